//! History of the last two seconds: measurements in the order of their instants, and the state after each.

use super::state::{Sight, State, Step};
use base::{Duration, Instant};
use std::collections::VecDeque;

/// Length of the history: older measurements are final.
pub const HISTORY: Duration = Duration::from_secs(2);

/// A measurement.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// Begin of the history.
    Begin,
    /// A motion step up to this instant.
    Way(Step),
    /// A bearing.
    Bearing {
        sight: Sight,
        /// True until it has been processed.
        fresh: bool,
        /// True if it may change the state; false if only its fit is computed.
        used: bool,
        /// True if it was accepted when it was processed.
        accepted: bool,
    },
}

/// A measurement and the state after it.
#[derive(Clone, Copy, Debug)]
pub struct Entry<const N: usize> {
    pub at: Instant,
    pub kind: Kind,
    pub state: State<N>,
}

/// Ring of entries; never empty.
#[derive(Debug)]
pub struct History<const N: usize> {
    entries: VecDeque<Entry<N>>,
    /// Index from which states must be computed again.
    pub dirty: usize,
    /// Last motion step before the beginning.
    left: Step,
}

impl<const N: usize> History<N> {
    pub fn new(at: Instant, state: &State<N>) -> Self {
        let mut entries = VecDeque::with_capacity(128);
        entries.push_back(Entry { at, kind: Kind::Begin, state: *state });
        Self { entries, dirty: 1, left: Step::default() }
    }

    pub fn last(&self) -> &Entry<N> {
        &self.entries[self.entries.len() - 1]
    }

    pub fn first_at(&self) -> Instant {
        self.entries[0].at
    }

    /// Restarts the history at its end with another state.
    pub fn restart(&mut self, state: &State<N>) {
        self.left = self.last_step();
        let last = Entry { kind: Kind::Begin, state: *state, ..*self.last() };
        self.entries.clear();
        self.entries.push_back(last);
        self.dirty = 1;
    }

    /// Appends a motion step up to `at`, later than the last entry.
    pub fn push(&mut self, at: Instant, step: Step) {
        let state = self.last().state;
        self.entries.push_back(Entry { at, kind: Kind::Way(step), state });
        // The first entry keeps its state and becomes the beginning.
        while self.dirty > 1 && self.entries.get(1).is_some_and(|second| at.since(second.at) > HISTORY) {
            self.entries.pop_front();
            self.dirty -= 1;
        }
    }

    /// Index at which a bearing of `at` belongs; splits a motion step that extends beyond it. `at` lies between the
    /// first and the last entry.
    pub fn place(&mut self, at: Instant) -> usize {
        let mut place = self.entries.len();
        while place > 1 && self.entries[place - 1].at > at {
            place -= 1;
        }
        let before = self.entries[place - 1];
        if let Some(Entry { at: end, kind: Kind::Way(step), .. }) = self.entries.get(place).copied()
            && before.at < at
        {
            let part = at.since(before.at).as_secs_f64() / end.since(before.at).as_secs_f64();
            let (first, rest) = (step.part(part), step.part(1.0 - part));
            self.entries[place].kind = Kind::Way(rest);
            self.insert(place, &Entry { at, kind: Kind::Way(first), state: before.state });
            return place + 1;
        }
        place
    }

    pub fn insert(&mut self, place: usize, entry: &Entry<N>) {
        self.entries.insert(place, *entry);
        self.dirty = self.dirty.min(place);
    }

    /// Entry before an index.
    pub fn before(&self, place: usize) -> &Entry<N> {
        &self.entries[place - 1]
    }

    /// Motion step that contains the instant at an index, or else the last one before it.
    pub fn step_at(&self, place: usize) -> Step {
        let is_way = |entry: &Entry<N>| if let Kind::Way(step) = entry.kind { Some(step) } else { None };
        let on = self.entries.get(place).and_then(is_way);
        on.or_else(|| self.entries.range(..place).rev().find_map(is_way)).unwrap_or(self.left)
    }

    /// Last motion step.
    pub fn last_step(&self) -> Step {
        self.step_at(self.entries.len())
    }

    /// Indices of the bearings that changed the state, newest first, without the last entry.
    pub fn bearings(&self) -> impl Iterator<Item = usize> {
        let end = self.entries.len() - 1;
        (1..end).rev().filter(|place| matches!(self.entries[*place].kind, Kind::Bearing { used: true, .. }))
    }

    /// Entries from an index on.
    pub fn from(&self, place: usize) -> impl Iterator<Item = &Entry<N>> {
        self.entries.range(place..)
    }

    /// Excludes the bearing at this index from the estimate; later states are computed again. Returns the bearing if it
    /// had been accepted.
    pub fn take_back(&mut self, place: usize) -> Option<(Instant, Sight)> {
        let Entry { at, kind: Kind::Bearing { sight, used, accepted, .. }, .. } = &mut self.entries[place] else {
            return None;
        };
        *used = false;
        self.dirty = self.dirty.min(place);
        std::mem::take(accepted).then_some((*at, *sight))
    }

    /// Next entry to be processed, and the state before it.
    pub fn next(&mut self) -> Option<(State<N>, &mut Entry<N>)> {
        let place = self.dirty;
        let state = self.entries.get(place.checked_sub(1)?)?.state;
        let entry = self.entries.get_mut(place)?;
        self.dirty += 1;
        Some((state, entry))
    }
}
