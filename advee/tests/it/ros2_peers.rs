//! The robot among unmodified ROS 2 (rclpy on Fast DDS) and Eclipse Cyclone DDS, on the loopback interface and in a
//! domain of its own.

use crate::support::{self, Robot, View, workspace};
use messages::Hold;
use messages::middlelevel::DataEstimate;
use serde_json::Value as Json;
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use testing::Random;

/// Greatest time for all that a peer does: a busy machine starts Python in many seconds.
const PEER_TIMEOUT: Duration = Duration::from_secs(120);

fn python() -> Option<PathBuf> {
    let needed = ["rclpy", "nav_msgs", "sensor_msgs", "diagnostic_msgs", "rosgraph_msgs", "cyclonedds"];
    testing::peer_or_skip(testing::python(&needed))
}

/// A domain that no other test of this machine uses while the socket is open: at a port between those of its
/// participants and the next domain.
pub(crate) fn domain() -> (u32, UdpSocket) {
    let first = std::process::id();
    let free = (0..100).map(|n| 1 + (first + n) % 100).find_map(|domain| {
        let port = u16::try_from(7400 + 250 * domain + 249).expect("a port");
        Some((domain, UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).ok()?))
    });
    free.expect("some domain is free")
}

/// The courier as a node of ROS in a domain, ready to be driven.
pub(crate) fn courier(domain: u32, extra: &[&str]) -> Robot {
    courier_in("empty", domain, extra)
}

/// The same, in another world.
pub(crate) fn courier_in(world: &str, domain: u32, extra: &[&str]) -> Robot {
    let config = workspace().join("conf/courier").display().to_string();
    let set = format!("ros2.domain={domain}");
    let common = ["--config", &config, "--set", "ros2.enabled=true", "--set", &set, "--world", world];
    let mut robot = Robot::start(&[&common[..], extra].concat());
    robot.until("all modules RUN and nothing but a command is missing", 30.0, |view| {
        view.all_run() && view.runs("ros2") && view.is_free()
    });
    // Before its first sightings of beacons an estimate is anywhere.
    robot.until("the robot knows where it is", 30.0, |view| {
        let fine = |estimate: &DataEstimate| estimate.quality == DataEstimate::FINE;
        view.estimate.as_ref().is_some_and(fine)
    });
    robot
}

/// A peer's process, which ends with the test.
pub(crate) struct Peer(Child);

impl Peer {
    pub(crate) fn start(python: &Path, script: &str, args: &[&str]) -> Self {
        let mut command = Command::new(python);
        command.arg(workspace().join("advee/tests/it/peers").join(script)).args(args);
        Self::of(command)
    }

    /// An example, which gets the domain from the environment, as programs of ROS do.
    pub(crate) fn example(python: &Path, script: &str, domain: u32, args: &[&str]) -> Self {
        let mut command = Command::new(python);
        command.arg(workspace().join("examples/ros2").join(script)).args(args);
        command.env("ROS_DOMAIN_ID", domain.to_string()).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        Self::of(command)
    }

    fn of(mut command: Command) -> Self {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        Self(command.spawn().expect("python is there"))
    }

    /// Receives the robot's messages until the peer has ended; its line of JSON.
    #[track_caller]
    pub(crate) fn finish(self, robot: &mut Robot, each: impl FnMut(&mut Robot)) -> Json {
        let said = self.end(robot, each);
        let line = said.lines().find(|line| line.starts_with('{')).unwrap_or_default();
        serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {said}"))
    }

    /// Receives the robot's messages until the peer has ended with success; all that it wrote.
    #[track_caller]
    pub(crate) fn end(mut self, robot: &mut Robot, mut each: impl FnMut(&mut Robot)) -> String {
        let begin = Instant::now();
        let status = loop {
            if let Some(status) = self.0.try_wait().expect("it is our child") {
                break status;
            }
            robot.pass(0.05);
            each(robot);
            if begin.elapsed() > PEER_TIMEOUT {
                let _ = self.0.kill();
                panic!("the peer does not end: {}", self.said());
            }
        };
        let said = self.said();
        assert!(status.success(), "{status}: {said}");
        said
    }

    /// All that it wrote; it has ended.
    fn said(&mut self) -> String {
        let mut said = String::new();
        let _ = self.0.stdout.take().map(|mut out| out.read_to_string(&mut said));
        let _ = self.0.stderr.take().map(|mut err| err.read_to_string(&mut said));
        said
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub(crate) fn number(json: &Json) -> f64 {
    json.as_f64().unwrap_or(f64::NAN)
}

#[test]
fn ros_sees_the_robot_and_does_not_move_it_without_leave() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &[]);
        let start = robot.view.truth.clone().expect("it is simulated");
        let peer = Peer::start(&python, "ros2_rclpy.py", &["look", &domain.to_string()]);
        let mut fastest = 0.0_f64;
        let seen = peer.finish(&mut robot, |robot| fastest = fastest.max(robot.view.speed().abs()));
        assert_eq!(seen["frames"], serde_json::json!(["odom", "base_link", "lidar_top", "map"]), "{seen}");
        assert!((-0.1..1.0).contains(&number(&seen["age"])), "{seen}");
        assert!(number(&seen["beams"]) > 300.0 && number(&seen["measured"]) > 100.0, "{seen}");
        assert!((0.1..12.0).contains(&number(&seen["nearest"])), "{seen}");
        let [width, height, cells] = [0, 1, 2].map(|n| number(&seen["grid"][n]));
        assert!(width * height == cells && cells > 10_000.0, "{seen}");
        assert_eq!(seen["grid"][3], serde_json::json!([0, 100]), "{seen}");
        assert!(seen["nodes"].as_array().is_some_and(|nodes| nodes.iter().any(|node| node == "courier")), "{seen}");
        // Nobody listens to its commands, and nothing moves.
        assert_eq!(seen["listeners"], 0, "{seen}");
        assert!(number(&seen["moved"]) < 0.01 && fastest < 0.01, "{seen} {fastest}");
        let end = robot.view.truth.clone().expect("it is simulated");
        assert!((end.x - start.x).hypot(end.y - start.y) < 0.01);
        assert_eq!(robot.stop(), 0);
        assert!(robot.processes().is_empty(), "processes left over: {:?}", robot.processes());
    });
}

#[test]
fn ros_reads_the_types_of_the_package_that_is_made_from_the_messages() {
    let Some(_) = python() else { return };
    let Some(python) = testing::peer_or_skip(testing::python(&["rclpy", "advee_msgs"])) else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &[]);
        let seen = Peer::start(&python, "ros2_rclpy.py", &["own", &domain.to_string()]).finish(&mut robot, |_| ());
        let ages = seen["ages"].as_array().expect("a list");
        assert!(ages.iter().all(|age| (-0.1..5.0).contains(&number(age))), "{seen}");
        let modules: Vec<&String> = robot.view.processes.keys().collect();
        assert_eq!(seen["modules"], serde_json::json!(modules), "{seen}");
        assert_eq!(seen["count"], modules.len(), "{seen}");
        // Of the driver, or of the planner.
        let holds = [Hold::NobodyCommands, Hold::NoGoal].map(|hold| serde_json::json!([[hold.code(), false]]));
        assert!(holds.contains(&seen["holds"]), "{seen}");
        for what in ["planner_runs", "goal", "faults"] {
            assert_eq!(seen[what], true, "{what}: {seen}");
        }
        assert!((0.1..3.0).contains(&number(&seen["forward"])), "{seen}");
    });
}

#[test]
fn ros_drives_the_robot_and_its_silence_or_a_bad_value_stops_it() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true"]);
        let peer = Peer::start(&python, "ros2_rclpy.py", &["drive", &domain.to_string()]);
        let mut sources = Vec::new();
        let driven = peer.finish(&mut robot, |robot| {
            let motion = robot.view.motion.as_ref().filter(|motion| motion.speed.abs() > 0.05);
            sources.extend(motion.map(|motion| motion.source.clone()));
        });
        assert!((0.2..0.35).contains(&number(&driven["speed"])), "{driven}");
        // The time to live of 0.25 s, a quick stop of 0.2 s, and what a busy machine adds.
        assert!((0.3..2.0).contains(&number(&driven["stood_after"])), "{driven}");
        assert!(number(&driven["without_zero"]) < 0.02, "{driven}");
        assert!(number(&driven["stood_after_nan"]) < 1.5, "{driven}");
        sources.retain(|source| !source.is_empty());
        assert!(!sources.is_empty() && sources.iter().all(|source| source == "ros2"), "{sources:?}");
    });
}

#[test]
fn cyclone_reads_the_transforms_and_sends_the_robot_to_a_goal_in_the_map_only() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true"]);
        let start = robot.view.truth.clone().expect("it is simulated");
        let at = |ahead: f64| (start.x + ahead * start.theta.cos(), start.y + ahead * start.theta.sin());
        let goal = at(1.5);
        let args = [domain.to_string(), goal.0.to_string(), goal.1.to_string()];
        let args = [&*args[0], &args[1], &args[2]];
        let seen = Peer::start(&python, "ros2_cyclone.py", &args).finish(&mut robot, |_| ());
        let link = |name: &str| [0, 1, 2, 3].map(|n| number(&seen["links"][name][n]));
        let (map, odom) = (link("map/odom"), link("odom/base_link"));
        // The robot's place in the map by both, while it stood: where it really is.
        let turn = 2.0 * map[2].atan2(map[3]);
        let (x, y) = (
            map[0] + odom[0] * turn.cos() - odom[1] * turn.sin(),
            map[1] + odom[0] * turn.sin() + odom[1] * turn.cos(),
        );
        assert!((x - start.x).hypot(y - start.y) < 0.5, "{seen} {start:?}");
        assert!(number(&seen["links"]["base_link/lidar_top"][3]) > 0.9, "{seen}");
        // One goal is refused, since it is in another frame; the other one is driven to.
        let refused = "/goal_pose: a message is refused: its frame is \"odom\": expected \"map\"";
        robot.until("the goal in odom is refused", 10.0, |view| view.texts.iter().any(|text| text.text == refused));
        let near =
            |view: &View| view.truth.as_ref().is_some_and(|truth| (truth.x - goal.0).hypot(truth.y - goal.1) < 0.5);
        robot.until("the robot is at the goal", 60.0, near);
    });
}

/// Datagrams as an attacker sends them: participants that do not exist, cut off and altered ones, chance.
fn hostile(domain: u32, random: &mut Random) -> Vec<u8> {
    let mut prefix = [0; 12];
    prefix.copy_from_slice(&random.bytes(12));
    let own = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9);
    let mut other = rtps::Participant::new(rtps::Config {
        domain,
        prefix: rtps::Prefix(prefix),
        locators: vec![own],
        announce_to: vec![own],
        announce_period: Duration::from_secs(3),
        lease: Duration::from_secs(3600),
        name: "x".repeat(200),
        user_data: vec![0; 500],
        endpoint_data: |_| Vec::new(),
        limits: rtps::Limits::default(),
    });
    other.handle_timeout(base::Instant::from_millis(1));
    let mut datagram = other.poll_tx().expect("an announcement").datagram;
    match random.below(4) {
        0 => datagram.truncate(random.index(datagram.len())),
        1 => datagram = random.bytes(datagram.len()),
        2 => {
            let at = random.index(datagram.len());
            datagram[at] = random.edge_byte();
        }
        _ => {}
    }
    datagram
}

#[test]
fn a_flood_of_rtps_neither_stops_the_robot_nor_fills_its_memory() {
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true"]);
        robot.drive(0.3, 0.0, 1.5);
        let (pid, before) = (robot.view.pid("ros2"), robot.view.processes["ros2"].rss);
        let port = rtps::unicast_port(domain, 0).expect("a port");
        let mut random = Random::new(11);
        let datagrams: Vec<Vec<u8>> = (0..2000).map(|_| hostile(domain, &mut random)).collect();
        let ended = AtomicBool::new(false);
        let sent = std::thread::scope(|scope| {
            let flood = scope.spawn(|| {
                let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
                let mut sent = 0;
                while !ended.load(Ordering::Relaxed) {
                    for datagram in &datagrams {
                        // One that finds the buffer full is lost, as an attacker's may be.
                        sent += u64::from(socket.send_to(datagram, (Ipv4Addr::LOCALHOST, port)).is_ok());
                        if sent % 100 == 0 {
                            std::thread::sleep(Duration::from_millis(5));
                        }
                    }
                }
                sent
            });
            let driven = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                for _ in 0..80 {
                    robot.command(0.3, 0.0);
                    robot.pass(0.05);
                    assert!(robot.view.speed() > 0.2, "{}", robot.view.reason());
                }
            }));
            ended.store(true, Ordering::Relaxed);
            let sent = flood.join().expect("it only sends");
            driven.unwrap_or_else(|failure| std::panic::resume_unwind(failure));
            sent
        });
        assert!(sent > 10_000, "{sent}");
        robot.until("the flood is counted", 15.0, |view| {
            view.texts.iter().any(|text| text.module == "ros2" && text.text.ends_with("datagrams are malformed"))
        });
        let after = robot.view.processes["ros2"].rss;
        println!("{sent} datagrams; resident memory of ros2 before {before}, after {after} bytes");
        assert_eq!(robot.view.pid("ros2"), pid);
        assert!(after - before < 8 << 20, "{before} {after}");
    });
}
