//! Dead-reckoned trajectory of the last seconds.

use base::{Duration, Instant};
use navitools::{Motion, Pose};
use std::collections::VecDeque;

/// Length of the trail.
const TRAIL: Duration = Duration::from_secs(8);

/// A dead-reckoned pose in an arbitrary frame, with accumulated variances.
#[derive(Clone, Copy, Debug, Default)]
pub struct TrailPose {
    pub at: Instant,
    pub pose: Pose,
    /// Variance along the path, m².
    pub along: f64,
    /// Variance of the heading, rad².
    pub turn: f64,
}

/// Greatest difference between a bearing's time stamp and its instant, s: it lies outside any trail and history.
const SHIFT_MAX: f64 = 60.0;

/// The instant `seconds` after `at`, or before it if negative. The filter's state may hold any number: the shift is
/// limited, and none for one that is not a number.
pub fn shifted(at: Instant, seconds: f64) -> Instant {
    let limited = if seconds.is_nan() { 0.0 } else { seconds.clamp(-SHIFT_MAX, SHIFT_MAX) };
    let by = Duration::from_secs_f64(limited.abs());
    if limited >= 0.0 { at + by } else { at - by }
}

/// Pose after a way whose direction of travel is `drift` in the robot's frame, rad.
pub fn pose_along(pose: Pose, way: Motion, drift: f64) -> Pose {
    let end = Pose { theta: pose.theta + drift, ..pose }.along(way);
    Pose { theta: end.theta + -drift, ..end }
}

/// Poses in order of time.
#[derive(Debug, Default)]
pub struct Trail(VecDeque<TrailPose>);

impl Trail {
    /// Appends a motion step up to `at`, in the direction `drift`, with its variances along it and of the heading.
    pub fn push(&mut self, at: Instant, way: Motion, drift: f64, (along, turn): (f64, f64)) {
        let last = self.last();
        let pose = pose_along(last.pose, way, drift);
        self.0.push_back(TrailPose { at, pose, along: last.along + along, turn: last.turn + turn });
        while self.0.front().is_some_and(|first| at.since(first.at) > TRAIL) {
            self.0.pop_front();
        }
    }

    /// Newest pose.
    pub fn last(&self) -> TrailPose {
        self.0.back().copied().unwrap_or_default()
    }

    /// Interpolated pose at `at`; `None` outside the trail.
    pub fn at(&self, at: Instant) -> Option<TrailPose> {
        let after = self.0.partition_point(|place| place.at < at);
        let (end, begin) = (self.0.get(after)?, self.0.get(after.checked_sub(1)?)?);
        let part = at.since(begin.at).as_secs_f64() / end.at.since(begin.at).as_secs_f64();
        let between = |begin: f64, end: f64| begin + part * (end - begin);
        // Steps are short: chord and arc are equal.
        let turned = (end.pose.theta - begin.pose.theta).radians() * part;
        let (x, y) = (between(begin.pose.x, end.pose.x), between(begin.pose.y, end.pose.y));
        let pose = Pose { x, y, theta: begin.pose.theta + turned };
        Some(TrailPose { at, pose, along: between(begin.along, end.along), turn: between(begin.turn, end.turn) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_number_of_seconds_is_too_much() {
        let at = Instant::from_millis(100_000);
        assert_eq!(shifted(at, 0.25), Instant::from_millis(100_250));
        assert_eq!(shifted(at, -0.25), Instant::from_millis(99_750));
        let limits = [Instant::from_millis(160_000), Instant::from_millis(40_000)];
        for huge in [60.0, 1e19, 1e300, f64::MAX, f64::INFINITY] {
            assert_eq!([huge, -huge].map(|seconds| shifted(at, seconds)), limits, "{huge}");
        }
        assert_eq!(shifted(at, f64::NAN), at);
        assert_eq!(shifted(Instant::ZERO, -1e300), Instant::ZERO);
    }
}
