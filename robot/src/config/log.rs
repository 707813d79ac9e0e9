//! `[log]`: what a run writes down, and where.

use super::reader::Table;
use std::path::PathBuf;

/// `[log]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Log {
    /// Whether each module's host writes down what the module is told and answers (`docs/replay.md`); default false.
    pub inputs: bool,
    /// One such file is not longer than this, 1e6..=1e12 bytes; default 256e6.
    pub inputs_max_bytes: u64,
    /// Where each run gets a folder, from the configuration folder on; none: `log` in a checkout, else `/opt/advee/log`.
    pub folder: Option<PathBuf>,
}

impl Default for Log {
    fn default() -> Self {
        Self { inputs: false, inputs_max_bytes: 256_000_000, folder: None }
    }
}

impl Log {
    pub(super) fn read(mut table: Table<'_>) -> Self {
        let default = Self::default();
        let log = Self {
            inputs: table.boolean("inputs", default.inputs),
            inputs_max_bytes: table.number("inputs_max_bytes", Some(default.inputs_max_bytes as f64), 1e6..=1e12)
                as u64,
            folder: table.has("folder").then(|| table.text("folder", None).into()),
        };
        table.end();
        log
    }
}
