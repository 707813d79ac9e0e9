//! The simulator's end of a gamepad's stream: a UNIX socket in the run folder. Clients receive the simulated gamepad's
//! events; a client that writes lines acts as the gamepad for the simulator until it hangs up.

use super::codec;
use super::stream::{Stream, StreamItem};
use super::{Device, Lost, Received};
use base::gamepad::{self, Event};
use base::{Fault, Instant};
use module::{Input, Output};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use nix::unistd::write;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixListener;
use std::path::PathBuf;
use std::{fs, io};

/// Maximum number of clients; further ones are disconnected.
const CLIENTS_MAX: usize = 8;

/// Server of the stream.
pub struct Hub {
    path: PathBuf,
    opened: Option<(Epoll, UnixListener)>,
    pub(super) clients: Vec<Client>,
    /// The gamepad as last described, for clients that connect later.
    device: Option<Box<gamepad::Device>>,
    current: Option<Event>,
}

pub(super) struct Client {
    stream: Stream,
    /// It has sent lines: it acts as the gamepad and receives nothing.
    plays: bool,
}

impl Hub {
    /// Creates the port for a socket of that name, which is created anew and removed at the end.
    pub fn new(path: PathBuf) -> Self {
        Self { path, opened: None, clients: Vec::new(), device: None, current: None }
    }

    fn listen(&self) -> io::Result<(Epoll, UnixListener)> {
        let any = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?;
        // Renamed into place once it listens.
        let early = self.path.with_extension("new");
        let _ = fs::remove_file(&early);
        let listener = UnixListener::bind(&early)?;
        listener.set_nonblocking(true)?;
        any.add(&listener, EpollEvent::new(EpollFlags::EPOLLIN, 0))?;
        fs::rename(&early, &self.path)?;
        Ok((any, listener))
    }

    /// Accepts new clients.
    fn accept(&mut self) {
        let Some((any, listener)) = &self.opened else { return };
        while let Ok((socket, _)) = listener.accept() {
            if self.clients.len() >= CLIENTS_MAX || socket.set_nonblocking(true).is_err() {
                continue;
            }
            let Ok(stream) = Stream::new(OwnedFd::from(socket)) else { continue };
            if any.add(stream.fd(), EpollEvent::new(EpollFlags::EPOLLIN, 1)).is_err() {
                continue;
            }
            let found = self.device.clone().map(Event::Found);
            if found.is_none_or(|found| send_event(&stream, &found)) {
                self.clients.push(Client { stream, plays: false });
            }
        }
    }
}

/// Sends an event; false if it could not be written completely, after which the stream would be invalid.
fn send_event(stream: &Stream, event: &Event) -> bool {
    let mut text = String::new();
    codec::encode(event, &mut text);
    write(stream.file(), text.as_bytes()) == Ok(text.len())
}

impl Device for Hub {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let opened = self.listen().map_err(|error| format!("{}: {error}", self.path.display()))?;
        self.opened = Some(opened);
        Ok(())
    }

    fn close(&mut self) {
        self.clients.clear();
        if self.opened.take().is_some() {
            let _ = fs::remove_file(&self.path);
        }
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.opened.as_ref().map(|(any, _)| any.0.as_fd())
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        self.accept();
        let mut place = 0;
        while let Some(client) = self.clients.get_mut(place) {
            match client.stream.poll() {
                StreamItem::Event(event) => {
                    client.plays = true;
                    let event = self.current.insert(event);
                    return Ok(Received::input(now, Input::Gamepad(event.as_input())));
                }
                StreamItem::Wrong(why) => return Ok(Received::Fault(Fault::MessageMalformed, why)),
                StreamItem::Nothing => place += 1,
                StreamItem::End => {
                    if self.clients.remove(place).plays {
                        return Ok(Received::input(now, Input::Gamepad(gamepad::Input::Gone)));
                    }
                }
            }
        }
        Ok(Received::Nothing)
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let Output::Gamepad(event) = output else { return Ok(false) };
        gamepad::keep(&mut self.device, event);
        self.clients.retain(|client| client.plays || send_event(&client.stream, event));
        Ok(true)
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        self.close();
    }
}
