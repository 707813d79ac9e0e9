//! Live probes of the bus: datagrams with TTL 0 that are sent and received on this host.

use super::network::{self, Interface};
use lcm::live::Lcm;
use lcm::url::{Udpm, Url};
use nix::cmsg_space;
use nix::errno::Errno;
use nix::libc::in_pktinfo;
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, IpMembershipRequest, MsgFlags, SockFlag, SockType, SockaddrIn, bind,
    getsockopt, recvmsg, sendto, setsockopt, socket, sockopt,
};
use std::io::IoSliceMut;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::time::{Duration, Instant};

/// Time limit of a datagram from a socket to another one of the same host. Only a failing probe waits this long.
const PATIENCE: Duration = Duration::from_millis(500);
/// Maximum number of datagrams that are counted out.
const SHOTS: u32 = 16;

/// A datagram's way from a sender to a receiver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trip {
    /// `on eth0`.
    pub way: String,
    /// Interface of reception, by index, and the delay; or the error.
    pub heard: Result<(u32, Duration), String>,
}

/// A socket bound to the bus that has joined on each of `on`.
struct Ear {
    fd: OwnedFd,
}

/// Names the failed call in its error.
fn named(what: &'static str) -> impl Fn(Errno) -> String {
    move |errno| format!("{what}: {}", errno.desc())
}

fn open() -> Result<OwnedFd, String> {
    socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None).map_err(named("socket"))
}

impl Ear {
    fn open(bus: SocketAddrV4, on: &[Ipv4Addr]) -> Result<Self, String> {
        let fd = open()?;
        setsockopt(&fd, sockopt::ReuseAddr, &true).map_err(named("SO_REUSEADDR"))?;
        setsockopt(&fd, sockopt::Ipv4PacketInfo, &true).map_err(named("IP_PKTINFO"))?;
        bind(fd.as_raw_fd(), &SockaddrIn::from(bus)).map_err(named("bind"))?;
        for address in on {
            join(&fd, *bus.ip(), *address)?;
        }
        Ok(Self { fd })
    }

    /// Waits for a datagram with `text`; returns the interface of its reception.
    fn hear(&self, text: &[u8]) -> Result<(u32, Duration), String> {
        let start = Instant::now();
        while let Some(left) = PATIENCE.checked_sub(start.elapsed()) {
            if !wait(&self.fd, left)? {
                break;
            }
            let (mut buffer, mut control) = ([0; 128], cmsg_space!(in_pktinfo));
            let mut parts = [IoSliceMut::new(&mut buffer)];
            let flags = MsgFlags::MSG_DONTWAIT;
            let message = recvmsg::<SockaddrIn>(self.fd.as_raw_fd(), &mut parts, Some(&mut control), flags);
            let message = message.map_err(named("recvmsg"))?;
            let by = message.cmsgs().into_iter().flatten().find_map(|message| match message {
                ControlMessageOwned::Ipv4PacketInfo(info) => u32::try_from(info.ipi_ifindex).ok(),
                _ => None,
            });
            let len = message.bytes;
            if buffer[..len] == *text {
                return Ok((by.unwrap_or(0), start.elapsed()));
            }
        }
        Err("not heard".into())
    }
}

fn join(fd: &OwnedFd, group: Ipv4Addr, on: Ipv4Addr) -> Result<(), String> {
    match setsockopt(fd, sockopt::IpAddMembership, &IpMembershipRequest::new(group, Some(on))) {
        Err(Errno::EADDRINUSE) => Ok(()),
        result => result.map_err(named("cannot join the group")),
    }
}

fn wait(fd: &OwnedFd, left: Duration) -> Result<bool, String> {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    let left = PollTimeout::from(left.as_millis() as u16 + 1);
    match poll(&mut [PollFd::new(fd.as_fd(), PollFlags::POLLIN)], left) {
        Ok(ready) => Ok(ready > 0),
        Err(Errno::EINTR) => Ok(true),
        Err(errno) => Err(named("poll")(errno)),
    }
}

/// A sender with TTL 0 that has joined where it sends, as every LCM context has. 0.0.0.0: where the route leads.
fn mouth(group: Ipv4Addr, on: Ipv4Addr) -> Result<OwnedFd, String> {
    let fd = open()?;
    setsockopt(&fd, sockopt::IpMulticastTtl, &0).map_err(named("IP_MULTICAST_TTL"))?;
    if !on.is_unspecified() {
        bind(fd.as_raw_fd(), &SockaddrIn::from(SocketAddrV4::new(on, 0))).map_err(named("bind"))?;
    }
    join(&fd, group, on)?;
    Ok(fd)
}

fn say(fd: &OwnedFd, bus: SocketAddrV4, what: &[u8]) -> Result<(), String> {
    sendto(fd.as_raw_fd(), what, &SockaddrIn::from(bus), MsgFlags::MSG_DONTWAIT).map(drop).map_err(named("sendto"))
}

/// A bus without other users: the given group, a free port.
pub fn free_bus(group: Ipv4Addr) -> Result<SocketAddrV4, String> {
    let port = std::net::UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).and_then(|socket| socket.local_addr());
    port.map(|address| SocketAddrV4::new(group, address.port())).map_err(|error| format!("UDP socket: {error}"))
}

/// The interface that the routing table has for the group, which the official LCM uses; none where there is no route.
///
/// The source address of a connected socket tells it, except on a route over `lo` that names no source.
pub fn route<'a>(
    bus: SocketAddrV4,
    with: impl Fn(Ipv4Addr) -> Option<&'a Interface>,
    lo: Option<&'a Interface>,
) -> Option<&'a Interface> {
    match network::source_towards(bus).ok()? {
        Ipv4Addr::UNSPECIFIED => lo,
        source => with(source),
    }
}

/// Sends from a socket that joined `from`, listens on one that joined `to`.
pub fn trip(way: String, bus: SocketAddrV4, from: Ipv4Addr, to: &[Ipv4Addr]) -> Trip {
    let text = format!("advee doctor {} {way}", std::process::id());
    let heard = Ear::open(bus, to).and_then(|ear| {
        let mouth = mouth(*bus.ip(), from)?;
        say(&mouth, bus, text.as_bytes())?;
        ear.hear(text.as_bytes())
    });
    Trip { way, heard }
}

/// Time that a hub takes to accept us.
pub fn connect(hub: SocketAddrV4) -> Result<Duration, String> {
    let start = Instant::now();
    let connected = std::net::TcpStream::connect_timeout(&hub.into(), 4 * PATIENCE);
    connected.map(|_| start.elapsed()).map_err(|error| error.to_string())
}

/// The channel and payload of LCM's own self test, which every program that joins sends (facts/lcm.md A1).
const SELF_TEST: (&str, &[u8]) = ("LCM_SELF_TEST", b"lcm self test");

/// The configured bus, joined as every module joins it: the self test there and back, and the receive buffer that the
/// kernel granted, in bytes.
pub fn join_bus(url: &Udpm) -> Result<(Duration, usize), String> {
    let named = |error: &dyn std::fmt::Display| error.to_string();
    let url = Url::from(Udpm { ttl: 0, ..url.clone() });
    let mut lcm = Lcm::new(&url).map_err(|error| named(&error))?;
    lcm.subscribe(SELF_TEST.0).map_err(|error| named(&error))?;
    let granted = lcm.udpm().map(lcm::live::Udpm::granted_recv_buf_size);
    let granted = granted.unwrap_or(Ok(0)).map_err(|error| named(&error))?;
    let start = Instant::now();
    lcm.publish(SELF_TEST.0, SELF_TEST.1).map_err(|error| named(&error))?;
    while let Some(left) = PATIENCE.checked_sub(start.elapsed()) {
        lcm.wait(left).map_err(|error| named(&error))?;
        while let Some(received) = lcm.recv().map_err(|error| named(&error))? {
            if (received.channel, received.payload) == SELF_TEST {
                return Ok((start.elapsed(), granted));
            }
        }
    }
    Err("the self test is not heard".into())
}

/// Number of datagrams that left, by the kernel's count of multicast datagrams handed to an interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outgoing {
    /// TTL of the sending socket.
    pub ttl: u8,
    pub sent: u32,
    /// At most; others on this host send, too.
    pub left: u64,
}

/// Sends with TTL 0 and counts what leaves; the best of some tries, as the count is the whole host's.
pub fn outgoing(bus: SocketAddrV4, on: Ipv4Addr) -> Result<Outgoing, String> {
    const TRIES: u32 = 5;
    let count = || {
        network::counter("/proc/net/netstat", "IpExt", "OutMcastPkts")
            .ok_or_else(|| "the kernel does not count multicast datagrams".to_string())
    };
    let mouth = mouth(*bus.ip(), on)?;
    let ttl = getsockopt(&mouth, sockopt::IpMulticastTtl).map_err(named("IP_MULTICAST_TTL"))?;
    let mut least = u64::MAX;
    for _ in 0..TRIES {
        let before = count()?;
        for _ in 0..SHOTS {
            say(&mouth, bus, b"advee doctor")?;
        }
        least = least.min(count()? - before);
        if least == 0 {
            break;
        }
    }
    Ok(Outgoing { ttl, sent: SHOTS, left: least })
}

/// Cost of a datagram of `len` bytes in a receive buffer on this way, bytes: the kernel includes its own structures
/// and, where the interface's MTU is small, every fragment's.
pub fn buffer_taken(bus: SocketAddrV4, on: Ipv4Addr, len: usize) -> Result<u64, String> {
    let ear = Ear::open(bus, &[on])?;
    let mouth = mouth(*bus.ip(), on)?;
    say(&mouth, bus, &vec![0; len])?;
    if !wait(&ear.fd, PATIENCE)? {
        return Err("not heard".into());
    }
    let inode = nix::sys::stat::fstat(&ear.fd).map_err(named("fstat"))?.st_ino;
    let socket = network::udp_sockets().into_iter().find(|socket| socket.inode as nix::libc::ino_t == inode);
    socket.map(|socket| socket.queued).ok_or_else(|| "the socket is not in /proc/net/udp".into())
}

/// The address to send from on an interface.
pub fn address(interface: &Interface) -> Option<Ipv4Addr> {
    interface.addresses.first().copied()
}
