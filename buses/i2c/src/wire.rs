//! Two lines with pull-ups that any number of devices pull, and a target on them, level by level: the counterpart of a
//! bit-banged master in tests, benches and the fuzzer.

use crate::bitbang::{Levels, Pins};
use crate::target::Target;
use base::i2c::{Address, Error};
use base::{Duration, Instant};

/// Bus interface of a target (UM10204 3.1): sees the levels and drives the lines.
#[derive(Debug)]
pub struct Slave<T> {
    /// The chip behind it.
    pub target: T,
    /// For how long it holds SCL low before each ACK bit.
    pub stretch: Duration,
    state: State,
    seen: Levels,
    lines: Levels,
    /// SCL is held until then.
    until: Instant,
}

#[derive(Clone, Copy, Debug)]
enum State {
    /// Waits for a START.
    Idle,
    /// Takes in a byte: an address behind a START, or what is written.
    Taking { address: bool, bit: u8, byte: u8 },
    /// Acknowledges, or not.
    Answering { reads: bool },
    /// Sends a byte; the number of bits already sent.
    Giving { bit: u8, byte: u8 },
    /// Waits for the master's acknowledge.
    Asking { more: bool },
}

impl<T: Target> Slave<T> {
    /// Makes a target that does not stretch, on a free bus.
    pub fn new(target: T) -> Self {
        let (seen, lines) = (Levels::HIGH, Levels::HIGH);
        Self { target, stretch: Duration::ZERO, state: State::Idle, seen, lines, until: Instant::ZERO }
    }

    /// Levels that it drives.
    pub fn lines(&self) -> Levels {
        self.lines
    }

    /// Instant at which it releases SCL.
    pub fn poll_timeout(&self) -> Option<Instant> {
        (!self.lines.scl).then_some(self.until)
    }

    /// To be called at `poll_timeout`.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.lines.scl |= self.until <= now;
    }

    /// The bus has these levels now.
    pub fn handle_levels(&mut self, now: Instant, levels: Levels) {
        let seen = core::mem::replace(&mut self.seen, levels);
        match (seen, levels) {
            // UM10204 3.1.4: START and STOP are edges of SDA while SCL is high.
            (Levels::HIGH, Levels { scl: true, sda: false }) => {
                self.state = State::Taking { address: true, bit: 0, byte: 0 };
                self.lines.sda = true;
            }
            (Levels { scl: true, sda: false }, Levels::HIGH) => {
                self.target.stop();
                self.state = State::Idle;
                self.lines.sda = true;
            }
            (Levels { scl: false, .. }, Levels { scl: true, sda }) => self.rose(sda),
            (Levels { scl: true, .. }, Levels { scl: false, .. }) => self.fell(now),
            _ => {}
        }
    }

    fn rose(&mut self, sda: bool) {
        match &mut self.state {
            State::Taking { bit, byte, .. } => (*bit, *byte) = (*bit + 1, *byte << 1 | u8::from(sda)),
            State::Giving { bit, .. } => *bit += 1,
            State::Asking { more } => *more = !sda,
            State::Idle | State::Answering { .. } => {}
        }
    }

    fn fell(&mut self, now: Instant) {
        self.state = match self.state {
            State::Taking { address, bit: 8, byte } => {
                let reads = address && byte & 1 == 1;
                let acknowledged = match Address::new(byte >> 1) {
                    Some(to) if address => self.target.start(to, reads),
                    _ => self.target.write(byte),
                };
                self.lines.sda = !acknowledged;
                if acknowledged && !self.stretch.is_zero() {
                    (self.lines.scl, self.until) = (false, now + self.stretch);
                }
                if acknowledged { State::Answering { reads } } else { State::Idle }
            }
            State::Answering { reads: false } => {
                self.lines.sda = true;
                State::Taking { address: false, bit: 0, byte: 0 }
            }
            State::Answering { reads: true } | State::Asking { more: true } => self.give(),
            State::Giving { bit: 8, .. } => {
                self.lines.sda = true;
                State::Asking { more: false }
            }
            State::Giving { bit, byte } => {
                self.lines.sda = byte << bit & 0x80 != 0;
                State::Giving { bit, byte }
            }
            State::Asking { more: false } => State::Idle,
            other @ (State::Idle | State::Taking { .. }) => other,
        };
    }

    fn give(&mut self) -> State {
        let byte = self.target.read();
        self.lines.sda = byte & 0x80 != 0;
        State::Giving { bit: 0, byte }
    }
}

/// The lines, with a target on them. [`drive`](Self::drive) takes the master's levels; transitions are counted.
#[derive(Debug)]
pub struct Wire<T> {
    /// The target.
    pub slave: Slave<T>,
    /// Levels driven by others: another master, a short circuit.
    pub other: Levels,
    /// Changes of a line by the master.
    pub sets: u32,
    /// Looks of the master.
    pub gets: u32,
    master: Levels,
    now: Instant,
}

impl<T: Target> Wire<T> {
    /// A free bus with this target.
    pub fn new(target: T) -> Self {
        let (master, other) = (Levels::HIGH, Levels::HIGH);
        Self { slave: Slave::new(target), other, sets: 0, gets: 0, master, now: Instant::ZERO }
    }

    /// The levels of the lines.
    pub fn levels(&self) -> Levels {
        self.master.and(self.other).and(self.slave.lines())
    }

    /// The time.
    pub fn now(&self) -> Instant {
        self.now
    }

    /// The master gives the lines these levels.
    pub fn drive(&mut self, lines: Levels) {
        self.sets += u32::from(lines.scl != self.master.scl) + u32::from(lines.sda != self.master.sda);
        self.master = lines;
        self.settle();
    }

    /// Another does.
    pub fn disturb(&mut self, lines: Levels) {
        self.other = lines;
        self.settle();
    }

    /// Time goes on to `at`.
    pub fn advance(&mut self, at: Instant) {
        while let Some(due) = self.slave.poll_timeout().filter(|due| *due <= at) {
            self.now = self.now.max(due);
            self.slave.handle_timeout(self.now);
            self.settle();
        }
        self.now = self.now.max(at);
    }

    /// The target sees what came of it, and pulls or releases in turn; it never answers to that with a third change.
    fn settle(&mut self) {
        for _ in 0..2 {
            let levels = self.levels();
            self.slave.handle_levels(self.now, levels);
        }
    }
}

impl<T: Target> Pins for Wire<T> {
    fn set(&mut self, lines: Levels) -> Result<(), Error> {
        self.drive(lines);
        Ok(())
    }

    fn get(&mut self) -> Result<Levels, Error> {
        self.gets += 1;
        Ok(self.levels())
    }
}
