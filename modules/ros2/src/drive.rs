//! `/cmd_vel` as a source of motion. A velocity is passed on at once, and repeated while it holds: ROS sends at its own
//! rate, the robot's driver expects 20 Hz. When ROS is silent, so is this source, and the driver stops the robot.

use crate::incoming::Velocity;
use base::{Duration, Instant};
use messages::lowlevel::CmdVelocity;

/// Period of the repetition.
const PERIOD: Duration = Duration::from_millis(50);
/// Shortest time between two commands: of faster ones the newest counts.
const SPACING: Duration = Duration::from_millis(10);

/// Name among the sources of motion.
pub const SOURCE: &str = "ros2";

/// What is set.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Among the sources of motion.
    pub priority: i8,
    /// Silence of ROS after which the robot is to stop.
    pub ttl: Duration,
    /// Silence of a source after which the robot's driver stops it: `limits.command_ttl_s`.
    pub driver_ttl: Duration,
}

/// The source.
#[derive(Clone, Debug)]
pub struct Drive {
    config: Config,
    held: Option<Held>,
    /// Time of the last command.
    last: Option<Instant>,
}

#[derive(Clone, Copy, Debug)]
struct Held {
    velocity: Velocity,
    session: i64,
    /// The last repetition is before.
    until: Instant,
    due: Instant,
}

impl Drive {
    /// Creates the source, which is silent.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self { config, held: None, last: None }
    }

    /// A velocity that was received at `at`, from the publisher `session`. False: it is too old.
    pub fn on_velocity(&mut self, now: Instant, at: Instant, session: i64, velocity: Velocity) -> bool {
        let age = now.since(at);
        if age >= self.config.ttl {
            return false;
        }
        // The driver counts its own time from the last repetition on.
        let until = at + self.config.ttl.saturating_sub(self.config.driver_ttl);
        let due = self.last.map_or(now, |last| now.max(last + SPACING));
        self.held = Some(Held { velocity, session, until, due });
        true
    }

    /// Nothing is to be sent any more: ROS may not command now.
    pub fn end(&mut self) {
        self.held = None;
    }

    /// When [`poll`](Self::poll) is to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.held.map(|held| held.due)
    }

    /// The command that is due; `timestamp` is that of now, µs since the UNIX epoch.
    pub fn poll(&mut self, now: Instant, timestamp: i64) -> Option<CmdVelocity> {
        let held = self.held.as_mut().filter(|held| held.due <= now)?;
        let Held { velocity: Velocity { vx, vy, omega }, session, until, .. } = *held;
        held.due = now + PERIOD;
        if held.due > until {
            self.held = None;
        }
        self.last = Some(now);
        Some(CmdVelocity { timestamp, vx, vy, omega, priority: self.config.priority, source: SOURCE.into(), session })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AHEAD: Velocity = Velocity { vx: 0.3, vy: 0.0, omega: 0.1 };

    fn ms(millis: u64) -> Instant {
        Instant::from_millis(1000 + millis)
    }

    fn drive(ttl: u64, driver_ttl: u64) -> Drive {
        let [ttl, driver_ttl] = [ttl, driver_ttl].map(Duration::from_millis);
        Drive::new(Config { priority: 1, ttl, driver_ttl })
    }

    /// Times of the commands, ms.
    fn run(drive: &mut Drive, from: u64, to: u64) -> Vec<u64> {
        (from..to).filter(|now| drive.poll(ms(*now), 0).is_some()).collect()
    }

    #[test]
    fn a_velocity_is_sent_at_once_and_repeated_so_that_the_driver_stops_at_the_time_to_live() {
        let mut drive = drive(500, 250);
        assert!(drive.on_velocity(ms(0), ms(0), 7, AHEAD));
        assert_eq!(drive.poll_timeout(), Some(ms(0)));
        assert_eq!(run(&mut drive, 0, 1000), [0, 50, 100, 150, 200, 250]);
        assert_eq!(drive.poll_timeout(), None);
        // The last one at 250 ms, and 250 ms of the driver.
        let first = drive.on_velocity(ms(1000), ms(1000), 7, AHEAD).then(|| drive.poll(ms(1000), 42)).flatten();
        let CmdVelocity { timestamp, vx, omega, priority, source, session, .. } = first.unwrap();
        assert_eq!((timestamp, vx, omega, priority, &*source, session), (42, 0.3, 0.1, 1, "ros2", 7));
    }

    #[test]
    fn a_time_to_live_as_short_as_the_driver_s_repeats_nothing() {
        for ttl in [100, 250] {
            let mut drive = drive(ttl, 250);
            drive.on_velocity(ms(0), ms(0), 7, AHEAD);
            assert_eq!(run(&mut drive, 0, 1000), [0]);
        }
    }

    #[test]
    fn what_waited_too_long_moves_nothing_and_what_waited_a_little_moves_for_the_rest() {
        let mut drive = drive(500, 250);
        assert!(!drive.on_velocity(ms(500), ms(0), 7, AHEAD));
        assert_eq!(run(&mut drive, 500, 2000), [0; 0]);
        assert!(drive.on_velocity(ms(2200), ms(2000), 7, AHEAD));
        assert_eq!(run(&mut drive, 2200, 3000), [2200, 2250]);
    }

    #[test]
    fn of_a_flood_the_newest_counts() {
        let mut drive = drive(500, 250);
        let mut sent = Vec::new();
        for micros in 0..100_000 {
            let now = ms(0) + Duration::from_micros(micros);
            drive.on_velocity(now, now, 7, Velocity { vx: micros as f64, ..AHEAD });
            sent.extend(drive.poll(now, 0).map(|command| command.vx));
        }
        assert_eq!(sent, (0..10).map(|n| f64::from(n) * 10_000.0).collect::<Vec<_>>());
    }

    #[test]
    fn after_the_end_it_is_silent() {
        let mut drive = drive(500, 250);
        drive.on_velocity(ms(0), ms(0), 7, AHEAD);
        drive.poll(ms(0), 0);
        drive.end();
        assert_eq!(run(&mut drive, 0, 1000), [0; 0]);
    }
}
