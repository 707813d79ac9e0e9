//! Requests to a folder of log files, executed with calls that may block.
//!
//! Everything in the folder is reached from its descriptor, name by name, and no symbolic link is followed: files are
//! written and removed only inside the folder, whatever anybody put there. The folder itself may be a link to another
//! disk.

use base::store::{Answer, Entry, Request, Trouble, is_name};
use nix::dir::Dir;
use nix::errno::Errno;
use nix::fcntl::{AtFlags, Flock, FlockArg, OFlag, openat};
use nix::sys::stat::{FileStat, Mode, SFlag, fstatat, mkdirat};
use nix::sys::statvfs::statvfs;
use nix::unistd::{UnlinkatFlags, unlinkat};
use std::collections::BTreeSet;
use std::ffi::CString;
use std::fs::{self, File};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

/// Maximum depth of nested folders.
const DEPTH: u32 = 8;
/// Maximum number of entries listed: those with the first names, which are the oldest runs.
const ENTRIES: usize = 10_000;
/// Maximum number of attempts: a folder may be listed incompletely while entries are being removed.
const REMOVE_TRIES: u32 = 8;
/// Number of attempts to lock a new file; a repair inspects it only briefly.
const LOCK_TRIES: u32 = 50;

/// The folder, and the open file in it.
pub struct Disk {
    folder: PathBuf,
    open: Option<Open>,
}

struct Open {
    name: String,
    file: File,
    /// Length of its completely written records, bytes.
    length: u64,
    /// Shows a repair that this file is being written.
    _lock: Option<Flock<File>>,
}

impl Disk {
    /// Creates the state of a folder, which is created with the first file.
    pub fn new(folder: &Path) -> Self {
        Self { folder: std::path::absolute(folder).unwrap_or_else(|_| folder.into()), open: None }
    }

    /// Executes a request, which may block.
    pub fn perform(&mut self, request: Request) -> Answer {
        let done = match request {
            Request::Create { name } | Request::Remove { name } if !is_name(&name) => {
                Err(Trouble::Other(format!("{name:?} is no valid file name")))
            }
            Request::Create { name } => self.create(name),
            Request::Append { bytes, sync } => self.append(&bytes, sync),
            Request::Remove { name } => self.remove(&name),
            Request::List => {
                // The caller wants space: a file without a name keeps its bytes as long as it is open.
                self.open.take_if(|open| open.is_removed());
                return self
                    .list()
                    .map_or_else(Answer::Failed, |entries| Answer::Listed { entries, free: self.free() });
            }
        };
        done.map_or_else(Answer::Failed, |()| Answer::Done { free: self.free() })
    }

    /// Free space for users other than root, bytes; of the folder's future disk if it does not exist yet.
    #[allow(clippy::unnecessary_cast, reason = "machines of 32 bits have narrower ones")]
    fn free(&self) -> u64 {
        let there = self.folder.ancestors().find_map(|folder| statvfs(folder).ok());
        there.map_or(0, |disk| disk.blocks_available() as u64 * disk.fragment_size() as u64)
    }

    fn create(&mut self, name: String) -> Result<(), Trouble> {
        if let Some(Open { name, file, .. }) = self.open.take() {
            file.sync_data().map_err(|error| trouble(&name, &error))?;
        }
        let named = |error: io::Error| trouble(&name, &error);
        create_folder(&self.folder).map_err(|error| trouble(&self.folder.display().to_string(), &error))?;
        let root = File::open(&self.folder).map_err(named)?;
        let (folder, last) = match name.split_once('/') {
            Some((run, last)) => {
                match mkdirat(&root, run, Mode::from_bits_truncate(0o777)) {
                    Ok(()) => root.sync_all().map_err(named)?,
                    Err(Errno::EEXIST) => {}
                    Err(errno) => return Err(named(errno.into())),
                }
                (File::from(open_folder(&root, run).map_err(named)?), last)
            }
            None => (root, name.as_str()),
        };
        let flags = OFlag::O_WRONLY | OFlag::O_CREAT | OFlag::O_EXCL | OFlag::O_NOFOLLOW | OFlag::O_CLOEXEC;
        let file =
            openat(&folder, last, flags, Mode::from_bits_truncate(0o666)).map_err(|errno| named(errno.into()))?;
        let file = File::from(file);
        let lock = lock_new(&file);
        if let Err(error) = folder.sync_all() {
            // Without fsync of the folder the file would be lost by a power failure.
            let _ = unlinkat(&folder, last, UnlinkatFlags::NoRemoveDir);
            return Err(named(error));
        }
        self.open = Some(Open { name, file, length: 0, _lock: lock });
        Ok(())
    }

    fn append(&mut self, bytes: &[u8], sync: bool) -> Result<(), Trouble> {
        let Some(open) = &mut self.open else { return Err(Trouble::Other("no file is open".into())) };
        open.append(bytes, sync).map_err(|error| trouble(&open.name, &error))
    }

    fn remove(&self, name: &str) -> Result<(), Trouble> {
        let inside =
            |open: &Open| open.name.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
        if self.open.as_ref().is_some_and(inside) {
            return Err(Trouble::Other(format!("{name} is being written")));
        }
        let removed = || -> io::Result<()> {
            let root = OwnedFd::from(File::open(&self.folder)?);
            let (folder, last) = match name.split_once('/') {
                Some((run, last)) => (open_folder(&root, run)?, last),
                None => (root, name),
            };
            Ok(remove_all(&folder, &CString::new(last)?, DEPTH)?)
        };
        match removed() {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(trouble(name, &error)),
            _ => Ok(()),
        }
    }

    fn list(&self) -> Result<Vec<Entry>, Trouble> {
        let list = || {
            let root = match File::open(&self.folder) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
                root => OwnedFd::from(root?),
            };
            let mut names = BTreeSet::new();
            for_each(&root, |name| {
                if let Some(name) = name.to_str().ok().filter(|name| is_name(name)) {
                    names.insert(name.to_string());
                    if names.len() > ENTRIES {
                        names.pop_last();
                    }
                }
                Ok(())
            })?;
            let entry = |name: String| {
                let stat = stat(&root, &CString::new(&*name).ok()?).ok()?;
                let bytes = match kind(&stat) {
                    SFlag::S_IFREG => stat.st_size as u64,
                    SFlag::S_IFDIR => open_folder(&root, &*name).map_or(0, |folder| size(folder, DEPTH)),
                    _ => return None,
                };
                Some(Entry { name, bytes })
            };
            Ok(names.into_iter().filter_map(entry).collect())
        };
        list().map_err(|error: io::Error| trouble(&self.folder.display().to_string(), &error))
    }
}

impl Open {
    fn is_removed(&self) -> bool {
        self.file.metadata().is_ok_and(|file| file.nlink() == 0)
    }

    fn append(&mut self, bytes: &[u8], sync: bool) -> io::Result<()> {
        // Data of a file without a name would be lost.
        if self.is_removed() {
            return Err(io::Error::other("it was removed"));
        }
        let written = self.file.write_all_at(bytes, self.length);
        let synced = written.and_then(|()| if sync { self.file.sync_data() } else { Ok(()) });
        match synced {
            Ok(()) => self.length += bytes.len() as u64,
            // If this fails too, the next record overwrites the partial one.
            Err(_) => drop(self.file.set_len(self.length)),
        }
        synced
    }
}

/// Creates a folder so that it survives a power failure.
fn create_folder(folder: &Path) -> io::Result<()> {
    if folder.is_dir() {
        return Ok(());
    }
    let Some(above) = folder.parent() else { return Ok(()) };
    create_folder(above)?;
    match fs::create_dir(folder) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    File::open(above)?.sync_all()
}

/// Locks a new file; `None` if its file system has no locks.
fn lock_new(file: &File) -> Option<Flock<File>> {
    let mut file = file.try_clone().ok()?;
    for _ in 0..LOCK_TRIES {
        match Flock::lock(file, FlockArg::LockExclusiveNonblock) {
            Ok(lock) => return Some(lock),
            Err((back, Errno::EWOULDBLOCK)) => file = back,
            Err(_) => return None,
        }
        thread::sleep(Duration::from_millis(1));
    }
    None
}

fn open_folder<P: ?Sized + nix::NixPath>(above: impl AsFd, name: &P) -> io::Result<OwnedFd> {
    let flags = OFlag::O_RDONLY | OFlag::O_DIRECTORY | OFlag::O_NOFOLLOW | OFlag::O_CLOEXEC;
    Ok(openat(above, name, flags, Mode::empty())?)
}

fn stat(folder: impl AsFd, name: &CString) -> nix::Result<FileStat> {
    fstatat(folder, name.as_c_str(), AtFlags::AT_SYMLINK_NOFOLLOW)
}

fn kind(stat: &FileStat) -> SFlag {
    SFlag::from_bits_truncate(stat.st_mode) & SFlag::S_IFMT
}

/// Calls `visit` with each entry of a folder.
fn for_each(folder: &OwnedFd, mut visit: impl FnMut(CString) -> io::Result<()>) -> io::Result<()> {
    for entry in
        Dir::openat(folder, ".", OFlag::O_RDONLY | OFlag::O_DIRECTORY | OFlag::O_CLOEXEC, Mode::empty())?.iter()
    {
        let entry = entry?;
        if !matches!(entry.file_name().to_bytes(), b"." | b"..") {
            visit(entry.file_name().into())?;
        }
    }
    Ok(())
}

/// Total size of all files in a folder, bytes. Unreadable ones count 0, since this serves to make space.
fn size(folder: OwnedFd, depth: u32) -> u64 {
    let mut bytes = 0;
    let _ = for_each(&folder, |name| {
        if let Ok(stat) = stat(&folder, &name) {
            bytes += match kind(&stat) {
                SFlag::S_IFREG => stat.st_size as u64,
                SFlag::S_IFDIR if depth > 0 => open_folder(&folder, &*name).map_or(0, |inner| size(inner, depth - 1)),
                _ => 0,
            };
        }
        Ok(())
    });
    bytes
}

/// Removes a file, a link, or a folder with its content.
fn remove_all(folder: &OwnedFd, name: &CString, depth: u32) -> nix::Result<()> {
    match unlinkat(folder, name.as_c_str(), UnlinkatFlags::NoRemoveDir) {
        Err(Errno::EISDIR) if depth > 0 => {}
        result => return result,
    }
    let inner = open_folder(folder, name.as_c_str()).map_err(errno)?;
    for _ in 0..REMOVE_TRIES {
        for_each(&inner, |name| Ok(remove_all(&inner, &name, depth - 1)?)).map_err(errno)?;
        match unlinkat(folder, name.as_c_str(), UnlinkatFlags::RemoveDir) {
            Err(Errno::ENOTEMPTY) => {}
            result => return result,
        }
    }
    Err(Errno::ENOTEMPTY)
}

fn errno(error: io::Error) -> Errno {
    error.raw_os_error().map_or(Errno::EIO, Errno::from_raw)
}

fn trouble(name: &str, error: &io::Error) -> Trouble {
    match error.raw_os_error().map(Errno::from_raw) {
        Some(Errno::ENOSPC | Errno::EDQUOT) => Trouble::Full,
        Some(Errno::EROFS | Errno::EACCES | Errno::EPERM) => Trouble::ReadOnly,
        _ => Trouble::Other(format!("{name}: {error}")),
    }
}
