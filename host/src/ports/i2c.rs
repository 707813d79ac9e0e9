//! I2C buses: an adapter of the kernel, two GPIO lines, the simulator's socket, and the simulator's end of that.
//!
//! `docs/i2c.md` describes the capabilities of each. Adapters and GPIO block, so they have their own thread; the socket
//! does not.

mod dev;
mod gpio;
mod server;
mod socket;
pub(super) mod sys;

pub use server::Server;
pub use socket::Socket;

use super::worker::{Life, Worker};
use super::{Device, Lost, Received};
use base::Instant;
use base::i2c::{Outcome, Transfer};
use module::{Input, Output};
use std::os::fd::BorrowedFd;
use std::path::PathBuf;

/// Outcome of a transfer, and a note for people if there is one.
type Done = (Outcome, Option<String>);

/// Executor of transfers, which may block. `Err`: the bus is lost.
trait Blocking: Send {
    fn transfer(&mut self, transfer: &Transfer) -> Result<Done, Lost>;
}

/// Bus with blocking transfers.
pub struct I2c {
    place: Place,
    worker: Option<Worker<Transfer, Done>>,
    life: Life,
    /// Outcome that follows the note just delivered.
    next: Option<Outcome>,
    outcome: Outcome,
}

enum Place {
    Dev(PathBuf),
    Gpio { chip: PathBuf, sda: u32, scl: u32, hz: u32 },
}

impl I2c {
    /// Creates the port of a kernel adapter: `/dev/i2c-1`.
    pub fn dev(path: PathBuf) -> Self {
        Self::new(Place::Dev(path))
    }

    /// Creates the port of two lines of a GPIO chip.
    pub fn gpio(chip: PathBuf, sda: u32, scl: u32, hz: u32) -> Self {
        Self::new(Place::Gpio { chip, sda, scl, hz })
    }

    fn new(place: Place) -> Self {
        Self { place, worker: None, life: Life::default(), next: None, outcome: Ok(Default::default()) }
    }

    fn open_bus(&self) -> Result<Box<dyn Blocking>, Lost> {
        Ok(match &self.place {
            Place::Dev(path) => Box::new(dev::Dev::open(path)?),
            Place::Gpio { chip, sda, scl, hz } => Box::new(gpio::Gpio::open(chip, *sda, *scl, *hz)?),
        })
    }
}

impl Device for I2c {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        if self.life.is_alive() {
            return Err("its last transfer has not finished".into());
        }
        let mut bus = self.open_bus()?;
        let worker = Worker::start("i2c", &mut self.life, move |transfer| bus.transfer(&transfer));
        self.worker = Some(worker.map_err(|error| format!("its thread: {error}"))?);
        Ok(())
    }

    fn close(&mut self) {
        (self.worker, self.next) = (None, None);
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.worker.as_ref().map(Worker::fd)
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        let outcome = match self.next.take() {
            Some(outcome) => outcome,
            None => match self.worker.as_mut().and_then(Worker::take) {
                None => return Ok(Received::Nothing),
                Some(done) => match done? {
                    (outcome, None) => outcome,
                    // The note goes first: a receiver that waits for the outcome reads no further.
                    (outcome, Some(note)) => {
                        self.next = Some(outcome);
                        return Ok(Received::Note(note));
                    }
                },
            },
        };
        self.outcome = outcome;
        Ok(Received::input(now, Input::I2c(&self.outcome)))
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(worker), Output::I2c(transfer)) = (&mut self.worker, output) else {
            return Ok(false);
        };
        Ok(worker.queue(transfer.clone()))
    }
}

#[cfg(test)]
mod tests;
