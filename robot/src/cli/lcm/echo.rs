//! `advee lcm echo`: prints messages as they come.

use crate::cli::bus::{interrupt, wait};
use crate::cli::{Common, Outcome, print, seconds};
use crate::live::bus::{Bus, Raw};
use crate::live::clock;
use base::{Duration, Instant};
use messages::{Channel, Message};
use serde::Serialize;
use serde_json::ser::{Formatter, Serializer};
use std::fmt::Display;
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Echo {
    /// Channels, by a regular expression that must match the whole name
    channel: String,
    /// JSON lines: {"channel", "utime", "type", "message"}
    #[arg(long)]
    json: bool,
    /// How long, s; until Ctrl-C without it
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
}

pub fn echo(common: &Common, command: &Echo) -> Outcome {
    let interrupt = interrupt()?;
    let mut bus = Bus::open(&common.lcm_url(), &[&command.channel])?;
    let until = command.time.map_or(Instant::NEVER, |time| clock::now() + time);
    loop {
        let now = clock::now();
        if now >= until || matches!(interrupt.read_signal(), Ok(Some(_))) {
            return Ok(ExitCode::SUCCESS);
        }
        match bus.receive_raw()? {
            Some(raw) if command.json => print(json(&raw))?,
            Some(raw) => print(text(&raw))?,
            None => wait(&[bus.as_fd(), interrupt.as_fd()], until.since(now))?,
        }
    }
}

/// What came on a channel: a message, or why it is none.
fn decode(raw: &Raw<'_>) -> Result<Message, String> {
    let size = raw.data.len();
    match Message::receive(raw.channel, raw.data) {
        Some(Ok(message)) => Ok(message),
        Some(Err(error)) => Err(format!("malformed, {size} bytes: {error}")),
        None => {
            let by_type = |fingerprint| Channel::ALL.iter().find(|channel| channel.fingerprint() == fingerprint);
            Err(match ::lcm::codec::fingerprint(raw.data) {
                Some(fingerprint) => match by_type(fingerprint) {
                    Some(channel) => {
                        format!("unknown channel, {size} bytes of {}", channel.type_name())
                    }
                    None => format!("unknown channel and type {fingerprint:#018x}, {size} bytes"),
                },
                None => format!("unknown channel, {size} bytes, too short for a message"),
            })
        }
    }
}

fn text(raw: &Raw<'_>) -> String {
    let mut line = raw.channel.escape_debug().to_string();
    match decode(raw) {
        Ok(message) => {
            line.push(' ');
            line.push_str(&compact(&message));
        }
        Err(why) => {
            line.push_str(": ");
            line.push_str(&why);
        }
    }
    line
}

fn json(raw: &Raw<'_>) -> impl Display + use<> {
    let channel = serde_json::Value::from(raw.channel);
    let utime = raw.received_ns / 1000;
    let (kind, message) = match decode(raw) {
        Ok(message) => (format!("{:?}", message.channel().type_name()), serde_json::to_string(&message)),
        Err(why) => {
            let error = serde_json::json!({ "error": why });
            ("null".into(), Ok(error.to_string()))
        }
    };
    // A message has nothing that JSON cannot say.
    let message = message.unwrap_or_else(|_| "null".into());
    format!(r#"{{"channel":{channel},"utime":{utime},"type":{kind},"message":{message}}}"#)
}

/// `key=value key=value`, members in the order of the type; arrays in brackets, nested structs in braces.
fn compact(message: &impl Serialize) -> String {
    let mut out = Vec::new();
    let style = Compact { depth: 0, key: false };
    // Writing to a Vec cannot fail, and a message has nothing that JSON cannot say.
    let _ = message.serialize(&mut Serializer::with_formatter(&mut out, style));
    String::from_utf8(out).unwrap_or_default()
}

/// JSON with other punctuation.
struct Compact {
    depth: u32,
    key: bool,
}

impl Formatter for Compact {
    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth += 1;
        if self.depth > 1 { writer.write_all(b"{") } else { Ok(()) }
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth -= 1;
        if self.depth > 0 { writer.write_all(b"}") } else { Ok(()) }
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.key = true;
        if first { Ok(()) } else { writer.write_all(b" ") }
    }

    fn end_object_key<W: ?Sized + Write>(&mut self, _writer: &mut W) -> io::Result<()> {
        self.key = false;
        Ok(())
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b"=")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        if first { Ok(()) } else { writer.write_all(b" ") }
    }

    fn begin_string<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        if self.key { Ok(()) } else { writer.write_all(b"\"") }
    }

    fn end_string<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        if self.key { Ok(()) } else { writer.write_all(b"\"") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{common, lowlevel};

    fn encoded(message: impl Into<Message>) -> Vec<u8> {
        let mut data = Vec::new();
        message.into().encode(&mut data).unwrap();
        data
    }

    fn raw<'a>(channel: &'a str, data: &'a [u8]) -> Raw<'a> {
        Raw { channel, data, received_ns: 1_700_000_000_123_456_789 }
    }

    #[test]
    fn a_message_is_a_line_of_its_members_in_their_order() {
        let state = common::DataState { timestamp: 7, module: "driver \"x\"".into(), state: 3 };
        let data = encoded(state);
        assert_eq!(text(&raw("CM_DATA_STATE", &data)), r#"CM_DATA_STATE timestamp=7 module="driver \"x\"" state=3"#);
        assert_eq!(
            json(&raw("CM_DATA_STATE", &data)).to_string(),
            r#"{"channel":"CM_DATA_STATE","utime":1700000000123456,"type":"common.data_state_t","message":{"timestamp":7,"module":"driver \"x\"","state":3}}"#
        );
    }

    #[test]
    fn arrays_and_what_is_not_a_number_stay_readable() {
        let range = lowlevel::Range { id: 1, x: 0.5, y: 0.0, theta: 0.0, distance: f64::NAN, valid: false };
        let data = encoded(lowlevel::DataIrs { timestamp: 7, irs: vec![range.clone(), range] });
        let one = "{id=1 x=0.5 y=0.0 theta=0.0 distance=null valid=false}";
        assert_eq!(text(&raw("LL_DATA_IRS", &data)), format!("LL_DATA_IRS timestamp=7 irs=[{one} {one}]"));
    }

    #[test]
    fn what_is_unknown_or_malformed_is_said_with_its_size() {
        let data = encoded(common::DataState { timestamp: 7, module: "m".into(), state: 3 });
        assert_eq!(
            text(&raw("OTHER", &data)),
            format!("OTHER: unknown channel, {} bytes of common.data_state_t", data.len())
        );
        assert_eq!(text(&raw("OTHER", &[1; 9])), "OTHER: unknown channel and type 0x0101010101010101, 9 bytes");
        assert_eq!(text(&raw("O\n", &[])), "O\\n: unknown channel, 0 bytes, too short for a message");
        assert!(text(&raw("CM_DATA_STATE", &data[..12])).starts_with("CM_DATA_STATE: malformed, 12 bytes: "));
        let line = json(&raw("OTHER", &[])).to_string();
        assert!(line.contains(r#""type":null,"message":{"error":"#), "{line}");
    }
}
