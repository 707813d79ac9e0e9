//! A battery whose values are signals.

use super::config::BatteryKeys;
use super::signal::{Signal, place};
use base::Instant;
use messages::lowlevel::DataBattery;

/// A battery, by the indices of its signals.
#[derive(Debug)]
pub(super) struct Battery {
    name: String,
    voltage: Option<usize>,
    current: Option<usize>,
    charge: Option<usize>,
    health: Option<usize>,
    temperature: Option<usize>,
    charging: Option<usize>,
    cells: Vec<usize>,
}

impl Battery {
    /// `None`: it names a signal that there is not.
    pub fn new(keys: &BatteryKeys, signals: &[Signal]) -> Option<Self> {
        if keys.names().any(|name| place(signals, name).is_none()) {
            return None;
        }
        let of = |name: &Option<String>| name.as_ref().and_then(|name| place(signals, name));
        Some(Self {
            name: keys.name.clone(),
            voltage: of(&keys.voltage),
            current: of(&keys.current),
            charge: of(&keys.charge),
            health: of(&keys.health),
            temperature: of(&keys.temperature),
            charging: of(&keys.charging),
            cells: keys.cells.iter().filter_map(|name| place(signals, name)).collect(),
        })
    }

    pub fn shown(&self, now: Instant, timestamp: i64, signals: &[Signal]) -> DataBattery {
        let value = |n: usize| signals[n].valid(now).unwrap_or(f64::NAN);
        let of = |n: Option<usize>| n.map_or(f64::NAN, value);
        DataBattery {
            timestamp,
            name: self.name.clone(),
            voltage: of(self.voltage),
            current: of(self.current),
            charge: of(self.charge),
            health: of(self.health),
            temperature: of(self.temperature),
            charging: of(self.charging) > 0.0,
            cells: self.cells.iter().map(|n| value(*n)).collect(),
        }
    }
}
