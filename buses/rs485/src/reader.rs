//! Reception, word by word: bounded, counted, and never stuck, whatever arrives.

use crate::crc::Crc8;
use crate::frame::{Frame, HEADER, MAX_WORDS, OVERHEAD, intact};
use base::serial::Word;
use base::{Duration, Instant};
use heapless::Vec;

/// Counters of a reader.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames with a right CRC.
    pub frames: u32,
    /// Frames with a wrong CRC.
    pub crc_errors: u32,
    /// Frames cut short by the address word of another.
    pub restarts: u32,
    /// Frames dropped for a gap between two words.
    pub gaps: u32,
    /// Words that belong to no frame: no address word came before them.
    pub stray_words: u32,
}

/// Frame completed by its last word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received<'a> {
    /// A frame with a right CRC.
    Frame(Frame<'a>),
    /// A frame with a wrong one: nothing in it can be trusted.
    BadCrc(Frame<'a>),
}

/// The reception automaton of either side of the bus.
#[derive(Debug)]
pub struct Reader {
    crc: Crc8,
    gap: Option<Duration>,
    bytes: Vec<u8, MAX_WORDS>,
    last: Instant,
    untidy: bool,
    complete: bool,
    counters: Counters,
}

impl Reader {
    /// A reader that waits for an address word. With `gap`, a frame whose next word comes later than that after the
    /// one before it is dropped (a slave: 5 ms; a master has its response timeout instead, as its host may stall).
    #[must_use]
    pub fn new(crc: Crc8, gap: Option<Duration>) -> Self {
        let counters = Counters::default();
        Self { crc, gap, bytes: Vec::new(), last: Instant::ZERO, untidy: false, complete: false, counters }
    }

    /// Takes one word that ended at `at`.
    pub fn push(&mut self, at: Instant, word: Word) -> Option<Received<'_>> {
        if self.complete {
            self.complete = false;
            self.bytes.clear();
        }
        if !self.bytes.is_empty() && self.gap.is_some_and(|gap| at.since(self.last) > gap) {
            self.bytes.clear();
            self.untidy = true;
            count(&mut self.counters.gaps);
        }
        self.last = at;
        match (word.ninth, self.bytes.is_empty()) {
            (true, true) => {}
            (true, false) => {
                // The ninth bit always starts a frame (`docs/facts/boards.md` 1).
                self.bytes.clear();
                self.untidy = true;
                count(&mut self.counters.restarts);
            }
            (false, true) => {
                self.untidy = true;
                count(&mut self.counters.stray_words);
                return None;
            }
            (false, false) => {}
        }
        // Room for the longest frame; a frame ends at its own length, so this is never refused.
        let _ = self.bytes.push(word.byte);
        let length = usize::from(*self.bytes.get(HEADER - 1)?);
        if self.bytes.len() < length + OVERHEAD { None } else { self.finish() }
    }

    fn finish(&mut self) -> Option<Received<'_>> {
        self.complete = true;
        let frame = Frame::decode(&self.bytes)?;
        if intact(self.crc, &self.bytes) {
            self.untidy = false;
            count(&mut self.counters.frames);
            Some(Received::Frame(frame))
        } else {
            self.untidy = true;
            count(&mut self.counters.crc_errors);
            Some(Received::BadCrc(frame))
        }
    }

    /// Forgets an unfinished frame; the counters stay.
    pub fn reset(&mut self) {
        self.bytes.clear();
        self.untidy = false;
        self.complete = false;
    }

    /// Forgets what was untidy until now, but not an unfinished frame: on a full-duplex link one may be under way.
    pub fn tidy(&mut self) {
        self.untidy = false;
    }

    /// True if a frame has begun and not ended.
    #[must_use]
    pub fn is_under_way(&self) -> bool {
        !(self.complete || self.bytes.is_empty())
    }

    /// True if anything but whole and right frames came since [`Reader::reset`] or the last right frame.
    #[must_use]
    pub fn is_untidy(&self) -> bool {
        self.untidy || self.is_under_way()
    }

    /// Counters.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, words};
    use std::string::String;

    /// Feeds words 100 us apart; `+N` lets N ms pass first. Says what came out.
    fn read(reader: &mut Reader, text: &str) -> String {
        let mut at = reader.last;
        let mut out = String::new();
        for token in text.split_whitespace() {
            if let Some(pause) = token.strip_prefix('+') {
                at += Duration::from_millis(pause.parse().unwrap());
                continue;
            }
            at += Duration::from_micros(100);
            match reader.push(at, words(token)[0]) {
                Some(Received::Frame(frame)) => out += &std::format!("[{:02x?}]", frame.data),
                Some(Received::BadCrc(_)) => out += "[bad crc]",
                None => {}
            }
        }
        out
    }

    fn reader() -> Reader {
        Reader::new(Crc8::SAE_J1850, Some(Duration::from_millis(5)))
    }

    #[test]
    fn a_frame_comes_out_with_its_last_word() {
        let mut reader = reader();
        assert_eq!(read(&mut reader, "20! 01 00 04 01 00 ff ff"), "");
        assert!(reader.is_untidy());
        assert_eq!(read(&mut reader, "36"), "[[01, 00, ff, ff]]");
        assert!(!reader.is_untidy());
    }

    #[test]
    fn the_ninth_bit_starts_a_frame_in_the_middle_of_another() {
        let mut reader = reader();
        assert_eq!(read(&mut reader, "20! 01 00 04 01 20! 01 00 00 9c"), "[[]]");
        assert_eq!(reader.counters(), Counters { frames: 1, restarts: 1, ..Counters::default() });
    }

    #[test]
    fn a_gap_of_more_than_5_ms_drops_the_frame() {
        let mut reader = reader();
        assert_eq!(read(&mut reader, "20! 01 +4 00 00 9c"), "[[]]");
        assert_eq!(read(&mut reader, "20! 01 +5 00 00 9c 20! 01 00 00 9c"), "[[]]");
        assert_eq!(reader.counters(), Counters { frames: 2, gaps: 1, stray_words: 3, ..Counters::default() });
    }

    #[test]
    fn a_reader_without_a_gap_waits_as_long_as_it_takes() {
        assert_eq!(read(&mut Reader::new(Crc8::SAE_J1850, None), "20! 01 +500 00 00 9c"), "[[]]");
    }

    #[test]
    fn a_wrong_crc_is_said_and_the_next_frame_is_read() {
        let mut reader = reader();
        assert_eq!(read(&mut reader, "20! 01 00 00 a4 20! 01 00 00 9c"), "[bad crc][[]]");
        assert_eq!(reader.counters(), Counters { frames: 1, crc_errors: 1, ..Counters::default() });
    }

    #[test]
    fn words_before_the_first_address_are_counted_and_ignored() {
        let mut reader = reader();
        assert_eq!(read(&mut reader, "01 00 00 20! 01 00 00 9c"), "[[]]");
        assert_eq!(reader.counters().stray_words, 3);
    }

    #[test]
    fn random_words_never_panic_and_pass_one_frame_in_256() {
        let mut reader = Reader::new(Crc8::SAE_J1850, None);
        let mut random = Random::new(1);
        for _ in 0..2_000_000 {
            // One word in 16 starts a frame, one in 8 is small, so that short frames abound.
            let bits = random.next();
            let byte = if bits & 0x700 == 0 { bits as u8 & 7 } else { bits as u8 };
            let word = Word { byte, ninth: bits & 0xF000 == 0 };
            reader.push(Instant::ZERO, word);
        }
        let Counters { frames, crc_errors, .. } = reader.counters();
        let one_in = f64::from(frames + crc_errors) / f64::from(frames);
        assert!((200.0..330.0).contains(&one_in), "one in {one_in}");
    }

    #[test]
    fn after_any_garbage_the_next_good_frame_is_understood() {
        let mut random = Random::new(9);
        for gap in [None, Some(Duration::from_millis(5))] {
            let mut reader = Reader::new(Crc8::SAE_J1850, gap);
            for _ in 0..100_000 {
                // From almost no ninth bits to only such; as long as the longest frame, or longer.
                let share = 1 + random.next() % 64;
                for _ in 0..random.next() % 300 {
                    let word = Word { byte: random.next() as u8, ninth: random.one_in(share) };
                    reader.push(Instant::ZERO, word);
                }
                assert_eq!(read(&mut reader, "20! 01 00 04 01 00 ff ff 36"), "[[01, 00, ff, ff]]");
            }
        }
    }

    #[test]
    fn words_without_ninth_bits_are_no_frame_whatever_they_say() {
        let mut reader = Reader::new(Crc8::SAE_J1850, None);
        assert_eq!(read(&mut reader, &"20 01 00 04 01 00 ff ff 36 ".repeat(100)), "");
        assert_eq!(reader.counters(), Counters { stray_words: 900, ..Counters::default() });
    }
}
