//! Limits of [`sim::check`] from the configuration: the checks are for the robot that is built.

use crate::config::{CanBus, Config, ConfigError, Robot, Rs485Bus};
use crate::place::RobotLocation;
use base::Duration;
use drivers::rs485_bus::Node;
use drivers::{canbus, power, rs485a};
use navitools::Pose;
use sim::check::{Limits, Promise, RangingBoard};
use std::f64::consts::PI;

/// Angle to the robot's axis within which a sonar looks forward, or backward, rad.
const LOOKS_RAD: f64 = 1.3;

/// Limits for this robot, for runs in virtual time. `restart_max` is the host's longest delay.
///
/// # Errors
/// The configuration is invalid, or has no drives.
pub fn limits(place: &RobotLocation, restart_max: Duration) -> Result<Limits, ConfigError> {
    let config = Config::load(&place.config, place.sim, &place.sets)?;
    let robot = &config.robot;
    let drives = |bus: &CanBus| {
        Some((bus.name.clone(), bus.driver.homing_release, bus.driver.propulsion()?, bus.driver.steering()?.node))
    };
    let Some((bus, homing_release, (propulsion, gear), steering)) = robot.can.iter().find_map(drives) else {
        return Err(ConfigError(vec!["checks: robot.toml has no [can.<bus>] with an epos and an icla".into()]));
    };
    Ok(Limits {
        driver: canbus::NAME.into(),
        watchdog: watchdog::NAME.into(),
        planner: "planner".into(),
        critical: config.critical().collect(),
        power: robot.power.as_ref().map(|_| power::NAME.into()),
        commands: robot.bus.commands,
        bus: format!("can.{bus}"),
        propulsion,
        steering,
        rpm_per_mps: 60.0 * gear / robot.geometry.wheel_circumference_m(),
        speed: robot.limits.speed_mps,
        steering_angle: robot.limits.steering_rad,
        wheelbase: robot.geometry.wheelbase_m,
        speed_manual: robot.limits.speed_manual_mps,
        speed_autonomous: robot.limits.speed_autonomous_mps,
        quick_stop: robot.limits.quick_stop_mps2,
        ttl: robot.limits.command_ttl,
        ranging: ranging(robot),
        homing_at_start: homing_release == canbus::HomingRelease::Start,
        promise: (robot.guard.ranging != ::guard::Ranging::None).then(|| Promise {
            guard: ::guard::NAME.into(),
            reaction_s: robot.guard.reaction + robot.guard.sensing,
            braking_mps2: robot.limits.deceleration_mps2,
            beam_rad: robot.sensors.srf08.beam_rad,
        }),
        restart_max,
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
