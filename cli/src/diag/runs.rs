//! The runs in the log folder of this machine.

use base::{Duration, Instant};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Maximum number of runs listed, newest first.
const RUNS_MAX: usize = 500;
/// Files of a run that are counted, and names of the folder that are looked at.
const FILES_MAX: usize = 1000;
const NAMES_MAX: usize = 20_000;
/// Runs that are measured in one look.
const AT_ONCE: usize = 50;
/// The folder is looked at this often.
const LOOKED: Duration = Duration::from_secs(2);

/// A run.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// `YYYY_MM_DD_HH_MM_SS`, UTC.
    pub name: String,
    /// Files with their bytes, in order of their names; none: not looked at yet.
    pub files: Option<Vec<(String, u64)>>,
    /// True if it is being recorded.
    pub recorded: bool,
}

impl Run {
    /// Bytes of all its files.
    pub fn bytes(&self) -> Option<u64> {
        self.files.as_ref().map(|files| files.iter().map(|(_, bytes)| bytes).sum())
    }
}

/// All runs, newest first.
#[derive(Debug)]
pub struct Runs {
    folder: PathBuf,
    looked: Option<Instant>,
    runs: Vec<Run>,
    /// Why they cannot be listed.
    pub why: Option<String>,
}

impl Runs {
    /// Runs in `folder`, not read yet.
    pub fn of(folder: PathBuf) -> Self {
        Self { folder, looked: None, runs: Vec::new(), why: None }
    }

    /// Folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The runs that were found.
    pub fn all(&self) -> &[Run] {
        &self.runs
    }

    /// Looks whether there is something new, if it is time to.
    pub fn look(&mut self, now: Instant, recorded: Option<&str>) {
        if self.looked.is_some_and(|looked| now.since(looked) < LOOKED) {
            return;
        }
        self.looked = Some(now);
        let names = match fs::read_dir(&self.folder) {
            Ok(entries) => entries.take(NAMES_MAX).flatten().filter_map(|entry| entry.file_name().into_string().ok()),
            Err(error) => {
                self.runs.clear();
                self.why = Some(error.to_string());
                return;
            }
        };
        self.why = None;
        let mut names: Vec<String> = names.filter(|name| is_run(name)).collect();
        names.sort_unstable_by(|one, other| other.cmp(one));
        names.truncate(RUNS_MAX);
        let mut left = AT_ONCE;
        let known = std::mem::take(&mut self.runs);
        for (place, name) in names.into_iter().enumerate() {
            let is_recorded = recorded == Some(&*name);
            let known = known.iter().find(|run| run.name == name);
            let mut files = known.and_then(|run| run.files.clone());
            // The latest may still grow.
            let grows = is_recorded || place == 0 || known.is_some_and(|run| run.recorded);
            if left > 0 && (files.is_none() || grows) {
                files = Some(files_of(&self.folder.join(&name)));
                left -= 1;
            }
            self.runs.push(Run { name, files, recorded: is_recorded });
        }
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let run = |run: &Run| json!({ "run": run.name, "bytes": run.bytes(), "recorded": run.recorded });
        json!({ "folder": self.folder, "runs": self.runs.iter().map(run).collect::<Vec<_>>(), "why": self.why })
    }
}

/// `YYYY_MM_DD_HH_MM_SS`, and an optional suffix.
fn is_run(name: &str) -> bool {
    let pattern = |(place, byte): (usize, u8)| match place {
        4 | 7 | 10 | 13 | 16 | 19 => byte == b'_',
        _ => byte.is_ascii_digit(),
    };
    (19..30).contains(&name.len()) && name.bytes().enumerate().all(pattern)
}

fn files_of(run: &Path) -> Vec<(String, u64)> {
    let entries = fs::read_dir(run).into_iter().flatten().flatten().take(FILES_MAX);
    let file = |entry: fs::DirEntry| {
        let metadata = entry.metadata().ok().filter(fs::Metadata::is_file)?;
        Some((entry.file_name().to_string_lossy().into_owned(), metadata.len()))
    };
    let mut files: Vec<_> = entries.filter_map(file).collect();
    files.sort_unstable();
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_listed_the_latest_first_with_what_they_take() {
        let folder = std::env::temp_dir().join(format!("advee-runs-{}", std::process::id()));
        let mut runs = Runs::of(folder.clone());
        runs.look(Instant::from_millis(0), None);
        assert!(runs.why.is_some() && runs.all().is_empty());
        for (run, bytes) in [("2026_01_01_00_00_00", 5), ("2026_01_01_00_00_01", 7), ("photos", 9)] {
            fs::create_dir_all(folder.join(run)).unwrap();
            fs::write(folder.join(run).join("log_000.mcap"), vec![0; bytes]).unwrap();
        }
        runs.look(Instant::from_millis(1000), None);
        assert!(runs.all().is_empty(), "not yet");
        runs.look(Instant::from_millis(2000), Some("2026_01_01_00_00_01"));
        let seen: Vec<_> = runs.all().iter().map(|run| (run.name.as_str(), run.bytes(), run.recorded)).collect();
        assert_eq!(seen, [("2026_01_01_00_00_01", Some(7), true), ("2026_01_01_00_00_00", Some(5), false)]);
        fs::write(folder.join("2026_01_01_00_00_01/log_001.mcap"), [0; 3]).unwrap();
        runs.look(Instant::from_millis(4000), None);
        assert_eq!(runs.all()[0].bytes(), Some(10));
        fs::remove_dir_all(folder).unwrap();
    }
}
