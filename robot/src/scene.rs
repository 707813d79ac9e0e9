//! Scene for web pages: dimensions, map and names of parts, which no message contains.

use crate::config::{CanBus, Robot};
use drivers::canbus::Node;
use logger::ros::{self, RobotScene, Sensor};
use navitools::Point;
use planner::map::Map;
use rs485::boards::psc1;
use settings::robot::Geometry;
use simulator::world::World;
use web::center::authority::Limits;
use web::center::scene::{Beacon, Drive, Route, Scene, TemperatureLimit, outline, rounded};

/// Scene of a robot, with its world if it is simulated, else with the map of its planner.
#[must_use]
pub fn of(robot: &Robot, world: Option<&World>, map: Option<&Map>) -> Scene {
    let geometry = &robot.geometry;
    let walls = match (map, world) {
        (Some(map), _) => outline(map),
        (None, Some(world)) => {
            world.walls.iter().map(|wall| [wall.a.x, wall.a.y, wall.b.x, wall.b.y].map(rounded)).collect()
        }
        (None, None) => Vec::new(),
    };
    let columns = world.filter(|_| map.is_none()).map(|world| &world.columns[..]).unwrap_or_default();
    let routes = world.map(|world| &world.routes[..]).unwrap_or_default();
    let flat = |point: &Point| [rounded(point.x), rounded(point.y)];
    let route = |route: &simulator::world::Route| {
        let mut points: Vec<_> = route.waypoints.iter().map(flat).collect();
        points.extend(route.waypoints.first().filter(|_| route.looped).map(flat));
        Route { name: route.name.clone(), points }
    };
    Scene {
        robot: robot.general.name.clone(),
        simulated: world.is_some(),
        outline: corners(geometry),
        wheelbase: geometry.wheelbase_m,
        limits: hand_limits(robot),
        blind: robot.blind_mps(),
        sonar: Sensor::srf08(robot.sensors.srf08.beam_rad).into(),
        beacons: robot.beacons.iter().map(|beacon| Beacon { id: beacon.id, x: beacon.x, y: beacon.y }).collect(),
        walls,
        columns: columns.iter().map(|column| [column.centre.x, column.centre.y, column.radius].map(rounded)).collect(),
        routes: routes.iter().map(route).collect(),
        power_channels: robot.power.as_ref().map(|_| psc1::CHANNELS.to_vec()).unwrap_or_default(),
        temperature_limits: temperature_limits(robot),
        drives: robot.can.iter().flat_map(|bus| drives(robot, bus)).collect(),
        ..Scene::default()
    }
}

/// Limits of a hand on the page.
pub(crate) fn hand_limits(robot: &Robot) -> Limits {
    let (speed, base) = (robot.hand_mps(), robot.base.as_ref());
    Limits {
        speed,
        steering: robot.limits.steering_rad,
        sideways: base.filter(|base| base.goes_sideways()).map_or(0.0, |_| speed),
        rotation: base.map_or(0.0, |_| robot.limits.rotation_radps),
    }
}

/// What is shown of the robot and no message says.
pub(crate) fn translated(robot: &Robot) -> RobotScene {
    let beacon = |beacon: &settings::robot::Beacon| ros::Beacon { id: beacon.id.into(), x: beacon.x, y: beacon.y };
    RobotScene {
        name: robot.general.name.clone(),
        outline: corners(&robot.geometry),
        beacons: robot.beacons.iter().map(beacon).collect(),
        sonar: Sensor::srf08(robot.sensors.srf08.beam_rad),
        infrared: Sensor::GP2Y0A41,
    }
}

/// Corners of the outline; of a rectangle from the one at the front left on.
pub(crate) fn corners(geometry: &Geometry) -> Vec<[f64; 2]> {
    let (rear, front) = (-geometry.rear_m(), geometry.front_m());
    let half = geometry.width_m() / 2.0;
    match geometry.footprint() {
        Some(shape) => shape.corners().iter().map(|corner| [corner.x, corner.y]).collect(),
        None => vec![[front, half], [rear, half], [rear, -half], [front, -half]],
    }
}

fn temperature_limits(robot: &Robot) -> Vec<TemperatureLimit> {
    let limit = |name: &String, celsius: f64| TemperatureLimit { name: name.clone(), celsius };
    let chips = robot.i2c.iter().flat_map(|bus| &bus.driver.chips).flat_map(|chip| &chip.temperatures);
    let chips = chips.map(|temperature| limit(&temperature.name, temperature.limit_c.into()));
    let named = robot.w1.iter().flat_map(|w1| &w1.driver.sensors);
    let named = named.filter_map(|sensor| Some(limit(&sensor.name, sensor.limit_c?)));
    let host = robot.host.iter().flat_map(|host| &host.driver.sensors);
    let host = host.filter_map(|sensor| Some(limit(&sensor.name, sensor.limit_c?)));
    chips.chain(named).chain(host).collect()
}

fn drives(robot: &Robot, bus: &CanBus) -> impl Iterator<Item = Drive> {
    let drive = |node: &Node| Drive { name: node.axis.name(), node: robot.node_number(bus, node.id) };
    // Others have no objects.
    bus.driver.nodes.iter().filter(|node| node.is_canopen()).map(drive)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use std::path::Path;

    fn robot(name: &str) -> Robot {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf").join(name);
        Config::load(&folder, true, &[]).unwrap().robot
    }

    #[test]
    fn the_drives_with_objects_are_those_of_canopen() {
        let names = |name| of(&robot(name), None, None).drives.iter().map(|drive| drive.name).collect::<Vec<_>>();
        assert_eq!(names("advee"), ["propulsion", "steering"]);
        assert!(names("rover").is_empty(), "ODrives");
    }

    #[test]
    fn a_hand_is_offered_no_more_than_the_robot_drives() {
        let speed = |name| rounded(hand_limits(&robot(name)).speed);
        // The limit by hand, the distance of PAUSE without commands, and a robot that senses nothing.
        assert_eq!(["advee", "courier", "rover"].map(speed), [0.6, 0.424, 0.3]);
    }
}
