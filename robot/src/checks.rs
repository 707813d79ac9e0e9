//! The bounds of [`sim::check`], from the configuration: the robot that is checked is the one that is built.

use crate::config::{CanBus, Config, ConfigError};
use crate::place::Place;
use base::Duration;
use drivers::canbus;
use sim::check::Limits;

/// What must hold for this robot; for whoever runs it in virtual time. `restart_max` is the host's longest delay.
///
/// # Errors
/// When the configuration is refused, or has no drives.
pub fn limits(place: &Place, restart_max: Duration) -> Result<Limits, ConfigError> {
    let config = Config::load(&place.config, place.sim, &place.sets)?;
    let robot = &config.robot;
    let drives = |bus: &CanBus| Some((bus.name.clone(), bus.driver.propulsion()?, bus.driver.steering()?.node));
    let Some((bus, (propulsion, gear), steering)) = robot.can.iter().find_map(drives) else {
        return Err(ConfigError(vec!["checks: robot.toml has no [can.<bus>] with an epos and an icla".into()]));
    };
    Ok(Limits {
        driver: canbus::NAME.into(),
        watchdog: watchdog::NAME.into(),
        planner: "planner".into(),
        critical: config.critical().collect(),
        bus: format!("can.{bus}"),
        propulsion,
        steering,
        rpm_per_mps: 60.0 * gear / robot.geometry.wheel_circumference_m(),
        speed: robot.limits.speed_mps,
        steering_angle: robot.limits.steering_rad,
        speed_manual: robot.limits.speed_manual_mps,
        speed_autonomous: robot.limits.speed_autonomous_mps,
        quick_stop: robot.limits.quick_stop_mps2,
        ttl: robot.limits.command_ttl,
        pause_line: robot.power.is_some(),
        restart_max,
    })
}
