use super::*;
use base::{Duration, Instant};
use messages::common::{DataFaults, DataProcesses, DataState, Error, EventText, Fault, Process};
use messages::lowlevel::{self, DataHold, DataMotion, DataVelocity, EventStop};
use messages::middlelevel::DataGoal;
use messages::{Channel, Hold, Message, simulation};

const T0: Instant = Instant::from_millis(10_000);

fn model() -> Model {
    Model::new(Config { robot: "advee".into(), critical: vec!["driver_canbus".into()], simulated: true })
}

fn say(model: &mut Model, at: Instant, message: impl Into<Message>) {
    let message = message.into();
    model.receive(at, &message.channel_name(), 40, Some(message));
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

fn holds(module: &str, causes: &[(Hold, &str)]) -> DataHold {
    let row = |&(hold, subject): &(Hold, &str)| lowlevel::Hold {
        code: hold.code(),
        subject: subject.into(),
        latched: hold.is_latched(),
        since: 7,
    };
    DataHold { timestamp: 1, module: module.into(), holds: causes.iter().map(row).collect() }
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
fn beside_a_simulation_that_is_slow_values_age_by_its_time() {
    let clock = |rate| simulation::DataClock { timestamp: 1, rate };
    let after = |seconds: f64| T0 + Duration::from_secs_f64(seconds);
    let mut model = model();
    let words = |model: &Model, now: Instant| {
        let concerns: Vec<String> = model.concerns(now).into_iter().map(|concern| concern.words).collect();
        (model.status(now).reason, concerns)
    };
    say(&mut model, T0, process(Process::RUNNING, DataState::RUN, 0));
    say(&mut model, T0, motion(0.5, "", "planner"));
    say(&mut model, T0, holds("driver_canbus", &[]));
    say(&mut model, T0, clock(0.05));
    let now = model.at(after(1.0));
    assert_eq!(now, after(0.05));
    assert_eq!(words(&model, now), ("0.50 m/s; commanded by planner".into(), vec!["simulation at 0.05 ×".into()]));
    say(&mut model, after(1.0), clock(0.0));
    say(&mut model, after(2.0), clock(0.0));
    let now = model.at(after(3.0));
    assert_eq!(words(&model, now), ("simulation paused".into(), vec![]));
    assert_eq!(model.motion.fresh(now).map(|motion| motion.speed), Some(0.5));
    // One that has ended is silent.
    let now = model.at(after(6.0));
    assert_eq!((now, model.status(now).word), (after(1.55), RobotStatus::Silent));

    // A robot that is no simulation never stands still so.
    let mut real = Model::new(Config::default());
    say(&mut real, T0, motion(0.5, "", "planner"));
    say(&mut real, T0, clock(0.0));
    assert_eq!((real.at(after(2.0)), words(&real, T0).1), (after(2.0), vec![]));
    assert_eq!(real.status(after(2.0)).word, RobotStatus::Silent);
}

#[test]
fn the_status_shows_the_most_important_cause_first() {
    let mut model = model();
    let word = |model: &Model, now| {
        let Status { word, reason } = model.status(now);
        (word, reason)
    };
    assert_eq!(word(&model, T0).0, RobotStatus::Silent);
    say(&mut model, T0, process(Process::RUNNING, DataState::RUN, 0));
    assert_eq!(word(&model, T0), (RobotStatus::Fault, "driver_canbus does not report the drives".into()));
    let idle = motion(0.0, "nobody commands the motion", "");
    say(&mut model, T0, holds("driver_canbus", &[(Hold::NobodyCommands, "")]));
    say(&mut model, T0, DataMotion { enabled: false, quick_stop: true, ..idle });
    assert_eq!(word(&model, T0), (RobotStatus::Ready, "the robot is at standstill without a command".into()));
    say(&mut model, T0, holds("driver_canbus", &[]));
    say(&mut model, T0, motion(0.4, "", "planner"));
    assert_eq!(word(&model, T0), (RobotStatus::Driving, "0.40 m/s; commanded by planner".into()));
    let velocity = |vy, omega| DataVelocity { vy, omega, ..DataVelocity::default() };
    for (speed, vy, omega, words) in [
        (0.3, 0.4, 0.0, "0.50 m/s; commanded by planner"),
        (0.0, -0.2, 0.0, "0.20 m/s; commanded by planner"),
        (0.0, 0.0, -0.35, "turns on the spot at 20 deg/s; commanded by planner"),
    ] {
        say(&mut model, T0, motion(speed, "", "planner"));
        say(&mut model, T0, velocity(vy, omega));
        assert_eq!(word(&model, T0), (RobotStatus::Driving, words.into()));
    }
    say(&mut model, T0, velocity(0.0, 0.0));
    for (source, words) in [("web:Jana", "Jana (web)"), ("diag:6323", "a terminal (advee diag)")] {
        say(&mut model, T0, motion(0.4, "", source));
        assert_eq!((word(&model, T0).1, model.driver()), (format!("0.40 m/s; commanded by {words}"), words.into()));
    }
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
    assert_eq!(word(&model, T0), (RobotStatus::Waiting, "waits: somebody is in the way".into()));
    say(&mut model, T0, DataMotion { homed: false, ..motion(0.0, "the steering is not homed", "") });
    assert_eq!(word(&model, T0), (RobotStatus::Stopped, "the steering is not homed".into()));
    say(&mut model, T0, process(Process::TERMINATED, DataState::RUN, 139));
    let down = "driver_canbus is down: SIGSEGV: crashed; the robot does not move without it";
    assert_eq!(word(&model, T0), (RobotStatus::Fault, down.into()));
    say(&mut model, T0, EventStop { timestamp: 1, engaged: true, source: "bumper3".into() });
    let paused = "the PAUSE line is engaged by bumper 3; release it, then resume";
    assert_eq!(word(&model, T0), (RobotStatus::Paused, paused.into()));
    assert_eq!(
        word(&model, T0 + Duration::from_millis(2500)),
        (RobotStatus::Silent, "no message from the robot for 2 s".into())
    );
}

#[test]
fn another_sentence_for_the_same_cause_changes_no_status() {
    let status = |cause: Hold, reason: &str| {
        let mut model = model();
        say(&mut model, T0, process(Process::RUNNING, DataState::RUN, 0));
        say(&mut model, T0, holds("driver_canbus", &[(cause, "steering")]));
        say(&mut model, T0, DataMotion { enabled: false, quick_stop: true, ..motion(0.0, reason, "") });
        model.status(T0).word
    };
    for reason in ["nobody commands the motion", "no source commands", ""] {
        assert_eq!(status(Hold::NobodyCommands, reason), RobotStatus::Ready, "{reason:?}");
        assert_eq!(status(Hold::DriveFault, reason), RobotStatus::Stopped, "{reason:?}");
    }
}

#[test]
fn each_cause_has_one_row_the_motion_first() {
    let mut model = model();
    let goal = [(Hold::PauseBumper, "bumper2"), (Hold::EstimateLost, "")];
    say(&mut model, T0, holds("planner", &goal));
    say(&mut model, T0, holds("driver_canbus", &[(Hold::PauseBumper, "bumper2"), (Hold::NotReleased, "web")]));
    let rows = model.hold_rows(T0);
    let told: Vec<_> = rows.iter().map(|row| (row.module.as_str(), row.code, row.words.as_str())).collect();
    let expected = [
        ("driver_canbus", 111, "PAUSE is engaged by bumper2"),
        ("driver_canbus", 405, "web must send zero first: the robot was stopped"),
        ("planner", 502, "the estimator is lost"),
    ];
    assert_eq!(told, expected);
    let json = serde_json::to_value(model.view(T0)).unwrap();
    let first = serde_json::json!({
        "module": "driver_canbus", "code": 111, "name": "PauseBumper", "subject": "bumper2", "who": "bumper 2",
        "words": "PAUSE is engaged by bumper2", "remedy": "Clear what touches bumper 2.", "latched": false, "since": 7
    });
    assert_eq!((&json["holds"][0], &json["holds"][1]["latched"]), (&first, &true.into()));
    // Causes expire if they are not repeated.
    let late = T0 + Duration::from_millis(401);
    assert_eq!(model.hold_rows(late), []);
    let unknown = lowlevel::Hold { code: 9999, subject: "x".into(), latched: false, since: 0 };
    say(&mut model, late, DataHold { timestamp: 1, module: "driver_canbus".into(), holds: vec![unknown; 500] });
    let rows = model.hold_rows(late);
    assert_eq!((rows.len(), rows[0].name, rows[0].words.contains("9999")), (1, "", true));
    let many = |n: i32| lowlevel::Hold { code: n, subject: String::new(), latched: false, since: 0 };
    say(&mut model, late, DataHold { timestamp: 1, module: "x".into(), holds: (0..5000).map(many).collect() });
    assert_eq!(model.hold_rows(late).len(), 64, "the bus is hostile input");
}

#[test]
fn a_log_from_before_the_numbers_has_its_text() {
    let mut model = model();
    say(&mut model, T0, motion(0.0, "the watchdog is not heard", ""));
    let rows = model.hold_rows(T0);
    assert_eq!((rows.len(), rows[0].code, rows[0].words.as_str()), (1, 0, "the watchdog is not heard"));
    assert_eq!(rows[0].since, None);
    say(&mut model, T0, holds("driver_canbus", &[]));
    assert_eq!(model.hold_rows(T0), []);
}

#[test]
fn a_value_older_than_twice_its_period_is_stale() {
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
fn reports_of_a_fault_are_one_group_until_it_is_cleared() {
    let mut errors = Errors::default();
    for (n, severity) in [Error::ERROR, Error::ERROR, Error::NOTICE].into_iter().enumerate() {
        errors.on_report(T0, &error(0x201, severity, "lost", n as i64));
        let groups = errors.groups(T0);
        assert_eq!((groups.len(), groups[0].standing), (1, severity != Error::NOTICE));
    }
    let group = errors.groups(T0)[0].group.clone();
    assert_eq!((group.count, group.first, group.last, group.severity), (2, 0, 1, Error::ERROR));
    assert!(errors.of("driver_canbus", T0).is_none());
    for number in 0..1000 {
        errors.on_report(T0 + Duration::from_millis(number as u64), &error(number, Error::WARNING, "x", 0));
    }
    assert_eq!((errors.groups(T0).len(), errors.reports().count()), (256, 500));
}

#[test]
fn a_cleared_fault_shows_its_cause_beside_its_end() {
    let mut model = model();
    let shown = |model: &Model| {
        let groups = model.errors.groups(T0);
        (groups[0].standing, groups[0].cause.clone(), groups[0].message.clone())
    };
    say(&mut model, T0, error(0x0205, Error::ERROR, "emergency 0x8130", 1));
    say(&mut model, T0, error(0x0205, Error::NOTICE, "fault reset", 2));
    assert_eq!(shown(&model), (false, "emergency 0x8130".into(), "fault reset".into()));
    // The same of a module that lists its faults.
    let mut model = self::model();
    let fault = Fault { message: "emergency 0x8130".into(), ..fault(0x0205, "propulsion", 1) };
    say(&mut model, T0, list(1, "driver_canbus", &[fault]));
    say(&mut model, T0, error(0x0205, Error::NOTICE, "fault reset", 2));
    say(&mut model, T0, list(3, "driver_canbus", &[]));
    assert_eq!((shown(&model).0, shown(&model).1), (false, "emergency 0x8130".into()));
}

#[test]
fn a_fault_is_shown_once_without_the_reason_that_follows_from_it() {
    let mut model = model();
    let stopped = |model: &mut Model, reason: &str| {
        say(model, T0, DataMotion { enabled: false, ..motion(0.0, reason, "") });
        model.status(T0).reason
    };
    say(&mut model, T0, process(Process::RUNNING, DataState::ERROR, 0));
    say(&mut model, T0, DataState { timestamp: 1, module: "driver_canbus".into(), state: DataState::ERROR });
    say(&mut model, T0, error(0x0201, Error::ERROR, "propulsion drive (node 1) cannot be booted; tried again", 1));
    let fault = "propulsion drive (node 1) cannot be booted; tried again";
    assert_eq!(stopped(&mut model, "propulsion drive (node 1) cannot be booted"), fault);
}

#[test]
fn a_channel_has_its_rate_and_the_table_is_bounded() {
    let mut traffic = Traffic::default();
    for n in 0..200 {
        traffic.count(T0 + Duration::from_millis(n * 50), "LL_DATA_MOTION", 100);
    }
    let row = &traffic.rows(T0 + Duration::from_millis(9_950))[0];
    assert!((row.rate - 20.0).abs() < 0.5 && (row.bandwidth - 2000.0).abs() < 50.0, "{row:?}");
    assert_eq!((row.r#type, row.count), (Channel::LlDataMotion.type_name(), 200));
    let silent = &traffic.rows(T0 + Duration::from_secs(60))[0];
    assert_eq!((silent.rate, silent.count), (0.0, 200));
    for n in 0..2000 {
        traffic.count(T0, &format!("C{n}"), 1);
    }
    assert_eq!((traffic.rows(T0).len(), traffic.others()), (1000, 1001));
}

#[test]
fn a_module_without_a_watchdog_is_a_stranger() {
    let mut model = model();
    say(&mut model, T0, DataState { timestamp: 1, module: "listen.py".into(), state: DataState::RUN });
    say(&mut model, T0, process(Process::RUNNING, DataState::ERROR, 0));
    let rows = model.modules(T0);
    assert_eq!(
        rows.iter().map(|row| (row.phase, row.well)).collect::<Vec<_>>(),
        [("running", false), ("stranger", true)]
    );
    // A tool that has ended is no module that fails.
    let later = T0 + Duration::from_secs(31);
    say(&mut model, later, process(Process::RUNNING, DataState::ERROR, 0));
    assert_eq!(model.modules(later).len(), 1);
    assert_eq!(exit_in_words(0x21), "a device failed (0x21)");
    assert_eq!(exit_in_words(0x14), "a resource is unavailable (0x14): its server stood still");
    assert_eq!(exit_in_words(0x41), "failed (0x41): a defect of the program, at the place in its last line");
    assert_eq!(exit_in_words(137), "SIGKILL: killed");
    assert_eq!(exit_in_words(128 + 40), "signal 40");
}

#[test]
fn an_ellipse_extends_along_the_largest_uncertainty() {
    let ellipse = Ellipse::of(&[[0.04, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0001]]).unwrap();
    assert!((ellipse.long - 0.4).abs() < 1e-12 && (ellipse.short - 0.2).abs() < 1e-12 && ellipse.angle == 0.0);
    assert_eq!(Ellipse::of(&[[f64::NAN; 3]; 3]), None);
    assert_eq!(Ellipse::of(&[[-1.0; 3]; 3]), None);
}

const LOST: i32 = 0x0102;

fn fault(number: i32, subject: &str, since: i64) -> Fault {
    let message = format!("{subject} does not answer");
    Fault { number, subject: subject.into(), severity: Error::WARNING, since, message }
}

fn list(timestamp: i64, module: &str, faults: &[Fault]) -> DataFaults {
    DataFaults { timestamp, module: module.into(), faults: faults.to_vec() }
}

fn lost(timestamp: i64, severity: i8, message: &str) -> Error {
    Error { module: "driver_rs485a".into(), ..error(LOST, severity, message, timestamp) }
}

fn ms(millis: u64) -> Instant {
    T0 + Duration::from_millis(millis)
}

/// Groups as (subject, standing, known, count).
fn groups(model: &Model, now: Instant) -> Vec<(String, bool, bool, u64)> {
    let groups = model.errors.groups(now).into_iter();
    let mut groups: Vec<_> =
        groups.map(|shown| (shown.subject.clone(), shown.standing, shown.known, shown.count)).collect();
    groups.sort();
    groups
}

#[test]
fn of_two_lost_boards_one_that_comes_back_does_not_clear_the_other() {
    let mut model = model();
    let both = [fault(LOST, "sd1_front", 10), fault(LOST, "sd1_rear", 10)];
    say(&mut model, T0, list(10, "driver_rs485a", &both));
    // In an order other than that of the list.
    say(&mut model, T0, lost(10, Error::WARNING, "sd1_rear does not answer"));
    say(&mut model, T0, lost(10, Error::WARNING, "sd1_front does not answer"));
    let stands = |subject: &str, standing, count| (subject.to_owned(), standing, true, count);
    assert_eq!(groups(&model, T0), [stands("sd1_front", true, 1), stands("sd1_rear", true, 1)]);
    say(&mut model, ms(500), list(20, "driver_rs485a", &both[1..]));
    say(&mut model, ms(500), lost(20, Error::NOTICE, "sd1_front answers again"));
    assert_eq!(groups(&model, ms(500)), [stands("sd1_front", false, 1), stands("sd1_rear", true, 1)]);
    assert_eq!(model.errors.of("driver_rs485a", ms(500)).unwrap().subject, "sd1_rear");
    let subjects: Vec<_> = model.errors.reports().map(|report| report.subject.clone().unwrap()).collect();
    assert_eq!(subjects, ["sd1_front", "sd1_front", "sd1_rear"], "the latest first");
    // It is lost once more: counted, also by its list alone, in case the report is lost.
    say(&mut model, ms(600), list(30, "driver_rs485a", &[fault(LOST, "sd1_front", 30), both[1].clone()]));
    assert_eq!(groups(&model, ms(600)), [stands("sd1_front", true, 2), stands("sd1_rear", true, 1)]);
    let view = serde_json::to_value(model.view(ms(600))).unwrap();
    let group = view["errors"].as_array().unwrap().iter().find(|group| group["subject"] == "sd1_rear").unwrap();
    assert_eq!((&group["standing"], &group["known"], &group["number"]), (&true.into(), &true.into(), &LOST.into()));
}

#[test]
fn a_late_listener_knows_the_active_faults_only() {
    let mut model = model();
    say(&mut model, T0, list(900, "driver_rs485a", &[fault(LOST, "sd1_front", 10), fault(LOST, "sd1_rear", 20)]));
    say(&mut model, T0, list(900, "planner", &[]));
    let stands = |subject: &str| (subject.to_owned(), true, true, 1);
    assert_eq!(groups(&model, T0), [stands("sd1_front"), stands("sd1_rear")]);
    let active = |module: &str, now| model.errors.active(module, now);
    assert_eq!([active("driver_rs485a", T0), active("planner", T0), active("estimator", T0)], [Some(2), Some(0), None]);
    assert_eq!([active("driver_rs485a", ms(3001)), active("planner", ms(3001))], [None, None], "too old");
}

#[test]
fn an_expired_list_leaves_faults_unknown() {
    let mut model = model();
    say(&mut model, T0, list(10, "driver_rs485a", &[fault(LOST, "sd1_rear", 10)]));
    let group = |standing, known| vec![("sd1_rear".to_owned(), standing, known, 1)];
    assert_eq!(groups(&model, ms(3000)), group(true, true));
    assert_eq!(groups(&model, ms(3001)), group(true, false), "its module is silent");
    say(&mut model, ms(4000), list(20, "driver_rs485a", &[fault(LOST, "sd1_rear", 10)]));
    assert_eq!(groups(&model, ms(4000)), group(true, true), "the same as before, so it is not counted");
    // The module dies: the watchdog publishes a list in its name.
    let down = |timestamp| list(timestamp, "driver_rs485a", &[fault(0x0307, "driver_rs485a", 30)]);
    say(&mut model, ms(4100), down(30));
    assert_eq!(groups(&model, ms(4100)), group(true, false));
    assert_eq!(model.errors.knowledge("driver_rs485a", ms(4100)), Knowledge::Unknown);
    // The module is back, and so is its board.
    say(&mut model, ms(4200), list(40, "driver_rs485a", &[]));
    assert_eq!(groups(&model, ms(4200)), group(false, true));
}

#[test]
fn a_module_without_a_list_is_judged_by_its_reports_and_single_events_are_never_active() {
    let mut model = model();
    say(&mut model, T0, lost(10, Error::WARNING, "a board is lost"));
    let group = |standing, count| vec![(String::new(), standing, true, count)];
    assert_eq!(groups(&model, ms(60_000)), group(true, 1));
    // The watchdog's list applies while the module is down, and no longer.
    say(&mut model, ms(60_000), list(15, "driver_rs485a", &[fault(0x0307, "driver_rs485a", 15)]));
    assert_eq!(model.errors.knowledge("driver_rs485a", ms(60_000)), Knowledge::Unknown);
    assert_eq!(model.errors.knowledge("driver_rs485a", ms(63_001)), Knowledge::Reported);
    say(&mut model, ms(64_000), lost(20, Error::NOTICE, "it is back"));
    assert_eq!(groups(&model, ms(64_000)), group(false, 1));
    // From its first list on, the list decides.
    say(&mut model, ms(65_000), lost(30, Error::WARNING, "a board is lost"));
    assert_eq!(groups(&model, ms(65_000)), group(true, 2));
    say(&mut model, ms(65_000), list(40, "driver_rs485a", &[]));
    assert_eq!(groups(&model, ms(65_000)), group(false, 2));
    say(&mut model, ms(65_000), lost(50, Error::WARNING, "it happened once"));
    assert_eq!(groups(&model, ms(65_000)), group(false, 3));
}

#[test]
fn all_lists_are_bounded() {
    let mut model = model();
    for n in 0..600 {
        let faults: Vec<Fault> = (0..300).map(|number| fault(number, &format!("{n}"), 1)).collect();
        say(&mut model, ms(n), list(1, &format!("module {n}"), &faults));
        say(&mut model, ms(n), EventText { text: "x".repeat(10_000), ..EventText::default() });
    }
    assert_eq!(model.errors.groups(T0).len(), 256);
    assert_eq!(model.texts.latest().count(), 500);
    assert!(model.texts.latest().all(|text| text.text.len() <= 512));
    assert_eq!(model.errors.knowledge("module 599", ms(599)), Knowledge::Reported, "there are too many modules");
}

#[test]
fn texts_are_listed_newest_first_with_their_level() {
    let mut model = model();
    for (n, level) in [EventText::INFO, EventText::ERROR, 77].into_iter().enumerate() {
        let text = EventText { timestamp: n as i64, module: "eye".into(), level, text: format!("line {n}\n") };
        say(&mut model, T0, text);
    }
    let texts: Vec<_> = model.texts.latest().map(|text| (text.level(), text.text.as_str())).collect();
    assert_eq!(texts, [("?", "line 2 "), ("ERROR", "line 1 "), ("INFO", "line 0 ")]);
    assert_eq!(serde_json::to_value(model.view(T0)).unwrap()["texts"][0]["module"], "eye");
}

#[test]
fn readings_show_unknown_and_fall_back_to_the_view_of_2011() {
    use lowlevel::{DataIrs, DataRanges, DataSrfs, Range, Reading};
    let mut model = model();
    assert_eq!(model.sonar_readings(T0, 0.5), None);
    let range = |id, distance: f64| Range { id, distance, valid: distance.is_finite(), ..Default::default() };
    let srfs = DataSrfs { timestamp: 1, srfs: vec![range(0, 1.5), range(1, f64::NAN)] };
    say(&mut model, T0, srfs.clone());
    say(&mut model, T0, DataIrs { timestamp: 1, irs: vec![range(0, 0.12)] });
    let statuses = |model: &Model, now| {
        let sonars = model.sonar_readings(now, 0.5).unwrap();
        (sonars.of_2011, sonars.readings.iter().map(|reading| (reading.status, reading.beam)).collect::<Vec<_>>())
    };
    assert_eq!(statuses(&model, T0), (true, vec![(Reading::MEASURED, 0.5), (Reading::UNKNOWN, 0.5)]));
    let reading = |kind, status| Reading { kind, status, beam: 0.96, ..Default::default() };
    let readings = vec![reading(Reading::SONAR, Reading::SILENT), reading(Reading::INFRARED, Reading::MEASURED)];
    say(&mut model, T0, DataRanges { timestamp: 1, readings });
    assert_eq!(statuses(&model, T0), (false, vec![(Reading::SILENT, 0.96)]));
    assert_eq!(model.infrared_readings(T0).unwrap().readings.len(), 1);
    let later = T0 + Duration::from_secs(2);
    assert!(!statuses(&model, later).0, "neither comes");
    say(&mut model, later, srfs);
    assert!(statuses(&model, later).0, "only that of 2011 comes");
}

fn guard(forward: f64, backward: f64, code: Hold, subject: &str) -> lowlevel::DataGuard {
    let field = |kind| lowlevel::Field { kind, occupied: false, x: vec![0.0, 1.0, 1.0], y: vec![0.0, 0.0, 1.0] };
    let fields = vec![field(lowlevel::Field::PROTECTIVE), field(lowlevel::Field::WARNING)];
    lowlevel::DataGuard { forward, backward, code: code.code(), subject: subject.into(), fields, ..Default::default() }
}

#[test]
fn the_bound_is_that_of_the_direction_of_travel_with_its_cause() {
    let words = |speed: f64, guard: lowlevel::DataGuard| {
        let mut model = model();
        say(&mut model, T0, motion(speed, "", "web:Jana"));
        say(&mut model, T0, guard);
        model.bound(T0).unwrap().words
    };
    let near = guard(0.32, 0.8, Hold::GuardStops, "sonar 3");
    assert_eq!(words(0.3, near.clone()), "at most 0.32 m/s forward: sonar 3");
    assert_eq!(words(-0.3, near.clone()), "at most 0.80 m/s backward: sonar 3");
    assert_eq!(words(0.0, near), "at most 0.32 m/s forward: sonar 3");
    assert_eq!(words(0.0, guard(0.3, 0.0, Hold::GuardSlows, "sonar 12")), "must not move backward: sonar 12");
    let unknown = guard(f64::NAN, 0.2, Hold::GuardUnknown, "sonar 2");
    assert_eq!(words(0.1, unknown), "must not move forward: nothing is known of sonar 2");
    assert_eq!(words(0.1, guard(0.3, 0.3, Hold::GuardBlind, "")), "at most 0.30 m/s forward: no sensor looks there");
    assert_eq!(
        words(0.1, guard(0.0, 0.0, Hold::GuardMotion, "")),
        "must not move forward: the guard does not know the motion"
    );
    let free = lowlevel::DataGuard { code: 0, ..guard(0.66, 0.66, Hold::GuardStops, "") };
    assert_eq!(words(0.1, free), "at most 0.66 m/s forward");
    let later = lowlevel::DataGuard { code: 719, ..guard(0.2, 0.66, Hold::GuardStops, "") };
    assert_eq!(words(0.1, later), "at most 0.20 m/s forward: cause 719");
}

#[test]
fn without_a_guard_there_is_no_bound_and_a_silent_one_permits_nothing() {
    let mut model = model();
    say(&mut model, T0, motion(0.3, "", "web:Jana"));
    assert_eq!(model.bound(T0), None);
    say(&mut model, T0, guard(0.32, 0.8, Hold::GuardStops, "sonar 3"));
    let bound = model.bound(T0).unwrap();
    assert!((bound.speed, bound.limits, bound.creeping) == (0.32, true, false));
    assert_eq!(model.bound(T0 + Duration::from_millis(150)).unwrap().speed, 0.32);
    let silent = model.bound(T0 + Duration::from_millis(151)).unwrap();
    assert!((silent.words.as_str(), silent.speed, silent.limits) == ("the guard does not report", 0.0, true));
    let free = lowlevel::DataGuard { code: 0, ..guard(0.66, 0.66, Hold::GuardStops, "") };
    say(&mut model, T0, free);
    assert!(!model.bound(T0).unwrap().limits, "the reach of the sensors is nobody in the way");
}

#[test]
fn a_creeping_robot_says_so_with_the_bound_that_it_passes() {
    let mut model = model();
    say(&mut model, T0, guard(0.0, 0.8, Hold::GuardStops, "sonar 3"));
    say(&mut model, T0, holds("driver_canbus", &[(Hold::GuardCreep, "web:Jana")]));
    let bound = model.bound(T0).unwrap();
    assert!(bound.creeping);
    assert_eq!(bound.words, "creeping; otherwise must not move forward: sonar 3");
}

#[test]
fn a_robot_that_its_guard_lets_stand_waits_and_says_for_what() {
    let mut model = model();
    let now = T0;
    say(&mut model, now, process(Process::RUNNING, DataState::RUN, 0));
    say(&mut model, now, motion(0.0, "", "web:Jana"));
    say(&mut model, now, holds("driver_canbus", &[]));
    assert_eq!(model.status(now).word, RobotStatus::Ready);
    say(&mut model, now, holds("driver_canbus", &[(Hold::GuardStops, "sonar 3")]));
    let status = model.status(now);
    assert_eq!((status.word, status.reason.as_str()), (RobotStatus::Waiting, "something is near: sonar 3"));
    // Slower than commanded it drives.
    say(&mut model, now, motion(0.1, "", "web:Jana"));
    assert_eq!(model.status(now).word, RobotStatus::Driving);
}

#[test]
fn of_the_fields_that_anybody_can_publish_only_a_few_sound_ones_are_kept() {
    let field = |x: Vec<f64>, y: Vec<f64>| lowlevel::Field { kind: 0, occupied: true, x, y };
    let sound = field(vec![0.0, 1.0, 1.0], vec![0.0, 0.0, 1.0]);
    let fields = vec![
        field(vec![0.0; 2], vec![0.0; 2]),
        field(vec![0.0, f64::NAN, 1.0], vec![0.0; 3]),
        field(vec![0.0, 1.0, 101.0], vec![0.0; 3]),
        field(vec![0.0; 65], vec![0.0; 65]),
        field(vec![0.0; 3], vec![0.0; 4]),
        sound.clone(),
        field(vec![0.0; 64], vec![0.0; 64]),
    ];
    let kept = |fields: Vec<lowlevel::Field>| {
        let mut model = model();
        let message = lowlevel::DataGuard { fields, ..Default::default() };
        model.receive(T0, "LL_DATA_GUARD", 40, Some(message.into()));
        model.guard.get().unwrap().fields.len()
    };
    assert_eq!((kept(fields), kept(vec![sound; 1000])), (2, 10));
}

#[test]
fn a_source_that_sends_both_messages_is_shown_once_by_its_newer_command() {
    let mut model = model();
    let motion = lowlevel::CmdMotion { speed: 0.4, priority: 1, source: "op".into(), ..Default::default() };
    let velocity = lowlevel::CmdVelocity { vx: 0.3, priority: 1, source: "op".into(), ..Default::default() };
    let sources = |model: &Model, now| (model.commands(now).count(), model.velocity_commands(now).count());
    say(&mut model, T0, motion.clone());
    assert_eq!(sources(&model, T0), (1, 0));
    say(&mut model, T0, velocity.clone());
    assert_eq!(model.velocity_commands(T0).next(), Some(&velocity));
    assert_eq!(sources(&model, T0), (0, 1));
    say(&mut model, T0, lowlevel::CmdMotion { source: "pad".into(), ..motion.clone() });
    assert_eq!(sources(&model, T0), (1, 1));
    say(&mut model, T0, motion);
    assert_eq!(sources(&model, T0), (2, 0));
    assert_eq!(sources(&model, T0 + Duration::from_secs(1)), (0, 0), "they are silent");
}

#[test]
fn each_inertial_measurement_unit_has_its_last_message_and_their_number_is_bounded() {
    let mut model = model();
    let imu = |name: &str, up: f64| lowlevel::DataImu {
        name: name.into(),
        acceleration: [0.0, 0.0, up],
        ..lowlevel::DataImu::default()
    };
    for (name, up) in [("front", 1.0), ("base", 9.8), ("front", 9.7)] {
        say(&mut model, T0, imu(name, up));
    }
    let shown: Vec<_> =
        model.imus().map(|slot| slot.get().map(|imu| (imu.name.as_str(), imu.acceleration[2]))).collect();
    assert_eq!(shown, [Some(("base", 9.8)), Some(("front", 9.7))]);
    (0..1000).for_each(|n| say(&mut model, T0, imu(&n.to_string(), 9.8)));
    assert!(model.imus().count() <= 8);
}
