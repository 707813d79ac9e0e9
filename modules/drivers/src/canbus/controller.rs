//! A motor controller without CANopen that turns a wheel (docs/motor-controllers.md): its engine, and what the module
//! must know of it.
//!
//! Device    ODrive by CAN Simple, VESC on CAN or a UART, RoboClaw: facts in `motorctl`; on a serial line see `lines`
//! Timing    set-points every 20 ms, a quick stop at once; the command time limit of the device is 200 ms, and proven
//! Silence   of the device for 80 ms: lost, all others stop; of the driver: an ODrive disarms itself, and rolls, a VESC
//!           brakes by `timeout_brake_current`, if that is not 0

use super::drive::{Objection, Trouble};
use super::engine::Engine;
use super::keys::{ControllerConfig, axis_of};
use super::lines::LineEngine;
use super::{Config, ConfigError, PropulsionConfig, PropulsionDrive, STANDSTILL_MPS};
use base::can::Frame;
use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use canopen::axis::Goal;
use messages::Hold;
use messages::lowlevel::{Axis, Node, Wheel};
use module::Actions;
use motorctl::can::OnCan;
use motorctl::{Event, Feedback, LostReason, Refusal, State, Step};
use std::f64::consts::TAU;
use std::fmt;

/// Minimum time for which one that did not obey blocks motion.
const TROUBLE_MIN: Duration = Duration::from_millis(500);
/// No start-up begins so long after a command of another program: each takes the torque away for its silence.
const COMMANDED_REST: Duration = Duration::from_millis(500);
/// Interval at which it is looked for standstill.
const STANDING_AGAIN: Duration = Duration::from_millis(20);
/// Age beyond which its speed is unknown.
const MEASURED_AGE_MAX: Duration = Duration::from_millis(200);

/// What is known of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Availability {
    Starting,
    Refused(Step),
    Lost(LostReason),
    /// Its bus, or its line, is down.
    Unreached(&'static str),
    Ready,
    /// Another program has commanded or configured it: it stops, and is started again.
    Commanded,
    /// It was disarmed, because the module ends.
    Off,
}

impl Availability {
    /// Cause in `LL_DATA_HOLD`.
    pub(super) fn hold(self) -> Hold {
        match self {
            Self::Starting | Self::Ready | Self::Off => Hold::DriveBooting,
            Self::Refused(_) => Hold::DriveBootFailed,
            Self::Lost(LostReason::Fault { .. }) => Hold::DriveFault,
            Self::Lost(LostReason::TimeLimitChanged) | Self::Commanded => Hold::DriveParameter,
            Self::Lost(_) | Self::Unreached(_) => Hold::DriveLost,
        }
    }
}

/// Predicate of a sentence whose subject is the drive.
impl fmt::Display for Availability {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Starting => f.write_str("is being started"),
            Self::Refused(step) => write!(f, "cannot be started: {step}"),
            Self::Lost(reason) => reason.fmt(f),
            Self::Unreached(what) => write!(f, "is not reached: the {what} is down"),
            Self::Ready => f.write_str("is ready"),
            Self::Commanded => f.write_str("was commanded by another program, and is started again at standstill"),
            Self::Off => f.write_str("is switched off"),
        }
    }
}

base::deadlines! {
    /// Deadlines beside those of the engine.
    enum Timer {
        /// Trouble is evaluated again. Set while it blocks motion.
        Trouble,
        /// It may be started again after a command of another program.
        Restart,
    }
}

pub(super) struct Controller {
    name: &'static str,
    /// Where it is, in words.
    place: String,
    /// Its id, or its address.
    address: u8,
    /// m per rad of the wheel.
    radius: f64,
    engine: Engine,
    availability: Availability,
    /// After a loss, a refusal or trouble it is not enabled before a deliberate act.
    locked: bool,
    trouble: Option<Trouble>,
    /// [`Fault::DriveFault`] was raised because of trouble.
    alarmed: bool,
    /// Another program has commanded or configured it since its last start-up began: what that start-up has written
    /// and proven no longer holds.
    commanded: bool,
    /// Commanded speed, m/s.
    target: f64,
    /// Its bus is up.
    reached: bool,
    /// When its speed was measured.
    measured: Option<Instant>,
    changed: bool,
    deadlines: Deadlines<Timer>,
}

impl Controller {
    /// `lines`: the devices of the serial lines.
    pub(super) fn new(own: &PropulsionConfig, config: &Config, lines: &[LineEngine]) -> Result<Self, ConfigError> {
        let (engine, place, circumference) = match own.drive {
            PropulsionDrive::Controller(ControllerConfig { gear, device, circumference }) => {
                let axis = axis_of(gear, circumference, &config.limits);
                let place = config.place(config.bus_of(own.axis), own.node);
                let engine = OnCan::new(&motorctl::Config::new([axis]), device);
                let engine = engine.map_err(|error| ConfigError::Controller { axis: own.axis, error })?;
                (Engine::Can { device, engine: Box::new(engine) }, place, circumference)
            }
            PropulsionDrive::OnLine { line, motor } => {
                let (Some(engine), Some(of)) = (lines.get(line), config.lines.get(line)) else {
                    return Err(ConfigError::NoMotor);
                };
                if motor >= of.motors.len() {
                    return Err(ConfigError::NoMotor);
                }
                (Engine::Line(engine.channel(line, motor)), of.bus.clone(), config.wheel_circumference)
            }
            PropulsionDrive::Table { .. } | PropulsionDrive::Cia402 { .. } => {
                return Err(ConfigError::NoSheet(own.axis));
            }
        };
        Ok(Self {
            name: own.axis.name(),
            place,
            address: own.node,
            radius: circumference / TAU,
            engine,
            availability: Availability::Starting,
            locked: false,
            trouble: None,
            alarmed: false,
            commanded: false,
            target: 0.0,
            reached: false,
            measured: None,
            changed: true,
            deadlines: Deadlines::new(),
        })
    }

    /// Number of the serial line that it is on; absent on CAN.
    pub(super) fn line(&self) -> Option<usize> {
        if let Engine::Line(channel) = &self.engine { Some(channel.number) } else { None }
    }

    /// Its bus or line is up, and the controller is started; or down.
    pub(super) fn on_bus(&mut self, now: Instant, up: bool, out: &mut Actions) {
        self.reached = up;
        if up {
            self.restart(now);
            return;
        }
        let was_ready = self.is_ready();
        // Nothing leaves: its command time limit acts.
        self.engine.disarm(now);
        self.engine.drop_tx(now);
        let unreached = Availability::Unreached(if self.line().is_some() { "line" } else { "bus" });
        self.set_availability(now, unreached);
        if was_ready {
            self.raise(Fault::DriveLost, format!("{unreached}; the robot stops"), out);
        }
    }

    fn restart(&mut self, now: Instant) {
        self.engine.restart(now);
        self.commanded = false;
        self.set_availability(now, Availability::Starting);
    }

    fn set_availability(&mut self, now: Instant, availability: Availability) {
        self.availability = availability;
        (self.locked, self.changed) = (true, true);
        self.trouble = None;
        self.deadlines.clear_all();
        // A start-up that ends may have begun before the command.
        if self.commanded && self.is_ready() {
            self.deadlines.set(Timer::Restart, now + COMMANDED_REST);
        }
    }

    /// Serves the deadlines of the engine; to be called before each decision, and after it.
    pub(super) fn serve(&mut self, now: Instant, out: &mut Actions) {
        if self.is_served() {
            self.engine.handle_timeout(now);
            self.drain(now, out);
        }
    }

    fn is_served(&self) -> bool {
        self.reached && self.availability != Availability::Off
    }

    /// True for a frame of its device, or to it.
    pub(super) fn is_own(&self, frame: &Frame) -> bool {
        matches!(&self.engine, Engine::Can { device, .. } if device.owns(frame))
    }

    /// True for a frame by which its device is commanded or configured, not one that asks it for something.
    pub(super) fn is_commanded_by(&self, frame: &Frame) -> bool {
        matches!(&self.engine, Engine::Can { device, .. } if device.is_commanded_by(frame))
    }

    /// Its name, if another program commands or configures its device by this frame; one that asks it for something
    /// does not. Its command time limit may be off then: it stops, and all of its start-up precedes the next motion.
    pub(super) fn on_foreign(&mut self, now: Instant, frame: &Frame) -> Option<&'static str> {
        if !self.is_commanded_by(frame) {
            return None;
        }
        self.changed |= !self.commanded;
        (self.commanded, self.locked) = (true, true);
        if self.is_ready() {
            self.deadlines.set(Timer::Restart, now + COMMANDED_REST);
        }
        Some(self.name)
    }

    /// A frame of its device.
    pub(super) fn on_frame(&mut self, now: Instant, frame: &Frame, out: &mut Actions) {
        if let Engine::Can { engine, .. } = &mut self.engine {
            engine.handle_rx(now, frame);
        }
        self.drain(now, out);
    }

    /// Its speed, m/s, if it was measured since the last call.
    pub(super) fn take_measured(&mut self) -> Option<f64> {
        let feedback = self.engine.feedback().filter(|feedback| self.measured.is_none_or(|at| feedback.at > at))?;
        self.measured = Some(feedback.at);
        Some(feedback.velocity_radps * self.radius)
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.engine.poll_event() {
            match event {
                Event::Ready { acted_after, reaction } => {
                    let after = acted_after.map_or(f64::NAN, |after| after.as_secs_f64());
                    self.set_availability(now, Availability::Ready);
                    self.alarmed = false;
                    let message = format!(
                        "{} drive ({}) is ready: {after:.2} s without a command it {reaction}",
                        self.name, self.place
                    );
                    let faults = [Fault::DriveLost, Fault::DriveBootFailed, Fault::DriveMismatch];
                    for fault in faults.into_iter().chain([Fault::DriveFault, Fault::DriveParameter]) {
                        out.clear(fault, self.name, message.clone());
                    }
                    out.note(message);
                }
                Event::Refused { step, reason } => {
                    self.set_availability(now, Availability::Refused(step));
                    let fault = match reason {
                        Refusal::Identity { .. } => Fault::DriveMismatch,
                        _ => Fault::DriveBootFailed,
                    };
                    self.raise(fault, format!("cannot be started, {step}: it {reason}; tried again each second"), out);
                }
                Event::Lost { reason } => {
                    self.set_availability(now, Availability::Lost(reason));
                    let fault = match reason {
                        LostReason::Fault { .. } => Fault::DriveFault,
                        LostReason::TimeLimitChanged => Fault::DriveParameter,
                        LostReason::Silent | LostReason::Disabled | LostReason::TimeLimitActed => Fault::DriveLost,
                    };
                    self.raise(fault, format!("{reason}; the robot stops, it is started again"), out);
                }
            }
        }
    }

    fn raise(&self, fault: Fault, predicate: impl fmt::Display, out: &mut Actions) {
        let message = format!("{} drive ({}) {predicate}", self.name, self.place);
        out.raise(Severity::Error, fault, self.name, message);
    }

    /// It does not obey: blocks motion until it was seen stopped.
    pub(super) fn block_until_stopped(&mut self, now: Instant, why: Trouble, message: String, out: &mut Actions) {
        out.raise(Severity::Error, Fault::DriveFault, self.name, message);
        (self.trouble, self.alarmed, self.locked) = (Some(why), true, true);
        self.deadlines.set(Timer::Trouble, now + TROUBLE_MIN);
    }

    /// Passes the goal to the engine; what follows from it is sent when all wheels have theirs, by [`Self::serve`].
    /// `speed`: measured, m/s, NaN if unknown.
    pub(super) fn advance(&mut self, now: Instant, goal: Goal, speed: f64, out: &mut Actions) {
        if self.deadlines.is_due(Timer::Trouble, now) {
            self.deadlines.set(Timer::Trouble, now + TROUBLE_MIN);
            if self.is_ready() && speed.abs() < STANDSTILL_MPS {
                self.deadlines.clear(Timer::Trouble);
                self.trouble = None;
            }
        }
        if self.deadlines.is_due(Timer::Restart, now) {
            if speed.abs() < STANDSTILL_MPS {
                self.restart(now);
            } else {
                // The speed monitor judges how it stops.
                self.deadlines.set(Timer::Restart, now + STANDING_AGAIN);
            }
        }
        if self.alarmed && self.trouble.is_none() && self.is_ready() {
            self.alarmed = false;
            out.clear(Fault::DriveFault, self.name, format!("{} drive: no fault any more", self.name));
        }
        match goal {
            Goal::Disabled => self.switch_off(now),
            _ if self.availability == Availability::Off => self.restart(now),
            Goal::Enabled if self.may_be_enabled() => {
                if self.engine.is_quick_stop() {
                    // Refused while it turns: it stays stopped.
                    let _refused = self.engine.release(now);
                }
                if !self.engine.is_quick_stop() && self.engine.command(now, self.target / self.radius).is_err() {
                    self.engine.quick_stop();
                }
            }
            Goal::Enabled | Goal::QuickStop => self.engine.quick_stop(),
        }
    }

    fn may_be_enabled(&self) -> bool {
        self.is_ready() && !self.locked && !self.commanded && self.trouble.is_none()
    }

    /// Takes the torque away. One that is not ready has none, or loses it by its command time limit.
    fn switch_off(&mut self, now: Instant) {
        if self.availability == Availability::Off {
            return;
        }
        if self.is_ready() {
            self.engine.disarm(now);
        }
        self.set_availability(now, Availability::Off);
    }

    /// The next frame, on CAN.
    pub(super) fn poll_frame(&mut self, now: Instant) -> Option<Frame> {
        if self.reached { self.engine.poll_frame(now) } else { None }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let engine = self.engine.poll_timeout().filter(|_| self.is_served());
        earliest([engine, self.deadlines.next()])
    }

    pub(super) fn target(&self) -> f64 {
        self.target
    }

    pub(super) fn set_target(&mut self, speed: f64) {
        self.target = speed;
    }

    pub(super) fn release(&mut self) {
        self.locked = false;
    }

    /// True if its speed was measured recently.
    pub(super) fn is_known(&self, now: Instant) -> bool {
        self.measured.is_some_and(|at| now.since(at) < MEASURED_AGE_MAX)
    }

    pub(super) fn is_ready(&self) -> bool {
        self.availability == Availability::Ready
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.may_be_enabled() && !self.engine.is_quick_stop()
    }

    pub(super) fn is_quick_stopped(&self) -> bool {
        self.is_ready() && self.engine.is_quick_stop()
    }

    pub(super) fn is_off(&self) -> bool {
        !self.is_ready()
    }

    pub(super) fn objection(&self) -> Option<Objection> {
        match (self.availability, self.trouble) {
            (Availability::Ready, _) if self.commanded => Some(Objection::Controller(Availability::Commanded)),
            (Availability::Ready, trouble) => trouble.map(Objection::Trouble),
            (availability, _) => Some(Objection::Controller(availability)),
        }
    }

    pub(super) fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// Row in `LL_DATA_AXES`, in the terms of CANopen and CiA 402.
    pub(super) fn row(&self, speed: f64) -> Axis {
        const OPERATION_ENABLED: i32 = 0x27;
        const QUICK_STOP_ACTIVE: i32 = 0x07;
        const FAULT: i32 = 0x08;
        const SWITCH_ON_DISABLED: i32 = 0x40;
        const OPERATIONAL: i8 = 5;
        const PRE_OPERATIONAL: i8 = 127;
        let (nmt_state, statusword, error_code) = match self.availability {
            Availability::Ready if self.engine.is_quick_stop() => (OPERATIONAL, QUICK_STOP_ACTIVE, 0),
            Availability::Ready => (OPERATIONAL, OPERATION_ENABLED, 0),
            Availability::Lost(LostReason::Fault { errors }) => (PRE_OPERATIONAL, FAULT, errors as i32),
            Availability::Starting | Availability::Off => (PRE_OPERATIONAL, SWITCH_ON_DISABLED, 0),
            Availability::Refused(_) | Availability::Lost(_) | Availability::Unreached(_) | Availability::Commanded => {
                (-1, 0, 0)
            }
        };
        Axis {
            name: self.name.into(),
            nmt_state,
            statusword,
            error_code,
            position: f64::NAN,
            velocity: speed,
            current: self.engine.feedback().map_or(f64::NAN, |feedback| feedback.current_a),
        }
    }

    /// Row in `LL_DATA_WHEELS`, without the speed.
    pub(super) fn wheel_row(&self) -> Wheel {
        let feedback = self.engine.feedback().filter(|_| self.is_ready());
        let of = |value: fn(&Feedback) -> f64| feedback.as_ref().map_or(f64::NAN, value);
        Wheel {
            name: self.name.into(),
            steering: f64::NAN,
            rotation: of(|feedback| feedback.position_rad),
            speed: f64::NAN,
            torque: f64::NAN,
            current: of(|feedback| feedback.current_a),
            temperature: of(|feedback| feedback.temperature_c),
            load: f64::NAN,
        }
    }

    /// Row in `LL_DATA_BUS`: it is asked for nothing that it must answer.
    pub(super) fn bus_row(&self) -> Node {
        let state = match (self.availability, self.engine.state()) {
            (Availability::Ready, _) => Node::OK,
            (Availability::Starting, State::Starting) => Node::DEGRADED,
            _ => Node::LOST,
        };
        Node {
            name: self.name.into(),
            address: i32::from(self.address),
            state,
            round_trip_min: f64::NAN,
            round_trip_mean: f64::NAN,
            round_trip_max: f64::NAN,
            ..Node::default()
        }
    }
}
