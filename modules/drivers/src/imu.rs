//! Inertial measurement units, any number of them, each on a serial line, an I2C or a CAN bus.
//!
//! Devices   by `[imu.<name>]` of robot.toml (`docs/imu.md`): Bosch BNO055, WitMotion, Xsens MTi
//! Protocol  the engines of `imu`; on I2C one transfer at a time for each device, on CAN nothing is sent
//! Timing    at the rate of the device, with the instant of the measurement
//! Zero      of the gyroscope: what it measures while the robot stands by `LL_DATA_VELOCITY`, which is subtracted
//! Silence   no measurement for 400 ms: reported, ERROR, started anew each time
//! Data      `LL_DATA_IMU` for each measurement, in the robot frame; `LL_DATA_BUS` once a second for each serial line
//!
//! `LL_DATA_MOTION` does not say whether a base turns on the spot; so the standstill is taken from `LL_DATA_VELOCITY`.
//! In STOP nothing is published. None of these is a safety device.

mod config;
mod zero;

use base::can::Frame;
use base::i2c::Outcome;
use base::serial::Word;
use base::{Duration, Fault, Instant, Severity, Ticker, earliest};
pub use config::{Config, DEVICES_MAX, Device, ImuKeys, Model};
use imu::frame::Rotation;
use imu::{Event as ImuEvent, Fault as ImuFault, Imu, LostReason, Sample, Status};
use messages::lowlevel::{DataBus, DataImu, DataVelocity};
use messages::{Channel, Message};
use module::{Actions, Event, Input, Line, Module, OUTSTANDING, PortId, PortSpec, State};
use std::collections::VecDeque;
use zero::{Zero, ZeroState};

/// Name of the module.
pub const NAME: &str = "driver_imu";
/// Period of the statistics of lines.
const BUS_PERIOD: Duration = Duration::from_secs(1);
/// Speeds below which the robot counts as standing: m/s, and rad/s.
const STANDS: (f64, f64) = (0.005, 0.005);
/// It must have stood for this time: what moves with it has come to rest.
const SETTLED: Duration = Duration::from_millis(500);
/// Age of the velocity (20 Hz) beyond which it is not known whether the robot stands.
const VELOCITY_AGE_MAX: Duration = Duration::from_millis(200);

/// Driver of inertial measurement units.
#[derive(Debug)]
pub struct Imus {
    ports: Vec<PortSpec>,
    lines: Vec<LineState>,
    units: Vec<Unit>,
    state: State,
    statistics: Ticker,
    stand: Standstill,
    /// Last result reported to the shell: true if it works.
    working: Option<bool>,
}

/// State of a line or bus, which devices may share.
#[derive(Debug, Default)]
struct LineState {
    /// `None` until the host has reported the port.
    up: Option<bool>,
    /// Units whose transfers are under way, in the order of their requests; at most [`OUTSTANDING`].
    asked: VecDeque<usize>,
}

/// Whether the robot stands.
#[derive(Debug, Default)]
struct Standstill {
    /// When the last velocity came, and since when all of them were zero.
    last: Option<Instant>,
    since: Option<Instant>,
}

/// A device.
#[derive(Debug)]
struct Unit {
    device: Device,
    /// Subject of its faults.
    subject: String,
    place: usize,
    engine: Imu,
    mount: Rotation,
    zero: Zero,
    /// It measures; `None`: not known yet.
    measures: Option<bool>,
    identity: Option<imu::Identity>,
    /// What the engine says, and what the zero says, of its plausibility.
    implausible: bool,
    turns_at_rest: bool,
    /// Bytes of this second.
    bytes: usize,
    rx: Vec<u8>,
}

impl Imus {
    /// Creates the driver, not started yet. Devices beyond [`DEVICES_MAX`], and those whose address is none, are left
    /// out.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let mut ports: Vec<PortSpec> = Vec::new();
        let mut units = Vec::new();
        for device in config.devices.into_iter().take(DEVICES_MAX) {
            let Some(model) = device.model() else { continue };
            let place = ports.iter().position(|port| port.bus == device.bus).unwrap_or(ports.len());
            if place == ports.len() {
                ports.push(PortSpec { bus: device.bus.clone(), line: device.line });
            }
            units.push(Unit::new(device, model, place));
        }
        Self {
            lines: ports.iter().map(|_| LineState::default()).collect(),
            ports,
            units,
            state: State::Init,
            statistics: Ticker::new(Instant::NEVER, BUS_PERIOD),
            stand: Standstill::default(),
            working: None,
        }
    }

    fn on_port(&mut self, now: Instant, port: PortId, input: &Input<'_>, out: &mut Actions) {
        let place = usize::from(port.0);
        let (Some(line), Some(spec)) = (self.lines.get_mut(place), self.ports.get(place)) else { return };
        let bus = spec.bus.as_str();
        let units = self.units.iter_mut().filter(|unit| unit.place == place);
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, bus, format!("{bus} is up"));
                line.up = Some(true);
            }
            Input::Down(why) => {
                out.raise(Severity::Error, Fault::PortDown, bus, format!("{bus} is down: {why}; retrying"));
                *line = LineState { up: Some(false), asked: VecDeque::new() };
                for unit in units {
                    unit.engine.handle_closed(now);
                    unit.measures = Some(false);
                }
            }
            Input::Words(words) if line.up == Some(true) => units.for_each(|unit| unit.on_words(now, words)),
            Input::Can { frame, at } if line.up == Some(true) => units.for_each(|unit| unit.on_frame(*at, frame)),
            Input::I2c(outcome) => {
                if let Some(unit) = line.asked.pop_front().and_then(|unit| self.units.get_mut(unit)) {
                    unit.on_outcome(now, outcome);
                }
            }
            _ => {}
        }
    }

    /// Sends the transfers of the units on I2C, as far as there is room for them.
    fn ask(&mut self, out: &mut Actions) {
        for (n, unit) in self.units.iter_mut().enumerate() {
            let line = &mut self.lines[unit.place];
            if line.up == Some(true)
                && line.asked.len() < OUTSTANDING
                && let Some(transfer) = unit.engine.poll_transfer()
            {
                line.asked.push_back(n);
                out.transfer(PortId(unit.place as u8), transfer);
            }
        }
    }

    /// Reports to the shell whether the module works, if that changed and is known of all units.
    fn report_condition(&mut self, out: &mut Actions) {
        let all = || self.units.iter().map(|unit| unit.measures);
        let works = match all().any(|measures| measures == Some(false)) {
            true => Some(false),
            false => all().all(|measures| measures.is_some()).then_some(true),
        };
        if let Some(working) = works
            && self.working.replace(working) != works
        {
            if working { out.working() } else { out.failed() }
        }
    }
}

impl Standstill {
    fn on_velocity(&mut self, at: Instant, velocity: &DataVelocity) {
        let DataVelocity { vx, vy, omega, .. } = *velocity;
        // Not so of what is unknown.
        let stands = vx.abs() <= STANDS.0 && vy.abs() <= STANDS.0 && omega.abs() <= STANDS.1;
        // After a silence it is not known whether it stood meanwhile.
        let kept = self.since.filter(|_| self.last.is_some_and(|last| at.since(last) <= VELOCITY_AGE_MAX));
        self.since = stands.then(|| kept.unwrap_or(at));
        self.last = Some(at);
    }

    /// True if the robot has stood long enough, and is known to.
    fn holds(&self, now: Instant) -> bool {
        self.last.is_some_and(|last| now.since(last) <= VELOCITY_AGE_MAX)
            && self.since.is_some_and(|since| now.since(since) >= SETTLED)
    }
}

impl Unit {
    fn new(device: Device, model: imu::Model, place: usize) -> Self {
        let ImuKeys { roll, pitch, yaw, .. } = device.keys;
        Self {
            subject: format!("imu.{}", device.name),
            device,
            place,
            engine: Imu::new(model),
            mount: Rotation::from_angles(roll, pitch, yaw),
            zero: Zero::default(),
            measures: None,
            identity: None,
            implausible: false,
            turns_at_rest: false,
            bytes: 0,
            rx: Vec::new(),
        }
    }

    fn on_words(&mut self, now: Instant, words: &[Word]) {
        self.bytes += words.len();
        self.rx.clear();
        self.rx.extend(words.iter().map(|word| word.byte));
        self.engine.handle_rx(now, &self.rx);
    }

    fn on_frame(&mut self, at: Instant, frame: &Frame) {
        self.engine.handle_frame(at, frame);
    }

    fn on_outcome(&mut self, now: Instant, outcome: &Outcome) {
        self.engine.handle_outcome(now, outcome);
    }

    fn serve(&mut self, stands: bool, publishes: bool, out: &mut Actions) {
        while let Some(event) = self.engine.poll_event() {
            let name = &self.device.name;
            match event {
                ImuEvent::Sample(sample) => self.on_sample(&sample, stands, publishes, out),
                ImuEvent::Identity(identity) if self.identity.replace(identity) != Some(identity) => {
                    let imu::Identity { firmware: [upper, lower], bootloader } = identity;
                    out.note(format!("imu {name}: firmware {upper:x}.{lower:02x}, boot loader {bootloader:#04x}"));
                }
                ImuEvent::Identity(_) => {}
                ImuEvent::Fault { fault: ImuFault::Implausible, active } => {
                    self.implausible = active;
                    self.report_plausibility(out);
                }
                ImuEvent::Fault { fault, active } => self.report(fault, active, out),
                ImuEvent::Lost { reason } => {
                    self.measures = Some(false);
                    let message = format!("imu {name} {}: nothing goes by it", why(reason, &self.engine));
                    out.raise(Severity::Error, Fault::ImuLost, self.subject.as_str(), message);
                }
                ImuEvent::Recovered { .. } => {
                    self.measures = Some(true);
                    out.clear(Fault::ImuLost, self.subject.as_str(), format!("imu {name} measures"));
                }
            }
        }
    }

    fn on_sample(&mut self, sample: &Sample, stands: bool, publishes: bool, out: &mut Actions) {
        let rotation = self.mount.apply(sample.rotation_radps);
        let usable = sample.status == Status::Ok;
        if let Some(state) = self.zero.take(sample.at, rotation, stands && usable) {
            self.turns_at_rest = state == ZeroState::Beyond;
            self.report_plausibility(out);
        }
        if publishes {
            let timestamp = out.timestamp(sample.at);
            out.publish(self.message(sample, rotation, timestamp));
        }
    }

    /// `LL_DATA_IMU` of a sample whose rotation is this in the robot frame.
    fn message(&self, sample: &Sample, rotation: [f64; 3], timestamp: i64) -> DataImu {
        let zero = self.zero.value();
        let level = sample.orientation.and_then(Rotation::new).map(|device| device.after(self.mount.inverse()));
        DataImu {
            timestamp,
            name: self.device.name.clone(),
            status: match sample.status {
                Status::Ok if self.turns_at_rest => DataImu::IMPLAUSIBLE,
                Status::Ok if !self.zero.is_known() => DataImu::UNCALIBRATED,
                Status::Ok => DataImu::OK,
                Status::Uncalibrated => DataImu::UNCALIBRATED,
                Status::Implausible => DataImu::IMPLAUSIBLE,
                Status::Fault => DataImu::FAULT,
            },
            acceleration: self.mount.apply(sample.acceleration_mps2),
            rotation: std::array::from_fn(|n| rotation[n] - zero[n]),
            orientation: level.unwrap_or(Rotation::IDENTITY).quaternion(),
            oriented: level.is_some(),
            temperature: sample.temperature_c,
        }
    }

    fn report_plausibility(&self, out: &mut Actions) {
        let (name, subject) = (&self.device.name, self.subject.as_str());
        let what = match (self.implausible, self.turns_at_rest) {
            (true, _) => "it measures what no robot does",
            (false, true) => "it turns while the robot stands",
            (false, false) => return out.clear(Fault::ImuImplausible, subject, format!("imu {name} is plausible")),
        };
        out.raise(Severity::Error, Fault::ImuImplausible, subject, format!("imu {name}: {what}; nothing goes by it"));
    }

    fn report(&self, fault: ImuFault, active: bool, out: &mut Actions) {
        let (number, severity, what) = match fault {
            ImuFault::Noise => (Fault::ImuDisturbed, Severity::Error, "its line is disturbed"),
            ImuFault::Implausible => (Fault::ImuImplausible, Severity::Error, "it measures what no robot does"),
            ImuFault::Frozen => (Fault::ImuFrozen, Severity::Error, "it repeats the same values"),
            ImuFault::Uncalibrated => (Fault::ImuUncalibrated, Severity::Warning, "its gyroscope is not calibrated"),
            ImuFault::Device => (Fault::ImuError, Severity::Error, "it reports an error"),
        };
        let (name, subject) = (&self.device.name, self.subject.as_str());
        if active {
            let code = (fault == ImuFault::Device).then(|| format!(", {}", coded(self.engine.error(), &self.engine)));
            let code = code.unwrap_or_default();
            out.raise(severity, number, subject, format!("imu {name}: {what}{code}; nothing goes by it"));
        } else {
            out.clear(number, subject, format!("imu {name}: not any more: {what}"));
        }
    }

    /// Publishes `LL_DATA_BUS` of its serial line, and begins a new second.
    fn publish_bus(&mut self, now: Instant, up: bool, out: &mut Actions) {
        let Line::Serial { baud } = self.device.line else { return };
        let counters = self.engine.counters();
        let bytes = std::mem::take(&mut self.bytes) as f64;
        out.publish(DataBus {
            timestamp: out.timestamp(now),
            bus: self.device.bus.clone(),
            // A character has ten bits.
            load: (10.0 * bytes / f64::from(baud)).min(1.0),
            frames: i64::from(counters.messages),
            errors: i64::from(counters.rejected) + i64::from(counters.dropped),
            state: if up { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes: Vec::new(),
        });
    }
}

/// A number of an error, and what it means where that is known.
fn coded(code: u8, engine: &Imu) -> String {
    engine.meaning(code).map_or_else(|| format!("code {code}"), |meaning| format!("code {code}, {meaning}"))
}

/// Why it is lost, in words.
fn why(reason: LostReason, engine: &Imu) -> String {
    match reason {
        LostReason::Silent => "is silent".into(),
        LostReason::Garbled => "sends nothing that is valid: wrong model or rate".into(),
        LostReason::Incomplete => "sends no acceleration or no rotation, or restarted".into(),
        LostReason::Identity { chip } => format!("is another chip, {chip:#04x}"),
        LostReason::Device { code } => format!("reports an error, {}, and does not measure", coded(code, engine)),
        LostReason::Closed => "is not connected".into(),
    }
}

impl Module for Imus {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::LlDataVelocity]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.statistics = Ticker::new(now + BUS_PERIOD, BUS_PERIOD),
            Event::Port { port, input } => self.on_port(now, port, &input, out),
            Event::State(state) => self.state = state,
            Event::Message { at, message: Message::LlDataVelocity(velocity), .. } => {
                self.stand.on_velocity(at.min(now), velocity);
            }
            Event::Timer | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        let publishes = !matches!(self.state, State::Stop | State::Terminate);
        let stands = self.stand.holds(now);
        for unit in &mut self.units {
            if self.lines[unit.place].up == Some(true) {
                unit.engine.handle_timeout(now);
            }
            unit.serve(stands, publishes, out);
        }
        self.ask(out);
        if self.statistics.due(now) {
            for unit in &mut self.units {
                unit.publish_bus(now, self.lines[unit.place].up == Some(true), out);
            }
        }
        self.report_condition(out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let up = |unit: &&Unit| self.lines[unit.place].up == Some(true);
        let units = self.units.iter().filter(up).filter_map(|unit| unit.engine.poll_timeout());
        earliest([units.min(), Some(self.statistics.next())])
    }
}

#[cfg(test)]
mod tests;
