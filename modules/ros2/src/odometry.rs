//! Dead reckoning in the frame `odom`, and the frame's place in the map (REP 105).

use logger::ros::Pose;
use messages::lowlevel::{DataOdo, DataVelocity};
use std::collections::VecDeque;

/// Longest time between two measurements over which the motion goes on, µs; after a longer one it begins anew at the
/// last pose.
const GAP_US: i64 = 1_000_000;
/// Longest way between two measurements, m, and rad: a longer one means that the odometry restarted.
const STEP_MAX: f64 = 5.0;
/// Poses that are kept, to find the one of an estimate that comes later than it.
const KEPT: usize = 64;

/// A pose with its velocity, as measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// µs since the UNIX epoch.
    pub timestamp: i64,
    /// In `odom`; the heading is not wrapped.
    pub pose: Pose,
    /// Velocity of the robot's origin, forward, m/s.
    pub vx: f64,
    /// To the left, m/s.
    pub vy: f64,
    /// Rotation, counter-clockwise, rad/s.
    pub omega: f64,
}

/// Dead reckoning.
#[derive(Clone, Debug, Default)]
pub struct Odometry {
    kept: VecDeque<Motion>,
    /// Integrals of the last `LL_DATA_ODO`, m and rad.
    integrals: Option<(f64, f64)>,
}

impl Odometry {
    /// By the wheels of a base that steers: way and heading.
    pub fn on_odo(&mut self, odo: &DataOdo) -> Option<Motion> {
        let finite = [odo.path, odo.heading, odo.translation, odo.rotation].iter().all(|value| value.is_finite());
        finite.then_some(())?;
        let step = self.integrals.replace((odo.path, odo.heading)).map(|(path, heading)| {
            let (way, turn) = (odo.path - path, odo.heading - heading);
            if way.abs() < STEP_MAX && turn.abs() < STEP_MAX { (way, turn) } else { (0.0, 0.0) }
        });
        let (way, turn) = step.unwrap_or_default();
        self.add(odo.timestamp, (odo.translation, 0.0, odo.rotation), |_, _| (way, 0.0, turn))
    }

    /// By the drives: a velocity, which holds since the last one.
    pub fn on_velocity(&mut self, velocity: &DataVelocity) -> Option<Motion> {
        let &DataVelocity { vx, vy, omega, .. } = velocity;
        [vx, vy, omega].iter().all(|value| value.is_finite()).then_some(())?;
        self.add(velocity.timestamp, (vx, vy, omega), |last, seconds| {
            let mean = |before: f64, now: f64| (before + now) / 2.0 * seconds;
            (mean(last.vx, vx), mean(last.vy, vy), mean(last.omega, omega))
        })
    }

    /// `step`: way forward and to the left, m, and turn, rad, since the last motion, so many seconds ago.
    fn add(
        &mut self,
        timestamp: i64,
        (vx, vy, omega): (f64, f64, f64),
        step: impl FnOnce(&Motion, f64) -> (f64, f64, f64),
    ) -> Option<Motion> {
        let mut pose = Pose::default();
        if let Some(last) = self.kept.back() {
            pose = last.pose;
            let gap = timestamp.saturating_sub(last.timestamp);
            if gap < 0 {
                // A clock that was set back: what was known before is of another time.
                self.kept.clear();
            } else if gap <= GAP_US {
                let (ahead, left, turn) = step(last, gap as f64 / 1e6);
                let (sin, cos) = libm::sincos(pose.theta + turn / 2.0);
                pose.x += ahead * cos - left * sin;
                pose.y += ahead * sin + left * cos;
                pose.theta += turn;
            }
        }
        let motion = Motion { timestamp, pose, vx, vy, omega };
        if self.kept.len() == KEPT {
            self.kept.pop_front();
        }
        self.kept.push_back(motion);
        Some(motion)
    }

    /// The pose at a time, between the poses that are kept; the nearest one before and after all.
    fn at(&self, timestamp: i64) -> Option<Pose> {
        let next = self.kept.iter().position(|motion| motion.timestamp >= timestamp);
        let (before, after) = match next {
            None => return self.kept.back().map(|last| last.pose),
            Some(0) => return self.kept.front().map(|first| first.pose),
            Some(n) => (&self.kept[n - 1], &self.kept[n]),
        };
        let since = |time: i64| time.saturating_sub(before.timestamp) as f64;
        let share = since(timestamp) / since(after.timestamp);
        let between = |a: f64, b: f64| a + (b - a) * share;
        Some(Pose {
            x: between(before.pose.x, after.pose.x),
            y: between(before.pose.y, after.pose.y),
            theta: between(before.pose.theta, after.pose.theta),
        })
    }

    /// Place of `odom` in the map by which the robot is where it is estimated to be. `None`: it has no odometry.
    #[must_use]
    pub fn in_map(&self, timestamp: i64, estimate: Pose) -> Option<Pose> {
        let own = self.at(timestamp)?;
        let theta = estimate.theta - own.theta;
        let (sin, cos) = libm::sincos(theta);
        let (x, y) = (estimate.x - (own.x * cos - own.y * sin), estimate.y - (own.x * sin + own.y * cos));
        Some(Pose { x, y, theta })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn near(a: Pose, b: Pose) {
        let off = [a.x - b.x, a.y - b.y, a.theta - b.theta];
        assert!(off.iter().all(|off| off.abs() < 0.01), "{a:?} {b:?}");
    }

    fn velocity(timestamp: i64, vx: f64, vy: f64, omega: f64) -> DataVelocity {
        DataVelocity { timestamp, vx, vy, omega, ..Default::default() }
    }

    #[test]
    fn a_circle_ends_where_it_began_by_either_message() {
        let (mut by_drives, mut by_wheels) = (Odometry::default(), Odometry::default());
        let mut ends = [Pose::default(); 2];
        for n in 0..=100 {
            let (timestamp, share) = (50_000 * n, n as f64 / 100.0);
            let omega = 2.0 * PI / 5.0;
            ends[0] = by_drives.on_velocity(&velocity(timestamp, omega, 0.0, omega)).unwrap().pose;
            let (path, heading) = (7.0 + 2.0 * PI * share, 3.0 + 2.0 * PI * share);
            let odo = DataOdo { timestamp, path, heading, translation: omega, rotation: omega, ..Default::default() };
            ends[1] = by_wheels.on_odo(&odo).unwrap().pose;
        }
        ends.into_iter().for_each(|end| near(end, Pose { x: 0.0, y: 0.0, theta: 2.0 * PI }));
    }

    #[test]
    fn to_the_side_it_goes_to_the_side() {
        let mut odometry = Odometry::default();
        for n in 0..=20 {
            odometry.on_velocity(&velocity(50_000 * n, 0.0, 0.5, 0.0));
        }
        near(odometry.at(1_000_000).unwrap(), Pose { x: 0.0, y: 0.5, theta: 0.0 });
        near(odometry.at(525_000).unwrap(), Pose { x: 0.0, y: 0.2625, theta: 0.0 });
        near(odometry.at(i64::MAX).unwrap(), Pose { x: 0.0, y: 0.5, theta: 0.0 });
        near(odometry.at(-1).unwrap(), Pose::default());
    }

    #[test]
    fn a_gap_a_restart_and_what_is_unknown_move_nothing() {
        let mut odometry = Odometry::default();
        let at = |path| DataOdo { timestamp: 0, path, ..Default::default() };
        odometry.on_odo(&at(1.0));
        odometry.on_odo(&DataOdo { timestamp: 100_000, ..at(2.0) });
        let moved = odometry.on_odo(&DataOdo { timestamp: 200_000, ..at(0.0) }).unwrap();
        near(moved.pose, Pose { x: -1.0, ..Pose::default() });
        let restarted = odometry.on_odo(&DataOdo { timestamp: 300_000, ..at(900.0) }).unwrap();
        near(restarted.pose, moved.pose);
        assert_eq!(odometry.on_odo(&DataOdo { timestamp: 400_000, ..at(f64::NAN) }), None);
        let mut odometry = Odometry::default();
        odometry.on_velocity(&velocity(0, 1.0, 0.0, 0.0));
        near(odometry.on_velocity(&velocity(5_000_000, 1.0, 0.0, 0.0)).unwrap().pose, Pose::default());
        // Nor does a clock that is set back by any amount.
        near(odometry.on_velocity(&velocity(i64::MIN, 1.0, 0.0, 0.0)).unwrap().pose, Pose::default());
        near(odometry.on_velocity(&velocity(i64::MAX, 1.0, 0.0, 0.0)).unwrap().pose, Pose::default());
        assert_eq!(odometry.on_velocity(&velocity(6_000_000, f64::NAN, 0.0, 0.0)), None);
    }

    #[test]
    fn the_map_is_where_the_estimate_puts_the_robot() {
        let mut odometry = Odometry::default();
        assert_eq!(odometry.in_map(0, Pose::default()), None);
        for n in 0..=20 {
            odometry.on_velocity(&velocity(50_000 * n, 1.0, 0.0, 0.0));
        }
        // It is at 0.5 m in odom at half the time; the map has it at 3, 4, looking to the left.
        let found = odometry.in_map(500_000, Pose { x: 3.0, y: 4.0, theta: PI / 2.0 }).unwrap();
        near(found, Pose { x: 3.0, y: 3.5, theta: PI / 2.0 });
    }
}
