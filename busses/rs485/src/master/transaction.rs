//! The words of the master's caller: its configuration, what is asked, what comes of it.

use crate::Data;
use crate::boards::Instruction;
use crate::crc::Crc8;
use crate::frame::Status;
use base::Duration;

/// What a master needs to know of its bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// bit/s on the wire.
    pub baud: u32,
    /// The bus's CRC.
    pub crc: Crc8,
    /// How long a node may take to answer, from the request's last bit to the answer's last, unless its own entry
    /// says otherwise.
    pub timeout: Duration,
    /// How often a request is repeated before the transaction has failed. A lost node is asked once only.
    pub retries: u8,
    /// How long the host may take to send, beyond the wire's own time; and how long a talker that never falls silent
    /// is waited for.
    pub patience: Duration,
    /// Whether both ends may talk at once, as on the link to the PSC1: no silence is owed before a request then.
    pub full_duplex: bool,
    /// What nodes may send by themselves; `answer` is which lengths its data may have.
    pub unasked: &'static [Instruction],
}

impl Default for Config {
    /// 115200 Bd, the default CRC, 20 ms, 2 retries, 100 ms; half-duplex, and nothing unasked.
    fn default() -> Self {
        Self {
            baud: 115_200,
            crc: Crc8::SAE_J1850,
            timeout: Duration::from_millis(20),
            retries: 2,
            patience: Duration::from_millis(100),
            full_duplex: false,
            unasked: &[],
        }
    }
}

/// Which lengths an answer's data may have: every `step`-th number of bytes from `min` to `max`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lengths {
    /// Fewest bytes.
    pub min: u8,
    /// Most bytes.
    pub max: u8,
    /// Distance of two allowed lengths; 0 counts as 1.
    pub step: u8,
}

impl Lengths {
    /// Any length.
    pub const ANY: Self = Self::between(0, 255);
    /// No data.
    pub const NONE: Self = Self::exactly(0);

    /// This length only.
    #[must_use]
    pub const fn exactly(length: u8) -> Self {
        Self { min: length, max: length, step: 1 }
    }

    /// Any length from `min` to `max`.
    #[must_use]
    pub const fn between(min: u8, max: u8) -> Self {
        Self { min, max, step: 1 }
    }

    /// Whether data of `length` bytes is allowed.
    #[must_use]
    pub fn allow(self, length: usize) -> bool {
        let (min, max, step) = (usize::from(self.min), usize::from(self.max), usize::from(self.step.max(1)));
        (min..=max).contains(&length) && (length - min).is_multiple_of(step)
    }
}

/// What is asked of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request<'a> {
    /// The node; [`BROADCAST`](crate::frame::BROADCAST) is never answered.
    pub to: u8,
    /// The instruction.
    pub instruction: u8,
    /// At most [`MAX_DATA`](crate::frame::MAX_DATA) bytes.
    pub data: &'a [u8],
    /// Ask the node not to answer.
    pub no_ack: bool,
    /// Which lengths a good answer may have; another one counts as damaged.
    pub answer: Lengths,
}

impl<'a> Request<'a> {
    /// A request that is answered, by any number of bytes.
    #[must_use]
    pub const fn new(to: u8, instruction: u8, data: &'a [u8]) -> Self {
        Self { to, instruction, data, no_ack: false, answer: Lengths::ANY }
    }
}

/// Why a request was refused. Nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestError {
    /// A transaction is outstanding: ask again after its event.
    Busy,
    /// More data than a frame carries.
    TooLong {
        /// Bytes given.
        len: usize,
        /// Bytes allowed.
        max: usize,
    },
}

/// What is wrong with what a node answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The answer's CRC.
    Crc,
    /// The answer's length is not one that the instruction allows.
    Length {
        /// Data bytes of the answer.
        got: u8,
    },
    /// The answer's status is none.
    Status {
        /// The byte.
        got: u8,
    },
    /// Words came, but no whole frame.
    Incomplete,
    /// The node says that the request's CRC was wrong.
    Request,
}

/// What the bus did. A silent board is news, not our failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The node answered. Only with [`Status::Ok`] has it done what was asked.
    Reply {
        /// Who was asked.
        to: u8,
        /// What was asked.
        instruction: u8,
        /// What it says of it; never [`Status::BadCrc`].
        status: Status,
        /// The answer's data.
        data: Data,
    },
    /// A request that is not answered has left the wire.
    Sent {
        /// Who was told.
        to: u8,
        /// What.
        instruction: u8,
    },
    /// The transaction failed: nothing was heard, at the last attempt.
    Silent {
        /// Who was asked.
        to: u8,
        /// What was asked.
        instruction: u8,
    },
    /// The transaction failed: what was heard, at the last attempt, was damaged.
    Garbled {
        /// Who was asked.
        to: u8,
        /// What was asked.
        instruction: u8,
        /// How.
        why: Why,
    },
    /// The host did not send the request in time. The node is not blamed.
    Unsent {
        /// Who was to be asked.
        to: u8,
        /// What.
        instruction: u8,
    },
    /// The node's error counter reached 96. Said once until [`Event::Recovered`] or [`Event::Back`].
    Degraded {
        /// Which node.
        node: u8,
    },
    /// The error counter of a node that was degraded is back at 0.
    Recovered {
        /// Which node.
        node: u8,
    },
    /// The node's error counter reached 128: ask it once a second only.
    Lost {
        /// Which node.
        node: u8,
    },
    /// A lost node answered; it may have been exchanged: ask its version.
    Back {
        /// Which node.
        node: u8,
    },
    /// A node said by itself what [`Config::unasked`] lets it say; its length is allowed, its CRC right.
    Unasked {
        /// Who says so.
        from: u8,
        /// What.
        instruction: u8,
        /// The frame's data.
        data: Data,
    },
    /// Somebody talks whom nobody asked. Said once until its [`Event::BabbleOver`].
    Babble {
        /// The address that stands in its frames; none when what it says is no frame.
        who: Option<u8>,
    },
    /// For a second this one talked unasked no more. Told with the next request.
    BabbleOver {
        /// Who it was.
        who: Option<u8>,
    },
    /// Two devices seem to have one address. Said once until [`Event::ClashOver`].
    Clash {
        /// The address.
        node: u8,
        /// Whether two were told apart. If not, only this node's answers are damaged again and again: two that talk at
        /// once, or one whose transmitter is bad.
        certain: bool,
    },
    /// One device answers at this address again, and well.
    ClashOver {
        /// The address.
        node: u8,
    },
}

/// What passed on the whole bus since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusStatistics {
    /// Words sent and received: times [`word_time`](crate::word_time), how long the wire was busy.
    pub words: u64,
    /// Frames sent, and received with a right CRC.
    pub frames: u64,
    /// Whole frames that no transaction was waiting for: late answers, other talkers.
    pub stray_frames: u64,
    /// Attempts that were answered by nothing or by damaged words.
    pub errors: u64,
    /// Requests that the host did not send in time.
    pub unsent: u64,
    /// Words that nobody was asked for.
    pub surplus_words: u64,
}
