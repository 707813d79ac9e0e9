//! After the hang or death of a critical module, or of the watchdog, the stop has begun within 300 ms (DESIGN 1.4).
//!
//! Begun: an RPDO4 that is a quick stop or zero, or the drive's own stop, told by its statusword or, where nobody hears
//! that, seen by the body's speed falling. Counted from the last of faults that overlap; a hang that is over sooner is
//! none. Judged only where a set-point moves the robot.

use super::Verdict;
use super::facts::{DELAY_MAX, Facts};
use base::{Duration, Instant};

/// From hang or death to the stop.
const STOP_MAX: Duration = Duration::from_millis(300);
/// Speed below which it counts as standing, m/s.
const STANDSTILL_MPS: f64 = 0.02;
/// Between two looks at the body, 50 ms apart, a speed that falls falls by more, even of rolling, m/s.
const DECELERATION_MIN: f64 = 0.004;

/// A module that the motion depends on is lost, and the robot moves yet.
#[derive(Debug)]
struct Lost {
    module: Box<str>,
    at: Instant,
    /// The speed after the time was up.
    speed: Option<f64>,
}

impl Lost {
    /// The last of the faults that overlap.
    fn counts_from(&self, now: Instant, facts: &Facts) -> Instant {
        let others = [&facts.limits.driver, &facts.limits.watchdog];
        let others = others.into_iter().filter(|name| ***name != *self.module);
        let ill = others.filter_map(|name| facts.life(name)).map(|life| life.ill(now)).max().unwrap_or_default();
        let bus = if facts.is_disturbed(now) || facts.is_cut_off(now) { now } else { Instant::ZERO };
        self.at.max(ill).max(bus).max(facts.lcm_disturbed(now).unwrap_or_default())
    }
}

/// Lost units.
#[derive(Debug, Default)]
pub(super) struct Rule {
    lost: Option<Lost>,
    /// True if the propulsion last reported Operation Enabled.
    enabled: bool,
    /// Longest time to a reported stop.
    pub worst: Option<Duration>,
}

impl Rule {
    /// A process died or hangs.
    pub fn on_lost(&mut self, now: Instant, module: &str, facts: &Facts) {
        let matters = module == facts.limits.watchdog || facts.limits.critical.iter().any(|name| *name == *module);
        let known = self.lost.as_ref().is_some_and(|lost| *lost.module == *module);
        if matters && !known && facts.set_point.speed().is_some() {
            self.lost = Some(Lost { module: module.into(), at: now, speed: None });
        }
    }

    /// A process that hung goes on, or the watchdog is there again before anybody missed it: a module that died and is
    /// there again is no such thing.
    pub fn on_back(&mut self, module: &str) {
        self.lost.take_if(|lost| *lost.module == *module);
    }

    /// Takes a frame that left the wire, other than those to the propulsion.
    pub fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], facts: &Facts) {
        let node = u16::from(facts.limits.propulsion);
        if (id == 0x180 + node || id == 0x480 + node)
            && let &[low, ..] = data
        {
            // CiA 402-2, statusword: operation enabled.
            let enabled = low & 0x6F == 0x27;
            if std::mem::replace(&mut self.enabled, enabled) && !enabled {
                self.on_still(now, facts);
            }
        }
    }

    /// Takes an RPDO4 that does not move the robot, or the drive's report of its own stop.
    pub fn on_still(&mut self, now: Instant, facts: &Facts) {
        if let Some(lost) = self.lost.take() {
            self.worst = self.worst.max(Some(now.since(lost.counts_from(now, facts))));
        }
    }

    /// The body was seen.
    pub fn on_truth(&mut self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let Some(lost) = &mut self.lost else { return Ok(()) };
        let from = lost.counts_from(now, facts);
        if from > lost.at && facts.life(&lost.module).is_some_and(super::life::Life::is_well) {
            // It is back before anybody could know, or who had to know was not there.
            self.lost = None;
            return Ok(());
        }
        if now <= from + STOP_MAX + DELAY_MAX {
            return Ok(());
        }
        match lost.speed.replace(speed.abs()) {
            _ if speed.abs() < STANDSTILL_MPS => self.lost = None,
            Some(before) if speed.abs() < before - DECELERATION_MIN => self.lost = None,
            Some(_) => return Err(format!("{speed:.3} m/s, and {} is lost since {:?}", lost.module, lost.at)),
            None => {}
        }
        Ok(())
    }
}
