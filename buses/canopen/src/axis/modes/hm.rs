//! Homing (CiA 402-2, 11): set the method by SDO, switch the mode, start by controlword bit 4, decode the result,
//! switch the mode back.
//! It requests SDO transfers one at a time ([`Homing::poll_sdo`]) and takes their results; the caller adds
//! [`Homing::controlword_bits`] to the controlword of an enabled axis and passes every statusword.

use super::Mode;
use super::switch::{Access, Switch, SwitchError};
use crate::axis::{control, status};
use crate::{Payload, sdo};
use base::{Duration, Instant};
use core::fmt;

/// Time limit for a drive to show that homing has started.
const REACT_WITHIN: Duration = Duration::from_millis(500);
/// Time limit for the new mode to be displayed, with repeated transfers.
const SWITCH_WITHIN: Duration = Duration::from_secs(2);

/// Parameters of homing.
#[derive(Clone, Copy, Debug)]
pub struct HomingConfig {
    /// 0x6098: a number of [`Method`](super::method::Method), or a manufacturer's negative one.
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
    /// Time limit of the motion.
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
    /// Interrupted, by the drive's statusword.
    Interrupted,
    /// Failed, by the drive's statusword (bit 13).
    Refused,
    /// Time limit exceeded.
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

/// Progress of homing in the statusword: bits 13, 12 and 10.
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

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    /// Write number `at` of the preparation.
    Preparing {
        at: usize,
    },
    /// The mode is being switched to homing.
    Entering,
    /// Bit 4 is high. `before`: progress in the statusword before the start; `began`: motion was seen.
    Running {
        before: Progress,
        began: bool,
        react: Instant,
        until: Instant,
    },
    /// The old mode is being switched to.
    Leaving {
        result: Result<(), HomingError>,
    },
}

/// Homing of one axis.
pub struct Homing {
    config: HomingConfig,
    state: State,
    switch: Switch,
    /// A transfer of the preparation to be made, and whether one is under way.
    wanted: Option<Access>,
    pending: Option<Access>,
    statusword: u16,
    finished: Option<Result<(), HomingError>>,
}

impl Homing {
    /// Makes a homing that has not begun.
    #[must_use]
    pub fn new(config: HomingConfig) -> Self {
        let switch = Switch::new(SWITCH_WITHIN);
        Self { config, state: State::Idle, switch, wanted: None, pending: None, statusword: 0, finished: None }
    }

    /// Begins; the axis must be enabled. While it runs nothing happens.
    pub fn start(&mut self) {
        if self.state == State::Idle {
            self.finished = None;
            self.prepare(0);
        }
    }

    /// True if it runs.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.state != State::Idle
    }

    /// The mode in which the drive must be; `None` while it is switched.
    #[must_use]
    pub fn mode(&self) -> Option<i8> {
        match self.state {
            State::Idle | State::Preparing { .. } => Some(self.config.mode_after),
            State::Running { .. } => Some(Mode::Homing.code()),
            State::Entering | State::Leaving { .. } => None,
        }
    }

    /// Cancels: bit 4 falls, the old mode is restored, then the end is reported.
    pub fn cancel(&mut self) {
        match self.state {
            State::Idle | State::Leaving { .. } => {}
            _ => self.restore(Err(HomingError::Cancelled)),
        }
    }

    /// Ends at once because the node is lost, and reports it.
    pub fn lost(&mut self) {
        self.switch.lost();
        self.pending = None;
        if self.is_running() {
            self.finish(Err(HomingError::Cancelled));
        }
    }

    fn preparation(&self, at: usize) -> Option<Access> {
        let config = &self.config;
        [
            Some(Access::write(0x6098, 0, config.method)),
            Some(Access::write(0x6099, 1, config.switch_speed)),
            Some(Access::write(0x6099, 2, config.zero_speed)),
            config.acceleration.map(|value| Access::write(0x609A, 0, value)),
            config.offset.map(|value| Access::write(0x607C, 0, value)),
        ]
        .into_iter()
        .flatten()
        .nth(at)
    }

    fn prepare(&mut self, at: usize) {
        self.state = State::Preparing { at };
        self.wanted = self.preparation(at);
        if self.wanted.is_none() {
            self.state = State::Entering;
            self.switch.start(Mode::Homing);
        }
    }

    fn restore(&mut self, result: Result<(), HomingError>) {
        self.state = State::Leaving { result };
        self.wanted = None;
        self.switch.start_code(self.config.mode_after);
    }

    fn finish(&mut self, result: Result<(), HomingError>) {
        self.state = State::Idle;
        self.wanted = None;
        self.finished = Some(result);
    }

    /// Next SDO transfer; its result goes to [`Self::handle_sdo`].
    pub fn poll_sdo(&mut self) -> Option<Access> {
        if self.pending.is_some() || self.switch.is_busy() {
            return None;
        }
        self.pending = self.wanted.take();
        self.pending.clone().or_else(|| self.switch.poll_sdo())
    }

    /// The transfer that [`Self::poll_sdo`] gave has ended: what was read, nothing for a write.
    pub fn handle_sdo(&mut self, now: Instant, result: Result<Payload, sdo::Error>) {
        match (self.pending.take(), self.state, result) {
            (Some(_), State::Preparing { at }, Ok(_)) => self.prepare(at + 1),
            (Some(access), State::Preparing { .. }, Err(error)) => {
                let (index, sub) = access.object();
                self.restore(Err(HomingError::Sdo { index, sub, error }));
            }
            // Result of a transfer that the state no longer needs.
            (Some(_), ..) => {}
            (None, _, result) => self.switch.handle_sdo(now, result),
        }
        self.handle_timeout(now);
    }

    /// The mode is another one, or will not be.
    fn switched(&mut self, now: Instant) {
        let Some(switched) = self.switch.poll_finished() else {
            return;
        };
        let switched = switched.map_err(|error| match error {
            SwitchError::Sdo { index, error } => HomingError::Sdo { index, sub: 0, error },
            SwitchError::NotShown { .. } => HomingError::Mode,
        });
        match (self.state, switched) {
            (State::Entering, Ok(())) => {
                let before = Progress::decode(self.statusword);
                let (react, until) = (now + REACT_WITHIN, now + self.config.timeout);
                self.state = State::Running { before, began: false, react, until };
            }
            (State::Entering, Err(error)) => self.restore(Err(error)),
            (State::Leaving { result }, switched) => self.finish(result.and(switched)),
            (State::Idle | State::Preparing { .. } | State::Running { .. }, _) => {}
        }
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
        // Progress shown before the start counts only after it has changed.
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
        if matches!(self.state, State::Running { .. }) { control::START_HOMING } else { 0 }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.switch.handle_timeout(now);
        self.switched(now);
        match self.state {
            State::Running { began: false, react, .. } if react <= now => {
                self.restore(Err(HomingError::NotStarted));
            }
            State::Running { until, .. } if until <= now => self.restore(Err(HomingError::Timeout)),
            _ => {}
        }
    }

    /// Result, returned once.
    pub fn poll_finished(&mut self) -> Option<Result<(), HomingError>> {
        self.finished.take()
    }

    /// Instant of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Idle | State::Preparing { .. } => None,
            State::Entering | State::Leaving { .. } => self.switch.poll_timeout(),
            State::Running { began, react, until, .. } => Some(if began { until } else { react.min(until) }),
        }
    }
}
