//! Wheels on motor controllers without CANopen: emulated ODrives and VESCs, whose motors turn without a body.

use super::super::{Axis, ControllerConfig};
use super::*;
use base::can::Id;
use motorctl::can::{Device, Emulated};
use motorctl::motor::Encoder;
use motorctl::odrive::{self, wire};
use motorctl::vesc;
use settings::robot::{Base, Differential, Layout};
use std::f64::consts::TAU;

const GEAR: f64 = 8.0;
/// Radius of the wheels, m.
const RADIUS: f64 = 0.085;

fn odrive(node: u8) -> Device {
    Device::Odrive(odrive::Device { node, ..odrive::Device::EXAMPLE })
}

fn vesc(id: u8) -> Device {
    Device::Vesc { device: vesc::Device { id, erpm_min: 60.0, ..vesc::Device::EXAMPLE }, host: 128 + id }
}

fn on(device: fn(u8) -> Device) -> Config {
    let wheel = |(node, axis)| PropulsionConfig {
        axis,
        node,
        drive: PropulsionDrive::Controller(ControllerConfig {
            gear: GEAR,
            device: device(node),
            circumference: TAU * RADIUS,
        }),
        writable: Vec::new(),
    };
    Config {
        base: Some(Base { layout: Layout::Differential(Differential { track_m: 0.42 }), strain: 0.3 }),
        wheels: [(1, Axis::Left), (2, Axis::Right)].map(wheel).into(),
        steering: None,
        critical: Vec::new(),
        planning: Vec::new(),
        ..config()
    }
}

/// The module and two controllers on a wire without delay.
struct Rover {
    bench: Bench,
    drives: [Emulated; 2],
    frames: Vec<(Instant, can::Frame)>,
    holds: lowlevel::DataHold,
    axes: Option<lowlevel::DataAxes>,
    bus: Option<lowlevel::DataBus>,
    answers: Vec<lowlevel::DataSdo>,
    errors: Vec<Fault>,
    ended: bool,
}

impl Rover {
    fn new(device: fn(u8) -> Device) -> Self {
        let canbus = Canbus::new(on(device)).expect("a good configuration");
        let mut rover = Self {
            bench: Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(canbus))),
            drives: [1, 2].map(|node| Emulated::new(device(node))),
            frames: Vec::new(),
            holds: lowlevel::DataHold::default(),
            axes: None,
            bus: None,
            answers: Vec::new(),
            errors: Vec::new(),
            ended: false,
        };
        rover.bench.start();
        rover
    }

    /// Started, without a command.
    fn ready(device: fn(u8) -> Device) -> Self {
        let mut rover = Self::new(device);
        rover.pass(2000);
        assert_eq!((rover.bench.shell.state(), rover.causes()), (State::Run, vec![(Hold::NobodyCommands, "")]));
        rover
    }

    fn pass(&mut self, ms: u32) {
        for _ in 0..ms {
            self.bench.pass(MS);
            let now = self.bench.now();
            self.drives.iter_mut().for_each(|drive| drive.handle_timeout(now));
            self.exchange();
        }
    }

    fn exchange(&mut self) {
        loop {
            let (now, mut quiet) = (self.bench.now(), true);
            for (at, action) in self.bench.done() {
                match action {
                    Action::Send(_, Output::Can(frame)) => {
                        quiet = false;
                        self.frames.push((at, frame));
                        self.drives.iter_mut().for_each(|drive| drive.handle_rx(now, &frame));
                    }
                    Action::Publish(Message::LlDataHold(holds)) => self.holds = holds,
                    Action::Publish(Message::LlDataAxes(axes)) => self.axes = Some(axes),
                    Action::Publish(Message::LlDataBus(bus)) => self.bus = Some(bus),
                    Action::Publish(Message::LlDataSdo(answer)) => self.answers.push(answer),
                    Action::Report(report) => self.errors.push(report.fault),
                    Action::Exit(_) => self.ended = true,
                    _ => {}
                }
            }
            for drive in &mut self.drives {
                while let Some(frame) = drive.poll_tx() {
                    quiet = false;
                    self.bench.can(PortId(0), frame);
                }
            }
            if quiet {
                return;
            }
        }
    }

    /// Commands at 20 Hz.
    fn drive(&mut self, speed: f64, ms: u32) {
        for _ in 0..ms / 50 {
            let (priority, source) = (lowlevel::CmdMotion::REMOTE, "test".into());
            self.bench.message(lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source });
            self.exchange();
            self.pass(50);
        }
    }

    /// It drives at 0.4 m/s.
    fn driving(device: fn(u8) -> Device) -> Self {
        let mut rover = Self::ready(device);
        rover.drive(0.0, 50);
        rover.drive(0.4, 1500);
        assert!(rover.is_at(0.4), "{:?}", rover.causes());
        rover
    }

    /// Another program sends this frame.
    fn foreign(&mut self, frame: can::Frame) {
        let now = self.bench.now();
        self.drives.iter_mut().for_each(|drive| drive.handle_rx(now, &frame));
        self.bench.can(PortId(0), frame);
        self.exchange();
    }

    /// Commands 0.4 m/s at 20 Hz; neither wheel moves.
    fn stands(&mut self, ms: u32) {
        for _ in 0..ms / 50 {
            self.drive(0.4, 50);
            assert_eq!(self.speeds(), [0.0; 2], "{:?}", self.causes());
        }
    }

    /// Both wheels turn at this speed, m/s; a VESC is commanded in whole ERPM.
    fn is_at(&self, speed: f64) -> bool {
        self.speeds().iter().all(|each| (each - speed).abs() < 2e-3)
    }

    fn odrive(&mut self, place: usize) -> &mut odrive::device::Device {
        let Emulated::Odrive(drive) = &mut self.drives[place] else { panic!("it is none") };
        drive
    }

    fn vesc(&mut self, place: usize) -> &mut vesc::device::Device<vesc::can::Link> {
        let Emulated::Vesc(drive) = &mut self.drives[place] else { panic!("it is none") };
        drive
    }

    fn are_armed(&self) -> [bool; 2] {
        [0, 1].map(|n: usize| matches!(&self.drives[n], Emulated::Odrive(drive) if drive.is_armed()))
    }

    /// Speeds of the wheels, m/s.
    fn speeds(&self) -> [f64; 2] {
        [0, 1].map(|n: usize| self.drives[n].motor().velocity() / GEAR * TAU * RADIUS)
    }

    fn causes(&self) -> Vec<(Hold, &str)> {
        let cause = |hold: &lowlevel::Hold| hold.cause().expect("a number of this version");
        self.holds.holds.iter().map(|hold| (cause(hold), hold.subject.as_str())).collect()
    }

    /// When the wheel of this node was first commanded zero at or after this instant.
    fn zero(&self, node: u8, since: Instant) -> Option<Instant> {
        let is_zero = |frame: &can::Frame| match frame.id() {
            Id::Standard(_) => wire::Command::decode(frame) == Some((node, wire::Command::SetInputVel(0.0))),
            // CAN_PACKET_SET_CURRENT_BRAKE.
            Id::Extended(id) => id == 0x0200 | u32::from(node),
        };
        self.frames.iter().find(|(at, frame)| *at >= since && is_zero(frame)).map(|(at, _)| *at)
    }
}

#[test]
fn two_odrives_are_started_and_drive_and_no_frame_is_one_of_canopen() {
    let mut rover = Rover::new(odrive);
    rover.drive(0.4, 300);
    assert!(rover.speeds() == [0.0; 2], "it moved before it was started");
    rover = Rover::driving(odrive);
    let own = |frame: &can::Frame| matches!(frame.id(), Id::Standard(id) if [1, 2].contains(&(id >> 5)));
    assert!(rover.frames.iter().all(|(_, frame)| own(frame)));
    let row = |axis: &lowlevel::Axis| (axis.name.clone(), axis.nmt_state, axis.statusword, axis.error_code);
    let axes = rover.axes.as_ref().unwrap();
    let expected = ["left", "right"].map(|name| (name.to_owned(), 5, 0x27, 0));
    assert_eq!(axes.axes.iter().map(row).collect::<Vec<_>>(), expected);
    assert!(axes.axes.iter().all(|axis| (axis.velocity - 0.4).abs() < 1e-3), "{axes:?}");
    let nodes = &rover.bus.as_ref().unwrap().nodes;
    let expected = [("left".to_owned(), 1, lowlevel::Node::OK), ("right".to_owned(), 2, lowlevel::Node::OK)];
    assert_eq!(nodes.iter().map(|node| (node.name.clone(), node.address, node.state)).collect::<Vec<_>>(), expected);
}

#[test]
fn a_source_that_falls_silent_is_a_stop_at_once_and_does_not_resume() {
    let mut rover = Rover::driving(odrive);
    let last = rover.bench.now() - 50 * MS;
    rover.pass(300);
    // The time to live of the command, to the millisecond.
    let zero = last + 250 * MS;
    assert_eq!([1, 2].map(|node| rover.zero(node, zero)), [Some(zero); 2]);
    rover.pass(500);
    rover.drive(0.4, 500);
    assert_eq!((rover.speeds(), rover.causes()), ([0.0; 2], vec![(Hold::NotReleased, "test")]));
    rover.drive(0.0, 50);
    rover.drive(0.4, 1500);
    assert!(rover.is_at(0.4));
}

#[test]
fn the_other_wheel_stops_if_one_is_lost_refuses_or_lies() {
    type Harm = fn(&mut Rover);
    let fault = (Hold::DriveFault, Fault::DriveFault);
    let lost = (Hold::DriveLost, Fault::DriveLost);
    let untrue = (Hold::DriveNoTarget, Fault::DriveFault);
    let harms: [(&str, Harm, u32, (Hold, Fault)); 6] = [
        ("fault", |rover| rover.odrive(1).raise(wire::error::CURRENT_LIMIT_VIOLATION), 20, fault),
        ("silent", |rover| rover.odrive(1).faults.unplugged = true, 80, lost),
        ("mute", |rover| rover.odrive(1).faults.mute = true, 80, lost),
        ("reboot", |rover| rover.drives[1] = Emulated::new(odrive(2)), 20, lost),
        ("dead encoder", |rover| rover.odrive(1).motor.encoder = Encoder::Dead, 230, untrue),
        ("reversed encoder", |rover| rover.odrive(1).motor.encoder = Encoder::Reversed, 230, fault),
    ];
    for (what, harm, within_ms, (hold, report)) in harms {
        let mut rover = Rover::driving(odrive);
        let since = rover.bench.now();
        harm(&mut rover);
        rover.drive(0.4, 300);
        let took = rover.zero(1, since).map(|at| at.since(since));
        assert!(took.is_some_and(|took| took <= within_ms * MS), "{what}: {took:?}");
        let causes = rover.causes();
        assert!(causes.contains(&(hold, "right")) && rover.errors.contains(&report), "{what}: {causes:?}");
        rover.drive(0.4, 3000);
        assert_eq!(rover.speeds()[0], 0.0, "{what}: it moves by itself");
    }
}

#[test]
fn a_drive_that_comes_back_is_started_again_and_waits_for_an_act() {
    let mut rover = Rover::driving(odrive);
    rover.odrive(1).faults.unplugged = true;
    rover.drive(0.4, 500);
    // Its own time limit has acted.
    assert!(!rover.are_armed()[1]);
    rover.odrive(1).faults.unplugged = false;
    rover.drive(0.4, 4000);
    assert_eq!((rover.speeds(), rover.causes()), ([0.0; 2], vec![(Hold::NotReleased, "test")]));
    assert_eq!(rover.are_armed(), [true; 2], "they hold zero");
    rover.drive(0.0, 50);
    rover.drive(0.4, 1500);
    assert!(rover.is_at(0.4));
}

#[test]
fn another_firmware_and_a_dead_watchdog_are_refused() {
    type Harm = fn(&mut Rover);
    let harms: [(Harm, Fault); 2] = [
        (|rover| rover.drives[0] = other_firmware(), Fault::DriveMismatch),
        (|rover| rover.odrive(0).faults.watchdog_dead = true, Fault::DriveBootFailed),
    ];
    for (harm, report) in harms {
        let mut rover = Rover::new(odrive);
        harm(&mut rover);
        rover.drive(0.0, 3000);
        rover.drive(0.4, 1000);
        assert!(rover.errors.contains(&report), "{:?}", rover.errors);
        assert_eq!((rover.speeds(), rover.causes()[0]), ([0.0; 2], (Hold::DriveBootFailed, "left")));
    }
}

fn other_firmware() -> Emulated {
    let usual = odrive::Device { node: 1, ..odrive::Device::EXAMPLE };
    let version = wire::Version { firmware: [0, 6, 9], ..usual.version };
    Emulated::new(Device::Odrive(odrive::Device { version, ..usual }))
}

#[test]
fn a_second_master_stops_the_robot_and_one_who_only_asks_does_not() {
    let mut rover = Rover::driving(odrive);
    rover.bench.can(PortId(0), wire::Command::GetError.frame(1));
    rover.drive(0.4, 100);
    assert_eq!(rover.causes(), []);
    let since = rover.bench.now();
    rover.bench.can(PortId(0), wire::Command::SetInputVel(1.0).frame(1));
    rover.drive(0.4, 100);
    assert_eq!([1, 2].map(|node| rover.zero(node, since)), [Some(since); 2]);
    assert_eq!(rover.causes()[0], (Hold::SecondMaster, "can.main"));
}

#[test]
fn an_odrive_that_another_program_has_configured_is_started_anew_before_it_drives_again() {
    let endpoint = odrive::Device::EXAMPLE.endpoints.enable_watchdog;
    let switch = |on| wire::Command::Write { endpoint, value: wire::Value::Bool(on) };
    let silence = Duration::from_millis(150);
    // Once; twice while it drives; again while it is started, before and after its own time limit was proven.
    for again_after_ms in [None, Some(50), Some(800), Some(1100), Some(1300), Some(1500)] {
        let mut rover = Rover::driving(odrive);
        let mut since = rover.bench.now();
        rover.foreign(switch(false).frame(2));
        assert_eq!([1, 2].map(|node| rover.zero(node, since)), [Some(since); 2]);
        rover.drive(0.4, 50);
        assert!(rover.causes().contains(&(Hold::DriveParameter, "right")), "{:?}", rover.causes());
        if let Some(ms) = again_after_ms {
            rover.drive(0.4, ms);
            since = rover.bench.now();
            rover.foreign(switch(false).frame(2));
        }
        rover.drive(0.4, 1000);
        rover.stands(13_000);
        assert_eq!(rover.causes(), [(Hold::NotReleased, "test")], "{again_after_ms:?}");
        let to = |frame: &can::Frame| wire::Command::decode(frame).filter(|(node, _)| *node == 2);
        let sent: Vec<_> = rover.frames.iter().filter(|(at, _)| *at > since).collect();
        let place = |command| sent.iter().position(|(_, frame)| to(frame) == Some((2, command)));
        let (written, read) = (place(switch(true)).unwrap(), place(wire::Command::Read { endpoint }).unwrap());
        assert!(written < read, "written {written}, read {read}");
        // Its time limit is proven.
        let own: Vec<Instant> =
            sent[read..].iter().filter(|(_, frame)| to(frame).is_some()).map(|(at, _)| *at).collect();
        assert!(own.windows(2).any(|pair| pair[1].since(pair[0]) >= silence), "{again_after_ms:?}");
        rover.drive(0.0, 50);
        rover.drive(0.4, 1500);
        assert!(rover.is_at(0.4), "{:?}", rover.causes());
        rover.bench.event(Event::Port { port: PortId(0), input: Input::Down("unplugged") });
        rover.exchange();
        rover.drive(0.4, 300);
        assert_eq!(rover.are_armed(), [false; 2], "{again_after_ms:?}");
    }
}

#[test]
fn a_wheel_that_another_program_commands_all_the_time_is_not_left_without_torque() {
    let mut rover = Rover::driving(odrive);
    for _ in 0..50 {
        rover.foreign(wire::Command::SetControllerMode { control: 2, input: 1 }.frame(1));
        rover.drive(0.4, 100);
        assert_eq!(rover.are_armed(), [true; 2]);
    }
    assert_eq!(rover.speeds(), [0.0; 2]);
    // Commands of the other device, and questions, do not start it again.
    let frames = rover.frames.len();
    rover.foreign(wire::Command::GetError.frame(2));
    rover.drive(0.4, 3000);
    let restarted =
        |node| rover.frames[frames..].iter().any(|(_, frame)| *frame == wire::Command::GetVersion.frame(node));
    assert_eq!([restarted(1), restarted(2)], [true, false]);
}

#[test]
fn objects_of_canopen_are_refused_where_there_is_none() {
    let mut rover = Rover::ready(odrive);
    rover.bench.message(lowlevel::CmdSdo { node: 1, index: 0x1000, ..Default::default() });
    rover.exchange();
    assert_eq!(rover.answers.len(), 1);
    assert_ne!(rover.answers[0].abort_code, 0);
}

#[test]
fn a_bus_that_was_down_starts_the_drives_again() {
    let mut rover = Rover::driving(odrive);
    rover.bench.event(Event::Port { port: PortId(0), input: Input::Down("unplugged") });
    rover.exchange();
    let frames = rover.frames.len();
    rover.drive(0.4, 1000);
    assert_eq!(rover.frames.len(), frames, "frames for a port that is down");
    assert_eq!(rover.causes()[0], (Hold::BusDown, "can.main"));
    assert!(rover.are_armed() == [false; 2], "by their own time limit");
    rover.bench.event(Event::Port { port: PortId(0), input: Input::Up });
    rover.drive(0.4, 3000);
    assert_eq!((rover.speeds(), rover.causes()), ([0.0; 2], vec![(Hold::NotReleased, "test")]));
}

#[test]
fn a_module_that_ends_leaves_its_drives_without_torque() {
    let mut rover = Rover::driving(odrive);
    let state = State::Terminate as i8;
    rover.bench.message(common::CmdState { module: NAME.into(), state, manual: true, ..Default::default() });
    rover.exchange();
    rover.pass(2000);
    assert!(rover.ended && rover.are_armed() == [false; 2]);
    let estop = |frame: &can::Frame| matches!(wire::Command::decode(frame), Some((_, wire::Command::Estop)));
    let stopped: Vec<Instant> = rover.frames.iter().filter(|(_, frame)| estop(frame)).map(|(at, _)| *at).collect();
    assert_eq!(stopped.len(), 2);
    assert!(rover.frames.iter().all(|(at, _)| *at <= stopped[1]), "nothing after it");
}

#[test]
fn two_vescs_drive_and_the_other_stops_if_one_is_lost_or_lies() {
    type Harm = fn(&mut Rover);
    let fault = (Hold::DriveFault, Fault::DriveFault);
    let lost = (Hold::DriveLost, Fault::DriveLost);
    let untrue = (Hold::DriveNoTarget, Fault::DriveFault);
    let harms: [(&str, Harm, u32, (Hold, Fault)); 5] = [
        ("fault", |rover| rover.vesc(1).raise(3), 40, fault),
        ("silent", |rover| rover.vesc(1).faults.unplugged = true, 80, lost),
        ("mute", |rover| rover.vesc(1).faults.mute = true, 80, lost),
        ("deaf", |rover| rover.vesc(1).faults.deaf = true, 260, lost),
        ("dead encoder", |rover| rover.vesc(1).motor.encoder = Encoder::Dead, 250, untrue),
    ];
    for (what, harm, within_ms, (hold, report)) in harms {
        let mut rover = Rover::driving(vesc);
        let own = |frame: &can::Frame| matches!(frame.id(), Id::Extended(id) if [1, 2].contains(&(id as u8)));
        assert!(rover.frames.iter().all(|(_, frame)| own(frame)), "a frame of CANopen");
        let since = rover.bench.now();
        harm(&mut rover);
        rover.drive(0.4, 300);
        let took = rover.zero(1, since).map(|at| at.since(since));
        assert!(took.is_some_and(|took| took <= within_ms * MS), "{what}: {took:?}");
        let causes = rover.causes();
        assert!(causes.contains(&(hold, "right")) && rover.errors.contains(&report), "{what}: {causes:?}");
        rover.drive(0.4, 3000);
        assert_eq!(rover.speeds()[0], 0.0, "{what}: it moves by itself");
    }
}

#[test]
fn the_commands_to_all_wheels_precede_the_questions_to_any() {
    let mut rover = Rover::driving(vesc);
    rover.frames.clear();
    rover.drive(0.4, 50);
    let mut rounds = 0;
    for round in rover.frames.chunk_by(|(a, _), (b, _)| a == b) {
        let is_command = |frame| [1, 2].into_iter().any(|id| vesc(id).is_commanded_by(frame));
        let kinds: Vec<bool> = round.iter().map(|(_, frame)| is_command(frame)).collect();
        assert!(kinds.is_sorted_by(|command, next| command >= next), "{round:?}");
        rounds += u32::from(kinds == [true, true, false, false]);
    }
    assert!(rounds >= 2, "{:?}", rover.frames);
}

#[test]
fn a_vesc_brakes_without_commands_and_one_whose_timeout_is_long_or_dead_is_refused() {
    let mut rover = Rover::driving(vesc);
    // The wire is cut on the driver's side: nothing arrives, and the devices act by themselves.
    rover.bench.event(Event::Port { port: PortId(0), input: Input::Down("unplugged") });
    rover.exchange();
    rover.pass(1000);
    assert!(rover.speeds() == [0.0; 2] && rover.vesc(0).is_timed_out());
    type Harm = fn(&mut Rover);
    let harms: [Harm; 3] = [
        |rover| rover.vesc(0).timeout_ms = 1000,
        |rover| rover.vesc(0).timeout_ms = 0,
        |rover| rover.vesc(0).faults.timeout_dead = true,
    ];
    for harm in harms {
        let mut rover = Rover::new(vesc);
        harm(&mut rover);
        rover.drive(0.0, 3000);
        rover.drive(0.4, 1000);
        assert!(rover.errors.contains(&Fault::DriveBootFailed), "{:?}", rover.errors);
        assert_eq!((rover.speeds(), rover.causes()[0]), ([0.0; 2], (Hold::DriveBootFailed, "left")));
    }
}

#[test]
fn a_second_master_of_a_vesc_stops_the_robot_and_one_who_only_asks_does_not() {
    let mut rover = Rover::driving(vesc);
    let frame = |id: u32, data: &[u8]| can::Frame::new(Id::Extended(id), data).unwrap();
    // COMM_GET_VALUES for 7, who is answered there.
    rover.bench.can(PortId(0), frame(0x0801, &[7, 0, 4]));
    rover.drive(0.4, 100);
    assert_eq!(rover.causes(), []);
    rover.bench.can(PortId(0), frame(0x0301, &[0, 0, 3, 0xE8]));
    rover.drive(0.4, 100);
    assert_eq!(rover.causes()[0], (Hold::SecondMaster, "can.main"));
    rover.drive(0.4, 2000);
    assert_eq!(rover.speeds(), [0.0; 2]);
}

#[test]
fn a_vesc_that_another_program_has_configured_is_started_anew_before_it_drives_again() {
    // The first fragment of COMM_SET_APPCONF to 2.
    let configures = can::Frame::new(Id::Extended(0x0502), &[0, 16, 0, 0, 0, 0, 0, 0]).unwrap();
    let mut rover = Rover::driving(vesc);
    rover.foreign(configures);
    let usual = std::mem::replace(&mut rover.vesc(1).timeout_ms, 0);
    rover.drive(0.4, 50);
    assert!(rover.causes().contains(&(Hold::DriveParameter, "right")), "{:?}", rover.causes());
    rover.drive(0.4, 1000);
    rover.stands(3000);
    assert!(rover.causes().contains(&(Hold::DriveBootFailed, "right")), "{:?}", rover.causes());
    rover.vesc(1).timeout_ms = usual;
    rover.stands(13_000);
    assert_eq!(rover.causes(), [(Hold::NotReleased, "test")]);
    rover.drive(0.0, 50);
    rover.drive(0.4, 1500);
    assert!(rover.is_at(0.4), "{:?}", rover.causes());
}
