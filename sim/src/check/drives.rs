//! The loss of one drive stops all others (docs/design.md, section 4): the propulsion does not turn while the steering
//! is absent, nor do wheels that turn the robot together while one of them is.
//!
//! No set-point 200 ms after the drive's last heartbeat, nor after it has reported a fault or has restarted; and 300 ms
//! later no wheel turns any more, by its last set-point and its own report, unless the body stands.
//!
//! A CANopen drive reports that it stops by itself when it no longer receives its master: by emergency 0x8130, and by a
//! heartbeat that is not Operational, in which state it takes no set-point (CiA 301). Its last set-point then moves
//! nothing. The report is not believed: the wheel itself must stand within the time of a quick stop. What may go on
//! is a wheel whose drive has restarted: its power stage is off, and it rolls. Two of three omni wheels that stand
//! leave the body one motion, a turn about the point where their axles meet, in which the third wheel rolls. Nothing
//! but the losses of this one wheel slows the body down then, at less than the deceleration of all of them, for some
//! seconds.

use super::facts::{DELAY_MAX, Facts, OPERATION_ENABLED, QUEUE_AGE, STATE_MASK, SetPoint};
use super::wire::{Drive, Heartbeat};
use super::{Limits, Verdict};
use base::{Duration, Instant};
use kinematics::Twist;

/// Timeout of a node's heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(200);
/// Maximum time from then until the others are commanded to stop, or stop by themselves.
const STOP_MAX: Duration = Duration::from_millis(300);
/// Speed below which the body, or a wheel, counts as standing, m/s.
const STANDSTILL_MPS: f64 = 0.02;
/// Time beside the ramp within which a wheel stands whose drive stops by itself: two samples of the body's motion.
const SAMPLES: Duration = Duration::from_millis(100);

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
    /// Since when it has reported that it stops by itself, and the speed of the body's fastest wheel then, m/s; without
    /// a set-point since then.
    stops: Option<(Instant, f64)>,
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
            stops: None,
        }
    }

    /// `speed`: of the body's fastest wheel, m/s.
    fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], speed: f64, facts: &Facts) {
        if let Some(heartbeat) = self.drive.heartbeat(id, data) {
            self.heartbeat = now;
            self.heard = if facts.is_disturbed(now) { now + QUEUE_AGE } else { now };
            match heartbeat {
                Heartbeat::Down => (self.reset, self.stops) = (self.reset.or(Some(now)), None),
                Heartbeat::Operational => self.reset = None,
                Heartbeat::Other if self.reset.is_none() => self.stops = self.stops.or(Some((now, speed))),
                Heartbeat::Other => {}
            }
        }
        if self.drive.loses_master(id, data) {
            self.stops = self.stops.or(Some((now, speed)));
        }
        if let Some(status) = self.drive.reported(id, data) {
            // CiA 402-2, statusword: fault, fault reaction active.
            let is_fault = matches!(status & 0x4F, 0x08 | 0x0F);
            self.fault = if is_fault { self.fault.or(Some(now)) } else { None };
            if status & STATE_MASK == OPERATION_ENABLED {
                self.stops = None;
            }
        }
    }

    /// Instant since which it is missing. Input that waited while the driver was held up until `ill` is new to it.
    fn missing(&self, ill: Instant) -> Instant {
        let silent = self.heard.max(ill) + HEARTBEAT;
        self.reset.or(self.fault).map_or(silent, |down| silent.min(down.max(ill)))
    }

    /// True if it is moved by a set-point: it has neither restarted since then, nor reported that it stops by itself.
    fn obeys(&self, set_point: SetPoint) -> bool {
        set_point.speed().is_some() && self.reset.is_none() && self.stops.is_none()
    }

    /// True if it reported that it stops by itself, and turns at `speed`, m/s, when its quick stop must have ended.
    /// Without power it may roll.
    fn turns_on(&self, now: Instant, speed: f64, quick_stop: f64) -> bool {
        let ended = |(since, from): (Instant, f64)| since + SAMPLES + Duration::from_secs_f64(from / quick_stop) < now;
        let powered = self.reset.is_none() && self.fault.is_none();
        powered && self.stops.is_some_and(ended) && speed.abs() > STANDSTILL_MPS
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
    /// Speed of the body's fastest wheel at the last sample, m/s.
    speed: f64,
}

impl Rule {
    pub fn new(limits: &Limits) -> Self {
        let watched = match &limits.steering {
            Some(steering) => vec![Watched::new(super::STEERING, steering)],
            None => limits.drives().map(|(name, drive)| Watched::new(name, drive)).collect(),
        };
        Self { watched, speed: 0.0 }
    }

    /// Processes a frame on the wire, except those to the propulsion.
    pub fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], facts: &Facts) {
        self.watched.iter_mut().for_each(|drive| drive.on_frame(now, id, data, self.speed, facts));
    }

    /// Processes a frame of a drive that no node received.
    pub fn on_frame_lost(&mut self, id: u16) {
        for drive in &mut self.watched {
            if drive.drive.heartbeat_id() == id || drive.drive.reports.iter().any(|place| place.id == id) {
                (drive.reset, drive.fault) = (None, None);
            }
        }
    }

    /// A command of a wheel that moves it has left the wire: what its drive reported before is over.
    pub fn on_moving(&mut self, wheel: usize, facts: &Facts) {
        let name = &facts.limits.wheels[wheel].name;
        self.watched.iter_mut().filter(|drive| drive.name == *name).for_each(|drive| drive.stops = None);
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

    /// Processes a sample of the body's speed and velocity. What a drive does that is not reached, or does not obey, is
    /// judged by other rules.
    pub fn on_truth(&mut self, now: Instant, speed: f64, twist: Twist, facts: &Facts) -> Verdict {
        self.speed = speed.abs();
        let excused = facts.is_disturbed(now) || facts.is_cut_off(now) || facts.may_disobey(now);
        if speed.abs() < STANDSTILL_MPS || excused || facts.wheels.len() < 2 || !facts.driver.is_well() {
            return Ok(());
        }
        let Some((since, drive)) = self.missing(facts.driver.ill(now)) else { return Ok(()) };
        if now.since(since) <= STOP_MAX + DELAY_MAX {
            return Ok(());
        }
        if self.others_move(now, facts) {
            return Err(format!("{speed:.3} m/s, {}, and not all wheels are commanded to stop", drive.why()));
        }
        match self.turns_on(now, twist, facts) {
            Some(other) => Err(format!("{}, and the {} wheel turns on, which reports a stop", drive.why(), other.name)),
            None => Ok(()),
        }
    }

    /// True if the last set-points move the robot; of drives that get no command while they are lost, those of the
    /// others.
    fn others_move(&self, now: Instant, facts: &Facts) -> bool {
        let mut wheels = self.watched.iter().zip(&facts.wheels);
        if !facts.limits.repeats() {
            return wheels.any(|(drive, set_point)| drive.obeys(*set_point));
        }
        let ill = facts.driver.ill(now);
        wheels.any(|(drive, set_point)| drive.missing(ill) > now && set_point.speed().is_some())
    }

    /// A drive of a CANopen base that reported that it stops by itself, and whose wheel turns.
    fn turns_on(&self, now: Instant, twist: Twist, facts: &Facts) -> Option<&Watched> {
        let base = facts.limits.base.as_ref().filter(|_| !facts.limits.repeats())?;
        let speeds = base.chassis.wheel_states(twist, &[]);
        let mut wheels = self.watched.iter().zip(&speeds);
        let quick_stop = facts.limits.quick_stop;
        let found = wheels.find(|(drive, wheel)| drive.turns_on(now, wheel.speed_mps, quick_stop));
        found.map(|(drive, _)| drive)
    }

    /// The drive that is missing longest.
    fn missing(&self, ill: Instant) -> Option<(Instant, &Watched)> {
        self.watched.iter().map(|drive| (drive.missing(ill), drive)).min_by_key(|(since, _)| *since)
    }
}
