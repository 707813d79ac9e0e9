//! Huffman codes of literals (RFC 8878, 4.2).

use super::bits::Backward;
use super::fse::Table;

/// Maximum length of a code, bits.
const BITS_MAX: u32 = 11;
/// Maximum number of weights in a description; the last symbol's follows from the others.
const WEIGHTS_MAX: usize = 255;
/// Maximum number of bits of a state that decodes weights.
const WEIGHTS_LOG_MAX: u8 = 6;
/// Symbols decoded for each reload of the bits: as many as 57 bits have in any case.
const AT_ONCE: usize = 5;

/// Codes; none until they are read.
pub struct Codes {
    /// Symbol, and length of its code times 256, by the next bits.
    table: [u16; 1 << BITS_MAX],
    bits: u32,
    states: Table,
}

impl Default for Codes {
    fn default() -> Self {
        Self { table: [0; 1 << BITS_MAX], bits: 0, states: Table::default() }
    }
}

impl Codes {
    /// Forgets the codes.
    pub fn clear(&mut self) {
        self.bits = 0;
    }

    /// Reads a description. Returns what is behind it.
    pub fn read<'a>(&mut self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        self.bits = 0;
        let (&head, bytes) = bytes.split_first()?;
        let mut weights = [0_u8; WEIGHTS_MAX + 1];
        let (count, rest) = match usize::from(head) {
            size @ 0..128 => {
                let (coded, rest) = bytes.split_at_checked(size)?;
                (self.weights(coded, &mut weights)?, rest)
            }
            count => {
                let count = count - 127;
                let (halves, rest) = bytes.split_at_checked(count.div_ceil(2))?;
                for (pair, byte) in weights.chunks_mut(2).zip(halves) {
                    pair.iter_mut().zip([byte >> 4, byte & 15]).for_each(|(weight, half)| *weight = half);
                }
                (count, rest)
            }
        };
        self.fill(&mut weights, count)?;
        Some(rest)
    }

    /// Decodes weights by two states in turn. Returns their number.
    fn weights(&mut self, coded: &[u8], weights: &mut [u8; WEIGHTS_MAX + 1]) -> Option<usize> {
        let rest = self.states.read(coded, WEIGHTS_LOG_MAX, |symbol| Some((symbol.into(), 0)))?;
        let log = self.states.log()?;
        let mut bits = Backward::new(rest)?;
        let mut states = [bits.take(log), bits.take(log)];
        for count in 0..WEIGHTS_MAX {
            let entry = self.states.entry(states[count % 2]);
            weights[count] = entry.base as u8;
            bits.reload();
            states[count % 2] = usize::from(entry.next) + bits.take(entry.bits.into());
            if bits.left() < 0 {
                // The other state still stands for a weight.
                let last = count + 1;
                *weights.get_mut(..WEIGHTS_MAX)?.get_mut(last)? = self.states.entry(states[last % 2]).base as u8;
                return Some(last + 1);
            }
        }
        None
    }

    /// Fills the table by the first `count` weights and the one that follows from them.
    fn fill(&mut self, weights: &mut [u8; WEIGHTS_MAX + 1], count: usize) -> Option<()> {
        let mut shares = [0_usize; 1 + BITS_MAX as usize];
        let mut sum = 0_u32;
        for weight in weights.get(..count)?.iter().copied().filter(|weight| *weight > 0) {
            *shares.get_mut(usize::from(weight))? += 1;
            sum += 1 << (weight - 1);
        }
        let bits = sum.checked_ilog2()? + 1;
        let left = (1 << bits) - sum;
        if bits > BITS_MAX || !left.is_power_of_two() {
            return None;
        }
        let last = left.ilog2() + 1;
        *weights.get_mut(count)? = last as u8;
        shares[last as usize] += 1;
        // Where the symbols of each weight begin: those with the longest codes first.
        let (mut begins, mut at) = ([0; 1 + BITS_MAX as usize], 0);
        for weight in 1..=BITS_MAX as usize {
            begins[weight] = at;
            at += shares[weight] << (weight - 1);
        }
        for (symbol, weight) in (0_u16..).zip(&weights[..=count]).filter(|(_, weight)| **weight > 0) {
            let begin = &mut begins[usize::from(*weight)];
            let size = 1 << (weight - 1);
            let code = symbol | ((bits + 1 - u32::from(*weight)) as u16) << 8;
            self.table.get_mut(*begin..*begin + size)?.fill(code);
            *begin += size;
        }
        self.bits = bits;
        Some(())
    }

    #[inline]
    fn symbol(&self, bits: &mut Backward<'_>) -> u8 {
        let code = self.table[bits.peek(self.bits) % (1 << BITS_MAX)];
        bits.skip((code >> 8).into());
        code as u8
    }

    /// Decodes a stream into `out`, which it fills exactly.
    pub fn one(&self, stream: &[u8], out: &mut [u8]) -> Option<()> {
        let mut bits = Backward::new(stream).filter(|_| self.bits > 0)?;
        self.end(&mut bits, out)
    }

    fn end(&self, bits: &mut Backward<'_>, out: &mut [u8]) -> Option<()> {
        for symbols in out.chunks_mut(AT_ONCE) {
            bits.reload();
            symbols.iter_mut().for_each(|symbol| *symbol = self.symbol(bits));
        }
        (bits.left() == 0).then_some(())
    }

    /// Decodes four streams, behind a table of the sizes of three of them, each into a quarter of `out`.
    pub fn four(&self, streams: &[u8], out: &mut [u8]) -> Option<()> {
        let (&[a, b, c, d, e, f], streams) = streams.split_first_chunk()?;
        let size = |low, high| usize::from(u16::from_le_bytes([low, high]));
        let (first, streams) = streams.split_at_checked(size(a, b))?;
        let (second, streams) = streams.split_at_checked(size(c, d))?;
        let (third, fourth) = streams.split_at_checked(size(e, f))?;
        let open = |stream| Backward::new(stream).filter(|_| self.bits > 0);
        let mut bits = [open(first)?, open(second)?, open(third)?, open(fourth)?];
        let quarter = out.len().div_ceil(4);
        let (first, out) = out.split_at_mut_checked(quarter)?;
        let (second, out) = out.split_at_mut_checked(quarter)?;
        let (third, fourth) = out.split_at_mut_checked(quarter)?;
        // Side by side, because each code of a stream is found only after the one before it.
        let common = fourth.len() / AT_ONCE * AT_ONCE;
        let (first, first_end) = first.split_at_mut_checked(common)?;
        let (second, second_end) = second.split_at_mut_checked(common)?;
        let (third, third_end) = third.split_at_mut_checked(common)?;
        let (fourth, fourth_end) = fourth.split_at_mut_checked(common)?;
        let parts = |part| <[u8]>::as_chunks_mut::<AT_ONCE>(part).0.iter_mut();
        let firsts = parts(first).zip(parts(second));
        for ((first, second), (third, fourth)) in firsts.zip(parts(third).zip(parts(fourth))) {
            for bits in &mut bits {
                bits.reload();
            }
            for place in 0..AT_ONCE {
                first[place] = self.symbol(&mut bits[0]);
                second[place] = self.symbol(&mut bits[1]);
                third[place] = self.symbol(&mut bits[2]);
                fourth[place] = self.symbol(&mut bits[3]);
            }
        }
        let ends = [first_end, second_end, third_end, fourth_end];
        bits.iter_mut().zip(ends).try_for_each(|(bits, end)| self.end(bits, end))
    }
}
