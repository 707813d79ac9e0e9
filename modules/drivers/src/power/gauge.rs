//! Battery charge: counted ampere-hours, corrected by the rest voltage where that is significant.
//!
//! The curve of LiFeYPO4 is flat in the middle, 0.1 V over 60 % (`docs/facts/robot.md` 2.4): below 15 % and above 95 %
//! the voltage gives the charge, between them only the count does. At the start there is only the voltage.

use base::{Duration, Instant};

/// Rest voltage of a cell, V, by charge (`docs/facts/robot.md` 2.4).
const REST_VOLTAGE: [(f64, f64); 13] = [
    (2.50, 0.00),
    (2.95, 0.05),
    (3.10, 0.10),
    (3.20, 0.20),
    (3.23, 0.30),
    (3.25, 0.40),
    (3.26, 0.50),
    (3.28, 0.60),
    (3.30, 0.70),
    (3.32, 0.80),
    (3.34, 0.90),
    (3.36, 0.95),
    (3.40, 1.00),
];
/// Charges below and above which the voltage is significant.
const LOW_CHARGE: f64 = 0.15;
const HIGH_CHARGE: f64 = 0.95;
/// Resistance of a cell, and of the wiring, ohm.
const RESISTANCE_OHM: (f64, f64) = (0.0012, 0.008);
/// At rest: the current is below this fraction of the capacity per hour for [`REST_TIME`].
const REST_RATE: f64 = 0.25;
const REST_TIME: Duration = Duration::from_secs(30);
/// Time constant of the correction to the rest voltage.
const CORRECTION: Duration = Duration::from_secs(60);
/// Time constant of the mean load.
const MEAN_TIME: Duration = Duration::from_secs(60);
/// Maximum interval between two measurements over which the charge is integrated.
const GAP_MAX: Duration = Duration::from_secs(10);
/// Load below which the remaining time is unknown, A.
const IDLE_A: f64 = 0.1;

/// Battery gauge.
#[derive(Debug)]
pub(super) struct Gauge {
    capacity_ah: f64,
    cells: f64,
    /// `None` before the first measurement.
    charge: Option<f64>,
    at: Instant,
    load: f64,
    resting_since: Option<Instant>,
}

impl Gauge {
    pub fn new(capacity_ah: f64, cells: u8) -> Self {
        let cells = f64::from(cells);
        Self { capacity_ah, cells, charge: None, at: Instant::ZERO, load: 0.0, resting_since: None }
    }

    /// Adds a measurement of the whole battery, V and A. A second one at the same time is ignored.
    pub fn measured(&mut self, now: Instant, volts: f64, amperes: f64) {
        let by_voltage = self.by_voltage(volts, amperes);
        let Some(charge) = self.charge else {
            (self.charge, self.at, self.load) = (Some(by_voltage), now, amperes);
            return;
        };
        let passed = now.since(self.at);
        self.at = now;
        if passed > GAP_MAX {
            self.resting_since = None;
            return;
        }
        let seconds = passed.as_secs_f64();
        self.load += (amperes - self.load) * (seconds / MEAN_TIME.as_secs_f64()).min(1.0);
        let mut charge = charge - amperes * seconds / 3600.0 / self.capacity_ah;
        if amperes > REST_RATE * self.capacity_ah {
            self.resting_since = None;
        } else if now.since(*self.resting_since.get_or_insert(now)) >= REST_TIME
            && !(LOW_CHARGE..=HIGH_CHARGE).contains(&by_voltage)
        {
            charge += (by_voltage - charge) * (seconds / CORRECTION.as_secs_f64()).min(1.0);
        }
        self.charge = Some(charge.clamp(0.0, 1.0));
    }

    /// Charge, 0..=1; NaN before the first measurement.
    pub fn charge(&self) -> f64 {
        self.charge.unwrap_or(f64::NAN)
    }

    /// Time until empty at the mean load, s; NaN if unknown.
    pub fn remaining(&self) -> f64 {
        if self.load < IDLE_A { f64::NAN } else { self.charge() * self.capacity_ah * 3600.0 / self.load }
    }

    fn by_voltage(&self, volts: f64, amperes: f64) -> f64 {
        let cell = (volts + amperes * (RESISTANCE_OHM.0 * self.cells + RESISTANCE_OHM.1)) / self.cells;
        let segment =
            REST_VOLTAGE.windows(2).find(|pair| cell <= pair[1].0).unwrap_or(&REST_VOLTAGE[REST_VOLTAGE.len() - 2..]);
        let [(v0, c0), (v1, c1)] = [segment[0], segment[1]];
        c0 + (c1 - c0) * ((cell - v0) / (v1 - v0)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn s(seconds: u64) -> Instant {
        Instant::ZERO + Duration::from_secs(seconds)
    }

    /// Measurements each second at constant load and voltage.
    fn run(gauge: &mut Gauge, from: u64, to: u64, volts: f64, amperes: f64) {
        (from..to).for_each(|second| gauge.measured(s(second), volts, amperes));
    }

    #[test]
    fn ampere_hours_are_counted_where_the_voltage_is_flat() {
        let mut gauge = Gauge::new(40.0, 8);
        assert!(gauge.charge().is_nan() && gauge.remaining().is_nan());
        gauge.measured(s(0), 26.4, 0.0);
        assert!((gauge.charge() - 0.7).abs() < 1e-9, "3.30 V a cell: {}", gauge.charge());
        // 8 A for an hour are 20 % of 40 Ah, whatever the voltage.
        run(&mut gauge, 1, 3602, 26.0, 8.0);
        assert!((gauge.charge() - 0.5).abs() < 0.001, "{}", gauge.charge());
        assert!((gauge.remaining() - 0.5 * 40.0 / 8.0 * 3600.0).abs() < 30.0, "{}", gauge.remaining());
    }

    #[test]
    fn at_rest_the_voltage_corrects_the_count_at_both_ends_only() {
        let full = |volts: f64, amperes: f64| {
            let mut gauge = Gauge::new(40.0, 8);
            gauge.measured(s(0), 26.4, 0.0);
            run(&mut gauge, 1, 600, volts, amperes);
            gauge.charge()
        };
        assert!(full(27.2, 0.0) > 0.99, "3.40 V a cell: full");
        assert!(full(22.0, 0.0) < 0.06, "2.75 V a cell: nearly empty");
        assert!((full(26.0, 0.0) - 0.7).abs() < 1e-9, "3.25 V a cell may be anything");
        assert!((full(27.2, 12.0) - (0.7 - 12.0 * 599.0 / 3600.0 / 40.0)).abs() < 1e-9, "not under load");
    }

    #[test]
    fn the_voltage_drop_under_load_is_compensated() {
        let mut gauge = Gauge::new(40.0, 8);
        gauge.measured(s(0), 26.4 - 10.0 * 0.0176, 10.0);
        assert!((gauge.charge() - 0.7).abs() < 1e-9);
    }

    #[test]
    fn a_gap_is_not_counted_and_nothing_leaves_0_to_1() {
        let mut gauge = Gauge::new(40.0, 8);
        gauge.measured(s(0), 26.4, 0.0);
        gauge.measured(s(7200), 26.4, 20.0);
        assert!((gauge.charge() - 0.7).abs() < 1e-9);
        run(&mut gauge, 7201, 9_000, 20.0, 400.0);
        assert_eq!(gauge.charge(), 0.0);
        run(&mut gauge, 9_000, 9_300, 40.0, 0.0);
        assert!(gauge.charge() > 0.98 && gauge.charge() <= 1.0, "{}", gauge.charge());
    }
}
