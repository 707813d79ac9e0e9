//! A CAN bus over UDP multicast: every frame is a datagram to all nodes, including the sender. Buses are separated by
//! port. Frames from other computers are dropped by a socket filter, without which the port is not opened. It does not
//! model CAN's timing: it has no order, arbitration or bit rate.

pub mod codec;

use super::{Device, Lost, Received};
use crate::clock;
use base::can::{Frame, Notice};
use base::{Fault, Instant};
use lcm::live::Fullness;
use module::{Input, Output};
use nix::cmsg_space;
use nix::errno::Errno;
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, MsgFlags, SockFlag, SockType, SockaddrIn, bind, recvmsg, setsockopt, socket,
    sockopt,
};
use nix::sys::time::TimeSpec;
use std::io::{self, ErrorKind, IoSliceMut};
use std::mem;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};

/// Receive buffer for a burst of datagrams, bytes, if the kernel permits.
const RECEIVE_BUFFER: usize = 1 << 20;

/// CAN bus on a multicast group.
pub struct CanUdp {
    bus: SocketAddrV4,
    sockets: Option<Sockets>,
    datagram: Vec<u8>,
    control: Vec<u8>,
    /// The kernel's count of datagrams lost to a full receive buffer as of the last one, and the numbers not reported
    /// yet: as a fault of the host, and as a notice for the module.
    dropped: u32,
    untold: (u32, u32),
    /// Datagram received with such a count, delivered after the report.
    next: Option<Datagram>,
}

/// A datagram of another node.
struct Datagram {
    /// The frame, or the reason why it is invalid.
    frame: Result<Frame, String>,
    at: Instant,
    stamp: Option<u64>,
}

struct Sockets {
    receiver: UdpSocket,
    fullness: Fullness,
    /// Separate from the receiver, whose port all nodes share: own frames are recognized by this socket's address.
    sender: UdpSocket,
    own: SocketAddrV4,
}

impl CanUdp {
    /// Creates the port of a bus at a multicast group and port.
    pub fn new(bus: SocketAddrV4) -> Self {
        Self {
            bus,
            sockets: None,
            datagram: Vec::new(),
            control: cmsg_space!(u32, TimeSpec),
            dropped: 0,
            untold: (0, 0),
            next: None,
        }
    }

    /// Reads until a datagram of another node arrives.
    fn read(&mut self, now: Instant) -> Result<Option<Datagram>, Lost> {
        let Some(sockets) = &mut self.sockets else {
            return Ok(None);
        };
        // One byte more than any valid one, to detect truncation.
        let mut datagram = [0; codec::DATAGRAM_MAX + 1];
        loop {
            let mut parts = [IoSliceMut::new(&mut datagram)];
            let fd = sockets.receiver.as_raw_fd();
            let message = match recvmsg::<SockaddrIn>(fd, &mut parts, Some(&mut self.control), MsgFlags::empty()) {
                Ok(message) => message,
                Err(Errno::EAGAIN) => {
                    sockets.fullness.empty();
                    return Ok(None);
                }
                Err(Errno::EINTR) => continue,
                Err(errno) => return Err(errno.desc().into()),
            };
            // What the filter refuses counts as dropped, too.
            let was_full = sockets.fullness.was_full(sockets.receiver.as_fd(), message.bytes);
            let mut stamp = None;
            for control in message.cmsgs().map_err(Errno::desc)? {
                match control {
                    ControlMessageOwned::RxqOvfl(count) => {
                        let new = count.wrapping_sub(mem::replace(&mut self.dropped, count));
                        let more = if was_full { new } else { 0 };
                        self.untold = (self.untold.0.saturating_add(more), self.untold.1.saturating_add(more));
                    }
                    ControlMessageOwned::ScmTimestampns(time) => {
                        stamp = Some(time.tv_sec() as u64 * 1_000_000_000 + time.tv_nsec() as u64);
                    }
                    _ => {}
                }
            }
            let from = message.address.map(SocketAddrV4::from);
            let length = message.bytes;
            if from != Some(sockets.own) {
                let whom = from.map_or("nobody".into(), |from| from.to_string());
                let refused = |why| format!("dropped a datagram from {whom} that is not a frame: {why}");
                let frame = codec::decode(&datagram[..length]).map_err(refused);
                let at = stamp.map_or(now, |stamp| clock::received(now, stamp));
                return Ok(Some(Datagram { frame, at, stamp }));
            }
        }
    }
}

impl Sockets {
    fn open(bus: SocketAddrV4) -> io::Result<Self> {
        let sender = open_sender(bus)?;
        let SocketAddr::V4(own) = sender.local_addr()? else { return Err(ErrorKind::Unsupported.into()) };
        let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
        let receiver = socket(AddressFamily::Inet, SockType::Datagram, flags, None)?;
        setsockopt(&receiver, sockopt::ReuseAddr, &true)?;
        setsockopt(&receiver, sockopt::ReusePort, &true)?;
        // Privileged processes get the requested size, others at most net.core.rmem_max.
        setsockopt(&receiver, sockopt::RcvBufForce, &RECEIVE_BUFFER)
            .or_else(|_| setsockopt(&receiver, sockopt::RcvBuf, &RECEIVE_BUFFER))?;
        setsockopt(&receiver, sockopt::RxqOvfl, &1)?;
        setsockopt(&receiver, sockopt::ReceiveTimestampns, &true)?;
        // The bus belongs to this computer alone: nothing leaves (TTL 0), and from the first moment nothing enters.
        lcm::live::keep_local(receiver.as_fd())?;
        bind_to(&receiver, bus)?;
        let receiver = UdpSocket::from(receiver);
        // The sender's interface: frames arrive, and the kernel honours a TTL of 0 only where a socket has joined.
        receiver.join_multicast_v4(bus.ip(), own.ip())?;
        // As LCM does, for other programs: the interface to which multicast is routed, and the loopback. Most often one
        // of them is joined already, and there may be no such route.
        for interface in [Ipv4Addr::UNSPECIFIED, Ipv4Addr::LOCALHOST] {
            let _ = receiver.join_multicast_v4(bus.ip(), &interface);
        }
        let fullness = Fullness::of(receiver.as_fd())?;
        Ok(Self { receiver, fullness, sender, own })
    }
}

fn bind_to(receiver: &impl std::os::fd::AsRawFd, bus: SocketAddrV4) -> io::Result<()> {
    Ok(bind(receiver.as_raw_fd(), &SockaddrIn::from(bus))?)
}

/// Opens a sender on the interface that the routing table selects; on the loopback if there is no route.
fn open_sender(bus: SocketAddrV4) -> io::Result<UdpSocket> {
    let connect = |from: Ipv4Addr| {
        let sender = UdpSocket::bind((from, 0))?;
        sender.set_multicast_ttl_v4(0)?;
        sender.set_multicast_loop_v4(true)?;
        sender.set_nonblocking(true)?;
        sender.connect(bus)?;
        Ok(sender)
    };
    // Linux sends multicast on the interface of the source address.
    connect(Ipv4Addr::UNSPECIFIED).or_else(|_: io::Error| connect(Ipv4Addr::LOCALHOST))
}

impl Device for CanUdp {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        self.sockets = Some(Sockets::open(self.bus).map_err(|error| format!("udp:{}: {error}", self.bus))?);
        Ok(())
    }

    fn close(&mut self) {
        (self.sockets, self.dropped, self.untold, self.next) = (None, 0, (0, 0), None);
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.sockets.as_ref().map(|sockets| sockets.receiver.as_fd())
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        if self.next.is_none() {
            self.next = self.read(now)?;
        }
        match &mut self.untold {
            (0, 0) => {}
            (0, news) => return Ok(Received::input(now, Input::CanNotice(Notice::Lost(mem::take(news))))),
            (fault, _) => {
                let what = format!("the receive buffer overflowed: {} frames are lost", mem::take(fault));
                return Ok(Received::Fault(Fault::PortOverrun, what));
            }
        }
        Ok(match self.next.take() {
            None => Received::Nothing,
            Some(Datagram { frame: Ok(frame), at, stamp }) => {
                Received::Input { input: Input::Can { frame, at }, at, stamp }
            }
            Some(Datagram { frame: Err(why), .. }) => Received::Fault(Fault::MessageMalformed, why),
        })
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(sockets), Output::Can(frame)) = (&self.sockets, output) else {
            return Ok(false);
        };
        codec::encode(frame, clock::wall() as f64 * 1e-9, &mut self.datagram);
        match sockets.sender.send(&self.datagram) {
            Ok(_) => Ok(true),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(false),
            // A delayed error about a listener that is gone, which does not apply to multicast.
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(false),
            Err(error) => Err(error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datagrams_that_found_the_buffer_full_are_counted() {
        let port = 20_000 + (std::process::id() % 20_000) as u16;
        let bus = SocketAddrV4::new(Ipv4Addr::new(239, 68, 77, 78), port);
        let [mut left, mut right] = [(); 2].map(|()| CanUdp::new(bus));
        left.open().unwrap();
        right.open().unwrap();
        let sockets = right.sockets.as_mut().unwrap();
        setsockopt(&sockets.receiver, sockopt::RcvBuf, &8192).unwrap();
        sockets.fullness = Fullness::of(sockets.receiver.as_fd()).unwrap();
        let send = |left: &mut CanUdp, n: u16| {
            let frame = Output::Can(Frame::standard(n, &[1]));
            assert_eq!(left.send(Instant::ZERO, &frame), Ok(true));
        };
        for n in 0..200 {
            send(&mut left, n);
        }
        let (mut got, mut lost, mut told) = (0, Vec::new(), 0);
        let mut drain = |right: &mut CanUdp| loop {
            match right.receive(clock::now()).unwrap() {
                Received::Input { input: Input::Can { .. }, .. } => got += 1,
                Received::Input { input: Input::CanNotice(Notice::Lost(count)), .. } => told += count,
                Received::Fault(Fault::PortOverrun, why) => lost.push(why),
                Received::Nothing => break,
                _ => panic!(),
            }
        };
        drain(&mut right);
        // Losses are reported together with the next frame.
        send(&mut left, 200);
        drain(&mut right);
        assert!(got < 201 && got + told == 201, "{got} {told}");
        assert_eq!(lost, [format!("the receive buffer overflowed: {told} frames are lost")]);
        // Own frames come back and are ignored.
        assert!(matches!(left.receive(clock::now()), Ok(Received::Nothing)));
    }
}
