//! `advee log cat`: messages as JSON lines; with `--texts` what modules reported, as lines for people.

use super::decode::Decoder;
use super::select::{Select, Selection};
use super::source::{Item, Log};
use super::texts;
use crate::lcm::show::hold_words;
use crate::lcm::types::TypesArg;
use crate::{Failed, Outcome, complain};
use lcm_gen::dynamic::{Message, Value};
use std::borrow::Cow;
use std::io::{self, BufWriter, Write};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Cat {
    /// A run's folder, an MCAP file, or an LCM event log
    log: PathBuf,
    #[command(flatten)]
    select: Select,
    /// Only these members: name,name.name,name[0].name; may be repeated
    #[arg(long, value_name = "MEMBERS", value_delimiter = ',')]
    fields: Vec<String>,
    /// Number of messages
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// JSON lines: {"channel", "utime", "log_time", "type", "message"}, of LL_DATA_HOLD "words" too; it has no other
    /// form
    #[arg(long)]
    json: bool,
    /// Texts, reports and marks as lines for people, reports with file and line; nothing else
    #[arg(long, conflicts_with_all = ["fields", "json"])]
    texts: bool,
    /// Lowest level of these
    #[arg(long, value_name = "LEVEL", requires = "texts", value_parser = texts::LEVELS, default_value = "debug")]
    level: String,
    #[command(flatten)]
    types: TypesArg,
}

pub fn cat(command: &Cat) -> Outcome {
    let log = Log::open(&command.log)?;
    let mut items = log.items(&Selection::of(&command.select, &log)?)?;
    let mut decoder = Decoder::new(&command.types)?;
    let mut out = BufWriter::with_capacity(1 << 16, io::stdout().lock());
    let mut left = command.count.unwrap_or(u64::MAX);
    let from = texts::level(&command.level);
    while left > 0
        && let Some(item) = items.next()?
    {
        if command.texts {
            if let Some(text) = texts::line(&item, from) {
                left -= 1;
                written(writeln!(out, "{text}"))?;
            }
            continue;
        }
        left -= 1;
        written(line(&mut decoder, &item, &command.fields, &mut out))?;
    }
    written(out.flush())?;
    if let Some(left_out) = items.left_out() {
        complain(&left_out);
    }
    Ok(ExitCode::SUCCESS)
}

/// A reader that has read enough ends the command, without a word.
fn written(result: io::Result<()>) -> Result<(), Failed> {
    result.map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Failed { code: 0, why: String::new() },
        _ => Failed::from(format!("stdout: {error}")),
    })
}

fn line(decoder: &mut Decoder, item: &Item<'_>, fields: &[String], out: &mut impl Write) -> io::Result<()> {
    let channel = serde_json::Value::from(item.channel);
    write!(out, r#"{{"channel":{channel},"utime":{},"log_time":{},"type":"#, item.log_time / 1000, item.log_time)?;
    match decoder.decode(item) {
        Ok(message) => {
            write!(out, "{:?},\"message\":", message.ty().name())?;
            if fields.is_empty() {
                serde_json::to_writer(&mut *out, &message)?;
            } else {
                chosen(&message, fields, out)?;
            }
        }
        Err(why) => {
            let name = item.schema.map(|schema| schema.name.as_str());
            let (name, error) = (serde_json::json!(name), serde_json::json!({ "error": why }));
            write!(out, "{name},\"message\":{error}")?;
        }
    }
    // Numbers of causes with the sentences that people read.
    if let Some(words) = hold_words(item.channel, item.data) {
        write!(out, ",\"words\":{}", serde_json::json!(words))?;
    }
    out.write_all(b"}\n")
}

/// `{"name.name": value, …}`; null where there is none.
fn chosen(message: &Message<'_>, fields: &[String], out: &mut impl Write) -> io::Result<()> {
    let value = message.value();
    out.write_all(b"{")?;
    for (i, field) in fields.iter().enumerate() {
        let comma = if i == 0 { "" } else { "," };
        write!(out, "{comma}{}:", serde_json::Value::from(field.as_str()))?;
        match find(&value, field) {
            Some(value) => serde_json::to_writer(&mut *out, &json(value))?,
            None => out.write_all(b"null")?,
        }
    }
    out.write_all(b"}")
}

/// A member by its path: `srfs[3].distance`.
fn find<'v, 'a>(value: &'v Value<'a>, path: &str) -> Option<&'v Value<'a>> {
    path.split('.').try_fold(value, |value, step| {
        let mut parts = step.split('[');
        let member = value.get(parts.next()?)?;
        parts.try_fold(member, |value, index| match value {
            Value::Array(elements) => elements.get(index.strip_suffix(']')?.parse::<usize>().ok()?),
            _ => None,
        })
    })
}

fn json(value: &Value<'_>) -> serde_json::Value {
    use serde_json::Value as Json;
    match value {
        Value::Null => Json::Null,
        Value::Bool(value) => (*value).into(),
        Value::Int(value) => (*value).into(),
        // As in a whole message.
        Value::Single(value) if value.is_infinite() => value.to_string().into(),
        Value::Float(value) if value.is_infinite() => value.to_string().into(),
        Value::Single(value) => (*value).into(),
        Value::Float(value) => (*value).into(),
        Value::Text(text) => Json::from(Cow::as_ref(text)),
        Value::Array(elements) => elements.iter().map(json).collect(),
        Value::Struct(members) => members.iter().map(|(name, value)| (name.to_string(), json(value))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_member_is_found_by_its_path_or_not_at_all() {
        let range = |id| Value::Struct(vec![("id".into(), Value::Int(id))]);
        let message = Value::Struct(vec![
            ("srfs".into(), Value::Array(vec![range(3), range(4)])),
            ("grid".into(), Value::Array(vec![Value::Array(vec![Value::Int(7)])])),
        ]);
        assert_eq!(find(&message, "srfs[1].id"), Some(&Value::Int(4)));
        assert_eq!(find(&message, "grid[0][0]"), Some(&Value::Int(7)));
        for none in ["", ".", "srfs[2].id", "srfs[x]", "srfs[", "srfs.id", "grid[0][0][0]", "nobody"] {
            assert_eq!(find(&message, none), None, "{none}");
        }
    }
}
