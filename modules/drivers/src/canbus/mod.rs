//! `driver_canbus`: CANopen master of the propulsion and the steering drive, and the place where it is decided whether
//! the robot may move.
//!
//! Read [`arbiter`] first (who may command), then [`surroundings`] (what else must be well), then `decide` here, which
//! turns both into what the two axes are told. Everything that is not a clear permission is a quick stop.
//!
//! Device    EPOS 70/10 and IclA N065; facts in `canopen::drives`
//! Timing    a command lives 250 ms; the master's heartbeat leaves every 50 ms, so a dead host stops the drives
//! Silence   of a drive: the other one stops, the node is booted again, nothing resumes by itself; so, too, after 2 s, where it
//!           lives but does not answer

pub mod arbiter;
pub mod surroundings;

mod bus;
mod config;
mod drive;
mod propulsion;
mod requests;
mod steering;
#[cfg(test)]
mod tests;

pub use config::{Config, Limits, PropulsionConfig, SteeringConfig};

use arbiter::{Arbiter, Command, Verdict};
use base::{Duration, Fault, Instant, Severity, Ticker};
use bus::Bus;
use canopen::master::ConfigError;
use canopen::{Event as Heard, Master, MasterConfig, NodeConfig, sdo};
use messages::{Channel, Message, common, lowlevel};
use module::sabotage::{self, Bug};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, State};
use propulsion::Propulsion;
use requests::{Requests, Whose};
use steering::Steering;
use surroundings::{Objection, Surroundings};

/// The module's name.
pub const NAME: &str = "driver_canbus";

const CAN: PortId = PortId(0);
/// Objects that are read when a drive has booted, or has been quiet.
const STATUSWORD: u16 = 0x6041;
const POSITION: u16 = 0x6064;
const VELOCITY: u16 = 0x606C;
const MEASURED: [u16; 3] = [STATUSWORD, POSITION, VELOCITY];
/// Drives answer within a few ms. Two questions without an answer, and the robot stops.
const SDO_TIMEOUT: Duration = Duration::from_millis(250);
/// A second master is told at most every 10 s while it is heard.
const SECOND_MASTER: Duration = Duration::from_secs(11);
const MOTION_PERIOD: Duration = Duration::from_millis(50);
const AXES_PERIOD: Duration = Duration::from_millis(200);
/// Slower than this the robot stands, m/s: one unit of the drive's speed resolution (30 rpm) is 0.012 m/s.
const STANDING: f64 = 0.02;

/// The module.
pub struct Canbus {
    config: Config,
    ports: [PortSpec; 1],
    master: Master,
    propulsion: Propulsion,
    steering: Steering,
    arbiter: Arbiter,
    around: Surroundings,
    bus: Bus,
    requests: Requests,
    state: State,
    /// What stands against motion, as it was decided last.
    blocked: Option<Blocked>,
    /// A command out of limits stops the robot until it has been absent for its time to live.
    refused_until: Option<Instant>,
    /// The last command that was not followed, and why; shown for its time to live.
    ignored: Option<(Instant, String)>,
    contested: Option<Instant>,
    /// Another master was heard; it stands against motion until this moment.
    second_master: Option<Instant>,
    working: Option<bool>,
    /// The planner was permitted to move the robot, as it was decided last.
    planned: bool,
    motion: Ticker,
    axes: Ticker,
    now: Instant,
}

/// Why the robot must not move.
#[derive(Clone, Debug, PartialEq)]
struct Blocked {
    reason: String,
    objection: Option<Objection>,
    /// Nothing else stands against motion than that the steering has no reference.
    only_not_homed: bool,
}

impl Canbus {
    /// The module.
    ///
    /// # Errors
    /// What CANopen does not allow: node ids out of range or given twice.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        let ports = [PortSpec { bus: config.bus.clone(), line: Line::Can { bitrate: config.bitrate } }];
        let propulsion = Propulsion::new(&config);
        let steering = Steering::new(&config);
        let nodes = [propulsion.node_config(), steering.node_config()];
        let (id, bit_rate, sync) = (config.node_id, config.bitrate, config.sync);
        let master = MasterConfig { id, bit_rate, sync, sdo_timeout: SDO_TIMEOUT, ..MasterConfig::default() };
        let master = Master::new(master, &nodes)?;
        Ok(Self {
            master,
            arbiter: Arbiter::new(config.ttl),
            around: Surroundings::new(config.critical.clone(), config.planning.clone(), config.has_pause_line),
            ports,
            propulsion,
            steering,
            bus: Bus::new(&config.bus, config.bitrate),
            requests: Requests::default(),
            config,
            state: State::Init,
            blocked: None,
            refused_until: None,
            ignored: None,
            contested: None,
            second_master: None,
            working: None,
            planned: false,
            motion: Ticker::new(Instant::NEVER, MOTION_PERIOD),
            axes: Ticker::new(Instant::NEVER, AXES_PERIOD),
            now: Instant::ZERO,
        })
    }

    /// How its nodes are set up, drive by drive.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeConfig> {
        let ids = [self.propulsion.drive.node, self.steering.drive.node];
        ids.into_iter().filter_map(|id| self.master.config(id))
    }

    fn on_message(&mut self, now: Instant, at: Instant, message: &Message, out: &mut Actions) {
        // A clock that was wrong when it was received must not make it live longer.
        let at = at.min(now);
        match message {
            Message::LlCmdMotion(command) => self.on_motion(now, at, command, out),
            Message::LlCmdHoming(homing) => self.on_homing(homing, out),
            Message::LlCmdSdo(request) => {
                let whose = self.whose(request.node);
                self.requests.on_command(now, request, whose, &mut self.master, out);
            }
            Message::CmDataProcesses(list) => self.around.on_processes(at, list),
            Message::LlEventStop(stop) => self.around.on_stop(at, stop),
            Message::MlDataEstimate(estimate) => self.around.on_estimate(at, estimate),
            Message::MlCmdGoal(goal) if !goal.waypoints.is_empty() => self.release_planner(at),
            Message::CmCmdState(command) => self.on_state_command(at, command),
            _ => {}
        }
    }

    fn on_motion(&mut self, now: Instant, at: Instant, command: &lowlevel::CmdMotion, out: &mut Actions) {
        // A command that waited longer than it lives says what somebody wanted then, not what he wants now.
        if now.since(at) >= self.config.ttl {
            return;
        }
        let limits = &self.config.limits;
        let in_limits = command.speed.abs() <= limits.speed && command.steering.abs() <= limits.steering;
        let in_limits = in_limits || sabotage::is(Bug::LimitsIgnored);
        if !in_limits || !arbiter::is_priority(command.priority) {
            self.refuse(now, command, out);
            return;
        }
        let asked = Command {
            speed: command.speed,
            steering: command.steering,
            priority: command.priority,
            source: command.source.clone(),
        };
        let verdict = self.arbiter.command(at, asked, self.blocked.is_some());
        let why = match verdict {
            // What blocks it is told in its own words.
            Verdict::Holds | Verdict::Blocked => {
                self.ignored = None;
                return;
            }
            Verdict::Overruled => format!("{} is overruled by a higher priority", command.source),
            Verdict::Contested => {
                format!("{} must wait: another source of its priority moves the robot", command.source)
            }
            Verdict::NotReleased => format!("{} must send zero first: the robot was stopped", command.source),
            Verdict::Latched => format!("{} must be let go by an operator first", command.source),
        };
        if verdict == Verdict::Contested {
            self.contested = Some(now + self.config.ttl);
            out.raise(Severity::Warning, Fault::MotionContested, "", why.as_str());
        }
        self.ignored = Some((now + self.config.ttl, why));
    }

    /// A command that no honest source sends: the robot stops, whoever sent it.
    fn refuse(&mut self, now: Instant, command: &lowlevel::CmdMotion, out: &mut Actions) {
        let limits = &self.config.limits;
        let message = format!(
            "command of {} refused: speed {} m/s (at most {}), steering {} rad (at most {}), priority {}",
            command.source, command.speed, limits.speed, command.steering, limits.steering, command.priority
        );
        self.refused_until = Some(now + self.config.ttl);
        out.raise(Severity::Error, Fault::MotionRefused, "", message);
    }

    fn on_homing(&mut self, homing: &lowlevel::CmdHoming, out: &mut Actions) {
        match homing.axis.as_str() {
            "steering" if self.is_standing() && self.state == State::Run => self.steering.home_again(),
            "steering" => {
                let why = "homing the steering refused: the robot moves, or the module is not in RUN";
                out.report(Severity::Warning, Fault::CommandForbidden, "steering", why);
            }
            axis => {
                let why = format!("homing of {axis:?} refused: only the steering has a reference");
                out.report(Severity::Warning, Fault::CommandForbidden, axis, why);
            }
        }
    }

    fn on_state_command(&mut self, at: Instant, command: &common::CmdState) {
        let planner = command.module == "planner" || command.module == "*";
        if planner && command.manual && command.state == State::Run as i8 {
            self.release_planner(at);
        }
    }

    fn release_planner(&mut self, at: Instant) {
        if self.blocked.is_none() {
            self.arbiter.release_planner(at);
        }
    }

    /// A node that is not booted does not move: it may be mended.
    fn whose(&self, node: i32) -> Whose {
        let ours = [&self.propulsion.drive, &self.steering.drive];
        match ours.into_iter().find(|drive| i32::from(drive.node) == node) {
            Some(drive) => Whose::Ours { standing: !drive.is_booted() || self.is_standing() },
            None => Whose::Others,
        }
    }

    fn on_port(&mut self, now: Instant, down: Option<&str>, out: &mut Actions) {
        self.bus.on_port(down, out);
        match down {
            Some(_) => self.master.handle_bus_down(now),
            None => self.master.handle_timeout(now),
        }
    }

    fn on_master(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.master.poll_event() {
            self.on_heard(now, event, out);
        }
        let working = self.propulsion.drive.is_booted() && self.steering.drive.is_booted();
        // Until the first success the module is starting; what it waits for has been reported.
        if working != self.working.unwrap_or(false) {
            self.working = Some(working);
            if working { out.working() } else { out.failed() }
        }
    }

    fn on_heard(&mut self, now: Instant, event: Heard, out: &mut Actions) {
        match event {
            Heard::Booted { node } => {
                let (subject, name) = self.name_of(node);
                out.clear(Fault::NodeClash, subject, format!("{name} answers once"));
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_booted(now, out);
                }
                if node == self.steering.drive.node {
                    self.steering.on_booted();
                }
                self.ask_where_it_is(now, node);
            }
            Heard::BootFailed { node, step, reason } => {
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_boot_failed(step, reason, out);
                }
            }
            Heard::Lost { .. } if sabotage::is(Bug::LostDriveIgnored) => {}
            Heard::Lost { node, reason } => {
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_lost(reason, out);
                }
                if node == self.steering.drive.node {
                    self.steering.on_lost();
                } else if node == self.propulsion.drive.node {
                    self.propulsion.on_lost();
                }
            }
            Heard::Emergency { node, emergency, suppressed } => {
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_emergency(&emergency, suppressed, out);
                }
            }
            Heard::Pdo { node, number, data, len } => {
                let data = &data[..usize::from(len).min(data.len())];
                if node == self.propulsion.drive.node {
                    self.propulsion.on_pdo(now, number, data, out);
                } else if node == self.steering.drive.node {
                    self.steering.on_pdo(now, number, data, out);
                }
            }
            // What somebody else asked for comes first: it may be an object that is asked for here, too.
            Heard::SdoRead { ticket, ref data, .. } if self.requests.on_end(now, ticket, Ok(data), out) => {}
            Heard::SdoWritten { ticket, .. } if self.requests.on_end(now, ticket, Ok(&[]), out) => {}
            Heard::SdoFailed { ticket, error, .. } if self.requests.on_end(now, ticket, Err(error), out) => {}
            Heard::SdoRead { node, index, sub: 0, ref data, .. } if MEASURED.contains(&index) => {
                self.on_measured(now, node, index, data, out);
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_answer(now, true, out);
                }
            }
            Heard::SdoFailed { node, index, sub: 0, error, .. } if MEASURED.contains(&index) => {
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_answer(now, error == sdo::Error::Cancelled, out);
                }
            }
            Heard::SdoRead { .. } | Heard::SdoWritten { .. } | Heard::SdoFailed { .. } => {
                self.steering.on_sdo(now, &event);
            }
            Heard::Malformed { node, count } => {
                let message = format!("{count} frames of node {node} that CANopen does not allow, dropped");
                out.report(Severity::Warning, Fault::CanMalformed, format!("node {node}"), message);
            }
            Heard::SecondMaster => {
                let Config { node_id, bus, .. } = &self.config;
                let message = format!("another master with node id {node_id} is on {bus}: the robot stops");
                out.raise(Severity::Error, Fault::SecondMaster, bus.as_str(), message);
                self.second_master = Some(now + SECOND_MASTER);
            }
            Heard::DuplicateId { node } => {
                let (subject, name) = self.name_of(node);
                let message =
                    format!("{name} keeps resetting, or two nodes of {} have its id; the robot stops", self.config.bus);
                out.raise(Severity::Error, Fault::NodeClash, subject, message);
            }
            Heard::Babbling { node, rate } => {
                let (subject, name) = self.name_of(node);
                let message = format!("{name} floods {}: {rate} frames/s", self.config.bus);
                out.raise(Severity::Error, Fault::CanBabble, subject, message);
            }
            Heard::BabblingOver { node } => {
                let (subject, name) = self.name_of(node);
                out.clear(Fault::CanBabble, subject, format!("{name} is quiet on {} again", self.config.bus));
            }
            Heard::Swapped { node, serial } => {
                out.note(format!("{} is another device now, serial number {serial:#x}", self.name_of(node).1));
            }
            Heard::Stranger { node } => {
                out.note(format!("node {node} on {} is not in the configuration", self.config.bus));
            }
            // The drives tell it one by one.
            Heard::Ready | Heard::NotReady => {}
        }
    }

    /// Event-driven PDOs tell changes only, and the first ones may have left before the node counted as started.
    fn ask_where_it_is(&mut self, now: Instant, node: u8) {
        let measured = if node == self.propulsion.drive.node { VELOCITY } else { POSITION };
        for index in [measured, STATUSWORD] {
            // The queue of a node that has just booted has room for both.
            if self.master.sdo_read(now, node, index, 0).is_ok()
                && let Some(drive) = self.drive_mut(node)
            {
                drive.on_asked();
            }
        }
    }

    fn on_measured(&mut self, now: Instant, node: u8, index: u16, data: &[u8], out: &mut Actions) {
        match (index, data) {
            (VELOCITY, &[a, b, c, d]) => self.propulsion.on_velocity(now, i32::from_le_bytes([a, b, c, d])),
            (POSITION, &[a, b, c, d]) => self.steering.on_position(now, i32::from_le_bytes([a, b, c, d])),
            (STATUSWORD, &[low, high]) => {
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_statusword(now, u16::from_le_bytes([low, high]), out);
                }
            }
            _ => {}
        }
    }

    /// A node for reports' subjects, and for people.
    fn name_of(&self, node: u8) -> (String, String) {
        let drives = [&self.propulsion.drive, &self.steering.drive];
        match (drives.into_iter().find(|drive| drive.node == node), node) {
            (Some(drive), _) => (drive.name.into(), format!("{} drive (node {node})", drive.name)),
            (None, 0) => (self.config.bus.clone(), "somebody".into()),
            (None, _) => (format!("node {node}"), format!("node {node}")),
        }
    }

    fn drive_mut(&mut self, node: u8) -> Option<&mut drive::Drive> {
        [&mut self.propulsion.drive, &mut self.steering.drive].into_iter().find(|drive| drive.node == node)
    }

    /// Whether it is known to stand.
    fn is_standing(&self) -> bool {
        self.propulsion.is_slower(self.now, STANDING)
    }

    /// What stands against any motion, in the order in which an engineer would ask.
    fn objection(&self, now: Instant) -> Option<Blocked> {
        let plain = |reason: String| Some(Blocked { reason, objection: None, only_not_homed: false });
        if let Some(reason) = self.bus.objection() {
            return plain(reason);
        }
        if self.second_master.is_some() {
            return plain("another master commands the drives".into());
        }
        let around = |objection: Objection| {
            let reason = objection.to_string();
            Some(Blocked { reason, objection: Some(objection), only_not_homed: false })
        };
        // Before the drives: the line takes their feed away, and that they are in fault follows from it.
        let paused = |objection: &Objection| matches!(objection, Objection::Paused(_));
        if let Some(objection) = self.around.objection(now).filter(paused) {
            return around(objection);
        }
        if let Some(reason) = self.propulsion.drive.objection().or_else(|| self.steering.drive.objection()) {
            return plain(reason);
        }
        if self.state != State::Run && !sabotage::is(Bug::StateIgnored) {
            return plain(format!("{NAME} is in {}", self.state));
        }
        if let Some(objection) = self.around.objection(now) {
            return around(objection);
        }
        if self.refused_until.is_some() {
            return plain("a command was out of limits".into());
        }
        if !self.steering.is_homed() && !sabotage::is(Bug::HomingNotRequired) {
            // Asked last: this alone may be mended by moving the steering.
            return Some(Blocked { reason: self.steering.why_not_homed(), objection: None, only_not_homed: true });
        }
        None
    }

    /// Turns what is known into what the axes are told. Called after every event.
    fn decide(&mut self, now: Instant, out: &mut Actions) {
        self.forget(now, out);
        let blocked = self.objection(now);
        if blocked != self.blocked {
            self.report_change(blocked.as_ref(), out);
            self.arbiter.stopped(now);
            self.blocked = blocked;
        }
        if self.is_standing() {
            self.arbiter.standing(now);
        }
        self.watch_planner(now);
        match self.permitted(now) {
            Some((speed, steering)) => {
                self.steering.go(steering);
                // A robot that does not steer does not drive.
                self.propulsion.drive(if self.steering.is_enabled() { speed } else { 0.0 });
            }
            None => {
                self.propulsion.quick_stop();
                self.decide_steering();
            }
        }
        self.arbiter.decided(now);
        self.propulsion.advance(now, &mut self.master, out);
        self.steering.advance(now, &mut self.master, out);
        for drive in [&mut self.propulsion.drive, &mut self.steering.drive] {
            if drive.gives_up(now) {
                self.master.reboot(now, drive.node);
            }
        }
        for (node, in_doubt) in [self.propulsion.drive.take_doubt(), self.steering.drive.take_doubt()] {
            if in_doubt {
                self.ask_where_it_is(now, node);
            }
        }
    }

    /// Without an estimate, or the modules that it needs, the planner stops; when they come back that does not let it go
    /// again.
    fn watch_planner(&mut self, now: Instant) {
        let plans = self.arbiter.current(now).is_some_and(|command| command.priority == arbiter::PLANNER);
        let objection = self.around.objection_to_planner(now).filter(|_| plans);
        self.planned = match objection {
            Some(why) if self.planned => {
                self.arbiter.stopped(now);
                self.ignored = Some((now + self.config.ttl, why));
                false
            }
            Some(_) => false,
            None => plans,
        };
    }

    /// The steering while nobody moves the robot: it is homed when nothing but that stands against motion, holds its
    /// angle when nobody commands, and stops where it is when something is wrong.
    fn decide_steering(&mut self) {
        match &self.blocked {
            None => self.steering.hold(),
            Some(blocked) if blocked.only_not_homed && self.is_standing() => self.steering.home(),
            Some(_) => self.steering.quick_stop(),
        }
    }

    /// Speed and steering that may be driven now.
    fn permitted(&self, now: Instant) -> Option<(f64, f64)> {
        if self.blocked.is_some() {
            return None;
        }
        let command = self.arbiter.current(now)?;
        let limits = &self.config.limits;
        let planner = command.priority == arbiter::PLANNER;
        if planner && self.around.objection_to_planner(now).is_some() {
            return None;
        }
        let by_source = if planner { limits.speed_autonomous } else { limits.speed_manual };
        let curvature = libm::fabs(libm::tan(command.steering) / self.config.wheelbase);
        let by_curve = if curvature > 0.0 { libm::sqrt(limits.lateral_acceleration / curvature) } else { by_source };
        let bound = by_source.min(by_curve);
        Some((command.speed.clamp(-bound, bound), command.steering))
    }

    fn forget(&mut self, now: Instant, out: &mut Actions) {
        if self.refused_until.is_some_and(|until| until <= now) {
            self.refused_until = None;
            out.clear(Fault::MotionRefused, "", "commands are within limits again");
        }
        if self.second_master.is_some_and(|until| until <= now) {
            self.second_master = None;
            let bus = self.config.bus.as_str();
            out.clear(Fault::SecondMaster, bus, format!("no other master is heard on {bus}"));
        }
        if self.contested.is_some_and(|until| until <= now) {
            self.contested = None;
            out.clear(Fault::MotionContested, "", "one source commands the motion");
        }
        if self.ignored.as_ref().is_some_and(|(until, _)| *until <= now) {
            self.ignored = None;
        }
    }

    fn report_change(&self, blocked: Option<&Blocked>, out: &mut Actions) {
        let fault = |blocked: &Blocked| blocked.objection.as_ref().and_then(Objection::fault);
        let was = self.blocked.as_ref().and_then(fault);
        let is = blocked.and_then(fault);
        if let Some(was) = was.filter(|was| is != Some(*was)) {
            out.clear(was, "", "what stopped the robot is over; it moves when it is commanded anew");
        }
        if let (Some(is), Some(blocked)) = (is, blocked) {
            out.raise(Severity::Error, is, "", format!("the robot is stopped: {}", blocked.reason));
        }
    }

    /// Why it does not move; empty when it does as commanded.
    fn reason(&self, now: Instant) -> String {
        let ignored = || self.ignored.as_ref().map(|(_, why)| why.clone());
        match (&self.blocked, self.arbiter.current(now)) {
            (Some(blocked), _) => blocked.reason.clone(),
            (None, Some(command)) if command.priority == arbiter::PLANNER => {
                self.around.objection_to_planner(now).unwrap_or_default()
            }
            (None, Some(_)) => String::new(),
            (None, None) => ignored().unwrap_or_else(|| "nobody commands the motion".into()),
        }
    }

    fn publish_motion(&self, now: Instant, out: &mut Actions) {
        let (speed_target, steering_target) = self.permitted(now).unwrap_or((0.0, self.steering.angle()));
        let source = self.arbiter.current(now).map_or(String::new(), |command| command.source.clone());
        out.publish(lowlevel::DataMotion {
            timestamp: out.timestamp(now),
            speed: self.propulsion.speed(),
            steering: self.steering.angle(),
            speed_target,
            steering_target,
            enabled: self.propulsion.is_enabled() && self.steering.is_enabled(),
            homed: self.steering.is_homed(),
            quick_stop: self.propulsion.is_quick_stopped(),
            source,
            reason: self.reason(now),
        });
    }

    fn publish_axes(&self, now: Instant, out: &mut Actions) {
        let axes = vec![self.propulsion.row(&self.master), self.steering.row(&self.master)];
        out.publish(lowlevel::DataAxes { timestamp: out.timestamp(now), axes });
    }

    fn publish_bus(&mut self, now: Instant, out: &mut Actions) {
        let mut message = self.bus.message(out.timestamp(now));
        let drives = [&self.propulsion.drive, &self.steering.drive];
        message.nodes = drives.map(|drive| bus::node(drive.name, drive.node, &mut self.master)).into();
        out.publish(message);
    }
}

impl Module for Canbus {
    fn subscriptions(&self) -> &[Channel] {
        &[
            Channel::LlCmdMotion,
            Channel::LlCmdHoming,
            Channel::LlCmdSdo,
            Channel::LlEventStop,
            Channel::CmDataProcesses,
            Channel::CmCmdState,
            Channel::MlDataEstimate,
            Channel::MlCmdGoal,
        ]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        self.now = now;
        match event {
            Event::Start => {
                self.motion = Ticker::new(now, MOTION_PERIOD);
                self.axes = Ticker::new(now, AXES_PERIOD);
                self.bus.start(now);
            }
            Event::Message { at, message } => self.on_message(now, at, message, out),
            Event::Port { input: Input::Can(frame), .. } => {
                self.bus.crossed(&frame);
                self.master.handle_rx(now, &frame);
            }
            Event::Port { input: Input::CanNotice(notice), .. } => self.bus.on_notice(now, notice, out),
            Event::Port { input: Input::Up, .. } => self.on_port(now, None, out),
            Event::Port { input: Input::Down(why), .. } => self.on_port(now, Some(why), out),
            Event::State(state) => self.state = state,
            Event::Timer if self.bus.is_up() => self.master.handle_timeout(now),
            Event::Port { .. } | Event::Heard { .. } | Event::Process(_) | Event::Timer => {}
        }
        self.on_master(now, out);
        self.decide(now, out);
        self.on_master(now, out);
        let blind_stop = self.propulsion.blind_stop(now, self.bus.is_up());
        for frame in blind_stop.into_iter().chain(std::iter::from_fn(|| self.master.poll_tx())) {
            self.bus.crossed(&frame);
            out.send_can(CAN, frame);
        }
        if self.bus.handle_timeout(now, out) {
            self.publish_bus(now, out);
        }
        if self.motion.due(now) {
            self.publish_motion(now, out);
        }
        if self.axes.due(now) | self.propulsion.drive.take_changed() | self.steering.drive.take_changed() {
            self.publish_axes(now, out);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let own = [
            Some(self.motion.next()),
            Some(self.axes.next()),
            self.master.poll_timeout().filter(|_| self.bus.is_up()),
            self.bus.poll_timeout(),
            self.propulsion.poll_timeout(),
            self.steering.poll_timeout(),
            self.arbiter.poll_timeout(self.now),
            self.around.poll_timeout(self.now),
            self.refused_until,
            self.contested,
            self.second_master,
        ];
        own.into_iter().flatten().min()
    }

    /// The drives hold the robot's last speed until their ramp is done: the process stays, and its heartbeat with it.
    fn finished(&self) -> bool {
        !self.bus.is_up() || !self.propulsion.drive.is_booted() || self.is_standing()
    }
}
