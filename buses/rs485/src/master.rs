//! The bus's master: one transaction at a time, its deadlines, its retries, and how well each node answers.
//!
//! Reads no clock and owns no port: feed it words and time, and after any call drain [`Master::poll_tx`], then
//! [`Master::poll_event`], then arm one timer for [`Master::poll_timeout`].
//!
//! ```text
//!            request          2 words of silence     poll_tx           tx_done
//!     Idle ----------> Gap -------------------> Ready -----> Sending ----------> Waiting
//!      ^                ^                                       |                  | |
//!      |                +------------- retry -------------------|------------------+ |
//!      +--------------------- answered, failed, not sent -------+--------------------+
//! ```

use crate::frame::{self, BROADCAST, Frame, MAX_DATA, MAX_WORDS, NO_ACK, OVERHEAD, RESEND, Status, Words};
use crate::instruction::Instruction;
use crate::node::{Change, ErrorCounter, Health, RoundTrips, Statistics};
use crate::reader::{Counters, Reader, Received};
use crate::{Data, Transmit, word_time};
use base::serial::Word;
use base::{Duration, Instant, Queue};
use culprit::Watch;
use heapless::Vec;

mod culprit;
mod transaction;

pub use crate::instruction::{Lengths, Request};
pub use transaction::{BusStatistics, Config, Event, RequestError, Why};

/// Most nodes that a master counts errors of.
pub const NODES_MAX: usize = 32;

/// Silence owed to the bus before anyone talks, in words (`docs/facts/boards.md` 1, turnaround).
const GAP_WORDS: u32 = 2;

/// An answer whose words arrive at less than this interval at the deadline is received to its end: the longest takes 25
/// ms at 115200 Bd, more than the 20 ms that a node has.
const WORDS_WITHIN: Duration = Duration::from_millis(5);

/// Events that wait to be drained.
const EVENTS: usize = 8;

/// An attempt of a transaction.
#[derive(Clone, Copy, Debug)]
struct Attempt {
    to: u8,
    instruction: u8,
    answered: bool,
    answer: Lengths,
    retries_left: u8,
    first: bool,
    /// When the request was sent that the node executes; an answer that it repeats belongs to the first one.
    asked: Option<Instant>,
}

#[derive(Clone, Copy, Debug)]
enum State {
    Idle,
    /// Silence owed to the bus; received words postpone `until`, but not beyond `latest`.
    Gap {
        attempt: Attempt,
        until: Instant,
        latest: Instant,
    },
    /// The host owes `poll_tx`.
    Ready {
        attempt: Attempt,
        until: Instant,
    },
    /// The host owes `handle_tx_done`; before `off` the last bit cannot have left.
    Sending {
        attempt: Attempt,
        started: Instant,
        off: Instant,
        until: Instant,
    },
    /// The node owes an answer; one that has begun puts `until` off while its words come, but not beyond `latest`.
    Waiting {
        attempt: Attempt,
        started: Instant,
        until: Instant,
        latest: Instant,
    },
}

#[derive(Debug)]
struct Node {
    address: u8,
    timeout: Duration,
    errors: ErrorCounter,
    statistics: Statistics,
    recent: RoundTrips,
}

/// The master.
#[derive(Debug)]
pub struct Master {
    config: Config,
    word: Duration,
    state: State,
    /// From when on the bus has been silent long enough.
    quiet: Instant,
    /// Time when the last word came.
    heard: Instant,
    reader: Reader,
    tx: Words,
    nodes: Vec<Node, NODES_MAX>,
    events: Queue<Event, EVENTS>,
    watch: Watch,
    statistics: BusStatistics,
}

impl Master {
    /// A master without nodes.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            config,
            word: word_time(config.baud),
            state: State::Idle,
            quiet: Instant::ZERO,
            heard: Instant::ZERO,
            reader: Reader::new(config.crc, None),
            tx: Words::new(),
            nodes: Vec::new(),
            events: Queue::new(),
            watch: Watch::new(),
            statistics: BusStatistics::default(),
        }
    }

    /// Counts errors of the node at `address` from now on, and gives it `timeout` to answer. False when there is no
    /// room ([`NODES_MAX`]). Nodes that were not added may be asked too, with the bus's own timeout.
    pub fn add_node(&mut self, address: u8, timeout: Duration) -> bool {
        if let Some(node) = self.node(address) {
            node.timeout = timeout;
            return true;
        }
        let node = Node {
            address,
            timeout,
            errors: ErrorCounter::default(),
            statistics: Statistics::default(),
            recent: RoundTrips::default(),
        };
        self.watch.add(address);
        self.nodes.push(node).is_ok()
    }

    /// Starts a transaction. It ends with exactly one of `Reply`, `Sent`, `Silent`, `Garbled`, `Unsent`.
    ///
    /// # Errors
    /// When the caller did wrong; the bus is untouched then.
    pub fn request(&mut self, request: Request<'_>) -> Result<(), RequestError> {
        if !self.is_idle() {
            return Err(RequestError::Busy);
        }
        if request.data.len() > MAX_DATA {
            return Err(RequestError::TooLong { len: request.data.len(), max: MAX_DATA });
        }
        let Request { to, instruction, data, no_ack, answer } = request;
        let flags = if no_ack { NO_ACK } else { 0 };
        Frame { address: to, instruction, flags, data }.encode(self.config.crc, &mut self.tx);
        let answered = !no_ack && to != BROADCAST;
        let lost = self.health(to) == Health::Lost;
        let retries_left = if answered && !lost { self.config.retries } else { 0 };
        let attempt = Attempt { to, instruction, answered, answer, retries_left, first: true, asked: None };
        self.state = State::Gap { attempt, until: self.quiet, latest: self.quiet + self.config.patience };
        Ok(())
    }

    /// True if a request would be accepted.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        matches!(self.state, State::Idle)
    }

    /// Gives up the outstanding transaction without an event, for instance because the port is gone.
    pub fn cancel(&mut self) {
        self.state = State::Idle;
        self.reader.reset();
        self.watch.on_cancel();
    }

    /// Health of a node; Ok for a node that was not added.
    #[must_use]
    pub fn health(&self, address: u8) -> Health {
        self.nodes.iter().find(|node| node.address == address).map_or(Health::Ok, |node| node.errors.health())
    }

    /// The node's error counter, 0 to 128; none for a node that was not added.
    #[must_use]
    pub fn error_count(&self, address: u8) -> Option<u8> {
        self.nodes.iter().find(|node| node.address == address).map(|node| node.errors.value())
    }

    /// The node's statistics; none for a node that was not added.
    #[must_use]
    pub fn statistics(&self, address: u8) -> Option<&Statistics> {
        self.nodes.iter().find(|node| node.address == address).map(|node| &node.statistics)
    }

    /// The node's round trips since the last call.
    pub fn take_recent(&mut self, address: u8) -> RoundTrips {
        self.node(address).map(|node| core::mem::take(&mut node.recent)).unwrap_or_default()
    }

    /// The bus's statistics.
    #[must_use]
    pub fn bus_statistics(&self) -> BusStatistics {
        self.statistics
    }

    /// Counters of reception.
    #[must_use]
    pub fn reception(&self) -> Counters {
        self.reader.counters()
    }

    /// Takes words that were received, the last of them at `now`.
    pub fn handle_rx(&mut self, now: Instant, words: &[Word]) {
        for word in words {
            self.handle_word(now, *word);
        }
    }

    fn handle_word(&mut self, now: Instant, word: Word) {
        self.statistics.words += 1;
        self.heard = now;
        self.busy_until(now);
        if !self.config.full_duplex && self.watch.on_word(now, word, &mut self.events) {
            self.statistics.surplus_words += 1;
        }
        let answer = match self.reader.push(now, word) {
            None => Answer::None,
            Some(Received::BadCrc(frame)) => Answer::of_damaged(self.state, frame, &self.config),
            Some(Received::Frame(frame)) => {
                self.statistics.frames += 1;
                let answer = Answer::of(self.state, frame, &self.config);
                if matches!(answer, Answer::Stray) && !self.config.full_duplex {
                    let waiting = matches!(self.state, State::Sending { .. } | State::Waiting { .. });
                    self.watch.on_stray(now, frame.address, frame.flags, waiting, &mut self.events);
                }
                answer
            }
        };
        self.state = match (self.state, answer) {
            (
                State::Sending { attempt, started, .. } | State::Waiting { attempt, started, .. },
                Answer::Good(status, data),
            ) => self.answered(now, attempt, started, status, data),
            (State::Waiting { attempt, .. }, Answer::Damaged(why)) => self.damaged(attempt, why),
            // The host may report transmission after reception; a damaged frame is judged at the deadline then.
            (state @ State::Sending { .. }, Answer::Damaged(_)) => state,
            (state, Answer::Unasked { from, instruction, data }) => {
                self.unasked(from, instruction, data);
                self.put_off(state)
            }
            (state, Answer::None) => self.put_off(state),
            (state, Answer::Stray | Answer::Good(..) | Answer::Damaged(_)) => {
                self.statistics.stray_frames += 1;
                self.put_off(state)
            }
        };
    }

    /// Postpones a request that waits for silence, after received words.
    fn put_off(&self, state: State) -> State {
        match state {
            State::Gap { attempt, latest, .. } => State::Gap { attempt, until: self.quiet.min(latest), latest },
            other => other,
        }
    }

    /// The wire is in use until `at`. On a full-duplex link the master's own pair is its own.
    fn busy_until(&mut self, at: Instant) {
        if !self.config.full_duplex {
            self.quiet = at + self.word * GAP_WORDS;
        }
    }

    fn unasked(&mut self, from: u8, instruction: u8, data: Data) {
        self.watch.on_unasked(data.len() + OVERHEAD);
        if let Some(node) = self.node(from) {
            node.statistics.unasked += 1;
        }
        // Half of the queue is kept for what a transaction comes to, however many talk between two drains.
        if self.events.len() < EVENTS / 2 {
            self.events.push(Event::Unasked { from, instruction, data });
        }
    }

    /// The last bit of what [`Master::poll_tx`] gave has left the wire.
    pub fn handle_tx_done(&mut self, now: Instant) {
        let State::Sending { attempt, started, off, .. } = self.state else {
            return;
        };
        let now = now.max(off);
        self.busy_until(now);
        self.state = if attempt.answered {
            let until = now + self.timeout(attempt.to);
            State::Waiting { attempt, started, until, latest: until + self.word * MAX_WORDS as u32 }
        } else {
            self.events.push(Event::Sent { to: attempt.to, instruction: attempt.instruction });
            State::Idle
        };
    }

    /// Serves deadlines; late and needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.state = match self.state {
            State::Gap { attempt, until, .. } if until <= now => {
                State::Ready { attempt, until: now + self.config.patience }
            }
            State::Ready { attempt, until } | State::Sending { attempt, until, .. } if until <= now => {
                self.statistics.unsent += 1;
                self.events.push(Event::Unsent { to: attempt.to, instruction: attempt.instruction });
                State::Idle
            }
            State::Waiting { attempt, started, until, latest } if until <= now && self.goes_on(now, latest) => {
                State::Waiting { attempt, started, until: (self.heard + WORDS_WITHIN).min(latest), latest }
            }
            State::Waiting { attempt, until, .. } if until <= now && self.reader.is_untidy() => {
                self.damaged(attempt, Why::Incomplete)
            }
            State::Waiting { attempt, until, .. } if until <= now => self.silent(attempt),
            other => other,
        };
    }

    /// True if an answer is being received.
    fn goes_on(&self, now: Instant, latest: Instant) -> bool {
        self.reader.is_under_way() && now < self.heard + WORDS_WITHIN && now < latest
    }

    /// Next output, to be sent at once and without a gap.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Transmit<'_>> {
        if let State::Gap { until, .. } = self.state
            && until <= now
        {
            self.handle_timeout(now);
        }
        let State::Ready { mut attempt, .. } = self.state else {
            return None;
        };
        attempt.asked.get_or_insert(now);
        let off = now + self.word * self.tx.len() as u32;
        self.state = State::Sending { attempt, started: now, off, until: off + self.config.patience };
        if self.config.full_duplex {
            self.reader.tidy();
        } else {
            self.reader.reset();
            let words = attempt.answered.then(|| usize::from(attempt.answer.max) + OVERHEAD);
            self.watch.on_sent(now, attempt.to, words, &mut self.events);
        }
        self.statistics.frames += 1;
        self.statistics.words += self.tx.len() as u64;
        if let Some(node) = self.node(attempt.to) {
            let counter = if attempt.first { &mut node.statistics.requests } else { &mut node.statistics.retries };
            *counter += 1;
        }
        Some(Transmit { words: &self.tx })
    }

    /// The next thing that happened.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    /// Instant of the next [`Master::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Idle => None,
            State::Gap { until, .. }
            | State::Ready { until, .. }
            | State::Sending { until, .. }
            | State::Waiting { until, .. } => Some(until),
        }
    }

    fn answered(&mut self, now: Instant, attempt: Attempt, started: Instant, status: Status, data: Data) -> State {
        let Attempt { to, instruction, asked, .. } = attempt;
        let change = self.node(to).and_then(|node| {
            let round_trip = now.since(started);
            node.statistics.round_trips.add(round_trip);
            node.recent.add(round_trip);
            node.errors.good()
        });
        self.events.push(Event::Reply { to, instruction, asked: asked.unwrap_or(started), status, data });
        self.changed(to, change);
        self.watch.on_good(to, &mut self.events);
        State::Idle
    }

    fn silent(&mut self, attempt: Attempt) -> State {
        if let Some(node) = self.node(attempt.to) {
            node.statistics.timeouts += 1;
        }
        let Attempt { to, instruction, .. } = attempt;
        self.retry_or(self.hurried(attempt), 0, Event::Silent { to, instruction })
    }

    fn damaged(&mut self, attempt: Attempt, why: Why) -> State {
        if let Some(node) = self.node(attempt.to) {
            node.statistics.crc_errors += 1;
        }
        match why {
            // A request misread by the node is no fault of its transmitter.
            Why::Request => self.watch.on_misread(),
            _ => self.watch.on_damaged(attempt.to, &mut self.events),
        }
        let attempt = if why == Why::Incomplete { self.hurried(attempt) } else { attempt };
        // The first retry asks for the same answer again; if that does not help the node may have none to repeat. A
        // node that could not read the request has not.
        let flags = if attempt.first && why != Why::Request { RESEND } else { 0 };
        let Attempt { to, instruction, .. } = attempt;
        self.retry_or(attempt, flags, Event::Garbled { to, instruction, why })
    }

    /// A degraded node is not asked again when its time ran out: that time belongs to the others. Damage is known at
    /// once, and costs no more than its words.
    fn hurried(&self, attempt: Attempt) -> Attempt {
        if self.health(attempt.to) == Health::Ok { attempt } else { Attempt { retries_left: 0, ..attempt } }
    }

    fn retry_or(&mut self, attempt: Attempt, flags: u8, failure: Event) -> State {
        self.statistics.errors += 1;
        if attempt.retries_left > 0 {
            frame::set_flags(self.config.crc, &mut self.tx, flags);
            let asked = attempt.asked.filter(|_| flags & RESEND != 0);
            let attempt = Attempt { retries_left: attempt.retries_left - 1, first: false, asked, ..attempt };
            return State::Gap { attempt, until: self.quiet, latest: self.quiet + self.config.patience };
        }
        self.events.push(failure);
        let change = self.node(attempt.to).and_then(|node| {
            node.statistics.failures += 1;
            node.errors.failed()
        });
        self.changed(attempt.to, change);
        State::Idle
    }

    fn changed(&mut self, node: u8, change: Option<Change>) {
        let event = match change {
            None => return,
            Some(Change::Degraded) => Event::Degraded { node },
            Some(Change::Recovered) => Event::Recovered { node },
            Some(Change::Lost) => Event::Lost { node },
            Some(Change::Back) => Event::Back { node },
        };
        self.events.push(event);
    }

    fn timeout(&self, address: u8) -> Duration {
        self.nodes.iter().find(|node| node.address == address).map_or(self.config.timeout, |node| node.timeout)
    }

    fn node(&mut self, address: u8) -> Option<&mut Node> {
        self.nodes.iter_mut().find(|node| node.address == address)
    }
}

/// Effect of a received word on the outstanding transaction.
enum Answer {
    /// No effect yet.
    None,
    /// A frame that is not the answer to what was asked: a late answer, another talker.
    Stray,
    Good(Status, Data),
    Damaged(Why),
    Unasked {
        from: u8,
        instruction: u8,
        data: Data,
    },
}

impl Answer {
    fn of(state: State, frame: Frame<'_>, config: &Config) -> Self {
        let (State::Sending { attempt, .. } | State::Waiting { attempt, .. }) = state else {
            return Self::unasked(frame, config);
        };
        if (frame.address, frame.instruction) != (attempt.to, attempt.instruction) || !attempt.answered {
            return Self::unasked(frame, config);
        }
        match Status::from_byte(frame.flags) {
            None => Self::Damaged(Why::Status { got: frame.flags }),
            Some(Status::BadCrc) => Self::Damaged(Why::Request),
            Some(Status::Ok) if !attempt.answer.allow(frame.data.len()) => {
                Self::Damaged(Why::Length { got: frame.data.len() as u8 })
            }
            Some(status) => Self::Good(status, frame.data.iter().copied().collect()),
        }
    }

    /// Nothing in a damaged frame can be trusted. But where nodes may send unsolicited messages, one that does not look
    /// like the answer is left to the deadline: the answer may follow.
    fn of_damaged(state: State, frame: Frame<'_>, config: &Config) -> Self {
        match state {
            State::Waiting { attempt, .. }
                if !config.unasked.is_empty()
                    && (frame.address, frame.instruction) != (attempt.to, attempt.instruction) =>
            {
                Self::Stray
            }
            _ => Self::Damaged(Why::Crc),
        }
    }

    fn unasked(frame: Frame<'_>, config: &Config) -> Self {
        let Frame { address, instruction, flags, data } = frame;
        let allows = |known: &Instruction| known.code == instruction && known.answer.allow(data.len());
        if flags == Status::Ok as u8 && config.unasked.iter().any(allows) {
            Self::Unasked { from: address, instruction, data: data.iter().copied().collect() }
        } else {
            Self::Stray
        }
    }
}

#[cfg(test)]
mod tests;
