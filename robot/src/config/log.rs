//! `[log]`: what a run writes down, and where.

use logger::Compression;
use settings::Table;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// `[log]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// Whether each module's host writes down what the module is told and answers (`docs/replay.md`); default false.
    pub inputs: bool,
    /// One such file is not longer than this, 1e6..=1e12 bytes; default 256e6.
    pub inputs_max_bytes: u64,
    /// Where each run gets a folder, from the configuration folder on; none: `log` in a checkout, else `/opt/advee/log`.
    pub folder: Option<PathBuf>,
    /// Whether the logger records from the start, or when it is told to; default true.
    pub start: bool,
    /// How its chunks are compressed: `none`, `lz4`, `zstd` (default).
    pub compression: Compression,
    /// A file of messages that is longer is followed by the next, 1e6..=1e12 bytes; default 256e6.
    pub file_max_bytes: u64,
    /// What waits for the disk, 1e6..=1e9 bytes; beyond it messages are dropped; default 32e6.
    pub buffer_bytes: usize,
    /// While nothing is recorded the messages of so long are kept for a recording that begins, 0..=600 s; default 10.
    pub pretrigger_s: f64,
    /// And at most so many bytes of them, 0..=1e9; default 16e6.
    pub pretrigger_bytes: usize,
    /// So much stays free on the disk, 0..=1e15 bytes; default 200e6.
    pub keep_free_bytes: u64,
    /// All runs together take no more than this, 1e6..=1e15 bytes; default 8e9.
    pub keep_runs_bytes: u64,
}

impl Default for Log {
    fn default() -> Self {
        let logger = logger::Config::default();
        Self {
            inputs: false,
            inputs_max_bytes: 256_000_000,
            folder: None,
            start: logger.start,
            compression: logger.compression,
            file_max_bytes: logger.file_max_bytes,
            buffer_bytes: logger.buffer_bytes,
            pretrigger_s: logger.pretrigger.as_secs_f64(),
            pretrigger_bytes: logger.pretrigger_bytes,
            keep_free_bytes: logger.keep_free_bytes,
            keep_runs_bytes: logger.keep_runs_bytes,
        }
    }
}

const COMPRESSIONS: &[(&str, Compression)] =
    &[("none", Compression::None), ("lz4", Compression::Lz4), ("zstd", Compression::Zstd)];

impl Log {
    pub(super) fn read(mut table: Table<'_>) -> Self {
        let default = Self::default();
        let mut bytes = |key: &'static str, usual: u64, allowed: RangeInclusive<f64>| {
            table.number(key, Some(usual as f64), allowed) as u64
        };
        let inputs_max_bytes = bytes("inputs_max_bytes", default.inputs_max_bytes, 1e6..=1e12);
        // Where a place in a file has 32 bits, so that what is over the limit before a file is closed stays below 2 GiB.
        let largest = if cfg!(target_pointer_width = "32") { 2e9 } else { 1e12 };
        let file_max_bytes = bytes("file_max_bytes", default.file_max_bytes, 1e6..=largest);
        let buffer_bytes = bytes("buffer_bytes", default.buffer_bytes as u64, 1e6..=1e9) as usize;
        let pretrigger_bytes = bytes("pretrigger_bytes", default.pretrigger_bytes as u64, 0.0..=1e9) as usize;
        let keep_free_bytes = bytes("keep_free_bytes", default.keep_free_bytes, 0.0..=1e15);
        let keep_runs_bytes = bytes("keep_runs_bytes", default.keep_runs_bytes, 1e6..=1e15);
        let log = Self {
            inputs: table.boolean("inputs", default.inputs),
            inputs_max_bytes,
            folder: table.has("folder").then(|| table.text("folder", None).into()),
            start: table.boolean("start", default.start),
            compression: table.choice("compression", Some(default.compression), COMPRESSIONS),
            file_max_bytes,
            buffer_bytes,
            pretrigger_s: table.number("pretrigger_s", Some(default.pretrigger_s), 0.0..=600.0),
            pretrigger_bytes,
            keep_free_bytes,
            keep_runs_bytes,
        };
        table.end();
        log
    }
}
