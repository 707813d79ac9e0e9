//! A CAN interface of the kernel (SocketCAN), by a raw socket.

use super::{Device, Lost, Received};
use crate::live::sys;
use base::can::{Frame, Id};
use base::{Fault, Instant};
use module::{Input, Output};
use nix::errno::Errno;
use nix::unistd::{read, write};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

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

/// The interface.
pub struct CanSocket {
    interface: String,
    socket: Option<OwnedFd>,
}

impl CanSocket {
    /// A network interface, `can0`.
    pub fn new(interface: String) -> Self {
        Self { interface, socket: None }
    }
}

impl Device for CanSocket {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let reason = |error: io::Error| match error.raw_os_error().map(Errno::from_raw) {
            Some(Errno::EAFNOSUPPORT) => format!("{}: this kernel has no CAN", self.interface),
            Some(Errno::ENODEV) => format!("{}: there is no such interface", self.interface),
            _ => format!("{}: {error}", self.interface),
        };
        self.socket = Some(sys::open_can(&self.interface, ERRORS).map_err(reason)?);
        Ok(())
    }

    fn close(&mut self) {
        self.socket = None;
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(AsFd::as_fd)
    }

    fn receive(&mut self, _now: Instant) -> Result<Received<'_>, Lost> {
        let Some(socket) = &self.socket else {
            return Ok(Received::Nothing);
        };
        let mut raw = [0; FRAME];
        loop {
            match read(socket, &mut raw) {
                Ok(FRAME) => return received(&raw),
                Ok(_) => return Err("the interface gives frames of a strange length".into()),
                Err(Errno::EAGAIN) => return Ok(Received::Nothing),
                Err(Errno::EINTR) => {}
                Err(errno) => return Err(errno.desc().into()),
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
            Err(errno) => Err(errno.desc().into()),
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
        // Opened anew, and so without the frames that waited.
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

    #[test]
    fn an_interface_that_is_not_there_is_one_clear_line() {
        let reason = CanSocket::new("can_not_here".into()).open().unwrap_err();
        assert!(reason.starts_with("can_not_here: ") && !reason.contains('\n'), "{reason}");
    }
}
