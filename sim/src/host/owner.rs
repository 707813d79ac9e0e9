//! The port of a process, which a wire connects.

use module::PortId;

/// A port of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Owner {
    pub pid: u32,
    pub port: PortId,
}
