//! Wheels that contradict each other: no motion of the base has all the speeds that they measure.
//!
//! Only a base with more wheels than independent motions can tell: four mecanum wheels, or two axles of a skid-steer
//! base. A wheel is named only where the geometry decides which one is wrong ([`Chassis::agreement`](kinematics::Chassis)).

use super::Canbus;
use super::body::Measured;
use base::{Duration, Fault, Instant, Severity};
use kinematics::Agreement;
use module::Actions;

/// Root mean square of the residuals that is always tolerated, m/s: of four mecanum wheels one that is 0.08 m/s off.
const RESIDUAL_MPS: f64 = 0.02;
/// The same as a part of the fastest wheel's speed: wheels slip, and differ in diameter.
const RESIDUAL_PART: f64 = 0.05;
/// How long the residual must be greater: wheels are not measured at the same instant.
const LONG: Duration = Duration::from_millis(300);

/// The watch over the residual.
#[derive(Debug, Default)]
pub(super) struct AgreementWatch {
    /// Since when it has been too great.
    since: Option<Instant>,
    /// It stops the robot until this stands.
    pub(super) stops: bool,
}

impl AgreementWatch {
    /// Takes a measurement: the residual and what is tolerated, m/s. True once the wheels have disagreed for too long.
    fn measure(&mut self, now: Instant, residual: f64, tolerance: f64) -> bool {
        // NaN: a wheel is not known, which others judge.
        if residual.is_nan() || residual <= tolerance {
            self.since = None;
            return false;
        }
        now.since(*self.since.get_or_insert(now)) >= LONG
    }
}

impl Canbus {
    /// Judges the measured speeds of all wheels together; to be called after each decision.
    pub(super) fn watch_agreement(&mut self, now: Instant, out: &mut Actions) {
        if !self.body.is_redundant() {
            return;
        }
        if self.agreement.stops && self.is_standing() {
            self.agreement = AgreementWatch::default();
            out.clear(Fault::WheelsDisagree, "", "the robot stands");
        }
        let wheels = self.wheels.measured();
        let Measured { residual, .. } = self.measured();
        let fastest = wheels.iter().map(|wheel| wheel.speed_mps.abs()).fold(0.0, f64::max);
        let tolerance = RESIDUAL_MPS.max(RESIDUAL_PART * fastest);
        let known = self.wheels.iter().all(|wheel| wheel.is_known(now));
        let disagree = self.agreement.measure(now, if known { residual } else { f64::NAN }, tolerance);
        if disagree && !self.agreement.stops {
            self.agreement.stops = true;
            let name = |wheel: usize| self.wheels.iter().nth(wheel).map_or("", |wheel| wheel.axis.name());
            let who = match self.body.agreement(&wheels, tolerance) {
                Some(Agreement::Wheel(wheel)) => format!("{} contradicts the other wheels", name(wheel)),
                Some(Agreement::Swapped(one, other)) => format!("{} and {} are exchanged", name(one), name(other)),
                _ => "no motion of the base has the speeds of its wheels".into(),
            };
            let what = format!("{who}, by {residual:.2} m/s (root mean square): the robot stops");
            out.raise(Severity::Error, Fault::WheelsDisagree, "", what);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(millis)
    }

    #[test]
    fn a_residual_counts_once_it_has_lasted() {
        let mut watch = AgreementWatch::default();
        assert!(!watch.measure(at(0), 0.03, 0.02));
        assert!(!watch.measure(at(299), 0.03, 0.02));
        assert!(watch.measure(at(300), 0.03, 0.02));
    }

    #[test]
    fn one_agreement_or_an_unknown_wheel_begins_anew() {
        let mut watch = AgreementWatch::default();
        for residual in [0.02, f64::NAN] {
            watch.measure(at(0), 0.03, 0.02);
            assert!(!watch.measure(at(200), residual, 0.02));
            assert!(!watch.measure(at(400), 0.03, 0.02));
            assert!(!watch.measure(at(699), 0.03, 0.02));
            assert!(watch.measure(at(700), 0.03, 0.02));
        }
    }
}
