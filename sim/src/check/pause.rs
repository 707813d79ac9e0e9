//! The PAUSE line stops the robot (docs/design.md, section 4): no set-point leaves later than 20 ms after the driver
//! was served that the line is engaged, and the body's speed never rises, unless it touches something, which may hold
//! it and let it go before its wheels stand. If the robot has such a line, no set-point
//! leaves before its first report, nor 1.2 s after its last one; the same holds for a lidar's fields and an input of a
//! module that stop the robot, within 0.5 s.

use super::Verdict;
use super::facts::Facts;
use super::pause_line::{PAUSE_TIMEOUT, Pause};
use base::{Duration, Instant};

/// Maximum time from the report to the wire.
const REACTION_MAX: Duration = Duration::from_millis(20);
/// Timeout of the reports of a lidar's fields, and of an input, ten of which are sent in a second.
const STOPS_TIMEOUT: Duration = Duration::from_millis(500);
/// Speed change within a step of the body plus the rounding of the truth, m/s.
const SPEED_TOLERANCE_MPS: f64 = 0.005;
/// Distance from the nearest obstacle up to which that may hold the robot, m.
const HELD_M: f64 = 0.01;

/// A set-point has left the wire.
pub(super) fn on_set_point(now: Instant, speed: f64, facts: &Facts) -> Verdict {
    let slack = facts.slack(now);
    let line = facts.limits.power.is_some();
    let is_late = |at| now.since(at) > STOPS_TIMEOUT + REACTION_MAX.max(slack);
    let mut unknown = facts.limits.stops.iter().filter(|stop| facts.pause.known(&stop.source).is_none_or(is_late));
    if let Some(stop) = unknown.next() {
        let at = facts.pause.known(&stop.source);
        return Err(format!("{speed:.3} m/s, and the last report of {} is of {at:?}", stop.source));
    }
    match facts.pause.state() {
        Pause::Engaged(since) if now.since(since) > REACTION_MAX.max(slack) => {
            Err(format!("{speed:.3} m/s, and PAUSE is known since {since:?}"))
        }
        Pause::Unheard if line => Err(format!("{speed:.3} m/s before the PAUSE line was heard of")),
        Pause::Open if line && now.since(facts.pause.heard()) > PAUSE_TIMEOUT + slack => {
            Err(format!("{speed:.3} m/s, and the PAUSE line was last heard of at {:?}", facts.pause.heard()))
        }
        _ => Ok(()),
    }
}

/// Motion of the robot while PAUSE is known.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// Speed of the body.
    speed: Option<f64>,
    /// The last RPDO4 moves the robot.
    moves: bool,
    /// Longest time from the report to the stop on an undisturbed bus.
    pub worst: Option<Duration>,
}

impl Rule {
    /// A set-point has left the wire.
    pub fn on_moving(&mut self) {
        self.moves = true;
    }

    /// An RPDO4 that does not move the robot has left the wire.
    pub fn on_still(&mut self, now: Instant, facts: &Facts) {
        let moved = std::mem::take(&mut self.moves) && !facts.was_disturbed(now);
        if let (true, Pause::Engaged(since)) = (moved, facts.pause.state()) {
            self.worst = self.worst.max(Some(now.since(since)));
        }
    }

    /// Processes a sample of the body's speed, and its distance from the nearest obstacle, m.
    pub fn on_truth(&mut self, now: Instant, speed: f64, clearance: f64, facts: &Facts) -> Verdict {
        let known = matches!(facts.pause.state(), Pause::Engaged(since) if now.since(since) > REACTION_MAX);
        // A drive that receives nothing continues until its timeout of the master's heartbeat.
        let obeys = !facts.may_disobey(now) && !facts.is_cut_off(now) && !facts.is_disturbed(now);
        if !known || !obeys || !facts.driver.works() || clearance < HELD_M {
            self.speed = None;
            return Ok(());
        }
        let before = self.speed.replace(speed.abs());
        if let Some(before) = before.filter(|before| speed.abs() > before + SPEED_TOLERANCE_MPS) {
            return Err(format!("the speed rises from {before:.3} to {:.3} m/s under PAUSE", speed.abs()));
        }
        Ok(())
    }
}
