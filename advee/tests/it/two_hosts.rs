//! Whole robot on a host of its own: its network traffic verified on the wire, driven from a second host, and without
//! any network.

#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::hosts::{self, Host};
use crate::support::{self, Robot, View, python, workspace};
use base::Instant;
use base::can::Frame;
use host::ports::{Port, PortConfig, Received, can_udp_codec};
use module::Input;
use nix::sys::socket::{AddressFamily, SockFlag, SockType, SockaddrIn, bind, setsockopt, socket, sockopt};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 76, 67);
/// Group of the CAN bus in `sim.toml`.
const CAN_GROUP: Ipv4Addr = Ipv4Addr::new(239, 74, 163, 2);

/// Runs `body` with [`hosts::on_a_host`]; the robot there takes a share of this machine.
fn on_a_host(test: &str, body: impl FnOnce(Host)) {
    let _turn = support::turn();
    hosts::on_a_host(test, body);
}

/// Second host, at the other end of the cable in `eth7`; both have their default route through it.
fn cabled(here: &Host) -> Host {
    let there = Host::new();
    here.cable(("eth7", "10.1.2.1"), &there, ("eth8", "10.1.2.2"));
    here.ip("route add default dev eth7");
    there.ip("route add default dev eth8");
    // A newly plugged cable carries no traffic at first.
    assert_eq!(here.seen(&["eth7"], &there.tap(), GROUP), []);
    there
}

/// `second_host.py` on `host`, which commands `speed`.
struct Module {
    child: Child,
    lines: std::io::Lines<BufReader<std::process::ChildStdout>>,
    types: PathBuf,
}

impl Module {
    fn start(python: &Path, host: &Host, robot: &Robot, speed: f64) -> Self {
        let types = robot.run_dir.with_extension("types");
        support::python_types(python, &types);
        let mut command = Command::new(python);
        command
            .arg(workspace().join("advee/tests/it/peers/second_host.py"))
            .args([&speed.to_string(), "60"])
            .env("LCM_DEFAULT_URL", &robot.url)
            .env("PYTHONPATH", &types)
            .stdout(Stdio::piped());
        let mut child = host.run(|| command.spawn()).expect("python runs");
        let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        Self { child, lines, types }
    }

    /// Waits until it reports this.
    fn until(&mut self, what: &str) {
        let told = self.lines.next().expect("it goes on").expect("text");
        let told: Value = serde_json::from_str(&told).expect("JSON");
        assert_eq!(told["what"], what);
    }
}

impl Drop for Module {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.types);
    }
}

#[test]
fn a_module_on_a_second_host_drives_the_robot_until_the_cable_is_pulled() {
    on_a_host("a_module_on_a_second_host_drives_the_robot_until_the_cable_is_pulled", |here| {
        let Some(python) = python() else { return };
        let there = cabled(&here);
        let mut robot = Robot::ready_on(1, &["--set", "bus.commands=network"]);
        let mut module = Module::start(&python, &there, &robot, 0.4);
        module.until("ready");
        module.until("moving");
        robot.until("the robot moves", 5.0, |view| view.speed() > 0.35);

        there.ip("link set eth8 down");
        // Its commands are valid for 250 ms; the message that shows the stop is sent at 20 Hz.
        let begun = robot.until("the quick stop begins", 1.0, |view| view.motion.as_ref().unwrap().quick_stop);
        println!("the quick stop began {} ms after the cable was pulled", begun.as_millis());
        robot.until("the robot stands", 1.0, |view| view.speed().abs() < 0.01);
        assert_eq!(robot.view.causes(), [messages::Hold::NobodyCommands]);
        module.until("silent");
        assert!(robot.view.all_run(), "the rest of the robot does not need that cable");

        // The module never stopped commanding motion: plugged in again it must send zero first, without a restart.
        there.ip("link set eth8 up");
        there.ip("route add default dev eth8");
        let not_released = |view: &View| view.causes() == [messages::Hold::NotReleased];
        robot.until("the module is heard again", 20.0, not_released);
        robot.pass(1.0);
        assert!(robot.view.speed().abs() < 0.01, "{}", robot.view.speed());
        robot.until("the robot moves", 20.0, |view| view.speed() > 0.35);
    });
}

#[test]
fn with_ttl_0_nothing_of_a_running_robot_leaves_its_host() {
    on_a_host("with_ttl_0_nothing_of_a_running_robot_leaves_its_host", |here| {
        let there = cabled(&here);
        let tap = there.tap();
        let mut robot = Robot::ready(&[]);
        robot.drive(0.4, 0.1, 1.5);
        assert!(robot.view.speed() > 0.35, "{}", robot.view.reason());
        assert!(robot.advee(&["doctor", "--sim"]).status.success());
        let far = here.all_seen("eth7", &tap);
        let ours: Vec<_> = far.iter().filter(|seen| [GROUP, CAN_GROUP].contains(&seen.to)).collect();
        assert!(ours.is_empty(), "{ours:?}");
    });
}

/// The next frame at a port, if one has arrived.
fn arrived(port: &mut Port) -> Option<Frame> {
    match port.device.receive(Instant::ZERO).expect("the port is open") {
        Received::Input { input: Input::Can { frame, .. }, .. } => Some(frame),
        Received::Nothing => None,
        _ => panic!("neither a frame nor nothing"),
    }
}

/// A socket on the bus without a filter.
fn control(bus: SocketAddrV4) -> UdpSocket {
    let ear = socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None).unwrap();
    setsockopt(&ear, sockopt::ReuseAddr, &true).unwrap();
    setsockopt(&ear, sockopt::ReusePort, &true).unwrap();
    bind(ear.as_raw_fd(), &SockaddrIn::from(bus)).unwrap();
    let ear = UdpSocket::from(ear);
    ear.join_multicast_v4(bus.ip(), &Ipv4Addr::UNSPECIFIED).unwrap();
    ear.set_read_timeout(Some(std::time::Duration::from_secs(10))).unwrap();
    ear
}

#[test]
fn frames_of_another_host_do_not_enter_the_can_bus() {
    const SHOTS: u16 = 16;
    on_a_host("frames_of_another_host_do_not_enter_the_can_bus", |here| {
        let there = cabled(&here);
        let bus = SocketAddrV4::new(CAN_GROUP, 24_000);
        let [mut ours, mut neighbour] = ["ours", "neighbour"].map(|name| {
            let mut port = Port::new(name.into(), PortConfig::CanUdp { bus });
            port.device.open().expect("the bus opens");
            port
        });
        let control = control(bus);
        let stranger = there.run(|| UdpSocket::bind("0.0.0.0:0")).unwrap();
        stranger.set_multicast_ttl_v4(1).unwrap();
        let mut datagram = Vec::new();
        for n in 0..SHOTS {
            // A set-point of the propulsion among them.
            can_udp_codec::encode(&Frame::standard(0x4F8 + n, &[0x0F, 0, 0xE9, 2, 0, 0]), 0.0, &mut datagram);
            stranger.send_to(&datagram, bus).unwrap();
        }
        for _ in 0..SHOTS {
            control.recv(&mut [0; 512]).expect("a socket without the filter receives them");
        }
        // What the control has received has been passed to all sockets.
        assert_eq!([arrived(&mut ours), arrived(&mut neighbour)], [None, None]);
        // Nor do they count as lost.
        let frame = Frame::standard(0x181, &[1]);
        assert_eq!(neighbour.device.send(Instant::ZERO, &module::Output::Can(frame)), Ok(true));
        control.recv(&mut [0; 512]).expect("a frame of this host enters");
        assert_eq!(arrived(&mut ours), Some(frame));
    });
}

#[test]
fn where_multicast_is_routed_to_the_loopback_a_can_bus_stays_whole_and_on_its_host() {
    on_a_host("where_multicast_is_routed_to_the_loopback_a_can_bus_stays_whole_and_on_its_host", |here| {
        let there = cabled(&here);
        here.ip("route add 224.0.0.0/4 dev lo");
        let bus = SocketAddrV4::new(CAN_GROUP, 24_001);
        let [mut ours, mut neighbour] = ["ours", "neighbour"].map(|name| {
            let mut port = Port::new(name.into(), PortConfig::CanUdp { bus });
            port.device.open().expect("the bus opens");
            port
        });
        let tap = there.tap();
        let frame = Frame::standard(0x181, &[1]);
        assert_eq!(neighbour.device.send(Instant::ZERO, &module::Output::Can(frame)), Ok(true));
        assert_eq!([arrived(&mut ours), arrived(&mut neighbour)], [Some(frame), None]);
        assert_eq!(here.seen(&["eth7"], &tap, CAN_GROUP), []);
    });
}

/// Result of `advee doctor` for the bus: level and cure of one check.
fn diagnosis(robot: &Robot, check: &str) -> (String, String) {
    let output = robot.advee(&["doctor", "--sim", "--json"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let found = report["checks"]["bus"].as_array().unwrap().iter().find(|found| found["check"] == check);
    let found = found.unwrap_or_else(|| panic!("no check {check} in {report}"));
    let text = |key: &str| found[key].as_str().unwrap().to_string();
    (text("level"), text("cure"))
}

#[test]
fn with_nothing_but_loopback_the_robot_works_and_doctor_lets_the_official_lcm_in() {
    on_a_host("with_nothing_but_loopback_the_robot_works_and_doctor_lets_the_official_lcm_in", |here| {
        here.ip("link set lo multicast off");
        let mut robot = Robot::ready(&[]);
        robot.drive(0.4, 0.0, 1.5);
        assert!(robot.view.speed() > 0.35, "{}", robot.view.reason());
        robot.until("the robot stands", 2.0, |view| view.speed().abs() < 0.01);

        let (level, cure) = diagnosis(&robot, "route");
        assert_eq!(level, "WARNING");
        let Some(python) = python() else { return };
        here.ip(cure.strip_prefix("sudo ip ").unwrap_or_else(|| panic!("{cure}")));
        assert_eq!(diagnosis(&robot, "route"), ("OK".into(), String::new()));
        let mut module = Module::start(&python, &here, &robot, 0.3);
        module.until("ready");
        module.until("moving");
        robot.until("the robot moves", 5.0, |view| view.speed() > 0.25);
    });
}

/// Program on the official LCM that joins and publishes one message per input line.
const OFFICIAL: &str = "
import lcm, os, sys
bus = lcm.LCM(os.environ['LCM_DEFAULT_URL'])
bus.subscribe('A', lambda channel, data: None)
for line in sys.stdin:
    bus.publish('A', line.encode())
    print('sent', flush=True)
";

#[test]
fn doctor_tells_when_the_official_lcm_leaks_after_a_change_of_the_route() {
    on_a_host("doctor_tells_when_the_official_lcm_leaks_after_a_change_of_the_route", |here| {
        let Some(python) = python() else { return };
        let there = cabled(&here);
        here.cable(("eth9", "10.1.3.1"), &there, ("eth10", "10.1.3.2"));
        here.all_seen("eth9", &there.tap());
        let url = format!("udpm://{GROUP}:7667?ttl=0");
        let level = || {
            let doctor = support::advee(&url, Path::new("run")).args(["doctor", "--sim", "--json"]).output().unwrap();
            let report: Value = serde_json::from_slice(&doctor.stdout).unwrap();
            let found = report["checks"]["bus"].as_array().unwrap().iter().find(|it| it["check"] == "official LCM");
            found.unwrap()["level"].as_str().unwrap().to_string()
        };
        let mut command = Command::new(python);
        command.args(["-c", OFFICIAL]).env("LCM_DEFAULT_URL", &url).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut publish = |stdin: &mut std::process::ChildStdin| {
            stdin.write_all(b"x\n").unwrap();
            assert_eq!(lines.next().unwrap().unwrap(), "sent");
        };
        let mut stdin = child.stdin.take().unwrap();
        let tap = there.tap();
        let leaked = || here.seen(&["eth7", "eth9"], &tap, GROUP).len();

        publish(&mut stdin);
        assert_eq!(leaked(), 0);
        assert_eq!(level(), "OK");
        here.ip("route replace default dev eth9");
        publish(&mut stdin);
        assert_eq!(leaked(), 1, "the kernel looks at the TTL now: doctor need not warn");
        assert_eq!(level(), "WARNING");
        drop(stdin);
        assert!(child.wait().unwrap().success());
    });
}
