//! A CAN port of our own: frames in, frames out, in order, none lost by us.

use super::target::Target;
use crate::Failed;
use crate::holder::holder;
use crate::port::OpenPort;
use base::can::{Frame, Notice};
use base::{Duration, Instant};
use host::clock;
use host::ports::{PortConfig, Received};
use module::{Input, Output};

/// Received event.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// A foreign frame.
    Frame {
        /// The frame.
        frame: Frame,
        /// Kernel time of its reception, ns since 1970, if available.
        stamp: Option<u64>,
    },
    /// A notice of the controller.
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

    /// Next received event.
    pub fn receive(&mut self, now: Instant) -> Result<Heard, Failed> {
        let heard = match self.open.port.device.receive(now) {
            Ok(Received::Nothing) => Ok(Heard::Nothing),
            Ok(Received::Input { input: Input::Can { frame, .. }, stamp, .. }) => Ok(Heard::Frame { frame, stamp }),
            Ok(Received::Input { input: Input::CanNotice(notice), .. }) => Ok(Heard::Notice(notice)),
            Ok(Received::Input { input: Input::Down(_), .. }) => Err("the port is down".into()),
            Ok(Received::Input { .. }) => Ok(Heard::Note(String::new())),
            Ok(Received::Fault(_, note) | Received::Note(note)) => Ok(Heard::Note(note)),
            Err(why) => Err(why),
        };
        heard.map_err(|why| self.open.lost(&why))
    }

    /// True if the last frame still waits for room: nothing more can be sent now.
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
