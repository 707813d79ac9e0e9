//! The folder in `/dev/shm` where the contexts of one bus find each other.
//!
//! | file | is |
//! |---|---|
//! | `board` | the [`Board`](super::station::Board) |
//! | `lock` | locked by those of the folder's owner while they join: the folder stays |
//! | `NAME.station` | a [`Station`](super::station::Station); its owner holds a lock on it, which the kernel releases when the owner dies, however it dies and whoever gets its process id |
//! | `NAME.new` | a station that is being made |
//! | `NAME.bell` | a FIFO; a byte in it wakes the owner |
//! | `NAME.N` | the payload of message number N, too large for the ring |
//!
//! The folder belongs to one user, and is closed to all others (mode 0700), unless that user shares it with its group
//! (mode 1770). In a shared folder nobody writes to, or removes, a file of another user, except for the board and for
//! bytes in a bell: the owner of a station's file is its publisher. The folder's owner removes what other users left.

use super::station::LAYOUT;
use crate::url::{Interface, Shm, Udpm};
use nix::fcntl::{Flock, FlockArg, OFlag};
use nix::sys::stat::Mode;
use nix::unistd::{geteuid, mkfifo};
use std::fs::{self, DirBuilder, File, OpenOptions, Permissions};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// Modes of a folder that is shared with its group, the effective one of all who join: only the owner of a file, and
/// the folder's, remove it (sticky).
const SHARED: u32 = 0o1770;
/// Modes of the files that the group of a shared folder reads, writes, and rings.
const READ: u32 = 0o640;
const WRITTEN: u32 = 0o660;
const RUNG: u32 = 0o620;

/// A folder of one user.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// Its owner, and the user of this process.
    owner: u32,
    user: u32,
}

/// The file of a station.
#[derive(Debug)]
pub struct StationFile {
    /// Open for reading; for writing only if it is this user's.
    pub file: File,
    /// Its owner.
    pub uid: u32,
    /// True if it is this user's.
    pub ours: bool,
}

impl Folder {
    /// The folder of a bus: of a user, network name space, group, port and interface.
    ///
    /// # Errors
    /// Not found: it is another user's, and only that user creates it. Permission denied: somebody else created it, or
    /// may write there.
    pub fn open(root: &Path, url: &Udpm) -> io::Result<Self> {
        let user = geteuid().as_raw();
        let owner = if let Shm::Of(owner) = url.shm { owner } else { user };
        // Of this thread: threads may have name spaces of their own.
        let network = fs::metadata("/proc/thread-self/ns/net")?.ino();
        let interface = match &url.interface {
            None => String::new(),
            Some(Interface::Name(name)) => format!("-{name}"),
            Some(Interface::Address(address)) => format!("-{address}"),
        };
        let path = root.join(format!("lcm{LAYOUT}-{owner}-{network}-{}-{}{interface}", url.group, url.port));
        if owner == user {
            match DirBuilder::new().mode(0o700).create(&path) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
                _ => {}
            }
        }
        let found = fs::symlink_metadata(&path)?;
        let closed = |mode: u32| mode & 0o077 == 0 || mode & 0o7777 == SHARED;
        if !found.is_dir() || found.uid() != owner || !closed(found.mode()) {
            let text = format!("{} is not a folder of user {owner}, alone or with its group", path.display());
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, text));
        }
        if url.shm == Shm::Of(user) && found.mode() & 0o7777 != SHARED {
            // Its group is that of the process that created it: a sandbox may refuse to change it.
            fs::set_permissions(&path, Permissions::from_mode(SHARED))?;
        }
        Ok(Self { path, owner, user })
    }

    fn path(&self, name: &str, kind: &str) -> PathBuf {
        self.path.join(format!("{name}.{kind}"))
    }

    /// Also for files that another user may have created: never a symbolic link, and no wait for the other end of a
    /// FIFO.
    fn options(write: bool) -> OpenOptions {
        let mut options = OpenOptions::new();
        let flags = (OFlag::O_NOFOLLOW | OFlag::O_NONBLOCK).bits();
        options.read(true).write(write).mode(0o600).custom_flags(flags);
        options
    }

    /// True if this user made the folder.
    pub fn is_ours(&self) -> bool {
        self.owner == self.user
    }

    /// File of the board, created if absent, and a lock: the folder is not removed until that is dropped. Users other
    /// than the folder's owner have no lock, and look again by [`Folder::has_board`] once they have joined.
    ///
    /// # Errors
    /// Not found: the folder has just been removed. Permission denied: another user than the folder's made the board
    /// or the lock.
    pub fn board(&self) -> io::Result<(File, Option<Flock<File>>)> {
        let (path, ours) = (self.path.join("board"), self.is_ours());
        let lock = match ours {
            true => {
                let file = Self::options(true).create(true).open(self.path.join("lock"))?;
                // Another user's could stay locked.
                if file.metadata()?.uid() != self.user {
                    return Err(io::ErrorKind::PermissionDenied.into());
                }
                let lock = Flock::lock(file, FlockArg::LockShared).map_err(|(_, errno)| io::Error::from(errno))?;
                if !self.is(&lock, "lock")? {
                    return Err(io::ErrorKind::NotFound.into());
                }
                Some(lock)
            }
            false => None,
        };
        let file = Self::options(true).create(ours).open(path)?;
        let found = file.metadata()?;
        if !found.is_file() || found.uid() != self.owner {
            return Err(io::ErrorKind::PermissionDenied.into());
        }
        if ours {
            file.set_permissions(Permissions::from_mode(WRITTEN))?;
        }
        Ok((file, lock))
    }

    /// True if this is still the board.
    pub fn has_board(&self, file: &File) -> bool {
        self.is(file, "board").unwrap_or(false)
    }

    fn is(&self, file: &File, name: &str) -> io::Result<bool> {
        Ok(fs::symlink_metadata(self.path.join(name))?.ino() == file.metadata()?.ino())
    }

    /// Removes the folder if it is empty and no process is about to join.
    pub fn close(&self) {
        if !self.is_ours() {
            return;
        }
        let Some(held) = Self::options(true).open(self.path.join("lock")).ok().and_then(lock) else { return };
        if self.is(&held, "lock").unwrap_or(false) && self.is_empty() {
            for name in ["board", "lock"] {
                let _ = fs::remove_file(self.path.join(name));
            }
            let _ = fs::remove_dir(&self.path);
        }
    }

    fn is_empty(&self) -> bool {
        fs::read_dir(&self.path).is_ok_and(|mut entries| {
            entries.all(|entry| entry.is_ok_and(|entry| entry.file_name() == "board" || entry.file_name() == "lock"))
        })
    }

    /// File of a new station, locked, and invisible until [`Folder::show`].
    pub fn create(&self, name: &str) -> io::Result<Flock<File>> {
        let file = Self::options(true).create_new(true).open(self.path(name, "new"))?;
        let lock = Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, errno)| io::Error::from(errno))?;
        // Only now: another user who can read it could have locked it earlier.
        lock.set_permissions(Permissions::from_mode(READ))?;
        Ok(lock)
    }

    /// Makes the bell of a station, which its owner holds by both ends.
    pub fn create_bell(&self, name: &str) -> io::Result<OwnedFd> {
        let path = self.path(name, "bell");
        mkfifo(&path, Mode::from_bits_truncate(0o600))?;
        let bell = self.bell(name, true)?;
        fs::set_permissions(path, Permissions::from_mode(RUNG))?;
        Ok(bell)
    }

    /// The bell of a station. One of this user is also opened for reading: writing to that of a dead reader then
    /// succeeds, without SIGPIPE, which Rust programs ignore. The bell of another user is not read here.
    pub fn bell(&self, name: &str, ours: bool) -> io::Result<OwnedFd> {
        let flags = (OFlag::O_NONBLOCK | OFlag::O_NOFOLLOW).bits();
        let path = self.path(name, "bell");
        Ok(OpenOptions::new().read(ours).write(true).custom_flags(flags).open(path)?.into())
    }

    /// From now on the station is there for all.
    pub fn show(&self, name: &str) -> io::Result<()> {
        fs::rename(self.path(name, "new"), self.path(name, "station"))
    }

    /// The file of a station.
    pub fn station(&self, name: &str) -> io::Result<StationFile> {
        let path = self.path(name, "station");
        let ours = fs::symlink_metadata(&path)?.uid() == self.user;
        let file = Self::options(ours).open(path)?;
        let found = file.metadata()?;
        // Not what was there a moment ago.
        if !found.is_file() || (found.uid() == self.user) != ours {
            return Err(io::ErrorKind::InvalidData.into());
        }
        Ok(StationFile { file, uid: found.uid(), ours })
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
        for entry in fs::read_dir(&self.path)? {
            let entry = entry?.file_name();
            let name = entry.to_str().and_then(|entry| entry.split_once('.')).filter(|(_, found)| *found == kind);
            names.extend(name.map(|(name, _)| name.to_string()));
        }
        Ok(names)
    }

    /// If the owner of a station is dead: its lock, held against others who find the same until it is dropped, and
    /// whether it is this user's.
    pub fn dead(&self, name: &str) -> Option<(Flock<File>, bool)> {
        let StationFile { file, ours, .. } = self.station(name).ok()?;
        Some((lock(file)?, ours))
    }

    /// Takes away what contexts left that died while they joined.
    pub fn clean(&self) -> io::Result<()> {
        for name in self.names("new")? {
            if let Some(_lock) = Self::options(false).open(self.path(&name, "new")).ok().and_then(lock) {
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
        for entry in fs::read_dir(&self.path).into_iter().flatten().flatten() {
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
        let written = Self::options(true).create_new(true).open(&path).and_then(|mut file| {
            file.set_permissions(Permissions::from_mode(READ))?;
            io::Write::write_all(&mut file, payload)
        });
        written.inspect_err(|_| self.drop_aside(name, sequence))
    }

    /// Takes such a file away.
    pub fn drop_aside(&self, name: &str, sequence: u32) {
        let _ = fs::remove_file(self.path(name, &sequence.to_string()));
    }

    /// Reads such a file of a publisher of the user `uid`; an error if it is gone, of another length, or of another
    /// user.
    pub fn fetch_aside(
        &self,
        name: &str,
        uid: u32,
        sequence: u32,
        payload: &mut Vec<u8>,
        len: usize,
    ) -> io::Result<()> {
        let mut file = Self::options(false).open(self.path(name, &sequence.to_string()))?;
        let found = file.metadata()?;
        if !found.is_file() || found.uid() != uid || found.len() != len as u64 {
            return Err(io::ErrorKind::InvalidData.into());
        }
        if let Some(more) = len.checked_sub(payload.len()) {
            payload.try_reserve_exact(more).map_err(|_| io::ErrorKind::OutOfMemory)?;
            payload.resize(len, 0);
        }
        io::Read::read_exact(&mut file, &mut payload[..len])
    }
}

fn lock(file: File) -> Option<Flock<File>> {
    Flock::lock(file, FlockArg::LockExclusiveNonblock).ok()
}
