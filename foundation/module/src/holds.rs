//! `LL_DATA_HOLD` of a module: the causes for which it does not act, each with its begin, published at 5 Hz and on
//! change.

use crate::Actions;
use base::{Duration, Instant, Ticker};
use messages::{Hold, lowlevel};

/// Period of the list, which is also published at every change.
const PUBLISH_PERIOD: Duration = Duration::from_millis(200);

/// An active cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActiveHold<'a> {
    /// Kind of cause.
    pub hold: Hold,
    /// Drive, bus, module, source or waypoint concerned; empty for a cause without a subject.
    pub subject: &'a str,
    /// Active until a person acts.
    pub latched: bool,
}

impl<'a> ActiveHold<'a> {
    /// Creates a cause about a subject, latched if its kind is.
    #[must_use]
    pub const fn new(hold: Hold, subject: &'a str) -> Self {
        Self { hold, subject, latched: hold.is_latched() }
    }
}

/// Last published list.
#[derive(Debug)]
pub struct Holds {
    list: Vec<lowlevel::Hold>,
    ticker: Ticker,
}

impl Default for Holds {
    fn default() -> Self {
        Self { list: Vec::new(), ticker: Ticker::new(Instant::NEVER, PUBLISH_PERIOD) }
    }
}

impl Holds {
    /// Starts the periodic publication at `now`.
    pub fn start(&mut self, now: Instant) {
        self.ticker = Ticker::new(now, PUBLISH_PERIOD);
    }

    /// Deadline of the next list, changed or not.
    #[must_use]
    pub fn next(&self) -> Instant {
        self.ticker.next()
    }

    /// Publishes the causes at `now`, main one first, if they changed or the list is due. A cause keeps its `since` as
    /// long as it is active with the same subject. Allocates only when it publishes. True if it did.
    pub fn publish<'a>(
        &mut self,
        now: Instant,
        module: &str,
        causes: impl Iterator<Item = ActiveHold<'a>> + Clone,
        out: &mut Actions,
    ) -> bool {
        let told = self.list.iter().map(|told| (told.code, told.subject.as_str(), told.latched));
        let changed = !causes.clone().map(|cause| (cause.hold.code(), cause.subject, cause.latched)).eq(told);
        if !(self.ticker.due(now) | changed) {
            return false;
        }
        let timestamp = out.timestamp(now);
        if changed {
            let since = |cause: &ActiveHold<'_>| {
                let same = |told: &&lowlevel::Hold| told.code == cause.hold.code() && told.subject == cause.subject;
                self.list.iter().find(same).map_or(timestamp, |told| told.since)
            };
            let row = |cause: ActiveHold<'_>| lowlevel::Hold {
                code: cause.hold.code(),
                subject: cause.subject.into(),
                latched: cause.latched,
                since: since(&cause),
            };
            self.list = causes.map(row).collect();
        }
        out.publish(lowlevel::DataHold { timestamp, module: module.into(), holds: self.list.clone() });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Action;
    use messages::Message;

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    /// Published list at `at`: code, subject, latched, ms since its begin.
    fn told(holds: &mut Holds, at: u64, causes: &[ActiveHold<'_>]) -> Option<Vec<(i32, String, bool, i64)>> {
        let mut out = Actions::default();
        let published = holds.publish(ms(at), "driver_canbus", causes.iter().copied(), &mut out);
        let Some(Action::Publish(Message::LlDataHold(list))) = out.as_slice().first() else {
            assert!(!published && out.as_slice().is_empty());
            return None;
        };
        assert!(published && list.module == "driver_canbus");
        let age = |hold: &lowlevel::Hold| (list.timestamp - hold.since) / 1000;
        Some(list.holds.iter().map(|hold| (hold.code, hold.subject.clone(), hold.latched, age(hold))).collect())
    }

    #[test]
    fn a_change_is_published_at_once_and_the_list_five_times_a_second() {
        let mut holds = Holds::default();
        let bumper = [ActiveHold::new(Hold::PauseBumper, "bumper2")];
        assert_eq!(told(&mut holds, 0, &bumper), Some(vec![(111, "bumper2".into(), false, 0)]));
        assert_eq!(told(&mut holds, 1000, &bumper), None, "not started: on change only");
        holds.start(ms(1000));
        assert!(told(&mut holds, 1000, &bumper).is_some());
        let published = (1001..2001).filter(|at| told(&mut holds, *at, &bumper).is_some()).count();
        assert_eq!(published, 5);
        assert_eq!(told(&mut holds, 2001, &[]), Some(vec![]));
        assert_eq!(told(&mut holds, 2002, &[]), None);
    }

    #[test]
    fn a_cause_keeps_its_begin_until_it_ends_or_its_subject_changes() {
        let mut holds = Holds::default();
        let (bumper, drive) =
            (ActiveHold::new(Hold::PauseBumper, "bumper2"), ActiveHold::new(Hold::DriveFault, "propulsion"));
        told(&mut holds, 100, &[bumper]);
        let both = told(&mut holds, 150, &[bumper, drive]).unwrap();
        assert_eq!((both[0].3, both[1].3), (50, 0));
        let other = ActiveHold::new(Hold::PauseBumper, "bumper3");
        let both = told(&mut holds, 200, &[other, drive]).unwrap();
        assert_eq!((both[0].3, both[1].3), (0, 50));
        let latched = ActiveHold { latched: true, ..drive };
        assert_eq!(told(&mut holds, 300, &[latched]), Some(vec![(218, "propulsion".into(), true, 150)]));
        told(&mut holds, 310, &[]);
        assert_eq!(told(&mut holds, 320, &[drive]).unwrap()[0].3, 0, "a new begin");
    }
}
