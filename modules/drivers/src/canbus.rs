//! `driver_canbus`: master of the drives of wheels and steering, which decides whether the robot may move. Those of
//! wheels may be motor controllers without CANopen, on CAN or on serial lines; without a CANopen node no frame of
//! CANopen is sent, and without a drive on CAN there need not be a CAN bus. There may be several (`net`): each has a
//! master of its own, and the drives of all of them are one body.
//!
//! Read [`arbiter`] first (which source may command), then [`surroundings`] (other conditions of motion), then `decide`
//! here, which turns both into the goals of the axes. Anything but a clear permission is a quick stop.
//!
//! Device    EPOS 70/10 and IclA N065, facts in `canopen::drives`; any drive of CiA 402 by its data sheet; ODrive,
//!           VESC and RoboClaw
//! Timing    a command is valid for 250 ms; the master's heartbeat is sent every 50 ms, so a dead host stops the drives
//! Silence   of a drive: all others stop, the node is booted again, nothing resumes by itself. The same after 2 s
//!           if the drive sends heartbeats but does not answer

pub mod arbiter;
pub mod protection;
pub mod ranging;
pub mod surroundings;

mod agreement;
mod axis;
mod body;
mod brake;
mod bus;
mod cia402;
mod config;
mod controller;
mod devices;
mod drive;
mod engine;
mod feed_output;
mod identity_keys;
mod ignored;
mod inputs;
mod keys;
mod line_keys;
mod lines;
mod motor_watch;
mod net;
mod objection;
mod odrive;
mod pause;
mod propulsion;
mod ramp;
mod readback;
mod reference;
mod release;
mod requests;
mod second_way;
mod servo;
mod speed_monitor;
mod steering;
mod strain;
pub mod table;
pub mod tables;
#[cfg(test)]
mod tests;
mod vesc;
mod wheels;

pub use axis::Axis;
pub use cia402::{BrakeControl, Cia402, Cia402Config, DriveMode, VelocityUnit};
pub use config::{
    BusConfig, Config, ConfigError, Drive, FurtherBus, HomingRelease, HomingSwitch, Node, PauseStop, PropulsionConfig,
    PropulsionDrive, SecondWay, SteeringConfig, SteeringDrive, SteeringKeys, Stop, StopInput, UnbrakedStop, WheelKeys,
};
pub use feed_output::{GpioConfig, OutputConfig};
pub use keys::ControllerConfig;
pub use line_keys::{LineConfig, LineKeys, RoboClawConfig, RoboClawMotor, UartVescConfig};
pub use net::node_number;
pub use odrive::{OdriveConfig, Release};
pub use pause::Paused;
pub use vesc::{VescConfig, VescMotor};

use agreement::AgreementWatch;
use arbiter::{Arbiter, Course, Request, Verdict};
use base::can::Frame;
use base::{Deadlines, Duration, Fault, Instant, Level, Severity, earliest};
use body::{Body, Caps, Measured, SetPoints};
use canopen::master::Ticket;
use canopen::{Event as CanEvent, NodeConfig, sdo};
use devices::Devices;
use ignored::Ignored;
use inputs::DriveInputs;
use kinematics::Twist;
use lines::{LineEngine, LinePort};
use messages::{Channel, Hold, Message, common, lowlevel, source_in_words};
use module::admission::Origin;
use module::{Actions, ActiveHold, Event, Holds, Input, Line, Module, PortId, PortSpec, State};
use net::{Net, NodeAt};
use objection::Objection;
use propulsion::Propulsion;
use protection::{Mover, Protection};
use ranging::Ranging;
use readback::{Found, Readback};
use release::Releases;
use requests::{NodeOwner, Requests};
use second_way::StopWatch;
use steering::Steering;
use strain::StrainWatch;
use surroundings::Surroundings;
use wheels::Wheels;

/// Name of the module.
pub const NAME: &str = "driver_canbus";

/// Name of the port of the GPIO line.
pub const LINE_BUS: &str = "stop.gpio";
/// Objects that are read from a drive that has booted or has sent nothing for a while.
const STATUSWORD: u16 = 0x6041;
const POSITION: u16 = 0x6064;
const VELOCITY: u16 = 0x606C;
/// Reported at each start of a robot without a PAUSE line and `[[stop.inputs]]`.
const NO_EMERGENCY_STOP: &str = "no emergency stop is read: neither a power controller reports the PAUSE line, nor has \
                                 [stop] inputs; one that is pressed must stop the robot without this computer";
/// Difference from the measured steering angle from which an angle is a motion, rad.
const TURN_RAD: f64 = 0.02;
const MEASURED_OBJECTS: [u16; 3] = [STATUSWORD, POSITION, VELOCITY];
/// Drives answer within a few ms. Two requests without an answer stop the robot.
const SDO_TIMEOUT: Duration = Duration::from_millis(250);
/// Reported at most every 10 s while frames of a second master arrive; blocks motion for 11 s after the last one.
const SECOND_MASTER_TIMEOUT: Duration = Duration::from_secs(11);
/// Time in which the drives are switched off when the module ends.
const SWITCH_OFF_MAX: Duration = Duration::from_millis(500);
const MOTION_PERIOD: Duration = Duration::from_millis(50);
const AXES_PERIOD: Duration = Duration::from_millis(200);
/// Period of `LL_DATA_BUS` for serial lines.
const LINES_PERIOD: Duration = Duration::from_secs(1);
/// Speed below which the robot counts as standing, m/s: one unit of the drive's speed resolution (30 rpm) is 0.012 m/s.
const STANDSTILL_MPS: f64 = 0.02;

base::deadlines! {
    /// Deadlines of the module itself.
    enum Timer {
        /// `LL_DATA_MOTION` is published. Set from the start on.
        Motion,
        /// `LL_DATA_AXES` is published. Set from the start on.
        Axes,
        /// `LL_DATA_BUS` is published for each serial line. Set from the start on, if there is one.
        Lines,
        /// The command out of limits that stops the robot has been absent for its time to live. Set while it stops it.
        Refused,
        /// No other source of the holder's priority has sent a command for its time to live. Set while it is reported.
        Contested,
        /// The order to cut the motors' feed is repeated. Set until it is known to be cut.
        Cut,
        /// The drives are left as they are although they are not switched off. Set when the module ends and the robot
        /// stands.
        SwitchOff,
    }
}

/// The module `driver_canbus`. Its ports: the first CAN bus, if there is one, the GPIO line that feeds the motors, if
/// there is one, the serial lines, the further CAN buses.
pub struct Canbus {
    config: Config,
    ports: Vec<PortSpec>,
    /// The CAN buses, at least one; the only one may have no bus: all drives are on serial lines.
    nets: Vec<Net>,
    wheels: Wheels,
    steering: Option<Steering>,
    body: Body,
    arbiter: Arbiter,
    around: Surroundings,
    releases: Releases,
    stop_watch: StopWatch,
    agreement: AgreementWatch,
    strain: StrainWatch,
    /// Of the wheels' drives, then of the steering's.
    readbacks: Vec<Readback>,
    /// Inputs of drives that stop the robot.
    inputs: DriveInputs,
    /// Devices with inputs and outputs.
    devices: Devices,
    protection: Protection,
    lines: Vec<LinePort>,
    requests: Requests,
    state: State,
    /// Main objection to any motion as of the last decision.
    blocked: Option<Objection>,
    /// The robot still brakes by the quick stop that an objection began: nobody is served before it stands, also if
    /// the objection has ended.
    stopping: bool,
    /// The module ends: its drives are off and were told to expect no master, and they have done so.
    leaves: bool,
    left: bool,
    ignored: Ignored,
    holds: Holds,
    working: Option<bool>,
    /// The planner was permitted to move the robot as of the last decision.
    planned: bool,
    /// A module without which the planner must not drive did not run at the last decision.
    planning_missing: bool,
    deadlines: Deadlines<Timer>,
    now: Instant,
}

/// Set-points within the robot's limits, and the source that commands them.
#[derive(Clone, Copy)]
struct Wanted<'a> {
    points: SetPoints,
    mover: Mover<'a>,
    /// The stopping distance bounds the speed more than the source's limit.
    capped: bool,
}

impl Canbus {
    /// Creates the module.
    ///
    /// # Errors
    /// Invalid in CANopen: node ids out of range or used twice. No base has these dimensions. Or a drive cannot be
    /// driven by its data sheet.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        let can = config.bus.clone().map(|bus| PortSpec { bus, line: Line::Can { bitrate: config.bitrate } });
        let line = config.stop.feed_line().map(|_| PortSpec { bus: LINE_BUS.into(), line: Line::Gpio });
        let feed_line = PortId(can.iter().len() as u8);
        let serial = |own: &LineConfig| PortSpec { bus: own.bus.clone(), line: Line::Serial { baud: own.baud } };
        let first = can.iter().chain(&line).count();
        let of_bus = |own: &FurtherBus| PortSpec { bus: own.bus.clone(), line: Line::Can { bitrate: own.bitrate } };
        let ports = can.into_iter().chain(line).chain(config.lines.iter().map(serial));
        let ports: Vec<PortSpec> = ports.chain(config.further.iter().map(of_bus)).collect();
        let engines = config.lines.iter().map(|own| LineEngine::new(own, &config)).collect::<Result<Vec<_>, _>>()?;
        let wheels = Wheels::new(&config, &engines)?;
        let lines = (first..).zip(config.lines.iter().zip(engines));
        let lines = lines.map(|(port, (own, engine))| LinePort::new(own, engine, PortId(port as u8))).collect();
        let body = Body::new(&config)?;
        let steering = config.steering.as_ref().map(|own| Steering::new(own, &config)).transpose()?;
        let devices = Devices::new(&config.devices, &config.stop, |name| config.bus_number(name));
        let output_bus = config.bus_number(config.stop.output_bus.as_deref());
        let stop_watch = StopWatch::new(&config.stop, config.has_pause_line, feed_line, output_bus);
        let mut nets = Vec::new();
        for bus in 0..=config.further.len() {
            let steers = steering.iter().filter(|own| own.drive.bus == bus).map(Steering::node_config);
            let nodes = wheels.node_configs(bus).chain(steers).chain(devices.node_configs(bus)).collect::<Vec<_>>();
            let mut net = match bus.checked_sub(1).map(|place| &config.further[place]) {
                None => Net::first(&config, &nodes)?,
                Some(own) => {
                    let port = ports.len() - config.further.len() + bus - 1;
                    Net::further(own, bus, PortId(port as u8), &nodes)?
                }
            };
            net.has_canopen |= stop_watch.node().is_some_and(|node| node.bus == bus);
            nets.push(net);
        }
        let drives = wheels.drives().chain(steering.iter().map(|own| &own.drive));
        let readback = |drive: &drive::Drive| {
            let setup = nets[drive.bus].master.config(drive.node)?;
            Some(Readback::new(setup, nets[drive.bus].master.id()))
        };
        let readbacks = drives.filter_map(readback).collect();
        let drives = wheels.drive_axes().zip(wheels.drives()).map(|(axis, drive)| (axis, drive.at()));
        let steers = steering.iter().map(|steering| (Axis::Steering, steering.drive.at()));
        let inputs = DriveInputs::new(&config.stop, drives.chain(steers));
        Ok(Self {
            nets,
            arbiter: Arbiter::new(config.limits.command_ttl),
            around: Surroundings::new(
                config.critical.clone(),
                config.planning.clone(),
                config.has_pause_line,
                (&config.fields, &inputs::names(&config.stop, &config.devices)),
                config.guarded,
                Ranging::new(&config.ranging, config.ranging_age_max),
            ),
            stop_watch,
            inputs,
            devices,
            agreement: AgreementWatch::default(),
            strain: StrainWatch::default(),
            readbacks,
            releases: Releases::new(config.homing_release == HomingRelease::Start),
            protection: Protection::new(config.protection),
            ports,
            wheels,
            steering,
            body,
            lines,
            requests: Requests::default(),
            config,
            state: State::Init,
            blocked: None,
            stopping: false,
            leaves: false,
            left: false,
            ignored: Ignored::default(),
            holds: Holds::default(),
            working: None,
            planned: false,
            planning_missing: false,
            deadlines: Deadlines::new(),
            now: Instant::ZERO,
        })
    }

    /// Configuration of each drive's node.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeConfig> {
        self.drives().filter_map(|drive| self.nets[drive.bus].master.config(drive.node))
    }

    /// The CANopen drives: the wheels', then the steering's.
    fn drives(&self) -> impl Iterator<Item = &drive::Drive> + Clone {
        self.wheels.drives().chain(self.steering.iter().map(|steering| &steering.drive))
    }

    fn drives_mut(&mut self) -> impl Iterator<Item = &mut drive::Drive> {
        self.wheels.drives_mut().chain(self.steering.iter_mut().map(|steering| &mut steering.drive))
    }

    /// What the CANopen drives move, in the same order.
    fn axes(&self) -> impl Iterator<Item = Axis> + Clone {
        self.wheels.drive_axes().chain(self.steering.iter().map(|_| Axis::Steering))
    }

    /// The steering, if this node is its drive.
    fn steering_at(&mut self, node: NodeAt) -> Option<&mut Steering> {
        self.steering.as_mut().filter(|steering| steering.drive.at() == node)
    }

    /// Measured angle of the steering, rad; 0 without one.
    fn angle(&self) -> f64 {
        self.steering.as_ref().map_or(0.0, Steering::angle)
    }

    /// Measured velocity.
    fn measured(&self) -> Measured {
        self.body.velocity(&self.wheels.measured(), self.angle())
    }

    /// Measured speed forward, m/s; 0 if unknown. That of a fixed axle that is driven as a whole is known without the
    /// steering's angle.
    fn speed(&self) -> f64 {
        let speed = match &self.steering {
            Some(_) if self.config.traction.is_the_axle() => {
                self.wheels.measured().first().map_or(f64::NAN, |axle| axle.speed_mps)
            }
            _ => self.measured().twist.vx,
        };
        if speed.is_nan() { 0.0 } else { speed }
    }

    fn on_message(&mut self, now: Instant, at: Instant, from: Origin, message: &Message, out: &mut Actions) {
        // The clock may have been wrong at reception, which must not extend the command's life.
        let at = at.min(now);
        match message {
            Message::LlCmdMotion(command) => self.on_motion(now, at, command, out),
            Message::LlCmdVelocity(command) => self.on_velocity(now, at, command, out),
            Message::LlCmdHoming(homing) => self.on_homing(now, at, homing, out),
            Message::LlCmdSdo(request) => {
                let at = NodeAt::of_request(request.node);
                let owner = at.map_or(NodeOwner::Others, |at| self.owner_of(at));
                let net = at.and_then(|at| Some((at, self.nets.get_mut(at.bus)?)));
                let node = net.filter(|(_, net)| net.has_canopen).map(|(at, net)| (at.bus, at.id, &mut net.master));
                self.requests.on_command(now, request, &owner, node, out);
            }
            Message::CmDataProcesses(list) => {
                self.around.on_processes(at, list);
                self.protection.on_watchdog(at);
                // An earlier process may have been commanded by a source that still commands.
                let inherited = self.steering.as_ref().is_some_and(Steering::is_inherited);
                if self.around.is_restarted() || inherited {
                    self.arbiter.trust_no_new_source();
                }
            }
            Message::LlDataGuard(guard) if !from.due => self.protection.on_guard_of_another(guard),
            Message::LlDataGuard(guard) => {
                self.protection.on_speed(self.speed());
                self.protection.on_guard(at, guard);
            }
            Message::LlCmdCreep(creep) => self.protection.on_creep(at, creep),
            Message::LlEventStop(stop) => self.around.on_stop(at, from, stop),
            Message::LlDataRanges(ranges) => self.around.on_ranges(at, ranges),
            Message::MlDataEstimate(estimate) => self.around.on_estimate(at, estimate),
            Message::MlCmdGoal(goal) if !goal.waypoints.is_empty() => self.on_goal(now, at, out),
            Message::MlCmdMode(mode) if mode.is_order_to_drive() => self.on_goal(now, at, out),
            Message::CmCmdState(command) => self.on_state_command(now, at, command, out),
            Message::LlDataPower(power) => self.on_power(now, power),
            Message::LlCmdPower(command) => self.on_power_command(now, command, out),
            Message::LlCmdNodeIo(order) => self.devices.on_order(at, order),
            _ => {}
        }
    }

    fn on_motion(&mut self, now: Instant, at: Instant, command: &lowlevel::CmdMotion, out: &mut Actions) {
        // A command that is already older than its time to live no longer expresses the source's intention.
        if now.since(at) >= self.config.limits.command_ttl {
            return;
        }
        let limits = &self.config.limits;
        let in_limits = command.speed.abs() <= limits.speed_mps && command.steering.abs() <= limits.steering_rad;
        if !in_limits || !arbiter::is_priority(command.priority) {
            let values = format!(
                "speed {} m/s (at most {}), steering {} rad (at most {})",
                command.speed, limits.speed_mps, command.steering, limits.steering_rad
            );
            self.refuse(now, &command.into(), &values, out);
            return;
        }
        self.on_request(now, at, &command.into(), out);
    }

    fn on_velocity(&mut self, now: Instant, at: Instant, command: &lowlevel::CmdVelocity, out: &mut Actions) {
        if now.since(at) >= self.config.limits.command_ttl {
            return;
        }
        let &lowlevel::CmdVelocity { vx, vy, omega, .. } = command;
        if !self.body.is_in_limits(Twist::new(vx, vy, omega)) || !arbiter::is_priority(command.priority) {
            let (speed, rotation) = self.body.limits();
            let values = format!(
                "{vx} m/s forward, {vy} m/s to the left (at most {speed}), {omega} rad/s (at most {rotation:.3})"
            );
            self.refuse(now, &command.into(), &values, out);
            return;
        }
        self.on_request(now, at, &command.into(), out);
    }

    /// A command within limits.
    fn on_request(&mut self, now: Instant, at: Instant, request: &Request<'_>, out: &mut Actions) {
        if self.arbiter.is_outdated(at, request) {
            return;
        }
        if self.arbiter.is_press(at, request) {
            self.on_act(now, at, false, out);
        }
        let (source, verdict) = self.arbiter.command(at, *request, self.blocked.is_some());
        let why = match verdict {
            Verdict::Holds => None,
            // State after the stop: a source that kept commanding during it must send zero first.
            Verdict::Blocked if request.priority == arbiter::PLANNER => Some(Hold::PlannerLatched),
            Verdict::Blocked => (!request.is_zero()).then_some(Hold::NotReleased),
            Verdict::Overruled => Some(Hold::Overruled),
            Verdict::Contested => Some(Hold::Contested),
            Verdict::NotReleased => Some(Hold::NotReleased),
            Verdict::Latched => Some(Hold::PlannerLatched),
        };
        if verdict == Verdict::Contested {
            self.deadlines.set(Timer::Contested, now + self.config.limits.command_ttl);
            out.raise(Severity::Warning, Fault::MotionContested, "", Hold::Contested.words(request.source));
        }
        self.ignored.put(now + self.config.limits.command_ttl, source, why);
    }

    /// Rejects a command that no correct source sends: the robot stops, whatever the source.
    fn refuse(&mut self, now: Instant, request: &Request<'_>, values: &str, out: &mut Actions) {
        let (by, priority) = (source_in_words(request.source), request.priority);
        let message = format!("command of {by} refused: {values}, priority {priority}");
        self.deadlines.set(Timer::Refused, now + self.config.limits.command_ttl);
        out.raise(Severity::Error, Fault::MotionRefused, "", message);
    }

    fn on_state_command(&mut self, now: Instant, at: Instant, command: &common::CmdState, out: &mut Actions) {
        let addressed = ["*", "planner", NAME].contains(&command.module.as_str());
        if !addressed || !command.manual || command.state != State::Run as i8 {
            return;
        }
        if command.module != "planner" {
            self.around.pause.overrule(now);
            self.acknowledge_speed(out);
        }
        let planner = command.module != NAME;
        self.on_act(now, at, planner, out);
        if planner {
            self.release_planner(at);
        }
    }

    fn on_goal(&mut self, now: Instant, at: Instant, out: &mut Actions) {
        self.on_act(now, at, true, out);
        self.release_planner(at);
    }

    fn release_planner(&mut self, at: Instant) {
        if self.blocked.is_none() {
            self.arbiter.release_planner(at);
        }
    }

    /// A node that is not booted does not move, so its objects may be written for repair. Those of the node that feeds
    /// the motors may not.
    fn owner_of(&self, node: NodeAt) -> NodeOwner {
        let of_canopen = |wheel: &&PropulsionConfig| {
            matches!(wheel.drive, PropulsionDrive::Table { .. } | PropulsionDrive::Cia402 { .. })
        };
        let wheels = self.config.wheels.iter().filter(of_canopen).map(|wheel| &wheel.writable);
        let writable = wheels.chain(self.config.steering.iter().map(|steering| &steering.writable));
        let is_it = |own: NodeAt| own == node;
        match self.drives().zip(writable).find(|(drive, _)| drive.at() == node) {
            Some((drive, writable)) => {
                NodeOwner::Ours { standing: !drive.is_booted() || self.is_standing(), writable: writable.clone() }
            }
            None if self.stop_watch.node().into_iter().chain(self.devices.nodes().map(|(_, own)| own)).any(is_it) => {
                NodeOwner::Ours { standing: self.is_standing(), writable: Vec::new() }
            }
            None => NodeOwner::Others,
        }
    }

    fn on_port(&mut self, now: Instant, port: PortId, down: Option<&str>, out: &mut Actions) {
        let Some(number) = self.net_at(port) else { return };
        let net = &mut self.nets[number];
        if let Some(bus) = &mut net.bus {
            bus.on_port(down, out);
        }
        self.wheels.controllers_of_bus(number).for_each(|controller| controller.on_bus(now, down.is_none(), out));
        match down {
            _ if !net.has_canopen => {}
            Some(_) => net.master.handle_bus_down(now),
            None => net.master.handle_timeout(now),
        }
    }

    /// An input of a serial line; false if the port is of no line.
    fn on_line(&mut self, now: Instant, port: PortId, input: &Input<'_>, out: &mut Actions) -> bool {
        let Some(number) = self.lines.iter().position(|line| line.port == port) else { return false };
        let line = &mut self.lines[number];
        let down = match input {
            Input::Words(words) => {
                line.on_words(now, words);
                self.wheels.iter_mut().for_each(|wheel| wheel.on_line(now, number, out));
                return true;
            }
            Input::Up => None,
            Input::Down(why) => Some(*why),
            _ => return true,
        };
        line.on_port(down, out);
        self.wheels.controllers_on(number).for_each(|controller| controller.on_bus(now, down.is_none(), out));
        true
    }

    /// A frame was received: of a motor controller, or of CANopen.
    fn on_frame(&mut self, now: Instant, at: Instant, port: PortId, frame: &Frame, out: &mut Actions) {
        let Some(number) = self.net_at(port) else { return };
        if let Some(bus) = &mut self.nets[number].bus {
            bus.count_frame(frame);
        }
        let mut foreign = None;
        for controller in self.wheels.controllers_of_bus(number) {
            foreign = controller.on_foreign(now, frame).or(foreign);
        }
        if let Some(name) = foreign {
            self.on_second_master(now, number, format_args!("a command to the {name} drive"), out);
        }
        let mut wheels = self.wheels.iter_mut().filter(|wheel| wheel.bus == number);
        let net = &mut self.nets[number];
        if !wheels.any(|wheel| wheel.on_frame(now, frame, out)) && net.has_canopen {
            net.master.handle_rx_at(now, at, frame);
        }
    }

    fn on_master(&mut self, now: Instant, out: &mut Actions) {
        for bus in 0..self.nets.len() {
            while let Some(event) = self.nets[bus].master.poll_event() {
                self.on_can_event(now, bus, event, out);
            }
        }
        let working = self.wheels.are_up() && self.drives().all(drive::Drive::is_booted);
        // The module is starting until its first success; pending conditions have been reported.
        if working != self.working.unwrap_or(false) {
            self.working = Some(working);
            if working { out.working() } else { out.failed() }
        }
    }

    fn on_can_event(&mut self, now: Instant, bus: usize, event: CanEvent, out: &mut Actions) {
        let on_bus = |id: u8| NodeAt { bus, id };
        match event {
            CanEvent::Booted { node } => {
                let node = on_bus(node);
                let (subject, name) = self.name_of(node);
                out.clear(Fault::NodeClash, subject, format!("{name} answers once"));
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_booted(now, out);
                }
                if let Some(steering) = self.steering_at(node) {
                    steering.on_booted();
                }
                if self.devices.name(node).is_some() {
                    self.devices.on_booted(now, node, out);
                } else {
                    self.read_measured(now, node);
                }
            }
            CanEvent::BootFailed { node, step, reason } => {
                let node = on_bus(node);
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_boot_failed(step, reason, out);
                }
                self.devices.on_boot_failed(node, step, reason, &mut self.around.pause, out);
            }
            CanEvent::Lost { node, reason } => {
                let node = on_bus(node);
                self.watch_reset(now, node, reason);
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_lost(reason, out);
                }
                if let Some(steering) = self.steering_at(node) {
                    steering.on_lost();
                } else if let Some(wheel) = self.wheels.of_mut(node) {
                    wheel.on_lost();
                }
                self.devices.on_lost(node, reason, &mut self.around.pause, out);
            }
            CanEvent::Emergency { node, emergency, suppressed } => {
                let node = on_bus(node);
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_emergency(now, &emergency, suppressed, out);
                }
                self.devices.on_emergency(now, node, &emergency, suppressed, out);
            }
            CanEvent::Pdo { node, number, data, len } => {
                let node = on_bus(node);
                let data = &data[..usize::from(len).min(data.len())];
                if let Some(wheel) = self.wheels.of_mut(node) {
                    wheel.on_pdo(now, number, data, out);
                } else if let Some(steering) = self.steering_at(node) {
                    steering.on_pdo(now, number, data, out);
                } else {
                    self.devices.on_pdo(now, (node, number), data, &mut self.around.pause, out);
                }
            }
            CanEvent::SdoRead { ticket, ref data, .. } => self.on_sdo(now, (bus, ticket), Ok(data), &event, out),
            CanEvent::SdoWritten { ticket, .. } => self.on_sdo(now, (bus, ticket), Ok(&[]), &event, out),
            CanEvent::SdoFailed { ticket, error, .. } => self.on_sdo(now, (bus, ticket), Err(error), &event, out),
            CanEvent::Malformed { node, count } => {
                let node = self.node_in_words(on_bus(node));
                let message = format!("{count} invalid CANopen frames of {node} dropped");
                out.report(Severity::Warning, Fault::CanMalformed, node, message);
            }
            CanEvent::SecondMaster { by } => {
                self.on_second_master(now, bus, by, out);
                let drives = self.wheels.drives().chain(self.steering.iter().map(|steering| &steering.drive));
                for (readback, _) in self.readbacks.iter_mut().zip(drives).filter(|(_, drive)| drive.bus == bus) {
                    readback.on_foreign(now, by);
                }
            }
            CanEvent::DuplicateId { node } => {
                let node = on_bus(node);
                let (subject, name) = self.name_of(node);
                // Of a device an input of `[stop]` does that.
                let stops = if self.devices.name(node).is_some() { "" } else { "; the robot stops" };
                let bus = self.bus_name(bus);
                let message = format!("{name} resets repeatedly, or two nodes of {bus} have its id{stops}");
                out.raise(Severity::Error, Fault::NodeClash, subject, message);
            }
            CanEvent::Babbling { node, rate } => {
                let node = on_bus(node);
                let (subject, name) = self.name_of(node);
                let message = format!("{name} floods {}: {rate} frames/s", self.bus_name(bus));
                out.raise(Severity::Error, Fault::CanBabble, subject, message);
            }
            CanEvent::BabblingOver { node } => {
                let node = on_bus(node);
                let (subject, name) = self.name_of(node);
                out.clear(Fault::CanBabble, subject, format!("{name} no longer floods {}", self.bus_name(bus)));
            }
            CanEvent::Swapped { node, serial } => {
                let (_, name) = self.name_of(on_bus(node));
                out.note(format!("{name} is another device now, serial number {serial:#x}"));
            }
            CanEvent::Stranger { node } if Some(on_bus(node)) == self.stop_watch.node() => {}
            CanEvent::Stranger { node } => {
                out.note(format!("node {node} on {} is not in the configuration", self.bus_name(bus)));
            }
            // Reported for each drive.
            CanEvent::Ready | CanEvent::NotReady => {}
        }
    }

    /// A transfer has ended: of `LL_CMD_SDO`, of a drive's measured values, or of homing.
    fn on_sdo(
        &mut self,
        now: Instant,
        (bus, ticket): (usize, Ticket),
        result: Result<&[u8], sdo::Error>,
        event: &CanEvent,
        out: &mut Actions,
    ) {
        let on_bus = |id: u8| NodeAt { bus, id };
        // External requests come first: the object may be one that the driver reads, too.
        if self.requests.on_end(now, ticket, result, out)
            || self.stop_watch.on_sdo(now, ticket, result.ok())
            || self.inputs.on_sdo(ticket, result.ok(), &mut self.around.pause)
            || self.devices.on_sdo(now, ticket, result, &mut self.around.pause, out)
            || self.on_read_back(now, ticket, result.ok(), out)
            || self.drives_mut().any(|drive| {
                drive.on_mode(now, ticket, result)
                    || drive.on_brake(now, ticket, result)
                    || drive.on_motor(now, ticket, result, out)
            })
        {
            return;
        }
        match *event {
            CanEvent::SdoRead { node, index, sub: 0, ref data, .. } if MEASURED_OBJECTS.contains(&index) => {
                self.on_measured(now, on_bus(node), index, data, out);
                if let Some(drive) = self.drive_mut(on_bus(node)) {
                    drive.on_answer(now, None, out);
                }
            }
            CanEvent::SdoFailed { node, index, sub: 0, error, .. } if MEASURED_OBJECTS.contains(&index) => {
                if let Some(drive) = self.drive_mut(on_bus(node)) {
                    drive.on_answer(now, Some(error), out);
                }
            }
            _ => self.steering.iter_mut().for_each(|steering| steering.on_sdo(now, event)),
        }
    }

    /// A transfer of the objects that are read back has ended; false if it is another transfer.
    fn on_read_back(&mut self, now: Instant, ticket: Ticket, data: Option<&[u8]>, out: &mut Actions) -> bool {
        let axes = self.wheels.drive_axes().chain(self.steering.iter().map(|_| Axis::Steering));
        let drives = self.wheels.drives().chain(self.steering.iter().map(|steering| &steering.drive));
        for ((readback, axis), drive) in self.readbacks.iter_mut().zip(axes).zip(drives) {
            let name = axis.name();
            let master = &mut self.nets[drive.bus].master;
            let Some(found) = readback.on_sdo(now, ticket, data, master) else { continue };
            match found {
                Some(Found::Changed { index, sub }) => {
                    let what =
                        format!("0x{index:04X}:{sub} of the {name} drive was changed, and its stop depends on that");
                    let message = format!("{what}: the robot stops, it is written again");
                    out.raise(Severity::Error, Fault::DriveParameter, name, message);
                }
                Some(Found::Restored) => {
                    out.clear(Fault::DriveParameter, name, format!("the {name} drive holds its configuration"));
                }
                None => {}
            }
            return true;
        }
        false
    }

    /// Reads the state of a drive: event-driven PDOs report changes only, and the first ones may have been sent before
    /// the node counted as started.
    fn read_measured(&mut self, now: Instant, node: NodeAt) {
        let measured = if self.wheels.place(node).is_some() { VELOCITY } else { POSITION };
        for index in [measured, STATUSWORD] {
            // The queue of a freshly booted node has room for all of them.
            if self.nets[node.bus].master.sdo_read(now, node.id, index, 0).is_ok()
                && let Some(drive) = self.drive_mut(node)
            {
                drive.on_asked();
            }
        }
    }

    fn on_measured(&mut self, now: Instant, node: NodeAt, index: u16, data: &[u8], out: &mut Actions) {
        match (index, data) {
            (VELOCITY, &[a, b, c, d]) => {
                if let Some(wheel) = self.wheels.of_mut(node) {
                    wheel.on_velocity(now, i32::from_le_bytes([a, b, c, d]));
                }
            }
            (POSITION, &[a, b, c, d]) => {
                if let Some(steering) = self.steering_at(node) {
                    steering.on_position(now, i32::from_le_bytes([a, b, c, d]));
                }
            }
            (STATUSWORD, &[low, high]) => {
                if let Some(drive) = self.drive_mut(node) {
                    drive.on_statusword(now, u16::from_le_bytes([low, high]), out);
                }
            }
            _ => {}
        }
    }

    /// Name of a node as the subject of reports, and for people.
    fn name_of(&self, node: NodeAt) -> (String, String) {
        let id = node.id;
        if let Some(name) = self.devices.name(node) {
            return (name.into(), format!("{name} (node {id})"));
        }
        match (self.drives().find(|drive| drive.at() == node), id) {
            (Some(drive), _) => (drive.name.into(), drive.in_words()),
            (None, 0) => (self.bus_name(node.bus).into(), "somebody".into()),
            (None, _) => (self.node_in_words(node), self.node_in_words(node)),
        }
    }

    fn drive_mut(&mut self, node: NodeAt) -> Option<&mut drive::Drive> {
        self.drives_mut().find(|drive| drive.at() == node)
    }

    /// True if the robot is known to stand.
    fn is_standing(&self) -> bool {
        self.wheels.are_slower(self.now, STANDSTILL_MPS)
    }

    /// All objections to any motion, in the order in which an engineer would check them.
    fn objections(&self, now: Instant) -> impl Iterator<Item = Objection> + Clone + '_ {
        let buses = self.nets.iter().enumerate();
        let bus = buses.clone().filter_map(|(n, net)| Some(Objection::Bus(n, net.bus.as_ref()?.objection()?)));
        let second_master = buses.filter(|(_, net)| !net.is_alone()).map(|(n, _)| Objection::SecondMaster(n));
        let pauses = self.around.pauses(now).map(Objection::Around);
        // With a line that is open and latched last, because an operator's act ends it.
        let around = self.around.others(now).map(Objection::Around);
        let wheels = self.wheels.iter().map(|wheel| (wheel.axis, wheel.objection()));
        let steering = self.steering.iter().map(|steering| (Axis::Steering, steering.drive.objection()));
        let drives = wheels.chain(steering).filter_map(|(axis, objection)| Some(Objection::Drive(axis, objection?)));
        let parameters = self.axes().zip(&self.readbacks);
        let parameters = parameters.filter(|(_, readback)| readback.is_changed());
        let parameters = parameters.map(|(axis, _)| Objection::Parameter(axis));
        let state = self.state.hold().map(Objection::State);
        let refused = self.deadlines.is_set(Timer::Refused).then_some(Objection::Refused);
        let not_homed = self.steering.as_ref().and_then(Steering::why_not_homed);
        // The PAUSE line before the drives: it cuts their supply, and their faults follow from that.
        let speed = self.stop_watch.objection();
        let guard = self.protection.objection(now).map(Objection::Guard);
        let speed = speed.or(self.agreement.stops.then_some(Objection::Speed(Hold::WheelsDisagree)));
        let devices = bus.chain(second_master).chain(speed).chain(pauses).chain(drives);
        let devices = devices.chain(self.stop_watch.stood()).chain(parameters);
        // Homing last: if it is the only objection, the steering may be moved to resolve it.
        devices.chain(state).chain(around).chain(guard).chain(refused).chain(not_homed.map(Objection::NotHomed))
    }

    /// All causes for which the robot does not follow its command, main one first; empty while it does.
    fn causes(&self, now: Instant) -> impl Iterator<Item = ActiveHold<'_>> + Clone {
        let mut objections = self.objections(now);
        let main = objections.next();
        let blocked = main.is_some();
        let holder = self.arbiter.current(now).map(|command| command.priority);
        let waits = blocked || holder.is_none();
        let plans =
            holder.map_or_else(|| self.ignored.has_planner(&self.arbiter), |priority| priority == arbiter::PLANNER);
        let to_planner = self.around.objections_to_planner(now).filter(move |_| plans && !blocked);
        let ignored = self.ignored.active_holds(&self.arbiter).filter(move |_| waits);
        let stopping = (self.stopping && !blocked).then_some(ActiveHold::new(Hold::Stopping, ""));
        let nobody = (!blocked && !self.stopping && waits && ignored.clone().next().is_none())
            .then_some(ActiveHold::new(Hold::NobodyCommands, ""));
        let objections = main.into_iter().chain(objections).map(|objection| self.active_hold(objection));
        let bounded = self.bounded(now).map(|(hold, subject)| ActiveHold::new(hold, subject));
        let to_planner = to_planner.map(|(hold, subject)| ActiveHold::new(hold, subject));
        objections.chain(stopping).chain(to_planner).chain(ignored).chain(nobody).chain(bounded)
    }

    /// Derives the goals of the axes from the current state. Called after every event.
    fn decide(&mut self, now: Instant, out: &mut Actions) {
        self.expire(now, out);
        self.around.pause.expire(now);
        self.update_releases(now);
        let blocked = self.objections(now).next();
        if blocked != self.blocked {
            self.report_change(blocked, out);
            self.arbiter.disarm_all(now);
            self.blocked = blocked;
            if blocked.is_none() {
                self.release_planner_after_homing(now);
            }
        }
        let rolls = !self.is_standing();
        let pause = &self.around.pause;
        let holds = pause.is_engaged() || pause.is_latched() && rolls;
        let unfed = pause.cuts_feed() || self.stop_watch.cuts_feed();
        for drive in self.wheels.drives_mut() {
            drive.hold_fault_reset(holds);
            drive.set_unfed(unfed);
        }
        if !rolls {
            self.arbiter.on_standstill(now);
        }
        self.watch_planner(now);
        let permitted = |wanted: Wanted<'_>| {
            let velocity = self.protection.clamped(now, wanted.points.velocity, wanted.mover);
            (velocity, wanted.points.steering, self.is_motion(wanted))
        };
        match self.wanted(now).map(permitted) {
            Some((velocity, steering, moves)) => {
                // After a fault, a drop or a loss every source is disarmed: this motion is a deliberate act.
                if moves {
                    self.wheels.iter_mut().for_each(Propulsion::release);
                    self.steering.iter_mut().for_each(|steering| steering.drive.release());
                }
                match (&mut self.steering, steering) {
                    (Some(own), Some(steering)) => own.go(steering),
                    (Some(own), None) => own.hold(),
                    (None, _) => {}
                }
                self.drive(now, velocity);
            }
            None => {
                self.wheels.quick_stop();
                self.body.stand();
                self.decide_steering();
            }
        }
        let gone = self.wheels.are_slower_or_absent(now, STANDSTILL_MPS);
        let ends = self.state == State::Terminate && gone;
        if ends {
            self.wheels.switch_off();
            self.steering.iter_mut().for_each(Steering::switch_off);
        }
        if ends || self.leaves {
            self.devices.end();
        }
        self.arbiter.expire_holder(now);
        for wheel in self.wheels.iter_mut() {
            let bus = wheel.bus;
            wheel.advance(now, &mut self.nets[bus].master, out);
        }
        // When all have their goals: a device may turn two wheels.
        self.serve_controllers(now, out);
        if let Some(steering) = &mut self.steering {
            let bus = steering.drive.bus;
            steering.advance(now, &mut self.nets[bus].master, out);
        }
        if ends || self.leaves {
            self.leave(now);
        } else {
            // A drive that was lost, and took no part, has come back and turns.
            self.deadlines.clear(Timer::SwitchOff);
        }
        let began = self.stopping || self.blocked.is_some();
        self.stopping = began && rolls && self.wheels.may_be_stopping();
        self.watch_speed(now, out);
        self.watch_agreement(now, out);
        self.watch_strain(now, out);
        self.advance_second_way(now, out);
        let drives = self.wheels.drives().chain(self.steering.iter().map(|steering| &steering.drive));
        for (readback, drive) in self.readbacks.iter_mut().zip(drives) {
            readback.advance(now, drive.is_booted(), &mut self.nets[drive.bus].master);
        }
        for drive in self.wheels.drives_mut().chain(self.steering.iter_mut().map(|steering| &mut steering.drive)) {
            if drive.must_reboot(now, !rolls) {
                self.nets[drive.bus].master.reboot(now, drive.node);
            }
        }
        let ask = |drive: &mut drive::Drive| {
            let master = &self.nets[drive.bus].master;
            drive.must_ask_lost(now, master.nmt_state(drive.node).is_some()).then_some(drive.at())
        };
        let mut nodes: Vec<NodeAt> = self.wheels.drives_mut().filter_map(ask).collect();
        let outdated = self.drives_mut().map(drive::Drive::take_outdated);
        nodes.extend(outdated.filter_map(|(node, in_doubt)| in_doubt.then_some(node)));
        for node in nodes {
            self.read_measured(now, node);
        }
        self.read_inputs(now);
        for (bus, net) in self.nets.iter_mut().enumerate() {
            self.devices.advance(now, (bus, net.is_alone() && net.is_up()), &mut net.master);
        }
        for drive in self.wheels.drives_mut().chain(self.steering.iter_mut().map(|steering| &mut steering.drive)) {
            let net = &mut self.nets[drive.bus];
            drive.watch_motor(now, net.is_alone(), &mut net.master);
        }
    }

    /// Reads the inputs of drives that stop the robot.
    fn read_inputs(&mut self, now: Instant) {
        let drives = self.wheels.drives().chain(self.steering.iter().map(|steering| &steering.drive));
        let is_booted = |node| drives.clone().any(|drive| drive.at() == node && drive.is_booted());
        for (bus, net) in self.nets.iter_mut().enumerate() {
            self.inputs.advance(now, (bus, net.is_alone()), is_booted, &mut net.master);
        }
    }

    fn serve_controllers(&mut self, now: Instant, out: &mut Actions) {
        self.wheels.controllers_mut().for_each(|controller| controller.serve(now, out));
    }

    /// Drives at a velocity, unless a drive does not follow: without steering, or with a wheel that does not turn, the
    /// robot must not drive.
    fn drive(&mut self, now: Instant, velocity: Twist) {
        let enabled = match &self.steering {
            Some(steering) => steering.is_enabled(),
            None => self.wheels.are_enabled(),
        };
        let speeds = self.body.speeds(now, if enabled { velocity } else { Twist::ZERO }, self.angle(), enabled);
        self.wheels.drive(&speeds);
    }

    /// The module ends, and the robot stands: when the drives have no torque they are told to expect no master, and
    /// awaited. Otherwise they would miss its heartbeat and go to fault, or stay under power, and would not answer
    /// the next master.
    fn leave(&mut self, now: Instant) {
        if !self.deadlines.is_set(Timer::SwitchOff) && !self.left {
            self.deadlines.set(Timer::SwitchOff, now + SWITCH_OFF_MAX);
        }
        let late = self.deadlines.is_due(Timer::SwitchOff, now);
        let off = self.wheels.iter().all(Propulsion::is_off) && self.drives().all(drive::Drive::is_off);
        // The reset of a device's communication leaves its outputs as they are.
        let off = off && self.devices.are_settled();
        if !self.leaves && (off || late) {
            self.leaves = true;
            self.nets.iter_mut().for_each(|net| net.master.leave(now));
            self.deadlines.set(Timer::SwitchOff, now + SWITCH_OFF_MAX);
        } else if self.leaves && (late || self.nets.iter_mut().all(|net| net.master.has_left())) {
            self.deadlines.clear(Timer::SwitchOff);
            self.left = true;
        }
    }

    /// Stops the planner if the estimate or a required module is lost; their return alone does not release it.
    fn watch_planner(&mut self, now: Instant) {
        let current = self.arbiter.current(now).filter(|command| command.priority == arbiter::PLANNER);
        let plans = current.is_some();
        let objects = plans && self.around.objections_to_planner(now).next().is_some();
        if let Some(command) = current.filter(|_| objects && self.planned) {
            let until = now + self.config.limits.command_ttl;
            self.ignored.put(until, command.source, Some(Hold::PlannerLatched));
            self.arbiter.disarm_all(now);
        }
        self.planned = plans && !objects;
        // Also if its command had expired before the watchdog listed the module: the one that returns is another one.
        let missing = self.around.is_planning_missing();
        if missing && !self.planning_missing {
            self.arbiter.latch_planner(now);
        }
        self.planning_missing = missing;
    }

    /// Goal of the steering while no source moves the robot: it is homed if that is the only objection, holds its angle
    /// without a command, and stops where it is if something is wrong.
    fn decide_steering(&mut self) {
        let may_home = self.may_home();
        let Some(steering) = &mut self.steering else { return };
        match &self.blocked {
            None => steering.hold(),
            // Last in the list: there is no other objection to motion.
            Some(_) if may_home => steering.home(),
            Some(_) => steering.quick_stop(),
        }
    }

    /// Velocity, and steering angle, rad, that are permitted now. Without a permission the robot is to stand.
    fn permitted(&self, now: Instant) -> (Twist, f64) {
        let velocity = |Wanted { points, mover, .. }: Wanted<'_>| self.protection.clamped(now, points.velocity, mover);
        let wanted = self.wanted(now);
        let steering = wanted.and_then(|wanted| wanted.points.steering);
        (wanted.map_or(Twist::ZERO, velocity), steering.unwrap_or_else(|| self.angle()))
    }

    /// True if a command is motion. A planner that was let go may turn the wheels before it drives; of a manual source
    /// a steering angle at zero speed is only the position of its controls.
    fn is_motion(&self, Wanted { points, mover, .. }: Wanted<'_>) -> bool {
        let turns = |steering: f64| (steering - self.angle()).abs() > TURN_RAD;
        points.velocity != Twist::ZERO || !mover.manual && points.steering.is_some_and(turns)
    }

    /// Why the robot does not do all that it is commanded to do; it moves, or would.
    fn bounded(&self, now: Instant) -> impl Iterator<Item = (Hold, &str)> + Clone {
        let wanted = self.wanted(now);
        let bound = wanted.and_then(|Wanted { points, mover, .. }| self.protection.notice(now, points.velocity, mover));
        let capped = wanted.filter(|wanted| wanted.capped).map(|_| (Hold::StopDistance, ""));
        let left_out = wanted.into_iter().flat_map(|Wanted { points, mover, .. }| {
            points.left_out.into_iter().flatten().map(move |hold| (hold, mover.name))
        });
        bound.into_iter().chain(capped).chain(left_out)
    }

    /// What the source that holds the motion wants, within the robot's limits.
    fn wanted(&self, now: Instant) -> Option<Wanted<'_>> {
        if self.blocked.is_some() || self.stopping {
            return None;
        }
        let command = self.arbiter.current(now)?;
        let limits = &self.config.limits;
        let planner = command.priority == arbiter::PLANNER;
        if planner && self.around.objections_to_planner(now).next().is_some() {
            return None;
        }
        let by_source = if planner { limits.speed_autonomous_mps } else { limits.speed_manual_mps };
        let points = match command.course {
            Course::Steering(steering) => self.body.by_steering(command.speed, steering),
            Course::Velocity { vy, omega } => self.body.set_points(Twist::new(command.speed, vy, omega)),
        };
        let within = |speed| self.body.capped(points, Caps { speed, lateral: limits.lateral_acceleration_mps2 });
        let cap = self.cap_mps();
        let bounded = within(by_source.min(cap));
        let capped = cap < by_source && within(by_source).velocity != bounded.velocity;
        let mover = Mover { name: self.arbiter.name(command.source), manual: !planner };
        Some(Wanted { points: bounded, mover, capped })
    }

    /// Greatest speed, m/s, by the distance in which the robot must stand after PAUSE, and without commands.
    fn cap_mps(&self) -> f64 {
        let rolls = self.wheels.controllers().next().is_some();
        self.config.stop.speed_max_mps(self.config.limits.quick_stop_mps2, rolls)
    }

    /// Reports at the start that the stopping distance after PAUSE caps the speed.
    fn report_cap(&self, out: &mut Actions) {
        let (limits, stop, cap) = (&self.config.limits, &self.config.stop, self.cap_mps());
        if cap < limits.speed_manual_mps.max(limits.speed_autonomous_mps) {
            let distance = stop.distance_m;
            out.note(format!("the speed is capped at {cap:.2} m/s, so that PAUSE stops the robot within {distance} m"));
        }
    }

    /// Reports at the start what a drive lacks to stop by itself.
    fn report_reservations(&self, out: &mut Actions) {
        for drive in self.drives() {
            for lack in &drive.reservations {
                let name = drive.name;
                out.say(Level::Warning, format!("the {name} drive relies on the second way to stop: {lack}"));
            }
        }
    }

    fn expire(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.take(Timer::Refused, now) {
            out.clear(Fault::MotionRefused, "", "commands are within limits again");
        }
        for bus in self.nets.iter_mut().filter_map(|net| net.bus.as_mut()) {
            bus.expire_second_master(now, out);
        }
        if self.deadlines.take(Timer::Contested, now) {
            out.clear(Fault::MotionContested, "", "one source commands the motion");
        }
        self.ignored.expire(now);
    }

    fn report_change(&self, blocked: Option<Objection>, out: &mut Actions) {
        let was = self.blocked.and_then(Objection::fault);
        let is = blocked.and_then(Objection::fault);
        if let Some(was) = was.filter(|was| is != Some(*was)) {
            out.clear(was, "", "the cause of the stop has ended; the robot moves on a new command");
        }
        if let (Some(is), Some(blocked)) = (is, blocked) {
            out.raise(Severity::Error, is, "", format!("the robot is stopped: {}", self.words(blocked)));
        }
    }

    /// Reason why the robot does not move, in words; empty while it follows its command.
    fn reason(&self, now: Instant) -> String {
        if let Some(objection) = self.objections(now).next() {
            return self.words(objection);
        }
        let stops = self.causes(now).find(|cause| !cause.hold.is_notice());
        stops.map_or_else(String::new, |cause| cause.hold.words(cause.subject))
    }

    fn publish_holds(&mut self, now: Instant, out: &mut Actions) {
        let mut holds = std::mem::take(&mut self.holds);
        holds.publish(now, NAME, self.causes(now), out);
        self.holds = holds;
    }

    fn publish_motion(&self, now: Instant, out: &mut Actions) {
        let (velocity_target, steering_target) = self.permitted(now);
        let source = self.arbiter.current(now).map_or("", |command| self.arbiter.name(command.source)).to_owned();
        let (timestamp, quick_stop) = (out.timestamp(now), self.wheels.are_quick_stopped());
        let enabled = self.wheels.are_enabled() && self.steering.as_ref().is_none_or(Steering::is_enabled);
        let Measured { twist, residual } = self.measured();
        let (steering, steering_target) = match &self.steering {
            Some(steering) => (steering.angle(), steering_target),
            // That of the base with the same curve.
            None => {
                let target = self.body.equivalent_steering(velocity_target, 0.0);
                (self.body.equivalent_steering(twist, target), target)
            }
        };
        out.publish(lowlevel::DataMotion {
            timestamp,
            speed: self.speed(),
            steering,
            speed_target: velocity_target.vx,
            steering_target,
            enabled,
            homed: self.steering.as_ref().is_none_or(Steering::is_homed),
            quick_stop,
            source: source.clone(),
            reason: self.reason(now),
        });
        let target = self.body.set_velocity(velocity_target, steering_target);
        out.publish(lowlevel::DataVelocity {
            timestamp,
            vx: twist.vx,
            vy: twist.vy,
            omega: twist.omega,
            vx_target: target.vx,
            vy_target: target.vy,
            omega_target: target.omega,
            residual,
            enabled,
            ready: self.blocked.is_none() && !self.stopping,
            quick_stop,
            source,
        });
    }

    fn publish_axes(&self, now: Instant, out: &mut Actions) {
        let wheels = self.wheels.iter().map(|wheel| wheel.row(&self.nets[wheel.bus].master));
        let steers = self.steering.iter().map(|steering| steering.row(&self.nets[steering.drive.bus].master));
        let axes = wheels.chain(steers).collect();
        let timestamp = out.timestamp(now);
        out.publish(lowlevel::DataAxes { timestamp, axes });
        let wheels = self.wheels.iter().map(|wheel| wheel.wheel_row(self.config.wheel_circumference));
        let wheels = wheels.chain(self.steering.iter().map(Steering::wheel_row)).collect();
        out.publish(lowlevel::DataWheels { timestamp, wheels });
    }

    fn publish_bus(&mut self, now: Instant, number: usize, out: &mut Actions) {
        let drives = self.wheels.drives().chain(self.steering.iter().map(|steering| &steering.drive));
        let net = &mut self.nets[number];
        let Some(mut message) = net.bus.as_mut().map(|bus| bus.message(out.timestamp(now))) else { return };
        let nodes = drives.map(|drive| (drive.name, drive.at())).chain(self.devices.nodes());
        let nodes = nodes.filter(|(_, node)| node.bus == number);
        message.nodes = nodes.map(|(name, node)| bus::node(name, node.id, &mut net.master)).collect();
        message.nodes.extend(self.wheels.controllers_of_bus(number).map(|controller| controller.bus_row()));
        out.publish(message);
    }

    /// Sends what waits on each CAN bus.
    fn send_frames(&mut self, now: Instant, out: &mut Actions) {
        for (number, net) in self.nets.iter_mut().enumerate() {
            let bus_is_up = net.is_up();
            let wheels = self.wheels.iter_mut().filter(|wheel| wheel.bus == number);
            let wheels = wheels.filter_map(|wheel| wheel.blind_stop(now, bus_is_up));
            let steering = self.steering.iter_mut().filter(|steering| steering.drive.bus == number);
            let steering = steering.filter_map(|steering| steering.blind_stop(now, bus_is_up));
            let mut frames: Vec<Frame> = wheels.chain(steering).collect();
            let mut questions = Vec::new();
            for controller in self.wheels.controllers_of_bus(number) {
                while let Some(frame) = controller.poll_frame(now) {
                    if controller.is_commanded_by(&frame) { frames.push(frame) } else { questions.push(frame) }
                }
            }
            // The answers to one wheel's questions may precede the commands to the next on the wire.
            frames.append(&mut questions);
            let Net { bus, port, master, has_canopen } = net;
            let canopen = std::iter::from_fn(|| master.poll_tx().filter(|_| *has_canopen));
            for frame in frames.into_iter().chain(canopen) {
                if let Some(bus) = bus {
                    bus.count_frame(&frame);
                    out.send_can(*port, frame);
                }
            }
        }
    }

    fn publish_lines(&mut self, now: Instant, out: &mut Actions) {
        for (number, line) in self.lines.iter_mut().enumerate() {
            let nodes = self.wheels.controllers_on(number).map(|controller| controller.bus_row()).collect();
            out.publish(line.message(out.timestamp(now), nodes));
        }
    }
}

impl Module for Canbus {
    fn subscriptions(&self) -> &[Channel] {
        &[
            Channel::LlCmdMotion,
            Channel::LlCmdVelocity,
            Channel::LlCmdHoming,
            Channel::LlCmdSdo,
            Channel::LlEventStop,
            Channel::LlDataGuard,
            Channel::LlCmdCreep,
            Channel::LlDataRanges,
            Channel::CmDataProcesses,
            Channel::CmCmdState,
            Channel::MlDataEstimate,
            Channel::MlCmdGoal,
            Channel::MlCmdMode,
            Channel::LlDataPower,
            Channel::LlCmdPower,
            Channel::LlCmdNodeIo,
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
                for bus in self.nets.iter_mut().filter_map(|net| net.bus.as_mut()) {
                    bus.start(now);
                }
                if !self.lines.is_empty() {
                    self.deadlines.set(Timer::Lines, now);
                }
                // TIME is the time of this process's messages: a step of the wall clock changes neither.
                self.nets.iter_mut().for_each(|net| net.master.set_time(now, out.timestamp(now)));
                self.start_second_way(now, out);
                self.report_cap(out);
                self.report_reservations(out);
                self.report_blind_to_strain(out);
                if !self.config.has_pause_line && self.config.stop.inputs.is_empty() {
                    out.say(Level::Warning, NO_EMERGENCY_STOP);
                }
                if let Some(warning) = self.protection.warning() {
                    out.say(Level::Warning, warning);
                }
            }
            Event::Message { at, from, message } => self.on_message(now, at, from, message, out),
            Event::Port { port, input } if self.stop_watch.on_port(now, port, &input) => {}
            Event::Port { port, input } if self.on_line(now, port, &input, out) => {}
            Event::Port { port, input: Input::Can { frame, at } } => {
                self.on_frame(now, at, port, &frame, out);
            }
            Event::Port { port, input: Input::CanNotice(notice) } => {
                let net = self.net_at(port).and_then(|bus| self.nets.get_mut(bus));
                if let Some(bus) = net.and_then(|net| net.bus.as_mut()) {
                    bus.on_notice(now, notice, out);
                }
            }
            Event::Port { port, input: Input::Up } => self.on_port(now, port, None, out),
            Event::Port { port, input: Input::Down(why) } => self.on_port(now, port, Some(why), out),
            Event::State(state) => self.state = state,
            Event::Timer => {
                self.nets.iter_mut().filter(|net| net.is_served()).for_each(|net| net.master.handle_timeout(now));
            }
            Event::Port { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        self.serve_controllers(now, out);
        self.on_master(now, out);
        self.decide(now, out);
        self.on_master(now, out);
        self.send_frames(now, out);
        self.lines.iter_mut().for_each(|line| line.send(now, out));
        for bus in 0..self.nets.len() {
            if self.nets[bus].bus.as_mut().is_some_and(|own| own.handle_timeout(now, out)) {
                self.publish_bus(now, bus, out);
            }
        }
        if self.deadlines.tick(Timer::Lines, now, LINES_PERIOD) {
            self.publish_lines(now, out);
        }
        self.devices.publish(now, out);
        self.publish_holds(now, out);
        if self.deadlines.tick(Timer::Motion, now, MOTION_PERIOD) {
            self.publish_motion(now, out);
        }
        let due = self.deadlines.tick(Timer::Axes, now, AXES_PERIOD);
        let wheels = self.wheels.iter_mut().fold(false, |changed, wheel| changed | wheel.take_changed());
        let changed = self.steering.iter_mut().fold(wheels, |changed, own| changed | own.drive.take_changed());
        if due | changed {
            self.publish_axes(now, out);
        }
    }

    fn handle_host_fault(&mut self, now: Instant, fault: Fault, active: bool, out: &mut Actions) {
        if fault == Fault::SecondRobot {
            self.around.on_second_robot(active);
            self.handle(now, Event::Timer, out);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        earliest([
            self.deadlines.next(),
            Some(self.holds.next()),
            self.ignored.poll_timeout(),
            self.nets.iter().filter(|net| net.is_served()).filter_map(|net| net.master.poll_timeout()).min(),
            self.nets.iter().filter_map(|net| net.bus.as_ref()?.poll_timeout()).min(),
            self.readbacks.iter().filter_map(Readback::poll_timeout).min(),
            self.stop_watch.poll_timeout(),
            self.inputs.poll_timeout(|node| self.drives().any(|drive| drive.at() == node && drive.is_booted())),
            self.devices.poll_timeout(|bus| self.nets.get(bus).is_some_and(|net| net.is_alone() && net.is_up())),
            self.wheels.iter().filter_map(Propulsion::poll_timeout).min(),
            self.steering.as_ref().and_then(Steering::poll_timeout),
            self.body.poll_timeout(),
            self.arbiter.poll_timeout(self.now),
            self.around.poll_timeout(self.now),
            self.protection.poll_timeout(self.now),
        ])
    }

    /// The drives keep the robot's last speed until their ramp is done: the process and its heartbeat stay until then,
    /// and until they are switched off.
    fn finished(&self) -> bool {
        let is_reached = self.nets.iter().any(Net::is_up) || self.lines.iter().any(LinePort::is_up);
        !is_reached || self.left
    }
}
