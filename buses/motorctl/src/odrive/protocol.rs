//! The start-up of an ODrive, its commands and its feedback.
//!
//! Steps: heartbeat; version; zero velocity until it stands, IDLE; write and read back the watchdog's time and its
//! switch; closed loop with zero torque; silence until the heartbeat shows that the axis is disarmed, and Get_Error
//! that the watchdog did it; errors cleared, closed loop with zero velocity.

use super::wire::{
    CLOSED_LOOP, Command, IDLE, Message, PASSTHROUGH, Received, TORQUE_CONTROL, VELOCITY_CONTROL, Value,
};
use super::wire::{Version, error};
use super::{Device, Endpoints};
use crate::config::Timing;
use crate::engine::{Progress, Protocol, Setpoint, Shared};
use crate::event::{LostReason, Reaction, Refusal, Step, text};
use base::can::Frame;
use base::{Duration, Instant, Queue};

/// Time limit of a step that waits for an answer.
const ANSWER_WITHIN: Duration = Duration::from_millis(500);
/// Interval of a request that is repeated until it is answered.
const REPEAT: Duration = Duration::from_millis(100);
/// Time limit to stand, when the axis turned at the start.
const STANDSTILL_WITHIN: Duration = Duration::from_secs(5);
/// Pause after a write. Firmware 0.6.11 and later confirms it with a TxSdo, which must not be taken for the answer to
/// the read (ODriveResources, `examples/can_param_access.py`).
const WRITE_PAUSE: Duration = Duration::from_millis(100);
/// One measurement is asked for in this many periods.
const MEASURE_PERIODS: u8 = 5;
/// Measurements, asked for in turn.
const MEASUREMENTS: [Command; 3] = [Command::GetBus, Command::GetTemperature, Command::GetIq];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Parameter {
    Timeout,
    Enable,
}

/// What the start-up waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wait {
    /// A heartbeat.
    Contact,
    /// Get_Version.
    Version,
    /// Standstill.
    Standstill,
    /// IDLE.
    Idle,
    /// The end of the pause after the write of a parameter.
    Written(Parameter),
    /// The value of a parameter.
    Read(Parameter),
    /// Closed loop, without torque.
    Armed,
    /// Get_Error, after the axis was disarmed so long after the last command.
    Cause { acted_after: Duration },
    /// Closed loop, at zero velocity.
    Enabled { acted_after: Duration },
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Off,
    /// The requests of `wait` are repeated at `next`, and given up at `until`.
    Waiting {
        wait: Wait,
        next: Instant,
        until: Instant,
    },
    /// Nothing is sent; the axis must be disarmed before `until`.
    Silence {
        until: Instant,
    },
    Ready {
        heartbeat_until: Instant,
        /// Periods since the last measurement was asked for, and which comes next.
        periods: u8,
        measurement: usize,
    },
}

/// CAN Simple for one axis.
#[derive(Debug)]
pub struct CanSimple {
    device: Device,
    timing: Timing,
    phase: Phase,
    /// Error bits of the last heartbeat.
    errors: u32,
    /// When the last frame was handed out.
    sent: Instant,
    frames: Queue<Frame, 8>,
}

impl CanSimple {
    pub(super) fn new(device: Device, timing: Timing) -> Self {
        let frames = Queue::new();
        Self { device, timing, phase: Phase::Off, errors: 0, sent: Instant::ZERO, frames }
    }

    fn push(&mut self, command: Command) {
        self.frames.push(command.frame(self.device.node));
    }

    /// Begins to wait, with the requests that belong to it.
    fn enter(&mut self, now: Instant, wait: Wait) -> Progress {
        let endpoints = self.device.endpoints;
        match wait {
            Wait::Written(parameter) => {
                let value = self.value(parameter);
                self.push(Command::Write { endpoint: endpoint(endpoints, parameter), value });
            }
            Wait::Armed => self.arm(TORQUE_CONTROL, Command::SetInputTorque(0.0)),
            Wait::Enabled { .. } => self.arm(VELOCITY_CONTROL, Command::SetInputVel(0.0)),
            _ => self.request(wait),
        }
        let (repeat, within) = match wait {
            Wait::Contact => (ANSWER_WITHIN, ANSWER_WITHIN),
            Wait::Standstill => (self.timing.period, STANDSTILL_WITHIN),
            Wait::Written(_) => (WRITE_PAUSE, WRITE_PAUSE),
            Wait::Armed | Wait::Enabled { .. } => (self.timing.period, ANSWER_WITHIN),
            _ => (REPEAT, ANSWER_WITHIN),
        };
        self.phase = Phase::Waiting { wait, next: now + repeat, until: now + within };
        Progress::Pending
    }

    fn arm(&mut self, control: u32, input: Command) {
        self.push(Command::ClearErrors);
        self.push(Command::SetControllerMode { control, input: PASSTHROUGH });
        self.push(input);
        self.push(Command::SetAxisState(CLOSED_LOOP.into()));
    }

    /// What is sent at first and repeated while the start-up waits.
    fn request(&mut self, wait: Wait) {
        match wait {
            Wait::Contact | Wait::Written(_) => {}
            Wait::Version => self.push(Command::GetVersion),
            Wait::Standstill | Wait::Enabled { .. } => self.push(Command::SetInputVel(0.0)),
            Wait::Idle => self.push(Command::SetAxisState(IDLE.into())),
            Wait::Read(parameter) => {
                self.push(Command::Read { endpoint: endpoint(self.device.endpoints, parameter) });
            }
            Wait::Armed => self.push(Command::SetInputTorque(0.0)),
            Wait::Cause { .. } => self.push(Command::GetError),
        }
    }

    fn value(&self, parameter: Parameter) -> Value {
        match parameter {
            Parameter::Timeout => Value::Float(self.timing.time_limit.as_secs_f32()),
            Parameter::Enable => Value::Bool(true),
        }
    }

    /// The time of a step is over.
    fn expired(&mut self, now: Instant, wait: Wait) -> Progress {
        let not_enabled = match self.errors {
            0 => Refusal::NotEnabled,
            errors => Refusal::Fault { errors },
        };
        match wait {
            Wait::Contact => Progress::Refused(Step::Contact, Refusal::Silent),
            Wait::Version => Progress::Refused(Step::Identity, Refusal::Silent),
            Wait::Standstill => Progress::Refused(Step::Standstill, Refusal::Moving),
            Wait::Idle => Progress::Refused(Step::Standstill, Refusal::NotEnabled),
            Wait::Written(parameter) => self.enter(now, Wait::Read(parameter)),
            Wait::Read(_) => Progress::Refused(Step::TimeLimit, Refusal::Silent),
            Wait::Armed => Progress::Refused(Step::Silence, not_enabled),
            Wait::Cause { .. } => Progress::Refused(Step::Silence, Refusal::Silent),
            Wait::Enabled { .. } => Progress::Refused(Step::Enable, not_enabled),
        }
    }

    fn heartbeat(&mut self, now: Instant, errors: u32, state: u8) -> Progress {
        self.errors = errors;
        let armed = state == CLOSED_LOOP && errors == 0;
        match self.phase {
            Phase::Waiting { wait: Wait::Contact, .. } => self.enter(now, Wait::Version),
            Phase::Waiting { wait: Wait::Idle, .. } if state == IDLE => {
                self.enter(now, Wait::Written(Parameter::Timeout))
            }
            Phase::Waiting { wait: Wait::Armed, .. } if armed => {
                self.frames.clear();
                // The reaction is seen at the first heartbeat after it.
                let until = self.sent + self.timing.time_limit + self.device.heartbeat_within;
                self.phase = Phase::Silence { until };
                Progress::Pending
            }
            Phase::Silence { .. } if state != CLOSED_LOOP => {
                let acted_after = now.since(self.sent);
                self.enter(now, Wait::Cause { acted_after })
            }
            Phase::Waiting { wait: Wait::Enabled { acted_after }, .. } if armed => {
                let heartbeat_until = now + self.device.heartbeat_within;
                self.phase = Phase::Ready { heartbeat_until, periods: 0, measurement: 0 };
                Progress::Started(Some(acted_after), Reaction::Disarms)
            }
            Phase::Ready { periods, measurement, .. } => {
                let heartbeat_until = now + self.device.heartbeat_within;
                self.phase = Phase::Ready { heartbeat_until, periods, measurement };
                self.operating(errors, state)
            }
            _ => Progress::Pending,
        }
    }

    fn operating(&self, errors: u32, state: u8) -> Progress {
        if errors & error::WATCHDOG_TIMER_EXPIRED != 0 {
            Progress::Lost(LostReason::TimeLimitActed)
        } else if errors != 0 {
            Progress::Lost(LostReason::Fault { errors })
        } else if state != CLOSED_LOOP {
            Progress::Lost(LostReason::Disabled)
        } else {
            Progress::Pending
        }
    }

    fn version(&mut self, now: Instant, version: Version) -> Progress {
        match self.phase {
            Phase::Waiting { wait: Wait::Version, .. } if version == self.device.version => {
                self.enter(now, Wait::Standstill)
            }
            Phase::Waiting { wait: Wait::Version, .. } => {
                let ([h0, h1, h2], [f0, f1, f2]) = (version.hardware, version.firmware);
                let found = text(format_args!("hardware {h0}.{h1}.{h2}, firmware {f0}.{f1}.{f2}"));
                Progress::Refused(Step::Identity, Refusal::Identity { found })
            }
            _ => Progress::Pending,
        }
    }

    fn parameter(&mut self, now: Instant, number: u16, value: Value) -> Progress {
        let Phase::Waiting { wait: Wait::Read(parameter), .. } = self.phase else { return Progress::Pending };
        if endpoint(self.device.endpoints, parameter) != number {
            return Progress::Pending;
        }
        if value != self.value(parameter) {
            let found = match value {
                Value::Float(seconds) => Duration::try_from_secs_f32(seconds).unwrap_or(Duration::MAX),
                Value::Bool(_) => Duration::ZERO,
            };
            return Progress::Refused(Step::TimeLimit, Refusal::TimeLimit { found });
        }
        match parameter {
            Parameter::Timeout => self.enter(now, Wait::Written(Parameter::Enable)),
            Parameter::Enable => self.enter(now, Wait::Armed),
        }
    }

    fn cause(&mut self, now: Instant, errors: u32) -> Progress {
        let Phase::Waiting { wait: Wait::Cause { acted_after }, .. } = self.phase else { return Progress::Pending };
        match errors {
            // Sent before the axis was disarmed.
            0 => Progress::Pending,
            _ if errors & error::WATCHDOG_TIMER_EXPIRED != 0 => self.enter(now, Wait::Enabled { acted_after }),
            _ => Progress::Refused(Step::Silence, Refusal::Fault { errors }),
        }
    }

    fn message(&mut self, now: Instant, message: Message, shared: &mut Shared<1>) -> Progress {
        let feedback = &mut shared.feedback[0];
        match message {
            Message::Version(version) => return self.version(now, version),
            Message::Heartbeat { errors, state } => return self.heartbeat(now, errors, state),
            Message::Errors { active, disarm } => return self.cause(now, active | disarm),
            Message::Parameter { endpoint, value } => return self.parameter(now, endpoint, value),
            Message::Estimates { position, velocity } => {
                shared.measured(now, 0, velocity.into(), position.into());
                if matches!(self.phase, Phase::Waiting { wait: Wait::Standstill, .. }) && shared.stands(0) {
                    return self.enter(now, Wait::Idle);
                }
            }
            Message::Iq(current) => feedback.current_a = current.into(),
            Message::Temperature(stage) => feedback.temperature_c = stage.into(),
            Message::Bus(voltage) => feedback.supply_v = voltage.into(),
        }
        Progress::Pending
    }
}

fn endpoint(endpoints: Endpoints, parameter: Parameter) -> u16 {
    match parameter {
        Parameter::Timeout => endpoints.watchdog_timeout,
        Parameter::Enable => endpoints.enable_watchdog,
    }
}

impl Protocol<1> for CanSimple {
    type Rx = Frame;
    type Tx = Frame;

    fn start(&mut self, now: Instant) {
        self.errors = 0;
        self.enter(now, Wait::Contact);
    }

    fn reset(&mut self) {
        self.phase = Phase::Off;
        self.frames.clear();
    }

    fn withdraw(&mut self, _: Instant) {
        let is_stranger = matches!(self.phase, Phase::Waiting { wait: Wait::Contact | Wait::Version, .. });
        self.reset();
        if !is_stranger {
            self.push(Command::SetAxisState(IDLE.into()));
        }
    }

    fn handle_rx(&mut self, now: Instant, frame: &Frame, shared: &mut Shared<1>) -> Progress {
        match Message::decode(self.device.node, frame) {
            Received::Message(message) => self.message(now, message, shared),
            Received::Other => Progress::Pending,
            Received::Malformed => {
                shared.reject();
                Progress::Pending
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant, _: &mut Shared<1>) -> Progress {
        match self.phase {
            Phase::Waiting { wait, until, .. } if until <= now => self.expired(now, wait),
            Phase::Waiting { wait, next, until } if next <= now => {
                self.request(wait);
                let repeat = match wait {
                    Wait::Standstill | Wait::Armed | Wait::Enabled { .. } => self.timing.period,
                    _ => REPEAT,
                };
                self.phase = Phase::Waiting { wait, next: now + repeat, until };
                Progress::Pending
            }
            Phase::Silence { until } if until <= now => {
                Progress::Refused(Step::Silence, Refusal::NoReaction { after: now.since(self.sent) })
            }
            Phase::Ready { heartbeat_until, .. } if heartbeat_until <= now => Progress::Lost(LostReason::Silent),
            _ => Progress::Pending,
        }
    }

    fn send(&mut self, _: Instant, setpoint: &Setpoint<1>, shared: &Shared<1>) {
        // Of a bus that takes nothing, only the newest setpoint may wait.
        self.frames.clear();
        let turns_per_s = setpoint.velocity_radps[0] * shared.axes[0].turns_per_rad();
        self.push(Command::SetInputVel(turns_per_s as f32));
        let Phase::Ready { periods, measurement, .. } = &mut self.phase else { return };
        *periods += 1;
        if *periods >= MEASURE_PERIODS {
            let command = MEASUREMENTS[*measurement];
            (*periods, *measurement) = (0, (*measurement + 1) % MEASUREMENTS.len());
            self.push(command);
        }
    }

    fn halt(&mut self, _: Instant) {
        self.reset();
        self.push(Command::SetInputVel(0.0));
    }

    fn disarm(&mut self, _: Instant) {
        self.reset();
        self.push(Command::Estop);
    }

    fn poll_tx(&mut self, now: Instant) -> Option<Frame> {
        let frame = self.frames.pop()?;
        self.sent = now;
        Some(frame)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self.phase {
            Phase::Off => None,
            Phase::Waiting { next, until, .. } => Some(next.min(until)),
            Phase::Silence { until } => Some(until),
            Phase::Ready { heartbeat_until, .. } => Some(heartbeat_until),
        }
    }
}
