//! The folder in `/dev/shm` where the contexts of one bus find each other.
//!
//! | file | is |
//! |---|---|
//! | `board` | the [`Board`](super::station::Board) |
//! | `NAME.station` | a [`Station`](super::station::Station); its owner holds a lock on it, which the kernel releases when the owner dies, however it dies and whoever gets its process id |
//! | `NAME.new` | a station that is being made |
//! | `NAME.bell` | a FIFO; a byte in it wakes the owner |
//! | `NAME.N` | the payload of message number N, too large for the ring |

use super::station::LAYOUT;
use crate::url::{Interface, Udpm};
use nix::fcntl::{Flock, FlockArg, OFlag};
use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// A folder of mode 0700 that belongs to this user.
#[derive(Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// The folder of a bus: of this user, network name space, group, port and interface.
    pub fn open(root: &Path, url: &Udpm) -> io::Result<Self> {
        let user = nix::unistd::geteuid();
        // Of this thread: threads may have name spaces of their own.
        let network = fs::metadata("/proc/thread-self/ns/net")?.ino();
        let interface = match &url.interface {
            None => String::new(),
            Some(Interface::Name(name)) => format!("-{name}"),
            Some(Interface::Address(address)) => format!("-{address}"),
        };
        let path = root.join(format!("lcm{LAYOUT}-{user}-{network}-{}-{}{interface}", url.group, url.port));
        match DirBuilder::new().mode(0o700).create(&path) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
            _ => {}
        }
        let found = fs::symlink_metadata(&path)?;
        if !found.is_dir() || found.uid() != user.as_raw() || found.mode() & 0o077 != 0 {
            let text = format!("{} is not a folder of this user alone", path.display());
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, text));
        }
        Ok(Self(path))
    }

    fn path(&self, name: &str, kind: &str) -> PathBuf {
        self.0.join(format!("{name}.{kind}"))
    }

    fn options() -> OpenOptions {
        let mut options = OpenOptions::new();
        options.read(true).write(true).mode(0o600).custom_flags(OFlag::O_NOFOLLOW.bits());
        options
    }

    /// File of the board, created if absent. The folder is not removed until the lock is dropped.
    ///
    /// # Errors
    /// Not found: the folder has just been removed.
    pub fn board(&self) -> io::Result<Flock<File>> {
        let file = Self::options().create(true).open(self.0.join("board"))?;
        let lock = Flock::lock(file, FlockArg::LockShared).map_err(|(_, errno)| io::Error::from(errno))?;
        if self.is_board(&lock)? { Ok(lock) } else { Err(io::ErrorKind::NotFound.into()) }
    }

    fn is_board(&self, file: &File) -> io::Result<bool> {
        Ok(fs::symlink_metadata(self.0.join("board"))?.ino() == file.metadata()?.ino())
    }

    /// Removes the folder if it is empty and no process is about to join.
    pub fn close(&self) {
        let Some(board) = Self::options().open(self.0.join("board")).ok().and_then(lock) else { return };
        if self.is_board(&board).unwrap_or(false) && self.is_empty() {
            let _ = fs::remove_file(self.0.join("board"));
            let _ = fs::remove_dir(&self.0);
        }
    }

    fn is_empty(&self) -> bool {
        fs::read_dir(&self.0).is_ok_and(|entries| entries.count() == 1)
    }

    /// File of a new station, locked, and invisible until [`Folder::show`].
    pub fn create(&self, name: &str) -> io::Result<Flock<File>> {
        let file = Self::options().create_new(true).open(self.path(name, "new"))?;
        Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, errno)| errno.into())
    }

    /// Makes the bell of a station, which its owner holds by both ends.
    pub fn create_bell(&self, name: &str) -> io::Result<OwnedFd> {
        mkfifo(&self.path(name, "bell"), Mode::from_bits_truncate(0o600))?;
        self.bell(name)
    }

    /// The bell of a station. Opened for reading too: writing to a dead reader's is then an ordinary thing, no SIGPIPE.
    pub fn bell(&self, name: &str) -> io::Result<OwnedFd> {
        let flags = (OFlag::O_NONBLOCK | OFlag::O_NOFOLLOW).bits();
        Ok(OpenOptions::new().read(true).write(true).custom_flags(flags).open(self.path(name, "bell"))?.into())
    }

    /// From now on the station is there for all.
    pub fn show(&self, name: &str) -> io::Result<()> {
        fs::rename(self.path(name, "new"), self.path(name, "station"))
    }

    /// The file of a station.
    pub fn station(&self, name: &str) -> io::Result<File> {
        Self::options().open(self.path(name, "station"))
    }

    /// True if a station is there.
    pub fn has(&self, name: &str) -> bool {
        self.path(name, "station").exists()
    }

    /// The names of all stations.
    pub fn stations(&self) -> io::Result<Vec<String>> {
        self.names("station")
    }

    fn names(&self, kind: &str) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        for entry in fs::read_dir(&self.0)? {
            let entry = entry?.file_name();
            let name = entry.to_str().and_then(|entry| entry.split_once('.')).filter(|(_, found)| *found == kind);
            names.extend(name.map(|(name, _)| name.to_string()));
        }
        Ok(names)
    }

    /// True if the owner of a station is dead: its lock, held against others who find the same until it is dropped.
    pub fn dead(&self, name: &str) -> Option<Flock<File>> {
        lock(self.station(name).ok()?)
    }

    /// Takes away what contexts left that died while they joined.
    pub fn clean(&self) -> io::Result<()> {
        for name in self.names("new")? {
            if let Some(_lock) = Self::options().open(self.path(&name, "new")).ok().and_then(lock) {
                self.remove_as(&name, "new");
            }
        }
        Ok(())
    }

    /// Takes away all files of a station whose owner is dead or is the caller.
    pub fn remove(&self, name: &str) {
        self.remove_as(name, "station");
    }

    /// The station itself last, so that what a crash leaves in between is found again.
    fn remove_as(&self, name: &str, last: &str) {
        for entry in fs::read_dir(&self.0).into_iter().flatten().flatten() {
            let file = entry.file_name();
            let kind = file.to_str().and_then(|file| file.split_once('.')).filter(|(found, _)| *found == name);
            if kind.is_some_and(|(_, kind)| kind != last) {
                let _ = fs::remove_file(entry.path());
            }
        }
        let _ = fs::remove_file(self.path(name, last));
    }

    /// Writes a payload to a file of its own. What is written never changes.
    pub fn put_aside(&self, name: &str, sequence: u32, payload: &[u8]) -> io::Result<()> {
        let path = self.path(name, &sequence.to_string());
        let written =
            Self::options().create_new(true).open(&path).and_then(|mut file| io::Write::write_all(&mut file, payload));
        written.inspect_err(|_| self.drop_aside(name, sequence))
    }

    /// Takes such a file away.
    pub fn drop_aside(&self, name: &str, sequence: u32) {
        let _ = fs::remove_file(self.path(name, &sequence.to_string()));
    }

    /// Reads such a file; an error if it is gone or of another length.
    pub fn fetch_aside(&self, name: &str, sequence: u32, payload: &mut Vec<u8>, len: usize) -> io::Result<()> {
        let mut file = Self::options().open(self.path(name, &sequence.to_string()))?;
        if file.metadata()?.len() != len as u64 {
            return Err(io::ErrorKind::InvalidData.into());
        }
        if payload.len() < len {
            payload.resize(len, 0);
        }
        io::Read::read_exact(&mut file, &mut payload[..len])
    }
}

fn lock(file: File) -> Option<Flock<File>> {
    Flock::lock(file, FlockArg::LockExclusiveNonblock).ok()
}
