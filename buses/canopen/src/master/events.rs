//! Events of a master.

use crate::wire::{Emergency, NmtState};
use crate::{Payload, sdo};
use base::listed;
use core::fmt;

/// Which request an SDO event answers: the series of its master, and a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub(super) u8, pub(super) u32);

listed! {
    /// A step of the boot-up of a node, in their order.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Step {
        /// Reset, and its boot-up message.
        BootUp => "boot-up",
        /// 0x1000 (the first that a silent node does not answer).
        DeviceType => "device type",
        /// A drive is stopped.
        Stop => "stop",
        /// Identity: 0x1018 and further objects.
        Identity => "identity",
        /// Objects written and read back.
        Configuration => "configuration",
        /// PDOs compared.
        Mapping => "PDO mapping",
        /// 0x1016, 0x1017, and the first heartbeat.
        ErrorControl => "error control",
        /// NMT start, and the heartbeat that shows it.
        Start => "start",
    }
}

/// Why a boot-up failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BootError {
    /// An object could not be read or written.
    Sdo {
        /// The object's index.
        index: u16,
        /// The object's sub-index.
        sub: u8,
        /// Why.
        error: sdo::Error,
    },
    /// An object does not hold what it must.
    Mismatch {
        /// The object's index.
        index: u16,
        /// The object's sub-index.
        sub: u8,
        /// The bits that count, as they should be (the least, where more is right too).
        expected: u32,
        /// The bits that count, as they are.
        found: u32,
    },
    /// No heartbeat after the configuration.
    NoHeartbeat,
    /// Started, but in another state.
    NotStarted {
        /// Which.
        state: NmtState,
    },
    /// Unsolicited boot-up messages: the node keeps resetting, or two nodes have the same id.
    Restless,
    /// Two nodes have the same id: requests are answered twice, or heartbeats come twice as often as they may.
    DuplicateId,
    /// An object of more than four bytes, or of another length, does not hold what was written.
    Differs {
        /// The object's index.
        index: u16,
        /// The object's sub-index.
        sub: u8,
    },
}

impl fmt::Display for BootError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sdo { index, sub, error } => write!(f, "0x{index:04X}:{sub} {error}"),
            Self::Mismatch { index, sub, expected, found } => {
                write!(f, "0x{index:04X}:{sub} is 0x{found:X}, expected 0x{expected:X}")
            }
            Self::NoHeartbeat => f.write_str("no heartbeat"),
            Self::NotStarted { state } => write!(f, "does not start, stays {state:?}"),
            Self::Restless => f.write_str("boots again and again, or two nodes have this id"),
            Self::DuplicateId => f.write_str("two nodes have this id"),
            Self::Differs { index, sub } => write!(f, "0x{index:04X}:{sub} does not hold what was written"),
        }
    }
}

/// Why a node that ran is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LostReason {
    /// Heartbeat is missing.
    Heartbeat,
    /// Boot-up message: the node has lost its configuration.
    BootUp,
    /// Heartbeat names another state than Operational.
    State(NmtState),
    /// The host reported that the bus is down.
    BusDown,
    /// [`Master::reboot`](super::Master::reboot) was called.
    Reboot,
    /// No answer to the master's guarding.
    Guarding,
    /// Two nodes have this id.
    DuplicateId,
}

impl fmt::Display for LostReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Heartbeat => f.write_str("heartbeat missing"),
            Self::BootUp => f.write_str("booted by itself"),
            Self::State(state) => write!(f, "went to {state:?}"),
            Self::BusDown => f.write_str("bus down"),
            Self::Reboot => f.write_str("reboot commanded"),
            Self::Guarding => f.write_str("guarding not answered"),
            Self::DuplicateId => f.write_str("two nodes have its id"),
        }
    }
}

/// Sign of another master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // node: the addressed node
pub enum Foreign {
    /// Heartbeat with the master's own id.
    Heartbeat,
    /// NMT command; node 0: to all.
    Nmt { node: u8 },
    /// SYNC.
    Sync,
    /// RPDO: a set-point.
    Rpdo { node: u8 },
    /// SDO request.
    SdoRequest { node: u8 },
}

impl fmt::Display for Foreign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Heartbeat => f.write_str("a heartbeat with the master's node id"),
            Self::Nmt { node: 0 } => f.write_str("an NMT command to all nodes"),
            Self::Nmt { node } => write!(f, "an NMT command to node {node}"),
            Self::Sync => f.write_str("a SYNC"),
            Self::Rpdo { node } => write!(f, "an RPDO to node {node}"),
            Self::SdoRequest { node } => write!(f, "an SDO request to node {node}"),
        }
    }
}

/// What happened on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // node: the node's id
pub enum Event {
    /// The node is who it must be, set up, watched and Operational: PDOs may be sent.
    Booted { node: u8 },
    /// An attempt to boot failed; reported once for each cause. Attempts go on.
    BootFailed { node: u8, step: Step, reason: BootError },
    /// A node that ran is lost, and its PDOs with it; it is booted again.
    Lost { node: u8, reason: LostReason },
    /// Emergency message of a node. In a flood one is reported each 100 ms: the first and, later, the newest;
    /// `suppressed` counts the others.
    Emergency { node: u8, emergency: Emergency, suppressed: u32 },
    /// A TPDO, numbered 1 to 4, of a node that is Operational.
    Pdo { node: u8, number: u8, data: [u8; 8], len: u8 },
    /// An object was read.
    SdoRead { node: u8, ticket: Ticket, index: u16, sub: u8, data: Payload },
    /// An object was written.
    SdoWritten { node: u8, ticket: Ticket, index: u16, sub: u8 },
    /// An object was neither read nor written.
    SdoFailed { node: u8, ticket: Ticket, index: u16, sub: u8, error: sdo::Error },
    /// Number of frames of this node that CANopen does not allow; reported at 1, 2, 4, 8 and so on.
    Malformed { node: u8, count: u32 },
    /// Another master is on the bus: a heartbeat with the master's own id, or a command that this master did not send.
    /// Reported at most every 10 s.
    SecondMaster { by: Foreign },
    /// All mandatory nodes are Operational.
    Ready,
    /// A mandatory node was lost after [`Event::Ready`].
    NotReady,
    /// First frame of an unconfigured node.
    Stranger { node: u8 },
    /// Another device answers with this id: its serial number is not the one seen before. It is configured like any
    /// other before it counts as booted.
    Swapped { node: u8, serial: u32 },
    /// Two nodes have this id, see [`BootError::DuplicateId`], or the node keeps resetting. Reported once until the
    /// node has booted again.
    DuplicateId { node: u8 },
    /// Frames of one node take more of the bus than they may; `rate` a second. Node 0: of no known identifier.
    Babbling { node: u8, rate: u32 },
    /// The babbling has ended.
    BabblingOver { node: u8 },
}

/// Why a PDO was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PdoError {
    /// No node with this id is configured.
    UnknownNode,
    /// The node is not booted, or lost; or the master itself is not Operational.
    NotOperational,
    /// Number of a PDO without an identifier: only 1 to 4 have one.
    Number,
    /// More than 8 bytes.
    TooLong,
    /// The queue is full: the host does not drain it.
    QueueFull,
}

/// Why an SDO request was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestError {
    /// The node id is not within 1..=127, or the master's own.
    UnknownNode,
    /// Too many requests wait for this node, or too many nodes that are not configured are asked.
    QueueFull,
    /// More than [`sdo::MAX_LEN`] bytes.
    TooLong,
}

/// Progress of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Being booted.
    Booting(Step),
    /// The last attempt failed; the next one waits.
    Resting,
    /// Booted, Operational, and its heartbeat is received.
    Operational,
}
