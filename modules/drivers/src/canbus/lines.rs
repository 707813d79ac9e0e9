//! Drives on serial lines: a VESC on a UART, which turns one wheel, or a RoboClaw, which turns two.
//!
//! Device    facts in `motorctl::vesc`, `motorctl::roboclaw`; one for each line
//! Timing    set-points and questions every 20 ms, a quick stop at once
//! Silence   of the device for 80 ms: lost, all others stop. A port that is closed is a lost drive at once

use super::keys::axis_of;
use super::line_keys::LineConfig;
use super::{Config, ConfigError};
use base::serial::Word;
use base::{Fault, Instant, Severity};
use messages::lowlevel::{DataBus, Node};
use module::{Actions, PortId};
use motorctl::serial::{AXES_MAX, Bytes, OnSerial};
use motorctl::{CommandError, Event, Feedback, ReleaseError, State};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// Bits of a byte on the wire.
const BITS_PER_BYTE: f64 = 10.0;
/// Events that wait for a wheel, at most; an engine has two of them in a second.
const EVENTS: usize = 8;

/// An engine, and what each wheel wants of it.
struct Shared {
    engine: OnSerial,
    channels: [ChannelState; AXES_MAX],
    count: usize,
}

#[derive(Default)]
struct ChannelState {
    /// rad/s.
    velocity: f64,
    /// It wants the quick stop, which is one of all axes.
    stops: bool,
    events: VecDeque<Event>,
}

/// The device of a line.
#[derive(Clone)]
pub(super) struct LineEngine(Rc<RefCell<Shared>>);

/// One axis of the device of a line, for the controller of a wheel.
pub(super) struct Channel {
    line: LineEngine,
    /// Number of the line.
    pub(super) number: usize,
    axis: usize,
}

impl LineEngine {
    pub(super) fn new(own: &LineConfig, config: &Config) -> Result<Self, ConfigError> {
        let Some(&(first, _)) = own.motors.first() else { return Err(ConfigError::NoMotor) };
        let axis = |(_, gear): &(_, f64)| axis_of(*gear, config.wheel_circumference, &config.limits);
        let axes: Vec<motorctl::Axis> = own.motors.iter().map(axis).collect();
        let second_way = config.stop.has_second_way(config.has_pause_line);
        let engine = OnSerial::new(&axes, second_way, own.device);
        let engine = engine.map_err(|error| ConfigError::Controller { axis: first, error })?;
        let shared = Shared { engine, channels: Default::default(), count: axes.len().min(AXES_MAX) };
        Ok(Self(Rc::new(RefCell::new(shared))))
    }

    /// The axis of this number, of the line of this number.
    pub(super) fn channel(&self, number: usize, axis: usize) -> Channel {
        Channel { line: self.clone(), number, axis }
    }

    /// Bytes that arrived.
    pub(super) fn handle_rx(&self, now: Instant, bytes: &[u8]) {
        let mut shared = self.0.borrow_mut();
        shared.engine.handle_rx(now, bytes);
        shared.distribute();
    }

    pub(super) fn poll_tx(&self, now: Instant) -> Option<Bytes> {
        self.0.borrow_mut().engine.poll_tx(now)
    }

    /// Inputs that the protocol does not allow.
    fn rejected(&self) -> u32 {
        self.0.borrow().engine.rejected()
    }
}

impl Shared {
    /// Each wheel gets every event.
    fn distribute(&mut self) {
        while let Some(event) = self.engine.poll_event() {
            for channel in self.channels.iter_mut().take(self.count) {
                if channel.events.len() >= EVENTS {
                    channel.events.pop_front();
                }
                channel.events.push_back(event.clone());
            }
        }
    }
}

impl Channel {
    fn with<T>(&self, then: impl FnOnce(&mut Shared, usize) -> T) -> T {
        then(&mut self.line.0.borrow_mut(), self.axis)
    }

    pub(super) fn restart(&mut self, now: Instant) {
        self.with(|shared, _| shared.engine.restart(now));
    }

    pub(super) fn disarm(&mut self, now: Instant) {
        self.with(|shared, _| shared.engine.disarm(now));
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        self.with(|shared, _| {
            shared.engine.handle_timeout(now);
            shared.distribute();
        });
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.with(|shared, _| shared.engine.poll_timeout())
    }

    pub(super) fn poll_event(&mut self) -> Option<Event> {
        self.with(|shared, axis| shared.channels[axis].events.pop_front())
    }

    pub(super) fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        self.line.poll_tx(now)
    }

    pub(super) fn state(&self) -> State {
        self.with(|shared, _| shared.engine.state())
    }

    pub(super) fn feedback(&self) -> Option<Feedback> {
        self.with(|shared, axis| shared.engine.feedback(axis).copied())
    }

    /// The device takes the velocities of all axes at once: that of another one is its last.
    pub(super) fn command(&mut self, now: Instant, velocity_radps: f64) -> Result<(), CommandError> {
        self.with(|shared, axis| {
            shared.channels[axis].velocity = velocity_radps;
            let velocities = shared.channels.each_ref().map(|own| own.velocity);
            shared.engine.command(now, &velocities[..shared.count])
        })
    }

    pub(super) fn quick_stop(&mut self) {
        self.with(|shared, axis| {
            shared.channels[axis].stops = true;
            shared.channels[axis].velocity = 0.0;
            shared.engine.quick_stop();
        });
    }

    pub(super) fn is_quick_stop(&self) -> bool {
        self.with(|shared, _| shared.engine.is_quick_stop())
    }

    /// It ends when no wheel of the device wants it any more.
    pub(super) fn release(&mut self, now: Instant) -> Result<(), ReleaseError> {
        self.with(|shared, axis| {
            shared.channels[axis].stops = false;
            if shared.channels.iter().any(|own| own.stops) {
                return Err(ReleaseError::Moving);
            }
            shared.engine.release(now)
        })
    }
}

/// The port of a line.
pub(super) struct LinePort {
    pub(super) name: String,
    pub(super) port: PortId,
    baud: u32,
    engine: LineEngine,
    up: bool,
    /// Packets sent and pieces received, since the start.
    frames: i64,
    /// Of this second.
    bytes: usize,
    rx: Vec<u8>,
}

impl LinePort {
    pub(super) fn new(own: &LineConfig, engine: LineEngine, port: PortId) -> Self {
        let (name, baud) = (own.bus.clone(), own.baud);
        Self { name, port, baud, engine, up: false, frames: 0, bytes: 0, rx: Vec::new() }
    }

    pub(super) fn is_up(&self) -> bool {
        self.up
    }

    pub(super) fn on_port(&mut self, down: Option<&str>, out: &mut Actions) {
        let name = self.name.as_str();
        self.up = down.is_none();
        match down {
            Some(why) => {
                out.raise(Severity::Error, Fault::PortDown, name, format!("{name} is down: {why}; tried again"));
            }
            None => out.clear(Fault::PortDown, name, format!("{name} is up")),
        }
    }

    /// Received words.
    pub(super) fn on_words(&mut self, now: Instant, words: &[Word]) {
        self.count(words.len());
        self.rx.clear();
        self.rx.extend(words.iter().map(|word| word.byte));
        self.engine.handle_rx(now, &self.rx);
    }

    /// Sends what waits; a line that is down takes nothing.
    pub(super) fn send(&mut self, now: Instant, out: &mut Actions) {
        while let Some(bytes) = self.engine.poll_tx(now).filter(|_| self.up) {
            self.count(bytes.len());
            let words: Vec<Word> = bytes.iter().copied().map(Word::data).collect();
            out.send_words(self.port, &words);
        }
    }

    fn count(&mut self, bytes: usize) {
        self.frames = self.frames.saturating_add(1);
        self.bytes = self.bytes.saturating_add(bytes);
    }

    /// `LL_DATA_BUS` with these nodes; starts a new second.
    pub(super) fn message(&mut self, timestamp: i64, nodes: Vec<Node>) -> DataBus {
        let bytes = std::mem::take(&mut self.bytes) as f64;
        DataBus {
            timestamp,
            bus: self.name.clone(),
            load: (BITS_PER_BYTE * bytes / f64::from(self.baud.max(1))).min(1.0),
            frames: self.frames,
            errors: self.engine.rejected().into(),
            state: if self.up { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes,
        }
    }
}
