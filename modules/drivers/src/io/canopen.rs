//! Inputs and outputs of CANopen devices: their keys, and what a value is on the wire. `driver_canbus`, the master of
//! their bus, serves them (`canbus::devices`); this module names, publishes and commands them.

use super::output::OutputKeys;
use base::Duration;
use settings::{Choice, Table, settings};

/// Number of a device profile by which inputs and outputs are at known indices.
pub const PROFILE_401: u16 = 401;

const KINDS: Choice<ObjectKind> = Choice(&[
    ("digital-in", ObjectKind::DigitalIn),
    ("digital-out", ObjectKind::DigitalOut),
    ("analogue-in", ObjectKind::AnalogueIn),
    ("analogue-out", ObjectKind::AnalogueOut),
    ("object", ObjectKind::Object),
]);

const FORMATS: Choice<Format> = Choice(&[
    ("u8", Format::U8),
    ("i8", Format::I8),
    ("u16", Format::U16),
    ("i16", Format::I16),
    ("u32", Format::U32),
    ("i32", Format::I32),
    ("f32", Format::F32),
    ("bit", Format::Bit),
]);

/// What a signal of a CANopen device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectKind {
    /// A bit of 0x6000, digital inputs by eights (CiA 401).
    DigitalIn,
    /// A bit of 0x6200, digital outputs by eights.
    DigitalOut,
    /// A channel of 0x6401, analogue inputs of 16 bits.
    AnalogueIn,
    /// A channel of 0x6411, analogue outputs of 16 bits.
    AnalogueOut,
    /// An object by its index.
    Object,
}

/// Type of an object, or a bit of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// UNSIGNED8.
    U8,
    /// INTEGER8.
    I8,
    /// UNSIGNED16.
    U16,
    /// INTEGER16.
    I16,
    /// UNSIGNED32.
    U32,
    /// INTEGER32.
    I32,
    /// REAL32.
    F32,
    /// A bit of an unsigned object of up to 32 bits.
    Bit,
}

settings! {
    /// Keys of `[io.canopen.<name>]`: a CANopen device on the CAN bus of the drives, served by its master (docs/io.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct CanopenKeys {
        /// CANopen node: none of the drives, of other devices, nor of the master.
        node: u8 = required, 1..=127;
        /// Its CAN bus, where the drives are on several: `"can.second"`. Absent: the first one, `can.main` if there is
        /// one.
        bus: Option<String> = optional;
        /// Its device profile, the low 16 bits of 0x1000: 401 of inputs and outputs, 418 of a battery; 0: any.
        profile: u16 = PROFILE_401, 0..=0xFFFF;
        /// Required vendor, 0x1018:1. Absent: any.
        vendor: Option<u32> = optional, 0..=u32::MAX;
        /// Required product code, 0x1018:2. Absent: any.
        product: Option<u32> = optional, 0..=u32::MAX;
        /// Its PDOs are used where they carry inputs, as the device has mapped them; beside them, and with `false`
        /// alone, inputs are read by SDO.
        pdo: bool = true;
        /// Period in which each input is read by SDO.
        period_s as period: Duration = 0.1, 0.01..=60.0;
        /// Period in which outputs are written, beside each change.
        refresh_s as refresh: Duration = 0.5, 0.05..=60.0;
        /// Values that nothing has confirmed for this time are not valid: longer than `period_s`, with outputs than
        /// `refresh_s`. An input of `[stop]` is unknown after 0.5 s, whatever is set here.
        age_max_s as age_max: Duration = 1.5, 0.05..=300.0;
        /// Period of its heartbeat, written to 0x1017 at each start.
        heartbeat_s as heartbeat: Duration = 0.1, 0.01..=10.0;
        /// It is lost after this time without a heartbeat: longer than `heartbeat_s`.
        heartbeat_limit_s as heartbeat_limit: Duration = 0.3, 0.02..=60.0;
        /// Outputs of CiA 401 get their safe values from the device itself when it misses the master's heartbeat for
        /// 0.5 s: 0x1016, 0x6206 and 0x6207, 0x6443 and 0x6444 are written at each start, and a device that has not got
        /// them is refused. With `false` its outputs stay as they are then.
        error_values: bool = true;
        /// Its inputs and outputs.
        signals: Vec<ObjectKeys> = [];
    }
    check CanopenKeys::check;
}

settings! {
    /// `[[io.canopen.<name>.signals]]`: a value of a CANopen device.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ObjectKeys {
        /// Name, of one signal of the robot.
        name: String = required;
        /// What it is: by CiA 401 with its `channel`, or an `"object"` by its `index`.
        kind: ObjectKind = required, KINDS;
        /// Inputs and outputs of CiA 401: its number from 0; digital ones are eight to a sub-index.
        channel: Option<u16> = optional, 0..=2031;
        /// An object: its index.
        index: Option<u16> = optional, 0x1000..=0xBFFF;
        /// Its sub-index.
        subindex: u8 = 0, 0..=254;
        /// Its type.
        format: Format = Format::U8, FORMATS;
        /// With `format = "bit"`: the bit, 0 the lowest.
        bit: u8 = 0, 0..=31;
        /// Value = number × scale + offset.
        scale: f64 = 1.0, -1e9..=1e9;
        /// See `scale`.
        offset: f64 = 0.0, -1e9..=1e9;
        /// An object that is written. Otherwise it is read.
        output: bool = false;
        /// Its value in a simulated device, at the start.
        simulated: f64 = 0.0, -1e9..=1e9;
        limits: OutputKeys = flat;
    }
    check ObjectKeys::check;
}

/// Where the value of a signal is in an object dictionary, and what it is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectPlace {
    /// Index of the object.
    pub index: u16,
    /// Its sub-index.
    pub sub: u8,
    /// Its type.
    pub format: Format,
    /// The bit, of [`Format::Bit`].
    pub bit: u8,
    /// The bit is one of eight of an UNSIGNED8, as those of CiA 401.
    pub of_eight: bool,
    /// Value = number × scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
}

impl Format {
    /// Bytes of the object; of a bit 1, which is the size of an output's object.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 | Self::Bit => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
        }
    }

    /// Numbers that it has.
    fn range(self) -> (f64, f64) {
        match self {
            Self::U8 => (0.0, u8::MAX.into()),
            Self::I8 => (i8::MIN.into(), i8::MAX.into()),
            Self::U16 => (0.0, u16::MAX.into()),
            Self::I16 => (i16::MIN.into(), i16::MAX.into()),
            Self::U32 => (0.0, u32::MAX.into()),
            Self::I32 => (i32::MIN.into(), i32::MAX.into()),
            Self::F32 => (f32::MIN.into(), f32::MAX.into()),
            Self::Bit => (0.0, 1.0),
        }
    }
}

impl ObjectPlace {
    /// Value of the object's bytes; `None` if their number is not that of its type, or the value is no number.
    #[must_use]
    pub fn value(&self, bytes: &[u8]) -> Option<f64> {
        let bit_bytes_max = if self.of_eight { 1 } else { 4 };
        let number = match (self.format, bytes) {
            (Format::U8, &[a]) => a.into(),
            (Format::I8, &[a]) => i8::from_le_bytes([a]).into(),
            (Format::U16, &[a, b]) => u16::from_le_bytes([a, b]).into(),
            (Format::I16, &[a, b]) => i16::from_le_bytes([a, b]).into(),
            (Format::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]).into(),
            (Format::I32, &[a, b, c, d]) => i32::from_le_bytes([a, b, c, d]).into(),
            (Format::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]).into(),
            (Format::Bit, bytes) if bytes.len() <= bit_bytes_max => {
                f64::from(bytes.get(usize::from(self.bit / 8))? >> (self.bit % 8) & 1)
            }
            _ => return None,
        };
        let value = number * self.scale + self.offset;
        value.is_finite().then_some(value)
    }

    /// Number of a value, as the bits of the object; of [`Format::Bit`] that bit alone. `None`: the object has no such
    /// number.
    #[must_use]
    pub fn bits(&self, value: f64) -> Option<u32> {
        let number = (value - self.offset) / self.scale;
        let (least, greatest) = self.format.range();
        if self.format == Format::F32 {
            return (least..=greatest).contains(&number).then(|| (number as f32).to_bits());
        }
        let number = libm::round(number);
        if !(least..=greatest).contains(&number) {
            return None;
        }
        let bits = number as i64 as u32;
        Some(match self.format {
            Format::Bit => bits << self.bit,
            Format::U8 | Format::I8 => bits & 0xFF,
            Format::U16 | Format::I16 => bits & 0xFFFF,
            Format::U32 | Format::I32 | Format::F32 => bits,
        })
    }
}

impl CanopenKeys {
    fn check(&self, table: &Table<'_>) {
        if self.signals.is_empty() {
            table.refuse_missing("signals", "at least one signal");
        }
        // A default may be too short, too.
        let refuse = |key: &str, expected: &str| match table.has(key) {
            true => table.refuse(key, expected),
            false => table.refuse_missing(key, expected),
        };
        if self.heartbeat_limit <= self.heartbeat {
            refuse("heartbeat_limit_s", "a time longer than heartbeat_s");
        }
        let writes = self.signals.iter().any(ObjectKeys::is_output);
        if self.age_max <= self.period || writes && self.age_max <= self.refresh {
            refuse("age_max_s", "a time longer than period_s, with outputs than refresh_s");
        }
        for (n, signal) in self.signals.iter().enumerate().filter(|(_, signal)| signal.is_output()) {
            let place = signal.place();
            let clash = |other: &ObjectKeys| {
                let at = other.place();
                let same = (at.index, at.sub) == (place.index, place.sub);
                same && (at.format != Format::Bit || place.format != Format::Bit || at.bit == place.bit)
            };
            if self.signals[..n].iter().filter(|other| other.is_output()).any(clash) {
                let key = if signal.kind == ObjectKind::Object { "index" } else { "channel" };
                let _ = table.item("signals", n).map(|item| item.refuse(key, "one that no other output has"));
            }
            let zero = signal.limits.safe.and_then(|safe| place.bits(safe)) == Some(0);
            if self.error_values && signal.kind == ObjectKind::AnalogueOut && !zero {
                let expected =
                    "a value whose number is 0: devices differ in the type of 0x6444; else error_values = false";
                let _ = table.item("signals", n).map(|item| item.refuse("safe", expected));
            }
        }
    }

    /// True if the device itself sets its outputs when it misses the master.
    #[must_use]
    pub fn sets_error_values(&self) -> bool {
        let by_profile = |signal: &ObjectKeys| matches!(signal.kind, ObjectKind::DigitalOut | ObjectKind::AnalogueOut);
        self.error_values && self.signals.iter().any(by_profile)
    }
}

impl ObjectKeys {
    fn check(&self, table: &Table<'_>) {
        let of_profile = self.kind != ObjectKind::Object;
        if of_profile {
            let sub_max = if self.is_digital() { 8 * 254 } else { 254 };
            match self.channel {
                None => table.refuse_missing("channel", "the number of the input or output, from 0"),
                Some(channel) if channel >= sub_max => {
                    table.refuse("channel", format_args!("an integer from 0 to {}", sub_max - 1));
                }
                Some(_) => {}
            }
            for key in ["index", "subindex", "format", "bit", "output"].into_iter().filter(|key| table.has(key)) {
                table.refuse(key, "a key of kind = \"object\" only: this kind has a channel");
            }
        } else {
            if self.index.is_none() {
                table.refuse_missing("index", "the index of the object");
            }
            if self.channel.is_some() {
                table.refuse("channel", "none: an object has index and subindex");
            }
            if self.output && self.format == Format::Bit {
                table.refuse("format", "the type of a whole object: its other bits would be overwritten");
            }
            if self.output && self.index.is_some_and(|index| index < 0x2000) {
                table.refuse("index", "an object of the device, from 0x2000 on: those below set up its communication");
            }
        }
        if self.format != Format::Bit && table.has("bit") && !of_profile {
            table.refuse("bit", "none without format = \"bit\"");
        }
        if self.scale == 0.0 {
            table.refuse("scale", "a number other than 0");
        }
        let place = self.place();
        self.limits.check(table, self.is_output(), |value| place.bits(value).is_some());
    }

    fn is_digital(&self) -> bool {
        matches!(self.kind, ObjectKind::DigitalIn | ObjectKind::DigitalOut)
    }

    /// True if it is written.
    #[must_use]
    pub fn is_output(&self) -> bool {
        match self.kind {
            ObjectKind::DigitalOut | ObjectKind::AnalogueOut => true,
            ObjectKind::DigitalIn | ObjectKind::AnalogueIn => false,
            ObjectKind::Object => self.output,
        }
    }

    /// True for an output that takes this value.
    #[must_use]
    pub fn takes(&self, value: f64) -> bool {
        self.is_output() && self.limits.accepts(value) && self.place().bits(value).is_some()
    }

    /// True for an input that is 0 or 1.
    #[must_use]
    pub fn is_bit_input(&self) -> bool {
        !self.is_output() && self.place().format == Format::Bit && (self.scale, self.offset) == (1.0, 0.0)
    }

    /// Where its value is.
    #[must_use]
    pub fn place(&self) -> ObjectPlace {
        let Self { subindex, format, bit, scale, offset, .. } = *self;
        let channel = self.channel.unwrap_or_default();
        let by_eights = |index| {
            let sub = u8::try_from(channel / 8 + 1).unwrap_or(u8::MAX);
            ObjectPlace { index, sub, format: Format::Bit, bit: (channel % 8) as u8, of_eight: true, scale, offset }
        };
        let by_words = |index| {
            let sub = u8::try_from(channel.saturating_add(1)).unwrap_or(u8::MAX);
            ObjectPlace { index, sub, format: Format::I16, bit: 0, of_eight: false, scale, offset }
        };
        match self.kind {
            ObjectKind::DigitalIn => by_eights(0x6000),
            ObjectKind::DigitalOut => by_eights(0x6200),
            ObjectKind::AnalogueIn => by_words(0x6401),
            ObjectKind::AnalogueOut => by_words(0x6411),
            ObjectKind::Object => {
                let index = self.index.unwrap_or_default();
                ObjectPlace { index, sub: subindex, format, bit, of_eight: false, scale, offset }
            }
        }
    }
}

/// A CANopen device with inputs and outputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Canopen {
    /// Its name, the subject of its faults: `canopen.plc`.
    pub name: String,
    /// Its keys.
    pub keys: CanopenKeys,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(format: Format, bit: u8, scale: f64) -> ObjectPlace {
        ObjectPlace { index: 0x2000, sub: 1, format, bit, of_eight: false, scale, offset: 0.0 }
    }

    #[test]
    fn a_value_has_the_length_of_its_type_or_is_none() {
        assert_eq!(place(Format::I16, 0, 0.5).value(&[0xFE, 0xFF]), Some(-1.0));
        assert_eq!(place(Format::U32, 0, 1.0).value(&[1, 0, 0, 0x80]), Some(2_147_483_649.0));
        assert_eq!(place(Format::F32, 0, 2.0).value(&1.25_f32.to_le_bytes()), Some(2.5));
        assert_eq!(place(Format::F32, 0, 1.0).value(&f32::NAN.to_le_bytes()), None);
        for format in [Format::U8, Format::I8, Format::U16, Format::I16, Format::U32, Format::I32, Format::F32] {
            for len in 0..=8 {
                let known = place(format, 0, 1.0).value(&[0; 8][..len]).is_some();
                assert_eq!(known, len == format.size(), "{format:?} of {len} bytes");
            }
        }
        let bit = place(Format::Bit, 9, 1.0);
        assert_eq!(
            [&[0_u8, 2][..], &[0, 0xFD], &[0xFF], &[], &[0; 5]].map(|bytes| bit.value(bytes)),
            [Some(1.0), Some(0.0), None, None, None]
        );
        let input = ObjectPlace { of_eight: true, ..place(Format::Bit, 3, 1.0) };
        assert_eq!(
            [&[8_u8][..], &[0xF7], &[8, 0], &[8, 0, 0, 0], &[]].map(|bytes| input.value(bytes)),
            [Some(1.0), Some(0.0), None, None, None]
        );
    }

    #[test]
    fn a_value_becomes_the_number_that_is_nearest_or_is_refused() {
        assert_eq!(place(Format::I16, 0, 0.5).bits(-1.0), Some(0xFFFE));
        assert_eq!(place(Format::U8, 0, 0.1).bits(25.5), Some(255));
        assert_eq!(place(Format::U8, 0, 0.1).bits(25.6), None);
        assert_eq!(place(Format::Bit, 3, 1.0).bits(1.0), Some(8));
        assert_eq!(place(Format::Bit, 3, 1.0).bits(2.0), None);
        assert_eq!(place(Format::F32, 0, 1.0).bits(1.5), Some(1.5_f32.to_bits()));
        for value in [f64::NAN, f64::INFINITY] {
            assert_eq!(place(Format::I32, 0, 1.0).bits(value), None);
        }
    }
}
