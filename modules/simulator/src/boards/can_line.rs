//! What is wrong on the CAN bus beside the drives: frames that are lost where the host models no wire, a node that
//! babbles, a second node with the number of another.

use crate::faults::InjectedFault;
use crate::random::Random;
use base::can::{Frame, frame_bits};
use base::{Duration, Instant};
use canopen::{Dictionary, Node};

/// Bits between two frames of 8 bytes of a babbling node, which takes half of the wire.
const BABBLE: u32 = 2 * 131;
/// Without a wire a controller that went off is back after so long.
const OFF: Duration = Duration::from_millis(100);

/// The bus, as it is at the simulator's port.
pub(crate) struct CanLine {
    bitrate: u32,
    /// The host models no wire: its faults are imitated here.
    imitates: bool,
    random: Random,
    noise: (Instant, f64),
    corrupt: (Instant, u64),
    loss: (Instant, f64),
    lose: u64,
    dead: Instant,
    frames: u64,
    babblers: Vec<Babbler>,
    /// Their ids, and until when they are there.
    twins: Vec<(u8, Instant, Node)>,
}

struct Babbler {
    node: u8,
    frame: Frame,
    until: Instant,
    next: Instant,
}

impl CanLine {
    pub fn new(bitrate: u32, imitates: bool, random: Random) -> Self {
        Self {
            bitrate: bitrate.max(1),
            imitates,
            random,
            noise: (Instant::ZERO, 0.0),
            corrupt: (Instant::ZERO, 0),
            loss: (Instant::ZERO, 0.0),
            lose: 0,
            dead: Instant::ZERO,
            frames: 0,
            babblers: Vec::new(),
            twins: Vec::new(),
        }
    }

    /// Injects a fault into the bus; false if it is none of its faults.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        match injected {
            InjectedFault::Noise(rate) => self.noise = (until, rate),
            InjectedFault::Corrupt(every) => self.corrupt = (until, every),
            InjectedFault::Loss(chance) => self.loss = (until, chance),
            // The host's wire does these, where there is one.
            InjectedFault::Duplicate(_) | InjectedFault::Delay(_) => return !self.imitates,
            InjectedFault::Lose(nth) => self.lose = self.frames.saturating_add(nth),
            InjectedFault::Cut => self.dead = until,
            InjectedFault::BusOff => self.dead = if until == Instant::NEVER { now + OFF } else { until },
            InjectedFault::None => {
                (self.noise.0, self.corrupt.0, self.loss.0, self.lose, self.dead) = (now, now, now, 0, now);
            }
            _ => return false,
        }
        true
    }

    /// Injects a fault into a node that does not concern its drive; false if it is no such fault. Without `objects`
    /// it is no CANopen node, and has no second one.
    pub fn inject_node(
        &mut self,
        now: Instant,
        node: u8,
        injected: InjectedFault,
        until: Instant,
        objects: Option<Dictionary>,
    ) -> bool {
        match injected {
            InjectedFault::Babble { id, .. } => {
                let id = if id > 0 { id } else { 0x280 + u16::from(node) };
                self.babblers.retain(|babbler| babbler.node != node);
                self.babblers.push(Babbler { node, frame: Frame::standard(id, &[0; 8]), until, next: now });
            }
            InjectedFault::Clash => {
                let Some(objects) = objects else { return false };
                let mut twin = Node::new(objects, Duration::ZERO);
                twin.power_on(now);
                self.twins.retain(|(other, ..)| *other != node);
                self.twins.push((node, until, twin));
            }
            _ => return false,
        }
        true
    }

    /// A node is well again.
    pub fn heal_node(&mut self, node: u8) {
        self.babblers.retain(|babbler| babbler.node != node);
        self.twins.retain(|(other, ..)| *other != node);
    }

    /// True if a frame passes the bus.
    pub fn passes(&mut self, now: Instant, frame: &Frame) -> bool {
        if !self.imitates {
            return true;
        }
        self.frames += 1;
        let noise =
            if now < self.noise.0 { 1.0 - libm::pow(1.0 - self.noise.1, f64::from(frame_bits(frame))) } else { 0.0 };
        let corrupt = now < self.corrupt.0 && self.frames.is_multiple_of(self.corrupt.1);
        let loss = if now < self.loss.0 { self.loss.1 } else { 0.0 };
        now >= self.dead
            && !self.random.chance(loss)
            && !corrupt
            && self.frames != self.lose
            && !self.random.chance(noise)
    }

    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        for (.., twin) in &mut self.twins {
            twin.handle_rx(now, frame);
        }
    }

    pub fn handle_timeout(&mut self, now: Instant) {
        self.babblers.retain(|babbler| now < babbler.until);
        self.twins.retain(|(_, until, _)| now < *until);
        for (.., twin) in &mut self.twins {
            twin.handle_timeout(now);
        }
    }

    pub fn poll_tx(&mut self, now: Instant) -> Option<Frame> {
        let pause = Duration::from_nanos(u64::from(BABBLE) * 1_000_000_000 / u64::from(self.bitrate));
        if let Some(babbler) = self.babblers.iter_mut().find(|babbler| babbler.next <= now) {
            // What it missed is not made up for.
            babbler.next = now + pause;
            return Some(babbler.frame);
        }
        self.twins.iter_mut().find_map(|(.., twin)| {
            // Events of its objects have no consumer.
            while twin.poll_event().is_some() {}
            twin.poll_tx()
        })
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let babblers = self.babblers.iter().map(|babbler| babbler.next.min(babbler.until));
        babblers.chain(self.twins.iter().filter_map(|(.., twin)| twin.poll_timeout())).min()
    }
}
