//! Wheels on serial lines, and no CAN bus: emulated VESCs and a RoboClaw, whose motors turn without a body.

use super::super::LineConfig;
use super::*;
use base::serial::Word;
use motorctl::motor::{Drive, Encoder};
use motorctl::roboclaw::{self, wire};
use motorctl::serial::{Device, Emulated};
use motorctl::vesc;
use settings::robot::{Base, Differential, Layout};
use std::f64::consts::TAU;

const GEAR: f64 = 8.0;
/// Radius of the wheels, m.
const RADIUS: f64 = 0.085;

fn vesc(id: u8) -> Device {
    Device::Vesc(vesc::Device { id, erpm_min: 60.0, ..vesc::Device::EXAMPLE })
}

/// A line with its device for each of these.
fn line(name: &str, device: Device, axes: &[Axis]) -> LineConfig {
    let motors = axes.iter().map(|axis| (*axis, GEAR)).collect();
    LineConfig { bus: format!("serial.{name}"), baud: 115_200, device, motors }
}

/// The right wheel is the one that is harmed.
fn on_vescs() -> Config {
    on(vec![line("left", vesc(1), &[Axis::Left]), line("right", vesc(2), &[Axis::Right])])
}

/// A GPIO line feeds the motors.
fn on_roboclaw() -> Config {
    let gpio = GpioConfig { chip: "/dev/gpiochip0".into(), line: LineId::Number(17), active_low: false };
    let device = Device::RoboClaw(roboclaw::Device::EXAMPLE);
    let config = on(vec![line("wheels", device, &[Axis::Left, Axis::Right])]);
    Config { stop: Stop { second_way: SecondWay::Gpio, gpio: Some(gpio), ..config.stop.clone() }, ..config }
}

fn on(lines: Vec<LineConfig>) -> Config {
    let motors = lines.iter().enumerate().flat_map(|(number, line)| {
        let of = move |(motor, (axis, _)): (usize, &(Axis, f64))| PropulsionConfig {
            axis: *axis,
            node: line.device.address(),
            drive: PropulsionDrive::OnLine { line: number, motor },
            writable: Vec::new(),
        };
        line.motors.iter().enumerate().map(of)
    });
    Config {
        base: Some(Base { layout: Layout::Differential(Differential { track_m: 0.42 }), strain: 0.3 }),
        wheel_circumference: TAU * RADIUS,
        wheels: motors.collect(),
        bus: None,
        lines,
        steering: None,
        critical: Vec::new(),
        planning: Vec::new(),
        ..config()
    }
}

/// The module and its lines without delay.
struct Rover {
    bench: Bench,
    config: Config,
    ends: Vec<Emulated>,
    /// The line of this number is closed.
    closed: Option<usize>,
    /// Each byte that the device of this line sends is damaged.
    garbled: Option<usize>,
    holds: lowlevel::DataHold,
    axes: Option<lowlevel::DataAxes>,
    buses: Vec<lowlevel::DataBus>,
    errors: Vec<Fault>,
    ended: bool,
    /// When the motor of the left wheel was last driven.
    driven: Instant,
}

impl Rover {
    fn new(config: Config) -> Self {
        let canbus = Canbus::new(config.clone()).expect("a good configuration");
        let mut rover = Self {
            bench: Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(canbus))),
            ends: config.lines.iter().map(|line| Emulated::new(line.device)).collect(),
            config,
            closed: None,
            garbled: None,
            holds: lowlevel::DataHold::default(),
            axes: None,
            buses: Vec::new(),
            errors: Vec::new(),
            ended: false,
            driven: Instant::ZERO,
        };
        rover.bench.start();
        rover
    }

    /// Port of the first line.
    fn first(&self) -> usize {
        usize::from(self.config.stop.feed_line().is_some())
    }

    fn port(&self, line: usize) -> PortId {
        PortId((self.first() + line) as u8)
    }

    fn pass(&mut self, ms: u32) {
        for _ in 0..ms {
            self.bench.pass(MS);
            let now = self.bench.now();
            self.ends.iter_mut().for_each(|end| end.handle_timeout(now));
            self.exchange();
            if matches!(self.ends[0].motors()[0].drive, Drive::Velocity(turns) if turns != 0.0) {
                self.driven = now;
            }
        }
    }

    fn exchange(&mut self) {
        loop {
            let (now, mut quiet) = (self.bench.now(), true);
            for (_, action) in self.bench.done() {
                match action {
                    Action::Send(port, Output::Words(words)) => {
                        quiet = false;
                        let line = usize::from(port.0) - self.first();
                        assert!(self.closed != Some(line), "bytes for a port that is down");
                        let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                        self.ends[line].handle_rx(now, &bytes);
                    }
                    Action::Send(port, Output::Gpio(signal)) => {
                        quiet = false;
                        let level = if let Signal::Level(level) = signal { level } else { true };
                        self.bench.event(Event::Port { port, input: Input::Gpio(Signal::Level(level)) });
                    }
                    Action::Send(_, other) => panic!("there is no port for {other:?}"),
                    Action::Publish(Message::LlDataHold(holds)) => self.holds = holds,
                    Action::Publish(Message::LlDataAxes(axes)) => self.axes = Some(axes),
                    Action::Publish(Message::LlDataBus(bus)) => self.buses.push(bus),
                    Action::Report(report) => self.errors.push(report.fault),
                    Action::Exit(_) => self.ended = true,
                    _ => {}
                }
            }
            for line in 0..self.ends.len() {
                while let Some(bytes) = self.ends[line].poll_tx(now) {
                    quiet = false;
                    let damage = if self.garbled == Some(line) { 0x55 } else { 0 };
                    let words: Vec<Word> = bytes.iter().map(|byte| Word::data(byte ^ damage)).collect();
                    if self.closed != Some(line) {
                        self.bench.words(self.port(line), &words);
                    }
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
    fn driving(config: Config) -> Self {
        let mut rover = Self::new(config);
        rover.pass(2000);
        assert_eq!((rover.bench.shell.state(), rover.causes()), (State::Run, vec![(Hold::NobodyCommands, "")]));
        rover.drive(0.0, 50);
        rover.drive(0.4, 1500);
        assert!(rover.is_at(0.4), "{:?} {:?}", rover.speeds(), rover.causes());
        rover
    }

    /// Both wheels turn at this speed, m/s, as far as the device resolves it.
    fn is_at(&self, speed: f64) -> bool {
        self.speeds().iter().all(|each| (each - speed).abs() < 2e-3)
    }

    /// Speeds of the wheels, m/s.
    fn speeds(&self) -> Vec<f64> {
        let motors = self.ends.iter().flat_map(Emulated::motors);
        motors.map(|motor| motor.velocity() / GEAR * TAU * RADIUS).collect()
    }

    /// The device that turns the right wheel, and the number of its motor.
    fn right(&mut self) -> (&mut Emulated, usize) {
        match &mut self.ends[..] {
            [one] => (one, 1),
            [_, right] => (right, 0),
            other => panic!("{} devices", other.len()),
        }
    }

    fn encoder(&mut self, encoder: Encoder) {
        let (end, motor) = self.right();
        end.motors_mut()[motor].encoder = encoder;
    }

    fn unplug(&mut self, unplugged: bool) {
        match self.right().0 {
            Emulated::Vesc(own) => own.faults.unplugged = unplugged,
            Emulated::RoboClaw(own) => own.faults.unplugged = unplugged,
        }
    }

    fn set_port(&mut self, line: usize, up: bool) {
        self.closed = (!up).then_some(line);
        let input = if up { Input::Up } else { Input::Down("unplugged") };
        self.bench.event(Event::Port { port: self.port(line), input });
        self.exchange();
    }

    fn causes(&self) -> Vec<(Hold, &str)> {
        let cause = |hold: &lowlevel::Hold| hold.cause().expect("a number of this version");
        self.holds.holds.iter().map(|hold| (cause(hold), hold.subject.as_str())).collect()
    }
}

#[test]
fn both_kinds_are_started_and_drive_without_a_can_bus() {
    for (config, expected) in [
        (on_vescs(), vec![("serial.left", vec![("left", 1)]), ("serial.right", vec![("right", 2)])]),
        (on_roboclaw(), vec![("serial.wheels", vec![("left", 0x80), ("right", 0x80)])]),
    ] {
        let mut rover = Rover::new(config.clone());
        rover.drive(0.4, 200);
        assert!(rover.speeds() == [0.0; 2], "it moved before it was started");
        let rover = Rover::driving(config);
        let row = |axis: &lowlevel::Axis| (axis.name.clone(), axis.nmt_state, axis.statusword, axis.error_code);
        let axes = rover.axes.as_ref().unwrap();
        let rows = ["left", "right"].map(|name| (name.to_owned(), 5, 0x27, 0));
        assert_eq!(axes.axes.iter().map(row).collect::<Vec<_>>(), rows);
        for (name, nodes) in expected {
            let bus = rover.buses.iter().rev().find(|bus| bus.bus == name).expect(name);
            let found: Vec<_> = bus.nodes.iter().map(|node| (node.name.as_str(), node.address)).collect();
            assert_eq!(found, nodes);
            assert!(bus.nodes.iter().all(|node| node.state == lowlevel::Node::OK), "{bus:?}");
            assert!(bus.load > 0.05 && bus.load < 0.9 && bus.errors == 0, "{bus:?}");
            assert_eq!(bus.state, lowlevel::DataBus::ACTIVE);
        }
        assert!(rover.buses.iter().all(|bus| bus.bus.starts_with("serial.")), "{:?}", rover.buses);
    }
}

#[test]
fn the_other_wheel_stops_if_one_is_lost_refuses_or_lies() {
    type Harm = fn(&mut Rover);
    type Found = (Hold, &'static str, Fault);
    let fault = (Hold::DriveFault, "right", Fault::DriveFault);
    let lost = (Hold::DriveLost, "right", Fault::DriveLost);
    let untrue = (Hold::DriveNoTarget, "right", Fault::DriveFault);
    let fast = (Hold::SpeedExceeded, "", Fault::SpeedExceeded);
    let harms: [(&str, Harm, u32, Found); 6] = [
        ("fault", |rover| rover.right().0.raise(3), 60, fault),
        ("silent", |rover| rover.unplug(true), 90, lost),
        ("garbled", |rover| rover.garbled = Some(rover.ends.len() - 1), 90, lost),
        ("closed", |rover| rover.set_port(rover.ends.len() - 1, false), 1, lost),
        ("dead encoder", |rover| rover.encoder(Encoder::Dead), 260, untrue),
        ("reversed encoder", |rover| rover.encoder(Encoder::Reversed), 260, fast),
    ];
    for (config, (what, harm, within_ms, (hold, subject, report))) in
        [on_vescs(), on_roboclaw()].iter().flat_map(|config| harms.map(|harm| (config, harm)))
    {
        let mut rover = Rover::driving(config.clone());
        let kind = rover.ends.len();
        let since = rover.bench.now();
        harm(&mut rover);
        rover.drive(0.4, 300);
        // A RoboClaw that is cut off turns on until its own time limit.
        let own_limit = if kind == 1 && ["silent", "closed"].contains(&what) { 200 } else { 0 };
        let took = rover.driven.since(since);
        assert!(took <= (within_ms + own_limit) * MS, "{kind} {what}: {took:?}");
        let causes = rover.causes();
        assert!(causes.contains(&(hold, subject)) && rover.errors.contains(&report), "{kind} {what}: {causes:?}");
        rover.drive(0.4, 4000);
        assert_eq!(rover.speeds()[0], 0.0, "{kind} {what}: it moves by itself");
    }
}

#[test]
fn a_line_that_was_closed_starts_its_drive_again_and_waits_for_an_act() {
    for config in [on_vescs(), on_roboclaw()] {
        let mut rover = Rover::driving(config);
        rover.set_port(0, false);
        rover.drive(0.4, 1000);
        assert!(rover.errors.contains(&Fault::PortDown), "{:?}", rover.errors);
        assert_eq!(rover.causes()[0], (Hold::DriveLost, "left"));
        rover.set_port(0, true);
        rover.drive(0.4, 4000);
        assert_eq!((rover.speeds(), rover.causes()), (vec![0.0; 2], vec![(Hold::NotReleased, "test")]));
        rover.drive(0.0, 50);
        rover.drive(0.4, 1500);
        assert!(rover.is_at(0.4), "{:?} {:?}", rover.speeds(), rover.causes());
    }
}

#[test]
fn the_wheels_of_one_device_turn_at_their_own_speeds() {
    let mut rover = Rover::driving(on_roboclaw());
    for _ in 0..30 {
        let (priority, source, session) = (lowlevel::CmdMotion::REMOTE, "test".to_owned(), 0);
        let omega = 0.5;
        rover.bench.message(lowlevel::CmdVelocity { timestamp: 0, vx: 0.3, vy: 0.0, omega, priority, source, session });
        rover.exchange();
        rover.pass(50);
    }
    let [left, right] = rover.speeds()[..] else { panic!("two wheels") };
    assert!((left - (0.3 - 0.5 * 0.21)).abs() < 2e-3 && (right - (0.3 + 0.5 * 0.21)).abs() < 2e-3, "{left} {right}");
}

#[test]
fn a_roboclaw_without_a_second_way_is_refused() {
    let config = on_roboclaw();
    let stop = Stop { second_way: SecondWay::None, gpio: None, ..config.stop.clone() };
    let mut rover = Rover::new(Config { stop, ..config });
    rover.drive(0.0, 2000);
    rover.drive(0.4, 1000);
    assert!(rover.errors.contains(&Fault::DriveBootFailed), "{:?}", rover.errors);
    assert_eq!((rover.speeds(), rover.causes()[0]), (vec![0.0; 2], (Hold::DriveBootFailed, "left")));
}

#[test]
fn a_vesc_whose_timeout_is_long_or_dead_is_refused_and_so_is_another_roboclaw() {
    type Harm = fn(&mut Emulated);
    let harms: [(Config, Harm, Fault); 4] = [
        (on_vescs(), |end| vesc_of(end).timeout_ms = 1000, Fault::DriveBootFailed),
        (on_vescs(), |end| vesc_of(end).timeout_ms = 0, Fault::DriveBootFailed),
        (on_vescs(), |end| vesc_of(end).faults.timeout_dead = true, Fault::DriveBootFailed),
        (on_roboclaw(), |end| other_model(end), Fault::DriveMismatch),
    ];
    for (config, harm, report) in harms {
        let mut rover = Rover::new(config);
        harm(&mut rover.ends[0]);
        rover.drive(0.0, 3000);
        rover.drive(0.4, 1000);
        assert!(rover.errors.contains(&report), "{:?}", rover.errors);
        assert_eq!((rover.speeds(), rover.causes()[0]), (vec![0.0; 2], (Hold::DriveBootFailed, "left")));
    }
}

fn vesc_of(end: &mut Emulated) -> &mut vesc::device::Device<vesc::uart::Link> {
    let Emulated::Vesc(own) = end else { panic!("a RoboClaw") };
    own
}

fn other_model(end: &mut Emulated) {
    let Emulated::RoboClaw(own) = end else { panic!("a VESC") };
    own.model = roboclaw::Model::new("RoboClaw 2x30a v4.1.34").unwrap();
}

#[test]
fn an_error_of_one_motor_stops_both_wheels_of_a_roboclaw() {
    let mut rover = Rover::driving(on_roboclaw());
    let Emulated::RoboClaw(own) = &mut rover.ends[0] else { panic!("a VESC") };
    own.raise(wire::M1_CURRENT_ERROR);
    rover.drive(0.4, 100);
    let causes = rover.causes();
    assert!(["left", "right"].iter().all(|axis| causes.contains(&(Hold::DriveFault, axis))), "{causes:?}");
}

#[test]
fn any_bytes_on_a_line_are_counted_and_do_no_harm() {
    for config in [on_vescs(), on_roboclaw()] {
        let mut rover = Rover::driving(config);
        let mut random = 1_u32;
        let mut byte = || {
            // Xorshift (Marsaglia 2003).
            random ^= random << 13;
            random ^= random >> 17;
            random ^= random << 5;
            random as u8
        };
        for _ in 0..2000 {
            let words: Vec<Word> = (0..byte() % 20).map(|_| Word::data(byte())).collect();
            let port = rover.port(0);
            rover.bench.words(port, &words);
            rover.exchange();
            rover.pass(1);
        }
        assert!(rover.buses.iter().any(|bus| bus.errors > 0));
        rover.pass(2000);
        assert_eq!(rover.speeds(), [0.0; 2], "its source is silent");
    }
}

#[test]
fn a_module_that_ends_leaves_its_drives_without_torque() {
    for config in [on_vescs(), on_roboclaw()] {
        let mut rover = Rover::driving(config);
        let state = State::Terminate as i8;
        rover.bench.message(common::CmdState { module: NAME.into(), state, manual: true, ..Default::default() });
        rover.exchange();
        rover.pass(2000);
        let drives: Vec<Drive> = rover.ends.iter().flat_map(Emulated::motors).map(|motor| motor.drive).collect();
        assert!(rover.ended && rover.speeds() == [0.0; 2], "{:?}", rover.causes());
        // The brake current of a VESC acts without commands, too.
        assert!(drives.iter().all(|drive| matches!(drive, Drive::Free | Drive::Brake)), "{drives:?}");
    }
}
