//! The set-point handshake of profile position (CiA 402-2, 10.2): a rising edge of controlword bit 4 for each new
//! target, acknowledged by statusword bit 12. A lost edge never moves an axis, so it is repeated with a fresh one.

use crate::axis::{control, status};
use base::{Duration, Instant, Queue};

/// How long bit 4 is low before an edge is repeated: the drive must have seen it.
const LOW_FOR: Duration = Duration::from_millis(20);

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    /// Bit 4 is high; the acknowledge is awaited.
    Raised {
        until: Instant,
    },
    /// Acknowledged; bit 4 is low, the end of the acknowledge is awaited.
    Lowered {
        until: Instant,
    },
    /// The acknowledge did not come; bit 4 is low for a while.
    Resting {
        until: Instant,
    },
}

/// What became of a set-point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetpointEvent {
    /// The drive took the target and goes there.
    Accepted {
        /// Where to.
        target: i32,
    },
    /// The drive did not acknowledge in time; another edge follows.
    Retried {
        /// Where to.
        target: i32,
        /// How often in a row.
        tries: u32,
    },
}

/// One axis's targets, the newest first: a target that was not sent yet is replaced by a newer one. Use it while the
/// axis is enabled in profile position mode, [`Self::reset`] it otherwise.
pub struct Setpoint {
    timeout: Duration,
    state: State,
    /// On the wire.
    target: i32,
    /// The next one.
    pending: Option<i32>,
    accepted: Option<i32>,
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
            target: 0,
            pending: None,
            accepted: None,
            acknowledge: false,
            tries: 0,
            events: Queue::new(),
        }
    }

    /// Forgets all targets: the axis is not enabled, or its mode is another. `position` stands on the wire until
    /// the next target.
    pub fn reset(&mut self, position: i32) {
        *self = Self { target: position, acknowledge: self.acknowledge, ..Self::new(self.timeout) };
    }

    /// A new target. The one the drive goes to already is not sent again.
    pub fn set(&mut self, now: Instant, target: i32) {
        let heading = match self.state {
            State::Raised { .. } | State::Resting { .. } => Some(self.target),
            State::Idle | State::Lowered { .. } => self.accepted,
        };
        self.pending = (heading != Some(target)).then_some(target);
        self.next(now);
    }

    /// The target that the drive took last.
    #[must_use]
    pub fn accepted(&self) -> Option<i32> {
        self.accepted
    }

    /// Whether the drive took the newest target and stands in its window there (statusword bit 10).
    #[must_use]
    pub fn is_reached(&self, statusword: u16) -> bool {
        let settled = self.state == State::Idle && self.pending.is_none() && self.accepted.is_some();
        settled && statusword & status::TARGET_REACHED != 0
    }

    /// Bits to add to the controlword, and the target to send with it.
    #[must_use]
    pub fn command(&self) -> (u16, i32) {
        let new = if matches!(self.state, State::Raised { .. }) { control::MODE_4 } else { 0 };
        (new | control::CHANGE_AT_ONCE, self.target)
    }

    /// A statusword of the drive.
    pub fn handle_statusword(&mut self, now: Instant, statusword: u16) {
        self.acknowledge = statusword & status::MODE_12 != 0;
        match (self.state, self.acknowledge) {
            (State::Raised { .. }, true) => {
                self.accepted = Some(self.target);
                self.tries = 0;
                self.events.push(SetpointEvent::Accepted { target: self.target });
                self.state = State::Lowered { until: now + self.timeout };
            }
            (State::Lowered { .. }, false) => self.state = State::Idle,
            _ => {}
        }
        self.next(now);
    }

    /// Sends what waits, when the drive can take it.
    fn next(&mut self, now: Instant) {
        if self.state != State::Idle {
            return;
        }
        let Some(target) = self.pending else { return };
        if self.acknowledge {
            // Left over from before: wait until the drive can take a set-point.
            self.state = State::Lowered { until: now + self.timeout };
            return;
        }
        self.pending = None;
        self.raise(now, target);
    }

    fn raise(&mut self, now: Instant, target: i32) {
        self.target = target;
        self.state = State::Raised { until: now + self.timeout };
    }

    /// Repeats an edge that was not answered.
    pub fn handle_timeout(&mut self, now: Instant) {
        match self.state {
            State::Raised { until } if until <= now => {
                self.tries = self.tries.saturating_add(1);
                self.events.push(SetpointEvent::Retried { target: self.target, tries: self.tries });
                self.state = State::Resting { until: now + LOW_FOR };
            }
            // The end of the acknowledge was lost, or never seen: an edge shows.
            State::Lowered { until } if until <= now => {
                self.acknowledge = false;
                self.state = State::Idle;
                self.next(now);
            }
            State::Resting { until } if until <= now => {
                let target = self.pending.take().unwrap_or(self.target);
                self.raise(now, target);
            }
            _ => {}
        }
    }

    /// What happened.
    pub fn poll_event(&mut self) -> Option<SetpointEvent> {
        self.events.pop()
    }

    /// When to call [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Idle => None,
            State::Raised { until } | State::Lowered { until } | State::Resting { until } => Some(until),
        }
    }
}
