//! Adds the missing index to logs of earlier runs that ended by a power failure or a crash of the logger.
//!
//! One thread at the lowest priority, limited to `RATE`, so that it yields to everything else on the machine. A file
//! that a logger is writing is recognized by its lock (`host/src/ports/store`) and skipped, whatever run it belongs to.
//! A file that cannot be repaired stays unchanged and is tried again at the next start.

use crate::log::Log;
use logger::recover::{self, Sealed};
use nix::dir::{Dir, Type};
use nix::fcntl::{Flock, FlockArg, OFlag, openat};
use nix::sys::signal::{SigSet, SigmaskHow};
use nix::sys::stat::Mode;
use nix::unistd::{UnlinkatFlags, unlinkat};
use std::ffi::CString;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

/// Maximum rate, bytes per second read and written.
const RATE: u64 = 32_000_000;
/// Number of bytes between two pauses.
const PAUSE_BYTES: u64 = 1 << 18;
/// Final bytes of a complete file.
const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Maximum number of folder entries that are examined.
const ENTRIES_MAX: usize = 100_000;

/// Starts to repair the files in a folder of runs; continues until all are done or the process ends. Each incomplete
/// file gets a line in the log.
pub fn start(folder: PathBuf, log: Log) {
    // Signals are for the thread with the loop, which may not have blocked them yet.
    let (all, mut before) = (SigSet::all(), SigSet::empty());
    if nix::sys::signal::pthread_sigmask(SigmaskHow::SIG_SETMASK, Some(&all), Some(&mut before)).is_err() {
        return;
    }
    let note = log.clone();
    let started = thread::Builder::new().name("repair".into()).spawn(move || {
        // On Linux this applies to the calling thread only.
        let _ = crate::sys::set_nice(19);
        repair(&folder, RATE, |line| log.line(line));
    });
    let _ = before.thread_set_mask();
    if let Err(error) = started {
        note.line(format_args!("logs of earlier runs are not repaired: {error}"));
    }
}

/// Repairs the files in a folder of runs; reports each incomplete file in a line.
fn repair(folder: &Path, rate: u64, mut report: impl FnMut(String)) {
    // The folder need not exist yet.
    let Ok(root) = File::open(folder).map(OwnedFd::from) else { return };
    for run in names(&root, Type::Directory) {
        let flags = OFlag::O_RDONLY | OFlag::O_DIRECTORY | OFlag::O_NOFOLLOW | OFlag::O_CLOEXEC;
        let Ok(run_folder) = openat(&root, run.as_c_str(), flags, Mode::empty()) else { continue };
        for name in names(&run_folder, Type::File).into_iter().filter(|name| name.to_bytes().ends_with(b".mcap")) {
            let note = repair_file(&run_folder, &name, rate);
            let name = || format!("{}/{}", run.to_string_lossy(), name.to_string_lossy()).escape_debug().to_string();
            match note {
                Ok(None) => {}
                Ok(Some(note)) => report(format!("{}: {note}", name())),
                Err(error) => report(format!("{}: it has no index, and adding one failed: {error}", name())),
            }
        }
    }
}

/// Names of a folder's entries of one type, sorted.
fn names(folder: &OwnedFd, kind: Type) -> Vec<CString> {
    let flags = OFlag::O_RDONLY | OFlag::O_DIRECTORY | OFlag::O_CLOEXEC;
    let Ok(mut listed) = Dir::openat(folder, ".", flags, Mode::empty()) else { return Vec::new() };
    let entries = listed.iter().flatten().take(ENTRIES_MAX);
    // File systems without entry types: the type is checked when the entry is opened.
    let fits = entries.filter(|entry| entry.file_type().is_none_or(|is| is == kind));
    let mut names: Vec<CString> = fits.map(|entry| entry.file_name().into()).collect();
    names.retain(|name| !name.to_bytes().starts_with(b"."));
    names.sort_unstable();
    names
}

/// Repairs a file; returns the outcome if it was incomplete.
fn repair_file(folder: &OwnedFd, name: &CString, rate: u64) -> io::Result<Option<String>> {
    // A pipe of that name must not block.
    let flags = OFlag::O_NOFOLLOW | OFlag::O_CLOEXEC | OFlag::O_NONBLOCK;
    let mut reading = File::from(openat(folder, name.as_c_str(), flags | OFlag::O_RDONLY, Mode::empty())?);
    if !reading.metadata()?.is_file() || is_whole(&mut reading)? {
        return Ok(None);
    }
    drop(reading);
    let file = File::from(openat(folder, name.as_c_str(), flags | OFlag::O_RDWR, Mode::empty())?);
    let Ok(file) = Flock::lock(file, FlockArg::LockExclusiveNonblock) else { return Ok(None) };
    let size = file.metadata()?.len();
    if size == 0 {
        // Created, but the power failed before its first bytes were on disk.
        unlinkat(folder, name.as_c_str(), UnlinkatFlags::NoRemoveDir)?;
        return Ok(Some("removed, because it was empty".into()));
    }
    match recover::seal(RateLimited { file: &file, rate, spent: 0 }, &mut |_, _| ()) {
        Ok(Sealed::Whole) => Ok(None),
        Ok(Sealed::Sealed(report)) => {
            file.set_len(report.written)?;
            file.sync_all()?;
            Ok(Some(format!("index added: {} messages", report.messages)))
        }
        Ok(Sealed::Damaged(_)) => Ok(Some("damaged inside: use advee log recover".into())),
        Err(error) => {
            // Truncated to its former size: the disk may be full.
            file.set_len(size)?;
            Err(error)
        }
    }
}

/// True if a file ends as complete ones do.
fn is_whole(file: &mut File) -> io::Result<bool> {
    let mut end = [0; MAGIC.len()];
    if file.seek(SeekFrom::End(0))? <= 2 * end.len() as u64 {
        return Ok(false);
    }
    file.seek(SeekFrom::End(-(end.len() as i64)))?;
    file.read_exact(&mut end)?;
    Ok(end == *MAGIC)
}

/// A file that is read and written at a limited rate.
struct RateLimited<'a> {
    file: &'a File,
    rate: u64,
    spent: u64,
}

impl RateLimited<'_> {
    fn spend(&mut self, bytes: io::Result<usize>) -> io::Result<usize> {
        self.spent += *bytes.as_ref().unwrap_or(&0) as u64;
        if self.spent >= PAUSE_BYTES {
            thread::sleep(Duration::from_nanos(self.spent * 1_000_000_000 / self.rate));
            self.spent = 0;
        }
        bytes
    }
}

impl Read for RateLimited<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(buffer);
        self.spend(read)
    }
}

impl Write for RateLimited<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes);
        self.spend(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for RateLimited<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

#[cfg(test)]
mod tests;
