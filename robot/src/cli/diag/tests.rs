//! The screen and the keys, without a terminal.

use super::*;
use messages::common::{DataProcesses, Error};
use messages::lowlevel::{CmdMotion, DataMotion};
use messages::{Channel, middlelevel};
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

const BODY: Body = Body { rear: -0.2, front: 0.75, half_width: 0.3 };

fn at(millis: u64) -> Instant {
    Instant::from_millis(50_000 + millis)
}

fn app(read_only: bool) -> App {
    let model = Model::new(Config { robot: "advee".into(), critical: vec!["driver_canbus".into()] });
    App::new(model, Drive::new(at(0), (0.5, 0.4)), read_only, base::Epoch::default(), "diag:1".into())
}

fn hear(app: &mut App, message: impl Into<Message>) {
    let message: Message = message.into();
    app.hear(at(0), &message.channel_name(), 64, Some(message));
}

fn press(app: &mut App, millis: u64, keys: &str) {
    for key in keys.chars() {
        let code = if key == '\n' { KeyCode::Enter } else { KeyCode::Char(key) };
        app.on_key(at(millis), KeyEvent::new(code, KeyModifiers::NONE));
    }
}

fn screen(app: &App, width: u16, height: u16) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw::draw(frame, app, BODY, at(0))).unwrap();
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
        for (width, height) in [(200, 60), (80, 24), (40, 10), (39, 9), (1, 1)] {
            for key in "123456?".chars() {
                press(app, 0, &key.to_string());
                let screen = screen(app, width, height);
                assert!(!screen.contains('\u{1b}'), "{screen}");
            }
            press(app, 0, "x");
        }
    }
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
