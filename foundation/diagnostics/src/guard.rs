//! What the guard permits, for people (docs/guard.md).

use crate::Model;
use base::Instant;
use messages::Hold;
use messages::lowlevel::{DataGuard, Field};
use serde::Serialize;

/// Maximum number of fields that are kept, and of corners of each; `guard` publishes two of about twelve, and up to
/// eight of the configuration.
const FIELDS_MAX: usize = 10;
const CORNERS_MAX: usize = 64;
/// Greatest distance of a corner from the robot along an axis, m.
const CORNER_MAX_M: f64 = 100.0;
/// Speed below which the robot counts as standing, as in the module `guard`, m/s.
const STANDSTILL_MPS: f64 = 0.02;

/// Bound in the direction of travel; at standstill that of the direction along x that is bounded most.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bound {
    /// For people: `at most 0.32 m/s forward: sonar 3`.
    pub words: String,
    /// Greatest speed, m/s; 0: the robot must not move so.
    pub speed: f64,
    /// True if the guard has a cause for it: something sensed or unknown, no sensor, or silence. False: the reach of
    /// the sensors, or the limits of the robot.
    pub limits: bool,
    /// True while a person creeps past the guard by a second input.
    pub creeping: bool,
}

impl Model {
    /// Bound of the guard; `None` for a robot without one.
    #[must_use]
    pub fn bound(&self, now: Instant) -> Option<Bound> {
        self.guard.get()?;
        let creeping = self.motion_holds(now).is_some_and(|list| list.has(Hold::GuardCreep));
        let Some(guard) = self.guard.fresh(now) else {
            let words = Hold::GuardSilent.words("");
            return Some(Bound { words, speed: 0.0, limits: true, creeping });
        };
        let motion = self.motion.fresh(now).map_or(0.0, |motion| motion.speed);
        let backward = match motion {
            speed if speed > STANDSTILL_MPS => false,
            speed if speed < -STANDSTILL_MPS => true,
            _ => guard.backward < guard.forward,
        };
        let (speed, way) = if backward { (guard.backward, "backward") } else { (guard.forward, "forward") };
        // What is not a number permits nothing.
        let speed = speed.max(0.0);
        let most = if speed > 0.0 { format!("at most {speed:.2} m/s {way}") } else { format!("must not move {way}") };
        let words = match cause(guard) {
            cause if cause.is_empty() => most,
            cause => format!("{most}: {cause}"),
        };
        let words = if creeping { format!("creeping; otherwise {words}") } else { words };
        Some(Bound { words, speed, limits: guard.code != 0, creeping })
    }
}

/// Cause in a few words; empty without one.
fn cause(guard: &DataGuard) -> String {
    let subject = guard.subject.as_str();
    match Hold::from_code(guard.code) {
        Some(Hold::GuardStops | Hold::GuardSlows) => subject.into(),
        Some(Hold::GuardUnknown) => format!("nothing is known of {subject}"),
        Some(Hold::GuardBlind) => "no sensor looks there".into(),
        Some(other) => other.words(subject),
        None if guard.code == 0 => String::new(),
        None => format!("cause {}", guard.code),
    }
}

/// The message without what is not a field: any sender can publish it, and it is shown ten times a second.
pub(crate) fn limited(mut guard: DataGuard) -> DataGuard {
    guard.fields.retain(is_sound);
    guard.fields.truncate(FIELDS_MAX);
    guard
}

fn is_sound(field: &Field) -> bool {
    let near = |place: &f64| place.abs() <= CORNER_MAX_M;
    (3..=CORNERS_MAX).contains(&field.x.len())
        && field.x.len() == field.y.len()
        && field.x.iter().chain(&field.y).all(near)
}
