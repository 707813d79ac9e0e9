//! The loss of one drive stops all others (docs/design.md, section 4): the propulsion does not turn while the steering
//! is absent, nor do wheels that turn the robot together while one of them is.
//!
//! No set-point 200 ms after the drive's last heartbeat, nor after it has reported a fault or has restarted; and 300 ms
//! later no wheel turns any more, by its last set-point and its own report, unless the body stands.

use super::facts::{DELAY_MAX, Facts, QUEUE_AGE};
use super::wire::{Drive, Heartbeat};
use super::{Limits, Verdict};
use base::{Duration, Instant};

/// Timeout of a node's heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(200);
/// Maximum time from then until the others are commanded to stop, or stop by themselves.
const STOP_MAX: Duration = Duration::from_millis(300);
/// Speed below which the body counts as standing, m/s.
const STANDSTILL_MPS: f64 = 0.02;

/// A drive without which the robot does not move.
#[derive(Debug)]
struct Watched {
    name: String,
    drive: Drive,
    /// When its last heartbeat was sent, and until when that may have been received.
    heartbeat: Instant,
    heard: Instant,
    /// Instant since which it is not started.
    reset: Option<Instant>,
    /// Instant since which it is in fault.
    fault: Option<Instant>,
}

impl Watched {
    fn new(name: &str, drive: &Drive) -> Self {
        Self {
            name: name.into(),
            drive: drive.clone(),
            heartbeat: Instant::ZERO,
            heard: Instant::ZERO,
            reset: None,
            fault: None,
        }
    }

    fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], facts: &Facts) {
        if let Some(heartbeat) = self.drive.heartbeat(id, data) {
            self.heartbeat = now;
            self.heard = if facts.is_disturbed(now) { now + QUEUE_AGE } else { now };
            match heartbeat {
                Heartbeat::Down => self.reset = self.reset.or(Some(now)),
                Heartbeat::Operational => self.reset = None,
                Heartbeat::Other => {}
            }
        }
        if let Some(status) = self.drive.reported(id, data) {
            // CiA 402-2, statusword: fault, fault reaction active.
            let is_fault = matches!(status & 0x4F, 0x08 | 0x0F);
            self.fault = if is_fault { self.fault.or(Some(now)) } else { None };
        }
    }

    /// Instant since which it is missing. Input that waited while the driver was held up until `ill` is new to it.
    fn missing(&self, ill: Instant) -> Instant {
        let silent = self.heard.max(ill) + HEARTBEAT;
        self.reset.or(self.fault).map_or(silent, |down| silent.min(down.max(ill)))
    }

    /// Why it is missing.
    fn why(&self) -> String {
        let Self { name, heartbeat, reset, fault, .. } = self;
        match reset.or(*fault) {
            Some(down) => format!("the {name} drive is in fault or not started since {down:?}"),
            None => format!("the {name} drive's last heartbeat was at {heartbeat:?}"),
        }
    }
}

/// Reports of the drives.
#[derive(Debug)]
pub(super) struct Rule {
    watched: Vec<Watched>,
}

impl Rule {
    pub fn new(limits: &Limits) -> Self {
        let watched = match &limits.steering {
            Some(steering) => vec![Watched::new(super::STEERING, steering)],
            None => limits.drives().map(|(name, drive)| Watched::new(name, drive)).collect(),
        };
        Self { watched }
    }

    /// Processes a frame on the wire, except those to the propulsion.
    pub fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], facts: &Facts) {
        self.watched.iter_mut().for_each(|drive| drive.on_frame(now, id, data, facts));
    }

    /// Processes a frame of a drive that no node received.
    pub fn on_frame_lost(&mut self, id: u16) {
        for drive in &mut self.watched {
            if drive.drive.heartbeat_id() == id || drive.drive.reports.iter().any(|place| place.id == id) {
                (drive.reset, drive.fault) = (None, None);
            }
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        match self.missing(facts.driver.ill(now)) {
            Some((since, drive)) if now.since(since) > facts.slack(now) => {
                Err(format!("{speed:.3} m/s, and {}", drive.why()))
            }
            _ => Ok(()),
        }
    }

    /// Processes a sample of the body's speed, m/s. What a drive does that is not reached, or does not obey, is judged
    /// by other rules.
    pub fn on_truth(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let excused = facts.is_disturbed(now) || facts.is_cut_off(now) || facts.may_disobey(now);
        if speed.abs() < STANDSTILL_MPS || excused || facts.wheels.len() < 2 || !facts.driver.is_well() {
            return Ok(());
        }
        match self.missing(facts.driver.ill(now)) {
            Some((since, drive)) if now.since(since) > STOP_MAX + DELAY_MAX && self.others_move(now, facts) => {
                Err(format!("{speed:.3} m/s, {}, and not all wheels are commanded to stop", drive.why()))
            }
            _ => Ok(()),
        }
    }

    /// True if the last set-points move the robot; of drives that get no command while they are lost, those of the
    /// others.
    fn others_move(&self, now: Instant, facts: &Facts) -> bool {
        if !facts.limits.repeats() {
            return facts.set_point.speed().is_some();
        }
        let ill = facts.driver.ill(now);
        let mut wheels = self.watched.iter().zip(&facts.wheels);
        wheels.any(|(drive, set_point)| drive.missing(ill) > now && set_point.speed().is_some())
    }

    /// The drive that is missing longest.
    fn missing(&self, ill: Instant) -> Option<(Instant, &Watched)> {
        self.watched.iter().map(|drive| (drive.missing(ill), drive)).min_by_key(|(since, _)| *since)
    }
}
