//! The bounds of `guard`, applied to every source after arbitration (docs/guard.md): a bound clamps the speed, and is
//! reported. If the guard is silent the bound is zero, and after a second the robot is stopped. A robot that senses
//! nothing drives slowly.

use base::{Deadlines, Duration, Instant};
use kinematics::Twist;
use messages::{Hold, lowlevel};

/// Age of `LL_DATA_GUARD` from which no motion is permitted; ends by itself.
pub const GUARD_VALID_FOR: Duration = Duration::from_millis(150);
/// Silence of the guard from which on the robot is stopped until a source releases it.
pub const GUARD_SILENT: Duration = Duration::from_secs(1);
/// Speed up to which the robot counts as standing, m/s, as for the guard: its words are about the direction of travel,
/// at standstill about the direction that is bounded more.
const STANDSTILL_MPS: f64 = 0.02;
/// Codes of the guard's own causes begin here (docs/holds.md).
const GUARD_CODES: i32 = 700;
/// Age up to which a second input counts as held.
pub const CREEP_VALID_FOR: Duration = Duration::from_millis(250);

/// Whether a guard senses obstacles for this driver, and the speeds where nothing is sensed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The robot has a `guard` that senses.
    pub guarded: bool,
    /// Highest speed where nothing is sensed, m/s.
    pub speed_blind: f64,
    /// Highest speed by hand past the guard, m/s.
    pub creep: f64,
    /// Distance of the farthest point of the outline from the origin, m: while the robot turns on the spot that point
    /// has such a speed.
    pub reach: f64,
}

impl Default for Config {
    /// A robot that senses nothing.
    fn default() -> Self {
        Self { guarded: false, speed_blind: 0.3, creep: 0.15, reach: 1.0 }
    }
}

base::deadlines! {
    /// Deadlines of received data. A past deadline stays, and so does its consequence.
    enum Timer {
        /// The last bounds are too old. Set from the first ones on.
        Valid,
        /// The guard is silent. Set from the first bounds or the watchdog's first list on: without either, this module
        /// was started alone by a person.
        Silent,
        /// The second input is not held any more. Set while it is.
        Creep,
    }
}

/// Last words of the guard, and of who creeps past it.
#[derive(Debug)]
pub struct Protection {
    config: Config,
    /// By [`Way`].
    bounds: [f64; 6],
    /// Cause of the last bounds.
    said: Said,
    subject: String,
    /// Code and subject are about driving forward; `None`: that is not certain.
    about_forward: Option<bool>,
    /// Measured speed, m/s: now, and when the last bounds came. The guard knew one between them.
    speeds: [f64; 2],
    /// Source that holds the second input, and its session.
    creeper: (String, i64),
    deadlines: Deadlines<Timer>,
}

/// Cause that the guard names for its bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Said {
    /// None: nothing is near.
    Nothing,
    /// One that this version knows.
    Known(Hold),
    /// One of a later version.
    Unknown,
}

impl Said {
    fn of(code: i32) -> Self {
        let known = || Hold::from_code(code).filter(|hold| hold.is_notice() && code >= GUARD_CODES);
        if code == 0 { Self::Nothing } else { known().map_or(Self::Unknown, Self::Known) }
    }
}

/// A way of moving, in the order of the guard's bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    Forward,
    Backward,
    Left,
    Right,
    TurnLeft,
    TurnRight,
}

impl Way {
    /// This way, or the opposite one of a negative component.
    fn or_back(self, component: f64) -> Self {
        match self {
            Self::Forward if component < 0.0 => Self::Backward,
            Self::Left if component < 0.0 => Self::Right,
            Self::TurnLeft if component < 0.0 => Self::TurnRight,
            way => way,
        }
    }

    fn turns(self) -> bool {
        matches!(self, Self::TurnLeft | Self::TurnRight)
    }
}

/// The ways in which a velocity moves the robot, with their speeds, m/s and rad/s.
fn ways(Twist { vx, vy, omega }: Twist) -> [(Way, f64); 3] {
    [(Way::Forward, vx), (Way::Left, vy), (Way::TurnLeft, omega)].map(|(way, speed)| (way.or_back(speed), speed.abs()))
}

/// The source that moves the robot, as far as the bound depends on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mover<'a> {
    /// Its name.
    pub name: &'a str,
    /// It is a person: it may creep.
    pub manual: bool,
}

impl Protection {
    /// Creates the state with nothing received.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            config,
            bounds: [0.0; 6],
            said: Said::Nothing,
            subject: String::new(),
            about_forward: None,
            speeds: [0.0; 2],
            creeper: (String::new(), 0),
            deadlines: Deadlines::new(),
        }
    }

    /// What an operator reads at the start of a robot whose guard senses nothing.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let Config { guarded, speed_blind, .. } = self.config;
        let blind = format!("NOTHING SENSES WHAT IS IN THE WAY: AT MOST {speed_blind} m/s");
        (!guarded).then(|| blind + " (table guard of robot.toml, docs/guard.md)")
    }

    /// Processes the measured speed, m/s, by which it follows what the next bounds are about.
    pub fn on_speed(&mut self, speed: f64) {
        self.speeds[0] = speed;
    }

    /// Processes the bounds, received at `at`. A bound that is not a number permits nothing.
    pub fn on_guard(&mut self, at: Instant, guard: &lowlevel::DataGuard) {
        if !self.config.guarded {
            return;
        }
        let bound = |speed: f64| if speed.is_finite() { speed.max(0.0) } else { 0.0 };
        let lowlevel::DataGuard { forward, backward, left, right, turn_left, turn_right, .. } = *guard;
        self.bounds = [forward, backward, left, right, turn_left, turn_right].map(bound);
        self.said = Said::of(guard.code);
        self.subject.clone_from(&guard.subject);
        let at_rest = self.bounds[Way::Forward as usize] <= self.bounds[Way::Backward as usize];
        let [now, before] = self.speeds.map(|speed| match speed {
            speed if speed > STANDSTILL_MPS => true,
            speed if speed < -STANDSTILL_MPS => false,
            _ => at_rest,
        });
        self.about_forward = (now == before).then_some(now);
        self.speeds[1] = self.speeds[0];
        self.deadlines.set(Timer::Valid, at + GUARD_VALID_FOR);
        self.deadlines.set(Timer::Silent, at + GUARD_SILENT);
    }

    /// Processes bounds of another sender than the guard: they take from what the guard permits until its next ones,
    /// and are no sign that it lives.
    pub fn on_guard_of_another(&mut self, guard: &lowlevel::DataGuard) {
        let lowlevel::DataGuard { forward, backward, left, right, turn_left, turn_right, .. } = *guard;
        let others = [forward, backward, left, right, turn_left, turn_right];
        for (bound, other) in self.bounds.iter_mut().zip(others) {
            *bound = if other.is_finite() { bound.min(other.max(0.0)) } else { 0.0 };
        }
        (self.said, self.about_forward) = (Said::Unknown, None);
        self.subject.clear();
    }

    /// The watchdog supervises this robot, as of `at`: its guard must be heard.
    pub fn on_watchdog(&mut self, at: Instant) {
        if self.config.guarded && !self.deadlines.is_set(Timer::Silent) {
            self.deadlines.set(Timer::Silent, at + GUARD_SILENT);
        }
    }

    /// Processes the second input, received at `at`.
    pub fn on_creep(&mut self, at: Instant, creep: &lowlevel::CmdCreep) {
        if !self.config.guarded {
            return;
        }
        let same = self.creeper.0 == creep.source && self.creeper.1 == creep.session;
        if creep.held {
            self.creeper = (creep.source.clone(), creep.session);
            self.deadlines.set(Timer::Creep, at + CREEP_VALID_FOR);
        } else if same {
            self.deadlines.clear(Timer::Creep);
        }
    }

    /// The cause for which the robot is stopped until a source releases it.
    #[must_use]
    pub fn objection(&self, now: Instant) -> Option<Hold> {
        self.deadlines.is_due(Timer::Silent, now).then_some(Hold::GuardSilent)
    }

    /// Highest speed now, m/s, or rotation, rad/s, one way, and its cause.
    fn bound(&self, now: Instant, way: Way, mover: Mover<'_>) -> (f64, Hold) {
        let Config { guarded, speed_blind, creep, reach } = self.config;
        let of_reach = |speed: f64| if way.turns() { speed / reach } else { speed };
        if !guarded || !self.deadlines.is_set(Timer::Silent) {
            return (of_reach(speed_blind), Hold::GuardBlind);
        }
        if self.deadlines.get(Timer::Valid).is_none_or(|until| until <= now) {
            return (0.0, Hold::GuardLate);
        }
        let bound = self.bounds[way as usize];
        let held = self.deadlines.get(Timer::Creep).is_some_and(|until| now < until);
        let creep = of_reach(creep);
        if mover.manual && held && self.creeper.0 == mover.name && bound < creep {
            return (creep, Hold::GuardCreep);
        }
        (bound, self.cause(bound, way))
    }

    /// What bounds a direction, as far as the guard has said. Whoever is sent to a sensor must find the cause there.
    fn cause(&self, bound: f64, way: Way) -> Hold {
        let this_way = match way {
            Way::Forward => self.about_forward == Some(true),
            Way::Backward => self.about_forward == Some(false),
            _ => false,
        };
        match self.said {
            Said::Known(Hold::GuardMotion) => Hold::GuardMotion,
            Said::Known(Hold::GuardStops | Hold::GuardSlows | Hold::GuardUnknown) if self.subject.is_empty() => {
                Hold::GuardBounds
            }
            Said::Known(hold) if this_way => hold,
            Said::Nothing if this_way && bound > 0.0 => Hold::GuardReach,
            _ => Hold::GuardBounds,
        }
    }

    /// The part of a velocity that is permitted now, in the same direction and with the same curvature.
    #[must_use]
    pub fn clamped(&self, now: Instant, velocity: Twist, mover: Mover<'_>) -> Twist {
        let Twist { vx, vy, omega } = velocity;
        if vy == 0.0 && omega == 0.0 {
            let (bound, _) = self.bound(now, Way::Forward.or_back(vx), mover);
            return Twist { vx: vx.clamp(-bound, bound), ..velocity };
        }
        let parts = ways(velocity).map(|(way, speed)| match self.bound(now, way, mover).0 {
            bound if bound < speed => bound / speed,
            _ => 1.0,
        });
        velocity * parts.into_iter().fold(1.0, f64::min)
    }

    /// Why this velocity is not reached, with the subject; `None` if it is.
    #[must_use]
    pub fn notice<'a>(&'a self, now: Instant, velocity: Twist, mover: Mover<'a>) -> Option<(Hold, &'a str)> {
        let of = |(way, speed): (Way, f64)| {
            let (bound, hold) = self.bound(now, way, mover);
            let creeps = hold == Hold::GuardCreep && speed != 0.0;
            // The bound that leaves the least of it.
            (speed > bound || creeps).then_some((bound / speed, hold))
        };
        let (_, hold) = ways(velocity).into_iter().filter_map(of).min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(match hold {
            Hold::GuardCreep => (hold, mover.name),
            Hold::GuardStops | Hold::GuardSlows | Hold::GuardUnknown => (hold, &self.subject),
            _ => (hold, ""),
        })
    }

    /// Next deadline after `now` at which silence changes what is permitted.
    #[must_use]
    pub fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        self.deadlines.next_after(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::{CmdCreep, DataGuard};

    const HAND: Mover<'_> = Mover { name: "pad", manual: true };
    const PLANNER: Mover<'_> = Mover { name: "planner", manual: false };

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn along(vx: f64) -> Twist {
        Twist::new(vx, 0.0, 0.0)
    }

    fn guarded() -> Protection {
        Protection::new(Config { guarded: true, ..Config::default() })
    }

    fn guard(forward: f64, backward: f64, code: Hold) -> DataGuard {
        DataGuard { forward, backward, code: code.code(), subject: "sonar 2".into(), ..DataGuard::default() }
    }

    #[test]
    fn a_bound_clamps_both_ways_for_every_source_and_names_its_cause() {
        let mut protection = guarded();
        protection.on_guard(ms(0), &guard(0.2, 0.4, Hold::GuardStops));
        for mover in [HAND, PLANNER] {
            assert_eq!(protection.clamped(ms(100), along(0.6), mover).vx, 0.2);
            assert_eq!(protection.clamped(ms(100), along(-0.6), mover).vx, -0.4);
            assert_eq!(protection.clamped(ms(100), along(0.1), mover).vx, 0.1);
            assert_eq!(protection.notice(ms(100), along(0.6), mover), Some((Hold::GuardStops, "sonar 2")));
            assert_eq!(protection.notice(ms(100), along(0.1), mover), None);
        }
    }

    #[test]
    fn nobody_is_sent_to_the_sensor_of_the_other_direction() {
        let neutral = Some((Hold::GuardBounds, ""));
        let near = Some((Hold::GuardStops, "sonar 2"));
        // Speed at the bounds before and now, bounds, and the causes forward and backward.
        for (speeds, bounds, forward, backward) in [
            ([0.0, 0.0], (0.0, 0.1), near, neutral),
            ([0.0, 0.0], (0.2, 0.0), neutral, near),
            ([0.3, 0.3], (0.2, 0.1), near, neutral),
            ([-0.3, -0.3], (0.1, 0.2), neutral, near),
            // It has just begun, ended or reversed its travel: the guard may have known either.
            ([0.0, 0.1], (0.2, 0.1), neutral, neutral),
            ([-0.1, 0.0], (0.1, 0.2), neutral, neutral),
            ([0.1, -0.1], (0.1, 0.1), neutral, neutral),
            ([0.1, 0.0], (0.1, 0.2), near, neutral),
        ] {
            let mut protection = guarded();
            for speed in speeds {
                protection.on_speed(speed);
                protection.on_guard(ms(0), &guard(bounds.0, bounds.1, Hold::GuardStops));
            }
            let found = [0.6, -0.6].map(|speed| protection.notice(ms(100), along(speed), HAND));
            assert_eq!(found, [forward, backward], "{speeds:?} {bounds:?}");
            protection.on_guard(ms(0), &guard(0.0, 0.0, Hold::GuardMotion));
            let found = [0.6, -0.6].map(|speed| protection.notice(ms(100), along(speed), HAND));
            assert_eq!(found, [Some((Hold::GuardMotion, "")); 2]);
        }
    }

    #[test]
    fn every_bound_has_words_without_a_gap() {
        let mut protection = guarded();
        let words = |protection: &Protection, speed| {
            let (hold, subject) = protection.notice(ms(100), along(speed), HAND).unwrap();
            assert!(hold.is_notice() && (!subject.is_empty() || !hold.sentence().contains("{}")), "{hold:?}");
            hold
        };
        for code in [0, Hold::GuardStops.code(), Hold::GuardSlows.code(), Hold::GuardUnknown.code(), 799, -1] {
            for (forward, backward) in [(0.5, 0.5), (0.5, 0.0), (0.0, 0.5), (0.0, 0.0)] {
                protection.on_guard(ms(0), &DataGuard { forward, backward, code, ..DataGuard::default() });
                for speed in [0.6, -0.6] {
                    words(&protection, speed);
                }
            }
        }
        protection.on_guard(ms(0), &DataGuard { forward: 0.5, backward: 0.6, ..DataGuard::default() });
        assert_eq!(words(&protection, 0.6), Hold::GuardReach);
        assert_eq!(words(&protection, -0.8), Hold::GuardBounds, "of that direction nothing is said");
        protection.on_guard(ms(0), &DataGuard::default());
        assert_eq!(words(&protection, 0.6), Hold::GuardBounds, "nothing is permitted, and no sensor's reach does that");
    }

    #[test]
    fn silence_is_zero_that_ends_by_itself_and_after_a_second_a_stop() {
        let mut protection = guarded();
        protection.on_guard(ms(0), &guard(0.8, 0.8, Hold::GuardSlows));
        assert_eq!([149, 150].map(|at| protection.clamped(ms(at), along(0.6), HAND).vx), [0.6, 0.0]);
        assert_eq!(protection.notice(ms(150), along(0.6), HAND), Some((Hold::GuardLate, "")));
        assert_eq!([999, 1000].map(|at| protection.objection(ms(at))), [None, Some(Hold::GuardSilent)]);
        assert_eq!([0, 150].map(|at| protection.poll_timeout(ms(at))), [Some(ms(150)), Some(ms(1000))]);
        protection.on_guard(ms(1200), &guard(0.8, 0.8, Hold::GuardSlows));
        assert_eq!((protection.objection(ms(1200)), protection.clamped(ms(1200), along(0.6), HAND).vx), (None, 0.6));
    }

    #[test]
    fn bounds_of_another_sender_stop_and_are_no_sign_of_life_of_the_guard() {
        let mut protection = guarded();
        protection.on_guard(ms(0), &guard(0.8, 0.8, Hold::GuardSlows));
        protection.on_guard_of_another(&DataGuard::default());
        assert_eq!(protection.clamped(ms(10), along(0.6), PLANNER).vx, 0.0);
        assert_eq!(protection.notice(ms(10), along(0.6), PLANNER), Some((Hold::GuardBounds, "")));
        protection.on_guard(ms(50), &guard(0.8, 0.8, Hold::GuardSlows));
        assert_eq!(protection.clamped(ms(60), along(0.6), PLANNER).vx, 0.6, "the guard goes on");
        for at in (60..1050).step_by(10) {
            protection.on_guard_of_another(&DataGuard::default());
            assert_eq!(protection.objection(ms(at)), None);
        }
        assert_eq!(protection.notice(ms(1040), along(0.6), PLANNER), Some((Hold::GuardLate, "")));
        assert_eq!(protection.objection(ms(1050)), Some(Hold::GuardSilent));
        // Nothing that another sender permits is added, whatever passed.
        protection.on_guard(ms(2000), &guard(0.2, 0.2, Hold::GuardSlows));
        protection.on_guard_of_another(&guard(0.8, f64::NAN, Hold::GuardSlows));
        assert_eq!([0.6, -0.6].map(|vx| protection.clamped(ms(2000), along(vx), HAND).vx), [0.2, 0.0]);
        // One that was never heard does not begin to live.
        let mut protection = guarded();
        protection.on_watchdog(ms(0));
        protection.on_guard_of_another(&DataGuard::default());
        assert_eq!(protection.objection(ms(1000)), Some(Hold::GuardSilent));
    }

    #[test]
    fn a_supervised_robot_waits_for_its_guard_and_a_driver_alone_is_slow() {
        let mut protection = guarded();
        assert_eq!(protection.clamped(ms(5000), along(0.6), HAND).vx, 0.3, "on a bench, by hand");
        assert_eq!(protection.objection(ms(5000)), None);
        protection.on_watchdog(ms(6000));
        assert_eq!(protection.clamped(ms(6000), along(0.6), HAND).vx, 0.0);
        assert_eq!(protection.objection(ms(7000)), Some(Hold::GuardSilent));
    }

    #[test]
    fn a_guard_that_senses_nothing_is_slow_and_says_so() {
        let mut protection = Protection::new(Config::default());
        protection.on_watchdog(ms(0));
        protection.on_guard(ms(0), &guard(1.0, 1.0, Hold::GuardStops));
        assert_eq!(protection.clamped(ms(9000), along(-0.6), PLANNER).vx, -0.3);
        assert_eq!(protection.notice(ms(9000), along(-0.6), PLANNER), Some((Hold::GuardBlind, "")));
        assert!(protection.warning().is_some_and(|text| text.contains("AT MOST 0.3 m/s")));
        let creep = CmdCreep { timestamp: 0, source: "pad".into(), session: 7, held: true };
        protection.on_creep(ms(9000), &creep);
        assert_eq!(protection.clamped(ms(9000), along(0.6), HAND).vx, 0.3, "there is nothing to creep past");
        assert_eq!((guarded().warning(), protection.objection(ms(9000))), (None, None));
        assert_eq!(protection.poll_timeout(ms(0)), None);
    }

    #[test]
    fn a_person_creeps_while_the_second_input_is_held_and_the_planner_does_not() {
        let mut protection = guarded();
        let creep = |source: &str, held| CmdCreep { timestamp: 0, source: source.into(), session: 7, held };
        protection.on_guard(ms(0), &guard(0.0, 0.5, Hold::GuardStops));
        assert_eq!(protection.clamped(ms(0), along(0.6), HAND).vx, 0.0);
        protection.on_creep(ms(0), &creep("pad", true));
        assert_eq!(protection.clamped(ms(0), along(0.6), HAND).vx, 0.15);
        assert_eq!(
            protection.notice(ms(0), along(0.1), HAND),
            Some((Hold::GuardCreep, "pad")),
            "shown as long as it counts"
        );
        assert_eq!(protection.clamped(ms(0), along(-0.6), HAND).vx, -0.5, "where more is permitted nothing changes");
        assert_eq!(protection.clamped(ms(0), along(0.6), PLANNER).vx, 0.0);
        let other = Mover { name: "phone", manual: true };
        assert_eq!(protection.clamped(ms(0), along(0.6), other).vx, 0.0, "it is not that person's button");
        protection.on_guard(ms(200), &guard(0.0, 0.5, Hold::GuardStops));
        assert_eq!([249, 250].map(|at| protection.clamped(ms(at), along(0.6), HAND).vx), [0.15, 0.0]);
        protection.on_creep(ms(260), &creep("pad", true));
        protection.on_creep(ms(270), &creep("pad", false));
        assert_eq!(protection.clamped(ms(280), along(0.6), HAND).vx, 0.0);
    }

    #[test]
    fn bounds_that_are_no_numbers_permit_nothing() {
        let mut protection = guarded();
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            protection.on_guard(ms(0), &guard(bad, bad, Hold::GuardSlows));
            assert_eq!(protection.clamped(ms(0), along(0.6), HAND).vx, 0.0);
            assert_eq!(protection.clamped(ms(0), along(-0.6), HAND).vx, 0.0);
        }
    }
}
