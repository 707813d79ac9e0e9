//! The simulator's output: two sockets in the run folder, one of each end, and a datagram of one byte for each signal.

use crate::ports::{Device, Lost, Received};
use base::gpio::Signal;
use base::{Fault, Instant};
use module::{Input, Output};
use std::ffi::OsString;
use std::fs;
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;

/// One end.
pub struct Socket {
    own: PathBuf,
    peer: PathBuf,
    simulated: bool,
    socket: Option<UnixDatagram>,
}

impl Socket {
    /// Creates the port of the output at `path`; `simulated`: the simulator's end.
    pub fn new(path: PathBuf, simulated: bool) -> Self {
        let mut owner = OsString::from(&path);
        owner.push(".owner");
        let (own, peer) = if simulated { (path, owner.into()) } else { (owner.into(), path) };
        Self { own, peer, simulated, socket: None }
    }

    fn bind(&self) -> io::Result<UnixDatagram> {
        // Left over by a process that was killed.
        let _ = fs::remove_file(&self.own);
        let socket = UnixDatagram::bind(&self.own)?;
        socket.set_nonblocking(true)?;
        Ok(socket)
    }
}

impl Device for Socket {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        self.socket = Some(self.bind().map_err(|error| format!("{}: {error}", self.own.display()))?);
        Ok(())
    }

    fn close(&mut self) {
        if self.socket.take().is_some() {
            let _ = fs::remove_file(&self.own);
        }
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(AsFd::as_fd)
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        let Some(socket) = &self.socket else { return Ok(Received::Nothing) };
        let mut byte = [0];
        match socket.recv(&mut byte) {
            Ok(_) => Ok(match Signal::from_byte(byte[0]) {
                Some(signal) => Received::input(now, Input::Gpio(signal)),
                None => Received::Fault(Fault::MessageMalformed, "its socket received an invalid signal".into()),
            }),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(Received::Nothing),
            Err(error) => Err(error.to_string()),
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(socket), Output::Gpio(signal)) = (&self.socket, output) else { return Ok(false) };
        match socket.send_to(&[signal.to_byte()], &self.peer) {
            Ok(_) => Ok(true),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(false),
            // The owner has ended; another one will ask again.
            Err(_) if self.simulated => Ok(true),
            Err(error) => Err(format!("{}: {error}", self.peer.display())),
        }
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        self.close();
    }
}
