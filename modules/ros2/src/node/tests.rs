//! The node beside somebody of ROS.

mod hashes;

use super::*;
use crate::description::Description;
use base::Duration;
use logger::ros::RobotScene;
use messages::lowlevel::{CmdVelocity, DataVelocity};
use rtps::{Limits, Prefix, SampleIdentity};

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
        endpoint_data: crate::type_hashes::user_data,
        limits: Limits::default(),
    }
}

fn config(commands: bool, managed: bool) -> Config {
    let [ttl, driver_ttl] = [500, 250].map(Duration::from_millis);
    Config {
        name: "courier".into(),
        namespace: "/r1".into(),
        participant: participant(1, 2),
        outgoing: outgoing::Config {
            scene: RobotScene::default(),
            odometry: outgoing::OdometrySource::Drives,
            devices: crate::topics::Devices::default(),
            simulated: false,
            description: Description::default(),
        },
        fixed: Vec::new(),
        servers: servers::Config { operator: commands.then(Default::default), parameters: Vec::new(), managed },
        drive: commands.then_some(drive::Config { priority: 1, ttl, driver_ttl }),
        epoch: Epoch::default(),
    }
}

/// The node, and somebody of ROS.
struct Bench {
    now: Instant,
    node: Node,
    ros: Participant,
    told: Vec<CmdVelocity>,
    others: Vec<Message>,
    /// What the node has sent.
    sent: Vec<u8>,
}

impl Bench {
    fn new(commands: bool) -> Self {
        Self::of(config(commands, false))
    }

    fn of(config: Config) -> Self {
        let now = Instant::from_millis(1);
        let (node, ros) = (Node::new(config, now), Participant::new(participant(2, 1)));
        Self { now, node, ros, told: Vec::new(), others: Vec::new(), sent: Vec::new() }
    }

    fn run(&mut self, millis: u64) {
        for _ in 0..millis {
            self.now += Duration::from_millis(1);
            let now = self.now;
            self.node.handle_timeout(now);
            self.ros.handle_timeout(now);
            while let Some(sent) = self.node.poll_tx() {
                self.ros.handle_rx(now, address(1), &sent.datagram);
                self.sent.extend(sent.datagram);
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
    // The participant, the writers of /odom and /tf, those of feedback and status of two actions and of transitions,
    // and a reader and a writer of each service: three of an action, six of parameters, five of the life cycle.
    let services = 2 * 3 + 6 + 5;
    assert_eq!(graphs.windows(12).filter(|bytes| **bytes == [1; 12]).count(), 1 + 2 + 5 + 2 * services);
}

/// A client of a service, as Fast DDS has it.
struct Client {
    asks: WriterId,
    answers: ReaderId,
}

impl Client {
    fn new(bench: &mut Bench, name: &str, kind: &str) -> Self {
        let (request, response) = (format!("{kind}_Request_"), format!("{kind}_Response_"));
        let asks = bench.ros.add_writer(bench.now, &format!("rq/r1{name}Request"), &request, Qos::RELIABLE).unwrap();
        let answers = bench.ros.add_reader(bench.now, &format!("rr/r1{name}Reply"), &response, Qos::RELIABLE).unwrap();
        Self { asks, answers }
    }

    /// Sends a request; the answers that come within some time, with what they answer.
    fn call(&self, bench: &mut Bench, request: &[u8]) -> Vec<(SampleIdentity, Vec<u8>)> {
        let reader = bench.ros.reader_guid(self.answers);
        let belongs = SampleIdentity { writer: reader, number: SampleIdentity::UNKNOWN_NUMBER };
        let now = bench.now;
        bench.ros.write_related(now, self.asks, 0, Some(belongs), request);
        bench.run(100);
        let samples = std::iter::from_fn(|| bench.ros.poll_event());
        samples
            .filter(|sample| sample.reader == self.answers)
            .map(|sample| (sample.related.unwrap(), sample.payload))
            .collect()
    }
}

#[test]
fn services_answer_to_the_reader_that_a_request_names() {
    let mut bench = Bench::new(true);
    let client = Client::new(&mut bench, "/courier/pause", "std_srvs::srv::dds_::SetBool");
    bench.run(300);
    let reader = bench.ros.reader_guid(client.answers);
    for number in 1..=3 {
        let answers = client.call(&mut bench, &[0, 1, 0, 0, 1]);
        let [(related, answer)] = &answers[..] else { panic!("{}", answers.len()) };
        assert_eq!((*related, answer[4]), (SampleIdentity { writer: reader, number }, 1));
        assert_eq!(bench.others.len(), usize::try_from(number).unwrap());
    }
    bench.node.set_acts(false);
    assert_eq!(client.call(&mut bench, &[0, 1, 0, 0, 1])[0].1[4], 0);
    bench.node.set_acts(true);
    assert_eq!(client.call(&mut bench, &[0, 1, 0, 0, 7])[0].1[4], 0, "neither true nor false");
    assert_eq!(bench.others.len(), 3);
}

#[test]
fn an_answer_waits_for_a_reader_that_is_not_known_yet_and_not_for_ever() {
    let mut bench = Bench::new(true);
    let kind = "std_srvs::srv::dds_::SetBool";
    let asks =
        bench.ros.add_writer(bench.now, "rq/r1/courier/pauseRequest", &format!("{kind}_Request_"), Qos::RELIABLE);
    let asks = asks.unwrap();
    bench.run(300);
    let now = bench.now;
    bench.ros.write(now, asks, 0, &[0, 1, 0, 0, 1]);
    bench.run(500);
    assert_eq!(bench.others.len(), 1, "it is obeyed");
    let name = format!("{kind}_Response_");
    let reader = bench.ros.add_reader(bench.now, "rr/r1/courier/pauseReply", &name, Qos::RELIABLE).unwrap();
    bench.run(300);
    let answers = std::iter::from_fn(|| bench.ros.poll_event()).filter(|sample| sample.reader == reader).count();
    assert_eq!(answers, 1);
    let mut lonely = Bench::new(true);
    let asks =
        lonely.ros.add_writer(lonely.now, "rq/r1/courier/pauseRequest", &format!("{kind}_Request_"), Qos::RELIABLE);
    let asks = asks.unwrap();
    lonely.run(300);
    for _ in 0..40 {
        let now = lonely.now;
        lonely.ros.write(now, asks, 0, &[0, 1, 0, 0, 1]);
        lonely.run(10);
    }
    lonely.run(1500);
    let notes: Vec<String> = std::iter::from_fn(|| lonely.node.poll_note()).collect();
    assert!(notes.iter().any(|note| note.ends_with("answers are dropped: their clients are gone")), "{notes:?}");
}

#[test]
fn without_leave_there_are_actions_that_reject_and_parameters_and_no_operators() {
    let mut bench = Bench::new(false);
    let pause = Client::new(&mut bench, "/courier/pause", "std_srvs::srv::dds_::SetBool");
    let list = Client::new(&mut bench, "/courier/list_parameters", "rcl_interfaces::srv::dds_::ListParameters");
    let kind = "nav2_msgs::action::dds_::NavigateToPose_SendGoal";
    let goal = Client::new(&mut bench, "/navigate_to_pose/_action/send_goal", kind);
    bench.run(300);
    let matched = [&pause, &list, &goal].map(|client| bench.ros.matched(client.asks));
    assert_eq!(matched, [0, 1, 1]);
    let request = crate::navigate::wire::goal_request(crate::navigate::Kind::ToPose, [1; 16], "map", &[[1.0; 3]], "");
    assert_eq!(goal.call(&mut bench, &request)[0].1[4], 0, "rejected");
    let empty = [0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(list.call(&mut bench, &empty)[0].1[4..12], [0; 8]);
    assert!(bench.others.is_empty() && bench.told.is_empty());
}

#[test]
fn a_goal_goes_to_the_planner_and_its_end_to_the_client() {
    use messages::middlelevel::DataGoal;
    let mut bench = Bench::new(true);
    let kind = "nav2_msgs::action::dds_::NavigateToPose";
    let send = Client::new(&mut bench, "/navigate_to_pose/_action/send_goal", &format!("{kind}_SendGoal"));
    let result = Client::new(&mut bench, "/navigate_to_pose/_action/get_result", &format!("{kind}_GetResult"));
    let status = "action_msgs::msg::dds_::GoalStatusArray_";
    let status =
        bench.ros.add_reader(bench.now, "rt/r1/navigate_to_pose/_action/status", status, Qos::LATCHED).unwrap();
    bench.run(300);
    let request = crate::navigate::wire::goal_request(crate::navigate::Kind::ToPose, [1; 16], "map", &[[1.0; 3]], "");
    assert_eq!(send.call(&mut bench, &request)[0].1[4], 1);
    let Some(Message::MlCmdGoal(goal)) = bench.others.pop() else { panic!() };
    let mut ask = vec![0, 1, 0, 0];
    ask.extend([1; 16]);
    assert!(result.call(&mut bench, &ask).is_empty(), "not yet");
    bench.bus(DataGoal { id: goal.id, status: DataGoal::REACHED, ..DataGoal::default() });
    bench.run(50);
    let (mut answers, mut states) = (Vec::new(), Vec::new());
    while let Some(sample) = bench.ros.poll_event() {
        if sample.reader == result.answers {
            answers.push(sample.payload[4]);
        } else if sample.reader == status {
            states.push(sample.payload[8 + 24]);
        }
    }
    assert_eq!((answers, states), (vec![4], vec![4]));
}

/// Number and label of `lifecycle_msgs/msg/Transition`.
fn transition(number: u8) -> Vec<u8> {
    let mut cdr = Vec::new();
    let mut to = Writer::new(&mut cdr);
    to.u8(number);
    to.string("");
    cdr
}

#[test]
fn a_managed_node_commands_nothing_until_it_is_activated_and_its_goal_ends_when_it_is_deactivated() {
    let [configure, activate, deactivate] = [1, 3, 4];
    let mut bench = Bench::of(config(true, true));
    let twist = bench.writer();
    let change = Client::new(&mut bench, "/courier/change_state", "lifecycle_msgs::srv::dds_::ChangeState");
    let pause = Client::new(&mut bench, "/courier/pause", "std_srvs::srv::dds_::SetBool");
    let kind = "nav2_msgs::action::dds_::NavigateToPose_SendGoal";
    let send = Client::new(&mut bench, "/navigate_to_pose/_action/send_goal", kind);
    let bond = bench.ros.add_reader(bench.now, "rt/r1/bond", "bond::msg::dds_::Status_", Qos::RELIABLE).unwrap();
    let goal =
        |id| crate::navigate::wire::goal_request(crate::navigate::Kind::ToPose, [id; 16], "map", &[[1.0; 3]], "");
    bench.run(300);
    bench.twist(twist, 0.4);
    assert_eq!(send.call(&mut bench, &goal(1))[0].1[4], 0, "rejected");
    assert_eq!((bench.told.len(), bench.others.len()), (0, 0));
    assert_eq!(pause.call(&mut bench, &[0, 1, 0, 0, 0])[0].1[4], 0, "no release");
    assert_eq!(pause.call(&mut bench, &[0, 1, 0, 0, 1])[0].1[4], 1, "a stop");
    assert_eq!(bench.others.len(), 1);

    assert_eq!(change.call(&mut bench, &transition(activate))[0].1[4], 0);
    assert_eq!(change.call(&mut bench, &transition(configure))[0].1[4], 1);
    assert!(std::iter::from_fn(|| bench.ros.poll_event()).all(|sample| sample.reader != bond));
    assert_eq!(change.call(&mut bench, &transition(activate))[0].1[4], 1);
    bench.run(1000);
    let beats = std::iter::from_fn(|| bench.ros.poll_event()).filter(|sample| sample.reader == bond).count();
    assert_eq!(beats, 4, "that of the activation was read with the answer");
    assert_eq!(send.call(&mut bench, &goal(2))[0].1[4], 1);
    let Some(Message::MlCmdGoal(begun)) = bench.others.pop() else { panic!() };
    bench.twist(twist, 0.4);
    bench.run(20);
    assert_eq!((begun.waypoints.len(), bench.told.len()), (1, 1));

    assert_eq!(change.call(&mut bench, &transition(deactivate))[0].1[4], 1);
    let Some(Message::MlCmdGoal(ended)) = bench.others.pop() else { panic!() };
    assert!(ended.waypoints.is_empty() && ended.id != begun.id);
    let said = bench.told.len();
    bench.twist(twist, 0.4);
    bench.run(1000);
    assert_eq!(bench.told.len(), said, "it fell silent");
}
