//! Running digest of a run: equal runs give the same number on every machine.

use base::Instant;
use base::can::{Frame, Id};
use base::gamepad::Event;
use base::gpio::Signal;
use base::serial::Word;
use base::{i2c, w1};
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
            // Lengths first, so that different records cannot have the same encoding.
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

    pub fn i2c(&mut self, at: Instant, bus: &str, transfer: &i2c::Transfer, outcome: &i2c::Outcome) {
        let (kind, count) = match transfer.read {
            i2c::Read::None => (0, 0),
            i2c::Read::Exactly(count) => (1, count),
            i2c::Read::Block { extra } => (2, extra),
        };
        let (error, read): (u8, &[u8]) = match outcome {
            Ok(read) => (0, read),
            Err(i2c::Error::NoAddress) => (1, &[]),
            Err(i2c::Error::NoData { at }) => (2, std::slice::from_ref(at)),
            Err(i2c::Error::Arbitration) => (3, &[]),
            Err(i2c::Error::Stretched) => (4, &[]),
            Err(i2c::Error::Stuck) => (5, &[]),
            Err(i2c::Error::Other) => (6, &[]),
        };
        let head = [transfer.address.get(), kind, count, error];
        self.record(4, at, &[bus.as_bytes(), &head, &transfer.write, read]);
    }

    pub fn w1(&mut self, at: Instant, bus: &str, answer: &w1::Answer) {
        let mut bytes = Vec::new();
        let mut rom = |rom: &w1::Rom| {
            bytes.push(rom.family());
            bytes.extend(rom.serial().to_le_bytes());
        };
        match answer {
            w1::Answer::List(list) => list.iter().for_each(rom),
            w1::Answer::Temperature(of, said) => {
                rom(of);
                let (error, value) = match said {
                    Ok(value) => (0, *value),
                    Err(w1::Error::Absent) => (1, 0),
                    Err(w1::Error::Crc) => (2, 0),
                    Err(w1::Error::Nonsense) => (3, 0),
                    Err(w1::Error::Other) => (4, 0),
                };
                bytes.push(error);
                bytes.extend(value.to_le_bytes());
            }
            w1::Answer::Switch(of, said) => {
                rom(of);
                // A state has four bits.
                bytes.push(said.map_or_else(|error| 0x80 | error as u8, |state| state));
            }
        }
        self.record(5, at, &[bus.as_bytes(), &bytes]);
    }
    pub fn gamepad(&mut self, at: Instant, bus: &str, event: &Event) {
        let (what, code, value) = match event {
            Event::Found(device) => {
                for axis in device.axes() {
                    self.gamepad(at, bus, &Event::Axis { code: axis.code, value: axis.value });
                }
                for button in device.buttons() {
                    self.gamepad(at, bus, &Event::Button { code: button.code, pressed: button.pressed });
                }
                (0, 0, 0)
            }
            Event::Gone => (1, 0, 0),
            Event::Axis { code, value } => (2, *code, *value),
            Event::Button { code, pressed } => (3, *code, i32::from(*pressed)),
            Event::Frame => (4, 0, 0),
        };
        self.record(6, at, &[bus.as_bytes(), &[what], &code.to_le_bytes(), &value.to_le_bytes()]);
    }

    pub fn gpio(&mut self, at: Instant, bus: &str, signal: Signal) {
        self.record(7, at, &[bus.as_bytes(), &[signal.to_byte()]]);
    }

    pub fn value(&self) -> u64 {
        self.hash.digest()
    }
}
