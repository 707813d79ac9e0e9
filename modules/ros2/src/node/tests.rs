//! The node beside somebody of ROS.

use super::*;
use crate::description::Description;
use base::Duration;
use logger::ros::RobotScene;
use messages::lowlevel::{CmdVelocity, DataVelocity};
use rtps::{Limits, Prefix};

fn address(n: u8) -> SocketAddrV4 {
    SocketAddrV4::new([127, 0, 0, n].into(), 7410)
}

fn participant(n: u8, peer: u8) -> rtps::Config {
    rtps::Config {
        domain: 0,
        prefix: Prefix([n; 12]),
        locators: vec![address(n)],
        announce_to: vec![address(peer)],
        announce_period: Duration::from_secs(3),
        lease: Duration::from_secs(20),
        name: String::new(),
        user_data: Vec::new(),
        limits: Limits::default(),
    }
}

/// The node, and somebody of ROS.
struct Bench {
    now: Instant,
    node: Node,
    ros: Participant,
    told: Vec<CmdVelocity>,
    others: Vec<Message>,
}

impl Bench {
    fn new(commands: bool) -> Self {
        let [ttl, driver_ttl] = [500, 250].map(Duration::from_millis);
        let source = outgoing::OdometrySource::Drives;
        let scene = RobotScene::default();
        let config = Config {
            name: "courier".into(),
            namespace: "/r1".into(),
            participant: participant(1, 2),
            outgoing: outgoing::Config {
                scene,
                odometry: source,
                lidars: 0,
                simulated: false,
                description: Description::default(),
            },
            fixed: Vec::new(),
            drive: commands.then_some(drive::Config { priority: 1, ttl, driver_ttl }),
            epoch: Epoch::default(),
        };
        let now = Instant::from_millis(1);
        let (node, ros) = (Node::new(config, now), Participant::new(participant(2, 1)));
        Self { now, node, ros, told: Vec::new(), others: Vec::new() }
    }

    fn run(&mut self, millis: u64) {
        for _ in 0..millis {
            self.now += Duration::from_millis(1);
            let now = self.now;
            self.node.handle_timeout(now);
            self.ros.handle_timeout(now);
            while let Some(sent) = self.node.poll_tx() {
                self.ros.handle_rx(now, address(1), &sent.datagram);
            }
            while let Some(sent) = self.ros.poll_tx() {
                self.node.on_datagram(now, now, address(2), &sent.datagram);
            }
            while let Some(message) = self.node.poll_message() {
                match message {
                    Message::LlCmdVelocity(command) => self.told.push(command),
                    other => self.others.push(other),
                }
            }
        }
    }

    fn twist(&mut self, writer: WriterId, vx: f64) {
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        [vx, 0.0, 0.0, 0.0, 0.0, 0.0].into_iter().for_each(|number| to.f64(number));
        let now = self.now;
        self.ros.write(now, writer, 0, &cdr);
    }

    fn writer(&mut self) -> WriterId {
        let name = "geometry_msgs::msg::dds_::Twist_";
        self.ros.add_writer(self.now, "rt/r1/cmd_vel", name, Qos::RELIABLE).unwrap()
    }

    fn bus(&mut self, message: impl Into<Message>) {
        let (message, mut data) = (message.into(), Vec::new());
        message.encode(&mut data).unwrap();
        self.node.on_bus(self.now, &message.channel_name(), &data);
    }
}

#[test]
fn ros_drives_only_where_it_may_command() {
    for commands in [false, true] {
        let mut bench = Bench::new(commands);
        let writer = bench.writer();
        bench.run(300);
        assert_eq!(bench.ros.matched(writer), usize::from(commands));
        bench.twist(writer, 0.4);
        bench.run(1000);
        // The first one a millisecond after its reception, the others every 50 ms until 250 ms.
        assert_eq!(bench.told.len(), if commands { 5 } else { 0 });
        assert!(bench.told.iter().all(|command| (command.vx, &*command.source) == (0.4, "ros2")));
    }
}

#[test]
fn two_publishers_are_two_sessions() {
    let mut bench = Bench::new(true);
    let writers = [bench.writer(), bench.writer()];
    bench.run(300);
    for writer in writers {
        bench.twist(writer, 0.4);
        bench.run(100);
    }
    let sessions: Vec<i64> = bench.told.iter().map(|command| command.session).collect();
    assert_ne!(sessions.first(), sessions.last());
}

#[test]
fn a_module_that_does_not_act_is_silent_at_once() {
    let mut bench = Bench::new(true);
    let writer = bench.writer();
    bench.run(300);
    bench.twist(writer, 0.4);
    bench.run(20);
    assert_eq!(bench.told.len(), 1);
    bench.node.set_acts(false);
    bench.run(500);
    bench.twist(writer, 0.4);
    bench.run(500);
    assert_eq!(bench.told.len(), 1);
    bench.node.set_acts(true);
    bench.twist(writer, 0.4);
    bench.run(20);
    assert_eq!(bench.told.len(), 2);
}

#[test]
fn a_refusal_is_noted_once_until_it_is_read() {
    let mut bench = Bench::new(true);
    let name = "geometry_msgs::msg::dds_::PoseStamped_";
    let writer = bench.ros.add_writer(bench.now, "rt/r1/goal_pose", name, Qos::RELIABLE).unwrap();
    bench.run(300);
    for _ in 0..3 {
        let now = bench.now;
        bench.ros.write(now, writer, 0, &[0, 1, 0, 0, 1, 2, 3, 4]);
        bench.run(10);
    }
    assert_eq!(bench.node.poll_note().as_deref(), Some("/goal_pose: a message is refused: it is malformed"));
    assert_eq!((bench.node.poll_note(), bench.others.len()), (None, 0));
}

#[test]
fn topics_are_told_to_who_listens_and_the_graph_names_the_node() {
    let mut bench = Bench::new(false);
    let odom = "nav_msgs::msg::dds_::Odometry_";
    let odom = bench.ros.add_reader(bench.now, "rt/r1/odom", odom, Qos::RELIABLE).unwrap();
    let graph = bench.ros.add_reader(bench.now, GRAPH.0, GRAPH.1, Qos::LATCHED).unwrap();
    let at = |timestamp| DataVelocity { timestamp, ..Default::default() };
    bench.bus(at(1));
    bench.run(300);
    bench.bus(at(50_001));
    bench.run(300);
    let (mut odoms, mut graphs) = (0, Vec::new());
    while let Some(sample) = bench.ros.poll_event() {
        if sample.reader == odom {
            odoms += 1;
        } else if sample.reader == graph {
            graphs = sample.payload;
        }
    }
    assert_eq!(odoms, 1);
    let text = String::from_utf8_lossy(&graphs);
    assert!(text.contains("courier\0") && text.contains("/r1\0"), "{text:?}");
    // The participant, and the writers of /odom and /tf.
    assert_eq!(graphs.windows(12).filter(|bytes| **bytes == [1; 12]).count(), 3);
}
