//! The other end: an ODrive axis with its motor, by the documents that [`super`] names. For the simulator and for
//! tests.
//!
//! Taken from the source of firmware 0.5.6 where 0.6 is not documented: every message to the axis feeds the watchdog
//! (`can_simple.cpp`), which expires in IDLE too and disarms (`axis.cpp`, `main.cpp`); with an error closed loop is not
//! entered. Assumed: a message that is not understood does not feed it; torque control turns nothing.

use super::wire::{CLOSED_LOOP, Command, IDLE, Message, VELOCITY_CONTROL, Value, error};
use super::{Device as Identity, Endpoints};
use crate::motor::{Drive, Encoder, Motor};
use base::can::Frame;
use base::{Duration, Instant, Queue, Ticker, earliest};

/// Interval of the heartbeat.
pub const HEARTBEAT: Duration = Duration::from_millis(20);
/// Interval of the encoder estimates.
pub const ESTIMATES: Duration = Duration::from_millis(10);

/// What is wrong with the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Neither receives nor sends; the motor runs on as the watchdog lets it.
    pub unplugged: bool,
    /// Sends no cyclic messages.
    pub mute: bool,
    /// The watchdog is configured, and never acts.
    pub watchdog_dead: bool,
    /// Parameters keep their values.
    pub read_only: bool,
}

/// An ODrive axis.
#[derive(Debug)]
pub struct Device {
    identity: Identity,
    /// What is wrong with it.
    pub faults: Faults,
    /// Its motor.
    pub motor: Motor,
    state: u8,
    errors: u32,
    disarm_reason: u32,
    control_mode: u32,
    input_vel: f32,
    watchdog_timeout_s: f32,
    watchdog_enabled: bool,
    /// When the watchdog was fed.
    fed: Instant,
    heartbeat: Ticker,
    estimates: Ticker,
    frames: Queue<Frame, 32>,
}

impl Device {
    /// An axis at power-on, calibrated, with the watchdog off.
    #[must_use]
    pub fn new(identity: Identity) -> Self {
        Self {
            identity,
            faults: Faults::default(),
            motor: Motor::new(),
            state: IDLE,
            errors: 0,
            disarm_reason: 0,
            control_mode: VELOCITY_CONTROL,
            input_vel: 0.0,
            watchdog_timeout_s: 0.0,
            watchdog_enabled: false,
            fed: Instant::ZERO,
            heartbeat: Ticker::new(Instant::ZERO, HEARTBEAT),
            estimates: Ticker::new(Instant::ZERO, ESTIMATES),
            frames: Queue::new(),
        }
    }

    /// True in closed loop control.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.state == CLOSED_LOOP
    }

    /// Raises errors, as the device's own checks do: the axis is disarmed.
    pub fn raise(&mut self, errors: u32) {
        self.errors |= errors;
        if self.is_armed() {
            self.disarm_reason = errors;
            self.state = IDLE;
        }
        self.act();
    }

    /// Takes a frame from the bus.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        let Some((node, command)) = Command::decode(frame).filter(|_| !self.faults.unplugged) else { return };
        if node != self.identity.node {
            return;
        }
        self.handle_timeout(now);
        self.fed = now;
        self.execute(command);
        self.act();
    }

    fn execute(&mut self, command: Command) {
        match command {
            Command::GetVersion => self.send(Message::Version(self.identity.version)),
            Command::Estop => self.raise(error::ESTOP_REQUESTED),
            Command::GetError => self.send(Message::Errors { active: self.errors, disarm: self.disarm_reason }),
            Command::Read { endpoint } => self.read(endpoint),
            Command::Write { endpoint, value } => self.write(endpoint, value),
            Command::SetAxisState(state) if state == u32::from(CLOSED_LOOP) => {
                if self.errors == 0 {
                    self.state = CLOSED_LOOP;
                }
            }
            Command::SetAxisState(_) => self.state = IDLE,
            Command::SetControllerMode { control, .. } => self.control_mode = control,
            Command::SetInputVel(velocity) => self.input_vel = velocity,
            Command::SetInputTorque(_) => {}
            Command::GetIq => self.send(Message::Iq(0.5)),
            Command::GetTemperature => self.send(Message::Temperature(31.0)),
            Command::GetBus => self.send(Message::Bus(24.0)),
            Command::ClearErrors => (self.errors, self.disarm_reason) = (0, 0),
        }
    }

    fn read(&mut self, endpoint: u16) {
        let Endpoints { enable_watchdog, watchdog_timeout } = self.identity.endpoints;
        if endpoint == enable_watchdog {
            self.send(Message::Parameter { endpoint, value: Value::Bool(self.watchdog_enabled) });
        } else if endpoint == watchdog_timeout {
            self.send(Message::Parameter { endpoint, value: Value::Float(self.watchdog_timeout_s) });
        }
    }

    fn write(&mut self, endpoint: u16, value: Value) {
        let Endpoints { enable_watchdog, watchdog_timeout } = self.identity.endpoints;
        match value {
            _ if self.faults.read_only => {}
            Value::Bool(on) if endpoint == enable_watchdog => self.watchdog_enabled = on,
            Value::Float(seconds) if endpoint == watchdog_timeout => self.watchdog_timeout_s = seconds,
            _ => {}
        }
    }

    fn send(&mut self, message: Message) {
        if !self.faults.unplugged {
            self.frames.push(message.frame(self.identity.node));
        }
    }

    /// What the motor is driven with.
    fn act(&mut self) {
        self.motor.drive = match self.is_armed() {
            true if self.control_mode == VELOCITY_CONTROL => Drive::Velocity(self.input_vel.into()),
            _ => Drive::Free,
        };
    }

    /// When the watchdog expires.
    fn expiry(&self) -> Option<Instant> {
        let on = self.watchdog_enabled && !self.faults.watchdog_dead;
        let expired = self.errors & error::WATCHDOG_TIMER_EXPIRED != 0;
        let timeout = Duration::try_from_secs_f32(self.watchdog_timeout_s).unwrap_or(Duration::MAX);
        (on && !expired).then_some(self.fed + timeout)
    }

    /// Moves the motor, checks, and sends the cyclic messages.
    pub fn handle_timeout(&mut self, now: Instant) {
        if let Some(expiry) = self.expiry().filter(|expiry| *expiry <= now) {
            self.motor.advance(expiry);
            self.raise(error::WATCHDOG_TIMER_EXPIRED);
        }
        self.motor.advance(now);
        let runs_away = self.motor.encoder == Encoder::Reversed && self.motor.velocity().abs() > 0.5;
        if self.is_armed() && runs_away {
            self.raise(error::SPINOUT_DETECTED);
        }
        if self.heartbeat.due(now) && !self.faults.mute {
            self.send(Message::Heartbeat { errors: self.errors, state: self.state });
        }
        if self.estimates.due(now) && !self.faults.mute {
            let (position, velocity) = (self.motor.turns() as f32, self.motor.measured() as f32);
            self.send(Message::Estimates { position, velocity });
        }
    }

    /// Next frame for the bus.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        self.frames.pop()
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        earliest([self.expiry(), Some(self.heartbeat.next()), Some(self.estimates.next())])
    }
}
