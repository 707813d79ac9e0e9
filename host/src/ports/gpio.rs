//! Digital outputs and inputs: lines of a GPIO chip, or the simulator's, a pair of sockets in the run folder.
//!
//! A chip behind a slow bus blocks, so a thread makes the calls; it opens the chip, too, with the first of them.

mod input;
mod socket;

pub use input::{GpioInput, InputLine};
pub use socket::Socket;

use super::Lost;
use super::i2c::sys;
use super::threaded::Service;
use base::gpio::{LineId, Signal};
use module::{Input, Output};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::PathBuf;

/// Where the output is found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpioConfig {
    /// Device file, `/dev/gpiochip0`.
    pub chip: PathBuf,
    /// The line.
    pub line: LineId,
    /// The line is active at the low level.
    pub active_low: bool,
}

impl GpioConfig {
    /// Name of another program that holds the line, if one does; the line itself does not change.
    ///
    /// # Errors
    /// The chip cannot be opened, or has no such line.
    pub fn foreign_holder(&self) -> Result<Option<String>, Lost> {
        let (chip, number) = self.find()?;
        let info = sys::line_info(chip.as_fd(), number).map_err(|error| format!("line {}: {error}", self.line))?;
        Ok(Some(info.consumer).filter(|consumer| !consumer.is_empty() && consumer != sys::STOP_CONSUMER))
    }

    /// The chip, and the number of the line.
    fn find(&self) -> Result<(File, u32), String> {
        let chip = OpenOptions::new().read(true).write(true).open(&self.chip).map_err(|error| error.to_string())?;
        let number = number(chip.as_fd(), &self.line)?;
        Ok((chip, number))
    }
}

/// A line of a GPIO chip. When it is requested, an output keeps its level, and any other line becomes inactive; when it
/// is closed, the chip decides what becomes of it.
pub struct Line(pub GpioConfig);

impl Service for Line {
    type Request = Signal;
    type Answer = Signal;
    const THREAD: &'static str = "gpio";
    const BUSY: &'static str = "its last call has not finished";

    fn work(&self) -> impl FnMut(Signal) -> Result<Signal, Lost> + Send + 'static {
        let config = self.0.clone();
        let mut open = None;
        move |signal| {
            let held = match open.take() {
                Some(held) => held,
                None => Held::request(&config).map_err(|why| format!("{}: {why}", config.chip.display()))?,
            };
            let level = held.answer(signal).map_err(|error| format!("line {}: {error}", config.line))?;
            open = Some(held);
            Ok(Signal::Level(level))
        }
    }

    fn request(output: &Output) -> Option<&Signal> {
        if let Output::Gpio(signal) = output { Some(signal) } else { None }
    }

    fn input(answer: &Signal) -> Input<'_> {
        Input::Gpio(*answer)
    }
}

/// The requested line.
struct Held {
    line: OwnedFd,
    /// Kept open so that tools can find the holder of the line, whose descriptor has no name.
    _chip: File,
}

impl Held {
    fn request(config: &GpioConfig) -> Result<Self, String> {
        let (chip, number) = config.find()?;
        let line = sys::output(chip.as_fd(), number, config.active_low);
        let line = line.map_err(|error| format!("line {}: {error}", config.line))?;
        Ok(Self { line, _chip: chip })
    }

    fn answer(&self, signal: Signal) -> io::Result<bool> {
        if let Signal::Level(level) = signal {
            sys::set_levels(self.line.as_fd(), [level])?;
        }
        sys::levels(self.line.as_fd()).map(|[level]| level)
    }
}

/// Number of a line; the name must be that of one line only.
fn number(chip: BorrowedFd<'_>, line: &LineId) -> Result<u32, String> {
    let name = match line {
        LineId::Number(number) => return Ok(*number),
        LineId::Name(name) => name,
    };
    let names = (0..).map_while(|number| Some((number, sys::line_info(chip, number).ok()?.name)));
    let numbers: Vec<u32> = names.filter(|(_, found)| found == name).map(|(number, _)| number).collect();
    match numbers[..] {
        [number] => Ok(number),
        [] => Err(format!("no line is named {name}")),
        _ => Err(format!("several lines are named {name}")),
    }
}

#[cfg(test)]
mod tests;
