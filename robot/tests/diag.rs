//! The terminal diagnostic center on a terminal of its own: another's emulator (vt100) reads the screen, keys drive the
//! simulated robot.

mod support;

use nix::pty::{Winsize, openpty};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZero;
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use support::Robot;

/// `advee diag` and what is on its screen.
struct Screen {
    child: Child,
    keys: File,
    parser: Arc<Mutex<vt100::Parser>>,
}

impl Screen {
    fn open(robot: &Robot, args: &[&str]) -> Self {
        let size = Winsize { ws_row: ROWS.get(), ws_col: COLUMNS.get(), ws_xpixel: 0, ws_ypixel: 0 };
        let pty = openpty(&size, None).expect("a pseudo-terminal");
        let stdio = || Stdio::from(pty.slave.try_clone().expect("its other end"));
        let mut command = support::advee(&robot.url, &robot.run_dir);
        let child = command.arg("diag").args(args).env("TERM", "xterm-256color");
        let child = child.stdin(stdio()).stdout(stdio()).stderr(Stdio::inherit()).spawn().expect("advee diag");
        drop(pty.slave);
        let keys = File::from(pty.master);
        let parser = Arc::new(Mutex::new(vt100::Parser::new(ROWS, COLUMNS, 0)));
        let (mut reader, seen) = (keys.try_clone().expect("its end"), parser.clone());
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            // Ends with the terminal's other side.
            while let Ok(count @ 1..) = reader.read(&mut bytes) {
                seen.lock().expect("the screen").process(&bytes[..count]);
            }
        });
        Self { child, keys, parser }
    }

    fn text(&self) -> String {
        self.parser.lock().expect("the screen").screen().contents()
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
fn arrows_that_are_held_drive_and_let_go_stop_and_the_screen_says_so() {
    let mut robot = Robot::ready(&[]);
    let mut screen = Screen::open(&robot, &[]);
    screen.until("it is ready", |text| text.contains(" READY ") && text.contains("1Overview"));
    screen.press("d");
    screen.until("the drive is taken", |text| text.contains("you drive  zero"));
    // As a keyboard does: a press, a pause, repeats.
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
    screen.until("the modules", |text| text.contains("driver_canbus !") && text.contains("running"));
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
    let seen = screen.parser.lock().expect("the screen");
    assert!(!seen.screen().alternate_screen() && !seen.screen().hide_cursor(), "the terminal is as it was");
}

#[test]
fn who_is_killed_at_the_wheel_leaves_a_robot_that_stops() {
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
}

#[test]
fn a_view_is_printed_once_as_text_and_as_json() {
    let robot = Robot::ready(&[]);
    let text = robot.advee(&["diag", "--once", "--view", "modules"]);
    let text = String::from_utf8(text.stdout).expect("text");
    assert!(text.contains("driver_canbus !") && text.contains(" READY "), "{text}");
    let json = robot.advee(&["diag", "--once", "--json"]);
    let view: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    assert_eq!(view["status"]["word"], "ready", "{view}");
    assert_eq!(view["motion"]["value"]["homed"], true);
    assert!(view["modules"].as_array().is_some_and(|modules| modules.len() >= 9));
    let none = robot.advee(&["diag"]);
    assert!(!none.status.success() && String::from_utf8_lossy(&none.stderr).contains("this is no terminal"));
}
