//! The run folder: all files that a running robot writes; held by one `advee up` at a time.

use nix::fcntl::{Flock, FlockArg};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Exclusive lock of the run folder until it is released; the kernel releases that of a killed process.
pub struct RunFolder {
    path: PathBuf,
    lock: Flock<File>,
}

impl RunFolder {
    /// Creates the folder if necessary and locks it. The error, in one line, names the holder or the failed call.
    pub fn take(path: &Path) -> Result<Self, String> {
        let named = |error: io::Error| format!("run folder {}: {error}", path.display());
        loop {
            fs::create_dir_all(path).map_err(named)?;
            let name = path.join("lock");
            let mut options = OpenOptions::new();
            let mut file = match options.read(true).write(true).create(true).truncate(false).open(&name) {
                Ok(file) => file,
                // Another process just removed it.
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                Err(error) => return Err(named(error)),
            };
            let mut holder = String::new();
            // The content is for people.
            let _ = (&mut file).take(32).read_to_string(&mut holder);
            let mut lock = Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, errno)| match errno {
                nix::errno::Errno::EWOULDBLOCK => held(path, holder.trim()),
                other => named(other.into()),
            })?;
            // A lock on a file that has been removed meanwhile protects nothing.
            let locked = lock.metadata().map_err(named)?;
            if fs::metadata(&name).is_ok_and(|there| (there.dev(), there.ino()) == (locked.dev(), locked.ino())) {
                lock.set_len(0).map_err(named)?;
                writeln!(lock, "{}", std::process::id()).map_err(named)?;
                return Ok(Self { path: path.into(), lock });
            }
        }
    }

    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes the lock file, and the folder if it is empty.
    pub fn release(self) {
        let _ = fs::remove_file(self.path.join("lock"));
        drop(self.lock);
        let _ = fs::remove_dir(&self.path);
    }
}

/// Refusal of a folder that another process holds, which wrote its number into the lock file.
fn held(path: &Path, holder: &str) -> String {
    let pid = holder.parse::<u32>().ok().filter(|pid| *pid > 0);
    let (who, kill) = pid.map_or_else(Default::default, |pid| (format!(", process {pid}"), format!("kill {pid}, ")));
    let path = path.display();
    format!(
        "run folder {path} is held by another advee up{who}: end that robot first, by Ctrl-C in its terminal, {kill}or \
         systemctl stop advee for the service"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fresh(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("advee-{name}-{}", std::process::id()))
    }

    #[test]
    fn a_folder_is_locked_once_and_removed_at_the_end() {
        let path = fresh("held");
        let first = RunFolder::take(&path).unwrap();
        let Err(refusal) = RunFolder::take(&path) else { panic!("taken twice") };
        let pid = std::process::id();
        let expected = format!(
            "run folder {} is held by another advee up, process {pid}: end that robot first, by Ctrl-C in its \
             terminal, kill {pid}, or systemctl stop advee for the service",
            path.display()
        );
        assert_eq!(refusal, expected);
        // The holder has not written its number yet, or another program changed it.
        for holder in ["", "1 && rm", "-1", "0"] {
            let text = held(&path, holder);
            assert!(text.contains("is held by another advee up: end") && !text.contains("kill"), "{text}");
        }
        first.release();
        assert!(!path.exists());
        RunFolder::take(&path).unwrap().release();
        assert!(!path.exists());
    }

    #[test]
    fn foreign_files_in_the_folder_are_kept() {
        let path = fresh("shared");
        let folder = RunFolder::take(&path).unwrap();
        fs::write(path.join("other"), "").unwrap();
        folder.release();
        assert!(path.join("other").exists() && !path.join("lock").exists());
        fs::remove_dir_all(&path).unwrap();
    }

    #[test]
    fn a_folder_that_cannot_be_created_is_reported_in_one_line() {
        let Err(why) = RunFolder::take(Path::new("/proc/nothing/run")) else { panic!() };
        assert!(why.starts_with("run folder /proc/nothing/run: ") && !why.contains('\n'), "{why}");
    }
}
