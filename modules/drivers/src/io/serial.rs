//! Devices with simple request and answer on a serial line: their keys, and what is a mistake in them. What is sent and
//! taken by them: `polled`.

use super::output::OutputKeys;
use base::Duration;
use exchange::check::{Check, Method};
use exchange::device::{REQUESTS_MAX, VALUES_MAX};
use exchange::value::{AFTER_MAX, DIGITS_MAX, Kind, Place};
use exchange::{Answer, LEN_MAX, Octets, Protocol};
use settings::{Choice, Parsed, Table, settings};

const CHECKS: Choice<Method> = Choice(&[
    ("none", Method::None),
    ("sum8", Method::Sum8),
    ("sum8-negative", Method::Sum8Negative),
    ("xor8", Method::Xor8),
    ("crc8", Method::Crc8),
    ("crc16-modbus", Method::Crc16Modbus),
    ("crc16-ccitt", Method::Crc16Ccitt),
    ("crc16-xmodem", Method::Crc16Xmodem),
    ("nmea", Method::Nmea),
]);

const FORMATS: Choice<Kind> = Choice(&[
    ("u8", Kind::U8),
    ("i8", Kind::I8),
    ("u16", Kind::U16),
    ("i16", Kind::I16),
    ("u32", Kind::U32),
    ("i32", Kind::I32),
    ("f32", Kind::F32),
    ("bit", Kind::Bit),
    ("decimal", Kind::Decimal),
    ("hex", Kind::Hex),
]);

const BYTES: Parsed<Octets> = Parsed(
    Octets::parse,
    "at most 64 bytes, in hexadecimal digits and text in single quotes: \"02 'A1?' 0D\"",
    "02 'A1?' 0D",
);

/// Rate at which words of a connection pass: that of the fastest line.
const CONNECTION_BAUD: u32 = 4_000_000;

settings! {
    /// Keys of `[io.serial.<name>]` for the driver: a line of devices with simple request and answer (docs/io.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct SerialKeys {
        /// Check of each request and answer, behind its data.
        check: Method = Method::None, CHECKS;
        /// With `check = "crc8"`: its polynomial without the highest term; it begins with 0, the highest bit first.
        check_polynomial: u8 = 0x07, 1..=255;
        /// First byte that the check covers, from 0. Absent: 0, with `"nmea"` 1.
        check_from: Option<u8> = optional, 0..=63;
        /// The check is sent as hexadecimal digits; with `"nmea"` always.
        check_text: bool = false;
        /// Last bytes of each request, behind the check.
        request_end: Octets = Octets::default(), BYTES;
        /// Last bytes of each answer, behind the check. An answer without `answer_length` ends with them.
        answer_end: Octets = Octets::default(), BYTES;
        /// Longest time to an answer, without the time that it takes on the line.
        time_limit_s as time_limit: Duration = 0.1, 0.005..=5.0;
        /// Further attempts before a device counts as lost; a lost one is asked once a second.
        retries: u8 = 2, 0..=10;
        /// Silence of the line before each request.
        gap_s as gap: Duration = 0.005, 0.0..=1.0;
        /// Period in which inputs are read.
        period_s as period: Duration = 0.1, 0.005..=60.0;
        /// Period in which outputs are written, beside each change.
        refresh_s as refresh: Duration = 0.5, 0.01..=60.0;
        /// Older values are not valid.
        age_max_s as age_max: Duration = 1.5, 0.02..=300.0;
        /// What is asked and written.
        requests: Vec<RequestKeys> = [];
    }
    check SerialKeys::check;
}

settings! {
    /// `[[io.serial.<name>.requests]]`: a request and its answer. Its signals are inputs, or outputs.
    #[derive(Clone, Debug, PartialEq)]
    pub struct RequestKeys {
        /// Name in reports, of one request of the line.
        name: String = required;
        /// The device that answers it, of several on the line: one that is lost does not delay the others.
        device: String = "device";
        /// Its bytes, without check and end; where outputs are, any.
        request: Octets = required, BYTES;
        /// The device answers by the request itself.
        echo: bool = false;
        /// The answer, without check and end, if it is always the same.
        answer: Option<Octets> = optional, BYTES;
        /// Bytes of an answer with values, its check and end among them. Absent: it ends with `answer_end`.
        answer_length: Option<u16> = optional, 1..=256;
        /// First bytes of an answer with values; another one is not taken.
        answer_prefix: Octets = Octets::default(), BYTES;
        /// Last bytes of its data, before check and end.
        answer_suffix: Octets = Octets::default(), BYTES;
        /// Values in its answer, or in the request.
        signals: Vec<FieldKeys> = [];
    }
}

settings! {
    /// `[[io.serial.<name>.requests.signals]]`: a value.
    #[derive(Clone, Debug, PartialEq)]
    pub struct FieldKeys {
        /// Name, of one signal of the robot.
        name: String = required;
        /// Its first byte in the answer, of an output in the request, from 0; with `after` counted from behind that.
        at: u8 = 0, 0..=255;
        /// Inputs: the value is behind the first of these bytes.
        after: Octets = Octets::default(), BYTES;
        /// Its type: a number in bytes, a bit of a byte, or decimal or hexadecimal digits.
        format: Kind = required, FORMATS;
        /// Of several bytes the low one is first.
        low_byte_first: bool = false;
        /// With `format = "bit"`: the bit of the byte, 0 the lowest.
        bit: u8 = 0, 0..=7;
        /// Characters of digits, sign, point and spaces. Absent: of an input as many as belong to the number; an output
        /// is inserted into the request, as long as it is.
        length: Option<u8> = optional, 1..=16;
        /// Outputs of decimal digits: digits behind the point.
        decimals: u8 = 0, 0..=9;
        /// Outputs of decimal digits: with a sign in any case.
        signed: bool = false;
        /// Value = number × scale + offset.
        scale: f64 = 1.0, -1e9..=1e9;
        /// See `scale`.
        offset: f64 = 0.0, -1e9..=1e9;
        /// Inputs: the number, before `scale`, by which the device reports that it has no value.
        unknown: Option<f64> = optional, -1e10..=1e10;
        /// It is written. Otherwise it is read.
        output: bool = false;
        /// Inputs: value that a simulated device answers.
        simulated: f64 = 0.0, -1e9..=1e9;
        limits: OutputKeys = flat;
    }
    check FieldKeys::check;
}

/// A serial line with its devices.
#[derive(Clone, Debug, PartialEq)]
pub struct Serial {
    /// The bus's name: `io.serial.board`.
    pub bus: String,
    /// Rate of the line; `None`: a connection.
    pub baud: Option<u32>,
    /// Its keys.
    pub keys: SerialKeys,
}

impl Serial {
    /// Rate of its port; of a connection one that delays nothing.
    #[must_use]
    pub fn line_baud(&self) -> u32 {
        self.baud.unwrap_or(CONNECTION_BAUD)
    }
}

impl SerialKeys {
    /// What all its frames have.
    #[must_use]
    pub fn protocol(&self) -> Protocol {
        let from = self.check_from.unwrap_or(u8::from(self.check == Method::Nmea));
        let check =
            Check { method: self.check, polynomial: self.check_polynomial, from: from.into(), text: self.check_text };
        Protocol { check, request_end: self.request_end.clone(), answer_end: self.answer_end.clone() }
    }

    /// All its signals.
    pub fn signals(&self) -> impl Iterator<Item = &FieldKeys> {
        self.requests.iter().flat_map(|request| &request.signals)
    }

    fn check(&self, table: &Table<'_>) {
        if self.requests.is_empty() {
            table.refuse_missing("requests", "at least one request");
        }
        if self.check != Method::Crc8 {
            table.refuse("check_polynomial", "a key of check = \"crc8\" only");
        }
        let names: Vec<&String> = self.requests.iter().map(|request| &request.name).collect();
        table.unique("requests", "name", &names, "a name that no other request of the line has");
        let protocol = self.protocol();
        for (n, request) in self.requests.iter().enumerate() {
            let Some(item) = table.item("requests", n) else { continue };
            if n >= REQUESTS_MAX {
                item.refuse("name", format_args!("no more than {REQUESTS_MAX} requests of a line"));
            }
            request.check(&item, &protocol);
        }
    }
}

/// A mistake in a key that may be absent.
trait Refuse {
    /// Refuses the key, or that it is missing.
    fn refuse_or_missing(&self, key: &str, expected: &str);
}

impl Refuse for Table<'_> {
    fn refuse_or_missing(&self, key: &str, expected: &str) {
        if self.has(key) { self.refuse(key, expected) } else { self.refuse_missing(key, expected) }
    }
}

impl RequestKeys {
    /// True if it has outputs.
    #[must_use]
    pub fn writes(&self) -> bool {
        self.signals.iter().any(|signal| signal.output)
    }

    /// What is answered to it.
    #[must_use]
    pub fn answer(&self) -> Answer {
        match &self.answer {
            _ if self.echo => Answer::Echo,
            Some(data) => Answer::Exact(data.clone()),
            None => Answer::Data {
                length: self.answer_length.map(usize::from),
                prefix: self.answer_prefix.clone(),
                suffix: self.answer_suffix.clone(),
            },
        }
    }

    fn check(&self, table: &Table<'_>, protocol: &Protocol) {
        if self.request.is_empty() {
            table.refuse("request", "at least one byte");
        }
        if self.signals.is_empty() {
            table.refuse_missing("signals", "at least one signal");
        }
        if self.signals.len() > VALUES_MAX {
            table.refuse("name", format_args!("no more than {VALUES_MAX} signals of a request"));
        }
        let is_known = self.echo || self.answer.is_some();
        if is_known {
            let keys = ["answer_length", "answer_prefix", "answer_suffix"];
            keys.iter().for_each(|key| table.refuse(key, "nothing beside echo or answer"));
        }
        if self.echo {
            table.refuse("answer", "nothing beside echo");
        }
        self.check_answer(table, protocol);
        for (n, signal) in self.signals.iter().enumerate() {
            let Some(item) = table.item("signals", n) else { continue };
            if signal.output != self.writes() {
                item.refuse("name", "an output, as others of this request: inputs need one of their own");
            } else if is_known && !signal.output {
                item.refuse("name", "an output: with echo or answer no value is read");
            } else {
                self.check_place(&item, signal, protocol);
                self.check_overlap(&item, n);
            }
        }
    }

    fn check_answer(&self, table: &Table<'_>, protocol: &Protocol) {
        let longest = LEN_MAX - protocol.check.len() - protocol.request_end.len() - DIGITS_MAX;
        let Some(frame) = protocol.request(self.request.as_slice()).filter(|_| self.request.len() <= longest) else {
            return table.refuse("request", "a shorter one");
        };
        if protocol.expect(&self.answer(), &frame).is_some() {
            return;
        }
        let fixed = self.answer_prefix.len() + self.answer_suffix.len();
        match self.answer_length {
            Some(_) => {
                let least = fixed + protocol.check.len() + protocol.answer_end.len();
                let expected = format!("at least {least}: prefix, suffix, check and answer_end are {least} bytes");
                table.refuse("answer_length", expected);
            }
            None if protocol.check.is_binary() => table.refuse_missing(
                "answer_length",
                "its bytes: a check in bytes may be equal to answer_end; or check_text = true",
            ),
            None => table.refuse_missing("answer_length", "its bytes, or answer_end of the line, or echo, or answer"),
        }
    }

    /// The place of a signal is within the request or the answer.
    fn check_place(&self, item: &Table<'_>, signal: &FieldKeys, protocol: &Protocol) {
        let place = signal.place();
        let ends = place.span().map_or(place.at, |span| span.end);
        if signal.output {
            if ends > self.request.len() {
                let len = self.request.len();
                item.refuse_or_missing("at", &format!("a place within the {len} bytes of the request"));
            }
            return;
        }
        if !place.after.is_empty() {
            return;
        }
        if place.at < self.answer_prefix.len() {
            let len = self.answer_prefix.len();
            item.refuse_or_missing("at", &format!("at least {len}, behind answer_prefix"));
        }
        let len = self.answer_length.and_then(|length| protocol.data_len(length.into()));
        let len = len.map(|len| len.saturating_sub(self.answer_suffix.len()));
        // A text has a character at least.
        let ends = ends.max(place.at + 1);
        if let Some(len) = len.filter(|len| ends > *len) {
            let expected = format!("a place within the {len} bytes of the answer before suffix, check and end");
            item.refuse_or_missing("at", &expected);
        }
    }

    /// No two signals are at the same place, but bits of a byte.
    fn check_overlap(&self, item: &Table<'_>, n: usize) {
        let signal = &self.signals[n];
        let Some(span) = signal.place().span() else {
            if signal.output && self.signals.len() > 1 {
                item.refuse("name", "the only signal of its request, or a length: what is inserted moves the others");
            }
            return;
        };
        let meets = |other: &FieldKeys| {
            let bits = (other.format == Kind::Bit, signal.format == Kind::Bit);
            let apart = match bits {
                (true, true) => other.bit != signal.bit,
                // A status word may be read by its bits, too.
                (true, false) | (false, true) => !signal.output,
                (false, false) => false,
            };
            let span_of = other.place().span();
            !apart && span_of.is_some_and(|other| other.start < span.end && span.start < other.end)
        };
        if let Some(other) = self.signals[..n].iter().find(|other| meets(other)) {
            item.refuse_or_missing("at", &format!("a place that {:?} does not overlap", other.name));
        }
    }
}

impl FieldKeys {
    fn check(&self, table: &Table<'_>) {
        if self.name.is_empty() {
            table.refuse("name", "a name");
        }
        if self.scale == 0.0 {
            table.refuse("scale", "a number other than 0");
        }
        if self.after.len() > AFTER_MAX {
            table.refuse("after", format_args!("at most {AFTER_MAX} bytes"));
        }
        if !self.format.is_text() {
            let keys = ["length", "decimals", "signed"];
            keys.iter().for_each(|key| table.refuse(key, "a key of \"decimal\" and \"hex\" only"));
        }
        if self.format != Kind::Bit {
            table.refuse("bit", "a key of format = \"bit\" only");
        }
        if self.output {
            table.refuse("after", "none: an output is at its place in the request");
            table.refuse("unknown", "none: a key of inputs");
        }
        let place = self.place();
        if self.scale != 0.0 {
            self.limits.check(table, self.output, |value| place.has(value));
        }
    }

    /// True for an output that takes this value.
    #[must_use]
    pub fn takes(&self, value: f64) -> bool {
        self.output && self.limits.accepts(value) && self.place().has(value)
    }

    /// Where its value is.
    #[must_use]
    pub fn place(&self) -> Place {
        Place {
            at: self.at.into(),
            after: self.after.as_slice().iter().copied().take(AFTER_MAX).collect(),
            kind: self.format,
            low_first: self.low_byte_first,
            bit: self.bit,
            length: self.length.map(usize::from),
            decimals: self.decimals.into(),
            signed: self.signed,
            scale: self.scale,
            offset: self.offset,
            unknown: self.unknown,
        }
    }
}
