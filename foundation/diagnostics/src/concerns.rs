//! What is not well although the robot may be driven, for people: the second half of a headline.

use crate::Model;
use base::Instant;
use messages::common::Error;
use messages::lowlevel::Reading;
use messages::middlelevel::DataEstimate;

/// Charge below which the battery is a concern.
pub const CHARGE_LOW: f64 = 0.3;
/// Charge below which it is almost empty.
pub const CHARGE_EMPTY: f64 = 0.15;

impl Model {
    /// What is not well, the most important first, in a few words each; empty if all is well. A cause that stops the
    /// robot is its status, and not listed again.
    #[must_use]
    pub fn concerns(&self, now: Instant) -> Vec<String> {
        let mut concerns = Vec::new();
        concerns.extend(self.position_concern(now));
        concerns.extend(self.sonar_concern(now));
        concerns.extend(self.module_concern(now));
        concerns.extend(self.fault_concern(now));
        if let Some(power) = self.power.fresh(now).filter(|power| power.charge < CHARGE_LOW) {
            concerns.push(format!("battery {:.0} %", 100.0 * power.charge.max(0.0)));
        }
        concerns
    }

    /// Of a robot that has an estimator.
    fn position_concern(&self, now: Instant) -> Option<String> {
        self.estimate.get()?;
        match self.estimate.fresh(now) {
            None => Some("position unknown".into()),
            Some(estimate) if estimate.quality < DataEstimate::COARSE => Some("position lost".into()),
            Some(_) => None,
        }
    }

    fn sonar_concern(&self, now: Instant) -> Option<String> {
        let sonars = self.sonar_readings(now, 0.0).filter(|sonars| !sonars.of_2011)?;
        let unknown = sonars.readings.iter().filter(|reading| reading.status == Reading::UNKNOWN).count();
        match (unknown, sonars.readings.len()) {
            (0, _) => None,
            (1, _) => Some("1 sonar does not measure".into()),
            (unknown, all) if unknown == all => Some("no sonar measures".into()),
            (unknown, _) => Some(format!("{unknown} sonars do not measure")),
        }
    }

    fn module_concern(&self, now: Instant) -> Option<String> {
        let modules = self.modules(now);
        let mut unwell = modules.iter().filter(|row| !row.well);
        let first = unwell.next()?;
        let state = if row_runs(first.phase) { first.state } else { first.phase };
        match unwell.count() {
            0 => Some(format!("{} is {state}", first.module)),
            more => Some(format!("{} is {state}, and {more} more", first.module)),
        }
    }

    fn fault_concern(&self, now: Instant) -> Option<String> {
        let active: Vec<_> =
            self.errors.groups(now).into_iter().filter(|group| group.standing && group.known).collect();
        let severe = active.iter().filter(|group| group.severity > Error::NOTICE);
        let (first, count) = (severe.clone().next()?, severe.count());
        match count {
            1 => Some(first.about()),
            count => Some(format!("{}, and {} more", first.about(), count - 1)),
        }
    }
}

fn row_runs(phase: &str) -> bool {
    ["running", "stranger"].contains(&phase)
}
