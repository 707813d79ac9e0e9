//! Limits of [`sim::check`] from the configuration: the checks are for the robot that is built.

use crate::config::{CanDriver, Config, ConfigError};
use crate::place::Place;
use base::Duration;
use drivers::canbus;
use sim::check::Limits;

/// Limits for this robot, for runs in virtual time. `restart_max` is the host's longest delay.
///
/// # Errors
/// The configuration is invalid, or has no drives.
pub fn limits(place: &Place, restart_max: Duration) -> Result<Limits, ConfigError> {
    let config = Config::load(&place.config, place.sim, &place.sets)?;
    let robot = &config.robot;
    let drives = robot.can.iter().find_map(|bus| {
        let propulsion = bus.nodes.iter().find_map(|node| match node.driver {
            CanDriver::Epos { gear } => Some((node.id, gear)),
            CanDriver::Icla { .. } => None,
        })?;
        let steering = bus.nodes.iter().find(|node| matches!(node.driver, CanDriver::Icla { .. }))?;
        Some((bus, propulsion, steering.id))
    });
    let Some((bus, (propulsion, gear), steering)) = drives else {
        return Err(ConfigError(vec!["checks: robot.toml has no [can.<bus>] with an epos and an icla".into()]));
    };
    let metres_per_turn = core::f64::consts::TAU * robot.geometry.wheel_radius_m;
    let critical = config.modules.iter().filter(|module| module.critical);
    Ok(Limits {
        driver: canbus::NAME.into(),
        watchdog: watchdog::NAME.into(),
        planner: "planner".into(),
        critical: critical.map(|module| module.name.clone()).collect(),
        bus: format!("can.{}", bus.name),
        propulsion,
        steering,
        rpm_per_mps: 60.0 * gear / metres_per_turn,
        speed: robot.limits.speed_mps,
        steering_angle: robot.limits.steering_rad,
        speed_manual: robot.limits.speed_manual_mps,
        speed_autonomous: robot.limits.speed_autonomous_mps,
        quick_stop: robot.limits.quick_stop_mps2,
        ttl: Duration::from_secs_f64(robot.limits.command_ttl_s),
        pause_line: robot.power.is_some(),
        restart_max,
    })
}
