//! Status of the scanner (`get_debug_data`): sweeps, rejected pulses, supply.
//!
//! Rejected pulses are light that is no beacon: sun, lamps, reflections. A board that was reset counts from 0 again.

use crate::rs485_bus::Node;
use base::{Fault, Instant, Severity};
use messages::lowlevel::DataScanner;
use module::Actions;
use rs485::boards::sbs1::Debug;

/// Distance from a limit at which the supply is in its range again, V.
const MARGIN_V: f64 = 0.05;

#[derive(Debug)]
pub(super) struct ScannerStatus {
    name: String,
    /// Limits of the supply, V.
    least: f64,
    greatest: f64,
    last: Option<(Instant, Debug)>,
    rejected: i64,
}

impl ScannerStatus {
    pub(super) fn new(node: &Node) -> Self {
        let (least, greatest) = (node.supply_min_v, node.supply_max_v);
        Self { name: node.name.clone(), least, greatest, last: None, rejected: 0 }
    }

    /// Publishes an answer; true if the board was reset since the previous one.
    pub(super) fn on_debug(&mut self, now: Instant, debug: Debug, out: &mut Actions) -> bool {
        let last = self.last.replace((now, debug));
        let was_reset = last.is_some_and(|(_, before)| debug.sweeps < before.sweeps);
        let rejected = last.map_or(0, |(_, before)| {
            let from = if was_reset { 0 } else { before.rejected_pulses };
            debug.rejected_pulses.wrapping_sub(from)
        });
        self.rejected += i64::from(rejected);
        let elapsed = last.map_or(f64::NAN, |(at, _)| now.since(at).as_secs_f64());
        let supply = f64::from(debug.supply_mv) / 1000.0;
        out.publish(DataScanner {
            timestamp: out.timestamp(now),
            name: self.name.clone(),
            sweeps: debug.sweeps.into(),
            rejected: self.rejected,
            rejected_rate: if elapsed > 0.0 { f64::from(rejected) / elapsed } else { f64::NAN },
            supply,
        });
        self.watch_supply(supply, out);
        was_reset
    }

    fn watch_supply(&self, supply: f64, out: &mut Actions) {
        let Self { name, least, greatest, .. } = self;
        if !(*least..=*greatest).contains(&supply) {
            let message = format!(
                "the supply of {name} is {supply:.2} V, not {least} to {greatest} V: its sightings may be wrong or \
                 absent; check its cable and the power channel sensors"
            );
            out.raise(Severity::Warning, Fault::BoardSupply, name.as_str(), message);
        } else if (least + MARGIN_V..=greatest - MARGIN_V).contains(&supply) {
            out.clear(Fault::BoardSupply, name.as_str(), format!("the supply of {name} is {supply:.2} V"));
        }
    }
}
