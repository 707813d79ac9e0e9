//! The simulated side of a robot: its buses with their boards and drives, its body, a world.

use crate::config::{CanBus, ModbusBus, Robot, gpio_bus};
use crate::place::{GAMEPAD_BUS, W1_BUS};
use base::Duration;
use drivers::auxiliary::ChipKeys;
use drivers::canbus::{self, PauseStop};
use drivers::rs485_bus::{Kind, Node};
use drivers::rs485a::Ranger;
use modbus::value::{Number, Place};
use navitools::{Point, Pose};
use settings::robot::Beacon;
use simulator::boards::battery::BatteryConfig;
use simulator::boards::icla::Gearing;
use simulator::boards::sbs1::Sbs1Config;
use simulator::boards::sd1::Sd1Config;
use simulator::body::{Errors, Parameters};
use simulator::world::World;
use simulator::{
    BoardConfig, BoardKind, CanConfig, Config, DeviceConfig, I2cConfig, LineConfig, ModbusConfig, SerialConfig,
    W1Config,
};

/// `simulator`: every bus, the robot's body, a world.
pub(crate) fn config(mut world: World, robot: &Robot, wire_time: bool) -> Config {
    if world.beacons.is_empty() {
        let at = |beacon: &Beacon| Point { x: beacon.x, y: beacon.y };
        let beacon = |beacon: &Beacon| simulator::world::Beacon { id: beacon.id, at: at(beacon) };
        world.beacons = robot.beacons.iter().map(beacon).collect();
    }
    let can = robot.can.iter().find_map(|bus| drives(bus, robot.stop.feed_output()));
    let usual = Parameters::default();
    let parameters = Parameters {
        gear: can.as_ref().map_or(usual.gear, |(_, gear)| *gear),
        steering_rate: robot.limits.steering_rate_radps,
        errors: Errors::usual(),
        brake: if robot.stop.pause == PauseStop::Brake { robot.stop.brake_mps2 } else { 0.0 },
        ..Parameters::of(&robot.geometry)
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
    });
    let usual = Config::default();
    let gpio = robot.io.iter().flat_map(|io| &io.gpio);
    Config {
        modbus: robot.io.iter().flat_map(|io| &io.modbus).map(modbus_line).collect(),
        gpio: gpio.map(|keys| LineConfig { bus: gpio_bus(keys), active: keys.simulated }).collect(),
        pause_delay: if robot.stop.pause == PauseStop::Delayed { robot.stop.delay } else { Duration::ZERO },
        world,
        parameters,
        can: can.map(|(can, _)| can),
        serial: serial.collect(),
        i2c: i2c.collect(),
        w1,
        line: robot.stop.feed_line().map(|_| canbus::LINE_BUS.into()),
        gamepad: robot.gamepad.as_ref().filter(|gamepad| gamepad.port.is_simulated()).map(|_| GAMEPAD_BUS.into()),
        wire_time,
        sonar: simulator::sonar::Sonar { beam: robot.sensors.srf08.beam_rad, ..usual.sonar },
        ..usual
    }
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

/// What a device has for a value; one that it cannot have is 0.
fn words(place: &Place, value: f64) -> Vec<u16> {
    match place.number(value) {
        Some(Number::Words(words)) => words.to_vec(),
        Some(Number::Bit(on)) if place.table.is_bits() => vec![on.into()],
        Some(Number::Bit(on)) => vec![u16::from(on) << place.bit],
        None => vec![0; place.width().into()],
    }
}

/// A CAN bus with both drives on it, with the output that feeds the motors, and the gear of the propulsion.
fn drives(bus: &CanBus, output: Option<canbus::OutputConfig>) -> Option<(CanConfig, f64)> {
    let (propulsion, gear) = bus.driver.propulsion()?;
    let steering = bus.driver.steering()?;
    let canbus::SteeringDrive::Icla { gear: steering_gear, counts_per_turn, .. } = steering.drive else { return None };
    let can = CanConfig {
        bus: format!("can.{}", bus.name),
        bitrate: bus.driver.bitrate,
        propulsion,
        steering: steering.node,
        gearing: Gearing { counts_per_turn, gear: steering_gear },
        output: output.map(|canbus::OutputConfig { node, index, subindex, bits, on, .. }| {
            simulator::boards::output::OutputConfig { node, index, sub: subindex, bits, on }
        }),
    };
    Some((can, gear))
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
