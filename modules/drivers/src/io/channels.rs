//! Channels of the power controller as outputs: `driver_power` is commanded, and publishes what is on.
//!
//! An order is repeated until the channel has obeyed once, one to switch on a few times only: a channel with a short
//! circuit switches itself off before anything is published, and must not be switched on for ever. What changes
//! afterwards without an order of this module, such as a channel that switched itself off at an over-current, or that a
//! person switched, is left as it is.

use super::config::PowerKeys;
use super::signal::{Signal, place};
use base::{Duration, Instant};
use messages::lowlevel::{CmdPower, DataPower};
use module::Actions;
use rs485::boards::psc1::CHANNELS;

/// An order that was not obeyed is repeated after this time: the controller switches one channel after the other.
const REPEAT: Duration = Duration::from_secs(12);

/// Orders to switch on, the first one included, until the output is to be off again.
const ON_ORDERS_MAX: u8 = 3;

/// A channel that is an output.
#[derive(Debug)]
pub(super) struct PowerOutput {
    signal: usize,
    name: &'static str,
    device: i8,
    /// It is on, as reported last; `None` before the first report.
    on: Option<bool>,
    /// What it is to be by the last order, and whether it was that since.
    ordered: Option<(bool, bool)>,
    /// How often that was ordered.
    times: u8,
    /// No order is sent before.
    gate: Instant,
}

impl PowerOutput {
    /// `None` for a channel that the controller does not have.
    pub fn new(keys: &PowerKeys, signals: &[Signal]) -> Option<Self> {
        let device = CHANNELS.iter().position(|name| *name == keys.channel)?;
        let (signal, device) = (place(signals, &keys.name)?, i8::try_from(device).ok()?);
        Some(Self { signal, name: keys.channel, device, on: None, ordered: None, times: 0, gate: Instant::ZERO })
    }

    pub fn on_power(&mut self, now: Instant, power: &DataPower, signals: &mut [Signal]) {
        let Some(channel) = power.channels.iter().find(|channel| channel.name == self.name) else { return };
        self.on = Some(channel.on);
        signals[self.signal].take(now, f64::from(u8::from(channel.on)));
        if let Some((target, obeyed)) = &mut self.ordered {
            *obeyed |= channel.on == *target;
        }
    }

    fn target(&self, signals: &[Signal]) -> bool {
        signals[self.signal].target().is_some_and(|value| value != 0.0)
    }

    /// When an order is due; `None`: none is, or the state of the channel is not known yet.
    pub fn poll_timeout(&self, signals: &[Signal]) -> Option<Instant> {
        self.on?;
        let target = self.target(signals);
        match self.ordered {
            Some((ordered, true)) if ordered == target => None,
            Some((ordered, false)) if ordered == target => (!target || self.times < ON_ORDERS_MAX).then_some(self.gate),
            _ => Some(Instant::ZERO),
        }
    }

    pub fn serve(&mut self, now: Instant, signals: &[Signal], out: &mut Actions) {
        if self.poll_timeout(signals).is_none_or(|due| now < due) {
            return;
        }
        let target = self.target(signals);
        let again = self.ordered.is_some_and(|(ordered, _)| ordered == target);
        self.times = if again { self.times.saturating_add(1) } else { 1 };
        let obeyed = self.on == Some(target) && self.ordered.is_none();
        (self.ordered, self.gate) = (Some((target, obeyed)), now + REPEAT);
        if !obeyed {
            let action = if target { CmdPower::ON } else { CmdPower::OFF };
            out.publish(CmdPower { timestamp: out.timestamp(now), device: self.device, action });
        }
    }
}
