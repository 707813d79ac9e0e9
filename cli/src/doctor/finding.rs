//! Result of a check.

use base::listed;
use serde::Serialize;

listed! {
    /// Severity of a finding.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
    #[serde(rename_all = "UPPERCASE")]
    pub enum Level {
        /// Nothing to do.
        Ok => "OK",
        /// The robot works, but not as well as it could, or not for everybody.
        Warning => "WARNING",
        /// The robot does not work.
        Fail => "FAIL",
    }
}

/// Result of one check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Name of the check, in a word or two.
    pub check: String,
    pub level: Level,
    /// Finding, in one line.
    pub what: String,
    /// Why that matters; empty where all is well.
    pub why: String,
    /// Command that helps, ready to be copied; empty if all is well or no command would help.
    pub cure: String,
}

impl Finding {
    pub fn ok(check: impl Into<String>, what: impl Into<String>) -> Self {
        Self::new(Level::Ok, check, what)
    }

    pub fn warning(check: impl Into<String>, what: impl Into<String>) -> Self {
        Self::new(Level::Warning, check, what)
    }

    pub fn fail(check: impl Into<String>, what: impl Into<String>) -> Self {
        Self::new(Level::Fail, check, what)
    }

    fn new(level: Level, check: impl Into<String>, what: impl Into<String>) -> Self {
        Self { check: check.into(), level, what: what.into(), why: String::new(), cure: String::new() }
    }

    pub fn why(self, why: impl Into<String>) -> Self {
        Self { why: why.into(), ..self }
    }

    pub fn cure(self, cure: impl Into<String>) -> Self {
        Self { cure: cure.into(), ..self }
    }
}

/// Bytes as people read them.
pub fn bytes(count: u64) -> String {
    const UNITS: [(u64, &str); 3] = [(1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")];
    let Some((unit, name)) = UNITS.into_iter().find(|(unit, _)| count >= *unit) else {
        return format!("{count} B");
    };
    let tenths = count * 10 / unit;
    match tenths % 10 {
        0 => format!("{} {name}", tenths / 10),
        rest => format!("{}.{rest} {name}", tenths / 10),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_short() {
        let texts = [0, 1023, 1024, 212_992, 2 << 20, 10_485_760, 3 << 30].map(bytes);
        assert_eq!(texts, ["0 B", "1023 B", "1 KiB", "208 KiB", "2 MiB", "10 MiB", "3 GiB"]);
        assert_eq!(bytes(1_600_000), "1.5 MiB");
    }
}
