//! Requests and answers without their frames, big-endian (Application Protocol V1.1b3, 4 to 7).

use base::listed;
use heapless::Vec;

/// Maximum length of a request or an answer.
pub const LEN_MAX: usize = 253;
/// A request or an answer.
pub type Pdu = Vec<u8, LEN_MAX>;

/// Greatest numbers of values in one request (6.1, 6.3, 6.11, 6.12).
pub const READ_BITS_MAX: u16 = 2000;
/// Registers that one request reads.
pub const READ_WORDS_MAX: u16 = 125;
/// Coils that one request writes.
pub const WRITE_BITS_MAX: u16 = 0x7B0;
/// Registers that one request writes.
pub const WRITE_WORDS_MAX: u16 = 123;

/// Values of a coil that is written alone (6.5).
const ON: u16 = 0xFF00;
const OFF: u16 = 0;
/// Marks the function code of an exception.
const EXCEPTION: u8 = 0x80;

listed! {
    /// The four tables of a device (4.3).
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Table {
        /// Bits, read and written: functions 1, 5, 15.
        Coils => "coil",
        /// Bits, read only: function 2.
        DiscreteInputs => "discrete",
        /// Registers of 16 bits, read and written: functions 3, 6, 16.
        HoldingRegisters => "holding",
        /// Registers of 16 bits, read only: function 4.
        InputRegisters => "input",
    }
}

impl Table {
    /// True for tables of single bits.
    #[must_use]
    pub const fn is_bits(self) -> bool {
        matches!(self, Self::Coils | Self::DiscreteInputs)
    }

    /// True if the master may write.
    #[must_use]
    pub const fn is_writable(self) -> bool {
        matches!(self, Self::Coils | Self::HoldingRegisters)
    }

    /// Values that one request reads at most.
    #[must_use]
    pub const fn read_max(self) -> u16 {
        if self.is_bits() { READ_BITS_MAX } else { READ_WORDS_MAX }
    }

    const fn read_code(self) -> u8 {
        match self {
            Self::Coils => 1,
            Self::DiscreteInputs => 2,
            Self::HoldingRegisters => 3,
            Self::InputRegisters => 4,
        }
    }
}

/// Several bits, eight to a byte, the first in the lowest bit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bits {
    bytes: Vec<u8, 246>,
    count: u16,
}

impl Bits {
    /// Appends a bit; false if there is no room.
    pub fn push(&mut self, bit: bool) -> bool {
        if self.count >= WRITE_BITS_MAX {
            return false;
        }
        if self.count.is_multiple_of(8) {
            // There is room: the count says so.
            let _ = self.bytes.push(0);
        }
        if let Some(byte) = self.bytes.last_mut() {
            *byte |= u8::from(bit) << (self.count % 8);
        }
        self.count += 1;
        true
    }

    /// The bits.
    pub fn iter(&self) -> impl Iterator<Item = bool> + '_ {
        (0..self.count).map(|n| self.bytes[usize::from(n / 8)] >> (n % 8) & 1 != 0)
    }
}

/// A request of the master.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Functions 1 to 4.
    Read {
        /// Where.
        table: Table,
        /// The first, from 0.
        address: u16,
        /// How many.
        count: u16,
    },
    /// Function 5.
    WriteCoil {
        /// From 0.
        address: u16,
        /// Its value.
        on: bool,
    },
    /// Function 6.
    WriteRegister {
        /// From 0.
        address: u16,
        /// Its value.
        word: u16,
    },
    /// Function 15.
    WriteCoils {
        /// The first, from 0.
        address: u16,
        /// Their values.
        bits: Bits,
    },
    /// Function 16.
    WriteRegisters {
        /// The first, from 0.
        address: u16,
        /// Their values.
        words: Vec<u16, { WRITE_WORDS_MAX as usize }>,
    },
}

/// What an answer says: the values of a read, in the order of their addresses; nothing after a write.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Data(Vec<u8, 250>);

impl Data {
    /// The bit with this index, of coils and discrete inputs.
    #[must_use]
    pub fn bit(&self, index: usize) -> Option<bool> {
        self.0.get(index / 8).map(|byte| byte >> (index % 8) & 1 != 0)
    }

    /// The register with this index.
    #[must_use]
    pub fn word(&self, index: usize) -> Option<u16> {
        let bytes = self.0.get(2 * index..2 * index + 2)?;
        Some(u16::from_be_bytes([bytes[0], bytes[1]]))
    }
}

/// Why a device does not do what it was asked for (7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Exception(pub u8);

impl Exception {
    /// The device does not know the function.
    pub const ILLEGAL_FUNCTION: Self = Self(1);
    /// The device has no such address.
    pub const ILLEGAL_ADDRESS: Self = Self(2);
    /// The request's structure or value is not permitted.
    pub const ILLEGAL_VALUE: Self = Self(3);
    /// The device failed.
    pub const DEVICE_FAILURE: Self = Self(4);
    /// The device has begun, and will take longer.
    pub const ACKNOWLEDGE: Self = Self(5);
    /// The device is busy.
    pub const BUSY: Self = Self(6);

    /// True if the same request may succeed later.
    #[must_use]
    pub const fn is_passing(self) -> bool {
        matches!(self, Self::ACKNOWLEDGE | Self::BUSY)
    }

    /// Meaning, for people.
    #[must_use]
    pub const fn means(self) -> &'static str {
        match self.0 {
            1 => "illegal function",
            2 => "illegal data address",
            3 => "illegal data value",
            4 => "server device failure",
            5 => "acknowledge",
            6 => "server device busy",
            8 => "memory parity error",
            10 => "gateway path unavailable",
            11 => "gateway target device failed to respond",
            _ => "an exception code that is not defined",
        }
    }
}

/// Why an answer is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rejection {
    /// The device refuses.
    Exception(Exception),
    /// Wrong function, length or echo.
    Malformed,
}

/// Value of a coil that is written alone.
const fn word_of(on: bool) -> u16 {
    if on { ON } else { OFF }
}

/// True if all addresses exist: there are 65 536.
fn ends_in_space(address: u16, count: u16) -> bool {
    u32::from(address) + u32::from(count) <= 0x1_0000
}

impl Request {
    /// Function code.
    #[must_use]
    pub const fn code(&self) -> u8 {
        match self {
            Self::Read { table, .. } => table.read_code(),
            Self::WriteCoil { .. } => 5,
            Self::WriteRegister { .. } => 6,
            Self::WriteCoils { .. } => 15,
            Self::WriteRegisters { .. } => 16,
        }
    }

    /// The first address and the number of values.
    #[must_use]
    pub fn range(&self) -> (u16, u16) {
        match self {
            Self::Read { address, count, .. } => (*address, *count),
            Self::WriteCoil { address, .. } | Self::WriteRegister { address, .. } => (*address, 1),
            Self::WriteCoils { address, bits } => (*address, bits.count),
            Self::WriteRegisters { address, words } => (*address, words.len() as u16),
        }
    }

    /// True if the specification permits it.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let (address, count) = self.range();
        let max = if let Self::Read { table, .. } = self { table.read_max() } else { WRITE_BITS_MAX };
        (1..=max).contains(&count) && ends_in_space(address, count)
    }

    /// Its bytes. Of a request that [is not valid](Self::is_valid) they mean nothing.
    #[must_use]
    pub fn encode(&self) -> Pdu {
        let (address, count) = self.range();
        let mut pdu = Pdu::new();
        // A request with the greatest number of values is as long as a PDU may be.
        let mut put = |bytes: &[u8]| _ = pdu.extend_from_slice(bytes);
        put(&[self.code()]);
        put(&address.to_be_bytes());
        match self {
            Self::Read { .. } => put(&count.to_be_bytes()),
            Self::WriteCoil { on, .. } => put(&word_of(*on).to_be_bytes()),
            Self::WriteRegister { word, .. } => put(&word.to_be_bytes()),
            Self::WriteCoils { bits, .. } => {
                put(&count.to_be_bytes());
                put(&[bits.bytes.len() as u8]);
                put(&bits.bytes);
            }
            Self::WriteRegisters { words, .. } => {
                put(&count.to_be_bytes());
                put(&[2 * words.len() as u8]);
                words.iter().for_each(|word| put(&word.to_be_bytes()));
            }
        }
        pdu
    }

    /// Length of its answer, if that is no exception.
    #[must_use]
    pub fn answer_len(&self) -> usize {
        match self {
            Self::Read { table, count, .. } => 2 + data_len(*table, *count),
            _ => 5,
        }
    }

    /// Length of the answer that begins with `code`; `None`: it is no answer to this request.
    #[must_use]
    pub(crate) fn answer_len_of(&self, code: u8) -> Option<usize> {
        match code {
            code if code == self.code() => Some(self.answer_len()),
            code if code == self.code() | EXCEPTION => Some(2),
            _ => None,
        }
    }

    /// Reads the answer: of a write it repeats address and value.
    ///
    /// # Errors
    /// It is an exception, or no answer to this request.
    pub fn accept(&self, answer: &[u8]) -> Result<Data, Rejection> {
        let malformed = Err(Rejection::Malformed);
        let Some((code, rest)) = answer.split_first() else { return malformed };
        if self.answer_len_of(*code) != Some(answer.len()) {
            return malformed;
        }
        if *code != self.code() {
            return Err(Rejection::Exception(Exception(rest[0])));
        }
        if !matches!(self, Self::Read { .. }) {
            return if *rest == self.encode()[1..5] { Ok(Data::default()) } else { malformed };
        }
        match rest.split_first() {
            Some((len, data)) if usize::from(*len) == data.len() => {
                Vec::from_slice(data).map(Data).map_err(|_| Rejection::Malformed)
            }
            _ => malformed,
        }
    }

    /// Reads a request, at a device.
    ///
    /// # Errors
    /// The exception with which the device answers.
    pub fn decode(pdu: &[u8]) -> Result<Self, Exception> {
        let (code, rest) = pdu.split_first().ok_or(Exception::ILLEGAL_FUNCTION)?;
        let word = |at: usize| rest.get(at..at + 2).map(|bytes| u16::from_be_bytes([bytes[0], bytes[1]]));
        let (Some(address), Some(second)) = (word(0), word(2)) else { return Err(known(*code)) };
        let read = |table| Ok(Self::Read { table, address, count: second });
        let fixed = match code {
            1 => read(Table::Coils),
            2 => read(Table::DiscreteInputs),
            3 => read(Table::HoldingRegisters),
            4 => read(Table::InputRegisters),
            5 if second == ON || second == OFF => Ok(Self::WriteCoil { address, on: second == ON }),
            6 => Ok(Self::WriteRegister { address, word: second }),
            15 | 16 => return Self::decode_several(*code, address, second, &rest[4..]),
            code => Err(known(*code)),
        }?;
        let (_, count) = fixed.range();
        match (rest.len(), fixed.is_valid()) {
            (4, true) => Ok(fixed),
            (4, false) if count <= fixed.count_max() && count > 0 => Err(Exception::ILLEGAL_ADDRESS),
            _ => Err(Exception::ILLEGAL_VALUE),
        }
    }

    fn count_max(&self) -> u16 {
        if let Self::Read { table, .. } = self { table.read_max() } else { 1 }
    }

    fn decode_several(code: u8, address: u16, count: u16, rest: &[u8]) -> Result<Self, Exception> {
        let (table, max) =
            if code == 15 { (Table::Coils, WRITE_BITS_MAX) } else { (Table::HoldingRegisters, WRITE_WORDS_MAX) };
        let data = match rest.split_first() {
            Some((len, data)) if usize::from(*len) == data.len() => data,
            _ => return Err(Exception::ILLEGAL_VALUE),
        };
        if !(1..=max).contains(&count) || data.len() != data_len(table, count) {
            return Err(Exception::ILLEGAL_VALUE);
        }
        if !ends_in_space(address, count) {
            return Err(Exception::ILLEGAL_ADDRESS);
        }
        if code == 15 {
            let mut bits = Bits::default();
            (0..usize::from(count)).for_each(|n| _ = bits.push(data[n / 8] >> (n % 8) & 1 != 0));
            return Ok(Self::WriteCoils { address, bits });
        }
        let words = data.chunks_exact(2).map(|word| u16::from_be_bytes([word[0], word[1]])).collect();
        Ok(Self::WriteRegisters { address, words })
    }

    /// Length of the request that begins so; `None` while that is not known. A function that is not known here has the
    /// length of what arrived.
    pub(crate) fn len_of(start: &[u8]) -> Option<usize> {
        match start {
            [] => None,
            [1..=6, ..] => Some(5),
            [15 | 16, _, _, _, _, len, ..] => Some(6 + usize::from(*len)),
            [15 | 16, ..] => None,
            other => Some(other.len()),
        }
    }
}

/// Exception of a request of this function that cannot be read.
fn known(code: u8) -> Exception {
    if matches!(code, 1..=6 | 15 | 16) { Exception::ILLEGAL_VALUE } else { Exception::ILLEGAL_FUNCTION }
}

/// Bytes of that many values.
fn data_len(table: Table, count: u16) -> usize {
    if table.is_bits() { usize::from(count).div_ceil(8) } else { 2 * usize::from(count) }
}

/// The answer of a device to a read, whose values are `data`.
pub(crate) fn answer(code: u8, data: &[u8]) -> Pdu {
    let mut pdu = Pdu::new();
    // At most 250 bytes, by the number of values.
    let _ = pdu.extend_from_slice(&[code, data.len() as u8]);
    let _ = pdu.extend_from_slice(data);
    pdu
}

/// The exception of a device to a request of this function.
pub(crate) fn exception(code: u8, exception: Exception) -> Pdu {
    let mut pdu = Pdu::new();
    let _ = pdu.extend_from_slice(&[code | EXCEPTION, exception.0]);
    pdu
}
