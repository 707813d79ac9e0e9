//! Drive of the front wheels' steering: converts rad to counts; homed to its switch before any motion.

use super::cia402::{Cia402, VelocityUnit, Wanted};
use super::drive::{Drive, Trouble};
use super::ramp::Glide;
use super::reference::ReferenceCheck;
use super::table::DriveTable;
use super::{Axis, Config, ConfigError, SteeringConfig, SteeringDrive};
use base::can::Frame;
use base::{Duration, Fault, Instant, Severity, earliest};
use canopen::axis::modes::Mode;
use canopen::axis::modes::hm::{Homing, HomingConfig, HomingError};
use canopen::axis::modes::pp::{Setpoint, SetpointEvent};
use canopen::axis::modes::switch::Access;
use canopen::axis::{Goal, Reach, ReachConfig, Units, control};
use canopen::drives::cia402::{Parameters, Table};
use canopen::drives::derive::{self, Reason, Refusal};
use canopen::master::Ticket;
use canopen::pdo::Data;
use canopen::{Event as CanEvent, Master, NodeConfig, Payload, sdo};
use messages::{Hold, lowlevel};
use module::Actions;
use std::f64::consts::TAU;

/// Timeout of a set-point's acknowledgement, after which its edge is repeated.
const ACKNOWLEDGE_TIMEOUT: Duration = Duration::from_millis(100);
/// Number of consecutive unacknowledged edges that is reported.
const SETPOINT_TRIES: u32 = 5;
/// Number of retries of an unanswered homing transfer: a single lost frame need not be reported.
const HOMING_RETRIES: u8 = 2;
/// Maximum deviation from the middle at which the wheels count as straight after homing, rad.
const STRAIGHT_MAX_RAD: f64 = 0.01;
/// Speed of the search for the switch's edge, relative to the speed towards it.
const ZERO_SEARCH_SPEED_RATIO: f64 = 0.2;
/// Deviation from the commanded angle that is not judged, rad: the play, and the lag of the position loop.
const REACHED_RAD: f64 = 0.03;
/// For how long it may stand although it is to steer, where only its own encoder measures the angle. A set-point whose
/// frames are lost twice is repeated meanwhile.
const STANDS_MAX: Duration = Duration::from_millis(350);
/// Durations of the steering's ramps, s: to full speed, and from there to standstill in a quick stop.
const RAMP_S: f64 = 0.1;
const QUICK_STOP_RAMP_S: f64 = 0.05;

/// The drive's own limits of its position, relative to the outermost angle.
const RANGE_MARGIN: f64 = 1.1;

/// Goal of the steering.
#[derive(Clone, Copy, Debug, PartialEq)]
enum SteeringGoal {
    /// Without torque.
    Off,
    Stop,
    Hold,
    Go(f64),
    Home,
}

/// Relation of position to angle.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Reference {
    /// Being read back from a drive that was booted.
    Unchecked,
    None,
    /// Homed; moving to straight ahead.
    Centering,
    Known,
    /// Homing failed; retried on command.
    Failed(HomingError),
}

/// Reason why the steering has no reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NotHomed {
    /// The drive is being asked whether it has a reference.
    Unchecked,
    /// Homing was released, and begins.
    NotYet,
    /// Homing, or its way to straight ahead, waits for a release.
    Unreleased,
    Running,
    /// Homed; moving to straight ahead.
    Centering,
    Failed(HomingError),
}

impl NotHomed {
    /// Cause in `LL_DATA_HOLD`.
    pub(super) fn hold(self) -> Hold {
        match self {
            Self::Unchecked | Self::NotYet => Hold::NotHomed,
            Self::Unreleased => Hold::ToBeHomed,
            Self::Running => Hold::Homing,
            Self::Centering => Hold::Centering,
            Self::Failed(_) => Hold::HomingFailed,
        }
    }
}

pub(super) struct Steering {
    pub(super) drive: Drive,
    config: SteeringConfig,
    table: Table,
    parameters: Parameters,
    units: Units,
    goal: SteeringGoal,
    reference: Reference,
    check: ReferenceCheck,
    /// Homing may move the wheels, up to straight ahead.
    released: bool,
    /// The drive was homed before this process was.
    inherited: bool,
    /// The reference was checked or made once.
    checked: bool,
    homing: Homing,
    /// The drive was to be enabled for homing since it was booted.
    tried: bool,
    /// Current transfer of homing, and its number of unanswered attempts.
    access: Option<(Ticket, Access)>,
    /// Transfer to be repeated.
    again: Option<Access>,
    unanswered: u8,
    setpoint: Setpoint,
    /// The way to the target, of a drive that has no profile in its mode.
    glide: Option<Glide>,
    /// The SYNC that was next when homing was about to change the mode. Set while it does, of such a drive.
    switches: Option<Instant>,
    /// Measured position, counts.
    position: Option<i32>,
    /// Measured since it was compared with the target.
    measured: bool,
    reach: Reach,
}

impl Steering {
    pub(super) fn new(own: &SteeringConfig, config: &Config) -> Result<Self, ConfigError> {
        let Built { table, parameters, units, acceleration, reservations } = match &own.drive {
            SteeringDrive::Table { table, gear, counts_per_turn, remap } => {
                by_table(table, own, *gear, *counts_per_turn, *remap)?
            }
            SteeringDrive::Cia402(drive) => by_sheet(drive, own, config)?,
        };
        let speed = f64::from(units.position(own.speed)).abs();
        let period = config.sync_and_master(Axis::Steering).0;
        let period = period.filter(|_| matches!(table.mode, Mode::CyclicPosition | Mode::Interpolated));
        let glide = period.map(|period| Glide::new(period, speed, speed / RAMP_S));
        let stands_max = (!config.odometry).then_some(STANDS_MAX);
        let bus = config.bus_of(Axis::Steering);
        let place = config.place(bus, own.node);
        let config = own.clone();
        let homing = HomingConfig {
            method: config.homing_method,
            switch_speed: units.speed(config.homing_speed),
            zero_speed: units.speed(config.homing_speed * ZERO_SEARCH_SPEED_RATIO),
            acceleration: acceleration.then(|| units.acceleration(config.homing_speed / RAMP_S)),
            offset: Some(units.position(config.switch)),
            mode_after: table.mode.code(),
            timeout: config.homing_timeout,
        };
        let check = ReferenceCheck::new(homing.method, units.position(config.switch));
        let reach = Reach::new(ReachConfig { speed: config.speed, least: REACHED_RAD, stands_max });
        Ok(Self {
            drive: Drive::new("steering", config.node, &table, reservations).on_bus(bus, place),
            config,
            table,
            parameters,
            units,
            goal: SteeringGoal::Stop,
            reference: Reference::None,
            check,
            released: false,
            inherited: false,
            checked: false,
            homing: Homing::new(homing),
            tried: false,
            access: None,
            again: None,
            unanswered: 0,
            setpoint: Setpoint::new(ACKNOWLEDGE_TIMEOUT),
            glide,
            switches: None,
            position: None,
            measured: false,
            reach,
        })
    }

    pub(super) fn node_config(&self) -> NodeConfig {
        self.table.node_config("steering", &self.parameters)
    }

    pub(super) fn on_booted(&mut self) {
        self.reference = Reference::Unchecked;
        self.check.start();
    }

    pub(super) fn on_lost(&mut self) {
        self.reference = Reference::None;
        self.homing.lost();
        self.tried = false;
        (self.access, self.again, self.unanswered) = (None, None, 0);
        self.position = None;
    }

    pub(super) fn on_pdo(&mut self, now: Instant, number: u8, data: &[u8], out: &mut Actions) {
        let Some(status) = self.table.unpack(number, data) else {
            return;
        };
        if let Some(counts) = status.value {
            self.on_position(now, counts);
        }
        let Some(statusword) = status.statusword else { return };
        self.drive.on_statusword(now, statusword, out);
        if self.homing.is_running() {
            self.homing.handle_statusword(now, statusword);
        } else if self.glide.is_none() {
            self.setpoint.handle_statusword(now, statusword);
        }
    }

    pub(super) fn on_position(&mut self, now: Instant, counts: i32) {
        self.position = Some(counts);
        self.measured = true;
        self.drive.on_measured(now);
    }

    pub(super) fn on_sdo(&mut self, now: Instant, event: &CanEvent) {
        let (ticket, result) = match event {
            CanEvent::SdoRead { ticket, data, .. } => (ticket, Ok(data.clone())),
            CanEvent::SdoWritten { ticket, .. } => (ticket, Ok(Payload::EMPTY)),
            CanEvent::SdoFailed { ticket, error, .. } => (ticket, Err(*error)),
            _ => return,
        };
        if self.check.on_sdo(*ticket, result.as_ref().map(Payload::as_slice).ok()) {
            return;
        }
        let Some((_, access)) = self.access.take_if(|(own, _)| own == ticket) else {
            return;
        };
        if result == Err(sdo::Error::Timeout) && self.unanswered < HOMING_RETRIES {
            self.unanswered += 1;
            self.again = Some(access);
            return;
        }
        self.unanswered = 0;
        self.homing.handle_sdo(now, result);
    }

    /// Steers to `angle`, rad.
    pub(super) fn go(&mut self, angle: f64) {
        self.goal = SteeringGoal::Go(angle);
    }

    /// Keeps the current angle.
    pub(super) fn hold(&mut self) {
        self.goal = SteeringGoal::Hold;
    }

    /// Finds the reference, then steers straight ahead.
    pub(super) fn home(&mut self) {
        self.goal = SteeringGoal::Home;
    }

    /// Discards the reference, as an operator commands; homing starts at once.
    pub(super) fn home_again(&mut self) {
        self.reference = Reference::None;
        self.released = true;
        self.drive.release();
    }

    /// An operator releases homing, if the steering waits for that.
    pub(super) fn release_homing(&mut self) {
        self.released = matches!(self.reference, Reference::None | Reference::Centering);
        if self.released {
            self.drive.release();
        }
    }

    /// A stop: homing needs a new release.
    pub(super) fn revoke_homing(&mut self) {
        self.released = false;
    }

    /// True after a fault of the drive that was enabled for homing.
    pub(super) fn failed_to_home(&self) -> bool {
        self.tried && self.drive.axis.is_locked()
    }

    /// True if the drive had its reference from an earlier process.
    pub(super) fn is_inherited(&self) -> bool {
        self.inherited
    }

    /// True while homing moves the wheels, or is about to.
    pub(super) fn is_homing(&self) -> bool {
        self.homing.is_running() || self.reference == Reference::Centering
    }

    /// Stops at the current angle by the quick stop ramp.
    pub(super) fn quick_stop(&mut self) {
        self.goal = SteeringGoal::Stop;
    }

    /// Takes the torque away.
    pub(super) fn switch_off(&mut self) {
        self.goal = SteeringGoal::Off;
    }

    /// [`Drive::blind_stop`] at the current angle; the drive keeps its reference.
    pub(super) fn blind_stop(&mut self, now: Instant, bus_is_up: bool) -> Option<Frame> {
        let data = self.table.pack(self.table.quick_stop, self.glide.as_ref().map_or(0, Glide::setpoint));
        self.drive.blind_stop(now, bus_is_up, self.table.rpdo.number, &data)
    }

    pub(super) fn advance(&mut self, now: Instant, master: &mut Master, out: &mut Actions) {
        let goal = match self.goal {
            SteeringGoal::Off => Goal::Disabled,
            SteeringGoal::Stop => Goal::QuickStop,
            SteeringGoal::Hold | SteeringGoal::Go(_) | SteeringGoal::Home => Goal::Enabled,
        };
        self.drive.set_goal(now, goal);
        self.tried |= self.goal == SteeringGoal::Home && self.drive.axis.goal() == Goal::Enabled;
        self.drive.handle_timeout(now, out);
        self.check_reference(now, master, out);
        self.advance_homing(now, master, out);
        self.drive.expect_mode(now, self.homing.mode(), master);
        self.advance_setpoint(now, master, out);
        self.watch(now, out);
        let data = self.command();
        self.drive.send(now, master, self.table.rpdo.number, data);
    }

    /// Accepts the reference of a drive that kept it: only this process, or the bus, was gone.
    fn check_reference(&mut self, now: Instant, master: &mut Master, out: &mut Actions) {
        if self.reference != Reference::Unchecked || !self.drive.is_booted() {
            return;
        }
        let read = |index| master.sdo_read(now, self.config.node, index, 0).ok();
        let known = self.position.is_some() && self.drive.axis.state().is_some();
        let Some(same) = self.check.poll(read).filter(|_| known) else { return };
        let homed = self.drive.axis.statusword() & self.table.homed != 0;
        self.reference = if same && homed { Reference::Known } else { Reference::None };
        self.inherited |= homed && !std::mem::replace(&mut self.checked, true);
        if self.reference == Reference::Known {
            self.setpoint.reset(self.position.unwrap_or(0));
            out.clear(Fault::HomingFailed, "steering", "the steering is homed");
            out.note("the steering has kept its reference: the robot may be driven");
        }
    }

    fn advance_homing(&mut self, now: Instant, master: &mut Master, out: &mut Actions) {
        if let Some(result) = self.homing.poll_finished() {
            self.on_homing_finished(result, out);
        }
        match self.goal {
            SteeringGoal::Home
                if self.reference == Reference::None && self.released && self.drive.axis.is_enabled() =>
            {
                self.homing.start();
            }
            SteeringGoal::Home => {}
            _ => self.homing.cancel(),
        }
        self.homing.handle_timeout(now);
        if !self.may_switch(master.next_sync()) {
            return;
        }
        while let Some(access) = self.again.take().or_else(|| self.homing.poll_sdo()) {
            let node = self.config.node;
            let asked = match access.clone() {
                Access::Read { index, sub } => master.sdo_read(now, node, index, sub),
                Access::Write { index, sub, data } => master.sdo_write(now, node, index, sub, data),
            };
            match asked {
                Ok(ticket) => self.access = Some((ticket, access)),
                Err(_) => self.homing.handle_sdo(now, Err(sdo::Error::Cancelled)),
            }
        }
    }

    /// False while a drive that follows set-points at SYNC is to change its mode, and has had no SYNC since. The last
    /// set-point that it took is a position from before homing: in its own mode it would go there.
    fn may_switch(&mut self, sync: Option<Instant>) -> bool {
        match sync.filter(|_| self.glide.is_some() && self.homing.mode().is_none()) {
            Some(next) => *self.switches.get_or_insert(next) != next,
            None => {
                self.switches = None;
                true
            }
        }
    }

    fn on_homing_finished(&mut self, result: Result<(), HomingError>, out: &mut Actions) {
        self.setpoint.reset(self.position.unwrap_or(0));
        self.released &= result.is_ok();
        self.reference = match result {
            Ok(()) => {
                out.clear(Fault::HomingFailed, "steering", "the steering is homed");
                Reference::Centering
            }
            // Cancelled for another cause; starts again with a release after the end of that cause.
            Err(HomingError::Cancelled) => Reference::None,
            Err(error) => {
                let message = format!("homing the steering failed: {error}; `advee home steering` tries again");
                out.raise(Severity::Error, Fault::HomingFailed, "steering", message);
                Reference::Failed(error)
            }
        };
    }

    fn advance_setpoint(&mut self, now: Instant, master: &Master, out: &mut Actions) {
        let ready = self.drive.axis.is_enabled() && !self.homing.is_running();
        if !ready {
            // Until the axis is enabled again the set-point follows the position, so that enabling moves nothing.
            self.setpoint.reset(self.position.unwrap_or(0));
            if let (Some(glide), Some(position)) = (&mut self.glide, self.position) {
                glide.begin(position);
            }
            return;
        }
        let target = match (self.goal, &self.reference) {
            (SteeringGoal::Go(angle), Reference::Known) => Some(self.units.position(angle)),
            (SteeringGoal::Home, Reference::Centering) if self.released => Some(0),
            _ => None,
        };
        if let Some(glide) = &mut self.glide {
            if let Some(target) = target {
                glide.set(target);
            }
            if glide.advance(master.next_sync()) {
                self.drive.send_again();
            }
        } else if let Some(target) = target {
            self.setpoint.set(now, target);
        }
        self.setpoint.handle_timeout(now);
        while let Some(event) = self.setpoint.poll_event() {
            if matches!(event, SetpointEvent::Retried { tries: SETPOINT_TRIES, .. }) {
                let message =
                    format!("steering drive does not take its target after {SETPOINT_TRIES} attempts: the robot stops");
                self.drive.alarm(message, out);
                self.drive.block_until_stopped(now, Trouble::NoTarget);
            }
        }
        if self.reference == Reference::Centering && self.angle().abs() < STRAIGHT_MAX_RAD {
            (self.reference, self.released) = (Reference::Known, false);
            out.note("the steering is homed: the robot may be driven");
        }
    }

    /// Compares a measured angle with the one that the enabled drive is commanded: one that stands although it is to
    /// steer stops the robot.
    fn watch(&mut self, now: Instant, out: &mut Actions) {
        let target = match (self.goal, &self.reference) {
            (SteeringGoal::Go(angle), Reference::Known) if self.drive.axis.is_enabled() => Some(angle),
            _ => None,
        };
        self.reach.command(now, target);
        self.drive.set_changing(now, self.reach.is_under_way());
        let measured = std::mem::take(&mut self.measured).then(|| self.angle());
        let Some(lag) = measured.and_then(|angle| self.reach.measure(now, angle)) else { return };
        let why = Trouble::NotFollowing(lag, "rad");
        self.drive.alarm(format!("steering drive {why}: the robot stops"), out);
        self.drive.block_until_stopped(now, why);
    }

    fn command(&self) -> Data {
        let position = self.position.unwrap_or(0);
        let controlword = self.drive.axis.controlword();
        if !self.drive.axis.is_enabled() {
            self.table.pack(controlword, position)
        } else if self.homing.is_running() {
            self.table.pack(controlword | self.homing.controlword_bits(), position)
        } else if let Some(glide) = &self.glide {
            let bits = if self.table.mode == Mode::Interpolated { control::ENABLE_IP } else { 0 };
            self.table.pack(controlword | bits, glide.setpoint())
        } else {
            let (bits, target) = self.setpoint.command();
            self.table.pack(controlword | bits, target)
        }
    }

    /// Angle, rad, counter-clockwise; NaN if position or reference is unknown.
    pub(super) fn angle(&self) -> f64 {
        match (&self.reference, self.position) {
            (Reference::Known | Reference::Centering, Some(position)) => self.units.position_si(position),
            _ => f64::NAN,
        }
    }

    pub(super) fn is_homed(&self) -> bool {
        self.reference == Reference::Known
    }

    /// Reason why it is not homed; `None` if it is.
    pub(super) fn why_not_homed(&self) -> Option<NotHomed> {
        match self.reference {
            Reference::Known => None,
            Reference::None if self.homing.is_running() => Some(NotHomed::Running),
            Reference::Unchecked => Some(NotHomed::Unchecked),
            Reference::None if self.released => Some(NotHomed::NotYet),
            Reference::Centering if self.released => Some(NotHomed::Centering),
            Reference::None | Reference::Centering => Some(NotHomed::Unreleased),
            Reference::Failed(error) => Some(NotHomed::Failed(error)),
        }
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.drive.axis.is_enabled()
    }

    /// Row in `LL_DATA_WHEELS`.
    pub(super) fn wheel_row(&self) -> lowlevel::Wheel {
        self.drive.wheel_row(self.angle(), f64::NAN)
    }

    pub(super) fn row(&self, master: &Master) -> lowlevel::Axis {
        self.drive.row(master, self.angle(), f64::NAN)
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let setpoint = self.setpoint.poll_timeout().filter(|_| self.drive.axis.is_enabled());
        earliest([self.drive.poll_timeout(), self.homing.poll_timeout(), setpoint])
    }
}

/// What a steering is made of.
struct Built {
    table: Table,
    parameters: Parameters,
    units: Units,
    /// Homing has an acceleration of its own.
    acceleration: bool,
    reservations: Vec<Refusal>,
}

fn by_table(
    own: &DriveTable,
    config: &SteeringConfig,
    gear: f64,
    counts_per_turn: f64,
    remap: bool,
) -> Result<Built, ConfigError> {
    let turns = gear / TAU;
    let per_turn = match own.velocity_unit {
        VelocityUnit::CountsPerSecond => counts_per_turn,
        _ => own.units_per_turn,
    };
    let units = Units::new(counts_per_turn * gear / TAU, turns * per_turn, turns * per_turn);
    let parameters = Parameters {
        node: config.node,
        velocity: units.speed(config.speed),
        acceleration: units.acceleration(config.speed / RAMP_S),
        deceleration: units.acceleration(config.speed / RAMP_S),
        quick_stop_deceleration: units.acceleration(config.speed / QUICK_STOP_RAMP_S),
        remap,
    };
    // No angle is farther than a turn. A position that does not fit would be another angle.
    let turn = counts_per_turn * gear.abs();
    if turn > f64::from(i32::MAX) {
        let reason = Reason::OutOfLimits { value: turn as i64, low: i32::MIN.into(), high: i32::MAX.into() };
        let refusal = Refusal { index: 0x607A, sub: 0, reason };
        return Err(ConfigError::Drive { axis: super::Axis::Steering, refusal });
    }
    let high = own.velocity_max.unwrap_or(u32::MAX);
    if parameters.velocity > high {
        let reason = Reason::OutOfLimits { value: parameters.velocity.into(), low: 1, high: high.into() };
        let refusal = Refusal { index: 0x6081, sub: 0, reason };
        return Err(ConfigError::Drive { axis: super::Axis::Steering, refusal });
    }
    own.check(&parameters).map_err(|refusal| ConfigError::Drive { axis: super::Axis::Steering, refusal })?;
    let acceleration = own.homing_acceleration;
    Ok(Built { table: own.table.clone(), parameters, units, acceleration, reservations: Vec::new() })
}

fn by_sheet(drive: &Cia402, own: &SteeringConfig, config: &Config) -> Result<Built, ConfigError> {
    // Commands stay within the limit; homing ends at the switch.
    let end = config.limits.steering_rad.max(own.switch.abs()) * RANGE_MARGIN;
    let wanted = Wanted {
        axis: super::Axis::Steering,
        node: own.node,
        mode: drive.mode(super::Axis::Steering, own.node),
        per_turn: TAU,
        limits: derive::Limits {
            velocity: own.speed,
            acceleration: own.speed / RAMP_S,
            deceleration: own.speed / RAMP_S,
            quick_stop: own.speed / QUICK_STOP_RAMP_S,
        },
        range: Some([-end, end]),
        torque: false,
    };
    let derived = drive.derive(&wanted, config)?;
    Ok(Built {
        table: derived.table,
        parameters: derived.parameters,
        units: derived.units,
        acceleration: derived.homing_acceleration,
        reservations: derived.reservations,
    })
}
