//! Which module is made of what, and where its ports are: the configuration becomes modules here, and nowhere else.

use crate::config::{
    self, CanBus, CanDriver, CanInterface, Config, ConfigError, I2cBus, I2cChip, I2cPlace, Joystick, JoystickDevice,
    ModuleEntry, Robot, Rs485Bus, Rs485Driver, SIMULATOR,
};
use crate::map_file;
use crate::place::{self, Place};
use crate::recording;
use crate::scene;
use ::host::limits::Limits;
use ::host::ports::{GamepadPlace, PortConfig, TerminalConfig};
use ::host::processes::{Launch, LinesFrom, Start};
use ::host::{HostConfig, beats};
use base::{Duration, Level};
use canopen::eds::Eds;
use drivers::{auxiliary, canbus, joydev, power, rs485a, rs485b};
use i2c::max6615::{self, fields::Frequency};
use logger::ros::{self, RobotScene, Sensor, Translator};
use module::{Module, PortSpec, Shell, ShellConfig, State};
use navitools::{Point, Pose};
use record::{Recorder, Sink};
use rs485::crc::Crc8;
use sim::host::{self, Virtual};
use simulator::world::{Beacon, World};
use std::ffi::OsString;
use std::net::SocketAddrV4;
use std::path::PathBuf;
use std::process::Command;
use watchdog::Watchdog;
use web::Web;
use web::center::{authority, command};

/// Makes the module `name` in its shell, to start in `wanted`, and says where its host finds what it needs.
pub fn module(place: &Place, name: &str, wanted: State) -> Result<(Shell, HostConfig), ConfigError> {
    let config = Config::load(&place.config, place.sim, &place.sets)?;
    let shell = shell(place, &config, name, wanted, Made::LIVE)?;
    let simulated_side = name == SIMULATOR;
    let ports = shell.module().ports().iter().map(|port| place_of(place, &config.robot, &port.bus, simulated_side));
    let ports = ports.collect::<Result<_, _>>()?;
    // One side tells of what crosses a wire.
    let raw = |port: &PortSpec| if simulated_side { None } else { raw_name(&config.robot, &port.bus) };
    let raw = shell.module().ports().iter().map(raw).collect();
    let launch = match name {
        watchdog::NAME => Some(launcher(place, &config)?),
        _ => None,
    };
    // Without a folder for their pages modules are judged by their announcements.
    let beats = launch.as_ref().and_then(|_| beats::folder(&place.run_dir).ok());
    let inputs = recording::inputs(place, &config, name, wanted)?;
    let host = HostConfig { lcm_url: place.lcm_url.clone(), ports, raw, launch, beats, inputs };
    Ok((shell, host))
}

/// The same robot in virtual time: spawn its watchdog, and it starts the rest.
pub fn virtual_machine(place: &Place, config: host::Config) -> Result<Virtual, ConfigError> {
    virtual_machine_recorded(place, config, |_| None)
}

/// The same; what each process is told and answers is written to the sink that there is for its module, if any.
pub fn virtual_machine_recorded(
    place: &Place,
    config: host::Config,
    sink: impl FnMut(&str) -> Option<Sink> + 'static,
) -> Result<Virtual, ConfigError> {
    virtual_machine_made(place, config, false, sink)
}

/// The same as [`virtual_machine`], with the logger, whose disk is that of the bus `log`.
pub fn virtual_machine_logged(place: &Place, config: host::Config) -> Result<Virtual, ConfigError> {
    virtual_machine_made(place, config, true, |_| None)
}

fn virtual_machine_made(
    place: &Place,
    mut config: host::Config,
    logs: bool,
    mut sink: impl FnMut(&str) -> Option<Sink> + 'static,
) -> Result<Virtual, ConfigError> {
    // Nobody can look into virtual time; what is recorded there says so, too.
    let mut place = place.clone();
    place.sets.push("web.enabled=false".into());
    let read = Config::load(&place.config, place.sim, &place.sets)?;
    config.full_duplex.extend(read.robot.power.iter().map(|power| power.bus.clone()));
    let restart_delay_max = Some(config.restart_delay_max);
    let made = Made { wire_time: false, seed: Some(config.seed), restart_delay_max, logs };
    let mut make = move |name: &str, wanted| {
        let mut shell = shell(&place, &read, name, wanted, made)?;
        if let Some(sink) = sink(name) {
            let header = recording::header(&place, name, wanted, made)?;
            shell.record(Recorder::new(&header, u64::MAX, sink));
        }
        Ok(shell)
    };
    Ok(Virtual::new(config, move |name, wanted| make(name, wanted).map_err(|error: ConfigError| error.to_string())))
}

/// What a host decides about its modules, beside the configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Made {
    /// The simulator plays the time that words take on a wire.
    pub wire_time: bool,
    /// What the simulator's chance comes from; none: always the same.
    pub seed: Option<u64>,
    /// The watchdog's longest delay before a restart; none: the usual.
    pub restart_delay_max: Option<Duration>,
    /// Whether there is a logger, where the configuration has one. In virtual time it would take more than all else.
    pub logs: bool,
}

impl Made {
    /// A pseudo-terminal has no wire: the time on it must be played.
    pub const LIVE: Self = Self { wire_time: true, seed: None, restart_delay_max: None, logs: true };
}

fn shell(place: &Place, config: &Config, name: &str, wanted: State, made: Made) -> Result<Shell, ConfigError> {
    shell_in(place, config, name, wanted, made, || config::world(&place.config, place.world.as_deref(), &place.sets))
}

/// Makes a module in its shell; the simulated robot is in `world`, and has its map.
pub(crate) fn shell_in(
    place: &Place,
    config: &Config,
    name: &str,
    wanted: State,
    made: Made,
    world: impl FnOnce() -> Result<World, ConfigError>,
) -> Result<Shell, ConfigError> {
    let without = (!made.logs).then(|| without_logger(config));
    let config = without.as_ref().unwrap_or(config);
    let world = if place.sim && MAPPED.contains(&name) { Some(world()?) } else { None };
    let robot = &mapped(&config.robot, world.as_ref());
    let module: Box<dyn Module> = match name {
        watchdog::NAME => {
            let usual = watchdog(config);
            let delay_max = made.restart_delay_max.unwrap_or(usual.delay_max);
            Box::new(Watchdog::new(watchdog::Config { delay_max, ..usual }))
        }
        "driver_rs485a" => Box::new(rs485a(&config.robot)?),
        rs485b::NAME => Box::new(rs485b(robot)?),
        power::NAME => Box::new(power(place, config)?),
        estimator::NAME => Box::new(estimator(robot)?),
        canbus::NAME => Box::new(canbus(place, config)?),
        auxiliary::NAME => Box::new(auxiliary(&config.robot)?),
        joydev::NAME => Box::new(joydev(robot)?),
        planner::NAME => Box::new(planner(place, robot, world.as_ref())?),
        web::NAME => Box::new(Web::new(web_settings(place, &config.modules, robot, world.as_ref()))),
        logger::NAME => Box::new(logger(place, robot, made)),
        SIMULATOR if place.sim => {
            let usual = simulator(world.unwrap_or_default(), robot, made.wire_time);
            Box::new(simulator::Simulator::new(simulator::Config { seed: made.seed.unwrap_or(usual.seed), ..usual }))
        }
        SIMULATOR => return refused(format!("module {name}: only with --sim")),
        _ => {
            return refused(format!("module {name}: there is none of that name; there are {}", MODULES.join(", ")));
        }
    };
    let mut shell = ShellConfig::new(name);
    shell.wanted = wanted;
    shell.report_from = config.robot.report_from;
    (shell.print_from, shell.send_from) = levels(config, name);
    if name == watchdog::NAME {
        shell.obeys_all = false;
        shell.end_within = WATCHDOG_END;
    }
    Ok(Shell::new(shell, module))
}

/// Configured lowest levels of a module's texts and reports that are printed, and that are sent.
fn levels(config: &Config, name: &str) -> (Option<Level>, Option<Level>) {
    let entry = config.modules.iter().find(|module| module.name == name);
    let (print, send) = entry.map_or((None, None), |entry| (entry.print_from, entry.send_from));
    (print.or(config.robot.print_from), send.or(config.robot.send_from))
}

fn without_logger(config: &Config) -> Config {
    let mut config = config.clone();
    config.modules.retain(|module| module.name != logger::NAME);
    config
}

/// Those that know where what is: their map is of the world, where that is simulated.
const MAPPED: [&str; 6] = [SIMULATOR, rs485b::NAME, estimator::NAME, planner::NAME, web::NAME, logger::NAME];

/// The robot with the beacons of a world, if that has any.
pub(crate) fn mapped(robot: &Robot, world: Option<&World>) -> Robot {
    let mut robot = robot.clone();
    if let Some(world) = world.filter(|world| !world.beacons.is_empty()) {
        let beacon = |beacon: &Beacon| config::Beacon { id: beacon.id, x: beacon.at.x, y: beacon.at.y };
        robot.beacons = world.beacons.iter().map(beacon).collect();
    }
    robot
}

/// Those without which the planner does not move the robot, and others may.
const PLANNING: [&str; 2] = [estimator::NAME, planner::NAME];
const MODULES: [&str; 12] = [
    watchdog::NAME,
    SIMULATOR,
    power::NAME,
    "driver_rs485a",
    rs485b::NAME,
    canbus::NAME,
    joydev::NAME,
    auxiliary::NAME,
    estimator::NAME,
    planner::NAME,
    web::NAME,
    logger::NAME,
];
/// The port of the folder of logs.
const LOG_BUS: &str = "log";
/// The gamepad's port.
const JOYSTICK: &str = "joystick";
/// What modules call the 1-Wire bus.
const W1_BUS: &str = "w1";
/// The watchdog ends modules one after the other, those that others depend on last.
const WATCHDOG_END: Duration = Duration::from_secs(6);

fn refused<T>(why: String) -> Result<T, ConfigError> {
    Err(ConfigError(vec![why]))
}

/// Where a port of a bus is; the simulator has the other end of a serial line.
fn place_of(place: &Place, robot: &Robot, bus: &str, simulated_side: bool) -> Result<PortConfig, ConfigError> {
    if let Some(can) = bus.strip_prefix("can.").and_then(|name| robot.can.iter().find(|can| can.name == name)) {
        return can_port(place, &can.interface, can.bitrate);
    }
    if let (JOYSTICK, Some(joystick)) = (bus, &robot.joystick) {
        return Ok(gamepad_port(place, joystick, simulated_side));
    }
    if let Some(i2c) = bus.strip_prefix("i2c.").and_then(|name| robot.i2c.iter().find(|i2c| i2c.name == name)) {
        return i2c_port(place, i2c, simulated_side);
    }
    if bus == LOG_BUS {
        return Ok(PortConfig::Store { folder: log_folder(place, robot) });
    }
    if let (W1_BUS, Some(w1)) = (bus, &robot.w1) {
        let folder = place.run_dir.join(&w1.folder);
        return match simulated_side {
            true if w1.folder.is_relative() => Ok(PortConfig::W1Folder { folder }),
            true => refused(format!("w1.folder = {:?}: the simulator needs a name in the run folder", w1.folder)),
            false => Ok(PortConfig::W1 { folder }),
        };
    }
    let serial = bus.strip_prefix("rs485.").and_then(|name| robot.rs485.iter().find(|line| line.name == name));
    let Some(line) = serial else {
        return refused(format!("bus {bus}: robot.toml has no table [{bus}]"));
    };
    if !simulated_side {
        return Ok(PortConfig::Terminal(terminal(place, line)));
    }
    match (line.offered(), &line.simulated_at) {
        (Some(name), _) => Ok(PortConfig::Pseudo { link: place.run_dir.join(name), baud: line.baud }),
        (None, Some(port)) => {
            let plain = TerminalConfig::new(port.clone(), line.baud);
            let low_latency = line.low_latency;
            Ok(PortConfig::Terminal(TerminalConfig { transport: line.transport, low_latency, ..plain }))
        }
        (None, None) => refused(format!(
            "{bus}.port = {:?}: the simulator needs a name in the run folder, or simulated_at",
            line.port
        )),
    }
}

/// Where the gamepad is; the simulator has the other end of what lies in the run folder.
fn gamepad_port(place: &Place, joystick: &Joystick, simulated_side: bool) -> PortConfig {
    let found = match &joystick.device {
        JoystickDevice::Stream(path) if simulated_side => {
            return PortConfig::GamepadHub { path: place.run_dir.join(path) };
        }
        JoystickDevice::Stream(path) => GamepadPlace::Stream(place.run_dir.join(path)),
        JoystickDevice::Path(path) => GamepadPlace::Device(path.clone()),
        JoystickDevice::Auto => GamepadPlace::Auto,
    };
    PortConfig::Gamepad { place: found, grab: joystick.grab }
}

/// The serial device of a bus.
#[must_use]
pub fn terminal(place: &Place, line: &Rs485Bus) -> TerminalConfig {
    let plain =
        TerminalConfig { transport: line.transport, ..TerminalConfig::new(place.run_dir.join(&line.port), line.baud) };
    // What the simulator offers in the run folder is no board with registers, and has no RTS.
    if line.port.is_relative() {
        return plain;
    }
    TerminalConfig { setup: line.setup.clone(), direction: line.direction, low_latency: line.low_latency, ..plain }
}

/// The name of a bus on `LL_DATA_RAW_<BUS>`, where its frames are sent.
fn raw_name(robot: &Robot, bus: &str) -> Option<String> {
    let (kind, name) = bus.split_once('.')?;
    let raw = match kind {
        "can" => robot.can.iter().find(|can| can.name == name)?.raw,
        "rs485" => robot.rs485.iter().find(|line| line.name == name)?.raw,
        "i2c" => robot.i2c.iter().find(|bus| bus.name == name)?.raw,
        _ => false,
    };
    raw.then(|| name.to_uppercase())
}

/// Where an I2C bus is; the simulator has the other end of a socket.
pub fn i2c_port(place: &Place, bus: &I2cBus, simulated_side: bool) -> Result<PortConfig, ConfigError> {
    match &bus.place {
        I2cPlace::Socket(path) if simulated_side => Ok(PortConfig::I2cServer { path: place.run_dir.join(path) }),
        _ if simulated_side => {
            refused(format!("i2c.{}.bus: the simulator needs \"unix:\" and a name in the run folder", bus.name))
        }
        place_of => Ok(i2c_place(place, place_of, bus.hz)),
    }
}

/// The port at a place.
#[must_use]
pub fn i2c_place(place: &Place, bus: &I2cPlace, hz: u32) -> PortConfig {
    match bus {
        I2cPlace::Dev(path) => PortConfig::I2cDev { path: path.clone() },
        I2cPlace::Gpio { chip, sda, scl } => PortConfig::I2cGpio { chip: chip.clone(), sda: *sda, scl: *scl, hz },
        I2cPlace::Socket(path) => PortConfig::I2cSocket { path: place.run_dir.join(path) },
    }
}

/// Where a CAN bus is; its bit rate where the port sets it.
pub fn can_port(place: &Place, interface: &CanInterface, bitrate: u32) -> Result<PortConfig, ConfigError> {
    match interface {
        CanInterface::Socket(interface) => Ok(PortConfig::CanSocket { interface: interface.clone() }),
        CanInterface::Slcan(path) => Ok(PortConfig::CanSlcan { path: path.clone(), bitrate }),
        CanInterface::Udp { group, port } => {
            let (url, _) = lcm::Url::parse(&place.lcm_url).map_err(|error| ConfigError(vec![error.to_string()]))?;
            // Whatever else carries the messages has no UDP port to stand beside.
            let beside = if let lcm::Url::Udpm(udpm) = url { udpm.port } else { lcm::url::PORT };
            let port = port.unwrap_or_else(|| can_port_beside(beside));
            Ok(PortConfig::CanUdp { bus: SocketAddrV4::new(*group, port) })
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

fn watchdog(config: &Config) -> watchdog::Config {
    let modules = config.modules.iter().map(|module| watchdog::ModuleConfig {
        name: module.name.clone(),
        depends: module.depends.clone(),
        beat_timeout: Duration::from_secs_f64(module.beat_timeout_s),
        restart: module.restart,
        critical: module.critical,
    });
    watchdog::Config { modules: modules.collect(), ..watchdog::Config::default() }
}

/// How the watchdog's host starts a module: our own executable with our own arguments, unless the list says otherwise.
fn launcher(place: &Place, config: &Config) -> Result<Launch, ConfigError> {
    let own = std::env::current_exe().map_err(|error| ConfigError(vec![format!("own executable: {error}")]))?;
    let (place, modules, config) = (place.clone(), config.modules.clone(), config.clone());
    let run_dir = Some(place.run_dir.clone());
    let divides = modules.iter().any(|module| module.memory_max.is_some() || module.cpu_max.is_some());
    let rt_priority = modules.iter().filter_map(|module| module.rt_priority).max().map(|highest| highest + 1);
    let start = move |name: &str, state: State| {
        let entry = modules.iter().find(|module| module.name == name);
        let args = entry.map(|entry| entry.args.as_slice()).unwrap_or_default();
        let mut command = match entry.and_then(|entry| entry.command.as_ref()) {
            Some(command) => {
                // docs/writing-a-module.md
                let mut command = Command::new(command);
                command.env("ADVEE_MODULE", name).env("ADVEE_STATE", state.name());
                command.env("LCM_DEFAULT_URL", foreign_url(&place.lcm_url));
                command
            }
            None => {
                let mut command = Command::new(&own);
                command.args(["run", name, "--state", state.name()]).args(place.arguments());
                command
            }
        };
        command.args(args);
        let foreign = entry.is_some_and(|entry| entry.command.is_some());
        let ((print, send), usual) = (levels(&config, name), LinesFrom::default());
        let lines_from = LinesFrom { print: print.unwrap_or(usual.print), send: send.unwrap_or(usual.send) };
        Start { command, limits: entry.map(limits).unwrap_or_default(), foreign, lines_from }
    };
    Ok(Launch { start: Box::new(start), run_dir, divides, rt_priority })
}

fn limits(module: &ModuleEntry) -> Limits {
    let ModuleEntry { rt_priority, nice, memory_max, cpu_max, .. } = *module;
    Limits { rt_priority, cpus: module.cpus.clone(), nice, memory_max, cpu_max }
}

/// The bus as programs on the official library are told of it, which warns of options that are ours alone.
fn foreign_url(url: &str) -> String {
    match lcm::Url::parse(url) {
        Ok((lcm::Url::Udpm(udpm), _)) => lcm::Url::from(lcm::url::Udpm { shm: lcm::url::Shm::Off, ..udpm }).to_string(),
        _ => url.into(),
    }
}

impl Place {
    /// The arguments that make another `advee run` find the same robot.
    #[must_use]
    pub fn arguments(&self) -> Vec<OsString> {
        let mut args: Vec<OsString> = Vec::new();
        args.extend(["--config".into(), self.config.clone().into()]);
        args.extend(["--run-dir".into(), self.run_dir.clone().into()]);
        args.extend(["--lcm-url".into(), self.lcm_url.clone().into()]);
        for set in &self.sets {
            args.extend(["--set".into(), set.into()]);
        }
        if self.sim {
            args.push("--sim".into());
        }
        if let Some(world) = &self.world {
            args.extend(["--world".into(), world.into()]);
        }
        args
    }
}

/// The check of a bus.
#[must_use]
pub fn crc(crc: config::Crc) -> Crc8 {
    Crc8 { poly: crc.polynomial, init: crc.initial, reflected: crc.reflected, xorout: crc.final_xor }
}

/// Where runs have their folders.
#[must_use]
pub fn log_folder(place: &Place, robot: &Robot) -> PathBuf {
    let folder = robot.log.folder.as_ref().map_or_else(place::log_folder, |folder| place.config.join(folder));
    std::path::absolute(&folder).unwrap_or(folder)
}

/// `logger`: all that is said. Its first run is written where the inputs of this run's modules are, if they are.
fn logger(place: &Place, robot: &Robot, made: Made) -> logger::Logger {
    let log = &robot.log;
    let folder = log_folder(place, robot);
    let run = std::env::var_os(recording::VARIABLE).map(PathBuf::from).filter(|_| made == Made::LIVE);
    let run = run.filter(|run| run.parent() == Some(&*folder));
    let config = logger::Config {
        bus: LOG_BUS.into(),
        robot: robot.name.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
        attachments: recording::attachments(place, made),
        run: run.and_then(|run| Some(run.file_name()?.to_str()?.to_owned())),
        start: log.start,
        compression: log.compression,
        file_max_bytes: log.file_max_bytes,
        buffer_bytes: log.buffer_bytes,
        pretrigger: Duration::from_secs_f64(log.pretrigger_s),
        pretrigger_bytes: log.pretrigger_bytes,
        keep_free_bytes: log.keep_free_bytes,
        keep_runs_bytes: log.keep_runs_bytes,
    };
    logger::Logger::new(config, Translator::new(robot_scene(robot)))
}

/// `driver_rs485a`: the bus `a`.
fn rs485a(robot: &Robot) -> Result<rs485a::Rs485a, ConfigError> {
    let Some(bus) = robot.rs485_bus("rs485.a") else {
        return refused("driver_rs485a: robot.toml has no table [rs485.a]".into());
    };
    let node = |node: &config::Rs485Node| {
        let kind = match node.driver {
            Rs485Driver::Sd1 => rs485a::Kind::Sd1,
            Rs485Driver::So1 => rs485a::Kind::So1,
            Rs485Driver::Sbs1 | Rs485Driver::Psc1 => {
                return refused(format!("driver_rs485a: {} on rs485.a: it knows sd1 and so1", node.name));
            }
        };
        let timeout = Duration::from_secs_f64(node.timeout_s);
        Ok(rs485a::Node { name: node.name.clone(), address: node.address, kind, rate_hz: node.rate_hz, timeout })
    };
    let rangers = |rangers: &[config::Ranger], beam: f64| {
        let ranger = |ranger: &config::Ranger| {
            let config::Ranger { id, board, channel, x, y, theta } = *ranger;
            rs485a::Ranger { id, board, channel, x, y, theta, beam }
        };
        rangers.iter().map(ranger).collect()
    };
    let config = rs485a::Config {
        bus: "rs485.a".into(),
        baud: bus.baud,
        crc: crc(bus.crc),
        nodes: bus.nodes.iter().map(node).collect::<Result<_, _>>()?,
        srfs: rangers(&robot.srfs, robot.sensors.srf08.beam_rad),
        irs: rangers(&robot.irs, Sensor::GP2Y0A41.field_of_view),
        wheels: rs485a::Wheels {
            wheelbase_m: robot.geometry.wheelbase_m,
            track_m: robot.geometry.track_m,
            radius_m: robot.geometry.wheel_radius_m,
            ticks_per_turn: robot.geometry.ticks_per_turn,
            speed_max_mps: robot.limits.speed_mps,
        },
    };
    rs485a::Rs485a::new(config).map_err(|error| ConfigError(vec![format!("driver_rs485a: {error}")]))
}

/// `driver_rs485b`: the bus `b` with the beacon scanner.
fn rs485b(robot: &Robot) -> Result<rs485b::Rs485b, ConfigError> {
    let bus = robot.rs485_bus("rs485.b");
    let Some((bus, [node @ config::Rs485Node { driver: Rs485Driver::Sbs1, .. }])) =
        bus.map(|bus| (bus, &bus.nodes[..]))
    else {
        return refused("driver_rs485b: robot.toml has no table [rs485.b] with one node, an sbs1".into());
    };
    let config = rs485b::Config {
        bus: "rs485.b".into(),
        baud: bus.baud,
        crc: crc(bus.crc),
        name: node.name.clone(),
        address: node.address,
        rate_hz: node.rate_hz,
        timeout: Duration::from_secs_f64(node.timeout_s),
        beacons: robot.beacons.iter().map(|beacon| beacon.id).collect(),
    };
    rs485b::Rs485b::new(config).map_err(|error| ConfigError(vec![format!("driver_rs485b: {error}")]))
}

/// `web`: where it is reached, and what it shows besides what is said.
fn web_settings(place: &Place, modules: &[ModuleEntry], robot: &Robot, world: Option<&World>) -> web::Settings {
    // A map that cannot be read is the planner's to tell.
    let map = robot.planner.map.as_ref().and_then(|file| map_file::load(&place.config.join(file)).ok());
    let simulated =
        |world: &World| simulator::Simulator::offered(simulator(world.clone(), robot, Made::LIVE.wire_time));
    let faults = world.map(simulated).unwrap_or_default();
    let route = |route: &simulator::world::Route| {
        let points = route.waypoints.iter().map(|at| [at.x, at.y]).collect();
        command::Route { name: route.name.clone(), points, looped: route.looped }
    };
    let limits = authority::Limits { speed: robot.limits.speed_manual_mps, steering: robot.limits.steering_rad };
    let routes = world.iter().flat_map(|world| &world.routes).map(route).collect();
    web::Settings {
        robot: robot.name.clone(),
        lcm_url: place.lcm_url.clone(),
        web: robot.web.clone(),
        config: place.config.clone(),
        scene: robot_scene(robot),
        center: scene::of(robot, world, map.as_ref()).with_faults(faults),
        recorded: recording::scene,
        critical: modules.iter().filter(|module| module.critical).map(|module| module.name.clone()).collect(),
        logs: log_folder(place, robot),
        run: place.run_dir.clone(),
        commands: command::Robot { limits, routes, simulated: place.sim },
    }
}

/// What is shown of the robot and no message says.
fn robot_scene(robot: &Robot) -> RobotScene {
    let geometry = &robot.geometry;
    let (rear, front) = (-geometry.rear_overhang_m, geometry.length_m - geometry.rear_overhang_m);
    let half = geometry.width_m / 2.0;
    let beacon = |beacon: &config::Beacon| ros::Beacon { id: beacon.id.into(), x: beacon.x, y: beacon.y };
    RobotScene {
        name: robot.name.clone(),
        outline: vec![[front, half], [rear, half], [rear, -half], [front, -half]],
        beacons: robot.beacons.iter().map(beacon).collect(),
        sonar: Sensor::srf08(robot.sensors.srf08.beam_rad),
        infrared: Sensor::GP2Y0A41,
    }
}

/// `estimator`: the map of beacons, and as many of them at once as the scanner takes.
fn estimator(robot: &Robot) -> Result<estimator::Estimator, ConfigError> {
    let beacons = robot
        .beacons
        .iter()
        .map(|beacon| estimator::filter::Beacon { id: beacon.id.into(), at: Point { x: beacon.x, y: beacon.y } });
    let config = estimator::Config {
        filter: estimator::filter::Config { beacons: beacons.collect(), ..robot.estimator.clone() },
        wheelbase_m: robot.geometry.wheelbase_m,
        track_m: robot.geometry.track_m,
        active_max: rs485::boards::sbs1::BEACONS,
    };
    estimator::Estimator::new(config).map_err(|error| ConfigError(vec![format!("estimator: {error}")]))
}

/// `driver_power`: the link that the table `power` names. In simulation the computer belongs to somebody else.
fn power(place: &Place, config: &Config) -> Result<power::Power, ConfigError> {
    let robot = &config.robot;
    let found = robot.power.as_ref().and_then(|power| Some((power, robot.rs485_bus(&power.bus)?)));
    let Some((power, bus, node)) = found.and_then(|(power, bus)| Some((power, bus, bus.nodes.first()?))) else {
        return refused("driver_power: robot.toml has no table [power]".into());
    };
    let others = config.modules.iter().map(|module| &module.name);
    let config = power::Config {
        bus: power.bus.clone(),
        baud: bus.baud,
        crc: crc(bus.crc),
        name: node.name.clone(),
        address: node.address,
        rate_hz: node.rate_hz,
        timeout: Duration::from_secs_f64(node.timeout_s),
        capacity_ah: power.capacity_ah,
        cells: power.cells,
        reserve: power.reserve,
        // The simulator plays the hardware: that is not ended, but switched off.
        modules: others.filter(|name| ![power::NAME, SIMULATOR].contains(&name.as_str())).cloned().collect(),
        halt: power.halt_command.clone(),
        reboot: power.reboot_command.clone(),
        simulated: place.sim,
    };
    power::Power::new(config).map_err(|error| ConfigError(vec![format!("driver_power: {error}")]))
}

/// `driver_aux`: the first I2C bus with chips on it, and the thermometers.
fn auxiliary(robot: &Robot) -> Result<auxiliary::Auxiliary, ConfigError> {
    let bus = robot.i2c.iter().find(|bus| !bus.chips.is_empty()).map(|bus| {
        let chips = bus.chips.iter().map(chip).collect::<Result<_, _>>()?;
        Ok(auxiliary::BusConfig { bus: format!("i2c.{}", bus.name), hz: bus.hz, chips })
    });
    let sensor = |sensor: &config::W1Sensor| {
        let config::W1Sensor { id, ref name, limit_c } = *sensor;
        auxiliary::Thermometer { rom: id, name: name.clone(), limit_c }
    };
    let w1 = robot.w1.as_ref().map(|w1| {
        let thermometers = w1.sensors.iter().map(sensor).collect();
        auxiliary::W1Config { bus: W1_BUS.into(), thermometers }
    });
    let driver = auxiliary::Auxiliary::new(auxiliary::Config { bus: bus.transpose()?, w1 });
    driver.map_err(|error| ConfigError(vec![format!("driver_aux: {error}")]))
}

fn address(chip: &I2cChip) -> Result<base::i2c::Address, ConfigError> {
    let address = base::i2c::Address::new(chip.address);
    address.ok_or_else(|| ConfigError(vec![format!("{}: {:#04x} is no address", chip.name, chip.address)]))
}

fn chip(chip: &I2cChip) -> Result<auxiliary::ChipConfig, ConfigError> {
    let usual = max6615::Config::new(address(chip)?);
    let fan = |fan: &Option<config::I2cFan>| {
        // An output that nobody uses stands still.
        let off = max6615::Fan { mode: max6615::Mode::Manual { duty: 0.0 }, minimum_rpm: 0.0, ..usual.fans[0] };
        let Some(fan) = fan else { return off };
        // In 240ths; no more than 15, as the configuration was checked.
        let step = (fan.duty_per_c * 240.0).round() as u8;
        let mode = match fan.follows {
            [false, false] => max6615::Mode::Manual { duty: fan.duty },
            follows => max6615::Mode::Automatic { follows, start_duty: fan.duty, maximum_duty: fan.duty_max, step },
        };
        max6615::Fan { mode, minimum_rpm: fan.rpm_min, ..off }
    };
    let [one, two] = &chip.temperatures;
    let of = |temperature: &Option<config::I2cTemperature>, usual: u8, f: fn(&config::I2cTemperature) -> u8| {
        temperature.as_ref().map_or(usual, f)
    };
    let limits = [of(one, 255, |one| one.limit_c), of(two, 255, |two| two.limit_c)];
    let starts = [of(one, 255, |one| one.start_c), of(two, 255, |two| two.start_c)];
    let named = |temperature: &Option<config::I2cTemperature>| {
        temperature.as_ref().map(|temperature| auxiliary::Channel { name: temperature.name.clone() })
    };
    Ok(auxiliary::ChipConfig {
        name: chip.name.clone(),
        channels: [named(one), named(two)],
        fans: chip.fans.clone().map(|fan| fan.map(|fan| auxiliary::FanConfig { name: fan.name })),
        chip: max6615::Config {
            limit_c: limits,
            start_c: starts,
            internal: chip.internal,
            minimum_duty: chip.always,
            frequency: if chip.pwm_35_khz { Frequency::Khz35 } else { Frequency::Hz33 },
            fans: [fan(&chip.fans[0]), fan(&chip.fans[1])],
            ..usual
        },
    })
}

/// `driver_canbus`: the CAN bus that both drives are on.
fn canbus(place: &Place, config: &Config) -> Result<canbus::Canbus, ConfigError> {
    let robot = &config.robot;
    let found = robot.can.iter().find_map(|bus| Some((bus, propulsion(robot, bus)?, steering(robot, bus)?)));
    let Some((bus, propulsion, steering)) = found else {
        return refused("driver_canbus: robot.toml has no [can.<bus>] with an epos and an icla".into());
    };
    let limits = robot.limits;
    let critical = config.modules.iter().filter(|module| module.critical && module.name != canbus::NAME);
    let config = canbus::Config {
        bus: format!("can.{}", bus.name),
        bitrate: bus.bitrate,
        node_id: bus.master,
        sync: bus.sync_s.map(Duration::from_secs_f64),
        wheelbase: robot.geometry.wheelbase_m,
        limits: canbus::Limits {
            speed: limits.speed_mps,
            steering: limits.steering_rad,
            speed_manual: limits.speed_manual_mps,
            speed_autonomous: limits.speed_autonomous_mps,
            lateral_acceleration: limits.lateral_acceleration_mps2,
            acceleration: limits.acceleration_mps2,
            deceleration: limits.deceleration_mps2,
            quick_stop: limits.quick_stop_mps2,
        },
        ttl: Duration::from_secs_f64(limits.command_ttl_s),
        critical: critical.map(|module| module.name.clone()).collect(),
        planning: config
            .modules
            .iter()
            .map(|module| &module.name)
            .filter(|name| PLANNING.contains(&name.as_str()))
            .cloned()
            .collect(),
        has_pause_line: robot.power.is_some(),
        propulsion,
        steering,
    };
    let driver = canbus::Canbus::new(config).map_err(|error| ConfigError(vec![format!("driver_canbus: {error}")]))?;
    check_sheets(place, bus, &driver)?;
    Ok(driver)
}

/// `driver_joydev`: the gamepad, within the limits of a manual source.
fn joydev(robot: &Robot) -> Result<joydev::Joydev, ConfigError> {
    let Some(joystick) = &robot.joystick else {
        return refused("driver_joydev: robot.toml has no table [joystick]".into());
    };
    let stick = |stick: config::JoystickStick, limit: f64| joydev::StickConfig {
        axis: stick.axis,
        inverted: stick.inverted,
        dead_zone: stick.dead_zone,
        expo: stick.expo,
        limit: stick.limit.unwrap_or(limit).min(limit),
    };
    let gear = |gear: config::JoystickGear| joydev::Gear { button: gear.button, scale: gear.scale };
    let limits = robot.limits;
    let config = joydev::Config {
        bus: JOYSTICK.into(),
        speed: stick(joystick.speed, limits.speed_manual_mps.min(limits.speed_mps)),
        steering: stick(joystick.steering, limits.steering_rad),
        dead_man: joystick.dead_man,
        scale: joystick.scale,
        slow: joystick.slow.map(gear),
        fast: joystick.fast.map(gear),
        quiet: joystick.quiet_s.map(Duration::from_secs_f64),
    };
    joydev::Joydev::new(config).map_err(|error| ConfigError(vec![format!("driver_joydev: {error}")]))
}

/// `planner`: the robot's measures and limits, and a map: the file that the configuration names, or the world's walls.
fn planner(place: &Place, robot: &Robot, world: Option<&World>) -> Result<planner::Planner, ConfigError> {
    let (geometry, limits) = (&robot.geometry, &robot.limits);
    let map = match &robot.planner.map {
        Some(file) => Some(map_file::load(&place.config.join(file)).map_err(|why| ConfigError(vec![why]))?),
        // One that is too large for a map is an open floor.
        None => world.and_then(|world| map_file::of_world(world).ok()),
    };
    Ok(planner::Planner::new(planner::Config {
        body: planner::Body {
            wheelbase: geometry.wheelbase_m,
            front: geometry.length_m - geometry.rear_overhang_m,
            rear: geometry.rear_overhang_m,
            width: geometry.width_m,
        },
        limits: planner::Limits {
            speed: limits.speed_autonomous_mps,
            steering: limits.steering_rad,
            steering_rate: limits.steering_rate_radps,
            acceleration: limits.acceleration_mps2,
            deceleration: limits.deceleration_mps2,
            lateral_acceleration: limits.lateral_acceleration_mps2,
        },
        manners: robot.planner.manners(),
        sonar_beam: robot.sensors.srf08.beam_rad,
        map,
    }))
}

/// A data sheet that the configuration names must be one of a device that the driver can set up.
fn check_sheets(place: &Place, bus: &CanBus, driver: &canbus::Canbus) -> Result<(), ConfigError> {
    for node in &bus.nodes {
        let (Some(path), Some(setup)) = (&node.eds, driver.nodes().find(|setup| setup.id == node.id)) else { continue };
        let path = place.config.join(path);
        let named = |why: String| ConfigError(vec![format!("{}: {why}", path.display())]);
        let file = std::fs::read(&path).map_err(|error| named(error.to_string()))?;
        let sheet = Eds::parse(&file).map_err(|error| named(error.to_string()))?;
        if let Some(objection) = sheet.objection(setup) {
            return Err(named(format!("not the sheet of a drive for the {}: {objection}", setup.name)));
        }
    }
    Ok(())
}

fn propulsion(robot: &Robot, bus: &CanBus) -> Option<canbus::PropulsionConfig> {
    bus.nodes.iter().find_map(|node| match node.driver {
        CanDriver::Epos { gear } => {
            let metres_per_turn = 2.0 * std::f64::consts::PI * robot.geometry.wheel_radius_m;
            Some(canbus::PropulsionConfig { node: node.id, rpm_per_mps: 60.0 * gear / metres_per_turn })
        }
        CanDriver::Icla { .. } => None,
    })
}

fn steering(robot: &Robot, bus: &CanBus) -> Option<canbus::SteeringConfig> {
    bus.nodes.iter().find_map(|node| match node.driver {
        CanDriver::Icla {
            gear,
            counts_per_turn,
            switch_rad,
            homing_method,
            homing_speed_radps,
            homing_timeout_s,
            remap,
        } => Some(canbus::SteeringConfig {
            node: node.id,
            counts_per_turn,
            gear,
            switch: switch_rad,
            homing_method,
            homing_speed: homing_speed_radps,
            homing_timeout: Duration::from_secs_f64(homing_timeout_s),
            speed: robot.limits.steering_rate_radps,
            remap,
        }),
        CanDriver::Epos { .. } => None,
    })
}

/// `simulator`: every serial bus with its boards, the robot's body, a world.
fn simulator(mut world: World, robot: &Robot, wire_time: bool) -> simulator::Config {
    if world.beacons.is_empty() {
        let beacon = |beacon: &config::Beacon| Beacon { id: beacon.id, at: Point { x: beacon.x, y: beacon.y } };
        world.beacons = robot.beacons.iter().map(beacon).collect();
    }
    let geometry = robot.geometry;
    let can = robot.can.iter().find_map(drives);
    let parameters = simulator::body::Parameters {
        wheelbase: geometry.wheelbase_m,
        track: geometry.track_m,
        overhang_rear: geometry.rear_overhang_m,
        overhang_front: geometry.length_m - geometry.rear_overhang_m - geometry.wheelbase_m,
        width: geometry.width_m,
        wheel_radius: geometry.wheel_radius_m,
        gear: can.as_ref().map_or(simulator::body::Parameters::default().gear, |(_, gear)| *gear),
        encoder_counts: f64::from(geometry.ticks_per_turn),
        steering_rate: robot.limits.steering_rate_radps,
        errors: simulator::body::Errors::usual(),
        ..simulator::body::Parameters::default()
    };
    let serial = robot.rs485.iter().map(|bus| simulator::SerialConfig {
        bus: format!("rs485.{}", bus.name),
        baud: bus.baud,
        crc: crc(bus.crc),
        real: bus.offered().is_none(),
        boards: bus.nodes.iter().map(|node| board(robot, node)).collect(),
    });
    let i2c = robot.i2c.iter().map(|bus| simulator::I2cConfig {
        bus: format!("i2c.{}", bus.name),
        hz: bus.hz,
        fans: bus.chips.iter().filter_map(|chip| Some((chip.name.clone(), address(chip).ok()?))).collect(),
    });
    let w1 = robot.w1.as_ref().map(|w1| simulator::W1Config {
        bus: W1_BUS.into(),
        thermometers: w1.sensors.iter().map(|sensor| (sensor.id, sensor.name.clone())).collect(),
    });
    simulator::Config {
        world,
        parameters,
        can: can.map(|(can, _)| can),
        serial: serial.collect(),
        i2c: i2c.collect(),
        w1,
        gamepad: robot.joystick.as_ref().filter(|joystick| is_simulated(joystick)).map(|_| JOYSTICK.into()),
        wire_time,
        sonar: simulator::sonar::Sonar { beam: robot.sensors.srf08.beam_rad, ..simulator::sonar::Sonar::default() },
        ..simulator::Config::default()
    }
}

/// Whether the simulator has the gamepad: what is read lies in the run folder.
fn is_simulated(joystick: &Joystick) -> bool {
    matches!(&joystick.device, JoystickDevice::Stream(path) if path.is_relative())
}

/// A CAN bus with both drives on it, and the gear of the propulsion.
fn drives(bus: &CanBus) -> Option<(simulator::CanConfig, f64)> {
    let (propulsion, gear) = bus.nodes.iter().find_map(|node| match node.driver {
        CanDriver::Epos { gear } => Some((node.id, gear)),
        CanDriver::Icla { .. } => None,
    })?;
    let (steering, gearing) = bus.nodes.iter().find_map(|node| match node.driver {
        CanDriver::Icla { gear, counts_per_turn, .. } => {
            Some((node.id, simulator::boards::icla::Gearing { counts_per_turn, gear }))
        }
        CanDriver::Epos { .. } => None,
    })?;
    let (bus, bitrate) = (format!("can.{}", bus.name), bus.bitrate);
    Some((simulator::CanConfig { bus, bitrate, propulsion, steering, gearing }, gear))
}

fn board(robot: &Robot, node: &config::Rs485Node) -> simulator::BoardConfig {
    let kind = match node.driver {
        Rs485Driver::So1 => simulator::BoardKind::So1,
        Rs485Driver::Sbs1 => simulator::BoardKind::Sbs1(simulator::boards::sbs1::Sbs1Config::default()),
        Rs485Driver::Psc1 => {
            let battery = simulator::boards::battery::BatteryConfig::default();
            simulator::BoardKind::Psc1(robot.power.as_ref().map_or(battery, |power| {
                simulator::boards::battery::BatteryConfig {
                    capacity_ah: power.capacity_ah,
                    cells: power.cells,
                    ..battery
                }
            }))
        }
        Rs485Driver::Sd1 => simulator::BoardKind::Sd1(simulator::boards::sd1::Sd1Config {
            srfs: by_channel(&robot.srfs, node.address, |ranger| Pose::new(ranger.x, ranger.y, ranger.theta)),
            irs: by_channel(&robot.irs, node.address, |ranger| Point { x: ranger.x, y: ranger.y }),
        }),
    };
    simulator::BoardConfig { name: node.name.clone(), address: node.address, kind }
}

/// A board's rangers in the order of their channels. A channel without a ranger takes the place of the one before it:
/// nobody asks for it.
fn by_channel<T>(rangers: &[config::Ranger], board: u8, place: impl Fn(&config::Ranger) -> T) -> Vec<T> {
    let mut own: Vec<&config::Ranger> = rangers.iter().filter(|ranger| ranger.board == board).collect();
    own.sort_by_key(|ranger| ranger.channel);
    let count = own.last().map_or(0, |last| usize::from(last.channel) + 1);
    let at = |channel| own.iter().rev().find(|ranger| usize::from(ranger.channel) <= channel).or(own.first());
    (0..count).filter_map(|channel| at(channel).map(|ranger| place(ranger))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::path::Path;

    fn shipped(sim: bool) -> Place {
        Place {
            config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
            run_dir: "/run/advee".into(),
            lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
            sets: Vec::new(),
            sim,
            world: None,
        }
    }

    #[test]
    fn the_can_port_follows_the_lcm_port_and_no_two_share_one() {
        assert_eq!(can_port_beside(7667), 43113);
        let ports: BTreeSet<u16> = (1..=u16::MAX).map(can_port_beside).collect();
        assert_eq!(ports.len(), usize::from(u16::MAX));
        assert!(!ports.contains(&0));
        assert!((1024..=u16::MAX).all(|lcm| can_port_beside(lcm) >= 1024));
    }

    #[test]
    fn a_data_sheet_of_another_device_is_refused_before_anything_starts() {
        let place = shipped(true);
        let mut config = Config::load(&place.config, true, &[]).unwrap();
        let mut with = |sheet: &str| {
            let sheet = Path::new(env!("CARGO_MANIFEST_DIR")).join("../buses/canopen/eds").join(sheet);
            config.robot.can[0].nodes[1].eds = Some(sheet);
            shell(&place, &config, canbus::NAME, State::Run, Made::LIVE).map(|_| ()).map_err(|error| error.to_string())
        };
        assert_eq!(with("icla_sim.eds"), Ok(()));
        let refused = with("epos_sim.eds").unwrap_err();
        assert!(refused.ends_with("not the sheet of a drive for the steering: it has no object 0x605A:0"), "{refused}");
        assert!(with("no.eds").unwrap_err().contains("no.eds: "));
    }

    #[test]
    fn every_listed_module_can_be_made() {
        for place in [shipped(false), shipped(true)] {
            let config = Config::load(&place.config, place.sim, &[]).unwrap();
            let listed = config.modules.iter().map(|module| module.name.as_str());
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
            let place = Place { sets: sets.map(|set: String| format!("rs485.a.{set}")).into(), ..shipped(true) };
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

    #[test]
    fn the_gamepad_is_the_simulator_s_where_its_socket_lies_in_the_run_folder() {
        let ports = |sim, name: &str, set: &str| {
            let sets = if set.is_empty() { Vec::new() } else { vec![format!("joystick.device={set:?}")] };
            module(&Place { sets, ..shipped(sim) }, name, State::Run).unwrap().1.ports
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
    fn a_module_that_is_not_there_is_refused() {
        let why = |place, name| module(&place, name, State::Run).err().unwrap().to_string();
        assert_eq!(why(shipped(false), SIMULATOR), "module simulator: only with --sim");
        assert!(
            why(shipped(true), "cook").starts_with("module cook: there is none of that name; there are watchdog, ")
        );
    }
}
