//! News for observers of a virtual machine.

use base::serial::Word;
use base::{Duration, Instant, Report, i2c, w1};
use messages::Message;
use module::admission::Sender;
use module::{ExitStatus, State};

/// News for an observer.
#[derive(Debug)]
pub enum News<'a> {
    /// A message was sent.
    Message {
        /// Sender; process 0 is the test.
        sender: Sender,
        /// Message.
        message: &'a Message,
    },
    /// A message is served to a subscribed process.
    Heard {
        /// Receiver.
        pid: u32,
        /// Reception time; it may have waited since.
        at: Instant,
        /// Sender, which it accepts.
        sender: Sender,
        /// Message.
        message: &'a Message,
    },
    /// A CAN frame was sent.
    Can {
        /// The bus.
        bus: &'a str,
        /// Process of the sender; 0: a node that is no process's.
        pid: u32,
        /// The frame.
        frame: base::can::Frame,
    },
    /// A CAN frame was sent, but no node received it ([`Config::can_loss`](super::Config::can_loss), fault `lose`).
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
    /// A report of a module.
    Report {
        /// Module.
        module: &'a str,
        /// Report.
        report: &'a Report,
    },
    /// A printed text of a module.
    Note {
        /// Module.
        module: &'a str,
        /// The line.
        line: &'a str,
    },
    /// A module changed its state.
    State {
        /// Module.
        module: &'a str,
        /// New state.
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
    /// A hung process continues; its pending input follows.
    Resumed {
        /// Module.
        module: &'a str,
        /// Number.
        pid: u32,
    },
    /// A process is slow from now on.
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
        /// End; [`Instant::NEVER`]: until it is removed.
        until: Instant,
    },
    /// Dropped data: frames in the queue of a CAN port, input in that of a process.
    Dropped {
        /// Bus or module.
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
    /// Transfers and requests that did not fit into a queue; CAN frames that did not fit, became too old, or were
    /// queued when the sender went bus-off.
    pub dropped: u64,
    /// CAN frames destroyed by an error on the wire, which are retransmitted; failed transfers.
    pub errors: u64,
    /// Serial transmissions that began during another one.
    pub collisions: u64,
    /// Time that the wire was busy.
    pub busy: Duration,
}
