//! State of a process: alive, hung, late.

use crate::host::News;
use base::{Duration, Instant};

/// A process.
#[derive(Debug, Default)]
pub(super) struct Life {
    pub pid: Option<u32>,
    pub started: Instant,
    /// True while it hangs.
    hung: bool,
    /// Time at which it last ceased to work.
    ceased: Instant,
    /// Latency.
    pub late: Duration,
    /// Time at which it was last dead, hung or late.
    ill: Instant,
    /// End of its last hang, or time by which it has worked off what waited at the end of a latency.
    resumed: Instant,
}

impl Life {
    pub fn is_well(&self) -> bool {
        self.pid.is_some() && !self.hung && self.late.is_zero()
    }

    /// True if it is served, late or not.
    pub fn works(&self) -> bool {
        self.pid.is_some() && !self.hung
    }

    /// Instant of its last activity; now, while it works.
    pub fn worked(&self, now: Instant) -> Instant {
        if self.works() { now } else { self.ceased }
    }

    /// Instant at which it was last dead, hung or late; now, while it is.
    pub fn ill(&self, now: Instant) -> Instant {
        if self.is_well() { self.ill } else { now }
    }

    /// True if it ended a hang or a latency less than `time` ago: all that waited for it is processed at once.
    pub fn has_resumed_within(&self, now: Instant, time: Duration) -> bool {
        self.resumed > Instant::ZERO && now.since(self.resumed) < time
    }

    pub fn observe(&mut self, now: Instant, news: &News<'_>) {
        match *news {
            News::Started { pid, .. } => {
                *self = Self { pid: Some(pid), started: now, ill: now, resumed: self.resumed, ..Self::default() };
            }
            News::Exited { pid, .. } if self.pid == Some(pid) => {
                // Frames that it has queued outlive it.
                *self = Self { ceased: self.worked(now), ill: now, resumed: self.resumed, ..Self::default() };
            }
            News::Hung { pid, .. } if self.pid == Some(pid) => (self.ceased, self.hung) = (self.worked(now), true),
            News::Resumed { pid, .. } if self.pid == Some(pid) => {
                (self.hung, self.ill, self.resumed) = (false, now, now);
            }
            News::Crawls { pid, late, .. } if self.pid == Some(pid) => {
                // Pending input is served with the old latency.
                self.ill = now + self.late;
                if late < self.late {
                    self.resumed = self.ill;
                }
                self.late = late;
            }
            _ => {}
        }
    }
}
