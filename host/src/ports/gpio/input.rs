//! An input: a line of a GPIO chip with its edges as events of the kernel.
//!
//! The chip is asked when the port is opened; then the kernel reports each edge, so that no later call can block. If
//! there were more edges than its buffer holds, the kernel has dropped the oldest ones: the last one tells the level.

use super::number;
use crate::ports::i2c::sys;
use crate::ports::{Device, Lost, Received};
use base::gpio::{Bias, LineId, Signal};
use base::{Duration, Instant};
use module::{Input, OUTSTANDING, Output};
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::unistd::read;
use std::fs::{File, OpenOptions};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::PathBuf;

/// Where the input is found, and how it is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpioInput {
    /// Device file, `/dev/gpiochip0`.
    pub chip: PathBuf,
    /// The line.
    pub line: LineId,
    /// The line is active at the low level.
    pub active_low: bool,
    /// Resistor of the chip.
    pub bias: Bias,
    /// A level that lasts shorter is no edge; zero: any is.
    pub debounce: Duration,
}

/// A line of a GPIO chip as an input.
pub struct InputLine {
    config: GpioInput,
    open: Option<Open>,
}

struct Open {
    line: OwnedFd,
    /// Kept open so that tools can find the holder of the line, whose descriptor has no name.
    _chip: File,
    /// Readable while an answer waits.
    asked: EventFd,
    waiting: usize,
    /// Readable if one of both is.
    all: Epoll,
    active: bool,
}

impl InputLine {
    /// Creates a port that is closed.
    pub fn new(config: GpioInput) -> Self {
        Self { config, open: None }
    }

    fn request(&self) -> Result<Open, Lost> {
        let GpioInput { chip, line, active_low, bias, debounce } = &self.config;
        let chip = OpenOptions::new().read(true).write(true).open(chip).map_err(|error| error.to_string())?;
        let number = number(chip.as_fd(), line)?;
        let told = |error: std::io::Error| format!("line {line}: {error}");
        let held = sys::input(chip.as_fd(), number, *active_low, *bias, *debounce).map_err(told)?;
        let asked = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK).map_err(Errno::desc)?;
        let all = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(Errno::desc)?;
        all.add(&held, EpollEvent::new(EpollFlags::EPOLLIN, 0)).map_err(Errno::desc)?;
        all.add(&asked, EpollEvent::new(EpollFlags::EPOLLIN, 1)).map_err(Errno::desc)?;
        // An edge from now on is an event.
        let [active] = sys::levels(held.as_fd()).map_err(told)?;
        Ok(Open { line: held, _chip: chip, asked, waiting: 0, all, active })
    }
}

impl Open {
    /// The level after the next edge, if there was one.
    fn edge(&mut self) -> Result<Option<bool>, Lost> {
        let mut event = [0; sys::EVENT_SIZE];
        match read(&self.line, &mut event) {
            Ok(count) => match sys::edge(&event[..count]) {
                Some(active) => {
                    self.active = active;
                    Ok(Some(active))
                }
                None => Err("the kernel sent an invalid event".into()),
            },
            Err(Errno::EAGAIN | Errno::EINTR) => Ok(None),
            Err(errno) => Err(errno.desc().into()),
        }
    }
}

impl Device for InputLine {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let open = self.request().map_err(|why| format!("{}: {why}", self.config.chip.display()));
        self.open = Some(open?);
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
        if let Some(active) = open.edge()? {
            return Ok(Received::input(now, Input::Gpio(Signal::Level(active))));
        }
        if open.waiting == 0 {
            let _ = open.asked.read();
            return Ok(Received::Nothing);
        }
        open.waiting -= 1;
        Ok(Received::input(now, Input::Gpio(Signal::Level(open.active))))
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(open), Output::Gpio(Signal::Read)) = (&mut self.open, output) else { return Ok(false) };
        if open.waiting >= OUTSTANDING {
            return Ok(false);
        }
        open.waiting += 1;
        open.asked.write(1).map_err(Errno::desc)?;
        Ok(true)
    }
}
