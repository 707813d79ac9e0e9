//! Telegrams of CoLa A and CoLa B: frames, values, scans, field results and outputs, without state.

use crate::event::FieldResult;
use heapless::Vec;

/// Longest telegram, bytes: 1141 distances and intensities as text, and some more.
pub const TELEGRAM_MAX: usize = 16_384;
/// Begin of a frame of CoLa A, and each of the first four bytes of CoLa B.
pub const STX: u8 = 0x02;
/// End of a frame of CoLa A.
pub const ETX: u8 = 0x03;
/// Bytes before the telegram in CoLa B: four times STX, and the length.
pub const HEADER_B: usize = 8;

/// Form of the telegrams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// CoLa A: text. It has no checksum.
    Text,
    /// CoLa B: binary, with a checksum.
    Binary,
}

/// Exclusive or of all bytes of a telegram of CoLa B.
#[must_use]
pub fn checksum(telegram: &[u8]) -> u8 {
    telegram.iter().fold(0, |sum, byte| sum ^ byte)
}

/// A telegram that is written: a name, then values.
#[derive(Debug)]
pub struct Writer<const N: usize> {
    dialect: Dialect,
    bytes: Vec<u8, N>,
    /// False once something had no room.
    fits: bool,
}

impl<const N: usize> Writer<N> {
    /// A telegram of this kind and name, such as `sRN DeviceIdent`.
    #[must_use]
    pub fn new(dialect: Dialect, name: &str) -> Self {
        let mut writer = Self { dialect, bytes: Vec::new(), fits: true };
        writer.put(match dialect {
            Dialect::Text => &[STX],
            Dialect::Binary => &[STX, STX, STX, STX, 0, 0, 0, 0],
        });
        writer.put(name.as_bytes());
        writer
    }

    fn put(&mut self, bytes: &[u8]) {
        self.fits &= self.bytes.extend_from_slice(bytes).is_ok();
    }

    fn hex(&mut self, value: u32) {
        let digits = (8 - value.leading_zeros() as usize / 4).max(1);
        self.put(b" ");
        for n in (0..digits).rev() {
            let digit = (value >> (4 * n) & 0xF) as u8;
            self.put(&[if digit < 10 { b'0' + digit } else { b'A' - 10 + digit }]);
        }
    }

    /// In CoLa B a blank is between the name and the first value.
    #[must_use]
    pub fn blank(mut self) -> Self {
        if self.dialect == Dialect::Binary {
            self.put(b" ");
        }
        self
    }

    /// Adds a value of one byte.
    #[must_use]
    pub fn u8(mut self, value: u8) -> Self {
        match self.dialect {
            Dialect::Text => self.hex(value.into()),
            Dialect::Binary => self.put(&[value]),
        }
        self
    }

    /// Adds a value of two bytes.
    #[must_use]
    pub fn u16(mut self, value: u16) -> Self {
        match self.dialect {
            Dialect::Text => self.hex(value.into()),
            Dialect::Binary => self.put(&value.to_be_bytes()),
        }
        self
    }

    /// Adds a value of four bytes.
    #[must_use]
    pub fn u32(mut self, value: u32) -> Self {
        match self.dialect {
            Dialect::Text => self.hex(value),
            Dialect::Binary => self.put(&value.to_be_bytes()),
        }
        self
    }

    /// Adds the values of a channel, of 16 or 8 bits.
    #[must_use]
    pub fn samples(mut self, is_wide: bool, values: impl Iterator<Item = u16>) -> Self {
        for value in values {
            match (self.dialect, is_wide) {
                (Dialect::Text, _) => self.hex(value.into()),
                (Dialect::Binary, true) => self.put(&value.to_be_bytes()),
                // Values of 8 bits are below 256.
                (Dialect::Binary, false) => self.put(&[value as u8]),
            }
        }
        self
    }

    /// Adds a text without its length.
    #[must_use]
    pub fn fixed(mut self, text: &str) -> Self {
        if self.dialect == Dialect::Text {
            self.put(b" ");
        }
        self.put(text.as_bytes());
        self
    }

    /// Adds a text with its length.
    #[must_use]
    pub fn text(self, text: &str) -> Self {
        // Texts of this crate are short.
        self.u16(text.len() as u16).fixed(text)
    }

    /// The frame; empty if it had no room.
    #[must_use]
    pub fn frame(mut self) -> Vec<u8, N> {
        match self.dialect {
            Dialect::Text => self.put(&[ETX]),
            Dialect::Binary => {
                let length = (self.bytes.len() - HEADER_B) as u32;
                self.bytes[4..HEADER_B].copy_from_slice(&length.to_be_bytes());
                let sum = checksum(&self.bytes[HEADER_B..]);
                self.put(&[sum]);
            }
        }
        if !self.fits {
            self.bytes.clear();
        }
        self.bytes
    }
}

/// Values of a telegram, in order.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a> {
    dialect: Dialect,
    left: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Values after the name. `None`: the telegram has another name.
    #[must_use]
    pub fn new(dialect: Dialect, telegram: &'a [u8], name: &str) -> Option<Self> {
        let left = telegram.strip_prefix(name.as_bytes())?;
        match left {
            [] => Some(Self { dialect, left }),
            // The first blank belongs to the name; tokens of text skip it anyway.
            [b' ', rest @ ..] => Some(Self { dialect, left: rest }),
            _ => None,
        }
    }

    fn token(&mut self) -> Option<&'a [u8]> {
        let begin = self.left.iter().position(|byte| *byte != b' ')?;
        let rest = &self.left[begin..];
        let end = rest.iter().position(|byte| *byte == b' ').unwrap_or(rest.len());
        self.left = &rest[end..];
        Some(&rest[..end])
    }

    /// A number as text: hexadecimal, or decimal with a sign before it.
    fn number(&mut self) -> Option<i64> {
        let token = self.token()?;
        let (sign, digits, radix) = match token {
            [b'+', rest @ ..] => (1, rest, 10),
            [b'-', rest @ ..] => (-1, rest, 10),
            _ => (1, token, 16),
        };
        if digits.is_empty() || digits.len() > 10 {
            return None;
        }
        let value = digits.iter().try_fold(0_i64, |value, digit| {
            Some(value * i64::from(radix) + i64::from(char::from(*digit).to_digit(radix)?))
        })?;
        Some(sign * value)
    }

    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.left.split_first_chunk::<N>()?;
        self.left = rest;
        Some(*bytes)
    }

    /// A value of one byte.
    pub fn u8(&mut self) -> Option<u8> {
        match self.dialect {
            Dialect::Text => u8::try_from(self.number()?).ok(),
            Dialect::Binary => Some(u8::from_be_bytes(self.bytes()?)),
        }
    }

    /// A value of two bytes.
    pub fn u16(&mut self) -> Option<u16> {
        match self.dialect {
            Dialect::Text => u16::try_from(self.number()?).ok(),
            Dialect::Binary => Some(u16::from_be_bytes(self.bytes()?)),
        }
    }

    /// A value of four bytes.
    pub fn u32(&mut self) -> Option<u32> {
        match self.dialect {
            Dialect::Text => u32::try_from(self.number()?).ok(),
            Dialect::Binary => Some(u32::from_be_bytes(self.bytes()?)),
        }
    }

    /// A value of four bytes with a sign; as text it is the same bits, or decimal with a sign.
    pub fn i32(&mut self) -> Option<i32> {
        match self.dialect {
            Dialect::Text => {
                let number = self.number()?;
                u32::try_from(number).ok().map(u32::cast_signed).or(i32::try_from(number).ok())
            }
            Dialect::Binary => Some(i32::from_be_bytes(self.bytes()?)),
        }
    }

    /// A text of `len` bytes; as text it is a token.
    pub fn fixed(&mut self, len: usize) -> Option<&'a [u8]> {
        match self.dialect {
            Dialect::Text => self.token(),
            Dialect::Binary => {
                let (text, rest) = self.left.split_at_checked(len)?;
                self.left = rest;
                Some(text)
            }
        }
    }

    /// A text with its length before it.
    pub fn text(&mut self) -> Option<&'a [u8]> {
        let len = usize::from(self.u16()?);
        if self.dialect == Dialect::Text {
            self.left = self.left.strip_prefix(b" ")?;
        }
        let (text, rest) = self.left.split_at_checked(len)?;
        self.left = rest;
        Some(text)
    }

    /// Number of outputs in what is left, and whether a time follows them: each has a state and a counter.
    fn outputs(&self) -> Option<(usize, bool)> {
        let (left, each, ends) = match self.dialect {
            Dialect::Text => (self.left.split(|byte| *byte == b' ').filter(|it| !it.is_empty()).count(), 2, [1, 8]),
            Dialect::Binary => (self.left.len(), 5, [2, 13]),
        };
        let count = |end: usize| left.checked_sub(end).filter(|left| left % each == 0).map(|left| left / each);
        // No length is that of both.
        count(ends[0]).map(|count| (count, false)).or_else(|| count(ends[1]).map(|count| (count, true)))
    }

    /// The next value of a channel, of 16 or 8 bits.
    fn sample(&mut self, is_wide: bool) -> Option<u16> {
        if is_wide { self.u16() } else { self.u8().map(u16::from) }
    }
}

/// A channel of a scan: distances or intensities.
#[derive(Clone, Copy, Debug)]
pub struct Channel<'a> {
    values: Reader<'a>,
    is_wide: bool,
    /// A value counts for this much.
    pub scale: f32,
    /// And this is added.
    pub offset: f32,
    /// Direction of the first value, 1/10000°, counter-clockwise, 90° at the front.
    pub start: i32,
    /// From one value to the next, 1/10000°.
    pub step: u16,
    /// Number of values.
    pub count: u16,
}

impl Channel<'_> {
    /// The values, not scaled. All of them are there: [`Scan::decode`] has seen them.
    pub fn values(&self) -> impl Iterator<Item = u16> {
        let (mut values, is_wide) = (self.values, self.is_wide);
        (0..self.count).map_while(move |_| values.sample(is_wide))
    }
}

/// A scan: telegram LMDscandata.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    /// Serial number of the device.
    pub serial: u32,
    /// State of the device: bit 0 error, bit 1 contamination warning, bit 2 contamination error.
    pub status: u8,
    /// Number of the telegram.
    pub telegram: u16,
    /// Number of the scan.
    pub number: u16,
    /// Clock of the device at the scan, µs.
    pub scanned_us: u32,
    /// Clock of the device when the telegram was sent, µs.
    pub sent_us: u32,
    /// Scans per second, 1/100 Hz.
    pub frequency: u32,
    /// Distances, mm after scale and offset; values below [`VALID_MIN`] are codes.
    pub distances: Channel<'a>,
    /// Intensities, in the same directions.
    pub intensities: Option<Channel<'a>>,
}

/// Distances below this value are codes: 0 nothing valid received, 1 dazzled, others reserved.
pub const VALID_MIN: u16 = 16;
/// Channels of a telegram at most.
const CHANNELS_MAX: u16 = 12;

impl<'a> Scan<'a> {
    /// Decodes the values of a scan. `None`: it is cut, a value is out of its range, or it has no distances.
    #[must_use]
    pub fn decode(mut values: Reader<'a>) -> Option<Self> {
        let _version = values.u16()?;
        let _device = values.u16()?;
        let serial = values.u32()?;
        let status = values.u8()? | values.u8()?;
        let (telegram, number) = (values.u16()?, values.u16()?);
        let (scanned_us, sent_us) = (values.u32()?, values.u32()?);
        for _ in 0..4 {
            let _inputs_and_outputs = values.u8()?;
        }
        let _layer = values.u16()?;
        let (frequency, _samples) = (values.u32()?, values.u32()?);
        for _ in 0..Some(values.u16()?).filter(|count| *count <= CHANNELS_MAX)? {
            let _encoder = (values.u32()?, values.u16()?);
        }
        let (mut distances, mut intensities) = (None, None);
        for is_wide in [true, false] {
            for _ in 0..Some(values.u16()?).filter(|count| *count <= CHANNELS_MAX)? {
                let content = values.fixed(5)?;
                let scale = f32::from_bits(values.u32()?);
                let offset = f32::from_bits(values.u32()?);
                let (start, step, count) = (values.i32()?, values.u16()?, values.u16()?);
                let channel = Channel { values, is_wide, scale, offset, start, step, count };
                for _ in 0..count {
                    values.sample(is_wide)?;
                }
                match content {
                    b"DIST1" => distances = Some(channel),
                    b"RSSI1" => intensities = Some(channel),
                    _ => {}
                }
            }
        }
        let distances = distances?;
        // A turn and a day are beyond what devices send.
        let is_valid = distances.scale.is_finite()
            && distances.scale > 0.0
            && distances.scale <= 64.0
            && distances.offset.abs() <= 10_000.0
            && distances.step > 0
            && distances.count > 1
            && u32::from(distances.step) * (u32::from(distances.count) - 1) < 3_600_000
            && distances.start.abs() <= 3_600_000
            && (100..=20_000).contains(&frequency);
        let intensities = intensities.filter(|channel| channel.count == distances.count);
        let scan = Self { serial, status, telegram, number, scanned_us, sent_us, frequency, distances, intensities };
        is_valid.then_some(scan)
    }
}

/// Fields of a telegram LFErec at most, and their highest number.
pub const FIELDS_MAX: usize = 48;
/// Outputs of a telegram LIDoutputstate at most.
pub const OUTPUTS_MAX: usize = 16;

/// Decodes the results of a field evaluation: number and result of each field. `None`: it is cut, or a value is out of
/// its range. An LMS5xx adds values to fields that are infringed, which are not read: it is not supported.
#[must_use]
pub fn fields(mut values: Reader<'_>) -> Option<Vec<(u8, FieldResult), FIELDS_MAX>> {
    let mut fields = Vec::new();
    for _ in 0..values.u16()? {
        let _version = values.u16()?;
        let number = values.u8()?;
        let _clock = values.u32()?;
        let _scales = (values.u32()?, values.u32()?, values.u32()?, values.i32()?);
        let result = match values.u8()? {
            0 => FieldResult::Unknown,
            1 => FieldResult::Free,
            2 => FieldResult::Infringed,
            _ => return None,
        };
        for _ in 0..3 {
            let _reserved = values.u16()?;
        }
        if values.u16()? != 0 {
            let _date = (values.u16()?, values.u8()?, values.u8()?);
            let _time = (values.u8()?, values.u8()?, values.u8()?, values.u32()?);
        }
        fields.push((number, result)).ok()?;
    }
    Some(fields)
}

/// Decodes the states of the outputs: number and state of each; one that is not used is unknown. `None`: the telegram
/// is cut, or a value is out of its range.
#[must_use]
pub fn outputs(mut values: Reader<'_>) -> Option<Vec<(u8, FieldResult), OUTPUTS_MAX>> {
    let (_version, _clock) = (values.u16()?, values.u32()?);
    let (count, has_time) = values.outputs()?;
    let mut outputs = Vec::new();
    for number in 1..=u8::try_from(count).ok()? {
        let state = match values.u8()? {
            0 => FieldResult::Infringed,
            1 => FieldResult::Free,
            2 => FieldResult::Unknown,
            _ => return None,
        };
        let _changes = values.u32()?;
        outputs.push((number, state)).ok()?;
    }
    ((values.u16()? != 0) == has_time).then_some(outputs)
}
