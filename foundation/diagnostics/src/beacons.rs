//! Beacons as shown to people: in which state each one is for the estimate.

use base::listed;
use messages::middlelevel::BeaconUse;

/// Time without a bearing after which a beacon counts as not seen, µs: five sweeps of the scanner.
const SEEN_US: i64 = 5_000_000;

listed! {
    /// State of a beacon for the estimate.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum BeaconState {
        /// Its last bearing was accepted.
        Used = 0 => "used",
        /// Its last bearing was refused as an outlier.
        Refused = 1 => "refused",
        /// The scanner looks for it, and it has not been seen for five seconds, or never.
        Unseen = 2 => "not seen",
        /// The estimator has not selected it for the scanner.
        Unselected = 3 => "not selected",
        /// A person excluded it.
        Excluded = 4 => "excluded",
    }
}

impl BeaconState {
    /// State of a beacon in a `ML_DATA_BEACON_USE` of this timestamp, µs since the UNIX epoch.
    #[must_use]
    pub fn of(beacon: &BeaconUse, timestamp: i64) -> Self {
        match () {
            () if !beacon.permitted => Self::Excluded,
            () if !beacon.active => Self::Unselected,
            () if beacon.last <= 0 || timestamp.saturating_sub(beacon.last) > SEEN_US => Self::Unseen,
            () if beacon.fits => Self::Used,
            () => Self::Refused,
        }
    }
}

/// Residual in standard deviations; `None` without one, or with an invalid deviation.
#[must_use]
pub fn normalized_residual(beacon: &BeaconUse) -> Option<f64> {
    let normalized = beacon.residual / beacon.deviation;
    (beacon.deviation > 0.0 && normalized.is_finite()).then_some(normalized)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beacon_is_in_the_state_that_explains_most() {
        let good = BeaconUse { active: true, permitted: true, fits: true, last: 9_000_000, ..BeaconUse::default() };
        let state = |beacon: BeaconUse| BeaconState::of(&beacon, 10_000_000);
        assert_eq!(state(good.clone()), BeaconState::Used);
        assert_eq!(state(BeaconUse { fits: false, ..good.clone() }), BeaconState::Refused);
        assert_eq!(state(BeaconUse { last: 4_000_000, ..good.clone() }), BeaconState::Unseen);
        assert_eq!(state(BeaconUse { last: 0, ..good.clone() }), BeaconState::Unseen);
        assert_eq!(state(BeaconUse { last: i64::MIN, ..good.clone() }), BeaconState::Unseen);
        assert_eq!(state(BeaconUse { active: false, ..good.clone() }), BeaconState::Unselected);
        assert_eq!(state(BeaconUse { permitted: false, active: false, ..good }), BeaconState::Excluded);
    }

    #[test]
    fn a_residual_without_a_deviation_is_not_normalized() {
        let beacon = |residual, deviation| BeaconUse { residual, deviation, ..BeaconUse::default() };
        assert_eq!(normalized_residual(&beacon(-0.04, 0.02)), Some(-2.0));
        for (residual, deviation) in [(0.1, 0.0), (f64::NAN, 0.1), (0.1, f64::NAN), (0.1, -0.1), (f64::INFINITY, 0.1)] {
            assert_eq!(normalized_residual(&beacon(residual, deviation)), None, "{residual} {deviation}");
        }
    }
}
