//! Parameters that can be changed while the planner runs, each within its safe range, until it restarts.

use crate::config::{Behaviour, Config, Limits};
use messages::middlelevel::{DataParameters, LiveParameter};

/// Lowest speed to which a limit can be set, m/s: above that from which a robot that was blocked starts again.
const SPEED_MIN_MPS: f64 = 0.1;
/// Greatest multiple of the configured value to which a distance can be set.
const DISTANCE_FACTOR_MAX: f64 = 2.0;
/// Greatest distance to a person who is approached, m, as in the configuration.
const APPROACH_DISTANCE_MAX_M: f64 = 2.0;
/// Range of the patience, s.
const PATIENCE_S: (f64, f64) = (0.5, 60.0);
/// Characters of an unknown name that a refusal repeats.
const QUOTED_MAX: usize = 40;

/// The parameters, in the order of `ML_DATA_PARAMETERS`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Name {
    Speed,
    SpeedReverse,
    SpeedUnseen,
    SpeedApproach,
    Margin,
    StopDistance,
    PeopleMargin,
    ApproachDistance,
    Patience,
}

impl Name {
    const ALL: [Self; 9] = [
        Self::Speed,
        Self::SpeedReverse,
        Self::SpeedUnseen,
        Self::SpeedApproach,
        Self::Margin,
        Self::StopDistance,
        Self::PeopleMargin,
        Self::ApproachDistance,
        Self::Patience,
    ];

    /// Key of `[planner]`.
    const fn key(self) -> &'static str {
        match self {
            Self::Speed => "speed_mps",
            Self::SpeedReverse => "speed_reverse_mps",
            Self::SpeedUnseen => "speed_unseen_mps",
            Self::SpeedApproach => "speed_approach_mps",
            Self::Margin => "margin_m",
            Self::StopDistance => "stop_distance_m",
            Self::PeopleMargin => "people_margin_m",
            Self::ApproachDistance => "approach_distance_m",
            Self::Patience => "patience_s",
        }
    }

    fn configured(self, limits: &Limits, behaviour: &Behaviour) -> f64 {
        match self {
            Self::Speed => limits.speed,
            Self::SpeedReverse => behaviour.speed_reverse,
            Self::SpeedUnseen => behaviour.speed_unseen,
            Self::SpeedApproach => behaviour.speed_approach,
            Self::Margin => behaviour.margin,
            Self::StopDistance => behaviour.stop_distance,
            Self::PeopleMargin => behaviour.people_margin,
            Self::ApproachDistance => behaviour.approach_distance,
            Self::Patience => behaviour.patience,
        }
    }

    /// Range: speeds are only lowered, distances to obstacles and people only raised.
    fn range(self, configured: f64) -> (f64, f64) {
        match self {
            Self::Speed | Self::SpeedReverse | Self::SpeedUnseen | Self::SpeedApproach => {
                (SPEED_MIN_MPS.min(configured), configured)
            }
            Self::Margin | Self::StopDistance | Self::PeopleMargin => (configured, DISTANCE_FACTOR_MAX * configured),
            Self::ApproachDistance => (configured, APPROACH_DISTANCE_MAX_M.max(configured)),
            Self::Patience => (PATIENCE_S.0, PATIENCE_S.1.max(configured)),
        }
    }
}

/// Values of all parameters.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Present and configured value, in the order of [`Name::ALL`].
    values: [(f64, f64); Name::ALL.len()],
}

impl Parameters {
    /// Parameters at their configured values.
    #[must_use]
    pub fn new(limits: &Limits, behaviour: &Behaviour) -> Self {
        let values = Name::ALL.map(|name| {
            let configured = name.configured(limits, behaviour);
            (configured, configured)
        });
        Self { values }
    }

    /// Changes a parameter. True if the value is another one than before.
    ///
    /// # Errors
    /// The name is unknown, or the value is not a number within the range; the text is for people.
    pub fn set(&mut self, name: &str, value: f64) -> Result<bool, String> {
        let Some(known) = Name::ALL.into_iter().find(|known| known.key() == name) else {
            let quoted: String = name.chars().filter(|c| !c.is_control()).take(QUOTED_MAX).collect();
            return Err(format!("there is no parameter {quoted:?}"));
        };
        let (present, configured) = self.values[known as usize];
        let (least, most) = known.range(configured);
        if !(least..=most).contains(&value) {
            return Err(format!("{name} {value}: not within {least} to {most}"));
        }
        self.values[known as usize] = (value, configured);
        Ok(value != present)
    }

    fn value(&self, name: Name) -> f64 {
        self.values[name as usize].0
    }

    /// Writes the values to the configuration. `approaches`: the robot drives to a person.
    pub fn apply(&self, approaches: bool, config: &mut Config) {
        let (limits, behaviour) = (&mut config.limits, &mut config.behaviour);
        limits.speed = self.value(Name::Speed);
        behaviour.speed_reverse = self.value(Name::SpeedReverse);
        behaviour.speed_unseen = self.value(Name::SpeedUnseen);
        behaviour.speed_approach = self.value(Name::SpeedApproach);
        behaviour.margin = self.value(Name::Margin);
        behaviour.stop_distance = self.value(Name::StopDistance);
        behaviour.people_margin = self.value(Name::PeopleMargin);
        behaviour.approach_distance = self.value(Name::ApproachDistance);
        behaviour.patience = self.value(Name::Patience);
        if approaches {
            limits.speed = limits.speed.min(behaviour.speed_approach);
        }
    }

    /// The parameters with their ranges.
    #[must_use]
    pub fn message(&self, timestamp: i64) -> DataParameters {
        let row = |name: Name| {
            let (value, configured) = self.values[name as usize];
            let (minimum, maximum) = name.range(configured);
            LiveParameter { name: name.key().into(), value, minimum, maximum, configured }
        };
        DataParameters { timestamp, parameters: Name::ALL.map(row).into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use settings::Section;

    const LIMITS: Limits = Limits {
        speed: 0.8,
        steering: 0.6,
        steering_rate: 0.7,
        acceleration: 0.5,
        deceleration: 0.8,
        lateral_acceleration: 0.8,
        rotation: f64::INFINITY,
    };

    fn parameters() -> Parameters {
        Parameters::new(&LIMITS, &Behaviour::usual())
    }

    #[test]
    fn numbers_lead_to_their_places() {
        assert!(Name::ALL.iter().enumerate().all(|(place, name)| *name as usize == place));
    }

    #[test]
    fn a_speed_is_only_lowered_and_a_margin_only_raised() {
        for (name, good, bad) in [
            ("speed_mps", [0.1, 0.3, 0.8], [0.099, 0.81, -1.0]),
            ("speed_approach_mps", [0.1, 0.2, 0.4], [0.0, 0.41, 1.0]),
            ("margin_m", [0.15, 0.2, 0.3], [0.14, 0.31, 0.0]),
            ("people_margin_m", [0.35, 0.5, 0.7], [0.34, 0.71, 0.0]),
            ("approach_distance_m", [1.2, 1.5, 2.0], [1.19, 2.01, 0.0]),
            ("patience_s", [0.5, 10.0, 60.0], [0.4, 61.0, -1.0]),
        ] {
            for value in good {
                assert!(parameters().set(name, value).is_ok(), "{name} {value}");
            }
            for value in bad.into_iter().chain([f64::NAN, f64::INFINITY, f64::NEG_INFINITY]) {
                let mut all = parameters();
                let before = all.message(0);
                assert!(all.set(name, value).is_err_and(|why| why.starts_with(name)), "{name} {value}");
                assert!(all.message(0) == before, "{name} {value}");
            }
        }
        let why = parameters().set("attempts\n", 3.0).unwrap_err();
        assert_eq!(why, "there is no parameter \"attempts\"");
        assert!(parameters().set(&"x".repeat(5000), 1.0).unwrap_err().len() < 100);
    }

    #[test]
    fn a_repetition_is_no_change() {
        let mut all = parameters();
        assert_eq!([0.3, 0.3, 0.8].map(|value| all.set("speed_mps", value)), [Ok(true), Ok(false), Ok(true)]);
    }

    #[test]
    fn each_parameter_has_its_key_and_is_within_its_range() {
        let DataParameters { parameters, .. } = parameters().message(7);
        let mut keys = Vec::new();
        for LiveParameter { name, value, minimum, maximum, configured } in parameters {
            assert!(value == configured && (minimum..=maximum).contains(&value), "{name}");
            keys.push(name);
        }
        let mut rows = settings::Rows::default();
        Behaviour::rows(&mut rows);
        let known = format!("{rows:?}");
        assert!(keys.iter().all(|key| known.contains(&format!("{key:?}"))), "{keys:?}: {known}");
    }
}
