//! Whether a line is disturbed, by the messages that arrive damaged.

use crate::time::{Duration, Instant};

/// Damaged messages within this time are one disturbance, such as that of a plug that makes contact.
const APART: Duration = Duration::from_millis(100);
/// Two disturbances within this time are a disturbed line.
const WITHIN: Duration = Duration::from_millis(1000);
/// It is no longer disturbed after this time without a damaged message.
const QUIET: Duration = Duration::from_millis(1400);

/// Judges a line: it is disturbed from the second disturbance within 1 s on, each of 100 ms at most, until no message
/// has been damaged for 1.4 s.
///
/// ```
/// use base::{Disturbance, Instant};
///
/// let at = Instant::from_millis;
/// let mut line = Disturbance::default();
/// // A plug makes contact.
/// assert!((0..10).all(|n| !line.damaged(at(10 * n))));
/// // Damaged again, 600 ms later.
/// assert!(line.damaged(at(690)));
/// assert_eq!(line.poll_timeout(), Some(at(2090)));
/// assert!(line.is_disturbed(at(2089)) && !line.is_disturbed(at(2090)));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Disturbance {
    /// First and last damaged message of the last disturbance.
    last: Option<(Instant, Instant)>,
    disturbed: bool,
}

impl Disturbance {
    /// Takes note of a message that is damaged. True: the line is disturbed.
    pub fn damaged(&mut self, now: Instant) -> bool {
        let first = match self.last {
            Some((first, _)) if now.since(first) < APART => first,
            Some((_, last)) => {
                self.disturbed |= now.since(last) <= WITHIN;
                now
            }
            None => now,
        };
        self.last = Some((first, now));
        self.disturbed
    }

    /// Whether the line is disturbed at this instant.
    pub fn is_disturbed(&mut self, now: Instant) -> bool {
        self.disturbed &= self.last.is_some_and(|(_, last)| now.since(last) < QUIET);
        self.disturbed
    }

    /// When a disturbed line is none any more, unless a message is damaged meanwhile.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.last.filter(|_| self.disturbed).map(|(_, last)| last + QUIET)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disturbed(at_ms: &[u64]) -> bool {
        let mut line = Disturbance::default();
        at_ms.iter().fold(false, |_, at| line.damaged(Instant::from_millis(*at)))
    }

    #[test]
    fn one_disturbance_is_none_and_two_within_a_second_are() {
        assert!(!disturbed(&[5]) && !disturbed(&[0, 40, 99]) && disturbed(&[0, 100]) && disturbed(&[0, 50, 100]));
        assert!(disturbed(&[0, 1000]) && !disturbed(&[0, 1001]) && !disturbed(&[0, 1001, 2002, 3003]));
        // The second one counts from the end of the first one.
        assert!(disturbed(&[0, 90, 1080]));
    }

    #[test]
    fn it_ends_after_1400_ms_without_a_damaged_message_and_what_comes_then_is_the_first_one_again() {
        let mut line = Disturbance::default();
        let at = Instant::from_millis;
        assert!(!line.damaged(at(0)) && line.damaged(at(100)));
        for n in 1..100 {
            assert!(line.is_disturbed(at(100 + 1399 * n)));
            assert!(line.damaged(at(100 + 1399 * n)));
        }
        let last = 100 + 1399 * 99;
        assert!(line.is_disturbed(at(last + 1399)) && !line.is_disturbed(at(last + 1400)));
        assert_eq!(line.poll_timeout(), None);
        assert!(!line.damaged(at(last + 1500)));
    }
}
