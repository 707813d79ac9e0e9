//! Values in registers and bits: type, order of the words, scale and offset, limits.

use crate::pdu::Table;
use base::listed;
use heapless::Vec;

listed! {
    /// Type of a value in registers; within a register the high byte is first (Application Protocol V1.1b3, 4.2).
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum Kind {
        /// 16 bits without sign.
        U16 => "u16",
        /// 16 bits, two's complement.
        I16 => "i16",
        /// 32 bits without sign.
        U32 => "u32",
        /// 32 bits, two's complement.
        I32 => "i32",
        /// 32 bits, IEEE 754.
        F32 => "f32",
        /// One bit of a register.
        Bit => "bit",
    }
}

/// Where a value is, and what it means: value = number * scale + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The table.
    pub table: Table,
    /// The first address, from 0.
    pub address: u16,
    /// Its type; without meaning in a table of bits.
    pub kind: Kind,
    /// The bit of [`Kind::Bit`], 0 the lowest.
    pub bit: u8,
    /// Of two registers the first has the low word.
    pub low_first: bool,
    /// Unit of the value for each unit of the number; not 0.
    pub scale: f64,
    /// The value where the number is 0.
    pub offset: f64,
}

/// What is written for a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Number {
    /// A bit.
    Bit(bool),
    /// One or two registers, in the order of their addresses.
    Words(Vec<u16, 2>),
}

impl Place {
    /// True for a coil, a discrete input, or a bit of a register.
    #[must_use]
    pub fn is_bit(&self) -> bool {
        self.table.is_bits() || self.kind == Kind::Bit
    }

    /// Number of addresses that it occupies.
    #[must_use]
    pub fn width(&self) -> u16 {
        match self.kind {
            Kind::U32 | Kind::I32 | Kind::F32 if !self.table.is_bits() => 2,
            _ => 1,
        }
    }

    /// True if scale and offset are numbers, the scale is not 0, the bit exists, and so do the addresses.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let ends = u32::from(self.address) + u32::from(self.width()) <= 0x1_0000;
        self.scale.is_finite() && self.scale != 0.0 && self.offset.is_finite() && self.bit < 16 && ends
    }

    /// The value of a bit.
    #[must_use]
    pub fn of_bit(&self, bit: bool) -> f64 {
        f64::from(u8::from(bit)) * self.scale + self.offset
    }

    /// The value of registers in the order of their addresses; NaN: they are no number.
    #[must_use]
    pub fn of_words(&self, words: [u16; 2]) -> f64 {
        let [first, second] = words;
        let (high, low) = if self.low_first { (second, first) } else { (first, second) };
        let double = u32::from(high) << 16 | u32::from(low);
        let number = match self.kind {
            Kind::U16 => f64::from(first),
            Kind::I16 => f64::from(first as i16),
            Kind::U32 => f64::from(double),
            Kind::I32 => f64::from(double as i32),
            Kind::F32 => f64::from(f32::from_bits(double)),
            Kind::Bit => f64::from(first >> (self.bit % 16) & 1),
        };
        let value = number * self.scale + self.offset;
        if value.is_finite() { value } else { f64::NAN }
    }

    /// What is written for a value, rounded to the next number; `None`: there is no such number.
    #[must_use]
    pub fn number(&self, value: f64) -> Option<Number> {
        let exact = (value - self.offset) / self.scale;
        if self.is_bit() {
            return [(0.0, false), (1.0, true)]
                .into_iter()
                .find(|(number, _)| *number == exact)
                .map(|(_, bit)| Number::Bit(bit));
        }
        let rounded = libm::round(exact);
        let within = |low: f64, high: f64| (low..=high).contains(&rounded);
        let single = |word: u16| Some(Number::Words(Vec::from_slice(&[word]).ok()?));
        let double = |number: u32| {
            let (high, low) = ((number >> 16) as u16, number as u16);
            let words = if self.low_first { [low, high] } else { [high, low] };
            Some(Number::Words(Vec::from_slice(&words).ok()?))
        };
        match self.kind {
            Kind::U16 => within(0.0, u16::MAX.into()).then_some(rounded as u16).and_then(single),
            Kind::I16 => within(i16::MIN.into(), i16::MAX.into()).then_some(rounded as i16 as u16).and_then(single),
            Kind::U32 => within(0.0, u32::MAX.into()).then_some(rounded as u32).and_then(double),
            Kind::I32 => within(i32::MIN.into(), i32::MAX.into()).then_some(rounded as i32 as u32).and_then(double),
            Kind::F32 => {
                Some(exact as f32).filter(|number| number.is_finite()).and_then(|number| double(number.to_bits()))
            }
            Kind::Bit => None,
        }
    }
}
