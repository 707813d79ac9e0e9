//! The running digest of a run: the same run gives the same number on every machine.

use base::Instant;
use base::can::{Frame, Id};
use base::serial::Word;
use xxhash_rust::xxh64::Xxh64;

/// xxh64 over every message and every frame, in order.
pub(super) struct Digest {
    hash: Xxh64,
    scratch: Vec<u8>,
}

impl Digest {
    pub fn new(seed: u64) -> Self {
        Self { hash: Xxh64::new(seed), scratch: Vec::with_capacity(512) }
    }

    fn record(&mut self, kind: u8, at: Instant, parts: &[&[u8]]) {
        self.scratch.clear();
        self.scratch.push(kind);
        self.scratch.extend_from_slice(&at.as_nanos().to_le_bytes());
        for part in parts {
            // Lengths first, so that no two records read alike.
            self.scratch.extend_from_slice(&(part.len() as u32).to_le_bytes());
            self.scratch.extend_from_slice(part);
        }
        self.hash.update(&self.scratch);
    }

    pub fn message(&mut self, at: Instant, source: u32, channel: &str, bytes: &[u8]) {
        self.record(1, at, &[&source.to_le_bytes(), channel.as_bytes(), bytes]);
    }

    pub fn can(&mut self, at: Instant, bus: &str, frame: &Frame) {
        let id = match frame.id() {
            Id::Standard(id) => u32::from(id),
            Id::Extended(id) => id | 1 << 31,
        };
        let header = [frame.dlc(), u8::from(frame.is_remote())];
        self.record(2, at, &[bus.as_bytes(), &id.to_le_bytes(), &header, frame.data()]);
    }

    pub fn words(&mut self, at: Instant, bus: &str, words: &[Word]) {
        let mut bytes = [0; 512];
        let pairs = words.iter().flat_map(|word| [word.byte, u8::from(word.ninth)]);
        let n = bytes.iter_mut().zip(pairs).map(|(to, from)| *to = from).count();
        self.record(3, at, &[bus.as_bytes(), &bytes[..n]]);
    }

    pub fn value(&self) -> u64 {
        self.hash.digest()
    }
}
