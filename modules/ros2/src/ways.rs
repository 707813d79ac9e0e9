//! Way of a wheel whose drive reports a velocity alone, so that it is seen to turn.

use messages::lowlevel::DataAxes;
use std::collections::BTreeMap;

/// Longest time between two velocities over which a wheel turns on, µs.
const GAP_US: i64 = 1_000_000;
/// Axes that are kept at most.
const AXES_MAX: usize = 32;

/// Ways of axes by name.
#[derive(Clone, Debug, Default)]
pub struct Ways(BTreeMap<String, Way>);

#[derive(Clone, Copy, Debug)]
struct Way {
    timestamp: i64,
    /// m/s
    velocity: f64,
    /// m since the first velocity.
    way: f64,
}

impl Ways {
    /// Gives wheels that report no position the integral of their velocity, from 0 on.
    pub fn complete(&mut self, axes: &mut DataAxes, is_wheel: impl Fn(&str) -> bool) {
        let timestamp = axes.timestamp;
        for axis in axes.axes.iter_mut().filter(|axis| axis.position.is_nan() && axis.velocity.is_finite()) {
            if !is_wheel(&axis.name) || self.0.len() >= AXES_MAX && !self.0.contains_key(&axis.name) {
                continue;
            }
            let velocity = axis.velocity;
            let last = self.0.entry(axis.name.clone()).or_insert(Way { timestamp, velocity, way: 0.0 });
            let gap = timestamp.saturating_sub(last.timestamp);
            if (0..=GAP_US).contains(&gap) {
                last.way += (last.velocity + velocity) / 2.0 * gap as f64 / 1e6;
            }
            (last.timestamp, last.velocity) = (timestamp, velocity);
            axis.position = last.way;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::Axis;

    #[test]
    fn a_wheel_without_a_position_gets_its_way_and_a_steering_does_not() {
        let mut ways = Ways::default();
        let mut at = |ms: i64, velocity: f64, position: f64| {
            let axis = |name: &str| Axis { name: name.into(), velocity, position, ..Axis::default() };
            let timestamp = ms * 1000;
            let mut axes = DataAxes { timestamp, axes: vec![axis("left"), axis("steering")] };
            ways.complete(&mut axes, |name| name == "left");
            [axes.axes[0].position, axes.axes[1].position]
        };
        assert_eq!(at(0, 0.4, f64::NAN)[0], 0.0);
        let [left, steering] = at(500, 0.6, f64::NAN);
        assert!((left - 0.25).abs() < 1e-12 && steering.is_nan(), "{left}");
        assert_eq!(at(600, 0.6, 7.0), [7.0, 7.0], "one that is measured stays");
        let [left, _] = at(5000, 0.6, f64::NAN);
        assert!((left - 0.25).abs() < 1e-12, "nobody knows what it did meanwhile: {left}");
    }
}
