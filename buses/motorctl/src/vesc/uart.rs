//! Payloads on a UART, `comm/packet.c` of the firmware: 2 and a length of one byte, or 3 and one of two bytes; the
//! payload; its CRC-16; 3. Both ends use it.

use super::{Link as Way, PAYLOAD_MAX};
use crate::crc::crc16;
use base::{Duration, Instant};
use heapless::Vec;

const SHORT: u8 = 2;
const LONG: u8 = 3;
const END: u8 = 3;
/// Least length that is sent with two bytes, `packet.c`.
const LONG_MIN: usize = 255;
/// CRC and end.
const TAIL: usize = 3;
const PACKET_MAX: usize = 3 + PAYLOAD_MAX + TAIL;
/// A packet with a longer pause between two bytes is given up: its length may be damaged, and what follows must not
/// wait for it.
const GAP: Duration = Duration::from_millis(20);

/// Bytes to be sent without a gap.
pub type Bytes = Vec<u8, { PACKET_MAX + 64 }>;

/// One end of the line.
#[derive(Debug)]
pub struct Link {
    rx: Vec<u8, PACKET_MAX>,
    received: Instant,
    tx: Bytes,
}

/// What the received bytes are.
enum Found {
    More,
    /// The first byte begins no packet.
    Nothing,
    /// The first bytes are a packet whose checksum or end is wrong.
    Damaged,
    /// The payload's beginning and end.
    Packet(usize, usize),
}

impl Link {
    /// An end at which nothing was received.
    #[must_use]
    pub fn new() -> Self {
        Self { rx: Vec::new(), received: Instant::ZERO, tx: Bytes::new() }
    }

    fn find(&self) -> Found {
        let (start, len) = match *self.rx {
            [] | [SHORT] | [LONG] | [LONG, _] => return Found::More,
            [SHORT, len, ..] if len > 0 => (2, usize::from(len)),
            [LONG, high, low, ..] => (3, usize::from(u16::from_be_bytes([high, low]))),
            _ => return Found::Nothing,
        };
        if len > PAYLOAD_MAX || (start == 3 && len < LONG_MIN) {
            return Found::Nothing;
        }
        let end = start + len;
        match self.rx.get(end..end + TAIL) {
            None => Found::More,
            Some(tail) => {
                let [high, low] = crc16(0, &self.rx[start..end]).to_be_bytes();
                if *tail == [high, low, END] { Found::Packet(start, end) } else { Found::Damaged }
            }
        }
    }

    fn forget(&mut self, count: usize) {
        self.rx.copy_within(count.., 0);
        self.rx.truncate(self.rx.len() - count);
    }
}

impl Default for Link {
    fn default() -> Self {
        Self::new()
    }
}

impl Way for Link {
    type Rx = [u8];
    type Tx = Bytes;

    fn send(&mut self, payload: &[u8]) {
        let [high, low] = (payload.len() as u16).to_be_bytes();
        let long = [LONG, high, low];
        let short = [SHORT, low];
        let head: &[u8] = if payload.len() > 255 { &long } else { &short };
        if payload.is_empty() || payload.len() > PAYLOAD_MAX {
            return;
        }
        if self.tx.len() + head.len() + payload.len() + TAIL > self.tx.capacity() {
            return;
        }
        let [high, low] = crc16(0, payload).to_be_bytes();
        head.iter().chain(payload).chain(&[high, low, END]).for_each(|byte| _ = self.tx.push(*byte));
    }

    fn receive(&mut self, now: Instant, bytes: &[u8], take: &mut dyn FnMut(&[u8])) -> u32 {
        let mut damaged = 0;
        if self.received + GAP < now && !self.rx.is_empty() {
            damaged += 1;
            self.rx.clear();
        }
        self.received = now;
        for byte in bytes {
            // A packet is complete before the buffer is full.
            let _ = self.rx.push(*byte);
            loop {
                match self.find() {
                    Found::More => break,
                    Found::Nothing => self.forget(1),
                    Found::Damaged => {
                        damaged += 1;
                        self.forget(1);
                    }
                    Found::Packet(start, end) => {
                        take(&self.rx[start..end]);
                        self.forget(end + TAIL);
                    }
                }
            }
        }
        damaged
    }

    fn poll_tx(&mut self) -> Option<Bytes> {
        (!self.tx.is_empty()).then(|| core::mem::take(&mut self.tx))
    }

    fn clear(&mut self) {
        self.tx.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Random;

    fn received(link: &mut Link, at: Instant, bytes: &[u8]) -> (std::vec::Vec<std::vec::Vec<u8>>, u32) {
        let mut payloads = std::vec::Vec::new();
        let damaged = link.receive(at, bytes, &mut |payload| payloads.push(payload.to_vec()));
        (payloads, damaged)
    }

    /// The checksums were computed bit by bit.
    #[test]
    fn packets_are_those_of_the_source() {
        let mut link = Link::new();
        link.send(&[0]);
        assert_eq!(link.poll_tx().unwrap(), [2, 1, 0, 0x00, 0x00, 3]);
        link.send(&[8, 0, 0, 0x0B, 0xB8]);
        assert_eq!(link.poll_tx().unwrap(), [2, 5, 8, 0, 0, 0x0B, 0xB8, 0xF8, 0x04, 3]);
        link.send(&[17; 300]);
        let long = link.poll_tx().unwrap();
        assert_eq!((long.len(), &long[..4]), (306, &[3, 0x01, 0x2C, 17][..]));
        assert!(link.poll_tx().is_none());
    }

    #[test]
    fn payloads_of_all_lengths_return() {
        let (mut link, mut random) = (Link::new(), Random::new(2));
        for len in 1..=PAYLOAD_MAX {
            let payload = random.bytes(len);
            link.send(&payload);
            let bytes = link.poll_tx().unwrap();
            assert_eq!(received(&mut link, Instant::ZERO, &bytes), (std::vec![payload], 0));
        }
    }

    #[test]
    fn after_damage_the_next_packet_is_found() {
        let mut link = Link::new();
        link.send(&[1, 2, 3]);
        let good = link.poll_tx().unwrap();
        let mut random = Random::new(4);
        for n in 0..2000_u64 {
            let mut bad = good.clone();
            bad[random.index(good.len())] ^= 1 << random.below(8);
            let at = Instant::from_millis(n * 100);
            received(&mut link, at, &bad);
            // A damaged length is waited for, no longer than the gap.
            assert_eq!(received(&mut link, at + GAP * 2, &good).0, [[1, 2, 3]]);
        }
    }

    #[test]
    fn any_bytes_are_received_without_a_panic() {
        let (mut link, mut random) = (Link::new(), Random::new(6));
        for n in 0..100_000 {
            let len = random.index(8);
            let bytes: std::vec::Vec<u8> = (0..len)
                .map(|_| if random.one_in(2) { 2 + random.below(2) as u8 } else { random.edge_byte() })
                .collect();
            received(&mut link, Instant::from_millis(n), &bytes);
            assert!(link.rx.len() < PACKET_MAX);
        }
    }
}
