//! The screen and the keys, without a terminal.

use super::*;
use messages::common::{DataProcesses, Error};
use messages::lowlevel::{CmdMotion, DataMotion};
use messages::{Channel, Message, middlelevel};
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

const BODY: Body = Body { rear: -0.2, front: 0.75, half_width: 0.3, sonar_beam: 0.96 };

fn at(millis: u64) -> Instant {
    Instant::from_millis(50_000 + millis)
}

fn app(read_only: bool) -> App {
    let model = Model::new(Config { robot: "advee".into(), critical: vec!["driver_canbus".into()], simulated: true });
    App::new(Setup {
        model,
        drive: Drive::new(at(0), (0.5, 0.4)),
        session: 0,
        read_only,
        epoch: base::Epoch::default(),
        source: "diag:1".into(),
        nodes: vec![(1, "propulsion".into()), (2, "steering".into())],
        runs: Runs::of("/nowhere".into()),
        faults: vec![("fan1".into(), vec!["stall", "none"])],
    })
}

fn hear(app: &mut App, message: impl Into<Message>) {
    let message: Message = message.into();
    app.hear(at(0), &message.channel_name(), 64, Some(message));
}

fn press(app: &mut App, millis: u64, keys: &str) {
    for key in keys.chars() {
        let code = match key {
            '\n' => KeyCode::Enter,
            '\t' => KeyCode::Tab,
            '\u{1b}' => KeyCode::Esc,
            '↓' => KeyCode::Down,
            key => KeyCode::Char(key),
        };
        app.on_key(at(millis), KeyEvent::new(code, KeyModifiers::NONE));
    }
}

fn screen(app: &App, width: u16, height: u16) -> String {
    screen_at(app, width, height, 0)
}

fn screen_at(app: &App, width: u16, height: u16, millis: u64) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw::draw(frame, app, BODY, at(millis))).unwrap();
    let cells = terminal.backend().buffer().content();
    cells
        .chunks(usize::from(width))
        .map(|row| row.iter().map(ratatui::buffer::Cell::symbol).collect::<String>() + "\n")
        .collect()
}

#[test]
fn every_view_is_drawn_on_any_terminal_with_anything_heard_or_nothing() {
    let mut full = app(false);
    for channel in Channel::ALL {
        // Whatever a message is made of: zeros are one.
        for bytes in [
            channel.fingerprint().to_be_bytes().to_vec(),
            [&channel.fingerprint().to_be_bytes()[..], &[0; 400]].concat(),
        ] {
            if let Ok(message) = Message::decode(*channel, &bytes) {
                hear(&mut full, message);
            }
        }
    }
    hear(&mut full, DataProcesses::default());
    let nan = f64::NAN;
    hear(
        &mut full,
        DataMotion { speed: nan, steering: f64::INFINITY, reason: "\u{1b}[2Jx".repeat(50), ..DataMotion::default() },
    );
    hear(
        &mut full,
        middlelevel::DataEstimate { x: nan, covariance: [[nan; 3]; 3], quality: 100, ..Default::default() },
    );
    hear(&mut full, middlelevel::DataPlan { x: vec![nan, 1e300], y: vec![nan, -1e300], ..Default::default() });
    for app in [&mut app(false), &mut full] {
        for (width, height) in [(200, 60), (80, 24), (40, 10), (39, 9), (20, 5), (3, 30), (300, 2), (1, 1)] {
            for keys in
                ["1", "1\n", "2", "2\n", "3", "3\n", "4", "4\n", "5", "5\n", "6", "6\n", "?", "x", ":state a", "\u{1b}"]
            {
                press(app, 0, keys);
                let screen = screen(app, width, height);
                assert!(!screen.replace('\n', "").contains(draw::is_harmful), "{screen:?}");
            }
        }
    }
}

/// What could move a terminal's cursor, and texts without an end, wherever somebody may put a text.
fn hostile(app: &mut App) {
    let evil = |n: usize| {
        format!("\u{1b}]0;e\u{ad}v\u{200d}il{n}\u{7}\u{9b}2J\u{202e}\u{200b}\r\n\t{}", "long ".repeat(2_000))
    };
    for n in 0..40 {
        let module = evil(n);
        hear(app, messages::common::DataState { module: module.clone(), state: 1, ..Default::default() });
        hear(
            app,
            Error {
                module: module.clone(),
                message: evil(n),
                severity: 2,
                number: n as i32,
                file: evil(n),
                ..Error::default()
            },
        );
        let node =
            messages::lowlevel::Node { name: evil(n), requests: i64::MIN, round_trip_max: 1e300, ..Default::default() };
        hear(app, messages::lowlevel::DataBus { bus: evil(n), nodes: vec![node; 50], state: -7, ..Default::default() });
    }
    let axis = messages::lowlevel::Axis {
        name: evil(0),
        nmt_state: -128,
        statusword: -1,
        error_code: i32::MIN,
        ..Default::default()
    };
    hear(app, messages::lowlevel::DataAxes { axes: vec![axis; 50], ..Default::default() });
    let processes = vec![
        messages::common::Process {
            module: evil(1),
            uptime: f64::NAN,
            cpu: -1e300,
            rss: i64::MIN,
            last_exit: i32::MIN,
            ..Default::default()
        };
        50
    ];
    hear(app, DataProcesses { processes, ..Default::default() });
    let channels =
        vec![messages::lowlevel::Channel { name: evil(2), current: f64::INFINITY, ..Default::default() }; 50];
    hear(app, messages::lowlevel::DataPower { channels, remaining: -1.0, ..Default::default() });
    hear(app, messages::common::DataLog { run: evil(3), recording: true, bytes: i64::MIN, ..Default::default() });
    hear(app, DataMotion { source: evil(4), reason: evil(5), speed: f64::NAN, ..Default::default() });
    hear(app, middlelevel::DataGoal { message: evil(6), status: 1, ..Default::default() });
    let fans = vec![messages::lowlevel::Fan { name: evil(7), failed: true, ..Default::default() }; 50];
    let temperatures = vec![messages::lowlevel::Temperature { name: evil(7), over: true, value: 1e300 }; 50];
    hear(app, messages::lowlevel::DataTemperature { temperatures, fans, ..Default::default() });
    let srfs =
        vec![messages::lowlevel::Range { theta: f64::NAN, distance: 1e-300, valid: true, ..Default::default() }; 5000];
    hear(app, messages::lowlevel::DataSrfs { srfs, ..Default::default() });
    let wild =
        messages::lowlevel::Reading { theta: f64::NAN, distance: 1e-300, status: 2, beam: 1e300, ..Default::default() };
    let readings = (0..5000).map(|n| messages::lowlevel::Reading { status: (n % 4) as i8, ..wild.clone() }).collect();
    hear(app, messages::lowlevel::DataRanges { readings, ..Default::default() });
    app.hear(at(0), &evil(8)[..60], 3, None);
}

#[test]
fn nothing_of_a_hostile_bus_reaches_the_terminal() {
    let mut app = app(false);
    hostile(&mut app);
    for (width, height) in [(160, 50), (80, 24), (20, 5)] {
        for keys in ["1", "\n", "2", "\n", "↓", "3", "↓\n", "4", "\n", "5", "\n", "6", "\n"] {
            press(&mut app, 0, keys);
            let screen = screen(&app, width, height);
            assert!(!screen.replace('\n', "").contains(draw::is_harmful), "{screen:?}");
        }
    }
    let json = serde_json::to_value(app.shown(at(0)).0.view(at(0))).unwrap();
    let told = harmless(&json.to_string());
    assert!(!told.contains(draw::is_harmful) && serde_json::from_str::<Value>(&told).unwrap() == json);
}

#[test]
fn json_is_printed_once_with_or_without_that_word() {
    let parse = |line: &str| crate::command().try_get_matches_from(line.split(' ')).map(drop);
    for line in ["--once", "--json", "--once --json", "--json --view errors --for 2", "--view logs"] {
        assert!(parse(&format!("advee diag {line}")).is_ok(), "{line}");
    }
    assert!(parse("advee diag --for 2").is_err());
}

#[test]
fn a_robot_that_is_ready_but_not_well_says_so_in_its_first_line() {
    let mut app = app(false);
    let motion = DataMotion { enabled: true, homed: true, ..DataMotion::default() };
    hear(&mut app, motion);
    assert!(screen(&app, 80, 24).starts_with(" READY  the robot is at standstill"));
    hear(&mut app, middlelevel::DataEstimate { quality: middlelevel::DataEstimate::SEARCHING, ..Default::default() });
    let first = screen(&app, 80, 24);
    assert!(first.starts_with(" READY  ! position lost \u{b7} the robot is at standstill"), "{first}");
}

#[test]
fn a_wide_terminal_shows_errors_and_modules_beside_the_overview() {
    let mut app = app(false);
    let process = messages::common::Process { module: "planner".into(), ..Default::default() };
    hear(&mut app, DataProcesses { processes: vec![process], ..Default::default() });
    hear(
        &mut app,
        Error { module: "driver_aux".into(), message: "a fan fails".into(), severity: 2, ..Error::default() },
    );
    let wide = screen(&app, 200, 60);
    assert!(wide.contains(" 4 errors ") && wide.contains("ACTIVE  ") && wide.contains("a fan fails"), "{wide}");
    assert!(wide.contains(" 2 modules ") && wide.contains("! planner"), "{wide}");
    let narrow = screen(&app, 120, 40);
    assert!(!narrow.contains(" 4 errors ") && !narrow.contains("a fan fails"), "{narrow}");
}

#[test]
fn the_first_line_says_why_however_small_the_screen() {
    let mut app = app(false);
    hear(&mut app, DataMotion { reason: "the steering is being homed".into(), ..DataMotion::default() });
    hear(&mut app, DataProcesses::default());
    for (width, height) in [(80, 24), (20, 5), (40, 10)] {
        let screen = screen(&app, width, height);
        let words: Vec<&str> = screen.split_whitespace().collect();
        assert!(screen.starts_with(" STOPPED") && words.join(" ").contains("the steering is being homed"), "{screen}");
    }
    // One that is longer than the line goes on in the next.
    hear(&mut app, DataMotion { reason: "why ".repeat(30) + "END", ..DataMotion::default() });
    assert!(screen(&app, 80, 24).lines().nth(1).unwrap().contains("END"));
}

#[test]
fn all_that_stands_against_acting_is_on_the_first_view() {
    let mut app = app(false);
    hear(&mut app, DataMotion { timestamp: 9_000_000, reason: "whatever".into(), ..DataMotion::default() });
    let hold = |code: i32, subject: &str, latched, since| messages::lowlevel::Hold {
        code,
        subject: subject.into(),
        latched,
        since,
    };
    let holds = vec![hold(111, "bumper2", false, 4_000_000), hold(405, "web:Jana", true, 8_000_000)];
    hear(&mut app, messages::lowlevel::DataHold { timestamp: 1, module: "driver_canbus".into(), holds });
    let holds = vec![hold(111, "bumper2", false, 1), hold(502, "", false, 9_000_000)];
    hear(&mut app, messages::lowlevel::DataHold { timestamp: 1, module: "planner".into(), holds });
    let screen = screen(&app, 150, 40);
    for told in [
        "held       5.0s PAUSE is engaged by bumper2 ",
        "           1.0s Jana (web) must send zero first: the robot",
        "                latched until commanded",
        "           0.0s the estimator is lost",
    ] {
        assert!(screen.contains(told), "{told}:\n{screen}");
    }
    assert_eq!(screen.matches("PAUSE is engaged by bumper2").count(), 1, "each once:\n{screen}");
    // A robot, or a log, from before the numbers.
    let mut old = self::app(false);
    hear(&mut old, DataMotion { reason: "the watchdog is not heard".into(), ..DataMotion::default() });
    let screen = self::screen(&old, 150, 40);
    assert!(screen.contains("- the watchdog is not heard"), "{screen}");
}

#[test]
fn the_bound_of_the_guard_is_one_line_with_its_cause() {
    let mut app = app(false);
    hear(&mut app, DataMotion { speed: 0.3, ..DataMotion::default() });
    let line = |app: &App, millis: u64| {
        let screen = screen_at(app, 150, 40, millis);
        screen.lines().find(|line| line.contains("guard ")).map(str::to_owned)
    };
    assert_eq!(line(&app, 0), None, "a robot without a guard");
    let guard = messages::lowlevel::DataGuard {
        forward: 0.32,
        backward: 0.8,
        code: messages::Hold::GuardStops.code(),
        subject: "sonar 3".into(),
        ..Default::default()
    };
    hear(&mut app, guard);
    let told = line(&app, 0).unwrap();
    assert!(told.contains("guard      0.0s at most 0.32 m/s forward: sonar 3 "), "{told}");
    let (code, subject) = (messages::Hold::GuardCreep.code(), "diag:1".into());
    let holds = vec![messages::lowlevel::Hold { code, subject, latched: false, since: 0 }];
    hear(&mut app, messages::lowlevel::DataHold { timestamp: 1, module: "driver_canbus".into(), holds });
    let told = line(&app, 0).unwrap();
    assert!(told.contains(" creeping; otherwise at most 0.32 m/s forward: sonar 3 "), "{told}");
    assert!(screen(&app, 150, 40).contains("bounded  "), "it does not stand");
    let told = line(&app, 300).unwrap();
    assert!(told.contains("!0.3s") && told.contains("the guard does not report"), "{told}");
}

#[test]
fn a_mark_stays_with_its_row_and_enter_tells_all_of_it() {
    let mut app = app(false);
    let process = |module: &str, cpu, restarts| messages::common::Process {
        module: module.into(),
        cpu,
        restarts,
        last_exit: 137,
        phase: messages::common::Process::RUNNING,
        pid: 4711,
        ..Default::default()
    };
    hear(&mut app, DataProcesses { processes: vec![process("a", 0.1, 0), process("b", 0.2, 3)], ..Default::default() });
    hear(
        &mut app,
        Error { module: "b".into(), message: "b is ill".into(), number: 0x0102, severity: 2, ..Error::default() },
    );
    press(&mut app, 0, "2↓");
    assert_eq!(app.marked_key(at(0)).as_deref(), Some("b"));
    press(&mut app, 0, "oo");
    let screen_now = screen(&app, 80, 24);
    assert!(screen_now.contains("order: cpu") && app.marked_key(at(0)).as_deref() == Some("b"), "{screen_now}");
    press(&mut app, 0, "\n");
    let screen_now = screen(&app, 80, 24);
    for told in ["SIGKILL", "restarts    3", "pid 4711", "b is ill", "20.0 % of a core"] {
        assert!(screen_now.contains(told), "{told}:\n{screen_now}");
    }
    press(&mut app, 0, "c");
    assert_eq!(app.mode, app::Mode::Command("state b ".into()));
    press(&mut app, 0, "P\t\n");
    assert!(
        matches!(&app.poll(at(0))[..], [Message::CmCmdState(command)] if command.module == "b" && command.state == 6),
        "PAUSE"
    );
    press(&mut app, 0, "4\n");
    let screen_now = screen(&app, 80, 24);
    assert!(screen_now.contains("0x0102 BoardLost") && screen_now.contains("count 1"), "{screen_now}");
}

#[test]
fn an_object_is_asked_for_and_its_answer_stands_on_the_screen() {
    let mut app = app(false);
    press(&mut app, 0, "3:sdo steering statusword\n");
    let sent = app.poll(at(0));
    let [Message::LlCmdSdo(asked)] = &sent[..] else { panic!("{sent:?}") };
    assert_eq!((asked.node, asked.index, asked.write), (2, 0x6041, false));
    let answer = messages::lowlevel::DataSdo {
        request: asked.request,
        node: 2,
        index: 0x6041,
        data: vec![0x37, 2],
        ..Default::default()
    };
    hear(&mut app, answer);
    let screen = screen(&app, 80, 24);
    let said = "node 2 0x6041 Statusword = 0x0237 operation enabled";
    assert_eq!(screen.matches(said).count(), 2, "in the list and below:\n{screen}");
}

#[test]
fn drives_are_told_in_words() {
    let mut app = app(false);
    let axis = |name: &str, nmt_state, statusword| messages::lowlevel::Axis {
        name: name.into(),
        nmt_state,
        statusword,
        ..Default::default()
    };
    let axes = vec![axis("propulsion", 5, 0x0237), axis("steering", 127, 0x0208), axis("third", -1, 0)];
    hear(&mut app, messages::lowlevel::DataAxes { axes, ..Default::default() });
    press(&mut app, 0, "3");
    let screen = screen(&app, 80, 24);
    for words in ["operational", "operation enabled", "pre-operational", "fault", "LOST"] {
        assert!(screen.contains(words), "{words}:\n{screen}");
    }
    let wheel =
        messages::lowlevel::Wheel { name: "propulsion".into(), load: 0.42, temperature: 51.4, ..Default::default() };
    hear(&mut app, messages::lowlevel::DataWheels { wheels: vec![wheel], ..Default::default() });
    let screen = self::screen(&app, 120, 24);
    assert!(screen.contains("42 %") && screen.contains("51 degC"), "{screen}");
}

#[test]
fn ages_are_told_and_what_is_stale_says_so_without_colour() {
    let mut app = app(false);
    hear(&mut app, middlelevel::DataEstimate { x: 1.0, ..Default::default() });
    app.hear(Instant::from_millis(46_000), "LL_DATA_MOTION", 9, Some(DataMotion::default().into()));
    let screen = screen(&app, 80, 24);
    assert!(screen.contains("position   0.0s 1.00") && screen.contains("speed     !4.0s"), "{screen}");
}

#[test]
fn what_is_pasted_is_no_keys() {
    let mut app = app(false);
    app.on_paste(at(0), "dhyq:state * TERMINATE\n");
    assert!(app.poll(at(0)).is_empty() && !app.quit && !app.drive.is_taken());
    press(&mut app, 0, ":");
    app.on_paste(at(0), "mark here\u{1b}");
    press(&mut app, 0, "\n");
    assert!(matches!(&app.poll(at(0))[..], [Message::CmCmdLog(mark)] if mark.text == "here"));
}

#[test]
fn a_terminal_that_stalled_gives_the_drive_back() {
    let mut app = app(false);
    press(&mut app, 0, "d");
    app.on_key(at(0), KeyEvent::new(KeyCode::Up, KeyModifiers::NONE));
    app.on_stall(at(10));
    app.on_key(at(20), KeyEvent::new(KeyCode::Up, KeyModifiers::NONE));
    let sent: Vec<Message> = (20..2000).flat_map(|ms| app.poll(at(ms))).collect();
    assert!(
        sent.len() == 10
            && sent.iter().all(|sent| matches!(sent, Message::LlCmdMotion(command) if command.speed == 0.0))
    );
}

#[test]
fn the_answer_to_a_command_is_told() {
    let mut app = app(false);
    let refusal = Error { module: "driver_power".into(), message: "no".into(), severity: 1, ..Error::default() };
    hear(&mut app, refusal.clone());
    assert!(app.said(at(0)).is_none(), "nobody asked");
    press(&mut app, 0, ":power motors off\n");
    hear(&mut app, refusal);
    assert_eq!(app.said(at(0)), Some("driver_power: no"));
}

#[test]
fn the_status_stands_first_on_a_small_screen_and_rows_can_be_filtered() {
    let mut app = app(false);
    hear(
        &mut app,
        Error { module: "driver_aux".into(), message: "the fan stands".into(), severity: 2, ..Error::default() },
    );
    hear(&mut app, Error { module: "planner".into(), message: "lost".into(), severity: 1, ..Error::default() });
    press(&mut app, 0, "4");
    let all = screen(&app, 80, 24);
    assert!(all.starts_with(" FAULT ") && all.contains("the fan stands") && all.contains("planner"), "{all}");
    press(&mut app, 0, "/aux\n");
    let some = screen(&app, 80, 24);
    assert!(some.contains("the fan stands") && !some.contains("planner"), "{some}");
}

#[test]
fn choices_that_have_no_room_are_told_to_be_there() {
    let mut app = app(false);
    let names = ["fan1", "fan2", "psc1", "propulsion", "steering", "gamepad", "robot", "sonar_front", "sonar_rear"];
    app.faults = names.iter().map(|name| ((*name).to_string(), vec!["none"])).collect();
    press(&mut app, 100, ":fault ");
    let foot = |width| {
        let screen = screen(&app, width, 24);
        screen.lines().last().unwrap_or_default().trim_end().to_string()
    };
    let all = format!(":fault \u{2588}   {}", names.join(" "));
    assert_eq!(foot(all.chars().count() as u16), all);
    assert_eq!(foot(80), ":fault \u{2588}   fan1 fan2 psc1 propulsion steering gamepad robot sonar_front …");
    assert_eq!(foot(48), ":fault \u{2588}   fan1 fan2 psc1 propulsion steering …");
    assert_eq!(foot(40), ":fault \u{2588}   fan1 fan2 psc1 propulsion …");
}

#[test]
fn read_only_sends_nothing_whatever_is_typed() {
    let mut app = app(true);
    press(&mut app, 0, "d hy:goal 1,2\n:cancel\ns");
    app.on_key(at(0), KeyEvent::new(KeyCode::Up, KeyModifiers::NONE));
    assert!((0..2000).all(|ms| app.poll(at(ms)).is_empty()));
}

#[test]
fn stop_is_zero_and_no_goal_at_once() {
    let mut app = app(false);
    press(&mut app, 0, " ");
    let sent = app.poll(at(0));
    assert!(
        matches!(&sent[..], [Message::LlCmdMotion(CmdMotion { speed: 0.0, .. }), Message::MlCmdGoal(goal)] if goal.waypoints.is_empty()),
        "{sent:?}"
    );
}

#[test]
fn homing_asks_first() {
    let mut app = app(false);
    press(&mut app, 0, "hn");
    assert!(app.poll(at(0)).is_empty());
    press(&mut app, 0, "hy");
    assert!(matches!(&app.poll(at(0))[..], [Message::LlCmdHoming(_)]));
}

#[test]
fn what_is_frozen_stays_while_the_status_goes_on() {
    let mut app = app(false);
    hear(&mut app, DataMotion { enabled: true, homed: true, speed: 0.25, ..DataMotion::default() });
    hear(&mut app, DataProcesses::default());
    press(&mut app, 0, "f");
    hear(&mut app, DataMotion { enabled: true, homed: true, speed: 0.5, ..DataMotion::default() });
    let screen = screen(&app, 100, 30);
    assert!(
        screen.contains("FROZEN") && screen.contains("+0.25 m/s") && screen.starts_with(" DRIVING  0.50 m/s"),
        "{screen}"
    );
}

#[test]
fn beacons_are_counted_by_their_state_and_listed_in_detail() {
    use messages::middlelevel::{BeaconUse, DataBeaconUse};
    let mut app = app(false);
    assert!(!screen(&app, 120, 40).contains("beacons"), "of a robot without a map");
    let seen = BeaconUse { id: 1, active: true, permitted: true, fits: true, last: 9_000_000, ..BeaconUse::default() };
    let seen = BeaconUse { residual: 0.01, deviation: 0.02, accepted: 7, ..seen };
    let refused = BeaconUse { id: 2, fits: false, refused: 3, ..seen.clone() };
    let excluded = BeaconUse { id: 3, active: false, permitted: false, ..seen.clone() };
    hear(&mut app, DataBeaconUse { timestamp: 10_000_000, beacons: vec![seen, refused, excluded] });
    let brief = screen(&app, 120, 40);
    assert!(brief.contains("1 used, 1 refused, 1 excluded"), "{brief}");
    app.expanded = true;
    let detail = screen(&app, 150, 40);
    assert!(detail.contains("   1 used         +0.57 deg 0.5 sigma  7 ok 0 refused"), "{detail}");
    assert!(detail.contains("   3 excluded "), "{detail}");
}

#[test]
fn an_error_in_detail_says_what_to_do() {
    let mut app = app(false);
    let error = Error { module: "driver_aux".into(), number: 0x0703, severity: 2, ..Error::default() };
    hear(&mut app, Error { message: "fan1 does not turn".into(), ..error });
    app.turn_to(Tab::Errors);
    assert!(!screen(&app, 120, 40).contains("what to do"));
    app.expanded = true;
    let detail = screen(&app, 120, 40);
    assert!(detail.contains("what to do  Clean the fan and check its plug, else replace it."), "{detail}");
}
