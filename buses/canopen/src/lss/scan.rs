//! The fastscan: an address found bit by bit, by answers or their absence (CiA 305, LSS fastscan).
//!
//! Each question names a prefix; a slave whose address begins with it answers. So no answer to a 0 means that the bit
//! is 1, or that a frame was lost: the whole word is asked once more at its end, and that must be answered. Slaves that
//! share the bus drop out as soon as a bit of theirs is 1 where another one's is 0: the lowest address is found.

use super::Address;
use super::wire::FastScan;

/// Progress of a scan.
#[derive(Clone, Copy, Debug)]
enum Phase {
    /// Is anybody there?
    Reset,
    /// Is this bit of this word 0?
    Bit { word: u8, bit: u8 },
    /// Is this the whole word?
    Check { word: u8 },
}

/// Next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Next {
    /// Ask [`Scan::request`].
    Ask,
    /// The one found is in the configuration state now.
    Found(Address),
    /// No answer to the first request.
    Nobody,
    /// No slave has the word that was assembled.
    Contradiction,
}

/// Requests of a scan: the first one, and the bits and a check of each word.
const REQUESTS: u8 = 1 + 4 * (32 + 1);

/// A scan: at most [`REQUESTS`] requests.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scan {
    words: [u32; 4],
    phase: Phase,
}

impl Scan {
    pub(super) fn new() -> Self {
        Self { words: [0; 4], phase: Phase::Reset }
    }

    pub(super) fn request(&self) -> FastScan {
        match self.phase {
            Phase::Reset => FastScan { number: 0, bit_check: FastScan::RESET, sub: 0, next: 0 },
            Phase::Bit { word, bit } => {
                FastScan { number: self.words[usize::from(word)], bit_check: bit, sub: word, next: word }
            }
            Phase::Check { word } => {
                FastScan { number: self.words[usize::from(word)], bit_check: 0, sub: word, next: (word + 1) % 4 }
            }
        }
    }

    /// Share of its requests that are behind it, 0 to 1.
    pub(super) fn share(&self) -> f64 {
        let behind = match self.phase {
            Phase::Reset => 0,
            Phase::Bit { word, bit } => 1 + 33 * word + (31 - bit),
            Phase::Check { word } => 33 * (word + 1),
        };
        f64::from(behind) / f64::from(REQUESTS)
    }

    /// True if the question was answered.
    pub(super) fn advance(&mut self, heard: bool) -> Next {
        self.phase = match (self.phase, heard) {
            (Phase::Reset, false) => return Next::Nobody,
            (Phase::Reset, true) => Phase::Bit { word: 0, bit: 31 },
            (Phase::Bit { word, bit }, _) => {
                self.words[usize::from(word)] |= u32::from(!heard) << bit;
                if bit == 0 { Phase::Check { word } } else { Phase::Bit { word, bit: bit - 1 } }
            }
            (Phase::Check { .. }, false) => return Next::Contradiction,
            (Phase::Check { word: 3 }, true) => return Next::Found(Address::from_words(self.words)),
            (Phase::Check { word }, true) => Phase::Bit { word: word + 1, bit: 31 },
        };
        Next::Ask
    }
}
