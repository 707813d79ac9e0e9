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

use super::commands::commands;

commands! {
    |common, command|
    pub enum Rs485 {
        /// Ask every address for its firmware version: who is on the line
        Scan(scan::Scan) => scan::scan(common, command),
        /// Say a board's firmware version
        Version(ask::Version) => ask::version(common, command),
        /// Reset a board, or all at once
        Reset(ask::Reset) => ask::reset(common, command),
        /// Repeat an instruction and count: rate, round trips, errors
        Poll(poll::Poll) => poll::poll(common, command),
        /// Show what crosses the line, both ways, with times and names
        Monitor(monitor::Monitor) => monitor::monitor(common, command),
    }
}
