//! A table for each channel.

use super::decode::Decoder;
use super::feed::{Batch, Fed, Feed};
use super::select::Selection;
use super::source::{Item, Log};
use crate::lcm::types::TypesArg;
use crate::progress::Interruptible;
use crate::{Failed, complain};
use lcm_gen::dynamic::Columns;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// A wider table opens nowhere.
const COLUMNS_MAX: usize = 100_000;
/// Maximum number of open files; with more channels each write opens its own.
const OPEN_MAX: usize = 500;
/// Maximum number of threads that write tables.
const THREADS_MAX: usize = 8;
/// Size of the messages that they write at a time, bytes: while the log is read, and of those in memory.
const GROUP: usize = 4 << 20;
const GROUP_KEPT: usize = 16 << 20;
/// Costs of a row that does not depend on its columns, in cells.
const ROW: u64 = 4;
/// Size of a table's write buffer, bytes.
const BUFFER: usize = 1 << 18;
/// Maximum size of a selection that stays in memory between the two passes, bytes; a larger one is read twice.
pub const KEPT_MAX: usize = 64 << 20;

/// Maximum number of channels without a table that are named.
const NAMED_MAX: usize = 20;

/// Result of an interrupted export.
const CUT: &str = "tables are missing or cut";

/// A table.
#[derive(Default)]
struct Table {
    columns: Columns,
    /// True if messages of the type may have further columns.
    grows: bool,
    path: Option<PathBuf>,
    file: Option<File>,
    buffer: Vec<u8>,
    /// All messages in the first pass, rows in the second.
    rows: u64,
    undecoded: u64,
    /// Messages of the channel's other types.
    others: u64,
    /// Elements of arrays beyond the columns.
    left_out: u64,
    /// Size of the rows' messages, bytes.
    bytes: u64,
    /// The type; the first message's.
    ty: String,
}

/// Summary of the written files.
pub struct Written {
    /// Path, rows.
    pub tables: Vec<(PathBuf, u64)>,
    pub messages: u64,
    pub bytes: u64,
}

pub struct Export<'a> {
    pub log: Arc<Log>,
    pub selection: Selection,
    /// A folder; none: stdout, for one channel.
    pub folder: Option<&'a Path>,
    /// Maximum number of columns of an array.
    pub elements_max: usize,
    /// Maximum size of the messages in memory, bytes: [`KEPT_MAX`].
    pub kept_max: usize,
    pub types: &'a TypesArg,
}

/// All messages of the selection, for the second pass.
#[derive(Default)]
struct Kept {
    batches: Vec<Batch>,
    /// Size of the batches, bytes.
    bytes: usize,
}

impl Kept {
    /// Takes the next batch in; `None` if that is too much.
    fn with(mut self, batch: Batch, max: usize) -> Option<Self> {
        self.bytes += batch.size();
        self.batches.push(batch);
        Some(self).filter(|kept| kept.bytes <= max)
    }
}

impl Export<'_> {
    pub fn run(&self) -> Result<Written, Failed> {
        let (mut tables, kept) = self.measure()?;
        if tables.is_empty() {
            return Err("no message in that selection can be decoded".into());
        }
        if self.folder.is_none() && tables.len() > 1 {
            let names: Vec<&str> = tables.keys().map(String::as_str).take(5).collect();
            let why = format!(
                "{} channels ({} …): one goes to stdout, more go to --out FOLDER",
                tables.len(),
                names.join(", ")
            );
            return Err(why.into());
        }
        if let Some(folder) = self.folder {
            fs::create_dir_all(folder).map_err(|error| named(folder, error))?;
        }
        name(&mut tables, self.folder);
        for (channel, table) in &mut tables {
            let columns = table.columns.count();
            if columns > COLUMNS_MAX {
                return Err(format!("{channel}: {columns} columns; --elements N limits those of an array").into());
            }
            let mut names = String::from("log_time");
            table.columns.names(&mut names);
            table.buffer.extend_from_slice(names.as_bytes());
            table.buffer.push(b'\n');
            if let Some(path) = &table.path {
                File::create(path).map_err(|error| named(path, error))?;
            }
        }
        self.write(tables, kept)
    }

    /// Goes through what has arrays, and the first message of all else. Returns the messages too, unless they are too
    /// many.
    fn measure(&self) -> Result<(BTreeMap<String, Table>, Option<Kept>), Failed> {
        let mut tables: BTreeMap<String, Table> = BTreeMap::new();
        let mut decoder = Decoder::new(self.types)?;
        let mut take = |item: &Item<'_>| {
            let table = match tables.get_mut(item.channel) {
                Some(table) => table,
                None => tables.entry(item.channel.into()).or_default(),
            };
            table.rows += 1;
            if table.ty.is_empty() || table.grows {
                match decoder.decode(item) {
                    Ok(message) => {
                        let ty = message.ty().name();
                        if table.ty.is_empty() {
                            table.ty = ty.into();
                        }
                        if table.ty == ty {
                            table.columns.measure(&message, self.elements_max);
                            table.grows = table.columns.may_grow();
                        }
                    }
                    Err(_) => table.undecoded += 1,
                }
            }
        };
        let mut kept = Some(Kept::default());
        let left_out = self.read("measuring", |batch| {
            batch.items().for_each(|item| take(&item));
            kept = kept.take().and_then(|kept| kept.with(batch, self.kept_max));
            Ok(())
        })?;
        if let Some(left_out) = left_out {
            complain(&left_out);
        }
        let mut unknown = tables.iter().filter(|(_, table)| table.ty.is_empty()).map(|(channel, _)| channel);
        for channel in unknown.by_ref().take(NAMED_MAX) {
            complain(&format!("{}: no message can be decoded; left out", channel.escape_debug()));
        }
        let more = unknown.count();
        if more > 0 {
            complain(&format!("{}: no message can be decoded; left out", crate::counted(more as u64, "more channel")));
        }
        tables.retain(|_, table| !table.ty.is_empty());
        tables.values_mut().for_each(|table| table.undecoded = 0);
        Ok((tables, kept))
    }

    fn write(&self, tables: BTreeMap<String, Table>, kept: Option<Kept>) -> Result<Written, Failed> {
        let keep_open = tables.len() <= OPEN_MAX;
        let mut writers = Writer::share(tables, &Decoder::new(self.types)?, keep_open);
        match kept {
            Some(Kept { batches, .. }) => {
                let mut progress = Interruptible::new("writing", CUT)?;
                let (mut done, all) = (0, batches.len() as u64);
                let mut batches = batches.into_iter();
                loop {
                    let group = Group::of(&mut batches, GROUP_KEPT);
                    if group.0.is_empty() {
                        break;
                    }
                    done += group.0.len() as u64;
                    group.write(&mut writers)?;
                    progress.tell(done, all)?;
                }
            }
            None => {
                let mut group = Group::default();
                // What is left out is known from the first pass.
                self.read("writing", |batch| {
                    group.0.push(batch);
                    if group.is_full(GROUP) { std::mem::take(&mut group).write(&mut writers) } else { Ok(()) }
                })?;
                group.write(&mut writers)?;
            }
        }
        let mut tables: BTreeMap<String, Table> = BTreeMap::new();
        writers.into_iter().for_each(|writer| tables.extend(writer.tables));
        tables.values_mut().try_for_each(|table| table.flush(keep_open))?;
        for (channel, table) in &tables {
            for (count, what) in [(table.undecoded, "cannot be decoded"), (table.others, "are of another type")] {
                if count > 0 {
                    complain(&format!("{}: {count} messages {what}; left out", channel.escape_debug()));
                }
            }
        }
        let left_out: u64 = tables.values().map(|table| table.left_out).sum();
        if left_out > 0 {
            let max = self.elements_max;
            complain(&format!("{left_out} elements beyond {max} of an array were left out; --elements says how many"));
        }
        let messages = tables.values().map(|table| table.rows).sum();
        let bytes = tables.values().map(|table| table.bytes).sum();
        let tables = tables.values().filter_map(|table| Some((table.path.clone()?, table.rows))).collect();
        Ok(Written { tables, messages, bytes })
    }

    /// Reads the selection. Returns a text about omitted parts, if any.
    fn read(
        &self,
        what: &'static str,
        mut take: impl FnMut(Batch) -> Result<(), Failed>,
    ) -> Result<Option<String>, Failed> {
        let mut progress = Interruptible::new(what, CUT)?;
        let feed = Feed::start(&self.log, &self.selection)?;
        loop {
            match feed.next(Duration::from_secs(1))? {
                Fed::Batch(batch) => {
                    take(batch)?;
                    let (done, all) = feed.progress();
                    progress.tell(done, all)?;
                }
                Fed::Nothing => {}
                Fed::End => return Ok(feed.left_out()),
            }
        }
    }
}

/// Messages that are written together.
#[derive(Default)]
struct Group(Vec<Batch>);

impl Group {
    /// The next batches, until there are `size` bytes.
    fn of(batches: &mut impl Iterator<Item = Batch>, size: usize) -> Self {
        let mut group = Self::default();
        while !group.is_full(size)
            && let Some(batch) = batches.next()
        {
            group.0.push(batch);
        }
        group
    }

    fn is_full(&self, size: usize) -> bool {
        self.0.iter().map(Batch::size).sum::<usize>() >= size
    }

    /// Has all writers write their messages, at the same time.
    fn write(self, writers: &mut [Writer]) -> Result<(), Failed> {
        let write = |writer: &mut Writer| {
            self.0.iter().flat_map(Batch::numbered).try_for_each(|(number, item)| writer.take(number, &item))
        };
        let Some((here, others)) = writers.split_first_mut() else { return Ok(()) };
        thread::scope(|scope| {
            let others: Vec<_> = others.iter_mut().map(|writer| scope.spawn(move || write(writer))).collect();
            let written = write(here);
            let ended = others
                .into_iter()
                .map(|thread| thread.join().unwrap_or_else(|_| Err(Failed::from("a thread ended".to_string()))));
            ended.fold(written, Result::and)
        })
    }
}

/// Writes some of the tables.
struct Writer {
    /// By channel, in order.
    tables: Vec<(String, Table)>,
    /// By number of the messages.
    places: Vec<Place>,
    decoder: Decoder,
    keep_open: bool,
}

/// Where messages are written.
#[derive(Clone, Copy)]
enum Place {
    Unknown,
    /// By another writer, or nowhere.
    Elsewhere,
    /// To this table.
    Here(usize),
}

impl Writer {
    /// A writer for each processor, with about the same number of cells.
    fn share(tables: BTreeMap<String, Table>, decoder: &Decoder, keep_open: bool) -> Vec<Self> {
        let count = thread::available_parallelism().map_or(1, usize::from).min(THREADS_MAX).min(tables.len());
        let mut shares: Vec<(u64, Self)> = (0..count.max(1))
            .map(|_| (0, Self { tables: Vec::new(), places: Vec::new(), decoder: decoder.another(), keep_open }))
            .collect();
        let cost = |mut table: Table| {
            let rows = std::mem::take(&mut table.rows);
            (rows.saturating_mul(ROW + table.columns.count() as u64), table)
        };
        let mut tables: Vec<(String, (u64, Table))> =
            tables.into_iter().map(|(channel, table)| (channel, cost(table))).collect();
        tables.sort_by_key(|(_, (cost, _))| Reverse(*cost));
        for (channel, (cost, table)) in tables {
            if let Some((sum, writer)) = shares.iter_mut().min_by_key(|(sum, _)| *sum) {
                *sum = sum.saturating_add(cost);
                writer.tables.push((channel, table));
            }
        }
        shares.iter_mut().for_each(|(_, writer)| writer.tables.sort_by(|(a, _), (b, _)| a.cmp(b)));
        shares.into_iter().map(|(_, writer)| writer).collect()
    }

    /// Table of the messages with this number.
    fn place(&mut self, number: usize, channel: &str) -> Place {
        if number >= self.places.len() {
            self.places.resize(number + 1, Place::Unknown);
        }
        let place = &mut self.places[number];
        if let Place::Unknown = place {
            let found = self.tables.binary_search_by(|(name, _)| name.as_str().cmp(channel));
            *place = found.map_or(Place::Elsewhere, Place::Here);
        }
        *place
    }

    fn take(&mut self, number: usize, item: &Item<'_>) -> Result<(), Failed> {
        let Place::Here(at) = self.place(number, item.channel) else { return Ok(()) };
        let (_, table) = &mut self.tables[at];
        let message = match self.decoder.decode(item) {
            Ok(message) if message.ty().name() == table.ty => message,
            Ok(_) => {
                table.others += 1;
                return Ok(());
            }
            Err(_) => {
                table.undecoded += 1;
                return Ok(());
            }
        };
        write!(table.buffer, "{}", item.log_time).map_err(|error| Failed::from(error.to_string()))?;
        table.left_out += table.columns.write(&message, &mut table.buffer);
        table.buffer.push(b'\n');
        table.rows += 1;
        table.bytes += item.data.len() as u64;
        if table.buffer.len() >= BUFFER { table.flush(self.keep_open) } else { Ok(()) }
    }
}

impl Table {
    fn flush(&mut self, keep_open: bool) -> Result<(), Failed> {
        let Some(path) = &self.path else {
            let mut out = BufWriter::new(io::stdout().lock());
            let written = out.write_all(&self.buffer).and_then(|()| out.flush());
            self.buffer.clear();
            return written.map_err(|error| match error.kind() {
                io::ErrorKind::BrokenPipe => Failed { code: 0, why: String::new() },
                _ => Failed::from(format!("stdout: {error}")),
            });
        };
        let mut file = match self.file.take() {
            Some(file) => file,
            None => File::options().append(true).open(path).map_err(|error| named(path, error))?,
        };
        file.write_all(&self.buffer).map_err(|error| named(path, error))?;
        self.buffer.clear();
        self.file = Some(file).filter(|_| keep_open);
        if self.buffer.capacity() > 4 * BUFFER || !keep_open {
            self.buffer = Vec::new();
        }
        Ok(())
    }
}

/// Gives each table its file, new and empty: `CHANNEL.csv`, what no file may be called replaced by `_`.
fn name(tables: &mut BTreeMap<String, Table>, folder: Option<&Path>) {
    let Some(folder) = folder else { return };
    let mut taken = std::collections::BTreeSet::new();
    for (channel, table) in tables {
        let plain = |c: char| if c.is_alphanumeric() || "_-.".contains(c) { c } else { '_' };
        let stem: String = channel.trim_start_matches(['/', '.']).chars().map(plain).take(100).collect();
        let numbered = (1..).map(|n| if n == 1 { stem.clone() } else { format!("{stem}_{n}") });
        let name = numbered.into_iter().find(|name| taken.insert(name.clone())).unwrap_or_default();
        table.path = Some(folder.join(format!("{name}.csv")));
    }
}

fn named(path: &Path, error: impl std::fmt::Display) -> Failed {
    format!("{}: {error}", path.display()).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::select::Select;
    use messages::{Message, lowlevel};

    /// Tables of a log whose messages have one range, then three, by file name.
    fn tables(kept_max: usize) -> BTreeMap<String, String> {
        let folder = std::env::temp_dir().join(format!("advee-csv-{}-{kept_max}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("run.lcmlog");
        let mut events = lcm::eventlog::Writer::new(File::create(&path).unwrap());
        for n in 0..5 {
            let srfs = vec![lowlevel::Range::default(); if n < 3 { 1 } else { 3 }];
            let mut bytes = Vec::new();
            Message::from(lowlevel::DataSrfs { timestamp: n, srfs }).encode(&mut bytes).unwrap();
            events.write(n, "LL_DATA_SRFS", &bytes).unwrap();
            events.write(n, "LL_DATA_SRFS", b"none of ours").unwrap();
        }
        events.flush().unwrap();
        let log = Arc::new(Log::open(&path).unwrap());
        let selection = Selection::of(&Select::default(), &log).unwrap();
        let (out, types) = (folder.join("out"), TypesArg::default());
        let export = Export { log, selection, folder: Some(&out), elements_max: 1000, kept_max, types: &types };
        let written = export.run().unwrap();
        assert_eq!(written.messages, 5);
        let read = |(path, _): &(PathBuf, u64)| {
            (path.file_name().unwrap().to_str().unwrap().into(), fs::read_to_string(path).unwrap())
        };
        let tables = written.tables.iter().map(read).collect();
        fs::remove_dir_all(&folder).unwrap();
        tables
    }

    #[test]
    fn a_log_too_large_for_memory_gives_the_same_tables() {
        let (kept, read_twice) = (tables(KEPT_MAX), tables(0));
        assert_eq!(kept, read_twice);
        let lines: Vec<&str> = kept["LL_DATA_SRFS.csv"].lines().collect();
        assert_eq!(lines.len(), 6);
        assert!(lines[0].starts_with("log_time,timestamp,srfs[0]."));
        let columns = |line: &str| line.split(',').count();
        assert!(lines.iter().all(|line| columns(line) == columns(lines[0])));
        assert!(lines[1].ends_with(",,") && !lines[5].ends_with(','));
    }
}
