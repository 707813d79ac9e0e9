//! `advee can …`: commissioning of CANopen nodes, on a bus of the configuration or on any interface.
//!
//! A bus that a module holds belongs to it: objects are read and written through the module (`LL_CMD_SDO`) then,
//! commands to nodes are refused with the module's name, and `monitor`, which only listens, works.

mod access;
mod book;
mod controllers;
mod decode;
mod identify;
mod link;
mod lss;
mod monitor;
mod nmt;
mod scan;
mod sdo;
pub(super) mod standard;
mod target;
pub(super) mod value;

use super::commands::commands;
pub(super) use link::{Heard, Link};
pub(super) use target::Target;

commands! {
    |common, command|
    pub enum Can {
        /// Ask every node id who is there
        Scan(scan::Scan) => scan::scan(common, command),
        /// Write the lines of robot.toml for the drives on the bus
        Identify(identify::Identify) => identify::identify(common, command),
        /// Start, stop or reset nodes
        Nmt(nmt::Nmt) => nmt::nmt(common, command),
        /// Read and write objects of a node
        #[command(subcommand)]
        Sdo(sdo::Sdo) => command.run(common),
        /// Show what crosses the bus, decoded, with times and names
        Monitor(monitor::Monitor) => monitor::monitor(common, command),
        /// Find nodes without node id, give node ids and bit rates
        #[command(subcommand)]
        Lss(lss::Lss) => lss::lss(common, command),
    }
}
