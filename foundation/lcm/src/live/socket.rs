//! The two sockets, and which interfaces they use.
//!
//! `liblcm` sends on, and joins on, the one interface that the routing table has for the group, asked at the start
//! and, for sending, at every datagram. That breaks when a cable is pulled or the default route moves: what is sent
//! then leaves on an interface where nobody on this host has joined. So here
//!
//! - the receive socket joins on that interface and on `lo`;
//! - the send socket is bound to that interface's address, which pins it there, and joins there too, so that the
//!   kernel loops its datagrams back even if no other socket of this host did;
//! - without a route, at the start or later, the send socket is bound to 127.0.0.1 instead, which pins it to `lo`
//!   (Linux `ip_route_output_key_hash_rcu`: a multicast goes out where its source address lives).
//!
//! A datagram is sent on one interface and received on that one, so joining on two delivers nothing twice. What
//! others on this host joined on a third interface is heard as well (`IP_MULTICAST_ALL`, the kernel's default, needs
//! the receive socket bound to the group: it is): that is how `liblcm` peers hear what goes over `lo`.

use super::{RealtimeNanos, context};
use crate::url::Udpm;
use nix::cmsg_space;
use nix::errno::Errno;
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, IpMembershipRequest, MsgFlags, SockFlag, SockType, SockaddrIn, bind, connect,
    getsockname, getsockopt, recvmsg, sendmsg, setsockopt, socket, sockopt,
};
use nix::sys::time::{TimeSpec, TimeValLike};
use std::io::{self, IoSlice, IoSliceMut};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};

/// The send socket receives nothing that anybody wants; the kernel makes this its minimum.
const SEND_SOCKET_RECV_BUF: usize = 0;

fn open_socket() -> io::Result<OwnedFd> {
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    socket(AddressFamily::Inet, SockType::Datagram, flags, None).map_err(context("cannot open a UDP socket"))
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

#[derive(Debug)]
pub struct ReceiveSocket {
    fd: OwnedFd,
    address: SocketAddrV4,
    joined: bool,
    control: Vec<u8>,
    /// The kernel's counter as last seen, which wraps, and the same one widened.
    overflows: u32,
    dropped: u64,
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
        let control = cmsg_space!(TimeSpec, u32);
        Ok(Self { fd, address: url.address(), joined: false, control, overflows: 0, dropped: 0 })
    }

    /// Joins the group and begins to receive; does nothing when that is done. Can be tried again after an error.
    pub fn join(&mut self) -> io::Result<()> {
        if self.joined {
            return Ok(());
        }
        let group = *self.address.ip();
        let routed = join(&self.fd, group, Ipv4Addr::UNSPECIFIED);
        let loopback = join(&self.fd, group, Ipv4Addr::LOCALHOST);
        // No route: loopback alone. No loopback (a container without one): the route alone.
        routed
            .or(loopback)
            .map_err(context(format_args!("cannot join the multicast group {group} on any interface")))?;
        // To the group, not to any address: unicast to the port is none of the bus's.
        bind(self.fd.as_raw_fd(), &SockaddrIn::from(self.address))
            .map_err(context(format_args!("cannot bind to {}", self.address)))?;
        self.joined = true;
        Ok(())
    }

    /// The next datagram, if one waits.
    pub fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        let mut parts = [IoSliceMut::new(buffer)];
        let received = loop {
            let control = Some(&mut self.control[..]);
            match recvmsg::<SockaddrIn>(self.fd.as_raw_fd(), &mut parts, control, MsgFlags::MSG_DONTWAIT) {
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN) => return Ok(None),
                result => break result.map_err(context("cannot receive"))?,
            }
        };
        let (mut at, mut overflows) = (None, self.overflows);
        for message in received.cmsgs().map_err(context("cannot read the kernel's receive time"))? {
            match message {
                ControlMessageOwned::ScmTimestampns(time) => {
                    at = Some(RealtimeNanos(time.num_nanoseconds()));
                }
                ControlMessageOwned::RxqOvfl(count) => overflows = count,
                _ => {}
            }
        }
        let from = received.address.map_or(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0), SocketAddrV4::from);
        let at = at.ok_or_else(|| io::Error::other("the kernel gave no receive time"))?;
        let len = received.bytes;
        self.dropped += u64::from(overflows.wrapping_sub(self.overflows));
        self.overflows = overflows;
        Ok(Some(Arrival { from, len, at }))
    }

    /// Datagrams that found the receive buffer full.
    pub fn dropped(&self) -> u64 {
        self.dropped
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

#[derive(Debug)]
pub struct SendSocket {
    fd: OwnedFd,
    group: SockaddrIn,
    ttl: u8,
    source: Ipv4Addr,
}

impl SendSocket {
    pub fn open(url: &Udpm) -> io::Result<Self> {
        let source = route_to(url.address())?.unwrap_or(Ipv4Addr::LOCALHOST);
        let fd = open_sender(*url.address().ip(), url.ttl, source)?;
        Ok(Self { fd, group: url.address().into(), ttl: url.ttl, source })
    }

    /// Sends one datagram; when its interface has gone, from now on over `lo`, where all of ours listen.
    pub fn send(&mut self, header: &[u8], payload: &[u8]) -> nix::Result<()> {
        let parts = [IoSlice::new(header), IoSlice::new(payload)];
        match self.send_once(&parts) {
            // The interface is down, or has lost its address.
            Err(
                error @ (Errno::ENETUNREACH | Errno::EHOSTUNREACH | Errno::ENETDOWN | Errno::ENODEV | Errno::EINVAL),
            ) if !self.on_loopback() => {
                let fd = open_sender(self.group.ip(), self.ttl, Ipv4Addr::LOCALHOST).map_err(|_| error)?;
                (self.fd, self.source) = (fd, Ipv4Addr::LOCALHOST);
                self.send_once(&parts)
            }
            result => result,
        }
    }

    fn send_once(&self, parts: &[IoSlice<'_>]) -> nix::Result<()> {
        loop {
            match sendmsg(self.fd.as_raw_fd(), parts, &[], MsgFlags::MSG_DONTWAIT, Some(&self.group)) {
                Err(Errno::EINTR) => {}
                result => return result.map(drop),
            }
        }
    }

    pub fn on_loopback(&self) -> bool {
        self.source.is_loopback()
    }
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

fn open_sender(group: Ipv4Addr, ttl: u8, source: Ipv4Addr) -> io::Result<OwnedFd> {
    let fd = open_socket()?;
    setsockopt(&fd, sockopt::IpMulticastTtl, &ttl).map_err(context("cannot set IP_MULTICAST_TTL"))?;
    setsockopt(&fd, sockopt::IpMulticastLoop, &true).map_err(context("cannot set IP_MULTICAST_LOOP"))?;
    setsockopt(&fd, sockopt::RcvBuf, &SEND_SOCKET_RECV_BUF).map_err(context("cannot set SO_RCVBUF"))?;
    bind(fd.as_raw_fd(), &SockaddrIn::from(SocketAddrV4::new(source, 0)))
        .map_err(context(format_args!("cannot bind to {source}")))?;
    join(&fd, group, source).map_err(context(format_args!("cannot join the multicast group {group} on {source}")))?;
    Ok(fd)
}
