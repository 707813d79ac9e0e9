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

use super::commands::commands;

commands! {
    |common, command|
    pub enum I2c {
        /// Ask every address: who is on the bus
        Scan(scan::Scan) => scan::scan(common, command),
        /// Read a register
        Get(registers::Get) => registers::get(common, command),
        /// Write a register, and read it back
        Set(registers::Set) => registers::set(common, command),
        /// Read all registers of a chip
        Dump(dump::Dump) => dump::dump(common, command),
    }
}
