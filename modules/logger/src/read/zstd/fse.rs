//! Tables of finite state entropy coding (RFC 8878, 4.1).

use super::bits::Forward;

/// Maximum number of a table's states.
const STATES_MAX: usize = 512;
/// Number of symbols that any table may have.
const SYMBOLS_MAX: usize = 256;

/// What a state stands for, and how the next one is found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Entry {
    /// Smallest value of the symbol.
    pub base: u32,
    /// Bits to be added to it.
    pub extra: u8,
    /// Bits to be added to `next`.
    pub bits: u8,
    pub next: u16,
}

/// Value of a symbol: smallest one, and number of bits that are added.
pub type Meaning = fn(u8) -> Option<(u32, u8)>;

/// A table; without states until it is read.
pub struct Table {
    entries: [Entry; STATES_MAX],
    log: Option<u8>,
}

impl Default for Table {
    fn default() -> Self {
        Self { entries: [Entry::default(); STATES_MAX], log: None }
    }
}

impl Table {
    /// Forgets the states.
    pub fn clear(&mut self) {
        self.log = None;
    }

    /// Number of bits of a state; `None` without states.
    pub fn log(&self) -> Option<u32> {
        self.log.map(u32::from)
    }

    #[inline]
    pub fn entry(&self, state: usize) -> Entry {
        self.entries[state % STATES_MAX]
    }

    /// One state that stands for one symbol.
    pub fn only(&mut self, symbol: u8, meaning: Meaning) -> Option<()> {
        let (base, extra) = meaning(symbol)?;
        self.entries[0] = Entry { base, extra, bits: 0, next: 0 };
        self.log = Some(0);
        Some(())
    }

    /// Reads the description of a table with at most `log_max` bits for a state. Returns what is behind it.
    pub fn read<'a>(&mut self, bytes: &'a [u8], log_max: u8, meaning: Meaning) -> Option<&'a [u8]> {
        let mut bits = Forward::new(bytes);
        let log = bits.peek(4) as u8 + 5;
        bits.skip(4);
        if log > log_max {
            return None;
        }
        let mut shares = [0_i16; SYMBOLS_MAX];
        let (mut count, mut left) = (0, 1_u32 << log);
        while left > 0 {
            // A share is 0 to left + 1 here, one more than it is; small ones have one bit less.
            let width = (left + 1).ilog2() as usize + 1;
            let short = (1 << width) - 1 - (left + 1);
            let value = bits.peek(width);
            let low = value & ((1 << (width - 1)) - 1);
            let share = if low < short {
                bits.skip(width - 1);
                low
            } else {
                bits.skip(width);
                if value == low { value } else { value - short }
            };
            let share = i16::try_from(share).ok()? - 1;
            left = left.checked_sub(u32::from(share.unsigned_abs()))?;
            *shares.get_mut(count)? = share;
            count += 1;
            // More symbols without a state follow, by their number; 3 means that another number follows.
            let mut zeros = if share == 0 { 3 } else { 0 };
            while zeros == 3 && count <= SYMBOLS_MAX {
                zeros = bits.peek(2) as usize;
                bits.skip(2);
                count += zeros;
            }
        }
        let rest = bits.rest()?;
        self.fill(log, shares.get(..count)?, meaning)?;
        Some(rest)
    }

    /// Fills the table by the symbols' shares of the states; -1 is less than one state.
    pub fn fill(&mut self, log: u8, shares: &[i16], meaning: Meaning) -> Option<()> {
        self.log = None;
        let size = 1_usize << log;
        let entries = self.entries.get_mut(..size)?;
        let mut counts = [0_u16; SYMBOLS_MAX];
        let (mut symbols, mut end) = ([0_u8; STATES_MAX], size);
        for (symbol, share) in (0_u8..=u8::MAX).zip(shares).filter(|(_, share)| **share < 0) {
            end = end.checked_sub(1)?;
            symbols[end] = symbol;
            counts[usize::from(symbol)] = share.unsigned_abs();
        }
        let (mut at, step) = (0, (size >> 1) + (size >> 3) + 3);
        for (symbol, share) in (0_u8..=u8::MAX).zip(shares).filter(|(_, share)| **share > 0) {
            counts[usize::from(symbol)] = share.unsigned_abs();
            for _ in 0..*share {
                symbols[at] = symbol;
                at = (at + step) & (size - 1);
                while at >= end {
                    at = (at + step) & (size - 1);
                }
            }
        }
        for (entry, symbol) in entries.iter_mut().zip(&symbols) {
            let count = &mut counts[usize::from(*symbol)];
            let bits = log - u8::try_from(count.checked_ilog2()?).ok()?;
            let next = (usize::from(*count) << bits).checked_sub(size)?;
            *count += 1;
            let (base, extra) = meaning(*symbol)?;
            *entry = Entry { base, extra, bits, next: u16::try_from(next).ok()? };
        }
        self.log = Some(log);
        Some(())
    }
}
