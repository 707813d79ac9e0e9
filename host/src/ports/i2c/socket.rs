//! The simulator's bus: a socket in the run folder, with one datagram per transfer and one per outcome.

use crate::ports::{Device, Lost, Received};
use base::Instant;
use base::i2c::Outcome;
use base::i2c::codec::{self, DATAGRAM_MAX};
use module::{Input, OUTSTANDING, Output};
use nix::errno::Errno;
use nix::sys::socket::{
    AddressFamily, MsgFlags, SockFlag, SockType, UnixAddr, bind, connect, listen, recv, send, socket,
};
use std::fs::File;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

/// Maximum length of a socket's path (`sun_path` without its terminating zero).
const PATH_MAX: usize = 107;

/// The client's end.
pub struct Socket {
    path: PathBuf,
    socket: Option<OwnedFd>,
    waiting: usize,
    outcome: Outcome,
}

impl Socket {
    /// Creates the port of the bus that the simulator offers at `path`.
    pub fn new(path: PathBuf) -> Self {
        Self { path, socket: None, waiting: 0, outcome: Ok(Default::default()) }
    }
}

impl Device for Socket {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let socket = seqpacket().map_err(|errno| format!("socket: {}", errno.desc()))?;
        at(&self.path, |address| connect(socket.as_raw_fd(), address))?;
        self.socket = Some(socket);
        Ok(())
    }

    fn close(&mut self) {
        (self.socket, self.waiting) = (None, 0);
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(|socket| socket.as_fd())
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        let Some(socket) = &self.socket else { return Ok(Received::Nothing) };
        match read(socket)? {
            None => Ok(Received::Nothing),
            Some(datagram) => {
                self.outcome = codec::parse_outcome(&datagram).ok_or("it sent an invalid outcome")?;
                self.waiting = self.waiting.checked_sub(1).ok_or("it sent an outcome without a transfer")?;
                Ok(Received::input(now, Input::I2c(&self.outcome)))
            }
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(socket), Output::I2c(transfer)) = (&self.socket, output) else { return Ok(false) };
        if self.waiting >= OUTSTANDING {
            return Ok(false);
        }
        let sent = write(socket, &codec::transfer(transfer))?;
        self.waiting += usize::from(sent);
        Ok(sent)
    }
}

/// Reads a datagram, if available. `Err`: the peer is gone.
pub(super) fn read(socket: &impl AsRawFd) -> Result<Option<Vec<u8>>, Lost> {
    // One byte more than any valid one, to detect truncation.
    let mut datagram = [0; DATAGRAM_MAX + 1];
    loop {
        return match recv(socket.as_raw_fd(), &mut datagram, MsgFlags::MSG_DONTWAIT) {
            // An empty datagram looks like the end of the connection, and is never sent.
            Ok(0) => Err("the simulator is gone".into()),
            Ok(count) => Ok(Some(datagram[..count].to_vec())),
            Err(Errno::EAGAIN) => Ok(None),
            Err(Errno::EINTR) => continue,
            Err(errno) => Err(errno.desc().into()),
        };
    }
}

/// Sends a datagram; false if the socket buffer is full.
pub(super) fn write(socket: &impl AsRawFd, datagram: &[u8]) -> Result<bool, Lost> {
    loop {
        return match send(socket.as_raw_fd(), datagram, MsgFlags::MSG_DONTWAIT | MsgFlags::MSG_NOSIGNAL) {
            Ok(_) => Ok(true),
            Err(Errno::EAGAIN) => Ok(false),
            Err(Errno::EINTR) => continue,
            Err(errno) => Err(errno.desc().into()),
        };
    }
}

/// Creates a listening socket at `path`; replaces an existing file.
pub(super) fn listener(path: &Path) -> Result<OwnedFd, Lost> {
    let named = |errno: Errno| format!("{}: {}", path.display(), errno.desc());
    let socket = seqpacket().map_err(named)?;
    let fresh = path.with_extension("new");
    let _ = std::fs::remove_file(&fresh);
    at(&fresh, |address| bind(socket.as_raw_fd(), address))?;
    listen(&socket, nix::sys::socket::Backlog::MAXALLOWABLE).map_err(named)?;
    std::fs::rename(&fresh, path).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(socket)
}

fn seqpacket() -> nix::Result<OwnedFd> {
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    socket(AddressFamily::Unix, SockType::SeqPacket, flags, None)
}

/// Calls a function with the address of a path of any length.
fn at(path: &Path, call: impl FnOnce(&UnixAddr) -> nix::Result<()>) -> Result<(), Lost> {
    let named = |why: &str| format!("{}: {why}", path.display());
    let (folder, name) = (path.parent().unwrap_or(Path::new(".")), path.file_name().unwrap_or_default());
    let opened;
    let near = if path.as_os_str().len() <= PATH_MAX {
        path.into()
    } else {
        opened = File::open(folder).map_err(|error| named(&error.to_string()))?;
        Path::new("/proc/self/fd").join(opened.as_raw_fd().to_string()).join(name)
    };
    let address = UnixAddr::new(&near).map_err(|errno| named(errno.desc()))?;
    call(&address).map_err(|errno| named(errno.desc()))
}
