//! A path as it is driven: the poses with their way, curvature and the greatest speed at each; and the steering that
//! keeps the robot on it.
//!
//! Legs forward and legs backward meet in cusps, where the robot stops and steers first. Legs that go on in the same
//! direction are one.

use crate::config::{Body, Limits, Manners};
use navitools::Pose;

/// Poses are taken as the same place when nearer, m.
const SAME: f64 = 1e-3;
/// Curvature is judged over this way, m: paths of arcs and lines have jumps in it, which no steering follows.
const WINDOW: f64 = 0.15;
/// What braking on the way to a stop takes of the deceleration that there is.
const GENTLE: f64 = 0.6;
/// The share of the steering's rate that the path may ask for.
const RATE_SHARE: f64 = 0.9;
/// A leg's end is reached when it is nearer, m.
const LEG_END: f64 = 0.03;
/// The slowest that is commanded short of an end, m/s: slower the drive hardly turns.
const CREEP: f64 = 0.06;
/// The steering has come far enough to drive on, rad.
const STEERED: f64 = 0.10;
/// The robot stands, m/s.
const STANDING: f64 = 0.03;
/// The path is looked at ahead by the time that steering takes, s.
const PREVIEW: f64 = 0.15;

/// One pose of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Where.
    pub pose: Pose,
    /// Whether it is driven forward.
    pub forward: bool,
    /// The way to here from the path's beginning, m.
    pub way: f64,
    /// 1/m, to the left.
    pub curvature: f64,
    /// The greatest speed here, m/s.
    pub speed: f64,
}

/// What is commanded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// m/s; backwards below zero.
    pub speed: f64,
    /// rad.
    pub steering: f64,
}

/// A path, and how far the robot has come on it.
#[derive(Clone, Debug, Default)]
pub struct Track {
    samples: Vec<Sample>,
    /// The sample that the robot has passed last.
    at: usize,
    /// Ends of what was planned for a waypoint: sample, waypoint.
    marks: Vec<(usize, usize)>,
    /// Deviations of the robot from the path: to the left, m, and of its heading, rad.
    error: (f64, f64),
}

impl Track {
    /// A track to `waypoint`, if to any, of poses driven forward (or not), near enough to each other to be joined by straight
    /// lines. At a cusp the pose may stand twice.
    #[must_use]
    pub fn new(
        poses: &[(Pose, bool)],
        waypoint: Option<usize>,
        body: &Body,
        limits: &Limits,
        manners: &Manners,
    ) -> Self {
        let mut track = Self::default();
        track.extend(poses, waypoint, body, limits, manners);
        track
    }

    /// Appends the way to the next waypoint; it begins where this one ends.
    pub fn extend(
        &mut self,
        poses: &[(Pose, bool)],
        waypoint: Option<usize>,
        body: &Body,
        limits: &Limits,
        manners: &Manners,
    ) {
        // What was driven is not needed any more.
        let passed = self.at.saturating_sub(1);
        self.samples.drain(..passed);
        self.at -= passed;
        self.marks.retain_mut(|mark| {
            mark.0 = mark.0.saturating_sub(passed);
            true
        });
        for &(pose, forward) in poses {
            let last = self.samples.last().copied();
            let step = last.map_or(0.0, |last| last.pose.point().distance(pose.point()));
            let turned = last.is_none_or(|last| last.forward != forward);
            if step >= SAME || turned {
                let way = last.map_or(0.0, |last| last.way) + step;
                self.samples.push(Sample { pose, forward, way, curvature: 0.0, speed: 0.0 });
            }
        }
        self.marks.extend(waypoint.map(|waypoint| (self.samples.len().saturating_sub(1), waypoint)));
        self.shape(body, limits, manners);
    }

    /// Curvature and speed of every sample.
    fn shape(&mut self, body: &Body, limits: &Limits, manners: &Manners) {
        let count = self.samples.len();
        let mut begin = 0;
        while begin < count {
            let end = self.leg_end(begin);
            for number in begin..=end {
                let way = self.samples[number].way;
                let within = |other: &usize| (self.samples[*other].way - way).abs() <= WINDOW;
                let first = (begin..=number).rev().take_while(within).last().unwrap_or(number);
                let last = (number..=end).take_while(within).last().unwrap_or(number);
                let (a, b) = (self.samples[first], self.samples[last]);
                let sign = if a.forward { 1.0 } else { -1.0 };
                let turn = (b.pose.theta - a.pose.theta).radians();
                let curvature = if b.way - a.way > SAME { sign * turn / (b.way - a.way) } else { 0.0 };
                let most = libm::tan(limits.steering) / body.wheelbase;
                self.samples[number].curvature = curvature.clamp(-most, most);
            }
            begin = end + 1;
        }
        for number in 0..count {
            self.samples[number].speed = self.speed_at(number, body, limits, manners);
        }
        // Each place as fast as one can still brake for the next; ends and cusps are stops.
        for number in (0..count).rev() {
            let braked = match self.samples.get(number + 1) {
                Some(next) if next.forward == self.samples[number].forward => {
                    let step = next.way - self.samples[number].way;
                    libm::sqrt(next.speed * next.speed + 2.0 * GENTLE * limits.deceleration * step)
                }
                _ => 0.0,
            };
            let speed = &mut self.samples[number].speed;
            *speed = speed.min(braked);
        }
    }

    /// The greatest speed that curve and steering allow.
    fn speed_at(&self, number: usize, body: &Body, limits: &Limits, manners: &Manners) -> f64 {
        let sample = &self.samples[number];
        let straight = if sample.forward { limits.speed } else { manners.speed_reverse.min(limits.speed) };
        let curve = libm::sqrt(limits.lateral_acceleration / sample.curvature.abs().max(1e-6));
        let neighbour = |other: Option<&Sample>| other.filter(|other| other.forward == sample.forward).copied();
        let before = number.checked_sub(1).and_then(|other| neighbour(self.samples.get(other))).unwrap_or(*sample);
        let after = neighbour(self.samples.get(number + 1)).unwrap_or(*sample);
        let step = (after.way - before.way).max(SAME);
        let steer = |sample: &Sample| libm::atan(body.wheelbase * sample.curvature);
        let steering = (steer(&after) - steer(&before)).abs() / step;
        let steered = RATE_SHARE * limits.steering_rate / steering.max(1e-6);
        straight.min(curve).min(steered).max(CREEP)
    }

    /// The last sample of the leg that `number` is on.
    fn leg_end(&self, number: usize) -> usize {
        let forward = self.samples[number].forward;
        let same = self.samples[number..].iter().take_while(|sample| sample.forward == forward).count();
        number + same - 1
    }

    /// All samples that are still to be driven, from the one that the robot has passed last.
    #[must_use]
    pub fn ahead(&self) -> &[Sample] {
        self.samples.get(self.at..).unwrap_or_default()
    }

    /// Where it ends, and in which direction it is driven there.
    #[must_use]
    pub fn end(&self) -> Option<(Pose, bool)> {
        self.samples.last().map(|sample| (sample.pose, sample.forward))
    }

    /// The way that is left, m.
    #[must_use]
    pub fn remaining(&self) -> f64 {
        match (self.samples.get(self.at), self.samples.last()) {
            (Some(here), Some(end)) => end.way - here.way,
            _ => 0.0,
        }
    }

    /// How far the robot is beside the path, m, and turned from it, rad.
    #[must_use]
    pub fn error(&self) -> (f64, f64) {
        self.error
    }

    /// The way of the sample that was passed last, m.
    #[must_use]
    pub fn way(&self) -> f64 {
        self.samples.get(self.at).map_or(0.0, |sample| sample.way)
    }

    /// Whether it is driven forward here; none without a track.
    #[must_use]
    pub fn forward(&self) -> Option<bool> {
        self.samples.get(self.at).map(|sample| sample.forward)
    }

    /// The waypoint whose end was passed, once.
    pub fn passed(&mut self) -> Option<usize> {
        let &(number, waypoint) = self.marks.first()?;
        // The last one is not passed but reached.
        if self.marks.len() < 2 || number > self.at {
            return None;
        }
        self.marks.remove(0);
        Some(waypoint)
    }

    /// The last waypoint that it leads to.
    #[must_use]
    pub fn leads_to(&self) -> Option<usize> {
        self.marks.last().map(|mark| mark.1)
    }

    /// Whether the robot has come to the end of all of it.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.at + 1 >= self.samples.len()
    }

    /// Follows the robot along the path, never back. On a leg's last sample it waits until the robot stands.
    fn locate(&mut self, robot: Pose, speed: f64) {
        if self.samples.is_empty() {
            return;
        }
        let end = self.leg_end(self.at);
        while self.at < end {
            let next = self.samples[self.at + 1];
            let (sin, cos) = next.pose.theta.sin_cos();
            let beyond = (robot.x - next.pose.x) * cos + (robot.y - next.pose.y) * sin;
            let beyond = if next.forward { beyond } else { -beyond };
            let near = if self.at + 1 == end { LEG_END } else { 0.0 };
            if beyond < -near {
                break;
            }
            self.at += 1;
        }
        if self.at == end && end + 1 < self.samples.len() && speed.abs() < STANDING {
            self.at += 1;
        }
    }

    /// What to command: where the robot is, how fast it goes and how its wheels stand, and the speed that everything
    /// else allows.
    pub fn follow(&mut self, robot: Pose, now: Motion, allowed: f64, body: &Body, limits: &Limits) -> Motion {
        self.locate(robot, now.speed);
        let Some(here) = self.samples.get(self.at).copied() else { return Motion { speed: 0.0, ..now } };
        let end = self.leg_end(self.at);
        let sign = if here.forward { 1.0 } else { -1.0 };
        // Place on the path between two samples.
        let (sin, cos) = here.pose.theta.sin_cos();
        let (dx, dy) = (robot.x - here.pose.x, robot.y - here.pose.y);
        let along = (sign * (dx * cos + dy * sin)).max(0.0);
        let way = here.way + along;
        let heading = here.pose.theta.radians() + here.curvature * sign * along;
        let (sin, cos) = libm::sincos(heading);
        let aside = dy * cos - dx * sin + here.curvature * along * along / 2.0;
        let turned = navitools::wrap(robot.theta.radians() - heading);
        self.error = (aside, turned);
        // In the way travelled, e'' = u with u the difference of the curvatures: a spring and a damper.
        let length = 0.45 + 0.4 * now.speed.abs();
        let wanted = -sign * libm::atan(aside / length);
        let u = -2.0 * sign * (turned - wanted) / length;
        let ahead = way + now.speed.abs() * PREVIEW;
        let preview =
            self.samples[self.at..=end].iter().find(|sample| sample.way >= ahead).unwrap_or(&self.samples[end]);
        let curvature = preview.curvature + u;
        let steering = libm::atan(body.wheelbase * curvature).clamp(-limits.steering, limits.steering);
        let left = self.samples[end].way - way;
        let stopping = libm::sqrt(2.0 * GENTLE * limits.deceleration * left.max(0.0));
        let mut speed = preview.speed.max(CREEP).min(stopping.max(CREEP)).min(allowed);
        let unsteered = (steering - now.steering).abs();
        if now.speed.abs() < STANDING && unsteered > STEERED {
            speed = 0.0;
        } else if unsteered > STEERED {
            speed *= (1.0 - 2.0 * (unsteered - STEERED)).max(0.3);
        }
        if self.at == end {
            speed = 0.0;
        }
        Motion { speed: sign * speed, steering }
    }

    /// At most about `most` points of what is ahead, x and y, the end among them; for people.
    #[must_use]
    pub fn points(&self, most: usize) -> (Vec<f64>, Vec<f64>) {
        let ahead = self.ahead();
        let step = ahead.len().div_ceil(most.max(1)).max(1);
        let last = ahead.last().filter(|_| !(ahead.len() - 1).is_multiple_of(step));
        ahead.iter().step_by(step).chain(last).map(|sample| (sample.pose.x, sample.pose.y)).unzip()
    }
}
