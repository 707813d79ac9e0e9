//! The simulated side of a robot: its buses with their boards and drives, its body, a world.

use crate::config::{CanBus, ConfigError, Imu, Io, IoLine, Lidar, ModbusBus, Robot, SerialLine, gpio_bus};
use crate::place::{GAMEPAD_BUS, HOST_BUS, RobotLocation, W1_BUS};
use crate::sheets;
use base::Duration;
use base::w1::Rom;
use drivers::auxiliary::ChipKeys;
use drivers::canbus::table::{DriveTable, Twin};
use drivers::canbus::{self, PauseStop};
use drivers::io::{self, SwitchKeys};
use drivers::lidar::{LidarKeys, Model};
use drivers::power;
use drivers::rs485_bus::{Kind, Node};
use drivers::rs485a::Ranger;
use exchange::device::Known;
use modbus::value::{Number, Place};
use navitools::{Point, Pose};
use rs485::boards::psc1::CHANNELS;
use settings::robot::{Base, Beacon};
use simulator::boards::battery::BatteryConfig;
use simulator::boards::cia402::Cia402Config;
use simulator::boards::icla::Gearing;
use simulator::boards::io_node::{IoNodeConfig, ObjectConfig};
use simulator::boards::output::OutputConfig;
use simulator::boards::sbs1::Sbs1Config;
use simulator::boards::sd1::Sd1Config;
use simulator::body::{Errors, Parameters, Switch};
use simulator::imu::ImuConfig;
use simulator::lidar::{LidarConfig, LidarModel};
use simulator::world::World;
use simulator::{
    Axis, BoardConfig, BoardKind, CanConfig, ComputerConfig, Config, DeviceConfig, DriveConfig, DriveKind,
    DriveLineConfig, ExchangeConfig, HostConfig, I2cConfig, LineConfig, ModbusConfig, MotorConfig, SerialConfig,
    W1Config,
};

/// A steering motor by a data sheet could turn the wheels so much faster than it is to: a unit of velocity that is not
/// what the configuration says shows.
const STEERING_RESERVE: f64 = 2.0;

/// Time that a simulated computer needs to shut down, if it is given twice as much.
const COMPUTER_SHUTDOWN: Duration = Duration::from_secs(8);

/// `simulator`: every bus, the robot's body, a world.
///
/// # Errors
/// The data sheet of a drive cannot be read.
pub(crate) fn config(
    place: &RobotLocation,
    mut world: World,
    robot: &Robot,
    wire_time: bool,
) -> Result<Config, ConfigError> {
    if world.beacons.is_empty() {
        let at = |beacon: &Beacon| Point { x: beacon.x, y: beacon.y };
        let beacon = |beacon: &Beacon| simulator::world::Beacon { id: beacon.id, at: at(beacon) };
        world.beacons = robot.beacons.iter().map(beacon).collect();
    }
    let mut buses = can(place, robot)?.into_iter();
    let (can, further) = (buses.next(), buses.collect::<Vec<_>>());
    let steers =
        |drive: &DriveConfig| matches!(drive.kind, DriveKind::Cia402(_)) && drive.kind.axis() == Axis::Steering;
    let by_sheet = can.iter().chain(&further).flat_map(|can| &can.drives).any(steers);
    let wheels = robot.base.map(|base| base.chassis(&robot.limits)).transpose();
    let wheels = wheels.map_err(|error| ConfigError(vec![format!("simulator: [base]: {error}")]))?;
    let parameters = Parameters {
        steering_rate: robot.limits.steering_rate_radps * if by_sheet { STEERING_RESERVE } else { 1.0 },
        errors: Errors::usual(),
        brake: if robot.stop.pause == PauseStop::Brake { robot.stop.brake_mps2 } else { 0.0 },
        ..Parameters::of(&robot.geometry)
    };
    let nodes = robot.can.iter().flat_map(|bus| &bus.driver.nodes);
    let parameters = match nodes.filter(|node| node.axis == canbus::Axis::Steering).find_map(|node| node.drive.homing())
    {
        Some(homing) => {
            let switch = Switch { angle: homing.angle, left: homing.is_left() };
            parameters.steered(robot.limits.steering_rad, switch)
        }
        None => parameters,
    };
    let serial = robot.rs485.iter().map(|bus| SerialConfig {
        bus: format!("rs485.{}", bus.name),
        baud: bus.line.baud,
        crc: bus.driver.crc.into(),
        real: bus.line.offered().is_none(),
        boards: bus.driver.nodes.iter().map(|node| board(robot, node)).collect(),
    });
    let fan = |chip: &ChipKeys| Some((chip.name.clone(), chip.address()?));
    let i2c = robot.i2c.iter().map(|bus| I2cConfig {
        bus: format!("i2c.{}", bus.name),
        hz: bus.port.hz,
        fans: bus.driver.chips.iter().filter_map(fan).collect(),
    });
    let w1 = robot.w1.as_ref().map(|w1| W1Config {
        bus: W1_BUS.into(),
        thermometers: w1.driver.sensors.iter().map(|sensor| (sensor.rom, sensor.name.clone())).collect(),
        switches: robot.io.as_ref().map_or_else(Vec::new, |io| switches(&io.w1)),
    });
    let host = robot.host.as_ref().map(|host| HostConfig {
        bus: HOST_BUS.into(),
        sensors: host.driver.sensors.iter().map(|sensor| (sensor.zone.clone(), sensor.name.clone())).collect(),
    });
    let usual = Config::default();
    let gpio = robot.io.iter().flat_map(|io| &io.gpio);
    Ok(Config {
        modbus: robot.io.iter().flat_map(|io| &io.modbus).map(modbus_line).collect(),
        exchange: robot.io.iter().flat_map(|io| &io.serial).map(exchange_line).collect(),
        lidars: robot.lidar.iter().map(lidar).collect(),
        imus: robot.imu.iter().map(|unit| imu(unit, can.as_ref())).collect::<Result<_, _>>()?,
        gpio: gpio.map(|keys| LineConfig { bus: gpio_bus(keys), active: keys.simulated }).collect(),
        computers: robot.power.iter().flat_map(|power| &power.computers).filter_map(computer).collect(),
        pause_delay: if robot.stop.pause == PauseStop::Delayed { robot.stop.delay } else { Duration::ZERO },
        world,
        parameters,
        wheels,
        can,
        further,
        drive_lines: robot.serial.iter().map(|line| drive_line(robot, line)).collect(),
        serial: serial.collect(),
        i2c: i2c.collect(),
        w1,
        host,
        line: robot.stop.feed_line().map(|_| canbus::LINE_BUS.into()),
        gamepad: robot.gamepad.as_ref().filter(|gamepad| gamepad.port.is_simulated()).map(|_| GAMEPAD_BUS.into()),
        wire_time,
        sonar: simulator::sonar::Sonar { beam: robot.sensors.srf08.beam_rad, ..usual.sonar },
        ..usual
    })
}

/// A computer that shuts down by its button; its lines are simulated if they are GPIO lines.
fn computer(keys: &power::ComputerConfig) -> Option<ComputerConfig> {
    let number = CHANNELS.iter().position(|name| *name == keys.channel)?;
    let line = |name: &String| format!("gpio.{name}");
    Some(ComputerConfig {
        channel: (u8::try_from(number).ok()?, keys.channel.clone()),
        button: Some(line(&keys.button)),
        alive: keys.alive.as_ref().map(line),
        shutdown: COMPUTER_SHUTDOWN.min(keys.shutdown / 2),
        starts: !keys.press_on,
    })
}

/// Switches, with what their pins see from outside: outputs are pulled up.
fn switches(keys: &[SwitchKeys]) -> Vec<(Rom, u8)> {
    let mut all: Vec<(Rom, u8)> = Vec::new();
    for keys in keys {
        let n = all.iter().position(|(rom, _)| *rom == keys.rom).unwrap_or_else(|| {
            all.push((keys.rom, 3));
            all.len() - 1
        });
        if !keys.output && keys.simulated == keys.active_low {
            all[n].1 &= !(1 << keys.channel);
        }
    }
    all
}

/// A lidar where it sits.
fn lidar(lidar: &Lidar) -> LidarConfig {
    let LidarKeys { model, x, y, theta, upside_down, dialect, .. } = lidar.driver;
    LidarConfig {
        bus: lidar.bus(),
        baud: lidar.device().line_baud(),
        model: match model {
            Model::Ld(model) => LidarModel::Ld(model),
            Model::Rplidar(model) => LidarModel::Rplidar(model),
            Model::Ydlidar(model) => LidarModel::Ydlidar(model),
            Model::Sick(family) => LidarModel::Sick(family, dialect),
            Model::Hokuyo(name) => LidarModel::hokuyo(name),
        },
        mount: Pose::new(x, y, theta),
        upside_down,
        fields: lidar.stop.simulated_fields.clone(),
    }
}

/// An inertial measurement unit as it is mounted.
fn imu(imu: &Imu, can: Option<&CanConfig>) -> Result<ImuConfig, ConfigError> {
    let (subject, bus) = (imu.subject(), imu.bus());
    let refused = |why: &str| Err(ConfigError(vec![format!("{subject}.bus = {bus:?}: {why}")]));
    let Some(model) = imu.driver.model() else { return refused("the address of the device is none") };
    if model == imu::Model::Xsens && can.is_none_or(|can| can.bus != bus) {
        return refused("the simulator has only the CAN bus of the drives");
    }
    Ok(ImuConfig {
        baud: imu.port.bus.is_none().then_some(imu.port.baud),
        mount: [imu.driver.roll, imu.driver.pitch, imu.driver.yaw],
        name: subject,
        bus,
        model,
    })
}

/// A Modbus line, with devices that have the registers of its signals.
fn modbus_line(bus: &ModbusBus) -> ModbusConfig {
    let mut devices: Vec<DeviceConfig> = Vec::new();
    for keys in &bus.driver.signals {
        let unit = keys.unit(bus.driver.unit);
        let words = words(&keys.place(), keys.simulated);
        let words = (keys.address..=u16::MAX).zip(words).map(|(address, word)| (keys.table, address, word));
        match devices.iter_mut().find(|device| device.unit == unit) {
            Some(device) => device.points.extend(words),
            None => devices.push(DeviceConfig { unit, points: words.collect() }),
        }
    }
    ModbusConfig { bus: bus.bus(), line: bus.line(), devices }
}

/// A serial line with a device that knows the requests of the table.
fn exchange_line(line: &IoLine) -> ExchangeConfig {
    let (protocol, device) = (line.driver.protocol(), line.device());
    let known = |request: &io::RequestKeys| {
        let answer = request.answer();
        let inputs = request.signals.iter().filter(|field| !field.output);
        let inputs: Vec<_> = inputs.map(|field| (field.place(), field.simulated)).collect();
        let outputs = request.signals.iter().filter(|field| field.output);
        Known {
            request: request.request.clone(),
            outputs: outputs.map(io::FieldKeys::place).collect(),
            data: exchange::device::answer_data(&protocol, &answer, &inputs),
            answer,
        }
    };
    let known = line.driver.requests.iter().map(known).collect();
    ExchangeConfig { bus: line.bus(), baud: device.line_baud(), protocol: protocol.clone(), known }
}

/// What a device has for a value; one that it cannot have is 0.
fn words(place: &Place, value: f64) -> Vec<u16> {
    match place.number(value) {
        Some(Number::Words(words)) => words.to_vec(),
        Some(Number::Bit(on)) if place.table.is_bits() => vec![on.into()],
        Some(Number::Bit(on)) => vec![u16::from(on) << place.bit],
        None => vec![0; place.width().into()],
    }
}

/// The CAN buses of `driver_canbus`: their drives, those of the propulsion first, the output that feeds the motors, and
/// the devices, which are on the first bus unless they name another one.
fn can(place: &RobotLocation, robot: &Robot) -> Result<Vec<CanConfig>, ConfigError> {
    let buses: Vec<CanBus> = robot.buses_of_motion(&robot.can).into_iter().cloned().collect();
    let bus = |(number, mut bus): (usize, CanBus)| {
        sheets::read(place, &mut bus)?;
        bus.driver.nodes.sort_by_key(|node| (node.axis == canbus::Axis::Steering, wheel(robot, node.axis)));
        let name = bus.bus();
        let is_on = |named: Option<&str>| named.map_or(number == 0, |named| named == name);
        Ok(CanConfig {
            bitrate: bus.driver.bitrate,
            drives: bus.driver.nodes.iter().map(|node| drive(robot, node)).collect::<Result<_, _>>()?,
            output: robot.stop.feed_output().filter(|_| is_on(robot.stop.output_bus.as_deref())).map(|output| {
                let canbus::OutputConfig { node, index, subindex, bits, on, .. } = output;
                OutputConfig { node, index, sub: subindex, bits, on }
            }),
            devices: robot
                .io
                .iter()
                .flat_map(Io::devices)
                .filter(|device| is_on(device.keys.bus.as_deref()))
                .map(|device| io_node(&device))
                .collect(),
            bus: name,
        })
    };
    buses.into_iter().enumerate().map(bus).collect()
}

/// A CANopen device with the objects of its signals.
fn io_node(device: &io::Canopen) -> IoNodeConfig {
    let keys = &device.keys;
    let mut objects: Vec<ObjectConfig> = Vec::new();
    for signal in &keys.signals {
        let place = signal.place();
        let (output, bits) = (signal.is_output(), place.bits(signal.simulated).unwrap_or_default());
        match objects.iter_mut().find(|object| (object.index, object.sub) == (place.index, place.sub)) {
            Some(object) => {
                object.value |= bits;
                object.output |= output;
                object.len = object.len.max(bytes(&place));
            }
            None => objects.push(ObjectConfig {
                index: place.index,
                sub: place.sub,
                len: bytes(&place),
                value: bits,
                output,
            }),
        }
    }
    IoNodeConfig {
        name: device.name.clone(),
        node: keys.node,
        profile: keys.profile,
        vendor: keys.vendor.unwrap_or_default(),
        product: keys.product.unwrap_or_default(),
        objects,
    }
}

/// Bytes of an object that has this value.
fn bytes(place: &io::ObjectPlace) -> usize {
    match (place.format, place.bit) {
        (io::Format::Bit, 8..=15) => 2,
        (io::Format::Bit, 16..) => 4,
        (format, _) => format.size(),
    }
}

/// A serial line with the motor controller that its keys describe.
fn drive_line(robot: &Robot, own: &SerialLine) -> DriveLineConfig {
    let canbus::LineConfig { bus, baud, device, motors } = own.line();
    let motor =
        |(axis, gear): (canbus::Axis, f64)| MotorConfig { name: axis.name().into(), wheel: wheel(robot, axis), gear };
    DriveLineConfig { bus, baud, device, motors: motors.into_iter().map(motor).collect() }
}

/// Number of the wheel that a drive turns.
fn wheel(robot: &Robot, own: canbus::Axis) -> u8 {
    let axes = robot.base.iter().flat_map(Base::axes);
    (0..).zip(axes).find(|(_, axis)| **axis == own.name()).map_or(0, |(number, _)| number)
}

/// A drive, as its keys describe it.
fn drive(robot: &Robot, node: &canbus::Node) -> Result<DriveConfig, ConfigError> {
    let name = node.axis.name();
    let missing = || ConfigError(vec![format!("simulator: the data sheet of the {name} drive was not read")]);
    let controller = |gear, device| DriveKind::Controller { wheel: wheel(robot, node.axis), gear, device };
    let kind = match &node.drive {
        canbus::Drive::Wheel(keys) => by_table(robot, node, (keys.gear, None), keys.table.as_deref())?,
        canbus::Drive::Steering(keys) => {
            by_table(robot, node, (keys.gear, Some(keys.counts_per_turn)), keys.table.as_deref())?
        }
        canbus::Drive::Odrive(keys) => controller(keys.gear, keys.device(node.id)),
        canbus::Drive::Vesc(keys) => controller(keys.motor.gear, keys.device(node.id)),
        canbus::Drive::Cia402(keys) => DriveKind::Cia402(Box::new(Cia402Config {
            axis: if node.axis == canbus::Axis::Steering {
                Axis::Steering
            } else {
                Axis::Wheel(wheel(robot, node.axis))
            },
            sheet: node.sheet.clone().ok_or_else(missing)?,
            gear: keys.gear,
            counts_per_turn: keys.counts_per_turn,
            velocity_unit: keys.velocity_unit.unit(),
            keeps_quick_stop: keys.keeps_quick_stop,
            stops_without: keys.stops_without.clone(),
            current: keys.current(),
            temperature: keys.temperature(),
            homed: keys.homed_bit.map_or(0, |bit| 1 << bit),
            brake: keys.brake == canbus::BrakeControl::Output,
        })),
    };
    Ok(DriveConfig { name: name.into(), node: node.id, kind })
}

/// A drive by a table of objects: the built-in one that it names, else that of its data sheet.
fn by_table(
    robot: &Robot,
    node: &canbus::Node,
    (gear, counts_per_turn): (f64, Option<f64>),
    table: Option<&DriveTable>,
) -> Result<DriveKind, ConfigError> {
    let refused = |why: String| ConfigError(vec![format!("simulator: {why}")]);
    let name = node.axis.name();
    let table = table.ok_or_else(|| refused(format!("the table of the {name} drive is not known")))?;
    let counts = counts_per_turn.or(table.counts_per_turn);
    Ok(match table.simulated {
        Some(Twin::Epos) => DriveKind::Epos { wheel: wheel(robot, node.axis), gear },
        Some(Twin::Icla) => {
            DriveKind::Icla(Gearing { counts_per_turn: counts.unwrap_or(Gearing::default().counts_per_turn), gear })
        }
        None => {
            let sheet = node.sheet.clone().ok_or_else(|| {
                let table = &table.name;
                refused(format!(
                    "the {name} drive cannot be simulated: drives/{table}.toml has neither eds nor simulated"
                ))
            })?;
            let steers = node.axis == canbus::Axis::Steering;
            DriveKind::Cia402(Box::new(Cia402Config {
                axis: if steers { Axis::Steering } else { Axis::Wheel(wheel(robot, node.axis)) },
                sheet,
                gear: Some(gear),
                // Exact below 2^53.
                counts_per_turn: counts.map(|counts| counts as u32),
                velocity_unit: table.velocity_unit.unit(),
                keeps_quick_stop: table.table.keeps_quick_stop,
                stops_without: table.stops_without.clone(),
                current: None,
                temperature: None,
                homed: table.table.homed,
                // A table of objects says nothing of a brake.
                brake: false,
            }))
        }
    })
}

fn board(robot: &Robot, node: &Node) -> BoardConfig {
    let kind = match node.kind {
        Kind::So1 => BoardKind::So1,
        Kind::Sbs1 => BoardKind::Sbs1(Sbs1Config::default()),
        Kind::Psc1 => {
            let usual = BatteryConfig::default();
            BoardKind::Psc1(robot.power.as_ref().map_or(usual, |power| BatteryConfig {
                capacity_ah: power.capacity_ah,
                cells: power.cells,
                ..usual
            }))
        }
        Kind::Sd1 => BoardKind::Sd1(Sd1Config {
            srfs: by_channel(&robot.srfs, node.address, |ranger| Pose::new(ranger.x, ranger.y, ranger.theta)),
            irs: by_channel(&robot.irs, node.address, |ranger| Point { x: ranger.x, y: ranger.y }),
        }),
    };
    BoardConfig { name: node.name.clone(), address: node.address, kind }
}

/// A board's rangers in the order of their channels. A channel without a ranger takes the place of the one before it:
/// nobody asks for it.
fn by_channel<T>(rangers: &[Ranger], board: u8, place: impl Fn(&Ranger) -> T) -> Vec<T> {
    let mut own: Vec<&Ranger> = rangers.iter().filter(|ranger| ranger.board == board).collect();
    own.sort_by_key(|ranger| ranger.channel);
    let count = own.last().map_or(0, |last| usize::from(last.channel) + 1);
    let at = |channel| own.iter().rev().find(|ranger| usize::from(ranger.channel) <= channel).or(own.first());
    (0..count).filter_map(|channel| at(channel).map(|ranger| place(ranger))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config as RobotConfig;
    use drivers::canbus::{Cia402Config as Keys, Drive, VelocityUnit};
    use settings::Section as _;
    use std::path::{Path, PathBuf};

    fn shipped() -> (RobotLocation, Robot) {
        let place = RobotLocation {
            config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
            run_dir: "/run/advee".into(),
            lcm_url: String::new(),
            sets: Vec::new(),
            sim: true,
            world: None,
        };
        let robot = RobotConfig::load(&place.config, true, &[]).unwrap().robot;
        (place, robot)
    }

    fn sheet(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../buses/canopen/eds").join(name)
    }

    /// The shipped robot, with these of its drives by a sheet.
    fn drives(by_sheet: [bool; 2]) -> Result<CanConfig, ConfigError> {
        let (place, mut robot) = shipped();
        let sheets = ["others/maxon_epos4_50_15_node1.dcf", "others/ros2_cia402_slave.eds"].map(sheet);
        let keys = Keys {
            velocity_unit: VelocityUnit::Rpm,
            homed_bit: Some(15),
            switch: Some(-0.6283),
            homing_speed: Some(0.1745),
            ..Keys::usual()
        };
        for (n, sheet) in sheets.into_iter().enumerate().filter(|(n, _)| by_sheet[*n]) {
            let node = &mut robot.can[0].driver.nodes[n];
            (node.drive, node.eds) = (Drive::Cia402(keys.clone()), Some(sheet));
        }
        robot.can[0].driver.nodes.reverse();
        Ok(config(&place, World::default(), &robot, false)?.can.unwrap())
    }

    #[test]
    fn drives_are_those_of_the_configuration_in_any_combination() {
        for by_sheet in [[false, false], [true, false], [false, true], [true, true]] {
            let can = drives(by_sheet).unwrap();
            let row = |drive: &DriveConfig| (drive.name.clone(), drive.node, drive.kind.axis());
            let rows: Vec<_> = can.drives.iter().map(row).collect();
            let expected = [("propulsion".into(), 1, Axis::Wheel(0)), ("steering".into(), 2, Axis::Steering)];
            assert_eq!(rows, expected, "the propulsion is first, wherever its node is in the file");
            let are = can.drives.iter().map(|drive| match &drive.kind {
                DriveKind::Epos { gear, .. } => (*gear == 26.0).then_some(false),
                DriveKind::Icla(gearing) => (gearing.gear == 180.0).then_some(false),
                DriveKind::Cia402(own) => (own.homed == 1 << 15).then_some(true),
                DriveKind::Controller { .. } => None,
            });
            assert_eq!(are.collect::<Vec<_>>(), by_sheet.map(Some));
        }
    }

    #[test]
    fn switch_and_stops_of_a_steering_are_those_of_its_configuration() {
        let steered = |switch, gear, method, most| {
            let (place, mut robot) = shipped();
            robot.limits.steering_rad = most;
            let Drive::Steering(keys) = &mut robot.can[0].driver.nodes[1].drive else { panic!("no IclA") };
            (keys.switch, keys.gear, keys.homing_method) = (switch, gear, method);
            let Parameters { steering_switch, steering_stop, .. } =
                config(&place, World::default(), &robot, false).unwrap().parameters;
            let degrees = |angle: f64| (angle.to_degrees() * 100.0).round() / 100.0;
            (degrees(steering_switch.angle), steering_switch.left, degrees(steering_stop))
        };
        for (name, stop) in [("advee", 37.5), ("advee-lidar", 37.5), ("tug", 37.5)] {
            let (place, _) = shipped();
            let place = RobotLocation { config: place.config.join("..").join(name), ..place };
            let robot = RobotConfig::load(&place.config, true, &[]).unwrap().robot;
            let own = config(&place, World::default(), &robot, false).unwrap().parameters;
            let usual = Parameters::default();
            assert_eq!((own.steering_switch, own.steering_stop), (usual.steering_switch, f64::to_radians(stop)));
        }
        // On its side of straight ahead, whatever searches for it.
        assert_eq!(steered(-0.45, 180.0, 27, 0.6109), (-25.78, false, 36.5));
        assert_eq!(steered(-0.45, -180.0, 27, 0.9), (-25.78, false, 53.07));
        assert_eq!(steered(0.7, -180.0, 27, 0.6109), (40.11, true, 41.61));
        // At straight ahead: where the method searches.
        for (gear, method, left) in [(180.0, 27, false), (-180.0, 27, true), (180.0, 19, true), (180.0, 37, false)] {
            assert_eq!(steered(0.0, gear, method, 0.6109), (0.0, left, 36.5));
        }
    }

    #[test]
    fn a_base_without_steering_has_a_motor_for_each_wheel() {
        for (name, wheels) in [("courier", 2), ("rover", 2), ("porter", 4), ("tripod", 3)] {
            let (place, _) = shipped();
            let place = RobotLocation { config: place.config.join("..").join(name), ..place };
            for sim in [false, true] {
                let robot = RobotConfig::load(&place.config, sim, &[]).unwrap().robot;
                let config = config(&place, World::default(), &robot, false).unwrap();
                assert_eq!(config.wheels.unwrap().wheels().len(), usize::from(wheels));
                let drives: Vec<_> = config.can.unwrap().drives.iter().map(|drive| drive.kind.axis()).collect();
                assert_eq!(drives, (0..wheels).map(Axis::Wheel).collect::<Vec<_>>(), "{name}");
            }
        }
    }

    #[test]
    fn a_sheet_that_cannot_be_read_is_named() {
        let (place, mut robot) = shipped();
        let node = &mut robot.can[0].driver.nodes[0];
        (node.drive, node.eds) = (Drive::Cia402(Keys::usual()), Some("no.eds".into()));
        let why = config(&place, World::default(), &robot, false).unwrap_err().to_string();
        assert!(why.contains("no.eds: "), "{why}");
    }
}
