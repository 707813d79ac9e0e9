//! Encoding of transfers and their outcomes: a datagram each on the simulator's socket, and an entry in records.
//! `docs/i2c.md` has the format.

use super::{Address, Bytes, Error, MAX, Outcome, Read, Transfer};
use alloc::vec;
use alloc::vec::Vec;

/// The longest of either kind.
pub const DATAGRAM_MAX: usize = 3 + MAX;

// What is read.
const NOTHING: u8 = 0;
const EXACTLY: u8 = 1;
const BLOCK: u8 = 2;

// What came of it.
const OK: u8 = 0;
const NO_ADDRESS: u8 = 1;
const NO_DATA: u8 = 2;
const ARBITRATION: u8 = 3;
const STRETCHED: u8 = 4;
const STUCK: u8 = 5;
const OTHER: u8 = 6;

/// Address, kind of reading, how much, then what is written.
#[must_use]
pub fn transfer(transfer: &Transfer) -> Vec<u8> {
    let (kind, count) = match transfer.read {
        Read::None => (NOTHING, 0),
        Read::Exactly(count) => (EXACTLY, count),
        Read::Block { extra } => (BLOCK, extra),
    };
    [&[transfer.address.get(), kind, count][..], &transfer.write].concat()
}

/// Decodes a transfer; `None` if it is invalid.
#[must_use]
pub fn parse_transfer(bytes: &[u8]) -> Option<Transfer> {
    let (&[address, kind, count], write) = bytes.split_first_chunk()?;
    let read = match (kind, count) {
        (NOTHING, 0) => Read::None,
        (EXACTLY, count) if usize::from(count) <= MAX => Read::Exactly(count),
        (BLOCK, extra @ 0..=3) => Read::Block { extra },
        _ => return None,
    };
    Some(Transfer { address: Address::new(address)?, write: Bytes::from_slice(write).ok()?, read })
}

/// Encodes an outcome: its kind, then the bytes read, or the index of the refused byte.
#[must_use]
pub fn outcome(outcome: &Outcome) -> Vec<u8> {
    match outcome {
        Ok(read) => [&[OK][..], read].concat(),
        Err(Error::NoAddress) => vec![NO_ADDRESS],
        Err(Error::NoData { at }) => vec![NO_DATA, *at],
        Err(Error::Arbitration) => vec![ARBITRATION],
        Err(Error::Stretched) => vec![STRETCHED],
        Err(Error::Stuck) => vec![STUCK],
        Err(Error::Other) => vec![OTHER],
    }
}

/// Decodes an outcome; `None` if it is invalid.
#[must_use]
pub fn parse_outcome(bytes: &[u8]) -> Option<Outcome> {
    Some(match bytes {
        [OK, read @ ..] => Ok(Bytes::from_slice(read).ok()?),
        [NO_ADDRESS] => Err(Error::NoAddress),
        [NO_DATA, at] => Err(Error::NoData { at: *at }),
        [ARBITRATION] => Err(Error::Arbitration),
        [STRETCHED] => Err(Error::Stretched),
        [STUCK] => Err(Error::Stuck),
        [OTHER] => Err(Error::Other),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transfer_and_its_outcome_are_read_as_they_were_written() {
        let address = Address::new(0x18).unwrap();
        for read in [Read::None, Read::Exactly(0), Read::Exactly(36), Read::Block { extra: 3 }] {
            for write in [&[][..], &[0x0D], &[9; MAX]] {
                let asked = Transfer { address, write: Bytes::from_slice(write).unwrap(), read };
                assert_eq!(parse_transfer(&transfer(&asked)), Some(asked));
            }
        }
        let errors = [Error::NoAddress, Error::NoData { at: 3 }, Error::Arbitration, Error::Stretched];
        let errors = errors.into_iter().chain([Error::Stuck, Error::Other]).map(Err);
        let read = [&[][..], &[7; MAX]].map(|read| Ok(Bytes::from_slice(read).unwrap()));
        for came in errors.chain(read) {
            assert_eq!(parse_outcome(&outcome(&came)), Some(came));
        }
    }

    #[test]
    fn what_is_no_transfer_is_none() {
        for bad in
            [&[][..], &[0x18], &[0x18, 0], &[0x80, 0, 0], &[0x18, 0, 1], &[0x18, 1, 37], &[0x18, 2, 4], &[0x18, 3, 0]]
        {
            assert_eq!(parse_transfer(bad), None, "{bad:?}");
        }
        assert_eq!(parse_transfer(&[0; 3 + MAX + 1]), None);
        for bad in [&[][..], &[1, 0], &[2], &[7], &[0; 2 + MAX]] {
            assert_eq!(parse_outcome(bad), None, "{bad:?}");
        }
    }
}
