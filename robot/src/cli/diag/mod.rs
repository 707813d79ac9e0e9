//! `advee diag`: the diagnostic center in a terminal, for a robot at the other end of an SSH line.
//!
//! - [`app`]: its state; keys and messages in, messages out. [`drive`]: hold to run. [`command`]: what is typed behind `:`.
//! - [`draw`]: the screen, a function of the state.
//! - here: the terminal, the bus, and `--once`, which prints a view as text or JSON.

mod app;
mod command;
mod draw;
mod drive;
#[cfg(test)]
mod tests;

use super::bus::{interrupt, wait};
use super::{Common, Failed, Outcome, print, seconds};
use crate::live::bus::{Bus, Received};
use crate::live::clock;
use app::{App, Tab};
use base::{Duration, Instant};
use diagnostics::{Config, Model};
use draw::Body;
use drive::Drive;
use messages::Message;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{
    self, DisableFocusChange, EnableFocusChange, Event, KeyboardEnhancementFlags, PopKeyboardEnhancementFlags,
    PushKeyboardEnhancementFlags,
};
use ratatui::crossterm::{execute, terminal};
use ratatui::{DefaultTerminal, Terminal};
use serde_json::Value;
use std::io::{self, IsTerminal};
use std::os::fd::AsFd;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Diag {
    /// Print a view once and end
    #[arg(long)]
    once: bool,
    /// A JSON object
    #[arg(long, requires = "once")]
    json: bool,
    /// Which view: overview, modules, busses, errors, messages or logs; all without it
    #[arg(long, requires = "once", value_parser = view)]
    view: Option<Tab>,
    /// Listen for so long before, s
    #[arg(long = "for", requires = "once", value_name = "S", default_value = "1.2", value_parser = seconds)]
    time: Duration,
    /// Send nothing
    #[arg(long)]
    read_only: bool,
}

/// The screen is drawn this often.
const DRAWN: Duration = Duration::from_millis(100);
/// What is due is looked for this often.
const TURN: Duration = Duration::from_millis(10);
/// Messages that are taken in one turn.
const BURST: usize = 1000;
/// What `--once` without JSON is as wide and high as.
const PAGE: (u16, u16) = (120, 40);

fn view(name: &str) -> Result<Tab, String> {
    let tab = Tab::ALL.into_iter().find(|tab| tab.name().eq_ignore_ascii_case(name));
    tab.ok_or_else(|| "expected overview, modules, busses, errors, messages or logs".into())
}

pub fn diag(common: &Common, command: &Diag) -> Outcome {
    // What is simulated has its own configuration; a robot elsewhere has none here, and is shown all the same.
    let config = common.load(true).or_else(|_| common.load(false))?;
    let geometry = &config.robot.geometry;
    let body = Body {
        rear: -geometry.rear_overhang_m,
        front: geometry.length_m - geometry.rear_overhang_m,
        half_width: geometry.width_m / 2.0,
    };
    let critical = config.modules.iter().filter(|module| module.critical).map(|module| module.name.clone());
    let model = Model::new(Config { robot: config.robot.name.clone(), critical: critical.collect() });
    let limits = (config.robot.limits.speed_manual_mps, config.robot.limits.steering_rad);
    let source = format!("diag:{}", std::process::id());
    let drive = Drive::new(clock::now(), limits);
    let app = App::new(model, drive, command.read_only, clock::epoch(), source);
    let bus = Bus::open(&common.lcm_url(), &[".*"])?;
    if command.once {
        return once(app, bus, body, command);
    }
    if !io::stdin().is_terminal() || !io::stdout().is_terminal() {
        return Err("this is no terminal; try --once".into());
    }
    in_terminal(app, bus, body)
}

/// Takes what was said.
fn listen(app: &mut App, bus: &mut Bus) -> Result<(), Failed> {
    for _ in 0..BURST {
        let now = clock::now();
        let mut heard = None;
        let received = bus.overhear(now, |at, raw| {
            heard = Some((at, raw.channel.to_owned(), raw.data.len()));
            true
        });
        let message = match received {
            Received::Nothing => return Ok(()),
            Received::Broken(why) => return Err(why.into()),
            Received::Message { message, .. } => Some(message),
            Received::Foreign | Received::Malformed { .. } => None,
        };
        if let Some((at, channel, bytes)) = heard {
            app.hear(at, &channel, bytes, message);
        }
    }
    Ok(())
}

fn once(mut app: App, mut bus: Bus, body: Body, command: &Diag) -> Outcome {
    let until = clock::now() + command.time;
    while clock::now() < until {
        listen(&mut app, &mut bus)?;
        wait(&[bus.as_fd()], until.since(clock::now()))?;
    }
    let now = clock::now();
    if command.json {
        let view = serde_json::to_value(app.shown(now).0.view(now)).map_err(|error| error.to_string())?;
        print(picked(view, command.view))?;
        return Ok(ExitCode::SUCCESS);
    }
    for tab in command.view.map_or(Tab::ALL.to_vec(), |tab| vec![tab]) {
        app.tab = tab;
        print(page(&app, body, now))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What of the JSON a view shows.
fn picked(mut view: Value, tab: Option<Tab>) -> Value {
    let keys: &[&str] = match tab {
        None => return view,
        Some(Tab::Overview) => &[
            "robot",
            "status",
            "motion",
            "commands",
            "stop",
            "estimate",
            "ellipse",
            "goal",
            "plan",
            "obstacles",
            "sonars",
            "infrareds",
            "beacons",
            "odometry",
            "power",
            "temperatures",
            "gamepad",
            "truth",
        ],
        Some(Tab::Modules) => &["modules"],
        Some(Tab::Busses) => &["busses", "axes"],
        Some(Tab::Errors) => &["errors"],
        Some(Tab::Messages) => &["channels"],
        Some(Tab::Logs) => &["log"],
    };
    if let Value::Object(fields) = &mut view {
        fields.retain(|key, _| keys.contains(&key.as_str()));
    }
    view
}

/// The screen as text.
fn page(app: &App, body: Body, now: Instant) -> String {
    let backend = TestBackend::new(PAGE.0, PAGE.1);
    let Ok(mut terminal) = Terminal::new(backend);
    let Ok(frame) = terminal.draw(|frame| draw::draw(frame, app, body, now));
    let cells = frame.buffer.content().chunks(usize::from(PAGE.0));
    let line = |row: &[ratatui::buffer::Cell]| {
        row.iter().map(ratatui::buffer::Cell::symbol).collect::<String>().trim_end().to_owned()
    };
    cells.map(line).collect::<Vec<_>>().join("\n")
}

/// Takes the terminal; gives it back however this ends.
fn in_terminal(app: App, bus: Bus, body: Body) -> Outcome {
    // Before the terminal's own threads, which inherit the mask.
    let signals = interrupt()?;
    let mut terminal = ratatui::init();
    let tells_releases = terminal::supports_keyboard_enhancement().unwrap_or(false);
    let refused = |error: io::Error| Failed::from(format!("terminal: {error}"));
    let mut out = io::stdout();
    let mut begin = || -> io::Result<()> {
        execute!(out, EnableFocusChange)?;
        if tells_releases {
            execute!(out, PushKeyboardEnhancementFlags(KeyboardEnhancementFlags::REPORT_EVENT_TYPES))?;
        }
        Ok(())
    };
    let result = begin().map_err(refused).and_then(|()| turns(app, bus, body, &mut terminal, &signals));
    if tells_releases {
        let _ = execute!(io::stdout(), PopKeyboardEnhancementFlags);
    }
    let _ = execute!(io::stdout(), DisableFocusChange);
    ratatui::restore();
    result.map(|()| ExitCode::SUCCESS)
}

fn turns(
    mut app: App,
    mut bus: Bus,
    body: Body,
    terminal: &mut DefaultTerminal,
    signals: &nix::sys::signalfd::SignalFd,
) -> Result<(), Failed> {
    let refused = |error: io::Error| Failed::from(format!("terminal: {error}"));
    let mut drawn = Instant::ZERO;
    let mut changed = true;
    while !app.quit {
        listen(&mut app, &mut bus)?;
        while event::poll(Duration::ZERO).map_err(refused)? {
            match event::read().map_err(refused)? {
                Event::Key(key) => app.on_key(clock::now(), key),
                Event::FocusLost => app.on_focus_lost(),
                _ => {}
            }
            changed = true;
        }
        if let Ok(Some(_)) = signals.read_signal() {
            break;
        }
        say(&mut app, &mut bus);
        let now = clock::now();
        if changed || now.since(drawn) >= DRAWN {
            terminal.draw(|frame| draw::draw(frame, &app, body, now)).map_err(refused)?;
            (drawn, changed) = (now, false);
        }
        let stdin = io::stdin();
        // The bus is asked when the next picture or command is due: it says something all the time.
        wait(&[stdin.as_fd(), signals.as_fd()], TURN)?;
    }
    // Who leaves while he drives leaves a robot that stops at once.
    app.drive.give_back();
    for _ in 0..3 {
        say(&mut app, &mut bus);
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

/// Sends what is to be sent; what does not leave is told.
fn say(app: &mut App, bus: &mut Bus) {
    let now = clock::now();
    let messages: Vec<Message> = app.poll(now);
    for message in messages {
        if let Err(why) = bus.publish(&message) {
            app.say(now, why);
        }
    }
}
