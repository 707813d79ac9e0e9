//! What the tests of this crate share: a bus with masters and a target, what was seen on it, and a reader of that.

use crate::bitbang::{Config, Levels, Master};
use crate::target::Target;
use crate::wire::Wire;
use base::i2c::{Address, Bytes, Outcome, Read, Transfer};
use base::{Duration, Instant};
use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

pub use ::testing::Random;

pub fn address(seven: u8) -> Address {
    Address::new(seven).unwrap()
}

pub fn bytes(bytes: &[u8]) -> Bytes {
    Bytes::from_slice(bytes).unwrap()
}

pub fn transfer(seven: u8, write: &[u8], read: Read) -> Transfer {
    Transfer { address: address(seven), write: bytes(write), read }
}

/// A memory of 256 bytes behind a pointer that the first byte written sets, at 0x18.
pub struct Memory {
    pub bytes: [u8; 256],
    pointer: u8,
    pointed: bool,
    /// Refuses this byte of a write.
    pub refuses: Option<u8>,
    written: u8,
}

impl Memory {
    pub fn new() -> Self {
        let mut bytes = [0; 256];
        bytes.iter_mut().enumerate().for_each(|(n, byte)| *byte = (n as u8).wrapping_mul(0x35));
        Self { bytes, pointer: 0, pointed: false, refuses: None, written: 0 }
    }
}

impl Target for Memory {
    fn start(&mut self, address: Address, read: bool) -> bool {
        self.pointed = read;
        self.written = 0;
        address.get() == 0x18
    }

    fn write(&mut self, byte: u8) -> bool {
        if self.refuses == Some(self.written) {
            return false;
        }
        self.written += 1;
        if self.pointed {
            self.bytes[usize::from(self.pointer)] = byte;
            self.pointer = self.pointer.wrapping_add(1);
        } else {
            (self.pointer, self.pointed) = (byte, true);
        }
        true
    }

    fn read(&mut self) -> u8 {
        let byte = self.bytes[usize::from(self.pointer)];
        self.pointer = self.pointer.wrapping_add(1);
        byte
    }

    fn stop(&mut self) {}
}

/// Masters and a target on two lines.
pub struct Bench {
    pub wire: Wire<Memory>,
    pub masters: Vec<Master>,
    lines: Vec<Levels>,
    /// What somebody else does with the lines.
    pub held: Levels,
    pub now: Instant,
    pub history: Vec<(Instant, Levels)>,
}

impl Bench {
    pub fn new(configs: &[Config]) -> Self {
        Self {
            wire: Wire::new(Memory::new()),
            masters: configs.iter().map(|config| Master::new(*config)).collect(),
            lines: vec![Levels::HIGH; configs.len()],
            held: Levels::HIGH,
            now: Instant::ZERO,
            history: vec![(Instant::ZERO, Levels::HIGH)],
        }
    }

    /// A master of 100 kHz.
    pub fn standard() -> Self {
        Self::new(&[Config::default()])
    }

    pub fn request(&mut self, master: usize, transfer: Transfer) {
        self.masters[master].request(self.now, transfer).unwrap();
    }

    /// Lets everything that is due next happen; false when nothing is.
    pub fn step(&mut self) -> bool {
        let dues = self.masters.iter().map(Master::poll_timeout);
        let Some(due) = dues.chain([self.wire.slave.poll_timeout()]).flatten().min() else { return false };
        self.now = self.now.max(due);
        self.wire.advance(self.now);
        self.note();
        // All look before any acts: what they do at one moment they do together.
        let levels = self.wire.levels();
        for n in 0..self.masters.len() {
            if self.masters[n].poll_timeout().is_some_and(|due| due <= self.now) {
                self.wire.gets += u32::from(self.masters[n].wants_levels());
                if let Some(lines) = self.masters[n].handle_timeout(self.now, levels) {
                    let old = core::mem::replace(&mut self.lines[n], lines);
                    assert!(old.scl == lines.scl || old.sda == lines.sda, "one line at a time");
                    self.apply();
                }
            }
        }
        true
    }

    /// The masters' lines, and what holds them besides.
    pub fn apply(&mut self) {
        self.wire.other = self.lines[1..].iter().fold(self.held, |all, lines| all.and(*lines));
        self.wire.drive(self.lines[0]);
        self.note();
    }

    fn note(&mut self) {
        let levels = self.wire.levels();
        if self.history.last().is_none_or(|(_, last)| *last != levels) {
            self.history.push((self.now, levels));
        }
    }

    /// The first master's transfer, to its end.
    pub fn run(&mut self, transfer: Transfer) -> Outcome {
        self.history.drain(..self.history.len() - 1);
        self.request(0, transfer);
        let mut steps = 0;
        while self.masters[0].poll_timeout().is_some() {
            self.step();
            steps += 1;
            assert!(steps < 1_000_000, "a transfer ends");
        }
        self.masters[0].poll_event().unwrap()
    }

    /// A new master in the place of the first, as after a restart of its process: it releases both lines.
    pub fn restart(&mut self) {
        self.masters[0] = Master::new(Config::default());
        self.lines[0] = Levels::HIGH;
        self.apply();
    }

    pub fn pass(&mut self, duration: Duration) {
        self.now += duration;
        self.wire.advance(self.now);
        self.note();
    }

    /// What was seen, a column for each change: high `-`, low `_`.
    pub fn levels(&self) -> (String, String) {
        let row = |level: fn(&Levels) -> bool| {
            self.history.iter().map(|(_, levels)| if level(levels) { '-' } else { '_' }).collect()
        };
        (row(|levels| levels.scl), row(|levels| levels.sda))
    }

    /// What was seen, read by the definitions of UM10204 3.1.2 to 3.1.6 alone: `S`, `Sr`, address with `W` or `R`,
    /// bytes, `A` or `N`, `P`; `!` where a START or a STOP cuts a byte.
    pub fn symbols(&self) -> String {
        let (mut words, mut bits, mut open, mut address) = (Vec::new(), Vec::new(), false, false);
        for pair in self.history.windows(2) {
            match (pair[0].1, pair[1].1) {
                (Levels { scl: true, sda: true }, Levels { scl: true, sda: false }) => {
                    words.extend((bits.len() > 1).then(|| "!".into()));
                    words.push(String::from(if open { "Sr" } else { "S" }));
                    (open, address) = (true, true);
                    bits.clear();
                }
                (Levels { scl: true, sda: false }, Levels { scl: true, sda: true }) => {
                    // The clock of the STOP itself is no bit.
                    words.extend((bits.len() > 1).then(|| "!".into()));
                    words.push("P".into());
                    open = false;
                    bits.clear();
                }
                (Levels { scl: false, .. }, Levels { scl: true, sda }) => bits.push(sda),
                _ => {}
            }
            if let [byte @ .., acknowledge] = &bits[..]
                && byte.len() == 8
            {
                let byte = byte.iter().fold(0u8, |byte, bit| byte << 1 | u8::from(*bit));
                let direction = if byte & 1 == 1 { 'R' } else { 'W' };
                words.push(if address { format!("{:02x}{direction}", byte >> 1) } else { format!("{byte:02x}") });
                words.push(if *acknowledge { "N".into() } else { "A".into() });
                address = false;
                bits.clear();
            }
        }
        words.join(" ")
    }
}
