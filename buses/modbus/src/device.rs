//! The other end: a device with the registers that it was given, byte by byte. For the simulator and for tests.
//!
//! An address that was not set does not exist: it is answered by exception 2, as by real devices.

use crate::frame::{Bytes, HEADER, Header, LATENCY, Line, rtu};
use crate::pdu::{Exception, Pdu, Request, Table, answer, exception};
use base::{Duration, Instant, Queue};
use heapless::Vec;

/// Addresses of one device at most.
pub const POINTS: usize = 512;
/// From the request's last byte to the answer's first, usually.
const DELAY: Duration = Duration::from_millis(2);

/// What is wrong with the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Neither receives nor sends.
    pub unplugged: bool,
    /// Receives, acts, and does not answer.
    pub mute: bool,
    /// The last byte of every answer is damaged.
    pub garbled: bool,
    /// Answers under the next unit.
    pub stranger: bool,
    /// TCP: answers the transaction before.
    pub stale: bool,
    /// Sends half of every answer.
    pub cut: bool,
    /// Answers every request so.
    pub exception: Option<Exception>,
}

#[derive(Clone, Copy, Debug)]
struct Point {
    table: Table,
    address: u16,
    word: u16,
}

/// A device.
#[derive(Debug)]
pub struct Device {
    line: Line,
    unit: u8,
    /// What is wrong with it.
    pub faults: Faults,
    /// From the request's last byte to the answer's first.
    pub delay: Duration,
    points: Vec<Point, POINTS>,
    rx: Bytes,
    received: Instant,
    answers: Queue<(Instant, Bytes), 4>,
    writes: u32,
}

impl Device {
    /// A device without registers.
    #[must_use]
    pub fn new(line: Line, unit: u8) -> Self {
        Self {
            line,
            unit,
            faults: Faults::default(),
            delay: DELAY,
            points: Vec::new(),
            rx: Bytes::new(),
            received: Instant::ZERO,
            answers: Queue::new(),
            writes: 0,
        }
    }

    /// Its unit.
    #[must_use]
    pub fn unit(&self) -> u8 {
        self.unit
    }

    /// Sets a register, or a bit: 0 or 1. False if there is no room for another address.
    pub fn set(&mut self, table: Table, address: u16, word: u16) -> bool {
        match self.point(table, address) {
            Some(point) => {
                point.word = word;
                true
            }
            None => self.points.push(Point { table, address, word }).is_ok(),
        }
    }

    /// A register or bit; `None` if it does not exist.
    #[must_use]
    pub fn get(&self, table: Table, address: u16) -> Option<u16> {
        let point = self.points.iter().find(|point| (point.table, point.address) == (table, address))?;
        Some(point.word)
    }

    /// Requests to write that it carried out.
    #[must_use]
    pub fn writes(&self) -> u32 {
        self.writes
    }

    fn point(&mut self, table: Table, address: u16) -> Option<&mut Point> {
        self.points.iter_mut().find(|point| (point.table, point.address) == (table, address))
    }

    /// The line is new: what was received and not answered is forgotten.
    pub fn reset(&mut self) {
        self.rx.clear();
        self.answers.clear();
    }

    /// Takes bytes from the line.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        if self.faults.unplugged {
            return;
        }
        if now.since(self.received) > self.line.t3_5() + LATENCY && self.line != Line::Tcp {
            self.rx.clear();
        }
        self.received = now;
        for byte in bytes {
            if self.rx.push(*byte).is_err() {
                self.rx.clear();
            }
            match self.line {
                Line::Rtu { .. } => self.rtu_complete(now),
                Line::Tcp => self.tcp_complete(now),
            }
        }
    }

    fn rtu_complete(&mut self, now: Instant) {
        let Some(pdu_len) = self.rx.get(1..).and_then(Request::len_of) else { return };
        // The end of an unknown function is where its checksum is met.
        let is_known = matches!(self.rx[1], 1..=6 | 15 | 16);
        if is_known && self.rx.len() < self.line.frame_len(pdu_len) {
            return;
        }
        let frame = match rtu(&self.rx) {
            Some((unit, pdu)) if unit == self.unit || unit == 0 => Some((unit, Pdu::from_slice(pdu))),
            Some(_) => None,
            None if is_known => None,
            None => return,
        };
        self.rx.clear();
        if let Some((unit, Ok(pdu))) = frame {
            let answer = self.execute(&pdu);
            if unit != 0 {
                self.answer(now, 0, &answer);
            }
        }
    }

    fn tcp_complete(&mut self, now: Instant) {
        match Header::read(&self.rx) {
            Ok(Some(header)) if self.rx.len() >= header.len => {
                let frame = core::mem::take(&mut self.rx);
                if header.unit == self.unit {
                    let answer = self.execute(&frame[HEADER..]);
                    self.answer(now, header.transaction, &answer);
                }
            }
            Ok(_) => {}
            Err(()) => self.rx.clear(),
        }
    }

    fn execute(&mut self, pdu: &[u8]) -> Pdu {
        let code = pdu.first().copied().unwrap_or_default();
        if let Some(fault) = self.faults.exception {
            return exception(code, fault);
        }
        let done = Request::decode(pdu).and_then(|request| self.carry_out(&request));
        match done {
            Ok(Some(data)) => answer(code, &data),
            // The answer to a write repeats its address and its value or count.
            Ok(None) => Pdu::from_slice(&pdu[..5.min(pdu.len())]).unwrap_or_default(),
            Err(why) => exception(code, why),
        }
    }

    fn carry_out(&mut self, request: &Request) -> Result<Option<Vec<u8, 250>>, Exception> {
        match request {
            Request::Read { table, address, count } => self.read(*table, *address, *count).map(Some),
            Request::WriteCoil { address, on } => self.write(Table::Coils, *address, &[u16::from(*on)]),
            Request::WriteRegister { address, word } => self.write(Table::HoldingRegisters, *address, &[*word]),
            Request::WriteCoils { address, bits } => {
                let words: Vec<u16, 0x7B0> = bits.iter().map(u16::from).collect();
                self.write(Table::Coils, *address, &words)
            }
            Request::WriteRegisters { address, words } => self.write(Table::HoldingRegisters, *address, words),
        }
    }

    fn read(&self, table: Table, address: u16, count: u16) -> Result<Vec<u8, 250>, Exception> {
        let mut data = Vec::new();
        for n in 0..count {
            let word = self.get(table, address + n).ok_or(Exception::ILLEGAL_ADDRESS)?;
            // At most 250 bytes, by the number of values.
            let _ = match (table.is_bits(), n % 8) {
                (false, _) => data.extend_from_slice(&word.to_be_bytes()),
                (true, 0) => data.push(u8::from(word != 0)).map_err(|_| Default::default()),
                (true, bit) => {
                    if let Some(byte) = data.last_mut() {
                        *byte |= u8::from(word != 0) << bit;
                    }
                    Ok(())
                }
            };
        }
        Ok(data)
    }

    fn write(&mut self, table: Table, address: u16, words: &[u16]) -> Result<Option<Vec<u8, 250>>, Exception> {
        let places = || (address..=u16::MAX).zip(words);
        if places().any(|(address, _)| self.get(table, address).is_none()) {
            return Err(Exception::ILLEGAL_ADDRESS);
        }
        for (address, word) in places() {
            self.set(table, address, *word);
        }
        self.writes = self.writes.saturating_add(1);
        Ok(None)
    }

    fn answer(&mut self, now: Instant, transaction: u16, pdu: &[u8]) {
        let Faults { mute, garbled, stranger, stale, cut, .. } = self.faults;
        if mute {
            return;
        }
        let unit = self.unit.wrapping_add(u8::from(stranger));
        let mut frame = self.line.frame(transaction.wrapping_sub(u16::from(stale)), unit, pdu);
        if garbled && let Some(byte) = frame.last_mut() {
            *byte ^= 0x55;
        }
        if cut {
            frame.truncate(frame.len() / 2);
        }
        self.answers.push((now + self.delay, frame));
    }

    /// Next bytes for the line.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        self.answers.front().filter(|(due, _)| *due <= now)?;
        let (_, bytes) = self.answers.pop()?;
        (!self.faults.unplugged).then_some(bytes)
    }

    /// Instant of the next [`Self::poll_tx`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.answers.front().map(|(due, _)| *due)
    }
}
