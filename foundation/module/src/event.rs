//! Every reason for a module to wake, on one page.

use crate::State;
use base::serial::Word;
use base::{Instant, can, gamepad, i2c, store, w1};
use messages::Message;

/// What happened.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// The first event: the process is up, its ports are being opened.
    Start,
    /// A message on one of the module's channels. `at` is when the kernel received it, on the scale of `now`: a
    /// message that waited while the process was frozen is old.
    Message {
        /// When it was received.
        at: Instant,
        /// What it says.
        message: &'a Message,
    },
    /// Anything that was said on the bus, as its bytes; only to a module that [overhears](crate::Module::overhears). It
    /// comes before the [`Event::Message`] that the same bytes may be.
    Heard {
        /// When it was received.
        at: Instant,
        /// The channel, at most 63 bytes.
        channel: &'a str,
        /// The message, of any type or none.
        data: &'a [u8],
    },
    /// Something from a port.
    Port {
        /// Which.
        port: PortId,
        /// What.
        input: Input<'a>,
    },
    /// News of a process; for the watchdog alone.
    Process(ProcessEvent<'a>),
    /// `Module::poll_timeout` has come.
    Timer,
    /// The module is in this state from now on. After TERMINATE it makes its device safe, and ends as soon as
    /// [`crate::Module::finished`] says so.
    State(State),
}

/// The place of a port in [`crate::Module::ports`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(pub u8);

/// A port that a module needs: which bus, and what a word on it costs. Where the bus is to be found (an interface, a
/// device file, a simulated wire) is the host's topology.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortSpec {
    /// The bus as the configuration names it: `can.main`, `rs485.a`.
    pub bus: String,
    /// What kind of line it is.
    pub line: Line,
}

/// Kinds of lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A CAN bus, at so many bit/s.
    Can {
        /// bit/s.
        bitrate: u32,
    },
    /// A serial line of 9-bit words, 11 bits each on the wire.
    Serial {
        /// Bd.
        baud: u32,
    },
    /// An I2C bus or SMBus, whose clock runs at so many Hz at most.
    I2c {
        /// Hz.
        hz: u32,
    },
    /// A 1-Wire bus with thermometers.
    OneWire,
    /// A gamepad or joystick.
    Gamepad,
    /// A folder for log files.
    Store,
}

/// What a port says.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// It is open: what is sent now leaves.
    Up,
    /// It could not be opened, or is lost; the host goes on trying. One line why.
    Down(&'a str),
    /// A frame was received. On a bus with echo this may be one's own.
    Can(can::Frame),
    /// News of the CAN controller.
    CanNotice(can::Notice),
    /// Words were received, in order.
    Words(&'a [Word]),
    /// The last word of what was sent has left the wire.
    Sent,
    /// What came of a transfer: one for each [`Output::I2c`](crate::Output::I2c), in order. What was on its way when the
    /// port went down has none.
    I2c(&'a i2c::Outcome),
    /// The simulator's end of an I2C bus: the master makes this transfer, and waits for what comes of it.
    I2cAsked(&'a i2c::Transfer),
    /// What came of a request: one for each [`Output::OneWire`](crate::Output::OneWire), in order; none, too, for what
    /// was on its way when the port went down.
    OneWire(&'a w1::Answer),
    /// News of a gamepad. That none is there is news, too, and no [`Input::Down`].
    Gamepad(gamepad::Input<'a>),
    /// What came of a request: one for each [`Output::Store`](crate::Output::Store), in order; none for what was on its
    /// way when the port went down.
    Store(&'a store::Answer),
}

/// News of the processes that the watchdog asked for.
#[derive(Clone, Copy, Debug)]
pub enum ProcessEvent<'a> {
    /// A module's process runs.
    Started {
        /// Which module.
        module: &'a str,
        /// Its process.
        pid: u32,
    },
    /// How an earlier watchdog left a module; told before [`Event::Start`], for each that it remembered
    /// ([`crate::ProcessCommand::Remember`]). Where its process still lives it is this watchdog's from now on.
    Earlier {
        /// Which module.
        module: &'a str,
        /// The state that was wanted of it.
        wanted: State,
        /// Whether only an operator leads it out of TERMINATE into RUN.
        held: bool,
        /// Its process, if that lives.
        pid: Option<u32>,
    },
    /// A module's process could not be started.
    Unstartable {
        /// Which module.
        module: &'a str,
        /// One line why.
        reason: &'a str,
    },
    /// A process is gone.
    Exited {
        /// Which.
        pid: u32,
        /// How it ended.
        status: ExitStatus,
    },
    /// A process has begun to beat: from now on its silence is a hang long before it would be missed on the bus.
    Beating {
        /// Which.
        pid: u32,
    },
    /// A thread of a process that beats is late by a beat or more; told at each look while that lasts.
    Silent {
        /// Which process.
        pid: u32,
        /// The thread that was silent longest, for people.
        thread: &'a str,
        /// When it last beat.
        last: Instant,
    },
    /// What a process beats with cannot be, so it is judged by its announcements; told once.
    BadBeats {
        /// Which.
        pid: u32,
        /// One line why.
        why: &'a str,
    },
    /// What a process uses; about once a second.
    Usage {
        /// Which.
        pid: u32,
        /// Cores: 0.01 is one percent of one.
        cpu: f64,
        /// Resident memory, bytes.
        rss: i64,
    },
}

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitStatus {
    /// By itself, with a code; -1 where nobody could see it.
    Code(i32),
    /// By a signal.
    Signal(i32),
}

impl ExitStatus {
    /// The one number of `process_t.last_exit`: the code, or 128 + the signal.
    #[must_use]
    pub const fn number(self) -> i32 {
        match self {
            Self::Code(code) => code,
            Self::Signal(signal) => 128 + signal,
        }
    }
}
