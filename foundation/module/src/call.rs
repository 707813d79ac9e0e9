//! Calls of a shell, for recording.

use crate::{Action, Actions, Event, Input, PortId, Shell};
use base::{Epoch, Instant, Level, Report, can};
use std::fmt;

/// One call of a [`Shell`].
#[derive(Clone, Copy, Debug)]
pub enum Call<'a> {
    /// [`Shell::handle`]
    Event(Event<'a>),
    /// [`Shell::terminate`]
    Terminate,
    /// [`Shell::raise`]
    Raise(&'a Report),
    /// [`Shell::clear`]
    Clear(&'a Report),
    /// [`Shell::say`]
    Say(Level, &'a str),
}

impl Call<'_> {
    /// Executes the call on a shell.
    pub fn tell(self, shell: &mut Shell, now: Instant, out: &mut Actions) {
        match self {
            Self::Event(event) => shell.handle(now, event, out),
            Self::Terminate => shell.terminate(now, out),
            Self::Raise(report) => shell.raise(now, report.clone(), out),
            Self::Clear(report) => shell.clear(now, report.clone(), out),
            Self::Say(level, text) => shell.say(now, level, text, out),
        }
    }
}

impl fmt::Display for Call<'_> {
    /// Short description for people.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Event(Event::Message { message, .. }) => write!(f, "message {}", message.channel_name()),
            Self::Event(Event::RawMessage { channel, data, .. }) => write!(f, "{} bytes on {channel}", data.len()),
            Self::Event(Event::Port { port: PortId(port), input }) => match input {
                Input::Words(words) => write!(f, "port {port}: {} words", words.len()),
                Input::Can { frame, .. } => match frame.id() {
                    can::Id::Standard(id) => write!(f, "port {port}: CAN frame {id:03X} {:02X?}", frame.data()),
                    can::Id::Extended(id) => write!(f, "port {port}: CAN frame {id:08X} {:02X?}", frame.data()),
                },
                input => write!(f, "port {port}: {input:?}"),
            },
            Self::Event(Event::Process(event)) => write!(f, "process {event:?}"),
            Self::Event(event) => write!(f, "{event:?}"),
            Self::Terminate => f.write_str("the request to end"),
            Self::Raise(report) => write!(f, "the host's report {} {}", report.fault.name(), report.subject),
            Self::Clear(report) => write!(f, "the end of the host's report {} {}", report.fault.name(), report.subject),
            Self::Say(level, text) => write!(f, "the host's {} text {text}", level.name()),
        }
    }
}

/// Recorder of each call of a shell and its answer; see [`Shell::record`].
pub trait CallLog {
    /// Begins a call.
    fn call(&mut self, now: Instant, epoch: Epoch, call: &Call<'_>);

    /// Records the answer: actions, and the next deadline of the shell.
    fn answer(&mut self, actions: &[Action], wake: Option<Instant>);

    /// True if calls are missing because they did not fit.
    fn has_gaps(&self) -> bool;
}
