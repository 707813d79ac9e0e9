//! `advee diag`: the diagnostic center in a terminal, for a robot at the other end of an SSH line.
//!
//! - [`app`]: its state; messages in, messages out. [`keys`]: what keys do. [`drive`]: hold to run. [`command`]: what
//!   is typed behind `:`. [`sdo`]: objects of nodes that were asked for. [`runs`]: the log folder.
//! - [`rows`]: what a view lists. [`draw`]: the screen, a function of the state.
//! - here: the terminal, the bus, and `--once`, which prints a view as text or JSON.

mod app;
mod command;
mod draw;
mod drive;
mod keys;
mod rows;
mod runs;
mod sdo;
#[cfg(test)]
mod tests;

use super::bus::{interrupt, wait};
use super::{Common, Failed, Outcome, print, seconds};
use app::{App, Setup, Tab};
use base::{Duration, Instant};
use clap::ArgGroup;
use diagnostics::{Config, Model};
use draw::Body;
use drive::Drive;
use drivers::canbus::Node;
use host::bus::{Bus, Received};
use host::clock;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{
    self, DisableBracketedPaste, DisableFocusChange, EnableBracketedPaste, EnableFocusChange, Event, KeyModifiers,
    KeyboardEnhancementFlags, PopKeyboardEnhancementFlags, PushKeyboardEnhancementFlags,
};
use ratatui::crossterm::{execute, terminal};
use ratatui::{DefaultTerminal, Terminal};
use robot::config::{CanBus, Config as Configuration};
use robot::place::RobotLocation;
use robot::preflight;
use robot::topology;
use runs::Runs;
use serde_json::Value;
use std::io::{self, IsTerminal};
use std::os::fd::AsFd;
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(group(ArgGroup::new("printed").args(["once", "json"]).multiple(true)))]
pub struct Diag {
    /// Print a view once and end
    #[arg(long)]
    once: bool,
    /// Print a JSON object once and end
    #[arg(long)]
    json: bool,
    /// Which view: overview, modules, buses, errors, messages or logs; printed without it: all
    #[arg(long, value_parser = view)]
    view: Option<Tab>,
    /// Listen for so long before it is printed, s
    #[arg(long = "for", requires = "printed", value_name = "S", default_value = "1.2", value_parser = seconds)]
    time: Duration,
    /// Send nothing
    #[arg(long)]
    read_only: bool,
}

/// The screen is drawn this often.
const DRAWN: Duration = Duration::from_millis(100);
/// Period of the main loop.
const TURN: Duration = Duration::from_millis(10);
/// Messages, and keys, that are taken in one turn.
const BURST: usize = 1000;
const KEYS: usize = 200;
/// Pause of the terminal, or of this process, after which waiting keys are too old to count.
const STALLED: Duration = Duration::from_millis(500);
/// Width and height of `--once` without JSON.
const PAGE: (u16, u16) = (120, 40);

fn view(name: &str) -> Result<Tab, String> {
    let tab = Tab::ALL.into_iter().find(|tab| tab.name().eq_ignore_ascii_case(name));
    tab.ok_or_else(|| "expected overview, modules, buses, errors, messages or logs".into())
}

pub fn diag(common: &Common, command: &Diag) -> Outcome {
    let (place, config) = configuration(common)?;
    let geometry = &config.robot.geometry;
    let body = Body {
        rear: -geometry.rear_m(),
        front: geometry.front_m(),
        half_width: geometry.width_m() / 2.0,
        sonar_beam: config.robot.sensors.srf08.beam_rad,
    };
    let critical = config.modules.iter().filter(|module| module.guard.critical).map(|module| module.name().to_owned());
    let limits = (config.robot.limits.manual_mps(), config.robot.limits.steering_rad);
    let drive = Drive::new(clock::now(), limits);
    let drive = match &config.robot.base {
        Some(base) => drive.free(config.robot.limits.rotation_radps, base.goes_sideways()),
        None => drive,
    };
    let epoch = clock::epoch();
    let of_bus = |bus: &CanBus| {
        let nodes = bus.driver.nodes.iter();
        let node = |node: &Node| (config.robot.node_number(bus, node.id), node.axis.name().to_owned());
        nodes.map(node).collect::<Vec<_>>()
    };
    let mut app = App::new(Setup {
        // Which of the two is on the bus is not known here; the first line shows a simulation that is slow.
        model: Model::new(Config {
            robot: config.robot.general.name.clone(),
            critical: critical.collect(),
            simulated: true,
        }),
        drive,
        read_only: command.read_only,
        session: epoch.timestamp(clock::now()),
        epoch,
        source: format!("diag:{}", std::process::id()),
        nodes: config.robot.can.iter().flat_map(of_bus).collect(),
        runs: Runs::of(topology::log_folder(&place, &config.robot)),
        faults: if place.sim { preflight::faults(&place).unwrap_or_default() } else { Vec::new() },
    });
    let bus = Bus::open(&common.lcm_url(), &[".*"])?;
    if command.once || command.json {
        return once(app, bus, body, command);
    }
    if !io::stdin().is_terminal() || !io::stdout().is_terminal() {
        return Err("this is no terminal; try --once".into());
    }
    app.turn_to(command.view.unwrap_or(Tab::Overview));
    in_terminal(app, bus, body)
}

/// The running robot with its arguments, else the configured one. A robot elsewhere has no configuration here, and is
/// shown without it.
pub fn configuration(common: &Common) -> Result<(RobotLocation, Configuration), Failed> {
    if let Some(place) = common.running()
        && let Ok(config) = Configuration::load(&place.config, place.sim, &place.sets)
    {
        return Ok((place, config));
    }
    let simulated = common.load(true).map(|config| (common.place(true), config));
    Ok(simulated.or_else(|_| common.load(false).map(|config| (common.place(false), config)))?)
}

/// Takes received messages. A failing bus is retried; its silence shows.
fn listen(app: &mut App, bus: &mut Bus) {
    for _ in 0..BURST {
        let now = clock::now();
        let mut heard = None;
        let received = bus.receive_with(now, |at, raw| {
            heard = Some((at, raw.channel.to_owned(), raw.data.len()));
            true
        });
        let message = match received {
            Received::Nothing => return,
            Received::Broken(why) => {
                app.say(now, why);
                return;
            }
            Received::Message { message, .. } => Some(message),
            Received::Foreign | Received::Malformed { .. } => None,
        };
        if let Some((at, channel, bytes)) = heard {
            app.hear(at, &channel, bytes, message);
        }
    }
}

fn once(mut app: App, mut bus: Bus, body: Body, command: &Diag) -> Outcome {
    let until = clock::now() + command.time;
    while clock::now() < until {
        listen(&mut app, &mut bus);
        wait(&[bus.as_fd()], until.since(clock::now()))?;
    }
    let now = clock::now();
    app.look(now);
    if command.json {
        let (model, at) = app.shown(now);
        let mut view = serde_json::to_value(model.view(at)).map_err(|error| error.to_string())?;
        let concerns = serde_json::to_value(model.concerns(at));
        view["concerns"] = concerns.map_err(|error| error.to_string())?;
        view["runs"] = app.runs.json();
        print(harmless(&picked(view, command.view).to_string()))?;
        return Ok(ExitCode::SUCCESS);
    }
    for tab in command.view.map_or(Tab::ALL.to_vec(), |tab| vec![tab]) {
        app.turn_to(tab);
        print(page(&app, body, now))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Part of the JSON that a view shows.
fn picked(mut view: Value, tab: Option<Tab>) -> Value {
    let keys: &[&str] = match tab {
        None => return view,
        Some(Tab::Overview) => &[
            "robot",
            "status",
            "concerns",
            "motion",
            "holds",
            "commands",
            "stop",
            "estimate",
            "beacon_use",
            "ellipse",
            "goal",
            "mode",
            "parameters",
            "plan",
            "obstacles",
            "sonars",
            "infrareds",
            "ranges",
            "beacons",
            "odometry",
            "power",
            "temperatures",
            "gamepad",
            "truth",
        ],
        Some(Tab::Modules) => &["modules"],
        Some(Tab::Buses) => &["busses", "axes"],
        Some(Tab::Errors) => &["errors"],
        Some(Tab::Messages) => &["channels"],
        Some(Tab::Logs) => &["log", "runs", "texts"],
    };
    if let Value::Object(fields) = &mut view {
        fields.retain(|key, _| keys.contains(&key.as_str()));
    }
    view
}

/// JSON whose texts a terminal may show: what could move its cursor is only ever within texts, and escaped there.
fn harmless(json: &str) -> String {
    let mut out = String::with_capacity(json.len());
    for c in json.chars() {
        match c {
            c if draw::is_harmful(c) => {
                out.extend(c.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")));
            }
            c => out.push(c),
        }
    }
    out
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
    let terminal = ratatui::init();
    let mut screen = Screen { app, bus, body, terminal, tells_releases: false };
    let result = screen.begin().and_then(|()| screen.turns(&signals));
    if screen.tells_releases {
        let _ = execute!(io::stdout(), PopKeyboardEnhancementFlags);
    }
    let _ = execute!(io::stdout(), DisableBracketedPaste, DisableFocusChange);
    ratatui::restore();
    result.map(|()| ExitCode::SUCCESS)
}

fn refused(error: io::Error) -> Failed {
    format!("terminal: {error}").into()
}

/// The state, the bus and the terminal.
struct Screen {
    app: App,
    bus: Bus,
    body: Body,
    terminal: DefaultTerminal,
    /// True if the terminal reports key releases.
    tells_releases: bool,
}

impl Screen {
    /// The first picture is there before the terminal is asked what it can: one that does not answer takes 2 s.
    fn begin(&mut self) -> Result<(), Failed> {
        listen(&mut self.app, &mut self.bus);
        self.draw(clock::now())?;
        execute!(io::stdout(), EnableFocusChange, EnableBracketedPaste).map_err(refused)?;
        self.tells_releases = terminal::supports_keyboard_enhancement().unwrap_or(false);
        if self.tells_releases {
            let flags = KeyboardEnhancementFlags::REPORT_EVENT_TYPES;
            execute!(io::stdout(), PushKeyboardEnhancementFlags(flags)).map_err(refused)?;
        }
        Ok(())
    }

    fn draw(&mut self, now: Instant) -> Result<(), Failed> {
        let (app, body) = (&self.app, self.body);
        self.terminal.draw(|frame| draw::draw(frame, app, body, now)).map(drop).map_err(refused)
    }

    fn turns(&mut self, signals: &nix::sys::signalfd::SignalFd) -> Result<(), Failed> {
        let mut drawn = Instant::ZERO;
        let mut changed = true;
        let mut turned = clock::now();
        while !self.app.quit {
            let began = clock::now();
            let is_stale = began.since(std::mem::replace(&mut turned, began)) >= STALLED && self.app.drive.is_taken();
            if is_stale {
                self.app.on_stall(began);
            }
            listen(&mut self.app, &mut self.bus);
            changed |= self.take_keys(is_stale)?;
            if let Ok(Some(_)) = signals.read_signal() {
                break;
            }
            self.say();
            let now = clock::now();
            if changed || now.since(drawn) >= DRAWN {
                self.draw(now)?;
                (drawn, changed) = (now, false);
            }
            let stdin = io::stdin();
            // The bus is asked when the next picture or command is due: it says something all the time.
            wait(&[stdin.as_fd(), signals.as_fd()], TURN)?;
        }
        // Who leaves while he drives leaves a robot that stops at once.
        self.app.drive.give_back();
        for _ in 0..3 {
            self.say();
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    /// True if there was any. Of stale ones only those that end something count.
    fn take_keys(&mut self, are_stale: bool) -> Result<bool, Failed> {
        for taken in 0..KEYS {
            if !event::poll(Duration::ZERO).map_err(refused)? {
                return Ok(taken > 0);
            }
            let now = clock::now();
            match event::read().map_err(refused)? {
                Event::Key(key) if are_stale && !key.modifiers.contains(KeyModifiers::CONTROL) => {}
                Event::Key(key) => self.app.on_key(now, key),
                Event::Paste(text) => self.app.on_paste(now, &text),
                Event::FocusLost => self.app.on_focus_lost(),
                _ => {}
            }
        }
        Ok(true)
    }

    /// Publishes waiting messages; reports a failure.
    fn say(&mut self) {
        let now = clock::now();
        for message in self.app.poll(now) {
            if let Err(why) = self.bus.publish(&message) {
                self.app.say(now, why);
            }
        }
    }
}
