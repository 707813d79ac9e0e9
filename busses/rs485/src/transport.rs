//! How nine bits reach user space: codecs between bytes of a port and words of the line. Each decoder takes a byte
//! at a time, so that reads may be split anywhere.

use base::serial::Word;

/// The `two-byte` transport (`docs/facts/boards.md` 1): the low byte, then 0x01 where the ninth bit is set, else 0x00.
#[derive(Debug, Default)]
pub struct TwoByte {
    low: Option<u8>,
    slips: u32,
}

impl TwoByte {
    /// A codec that expects a low byte.
    #[must_use]
    pub const fn new() -> Self {
        Self { low: None, slips: 0 }
    }

    /// The bytes of a word, in the order they are written.
    #[must_use]
    pub const fn encode(word: Word) -> [u8; 2] {
        [word.byte, word.ninth as u8]
    }

    /// Takes the next byte read; gives a word with each second one.
    ///
    /// A second byte that is neither 0 nor 1 tells that a byte was lost or added: the first one is dropped, the
    /// second is taken for a low byte, and the slip is counted. The CRC judges what was read until then.
    pub fn decode(&mut self, byte: u8) -> Option<Word> {
        let Some(low) = self.low.take() else {
            self.low = Some(byte);
            return None;
        };
        match byte {
            0 => Some(Word::data(low)),
            1 => Some(Word::address(low)),
            _ => {
                self.low = Some(byte);
                self.slips = self.slips.saturating_add(1);
                None
            }
        }
    }

    /// How often it lost step.
    #[must_use]
    pub fn slips(&self) -> u32 {
        self.slips
    }

    /// Expects a low byte next: the port was opened anew. The count of slips stays.
    pub fn reset(&mut self) {
        self.low = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn decode(codec: &mut TwoByte, bytes: &[u8]) -> Vec<Word> {
        bytes.iter().filter_map(|byte| codec.decode(*byte)).collect()
    }

    #[test]
    fn a_request_is_ten_bytes() {
        let words = crate::testing::words("20! 01 00 00 9c");
        let bytes: Vec<u8> = words.iter().copied().flat_map(TwoByte::encode).collect();
        assert_eq!(bytes, [0x20, 1, 0x01, 0, 0x00, 0, 0x00, 0, 0x9C, 0]);
        assert_eq!(decode(&mut TwoByte::new(), &bytes), words);
    }

    #[test]
    fn every_word_survives_and_reads_may_be_split_anywhere() {
        let words: Vec<Word> = (0..=255).flat_map(|byte| [false, true].map(|ninth| Word { byte, ninth })).collect();
        let bytes: Vec<u8> = words.iter().copied().flat_map(TwoByte::encode).collect();
        for size in [1, 2, 3, 7] {
            let mut codec = TwoByte::new();
            let read: Vec<Word> = bytes.chunks(size).flat_map(|chunk| decode(&mut codec, chunk)).collect();
            assert_eq!((read, codec.slips()), (words.clone(), 0));
        }
    }

    #[test]
    fn a_lost_byte_costs_a_word_or_two_and_is_counted() {
        let mut codec = TwoByte::new();
        // The 0 after the first 0x11 is lost.
        let words = decode(&mut codec, &[0x11, 0x20, 1, 0x33, 0]);
        assert_eq!(words, crate::testing::words("20! 33"));
        assert_eq!(codec.slips(), 1);
    }

    #[test]
    fn a_reopened_port_starts_with_a_low_byte() {
        let mut codec = TwoByte::new();
        assert_eq!(codec.decode(0x01), None);
        codec.reset();
        assert_eq!(decode(&mut codec, &[0x20, 1]), crate::testing::words("20!"));
    }

    #[test]
    fn after_any_bytes_the_words_of_an_address_above_1_are_read_right() {
        let mut random = crate::testing::Random::new(4);
        let mut codec = TwoByte::new();
        let words = crate::testing::words("20! 01 00 00 9c");
        let bytes: Vec<u8> = words.iter().copied().flat_map(TwoByte::encode).collect();
        for _ in 0..100_000 {
            for _ in 0..random.next() % 9 {
                codec.decode(random.next() as u8 % 5);
            }
            let read = decode(&mut codec, &bytes);
            assert!(read.ends_with(&words), "{read:?}");
        }
    }
}
