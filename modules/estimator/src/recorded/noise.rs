//! Noise of bearings, from the fit of those that the estimate did not depend on.

use crate::filter::{Config, Judged};
use core::f64::consts::TAU;

/// Upper ends of the classes of time between two bearings of a beacon, s.
const LAGS: [f64; 6] = [0.3, 0.75, 1.5, 3.0, 5.0, 8.0];
/// Times for which errors last that are tried, s.
const TIMES: [f64; 7] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0];
/// Least number of bearings that say something.
const ENOUGH: usize = 10;
/// Bounds of the deviation of a bearing, rad, and of the part of outliers.
const BEARING: (f64, f64) = (1e-3, 0.3);
const WILD: (f64, f64) = (0.01, 0.35);
/// Greatest part of the noise that lasts.
const LASTING_MAX: f64 = 0.95;
/// Usual part of the noise that lasts, its time, s, and the number of pairs of bearings that this counts for.
const USUAL: (f64, f64) = (0.8, 3.0);
const USUAL_WEIGHT: f64 = 100.0;
/// Time for which the error of the pose lasts, s.
const POSE_LASTS: f64 = 4.0;
/// Rounds of expectation and maximization.
const ROUNDS: usize = 15;
/// Distance of bearings of a beacon that count for the likelihood, s.
const APART: f64 = 1.0;

/// Probability that a bearing is none of the outliers, and its likelihood relative to uniformly distributed directions.
fn likelihood(config: &Config, judged: &Judged) -> (f64, f64) {
    let variance = config.bearing * config.bearing + judged.spread;
    let density = libm::exp(-0.5 * judged.innovation * judged.innovation / variance) / libm::sqrt(TAU * variance);
    let own = (1.0 - config.wild) * density * TAU;
    (own / (own + config.wild), own + config.wild)
}

/// Log-likelihood of bearings, of each beacon some distance apart.
pub fn evidence(config: &Config, judged: &[Judged]) -> f64 {
    let mut last = vec![None; config.beacons.len()];
    let mut sum = 0.0;
    for one in judged {
        let last = &mut last[one.beacon];
        if last.is_none_or(|last| one.at.since(last).as_secs_f64() >= APART) {
            *last = Some(one.at);
            sum += libm::log(likelihood(config, one).1);
        }
    }
    sum
}

/// Sets the noise of bearings: its deviation, the part of outliers, and how much of it lasts for how long.
pub fn adapt(config: &mut Config, judged: &[Judged]) {
    if judged.len() < ENOUGH {
        return;
    }
    // Expectation and maximization, over the mixture of right bearings and outliers.
    for _ in 0..ROUNDS {
        let variance = config.bearing * config.bearing;
        let (mut sum, mut right, mut weights) = (0.0, 0.0, 0.0);
        for one in judged {
            let inlier = likelihood(config, one).0;
            let part = variance / (variance + one.spread);
            let error = part * one.innovation;
            // Where the pose is uncertain the innovation says little of the bearing.
            let weight = inlier * part;
            sum += weight * (error * error + part * one.spread);
            weights += weight;
            right += inlier;
        }
        config.wild = (1.0 - right / judged.len() as f64).clamp(WILD.0, WILD.1);
        config.bearing = libm::sqrt(sum / f64::max(weights, 1e-9)).clamp(BEARING.0, BEARING.1);
    }
    let whole = config.bearing * config.bearing;
    let classes = covariances(config, judged);
    let mut best = (f64::INFINITY, 0.0, config.lasting_s);
    for time in TIMES {
        let (mut up, mut down) = (0.0, 0.0);
        for (lag, product, weight) in &classes {
            let again = libm::exp(-lag / time);
            up += weight * again * product;
            down += weight * again * again;
        }
        let lasting = (up / f64::max(down, 1e-12)).clamp(0.0, LASTING_MAX * whole);
        let miss = |(lag, product, weight): &(f64, f64, f64)| {
            let miss = product - lasting * libm::exp(-lag / time);
            weight * miss * miss
        };
        let misses = classes.iter().map(miss).sum::<f64>();
        if misses < best.0 {
            best = (misses, lasting, time);
        }
    }
    (config.lasting, config.lasting_s) = (best.1 / whole, best.2);
}

/// Mean product of the errors of two bearings of a beacon, rad², by the time between them: mean time, s, product, and
/// weight.
fn covariances(config: &Config, judged: &[Judged]) -> Vec<(f64, f64, f64)> {
    let variance = config.bearing * config.bearing;
    let mut sums = [(0.0, 0.0, 0.0); LAGS.len()];
    let mut begin = 0.0;
    for (sum, end) in sums.iter_mut().zip(LAGS) {
        let lag = 0.5 * (begin + end);
        let product = USUAL.0 * variance * libm::exp(-lag / USUAL.1);
        *sum = (USUAL_WEIGHT * lag, USUAL_WEIGHT * product, USUAL_WEIGHT);
        begin = end;
    }
    let right: Vec<f64> = judged.iter().map(|one| likelihood(config, one).0).collect();
    for (place, one) in judged.iter().enumerate() {
        for (other, probable) in judged[..place].iter().zip(&right).rev() {
            let lag = one.at.since(other.at).as_secs_f64();
            if lag >= LAGS[LAGS.len() - 1] {
                break;
            }
            if other.beacon == one.beacon && lag > 0.0 {
                let class = LAGS.iter().position(|end| lag < *end).unwrap_or(0);
                let (own, others) = (variance + one.spread, variance + other.spread);
                let weight = right[place] * probable * variance * variance / (own * others);
                let sum = &mut sums[class];
                sum.0 += weight * lag;
                // The error of the pose lasts, too.
                let pose = libm::sqrt(one.spread * other.spread) * libm::exp(-lag / POSE_LASTS);
                sum.1 += weight * (one.innovation * other.innovation - pose);
                sum.2 += weight;
            }
        }
    }
    let means = |(lag, product, weight): &(f64, f64, f64)| (lag / weight, product / weight, *weight);
    sums.iter().map(means).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::Beacon;
    use base::Instant;
    use navitools::Point;

    /// Fits of ten beacons at 5 Hz, whose errors are a first-order process of this time, s, and a part of outliers.
    fn judged(lasting_s: f64, wild: f64) -> Vec<Judged> {
        let mut state = 1u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut errors = [0.0; 10];
        let mut judged = Vec::new();
        for sweep in 0..1000u64 {
            for (beacon, error) in errors.iter_mut().enumerate() {
                let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
                let again = libm::exp(-0.2 / lasting_s);
                *error = again * *error + libm::sqrt(1.0 - again * again) * 0.0255 * normal;
                let innovation = if uniform() < wild { (uniform() - 0.5) * TAU } else { *error };
                let at = Instant::from_millis(1000 + 200 * sweep);
                judged.push(Judged { at, beacon, innovation, spread: 1e-6 });
            }
        }
        judged
    }

    #[test]
    fn noise_that_lasts_and_outliers_are_told_from_each_other() {
        let at = Point { x: 0.0, y: 0.0 };
        let beacons: Vec<Beacon> = (0..10).map(|id| Beacon { id, at }).collect();
        for (lasting_s, wild) in [(1.0, 0.0), (4.0, 0.0), (4.0, 0.2)] {
            let mut config = Config { beacons: beacons.clone(), bearing: 0.01, ..Config::default() };
            adapt(&mut config, &judged(lasting_s, wild));
            assert!((config.bearing / 0.0255 - 1.0).abs() < 0.15, "{lasting_s} s, {wild}: {config:?}");
            assert!((config.wild - wild).abs() < 0.02, "{lasting_s} s, {wild}: {config:?}");
            let sum = config.lasting * config.lasting_s / lasting_s;
            assert!((0.6..1.7).contains(&sum), "{lasting_s} s, {wild}: {config:?}");
        }
    }

    #[test]
    fn too_few_bearings_change_nothing() {
        let before = Config { beacons: vec![Beacon { id: 0, at: Point { x: 0.0, y: 0.0 } }], ..Config::default() };
        let mut after = before.clone();
        adapt(&mut after, &judged(1.0, 0.0)[..ENOUGH - 1]);
        assert_eq!(after, before);
    }
}
