use super::*;
use base::{Duration, Instant};
use messages::common::{DataProcesses, DataState, Error, Process};
use messages::lowlevel::{DataMotion, EventStop};
use messages::middlelevel::DataGoal;
use messages::{Channel, Message};

const T0: Instant = Instant::from_millis(10_000);

fn model() -> Model {
    Model::new(Config { robot: "advee".into(), critical: vec!["driver_canbus".into()] })
}

fn say(model: &mut Model, at: Instant, message: impl Into<Message>) {
    let message = message.into();
    model.hear(at, &message.channel_name(), 40, Some(message));
}

fn process(phase: i8, state: i8, last_exit: i32) -> DataProcesses {
    let process = Process {
        module: "driver_canbus".into(),
        pid: 7,
        phase,
        state,
        wanted: DataState::RUN,
        restarts: i32::from(last_exit != 0),
        last_exit,
        uptime: 3.0,
        cpu: 0.01,
        rss: 1 << 20,
    };
    DataProcesses { timestamp: 1, processes: vec![process] }
}

fn motion(speed: f64, reason: &str, source: &str) -> DataMotion {
    DataMotion {
        timestamp: 1,
        speed,
        steering: 0.0,
        speed_target: 0.0,
        steering_target: 0.0,
        enabled: true,
        homed: true,
        quick_stop: false,
        source: source.into(),
        reason: reason.into(),
    }
}

fn error(number: i32, severity: i8, message: &str, timestamp: i64) -> Error {
    Error {
        timestamp,
        module: "driver_canbus".into(),
        number,
        message: message.into(),
        fatal: false,
        r#type: Error::DEVICE,
        severity,
        file: "drive.rs".into(),
        line: 1,
    }
}

#[test]
fn the_status_says_first_what_people_must_know_first() {
    let mut model = model();
    let word = |model: &Model, now| {
        let Status { word, reason } = model.status(now);
        (word, reason)
    };
    assert_eq!(word(&model, T0).0, Word::Silent);
    say(&mut model, T0, process(Process::RUNNING, DataState::RUN, 0));
    assert_eq!(word(&model, T0), (Word::Fault, "driver_canbus says nothing of the drives".into()));
    let idle = motion(0.0, "nobody commands the motion", "");
    say(&mut model, T0, DataMotion { enabled: false, quick_stop: true, ..idle });
    assert_eq!(word(&model, T0), (Word::Ready, "it stands; nobody commands it".into()));
    say(&mut model, T0, motion(0.4, "", "planner"));
    assert_eq!(word(&model, T0), (Word::Driving, "0.40 m/s; planner commands".into()));
    say(&mut model, T0, motion(0.0, "", "planner"));
    let goal = DataGoal {
        timestamp: 1,
        id: 1,
        waypoint: 0,
        status: DataGoal::BLOCKED,
        remaining: 3.0,
        message: "waits: somebody is in the way".into(),
    };
    say(&mut model, T0, goal);
    assert_eq!(word(&model, T0), (Word::Waiting, "waits: somebody is in the way".into()));
    say(&mut model, T0, DataMotion { homed: false, ..motion(0.0, "the steering is not homed", "") });
    assert_eq!(word(&model, T0), (Word::Stopped, "the steering is not homed".into()));
    say(&mut model, T0, process(Process::TERMINATED, DataState::RUN, 139));
    let down = "driver_canbus is down: SIGSEGV: it crashed; the robot does not move without it";
    assert_eq!(word(&model, T0), (Word::Fault, down.into()));
    say(&mut model, T0, EventStop { timestamp: 1, engaged: true, source: "bumper3".into() });
    let paused = "the PAUSE line is engaged by bumper3; release it, then let the robot go on";
    assert_eq!(word(&model, T0), (Word::Paused, paused.into()));
    assert_eq!(
        word(&model, T0 + Duration::from_millis(2500)),
        (Word::Silent, "nothing was heard of the robot for 2 s".into())
    );
}

#[test]
fn what_is_older_than_twice_its_period_is_stale() {
    let mut model = model();
    assert_eq!(model.motion.freshness(T0), Freshness::Never);
    say(&mut model, T0, motion(0.0, "", ""));
    let after = |millis| T0 + Duration::from_millis(millis);
    assert_eq!(model.motion.freshness(after(100)), Freshness::Fresh);
    assert_eq!(model.motion.freshness(after(101)), Freshness::Stale);
    let view = serde_json::to_value(model.view(after(101))).unwrap();
    assert_eq!(view["motion"]["freshness"], "stale");
    assert_eq!(view["motion"]["age"], 0.101);
    assert_eq!(view["motion"]["value"]["homed"], true);
    assert_eq!(view["power"]["value"], serde_json::Value::Null);
}

#[test]
fn errors_of_a_kind_are_one_group_that_stands_until_its_end() {
    let mut errors = Errors::default();
    for (n, severity) in [Error::ERROR, Error::ERROR, Error::NOTICE].into_iter().enumerate() {
        errors.hear(T0, &error(0x201, severity, "lost", n as i64));
        let groups = errors.groups();
        assert_eq!((groups.len(), groups[0].standing), (1, severity != Error::NOTICE));
    }
    let group = errors.groups()[0].clone();
    assert_eq!((group.count, group.first, group.last, group.severity), (2, 0, 1, Error::ERROR));
    assert!(errors.of("driver_canbus").is_none());
    for number in 0..1000 {
        errors.hear(T0 + Duration::from_millis(number as u64), &error(number, Error::WARNING, "x", 0));
    }
    assert_eq!((errors.groups().len(), errors.reports().count()), (256, 500));
}

#[test]
fn a_channel_has_its_rate_and_there_are_so_many_at_most() {
    let mut traffic = Traffic::default();
    for n in 0..200 {
        traffic.hear(T0 + Duration::from_millis(n * 50), "LL_DATA_MOTION", 100);
    }
    let row = &traffic.rows(T0 + Duration::from_millis(9_950))[0];
    assert!((row.rate - 20.0).abs() < 0.5 && (row.bandwidth - 2000.0).abs() < 50.0, "{row:?}");
    assert_eq!((row.r#type, row.count), (Channel::LlDataMotion.type_name(), 200));
    let silent = &traffic.rows(T0 + Duration::from_secs(60))[0];
    assert_eq!((silent.rate, silent.count), (0.0, 200));
    for n in 0..2000 {
        traffic.hear(T0, &format!("C{n}"), 1);
    }
    assert_eq!((traffic.rows(T0).len(), traffic.others()), (1000, 1001));
}

#[test]
fn who_only_announces_himself_is_a_stranger() {
    let mut model = model();
    say(&mut model, T0, DataState { timestamp: 1, module: "listen.py".into(), state: DataState::RUN });
    say(&mut model, T0, process(Process::RUNNING, DataState::ERROR, 0));
    let rows = model.modules(T0);
    assert_eq!(
        rows.iter().map(|row| (row.phase, row.well)).collect::<Vec<_>>(),
        [("running", false), ("stranger", true)]
    );
    assert_eq!(exit_in_words(0x21), "a device failed (0x21)");
    assert_eq!(exit_in_words(137), "SIGKILL: it was killed");
    assert_eq!(exit_in_words(128 + 40), "signal 40");
}

#[test]
fn an_ellipse_lies_along_what_is_least_known() {
    let ellipse = Ellipse::of(&[[0.04, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0001]]).unwrap();
    assert!((ellipse.long - 0.4).abs() < 1e-12 && (ellipse.short - 0.2).abs() < 1e-12 && ellipse.angle == 0.0);
    assert_eq!(Ellipse::of(&[[f64::NAN; 3]; 3]), None);
    assert_eq!(Ellipse::of(&[[-1.0; 3]; 3]), None);
}
