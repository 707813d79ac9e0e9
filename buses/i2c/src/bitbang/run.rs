//! Which symbol comes next in a transfer. Knows no lines and no time.

use crate::target::expected;
use base::i2c::{Address, Bytes, Error, Read, Transfer};

/// Purpose of a clock pulse, or of a START without one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Symbol {
    Start,
    /// START again, on a bus that is ours.
    Restart,
    /// A bit of ours: of a byte, or our ACK (low) or NACK.
    Send(bool),
    /// A bit, or an ACK, of the target's.
    Receive,
    Stop,
    /// Recovery pulse for a target that holds SDA; the number left, this one included.
    Clock {
        left: u8,
    },
}

impl Symbol {
    /// The level that SDA is given while SCL is low.
    pub fn sda(self) -> bool {
        match self {
            Self::Send(bit) => bit,
            Self::Start | Self::Restart | Self::Receive | Self::Clock { .. } => true,
            Self::Stop => false,
        }
    }

    /// True if SDA moves while SCL is high.
    pub fn has_edge(self) -> bool {
        matches!(self, Self::Restart | Self::Stop)
    }

    /// True if this level of SDA while SCL is high shows another master on the bus (UM10204 3.1.8).
    pub fn contended(self, sda: bool) -> bool {
        !sda && matches!(self, Self::Send(true) | Self::Restart)
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Next {
    Symbol(Symbol),
    /// START, without waiting for the bus: SDA was just seen high.
    Begin,
    /// Bus recovered: the transfer starts again.
    Listen,
    Done(Result<(), Error>),
}

/// A transfer under way.
#[derive(Debug)]
pub(super) struct Run {
    transfer: Transfer,
    part: Part,
    /// Bits of this byte that were sent or received; the ninth is the ACK.
    bit: u8,
    byte: u8,
    read: Bytes,
    recovered: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// The START, and the address byte that follows one; with the read bit or not.
    Address {
        read: bool,
    },
    /// Which byte is written.
    Write(u8),
    Read,
    /// STOP, then the outcome.
    Stop(Result<(), Error>),
    /// Clocks, START and STOP for a target that holds SDA.
    Recovery,
}

impl Default for Run {
    /// Before the first transfer.
    fn default() -> Self {
        const NOBODY: Address = Address::new(0).expect("seven bits");
        Self::new(Transfer { address: NOBODY, write: Bytes::new(), read: Read::None })
    }
}

impl Run {
    pub fn new(transfer: Transfer) -> Self {
        let part = Part::Address { read: transfer.begins_with_read() };
        Self { transfer, part, bit: 0, byte: 0, read: Bytes::new(), recovered: false }
    }

    /// Bytes read.
    pub fn take_read(&mut self) -> Bytes {
        core::mem::take(&mut self.read)
    }

    /// True if nine clocks were tried for it.
    pub fn recovered(&self) -> bool {
        self.recovered
    }

    /// Step after `symbol`, with this level of SDA while SCL was high.
    pub fn next(&mut self, symbol: Symbol, sda: bool) -> Next {
        match (symbol, self.part) {
            (Symbol::Clock { left }, _) => self.clocked(left, sda),
            (Symbol::Start, Part::Recovery) => Next::Symbol(Symbol::Stop),
            (Symbol::Stop, Part::Recovery) => {
                self.part = Part::Address { read: self.transfer.begins_with_read() };
                Next::Listen
            }
            (Symbol::Stop, Part::Stop(result)) => Next::Done(result),
            (Symbol::Start | Symbol::Restart, Part::Address { read }) => {
                // UM10204 3.1.10: seven bits, then the direction.
                let byte = self.transfer.address.get() << 1 | u8::from(read);
                self.send(byte)
            }
            (_, Part::Read) => self.reading(sda),
            // The only symbols left are bits of the address or of what is written.
            _ => self.writing(sda),
        }
    }

    fn clocked(&mut self, left: u8, sda: bool) -> Next {
        self.recovered = true;
        self.part = Part::Recovery;
        match left {
            _ if sda => Next::Begin,
            0 | 1 => Next::Done(Err(Error::Stuck)),
            _ => Next::Symbol(Symbol::Clock { left: left - 1 }),
        }
    }

    /// The first bit of a byte of ours.
    fn send(&mut self, byte: u8) -> Next {
        (self.byte, self.bit) = (byte, 0);
        Next::Symbol(Symbol::Send(byte & 0x80 != 0))
    }

    fn writing(&mut self, sda: bool) -> Next {
        self.bit += 1;
        match self.bit {
            1..8 => Next::Symbol(Symbol::Send(self.byte << self.bit & 0x80 != 0)),
            8 => Next::Symbol(Symbol::Receive),
            _ if sda => {
                let error = match self.part {
                    Part::Write(at) => Error::NoData { at },
                    _ => Error::NoAddress,
                };
                self.stop(Err(error))
            }
            _ => self.acknowledged(),
        }
    }

    /// A byte of ours was taken.
    fn acknowledged(&mut self) -> Next {
        let written = match self.part {
            Part::Write(at) => at + 1,
            _ => 0,
        };
        let read_bit = self.part == Part::Address { read: true };
        match self.transfer.write.get(usize::from(written)).copied() {
            _ if read_bit && expected(self.transfer.read, None) == 0 => self.stop(Ok(())),
            _ if read_bit => {
                (self.part, self.bit, self.byte) = (Part::Read, 0, 0);
                Next::Symbol(Symbol::Receive)
            }
            Some(byte) => {
                self.part = Part::Write(written);
                self.send(byte)
            }
            None if self.transfer.reads() => {
                self.part = Part::Address { read: true };
                Next::Symbol(Symbol::Restart)
            }
            None => self.stop(Ok(())),
        }
    }

    fn reading(&mut self, sda: bool) -> Next {
        self.bit += 1;
        match self.bit {
            1..8 => {
                self.byte = self.byte << 1 | u8::from(sda);
                Next::Symbol(Symbol::Receive)
            }
            8 => {
                // `expected` is never more than there is room for.
                self.read.extend([self.byte << 1 | u8::from(sda)]);
                // The last byte gets a NACK, so that the target lets go of SDA (UM10204 3.1.6).
                let last = self.is_complete();
                Next::Symbol(Symbol::Send(last))
            }
            _ if self.is_complete() => self.stop(Ok(())),
            _ => {
                (self.bit, self.byte) = (0, 0);
                Next::Symbol(Symbol::Receive)
            }
        }
    }

    fn is_complete(&self) -> bool {
        self.read.len() >= expected(self.transfer.read, self.read.first().copied())
    }

    fn stop(&mut self, result: Result<(), Error>) -> Next {
        self.part = Part::Stop(result);
        Next::Symbol(Symbol::Stop)
    }
}
