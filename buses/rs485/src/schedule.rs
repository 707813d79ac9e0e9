//! Who is asked next: polls on their own grids, and demands on the wire that polls leave idle.
//!
//! A demand waits while a poll is due, so it makes a poll late by at most the one transaction that was under way. Only
//! where polls leave no idle wire, because more is asked than the wire can carry, one demand goes before them in every
//! [`ROUNDS`] rounds.

use base::{Duration, Instant, Queue, Ticker};
use heapless::Vec;

/// Interval at which a lost node is asked (`docs/facts/boards.md` 2).
pub const PROBE: Duration = Duration::from_secs(1);

/// Rounds of polls that a demand waits for idle wire.
pub const ROUNDS: usize = 2;

/// Most demands that wait.
pub const DEMANDS: usize = 8;

/// Request to a node.
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
    /// The node is lost: this poll probes it, or pauses.
    lost: bool,
}

/// At most `N` polls and [`DEMANDS`] waiting demands.
#[derive(Debug)]
pub struct Schedule<const N: usize> {
    polls: Vec<Poll, N>,
    demands: Queue<Turn, DEMANDS>,
    /// Polls that went before the demand that waits longest.
    waited: usize,
    /// Demands that may still go before the first poll: no poll has a rate to keep yet.
    early: usize,
}

impl<const N: usize> Schedule<N> {
    /// Makes an empty schedule.
    #[must_use]
    pub const fn new() -> Self {
        Self { polls: Vec::new(), demands: Queue::new(), waited: 0, early: DEMANDS }
    }

    /// Asks `turn` at `first`, then every `period`. False when there is no room.
    pub fn poll(&mut self, first: Instant, period: Duration, turn: Turn) -> bool {
        self.polls.push(Poll { turn, period, ticker: Ticker::new(first, period), lost: false }).is_ok()
    }

    /// Changes the period of a poll, which is due at once, so that polls that are changed together are in phase. While
    /// the node is lost the period is kept for later.
    pub fn set_period(&mut self, now: Instant, turn: Turn, period: Duration) {
        let Some(poll) = self.polls.iter_mut().find(|poll| poll.turn == turn) else { return };
        poll.period = period;
        if !poll.lost {
            poll.ticker = Ticker::new(now, period);
        }
    }

    /// Asks `turn` once, as soon as no poll is due; before the first poll, at once. False when [`DEMANDS`] wait
    /// already.
    pub fn demand(&mut self, turn: Turn) -> bool {
        self.demands.push(turn)
    }

    /// Whose turn it is: call when the bus is free, and ask. Of polls that are due the one due longest is first.
    pub fn due(&mut self, now: Instant) -> Option<Turn> {
        if (self.early > 0 || self.waited >= ROUNDS * self.polls.len())
            && let Some(turn) = self.next_demand()
        {
            return Some(turn);
        }
        let poll = self.polls.iter_mut().min_by_key(|poll| poll.ticker.next());
        match poll.filter(|poll| poll.ticker.next() <= now) {
            Some(poll) => {
                poll.ticker.due(now);
                self.early = 0;
                self.waited += usize::from(!self.demands.is_empty());
                Some(poll.turn)
            }
            None => self.next_demand(),
        }
    }

    fn next_demand(&mut self) -> Option<Turn> {
        self.waited = 0;
        self.early = self.early.saturating_sub(1);
        self.demands.pop()
    }

    /// Instant of the next turn; `now` or earlier means at once.
    #[must_use]
    pub fn next(&self) -> Option<Instant> {
        if self.demands.is_empty() {
            self.polls.iter().map(|poll| poll.ticker.next()).min()
        } else {
            Some(Instant::ZERO)
        }
    }

    /// The node is lost: the first of its polls comes once in [`PROBE`] from now on, its others not at all.
    pub fn lost(&mut self, now: Instant, node: u8) {
        let mut polls = self.polls.iter_mut().filter(|poll| poll.turn.to == node);
        if let Some(poll) = polls.next() {
            let period = poll.period.max(PROBE);
            poll.ticker = Ticker::new(now + period, period);
            poll.lost = true;
        }
        polls.for_each(|poll| {
            poll.ticker = Ticker::new(Instant::NEVER, poll.period);
            poll.lost = true;
        });
    }

    /// The node is back: its polls have their own periods again, from now on.
    pub fn back(&mut self, now: Instant, node: u8) {
        for poll in self.polls.iter_mut().filter(|poll| poll.turn.to == node) {
            poll.ticker = Ticker::new(now + poll.period, poll.period);
            poll.lost = false;
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
    fn demands_use_the_wire_that_polls_leave_idle() {
        let mut schedule = schedule();
        assert!((0..3).all(|_| schedule.demand(VERSION)));
        assert_eq!(schedule.next(), Some(Instant::ZERO));
        // No poll has come yet: none is made late.
        assert!((0..3).all(|_| schedule.due(ms(0)) == Some(VERSION)));
        assert_eq!(schedule.due(ms(0)), Some(SD1));
        assert!((0..2).all(|_| schedule.demand(VERSION)));
        let turns = [12, 12, 12, 12].map(|at| schedule.due(ms(at)));
        assert_eq!(turns, [Some(SO1), Some(VERSION), Some(VERSION), None]);
    }

    #[test]
    fn where_polls_leave_no_idle_wire_one_demand_in_two_rounds_is_served() {
        let mut schedule = Schedule::<2>::new();
        for turn in [SD1, SO1] {
            assert!(schedule.poll(ms(0), Duration::from_millis(10), turn));
        }
        assert!(schedule.due(ms(0)).is_some() && schedule.due(ms(0)).is_some());
        assert!((0..8).all(|_| schedule.demand(VERSION)));
        // Every transaction takes 20 ms: both polls are always due.
        let turns: std::vec::Vec<_> = (1..=10).filter_map(|n| schedule.due(ms(20 * n))).collect();
        assert_eq!(turns, [SD1, SO1, SD1, SO1, VERSION, SD1, SO1, SD1, SO1, VERSION]);
    }

    #[test]
    fn no_demand_makes_a_poll_late_by_more_than_one_transaction() {
        // Three polls that use half of the wire, 3 ms each, and as many demands of 5 ms as there is room for.
        let periods = [10, 20, 40].map(Duration::from_millis);
        let run = |demands: bool| {
            let mut schedule = Schedule::<3>::new();
            for (n, period) in (0_u8..).zip(periods) {
                assert!(schedule.poll(ms(0), period, Turn { to: n, instruction: 1 }));
            }
            assert!(schedule.due(ms(0)).is_some());
            let (mut now, mut served) = (ms(0), [(); 3].map(|()| std::vec::Vec::new()));
            while now < ms(10_000) {
                while demands && schedule.demand(VERSION) {}
                let lasts = match schedule.due(now) {
                    Some(VERSION) => 5,
                    Some(turn) => {
                        served[usize::from(turn.to)].push(now);
                        3
                    }
                    None => 1,
                };
                now += Duration::from_millis(lasts);
            }
            served
        };
        for ((alone, beside), rate) in run(false).into_iter().zip(run(true)).zip([999, 500, 250]) {
            assert_eq!((alone.len(), beside.len()), (rate, rate));
            let late = alone.iter().zip(&beside).map(|(alone, beside)| beside.since(*alone)).max();
            assert!(late.is_some_and(|late| late <= Duration::from_millis(5)), "{late:?}");
        }
    }

    #[test]
    fn of_a_lost_node_with_two_polls_one_probes() {
        let mut schedule = schedule();
        assert!(schedule.poll(ms(0), Duration::from_millis(50), Turn { instruction: 2, ..SO1 }));
        schedule.lost(ms(0), SO1.to);
        let asked = (0..5000).filter(|now| schedule.due(ms(*now)).is_some_and(|turn| turn.to == SO1.to)).count();
        assert_eq!(asked, 4);
        schedule.back(ms(5000), SO1.to);
        let asked = (5000..6000).filter(|now| schedule.due(ms(*now)).is_some_and(|turn| turn.to == SO1.to)).count();
        assert_eq!(asked, 9 + 19);
    }

    #[test]
    fn a_changed_period_begins_at_once_and_of_a_lost_node_when_it_is_back() {
        let asked = |schedule: &mut Schedule<4>, from: u64, to: u64| {
            (from..to)
                .filter(|now| schedule.due(ms(*now)).is_some_and(|turn| turn == SD1))
                .collect::<std::vec::Vec<_>>()
        };
        let mut schedule = schedule();
        assert_eq!(asked(&mut schedule, 0, 300), [0, 250]);
        schedule.set_period(ms(300), SD1, Duration::from_millis(50));
        assert_eq!(asked(&mut schedule, 300, 500), [300, 350, 400, 450]);
        schedule.set_period(ms(500), SD1, Duration::from_millis(250));
        assert_eq!(asked(&mut schedule, 500, 1200), [500, 750, 1000]);
        schedule.lost(ms(1200), SD1.to);
        schedule.set_period(ms(1200), SD1, Duration::from_millis(50));
        assert_eq!(asked(&mut schedule, 1200, 4000), [2200, 3200]);
        schedule.back(ms(4000), SD1.to);
        assert_eq!(asked(&mut schedule, 4000, 4200), [4050, 4100, 4150]);
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
