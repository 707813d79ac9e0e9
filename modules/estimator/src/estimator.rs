//! The module: messages in, `ML_DATA_ESTIMATE` out.
//!
//! Takes    `LL_DATA_ODO` (20 Hz), `LL_DATA_BEACONS` (each sighting at its own instant), `LL_DATA_MOTION` (what the
//!          drives do, where the odometry is silent or stuck), `ML_CMD_ESTIMATE` (the pose by hand)
//! Gives    `ML_DATA_ESTIMATE` 20 times a second, predicted to that moment; `LL_DATA_ACTIVE_BEACONS` every five seconds
//! Silence  without odometry it goes by the drives, and by nothing without them: never better than COARSE then
//! States   in PAUSE and STOP it keeps its state and goes on following; in STOP it says nothing

use crate::active;
use crate::filter::{self, Filter, Noise, Quality, Refused};
use crate::ways::{Source, Ways};
use base::{Duration, Epoch, Fault, Instant, Severity, Ticker};
use messages::lowlevel::{DataActiveBeacons, DataBeacons, DataMotion, DataOdo};
use messages::middlelevel::{CmdEstimate, DataEstimate};
use messages::{Channel, Message};
use module::{Actions, Event, Module, State};
use navitools::Pose;

/// The module's name.
pub const NAME: &str = "estimator";
const PERIOD: Duration = Duration::from_millis(50);
/// Which beacons are active is told this often, in periods.
const ACTIVE_EVERY: u32 = 100;
/// A stamp and the moment its message came differ by less than this, or their makers' clocks do not agree.
const AGREES: Duration = Duration::from_millis(150);
/// The drives' wheels slip and the steering has play.
const BY_DRIVES: Noise = Noise { along_per_m: 0.05, along_per_s: 0.03, turn_per_m: 0.05, turn_per_s: 0.02 };
/// One of both is wrong, and bearings decide.
const IN_CONFLICT: Noise = Noise { along_per_m: 0.3, along_per_s: 0.2, turn_per_m: 0.2, turn_per_s: 0.1 };

/// Configuration of the module.
#[derive(Clone, Debug)]
pub struct Config {
    /// Of the filter, with the map of beacons.
    pub filter: filter::Config,
    /// Between the axles, m.
    pub wheelbase_m: f64,
    /// Between the front wheels, m.
    pub track_m: f64,
    /// What the scanner takes at once.
    pub active_max: usize,
}

/// The module.
#[derive(Debug)]
pub struct Estimator {
    config: Config,
    filter: Filter,
    ways: Ways,
    tick: Option<Ticker>,
    ticks: u32,
    active: Vec<i32>,
    source: Source,
    silent: bool,
    /// Whether a pose was ever known, and whether that is told to be lost.
    known: bool,
    lost: bool,
    /// Doubts that are told.
    doubted: u64,
    bad: bool,
    unknown: Vec<i32>,
}

impl Estimator {
    /// A module that has not started.
    ///
    /// # Errors
    /// When the configuration cannot be.
    pub fn new(config: Config) -> Result<Self, filter::ConfigError> {
        Ok(Self {
            filter: Filter::new(config.filter.clone())?,
            ways: Ways::new(config.wheelbase_m, config.track_m),
            config,
            tick: None,
            ticks: 0,
            active: Vec::new(),
            source: Source::Nobody,
            silent: false,
            known: false,
            lost: false,
            doubted: 0,
            bad: false,
            unknown: Vec::new(),
        })
    }

    fn on_odo(&mut self, at: Instant, odo: &DataOdo, out: &mut Actions) {
        let at = moment(out.epoch(), odo.timestamp, at);
        let rates = self.ways.on_odo(at, odo);
        self.judge_source(at, out);
        if self.source == Source::Wheels {
            let taken = self.filter.odometry(at, rates);
            self.judge(taken, "odometry", out);
        }
    }

    fn on_motion(&mut self, at: Instant, motion: &DataMotion, out: &mut Actions) {
        let at = moment(out.epoch(), motion.timestamp, at);
        self.ways.on_motion(at, motion);
        self.judge_source(at, out);
        let (source, rates) = self.ways.source(at);
        let noise = match source {
            Source::Drives => BY_DRIVES,
            Source::DrivesAgainstWheels => IN_CONFLICT,
            Source::Wheels | Source::Nobody => return,
        };
        if self.ways.has_begun() && at > self.filter.at() {
            let taken = self.filter.way(at, rates, noise);
            self.judge(taken, "drives", out);
        }
    }

    fn on_beacons(&mut self, at: Instant, beacons: &DataBeacons, out: &mut Actions) {
        // The ages are by one clock, whatever that is; only the newest moment is taken from ours.
        let said = moment(out.epoch(), beacons.timestamp, at);
        for beacon in &beacons.beacons {
            let age_us = beacons.timestamp.saturating_sub(beacon.timestamp);
            let stamp = match u64::try_from(age_us) {
                Ok(age_us) => said - Duration::from_micros(age_us),
                Err(_) => said + Duration::from_micros(age_us.unsigned_abs()),
            };
            let taken = self.filter.bearing(stamp, beacon.id, beacon.bearing);
            if taken == Err(Refused::Unknown) && !self.unknown.contains(&beacon.id) && self.unknown.len() < 256 {
                self.unknown.push(beacon.id);
                let why = "sighted, and not on the map";
                out.report(Severity::Warning, Fault::BeaconUnknown, format!("beacon {}", beacon.id), why);
            }
            self.judge(taken, "bearing", out);
        }
    }

    fn on_command(&mut self, command: &CmdEstimate, out: &mut Actions) {
        let pose = Pose::new(command.x, command.y, command.theta);
        match self.filter.set(pose, command.covariance) {
            Ok(()) => out.note(format!("told to be at {:.2} {:.2} {:.3}", command.x, command.y, command.theta)),
            Err(_) => {
                let why = "a pose by hand was refused: numbers that are none, or no covariance";
                out.report(Severity::Warning, Fault::MeasurementBad, "pose", why);
            }
        }
    }

    fn judge(&mut self, taken: Result<(), Refused>, what: &str, out: &mut Actions) {
        if taken == Err(Refused::Value) && !self.bad {
            self.bad = true;
            out.report(Severity::Warning, Fault::MeasurementBad, what, "a number that is none, or beyond any robot's");
        }
    }

    /// What ways are by; a change is told.
    fn judge_source(&mut self, now: Instant, out: &mut Actions) {
        let (source, _) = self.ways.source(now);
        let before = std::mem::replace(&mut self.source, source);
        if before == source || !self.ways.has_begun() {
            return;
        }
        let silent = matches!(source, Source::Drives | Source::Nobody);
        if silent && !self.silent {
            let why = "silent: the estimate goes on by what the drives say, if they do";
            out.raise(Severity::Error, Fault::OdometrySilent, "odometry", why);
        } else if !silent && self.silent {
            out.clear(Fault::OdometrySilent, "odometry", "is heard again");
        }
        self.silent = silent;
        if source == Source::DrivesAgainstWheels {
            let why = "says otherwise than the drives for a second: the estimate goes by the drives";
            out.raise(Severity::Error, Fault::OdometryStuck, "odometry", why);
        } else if source == Source::Wheels {
            out.clear(Fault::OdometryStuck, "odometry", "agrees with the drives again");
        }
    }

    fn on_tick(&mut self, now: Instant, out: &mut Actions) {
        self.judge_source(now, out);
        if self.source == Source::Nobody && self.ways.has_begun() {
            self.filter.blind(now);
        }
        let mut estimate = self.filter.estimate(now);
        // A pose that was given up for another at once is told to be lost once: nobody drives on from there by itself.
        let doubted = self.filter.counts().doubted;
        if std::mem::replace(&mut self.doubted, doubted) < doubted && estimate.quality >= Quality::Coarse {
            estimate.quality = Quality::Searching;
            (0..3).for_each(|place| estimate.covariance[place][place] += [25.0, 25.0, 3.0][place]);
        }
        let most = if self.source == Source::Wheels { Quality::Fine } else { Quality::Coarse };
        let quality = estimate.quality.min(most);
        let Pose { x, y, theta } = estimate.pose;
        let (speed, rotation) = (estimate.motion.translation, estimate.motion.rotation);
        let (timestamp, covariance) = (out.timestamp(now), estimate.covariance);
        let (theta, level) = (theta.radians(), quality as i8);
        out.publish(DataEstimate { timestamp, x, y, theta, speed, rotation, covariance, quality: level });
        self.tell(quality, out);
        if self.ticks.is_multiple_of(ACTIVE_EVERY) {
            self.choose(now, (quality >= Quality::Coarse).then_some(estimate.pose), out);
        }
        self.ticks = self.ticks.wrapping_add(1);
    }

    /// That a pose that was known is lost, and that it is known again.
    fn tell(&mut self, quality: Quality, out: &mut Actions) {
        let knows = quality >= Quality::Coarse;
        if self.known && !knows && !self.lost {
            let why = "not known any more: bearings speak against it, or it was too long without";
            out.raise(Severity::Warning, Fault::PoseLost, "pose", why);
            self.lost = true;
        } else if knows && self.lost {
            out.clear(Fault::PoseLost, "pose", "is known again");
            self.lost = false;
        }
        self.known |= knows;
    }

    fn choose(&mut self, now: Instant, pose: Option<Pose>, out: &mut Actions) {
        let (beacons, turn) = (&self.config.filter.beacons, (self.ticks / ACTIVE_EVERY) as usize);
        if beacons.is_empty() {
            return;
        }
        let Config { active_max, filter: filter::Config { range, .. }, .. } = self.config;
        self.active = active::choose(beacons, active_max, range, pose, &self.active, turn);
        out.publish(DataActiveBeacons { timestamp: out.timestamp(now), ids: self.active.clone() });
    }
}

/// The moment of a stamp, by our clock; where its maker's clock is another one, the moment it came.
fn moment(epoch: Epoch, timestamp: i64, came: Instant) -> Instant {
    let stamp = timestamp.checked_sub(epoch.offset_us).and_then(|us| u64::try_from(us).ok());
    let stamp = stamp.map(|us| Instant::from_nanos(us.saturating_mul(1000)));
    stamp.filter(|stamp| came.since(*stamp) <= AGREES && stamp.since(came) <= AGREES).unwrap_or(came)
}

impl Module for Estimator {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::LlDataOdo, Channel::LlDataBeacons, Channel::LlDataMotion, Channel::MlCmdEstimate]
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.tick = Some(Ticker::new(now, PERIOD));
                out.working();
            }
            Event::Message { at, message } => match message {
                Message::LlDataOdo(odo) => self.on_odo(at, odo, out),
                Message::LlDataBeacons(beacons) => self.on_beacons(at, beacons, out),
                Message::LlDataMotion(motion) => self.on_motion(at, motion, out),
                Message::MlCmdEstimate(command) => self.on_command(command, out),
                _ => {}
            },
            Event::State(State::Stop | State::Terminate) => self.tick = None,
            Event::State(_) => {
                self.tick.get_or_insert(Ticker::new(now, PERIOD));
            }
            Event::Timer | Event::Port { .. } | Event::Heard { .. } | Event::Process(_) => {}
        }
        if self.tick.as_mut().is_some_and(|tick| tick.due(now)) {
            self.on_tick(now, out);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.tick.map(|tick| tick.next())
    }
}

#[cfg(test)]
mod tests;
