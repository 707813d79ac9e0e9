//! What turns a wheel, or the rear axle: a CANopen drive, or a motor controller without CANopen; and what is the same
//! for both: the order, the measured speed, and the comparison of the two.

use super::controller::Controller;
use super::drive::{Drive, Objection, Trouble};
use super::lines::LineEngine;
use super::net::NodeAt;
use super::second_way::WheelWatch;
use super::servo::{Force, Servo};
use super::speed_monitor::Order;
use super::{Axis, Config, ConfigError, PropulsionConfig, STANDSTILL_MPS};
use base::can::Frame;
use base::{Instant, earliest};
use canopen::Master;
use canopen::axis::{Follow, FollowConfig, Goal, NotFollowing, PowerState};
use messages::lowlevel;
use module::Actions;
use std::f64::consts::TAU;

/// Targets below this are not compared with the measured speed, m/s: four units of its resolution.
const FOLLOWED_MIN_MPS: f64 = 0.05;

/// What drives it.
enum Motor {
    Canopen(Box<Servo>),
    Controller(Box<Controller>),
}

pub(super) struct Propulsion {
    pub(super) axis: Axis,
    /// Number of its CAN bus; without meaning on a serial line.
    pub(super) bus: usize,
    motor: Motor,
    goal: Goal,
    /// It has gained speed against its brake: its drive is switched off, whatever the goal, until a person has let the
    /// robot go.
    cut: bool,
    /// Measured speed, m/s; NaN if unknown.
    speed: f64,
    /// Measured since the last call of [`Self::take_measured`].
    measured: bool,
    follow: Follow,
    pub(super) watch: WheelWatch,
}

impl Propulsion {
    pub(super) fn new(own: &PropulsionConfig, config: &Config, lines: &[LineEngine]) -> Result<Self, ConfigError> {
        let limits = &config.limits;
        let bus = config.bus_of(own.axis);
        let motor = match Servo::new(own, config)? {
            Some(mut servo) => {
                servo.drive = servo.drive.on_bus(bus, config.place(bus, own.node));
                Motor::Canopen(Box::new(servo))
            }
            None => Motor::Controller(Box::new(Controller::new(own, config, lines)?)),
        };
        // Several wheels are commanded the steps of a common ramp, and a motor controller may have none.
        let has_ramp = config.wheels.len() == 1 && matches!(motor, Motor::Canopen(_));
        let (acceleration, deceleration) = (limits.acceleration_mps2, limits.deceleration_mps2);
        Ok(Self {
            axis: own.axis,
            bus,
            motor,
            goal: Goal::QuickStop,
            cut: false,
            speed: f64::NAN,
            measured: false,
            follow: Follow::new(FollowConfig { ramp: acceleration.min(deceleration), least: FOLLOWED_MIN_MPS }),
            watch: WheelWatch::new(acceleration, deceleration, limits.quick_stop_mps2, has_ramp),
        })
    }

    pub(super) fn servo(&self) -> Option<&Servo> {
        if let Motor::Canopen(servo) = &self.motor { Some(servo) } else { None }
    }

    /// Its CANopen drive.
    pub(super) fn drive_ref(&self) -> Option<&Drive> {
        self.servo().map(|servo| &servo.drive)
    }

    /// The same.
    pub(super) fn drive_mut(&mut self) -> Option<&mut Drive> {
        if let Motor::Canopen(servo) = &mut self.motor { Some(&mut servo.drive) } else { None }
    }

    /// Its motor controller without CANopen.
    pub(super) fn controller(&self) -> Option<&Controller> {
        if let Motor::Controller(controller) = &self.motor { Some(controller) } else { None }
    }

    /// The same.
    pub(super) fn controller_mut(&mut self) -> Option<&mut Controller> {
        if let Motor::Controller(controller) = &mut self.motor { Some(controller) } else { None }
    }

    /// True if its drive is this node of CANopen.
    pub(super) fn is_node(&self, node: NodeAt) -> bool {
        self.drive_ref().is_some_and(|drive| drive.at() == node)
    }

    /// A frame was received: true if it is one of the motor controller.
    pub(super) fn on_frame(&mut self, now: Instant, frame: &Frame, out: &mut Actions) -> bool {
        let Some(controller) = self.controller_mut().filter(|controller| controller.is_own(frame)) else {
            return false;
        };
        controller.on_frame(now, frame, out);
        self.take_speed();
        true
    }

    /// The device of this serial line has received bytes, or time has passed.
    pub(super) fn on_line(&mut self, now: Instant, line: usize, out: &mut Actions) {
        if let Some(controller) = self.controller_mut().filter(|controller| controller.line() == Some(line)) {
            controller.serve(now, out);
            self.take_speed();
        }
    }

    /// Takes the speed that the motor controller has measured.
    fn take_speed(&mut self) {
        if let Some(speed) = self.controller_mut().and_then(Controller::take_measured) {
            (self.speed, self.measured) = (speed, true);
        }
    }

    /// A PDO of the CANopen drive.
    pub(super) fn on_pdo(&mut self, now: Instant, number: u8, data: &[u8], out: &mut Actions) {
        let Motor::Canopen(servo) = &mut self.motor else { return };
        let Some((speed, statusword)) = servo.take_pdo(now, number, data) else { return };
        if let Some(speed) = speed {
            self.on_speed(now, speed);
        }
        if let (Some(statusword), Some(drive)) = (statusword, self.drive_mut()) {
            drive.on_statusword(now, statusword, out);
        }
    }

    /// A velocity in the unit of the CANopen drive.
    pub(super) fn on_velocity(&mut self, now: Instant, velocity: i32) {
        if let Some(speed) = self.servo().map(|servo| servo.velocity_si(velocity)) {
            self.on_speed(now, speed);
        }
    }

    fn on_speed(&mut self, now: Instant, speed: f64) {
        (self.speed, self.measured) = (speed, true);
        if let Some(drive) = self.drive_mut() {
            drive.on_measured(now);
        }
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
        let message = format!("{} drive {why}: the robot stops", self.axis.name());
        match &mut self.motor {
            Motor::Canopen(servo) => {
                servo.drive.alarm(message, out);
                servo.drive.block_until_stopped(now, why);
            }
            Motor::Controller(controller) => controller.block_until_stopped(now, why, message, out),
        }
    }

    /// The speed should be changing.
    pub(super) fn set_changing(&mut self, now: Instant, changing: bool) {
        if let Some(drive) = self.drive_mut() {
            drive.set_changing(now, changing);
        }
    }

    /// Commanded speed, m/s.
    fn target(&self) -> f64 {
        match &self.motor {
            Motor::Canopen(servo) => servo.target(),
            Motor::Controller(controller) => controller.target(),
        }
    }

    fn set_target(&mut self, speed: f64) {
        match &mut self.motor {
            Motor::Canopen(servo) => servo.set_target(speed),
            Motor::Controller(controller) => controller.set_target(speed),
        }
    }

    /// True if its speed was measured recently.
    pub(super) fn is_known(&self, now: Instant) -> bool {
        match &self.motor {
            Motor::Canopen(servo) => servo.drive.is_known(now),
            Motor::Controller(controller) => controller.is_known(now),
        }
    }

    /// True if its speed is known to be below `limit`, m/s.
    pub(super) fn is_slower(&self, now: Instant, limit: f64) -> bool {
        self.is_known(now) && self.speed.abs() < limit
    }

    /// True if the power stage was on by the last statusword, and the drive is not known to be at standstill.
    pub(super) fn may_turn(&self) -> bool {
        let is_powered = self.drive_ref().is_some_and(Drive::is_powered);
        is_powered && (self.speed.is_nan() || self.speed.abs() >= STANDSTILL_MPS)
    }

    /// True if no brake holds it, as far as this driver switches it.
    fn is_free(&self) -> bool {
        self.servo().is_none_or(|servo| servo.drive.is_free())
    }

    /// Drives at `speed`, m/s, as soon as its brake is released.
    pub(super) fn drive(&mut self, speed: f64) {
        self.goal = Goal::Enabled;
        self.set_target(if self.is_free() { speed } else { 0.0 });
    }

    /// Stops by the quick stop ramp and stays stopped.
    pub(super) fn quick_stop(&mut self) {
        self.goal = Goal::QuickStop;
        self.set_target(0.0);
    }

    /// Takes the torque away; the drive must stand.
    pub(super) fn switch_off(&mut self) {
        self.goal = Goal::Disabled;
        self.set_target(0.0);
    }

    /// Takes the torque away at once, also of a wheel that turns.
    pub(super) fn cut(&mut self) {
        self.cut = true;
    }

    /// A person has let the robot go.
    pub(super) fn end_cut(&mut self) {
        self.cut = false;
    }

    pub(super) fn is_cut(&self) -> bool {
        self.cut
    }

    pub(super) fn advance(&mut self, now: Instant, master: &mut Master, out: &mut Actions) {
        let goal = if self.cut { Goal::Disabled } else { self.goal };
        let is_unknown = match &self.motor {
            Motor::Canopen(servo) => !servo.drive.is_booted() && !servo.drive.is_fresh(now),
            Motor::Controller(controller) => !controller.is_known(now),
        };
        if is_unknown {
            self.on_lost();
        }
        match &mut self.motor {
            Motor::Canopen(servo) => servo.advance(now, (goal, self.cut), self.speed, master, out),
            Motor::Controller(controller) => controller.advance(now, goal, self.speed, out),
        }
    }

    /// [`Servo::blind_stop`]; a motor controller without CANopen is stopped by its start-up, and by its own time limit.
    pub(super) fn blind_stop(&mut self, now: Instant, bus_is_up: bool) -> Option<Frame> {
        if let Motor::Canopen(servo) = &mut self.motor { servo.blind_stop(now, bus_is_up) } else { None }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let of_motor = match &self.motor {
            Motor::Canopen(servo) => servo.poll_timeout(),
            Motor::Controller(controller) => controller.poll_timeout(),
        };
        earliest([of_motor, self.watch.unwatched])
    }

    /// The motor's force at the floor, if its drive reports its torque, and has done so recently.
    pub(super) fn force(&self, now: Instant) -> Option<Force> {
        self.servo()?.force(now)
    }

    /// Measured speed, m/s; NaN if unknown.
    pub(super) fn measured(&self) -> f64 {
        self.speed
    }

    /// Measured speed, m/s; 0 if unknown.
    pub(super) fn speed(&self) -> f64 {
        if self.speed.is_nan() { 0.0 } else { self.speed }
    }

    /// True if the drive is booted, or the motor controller started: it takes commands.
    pub(super) fn is_up(&self) -> bool {
        match &self.motor {
            Motor::Canopen(servo) => servo.drive.is_booted(),
            Motor::Controller(controller) => controller.is_ready(),
        }
    }

    pub(super) fn is_enabled(&self) -> bool {
        match &self.motor {
            Motor::Canopen(servo) => servo.drive.axis.is_enabled() && servo.drive.is_free(),
            Motor::Controller(controller) => controller.is_enabled(),
        }
    }

    pub(super) fn is_quick_stopped(&self) -> bool {
        match &self.motor {
            Motor::Canopen(servo) => servo.is_quick_stopped(),
            Motor::Controller(controller) => controller.is_quick_stopped(),
        }
    }

    /// True if a quick stop is in progress, or may be.
    pub(super) fn may_be_stopping(&self) -> bool {
        match &self.motor {
            Motor::Canopen(servo) => servo.may_be_stopping(),
            Motor::Controller(controller) => !controller.is_ready() || controller.is_quick_stopped(),
        }
    }

    /// True if it has no torque, or is not reached at all.
    pub(super) fn is_off(&self) -> bool {
        match &self.motor {
            Motor::Canopen(servo) => servo.drive.is_off(),
            Motor::Controller(controller) => controller.is_off(),
        }
    }

    /// A deliberate act: it may be enabled again after a fault, a drop or a loss.
    pub(super) fn release(&mut self) {
        match &mut self.motor {
            Motor::Canopen(servo) => servo.drive.release(),
            Motor::Controller(controller) => controller.release(),
        }
    }

    /// Objection to motion.
    pub(super) fn objection(&self) -> Option<Objection> {
        match &self.motor {
            Motor::Canopen(servo) => servo.drive.objection(),
            Motor::Controller(controller) => controller.objection(),
        }
    }

    /// What it is commanded now, by its own state; [`Order::None`]: it is not judged.
    pub(super) fn order(&self) -> Order {
        match &self.motor {
            Motor::Controller(controller) if !controller.is_ready() => Order::None,
            Motor::Controller(_) if self.is_quick_stopped() => Order::Stop,
            Motor::Controller(_) => Order::Drive(self.target()),
            // A quick stop is sent all the time; whether it brakes is seen when its speed can be read again.
            Motor::Canopen(servo) if !servo.drive.is_booted() => {
                if servo.drive.is_powered() {
                    Order::Stop
                } else {
                    Order::None
                }
            }
            Motor::Canopen(servo) => match (servo.drive.axis.state(), servo.drive.axis.goal()) {
                (Some(PowerState::FaultReactionActive), _) => Order::Stop,
                (Some(PowerState::OperationEnabled | PowerState::QuickStopActive), Goal::Enabled) => {
                    Order::Drive(self.target())
                }
                (Some(PowerState::OperationEnabled | PowerState::QuickStopActive), _) => Order::Stop,
                _ => Order::None,
            },
        }
    }

    /// True if its state changed since the last call.
    pub(super) fn take_changed(&mut self) -> bool {
        match &mut self.motor {
            Motor::Canopen(servo) => servo.drive.take_changed(),
            Motor::Controller(controller) => controller.take_changed(),
        }
    }

    /// Row in `LL_DATA_WHEELS`; `circumference`: of the wheel, m.
    pub(super) fn wheel_row(&self, circumference: f64) -> lowlevel::Wheel {
        let speed = self.speed / circumference * TAU;
        match &self.motor {
            Motor::Canopen(servo) => servo.drive.wheel_row(f64::NAN, speed),
            Motor::Controller(controller) => lowlevel::Wheel { speed, ..controller.wheel_row() },
        }
    }

    pub(super) fn row(&self, master: &Master) -> lowlevel::Axis {
        match &self.motor {
            Motor::Canopen(servo) => servo.drive.row(master, f64::NAN, self.speed),
            Motor::Controller(controller) => controller.row(self.speed),
        }
    }
}
