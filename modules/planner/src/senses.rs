//! What the planner knows of the robot from others: where it is, how it moves, and what stands against driving.

use base::{Duration, Instant};
use messages::lowlevel::{DataMotion, EventStop};
use messages::middlelevel::DataEstimate;
use module::State;
use navitools::{Motion as Moved, Pose};
use std::collections::VecDeque;

/// An estimate that is older is none: the same as `driver_canbus` has.
const ESTIMATE_OLD: Duration = Duration::from_millis(200);
/// `LL_DATA_MOTION` comes at 20 Hz.
const MOTION_OLD: Duration = Duration::from_millis(500);
/// Sonars come at 4 Hz.
const SONARS_OLD: Duration = Duration::from_secs(1);
/// Poses are kept so long: a sonar's reading is at most 0.3 s old.
const HISTORY: Duration = Duration::from_millis(600);
/// How old a reading is on average when it arrives: half of a poll, the slot, and the bus.
pub(crate) const READING_AGE: Duration = Duration::from_millis(170);
/// An estimator whose time went back for this long was started anew.
const STARTED_ANEW: Duration = Duration::from_secs(1);
/// The estimate has jumped: the robot was put elsewhere, or found itself; m and rad.
const JUMP: (f64, f64) = (0.5, 0.5);

/// Where the robot was.
#[derive(Clone, Copy, Debug)]
pub struct Located {
    /// When that was received.
    pub at: Instant,
    /// Where.
    pub pose: Pose,
    /// How it moved.
    pub moved: Moved,
    /// Deviation of the position, m.
    pub sigma: f64,
}

/// What came of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It goes on from the one before.
    Well,
    /// It is somewhere else altogether.
    Jumped,
    /// It is not a number.
    Nonsense,
    /// It is older than the one before.
    Backwards,
}

/// Everything heard that the driving depends on.
#[derive(Debug, Default)]
pub struct Senses {
    /// The module's own state.
    pub state: Option<State>,
    estimates: VecDeque<Located>,
    quality: Option<i8>,
    /// Of the last estimate that was taken, and when.
    stamp: Option<(i64, Instant)>,
    motion: Option<(Instant, DataMotion)>,
    paused: Option<String>,
    sonars: Option<Instant>,
}

impl Senses {
    /// An estimate.
    pub fn on_estimate(&mut self, at: Instant, estimate: &DataEstimate) -> Taken {
        let DataEstimate { x, y, theta, speed, rotation, covariance, .. } = *estimate;
        let within = [x, y, theta].iter().all(|value| value.abs() < 1e5);
        let [[sxx, ..], [_, syy, _], _] = covariance;
        let moves = speed.abs() < 10.0 && rotation.abs() < 10.0;
        if !(within && moves && (sxx + syy).is_finite()) {
            self.estimates.clear();
            return Taken::Nonsense;
        }
        if let Some((last, heard)) = self.stamp
            && estimate.timestamp <= last
            && at.since(heard) < STARTED_ANEW
        {
            return Taken::Backwards;
        }
        self.stamp = Some((estimate.timestamp, at));
        self.quality = Some(estimate.quality);
        if estimate.quality < DataEstimate::COARSE {
            self.estimates.clear();
            return Taken::Well;
        }
        let sigma = libm::sqrt((sxx + syy).max(0.0) / 2.0);
        let moved = Moved { translation: speed, rotation };
        let now = Located { at, pose: Pose::new(x, y, theta), moved, sigma };
        let expected = self.estimates.back().map(|last| last.pose_at(at));
        let jumped = expected.is_none_or(|expected| {
            let turned = (now.pose.theta - expected.theta).radians().abs();
            expected.point().distance(now.pose.point()) > JUMP.0 || turned > JUMP.1
        });
        while self.estimates.front().is_some_and(|old| at.since(old.at) > HISTORY) {
            self.estimates.pop_front();
        }
        self.estimates.push_back(now);
        if jumped { Taken::Jumped } else { Taken::Well }
    }

    /// The drives.
    pub fn on_motion(&mut self, at: Instant, motion: &DataMotion) {
        let sane = motion.speed.is_finite() && motion.steering.is_finite();
        self.motion = sane.then(|| (at, motion.clone()));
    }

    /// The PAUSE line.
    pub fn on_stop(&mut self, stop: &EventStop) {
        self.paused = stop.engaged.then(|| stop.source.clone());
    }

    /// A round of the sonars, whatever they heard.
    pub fn on_sonars(&mut self, at: Instant) {
        self.sonars = Some(at);
    }

    /// Where the robot is at `now`.
    #[must_use]
    pub fn located(&self, now: Instant) -> Option<Located> {
        let last = self.estimates.back().filter(|last| now.since(last.at) < ESTIMATE_OLD)?;
        Some(Located { pose: last.pose_at(now), at: now, ..*last })
    }

    /// Where the robot was when sonars were fired whose readings were received at `at`.
    #[must_use]
    pub fn when_fired(&self, at: Instant) -> Option<Located> {
        let back = at.since(Instant::ZERO + READING_AGE);
        let fired = Instant::ZERO + back;
        let before = self.estimates.iter().rev().find(|known| known.at <= fired).or(self.estimates.front())?;
        Some(Located { pose: before.pose_at(fired), at: fired, ..*before })
    }

    /// How fast the robot goes and how its wheels stand; standing where the drives are not heard.
    #[must_use]
    pub fn motion(&self) -> crate::track::Motion {
        let motion = self.motion.as_ref().map(|(_, motion)| motion);
        motion.map_or_else(Default::default, |motion| crate::track::Motion {
            speed: motion.speed,
            steering: motion.steering,
        })
    }

    /// Whether `driver_canbus` does what the planner says.
    #[must_use]
    pub fn holds(&self, source: &str) -> bool {
        self.motion.as_ref().is_some_and(|(_, motion)| motion.source == source && motion.reason.is_empty())
    }

    /// What stands against driving at `now`, in words; none: nothing.
    #[must_use]
    pub fn objection(&self, now: Instant, source: &str) -> Option<String> {
        match self.state {
            Some(State::Run) => {}
            Some(state) => return Some(format!("{source} is in {state}")),
            None => return Some(format!("{source} has not started")),
        }
        if let Some(source) = &self.paused {
            return Some(format!("waits: PAUSE is engaged by {source}"));
        }
        match self.quality {
            _ if self.located(now).is_some() => {}
            None => return Some("waits for an estimate".into()),
            Some(DataEstimate::LOST) => return Some("waits: the estimator is lost".into()),
            Some(DataEstimate::SEARCHING) => return Some("waits: the estimator searches where the robot is".into()),
            Some(_) => return Some("waits: the estimate is old or no number".into()),
        }
        if self.sonars.is_none_or(|at| now.since(at) >= SONARS_OLD) {
            return Some("waits: the sonars are not heard".into());
        }
        let motion = self.motion.as_ref().filter(|(at, _)| now.since(*at) < MOTION_OLD);
        let Some((_, motion)) = motion else { return Some("waits: driver_canbus is not heard".into()) };
        if motion.reason.contains(LATCHED) {
            return Some(format!("waits for an operator: a goal given anew, or {source} RUN by hand"));
        }
        if !motion.source.is_empty() && motion.source != source {
            return Some(format!("waits: {} drives the robot", motion.source));
        }
        match motion.reason.as_str() {
            "" if motion.source == source => None,
            "" | NOBODY => Some("begins".into()),
            reason => Some(format!("waits: {reason}")),
        }
    }
}

/// Words of `driver_canbus`: the planner is latched out.
const LATCHED: &str = "must be let go by an operator";
/// And: it has heard of no source yet.
const NOBODY: &str = "nobody commands the motion";

impl Located {
    /// Where it has come to, or came from, by going on as it moved.
    fn pose_at(&self, at: Instant) -> Pose {
        let time = at.since(self.at).as_secs_f64() - self.at.since(at).as_secs_f64();
        let time = time.clamp(-0.5, 0.5);
        let Moved { translation, rotation } = self.moved;
        self.pose.along(Moved { translation: translation * time, rotation: rotation * time })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn estimate(stamp: i64, x: f64) -> DataEstimate {
        DataEstimate { timestamp: stamp, x, speed: 1.0, quality: DataEstimate::FINE, ..Default::default() }
    }

    fn ready() -> Senses {
        let mut senses = Senses { state: Some(State::Run), ..Senses::default() };
        senses.on_estimate(ms(1000), &estimate(1, 0.0));
        senses.on_sonars(ms(1000));
        senses.on_motion(ms(1000), &DataMotion { source: "planner".into(), ..Default::default() });
        senses
    }

    fn why(senses: &Senses, at: u64) -> String {
        senses.objection(ms(at), "planner").unwrap_or_default()
    }

    #[test]
    fn nothing_stands_against_driving_when_all_is_well() {
        assert_eq!(why(&ready(), 1100), "");
        assert!(ready().holds("planner"));
    }

    #[test]
    fn what_stands_against_driving_is_said_in_words() {
        let mut senses = ready();
        senses.state = Some(State::Pause);
        assert_eq!(why(&senses, 1100), "planner is in PAUSE");
        let mut senses = ready();
        senses.on_stop(&EventStop { timestamp: 0, engaged: true, source: "button".into() });
        assert_eq!(why(&senses, 1100), "waits: PAUSE is engaged by button");
        let mut senses = ready();
        senses.on_estimate(ms(1050), &DataEstimate { quality: DataEstimate::LOST, ..estimate(2, 0.0) });
        assert_eq!(why(&senses, 1100), "waits: the estimator is lost");
        assert_eq!(why(&ready(), 1200), "waits: the estimate is old or no number");
        let mut senses = ready();
        senses.on_estimate(ms(2000), &estimate(3, 0.0));
        assert_eq!(why(&senses, 2000), "waits: the sonars are not heard");
        senses.on_sonars(ms(2000));
        assert_eq!(why(&senses, 2000), "waits: driver_canbus is not heard");
    }

    #[test]
    fn a_latched_planner_waits_for_an_operator_by_name() {
        let mut senses = ready();
        let says = |senses: &mut Senses, source: &str, reason: &str| {
            let motion = DataMotion { source: source.into(), reason: reason.into(), ..Default::default() };
            senses.on_motion(ms(1100), &motion);
        };
        says(&mut senses, "", "planner must be let go by an operator first");
        assert_eq!(why(&senses, 1100), "waits for an operator: a goal given anew, or planner RUN by hand");
        says(&mut senses, "web", "");
        assert_eq!(why(&senses, 1100), "waits: web drives the robot");
        says(&mut senses, "", "the steering is not homed");
        assert_eq!(why(&senses, 1100), "waits: the steering is not homed");
        says(&mut senses, "", "nobody commands the motion");
        assert_eq!(why(&senses, 1100), "begins");
    }

    #[test]
    fn an_estimate_is_carried_on_to_now_and_back_to_when_the_sonars_were_fired() {
        let mut senses = ready();
        for n in 1..=6 {
            senses.on_estimate(ms(1000 + 50 * n), &estimate(1 + n as i64, 0.05 * n as f64));
        }
        assert!((senses.located(ms(1340)).unwrap().pose.x - 0.34).abs() < 1e-9);
        assert!((senses.when_fired(ms(1300)).unwrap().pose.x - 0.13).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_number_or_runs_backwards_is_no_estimate() {
        let mut senses = ready();
        assert_eq!(senses.on_estimate(ms(1050), &estimate(0, 0.0)), Taken::Backwards);
        assert_eq!(senses.on_estimate(ms(1050), &estimate(2, 0.05)), Taken::Well);
        assert_eq!(senses.on_estimate(ms(1100), &estimate(3, 5.0)), Taken::Jumped);
        assert_eq!(senses.on_estimate(ms(1150), &estimate(4, f64::NAN)), Taken::Nonsense);
        assert!(senses.located(ms(1150)).is_none());
        // A new estimator counts from elsewhere.
        assert_eq!(senses.on_estimate(ms(2200), &estimate(-9, 5.0)), Taken::Jumped);
        assert!(senses.located(ms(2200)).is_some());
    }

    #[test]
    fn an_estimate_that_jumps_on_its_first_word_is_where_the_robot_is() {
        let mut senses = Senses::default();
        assert_eq!(senses.on_estimate(ms(5), &estimate(1, 3.0)), Taken::Jumped);
        assert_eq!(senses.located(ms(5)).unwrap().pose.x, 3.0);
    }
}
