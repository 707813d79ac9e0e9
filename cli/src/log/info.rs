//! `advee log info`: what a log has.

use super::select::{Selection, date};
use super::source::{Events, Kind, Log, Mcap};
use crate::lcm::table::{aligned, shown};
use crate::progress::Progress;
use crate::{Failed, Outcome, counted, print};
use logger::read::{Damage, Index};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

#[derive(clap::Args)]
pub struct Info {
    /// A run's folder, an MCAP file, or an LCM event log
    log: PathBuf,
    /// Go through all of it: every check made, bytes of each channel counted
    #[arg(long)]
    check: bool,
    /// List the attachments, too
    #[arg(long)]
    all: bool,
    /// JSON lines: one a channel, then {"log": …}
    #[arg(long)]
    json: bool,
}

/// Summary of a channel.
#[derive(Default)]
struct Row {
    types: Vec<String>,
    messages: u64,
    bytes: Option<u64>,
}

pub fn info(command: &Info) -> Outcome {
    let mut log = Log::open(&command.log)?;
    let mut rows = rows(&log);
    if command.check {
        check(&mut log, &mut rows)?;
    }
    let seconds = log.span().map(|(start, end)| (end - start) as f64 / 1e9);
    if command.json {
        for ((channel, encoding), row) in &rows {
            print(json!({
                "channel": channel, "encoding": encoding, "types": row.types, "messages": row.messages,
                "hz": hz(row.messages, seconds), "bytes": row.bytes,
            }))?;
        }
        print(json!({ "log": summary(&log, &rows, seconds) }))?;
    } else {
        text(&log, &rows, seconds, command.all).iter().try_for_each(print)?;
    }
    Ok(ExitCode::SUCCESS)
}

type Rows = BTreeMap<(String, String), Row>;

fn rows(log: &Log) -> Rows {
    let mut rows: Rows =
        log.channels().into_iter().map(|(name, messages)| (name, Row { messages, ..Row::default() })).collect();
    match &log.kind {
        Kind::Mcap(files) => {
            for index in files.iter().map(|file| &file.index) {
                for channel in index.channels.values() {
                    let name = (channel.topic.clone(), channel.encoding.clone());
                    let schema = index.schemas.get(&channel.schema_id).map(|schema| schema.name.clone());
                    if let Some((row, schema)) = rows.get_mut(&name).zip(schema)
                        && !row.types.contains(&schema)
                    {
                        row.types.push(schema);
                    }
                }
            }
        }
        Kind::Events(events) => {
            for (name, (_, bytes)) in &events.channels {
                if let Some(row) = rows.get_mut(&(name.clone(), "lcm".into())) {
                    row.bytes = Some(*bytes);
                }
            }
        }
    }
    rows
}

/// Reads every message; what is damaged is known afterwards.
fn check(log: &mut Log, rows: &mut Rows) -> Result<(), Failed> {
    if let Kind::Mcap(files) = &mut log.kind {
        let mut progress = Progress::new("checking");
        for file in files {
            let named = |error: std::io::Error| Failed::from(format!("{}: {error}", file.path.display()));
            let opened = File::open(&file.path).map_err(named)?;
            let scanned = Index::scan(opened, &mut |done, all| progress.tell(done, all)).map_err(named)?;
            file.index = Arc::new(Index { indexed: file.index.indexed, ..scanned });
        }
    }
    rows.values_mut().for_each(|row| (row.messages, row.bytes) = (0, Some(0)));
    let mut progress = Progress::new("counting");
    let mut items = log.items(&Selection::all())?;
    let mut count = 0_u64;
    while let Some(item) = items.next()? {
        let row = match rows.get_mut(&(item.channel.to_owned(), item.encoding.to_owned())) {
            Some(row) => row,
            None => rows.entry((item.channel.to_owned(), item.encoding.to_owned())).or_default(),
        };
        row.messages += 1;
        *row.bytes.get_or_insert(0) += item.data.len() as u64;
        count += 1;
        if count.is_multiple_of(4096) {
            let (done, all) = items.progress();
            progress.tell(done, all);
        }
    }
    Ok(())
}

fn hz(messages: u64, seconds: Option<f64>) -> Option<f64> {
    seconds.filter(|seconds| *seconds > 0.0).map(|seconds| (messages.saturating_sub(1)) as f64 / seconds)
}

/// Time and text of each mark.
fn marks(files: &[Mcap]) -> Vec<(u64, String)> {
    let metadata = files.iter().flat_map(|file| &file.index.metadata).filter(|metadata| metadata.name == "mark");
    let mut marks: Vec<(u64, String)> = metadata
        .map(|mark| {
            let get = |key: &str| mark.values.get(key).cloned().unwrap_or_default();
            (get("time").parse().unwrap_or_default(), get("text"))
        })
        .collect();
    marks.sort();
    marks
}

/// Text about the damage of a file.
fn wrong(damage: &Damage) -> Vec<String> {
    let all = [
        (damage.regions, format!("damaged places, {} bytes", damage.bytes)),
        (damage.cut, "bytes of a record that is cut short".into()),
        (damage.sealed, "chunks with a compression that is not known here".into()),
        (damage.lost_channels, "channels whose definition is lost".into()),
        (damage.lost_types, "types whose definition is lost".into()),
        (damage.redefined, "definitions that contradict earlier ones".into()),
    ];
    all.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect()
}

fn summary(log: &Log, rows: &Rows, seconds: Option<f64>) -> Value {
    let (start, end) = log.span().unzip();
    let messages: u64 = rows.values().map(|row| row.messages).sum();
    let mut value = json!({
        "path": log.path.display().to_string(), "start_ns": start, "end_ns": end, "duration_s": seconds,
        "messages": messages, "channels": rows.len(),
    });
    let more = match &log.kind {
        Kind::Events(Events { stats, size, .. }) => json!({
            "format": "lcm", "files": [{
                "path": log.path.display().to_string(), "bytes": size,
                "skipped": stats.skipped, "cut": stats.truncated, "unusable": stats.unusable,
            }],
        }),
        Kind::Mcap(files) => json!({
            "format": "mcap",
            "files": files.iter().map(file_json).collect::<Vec<_>>(),
            "marks": marks(files).iter().map(|(time, text)| json!({"time_ns": time, "text": text})).collect::<Vec<_>>(),
        }),
    };
    if let (Value::Object(value), Value::Object(more)) = (&mut value, more) {
        value.extend(more);
    }
    value
}

fn file_json(file: &Mcap) -> Value {
    let index = &file.index;
    let damage = &index.damage;
    let attachment = |attachment: &logger::read::Attachment| json!({"name": attachment.name, "type": attachment.media_type, "bytes": attachment.data_len});
    json!({
        "path": file.path.display().to_string(), "bytes": index.size, "profile": index.profile,
        "library": index.library, "indexed": index.indexed, "chunks": index.pieces.len(),
        "attachments": index.attachments.iter().map(attachment).collect::<Vec<_>>(),
        "metadata": index.metadata.iter().map(|metadata| json!({"name": metadata.name, "values": metadata.values})).collect::<Vec<_>>(),
        "damage": {
            "regions": damage.regions, "bytes": damage.bytes, "cut": damage.cut, "sealed": damage.sealed,
            "lost_channels": damage.lost_channels, "lost_types": damage.lost_types, "redefined": damage.redefined,
            "places": damage.places,
        },
    })
}

/// What it is, its channels, then its marks, and last what is attached.
fn text(log: &Log, rows: &Rows, seconds: Option<f64>, all: bool) -> Vec<String> {
    let messages: u64 = rows.values().map(|row| row.messages).sum();
    let mut lines = vec![shown(&log.path.display().to_string())];
    if let (Some((start, end)), Some(seconds)) = (log.span(), seconds) {
        lines.push(format!("  from {} to {} UTC, {seconds:.3} s", date(start), date(end)));
    }
    lines.push(format!("  {} on {}", counted(messages, "message"), counted(rows.len() as u64, "channel")));
    match &log.kind {
        Kind::Events(events) => {
            lines.push(format!("  LCM event log, {}", size(events.size)));
            let stats = &events.stats;
            if stats.skipped + stats.truncated > 0 {
                lines.push(format!(
                    "  {} bytes are no event, {} at the end are one that is cut short",
                    stats.skipped, stats.truncated
                ));
            }
        }
        Kind::Mcap(files) => {
            files.iter().for_each(|file| file_text(file, &mut lines));
        }
    }
    lines.push(String::new());
    let heads = ["CHANNEL", "TYPE", "ENCODING", "MESSAGES", "HZ", "BYTES"];
    let mut cells = vec![heads.map(String::from).to_vec()];
    for ((channel, encoding), row) in rows {
        let or_none = |text: String| if text.is_empty() { "-".into() } else { text };
        cells.push(vec![
            shown(channel),
            or_none(shown(&row.types.join(", "))),
            or_none(shown(encoding)),
            row.messages.to_string(),
            hz(row.messages, seconds).map_or("-".into(), |hz| format!("{hz:.1}")),
            row.bytes.map_or("-".into(), |bytes| bytes.to_string()),
        ]);
    }
    lines.extend(aligned(&cells, 3));
    if let Kind::Mcap(files) = &log.kind {
        let more = [marks_text(files), attached(files, all)];
        for part in more.into_iter().filter(|part: &Vec<String>| !part.is_empty()) {
            lines.push(String::new());
            lines.extend(part);
        }
    }
    lines
}

fn marks_text(files: &[Mcap]) -> Vec<String> {
    marks(files).into_iter().map(|(time, text)| format!("mark {} {}", date(time), shown(&text))).collect()
}

/// Metadata and attachments of all files; of the attachments only number and size, unless all are wanted.
fn attached(files: &[Mcap], all: bool) -> Vec<String> {
    let values = |values: &BTreeMap<String, String>| {
        values.iter().map(|(key, value)| format!("{key}={value}")).collect::<Vec<_>>().join(" ")
    };
    let metadata = files.iter().flat_map(|file| &file.index.metadata).filter(|metadata| metadata.name != "mark");
    let metadata = metadata.map(|metadata| format!("{} {}", shown(&metadata.name), shown(&values(&metadata.values))));
    let mut lines: Vec<String> = metadata.collect();
    let attachments = || files.iter().flat_map(|file| &file.index.attachments);
    if all {
        let line = |attachment: &logger::read::Attachment| {
            format!("attachment {}, {}", shown(&attachment.name), size(attachment.data_len))
        };
        lines.extend(attachments().map(line));
    } else if attachments().next().is_some() {
        let (count, bytes) = (attachments().count() as u64, attachments().map(|attachment| attachment.data_len).sum());
        lines.push(format!("{}, {}; --all lists them", counted(count, "attachment"), size(bytes)));
    }
    lines
}

fn file_text(file: &Mcap, lines: &mut Vec<String>) {
    let index = &file.index;
    let name = file.path.file_name().unwrap_or(file.path.as_os_str()).to_string_lossy();
    let by = if index.library.is_empty() { "nobody" } else { &index.library };
    let mut compressions: Vec<&str> = index.pieces.iter().map(|piece| piece.compression.as_str()).collect();
    compressions.sort_unstable();
    compressions.dedup();
    compressions.retain(|compression| !compression.is_empty());
    let packed = if compressions.is_empty() { String::new() } else { format!(", {}", shown(&compressions.join(", "))) };
    let how = format!("{} chunks{packed}, by {}", index.pieces.len(), shown(by));
    lines.push(format!("  {}: {}, {how}", shown(&name), size(index.size)));
    if !index.indexed {
        lines.push("    was cut off, or is being written: it has no index (advee log recover makes one)".into());
    }
    lines.extend(wrong(&index.damage).iter().map(|wrong| format!("    {wrong}")));
}

fn size(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}
