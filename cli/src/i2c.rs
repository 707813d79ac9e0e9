//! `advee i2c …`: commissioning of chips on I2C and SMBus, on a bus of the configuration or on any other.
//!
//! An adapter that a module holds is its own: these refuse and name who has it. The simulator's bus has room for
//! several masters, as the wire has: there they work beside the module, a transfer of each in turn.

mod bus;
mod decode;
mod dump;
mod registers;
mod scan;
mod target;

use super::{Common, Outcome};
use clap::Subcommand;

#[derive(Subcommand)]
pub enum I2c {
    /// Ask every address: who is on the bus
    Scan(scan::Scan),
    /// Read a register
    Get(registers::Get),
    /// Write a register, and read it back
    Set(registers::Set),
    /// Read all registers of a chip
    Dump(dump::Dump),
}

pub fn i2c(common: &Common, command: &I2c) -> Outcome {
    match command {
        I2c::Scan(command) => scan::scan(common, command),
        I2c::Get(command) => registers::get(common, command),
        I2c::Set(command) => registers::set(common, command),
        I2c::Dump(command) => dump::dump(common, command),
    }
}
