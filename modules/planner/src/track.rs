//! Track: a path as it is driven, with the distance, curvature and highest speed of each pose; and the steering
//! controller that keeps the robot on it.
//!
//! Forward and reverse legs meet in cusps, where the robot stops and steers first. Consecutive legs in the same
//! direction are joined. Turns on the spot and moves to the side are legs of their own, which begin and end at
//! standstill; of a turn, distance and speed are those of the farthest corner.

use crate::config::{Behaviour, Body, Limits};
use crate::path::Poses;
use kinematics::Direction;
use navitools::{Pose, wrap};

/// Highest speed on a path without the whole margin, m/s: up to it the guard widens the sides least (docs/guard.md).
const NARROW_SPEED_MPS: f64 = 0.15;
/// Distance below which two poses are at the same place, m.
const SAME_PLACE_M: f64 = 1e-3;
/// Length over which the curvature is averaged, m: the curvature of paths of arcs and lines has steps, which steering
/// cannot follow.
const CURVATURE_WINDOW_M: f64 = 0.15;
/// Share of the available deceleration that is used for braking to a stop.
const DECELERATION_SHARE: f64 = 0.6;
/// Share of the steering rate that the path may require.
const STEERING_RATE_SHARE: f64 = 0.9;
/// Distance from a leg's end that counts as reached, m, and that of the farthest corner at the end of a turn.
const LEG_END_M: f64 = 0.03;
const TURN_END_M: f64 = 0.01;
/// Lowest commanded speed before an end, m/s: the drive hardly turns below it.
pub const SPEED_MIN_MPS: f64 = 0.06;
/// Remaining steering angle at which the robot starts to drive, rad.
pub const STEERED_RAD: f64 = 0.10;
/// Speed below which the robot is at standstill, m/s.
const STANDSTILL_MPS: f64 = 0.03;
/// Preview time along the path, s: the delay of the steering.
const PREVIEW_S: f64 = 0.15;

/// Pose of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Pose in the map.
    pub pose: Pose,
    /// Direction of travel to it.
    pub direction: Direction,
    /// Distance along the track from its beginning, m.
    pub distance: f64,
    /// Curvature, 1/m, positive to the left.
    pub curvature: f64,
    /// True on a path without the whole margin.
    pub narrow: bool,
    /// Highest speed here, m/s.
    pub speed: f64,
}

/// What a motion changes: of several at once that of a curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axis {
    /// Along the robot, on the curve of its steering angle.
    #[default]
    Along,
    /// To its side.
    Aside,
    /// Its heading, on the spot.
    Spot,
}

impl From<Direction> for Axis {
    fn from(direction: Direction) -> Self {
        match direction {
            Direction::Forward | Direction::Backward => Self::Along,
            Direction::Left | Direction::Right => Self::Aside,
            Direction::TurnLeft | Direction::TurnRight => Self::Spot,
        }
    }
}

/// Motion, commanded or measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Speed, m/s; negative in reverse, to the right and clockwise. On the spot that of the farthest corner.
    pub speed: f64,
    /// Steering angle, rad.
    pub steering: f64,
    /// What the speed is about.
    pub axis: Axis,
}

impl Motion {
    /// Speed along an axis, m/s.
    #[must_use]
    pub fn along(&self, axis: Axis) -> f64 {
        if self.axis == axis { self.speed } else { 0.0 }
    }
}

/// Path, and the robot's progress on it.
#[derive(Clone, Debug, Default)]
pub struct Track {
    samples: Vec<Sample>,
    /// Last passed sample.
    at: usize,
    /// Ends of the legs planned for waypoints: sample, waypoint.
    marks: Vec<(usize, usize)>,
    /// Deviation of the robot from the path: lateral, m, positive to the left, and of its heading, rad.
    error: (f64, f64),
}

impl Track {
    /// Creates a track to `waypoint`, if any, of poses with directions of travel, close enough to be joined by straight
    /// lines. A pose may occur twice at a cusp.
    #[must_use]
    pub fn new(path: &Poses, waypoint: Option<usize>, body: &Body, limits: &Limits, behaviour: &Behaviour) -> Self {
        let mut track = Self::default();
        track.extend(path, waypoint, body, limits, behaviour);
        track
    }

    /// Appends the path to the next waypoint; it begins where this one ends.
    pub fn extend(
        &mut self,
        path: &Poses,
        waypoint: Option<usize>,
        body: &Body,
        limits: &Limits,
        behaviour: &Behaviour,
    ) {
        // Samples already driven are no longer needed.
        let passed = self.at.saturating_sub(1);
        self.samples.drain(..passed);
        self.at -= passed;
        self.marks.retain_mut(|mark| {
            mark.0 = mark.0.saturating_sub(passed);
            true
        });
        let arm = body.arm();
        for &(pose, direction) in &path.poses {
            let last = self.samples.last().copied();
            let step = last.map_or(0.0, |last| match Axis::from(direction) {
                Axis::Spot => arm * (pose.theta - last.pose.theta).radians().abs(),
                _ => last.pose.point().distance(pose.point()),
            });
            let turned = last.is_none_or(|last| last.direction != direction);
            if step >= SAME_PLACE_M || turned {
                let distance = last.map_or(0.0, |last| last.distance) + step;
                let sample = Sample { pose, direction, distance, curvature: 0.0, narrow: path.narrow, speed: 0.0 };
                self.samples.push(sample);
            }
        }
        self.marks.extend(waypoint.map(|waypoint| (self.samples.len().saturating_sub(1), waypoint)));
        self.shape(body, limits, behaviour);
    }

    /// Computes curvature and speed of each sample, anew after a change of the limits.
    pub fn shape(&mut self, body: &Body, limits: &Limits, behaviour: &Behaviour) {
        let count = self.samples.len();
        let mut begin = 0;
        while begin < count {
            let end = self.leg_end(begin);
            for number in begin..=end {
                let distance = self.samples[number].distance;
                let within = |other: &usize| (self.samples[*other].distance - distance).abs() <= CURVATURE_WINDOW_M;
                let first = (begin..=number).rev().take_while(within).last().unwrap_or(number);
                let last = (number..=end).take_while(within).last().unwrap_or(number);
                let (a, b) = (self.samples[first], self.samples[last]);
                let sign = match a.direction {
                    Direction::Forward => 1.0,
                    Direction::Backward => -1.0,
                    _ => 0.0,
                };
                let turn = (b.pose.theta - a.pose.theta).radians();
                let curvature =
                    if b.distance - a.distance > SAME_PLACE_M { sign * turn / (b.distance - a.distance) } else { 0.0 };
                let most = libm::tan(limits.steering) / body.wheelbase;
                self.samples[number].curvature = curvature.clamp(-most, most);
            }
            begin = end + 1;
        }
        for number in 0..count {
            self.samples[number].speed = self.speed_at(number, body, limits, behaviour);
        }
        // Highest speed from which the robot can still brake for the next sample; ends and cusps are stops.
        for number in (0..count).rev() {
            let braked = match self.samples.get(number + 1) {
                Some(next) if next.direction == self.samples[number].direction => {
                    let step = next.distance - self.samples[number].distance;
                    libm::sqrt(next.speed * next.speed + 2.0 * DECELERATION_SHARE * limits.deceleration * step)
                }
                _ => 0.0,
            };
            let speed = &mut self.samples[number].speed;
            *speed = speed.min(braked);
        }
    }

    /// Highest speed that curvature and steering rate allow.
    fn speed_at(&self, number: usize, body: &Body, limits: &Limits, behaviour: &Behaviour) -> f64 {
        let sample = &self.samples[number];
        let straight = match sample.direction {
            Direction::Forward => limits.speed,
            Direction::TurnLeft | Direction::TurnRight => (body.arm() * limits.rotation).min(limits.speed),
            _ => behaviour.speed_reverse.min(limits.speed),
        };
        let straight = if sample.narrow { straight.min(NARROW_SPEED_MPS) } else { straight };
        let curve = libm::sqrt(limits.lateral_acceleration / sample.curvature.abs().max(1e-6));
        let curve = curve.min(limits.rotation / sample.curvature.abs().max(1e-6));
        let neighbour = |other: Option<&Sample>| other.filter(|other| other.direction == sample.direction).copied();
        let before = number.checked_sub(1).and_then(|other| neighbour(self.samples.get(other))).unwrap_or(*sample);
        let after = neighbour(self.samples.get(number + 1)).unwrap_or(*sample);
        let step = (after.distance - before.distance).max(SAME_PLACE_M);
        let steer = |sample: &Sample| libm::atan(body.wheelbase * sample.curvature);
        let steering = (steer(&after) - steer(&before)).abs() / step;
        let steered = STEERING_RATE_SHARE * limits.steering_rate / steering.max(1e-6);
        straight.min(curve).min(steered).max(SPEED_MIN_MPS)
    }

    /// Last sample of the leg that contains `number`.
    fn leg_end(&self, number: usize) -> usize {
        let direction = self.samples[number].direction;
        let same = self.samples[number..].iter().take_while(|sample| sample.direction == direction).count();
        number + same - 1
    }

    /// Samples still to be driven, beginning with the last passed one.
    #[must_use]
    pub fn ahead(&self) -> &[Sample] {
        self.samples.get(self.at..).unwrap_or_default()
    }

    /// Last pose.
    #[must_use]
    pub fn end(&self) -> Option<Pose> {
        self.samples.last().map(|sample| sample.pose)
    }

    /// Remaining length, m.
    #[must_use]
    pub fn remaining(&self) -> f64 {
        match (self.samples.get(self.at), self.samples.last()) {
            (Some(here), Some(end)) => end.distance - here.distance,
            _ => 0.0,
        }
    }

    /// Deviation of the robot from the path: lateral, m, and of its heading, rad.
    #[must_use]
    pub fn error(&self) -> (f64, f64) {
        self.error
    }

    /// Distance of the last passed sample along the track, m.
    #[must_use]
    pub fn distance(&self) -> f64 {
        self.samples.get(self.at).map_or(0.0, |sample| sample.distance)
    }

    /// Direction of travel here; without a track forwards.
    #[must_use]
    pub fn direction(&self) -> Direction {
        self.samples.get(self.at).map_or(Direction::Forward, |sample| sample.direction)
    }

    /// Waypoint whose end was passed; each is returned once.
    pub fn passed(&mut self) -> Option<usize> {
        let &(number, waypoint) = self.marks.first()?;
        // The last one is not passed but reached.
        if self.marks.len() < 2 || number > self.at {
            return None;
        }
        self.marks.remove(0);
        Some(waypoint)
    }

    /// Last waypoint of the track.
    #[must_use]
    pub fn leads_to(&self) -> Option<usize> {
        self.marks.last().map(|mark| mark.1)
    }

    /// True if the rest of the track is narrow somewhere.
    #[must_use]
    pub fn is_narrow(&self) -> bool {
        self.ahead().iter().any(|sample| sample.narrow)
    }

    /// True if the robot has reached the end of the track.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.at + 1 >= self.samples.len()
    }

    /// Advances along the path with the robot, never backwards. On a leg's last sample it waits for standstill.
    fn locate(&mut self, robot: Pose, speed: f64, body: &Body) {
        if self.samples.is_empty() {
            return;
        }
        let end = self.leg_end(self.at);
        while self.at < end {
            let next = self.samples[self.at + 1];
            let (beyond, _) = progress(next, robot, body);
            let near = if next.direction.turns() { TURN_END_M } else { LEG_END_M };
            let near = if self.at + 1 == end { near } else { 0.0 };
            if beyond < -near {
                break;
            }
            self.at += 1;
        }
        if self.at == end && end + 1 < self.samples.len() && speed.abs() < STANDSTILL_MPS {
            self.at += 1;
        }
    }

    /// Computes the command from the pose, the current motion, and the speed that other limits allow.
    pub fn follow(&mut self, robot: Pose, now: Motion, allowed: f64, body: &Body, limits: &Limits) -> Motion {
        self.locate(robot, now.speed, body);
        let Some(here) = self.samples.get(self.at).copied() else { return Motion { speed: 0.0, ..now } };
        let end = self.leg_end(self.at);
        let axis = Axis::from(here.direction);
        // The next leg begins when the last one has ended.
        let allowed = if now.axis != axis && now.speed.abs() >= STANDSTILL_MPS { 0.0 } else { allowed };
        if axis != Axis::Along {
            return self.follow_straight(robot, now, allowed, body, limits);
        }
        let now = Motion { speed: now.along(axis), ..now };
        let sign = if here.direction == Direction::Forward { 1.0 } else { -1.0 };
        // Position on the path between two samples.
        let (sin, cos) = here.pose.theta.sin_cos();
        let (dx, dy) = (robot.x - here.pose.x, robot.y - here.pose.y);
        let along = (sign * (dx * cos + dy * sin)).max(0.0);
        let distance = here.distance + along;
        let heading = here.pose.theta.radians() + here.curvature * sign * along;
        let (sin, cos) = libm::sincos(heading);
        let aside = dy * cos - dx * sin + here.curvature * along * along / 2.0;
        let turned = wrap(robot.theta.radians() - heading);
        self.error = (aside, turned);
        // Over the distance travelled, e'' = u, with u the difference of the curvatures: a spring and a damper.
        let length = 0.45 + 0.4 * now.speed.abs();
        let wanted = -sign * libm::atan(aside / length);
        let u = -2.0 * sign * (turned - wanted) / length;
        // Of a steering as of a robot that just moves, although it stands: with another angle for each it would stop to
        // steer for ever.
        let steers = limits.rotation.is_infinite();
        let slowest = if steers { SPEED_MIN_MPS } else { 0.0 };
        let ahead = distance + now.speed.abs().max(slowest) * PREVIEW_S;
        let preview =
            self.samples[self.at..=end].iter().find(|sample| sample.distance >= ahead).unwrap_or(&self.samples[end]);
        let curvature = preview.curvature + u;
        let steering = libm::atan(body.wheelbase * curvature).clamp(-limits.steering, limits.steering);
        let left = self.samples[end].distance - distance;
        let stopping = libm::sqrt(2.0 * DECELERATION_SHARE * limits.deceleration * left.max(0.0));
        let mut speed = preview.speed.max(SPEED_MIN_MPS).min(stopping.max(SPEED_MIN_MPS)).min(allowed);
        let unsteered = (steering - now.steering).abs();
        if now.speed.abs() < STANDSTILL_MPS && unsteered > STEERED_RAD {
            speed = 0.0;
        } else if unsteered > STEERED_RAD {
            speed *= (1.0 - 2.0 * (unsteered - STEERED_RAD)).max(0.3);
        }
        if self.at == end {
            speed = 0.0;
        }
        Motion { speed: sign * speed, steering, axis }
    }

    /// Command on a leg on the spot or to the side.
    fn follow_straight(&mut self, robot: Pose, now: Motion, allowed: f64, body: &Body, limits: &Limits) -> Motion {
        let (here, end) = (self.samples[self.at], self.leg_end(self.at));
        let last = self.samples[end];
        let (beyond, aside) = progress(here, robot, body);
        let left = last.distance - here.distance - beyond;
        let turned = if here.direction.turns() { 0.0 } else { (robot.theta - here.pose.theta).radians() };
        self.error = (aside, turned);
        let stopping = libm::sqrt(2.0 * DECELERATION_SHARE * limits.deceleration * left.max(0.0));
        let speed = here.speed.max(SPEED_MIN_MPS).min(stopping.max(SPEED_MIN_MPS)).min(allowed);
        let sign = if matches!(here.direction, Direction::Right | Direction::TurnRight) { -1.0 } else { 1.0 };
        let speed = if self.at == end { 0.0 } else { sign * speed };
        Motion { speed, axis: here.direction.into(), ..now }
    }

    /// About `most` points of the remaining path, x and y, including its end; for display.
    #[must_use]
    pub fn points(&self, most: usize) -> (Vec<f64>, Vec<f64>) {
        let ahead = self.ahead();
        let step = ahead.len().div_ceil(most.max(1)).max(1);
        let last = ahead.last().filter(|_| !(ahead.len() - 1).is_multiple_of(step));
        ahead.iter().step_by(step).chain(last).map(|sample| (sample.pose.x, sample.pose.y)).unzip()
    }
}

/// How far the robot is beyond a sample in its direction of travel, m, and beside it, m: to the left along the robot,
/// ahead on the way to the side. On the spot the farthest corner counts, and the distance from the place is that
/// beside it.
fn progress(sample: Sample, robot: Pose, body: &Body) -> (f64, f64) {
    let Sample { pose, direction, .. } = sample;
    let (sin, cos) = pose.theta.sin_cos();
    let (dx, dy) = (robot.x - pose.x, robot.y - pose.y);
    let (ahead, left) = (dx * cos + dy * sin, dy * cos - dx * sin);
    let turned = || body.arm() * wrap(robot.theta.radians() - pose.theta.radians());
    match direction {
        Direction::Forward => (ahead, left),
        Direction::Backward => (-ahead, left),
        Direction::Left => (left, ahead),
        Direction::Right => (-left, ahead),
        Direction::TurnLeft => (turned(), robot.point().distance(pose.point())),
        Direction::TurnRight => (-turned(), robot.point().distance(pose.point())),
    }
}
