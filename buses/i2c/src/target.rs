//! The answering side of a transfer, byte by byte: what a chip is, for the simulator and for tests.
//!
//! [`answer`] runs a whole transfer against chips; [`crate::wire::Slave`] lets the same chip answer level by level.

use base::i2c::{Address, Bytes, Error, MAX, Outcome, Read, Transfer};

/// A chip. Who holds it calls in the order of the bus: `start`, bytes one way, perhaps `start` again, `stop`.
pub trait Target {
    /// Addressed, with the read bit or without; true acknowledges.
    fn start(&mut self, address: Address, read: bool) -> bool;
    /// A byte written; true acknowledges.
    fn write(&mut self, byte: u8) -> bool;
    /// The next byte to be read.
    fn read(&mut self) -> u8;
    /// STOP, or a START that is another's.
    fn stop(&mut self);
}

/// Outcome of a transfer with these chips, without time and wires. All chips that acknowledge the address receive what
/// is written; where several are read, the wired-AND decides.
pub fn answer(chips: &mut [&mut dyn Target], transfer: &Transfer) -> Outcome {
    // One bit a chip, as on the bus.
    assert!(chips.len() <= 128, "a bus has no more addresses");
    let outcome = run(chips, transfer);
    chips.iter_mut().for_each(|chip| chip.stop());
    outcome
}

fn run(chips: &mut [&mut dyn Target], transfer: &Transfer) -> Outcome {
    let mut read = Bytes::new();
    if !transfer.begins_with_read() {
        let mut listening = start(chips, transfer.address, false)?;
        for (at, byte) in transfer.write.iter().enumerate() {
            let acknowledged = each(chips, listening, |chip| chip.write(*byte));
            if acknowledged == 0 {
                return Err(Error::NoData { at: at as u8 });
            }
            listening = acknowledged;
        }
    }
    if !transfer.reads() {
        return Ok(read);
    }
    let speaking = start(chips, transfer.address, true)?;
    let mut want = expected(transfer.read, None);
    while read.len() < want {
        let mut byte = 0xFF;
        each(chips, speaking, |chip| {
            byte &= chip.read();
            true
        });
        // `want` is no more than there is room for.
        read.extend([byte]);
        want = expected(transfer.read, read.first().copied());
    }
    Ok(read)
}

/// Number of bytes a transfer reads in all, once its first one is known.
#[must_use]
pub fn expected(read: Read, first: Option<u8>) -> usize {
    match (read, first) {
        (Read::None, _) => 0,
        (Read::Exactly(count), _) => usize::from(count).min(MAX),
        (Read::Block { extra }, Some(len @ 1..=32)) => (1 + usize::from(len) + usize::from(extra)).min(MAX),
        (Read::Block { .. }, _) => 1,
    }
}

fn start(chips: &mut [&mut dyn Target], address: Address, read: bool) -> Result<u128, Error> {
    match each(chips, u128::MAX, |chip| chip.start(address, read)) {
        0 => Err(Error::NoAddress),
        listening => Ok(listening),
    }
}

/// Calls the chips whose bit is set; returns the bits of those that returned true.
fn each(chips: &mut [&mut dyn Target], which: u128, mut call: impl FnMut(&mut dyn Target) -> bool) -> u128 {
    let mut said = 0;
    for (n, chip) in chips.iter_mut().enumerate() {
        if which >> n & 1 == 1 && call(*chip) {
            said |= 1 << n;
        }
    }
    said
}
