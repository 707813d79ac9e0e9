//! The simulator's end: one connection at a time; a new one takes the place of the one before.

use super::Stream;
use crate::ports::{Device, Lost, Received};
use base::Instant;
use module::{Input, Output};
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener};
use std::os::fd::{AsFd, BorrowedFd};

/// A listener and its connection.
pub struct Server {
    address: SocketAddr,
    open: Option<Open>,
}

struct Open {
    listener: TcpListener,
    /// Readable if the listener or the connection is.
    all: Epoll,
    stream: Option<Stream>,
}

impl Server {
    /// Creates a port that is closed.
    pub fn new(address: SocketAddr) -> Self {
        Self { address, open: None }
    }

    /// Address at which it listens, while open.
    #[cfg(test)]
    pub fn listens(&self) -> Option<SocketAddr> {
        self.open.as_ref()?.listener.local_addr().ok()
    }

    /// True while there is a connection.
    #[cfg(test)]
    pub fn is_connected(&self) -> bool {
        self.open.as_ref().is_some_and(|open| open.stream.is_some())
    }
}

impl Open {
    fn new(address: SocketAddr) -> Result<Self, Lost> {
        let listener = TcpListener::bind(address).map_err(|error| error.to_string())?;
        listener.set_nonblocking(true).map_err(|error| error.to_string())?;
        let all = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(Errno::desc)?;
        all.add(&listener, EpollEvent::new(EpollFlags::EPOLLIN, 0)).map_err(Errno::desc)?;
        Ok(Self { listener, all, stream: None })
    }

    fn accept(&mut self) -> Result<(), Lost> {
        loop {
            match self.listener.accept() {
                Ok((socket, _)) => {
                    let stream = Stream::new(socket)?;
                    let event = EpollEvent::new(EpollFlags::EPOLLIN, 1);
                    self.all.add(&stream.socket, event).map_err(Errno::desc)?;
                    self.stream = Some(stream);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) if [ErrorKind::Interrupted, ErrorKind::ConnectionAborted].contains(&error.kind()) => {}
                Err(error) => return Err(error.to_string()),
            }
        }
    }

    fn on_stream<T>(&mut self, work: impl FnOnce(&mut Stream) -> Result<T, Lost>) -> Option<T> {
        // A connection that fails is closed, and another one is awaited.
        let result = self.stream.as_mut().map(work)?.ok();
        if result.is_none() {
            self.stream = None;
        }
        result
    }
}

impl Device for Server {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        self.open = Some(Open::new(self.address).map_err(|why| format!("{}: {why}", self.address))?);
        Ok(())
    }

    fn close(&mut self) {
        self.open = None;
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.open.as_ref().map(|open| open.all.0.as_fd())
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        let Some(open) = &mut self.open else { return Ok(Received::Nothing) };
        open.accept()?;
        let received = open.on_stream(|stream| Ok(stream.receive()?.is_some())) == Some(true);
        Ok(match &open.stream {
            Some(stream) if received => Received::input(now, Input::Words(&stream.words)),
            _ => Received::Nothing,
        })
    }

    fn send(&mut self, now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(open), Output::Words(words)) = (&mut self.open, output) else { return Ok(false) };
        // Without a connection output is lost, as on a wire without a listener.
        Ok(open.on_stream(|stream| stream.send(now, words)).unwrap_or(true))
    }

    fn sent_at(&self) -> Option<Instant> {
        self.open.as_ref()?.stream.as_ref()?.sent.front().copied()
    }

    fn take_sent(&mut self, now: Instant) -> bool {
        let stream = self.open.as_mut().and_then(|open| open.stream.as_mut());
        stream.is_some_and(|stream| stream.take_sent(now))
    }
}
