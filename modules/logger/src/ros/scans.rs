//! `LL_DATA_SCAN` as `sensor_msgs/LaserScan`: the sectors of a revolution, put together in the order in which they were
//! measured. A lidar that turns clockwise has a negative `angle_increment`. What a lidar with a fault did not receive
//! is not measured there (NaN): `LaserScan` has no status, and to its readers `+inf` is free.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use messages::lowlevel::DataScan;

use super::standard::Standard;
use super::write::{Pose, To};

/// Lidars with topics at most.
const LIDARS_MAX: usize = 64;
/// Longest name of a lidar with a topic, bytes.
const NAME_BYTES_MAX: usize = 64;
/// Beams of a revolution at most: more than any lidar has.
const BEAMS_MAX: f64 = 16_384.0;
/// Share of the beams of a revolution by which two in succession differ that have the same directions.
const EVEN: f64 = 0.02;
/// Period at which the mounting is repeated: µs.
const MOUNTING_PERIOD_US: u64 = 1_000_000;

/// Lidars by name.
#[derive(Clone, Debug, Default)]
pub struct Scans(BTreeMap<String, Lidar>);

#[derive(Clone, Debug)]
struct Lidar {
    topic: String,
    frame: String,
    /// Directions of the last revolution.
    grid: Option<Grid>,
    /// The present revolution.
    turn: Option<Turn>,
    /// Timestamp of the last mounting.
    shown: Option<i64>,
}

/// Directions of the beams of a revolution: as long as the motor turns evenly, those of the revolution before, since
/// readers expect as many beams of each as of the first one. A beam goes to the nearest direction.
#[derive(Clone, Copy, Debug)]
struct Grid {
    angle_min: f64,
    angle_step: f64,
    /// Beams of a whole turn.
    count: usize,
}

/// A revolution, as far as it has arrived.
#[derive(Clone, Debug)]
struct Turn {
    number: i64,
    timestamp: i64,
    grid: Grid,
    beam_time: f64,
    limits: [f32; 2],
    ranges: Vec<f32>,
    /// Of the beams, or none.
    intensities: Vec<f32>,
    /// Place of the last beam, and one.
    used: usize,
}

impl Scans {
    /// A sector. A revolution is sent when the next one begins.
    pub fn translate(&mut self, scan: &DataScan, to: &mut To<'_, '_>) {
        if !self.0.contains_key(&scan.name) {
            if self.0.len() == LIDARS_MAX || scan.name.len() > NAME_BYTES_MAX {
                return to.topics.leave_out();
            }
            let (topic, frame) = (format!("/scan/{}", word(&scan.name)), lidar_frame(&scan.name));
            self.0.insert(scan.name.clone(), Lidar { topic, frame, grid: None, turn: None, shown: None });
        }
        let Some(lidar) = self.0.get_mut(&scan.name) else { return };
        if lidar.turn.as_ref().is_none_or(|turn| turn.number != scan.revolution) {
            if let Some(whole) = lidar.turn.take() {
                whole.send(lidar, scan.timestamp, to);
            }
            lidar.grid = Grid::of(scan).map(|grid| grid.or(lidar.grid));
            lidar.turn = lidar.grid.map(|grid| Turn::new(scan, grid));
            lidar.show(scan, to);
        }
        if let Some(turn) = &mut lidar.turn {
            turn.add(scan);
        }
    }
}

/// Frame of a lidar that is called so.
#[must_use]
pub fn lidar_frame(name: &str) -> String {
    format!("lidar_{}", word(name))
}

/// A name as a part of those of ROS.
fn word(name: &str) -> String {
    name.chars().map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '_' }).collect()
}

impl Lidar {
    /// Where it sits, once a second.
    fn show(&mut self, scan: &DataScan, to: &mut To<'_, '_>) {
        let place = Pose { x: scan.x, y: scan.y, theta: scan.theta };
        let is_due = self.shown.is_none_or(|shown| shown.abs_diff(scan.timestamp) >= MOUNTING_PERIOD_US);
        if is_due && place.is_finite() {
            self.shown = Some(scan.timestamp);
            to.mount(scan.timestamp, &[(self.frame.clone(), place)]);
        }
    }
}

impl Grid {
    /// Directions of the revolution that a sector begins; `None` if its angles are none.
    fn of(scan: &DataScan) -> Option<Self> {
        let &DataScan { angle_min, angle_step, .. } = scan;
        let count = TAU / angle_step.abs();
        let is_one = angle_min.is_finite() && (1.0..=BEAMS_MAX).contains(&count);
        is_one.then(|| Self { angle_min, angle_step, count: count.round() as usize })
    }

    /// The directions before, if these are about the same.
    fn or(self, before: Option<Self>) -> Self {
        let same = |before: &Self| {
            let shift = (self.angle_min - before.angle_min).rem_euclid(TAU);
            self.angle_step.signum() == before.angle_step.signum()
                && self.count.abs_diff(before.count) as f64 <= EVEN * before.count as f64
                && shift.min(TAU - shift) <= 1.5 * before.angle_step.abs()
        };
        before.filter(same).unwrap_or(self)
    }

    /// Place of a direction.
    fn place(&self, angle: f64) -> usize {
        let ahead = (angle - self.angle_min) * self.angle_step.signum();
        (ahead.rem_euclid(TAU) / self.angle_step.abs()).round() as usize % self.count
    }
}

impl Turn {
    /// The revolution that a sector begins.
    fn new(scan: &DataScan, grid: Grid) -> Self {
        Self {
            number: scan.revolution,
            timestamp: scan.timestamp,
            grid,
            beam_time: scan.beam_time,
            limits: [scan.range_min, scan.range_max],
            ranges: vec![f32::NAN; grid.count],
            intensities: Vec::new(),
            used: 0,
        }
    }

    fn add(&mut self, scan: &DataScan) {
        let count = self.ranges.len();
        if scan.intensities.len() == scan.ranges.len() && !scan.ranges.is_empty() {
            self.intensities.resize(count, 0.0);
        }
        for (k, range) in scan.ranges.iter().enumerate().take(count) {
            let place = self.grid.place(scan.angle_min + k as f64 * scan.angle_step);
            self.used = self.used.max(place + 1);
            let range = if *range == f32::INFINITY && scan.status != DataScan::OK { f32::NAN } else { *range };
            // The nearer of two.
            if self.ranges[place].is_nan() || range < self.ranges[place] {
                self.ranges[place] = range;
                if let (Some(to), Some(from)) = (self.intensities.get_mut(place), scan.intensities.get(k)) {
                    *to = *from;
                }
            }
        }
    }

    fn send(&self, lidar: &Lidar, next: i64, to: &mut To<'_, '_>) {
        let Grid { angle_min, angle_step, count } = self.grid;
        // A revolution that lacks a beam or two has them, too: not measured.
        let is_whole = self.used as f64 >= (1.0 - EVEN) * count as f64;
        let used = if is_whole { count } else { self.used.max(1) };
        let angle_max = angle_min + (used - 1) as f64 * angle_step;
        let scan_time = next.saturating_sub(self.timestamp) as f64 / 1e6;
        to.send(&lidar.topic, Standard::LaserScan, |fields| {
            fields.header(self.timestamp, &lidar.frame);
            for number in [angle_min, angle_max, angle_step, self.beam_time, scan_time] {
                fields.to.f32(number as f32);
            }
            self.limits.into_iter().for_each(|limit| fields.to.f32(limit));
            for list in [&self.ranges, &self.intensities] {
                let list = &list[..used.min(list.len())];
                fields.to.count(list.len());
                list.iter().for_each(|number| fields.to.f32(*number));
            }
        });
    }
}
