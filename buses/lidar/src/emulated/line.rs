//! A line with a bit rate and faults.

use super::Faults;
use alloc::boxed::Box;
use base::{Duration, Instant};
use heapless::{Deque, Vec};

/// Bytes on the line and in the buffers of its ends.
const CAPACITY: usize = 65_536;
/// Longest message that can be repeated.
const MESSAGE_MAX: usize = 16_384;
/// Bytes that wait for a slow line.
const SLOW_MAX: usize = 1000;
/// Time of the line that it makes up for after it held bytes back, ns.
const LATE_MAX_NS: u64 = 10_000_000_000;
/// Least interval of a message that is repeated for ever.
const AGAIN_AFTER: Duration = Duration::from_millis(5);

/// Bits of a character that change what a receiver takes it for: the start bit and eight data bits. The byte of a
/// character whose stop bit is wrong is taken as it is.
const BITS: u32 = 9;

/// The way from a device to the engine.
#[derive(Debug)]
pub struct Line {
    bytes_per_s: u64,
    bytes: Box<Deque<u8, CAPACITY>>,
    last: Box<Vec<u8, MESSAGE_MAX>>,
    again_at: Instant,
    served: Instant,
    /// Nanoseconds of the line that are not used yet.
    left_ns: u64,
    random: u64,
}

impl Line {
    /// A line that carries this many bytes per second.
    #[must_use]
    pub fn new(bytes_per_s: u32) -> Self {
        Self {
            bytes_per_s: u64::from(bytes_per_s).max(1),
            bytes: Box::default(),
            last: Box::default(),
            again_at: Instant::ZERO,
            served: Instant::ZERO,
            left_ns: 0,
            random: 0x9E37_79B9_7F4A_7C15,
        }
    }

    fn random(&mut self) -> u64 {
        // xorshift64
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random >> 16
    }

    fn in_1000(&mut self, count: u16) -> bool {
        self.in_million(1000 * u32::from(count))
    }

    fn in_million(&mut self, count: u32) -> bool {
        if count == 0 {
            return false;
        }
        // The thousands first: what happens by whole parts per mille does not depend on the finer digits.
        let random = self.random();
        random % 1000 * 1000 + random / 1000 % 1000 < u64::from(count)
    }

    /// Discards what is on the way.
    pub fn clear(&mut self) {
        self.bytes.clear();
    }

    /// The device begins to send at `at`: an idle line does not count the time before it.
    pub fn begin(&mut self, at: Instant) {
        if self.bytes.is_empty() {
            (self.served, self.left_ns) = (at, 0);
        }
    }

    /// Sends a message of the device.
    pub fn send(&mut self, message: &[u8], faults: &Faults) {
        if faults.repeats || faults.half_for_ever {
            return;
        }
        self.last.clear();
        // A longer one is repeated in part.
        let _ = self.last.extend_from_slice(&message[..message.len().min(MESSAGE_MAX)]);
        let end = if faults.halves { message.len() / 2 } else { message.len() };
        self.put(&message[..end], faults);
    }

    fn put(&mut self, message: &[u8], faults: &Faults) {
        if faults.cut || faults.mute || faults.unpowered {
            return;
        }
        for byte in message {
            if self.in_1000(faults.lost_per_mille) {
                continue;
            }
            let mut byte = *byte | faults.stuck_bits;
            if self.in_million(BITS * faults.wrong_bits_ppm) {
                // Two of one character are too rare to matter.
                match self.random() % u64::from(BITS) {
                    // Without its start bit it is not received.
                    8 => continue,
                    bit => byte ^= 1 << bit,
                }
            }
            if self.in_million(faults.noise_ppm) {
                byte ^= 1 << (self.random() % 8);
            }
            if faults.wrong_baud {
                // At half the bit rate each bit is read twice.
                byte = [0x00, 0x18, 0x86, 0x9E, 0x60, 0x78, 0xE6, 0xFE][usize::from(byte % 8)];
            }
            let byte = faults.constant.unwrap_or(byte);
            // What has no room is lost, as in the buffer of a port.
            if !faults.slow_line || self.bytes.len() < SLOW_MAX {
                let _ = self.bytes.push_back(byte);
            }
            if self.in_1000(faults.added_per_mille) {
                let byte = self.random() as u8;
                let _ = self.bytes.push_back(byte);
            }
        }
    }

    /// Bytes that have arrived by `now`; returns their number.
    pub fn poll(&mut self, now: Instant, bytes: &mut [u8], faults: &Faults) -> usize {
        let again = (faults.repeats || faults.half_for_ever) && self.again_at <= now;
        // Not faster than the line carries it.
        if again && self.bytes.is_empty() && !self.last.is_empty() {
            self.again_at = now + AGAIN_AFTER;
            let last = core::mem::take(&mut self.last);
            let end = if faults.half_for_ever { last.len() / 2 } else { last.len() };
            self.put(&last[..end], faults);
            self.last = last;
        }
        let elapsed = now.since(self.served).as_nanos() as u64;
        self.served = now;
        let byte_ns = 1_000_000_000 / self.bytes_per_s * if faults.slow_line { 10 } else { 1 };
        self.left_ns = self.left_ns.saturating_add(elapsed).min(LATE_MAX_NS);
        if faults.held_back {
            return 0;
        }
        let count = bytes.len().min((self.left_ns / byte_ns.max(1)) as usize);
        let mut taken = 0;
        while let Some(byte) = (taken < count).then(|| self.bytes.pop_front()).flatten() {
            bytes[taken] = byte;
            taken += 1;
        }
        self.left_ns -= taken as u64 * byte_ns;
        if self.bytes.is_empty() {
            self.left_ns = 0;
        }
        taken
    }

    /// Time for which this many bytes are on the way.
    #[must_use]
    pub fn time(&self, bytes: usize) -> Duration {
        Duration::from_nanos(bytes as u64 * (1_000_000_000 / self.bytes_per_s))
    }

    /// Instant at which all bytes that are on the way have arrived, if nothing is wrong with the line; `None`: it is
    /// idle.
    #[must_use]
    pub fn arrives(&self) -> Option<Instant> {
        let left = Duration::from_nanos(self.left_ns);
        self.is_busy().then(|| self.served + self.time(self.bytes.len()).saturating_sub(left))
    }

    /// True while bytes are on the way.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        !self.bytes.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that are lost and bytes that are wrong, of 1,000,000.
    fn suffered(faults: &Faults) -> (usize, usize) {
        let mut line = Line::new(1_000_000);
        let (mut all, mut bytes) = (std::vec::Vec::new(), [0; 1000]);
        for n in 1..=1000 {
            line.send(&[0; 1000], faults);
            let count = line.poll(Instant::from_millis(n), &mut bytes, faults);
            all.extend_from_slice(&bytes[..count]);
        }
        (1_000_000 - all.len(), all.iter().filter(|byte| **byte != 0).count())
    }

    #[test]
    fn noise_is_as_rare_as_it_is_set() {
        let wrong = |noise_ppm| {
            let (lost, wrong) = suffered(&Faults { noise_ppm, ..Faults::default() });
            assert_eq!(lost, 0);
            wrong
        };
        assert_eq!(wrong(0), 0);
        assert_eq!(wrong(1_000_000), 1_000_000);
        for (noise_ppm, expected) in [(100, 70..130), (1000, 900..1100), (30_000, 29_000..31_000)] {
            let count = wrong(noise_ppm);
            assert!(expected.contains(&count), "{noise_ppm}: {count}");
        }
    }

    #[test]
    fn a_byte_suffers_by_each_of_its_bits_and_is_lost_without_its_start_bit() {
        let (lost, wrong) = suffered(&Faults { wrong_bits_ppm: 1000, ..Faults::default() });
        assert!((900..1100).contains(&lost) && (7700..8300).contains(&wrong), "{lost} {wrong}");
    }
}
