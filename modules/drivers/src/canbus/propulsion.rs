//! Drive of a wheel, or of the rear axle: converts m/s to the drive's unit.

use super::cia402::Wanted;
use super::drive::{Drive, Trouble};
use super::second_way::WheelWatch;
use super::{Axis, Config, ConfigError, PropulsionConfig, PropulsionDrive, STANDSTILL_MPS};
use base::can::Frame;
use base::{Instant, earliest};
use canopen::axis::modes::Mode;
use canopen::axis::{Follow, FollowConfig, Goal, NotFollowing, PowerState, Units};
use canopen::drives::cia402::{Parameters, Table};
use canopen::drives::derive::{self, Derived};
use canopen::drives::epos;
use canopen::{Master, NodeConfig};
use messages::lowlevel;
use module::Actions;
use settings::robot::Limits;

/// Targets below this are not compared with the measured speed, m/s: four units of its resolution.
const FOLLOWED_MIN_MPS: f64 = 0.05;

pub(super) struct Propulsion {
    pub(super) axis: Axis,
    pub(super) drive: Drive,
    table: Table,
    parameters: Parameters,
    units: Units,
    /// Target velocity in the drive's unit.
    target: i32,
    goal: Goal,
    /// Measured speed, m/s; NaN if unknown.
    speed: f64,
    /// Measured since the last call of [`Self::take_measured`].
    measured: bool,
    follow: Follow,
    pub(super) watch: WheelWatch,
}

impl Propulsion {
    pub(super) fn new(own: &PropulsionConfig, config: &Config) -> Result<Self, ConfigError> {
        let limits = &config.limits;
        let (table, parameters, units, reservations) = match &own.drive {
            PropulsionDrive::Epos { rpm_per_mps } => {
                let (parameters, units) = epos(own.node, *rpm_per_mps, limits);
                (epos::TABLE.clone(), parameters, units, Vec::new())
            }
            PropulsionDrive::Cia402 { drive, circumference } => {
                let wanted = Wanted {
                    axis: own.axis,
                    node: own.node,
                    mode: Mode::ProfileVelocity,
                    per_turn: *circumference,
                    limits: derive::Limits {
                        velocity: limits.speed_mps,
                        acceleration: limits.acceleration_mps2,
                        deceleration: limits.deceleration_mps2,
                        quick_stop: limits.quick_stop_mps2,
                    },
                    range: None,
                };
                let Derived { table, parameters, units, reservations, .. } = drive.derive(&wanted, config)?;
                (table, parameters, units, reservations)
            }
        };
        Ok(Self {
            axis: own.axis,
            drive: Drive::new(own.axis.name(), own.node, table.axis_config(), reservations),
            table,
            parameters,
            units,
            target: 0,
            goal: Goal::QuickStop,
            speed: f64::NAN,
            measured: false,
            follow: Follow::new(FollowConfig {
                ramp: limits.acceleration_mps2.min(limits.deceleration_mps2),
                least: FOLLOWED_MIN_MPS,
            }),
            watch: WheelWatch::new(limits.deceleration_mps2, limits.quick_stop_mps2),
        })
    }

    pub(super) fn node_config(&self) -> NodeConfig {
        self.table.node_config(self.drive.name, &self.parameters)
    }

    pub(super) fn on_pdo(&mut self, now: Instant, number: u8, data: &[u8], out: &mut Actions) {
        let Some(status) = self.table.unpack(number, data) else {
            return;
        };
        if let Some(velocity) = status.value {
            self.on_velocity(now, velocity);
        }
        if let Some(statusword) = status.statusword {
            self.drive.on_statusword(now, statusword, out);
        }
    }

    pub(super) fn on_velocity(&mut self, now: Instant, velocity: i32) {
        self.speed = self.units.velocity_si(velocity);
        self.measured = true;
        self.drive.on_measured(now);
    }

    /// The speed is unknown until the next measured value.
    pub(super) fn on_lost(&mut self) {
        self.speed = f64::NAN;
    }

    /// Speed, m/s, if it was measured since the last call.
    pub(super) fn take_measured(&mut self) -> Option<f64> {
        std::mem::take(&mut self.measured).then_some(self.speed)
    }

    /// Compares a measured speed with the one that the enabled drive is commanded, absent if none: a drive that stands
    /// although it is to move is stopped, in whatever state and mode it says that it is.
    pub(super) fn compare(&mut self, now: Instant, target: Option<f64>, measured: Option<f64>, out: &mut Actions) {
        self.follow.command(now, target);
        if let Some(lag) = measured.and_then(|speed| self.follow.measure(now, speed)) {
            self.stop_for(now, lag, out);
        }
    }

    /// The robot stops, because this wheel does not turn as commanded.
    pub(super) fn stop_for(&mut self, now: Instant, lag: NotFollowing, out: &mut Actions) {
        let why = Trouble::NotFollowing(lag, "m/s");
        self.drive.alarm(format!("{} drive {why}: the robot stops", self.drive.name), out);
        self.drive.block_until_stopped(now, why);
    }

    /// Commanded speed, m/s.
    pub(super) fn target(&self) -> f64 {
        self.units.velocity_si(self.target)
    }

    /// True if its speed is known to be below `limit`, m/s.
    pub(super) fn is_slower(&self, now: Instant, limit: f64) -> bool {
        self.drive.is_known(now) && self.speed.abs() < limit
    }

    /// True if the power stage was on by the last statusword, and the drive is not known to be at standstill.
    pub(super) fn may_turn(&self) -> bool {
        self.drive.is_powered() && (self.speed.is_nan() || self.speed.abs() >= STANDSTILL_MPS)
    }

    /// Drives at `speed`, m/s.
    pub(super) fn drive(&mut self, speed: f64) {
        self.goal = Goal::Enabled;
        self.target = self.units.velocity(speed);
    }

    /// Stops by the quick stop ramp and stays stopped.
    pub(super) fn quick_stop(&mut self) {
        self.goal = Goal::QuickStop;
        self.target = 0;
    }

    /// Takes the torque away; the drive must stand.
    pub(super) fn switch_off(&mut self) {
        self.goal = Goal::Disabled;
        self.target = 0;
    }

    pub(super) fn advance(&mut self, now: Instant, master: &mut Master, out: &mut Actions) {
        if !self.drive.is_booted() && !self.drive.is_fresh(now) {
            self.on_lost();
        }
        self.drive.set_goal(now, self.goal);
        self.drive.handle_timeout(now, out);
        self.drive.expect_mode(now, Some(self.table.mode.code()), master);
        let data = self.table.pack(self.drive.axis.controlword(), self.target);
        self.drive.send(now, master, self.table.rpdo.number, data);
    }

    /// [`Drive::blind_stop`] by the quick stop ramp.
    pub(super) fn blind_stop(&mut self, now: Instant, bus_is_up: bool) -> Option<Frame> {
        let data = self.table.pack(self.table.quick_stop, 0);
        self.drive.blind_stop(now, bus_is_up, self.table.rpdo.number, &data)
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        earliest([self.drive.poll_timeout(), self.watch.unwatched])
    }

    /// Measured speed, m/s; NaN if unknown.
    pub(super) fn measured(&self) -> f64 {
        self.speed
    }

    /// Measured speed, m/s; 0 if unknown.
    pub(super) fn speed(&self) -> f64 {
        if self.speed.is_nan() { 0.0 } else { self.speed }
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.drive.axis.is_enabled()
    }

    pub(super) fn is_quick_stopped(&self) -> bool {
        self.drive.axis.goal() == Goal::QuickStop
            && matches!(self.drive.axis.state(), Some(PowerState::OperationEnabled | PowerState::QuickStopActive))
    }

    /// True if a quick stop is in progress, or may be: that of a drive whose state is not known yet was commanded by an
    /// earlier process, or before it was lost.
    pub(super) fn may_be_stopping(&self) -> bool {
        let is_known = self.drive.is_booted() && self.drive.axis.state().is_some();
        !is_known || self.is_quick_stopped()
    }

    pub(super) fn row(&self, master: &Master) -> lowlevel::Axis {
        self.drive.row(master, f64::NAN, self.speed)
    }
}

/// Values and units of an EPOS. Its speeds are rpm and rpm/s; its position is not used.
fn epos(node: u8, rpm_per_mps: f64, limits: &Limits) -> (Parameters, Units) {
    let units = Units::new(rpm_per_mps, rpm_per_mps, rpm_per_mps);
    let parameters = Parameters {
        // A margin above the limit of commands, for the drive's own controller.
        velocity: units.speed(limits.speed_mps * 1.1).min(epos::VELOCITY_MAX_RPM),
        acceleration: units.acceleration(limits.acceleration_mps2),
        deceleration: units.acceleration(limits.deceleration_mps2),
        quick_stop_deceleration: units.acceleration(limits.quick_stop_mps2),
        ..epos::parameters(node)
    };
    (parameters, units)
}
