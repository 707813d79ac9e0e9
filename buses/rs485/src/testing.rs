//! What the tests of this crate share.

use base::serial::Word;
use std::format;
use std::string::String;
use std::vec::Vec;

pub use ::testing::Random;

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
