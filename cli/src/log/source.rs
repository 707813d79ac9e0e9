//! A log of any kind: a run's folder, an MCAP file, an official LCM event log.

use super::ahead::Threads;
use super::select::Selection;
use crate::Failed;
use crate::progress::Progress;
use lcm::eventlog;
use logger::read::{Channel, Filter, Index, MAGIC, Messages, Schema, Skipped};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A log on the disk.
pub struct Log {
    pub path: PathBuf,
    pub kind: Kind,
}

pub enum Kind {
    /// Files of a run, in order.
    Mcap(Vec<Mcap>),
    Events(Events),
}

/// An MCAP file.
pub struct Mcap {
    pub path: PathBuf,
    pub index: Arc<Index>,
}

/// Channels of an official event log.
#[derive(Default)]
pub struct Events {
    /// Messages and bytes of each channel.
    pub channels: BTreeMap<String, (u64, u64)>,
    /// First and last time, ns since the epoch.
    pub span: Option<(u64, u64)>,
    pub stats: eventlog::Stats,
    pub size: u64,
}

/// Metadata of channels of an event log: none.
static NOTHING: BTreeMap<String, String> = BTreeMap::new();

/// A message of a log.
#[derive(Clone, Copy)]
pub struct Item<'a> {
    /// ns since the epoch.
    pub log_time: u64,
    pub publish_time: u64,
    pub sequence: u32,
    pub channel: &'a str,
    pub encoding: &'a str,
    pub schema: Option<&'a Schema>,
    /// Metadata of the channel.
    pub metadata: &'a BTreeMap<String, String>,
    /// Names the channel among all of the log.
    pub key: (usize, u16),
    pub data: &'a [u8],
}

fn failed(path: &Path, error: impl std::fmt::Display) -> Failed {
    format!("{}: {error}", path.display()).into()
}

impl Log {
    /// Opens what the path names.
    pub fn open(path: &Path) -> Result<Self, Failed> {
        let mut progress = Progress::new("reading");
        let metadata = fs::metadata(path).map_err(|error| failed(path, error))?;
        if metadata.is_dir() {
            let files = run_files(path)?;
            let files = files.into_iter().map(|path| Mcap::open(path, &mut progress)).collect::<Result<_, _>>()?;
            return Ok(Self { path: path.into(), kind: Kind::Mcap(files) });
        }
        let mut begin = Vec::new();
        let file = File::open(path).map_err(|error| failed(path, error))?;
        file.take(8).read_to_end(&mut begin).map_err(|error| failed(path, error))?;
        let kind = if begin.starts_with(&eventlog::SYNC.to_be_bytes()) {
            Kind::Events(Events::open(path, &mut progress)?)
        } else {
            let mcap = Mcap::open(path.into(), &mut progress)?;
            if begin != MAGIC && mcap.index.pieces.is_empty() {
                let events = Events::open(path, &mut progress)?;
                if events.channels.is_empty() {
                    return Err(failed(path, "neither an MCAP file nor an LCM event log"));
                }
                Kind::Events(events)
            } else {
                Kind::Mcap(vec![mcap])
            }
        };
        Ok(Self { path: path.into(), kind })
    }

    /// First and last log time, ns since the epoch.
    pub fn span(&self) -> Option<(u64, u64)> {
        match &self.kind {
            Kind::Events(events) => events.span,
            Kind::Mcap(files) => {
                let spans = || files.iter().filter_map(|file| file.index.span());
                Some((spans().map(|span| span.0).min()?, spans().map(|span| span.1).max()?))
            }
        }
    }

    /// True if there are messages of LCM in it.
    pub fn has_lcm(&self) -> bool {
        match &self.kind {
            Kind::Events(_) => true,
            Kind::Mcap(files) => {
                files.iter().any(|file| file.index.channels.values().any(|channel| channel.encoding == "lcm"))
            }
        }
    }

    /// Names and encodings of the channels that have messages, with how many.
    pub fn channels(&self) -> BTreeMap<(String, String), u64> {
        let mut channels = BTreeMap::new();
        match &self.kind {
            Kind::Events(events) => {
                channels
                    .extend(events.channels.iter().map(|(name, (count, _))| ((name.clone(), "lcm".into()), *count)));
            }
            Kind::Mcap(files) => {
                for index in files.iter().map(|file| &file.index) {
                    for (id, count) in &index.counts {
                        let Some(channel) = index.channels.get(id) else { continue };
                        *channels.entry((channel.topic.clone(), channel.encoding.clone())).or_default() += count;
                    }
                }
            }
        }
        channels
    }

    /// As [`Log::items`], with threads that read ahead.
    pub fn items_ahead(&self, selection: &Selection) -> Result<Items, Failed> {
        let mut items = self.items(selection)?;
        if let (Inner::Mcap(messages), Kind::Mcap(files)) = (&mut items.kind, &self.kind)
            && let Some(threads) = Threads::start(files, &messages.pending())?
        {
            messages.set_ahead(Box::new(threads));
        }
        Ok(items)
    }

    /// The messages of a selection, in order.
    pub fn items(&self, selection: &Selection) -> Result<Items, Failed> {
        let open = |path: &Path| File::open(path).map_err(|error| failed(path, error));
        let path = self.path.clone();
        match &self.kind {
            Kind::Mcap(files) => {
                let opened = files.iter().map(|file| Ok((open(&file.path)?, file.index.clone())));
                let opened = opened.collect::<Result<Vec<_>, Failed>>()?;
                let wants = |channel: &Channel, _: Option<&Schema>| selection.wants(&channel.topic, &channel.encoding);
                let filter = Filter { from: selection.from, to: selection.to, wants: &wants };
                Ok(Items { path, kind: Inner::Mcap(Box::new(Messages::new(opened, &filter))) })
            }
            Kind::Events(events) => {
                let selection = Box::new(selection.clone());
                let reader = eventlog::Reader::new(open(&self.path)?);
                Ok(Items { path, kind: Inner::Events { reader, selection, size: events.size } })
            }
        }
    }
}

/// `log_000.mcap`, `log_001.mcap`, … of a run's folder.
pub fn run_files(folder: &Path) -> Result<Vec<PathBuf>, Failed> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(|error| failed(folder, error))? {
        let path = entry.map_err(|error| failed(folder, error))?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let number = name.strip_prefix("log_").and_then(|rest| rest.strip_suffix(".mcap"));
        if let Some(number) = number.filter(|number| number.bytes().all(|byte| byte.is_ascii_digit()))
            && let Ok(number) = number.parse::<u64>()
        {
            files.push((number, path));
        }
    }
    if files.is_empty() {
        return Err(failed(folder, "no log there: log_000.mcap and so on are missing"));
    }
    files.sort();
    Ok(files.into_iter().map(|(_, path)| path).collect())
}

impl Mcap {
    fn open(path: PathBuf, progress: &mut Progress) -> Result<Self, Failed> {
        let file = File::open(&path).map_err(|error| failed(&path, error))?;
        let index =
            Index::read(file, &mut |done, all| progress.tell(done, all)).map_err(|error| failed(&path, error))?;
        Ok(Self { path, index: Arc::new(index) })
    }
}

impl Events {
    fn open(path: &Path, progress: &mut Progress) -> Result<Self, Failed> {
        let file = File::open(path).map_err(|error| failed(path, error))?;
        let size = file.metadata().map_err(|error| failed(path, error))?.len();
        let mut reader = eventlog::Reader::new(file);
        let mut events = Self { size, ..Self::default() };
        while let Some(event) = reader.next_event().map_err(|error| failed(path, error))? {
            let time = ns(event.timestamp_us);
            events.span = Some(events.span.map_or((time, time), |(start, end)| (start.min(time), end.max(time))));
            let len = event.payload.len() as u64;
            match events.channels.get_mut(event.channel) {
                Some((count, bytes)) => (*count, *bytes) = (*count + 1, *bytes + len),
                None => drop(events.channels.insert(event.channel.into(), (1, len))),
            }
            if reader.stats().events.is_multiple_of(4096) {
                progress.tell(reader.position(), size);
            }
        }
        events.stats = *reader.stats();
        Ok(events)
    }
}

/// Nanoseconds of microseconds; clamped at 1970.
fn ns(us: i64) -> u64 {
    u64::try_from(us).unwrap_or_default().saturating_mul(1000)
}

/// Messages, one after the other.
pub struct Items {
    path: PathBuf,
    kind: Inner,
}

enum Inner {
    Mcap(Box<Messages<File>>),
    Events { reader: eventlog::Reader<File>, selection: Box<Selection>, size: u64 },
}

impl Items {
    /// The next one; `None` at the end.
    pub fn next(&mut self) -> Result<Option<Item<'_>>, Failed> {
        let named = |error: io::Error| failed(&self.path, error);
        match &mut self.kind {
            Inner::Mcap(messages) => {
                let entry = messages.next_entry().map_err(named)?;
                Ok(entry.map(|entry| Item {
                    log_time: entry.message.log_time,
                    publish_time: entry.message.publish_time,
                    sequence: entry.message.sequence,
                    channel: &entry.channel.topic,
                    encoding: &entry.channel.encoding,
                    schema: entry.schema,
                    metadata: &entry.channel.metadata,
                    key: (entry.file, entry.message.channel),
                    data: entry.message.data,
                }))
            }
            Inner::Events { reader, selection, .. } => {
                loop {
                    let Some(event) = reader.peek().map_err(named)? else { return Ok(None) };
                    let time = ns(event.timestamp_us);
                    if (selection.from..=selection.to).contains(&time) && selection.wants(event.channel, "lcm") {
                        break;
                    }
                    reader.next_event().map_err(named)?;
                }
                let event = reader.next_event().map_err(named)?;
                Ok(event.map(|event| Item {
                    log_time: ns(event.timestamp_us),
                    publish_time: ns(event.timestamp_us),
                    sequence: event.number as u32,
                    channel: event.channel,
                    encoding: "lcm",
                    schema: None,
                    metadata: &NOTHING,
                    key: (0, 0),
                    data: event.payload,
                }))
            }
        }
    }

    /// Bytes read, and to be read in all.
    pub fn progress(&self) -> (u64, u64) {
        match &self.kind {
            Inner::Mcap(messages) => messages.progress(),
            Inner::Events { reader, size, .. } => (reader.position(), *size),
        }
    }

    /// Text about omitted parts, if any.
    pub fn left_out(&self) -> Option<String> {
        let parts: Vec<String> = match &self.kind {
            Inner::Mcap(messages) => {
                let Skipped { damaged, sealed, nameless, unordered } = messages.skipped();
                let all = [
                    (damaged, "damaged chunks were left out (advee log recover tells where)"),
                    (sealed, "chunks have a compression that is not known here"),
                    (nameless, "messages are of channels that nobody defines"),
                    (unordered, "messages came after later ones"),
                ];
                all.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect()
            }
            Inner::Events { reader, .. } => {
                let stats = reader.stats();
                let bytes = stats.skipped + stats.truncated;
                (bytes > 0).then(|| format!("{bytes} bytes are no event")).into_iter().collect()
            }
        };
        (!parts.is_empty()).then(|| format!("{}: {}", self.path.display(), parts.join(", ")))
    }
}
