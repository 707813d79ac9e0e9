//! Emergencies: when they leave (0x1015) and what is remembered of them (0x1003).

use super::{Node, Phase};
use crate::Dictionary;
use crate::wire::{Emergency, NmtState};
use base::can::Frame;
use base::{Duration, Instant, Queue};

/// Emergencies that wait for the inhibit time; more than these are not sent, but remembered.
#[derive(Default)]
pub(super) struct Emergencies {
    waiting: Queue<[u8; 8], 16>,
    until: Instant,
}

fn inhibit(dictionary: &Dictionary) -> Duration {
    Duration::from_micros(dictionary.get(0x1015, 0).unwrap_or(0).unsigned_abs() * 100)
}

impl Emergencies {
    /// Drops waiting emergencies.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.until = Instant::ZERO;
    }

    /// Gives it back when it may leave at once.
    pub(super) fn push(&mut self, dictionary: &Dictionary, data: [u8; 8]) -> Option<[u8; 8]> {
        if inhibit(dictionary).is_zero() && self.waiting.is_empty() {
            return Some(data);
        }
        self.waiting.push(data);
        None
    }

    /// The one that may leave now.
    pub(super) fn due(&mut self, now: Instant, dictionary: &Dictionary) -> Option<[u8; 8]> {
        if now < self.until {
            return None;
        }
        let data = self.waiting.pop()?;
        self.until = now + inhibit(dictionary);
        Some(data)
    }

    pub(super) fn next(&self) -> Option<Instant> {
        (!self.waiting.is_empty()).then_some(self.until)
    }
}

impl Node {
    /// Emergency of the node's own communication.
    pub(super) fn communication_emergency(&mut self, code: u16) {
        let register = self.number(0x1001, 0) as u8 | 0x10;
        self.emergency(code, register, [0; 5]);
    }

    /// Sends an emergency and remembers it in 0x1003; `code` 0: an error went away. `register` becomes 0x1001.
    /// Nothing is sent where the NMT state forbids it; with an inhibit time (0x1015) it leaves at
    /// [`Self::handle_timeout`].
    pub fn emergency(&mut self, code: u16, register: u8, info: [u8; 5]) {
        self.dictionary.set(0x1001, 0, i64::from(register));
        self.pdos.touch(&self.dictionary, 0x1001, 0);
        if code != 0 {
            remember(&mut self.dictionary, code, info);
        }
        let talks = matches!(self.phase, Phase::Running(NmtState::Operational | NmtState::PreOperational));
        let data = Emergency { code, register, info }.encode();
        if talks && let Some(data) = self.emergencies.push(&self.dictionary, data) {
            self.send_emergency(&data);
        }
    }

    pub(super) fn send_emergency(&mut self, data: &[u8]) {
        let cob_id = self.get(0x1014, 0).unwrap_or(0x80 + i64::from(self.id()));
        if cob_id & 1 << 31 == 0 {
            self.tx.push(Frame::standard(cob_id as u16, data));
        }
    }
}

/// The newest error moves to the front of 0x1003.
fn remember(dictionary: &mut Dictionary, code: u16, info: [u8; 5]) {
    let number = |dictionary: &Dictionary, sub| dictionary.get(0x1003, sub).unwrap_or(0);
    let room = (1..=254).take_while(|sub| dictionary.get(0x1003, *sub).is_some()).count() as u8;
    for sub in (1..room).rev() {
        let older = number(dictionary, sub);
        dictionary.set(0x1003, sub + 1, older);
    }
    let [low, high, ..] = info;
    dictionary.set(0x1003, 1, i64::from(u16::from_le_bytes([low, high])) << 16 | i64::from(code));
    let count = number(dictionary, 0) + 1;
    dictionary.set(0x1003, 0, count.min(i64::from(room)));
}

/// Sub-index 0 was written 0.
pub(super) fn clear_history(dictionary: &mut Dictionary) {
    for sub in 1..=254 {
        if dictionary.get(0x1003, sub).is_none() {
            break;
        }
        dictionary.set(0x1003, sub, 0);
    }
}
