//! Switches on the 1-Wire bus as signals: DS2413, two channels each, an open drain and its pin.
//!
//! An output writes its latch, an input leaves it open and reads the pin. Both channels of a switch are written, and
//! read, at once. The bus is shared with thermometers, whose measurements take most of a second.

use super::config::{Config, SwitchKeys};
use super::signal::{Signal, place};
use base::w1::{Answer, Error, Request, Rom};
use base::{Duration, Fault, Instant, Severity};
use module::{Actions, Input, PortId};

/// Period in which a switch is read, and written, beside each change of an output.
const PERIOD: Duration = Duration::from_millis(500);
/// A switch that fails is tried again after this time.
const RETRY: Duration = Duration::from_secs(1);
/// Failures in a row from which on it counts as lost.
const FAILURES_MAX: u8 = 3;

/// All switches of the bus.
#[derive(Debug)]
pub(super) struct Switches {
    port: PortId,
    bus: String,
    /// `None` until the host has reported the port.
    up: Option<bool>,
    /// The switch that is asked.
    asked: Option<usize>,
    all: Vec<Switch>,
}

#[derive(Debug)]
struct Switch {
    rom: Rom,
    channels: [Option<Channel>; 2],
    /// Latches that were written last.
    written: Option<u8>,
    failures: u8,
    /// It has answered.
    known: bool,
    due: Instant,
}

/// A channel that is a signal.
#[derive(Clone, Copy, Debug)]
struct Channel {
    signal: usize,
    output: bool,
    active_low: bool,
}

impl Switches {
    /// `None` without any.
    pub fn new(config: &Config, port: PortId, signals: &[Signal]) -> Option<Self> {
        let mut all: Vec<Switch> = Vec::new();
        for keys in &config.switches {
            let SwitchKeys { rom, channel, output, active_low, .. } = *keys;
            // It is one of the signals, which were made of the same configuration.
            let signal = place(signals, &keys.name).unwrap_or_default();
            let n = all.iter().position(|switch| switch.rom == rom).unwrap_or_else(|| {
                let (channels, due) = ([None; 2], Instant::ZERO);
                all.push(Switch { rom, channels, written: None, failures: 0, known: false, due });
                all.len() - 1
            });
            all[n].channels[usize::from(channel & 1)] = Some(Channel { signal, output, active_low });
        }
        let bus = config.w1_bus.clone();
        (!all.is_empty()).then_some(Self { port, bus, up: None, asked: None, all })
    }

    pub fn port(&self) -> PortId {
        self.port
    }

    /// True if all answer; `None` until that is known.
    pub fn works(&self) -> Option<bool> {
        match self.up {
            Some(true) if self.all.iter().any(|switch| switch.failures >= FAILURES_MAX) => Some(false),
            Some(true) => self.all.iter().all(|switch| switch.known).then_some(true),
            other => other,
        }
    }

    /// True if all outputs have what they should, or cannot be reached.
    pub fn is_settled(&self, signals: &[Signal]) -> bool {
        let settled = |switch: &Switch| {
            switch.failures > 0 || !switch.has_outputs() || switch.written == Some(switch.latches(signals))
        };
        self.up != Some(true) || self.asked.is_none() && self.all.iter().all(settled)
    }

    pub fn on_port(&mut self, now: Instant, input: &Input<'_>, signals: &mut [Signal], out: &mut Actions) {
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, self.bus.as_str(), format!("{} is up", self.bus));
                (self.up, self.asked) = (Some(true), None);
                self.all.iter_mut().for_each(|switch| (switch.written, switch.due) = (None, now));
            }
            Input::Down(why) => {
                let message = format!("{} is down: {why}; retrying", self.bus);
                out.raise(Severity::Error, Fault::PortDown, self.bus.as_str(), message);
                (self.up, self.asked) = (Some(false), None);
            }
            Input::OneWire(Answer::Switch(rom, answer)) => {
                if let Some(switch) = self.asked.and_then(|n| self.all.get_mut(n)).filter(|own| own.rom == *rom) {
                    self.asked = None;
                    switch.on_answer(now, *answer, &self.bus, signals, out);
                }
            }
            _ => {}
        }
    }

    /// The switch that is next, and when.
    fn next(&self, signals: &[Signal], reads: bool) -> Option<(Instant, usize)> {
        if self.up != Some(true) || self.asked.is_some() {
            return None;
        }
        let all = self.all.iter().enumerate();
        all.filter_map(|(n, switch)| Some((switch.deadline(signals, reads)?, n))).min()
    }

    pub fn serve(&mut self, now: Instant, signals: &[Signal], reads: bool, out: &mut Actions) {
        let Some((_, n)) = self.next(signals, reads).filter(|(due, _)| *due <= now) else { return };
        let switch = &mut self.all[n];
        let latches = switch.latches(signals);
        let request = match switch.has_outputs() {
            true => Request::Write(switch.rom, latches),
            false => Request::Read(switch.rom),
        };
        (switch.written, switch.due) = (Some(latches), now + PERIOD);
        self.asked = Some(n);
        out.ask_w1(self.port, request);
    }

    pub fn poll_timeout(&self, signals: &[Signal], reads: bool) -> Option<Instant> {
        self.next(signals, reads).map(|(due, _)| due)
    }
}

impl Switch {
    fn has_outputs(&self) -> bool {
        self.channels.iter().flatten().any(|channel| channel.output)
    }

    /// What its latches should be: 1 does not conduct.
    fn latches(&self, signals: &[Signal]) -> u8 {
        let open = |channel: &Option<Channel>| {
            let output = channel.as_ref().filter(|channel| channel.output);
            output.is_none_or(|channel| {
                let on = signals[channel.signal].target().is_some_and(|value| value != 0.0);
                on == channel.active_low
            })
        };
        u8::from(open(&self.channels[0])) | u8::from(open(&self.channels[1])) << 1
    }

    fn deadline(&self, signals: &[Signal], reads: bool) -> Option<Instant> {
        if !self.has_outputs() && !reads {
            return None;
        }
        // One that fails waits for its turn.
        let changed = self.has_outputs() && self.failures == 0 && self.written != Some(self.latches(signals));
        Some(if changed { Instant::ZERO } else { self.due })
    }

    fn on_answer(
        &mut self,
        now: Instant,
        answer: Result<u8, Error>,
        bus: &str,
        signals: &mut [Signal],
        out: &mut Actions,
    ) {
        let subject = format!("{bus} {}", self.rom);
        match answer {
            Ok(state) => {
                (self.failures, self.known) = (0, true);
                out.clear(Fault::IoDeviceLost, subject.as_str(), format!("{subject} answers again"));
                for (n, channel) in self.channels.iter().enumerate() {
                    let Some(channel) = channel else { continue };
                    let (pin, latch) = (state >> (2 * n) & 1 == 1, state >> (2 * n + 1) & 1 == 1);
                    // An output is on while it conducts, an input while its pin is high.
                    let on = if channel.output { !latch } else { pin };
                    signals[channel.signal].take(now, f64::from(u8::from(on != channel.active_low)));
                }
            }
            Err(error) => {
                self.failures = self.failures.saturating_add(1);
                (self.written, self.due) = (None, now + RETRY);
                if self.failures >= FAILURES_MAX {
                    let message = format!("{subject}: {error}; asked once a second");
                    out.raise(Severity::Error, Fault::IoDeviceLost, subject, message);
                }
            }
        }
    }
}
