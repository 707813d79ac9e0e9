//! Decompression of Zstandard frames (RFC 8878) without a dictionary, into memory.
//!
//! Chunks of a log are small frames whose whole content is wanted at once. There is no window beside the output: a
//! match is copied within it. Every length and offset of the frame is checked against what is there, so bad input ends
//! in `None`; a block adds at most [`BLOCK_MAX`] bytes, whatever the frame announces.

mod bits;
mod block;
mod fse;
mod huffman;

use block::Decoder as Blocks;

/// Maximum size of a block's content, bytes (RFC 8878, 3.1.1.2.4).
const BLOCK_MAX: usize = 128 << 10;
/// Bytes that a copy in pieces may write beyond its end.
pub const SLACK: usize = 16;
/// First bytes of a frame.
const MAGIC: u32 = 0xFD2F_B528;
/// First bytes of a frame to be skipped, with any of the lowest four bits.
const SKIPPED: u32 = 0x184D_2A50;

/// Decompressor. Keeps its tables' memory from frame to frame.
#[derive(Default)]
pub struct Decoder {
    blocks: Box<Blocks>,
}

impl Decoder {
    /// Appends the content of all frames in `input` to `out`, which then has at most `max` bytes. `None` if a frame is
    /// damaged, cut off, longer than that, or needs a dictionary; `out` is then of no use.
    pub fn expand(&mut self, mut input: &[u8], max: usize, out: &mut Vec<u8>) -> Option<()> {
        while !input.is_empty() {
            let magic = u32::from_le_bytes(*split(&mut input)?);
            if magic == MAGIC {
                self.frame(&mut input, max, out)?;
            } else if magic & !0xF == SKIPPED {
                let size = u32::from_le_bytes(*split(&mut input)?);
                input = input.get(usize::try_from(size).ok()?..)?;
            } else {
                return None;
            }
        }
        Some(())
    }

    /// A frame behind its magic number.
    fn frame(&mut self, input: &mut &[u8], max: usize, out: &mut Vec<u8>) -> Option<()> {
        let [descriptor] = *split(input)?;
        let (single, has_checksum) = (descriptor & 1 << 5 != 0, descriptor & 1 << 2 != 0);
        if descriptor & 1 << 3 != 0 {
            return None;
        }
        if !single {
            split::<1>(input)?;
        }
        let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
        let (dictionary, rest) = input.split_at_checked(dictionary)?;
        if dictionary.iter().any(|byte| *byte != 0) {
            return None;
        }
        // The content's size is that of the chunk, which is compared by the caller.
        let size = match descriptor >> 6 {
            0 => usize::from(single),
            flag => 1 << flag,
        };
        *input = rest.get(size..)?;
        self.blocks.begin(out.len());
        loop {
            let [a, b, c] = *split(input)?;
            let head = u32::from_le_bytes([a, b, c, 0]);
            let size = (head >> 3) as usize;
            if size > BLOCK_MAX {
                return None;
            }
            match head >> 1 & 3 {
                0 => {
                    let (content, rest) = input.split_at_checked(size)?;
                    *input = rest;
                    room(out, size, max)?;
                    out.extend_from_slice(content);
                }
                1 => {
                    let [byte] = *split(input)?;
                    room(out, size, max)?;
                    out.resize(out.len() + size, byte);
                }
                2 => {
                    let (content, rest) = input.split_at_checked(size)?;
                    *input = rest;
                    self.blocks.decode(content, max, out)?;
                }
                _ => return None,
            }
            if head & 1 != 0 {
                break;
            }
        }
        if has_checksum {
            // Chunks have a checksum of their own.
            split::<4>(input)?;
        }
        Some(())
    }
}

/// Checks that `size` more bytes are no more than `max` in all.
fn room(out: &[u8], size: usize, max: usize) -> Option<()> {
    (size <= max.checked_sub(out.len())?).then_some(())
}

/// Takes the next bytes.
fn split<'a, const N: usize>(input: &mut &'a [u8]) -> Option<&'a [u8; N]> {
    let (head, rest) = input.split_first_chunk()?;
    *input = rest;
    Some(head)
}

#[cfg(test)]
mod tests;
