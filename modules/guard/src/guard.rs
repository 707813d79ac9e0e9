//! The module: ranges and measured motion in, greatest speeds out.

use crate::config::{Config, Ranging};
use crate::fields::{Bound, Cause, Fields};
use crate::zones::Zones;
use base::{Deadlines, Duration, Instant};
use kinematics::reach::{Base, Direction, Kinematics, Motion};
use kinematics::{Polygon, Twist};
use messages::lowlevel::{DataGuard, DataMotion, DataScan, DataVelocity, Field};
use messages::{Channel, Hold, Message};
use module::{Actions, Event, Module};
use std::fmt;
use surroundings::{Echoes, Obstacle, Scans, Source, Trail, Unseen};

/// Name of the module.
pub const NAME: &str = "guard";

/// Period of `LL_DATA_GUARD`.
const PERIOD: Duration = Duration::from_millis(50);
/// Age of the measured motion, published at 20 Hz, beyond which it is unknown.
const MOTION_AGE_MAX: Duration = Duration::from_millis(200);
/// Measured motion up to this multiple of the robot's limits is plausible; beyond it the motion is unknown.
const PLAUSIBLE: f64 = 2.0;
/// Steering angle beyond which a path is no more than a spin, rad.
const STEERING_MAX_RAD: f64 = 1.5;
/// Speed below which the robot counts as standing, m/s.
const STANDSTILL_MPS: f64 = 0.02;
/// What a lidar finds near the robot is published at once, but not sooner than this after the last such message.
const SPACING: Duration = Duration::from_millis(10);

base::deadlines! {
    /// Deadlines of the module.
    enum Timer {
        /// `LL_DATA_GUARD` is published. Set from the start on.
        Publish,
        /// It is published with what a lidar found within [`SPACING`] of the last such message.
        Found,
    }
}

/// The outline of the robot has no area.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoOutline;

impl fmt::Display for NoOutline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the outline of the robot has no area")
    }
}

impl std::error::Error for NoOutline {}

/// The module `guard`.
#[derive(Debug)]
pub struct Guard {
    fields: Fields<Base>,
    /// Fields of the configuration, beside those.
    zones: Zones,
    ranging: Ranging,
    window: Duration,
    /// Greatest plausible speed, m/s.
    speed_max: f64,
    echoes: Echoes,
    scans: Scans,
    subscriptions: Vec<Channel>,
    /// Instant of the last message for what a lidar had found.
    found: Instant,
    trail: Trail,
    /// Measured steering angle of the curves of a base that does not steer, rad, and its instant.
    curve: Option<(Instant, f64)>,
    /// Measured motion, and its instant.
    motion: Option<(Instant, Motion)>,
    /// Last velocity of the trail, and its instant, also after motion that was not plausible.
    last: Option<(Instant, Twist)>,
    obstacles: Vec<Obstacle>,
    unseen: Vec<Unseen>,
    deadlines: Deadlines<Timer>,
}

impl Guard {
    /// Creates the module.
    ///
    /// # Errors
    /// The outline of the robot has no area.
    pub fn new(config: &Config) -> Result<Self, NoOutline> {
        let body = Polygon::hull(&config.footprint).ok_or(NoOutline)?;
        let rules = config.settings.rules();
        let mut subscriptions = vec![Channel::LlDataRanges, Channel::LlDataMotion];
        subscriptions.extend(config.base.turns.then_some(Channel::LlDataVelocity));
        subscriptions.extend((!config.lidars().is_empty()).then_some(Channel::LlDataScan));
        Ok(Self {
            fields: Fields::new(config, config.base).ok_or(NoOutline)?,
            zones: Zones::new(config, &body),
            ranging: config.settings.ranging,
            window: config.settings.window,
            speed_max: PLAUSIBLE * config.speed,
            echoes: Echoes::new(rules, config.sonars()),
            scans: Scans::new(rules, config.lidars(), &body),
            subscriptions,
            found: Instant::ZERO,
            trail: Trail::default(),
            curve: None,
            motion: None,
            last: None,
            obstacles: Vec::new(),
            unseen: Vec::new(),
            deadlines: Deadlines::new(),
        })
    }

    fn on_motion(&mut self, at: Instant, motion: &DataMotion) {
        let base = *self.fields.base();
        let steering_max = (PLAUSIBLE * base.curves.steering).min(STEERING_MAX_RAD);
        // What is not a number is not plausible either.
        let plausible = motion.speed.abs() <= self.speed_max && motion.steering.abs() <= steering_max;
        if !plausible {
            (self.motion, self.curve) = (None, None);
            return;
        }
        if base.turns {
            self.curve = Some((at, motion.steering));
        } else {
            self.moved(at, base.velocity(motion.speed, motion.steering), motion.steering);
        }
    }

    /// Measured velocity of a base that does not steer: `LL_DATA_MOTION` has only a part of it.
    fn on_velocity(&mut self, at: Instant, &DataVelocity { vx, vy, omega, .. }: &DataVelocity) {
        let corner = omega.abs() * self.fields.radius();
        let plausible = [vx.abs(), vy.abs(), corner].into_iter().all(|speed| speed <= self.speed_max);
        let curve = self.curve.filter(|(since, _)| plausible && at.since(*since) <= MOTION_AGE_MAX);
        match curve {
            Some((_, steering)) => self.moved(at, Twist { vx, vy, omega }, steering),
            None => self.motion = None,
        }
    }

    fn moved(&mut self, at: Instant, velocity: Twist, steering: f64) {
        // What it did in a gap is not known, if it moved before or moves now.
        let moves = |velocity: Twist| self.speed_of(velocity) > STANDSTILL_MPS;
        let is_gap = |(since, before)| at.since(since) > MOTION_AGE_MAX && (moves(before) || moves(velocity));
        let is_lost = self.last.is_some_and(is_gap);
        self.last = Some((at, velocity));
        self.trail.on_motion(at, velocity, self.window);
        if is_lost || !self.trail.is_sane() {
            // Where things were, relative to the robot, is lost with it: everything is unknown.
            self.trail = Trail::default();
            self.trail.on_motion(at, velocity, self.window);
            self.echoes.forget();
            self.scans.forget();
        }
        self.motion = Some((at, Motion { velocity, steering }));
    }

    /// Speed of the fastest part of the robot, m/s.
    fn speed_of(&self, Twist { vx, vy, omega }: Twist) -> f64 {
        libm::hypot(vx, vy).max(omega.abs() * self.fields.radius())
    }

    /// A lidar has measured. What comes into a field is published at once.
    fn on_scan(&mut self, now: Instant, at: Instant, scan: &DataScan, out: &mut Actions) {
        let age = u64::try_from(out.timestamp(at).saturating_sub(scan.timestamp))
            .map_or(Duration::ZERO, Duration::from_micros);
        let Some(distance) = self.scans.on_scan(at, age, scan, &self.trail) else { return };
        let velocity = self.motion.map_or_else(Twist::default, |(_, motion)| motion.velocity);
        let speed = self.speed_of(velocity);
        let law = self.fields.law();
        let field = self.fields.radius() + law.protective(speed).max(law.warning(speed));
        let field = field.max(self.zones.reach());
        if speed <= STANDSTILL_MPS || distance > field {
            return;
        }
        if now.since(self.found) >= SPACING {
            self.found = now;
            self.publish(now, out);
        } else if !self.deadlines.is_set(Timer::Found) {
            self.deadlines.set(Timer::Found, self.found + SPACING);
        }
    }

    fn publish(&mut self, now: Instant, out: &mut Actions) {
        self.deadlines.clear(Timer::Found);
        let timestamp = out.timestamp(now);
        let motion = self.motion.filter(|(at, _)| now.since(*at) <= MOTION_AGE_MAX).map(|(_, motion)| motion);
        let Some(motion) = motion else {
            // Without the measured motion, neither the robot's path nor the position of what was sensed is known.
            out.publish(DataGuard { timestamp, code: Hold::GuardMotion.code(), ..DataGuard::default() });
            return;
        };
        self.obstacles.clear();
        self.echoes.obstacles(now, &self.trail, &mut self.obstacles);
        self.scans.obstacles(now, &self.trail, &mut self.obstacles);
        let robot_from_trail = self.trail.pose(now).inverse().to_outer();
        for obstacle in &mut self.obstacles {
            obstacle.at = robot_from_trail(obstacle.at);
        }
        self.update_zones(now);
        let radius = self.fields.radius();
        let bounds = Direction::ALL.map(|direction| {
            let bound = self.fields.bound(direction, &motion, &self.obstacles);
            self.zones.lowered(bound, direction, self.fields.paths(direction, &motion), radius)
        });
        let ahead = ahead(&motion.velocity, &bounds);
        let (code, subject) = self.described(bounds[ahead as usize].cause);
        let fields = if self.ranging == Ranging::None { Vec::new() } else { self.shown(&motion, &bounds) };
        let [forward, backward, left, right, turn_left, turn_right] = bounds.map(|bound| bound.speed);
        let message =
            DataGuard { timestamp, forward, backward, left, right, turn_left, turn_right, code, subject, fields };
        out.publish(message);
    }

    /// Takes note of what is in the fields of the configuration.
    fn update_zones(&mut self, now: Instant) {
        if self.zones.is_empty() {
            return;
        }
        self.unseen.clear();
        self.echoes.unseen(now, &mut self.unseen);
        self.scans.unseen(now, &mut self.unseen);
        self.zones.update(&self.obstacles, &self.unseen);
    }

    /// Number of a cause in `docs/holds.md`, and its subject.
    fn described(&self, cause: Option<Cause>) -> (i32, String) {
        let (hold, source) = match cause {
            Some(Cause::Stops(source)) => (Hold::GuardStops, source),
            Some(Cause::Slows(source)) => (Hold::GuardSlows, source),
            Some(Cause::Unknown(source)) => (Hold::GuardUnknown, source),
            Some(Cause::Blind) => return (Hold::GuardBlind.code(), String::new()),
            None => return (0, String::new()),
        };
        let subject = match source {
            Source::Sonar(id) => format!("sonar {id}"),
            Source::Lidar(place) => format!("lidar {}", self.scans.name(place)),
        };
        (hold.code(), subject)
    }

    fn shown(&mut self, motion: &Motion, bounds: &[Bound; 6]) -> Vec<Field> {
        let direction = if motion.velocity.vx < -STANDSTILL_MPS { Direction::Backward } else { Direction::Forward };
        let shown = self.fields.shown(motion, &bounds[direction as usize], direction);
        let kinds = [Field::PROTECTIVE, Field::WARNING].into_iter();
        let field = |(kind, (corners, occupied)): (i8, (Vec<navitools::Point>, bool))| {
            let (x, y) = corners.into_iter().map(|corner| (corner.x, corner.y)).unzip();
            Field { kind, occupied, x, y }
        };
        let speed = libm::hypot(motion.velocity.vx, motion.velocity.vy);
        kinds.zip(shown).map(field).chain(self.zones.shown(speed)).collect()
    }
}

/// Direction of travel; at standstill the one along x that is bounded most.
fn ahead(velocity: &Twist, bounds: &[Bound; 6]) -> Direction {
    let back = bounds[Direction::Backward as usize].speed < bounds[Direction::Forward as usize].speed;
    match velocity.vx {
        vx if vx > STANDSTILL_MPS => Direction::Forward,
        vx if vx < -STANDSTILL_MPS || back => Direction::Backward,
        _ => Direction::Forward,
    }
}

impl Module for Guard {
    fn subscriptions(&self) -> &[Channel] {
        &self.subscriptions
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.deadlines.set(Timer::Publish, now);
                out.working();
            }
            Event::Message { at, message: Message::LlDataRanges(ranges), .. } => {
                self.echoes.on_ranges(at.min(now), ranges, &self.trail);
            }
            Event::Message { at, message: Message::LlDataScan(scan), .. } => self.on_scan(now, at.min(now), scan, out),
            Event::Message { at, message: Message::LlDataMotion(motion), .. } => self.on_motion(at.min(now), motion),
            Event::Message { at, message: Message::LlDataVelocity(velocity), .. } if self.fields.base().turns => {
                self.on_velocity(at.min(now), velocity);
            }
            _ => {}
        }
        let found = self.deadlines.take(Timer::Found, now);
        if found {
            self.found = now;
        }
        if self.deadlines.tick(Timer::Publish, now, PERIOD) || found {
            self.publish(now, out);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }
}

#[cfg(test)]
mod tests;
