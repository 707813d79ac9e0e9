//! SMBus commands as transfers, and the decoding of their outcomes; with a packet error code (PEC) or without.
//!
//! SMBus 3.2, chapter 6.5; the figures' symbols are in `tests`. Blocks have 1 to 32 bytes, as up to SMBus 2.0 and as
//! Linux has them.

use base::i2c::{self, Address, Bytes, Outcome, Read, Transfer};
use core::fmt;

/// The most bytes of a block.
pub const BLOCK_MAX: usize = 32;

/// The bytes of a block.
pub type Block = heapless::Vec<u8, BLOCK_MAX>;

/// Alert response address: a chip whose alert line is low answers with its own address, [`Command::ReceiveByte`] (SMBus
/// 3.2, appendix B).
pub const ALERT_RESPONSE: u8 = 0x0C;

/// A command of SMBus 3.2, section 6.5; `code` is the command code, at most chips a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// 6.5.1: the read bit is the whole command. After a read bit some chips hold SDA: only for chips that expect it.
    Quick {
        /// The bit: read, not write.
        read: bool,
    },
    /// 6.5.2
    SendByte(u8),
    /// 6.5.3
    ReceiveByte,
    /// 6.5.4
    WriteByte {
        /// The command code.
        code: u8,
        /// Value to write.
        value: u8,
    },
    /// 6.5.4
    WriteWord {
        /// The command code.
        code: u8,
        /// Value to write, low byte first.
        value: u16,
    },
    /// 6.5.5
    ReadByte {
        /// The command code.
        code: u8,
    },
    /// 6.5.5
    ReadWord {
        /// The command code.
        code: u8,
    },
    /// 6.5.6: writes a word and reads one.
    ProcessCall {
        /// The command code.
        code: u8,
        /// Value to write, low byte first.
        value: u16,
    },
    /// 6.5.7
    BlockWrite {
        /// The command code.
        code: u8,
        /// 1 to 32 bytes.
        data: &'a [u8],
    },
    /// 6.5.7
    BlockRead {
        /// The command code.
        code: u8,
    },
    /// 6.5.8: writes a block and reads one.
    BlockProcessCall {
        /// The command code.
        code: u8,
        /// 1 to 32 bytes; with those of the answer 32 at most, which only the chip can know.
        data: &'a [u8],
    },
    /// 6.5.10
    Write32 {
        /// The command code.
        code: u8,
        /// Value to write, low byte first.
        value: u32,
    },
    /// 6.5.11
    Read32 {
        /// The command code.
        code: u8,
    },
    /// 6.5.12
    Write64 {
        /// The command code.
        code: u8,
        /// Value to write, low byte first.
        value: u64,
    },
    /// 6.5.13
    Read64 {
        /// The command code.
        code: u8,
    },
}

/// Value read by a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// No value: a write.
    Nothing,
    /// A byte.
    Byte(u8),
    /// Two bytes, low byte first.
    Word(u16),
    /// Four bytes, low byte first.
    Word32(u32),
    /// Eight bytes, low byte first.
    Word64(u64),
    /// 1 to 32 bytes.
    Block(Block),
}

/// Why a command brought no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The transfer failed.
    Bus(i2c::Error),
    /// Wrong packet error code: the transfer was damaged.
    Pec {
        /// PEC received.
        got: u8,
        /// PEC computed.
        want: u8,
    },
    /// Invalid block length: 0, or more than 32.
    Length(u8),
    /// The adapter returned another number of bytes than requested.
    Count {
        /// Number of bytes returned.
        got: usize,
        /// Number of bytes requested.
        want: usize,
    },
}

/// A block to be written has no bytes, or more than 32. Nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadBlock {
    /// Number of bytes.
    pub len: usize,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => error.fmt(f),
            Self::Pec { got, want } => write!(f, "the packet error code is {got:02x}, and should be {want:02x}"),
            Self::Length(len) => write!(f, "the chip says that its block has {len} bytes; 1 to 32 are allowed"),
            Self::Count { got, want } => write!(f, "the adapter brought {got} bytes where {want} were asked for"),
        }
    }
}

impl core::error::Error for Error {}

impl fmt::Display for BadBlock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a block has 1 to {BLOCK_MAX} bytes, not {}", self.len)
    }
}

impl core::error::Error for BadBlock {}

impl Command<'_> {
    /// Transfer of this command to `address`; with a PEC if `pec`. A quick command has none.
    pub fn transfer(&self, address: Address, pec: bool) -> Result<Transfer, BadBlock> {
        let mut write = Bytes::new();
        // 35 bytes at most: code, length, 32, PEC.
        let mut put = |bytes: &[u8]| write.extend(bytes.iter().copied());
        match *self {
            Self::Quick { .. } | Self::ReceiveByte => {}
            Self::SendByte(value) => put(&[value]),
            Self::WriteByte { code, value } => put(&[code, value]),
            Self::ReadByte { code }
            | Self::ReadWord { code }
            | Self::BlockRead { code }
            | Self::Read32 { code }
            | Self::Read64 { code } => put(&[code]),
            Self::WriteWord { code, value } | Self::ProcessCall { code, value } => {
                put(&[code]);
                put(&value.to_le_bytes());
            }
            Self::Write32 { code, value } => {
                put(&[code]);
                put(&value.to_le_bytes());
            }
            Self::Write64 { code, value } => {
                put(&[code]);
                put(&value.to_le_bytes());
            }
            Self::BlockWrite { code, data } | Self::BlockProcessCall { code, data } => {
                if data.is_empty() || data.len() > BLOCK_MAX {
                    return Err(BadBlock { len: data.len() });
                }
                put(&[code, data.len() as u8]);
                put(data);
            }
        }
        let read = match self.reads() {
            Reads::Nothing => Read::None,
            Reads::Quick => Read::Exactly(0),
            Reads::Bytes(count) => Read::Exactly(count + u8::from(pec)),
            Reads::Block => Read::Block { extra: u8::from(pec) },
        };
        let mut transfer = Transfer { address, write, read };
        if pec && read == Read::None && !transfer.write.is_empty() {
            let code = pec_of(&transfer, &[]);
            transfer.write.extend([code]);
        }
        Ok(transfer)
    }

    /// Decodes the outcome of [`Self::transfer`], made with the same arguments.
    pub fn answer(&self, address: Address, pec: bool, outcome: &Outcome) -> Result<Answer, Error> {
        let mut bytes: &[u8] = outcome.as_ref().map_err(|error| Error::Bus(*error))?;
        let reads = self.reads();
        if matches!(reads, Reads::Nothing | Reads::Quick) {
            return expect(bytes, 0).map(|()| Answer::Nothing);
        }
        if reads == Reads::Block {
            let len = *bytes.first().ok_or(Error::Count { got: 0, want: 1 })?;
            if len == 0 || usize::from(len) > BLOCK_MAX {
                return Err(Error::Length(len));
            }
        }
        let want = usize::from(reads.count(bytes[..].first().copied().unwrap_or(0)));
        expect(bytes, want + usize::from(pec))?;
        if let (true, Some((got, covered))) = (pec, bytes.split_last()) {
            // The block of a process call was checked with the request, so there is a transfer.
            let want = self.transfer(address, true).map_or(0, |transfer| pec_of(&transfer, covered));
            if *got != want {
                return Err(Error::Pec { got: *got, want });
            }
            bytes = covered;
        }
        Ok(match (reads, bytes) {
            (Reads::Block, [_, data @ ..]) => Answer::Block(data.iter().copied().collect()),
            (_, &[byte]) => Answer::Byte(byte),
            (_, &[a, b]) => Answer::Word(u16::from_le_bytes([a, b])),
            (_, &[a, b, c, d]) => Answer::Word32(u32::from_le_bytes([a, b, c, d])),
            (_, &[a, b, c, d, e, f, g, h]) => Answer::Word64(u64::from_le_bytes([a, b, c, d, e, f, g, h])),
            // No command reads another number.
            _ => return Err(Error::Count { got: bytes.len(), want }),
        })
    }

    const fn reads(&self) -> Reads {
        match self {
            Self::Quick { read: true } => Reads::Quick,
            Self::ReceiveByte | Self::ReadByte { .. } => Reads::Bytes(1),
            Self::ReadWord { .. } | Self::ProcessCall { .. } => Reads::Bytes(2),
            Self::Read32 { .. } => Reads::Bytes(4),
            Self::Read64 { .. } => Reads::Bytes(8),
            Self::BlockRead { .. } | Self::BlockProcessCall { .. } => Reads::Block,
            Self::Quick { read: false }
            | Self::SendByte(_)
            | Self::WriteByte { .. }
            | Self::WriteWord { .. }
            | Self::BlockWrite { .. }
            | Self::Write32 { .. }
            | Self::Write64 { .. } => Reads::Nothing,
        }
    }
}

/// Data that a command reads, without the PEC.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Reads {
    Nothing,
    Quick,
    Bytes(u8),
    Block,
}

impl Reads {
    /// Number of bytes, given the first of them.
    const fn count(self, first: u8) -> u8 {
        match self {
            Self::Nothing | Self::Quick => 0,
            Self::Bytes(count) => count,
            Self::Block => 1 + first,
        }
    }
}

fn expect(bytes: &[u8], want: usize) -> Result<(), Error> {
    if bytes.len() == want { Ok(()) } else { Err(Error::Count { got: bytes.len(), want }) }
}

/// The PEC of a transfer, its address bytes included (SMBus 3.2, 6.4): what it writes, then, behind the address
/// with the read bit, the bytes `read`.
#[must_use]
pub fn pec_of(transfer: &Transfer, read: &[u8]) -> u8 {
    let write_address = transfer.address.get() << 1;
    let written = transfer.write.iter().fold(crc8(0, write_address), |crc, byte| crc8(crc, *byte));
    let start = if transfer.begins_with_read() { 0 } else { written };
    if !transfer.reads() {
        return written;
    }
    read.iter().fold(crc8(start, write_address | 1), |crc, byte| crc8(crc, *byte))
}

/// CRC-8, polynomial 0x07, goes on by a byte; begins with 0.
#[must_use]
pub const fn crc8(crc: u8, byte: u8) -> u8 {
    CRC[(crc ^ byte) as usize]
}

const CRC: [u8; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = (byte as u8, 0);
        while bit < 8 {
            crc = (crc << 1) ^ if crc & 0x80 == 0 { 0 } else { 0x07 };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
};

#[cfg(test)]
mod tests;
