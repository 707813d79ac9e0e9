//! Ports: devices that carry frames or words, opened calmly again and again, and never the end of a module.

mod can_slcan;
mod can_socket;
mod can_udp;
mod evdev;
mod i2c;
mod queue;
mod restart;
mod serial;
pub mod settings;
mod store;
mod threaded;
mod w1;
mod worker;

pub use can_slcan::codec as can_slcan_codec;
pub use can_udp::codec as can_udp_codec;
pub use evdev::GamepadPlace;
pub use evdev::codec as gamepad_codec;
pub use serial::{Direction, Driver, TerminalConfig, Transport};
pub use w1::read as w1_read;

use base::{Duration, Fault, Instant};
use module::{Input, Line, Output};
use std::net::SocketAddrV4;
use std::os::fd::BorrowedFd;
use std::path::PathBuf;
use threaded::Threaded;

/// Where a port is found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortConfig {
    /// The simulator's side of a serial line: a pseudo-terminal that is offered by a link of this name.
    Pseudo {
        /// Made anew, removed at the end.
        link: PathBuf,
        /// Bd, for the time that words take.
        baud: u32,
    },
    /// A serial device.
    Terminal(TerminalConfig),
    /// A CAN bus over UDP multicast, as python-can's `udp_multicast`.
    CanUdp {
        /// Group and port.
        bus: SocketAddrV4,
    },
    /// A CAN adapter on a serial device that speaks the slcan protocol.
    CanSlcan {
        /// The device file: `/dev/ttyACM0`.
        path: PathBuf,
        /// bit/s: 10 000, 20 000, 50 000, 100 000, 125 000, 250 000, 500 000, 800 000 or 1 000 000.
        bitrate: u32,
    },
    /// A CAN interface of the kernel.
    CanSocket {
        /// `can0`.
        interface: String,
    },
    /// A gamepad.
    Gamepad {
        /// Where.
        place: GamepadPlace,
        /// Keeps others from hearing it.
        grab: bool,
    },
    /// The simulator's side of a gamepad: a UNIX socket of this name.
    GamepadHub {
        /// Made anew, removed at the end.
        path: PathBuf,
    },
    /// An I2C adapter of the kernel's.
    I2cDev {
        /// `/dev/i2c-1`.
        path: PathBuf,
    },
    /// An I2C bus on two lines of a GPIO chip.
    I2cGpio {
        /// `/dev/gpiochip0`.
        chip: PathBuf,
        /// The number of the data line.
        sda: u32,
        /// The number of the clock line.
        scl: u32,
        /// Hz.
        hz: u32,
    },
    /// The simulator's I2C bus.
    I2cSocket {
        /// Socket.
        path: PathBuf,
    },
    /// The simulator's side of that.
    I2cServer {
        /// Made anew, removed at the end.
        path: PathBuf,
    },
    /// The kernel's 1-Wire thermometers.
    W1 {
        /// `/sys/bus/w1/devices`.
        folder: PathBuf,
    },
    /// The simulator's side of such.
    W1Folder {
        /// Made anew, removed at the end.
        folder: PathBuf,
    },
    /// A folder for log files.
    Store {
        /// Made with the first file.
        folder: PathBuf,
    },
}

/// What a device had for us.
pub enum Received<'a> {
    /// Nothing more for now.
    Nothing,
    /// For the module.
    Input {
        /// The input.
        input: Input<'a>,
        /// When the kernel received it, where it says so, else when it was read; never after the call's `now`, and not
        /// always after the input before.
        at: Instant,
        /// The kernel's receive time itself, nanoseconds of the wall clock, where it says so.
        stamp: Option<u64>,
    },
    /// Something was wrong with what came; the device goes on.
    Fault(Fault, String),
    /// A line for people.
    Note(String),
}

impl<'a> Received<'a> {
    /// An input for which the kernel gives no receive time.
    pub(crate) fn input(now: Instant, input: Input<'a>) -> Self {
        Self::Input { input, at: now, stamp: None }
    }
}

/// Why a port does not work, in one line.
pub type Lost = String;

/// One kind of port. All calls are non-blocking. `Err` says that the device is lost: it is closed and opened again.
pub trait Device {
    /// Says before it is opened what line the module expects here, and whether it wants everything that passes on it or
    /// only what such a module can use. Unless told it hands out everything.
    fn expect(&mut self, _line: Line, _everything: bool) {}
    /// Opens it; a device that was open is closed first.
    fn open(&mut self) -> Result<(), Lost>;
    /// True if opening failed only because something that it needs is still being done: tried again soon, no news.
    fn is_preparing(&self) -> bool {
        false
    }
    /// Forgets what was to be sent and closes it.
    fn close(&mut self);
    /// To wait for, while it is open.
    fn fd(&self) -> Option<BorrowedFd<'_>>;
    /// True if readiness must be told by its edges: the device stays "hung up" while its other side is closed.
    fn by_edge(&self) -> bool {
        false
    }
    /// Takes one input.
    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost>;
    /// Sends, or queues; what there is no room for is dropped, and false returned.
    fn send(&mut self, now: Instant, output: &Output) -> Result<bool, Lost>;
    /// True if something waits for the device to become writable.
    fn wants_to_write(&self) -> bool {
        false
    }
    /// It has become writable.
    fn on_writable(&mut self, _now: Instant) -> Result<(), Lost> {
        Ok(())
    }
    /// When the last word of the earliest output that [`Device::take_sent`] has not returned will have left the wire.
    fn sent_at(&self) -> Option<Instant> {
        None
    }
    /// True once for each output whose last word has left the wire by `now`.
    fn take_sent(&mut self, _now: Instant) -> bool {
        false
    }
}

/// A port is tried this often in the first second without it: it may be a race with who offers it.
const RETRY_SOON: Duration = Duration::from_millis(20);
const RETRY: Duration = Duration::from_millis(500);

/// A device, or the waiting for it.
pub struct Port {
    /// As the configuration names it, for people: `can.main`.
    pub name: String,
    /// What it is.
    pub device: Box<dyn Device>,
    /// True if it works.
    pub state: PortState,
    /// More may be had without waiting.
    pub more: bool,
    /// The last output was dropped: there was no room for it.
    pub overrun: bool,
    /// What the poller was told: to wait for room to write, too.
    pub polls_write: bool,
    /// Why it could not be opened last.
    why: Lost,
}

/// True if a port works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortState {
    /// It does.
    Up,
    /// It does not, since when; it is tried again at `retry`. `told` tells whether the module knows.
    Down {
        /// Since when.
        since: Instant,
        /// The next try.
        retry: Instant,
        /// True if the module was told.
        told: bool,
    },
}

impl Port {
    /// A port that has not been opened.
    #[must_use]
    pub fn new(name: String, config: PortConfig) -> Self {
        let device: Box<dyn Device> = match config {
            PortConfig::Pseudo { link, baud } => Box::new(serial::Serial::pseudo(link, baud)),
            PortConfig::Terminal(config) => Box::new(serial::Serial::terminal(config)),
            PortConfig::CanUdp { bus } => Box::new(can_udp::CanUdp::new(bus)),
            PortConfig::CanSlcan { path, bitrate } => Box::new(can_slcan::CanSlcan::new(path, bitrate)),
            PortConfig::Gamepad { place, grab } => Box::new(evdev::Gamepad::new(place, grab)),
            PortConfig::GamepadHub { path } => Box::new(evdev::Hub::new(path)),
            PortConfig::CanSocket { interface } => Box::new(can_socket::CanSocket::new(interface)),
            PortConfig::I2cDev { path } => Box::new(i2c::I2c::dev(path)),
            PortConfig::I2cGpio { chip, sda, scl, hz } => Box::new(i2c::I2c::gpio(chip, sda, scl, hz)),
            PortConfig::I2cSocket { path } => Box::new(i2c::Socket::new(path)),
            PortConfig::I2cServer { path } => Box::new(i2c::Server::new(path)),
            PortConfig::W1 { folder } => Box::new(Threaded::new(w1::Thermometers(folder))),
            PortConfig::W1Folder { folder } => Box::new(w1::Folder::new(folder)),
            PortConfig::Store { folder } => Box::new(Threaded::new(store::Files::new(folder))),
        };
        let state = PortState::Down { since: Instant::ZERO, retry: Instant::ZERO, told: false };
        Self { name, device, state, more: false, overrun: false, polls_write: false, why: Lost::new() }
    }

    /// Says what the module expects of it; see [`Device::expect`].
    #[must_use]
    pub fn expecting(mut self, line: Line, everything: bool) -> Self {
        self.device.expect(line, everything);
        self
    }

    /// Closes the device, to be tried again soon.
    pub fn lose(&mut self, now: Instant) {
        self.device.close();
        (self.more, self.polls_write) = (false, false);
        self.state = PortState::Down { since: now, retry: now + RETRY_SOON, told: true };
    }

    /// Tries to open it when that is due. `Some(Err)` the first time that it fails, and when it fails for another
    /// reason.
    pub fn try_open(&mut self, now: Instant) -> Option<Result<(), Lost>> {
        let PortState::Down { since, retry, told } = self.state else {
            return None;
        };
        if now < retry {
            return None;
        }
        match self.device.open() {
            Ok(()) => {
                self.why.clear();
                self.state = PortState::Up;
                self.more = true;
                Some(Ok(()))
            }
            Err(_) if self.device.is_preparing() => {
                self.state = PortState::Down { since, retry: now + RETRY_SOON, told };
                None
            }
            Err(reason) => {
                let since = if since == Instant::ZERO { now } else { since };
                let pause = if now.since(since) < Duration::from_secs(1) { RETRY_SOON } else { RETRY };
                self.state = PortState::Down { since, retry: now + pause, told: true };
                let news = !told || reason != self.why;
                self.why.clone_from(&reason);
                news.then_some(Err(reason))
            }
        }
    }

    /// When it wants to be looked at next.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            PortState::Up => self.device.sent_at(),
            PortState::Down { retry, .. } => Some(retry),
        }
    }

    /// True if all that was sent has left the wire.
    #[must_use]
    pub fn flushed(&self, now: Instant) -> bool {
        self.state != PortState::Up
            || (!self.device.wants_to_write() && self.device.sent_at().is_none_or(|at| at <= now))
    }
}
