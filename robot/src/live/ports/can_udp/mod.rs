//! A CAN bus over UDP multicast: every frame a datagram to everyone, one's own included. What keeps busses apart is
//! the port. No order, no arbitration, no rate: not a model of CAN's timing.

pub mod codec;

use super::{Device, Lost, Received};
use crate::live::clock;
use base::{Fault, Instant};
use module::{Input, Output};
use nix::sys::socket::{AddressFamily, SockFlag, SockType, SockaddrIn, bind, setsockopt, socket, sockopt};
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

/// A burst of so many bytes of datagrams may wait in the kernel, if it allows.
const RECEIVE_BUFFER: usize = 1 << 20;

/// The bus.
pub struct CanUdp {
    bus: SocketAddrV4,
    sockets: Option<Sockets>,
    datagram: Vec<u8>,
}

struct Sockets {
    receiver: UdpSocket,
    /// Apart from the receiver, whose port it would share with everyone: by this one's address own frames are told.
    sender: UdpSocket,
    own: SocketAddr,
}

impl CanUdp {
    /// A bus at a multicast group and port.
    pub fn new(bus: SocketAddrV4) -> Self {
        Self { bus, sockets: None, datagram: Vec::new() }
    }
}

impl Sockets {
    fn open(bus: SocketAddrV4) -> io::Result<Self> {
        let sender = open_sender(bus)?;
        let own = sender.local_addr()?;
        let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
        let receiver = socket(AddressFamily::Inet, SockType::Datagram, flags, None)?;
        setsockopt(&receiver, sockopt::ReuseAddr, &true)?;
        setsockopt(&receiver, sockopt::ReusePort, &true)?;
        // What the kernel does not allow it cuts down.
        setsockopt(&receiver, sockopt::RcvBuf, &RECEIVE_BUFFER)?;
        bind_to(&receiver, bus)?;
        let receiver = UdpSocket::from(receiver);
        // As LCM does: the interface of the default route, and the loopback.
        let by_route = receiver.join_multicast_v4(bus.ip(), &Ipv4Addr::UNSPECIFIED);
        let on_lo = receiver.join_multicast_v4(bus.ip(), &Ipv4Addr::LOCALHOST);
        // Without a route both are the loopback, and the second join is refused.
        by_route.or(on_lo)?;
        Ok(Self { receiver, sender, own })
    }
}

fn bind_to(receiver: &impl std::os::fd::AsRawFd, bus: SocketAddrV4) -> io::Result<()> {
    Ok(bind(receiver.as_raw_fd(), &SockaddrIn::from(bus))?)
}

/// A sender on the interface that the routing table chooses; on the loopback where there is no route.
fn open_sender(bus: SocketAddrV4) -> io::Result<UdpSocket> {
    let connect = |from: Ipv4Addr| {
        let sender = UdpSocket::bind((from, 0))?;
        sender.set_multicast_ttl_v4(0)?;
        sender.set_multicast_loop_v4(true)?;
        sender.set_nonblocking(true)?;
        sender.connect(bus)?;
        Ok(sender)
    };
    // Linux sends multicast by the interface of the source address.
    connect(Ipv4Addr::UNSPECIFIED).or_else(|_: io::Error| connect(Ipv4Addr::LOCALHOST))
}

impl Device for CanUdp {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        self.sockets = Some(Sockets::open(self.bus).map_err(|error| format!("udp:{}: {error}", self.bus))?);
        Ok(())
    }

    fn close(&mut self) {
        self.sockets = None;
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.sockets.as_ref().map(|sockets| sockets.receiver.as_fd())
    }

    fn receive(&mut self, _now: Instant) -> Result<Received<'_>, Lost> {
        let Some(sockets) = &self.sockets else {
            return Ok(Received::Nothing);
        };
        // One byte more than any good one, to tell those that were cut off.
        let mut datagram = [0; codec::DATAGRAM_MAX + 1];
        loop {
            match sockets.receiver.recv_from(&mut datagram) {
                Ok((_, from)) if from == sockets.own => {}
                Ok((length, from)) => {
                    return Ok(match codec::decode(&datagram[..length]) {
                        Ok(frame) => Received::Input(Input::Can(frame)),
                        Err(why) => Received::Fault(
                            Fault::MessageMalformed,
                            format!("dropped a datagram from {from} that is no frame: {why}"),
                        ),
                    });
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    return Ok(Received::Nothing);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.to_string()),
            }
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(sockets), Output::Can(frame)) = (&self.sockets, output) else {
            return Ok(false);
        };
        codec::encode(frame, clock::wall() as f64 * 1e-9, &mut self.datagram);
        match sockets.sender.send(&self.datagram) {
            Ok(_) => Ok(true),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(false),
            // An old error, told late: of a listener that is gone, which multicast does not have.
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(false),
            Err(error) => Err(error.to_string()),
        }
    }
}
