//! Rejected input, counted by cause: each cause is reported once, and its end once.

use base::{Duration, Fault, Instant};
use std::collections::BTreeMap;

/// A cause ends after this time without further occurrence.
pub const CAUSE_END: Duration = Duration::from_secs(60);
/// Maximum number of causes at a time; further ones are not reported.
const CAUSES_MAX: usize = 64;

/// Counts of rejected input, by cause.
#[derive(Debug, Default)]
pub struct BadInput {
    causes: BTreeMap<(Fault, String), Cause>,
}

#[derive(Clone, Copy, Debug)]
struct Cause {
    count: u64,
    last: Instant,
}

impl BadInput {
    /// Counts `more` occurrences of a cause; true if the cause is to be reported.
    pub fn count(&mut self, now: Instant, fault: Fault, subject: &str, more: u64) -> bool {
        let cause = (fault, subject.to_owned());
        if let Some(known) = self.causes.get_mut(&cause) {
            *known = Cause { count: known.count + more, last: now };
            return false;
        }
        let room = self.causes.len() < CAUSES_MAX;
        if room {
            self.causes.insert(cause, Cause { count: more, last: now });
        }
        room
    }

    /// Removes and returns a cause that has ended, with its number of occurrences.
    pub fn take_ended(&mut self, now: Instant) -> Option<(Fault, String, u64)> {
        let over = self.causes.iter().find(|(_, cause)| now.since(cause.last) >= CAUSE_END)?.0.clone();
        let cause = self.causes.remove(&over)?;
        Some((over.0, over.1, cause.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: u64) -> Instant {
        Instant::from_millis(seconds * 1000)
    }

    const BAD: Fault = Fault::MessageMalformed;

    #[test]
    fn a_cause_is_reported_once_counted_and_ends_after_a_minute_without_it() {
        let mut bad = BadInput::default();
        assert!(bad.count(at(1), BAD, "can.main", 1));
        assert!((2..=100).all(|second| !bad.count(at(second), BAD, "can.main", 1)));
        assert!(bad.count(at(100), BAD, "CM_CMD_STATE Fingerprint", 7), "another cause");
        assert!(bad.count(at(150), Fault::PortOverrun, "can.main", 1), "another fault");
        assert_eq!(bad.take_ended(at(159)), None);
        assert_eq!(bad.take_ended(at(160)), Some((BAD, "CM_CMD_STATE Fingerprint".into(), 7)));
        assert_eq!(bad.take_ended(at(160)), Some((BAD, "can.main".into(), 100)));
        assert_eq!(bad.take_ended(at(160)), None);
        assert!(bad.count(at(161), BAD, "can.main", 1), "reported again");
    }

    #[test]
    fn causes_are_bounded() {
        let mut bad = BadInput::default();
        let told = (0..1000).filter(|n| bad.count(at(1), BAD, &n.to_string(), 1)).count();
        assert_eq!((told, bad.causes.len()), (CAUSES_MAX, CAUSES_MAX));
    }
}
