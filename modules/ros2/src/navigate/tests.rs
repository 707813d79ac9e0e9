//! The actions, from the request of a client to its result, beside a planner that says what the test wants.

use super::wire::{goal_request, result};
use super::*;
use crate::cdr::Reader;
use crate::service::Caller;
use messages::lowlevel::Hold as Held;
use rtps::{Entity, Guid, Prefix};
use testing::Random;

const GOAL: [f64; 3] = [1.0, 2.0, 0.5];

struct Bench {
    now: Instant,
    navigator: Navigator,
    calls: i64,
    commands: Vec<CmdGoal>,
    feedbacks: Vec<Vec<u8>>,
    /// The states of the last status of the first action.
    states: Vec<i8>,
    answers: Vec<(Part, i64, Vec<u8>)>,
    notes: Vec<String>,
}

fn id(n: u8) -> GoalId {
    [n; 16]
}

impl Bench {
    fn new() -> Self {
        Self {
            now: Instant::from_millis(1000),
            navigator: Navigator::default(),
            calls: 0,
            commands: Vec::new(),
            feedbacks: Vec::new(),
            states: Vec::new(),
            answers: Vec::new(),
            notes: Vec::new(),
        }
    }

    fn micros(&self) -> i64 {
        (self.now.as_nanos() / 1000) as i64
    }

    /// A request; its answer, if there is one at once.
    fn ask(&mut self, kind: Kind, part: Part, sample: &[u8], refusal: Option<&'static str>) -> Option<Vec<u8>> {
        self.calls += 1;
        let writer = Guid { prefix: Prefix([3; 12]), entity: Entity::UNKNOWN };
        let caller = Caller::of(writer, self.calls);
        let (now, micros) = (self.now, self.micros());
        self.navigator.on_request(now, micros, (kind, part), caller, sample, refusal);
        self.take();
        let call = self.calls;
        self.answers.iter().rfind(|(_, number, _)| *number == call).map(|(_, _, cdr)| cdr.clone())
    }

    fn send(&mut self, n: u8) -> bool {
        let sample = goal_request(Kind::ToPose, id(n), "map", &[GOAL], "");
        self.ask(Kind::ToPose, Part::SendGoal, &sample, None).unwrap()[4] == 1
    }

    fn cancel(&mut self, goal: GoalId) -> (i8, u8) {
        let mut sample = vec![0, 1, 0, 0];
        sample.extend(goal);
        sample.extend([0; 8]);
        let answer = self.ask(Kind::ToPose, Part::CancelGoal, &sample, None).unwrap();
        (answer[4].cast_signed(), answer[8])
    }

    fn result(&mut self, n: u8) -> Option<(i8, u16, String)> {
        let mut sample = vec![0, 1, 0, 0];
        sample.extend(id(n));
        self.ask(Kind::ToPose, Part::GetResult, &sample, None).map(|answer| read_result(&answer))
    }

    fn planner(&mut self, id: i32, status: i8, message: &str) {
        let goal = DataGoal { id, status, remaining: 3.0, message: message.into(), ..DataGoal::default() };
        let (now, micros) = (self.now, self.micros());
        self.navigator.on_planner(now, micros, &goal);
        self.take();
    }

    /// Time passes, in which the planner is silent.
    fn wait(&mut self, millis: u64) {
        let end = self.now + Duration::from_millis(millis);
        while let Some(due) = self.navigator.poll_timeout().filter(|due| *due <= end) {
            self.now = self.now.max(due);
            self.navigator.handle_timeout(self.now);
            assert!(self.navigator.poll_timeout().is_none_or(|due| due > self.now));
        }
        self.now = end;
        self.take();
    }

    fn take(&mut self) {
        while let Some(output) = self.navigator.poll() {
            match output {
                Output::Answer(_, part, caller, cdr) => self.answers.push((part, caller.number(), cdr)),
                Output::Feedback(_, cdr) => self.feedbacks.push(cdr),
                Output::Status(Kind::ToPose, cdr) => self.states = states(&cdr),
                Output::Status(..) => {}
                Output::Command(goal) => self.commands.push(goal),
                Output::Note(text) => self.notes.push(text),
            }
        }
    }

    fn last(&self) -> i32 {
        self.commands.last().unwrap().id
    }
}

/// The states of `action_msgs/msg/GoalStatusArray`.
fn states(cdr: &[u8]) -> Vec<i8> {
    let mut reader = Reader::new(cdr).unwrap();
    let count = reader.u32().unwrap();
    let mut state = || {
        let (_, _, _) = (reader.bytes::<16>()?, reader.i32()?, reader.u32()?);
        reader.u8().map(u8::cast_signed)
    };
    (0..count).map(|_| state().unwrap()).collect()
}

fn read_result(answer: &[u8]) -> (i8, u16, String) {
    let code = u16::from_le_bytes([answer[6], answer[7]]);
    let length = answer[8] as usize;
    (answer[4].cast_signed(), code, String::from_utf8_lossy(&answer[12..12 + length - 1]).into_owned())
}

#[test]
fn a_goal_is_driven_to_and_its_result_comes_at_its_end_and_later() {
    let mut bench = Bench::new();
    assert!(bench.send(1));
    let [CmdGoal { waypoints, r#loop: false, .. }] = &bench.commands[..] else { panic!() };
    assert_eq!((waypoints.len(), waypoints[0].x, waypoints[0].heading), (1, 1.0, true));
    assert_eq!(bench.states, [Status::Executing as i8]);
    assert_eq!(bench.result(1), None, "not yet");
    let number = bench.last();
    // What the planner said before it received the goal changes nothing.
    bench.planner(number - 5, DataGoal::REACHED, "");
    bench.planner(number, DataGoal::DRIVING, "");
    assert!(bench.answers.iter().all(|(part, _, _)| *part != Part::GetResult));
    bench.planner(number, DataGoal::REACHED, "reached");
    let (_, call, answer) = bench.answers.iter().find(|(part, _, _)| *part == Part::GetResult).unwrap();
    assert_eq!((*call, read_result(answer)), (2, (Status::Succeeded as i8, 0, String::new())));
    assert_eq!(bench.result(1), Some((Status::Succeeded as i8, 0, String::new())));
    assert_eq!(bench.states, [Status::Succeeded as i8]);
    // For a time.
    bench.wait(15 * 60 * 1000 + 1);
    assert_eq!(bench.result(1).unwrap().0, Status::Unknown as i8);
    assert!(bench.states.is_empty() && bench.commands.len() == 1);
}

#[test]
fn commands_within_a_millisecond_have_different_numbers() {
    let mut bench = Bench::new();
    for n in 1..=4 {
        assert!(bench.send(n));
        if n == 2 {
            bench.now += Duration::from_millis(1);
        }
    }
    bench.cancel(id(4));
    let mut numbers: Vec<i32> = bench.commands.iter().map(|command| command.id).collect();
    numbers.sort_unstable();
    numbers.dedup();
    assert_eq!(numbers.len(), 5);
}

#[test]
fn feedback_has_the_pose_the_way_the_times_and_the_recoveries() {
    let mut bench = Bench::new();
    bench.send(1);
    let number = bench.last();
    bench.planner(number, DataGoal::DRIVING, "");
    for code in [606, 606, 603, 606] {
        let holds = vec![Held { code, ..Held::default() }];
        bench.navigator.on_holds(&DataHold { module: "planner".into(), holds, ..DataHold::default() });
        let other = vec![Held { code: 606, ..Held::default() }];
        bench.navigator.on_holds(&DataHold { module: "driver_canbus".into(), holds: other, ..DataHold::default() });
    }
    bench.now += Duration::from_millis(1500);
    let estimate = DataEstimate {
        timestamp: 7_000_000,
        x: 4.0,
        y: 5.0,
        speed: -0.5,
        quality: DataEstimate::FINE,
        ..DataEstimate::default()
    };
    let now = bench.now;
    bench.navigator.on_estimate(now, &estimate);
    bench.navigator.on_estimate(now + Duration::from_millis(99), &estimate);
    bench.navigator.on_estimate(now + Duration::from_millis(100), &DataEstimate { x: f64::NAN, ..estimate.clone() });
    let lost = DataEstimate { quality: DataEstimate::LOST, ..estimate };
    bench.navigator.on_estimate(now + Duration::from_millis(100), &lost);
    bench.take();
    let [feedback] = &bench.feedbacks[..] else { panic!("{}", bench.feedbacks.len()) };
    let mut reader = Reader::new(feedback).unwrap();
    assert_eq!((reader.bytes(), reader.i32(), reader.u32()), (Some(id(1)), Some(7), Some(0)));
    assert_eq!((reader.string(), reader.f64s()), (Some("map"), Some([4.0, 5.0, 0.0, 0.0, 0.0, 0.0, 1.0])));
    assert_eq!((reader.i32(), reader.u32()), (Some(1), Some(500_000_000)), "navigation time");
    assert_eq!((reader.i32(), reader.u32()), (Some(6), Some(0)), "3 m at 0.5 m/s");
    let (recoveries, remaining) = ((reader.u8(), reader.u8()), reader.u32().map(f32::from_bits));
    assert_eq!((recoveries, remaining), ((Some(2), Some(0)), Some(3.0)));
    assert_eq!(reader.end(), Some(()));
}

#[test]
fn a_cancelled_goal_ends_when_the_planner_says_so() {
    let mut bench = Bench::new();
    bench.send(1);
    let goal = bench.last();
    bench.planner(goal, DataGoal::DRIVING, "");
    assert_eq!(bench.cancel(id(9)), (CancelCode::UnknownGoal as i8, 0));
    assert_eq!(bench.cancel(id(1)), (CancelCode::None as i8, 1));
    assert!(bench.commands[1].waypoints.is_empty() && bench.commands[1].id != goal);
    assert_eq!(bench.states, [Status::Canceling as i8]);
    assert_eq!(bench.cancel(id(1)), (CancelCode::Rejected as i8, 0), "once");
    bench.planner(goal, DataGoal::DRIVING, "");
    assert_eq!(bench.states, [Status::Canceling as i8]);
    let end = bench.last();
    bench.planner(end, DataGoal::CANCELLED, "");
    assert_eq!(bench.result(1), Some((Status::Canceled as i8, 0, String::new())));
    assert_eq!(bench.cancel(id(1)), (CancelCode::Terminated as i8, 0));
    // All goals: none is left.
    assert_eq!(bench.cancel(GoalId::default()), (CancelCode::Rejected as i8, 0));
    assert_eq!(bench.commands.len(), 2);
}

#[test]
fn a_goal_that_is_cancelled_before_the_planner_begins_with_it_ends_as_cancelled() {
    let mut bench = Bench::new();
    for n in 1..=3 {
        bench.send(n);
        bench.wait(10);
    }
    let [first, second, third] = [0, 1, 2].map(|n| bench.commands[n].id);
    bench.planner(first, DataGoal::DRIVING, "");
    assert_eq!(bench.cancel(id(3)), (CancelCode::None as i8, 1));
    let end = bench.last();
    // The planner still speaks of what it did before.
    for goal in [first, second, third] {
        bench.planner(goal, DataGoal::DRIVING, "");
    }
    assert_eq!(bench.states.last(), Some(&(Status::Canceling as i8)));
    bench.planner(end, DataGoal::CANCELLED, "");
    assert_eq!(bench.result(3), Some((Status::Canceled as i8, 0, String::new())));
    assert_eq!(bench.commands.len(), 4, "each once");
    // Another one's goal is none of these.
    bench.send(4);
    bench.planner(bench.last(), DataGoal::DRIVING, "");
    bench.cancel(id(4));
    bench.planner(bench.last() + 1000, DataGoal::DRIVING, "");
    let why = "another goal replaced it, which was not sent by this action".to_owned();
    assert_eq!(bench.result(4), Some((Status::Aborted as i8, 9000, why)));
}

#[test]
fn a_newer_goal_replaces_an_older_one_of_either_action() {
    let mut bench = Bench::new();
    bench.send(1);
    let first = bench.last();
    bench.planner(first, DataGoal::DRIVING, "");
    assert!(bench.send(2));
    let second = bench.last();
    assert_ne!(first, second);
    let why = "it was replaced by a newer goal".to_owned();
    assert_eq!(bench.result(1), Some((Status::Aborted as i8, 9000, why)));
    // The planner may still speak of the first one.
    bench.planner(first, DataGoal::DRIVING, "");
    bench.planner(second, DataGoal::DRIVING, "");
    assert_eq!(bench.states, [Status::Aborted as i8, Status::Executing as i8]);
    let poses = [GOAL, [3.0, 4.0, 0.0]];
    let sample = goal_request(Kind::ThroughPoses, id(3), "map", &poses, "");
    assert_eq!(bench.ask(Kind::ThroughPoses, Part::SendGoal, &sample, None).unwrap()[4], 1);
    assert_eq!(bench.states, [Status::Aborted as i8; 2]);
    assert_eq!(bench.commands.last().unwrap().waypoints.len(), 2);
    assert_eq!(bench.commands.len(), 3, "the planner replaces a goal by itself");
}

#[test]
fn what_others_command_and_what_the_planner_gives_up_aborts_with_the_reason() {
    for (status, other, why) in [
        (DataGoal::FAILED, 0, "gave up waypoint 1: something stands in the way"),
        (DataGoal::CANCELLED, 1, "an operator cancelled it"),
        (DataGoal::DRIVING, 1, "another goal replaced it, which was not sent by this action"),
        (DataGoal::IDLE, 1, "the planner was started again, without a goal"),
    ] {
        let mut bench = Bench::new();
        bench.send(1);
        let number = bench.last();
        bench.planner(number, DataGoal::DRIVING, "");
        bench.planner(number + other, status, "gave up waypoint 1: something stands in the way");
        assert_eq!(bench.result(1), Some((Status::Aborted as i8, 9000, why.into())));
        assert_eq!(bench.commands.len(), 1, "the goal of somebody else goes on");
    }
}

#[test]
fn a_goal_of_somebody_else_that_is_refused_does_not_end_the_one_that_goes_on() {
    let mut bench = Bench::new();
    bench.send(1);
    let number = bench.last();
    bench.planner(number, DataGoal::DRIVING, "");
    for _ in 0..3 {
        bench.planner(number + 1, DataGoal::FAILED, "cannot reach waypoint 1: it is outside the map");
        bench.planner(number, DataGoal::DRIVING, "");
    }
    assert_eq!((&bench.states[..], bench.commands.len()), (&[Status::Executing as i8][..], 1));
    // A robot that was held ends its goal with it, and says so again.
    bench.planner(number + 1, DataGoal::FAILED, "x");
    bench.planner(number + 1, DataGoal::FAILED, "x");
    let why = "another goal replaced it, which was not sent by this action".to_owned();
    assert_eq!(bench.result(1), Some((Status::Aborted as i8, 9000, why)));
    assert_eq!(bench.commands.len(), 1);
}

#[test]
fn what_ros_has_given_up_is_cancelled_if_the_planner_goes_on_with_it() {
    // A newer goal of ROS is impossible.
    let mut bench = Bench::new();
    bench.send(1);
    let first = bench.last();
    bench.planner(first, DataGoal::DRIVING, "");
    bench.send(2);
    let second = bench.last();
    bench.planner(second, DataGoal::FAILED, "cannot reach waypoint 1: it is outside the map");
    let why = "cannot reach waypoint 1: it is outside the map".to_owned();
    assert_eq!(bench.result(2), Some((Status::Aborted as i8, 9000, why)));
    assert_eq!(bench.commands.len(), 2);
    bench.planner(first, DataGoal::DRIVING, "");
    assert!(bench.commands.len() == 3 && bench.commands[2].waypoints.is_empty(), "{:?}", bench.commands);
    // An operator's goal, for which the robot stopped, and then nothing led there.
    let mut bench = Bench::new();
    bench.send(1);
    let first = bench.last();
    bench.planner(first, DataGoal::DRIVING, "");
    bench.planner(first + 1, DataGoal::DRIVING, "looks for a way");
    assert_eq!(bench.states, [Status::Aborted as i8]);
    bench.planner(first + 1, DataGoal::FAILED, "cannot reach waypoint 1: no way leads to the goal");
    assert_eq!(bench.commands.len(), 1);
    bench.planner(first, DataGoal::DRIVING, "");
    assert!(bench.commands.len() == 2 && bench.commands[1].waypoints.is_empty());
}

#[test]
fn a_goal_of_which_the_planner_does_not_speak_is_aborted_and_cancelled_if_it_is_pursued_later() {
    let mut bench = Bench::new();
    bench.send(1);
    bench.wait(1999);
    assert_eq!(bench.states, [Status::Executing as i8]);
    bench.wait(1);
    assert_eq!(bench.result(1), Some((Status::Aborted as i8, 9000, "the planner does not answer".into())));
    let number = bench.last();
    bench.planner(number, DataGoal::DRIVING, "");
    assert!(bench.commands.len() == 2 && bench.commands[1].waypoints.is_empty());
    let end = bench.last();
    bench.planner(end, DataGoal::CANCELLED, "");
    // A silence in between is longer.
    bench.send(2);
    let number = bench.last();
    bench.planner(number, DataGoal::DRIVING, "");
    bench.wait(4999);
    assert_eq!(bench.states.last(), Some(&(Status::Executing as i8)));
    bench.wait(1);
    assert_eq!(bench.states.last(), Some(&(Status::Aborted as i8)));
}

#[test]
fn goals_that_may_not_be_are_rejected_and_send_nothing() {
    let mut bench = Bench::new();
    let sample = |frame: &str, poses: &[[f64; 3]], tree: &str| goal_request(Kind::ToPose, id(1), frame, poses, tree);
    for (sample, refusal, why) in [
        (sample("map", &[GOAL], ""), Some("not now"), "not now"),
        (sample("odom", &[GOAL], ""), None, "its frame is \"odom\": expected \"map\""),
        (sample("map", &[[f64::NAN, 0.0, 0.0]], ""), None, "its pose is not finite"),
        (sample("map", &[GOAL], "tree.xml"), None, "it names a behavior tree: the robot has none"),
        (sample("map", &[GOAL, GOAL], ""), None, "it is malformed"),
    ] {
        let answer = bench.ask(Kind::ToPose, Part::SendGoal, &sample, refusal).unwrap();
        assert_eq!(answer[4], 0, "{why}");
        assert_eq!(bench.notes.pop().unwrap(), format!("/navigate_to_pose: a goal is rejected: {why}"));
    }
    for count in [0, 101] {
        let sample = goal_request(Kind::ThroughPoses, id(1), "map", &vec![GOAL; count], "");
        assert_eq!(bench.ask(Kind::ThroughPoses, Part::SendGoal, &sample, None).unwrap()[4], 0);
    }
    assert!(bench.commands.is_empty() && bench.states.is_empty());
    assert!(bench.send(1) && !bench.send(1), "an identifier counts once");
    assert_eq!(bench.commands.len(), 1);
}

#[test]
fn goals_and_requests_for_results_are_bounded() {
    let mut bench = Bench::new();
    for n in 1..=200 {
        assert!(bench.send(n));
        bench.now += Duration::from_millis(5);
        assert!(bench.states.len() <= crate::action::GOALS_MAX);
    }
    assert_eq!(bench.result(1).unwrap().0, Status::Unknown as i8);
    assert_eq!(bench.result(199).unwrap().0, Status::Aborted as i8);
    let before = bench.answers.len();
    (0..20).for_each(|_| assert_eq!(bench.result(200), None));
    let number = bench.last();
    bench.planner(number, DataGoal::REACHED, "");
    assert_eq!(bench.answers.len() - before, 8);
    let numbers: std::collections::BTreeSet<i32> = bench.commands.iter().map(|goal| goal.id).collect();
    assert_eq!(numbers.len(), 200, "no two goals have a number in common");
}

#[test]
fn a_result_has_the_states_of_the_waypoints_as_of_kilted() {
    let poses = [GOAL; 3];
    let progress = Progress { poses: &poses, stamp: 0, reached: 1, has_failed: true };
    let cdr = result(Kind::ThroughPoses, Status::Aborted, "x", Some(progress));
    assert_eq!(read_result(&cdr), (6, 9100, "x".into()));
    let mut reader = Reader::new(&cdr).unwrap();
    let (_, _, _) = (reader.u8(), reader.bytes::<3>(), reader.string());
    assert_eq!((reader.u32(), reader.u8(), reader.u32()), (Some(3), Some(1), Some(0)));
    assert_eq!((reader.i32(), reader.u32(), reader.string()), (Some(0), Some(0), Some("map")));
    let [x, y, ..] = reader.f64s::<7>().unwrap();
    assert_eq!((x, y, reader.bytes::<2>(), reader.string()), (1.0, 2.0, Some([0, 0]), Some("")));
    assert_eq!((reader.u8(), reader.u32()), (Some(3), Some(1)), "failed");
}

#[test]
fn whatever_is_requested_is_survived() {
    let mut random = Random::new(8);
    let mut bench = Bench::new();
    let good = [
        goal_request(Kind::ToPose, id(1), "map", &[GOAL], ""),
        goal_request(Kind::ThroughPoses, id(2), "map", &[GOAL, GOAL], ""),
    ];
    for n in 0..20_000 {
        let mut sample = good[random.index(2)].clone();
        for _ in 0..random.below(4) {
            let at = random.index(sample.len());
            sample[at] = random.edge_byte();
        }
        if random.one_in(4) {
            sample.truncate(random.index(sample.len()));
        }
        let (kind, part) = (Kind::ALL[random.index(2)], Part::ALL[random.index(3)]);
        bench.ask(kind, part, &sample, None);
        if n % 7 == 0 {
            let number = bench.commands.last().map_or(0, |goal| goal.id) + random.index(2) as i32;
            let status = random.index(7) as i8 - 1;
            bench.planner(number, status, "x");
        }
        let bad = |at: &Waypoint| !(at.x + at.y + at.theta).is_finite();
        assert!(bench.commands.iter().all(|goal| !goal.waypoints.iter().any(bad)));
        bench.commands.truncate(1);
        bench.answers.clear();
        bench.notes.clear();
        bench.now += Duration::from_millis(3);
    }
}
