//! What a logger is to do.

use base::Duration;

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// LZ4.
    Lz4,
    /// Zstandard, its level 1: a fifth smaller, and hardly slower here (`docs/logs.md`).
    #[default]
    Zstd,
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

/// Configuration of the module.
#[derive(Clone, Debug)]
pub struct Config {
    /// The port of the folder of logs.
    pub bus: String,
    /// The robot's name.
    pub robot: String,
    /// The program's version.
    pub version: String,
    /// What each file carries beside the definitions of the messages.
    pub attachments: Vec<Attachment>,
    /// The folder that this run has already, for other records of it; the first run is written there.
    pub run: Option<String>,
    /// Whether it records from the start, or when it is told to.
    pub start: bool,
    /// How chunks are compressed.
    pub compression: Compression,
    /// A file that is longer is followed by the next.
    pub file_max_bytes: u64,
    /// What waits for the disk; beyond it messages are dropped. One message more than that fits in any case.
    pub buffer_bytes: usize,
    /// While nothing is recorded the messages of so long are kept for a recording that begins.
    pub pretrigger: Duration,
    /// And at most so many bytes of them.
    pub pretrigger_bytes: usize,
    /// So much stays free on the disk.
    pub keep_free_bytes: u64,
    /// All runs together take no more than this: older ones are removed when another file is begun.
    pub keep_runs_bytes: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            bus: "log".into(),
            robot: String::new(),
            version: String::new(),
            attachments: Vec::new(),
            run: None,
            start: true,
            compression: Compression::default(),
            file_max_bytes: 256_000_000,
            buffer_bytes: 32_000_000,
            pretrigger: Duration::from_secs(10),
            pretrigger_bytes: 16_000_000,
            keep_free_bytes: 200_000_000,
            keep_runs_bytes: 8_000_000_000,
        }
    }
}
