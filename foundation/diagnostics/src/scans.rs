//! What lidars see, as points around the robot: of each lidar its last whole revolution.

use crate::{Shown, Slot};
use base::{Duration, Instant};
use messages::lowlevel::DataScan;
use serde::Serialize;
use std::mem;

/// Lidars that are shown at most.
const LIDARS_MAX: usize = 16;
/// Points of a revolution that are shown at most; of more, each second one or fewer.
const POINTS_MAX: usize = 720;
/// Points of a revolution that are kept until it is whole.
const KEPT_MAX: usize = 8192;
/// Longest period of a revolution.
const TURN: Duration = Duration::from_millis(200);

/// What a lidar has seen in its last whole revolution.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scan {
    /// Its name.
    pub name: String,
    /// State of the lidar: one of the constants of `LL_DATA_SCAN`.
    pub status: i8,
    /// Where its beams met something, robot frame: forward, m, to the centimetre; at most 720.
    pub x: Vec<f64>,
    /// To the left, m; as many.
    pub y: Vec<f64>,
}

/// All of them, in the order in which they came.
#[derive(Clone, Debug, Default)]
pub struct Scans(Vec<Lidar>);

#[derive(Clone, Debug)]
struct Lidar {
    name: String,
    revolution: i64,
    points: Vec<(f64, f64)>,
    whole: Slot<Scan>,
}

impl Scans {
    /// A part of a revolution.
    pub fn on_scan(&mut self, at: Instant, scan: &DataScan) {
        if self.0.len() < LIDARS_MAX && self.0.iter().all(|lidar| lidar.name != scan.name) {
            let (name, revolution) = (scan.name.clone(), scan.revolution);
            self.0.push(Lidar { name, revolution, points: Vec::new(), whole: Slot::every(TURN) });
        }
        let Some(lidar) = self.0.iter_mut().find(|lidar| lidar.name == scan.name) else { return };
        if mem::replace(&mut lidar.revolution, scan.revolution) != scan.revolution {
            lidar.end(at, scan.status);
        }
        for (k, range) in scan.ranges.iter().map(|range| f64::from(*range)).enumerate() {
            let (sin, cos) = libm::sincos(scan.theta + scan.angle_min + k as f64 * scan.angle_step);
            let (x, y) = (scan.x + range * cos, scan.y + range * sin);
            if range > 0.0 && x.is_finite() && y.is_finite() && lidar.points.len() < KEPT_MAX {
                lidar.points.push((x, y));
            }
        }
    }

    /// What each has seen.
    pub fn shown(&self, now: Instant) -> Vec<Shown<'_, Scan>> {
        self.0.iter().map(|lidar| lidar.whole.shown(now)).collect()
    }
}

impl Lidar {
    fn end(&mut self, at: Instant, status: i8) {
        let every = self.points.len().div_ceil(POINTS_MAX).max(1);
        let rounded = |number: f64| libm::round(100.0 * number) / 100.0;
        let (x, y) = self.points.drain(..).step_by(every).map(|(x, y)| (rounded(x), rounded(y))).unzip();
        self.whole.put(at, Scan { name: self.name.clone(), status, x, y });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sector(name: &str, revolution: i64, ranges: Vec<f32>) -> DataScan {
        DataScan { name: name.into(), revolution, x: 0.5, angle_step: 0.5, ranges, ..DataScan::default() }
    }

    #[test]
    fn a_revolution_is_shown_when_the_next_one_begins() {
        let (mut scans, now) = (Scans::default(), Instant::from_millis(1000));
        scans.on_scan(now, &sector("front", 1, vec![2.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY]));
        scans.on_scan(now, &sector("front", 1, vec![1.0]));
        assert_eq!(scans.shown(now)[0].value, None);
        scans.on_scan(now, &DataScan { status: DataScan::SLOW, ..sector("front", 2, vec![9.0]) });
        let expected = Scan { name: "front".into(), status: DataScan::SLOW, x: vec![2.5, 1.5], y: vec![0.0; 2] };
        assert_eq!(scans.shown(now)[0].value, Some(&expected));
    }

    #[test]
    fn neither_lidars_nor_points_are_without_end() {
        let (mut scans, now) = (Scans::default(), Instant::from_millis(1000));
        for n in 0..100 {
            scans.on_scan(now, &sector(&n.to_string(), 1, vec![1.0]));
        }
        assert_eq!(scans.shown(now).len(), LIDARS_MAX);
        for _ in 0..10 {
            scans.on_scan(now, &sector("0", 2, vec![1.0; 5000]));
        }
        scans.on_scan(now, &sector("0", 3, vec![1.0]));
        let shown = scans.shown(now)[0].value.map(|scan| (scan.x.len(), scan.y.len()));
        assert!(matches!(shown, Some((x, y)) if x == y && x <= POINTS_MAX), "{shown:?}");
    }
}
