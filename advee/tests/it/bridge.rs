//! Two computers of a robot, each a network name space with a bus of its own, joined by a cable and the bridge: what
//! crosses, who is refused, and what happens when the cable is pulled, or delays and loses what it carries.

#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::hosts::{self, Host};
use crate::support::{self, Robot};
use base::Fault;
use lcm::live::Lcm;
use messages::common::DataBridge;
use messages::{Channel, Hold, Message, lowlevel};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

/// Bus of both computers: each has its own, since the name spaces differ.
const URL: &str = "udpm://239.255.76.67:7667?ttl=0&shm=auto";
/// Where the first computer listens.
const NEAR: &str = "10.1.2.1:7667";
/// Long enough for a loaded machine.
const PATIENCE: Duration = Duration::from_secs(20);

/// Folder of a test, with its keys; removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("advee-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    /// A new key, made by the command line.
    fn key(&self, name: &str) -> PathBuf {
        let path = self.0.join(name);
        let made = support::advee(URL, &self.0).args(["bridge", "key"]).arg(&path).output().unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A process that ends with the test.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Settings of a connection called `link`.
fn sets(end: &str, key: &Path, send: &str, receive: &str) -> Vec<String> {
    let set = |text: String| ["--set".to_owned(), format!("bridge.link.{text}")];
    let lists = [format!("send={send}"), format!("receive={receive}"), format!("key_file={key:?}"), end.to_owned()];
    lists.into_iter().flat_map(set).collect()
}

fn listens() -> String {
    format!("listen={NEAR:?}")
}

fn connects(to: &str) -> String {
    format!("connect={to:?}")
}

/// The bridge alone on a computer.
fn bridge(host: &Host, folder: &Folder, name: &str, sets: &[String]) -> Process {
    let mut command = support::advee(URL, &folder.0.join(name));
    command.args(["run", "bridge"]).args(sets).stdin(Stdio::null());
    Process(host.run(|| command.spawn()).expect("the executable is built"))
}

/// Publishes this motion at 20 Hz on a computer's bus.
fn drives(host: &Host, folder: &Folder, speed: f64) -> Process {
    let json = format!(r#"{{"speed": {speed}, "priority": 1, "source": "far"}}"#);
    let mut command = support::advee(URL, &folder.0);
    command.args(["lcm", "pub", "LL_CMD_MOTION", &json, "--defaults", "--rate", "20", "--force"]);
    command.stdin(Stdio::null()).stdout(Stdio::null());
    Process(host.run(|| command.spawn()).expect("the executable is built"))
}

/// Bus of a computer, and what the test received there.
struct Bus {
    lcm: Lcm,
    seen: Vec<String>,
    state: Option<DataBridge>,
}

impl Bus {
    fn on(host: &Host) -> Self {
        Self::at(host, URL)
    }

    fn at(host: &Host, url: &str) -> Self {
        Self { lcm: host.run(|| support::listen(url)), seen: Vec::new(), state: None }
    }

    fn publish(&mut self, channel: &str, payload: &[u8]) {
        self.lcm.publish(channel, payload).unwrap();
    }

    fn receive(&mut self) {
        self.lcm.wait(Duration::from_millis(20)).unwrap();
        while let Some(received) = self.lcm.recv().unwrap() {
            if received.channel == Channel::CmDataBridge.name()
                && let Ok(Message::CmDataBridge(state)) = Message::decode(Channel::CmDataBridge, received.payload)
            {
                self.state = Some(state);
            }
            self.seen.push(received.channel.to_owned());
        }
    }

    fn count(&self, channel: &str) -> usize {
        self.seen.iter().filter(|seen| *seen == channel).count()
    }

    fn refused(&self) -> i64 {
        self.state.as_ref().map_or(0, |state| state.refused)
    }
}

/// Repeats an action until a condition is true.
#[track_caller]
fn until(what: &str, mut step: impl FnMut() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !step() {
        assert!(Instant::now() < end, "not within {} s: {what}", PATIENCE.as_secs());
    }
}

/// The other computer, at the end of a cable.
fn cabled(here: &Host) -> Host {
    let there = Host::new();
    here.cable(("eth7", "10.1.2.1"), &there, ("eth8", "10.1.2.2"));
    there
}

fn on_a_host(test: &str, body: impl FnOnce(Host)) {
    let _turn = support::turn();
    hosts::on_a_host(test, body);
}

fn encoded(message: impl Into<Message>) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.into().encode(&mut bytes).unwrap();
    bytes
}

#[test]
fn allowed_channels_cross_the_bridge_in_their_direction_and_no_others() {
    on_a_host("allowed_channels_cross_the_bridge_in_their_direction_and_no_others", |here| {
        let (there, folder) = (cabled(&here), Folder::new("bridge-allowed"));
        let key = folder.key("key");
        let near = sets(&listens(), &key, r#"["LL_DATA_MOTION"]"#, r#"["LL_CMD_HOMING", "HL_DATA_*"]"#);
        let far = r#"["LL_CMD_HOMING", "LL_CMD_POWER", "HL_DATA_FACES"]"#;
        let far = sets(&connects(NEAR), &key, far, r#"["LL_DATA_MOTION", "LL_DATA_ODO"]"#);
        let _ends = [bridge(&here, &folder, "near", &near), bridge(&there, &folder, "far", &far)];
        let (mut near, mut far) = (Bus::on(&here), Bus::on(&there));
        let homing = encoded(lowlevel::CmdHoming::default());
        let power = encoded(lowlevel::CmdPower::default());
        let motion = encoded(lowlevel::DataMotion::default());
        until("allowed channels cross, both ways", || {
            // Not sent, and not accepted.
            far.publish("HL_DATA_SECRET", b"secret");
            far.publish("LL_CMD_POWER", &power);
            far.publish("LL_CMD_HOMING", &homing);
            far.publish("HL_DATA_FACES", b"faces");
            // Not sent.
            near.publish("LL_DATA_ODO", &encoded(lowlevel::DataOdo::default()));
            near.publish("LL_DATA_MOTION", &motion);
            near.receive();
            far.receive();
            near.count("LL_CMD_HOMING") > 5 && near.count("HL_DATA_FACES") > 5 && far.count("LL_DATA_MOTION") > 5
        });
        assert_eq!([near.count("HL_DATA_SECRET"), near.count("LL_CMD_POWER"), far.count("LL_DATA_ODO")], [0; 3]);
        until("the state of the connection shows it", || {
            near.receive();
            near.state.as_ref().is_some_and(|state| state.connected && state.received > 5 && state.dropped > 0)
        });
        let state = near.state.as_ref().unwrap();
        // Both name spaces have the clock of this machine.
        assert!(state.clock_offset.abs() <= state.round_trip, "{state:?}");
    });
}

#[test]
fn a_computer_with_another_key_and_a_program_without_one_are_refused_by_the_bridge() {
    on_a_host("a_computer_with_another_key_and_a_program_without_one_are_refused_by_the_bridge", |here| {
        let (there, folder) = (cabled(&here), Folder::new("bridge-key"));
        let [key, other] = ["key", "other"].map(|name| folder.key(name));
        let list = r#"["HL_DATA_FACES"]"#;
        let _ends = [
            bridge(&here, &folder, "near", &sets(&listens(), &key, "[]", list)),
            bridge(&there, &folder, "far", &sets(&connects(NEAR), &other, list, "[]")),
        ];
        let (mut near, mut far) = (Bus::on(&here), Bus::on(&there));
        until("the other key is refused", || {
            far.publish("HL_DATA_FACES", b"faces");
            [&mut near, &mut far].into_iter().for_each(Bus::receive);
            far.refused() > 0
        });
        until("a program without a key is refused", || {
            if let Ok(mut stranger) = there.run(|| TcpStream::connect(NEAR)) {
                let _ = stranger.write_all(&[0x41; 256]);
            }
            near.receive();
            near.refused() > 0
        });
        assert_eq!(near.count("HL_DATA_FACES"), 0);
        assert!(near.state.as_ref().is_some_and(|state| !state.connected && state.received == 0));
    });
}

/// Passes a connection on to the bridge of the first computer, and records what the connector sends.
fn recorder(listener: TcpListener) -> Arc<Mutex<Vec<u8>>> {
    let record = Arc::new(Mutex::new(Vec::new()));
    let written = record.clone();
    thread::spawn(move || {
        let (mut connector, _) = listener.accept().unwrap();
        let mut bridge = TcpStream::connect(NEAR).unwrap();
        let (mut back_from, mut back_to) = (bridge.try_clone().unwrap(), connector.try_clone().unwrap());
        thread::spawn(move || std::io::copy(&mut back_from, &mut back_to));
        let mut bytes = [0; 4096];
        while let Ok(count @ 1..) = connector.read(&mut bytes) {
            written.lock().unwrap().extend_from_slice(&bytes[..count]);
            if bridge.write_all(&bytes[..count]).is_err() {
                break;
            }
        }
        let _ = bridge.shutdown(std::net::Shutdown::Both);
    });
    record
}

#[test]
fn a_recorded_session_is_refused_by_the_bridge_when_it_is_replayed() {
    on_a_host("a_recorded_session_is_refused_by_the_bridge_when_it_is_replayed", |here| {
        let (there, folder) = (cabled(&here), Folder::new("bridge-replay"));
        let key = folder.key("key");
        let list = r#"["HL_DATA_FACES"]"#;
        let _near = bridge(&here, &folder, "near", &sets(&listens(), &key, "[]", list));
        let (mut near, mut far) = (Bus::on(&here), Bus::on(&there));
        until("the bridge listens", || TcpStream::connect(NEAR).is_ok());
        let record = recorder(TcpListener::bind("10.1.2.1:7668").unwrap());
        let end = bridge(&there, &folder, "far", &sets(&connects("10.1.2.1:7668"), &key, list, "[]"));
        until("messages cross", || {
            far.publish("HL_DATA_FACES", b"faces");
            near.receive();
            near.count("HL_DATA_FACES") > 5
        });
        drop(end);
        until("the connection is lost", || {
            near.receive();
            near.state.as_ref().is_some_and(|state| !state.connected)
        });
        let (crossed, refused) = (near.count("HL_DATA_FACES"), near.refused());
        let record = record.lock().unwrap().clone();
        let mut replay = TcpStream::connect(NEAR).unwrap();
        // The bridge may close the connection before it has read all.
        let _ = replay.write_all(&record);
        until("the replay is refused", || {
            near.receive();
            near.refused() > refused
        });
        assert_eq!(near.count("HL_DATA_FACES"), crossed);
    });
}

#[test]
fn a_robot_that_a_source_beyond_the_bridge_drives_stands_when_the_cable_is_pulled_and_does_not_resume() {
    let test = "a_robot_that_a_source_beyond_the_bridge_drives_stands_when_the_cable_is_pulled_and_does_not_resume";
    on_a_host(test, |here| {
        let (there, folder) = (cabled(&here), Folder::new("bridge-cable"));
        let key = folder.key("key");
        let (motion, measured) = (r#"["LL_CMD_MOTION"]"#, r#"["LL_DATA_MOTION"]"#);
        let _far = bridge(&there, &folder, "far", &sets(&connects(NEAR), &key, motion, measured));
        let mut near = sets(&listens(), &key, measured, motion);
        near.extend(["--set".into(), "bridge.link.critical=true".into()]);
        let near: Vec<&str> = near.iter().map(String::as_str).collect();
        let mut robot = Robot::ready(&near);
        let mut source = drives(&there, &folder, 0.4);
        robot.until("the robot moves", 10.0, |view| view.speed() > 0.35);

        there.ip("link set eth8 down");
        let begun = robot.until("the quick stop begins", 1.0, |view| view.motion.as_ref().unwrap().quick_stop);
        println!("the quick stop began {} ms after the cable was pulled", begun.as_millis());
        robot.until("the robot stands", 1.0, |view| view.speed().abs() < 0.01);
        let is_down = |error: &messages::common::Error| error.number == Fault::BridgeDown as i32;
        let told = robot.until("the fault is reported", 2.0, |view| view.errors.iter().any(is_down));
        println!("the fault was reported {} ms after the robot stood", told.as_millis());
        robot.until("a critical module is missing", 2.0, |view| view.causes().contains(&Hold::CriticalModule));

        there.ip("link set eth8 up");
        robot.until("the bridge works again", 20.0, |view| view.causes() == [Hold::NotReleased]);
        robot.pass(1.0);
        assert!(robot.view.speed().abs() < 0.01, "{}", robot.view.speed());

        // A deliberate act releases the source: zero, then motion.
        drop(std::mem::replace(&mut source, drives(&there, &folder, 0.0)));
        let is_released = |view: &support::View| {
            let holds = view.motion.as_ref().is_some_and(|motion| motion.source == "far");
            holds && !view.causes().contains(&Hold::NotReleased)
        };
        robot.until("the source is released", 10.0, is_released);
        drop(std::mem::replace(&mut source, drives(&there, &folder, 0.4)));
        robot.until("the robot moves", 20.0, |view| view.speed() > 0.35);
        drop(source);
        robot.until("the robot stands", 2.0, |view| view.speed().abs() < 0.01);
    });
}

/// Quality of a cable, each way.
#[derive(Clone, Copy)]
struct Cable {
    delay_ms: u64,
    loss_percent: u32,
}

/// Half of this, as the uncertainty of a message's age, counts as age: 80 ms of the 250 ms that are permitted.
const SHORT: Cable = Cable { delay_ms: 40, loss_percent: 0 };
/// Later than permitted, and less than the 400 ms without a record after which a connection counts as lost.
const LONG: Cable = Cable { delay_ms: 300, loss_percent: 0 };
/// Every third packet is lost, and sent again.
const LOSSY: Cable = Cable { delay_ms: 40, loss_percent: 33 };
/// Minimum time after which TCP of Linux sends a lost packet again, ms.
const RETRANSMISSION_MS: u64 = 200;

/// Program on the cable that carries connections to the bridge of the first computer and delays every piece. What
/// follows a lost packet waits for it, as it does in TCP.
struct Relay {
    delay_ms: AtomicU64,
    loss_percent: AtomicU32,
}

impl Relay {
    fn on(listener: TcpListener) -> Arc<Self> {
        let relay = Arc::new(Self { delay_ms: AtomicU64::new(0), loss_percent: AtomicU32::new(0) });
        let accepting = relay.clone();
        thread::spawn(move || {
            for connector in listener.incoming() {
                let connector = connector.unwrap();
                // The bridge may not listen yet; the other one connects again.
                let Ok(bridge) = TcpStream::connect(NEAR) else { continue };
                for (from, to) in [(&connector, &bridge), (&bridge, &connector)] {
                    accepting.carry(from.try_clone().unwrap(), to.try_clone().unwrap());
                }
            }
        });
        relay
    }

    fn set(&self, cable: Cable) {
        self.delay_ms.store(cable.delay_ms, Ordering::Relaxed);
        self.loss_percent.store(cable.loss_percent, Ordering::Relaxed);
    }

    /// Carries one direction of a connection until one end closes it.
    fn carry(self: &Arc<Self>, mut from: TcpStream, mut to: TcpStream) {
        let _ = to.set_nodelay(true);
        let (pieces, queue) = mpsc::channel::<(Instant, Vec<u8>)>();
        let relay = self.clone();
        thread::spawn(move || {
            let (mut bytes, mut random) = ([0; 4096], testing::Random::new(7));
            while let Ok(count @ 1..) = from.read(&mut bytes) {
                let is_lost = random.below(100) < relay.loss_percent.load(Ordering::Relaxed).into();
                let again = if is_lost { RETRANSMISSION_MS } else { 0 };
                let due = Instant::now() + Duration::from_millis(relay.delay_ms.load(Ordering::Relaxed) + again);
                if pieces.send((due, bytes[..count].to_vec())).is_err() {
                    break;
                }
            }
            let _ = from.shutdown(std::net::Shutdown::Both);
        });
        thread::spawn(move || {
            for (due, piece) in queue {
                thread::sleep(due.saturating_duration_since(Instant::now()));
                if to.write_all(&piece).is_err() {
                    break;
                }
            }
            let _ = to.shutdown(std::net::Shutdown::Both);
        });
    }
}

/// Sets delay and loss of one end of a cable, in the kernel.
fn netem(host: &Host, interface: &str, cable: Cable) -> testing::Found<()> {
    let Cable { delay_ms, loss_percent } = cable;
    let arguments = format!("qdisc replace dev {interface} root netem delay {delay_ms}ms loss {loss_percent}%");
    let output = host.run(|| Command::new("tc").args(arguments.split(' ')).output());
    let output = output.map_err(|error| format!("tc: {error} (tools/require ip installs it)"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(format!("no netem in this kernel: {}", String::from_utf8_lossy(&output.stderr).trim())),
    }
}

/// A robot, driven by a source beyond a bridge that connects to the address `to`, on a cable that `set` changes.
fn drives_by_a_cable_that_delays(here: &Host, there: &Host, name: &str, to: &str, set: impl Fn(Cable)) {
    let folder = Folder::new(name);
    let key = folder.key("key");
    let (commands, measured) = (r#"["LL_CMD_MOTION", "LL_EVENT_STOP", "CM_CMD_STATE"]"#, r#"["LL_DATA_MOTION"]"#);
    set(SHORT);
    let _far = bridge(there, &folder, "far", &sets(&connects(to), &key, commands, measured));
    let near = sets(&listens(), &key, measured, commands);
    let near: Vec<&str> = near.iter().map(String::as_str).collect();
    let mut robot = Robot::ready(&near);
    let (mut near, mut far) = (Bus::at(here, &robot.url), Bus::on(there));
    let _source = drives(there, &folder, 0.4);
    robot.until("the robot moves", 10.0, |view| view.speed() > 0.35);
    for _ in 0..40 {
        robot.pass(0.05);
        let has_stopped = robot.view.motion.as_ref().unwrap().quick_stop || robot.view.speed() < 0.35;
        assert!(!has_stopped, "{} m/s: {}", robot.view.speed(), robot.view.reason());
    }

    until("the state of the connection arrives", || {
        near.receive();
        near.state.is_some()
    });
    let late = near.state.as_ref().unwrap().late;
    set(LONG);
    let begun = robot.until("the quick stop begins", 1.0, |view| view.motion.as_ref().unwrap().quick_stop);
    println!("the quick stop began {} ms after the delay", begun.as_millis());
    robot.until("the robot stands", 1.0, |view| view.speed().abs() < 0.01);
    until("late commands are counted, and the connection remains", || {
        near.receive();
        near.state.as_ref().is_some_and(|state| state.connected && state.late > late + 10)
    });
    robot.pass(0.5);
    assert!(robot.view.speed().abs() < 0.01, "{} m/s by late commands", robot.view.speed());

    set(SHORT);
    robot.until("commands arrive in time again", 10.0, |view| view.causes() == [Hold::NotReleased]);
    robot.pass(1.0);
    assert!(robot.view.speed().abs() < 0.01, "{} m/s: it resumed", robot.view.speed());

    // What stops the robot crosses however late it is.
    set(LONG);
    let engaged = encoded(lowlevel::EventStop { timestamp: 0, engaged: true, source: "mast".into() });
    far.publish("LL_EVENT_STOP", &engaged);
    robot.until("a late stop engages", 5.0, |view| view.causes().contains(&Hold::PauseOther));
    set(LOSSY);
    until("PAUSE is commanded by a cable that loses packets", || {
        let pause = module::State::Pause as i8;
        let command = messages::common::CmdState { module: "driver_canbus".into(), state: pause, ..Default::default() };
        far.publish("CM_CMD_STATE", &encoded(command));
        robot.pass(0.2);
        robot.view.causes().contains(&Hold::ModulePaused)
    });
    assert!(robot.view.speed().abs() < 0.01, "{}", robot.view.speed());
}

#[test]
fn a_delay_on_the_cable_beyond_the_age_that_is_permitted_stops_the_robot_and_stops_still_cross() {
    let test = "a_delay_on_the_cable_beyond_the_age_that_is_permitted_stops_the_robot_and_stops_still_cross";
    on_a_host(test, |here| {
        let (there, at) = (cabled(&here), "10.1.2.1:7668");
        let relay = Relay::on(TcpListener::bind(at).unwrap());
        support::undisturbed(|| {
            drives_by_a_cable_that_delays(&here, &there, "bridge-delay", at, |cable| relay.set(cable));
        });
    });
}

#[test]
fn a_delay_of_the_kernel_beyond_the_age_that_is_permitted_stops_the_robot_and_stops_still_cross() {
    let test = "a_delay_of_the_kernel_beyond_the_age_that_is_permitted_stops_the_robot_and_stops_still_cross";
    on_a_host(test, |here| {
        let there = cabled(&here);
        let ends = [(&here, "eth7"), (&there, "eth8")];
        let tried = ends.iter().try_for_each(|(host, interface)| netem(host, interface, SHORT));
        if testing::machine_or_skip(tried).is_none() {
            return;
        }
        support::undisturbed(|| {
            drives_by_a_cable_that_delays(&here, &there, "bridge-netem", NEAR, |cable| {
                for (host, interface) in ends {
                    netem(host, interface, cable).unwrap();
                }
            });
        });
    });
}
