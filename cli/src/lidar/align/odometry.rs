//! The robot's way by its measured velocities, and what may be wrong with them.

/// A measured velocity of the body, robot frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity {
    /// Time, s.
    pub at: f64,
    /// Forward, m/s.
    pub vx: f64,
    /// To the left, m/s.
    pub vy: f64,
    /// Rotation, counter-clockwise, rad/s.
    pub omega: f64,
}

impl Velocity {
    /// True while the robot stands.
    pub fn is_zero(&self) -> bool {
        self.vx.hypot(self.vy) < 0.01 && self.omega.abs() < 0.01
    }
}

/// Systematic errors of the odometry. They are estimated with the lidar's place, so as not to spoil it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// True way over measured way, less 1.
    pub travel: f64,
    /// True angle over measured angle, less 1.
    pub turn: f64,
    /// Rotation that is not measured, rad per metre forward.
    pub drift: f64,
    /// Time by which velocities are older than scans with the same time stamp, s.
    pub delay: f64,
}

/// The robot's poses, from the origin at the first velocity.
#[derive(Clone, Debug)]
pub struct Way {
    times: Vec<f64>,
    /// x, m, y, m, and heading, rad, not wrapped.
    poses: Vec<[f64; 3]>,
    delay: f64,
}

impl Way {
    /// Integrates velocities, whose times increase.
    pub fn new(velocities: &[Velocity], errors: &Errors) -> Self {
        let mut way = Self { times: Vec::new(), poses: Vec::new(), delay: errors.delay };
        let true_one = |velocity: &Velocity| {
            let travel = 1.0 + errors.travel;
            let omega = velocity.omega * (1.0 + errors.turn) + errors.drift * velocity.vx;
            [velocity.vx * travel, velocity.vy * travel, omega]
        };
        let mut pose = [0.0_f64; 3];
        for (n, velocity) in velocities.iter().enumerate() {
            if let Some(before) = n.checked_sub(1).map(|n| &velocities[n]) {
                let step = velocity.at - before.at;
                let [a, b] = [before, velocity].map(true_one);
                let [vx, vy, omega] = [0, 1, 2].map(|n| (a[n] + b[n]) / 2.0);
                let (sin, cos) = (pose[2] + omega * step / 2.0_f64).sin_cos();
                pose[0] += (vx * cos - vy * sin) * step;
                pose[1] += (vx * sin + vy * cos) * step;
                pose[2] += omega * step;
            }
            way.times.push(velocity.at);
            way.poses.push(pose);
        }
        way
    }

    /// Pose at a time, s: x, m, y, m, heading, rad, not wrapped. The first and the last pose outside of the way.
    pub fn at(&self, time: f64) -> [f64; 3] {
        let time = time + self.delay;
        let after = self.times.partition_point(|known| *known <= time);
        let (Some(before), Some(next)) = (after.checked_sub(1), self.poses.get(after)) else {
            return self.poses.get(after.min(self.poses.len().saturating_sub(1))).copied().unwrap_or_default();
        };
        let (from, to) = (self.times[before], self.times[after]);
        let part = (time - from) / (to - from).max(1e-9);
        let pose = self.poses[before];
        [0, 1, 2].map(|n| pose[n] + part * (next[n] - pose[n]))
    }

    /// True if a time lies within the way.
    pub fn covers(&self, time: f64) -> bool {
        let ends = self.times.first().zip(self.times.last());
        ends.is_some_and(|(first, last)| (*first..=*last).contains(&(time + self.delay)))
    }

    /// Largest distance between two corners of the box around the way, m, and the range of its headings, rad.
    pub fn extent(&self) -> (f64, f64) {
        let range = |n: usize| {
            let values = || self.poses.iter().map(|pose| pose[n]);
            values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min)
        };
        if self.poses.is_empty() { (0.0, 0.0) } else { (range(0).hypot(range(1)), range(2)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn a_circle_ends_where_it_began() {
        let velocities: Vec<Velocity> =
            (0..=400).map(|n| Velocity { at: f64::from(n) * 0.05, vx: 0.3, vy: 0.0, omega: PI / 10.0 }).collect();
        let way = Way::new(&velocities, &Errors::default());
        let [x, y, heading] = way.at(20.0);
        assert!(x.hypot(y) < 1e-3 && (heading - 2.0 * PI).abs() < 1e-9, "{x} {y} {heading}");
        let [x, y, _] = way.at(10.0);
        assert!(x.abs() < 1e-3 && (y - 2.0 * 3.0 / PI).abs() < 1e-3, "{x} {y}");
        let (extent, turned) = way.extent();
        assert!((extent - 1.91 * 2f64.sqrt()).abs() < 0.01 && (turned - 2.0 * PI).abs() < 1e-9);
        assert!(way.covers(0.0) && !way.covers(20.1));
    }

    #[test]
    fn errors_of_the_odometry_are_applied() {
        let velocities: Vec<Velocity> =
            (0..=40).map(|n| Velocity { at: f64::from(n) * 0.05, vx: 0.5, vy: 0.0, omega: 0.0 }).collect();
        let errors = Errors { travel: 0.02, turn: 0.0, drift: 0.1, delay: 0.1 };
        let [x, _, heading] = Way::new(&velocities, &errors).at(1.0);
        assert!((heading - 0.1 * 0.5 * 1.1).abs() < 1e-9 && (x - 0.51 * 1.1).abs() < 1e-3, "{x} {heading}");
    }
}
