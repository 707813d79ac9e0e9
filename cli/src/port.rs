//! A port that a tool has opened for itself.

use super::bus::interrupt;
use super::{Failed, complain};
use base::{Duration, Instant};
use host::clock;
use host::ports::{Port, PortConfig, PortState};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::signalfd::SignalFd;
use nix::sys::time::TimeSpec;
use std::io::{IsTerminal, Write, stderr};
use std::os::fd::AsFd;

/// A set-up command may have to be waited for.
const OPEN_WITHIN: Duration = Duration::from_secs(6);

/// A port that is open, and Ctrl-C.
pub struct OpenPort {
    /// For people.
    pub name: String,
    /// The port.
    pub port: Port,
    interrupt: SignalFd,
}

impl OpenPort {
    /// Opens a port. Ctrl-C is heard by [`OpenPort::wait`] from now on.
    pub fn open(name: &str, config: PortConfig) -> Result<Self, Failed> {
        let interrupt = interrupt()?;
        // Exact times, not times rounded for the sake of a battery.
        let _ = nix::sys::prctl::set_timerslack(1);
        let mut open = Self { name: name.into(), port: Port::new(name.into(), config), interrupt };
        open.wait_open()?;
        Ok(open)
    }

    fn wait_open(&mut self) -> Result<(), Failed> {
        let until = clock::now() + OPEN_WITHIN;
        loop {
            let now = clock::now();
            match self.port.try_open(now) {
                Some(Ok(())) => return Ok(()),
                Some(Err(why)) => return Err(format!("{}: {why}", self.name).into()),
                None if now >= until => return Err(format!("{}: its set-up command does not end", self.name).into()),
                None => {}
            }
            let PortState::Down { retry, .. } = self.port.state else {
                return Ok(());
            };
            if self.wait(retry)? {
                return Err("interrupted".into());
            }
        }
    }

    /// The error that it is lost.
    pub fn lost(&self, why: &str) -> Failed {
        format!("{} is lost: {why}", self.name).into()
    }

    /// A line for people, in place of a line that shows progress.
    pub fn tell(&self, note: &str) {
        if stderr().is_terminal() {
            let _ = write!(stderr(), "\r\x1b[K");
        }
        complain(&format!("{}: {note}", self.name));
    }

    /// Waits for the port, for the end of a sending, or until `until`; true at Ctrl-C.
    pub fn wait(&mut self, until: Instant) -> Result<bool, Failed> {
        let now = clock::now();
        let device = &self.port.device;
        let until = device.sent_at().map_or(until, |sent| sent.min(until));
        let mut flags = PollFlags::POLLIN;
        flags.set(PollFlags::POLLOUT, device.wants_to_write());
        let mut fds = vec![PollFd::new(self.interrupt.as_fd(), PollFlags::POLLIN)];
        fds.extend(device.fd().map(|fd| PollFd::new(fd, flags)));
        match ppoll(&mut fds, Some(TimeSpec::from_duration(until.since(now))), None) {
            Ok(_) | Err(Errno::EINTR) => {}
            Err(errno) => return Err(format!("poll: {}", errno.desc()).into()),
        }
        if flags.contains(PollFlags::POLLOUT) {
            self.port.device.on_writable(clock::now()).map_err(|why| self.lost(&why))?;
        }
        Ok(matches!(self.interrupt.read_signal(), Ok(Some(_))))
    }
}
