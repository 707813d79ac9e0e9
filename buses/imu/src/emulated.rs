//! The other ends of the engines: devices as they answer on the wire, for the simulator and for tests.

use crate::engine::Model;
use crate::{bno055, witmotion, xsens};
use base::can::Frame;
use base::i2c::{Error, Outcome, Transfer};
use base::{Duration, Instant};

/// Period of the samples of all emulated devices.
pub const PERIOD: Duration = Duration::from_millis(10);

/// What a device is exposed to, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Proper acceleration, m/s².
    pub acceleration_mps2: [f64; 3],
    /// Rotation, rad/s.
    pub rotation_radps: [f64; 3],
    /// Quaternion x, y, z, w from the device's frame to a level one.
    pub orientation: [f64; 4],
    /// °C.
    pub temperature_c: f64,
}

impl Default for Truth {
    /// At rest, level, at room temperature.
    fn default() -> Self {
        Self {
            acceleration_mps2: [0.0, 0.0, crate::GRAVITY_MPS2],
            rotation_radps: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            temperature_c: 25.0,
        }
    }
}

/// What is wrong with a device or its line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// Its line is cut.
    pub cut: bool,
    /// It has no supply; when that comes back, it starts anew.
    pub unpowered: bool,
    /// Bytes of a million that are wrong on a serial line, or refused on I2C; frames of a million that lack a byte on
    /// CAN.
    pub noise_ppm: u32,
    /// Bits of a million that are wrong, at most 100,000: on a serial line the start bit of each byte included; on CAN
    /// a frame with such a bit lacks a byte, as if its interface passed it on instead of having it sent again. Not on
    /// I2C.
    pub wrong_bits_ppm: u32,
    /// Bytes of 1000 on a serial line that are lost.
    pub lost_per_mille: u16,
    /// Bytes of 1000 on a serial line that are followed by another one.
    pub added_per_mille: u16,
    /// These bits of all bytes that are read or received are always set.
    pub stuck_bits: u8,
    /// All bytes that are read or received become this one.
    pub constant: Option<u8>,
    /// The line has another bit rate than the engine: a serial line garbles all, a CAN bus carries nothing.
    pub wrong_baud: bool,
    /// Only the first half of each packet, reading or frame's data arrives.
    pub halves: bool,
    /// The first half of the last packet or frame's data is sent for ever, at the rate of the samples.
    pub half_for_ever: bool,
    /// I2C: each transfer fails by this.
    pub bus: Option<Error>,
    /// I2C: it has fallen back to its state at power-on, and whatever is written to it is lost.
    pub reset: bool,
    /// CAN: its frames are remote frames.
    pub remote: bool,
    /// CAN: its identifiers are extended ones.
    pub extended: bool,
    /// It sends no acceleration; that of a BNO055 is 0.
    pub without_acceleration: bool,
    /// It sends no rotation; that of a BNO055 is 0.
    pub without_rotation: bool,
    /// Its acceleration is at the end of the range.
    pub saturated_acceleration: bool,
    /// Its rotation is at the end of the range.
    pub saturated_rotation: bool,
    /// It repeats the last measurement.
    pub frozen: bool,
    /// Its gyroscope has lost its calibration; only a BNO055 says so.
    pub uncalibrated: bool,
    /// It reports an error of its own; a WitMotion cannot.
    pub error: bool,
    /// Another device is in its place: on I2C with another identifier, elsewhere its messages are unknown.
    pub stranger: bool,
    /// Its acceleration is this many times the truth, less 1.
    pub acceleration_excess: f64,
}

impl Faults {
    /// What becomes of a byte that is read or received.
    pub(crate) fn received(&self, byte: u8) -> u8 {
        self.constant.unwrap_or(byte | self.stuck_bits)
    }
}

/// State that all devices have.
#[derive(Debug)]
pub(crate) struct Body {
    pub truth: Truth,
    pub faults: Faults,
    /// What was measured last, which is repeated while it is frozen.
    measured: Truth,
    /// When it measures next; `None`: not started.
    next: Option<Instant>,
    random: u64,
}

impl Body {
    pub fn new() -> Self {
        Self {
            truth: Truth::default(),
            faults: Faults::default(),
            measured: Truth::default(),
            next: None,
            random: 0x9E37_79B9_7F4A_7C15,
        }
    }

    /// True with this probability, in parts per million.
    pub fn chance(&mut self, ppm: u32) -> bool {
        // xorshift64
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        let random = self.random >> 16;
        // The thousands first: what happens by whole parts per mille does not depend on the finer digits.
        random % 1000 * 1000 + random / 1000 % 1000 < u64::from(ppm)
    }

    /// A number below this one.
    pub fn below(&mut self, count: u64) -> u64 {
        self.chance(0);
        (self.random >> 16) % count
    }

    /// What is measured now.
    pub fn measure(&mut self) -> Truth {
        if !self.faults.frozen {
            let excess = 1.0 + self.faults.acceleration_excess;
            let mut measured = self.truth;
            measured.acceleration_mps2.iter_mut().for_each(|value| *value *= excess);
            if self.faults.saturated_acceleration {
                // Beyond all digits.
                measured.acceleration_mps2[0] = 1e6;
            }
            if self.faults.saturated_rotation {
                measured.rotation_radps[2] = 1e6;
            }
            self.measured = measured;
        }
        self.measured
    }

    /// True if a sample is due; what was missed is left out.
    fn due(&mut self, now: Instant) -> bool {
        if self.faults.unpowered {
            self.next = None;
            return false;
        }
        let next = *self.next.get_or_insert(now + PERIOD);
        if next > now {
            return false;
        }
        self.next = Some(next.next_on_grid(now, PERIOD));
        true
    }
}

/// A value in digits, as far as they go.
pub(crate) fn digits(value: f64, digit: f64) -> i16 {
    libm::round(value / digit) as i16
}

#[derive(Debug)]
enum Device {
    Bno055(bno055::emulated::Chip),
    WitMotion(witmotion::emulated::Sender),
    Xsens(xsens::emulated::Sender),
}

/// An emulated device.
#[derive(Debug)]
pub struct Emulated {
    body: Body,
    device: Device,
}

impl Emulated {
    /// A device at power-on.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let device = match model {
            Model::Bno055 { address } => Device::Bno055(bno055::emulated::Chip::new(address)),
            Model::WitMotion => Device::WitMotion(witmotion::emulated::Sender::default()),
            Model::Xsens => Device::Xsens(xsens::emulated::Sender::default()),
        };
        Self { body: Body::new(), device }
    }

    /// What it is exposed to from now on.
    pub fn set(&mut self, truth: Truth) {
        self.body.truth = truth;
    }

    /// What is wrong with it.
    pub fn faults(&mut self) -> &mut Faults {
        &mut self.body.faults
    }

    /// Lets it measure.
    pub fn handle_timeout(&mut self, now: Instant) {
        let due = self.body.due(now);
        match &mut self.device {
            Device::Bno055(chip) => chip.handle_timeout(now, due, &mut self.body),
            Device::WitMotion(sender) if due => sender.send(&mut self.body),
            Device::Xsens(sender) if due => sender.send(&mut self.body),
            Device::WitMotion(_) | Device::Xsens(_) => {}
        }
    }

    /// When it measures next.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        (!self.body.faults.unpowered).then(|| self.body.next.unwrap_or(Instant::ZERO))
    }

    /// Bytes that it sends on its serial line, at once; returns their number.
    pub fn poll_tx(&mut self, bytes: &mut [u8]) -> usize {
        match &mut self.device {
            Device::WitMotion(sender) => sender.poll(bytes),
            Device::Bno055(_) | Device::Xsens(_) => 0,
        }
    }

    /// The next frame that it sends on its CAN bus.
    pub fn poll_frame(&mut self) -> Option<Frame> {
        match &mut self.device {
            Device::Xsens(sender) => sender.poll(),
            Device::Bno055(_) | Device::WitMotion(_) => None,
        }
    }

    /// Outcome of a transfer on its I2C bus.
    pub fn handle_transfer(&mut self, now: Instant, transfer: &Transfer) -> Outcome {
        match &mut self.device {
            Device::Bno055(chip) => chip.answer(now, transfer, &mut self.body),
            Device::WitMotion(_) | Device::Xsens(_) => Err(Error::NoAddress),
        }
    }
}
