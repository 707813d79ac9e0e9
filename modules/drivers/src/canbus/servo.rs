//! A CANopen drive that turns a wheel: converts m/s to the drive's unit.

use super::cia402::Wanted;
use super::drive::Drive;
use super::ramp::Ramp;
use super::{Config, ConfigError, PropulsionConfig, PropulsionDrive, STANDSTILL_MPS};
use base::can::Frame;
use base::{Duration, Instant, earliest};
use canopen::axis::modes::Mode;
use canopen::axis::{Goal, PowerState, Units, control};
use canopen::drives::cia402::{Parameters, Status, Table};
use canopen::drives::derive::{self, Derived, Reason, Refusal};
use canopen::{Master, NodeConfig};
use module::Actions;
use settings::robot::Limits;
use std::f64::consts::TAU;

/// Age beyond which a torque is unknown: two in a row are lost.
const TORQUE_AGE_MAX: Duration = Duration::from_millis(70);

/// What a motor does at the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Force {
    /// By its torque, without friction in the gear, N, forward positive.
    pub newtons: f64,
    /// At the rated torque, N, above 0.
    pub rated: f64,
    /// When it was received.
    pub at: Instant,
}

pub(super) struct Servo {
    pub(super) drive: Drive,
    table: Table,
    parameters: Parameters,
    units: Units,
    /// Turns of the motor per m; 0 of a drive that reports no torque.
    turns: f64,
    /// Target velocity in the drive's unit.
    target: i32,
    /// The way to the target, of a drive that has no ramp in its mode.
    ramp: Option<Ramp>,
    /// Greatest speed of a set-point, m/s.
    speed_max: f64,
    /// It was not to be enabled at the last call of [`Self::setpoint`].
    stopped: bool,
    /// Torque, per mille of the rated one, and when it was received.
    torque: Option<(i16, Instant)>,
}

impl Servo {
    /// `None`: the drive is no CANopen node.
    pub(super) fn new(own: &PropulsionConfig, config: &Config) -> Result<Option<Self>, ConfigError> {
        let limits = &config.limits;
        let mut brake = None;
        let (table, parameters, units, turns, reservations) = match &own.drive {
            PropulsionDrive::Table { table, units_per_mps } => {
                let (parameters, units) = by_table(own.node, *units_per_mps, table.velocity_max, limits);
                // A target has 32 bits and a sign.
                let high = table.velocity_max.unwrap_or(u32::MAX).min(i32::MAX.unsigned_abs());
                let velocity = units.speed(limits.speed_mps);
                if velocity > high {
                    let reason = Reason::OutOfLimits { value: velocity.into(), low: 1, high: high.into() };
                    let refusal = Refusal { index: 0x607F, sub: 0, reason };
                    return Err(ConfigError::Drive { axis: own.axis, refusal });
                }
                table.check(&parameters).map_err(|refusal| ConfigError::Drive { axis: own.axis, refusal })?;
                (table.table.clone(), parameters, units, units_per_mps / table.units_per_turn, Vec::new())
            }
            PropulsionDrive::Cia402 { drive, circumference } => {
                brake = drive.brake(own.axis, own.node)?;
                let wanted = Wanted {
                    axis: own.axis,
                    node: own.node,
                    mode: drive.mode(own.axis, own.node),
                    per_turn: *circumference,
                    limits: derive::Limits {
                        velocity: limits.speed_mps,
                        acceleration: limits.acceleration_mps2,
                        deceleration: limits.deceleration_mps2,
                        quick_stop: limits.quick_stop_mps2,
                    },
                    range: None,
                    torque: is_redundant(config),
                };
                let Derived { table, parameters, units, turns, reservations, .. } = drive.derive(&wanted, config)?;
                (table, parameters, units, turns, reservations)
            }
            PropulsionDrive::Controller(_) | PropulsionDrive::OnLine { .. } => return Ok(None),
        };
        let drive = Drive::new(own.axis.name(), own.node, &table, reservations).with_brake(brake);
        let cyclic = table.mode == Mode::CyclicVelocity;
        let ramp = cyclic
            .then(|| Ramp::new(config.sync_and_master(own.axis).0, limits.acceleration_mps2, limits.deceleration_mps2));
        Ok(Some(Self {
            drive,
            table,
            parameters,
            units,
            turns,
            target: 0,
            ramp,
            speed_max: limits.speed_mps,
            stopped: true,
            torque: None,
        }))
    }

    pub(super) fn node_config(&self) -> NodeConfig {
        self.table.node_config(self.drive.name, &self.parameters)
    }

    /// A PDO was received; its speed, m/s, if it has one, and its statusword.
    pub(super) fn take_pdo(&mut self, now: Instant, number: u8, data: &[u8]) -> Option<(Option<f64>, Option<u16>)> {
        let Status { statusword, value, torque } = self.table.unpack(number, data)?;
        if let Some(torque) = torque {
            self.torque = Some((torque, now));
            self.drive.on_torque(now, torque);
        }
        Some((value.map(|velocity| self.velocity_si(velocity)), statusword))
    }

    /// True if the drive sends its torque by itself.
    pub(super) fn reports_torque(&self) -> bool {
        self.table.reports_torque()
    }

    /// The motor's force at the floor; `None`: its torque was not received recently, or its rated torque is not known.
    pub(super) fn force(&self, now: Instant) -> Option<Force> {
        let (per_mille, at) = self.torque?;
        let rated = TAU * self.turns * self.drive.rated_torque()?;
        let known = self.drive.is_booted() && now.since(at) <= TORQUE_AGE_MAX && rated != 0.0;
        known.then(|| Force { newtons: f64::from(per_mille) / 1000.0 * rated, rated: rated.abs(), at })
    }

    /// m/s of a velocity in the drive's unit.
    pub(super) fn velocity_si(&self, velocity: i32) -> f64 {
        self.units.velocity_si(velocity)
    }

    /// Commanded speed, m/s.
    pub(super) fn target(&self) -> f64 {
        self.velocity_si(self.target)
    }

    pub(super) fn set_target(&mut self, speed: f64) {
        self.target = self.units.velocity(speed);
    }

    /// `cut`: the power stage is switched off at once, from any state and without a ramp, by which the drive would go
    /// on. `speed`: measured, m/s, NaN if unknown.
    pub(super) fn advance(
        &mut self,
        now: Instant,
        (goal, cut): (Goal, bool),
        speed: f64,
        master: &mut Master,
        out: &mut Actions,
    ) {
        let stands = speed.abs() < STANDSTILL_MPS && self.drive.is_known(now);
        self.drive.advance_brake(now, goal, stands, master, out);
        let goal = if cut { goal } else { self.drive.held_until_braked(goal) };
        self.drive.set_goal(now, goal);
        self.drive.handle_timeout(now, out);
        self.drive.expect_mode(now, Some(self.table.mode.code()), master);
        let controlword = if cut { control::DISABLE_VOLTAGE } else { self.drive.axis.controlword() };
        let setpoint = self.setpoint(now, goal, speed, master);
        let data = self.table.pack(controlword, setpoint);
        self.drive.send(now, master, self.table.rpdo.number, data);
    }

    /// The set-point that is sent, in the drive's unit: the target, or where its drive has no ramp the next one on the
    /// way there. A drive that is enabled while its wheel rolls is not braked at once by a set-point of 0; whatever was
    /// measured, it does not begin beyond the limit.
    fn setpoint(&mut self, now: Instant, goal: Goal, speed: f64, master: &Master) -> i32 {
        let Some(ramp) = &mut self.ramp else { return self.target };
        let enabled = self.drive.is_booted() && self.drive.axis.state() == Some(PowerState::OperationEnabled);
        let was_stopped = std::mem::replace(&mut self.stopped, goal != Goal::Enabled);
        match goal {
            Goal::Enabled => {
                // A drive that was just commanded to stop may not show it yet, and its wheel still has its speed.
                if was_stopped || !enabled {
                    let rolls = speed.abs() >= STANDSTILL_MPS;
                    ramp.begin(if rolls { speed.clamp(-self.speed_max, self.speed_max) } else { 0.0 });
                }
                if enabled && ramp.advance(now, self.units.velocity_si(self.target), master.next_sync()) {
                    self.drive.send_again();
                }
            }
            Goal::QuickStop | Goal::Disabled => ramp.begin(0.0),
        }
        self.units.velocity(ramp.setpoint())
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        earliest([self.drive.poll_timeout(), self.ramp.as_ref().and_then(Ramp::poll_timeout)])
    }

    /// [`Drive::blind_stop`] by the quick stop ramp.
    pub(super) fn blind_stop(&mut self, now: Instant, bus_is_up: bool) -> Option<Frame> {
        let data = self.table.pack(self.table.quick_stop, 0);
        self.drive.blind_stop(now, bus_is_up, self.table.rpdo.number, &data)
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
}

/// True if wheels can work against each other.
fn is_redundant(config: &Config) -> bool {
    let chassis = config.base.and_then(|base| base.chassis(&config.limits).ok());
    chassis.is_some_and(|chassis| chassis.redundancy() > 0)
}

/// Values and units of a drive by a table of objects: at 1 m/s its velocity is `units_per_mps`, its ramps are that per
/// second. Its position is not used.
fn by_table(node: u8, units_per_mps: f64, velocity_max: Option<u32>, limits: &Limits) -> (Parameters, Units) {
    let units = Units::new(units_per_mps, units_per_mps, units_per_mps);
    let parameters = Parameters {
        node,
        // A margin above the limit of commands, for the drive's own controller.
        velocity: units.speed(limits.speed_mps * 1.1).min(velocity_max.unwrap_or(u32::MAX)),
        acceleration: units.acceleration(limits.acceleration_mps2),
        deceleration: units.acceleration(limits.deceleration_mps2),
        quick_stop_deceleration: units.acceleration(limits.quick_stop_mps2),
        remap: false,
    };
    (parameters, units)
}
