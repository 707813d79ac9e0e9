//! The time that a transfer takes on the wire.

use base::Duration;
use base::i2c::{Error, Outcome, Transfer};

/// A chip that does not answer at all holds the clock; a master gives up after this (SMBus 3.2, 3.1.1.3: 25 to 35 ms).
pub const STRETCH_MAX: Duration = Duration::from_millis(35);

/// The time on the wire of a transfer with this outcome, at a clock of `hz`.
#[must_use]
pub fn duration(transfer: &Transfer, outcome: &Outcome, hz: u32) -> Duration {
    let clocks = match outcome {
        Ok(read) => {
            let (writes, reads) = (!transfer.begins_with_read(), transfer.reads());
            let addresses = u64::from(writes) + u64::from(reads);
            // START or repeated START before each address, nine clocks a byte, STOP and the time that the bus is free
            // then.
            addresses + 9 * (addresses + transfer.write.len() as u64 + read.len() as u64) + 2
        }
        Err(Error::NoAddress) => 1 + 9 + 2,
        Err(Error::NoData { at }) => 1 + 9 * (2 + u64::from(*at)) + 2,
        // Nine clocks that free nobody.
        Err(Error::Stuck) => 9,
        Err(Error::Arbitration | Error::Other) => 1 + 9,
        Err(Error::Stretched) => return STRETCH_MAX,
    };
    Duration::from_nanos(clocks * 1_000_000_000 / u64::from(hz.max(1)))
}
