//! The TCPQ provider: a client of a hub. The wire: [`crate::tcpq`].
//!
//! The connection is made, lost and made again behind the caller's back, and never in its way: connecting, greeting
//! and waiting for the next try happen in [`Tcpq::publish`] and [`Tcpq::recv`], which return at once. The descriptor is
//! an epoll that holds the socket of the moment and a timer, so it is the same one through all connections. A program
//! that only publishes must watch it too, or publish on: what the kernel did not take goes out then.
//!
//! ```text
//!        ┌───────────── the timer: 50 ms, doubling to 2 s ──────────────┐
//!        v                                                              │
//!   Connecting ── connected: hello, subscriptions ──> Greeting ── hub's hello ──> Up
//!        └──── refused, no answer, no hub, end of stream: what waited is lost ──┴──┘──> Down
//! ```

use super::clock::{self, Timer};
use super::{PublishError, RealtimeNanos, Received, SubscribeError, check, context};
use crate::origin::{Origin, Provenance};
use crate::queue::Line;
use crate::receiver::Stats;
use crate::subscription::{Pattern, PatternError, Queue, SubscriptionId, Subscriptions};
use crate::tcpq::{self, Decoder, Message, Outbox, Peer, TEXT_MAX};
use crate::udpm::MESSAGE_MAX;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use nix::sys::socket::{
    AddressFamily, MsgFlags, SockFlag, SockType, SockaddrIn, connect, getsockopt, recv, sendmsg, setsockopt, socket,
    sockopt,
};
use std::io::{self, IoSlice};
use std::net::SocketAddrV4;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::time::Duration;

/// The first wait after a connection was lost, and the longest.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(2));
/// Time limit for a hub to accept, and then for its hello.
const PATIENCE: Duration = Duration::from_secs(3);
/// After how many seconds of silence the other end is asked whether it is there, and how often, each second.
const SILENCE: u32 = 3;
const PROBES: u32 = 3;
/// Maximum size of waiting output, bytes, before a message is refused; one message is accepted regardless of its size.
const OUTBOX_MAX: usize = 4 << 20;
/// Maximum size of waiting input, payload bytes, where subscriptions have limits.
const LINE_MAX: usize = 4 << 20;
/// Size of one read, bytes, and maximum number of reads in one call.
const CHUNK: usize = 64 << 10;
const READS_MAX: usize = 16;
/// Maximum number of pieces that go into one system call.
const PIECES_MAX: usize = 64;

/// A place on a bus that a hub relays.
#[derive(Debug)]
pub struct Tcpq {
    hub: SocketAddrV4,
    epoll: Epoll,
    timer: Timer,
    link: Link,
    /// The epoll looks for room to write.
    watches_out: bool,
    back_off: Duration,
    /// Why there was no connection last.
    why_down: String,
    outbox: Outbox,
    stream: Decoder,
    /// Maximum payload, bytes.
    message_max: usize,
    /// Time when the bytes in `stream` were read.
    read_at: RealtimeNanos,
    chunk: Box<[u8]>,
    subscriptions: Subscriptions,
    /// Expressions requested from the hub.
    patterns: Vec<(SubscriptionId, String)>,
    line: Line,
    stats: Stats,
}

/// A hub relays what anybody sends to it; a hub on another computer is trusted no more than the network.
fn provenance(hub: SocketAddrV4, at: RealtimeNanos) -> Provenance {
    let origin = if hub.ip().is_loopback() { Origin::Host(None) } else { Origin::Network };
    Provenance { at: at.0, published: None, origin }
}

#[derive(Debug)]
enum Link {
    /// Until the timer.
    Down,
    /// Until the socket is connected, or the timer.
    Connecting(OwnedFd),
    /// Connected; until the hub's hello, or the timer.
    Greeting(OwnedFd),
    Up(OwnedFd),
}

impl Tcpq {
    /// Begins to connect. That there is no hub is no error: it may come.
    pub(super) fn new(hub: SocketAddrV4) -> io::Result<Self> {
        let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(context("cannot make an epoll"))?;
        let timer = Timer::new()?;
        epoll.add(&timer, EpollEvent::new(EpollFlags::EPOLLIN, 0)).map_err(context("cannot watch a timer"))?;
        let mut tcpq = Self {
            hub,
            epoll,
            timer,
            link: Link::Down,
            watches_out: false,
            back_off: BACK_OFF.0,
            why_down: "not yet tried".into(),
            outbox: Outbox::default(),
            stream: Decoder::new(Peer::Hub, MESSAGE_MAX as usize),
            message_max: MESSAGE_MAX as usize,
            read_at: RealtimeNanos(0),
            chunk: vec![0; CHUNK].into(),
            subscriptions: Subscriptions::default(),
            patterns: Vec::new(),
            line: Line::new(LINE_MAX),
            stats: Stats::default(),
        };
        tcpq.connect()?;
        tcpq.drive()?;
        Ok(tcpq)
    }

    pub(super) fn publish(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        check(channel, payload)?;
        let result = self.send(channel, payload);
        self.stats.send_refused += u64::from(result.is_err());
        result
    }

    fn send(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        self.drive().map_err(PublishError::Io)?;
        let Some(socket) = self.link.connected() else {
            let why = format!("no connection to the hub at {}: {}", self.hub, self.why_down);
            return Err(PublishError::Io(io::Error::new(io::ErrorKind::NotConnected, why)));
        };
        let header = tcpq::publish_header(channel, payload.len());
        let len = header.len() + payload.len();
        if !self.outbox.is_empty() {
            if self.outbox.cost() + len > OUTBOX_MAX {
                return Err(PublishError::Busy);
            }
            self.outbox.push([&header, payload].concat().into(), 0);
            return Ok(());
        }
        let written = match write(socket, &[IoSlice::new(&header), IoSlice::new(payload)]) {
            Ok(written) => written,
            Err(errno) => {
                let error = io::Error::from(errno);
                self.lose(&errno.desc()).map_err(PublishError::Io)?;
                return Err(PublishError::Io(error));
            }
        };
        if written == len {
            self.stats.sent += 1;
            return Ok(());
        }
        self.outbox.push([&header, payload].concat().into(), written);
        self.watch().map_err(PublishError::Io)
    }

    pub(super) fn is_sent(&mut self) -> io::Result<bool> {
        self.drive()?;
        Ok(matches!(self.link, Link::Up(_)) && self.outbox.is_empty())
    }

    pub(super) fn subscribe(&mut self, pattern: &str, queue: Queue) -> Result<SubscriptionId, SubscribeError> {
        let too_long = || PatternError { pattern: pattern.into(), why: format!("longer than {TEXT_MAX} bytes") };
        if pattern.len() > TEXT_MAX {
            return Err(SubscribeError::Pattern(too_long()));
        }
        let id = self.subscriptions.add(Pattern::new(pattern).map_err(SubscribeError::Pattern)?, queue);
        // The hub need not know how many of ours are equal.
        let known = self.patterns.iter().any(|(_, text)| text == pattern);
        self.patterns.push((id, pattern.into()));
        if !known && let Err(error) = self.tell(&tcpq::subscribe(pattern)) {
            self.patterns.pop();
            self.subscriptions.remove(id);
            return Err(SubscribeError::Io(error));
        }
        Ok(id)
    }

    pub(super) fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        let Some(index) = self.patterns.iter().position(|(known, _)| *known == id) else {
            return false;
        };
        let (_, pattern) = self.patterns.remove(index);
        if !self.patterns.iter().any(|(_, text)| *text == pattern) {
            // If this fails, the hub goes on sending unwanted messages until the next connection.
            let _ = self.tell(&tcpq::unsubscribe(&pattern));
        }
        self.line.forget(id);
        self.subscriptions.remove(id)
    }

    pub(super) fn set_size_max(&mut self, id: SubscriptionId, bytes: usize) -> bool {
        self.subscriptions.set_size_max(id, bytes)
    }

    /// A hub that sends a larger message is disconnected, since the stream cannot be read beyond that message.
    pub(super) fn set_memory_max(&mut self, bytes: usize) {
        self.message_max = bytes.min(MESSAGE_MAX as usize);
        self.stream.set_message_max(self.message_max);
    }

    pub(super) fn recv(&mut self) -> io::Result<Option<Received<'_>>> {
        self.drive()?;
        let direct = self.line.is_empty() && self.subscriptions.unlimited();
        let mut reads = 0;
        let found = loop {
            match self.stream.next_message() {
                Ok(Some(Message::Publish { channel, payload, .. })) if direct => {
                    if self.subscriptions.takes(channel, payload.len()) {
                        break true;
                    }
                    let too_large = self.subscriptions.wants(channel);
                    self.stats.too_large += u64::from(too_large);
                    self.stats.unwanted += u64::from(!too_large);
                }
                Ok(Some(Message::Publish { channel, payload, .. })) => {
                    let from = provenance(self.hub, self.read_at);
                    if !self.line.push(&mut self.subscriptions, channel, payload, from) {
                        self.stats.unwanted += 1;
                    }
                    self.stats.queue_dropped = self.line.dropped();
                }
                Ok(Some(Message::Hello { .. })) => self.greeted()?,
                // The decoder refuses a hub that subscribes.
                Ok(Some(Message::Unusable(_) | Message::Subscribe(_) | Message::Unsubscribe(_))) => {
                    self.stats.malformed += 1;
                }
                Ok(None) if reads < READS_MAX => {
                    reads += 1;
                    if !self.read()? {
                        break false;
                    }
                }
                Ok(None) => break false,
                Err(error) => {
                    self.stats.malformed += 1;
                    self.lose(&error)?;
                    break false;
                }
            }
        };
        if let (true, Some((channel, payload))) = (found, self.stream.published()) {
            self.stats.received += 1;
            return Ok(Some(Received::new(channel, payload, provenance(self.hub, self.read_at))));
        }
        let waiting = self.line.pop(&mut self.subscriptions);
        Ok(waiting.map(|waiting| {
            self.stats.received += 1;
            Received::waiting(waiting)
        }))
    }

    /// True if a message waits that the descriptor does not signal.
    pub(super) fn ready(&self) -> bool {
        !self.line.is_empty() || self.stream.is_ready()
    }

    pub(super) fn stats(&self) -> &Stats {
        &self.stats
    }

    pub(super) fn dropped(&self, id: SubscriptionId) -> Option<u64> {
        self.subscriptions.dropped(id)
    }

    /// True if the hub has greeted and was not lost since, as of the last call.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        matches!(self.link, Link::Up(_))
    }

    /// Does what can be done now to get on: connect, greet, write.
    fn drive(&mut self) -> io::Result<()> {
        match &self.link {
            Link::Down if self.timer.expired() => self.connect()?,
            Link::Down => return Ok(()),
            Link::Connecting(_) | Link::Greeting(_) if self.timer.expired() => return self.lose(&"no answer"),
            Link::Connecting(_) | Link::Greeting(_) | Link::Up(_) => {}
        }
        if let Link::Connecting(socket) = &self.link {
            match connected(socket) {
                None => return Ok(()),
                Some(Err(errno)) => return self.lose(&errno.desc()),
                Some(Ok(())) => self.greet()?,
            }
        }
        self.flush()?;
        // Here too, for those who only publish. A hub's first message is its hello, or it is no hub.
        if matches!(self.link, Link::Greeting(_)) && self.read()? {
            match self.stream.next_message() {
                Ok(Some(_)) => return self.greeted(),
                Ok(None) => {}
                Err(error) => {
                    self.stats.malformed += 1;
                    return self.lose(&error);
                }
            }
        }
        Ok(())
    }

    fn connect(&mut self) -> io::Result<()> {
        match open(self.hub) {
            Ok(socket) => {
                let events = EpollFlags::EPOLLIN | EpollFlags::EPOLLOUT;
                self.epoll.add(&socket, EpollEvent::new(events, 1)).map_err(context("cannot watch a socket"))?;
                self.watches_out = true;
                self.link = Link::Connecting(socket);
                self.timer.set_after(PATIENCE)
            }
            Err(errno) => self.lose(&errno.desc()),
        }
    }

    /// Connected: hello, and all subscriptions.
    fn greet(&mut self) -> io::Result<()> {
        let Link::Connecting(socket) = std::mem::replace(&mut self.link, Link::Down) else {
            return Ok(());
        };
        self.link = Link::Greeting(socket);
        self.outbox.push_control(&tcpq::hello(Peer::Client));
        for (index, (_, pattern)) in self.patterns.iter().enumerate() {
            if !self.patterns[..index].iter().any(|(_, before)| before == pattern) {
                self.outbox.push_control(&tcpq::subscribe(pattern));
            }
        }
        self.timer.set_after(PATIENCE)
    }

    fn greeted(&mut self) -> io::Result<()> {
        self.link = match std::mem::replace(&mut self.link, Link::Down) {
            Link::Greeting(socket) => Link::Up(socket),
            other => other,
        };
        self.back_off = BACK_OFF.0;
        self.timer.clear()
    }

    /// The connection is lost, or there was none: what waited to be written is lost with it.
    fn lose(&mut self, why: &dyn std::fmt::Display) -> io::Result<()> {
        self.why_down = why.to_string();
        // Closing takes it out of the epoll.
        self.link = Link::Down;
        self.watches_out = false;
        self.stats.send_refused += self.outbox.messages() as u64;
        self.outbox = Outbox::default();
        self.stream = Decoder::new(Peer::Hub, self.message_max);
        self.timer.set_after(self.back_off)?;
        self.back_off = (self.back_off * 2).min(BACK_OFF.1);
        Ok(())
    }

    /// Sends what is no published message, if there is a connection; else the next one begins with it.
    fn tell(&mut self, control: &[u8]) -> io::Result<()> {
        if self.link.connected().is_some() {
            self.outbox.push_control(control);
            self.flush()?;
        }
        Ok(())
    }

    /// Writes what the kernel takes.
    fn flush(&mut self) -> io::Result<()> {
        while let Some(socket) = self.link.connected()
            && !self.outbox.is_empty()
        {
            let pieces: Vec<IoSlice<'_>> = self.outbox.slices().take(PIECES_MAX).map(IoSlice::new).collect();
            match write(socket, &pieces) {
                Ok(0) => break,
                Ok(written) => self.stats.sent += self.outbox.written(written),
                Err(errno) => return self.lose(&errno.desc()),
            }
        }
        self.watch()
    }

    /// Watches for room to write while something waits for it.
    fn watch(&mut self) -> io::Result<()> {
        let wanted = !self.outbox.is_empty();
        let Some(socket) = self.link.connected().filter(|_| wanted != self.watches_out) else {
            return Ok(());
        };
        let events = if wanted { EpollFlags::EPOLLIN | EpollFlags::EPOLLOUT } else { EpollFlags::EPOLLIN };
        let mut event = EpollEvent::new(events, 1);
        self.epoll.modify(socket, &mut event).map_err(context("cannot watch a socket"))?;
        self.watches_out = wanted;
        Ok(())
    }

    /// Reads once; false: nothing was there.
    fn read(&mut self) -> io::Result<bool> {
        let Some(socket) = self.link.connected() else {
            return Ok(false);
        };
        match recv(socket.as_raw_fd(), &mut self.chunk, MsgFlags::MSG_DONTWAIT) {
            Ok(0) => {
                self.lose(&"the hub has closed the connection")?;
                Ok(false)
            }
            Ok(len) => {
                self.read_at = clock::realtime();
                self.stream.push(&self.chunk[..len]);
                Ok(true)
            }
            Err(Errno::EINTR) => Ok(true),
            Err(Errno::EAGAIN) => Ok(false),
            Err(errno) => {
                self.lose(&errno.desc())?;
                Ok(false)
            }
        }
    }
}

impl AsFd for Tcpq {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.epoll.0.as_fd()
    }
}

impl Link {
    /// The socket, if it is connected.
    fn connected(&self) -> Option<&OwnedFd> {
        match self {
            Self::Greeting(socket) | Self::Up(socket) => Some(socket),
            Self::Down | Self::Connecting(_) => None,
        }
    }
}

/// A socket that is being connected.
fn open(hub: SocketAddrV4) -> nix::Result<OwnedFd> {
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    let fd = socket(AddressFamily::Inet, SockType::Stream, flags, None)?;
    prepare(&fd);
    // What was written and is not acknowledged: a hub takes everything, if it is there. Not for its own end, where a
    // client that only is slow would be cut off.
    let _ = setsockopt(&fd, sockopt::TcpUserTimeout, &(1000 * (SILENCE + PROBES)));
    match connect(fd.as_raw_fd(), &SockaddrIn::from(hub)) {
        Ok(()) | Err(Errno::EINPROGRESS | Errno::EINTR) => Ok(fd),
        Err(errno) => Err(errno),
    }
}

/// Sends at once, and notices that the other machine, or the cable, is gone, which would be silence for ever. Better
/// without all that than not at all.
pub(super) fn prepare(socket: &impl AsFd) {
    let _ = setsockopt(socket, sockopt::TcpNoDelay, &true);
    let _ = setsockopt(socket, sockopt::KeepAlive, &true);
    let _ = setsockopt(socket, sockopt::TcpKeepIdle, &SILENCE);
    let _ = setsockopt(socket, sockopt::TcpKeepInterval, &1);
    let _ = setsockopt(socket, sockopt::TcpKeepCount, &PROBES);
}

/// True if a socket is connected by now; `None`: not yet.
fn connected(socket: &OwnedFd) -> Option<nix::Result<()>> {
    let mut fds = [PollFd::new(socket.as_fd(), PollFlags::POLLOUT)];
    match poll(&mut fds, PollTimeout::ZERO) {
        Ok(0) | Err(Errno::EINTR) => None,
        Ok(_) => Some(match getsockopt(socket, sockopt::SocketError) {
            Ok(0) => Ok(()),
            Ok(error) => Err(Errno::from_raw(error)),
            Err(errno) => Err(errno),
        }),
        Err(errno) => Some(Err(errno)),
    }
}

/// Writes what the kernel takes, which may be nothing; a hub that has gone is an error and no signal.
pub(super) fn write(socket: impl AsFd, pieces: &[IoSlice<'_>]) -> nix::Result<usize> {
    let flags = MsgFlags::MSG_DONTWAIT | MsgFlags::MSG_NOSIGNAL;
    loop {
        match sendmsg::<()>(socket.as_fd().as_raw_fd(), pieces, &[], flags, None) {
            Err(Errno::EINTR) => {}
            Err(Errno::EAGAIN) => return Ok(0),
            result => return result,
        }
    }
}
