//! Bytes as people write them: hexadecimal, and text in single quotes: `02 'A1?' 0D`.

use core::fmt;
use heapless::Vec;

/// Bytes of one entry of a table at most.
pub const OCTETS_MAX: usize = 64;

/// Some bytes, at most [`OCTETS_MAX`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Octets(Vec<u8, OCTETS_MAX>);

impl Octets {
    /// Reads bytes: two hexadecimal digits each, with spaces between or without, and printable ASCII characters in
    /// single quotes. `None`: it is nothing of that, or longer than [`OCTETS_MAX`].
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut bytes = Vec::new();
        let mut rest = text.as_bytes();
        while let [first, behind @ ..] = rest {
            rest = match (first, behind) {
                (b' ', _) => behind,
                (b'\'', _) => {
                    let end = behind.iter().position(|byte| *byte == b'\'')?;
                    let quoted = &behind[..end];
                    if !quoted.iter().all(|byte| (b' '..=b'~').contains(byte)) {
                        return None;
                    }
                    bytes.extend_from_slice(quoted).ok()?;
                    &behind[end + 1..]
                }
                (high, [low, behind @ ..]) => {
                    bytes.push(digit(*high)? << 4 | digit(*low)?).ok()?;
                    behind
                }
                _ => return None,
            };
        }
        Some(Self(bytes))
    }

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &self.0
    }

    /// Their number.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// True without any.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Value of a hexadecimal digit.
pub(crate) fn digit(character: u8) -> Option<u8> {
    char::from(character).to_digit(16).map(|digit| digit as u8)
}

impl fmt::Display for Octets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, byte) in self.0.iter().enumerate() {
            let space = if n > 0 { " " } else { "" };
            write!(f, "{space}{byte:02X}")?;
        }
        Ok(())
    }
}
