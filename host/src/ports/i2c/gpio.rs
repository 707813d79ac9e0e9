//! Two lines of a GPIO chip as a bus: the bit-banged master of `i2c` in real time. The speed depends on the chip: each
//! bit takes three or four system calls.

use super::{Blocking, Done, sys};
use crate::clock;
use crate::ports::Lost;
use ::i2c::bitbang::{Config, Levels, Master};
use base::i2c::{Error, Transfer};
use base::{Duration, Instant};
use std::fs::{File, OpenOptions};
use std::hint;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;
use std::thread;

/// Shorter waits are busy, because waking up takes as long.
const SHORT: Duration = Duration::from_micros(100);

pub struct Gpio {
    /// SDA, then SCL.
    lines: OwnedFd,
    /// Kept open so that tools can find the holder of the lines, whose descriptors have no name.
    _chip: File,
    master: Master,
}

impl Gpio {
    pub fn open(chip: &Path, sda: u32, scl: u32, hz: u32) -> Result<Self, Lost> {
        let named = |error: io::Error| format!("{}: {error}", chip.display());
        let file = OpenOptions::new().read(true).write(true).open(chip).map_err(named)?;
        let lines = sys::open_drain(file.as_fd(), [sda, scl])
            .map_err(|error| format!("{}: lines {sda} and {scl}: {error}", chip.display()))?;
        Ok(Self { lines, _chip: file, master: Master::new(Config { hz, ..Config::default() }) })
    }

    fn step(&mut self, now: Instant) -> io::Result<()> {
        let levels = match self.master.wants_levels() {
            true => sys::levels(self.lines.as_fd()).map(|[sda, scl]| Levels { scl, sda })?,
            false => Levels::HIGH,
        };
        let set = self.master.handle_timeout(now, levels);
        set.map_or(Ok(()), |Levels { scl, sda }| sys::set_levels(self.lines.as_fd(), [sda, scl]))
    }
}

impl Blocking for Gpio {
    fn transfer(&mut self, transfer: &Transfer) -> Result<Done, Lost> {
        if self.master.request(clock::now(), transfer.clone()).is_err() {
            return Ok((Err(Error::Other), None));
        }
        while let Some(at) = self.master.poll_timeout() {
            wait(at);
            self.step(clock::now()).map_err(|error| format!("the GPIO lines: {error}"))?;
        }
        Ok((self.master.poll_event().unwrap_or(Err(Error::Other)), None))
    }
}

fn wait(until: Instant) {
    loop {
        let left = until.since(clock::now());
        if left.is_zero() {
            return;
        }
        if left > SHORT { thread::sleep(left) } else { hint::spin_loop() }
    }
}
