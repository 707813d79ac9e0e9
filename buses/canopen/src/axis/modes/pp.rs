//! The set-point handshake of profile position (CiA 402-2, 10.2): a rising edge of controlword bit 4 for each new
//! target, acknowledged by statusword bit 12. A lost edge never moves an axis, so it is repeated with a fresh one; but
//! for a relative move, which must not be made twice.

use crate::axis::{control, status};
use base::{Duration, Instant, Queue};

/// Time that bit 4 stays low before an edge is repeated, so that the drive samples it.
const LOW_FOR: Duration = Duration::from_millis(20);

/// A set-point and how it is to be taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Move {
    /// Target or distance, in the drive's position unit.
    pub target: i32,
    /// `target` counts from the target before it.
    pub relative: bool,
    /// The one before is given up; else it is finished first.
    pub immediately: bool,
    /// After the one before, without a stop there (controlword bit 9; not every drive has it).
    pub blends: bool,
}

impl Move {
    /// To a position, at once.
    #[must_use]
    pub const fn to(target: i32) -> Self {
        Self { target, relative: false, immediately: true, blends: false }
    }

    /// By a distance, at once.
    #[must_use]
    pub const fn by(distance: i32) -> Self {
        Self { relative: true, ..Self::to(distance) }
    }

    /// Starts after the previous one has finished.
    #[must_use]
    pub const fn after(self) -> Self {
        Self { immediately: false, ..self }
    }

    /// Starts when the previous target is passed.
    #[must_use]
    pub const fn blending(self) -> Self {
        Self { immediately: false, blends: true, ..self }
    }

    fn bits(self) -> u16 {
        let bit = |on: bool, bit| if on { bit } else { 0 };
        bit(self.immediately, control::CHANGE_AT_ONCE)
            | bit(self.relative, control::RELATIVE)
            | bit(self.blends, control::CHANGE_ON_SETPOINT)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    /// Bit 4 is high; the acknowledge is awaited.
    Raised {
        until: Instant,
    },
    /// Acknowledged; bit 4 is low, the end of the acknowledge is awaited. `None`: the drive holds it while its buffer
    /// is full.
    Lowered {
        until: Option<Instant>,
    },
    /// The acknowledge did not come; bit 4 is low for a while.
    Resting {
        until: Instant,
    },
}

/// Result of a set-point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetpointEvent {
    /// The drive took the target and goes there.
    Accepted {
        /// Target.
        target: i32,
    },
    /// The drive did not acknowledge in time; another edge follows.
    Retried {
        /// Target.
        target: i32,
        /// Number of attempts in a row.
        tries: u32,
    },
    /// The drive did not acknowledge a relative move in time; whether it moves is not known, and it is not repeated.
    /// Moves that waited behind it are dropped.
    Lost {
        /// Distance.
        distance: i32,
    },
}

/// Targets of one axis. [`Self::set`]: the newest replaces a target that was not sent yet. [`Self::push`]: a set of
/// set-points, one after the other. Used while the axis is enabled in profile position mode, with [`Self::reset`]
/// otherwise.
pub struct Setpoint {
    timeout: Duration,
    state: State,
    /// On the wire.
    current: Move,
    /// The next one.
    pending: Option<Move>,
    waiting: Queue<Move, 8>,
    accepted: Option<i32>,
    /// A target was accepted.
    moved: bool,
    acknowledge: bool,
    tries: u32,
    events: Queue<SetpointEvent, 8>,
}

impl Setpoint {
    /// Without target; an acknowledge may take `timeout`.
    #[must_use]
    pub fn new(timeout: Duration) -> Self {
        Self {
            timeout,
            state: State::Idle,
            current: Move::to(0),
            pending: None,
            waiting: Queue::new(),
            accepted: None,
            moved: false,
            acknowledge: false,
            tries: 0,
            events: Queue::new(),
        }
    }

    /// Drops all targets: the axis is disabled, or in another mode. Sends `position` until the next target.
    pub fn reset(&mut self, position: i32) {
        *self = Self { current: Move::to(position), acknowledge: self.acknowledge, ..Self::new(self.timeout) };
    }

    /// A new target, at once. The one the drive goes to already is not sent again.
    pub fn set(&mut self, now: Instant, target: i32) {
        let heading = match self.state {
            State::Raised { .. } | State::Resting { .. } => (!self.current.relative).then_some(self.current.target),
            State::Idle | State::Lowered { .. } => self.accepted,
        };
        self.waiting.clear();
        self.pending = (heading != Some(target)).then_some(Move::to(target));
        self.next(now);
    }

    /// A move of a set; false: eight wait already.
    pub fn push(&mut self, now: Instant, next: Move) -> bool {
        let taken = self.waiting.push(next);
        self.next(now);
        taken
    }

    /// The target that the drive took last; `None` after a relative move.
    #[must_use]
    pub fn accepted(&self) -> Option<i32> {
        self.accepted
    }

    /// True if the drive has taken all targets and is within its window at the last (statusword bit 10, which during a
    /// halt only means standstill).
    #[must_use]
    pub fn is_reached(&self, statusword: u16) -> bool {
        let settled = self.state == State::Idle && self.pending.is_none() && self.waiting.is_empty();
        settled && self.moved && statusword & status::TARGET_REACHED != 0
    }

    /// Bits to add to the controlword, and the target to send with it.
    #[must_use]
    pub fn command(&self) -> (u16, i32) {
        let new = if matches!(self.state, State::Raised { .. }) { control::NEW_SETPOINT } else { 0 };
        (new | self.current.bits(), self.current.target)
    }

    /// A statusword of the drive.
    pub fn handle_statusword(&mut self, now: Instant, statusword: u16) {
        self.acknowledge = statusword & status::MODE_12 != 0;
        match (self.state, self.acknowledge) {
            (State::Raised { .. }, true) => {
                let Move { target, relative, immediately, .. } = self.current;
                self.accepted = (!relative).then_some(target);
                (self.moved, self.tries) = (true, 0);
                self.events.push(SetpointEvent::Accepted { target });
                self.state = State::Lowered { until: immediately.then(|| now + self.timeout) };
            }
            (State::Lowered { .. }, false) => self.state = State::Idle,
            _ => {}
        }
        self.next(now);
    }

    /// Sends what waits, when the drive can take it.
    fn next(&mut self, now: Instant) {
        if self.state != State::Idle || self.pending.is_none() && self.waiting.is_empty() {
            return;
        }
        if self.acknowledge {
            // Bit 12 is left over: wait until the drive can take a set-point.
            self.state = State::Lowered { until: Some(now + self.timeout) };
            return;
        }
        if let Some(next) = self.pending.take().or_else(|| self.waiting.pop()) {
            self.raise(now, next);
        }
    }

    fn raise(&mut self, now: Instant, next: Move) {
        self.current = next;
        self.state = State::Raised { until: now + self.timeout };
    }

    /// Repeats an edge that was not answered.
    pub fn handle_timeout(&mut self, now: Instant) {
        match self.state {
            State::Raised { until } if until <= now => {
                let Move { target, relative, .. } = self.current;
                self.events.push(if relative {
                    self.waiting.clear();
                    SetpointEvent::Lost { distance: target }
                } else {
                    self.tries = self.tries.saturating_add(1);
                    SetpointEvent::Retried { target, tries: self.tries }
                });
                self.state = State::Resting { until: now + LOW_FOR };
            }
            // The end of the acknowledge was lost, or never seen: an edge shows.
            State::Lowered { until: Some(until) } if until <= now => {
                self.acknowledge = false;
                self.state = State::Idle;
                self.next(now);
            }
            State::Resting { until } if until <= now => match self.pending.take() {
                Some(newer) => self.raise(now, newer),
                None if self.current.relative => {
                    self.accepted = None;
                    self.state = State::Idle;
                    self.next(now);
                }
                None => self.raise(now, self.current),
            },
            _ => {}
        }
    }

    /// Next event.
    pub fn poll_event(&mut self) -> Option<SetpointEvent> {
        self.events.pop()
    }

    /// Instant of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Idle => None,
            State::Lowered { until } => until,
            State::Raised { until } | State::Resting { until } => Some(until),
        }
    }
}
