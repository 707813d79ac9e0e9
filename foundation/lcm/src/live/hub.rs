//! The hub of TCPQ on real sockets. Routing: [`crate::tcpq::hub`].
//!
//! ```no_run
//! # use std::time::Duration;
//! let mut hub = lcm::live::Hub::bind("127.0.0.1:7700".parse().unwrap())?;
//! loop {
//!     hub.wait(Duration::from_secs(1))?;
//!     hub.serve_once()?;
//!     while let Some(event) = hub.poll_event() {
//!         eprintln!("{event}");
//!     }
//! }
//! # #[allow(unreachable_code)]
//! # Ok::<(), std::io::Error>(())
//! ```

use super::clock::Timer;
use super::tcpq::{prepare, write};
use super::{context, wait};
use crate::tcpq::DecodeError;
use crate::tcpq::hub::{ClientId, ClientStats, Limits, Stats};
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::socket::{MsgFlags, recv};
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::io::{self, IoSlice};
use std::net::{SocketAddr, SocketAddrV4, TcpListener, TcpStream};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::time::Duration;

/// The listening socket and the timer among the clients' numbers, which count from 0.
const LISTENER: u64 = u64::MAX;
const TIMER: u64 = u64::MAX - 1;
/// Time without a byte taken after which a client is disconnected for which a hub without loss waits. Less than the 6 s
/// after which a publisher that is not read gives its connection up.
const STALL_MAX: Duration = Duration::from_secs(4);
/// Maximum number of sockets one [`Hub::serve_once`] serves, how much it reads of each and how many it accepts.
const SERVED_MAX: usize = 64;
const CHUNK: usize = 64 << 10;
const ACCEPTED_MAX: usize = 16;
/// Maximum number of messages that go into one system call.
const PIECES_MAX: usize = 256;
/// Maximum number of events that wait to be taken; then the oldest are lost.
const EVENTS_MAX: usize = 1024;

/// A client has come or gone. One line for people by `Display`.
#[derive(Debug)]
pub struct Event {
    /// The client.
    pub client: ClientId,
    /// Address of the client.
    pub address: SocketAddr,
    /// Kind of event.
    pub what: What,
}

/// Event of a client.
#[derive(Debug)]
pub enum What {
    /// Connected.
    Come,
    /// Closed the connection; counters of its messages.
    Gone(ClientStats),
    /// Sent malformed data.
    Malformed(DecodeError),
    /// The connection broke.
    Broken(io::Error),
    /// All others waited for it, and it took nothing for 4 s.
    Stalled,
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "client {} ({}): ", self.client.0, self.address)?;
        match &self.what {
            What::Come => write!(f, "connected"),
            What::Gone(ClientStats { published, delivered, dropped, .. }) => {
                write!(f, "gone; {published} messages from it, {delivered} to it, {dropped} dropped")
            }
            What::Malformed(error) => write!(f, "closed: {error}"),
            What::Broken(error) => write!(f, "lost: {error}"),
            What::Stalled => write!(f, "closed: it took nothing for 4 s, and all others waited for it"),
        }
    }
}

/// A hub that listens. It does nothing by itself: watch its descriptor and call [`Hub::serve_once`].
#[derive(Debug)]
pub struct Hub {
    hub: crate::tcpq::hub::Hub,
    listener: TcpListener,
    epoll: Epoll,
    connections: BTreeMap<ClientId, Connection>,
    events: VecDeque<Event>,
    chunk: Box<[u8]>,
    /// No client is read: one of them has to take its output first.
    holds: bool,
    /// Set while it holds: from then on each client that blocks has time to take something.
    timer: Timer,
    /// Given up for a moment to accept and close a connection when there are no descriptors left: unaccepted it would
    /// keep the listener readable.
    reserve: Option<OwnedFd>,
}

#[derive(Debug)]
struct Connection {
    stream: TcpStream,
    address: SocketAddr,
    /// The kernel takes no more now; the epoll looks for room to write.
    full: bool,
    /// Took something since the timer was set.
    took: bool,
    /// What the epoll looks for.
    watched: EpollFlags,
}

impl Hub {
    /// Listens, with the default [`Limits`].
    ///
    /// # Errors
    /// The address is not this machine's, or taken.
    pub fn bind(address: SocketAddrV4) -> io::Result<Self> {
        Self::with_limits(address, Limits::default())
    }

    /// Listens.
    ///
    /// # Errors
    /// As [`Hub::bind`].
    pub fn with_limits(address: SocketAddrV4, limits: Limits) -> io::Result<Self> {
        let listener = TcpListener::bind(address)
            .map_err(|error| io::Error::new(error.kind(), format!("cannot listen at {address}: {error}")))?;
        listener.set_nonblocking(true)?;
        let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(context("cannot make an epoll"))?;
        epoll.add(&listener, EpollEvent::new(EpollFlags::EPOLLIN, LISTENER)).map_err(context("cannot watch"))?;
        let timer = Timer::new()?;
        epoll.add(&timer, EpollEvent::new(EpollFlags::EPOLLIN, TIMER)).map_err(context("cannot watch"))?;
        let reserve = epoll.0.try_clone().ok();
        Ok(Self {
            hub: crate::tcpq::hub::Hub::new(limits),
            listener,
            epoll,
            connections: BTreeMap::new(),
            events: VecDeque::new(),
            chunk: vec![0; CHUNK].into(),
            holds: false,
            timer,
            reserve,
        })
    }

    /// Address on which it listens; with the actual port if 0 was requested.
    ///
    /// # Errors
    /// The system call failed.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Does all that can be done now, within limits, and returns: accepts, reads, relays, writes. Never blocks.
    ///
    /// # Errors
    /// The listening socket or the epoll failed. What is wrong with a client is its end, and an [`Event`].
    pub fn serve_once(&mut self) -> io::Result<()> {
        let mut ready = [EpollEvent::empty(); SERVED_MAX];
        let count = match self.epoll.wait(&mut ready, EpollTimeout::ZERO) {
            Err(Errno::EINTR) => 0,
            result => result.map_err(context("cannot wait for clients"))?,
        };
        for event in &ready[..count] {
            match event.data() {
                LISTENER => self.accept()?,
                TIMER => self.end_stalled()?,
                id => self.serve(ClientId(id), event.events()),
            }
        }
        while let Some(id) = self.hub.poll_pending() {
            if self.connections.get(&id).is_some_and(|connection| !connection.full) {
                self.write(id);
            }
        }
        self.hold_or_go_on()
    }

    /// Waits until [`Hub::serve_once`] has something to do, at most `timeout`; false when it has not, or a signal came.
    ///
    /// # Errors
    /// The system call failed.
    pub fn wait(&self, timeout: Duration) -> io::Result<bool> {
        wait(self.as_fd(), timeout)
    }

    /// Next event of a client; the oldest first, at most 1024 wait.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// True while nobody is read, since a client has to take its output first ([`crate::tcpq::hub::Overflow::Wait`]).
    #[must_use]
    pub fn holds(&self) -> bool {
        self.holds
    }

    /// Counters of everything.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.hub.stats()
    }

    /// Connected clients with their counters.
    pub fn clients(&self) -> impl Iterator<Item = (ClientId, SocketAddr, ClientStats)> {
        let stats = |id| self.hub.client(id).unwrap_or_default();
        self.connections.iter().map(move |(&id, connection)| (id, connection.address, stats(id)))
    }

    fn accept(&mut self) -> io::Result<()> {
        for _ in 0..ACCEPTED_MAX {
            let (stream, address) = match self.listener.accept() {
                Ok(accepted) => accepted,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) => match error.raw_os_error().map(Errno::from_raw) {
                    Some(Errno::EMFILE | Errno::ENFILE) => {
                        self.reserve = None;
                        drop(self.listener.accept());
                        self.reserve = self.epoll.0.try_clone().ok();
                        continue;
                    }
                    // Of the connection that is gone again, or of memory that is short for the moment.
                    _ => continue,
                },
            };
            // One too many, or not to be used, is closed by being dropped.
            if stream.set_nonblocking(true).is_err() {
                continue;
            }
            let Some(id) = self.hub.connect() else { continue };
            prepare(&stream);
            // While nobody is read a new client is not either: it would keep the hub busy.
            let watched = if self.holds { EpollFlags::empty() } else { EpollFlags::EPOLLIN };
            if self.epoll.add(&stream, EpollEvent::new(watched, id.0)).is_err() {
                self.hub.disconnect(id);
                continue;
            }
            self.connections.insert(id, Connection { stream, address, full: false, took: false, watched });
            self.tell(id, address, What::Come);
        }
        Ok(())
    }

    fn serve(&mut self, id: ClientId, events: EpollFlags) {
        if events.contains(EpollFlags::EPOLLOUT) {
            self.write(id);
        }
        let Some(connection) = self.connections.get(&id) else { return };
        let over = events.intersects(EpollFlags::EPOLLHUP | EpollFlags::EPOLLERR);
        // Also between two clients of one call: what is read must find room.
        let reads = events.contains(EpollFlags::EPOLLIN) && !self.hub.is_full();
        if !(over || reads) {
            return;
        }
        match recv(connection.stream.as_raw_fd(), &mut self.chunk, MsgFlags::MSG_DONTWAIT) {
            Ok(0) => {
                let stats = self.hub.client(id).unwrap_or_default();
                self.close(id, What::Gone(stats));
            }
            Ok(len) => {
                if let Err(error) = self.hub.handle_rx(id, &self.chunk[..len]) {
                    self.close(id, What::Malformed(error));
                }
            }
            Err(Errno::EAGAIN | Errno::EINTR) => {}
            Err(errno) => self.close(id, What::Broken(errno.into())),
        }
    }

    /// Writes what waits for a client, as far as the kernel takes it.
    fn write(&mut self, id: ClientId) {
        let Some(connection) = self.connections.get_mut(&id) else { return };
        let full = loop {
            let mut pieces = [IoSlice::new(&[]); PIECES_MAX];
            let mut count = 0;
            for (piece, bytes) in pieces.iter_mut().zip(self.hub.poll_tx(id)) {
                *piece = IoSlice::new(bytes);
                count += 1;
            }
            if count == 0 {
                break false;
            }
            let wanted: usize = pieces[..count].iter().map(|piece| piece.len()).sum();
            match write(&connection.stream, &pieces[..count]) {
                Ok(written) => {
                    self.hub.handle_tx(id, written);
                    connection.took |= written > 0;
                    if written < wanted {
                        break true;
                    }
                }
                Err(errno) => return self.close(id, What::Broken(errno.into())),
            }
        };
        connection.full = full;
        self.watch(id);
    }

    /// Looks for what can be done with a client now.
    fn watch(&mut self, id: ClientId) {
        let Some(connection) = self.connections.get_mut(&id) else { return };
        let mut wanted = EpollFlags::empty();
        wanted.set(EpollFlags::EPOLLIN, !self.holds);
        wanted.set(EpollFlags::EPOLLOUT, connection.full);
        if wanted == connection.watched {
            return;
        }
        connection.watched = wanted;
        if let Err(errno) = self.epoll.modify(&connection.stream, &mut EpollEvent::new(wanted, id.0)) {
            self.close(id, What::Broken(errno.into()));
        }
    }

    /// Reads no client while one has to take its output first.
    fn hold_or_go_on(&mut self) -> io::Result<()> {
        let holds = self.hub.is_full();
        if holds == self.holds {
            return Ok(());
        }
        self.holds = holds;
        match holds {
            true => self.await_stalled(),
            false => self.timer.clear(),
        }?;
        let ids: Vec<ClientId> = self.connections.keys().copied().collect();
        ids.into_iter().for_each(|id| self.watch(id));
        Ok(())
    }

    fn await_stalled(&mut self) -> io::Result<()> {
        self.connections.values_mut().for_each(|connection| connection.took = false);
        self.timer.set_after(STALL_MAX)
    }

    /// Disconnects the clients that block all others and took nothing in their time.
    fn end_stalled(&mut self) -> io::Result<()> {
        if !self.timer.expired() || !self.holds {
            return Ok(());
        }
        let stalled = self.connections.iter().filter(|(id, connection)| !connection.took && self.hub.blocks(**id));
        let stalled: Vec<ClientId> = stalled.map(|(id, _)| *id).collect();
        stalled.into_iter().for_each(|id| self.close(id, What::Stalled));
        self.await_stalled()
    }

    fn close(&mut self, id: ClientId, what: What) {
        self.hub.disconnect(id);
        // Closing takes it out of the epoll.
        if let Some(connection) = self.connections.remove(&id) {
            self.tell(id, connection.address, what);
        }
    }

    fn tell(&mut self, client: ClientId, address: SocketAddr, what: What) {
        if self.events.len() >= EVENTS_MAX {
            self.events.pop_front();
        }
        self.events.push_back(Event { client, address, what });
    }
}

impl AsFd for Hub {
    /// Readable when [`Hub::serve_once`] has something to do.
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.epoll.0.as_fd()
    }
}
