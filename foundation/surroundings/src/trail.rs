//! Where the robot was a moment ago: dead reckoning by the measured motion, for as long as a reading counts.

use base::{Duration, Instant};
use kinematics::Twist;
use navitools::{Motion, Pose};
use std::collections::VecDeque;

/// Poses kept: more than a window of [`Rules::window`](crate::Rules) at the rate of the measured motion.
const POSES_MAX: usize = 256;
/// Distance from the start up to which a pose keeps its metres, m: no robot comes so far.
const AWAY_MAX_M: f64 = 1e6;

/// Poses of the last moments, in a frame in which the robot started.
#[derive(Debug, Default)]
pub struct Trail {
    poses: VecDeque<(Instant, Pose)>,
    velocity: Twist,
    now: Pose,
    at: Instant,
}

impl Trail {
    /// Moves on to `at` with the velocity so far, then continues with `velocity`.
    pub fn on_motion(&mut self, at: Instant, velocity: Twist, kept_for: Duration) {
        self.now = self.pose(at);
        (self.at, self.velocity) = (at, velocity);
        while self.poses.len() >= POSES_MAX || self.poses.get(1).is_some_and(|(old, _)| at.since(*old) > kept_for) {
            self.poses.pop_front();
        }
        self.poses.push_back((at, self.now));
    }

    /// False if the poses mean nothing any more: one is not a number, or so far away that its metres are lost in the
    /// rounding.
    #[must_use]
    pub fn is_sane(&self) -> bool {
        let Pose { x, y, theta } = self.now;
        x.abs() <= AWAY_MAX_M && y.abs() <= AWAY_MAX_M && theta.radians().is_finite()
    }

    /// Pose at an instant: after the last measurement, extrapolated with the present velocity; between two poses,
    /// interpolated; earlier, the oldest one.
    #[must_use]
    pub fn pose(&self, at: Instant) -> Pose {
        if at >= self.at {
            return moved(self.now, self.velocity, at.since(self.at));
        }
        let after = self.poses.partition_point(|(time, _)| *time <= at);
        match (after.checked_sub(1).and_then(|n| self.poses.get(n)), self.poses.get(after)) {
            (Some((from, before)), Some((to, after))) => {
                let part = at.since(*from).as_secs_f64() / to.since(*from).as_secs_f64().max(1e-9);
                let way = before.inverse() * *after;
                *before * Pose::new(way.x * part, way.y * part, way.theta.radians() * part)
            }
            (Some((_, pose)), None) | (None, Some((_, pose))) => *pose,
            (None, None) => self.now,
        }
    }
}

fn moved(pose: Pose, velocity: Twist, time: Duration) -> Pose {
    let time = time.as_secs_f64();
    let along = pose.along(Motion { translation: velocity.vx * time, rotation: velocity.omega * time });
    // Sideways motion along the chord: a base that slides does so for some ms between two measurements.
    let (sin, cos) = (pose.theta + velocity.omega * time / 2.0).sin_cos();
    let side = velocity.vy * time;
    Pose { x: along.x - side * sin, y: along.y + side * cos, theta: along.theta }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    #[test]
    fn a_moment_ago_the_robot_was_behind() {
        let mut trail = Trail::default();
        for n in 0..40 {
            trail.on_motion(ms(n * 50), Twist { vx: 0.5, vy: 0.0, omega: 0.0 }, Duration::from_secs(1));
        }
        let x = |at| trail.pose(ms(at)).x;
        assert!((x(2000) - 1.0).abs() < 1e-9 && (x(1525) - 0.7625).abs() < 1e-9, "{} {}", x(2000), x(1525));
        assert!((x(0) - x(900)).abs() < 0.05, "older than a second: the oldest one that is known");
    }

    #[test]
    fn a_base_that_slides_is_followed() {
        let mut trail = Trail::default();
        trail.on_motion(ms(0), Twist { vx: 0.0, vy: 0.4, omega: 0.0 }, Duration::from_secs(1));
        trail.on_motion(ms(500), Twist::default(), Duration::from_secs(1));
        assert!((trail.pose(ms(600)).y - 0.2).abs() < 1e-12);
    }
}
