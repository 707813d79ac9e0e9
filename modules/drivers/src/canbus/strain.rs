//! Wheels that work against each other: forces of the motors that cancel each other through the floor, and move
//! nothing.
//!
//! Of a base with more wheels than motions a wheel that is to turn too fast may be held by the others: all speeds are
//! as commanded, and only the torques show it ([`Chassis::strain`](kinematics::Chassis)). Forces that accelerate, turn
//! or hold the robot have no such part, however great they are. Some is there in health, too: wheels differ in
//! diameter, friction and grip.
//!
//! Judged    while all wheels are to drive, at least one at [`TURNS_MPS`], each has its speed, and the set-points have
//!           not changed for [`SETTLED`]. Motors that are blocked, pushed or at their limit show it by their speeds,
//!           which others judge. On a ramp each drive follows its next set-point by a ramp of its own, and is there
//!           sooner or later than the others; at low speed wheels creep too little to make up for the resolution of
//!           their drives
//! Witness   the torque of each wheel, in a PDO and not older than a few of its periods, and the rated torque. A drive
//!           without them is reported at the start, one that falls silent when the robot drives; neither stops it

use super::Canbus;
use super::propulsion::Propulsion;
use super::servo::{Force, Servo};
use super::speed_monitor::{MARGIN_MPS, Order};
use base::{Duration, Fault, Instant, Level, Severity};
use kinematics::{Chassis, PerWheel};
use module::Actions;

/// Set-point that a wheel must have, m/s.
const TURNS_MPS: f64 = 0.1;
/// For how long the set-points must not have changed when a torque is received: longer than the period of those of a
/// ramp.
const SETTLED: Duration = Duration::from_millis(25);
/// What was judged before counts for this long while nothing is judged.
const PAUSE_MAX: Duration = Duration::from_millis(150);
/// How long the wheels must work against each other: a wheel may slip, or cross a gap in the floor.
const LONG: Duration = Duration::from_millis(150);
/// A wheel is named if its part is this much greater than that of any other.
const DISTINCT: f64 = 1.1;
/// Without torques for this long while the robot drives: reported.
const UNSEEN: Duration = Duration::from_secs(1);

/// How much the wheels work against each other.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Strain {
    /// Greatest part of a wheel's force that is cancelled by the others, of its rated force.
    part: f64,
    /// The same, N.
    newtons: f64,
    /// The wheel, if it stands out.
    wheel: Option<usize>,
}

impl Strain {
    /// Of the forces of all wheels; `None`: the base is not redundant, or has another number of wheels.
    fn of(chassis: &Chassis, forces: &[Force]) -> Option<Self> {
        let newtons: PerWheel<f64> = forces.iter().map(|force| force.newtons).collect();
        let cancelled = chassis.strain(&newtons)?;
        let part = |wheel: usize| cancelled[wheel].abs() / forces[wheel].rated;
        let worst = (0..forces.len()).max_by(|one, other| part(*one).total_cmp(&part(*other)))?;
        let stands_out = (0..forces.len()).all(|wheel| wheel == worst || part(worst) > DISTINCT * part(wheel));
        Some(Self { part: part(worst), newtons: cancelled[worst].abs(), wheel: stands_out.then_some(worst) })
    }
}

/// The watch over it.
#[derive(Debug, Default)]
pub(super) struct StrainWatch {
    /// Since when it has been too great, and when it was judged last.
    since: Option<Instant>,
    judged: Instant,
    /// Last set-points, and when they changed.
    set_points: PerWheel<f64>,
    changed: Instant,
    /// Since when the robot has driven without being judged for want of a torque.
    unseen: Option<Instant>,
    /// That was reported.
    reported: bool,
}

impl StrainWatch {
    /// Takes the set-points of all wheels, m/s.
    fn command(&mut self, now: Instant, set_points: PerWheel<f64>) {
        if self.set_points != set_points {
            (self.set_points, self.changed) = (set_points, now);
        }
    }

    /// True if a torque of this time is one of wheels that have their set-points.
    fn is_settled(&self, at: Instant) -> bool {
        at.since(self.changed) >= SETTLED
    }

    /// Takes the greatest part of a wheel's rated force; `None` if it is not judged. True once it has been above
    /// `allowed` for too long.
    fn measure(&mut self, now: Instant, part: Option<f64>, allowed: f64) -> bool {
        if now.since(self.judged) > PAUSE_MAX {
            self.since = None;
        }
        let Some(part) = part else { return false };
        self.judged = now;
        // False for NaN.
        if part > allowed {
            return now.since(*self.since.get_or_insert(now)) >= LONG;
        }
        self.since = None;
        false
    }

    /// `unseen`: the robot drives, and a torque is not known. True once that is to be reported.
    fn must_report(&mut self, now: Instant, unseen: bool) -> bool {
        if !unseen {
            self.unseen = None;
            return false;
        }
        let long = now.since(*self.unseen.get_or_insert(now)) >= UNSEEN;
        long && !std::mem::replace(&mut self.reported, true)
    }
}

/// Set-point of a wheel that is to drive and has its speed, m/s.
fn followed(now: Instant, wheel: &Propulsion) -> Option<f64> {
    let Order::Drive(target) = wheel.order() else { return None };
    // False for NaN.
    let follows = wheel.is_known(now) && (wheel.measured() - target).abs() <= MARGIN_MPS;
    follows.then_some(target)
}

impl Canbus {
    /// Reports at the start which drives do not show that wheels work against each other. A motor controller without
    /// CANopen never does.
    pub(super) fn report_blind_to_strain(&self, out: &mut Actions) {
        if !self.body.is_redundant() {
            return;
        }
        let blind = |wheel: &&Propulsion| wheel.servo().is_some_and(|servo| !servo.reports_torque());
        let names: Vec<&str> = self.wheels.iter().filter(blind).map(|wheel| wheel.axis.name()).collect();
        if !names.is_empty() {
            let names = names.join(", ");
            out.say(
                Level::Warning,
                format!("no torque of {names} in a PDO: wheels that work against each other are not noticed"),
            );
        }
    }

    /// Judges the forces of all wheels together; to be called after each decision.
    pub(super) fn watch_strain(&mut self, now: Instant, out: &mut Actions) {
        let Some(allowed) = self.body.strain_allowed() else { return };
        if !self.wheels.iter().all(|wheel| wheel.servo().is_some_and(Servo::reports_torque)) {
            return;
        }
        let forces: Option<PerWheel<Force>> = self.wheels.iter().map(|wheel| wheel.force(now)).collect();
        let set_points: Option<PerWheel<f64>> = self.wheels.iter().map(|wheel| followed(now, wheel)).collect();
        let set_points = set_points.filter(|all| all.iter().any(|speed| speed.abs() >= TURNS_MPS));
        let drives = set_points.is_some();
        self.strain.command(now, set_points.unwrap_or_default());
        if self.strain.must_report(now, drives && forces.is_none()) {
            out.say(
                Level::Warning,
                "no torque of all wheels is received: wheels that work against each other are not noticed",
            );
        }
        let settled = |forces: &PerWheel<Force>| forces.iter().all(|force| self.strain.is_settled(force.at));
        let forces = forces.filter(|forces| drives && settled(forces));
        let strain = forces.and_then(|forces| Strain::of(self.body.chassis(), &forces));
        let too_long = self.strain.measure(now, strain.map(|strain| strain.part), allowed);
        let Some(Strain { part, newtons, wheel }) = strain.filter(|_| too_long && !self.agreement.stops) else {
            return;
        };
        self.agreement.stops = true;
        let name = wheel.and_then(|wheel| self.wheels.iter().nth(wheel)).map(|wheel| wheel.axis.name());
        let who = name.map_or_else(
            || "the wheels work against each other".into(),
            |name| format!("{name} works against the other wheels"),
        );
        let percent = 100.0 * part;
        let what = format!("{who}, by {newtons:.0} N, {percent:.0} % of the rated torque: the robot stops");
        out.raise(Severity::Error, Fault::WheelsDisagree, "", what);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinematics::{Limits, Twist};

    const LIMITS: Limits = Limits { speed_mps: 1.0, acceleration_mps2: 0.5, deceleration_mps2: 0.8 };
    const RATED_N: f64 = 35.0;
    const ALLOWED: f64 = 0.3;

    fn at(millis: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(millis)
    }

    fn mecanum() -> Chassis {
        Chassis::mecanum(0.45, 0.42, LIMITS).expect("a base")
    }

    fn strain(chassis: &Chassis, forces: &[f64]) -> Strain {
        let forces: PerWheel<Force> =
            forces.iter().map(|newtons| Force { newtons: *newtons, rated: RATED_N, at: at(0) }).collect();
        Strain::of(chassis, &forces).expect("a redundant base")
    }

    /// Forces of equal motors: `push` on each wheel by a force and a moment on the body, `losses` against its motion.
    fn forces(push: Twist, motion: Twist, losses: f64) -> [f64; 4] {
        let speeds = |twist| mecanum().wheel_states(twist, &[]);
        let (push, motion) = (speeds(push), speeds(motion));
        core::array::from_fn(|wheel| push[wheel].speed_mps + losses * motion[wheel].speed_mps.signum())
    }

    #[test]
    fn a_body_that_gains_speed_turns_or_climbs_is_not_strained() {
        let ahead = Twist::new(0.4, 0.0, 0.0);
        for (push, motion) in [
            // 95 kg at 0.5 m/s²; a slope of 10 %; braking; to the side; on the spot; all at once, and a person who
            // pushes.
            (Twist::new(12.0, 0.0, 0.0), ahead),
            (Twist::new(25.0, 0.0, 0.0), ahead),
            (Twist::new(-19.0, 0.0, 0.0), ahead),
            (Twist::new(0.0, 12.0, 0.0), Twist::new(0.0, 0.4, 0.0)),
            (Twist::new(0.0, 0.0, 30.0), Twist::new(0.0, 0.0, 0.5)),
            (Twist::new(20.0, -15.0, 25.0), Twist::new(0.3, -0.2, 0.4)),
        ] {
            let Strain { part, .. } = strain(&mecanum(), &forces(push, motion, 4.0));
            // Of friction alone, which has the sign of each wheel's motion.
            assert!(part <= 4.0 / RATED_N + 1e-9, "{push:?}: {part}");
        }
    }

    #[test]
    fn a_wheel_that_slips_or_is_stiff_is_within_what_is_allowed() {
        // It transmits nothing, and the others gain speed or climb without it.
        for push in [12.0 + 4.0, 25.0 + 4.0] {
            let mut forces = [push * 4.0 / 3.0; 4];
            forces[2] = 0.0;
            let Strain { part, .. } = strain(&mecanum(), &forces);
            assert!(part < ALLOWED, "{push}: {part}");
        }
        let Strain { part, .. } = strain(&mecanum(), &[16.0, 16.0 + 20.0, 16.0, 16.0]);
        assert!(part < ALLOWED, "{part}");
    }

    #[test]
    fn one_wheel_against_three_is_found_and_not_named_where_no_geometry_can_tell() {
        for wheel in 0..4 {
            // Three hold it by the same force: both front wheels against both rear ones.
            let sign = if wheel < 2 { 1.0 } else { -1.0 };
            let fight = [1.0, 1.0, -1.0, -1.0].map(|own| sign * own * 36.0);
            let moving = forces(Twist::new(12.0, 0.0, 5.0), Twist::new(0.4, 0.0, 0.1), 4.0);
            let found = strain(&mecanum(), &core::array::from_fn::<f64, 4, _>(|n| fight[n] + moving[n]));
            assert!(found.part > 0.9 && found.newtons > 32.0 && found.wheel.is_none(), "{found:?}");
        }
        // Five wheels can tell: each resists by its share.
        let omni = Chassis::omni(0.25, 5, 0.3, LIMITS).expect("a base");
        for wheel in 0..5 {
            let mut forces = [2.0; 5];
            forces[wheel] = 60.0;
            let found = strain(&omni, &forces);
            assert!(found.part > 0.6 && found.wheel == Some(wheel), "{found:?}");
        }
    }

    #[test]
    fn it_counts_once_it_has_lasted_and_begins_anew_after_one_that_is_small() {
        for less in [0.3, f64::NAN] {
            let mut watch = StrainWatch::default();
            let mut measure = |ms, part| watch.measure(at(ms), Some(part), ALLOWED);
            assert!(!measure(0, 0.31) && !measure(149, 0.31) && !measure(160, less));
            assert!(!measure(180, 0.31) && !measure(329, 0.31) && measure(330, 0.31));
        }
    }

    #[test]
    fn a_short_pause_does_not_begin_anew_and_a_long_one_does() {
        for (pause, found) in [(150, true), (151, false)] {
            let mut watch = StrainWatch::default();
            assert!(!watch.measure(at(1000), Some(0.31), ALLOWED));
            assert!(!watch.measure(at(1000 + pause / 2), None, ALLOWED));
            assert_eq!(watch.measure(at(1000 + pause), Some(0.31), ALLOWED), found, "{pause} ms");
        }
    }

    #[test]
    fn a_torque_counts_from_a_while_after_the_last_set_point() {
        let mut watch = StrainWatch::default();
        let set = |watch: &mut StrainWatch, ms, speed| watch.command(at(ms), [speed; 4].into_iter().collect());
        // A ramp, as the driver makes it.
        for step in 0..50 {
            set(&mut watch, 20 * step, 0.01 * step as f64);
            assert!(!watch.is_settled(at(20 * step + 19)));
        }
        set(&mut watch, 1000, 0.49);
        assert!(!watch.is_settled(at(1004)) && watch.is_settled(at(1005)));
        set(&mut watch, 1010, 0.5);
        assert!(!watch.is_settled(at(1034)) && watch.is_settled(at(1035)));
    }

    #[test]
    fn unknown_torques_are_reported_once_and_only_after_a_while() {
        let mut watch = StrainWatch::default();
        assert!(!watch.must_report(at(0), true));
        assert!(!watch.must_report(at(900), false));
        assert!(!watch.must_report(at(1000), true));
        assert!(!watch.must_report(at(1999), true));
        assert!(watch.must_report(at(2000), true));
        assert!(!watch.must_report(at(9000), true));
    }
}
