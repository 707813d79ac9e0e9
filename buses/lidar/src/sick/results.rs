//! What a SICK lidar said last of its fields and outputs, and what it is asked for again and again while it scans.
//!
//! It reports a result by itself only when it changes, so silence would prove nothing: the results are read ten times a
//! second. A result is as old as the request that it answers; one that is too old is unknown, and so is all before the
//! first answer.

use crate::engine::Shared;
use crate::event::{FieldResult, Zone};
use base::{Duration, Instant, earliest, listed};

/// Time limit of an answer while the device scans: no other request is sent before. One lost answer lets no result
/// become too old.
const ANSWER_WITHIN: Duration = Duration::from_millis(150);
/// Age of a result, since the request that it answers, from which on it is unknown.
const AGE_MAX: Duration = Duration::from_millis(400);

listed! {
    /// What is read while the device scans.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(super) enum Read {
        /// Results of the field evaluation.
        Fields => "sRN LFErec",
        /// States of the outputs.
        Outputs => "sRN LIDoutputstate",
        /// Contamination of the optics.
        Contamination => "sRN LCMstate",
    }
}

impl Read {
    /// Interval in which it is read.
    fn every(self) -> Duration {
        match self {
            Self::Fields | Self::Outputs => Duration::from_millis(100),
            Self::Contamination => Duration::from_secs(1),
        }
    }
}

/// The requests: one at a time, since a refusal does not say of what.
#[derive(Debug, Default)]
pub(super) struct Reads {
    /// When each [`Read`] is due; `None`: it is not read.
    due: [Option<Instant>; Read::ALL.len()],
    /// The request under way, and when it was sent.
    asked: Option<(Read, Instant)>,
}

impl Reads {
    /// Reads this from `at` on.
    pub fn begin(&mut self, read: Read, at: Instant) {
        self.due[read as usize] = Some(at);
    }

    /// Reads this no more.
    pub fn end(&mut self, read: Read) {
        self.due[read as usize] = None;
    }

    /// True if this is read.
    pub fn has(&self, read: Read) -> bool {
        self.due[read as usize].is_some()
    }

    /// The next request to be sent at `now`.
    pub fn next(&mut self, now: Instant) -> Option<Read> {
        self.asked.take_if(|(_, at)| *at + ANSWER_WITHIN <= now);
        if self.asked.is_some() {
            return None;
        }
        let due = |read: &Read| self.due[*read as usize].filter(|at| *at <= now).map(|at| (at, *read));
        let (_, read) = Read::ALL.iter().filter_map(due).min_by_key(|(at, _)| *at)?;
        self.due[read as usize] = Some(now + read.every());
        self.asked = Some((read, now));
        Some(read)
    }

    /// Takes note of an answer: when its request was sent; `None` if it was not the one under way.
    pub fn answered(&mut self, read: Read) -> Option<Instant> {
        self.asked.take_if(|(asked, _)| *asked == read).map(|(_, at)| at)
    }

    /// The request under way was refused.
    pub fn refused(&mut self) -> Option<Read> {
        self.asked.take().map(|(read, _)| read)
    }

    /// Next deadline.
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.asked {
            Some((_, at)) => Some(at + ANSWER_WITHIN),
            None => earliest(self.due),
        }
    }
}

/// Results of the fields, or states of the outputs, by number.
#[derive(Debug)]
pub(super) struct Results<const N: usize> {
    zone: fn(u8) -> Zone,
    known: [FieldResult; N],
    /// When the request was sent that was answered last; `None`: nothing is known.
    asked: Option<Instant>,
}

impl<const N: usize> Results<N> {
    /// Nothing is known.
    pub const fn new(zone: fn(u8) -> Zone) -> Self {
        Self { zone, known: [FieldResult::Unknown; N], asked: None }
    }

    /// The result of one of them.
    pub fn get(&self, number: u8) -> FieldResult {
        let known = usize::from(number).checked_sub(1).and_then(|place| self.known.get(place));
        known.copied().unwrap_or(FieldResult::Unknown)
    }

    /// Takes the answer to the request that was sent at `asked`: what it does not list is unknown. `None`: a report of
    /// a change, or a late answer, which proves nothing of the device's present state.
    pub fn take(&mut self, listed: &[(u8, FieldResult)], asked: Option<Instant>, shared: &mut Shared) {
        if asked.is_some() {
            self.asked = asked;
            let absent = |number: &u8| !listed.iter().any(|(other, _)| other == number);
            (1..=N as u8).filter(absent).for_each(|number| self.set(number, FieldResult::Unknown, shared));
        }
        if self.asked.is_some() {
            listed.iter().for_each(|(number, result)| self.set(*number, *result, shared));
        }
    }

    /// Forgets what has become too old by `now`.
    pub fn expire(&mut self, now: Instant, shared: &mut Shared) {
        if self.poll_timeout().is_some_and(|at| at <= now) {
            self.forget(shared);
        }
    }

    /// Nothing is known any more.
    pub fn forget(&mut self, shared: &mut Shared) {
        self.asked = None;
        (1..=N as u8).for_each(|number| self.set(number, FieldResult::Unknown, shared));
    }

    /// When what is known becomes too old.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.asked.map(|asked| asked + AGE_MAX)
    }

    fn set(&mut self, number: u8, result: FieldResult, shared: &mut Shared) {
        let known = usize::from(number).checked_sub(1).and_then(|place| self.known.get_mut(place));
        if let Some(known) = known.filter(|known| **known != result) {
            *known = result;
            shared.zone((self.zone)(number), result);
        }
    }
}
