//! What the tests of this crate share.

use base::serial::Word;
use std::format;
use std::string::String;
use std::vec::Vec;

/// Words from text: hexadecimal bytes, `!` after one with the ninth bit set.
pub fn words(text: &str) -> Vec<Word> {
    let word = |token: &str| {
        let (byte, ninth) = token.strip_suffix('!').map_or((token, false), |byte| (byte, true));
        Word { byte: u8::from_str_radix(byte, 16).unwrap(), ninth }
    };
    text.split_whitespace().map(word).collect()
}

/// Text of words, as [`words`] reads it.
pub fn text(words: &[Word]) -> String {
    let word = |word: &Word| format!("{:02x}{}", word.byte, if word.ninth { "!" } else { "" });
    words.iter().map(word).collect::<Vec<_>>().join(" ")
}

/// A small deterministic generator (xorshift64*).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 16
    }

    /// True once in `n`.
    pub fn one_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }
}
