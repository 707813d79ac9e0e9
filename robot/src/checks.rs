//! Limits of [`sim::check`] from the configuration: the checks are for the robot that is built.

use crate::config::{CanBus, Config, ConfigError, Robot, Rs485Bus};
use crate::place::RobotLocation;
use crate::{simulated, topology};
use base::Duration;
use canopen::NodeConfig;
use canopen::master::PdoMapping;
use canopen::pdo::Mapped;
use drivers::rs485_bus::Node;
use drivers::{canbus, power, rs485a};
use module::admission::Policy;
use motorctl::{can, serial};
use navitools::Pose;
use settings::robot::Base;
use sim::check::{self, Guarded, Limits, Promise, RangingBoard, SeeingLidar, Sight, StopReport, wire};
use simulator::world::World;
use simulator::{Axis, CanConfig, DriveConfig, DriveKind};
use std::f64::consts::PI;

/// First communication record of a TPDO.
const TPDOS: u16 = 0x1800;
const CONTROLWORD: u16 = 0x6040;
const STATUSWORD: u16 = 0x6041;
/// Target position, interpolated position, target velocity.
const TARGETS: [u16; 3] = [0x607A, 0x60C1, 0x60FF];

/// Low byte of the controlword of a quick stop (CiA 402-2): what the rules read of a motor controller that has one.
const QUICK_STOP: u8 = 0x0B;

/// Angle to the robot's axis within which a sonar looks forward, or backward, rad.
const LOOKS_RAD: f64 = 1.3;

/// Limits for this robot, for runs in virtual time. `restart_max` is the host's longest delay.
///
/// # Errors
/// The configuration is invalid, or has no drives.
pub fn limits(place: &RobotLocation, restart_max: Duration) -> Result<Limits, ConfigError> {
    let config = Config::load(&place.config, place.sim, &place.sets)?;
    let robot = &config.robot;
    let driver = topology::canbus(place, &config, false)?;
    let simulated = simulated::config(place, World::default(), robot, false)?;
    let policy = topology::policy(&config);
    let missing = || ConfigError(vec!["checks: robot.toml has no drives of its base that the rules can read".into()]);
    let can: Vec<&CanConfig> = simulated.can.iter().chain(&simulated.further).collect();
    if can.len() > wire::BUSES_MAX {
        let why = format!("checks: {} CAN buses; the rules read at most {}", can.len(), wire::BUSES_MAX);
        return Err(ConfigError(vec![why]));
    }
    let is_controller = |drive: &DriveConfig| matches!(drive.kind, DriveKind::Controller { .. });
    let on_can = (0_u8..).zip(&can).flat_map(|(bus, can)| can.drives.iter().map(move |drive| (bus, drive)));
    let circumference = robot.geometry.wheel_circumference_m();
    let node = |drive: &DriveConfig| driver.nodes().find(|node| node.name == drive.name);
    let mut wheels = Vec::new();
    for (bus, drive) in on_can.clone() {
        let Axis::Wheel(place) = drive.kind.axis() else { continue };
        let (on_wire, stop_word) = match &drive.kind {
            DriveKind::Controller { device: can::Device::Odrive(device), .. } => {
                (wire::Drive::can_simple(bus, device.node, device.endpoints.enable_watchdog), 0)
            }
            DriveKind::Controller { device: can::Device::Vesc { device, host }, .. } => {
                (wire::Drive::of_controller(bus, place, wire::Protocol::VescOnCan(vesc(device, *host))), QUICK_STOP)
            }
            _ => {
                let node = node(drive).ok_or_else(missing)?;
                let stop_word = node.stop.as_ref().and_then(|stop| stop.value.first().copied()).unwrap_or(0);
                (on_wire(bus, node).ok_or_else(missing)?, stop_word)
            }
        };
        let units_per_mps = units_per_mps(drive, circumference);
        wheels.push((place, wire::Wheel { name: drive.name.clone(), drive: on_wire, stop_word, units_per_mps }));
    }
    for line in &simulated.drive_lines {
        for (motor, number) in line.motors.iter().zip(0_u8..) {
            let name = line.bus.clone();
            let (protocol, units_per_turn) = match &line.device {
                serial::Device::Vesc(device) => {
                    (wire::Protocol::VescOnUart { line: name, vesc: vesc(device, 0) }, erpm_per_turn(device))
                }
                serial::Device::RoboClaw(device) => {
                    let of = wire::RoboClaw { address: device.address, motor: number };
                    let counts = device.counts_per_turn.get(usize::from(number)).copied();
                    (wire::Protocol::RoboClaw { line: name, of }, counts.unwrap_or(f64::NAN))
                }
            };
            let wheel = wire::Wheel {
                name: motor.name.clone(),
                drive: wire::Drive::of_controller(0, motor.wheel, protocol),
                stop_word: QUICK_STOP,
                units_per_mps: units_per_turn * motor.gear / circumference,
            };
            wheels.push((motor.wheel, wheel));
        }
    }
    if wheels.is_empty() {
        return Err(missing());
    }
    // As the base has them, on whichever buses.
    wheels.sort_by_key(|(place, _)| *place);
    let steering_drive = on_can.clone().find(|(_, drive)| drive.kind.axis() == Axis::Steering);
    let read = |(bus, drive): (u8, &DriveConfig)| on_wire(bus, node(drive)?);
    let steering = steering_drive.map(|found| read(found).ok_or_else(missing)).transpose()?;
    let base = robot.base.as_ref().map(|base| base_limits(base, robot)).transpose()?;
    let homes_at_start = |bus: &CanBus| {
        let is_theirs = can.iter().any(|can| can.bus == bus.bus());
        is_theirs && bus.driver.homing_release == canbus::HomingRelease::Start
    };
    Ok(Limits {
        driver: canbus::NAME.into(),
        watchdog: watchdog::NAME.into(),
        planner: "planner".into(),
        critical: config.critical().collect(),
        power: robot.power.as_ref().map(|_| power::NAME.into()),
        stops: stops(robot, &policy),
        estimator: policy.estimator,
        commands: robot.bus.commands,
        wheels: wheels.into_iter().map(|(_, wheel)| wheel).collect(),
        steering,
        homed: match steering_drive.map(|(_, drive)| &drive.kind) {
            Some(DriveKind::Cia402(drive)) => drive.homed,
            Some(DriveKind::Epos { .. } | DriveKind::Icla(_) | DriveKind::Controller { .. }) => {
                canopen::drives::icla::HOMED
            }
            None => 0,
        },
        speed: robot.limits.speed_mps,
        steering_angle: robot.limits.steering_rad,
        wheelbase: robot.geometry.wheelbase_m,
        tread_ratio: robot.geometry.traction().greatest_ratio(robot.limits.steering_rad),
        rotation: match base {
            Some(_) => robot.limits.rotation_radps,
            // That of the tightest turn at full speed.
            None => robot.limits.speed_mps * robot.limits.steering_rad.tan() / robot.geometry.wheelbase_m,
        },
        base,
        feed_is_cut: robot.stop.second_way == canbus::SecondWay::Power && robot.power.is_some(),
        speed_manual: robot.limits.speed_manual_mps,
        speed_autonomous: robot.limits.speed_autonomous_mps,
        quick_stop: robot.limits.quick_stop_mps2,
        coasting: (on_can.clone().any(|(_, drive)| is_controller(drive)) || !simulated.drive_lines.is_empty())
            .then_some(robot.stop.coasting_mps2),
        ttl: robot.limits.command_ttl,
        ranging: ranging(robot),
        homing_at_start: robot.can.iter().any(homes_at_start),
        buses: can.iter().map(|can| can.bus.clone()).collect(),
        guard: (robot.guard.ranging != ::guard::Ranging::None)
            .then(|| Guarded { module: ::guard::NAME.into(), creep_mps: robot.guard.creep }),
        promise: robot.guard.ranging.has_sonars().then_some(Promise {
            reaction_s: robot.guard.reaction + robot.guard.sensing,
            braking_mps2: robot.limits.deceleration_mps2,
            beam_rad: robot.sensors.srf08.beam_rad,
        }),
        sight: sight(robot),
        restart_max,
    })
}

/// Sources of PAUSE that the driver of the lidars and that of the signals report.
fn stops(robot: &Robot, policy: &Policy) -> Vec<StopReport> {
    let fields = robot.lidar.iter().filter(|lidar| lidar.stop.stops()).map(|lidar| (lidar.bus(), &policy.lidar));
    // Those of CANopen devices are read by the driver of the drives.
    let signals = robot.io.iter().flat_map(|io| io.stops(&robot.stop));
    let inputs = signals.map(|name| (format!("io.{name}"), &policy.io));
    let report = |(source, module): (String, &Option<String>)| Some(StopReport { source, module: module.clone()? });
    fields.chain(inputs).filter_map(report).collect()
}

/// Kinematics and measures of a base that turns by its wheels.
fn base_limits(base: &Base, robot: &Robot) -> Result<check::Base, ConfigError> {
    let chassis = base.chassis(&robot.limits).map_err(|why| ConfigError(vec![format!("checks: [base]: {why}")]))?;
    Ok(check::Base { chassis, deceleration_mps2: robot.limits.deceleration_mps2 })
}

/// Units of velocity of a drive at 1 m/s, by its own objects: those of its driver may be wrong.
fn units_per_mps(drive: &DriveConfig, circumference: f64) -> f64 {
    match &drive.kind {
        DriveKind::Cia402(own) => own.velocity_units(drive.node, circumference),
        DriveKind::Epos { gear, .. } => 60.0 * gear / circumference,
        // Turns/s of the motor; ERPM of a VESC.
        DriveKind::Controller { gear, device, .. } => match device {
            can::Device::Odrive(_) => gear / circumference,
            can::Device::Vesc { device, .. } => erpm_per_turn(device) * gear / circumference,
        },
        DriveKind::Icla(_) => f64::NAN,
    }
}

/// ERPM at one motor turn per second: revolutions per minute of the field.
fn erpm_per_turn(device: &motorctl::vesc::Device) -> f64 {
    60.0 * f64::from(device.pole_pairs)
}

/// A VESC as the rules read it.
fn vesc(device: &motorctl::vesc::Device, host: u8) -> wire::Vesc {
    let [hold_ma, quick_stop_ma] =
        [device.hold_current_a, device.quick_stop_current_a].map(|current| (current * 1000.0).round() as i32);
    wire::Vesc { id: device.id, host, hold_ma, quick_stop_ma }
}

/// Where the PDOs of a node have controlword, target and statusword; none: they have not all of them in whole bytes.
fn on_wire(bus: u8, node: &NodeConfig) -> Option<wire::Drive> {
    let place = |mapping: &PdoMapping, wanted: &[u16]| {
        let mut bits = 0;
        for mapped in mapping.entries.iter().map(|entry| Mapped::new(*entry)) {
            if wanted.contains(&mapped.index) {
                return (bits % 8 == 0).then_some(bits / 8);
            }
            bits += usize::from(mapped.bits);
        }
        None
    };
    let rpdo = node.mappings.iter().find(|mapping| mapping.record < TPDOS)?;
    let tpdos = node.mappings.iter().filter(|mapping| mapping.record >= TPDOS);
    let report =
        |tpdo: &PdoMapping| Some(wire::Place { id: wire::on_bus(bus, tpdo.cob_id), at: place(tpdo, &[STATUSWORD])? });
    Some(wire::Drive {
        protocol: wire::Protocol::Canopen,
        bus,
        node: node.id,
        command: wire::Place { id: wire::on_bus(bus, rpdo.cob_id), at: place(rpdo, &[CONTROLWORD])? },
        target: place(rpdo, &TARGETS)?,
        reports: tpdos.filter_map(report).collect(),
    })
}

/// What a guard with lidars promises; none without.
fn sight(robot: &Robot) -> Option<Sight> {
    let guard = &robot.guard;
    // What is lost is noticed later than what appears.
    let sensing = guard.sensing.max(guard.scan_age_max.as_secs_f64());
    let geometry = &robot.geometry;
    guard.ranging.has_lidars().then(|| Sight {
        lidars: robot
            .lidar
            .iter()
            .map(|lidar| SeeingLidar {
                bus: lidar.bus(),
                mount: Pose::new(lidar.driver.x, lidar.driver.y, lidar.driver.theta),
                view_rad: lidar.driver.view_rad(),
                reach_m: lidar.driver.range_max.map_or(guard.reach, |range| range.min(guard.reach)),
            })
            .collect(),
        reaction_s: guard.reaction + sensing,
        braking_mps2: robot.limits.deceleration_mps2,
        body: (-geometry.rear_m(), geometry.front_m(), geometry.width_m() / 2.0),
        shape: geometry.footprint().copied(),
    })
}

/// Boards of range finders, and the directions in which their sonars look.
fn ranging(robot: &Robot) -> Vec<RangingBoard> {
    let board = |(bus, node, finders): (&Rs485Bus, &Node, canbus::ranging::RangingBoard)| {
        let sonars = || robot.srfs.iter().filter(|sonar| finders.sonars.contains(&sonar.id.into()));
        RangingBoard {
            name: finders.name.clone(),
            module: rs485a::NAME.into(),
            bus: format!("rs485.{}", bus.name),
            crc: bus.driver.crc.into(),
            address: node.address,
            forward: sonars().any(|sonar| sonar.theta.abs() < LOOKS_RAD),
            backward: sonars().any(|sonar| PI - sonar.theta.abs() < LOOKS_RAD),
            sonars: sonars().map(|sonar| (sonar.channel.into(), Pose::new(sonar.x, sonar.y, sonar.theta))).collect(),
        }
    };
    robot.ranging_boards().map(board).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn the_shipped_drives_are_where_their_tables_have_them() {
        let place = RobotLocation {
            config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
            run_dir: "/run/advee".into(),
            lcm_url: String::new(),
            sets: Vec::new(),
            sim: true,
            world: None,
        };
        let limits = limits(&place, Duration::from_secs(2)).unwrap();
        let first = |id| wire::Place { id, at: 0 };
        let drive = |node, command, reports: [u16; 2]| wire::Drive {
            protocol: wire::Protocol::Canopen,
            bus: 0,
            node,
            command: first(command),
            target: 2,
            reports: reports.map(first).into(),
        };
        let [propulsion] = &limits.wheels[..] else { panic!("{:?}", limits.wheels) };
        assert_eq!(propulsion.drive, drive(1, 0x501, [0x181, 0x481]));
        assert_eq!(limits.steering, Some(drive(2, 0x302, [0x182, 0x282])));
        // 26 turns of the motor per 0.628 m.
        assert!((propulsion.units_per_mps - 2483.0).abs() < 0.5, "{}", propulsion.units_per_mps);
        assert_eq!((&limits.buses[..], propulsion.stop_word, limits.homed), (&["can.main".into()][..], 0x0B, 0x8000));
        assert!(limits.homing_at_start);
    }
}
