//! Speed limits on the path: the robot can stop before an obstacle and before a tracked person, by the law of the
//! guard. So it seldom reaches the bounds of the guard, which brakes for every echo, whatever the path.

use crate::config::{Body, Config};
use crate::obstacles::{Hit, Obstacles};
use crate::people::Person;
use crate::track::Sample;
use base::{Duration, Instant};
use kinematics::Direction;
use navitools::{Point, Pose};

/// Distance along the path that is checked, m; a leg returns an echo up to 2.5 m.
const HORIZON_M: f64 = 2.5;
/// Distance between the checked poses, m.
const STRIDE_M: f64 = 0.10;
/// Time for which free space remains valid at full speed.
const FREE_SPACE_VALID_FOR: Duration = Duration::from_secs(1);
/// Distance by which the robot may still approach an obstacle that is already within the margin, m.
const APPROACH_MAX_M: f64 = 0.03;
/// Lateral distance from an obstacle below which the robot slows down, m.
const LATERAL_SLOW_M: f64 = 0.45;
/// Speed beside an obstacle that is almost touched, m/s, and its increase per metre of distance, 1/s.
const LATERAL_SPEED_MPS: f64 = 0.30;
const LATERAL_SPEED_GAIN: f64 = 1.1;
/// Increase of the distance to the middle of a person (`people_margin_m`) per standard deviation of the position, m/m,
/// and of the velocity each second.
const PERSON_DISTANCE_PER_SIGMA: f64 = 0.2;
/// Speed at which a person may leave the predicted path, m/s.
const PERSON_DEVIATION_MPS: f64 = 0.05;
/// Speed of the robot above which both count, m/s.
const PERSON_DEVIATION_FROM_MPS: f64 = 0.21;
/// Assumed speed of an unknown person, m/s, for the range from which people are considered.
const PERSON_SPEED_ASSUMED_MPS: f64 = 0.5;
/// Distance within `people_margin_m` from which on the robot does not approach a person further, m.
const PERSON_WITHIN_M: f64 = 0.03;
/// Distance from a person below which the speed is limited, m, and the limit, m/s.
const PERSON_BESIDE_M: f64 = 0.40;
const PERSON_BESIDE_SPEED_MPS: f64 = 0.2;
/// Tolerance of a comparison of distances, m.
const ROUNDING_M: f64 = 1e-9;
/// Steps of the tried speeds, m/s, and times, s.
const SPEED_STEP_MPS: f64 = 0.05;
const TIME_STEP_S: f64 = 0.2;
/// Distance between the poses of the predicted path, m, and their number; longer than the longest stop.
const PATH_STEP_M: f64 = 0.08;
const PATH_STEPS: usize = 12;
/// Upper bounds of the stop from full speed: distance, m, and time, s.
const STOP_DISTANCE_MAX_M: f64 = 0.9;
const STOP_TIME_MAX_S: f64 = 1.6;
/// Speed below which the robot is considered to stand, m/s.
const SPEED_MIN_MPS: f64 = 0.05;

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
    pub fn check(now: Instant, ahead: &[Sample], obstacles: &Obstacles, config: &Config) -> Self {
        let Some(here) = ahead.first() else { return Self::default() };
        let (body, behaviour) = (&config.body, &config.behaviour);
        let reach = HORIZON_M + body.front + LATERAL_SLOW_M;
        let near = |hit: &Hit| hit.at.distance(here.pose.point()) < reach;
        // An obstacle that is already closer may be left behind, but not approached.
        let here_from_map = here.pose.inverse().to_outer();
        let keep = |hit: &Hit| (gap(body, here_from_map(hit.at)) - APPROACH_MAX_M).min(behaviour.margin);
        let mut hits: Vec<(Hit, f64, bool)> =
            obstacles.hits().filter(near).map(|hit| (hit, keep(&hit), false)).collect();
        // Farther from the body an obstacle neither stops nor slows.
        let far = LATERAL_SLOW_M.max(behaviour.margin) + ROUNDING_M;
        let is_far = |Point { x, y }| x < -body.rear - far || x > body.front + far || y.abs() > body.width / 2.0 + far;
        let mut found = Self::default();
        let (mut next, mut last) = (here.distance, None);
        for sample in ahead.iter().take_while(|sample| sample.distance <= here.distance + HORIZON_M) {
            if sample.distance < next && last == Some(sample.direction) {
                continue;
            }
            (next, last) = (sample.distance + STRIDE_M, Some(sample.direction));
            let there_from_map = sample.pose.inverse().to_outer();
            let mut beside = LATERAL_SLOW_M;
            for (hit, keep, touched) in hits.iter_mut().filter(|(.., touched)| !touched) {
                let at = there_from_map(hit.at);
                if is_far(at) {
                    continue;
                }
                let gap = gap(body, at);
                if gap <= *keep {
                    *touched = true;
                    found.contacts.push((sample.distance, hit.closing));
                    found.first = found.first.or(Some((sample.distance, hit.at)));
                } else if at.x > -body.rear || sample.direction != Direction::Forward {
                    beside = beside.min(gap);
                }
            }
            if beside < LATERAL_SLOW_M {
                found.slow.push((
                    sample.distance,
                    LATERAL_SPEED_MPS + LATERAL_SPEED_GAIN * (beside - behaviour.margin).max(0.0),
                ));
            }
            let nose = sample.pose * nose(body, sample.direction);
            let ours = (sample.distance - here.distance) < STRIDE_M;
            if !ours && !obstacles.seen_within(now, nose, FREE_SPACE_VALID_FOR) {
                found.slow.push((sample.distance, behaviour.speed_unseen));
            }
        }
        found
    }

    /// First obstacle on the path, and the distance along the track at which the robot would touch it, m.
    #[must_use]
    pub fn first(&self) -> Option<(f64, Point)> {
        self.first
    }

    /// Highest speed at `distance` along the track, m/s; 0 to stop.
    #[must_use]
    pub fn speed(&self, distance: f64, config: &Config) -> f64 {
        let (limits, behaviour) = (&config.limits, &config.behaviour);
        let mut speed = limits.speed;
        for &(contact, closing) in &self.contacts {
            speed = speed.min(config.law.stops_before(contact - distance - behaviour.stop_distance, closing));
        }
        for &(place, slow) in &self.slow {
            // Braking begins early enough to reach that speed there.
            let left = (place - distance - speed * config.law.reaction).max(0.0);
            speed = speed.min(libm::sqrt(slow * slow + 2.0 * 0.5 * limits.deceleration * left));
        }
        if speed < SPEED_MIN_MPS { 0.0 } else { speed }
    }
}

/// Highest speed from which the robot can stop before it touches a tracked person, m/s, if it continues along `ahead`
/// and each person continues at the estimated velocity with some deviation. A person who walks into the standing robot
/// is not considered.
#[must_use]
pub fn person_speed_limit(now: Instant, ahead: &[Sample], obstacles: &Obstacles, config: &Config) -> f64 {
    let (body, limits) = (&config.body, &config.limits);
    let Some(path) = PredictedPath::of(ahead) else { return limits.speed };
    let here = path.0[0].inverse();
    let mut speed = limits.speed;
    for person in obstacles.people(now).filter(|person| person.confirmed) {
        let gap = gap(body, here * person.at);
        let goes = libm::hypot(person.velocity.0, person.velocity.1);
        // A person farther away cannot arrive within the longest stop.
        let reach = STOP_DISTANCE_MAX_M
            + config.behaviour.people_margin
            + (goes + PERSON_SPEED_ASSUMED_MPS + person.velocity_sigma) * STOP_TIME_MAX_S;
        if gap > reach {
            continue;
        }
        if gap < PERSON_BESIDE_M {
            speed = speed.min(PERSON_BESIDE_SPEED_MPS);
        }
        while speed > 0.0 && !path.is_free(speed, &person, gap, config) {
            speed = if speed > SPEED_STEP_MPS { speed - SPEED_STEP_MPS } else { 0.0 };
        }
    }
    if speed < SPEED_MIN_MPS { 0.0 } else { speed }
}

/// Predicted poses of the robot on the path, every [`PATH_STEP_M`].
struct PredictedPath([Pose; PATH_STEPS]);

impl PredictedPath {
    fn of(ahead: &[Sample]) -> Option<Self> {
        let first = ahead.first()?;
        let mut poses = [first.pose; PATH_STEPS];
        let mut rest = ahead.iter().take_while(|sample| sample.direction == first.direction).peekable();
        for step in 1..PATH_STEPS {
            poses[step] = poses[step - 1];
            while let Some(sample) =
                rest.next_if(|sample| sample.distance <= first.distance + PATH_STEP_M * step as f64)
            {
                poses[step] = sample.pose;
            }
        }
        Some(Self(poses))
    }

    /// Pose after `went` m; beyond the known path the last pose.
    fn at(&self, went: f64) -> Pose {
        let step = ((went / PATH_STEP_M) as usize).min(PATH_STEPS - 2);
        let (from, to) = (self.0[step], self.0[step + 1]);
        let share = (went / PATH_STEP_M - step as f64).min(1.0);
        let between = |from: f64, to: f64| from + share * (to - from);
        let theta = from.theta.radians() + share * (to.theta - from.theta).radians();
        Pose::new(between(from.x, to.x), between(from.y, to.y), theta)
    }

    /// Unit vector from the end of the path to its start; zero if it has no length, as on the spot.
    fn backwards(&self) -> (f64, f64) {
        let (from, to) = (self.0[PATH_STEPS - 1], self.0[0]);
        let length = from.point().distance(to.point());
        if length > 0.0 { ((to.x - from.x) / length, (to.y - from.y) / length) } else { (0.0, 0.0) }
    }

    /// True if a robot at `speed` that brakes after its reaction time stops before it is too close to a person who is
    /// `gap` m away.
    fn is_free(&self, speed: f64, person: &Person, gap_now: f64, config: &Config) -> bool {
        let (body, a, reaction) = (&config.body, config.limits.deceleration, config.law.reaction);
        let margin = config.behaviour.people_margin;
        // A person that close may be left behind; the closer, the less may the robot approach.
        let closer = APPROACH_MAX_M * ((gap_now - margin + PERSON_WITHIN_M) / 0.2).clamp(0.0, 1.0) + 1e-3;
        let keep = (margin + PERSON_DISTANCE_PER_SIGMA * person.sigma).min(gap_now - closer);
        let (deviation, comes) = if speed <= PERSON_DEVIATION_FROM_MPS {
            (0.0, 0.0)
        } else {
            let deviation = PERSON_DEVIATION_MPS + PERSON_DISTANCE_PER_SIGMA * person.velocity_sigma;
            // One who is not known to stand may come towards the robot, as fast as its velocity is uncertain.
            (deviation, if person.stands { 0.0 } else { person.velocity_sigma })
        };
        let stands = reaction + speed / a;
        // A velocity counts as far as it exceeds its uncertainty.
        let goes = libm::hypot(person.velocity.0, person.velocity.1);
        let known = (1.0 - person.velocity_sigma / goes.max(1e-3)).max(0.0);
        let (back_x, back_y) = self.backwards();
        let (vx, vy) = (person.velocity.0 * known + comes * back_x, person.velocity.1 * known + comes * back_y);
        // To a robot that turns on the spot from anywhere.
        let deviation = if (back_x, back_y) == (0.0, 0.0) { deviation + comes } else { deviation };
        let mut time = TIME_STEP_S;
        loop {
            let time_now = time.min(stands);
            let braking = (time_now - reaction).max(0.0);
            let went = speed * time_now - a * braking * braking / 2.0;
            let pose = self.at(went);
            let at = Point { x: person.at.x + vx * time_now, y: person.at.y + vy * time_now };
            if gap(body, pose.inverse() * at) < keep + deviation * time_now {
                return false;
            }
            if time >= stands {
                return true;
            }
            time += TIME_STEP_S;
        }
    }
}

/// Point of the body that leads in a direction of travel; on the spot the corner at the front.
fn nose(body: &Body, direction: Direction) -> Point {
    let (middle, side) = ((body.front - body.rear) / 2.0, body.width / 2.0);
    let (x, y) = match direction {
        Direction::Forward => (body.front, 0.0),
        Direction::Backward => (-body.rear, 0.0),
        Direction::Left => (middle, side),
        Direction::Right => (middle, -side),
        Direction::TurnLeft => (body.front, side),
        Direction::TurnRight => (body.front, -side),
    };
    Point { x, y }
}

/// Distance of a point in the robot's frame from its body, m; 0 within it.
#[must_use]
pub fn gap(body: &Body, at: Point) -> f64 {
    if let Some(shape) = &body.shape {
        return shape.distance(at);
    }
    let dx = (-body.rear - at.x).max(at.x - body.front).max(0.0);
    let dy = (at.y.abs() - body.width / 2.0).max(0.0);
    if dx == 0.0 || dy == 0.0 { dx + dy } else { libm::hypot(dx, dy) }
}

#[cfg(test)]
mod tests;
