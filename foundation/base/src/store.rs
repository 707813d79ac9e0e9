//! A folder that one writes log files into: the words between the logger, hosts and their disks.
//!
//! Disks are slow at times and full at others. So what is asked is answered later, in order, and what was written is
//! safe from a power cut only when an answer to a request with `sync` has come.

use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::fmt;

/// What is asked of the folder. Names are relative to it, of letters, digits, `_`, `-` and `.`, with at most one `/`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Makes a new file, with its folder, to append to from now on. The one before is synchronized and closed.
    Create {
        /// `2026_11_22_09_24_06/log_000.mcap`
        name: String,
    },
    /// Appends to the file that was made last: all of it, or on failure nothing, as far as the machine can take it
    /// back.
    Append {
        /// What.
        bytes: Arc<Vec<u8>>,
        /// True if this and everything before it is to survive a power cut once the answer has come.
        sync: bool,
    },
    /// Removes a file, or a folder of files with all that is in it.
    Remove {
        /// Which.
        name: String,
    },
    /// What is there.
    List,
}

/// What comes of a [`Request`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// It is done. So many bytes are free for more.
    Done {
        /// Bytes.
        free: u64,
    },
    /// What is there, in order of the names.
    Listed {
        /// Folders and files at the top.
        entries: Vec<Entry>,
        /// Bytes.
        free: u64,
    },
    /// It is not done.
    Failed(Trouble),
}

/// A folder or a file at the top of the folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Name.
    pub name: String,
    /// The bytes in it, those of a folder together.
    pub bytes: u64,
}

/// Why something was not done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// The disk is full.
    Full,
    /// Nothing may be written there.
    ReadOnly,
    /// Something else, in a line.
    Other(String),
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full => f.write_str("the disk is full"),
            Self::ReadOnly => f.write_str("the disk may not be written to"),
            Self::Other(why) => f.write_str(why),
        }
    }
}

/// True if a name is one that a [`Request`] may have.
#[must_use]
pub fn is_name(name: &str) -> bool {
    let part = |part: &str| {
        let plain = part.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"_-.".contains(&byte));
        plain && !part.is_empty() && part.len() <= 64 && !part.starts_with('.')
    };
    name.split('/').count() <= 2 && name.split('/').all(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_leads_nowhere_else() {
        for name in ["run", "2026_11_22_09_24_06/log_000.mcap", "a/b-c.d"] {
            assert!(is_name(name), "{name}");
        }
        for name in ["", "/", "a/", "/etc", "..", "a/..", "../a", "a/b/c", ".hidden", "a b", "a\0", "ä"] {
            assert!(!is_name(name), "{name}");
        }
    }
}
