//! Which module is made of what, and where its ports are: the configuration becomes modules here, and nowhere else.

use crate::config::{self, Config, ConfigError, IoLine, ModbusBus, ModuleEntry, Robot, SIMULATOR, gpio_bus};
use crate::launch::launcher;
use crate::map_file;
#[cfg(feature = "ros2")]
use crate::node;
use crate::picture;
use crate::place::{self, GAMEPAD_BUS, HOST_BUS, LOG_BUS, RobotLocation, W1_BUS};
use crate::recording;
use crate::scene;
use crate::sheets;
use crate::simulated;
use ::host::ports::{Disk, GpioConfig, GpioInput, PortConfig};
use ::host::{HostConfig, beats};
use base::Duration;
use base::store::Request;
use drivers::rs485_bus::{Kind, Node};
use drivers::{auxiliary, canbus, imu, io, joydev, lidar, power, rs485a, rs485b};
use logger::ros::{Sensor, Translator};
use module::admission::Policy;
use module::{Line, Module, PortSpec, Shell, ShellConfig, State};
use navitools::Point;
use record::{Recorder, Sink};
use settings::robot::{Beacon, Geometry};
use sim::host::{self, Virtual};
use simulator::world::World;
use std::fs;
use std::path::{Path, PathBuf};
use watchdog::Watchdog;
use web::Web;
use web::center::command;
use web::center::scene::Scene;

pub use ::host::ports::settings::can_port_beside;

/// Makes the module `name` in its shell, to start in `wanted`, and says where its host finds what it needs.
pub fn module(place: &RobotLocation, name: &str, wanted: State) -> Result<(Shell, HostConfig), ConfigError> {
    let (config, notices) = Config::load_with_notices(&place.config, place.sim, &place.sets)?;
    let shell = shell(place, &config, name, wanted, HostOptions::live())?;
    let simulated_side = name == SIMULATOR;
    let ports = shell.module().ports().iter().map(|port| place_of(place, &config.robot, &port.bus, simulated_side));
    let ports = ports.collect::<Result<_, _>>()?;
    // One side tells of what crosses a wire.
    // On CAN each receives all: the frames are published by the driver of the drives.
    let raw = |port: &PortSpec| {
        let others = simulated_side || (name == imu::NAME && matches!(port.line, Line::Can { .. }));
        if others { None } else { raw_name(&config.robot, &port.bus) }
    };
    let raw = shell.module().ports().iter().map(raw).collect();
    let launch = match name {
        watchdog::NAME => Some(launcher(place, &config, notices)?),
        _ => None,
    };
    // Without a folder for their pages modules are judged by their announcements.
    let beats = launch.as_ref().and_then(|_| beats::folder(&place.run_dir).ok());
    let inputs = recording::inputs(place, &config, name, wanted)?;
    let policy = policy(&config);
    let host = HostConfig { lcm_url: place.lcm_url.clone(), ports, raw, policy, launch, beats, inputs };
    Ok((shell, host))
}

/// The accepted senders: a program in another language has no place in shared memory by which it could be identified.
pub(crate) fn policy(config: &Config) -> Policy {
    let ours = |name: &str| {
        let ours = |module: &&ModuleEntry| module.name() == name && module.command.is_none();
        config.modules.iter().find(ours).map(|module| module.name().into())
    };
    let has_ranging = config.robot.ranging_boards().next().is_some();
    Policy {
        commands: config.robot.bus.commands,
        power: ours(power::NAME).filter(|_| config.robot.power.is_some()),
        guard: ours(guard::NAME),
        ranging: ours(rs485a::NAME).filter(|_| has_ranging),
        lidar: ours(lidar::NAME),
        imu: ours(imu::NAME),
        io: ours(io::NAME)
            .filter(|_| config.robot.io.as_ref().is_some_and(|io| io.stops(&config.robot.stop).next().is_some())),
        motion: ours(canbus::NAME),
        estimator: ours(estimator::NAME),
        planner: ours(planner::NAME),
        announcing: config.modules.iter().filter_map(|module| ours(module.name())).collect(),
    }
}

/// The same robot in virtual time: spawn its watchdog, and it starts the rest.
pub fn virtual_machine(place: &RobotLocation, config: host::Config) -> Result<Virtual, ConfigError> {
    virtual_machine_recorded(place, config, |_| None)
}

/// The same; what each process is told and answers is written to the sink that there is for its module, if any.
pub fn virtual_machine_recorded(
    place: &RobotLocation,
    config: host::Config,
    sink: impl FnMut(&str) -> Option<Sink> + 'static,
) -> Result<Virtual, ConfigError> {
    virtual_machine_made(place, config, Part::ALL, sink)
}

/// The same as [`virtual_machine`], without the modules of these names: no other one waits for them.
///
/// # Errors
/// What is wrong with the configuration.
pub fn virtual_machine_without(
    place: &RobotLocation,
    config: host::Config,
    without: &[&str],
) -> Result<Virtual, ConfigError> {
    virtual_machine_made(place, config, Part { without, ..Part::ALL }, |_| None)
}

/// The same as [`virtual_machine`], with the logger, whose disk is that of the bus `log`.
pub fn virtual_machine_logged(place: &RobotLocation, config: host::Config) -> Result<Virtual, ConfigError> {
    virtual_machine_made(place, config, Part { logs: true, ..Part::ALL }, |_| None)
}

/// The same as [`virtual_machine_logged`], for a robot that programs outside virtual time see: its logs are files in
/// the folder of the configuration, and modules that are such programs themselves are left out.
///
/// # Errors
/// What is wrong with the configuration.
pub fn virtual_machine_attached(place: &RobotLocation, config: host::Config) -> Result<Virtual, ConfigError> {
    let robot = Config::load(&place.config, place.sim, &place.sets)?.robot;
    let mut machine = virtual_machine_made(place, config, Part { logs: true, foreign: false, ..Part::ALL }, |_| None)?;
    let mut disk = Disk::new(&log_folder(place, &robot));
    machine.back(LOG_BUS, move |request| match request {
        // Waiting for the medium would hold up all modules, many times a second.
        Request::Append { bytes, .. } => disk.perform(Request::Append { bytes, sync: false }),
        other => disk.perform(other),
    });
    Ok(machine)
}

/// Modules of a robot in virtual time, beside those that it always has.
#[derive(Clone, Copy)]
struct Part<'a> {
    /// The logger.
    logs: bool,
    /// Programs of their own, which cannot be started there.
    foreign: bool,
    /// Modules of these names are left out.
    without: &'a [&'a str],
}

impl Part<'_> {
    const ALL: Self = Self { logs: false, foreign: true, without: &[] };
}

fn virtual_machine_made(
    place: &RobotLocation,
    mut config: host::Config,
    Part { logs, foreign, without }: Part<'_>,
    mut sink: impl FnMut(&str) -> Option<Sink> + 'static,
) -> Result<Virtual, ConfigError> {
    // Nobody can look into virtual time; what is recorded there says so, too.
    let mut place = place.clone();
    place.sets.extend(["web.enabled=false", "ros2.enabled=false"].map(String::from));
    let mut read = Config::load(&place.config, place.sim, &place.sets)?;
    without.iter().for_each(|name| read.leave_out(name));
    // Nor is there another computer.
    read.leave_out(bridge::NAME);
    if !foreign {
        let programs = read.modules.iter().filter(|module| module.command.is_some());
        let programs: Vec<String> = programs.map(|module| module.name().into()).collect();
        programs.iter().for_each(|name| read.leave_out(name));
    }
    config.policy = policy(&read);
    config.full_duplex.extend(read.robot.power.iter().map(|power| power.bus.clone()));
    let connections = read.robot.io.iter().flat_map(|io| &io.modbus).filter(|bus| bus.line() == modbus::Line::Tcp);
    config.full_duplex.extend(connections.map(ModbusBus::bus));
    let connections = read.robot.io.iter().flat_map(|io| &io.serial).filter(|line| line.port.address.is_some());
    config.full_duplex.extend(connections.map(IoLine::bus));
    config.full_duplex.extend(read.robot.lidar.iter().map(config::Lidar::bus));
    config.usb.extend(read.robot.lidar.iter().map(config::Lidar::bus));
    config.full_duplex.extend(read.robot.imu.iter().map(config::Imu::bus));
    config.full_duplex.extend(read.robot.serial.iter().map(config::SerialLine::bus));
    let restart_delay_max = Some(config.restart_delay_max);
    let options = HostOptions { wire_time: false, seed: Some(config.seed), restart_delay_max, logs, guarded: true };
    let mut make = move |name: &str, wanted| {
        let mut shell = shell(&place, &read, name, wanted, options)?;
        if let Some(sink) = sink(name) {
            let header = recording::header(&place, name, wanted, options)?;
            shell.record(Recorder::new(&header, u64::MAX, sink));
        }
        Ok(shell)
    };
    Ok(Virtual::new(config, move |name, wanted| make(name, wanted).map_err(|error: ConfigError| error.to_string())))
}

/// What a host decides about its modules, beside the configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostOptions {
    /// The simulator plays the time that words take on a wire.
    pub wire_time: bool,
    /// What the simulator's chance comes from; none: always the same.
    pub seed: Option<u64>,
    /// The watchdog's longest delay before a restart; none: the usual.
    pub restart_delay_max: Option<Duration>,
    /// Whether there is a logger, where the configuration has one. In virtual time it would take more than all else.
    pub logs: bool,
    /// A watchdog starts the modules.
    pub guarded: bool,
}

impl HostOptions {
    /// A pseudo-terminal has no wire: the time on it must be played.
    pub const LIVE: Self = Self { wire_time: true, seed: None, restart_delay_max: None, logs: true, guarded: false };

    /// True for the live host, guarded or not.
    fn is_live(self) -> bool {
        self == Self { guarded: self.guarded, ..Self::LIVE }
    }

    /// The live host's, in this process.
    #[must_use]
    pub fn live() -> Self {
        Self { guarded: std::env::var_os(::host::processes::VARIABLE).is_some(), ..Self::LIVE }
    }
}

fn shell(
    place: &RobotLocation,
    config: &Config,
    name: &str,
    wanted: State,
    options: HostOptions,
) -> Result<Shell, ConfigError> {
    shell_in(place, config, name, wanted, options, || config::world(&place.config, place.world.as_deref(), &place.sets))
}

/// Makes a module in its shell; the simulated robot is in `world`, and has its map.
pub(crate) fn shell_in(
    place: &RobotLocation,
    config: &Config,
    name: &str,
    wanted: State,
    options: HostOptions,
    world: impl FnOnce() -> Result<World, ConfigError>,
) -> Result<Shell, ConfigError> {
    let without = (!options.logs).then(|| without_logger(config));
    let config = without.as_ref().unwrap_or(config);
    let world = if place.sim && MAPPED.contains(&name) { Some(world()?) } else { None };
    let robot = &mapped(&config.robot, world.as_ref());
    let module: Box<dyn Module> = match name {
        watchdog::NAME => {
            let usual = watchdog::Config::default();
            let modules = config.modules.iter().map(|module| module.guard.clone()).collect();
            let delay_max = options.restart_delay_max.unwrap_or(usual.delay_max);
            Box::new(Watchdog::new(watchdog::Config { modules, delay_max, ..usual }))
        }
        rs485a::NAME => Box::new(rs485a(&config.robot)?),
        rs485b::NAME => Box::new(rs485b(robot)?),
        power::NAME => Box::new(power(place, config)?),
        estimator::NAME => Box::new(estimator(robot)?),
        canbus::NAME => Box::new(canbus(place, config, options.guarded)?),
        guard::NAME => Box::new(guard(robot)?),
        auxiliary::NAME => Box::new(auxiliary(&config.robot)?),
        joydev::NAME => Box::new(joydev(robot)?),
        io::NAME => Box::new(inputs_and_outputs(robot)?),
        lidar::NAME => Box::new(lidars(robot)?),
        imu::NAME => Box::new(imus(robot)?),
        planner::NAME => Box::new(planner(place, robot, world.as_ref())?),
        web::NAME => Box::new(Web::new(web_settings(place, config, robot, world.as_ref()))),
        #[cfg(feature = "ros2")]
        ros2::NAME => Box::new(ros2::Ros2::new(node::settings(place, robot, world.as_ref()))),
        #[cfg(not(feature = "ros2"))]
        ros2::NAME => return refused("ros2: this executable was built without the feature \"ros2\"".into()),
        bridge::NAME => Box::new(bridge::Bridge::new(bridge_settings(place, config))),
        logger::NAME => Box::new(logger(place, robot, options)),
        SIMULATOR if place.sim => {
            let usual = simulated::config(place, world.unwrap_or_default(), robot, options.wire_time)?;
            Box::new(simulator::Simulator::new(simulator::Config { seed: options.seed.unwrap_or(usual.seed), ..usual }))
        }
        SIMULATOR => return refused(format!("module {name}: only with --sim")),
        _ => return refused(unknown(place, name)),
    };
    let mut shell = ShellConfig::new(name);
    shell.wanted = wanted;
    shell.report_from = config.robot.general.report_from;
    (shell.print_from, shell.send_from) = config.levels(name);
    if name == watchdog::NAME {
        shell.obeys_all = false;
        shell.end_within = WATCHDOG_END;
    }
    Ok(Shell::new(shell, module))
}

fn without_logger(config: &Config) -> Config {
    let mut config = config.clone();
    config.modules.retain(|module| module.name() != logger::NAME);
    config
}

/// Those that know where what is: their map is of the world, where that is simulated.
const MAPPED: [&str; 7] =
    [SIMULATOR, rs485b::NAME, estimator::NAME, planner::NAME, web::NAME, ros2::NAME, logger::NAME];

/// The robot with the beacons of a world, if that has any.
pub(crate) fn mapped(robot: &Robot, world: Option<&World>) -> Robot {
    let mut robot = robot.clone();
    if let Some(world) = world.filter(|world| !world.beacons.is_empty()) {
        let beacon = |known: &simulator::world::Beacon| Beacon { id: known.id, x: known.at.x, y: known.at.y };
        robot.beacons = world.beacons.iter().map(beacon).collect();
    }
    robot
}

/// Those without which the planner does not move the robot, and others may.
const PLANNING: [&str; 2] = [estimator::NAME, planner::NAME];

/// Those of them that the robot has, be they its own or programs in another language.
fn planning(config: &Config) -> impl Iterator<Item = &str> {
    config.modules.iter().map(ModuleEntry::name).filter(|name| PLANNING.contains(name))
}

/// There is no such module: with the line that lists it, if one does.
fn unknown(place: &RobotLocation, name: &str) -> String {
    let there_are = MODULES.join(", ");
    let listed = |root: settings::Node| {
        let settings::Value::Array(modules) = &root.below("modules")?.value else { return None };
        let names = modules.iter().enumerate().filter_map(|(n, module)| Some((n, module.below("name")?)));
        let is_own = |node: &settings::Node| matches!(&node.value, settings::Value::String(own) if own == name);
        let (n, node) = names.into_iter().find(|(_, node)| is_own(node))?;
        Some(format!("{}: modules[{n}].name = {name:?}", node.origin))
    };
    match settings::read(&place.config.join("modules.toml")).ok().and_then(listed) {
        Some(listed) => format!("{listed}: expected {there_are}; or a module of yours with its command"),
        None => format!("module {name}: there is none of that name; there are {there_are}"),
    }
}

const MODULES: [&str; 18] = [
    watchdog::NAME,
    SIMULATOR,
    power::NAME,
    rs485a::NAME,
    rs485b::NAME,
    canbus::NAME,
    joydev::NAME,
    auxiliary::NAME,
    io::NAME,
    lidar::NAME,
    imu::NAME,
    guard::NAME,
    estimator::NAME,
    planner::NAME,
    web::NAME,
    ros2::NAME,
    bridge::NAME,
    logger::NAME,
];
/// The watchdog ends modules one after the other, those that others depend on last.
const WATCHDOG_END: Duration = Duration::from_secs(6);

fn refused<T>(why: String) -> Result<T, ConfigError> {
    Err(ConfigError(vec![why]))
}

/// Where a port of a bus is; the simulator has the other end of it.
pub(crate) fn place_of(
    place: &RobotLocation,
    robot: &Robot,
    bus: &str,
    simulated_side: bool,
) -> Result<PortConfig, ConfigError> {
    let (run_dir, missing) = (&*place.run_dir, || refused(format!("bus {bus}: robot.toml has no table [{bus}]")));
    let port =
        match (bus.split_once('.').unwrap_or((bus, "")), simulated_side) {
            ((LOG_BUS, _), _) => Ok(PortConfig::Store { folder: log_folder(place, robot) }),
            ((GAMEPAD_BUS, _), side) => match &robot.gamepad {
                Some(gamepad) => Ok(gamepad.port.port(run_dir, side)),
                None => return missing(),
            },
            ((W1_BUS, _), side) => match &robot.w1 {
                Some(w1) if side => w1.port.simulated(run_dir),
                Some(w1) => Ok(w1.port.port(run_dir)),
                None => return missing(),
            },
            ((HOST_BUS, _), side) => match &robot.host {
                Some(host) if side => host.port.simulated(run_dir),
                Some(host) => Ok(host.port.port(run_dir)),
                None => return missing(),
            },
            (("can", name), _) => match robot.can.iter().find(|can| can.name == name) {
                Some(can) => can.port.interface.port(&place.lcm_url, can.driver.bitrate),
                None => return missing(),
            },
            (("i2c", name), side) => match robot.i2c.iter().find(|i2c| i2c.name == name) {
                Some(i2c) if side => i2c.port.place.simulated(run_dir).ok_or_else(|| {
                    format!("i2c.{name}.bus: the simulator needs \"unix:\" and a name in the run folder")
                }),
                Some(i2c) => Ok(i2c.port.place.port(run_dir, i2c.port.hz)),
                None => return missing(),
            },
            (("modbus", _), side) => match robot.io.iter().flat_map(|io| &io.modbus).find(|line| line.bus() == bus) {
                Some(line) if side => line.port.simulated(run_dir, bus),
                Some(line) => Ok(line.port.port(run_dir)),
                None => return missing(),
            },
            (("io", _), side) => match robot.io.iter().flat_map(|io| &io.serial).find(|line| line.bus() == bus) {
                Some(line) if side => line.port.stream().simulated(run_dir, bus),
                Some(line) => Ok(line.port.stream().port(run_dir)),
                None => return missing(),
            },
            (("lidar", _), side) => match robot.lidar.iter().find(|lidar| lidar.bus() == bus) {
                Some(lidar) if side => lidar.stream().simulated(run_dir, bus),
                Some(lidar) => Ok(lidar.driver_port(run_dir)),
                None => return missing(),
            },
            (("imu", _), side) => match robot.imu.iter().find(|imu| imu.bus() == bus) {
                Some(imu) if side => imu.port.stream().simulated(run_dir, bus),
                Some(imu) => Ok(imu.port.stream().port(run_dir)),
                None => return missing(),
            },
            (("serial", _), side) => match robot.serial.iter().find(|line| line.bus() == bus) {
                Some(line) if side => line.port.stream().simulated(run_dir, bus),
                Some(line) => Ok(line.port.stream().port(run_dir)),
                None => return missing(),
            },
            (("gpio", _), side) => match robot.io.iter().flat_map(|io| &io.gpio).find(|keys| gpio_bus(keys) == bus) {
                Some(keys) => gpio_line(run_dir, keys, side),
                None => return missing(),
            },
            (("stop", _), side) => match robot.stop.feed_line() {
                Some(line) => feed_line(run_dir, line, side),
                None => return missing(),
            },
            (_, side) => match robot.rs485_bus(bus) {
                Some(serial) if side => serial.line.simulated(run_dir, bus),
                Some(serial) => Ok(PortConfig::Terminal(serial.line.terminal(run_dir))),
                None => return missing(),
            },
        };
    port.or_else(refused)
}

/// `bridge`: the connections, and what is a module of this computer.
fn bridge_settings(place: &RobotLocation, config: &Config) -> bridge::Settings {
    let modules = config.modules.iter().map(ModuleEntry::name).chain([watchdog::NAME]);
    bridge::Settings {
        lcm_url: place.lcm_url.clone(),
        config_dir: place.config.clone(),
        links: config.robot.bridge.clone(),
        modules: modules.map(String::from).collect(),
    }
}

/// The line that feeds the motors.
fn feed_line(run_dir: &Path, line: &canbus::GpioConfig, simulated: bool) -> Result<PortConfig, String> {
    let canbus::GpioConfig { chip, line, active_low } = line.clone();
    match (chip.is_relative(), simulated) {
        (true, _) => Ok(PortConfig::GpioSocket { path: run_dir.join(chip), simulated }),
        (false, true) => Err(format!("stop.gpio.chip = {chip:?}: the simulator needs a name in the run folder")),
        (false, false) => Ok(PortConfig::Gpio(GpioConfig { chip, line, active_low })),
    }
}

/// A line of `driver_io`.
fn gpio_line(run_dir: &Path, keys: &io::GpioKeys, simulated: bool) -> Result<PortConfig, String> {
    let io::GpioKeys { chip, line, active_low, output, bias, debounce, .. } = keys.clone();
    match (chip.is_relative(), simulated) {
        (true, _) => Ok(PortConfig::GpioSocket { path: run_dir.join(chip), simulated }),
        (false, true) => {
            Err(format!("io.gpio {}: chip = {chip:?}: the simulator needs a name in the run folder", keys.name))
        }
        (false, false) if output => Ok(PortConfig::Gpio(GpioConfig { chip, line, active_low })),
        (false, false) => Ok(PortConfig::GpioInput(GpioInput { chip, line, active_low, bias, debounce })),
    }
}

/// The name of a bus on `LL_DATA_RAW_<BUS>`, where its frames are sent.
fn raw_name(robot: &Robot, bus: &str) -> Option<String> {
    let (kind, name) = bus.split_once('.')?;
    let raw = match kind {
        "can" => robot.can.iter().find(|can| can.name == name)?.port.raw,
        "rs485" => robot.rs485.iter().find(|serial| serial.name == name)?.line.raw,
        "modbus" => robot.io.as_ref()?.modbus.iter().find(|line| line.name == name)?.port.raw,
        "io" => {
            let line = robot.io.as_ref()?.serial.iter().find(|line| line.bus() == bus)?;
            return line.port.raw.then(|| line.name.to_uppercase());
        }
        "lidar" => robot.lidar.iter().find(|lidar| lidar.name == name)?.port.raw,
        "imu" => robot.imu.iter().find(|imu| imu.name == name)?.port.raw,
        "serial" => robot.serial.iter().find(|line| line.name == name)?.port.raw,
        "i2c" => robot.i2c.iter().find(|i2c| i2c.name == name)?.port.raw,
        _ => false,
    };
    raw.then(|| name.to_uppercase())
}

/// Where runs have their folders.
#[must_use]
pub fn log_folder(place: &RobotLocation, robot: &Robot) -> PathBuf {
    let folder = robot.log.folder.as_ref().map_or_else(place::log_folder, |folder| place.config.join(folder));
    std::path::absolute(&folder).unwrap_or(folder)
}

/// `logger`: all that is said. Its first run is written where the inputs of this run's modules are, if they are.
fn logger(place: &RobotLocation, robot: &Robot, options: HostOptions) -> logger::Logger {
    let folder = log_folder(place, robot);
    let run = std::env::var_os(recording::VARIABLE).map(PathBuf::from).filter(|_| options.is_live());
    let run = run.filter(|run| run.parent() == Some(&*folder));
    let config = logger::Config {
        bus: LOG_BUS.into(),
        robot: robot.general.name.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
        attachments: recording::attachments(place, options),
        run: run.and_then(|run| Some(run.file_name()?.to_str()?.to_owned())),
        ..robot.log.logger.clone()
    };
    logger::Logger::new(config, Translator::new(scene::translated(robot)))
}

/// `driver_rs485a`: the bus `a`.
fn rs485a(robot: &Robot) -> Result<rs485a::Rs485a, ConfigError> {
    let Some(bus) = robot.rs485_bus("rs485.a") else {
        return refused("driver_rs485a: robot.toml has no table [rs485.a]".into());
    };
    let with = |rangers: &[rs485a::Ranger], beam: f64| {
        rangers.iter().map(|ranger| rs485a::Ranger { beam, ..*ranger }).collect()
    };
    let config = rs485a::Config {
        bus: "rs485.a".into(),
        baud: bus.line.baud,
        crc: bus.driver.crc.into(),
        nodes: bus.driver.nodes.clone(),
        srfs: with(&robot.srfs, robot.sensors.srf08.beam_rad),
        irs: with(&robot.irs, Sensor::GP2Y0A41.field_of_view),
        wheels: rs485a::Wheels::of(&robot.geometry, &robot.limits),
    };
    rs485a::Rs485a::new(config).or_else(|error| refused(format!("driver_rs485a: {error}")))
}

/// `driver_rs485b`: the bus `b` with the beacon scanner.
fn rs485b(robot: &Robot) -> Result<rs485b::Rs485b, ConfigError> {
    let bus = robot.rs485_bus("rs485.b");
    let Some((bus, [node @ Node { kind: Kind::Sbs1, .. }])) = bus.map(|bus| (bus, &bus.driver.nodes[..])) else {
        return refused("driver_rs485b: robot.toml has no table [rs485.b] with one node, an sbs1".into());
    };
    let config = rs485b::Config {
        bus: "rs485.b".into(),
        baud: bus.line.baud,
        crc: bus.driver.crc.into(),
        node: node.clone(),
        beacons: robot.beacons.iter().map(|beacon| beacon.id).collect(),
    };
    rs485b::Rs485b::new(config).or_else(|error| refused(format!("driver_rs485b: {error}")))
}

/// Text of the file of the simulated world, for the scenario editor; empty where there is none, where it was not read
/// (a recorded run has another one), and where it is too long to be sent back.
fn world_text(place: &RobotLocation, world: Option<&World>) -> String {
    let path = config::world_place(&place.config, place.world.as_deref());
    let text = world.and_then(|_| fs::read_to_string(path).ok());
    text.filter(|text| text.len() <= command::SCENARIO_MAX).unwrap_or_default()
}

/// `web`: where it is reached, and what it shows besides what is said.
fn web_settings(place: &RobotLocation, config: &Config, robot: &Robot, world: Option<&World>) -> web::Settings {
    // A map that cannot be read is the planner's to tell.
    let map = robot.planner.map.as_ref().and_then(|file| map_file::load(&place.config.join(file)).ok());
    let wire_time = HostOptions::LIVE.wire_time;
    // A data sheet that cannot be read is the driver's to tell.
    let simulated = |world: &World| simulated::config(place, world.clone(), robot, wire_time).ok();
    let faults = world.and_then(simulated).map(simulator::Simulator::offered).unwrap_or_default();
    let route = |route: &simulator::world::Route| {
        let points = route.waypoints.iter().map(|at| [at.x, at.y]).collect();
        command::Route { name: route.name.clone(), points, looped: route.looped }
    };
    let limits = scene::hand_limits(robot);
    let routes = world.iter().flat_map(|world| &world.routes).map(route).collect();
    web::Settings {
        robot: robot.general.name.clone(),
        lcm_url: place.lcm_url.clone(),
        web: robot.web.clone(),
        config: place.config.clone(),
        scene: scene::translated(robot),
        center: Scene { world: world_text(place, world), ..scene::of(robot, world, map.as_ref()).with_faults(faults) },
        recorded: recording::scene,
        picture: |run| picture::png(run, recording::described),
        critical: config.critical().collect(),
        logs: log_folder(place, robot),
        run: place.run_dir.clone(),
        commands: command::Robot { limits, routes, simulated: place.sim },
    }
}

/// `estimator`: the map of beacons, and as many of them at once as the scanner takes.
fn estimator(robot: &Robot) -> Result<estimator::Estimator, ConfigError> {
    let beacon =
        |beacon: &Beacon| estimator::filter::Beacon { id: beacon.id.into(), at: Point { x: beacon.x, y: beacon.y } };
    let beacons = robot.beacons.iter().map(beacon).collect();
    let config = estimator::Config {
        filter: estimator::filter::Config { beacons, ..robot.estimator.clone() },
        wheels: match robot.base {
            Some(base) => estimator::Wheels::Driven { radius_m: base.radius_m() },
            // Its rotation follows from the angle of its wheel, which errs like the way of a wheel at this distance.
            None if robot.is_measured_by_drives() => estimator::Wheels::Driven { radius_m: robot.geometry.wheelbase_m },
            None => {
                let Geometry { wheelbase_m, track_m, .. } = robot.geometry;
                estimator::Wheels::Steered { wheelbase_m, track_m }
            }
        },
        active_max: rs485::boards::sbs1::BEACONS,
        // The first one by its name.
        imu: robot.imu.iter().map(|imu| imu.name.clone()).min(),
    };
    estimator::Estimator::new(config).or_else(|error| refused(format!("estimator: {error}")))
}

/// `driver_power`: the link that the table `power` names. In simulation the computer belongs to somebody else.
fn power(place: &RobotLocation, config: &Config) -> Result<power::Power, ConfigError> {
    let robot = &config.robot;
    let found = robot.power.as_ref().and_then(|power| Some((power, robot.rs485_bus(&power.bus)?)));
    let Some((power, bus, node)) = found.and_then(|(power, bus)| Some((power, bus, bus.driver.nodes.first()?))) else {
        return refused("driver_power: robot.toml has no table [power]".into());
    };
    let others = config.modules.iter().map(ModuleEntry::name);
    let config = power::Config {
        baud: bus.line.baud,
        crc: bus.driver.crc.into(),
        node: node.clone(),
        // The simulator plays the hardware: that is not ended, but switched off.
        modules: others.filter(|name| ![power::NAME, SIMULATOR].contains(name)).map(Into::into).collect(),
        simulated: place.sim,
        ..power.clone()
    };
    power::Power::new(config).or_else(|error| refused(format!("driver_power: {error}")))
}

/// `driver_aux`: the first I2C bus with chips on it, and the thermometers.
fn auxiliary(robot: &Robot) -> Result<auxiliary::Auxiliary, ConfigError> {
    let bus = robot.i2c.iter().find(|bus| !bus.driver.chips.is_empty()).map(|bus| auxiliary::BusConfig {
        bus: format!("i2c.{}", bus.name),
        hz: bus.port.hz,
        chips: bus.driver.chips.iter().filter_map(auxiliary::ChipKeys::chip).collect(),
    });
    let w1 =
        robot.w1.as_ref().map(|w1| auxiliary::W1Config { bus: W1_BUS.into(), thermometers: w1.driver.sensors.clone() });
    let sensors = robot.host.as_ref().map(|host| host.driver.sensors.clone());
    let host = sensors.map(|sensors| auxiliary::HostConfig { bus: HOST_BUS.into(), sensors });
    let driver = auxiliary::Auxiliary::new(auxiliary::Config { bus, w1, host });
    driver.or_else(|error| refused(format!("driver_aux: {error}")))
}

/// Why the drives cannot move the robot: which axes have none, with the line that says what base it is.
fn unmoved(place: &RobotLocation, robot: &Robot) -> String {
    let is_on_line = |axis: &str| {
        robot.serial.iter().any(|line| line.driver.motors().into_iter().any(|(moved, _)| moved.name() == axis))
    };
    let has = |bus: &config::CanBus, axis: &str| bus.driver.nodes.iter().any(|node| node.axis.name() == axis);
    let is_on_bus = |axis: &str| robot.can.iter().any(|bus| has(bus, axis));
    let without = robot.axes().iter().filter(|axis| !is_on_line(axis) && !is_on_bus(axis));
    let without = without.map(|axis| format!("{axis:?}")).collect::<Vec<_>>().join(", ");
    let base = |root: settings::Node| {
        let kind = root.below("base")?.below("kind")?;
        Some(format!("{}: base.kind = {}", kind.origin, kind.value))
    };
    let base = Config::tree(&place.config, place.sim, &place.sets).ok().and_then(base);
    if let (Some(base), false) = (base, without.is_empty()) {
        return format!(
            "{base}: expected a drive of each axis: no [[can.<bus>.nodes]] or [serial.<name>] has {without}"
        );
    }
    let axes = if robot.base.is_none() { "both axes".into() } else { robot.axes().join(", ") };
    let lines = if robot.serial.is_empty() { "" } else { ", alone or with the tables [serial.<name>]" };
    let why = if without.is_empty() { String::new() } else { format!(": no drive has axis = {without}") };
    format!("driver_canbus: robot.toml has no [can.<bus>] with {axes}{lines}{why}")
}

/// `driver_canbus`: the CAN buses that the drives are on, and the serial lines.
pub(crate) fn canbus(place: &RobotLocation, config: &Config, guarded: bool) -> Result<canbus::Canbus, ConfigError> {
    let robot = &config.robot;
    let mut buses = robot.can.clone();
    buses.iter_mut().try_for_each(|bus| sheets::read(place, bus))?;
    let Some((_, usual)) = robot.motion(&buses) else {
        return refused(unmoved(place, robot));
    };
    let buses = robot.buses_of_motion(&buses);
    buses.iter().try_for_each(|bus| sheets::check_inputs(place, bus, &robot.stop))?;
    // The watchdog's list says of each process whether it can be judged. Where no other one is critical, its own row
    // does: a watchdog that is late finds a hang of this one too late, too.
    let (own, others): (Vec<_>, Vec<_>) = config.critical().partition(|name| name == canbus::NAME);
    let config = canbus::Config {
        critical: if others.is_empty() { own } else { others },
        planning: planning(config).map(Into::into).collect(),
        has_pause_line: robot.power.is_some(),
        fields: robot.lidar.iter().filter(|lidar| lidar.stop.stops()).map(config::Lidar::bus).collect(),
        ranging: robot.ranging_boards().map(|(_, _, board)| board).collect(),
        ranging_age_max: robot.sensors.age_max,
        odometry: robot.has_odometry(),
        guarded,
        stop: robot.stop.clone(),
        protection: protection(&robot.guard, &robot.geometry),
        ..usual
    };
    let driver = canbus::Canbus::new(config).or_else(|error| refused(sheets::named(place, &buses, &error)))?;
    buses.iter().try_for_each(|bus| sheets::check(place, bus, &driver))?;
    Ok(driver)
}

/// Drives that are refused at their boot-up if they are as their sheets state them. Of a configuration that is refused:
/// none.
pub(crate) fn misfits(place: &RobotLocation, config: &Config) -> Vec<sheets::Misfit> {
    let mut buses = config.robot.can.clone();
    let read = buses.iter_mut().try_for_each(|bus| sheets::read(place, bus));
    let Some(driver) = read.and_then(|()| canbus(place, config, false)).ok() else { return Vec::new() };
    buses.iter().flat_map(|bus| sheets::misfits(place, bus, &driver)).collect()
}

/// What `driver_canbus` applies of the table `[guard]`.
fn protection(guard: &guard::Settings, geometry: &Geometry) -> canbus::protection::Config {
    let guard::Settings { ranging, speed_blind, creep, .. } = *guard;
    let (guarded, reach) = (ranging != guard::Ranging::None, geometry.reach_m());
    canbus::protection::Config { guarded, speed_blind, creep, reach }
}

/// `guard`: the robot's outline, its sonars and its lidars.
fn guard(robot: &Robot) -> Result<guard::Guard, ConfigError> {
    guard::Guard::new(&robot.guard_config()).or_else(|error| refused(format!("guard: {error}")))
}

/// `driver_io`: the Modbus, serial and GPIO lines.
fn inputs_and_outputs(robot: &Robot) -> Result<io::Io, ConfigError> {
    let Some(config) = robot.io.as_ref().map(|io| io.config(&robot.signals, W1_BUS, &robot.stop)) else {
        return refused("driver_io: robot.toml has no table [io]".into());
    };
    io::Io::new(config).or_else(|error| refused(format!("driver_io: {error}")))
}

/// `driver_lidar`: the lidars.
fn lidars(robot: &Robot) -> Result<lidar::Lidars, ConfigError> {
    if robot.lidar.is_empty() {
        return refused("driver_lidar: robot.toml has no table [lidar.<name>]".into());
    }
    if robot.lidar.len() > lidar::DEVICES_MAX {
        return refused(format!("driver_lidar: more than {} tables [lidar.<name>] in robot.toml", lidar::DEVICES_MAX));
    }
    Ok(lidar::Lidars::new(lidar::Config { devices: robot.lidar.iter().map(config::Lidar::device).collect() }))
}

/// `driver_imu`: the inertial measurement units.
fn imus(robot: &Robot) -> Result<imu::Imus, ConfigError> {
    if robot.imu.is_empty() {
        return refused("driver_imu: robot.toml has no table [imu.<name>]".into());
    }
    if robot.imu.len() > imu::DEVICES_MAX {
        return refused(format!("driver_imu: more than {} tables [imu.<name>] in robot.toml", imu::DEVICES_MAX));
    }
    Ok(imu::Imus::new(imu::Config { devices: robot.imu.iter().filter_map(|imu| imu.device(robot)).collect() }))
}

/// `driver_joydev`: the gamepad, within the limits of a manual source.
fn joydev(robot: &Robot) -> Result<joydev::Joydev, ConfigError> {
    let Some(gamepad) = &robot.gamepad else {
        return refused("driver_joydev: robot.toml has no table [gamepad]".into());
    };
    let commands = joydev::Commands::of(robot.base.as_ref());
    let config = joydev::Config { bus: GAMEPAD_BUS.into(), ..gamepad.driver.clone().within(&robot.limits, commands) };
    joydev::Joydev::new(config, commands).or_else(|error| refused(format!("driver_joydev: {error}")))
}

/// `planner`: the robot's measures and limits, and a map: the file that the configuration names, or the world's walls.
fn planner(place: &RobotLocation, robot: &Robot, world: Option<&World>) -> Result<planner::Planner, ConfigError> {
    let map = match &robot.planner.map {
        Some(file) => Some(map_file::load(&place.config.join(file)).or_else(refused)?),
        // One that is too large for a map is an open floor.
        None => world.and_then(|world| map_file::of_world(world).ok()),
    };
    let abilities = robot.abilities();
    Ok(planner::Planner::new(planner::Config {
        body: (&robot.geometry).into(),
        limits: planner::Limits::new(&robot.limits, &robot.planner.behaviour, abilities),
        behaviour: robot.planner.behaviour,
        law: robot.planner.behaviour.law(robot.guard.law(robot.limits.deceleration_mps2, robot.power_lost_mps2())),
        sonar_beam: robot.sensors.srf08.beam_rad,
        age_max: robot.sensors.age_max,
        has_sonars: !robot.srfs.is_empty() || robot.guard.ranging.has_sonars(),
        abilities,
        map,
        home: robot.planner.home,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::host::ports::{ByteParity, GamepadPlace, TerminalConfig};
    use base::gpio::LineId;
    use drivers::canbus::{Cia402Config, Drive, SecondWay, VelocityUnit, WheelKeys, table};
    use settings::Section as _;

    fn shipped(sim: bool) -> RobotLocation {
        RobotLocation {
            config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
            run_dir: "/run/advee".into(),
            lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
            sets: Vec::new(),
            sim,
            world: None,
        }
    }

    #[test]
    fn the_shipped_robot_has_a_witness_for_all_that_frees_it() {
        let config = Config::load(&shipped(true).config, true, &[]).unwrap();
        let Policy { power, guard, ranging, motion, estimator, planner, .. } = policy(&config);
        let witnesses = [power, guard, ranging, motion, estimator, planner].map(Option::unwrap_or_default);
        let expected = ["driver_power", "guard", "driver_rs485a", "driver_canbus", "estimator", "planner"];
        assert_eq!(witnesses, expected);
    }

    #[test]
    fn a_module_in_another_language_is_no_witness_and_works_all_the_same() {
        let mut config = Config::load(&shipped(true).config, true, &[]).unwrap();
        let entry = config.modules.iter_mut().find(|module| module.name() == estimator::NAME).unwrap();
        entry.command = Some("estimator.py".into());
        assert_eq!(policy(&config).estimator, None, "its datagrams do not tell its process");
        assert!(policy(&config).planner.is_some());
    }

    #[test]
    fn the_robot_waits_for_a_planner_in_another_language_as_for_its_own() {
        let mut config = Config::load(&shipped(true).config, true, &[]).unwrap();
        let entry = config.modules.iter_mut().find(|module| module.name() == planner::NAME).unwrap();
        entry.command = Some("planner.py".into());
        assert_eq!(policy(&config).planner, None, "its datagrams do not tell its process");
        let planning: Vec<&str> = planning(&config).collect();
        assert_eq!(planning, PLANNING);
    }

    #[test]
    fn a_module_that_is_left_out_is_not_started_and_no_other_waits_for_it() {
        let runs = |without: &[&str]| {
            let mut machine = virtual_machine_without(&shipped(true), host::Config::default(), without).unwrap();
            machine.spawn(watchdog::NAME, State::Run).unwrap();
            machine.run_until(base::Instant::from_millis(2000));
            [planner::NAME, joydev::NAME, canbus::NAME].map(|name| machine.pid(name).is_some())
        };
        assert_eq!(runs(&[]), [true, true, true]);
        assert_eq!(runs(&[planner::NAME, SIMULATOR]), [false, true, true]);
    }

    #[test]
    fn a_data_sheet_of_another_device_is_refused_before_anything_starts() {
        let place = shipped(true);
        let mut config = Config::load(&place.config, true, &[]).unwrap();
        let mut with = |sheet: &str| {
            let sheet = Path::new(env!("CARGO_MANIFEST_DIR")).join("../buses/canopen/eds").join(sheet);
            config.robot.can[0].driver.nodes[1].eds = Some(sheet);
            shell(&place, &config, canbus::NAME, State::Run, HostOptions::LIVE)
                .map(|_| ())
                .map_err(|error| error.to_string())
        };
        assert_eq!(with("icla_sim.eds"), Ok(()));
        let refused = with("epos_sim.eds").unwrap_err();
        assert!(refused.ends_with("not the sheet of a drive for the steering: it has no object 0x605A:0"), "{refused}");
        assert!(with("no.eds").unwrap_err().contains("no.eds: "));
    }

    #[test]
    fn an_identity_that_is_not_that_of_the_sheet_is_remarked_with_its_line() {
        let sheet = "epos_sim.eds";
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../buses/canopen/eds").join(sheet);
        let text = std::fs::read_to_string(&path).unwrap();
        let made = |sheet: &str, change: fn(&mut Cia402Config)| {
            let mut keys = Cia402Config { gear: Some(26.0), velocity_unit: VelocityUnit::Rpm, ..Cia402Config::usual() };
            change(&mut keys);
            let (place, config) = by_sheet(sheet, keys, SecondWay::Power);
            let found = misfits(&place, &config);
            assert!(found.iter().all(|misfit| misfit.is_simulated));
            found.into_iter().map(|misfit| misfit.remark).collect::<Vec<_>>()
        };
        assert_eq!(made(sheet, |keys| keys.vendor = Some(0xFB)), [""; 0]);
        assert_eq!(made(sheet, |keys| keys.revision_min = Some(0x2033_0000)), [""; 0]);
        let changes: [(_, fn(&mut Cia402Config), _); 3] = [
            (
                1,
                |keys| keys.vendor = Some(0xFC),
                "(vendor) is 0xFB by the sheet, and the keys of the propulsion drive demand 0xFC: ",
            ),
            (
                2,
                |keys| keys.product = Some(7),
                "(product) is 0x64100000 by the sheet, and the keys of the propulsion drive demand 0x7: ",
            ),
            (
                3,
                |keys| keys.revision_min = Some(0x2033_0001),
                "(revision) is 0x20330000 by the sheet, and the keys of the propulsion drive demand at least \
                 0x20330001: ",
            ),
        ];
        for (sub, change, words) in changes {
            let line = text.lines().position(|line| line == format!("[1018sub{sub}]")).unwrap() + 1;
            let found = made(sheet, change);
            let expected = format!("epos_sim.eds:{line}: 0x1018:{sub} {words}");
            assert!(found.len() == 1 && found[0].contains(&expected), "{expected}\n{found:?}");
        }
        // An object without a value: what the sheet states of the device.
        let other = std::env::temp_dir().join(format!("advee-identity-{}.eds", std::process::id()));
        let unstated = text.replace("DefaultValue=0x64100000", "DefaultValue=0");
        let with = |device: &str| {
            let line = "[DeviceInfo]";
            assert!(unstated.contains(line));
            std::fs::write(&other, unstated.replacen(line, &format!("{line}\n{device}"), 1)).unwrap();
            made(other.to_str().unwrap(), |keys| keys.product = Some(7))
        };
        assert_eq!(with("Granularity=8"), [""; 0]);
        let line = unstated.lines().position(|line| line == "[DeviceInfo]").unwrap() + 2;
        let found = with("ProductNumber=0x8");
        let expected = format!(".eds:{line}: 0x1018:2 (product) is 0x8 by the sheet");
        assert!(found.len() == 1 && found[0].contains(&expected), "{expected}\n{found:?}");
        std::fs::remove_file(&other).unwrap();
    }

    /// The shipped robot, with the propulsion by this sheet.
    fn by_sheet(sheet: &str, keys: Cia402Config, second_way: SecondWay) -> (RobotLocation, Config) {
        let place = shipped(false);
        let mut config = Config::load(&place.config, false, &[]).unwrap();
        let node = &mut config.robot.can[0].driver.nodes[0];
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../buses/canopen/eds");
        (node.drive, node.eds) = (Drive::Cia402(keys), Some(folder.join(sheet)));
        config.robot.stop.second_way = second_way;
        (place, config)
    }

    fn epos(gear: f64) -> Drive {
        Drive::Wheel(WheelKeys { gear, table: table::built_in("epos") })
    }

    #[test]
    fn a_speed_that_the_built_in_drive_cannot_reach_with_its_gear_is_refused() {
        let place = shipped(true);
        let mut config = Config::load(&place.config, true, &[]).unwrap();
        config.robot.can[0].driver.nodes[0].drive = epos(1000.0);
        let made = shell(&place, &config, canbus::NAME, State::Run, HostOptions::LIVE);
        let why = made.map(|_| ()).unwrap_err().to_string();
        let expected = "the propulsion drive is refused: 0x607F:0 (greatest velocity): it takes 1 to 25000, not ";
        assert!(why.contains(expected), "{why}");
    }

    #[test]
    fn an_input_that_stops_the_robot_is_one_that_the_drive_has_by_its_sheet() {
        let made = |sheet: &str, velocity_unit, sets: &[String]| {
            let keys = Cia402Config { gear: Some(26.0), velocity_unit, ..Cia402Config::usual() };
            let (place, mut config) = by_sheet(sheet, keys, SecondWay::Power);
            config.robot.stop.inputs = Config::load(&place.config, false, sets).unwrap().robot.stop.inputs;
            let made = shell(&place, &config, canbus::NAME, State::Run, HostOptions::LIVE);
            made.map(|_| ()).map_err(|error| error.to_string())
        };
        let input = [r#"stop.inputs=[{axis="propulsion",bit=3}]"#.to_owned()];
        assert_eq!(made("others/maxon_epos4_50_15_node1.dcf", VelocityUnit::Stated, &input), Ok(()));
        assert_eq!(made("epos_sim.eds", VelocityUnit::Rpm, &[]), Ok(()));
        let why = made("epos_sim.eds", VelocityUnit::Rpm, &input).unwrap_err();
        let expected = "0x60FD:0 (digital inputs): the propulsion drive has no such object, and [stop] inputs names it";
        assert!(why.ends_with(&format!("epos_sim.eds: {expected}")), "{why}");
    }

    #[test]
    fn a_drive_by_its_sheet_is_made_or_refused_with_file_line_object_and_reason() {
        let made = |sheet: &str, keys: &Cia402Config, second_way| {
            let (place, config) = by_sheet(sheet, keys.clone(), second_way);
            let made = shell(&place, &config, canbus::NAME, State::Run, HostOptions::LIVE);
            made.map(|_| ()).map_err(|error| error.to_string())
        };
        let stated = Cia402Config { gear: Some(26.0), ..Cia402Config::usual() };
        let rpm = Cia402Config { velocity_unit: VelocityUnit::Rpm, ..stated.clone() };
        assert_eq!(made("others/maxon_epos4_50_15_node1.dcf", &stated, SecondWay::None), Ok(()));
        assert_eq!(made("epos_sim.eds", &rpm, SecondWay::Power), Ok(()));
        let why = made("epos_sim.eds", &rpm, SecondWay::None).unwrap_err();
        let words =
            "epos_sim.eds: the propulsion drive is refused: 0x605A:0 (quick stop option): the drive has no such object";
        assert!(why.ends_with(words), "{why}");
        let fast = Cia402Config { gear: Some(260.0), ..rpm };
        let why = made("epos_sim.eds", &fast, SecondWay::Power).unwrap_err();
        let sheet =
            std::fs::read_to_string(shipped(false).config.join("../../buses/canopen/eds/epos_sim.eds")).unwrap();
        let line = sheet.lines().position(|line| line == "[607F]").unwrap() + 1;
        let words =
            format!("epos_sim.eds:{line}: the propulsion drive is refused: 0x607F:0 (greatest velocity): it takes");
        assert!(why.contains(&words), "{why}");
        assert!(made("no.eds", &stated, SecondWay::Power).unwrap_err().contains("no.eds: "));
    }

    #[test]
    fn every_listed_module_can_be_made() {
        for place in [shipped(false), shipped(true)] {
            let config = Config::load(&place.config, place.sim, &[]).unwrap();
            let listed = config.modules.iter().map(ModuleEntry::name);
            for name in listed.chain([watchdog::NAME]) {
                let (shell, host) = module(&place, name, State::Run).unwrap();
                assert_eq!((shell.name(), shell.module().ports().len()), (name, host.ports.len()));
            }
        }
    }

    #[test]
    fn both_ends_of_a_simulated_line_meet_in_the_run_folder() {
        let place = shipped(true);
        let (_, driver) = module(&place, "driver_rs485a", State::Run).unwrap();
        let (_, simulator) = module(&place, SIMULATOR, State::Run).unwrap();
        let path = PathBuf::from("/run/advee/rs485-a");
        assert_eq!(driver.ports, [PortConfig::Terminal(TerminalConfig::new(path.clone(), 115_200))]);
        assert!(simulator.ports.contains(&PortConfig::Pseudo { link: path, baud: 115_200 }));
    }

    #[test]
    fn at_a_real_port_the_boards_are_simulated_where_it_is_wired_to() {
        let side = |name, at: &str| {
            let sets = ["port=\"/dev/ttyLAB0\"".into(), "transport=\"parity\"".into(), format!("simulated_at={at:?}")];
            let place =
                RobotLocation { sets: sets.map(|set: String| format!("rs485.a.{set}")).into(), ..shipped(true) };
            module(&place, name, State::Run).unwrap().1.ports
        };
        let terminal = |path: &str| {
            let plain = TerminalConfig::new(path.into(), 115_200);
            PortConfig::Terminal(TerminalConfig { transport: ::host::ports::Transport::Parity, ..plain })
        };
        assert_eq!(side("driver_rs485a", "/dev/ttyLAB1"), [terminal("/dev/ttyLAB0")]);
        assert!(side(SIMULATOR, "/dev/ttyLAB1").contains(&terminal("/dev/ttyLAB1")));
        assert_eq!(side("driver_rs485a", "boards"), [terminal("/dev/ttyLAB0")]);
        let pseudo = PortConfig::Pseudo { link: "/run/advee/boards".into(), baud: 115_200 };
        assert!(side(SIMULATOR, "boards").contains(&pseudo));
    }

    /// Both ends of a line of bytes of the courier with these tables more, at `/dev/ttyLAB10` and `at`; the simulator's
    /// second.
    fn ends_of(bus: &str, tables: &str, at: &str) -> [Result<PortConfig, String>; 2] {
        let place = shipped(true);
        let read = |name: &str| std::fs::read_to_string(place.config.join(name)).unwrap();
        let robot = format!("{}\n{tables}\nport = \"/dev/ttyLAB10\"\n{at}\n", read("robot.toml"));
        let node = |name: &str, text: &str| settings::Node::parse(Path::new(name), text).unwrap();
        let (robot, modules) = (node("robot.toml", &robot), node("modules.toml", &read("modules.toml")));
        let config = Config::merge::<&str>(robot, Some(node("sim.toml", &read("sim.toml"))), modules, &[]).unwrap();
        [false, true].map(|side| place_of(&place, &config.robot, bus, side).map_err(|error| error.to_string()))
    }

    #[test]
    fn at_a_real_port_a_device_of_bytes_is_simulated_where_it_is_wired_to() {
        for (bus, tables, baud, parity) in [
            ("lidar.a", "[lidar.a]\nmodel = \"ld19\"", 230_400, ByteParity::None),
            ("lidar.a", "[lidar.a]\nmodel = \"rplidar-a1\"", 115_200, ByteParity::None),
            ("imu.a", "[imu.a]\nmodel = \"witmotion\"", 115_200, ByteParity::None),
            (
                "modbus.a",
                "[io.modbus.a]\nsignals = [ { name = \"b\", table = \"coil\", address = 0 } ]\nparity = \"odd\"",
                19_200,
                ByteParity::Odd,
            ),
        ] {
            let terminal = |path: &str, low_latency| {
                let bytes = TerminalConfig { bytes: Some(parity), ..TerminalConfig::new(path.into(), baud) };
                TerminalConfig { low_latency, ..bytes }
            };
            let is_quick = bus != "modbus.a";
            // Its motor turns while DTR is low.
            let dtr_low = tables.contains("rplidar");
            let ours = PortConfig::Terminal(TerminalConfig { dtr_low, ..terminal("/dev/ttyLAB10", is_quick) });
            let [driver, simulator] = ends_of(bus, tables, "simulated_at = \"/dev/ttyLAB11\"");
            assert_eq!(driver, Ok(ours.clone()), "{bus}");
            assert_eq!(simulator, Ok(PortConfig::Terminal(terminal("/dev/ttyLAB11", is_quick))), "{bus}");
            let [driver, simulator] = ends_of(bus, tables, "simulated_at = \"device\"");
            assert_eq!(driver, Ok(ours), "{bus}");
            assert_eq!(simulator, Ok(PortConfig::PseudoBytes { link: "/run/advee/device".into(), baud }), "{bus}");
            let [_, simulator] = ends_of(bus, tables, "");
            let why = "port = \"/dev/ttyLAB10\": the simulator needs a name in the run folder, or simulated_at";
            assert_eq!(simulator, Err(format!("{bus}.{why}")));
        }
    }

    #[test]
    fn the_gamepad_is_the_simulator_s_where_its_socket_lies_in_the_run_folder() {
        let ports = |sim, name: &str, set: &str| {
            let sets = if set.is_empty() { Vec::new() } else { vec![format!("gamepad.device={set:?}")] };
            module(&RobotLocation { sets, ..shipped(sim) }, name, State::Run).unwrap().1.ports
        };
        let stream = |path: &str| PortConfig::Gamepad { place: GamepadPlace::Stream(path.into()), grab: false };
        let hub = PortConfig::GamepadHub { path: "/run/advee/gamepad".into() };
        assert_eq!(ports(true, joydev::NAME, ""), [stream("/run/advee/gamepad")]);
        assert!(ports(true, SIMULATOR, "").contains(&hub));
        assert_eq!(ports(true, joydev::NAME, "file:/tmp/pad"), [stream("/tmp/pad")]);
        let gamepads = |port: &PortConfig| matches!(port, PortConfig::GamepadHub { .. });
        assert!(!ports(true, SIMULATOR, "file:/tmp/pad").iter().any(gamepads));
        assert_eq!(ports(false, joydev::NAME, ""), [PortConfig::Gamepad { place: GamepadPlace::Auto, grab: false }]);
    }

    #[test]
    fn the_gpio_line_is_the_simulator_s_where_its_chip_is_a_name_in_the_run_folder() {
        let ports = |name: &str, chip: &str| {
            let sets = ["second_way=gpio".into(), format!("gpio.chip={chip:?}"), "gpio.line=17".into()];
            let sets = sets.map(|set: String| format!("stop.{set}")).into();
            module(&RobotLocation { sets, ..shipped(true) }, name, State::Run).map(|(_, host)| host.ports)
        };
        let end = |simulated| PortConfig::GpioSocket { path: "/run/advee/gpio-motors".into(), simulated };
        assert_eq!(ports(canbus::NAME, "gpio-motors").unwrap()[1..], [end(false)]);
        assert!(ports(SIMULATOR, "gpio-motors").unwrap().contains(&end(true)));
        let chip = "/dev/gpiochip0";
        let line = GpioConfig { chip: chip.into(), line: LineId::Number(17), active_low: false };
        assert_eq!(ports(canbus::NAME, chip).unwrap()[1..], [PortConfig::Gpio(line)]);
        let why = ports(SIMULATOR, chip).unwrap_err().to_string();
        assert_eq!(why, "stop.gpio.chip = \"/dev/gpiochip0\": the simulator needs a name in the run folder");
    }

    /// The shipped robot with `[io]`.
    fn with_io(sim: bool, address: &str) -> Config {
        let place = shipped(sim);
        let read = |name: &str| std::fs::read_to_string(place.config.join(name)).unwrap();
        let io = format!(
            r#"
            [io.modbus.plc]
            address = {address:?}
            signals = [ {{ name = "a", table = "input", address = 7, scale = 0.1, simulated = 24.5 }} ]
            [io.modbus.line]
            port = "modbus-line"
            unit = 9
            signals = [ {{ name = "b", table = "coil", address = 0, output = true, safe = 1 }} ]
            [[io.gpio]]
            name = "c"
            chip = "button"
            line = 3
            "#
        );
        let node = |name: &str, text: &str| settings::Node::parse(Path::new(name), text).unwrap();
        let robot = node("robot.toml", &format!("{}\n{io}", read("robot.toml")));
        let over = sim.then(|| node("sim.toml", &read("sim.toml")));
        Config::merge::<&str>(robot, over, node("modules.toml", &read("modules.toml")), &[]).unwrap()
    }

    #[test]
    fn both_ends_of_inputs_and_outputs_meet_in_the_run_folder_and_on_the_loopback_interface() {
        let (place, config) = (shipped(true), with_io(true, "127.0.0.1:1502"));
        let side = |simulated| {
            let port = |bus: &str| place_of(&place, &config.robot, bus, simulated).unwrap();
            ["modbus.plc", "modbus.line", "gpio.c"].map(port)
        };
        let address = "127.0.0.1:1502".parse().unwrap();
        let (line, path) = (PathBuf::from("/run/advee/modbus-line"), PathBuf::from("/run/advee/button"));
        let parity = Some(ByteParity::Even);
        let terminal = TerminalConfig { bytes: parity, ..TerminalConfig::new(line.clone(), 19_200) };
        let gpio = |simulated| PortConfig::GpioSocket { path: path.clone(), simulated };
        assert_eq!(side(false), [PortConfig::Tcp { address }, PortConfig::Terminal(terminal), gpio(false)]);
        let pseudo = PortConfig::PseudoBytes { link: line, baud: 19_200 };
        assert_eq!(side(true), [PortConfig::TcpServer { address }, pseudo, gpio(true)]);
        let far = with_io(true, "192.168.0.5:502");
        let why = place_of(&place, &far.robot, "modbus.plc", true).unwrap_err().to_string();
        assert!(why.contains("the simulator needs an address of this computer"), "{why}");
    }

    #[test]
    fn the_driver_of_inputs_and_outputs_and_their_simulated_devices_have_the_same_ports() {
        let (place, config) = (shipped(true), with_io(true, "127.0.0.1:1502"));
        let ports = |name: &str| {
            let made = shell_in(&place, &config, name, State::Run, HostOptions::LIVE, || Ok(World::default())).unwrap();
            made.module().ports().to_vec()
        };
        let (driver, simulator) = (ports(io::NAME), ports(SIMULATOR));
        assert_eq!(driver.len(), 3);
        assert_eq!(simulator[simulator.len() - 3..], driver);
        let simulated = simulated::config(&place, World::default(), &config.robot, true).unwrap();
        // In the order of their names.
        let device =
            |unit, table, address, word| simulator::DeviceConfig { unit, points: vec![(table, address, word)] };
        assert_eq!(simulated.modbus[0].devices, [device(9, modbus::Table::Coils, 0, 0)]);
        assert_eq!(simulated.modbus[1].devices, [device(1, modbus::Table::InputRegisters, 7, 245)]);
    }

    #[test]
    fn a_module_that_is_not_there_is_refused() {
        let why = |place, name| module(&place, name, State::Run).err().unwrap().to_string();
        assert_eq!(why(shipped(false), SIMULATOR), "module simulator: only with --sim");
        assert!(
            why(shipped(true), "cook").starts_with("module cook: there is none of that name; there are watchdog, ")
        );
    }
}
