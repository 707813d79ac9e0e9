//! The frame on the wire (`docs/facts/boards.md` 1): address, instruction, flags or status, length, data, CRC.
//! Stateless.

use crate::crc::Crc8;
use base::serial::Word;
use heapless::Vec;

/// Most data bytes of a frame.
pub const MAX_DATA: usize = 255;
/// Words before the data.
pub const HEADER: usize = 4;
/// Words of a frame besides its data.
pub const OVERHEAD: usize = HEADER + 1;
/// Words of the longest frame.
pub const MAX_WORDS: usize = MAX_DATA + OVERHEAD;

/// The address that all slaves obey and none answers.
pub const BROADCAST: u8 = 0xFF;
/// Instruction of every device: read the firmware version.
pub const VERSION: u8 = 0xFE;
/// Instruction of every device: reset yourself.
pub const RESET: u8 = 0xFF;

/// Request flag: repeat the last response.
pub const RESEND: u8 = 0x01;
/// Request flag: do not answer.
pub const NO_ACK: u8 = 0x02;

/// Status of a request in its response, in the place of the flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// Done.
    Ok = 0x00,
    /// The instruction is known but could not be done.
    Error = 0x01,
    /// The request came with a wrong CRC.
    BadCrc = 0x02,
    /// The board does not know the instruction.
    UnknownInstruction = 0x03,
}

impl Status {
    /// The status of a byte on the wire; none for a byte that is no status.
    #[must_use]
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0x00 => Some(Self::Ok),
            0x01 => Some(Self::Error),
            0x02 => Some(Self::BadCrc),
            0x03 => Some(Self::UnknownInstruction),
            _ => None,
        }
    }
}

/// A frame, its data borrowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// The slave that is asked, or that answers.
    pub address: u8,
    /// Instruction; repeated in the answer.
    pub instruction: u8,
    /// Request: [`RESEND`], [`NO_ACK`]. Response: a [`Status`].
    pub flags: u8,
    /// At most [`MAX_DATA`] bytes.
    pub data: &'a [u8],
}

/// The words of a frame.
pub type Words = Vec<Word, MAX_WORDS>;

impl<'a> Frame<'a> {
    /// Frame of bytes whose last is the CRC; `None` if their number contradicts the length byte. The CRC is not
    /// checked: see [`intact`].
    #[must_use]
    pub fn decode(bytes: &'a [u8]) -> Option<Self> {
        let [address, instruction, flags, length, rest @ ..] = bytes else {
            return None;
        };
        let (_crc, data) = rest.split_last()?;
        (data.len() == usize::from(*length)).then_some(Self {
            address: *address,
            instruction: *instruction,
            flags: *flags,
            data,
        })
    }

    /// Puts the frame's words in place of what `words` holds; data beyond [`MAX_DATA`] bytes is cut off.
    pub fn encode(&self, crc: Crc8, words: &mut Words) {
        let data = &self.data[..self.data.len().min(MAX_DATA)];
        words.clear();
        let header = [self.address, self.instruction, self.flags, data.len() as u8];
        words.extend(header.into_iter().chain(data.iter().copied()).chain([0]).map(Word::data));
        words[0].ninth = true;
        seal(crc, words);
    }
}

/// Gives an encoded frame other flags and the CRC that belongs to them.
pub fn set_flags(crc: Crc8, words: &mut Words, flags: u8) {
    if words.len() >= OVERHEAD {
        words[2].byte = flags;
        seal(crc, words);
    }
}

/// True if the last of `bytes` is the CRC of those before it.
#[must_use]
pub fn intact(crc: Crc8, bytes: &[u8]) -> bool {
    bytes.split_last().is_some_and(|(last, covered)| crc.of(covered.iter().copied()) == *last)
}

fn seal(crc: Crc8, words: &mut Words) {
    if let Some((last, covered)) = words.split_last_mut() {
        last.byte = crc.of(covered.iter().map(|word| word.byte));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn bytes(words: &Words) -> Vec<u8> {
        words.iter().map(|word| word.byte).collect()
    }

    #[test]
    fn a_request_stands_on_the_wire_as_the_table_says() {
        let mut words = Words::new();
        Frame { address: 0x20, instruction: 0x01, flags: 0, data: &[] }.encode(Crc8::SAE_J1850, &mut words);
        // CRC computed by another program.
        assert_eq!(bytes(&words), [0x20, 0x01, 0x00, 0x00, 0x9C]);
        assert!(words[0].ninth && words[1..].iter().all(|word| !word.ninth));
        set_flags(Crc8::SAE_J1850, &mut words, RESEND);
        assert_eq!(bytes(&words), [0x20, 0x01, 0x01, 0x00, 0xD0]);
    }

    #[test]
    fn decoding_undoes_encoding_for_every_length() {
        let data: Vec<u8> = (0..=255).collect();
        let mut words = Words::new();
        for length in 0..=MAX_DATA {
            let frame = Frame { address: 0x10, instruction: 0x02, flags: 3, data: &data[..length] };
            frame.encode(Crc8::SAE_J1850, &mut words);
            let bytes = bytes(&words);
            assert!(intact(Crc8::SAE_J1850, &bytes));
            assert_eq!(Frame::decode(&bytes), Some(frame));
            assert_eq!(Frame::decode(&bytes[..bytes.len() - 1]), None);
        }
    }

    #[test]
    fn too_much_data_is_cut_off() {
        let mut words = Words::new();
        Frame { address: 1, instruction: 2, flags: 0, data: &[7; 300] }.encode(Crc8::SAE_J1850, &mut words);
        assert_eq!(words.len(), MAX_WORDS);
    }
}
