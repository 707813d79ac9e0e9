//! The concise DCF (CiA 302-3, 0x1F22): a configuration in one stream, as a manager keeps it.

use crate::master::ConfigWrite;
use alloc::vec::Vec;
use core::fmt;

/// Why a stream is no concise DCF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConciseError {
    /// Ends within an entry.
    Truncated {
        /// Which entry, from 0.
        entry: u32,
    },
    /// Bytes are left behind the last entry.
    Rest {
        /// Number of them.
        len: usize,
    },
}

impl fmt::Display for ConciseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated { entry } => write!(f, "ends within entry {entry}"),
            Self::Rest { len } => write!(f, "{len} bytes behind the last entry"),
        }
    }
}

impl core::error::Error for ConciseError {}

/// The stream of these writes, in their order: their number, then index, sub-index, size and data of each.
#[must_use]
pub fn write_concise(writes: &[ConfigWrite]) -> Vec<u8> {
    let mut stream = Vec::from((writes.len() as u32).to_le_bytes());
    for write in writes {
        stream.extend(write.index.to_le_bytes());
        stream.push(write.sub);
        stream.extend((write.value.len() as u32).to_le_bytes());
        stream.extend_from_slice(&write.value);
    }
    stream
}

/// The writes of a stream. Takes no more memory than the stream does.
///
/// # Errors
/// It is cut off, or longer than it says.
pub fn read_concise(stream: &[u8]) -> Result<Vec<ConfigWrite>, ConciseError> {
    let truncated = |entry| ConciseError::Truncated { entry };
    let (count, mut rest) = stream.split_first_chunk().ok_or(truncated(0))?;
    let mut writes = Vec::new();
    for entry in 0..u32::from_le_bytes(*count) {
        let (head, body) = rest.split_first_chunk::<7>().ok_or(truncated(entry))?;
        let [a, b, sub, len @ ..] = *head;
        let len = usize::try_from(u32::from_le_bytes(len)).map_err(|_| truncated(entry))?;
        let (data, left) = body.split_at_checked(len).ok_or(truncated(entry))?;
        writes.push(ConfigWrite::new(u16::from_le_bytes([a, b]), sub, data));
        rest = left;
    }
    if rest.is_empty() { Ok(writes) } else { Err(ConciseError::Rest { len: rest.len() }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_is_written_and_read_again() {
        let writes = [ConfigWrite::new(0x6081, 0, 1000_u32), ConfigWrite::new(0x1017, 2, 100_u16)];
        let stream = write_concise(&writes);
        let expected = [
            [2, 0, 0, 0].as_slice(),
            &[0x81, 0x60, 0, 4, 0, 0, 0, 0xE8, 3, 0, 0],
            &[0x17, 0x10, 2, 2, 0, 0, 0, 100, 0],
        ];
        assert_eq!(stream, expected.concat());
        assert_eq!(read_concise(&stream).unwrap(), writes);
        assert_eq!(read_concise(&[0; 4]), Ok(Vec::new()));
    }

    #[test]
    fn a_stream_that_is_cut_off_or_too_long_is_refused() {
        let stream = write_concise(&[ConfigWrite::new(0x6081, 0, 1000_u32), ConfigWrite::new(0x1017, 0, 100_u16)]);
        for len in 0..stream.len() {
            let entry = u32::from(len >= 15);
            assert_eq!(read_concise(&stream[..len]), Err(ConciseError::Truncated { entry }), "{len}");
        }
        let longer = [&*stream, &[0, 0]].concat();
        assert_eq!(read_concise(&longer), Err(ConciseError::Rest { len: 2 }));
        // A number of entries and a size that lie cost nothing.
        assert_eq!(read_concise(&[0xFF; 4]), Err(ConciseError::Truncated { entry: 0 }));
        assert_eq!(read_concise(&[0xFF; 11]), Err(ConciseError::Truncated { entry: 0 }));
    }
}
