//! Signals of CANopen devices: `driver_canbus` reads and writes them, since it is the master of their bus. Their values
//! come by `LL_DATA_NODE_IO`, what outputs are to have leaves by `LL_CMD_NODE_IO`, in [`PERIOD`] and when it changes.

use super::canopen::Canopen;
use super::signal::{Signal, place};
use base::{Duration, Instant};
use messages::lowlevel::{CmdNodeIo, DataNodeIo, NodeTarget};
use module::Actions;

/// Longest period of `LL_CMD_NODE_IO`; `driver_canbus` gives outputs their safe values if it is missing for 1 s.
const PERIOD: Duration = Duration::from_millis(200);

/// Signals of all devices.
#[derive(Debug)]
pub(super) struct Devices {
    /// Indices of their signals, in order.
    signals: Vec<usize>,
    outputs: Vec<usize>,
    /// What was published last.
    ordered: Vec<f64>,
    due: Instant,
}

impl Devices {
    /// `None`: there are no such devices.
    pub fn new(devices: &[Canopen], signals: &[Signal]) -> Option<Self> {
        let names = devices.iter().flat_map(|device| &device.keys.signals);
        let mut all: Vec<usize> = names.filter_map(|keys| place(signals, &keys.name)).collect();
        all.sort_unstable();
        let outputs = all.iter().copied().filter(|n| signals[*n].output.is_some()).collect();
        (!all.is_empty()).then_some(Self { signals: all, outputs, ordered: Vec::new(), due: Instant::ZERO })
    }

    /// Takes the values, received at `at`; what is no signal of a device is ignored.
    pub fn on_values(&self, at: Instant, message: &DataNodeIo, signals: &mut [Signal]) {
        for value in &message.values {
            let own = place(signals, &value.name).filter(|n| self.signals.binary_search(n).is_ok());
            match own.map(|n| &mut signals[n]) {
                Some(signal) if value.value.is_finite() => signal.take(at, value.value),
                Some(signal) => signal.lose(),
                None => {}
            }
        }
    }

    /// Publishes what outputs are to have.
    pub fn serve(&mut self, now: Instant, signals: &[Signal], out: &mut Actions) {
        let targets = || self.outputs.iter().filter_map(|n| signals[*n].target());
        if self.outputs.is_empty() || now < self.due && targets().eq(self.ordered.iter().copied()) {
            return;
        }
        self.due = now + PERIOD;
        self.ordered = targets().collect();
        let names = self.outputs.iter().map(|n| &signals[*n].name);
        let outputs = names.zip(&self.ordered);
        let outputs = outputs.map(|(name, target)| NodeTarget { name: name.clone(), target: *target }).collect();
        out.publish(CmdNodeIo { timestamp: out.timestamp(now), outputs });
    }

    /// True if all outputs that can be reached have been confirmed as they should be.
    pub fn is_settled(&self, now: Instant, signals: &[Signal]) -> bool {
        let settled = |signal: &Signal| signal.valid(now).is_none_or(|value| Some(value) == signal.target());
        self.outputs.iter().all(|n| settled(&signals[*n]))
    }

    /// When it publishes again.
    pub fn poll_timeout(&self) -> Option<Instant> {
        (!self.outputs.is_empty()).then_some(self.due)
    }
}
