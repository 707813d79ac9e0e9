//! Commands and events of an LSS master.

use super::wire::Confirm;
use super::{Address, BitRate, Mode};
use base::Duration;

/// Time limits of the master.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// For the answer to a request (100 ms).
    pub answer: Duration,
    /// For the answers to one question of a fastscan or an identification, always in full (20 ms): more than one slave
    /// may answer, and an answer that comes later is taken for that to the next question. Each repetition of a scan
    /// takes twice as long. Slow slaves and a bus full of them need more.
    pub scan: Duration,
    /// After a frame that is not answered (2 ms); there are slaves that cannot take the next one at once.
    pub gap: Duration,
    /// Number of attempts for an unanswered request, 1 to 8 (3).
    pub attempts: u8,
}

impl Default for Timing {
    fn default() -> Self {
        let millis = Duration::from_millis;
        Self { answer: millis(100), scan: millis(20), gap: millis(2), attempts: 3 }
    }
}

/// Which slaves [`Command::Identify`] means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // bounds are part of it
pub struct Range {
    pub vendor: u32,
    pub product: u32,
    pub revision: (u32, u32),
    pub serial: (u32, u32),
}

/// Commands. Those from [`Self::InquireAddress`] on address the slave in the configuration state; selecting one is up
/// to the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Switches all slaves to a state. A slave with a new node id boots when it goes to waiting.
    SwitchGlobal(Mode),
    /// Switches this slave to the configuration state, all others to waiting.
    Select(Address),
    /// The slave without node id with the lowest address into the configuration state, all others to waiting: one
    /// [`Event::Found`].
    Find,
    /// As [`Self::Find`] until no further slave answers, at most 127 times; at the end all are waiting.
    /// [`Event::Found`] for each.
    FindAll,
    /// Is there a slave within this range? [`Event::Present`].
    Identify(Range),
    /// Is there a slave without node id? [`Event::Present`].
    IdentifyNonConfigured,
    /// [`Event::Address`].
    InquireAddress,
    /// [`Event::NodeId`].
    InquireNodeId,
    /// 1 to 127, or [`super::UNCONFIGURED`] to have none. In use when the slave resets its communication; a slave
    /// without node id does when it goes to waiting.
    SetNodeId(u8),
    /// In use after [`Self::Activate`], or when stored, after power-on.
    SetBitRate(BitRate),
    /// All slaves in the configuration state change their bit rate; the bus must be silent for `delay_ms` before and
    /// after. Between them comes [`Event::SwitchNow`].
    Activate {
        /// ms.
        delay_ms: u16,
    },
    /// Stores node id and bit rate permanently.
    Store,
}

/// Why a command was not taken. Nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartError {
    /// Another one runs.
    Busy,
    /// Neither 1 to 127 nor [`super::UNCONFIGURED`].
    NodeId,
}

/// Refusal by a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// To a node id: out of range.
    NodeIdOutOfRange,
    /// To a bit rate.
    BitRateNotSupported,
    /// Storing is not supported.
    StoreNotSupported,
    /// Storing failed: the medium is faulty.
    StorageAccess,
    /// The manufacturer's own reason.
    Specific(u8),
    /// A code that the standard does not name.
    Other(u8),
}

/// Why a command did not succeed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// No answer to any attempt.
    NoAnswer,
    /// Refused by the slave.
    Refused(Refusal),
    /// The answers to a scan contradict each other each time: frames are lost, answers are late, or a slave answers
    /// foreign requests. Earlier results stay valid.
    Contradiction,
}

/// Events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A slave without node id.
    Found(Address),
    /// The answer to [`Command::Identify`] and [`Command::IdentifyNonConfigured`].
    Present(bool),
    /// The answer to [`Command::InquireAddress`].
    Address(Address),
    /// The answer to [`Command::InquireNodeId`]; `None`: it has none.
    NodeId(Option<u8>),
    /// The master's own controller changes its bit rate now.
    SwitchNow,
    /// The command is done. The next one may start.
    Done(Command),
    /// The command failed. The next one may start.
    Failed(Command, Failure),
}

impl Range {
    /// Limits in the order of [`super::wire::Bound`].
    pub(super) fn bounds(&self) -> [u32; 6] {
        let Self { vendor, product, revision, serial } = *self;
        [vendor, product, revision.0, revision.1, serial.0, serial.1]
    }
}

impl Refusal {
    pub(super) fn of(command: Command, Confirm { error, specific }: Confirm) -> Self {
        match (command, error) {
            (_, 0xFF) => Self::Specific(specific),
            (Command::SetNodeId(_), 1) => Self::NodeIdOutOfRange,
            (Command::SetBitRate(_), 1) => Self::BitRateNotSupported,
            (Command::Store, 1) => Self::StoreNotSupported,
            (Command::Store, 2) => Self::StorageAccess,
            (_, other) => Self::Other(other),
        }
    }
}
