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
mod ignored;
mod objection;
mod propulsion;
mod requests;
mod steering;
#[cfg(test)]
mod tests;

pub use config::{Axis, BusConfig, Config, Drive, EposConfig, Node, PropulsionConfig, SteeringConfig};

use arbiter::{Arbiter, Verdict};
use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use bus::Bus;
use canopen::master::{ConfigError, Ticket};
use canopen::{Event as Heard, Master, MasterConfig, NodeConfig, sdo};
use ignored::Ignored;
use messages::{Channel, Hold, Message, common, lowlevel};
use module::sabotage::{self, Bug};
use module::{Actions, Event, Holds, Input, Line, Module, PortId, PortSpec, Standing, State};
use objection::Objection;
use propulsion::Propulsion;
use requests::{Requests, Whose};
use steering::Steering;
use surroundings::Surroundings;

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

base::deadlines! {
    /// What the module itself waits for.
    enum Timer {
        /// `LL_DATA_MOTION` is published. Set from the start on.
        Motion,
        /// `LL_DATA_AXES` is published. Set from the start on.
        Axes,
        /// The command out of limits that stops the robot has been absent for its time to live. Set while it stops it.
        Refused,
        /// No other source of the holder's priority has sent a command for its time to live. Set while it is reported.
        Contested,
        /// The other master on the bus has been silent for long enough. Set while it stands against motion.
        SecondMaster,
    }
}

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
    /// The weightiest of what stands against any motion, as it was decided last.
    blocked: Option<Objection>,
    ignored: Ignored,
    holds: Holds,
    working: Option<bool>,
    /// The planner was permitted to move the robot, as it was decided last.
    planned: bool,
    deadlines: Deadlines<Timer>,
    now: Instant,
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
            arbiter: Arbiter::new(config.limits.command_ttl),
            around: Surroundings::new(config.critical.clone(), config.planning.clone(), config.has_pause_line),
            ports,
            propulsion,
            steering,
            bus: Bus::new(&config.bus, config.bitrate),
            requests: Requests::default(),
            config,
            state: State::Init,
            blocked: None,
            ignored: Ignored::default(),
            holds: Holds::default(),
            working: None,
            planned: false,
            deadlines: Deadlines::new(),
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
        if now.since(at) >= self.config.limits.command_ttl {
            return;
        }
        let limits = &self.config.limits;
        let in_limits = command.speed.abs() <= limits.speed_mps && command.steering.abs() <= limits.steering_rad;
        let in_limits = in_limits || sabotage::is(Bug::LimitsIgnored);
        if !in_limits || !arbiter::is_priority(command.priority) {
            self.refuse(now, command, out);
            return;
        }
        let (source, verdict) = self.arbiter.command(at, command, self.blocked.is_some());
        let why = match verdict {
            Verdict::Holds => None,
            // What comes after the stop: whoever commands on through it must let go first.
            Verdict::Blocked if command.priority == arbiter::PLANNER => Some(Hold::PlannerLatched),
            Verdict::Blocked => (command.speed != 0.0).then_some(Hold::NotReleased),
            Verdict::Overruled => Some(Hold::Overruled),
            Verdict::Contested => Some(Hold::Contested),
            Verdict::NotReleased => Some(Hold::NotReleased),
            Verdict::Latched => Some(Hold::PlannerLatched),
        };
        if verdict == Verdict::Contested {
            self.deadlines.set(Timer::Contested, now + self.config.limits.command_ttl);
            out.raise(Severity::Warning, Fault::MotionContested, "", Hold::Contested.words(&command.source));
        }
        self.ignored.put(now + self.config.limits.command_ttl, source, why);
    }

    /// A command that no honest source sends: the robot stops, whoever sent it.
    fn refuse(&mut self, now: Instant, command: &lowlevel::CmdMotion, out: &mut Actions) {
        let limits = &self.config.limits;
        let message = format!(
            "command of {} refused: speed {} m/s (at most {}), steering {} rad (at most {}), priority {}",
            command.source, command.speed, limits.speed_mps, command.steering, limits.steering_rad, command.priority
        );
        self.deadlines.set(Timer::Refused, now + self.config.limits.command_ttl);
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
            Heard::SdoRead { ticket, ref data, .. } => self.on_sdo(now, ticket, Ok(data), &event, out),
            Heard::SdoWritten { ticket, .. } => self.on_sdo(now, ticket, Ok(&[]), &event, out),
            Heard::SdoFailed { ticket, error, .. } => self.on_sdo(now, ticket, Err(error), &event, out),
            Heard::Malformed { node, count } => {
                let message = format!("{count} frames of node {node} that CANopen does not allow, dropped");
                out.report(Severity::Warning, Fault::CanMalformed, format!("node {node}"), message);
            }
            Heard::SecondMaster => {
                let Config { node_id, bus, .. } = &self.config;
                let message = format!("another master with node id {node_id} is on {bus}: the robot stops");
                out.raise(Severity::Error, Fault::SecondMaster, bus.as_str(), message);
                self.deadlines.set(Timer::SecondMaster, now + SECOND_MASTER);
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

    /// A transfer has ended: one of `LL_CMD_SDO`, of what the drives measure, or of homing.
    fn on_sdo(
        &mut self,
        now: Instant,
        ticket: Ticket,
        result: Result<&[u8], sdo::Error>,
        event: &Heard,
        out: &mut Actions,
    ) {
        // What was requested from outside comes first: it may be an object that is asked for here, too.
        if self.requests.on_end(now, ticket, result, out) {
            return;
        }
        match *event {
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
            _ => self.steering.on_sdo(now, event),
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

    /// All that stands against any motion, in the order in which an engineer would ask.
    fn objections(&self, now: Instant) -> impl Iterator<Item = Objection> + Clone + '_ {
        let bus = self.bus.objection().map(Objection::Bus);
        let second_master = self.deadlines.is_set(Timer::SecondMaster).then_some(Objection::SecondMaster);
        let around = move |paused: bool| {
            let is_pause =
                |objection: &surroundings::Objection| matches!(objection, surroundings::Objection::Paused(_));
            self.around.objections(now).filter(move |objection| is_pause(objection) == paused).map(Objection::Around)
        };
        let drives = [(Axis::Propulsion, &self.propulsion.drive), (Axis::Steering, &self.steering.drive)];
        let drives = drives.into_iter().filter_map(|(axis, drive)| Some(Objection::Drive(axis, drive.objection()?)));
        let state = self.state.hold().filter(|_| !sabotage::is(Bug::StateIgnored)).map(Objection::State);
        let refused = self.deadlines.is_set(Timer::Refused).then_some(Objection::Refused);
        let not_homed = self.steering.why_not_homed().filter(|_| !sabotage::is(Bug::HomingNotRequired));
        // The PAUSE line before the drives: it takes their feed away, and that they are in fault follows from it.
        let devices = bus.into_iter().chain(second_master).chain(around(true)).chain(drives);
        // Homing last: where it stands alone, it may be mended by moving the steering.
        devices.chain(state).chain(around(false)).chain(refused).chain(not_homed.map(Objection::NotHomed))
    }

    /// All for which the robot does not do as it is commanded, the weightiest first; nothing while it does.
    fn causes(&self, now: Instant) -> impl Iterator<Item = Standing<'_>> + Clone {
        let blocked = self.objections(now).next().is_some();
        let holder = self.arbiter.current(now).map(|command| command.priority);
        let waits = blocked || holder.is_none();
        let plans =
            holder.map_or_else(|| self.ignored.has_planner(&self.arbiter), |priority| priority == arbiter::PLANNER);
        let to_planner = self.around.objections_to_planner(now).filter(move |_| plans && !blocked);
        let ignored = self.ignored.standing(&self.arbiter).filter(move |_| waits);
        let nobody =
            (!blocked && waits && ignored.clone().next().is_none()).then_some(Standing::new(Hold::NobodyCommands, ""));
        let objections = self.objections(now).map(|objection| self.standing(objection));
        let to_planner = to_planner.map(|(hold, subject)| Standing::new(hold, subject));
        objections.chain(to_planner).chain(ignored).chain(nobody)
    }

    /// Turns what is known into what the axes are told. Called after every event.
    fn decide(&mut self, now: Instant, out: &mut Actions) {
        self.forget(now, out);
        let blocked = self.objections(now).next();
        if blocked != self.blocked {
            self.report_change(blocked, out);
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
        let current = self.arbiter.current(now).filter(|command| command.priority == arbiter::PLANNER);
        let plans = current.is_some();
        let objects = plans && self.around.objections_to_planner(now).next().is_some();
        if let Some(command) = current.filter(|_| objects && self.planned) {
            let until = now + self.config.limits.command_ttl;
            self.ignored.put(until, command.source, Some(Hold::PlannerLatched));
            self.arbiter.stopped(now);
        }
        self.planned = plans && !objects;
    }

    /// The steering while nobody moves the robot: it is homed when nothing but that stands against motion, holds its
    /// angle when nobody commands, and stops where it is when something is wrong.
    fn decide_steering(&mut self) {
        match &self.blocked {
            None => self.steering.hold(),
            // Listed last: nothing else stands against motion.
            Some(Objection::NotHomed(_)) if self.is_standing() => self.steering.home(),
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
        if planner && self.around.objections_to_planner(now).next().is_some() {
            return None;
        }
        let by_source = if planner { limits.speed_autonomous_mps } else { limits.speed_manual_mps };
        let curvature = libm::fabs(libm::tan(command.steering) / self.config.wheelbase);
        let by_curve =
            if curvature > 0.0 { libm::sqrt(limits.lateral_acceleration_mps2 / curvature) } else { by_source };
        let bound = by_source.min(by_curve);
        Some((command.speed.clamp(-bound, bound), command.steering))
    }

    fn forget(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.take(Timer::Refused, now) {
            out.clear(Fault::MotionRefused, "", "commands are within limits again");
        }
        if self.deadlines.take(Timer::SecondMaster, now) {
            let bus = self.config.bus.as_str();
            out.clear(Fault::SecondMaster, bus, format!("no other master is heard on {bus}"));
        }
        if self.deadlines.take(Timer::Contested, now) {
            out.clear(Fault::MotionContested, "", "one source commands the motion");
        }
        self.ignored.forget(now);
    }

    fn report_change(&self, blocked: Option<Objection>, out: &mut Actions) {
        let was = self.blocked.and_then(Objection::fault);
        let is = blocked.and_then(Objection::fault);
        if let Some(was) = was.filter(|was| is != Some(*was)) {
            out.clear(was, "", "what stopped the robot is over; it moves when it is commanded anew");
        }
        if let (Some(is), Some(blocked)) = (is, blocked) {
            out.raise(Severity::Error, is, "", format!("the robot is stopped: {}", self.words(blocked)));
        }
    }

    /// Why it does not move, in words; empty when it does as commanded.
    fn reason(&self, now: Instant) -> String {
        if let Some(objection) = self.objections(now).next() {
            return self.words(objection);
        }
        self.causes(now).next().map_or_else(String::new, |cause| cause.hold.words(cause.subject))
    }

    fn publish_holds(&mut self, now: Instant, out: &mut Actions) {
        let mut holds = std::mem::take(&mut self.holds);
        holds.publish(now, NAME, self.causes(now), out);
        self.holds = holds;
    }

    fn publish_motion(&self, now: Instant, out: &mut Actions) {
        let (speed_target, steering_target) = self.permitted(now).unwrap_or((0.0, self.steering.angle()));
        let source = self.arbiter.current(now).map_or("", |command| self.arbiter.name(command.source)).into();
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
                self.deadlines.set(Timer::Motion, now);
                self.deadlines.set(Timer::Axes, now);
                self.holds.start(now);
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
        self.publish_holds(now, out);
        if self.deadlines.tick(Timer::Motion, now, MOTION_PERIOD) {
            self.publish_motion(now, out);
        }
        let due = self.deadlines.tick(Timer::Axes, now, AXES_PERIOD);
        if due | self.propulsion.drive.take_changed() | self.steering.drive.take_changed() {
            self.publish_axes(now, out);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        earliest([
            self.deadlines.next(),
            Some(self.holds.next()),
            self.ignored.poll_timeout(),
            self.master.poll_timeout().filter(|_| self.bus.is_up()),
            self.bus.poll_timeout(),
            self.propulsion.poll_timeout(),
            self.steering.poll_timeout(),
            self.arbiter.poll_timeout(self.now),
            self.around.poll_timeout(self.now),
        ])
    }

    /// The drives hold the robot's last speed until their ramp is done: the process stays, and its heartbeat with it.
    fn finished(&self) -> bool {
        !self.bus.is_up() || !self.propulsion.drive.is_booted() || self.is_standing()
    }
}
