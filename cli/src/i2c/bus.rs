//! A bus of our own: one transfer at a time.

use super::target::{Known, Target};
use crate::Failed;
use crate::port::OpenPort;
use ::i2c::smbus::{self, Answer, Command};
use base::Duration;
use base::i2c::{Error, Outcome, Transfer};
use host::clock;
use host::ports::Received;
use module::{Input, Output};

/// An adapter that has not come back after this does not work; kernel drivers give up after 1 s or 2 s.
const COMES_BACK: Duration = Duration::from_millis(500);

/// An opened bus.
pub struct Bus {
    open: OpenPort,
}

impl Bus {
    /// Opens a free bus.
    pub fn open(target: &Target) -> Result<Self, Failed> {
        target.is_free()?;
        Ok(Self { open: OpenPort::open(&target.name, target.port.clone())? })
    }

    /// Makes a transfer, and waits for what comes of it.
    pub fn transfer(&mut self, transfer: &Transfer) -> Result<Outcome, Failed> {
        let (now, output) = (clock::now(), Output::I2c(transfer.clone()));
        let until = now + COMES_BACK;
        if !self.open.port.device.send(now, &output).map_err(|why| self.open.lost(&why))? {
            return Err(format!("{}: no room for a transfer", self.open.name).into());
        }
        loop {
            let now = clock::now();
            match self.open.port.device.receive(now) {
                Ok(Received::Input { input: Input::I2c(outcome), .. }) => return Ok(outcome.clone()),
                Ok(Received::Note(note)) => self.open.tell(&note),
                Ok(Received::Nothing) if now >= until => {
                    return Err(format!("{}: the adapter does not finish a transfer", self.open.name).into());
                }
                Ok(Received::Nothing) => {
                    if self.open.wait(until)? {
                        return Err("interrupted".into());
                    }
                }
                Ok(_) => {}
                Err(why) => return Err(self.open.lost(&why)),
            }
        }
    }

    /// Answer of a chip to an SMBus command.
    pub fn ask(
        &mut self,
        chip: &Known,
        command: &Command<'_>,
        pec: bool,
    ) -> Result<Result<Answer, smbus::Error>, Failed> {
        let transfer = command.transfer(chip.address, pec).map_err(|error| error.to_string())?;
        let outcome = self.transfer(&transfer)?;
        // A stuck bus ends the command.
        if let Err(error @ Error::Stuck) = outcome {
            return Err(format!("{}: {error}", self.open.name).into());
        }
        Ok(command.answer(chip.address, pec, &outcome))
    }

    /// A register's byte.
    pub fn byte(&mut self, chip: &Known, register: u8) -> Result<Result<u8, smbus::Error>, Failed> {
        let answer = self.ask(chip, &Command::ReadByte { code: register }, false)?;
        Ok(answer.map(|answer| if let Answer::Byte(value) = answer { value } else { 0 }))
    }
}
