//! `advee rs485 …`: commissioning of the boards on EIA-485, on a bus of the configuration or on any port.
//!
//! A port that a module holds is its own: `monitor` then shows what the module tells on `LL_DATA_RAW_<BUS>`, the others
//! refuse and name who has it.

mod ask;
mod decode;
mod line;
mod monitor;
mod pairing;
mod poll;
mod scan;
mod target;

use super::{Common, Outcome};
use clap::Subcommand;

#[derive(Subcommand)]
pub enum Rs485 {
    /// Ask every address for its firmware version: who is on the line
    Scan(scan::Scan),
    /// Say a board's firmware version
    Version(ask::Version),
    /// Reset a board, or all at once
    Reset(ask::Reset),
    /// Repeat an instruction and count: rate, round trips, errors
    Poll(poll::Poll),
    /// Show what crosses the line, both ways, with times and names
    Monitor(monitor::Monitor),
}

pub fn rs485(common: &Common, command: &Rs485) -> Outcome {
    match command {
        Rs485::Scan(command) => scan::scan(common, command),
        Rs485::Version(command) => ask::version(common, command),
        Rs485::Reset(command) => ask::reset(common, command),
        Rs485::Poll(command) => poll::poll(common, command),
        Rs485::Monitor(command) => monitor::monitor(common, command),
    }
}
