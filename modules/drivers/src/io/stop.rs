//! Signals that stop the robot (`[stop]`): whether each is closed, on `LL_EVENT_STOP` in [`PERIOD`], and at once when
//! one opens. One that opened is reported as open for [`PERIOD`], so that a bouncing contact makes two messages in it.
//!
//! A signal is closed while its value is 1 and not older than [`AGE_MAX`]. Before its first value nothing is published:
//! silence stops the robot as well, and without that an operator would have to release PAUSE after each start.

use super::signal::{Signal, place};
use base::{Duration, Instant};
use messages::lowlevel::EventStop;
use module::Actions;

/// Longest period of `LL_EVENT_STOP`; `driver_canbus` stops the robot if it is missing for 500 ms.
const PERIOD: Duration = Duration::from_millis(100);
/// An older value counts as open.
const AGE_MAX: Duration = Duration::from_millis(500);

/// A signal that stops the robot.
#[derive(Debug)]
pub(super) struct Stop {
    signal: usize,
    /// As a source of PAUSE: `io.estop`.
    source: String,
    /// What was published last; `None`: nothing was known yet.
    engaged: Option<bool>,
    due: Instant,
}

impl Stop {
    /// `None`: there is no input of this name.
    pub(super) fn new(name: &str, signals: &[Signal]) -> Option<Self> {
        let signal = place(signals, name).filter(|place| signals[*place].output.is_none())?;
        Some(Self { signal, source: format!("io.{name}"), engaged: None, due: Instant::ZERO })
    }

    /// Publishes and notes its state.
    pub(super) fn serve(&mut self, now: Instant, signals: &[Signal], out: &mut Actions) {
        let recent = signals[self.signal].recent(now, AGE_MAX);
        if self.engaged.is_none() && recent.is_none() {
            return;
        }
        let engaged = recent != Some(1.0) || self.engaged == Some(true) && now < self.due;
        if self.engaged != Some(engaged) || self.due <= now {
            self.due = now + PERIOD;
            out.publish(EventStop { timestamp: out.timestamp(now), engaged, source: self.source.clone() });
        }
        if self.engaged.replace(engaged).is_some_and(|before| before != engaged) {
            let name = &signals[self.signal].name;
            out.note(match (engaged, recent) {
                (true, Some(_)) => format!("input {name} is open: PAUSE"),
                (true, None) => format!("input {name} is not known: PAUSE"),
                (false, _) => format!("input {name} is closed"),
            });
        }
    }

    /// When it is published, or becomes too old.
    pub(super) fn poll_timeout(&self, signals: &[Signal]) -> Option<Instant> {
        self.engaged?;
        let old = signals[self.signal].too_old(AGE_MAX).filter(|_| self.engaged == Some(false));
        base::earliest([Some(self.due), old])
    }
}
