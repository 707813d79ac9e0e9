//! Transport of nine bits through a port: codecs between its bytes and the words of the line. Each decoder takes a byte
//! at a time, so reads may be split anywhere. [`TwoByte`] and [`NinthFirst`] are the whole of their transports; for
//! `parity`, [`Parity`] decodes, and [`runs`] gives the bytes between two changes of a tty's parity, which the host
//! makes.

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
    /// A second byte that is neither 0 nor 1 shows that a byte was lost or added: the first one is dropped, the second
    /// is taken as a low byte, and the slip is counted. The CRC covers the damage.
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

    /// Number of slips.
    #[must_use]
    pub fn slips(&self) -> u32 {
        self.slips
    }

    /// Expects a low byte next, after the port was opened again. The count of slips stays.
    pub fn reset(&mut self) {
        self.low = None;
    }
}

/// The `ninth-first` transport (`docs/facts/boards.md` 1): 0x01 where the ninth bit is set, else 0x00, then the low
/// byte. The nine-bit ports of the TS-7800's own driver use this order, and drop a first byte that is neither.
#[derive(Debug, Default)]
pub struct NinthFirst {
    /// Of a word whose low byte is due.
    ninth: Option<bool>,
    /// The byte before, while it may have been the first one of a word.
    before: Option<bool>,
    slips: u32,
}

impl NinthFirst {
    /// A codec that expects the ninth bit.
    #[must_use]
    pub const fn new() -> Self {
        Self { ninth: None, before: None, slips: 0 }
    }

    /// The bytes of a word, in the order they are written.
    #[must_use]
    pub const fn encode(word: Word) -> [u8; 2] {
        [word.ninth as u8, word.byte]
    }

    /// Takes the next byte read; gives a word with each second one.
    ///
    /// A first byte that is neither 0 nor 1 shows that a byte was lost or added: it is the low byte of a word whose
    /// ninth bit was the byte before, if that can have been one; the slip is counted. The CRC covers the damage.
    pub fn decode(&mut self, byte: u8) -> Option<Word> {
        let bit = match byte {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        };
        let before = core::mem::replace(&mut self.before, bit);
        if let Some(ninth) = self.ninth.take() {
            return Some(Word { byte, ninth });
        }
        self.ninth = bit;
        if bit.is_some() {
            return None;
        }
        self.slips = self.slips.saturating_add(1);
        before.map(|ninth| Word { byte, ninth })
    }

    /// Number of slips.
    #[must_use]
    pub fn slips(&self) -> u32 {
        self.slips
    }

    /// Expects a ninth bit next, after the port was opened again. The count of slips stays.
    pub fn reset(&mut self) {
        (self.ninth, self.before) = (None, None);
    }
}

/// The receiving half of the `parity` transport (`docs/facts/boards.md` 1): a tty in space parity with `INPCK` and
/// `PARMRK`, where the kernel (`n_tty`) writes a word with the ninth bit set as `FF 00 xx` and a literal `FF` as `FF
/// FF`.
///
/// The same three bytes stand for a word whose stop bit is missing, and `FF 00 00` for a break: both read as an address
/// word. That is harmless: an address word only ever starts a frame anew, no board has address 0, and a line that is
/// broken has damaged the frame that was under way.
#[derive(Debug, Default)]
pub struct Parity {
    state: Mark,
    slips: u32,
}

/// Progress of a mark sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mark {
    #[default]
    None,
    /// `FF` was read.
    Escape,
    /// `FF 00` was read.
    Error,
}

impl Parity {
    /// A codec that is in the middle of nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self { state: Mark::None, slips: 0 }
    }

    /// Takes the next byte read; gives a word with each last byte of one.
    ///
    /// A byte after `FF` that is neither 0 nor `FF` shows that one was lost (or that the port does not mark): the `FF`
    /// is dropped, the byte is taken as a data word, and the slip is counted.
    pub fn decode(&mut self, byte: u8) -> Option<Word> {
        let (state, word) = match (self.state, byte) {
            (Mark::None, 0xFF) => (Mark::Escape, None),
            (Mark::None, byte) => (Mark::None, Some(Word::data(byte))),
            (Mark::Escape, 0x00) => (Mark::Error, None),
            (Mark::Escape, 0xFF) => (Mark::None, Some(Word::data(0xFF))),
            (Mark::Escape, byte) => {
                self.slips = self.slips.saturating_add(1);
                (Mark::None, Some(Word::data(byte)))
            }
            // A marked FF is not doubled.
            (Mark::Error, byte) => (Mark::None, Some(Word::address(byte))),
        };
        self.state = state;
        word
    }

    /// Number of sequences that no kernel writes.
    #[must_use]
    pub fn slips(&self) -> u32 {
        self.slips
    }

    /// Drops half a word, after the port was opened again. The count of slips stays.
    pub fn reset(&mut self) {
        self.state = Mark::None;
    }
}

/// The sending half of the `parity` transport: runs of words that go out in one parity setting, mark for those with the
/// ninth bit set (true), space for the others. A run must have left the wire before the parity changes for the next.
pub fn runs(words: &[Word]) -> impl Iterator<Item = (bool, &[Word])> {
    words.chunk_by(|a, b| a.ninth == b.ninth).map(|run| (run[0].ninth, run))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
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

    fn decode_ninth_first(codec: &mut NinthFirst, bytes: &[u8]) -> Vec<Word> {
        bytes.iter().filter_map(|byte| codec.decode(*byte)).collect()
    }

    #[test]
    fn ninth_first_is_the_other_order() {
        let words = crate::testing::words("20! 01 00 00 9c");
        let bytes: Vec<u8> = words.iter().copied().flat_map(NinthFirst::encode).collect();
        assert_eq!(bytes, [1, 0x20, 0, 0x01, 0, 0x00, 0, 0x00, 0, 0x9C]);
        assert_eq!(decode_ninth_first(&mut NinthFirst::new(), &bytes), words);
        // Neither order is taken for the other.
        assert_ne!(decode(&mut TwoByte::new(), &bytes), words);
    }

    #[test]
    fn ninth_first_every_word_survives_and_reads_may_be_split_anywhere() {
        let words: Vec<Word> = (0..=255).flat_map(|byte| [false, true].map(|ninth| Word { byte, ninth })).collect();
        let bytes: Vec<u8> = words.iter().copied().flat_map(NinthFirst::encode).collect();
        for size in [1, 2, 3, 7] {
            let mut codec = NinthFirst::new();
            let read: Vec<Word> = bytes.chunks(size).flat_map(|chunk| decode_ninth_first(&mut codec, chunk)).collect();
            assert_eq!((read, codec.slips()), (words.clone(), 0));
        }
    }

    #[test]
    fn ninth_first_a_lost_byte_is_counted_and_a_reopened_port_starts_anew() {
        let mut codec = NinthFirst::new();
        // The low byte of the first word is lost: 0x01 is taken for it, and 0x20 shows that it was none.
        assert_eq!(decode_ninth_first(&mut codec, &[0, 1, 0x20, 0, 0x33]), crate::testing::words("01 20! 33"));
        assert_eq!(codec.slips(), 1);
        assert_eq!(codec.decode(1), None);
        codec.reset();
        assert_eq!(decode_ninth_first(&mut codec, &[0, 0x20]), crate::testing::words("20"));
    }

    #[test]
    fn ninth_first_after_any_bytes_the_words_of_an_address_above_1_are_read_right() {
        let mut random = crate::testing::Random::new(4);
        let mut codec = NinthFirst::new();
        let words = crate::testing::words("20! 01 00 00 9c");
        let bytes: Vec<u8> = words.iter().copied().flat_map(NinthFirst::encode).collect();
        for _ in 0..100_000 {
            for _ in 0..random.next() % 9 {
                codec.decode(random.next() as u8 % 5);
            }
            let read = decode_ninth_first(&mut codec, &bytes);
            assert!(read.ends_with(&words), "{read:?}");
        }
    }

    fn unmark(codec: &mut Parity, bytes: &[u8]) -> Vec<Word> {
        bytes.iter().filter_map(|byte| codec.decode(*byte)).collect()
    }

    /// What happens on a line.
    #[derive(Clone, Copy)]
    enum Heard {
        Word(Word),
        /// The stop bit of a word is missing.
        Framing(u8),
        Break,
    }

    /// What Linux writes for it into the buffer of a raw tty in space parity with `INPCK | PARMRK`, neither `IGNPAR`
    /// nor `IGNBRK`: typed from termios(3), PARMRK, and from `n_tty`'s three cases.
    fn kernel(heard: Heard) -> Vec<u8> {
        match heard {
            Heard::Word(Word { byte: 0xFF, ninth: false }) => vec![0xFF, 0xFF],
            Heard::Word(Word { byte, ninth: false }) => vec![byte],
            Heard::Word(Word { byte, ninth: true }) | Heard::Framing(byte) => vec![0xFF, 0x00, byte],
            Heard::Break => vec![0xFF, 0x00, 0x00],
        }
    }

    #[test]
    fn marks_read_as_seen_on_a_real_port() {
        // docs/facts: an FTDI model in space mode sent this for address 42, 10, FF, 20.
        let mut codec = Parity::new();
        assert_eq!(
            unmark(&mut codec, &[0xFF, 0x00, 0x42, 0x10, 0xFF, 0xFF, 0x20]),
            crate::testing::words("42! 10 ff 20")
        );
        assert_eq!(unmark(&mut codec, &[0xFF, 0x00, 0xFF, 0x00]), crate::testing::words("ff! 00"), "FF, marked");
        assert_eq!(unmark(&mut codec, &[0xFF, 0xFF, 0x00, 0x42]), crate::testing::words("ff 00 42"), "no mark");
        assert_eq!(codec.slips(), 0);
    }

    #[test]
    fn whatever_a_line_does_is_read_as_the_kernel_tells_it_however_reads_are_split() {
        let mut random = crate::testing::Random::new(485);
        for round in 0..200 {
            let heard: Vec<Heard> = (0..64)
                .map(|_| match random.next() % 16 {
                    0 => Heard::Break,
                    1 => Heard::Framing(random.next() as u8),
                    // Bytes that look like parts of a mark are the ones to get wrong.
                    n if n < 9 => {
                        Heard::Word(Word { byte: [0x00, 0xFF][random.next() as usize % 2], ninth: n % 2 == 0 })
                    }
                    n => Heard::Word(Word { byte: random.next() as u8, ninth: n % 2 == 0 }),
                })
                .collect();
            let expected: Vec<Word> = heard
                .iter()
                .map(|heard| match *heard {
                    Heard::Word(word) => word,
                    Heard::Framing(byte) => Word::address(byte),
                    Heard::Break => Word::address(0),
                })
                .collect();
            let bytes: Vec<u8> = heard.iter().flat_map(|heard| kernel(*heard)).collect();
            let mut codec = Parity::new();
            let read: Vec<Word> = bytes.chunks(1 + round % 5).flat_map(|chunk| unmark(&mut codec, chunk)).collect();
            assert_eq!((read, codec.slips()), (expected, 0));
        }
    }

    #[test]
    fn any_three_bytes_leave_the_codec_ready_for_the_next_address() {
        for n in 0..1u32 << 24 {
            // All of them with the bytes that matter, every 97th of the others.
            let bytes = [n as u8, (n >> 8) as u8, (n >> 16) as u8];
            if n % 97 != 0 && !bytes.iter().all(|byte| [0x00, 0x01, 0xFE, 0xFF].contains(byte)) {
                continue;
            }
            let mut codec = Parity::new();
            let garbage = unmark(&mut codec, &bytes).len();
            assert!(garbage <= 3);
            // A mark that was begun swallows at most the first byte of the next one: two plain words bring it in step.
            unmark(&mut codec, &[0x55, 0x55]);
            assert_eq!(unmark(&mut codec, &[0xFF, 0x00, 0x20, 0x01]), crate::testing::words("20! 01"), "{bytes:02x?}");
        }
    }

    #[test]
    fn a_lost_byte_of_a_mark_is_counted_and_a_reopened_port_starts_anew() {
        let mut codec = Parity::new();
        // The 00 of a mark is lost.
        assert_eq!(unmark(&mut codec, &[0xFF, 0x20, 0x01]), crate::testing::words("20 01"));
        assert_eq!(codec.slips(), 1);
        assert_eq!(unmark(&mut codec, &[0xFF, 0x00]), []);
        codec.reset();
        assert_eq!(unmark(&mut codec, &[0x20]), crate::testing::words("20"));
    }

    #[test]
    fn a_frame_is_sent_in_two_runs_and_frames_back_to_back_in_four() {
        let split = |text: &str| -> Vec<_> {
            let words = crate::testing::words(text);
            runs(&words).map(|(mark, run)| (mark, crate::testing::text(run))).collect()
        };
        assert_eq!(split("20! 01 00 00 9c"), [(true, "20!".into()), (false, "01 00 00 9c".into())]);
        assert_eq!(split("20! 01 11! 02").len(), 4);
        assert_eq!(split("").len(), 0);
    }
}
