//! Restart of a controller that went bus-off, with exponential back-off.

use base::{Duration, Instant};

/// First and maximum delay; it doubles each time.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(5));

/// Restart timer; its delay is reset once the controller has been on the bus for some time.
#[derive(Debug)]
pub struct Restart {
    /// Time of the next restart; `None` while not bus-off.
    at: Option<Instant>,
    back_off: Duration,
    since: Instant,
}

impl Default for Restart {
    fn default() -> Self {
        Self { at: None, back_off: BACK_OFF.0, since: Instant::ZERO }
    }
}

impl Restart {
    /// The controller is bus-off.
    pub fn off(&mut self, now: Instant) {
        if now.since(self.since) > BACK_OFF.1 {
            self.back_off = BACK_OFF.0;
        }
        self.at = Some(now + self.back_off);
        self.back_off = (self.back_off * 2).min(BACK_OFF.1);
    }

    /// True if a restart is due; schedules the next one.
    pub fn is_due(&mut self, now: Instant) -> bool {
        let Some(at) = self.at else {
            self.off(now);
            return false;
        };
        let due = at <= now;
        if due {
            self.since = now;
            self.off(now);
        }
        due
    }

    /// The controller is on the bus.
    pub fn on(&mut self, now: Instant) {
        (self.at, self.since) = (None, now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn restarts_back_off_until_the_bus_was_stable() {
        let mut restart = Restart::default();
        let (mut due, mut now) = (Vec::new(), Instant::from_millis(10_000));
        restart.off(now);
        let mut last = now;
        while due.len() < 8 {
            now += Duration::from_millis(1);
            if restart.is_due(now) {
                due.push(now.since(last).as_millis());
                last = now;
            }
        }
        assert_eq!(due, [100, 200, 400, 800, 1600, 3200, 5000, 5000]);
        restart.on(now);
        restart.off(now + Duration::from_secs(1));
        assert!(!restart.is_due(now + Duration::from_secs(5)));
        restart.on(now);
        restart.off(now + Duration::from_secs(6));
        assert!(restart.is_due(now + Duration::from_millis(6100)));
    }
}
