//! Checks of frames: sums and CRCs in bytes, or as hexadecimal digits.

use crate::Bytes;
use crate::octets::digit;
use base::listed;
use heapless::Vec;

listed! {
    /// How a check is computed. Check values of the CRCs: of "123456789", by the catalogue of parametrised CRCs.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Method {
        /// Frames have no check.
        None => "none",
        /// Sum of the bytes, its low 8 bits.
        Sum8 => "sum8",
        /// Its two's complement: with it the sum of all bytes is 0.
        Sum8Negative => "sum8-negative",
        /// Exclusive or of the bytes.
        Xor8 => "xor8",
        /// CRC-8 with the polynomial of [`Check::polynomial`], begins with 0, most significant bit first.
        Crc8 => "crc8",
        /// CRC-16/MODBUS: low byte first on the line.
        Crc16Modbus => "crc16-modbus",
        /// CRC-16 with polynomial 0x1021, begins with 0xFFFF (IBM-3740, often called CCITT): high byte first.
        Crc16Ccitt => "crc16-ccitt",
        /// The same, begins with 0 (XMODEM).
        Crc16Xmodem => "crc16-xmodem",
        /// As sentences of NMEA 0183: `*` and two hexadecimal digits of the exclusive or of what is before.
        Nmea => "nmea",
    }
}

/// The check of all frames of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Check {
    /// How it is computed.
    pub method: Method,
    /// Polynomial of [`Method::Crc8`], without its highest term.
    pub polynomial: u8,
    /// The first byte that it covers; it covers all from there to its own place.
    pub from: usize,
    /// It is sent as hexadecimal digits, the highest first; always so with [`Method::Nmea`].
    pub text: bool,
}

impl Check {
    /// No check.
    pub const NONE: Self = Self { method: Method::None, polynomial: 0x07, from: 0, text: false };

    /// Bytes that it takes of a frame.
    #[must_use]
    pub fn len(&self) -> usize {
        match self.method {
            Method::None => 0,
            Method::Nmea => 3,
            Method::Crc16Modbus | Method::Crc16Ccitt | Method::Crc16Xmodem => 2 << u8::from(self.text),
            _ => 1 << u8::from(self.text),
        }
    }

    /// True if it takes no byte.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True if its bytes may have any value, so that no end of a frame can be recognised behind it.
    #[must_use]
    pub fn is_binary(&self) -> bool {
        !matches!(self.method, Method::None | Method::Nmea) && !self.text
    }

    /// What a frame with these bytes before its check has as check.
    fn of(&self, bytes: &[u8]) -> Vec<u8, 4> {
        let covered = bytes.get(self.from..).unwrap_or_default();
        let sum = || covered.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        let xor = || covered.iter().fold(0_u8, |sum, byte| sum ^ byte);
        let mut check = Vec::new();
        // At most four bytes, by `len`.
        let _ = match self.method {
            Method::None => Ok(()),
            Method::Sum8 => check.extend_from_slice(&[sum()]),
            Method::Sum8Negative => check.extend_from_slice(&[sum().wrapping_neg()]),
            Method::Xor8 | Method::Nmea => check.extend_from_slice(&[xor()]),
            Method::Crc8 => check.extend_from_slice(&[crc8(self.polynomial, covered)]),
            Method::Crc16Modbus if self.text => check.extend_from_slice(&reflected(covered).to_be_bytes()),
            Method::Crc16Modbus => check.extend_from_slice(&reflected(covered).to_le_bytes()),
            Method::Crc16Ccitt => check.extend_from_slice(&forward(0xFFFF, covered).to_be_bytes()),
            Method::Crc16Xmodem => check.extend_from_slice(&forward(0, covered).to_be_bytes()),
        };
        check
    }

    fn is_text(&self) -> bool {
        self.text || self.method == Method::Nmea
    }

    /// Appends it to what it covers; false if there is no room.
    #[must_use]
    pub fn append(&self, frame: &mut Bytes) -> bool {
        let check = self.of(frame);
        if !self.is_text() {
            return frame.extend_from_slice(&check).is_ok();
        }
        let star = self.method != Method::Nmea || frame.push(b'*').is_ok();
        let nibble = |nibble: u8| b"0123456789ABCDEF"[usize::from(nibble & 0x0F)];
        star && check.iter().flat_map(|byte| [nibble(byte >> 4), nibble(*byte)]).all(|digit| frame.push(digit).is_ok())
    }

    /// True if `check` is that of the bytes before it; digits may be of either case.
    #[must_use]
    pub fn holds(&self, bytes: &[u8], check: &[u8]) -> bool {
        let right = self.of(bytes);
        if !self.is_text() {
            return right == check;
        }
        let digits = match (self.method, check) {
            (Method::Nmea, [b'*', digits @ ..]) => digits,
            (Method::Nmea, _) => return false,
            (_, digits) => digits,
        };
        let pair = |pair: &[u8; 2]| Some(digit(pair[0])? << 4 | digit(pair[1])?);
        let (pairs, rest) = digits.as_chunks::<2>();
        rest.is_empty() && pairs.len() == right.len() && pairs.iter().map(pair).eq(right.iter().copied().map(Some))
    }
}

/// Frames are short, and a few a second: no tables.
fn crc8(polynomial: u8, bytes: &[u8]) -> u8 {
    let step = |crc: u8, _| (crc << 1) ^ if crc & 0x80 == 0 { 0 } else { polynomial };
    bytes.iter().fold(0, |crc, byte| (0..8).fold(crc ^ byte, step))
}

fn forward(initial: u16, bytes: &[u8]) -> u16 {
    let step = |crc: u16, _| (crc << 1) ^ if crc & 0x8000 == 0 { 0 } else { 0x1021 };
    bytes.iter().fold(initial, |crc, byte| (0..8).fold(crc ^ u16::from(*byte) << 8, step))
}

fn reflected(bytes: &[u8]) -> u16 {
    let step = |crc: u16, _| (crc >> 1) ^ if crc & 1 == 0 { 0 } else { 0xA001 };
    bytes.iter().fold(0xFFFF, |crc, byte| (0..8).fold(crc ^ u16::from(*byte), step))
}
