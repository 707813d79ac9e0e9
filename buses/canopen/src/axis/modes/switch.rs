//! Switching the mode of operation: 0x6060 is written, 0x6061 must show it in time (CiA 402-2, 9.1).
//! It requests SDO transfers one at a time ([`Switch::poll_sdo`]) and takes their results; where a TPDO carries 0x6061,
//! its value may be passed too.

use super::Mode;
use crate::{Payload, sdo};
use base::{Duration, Instant};
use core::fmt;

/// Time between two reads of the mode display.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// An SDO transfer to make.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read an object.
    Read {
        /// The object's index.
        index: u16,
        /// The object's sub-index.
        sub: u8,
    },
    /// Write an object.
    Write {
        /// The object's index.
        index: u16,
        /// The object's sub-index.
        sub: u8,
        /// Value.
        data: Payload,
    },
}

impl Access {
    /// Write a number.
    #[must_use]
    pub fn write(index: u16, sub: u8, data: impl Into<Payload>) -> Self {
        Self::Write { index, sub, data: data.into() }
    }

    /// Index and sub-index.
    #[must_use]
    pub const fn object(&self) -> (u16, u8) {
        match self {
            Self::Read { index, sub } | Self::Write { index, sub, .. } => (*index, *sub),
        }
    }
}

/// Why a mode was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwitchError {
    /// An object could not be read or written.
    Sdo {
        /// The object's index.
        index: u16,
        /// Why.
        error: sdo::Error,
    },
    /// The mode display (0x6061) does not follow.
    NotShown {
        /// Displayed mode; `None`: not read.
        shown: Option<i8>,
    },
}

impl fmt::Display for SwitchError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sdo { index, error } => write!(f, "0x{index:04X}:0 {error}"),
            Self::NotShown { shown: Some(shown) } => write!(f, "the mode display stays {shown}"),
            Self::NotShown { shown: None } => f.write_str("the mode display was not read"),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    /// 0x6060 is to be written, or is being written.
    Writing,
    /// 0x6061 is looked at.
    Showing {
        look: Instant,
        until: Instant,
    },
}

/// The mode of one axis on its way to another.
#[derive(Clone, Debug)]
pub struct Switch {
    timeout: Duration,
    mode: i8,
    state: State,
    shown: Option<i8>,
    /// A transfer to be made, and one under way.
    wanted: Option<Access>,
    pending: Option<Access>,
    finished: Option<Result<(), SwitchError>>,
}

impl Switch {
    /// Idle; a drive may take `timeout` to show a new mode.
    #[must_use]
    pub fn new(timeout: Duration) -> Self {
        Self { timeout, mode: 0, state: State::Idle, shown: None, wanted: None, pending: None, finished: None }
    }

    /// Asks for a mode of the standard.
    pub fn start(&mut self, mode: Mode) {
        self.start_code(mode.code());
    }

    /// Asks for any mode, manufacturers' too. One that is under way is given up.
    pub fn start_code(&mut self, mode: i8) {
        self.mode = mode;
        self.state = State::Writing;
        self.finished = None;
        self.shown = None;
        self.wanted = Some(Access::write(0x6060, 0, mode));
    }

    /// True if it is under way.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.state != State::Idle
    }

    /// True if a transfer is under way.
    pub(super) fn is_busy(&self) -> bool {
        self.pending.is_some()
    }

    /// Ends because the node is lost; nothing more is reported.
    pub fn lost(&mut self) {
        *self = Self::new(self.timeout);
    }

    /// Next SDO transfer; its result goes to [`Self::handle_sdo`].
    pub fn poll_sdo(&mut self) -> Option<Access> {
        if self.pending.is_some() {
            return None;
        }
        self.pending = self.wanted.take();
        self.pending.clone()
    }

    /// The transfer that [`Self::poll_sdo`] gave has ended: what was read, nothing for a write.
    pub fn handle_sdo(&mut self, now: Instant, result: Result<Payload, sdo::Error>) {
        let Some(access) = self.pending.take() else {
            return;
        };
        let (index, _) = access.object();
        match (self.state, access, result) {
            // Result of a transfer that the state no longer needs.
            _ if self.wanted.is_some() => {}
            (State::Idle, ..) => {}
            (_, _, Err(error)) => self.finish(Err(SwitchError::Sdo { index, error })),
            (State::Writing, Access::Write { .. }, Ok(_)) => {
                self.state = State::Showing { look: now, until: now + self.timeout };
            }
            (State::Showing { until, .. }, Access::Read { .. }, Ok(data)) => {
                self.state = State::Showing { look: now + LOOK_EVERY, until };
                if let [shown] = *data {
                    self.handle_display(shown as i8);
                }
            }
            (State::Writing | State::Showing { .. }, ..) => {}
        }
        self.handle_timeout(now);
    }

    /// Takes the value of 0x6061 from a TPDO.
    pub fn handle_display(&mut self, shown: i8) {
        if let State::Showing { .. } = self.state {
            self.shown = Some(shown);
            if shown == self.mode {
                self.finish(Ok(()));
            }
        }
    }

    fn finish(&mut self, result: Result<(), SwitchError>) {
        self.state = State::Idle;
        self.wanted = None;
        self.finished = Some(result);
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        match self.state {
            State::Showing { until, .. } if until <= now => {
                self.finish(Err(SwitchError::NotShown { shown: self.shown }));
            }
            State::Showing { look, .. } if look <= now && self.pending.is_none() => {
                self.wanted = Some(Access::Read { index: 0x6061, sub: 0 });
            }
            _ => {}
        }
    }

    /// Result, returned once.
    pub fn poll_finished(&mut self) -> Option<Result<(), SwitchError>> {
        self.finished.take()
    }

    /// Instant of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let busy = self.pending.is_some() || self.wanted.is_some();
        match self.state {
            State::Idle | State::Writing => None,
            State::Showing { look, until } => Some(if busy { until } else { look.min(until) }),
        }
    }
}
