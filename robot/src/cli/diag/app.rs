//! The state of the terminal: what is heard goes in, keys go in, messages come out. Draws nothing, opens nothing.

use super::command::{self, Asked};
use super::drive::{Arrow, Drive};
use base::{Duration, Epoch, Instant};
use diagnostics::{Model, Status};
use messages::Message;
use messages::lowlevel::{CmdHoming, CmdMotion};
use messages::middlelevel::CmdGoal;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use std::collections::BTreeMap;
use std::mem;

/// What was said to the user stands for so long.
const SAID: Duration = Duration::from_secs(6);
/// The latest messages are kept of so many channels.
const LATEST_MAX: usize = 500;
/// A line that is typed is not longer.
const LINE_MAX: usize = 200;

/// The views, in the order of their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tab {
    Overview,
    Modules,
    Busses,
    Errors,
    Messages,
    Logs,
}

impl Tab {
    pub const ALL: [Self; 6] = [Self::Overview, Self::Modules, Self::Busses, Self::Errors, Self::Messages, Self::Logs];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Overview => "Overview",
            Self::Modules => "Modules",
            Self::Busses => "Busses",
            Self::Errors => "Errors",
            Self::Messages => "Messages",
            Self::Logs => "Logs",
        }
    }

    fn next(self, steps: usize) -> Self {
        Self::ALL[(self as usize + steps) % Self::ALL.len()]
    }
}

/// What keys are for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mode {
    Normal,
    /// Behind `:`.
    Command(String),
    /// Behind `/`.
    Filter(String),
    Help,
    /// A risky thing waits for `y`.
    Confirm(&'static str),
}

/// What is frozen on the screen.
pub struct Frozen {
    pub at: Instant,
    model: Model,
    latest: BTreeMap<String, Message>,
}

/// The terminal's state.
pub struct App {
    model: Model,
    latest: BTreeMap<String, Message>,
    pub tab: Tab,
    pub mode: Mode,
    /// Only what contains this is listed.
    pub filter: String,
    pub selected: usize,
    pub drive: Drive,
    pub read_only: bool,
    pub frozen: Option<Box<Frozen>>,
    pub quit: bool,
    said: Option<(Instant, String)>,
    epoch: Epoch,
    source: String,
    out: Vec<Message>,
}

impl App {
    pub fn new(model: Model, drive: Drive, read_only: bool, epoch: Epoch, source: String) -> Self {
        Self {
            model,
            latest: BTreeMap::new(),
            tab: Tab::Overview,
            mode: Mode::Normal,
            filter: String::new(),
            selected: 0,
            drive,
            read_only,
            frozen: None,
            quit: false,
            said: None,
            epoch,
            source,
            out: Vec::new(),
        }
    }

    /// Something was said on the bus.
    pub fn hear(&mut self, at: Instant, channel: &str, bytes: usize, message: Option<Message>) {
        if let Some(message) = &message
            && (self.latest.contains_key(channel) || self.latest.len() < LATEST_MAX)
        {
            self.latest.insert(channel.into(), message.clone());
        }
        self.model.hear(at, channel, bytes, message);
    }

    /// The model as it is shown, and the moment of what is shown.
    pub fn shown(&self, now: Instant) -> (&Model, Instant) {
        self.frozen.as_ref().map_or((&self.model, now), |frozen| (&frozen.model, frozen.at))
    }

    /// The robot's name.
    pub fn robot(&self) -> &str {
        self.model.robot()
    }

    /// How the robot is now, frozen or not.
    pub fn status(&self, now: Instant) -> Status {
        self.model.status(now)
    }

    /// The latest message of a channel, as it is shown.
    pub fn latest(&self, channel: &str) -> Option<&Message> {
        self.frozen.as_ref().map_or(&self.latest, |frozen| &frozen.latest).get(channel)
    }

    /// What was said to the user of late.
    pub fn said(&self, now: Instant) -> Option<&str> {
        self.said.as_ref().filter(|(at, _)| now.since(*at) < SAID).map(|(_, text)| text.as_str())
    }

    /// Says something to the user.
    pub fn say(&mut self, now: Instant, text: impl Into<String>) {
        self.said = Some((now, text.into()));
    }

    /// Whether a row is listed.
    pub fn lists(&self, row: &str) -> bool {
        self.filter.is_empty() || row.to_lowercase().contains(&self.filter.to_lowercase())
    }

    /// What is to be sent now.
    pub fn poll(&mut self, now: Instant) -> Vec<Message> {
        if let Some((speed, steering)) = self.drive.poll(now) {
            let (timestamp, source) = (self.epoch.timestamp(now), self.source.clone());
            let command = CmdMotion { timestamp, speed, steering, priority: CmdMotion::REMOTE, source };
            self.out.push(command.into());
        }
        mem::take(&mut self.out)
    }

    /// The terminal was left: another window, or it is gone.
    pub fn on_focus_lost(&mut self) {
        self.drive.stop();
    }

    pub fn on_key(&mut self, now: Instant, key: KeyEvent) {
        let arrow = match key.code {
            KeyCode::Up => Some(Arrow::Forward),
            KeyCode::Down => Some(Arrow::Back),
            KeyCode::Left => Some(Arrow::Left),
            KeyCode::Right => Some(Arrow::Right),
            _ => None,
        };
        if key.kind == KeyEventKind::Release {
            if let Some(arrow) = arrow {
                self.drive.release(arrow);
            }
            return;
        }
        let mut code = key.code;
        if key.modifiers.contains(KeyModifiers::CONTROL) {
            match code {
                KeyCode::Char('c' | 'd') => self.quit = true,
                // A line feed: what some terminals send for Enter.
                KeyCode::Char('j') => code = KeyCode::Enter,
                _ => {}
            }
            if code != KeyCode::Enter {
                return;
            }
        }
        match mem::replace(&mut self.mode, Mode::Normal) {
            Mode::Normal => match arrow {
                Some(arrow) if self.drive.is_taken() => self.drive.press(now, arrow),
                Some(Arrow::Forward) => self.selected = self.selected.saturating_sub(1),
                Some(Arrow::Back) => self.selected = self.selected.saturating_add(1),
                Some(Arrow::Left) => self.turn_to(self.tab.next(Tab::ALL.len() - 1)),
                Some(Arrow::Right) => self.turn_to(self.tab.next(1)),
                None => self.on_letter(now, code),
            },
            Mode::Command(line) => match typed(line, code) {
                Typed::More(line) => self.mode = Mode::Command(line),
                Typed::Done(line) => self.command(now, &line),
                Typed::Left => {}
            },
            Mode::Filter(line) => match typed(line, code) {
                Typed::More(line) => {
                    self.filter.clone_from(&line);
                    self.mode = Mode::Filter(line);
                }
                Typed::Done(line) => self.filter = line,
                Typed::Left => self.filter.clear(),
            },
            Mode::Confirm(what) if code == KeyCode::Char('y') => self.confirmed(now, what),
            Mode::Confirm(_) => self.say(now, "not done"),
            Mode::Help => {}
        }
    }

    fn turn_to(&mut self, tab: Tab) {
        (self.tab, self.selected) = (tab, 0);
    }

    fn on_letter(&mut self, now: Instant, code: KeyCode) {
        match code {
            KeyCode::Char(digit @ '1'..='6') => self.turn_to(Tab::ALL[digit as usize - '1' as usize]),
            KeyCode::Tab => self.turn_to(self.tab.next(1)),
            KeyCode::BackTab => self.turn_to(self.tab.next(Tab::ALL.len() - 1)),
            KeyCode::Char('?') => self.mode = Mode::Help,
            KeyCode::Char('/') => self.mode = Mode::Filter(String::new()),
            KeyCode::Char(':') => self.mode = Mode::Command(String::new()),
            KeyCode::Char('q') => self.quit = true,
            KeyCode::Char('f') => {
                let frozen = Frozen { at: now, model: self.model.clone(), latest: self.latest.clone() };
                self.frozen = if self.frozen.is_some() { None } else { Some(Box::new(frozen)) };
            }
            KeyCode::Esc => {
                self.drive.give_back();
                self.filter.clear();
            }
            KeyCode::Char(' ' | 's') => self.stop(now),
            KeyCode::Char('d' | 'h') if self.read_only => self.say(now, "read-only: nothing is sent"),
            KeyCode::Char('d') => {
                self.drive.toggle();
                if self.drive.is_taken() {
                    self.turn_to(Tab::Overview);
                }
            }
            KeyCode::Char('h') => self.mode = Mode::Confirm("home the steering: the front wheels turn"),
            KeyCode::Char('+') => self.drive.faster(1.0),
            KeyCode::Char('-') => self.drive.faster(-1.0),
            _ => {}
        }
    }

    /// Zero, and no goal any more.
    fn stop(&mut self, now: Instant) {
        self.drive.stop();
        if self.read_only {
            self.say(now, "read-only: nothing is sent");
            return;
        }
        let timestamp = self.epoch.timestamp(now);
        let source = self.source.clone();
        let zero = CmdMotion { timestamp, speed: 0.0, steering: 0.0, priority: CmdMotion::REMOTE, source };
        self.out.extend([zero.into(), CmdGoal { timestamp, ..CmdGoal::default() }.into()]);
        self.say(now, "stop: zero sent, goal cancelled");
    }

    fn confirmed(&mut self, now: Instant, what: &str) {
        self.out.push(CmdHoming { timestamp: self.epoch.timestamp(now), axis: "steering".into() }.into());
        self.say(now, format!("sent: {what}"));
    }

    fn command(&mut self, now: Instant, line: &str) {
        match command::read(line, self.epoch.timestamp(now), &self.source) {
            Ok(Asked::Quit) => self.quit = true,
            Ok(Asked::Say(_)) if self.read_only => self.say(now, "read-only: nothing is sent"),
            Ok(Asked::Say(message)) => {
                self.say(now, format!("sent on {}", message.channel_name()));
                self.out.push(*message);
            }
            Err(why) => self.say(now, why),
        }
    }
}

enum Typed {
    More(String),
    Done(String),
    Left,
}

fn typed(mut line: String, code: KeyCode) -> Typed {
    match code {
        KeyCode::Enter => return Typed::Done(line),
        KeyCode::Esc => return Typed::Left,
        KeyCode::Backspace if line.pop().is_none() => return Typed::Left,
        KeyCode::Char(c) if line.len() < LINE_MAX => line.push(c),
        _ => {}
    }
    Typed::More(line)
}
