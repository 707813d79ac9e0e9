//! What the tests of both kinds of sensors share.

use super::Rules;
use base::Duration;

/// Rules of a usual robot.
pub const RULES: Rules = Rules {
    reach: 2.5,
    uncertainty: 0.05,
    age_max: Duration::from_millis(800),
    readings: 3,
    window: Duration::from_secs(1),
    evaluations: 2,
    scan_age_max: Duration::from_millis(300),
};
