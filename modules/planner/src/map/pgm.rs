//! Portable graymaps, plain (P2) and raw (P5), of 8 and 16 bits: netpbm's `pgm(5)`.

use super::CELLS_MAX;
use std::fmt;

/// Picture: grey values from 0 (black) to `max` (white), the top row first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Number of pixels along x.
    pub width: usize,
    /// Number of pixels along y.
    pub height: usize,
    /// Value of white; 1 to 65535.
    pub max: u16,
    /// Grey values, row by row.
    pub grey: Vec<u16>,
}

/// Position and cause of a parse error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PgmError {
    /// Offset of the byte at which it was detected, from 0.
    pub byte: usize,
    /// Cause.
    pub why: Why,
}

/// Cause of a parse error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// Does not begin with P2 or P5 and white space.
    Magic,
    /// A number was expected here.
    Number(&'static str),
    /// A number is out of range.
    Range(&'static str, u64),
    /// More pixels than a map may have.
    Size(usize, usize),
    /// Ends before the last pixel.
    Truncated {
        /// Number of pixels present.
        have: usize,
        /// Number of pixels expected.
        want: usize,
    },
}

impl fmt::Display for PgmError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "byte {}: ", self.byte)?;
        match self.why {
            Why::Magic => write!(f, "not a PGM file: expected P2 or P5"),
            Why::Number(what) => write!(f, "expected the {what}, a number"),
            Why::Range(what, value) => write!(f, "the {what} is {value}: out of range"),
            Why::Size(width, height) => write!(f, "{width} × {height} pixels: expected 1 to {CELLS_MAX}"),
            Why::Truncated { have, want } => write!(f, "the picture ends after {have} of {want} pixels"),
        }
    }
}

impl std::error::Error for PgmError {}

/// Parses a picture. Bytes after the last pixel are ignored.
///
/// # Errors
/// The bytes are not a valid picture. Memory use is bounded by the number of bytes present, whatever the header
/// contains.
pub fn read(bytes: &[u8]) -> Result<Picture, PgmError> {
    let mut reader = Reader { bytes, at: 2 };
    let plain = match bytes {
        [b'P', b'2', space, ..] if space.is_ascii_whitespace() || *space == b'#' => true,
        [b'P', b'5', space, ..] if space.is_ascii_whitespace() || *space == b'#' => false,
        _ => return Err(PgmError { byte: 0, why: Why::Magic }),
    };
    let width = reader.number("width", 1, CELLS_MAX as u64)? as usize;
    let height = reader.number("height", 1, CELLS_MAX as u64)? as usize;
    let size = width.checked_mul(height).filter(|size| *size <= CELLS_MAX);
    let size = size.ok_or_else(|| reader.refuse(Why::Size(width, height)))?;
    let max = reader.number("white value", 1, 65535)? as u16;
    let grey = if plain { reader.plain(size, max) } else { reader.raw(size, max) }?;
    Ok(Picture { width, height, max, grey })
}

/// Writes a raw picture (P5): a byte per pixel, two if white is above 255. [`read`] reads the same.
#[must_use]
pub fn write(picture: &Picture) -> Vec<u8> {
    let mut bytes = format!("P5\n{} {}\n{}\n", picture.width, picture.height, picture.max).into_bytes();
    for grey in &picture.grey {
        let [high, low] = grey.to_be_bytes();
        bytes.extend((picture.max > 255).then_some(high));
        bytes.push(low);
    }
    bytes
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn refuse(&self, why: Why) -> PgmError {
        PgmError { byte: self.at, why }
    }

    /// Reads a decimal number after white space and comments.
    fn number(&mut self, what: &'static str, low: u64, high: u64) -> Result<u64, PgmError> {
        loop {
            match self.bytes.get(self.at) {
                Some(b'#') => {
                    while !matches!(self.bytes.get(self.at), None | Some(b'\n' | b'\r')) {
                        self.at += 1;
                    }
                }
                Some(byte) if byte.is_ascii_whitespace() => self.at += 1,
                _ => break,
            }
        }
        let begin = self.at;
        let mut value = 0u64;
        while let Some(digit @ b'0'..=b'9') = self.bytes.get(self.at) {
            value = value.saturating_mul(10).saturating_add(u64::from(digit - b'0'));
            self.at += 1;
        }
        let ends = self.bytes.get(self.at).is_none_or(|byte| byte.is_ascii_whitespace() || *byte == b'#');
        let why = match (self.at > begin && ends, (low..=high).contains(&value)) {
            (true, true) => return Ok(value),
            (true, false) => Why::Range(what, value),
            (false, _) => Why::Number(what),
        };
        Err(PgmError { byte: begin, why })
    }

    fn plain(&mut self, size: usize, max: u16) -> Result<Vec<u16>, PgmError> {
        // A pixel takes at least two bytes.
        let mut grey = Vec::with_capacity(size.min(self.bytes.len() / 2));
        while grey.len() < size {
            match self.number("grey value", 0, u64::from(max)) {
                Ok(value) => grey.push(value as u16),
                Err(_) if self.at >= self.bytes.len() => {
                    return Err(self.refuse(Why::Truncated { have: grey.len(), want: size }));
                }
                Err(error) => return Err(error),
            }
        }
        Ok(grey)
    }

    fn raw(&mut self, size: usize, max: u16) -> Result<Vec<u16>, PgmError> {
        // A single white space ends the header; the rest is picture data.
        if !self.bytes.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            return Err(self.refuse(Why::Truncated { have: 0, want: size }));
        }
        let begin = self.at + 1;
        let deep = if max > 255 { 2 } else { 1 };
        let body = &self.bytes[begin..];
        if body.len() < size * deep {
            self.at = self.bytes.len();
            return Err(self.refuse(Why::Truncated { have: body.len() / deep, want: size }));
        }
        let value = |pixel: &[u8]| pixel.iter().fold(0u16, |value, byte| value << 8 | u16::from(*byte));
        let grey: Vec<u16> = body[..size * deep].chunks_exact(deep).map(value).collect();
        match grey.iter().position(|value| *value > max) {
            None => Ok(grey),
            Some(at) => Err(PgmError { byte: begin + at * deep, why: Why::Range("grey value", u64::from(grey[at])) }),
        }
    }
}
