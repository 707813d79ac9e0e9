//! Watch over the mode of operation: 0x6061 is read at a period while the axis is enabled, or comes in a TPDO. The mode
//! counts as wrong when it was displayed twice in a row. SDO transfers are requested as by
//! [`Switch`](super::switch::Switch).

use super::switch::Access;
use crate::{Payload, sdo};
use base::{Duration, Instant};

/// A mode other than the one asked for was displayed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WrongMode {
    /// Mode asked for.
    pub asked: i8,
    /// Mode displayed.
    pub shown: i8,
}

/// The watch over one axis.
#[derive(Clone, Debug)]
pub struct ModeWatch {
    period: Duration,
    asked: Option<i8>,
    due: Instant,
    /// A read is under way; false in it if the mode was changed meanwhile, so that its result does not count.
    pending: Option<bool>,
    /// The last display was wrong.
    doubt: bool,
    wrong: Option<WrongMode>,
}

impl ModeWatch {
    /// The mode is read once in `period`.
    #[must_use]
    pub fn new(period: Duration) -> Self {
        Self { period, asked: None, due: Instant::ZERO, pending: None, doubt: false, wrong: None }
    }

    /// The mode that the axis must be in; `None` while it is not enabled, lost, or switched to another mode.
    pub fn expect(&mut self, now: Instant, mode: Option<i8>) {
        if mode == self.asked {
            return;
        }
        (self.asked, self.due) = (mode, now + self.period);
        (self.doubt, self.wrong) = (false, None);
        self.pending = self.pending.map(|_| false);
    }

    /// Ends because the node is lost.
    pub fn lost(&mut self) {
        *self = Self::new(self.period);
    }

    /// The read that is due; its result goes to [`Self::handle_sdo`].
    pub fn poll_sdo(&mut self, now: Instant) -> Option<Access> {
        if self.asked.is_none() || self.pending.is_some() || now < self.due {
            return None;
        }
        self.pending = Some(true);
        Some(Access::Read { index: 0x6061, sub: 0 })
    }

    /// The read has ended. One that failed is repeated after the period.
    pub fn handle_sdo(&mut self, now: Instant, result: Result<Payload, sdo::Error>) {
        self.due = now + self.period;
        if self.pending.take() == Some(true)
            && let Ok(data) = result
            && let [shown] = *data
        {
            self.handle_display(now, shown as i8);
        }
    }

    /// Takes the value of 0x6061 from a TPDO.
    pub fn handle_display(&mut self, now: Instant, shown: i8) {
        let Some(asked) = self.asked else { return };
        let wrong = shown != asked;
        self.wrong = (wrong && self.doubt).then_some(WrongMode { asked, shown });
        if wrong && !self.doubt {
            // Read again at once.
            self.due = now;
        }
        self.doubt = wrong;
    }

    /// The wrong mode, while it is displayed.
    #[must_use]
    pub fn wrong(&self) -> Option<WrongMode> {
        self.wrong
    }

    /// Instant of the next [`Self::poll_sdo`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        (self.asked.is_some() && self.pending.is_none()).then_some(self.due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    /// Lets the watch read at `at`, and answers.
    fn read(watch: &mut ModeWatch, at: u64, shown: i8) {
        assert_eq!(watch.poll_sdo(ms(at)), Some(Access::Read { index: 0x6061, sub: 0 }));
        watch.handle_sdo(ms(at), Ok(shown.into()));
    }

    #[test]
    fn a_mode_that_is_wrong_twice_is_told() {
        let mut watch = ModeWatch::new(Duration::from_millis(200));
        assert_eq!((watch.poll_sdo(ms(0)), watch.poll_timeout()), (None, None));
        watch.expect(ms(0), Some(3));
        assert_eq!((watch.poll_sdo(ms(199)), watch.poll_timeout()), (None, Some(ms(200))));
        read(&mut watch, 200, 3);
        read(&mut watch, 400, -4);
        assert_eq!((watch.wrong(), watch.poll_timeout()), (None, Some(ms(400))));
        read(&mut watch, 400, -4);
        assert_eq!(watch.wrong(), Some(WrongMode { asked: 3, shown: -4 }));
        watch.handle_display(ms(500), 3);
        assert_eq!(watch.wrong(), None);
    }

    #[test]
    fn an_answer_from_before_a_switch_and_one_that_failed_do_not_count() {
        let mut watch = ModeWatch::new(Duration::from_millis(200));
        watch.expect(ms(0), Some(1));
        read(&mut watch, 200, 6);
        assert!(watch.poll_sdo(ms(200)).is_some());
        watch.expect(ms(201), None);
        watch.expect(ms(202), Some(6));
        watch.handle_sdo(ms(203), Ok(1_i8.into()));
        assert_eq!(watch.poll_sdo(ms(402)), None);
        assert!(watch.poll_sdo(ms(403)).is_some());
        watch.handle_sdo(ms(500), Err(sdo::Error::Timeout));
        assert_eq!((watch.wrong(), watch.poll_timeout()), (None, Some(ms(700))));
        read(&mut watch, 700, 6);
        watch.lost();
        assert_eq!(watch.poll_timeout(), None);
    }
}
