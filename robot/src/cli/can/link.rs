//! A CAN port of our own: frames in, frames out, in order, none lost by us.

use super::target::Target;
use crate::cli::Failed;
use crate::cli::holder::holder;
use crate::cli::port::OpenPort;
use crate::live::clock;
use crate::live::ports::{PortConfig, Received};
use base::can::{Frame, Notice};
use base::{Duration, Instant};
use module::{Input, Output};

/// What was heard.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// A frame of somebody else.
    Frame(Frame),
    /// The controller says something.
    Notice(Notice),
    /// A line for people: what else was wrong.
    Note(String),
    /// Nothing more now.
    Nothing,
}

/// An opened bus.
pub struct Link {
    open: OpenPort,
    /// A frame that found no room.
    waiting: Option<Frame>,
}

/// A queue without room is tried again after this.
const NO_ROOM: Duration = Duration::from_micros(500);

impl Link {
    /// Opens the bus. Of the ways to one only a serial device is for one process at a time.
    pub fn open(target: &Target) -> Result<Self, Failed> {
        if let PortConfig::CanSlcan { path, .. } = &target.port
            && let Some(holder) = holder(path)
        {
            return Err(format!("{} is held by {}", target.name, holder.text()).into());
        }
        Ok(Self { open: OpenPort::open(&target.name, target.port.clone())?, waiting: None })
    }

    /// What has come.
    pub fn receive(&mut self, now: Instant) -> Result<Heard, Failed> {
        let heard = match self.open.port.device.receive(now) {
            Ok(Received::Nothing) => Ok(Heard::Nothing),
            Ok(Received::Input(Input::Can(frame))) => Ok(Heard::Frame(frame)),
            Ok(Received::Input(Input::CanNotice(notice))) => Ok(Heard::Notice(notice)),
            Ok(Received::Input(Input::Down(_))) => Err("the port is down".into()),
            Ok(Received::Input(_)) => Ok(Heard::Note(String::new())),
            Ok(Received::Fault(_, note) | Received::Note(note)) => Ok(Heard::Note(note)),
            Err(why) => Err(why),
        };
        heard.map_err(|why| self.open.lost(&why))
    }

    /// When the kernel received the last frame, ns of its wall clock, where it says so.
    pub fn stamp(&self) -> Option<u64> {
        self.open.port.device.stamp()
    }

    /// Whether the last frame still waits for room: nothing more can be sent now.
    pub fn is_full(&self) -> bool {
        self.waiting.is_some()
    }

    /// Sends a frame; only when [`Link::is_full`] denies.
    pub fn send(&mut self, now: Instant, frame: Frame) -> Result<(), Failed> {
        self.waiting = Some(frame);
        self.flush(now)
    }

    /// Tries again to send what found no room.
    pub fn flush(&mut self, now: Instant) -> Result<(), Failed> {
        if let Some(frame) = self.waiting
            && self.open.port.device.send(now, &Output::Can(frame)).map_err(|why| self.open.lost(&why))?
        {
            self.waiting = None;
        }
        Ok(())
    }

    /// Waits until something can be read, or until `until`; true at Ctrl-C.
    pub fn wait(&mut self, until: Instant) -> Result<bool, Failed> {
        let until = if self.is_full() { until.min(clock::now() + NO_ROOM) } else { until };
        self.open.wait(until)
    }

    /// A line for people.
    pub fn tell(&self, note: &str) {
        self.open.tell(note);
    }
}
