//! Building blocks of standard messages.

use std::collections::BTreeMap;

use lcm_gen::cdr::Writer;

use super::standard::Standard;
use super::topics::{Sink, Topics};

/// Colour: red, green, blue, opacity, 0..1.
pub type Color = [f32; 4];

/// Position and heading in the plane: m, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position, x, m.
    pub x: f64,
    /// Position, y, m.
    pub y: f64,
    /// Heading, counter-clockwise from x, rad.
    pub theta: f64,
}

impl Pose {
    /// True if all values are finite: viewers fail on others.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.theta.is_finite()
    }
}

/// Destination of standard messages.
pub struct To<'a, 's> {
    pub topics: &'a mut Topics,
    pub buffer: &'a mut Vec<u8>,
    pub sink: &'a mut Sink<'s>,
    /// Poses of the sensors on the robot, by their frames, where these are sent as in [`Self::mount`].
    pub mounted: Option<&'a mut BTreeMap<String, Pose>>,
}

impl To<'_, '_> {
    /// Sends one message, whose fields `write` writes, unless there are too many topics.
    pub fn send(&mut self, topic: &str, ty: Standard, write: impl FnOnce(&mut Fields<'_>)) {
        let Some(id) = self.topics.standard(topic, ty) else { return };
        write(&mut Fields::new(self.buffer));
        (self.sink)(self.topics.get(id), self.buffer);
    }

    /// Sends the poses of sensors on the robot. For a log: as they are, each second. For a live network: all together,
    /// when one has changed, because who comes later gets the last message.
    pub fn mount(&mut self, timestamp: i64, frames: &[(String, Pose)]) {
        let Some(mounted) = &mut self.mounted else {
            return self.transforms("/tf", timestamp, frames);
        };
        let mut has_changed = false;
        for (frame, pose) in frames {
            has_changed |= mounted.insert(frame.clone(), *pose) != Some(*pose);
        }
        if has_changed {
            let all: Vec<_> = mounted.iter().map(|(frame, pose)| (frame.clone(), *pose)).collect();
            self.transforms("/tf_static", timestamp, &all);
        }
    }

    fn transforms(&mut self, topic: &str, timestamp: i64, frames: &[(String, Pose)]) {
        self.send(topic, Standard::Transforms, |fields| {
            fields.to.count(frames.len());
            for (frame, pose) in frames {
                fields.transform(timestamp, "base_link", frame, *pose);
            }
        });
    }
}

/// Writer for the fields of a message, in the order of its type.
#[derive(Debug)]
pub struct Fields<'a> {
    /// Writer of single values.
    pub to: Writer<'a>,
}

impl<'a> Fields<'a> {
    /// Begins a message in `buffer`, which is emptied.
    pub fn new(buffer: &'a mut Vec<u8>) -> Self {
        buffer.clear();
        Self { to: Writer::new(buffer) }
    }

    /// `builtin_interfaces/Time` from µs since the epoch, saturated to its range.
    pub fn time(&mut self, timestamp: i64) {
        let seconds = timestamp.div_euclid(1_000_000);
        let micros = u32::try_from(timestamp.rem_euclid(1_000_000)).unwrap_or_default();
        let (seconds, nanos) = match i32::try_from(seconds) {
            Ok(seconds) => (seconds, micros * 1000),
            Err(_) if seconds < 0 => (i32::MIN, 0),
            Err(_) => (i32::MAX, 999_999_999),
        };
        self.to.i32(seconds);
        self.to.u32(nanos);
    }

    /// `std_msgs/Header`.
    pub fn header(&mut self, timestamp: i64, frame: &str) {
        self.time(timestamp);
        self.to.string(frame);
    }

    /// `geometry_msgs/Point` or `Vector3`.
    pub fn vector(&mut self, x: f64, y: f64, z: f64) {
        [x, y, z].into_iter().for_each(|number| self.to.f64(number));
    }

    /// `geometry_msgs/Quaternion` of a rotation about the vertical.
    pub fn turn(&mut self, theta: f64) {
        let (sin, cos) = libm::sincos(theta / 2.0);
        [0.0, 0.0, sin, cos].into_iter().for_each(|number| self.to.f64(number));
    }

    /// `geometry_msgs/Pose`; also `Transform`, which has the same fields under other names.
    pub fn pose(&mut self, pose: Pose) {
        self.vector(pose.x, pose.y, 0.0);
        self.turn(pose.theta);
    }

    /// Covariance of x, y, theta within that of x, y, z and the rotations about them.
    pub fn covariance(&mut self, covariance: &[[f64; 3]; 3]) {
        const PLACES: [Option<usize>; 6] = [Some(0), Some(1), None, None, None, Some(2)];
        for row in PLACES {
            for column in PLACES {
                self.to.f64(row.zip(column).map_or(0.0, |(row, column)| covariance[row][column]));
            }
        }
    }

    /// `geometry_msgs/TransformStamped`: pose of `child` in `parent`.
    pub fn transform(&mut self, timestamp: i64, parent: &str, child: &str, pose: Pose) {
        self.header(timestamp, parent);
        self.to.string(child);
        self.pose(pose);
    }

    /// `std_msgs/ColorRGBA`.
    pub fn color(&mut self, color: Color) {
        color.into_iter().for_each(|part| self.to.f32(part));
    }

    /// `diagnostic_msgs/DiagnosticStatus`.
    pub fn status(&mut self, level: u8, name: &str, message: &str, hardware: &str, values: &[(&str, String)]) {
        self.to.u8(level);
        self.to.string(name);
        self.to.string(message);
        self.to.string(hardware);
        self.to.count(values.len());
        for (key, value) in values {
            self.to.string(key);
            self.to.string(value);
        }
    }
}
