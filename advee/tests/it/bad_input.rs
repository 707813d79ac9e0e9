//! Treatment of bad input: it is counted, reported once with one clear line for each cause, and stops no unaffected
//! part.
//!
//! Input over sockets, files and devices is tested on a live robot; input from boards and drives in virtual time, where
//! the faults are exact.

use crate::support::{self, Robot};
use base::can::{Frame, Id};
use base::{Duration, Fault, Instant, Report, Severity};
use canopen::{Node, drives};
use messages::{Channel, Message, common, lowlevel, simulation};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, Shell, ShellConfig, State};
use robot::place::RobotLocation;
use robot::topology::{self, can_port_beside, virtual_machine};
use sim::host::{Config, News, Virtual};
use std::cell::RefCell;
use std::net::{Ipv4Addr, UdpSocket};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Number of repetitions of each bad input.
const FLOOD: u32 = 100;

/// Reports of one fault by the live robot so far: module and text.
fn reported(robot: &Robot, fault: Fault) -> Vec<(String, String)> {
    let of_it = robot.view.errors.iter().filter(|error| error.number == fault as i32);
    of_it.map(|error| (error.module.clone(), error.message.clone())).collect()
}

/// Drives at 0.4 m/s, and sends bad input with every command.
fn drive_through(robot: &mut Robot, mut bad: impl FnMut(&mut Robot)) {
    robot.drive(0.4, 0.0, 2.0);
    for _ in 0..20 {
        for _ in 0..FLOOD / 20 {
            bad(robot);
        }
        robot.drive(0.4, 0.0, 0.05);
    }
    robot.drive(0.4, 0.0, 0.5);
    assert!((robot.view.speed() - 0.4).abs() < 0.02, "{} m/s: {}", robot.view.speed(), robot.view.reason());
}

/// Sends a datagram to the robot's own LCM or CAN bus.
fn throw(group: [u8; 4], port: u16, datagram: &[u8]) {
    let stranger = UdpSocket::bind("0.0.0.0:0").expect("a socket");
    stranger.set_multicast_ttl_v4(0).expect("it stays on this machine");
    stranger.send_to(datagram, (Ipv4Addr::from(group), port)).expect("it leaves");
}

const LCM_GROUP: [u8; 4] = [239, 255, 76, 67];
const CAN_GROUP: [u8; 4] = [239, 74, 163, 2];

#[test]
fn a_wrong_fingerprint_is_reported_once_and_the_robot_drives_on() {
    let mut robot = Robot::ready(&[]);
    let mut other_type = Vec::new();
    Message::from(common::DataState::default()).encode(&mut other_type).unwrap();
    drive_through(&mut robot, |robot| robot.bus.publish("LL_CMD_MOTION", &other_type).unwrap());
    let [found, expected] = [Channel::CmDataState, Channel::LlCmdMotion].map(Channel::fingerprint);
    let why = format!(
        "LL_CMD_MOTION: a message of {} bytes is dropped: another type: fingerprint {found:016x} where {expected:016x} is \
         expected",
        other_type.len()
    );
    let reports = reported(&robot, Fault::MessageMalformed);
    assert_eq!(reports, [("driver_canbus".into(), why)]);
}

#[test]
fn truncated_datagrams_and_messages_are_reported_once_each_and_the_robot_drives_on() {
    let mut robot = Robot::ready(&[]);
    let mut motion = Vec::new();
    Message::from(lowlevel::CmdMotion::default()).encode(&mut motion).unwrap();
    let port = robot.port;
    drive_through(&mut robot, |robot| {
        robot.bus.publish("LL_CMD_MOTION", &motion[..20]).unwrap();
        throw(LCM_GROUP, port, b"LC02\0\0");
        throw(LCM_GROUP, port, b"LC02\0\0\0\x07LL_CMD_MOTI");
        throw(LCM_GROUP, port, b"nothing of ours at all");
    });
    let mut reports = reported(&robot, Fault::MessageMalformed);
    // The text names the sender, whose port varies.
    for (_, why) in &mut reports {
        if let (Some(from), Some(to)) = (why.find(" from "), why.find(" dropped: ")) {
            why.replace_range(from..to, "");
        }
    }
    reports.sort();
    let said = |module: &str, why: &str| (module.to_string(), why.to_string());
    assert_eq!(
        reports,
        [
            said("driver_canbus", "LL_CMD_MOTION: a message of 20 bytes is dropped: truncated: 8 bytes needed, 4 left"),
            said("watchdog", "LCM datagram dropped: 6 bytes do not hold an LCM header"),
            said("watchdog", "LCM datagram dropped: the magic number 0x6e6f7468 is not LCM's"),
        ]
    );
    // A name without an end does not pass the kernel's filter of a module; a subscriber to everything counts it.
    let counted = robot.bus.rejections();
    let counts: u64 = counted.iter().map(|kind| kind.count).sum();
    assert_eq!((counted.len(), counts), (3, 3 * u64::from(FLOOD)), "{counted:?}");
}

#[test]
fn a_datagram_that_is_not_a_can_frame_is_reported_once_and_the_robot_drives_on() {
    let mut robot = Robot::ready(&[]);
    let port = can_port_beside(robot.port);
    drive_through(&mut robot, |_| throw(CAN_GROUP, port, b"nonsense"));
    let reports = reported(&robot, Fault::MessageMalformed);
    let modules: Vec<&str> = reports.iter().map(|(module, _)| module.as_str()).collect();
    assert!(modules == ["driver_canbus", "simulator"] || modules == ["simulator", "driver_canbus"], "{reports:?}");
    for (_, why) in reports {
        let [bus, sender] = ["dropped a datagram from ", " that is not a frame: "].map(|part| why.find(part).unwrap());
        assert!(why.starts_with("can.main: ") && bus < sender && !why.contains('\n'), "{why}");
    }
}

#[test]
fn a_missing_device_is_reported_once_until_it_appears() {
    // The driver alone: the simulator, which provides the device, starts later.
    let run_dir = std::env::temp_dir().join(format!("advee-missing-{}", std::process::id()));
    std::fs::create_dir_all(&run_dir).unwrap();
    let url = format!("udpm://239.255.76.67:{}?ttl=0", 19_000 + std::process::id() % 900);
    let mut bus = support::listen(&url);
    let run = |module: &str| support::advee(&url, &run_dir).args(["run", module, "--sim"]).spawn().unwrap();
    let mut driver = run("driver_rs485a");
    let (mut states, mut errors) = (Vec::new(), Vec::new());
    let mut listen = |seconds: f64, until: State, states: &mut Vec<i8>, errors: &mut Vec<(i8, String)>| {
        let end = std::time::Instant::now() + std::time::Duration::from_secs_f64(seconds);
        while std::time::Instant::now() < end && states.last() != Some(&(until as i8)) {
            bus.wait(std::time::Duration::from_millis(20)).unwrap();
            while let Some(received) = bus.recv().unwrap() {
                match Message::receive(received.channel, received.payload) {
                    Some(Ok(Message::CmDataState(state))) if state.module == "driver_rs485a" => {
                        states.push(state.state);
                    }
                    Some(Ok(Message::CmEventError(error))) if error.number == Fault::PortDown as i32 => {
                        errors.push((error.severity, error.message));
                    }
                    _ => {}
                }
            }
        }
    };
    // Long enough for dozens of attempts.
    listen(2.5, State::Run, &mut states, &mut errors);
    assert_eq!(states.last(), Some(&(State::Error as i8)), "{states:?}");
    let device = run_dir.join("rs485-a");
    let missing = format!("rs485.a is down: {}: No such file or directory; retrying", device.display());
    assert_eq!(errors, [(Severity::Error as i8, missing)]);

    let mut simulator = run("simulator");
    listen(5.0, State::Run, &mut states, &mut errors);
    assert_eq!(states.last(), Some(&(State::Run as i8)), "it recovers by itself: {states:?}");
    assert_eq!(errors[1..], [(Severity::Notice as i8, "rs485.a is up".to_string())]);
    for child in [&mut driver, &mut simulator] {
        support::signal(child.id() as i32, "TERM");
        child.wait().unwrap();
    }
    std::fs::remove_dir_all(&run_dir).unwrap();
}

#[test]
fn an_unknown_key_is_refused_with_its_line_and_nothing_starts() {
    let folder = std::env::temp_dir().join(format!("advee-unknown-key-{}", std::process::id()));
    let (conf, run_dir) = (folder.join("conf"), folder.join("run"));
    std::fs::create_dir_all(&conf).unwrap();
    for name in ["robot.toml", "modules.toml", "sim.toml"] {
        std::fs::copy(shipped().join(name), conf.join(name)).unwrap();
    }
    let robot = std::fs::read_to_string(conf.join("robot.toml")).unwrap();
    let line = 1 + robot.lines().position(|line| line.starts_with("track_m")).unwrap();
    std::fs::write(conf.join("robot.toml"), robot.replacen("track_m = 0.50", "trakc_m = 0.50", 1)).unwrap();
    let url = format!("udpm://239.255.76.67:{}?ttl=0", 18_000 + std::process::id() % 900);
    let mut bus = support::listen(&url);
    let mut up = support::advee(&url, &run_dir);
    let up = up.args(["up", "--sim", "--headless", "--config"]).arg(&conf).output().unwrap();

    assert_eq!(up.status.code(), Some(i32::from(module::exit::RESOURCE)));
    let said = String::from_utf8(up.stderr).unwrap();
    let file = conf.join("robot.toml");
    let unknown =
        format!("{}:{line}: geometry.trakc_m: unknown key, expected one of wheelbase_m, track_m, ", file.display());
    // The right key, now missing, is reported, too.
    assert!(said.lines().any(|line| line.starts_with(&unknown)), "{said}");
    assert!(said.starts_with("advee: the configuration is refused:\n") && said.lines().count() == 3, "{said}");
    assert!(!run_dir.exists(), "no run folder");
    bus.wait(std::time::Duration::from_millis(300)).unwrap();
    assert!(bus.recv().unwrap().is_none(), "nobody speaks");
    std::fs::remove_dir_all(&folder).unwrap();
}

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee")
}

fn place() -> RobotLocation {
    RobotLocation {
        config: shipped(),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: ["guard.ranging=none", "guard.speed_blind_mps=2.0"].map(String::from).into(),
        sim: true,
        world: None,
    }
}

fn at(seconds: f64) -> Instant {
    Instant::ZERO + Duration::from_secs_f64(seconds)
}

/// State kept by an observer of the virtual robot.
#[derive(Default)]
struct Seen {
    reports: Vec<(String, Report)>,
    bus: lowlevel::DataBus,
    odo: u32,
    speed: f64,
    reason: String,
}

/// Robot in virtual time.
struct InVirtualTime {
    machine: Virtual,
    seen: Rc<RefCell<Seen>>,
}

impl InVirtualTime {
    fn on(mut machine: Virtual) -> Self {
        let seen = Rc::new(RefCell::new(Seen::default()));
        let keep = seen.clone();
        machine.observe(move |_, news| {
            let mut seen = keep.borrow_mut();
            match news {
                News::Report { module, report } => seen.reports.push(((*module).into(), (*report).clone())),
                News::Message { message: Message::LlDataBus(bus), .. } if bus.bus == "rs485.a" => {
                    seen.bus = bus.clone();
                }
                News::Message { message: Message::LlDataOdo(_), .. } => seen.odo += 1,
                News::Message { message: Message::SimDataTruth(truth), .. } => seen.speed = truth.speed,
                News::Message { message: Message::LlDataMotion(motion), .. } => seen.reason = motion.reason.clone(),
                _ => {}
            }
        });
        Self { machine, seen }
    }

    /// All modules run, the steering is homed, and it drives in a circle at 0.4 m/s for `seconds`.
    fn driving(seconds: f64) -> Self {
        let mut robot = Self::on(virtual_machine(&place(), Config::default()).expect("the shipped configuration"));
        robot.machine.spawn("watchdog", State::Run).expect("the watchdog starts");
        robot.machine.run_until(at(12.0));
        for n in 0..(seconds * 20.0) as u32 {
            let priority = lowlevel::CmdMotion::REMOTE;
            let command =
                lowlevel::CmdMotion { timestamp: 0, speed: 0.4, steering: 0.3, priority, source: "test".into() };
            robot.machine.inject(at(12.0) + n * Duration::from_millis(50), command);
        }
        robot.machine.run_until(at(14.0));
        robot.seen.borrow_mut().reports.clear();
        robot
    }

    fn fault(&mut self, target: &str, fault: &str, duration: f64) {
        let (target, fault) = (target.into(), fault.into());
        let now = self.machine.now();
        self.machine.inject(now, simulation::CmdFault { timestamp: 0, target, fault, value: 0.0, duration });
    }

    fn pass(&mut self, seconds: f64) {
        self.machine.run_until(self.machine.now() + Duration::from_secs_f64(seconds));
    }

    #[track_caller]
    fn drives_on(&self) {
        let seen = self.seen.borrow();
        assert!((seen.speed - 0.4).abs() < 0.02, "{} m/s: {}", seen.speed, seen.reason);
    }

    /// It stands, for a cause that the driver names.
    #[track_caller]
    fn stands(&self, reason: &str) {
        let seen = self.seen.borrow();
        assert!(seen.speed.abs() < 0.02, "{} m/s: {}", seen.speed, seen.reason);
        assert_eq!(seen.reason, reason);
    }

    /// Takes the reports since the last call: severity, fault, line.
    fn reports(&self) -> Vec<(Severity, Fault, String)> {
        let reports = std::mem::take(&mut self.seen.borrow_mut().reports);
        reports.into_iter().map(|(_, report)| (report.severity, report.fault, report.message)).collect()
    }

    fn node(&self, name: &str) -> lowlevel::Node {
        self.seen.borrow().bus.nodes.iter().find(|node| node.name == name).expect("it is configured").clone()
    }
}

#[test]
fn an_occasional_bad_crc_is_counted_and_retried() {
    let mut robot = InVirtualTime::driving(20.0);
    let before = robot.node("so1").crc_errors;
    for _ in 0..5 {
        robot.fault("so1", "bad_crc", 0.05);
        robot.pass(1.0);
    }
    let node = robot.node("so1");
    assert!((5..=20).contains(&(node.crc_errors - before)), "{node:?}");
    assert_eq!((node.timeouts, node.state), (0, lowlevel::Node::OK));
    assert_eq!(robot.reports(), []);
    robot.drives_on();
}

#[test]
fn a_board_with_bad_crcs_is_reported_as_degraded_and_as_lost_and_the_robot_stands() {
    let mut robot = InVirtualTime::driving(60.0);
    let odo = robot.seen.borrow().odo;
    robot.fault("sd1_front", "bad_crc", 0.0);
    robot.pass(30.0);
    let degraded = "sd1_front (0x10 on rs485.a) fails repeatedly: it answers with a wrong CRC; polled on";
    let lost = "sd1_front (0x10 on rs485.a) answers with a wrong CRC: its data is invalid, polled once a second";
    let blind = "the robot is stopped: ranging board sd1_front does not answer";
    let expected = [
        (Severity::Error, Fault::RangingLost, blind.to_string()),
        (Severity::Warning, Fault::BoardDegraded, degraded.to_string()),
        (Severity::Error, Fault::BoardLost, lost.to_string()),
    ];
    assert_eq!(robot.reports(), expected);
    let node = robot.node("sd1_front");
    // 16 transactions of 3 attempts, then one per second.
    assert!((16 * 3 + 20..16 * 3 + 30).contains(&node.crc_errors), "{node:?}");
    assert_eq!((node.timeouts, node.state), (0, lowlevel::Node::LOST));
    let heard = robot.seen.borrow().odo - odo;
    assert!(heard >= 590, "{heard} of 600: the other boards are asked as before");
    robot.stands("ranging board sd1_front does not answer");

    robot.fault("sd1_front", "none", 0.0);
    robot.pass(3.0);
    let back = [
        (Severity::Notice, Fault::BoardDegraded, "sd1_front (0x10 on rs485.a) answers properly again".to_string()),
        (Severity::Notice, Fault::BoardLost, "sd1_front (0x10 on rs485.a) answers again".to_string()),
    ];
    let (of_the_stop, of_the_board): (Vec<_>, Vec<_>) =
        robot.reports().into_iter().partition(|(_, fault, _)| *fault == Fault::RangingLost);
    assert_eq!(of_the_board, back);
    assert!(matches!(of_the_stop[..], [(Severity::Notice, ..)]), "{of_the_stop:?}");
    // Nothing resumes by itself: the command goes on, and was never zero.
    robot.stands("test must send zero first: the robot was stopped");
}

#[test]
fn an_unknown_instruction_is_reported_once_and_counted_and_the_robot_stands() {
    let mut robot = InVirtualTime::driving(40.0);
    robot.fault("sd1_rear", "refuses", 25.0);
    robot.pass(20.0);
    let refused = "sd1_rear (0x11 on rs485.a) does not know instruction 0x10; polled on, its data is missing";
    let blind = "the robot is stopped: ranging board sd1_rear does not answer";
    let expected = [
        (Severity::Warning, Fault::BoardRefused, refused.to_string()),
        (Severity::Error, Fault::RangingLost, blind.to_string()),
    ];
    assert_eq!(robot.reports(), expected);
    assert_eq!(robot.node("sd1_rear").state, lowlevel::Node::OK, "it answers");
    robot.stands("ranging board sd1_rear does not answer");
    robot.pass(7.0);
    let reports = robot.reports();
    let again = "sd1_rear (0x11 on rs485.a) executes its instructions again, after ";
    assert!(
        reports.iter().any(|(_, fault, why)| *fault == Fault::BoardRefused && why.starts_with(again)),
        "{reports:?}"
    );
    assert!(reports.iter().all(|(severity, ..)| *severity == Severity::Notice), "{reports:?}");
    robot.stands("test must send zero first: the robot was stopped");
}

/// EPOS that refuses to have its quick stop deceleration written.
struct Stubborn {
    ports: [PortSpec; 1],
    node: Node,
    refused: Rc<RefCell<u32>>,
}

/// 0x6085, quick stop deceleration.
const QUICK_STOP_DECELERATION: [u8; 2] = [0x85, 0x60];
/// CiA 301: "Data cannot be transferred or stored to the application because of the present device state".
const DEVICE_STATE: u32 = 0x0800_0022;

impl Module for Stubborn {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.node.power_on(now);
                out.working();
            }
            Event::Port { input: Input::Can { frame, .. }, .. } => match (frame.id(), frame.data()) {
                // Initiate download, expedited.
                (Id::Standard(0x601), &[0x20..=0x2F, low, high, sub, ..]) if [low, high] == QUICK_STOP_DECELERATION => {
                    *self.refused.borrow_mut() += 1;
                    let mut abort = vec![0x80, low, high, sub];
                    abort.extend(DEVICE_STATE.to_le_bytes());
                    out.send_can(PortId(0), Frame::standard(0x581, &abort));
                }
                _ => self.node.handle_rx(now, &frame),
            },
            _ => {}
        }
        self.node.handle_timeout(now);
        while self.node.poll_event().is_some() {}
        while let Some(frame) = self.node.poll_tx() {
            out.send_can(PortId(0), frame);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.node.poll_timeout()
    }
}

#[test]
fn an_sdo_abort_at_boot_is_reported_once_with_object_and_reason_and_retried() {
    let refused = Rc::new(RefCell::new(0));
    let count = refused.clone();
    let machine = Virtual::new(Config::default(), move |name, wanted| match name {
        "epos" => {
            let ports = [PortSpec { bus: "can.main".into(), line: Line::Can { bitrate: 500_000 } }];
            let node = Node::new(drives::epos::dictionary(1), Duration::from_millis(100));
            Ok(Shell::new(ShellConfig::new(name), Box::new(Stubborn { ports, node, refused: count.clone() })))
        }
        _ => topology::module(&place(), name, wanted).map(|(shell, _)| shell).map_err(|error| error.to_string()),
    });
    let mut robot = InVirtualTime::on(machine);
    robot.machine.spawn("epos", State::Run).unwrap();
    robot.machine.spawn("driver_canbus", State::Run).unwrap();
    robot.pass(60.0);
    let attempts = *refused.borrow();
    assert!(attempts >= 30, "{attempts} attempts in a minute");
    let mut reports = robot.reports();
    // The other drive is absent.
    reports.retain(|(_, _, line)| !line.starts_with("steering"));
    let line = "propulsion drive (node 1) cannot be booted: configuration: 0x6085:0 refused: data cannot be transferred in the present \
                device state (0x08000022); retried each second";
    assert_eq!(reports, [(Severity::Error, Fault::DriveBootFailed, line.to_string())]);
}
