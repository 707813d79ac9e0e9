//! The loss of one drive stops the other (docs/design.md, section 4): the propulsion does not turn while the steering
//! is absent.
//!
//! No set-point 200 ms after the steering's last heartbeat, nor after it has reported a fault or has restarted.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};

/// Timeout of a node's heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(200);
/// NMT states in a heartbeat.
const BOOT_UP: u8 = 0;
const OPERATIONAL: u8 = 5;

/// Reports of the steering.
#[derive(Debug, Default)]
pub(super) struct Rule {
    heartbeat: Instant,
    /// Instant since which it is in fault, or not started.
    down: Option<Instant>,
}

impl Rule {
    /// Processes a frame on the wire, except those to the propulsion.
    pub fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], facts: &Facts) {
        let steering = &facts.limits.steering;
        if id == 0x700 + u16::from(steering.node) {
            self.heartbeat = now;
            match data.first() {
                Some(&BOOT_UP) => self.down = self.down.or(Some(now)),
                Some(&OPERATIONAL) => self.down = None,
                _ => {}
            }
        } else if steering.reported(id, data).is_some_and(|status| matches!(status & 0x4F, 0x08 | 0x0F)) {
            self.down = self.down.or(Some(now));
        }
    }

    /// Processes a frame of the steering that no node received.
    pub fn on_frame_lost(&mut self, id: u16, facts: &Facts) {
        let steering = &facts.limits.steering;
        if id == 0x700 + u16::from(steering.node) || steering.reports.iter().any(|place| place.id == id) {
            self.down = None;
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let slack = facts.slack(now);
        // Input that waited while the driver was held up is new to it.
        let ill = facts.driver.ill(now);
        if now.since(self.heartbeat.max(ill)) > HEARTBEAT + slack {
            return Err(format!("{speed:.3} m/s, and the steering's last heartbeat was at {:?}", self.heartbeat));
        }
        if let Some(down) = self.down.filter(|down| now.since(ill.max(*down)) > slack) {
            return Err(format!("{speed:.3} m/s, and the steering is in fault or not started since {down:?}"));
        }
        Ok(())
    }
}
