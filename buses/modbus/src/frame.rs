//! Frames: RTU (Modbus over Serial Line V1.02, 2.5.1), and the MBAP header of TCP (Messaging on TCP/IP V1.0b, 3.1.3).

use crate::crc::crc16;
use base::Duration;
use heapless::Vec;

/// Maximum length of a frame, of TCP.
pub const LEN_MAX: usize = 260;
/// Maximum length of an RTU frame.
pub(crate) const RTU_LEN_MAX: usize = 256;
/// Bytes of a frame.
pub type Bytes = Vec<u8, LEN_MAX>;

/// Length of the MBAP header, with the unit.
pub(crate) const HEADER: usize = 7;

/// A character: start bit, eight data bits, parity or a second stop bit, stop bit.
const BITS: u64 = 11;
/// Above this rate the times are fixed (2.5.1.1).
const FIXED_ABOVE: u32 = 19_200;

/// A pause that a computer may make of characters without a pause: latency timer of USB adapters (16 ms), scheduling.
pub const LATENCY: Duration = Duration::from_millis(30);

/// How frames travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A serial line.
    Rtu {
        /// Bd.
        baud: u32,
    },
    /// A TCP connection.
    Tcp,
}

/// Rate of a model of a TCP connection.
const TCP_BAUD: u32 = 10_000_000;

impl Line {
    /// Bd; of a TCP connection the rate of its model in virtual time.
    #[must_use]
    pub const fn baud(self) -> u32 {
        match self {
            Self::Rtu { baud } => baud,
            Self::Tcp => TCP_BAUD,
        }
    }

    /// Time of `count` characters on the line.
    #[must_use]
    pub fn time_of(self, count: usize) -> Duration {
        match self {
            Self::Rtu { baud } => {
                Duration::from_nanos((count as u64 * BITS * 1_000_000_000).div_ceil(baud.max(1).into()))
            }
            Self::Tcp => Duration::ZERO,
        }
    }

    /// t1.5: the longest pause between the characters of a frame.
    #[must_use]
    pub fn t1_5(self) -> Duration {
        match self {
            Self::Rtu { baud } if baud > FIXED_ABOVE => Duration::from_micros(750),
            line => line.time_of(3) / 2,
        }
    }

    /// t3.5: the shortest pause between two frames.
    #[must_use]
    pub fn t3_5(self) -> Duration {
        match self {
            Self::Rtu { baud } if baud > FIXED_ABOVE => Duration::from_micros(1750),
            line => line.time_of(7) / 2,
        }
    }

    /// Length of a frame with a PDU of `len` bytes.
    #[must_use]
    pub(crate) fn frame_len(self, len: usize) -> usize {
        match self {
            Self::Rtu { .. } => len + 3,
            Self::Tcp => len + HEADER,
        }
    }

    /// The frame; `transaction` for TCP.
    pub(crate) fn frame(self, transaction: u16, unit: u8, pdu: &[u8]) -> Bytes {
        let mut bytes = Bytes::new();
        // At most 253 bytes of a PDU, and the header.
        let mut put = |part: &[u8]| _ = bytes.extend_from_slice(part);
        match self {
            Self::Rtu { .. } => {
                put(&[unit]);
                put(pdu);
                let crc = crc16(&bytes);
                let _ = bytes.extend_from_slice(&crc.to_le_bytes());
            }
            Self::Tcp => {
                put(&transaction.to_be_bytes());
                put(&[0, 0]);
                put(&(pdu.len() as u16 + 1).to_be_bytes());
                put(&[unit]);
                put(pdu);
            }
        }
        bytes
    }
}

/// PDU of an RTU frame with its unit; `None`: too short or long, or its checksum is wrong.
pub(crate) fn rtu(frame: &[u8]) -> Option<(u8, &[u8])> {
    let (body, crc) = frame.split_last_chunk::<2>()?;
    let (unit, pdu) = body.split_first()?;
    let is_whole = !pdu.is_empty() && frame.len() <= RTU_LEN_MAX && crc16(body) == u16::from_le_bytes(*crc);
    is_whole.then_some((*unit, pdu))
}

/// An MBAP header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    pub transaction: u16,
    pub unit: u8,
    /// Length of the whole frame.
    pub len: usize,
}

impl Header {
    /// Reads the header at the start of `bytes`; `Ok(None)` if more is needed.
    ///
    /// # Errors
    /// It is no header: the stream is out of step.
    pub fn read(bytes: &[u8]) -> Result<Option<Self>, ()> {
        let [t0, t1, p0, p1, l0, l1, unit, ..] = *bytes else { return Ok(None) };
        let len = usize::from(u16::from_be_bytes([l0, l1]));
        // The unit, a function code, and at most the rest of a PDU.
        if (p0, p1) != (0, 0) || !(2..=LEN_MAX - HEADER + 1).contains(&len) {
            return Err(());
        }
        Ok(Some(Self { transaction: u16::from_be_bytes([t0, t1]), unit, len: len + HEADER - 1 }))
    }
}
