//! Punctuality of the watchdog's own checks.
//!
//! A check that comes late finds old heartbeats, whether the module hangs or the whole machine stood still. So the
//! delay of a check is not charged to the modules, but only once a second: otherwise a watchdog that is late at every
//! check would never find a hang in time. From the second late check on, a thread that a late check finds silent for
//! the first time is judged by the next check: after a standstill of the machine the thread has then had one period to
//! run.

use base::{Duration, Instant};

/// Period of the checks.
pub const PERIOD: Duration = Duration::from_millis(20);
/// Delay from which a check counts as late. A smaller delay does not excuse silent threads.
pub const LATE_MIN: Duration = Duration::from_millis(100);
/// Period within which one delay is forgiven.
const FORGIVEN_PERIOD: Duration = Duration::from_secs(1);

/// Times of the checks.
#[derive(Debug)]
pub struct Punctuality {
    last: Instant,
    forgiven: Option<Instant>,
}

/// One check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Check {
    /// Delay beyond [`PERIOD`]; zero if it is below [`LATE_MIN`].
    pub late: Duration,
    /// Part of it that is not charged to the modules.
    pub forgiven: Duration,
}

impl Punctuality {
    /// Starts with a check at `now`.
    #[must_use]
    pub fn new(now: Instant) -> Self {
        Self { last: now, forgiven: None }
    }

    /// The checks begin again at `now`: there was nothing to check.
    pub fn resume(&mut self, now: Instant) {
        self.last = now;
    }

    /// Counts a check at `now`.
    pub fn check(&mut self, now: Instant) -> Check {
        let late = now.since(self.last + PERIOD);
        self.last = now;
        if late < LATE_MIN {
            return Check { late: Duration::ZERO, forgiven: Duration::ZERO };
        }
        let forgive = self.forgiven.is_none_or(|before| now.since(before) >= FORGIVEN_PERIOD);
        if forgive {
            self.forgiven = Some(now);
        }
        Check { late, forgiven: if forgive { late } else { Duration::ZERO } }
    }
}

impl Check {
    /// True if a silent thread of a module is to be reported. `before`: the previous check found the module silent;
    /// updated.
    pub fn reports(self, silent: bool, before: &mut bool) -> bool {
        let known = std::mem::replace(before, silent);
        silent && (known || self.late == Duration::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beats::{HeartbeatPage, PageReader, Reading};
    use crate::processes::LATE_AFTER;

    /// Timeout of `modules.toml`.
    const BEAT_TIMEOUT: Duration = Duration::from_millis(200);

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    /// Longest time, ms, from a hang to its detection by a watchdog whose checks are each late by `late` ms. `None`: a
    /// hang was not found within 5 s, or a working module was reported.
    fn longest(late: u64) -> Option<u64> {
        let path = std::env::temp_dir().join(format!("advee-punctuality-{late}-{}", std::process::id()));
        let period = PERIOD.as_millis() as u64 + late;
        let mut longest = 0;
        // Every phase of the hang, also within the period of forgiveness.
        for hang in (1000..2300).step_by(7) {
            let mut page = PageReader::create(&path, false).unwrap();
            let mut beat = HeartbeatPage::at(&path).unwrap().thread(at(0), "main").unwrap();
            let (mut punctuality, mut silent) = (Punctuality::new(at(0)), false);
            let found = (1..7300).find(|ms| {
                if *ms < hang {
                    beat.beat(at(*ms));
                }
                if ms % period != 0 {
                    return false;
                }
                let now = at(*ms);
                let check = punctuality.check(now);
                let Reading::Oldest { last, .. } = page.read(now, std::process::id(), check.forgiven) else {
                    return false;
                };
                check.reports(now.since(last) >= LATE_AFTER, &mut silent) && now.since(last) >= BEAT_TIMEOUT
            });
            longest = longest.max(found?.checked_sub(hang)?);
        }
        std::fs::remove_file(path).unwrap();
        Some(longest)
    }

    #[test]
    fn a_hang_is_found_by_a_watchdog_that_is_late_at_every_check() {
        // ms, as in docs/beats.md. With every late check forgiven, delays of 100, 150 and 200 ms led to 1.3, 1.9 and
        // 2.4 s.
        for (late, within) in [(0, 200), (30, 240), (80, 280), (99, 345), (100, 435), (150, 670), (200, 860)] {
            let longest = longest(late).unwrap();
            assert!(longest <= within, "late by {late} ms: a hang is found after {longest} ms");
        }
    }

    #[test]
    fn one_delay_a_second_is_forgiven() {
        let mut punctuality = Punctuality::new(at(0));
        let mut check = |ms| {
            let Check { late, forgiven } = punctuality.check(at(ms));
            (late.as_millis(), forgiven.as_millis())
        };
        assert_eq!(check(119), (0, 0));
        assert_eq!(check(239), (100, 100));
        assert_eq!(check(259), (0, 0));
        assert_eq!(check(500), (221, 0));
        assert_eq!(check(1239), (719, 719));
    }

    #[test]
    fn a_module_gets_a_period_after_a_standstill_of_the_machine() {
        let standstill = Check { late: Duration::from_millis(300), forgiven: Duration::ZERO };
        let on_time = Check { late: Duration::ZERO, forgiven: Duration::ZERO };
        let mut silent = false;
        assert!(!standstill.reports(true, &mut silent));
        assert!(on_time.reports(true, &mut silent), "it has not continued");
        let mut silent = false;
        assert!(!standstill.reports(true, &mut silent));
        assert!(!on_time.reports(false, &mut silent), "it has continued");
        assert!(!standstill.reports(true, &mut silent));
        assert!(standstill.reports(true, &mut silent));
    }
}
