//! What the emulated devices have in common: their surroundings, their faults, and the line to the engine.
//!
//! A device is at `ld::emulated`, `rplidar::emulated`, `ydlidar::emulated`, `sick::emulated` and `hokuyo::emulated`. It
//! is fed bytes and time, and drained of the bytes that the line carries by then.

mod line;

pub use line::Line;

use crate::scan::turn;
use base::Instant;
use core::f64::consts::TAU;

/// Directions of a [`Scene`].
pub const DIRECTIONS: usize = 720;

/// What surrounds the device: ranges in m, in equal steps counter-clockwise from its front; infinite: nothing.
#[derive(Clone, Debug)]
pub struct Scene(pub [f32; DIRECTIONS]);

impl Default for Scene {
    /// A round wall at 3 m.
    fn default() -> Self {
        Self([3.0; DIRECTIONS])
    }
}

/// Directions of a [`Scene`] that a device measures whose head turns clockwise from one angle to another one, rad; as
/// [`Device::measures`] returns them.
pub(crate) fn swept(from_rad: f64, to_rad: f64) -> (usize, usize) {
    let per_rad = DIRECTIONS as f64 / TAU;
    // One more at each end, whatever the rounding.
    let count = libm::ceil((to_rad - from_rad).max(0.0) * per_rad) as usize + 3;
    let first = libm::floor(turn(-to_rad) * per_rad) as usize + DIRECTIONS - 1;
    if count < DIRECTIONS { (first % DIRECTIONS, count) } else { (0, DIRECTIONS) }
}

impl Scene {
    /// Range in a direction, rad counter-clockwise.
    #[must_use]
    pub fn range_m(&self, angle_rad: f64) -> f32 {
        let part = turn(angle_rad) / TAU;
        self.0[libm::round(part * DIRECTIONS as f64) as usize % DIRECTIONS]
    }
}

/// What is wrong with the device or its line. A device ignores what it cannot have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// The device has no supply: it forgets its state, and nothing passes.
    pub unpowered: bool,
    /// The line is cut: nothing passes either way, and the device goes on.
    pub cut: bool,
    /// Nothing reaches the engine.
    pub mute: bool,
    /// Nothing reaches the device.
    pub deaf: bool,
    /// Of a million bytes to the engine, this many have a wrong bit.
    pub noise_ppm: u32,
    /// Of a million bits to the engine, this many are wrong, the start bit of each byte included; at most 100,000.
    pub wrong_bits_ppm: u32,
    /// Of 1000 bytes to the engine, this many are lost.
    pub lost_per_mille: u16,
    /// Of 1000 bytes to the engine, this many are followed by another one.
    pub added_per_mille: u16,
    /// These bits are always set.
    pub stuck_bits: u8,
    /// All bytes become this one.
    pub constant: Option<u8>,
    /// The line has another bit rate than the engine.
    pub wrong_baud: bool,
    /// The line holds bytes back; at the end of the fault they arrive all at once.
    pub held_back: bool,
    /// The first half of the last message is sent for ever.
    pub half_for_ever: bool,
    /// The last message is sent for ever.
    pub repeats: bool,
    /// Only the first half of each message is sent.
    pub halves: bool,
    /// The line carries a tenth of its bytes.
    pub slow_line: bool,
    /// The device hangs: it takes and sends nothing, and its clock goes on.
    pub hangs: bool,
    /// The motor stands.
    pub motor_stopped: bool,
    /// The motor turns at half its speed.
    pub motor_slow: bool,
    /// The optics are dirty: the device warns, and measures.
    pub dirty: bool,
    /// The optics are too dirty to measure.
    pub blocked: bool,
    /// The device reports an error.
    pub error: bool,
    /// The device refuses every request that it can refuse.
    pub refuses: bool,
    /// The device is another model.
    pub stranger: bool,
}

/// The other end of the line, the same for all devices.
pub trait Device {
    /// What is wrong with it.
    fn faults(&mut self) -> &mut Faults;
    /// What surrounds it.
    fn scene(&mut self) -> &mut Scene;
    /// Directions of the scene that [`Self::handle_timeout`] may measure in any call up to `until`, whatever the faults
    /// are meanwhile: the first one, and their number from there on counter-clockwise. The scene need not be right
    /// elsewhere until then. All, where a device does not know better.
    fn measures(&self, _until: Instant) -> (usize, usize) {
        (0, DIRECTIONS)
    }
    /// Takes bytes from the line.
    fn handle_rx(&mut self, now: Instant, bytes: &[u8]);
    /// Turns the motor, and measures. Late and needless calls do no harm.
    fn handle_timeout(&mut self, now: Instant);
    /// Bytes that the line has carried by `now`; returns their number.
    fn poll_tx(&mut self, now: Instant, bytes: &mut [u8]) -> usize;
    /// Instant of the next [`Self::handle_timeout`] and [`Self::poll_tx`].
    fn poll_timeout(&self) -> Option<Instant>;
}
