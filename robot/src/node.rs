//! What ROS 2 is told of a robot besides what is said on its bus.

use crate::config::{Lidar, Robot};
use crate::map_file;
use crate::place::RobotLocation;
use crate::scene;
use logger::ros::{Pose, lidar_frame};
use ros2::description::{Description, Steering, Wheel};
use ros2::outgoing::{self, OdometrySource};
use settings::robot::{DrivenAxle, Geometry};
use simulator::world::World;

/// Parameters of the module `ros2`.
pub(crate) fn settings(place: &RobotLocation, robot: &Robot, world: Option<&World>) -> ros2::Settings {
    // As the estimator: by encoders beside the drives where there are any.
    let driven = robot.base.is_some() || robot.geometry.driven == DrivenAxle::Front;
    // A map that cannot be read is the planner's to tell.
    let map = match &robot.planner.map {
        Some(file) => map_file::load(&place.config.join(file)).ok(),
        None => world.and_then(|world| map_file::of_world(world).ok()),
    };
    let now = host::clock::epoch().timestamp(host::clock::now());
    ros2::Settings {
        robot: robot.general.name.clone(),
        lcm_url: place.lcm_url.clone(),
        ros2: robot.ros2.clone(),
        outgoing: outgoing::Config {
            scene: scene::translated(robot),
            odometry: if driven { OdometrySource::Drives } else { OdometrySource::Wheels },
            lidars: robot.lidar.len(),
            simulated: place.sim,
            description: description(robot),
        },
        map: map.map(|map| outgoing::map(&map, now)),
        driver_ttl: robot.limits.command_ttl,
    }
}

/// What the robot looks like.
fn description(robot: &Robot) -> Description {
    let geometry = &robot.geometry;
    let lidar = |lidar: &Lidar| {
        let keys = &lidar.driver;
        (lidar_frame(&lidar.name), Pose { x: keys.x, y: keys.y, theta: keys.theta })
    };
    Description {
        name: robot.general.name.clone(),
        body: [-geometry.rear_overhang_m, geometry.front_m(), geometry.width_m / 2.0],
        wheel_radius: geometry.wheel_radius_m,
        wheels: wheels(robot),
        sensors: robot.lidar.iter().map(lidar).collect(),
    }
}

fn wheels(robot: &Robot) -> Vec<Wheel> {
    let Geometry { wheelbase_m, track_m, driven, .. } = robot.geometry;
    if let Some(base) = robot.base {
        // What is no base is refused by its driver.
        let Ok(chassis) = base.chassis(&robot.limits) else { return Vec::new() };
        let wheels = chassis.wheels().iter().zip(base.axes());
        return wheels
            .map(|(wheel, axis)| Wheel {
                name: if axis.starts_with("wheel") { (*axis).into() } else { format!("{axis}_wheel") },
                place: Pose { x: wheel.x_m, y: wheel.y_m, theta: wheel.direction_rad },
                axis: Some((*axis).into()),
                steering: None,
            })
            .collect();
    }
    let wheel = |name: &str, x: f64, y: f64, driven: bool, steered: bool| Wheel {
        name: format!("{name}_wheel"),
        place: Pose { x, y, theta: 0.0 },
        axis: driven.then(|| "propulsion".into()),
        steering: steered.then(|| Steering { axis: "steering".into(), wheelbase: wheelbase_m }),
    };
    let half = track_m / 2.0;
    let by_front = driven == DrivenAxle::Front;
    let mut wheels: Vec<Wheel> =
        [("rear_left", half), ("rear_right", -half)].map(|(name, y)| wheel(name, 0.0, y, !by_front, false)).into();
    if by_front {
        wheels.push(wheel("front", wheelbase_m, 0.0, true, true));
    } else {
        wheels.extend(
            [("front_left", half), ("front_right", -half)].map(|(name, y)| wheel(name, wheelbase_m, y, false, true)),
        );
    }
    wheels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use std::path::Path;

    #[test]
    fn every_shipped_robot_has_its_wheels_and_lidars_where_they_are() {
        let shipped = [("advee", 4), ("courier", 2), ("rover", 2), ("porter", 4), ("tripod", 3), ("tug", 3)];
        for (name, count) in shipped {
            let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf").join(name);
            let robot = Config::load(&config, true, &[]).unwrap().robot;
            let description = description(&robot);
            assert_eq!(description.wheels.len(), count, "{name}");
            let [rear, front, half_width] = description.body;
            for Wheel { place, .. } in &description.wheels {
                assert!((rear..=front).contains(&place.x) && place.y.abs() <= half_width, "{name}: {place:?}");
            }
            assert_eq!(description.sensors.len(), robot.lidar.len());
            assert!(description.wheels.iter().any(|wheel| wheel.axis.is_some()), "{name}");
        }
    }
}
