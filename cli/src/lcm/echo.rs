//! `advee lcm echo`: prints messages as they come.

use super::ear::{Ear, Heard, Raw, silence};
use super::show::{compact, hold_words, pretty};
use super::types::{Dictionary, Found, TypesArg};
use crate::{Common, Outcome, print, seconds};
use base::{Duration, Instant};
use std::fmt::Display;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Echo {
    /// Channels, by a regular expression that must match the whole name
    channel: String,
    /// JSON lines: {"channel", "utime", "type", "message"}
    #[arg(long)]
    json: bool,
    /// A member a line
    #[arg(long, conflicts_with = "json")]
    pretty: bool,
    /// Number of messages
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Duration, s; without it until Ctrl-C
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    #[command(flatten)]
    types: TypesArg,
}

pub fn echo(common: &Common, command: &Echo) -> Outcome {
    let types = Dictionary::load(&command.types)?;
    let mut ear = Ear::open(common, &command.channel, command.time)?;
    let mut heard = 0;
    while command.count.is_none_or(|count| heard < count) {
        match ear.hear(Instant::NEVER)? {
            Heard::Message(raw) => {
                heard += 1;
                match (command.json, command.pretty) {
                    (true, _) => print(json(&types, &raw)),
                    (_, true) => print(lines(&types, &raw)),
                    _ => print(line(&types, &raw)),
                }?;
            }
            Heard::Nothing => {}
            Heard::Interrupt => break,
            Heard::End => return ended(common, command, heard),
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Result at the end of the time: success if the requested number was received.
fn ended(common: &Common, command: &Echo, heard: u64) -> Outcome {
    match command.count {
        Some(count) => Err(format!("{heard} of {count} messages came, then the time was over").into()),
        None => {
            if heard == 0 {
                silence(common, &command.channel, command.time);
            }
            Ok(ExitCode::SUCCESS)
        }
    }
}

fn line(types: &Dictionary, raw: &Raw<'_>) -> String {
    let mut line = super::table::shown(raw.channel);
    match types.find(raw.channel, raw.data) {
        Found::Message(message) => {
            line.push(' ');
            line.push_str(&compact(&message));
            line.push_str(&words(raw));
        }
        other => {
            line.push_str(": ");
            line.push_str(&why(raw, &other));
        }
    }
    line
}

fn lines(types: &Dictionary, raw: &Raw<'_>) -> String {
    let name = super::table::shown(raw.channel);
    match types.find(raw.channel, raw.data) {
        Found::Message(message) => {
            let words = words(raw);
            format!(
                "{name} {} {}{words}\n{}",
                message.ty().name(),
                time_of_day(raw.received_ns),
                pretty(&message.value())
            )
        }
        other => format!("{name}: {}", why(raw, &other)),
    }
}

fn json(types: &Dictionary, raw: &Raw<'_>) -> impl Display + use<> {
    let channel = serde_json::Value::from(raw.channel);
    let utime = raw.received_ns / 1000;
    let (kind, message) = match types.find(raw.channel, raw.data) {
        Found::Message(message) => (format!("{:?}", message.ty().name()), serde_json::to_string(&message)),
        other => {
            let error = serde_json::json!({ "error": why(raw, &other) });
            ("null".into(), Ok(error.to_string()))
        }
    };
    // Every message can be written as JSON.
    let message = message.unwrap_or_else(|_| "null".into());
    format!(r#"{{"channel":{channel},"utime":{utime},"type":{kind},"message":{message}}}"#)
}

/// Sentences of the causes on `LL_DATA_HOLD`; empty of any other message.
fn words(raw: &Raw<'_>) -> String {
    let words = hold_words(raw.channel, raw.data).filter(|words| !words.is_empty());
    words.map_or_else(String::new, |words| format!(": {}", words.join("; ")))
}

/// Defect of bytes that are no message.
fn why(raw: &Raw<'_>, found: &Found<'_>) -> String {
    format!("{} bytes, {found}", raw.data.len())
}

/// UTC, to the microsecond.
fn time_of_day(ns: u64) -> String {
    let (s, us) = (ns / 1_000_000_000, ns / 1000 % 1_000_000);
    format!("{:02}:{:02}:{:02}.{us:06}", s / 3600 % 24, s / 60 % 60, s % 60)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lcm_gen::dynamic::{Missing, Value};
    use messages::{Channel, Message, common, lowlevel};

    fn encoded(message: impl Into<Message>) -> Vec<u8> {
        let mut data = Vec::new();
        message.into().encode(&mut data).unwrap();
        data
    }

    fn types() -> Dictionary {
        Dictionary::load(&TypesArg::default()).unwrap()
    }

    fn text(raw: &Raw<'_>) -> String {
        line(&types(), raw)
    }

    fn json(raw: &Raw<'_>) -> String {
        super::json(&types(), raw).to_string()
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
            json(&raw("CM_DATA_STATE", &data)),
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
    fn infinities_are_shown_as_they_are_published() {
        let range = |distance| lowlevel::Range { distance, ..lowlevel::Range::default() };
        let irs = [f64::INFINITY, f64::NEG_INFINITY, f64::NAN].map(range).to_vec();
        let data = encoded(lowlevel::DataIrs { timestamp: 7, irs });
        let shown = json(&raw("LL_DATA_IRS", &data));
        let message = shown.split_once(r#""message":"#).unwrap().1.strip_suffix('}').unwrap();
        assert!(message.contains(r#""distance":"inf""#) && message.contains(r#""distance":"-inf""#), "{message}");
        let (value, types) = (serde_json::from_str::<Value<'_>>(message).unwrap(), types());
        let mut again = Vec::new();
        types.get("lowlevel.data_irs_t").unwrap().encode(&value, Missing::Refuse, &mut again).unwrap();
        assert_eq!(again, data);
    }

    #[test]
    fn numbers_of_causes_have_their_sentences_beside_them() {
        let hold = lowlevel::Hold { code: 111, subject: "bumper2".into(), latched: false, since: 3 };
        let other = lowlevel::Hold { code: 405, subject: "web".into(), latched: true, since: 4 };
        let list = |holds| encoded(lowlevel::DataHold { timestamp: 7, module: "driver_canbus".into(), holds });
        let data = list(vec![hold, other]);
        let members =
            r#"[{code=111 subject="bumper2" latched=false since=3} {code=405 subject="web" latched=true since=4}]"#;
        let words = "PAUSE is engaged by bumper2; web must send zero first: the robot was stopped";
        assert_eq!(
            text(&raw("LL_DATA_HOLD", &data)),
            format!(r#"LL_DATA_HOLD timestamp=7 module="driver_canbus" holds={members}: {words}"#)
        );
        assert!(!json(&raw("LL_DATA_HOLD", &data)).contains("engaged"), "the message as it is");
        let acts = text(&raw("LL_DATA_HOLD", &list(vec![])));
        assert_eq!(acts, r#"LL_DATA_HOLD timestamp=7 module="driver_canbus" holds=[]"#);
    }

    #[test]
    fn what_is_unknown_or_malformed_is_said_with_its_size() {
        let data = encoded(common::DataState { timestamp: 7, module: "m".into(), state: 3 });
        // A channel of anybody's, as long as its type is known.
        assert_eq!(text(&raw("OTHER", &data)), r#"OTHER timestamp=7 module="m" state=3"#);
        assert_eq!(
            text(&raw("LL_DATA_ODO", &data)),
            format!("LL_DATA_ODO: {} bytes, a common.data_state_t where lowlevel.data_odo_t belongs", data.len())
        );
        assert_eq!(
            text(&raw("OTHER", &[1; 9])),
            "OTHER: 9 bytes, unknown type 0x0101010101010101; --types says where it is"
        );
        assert_eq!(text(&raw("O\n", &[])), "O\\n: 0 bytes, too short for a message");
        let cut = text(&raw("CM_DATA_STATE", &data[..12]));
        assert_eq!(cut, "CM_DATA_STATE: 12 bytes, malformed common.data_state_t: truncated: 8 bytes needed, 4 left");
        let line = json(&raw("OTHER", &[]));
        assert!(line.contains(r#""type":null,"message":{"error":"#), "{line}");
    }

    #[test]
    fn every_channel_of_the_robots_reads_as_its_generated_type_does() {
        let types = types();
        for channel in Channel::ALL {
            let mut data = Vec::new();
            let ty = types.get(channel.type_name()).unwrap();
            ty.encode(&Value::Struct(vec![]), Missing::Zero, &mut data).unwrap();
            let generated = serde_json::to_string(&Message::decode(*channel, &data).unwrap()).unwrap();
            // Of a family of channels, one.
            let name = if *channel == Channel::LlDataRaw { "LL_DATA_RAW_MAIN" } else { channel.name() };
            let line = super::json(&types, &raw(name, &data)).to_string();
            assert!(line.contains(&format!(r#""type":"{}","message":{generated}"#, channel.type_name())), "{line}");
        }
    }
}
