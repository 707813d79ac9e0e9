//! `advee can …` as used from the shell: with simulated nodes on a UDP bus, and on the bus of the running simulated
//! robot.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::command::{Outcome, values};
use crate::support::{Robot, advee, can_port, workspace};
use base::can::{Frame, Id};
use base::{Duration, Instant};
use canopen::dictionary::{Access, DataType, Entry};
use canopen::drives::{epos, icla};
use canopen::eds::Eds;
use canopen::lss::BitRate;
use canopen::{Dictionary, NmtState, Node};
use host::clock;
use host::ports::{Port, PortConfig, Received};
use module::{Input, Output as ToPort};
use motorctl::{odrive, vesc};
use serde_json::Value;
use std::net::SocketAddrV4;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep, spawn};

/// Large object for uploads and downloads.
const STORE: Entry = Entry::new(0x2F00, 0, DataType::Domain, Access::ReadWrite, 0);
/// Object of unknown type.
const SECRET: Entry = Entry::new(0x2F01, 0, DataType::U16, Access::ReadWrite, 0);

/// Drive at standstill.
const STATUSWORD: Entry = Entry::new(0x6041, 0, DataType::U16, Access::ReadOnly, 0x0140).mappable();

fn drive() -> Dictionary {
    let mut dictionary = epos::dictionary(5).with(&[STORE, SECRET, STATUSWORD]);
    dictionary.set(0x1017, 0, 50);
    dictionary.store();
    dictionary
}

fn nodes() -> Vec<Node> {
    let ms = Duration::from_millis(20);
    let lss = Node::new(icla::dictionary(3), ms).with_lss(None, BitRate::Kbit500, &BitRate::ALL);
    vec![Node::new(drive(), ms), Node::new(icla::dictionary(9), ms), lss]
}

/// A controller that is no node of CANopen.
enum Controller {
    Odrive(Box<odrive::device::Device>),
    /// With its id where it sends its status.
    Vesc(Box<vesc::device::Device<vesc::can::Link>>, Option<u8>),
}

impl Controller {
    fn odrive(node: u8) -> Self {
        Self::Odrive(Box::new(odrive::device::Device::new(odrive::Device { node, ..odrive::Device::EXAMPLE })))
    }

    fn vesc(id: u8, sends_status: bool) -> Self {
        let device = vesc::Device { id, ..vesc::Device::EXAMPLE };
        Self::Vesc(Box::new(vesc::device::Device::new(device, vesc::can::Link::device(id))), sends_status.then_some(id))
    }

    fn serve(&mut self, now: Instant, received: &[Frame], sends_status: bool) -> Vec<Frame> {
        match self {
            Self::Odrive(device) => {
                received.iter().for_each(|frame| device.handle_rx(now, frame));
                device.handle_timeout(now);
                std::iter::from_fn(|| device.poll_tx()).collect()
            }
            Self::Vesc(device, status) => {
                received.iter().for_each(|frame| device.handle_rx(now, frame));
                device.handle_timeout(now);
                let status = status.filter(|_| sends_status);
                // CAN_PACKET_STATUS.
                let status = status.and_then(|id| Frame::new(Id::Extended(9 << 8 | u32::from(id)), &[0; 8]));
                std::iter::from_fn(|| device.poll_tx()).chain(status).collect()
            }
        }
    }
}

/// Nodes on a UDP bus, until dropped: an EPOS as node 5, an IclA as node 9, which has no heartbeat, and one without id.
struct Bus {
    port: u16,
    folder: PathBuf,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Bus {
    fn new() -> Self {
        Self::of(nodes)
    }

    fn of(nodes: fn() -> Vec<Node>) -> Self {
        Self::with(nodes, Vec::new)
    }

    fn with(nodes: fn() -> Vec<Node>, controllers: fn() -> Vec<Controller>) -> Self {
        let port = can_port();
        let folder = std::env::temp_dir().join(format!("advee-can-{}-{port}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (stop, ready) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (stopped, open) = (stop.clone(), ready.clone());
        let thread = spawn(move || {
            let bus = SocketAddrV4::new([239, 74, 163, 2].into(), port);
            let mut port = Port::new("bus".into(), PortConfig::CanUdp { bus });
            port.device.open().unwrap();
            let mut nodes = nodes();
            nodes.iter_mut().for_each(|node| node.power_on(clock::now()));
            let (mut controllers, mut status_at) = (controllers(), clock::now());
            while !stopped.load(Ordering::Relaxed) {
                let received = serve(&mut port, &mut nodes);
                let now = clock::now();
                let sends_status = now >= status_at;
                if sends_status {
                    status_at = now + Duration::from_millis(20);
                }
                for controller in &mut controllers {
                    for frame in controller.serve(now, &received, sends_status) {
                        let _ = port.device.send(now, &ToPort::Can(frame));
                    }
                }
                let booted = |node: &Node| node.nmt_state() == Some(NmtState::PreOperational);
                open.fetch_or(nodes.iter().take(2).all(booted), Ordering::Relaxed);
                sleep(std::time::Duration::from_micros(100));
            }
        });
        while !ready.load(Ordering::Relaxed) && !thread.is_finished() {
            sleep(std::time::Duration::from_millis(1));
        }
        Self { port, folder, stop, thread: Some(thread) }
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = advee("udpm://239.255.76.67:7667?ttl=0", &self.folder);
        command.arg("can").args(args).args(["--interface", &format!("udp:239.74.163.2:{}", self.port)]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn run(&self, args: &[&str]) -> Outcome {
        Outcome::of(self.command(args).output().expect("the executable is built"))
    }

    fn file(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Returns what was received.
fn serve(port: &mut Port, nodes: &mut [Node]) -> Vec<Frame> {
    let now: Instant = clock::now();
    let mut received = Vec::new();
    while let Ok(Received::Input { input: Input::Can { frame, .. }, .. }) = port.device.receive(now) {
        nodes.iter_mut().for_each(|node| node.handle_rx(now, &frame));
        received.push(frame);
    }
    for node in nodes {
        node.handle_timeout(now);
        while node.poll_event().is_some() {}
        while let Some(frame) = node.poll_tx() {
            let _ = port.device.send(now, &ToPort::Can(frame));
        }
    }
    received
}

#[test]
fn identify_finds_odrives_and_vescs() {
    let has = |told: &str, lines: &str| assert!(told.contains(lines), "{lines}\n\n{told}");
    let bus = Bus::with(Vec::new, || vec![Controller::odrive(1), Controller::vesc(2, false)]);
    let folder = Path::new(&bus.folder).join("none");
    let config = ["--config", folder.to_str().unwrap()];
    let told = bus.run(&[&["identify"], &config[..]].concat()).good();
    has(&told, "# 2 nodes answer on udp:239.74.163.2:");
    has(&told, "# ODrive 1: hardware 4.4.58, firmware 0.6.10\n[[can.main.nodes]]\nid = 1\naxis = \"left\" ");
    has(&told, "driver = \"odrive\"\ngear = 1                       # ? turns of the motor per turn of the wheel");
    has(&told, "hardware = \"4.4.58\"\nfirmware = \"0.6.10\"\n# Two keys are missing");
    has(&told, ", firmware 6.5\n[[can.main.nodes]]\nid = 2\naxis = \"right\" ");
    has(&told, "driver = \"vesc\"\ngear = 1 ");
    has(&told, "pole_pairs = 7 ");

    // Beside nodes of CANopen: those that send cyclically.
    let bus =
        Bus::with(nodes, || vec![Controller::odrive(10), Controller::vesc(20, true), Controller::vesc(21, false)]);
    let told = bus.run(&["identify"]).good();
    has(&told, "# 4 nodes answer on ");
    has(&told, "# ODrive 10: hardware 4.4.58, firmware 0.6.10\n# The robot has no further wheel.");
    has(&told, "# VESC 20: ");
    assert!(!told.contains("VESC 21"), "{told}");

    let bus = Bus::with(Vec::new, Vec::new);
    let nobody = bus.run(&["identify", "--from", "20", "--to", "22", "--timeout", "20"]).bad();
    has(&nobody, "nobody answers");
}

#[test]
fn scan_finds_and_identifies_the_nodes_on_the_bus() {
    let bus = Bus::new();
    let begin = std::time::Instant::now();
    let told = bus.run(&["scan"]).good();
    let took = begin.elapsed();
    assert!(took < std::time::Duration::from_secs(5), "{took:?}");
    let lines: Vec<Vec<&str>> = told.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines[1][..7], ["5", "pre-operational", "CiA", "402", "000000FB", "64100000", "20330000"], "{told}");
    assert_eq!(lines[2][..7], ["9", "-", "CiA", "402", "0200005A", "4E303635", "00010002"], "{told}");
    assert!(told.lines().nth(1).unwrap().ends_with("EPOS"), "{told}");
    assert_eq!(told.lines().nth(3), Some(format!("2 nodes on udp:239.74.163.2:{}", bus.port).as_str()));
    let json = bus.run(&["scan", "--from", "5", "--to", "5", "--json"]).values();
    assert_eq!(json.len(), 1);
    assert_eq!((&json[0]["vendor"], &json[0]["device_name"]), (&0xFB.into(), &"EPOS".into()));
    let nobody = bus.run(&["scan", "--from", "20", "--to", "22", "--timeout", "20"]).bad();
    assert!(nobody.contains("nobody answers"), "{nobody}");
}

const COURIER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../conf/courier");

/// A drive of the courier, and one that says of itself what would be lines of the file.
fn wheels() -> Vec<Node> {
    let sheet = std::fs::read(format!("{COURIER}/wheel.eds")).unwrap();
    let sheet = Eds::parse(&sheet).unwrap();
    let ms = Duration::from_millis(20);
    let mut second = sheet.dictionary(4);
    second.set_bytes(0x1008, 0, b"wheel\n[limits]\nspeed_mps = 9");
    vec![Node::new(sheet.dictionary(2), ms), Node::new(second, ms)]
}

#[test]
fn identify_writes_the_configuration_of_the_drives_on_the_bus() {
    let bus = Bus::new();
    let told = bus.run(&["identify"]).good();
    let has = |told: &str, lines: &str| assert!(told.contains(lines), "{lines}\n\n{told}");
    has(
        &told,
        "# Node 5: EPOS, CiA 402, vendor 0x000000FB, product 0x64100000, revision 0x20330000, serial 0x00000001",
    );
    has(&told, "[[can.main.nodes]]\nid = 5\naxis = \"propulsion\"            # ? turn it by hand");
    has(&told, "driver = \"epos\"\ngear = 1                       # ? turns of the motor per turn of the wheel");
    has(&told, "id = 9\naxis = \"steering\"");
    has(&told, "driver = \"icla\"");

    let bus = Bus::of(wheels);
    let folder = Path::new(&bus.folder).join("conf");
    std::fs::create_dir_all(&folder).unwrap();
    let config = ["--config", folder.to_str().unwrap()];
    let told = bus.run(&[&["identify"], &config[..]].concat()).good();
    has(&told, "# No data sheet with this vendor and product: give the maker's EDS by --eds.");
    assert!(!told.contains("[[can.main.nodes]]"), "{told}");
    let sheet = format!("{COURIER}/wheel.eds");
    let told = bus.run(&[&["identify", "--eds", &sheet], &config[..]].concat()).good();
    has(&told, "eds = \"wheel.eds\"              # copy it beside robot.toml: ");

    // A robot without drives becomes one by these lines alone.
    let courier = std::fs::read_to_string(format!("{COURIER}/robot.toml")).unwrap();
    let (before, drives) = courier.split_once("[can.main]").unwrap();
    let (_, after) = drives.split_once("[rs485.b]").unwrap();
    for name in ["modules.toml", "wheel.eds"] {
        std::fs::copy(format!("{COURIER}/{name}"), folder.join(name)).unwrap();
    }
    let told = bus.run(&[&["identify"], &config[..]].concat()).good();
    std::fs::write(folder.join("robot.toml"), format!("{before}{told}\n[rs485.b]{after}")).unwrap();
    let check = |command: &mut Command| Outcome::of(command.output().unwrap());
    let mut command = advee("udpm://239.255.76.67:7667?ttl=0", &bus.folder);
    check(command.args(["config", "check"]).args(config)).good();
    let again = bus.run(&[&["identify"], &config[..]].concat()).good();
    has(&again, "id = 2\naxis = \"left\"\ndriver = \"cia402\"\neds = \"wheel.eds\"\n");
    has(&again, "id = 4\naxis = \"right\"\ndriver = \"cia402\"\neds = \"wheel.eds\"\n");
}

#[test]
fn objects_are_read_and_written_by_number_and_by_name() {
    let bus = Bus::new();
    let read = |args: &[&str]| bus.run(&[&["sdo", "read", "5"], args].concat());
    assert!(read(&["0x6041"]).good().starts_with("node 5: 0x6041 Statusword = 0x0140 switch on disabled ("));
    assert!(read(&["Manufacturer device name"]).good().contains("0x1008 Manufacturer device name = \"EPOS\""));
    assert!(read(&["0x1018:2"]).good().contains("0x1018:2 Product code = 0x64100000"));
    // An object that is only in the data sheet.
    assert!(read(&["0x2003:1"]).good().contains("0x2003:1 = 0x2033 (8243)"));
    let eds = workspace().join("buses/canopen/eds/epos_sim.eds").display().to_string();
    let told = read(&["version.software", "--eds", &eds, "--json"]).good();
    let json = &values(&told)[0];
    assert_eq!((&json["object"], &json["value"]), (&"Version.Software".into(), &8243.into()));
    assert!(read(&["Version.Software"]).bad().contains("no object \"Version.Software\""));
    assert!(read(&["0x5000"]).bad().contains("node 5: 0x5000: refused: object does not exist (0x06020000)"));
    assert!(read(&["0x6041", "--eds", "/no/such.eds"]).bad().contains("/no/such.eds: No such file"));
    assert!(bus.run(&["sdo", "read", "77", "0x1000", "--timeout", "50"]).bad().contains("no answer in time"));

    let write = |args: &[&str]| bus.run(&[&["sdo", "write", "5"], args].concat());
    // A number in any notation; of this object, the node takes two bytes.
    let refused = write(&["0x2F01", "-2.5e-7", "--type", "f32"]).bad();
    assert!(refused.contains("length too high"), "{refused}");
    assert!(write(&["Target velocity", "-1500"]).good().contains("0x60FF Target velocity = -1500, written ("));
    assert!(read(&["0x60FF"]).good().contains("= -1500 ("));
    assert!(write(&["0x607F", "30000"]).bad().contains("value too high (0x06090031)"));
    assert!(write(&["0x1000", "1"]).bad().contains("attempt to write a read-only object"));
    assert!(write(&["0x2F01", "7"]).bad().contains("its type is not known: say --type"));
    assert!(write(&["0x2F01", "7", "--type", "u16"]).good().contains("0x2F01 = 7, written"));
    assert!(write(&["0x2F01", "0x0102"]).good().contains("0x2F01 = 0x0102 (258), written"), "a number, not bytes");
    assert!(read(&["0x2F01", "--type", "u16"]).good().contains("= 258 ("));
}

#[test]
fn long_objects_go_through_files_in_segments_and_in_blocks() {
    let bus = Bus::new();
    let data: Vec<u8> = (0..4000_u32).map(|n| (n * n / 8) as u8).collect();
    for (how, name) in [(&[][..], "segments"), (&["--block"], "blocks")] {
        let (from, to) = (bus.file(name), bus.file("back"));
        let data: Vec<u8> = data.iter().map(|byte| byte ^ name.len() as u8).collect();
        std::fs::write(&from, &data).unwrap();
        let told = bus.run(&[&["sdo", "download", "5", "0x2F00", &from], how].concat()).good();
        assert!(told.contains(&format!("0x2F00: 4000 bytes written from {from}, ")), "{told}");
        let told = bus.run(&[&["sdo", "upload", "5", "0x2F00", &to], how].concat()).good();
        assert!(told.contains("4000 bytes read into ") && std::fs::read(&to).unwrap() == data, "{told}");
    }
    let name = bus.run(&["sdo", "upload", "9", "0x1008", "-"]).good();
    assert_eq!(name, "Position drive, simulated, with a long device name");
    let refused = bus.run(&["sdo", "download", "5", "0x6041", &bus.file("blocks"), "--block"]).bad();
    assert!(refused.contains("0x6041 Statusword: refused: "), "{refused}");
    assert!(bus.run(&["sdo", "download", "5", "0x2F00", "/no/file"]).bad().contains("/no/file: No such file"));
}

#[test]
fn a_command_to_nodes_succeeds_only_if_they_follow_it() {
    let bus = Bus::new();
    let nmt = |args: &[&str]| bus.run(&[&["nmt"], args].concat());
    assert_eq!(nmt(&["start", "5"]).good(), "node 5: operational\n");
    assert_eq!(nmt(&["stop", "5"]).good(), "node 5: stopped\n");
    assert_eq!(nmt(&["preop", "5"]).good(), "node 5: pre-operational\n");
    assert_eq!(nmt(&["reset-comm", "5"]).good(), "node 5: has booted\n");
    let all = nmt(&["reset", "all", "--json"]).good();
    let booted: Vec<Value> = values(&all).into_iter().map(|line| line["node"].clone()).collect();
    assert_eq!(booted, [5, 9], "{all}");
    let silent = nmt(&["start", "9"]).bad();
    assert!(silent.contains("node 9 was not heard within 2 s") && silent.contains("0x1017"), "{silent}");
}

#[test]
fn a_node_without_id_is_found_and_gets_one() {
    let bus = Bus::new();
    let lss = |args: &[&str]| bus.run(&[&["lss"], args].concat());
    const ADDRESS: &str = "0200005A:4E303635:00010002:00000002";
    let found = lss(&["scan"]).good();
    assert_eq!(found.lines().next(), Some(ADDRESS), "{found}");
    assert!(found.contains("1 node without node id on "), "{found}");
    assert_eq!(lss(&["find"]).good(), format!("{ADDRESS}\nno node id\n"));
    assert_eq!(lss(&["set-bitrate", "250", "--slave", ADDRESS]).good(), "bit rate 250 kbit/s is set\n");
    let told = lss(&["set-node-id", "12", "--first", "--store"]).good();
    assert_eq!(told, format!("{ADDRESS}\nnode id 12 is set\nstored\nnode 12 has booted\n"));
    assert_eq!(lss(&["inquire", "--slave", ADDRESS]).good(), format!("{ADDRESS}\nnode id 12\n"));
    assert!(lss(&["scan"]).good().starts_with("0 nodes without node id"));
    assert!(lss(&["set-node-id", "13", "--first"]).bad().contains("nobody answers"));
    // One that has an id gets the new one at its next reset, and boots with it.
    let told = lss(&["set-node-id", "13", "--slave", ADDRESS]).good();
    assert_eq!(told, "node id 13 is set\nin use when the node boots next: advee can nmt reset-comm 12\n");
    assert_eq!(bus.run(&["nmt", "reset-comm", "12"]).good(), "node 13: has booted; it was node 12 until now\n");
    let again = bus.run(&["nmt", "reset-comm", "12"]).bad();
    assert!(again.contains("node 12 was not heard"), "{again}");
    assert!(lss(&["store"]).bad().contains("--slave"));
    assert!(bus.run(&["sdo", "read", "13", "0x1018:4"]).good().contains("Serial number = 0x00000002"));
}

#[test]
fn monitor_decodes_what_crosses_the_bus() {
    let bus = Bus::new();
    let text = bus.command(&["monitor", "--for", "3"]).spawn().unwrap();
    let json = bus.command(&["monitor", "--for", "3", "--json", "--only", "sdo,nmt", "--node", "5"]).spawn().unwrap();
    sleep(std::time::Duration::from_millis(800));
    assert!(bus.run(&["sdo", "read", "5", "0x6041"]).good().contains("Statusword"));
    assert!(bus.run(&["sdo", "read", "9", "0x5000"]).bad().contains("does not exist"));
    assert_eq!(bus.run(&["nmt", "start", "5"]).good(), "node 5: operational\n");
    let told = Outcome::of(text.wait_with_output().unwrap()).good();
    for what in [
        "605    5         SDO →      read 0x6041 Statusword",
        "585    5         SDO ←      0x6041 Statusword = 0x0140 switch on disabled",
        "589    9         SDO ←      0x5000: aborted: object does not exist (0x06020000)",
        "000    5         NMT →      start",
        "705    5         heartbeat  operational, was pre-operational",
    ] {
        assert!(told.contains(what), "{what:?} is not in\n{told}");
    }
    let end = told.lines().last().unwrap();
    assert!(end.contains(" frames in 3.0 s, load ") && end.contains("sdo 4") && end.contains("nmt 1"), "{end}");
    assert!(!told.contains('\x1b'), "no colours but on a terminal");
    let json = Outcome::of(json.wait_with_output().unwrap()).values();
    let kinds: Vec<&str> = json.iter().map(|line| line["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["sdo", "sdo", "nmt"], "{json:?}");
    assert_eq!((&json[1]["says"]["object"], &json[1]["says"]["value"]), (&"Statusword".into(), &0x140.into()));
}

#[test]
fn an_invalid_command_line_is_one_clear_line() {
    let run = |args: &[&str]| {
        let mut command = advee("udpm://239.255.76.67:7667?ttl=0", &std::env::temp_dir().join("advee-can-none"));
        Outcome::of(command.arg("can").args(args).output().unwrap())
    };
    assert!(run(&["scan", "--bus", "z"]).bad().contains("robot.toml has no bus [can.z]; it has main"));
    assert!(run(&["scan", "--interface", "udp:1.2.3.4"]).bad().contains("expected can0"));
    assert!(run(&["scan", "--interface", "advee-none0"]).bad().contains("advee-none0: "));
    assert!(run(&["scan", "--interface", "slcan:/no/such/adapter"]).bad().contains("/no/such/adapter"));
    assert!(
        run(&["sdo", "read", "200", "0x1000"]).bad().contains("expected an id from 1 to 127, or one of propulsion")
    );
}

#[test]
fn a_bus_held_by_a_module_is_monitored_and_otherwise_left_to_the_module() {
    let mut robot = Robot::ready(&[]);
    let driver = robot.view.pid("driver_canbus");
    let can = |robot: &Robot, args: &[&str]| Outcome::of(robot.advee(&[&["can"], args].concat()));
    let told = can(&robot, &["monitor", "--for", "1.5"]).good();
    let head = format!("can.main, 500 kbit/s, held by driver_canbus, process {driver}: listening");
    assert_eq!(told.lines().next(), Some(head.as_str()));
    for (what, least) in [
        ("   1 propulsion  heartbeat  operational", 10),
        (" 127 master      heartbeat  operational", 10),
        ("   1 propulsion  SDO ←      0x606C Velocity actual = 0", 2),
    ] {
        let count = told.lines().filter(|line| line.contains(what)).count();
        assert!(count >= least, "{count} of {what:?} in\n{told}");
    }
    let through = |told: &str| told.contains(", through driver_canbus)");
    let told = can(&robot, &["sdo", "read", "propulsion", "Modes of operation display"]).good();
    assert!(told.contains("node 1 (propulsion): 0x6061 ") && told.contains("= 3 profile velocity (") && through(&told));
    let told = can(&robot, &["sdo", "upload", "steering", "0x1008", "-"]).good();
    assert_eq!(told, "Position drive, simulated, with a long device name");
    assert!(
        can(&robot, &["sdo", "read", "9", "0x1000"]).bad().contains("node 9: 0x1000 Device type: no answer in time")
    );
    assert!(can(&robot, &["sdo", "read", "1", "0x5555"]).bad().contains("object does not exist"));
    let refused = can(&robot, &["sdo", "write", "1", "Controlword", "0x000F"]).bad();
    assert!(refused.contains("driver_canbus holds can.main") && refused.contains("TERMINATE"), "{refused}");
    let told = can(&robot, &["scan", "--from", "1", "--to", "4"]).good();
    assert!(told.contains("   1  propulsion  operational") && told.contains("   2  steering    operational"), "{told}");
    assert!(told.contains("2 nodes on can.main, through driver_canbus"), "{told}");
    for command in [&["nmt", "stop", "all"][..], &["lss", "scan"]] {
        let refused = can(&robot, command).bad();
        assert!(refused.contains(&format!("can.main is held by driver_canbus, process {driver}: ")), "{refused}");
    }
    // The robot was not disturbed.
    robot.pass(0.3);
    assert!(robot.view.all_run() && robot.view.is_homed());
    // With the module stopped the bus is free, and the drives of the simulator answer.
    assert!(robot.advee(&["state", "driver_canbus", "TERMINATE"]).status.success());
    robot.until("the driver has ended", 5.0, |_| !Path::new(&format!("/proc/{driver}")).exists());
    let told = can(&robot, &["sdo", "read", "propulsion", "Statusword"]).good();
    assert!(told.contains("= 0x") && !through(&told), "{told}");
    assert_eq!(can(&robot, &["nmt", "reset", "propulsion"]).good(), "node 1 (propulsion): has booted\n");
    robot.stop();
}
