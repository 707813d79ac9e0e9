//! The battery behind the PSC1 and what hangs on its channels (docs/facts/robot.md 1.2, 2.4).

use super::psc1::MOTORS;
use crate::scene::Scene;
use base::{Duration, Instant};
use rs485::boards::psc1::{CHANNELS, Currents};

/// Rest voltage of a LiFeYPO4 cell over its charge (docs/facts/robot.md 2.4).
const REST: [(f64, f64); 13] = [
    (0.00, 2.50),
    (0.05, 2.95),
    (0.10, 3.10),
    (0.20, 3.20),
    (0.30, 3.23),
    (0.40, 3.25),
    (0.50, 3.26),
    (0.60, 3.28),
    (0.70, 3.30),
    (0.80, 3.32),
    (0.90, 3.34),
    (0.95, 3.36),
    (1.00, 3.40),
];
/// Resistance of a cell, and of the wiring, ohm.
const RESISTANCE: (f64, f64) = (0.0012, 0.008);
/// A cell is empty below this, V, for [`EMPTY_FOR`].
const EMPTY: f64 = 2.5;
const EMPTY_FOR: Duration = Duration::from_millis(1500);
/// Power of each channel, W: 35 of electronics, 60 of two computers, 45 of the monitor, 10 of audio and fans.
const LOADS: [f64; CHANNELS.len()] = [5.0, 35.0, 25.0, 3.0, 45.0, 10.0, 20.0, 7.0];
/// Current of a device with a defect, A.
const OVERLOAD_A: f64 = 12.0;
/// Efficiency of gear and motor.
const EFFICIENCY: f64 = 0.83;
/// Deviation of a current sensor, A.
const SENSOR: f64 = 0.01;

/// The battery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryConfig {
    /// Ampere-hours when full.
    pub capacity_ah: f64,
    /// In series.
    pub cells: u8,
    /// 0..=1, at the start.
    pub charge: f64,
}

impl Default for BatteryConfig {
    /// Advee's, not fresh from the charger.
    fn default() -> Self {
        Self { capacity_ah: 40.0, cells: 8, charge: 0.9 }
    }
}

/// The battery, and its loads.
#[derive(Debug)]
pub struct Battery {
    config: BatteryConfig,
    charge: f64,
    at: Instant,
    /// Forced rest voltage, V, and its end.
    forced: (f64, Instant),
    /// A channel that draws [`OVERLOAD_A`] more, and until when.
    overload: (u8, Instant),
    empty_since: Option<Instant>,
}

impl Battery {
    /// Makes a battery as configured.
    #[must_use]
    pub fn new(config: BatteryConfig, at: Instant) -> Self {
        Self {
            config,
            charge: config.charge,
            at,
            forced: (0.0, Instant::ZERO),
            overload: (0, Instant::ZERO),
            empty_since: None,
        }
    }

    /// Forces this rest voltage until an instant, V.
    pub fn force(&mut self, volts: f64, until: Instant) {
        self.forced = (volts, until);
    }

    /// A channel draws 12 A more until an instant.
    pub fn overload(&mut self, channel: u8, until: Instant) {
        self.overload = (channel, until);
    }

    /// Takes what has been drawn since the last call, at the load of now.
    pub fn pass(&mut self, now: Instant, on: u8, scene: &Scene) {
        let hours = now.since(self.at).as_secs_f64() / 3600.0;
        self.at = now;
        let drawn: f64 = self.amperes(now, on, scene).iter().sum();
        self.charge = (self.charge - drawn * hours / self.config.capacity_ah).max(0.0);
    }

    /// Measurements of the board.
    #[must_use]
    pub fn measure(&self, now: Instant, on: u8, scene: &Scene) -> Currents {
        let amperes = self.amperes(now, on, scene);
        let mut random = scene.random(0x40 << 56 | now.as_nanos());
        // Saturates: a sensor cannot report negative values.
        let milliamps = amperes.map(|amperes| libm::round((amperes + SENSOR * random.normal()) * 1000.0) as u16);
        let volts = self.volts(now, amperes.iter().sum());
        Currents { milliamps, battery_mv: libm::round(volts * 1000.0) as u16 }
    }

    /// True if it has been below what its cells may have for a while; to be asked regularly.
    pub fn is_empty(&mut self, now: Instant, on: u8, scene: &Scene) -> bool {
        let volts = self.volts(now, self.amperes(now, on, scene).iter().sum());
        if volts >= EMPTY * f64::from(self.config.cells) {
            self.empty_since = None;
            return false;
        }
        now.since(*self.empty_since.get_or_insert(now)) >= EMPTY_FOR
    }

    /// Under a load.
    fn volts(&self, now: Instant, amperes: f64) -> f64 {
        let cells = f64::from(self.config.cells);
        (self.rest(now) - amperes * (RESISTANCE.0 * cells + RESISTANCE.1)).max(0.0)
    }

    fn rest(&self, now: Instant) -> f64 {
        match self.forced {
            (volts, until) if until > now => volts,
            _ => cell(self.charge) * f64::from(self.config.cells),
        }
    }

    fn amperes(&self, now: Instant, on: u8, scene: &Scene) -> [f64; CHANNELS.len()] {
        let body = scene.body();
        // What braking gives back is burnt.
        let motion = body.power().max(0.0) / EFFICIENCY;
        let volts = self.rest(now).max(1.0);
        std::array::from_fn(|channel| {
            let motion = if channel == usize::from(MOTORS) { motion } else { 0.0 };
            let overload = channel == usize::from(self.overload.0) && now < self.overload.1;
            let more = if overload { OVERLOAD_A } else { 0.0 };
            if on & 1 << channel == 0 { 0.0 } else { (LOADS[channel] + motion) / volts + more }
        })
    }
}

/// A cell's rest voltage at a charge, V.
fn cell(charge: f64) -> f64 {
    let segment = REST.windows(2).find(|pair| charge <= pair[1].0).unwrap_or(&REST[REST.len() - 2..]);
    let [(c0, v0), (c1, v1)] = [segment[0], segment[1]];
    v0 + (v1 - v0) * ((charge - c0) / (c1 - c0)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Parameters;
    use crate::sonar::Sonar;
    use crate::world::World;

    fn scene() -> Scene {
        Scene::new(Instant::ZERO, World::default(), Parameters::default(), Sonar::default(), 1)
    }

    #[test]
    fn a_pack_has_the_voltages_of_the_facts() {
        let pack = |charge| 8.0 * cell(charge);
        assert_eq!((pack(0.0), pack(1.0)), (20.0, 27.2));
        assert!((pack(0.75) - 26.48).abs() < 1e-9 && (pack(2.0) - 27.2).abs() < 1e-9);
    }

    #[test]
    fn a_standing_robot_empties_it_in_the_hours_that_its_loads_say() {
        let (scene, mut battery) = (scene(), Battery::new(BatteryConfig::default(), Instant::ZERO));
        let mut minutes = 0;
        while battery.charge > 0.1 {
            minutes += 1;
            battery.pass(Instant::ZERO + Duration::from_secs(60 * minutes), 0xFF, &scene);
        }
        // 80 % of 40 Ah at 150 W and 26 V.
        let expected = 0.8 * 40.0 * 26.0 / 150.0 * 60.0;
        assert!((minutes as f64 - expected).abs() < 0.02 * expected, "{minutes} min");
    }

    #[test]
    fn it_sags_under_load() {
        let (scene, battery) = (scene(), Battery::new(BatteryConfig::default(), Instant::ZERO));
        let [all, none] = [0xFF, 0].map(|on| battery.measure(Instant::ZERO, on, &scene).battery_mv);
        assert_eq!(none, 26_720);
        // 150 W make 5.6 A, in 17.6 mohm.
        assert_eq!(none - all, 99);
    }
}
