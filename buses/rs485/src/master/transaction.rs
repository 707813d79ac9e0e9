//! The words of the master's caller: its configuration, what is asked, what comes of it.

use crate::Data;
use crate::crc::Crc8;
use crate::frame::Status;
use crate::instruction::Instruction;
use base::Duration;
use base::Instant;

/// Configuration of a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// bit/s on the wire.
    pub baud: u32,
    /// The bus's CRC.
    pub crc: Crc8,
    /// Default time limit of an answer, from the request's last bit to the answer's last.
    pub timeout: Duration,
    /// Number of retries before a transaction has failed. A lost node is asked once only.
    pub retries: u8,
    /// Time limit for the host to send, beyond the duration on the wire; and longest wait for a sender that never falls
    /// silent.
    pub patience: Duration,
    /// True if both ends may talk at once, as on the link to the PSC1: no silence is owed before a request then.
    pub full_duplex: bool,
    /// Unsolicited messages that nodes may send; `answer` gives the lengths of their data.
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

/// Defect of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The answer's CRC.
    Crc,
    /// The answer's length is not one that the instruction allows.
    Length {
        /// Data bytes of the answer.
        got: u8,
    },
    /// Unknown status.
    Status {
        /// The byte.
        got: u8,
    },
    /// Words came, but no whole frame.
    Incomplete,
    /// The node reports a wrong CRC of the request.
    Request,
}

/// Event of the bus. A silent board is an event, not an error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The node answered. Only with [`Status::Ok`] has it done what was asked.
    Reply {
        /// Node.
        to: u8,
        /// Instruction.
        instruction: u8,
        /// When the request that it executed began to be sent: it measured what it answers after that.
        asked: Instant,
        /// Status; never [`Status::BadCrc`].
        status: Status,
        /// The answer's data.
        data: Data,
    },
    /// A request that is not answered has left the wire.
    Sent {
        /// Node.
        to: u8,
        /// Instruction.
        instruction: u8,
    },
    /// Transaction failed: no reception in the last attempt.
    Silent {
        /// Node.
        to: u8,
        /// Instruction.
        instruction: u8,
    },
    /// Transaction failed: damaged reception in the last attempt.
    Garbled {
        /// Node.
        to: u8,
        /// Instruction.
        instruction: u8,
        /// Defect.
        why: Why,
    },
    /// The host did not send the request in time. The node is not blamed.
    Unsent {
        /// Node.
        to: u8,
        /// Instruction.
        instruction: u8,
    },
    /// The node's error counter reached 96. Reported once until [`Event::Recovered`] or [`Event::Back`].
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
    /// Unsolicited message of a node, permitted by [`Config::unasked`], with a valid length and CRC.
    Unasked {
        /// Sender.
        from: u8,
        /// Instruction.
        instruction: u8,
        /// The frame's data.
        data: Data,
    },
    /// Unsolicited traffic (babbling). Reported once until its [`Event::BabbleOver`].
    Babble {
        /// Address in the frames; `None` if they are no frames.
        who: Option<u8>,
    },
    /// No unsolicited traffic of this sender for a second. Reported with the next request.
    BabbleOver {
        /// Sender.
        who: Option<u8>,
    },
    /// Two devices seem to have one address. Reported once until [`Event::ClashOver`].
    Clash {
        /// The address.
        node: u8,
        /// True if two answers were separated. If false, only this node's answers are damaged repeatedly: two devices
        /// that send at once, or one with a bad transmitter.
        certain: bool,
    },
    /// A single device answers at this address again, without damage.
    ClashOver {
        /// The address.
        node: u8,
    },
}

/// Counters of the whole bus since the start.
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
    /// Unsolicited words.
    pub surplus_words: u64,
}
