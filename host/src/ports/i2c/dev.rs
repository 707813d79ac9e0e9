//! An adapter of the kernel through i2c-dev: `I2C_RDWR`, or, if the adapter supports only SMBus, `I2C_SMBUS` for those
//! transfers that match an SMBus command.

use super::{Blocking, Done, sys};
use crate::ports::Lost;
use base::i2c::{Bytes, Error, MAX, Outcome, Read, Transfer};
use nix::errno::Errno;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};

// SMBus transaction types (linux/i2c.h).
const QUICK: u32 = 0;
const BYTE: u32 = 1;
const BYTE_DATA: u32 = 2;
const WORD_DATA: u32 = 3;
const PROC_CALL: u32 = 4;
const BLOCK_DATA: u32 = 5;
const I2C_BLOCK_DATA: u32 = 8;

/// Maximum length of an SMBus block, bytes.
const BLOCK_MAX: usize = 32;

pub struct Dev {
    path: PathBuf,
    file: File,
    /// Supports plain transfers.
    plain: bool,
    /// Supports block reads.
    blocks: bool,
    /// A missing capability was reported.
    reported: bool,
}

impl Dev {
    pub fn open(path: &Path) -> Result<Self, Lost> {
        let named = |error: io::Error| format!("{}: {error}", path.display());
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(named)?;
        let functions =
            sys::functions(file.as_fd()).map_err(|_| format!("{} is not an I2C adapter", path.display()))?;
        let plain = functions & sys::FUNC_I2C != 0;
        if !plain && functions & sys::FUNC_READ_BYTE_DATA == 0 {
            return Err(format!("{}: the adapter supports neither plain transfers nor SMBus commands", path.display()));
        }
        Ok(Self { path: path.into(), file, plain, blocks: functions & sys::FUNC_READ_BLOCK != 0, reported: false })
    }

    /// Executes a transfer with `I2C_RDWR`.
    fn plain(&self, transfer: &Transfer) -> io::Result<Bytes> {
        let (mut write, mut read) = (transfer.write.clone(), [0; MAX]);
        let (count, block) = match transfer.read {
            Read::None => (None, None),
            Read::Exactly(count) => (Some(usize::from(count).min(MAX)), None),
            Read::Block { extra } => (Some(MAX), Some(1 + extra)),
        };
        let writes = (!transfer.begins_with_read()).then_some(&mut write[..]);
        let reads = count.map(|count| &mut read[..count]);
        sys::transfer(self.file.as_fd(), transfer.address.get(), writes, reads, block)?;
        let count = match block {
            Some(around) => usize::from(read[0]).min(BLOCK_MAX) + usize::from(around),
            None => count.unwrap_or(0),
        };
        Ok(read[..count.min(MAX)].iter().copied().collect())
    }

    /// Executes a transfer with `I2C_SMBUS`; `None` if it matches no SMBus command.
    fn command(&self, transfer: &Transfer) -> Option<io::Result<Bytes>> {
        let Command { read, command, size, mut data } = Command::of(transfer)?;
        let done = sys::smbus(self.file.as_fd(), transfer.address.get(), read, command, size, &mut data);
        let reads = read || size == PROC_CALL;
        Some(done.map(|()| match size {
            BYTE | BYTE_DATA if reads => data[..1].iter().copied().collect(),
            WORD_DATA | PROC_CALL if reads => {
                u16::from_ne_bytes([data[0], data[1]]).to_le_bytes().into_iter().collect()
            }
            BLOCK_DATA if reads => data[..=usize::from(data[0]).min(BLOCK_MAX)].iter().copied().collect(),
            I2C_BLOCK_DATA if reads => data[1..=usize::from(data[0]).min(BLOCK_MAX)].iter().copied().collect(),
            _ => Bytes::new(),
        }))
    }

    fn refuse(&mut self, what: &str) -> Done {
        let reported = std::mem::replace(&mut self.reported, true);
        let note = format!("{}: the adapter cannot {what}", self.path.display());
        (Err(Error::Other), (!reported).then_some(note))
    }
}

impl Blocking for Dev {
    fn transfer(&mut self, transfer: &Transfer) -> Result<Done, Lost> {
        let done = match transfer.read {
            Read::Block { .. } if self.plain && !self.blocks => {
                return Ok(self.refuse("read a block of variable length"));
            }
            _ if self.plain => self.plain(transfer),
            _ => match self.command(transfer) {
                Some(done) => done,
                None => return Ok(self.refuse("make this transfer, because it supports SMBus only")),
            },
        };
        match done {
            Ok(read) => Ok((Ok(read), None)),
            // An adapter cannot go while its file is open; its name disappears when it was unplugged.
            Err(_) if !self.path.exists() => Err("the adapter is gone".into()),
            Err(error) => Ok((outcome(&error), None)),
        }
    }
}

/// Converts an adapter's error (Documentation/i2c/fault-codes.rst), which does not tell which byte was refused.
fn outcome(error: &io::Error) -> Outcome {
    Err(match Errno::from_raw(error.raw_os_error().unwrap_or(0)) {
        Errno::ENXIO | Errno::EREMOTEIO | Errno::ENODEV => Error::NoAddress,
        Errno::EAGAIN => Error::Arbitration,
        Errno::ETIMEDOUT => Error::Stretched,
        Errno::EBUSY => Error::Stuck,
        _ => Error::Other,
    })
}

/// Arguments of an `I2C_SMBUS` call.
#[derive(Debug, PartialEq)]
struct Command {
    read: bool,
    command: u8,
    size: u32,
    data: [u8; sys::SMBUS_DATA],
}

impl Command {
    /// Finds the SMBus command with the same bytes on the wire.
    fn of(transfer: &Transfer) -> Option<Self> {
        let new = |read, command, size| Self { read, command, size, data: [0; sys::SMBUS_DATA] };
        let word = |read, command, low, high, size| {
            let mut new = new(read, command, size);
            new.data[..2].copy_from_slice(&u16::from_le_bytes([low, high]).to_ne_bytes());
            new
        };
        Some(match (&transfer.write[..], transfer.read) {
            ([], Read::None) => new(false, 0, QUICK),
            ([], Read::Exactly(0)) => new(true, 0, QUICK),
            ([], Read::Exactly(1)) => new(true, 0, BYTE),
            ([command], Read::None) => new(false, *command, BYTE),
            ([command], Read::Exactly(1)) => new(true, *command, BYTE_DATA),
            ([command], Read::Exactly(2)) => new(true, *command, WORD_DATA),
            ([command], Read::Exactly(count)) if (3..=BLOCK_MAX).contains(&usize::from(count)) => {
                let mut new = new(true, *command, I2C_BLOCK_DATA);
                new.data[0] = count;
                new
            }
            ([command], Read::Block { extra: 0 }) => new(true, *command, BLOCK_DATA),
            ([command, low, high], Read::Exactly(2)) => word(true, *command, *low, *high, PROC_CALL),
            ([command, low, high], Read::None) => word(false, *command, *low, *high, WORD_DATA),
            ([command, value], Read::None) => {
                let mut new = new(false, *command, BYTE_DATA);
                new.data[0] = *value;
                new
            }
            ([command, rest @ ..], Read::None) if rest.len() <= BLOCK_MAX => {
                let mut new = new(false, *command, I2C_BLOCK_DATA);
                new.data[0] = rest.len() as u8;
                new.data[1..=rest.len()].copy_from_slice(rest);
                new
            }
            ([command, length, rest @ ..], Read::None) if usize::from(*length) == rest.len() => {
                let mut new = new(false, *command, BLOCK_DATA);
                new.data[0] = *length;
                new.data[1..=rest.len()].copy_from_slice(rest);
                new
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::i2c::Address;

    fn transfer(write: &[u8], read: Read) -> Transfer {
        Transfer { address: Address::new(0x18).unwrap(), write: Bytes::from_slice(write).unwrap(), read }
    }

    #[test]
    fn smbus_commands_are_recognized() {
        let command = |write: &[u8], read| {
            let Command { read, command, size, data } = Command::of(&transfer(write, read))?;
            Some((read, command, size, data[..4].to_vec()))
        };
        let word = |low, high| [&u16::from_le_bytes([low, high]).to_ne_bytes()[..], &[0, 0]].concat();
        assert_eq!(command(&[], Read::None), Some((false, 0, QUICK, vec![0; 4])));
        assert_eq!(command(&[], Read::Exactly(0)), Some((true, 0, QUICK, vec![0; 4])));
        assert_eq!(command(&[], Read::Exactly(1)), Some((true, 0, BYTE, vec![0; 4])));
        assert_eq!(command(&[7], Read::None), Some((false, 7, BYTE, vec![0; 4])));
        assert_eq!(command(&[7], Read::Exactly(1)), Some((true, 7, BYTE_DATA, vec![0; 4])));
        assert_eq!(command(&[7, 9], Read::None), Some((false, 7, BYTE_DATA, vec![9, 0, 0, 0])));
        assert_eq!(command(&[7], Read::Exactly(2)), Some((true, 7, WORD_DATA, vec![0; 4])));
        assert_eq!(command(&[7, 1, 2], Read::None), Some((false, 7, WORD_DATA, word(1, 2))));
        assert_eq!(command(&[7, 1, 2], Read::Exactly(2)), Some((true, 7, PROC_CALL, word(1, 2))));
        assert_eq!(command(&[7], Read::Block { extra: 0 }), Some((true, 7, BLOCK_DATA, vec![0; 4])));
        assert_eq!(command(&[7], Read::Exactly(32)), Some((true, 7, I2C_BLOCK_DATA, vec![32, 0, 0, 0])));
        assert_eq!(command(&[7, 2, 8, 9], Read::None), Some((false, 7, I2C_BLOCK_DATA, vec![3, 2, 8, 9])));
        assert_eq!(command(&[7], Read::Block { extra: 1 }), None);
        assert_eq!(command(&[7, 8], Read::Exactly(1)), None);
        assert_eq!(command(&[], Read::Exactly(2)), None);
        let longest = [&[7, 32][..], &[5; 32]].concat();
        assert_eq!(command(&longest, Read::None), Some((false, 7, BLOCK_DATA, vec![32, 5, 5, 5])));
    }

    #[test]
    fn a_file_that_is_not_an_adapter_is_rejected_by_name() {
        let why = |path: &str| Dev::open(Path::new(path)).err().unwrap();
        assert_eq!(why("/dev/null"), "/dev/null is not an I2C adapter");
        assert!(why("/dev/no-such-i2c").starts_with("/dev/no-such-i2c: "));
    }
}
