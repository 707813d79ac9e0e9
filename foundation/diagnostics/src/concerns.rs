//! What is not well, whether or not it prevents motion: the second word of the status.

use crate::Model;
use base::{Duration, Instant};
use messages::common::Error;
use messages::lowlevel::Reading;
use messages::middlelevel::DataEstimate;
use serde::Serialize;

/// Maximum number of concerns.
const CONCERNS_MAX: usize = 20;
/// Charge below which the battery is low, and below which it is almost empty.
pub const CHARGE_LOW: f64 = 0.3;
/// See [`CHARGE_LOW`].
pub const CHARGE_EMPTY: f64 = 0.15;
/// Age from which a position, or the range finders, are not known: a short delay is no concern.
const UNKNOWN_AFTER: Duration = Duration::from_secs(2);

/// Weight of a concern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Weight {
    /// Work is possible with restrictions.
    Warning,
    /// Something does not work.
    Error,
}

/// Condition that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Concern {
    /// Weight.
    pub weight: Weight,
    /// For people, without a stop: `position lost`.
    pub words: String,
}

impl Model {
    /// What is not well, the most severe first; empty: all is well, as far as the robot reports it.
    #[must_use]
    pub fn concerns(&self, now: Instant) -> Vec<Concern> {
        let warning = |words: String| Concern { weight: Weight::Warning, words };
        let slow = self.slow_rate(now).filter(|rate| *rate > 0.0);
        let mut concerns: Vec<Concern> = slow.map(|rate| warning(simulation(rate))).into_iter().collect();
        concerns.extend(self.position_concern(now).map(warning));
        concerns.extend(self.ranging_concern(now).map(warning));
        for row in self.modules(now) {
            if matches!(row.phase, "down" | "ending") && row.wanted != "TERMINATE" {
                let weight = if row.critical { Weight::Error } else { Weight::Warning };
                concerns.push(Concern { weight, words: format!("{} does not run", row.module) });
            } else if row.state == "ERROR" {
                concerns.push(warning(format!("{} is in ERROR", row.module)));
            }
        }
        let active = self.errors.groups(now).into_iter().filter(|shown| shown.standing && shown.known);
        concerns.extend(active.filter(|shown| shown.severity >= Error::WARNING).map(|shown| Concern {
            weight: if shown.severity >= Error::ERROR { Weight::Error } else { Weight::Warning },
            words: if shown.message.is_empty() { shown.about() } else { shown.message.clone() },
        }));
        concerns.extend(self.power.fresh(now).filter(|power| power.charge < CHARGE_LOW).map(|power| Concern {
            weight: if power.charge < CHARGE_EMPTY { Weight::Error } else { Weight::Warning },
            words: format!("battery {:.0} %", 100.0 * power.charge.max(0.0)),
        }));
        concerns.sort_by_key(|concern| std::cmp::Reverse(concern.weight));
        concerns.truncate(CONCERNS_MAX);
        concerns
    }

    /// A robot that has never reported a position has no estimator, or it is a module that does not run.
    fn position_concern(&self, now: Instant) -> Option<String> {
        let words = match self.estimate.get()?.quality {
            _ if self.estimate.age(now) > Some(UNKNOWN_AFTER) => "position not known",
            DataEstimate::LOST | DataEstimate::SEARCHING => "position lost",
            _ => return None,
        };
        Some(words.into())
    }

    fn ranging_concern(&self, now: Instant) -> Option<String> {
        let all = &self.ranges.get()?.readings;
        if self.ranges.age(now) > Some(UNKNOWN_AFTER) {
            return Some("range finders not known".into());
        }
        let unknown = all.iter().filter(|reading| reading.status == Reading::UNKNOWN).count();
        (unknown > 0).then(|| format!("{unknown} of {} range finders do not measure", all.len()))
    }
}

fn simulation(rate: f64) -> String {
    let decimals = if rate < 0.1 { 2 } else { 1 };
    format!("simulation at {rate:.decimals$} ×")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use messages::Message;
    use messages::common::{DataFaults, Fault};
    use messages::lowlevel::{DataPower, DataRanges};

    const T0: Instant = Instant::from_millis(10_000);

    fn say(model: &mut Model, message: impl Into<Message>) {
        let message = message.into();
        model.receive(T0, &message.channel_name(), 40, Some(message));
    }

    fn words(model: &Model, now: Instant) -> Vec<String> {
        model.concerns(now).into_iter().map(|concern| concern.words).collect()
    }

    #[test]
    fn who_comes_late_is_told_all_that_is_not_well_the_most_severe_first() {
        let mut model = Model::new(Config::default());
        assert!(words(&model, T0).is_empty(), "nothing is reported yet");
        let estimate = |quality| DataEstimate { quality, ..DataEstimate::default() };
        let ranges = |status: &[i8]| DataRanges {
            readings: status.iter().map(|status| Reading { status: *status, ..Reading::default() }).collect(),
            ..DataRanges::default()
        };
        say(&mut model, estimate(DataEstimate::FINE));
        say(&mut model, ranges(&[Reading::MEASURED, Reading::SILENT]));
        assert!(words(&model, T0).is_empty());
        say(&mut model, estimate(DataEstimate::LOST));
        say(&mut model, ranges(&[Reading::MEASURED, Reading::UNKNOWN, Reading::UNKNOWN]));
        let fault =
            |number, severity, message: &str| Fault { number, severity, message: message.into(), ..Fault::default() };
        let faults = vec![
            fault(1, Error::NOTICE, "only said"),
            fault(2, Error::WARNING, "fan 1 stands still"),
            fault(3, Error::ERROR, "a board is lost"),
        ];
        say(&mut model, DataFaults { module: "driver_aux".into(), faults, ..DataFaults::default() });
        say(&mut model, DataPower { charge: 0.2, ..DataPower::default() });
        let told = [
            "a board is lost",
            "position lost",
            "2 of 3 range finders do not measure",
            "fan 1 stands still",
            "battery 20 %",
        ];
        assert_eq!(words(&model, T0), told);
        assert_eq!(model.concerns(T0)[0].weight, Weight::Error);
        // Faults are valid for 3 s; what was known of the position and the ranges is not known any more.
        let later = T0 + Duration::from_secs(4);
        assert_eq!(words(&model, later), ["position not known", "range finders not known"]);
    }
}
