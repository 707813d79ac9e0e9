//! Estimator with arbitrary motion steps and bearings.

use base::Instant;
use estimator::Filter;
use estimator::filter::{Beacon, Config};
use navitools::{Motion, Point, Pose};

/// Odometry, bearings and poses with arbitrary numbers, at any time.
///
/// Pose and covariance remain finite.
pub fn estimator(data: &[u8]) {
    let Some(input) = crate::input::<Vec<(u8, i16, f64, f64)>>(data) else { return };
    let places = [(0.1, 0.1), (19.9, 0.1), (19.9, 11.9), (0.1, 11.9)];
    let beacons = (1..).zip(places).map(|(id, (x, y))| Beacon { id, at: Point { x, y } }).collect();
    let mut filter = Filter::new(Config { beacons, ..Config::default() }).expect("a configuration that can be");
    let mut now = 10_000u64;
    for (what, ms, one, other) in input {
        now = now.saturating_add_signed(ms.into());
        let at = Instant::from_millis(now);
        let _ = match what % 8 {
            0..4 => filter.odometry(at, Motion { translation: one, rotation: other }),
            4..7 => filter.bearing(at, i32::from(what % 5), one),
            _ => filter.set(Pose::new(one, other, one), [[other, 0.0, 0.0], [0.0, other, 0.0], [0.0, 0.0, one]]),
        };
        let estimate = filter.estimate(at);
        let Pose { x, y, theta } = estimate.pose;
        assert!(x.is_finite() && y.is_finite() && theta.radians().is_finite());
        assert!(estimate.covariance.iter().flatten().all(|number| number.is_finite()));
    }
}
