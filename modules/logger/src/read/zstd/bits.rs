//! Bits of a frame: forwards in descriptions of tables, backwards in what they decode.

/// Reads from the end of the bytes to their begin. The last byte's highest set bit ends the stream.
pub struct Backward<'a> {
    bytes: &'a [u8],
    /// Bits not read yet; negative behind the begin, where all bits are 0.
    left: isize,
    /// The next bits, highest first: at least 57 of them after [`Backward::reload`].
    word: u64,
}

impl<'a> Backward<'a> {
    /// `None` if the end is not marked.
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        let last = *bytes.last().filter(|last| **last != 0)?;
        let left = 8 * bytes.len() as isize - last.leading_zeros() as isize - 1;
        let mut this = Self { bytes, left, word: 0 };
        this.reload();
        Some(this)
    }

    /// Bits not read yet; negative if more were read than there are.
    #[inline]
    pub fn left(&self) -> isize {
        self.left
    }

    /// Makes 57 bits available to [`Backward::take`] and [`Backward::peek`].
    #[inline]
    pub fn reload(&mut self) {
        if self.left > 56 {
            let end = (self.left as usize).div_ceil(8);
            let word = self.bytes.get(end - 8..).and_then(|bytes| bytes.first_chunk());
            self.word = word.map_or(0, |word| u64::from_le_bytes(*word)) << (8 * end - self.left as usize);
        } else {
            self.reload_last();
        }
    }

    /// At most 56 bits are left.
    #[inline]
    fn reload_last(&mut self) {
        let left = u32::try_from(self.left).unwrap_or(0);
        let word = match self.bytes.first_chunk() {
            Some(word) => u64::from_le_bytes(*word),
            None => self.bytes.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte)),
        };
        self.word = word.checked_shl(64 - left).unwrap_or(0);
    }

    /// The next bits, at most 63, as a number.
    #[inline]
    pub fn take(&mut self, bits: u32) -> usize {
        let value = self.word >> 1 >> (63 - bits);
        self.skip(bits);
        value as usize
    }

    /// The next bits, 1 to 64, which are not taken.
    #[inline]
    pub fn peek(&self, bits: u32) -> usize {
        (self.word >> (64 - bits)) as usize
    }

    /// Takes bits, at most 63.
    #[inline]
    pub fn skip(&mut self, bits: u32) {
        self.word <<= bits;
        self.left -= bits as isize;
    }
}

/// Reads from the begin, lowest bit first.
pub struct Forward<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Forward<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next bits, at most 16; behind the end all bits are 0.
    pub fn peek(&self, bits: usize) -> u32 {
        let byte = |place: usize| u32::from(self.bytes.get(self.at / 8 + place).copied().unwrap_or(0));
        (byte(0) | byte(1) << 8 | byte(2) << 16) >> (self.at % 8) & ((1 << bits) - 1)
    }

    pub fn skip(&mut self, bits: usize) {
        self.at += bits;
    }

    /// The bytes behind the last one of which bits were taken; `None` if there were not as many.
    pub fn rest(&self) -> Option<&'a [u8]> {
        self.bytes.get(self.at.div_ceil(8)..)
    }
}
