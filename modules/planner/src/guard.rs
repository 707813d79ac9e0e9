//! Speed limits from sonar echoes: the robot can stop before an obstacle, even one that approaches, with the whole
//! reaction time (docs/facts/robot.md 5).

use crate::config::{Body, Config, Limits, Manners};
use crate::obstacles::{Echoed, Hit, Obstacles};
use crate::people::Person;
use crate::track::Sample;
use base::{Duration, Instant};
use navitools::{Point, Pose};

/// Distance along the path that is checked, m; a leg returns an echo up to 2.5 m.
const HORIZON: f64 = 2.5;
/// Distance between the checked poses, m.
const STRIDE: f64 = 0.10;
/// Time for which free space remains valid at full speed.
const FRESH: Duration = Duration::from_secs(1);
/// Distance by which the robot may still approach an obstacle that is already within the margin, m.
const CLOSER: f64 = 0.03;
/// Lateral distance from an obstacle below which the robot slows down, m.
const SHY: f64 = 0.45;
/// Speed beside an obstacle that is almost touched, m/s, and its increase per metre of distance, 1/s.
const SHY_SPEED: f64 = 0.30;
const SHY_GAIN: f64 = 1.1;
/// Distance of a single echo ahead below which the robot brakes, confirmed or not, m.
const SUDDEN: f64 = 0.8;
/// Lower bound of the speed after an unconfirmed echo, m/s.
const DOUBTFUL: f64 = 0.4;
/// Minimum distance from mapped obstacles, m.
const MAPPED: f64 = 0.04;
/// Distance to the middle of a person, m, and its increase per standard deviation of the position, and of the velocity
/// each second.
const KEEP: f64 = 0.35;
const DOUBT: f64 = 0.2;
/// Speed at which a person may leave the predicted path, m/s.
const STRAYS: f64 = 0.05;
/// Speed of the robot above which [`STRAYS`] counts, m/s.
const CREEPS: f64 = 0.21;
/// Assumed speed of an unknown person, m/s, for the range from which people are considered.
const STROLLING: f64 = 0.5;
/// Distance from the middle of a person at which the robot does not approach further, m.
const TOUCHES: f64 = 0.32;
/// Distance from a person below which the speed is limited, m, and the limit, m/s.
const BESIDE: f64 = 0.40;
const SQUEEZES: f64 = 0.2;
/// Corridor before the robot, m beside its axis, in which an unconfirmed person may approach at this speed, m/s: the
/// robot brakes for one echo.
const CORRIDOR: f64 = 0.6;
const COMES: f64 = 1.2;
/// Steps of the tried speeds, m/s, and times, s.
const SLOWER: f64 = 0.05;
const TICK: f64 = 0.2;
/// Distance between the poses of the predicted path, m, and their number; longer than the longest stop.
const WAY_STEP: f64 = 0.08;
const WAY_STEPS: usize = 12;
/// Upper bounds of the stop from full speed: distance, m, and time, s.
const STOP: f64 = 0.9;
const STOP_TIME: f64 = 1.6;
/// Speed below which the robot is considered to stand, m/s.
const LEAST: f64 = 0.05;

/// Obstacles along the path ahead, from the last round of the sonars.
#[derive(Clone, Debug, Default)]
pub struct Ahead {
    /// Contacts: distance along the track, m, and closing speed, m/s.
    contacts: Vec<(f64, f64)>,
    /// First contact: distance along the track, m, and position of the obstacle.
    first: Option<(f64, Point)>,
    /// Speed limits along the track: beside an obstacle, or in space that was not observed.
    slow: Vec<(f64, f64)>,
}

impl Ahead {
    /// Checks the path from `ahead[0]` on, at `now`.
    #[must_use]
    pub fn look(now: Instant, ahead: &[Sample], obstacles: &Obstacles, config: &Config) -> Self {
        let Some(here) = ahead.first() else { return Self::default() };
        let (body, manners) = (&config.body, &config.manners);
        let reach = HORIZON + body.front + SHY;
        let near = |hit: &Hit| hit.at.distance(here.pose.point()) < reach;
        // An obstacle that is already closer may be left behind, but not approached.
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

    /// First obstacle on the path, and the distance along the track at which the robot would touch it, m.
    #[must_use]
    pub fn first(&self) -> Option<(f64, Point)> {
        self.first
    }

    /// Highest speed at `way` on the track, m/s; 0 to stop.
    #[must_use]
    pub fn speed(&self, way: f64, config: &Config) -> f64 {
        let (limits, manners) = (&config.limits, &config.manners);
        let mut speed = limits.speed;
        for &(contact, closing) in &self.contacts {
            speed = speed.min(stopping_speed(contact - way - manners.stop_distance, closing, limits, manners));
        }
        for &(place, slow) in &self.slow {
            // Braking begins early enough to reach that speed there.
            let left = (place - way - speed * manners.reaction).max(0.0);
            speed = speed.min(libm::sqrt(slow * slow + 2.0 * 0.5 * limits.deceleration * left));
        }
        if speed < LEAST { 0.0 } else { speed }
    }
}

/// Speed allowed by the nearest echo in the direction of travel, confirmed or not, m/s. The path already keeps its
/// distance from mapped obstacles, so they may be passed closer. 0 if the state of all sonars in that direction is
/// unknown.
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
        // A first echo may be a false alarm: the robot brakes until the next round, but not to a stop.
        if echo.again || echo.mapped { speed } else { speed.max(DOUBTFUL) }
    };
    let speed = near.map(speed).fold(limits.speed, f64::min);
    if speed < LEAST { 0.0 } else { speed }
}

/// Highest speed from which the robot can stop before it touches a tracked person, m/s, if it continues along `ahead`
/// and each person continues at the estimated velocity with some deviation. A person who walks into the standing robot
/// is not considered.
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
        // A person farther away cannot arrive within the longest stop.
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

/// Predicted poses of the robot on the path, every [`WAY_STEP`].
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

    /// Pose after `went` m; beyond the known path the last pose.
    fn at(&self, went: f64) -> Pose {
        let step = ((went / WAY_STEP) as usize).min(WAY_STEPS - 2);
        let (from, to) = (self.0[step], self.0[step + 1]);
        let share = (went / WAY_STEP - step as f64).min(1.0);
        let between = |from: f64, to: f64| from + share * (to - from);
        let theta = from.theta.radians() + share * (to.theta - from.theta).radians();
        Pose::new(between(from.x, to.x), between(from.y, to.y), theta)
    }

    /// True if a robot at `speed` that brakes after its reaction time stops before it is too close to a person who is
    /// `gap` m away.
    fn is_free(&self, speed: f64, person: &Person, gap_now: f64, config: &Config) -> bool {
        let (body, a, reaction) = (&config.body, config.limits.deceleration, config.manners.reaction);
        // A person that close may be left behind; the closer, the less may the robot approach.
        let closer = CLOSER * ((gap_now - TOUCHES) / 0.2).clamp(0.0, 1.0) + 1e-3;
        let keep = (KEEP + DOUBT * person.sigma).min(gap_now - closer);
        let strays = if speed <= CREEPS { 0.0 } else { STRAYS + DOUBT * person.restless };
        let stands = reaction + speed / a;
        // A velocity counts as far as it exceeds its uncertainty.
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

/// Highest speed from which the robot stops within `free` m while the obstacle approaches at `closing` m/s: with the
/// brakes after the reaction time, and also by coasting when the motors lose their supply.
#[must_use]
pub fn stopping_speed(free: f64, closing: f64, limits: &Limits, manners: &Manners) -> f64 {
    let (a, reaction) = (limits.deceleration, manners.reaction);
    // v T + v²/2a = free - closing T; the obstacle also approaches while the robot brakes.
    let left = free - closing * reaction;
    if left <= 0.0 {
        return 0.0;
    }
    let t = reaction + closing / a;
    let braked = a * (libm::sqrt(t * t + 2.0 * left / a) - t);
    braked.min(libm::sqrt(2.0 * manners.coasting * left))
}

/// Distance of a point in the robot's frame from its body, m; 0 within it.
#[must_use]
pub fn gap(body: &Body, at: Point) -> f64 {
    let dx = (-body.rear - at.x).max(at.x - body.front).max(0.0);
    let dy = (at.y.abs() - body.width / 2.0).max(0.0);
    libm::hypot(dx, dy)
}

/// True if the robot at `pose` is at least `margin` m from all sensed obstacles.
#[must_use]
pub fn is_clear(pose: Pose, obstacles: &Obstacles, body: &Body, margin: f64) -> bool {
    let inverse = pose.inverse();
    obstacles.hits().all(|hit| !body.covers(inverse * hit.at, margin))
}

#[cfg(test)]
mod tests;
