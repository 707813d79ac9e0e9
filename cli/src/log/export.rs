//! `advee log export`: a log, or a part of it, for other programs.

use super::csv;
use super::select::{Select, Selection};
use super::source::{Items, Kind, Log};
use crate::lcm::types::TypesArg;
use crate::progress::Interruptible;
use crate::{Failed, Outcome, complain, print};
use lcm::eventlog;
use logger::read::{Attachment, Metadata};
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use serde_json::json;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

#[derive(clap::Args)]
pub struct Export {
    /// A run's folder, an MCAP file, or an LCM event log
    log: PathBuf,
    /// csv: a table for each channel; lcm: an official event log; mcap: a log with less in it
    #[arg(long, value_enum)]
    format: Format,
    /// Output: a folder for csv, else a file; csv of one channel goes to stdout without it
    #[arg(long, value_name = "PATH", required_if_eq_any([("format", "lcm"), ("format", "mcap")]))]
    out: Option<PathBuf>,
    #[command(flatten)]
    select: Select,
    /// Maximum number of columns of an array in csv
    #[arg(long, value_name = "N", default_value = "1000", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    elements: u32,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    types: TypesArg,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Csv,
    Lcm,
    Mcap,
}

/// Maximum size of a copied attachment, bytes.
const ATTACHMENT_MAX: u64 = 256 << 20;

pub fn export(command: &Export) -> Outcome {
    let begin = Instant::now();
    let log = Arc::new(Log::open(&command.log)?);
    let selection = Selection::of(&command.select, &log)?;
    let (messages, bytes, files) = match (command.format, &command.out) {
        (Format::Csv, folder) => {
            let (elements_max, types) = (command.elements as usize, &command.types);
            let kept_max = csv::KEPT_MAX;
            let export = csv::Export { log, selection, folder: folder.as_deref(), elements_max, kept_max, types };
            let written = export.run()?;
            if folder.is_none() {
                return Ok(ExitCode::SUCCESS);
            }
            (written.messages, written.bytes, written.tables)
        }
        (format, Some(path)) => {
            let (messages, bytes) =
                if format == Format::Lcm { events(&log, &selection, path)? } else { part(&log, &selection, path)? };
            (messages, bytes, vec![(path.clone(), messages)])
        }
        (_, None) => return Err("--out says where it goes".into()),
    };
    let seconds = begin.elapsed().as_secs_f64();
    if command.json {
        let files: Vec<_> =
            files.iter().map(|(path, count)| json!({"path": path.display().to_string(), "messages": count})).collect();
        print(json!({"messages": messages, "bytes": bytes, "seconds": seconds, "files": files}))?;
    } else {
        for (path, count) in &files {
            print(format_args!("{}: {}", path.display(), crate::counted(*count, "message")))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn named(path: &Path, error: impl std::fmt::Display) -> Failed {
    format!("{}: {error}", path.display()).into()
}

/// A new file that takes the place of `path` when all of it is written: what was there stays until then. A path that is
/// not a regular file, such as `/dev/null` or a pipe, is written to, and not replaced.
pub struct New {
    /// For a regular file: the scratch file beside it, and its final name.
    unfinished: Option<(PathBuf, PathBuf)>,
}

impl New {
    pub fn create(path: &Path) -> Result<(Self, File), Failed> {
        // A symbolic link remains one: the file to which it leads is replaced.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.into());
        if fs::metadata(&path).is_ok_and(|there| !there.is_file()) {
            let file = OpenOptions::new().write(true).open(&path).map_err(|error| named(&path, error))?;
            return Ok((Self { unfinished: None }, file));
        }
        let mut scratch = path.as_os_str().to_owned();
        scratch.push(".part");
        let scratch = PathBuf::from(scratch);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&scratch);
        let file = file.map_err(|error| named(&scratch, error))?;
        Ok((Self { unfinished: Some((scratch, path)) }, file))
    }

    pub fn finish(mut self) -> Result<(), Failed> {
        let Some((scratch, path)) = &self.unfinished else { return Ok(()) };
        fs::rename(scratch, path).map_err(|error| named(path, error))?;
        self.unfinished = None;
        Ok(())
    }
}

impl Drop for New {
    fn drop(&mut self) {
        if let Some((scratch, _)) = &self.unfinished {
            let _ = fs::remove_file(scratch);
        }
    }
}

fn told(items: &Items) {
    if let Some(left_out) = items.left_out() {
        complain(&left_out);
    }
}

/// The messages of LCM as the official logger would have written them.
fn events(log: &Log, selection: &Selection, path: &Path) -> Result<(u64, u64), Failed> {
    let mut items = log.items(selection)?;
    let mut progress = Interruptible::new("exporting", "nothing is written")?;
    let (new, file) = New::create(path)?;
    let mut out = eventlog::Writer::new(BufWriter::with_capacity(1 << 20, file));
    let (mut messages, mut bytes, mut others) = (0_u64, 0, 0_u64);
    while let Some(item) = items.next()? {
        if item.encoding != "lcm" {
            others += 1;
            continue;
        }
        let us = i64::try_from(item.log_time / 1000).unwrap_or(i64::MAX);
        let len = item.data.len() as u64;
        match out.write(us, item.channel, item.data) {
            Ok(_) => (messages, bytes) = (messages + 1, bytes + len),
            Err(eventlog::WriteError::Io(error)) => return Err(named(path, error)),
            Err(_) => others += 1,
        }
        if messages.is_multiple_of(4096) {
            let (done, all) = items.progress();
            progress.tell(done, all)?;
        }
    }
    out.flush().map_err(|error| named(path, error))?;
    told(&items);
    if messages == 0 && others > 0 {
        return Err("no message there is one of LCM's".into());
    }
    if others > 0 {
        complain(&format!("{others} messages cannot stand in an LCM event log; left out"));
    }
    new.finish()?;
    Ok((messages, bytes))
}

/// A log of the same form with less in it: every form of the messages wanted, all attachments, the marks of the time.
fn part(log: &Log, selection: &Selection, path: &Path) -> Result<(u64, u64), Failed> {
    let selection = selection.clone().with_twins();
    let mut items = log.items(&selection)?;
    let mut progress = Interruptible::new("exporting", "nothing is written")?;
    let failed = |error: mcap::McapError| named(path, error);
    let (new, file) = New::create(path)?;
    let profile = match &log.kind {
        Kind::Mcap(files) => files.first().map(|file| file.index.profile.clone()).unwrap_or_default(),
        Kind::Events(_) => String::new(),
    };
    let options = options(&profile);
    let mut out = Writer::with_options(BufWriter::with_capacity(1 << 20, file), options).map_err(failed)?;
    if let Kind::Mcap(files) = &log.kind {
        for file in files {
            let mut source = File::open(&file.path).map_err(|error| named(&file.path, error))?;
            for attachment in &file.index.attachments {
                attach(&mut source, attachment, &mut out).map_err(|why| named(&file.path, why))?;
            }
            for metadata in file.index.metadata.iter().filter(|metadata| in_time(metadata, &selection)) {
                let Metadata { name, values, .. } = metadata.clone();
                out.write_metadata(&mcap::records::Metadata { name, metadata: values }).map_err(failed)?;
            }
        }
    }
    // Of each channel: its key and encoding in the log, and its number in what is written.
    type Ids = Vec<((usize, u16), String, u16)>;
    let mut ids: BTreeMap<String, Ids> = BTreeMap::new();
    let (mut messages, mut bytes) = (0_u64, 0_u64);
    while let Some(item) = items.next()? {
        let known =
            ids.get(item.channel).and_then(|all| all.iter().find(|id| id.0 == item.key && id.1 == item.encoding));
        let channel_id = match known {
            Some((_, _, id)) => *id,
            None => {
                let schema = match item.schema {
                    Some(schema) => out.add_schema(&schema.name, &schema.encoding, &schema.data).map_err(failed)?,
                    None => 0,
                };
                let id = out.add_channel(schema, item.channel, item.encoding, item.metadata).map_err(failed)?;
                ids.entry(item.channel.into()).or_default().push((item.key, item.encoding.into(), id));
                id
            }
        };
        let (sequence, log_time, publish_time) = (item.sequence, item.log_time, item.publish_time);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        out.write_to_known_channel(&header, item.data).map_err(failed)?;
        (messages, bytes) = (messages + 1, bytes + item.data.len() as u64);
        if messages.is_multiple_of(4096) {
            let (done, all) = items.progress();
            progress.tell(done, all)?;
        }
    }
    out.finish().map_err(failed)?;
    out.into_inner().flush().map_err(|error| named(path, error))?;
    told(&items);
    new.finish()?;
    Ok((messages, bytes))
}

/// Options for writing logs.
pub fn options(profile: &str) -> WriteOptions {
    let library = format!("advee {}", env!("CARGO_PKG_VERSION"));
    WriteOptions::new().compression(None).profile(profile).library(library).chunk_size(Some(256 << 10))
}

/// True if a mark is of the time wanted; what is no mark always is.
fn in_time(metadata: &Metadata, selection: &Selection) -> bool {
    let time = metadata.values.get("time").filter(|_| metadata.name == "mark").and_then(|time| time.parse().ok());
    time.is_none_or(|time: u64| (selection.from..=selection.to).contains(&time))
}

fn attach<W: Write + Seek>(source: &mut File, attachment: &Attachment, out: &mut Writer<W>) -> Result<(), String> {
    let Attachment { name, media_type, log_time, create_time, data_offset, data_len, .. } = attachment;
    if *data_len > ATTACHMENT_MAX {
        return Err(format!("attachment {}: longer than {} MiB", name.escape_debug(), ATTACHMENT_MAX >> 20));
    }
    let mut data = Vec::new();
    source.seek(SeekFrom::Start(*data_offset)).map_err(|error| error.to_string())?;
    source.take(*data_len).read_to_end(&mut data).map_err(|error| error.to_string())?;
    let (name, media_type) = (name.clone(), media_type.clone());
    let (log_time, create_time) = (*log_time, *create_time);
    let copy = mcap::Attachment { log_time, create_time, name, media_type, data: Cow::Owned(data) };
    out.attach(&copy).map_err(|error| error.to_string())
}
