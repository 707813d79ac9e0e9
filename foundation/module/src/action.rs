//! All effects of a module on the world, on one page.

use crate::{PortId, State};
use base::serial::Word;
use base::{Epoch, Fault, Instant, Level, Report, Severity, can, gamepad, gpio, i2c, store, thermal, w1};
use messages::Message;

/// Effect requested by a module.
#[derive(Clone, Debug)]
pub enum Action {
    /// Publish a message on its channel.
    Publish(Message),
    /// Send an output on a port.
    Send(PortId, Output),
    /// To the shell: a fault is active from now on. It is reported once until it is cleared.
    Raise(Report),
    /// To the shell: the fault with this subject is cleared.
    Clear(Report),
    /// A single event to be reported. From the shell to the host: print this.
    Report(Report),
    /// A text for people. From a module to the shell, which publishes it on `CM_EVENT_TEXT`; from the shell to the
    /// host: print this.
    Note(Level, String),
    /// To the shell: the module is able to work, or not.
    Condition(Condition),
    /// Start or end a process; watchdog only.
    Process(ProcessCommand),
    /// Run this command with its arguments: the configured command for halting or restarting the computer. Executed by
    /// a live host only, which does not wait for it.
    Run(Vec<String>),
    /// From the shell to the host: the new state.
    State(State),
    /// End the process with this code (see [`crate::exit`]) after all earlier output has left.
    Exit(u8),
}

/// Ability of a module to work; the shell derives states from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// Its devices are available: leads out of INIT into the wanted state, and out of ERROR to the previous state.
    Working,
    /// A required device is missing: leads into ERROR.
    Failed,
}

/// Output on a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// A CAN frame.
    Can(can::Frame),
    /// Words of a serial line; the host answers with `Input::Sent` when the last one has left the wire.
    Words(Vec<Word>),
    /// A transfer on an I2C bus; the host answers with `Input::I2c`. At most [`OUTSTANDING`] may be pending.
    I2c(i2c::Transfer),
    /// The simulator's end of an I2C bus: outcome of the oldest pending `Input::I2cRequested`.
    I2cAnswer(i2c::Outcome),
    /// A request on a 1-Wire bus; the host answers with `Input::OneWire`. At most [`OUTSTANDING`] may be pending.
    OneWire(w1::Request),
    /// The simulator's end of a 1-Wire bus: the present thermometers, or the value of one of them, from now on.
    OneWireState(w1::Answer),
    /// The temperatures of the computer are read; the host answers with `Input::Thermal`. At most [`OUTSTANDING`] may
    /// be pending.
    Thermal,
    /// The simulator's end of them: what they are from now on.
    ThermalState(thermal::State),
    /// An event of a simulated gamepad.
    Gamepad(gamepad::Event),
    /// A digital output is set, or read, or an input is read; the host answers with `Input::Gpio`. At most
    /// [`OUTSTANDING`] may be pending. From the simulator's end: the answer.
    Gpio(gpio::Signal),
    /// A request to a folder of log files; the host answers with `Input::Store`. At most [`OUTSTANDING`] may be
    /// pending.
    Store(store::Request),
}

/// Maximum number of pending transfers and requests on a port; further ones are dropped, which a live host reports as
/// `PortOverrun`.
pub const OUTSTANDING: usize = 8;

/// Command of the watchdog to its host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ProcessCommand {
    /// Start the module's process; it goes to `wanted` when it is ready.
    Spawn {
        /// Name of the module.
        module: String,
        /// First state after INIT.
        wanted: State,
    },
    /// Ask the process and its group to end (SIGTERM).
    Terminate {
        /// Process id.
        pid: u32,
    },
    /// End the process and its group now (SIGKILL).
    Kill {
        /// Process id.
        pid: u32,
    },
    /// Keep this for the next watchdog in case this one dies: [`crate::ProcessEvent::Earlier`].
    Remember {
        /// Name of the module.
        module: String,
        /// Wanted state of the module.
        wanted: State,
        /// True if only an operator leads it out of TERMINATE into RUN.
        held: bool,
    },
    /// Health of the critical modules from now on: the supervisor of the watchdog is fed only while they are healthy.
    Health {
        /// True if all critical modules are healthy.
        healthy: bool,
        /// Summary of all modules for people.
        status: String,
    },
}

/// Actions of a module; the host drains it after every call.
#[derive(Debug, Default)]
pub struct Actions {
    epoch: Epoch,
    list: Vec<Action>,
}

impl Actions {
    /// Creates an empty list for a process whose time counts from `epoch`.
    #[must_use]
    pub fn new(epoch: Epoch) -> Self {
        Self { epoch, list: Vec::new() }
    }

    /// Epoch of the process.
    #[must_use]
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// Message timestamp of an instant, microseconds since the UNIX epoch.
    #[must_use]
    pub fn timestamp(&self, at: Instant) -> i64 {
        self.epoch.timestamp(at)
    }

    /// Appends any action.
    pub fn push(&mut self, action: Action) {
        self.list.push(action);
    }

    /// Publishes a message on its channel.
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

    /// Starts a transfer on an I2C bus.
    pub fn transfer(&mut self, port: PortId, transfer: i2c::Transfer) {
        self.push(Action::Send(port, Output::I2c(transfer)));
    }

    /// Sends a request to a 1-Wire bus.
    pub fn ask_w1(&mut self, port: PortId, request: w1::Request) {
        self.push(Action::Send(port, Output::OneWire(request)));
    }

    /// Sends a request to a folder of log files.
    pub fn store(&mut self, port: PortId, request: store::Request) {
        self.push(Action::Send(port, Output::Store(request)));
    }

    /// Raises a fault: active and listed on `CM_DATA_FAULTS` until cleared, reported once.
    #[track_caller]
    pub fn raise(&mut self, severity: Severity, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        self.push(Action::Raise(Report::new(severity, fault, subject, message)));
    }

    /// Clears the fault with this subject; reported as a notice if it was active.
    #[track_caller]
    pub fn clear(&mut self, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        self.push(Action::Clear(Report::new(Severity::Notice, fault, subject, message)));
    }

    /// Reports a single event.
    #[track_caller]
    pub fn report(&mut self, severity: Severity, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        self.push(Action::Report(Report::new(severity, fault, subject, message)));
    }

    /// Reports a fatal error, severity ERROR, and ends the process with this code: one of [`crate::exit`] other than 0.
    #[track_caller]
    pub fn fatal(&mut self, fault: Fault, subject: impl Into<String>, message: impl Into<String>, code: u8) {
        self.push(Action::Report(Report::new(Severity::Error, fault, subject, message).fatal()));
        self.push(Action::Exit(code));
    }

    /// Adds a text for people, level INFO.
    pub fn note(&mut self, line: impl Into<String>) {
        self.say(Level::Info, line);
    }

    /// Adds a text for people.
    pub fn say(&mut self, level: Level, line: impl Into<String>) {
        self.push(Action::Note(level, line.into()));
    }

    /// Reports that the module is able to work.
    pub fn working(&mut self) {
        self.push(Action::Condition(Condition::Working));
    }

    /// Reports that the module is not able to work.
    pub fn failed(&mut self) {
        self.push(Action::Condition(Condition::Failed));
    }

    /// Removes and returns all actions, in order.
    pub fn drain(&mut self) -> impl Iterator<Item = Action> + '_ {
        self.list.drain(..)
    }

    /// Moves the actions from index `from` on to `to`.
    pub(crate) fn split_off(&mut self, from: usize, to: &mut Self) {
        to.list.extend(self.list.drain(from..));
    }

    /// Inserts an action at index `place`.
    pub(crate) fn insert(&mut self, place: usize, action: Action) {
        self.list.insert(place.min(self.list.len()), action);
    }

    /// Actions pushed and not drained yet.
    #[must_use]
    pub fn as_slice(&self) -> &[Action] {
        &self.list
    }
}
