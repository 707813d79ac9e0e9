//! Terminal diagnostic center on a pseudo-terminal: an independent emulator (vt100) interprets the screen, keys drive
//! the simulated robot.

mod support;

use messages::{common, lowlevel};
use nix::pty::{Winsize, openpty};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZero;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use support::Robot;

/// `advee diag` with its screen.
struct Screen {
    child: Child,
    keys: File,
    seen: Arc<Mutex<Seen>>,
    begun: Instant,
}

/// Output: as interpreted by the emulator, and raw.
struct Seen {
    parser: vt100::Parser,
    bytes: Vec<u8>,
    first: Option<Instant>,
}

impl Screen {
    fn open(robot: &Robot, args: &[&str]) -> Self {
        let size = Winsize { ws_row: ROWS.get(), ws_col: COLUMNS.get(), ws_xpixel: 0, ws_ypixel: 0 };
        let pty = openpty(&size, None).expect("a pseudo-terminal");
        let stdio = || Stdio::from(pty.slave.try_clone().expect("its other end"));
        let mut command = support::advee(&robot.url, &robot.run_dir);
        let child = command.arg("diag").args(args).env("TERM", "xterm-256color");
        let child = child.stdin(stdio()).stdout(stdio()).stderr(Stdio::inherit());
        let begun = Instant::now();
        let child = child.spawn().expect("advee diag");
        drop(pty.slave);
        let keys = File::from(pty.master);
        let parser = vt100::Parser::new(ROWS, COLUMNS, 0);
        let seen = Arc::new(Mutex::new(Seen { parser, bytes: Vec::new(), first: None }));
        let (mut reader, writer, all) = (keys.try_clone().expect("its end"), keys.try_clone(), seen.clone());
        std::thread::spawn(move || {
            let mut writer = writer.expect("its end");
            let mut bytes = [0; 4096];
            // Ends with the terminal's other side.
            while let Ok(count @ 1..) = reader.read(&mut bytes) {
                let mut seen = all.lock().expect("the screen");
                let bytes = &bytes[..count];
                seen.parser.process(bytes);
                seen.bytes.extend(bytes);
                if seen.first.is_none() && seen.parser.screen().contents().contains("? help") {
                    seen.first = Some(Instant::now());
                }
                // Query for the terminal type, which every terminal answers.
                if bytes.windows(3).any(|part| part == b"\x1b[c") {
                    let _ = writer.write_all(b"\x1b[?62c");
                }
            }
        });
        Self { child, keys, seen, begun }
    }

    fn text(&self) -> String {
        self.seen.lock().expect("the screen").parser.screen().contents()
    }

    /// Changes the size of the terminal.
    fn resize(&self, rows: u16, columns: u16) {
        let terminal = Stdio::from(self.keys.try_clone().expect("its end"));
        let (rows_text, columns_text) = (rows.to_string(), columns.to_string());
        let stty = Command::new("stty").args(["rows", &rows_text, "cols", &columns_text]).stdin(terminal).status();
        assert!(stty.expect("stty").success());
        let sizes = (NonZero::new(rows).expect("not zero"), NonZero::new(columns).expect("not zero"));
        self.seen.lock().expect("the screen").parser.screen_mut().set_size(sizes.0, sizes.1);
        kill(Pid::from_raw(self.child.id() as i32), Signal::SIGWINCH).expect("it is there");
    }

    /// User and system time so far, s.
    fn cpu(&self) -> f64 {
        let text = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).expect("it runs");
        let fields = text.rsplit(')').next().unwrap_or_default().split_whitespace();
        fields.skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum::<f64>() / 100.0
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).expect("the terminal takes keys");
    }

    #[track_caller]
    fn until(&self, what: &str, seen: impl Fn(&str) -> bool) {
        let end = Instant::now() + Duration::from_secs(10);
        while !seen(&self.text()) {
            assert!(Instant::now() < end, "{what}; the screen is\n{}", self.text());
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

const ROWS: NonZero<u16> = NonZero::new(24).expect("not zero");
const COLUMNS: NonZero<u16> = NonZero::new(80).expect("not zero");
const UP: &str = "\x1b[A";

#[test]
fn held_arrow_keys_drive_and_released_ones_stop_and_the_screen_shows_it() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let mut screen = Screen::open(&robot, &[]);
        screen.until("it is ready", |text| text.contains(" READY ") && text.contains("1Overview"));
        screen.press("d");
        screen.until("the drive is taken", |text| text.contains("you drive  zero"));
        // Like a keyboard: a press, a pause, repeats.
        for repeat in 0..20 {
            screen.press(UP);
            robot.pass(if repeat == 0 { 0.5 } else { 0.033 });
        }
        assert!(robot.view.speed() > 0.1, "{}", robot.view.speed());
        screen.until("it is seen", |text| text.contains(" DRIVING "));
        robot.until("let go", 3.0, |view| view.speed().abs() < 0.01);
        screen.press(" ");
        screen.until("stop is said", |text| text.contains("stop: zero sent"));
        screen.press("2");
        screen.until("the modules", |text| text.contains("driver_canbus *") && text.contains("running"));
        screen.press("5/ODO\r");
        screen.until("a channel with its values", |text| text.contains("LL_DATA_ODO") && text.contains("ticks_left"));
        screen.press(":fly\n");
        screen.until("nonsense is told", |text| text.contains("fly is no command"));
        screen.press("q");
        let end = Instant::now() + Duration::from_secs(5);
        let status = loop {
            match screen.child.try_wait().expect("its end") {
                Some(status) => break status,
                None => assert!(Instant::now() < end, "it does not end"),
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        assert!(status.success(), "{status}");
        let seen = screen.seen.lock().expect("the screen");
        let seen = seen.parser.screen();
        assert!(
            !seen.alternate_screen() && !seen.hide_cursor() && !seen.bracketed_paste(),
            "the terminal is as it was"
        );
    });
}

#[test]
fn a_terminal_killed_while_driving_leaves_a_robot_that_stops() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let mut screen = Screen::open(&robot, &[]);
        screen.until("it is ready", |text| text.contains(" READY "));
        screen.press("d");
        for _ in 0..30 {
            screen.press(UP);
            robot.pass(0.033);
        }
        assert!(robot.view.speed() > 0.05);
        kill(Pid::from_raw(screen.child.id() as i32), Signal::SIGKILL).expect("it is killed");
        robot.until("it stands", 3.0, |view| view.speed().abs() < 0.01);
    });
}

#[test]
fn an_expert_finds_out_what_ended_and_reads_a_drive() {
    let mut robot = Robot::ready(&[]);
    let mut screen = Screen::open(&robot, &[]);
    screen.until("it is ready", |text| text.contains(" READY "));
    screen.press("2/rs485a\r\r");
    screen.until("all about a module", |text| text.contains("it never ended") && text.contains("critical    yes"));
    robot.kill("driver_rs485a");
    screen.until("how it ended", |text| text.contains("SIGKILL: killed") && text.contains("restarts    1"));
    screen.press("\x1b");
    std::thread::sleep(Duration::from_millis(300));
    screen.press("3:sdo propulsion 0x6041\r");
    screen.until("a drive's answer", |text| {
        text.matches("node 1 0x6041 Statusword = 0x").count() == 2 && text.contains("operation")
    });
    screen.press(":sdo 1 0x6040 0 6\r");
    screen.until("a refusal, and why", |text| text.contains("driver_canbus lets nobody else write it"));
    screen.press(":sdo 9 0x1000\r");
    screen.until("a node that is not there", |text| text.contains("node 9 0x1000 Device type refused"));
    screen.press("6");
    let run = std::fs::read_dir(support::logs(&robot.run_dir)).expect("logs").next().expect("a run").expect("a run");
    let run = run.file_name().into_string().expect("a name");
    screen.until("the run that is written", |text| text.contains(&run) && text.contains("being written"));
    screen.press(":log stop\r");
    screen.until("the recorder has stopped", |text| text.contains("RECORDS NOTHING"));
    robot.pass(0.1);
    assert!(robot.view.errors.iter().all(|error| !error.fatal));
}

#[test]
fn control_characters_on_the_bus_never_reach_the_terminal() {
    let mut robot = Robot::ready(&[]);
    let mut screen = Screen::open(&robot, &["--read-only"]);
    screen.until("it is ready", |text| text.contains(" READY "));
    // A title, a bell, C1 controls, a change of the text direction; and a very long name.
    let evil = format!("\x1b]0;evil\x07\u{9b}2J\u{202e}\x1b[31m{}", "x".repeat(30_000));
    for turn in 0..60 {
        let number = turn % 7;
        let (module, message) = (format!("{number}{evil}"), evil.clone());
        let error = common::Error { module, message, number, severity: 2, ..<_>::default() };
        robot.publish(error);
        robot.publish(common::DataState { module: format!("{number}{evil}"), state: 3, ..<_>::default() });
        let node = lowlevel::Node { name: evil.clone(), state: 2, ..<_>::default() };
        robot.publish(lowlevel::DataBus { bus: evil.clone(), nodes: vec![node], ..<_>::default() });
        robot.bus.publish("\u{9b}2J\u{202e}EVIL", b"?").ok();
        screen.press(["1", "2", "3", "4", "5", "6", "\r"][turn as usize % 7]);
        robot.pass(0.03);
    }
    screen.press("\x1b4");
    screen.until("it is told all the same", |text| text.contains("evil"));
    let seen = screen.seen.lock().expect("the screen");
    let text = String::from_utf8_lossy(&seen.bytes);
    assert!(!text.contains("\x1b]") && !text.contains('\x07') && !text.contains(['\u{9b}', '\u{202e}']));
    drop(seen);
    // Nor does it reach the printed output.
    for args in [&["diag", "--once"][..], &["diag", "--once", "--json"]] {
        let told = robot.advee(args);
        let told = String::from_utf8(told.stdout).expect("text");
        assert!(!told.contains(['\x1b', '\x07', '\u{9b}', '\u{202e}']), "{args:?}");
    }
}

#[test]
fn floods_of_keys_messages_and_resizes_are_survived() {
    let mut robot = Robot::ready(&[]);
    let mut screen = Screen::open(&robot, &[]);
    screen.until("it is ready", |text| text.contains(" READY "));
    for turn in 0_u16..300 {
        let (rows, columns) = [(1, 1), (5, 20), (50, 160), (24, 80), (3, 200), (200, 3)][usize::from(turn) % 6];
        screen.resize(rows, columns);
        screen.press("\x1b[A\x1b[B123456o?x\r/z\x1b");
        for number in 0..20 {
            robot.publish(common::Error { module: format!("m{turn}"), number, severity: 1, ..<_>::default() });
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    screen.resize(24, 80);
    std::thread::sleep(Duration::from_millis(500));
    screen.press("\x1b");
    std::thread::sleep(Duration::from_millis(300));
    screen.press("2");
    screen.until("it goes on", |text| text.contains("driver_canbus *") && text.contains("? help"));
    let standing = robot.view.speed();
    assert!(standing.abs() < 0.01, "{standing}");
}

#[test]
fn it_starts_at_once_and_uses_little_processor_time() {
    let mut robot = Robot::ready(&[]);
    let screen = Screen::open(&robot, &[]);
    screen.until("it is ready", |text| text.contains(" READY "));
    let first = screen.seen.lock().expect("the screen").first.expect("a first picture");
    let start = first.duration_since(screen.begun);
    let before = screen.cpu();
    robot.pass(5.0);
    let part = (screen.cpu() - before) / 5.0;
    let _ = writeln!(std::io::stderr(), "start {start:?}, {:.1} % of a core", 100.0 * part);
    // The figures are 0.1 s and 3 %; a loaded machine takes longer.
    assert!(start < Duration::from_secs(1), "{start:?}");
    assert!(part < 0.1, "{part}");
}

#[test]
fn a_view_is_printed_once_as_text_and_as_json() {
    let robot = Robot::ready(&[]);
    let text = robot.advee(&["diag", "--once", "--view", "modules"]);
    let text = String::from_utf8(text.stdout).expect("text");
    assert!(text.contains("driver_canbus *") && text.contains(" READY "), "{text}");
    let json = robot.advee(&["diag", "--once", "--json"]);
    let view: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    assert_eq!(view["status"]["word"], "ready", "{view}");
    assert_eq!(view["motion"]["value"]["homed"], true);
    for (view, key) in [("overview", "motion"), ("modules", "modules"), ("buses", "axes"), ("errors", "errors")] {
        let json = robot.advee(&["diag", "--once", "--json", "--view", view]).stdout;
        let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
        assert!(!json[key].is_null() && json["channels"].is_null(), "{view}: {json}");
    }
    let logs = robot.advee(&["diag", "--once", "--json", "--view", "logs"]).stdout;
    let logs: serde_json::Value = serde_json::from_slice(&logs).expect("JSON");
    assert_eq!(logs["runs"]["runs"][0]["run"], logs["log"]["value"]["run"], "{logs}");
    assert!(view["modules"].as_array().is_some_and(|modules| modules.len() >= 9));
    let none = robot.advee(&["diag"]);
    assert!(!none.status.success() && String::from_utf8_lossy(&none.stderr).contains("this is no terminal"));
}
