//! The master of one line: one request at a time, with its time limit and retries.
//!
//! ```text
//!            request             frame sent              answer
//!     Idle ----------> Queued ----------------> Awaiting ------> Idle, Event
//!                        ^                      |     | no answer can come of it
//!                        |     time limit       |     v
//!                        +--- (retries left) <--+--- Spoilt
//! ```
//!
//! An answer names no request: one that comes too late could be taken for the answer to the next request. So nothing is
//! sent before the line has been silent for [`Config::gap`], nor, after a time limit has passed, for one more, and what
//! was received before a request is discarded.

use crate::frame::{Expected, Verdict};
use crate::{Bytes, LEN_MAX};
use base::{Duration, Instant};
use core::fmt;

/// Silence before a request, usually.
pub const GAP: Duration = Duration::from_millis(5);
/// A line on which something is received all the time cannot be used; a request fails after this time.
const PATIENCE: Duration = Duration::from_secs(1);
/// Bytes before an answer that are taken as noise; more are no answer. An EIA-485 line that changes its direction may
/// make one.
const NOISE_MAX: usize = 8;
/// Bits of a character: start, eight of data, parity or a second stop bit, stop.
const BITS: u64 = 11;

/// Settings of a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Rate of the line; `None`: a connection.
    pub baud: Option<u32>,
    /// From the end of a request to the end of its answer, without the answer's time on the line. An answer without a
    /// known length must have begun by then.
    pub time_limit: Duration,
    /// Further attempts after one that failed.
    pub retries: u8,
    /// Silence of the line before each request.
    pub gap: Duration,
}

impl Config {
    /// Usual times for a line.
    #[must_use]
    pub const fn new(baud: Option<u32>) -> Self {
        Self { baud, time_limit: Duration::from_millis(100), retries: 2, gap: GAP }
    }

    /// Time of characters on the line.
    #[must_use]
    pub fn time_of(&self, characters: usize) -> Duration {
        let nanos = |baud: u32| (characters as u64 * BITS * 1_000_000_000).div_ceil(baud.max(1).into());
        Duration::from_nanos(self.baud.map_or(0, nanos))
    }
}

/// Why a request failed, after all attempts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// Nothing came within the time limit.
    Silent,
    /// What came within the time limit was no answer to the request.
    Damaged,
    /// The line was never silent, so nothing was sent.
    Babble,
    /// The line was reset.
    Reset,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Silent => "no answer",
            Self::Damaged => "what it answers is damaged, or not what the table expects",
            Self::Babble => "something sends on the line all the time",
            Self::Reset => "the line is down",
        })
    }
}

/// The end of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// When the request of the answer was sent: its values are not older. Of a failure, of the last attempt.
    pub sent: Instant,
    /// The data of the answer, or why there are none.
    pub result: Result<Bytes, Failure>,
}

/// What happened since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Requests sent, with retries.
    pub sent: u32,
    /// Answers taken.
    pub answers: u32,
    /// Attempts without any byte in time.
    pub silent: u32,
    /// Attempts of which the answer was damaged, incomplete or another one.
    pub damaged: u32,
    /// Answers with noise before them, which were taken.
    pub noisy: u32,
    /// Times that something came while nothing was expected: late answers.
    pub late: u32,
}

impl Counters {
    /// All that was received and is no answer.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.damaged.saturating_add(self.late)
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// It fails then.
    Queued {
        until: Instant,
    },
    /// If something has come by `until`, the rest may come by `last`.
    Awaiting {
        until: Instant,
        last: Instant,
    },
    Spoilt {
        until: Instant,
    },
}

#[derive(Debug)]
struct Current {
    frame: Bytes,
    expected: Expected,
    retries: u8,
    sent: Instant,
    phase: Phase,
    /// Noise in this attempt.
    noise: usize,
}

/// A master. Feed it bytes and time, and after any call drain [`Self::poll_tx`], then [`Self::poll_event`], then arm
/// one timer for [`Self::poll_timeout`].
#[derive(Debug)]
pub struct Master {
    config: Config,
    current: Option<Current>,
    event: Option<Event>,
    rx: Bytes,
    received: Instant,
    /// Nothing is sent before.
    free: Instant,
    counters: Counters,
}

impl Master {
    /// A master that is idle.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            config,
            current: None,
            event: None,
            rx: Bytes::new(),
            received: Instant::ZERO,
            free: Instant::ZERO,
            counters: Counters::default(),
        }
    }

    /// True if a request would be taken.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.current.is_none() && self.event.is_none()
    }

    /// Takes a request; it ends with an [`Event`]. False: another one is under way, or its event was not drained.
    #[must_use]
    pub fn request(&mut self, now: Instant, frame: Bytes, expected: Expected) -> bool {
        let is_idle = self.is_idle();
        if is_idle {
            let (retries, phase) = (self.config.retries, self.queued(now));
            self.current = Some(Current { frame, expected, retries, sent: now, phase, noise: 0 });
        }
        is_idle
    }

    fn queued(&self, now: Instant) -> Phase {
        Phase::Queued { until: self.free.max(now) + PATIENCE }
    }

    /// Forgets what was received; the request under way fails. For a line that is lost or new.
    pub fn reset(&mut self, now: Instant) {
        self.rx.clear();
        self.free = now;
        self.end(Err(Failure::Reset));
    }

    /// What happened since the start.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Takes bytes that arrived at `now`.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        self.handle_timeout(now);
        if bytes.is_empty() {
            return;
        }
        let gap = now.since(self.received);
        self.received = now;
        self.free = self.free.max(now + self.config.gap);
        match &self.current {
            Some(Current { phase: Phase::Awaiting { .. }, .. }) => self.receive(bytes),
            // The rest of a damaged answer was counted with it.
            Some(Current { phase: Phase::Spoilt { .. }, .. }) => {}
            _ if gap >= self.config.gap => count(&mut self.counters.late),
            _ => {}
        }
    }

    fn receive(&mut self, bytes: &[u8]) {
        let Some(current) = &mut self.current else { return };
        if self.rx.extend_from_slice(bytes).is_err() {
            return self.spoil();
        }
        let noise = current.expected.noise(&self.rx);
        current.noise += noise;
        if current.noise > NOISE_MAX {
            return self.spoil();
        }
        self.rx = self.rx.iter().skip(noise).copied().collect();
        match current.expected.judge(&self.rx) {
            Verdict::More => {}
            Verdict::Wrong => self.spoil(),
            Verdict::Answer(len) => {
                count(&mut self.counters.answers);
                if current.noise > 0 {
                    count(&mut self.counters.noisy);
                }
                let mut data = core::mem::take(&mut self.rx);
                data.truncate(len);
                self.end(Ok(data));
            }
        }
    }

    /// No answer can come of what was received: the rest is discarded until the time limit.
    fn spoil(&mut self) {
        self.rx.clear();
        if let Some(current) = &mut self.current
            && let Phase::Awaiting { last, .. } = current.phase
        {
            current.phase = Phase::Spoilt { until: last };
        }
    }

    fn end(&mut self, result: Result<Bytes, Failure>) {
        if let Some(Current { sent, .. }) = self.current.take() {
            self.event = Some(Event { sent, result });
        }
    }

    /// Serves deadlines; late and needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        let Some(current) = &mut self.current else { return };
        let has_begun = !self.rx.is_empty() || current.noise > 0;
        let failure = match &mut current.phase {
            Phase::Queued { until } if *until <= now && now < self.free => return self.end(Err(Failure::Babble)),
            Phase::Awaiting { until, last } if *until <= now => {
                if has_begun && now < *last {
                    *until = *last;
                    return;
                }
                if has_begun { Failure::Damaged } else { Failure::Silent }
            }
            Phase::Spoilt { until } if *until <= now => Failure::Damaged,
            _ => return,
        };
        self.rx.clear();
        let (counter, quarantine) = match failure {
            Failure::Silent => (&mut self.counters.silent, self.config.time_limit),
            _ => (&mut self.counters.damaged, Duration::ZERO),
        };
        count(counter);
        self.free = self.free.max(now + quarantine);
        let again = self.queued(now);
        match &mut self.current {
            Some(current) if current.retries > 0 => {
                (current.retries, current.noise, current.phase) = (current.retries - 1, 0, again);
            }
            _ => self.end(Err(failure)),
        }
    }

    /// The frame of a request whose time has come; it is sent without a gap.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        let config = self.config;
        let current = self.current.as_mut().filter(|current| matches!(current.phase, Phase::Queued { .. }))?;
        if now < self.free {
            return None;
        }
        let (sent, length) = (config.time_of(current.frame.len()), current.expected.length());
        let until = now + sent + config.time_of(length.unwrap_or_default()) + config.time_limit;
        let last = match length {
            Some(_) => until,
            None => until + config.time_of(LEN_MAX).max(config.time_limit),
        };
        (current.sent, current.noise, current.phase) = (now, 0, Phase::Awaiting { until, last });
        self.rx.clear();
        count(&mut self.counters.sent);
        Some(current.frame.clone())
    }

    /// The end of a request.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.event.take()
    }

    /// Instant of the next [`Self::handle_timeout`] and [`Self::poll_tx`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.current.as_ref().map(|current| match current.phase {
            Phase::Queued { until } => until.min(self.free),
            Phase::Awaiting { until, .. } | Phase::Spoilt { until } => until,
        })
    }
}
