//! The PAUSE line stops the robot (docs/design.md, section 4): no set-point leaves later than 20 ms after the driver
//! was served that the line is engaged, and the body's speed never rises. If the robot has such a line, no set-point
//! leaves before its first report, nor 1.2 s after its last one.

use super::Verdict;
use super::facts::{Facts, Pause};
use base::{Duration, Instant};

/// Maximum time from the report to the wire.
const REACTION_MAX: Duration = Duration::from_millis(20);
/// Timeout of `LL_EVENT_STOP`, which is sent every 500 ms.
const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);
/// Speed change within a step of the body plus the rounding of the truth, m/s.
const SPEED_TOLERANCE_MPS: f64 = 0.005;

/// A set-point has left the wire.
pub(super) fn on_set_point(now: Instant, speed: f64, facts: &Facts) -> Verdict {
    let slack = facts.slack(now);
    match facts.pause {
        Pause::Engaged(since) if now.since(since) > REACTION_MAX.max(slack) => {
            Err(format!("{speed:.3} m/s, and PAUSE is known since {since:?}"))
        }
        Pause::Unheard if facts.limits.pause_line => Err(format!("{speed:.3} m/s before the PAUSE line was heard of")),
        Pause::Open if facts.limits.pause_line && now.since(facts.pause_at) > PAUSE_TIMEOUT + slack => {
            Err(format!("{speed:.3} m/s, and the PAUSE line was last heard of at {:?}", facts.pause_at))
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
        if let (true, Pause::Engaged(since)) = (moved, facts.pause) {
            self.worst = self.worst.max(Some(now.since(since)));
        }
    }

    /// Processes a sample of the body's speed.
    pub fn on_truth(&mut self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let known = matches!(facts.pause, Pause::Engaged(since) if now.since(since) > REACTION_MAX);
        // A drive that receives nothing continues until its timeout of the master's heartbeat.
        if !known || facts.is_cut_off(now) || facts.is_disturbed(now) || !facts.driver.works() {
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
