//! Every effect of a module on the world, on one page.

use crate::{PortId, State};
use base::serial::Word;
use base::{Epoch, Fault, Instant, Level, Report, Severity, can, gamepad, i2c, store, w1};
use messages::Message;

/// What a module wants done.
#[derive(Clone, Debug)]
pub enum Action {
    /// Send a message on its channel.
    Publish(Message),
    /// Send on a port.
    Send(PortId, Output),
    /// To the shell: a fault stands from now on. It is reported once until it is cleared.
    Raise(Report),
    /// To the shell: a fault of this subject stands no more.
    Clear(Report),
    /// Something happened, once. From the shell to the host: print this.
    Report(Report),
    /// A line for people. From a module to the shell, which sends it on `CM_EVENT_TEXT`; from the shell to the host:
    /// print this.
    Note(Level, String),
    /// To the shell: whether the module can do its work.
    Condition(Condition),
    /// Start or end a process; the watchdog alone.
    Process(ProcessCommand),
    /// Run this command with its arguments: what the configuration has for halting or restarting the computer. A live
    /// host alone does; nobody waits for it.
    Run(Vec<String>),
    /// From the shell to the host: the state from now on.
    State(State),
    /// End the process with this code (see [`crate::exit`]), after everything before it has left.
    Exit(u8),
}

/// Whether a module can do its work; the shell makes states of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// Its devices are there: leads out of INIT into the wanted state, and out of ERROR to where it came from.
    Working,
    /// A device that its work needs is not there: leads into ERROR.
    Failed,
}

/// What is sent on a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// A CAN frame.
    Can(can::Frame),
    /// Words of a 9-bit line; the host answers with `Input::Sent` when the last has left the wire.
    Words(Vec<Word>),
    /// A transfer on an I2C bus; the host answers with `Input::I2c`. At most [`OUTSTANDING`] may wait for theirs.
    I2c(i2c::Transfer),
    /// The simulator's end of an I2C bus: what comes of the oldest `Input::I2cAsked` that has none yet.
    I2cAnswer(i2c::Outcome),
    /// A request on a 1-Wire bus; the host answers with `Input::OneWire`. At most [`OUTSTANDING`] may wait for theirs.
    OneWire(w1::Request),
    /// The simulator's end of a 1-Wire bus: which thermometers are there, or what one of them says, from now on.
    OneWireIs(w1::Answer),
    /// What a simulated gamepad tells.
    Gamepad(gamepad::Event),
    /// A request to a folder of log files; the host answers with `Input::Store`. At most [`OUTSTANDING`] may wait for
    /// theirs.
    Store(store::Request),
}

/// Transfers and requests that wait for their answers on one port; more are dropped, which a live host reports as
/// `PortOverrun`.
pub const OUTSTANDING: usize = 8;

/// What the watchdog asks of the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ProcessCommand {
    /// Start the module's process; it goes to `wanted` when it is ready.
    Spawn {
        /// Which module.
        module: String,
        /// Its first state after INIT.
        wanted: State,
    },
    /// Ask the process and its group to end (SIGTERM).
    Terminate {
        /// Which.
        pid: u32,
    },
    /// End the process and its group now (SIGKILL).
    Kill {
        /// Which.
        pid: u32,
    },
    /// Keep this for the next watchdog, should this one die: [`crate::ProcessEvent::Earlier`].
    Remember {
        /// Which module.
        module: String,
        /// The state that is wanted of it.
        wanted: State,
        /// Whether only an operator leads it out of TERMINATE into RUN.
        held: bool,
    },
    /// Whether all critical modules are healthy, from now on: what guards the watchdog is fed only while they are.
    Health {
        /// Whether they are.
        healthy: bool,
        /// How all are, in a few words for people.
        status: String,
    },
}

/// Where a module puts its actions; the host drains it after every call.
#[derive(Debug, Default)]
pub struct Actions {
    epoch: Epoch,
    list: Vec<Action>,
}

impl Actions {
    /// An empty list for a process that counts time from `epoch`.
    #[must_use]
    pub fn new(epoch: Epoch) -> Self {
        Self { epoch, list: Vec::new() }
    }

    /// The process's epoch.
    #[must_use]
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// The message timestamp of a moment, microseconds since the UNIX epoch.
    #[must_use]
    pub fn timestamp(&self, at: Instant) -> i64 {
        self.epoch.timestamp(at)
    }

    /// Appends any action.
    pub fn push(&mut self, action: Action) {
        self.list.push(action);
    }

    /// Sends a message on its channel.
    pub fn publish(&mut self, message: impl Into<Message>) {
        self.push(Action::Publish(message.into()));
    }

    /// Sends a CAN frame.
    pub fn send_can(&mut self, port: PortId, frame: can::Frame) {
        self.push(Action::Send(port, Output::Can(frame)));
    }

    /// Sends words of a 9-bit line.
    pub fn send_words(&mut self, port: PortId, words: &[Word]) {
        self.push(Action::Send(port, Output::Words(words.to_vec())));
    }

    /// Makes a transfer on an I2C bus.
    pub fn transfer(&mut self, port: PortId, transfer: i2c::Transfer) {
        self.push(Action::Send(port, Output::I2c(transfer)));
    }

    /// Asks on a 1-Wire bus.
    pub fn ask_w1(&mut self, port: PortId, request: w1::Request) {
        self.push(Action::Send(port, Output::OneWire(request)));
    }

    /// Asks something of a folder of log files.
    pub fn store(&mut self, port: PortId, request: store::Request) {
        self.push(Action::Send(port, Output::Store(request)));
    }

    /// Raises a fault: active and listed on `CM_DATA_FAULTS` until cleared, reported once.
    #[track_caller]
    pub fn raise(&mut self, severity: Severity, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        self.push(Action::Raise(Report::new(severity, fault, subject, message)));
    }

    /// The fault of this subject stands no more; reported as a notice if it stood.
    #[track_caller]
    pub fn clear(&mut self, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        self.push(Action::Clear(Report::new(Severity::Notice, fault, subject, message)));
    }

    /// Something happened, once.
    #[track_caller]
    pub fn report(&mut self, severity: Severity, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        self.push(Action::Report(Report::new(severity, fault, subject, message)));
    }

    /// Adds a line for people, level INFO.
    pub fn note(&mut self, line: impl Into<String>) {
        self.say(Level::Info, line);
    }

    /// Adds a line for people.
    pub fn say(&mut self, level: Level, line: impl Into<String>) {
        self.push(Action::Note(level, line.into()));
    }

    /// The module can do its work.
    pub fn working(&mut self) {
        self.push(Action::Condition(Condition::Working));
    }

    /// The module cannot do its work.
    pub fn failed(&mut self) {
        self.push(Action::Condition(Condition::Failed));
    }

    /// Takes all actions, in order.
    pub fn drain(&mut self) -> impl Iterator<Item = Action> + '_ {
        self.list.drain(..)
    }

    /// Moves what was pushed since there were `from` to `to`.
    pub(crate) fn split_off(&mut self, from: usize, to: &mut Self) {
        to.list.extend(self.list.drain(from..));
    }

    /// Inserts an action at index `place`.
    pub(crate) fn insert(&mut self, place: usize, action: Action) {
        self.list.insert(place.min(self.list.len()), action);
    }

    /// What was pushed and not drained yet.
    #[must_use]
    pub fn as_slice(&self) -> &[Action] {
        &self.list
    }
}
