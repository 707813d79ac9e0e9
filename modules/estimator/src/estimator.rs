//! The module: messages in, `ML_DATA_ESTIMATE` out.
//!
//! Takes    `LL_DATA_ODO` (20 Hz), `LL_DATA_BEACONS` (each bearing at its own instant), `LL_DATA_MOTION` (motion of the
//!          drives, while the odometry is silent or stuck), `ML_CMD_ESTIMATE` (a pose set by hand); of a base that does
//!          not steer `LL_DATA_VELOCITY` in place of odometry and drives; `LL_DATA_IMU`, where a unit is configured;
//!          `ML_CMD_BEACON_USE` (a person excludes a beacon, or permits it again)
//! Rotation by that unit while it is OK, else by the wheels; where they disagree the wheels slip, and their way counts
//!          for less
//! Gives    `ML_DATA_ESTIMATE` at 20 Hz, predicted to the present; `LL_DATA_ACTIVE_BEACONS` every five seconds;
//!          `ML_DATA_BEACON_USE`, what became of the bearings of each beacon, every second
//! Silence  without odometry the drives count, without them nothing does: at most COARSE then
//! States   in PAUSE and STOP it goes on estimating; in STOP it publishes nothing

use crate::active;
use crate::filter::{self, Filter, Noise, Quality, Refused};
use crate::gyro::{Gyro, Turn};
use crate::motion_source::{MotionSources, Source};
use base::{Duration, Epoch, Fault, Instant, Severity, Ticker};
use messages::lowlevel::{DataActiveBeacons, DataBeacons, DataImu, DataMotion, DataOdo, DataVelocity};
use messages::middlelevel::{BeaconUse, CmdBeaconUse, CmdEstimate, DataBeaconUse, DataEstimate};
use messages::{Channel, Message};
use module::{Actions, Event, Module, State};
use navitools::odometry::SteeredWheels;
use navitools::{Motion, Pose};

/// The module's name.
pub const NAME: &str = "estimator";
const PERIOD: Duration = Duration::from_millis(50);
/// Periods between two publications of the active beacons.
const ACTIVE_BEACONS_PERIODS: u32 = 100;
/// Periods between two publications of the use of beacons.
const BEACON_USE_PERIODS: u32 = 20;
/// Greatest difference between a time stamp and the time of reception; beyond it the sender's clock is another one.
const CLOCK_DIFFERENCE_MAX: Duration = Duration::from_millis(150);
/// Noise of the drives' motion: wheels slip and the steering has play.
const DRIVES_NOISE: Noise = Noise { along_per_m: 0.05, along_per_s: 0.03, turn_per_m: 0.05, turn_per_s: 0.02 };
/// Noise while odometry and drives contradict each other: bearings decide.
const CONFLICT_NOISE: Noise = Noise { along_per_m: 0.3, along_per_s: 0.2, turn_per_m: 0.2, turn_per_s: 0.1 };

/// Deviation of the heading by an inertial measurement unit, rad/√s: its noise, and what its zero is off.
const GYRO_TURN_PER_S: f64 = 0.003;
/// Deviation of the way while wheels slip, m/√m and m/√s.
const SLIP_ALONG: (f64, f64) = (CONFLICT_NOISE.along_per_m, CONFLICT_NOISE.along_per_s);

/// Configuration of the module.
#[derive(Clone, Debug)]
pub struct Config {
    /// Configuration of the filter, with the map of beacons.
    pub filter: filter::Config,
    /// The wheels by which it measures its way.
    pub wheels: Wheels,
    /// Maximum number of beacons that the scanner takes at once.
    pub active_max: usize,
    /// Name of the inertial measurement unit by which it measures its rotation, if the robot has one.
    pub imu: Option<String>,
}

impl Config {
    fn subscriptions(&self) -> Vec<Channel> {
        let all: &[Channel] = match self.wheels {
            Wheels::Steered { .. } => &[
                Channel::LlDataOdo,
                Channel::LlDataBeacons,
                Channel::LlDataMotion,
                Channel::MlCmdEstimate,
                Channel::MlCmdBeaconUse,
            ],
            Wheels::Driven { .. } => {
                &[Channel::LlDataVelocity, Channel::LlDataBeacons, Channel::MlCmdEstimate, Channel::MlCmdBeaconUse]
            }
        };
        all.iter().copied().chain(self.imu.iter().map(|_| Channel::LlDataImu)).collect()
    }
}

/// Wheels that measure the robot's way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wheels {
    /// Both steered ones of the front axle, not driven: `LL_DATA_ODO`.
    Steered {
        /// Rear axle to front axle, m.
        wheelbase_m: f64,
        /// Distance of the front wheels, m.
        track_m: f64,
    },
    /// All wheels of a base that does not steer, or the driven front wheel of a tricycle: `LL_DATA_VELOCITY`.
    Driven {
        /// Distance of the wheels from the middle, m: what they roll for each rad of a turn on the spot. Of a tricycle
        /// its wheelbase.
        radius_m: f64,
    },
}

/// The module.
#[derive(Debug)]
pub struct Estimator {
    config: Config,
    filter: Filter,
    sources: MotionSources,
    gyro: Option<Gyro>,
    /// The disagreement of wheels and unit has been reported.
    slips: bool,
    subscriptions: Vec<Channel>,
    tick: Option<Ticker>,
    ticks: u32,
    active: Vec<i32>,
    /// Beacons of the map that a person excluded.
    excluded: Vec<i32>,
    /// The excluded ones have changed: the active ones are to be chosen anew.
    to_choose: bool,
    source: Source,
    silent: bool,
    /// True if a pose was ever known, and if its loss has been reported.
    known: bool,
    lost: bool,
    /// Number of doubts reported.
    doubted: u64,
    bad: bool,
    unknown: Vec<i32>,
}

impl Estimator {
    /// Makes the module.
    ///
    /// # Errors
    /// The configuration is inconsistent.
    pub fn new(config: Config) -> Result<Self, filter::ConfigError> {
        let (wheels, spin, sources) = match config.wheels {
            Wheels::Steered { wheelbase_m, track_m } => {
                let wheels = SteeredWheels::new(wheelbase_m, track_m);
                (Some(wheels), 0.0, MotionSources::new(wheelbase_m, track_m))
            }
            Wheels::Driven { radius_m } => (None, radius_m, MotionSources::new(radius_m, radius_m)),
        };
        Ok(Self {
            gyro: config.imu.clone().map(Gyro::new),
            slips: false,
            subscriptions: config.subscriptions(),
            filter: Filter::new(filter::Config { wheels, spin, ..config.filter.clone() })?,
            sources,
            config,
            tick: None,
            ticks: 0,
            active: Vec::new(),
            excluded: Vec::new(),
            to_choose: false,
            source: Source::None,
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
        let rates = self.sources.on_odo(at, odo);
        self.judge_source(at, out);
        if self.source == Source::Wheels {
            let stands = rates == Motion::default();
            let taken = match self.turn(at, rates.rotation, stands, out) {
                Some(turn) => self.filter.turned(at, rates.translation, 0.0, turn.radps, self.noise(turn)),
                None => self.filter.odometry(at, rates),
            };
            self.judge(taken, "odometry", out);
        }
    }

    fn on_imu(&mut self, at: Instant, imu: &DataImu, out: &mut Actions) {
        let at = moment(out.epoch(), imu.timestamp, at);
        if let Some(gyro) = &mut self.gyro {
            gyro.on_imu(at, imu);
            self.report_slip(out);
        }
    }

    /// Rotation of the step up to `at` by the inertial measurement unit, if that is to count.
    fn turn(&mut self, at: Instant, by_wheels: f64, wheels_stand: bool, out: &mut Actions) -> Option<Turn> {
        let turn = self.gyro.as_mut()?.turn(self.filter.at(), at, by_wheels, wheels_stand);
        self.report_slip(out);
        turn
    }

    fn noise(&self, turn: Turn) -> Noise {
        let Noise { along_per_m, along_per_s, .. } = self.config.filter.odometry;
        let (along_per_m, along_per_s) = if turn.slips { SLIP_ALONG } else { (along_per_m, along_per_s) };
        Noise { along_per_m, along_per_s, turn_per_m: 0.0, turn_per_s: GYRO_TURN_PER_S }
    }

    fn report_slip(&mut self, out: &mut Actions) {
        let slips = self.gyro.as_ref().is_some_and(Gyro::slips);
        if std::mem::replace(&mut self.slips, slips) == slips {
            return;
        }
        if slips {
            let why = "wheels and inertial unit disagree: wheels slip, or one of both errs; the rotation is the unit's";
            out.raise(Severity::Warning, Fault::RotationDisagrees, "rotation", why);
        } else {
            out.clear(Fault::RotationDisagrees, "rotation", "wheels and inertial unit agree, or the unit is not used");
        }
    }

    fn on_velocity(&mut self, at: Instant, velocity: &DataVelocity, out: &mut Actions) {
        let DataVelocity { vx, vy, omega, .. } = *velocity;
        // While one wheel is silent the velocity is unknown.
        if vx.is_nan() || vy.is_nan() || omega.is_nan() {
            return;
        }
        let at = moment(out.epoch(), velocity.timestamp, at);
        self.sources.on_velocity(at);
        self.judge_source(at, out);
        let stands = vx == 0.0 && vy == 0.0 && omega == 0.0;
        let taken = match self.turn(at, omega, stands, out) {
            Some(turn) => self.filter.turned(at, vx, vy, turn.radps, self.noise(turn)),
            None => self.filter.velocity(at, vx, vy, omega),
        };
        self.judge(taken, "velocity", out);
    }

    fn on_motion(&mut self, at: Instant, motion: &DataMotion, out: &mut Actions) {
        let at = moment(out.epoch(), motion.timestamp, at);
        self.sources.on_motion(at, motion);
        self.judge_source(at, out);
        let (source, rates) = self.sources.source(at);
        let noise = match source {
            Source::Drives => DRIVES_NOISE,
            Source::DrivesAgainstWheels => CONFLICT_NOISE,
            Source::Wheels | Source::None => return,
        };
        if self.sources.has_begun() && at > self.filter.at() {
            let taken = self.filter.way(at, rates, noise);
            self.judge(taken, "drives", out);
        }
    }

    fn on_beacons(&mut self, at: Instant, beacons: &DataBeacons, out: &mut Actions) {
        // Ages are differences on the sender's clock; only the newest instant is mapped to ours.
        let said = moment(out.epoch(), beacons.timestamp, at);
        for beacon in &beacons.beacons {
            let age_us = beacons.timestamp.saturating_sub(beacon.timestamp);
            let stamp = match u64::try_from(age_us) {
                Ok(age_us) => said - Duration::from_micros(age_us),
                Err(_) => said + Duration::from_micros(age_us.unsigned_abs()),
            };
            if self.excluded.contains(&beacon.id) {
                continue;
            }
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

    fn on_beacon_use(&mut self, command: &CmdBeaconUse, out: &mut Actions) {
        let CmdBeaconUse { id, permitted, .. } = *command;
        let of_map = self.config.filter.beacons.iter().map(|beacon| beacon.id);
        let meant: Vec<i32> = of_map.filter(|own| id == CmdBeaconUse::ALL || id == *own).collect();
        if meant.is_empty() {
            let why = format!("beacon {id} is not on the map: it is neither excluded nor permitted");
            out.report(Severity::Warning, Fault::CommandForbidden, "beacons", why);
            return;
        }
        let before = self.excluded.len();
        self.excluded.retain(|excluded| !meant.contains(excluded));
        if !permitted {
            self.excluded.extend(meant);
        }
        self.to_choose = true;
        if self.excluded.len() != before {
            let excluded: Vec<String> = self.excluded.iter().map(i32::to_string).collect();
            out.note(match excluded.is_empty() {
                true => "all beacons are permitted".into(),
                false => format!("excluded beacons: {}", excluded.join(", ")),
            });
        }
    }

    fn judge(&mut self, taken: Result<(), Refused>, what: &str, out: &mut Actions) {
        if taken == Err(Refused::Value) && !self.bad {
            self.bad = true;
            out.report(Severity::Warning, Fault::MeasurementBad, what, "a number that is none, or beyond any robot's");
        }
    }

    /// Selects the motion source and reports a change.
    fn judge_source(&mut self, now: Instant, out: &mut Actions) {
        let (source, _) = self.sources.source(now);
        let before = std::mem::replace(&mut self.source, source);
        if before == source || !self.sources.has_begun() {
            return;
        }
        let silent = matches!(source, Source::Drives | Source::None);
        if silent && !self.silent {
            let why = match self.config.wheels {
                Wheels::Steered { .. } => "silent: the estimate goes on by what the drives say, if they do",
                Wheels::Driven { .. } => "silent: the estimate does not know how the robot moves",
            };
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
        if self.source == Source::None && self.sources.has_begun() {
            self.filter.blind(now);
        }
        let mut estimate = self.filter.estimate(now);
        // A pose replaced at once by another is reported lost once, so that nothing drives on from there by itself.
        let doubted = self.filter.counts().doubted;
        if std::mem::replace(&mut self.doubted, doubted) < doubted && estimate.quality >= Quality::Coarse {
            estimate.quality = Quality::Searching;
            (0..3).for_each(|place| estimate.covariance[place][place] += [25.0, 25.0, 3.0][place]);
        }
        let most = if self.source == Source::Wheels { Quality::Fine } else { Quality::Coarse };
        let quality = estimate.quality.min(most);
        let Pose { x, y, theta } = estimate.pose;
        let speed = estimate.motion.translation * libm::cos(estimate.drift);
        let rotation = estimate.motion.rotation;
        let (timestamp, covariance) = (out.timestamp(now), estimate.covariance);
        let (theta, level) = (theta.radians(), quality as i8);
        out.publish(DataEstimate { timestamp, x, y, theta, speed, rotation, covariance, quality: level });
        self.tell(quality, out);
        let anew = std::mem::take(&mut self.to_choose);
        if anew || self.ticks.is_multiple_of(ACTIVE_BEACONS_PERIODS) {
            self.choose(now, (quality >= Quality::Coarse).then_some(estimate.pose), out);
        }
        if anew || self.ticks.is_multiple_of(BEACON_USE_PERIODS) {
            self.publish_beacon_use(now, out);
        }
        self.ticks = self.ticks.wrapping_add(1);
    }

    /// Reports the loss of a known pose, and its recovery.
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
        let (beacons, turn) = (&self.config.filter.beacons, (self.ticks / ACTIVE_BEACONS_PERIODS) as usize);
        if beacons.is_empty() {
            return;
        }
        let Config { active_max, filter: filter::Config { range, .. }, .. } = self.config;
        let mut permitted = beacons.clone();
        permitted.retain(|beacon| !self.excluded.contains(&beacon.id));
        self.active = active::choose(&permitted, active_max, range, pose, &self.active, turn);
        out.publish(DataActiveBeacons { timestamp: out.timestamp(now), ids: self.active.clone() });
    }

    fn publish_beacon_use(&self, now: Instant, out: &mut Actions) {
        let beacons = &self.config.filter.beacons;
        if beacons.is_empty() {
            return;
        }
        let count = |count: u64| i32::try_from(count).unwrap_or(i32::MAX);
        let of = |(beacon, seen): (&filter::Beacon, &filter::BeaconUse)| BeaconUse {
            id: beacon.id,
            x: beacon.at.x,
            y: beacon.at.y,
            active: self.active.contains(&beacon.id),
            permitted: !self.excluded.contains(&beacon.id),
            last: seen.last.map_or(0, |last| out.timestamp(last.stamp)),
            residual: seen.last.map_or(f64::NAN, |last| last.residual),
            deviation: seen.last.map_or(f64::NAN, |last| last.deviation),
            fits: seen.last.is_some_and(|last| last.fits),
            accepted: count(seen.accepted),
            refused: count(seen.refused),
        };
        let beacons = beacons.iter().zip(self.filter.uses()).map(of).collect();
        out.publish(DataBeaconUse { timestamp: out.timestamp(now), beacons });
    }
}

/// Instant of a time stamp on our clock; the time of reception if the sender's clock is another one.
fn moment(epoch: Epoch, timestamp: i64, came: Instant) -> Instant {
    let stamp = timestamp.checked_sub(epoch.offset_us).and_then(|us| u64::try_from(us).ok());
    let stamp = stamp.map(|us| Instant::from_nanos(us.saturating_mul(1000)));
    stamp
        .filter(|stamp| came.since(*stamp) <= CLOCK_DIFFERENCE_MAX && stamp.since(came) <= CLOCK_DIFFERENCE_MAX)
        .unwrap_or(came)
}

impl Module for Estimator {
    fn subscriptions(&self) -> &[Channel] {
        &self.subscriptions
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.tick = Some(Ticker::new(now, PERIOD));
                out.working();
            }
            Event::Message { at, message, .. } => match message {
                Message::LlDataOdo(odo) => self.on_odo(at, odo, out),
                Message::LlDataBeacons(beacons) => self.on_beacons(at, beacons, out),
                Message::LlDataMotion(motion) => self.on_motion(at, motion, out),
                Message::LlDataVelocity(velocity) => self.on_velocity(at, velocity, out),
                Message::LlDataImu(imu) => self.on_imu(at, imu, out),
                Message::MlCmdEstimate(command) => self.on_command(command, out),
                Message::MlCmdBeaconUse(command) => self.on_beacon_use(command, out),
                _ => {}
            },
            Event::State(State::Stop | State::Terminate) => self.tick = None,
            Event::State(_) => {
                self.tick.get_or_insert(Ticker::new(now, PERIOD));
            }
            Event::Timer | Event::Port { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
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
