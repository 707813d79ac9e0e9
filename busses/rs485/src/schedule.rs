//! Who is asked next: polls on their own grids, and demands between them.

use base::{Duration, Instant, Queue, Ticker};
use heapless::Vec;

/// How often a lost node is asked (`docs/facts/boards.md` 2).
pub const PROBE: Duration = Duration::from_secs(1);

/// What to ask of whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// The node.
    pub to: u8,
    /// The instruction.
    pub instruction: u8,
}

#[derive(Debug)]
struct Poll {
    turn: Turn,
    period: Duration,
    ticker: Ticker,
}

/// At most `N` polls and 8 waiting demands.
#[derive(Debug)]
pub struct Schedule<const N: usize> {
    polls: Vec<Poll, N>,
    demands: Queue<Turn, 8>,
}

impl<const N: usize> Schedule<N> {
    /// Nothing to ask.
    #[must_use]
    pub const fn new() -> Self {
        Self { polls: Vec::new(), demands: Queue::new() }
    }

    /// Asks `turn` at `first`, then every `period`. False when there is no room.
    pub fn poll(&mut self, first: Instant, period: Duration, turn: Turn) -> bool {
        self.polls.push(Poll { turn, period, ticker: Ticker::new(first, period) }).is_ok()
    }

    /// Asks `turn` once, before any poll. False when 8 wait already.
    pub fn demand(&mut self, turn: Turn) -> bool {
        self.demands.push(turn)
    }

    /// Whose turn it is: call when the bus is free, and ask. Of polls that are due the one due longest is first.
    pub fn due(&mut self, now: Instant) -> Option<Turn> {
        if let Some(turn) = self.demands.pop() {
            return Some(turn);
        }
        let poll = self.polls.iter_mut().min_by_key(|poll| poll.ticker.next())?;
        poll.ticker.due(now).then_some(poll.turn)
    }

    /// When the next turn comes; `now` at the latest means at once.
    #[must_use]
    pub fn next(&self) -> Option<Instant> {
        if self.demands.is_empty() {
            self.polls.iter().map(|poll| poll.ticker.next()).min()
        } else {
            Some(Instant::ZERO)
        }
    }

    /// The node is lost: each of its polls comes once in [`PROBE`] from now on.
    pub fn lost(&mut self, now: Instant, node: u8) {
        for poll in self.polls.iter_mut().filter(|poll| poll.turn.to == node) {
            let period = poll.period.max(PROBE);
            poll.ticker = Ticker::new(now + period, period);
        }
    }

    /// The node is back: its polls have their own periods again, from now on.
    pub fn back(&mut self, now: Instant, node: u8) {
        for poll in self.polls.iter_mut().filter(|poll| poll.turn.to == node) {
            poll.ticker = Ticker::new(now + poll.period, poll.period);
        }
    }
}

impl<const N: usize> Default for Schedule<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SD1: Turn = Turn { to: 0x10, instruction: 0x10 };
    const SO1: Turn = Turn { to: 0x20, instruction: 0x01 };
    const VERSION: Turn = Turn { to: 0x10, instruction: 0xFE };

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn schedule() -> Schedule<4> {
        let mut schedule = Schedule::new();
        assert!(schedule.poll(ms(0), Duration::from_millis(250), SD1));
        assert!(schedule.poll(ms(10), Duration::from_millis(100), SO1));
        schedule
    }

    #[test]
    fn polls_keep_their_grids_whenever_they_are_served() {
        let mut schedule = schedule();
        assert_eq!([ms(0), ms(5), ms(17), ms(18)].map(|now| schedule.due(now)), [Some(SD1), None, Some(SO1), None]);
        assert_eq!(schedule.next(), Some(ms(110)));
        // Served late, both are due: the one due longest first; what was missed is dropped.
        assert_eq!([ms(460), ms(461), ms(462)].map(|now| schedule.due(now)), [Some(SO1), Some(SD1), None]);
        assert_eq!(schedule.next(), Some(ms(500)));
    }

    #[test]
    fn a_demand_comes_between_polls() {
        let mut schedule = schedule();
        assert!(schedule.demand(VERSION));
        assert_eq!(schedule.next(), Some(Instant::ZERO));
        assert_eq!([schedule.due(ms(0)), schedule.due(ms(0)), schedule.due(ms(0))], [Some(VERSION), Some(SD1), None]);
    }

    #[test]
    fn a_lost_node_is_asked_once_a_second_until_it_is_back() {
        let mut schedule = schedule();
        schedule.lost(ms(0), SO1.to);
        assert_eq!(schedule.due(ms(0)), Some(SD1));
        let asked = (1..5000).filter(|now| schedule.due(ms(*now)) == Some(SO1)).count();
        assert_eq!(asked, 4);
        schedule.back(ms(5000), SO1.to);
        let asked = (5000..6000).filter(|now| schedule.due(ms(*now)) == Some(SO1)).count();
        assert_eq!(asked, 9);
    }

    #[test]
    fn a_full_schedule_refuses() {
        let mut schedule = Schedule::<1>::new();
        assert!(schedule.poll(ms(0), PROBE, SD1) && !schedule.poll(ms(0), PROBE, SO1));
        assert_eq!((0..9).filter(|_| schedule.demand(VERSION)).count(), 8);
    }
}
