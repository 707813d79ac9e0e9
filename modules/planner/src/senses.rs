//! State of the robot as other modules report it: pose, motion, and the causes that hold the robot.

use crate::goal_state::FRONT;
use crate::path::Move;
use crate::ranges::{READING_VALID_FOR, Sounding};
use crate::track::{Axis, Motion};
use base::{Duration, Instant};
use messages::lowlevel::{DataGuard, DataHold, DataMotion, DataVelocity, EventStop};
use messages::middlelevel::DataEstimate;
use messages::{Hold, MOTION_MODULE, StopSource};
use module::State;
use navitools::{Motion as Moved, Pose};
use std::collections::VecDeque;

/// Maximum age of an estimate; the same limit as in `driver_canbus`.
const ESTIMATE_AGE_MAX: Duration = Duration::from_millis(200);
/// Silence of a source that engages PAUSE after which a person may have overruled it.
const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);
/// Causes by which PAUSE is engaged.
const ENGAGED: [Hold; 9] = [
    Hold::PauseUnknown,
    Hold::PauseFieldUnknown,
    Hold::PauseInputUnknown,
    Hold::PauseBumper,
    Hold::PauseFloor,
    Hold::PauseButton,
    Hold::PauseField,
    Hold::PauseInput,
    Hold::PauseOther,
];
/// Causes by which the pose is unknown.
const ESTIMATE: [Hold; 4] = [Hold::NoEstimate, Hold::EstimateLost, Hold::EstimateSearching, Hold::EstimateBad];
/// Causes by which the angle of the steering is unknown.
const HOMING: [Hold; 4] = [Hold::NotHomed, Hold::Homing, Hold::HomingFailed, Hold::ToBeHomed];
/// Maximum age of `LL_DATA_MOTION` (20 Hz) and `LL_DATA_HOLD` (5 Hz).
const MOTION_AGE_MAX: Duration = Duration::from_millis(500);
/// Maximum age of `LL_DATA_GUARD` (20 Hz).
const GUARD_AGE_MAX: Duration = Duration::from_millis(500);
/// Time for which poses are kept: longer than sonar readings stay valid.
const POSES_KEPT_FOR: Duration = Duration::from_millis(1200);
/// Time after the last `LL_DATA_RANGES` (at least 1 Hz) during which `LL_DATA_SRFS` is ignored.
const RANGES_TIMEOUT: Duration = Duration::from_millis(1500);
/// An estimator whose timestamps run backwards for this long has restarted.
const RESTART_AFTER: Duration = Duration::from_secs(1);
/// Speed below which the robot is at standstill, m/s.
const STANDSTILL_MPS: f64 = 0.03;
/// Change between two estimates that counts as a jump (kidnapped robot, or first fix), m and rad.
const JUMP_MIN: (f64, f64) = (0.5, 0.5);

/// Pose of the robot at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Located {
    /// Instant at which the pose was received.
    pub at: Instant,
    /// Pose in the map, m and rad.
    pub pose: Pose,
    /// Velocity, m/s and rad/s.
    pub moved: Moved,
    /// Velocity to the left, m/s; 0 where it is not measured.
    pub aside: f64,
    /// Standard deviation of the position, m.
    pub sigma: f64,
}

/// Result of the check of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EstimateCheck {
    /// Continues the previous estimate.
    Ok,
    /// Accepted, but far from the previous estimate.
    Jumped,
    /// Rejected: not finite or out of range.
    NotFinite,
    /// Rejected: older than the previous estimate.
    OutOfOrder,
}

/// Received state that driving depends on.
#[derive(Debug, Default)]
pub struct Senses {
    /// State of the planner's own module.
    pub state: Option<State>,
    estimates: VecDeque<Located>,
    quality: Option<i8>,
    /// Timestamp of the last accepted estimate, and the instant of its reception.
    stamp: Option<(i64, Instant)>,
    motion: Option<(Instant, DataMotion)>,
    /// Measured velocity of a base that turns on the spot or goes sideways: forward, to the left, m/s, and rad/s.
    velocity: Option<[f64; 3]>,
    /// Greatest speeds that the guard permits, m/s and rad/s, in the order of `LL_DATA_GUARD`.
    guard: Option<(Instant, [f64; 6])>,
    /// Causes reported by `driver_canbus` that hold the robot.
    holds: Option<(Instant, DataHold)>,
    /// When PAUSE was last reported engaged, the cause, and the name of the source as reported.
    paused: Option<(Instant, Hold, String)>,
    /// Firing instant of the newest sonar reading.
    sonars: Option<Instant>,
    /// Reception of the last `LL_DATA_RANGES`.
    ranges: Option<Instant>,
}

impl Senses {
    /// Processes `ML_DATA_ESTIMATE`.
    pub fn on_estimate(&mut self, at: Instant, estimate: &DataEstimate) -> EstimateCheck {
        let DataEstimate { x, y, theta, speed, rotation, covariance, .. } = *estimate;
        let within = [x, y, theta].iter().all(|value| value.abs() < 1e5);
        let [[sxx, ..], [_, syy, _], _] = covariance;
        let moves = speed.abs() < 10.0 && rotation.abs() < 10.0;
        if !(within && moves && (sxx + syy).is_finite()) {
            self.estimates.clear();
            return EstimateCheck::NotFinite;
        }
        if let Some((last, received)) = self.stamp
            && estimate.timestamp <= last
            && at.since(received) < RESTART_AFTER
        {
            return EstimateCheck::OutOfOrder;
        }
        self.stamp = Some((estimate.timestamp, at));
        self.quality = Some(estimate.quality);
        if estimate.quality < DataEstimate::COARSE {
            self.estimates.clear();
            return EstimateCheck::Ok;
        }
        let sigma = libm::sqrt((sxx + syy).max(0.0) / 2.0);
        let moved = Moved { translation: speed, rotation };
        let aside = self.velocity.map_or(0.0, |[_, aside, _]| aside);
        let now = Located { at, pose: Pose::new(x, y, theta), moved, aside, sigma };
        let expected = self.estimates.back().map(|last| last.pose_at(at));
        let jumped = expected.is_none_or(|expected| {
            let turned = (now.pose.theta - expected.theta).radians().abs();
            expected.point().distance(now.pose.point()) > JUMP_MIN.0 || turned > JUMP_MIN.1
        });
        while self.estimates.front().is_some_and(|old| at.since(old.at) > POSES_KEPT_FOR) {
            self.estimates.pop_front();
        }
        self.estimates.push_back(now);
        if jumped { EstimateCheck::Jumped } else { EstimateCheck::Ok }
    }

    /// Processes `LL_DATA_MOTION`. Its steering angle is no number while the steering is homed.
    pub fn on_motion(&mut self, at: Instant, motion: &DataMotion) {
        self.motion = Some((at, motion.clone()));
    }

    /// Processes `LL_DATA_VELOCITY` of a base that turns on the spot or goes sideways.
    pub fn on_velocity(&mut self, velocity: &DataVelocity) {
        let velocity = [velocity.vx, velocity.vy, velocity.omega];
        self.velocity = velocity.iter().all(|part| part.is_finite()).then_some(velocity);
    }

    /// Processes `LL_DATA_GUARD`.
    pub fn on_guard(&mut self, at: Instant, guard: &DataGuard) {
        let &DataGuard { forward, backward, left, right, turn_left, turn_right, .. } = guard;
        self.guard = Some((at, [forward, backward, left, right, turn_left, turn_right]));
    }

    /// Greatest speeds that the guard permits with the present steering, m/s and rad/s, in the order of
    /// `LL_DATA_GUARD`; infinite without a guard. A value that is not a number permits nothing.
    #[must_use]
    pub fn permitted(&self, now: Instant) -> [f64; 6] {
        let guard = self.guard.filter(|(at, _)| now.since(*at) < GUARD_AGE_MAX);
        guard.map_or([f64::INFINITY; 6], |(_, bounds)| bounds.map(|bound| bound.max(0.0)))
    }

    /// Processes `LL_DATA_HOLD`.
    pub fn on_hold(&mut self, at: Instant, holds: &DataHold) {
        if holds.is_of_motion() {
            // A source that fell silent may have been overruled: then the driver does not list it any more.
            let lists = ENGAGED.iter().any(|hold| holds.has(*hold));
            self.paused.take_if(|(last, ..)| at.since(*last) >= PAUSE_TIMEOUT && !lists);
            self.holds = Some((at, holds.clone()));
        }
    }

    /// Processes `LL_EVENT_STOP`: state of the PAUSE line, or of another source, which ends nothing of the line, nor
    /// the line anything of it.
    pub fn on_stop(&mut self, at: Instant, stop: &EventStop) {
        let of_line = StopSource::is_of_line(&stop.source);
        let (is_same, stays) = self.paused.as_ref().map_or((false, false), |(.., name)| {
            let was_of_line = StopSource::is_of_line(name);
            (if of_line { was_of_line } else { *name == stop.source }, was_of_line && !of_line)
        });
        if stop.engaged && !stays {
            self.paused = Some((at, StopSource::hold_of(&stop.source), stop.source.clone()));
        } else if !stop.engaged && is_same {
            self.paused = None;
        }
    }

    /// Processes `LL_EVENT_STOP` in the power controller's name, of another sender. What that releases is left to
    /// `driver_canbus`, whose causes hold the robot.
    pub fn on_stop_of_another(&mut self, at: Instant, stop: &EventStop) {
        if stop.engaged && self.paused.is_none() {
            self.paused = Some((at, Hold::PauseOther, stop.source.clone()));
        }
    }

    /// Processes sonar readings.
    pub fn on_soundings(&mut self, soundings: &[Sounding]) {
        let newest = soundings.iter().filter(|sounding| sounding.is_known()).map(|sounding| sounding.at).max();
        self.sonars = self.sonars.max(newest);
    }

    /// Notes the reception of `LL_DATA_RANGES`.
    pub fn on_ranges(&mut self, at: Instant) {
        self.ranges = Some(at);
    }

    /// True if `LL_DATA_RANGES` is missing, so that `LL_DATA_SRFS` (the view of 2011) must be used.
    #[must_use]
    pub fn lacks_ranges(&self, at: Instant) -> bool {
        self.ranges.is_none_or(|last| at.since(last) >= RANGES_TIMEOUT)
    }

    /// Pose extrapolated to `now`; `None` without a recent estimate.
    #[must_use]
    pub fn located(&self, now: Instant) -> Option<Located> {
        let last = self.estimates.back().filter(|last| now.since(last.at) < ESTIMATE_AGE_MAX)?;
        Some(Located { pose: last.pose_at(now), at: now, ..*last })
    }

    /// Pose at the instant at which a sonar fired.
    #[must_use]
    pub fn when_fired(&self, fired: Instant) -> Option<Located> {
        let before = self.estimates.iter().rev().find(|known| known.at <= fired).or(self.estimates.front())?;
        Some(Located { pose: before.pose_at(fired), at: fired, ..*before })
    }

    /// Speed and steering angle of a robot that steers; zero if the drives have not reported them.
    #[must_use]
    pub fn motion(&self) -> Motion {
        let motion = self.motion.as_ref().map(|(_, motion)| motion).filter(|motion| is_known(motion));
        motion.map_or_else(Default::default, |motion| Motion {
            speed: motion.speed,
            steering: motion.steering,
            axis: Axis::Along,
        })
    }

    /// Motion of a robot that turns on the spot or goes sideways, whose farthest corner is `arm` m away and whose
    /// curves have a curvature of `most` 1/m at most. While it drives forward or backward, that counts; else the
    /// greatest part, of the rotation what no curve explains. An unknown motion is not one along any path: it is
    /// infinite.
    #[must_use]
    pub fn motion_of_wheels(&self, arm: f64, most: f64) -> Motion {
        let steering = self.motion().steering;
        let Some([along, aside, rotation]) = self.velocity else {
            return Motion { speed: f64::INFINITY, steering, axis: Axis::Spot };
        };
        let spot = arm * (rotation.abs() - along.abs() * most).max(0.0).copysign(rotation);
        let (speed, axis) = match () {
            () if along.abs() >= STANDSTILL_MPS => (along, Axis::Along),
            () if spot.abs() > aside.abs() && spot.abs() > along.abs() => (spot, Axis::Spot),
            () if aside.abs() > along.abs() => (aside, Axis::Aside),
            () => (along, Axis::Along),
        };
        Motion { speed, steering, axis }
    }

    /// Causes that hold the robot at `now`, the most important one first; empty if it may drive. `source` is the
    /// planner's name; `blind` is true if the state of the front sonars is unknown, and `None` of a robot without
    /// sonars: once readings were received, their silence holds it, too.
    #[must_use]
    pub fn waits(&self, now: Instant, source: &str, blind: Option<bool>) -> Vec<Wait> {
        let mut waits = Vec::new();
        let mut add = |hold, subject: &str| waits.push(Wait::new(hold, subject));
        if let Some(hold) = self.state.unwrap_or(State::Init).hold() {
            add(hold, source);
        }
        if let Some((_, hold, name)) = &self.paused {
            add(*hold, name);
        }
        match self.quality {
            _ if self.located(now).is_some() => {}
            None => add(Hold::NoEstimate, ""),
            Some(DataEstimate::LOST) => add(Hold::EstimateLost, ""),
            Some(DataEstimate::SEARCHING) => add(Hold::EstimateSearching, ""),
            Some(_) => add(Hold::EstimateBad, ""),
        }
        match blind {
            None if self.sonars.is_none() => {}
            _ if self.sonars.is_none_or(|at| now.since(at) >= READING_VALID_FOR) => add(Hold::SonarsSilent, ""),
            Some(true) => add(Hold::SonarsUnknown, FRONT),
            Some(false) | None => {}
        }
        self.add_driver(now, source, &mut waits);
        // Without the angle of the steering there is no odometry, and no estimate: homing comes first.
        let estimate = waits.iter().position(|wait| ESTIMATE.contains(&wait.hold));
        let homing = waits.iter().position(|wait| HOMING.contains(&wait.hold));
        if let (Some(estimate), Some(homing)) = (estimate, homing)
            && estimate < homing
        {
            waits[estimate..=homing].rotate_right(1);
        }
        waits
    }

    /// Adds the causes that `driver_canbus` reports.
    fn add_driver(&self, now: Instant, source: &str, waits: &mut Vec<Wait>) {
        let fresh = |at: &Instant| now.since(*at) < MOTION_AGE_MAX;
        let motion = self.motion.as_ref().filter(|(at, _)| fresh(at));
        let holds = self.holds.as_ref().filter(|(at, _)| fresh(at));
        let (Some((_, motion)), Some((_, list))) = (motion, holds) else {
            waits.push(Wait::new(Hold::ModuleSilent, MOTION_MODULE));
            return;
        };
        if !motion.source.is_empty() && motion.source != source && list.first() != Some(Hold::PlannerLatched) {
            waits.push(Wait::new(Hold::OtherSource, &motion.source));
        }
        for (place, reported) in list.holds.iter().enumerate() {
            // A cause from a later version holds the robot as well.
            let hold = reported.cause().unwrap_or(Hold::ModuleError);
            if hold.is_idle()
                || hold.is_notice()
                || waits.iter().any(|wait| wait.hold == hold && wait.subject == reported.subject)
            {
                continue;
            }
            // The driver's own text contains the figures of its most important cause.
            let text = (place == 0 && motion.timestamp >= list.timestamp).then(|| motion.reason.clone());
            let words = text.filter(|text| !text.is_empty()).unwrap_or_else(|| reported.words());
            waits.push(Wait { hold, subject: reported.subject.clone(), latched: reported.latched, words });
        }
        if waits.is_empty() && !is_known(motion) {
            waits.push(Wait::new(Hold::ModuleSilent, MOTION_MODULE));
        }
        if waits.is_empty() && motion.source != source {
            waits.push(Wait::new(Hold::Starting, ""));
        }
    }
}

/// True if speed and steering angle are numbers.
fn is_known(motion: &DataMotion) -> bool {
    motion.speed.is_finite() && motion.steering.is_finite()
}

/// Cause for which the planner does not drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wait {
    /// Number of the cause.
    pub hold: Hold,
    /// Module, drive or source that the cause concerns; empty if the cause has no subject.
    pub subject: String,
    /// True if the cause remains until a person acts.
    pub latched: bool,
    words: String,
}

impl Wait {
    fn new(hold: Hold, subject: &str) -> Self {
        Self { hold, subject: subject.into(), latched: hold.is_latched(), words: hold.words(subject) }
    }

    /// Text for `ML_DATA_GOAL`. `source` is the planner's name.
    #[must_use]
    pub fn message(&self, source: &str) -> String {
        let Self { hold, subject, words, .. } = self;
        match hold {
            Hold::NoEstimate => "waits for an estimate".into(),
            Hold::Starting => "begins".into(),
            Hold::PlannerLatched if subject == source => {
                format!("waits for an operator: a goal or mode given anew, or {source} RUN by hand")
            }
            Hold::ModuleInit | Hold::ModulePaused | Hold::ModuleStopped | Hold::ModuleError | Hold::ModuleEnding
                if subject == source =>
            {
                words.clone()
            }
            _ => format!("waits: {words}"),
        }
    }
}

impl Located {
    /// Pose extrapolated to `at`, forwards or backwards, at constant velocity.
    fn pose_at(&self, at: Instant) -> Pose {
        let time = at.since(self.at).as_secs_f64() - self.at.since(at).as_secs_f64();
        let time = time.clamp(-0.5, 0.5);
        let Moved { translation, rotation } = self.moved;
        let pose = self.pose.along(Moved { translation: translation * time, rotation: rotation * time });
        if self.aside == 0.0 { pose } else { Move::Aside(self.aside * time).from(pose) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranges::{Measurement, Mount};

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn estimate(stamp: i64, x: f64) -> DataEstimate {
        DataEstimate { timestamp: stamp, x, speed: 1.0, quality: DataEstimate::FINE, ..Default::default() }
    }

    fn holds(timestamp: i64, holds: &[(Hold, &str)]) -> DataHold {
        let row = |&(hold, subject): &(Hold, &str)| messages::lowlevel::Hold {
            code: hold.code(),
            subject: subject.into(),
            latched: hold.is_latched(),
            since: 0,
        };
        DataHold { timestamp, module: MOTION_MODULE.into(), holds: holds.iter().map(row).collect() }
    }

    fn fired(at: Instant, measurement: Measurement) -> [Sounding; 1] {
        [Sounding { id: 0, at, stamp: 0, mount: Mount::default(), measurement }]
    }

    fn ready() -> Senses {
        let mut senses = Senses { state: Some(State::Run), ..Senses::default() };
        senses.on_estimate(ms(1000), &estimate(1, 0.0));
        senses.on_soundings(&fired(ms(1000), Measurement::Silent));
        senses.on_motion(ms(1000), &DataMotion { source: "planner".into(), ..Default::default() });
        senses.on_hold(ms(1000), &holds(0, &[]));
        senses
    }

    #[test]
    fn a_robot_without_sonars_drives_until_readings_were_received_and_ended() {
        let waits = |senses: &Senses, at: u64| senses.waits(ms(at), "planner", None).first().map(|wait| wait.hold);
        let mut senses = Senses { sonars: None, ..ready() };
        assert_eq!(waits(&senses, 1010), None);
        senses.on_soundings(&fired(ms(0), Measurement::Silent));
        senses.on_estimate(ms(2000), &estimate(2, 1.0));
        assert_eq!(waits(&senses, 2010), Some(Hold::SonarsSilent));
    }

    /// Causes, and the text of the first.
    fn why(senses: &Senses, at: u64) -> (Vec<(Hold, String)>, String) {
        let waits = senses.waits(ms(at), "planner", Some(false));
        let text = waits.first().map_or(String::new(), |wait| wait.message("planner"));
        (waits.into_iter().map(|wait| (wait.hold, wait.subject)).collect(), text)
    }

    fn one(hold: Hold, subject: &str, text: &str) -> (Vec<(Hold, String)>, String) {
        (vec![(hold, subject.into())], text.into())
    }

    #[test]
    fn nothing_holds_the_robot_when_all_is_well() {
        assert_eq!(why(&ready(), 1100), (vec![], String::new()));
    }

    #[test]
    fn each_cause_has_its_number_and_its_text() {
        let mut senses = ready();
        senses.state = Some(State::Pause);
        assert_eq!(why(&senses, 1100), one(Hold::ModulePaused, "planner", "planner is in PAUSE"));
        let mut senses = ready();
        senses.on_stop(ms(1000), &EventStop { timestamp: 0, engaged: true, source: "button".into() });
        assert_eq!(why(&senses, 1100), one(Hold::PauseButton, "button", "waits: PAUSE is engaged by button"));
        let mut senses = ready();
        senses.on_estimate(ms(1050), &DataEstimate { quality: DataEstimate::LOST, ..estimate(2, 0.0) });
        assert_eq!(why(&senses, 1100), one(Hold::EstimateLost, "", "waits: the estimator is lost"));
        let old = one(Hold::EstimateBad, "", "waits: the estimate is old or no number");
        assert_eq!(why(&ready(), 1200), old);
        let fresh = Senses { estimates: VecDeque::new(), quality: None, ..ready() };
        assert_eq!(why(&fresh, 1100), one(Hold::NoEstimate, "", "waits for an estimate"));
        let mut senses = ready();
        senses.on_estimate(ms(2000), &estimate(3, 0.0));
        senses.on_motion(ms(2000), &DataMotion { source: "planner".into(), ..Default::default() });
        senses.on_hold(ms(2000), &holds(0, &[]));
        assert_eq!(why(&senses, 2000), one(Hold::SonarsSilent, "", "waits: the sonars do not report"));
        senses.on_soundings(&fired(ms(2000), Measurement::Unknown));
        assert_eq!(why(&senses, 2000).0.len(), 1, "messages of dead sonars are no readings");
        senses.on_soundings(&fired(ms(2000), Measurement::NoEcho));
        assert_eq!(why(&senses, 2000).0, []);
        let silent = one(Hold::ModuleSilent, MOTION_MODULE, "waits: driver_canbus does not report");
        senses.on_estimate(ms(2500), &estimate(4, 0.5));
        senses.on_motion(ms(2500), &DataMotion { source: "planner".into(), ..Default::default() });
        assert_eq!(why(&senses, 2500), silent, "LL_DATA_HOLD is missing");
    }

    #[test]
    fn a_source_of_pause_that_was_overruled_does_not_hold_the_planner() {
        let mut senses = ready();
        senses.on_stop(ms(1000), &EventStop { timestamp: 0, engaged: true, source: "button".into() });
        let hear = |senses: &mut Senses, at: u64, causes: &[(Hold, &str)]| {
            senses.on_estimate(ms(at), &estimate(2, 0.0));
            senses.on_motion(ms(at), &DataMotion { source: "planner".into(), ..Default::default() });
            senses.on_hold(ms(at), &holds(0, causes));
            senses.on_soundings(&fired(ms(at), Measurement::NoEcho));
        };
        hear(&mut senses, 1100, &[]);
        assert_eq!(why(&senses, 1100).0, [(Hold::PauseButton, "button".into())], "the driver has not heard of it yet");
        hear(&mut senses, 2200, &[(Hold::PauseButton, "button")]);
        assert_eq!(why(&senses, 2200).0, [(Hold::PauseButton, "button".into())]);
        hear(&mut senses, 2300, &[]);
        assert_eq!(why(&senses, 2300).0, []);
    }

    #[test]
    fn another_sender_engages_no_bumper_and_releases_nothing_of_the_line() {
        let stop = |engaged, source: &str| EventStop { timestamp: 0, engaged, source: source.into() };
        let mut senses = ready();
        senses.on_stop_of_another(ms(1000), &stop(true, "bumper2"));
        assert_eq!(why(&senses, 1100).0, [(Hold::PauseOther, "bumper2".into())]);
        senses.on_stop(ms(1010), &stop(true, "button"));
        senses.on_stop_of_another(ms(1020), &stop(false, ""));
        assert_eq!(why(&senses, 1100).0, [(Hold::PauseButton, "button".into())]);
    }

    #[test]
    fn the_line_and_the_fields_of_a_lidar_do_not_end_each_other() {
        let stop = |engaged, source: &str| EventStop { timestamp: 0, engaged, source: source.into() };
        let mut senses = ready();
        let field = [(Hold::PauseField, "lidar.front".to_owned())];
        senses.on_stop(ms(1000), &stop(true, "lidar.front"));
        senses.on_stop(ms(1010), &stop(false, ""));
        assert_eq!(why(&senses, 1100).0, field);
        senses.on_stop(ms(1020), &stop(true, "button"));
        senses.on_stop(ms(1030), &stop(false, "lidar.front"));
        senses.on_stop(ms(1040), &stop(true, "lidar.rear"));
        assert_eq!(why(&senses, 1100).0, [(Hold::PauseButton, "button".into())]);
        senses.on_stop(ms(1050), &stop(false, ""));
        senses.on_stop(ms(1060), &stop(true, "lidar.front"));
        senses.on_stop(ms(1070), &stop(false, "lidar.rear"));
        assert_eq!(why(&senses, 1100).0, field);
        senses.on_stop(ms(1080), &stop(false, "lidar.front"));
        assert_eq!(why(&senses, 1100).0, []);
    }

    #[test]
    fn each_cause_is_listed_once() {
        let mut senses = ready();
        senses.on_stop(ms(1000), &EventStop { timestamp: 0, engaged: true, source: "bumper2".into() });
        senses.on_estimate(ms(1050), &DataEstimate { quality: DataEstimate::SEARCHING, ..estimate(2, 0.0) });
        let stands = [(Hold::PauseBumper, "bumper2"), (Hold::DriveFault, "propulsion"), (Hold::NobodyCommands, "")];
        senses.on_motion(ms(1050), &DataMotion::default());
        senses.on_hold(ms(1050), &holds(0, &stands));
        let all = [
            (Hold::PauseBumper, "bumper2".to_owned()),
            (Hold::EstimateSearching, String::new()),
            (Hold::DriveFault, "propulsion".to_owned()),
        ];
        assert_eq!(why(&senses, 1100).0, all);
    }

    #[test]
    fn a_latched_planner_waits_for_an_operator() {
        let mut senses = ready();
        let says = |senses: &mut Senses, source: &str, stands: &[(Hold, &str)], reason: &str| {
            let motion = DataMotion { source: source.into(), reason: reason.into(), ..Default::default() };
            senses.on_motion(ms(1100), &motion);
            senses.on_hold(ms(1100), &holds(0, stands));
        };
        says(&mut senses, "", &[(Hold::PlannerLatched, "planner")], "");
        let text = "waits for an operator: a goal or mode given anew, or planner RUN by hand";
        assert_eq!(why(&senses, 1100), one(Hold::PlannerLatched, "planner", text));
        says(&mut senses, "web", &[], "");
        assert_eq!(why(&senses, 1100), one(Hold::OtherSource, "web", "waits: web drives the robot"));
        says(&mut senses, "", &[(Hold::NotHomed, "steering")], "the steering is not homed yet");
        assert_eq!(why(&senses, 1100), one(Hold::NotHomed, "steering", "waits: the steering is not homed yet"));
        // The driver's text contains figures; it is used if it belongs to the same list of causes.
        let fault = [(Hold::DriveFault, "propulsion")];
        says(&mut senses, "", &fault, "the propulsion drive is in fault, error code 0x2310");
        assert_eq!(why(&senses, 1100).1, "waits: the propulsion drive is in fault, error code 0x2310");
        senses.on_hold(ms(1100), &holds(1, &fault));
        assert_eq!(why(&senses, 1100).1, "waits: the propulsion drive is in fault");
        says(&mut senses, "", &[(Hold::NobodyCommands, "")], "nobody commands the motion");
        assert_eq!(why(&senses, 1100), one(Hold::Starting, "", "begins"));
    }

    #[test]
    fn other_sentences_for_the_same_causes_change_nothing() {
        let mut senses = ready();
        for (stands, source, drives) in [
            (&[][..], "planner", true),
            (&[(Hold::NobodyCommands, "")], "", false),
            (&[(Hold::Homing, "x")], "", false),
        ] {
            for reason in ["", "nobody commands the motion", "must be let go by an operator", "reworded"] {
                let motion = DataMotion { source: source.into(), reason: reason.into(), ..Default::default() };
                senses.on_motion(ms(1100), &motion);
                senses.on_hold(ms(1100), &holds(0, stands));
                let causes = why(&senses, 1100).0;
                assert_eq!(causes.is_empty(), drives, "{reason:?} {causes:?}");
                let starting = causes.iter().any(|(hold, _)| *hold == Hold::Starting);
                assert_eq!(starting, stands == [(Hold::NobodyCommands, "")], "{reason:?}");
            }
        }
    }

    #[test]
    fn a_steering_angle_that_is_not_known_hides_no_cause_and_holds_the_robot() {
        let mut senses = ready();
        let motion = |source: &str, steering| DataMotion { source: source.into(), steering, ..Default::default() };
        senses.on_motion(ms(1100), &motion("", f64::NAN));
        senses.on_hold(ms(1100), &holds(0, &[(Hold::Homing, "steering")]));
        assert_eq!(why(&senses, 1100), one(Hold::Homing, "steering", "waits: the steering is being homed"));
        assert_eq!(senses.motion().steering.to_bits(), 0);
        senses.on_motion(ms(1150), &motion("planner", f64::NAN));
        senses.on_hold(ms(1150), &holds(0, &[]));
        assert_eq!(why(&senses, 1150).0, [(Hold::ModuleSilent, MOTION_MODULE.into())]);
        senses.on_motion(ms(1150), &motion("planner", 0.0));
        assert_eq!(why(&senses, 1150).0, []);
    }

    #[test]
    fn a_steering_that_is_not_homed_is_named_before_the_estimate_that_it_costs() {
        for hold in [Hold::ToBeHomed, Hold::HomingFailed] {
            let mut senses = ready();
            senses.on_estimate(ms(1050), &DataEstimate { quality: DataEstimate::LOST, ..estimate(2, 0.0) });
            senses.on_hold(ms(1050), &holds(0, &[(Hold::DriveFault, "propulsion"), (hold, "steering")]));
            let steering = (hold, "steering".into());
            let (causes, text) = why(&senses, 1100);
            let others = [(Hold::EstimateLost, String::new()), (Hold::DriveFault, "propulsion".into())];
            assert_eq!(causes, [[steering].as_slice(), &others].concat());
            assert_eq!(text, format!("waits: {}", hold.words("steering")));
            // A stop is what a person ends first.
            senses.on_stop(ms(1050), &EventStop { timestamp: 0, engaged: true, source: "button".into() });
            assert_eq!(why(&senses, 1100).1, "waits: PAUSE is engaged by button");
        }
    }

    #[test]
    fn an_unknown_cause_holds_the_robot() {
        let mut senses = ready();
        let mut list = holds(0, &[(Hold::Homing, "steering")]);
        list.holds[0].code = 9999;
        senses.on_hold(ms(1100), &list);
        assert_eq!(why(&senses, 1100).1, "waits: cause 9999 of steering, which this version does not know");
    }

    #[test]
    fn an_estimate_is_extrapolated_to_now_and_back_to_the_firing_of_the_sonars() {
        let mut senses = ready();
        for n in 1..=6 {
            senses.on_estimate(ms(1000 + 50 * n), &estimate(1 + n as i64, 0.05 * n as f64));
        }
        assert!((senses.located(ms(1340)).unwrap().pose.x - 0.34).abs() < 1e-9);
        assert!((senses.when_fired(ms(1130)).unwrap().pose.x - 0.13).abs() < 1e-9);
    }

    #[test]
    fn nan_and_backward_timestamps_are_rejected() {
        let mut senses = ready();
        assert_eq!(senses.on_estimate(ms(1050), &estimate(0, 0.0)), EstimateCheck::OutOfOrder);
        assert_eq!(senses.on_estimate(ms(1050), &estimate(2, 0.05)), EstimateCheck::Ok);
        assert_eq!(senses.on_estimate(ms(1100), &estimate(3, 5.0)), EstimateCheck::Jumped);
        assert_eq!(senses.on_estimate(ms(1150), &estimate(4, f64::NAN)), EstimateCheck::NotFinite);
        assert!(senses.located(ms(1150)).is_none());
        // A restarted estimator counts from another origin.
        assert_eq!(senses.on_estimate(ms(2200), &estimate(-9, 5.0)), EstimateCheck::Jumped);
        assert!(senses.located(ms(2200)).is_some());
    }

    #[test]
    fn the_first_estimate_is_reported_as_a_jump() {
        let mut senses = Senses::default();
        assert_eq!(senses.on_estimate(ms(5), &estimate(1, 3.0)), EstimateCheck::Jumped);
        assert_eq!(senses.located(ms(5)).unwrap().pose.x, 3.0);
    }

    #[test]
    fn the_view_of_2011_is_the_fallback_only() {
        let mut senses = Senses::default();
        assert!(senses.lacks_ranges(ms(0)));
        senses.on_ranges(ms(1000));
        assert!(!senses.lacks_ranges(ms(2499)) && senses.lacks_ranges(ms(2500)));
    }
}
