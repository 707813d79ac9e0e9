//! What a logger is to do.

use base::Duration;
use settings::{Bytes, Section, settings};

settings! {
    /// How chunks are compressed.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Compression {
        /// Not at all.
        None = "none",
        /// LZ4.
        Lz4 = "lz4",
        /// Zstandard, its level 1: a fifth smaller, and hardly slower here (`docs/logs.md`).
        #[default]
        Zstd = "zstd",
    }
}

/// Something that each file carries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// `robot.toml`
    pub name: String,
    /// `text/plain`
    pub media_type: String,
    /// Its content.
    pub data: Vec<u8>,
}

/// Bytes of a file of messages; where a place in a file has 32 bits, a file that is closed late stays below 2 GiB.
const FILE_MAX: f64 = if cfg!(target_pointer_width = "32") { 2e9 } else { 1e12 };

settings! {
    /// Keys of `[log]` for the logger.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct Config {
        /// The port of the folder of logs.
        bus: String = unset "log";
        /// The robot's name.
        robot: String = unset "";
        /// The program's version.
        version: String = unset "";
        /// Attachments of each file beside the definitions of the messages.
        attachments: Vec<Attachment> = unset [];
        /// The folder that this run has already, for other records of it; the first run is written there.
        run: Option<String> = unset None;
        /// It records from the start, else when `CM_CMD_LOG` commands it.
        start: bool = true;
        /// Compression of chunks.
        compression: Compression = Compression::Zstd;
        /// A file that is longer is followed by the next.
        file_max_bytes: u64 = 256_000_000, Bytes(1e6..=FILE_MAX);
        /// Buffer for a slow disk; beyond it messages are dropped, counted and reported. One message more than that
        /// fits in any case.
        buffer_bytes: usize = 32_000_000, Bytes(1e6..=1e9);
        /// While nothing is recorded, messages of this time are kept for a recording that begins.
        pretrigger_s as pretrigger: Duration = 10.0, 0.0..=600.0;
        /// Maximum size of these messages.
        pretrigger_bytes: usize = 16_000_000, Bytes(0.0..=1e9);
        /// Space that stays free on the disk: the oldest runs are removed, then recording stops.
        keep_free_bytes: u64 = 200_000_000, Bytes(0.0..=1e15);
        /// Maximum size of all runs together: older ones are removed when another file is begun.
        keep_runs_bytes: u64 = 8_000_000_000, Bytes(1e6..=1e15);
    }
}

impl Default for Config {
    fn default() -> Self {
        Self::usual()
    }
}
