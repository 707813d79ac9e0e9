//! Capsules: blocks of samples with a checksum.
//!
//! A capsule has the angle of its first sample; that of the others follows from the next capsule. So a capsule is
//! decoded when the next one has arrived, but for an express or dense one whose motor turns steadily ([`ahead`]).

use super::Mode;
use core::f64::consts::TAU;
use heapless::Vec;

/// Longest capsule, bytes.
pub const LENGTH_MAX: usize = 132;
/// Most samples of a capsule.
pub const SAMPLES_MAX: usize = 96;
/// Bytes of a capsule.
pub type Capsule = Vec<u8, LENGTH_MAX>;

/// A sample: angle in rad clockwise from the front, range in mm; 0: no echo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    pub angle_rad: f64,
    pub range_mm: f32,
}

/// Length of a capsule and its number of samples; none for single samples.
pub fn shape(mode: Mode) -> Option<(usize, usize)> {
    match mode {
        Mode::Standard => None,
        Mode::Express => Some((84, 32)),
        Mode::Ultra => Some((132, 96)),
        Mode::Dense => Some((84, 40)),
    }
}

/// True if these bytes may begin a capsule.
pub fn may_begin(bytes: &[u8]) -> bool {
    bytes.first().is_none_or(|byte| byte >> 4 == 0xA) && bytes.get(1).is_none_or(|byte| byte >> 4 == 0x5)
}

/// True if the checksum of a whole capsule is right.
pub fn is_valid(bytes: &[u8]) -> bool {
    let [low, high, rest @ ..] = bytes else { return false };
    may_begin(bytes) && rest.iter().fold(0, |sum, byte| sum ^ byte) == (low & 0xF | high << 4)
}

/// Sets header and checksum.
pub fn seal(bytes: &mut [u8]) {
    let sum = bytes[2..].iter().fold(0, |sum, byte| sum ^ byte);
    (bytes[0], bytes[1]) = (0xA0 | sum & 0xF, 0x50 | sum >> 4);
}

fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

/// Angle of the first sample, 1/64°.
pub fn start_q6(bytes: &[u8]) -> u16 {
    word(bytes, 2) & 0x7FFF
}

/// True for the first capsule after a start.
pub fn is_first(bytes: &[u8]) -> bool {
    word(bytes, 2) & 0x8000 != 0
}

/// From the first sample of a capsule to that of the next, 1/64°, below a turn.
pub fn advance_q6(bytes: &[u8], next: &[u8]) -> u32 {
    const TURN: u32 = 360 * 64;
    (TURN + u32::from(start_q6(next)) % TURN - u32::from(start_q6(bytes)) % TURN) % TURN
}

/// Value of 12 bits whose scale grows with it, and the scale's exponent (`sl_lidar_cmd.h`, variable bit scale).
fn expand(scaled: u32) -> (i32, u32) {
    const STEPS: [(u32, u32, u32); 5] =
        [(3328, 1 << 14, 4), (1792, 1 << 12, 3), (1280, 1 << 11, 2), (512, 512, 1), (0, 0, 0)];
    let found = STEPS.iter().find(|(from, ..)| scaled >= *from);
    // The last step begins at 0.
    let (from, base, exponent) = *found.unwrap_or(&(0, 0, 0));
    ((base + ((scaled - from) << exponent)) as i32, exponent)
}

/// The three ranges of an ultra cabin, mm: the first as it is, the others as differences to it and to the next cabin.
fn ultra(cabin: u32, next: u32) -> [i32; 3] {
    let (major, mut exponent) = expand(cabin & 0xFFF);
    let (following, next_exponent) = expand(next & 0xFFF);
    let mut base = major;
    if major == 0 && following != 0 {
        (base, exponent) = (following, next_exponent);
    }
    // Differences of 10 bits with a sign; their two ends mean: no echo.
    let difference = |bits: u32| ((bits << 22) as i32) >> 22;
    let range = |difference: i32, base: i32, exponent: u32| match difference {
        -512 | 511 => 0,
        _ => (base + (difference << exponent)).max(0),
    };
    [major, range(difference(cabin >> 12), base, exponent), range(difference(cabin >> 22), following, next_exponent)]
}

/// How far a sample of an ultra capsule lies behind the sweep, rad, by its range.
pub fn ultra_offset_rad(range_mm: i32) -> f64 {
    if range_mm < 50 {
        return 7.5 / 360.0 * TAU;
    }
    let k = f64::from(98_361 / (range_mm * 4));
    8.0 / 360.0 * TAU - k / 1024.0 - k * k * k / 98_304.0 / 65_536.0
}

/// Samples of a valid capsule, by the next one.
pub fn decode(mode: Mode, bytes: &[u8], next: &[u8]) -> Vec<Sample, SAMPLES_MAX> {
    samples(mode, bytes, next, advance_q6(bytes, next))
}

/// Samples of a valid express or dense capsule before the next one arrives, if the motor turns on as from the one
/// before to this one, 1/64°. Those of an ultra capsule need the next one's ranges, too.
pub fn ahead(mode: Mode, bytes: &[u8], advance_q6: u32) -> Vec<Sample, SAMPLES_MAX> {
    samples(mode, bytes, bytes, advance_q6)
}

fn samples(mode: Mode, bytes: &[u8], next: &[u8], advance_q6: u32) -> Vec<Sample, SAMPLES_MAX> {
    let mut samples = Vec::new();
    let Some((_, count)) = shape(mode).filter(|(length, _)| bytes.len() == *length && next.len() == *length) else {
        return samples;
    };
    let q6 = TAU / f64::from(360 * 64);
    let step_rad = f64::from(advance_q6) / count as f64 * q6;
    let start_rad = f64::from(start_q6(bytes)) * q6;
    let cabin_3 = |bytes: &[u8], n: usize| u32::from(word(bytes, 4 + 4 * n)) | u32::from(word(bytes, 6 + 4 * n)) << 16;
    for n in 0..count {
        let (range_mm, offset_rad) = match mode {
            Mode::Standard => (0, 0.0),
            Mode::Dense => (i32::from(word(bytes, 4 + 2 * n)), 0.0),
            Mode::Express => {
                let at = 4 + 5 * (n / 2);
                let range = word(bytes, at + 2 * (n % 2));
                let low = if n % 2 == 0 { bytes[at + 4] & 0xF } else { bytes[at + 4] >> 4 };
                let offset_q3 = u16::from(low) | (range & 3) << 4;
                (i32::from(range >> 2), f64::from(offset_q3) / 8.0 / 360.0 * TAU)
            }
            Mode::Ultra => {
                let cabin = n / 3;
                let following = if cabin < 31 { cabin_3(bytes, cabin + 1) } else { cabin_3(next, 0) };
                let range = ultra(cabin_3(bytes, cabin), following)[n % 3];
                (range, ultra_offset_rad(range))
            }
        };
        let swept_rad = start_rad + n as f64 * step_rad;
        // At most SAMPLES_MAX.
        let _ = samples.push(Sample { angle_rad: swept_rad - offset_rad, range_mm: range_mm as f32 });
    }
    samples
}

/// The least value of 12 bits whose range is not shorter, for ranges up to that of the scheme.
pub fn compress(range_mm: i32) -> u32 {
    let (mut low, mut high) = (0, 4095);
    while low < high {
        let middle = (low + high) / 2;
        if expand(middle).0 < range_mm { low = middle + 1 } else { high = middle }
    }
    low
}

/// Writes a capsule: angle of the first sample, 1/64°; ranges, mm, one for each sample. The express capsule has the
/// correction of its angles by `offset_q3`, 1/8°; ultra cabins whose differences have no room read no echo.
pub fn encode(mode: Mode, start_q6: u16, is_first: bool, ranges_mm: &[u16], next_mm: u16, offset_q3: u8) -> Capsule {
    let mut bytes = Capsule::new();
    let Some((length, _)) = shape(mode) else { return bytes };
    // LENGTH_MAX is the longest.
    let _ = bytes.resize(length, 0);
    let start = start_q6 & 0x7FFF | if is_first { 0x8000 } else { 0 };
    bytes[2..4].copy_from_slice(&start.to_le_bytes());
    let major = |range_mm: u16| expand(compress(range_mm.into()));
    match mode {
        Mode::Standard => {}
        Mode::Dense => {
            for (place, range) in bytes[4..].chunks_exact_mut(2).zip(ranges_mm) {
                place.copy_from_slice(&range.to_le_bytes());
            }
        }
        Mode::Express => {
            let (low, high) = (offset_q3 & 0xF, u16::from(offset_q3 >> 4 & 3));
            for (place, pair) in bytes[4..].chunks_exact_mut(5).zip(ranges_mm.chunks_exact(2)) {
                place[..2].copy_from_slice(&(pair[0] << 2 | high).to_le_bytes());
                place[2..4].copy_from_slice(&(pair[1] << 2 | high).to_le_bytes());
                place[4] = low | low << 4;
            }
        }
        Mode::Ultra => {
            for (n, place) in bytes[4..].chunks_exact_mut(4).enumerate() {
                let [first, one, two] = [0, 1, 2].map(|k| ranges_mm.get(3 * n + k).copied().unwrap_or(0));
                let following = ranges_mm.get(3 * n + 3).copied().unwrap_or(next_mm);
                let (mut base, mut exponent) = major(first);
                if base == 0 {
                    (base, exponent) = major(following);
                }
                let difference = |range: u16, base: i32, exponent: u32| {
                    let difference = (i32::from(range) - base) >> exponent;
                    if range == 0 || !(-511..511).contains(&difference) { 0x200 } else { difference as u32 & 0x3FF }
                };
                let (next_base, next_exponent) = major(following);
                let cabin = compress(first.into())
                    | difference(one, base, exponent) << 12
                    | difference(two, next_base, next_exponent) << 22;
                place.copy_from_slice(&cabin.to_le_bytes());
            }
        }
    }
    seal(&mut bytes);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaled_ranges_grow_without_a_jump() {
        let mut last = -1;
        for scaled in 0..4096 {
            let (range, exponent) = expand(scaled);
            assert!(range > last && range - last <= 1 << exponent, "{scaled}");
            last = range;
        }
        // The longest range of the scheme: 28672 mm and below.
        assert_eq!(last, (1 << 14) + (767 << 4));
    }

    #[test]
    fn the_least_scaled_range_is_found() {
        for range_mm in 0..30_000 {
            let scaled = compress(range_mm);
            assert!(expand(scaled).0 >= range_mm || scaled == 4095, "{range_mm} mm");
            assert!(scaled == 0 || expand(scaled - 1).0 < range_mm, "{range_mm} mm");
        }
    }

    #[test]
    fn ultra_cabins_have_a_range_and_two_differences() {
        // 1000 mm; 5 more; the next cabin's 500 less 3.
        let cabin = |range: u32, one: i32, two: i32| range | (one as u32 & 0x3FF) << 12 | (two as u32 & 0x3FF) << 22;
        let scaled = 512 + (1000 - 512) / 2;
        assert_eq!(ultra(cabin(scaled, 5, -3), cabin(500, 0, 0)), [1000, 1010, 497]);
        assert_eq!(ultra(cabin(scaled, -512, 511), cabin(500, 0, 0)), [1000, 0, 0]);
        // A cabin without a first range: the differences count from the next.
        assert_eq!(ultra(cabin(0, 4, 0), cabin(500, 0, 0)), [0, 504, 500]);
    }

    #[test]
    fn capsules_are_sealed_and_a_damaged_bit_is_found() {
        let mut bytes = [0; 84];
        for (n, byte) in bytes.iter_mut().enumerate() {
            *byte = (n * 7) as u8;
        }
        seal(&mut bytes);
        assert!(is_valid(&bytes));
        for bit in 0..84 * 8 {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(!is_valid(&damaged), "bit {bit}");
        }
    }
}
