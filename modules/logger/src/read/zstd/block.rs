//! Compressed blocks: literals, and sequences that copy them and what was there before (RFC 8878, 3.1.1.3).

use super::bits::Backward;
use super::fse::{Meaning, Table};
use super::huffman::Codes;
use super::{BLOCK_MAX, SLACK};

/// Bits added to codes of literal lengths; the codes' values follow each other without a gap.
const LITERALS: [u8; 36] =
    [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16];
/// Bits added to codes of match lengths.
const MATCHES: [u8; 53] = [
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2,
    3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16,
];
/// Length of the shortest match, bytes.
const MATCH_MIN: u32 = 3;
/// Largest code of an offset.
const OFFSET_CODE_MAX: u8 = 31;
/// Extra bits of a sequence that leave enough of 57 bits for the next states, of 9, 9 and 8 bits.
const EXTRA_USUAL: u8 = 30;

const LITERAL_BASES: [u32; 36] = bases(0, &LITERALS);
const MATCH_BASES: [u32; 53] = bases(MATCH_MIN, &MATCHES);

const fn bases<const N: usize>(first: u32, bits: &[u8; N]) -> [u32; N] {
    let mut bases = [first; N];
    let mut code = 1;
    while code < N {
        bases[code] = bases[code - 1] + (1 << bits[code - 1]);
        code += 1;
    }
    bases
}

/// A table of sequences.
struct Kind {
    meaning: Meaning,
    log_max: u8,
    /// The table that needs no description: bits of a state, shares of the symbols.
    usual: (u8, &'static [i16]),
}

/// Lengths of literals, offsets, lengths of matches.
const KINDS: [Kind; 3] = [
    Kind {
        meaning: |code| Some((*LITERAL_BASES.get(usize::from(code))?, LITERALS[usize::from(code)])),
        log_max: 9,
        usual: (
            6,
            &[
                4, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 3, 2, 1, 1, 1, 1, 1, -1, -1,
                -1, -1,
            ],
        ),
    },
    Kind {
        meaning: |code| (code <= OFFSET_CODE_MAX).then(|| (1 << code, code)),
        log_max: 8,
        usual: (5, &[1, 1, 1, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1]),
    },
    Kind {
        meaning: |code| Some((*MATCH_BASES.get(usize::from(code))?, MATCHES[usize::from(code)])),
        log_max: 9,
        usual: (
            6,
            &[
                1, 4, 3, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
                1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1, -1, -1,
            ],
        ),
    },
];

/// Decoder of a frame's blocks, which may use each other's tables.
#[derive(Default)]
pub struct Decoder {
    codes: Codes,
    /// By [`KINDS`].
    tables: [Table; 3],
    /// Latest offsets, newest first.
    offsets: [usize; 3],
    /// Of the present block, and [`SLACK`].
    literals: Vec<u8>,
    /// Length of the output before the frame.
    begin: usize,
}

impl Decoder {
    /// Begins a frame behind `begin` bytes of output, which it cannot refer to.
    pub fn begin(&mut self, begin: usize) {
        self.codes.clear();
        self.tables.iter_mut().for_each(Table::clear);
        self.offsets = [1, 4, 8];
        self.begin = begin;
    }

    /// Appends the content of a compressed block, so that `out` has at most `max` bytes.
    pub fn decode(&mut self, block: &[u8], max: usize, out: &mut Vec<u8>) -> Option<()> {
        let rest = self.read_literals(block)?;
        let begin = out.len();
        let limit = max.min(begin + BLOCK_MAX);
        out.resize(limit.checked_add(SLACK)?, 0);
        let end = self.sequences(rest, begin, limit, out);
        out.truncate(end.unwrap_or(begin));
        end.map(drop)
    }

    /// Reads the section of literals. Returns what is behind it.
    fn read_literals<'a>(&mut self, block: &'a [u8]) -> Option<&'a [u8]> {
        let byte = |place: usize| block.get(place).map_or(0, |byte| u64::from(*byte));
        let head = (0..5).fold(0, |head, place| head | byte(place) << (8 * place));
        let (kind, format) = (block.first()? & 3, head >> 2 & 3);
        if kind < 2 {
            let (size, len) = match format {
                1 => (head >> 4 & 0xFFF, 2),
                3 => (head >> 4 & 0xF_FFFF, 3),
                _ => (head >> 3 & 0x1F, 1),
            };
            let (size, rest) = (usize::try_from(size).ok()?, block.get(len..)?);
            let (content, rest) = rest.split_at_checked(if kind == 0 { size } else { 1 })?;
            self.literals.clear();
            if kind == 0 {
                self.literals.extend_from_slice(content);
            } else if size <= BLOCK_MAX {
                self.literals.resize(size, *content.first()?);
            } else {
                return None;
            }
            self.literals.resize(size + SLACK, 0);
            return Some(rest);
        }
        let (width, len) = [(10, 3), (10, 3), (14, 4), (18, 5)][format as usize];
        let part = |at: u32| usize::try_from(head >> at & ((1 << width) - 1)).ok();
        let (size, packed) = (part(4).filter(|size| *size <= BLOCK_MAX)?, part(4 + width)?);
        let (mut streams, rest) = block.get(len..)?.split_at_checked(packed)?;
        if kind == 2 {
            streams = self.codes.read(streams)?;
        }
        self.literals.resize(size + SLACK, 0);
        let out = &mut self.literals[..size];
        if format == 0 {
            self.codes.one(streams, out)?;
        } else {
            self.codes.four(streams, out)?;
        }
        Some(rest)
    }

    /// Reads the tables of sequences, as their modes say. Returns what is behind them.
    fn read_tables<'a>(&mut self, modes: u8, mut bytes: &'a [u8]) -> Option<&'a [u8]> {
        if modes & 3 != 0 {
            return None;
        }
        for (place, (table, kind)) in self.tables.iter_mut().zip(&KINDS).enumerate() {
            match modes >> (6 - 2 * place) & 3 {
                0 => table.fill(kind.usual.0, kind.usual.1, kind.meaning)?,
                1 => {
                    let (&symbol, rest) = bytes.split_first()?;
                    table.only(symbol, kind.meaning)?;
                    bytes = rest;
                }
                2 => bytes = table.read(bytes, kind.log_max, kind.meaning)?,
                _ => drop(table.log()?),
            }
        }
        Some(bytes)
    }

    /// Executes the sequences from `at` on: at most up to `limit`, behind which `out` has [`SLACK`]. Returns the end of
    /// the output.
    fn sequences(&mut self, bytes: &[u8], mut at: usize, limit: usize, out: &mut [u8]) -> Option<usize> {
        let literals_end = self.literals.len() - SLACK;
        let (count, bytes) = match *bytes {
            [0, ..] => (0, bytes),
            [255, low, high, ref rest @ ..] => (usize::from(u16::from_le_bytes([low, high])) + 0x7F00, rest),
            [high @ 128..=254, low, ref rest @ ..] => (usize::from(high - 128) << 8 | usize::from(low), rest),
            [count @ ..128, ref rest @ ..] => (usize::from(count), rest),
            _ => return None,
        };
        let mut literals_at = 0;
        if count > 0 {
            let (&modes, bytes) = bytes.split_first()?;
            let bytes = self.read_tables(modes, bytes)?;
            let Self { tables: [lengths, distances, matches], offsets, literals, begin, .. } = self;
            let mut bits = Backward::new(bytes)?;
            let mut of_length = bits.take(lengths.log()?);
            let mut of_offset = bits.take(distances.log()?);
            let mut of_match = bits.take(matches.log()?);
            for left in (0..count).rev() {
                bits.reload();
                let (length, distance, matched) =
                    (lengths.entry(of_length), distances.entry(of_offset), matches.entry(of_match));
                let many = length.extra + distance.extra + matched.extra > EXTRA_USUAL;
                let code = distance.base as usize + bits.take(distance.extra.into());
                if many {
                    bits.reload();
                }
                let match_len = matched.base as usize + bits.take(matched.extra.into());
                let len = length.base as usize + bits.take(length.extra.into());
                if left > 0 {
                    if many {
                        bits.reload();
                    }
                    of_length = usize::from(length.next) + bits.take(length.bits.into());
                    of_match = usize::from(matched.next) + bits.take(matched.bits.into());
                    of_offset = usize::from(distance.next) + bits.take(distance.bits.into());
                }
                let offset = next_offset(offsets, code, len == 0)?;
                let match_at = at + len;
                if len > literals_end - literals_at || match_len > limit.checked_sub(match_at)? {
                    return None;
                }
                copy_literals(literals, literals_at, out, at, len)?;
                literals_at += len;
                if offset > match_at - *begin {
                    return None;
                }
                copy_match(out, match_at, offset, match_len)?;
                at = match_at + match_len;
            }
            if bits.left() != 0 {
                return None;
            }
        }
        let rest = self.literals.get(literals_at..literals_end)?;
        if rest.len() > limit - at {
            return None;
        }
        out.get_mut(at..at + rest.len())?.copy_from_slice(rest);
        Some(at + rest.len())
    }
}

/// Offset of a code: one of the latest three, or a new one (RFC 8878, 3.1.1.5).
#[inline]
fn next_offset(offsets: &mut [usize; 3], code: usize, no_literals: bool) -> Option<usize> {
    let [first, second, third] = *offsets;
    let offset = match code + usize::from(no_literals && code <= 3) {
        1 if code <= 3 => return Some(first),
        2 if code <= 3 => {
            *offsets = [second, first, third];
            return Some(second);
        }
        3 if code <= 3 => third,
        4 if code <= 3 => first.checked_sub(1).filter(|offset| *offset > 0)?,
        _ => code - 3,
    };
    *offsets = [offset, first, second];
    Some(offset)
}

/// Copies `len` literals; up to [`SLACK`] more bytes of the output change.
#[inline]
fn copy_literals(literals: &[u8], from: usize, out: &mut [u8], at: usize, len: usize) -> Option<()> {
    if len <= SLACK {
        let piece: [u8; SLACK] = *literals.get(from..)?.first_chunk()?;
        *out.get_mut(at..)?.first_chunk_mut()? = piece;
    } else {
        out.get_mut(at..at + len)?.copy_from_slice(literals.get(from..from + len)?);
    }
    Some(())
}

/// Copies `len` bytes from `offset` before `at`, among them those that it writes itself; up to [`SLACK`] more bytes
/// change.
#[inline]
fn copy_match(out: &mut [u8], at: usize, offset: usize, len: usize) -> Option<()> {
    let from = at - offset;
    if offset >= SLACK && len <= 4 * SLACK {
        for done in (0..len).step_by(SLACK) {
            let piece: [u8; SLACK] = *out.get(from + done..)?.first_chunk()?;
            *out.get_mut(at + done..)?.first_chunk_mut()? = piece;
        }
    } else {
        // What is there repeats itself: twice as much each time.
        let mut done = 0;
        while done < len {
            let count = (offset + done).min(len - done);
            out.copy_within(from..from + count, at + done);
            done += count;
        }
    }
    Some(())
}
