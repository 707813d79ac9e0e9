//! Homing (CiA 402-2, 11): set the method by SDO, switch the mode, start by controlword bit 4, decode the result,
//! switch the mode back.
//!
//! It asks for SDO transfers one at a time ([`Homing::poll_sdo`]) and is told their ends; the caller adds its
//! [`Homing::controlword_bits`] to the controlword of an enabled axis and shows it every statusword.

use crate::axis::{control, status};
use crate::master::ConfigWrite;
use crate::{Payload, sdo};
use base::{Duration, Instant};
use core::fmt;

const HOMING_MODE: i8 = 6;
/// How long the mode display is waited for between two looks.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How long a drive may take to switch its mode, or to show that it has started.
const REACT_WITHIN: Duration = Duration::from_millis(500);

/// How to home.
#[derive(Clone, Copy, Debug)]
pub struct HomingConfig {
    /// 0x6098; 23 to 30: a home switch without index.
    pub method: i8,
    /// 0x6099:1, speed while the switch is searched, in the drive's unit.
    pub switch_speed: u32,
    /// 0x6099:2, speed while its edge is searched.
    pub zero_speed: u32,
    /// 0x609A, in the drive's unit; `None`: as the drive has it.
    pub acceleration: Option<u32>,
    /// 0x607C, what the home position counts as; `None`: as the drive has it.
    pub offset: Option<i32>,
    /// The mode of operation to go back to.
    pub mode_after: i8,
    /// How long the motion may take.
    pub timeout: Duration,
}

/// Why homing failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingError {
    /// An object could not be read or written.
    Sdo {
        /// The object's index.
        index: u16,
        /// The object's sub-index.
        sub: u8,
        /// Why.
        error: sdo::Error,
    },
    /// The mode display (0x6061) does not follow.
    Mode,
    /// The drive shows no sign of having started.
    NotStarted,
    /// The drive says that it was interrupted.
    Interrupted,
    /// The drive says that homing failed (statusword bit 13).
    Refused,
    /// It takes too long.
    Timeout,
    /// [`Homing::cancel`] was called.
    Cancelled,
}

impl fmt::Display for HomingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sdo { index, sub, error } => write!(f, "0x{index:04X}:{sub} {error}"),
            Self::Mode => f.write_str("the mode of operation does not change"),
            Self::NotStarted => f.write_str("does not start"),
            Self::Interrupted => f.write_str("interrupted"),
            Self::Refused => f.write_str("the drive reports a homing error"),
            Self::Timeout => f.write_str("takes too long"),
            Self::Cancelled => f.write_str("cancelled"),
        }
    }
}

/// What a statusword says of homing: bits 13, 12 and 10.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the standard's
pub enum Progress {
    Running,
    NotStarted,
    AttainedMoving,
    Done,
    ErrorMoving,
    ErrorStopped,
}

impl Progress {
    /// Decodes a statusword in homing mode.
    #[must_use]
    pub fn decode(statusword: u16) -> Self {
        let bit = |mask| statusword & mask != 0;
        match (bit(status::MODE_13), bit(status::MODE_12), bit(status::TARGET_REACHED)) {
            (false, false, false) => Self::Running,
            (false, false, true) => Self::NotStarted,
            (false, true, false) => Self::AttainedMoving,
            (false, true, true) => Self::Done,
            (true, _, false) => Self::ErrorMoving,
            (true, _, true) => Self::ErrorStopped,
        }
    }
}

/// An SDO transfer to make.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read 0x6061.
    ReadMode,
    /// Write an object.
    Write(ConfigWrite),
}

impl Access {
    fn object(&self) -> (u16, u8) {
        match self {
            Self::ReadMode => (0x6061, 0),
            Self::Write(write) => (write.index, write.sub),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    /// Write number `at` of the preparation.
    Preparing {
        at: usize,
    },
    /// The mode was set to homing; its display is looked at.
    Entering {
        look: Instant,
        until: Instant,
    },
    /// Bit 4 is high. `before`: what the drive said then; `began`: it was seen moving.
    Running {
        before: Progress,
        began: bool,
        react: Instant,
        until: Instant,
    },
    /// The old mode is set again, then its display looked at.
    Restoring {
        result: Result<(), HomingError>,
    },
    Leaving {
        result: Result<(), HomingError>,
        look: Instant,
        until: Instant,
    },
}

/// Homing of one axis.
pub struct Homing {
    config: HomingConfig,
    state: State,
    /// A transfer to be made, and one under way.
    wanted: Option<Access>,
    pending: Option<Access>,
    statusword: u16,
    finished: Option<Result<(), HomingError>>,
}

impl Homing {
    /// Not begun.
    #[must_use]
    pub fn new(config: HomingConfig) -> Self {
        Self { config, state: State::Idle, wanted: None, pending: None, statusword: 0, finished: None }
    }

    /// Begins; the axis must be enabled. While it runs nothing happens.
    pub fn start(&mut self) {
        if self.state == State::Idle {
            self.finished = None;
            self.prepare(0);
        }
    }

    /// Whether it runs.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.state != State::Idle
    }

    /// Gives up: bit 4 falls and the old mode is restored, then the end is told.
    pub fn cancel(&mut self) {
        match self.state {
            State::Idle | State::Restoring { .. } | State::Leaving { .. } => {}
            _ => self.restore(Err(HomingError::Cancelled)),
        }
    }

    /// The node is lost: ends at once and tells it.
    pub fn lost(&mut self) {
        if self.is_running() {
            self.finish(Err(HomingError::Cancelled));
        }
    }

    fn preparation(&self, at: usize) -> Option<ConfigWrite> {
        let config = &self.config;
        [
            Some(ConfigWrite::new(0x6098, 0, config.method)),
            Some(ConfigWrite::new(0x6099, 1, config.switch_speed)),
            Some(ConfigWrite::new(0x6099, 2, config.zero_speed)),
            config.acceleration.map(|value| ConfigWrite::new(0x609A, 0, value)),
            config.offset.map(|value| ConfigWrite::new(0x607C, 0, value)),
            Some(ConfigWrite::new(0x6060, 0, HOMING_MODE)),
        ]
        .into_iter()
        .flatten()
        .nth(at)
    }

    fn prepare(&mut self, at: usize) {
        self.state = State::Preparing { at };
        self.wanted = self.preparation(at).map(Access::Write);
    }

    fn restore(&mut self, result: Result<(), HomingError>) {
        self.state = State::Restoring { result };
        self.wanted = Some(Access::Write(ConfigWrite::new(0x6060, 0, self.config.mode_after)));
    }

    fn finish(&mut self, result: Result<(), HomingError>) {
        self.state = State::Idle;
        self.wanted = None;
        self.pending = None;
        self.finished = Some(result);
    }

    /// A transfer to make now; tell its end by [`Self::handle_sdo`].
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
        let (index, sub) = access.object();
        match (self.state, access, result) {
            // The state has moved on since it was asked for.
            (_, _, _) if self.wanted.is_some() => {}
            (State::Restoring { result: Ok(()) } | State::Leaving { result: Ok(()), .. }, _, Err(error)) => {
                self.finish(Err(HomingError::Sdo { index, sub, error }));
            }
            (State::Restoring { result } | State::Leaving { result, .. }, _, Err(_)) => {
                self.finish(result);
            }
            (State::Idle, ..) => {}
            (_, _, Err(error)) => self.restore(Err(HomingError::Sdo { index, sub, error })),
            (State::Preparing { at }, Access::Write(_), Ok(_)) => {
                self.prepare(at + 1);
                if self.wanted.is_none() {
                    self.state = State::Entering { look: now, until: now + REACT_WITHIN };
                }
            }
            (State::Restoring { result }, Access::Write(_), Ok(_)) => {
                self.state = State::Leaving { result, look: now, until: now + REACT_WITHIN };
            }
            (State::Entering { until, .. }, Access::ReadMode, Ok(mode)) => {
                self.entered(now, &mode, until);
            }
            (State::Leaving { result, until, .. }, Access::ReadMode, Ok(mode)) => {
                if *mode == self.config.mode_after.to_le_bytes() {
                    self.finish(result);
                } else {
                    self.state = State::Leaving { result, look: now + LOOK_EVERY, until };
                }
            }
            _ => {}
        }
        self.handle_timeout(now);
    }

    fn entered(&mut self, now: Instant, mode: &[u8], until: Instant) {
        self.state = if *mode == HOMING_MODE.to_le_bytes() {
            let before = Progress::decode(self.statusword);
            State::Running { before, began: false, react: now + REACT_WITHIN, until: now + self.config.timeout }
        } else {
            State::Entering { look: now + LOOK_EVERY, until }
        };
    }

    /// A statusword of the drive.
    pub fn handle_statusword(&mut self, _now: Instant, statusword: u16) {
        self.statusword = statusword;
        let State::Running { before, began, react, until } = self.state else {
            return;
        };
        let progress = Progress::decode(statusword);
        let moves = matches!(progress, Progress::Running | Progress::AttainedMoving);
        let began = began || moves;
        // What the drive said before the start is old news until it says something else.
        let before = if progress == Progress::NotStarted { progress } else { before };
        self.state = State::Running { before, began, react, until };
        match progress {
            _ if moves || !began && progress == before => {}
            Progress::Done => self.restore(Ok(())),
            Progress::ErrorMoving | Progress::ErrorStopped => {
                self.restore(Err(HomingError::Refused));
            }
            Progress::NotStarted | Progress::Running | Progress::AttainedMoving => {
                self.restore(Err(HomingError::Interrupted));
            }
        }
    }

    /// The bits to add to the controlword of the enabled axis.
    #[must_use]
    pub fn controlword_bits(&self) -> u16 {
        if matches!(self.state, State::Running { .. }) { control::MODE_4 } else { 0 }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        match self.state {
            State::Entering { until, .. } if until <= now => self.restore(Err(HomingError::Mode)),
            State::Leaving { result, until, .. } if until <= now => {
                self.finish(result.and(Err(HomingError::Mode)));
            }
            State::Entering { look, .. } | State::Leaving { look, .. } if look <= now => {
                self.look();
            }
            State::Running { began: false, react, .. } if react <= now => {
                self.restore(Err(HomingError::NotStarted));
            }
            State::Running { until, .. } if until <= now => self.restore(Err(HomingError::Timeout)),
            _ => {}
        }
    }

    fn look(&mut self) {
        if self.pending.is_none() {
            self.wanted = Some(Access::ReadMode);
        }
    }

    /// How it ended, once.
    pub fn poll_finished(&mut self) -> Option<Result<(), HomingError>> {
        self.finished.take()
    }

    /// When to call [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let busy = self.pending.is_some() || self.wanted.is_some();
        match self.state {
            State::Idle | State::Preparing { .. } | State::Restoring { .. } => None,
            State::Entering { look, until } | State::Leaving { look, until, .. } => {
                Some(if busy { until } else { look.min(until) })
            }
            State::Running { began, react, until, .. } => Some(if began { until } else { react.min(until) }),
        }
    }
}
