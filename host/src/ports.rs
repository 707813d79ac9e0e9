//! Ports: devices that carry frames or words. Reopened with a fixed back-off; a lost port never ends its module.

mod can_slcan;
mod can_socket;
mod can_udp;
mod evdev;
mod gpio;
mod i2c;
mod queue;
mod restart;
mod serial;
pub mod settings;
mod store;
mod tcp;
mod thermal;
mod threaded;
mod w1;
mod worker;

pub use can_slcan::codec as can_slcan_codec;
pub use can_udp::codec as can_udp_codec;
pub use evdev::GamepadPlace;
pub use evdev::codec as gamepad_codec;
pub use gpio::{GpioConfig, GpioInput};
pub use serial::{ByteParity, Direction, Driver, TerminalConfig, Transport};
pub use store::disk::Disk;
pub use tcp::begin as begin_tcp;
pub use thermal::read as thermal_read;
pub use w1::read as w1_read;

use base::{Duration, Fault, Instant};
use module::{Input, Line, Output};
use std::net::{SocketAddr, SocketAddrV4};
use std::os::fd::BorrowedFd;
use std::path::PathBuf;
use threaded::Threaded;

/// Kind and address of a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortConfig {
    /// The simulator's end of a serial line: a pseudo-terminal reached by a link of this name.
    Pseudo {
        /// Created anew, removed at the end.
        link: PathBuf,
        /// Bd; determines the transmission time of words.
        baud: u32,
    },
    /// The same, for a line of bytes.
    PseudoBytes {
        /// Created anew, removed at the end.
        link: PathBuf,
        /// Bd; determines the transmission time of characters.
        baud: u32,
    },
    /// A serial device.
    Terminal(TerminalConfig),
    /// A TCP connection to a device, whose bytes are words without the ninth bit.
    Tcp {
        /// The device.
        address: SocketAddr,
    },
    /// The simulator's end of a TCP connection.
    TcpServer {
        /// An address of this computer.
        address: SocketAddr,
    },
    /// A CAN bus over UDP multicast, as python-can's `udp_multicast`.
    CanUdp {
        /// Group and port.
        bus: SocketAddrV4,
    },
    /// A CAN adapter on a serial device that speaks the slcan protocol.
    CanSlcan {
        /// Device file, `/dev/ttyACM0`.
        path: PathBuf,
        /// bit/s: 10 000, 20 000, 50 000, 100 000, 125 000, 250 000, 500 000, 800 000 or 1 000 000.
        bitrate: u32,
    },
    /// A CAN interface of the kernel.
    CanSocket {
        /// Name of the interface, `can0`.
        interface: String,
    },
    /// A gamepad.
    Gamepad {
        /// Source of its events.
        place: GamepadPlace,
        /// Grab the device, so that no other program receives its events.
        grab: bool,
    },
    /// The simulator's end of a gamepad: a UNIX socket of this name.
    GamepadHub {
        /// Created anew, removed at the end.
        path: PathBuf,
    },
    /// A line of a GPIO chip as an output.
    Gpio(GpioConfig),
    /// A line of a GPIO chip as an input.
    GpioInput(GpioInput),
    /// The simulator's line.
    GpioSocket {
        /// Created anew, removed at the end.
        path: PathBuf,
        /// True for the simulator's end.
        simulated: bool,
    },
    /// An I2C adapter of the kernel.
    I2cDev {
        /// Device file, `/dev/i2c-1`.
        path: PathBuf,
    },
    /// An I2C bus on two lines of a GPIO chip.
    I2cGpio {
        /// Device file, `/dev/gpiochip0`.
        chip: PathBuf,
        /// Number of the data line.
        sda: u32,
        /// Number of the clock line.
        scl: u32,
        /// Clock frequency, Hz.
        hz: u32,
    },
    /// The simulator's I2C bus, as a client.
    I2cSocket {
        /// Path of the socket.
        path: PathBuf,
    },
    /// The simulator's end of its I2C bus.
    I2cServer {
        /// Created anew, removed at the end.
        path: PathBuf,
    },
    /// The kernel's 1-Wire thermometers.
    W1 {
        /// Folder of the devices, `/sys/bus/w1/devices`.
        folder: PathBuf,
    },
    /// The simulator's end of 1-Wire thermometers.
    W1Folder {
        /// Created anew, removed at the end.
        folder: PathBuf,
    },
    /// The kernel's temperatures of the computer.
    Thermal {
        /// `/sys`.
        folder: PathBuf,
    },
    /// The simulator's end of temperatures of the computer.
    ThermalFolder {
        /// Created anew, removed at the end.
        folder: PathBuf,
    },
    /// A folder for log files.
    Store {
        /// Created with the first file.
        folder: PathBuf,
    },
}

/// Result of reading a device.
pub enum Received<'a> {
    /// Empty: nothing more for now.
    Nothing,
    /// An input for the module.
    Input {
        /// The input.
        input: Input<'a>,
        /// Receive time of the kernel if available, else the time of reading; never after the call's `now`, and not
        /// necessarily after the previous input's.
        at: Instant,
        /// Receive time of the kernel itself, nanoseconds of the wall clock, if available.
        stamp: Option<u64>,
    },
    /// Invalid input; the device stays open.
    Fault(Fault, String),
    /// A note for people.
    Note(String),
}

impl<'a> Received<'a> {
    /// An input without a receive time of the kernel.
    pub(crate) fn input(now: Instant, input: Input<'a>) -> Self {
        Self::Input { input, at: now, stamp: None }
    }
}

/// Reason why a port does not work, in one line.
pub type Lost = String;

/// One kind of port. No call blocks. `Err` means that the device is lost: it is closed and reopened.
pub trait Device {
    /// Called before opening: the line's format that the module expects, and whether it wants all traffic or only what
    /// such a module can use. Without this call all traffic is delivered.
    fn expect(&mut self, _line: Line, _everything: bool) {}
    /// Opens the device; an open device is closed first.
    fn open(&mut self) -> Result<(), Lost>;
    /// True if opening failed only because a preparation is still running: retried soon, not reported.
    fn is_preparing(&self) -> bool {
        false
    }
    /// Discards pending output and closes the device.
    fn close(&mut self);
    /// Descriptor to wait for, while open.
    fn fd(&self) -> Option<BorrowedFd<'_>>;
    /// True if readiness must be edge-triggered: the device stays "hung up" while its other end is closed.
    fn by_edge(&self) -> bool {
        false
    }
    /// Reads one input.
    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost>;
    /// Sends or queues an output. Returns false if the queue is full and the output was dropped.
    fn send(&mut self, now: Instant, output: &Output) -> Result<bool, Lost>;
    /// True if output waits for the device to become writable.
    fn wants_to_write(&self) -> bool {
        false
    }
    /// The device became writable.
    fn on_writable(&mut self, _now: Instant) -> Result<(), Lost> {
        Ok(())
    }
    /// Time at which the last word of the earliest output not yet returned by [`Device::take_sent`] will have left the
    /// wire.
    fn sent_at(&self) -> Option<Instant> {
        None
    }
    /// True once for each output whose last word has left the wire by `now`.
    fn take_sent(&mut self, _now: Instant) -> bool {
        false
    }
}

/// Retry period in the first second after a loss, which may be a race with the program that offers the device.
const RETRY_SOON: Duration = Duration::from_millis(20);
const RETRY: Duration = Duration::from_millis(500);

/// A device and its state.
pub struct Port {
    /// Name in the configuration, for people: `can.main`.
    pub name: String,
    /// The device.
    pub device: Box<dyn Device>,
    /// State of the port.
    pub state: PortState,
    /// More input may be available without waiting.
    pub more: bool,
    /// The last output was dropped because the queue was full.
    pub overrun: bool,
    /// The descriptor is registered for writing too.
    pub polls_write: bool,
    /// Reason of the last failure to open.
    why: Lost,
}

/// State of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortState {
    /// Working.
    Up,
    /// Not working; the next attempt is at `retry`.
    Down {
        /// Time of the loss.
        since: Instant,
        /// Time of the next attempt.
        retry: Instant,
        /// True if the module was informed.
        reported: bool,
    },
}

impl Port {
    /// Creates a port that is closed.
    #[must_use]
    pub fn new(name: String, config: PortConfig) -> Self {
        let device: Box<dyn Device> = match config {
            PortConfig::Pseudo { link, baud } => Box::new(serial::Serial::pseudo(link, baud)),
            PortConfig::PseudoBytes { link, baud } => Box::new(serial::Serial::pseudo_bytes(link, baud)),
            PortConfig::Terminal(config) => Box::new(serial::Serial::terminal(config)),
            PortConfig::Tcp { address } => Box::new(tcp::Client::new(address)),
            PortConfig::TcpServer { address } => Box::new(tcp::Server::new(address)),
            PortConfig::CanUdp { bus } => Box::new(can_udp::CanUdp::new(bus)),
            PortConfig::CanSlcan { path, bitrate } => Box::new(can_slcan::CanSlcan::new(path, bitrate)),
            PortConfig::Gamepad { place, grab } => Box::new(evdev::Gamepad::new(place, grab)),
            PortConfig::GamepadHub { path } => Box::new(evdev::Hub::new(path)),
            PortConfig::CanSocket { interface } => Box::new(can_socket::CanSocket::new(interface)),
            PortConfig::Gpio(config) => Box::new(Threaded::new(gpio::Line(config))),
            PortConfig::GpioInput(config) => Box::new(gpio::InputLine::new(config)),
            PortConfig::GpioSocket { path, simulated } => Box::new(gpio::Socket::new(path, simulated)),
            PortConfig::I2cDev { path } => Box::new(i2c::I2c::dev(path)),
            PortConfig::I2cGpio { chip, sda, scl, hz } => Box::new(i2c::I2c::gpio(chip, sda, scl, hz)),
            PortConfig::I2cSocket { path } => Box::new(i2c::Socket::new(path)),
            PortConfig::I2cServer { path } => Box::new(i2c::Server::new(path)),
            PortConfig::W1 { folder } => Box::new(Threaded::new(w1::Thermometers(folder))),
            PortConfig::W1Folder { folder } => Box::new(w1::Folder::new(folder)),
            PortConfig::Thermal { folder } => Box::new(Threaded::new(thermal::Zones(folder))),
            PortConfig::ThermalFolder { folder } => Box::new(Threaded::new(thermal::Folder(folder))),
            PortConfig::Store { folder } => Box::new(Threaded::new(store::Files::new(folder))),
        };
        let state = PortState::Down { since: Instant::ZERO, retry: Instant::ZERO, reported: false };
        Self { name, device, state, more: false, overrun: false, polls_write: false, why: Lost::new() }
    }

    /// Passes the module's expectations to the device; see [`Device::expect`].
    #[must_use]
    pub fn expecting(mut self, line: Line, everything: bool) -> Self {
        self.device.expect(line, everything);
        self
    }

    /// Closes the device; the next attempt to open it is soon.
    pub fn lose(&mut self, now: Instant) {
        self.device.close();
        (self.more, self.polls_write) = (false, false);
        self.state = PortState::Down { since: now, retry: now + RETRY_SOON, reported: true };
    }

    /// Attempts to open the device if that is due. `Some(Err)` at the first failure and when the reason changes.
    pub fn try_open(&mut self, now: Instant) -> Option<Result<(), Lost>> {
        let PortState::Down { since, retry, reported } = self.state else {
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
                self.state = PortState::Down { since, retry: now + RETRY_SOON, reported };
                None
            }
            Err(reason) => {
                let since = if since == Instant::ZERO { now } else { since };
                let pause = if now.since(since) < Duration::from_secs(1) { RETRY_SOON } else { RETRY };
                self.state = PortState::Down { since, retry: now + pause, reported: true };
                let news = !reported || reason != self.why;
                self.why.clone_from(&reason);
                news.then_some(Err(reason))
            }
        }
    }

    /// Deadline of the next attempt or transmission.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            PortState::Up => self.device.sent_at(),
            PortState::Down { retry, .. } => Some(retry),
        }
    }

    /// True if all output has left the wire.
    #[must_use]
    pub fn flushed(&self, now: Instant) -> bool {
        self.state != PortState::Up
            || (!self.device.wants_to_write() && self.device.sent_at().is_none_or(|at| at <= now))
    }
}
