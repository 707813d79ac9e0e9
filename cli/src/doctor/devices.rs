//! The configuration, and the devices that it names.

use super::finding::{Finding, Level};
use host::ports::settings::{CanInterface, I2cPlace, StreamPort};
use host::ports::{GamepadPlace, GpioConfig};
use nix::unistd::{AccessFlags, Gid, Group, access};
use robot::config::{CanBus, Config, ConfigError, Gamepad, I2cBus, ModuleEntry, Robot, Rs485Bus, W1};
use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;
use std::process::Command;

/// The folder as a whole; a finding for each line that is wrong.
pub fn configuration(loaded: &Result<Config, ConfigError>, dir: &Path) -> Vec<Finding> {
    const CHECK: &str = "configuration";
    match loaded {
        Ok(config) => {
            let modules: Vec<&str> = config.modules.iter().map(ModuleEntry::name).collect();
            vec![Finding::ok(CHECK, format!("{}: {}", config.robot.general.name, modules.join(", ")))]
        }
        Err(ConfigError(lines)) => {
            let wrong = |line: &String| {
                Finding::fail(CHECK, line).why("Nothing starts with a wrong configuration.").cure(match place(line) {
                    Some((file, number)) => format!("${{EDITOR:-nano}} +{number} {file}"),
                    // The command line is the place.
                    None if line.starts_with("--set") => String::new(),
                    None => format!("ls -l {}", dir.display()),
                })
            };
            lines.iter().map(wrong).collect()
        }
    }
}

/// `FILE:LINE: …`
fn place(line: &str) -> Option<(&str, u32)> {
    let mut parts = line.splitn(3, ':');
    let (file, number) = (parts.next()?, parts.next()?);
    Some((file, number.parse().ok()?))
}

/// A device file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Device {
    pub there: bool,
    pub character: bool,
    /// True if this user may read and write it.
    pub access: bool,
    /// True if he may read it.
    pub readable: bool,
    /// The group that owns it.
    pub group: Option<String>,
}

impl Device {
    pub fn gather(path: &Path) -> Self {
        let Ok(data) = fs::metadata(path) else { return Self::default() };
        Self {
            there: true,
            character: data.file_type().is_char_device(),
            access: access(path, AccessFlags::R_OK | AccessFlags::W_OK).is_ok(),
            readable: access(path, AccessFlags::R_OK).is_ok(),
            group: Group::from_gid(Gid::from_raw(data.gid())).ok().flatten().map(|group| group.name),
        }
    }
}

/// A serial port; a relative path is the simulator's and comes with it.
pub fn serial(bus: &Rs485Bus, device: &Device, user: &str) -> Option<Finding> {
    if bus.line.port.is_relative() {
        return None;
    }
    let lost = "Its boards are not heard; where the module is critical the robot does not move.";
    Some(device_file(&format!("rs485.{}", bus.name), &bus.line.port, bus.line.baud, device, (lost, user), SERIAL))
}

/// The serial ports of drives, lidars, inertial units, Modbus lines and others of `[io]`. A device with an address, or
/// on a bus, has no port; a relative path is the simulator's.
pub fn streams(robot: &Robot, device: impl Fn(&Path) -> Device, user: &str) -> Vec<Finding> {
    const WHEELS: &str = "Its wheels do not turn, and the robot does not move.";
    const LIDAR: &str = "It measures nothing; what it would see counts as unknown.";
    const IMU: &str = "It measures nothing.";
    const IO: &str = "Its inputs are unknown, and its outputs are not set.";
    let drives = robot.serial.iter().map(|line| (line.bus(), line.port.stream(), WHEELS));
    let lidars = robot.lidar.iter().map(|lidar| (lidar.bus(), lidar.stream(), LIDAR));
    let imus = robot.imu.iter().map(|imu| (imu.subject(), imu.port.stream(), IMU));
    let modbus = robot.io.iter().flat_map(|io| &io.modbus).map(|line| (line.bus(), line.port.clone(), IO));
    let serial = robot.io.iter().flat_map(|io| &io.serial).map(|line| (line.bus(), line.port.stream(), IO));
    let finding = |(bus, line, lost): (String, StreamPort, &str)| {
        let port = line.port.as_deref().filter(|port| port.is_absolute())?;
        Some(device_file(&bus, port, line.baud, &device(port), (lost, user), SERIAL))
    };
    drives.chain(lidars).chain(imus).chain(modbus).chain(serial).filter_map(finding).collect()
}

/// An I2C adapter, or the GPIO chip that makes one; none for the simulator's.
pub fn i2c(bus: &I2cBus, device: impl Fn(&Path) -> Device, user: &str) -> Option<Finding> {
    let (path, kind) = match &bus.port.place {
        I2cPlace::Dev(path) => (path, ("ls -l /dev/i2c-*; sudo modprobe i2c-dev", "i2c")),
        I2cPlace::Gpio { chip, .. } => (chip, ("ls -l /dev/gpiochip*", "gpio")),
        I2cPlace::Socket(_) => return None,
    };
    let lost = "Temperatures and fans are not seen; the fans go on by themselves.";
    Some(device_file(&format!("i2c.{}", bus.name), path, bus.port.hz, &device(path), (lost, user), kind))
}

/// The GPIO line that cuts the motors' feed; none for the simulator's.
pub fn feed_line(
    line: &GpioConfig,
    device: impl Fn(&Path) -> Device,
    holder: impl Fn(&GpioConfig) -> Result<Option<String>, String>,
    user: &str,
) -> Option<Finding> {
    const CHECK: &str = "stop.gpio";
    let (chip, id) = (&line.chip, &line.line);
    if chip.is_relative() {
        return None;
    }
    let lost = "The motors' feed cannot be cut: the robot does not move.";
    let found = device_file(CHECK, chip, 0, &device(chip), (lost, user), ("ls -l /dev/gpiochip*", "gpio"));
    if found.level != Level::Ok {
        return Some(found);
    }
    let fail = |what: String| Finding::fail(CHECK, what).why(lost).cure(format!("gpioinfo {}", chip.display()));
    Some(match holder(line) {
        Ok(None) => Finding::ok(CHECK, format!("line {id} of {} can be requested", chip.display())),
        Ok(Some(other)) => fail(format!("line {id} of {} is held by {other:?}", chip.display())),
        Err(why) => fail(format!("{}: {why}", chip.display())),
    })
}

/// The kernel's 1-Wire thermometers; none for the simulator's.
pub fn w1(w1: &W1) -> Option<Finding> {
    const CHECK: &str = "w1";
    if w1.port.folder.is_relative() {
        return None;
    }
    let folder = w1.port.folder.display();
    if !w1.port.folder.is_dir() {
        let what = format!("{folder} is not there: no thermometer is connected");
        return Some(Finding::warning(CHECK, what).cure("sudo modprobe w1-therm; dmesg | grep -i w1"));
    }
    let missing: Vec<&str> = w1
        .driver
        .sensors
        .iter()
        .filter(|sensor| !w1.port.folder.join(sensor.rom.to_string()).exists())
        .map(|sensor| &*sensor.name)
        .collect();
    Some(match missing[..] {
        [] => Finding::ok(CHECK, format!("{} thermometers are connected", w1.driver.sensors.len())),
        _ => Finding::warning(CHECK, format!("not connected: {}", missing.join(", "))).cure(format!("ls {folder}")),
    })
}

/// The serial device of a CAN adapter.
pub fn adapter(bus: &CanBus, path: &Path, device: &Device, user: &str) -> Finding {
    let lost = "The drives are not reached: the robot does not move.";
    device_file(&format!("can.{}", bus.name), path, bus.driver.bitrate, device, (lost, user), SERIAL)
}

/// Hints for a serial device, and its usual group.
const SERIAL: (&str, &str) = ("ls -l /dev/serial/by-id/ /dev/tt*[A-Z]*[0-9]", "dialout");

fn device_file(
    check: &str,
    path: &Path,
    rate: u32,
    device: &Device,
    (lost, user): (&str, &str),
    (look, usual_group): (&str, &str),
) -> Finding {
    let port = path.display();
    let fail = |what: String| Finding::fail(check, what).why(lost);
    match device {
        Device { there: false, .. } => fail(format!("{port} is not there")).cure(look),
        Device { character: false, .. } => fail(format!("{port} is no device")).cure(format!("ls -lL {port}")),
        Device { access: false, group, .. } => {
            let group = group.as_deref().filter(|group| *group != "root").unwrap_or(usual_group);
            let why = format!("{lost} Log in anew after the cure.");
            fail(format!("{user} may not open {port}")).why(why).cure(format!("sudo usermod -aG {group} {user}"))
        }
        _ => Finding::ok(check, format!("{port}, {rate} bit/s asked")),
    }
}

/// A gamepad: its absence is no fault, missing rights are. `None` for a stream, which may come later.
pub fn gamepad(gamepad: &Gamepad, gather: impl Fn(&Path) -> Device, user: &str) -> Option<Finding> {
    const CHECK: &str = "joystick";
    let path = match &gamepad.port.place {
        GamepadPlace::Auto => Path::new("/dev/input"),
        GamepadPlace::Device(path) => path,
        GamepadPlace::Stream(_) => return None,
    };
    let (device, place) = (gather(path), path.display());
    Some(match (&gamepad.port.place, device) {
        (_, Device { there: false, .. }) => Finding::ok(CHECK, format!("{place} is not there: not connected")),
        (GamepadPlace::Device(_), Device { readable: false, group, .. }) => {
            let group = group.filter(|group| group != "root").unwrap_or_else(|| "input".into());
            Finding::fail(CHECK, format!("{user} may not open {place}"))
                .why("The gamepad is not heard. Log in anew after the cure.")
                .cure(format!("sudo usermod -aG {group} {user}"))
        }
        (GamepadPlace::Device(_), _) => Finding::ok(CHECK, format!("{place} is connected")),
        _ => Finding::ok(CHECK, format!("any gamepad in {place}")),
    })
}

/// A CAN interface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Can {
    pub there: bool,
    /// Rather than some other network interface.
    pub can: bool,
    pub up: bool,
    /// bit/s; none for a virtual one, or where `ip` cannot be asked.
    pub bitrate: Option<u32>,
    /// `ERROR-ACTIVE`, `BUS-OFF`, …
    pub state: Option<String>,
}

impl Can {
    pub fn gather(interface: &str) -> Self {
        /// ARPHRD_CAN (linux/if_arp.h).
        const TYPE: &str = "280";
        let sys = |file: &str| fs::read_to_string(format!("/sys/class/net/{interface}/{file}")).ok();
        let Some(kind) = sys("type") else { return Self::default() };
        let flags = sys("flags").and_then(|flags| u32::from_str_radix(flags.trim().trim_start_matches("0x"), 16).ok());
        let asked = Command::new("ip").args(["-details", "-json", "link", "show", interface]).output();
        let (bitrate, state) = asked.map_or((None, None), |answer| details(&answer.stdout));
        Self { there: true, can: kind.trim() == TYPE, up: flags.is_some_and(|flags| flags & 1 == 1), bitrate, state }
    }
}

/// Bit rate and state from `ip -details -json link show`.
fn details(json: &[u8]) -> (Option<u32>, Option<String>) {
    let Ok(json) = serde_json::from_slice::<serde_json::Value>(json) else { return (None, None) };
    let data = &json[0]["linkinfo"]["info_data"];
    let bitrate = data["bittiming"]["bitrate"].as_u64().and_then(|rate| rate.try_into().ok());
    (bitrate, data["state"].as_str().map(Into::into))
}

/// A CAN bus on a network interface; `None` for one over UDP, which belongs to the simulator.
pub fn can(bus: &CanBus, can: &Can) -> Option<Finding> {
    let CanInterface::Socket(name) = &bus.port.interface else { return None };
    let check = format!("can.{}", bus.name);
    let fail = |what: String| Finding::fail(&check, what).why("The drives are not reached: the robot does not move.");
    let set = format!(
        "sudo ip link set {name} down; sudo ip link set {name} type can bitrate {} restart-ms 100; \
         sudo ip link set {name} up",
        bus.driver.bitrate
    );
    Some(match can {
        Can { there: false, .. } => {
            fail(format!("there is no interface {name}")).cure("ip -br link show type can; sudo dmesg | grep -i can")
        }
        Can { can: false, .. } => fail(format!("{name} is no CAN interface")).cure("ip -br link show type can"),
        Can { bitrate: Some(rate), .. } if *rate != bus.driver.bitrate => {
            fail(format!("{name} runs at {rate} bit/s, {} is asked for", bus.driver.bitrate)).cure(set)
        }
        Can { up: false, .. } => fail(format!("{name} is down")).cure(set),
        Can { state: Some(state), .. } if state == "BUS-OFF" => fail(format!("{name} is BUS-OFF")).cure(set),
        Can { bitrate: Some(rate), state, .. } => {
            let state = state.as_deref().unwrap_or("state unknown");
            Finding::ok(&check, format!("{name} is up at {rate} bit/s, {state}"))
        }
        Can { .. } => Finding::ok(&check, format!("{name} is up, without a bit rate (virtual)")),
    })
}

/// Modules that are executables of their own.
pub fn commands(modules: &[ModuleEntry], found: impl Fn(&str) -> bool) -> Vec<Finding> {
    let missing = modules.iter().filter_map(|module| Some((module, module.command.as_deref()?)));
    let missing = missing.filter(|(_, command)| !found(command));
    let finding = |(module, command): (&ModuleEntry, &str)| {
        Finding::fail(format!("module {}", module.name()), format!("there is no executable {command}"))
            .why("The watchdog cannot start it.")
            .cure(format!("ls -l {command}; command -v {command}"))
    };
    missing.map(finding).collect()
}

/// True if `command`, a path or a name in `PATH`, can be executed.
pub fn executable(command: &str) -> bool {
    let is = |path: &Path| path.is_file() && access(path, AccessFlags::X_OK).is_ok();
    if command.contains('/') {
        return is(Path::new(command));
    }
    std::env::var_os("PATH").is_some_and(|path| std::env::split_paths(&path).any(|dir| is(&dir.join(command))))
}
