//! State of the terminal: messages and keys ([`super::keys`]) in, messages out. Draws nothing.

use super::drive::{Drive, Motion};
use super::rows;
use super::runs::Runs;
use super::sdo::Objects;
use crate::fault::Offered;
use base::listed;
use base::{Duration, Epoch, Instant};
use diagnostics::{Concern, Model, Status};
use messages::Message;
use messages::common::Error;
use messages::lowlevel::{CmdMotion, CmdVelocity};
use std::collections::BTreeMap;
use std::mem;

/// Display time of a message to the user.
const SAID: Duration = Duration::from_secs(6);
/// A report within this time after a command is taken for its answer.
const ANSWER: Duration = Duration::from_secs(3);
/// Maximum number of channels with a kept message, and maximum length of it, bytes.
const LATEST_MAX: usize = 500;
const LATEST_BYTES: usize = 256 * 1024;

listed! {
    /// The views, in the order of their numbers.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Tab {
        Overview => "Overview",
        Modules => "Modules",
        Buses => "Buses",
        Errors => "Errors",
        Messages => "Messages",
        Logs => "Logs",
    }
}

impl Tab {
    /// Sort orders of its rows; the first is the default.
    pub const fn orders(self) -> &'static [&'static str] {
        match self {
            Self::Modules => &["as started", "trouble first", "cpu", "memory", "restarts", "name"],
            Self::Errors => &["active first", "latest", "count"],
            Self::Messages => &["name", "rate", "bytes"],
            Self::Overview | Self::Buses | Self::Logs => &[""],
        }
    }

    pub fn next(self, steps: usize) -> Self {
        Self::ALL[(self as usize + steps) % Self::ALL.len()]
    }
}

/// Input mode of keys.
#[derive(Clone, Debug, PartialEq)]
pub enum Mode {
    Normal,
    /// Behind `:`.
    Command(String),
    /// Behind `/`.
    Filter(String),
    Help,
    /// A risky thing waits for `y`.
    Confirm(String, Box<Message>),
}

/// Frozen state of the screen.
pub struct Frozen {
    pub at: Instant,
    /// The same instant of the robot's time.
    model_at: Instant,
    model: Model,
    latest: BTreeMap<String, Message>,
}

/// Initial knowledge of the terminal.
pub struct Setup {
    pub model: Model,
    pub drive: Drive,
    pub read_only: bool,
    pub epoch: Epoch,
    /// Name of the commanding user in messages.
    pub source: String,
    /// Session of its motion commands.
    pub session: i64,
    /// The CANopen nodes and their axes.
    pub nodes: Vec<(i32, String)>,
    pub runs: Runs,
    /// What can be broken; empty without a simulation.
    pub faults: Offered,
}

/// The terminal's state.
pub struct App {
    model: Model,
    latest: BTreeMap<String, Message>,
    pub tab: Tab,
    pub mode: Mode,
    /// Filter: only rows that contain it are listed.
    pub filter: String,
    /// Marked row: its key, and its index in case the key is gone.
    pub mark: (String, usize),
    /// True if the marked row is shown in detail.
    pub expanded: bool,
    /// Scroll position of help and of a message, lines.
    pub scroll: u16,
    /// Which of its orders each view has.
    pub orders: [usize; Tab::ALL.len()],
    pub drive: Drive,
    pub read_only: bool,
    pub frozen: Option<Box<Frozen>>,
    pub quit: bool,
    pub nodes: Vec<(i32, String)>,
    pub runs: Runs,
    pub faults: Offered,
    pub objects: Objects,
    /// Lines that were typed behind `:`, and which of them is shown.
    pub history: (Vec<String>, usize),
    said: Option<(Instant, String)>,
    asked: Option<Instant>,
    epoch: Epoch,
    session: i64,
    source: String,
    out: Vec<Message>,
}

impl App {
    pub fn new(setup: Setup) -> Self {
        let Setup { model, drive, read_only, epoch, source, session, nodes, runs, faults } = setup;
        Self {
            model,
            latest: BTreeMap::new(),
            tab: Tab::Overview,
            mode: Mode::Normal,
            filter: String::new(),
            mark: (String::new(), 0),
            expanded: false,
            scroll: 0,
            orders: [0; Tab::ALL.len()],
            drive,
            read_only,
            frozen: None,
            quit: false,
            nodes,
            runs,
            faults,
            objects: Objects::default(),
            history: (Vec::new(), 0),
            said: None,
            asked: None,
            epoch,
            session,
            source,
            out: Vec::new(),
        }
    }

    /// Takes a message of the bus.
    pub fn hear(&mut self, at: Instant, channel: &str, bytes: usize, message: Option<Message>) {
        if let Some(message) = message.as_ref().filter(|_| bytes <= LATEST_BYTES)
            && (self.latest.contains_key(channel) || self.latest.len() < LATEST_MAX)
        {
            self.latest.insert(channel.into(), message.clone());
        }
        match &message {
            Some(Message::LlDataSdo(answer)) => {
                if let Some(line) = self.objects.hear(at, answer) {
                    self.say(at, line);
                }
            }
            // Refusal of a recent command.
            Some(Message::CmEventError(error))
                if error.severity != Error::NOTICE && self.asked.is_some_and(|asked| at.since(asked) < ANSWER) =>
            {
                self.say(at, format!("{}: {}", error.module, error.message));
            }
            _ => {}
        }
        self.model.receive(at, channel, bytes, message);
    }

    /// The model as it is shown, and the moment of what is shown, in the robot's time.
    pub fn shown(&self, now: Instant) -> (&Model, Instant) {
        let live = || (&self.model, self.model.at(now));
        self.frozen.as_ref().map_or_else(live, |frozen| (&frozen.model, frozen.model_at))
    }

    /// Holds what is shown, or lets it go on.
    pub fn freeze(&mut self, now: Instant) {
        self.frozen = match self.frozen {
            Some(_) => None,
            None => Some(Box::new(Frozen {
                at: now,
                model_at: self.model.at(now),
                model: self.model.clone(),
                latest: self.latest.clone(),
            })),
        };
    }

    /// The robot's name.
    pub fn robot(&self) -> &str {
        self.model.robot()
    }

    /// Status of the robot, frozen or not.
    pub fn status(&self, now: Instant) -> Status {
        self.model.status(self.model.at(now))
    }

    /// What is not well, frozen or not.
    pub fn concerns(&self, now: Instant) -> Vec<Concern> {
        self.model.concerns(self.model.at(now))
    }

    /// Number of modules with problems, and of active errors; now, frozen or not.
    pub fn troubles(&self, now: Instant) -> (usize, usize) {
        let now = self.model.at(now);
        let unwell = self.model.modules(now).iter().filter(|row| !row.well).count();
        (unwell, self.model.errors.groups(now).iter().filter(|group| group.standing).count())
    }

    /// The latest message of a channel, as it is shown.
    pub fn latest(&self, channel: &str) -> Option<&Message> {
        self.frozen.as_ref().map_or(&self.latest, |frozen| &frozen.latest).get(channel)
    }

    /// Present message to the user.
    pub fn said(&self, now: Instant) -> Option<&str> {
        self.said.as_ref().filter(|(at, _)| now.since(*at) < SAID).map(|(_, text)| text.as_str())
    }

    /// Shows a message to the user.
    pub fn say(&mut self, now: Instant, text: impl Into<String>) {
        self.said = Some((now, text.into()));
    }

    /// True if a row is listed.
    pub fn lists(&self, row: &str) -> bool {
        self.filter.is_empty() || row.to_lowercase().contains(&self.filter.to_lowercase())
    }

    /// The order of this view's rows.
    pub fn order(&self) -> &'static str {
        let orders = self.tab.orders();
        orders[self.orders[self.tab as usize] % orders.len()]
    }

    /// Which of the rows is marked.
    pub fn marked(&self, keys: &[String]) -> usize {
        let place = keys.iter().position(|key| *key == self.mark.0);
        place.unwrap_or(self.mark.1.min(keys.len().saturating_sub(1)))
    }

    /// Moves the mark by this number of rows.
    pub fn move_mark(&mut self, now: Instant, steps: isize) {
        let keys = rows::keys(self, now);
        let place = self.marked(&keys).saturating_add_signed(steps).min(keys.len().saturating_sub(1));
        self.mark = (keys.into_iter().nth(place).unwrap_or_default(), place);
    }

    /// Key of the marked row.
    pub fn marked_key(&self, now: Instant) -> Option<String> {
        let keys = rows::keys(self, now);
        let place = self.marked(&keys);
        keys.into_iter().nth(place)
    }

    pub fn turn_to(&mut self, tab: Tab) {
        (self.tab, self.mark, self.expanded, self.scroll) = (tab, (String::new(), 0), false, 0);
    }

    /// Timestamp for a message published now.
    pub fn timestamp(&self, now: Instant) -> i64 {
        self.epoch.timestamp(now)
    }

    /// Name of the commanding user.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// To be sent; unless nothing may be.
    pub fn send(&mut self, now: Instant, message: impl Into<Message>, said: impl Into<String>) {
        if self.read_only {
            self.say(now, "read-only: nothing is sent");
            return;
        }
        self.out.push(message.into());
        self.asked = Some(now);
        self.say(now, said);
    }

    /// Messages to publish now.
    pub fn poll(&mut self, now: Instant) -> Vec<Message> {
        if let Some(motion) = self.drive.poll(now) {
            let (timestamp, priority, source) = (self.epoch.timestamp(now), CmdMotion::REMOTE, self.source.clone());
            self.out.push(match motion {
                Motion::Curve(speed, steering) => CmdMotion { timestamp, speed, steering, priority, source }.into(),
                Motion::Velocity(vx, vy, omega) => {
                    let session = self.session;
                    CmdVelocity { timestamp, vx, vy, omega, priority, source, session }.into()
                }
            });
        }
        if let Some(line) = self.objects.poll(now) {
            self.say(now, line);
        }
        // Listing a folder may take a disk's time, and who drives has none to spare.
        if self.tab == Tab::Logs && !self.drive.is_taken() {
            self.look(now);
        }
        mem::take(&mut self.out)
    }

    /// Looks into the log folder.
    pub fn look(&mut self, now: Instant) {
        let recorded = self.model.log.fresh(self.model.at(now)).filter(|log| log.recording).map(|log| log.run.as_str());
        self.runs.look(now, recorded);
    }

    /// The terminal was left: another window, or it is gone.
    pub fn on_focus_lost(&mut self) {
        self.drive.stop();
    }

    /// The terminal took nothing for a while, and he who drives saw nothing.
    pub fn on_stall(&mut self, now: Instant) {
        self.drive.give_back();
        self.say(now, "the terminal stood still: the drive is given back; d takes it again");
    }
}
