//! How fast the robot may go for what the sonars hear: so that it stands before what is in the way, whoever comes
//! nearer, with the whole chain of reaction (docs/facts/robot.md 5).

use crate::config::{Body, Config, Limits, Manners};
use crate::obstacles::{Echoed, Hit, Obstacles};
use crate::people::Person;
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
const SUDDEN: f64 = 0.8;
/// It is not slowed down for below this, m/s, before it is heard again.
const DOUBTFUL: f64 = 0.4;
/// Kept at least to what the map has, m.
const MAPPED: f64 = 0.04;
/// Kept to the middle of somebody, m; and more for each deviation of his place, and of his velocity each second.
const KEEP: f64 = 0.35;
const DOUBT: f64 = 0.2;
/// Somebody strays from where he goes by so much a second, m, which counts for a robot that is faster than
const STRAYS: f64 = 0.05;
const CREEPS: f64 = 0.21;
/// this. Where nobody can be told from farther than
const STROLLING: f64 = 0.5;
/// Somebody whose middle is as near as this, m, is not approached at all.
const TOUCHES: f64 = 0.32;
/// With somebody as near as this, m, the robot goes no faster than this, m/s.
const BESIDE: f64 = 0.40;
const SQUEEZES: f64 = 0.2;
/// Who may be before the robot, no further beside its axis, m, may come at this speed, m/s: one echo is braked for.
const CORRIDOR: f64 = 0.6;
const COMES: f64 = 1.2;
/// Speeds are tried in such steps, m/s, and times, s.
const SLOWER: f64 = 0.05;
const TICK: f64 = 0.2;
/// The path is taken in such steps, m, and so many: further than the robot rolls before it stands.
const WAY_STEP: f64 = 0.08;
const WAY_STEPS: usize = 12;
/// At the greatest speed it rolls less far, m, and for less time, s.
const STOP: f64 = 0.9;
const STOP_TIME: f64 = 1.6;
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
/// slowly. What the map has is kept clear of by the path, and may be passed nearer. 0 where sonars look that way and
/// nothing is known of any.
#[must_use]
pub fn sudden(now: Instant, forward: bool, obstacles: &Obstacles, config: &Config) -> f64 {
    let (limits, manners) = (&config.limits, &config.manners);
    if obstacles.is_blind(now, forward, &config.body) {
        return 0.0;
    }
    let near = obstacles.echoes(now, forward, &config.body).filter(|echo| echo.distance < SUDDEN);
    let speed = |echo: Echoed| {
        let keep = if echo.mapped { MAPPED } else { manners.stop_distance / 2.0 };
        let speed = stopping_speed(echo.distance - keep, echo.closing, limits, manners);
        // A first echo may be of nothing: it is braked for until the next round, but not to a stop.
        if echo.again || echo.mapped { speed } else { speed.max(DOUBTFUL) }
    };
    let speed = near.map(speed).fold(limits.speed, f64::min);
    if speed < LEAST { 0.0 } else { speed }
}

/// The speed from which the robot stands before anybody around can be touched by it, going on along `ahead` as everybody
/// goes on as he goes, and a little otherwise. Whoever comes to a robot that stands is not its affair.
#[must_use]
pub fn meeting(now: Instant, ahead: &[Sample], obstacles: &Obstacles, config: &Config) -> f64 {
    let (body, limits) = (&config.body, &config.limits);
    let Some(way) = Way::of(ahead) else { return limits.speed };
    let here = way.0[0].inverse();
    let mut speed = limits.speed;
    for person in obstacles.people(now) {
        let gap = gap(body, here * person.at);
        let goes = libm::hypot(person.velocity.0, person.velocity.1);
        if !person.sure {
            let at = here * person.at;
            let before = if ahead[0].forward { at.x - body.front } else { -body.rear - at.x };
            if at.y.abs() < CORRIDOR && before > SUDDEN {
                speed = speed.min(stopping_speed(before - KEEP, COMES, limits, &config.manners));
            }
            continue;
        }
        // Within the longest stop nobody comes from farther.
        let reach = STOP + KEEP + (goes + STROLLING + person.restless) * STOP_TIME;
        if gap > reach {
            continue;
        }
        if gap < BESIDE {
            speed = speed.min(SQUEEZES);
        }
        while speed > 0.0 && !way.is_free(speed, &person, gap, config) {
            speed = if speed > SLOWER { speed - SLOWER } else { 0.0 };
        }
    }
    if speed < LEAST { 0.0 } else { speed }
}

/// Where the robot will be on the path: poses every [`WAY_STEP`].
struct Way([Pose; WAY_STEPS]);

impl Way {
    fn of(ahead: &[Sample]) -> Option<Self> {
        let first = ahead.first()?;
        let mut poses = [first.pose; WAY_STEPS];
        let mut rest = ahead.iter().take_while(|sample| sample.forward == first.forward).peekable();
        for step in 1..WAY_STEPS {
            poses[step] = poses[step - 1];
            while let Some(sample) = rest.next_if(|sample| sample.way <= first.way + WAY_STEP * step as f64) {
                poses[step] = sample.pose;
            }
        }
        Some(Self(poses))
    }

    /// Where it is after `went` m; at the end of what is known it stays.
    fn at(&self, went: f64) -> Pose {
        let step = ((went / WAY_STEP) as usize).min(WAY_STEPS - 2);
        let (from, to) = (self.0[step], self.0[step + 1]);
        let share = (went / WAY_STEP - step as f64).min(1.0);
        let between = |from: f64, to: f64| from + share * (to - from);
        let theta = from.theta.radians() + share * (to.theta - from.theta).radians();
        Pose::new(between(from.x, to.x), between(from.y, to.y), theta)
    }

    /// Whether a robot that goes at `speed`, and brakes after its reaction, stands before it is too near to somebody who is
    /// `gap` away.
    fn is_free(&self, speed: f64, person: &Person, gap_now: f64, config: &Config) -> bool {
        let (body, a, reaction) = (&config.body, config.limits.deceleration, config.manners.reaction);
        // Who is that near is left behind, and the nearer he is the less is he approached.
        let closer = CLOSER * ((gap_now - TOUCHES) / 0.2).clamp(0.0, 1.0) + 1e-3;
        let keep = (KEEP + DOUBT * person.sigma).min(gap_now - closer);
        let strays = if speed <= CREEPS { 0.0 } else { STRAYS + DOUBT * person.restless };
        let stands = reaction + speed / a;
        // Of a velocity only what is known of it counts.
        let goes = libm::hypot(person.velocity.0, person.velocity.1);
        let known = (1.0 - person.restless / goes.max(1e-3)).max(0.0);
        let (vx, vy) = (person.velocity.0 * known, person.velocity.1 * known);
        let mut time = TICK;
        loop {
            let time_now = time.min(stands);
            let braking = (time_now - reaction).max(0.0);
            let went = speed * time_now - a * braking * braking / 2.0;
            let pose = self.at(went);
            let at = Point { x: person.at.x + vx * time_now, y: person.at.y + vy * time_now };
            if gap(body, pose.inverse() * at) < keep + strays * time_now {
                return false;
            }
            if time >= stands {
                return true;
            }
            time += TICK;
        }
    }
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

#[cfg(test)]
mod tests;
