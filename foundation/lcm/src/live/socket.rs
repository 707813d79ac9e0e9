//! The two sockets, and which interfaces they use.
//! `liblcm` sends on, and joins on, the one interface that the routing table has for the group, looked up at the start
//! and, for sending, with every datagram. That breaks when a cable is pulled or the default route changes: datagrams
//! then leave on an interface where no process on this host has joined. Therefore
//!
//! - the receive socket joins on that interface and on `lo`;
//! - the send socket is bound to that interface's address and pinned to its index, and joins there too, so that the
//!   kernel loops its datagrams back even if no other socket of this host did;
//! - without a route, at the start or later, the send socket is bound to 127.0.0.1 instead, which pins it to `lo`
//!   (Linux `ip_route_output_key_hash_rcu`: a multicast goes out where its source address lives).
//!
//! With `interface` in the URL both sockets use that interface and no other. With a TTL of 0 the bus belongs to this
//! computer alone: the receive socket gets a filter against datagrams from other hosts before it is bound or joins a
//! group, and keeps it; if the filter cannot be attached, the socket receives nothing.
//!
//! A datagram is sent on one interface and received on that one, so joining on two delivers nothing twice. Datagrams of
//! a third interface that another process on this host has joined are received as well (`IP_MULTICAST_ALL`, the
//! kernel's default; the receive socket must be bound to the group, which it is): so `liblcm` peers receive what goes
//! over `lo`.

use super::{RealtimeNanos, clock, context, sys};
use crate::filter::{self, Instruction};
use crate::udpm::DATAGRAM_MAX;
use crate::url::{Interface, Udpm};
use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{
    AddressFamily, IpMembershipRequest, MsgFlags, SockFlag, SockType, SockaddrIn, bind, connect, getsockname,
    getsockopt, send, sendmsg, setsockopt, socket, sockopt,
};
use nix::sys::time::{TimeVal, TimeValLike};
use std::io::{self, IoSlice};
use std::mem;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::time::{Duration, Instant};

/// The send socket receives nothing that anybody wants; the kernel makes this its minimum.
const SEND_SOCKET_RECV_BUF: usize = 0;

/// Opens a blocking socket: each call decides if it waits.
fn open_socket() -> io::Result<OwnedFd> {
    socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None)
        .map_err(context("cannot open a UDP socket"))
}

/// Joins `group` on the interface that has `address`, or with 0.0.0.0 on the one in the routing table.
fn join(fd: &OwnedFd, group: Ipv4Addr, address: Ipv4Addr) -> nix::Result<()> {
    let request = IpMembershipRequest::new(group, Some(address));
    match setsockopt(fd, sockopt::IpAddMembership, &request) {
        Err(Errno::EADDRINUSE) => Ok(()), // joined there already
        result => result,
    }
}

/// A datagram as it arrived.
pub struct Arrival {
    pub from: SocketAddrV4,
    pub len: usize,
    pub at: RealtimeNanos,
}

/// Makes the kernel drop what other hosts send to a multicast socket; to be called before the socket is bound, since
/// datagrams that wait in it are no longer filtered.
///
/// # Errors
/// The kernel has no socket filters, or no memory for one.
pub fn keep_local(fd: BorrowedFd<'_>) -> io::Result<()> {
    let refused = context("cannot attach the socket filter that keeps datagrams of other hosts away");
    sys::attach_filter(fd, &filter::local()).map_err(refused)
}

#[derive(Debug)]
pub struct ReceiveSocket {
    fd: OwnedFd,
    address: SocketAddrV4,
    /// The address of the one interface to join on, if the URL names one.
    interface: Option<Ipv4Addr>,
    joined: bool,
    /// Datagrams of other hosts are kept away.
    local: bool,
    /// Unwanted channels are kept away.
    filtered: bool,
    /// Time limit of a call, as last passed to the kernel; `None`: no call has waited yet.
    patience: Option<Duration>,
    fullness: Fullness,
    drops: Drops,
}

impl ReceiveSocket {
    /// A socket that receives nothing until [`ReceiveSocket::join`]. It exists from the start so that an event loop
    /// can watch it before the first subscription.
    pub fn open(url: &Udpm) -> io::Result<Self> {
        let fd = open_socket()?;
        setsockopt(&fd, sockopt::ReuseAddr, &true).map_err(context("cannot set SO_REUSEADDR"))?;
        setsockopt(&fd, sockopt::ReceiveTimestampns, &true).map_err(context("cannot set SO_TIMESTAMPNS"))?;
        setsockopt(&fd, sockopt::RxqOvfl, &1).map_err(context("cannot set SO_RXQ_OVFL"))?;
        // Privileged processes get what they ask for, the others at most net.core.rmem_max.
        setsockopt(&fd, sockopt::RcvBufForce, &url.recv_buf_size)
            .or_else(|_| setsockopt(&fd, sockopt::RcvBuf, &url.recv_buf_size))
            .map_err(context("cannot set SO_RCVBUF"))?;
        let fullness = Fullness::of(fd.as_fd())?;
        Ok(Self {
            fd,
            address: url.address(),
            interface: address_of(url.interface.as_ref())?,
            joined: false,
            local: url.ttl == 0,
            filtered: false,
            patience: None,
            fullness,
            drops: Drops::default(),
        })
    }

    /// Joins the group and begins to receive; does nothing when that is done. Can be tried again after an error.
    pub fn join(&mut self) -> io::Result<()> {
        if self.joined {
            return Ok(());
        }
        let group = *self.address.ip();
        let joined = match self.interface {
            Some(address) => join(&self.fd, group, address),
            None => {
                let routed = join(&self.fd, group, Ipv4Addr::UNSPECIFIED);
                let loopback = join(&self.fd, group, Ipv4Addr::LOCALHOST);
                // No route: loopback alone. No loopback (a container without one): the route alone.
                routed.or(loopback)
            }
        };
        joined.map_err(context(format_args!("cannot join the multicast group {group} on any interface")))?;
        // Bound to the group, not to any address: unicast datagrams to the port do not belong to the bus.
        bind(self.fd.as_raw_fd(), &SockaddrIn::from(self.address))
            .map_err(context(format_args!("cannot bind to {}", self.address)))?;
        self.joined = true;
        Ok(())
    }

    /// True if datagrams of other hosts are kept away: of a bus with TTL 0.
    pub fn is_local(&self) -> bool {
        self.local
    }

    /// Makes the kernel pass what `program` passes, which excludes other hosts if this bus does; everything on the bus
    /// without a program, or if the kernel refuses it. True if it filters channels now.
    ///
    /// # Errors
    /// Other hosts cannot be excluded. What was filtered before still is.
    pub fn filter(&mut self, program: Option<&[Instruction]>) -> io::Result<bool> {
        let attached = program.is_some_and(|program| sys::attach_filter(self.fd.as_fd(), program).is_ok());
        if !attached && self.local {
            keep_local(self.fd.as_fd())?;
        } else if !attached && self.filtered {
            // Cannot fail: there is one.
            let _ = sys::detach_filter(self.fd.as_fd());
        }
        self.filtered = attached;
        Ok(attached)
    }

    pub fn filtered(&self) -> bool {
        self.filtered
    }

    /// The next datagram, if one waits, or comes within the time that is given.
    pub fn receive(&mut self, buffer: &mut [u8], wait: Option<Duration>) -> io::Result<Option<Arrival>> {
        let flags = match wait {
            Some(patience) if !patience.is_zero() => {
                self.set_patience(patience)?;
                MsgFlags::empty()
            }
            _ => MsgFlags::MSG_DONTWAIT,
        };
        // The kernel's counter has what the filter dropped in it, too: while there is one, only the counts of when the
        // buffer was full are of use, and each costs a copy.
        let filtered = self.filtered || self.local;
        let counts = !filtered || self.fullness.is_near();
        let received = loop {
            match sys::receive(self.fd.as_fd(), buffer, counts, flags.bits()) {
                // A signal ends the wait.
                Err(Errno::EINTR) if flags.is_empty() => return Ok(None),
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN) => {
                    self.fullness.empty();
                    return Ok(None);
                }
                result => break result.map_err(context("cannot receive"))?,
            }
        };
        let sys::Datagram { from, len, at, overflows } = received;
        let at = at.map(RealtimeNanos).ok_or_else(|| io::Error::other("the kernel gave no receive time"))?;
        let was_full = self.fullness.was_full(self.fd.as_fd(), len);
        match counts {
            true => self.drops.note(overflows, !filtered || was_full),
            false => self.drops.pass(),
        }
        Ok(Some(Arrival { from, len, at }))
    }

    fn set_patience(&mut self, patience: Duration) -> io::Result<()> {
        if self.patience != Some(patience) {
            // Zero is for ever.
            let micros = match patience {
                Duration::MAX => 0,
                _ => i64::try_from(patience.as_micros()).unwrap_or(i64::MAX).clamp(1, 1 << 50),
            };
            setsockopt(&self.fd, sockopt::ReceiveTimeout, &TimeVal::microseconds(micros))
                .map_err(context("cannot set SO_RCVTIMEO"))?;
            self.patience = Some(patience);
        }
        Ok(())
    }

    /// Datagrams that found the receive buffer full; while the kernel filters, also unwanted ones of the same moment.
    pub fn dropped(&self) -> u64 {
        self.drops.counted
    }

    pub fn granted_size(&self) -> io::Result<usize> {
        // The kernel reports twice what it grants, the half for its own bookkeeping (socket(7)).
        let size = getsockopt(&self.fd, sockopt::RcvBuf).map_err(context("cannot read SO_RCVBUF"))?;
        Ok(size / 2)
    }

    pub fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

/// Count of the datagrams that found the receive buffer full.
#[derive(Debug, Default)]
struct Drops {
    counted: u64,
    /// The kernel's counter as last seen, which wraps.
    seen: u32,
    /// Datagrams have come since then without that counter.
    stale: bool,
}

impl Drops {
    /// A datagram came with the kernel's counter, or without one because it is 0 or has not changed. `all`: what was
    /// dropped between the datagram before and this one found the buffer full.
    fn note(&mut self, overflows: Option<u32>, all: bool) {
        let now = overflows.unwrap_or(self.seen);
        if !mem::replace(&mut self.stale, false) && all {
            self.counted += u64::from(now.wrapping_sub(self.seen));
        }
        self.seen = now;
    }

    /// A datagram came of which the counter was not asked for.
    fn pass(&mut self) {
        self.stale = true;
    }
}

/// Detects that the receive buffer of a socket with a filter was full: the kernel's count of drops (`SO_RXQ_OVFL`) has
/// what the filter refused in it, too. Without a system call per datagram: before it was full it must have been three
/// quarters full after a quarter of it has been read.
#[derive(Debug)]
pub struct Fullness {
    /// Bytes to read between two looks.
    quarter: usize,
    read: usize,
    full: bool,
    /// True if it has been read empty since.
    emptied: bool,
}

impl Fullness {
    /// Approximate overhead of a datagram in the buffer, bytes, at most.
    const OVERHEAD: usize = 1280;

    /// Of a socket whose buffer has its size.
    ///
    /// # Errors
    /// The kernel does not tell the size.
    pub fn of(fd: BorrowedFd<'_>) -> io::Result<Self> {
        let size = getsockopt(&fd, sockopt::RcvBuf).map_err(context("cannot read SO_RCVBUF"))?;
        Ok(Self { quarter: size / 4, read: 0, full: false, emptied: false })
    }

    /// True if the buffer was full lately, or may be found to have been full with the next datagram or the one after
    /// it: of these the kernel's count of drops is needed.
    fn is_near(&self) -> bool {
        self.full || self.read + 2 * (DATAGRAM_MAX + Self::OVERHEAD) > self.quarter
    }

    /// No datagram waits.
    pub fn empty(&mut self) {
        self.emptied = true;
    }

    /// True if it was full before this datagram of `len` bytes arrived; to be called for each one received.
    pub fn was_full(&mut self, fd: BorrowedFd<'_>, len: usize) -> bool {
        self.read += len + Self::OVERHEAD;
        if self.read > self.quarter {
            self.read = 0;
            let (taken, size) = sys::receive_memory(fd).unwrap_or_default();
            if u64::from(taken) * 3 >= u64::from(size) * 2 {
                (self.full, self.emptied) = (true, false);
            }
        }
        // The first datagram that fits again indicates those that did not.
        let was_full = self.full;
        if self.emptied {
            (self.full, self.emptied) = (false, false);
        }
        was_full
    }
}

/// Largest datagram that is put together before it is sent, bytes: up to there a copy costs less than the kernel's look
/// at two parts.
const JOINED_MAX: usize = 2048;

#[derive(Debug)]
pub struct SendSocket {
    fd: OwnedFd,
    group: SockaddrIn,
    /// The socket is connected to the group: its datagrams need no address each.
    connected: bool,
    ttl: u8,
    source: SocketAddrV4,
    /// The URL names the interface: there is no other way.
    pinned: bool,
    datagram_max: usize,
    /// A datagram as it is sent.
    joined: Vec<u8>,
}

impl SendSocket {
    pub fn open(url: &Udpm) -> io::Result<Self> {
        let (interface, to) = (address_of(url.interface.as_ref())?, url.address());
        let source = match interface {
            Some(address) => address,
            // A route over `lo` may have no source address: 0.0.0.0, which pins nothing.
            None => route_to(to)?.filter(|source| !source.is_unspecified()).unwrap_or(Ipv4Addr::LOCALHOST),
        };
        let (fd, source) = open_sender(url.group, url.ttl, source)?;
        let connected = connect_sender(&fd, &to.into());
        // A datagram that leaves this host in pieces is lost with any of them. What stays here is never in pieces.
        let datagram_max = match url.ttl {
            0 => DATAGRAM_MAX,
            _ => path_mtu(*source.ip(), to).saturating_sub(IP_AND_UDP_HEADER).min(DATAGRAM_MAX),
        };
        let (pinned, joined) = (interface.is_some(), Vec::with_capacity(JOINED_MAX));
        Ok(Self { fd, group: to.into(), connected, ttl: url.ttl, source, pinned, datagram_max, joined })
    }

    /// Sends one datagram; if its interface has gone, from now on over `lo`, where all our processes listen. `moved`
    /// gets the new source address before the first datagram leaves from there.
    pub fn send(&mut self, header: &[u8], payload: &[u8], moved: impl FnOnce(SocketAddrV4)) -> nix::Result<()> {
        match self.send_once(header, payload) {
            // The interface is down, or has lost its address.
            Err(
                error @ (Errno::ENETUNREACH | Errno::EHOSTUNREACH | Errno::ENETDOWN | Errno::ENODEV | Errno::EINVAL),
            ) if !self.pinned && !self.on_loopback() => {
                let (fd, source) = open_sender(self.group.ip(), self.ttl, Ipv4Addr::LOCALHOST).map_err(|_| error)?;
                self.connected = connect_sender(&fd, &self.group);
                (self.fd, self.source, self.datagram_max) = (fd, source, DATAGRAM_MAX);
                moved(source);
                self.send_once(header, payload)
            }
            result => result,
        }
    }

    fn send_once(&mut self, header: &[u8], payload: &[u8]) -> nix::Result<()> {
        let (fd, flags) = (self.fd.as_raw_fd(), MsgFlags::MSG_DONTWAIT);
        let joined = self.connected && header.len() + payload.len() <= JOINED_MAX;
        if joined {
            self.joined.clear();
            self.joined.extend_from_slice(header);
            self.joined.extend_from_slice(payload);
        }
        let to = if self.connected { None } else { Some(&self.group) };
        loop {
            let result = match joined {
                true => send(fd, &self.joined, flags),
                false => sendmsg(fd, &[IoSlice::new(header), IoSlice::new(payload)], &[], flags, to),
            };
            match result {
                Err(Errno::EINTR) => {}
                result => return result.map(drop),
            }
        }
    }

    /// Waits until the kernel has room, at most so long; how much of that is left.
    #[allow(clippy::disallowed_methods, reason = "how long was waited")]
    pub fn wait(&self, patience: Duration) -> Duration {
        let begin = Instant::now();
        let millis = u16::try_from(patience.as_nanos().div_ceil(1_000_000)).unwrap_or(u16::MAX);
        // The result does not matter: sending reports errors.
        let _ = poll(&mut [PollFd::new(self.fd.as_fd(), PollFlags::POLLOUT)], PollTimeout::from(millis));
        patience.saturating_sub(begin.elapsed())
    }

    /// Source address of our datagrams.
    pub fn source(&self) -> SocketAddrV4 {
        self.source
    }

    /// The largest datagram that travels in one piece.
    pub fn datagram_max(&self) -> usize {
        self.datagram_max
    }

    pub fn on_loopback(&self) -> bool {
        self.source.ip().is_loopback()
    }
}

/// Addresses of this host's interfaces. The kernel drops datagrams from outside with one of them as their source (Linux
/// `fib_validate_source`), so a datagram from one is of this host.
#[derive(Debug, Default)]
pub struct Neighbours {
    addresses: Vec<Ipv4Addr>,
    /// Time of the last look, ns of the monotonic clock.
    looked_at: Option<i64>,
}

impl Neighbours {
    /// Minimum time between two looks, ns.
    const LOOK: i64 = 1_000_000_000;

    /// True if `address` is one of this host; looks again, at times, if it is not known.
    pub fn has(&mut self, address: Ipv4Addr) -> bool {
        let now = clock::monotonic();
        if !self.addresses.contains(&address) && self.looked_at.is_none_or(|at| now - at > Self::LOOK) {
            self.looked_at = Some(now);
            let found = getifaddrs().into_iter().flatten();
            self.addresses = found.filter_map(|entry| Some(entry.address?.as_sockaddr_in()?.ip())).collect();
        }
        self.addresses.contains(&address)
    }
}

/// Without options.
const IP_AND_UDP_HEADER: usize = 28;
/// The largest packet that every network carries whole, more or less: Ethernet's.
const USUAL_MTU: usize = 1500;

/// The largest packet on the way from `source` to `to`.
fn path_mtu(source: Ipv4Addr, to: SocketAddrV4) -> usize {
    let probe = || {
        let probe = open_socket()?;
        bind(probe.as_raw_fd(), &SockaddrIn::from(SocketAddrV4::new(source, 0)))?;
        connect(probe.as_raw_fd(), &SockaddrIn::from(to))?;
        io::Result::Ok(sys::path_mtu(probe.as_fd())?)
    };
    probe().unwrap_or(USUAL_MTU)
}

/// The IPv4 address of an interface.
fn address_of(interface: Option<&Interface>) -> io::Result<Option<Ipv4Addr>> {
    let name = match interface {
        None => return Ok(None),
        Some(Interface::Address(address)) => return Ok(Some(*address)),
        Some(Interface::Name(name)) => name,
    };
    let all = getifaddrs().map_err(context("cannot list the network interfaces"))?;
    let mut addresses = all.filter(|entry| entry.interface_name == *name);
    let address = addresses.find_map(|entry| Some(entry.address?.as_sockaddr_in()?.ip()));
    let missing = || {
        let text = format!("there is no network interface {name} with an IPv4 address");
        io::Error::new(io::ErrorKind::NotFound, text)
    };
    address.map(Some).ok_or_else(missing)
}

/// The address that a datagram to `to` would leave with; `None` where there is no route. Sends nothing.
fn route_to(to: SocketAddrV4) -> io::Result<Option<Ipv4Addr>> {
    let probe = open_socket()?;
    // Whichever error: no route, a route that forbids, an interface that is down. What is really wrong shows on `lo`.
    if connect(probe.as_raw_fd(), &SockaddrIn::from(to)).is_err() {
        return Ok(None);
    }
    let address: SockaddrIn = getsockname(probe.as_raw_fd()).map_err(context("cannot read a socket's address"))?;
    Ok(Some(address.ip()))
}

/// True if it is connected now. An interface that is down refuses it; then sending shows what is wrong.
fn connect_sender(fd: &OwnedFd, group: &SockaddrIn) -> bool {
    connect(fd.as_raw_fd(), group).is_ok()
}

fn open_sender(group: Ipv4Addr, ttl: u8, source: Ipv4Addr) -> io::Result<(OwnedFd, SocketAddrV4)> {
    let fd = open_socket()?;
    setsockopt(&fd, sockopt::IpMulticastTtl, &ttl).map_err(context("cannot set IP_MULTICAST_TTL"))?;
    setsockopt(&fd, sockopt::IpMulticastLoop, &true).map_err(context("cannot set IP_MULTICAST_LOOP"))?;
    setsockopt(&fd, sockopt::RcvBuf, &SEND_SOCKET_RECV_BUF).map_err(context("cannot set SO_RCVBUF"))?;
    bind(fd.as_raw_fd(), &SockaddrIn::from(SocketAddrV4::new(source, 0)))
        .map_err(context(format_args!("cannot bind to {source}")))?;
    // By its index, too: then an interface that is down is an error and not a silence; and when the address moves to
    // another interface, where we have not joined, nothing follows it: there not even a TTL of 0 would hold.
    sys::set_multicast_interface(fd.as_fd(), source).map_err(context("cannot set IP_MULTICAST_IF"))?;
    join(&fd, group, source).map_err(context(format_args!("cannot join the multicast group {group} on {source}")))?;
    let bound: SockaddrIn = getsockname(fd.as_raw_fd()).map_err(context("cannot read a socket's address"))?;
    Ok((fd, bound.into()))
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "a real socket")]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn drops_count_between_two_datagrams_that_came_with_the_counter() {
        let mut drops = Drops::default();
        drops.note(None, true);
        drops.note(Some(3), true);
        assert_eq!(drops.counted, 3);
        drops.note(Some(10), false);
        drops.note(Some(11), true);
        assert_eq!(drops.counted, 4, "what the filter refused is left out");
        drops.pass();
        drops.note(Some(500), true);
        assert_eq!(drops.counted, 4, "nobody knows when those were dropped, nor why");
        drops.note(Some(502), true);
        drops.note(None, true);
        assert_eq!(drops.counted, 6);
        let mut drops = Drops { seen: u32::MAX, ..Drops::default() };
        drops.note(Some(1), true);
        assert_eq!(drops.counted, 2, "the counter wraps");
    }

    /// The one at which a full buffer is noticed, and the one before it: what is between them counts.
    #[test]
    fn two_datagrams_before_a_look_at_the_buffer_come_with_the_counter() {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        for quarter in [1 << 10, 140_000, 1 << 20] {
            let (mut fullness, mut looks, mut near) = (Fullness::of(socket.as_fd()).unwrap(), 0, [true; 2]);
            fullness.quarter = quarter;
            let mut far = 0;
            for number in 0..20_000_usize {
                let len = [0, 64, 1400, DATAGRAM_MAX][number * number % 4] / (1 + number % 3);
                near = [near[1], fullness.is_near()];
                far += usize::from(!near[1]);
                assert!(!fullness.was_full(socket.as_fd(), len));
                if fullness.read == 0 {
                    looks += 1;
                    assert_eq!(near, [true; 2], "{quarter} {number}");
                }
            }
            assert!(looks > 10 && (far > 1000) == (quarter > 200_000), "{looks} {far}");
        }
    }
}
