//! A CAN interface of the kernel (SocketCAN), by a raw socket.

use super::{Device, Lost, Received};
use crate::live::sys;
use base::can::{Frame, Id};
use base::{Fault, Instant};
use module::{Input, Output};
use nix::cmsg_space;
use nix::errno::Errno;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, getsockopt, recvmsg, setsockopt, sockopt};
use nix::unistd::write;
use std::io::{self, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::{fs, mem};

/// `struct can_frame`: identifier and flags, length, three bytes of padding, data.
const FRAME: usize = 16;
// linux/can.h
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;
// linux/can/error.h
const ERROR_CONTROLLER: u32 = 0x0004;
const ERROR_BUS_OFF: u32 = 0x0040;
const ERROR_RESTARTED: u32 = 0x0100;
/// The errors to be told of; single bus errors are the controller's affair.
const ERRORS: u32 = ERROR_CONTROLLER | ERROR_BUS_OFF | ERROR_RESTARTED;
const RX_OVERFLOW: u8 = 0x01;
const TX_OVERFLOW: u8 = 0x02;
const WARNING: u8 = 0x04 | 0x08;
const PASSIVE: u8 = 0x10 | 0x20;
const ACTIVE: u8 = 0x40;

/// So many bytes may wait in the kernel, if it allows: some thousand frames.
const RECEIVE_BUFFER: usize = 1 << 20;

/// The interface.
pub struct CanSocket {
    interface: String,
    socket: Option<OwnedFd>,
    control: Vec<u8>,
    /// The kernel's count of frames that found the receive buffer full, as the last frame brought it, and how many of
    /// them are not told yet.
    dropped: u32,
    untold: u32,
    /// A frame that came with such a count, and waits for it to be told.
    next: Option<[u8; FRAME]>,
}

impl CanSocket {
    /// A network interface, `can0`.
    pub fn new(interface: String) -> Self {
        Self { interface, socket: None, control: cmsg_space!(u32), dropped: 0, untold: 0, next: None }
    }

    fn lost(&self, errno: Errno) -> Lost {
        let interface = &self.interface;
        match errno {
            Errno::EAFNOSUPPORT => format!("{interface}: this kernel has no CAN"),
            Errno::ENODEV | Errno::ENXIO => format!("{interface}: there is no such interface"),
            Errno::ENETDOWN => format!("{interface}: the interface is down (ip link set {interface} up)"),
            errno => format!("{interface}: {}", errno.desc()),
        }
    }

    /// Whether what is sent now will leave now. An interface that is down takes a socket all the same, with an error
    /// pending; one that is bus-off takes frames and keeps them for later, or drops them without a word.
    fn check(&self, socket: &impl AsFd) -> Result<(), Lost> {
        match getsockopt(socket, sockopt::SocketError).map_err(|errno| self.lost(errno))? {
            0 => {}
            pending => return Err(self.lost(Errno::from_raw(pending))),
        }
        let interface = &self.interface;
        match fs::read(format!("/sys/class/net/{interface}/carrier")) {
            Ok(carrier) if carrier.starts_with(b"0") => {
                Err(format!("{interface}: no carrier: bus-off (ip link set {interface} type can restart)"))
            }
            // Where there is no sysfs it cannot be asked.
            _ => Ok(()),
        }
    }

    fn read(&mut self) -> Result<Option<[u8; FRAME]>, Lost> {
        let Some(socket) = &self.socket else {
            return Ok(None);
        };
        let mut raw = [0; FRAME];
        let mut parts = [IoSliceMut::new(&mut raw)];
        let message = loop {
            match recvmsg::<()>(socket.as_raw_fd(), &mut parts, Some(&mut self.control), MsgFlags::empty()) {
                Ok(message) => break message,
                Err(Errno::EAGAIN) => return Ok(None),
                Err(Errno::EINTR) => {}
                Err(errno) => return Err(self.lost(errno)),
            }
        };
        for control in message.cmsgs().map_err(Errno::desc)? {
            if let ControlMessageOwned::RxqOvfl(count) = control {
                self.untold = self.untold.saturating_add(count.wrapping_sub(mem::replace(&mut self.dropped, count)));
            }
        }
        match message.bytes {
            FRAME => Ok(Some(raw)),
            _ => Err(format!("{}: gives frames of a strange length", self.interface)),
        }
    }
}

impl Device for CanSocket {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let reason = |error: io::Error| match error.raw_os_error() {
            Some(errno) => self.lost(Errno::from_raw(errno)),
            None => format!("{}: {error}", self.interface),
        };
        let socket = sys::open_can(&self.interface, ERRORS).map_err(reason)?;
        self.check(&socket)?;
        setsockopt(&socket, sockopt::RxqOvfl, &1).map_err(|errno| self.lost(errno))?;
        // Privileged processes get what they ask for, the others what net.core.rmem_max allows.
        setsockopt(&socket, sockopt::RcvBufForce, &RECEIVE_BUFFER)
            .or_else(|_| setsockopt(&socket, sockopt::RcvBuf, &RECEIVE_BUFFER))
            .map_err(|errno| self.lost(errno))?;
        self.socket = Some(socket);
        Ok(())
    }

    fn close(&mut self) {
        (self.socket, self.dropped, self.untold, self.next) = (None, 0, 0, None);
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(AsFd::as_fd)
    }

    fn receive(&mut self, _now: Instant) -> Result<Received<'_>, Lost> {
        let raw = match self.next.take() {
            Some(raw) => raw,
            None => match self.read()? {
                Some(raw) => raw,
                None => return Ok(Received::Nothing),
            },
        };
        match mem::take(&mut self.untold) {
            0 => received(&raw).map_err(|why| format!("{}: {why}", self.interface)),
            count => {
                self.next = Some(raw);
                let what = format!("{}: the receive buffer ran over: {count} frames are lost", self.interface);
                Ok(Received::Fault(Fault::PortOverrun, what))
            }
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(socket), Output::Can(frame)) = (&self.socket, output) else {
            return Ok(false);
        };
        match write(socket, &encode(frame)) {
            Ok(_) => Ok(true),
            // A full queue: what cannot leave now would be old when it could.
            Err(Errno::EAGAIN | Errno::ENOBUFS | Errno::EINTR) => Ok(false),
            Err(errno) => Err(self.lost(errno)),
        }
    }
}

fn encode(frame: &Frame) -> [u8; FRAME] {
    let id = match frame.id() {
        Id::Standard(id) => u32::from(id),
        Id::Extended(id) => id | EXTENDED,
    };
    let id = if frame.is_remote() { id | REMOTE } else { id };
    let mut raw = [0; FRAME];
    raw[..4].copy_from_slice(&id.to_ne_bytes());
    raw[4] = frame.dlc();
    raw[8..8 + frame.data().len()].copy_from_slice(frame.data());
    raw
}

fn received(raw: &[u8; FRAME]) -> Result<Received<'static>, Lost> {
    let flags = u32::from_ne_bytes([raw[0], raw[1], raw[2], raw[3]]);
    if flags & ERROR != 0 {
        return error(flags, raw[9]);
    }
    let id = match flags & EXTENDED {
        0 => Id::Standard((flags & 0x7FF) as u16),
        _ => Id::Extended(flags & 0x1FFF_FFFF),
    };
    let length = raw[4].min(8);
    let frame = match flags & REMOTE {
        0 => Frame::new(id, &raw[8..8 + usize::from(length)]),
        _ => Frame::remote(id, length),
    };
    // In range by the masks above.
    Ok(frame.map_or(Received::Nothing, |frame| Received::Input(Input::Can(frame))))
}

/// An error frame of the kernel: its class, and the controller's state (byte 1 of its data).
fn error(class: u32, controller: u8) -> Result<Received<'static>, Lost> {
    if class & ERROR_BUS_OFF != 0 {
        // Opened anew when the controller is on the bus again; till then nothing is sent that would be old then.
        return Err("bus-off".into());
    }
    let overflow = |side: &str| Received::Fault(Fault::PortOverrun, format!("the controller's {side} buffer ran over"));
    let note = |text: &str| Received::Note(text.into());
    Ok(match controller {
        _ if class & ERROR_RESTARTED != 0 => note("the controller was restarted"),
        bits if bits & RX_OVERFLOW != 0 => overflow("receive"),
        bits if bits & TX_OVERFLOW != 0 => overflow("transmit"),
        bits if bits & PASSIVE != 0 => note("the controller is error-passive"),
        bits if bits & WARNING != 0 => note("the controller has many errors (warning level)"),
        bits if bits & ACTIVE != 0 => note("the controller is error-active again"),
        _ => note("the controller's state is not specified"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{Ipv4Addr, UdpSocket};

    #[test]
    fn frames_survive_the_kernel_s_layout() {
        let frames = [
            Frame::standard(0x181, &[1, 2, 3]),
            Frame::remote(Id::Standard(0x701), 1).unwrap(),
            Frame::new(Id::Extended(0x1FFF_FFFF), &[0xFF; 8]).unwrap(),
        ];
        for frame in frames {
            let Ok(Received::Input(Input::Can(back))) = received(&encode(&frame)) else { panic!("{frame:?}") };
            assert_eq!(back, frame);
        }
    }

    #[test]
    fn bus_off_loses_the_port_and_other_errors_do_not() {
        assert!(error(ERROR | ERROR_BUS_OFF, 0).is_err());
        let Ok(Received::Note(text)) = error(ERROR | ERROR_CONTROLLER, 0x20) else { panic!() };
        assert_eq!(text, "the controller is error-passive");
        let Ok(Received::Fault(Fault::PortOverrun, _)) = error(ERROR | ERROR_CONTROLLER, 1) else { panic!() };
    }

    /// The interface with one end of a UDP connection for its socket, which counts what it loses as CAN's does.
    fn connected() -> (CanSocket, UdpSocket) {
        let [ours, peer] = [(); 2].map(|()| UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap());
        ours.connect(peer.local_addr().unwrap()).unwrap();
        peer.connect(ours.local_addr().unwrap()).unwrap();
        ours.set_nonblocking(true).unwrap();
        setsockopt(&ours, sockopt::RxqOvfl, &1).unwrap();
        setsockopt(&ours, sockopt::RcvBuf, &0).unwrap();
        let mut port = CanSocket::new("lo".into());
        port.socket = Some(ours.into());
        (port, peer)
    }

    #[test]
    fn frames_that_found_the_buffer_full_are_counted_and_the_others_come_in_order() {
        const SENT: u32 = 1000;
        let (mut port, peer) = connected();
        let send = |id: u32| peer.send(&encode(&Frame::standard(id as u16, &[0; 8]))).unwrap();
        (0..SENT).for_each(|id| assert_eq!(send(id), FRAME));
        let (mut got, mut lost) = (Vec::new(), Vec::new());
        let mut drain = |port: &mut CanSocket| loop {
            match port.receive(Instant::ZERO).unwrap() {
                Received::Nothing => break,
                Received::Input(Input::Can(frame)) => got.push(frame.id()),
                Received::Fault(Fault::PortOverrun, why) => lost.push(why),
                _ => panic!(),
            }
        };
        drain(&mut port);
        // Those lost since the last one that came are told with the next.
        send(SENT);
        drain(&mut port);
        let count = SENT as usize + 1 - got.len();
        assert!(count > 0 && got.is_sorted(), "{got:?}");
        assert_eq!(lost, [format!("lo: the receive buffer ran over: {count} frames are lost")]);
        assert_eq!(got.last(), Some(&Id::Standard(SENT as u16)));
    }

    #[test]
    fn a_socket_with_an_error_pending_is_not_up() {
        let (port, peer) = connected();
        let socket = port.socket.as_ref().unwrap();
        assert_eq!(port.check(socket), Ok(()));
        drop(peer);
        write(socket, b"to nobody").unwrap();
        assert_eq!(port.check(socket), Err(format!("lo: {}", Errno::ECONNREFUSED.desc())));
        assert_eq!(port.check(socket), Ok(()), "told once");
    }

    #[test]
    fn a_frame_of_a_strange_length_loses_the_port() {
        let (mut port, peer) = connected();
        peer.send(&[0; FRAME - 1]).unwrap();
        assert_eq!(port.receive(Instant::ZERO).err().unwrap(), "lo: gives frames of a strange length");
    }

    #[test]
    fn an_interface_that_is_not_there_is_one_clear_line() {
        let reason = CanSocket::new("can_not_here".into()).open().unwrap_err();
        assert!(reason.starts_with("can_not_here: ") && !reason.contains('\n'), "{reason}");
    }
}
