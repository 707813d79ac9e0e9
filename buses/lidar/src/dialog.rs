//! The start-up that RPLIDARs and YDLIDARs have in common: a stop, requests with one answer each, and data for ever.

mod receiver;

use crate::engine::{Bytes, Progress, Shared};
use crate::event::LostReason;
use crate::rplidar::wire::Descriptor;
use base::{Duration, Instant};
use heapless::Vec;
use receiver::{ANSWER_MAX, Receiver};

/// Time after a stop in which what was under way arrives.
const STOPPING: Duration = Duration::from_millis(30);
/// Time limit of an answer.
const ANSWER_WITHIN: Duration = Duration::from_millis(120);
/// Attempts of a request.
const TRIES: u8 = 3;

#[derive(Clone, Copy, Debug)]
enum Phase {
    Off,
    /// What arrives belongs to the scan before.
    Stopping {
        until: Instant,
    },
    Asking {
        tries: u8,
        until: Instant,
    },
    /// The first data are due by `until`; later ones by the rules of the engine.
    Scanning {
        until: Option<Instant>,
    },
}

/// What a byte is.
#[derive(Debug)]
pub(crate) enum Received<A> {
    /// Part of an answer, or of what is not awaited.
    Nothing,
    /// With this byte the answer to a question is complete.
    Answer { ask: A, descriptor: Descriptor, bytes: Vec<u8, ANSWER_MAX> },
    /// Part of the data.
    Data,
}

/// One question at a time; `A` is what a protocol asks.
#[derive(Debug)]
pub(crate) struct Dialog<A> {
    phase: Phase,
    ask: A,
    request: Bytes,
    receiver: Receiver,
}

impl<A: Copy> Dialog<A> {
    /// A dialog that has not begun; `first` is its first question.
    pub fn new(first: A) -> Self {
        Self { phase: Phase::Off, ask: first, request: Bytes::new(), receiver: Receiver::default() }
    }

    /// Begins anew: stops the scan, and asks the first question when the line is quiet.
    pub fn start(&mut self, now: Instant, stop: &[u8], first: A, request: Bytes, shared: &mut Shared) {
        (self.ask, self.request) = (first, request);
        self.receiver.clear();
        shared.send(stop);
        self.phase = Phase::Stopping { until: now + STOPPING };
    }

    /// Asks a question.
    pub fn ask(&mut self, now: Instant, ask: A, request: Bytes, shared: &mut Shared) -> Progress {
        (self.ask, self.request) = (ask, request);
        self.send(now, TRIES, shared)
    }

    fn send(&mut self, now: Instant, tries: u8, shared: &mut Shared) -> Progress {
        self.receiver.clear();
        shared.send(&self.request);
        self.phase = Phase::Asking { tries, until: now + ANSWER_WITHIN };
        Progress::Pending
    }

    /// Data follow, the first of them by `until`.
    pub fn scan(&mut self, until: Instant) -> Progress {
        self.phase = Phase::Scanning { until: Some(until) };
        Progress::Pending
    }

    /// Takes note of the first data.
    pub fn scanned(&mut self) {
        self.phase = Phase::Scanning { until: None };
    }

    /// Takes a byte.
    pub fn receive(&mut self, byte: u8, shared: &mut Shared) -> Received<A> {
        match self.phase {
            Phase::Off | Phase::Stopping { .. } => Received::Nothing,
            Phase::Scanning { .. } => Received::Data,
            Phase::Asking { .. } => match self.receiver.receive(byte, shared) {
                Some(descriptor) => Received::Answer { ask: self.ask, descriptor, bytes: self.receiver.take() },
                None => Received::Nothing,
            },
        }
    }

    /// Serves deadlines: a question without an answer is repeated.
    pub fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) -> Progress {
        match self.phase {
            Phase::Stopping { until } if until <= now => self.send(now, TRIES, shared),
            Phase::Asking { tries: 1, until } | Phase::Scanning { until: Some(until) } if until <= now => {
                self.phase = Phase::Off;
                Progress::Lost(LostReason::Silent)
            }
            Phase::Asking { tries, until } if until <= now => self.send(now, tries - 1, shared),
            _ => Progress::Pending,
        }
    }

    /// Next deadline.
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.phase {
            Phase::Off => None,
            Phase::Stopping { until } | Phase::Asking { until, .. } => Some(until),
            Phase::Scanning { until } => until,
        }
    }
}
