//! The way of the last seconds by odometry alone.

use base::{Duration, Instant};
use navitools::{Motion, Pose};
use std::collections::VecDeque;

/// What is older is forgotten.
const KEPT: Duration = Duration::from_secs(8);

/// Where odometry alone was, from anywhere, and how its variances added up.
#[derive(Clone, Copy, Debug, Default)]
pub struct Place {
    pub at: Instant,
    pub pose: Pose,
    /// m².
    pub along: f64,
    /// rad².
    pub turn: f64,
}

/// The last places.
#[derive(Debug, Default)]
pub struct Trail(VecDeque<Place>);

impl Trail {
    /// Goes on to `at` by a way with these variances.
    pub fn push(&mut self, at: Instant, way: Motion, along: f64, turn: f64) {
        let last = self.last();
        let pose = last.pose.along(way);
        self.0.push_back(Place { at, pose, along: last.along + along, turn: last.turn + turn });
        while self.0.front().is_some_and(|first| at.since(first.at) > KEPT) {
            self.0.pop_front();
        }
    }

    /// Where it ends.
    pub fn last(&self) -> Place {
        self.0.back().copied().unwrap_or_default()
    }

    /// Where it was; `None` beyond its ends.
    pub fn at(&self, at: Instant) -> Option<Place> {
        let after = self.0.partition_point(|place| place.at < at);
        let (end, begin) = (self.0.get(after)?, self.0.get(after.checked_sub(1)?)?);
        let part = at.since(begin.at).as_secs_f64() / end.at.since(begin.at).as_secs_f64();
        let between = |begin: f64, end: f64| begin + part * (end - begin);
        // A step is short: its chord is its arc.
        let turned = (end.pose.theta - begin.pose.theta).radians() * part;
        let (x, y) = (between(begin.pose.x, end.pose.x), between(begin.pose.y, end.pose.y));
        let pose = Pose { x, y, theta: begin.pose.theta + turned };
        Some(Place { at, pose, along: between(begin.along, end.along), turn: between(begin.turn, end.turn) })
    }
}
