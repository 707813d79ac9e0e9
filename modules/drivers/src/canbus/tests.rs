//! The module with fake drives in virtual time: every rule about permission to move, and every cause of a stop.

mod bus;
mod buses;
mod cia402;
mod controller;
mod devices;
mod fake;
mod faults;
mod guard;
mod holds;
mod homing;
mod hostile;
mod layout;
mod lines;
mod motor;
mod pause;
mod ranging;
mod stopping;
mod table;
mod velocity;
mod wheels;

use super::{
    Axis, Canbus, Config, GpioConfig, HomingRelease, NAME, OutputConfig, PauseStop, PropulsionConfig, PropulsionDrive,
    SecondWay, SteeringConfig, SteeringDrive, Stop, StopInput, UnbrakedStop,
};
use base::gpio::{LineId, Signal};
use base::{Duration, Fault, Instant, Report, Severity, can};
use canopen::axis::PowerState;
use canopen::drives::{epos, icla};
use canopen::{Node, NodeEvent};
use fake::Fake;
use messages::{Hold, Message, common, lowlevel};
use module::admission::{Origin, Process};
use module::bench::Bench;
use module::{Action, Event, Input, Output, PortId, Shell, ShellConfig, State};
use settings::Section as _;
use settings::robot::Limits;

const MS: Duration = Duration::from_millis(1);
/// Port of the GPIO line that feeds the motors.
const LINE: PortId = PortId(1);

pub(super) fn config() -> Config {
    Config {
        bus: Some("can.main".into()),
        further: Vec::new(),
        lines: Vec::new(),
        bitrate: 1_000_000,
        node_id: 127,
        sync: None,
        time: None,
        wheelbase: 0.6,
        wheel_circumference: 0.8,
        traction: settings::robot::Traction::Fixed { left: 0.0 },
        base: None,
        limits: Limits {
            speed_mps: 1.2,
            steering_rad: 0.61,
            speed_manual_mps: 0.6,
            speed_autonomous_mps: 0.8,
            lateral_acceleration_mps2: 0.8,
            acceleration_mps2: 0.5,
            deceleration_mps2: 0.8,
            quick_stop_mps2: 1.5,
            steering_rate_radps: 0.7,
            rotation_radps: 1.0,
            command_ttl: Duration::from_millis(250),
        },
        critical: vec!["driver_rs485a".into()],
        planning: vec!["planner".into()],
        has_pause_line: false,
        fields: Vec::new(),
        ranging: Vec::new(),
        ranging_age_max: Duration::ZERO,
        odometry: true,
        guarded: false,
        homing_release: HomingRelease::Start,
        stop: Stop { pause: PauseStop::Brake, ..Stop::usual() },
        // As fast as its limits, whatever is sensed.
        protection: super::protection::Config { speed_blind: f64::INFINITY, ..Default::default() },
        wheels: vec![PropulsionConfig {
            axis: Axis::Propulsion,
            node: 1,
            drive: epos_with(2483.0),
            writable: vec![0x6065],
        }],
        steering: Some(SteeringConfig {
            node: 2,
            drive: icla_with(false),
            switch: -0.628,
            homing_method: 27,
            homing_speed: 0.17,
            homing_timeout: Duration::from_secs(15),
            speed: 0.7,
            writable: Vec::new(),
        }),
        devices: Vec::new(),
    }
}

/// An EPOS with this velocity of its motor at 1 m/s, rpm.
fn epos_with(units_per_mps: f64) -> PropulsionDrive {
    PropulsionDrive::Table { table: super::table::built_in("epos").expect("a built-in table"), units_per_mps }
}

/// An IclA.
fn icla_with(remap: bool) -> SteeringDrive {
    let table = super::table::built_in("icla").expect("a built-in table");
    SteeringDrive::Table { table, counts_per_turn: 4096.0, gear: 180.0, remap }
}

/// The steering drive of a configuration that has one.
fn steering_of(config: &mut Config) -> &mut SteeringConfig {
    config.steering.as_mut().expect("a base that steers")
}

/// The module, both drives, a wire without delay, and a watchdog that reports all modules running.
struct Robot {
    bench: Bench,
    epos: Fake,
    icla: Fake,
    /// Drives of further wheels.
    more: Vec<Fake>,
    /// Node whose output feeds the motors, or level of the GPIO line that does, and the values written to it.
    output: Option<Node>,
    /// Identifiers and first bytes of requests to that node that are lost, each once.
    lost: Vec<(can::Id, [u8; 4])>,
    line: Option<bool>,
    /// The line keeps its level.
    stuck: bool,
    /// What a port that hangs was asked for, and does when it works again.
    held: Option<Vec<Signal>>,
    written: Vec<(Instant, i64)>,
    watchdog: bool,
    missing: &'static str,
    /// Number of times for which the watchdog has restarted the module.
    restarts: i32,
    frames: Vec<(Instant, can::Frame)>,
    motion: Option<lowlevel::DataMotion>,
    velocity: Option<lowlevel::DataVelocity>,
    holds: lowlevel::DataHold,
    axes: lowlevel::DataAxes,
    wheels: lowlevel::DataWheels,
    bus: Option<lowlevel::DataBus>,
    nodes: Option<lowlevel::DataNodeIo>,
    answers: Vec<lowlevel::DataSdo>,
    /// Orders to the power controller.
    power: Vec<(Instant, lowlevel::CmdPower)>,
    /// The module has ended.
    ended: bool,
    errors: Vec<(Fault, Severity)>,
    notes: Vec<String>,
}

impl Robot {
    fn new() -> Self {
        Self::with(epos::dictionary(1), config())
    }

    fn with(epos: canopen::Dictionary, config: Config) -> Self {
        let canbus = Canbus::new(config).expect("a good configuration");
        let mut robot = Self {
            bench: Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(canbus))),
            epos: Fake::new(epos, 6),
            icla: Fake::new(icla::dictionary(2), 6),
            more: Vec::new(),
            output: None,
            lost: Vec::new(),
            line: None,
            stuck: false,
            held: None,
            written: Vec::new(),
            watchdog: true,
            missing: "",
            restarts: 0,
            frames: Vec::new(),
            motion: None,
            velocity: None,
            holds: lowlevel::DataHold::default(),
            axes: lowlevel::DataAxes::default(),
            wheels: lowlevel::DataWheels::default(),
            bus: None,
            nodes: None,
            answers: Vec::new(),
            power: Vec::new(),
            ended: false,
            errors: Vec::new(),
            notes: Vec::new(),
        };
        robot.bench.start();
        robot
    }

    /// An operator homes the steering.
    fn home(&mut self) {
        self.bench.message(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
        self.exchange();
    }

    /// A manual source is pressed after it was released.
    fn press(&mut self, speed: f64) {
        self.command(0.0, 0.0);
        self.command(speed, 0.0);
    }

    /// Booted and homed, without a command.
    fn ready() -> Self {
        let mut robot = Self::new();
        robot.pass(3000);
        assert_eq!(robot.bench.shell.state(), State::Run);
        assert!(robot.motion().homed, "{}", robot.reason());
        robot.frames.clear();
        robot
    }

    fn pass(&mut self, ms: u32) {
        for _ in 0..ms {
            let now = self.bench.now() + MS;
            self.bench.pass(MS);
            if self.watchdog && now.as_nanos().is_multiple_of(100_000_000) {
                let process = |module: &str| common::Process {
                    module: module.into(),
                    phase: common::Process::RUNNING,
                    state: common::DataState::RUN,
                    restarts: self.restarts,
                    ..common::Process::default()
                };
                let modules = [NAME, "driver_rs485a", "planner"].into_iter().filter(|module| *module != self.missing);
                self.bench.message(common::DataProcesses { timestamp: 0, processes: modules.map(process).collect() });
            }
            self.epos.handle_timeout(now);
            self.icla.handle_timeout(now);
            self.more.iter_mut().for_each(|drive| drive.handle_timeout(now));
            if let Some(output) = &mut self.output {
                output.handle_timeout(now);
            }
            self.exchange();
        }
    }

    fn exchange(&mut self) {
        loop {
            let now = self.bench.now();
            let mut quiet = true;
            for (_, action) in self.bench.done() {
                match action {
                    Action::Send(_, Output::Can(frame)) => {
                        quiet = false;
                        self.frames.push((now, frame));
                        self.epos.handle_rx(now, &frame);
                        self.icla.handle_rx(now, &frame);
                        self.more.iter_mut().for_each(|drive| drive.handle_rx(now, &frame));
                        let lost = self
                            .lost
                            .iter()
                            .position(|(id, first)| frame.id() == *id && frame.data().starts_with(first));
                        if let Some(lost) = lost {
                            self.lost.remove(lost);
                        } else if let Some(output) = &mut self.output {
                            output.handle_rx(now, &frame);
                        }
                    }
                    Action::Send(LINE, Output::Gpio(signal)) => {
                        quiet = false;
                        self.line_asked(now, signal);
                    }
                    Action::Publish(Message::LlDataHold(holds)) => self.holds = holds,
                    Action::Publish(Message::LlDataMotion(motion)) => {
                        let stops = |hold: &lowlevel::Hold| hold.cause().is_none_or(|cause| !cause.is_notice());
                        assert_eq!(motion.reason.is_empty(), !self.holds.holds.iter().any(stops), "{:?}", self.holds);
                        self.motion = Some(motion);
                    }
                    Action::Publish(Message::LlDataVelocity(velocity)) => self.velocity = Some(velocity),
                    Action::Publish(Message::LlDataAxes(axes)) => self.axes = axes,
                    Action::Publish(Message::LlDataWheels(wheels)) => self.wheels = wheels,
                    Action::Publish(Message::LlDataBus(bus)) => self.bus = Some(bus),
                    Action::Publish(Message::LlDataNodeIo(nodes)) => self.nodes = Some(nodes),
                    Action::Publish(Message::LlDataSdo(answer)) => self.answers.push(answer),
                    Action::Publish(Message::LlCmdPower(order)) => self.power.push((now, order)),
                    Action::Exit(_) => self.ended = true,
                    Action::Note(_, text) => self.notes.push(text),
                    Action::Report(report) => self.errors.push((report.fault, report.severity)),
                    _ => {}
                }
            }
            for drive in [&mut self.epos, &mut self.icla].into_iter().chain(&mut self.more) {
                while let Some(frame) = drive.poll_tx() {
                    quiet = false;
                    self.bench.can(PortId(0), frame);
                }
            }
            if let Some(output) = &mut self.output {
                while let Some(event) = output.poll_event() {
                    if let NodeEvent::ObjectWritten { index: 0x6200, sub: 1 } = event {
                        self.written.push((now, output.get(0x6200, 1).unwrap_or(-1)));
                    }
                }
                while let Some(frame) = output.poll_tx() {
                    quiet = false;
                    self.bench.can(PortId(0), frame);
                }
            }
            if quiet {
                return;
            }
        }
    }

    fn line_asked(&mut self, now: Instant, signal: Signal) {
        if let Some(held) = &mut self.held {
            held.push(signal);
            return;
        }
        let Some(level) = &mut self.line else { return };
        if let Signal::Level(active) = signal {
            self.written.push((now, i64::from(active)));
            *level = if self.stuck { *level } else { active };
        }
        let input = Input::Gpio(Signal::Level(*level));
        self.bench.event(Event::Port { port: LINE, input });
    }

    fn command(&mut self, speed: f64, steering: f64) {
        self.bench.message(lowlevel::CmdMotion {
            timestamp: 0,
            speed,
            steering,
            priority: lowlevel::CmdMotion::REMOTE,
            source: "test".into(),
        });
        self.exchange();
    }

    /// Commands at 20 Hz.
    fn drive(&mut self, speed: f64, ms: u32) {
        for _ in 0..ms / 50 {
            self.command(speed, 0.0);
            self.pass(50);
        }
    }

    fn motion(&self) -> &lowlevel::DataMotion {
        self.motion.as_ref().expect("20 Hz")
    }

    fn velocity(&self) -> &lowlevel::DataVelocity {
        self.velocity.as_ref().expect("20 Hz")
    }

    fn reason(&self) -> String {
        self.motion().reason.clone()
    }

    /// Cause and subject of all holds.
    fn holds(&self) -> Vec<(Hold, &str)> {
        let cause = |hold: &lowlevel::Hold| hold.cause().expect("a number of this version");
        self.holds.holds.iter().map(|hold| (cause(hold), hold.subject.as_str())).collect()
    }

    /// Main hold.
    fn hold(&self) -> Option<Hold> {
        self.holds.first()
    }

    /// Last RPDO4 and its time.
    fn last_rpdo4(&self) -> (Instant, [u8; 6]) {
        let (at, frame) = self.frames.iter().rev().find(|(_, frame)| frame.id() == can::Id::Standard(0x501)).unwrap();
        (*at, frame.data().try_into().unwrap())
    }

    fn moves(&self) -> bool {
        self.epos.power.state() == PowerState::OperationEnabled && self.epos.node.get(0x606C, 0) != Some(0)
    }
}

#[test]
fn both_drives_are_booted_and_the_steering_is_homed_before_anything_moves() {
    let mut robot = Robot::new();
    robot.drive(0.4, 600);
    let enabled = |frame: &can::Frame| frame.id() == can::Id::Standard(0x501) && frame.data()[0] == 0x0F;
    assert!(!robot.frames.iter().any(|(_, frame)| enabled(frame)), "enabled before it was homed");
    robot.pass(3000);
    assert_eq!(robot.bench.shell.state(), State::Run);
    assert!(robot.motion().homed);
    // Homed to the switch at -0.628 rad, then straight ahead.
    assert_eq!(
        robot.icla.node.get(0x607C, 0),
        Some((-0.628_f64 * 4096.0 * 180.0 / core::f64::consts::TAU).round() as i64)
    );
    assert_eq!(robot.icla.node.get(0x6064, 0), Some(0));
}

#[test]
fn a_command_is_on_the_bus_in_the_same_turn() {
    let mut robot = Robot::ready();
    robot.drive(0.2, 300);
    let now = robot.bench.now();
    robot.command(0.4, 0.0);
    // 0.4 m/s are 993 rpm: enable operation and 0x000003E1, little endian (facts 2.2).
    assert_eq!(robot.last_rpdo4(), (now, [0x0F, 0x00, 0xE1, 0x03, 0x00, 0x00]));
    robot.command(-0.4, 0.0);
    assert_eq!(robot.last_rpdo4().1, [0x0F, 0x00, 0x1F, 0xFC, 0xFF, 0xFF]);
}

#[test]
fn silence_is_a_quick_stop_after_the_time_to_live() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    assert!(robot.moves());
    robot.command(0.4, 0.0);
    let last = robot.bench.now();
    robot.pass(249);
    assert!(robot.moves());
    robot.pass(10);
    let stop = robot.frames.iter().find(|(at, frame)| *at > last && frame.data().starts_with(&[0x0B, 0x00]));
    assert_eq!(stop.unwrap().0, last + Duration::from_millis(250));
    assert!(!robot.moves());
    robot.pass(100);
    assert!(robot.motion().quick_stop);
    assert_eq!(robot.holds(), [(Hold::NobodyCommands, "")]);
}

#[test]
fn a_source_that_stalled_does_not_resume() {
    let mut robot = Robot::ready();
    robot.drive(0.3, 500);
    assert!(robot.moves());
    // Nothing for 300 ms, then the stick is still held.
    robot.pass(300);
    assert!(!robot.moves());
    robot.frames.clear();
    robot.drive(0.3, 2000);
    assert!(!robot.moves(), "it resumed by itself");
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")]);
    robot.pass(10_000);
    robot.drive(0.3, 1000);
    assert!(!robot.moves(), "silence is no release");
    robot.drive(0.0, 50);
    robot.drive(0.3, 300);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_command_out_of_limits_or_not_a_number_stops_any_source() {
    for (speed, steering) in [(f64::NAN, 0.0), (0.0, f64::INFINITY), (1.3, 0.0), (0.4, -0.7)] {
        let mut robot = Robot::ready();
        robot.drive(0.4, 500);
        assert!(robot.moves());
        robot.command(speed, steering);
        assert!(!robot.moves(), "{speed} {steering}");
        assert!(robot.errors.contains(&(Fault::MotionRefused, Severity::Error)));
        // The correct source keeps commanding and must send zero first.
        robot.drive(0.4, 600);
        assert!(!robot.moves());
        robot.drive(0.0, 100);
        robot.drive(0.4, 200);
        assert!(robot.moves(), "{}", robot.reason());
    }
}

#[test]
fn a_command_that_waited_too_long_is_not_obeyed() {
    let mut robot = Robot::ready();
    let message = Message::from(lowlevel::CmdMotion {
        timestamp: 0,
        speed: 0.4,
        steering: 0.0,
        priority: 1,
        source: "frozen".into(),
    });
    let at = robot.bench.now() - Duration::from_millis(250);
    robot.bench.event(Event::Message { at, from: Origin::DUE, message: &message });
    robot.pass(100);
    assert!(!robot.moves());
}

#[test]
fn a_critical_module_that_dies_stops_the_robot_and_nothing_resumes_by_itself() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.missing = "driver_rs485a";
    robot.drive(0.4, 200);
    assert!(!robot.moves());
    assert!(robot.holds().contains(&(Hold::CriticalModule, "driver_rs485a")), "{}", robot.reason());
    robot.missing = "";
    robot.drive(0.4, 500);
    assert!(!robot.moves());
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")]);
    let critical: Vec<_> = robot.errors.iter().filter(|(fault, _)| *fault == Fault::CriticalModule).collect();
    assert_eq!(critical, [&(Fault::CriticalModule, Severity::Error), &(Fault::CriticalModule, Severity::Notice)]);
    robot.pass(300);
    robot.drive(0.4, 200);
    assert!(!robot.moves(), "silence is no release");
    robot.drive(0.0, 50);
    robot.drive(0.4, 200);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn another_robot_on_the_message_bus_stops_this_one_and_nothing_resumes_by_itself() {
    let mut robot = Robot::ready();
    robot.drive(0.5, 1000);
    assert!(robot.moves());
    robot.bench.raise(Report::new(Severity::Error, Fault::SecondRobot, "", "the list of a foreign watchdog"));
    robot.drive(0.5, 200);
    assert!(!robot.moves());
    assert_eq!(robot.hold(), Some(Hold::SecondRobot));
    robot.bench.clear(Report::new(Severity::Notice, Fault::SecondRobot, "", "one robot is on this bus"));
    robot.drive(0.5, 500);
    assert!(!robot.moves(), "not released");
    robot.drive(0.0, 100);
    robot.drive(0.5, 500);
    assert!(robot.moves());
}

#[test]
fn a_silent_watchdog_stops_the_robot() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.watchdog = false;
    robot.drive(0.4, 400);
    assert!(!robot.moves());
    assert_eq!(robot.hold(), Some(Hold::WatchdogSilent));
}

#[test]
fn a_lost_drive_stops_the_other_one_and_is_booted_again() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.icla.alive = false;
    robot.drive(0.4, 250);
    assert!(!robot.moves(), "the propulsion continues without steering");
    assert_eq!(robot.bench.shell.state(), State::Error);
    assert!(robot.errors.contains(&(Fault::DriveLost, Severity::Error)));
    robot.icla.alive = true;
    robot.drive(0.4, 5000);
    assert_eq!(robot.bench.shell.state(), State::Run);
    assert!(robot.errors.contains(&(Fault::DriveLost, Severity::Notice)));
    assert!(robot.motion().homed && !robot.moves(), "it kept its reference, and waits for a new command");
    robot.drive(0.0, 100);
    robot.drive(0.4, 200);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_in_fault_stops_the_robot_and_is_reset_with_pauses() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    let now = robot.bench.now();
    robot.epos.fault(now, 0x2310);
    robot.drive(0.4, 200);
    assert_eq!(robot.holds()[0], (Hold::DriveFault, "propulsion"));
    assert_eq!(robot.reason(), "the propulsion drive is in fault, error code 0x2310");
    assert!(robot.errors.contains(&(Fault::DriveEmergency, Severity::Error)));
    robot.drive(0.4, 2000);
    assert!(robot.errors.contains(&(Fault::DriveFault, Severity::Notice)), "{:?}", robot.errors);
    assert!(!robot.moves());
    robot.drive(0.0, 100);
    robot.drive(0.4, 300);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_that_is_not_the_configured_one_never_moves() {
    // Node 1 answers like the steering drive.
    let mut robot = Robot::with(icla::dictionary(1), config());
    robot.drive(0.4, 5000);
    assert_eq!(robot.bench.shell.state(), State::Init);
    let mismatches = robot.errors.iter().filter(|(fault, _)| *fault == Fault::DriveMismatch).count();
    assert_eq!(mismatches, 1, "reported once: {:?}", robot.errors);
    let told = robot.frames.iter().filter(|(_, frame)| frame.id() == can::Id::Standard(0x501));
    assert!(
        told.clone().count() > 50 && told.clone().all(|(_, frame)| frame.data() == [0x0B, 0, 0, 0, 0, 0]),
        "quick stops"
    );
    assert_eq!(robot.holds()[0], (Hold::DriveBootFailed, "propulsion"));
}

#[test]
fn another_master_on_the_bus_stops_the_robot() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    // Its heartbeat would keep the drives running after ours is gone.
    robot.bench.can(PortId(0), can::Frame::standard(0x77F, &[0x05]));
    robot.drive(0.4, 200);
    assert!(!robot.moves());
    assert_eq!(robot.holds()[0], (Hold::SecondMaster, "can.main"));
    // The steering does not move either: its goal waits.
    robot.pass(1000);
    let before = robot.icla.homings;
    robot.home();
    robot.pass(1000);
    assert!(robot.errors.contains(&(Fault::CommandForbidden, Severity::Warning)), "homing is refused meanwhile");
    robot.pass(12_000);
    assert_eq!(robot.icla.homings, before, "it was homed");
    robot.drive(0.0, 50);
    robot.drive(0.4, 300);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn pause_and_stop_hold_the_quick_stop_and_keep_the_contact() {
    for state in [State::Pause, State::Stop] {
        let mut robot = Robot::ready();
        robot.drive(0.4, 500);
        let (module, source) = (NAME.into(), "test".into());
        let command = common::CmdState { timestamp: 0, module, state: state as i8, manual: true, source };
        robot.bench.message(command.clone());
        robot.drive(0.4, 500);
        assert!(!robot.moves());
        assert_eq!(robot.epos.power.state(), PowerState::QuickStopActive);
        let hold = if state == State::Pause { Hold::ModulePaused } else { Hold::ModuleStopped };
        assert_eq!(robot.holds(), [(hold, NAME), (Hold::NotReleased, "test")]);
        assert!(robot.holds.holds.iter().all(|hold| hold.latched), "{:?}", robot.holds);
        robot.bench.message(common::CmdState { state: State::Run as i8, ..command });
        robot.drive(0.4, 300);
        assert!(!robot.moves(), "it resumed by itself");
        robot.pass(300);
        robot.drive(0.0, 50);
        robot.drive(0.4, 300);
        assert!(robot.moves(), "{}", robot.reason());
    }
}

#[test]
fn a_lost_port_is_reported_and_its_return_restarts_everything() {
    let mut robot = Robot::ready();
    robot.bench.event(Event::Port { port: PortId(0), input: Input::Down("cable pulled") });
    robot.pass(500);
    assert_eq!(robot.bench.shell.state(), State::Error);
    assert!(robot.errors.contains(&(Fault::PortDown, Severity::Error)));
    robot.bench.event(Event::Port { port: PortId(0), input: Input::Up });
    robot.pass(5000);
    assert_eq!(robot.bench.shell.state(), State::Run);
    assert!(robot.motion().homed, "{}", robot.reason());
}

#[test]
fn the_end_waits_until_the_robot_stands() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    let (module, source) = ("*".into(), "test".into());
    robot.bench.message(common::CmdState {
        timestamp: 0,
        module,
        state: State::Terminate as i8,
        manual: false,
        source,
    });
    robot.exchange();
    // Quick stop; the fake stands at once, and is switched off.
    let words: Vec<_> = robot.frames.iter().filter(|(_, frame)| frame.id() == can::Id::Standard(0x501)).collect();
    let words: Vec<_> = words[words.len() - 2..].iter().map(|(_, frame)| frame.data()[0]).collect();
    assert_eq!(words, [0x0B, 0x00]);
    assert!(!robot.moves());
    // The drives are reset, and awaited.
    robot.pass(200);
    assert!(robot.ended);
}

#[test]
fn homing_applies_to_the_steering_at_standstill() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    let homing = |axis: &str| lowlevel::CmdHoming { timestamp: 0, axis: axis.into() };
    robot.bench.message(homing("steering"));
    robot.bench.message(homing("propulsion"));
    robot.drive(0.4, 100);
    assert!(robot.moves() && robot.motion().homed);
    assert_eq!(robot.errors.iter().filter(|(fault, _)| *fault == Fault::CommandForbidden).count(), 2);
    robot.pass(1000);
    robot.bench.message(homing("steering"));
    robot.pass(60);
    assert!(!robot.motion().homed);
    robot.pass(2000);
    assert!(robot.motion().homed);
}

#[test]
fn any_frames_on_the_bus_are_survived() {
    let mut robot = Robot::ready();
    let mut seed = 1_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as u32
    };
    for _ in 0..20_000 {
        let data: Vec<u8> = (0..random() % 9).map(|_| random() as u8).collect();
        // Every identifier of both nodes.
        let frame = can::Frame::standard((((random() % 16) << 7) | (random() % 3)) as u16, &data);
        robot.bench.can(PortId(0), frame);
        robot.pass(random() % 2);
    }
    // Some of them were another master's.
    robot.pass(12_000);
    // Homing waits for an operator's command.
    robot.bench.message(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
    robot.pass(10_000);
    assert!(robot.motion().homed, "{}", robot.reason());
}
