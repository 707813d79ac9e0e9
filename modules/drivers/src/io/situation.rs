//! Situations that outputs can show: what the robot does, and what holds it, by messages of other modules.
//!
//! Whatever is not known, or older than [`AGE_MAX`], is [`Situation::Unknown`] and nothing else but faults.

use super::config::Shows;
use base::{Duration, Instant, earliest};
use messages::common::{DataFaults, Error};
use messages::lowlevel::{DataHold, DataVelocity};
use messages::{GOAL_MODULE, Hold, MOTION_MODULE};
use settings::settings;
use std::collections::BTreeMap;

/// Motion, and what holds it, are not known when older: they are published at 20 Hz and 5 Hz.
const AGE_MAX: Duration = Duration::from_millis(500);
/// Lists of faults are valid for this time.
const FAULTS_AGE_MAX: Duration = Duration::from_secs(3);
/// Modules whose faults are known at most; further ones are left out.
const MODULES_MAX: usize = 64;

settings! {
    /// What an entry of `[signals]` waits for. Several may apply at once.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Situation {
        /// The robot begins to move: its set-point is not 0 any more, for `signal_s`. Motion does not wait for it.
        Starting = "starting",
        /// It moves, or is to move.
        Driving = "driving",
        /// It moves backwards, or is to.
        Reversing = "reversing",
        /// It moves and rotates counter-clockwise.
        TurningLeft = "turning_left",
        /// It moves and rotates clockwise.
        TurningRight = "turning_right",
        /// It neither moves nor is to.
        Standing = "standing",
        /// It stands and waits for a free way: for who or what is in it.
        Waiting = "waiting",
        /// Something holds the motion, PAUSE and faults included.
        Held = "held",
        /// PAUSE is engaged, latched or unknown.
        Pause = "pause",
        /// A drive, bus or module that the motion needs is in fault, or a module reports an error that lasts.
        Fault = "fault",
        /// What it does is not known.
        Unknown = "unknown",
        /// Any.
        Always = "always",
    }
}

/// Situations that apply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Situations(u16);

impl Situations {
    pub fn has(self, situation: Situation) -> bool {
        self.0 & 1 << situation as u16 != 0
    }

    fn with(self, situation: Situation, applies: bool) -> Self {
        Self(self.0 | u16::from(applies) << situation as u16)
    }
}

/// Last motion, as far as it is shown.
#[derive(Clone, Copy, Debug)]
struct Motion {
    at: Instant,
    /// It moves; it is to move.
    moves: bool,
    commanded: bool,
    backwards: bool,
    /// Counter-clockwise rotation, rad/s.
    rotation: f64,
}

/// What holds the motion, or the goal.
#[derive(Clone, Copy, Debug)]
struct Held {
    at: Instant,
    holds: bool,
    pause: bool,
    fault: bool,
    in_the_way: bool,
}

/// Follows the messages.
#[derive(Debug)]
pub(super) struct Watcher {
    speed_mps: f64,
    turn_radps: f64,
    signal: Duration,
    motion: Option<Motion>,
    held: Option<Held>,
    goal: Option<Held>,
    /// By module: when its list came, and whether it has an error.
    faults: BTreeMap<String, (Instant, bool)>,
    /// Until when a start is shown.
    starts: Option<Instant>,
}

impl Watcher {
    pub fn new(keys: &Shows) -> Self {
        Self {
            speed_mps: keys.speed_mps,
            turn_radps: keys.turn_radps,
            signal: keys.signal,
            motion: None,
            held: None,
            goal: None,
            faults: BTreeMap::new(),
            starts: None,
        }
    }

    pub fn on_velocity(&mut self, at: Instant, velocity: &DataVelocity) {
        let DataVelocity { vx, vy, omega, vx_target, vy_target, omega_target, .. } = *velocity;
        if ![vx, vy, omega, vx_target, vy_target, omega_target].into_iter().all(f64::is_finite) {
            (self.motion, self.starts) = (None, None);
            return;
        }
        let any = |x: f64, y: f64, omega: f64| x.abs().max(y.abs()) > self.speed_mps || omega.abs() > self.turn_radps;
        let (moves, commanded) = (any(vx, vy, omega), any(vx_target, vy_target, omega_target));
        let (forward, rotation) = if commanded { (vx_target, omega_target) } else { (vx, omega) };
        let backwards = forward < -self.speed_mps;
        let stood = self.motion.is_some_and(|before| !before.moves && !before.commanded);
        match (commanded, moves) {
            (true, _) if stood => self.starts = Some(at + self.signal),
            (false, false) => self.starts = None,
            _ => {}
        }
        self.motion = Some(Motion { at, moves, commanded, backwards, rotation });
    }

    pub fn on_hold(&mut self, at: Instant, list: &DataHold) {
        let causes = || list.holds.iter().map(messages::lowlevel::Hold::cause);
        let held = Held {
            at,
            holds: !list.is_free(),
            pause: causes().any(|cause| cause.is_some_and(is_pause)),
            fault: causes().any(|cause| cause.is_some_and(is_fault)),
            in_the_way: causes().any(|cause| cause.is_some_and(is_in_the_way)),
        };
        match list.module.as_str() {
            MOTION_MODULE => self.held = Some(held),
            GOAL_MODULE => self.goal = Some(held),
            _ => {}
        }
    }

    pub fn on_faults(&mut self, at: Instant, list: &DataFaults) {
        let error = list.faults.iter().any(|fault| fault.severity >= Error::ERROR);
        if self.faults.len() < MODULES_MAX || self.faults.contains_key(&list.module) {
            self.faults.insert(list.module.clone(), (at, error));
        }
    }

    /// Forgets what is too old, and returns what applies.
    pub fn situations(&mut self, now: Instant) -> Situations {
        let fresh = |at: Instant, age: Duration| now.since(at) <= age;
        self.motion = self.motion.filter(|motion| fresh(motion.at, AGE_MAX));
        self.held = self.held.filter(|held| fresh(held.at, AGE_MAX));
        self.goal = self.goal.filter(|held| fresh(held.at, AGE_MAX));
        self.faults.retain(|_, (at, _)| fresh(*at, FAULTS_AGE_MAX));
        if self.motion.is_none() {
            self.starts = None;
        }
        self.starts = self.starts.filter(|until| now < *until);
        let error = self.faults.values().any(|(_, error)| *error);
        let always = Situations::default().with(Situation::Always, true);
        let (Some(motion), Some(held)) = (self.motion, self.held) else {
            return always.with(Situation::Unknown, true).with(Situation::Fault, error);
        };
        let driving = motion.moves || motion.commanded;
        let blocked = held.in_the_way || self.goal.is_some_and(|goal| goal.in_the_way);
        always
            .with(Situation::Starting, self.starts.is_some())
            .with(Situation::Driving, driving)
            .with(Situation::Reversing, motion.backwards)
            .with(Situation::TurningLeft, driving && motion.rotation > self.turn_radps)
            .with(Situation::TurningRight, driving && motion.rotation < -self.turn_radps)
            .with(Situation::Standing, !driving)
            .with(Situation::Waiting, !driving && blocked)
            .with(Situation::Held, held.holds)
            .with(Situation::Pause, held.pause)
            .with(Situation::Fault, held.fault || error)
    }

    /// When something ends by its age.
    pub fn poll_timeout(&self) -> Option<Instant> {
        // An age equal to the limit is known.
        let end = |at: Instant, age: Duration| at + age + Duration::from_nanos(1);
        let lists = [self.held, self.goal].into_iter().flatten().map(|held| end(held.at, AGE_MAX)).min();
        let motion = self.motion.map(|motion| end(motion.at, AGE_MAX));
        let faults = self.faults.values().map(|(at, _)| end(*at, FAULTS_AGE_MAX)).min();
        earliest([lists, motion, faults, self.starts])
    }
}

/// The PAUSE line, or another source of PAUSE.
fn is_pause(cause: Hold) -> bool {
    (100..200).contains(&cause.code())
}

/// What is broken or missing, and no step of a start, no order of a person.
fn is_fault(cause: Hold) -> bool {
    let usual = [
        Hold::DriveBooting,
        Hold::DriveUnseen,
        Hold::NotHomed,
        Hold::Homing,
        Hold::Centering,
        Hold::ToBeHomed,
        Hold::FeedOff,
        Hold::ModuleInit,
        Hold::ModulePaused,
        Hold::ModuleStopped,
        Hold::ModuleEnding,
    ];
    (200..400).contains(&cause.code()) && !usual.contains(&cause)
}

/// Somebody or something in the way, or a space of which nothing is known.
fn is_in_the_way(cause: Hold) -> bool {
    matches!(
        cause,
        Hold::InTheWay
            | Hold::SomebodyNear
            | Hold::GoalBlocked
            | Hold::StartBlocked
            | Hold::Unreachable
            | Hold::WayBlocked
            | Hold::GuardStops
            | Hold::GuardUnknown
            | Hold::GuardBounds
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::common;
    use messages::lowlevel;

    fn watcher() -> Watcher {
        let signal = Duration::from_secs(2);
        Watcher::new(&Shows { signal, speed_mps: 0.02, turn_radps: 0.1, show: Vec::new() })
    }

    fn ms(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    /// Measured velocity and set-point.
    fn velocity(is: [f64; 2], target: [f64; 2]) -> DataVelocity {
        let ([vx, omega], [vx_target, omega_target]) = (is, target);
        DataVelocity { vx, omega, vx_target, omega_target, ..Default::default() }
    }

    fn holds(module: &str, causes: &[Hold]) -> DataHold {
        let hold = |cause: &Hold| lowlevel::Hold { code: cause.code(), ..Default::default() };
        DataHold { module: module.into(), holds: causes.iter().map(hold).collect(), ..Default::default() }
    }

    fn names(watcher: &mut Watcher, now: Instant) -> Vec<&'static str> {
        let applies = watcher.situations(now);
        Situation::ALL.iter().filter(|(_, situation)| applies.has(*situation)).map(|(name, _)| *name).collect()
    }

    /// What applies with this motion and these causes.
    fn applies(is: [f64; 2], target: [f64; 2], motion: &[Hold], goal: &[Hold]) -> Vec<&'static str> {
        let mut watcher = watcher();
        watcher.on_velocity(ms(100), &velocity(is, target));
        watcher.on_hold(ms(100), &holds(MOTION_MODULE, motion));
        watcher.on_hold(ms(100), &holds(GOAL_MODULE, goal));
        names(&mut watcher, ms(200))
    }

    #[test]
    fn each_situation_follows_from_motion_and_causes() {
        let stands = [0.0, 0.0];
        assert_eq!(applies(stands, stands, &[Hold::NobodyCommands], &[Hold::NoGoal]), ["standing", "always"]);
        assert_eq!(applies([0.4, 0.0], [0.4, 0.0], &[], &[]), ["driving", "always"]);
        assert_eq!(applies(stands, [0.4, 0.0], &[], &[]), ["driving", "always"]);
        assert_eq!(applies([0.4, 0.0], stands, &[], &[]), ["driving", "always"], "it brakes");
        assert_eq!(applies([-0.1, 0.0], [-0.4, 0.0], &[], &[]), ["driving", "reversing", "always"]);
        assert_eq!(applies([0.4, 0.3], [0.4, 0.3], &[], &[]), ["driving", "turning_left", "always"]);
        assert_eq!(applies([0.4, 0.3], [0.4, -0.3], &[], &[]), ["driving", "turning_right", "always"]);
        assert_eq!(applies([0.4, 0.3], stands, &[], &[]), ["driving", "turning_left", "always"], "as measured");
        assert_eq!(applies(stands, [0.0, -0.5], &[], &[]), ["driving", "turning_right", "always"], "on the spot");
        assert_eq!(applies(stands, stands, &[Hold::GuardStops], &[]), ["standing", "waiting", "always"]);
        assert_eq!(applies(stands, stands, &[], &[Hold::InTheWay]), ["standing", "waiting", "always"]);
        assert_eq!(applies([0.3, 0.0], [0.3, 0.0], &[Hold::GuardStops], &[]), ["driving", "always"]);
        assert_eq!(applies(stands, stands, &[Hold::PauseButton], &[]), ["standing", "held", "pause", "always"]);
        assert_eq!(applies(stands, stands, &[Hold::ToBeHomed], &[]), ["standing", "held", "always"]);
        assert_eq!(applies(stands, stands, &[Hold::DriveLost], &[]), ["standing", "held", "fault", "always"]);
        assert_eq!(applies([f64::NAN, 0.0], stands, &[], &[]), ["unknown", "always"]);
    }

    #[test]
    fn a_start_is_shown_for_its_time_and_only_from_standing() {
        let mut watcher = watcher();
        let mut at = 0;
        let mut say = |watcher: &mut Watcher, is: f64, target: f64| {
            at += 50;
            watcher.on_velocity(ms(at), &velocity([is, 0.0], [target, 0.0]));
            watcher.on_hold(ms(at), &holds(MOTION_MODULE, &[]));
            watcher.situations(ms(at)).has(Situation::Starting)
        };
        assert!(!say(&mut watcher, 0.3, 0.3), "whether it stood is not known");
        assert!(!say(&mut watcher, 0.0, 0.0));
        assert!(say(&mut watcher, 0.0, 0.3));
        for _ in 0..39 {
            assert!(say(&mut watcher, 0.3, 0.3));
        }
        assert!(!say(&mut watcher, 0.3, 0.3));
        assert!(!say(&mut watcher, 0.3, 0.0) && !say(&mut watcher, 0.0, 0.0));
        assert!(say(&mut watcher, 0.0, -0.3));
        assert!(!say(&mut watcher, 0.0, 0.0), "it does not start after all");
    }

    #[test]
    fn what_is_old_or_missing_is_unknown_and_ends_by_itself() {
        let mut watcher = watcher();
        assert_eq!((names(&mut watcher, ms(0)), watcher.poll_timeout()), (vec!["unknown", "always"], None));
        watcher.on_velocity(ms(0), &velocity([0.4, 0.0], [0.4, 0.0]));
        assert_eq!(names(&mut watcher, ms(0)), ["unknown", "always"], "what holds it is not known");
        watcher.on_hold(ms(100), &holds("somebody", &[]));
        assert_eq!(names(&mut watcher, ms(100)), ["unknown", "always"]);
        watcher.on_hold(ms(100), &holds(MOTION_MODULE, &[]));
        assert_eq!(names(&mut watcher, ms(500)), ["driving", "always"]);
        let end = watcher.poll_timeout().unwrap();
        assert_eq!(end, ms(500) + Duration::from_nanos(1));
        assert_eq!(names(&mut watcher, end), ["unknown", "always"]);
    }

    #[test]
    fn an_error_of_any_module_is_a_fault_until_it_ends_or_its_list_is_old() {
        let list = |severity: Option<i8>| {
            let fault = severity.map(|severity| common::Fault { severity, ..Default::default() });
            DataFaults { module: "driver_aux".into(), faults: fault.into_iter().collect(), ..Default::default() }
        };
        let mut watcher = watcher();
        watcher.on_faults(ms(0), &list(Some(Error::WARNING)));
        assert_eq!(names(&mut watcher, ms(0)), ["unknown", "always"]);
        watcher.on_faults(ms(0), &list(Some(Error::ERROR)));
        assert_eq!(names(&mut watcher, ms(3000)), ["fault", "unknown", "always"]);
        assert_eq!(names(&mut watcher, ms(3001)), ["unknown", "always"]);
        watcher.on_faults(ms(4000), &list(Some(Error::ERROR)));
        watcher.on_faults(ms(4100), &list(None));
        assert_eq!(names(&mut watcher, ms(4100)), ["unknown", "always"]);
        // A flood of names is bounded.
        for n in 0..1000 {
            watcher.on_faults(ms(4200), &DataFaults { module: format!("module{n}"), ..list(None) });
        }
        assert_eq!(watcher.faults.len(), MODULES_MAX);
    }
}
