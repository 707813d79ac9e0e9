//! How fast the robot may go for what the sonars hear: so that it stands before what is in the way, whoever comes
//! nearer, with the whole chain of reaction (docs/facts/robot.md 5).

use crate::config::{Body, Config, Limits, Manners};
use crate::obstacles::{Echoed, Hit, Obstacles};
use crate::track::Sample;
use base::{Duration, Instant};
use navitools::{Point, Pose};

/// The path is looked along so far, m: a leg is heard to 2.5 m.
const HORIZON: f64 = 2.5;
/// The path is looked at this often, m.
const STRIDE: f64 = 0.10;
/// Free space is believed for this long at full speed.
const FRESH: Duration = Duration::from_secs(1);
/// Who is within the margin already is not approached by more, m.
const CLOSER: f64 = 0.03;
/// What is nearer beside the way than this makes the robot slow, m.
const SHY: f64 = 0.45;
/// How fast it passes what it nearly touches, m/s, and how much faster for each metre between.
const SHY_SPEED: f64 = 0.30;
const SHY_GAIN: f64 = 1.1;
/// A single echo ahead nearer than this is braked for, confirmed or not, m.
const SUDDEN: f64 = 1.2;
/// Kept at least to what the map has, m.
const MAPPED: f64 = 0.04;
/// Who is this far behind the robot's front corner, m, is not before it.
const ABREAST: f64 = 0.3;
/// Sonars hear legs; people are so much wider, m.
const STOUT: f64 = 0.2;
/// People come nearer as fast, m/s, and are met as slowly where they are before the robot, or nearer beside it than
const STROLLING: f64 = 0.4;
const CAUTIOUS: f64 = 0.20;
/// this, m; and passed as slowly where they are farther.
const NARROW: f64 = 0.30;
const PASSING: f64 = 0.45;
/// Slower is standing still, m/s.
const LEAST: f64 = 0.05;

/// What was found along the path ahead at the last round of the sonars.
#[derive(Clone, Debug, Default)]
pub struct Ahead {
    /// Where the robot would touch something: the way on the track, m, how fast it comes nearer, and where it stands.
    contacts: Vec<(f64, f64)>,
    /// Where the first contact stands.
    first: Option<(f64, Point)>,
    /// Speeds at ways on the track: beside something, or in space that was not seen.
    slow: Vec<(f64, f64)>,
}

impl Ahead {
    /// Looks along the path from `ahead[0]`, at `now`.
    #[must_use]
    pub fn look(now: Instant, ahead: &[Sample], obstacles: &Obstacles, config: &Config) -> Self {
        let Some(here) = ahead.first() else { return Self::default() };
        let (body, manners) = (&config.body, &config.manners);
        let reach = HORIZON + body.front + SHY;
        let near = |hit: &Hit| hit.at.distance(here.pose.point()) < reach;
        // What is nearer already is left behind, but not approached.
        let inverse = here.pose.inverse();
        let keep = |hit: &Hit| (gap(body, inverse * hit.at) - CLOSER).min(manners.margin);
        let mut hits: Vec<(Hit, f64, bool)> =
            obstacles.hits().filter(near).map(|hit| (hit, keep(&hit), false)).collect();
        let mut found = Self::default();
        let (mut next, mut last) = (here.way, None);
        for sample in ahead.iter().take_while(|sample| sample.way <= here.way + HORIZON) {
            if sample.way < next && last == Some(sample.forward) {
                continue;
            }
            (next, last) = (sample.way + STRIDE, Some(sample.forward));
            let inverse = sample.pose.inverse();
            let mut beside = SHY;
            for (hit, keep, touched) in hits.iter_mut().filter(|(.., touched)| !touched) {
                let at = inverse * hit.at;
                let gap = gap(body, at);
                if gap <= *keep {
                    *touched = true;
                    found.contacts.push((sample.way, hit.closing));
                    found.first = found.first.or(Some((sample.way, hit.at)));
                } else if at.x > -body.rear || !sample.forward {
                    beside = beside.min(gap);
                }
            }
            if beside < SHY {
                found.slow.push((sample.way, SHY_SPEED + SHY_GAIN * (beside - manners.margin).max(0.0)));
            }
            let nose = if sample.forward { body.front } else { -body.rear };
            let nose = sample.pose * Point { x: nose, y: 0.0 };
            let ours = (sample.way - here.way) < STRIDE;
            if !ours && !obstacles.seen_within(now, nose, FRESH) {
                found.slow.push((sample.way, manners.speed_unseen));
            }
        }
        found
    }

    /// Where the first thing in the way stands, and the way on the track to where the robot would touch it, m.
    #[must_use]
    pub fn first(&self) -> Option<(f64, Point)> {
        self.first
    }

    /// The greatest speed at `way` on the track, m/s; 0: stop.
    #[must_use]
    pub fn speed(&self, way: f64, config: &Config) -> f64 {
        let (limits, manners) = (&config.limits, &config.manners);
        let mut speed = limits.speed;
        for &(contact, closing) in &self.contacts {
            speed = speed.min(stopping_speed(contact - way - manners.stop_distance, closing, limits, manners));
        }
        for &(place, slow) in &self.slow {
            // Braking begins early enough to be so slow there.
            let left = (place - way - speed * manners.reaction).max(0.0);
            speed = speed.min(libm::sqrt(slow * slow + 2.0 * 0.5 * limits.deceleration * left));
        }
        if speed < LEAST { 0.0 } else { speed }
    }
}

/// The speed that the nearest echo in the direction of travel allows, confirmed or not: who is that near is approached
/// slowly. What the map has is kept clear of by the path, and may be passed nearer.
#[must_use]
pub fn sudden(now: Instant, forward: bool, obstacles: &Obstacles, config: &Config) -> f64 {
    let (limits, manners) = (&config.limits, &config.manners);
    let near = obstacles.echoes(now, forward).filter(|echo| echo.distance < SUDDEN);
    let speed = |echo: Echoed| {
        let keep = if echo.mapped { MAPPED } else { manners.stop_distance / 2.0 };
        stopping_speed(echo.distance - keep, echo.closing, limits, manners)
    };
    let speed = near.map(speed).fold(limits.speed, f64::min);
    if speed < LEAST { 0.0 } else { speed }
}

/// The speed at which the robot may meet those who were heard ahead of it of late, wherever they go next.
#[must_use]
pub fn caution(now: Instant, robot: Pose, forward: bool, obstacles: &Obstacles, config: &Config) -> f64 {
    let (body, limits, manners) = (&config.body, &config.limits, &config.manners);
    let inverse = robot.inverse();
    let speed = |place: Point| {
        let at = inverse * place;
        let before = if forward { at.x - body.front } else { -body.rear - at.x };
        if before < -ABREAST {
            return limits.speed;
        }
        // He is not before the robot yet: what he must walk for that is as good as distance.
        let beside = (at.y.abs() - body.width / 2.0 - STOUT).max(0.0);
        let least = if beside < NARROW { CAUTIOUS } else { PASSING };
        stopping_speed(before - STOUT + beside, STROLLING, limits, manners).max(least)
    };
    obstacles.present(now).map(speed).fold(limits.speed, f64::min)
}

/// From how fast the robot stands within `free` m while something comes nearer at `closing` m/s: both by the brakes
/// after the reaction, and rolling out by itself when its motors lose their feed.
#[must_use]
pub fn stopping_speed(free: f64, closing: f64, limits: &Limits, manners: &Manners) -> f64 {
    let (a, reaction) = (limits.deceleration, manners.reaction);
    // v T + v²/2a = free - closing T, where what comes nearer does so during the braking too.
    let left = free - closing * reaction;
    if left <= 0.0 {
        return 0.0;
    }
    let t = reaction + closing / a;
    let braked = a * (libm::sqrt(t * t + 2.0 * left / a) - t);
    braked.min(libm::sqrt(2.0 * manners.coasting * left))
}

/// How far a point of the robot's frame is from the robot, m; 0 within it.
#[must_use]
pub fn gap(body: &Body, at: Point) -> f64 {
    let dx = (-body.rear - at.x).max(at.x - body.front).max(0.0);
    let dy = (at.y.abs() - body.width / 2.0).max(0.0);
    libm::hypot(dx, dy)
}

/// Whether the robot at `pose` is clear of all that was sensed, by `margin` m.
#[must_use]
pub fn is_clear(pose: Pose, obstacles: &Obstacles, body: &Body, margin: f64) -> bool {
    let inverse = pose.inverse();
    obstacles.hits().all(|hit| !body.covers(inverse * hit.at, margin))
}
