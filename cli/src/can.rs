//! `advee can …`: commissioning of CANopen nodes, on a bus of the configuration or on any interface.
//!
//! A bus that a module holds belongs to it: objects are read and written through the module (`LL_CMD_SDO`) then,
//! commands to nodes are refused with the module's name, and `monitor`, which only listens, works.

mod access;
mod book;
mod decode;
mod link;
mod lss;
mod monitor;
mod nmt;
mod scan;
mod sdo;
pub(super) mod standard;
mod target;
pub(super) mod value;

use super::{Common, Outcome};
use clap::Subcommand;
pub(super) use link::{Heard, Link};
pub(super) use target::Target;

#[derive(Subcommand)]
pub enum Can {
    /// Ask every node id who is there
    Scan(scan::Scan),
    /// Start, stop or reset nodes
    Nmt(nmt::Nmt),
    /// Read and write objects of a node
    #[command(subcommand)]
    Sdo(sdo::Sdo),
    /// Show what crosses the bus, decoded, with times and names
    Monitor(monitor::Monitor),
    /// Find nodes without node id, give node ids and bit rates
    #[command(subcommand)]
    Lss(lss::Lss),
}

pub fn can(common: &Common, command: &Can) -> Outcome {
    match command {
        Can::Scan(command) => scan::scan(common, command),
        Can::Nmt(command) => nmt::nmt(common, command),
        Can::Sdo(command) => sdo::sdo(common, command),
        Can::Monitor(command) => monitor::monitor(common, command),
        Can::Lss(command) => lss::lss(common, command),
    }
}
