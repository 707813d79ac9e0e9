//! Places of ports as the configuration has them: one that the robot, or the simulator, cannot open by its kind alone
//! is refused with file and line before anything starts. No device is opened.

use crate::config::{Config, ConfigError, Robot, gpio_bus};
use crate::place::{HOST_BUS, RobotLocation, W1_BUS};
use crate::topology::place_of;
use ::host::ports::settings::{CanInterface, I2cPlace, StreamPort};
use settings::{Problems, Table};
use std::net::SocketAddr;
use std::path::Path;

const END: &str = "a name in the run folder, as \"line\", where the simulator has the other end";
const OF_SIMULATOR: &str = "a name in the run folder is the simulator's";

/// Where a port is, by its keys.
#[derive(Clone, Copy)]
enum Spot<'a> {
    /// A device file, or a name in the run folder.
    Device(&'a Path),
    /// The same of a GPIO chip.
    Chip(&'a Path),
    /// A folder of the kernel's, or a name in the run folder.
    Folder(&'a Path),
    /// A TCP connection.
    Tcp,
    /// An I2C bus.
    I2c(&'a I2cPlace),
    /// A CAN bus.
    Can(&'a CanInterface),
}

/// A port: the tables that lead to its key, where the last one is in a list its number there, and the key.
struct Key<'a> {
    tables: Vec<&'a str>,
    item: Option<usize>,
    key: &'static str,
    spot: Spot<'a>,
}

impl<'a> Key<'a> {
    fn new(tables: &[&'a str], key: &'static str, spot: Spot<'a>) -> Self {
        Self { tables: tables.into(), item: None, key, spot }
    }

    /// Of the port of a line.
    fn of_line(tables: &[&'a str], port: &'a Path) -> Self {
        Self::new(tables, "port", Spot::Device(port))
    }

    /// Of one of `port` and `address`.
    fn of_stream(tables: &[&'a str], port: Option<&'a Path>, address: Option<SocketAddr>) -> Option<Self> {
        match (port, address) {
            (_, Some(_)) => Some(Self::new(tables, "address", Spot::Tcp)),
            (port, None) => Some(Self::of_line(tables, port?)),
        }
    }

    /// Of the port that a module calls `bus`.
    fn of(robot: &'a Robot, bus: &'a str) -> Option<Self> {
        let (kind, name) = bus.split_once('.').unwrap_or((bus, ""));
        let io = robot.io.as_ref();
        match kind {
            W1_BUS => Some(Self::new(&["w1"], "folder", Spot::Folder(&robot.w1.as_ref()?.port.folder))),
            HOST_BUS => Some(Self::new(&["host"], "folder", Spot::Folder(&robot.host.as_ref()?.port.folder))),
            "can" => {
                let can = robot.can.iter().find(|can| can.name == name)?;
                Some(Self::new(&["can", name], "interface", Spot::Can(&can.port.interface)))
            }
            "rs485" => Some(Self::of_line(&["rs485", name], &robot.rs485_bus(bus)?.line.port)),
            "serial" => {
                let line = robot.serial.iter().find(|line| line.name == name)?;
                Some(Self::of_line(&["serial", name], &line.port.port))
            }
            "i2c" => {
                let i2c = robot.i2c.iter().find(|i2c| i2c.name == name)?;
                Some(Self::new(&["i2c", name], "bus", Spot::I2c(&i2c.port.place)))
            }
            "modbus" => {
                let StreamPort { port, address, .. } = &io?.modbus.iter().find(|line| line.name == name)?.port;
                Self::of_stream(&["io", "modbus", name], port.as_deref(), *address)
            }
            "io" => {
                let line = io?.serial.iter().find(|line| line.bus() == bus)?;
                Self::of_stream(&["io", "serial", &line.name], line.port.port.as_deref(), line.port.address)
            }
            "lidar" => {
                let port = &robot.lidar.iter().find(|lidar| lidar.name == name)?.port;
                Self::of_stream(&["lidar", name], port.port.as_deref(), port.address)
            }
            "imu" => {
                let imu = robot.imu.iter().find(|imu| imu.name == name)?;
                Self::of_stream(&["imu", name], imu.port.port.as_deref(), None)
            }
            "gpio" => {
                let lines = &io?.gpio;
                let item = lines.iter().position(|keys| gpio_bus(keys) == bus)?;
                Some(Self { item: Some(item), ..Self::new(&["io", "gpio"], "chip", Spot::Chip(&lines[item].chip)) })
            }
            "stop" => Some(Self::new(&["stop", "gpio"], "chip", Spot::Chip(&robot.stop.feed_line()?.chip))),
            _ => None,
        }
    }

    /// What a robot without a simulator takes in its place; absent: this.
    fn of_robot(&self) -> Option<String> {
        match self.spot {
            Spot::Device(path) if path.is_relative() => {
                Some(format!("a device file, which begins with /, as \"/dev/ttyUSB0\": {OF_SIMULATOR}"))
            }
            Spot::Chip(path) if path.is_relative() => {
                Some(format!("a device file, which begins with /, as \"/dev/gpiochip0\": {OF_SIMULATOR}"))
            }
            Spot::Folder(path) if path.is_relative() => {
                Some(format!("a folder of the kernel's, which begins with /: {OF_SIMULATOR}"))
            }
            Spot::I2c(I2cPlace::Socket(path)) if path.is_relative() => {
                Some(format!("\"/dev/i2c-1\" or \"gpio:/dev/gpiochip0:SDA:SCL\": {OF_SIMULATOR}"))
            }
            _ => None,
        }
    }

    /// What the simulator takes in its place, once it has refused this.
    fn of_simulator(&self) -> String {
        match &self.spot {
            Spot::Device(_) => format!("{END}; or simulated_at beside it (sim.toml)"),
            Spot::Chip(_) if self.item.is_some() => {
                format!("{END}: sim.toml has the whole list [[io.gpio]] once more")
            }
            Spot::Chip(_) | Spot::Folder(_) => format!("{END} (sim.toml)"),
            Spot::Tcp => "an address of this computer, as \"127.0.0.1:1502\" (sim.toml)".into(),
            Spot::I2c(_) => "\"unix:\" and a name in the run folder, as \"unix:i2c\" (sim.toml)".into(),
            Spot::Can(_) => "\"udp:GROUP\", as \"udp:239.74.163.2\" (sim.toml)".into(),
        }
    }

    /// True if the simulator cannot have this end of it; `is_refused`: by what it is.
    fn lacks_end(&self, is_refused: bool) -> bool {
        match self.spot {
            // The device of an adapter has one user, the driver.
            Spot::Can(interface) => matches!(interface, CanInterface::Slcan(_)),
            _ => is_refused,
        }
    }

    /// Notes it as wrong where it is written; absent: it is not there.
    fn refuse(&self, root: &Table<'_>, expected: &str) -> Option<()> {
        let (last, above) = self.tables.split_last()?;
        let mut table = None;
        for name in above {
            let below = table.as_ref().unwrap_or(root).below(name)?;
            table = Some(below);
        }
        let table = table.as_ref().unwrap_or(root);
        let table = match self.item {
            Some(n) => table.item(last, n)?,
            None => table.below(last)?,
        };
        match table.has(self.key) {
            true => table.refuse(self.key, expected),
            false => table.refuse_missing(self.key, expected),
        }
        Some(())
    }
}

/// Checks the ports of the modules: the names of their buses, and whether it is the simulator that has them.
///
/// # Errors
/// A line for each one that cannot be opened.
pub(crate) fn check(place: &RobotLocation, config: &Config, ports: &[(String, bool)]) -> Result<(), ConfigError> {
    let robot = &config.robot;
    let mut wrong: Vec<(Key<'_>, String)> = Vec::new();
    let mut buses: Vec<(&str, bool)> = ports.iter().map(|(bus, simulated)| (bus.as_str(), *simulated)).collect();
    // Several modules may be on one bus.
    buses.sort_unstable();
    buses.dedup();
    for (bus, simulated) in buses {
        let Some(key) = Key::of(robot, bus) else { continue };
        let expected = match simulated {
            true => key.lacks_end(place_of(place, robot, bus, true).is_err()).then(|| key.of_simulator()),
            false if place.sim => None,
            false => key.of_robot(),
        };
        wrong.extend(expected.map(|expected| (key, expected)));
    }
    if wrong.is_empty() {
        return Ok(());
    }
    let (root, problems) = (Config::tree(&place.config, place.sim, &place.sets)?, Problems::default());
    let mut lines = Vec::new();
    if let Some(root) = Table::root(&root, &problems) {
        for (key, expected) in wrong {
            // A file that was changed meanwhile may have no such key any more.
            if key.refuse(&root, &expected).is_none() {
                lines.push(format!("{}.{}: expected {expected}", key.tables.join("."), key.key));
            }
        }
    }
    Err(ConfigError([problems.lines(), lines].concat()))
}
