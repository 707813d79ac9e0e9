//! Table of range finders with the last measurement of each and its instant.
//!
//! A distance board fires its sonars in slots, sweep after sweep, synchronised with nothing; its answer contains the
//! last finished slot of each channel (`docs/facts/boards.md`, timing of the boards). So an answer alone gives a window
//! of one sweep in which a channel fired; the published instant is its middle. If the board is polled faster than it
//! sweeps, a distance that changed since the previous answer narrows the window, and an unchanged one is the same
//! measurement and keeps its instant. Since a channel fires once per sweep, the window of its last firing narrows the
//! next one too.

use super::config::{Config, Ranger};
use crate::rs485_bus::Kind;
use base::{Duration, Instant};
use messages::lowlevel::{Range, Reading};
use rs485::boards::sd1::{Both, IR_CYCLE, NO_ECHO, OUT_OF_RANGE, SLOT, SRFS, SWEEP};

/// Maximum deviation of a board's sweep from its nominal duration: 0.5 %, that of a ceramic resonator.
const SWEEP_TOLERANCE: Duration = Duration::from_millis(1);
/// Maximum number of sweeps over which the last firing predicts the next one.
const SWEEPS_PREDICTED: u32 = 8;

/// Last measurements of all SD1 boards, published together once all have answered, failed, or are not waited for.
#[derive(Debug)]
pub struct Ranges {
    boards: Vec<Board>,
    /// Sorted by number.
    srfs: Vec<Ranger>,
    irs: Vec<Ranger>,
    latest: Option<Instant>,
}

#[derive(Debug)]
struct Board {
    address: u8,
    last: Option<Answer>,
    /// Start of the current or last transaction.
    asked: Instant,
    /// End of the first sweep after a possible reset: until then a channel that has not fired yet reads like one
    /// without an echo.
    swept: Instant,
    /// Last firing of each sonar and measurement of the infrared rangers; kept when the board fails.
    fired: [Option<Firing>; SRFS],
    floor: Option<Instant>,
    /// Has answered or failed since the last publication.
    done: bool,
}

/// An answer; its measurements were complete at the earliest when it was requested.
#[derive(Debug)]
struct Answer {
    asked: Instant,
    both: Both,
}

/// Window of a sonar's firing, from `from` to `to`, published as `at`.
#[derive(Clone, Copy, Debug)]
struct Firing {
    at: Instant,
    from: Instant,
    to: Instant,
}

impl Firing {
    fn between(from: Instant, to: Instant) -> Self {
        Self { at: from + to.since(from) / 2, from, to }
    }

    /// Window `sweeps` later, intersected with `window`.
    fn later(&self, sweeps: u32, window: &Self) -> Option<Self> {
        let from = self.from + (SWEEP - SWEEP_TOLERANCE) * sweeps;
        let to = self.to + (SWEEP + SWEEP_TOLERANCE) * sweeps;
        let (from, to) = (from.max(window.from), to.min(window.to));
        (from <= to).then(|| Self::between(from, to))
    }

    /// Firing after `self` within `window`, for all possible numbers of sweeps in between.
    fn next(&self, window: &Self) -> Option<Self> {
        let possible = (1..=SWEEPS_PREDICTED).filter_map(|sweeps| self.later(sweeps, window));
        possible.reduce(|first, last| Self::between(first.from, last.to))
    }
}

impl Board {
    fn new(address: u8) -> Self {
        Self {
            address,
            last: None,
            asked: Instant::ZERO,
            swept: Instant::NEVER,
            fired: [None; SRFS],
            floor: None,
            done: false,
        }
    }

    fn take(&mut self, received: Instant, both: Both) {
        let asked = self.asked.min(received);
        if self.last.is_none() {
            self.swept = received + SWEEP;
        }
        let latest = received - SLOT;
        let whole = Firing::between(asked - (SLOT + SWEEP), latest);
        for (channel, fired) in self.fired.iter_mut().enumerate() {
            let Some(now) = both.srfs.get(channel) else { continue };
            if *now == NO_ECHO && asked < self.swept {
                *fired = None;
                continue;
            }
            let Some(before) = &self.last else {
                *fired = Some(whole);
                continue;
            };
            let same = before.both.srfs.get(channel) == Some(now);
            let known = fired.filter(|fired| same && fired.to >= whole.from);
            let changed = Firing::between((before.asked - SLOT).max(whole.from), latest);
            let window = if same { whole } else { changed };
            let next = || fired.and_then(|fired| fired.next(&window)).unwrap_or(window);
            *fired = Some(known.unwrap_or_else(next));
        }
        // The last completed cycle of the infrared rangers.
        self.floor = Some(Firing::between(asked - 2 * IR_CYCLE, received - IR_CYCLE).at);
        self.last = Some(Answer { asked, both });
    }

    fn fail(&mut self) {
        self.last = None;
    }
}

impl Ranges {
    pub fn new(config: &Config) -> Self {
        let sorted = |rangers: &[Ranger]| {
            let mut rangers = rangers.to_vec();
            rangers.sort_by_key(|ranger| ranger.id);
            rangers
        };
        let sd1 = config.nodes.iter().filter(|node| node.kind == Kind::Sd1);
        Self {
            boards: sd1.map(|node| Board::new(node.address)).collect(),
            srfs: sorted(&config.srfs),
            irs: sorted(&config.irs),
            latest: None,
        }
    }

    /// True if the configuration has no range finder.
    pub fn is_empty(&self) -> bool {
        self.srfs.is_empty() && self.irs.is_empty()
    }

    /// Addresses of the boards.
    pub fn boards(&self) -> impl Iterator<Item = u8> + '_ {
        self.boards.iter().map(|board| board.address)
    }

    /// A board is being asked for its ranges.
    pub fn asked(&mut self, now: Instant, address: u8) {
        if let Some(board) = self.boards.iter_mut().find(|board| board.address == address) {
            board.asked = now;
        }
    }

    /// True if the board already finished this round: publish before processing its next answer.
    pub fn is_done(&self, address: u8) -> bool {
        self.boards.iter().any(|board| board.address == address && board.done)
    }

    /// Stores a board's measurement, or its failure.
    pub fn put(&mut self, at: Instant, address: u8, both: Option<Both>) {
        if let Some(board) = self.boards.iter_mut().find(|board| board.address == address) {
            board.done = true;
            match both {
                Some(both) => board.take(at, both),
                None => board.fail(),
            }
            self.latest = Some(at);
        }
    }

    /// True if all boards that are waited for have answered or failed.
    pub fn complete(&self, waited_for: impl Fn(u8) -> bool) -> bool {
        let mut boards = self.boards.iter();
        boards.clone().any(|board| board.done) && boards.all(|board| board.done || !waited_for(board.address))
    }

    /// All sonars and infrared rangers in the form of 2011, and the time of the last answer; starts the next round.
    pub fn publish(&mut self) -> (Instant, Vec<Range>, Vec<Range>) {
        self.begin_round();
        let at = self.latest.unwrap_or_default();
        (at, self.list(&self.srfs, sonar), self.list(&self.irs, infrared))
    }

    /// All readings, sonars first, each with its own instant; `timestamp` converts instants.
    pub fn readings(&self, timestamp: impl Fn(Instant) -> i64) -> Vec<Reading> {
        let sonars = self.srfs.iter().map(|ranger| self.reading(ranger, Reading::SONAR, sonar, &timestamp));
        let infrareds = self.irs.iter().map(|ranger| self.reading(ranger, Reading::INFRARED, infrared, &timestamp));
        sonars.chain(infrareds).collect()
    }

    /// Starts a round, in which all boards answer again.
    pub fn begin_round(&mut self) {
        self.boards.iter_mut().for_each(|board| board.done = false);
    }

    /// Discards all measurements.
    pub fn forget(&mut self) {
        for board in &mut self.boards {
            board.fail();
            board.done = false;
        }
    }

    fn board(&self, ranger: &Ranger) -> Option<&Board> {
        self.boards.iter().find(|board| board.address == ranger.board)
    }

    fn list(&self, rangers: &[Ranger], measured: impl Fn(&Both, usize) -> Option<Echo>) -> Vec<Range> {
        let range = |ranger: &Ranger| {
            let answer = self.board(ranger).and_then(|board| board.last.as_ref());
            let heard = answer.and_then(|answer| measured(&answer.both, usize::from(ranger.channel)));
            let Ranger { id, x, y, theta, .. } = *ranger;
            let distance = heard.flatten().unwrap_or(f64::NAN);
            Range { id: i32::from(id), x, y, theta, distance, valid: distance.is_finite() }
        };
        rangers.iter().map(range).collect()
    }

    fn reading(
        &self,
        ranger: &Ranger,
        kind: i8,
        measured: impl Fn(&Both, usize) -> Option<Echo>,
        timestamp: impl Fn(Instant) -> i64,
    ) -> Reading {
        let Ranger { id, channel, x, y, theta, beam, .. } = *ranger;
        let channel = usize::from(channel);
        let board = self.board(ranger);
        let heard = board.and_then(|board| {
            let answer = board.last.as_ref()?;
            let heard = measured(&answer.both, channel)?;
            (heard.is_some() || kind != Reading::SONAR || answer.asked >= board.swept).then_some(heard)
        });
        let fired = board.and_then(|board| match kind {
            Reading::SONAR => board.fired.get(channel)?.map(|fired| fired.at),
            _ => board.floor,
        });
        let (status, distance) = match heard {
            None => (Reading::UNKNOWN, f64::NAN),
            Some(None) => (Reading::SILENT, f64::NAN),
            Some(Some(distance)) => (Reading::MEASURED, distance),
        };
        let timestamp = fired.map_or(0, timestamp);
        Reading { timestamp, id: i32::from(id), kind, status, distance, x, y, theta, beam }
    }
}

/// Distance of a channel's echo, m; `None`: no echo.
type Echo = Option<f64>;

fn sonar(both: &Both, channel: usize) -> Option<Echo> {
    both.srfs.get(channel).map(|mm| (*mm != NO_ECHO).then(|| f64::from(*mm) / 1000.0))
}

fn infrared(both: &Both, channel: usize) -> Option<Echo> {
    both.irs.get(channel).map(|mm| (*mm != OUT_OF_RANGE).then(|| f64::from(*mm) / 1000.0))
}
