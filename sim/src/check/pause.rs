//! The PAUSE line stops the robot (DESIGN 4; the bound): once the driver was served that it is engaged no
//! set-point leaves after 20 ms, and the body's speed never rises. Where there is such a line, none leaves either
//! before it was heard of, nor 1.2 s after it was last heard of.

use super::Verdict;
use super::facts::{Facts, Pause};
use base::{Duration, Instant};

/// From knowing to the wire.
const REACTION_MAX: Duration = Duration::from_millis(20);
/// `LL_EVENT_STOP` comes every 500 ms.
const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);
/// A step of the body, and one of the truth's rounding, m/s.
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
    /// The body's speed.
    speed: Option<f64>,
    /// The last RPDO4 moves it.
    moves: bool,
    /// The longest from knowing to the stop, where the bus is well.
    pub worst: Option<Duration>,
}

impl Rule {
    /// A set-point has left the wire.
    pub fn on_moving(&mut self) {
        self.moves = true;
    }

    /// An RPDO4 has left the wire that does not move the robot.
    pub fn on_still(&mut self, now: Instant, facts: &Facts) {
        let moved = std::mem::take(&mut self.moves) && !facts.was_disturbed(now);
        if let (true, Pause::Engaged(since)) = (moved, facts.pause) {
            self.worst = self.worst.max(Some(now.since(since)));
        }
    }

    /// The body was seen.
    pub fn on_truth(&mut self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let known = matches!(facts.pause, Pause::Engaged(since) if now.since(since) > REACTION_MAX);
        // A drive that receives nothing goes on until its own time limit for the master's heartbeat.
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
