//! One word of a 9-bit serial line. The ninth bit marks the first word of a frame, its address; how nine bits
//! cross a real port (two bytes, or mark and space parity) is the transport's affair.

/// Eight data bits and the ninth, as the wire carries them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Word {
    /// The eight data bits.
    pub byte: u8,
    /// The ninth bit: set on an address word.
    pub ninth: bool,
}

impl Word {
    /// A word with the ninth bit set: it starts a frame.
    #[must_use]
    pub const fn address(byte: u8) -> Self {
        Self { byte, ninth: true }
    }

    /// A word with the ninth bit clear.
    #[must_use]
    pub const fn data(byte: u8) -> Self {
        Self { byte, ninth: false }
    }
}
