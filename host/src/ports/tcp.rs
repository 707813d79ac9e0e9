//! TCP connections: to a device, and the simulator's end. Bytes are words without the ninth bit.

mod server;
#[cfg(test)]
mod tests;

pub use server::Server;

use super::{Device, Lost, Received};
use base::serial::Word;
use base::{Duration, Instant};
use module::{Input, Output};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{
    AddressFamily, SockFlag, SockProtocol, SockType, SockaddrStorage, connect, setsockopt, socket, sockopt,
};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};

/// Maximum number of bytes that wait for the peer; an output that does not fit is dropped as a whole.
const QUEUE_MAX: usize = 16 * 1024;
/// Maximum number of bytes per read.
const READ_MAX: usize = 1024;
/// Maximum number of outputs whose end was not taken.
const SENT_MAX: usize = 1024;
/// A peer that does not acknowledge what was sent for this long is lost, ms.
const UNACKNOWLEDGED_MS: u32 = 3000;
/// A device that takes what is sent, and sends nothing for this long after it, is connected anew.
const UNANSWERED_FOR: Duration = Duration::from_secs(10);
/// Number of attempts to open, 20 ms each, after which a connection has failed.
const ATTEMPTS: u32 = 100;

/// A connection.
struct Stream {
    socket: TcpStream,
    queue: VecDeque<u8>,
    /// Bytes written, and the count at the end of each output that is not.
    written: u64,
    outputs: VecDeque<u64>,
    sent: VecDeque<Instant>,
    words: Vec<Word>,
}

impl Stream {
    fn new(socket: TcpStream) -> Result<Self, Lost> {
        socket.set_nonblocking(true).and_then(|()| socket.set_nodelay(true)).map_err(|error| error.to_string())?;
        setsockopt(&socket, sockopt::TcpUserTimeout, &UNACKNOWLEDGED_MS).map_err(Errno::desc)?;
        let (queue, outputs, sent) = (VecDeque::new(), VecDeque::new(), VecDeque::new());
        Ok(Self { socket, queue, written: 0, outputs, sent, words: Vec::new() })
    }

    /// Reads what is there; `None`: nothing for now.
    fn receive(&mut self) -> Result<Option<&[Word]>, Lost> {
        let mut bytes = [0; READ_MAX];
        loop {
            match self.socket.read(&mut bytes) {
                Ok(0) => return Err("the other side closed the connection".into()),
                Ok(count) => {
                    self.words.clear();
                    self.words.extend(bytes[..count].iter().copied().map(Word::data));
                    return Ok(Some(&self.words));
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.to_string()),
            }
        }
    }

    fn send(&mut self, now: Instant, words: &[Word]) -> Result<bool, Lost> {
        if self.queue.len() + words.len() > QUEUE_MAX || self.outputs.len() + self.sent.len() >= SENT_MAX {
            return Ok(false);
        }
        self.queue.extend(words.iter().map(|word| word.byte));
        self.outputs.push_back(self.written + self.queue.len() as u64);
        self.write_pending(now)?;
        Ok(true)
    }

    fn write_pending(&mut self, now: Instant) -> Result<(), Lost> {
        while !self.queue.is_empty() {
            match self.socket.write(self.queue.as_slices().0) {
                Ok(count) => {
                    self.queue.drain(..count);
                    self.written += count as u64;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.to_string()),
            }
        }
        while self.outputs.front().is_some_and(|end| *end <= self.written) {
            self.outputs.pop_front();
            self.sent.push_back(now);
        }
        Ok(())
    }

    fn take_sent(&mut self, now: Instant) -> bool {
        let sent = self.sent.front().is_some_and(|at| *at <= now);
        if sent {
            self.sent.pop_front();
        }
        sent
    }
}

/// The connection to a device.
pub struct Client {
    address: SocketAddr,
    /// A connection that is being made, and the attempts to open since.
    pending: Option<(OwnedFd, u32)>,
    stream: Option<Stream>,
    /// When the first output was sent that no input has followed.
    asked: Option<Instant>,
}

impl Client {
    /// Creates a port that is closed.
    pub fn new(address: SocketAddr) -> Self {
        Self { address, pending: None, stream: None, asked: None }
    }

    fn connect(&mut self) -> Result<TcpStream, Lost> {
        let (socket, attempts) = match self.pending.take() {
            Some(pending) => pending,
            None => match begin(self.address)? {
                (socket, true) => return Ok(socket.into()),
                (socket, false) => (socket, 0),
            },
        };
        let mut ready = [PollFd::new(socket.as_fd(), PollFlags::POLLOUT)];
        if poll(&mut ready, PollTimeout::ZERO).map_err(Errno::desc)? == 0 {
            if attempts >= ATTEMPTS {
                return Err("the connection is not answered".into());
            }
            self.pending = Some((socket, attempts + 1));
            return Err("the connection is being made".into());
        }
        let stream = TcpStream::from(socket);
        match stream.take_error() {
            Ok(None) => Ok(stream),
            Ok(Some(error)) | Err(error) => Err(error.to_string()),
        }
    }
}

/// Begins a TCP connection without waiting for it; true if it was made at once. When the socket is writable, its error
/// (`SO_ERROR`) states whether it was made.
///
/// # Errors
/// One line: the kernel refuses it, or there is no route.
pub fn begin(address: SocketAddr) -> Result<(OwnedFd, bool), Lost> {
    let family = if address.is_ipv4() { AddressFamily::Inet } else { AddressFamily::Inet6 };
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    let socket = socket(family, SockType::Stream, flags, SockProtocol::Tcp).map_err(Errno::desc)?;
    match connect(socket.as_raw_fd(), &SockaddrStorage::from(address)) {
        Ok(()) => Ok((socket, true)),
        Err(Errno::EINPROGRESS) => Ok((socket, false)),
        Err(errno) => Err(errno.desc().into()),
    }
}

impl Device for Client {
    fn open(&mut self) -> Result<(), Lost> {
        (self.stream, self.asked) = (None, None);
        let connected = self.connect().and_then(Stream::new);
        self.stream = Some(connected.map_err(|why| format!("{}: {why}", self.address))?);
        Ok(())
    }

    fn is_preparing(&self) -> bool {
        self.pending.is_some()
    }

    fn close(&mut self) {
        (self.stream, self.pending, self.asked) = (None, None, None);
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.stream.as_ref().map(|stream| stream.socket.as_fd())
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        match &mut self.stream {
            Some(stream) => {
                let Some(words) = stream.receive()? else { return Ok(Received::Nothing) };
                self.asked = None;
                Ok(Received::input(now, Input::Words(words)))
            }
            None => Ok(Received::Nothing),
        }
    }

    fn send(&mut self, now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(stream), Output::Words(words)) = (&mut self.stream, output) else { return Ok(false) };
        let asked = *self.asked.get_or_insert(now);
        if now.since(asked) > UNANSWERED_FOR {
            return Err(format!("{}: it does not answer", self.address));
        }
        stream.send(now, words)
    }

    fn wants_to_write(&self) -> bool {
        self.stream.as_ref().is_some_and(|stream| !stream.queue.is_empty())
    }

    fn on_writable(&mut self, now: Instant) -> Result<(), Lost> {
        self.stream.as_mut().map_or(Ok(()), |stream| stream.write_pending(now))
    }

    fn sent_at(&self) -> Option<Instant> {
        self.stream.as_ref()?.sent.front().copied()
    }

    fn take_sent(&mut self, now: Instant) -> bool {
        self.stream.as_mut().is_some_and(|stream| stream.take_sent(now))
    }
}
