//! After the hang or death of a critical module, or of the watchdog, the stop has begun within 300 ms (docs/design.md,
//! section 1.4).
//!
//! The stop has begun with an RPDO that is a quick stop or zero, or with the drive's own stop, reported by its
//! statusword or, if that is not received, visible by decreasing speed of the body. The time counts from the last one
//! of overlapping faults; a hang that ends sooner does not count. Evaluated only while a set-point moves the robot.

use super::Verdict;
use super::facts::{DELAY_MAX, Facts, SetPoint};
use base::{Duration, Instant};

/// Maximum time from hang or death to the stop.
const STOP_MAX: Duration = Duration::from_millis(300);
/// Speed below which it counts as standing, m/s.
const STANDSTILL_MPS: f64 = 0.02;
/// Minimum decrease between two samples of the body's speed, 50 ms apart, that is not due to rolling, m/s.
const DECELERATION_MIN: f64 = 0.004;

/// A required module is lost, and the robot still moves.
#[derive(Debug)]
struct Lost {
    module: Box<str>,
    at: Instant,
    /// Speed after the time was up.
    speed: Option<f64>,
}

impl Lost {
    /// Last one of the overlapping faults.
    fn counts_from(&self, now: Instant, facts: &Facts) -> Instant {
        let others = [&facts.limits.driver, &facts.limits.watchdog];
        let others = others.into_iter().filter(|name| ***name != *self.module);
        let ill = others.filter_map(|name| facts.life(name)).map(|life| life.ill(now)).max().unwrap_or_default();
        let bus = if facts.is_disturbed(now) || facts.is_cut_off(now) || facts.may_disobey(now) {
            now
        } else {
            Instant::ZERO
        };
        self.at.max(ill).max(bus).max(facts.lcm_disturbed(now).unwrap_or_default())
    }
}

/// Lost units.
#[derive(Debug)]
pub(super) struct Rule {
    lost: Option<Lost>,
    /// The last sample of the body's speed, and since which sample it decreases.
    speed: f64,
    slows: Option<Instant>,
    /// True for each wheel that last reported Operation Enabled.
    enabled: Vec<bool>,
    /// Longest time to a reported stop.
    pub worst: Option<Duration>,
}

impl Rule {
    pub fn new(wheels: usize) -> Self {
        Self { lost: None, speed: 0.0, slows: None, enabled: vec![false; wheels], worst: None }
    }

    /// A process died or hangs.
    pub fn on_lost(&mut self, now: Instant, module: &str, facts: &Facts) {
        let matters = module == facts.limits.watchdog || facts.limits.critical.iter().any(|name| *name == *module);
        let known = self.lost.as_ref().is_some_and(|lost| *lost.module == *module);
        if matters && !known && facts.set_point.speed().is_some() {
            self.lost = Some(Lost { module: module.into(), at: now, speed: None });
        }
    }

    /// A hung process continues, or the watchdog is back before its absence was detected. Does not apply to a module
    /// that died and was restarted.
    pub fn on_back(&mut self, module: &str) {
        self.lost.take_if(|lost| *lost.module == *module);
    }

    /// Processes a frame on the wire, except those to the propulsion.
    pub fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], facts: &Facts) -> Verdict {
        let Some((wheel, status)) = facts.limits.reported(id, data) else { return Ok(()) };
        // CiA 402-2, statusword: operation enabled.
        let enabled = status & 0x6F == 0x27;
        let stops = std::mem::replace(&mut self.enabled[wheel], enabled) && !enabled;
        let turns = |(other, set_point): (usize, &SetPoint)| other != wheel && set_point.speed().is_some();
        let others = facts.wheels.iter().enumerate().any(|wheel| turns(wheel) && self.enabled[wheel.0]);
        if stops && !others { self.begins(now, facts) } else { Ok(()) }
    }

    /// Processes an RPDO that does not move the robot.
    pub fn on_still(&mut self, now: Instant, facts: &Facts) -> Verdict {
        self.begins(now, facts)
    }

    /// The stop has begun, at the latest now: a drive that stops by itself reports it within the period of its
    /// statusword, and a robot that already slows down may receive the order to stand later. The body shows it earlier.
    fn begins(&mut self, now: Instant, facts: &Facts) -> Verdict {
        let Some(lost) = self.lost.take() else { return Ok(()) };
        if self.speed <= STANDSTILL_MPS {
            return Ok(());
        }
        let begun = self.slows.map_or(now, |since| since.min(now));
        let took = begun.since(lost.counts_from(now, facts));
        if took > STOP_MAX + DELAY_MAX {
            return Err(format!("{} is lost since {:?}, and the stop begins after {took:?}", lost.module, lost.at));
        }
        self.worst = self.worst.max(Some(took));
        Ok(())
    }

    /// Processes a sample of the body's speed.
    pub fn on_truth(&mut self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let before = std::mem::replace(&mut self.speed, speed.abs());
        let slows = self.speed < before - DECELERATION_MIN;
        self.slows = slows.then(|| self.slows.unwrap_or(now));
        let Some(lost) = &mut self.lost else { return Ok(()) };
        let from = lost.counts_from(now, facts);
        if from > lost.at && facts.life(&lost.module).is_some_and(super::life::Life::is_well) {
            // It returned before its loss could be detected, or its supervisor was absent.
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
