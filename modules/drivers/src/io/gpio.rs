//! A GPIO line of the computer as a signal.

use super::config::Gpio;
use super::signal::{Signal, place};
use base::gpio::Signal as Wire;
use base::{Duration, Fault, Instant, Severity};
use module::{Action, Actions, Input, Output, PortId};

/// Period in which a line is read, beside its events, and an output is written.
const PERIOD: Duration = Duration::from_millis(500);
/// The same of an input that stops the robot.
const STOP_PERIOD: Duration = Duration::from_millis(100);
/// Older values are not valid.
pub(super) const AGE_MAX: Duration = Duration::from_millis(1500);

/// A line.
#[derive(Debug)]
pub(super) struct GpioLine {
    port: PortId,
    bus: String,
    signal: usize,
    /// `None` until the host has reported the port.
    up: Option<bool>,
    /// A call of the chip is under way.
    asked: bool,
    /// Level that was written last.
    sent: Option<bool>,
    period: Duration,
    due: Instant,
}

impl GpioLine {
    /// `stops`: it stops the robot.
    pub fn new(config: &Gpio, port: PortId, signals: &[Signal], stops: bool) -> Self {
        let period = if stops { STOP_PERIOD } else { PERIOD };
        // It is one of the signals, which were made of the same configuration.
        let signal = place(signals, &config.keys.name).unwrap_or_default();
        Self { port, bus: config.bus.clone(), signal, up: None, asked: false, sent: None, period, due: Instant::ZERO }
    }

    pub fn works(&self) -> Option<bool> {
        self.up
    }

    fn target(&self, signals: &[Signal]) -> Option<bool> {
        signals[self.signal].target().map(|value| value != 0.0)
    }

    /// True if the line has the level that it should, or cannot be reached.
    pub fn is_settled(&self, signals: &[Signal]) -> bool {
        self.up != Some(true) || self.target(signals).is_none_or(|level| self.sent == Some(level) && !self.asked)
    }

    pub fn on_port(&mut self, now: Instant, input: &Input<'_>, signals: &mut [Signal], out: &mut Actions) {
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, self.bus.as_str(), format!("{} is up", self.bus));
                (self.up, self.asked, self.sent, self.due) = (Some(true), false, None, now);
            }
            Input::Down(why) => {
                let message = format!("{} is down: {why}; retrying", self.bus);
                out.raise(Severity::Error, Fault::PortDown, self.bus.as_str(), message);
                (self.up, self.asked) = (Some(false), false);
            }
            Input::Gpio(Wire::Level(level)) => {
                self.asked = false;
                signals[self.signal].take(now, f64::from(u8::from(*level)));
            }
            _ => {}
        }
    }

    fn deadline(&self, signals: &[Signal], reads: bool) -> Option<Instant> {
        let target = self.target(signals);
        if self.up != Some(true) || self.asked || target.is_none() && !reads {
            return None;
        }
        Some(if target.is_some() && target != self.sent { Instant::ZERO } else { self.due })
    }

    pub fn serve(&mut self, now: Instant, signals: &[Signal], reads: bool, out: &mut Actions) {
        if self.deadline(signals, reads).is_some_and(|due| due <= now) {
            let target = self.target(signals);
            let wire = target.map_or(Wire::Read, Wire::Level);
            out.push(Action::Send(self.port, Output::Gpio(wire)));
            (self.asked, self.sent, self.due) = (true, target, now + self.period);
        }
    }

    pub fn poll_timeout(&self, signals: &[Signal], reads: bool) -> Option<Instant> {
        self.deadline(signals, reads)
    }
}
