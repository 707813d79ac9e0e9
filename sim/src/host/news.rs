//! What observers of a virtual machine are told.

use base::serial::Word;
use base::{Duration, Instant, Report, i2c, w1};
use messages::Message;
use module::{ExitStatus, State};

/// What an observer is told.
#[derive(Debug)]
pub enum News<'a> {
    /// A message was sent; process 0 is the test.
    Message {
        /// By whom.
        pid: u32,
        /// What.
        message: &'a Message,
    },
    /// A message is served to a process that wants it.
    Heard {
        /// To whom.
        pid: u32,
        /// When it was received; it may have waited since.
        at: Instant,
        /// Message.
        message: &'a Message,
    },
    /// A CAN frame has left the wire.
    Can {
        /// The bus.
        bus: &'a str,
        /// The frame.
        frame: base::can::Frame,
    },
    /// A CAN frame has left the wire, and no node received it ([`Config::can_loss`](super::Config::can_loss), fault
    /// `lose`).
    CanLost {
        /// The bus.
        bus: &'a str,
        /// The frame.
        frame: base::can::Frame,
    },
    /// Words have arrived on a serial bus.
    Words {
        /// The bus.
        bus: &'a str,
        /// Process.
        pid: u32,
        /// The words.
        words: &'a [Word],
    },
    /// A transfer on an I2C bus has ended.
    I2c {
        /// The bus.
        bus: &'a str,
        /// Transfer.
        transfer: &'a i2c::Transfer,
        /// Outcome.
        outcome: &'a i2c::Outcome,
    },
    /// A request on a 1-Wire bus is answered.
    OneWire {
        /// The bus.
        bus: &'a str,
        /// Answer.
        answer: &'a w1::Answer,
    },
    /// A module reported.
    Report {
        /// Which.
        module: &'a str,
        /// Report.
        report: &'a Report,
    },
    /// A module prints a line.
    Note {
        /// Which.
        module: &'a str,
        /// The line.
        line: &'a str,
    },
    /// A module changed its state.
    State {
        /// Which.
        module: &'a str,
        /// To what.
        state: State,
    },
    /// A process was started.
    Started {
        /// Module.
        module: &'a str,
        /// Number.
        pid: u32,
    },
    /// A process ended.
    Exited {
        /// Module.
        module: &'a str,
        /// Number.
        pid: u32,
        /// Exit status.
        status: ExitStatus,
    },
    /// A process hangs from now on.
    Hung {
        /// Module.
        module: &'a str,
        /// Number.
        pid: u32,
    },
    /// A process that hung goes on; what waited for it follows.
    Resumed {
        /// Module.
        module: &'a str,
        /// Number.
        pid: u32,
    },
    /// A process crawls from now on.
    Crawls {
        /// Module.
        module: &'a str,
        /// Number.
        pid: u32,
        /// Latency; zero: normal again.
        late: Duration,
    },
    /// A fault of a bus, a board or a drive begins or ends.
    Fault {
        /// Target.
        target: &'a str,
        /// Name, as in `SIM_CMD_FAULT`.
        fault: &'a str,
        /// Until when; [`Instant::NEVER`]: until it is taken away.
        until: Instant,
    },
    /// Something found no room: frames in the queue of a CAN port, input in that of a process.
    Dropped {
        /// The bus, or the module.
        whose: &'a str,
        /// Number.
        count: u64,
    },
}

/// Traffic on a bus since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// CAN frames that left the wire, words put on it, completed transfers and requests.
    pub sent: u64,
    /// Transfers and requests that found a queue full; CAN frames that did, grew old in it, or were in it when the
    /// sender went bus-off.
    pub dropped: u64,
    /// CAN frames that were destroyed by an error on the wire, and are sent again; transfers that failed.
    pub errors: u64,
    /// Serial talk that began while another talked.
    pub collisions: u64,
    /// Time that the wire was busy.
    pub busy: Duration,
}
