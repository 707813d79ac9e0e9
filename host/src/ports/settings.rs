//! Keys that say where the ports are, and the ports that they describe.
//!
//! A relative path lies in the run folder, where the simulator has the other end.

use super::{ByteParity, Direction, GamepadPlace, PortConfig, TerminalConfig, Transport};
use ::settings::{Parsed, Table, settings};
use std::fmt;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::{Path, PathBuf};

/// Where a CAN bus is found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CanInterface {
    /// A network interface: `can0`.
    Socket(String),
    /// An adapter on a serial device that speaks slcan: `slcan:/dev/ttyACM0`.
    Slcan(PathBuf),
    /// UDP multicast as python-can speaks it: `udp:239.74.163.2:43113`. Without a port it follows the port of LCM.
    Udp {
        /// The multicast group.
        group: Ipv4Addr,
        /// The port, which is what keeps buses apart.
        port: Option<u16>,
    },
}

settings! {
    /// Keys of `[can.<name>]` for the port.
    #[derive(Clone, Debug, PartialEq)]
    pub struct CanPort {
        /// Network interface, serial device of an slcan adapter, or UDP multicast. Without PORT it follows the port of
        /// LCM: 43113 at 7667.
        interface: CanInterface = required, Parsed(
            CanInterface::parse, r#""can0" or another network interface, "slcan:DEVICE", or "udp:GROUP[:PORT]""#, "can0"
        );
        /// Every frame is published as `LL_DATA_RAW_<BUS>`.
        raw: bool = false;
    }
}

impl CanInterface {
    /// Reads the value of the key; absent if it is no interface's name.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        if let Some(device) = text.strip_prefix("slcan:") {
            return device.starts_with('/').then(|| Self::Slcan(device.into()));
        }
        let Some(udp) = text.strip_prefix("udp:") else {
            // IFNAMSIZ counts the end of the string.
            let name = !text.is_empty()
                && text.len() < 16
                && !text.contains(['/', ':'])
                && !text.contains(char::is_whitespace);
            return name.then(|| Self::Socket(text.into()));
        };
        let (group, port) = match udp.split_once(':') {
            Some((group, port)) => (group, Some(port.parse().ok().filter(|port| *port != 0)?)),
            None => (udp, None),
        };
        let group: Ipv4Addr = group.parse().ok()?;
        group.is_multicast().then_some(Self::Udp { group, port })
    }

    /// The port; its bit rate where the port sets it.
    ///
    /// # Errors
    /// `lcm_url` is no URL of a bus.
    pub fn port(&self, lcm_url: &str, bitrate: u32) -> Result<PortConfig, String> {
        Ok(match self {
            Self::Socket(interface) => PortConfig::CanSocket { interface: interface.clone() },
            Self::Slcan(path) => PortConfig::CanSlcan { path: path.clone(), bitrate },
            Self::Udp { group, port } => {
                let (url, _) = lcm::Url::parse(lcm_url).map_err(|error| error.to_string())?;
                // Other transports of messages have no UDP port.
                let beside = if let lcm::Url::Udpm(udpm) = url { udpm.port } else { lcm::url::PORT };
                PortConfig::CanUdp { bus: SocketAddrV4::new(*group, port.unwrap_or_else(|| can_port_beside(beside))) }
            }
        })
    }
}

impl fmt::Display for CanInterface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socket(interface) => f.write_str(interface),
            Self::Slcan(path) => write!(f, "slcan:{}", path.display()),
            Self::Udp { group, port: Some(port) } => write!(f, "udp:{group}:{port}"),
            Self::Udp { group, port: None } => write!(f, "udp:{group}"),
        }
    }
}

/// The UDP port of the simulated CAN bus beside an LCM bus: 43113 at 7667, and another one for each other port.
#[must_use]
pub fn can_port_beside(lcm: u16) -> u16 {
    // A rotation of the unprivileged ports, and one of the others: no two map to the same.
    const FIRST: u32 = 1024;
    const COUNT: u32 = 65536 - FIRST;
    let lcm = u32::from(lcm);
    let port = match lcm.checked_sub(FIRST) {
        Some(offset) => FIRST + (offset + 43113 - 7667) % COUNT,
        None => 1 + (lcm.max(1) - 1 + 511) % (FIRST - 1),
    };
    port as u16
}

settings! {
    /// Keys of `[rs485.<name>]` for the port.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SerialPort {
        /// Device file; of a USB adapter its name under `/dev/serial/by-id`.
        port: PathBuf = required;
        /// Any rate that the port can make.
        baud: u32 = 115_200, 1200..=4_000_000;
        /// How nine bits cross the port: two bytes for each word, the low one first (the simulator's ports), or the
        /// ninth bit first (`tt8s*` of the TS-7800), or mark and space parity (any UART).
        transport: Transport = required;
        /// Simulation with a device file as `port`: the other end, a device file wired to it, or a relative path of a
        /// pseudo-terminal of two-byte words. Absent: the simulator makes `port` itself.
        simulated_at: Option<PathBuf> = optional;
        /// Program and arguments that make the port an EIA-485 port, run before each opening.
        setup: Vec<String> = Vec::<String>::new();
        /// RTS switches the direction of the line. Absent: the adapter does.
        rs485_direction as direction: Option<Direction> = optional;
        /// USB adapters: received bytes are handed on at once, not after 16 ms.
        low_latency: bool = false;
        /// Every word is published as `LL_DATA_RAW_<BUS>`.
        raw: bool = false;
    }
    check SerialPort::check;
}

impl SerialPort {
    fn check(&self, table: &Table<'_>) {
        check_other_end(table, Some(&self.port), self.simulated_at.as_ref());
    }

    /// The name in the run folder of the pseudo-terminal that the simulator makes, if it makes one.
    #[must_use]
    pub fn offered(&self) -> Option<&Path> {
        let path = self.simulated_at.as_ref().unwrap_or(&self.port);
        path.is_relative().then_some(path)
    }

    /// The serial device.
    #[must_use]
    pub fn terminal(&self, run_dir: &Path) -> TerminalConfig {
        let plain = TerminalConfig::new(run_dir.join(&self.port), self.baud);
        let plain = TerminalConfig { transport: self.transport, ..plain };
        // The simulator's pseudo-terminal has no registers and no RTS.
        if self.port.is_relative() {
            return plain;
        }
        TerminalConfig { setup: self.setup.clone(), direction: self.direction, low_latency: self.low_latency, ..plain }
    }

    /// The simulator's end of the line.
    ///
    /// # Errors
    /// The other end is a device file, and `simulated_at` is absent.
    pub fn simulated(&self, run_dir: &Path, bus: &str) -> Result<PortConfig, String> {
        match (self.offered(), &self.simulated_at) {
            (Some(name), _) => Ok(PortConfig::Pseudo { link: run_dir.join(name), baud: self.baud }),
            (None, Some(port)) => {
                let (transport, low_latency) = (self.transport, self.low_latency);
                let plain = TerminalConfig::new(port.clone(), self.baud);
                Ok(PortConfig::Terminal(TerminalConfig { transport, low_latency, ..plain }))
            }
            (None, None) => Err(format!(
                "{bus}.port = {:?}: the simulator needs a name in the run folder, or simulated_at",
                self.port
            )),
        }
    }
}

settings! {
    /// Keys of `[io.modbus.<name>]` for the port: one of `port` and `address`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct StreamPort {
        /// Modbus RTU: device file; of a USB adapter its name under `/dev/serial/by-id`. A relative path: the
        /// simulator's pseudo-terminal, in the run folder.
        port: Option<PathBuf> = optional;
        /// Modbus TCP: address and TCP port of the device, `"192.168.0.5:502"`. In simulation one of this computer, as
        /// `"127.0.0.1:1502"`.
        address: Option<SocketAddr> = optional, Parsed(
            |text| text.parse().ok(), r#""ADDRESS:PORT""#, "192.168.0.5:502"
        );
        /// RTU: simulation with a device file as `port`: the other end, a device file wired to it, or a relative path
        /// of a pseudo-terminal. Absent: the simulator makes `port` itself.
        simulated_at: Option<PathBuf> = optional;
        /// RTU: any rate that the port can make.
        baud: u32 = 19_200, 1200..=4_000_000;
        /// RTU: parity; with `"none"` there are two stop bits.
        parity: ByteParity = ByteParity::Even;
        /// RTU: program and arguments that make the port an EIA-485 port, run before each opening.
        setup: Vec<String> = Vec::<String>::new();
        /// RTU: RTS switches the direction of the line. Absent: the adapter does.
        rs485_direction as direction: Option<Direction> = optional;
        /// RTU, USB adapters: received bytes are handed on at once, not after 16 ms.
        low_latency: bool = false;
        /// Every byte is published as `LL_DATA_RAW_<BUS>`.
        raw: bool = false;
    }
    check StreamPort::check;
}

/// One of a device file and an address; the device file may have another end.
fn check_stream(table: &Table<'_>, port: Option<&PathBuf>, address: Option<SocketAddr>, other_end: Option<&PathBuf>) {
    match (port, address) {
        (None, None) => table.refuse_missing("port", "a device file, or address"),
        (Some(_), Some(_)) => table.refuse("address", "nothing beside port"),
        (None, Some(_)) => table.refuse("simulated_at", "nothing beside address"),
        (port, None) => check_other_end(table, port, other_end),
    }
}

/// The simulator's end of a line is not the driver's, and only a device file has another one.
fn check_other_end(table: &Table<'_>, port: Option<&PathBuf>, other_end: Option<&PathBuf>) {
    if port.is_some_and(|port| port.is_relative() || other_end == Some(port)) {
        table.refuse("simulated_at", "a place other than port, where that is a device file");
    }
}

impl StreamPort {
    /// A line of bytes without parity; RTS does not switch its direction.
    fn plain(port: Option<PathBuf>, baud: u32, low_latency: bool, raw: bool) -> Self {
        let (parity, setup) = (ByteParity::None, Vec::new());
        Self { port, address: None, simulated_at: None, baud, parity, setup, direction: None, low_latency, raw }
    }

    fn check(&self, table: &Table<'_>) {
        check_stream(table, self.port.as_ref(), self.address, self.simulated_at.as_ref());
    }

    /// The driver's port.
    #[must_use]
    pub fn port(&self, run_dir: &Path) -> PortConfig {
        match (&self.port, self.address) {
            (_, Some(address)) => PortConfig::Tcp { address },
            (path, None) => {
                let path = path.as_deref().unwrap_or(Path::new(""));
                let plain = TerminalConfig::new(run_dir.join(path), self.baud);
                let plain = TerminalConfig { bytes: Some(self.parity), ..plain };
                // The simulator's pseudo-terminal has no RTS.
                if path.is_relative() {
                    return PortConfig::Terminal(plain);
                }
                let (setup, direction, low_latency) = (self.setup.clone(), self.direction, self.low_latency);
                PortConfig::Terminal(TerminalConfig { setup, direction, low_latency, ..plain })
            }
        }
    }

    /// The simulator's end.
    ///
    /// # Errors
    /// The port is a device file without `simulated_at`, or the address is of another computer.
    pub fn simulated(&self, run_dir: &Path, bus: &str) -> Result<PortConfig, String> {
        let port = match (&self.port, self.address) {
            (_, Some(address)) if address.ip().is_loopback() => return Ok(PortConfig::TcpServer { address }),
            (_, Some(address)) => {
                return Err(format!(
                    "{bus}.address = \"{address}\": the simulator needs an address of this computer, as 127.0.0.1:1502"
                ));
            }
            (port, None) => port.as_deref().unwrap_or(Path::new("")),
        };
        match self.simulated_at.as_deref() {
            None if port.is_absolute() => {
                Err(format!("{bus}.port = {port:?}: the simulator needs a name in the run folder, or simulated_at"))
            }
            Some(end) if end.is_absolute() => {
                let (bytes, low_latency) = (Some(self.parity), self.low_latency);
                let plain = TerminalConfig::new(end.into(), self.baud);
                Ok(PortConfig::Terminal(TerminalConfig { bytes, low_latency, ..plain }))
            }
            end => Ok(PortConfig::PseudoBytes { link: run_dir.join(end.unwrap_or(port)), baud: self.baud }),
        }
    }
}

settings! {
    /// Keys of `[lidar.<name>]` for the port: one of `port` and `address`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct LidarPort {
        /// Serial: device file; of a USB adapter its name under `/dev/serial/by-id`. A relative path: the simulator's
        /// pseudo-terminal, in the run folder.
        port: Option<PathBuf> = optional;
        /// TCP: address and port of the device, `"192.168.0.1:2111"`. In simulation one of this computer, as
        /// `"127.0.0.1:2111"`.
        address: Option<SocketAddr> = optional, Parsed(
            |text| text.parse().ok(), r#""ADDRESS:PORT""#, "192.168.0.1:2111"
        );
        /// Serial: simulation with a device file as `port`: the other end, a device file wired to it, or a relative
        /// path of a pseudo-terminal. Absent: the simulator makes `port` itself.
        simulated_at: Option<PathBuf> = optional;
        /// Serial: rate. Absent: the usual one of the model.
        baud: Option<u32> = optional, 1200..=4_000_000;
        /// Serial, USB adapters: received bytes are handed on at once, not after 16 ms.
        low_latency: bool = true;
        /// Every byte is published as `LL_DATA_RAW_<BUS>`.
        raw: bool = false;
    }
    check LidarPort::check;
}

impl LidarPort {
    fn check(&self, table: &Table<'_>) {
        check_stream(table, self.port.as_ref(), self.address, self.simulated_at.as_ref());
    }

    /// The same as a line of bytes, at this rate where the configuration names none: no parity.
    #[must_use]
    pub fn stream(&self, usual_baud: u32) -> StreamPort {
        let baud = self.baud.unwrap_or(usual_baud);
        let line = StreamPort::plain(self.port.clone(), baud, self.low_latency, self.raw);
        StreamPort { address: self.address, simulated_at: self.simulated_at.clone(), ..line }
    }
}

settings! {
    /// Keys of `[io.serial.<name>]` for the port: one of `port` and `address`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct BytePort {
        /// Device file; of a USB adapter its name under `/dev/serial/by-id`. A relative path: the simulator's
        /// pseudo-terminal, in the run folder.
        port: Option<PathBuf> = optional;
        /// A serial server: address and TCP port, `"192.168.0.6:4001"`. In simulation one of this computer, as
        /// `"127.0.0.1:4001"`.
        address: Option<SocketAddr> = optional, Parsed(
            |text| text.parse().ok(), r#""ADDRESS:PORT""#, "192.168.0.6:4001"
        );
        /// Simulation with a device file as `port`: the other end, a device file wired to it, or a relative path of a
        /// pseudo-terminal. Absent: the simulator makes `port` itself.
        simulated_at: Option<PathBuf> = optional;
        /// Any rate that the port can make.
        baud: u32 = 9600, 1200..=4_000_000;
        /// Parity of the eight bits; with `"none"` there are two stop bits, which devices with one accept.
        parity: ByteParity = ByteParity::None;
        /// Program and arguments that make the port an EIA-485 port, run before each opening.
        setup: Vec<String> = Vec::<String>::new();
        /// RTS switches the direction of the line. Absent: the adapter does, or the line has both.
        rs485_direction as direction: Option<Direction> = optional;
        /// USB adapters: received bytes are handed on at once, not after 16 ms.
        low_latency: bool = false;
        /// Every byte is published as `LL_DATA_RAW_<NAME>`.
        raw: bool = false;
    }
    check BytePort::check;
}

impl BytePort {
    fn check(&self, table: &Table<'_>) {
        check_stream(table, self.port.as_ref(), self.address, self.simulated_at.as_ref());
    }

    /// The same as a line of bytes.
    #[must_use]
    pub fn stream(&self) -> StreamPort {
        let Self { port, address, simulated_at, baud, parity, setup, direction, low_latency, raw } = self.clone();
        StreamPort { port, address, simulated_at, baud, parity, setup, direction, low_latency, raw }
    }
}

settings! {
    /// Keys of `[imu.<name>]` for the port: one of `port` and `bus`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ImuPort {
        /// Serial: device file; of a USB adapter its name under `/dev/serial/by-id`. A relative path: the simulator's
        /// pseudo-terminal, in the run folder.
        port: Option<PathBuf> = optional;
        /// I2C, CAN: the bus that the device is on, `"i2c.main"` for `[i2c.main]`, `"can.main"` for `[can.main]`. Other
        /// devices may be on it.
        bus: Option<String> = optional;
        /// Serial: simulation with a device file as `port`: the other end, a device file wired to it, or a relative
        /// path of a pseudo-terminal. Absent: the simulator makes `port` itself.
        simulated_at: Option<PathBuf> = optional;
        /// Serial: rate.
        baud: u32 = 115_200, 1200..=4_000_000;
        /// Serial, USB adapters: received bytes are handed on at once, not after 16 ms.
        low_latency: bool = true;
        /// Serial: every byte is published as `LL_DATA_RAW_<BUS>`.
        raw: bool = false;
    }
    check ImuPort::check;
}

impl ImuPort {
    fn check(&self, table: &Table<'_>) {
        match (&self.port, &self.bus) {
            (None, None) => table.refuse_missing("port", "a device file, or bus"),
            (Some(_), Some(_)) => table.refuse("bus", "nothing beside port"),
            (None, Some(_)) => table.refuse("simulated_at", "nothing beside bus"),
            (port, None) => check_other_end(table, port.as_ref(), self.simulated_at.as_ref()),
        }
    }

    /// The serial line as one of bytes without parity.
    #[must_use]
    pub fn stream(&self) -> StreamPort {
        let line = StreamPort::plain(self.port.clone(), self.baud, self.low_latency, self.raw);
        StreamPort { simulated_at: self.simulated_at.clone(), ..line }
    }
}

settings! {
    /// Keys of `[serial.<name>]` for the port.
    #[derive(Clone, Debug, PartialEq)]
    pub struct LinePort {
        /// Device file; of a USB adapter its name under `/dev/serial/by-id`. A relative path: the simulator's
        /// pseudo-terminal, in the run folder.
        port: PathBuf = required;
        /// Simulation with a device file as `port`: the other end, a device file wired to it, or a relative path of a
        /// pseudo-terminal. Absent: the simulator makes `port` itself.
        simulated_at: Option<PathBuf> = optional;
        /// Rate, as it is set in the device.
        baud: u32 = 115_200, 9600..=4_000_000;
        /// USB adapters: received bytes are handed on at once, not after 16 ms.
        low_latency: bool = true;
        /// Every byte is published as `LL_DATA_RAW_<BUS>`.
        raw: bool = false;
    }
    check LinePort::check;
}

impl LinePort {
    fn check(&self, table: &Table<'_>) {
        check_other_end(table, Some(&self.port), self.simulated_at.as_ref());
    }

    /// The same as a line of bytes: no parity.
    #[must_use]
    pub fn stream(&self) -> StreamPort {
        let line = StreamPort::plain(Some(self.port.clone()), self.baud, self.low_latency, self.raw);
        StreamPort { simulated_at: self.simulated_at.clone(), ..line }
    }
}

/// Where an I2C bus is found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum I2cPlace {
    /// An adapter of the kernel's: `/dev/i2c-1`.
    Dev(PathBuf),
    /// Two lines of a GPIO chip: `gpio:/dev/gpiochip0:SDA:SCL`, the lines by their numbers.
    Gpio {
        /// The chip's device file.
        chip: PathBuf,
        /// The data line.
        sda: u32,
        /// The clock line.
        scl: u32,
    },
    /// The simulator's socket: `unix:PATH`.
    Socket(PathBuf),
}

settings! {
    /// Keys of `[i2c.<name>]` for the port.
    #[derive(Clone, Debug, PartialEq)]
    pub struct I2cPort {
        /// An adapter of the kernel, two open-drain lines of a GPIO chip by their numbers, or the simulator's socket.
        bus as place: I2cPlace = required, Parsed(
            I2cPlace::parse, r#""/dev/i2c-1", "gpio:/dev/gpiochip0:SDA:SCL", or "unix:PATH""#, "/dev/i2c-1"
        );
        /// Bit rate of a bit-banged bus; the rate of an adapter is set in its kernel driver.
        hz: u32 = 100_000, 1000..=1_000_000;
        /// Every transfer is published as `LL_DATA_RAW_<BUS>`.
        raw: bool = false;
    }
}

impl I2cPlace {
    /// Reads the value of the key; absent if it is no place of a bus.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        if let Some(path) = text.strip_prefix("unix:") {
            return (!path.is_empty()).then(|| Self::Socket(path.into()));
        }
        let Some(gpio) = text.strip_prefix("gpio:") else {
            return text.starts_with('/').then(|| Self::Dev(text.into()));
        };
        let mut parts = gpio.rsplitn(3, ':');
        let (scl, sda, chip) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?, parts.next()?);
        (chip.starts_with('/') && sda != scl).then(|| Self::Gpio { chip: chip.into(), sda, scl })
    }

    /// The port; `hz` is the bit rate where the host makes the clock.
    #[must_use]
    pub fn port(&self, run_dir: &Path, hz: u32) -> PortConfig {
        match self {
            Self::Dev(path) => PortConfig::I2cDev { path: path.clone() },
            Self::Gpio { chip, sda, scl } => PortConfig::I2cGpio { chip: chip.clone(), sda: *sda, scl: *scl, hz },
            Self::Socket(path) => PortConfig::I2cSocket { path: run_dir.join(path) },
        }
    }

    /// The simulator's end of the bus; absent if that is no socket.
    #[must_use]
    pub fn simulated(&self, run_dir: &Path) -> Option<PortConfig> {
        if let Self::Socket(path) = self { Some(PortConfig::I2cServer { path: run_dir.join(path) }) } else { None }
    }
}

impl fmt::Display for I2cPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dev(path) => write!(f, "{}", path.display()),
            Self::Gpio { chip, sda, scl } => write!(f, "gpio:{}:{sda}:{scl}", chip.display()),
            Self::Socket(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

settings! {
    /// Keys of `[w1]` for the port.
    #[derive(Clone, Debug, PartialEq)]
    pub struct W1Port {
        /// Folder in which the kernel's w1_therm has its thermometers.
        folder: PathBuf = "/sys/bus/w1/devices";
    }
}

impl W1Port {
    /// The thermometers.
    #[must_use]
    pub fn port(&self, run_dir: &Path) -> PortConfig {
        PortConfig::W1 { folder: run_dir.join(&self.folder) }
    }

    /// The simulator's end.
    ///
    /// # Errors
    /// The folder is not in the run folder.
    pub fn simulated(&self, run_dir: &Path) -> Result<PortConfig, String> {
        match self.folder.is_relative() {
            true => Ok(PortConfig::W1Folder { folder: run_dir.join(&self.folder) }),
            false => Err(format!("w1.folder = {:?}: the simulator needs a name in the run folder", self.folder)),
        }
    }
}

settings! {
    /// Keys of `[host]` for the port.
    #[derive(Clone, Debug, PartialEq)]
    pub struct HostPort {
        /// Folder in which the kernel shows the temperatures of the computer.
        folder: PathBuf = "/sys";
    }
}

impl HostPort {
    /// The temperatures.
    #[must_use]
    pub fn port(&self, run_dir: &Path) -> PortConfig {
        PortConfig::Thermal { folder: run_dir.join(&self.folder) }
    }

    /// The simulator's end.
    ///
    /// # Errors
    /// The folder is not in the run folder.
    pub fn simulated(&self, run_dir: &Path) -> Result<PortConfig, String> {
        match self.folder.is_relative() {
            true => Ok(PortConfig::ThermalFolder { folder: run_dir.join(&self.folder) }),
            false => Err(format!("host.folder = {:?}: the simulator needs a name in the run folder", self.folder)),
        }
    }
}

settings! {
    /// Keys of `[gamepad]` for the port.
    #[derive(Clone, Debug, PartialEq)]
    pub struct GamepadPort {
        /// `"auto"`: the first `/dev/input/event*` with two axes and a button that is no tablet, mouse or touch screen;
        /// a device file, best its name under `/dev/input/by-id/`; `"file:PATH"`: a file, FIFO or socket of lines.
        device as place: GamepadPlace = GamepadPlace::Auto, Parsed(
            GamepadPlace::parse, r#""auto", a device file as "/dev/input/event5", or "file:PATH""#, "auto"
        );
        /// No other program receives its events.
        grab: bool = false;
    }
}

impl GamepadPort {
    /// True if the simulator has the gamepad: its socket is in the run folder.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        matches!(&self.place, GamepadPlace::Stream(path) if path.is_relative())
    }

    /// The gamepad; `simulated` for the simulator's end of it.
    #[must_use]
    pub fn port(&self, run_dir: &Path, simulated: bool) -> PortConfig {
        let place = match &self.place {
            GamepadPlace::Stream(path) if simulated => return PortConfig::GamepadHub { path: run_dir.join(path) },
            GamepadPlace::Stream(path) => GamepadPlace::Stream(run_dir.join(path)),
            other => other.clone(),
        };
        PortConfig::Gamepad { place, grab: self.grab }
    }
}

impl GamepadPlace {
    /// Reads the value of the key; absent if it is no place of a gamepad.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        match text.strip_prefix("file:") {
            Some(path) => (!path.is_empty()).then(|| Self::Stream(path.into())),
            None if text == "auto" => Some(Self::Auto),
            None => text.starts_with('/').then(|| Self::Device(text.into())),
        }
    }
}

impl fmt::Display for GamepadPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Device(path) => write!(f, "{}", path.display()),
            Self::Stream(path) => write!(f, "file:{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_can_port_follows_the_lcm_port_and_no_two_share_one() {
        assert_eq!(can_port_beside(7667), 43113);
        let ports: BTreeSet<u16> = (1..=u16::MAX).map(can_port_beside).collect();
        assert_eq!(ports.len(), usize::from(u16::MAX));
        assert!(!ports.contains(&0));
        assert!((1024..=u16::MAX).all(|lcm| can_port_beside(lcm) >= 1024));
    }

    #[test]
    fn an_i2c_bus_is_where_it_says() {
        let place = |text: &str| I2cPlace::parse(text);
        assert_eq!(place("/dev/i2c-1"), Some(I2cPlace::Dev("/dev/i2c-1".into())));
        let chip = "/dev/gpiochip0".into();
        assert_eq!(place("gpio:/dev/gpiochip0:2:3"), Some(I2cPlace::Gpio { chip, sda: 2, scl: 3 }));
        assert_eq!(place("unix:i2c-aux"), Some(I2cPlace::Socket("i2c-aux".into())));
        for bad in ["", "i2c-1", "unix:", "gpio:", "gpio:/dev/gpiochip0", "gpio:/dev/gpiochip0:2", "gpio:chip:2:3"] {
            assert_eq!(place(bad), None, "{bad}");
        }
        for bad in ["gpio:/dev/gpiochip0:2:2", "gpio:/dev/gpiochip0:-1:2", "gpio:/dev/gpiochip0:2:x"] {
            assert_eq!(place(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_place_is_written_as_it_is_read() {
        for text in ["can0", "slcan:/dev/ttyACM0", "udp:239.0.0.1", "udp:239.0.0.1:5000"] {
            assert_eq!(CanInterface::parse(text).unwrap().to_string(), text);
        }
        for text in ["/dev/i2c-1", "gpio:/dev/gpiochip0:2:3", "unix:i2c-aux"] {
            assert_eq!(I2cPlace::parse(text).unwrap().to_string(), text);
        }
        for text in ["auto", "/dev/input/event5", "file:gamepad"] {
            assert_eq!(GamepadPlace::parse(text).unwrap().to_string(), text);
        }
    }
}
