//! The master of one line: one request at a time, with its time limit and retries.
//!
//! ```text
//!            request             frame sent              answer
//!     Idle ----------> Queued ----------------> Awaiting ------> Idle, Event
//!                        ^                      |     | damaged
//!                        |     time limit       |     v
//!                        +--- (retries left) <--+--- Spoilt
//! ```
//!
//! An RTU answer names no request: one that comes too late could be taken for the answer to the next request of the
//! same unit, function and length. After a time limit has passed, nothing is sent for [`Config::quarantine`].

use crate::frame::{Bytes, HEADER, Header, LATENCY, LEN_MAX, Line, rtu};
use crate::pdu::{Data, Exception, Rejection, Request};
use base::{Duration, Instant};
use core::fmt;

/// Greatest time limit of an answer.
pub const TIME_LIMIT_MAX: Duration = Duration::from_secs(10);
/// A device that is busy is asked again after this time.
const BUSY_PAUSE: Duration = Duration::from_millis(100);
/// Greatest unit of a serial line (Modbus over Serial Line V1.02, 2.2).
const RTU_UNIT_MAX: u8 = 247;
/// Greatest number of retries.
const RETRIES_MAX: u8 = 10;

/// Settings of a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// The line.
    pub line: Line,
    /// From the end of a request on the line to the end of its answer, without the answer's time on the line.
    pub time_limit: Duration,
    /// Further attempts after one that failed.
    pub retries: u8,
    /// Silence after a request on a serial line that was not answered in time.
    pub quarantine: Duration,
    /// Pause that the computer may make of characters without a pause.
    pub latency: Duration,
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// The rate is not within 1200..=4 000 000 Bd.
    Baud,
    /// A time is zero, or above [`TIME_LIMIT_MAX`].
    Time,
    /// More than ten.
    Retries,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Baud => "the rate must be from 1200 to 4000000 Bd",
            Self::Time => "time limits must be above 0 and at most 10 s",
            Self::Retries => "at most 10 retries",
        })
    }
}

impl core::error::Error for ConfigError {}

impl Config {
    /// Usual times for a line.
    #[must_use]
    pub const fn new(line: Line) -> Self {
        let time_limit = Duration::from_millis(100);
        Self { line, time_limit, retries: 2, quarantine: time_limit, latency: LATENCY }
    }

    fn check(&self) -> Result<(), ConfigError> {
        if let Line::Rtu { baud } = self.line
            && !(1200..=4_000_000).contains(&baud)
        {
            return Err(ConfigError::Baud);
        }
        let is_time = |time: Duration| time <= TIME_LIMIT_MAX;
        if self.time_limit.is_zero() || ![self.time_limit, self.quarantine, self.latency].into_iter().all(is_time) {
            return Err(ConfigError::Time);
        }
        if self.retries > RETRIES_MAX { Err(ConfigError::Retries) } else { Ok(()) }
    }
}

/// Why a request was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Another one is under way, or its event was not drained.
    Busy,
    /// It has no values, too many, or addresses beyond the last.
    Invalid,
    /// A serial line has units 1 to 247; 0, all units, has no answer and is not supported.
    Unit,
}

/// Why a request failed, after all attempts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// No answer within the time limit.
    Silent,
    /// What came within the time limit was no answer to the request.
    Damaged,
    /// The device refuses.
    Exception(Exception),
    /// The line was reset.
    Reset,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("no answer"),
            Self::Damaged => f.write_str("a damaged answer"),
            Self::Exception(exception) => write!(f, "exception {}, {}", exception.0, exception.means()),
            Self::Reset => f.write_str("the line is down"),
        }
    }
}

/// The end of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// The unit that was asked.
    pub unit: u8,
    /// What it was asked.
    pub request: Request,
    /// When the request of the answer was sent: its values are not older. Of a failure, of the last attempt.
    pub sent: Instant,
    /// The values, or why there are none.
    pub result: Result<Data, Failure>,
}

/// What happened since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Requests sent, with retries.
    pub sent: u32,
    /// Answers taken.
    pub answers: u32,
    /// Exceptions.
    pub exceptions: u32,
    /// Attempts without an answer in time.
    pub silent: u32,
    /// Wrong checksum, length, function, echo or header; incomplete frames.
    pub damaged: u32,
    /// Frames of another unit than the one that was asked.
    pub strangers: u32,
    /// Frames that nobody waits for, or of another transaction: late answers.
    pub late: u32,
}

impl Counters {
    /// All that was received and is no answer.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.damaged.saturating_add(self.strangers).saturating_add(self.late)
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Queued,
    Awaiting {
        until: Instant,
    },
    /// The answer is damaged: the rest is discarded.
    Spoilt {
        until: Instant,
    },
}

#[derive(Debug)]
struct Current {
    unit: u8,
    request: Request,
    transaction: u16,
    retries: u8,
    sent: Instant,
    phase: Phase,
}

/// A master. Feed it bytes and time, and after any call drain [`Self::poll_tx`], then [`Self::poll_event`], then arm
/// one timer for [`Self::poll_timeout`].
#[derive(Debug)]
pub struct Master {
    config: Config,
    current: Option<Current>,
    event: Option<Event>,
    transaction: u16,
    rx: Bytes,
    received: Instant,
    /// Nothing is sent before.
    free: Instant,
    counters: Counters,
}

impl Master {
    /// Creates a master that is idle.
    ///
    /// # Errors
    /// The configuration is invalid.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            config,
            current: None,
            event: None,
            transaction: 0,
            rx: Bytes::new(),
            received: Instant::ZERO,
            free: Instant::ZERO,
            counters: Counters::default(),
        })
    }

    /// True if a request would be taken.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.current.is_none() && self.event.is_none()
    }

    /// Takes a request; it ends with an [`Event`].
    ///
    /// # Errors
    /// It was not taken.
    pub fn request(&mut self, unit: u8, request: Request) -> Result<(), Refused> {
        if !self.is_idle() {
            return Err(Refused::Busy);
        }
        if !request.is_valid() {
            return Err(Refused::Invalid);
        }
        if self.config.line != Line::Tcp && !(1..=RTU_UNIT_MAX).contains(&unit) {
            return Err(Refused::Unit);
        }
        let retries = self.config.retries;
        let (sent, phase) = (Instant::ZERO, Phase::Queued);
        self.current = Some(Current { unit, request, transaction: 0, retries, sent, phase });
        Ok(())
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
        let gap = now.since(self.received);
        self.received = now;
        match self.config.line {
            Line::Rtu { .. } => self.receive_rtu(now, gap, bytes),
            Line::Tcp => bytes.iter().for_each(|byte| self.receive_tcp(now, *byte)),
        }
    }

    fn receive_rtu(&mut self, now: Instant, gap: Duration, bytes: &[u8]) {
        let line = self.config.line;
        self.free = self.free.max(now + line.t3_5());
        let Some(Current { unit, request, phase: Phase::Awaiting { .. }, .. }) = &self.current else {
            // The rest of a damaged answer was counted with it.
            let spoilt = matches!(self.current, Some(Current { phase: Phase::Spoilt { .. }, .. }));
            if !spoilt && (gap > line.t1_5() + self.config.latency || self.rx.is_empty()) {
                count(&mut self.counters.late);
            }
            self.rx.clear();
            // Marks that a late answer is arriving.
            let _ = self.rx.extend_from_slice(&bytes[..bytes.len().min(1)]);
            return;
        };
        if !self.rx.is_empty() && gap > line.t1_5() + self.config.latency {
            self.rx.clear();
            count(&mut self.counters.damaged);
        }
        if self.rx.extend_from_slice(bytes).is_err() {
            return self.spoil(|counters| &mut counters.damaged);
        }
        let [from, rest @ ..] = &self.rx[..] else { return };
        if from != unit {
            return self.spoil(|counters| &mut counters.strangers);
        }
        let Some(code) = rest.first() else { return };
        let Some(len) = request.answer_len_of(*code).map(|len| line.frame_len(len)) else {
            return self.spoil(|counters| &mut counters.damaged);
        };
        if self.rx.len() < len {
            return;
        }
        let answer = match rtu(&self.rx).filter(|_| self.rx.len() == len) {
            Some((_, pdu)) => request.accept(pdu),
            None => Err(Rejection::Malformed),
        };
        self.take(now, answer);
    }

    fn receive_tcp(&mut self, now: Instant, byte: u8) {
        if matches!(self.current, Some(Current { phase: Phase::Spoilt { .. }, .. })) {
            return;
        }
        // A frame is complete before the buffer is full: the header limits its length.
        let _ = self.rx.push(byte);
        let header = match Header::read(&self.rx) {
            Ok(Some(header)) if self.rx.len() >= header.len => header,
            Ok(_) => return,
            Err(()) => return self.spoil(|counters| &mut counters.damaged),
        };
        let frame = core::mem::take(&mut self.rx);
        match &self.current {
            Some(Current { unit, request, transaction, phase: Phase::Awaiting { .. }, .. })
                if *transaction == header.transaction =>
            {
                if *unit != header.unit {
                    return count(&mut self.counters.strangers);
                }
                let answer = request.accept(&frame[HEADER..]);
                self.take(now, answer);
            }
            _ => count(&mut self.counters.late),
        }
    }

    /// Takes a frame from the device that was asked.
    fn take(&mut self, now: Instant, answer: Result<Data, Rejection>) {
        self.rx.clear();
        match answer {
            Ok(data) => {
                count(&mut self.counters.answers);
                self.end(Ok(data));
            }
            Err(Rejection::Exception(exception)) => {
                count(&mut self.counters.exceptions);
                if exception.is_passing() {
                    self.fail(now + BUSY_PAUSE, Failure::Exception(exception));
                } else {
                    self.end(Err(Failure::Exception(exception)));
                }
            }
            Err(Rejection::Malformed) => self.spoil(|counters| &mut counters.damaged),
        }
    }

    /// Counts what is no answer, and discards what follows it until the time limit.
    fn spoil(&mut self, counter: impl FnOnce(&mut Counters) -> &mut u32) {
        count(counter(&mut self.counters));
        self.rx.clear();
        if let Some(current) = &mut self.current
            && let Phase::Awaiting { until } = current.phase
        {
            current.phase = Phase::Spoilt { until };
        }
    }

    /// An attempt failed: the next one is not before `free`.
    fn fail(&mut self, free: Instant, failure: Failure) {
        self.free = self.free.max(free);
        match &mut self.current {
            Some(current) if current.retries > 0 => {
                current.retries -= 1;
                current.phase = Phase::Queued;
            }
            _ => self.end(Err(failure)),
        }
    }

    fn end(&mut self, result: Result<Data, Failure>) {
        if let Some(Current { unit, request, sent, .. }) = self.current.take() {
            self.event = Some(Event { unit, request, sent, result });
        }
    }

    /// Serves deadlines; late and needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        let (until, failure) = match &self.current {
            Some(Current { phase: Phase::Awaiting { until }, .. }) => (*until, Failure::Silent),
            Some(Current { phase: Phase::Spoilt { until }, .. }) => (*until, Failure::Damaged),
            _ => return,
        };
        if now < until {
            return;
        }
        let mut free = now;
        if failure == Failure::Silent {
            count(&mut self.counters.silent);
            if self.config.line != Line::Tcp {
                free += self.config.quarantine;
            }
        }
        if !self.rx.is_empty() {
            count(&mut self.counters.damaged);
            self.rx.clear();
        }
        self.fail(free, failure);
    }

    /// The frame of a request whose time has come; it is sent without a gap.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        let Config { line, time_limit, .. } = self.config;
        let current = self.current.as_mut().filter(|current| current.phase == Phase::Queued && self.free <= now)?;
        self.transaction = self.transaction.wrapping_add(1);
        let pdu = current.request.encode();
        let frame = line.frame(self.transaction, current.unit, &pdu);
        let on_line = line.time_of(frame.len() + line.frame_len(current.request.answer_len()));
        let until = now + on_line + time_limit + line.t3_5();
        (current.transaction, current.sent, current.phase) = (self.transaction, now, Phase::Awaiting { until });
        if line != Line::Tcp {
            self.rx.clear();
        }
        count(&mut self.counters.sent);
        Some(frame)
    }

    /// The end of a request.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.event.take()
    }

    /// Instant of the next [`Self::handle_timeout`] and [`Self::poll_tx`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.current.as_ref().map(|current| match current.phase {
            Phase::Queued => self.free,
            Phase::Awaiting { until } | Phase::Spoilt { until } => until,
        })
    }
}

const _: () = assert!(LEN_MAX == HEADER + crate::pdu::LEN_MAX);
