//! Both sides of `embedded-hal` 1.0: our bit-banged master as an I2C bus for drivers of others, and anybody's I2C bus
//! for our transfers and drivers.

use crate::bitbang::{Config, Master, Pins, perform};
use base::i2c::{self, Address, Bytes, Outcome, Read, Transfer};
use core::fmt;
use embedded_hal::delay::DelayNs;
use embedded_hal::i2c::{Error as _, ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};

/// Our master on two pins as a blocking I2C bus.
#[derive(Debug)]
pub struct Bus<P, D> {
    master: Master,
    pins: P,
    delay: D,
}

/// [`i2c::Error`] in the words of `embedded-hal`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The transfer failed.
    Bus(i2c::Error),
    /// Anything but one write, one read, or a write and then a read, of at most [`i2c::MAX`] bytes each.
    Unsupported,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => error.fmt(f),
            Self::Unsupported => f.write_str("this bus can write, read, or write and then read, up to 36 bytes each"),
        }
    }
}

impl core::error::Error for Error {}

impl embedded_hal::i2c::Error for Error {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Bus(i2c::Error::NoAddress) => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
            Self::Bus(i2c::Error::NoData { .. }) => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data),
            Self::Bus(i2c::Error::Arbitration) => ErrorKind::ArbitrationLoss,
            Self::Bus(i2c::Error::Stretched | i2c::Error::Stuck) => ErrorKind::Bus,
            Self::Bus(i2c::Error::Other) | Self::Unsupported => ErrorKind::Other,
        }
    }
}

impl<P: Pins, D: DelayNs> Bus<P, D> {
    /// A bus on these pins, both of which are released.
    pub fn new(config: Config, pins: P, delay: D) -> Self {
        Self { master: Master::new(config), pins, delay }
    }

    /// Runs a transfer to its end.
    pub fn perform(&mut self, transfer: Transfer) -> Outcome {
        perform(&mut self.master, transfer, &mut self.pins, &mut self.delay)
    }

    /// The pins and the delay, for another use.
    pub fn release(self) -> (P, D) {
        (self.pins, self.delay)
    }
}

impl<P, D> ErrorType for Bus<P, D> {
    type Error = Error;
}

impl<P: Pins, D: DelayNs> I2c for Bus<P, D> {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), Error> {
        let address = Address::new(address).ok_or(Error::Unsupported)?;
        let mut transfer = Transfer { address, write: Bytes::new(), read: Read::None };
        let mut count = 0;
        // Adjacent operations of one direction are one to the bus.
        for operation in operations.iter() {
            match operation {
                Operation::Write(_) if transfer.reads() => return Err(Error::Unsupported),
                Operation::Write(bytes) => transfer.write.extend_from_slice(bytes).map_err(|_| Error::Unsupported)?,
                Operation::Read(bytes) => {
                    count += bytes.len();
                    transfer.read = Read::Exactly(fits(count)?);
                }
            }
        }
        if operations.is_empty() {
            return Ok(());
        }
        let read = self.perform(transfer).map_err(Error::Bus)?;
        let mut rest = read.iter();
        for operation in operations {
            if let Operation::Read(bytes) = operation {
                bytes.iter_mut().zip(&mut rest).for_each(|(to, from)| *to = *from);
            }
        }
        Ok(())
    }
}

fn fits(count: usize) -> Result<u8, Error> {
    if count <= i2c::MAX { Ok(count as u8) } else { Err(Error::Unsupported) }
}

/// Runs a transfer on any `embedded-hal` bus. A block is [`i2c::Error::Other`]: these traits cannot wait for a length;
/// so is any error without an equivalent here. The index of a refused byte is unknown: 0.
pub fn transfer(bus: &mut impl I2c, transfer: &Transfer) -> Outcome {
    let mut buffer = [0; i2c::MAX];
    let address = transfer.address.get();
    let done = match transfer.read {
        Read::None => bus.write(address, &transfer.write).map(|()| 0),
        Read::Exactly(count) if usize::from(count) <= buffer.len() => {
            let count = usize::from(count);
            let bytes = &mut buffer[..count];
            let read = if transfer.write.is_empty() {
                bus.read(address, bytes)
            } else {
                bus.write_read(address, &transfer.write, bytes)
            };
            read.map(|()| count)
        }
        Read::Exactly(_) | Read::Block { .. } => return Err(i2c::Error::Other),
    };
    let count = done.map_err(|error| match error.kind() {
        ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data) => i2c::Error::NoData { at: 0 },
        ErrorKind::NoAcknowledge(_) => i2c::Error::NoAddress,
        ErrorKind::ArbitrationLoss => i2c::Error::Arbitration,
        ErrorKind::Bus => i2c::Error::Stuck,
        _ => i2c::Error::Other,
    })?;
    Ok(buffer[..count].iter().copied().collect())
}
