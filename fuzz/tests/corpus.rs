//! Replay of the kept inputs through every target.

#![allow(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test reads its files and fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};

/// Limits of one target's folder, so that the replay and the repository remain small.
const FILES_MAX: usize = 20;
const BYTES_MAX: usize = 40_000;

fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    entries
}

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus")
}

#[test]
fn every_target_has_a_corpus_and_every_corpus_a_target() {
    let folders: Vec<String> =
        entries(&corpus()).iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_string()).collect();
    let mut targets: Vec<&str> = fuzz::TARGETS.iter().map(|(name, _)| *name).collect();
    targets.sort_unstable();
    assert_eq!(folders, targets);
    for folder in entries(&corpus()) {
        let files = entries(&folder);
        let bytes: usize = files.iter().map(|file| fs::read(file).unwrap().len()).sum();
        assert!(!files.is_empty(), "{} is empty", folder.display());
        assert!(
            files.len() <= FILES_MAX && bytes <= BYTES_MAX,
            "{}: {} files, {bytes} B",
            folder.display(),
            files.len()
        );
    }
}

#[test]
fn every_target_passes_with_its_kept_inputs() {
    for (name, target) in fuzz::TARGETS {
        for file in entries(&corpus().join(name)) {
            // Shown if the target panics.
            println!("{}", file.display());
            target(&fs::read(&file).unwrap());
        }
    }
}
