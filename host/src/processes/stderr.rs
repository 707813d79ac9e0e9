//! Standard error of foreign modules: lines that the watchdog prints and publishes on `CM_EVENT_TEXT`.
//!
//! A module outlives its watchdog. A pipe would break with the watchdog, or fill up while there is none; so each module
//! writes to a file in the run folder, which is read while it grows and truncated when it gets long. A new watchdog
//! reads on from its end.

use base::Level;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// Folder in the run folder; one file per module.
const FOLDER: &str = "stderr";
/// Maximum number of bytes read at a time.
const TURN: usize = 64 << 10;
/// Maximum number of unread bytes; more are skipped, which is reported as a line.
const BEHIND_MAX: u64 = 1 << 20;
/// The file is truncated once this many bytes are read.
const EMPTIED: u64 = 1 << 20;
/// Longer lines are split, bytes.
const LINE_MAX: usize = 4096;

/// The standard error of one process.
#[derive(Debug)]
pub struct Stderr {
    file: File,
    /// Number of bytes read.
    read: u64,
    /// Start of a line whose end has not been read yet.
    begun: Vec<u8>,
}

fn path(run_dir: &Path, module: &str) -> PathBuf {
    run_dir.join(FOLDER).join(module)
}

/// Removes the files of all modules.
pub fn clean(run_dir: &Path) {
    let _ = fs::remove_dir_all(run_dir.join(FOLDER));
}

impl Stderr {
    /// Creates the file of a module; returns it and the end that the process writes to.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(run_dir: &Path, module: &str) -> io::Result<(Self, Stdio)> {
        fs::create_dir_all(run_dir.join(FOLDER))?;
        let path = path(run_dir, module);
        // A new file: an earlier process may still write to the old one.
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let written = OpenOptions::new().append(true).create_new(true).open(&path)?;
        let file = OpenOptions::new().read(true).write(true).open(&path)?;
        Ok((Self { file, read: 0, begun: Vec::new() }, written.into()))
    }

    /// Opens the file of a process that an earlier watchdog started, to read what is written from now on.
    ///
    /// # Errors
    /// The file does not exist.
    pub fn open(run_dir: &Path, module: &str) -> io::Result<Self> {
        let mut file = OpenOptions::new().read(true).write(true).open(path(run_dir, module))?;
        let read = file.seek(SeekFrom::End(0))?;
        Ok(Self { file, read, begun: Vec::new() })
    }

    /// Passes the lines written since the previous call to `take`, each with its level: that of its prefix (`<4>`, see
    /// sd-daemon(3)), else INFO. An unfinished line is passed only if `last`.
    pub fn read(&mut self, last: bool, mut take: impl FnMut(Level, String)) {
        if let Ok(skipped) = self.fill()
            && skipped > 0
        {
            take(Level::Warning, format!("{skipped} bytes of its standard error skipped, because it writes too fast"));
        }
        let mut rest = self.begun.as_slice();
        loop {
            let end = match rest.iter().take(LINE_MAX + 1).position(|byte| *byte == b'\n') {
                Some(end) => end,
                None if rest.len() > LINE_MAX => LINE_MAX,
                None => break,
            };
            let (line, after) = rest.split_at(end);
            rest = after.strip_prefix(b"\n").unwrap_or(after);
            line_of(line, &mut take);
        }
        if last {
            line_of(rest, &mut take);
            rest = &[];
        }
        self.begun = rest.to_vec();
    }

    /// Appends new bytes to `begun`; returns the number of skipped bytes.
    fn fill(&mut self) -> io::Result<u64> {
        let end = self.file.metadata()?.len();
        // The process itself may truncate the file.
        self.read = self.read.min(end);
        // Nearly always: one system call.
        if self.read == end && self.read < EMPTIED {
            return Ok(0);
        }
        let mut skipped = 0;
        if end - self.read > BEHIND_MAX {
            skipped = end - self.read - TURN as u64;
            self.read += skipped;
            self.begun.clear();
        }
        self.file.seek(SeekFrom::Start(self.read))?;
        let taken = (&mut self.file).take(TURN as u64).read_to_end(&mut self.begun)? as u64;
        self.read += taken;
        // Bytes written between the check and the truncation are lost, so truncation is rare.
        if self.read >= EMPTIED && self.read == self.file.metadata()?.len() {
            self.file.set_len(0)?;
            self.read = 0;
        }
        Ok(skipped)
    }
}

fn line_of(bytes: &[u8], take: &mut impl FnMut(Level, String)) {
    let (level, bytes) = match bytes {
        [b'<', b'0'..=b'3', b'>', rest @ ..] => (Level::Error, rest),
        [b'<', b'4', b'>', rest @ ..] => (Level::Warning, rest),
        [b'<', b'5' | b'6', b'>', rest @ ..] => (Level::Info, rest),
        [b'<', b'7', b'>', rest @ ..] => (Level::Debug, rest),
        other => (Level::Info, other),
    };
    let text = String::from_utf8_lossy(bytes);
    let text = text.trim_end();
    if !text.is_empty() {
        take(level, text.into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let folder = std::env::temp_dir().join(format!("advee-stderr-{name}-{}", std::process::id()));
            fs::create_dir_all(&folder).unwrap();
            Self(folder)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn say(stdio: Stdio, script: &str) {
        assert!(Command::new("/bin/sh").args(["-c", script]).stderr(stdio).status().unwrap().success());
    }

    fn lines(stderr: &mut Stderr, last: bool) -> Vec<(Level, String)> {
        let mut lines = Vec::new();
        stderr.read(last, |level, text| lines.push((level, text)));
        lines
    }

    #[test]
    fn lines_come_with_the_level_that_they_name() {
        let folder = Folder::new("levels");
        let (mut stderr, written) = Stderr::create(&folder.0, "eye").unwrap();
        say(written, "printf 'one\\r\\n\\n<3>two\\n<7>three\\n<9>four\\nhal' >&2");
        let text = |level, text: &str| (level, text.to_owned());
        let expected = [text(Level::Info, "one"), text(Level::Error, "two"), text(Level::Debug, "three")];
        assert_eq!(lines(&mut stderr, false), [&expected[..], &[text(Level::Info, "<9>four")]].concat());
        assert_eq!(lines(&mut stderr, false), []);
        // Another watchdog continues at the end; the last line may lack its line feed.
        let mut stderr = Stderr::open(&folder.0, "eye").unwrap();
        fs::write(path(&folder.0, "eye"), "from here on it is another text, longer than the one before").unwrap();
        assert_eq!(lines(&mut stderr, false), []);
        assert_eq!(lines(&mut stderr, true).len(), 1);
        clean(&folder.0);
        assert!(Stderr::open(&folder.0, "eye").is_err());
    }

    #[test]
    fn a_flood_of_output_is_skipped_and_does_not_fill_the_disk() {
        let folder = Folder::new("flood");
        let (mut stderr, written) = Stderr::create(&folder.0, "eye").unwrap();
        say(written, "head -c 3000000 /dev/zero | tr '\\0' 'x' >&2; echo >&2; echo end >&2");
        let mut all = Vec::new();
        for _ in 0..10 {
            all.extend(lines(&mut stderr, false));
        }
        let skipped = 3_000_005 - TURN;
        assert!(all[0].1.starts_with(&format!("{skipped} bytes ")), "{}", all[0].1);
        assert!(all.iter().all(|(_, text)| text.len() <= LINE_MAX) && all.last().unwrap().1 == "end");
        assert_eq!(fs::metadata(path(&folder.0, "eye")).unwrap().len(), 0);
    }
}
