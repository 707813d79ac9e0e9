//! Lines of SCIP 2.0: checksums, numbers, parameters, without state.

/// End of a line; an empty line ends an answer.
pub const LF: u8 = b'\n';
/// Characters of data in a line at most, without its checksum.
pub const BLOCK: usize = 64;

/// Checksum of a line: the lower six bits of the sum of its characters, as a character.
#[must_use]
pub fn checksum(line: &[u8]) -> u8 {
    (line.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)) & 0x3F) + 0x30
}

/// A line without its checksum. `None`: it is wrong or missing. Where a line ends with a semicolon, that character may
/// be outside of the sum.
#[must_use]
pub fn checked(line: &[u8]) -> Option<&[u8]> {
    let (sum, line) = line.split_last()?;
    let without = line.strip_suffix(b";");
    (*sum == checksum(line) || without.is_some_and(|line| *sum == checksum(line))).then_some(line)
}

/// Number of characters of six bits each. `None`: a character is not one of them.
#[must_use]
pub fn decode(characters: &[u8]) -> Option<u32> {
    characters.iter().try_fold(0_u32, |value, byte| {
        let bits = byte.checked_sub(0x30).filter(|bits| *bits < 64)?;
        value.checked_mul(64).map(|value| value | u32::from(bits))
    })
}

/// The last `characters.len()` characters of a number.
pub fn encode(value: u32, characters: &mut [u8]) {
    let len = characters.len();
    for (n, byte) in characters.iter_mut().enumerate() {
        *byte = (value >> (6 * (len - 1 - n)) & 0x3F) as u8 + 0x30;
    }
}

/// Decimal number of a parameter.
fn decimal(text: &[u8]) -> Option<u32> {
    let digits = text.trim_ascii();
    if digits.is_empty() || digits.len() > 8 || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    Some(digits.iter().fold(0, |value, digit| value * 10 + u32::from(digit - b'0')))
}

/// Parameters of a sensor: the answer to `PP`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parameters {
    /// Shortest range, mm.
    pub range_min_mm: u32,
    /// Longest range, mm.
    pub range_max_mm: u32,
    /// Steps of a revolution.
    pub steps_per_turn: u32,
    /// First step that is measured.
    pub first: u32,
    /// Last step that is measured.
    pub last: u32,
    /// Step of the front.
    pub front: u32,
    /// Revolutions per minute.
    pub rpm: u32,
}

impl Parameters {
    /// Takes a line without its checksum; lines of other parameters are left out. False: its value is not a number.
    pub fn take(&mut self, line: &[u8]) -> bool {
        let line = line.strip_suffix(b";").unwrap_or(line);
        let Some((name, value)) = line.split_at_checked(5) else { return true };
        let place = match name {
            b"DMIN:" => &mut self.range_min_mm,
            b"DMAX:" => &mut self.range_max_mm,
            b"ARES:" => &mut self.steps_per_turn,
            b"AMIN:" => &mut self.first,
            b"AMAX:" => &mut self.last,
            b"AFRT:" => &mut self.front,
            b"SCAN:" => &mut self.rpm,
            _ => return true,
        };
        match decimal(value) {
            Some(value) => *place = value,
            None => return false,
        }
        true
    }

    /// True if a sensor can have these parameters.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        (1..=10_000).contains(&self.range_min_mm)
            && (100..=262_143).contains(&self.range_max_mm)
            && self.range_min_mm < self.range_max_mm
            && (90..=8192).contains(&self.steps_per_turn)
            && self.first < self.last
            && self.last < self.steps_per_turn
            && self.front < self.steps_per_turn
            && (60..=12_000).contains(&self.rpm)
    }

    /// Steps that are measured.
    #[must_use]
    pub fn count(&self) -> usize {
        (self.last - self.first + 1) as usize
    }
}
