//! A CAN wire: exact frame lengths, arbitration, one frame at a time (ISO 11898-1).

use super::Owner;
use super::news::Traffic;
use base::can::{Frame, INTERMISSION, Id, frame_bits};
use base::{Duration, Instant};
use std::collections::VecDeque;

/// Frames that an interface queues; further ones are lost, as with a short transmit queue in the kernel.
const QUEUE: usize = 128;
/// Base frames win over extended ones of the same first 11 bits, data over remote.
fn rank(frame: &Frame) -> u64 {
    let remote = u64::from(frame.is_remote());
    match frame.id() {
        Id::Standard(id) => u64::from(id) << 21 | remote << 20,
        Id::Extended(id) => u64::from(id >> 18) << 21 | 1 << 20 | u64::from(id & 0x3_FFFF) << 1 | remote,
    }
}

/// One wire. Each port sends its own frames in order; among the ports' first ones the lowest identifier wins.
#[derive(Debug)]
pub(super) struct CanWire {
    pub bitrate: u32,
    pub ports: Vec<Owner>,
    queues: Vec<(Owner, VecDeque<Frame>)>,
    sending: Option<(Instant, Owner, Frame)>,
    /// When the intermission is over.
    free: Instant,
    /// When the next arbitration begins; frames handed over at the same moment take part.
    start: Option<Instant>,
    pub traffic: Traffic,
}

impl CanWire {
    pub fn new(bitrate: u32) -> Self {
        Self {
            bitrate: bitrate.max(1),
            ports: Vec::new(),
            queues: Vec::new(),
            sending: None,
            free: Instant::ZERO,
            start: None,
            traffic: Traffic::default(),
        }
    }

    fn time(&self, bits: u32) -> Duration {
        Duration::from_nanos(u64::from(bits) * 1_000_000_000 / u64::from(self.bitrate))
    }

    pub fn send(&mut self, now: Instant, owner: Owner, frame: Frame) {
        let place = self.queues.iter().position(|(other, _)| *other == owner).unwrap_or_else(|| {
            self.queues.push((owner, VecDeque::new()));
            self.queues.len() - 1
        });
        let queue = &mut self.queues[place].1;
        if queue.len() >= QUEUE {
            self.traffic.dropped += 1;
            return;
        }
        queue.push_back(frame);
        if self.sending.is_none() && self.start.is_none() {
            self.start = Some(self.free.max(now));
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.sending.as_ref().map(|(end, ..)| *end).or(self.start)
    }

    /// Serves what is due; answers a frame whose end has come.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<(Owner, Frame)> {
        if let Some((_, owner, frame)) = self.sending.take() {
            self.free = now + self.time(INTERMISSION);
            let waiting = self.queues.iter().any(|(_, queue)| !queue.is_empty());
            self.start = waiting.then_some(self.free);
            self.traffic.sent += 1;
            return Some((owner, frame));
        }
        self.start = None;
        let heads = self.queues.iter_mut().filter(|(_, queue)| !queue.is_empty());
        let winner = heads.min_by_key(|(owner, queue)| (queue.front().map(rank), *owner))?;
        let (owner, frame) = (winner.0, winner.1.pop_front()?);
        let time = self.time(frame_bits(&frame));
        self.traffic.busy += time;
        self.sending = Some((now + time, owner, frame));
        None
    }

    /// The process is gone; what it had handed over is still sent, as the kernel does.
    pub fn close(&mut self, pid: u32) {
        self.ports.retain(|owner| owner.pid != pid);
        self.queues.retain(|(owner, queue)| owner.pid != pid || !queue.is_empty());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use module::PortId;

    fn frame(id: u16, data: &[u8]) -> Frame {
        Frame::standard(id, data)
    }

    #[test]
    fn frames_are_as_long_as_their_content_makes_them() {
        // docs/facts/canopen.md 7, with 3 bits of gap: 8 bytes 111 at best, 135 at worst; 0 bytes 47 to 55.
        for seed in 0..20_000u64 {
            let mut random = crate::random::Random::new(seed);
            let n = (random.bits() % 9) as usize;
            let data = random.bits().to_le_bytes();
            let bits = frame_bits(&frame(random.bits() as u16, &data[..n])) + INTERMISSION;
            let (best, worst) = (47 + 8 * n as u32, 47 + 8 * n as u32 + (34 + 8 * n as u32 - 1) / 4);
            assert!((best..=worst).contains(&bits), "{n} bytes: {bits}");
        }
        assert!(frame_bits(&frame(0, &[0; 8])) > frame_bits(&frame(0x555, &[0x55; 8])));
        let extended = Frame::new(Id::Extended(0x1234_5678), &[]).unwrap();
        assert!((64..=64 + 13).contains(&frame_bits(&extended)));
    }

    #[test]
    fn the_lowest_identifier_wins_and_each_port_keeps_its_order() {
        let mut wire = CanWire::new(1_000_000);
        let owner = |pid| Owner { pid, port: PortId(0) };
        let now = Instant::from_millis(1);
        wire.send(now, owner(1), frame(0x700, &[]));
        wire.send(now, owner(1), frame(0x001, &[]));
        wire.send(now, owner(2), frame(0x300, &[]));
        wire.send(now, owner(3), frame(0x200, &[]));
        let mut order = Vec::new();
        while let Some(due) = wire.poll_timeout() {
            if let Some((owner, frame)) = wire.handle_timeout(due) {
                order.push((owner.pid, frame.id()));
            }
        }
        let ids = [(3, 0x200), (2, 0x300), (1, 0x700), (1, 0x001)];
        assert_eq!(order, ids.map(|(pid, id)| (pid, Id::Standard(id))));
    }

    #[test]
    fn frames_follow_each_other_with_three_bits_between() {
        let mut wire = CanWire::new(500_000);
        let owner = Owner { pid: 1, port: PortId(0) };
        let (a, b) = (frame(0x181, &[1, 2, 3]), frame(0x182, &[]));
        wire.send(Instant::ZERO, owner, a);
        wire.send(Instant::ZERO, owner, b);
        let mut ends = Vec::new();
        while let Some(due) = wire.poll_timeout() {
            if wire.handle_timeout(due).is_some() {
                ends.push(due.as_nanos());
            }
        }
        let (a, b) = (u64::from(frame_bits(&a)) * 2000, u64::from(frame_bits(&b)) * 2000);
        assert_eq!(ends, [a, a + 3 * 2000 + b]);
    }
}
