//! All reasons for a module to wake, on one page.

use crate::State;
use crate::admission::Origin;
use base::serial::Word;
use base::{Duration, Instant, can, gamepad, gpio, i2c, store, thermal, w1};
use messages::Message;

/// Event for a module.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// The first event: the process is up, its ports are being opened.
    Start,
    /// A message on one of the module's channels. `at` is the kernel's receive time, on the scale of `now`: a message
    /// that waited while the process was frozen is old.
    Message {
        /// Time of reception.
        at: Instant,
        /// Who sent it, as far as a module treats senders differently.
        from: Origin,
        /// Content.
        message: &'a Message,
    },
    /// Any message on the bus, as its bytes; only for a module that [wants the raw bus](crate::Module::wants_raw_bus).
    /// Precedes the [`Event::Message`] of the same bytes.
    RawMessage {
        /// Time of reception.
        at: Instant,
        /// Name of the channel, at most 63 bytes.
        channel: &'a str,
        /// Payload, of any type or of none that is known.
        data: &'a [u8],
    },
    /// An input of a port.
    Port {
        /// Index of the port.
        port: PortId,
        /// The input.
        input: Input<'a>,
    },
    /// News of a process; watchdog only.
    Process(ProcessEvent<'a>),
    /// The deadline of `Module::poll_timeout` has passed.
    Timer,
    /// The module is in this state from now on. After TERMINATE it makes its device safe, and ends as soon as
    /// [`crate::Module::finished`] returns true.
    State(State),
}

/// Index of a port in [`crate::Module::ports`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(pub u8);

/// A port that a module needs: the bus, and the time that a word takes on it. The location of the bus (an interface, a
/// device file, a simulated wire) is up to the host's topology.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortSpec {
    /// Name of the bus in the configuration: `can.main`, `rs485.a`.
    pub bus: String,
    /// Kind of line.
    pub line: Line,
}

/// Kinds of lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A CAN bus.
    Can {
        /// Bit rate, bit/s.
        bitrate: u32,
    },
    /// A serial line of words, 11 bits each on the wire: nine data bits, or eight, whose words have no ninth bit, and a
    /// parity or second stop bit. A TCP connection is one of eight bits.
    Serial {
        /// Rate, Bd.
        baud: u32,
    },
    /// An I2C bus or SMBus.
    I2c {
        /// Maximum clock frequency, Hz.
        hz: u32,
    },
    /// A 1-Wire bus with thermometers.
    OneWire,
    /// Temperatures of the computer.
    Thermal,
    /// A gamepad or joystick.
    Gamepad,
    /// A digital output or input of the computer.
    Gpio,
    /// A folder for log files.
    Store,
}

/// Input of a port.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// The port is open: output is sent.
    Up,
    /// The port could not be opened, or is lost; the host keeps retrying. Reason in one line.
    Down(&'a str),
    /// A received frame. On a bus with echo it may be an own one.
    Can {
        /// The frame.
        frame: can::Frame,
        /// Kernel's receive time, on the scale of `now`, and not after it: a frame that waited while the process was
        /// frozen is old. If the kernel gives none, the time of reading.
        at: Instant,
    },
    /// News of the CAN controller.
    CanNotice(can::Notice),
    /// Received words, in order.
    Words(&'a [Word]),
    /// The last word of an output has left the wire.
    Sent,
    /// Outcome of a transfer: one for each [`Output::I2c`](crate::Output::I2c), in order. Transfers pending when the
    /// port went down have none.
    I2c(&'a i2c::Outcome),
    /// The simulator's end of an I2C bus: the master requests this transfer and waits for its outcome.
    I2cRequested(&'a i2c::Transfer),
    /// Answer to a request: one for each [`Output::OneWire`](crate::Output::OneWire), in order. Requests pending when
    /// the port went down have none.
    OneWire(&'a w1::Answer),
    /// Temperatures of the computer: one for each [`Output::Thermal`](crate::Output::Thermal), in order. Requests
    /// pending when the port went down have none. At the simulator's end: what was written.
    Thermal(&'a thermal::State),
    /// News of a gamepad. An absent gamepad is news, too, and not [`Input::Down`].
    Gamepad(gamepad::Input<'a>),
    /// Level of a digital output or input: one for each [`Output::Gpio`](crate::Output::Gpio), in order, and one for
    /// each edge of an input. Requests pending if the port went down have none. At the simulator's end: what the owner
    /// sends.
    Gpio(gpio::Signal),
    /// Answer to a request: one for each [`Output::Store`](crate::Output::Store), in order. Requests pending when the
    /// port went down have none.
    Store(&'a store::Answer),
}

/// News of the processes that the watchdog requested.
#[derive(Clone, Copy, Debug)]
pub enum ProcessEvent<'a> {
    /// A module's process was started.
    Started {
        /// Name of the module.
        module: &'a str,
        /// Its process id.
        pid: u32,
    },
    /// State in which an earlier watchdog left a module; reported before [`Event::Start`] for each module that it
    /// remembered ([`crate::ProcessCommand::Remember`]). A process that is still alive belongs to this watchdog from
    /// now on.
    Earlier {
        /// Name of the module.
        module: &'a str,
        /// Its wanted state.
        wanted: State,
        /// True if only an operator leads it out of TERMINATE into RUN.
        held: bool,
        /// Its process id, if it is alive.
        pid: Option<u32>,
    },
    /// A module's process could not be started.
    Unstartable {
        /// Name of the module.
        module: &'a str,
        /// Reason in one line.
        reason: &'a str,
    },
    /// A process has ended.
    Exited {
        /// Process id.
        pid: u32,
        /// Exit status.
        status: ExitStatus,
    },
    /// A process has started to send heartbeats: from now on its silence is a hang, long before its announcement is
    /// missed.
    HeartbeatStarted {
        /// Process id.
        pid: u32,
    },
    /// The heartbeat of a thread is late by a period or more; reported at each check while that lasts.
    HeartbeatLate {
        /// Process id.
        pid: u32,
        /// Name of the thread that was silent longest, for people.
        thread: &'a str,
        /// Time of its last heartbeat.
        last: Instant,
    },
    /// The heartbeat page of a process is invalid, so the process is judged by its announcements; reported once.
    BadHeartbeat {
        /// Process id.
        pid: u32,
        /// Reason in one line.
        why: &'a str,
    },
    /// The host's own check of the heartbeats came late; reported at each such check.
    CheckLate {
        /// Delay beyond the period of the checks.
        by: Duration,
    },
    /// Load of a process; about once a second.
    Usage {
        /// Process id.
        pid: u32,
        /// Processor time, cores: 0.01 is one percent of one core.
        cpu: f64,
        /// Resident memory, bytes.
        rss: i64,
    },
}

/// Exit status of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitStatus {
    /// Exit code; -1 if it is unknown.
    Code(i32),
    /// Number of the signal that ended it.
    Signal(i32),
}

impl ExitStatus {
    /// Single number of `process_t.last_exit`: the code, or 128 + the signal.
    #[must_use]
    pub const fn number(self) -> i32 {
        match self {
            Self::Code(code) => code,
            Self::Signal(signal) => 128 + signal,
        }
    }
}
