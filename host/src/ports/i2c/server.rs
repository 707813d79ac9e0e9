//! The simulator's end of its bus: each client is a master. Transfers are served one after the other, in order of
//! arrival.

use super::socket::{listener, read, write};
use crate::ports::{Device, Lost, Received};
use base::i2c::{Transfer, codec};
use base::{Fault, Instant};
use module::{Input, OUTSTANDING, Output};
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use std::collections::VecDeque;
use std::fs;
use std::io::ErrorKind;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixListener;
use std::path::PathBuf;

/// Maximum number of masters: the driver and some tools.
const MASTERS: usize = 8;

/// Server of the simulated bus.
pub struct Server {
    path: PathBuf,
    open: Option<Open>,
    transfer: Option<Transfer>,
}

struct Open {
    listener: UnixListener,
    /// Inode of our socket file, in case another process replaced it.
    inode: u64,
    /// Readable if anything is to be served.
    all: Epoll,
    masters: Vec<Master>,
    number: u64,
    /// Index of the master to be served next.
    turn: usize,
    /// Masters that wait for an outcome, in order.
    waiting: VecDeque<u64>,
}

struct Master {
    number: u64,
    socket: OwnedFd,
}

impl Server {
    /// Creates the port of a bus offered at `path`.
    pub fn new(path: PathBuf) -> Self {
        Self { path, open: None, transfer: None }
    }
}

impl Open {
    fn accept(&mut self) -> Result<(), Lost> {
        loop {
            let socket = match self.listener.accept() {
                Ok((socket, _)) => OwnedFd::from(socket),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) if [ErrorKind::Interrupted, ErrorKind::ConnectionAborted].contains(&error.kind()) => {
                    continue;
                }
                Err(error) => return Err(error.to_string()),
            };
            // Excess masters are disconnected at once.
            if self.masters.len() < MASTERS {
                self.number += 1;
                self.all.add(&socket, EpollEvent::new(EpollFlags::EPOLLIN, self.number)).map_err(Errno::desc)?;
                self.masters.push(Master { number: self.number, socket });
            }
        }
    }

    /// Reads the next transfer, from each master in turn; an invalid one is an error, and its master is disconnected.
    fn next(&mut self) -> Option<Result<Transfer, &'static str>> {
        let mut look = self.masters.len();
        while look > 0 {
            look -= 1;
            self.turn = (self.turn + 1) % self.masters.len();
            let master = &self.masters[self.turn];
            if self.waiting.iter().filter(|number| **number == master.number).count() >= OUTSTANDING {
                continue;
            }
            match read(&master.socket) {
                Ok(None) => {}
                Ok(Some(datagram)) => match codec::parse_transfer(&datagram) {
                    Some(transfer) => {
                        self.waiting.push_back(master.number);
                        return Some(Ok(transfer));
                    }
                    None => {
                        self.masters.remove(self.turn);
                        return Some(Err("a master on its socket sent an invalid transfer and was disconnected"));
                    }
                },
                Err(_gone) => {
                    self.masters.remove(self.turn);
                    self.turn = 0;
                }
            }
        }
        None
    }

    fn answer(&mut self, datagram: &[u8]) {
        let Some(number) = self.waiting.pop_front() else { return };
        let place = self.masters.iter().position(|master| master.number == number);
        // A master that does not read its outcomes is disconnected.
        if let Some(place) = place.filter(|place| !matches!(write(&self.masters[*place].socket, datagram), Ok(true))) {
            self.masters.remove(place);
        }
    }
}

impl Device for Server {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let listener = UnixListener::from(listener(&self.path)?);
        let all = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(Errno::desc)?;
        all.add(&listener, EpollEvent::new(EpollFlags::EPOLLIN, 0)).map_err(Errno::desc)?;
        let inode = fs::metadata(&self.path).map_err(|error| format!("{}: {error}", self.path.display()))?.ino();
        let (masters, waiting) = (Vec::new(), VecDeque::new());
        self.open = Some(Open { listener, inode, all, masters, number: 0, turn: 0, waiting });
        Ok(())
    }

    fn close(&mut self) {
        if let Some(open) = self.open.take()
            && fs::metadata(&self.path).is_ok_and(|data| data.ino() == open.inode)
        {
            let _ = fs::remove_file(&self.path);
        }
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.open.as_ref().map(|open| open.all.0.as_fd())
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        let Some(open) = &mut self.open else { return Ok(Received::Nothing) };
        open.accept()?;
        match open.next() {
            None => Ok(Received::Nothing),
            Some(Err(why)) => Ok(Received::Fault(Fault::MessageMalformed, why.into())),
            Some(Ok(transfer)) => Ok(Received::input(now, Input::I2cRequested(self.transfer.insert(transfer)))),
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(open), Output::I2cAnswer(outcome)) = (&mut self.open, output) else { return Ok(false) };
        open.answer(&codec::outcome(outcome));
        Ok(true)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.close();
    }
}
