//! The shared-memory bus beside the sockets of UDP multicast: whose turn it is, and what to wait for.

use super::{clock, context};
use crate::origin::{Origin, Process, Provenance};
use crate::shm::Bus;
use crate::udpm::{self, Datagram};
use crate::{filter, url};
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::stat::fstat;
use std::io;
use std::net::SocketAddrV4;
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

/// Maximum number of messages taken from shared memory before the socket is served.
const IN_A_ROW: u32 = 64;
/// The same while a publisher has gone over to datagrams, which come after what is in its ring.
const IN_A_ROW_FIRST: u32 = 4096;
/// Number of times the socket is skipped while shared memory has just run empty: after that a waiting caller relies on
/// the descriptor for the socket.
const PASSES: u32 = 16;
/// Token of the ready descriptor.
const SOCKET: u64 = 0;
const BELL: u64 = 1;

/// A context's place on the shared-memory bus.
#[derive(Debug)]
pub struct Local {
    bus: Bus,
    both: Epoll,
    in_a_row: u32,
    passes: u32,
    /// Number of waits since `offset` was read.
    waits: u32,
    /// Wall clock minus monotonic clock, ns, as of the last look at the socket, or some waits ago.
    offset: i64,
    /// Nothing was taken since [`Local::sleep`].
    asleep: bool,
}

impl Local {
    /// Joins the shared-memory bus if the URL requests it and it is available. `receive` is not bound yet.
    pub fn join(url: &url::Udpm, source: SocketAddrV4, receive: BorrowedFd<'_>) -> Option<Self> {
        if url.shm == url::Shm::Off {
            return None;
        }
        // Without it there are datagrams, and the others see that we need them.
        let inode = fstat(receive).ok()?.st_ino as u32;
        let both = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).ok()?;
        let bus = Bus::join(url, source, inode).ok()?;
        both.add(receive, EpollEvent::new(EpollFlags::EPOLLIN, SOCKET)).ok()?;
        both.add(bus.doorbell(), EpollEvent::new(EpollFlags::EPOLLIN | EpollFlags::EPOLLET, BELL)).ok()?;
        Some(Self { bus, both, in_a_row: 0, passes: 0, waits: 0, offset: offset(), asleep: true })
    }

    /// See [`Bus::publish`].
    pub fn publish(&mut self, sequence: u32, channel: &str, payload: &[u8], at: i64) -> bool {
        self.bus.publish(sequence, channel, payload, at)
    }

    /// See [`Bus::is_cut`].
    pub fn is_cut(&self) -> bool {
        self.bus.is_cut()
    }

    /// See [`Bus::moved`].
    pub fn moved(&mut self, source: SocketAddrV4) {
        self.bus.moved(source);
    }

    /// See [`Bus::set_interest`].
    pub fn set_interest(&mut self, channels: Option<&[&str]>) {
        self.bus.set_interest(channels);
    }

    /// Takes the next message, for [`Local::message`]; false also when it is the socket's turn.
    pub fn recv(&mut self, wants: impl FnMut(&str) -> bool, takes: impl Fn(&str, usize) -> bool) -> bool {
        let more = self.in_a_row < IN_A_ROW || self.in_a_row < IN_A_ROW_FIRST && self.bus.is_behind();
        if more && self.bus.recv(wants, takes) {
            self.asleep = false;
            self.in_a_row += 1;
            return true;
        }
        false
    }

    /// After [`Local::recv`] gave nothing: whether there is no need to look at the socket.
    pub fn passes_socket(&mut self) -> bool {
        if self.in_a_row < IN_A_ROW && self.bus.received() && self.passes < PASSES {
            self.passes += 1;
            return true;
        }
        (self.in_a_row, self.passes, self.waits, self.offset) = (0, 0, 0, offset());
        false
    }

    /// The wait has found that the socket has nothing.
    fn socket_is_empty(&mut self) {
        (self.in_a_row, self.passes, self.waits) = (0, 0, self.waits + 1);
        if self.waits >= PASSES {
            (self.waits, self.offset) = (0, offset());
        }
    }

    /// Channel and payload.
    pub fn message(&self) -> (&str, &[u8]) {
        let (channel, payload, _) = self.bus.message();
        (channel, payload)
    }

    /// When that was published, and by whom.
    pub fn provenance(&self) -> Provenance {
        let published = self.bus.published();
        let origin = self.bus.from().map_or(Origin::Host(None), Origin::Memory);
        Provenance { at: published.saturating_add(self.offset), published: Some(published), origin }
    }

    /// See [`Bus::process_at`].
    pub fn process_at(&self, source: SocketAddrV4) -> Option<Process> {
        self.bus.process_at(source)
    }

    /// Number of messages that were lost since the last call.
    pub fn take_lost(&mut self) -> u64 {
        self.bus.take_lost()
    }

    /// True if a datagram, received at `at`, is dropped because shared memory has its message.
    pub fn takes(&mut self, from: SocketAddrV4, datagram: &[u8], at: i64) -> bool {
        match udpm::decode(datagram) {
            Ok(Datagram::Short(short)) if short.channel == filter::SELF_TEST => {
                self.bus.self_test(from);
                false
            }
            Ok(datagram) => {
                let sequence = datagram.sequence();
                self.bus.overtakes(from, sequence) || self.bus.takes(from, sequence, at)
            }
            Err(_) => false,
        }
    }

    /// Prepares to sleep when nothing is left, in [`Local::wait`] if the caller `waits`; false if a message has arrived
    /// since.
    pub fn sleep(&mut self, waits: bool) -> bool {
        self.asleep = self.bus.sleep(!waits);
        self.asleep
    }

    /// True if the caller has not taken everything, so that it must not wait.
    pub fn ready(&self) -> bool {
        !self.asleep
    }

    /// Waits for the bell or the socket.
    pub fn wait(&mut self, timeout: Duration) -> io::Result<()> {
        // Rounded up: a wait of half a millisecond is not a busy loop.
        let millis = timeout.as_nanos().div_ceil(1_000_000).min(i32::MAX as u128) as i32;
        // Without a limit the kernel sets no timer.
        let timeout = match timeout {
            Duration::MAX => EpollTimeout::NONE,
            _ => EpollTimeout::try_from(millis).map_err(io::Error::other)?,
        };
        let mut events = [EpollEvent::empty(); 2];
        match self.both.wait(&mut events, timeout) {
            Ok(count) if events[..count].iter().any(|event| event.data() == SOCKET) => self.passes = PASSES,
            Ok(_) => self.socket_is_empty(),
            Err(Errno::EINTR) => {}
            Err(errno) => return Err(context("cannot wait")(errno)),
        }
        Ok(())
    }
}

fn offset() -> i64 {
    clock::realtime().0.saturating_sub(clock::monotonic())
}

impl AsFd for Local {
    /// Readable when the bell or the socket is.
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.both.0.as_fd()
    }
}
