//! A watchdog's connection to the keeper of a module, and the datagrams on it ([`crate::keeper`]).

use crate::clock;
use crate::keepers::Place;
use base::Duration;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;
use nix::sys::socket::{
    AddressFamily, MsgFlags, SockFlag, SockType, UnixAddr, connect, getsockopt, recv, send, socket, sockopt,
};
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

/// Maximum lengths of a command and of an answer, bytes.
pub(crate) const COMMAND_MAX: usize = 64 << 10;
const ANSWER_MAX: usize = 8 << 10;
/// Time within which a keeper answers, or begins to listen.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(1);

/// Answer of a keeper.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    Running { pid: u32, start: u64, mark: String },
    Idle,
    Failed(String),
    Used { ticks: u64, pages: u64 },
    Ended(i32),
}

impl Answer {
    pub(crate) fn encode(&self) -> Vec<u8> {
        match self {
            Self::Running { pid, start, mark } => format!("running\0{pid}\0{start}\0{mark}"),
            Self::Idle => "idle".into(),
            Self::Failed(why) => format!("failed\0{}", why.replace('\0', " ")),
            Self::Used { ticks, pages } => format!("used\0{ticks}\0{pages}"),
            Self::Ended(status) => format!("ended\0{status}"),
        }
        .into_bytes()
    }

    /// `None`: no answer that a keeper gives.
    fn decode(datagram: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(datagram).ok()?;
        let mut fields = text.split('\0');
        let kind = fields.next()?;
        let mut field = || fields.next();
        Some(match kind {
            "running" => {
                let (pid, start) = (field()?.parse().ok()?, field()?.parse().ok()?);
                // Neither 0, nor the init process, nor a process group.
                (1 < pid && pid <= i32::MAX as u32).then_some(())?;
                Self::Running { pid, start, mark: field()?.into() }
            }
            "idle" => Self::Idle,
            "failed" => Self::Failed(field()?.chars().filter(|c| !c.is_control()).take(200).collect()),
            "used" => Self::Used { ticks: field()?.parse().ok()?, pages: field()?.parse().ok()? },
            "ended" => Self::Ended(field()?.parse().ok()?),
            _ => return None,
        })
    }
}

/// A watchdog's connection to a keeper.
#[derive(Debug)]
pub(crate) struct Kept(OwnedFd);

impl Kept {
    /// Connects, and asks which process the keeper runs.
    pub fn find(place: &Place) -> io::Result<(Self, Answer)> {
        Self::ask(place, b"state")
    }

    /// Has the module started; `args` are those of `advee run MODULE`.
    pub fn start(place: &Place, mark: &str, page: Option<&Path>, args: &[&[u8]]) -> io::Result<(Self, Answer)> {
        let page = page.map_or(&b""[..], |page| page.as_os_str().as_bytes());
        let fields: Vec<&[u8]> =
            [&b"start"[..], mark.as_bytes(), page].into_iter().chain(args.iter().copied()).collect();
        Self::ask(place, &fields.join(&0))
    }

    fn ask(place: &Place, datagram: &[u8]) -> io::Result<(Self, Answer)> {
        let kept = Self::connect(place)?;
        send(kept.0.as_raw_fd(), datagram, MsgFlags::MSG_NOSIGNAL)?;
        let end = clock::now() + ANSWER_TIMEOUT;
        loop {
            let left = end.since(clock::now());
            wait(&[kept.as_fd()], left)?;
            match kept.poll()? {
                Some(Answer::Used { .. } | Answer::Ended(_)) => {}
                Some(answer) => return Ok((kept, answer)),
                None if left == Duration::ZERO => return Err(io::ErrorKind::TimedOut.into()),
                None => {}
            }
        }
    }

    /// The keeper may still be starting.
    fn connect(place: &Place) -> io::Result<Self> {
        let address = UnixAddr::new(&place.socket())?;
        let end = clock::now() + ANSWER_TIMEOUT;
        loop {
            let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
            let socket = socket(AddressFamily::Unix, SockType::SeqPacket, flags, None)?;
            match connect(socket.as_raw_fd(), &address) {
                Ok(()) if getsockopt(&socket, sockopt::PeerCredentials)?.uid() == place.user()? => {
                    return Ok(Self(socket));
                }
                Ok(()) => return Err(io::ErrorKind::PermissionDenied.into()),
                Err(Errno::ENOENT | Errno::ECONNREFUSED | Errno::EAGAIN) if clock::now() < end => {
                    std::thread::sleep(Duration::from_millis(10));
                }
                Err(errno) => return Err(errno.into()),
            }
        }
    }

    /// The next answer, if one has arrived. An invalid answer is an error, like a keeper that has gone.
    pub fn poll(&self) -> io::Result<Option<Answer>> {
        match receive(&self.0, ANSWER_MAX)? {
            Some(datagram) => Answer::decode(&datagram).map(Some).ok_or_else(|| io::ErrorKind::InvalidData.into()),
            None => Ok(None),
        }
    }

    /// Has the module signalled, with all that it started.
    pub fn signal(&self, signal: Signal) {
        // A keeper that cannot be reached has ended, and the module with it.
        let datagram = [&b"signal\0"[..], (signal as i32).to_string().as_bytes()].concat();
        let _ = send(self.0.as_raw_fd(), &datagram, MsgFlags::MSG_NOSIGNAL | MsgFlags::MSG_DONTWAIT);
    }
}

impl AsFd for Kept {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// `None`: nothing has come.
pub(crate) fn receive(socket: &OwnedFd, length_max: usize) -> io::Result<Option<Vec<u8>>> {
    let mut datagram = vec![0; length_max];
    match recv(socket.as_raw_fd(), &mut datagram, MsgFlags::MSG_DONTWAIT) {
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Ok(length) => {
            datagram.truncate(length);
            Ok(Some(datagram))
        }
        Err(Errno::EAGAIN | Errno::EINTR) => Ok(None),
        Err(errno) => Err(errno.into()),
    }
}

/// Waits until one of them is readable.
pub(crate) fn wait(fds: &[BorrowedFd<'_>], limit: Duration) -> io::Result<()> {
    let mut fds: Vec<PollFd<'_>> = fds.iter().map(|fd| PollFd::new(*fd, PollFlags::POLLIN)).collect();
    // Rounded up: no busy loop before the end.
    let millis = limit.as_nanos().div_ceil(1_000_000).min(60_000) as u16;
    match poll(&mut fds, PollTimeout::from(millis)) {
        Ok(_) | Err(Errno::EINTR) => Ok(()),
        Err(errno) => Err(errno.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_read_as_it_was_written_and_nonsense_is_none() {
        let running = Answer::Running { pid: 4711, start: 9, mark: "/run/processes:web:1".into() };
        let failed = Answer::Failed("no such file".into());
        for answer in [running, Answer::Idle, failed, Answer::Used { ticks: 1, pages: 2 }, Answer::Ended(-9)] {
            assert_eq!(Answer::decode(&answer.encode()), Some(answer));
        }
        for text in [
            "",
            "running",
            "running\x001\x001\0m",
            "running\x00-1\x001\0m",
            "running\x004294967295\x001\0m",
            "ended\0",
            "x",
        ] {
            assert_eq!(Answer::decode(text.as_bytes()), None, "{text:?}");
        }
        assert_eq!(Answer::decode(&[0xFF, 0]), None);
    }
}
