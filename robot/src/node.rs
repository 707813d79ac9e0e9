//! What ROS 2 is told of a robot besides what is said on its bus.

use crate::config::{Lidar, Robot};
use crate::map_file;
use crate::place::RobotLocation;
use crate::scene;
use logger::ros::{Pose, lidar_frame};
use ros2::description::{Description, Steering, Wheel};
use ros2::operator;
use ros2::outgoing::{self, OdometrySource};
use ros2::parameters::{Parameter, Value};
use ros2::topics::Devices;
use settings::robot::{DrivenAxle, End, Geometry, Steered};
use simulator::world::World;

/// Parameters of the module `ros2`.
pub(crate) fn settings(place: &RobotLocation, robot: &Robot, world: Option<&World>) -> ros2::Settings {
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
            // As the estimator: by encoders beside the drives where there are any.
            odometry: if robot.is_measured_by_drives() { OdometrySource::Drives } else { OdometrySource::Wheels },
            devices: devices(robot),
            simulated: place.sim,
            description: description(robot),
        },
        map: map.map(|map| outgoing::map(&map, now)),
        operator: operator(robot),
        parameters: parameters(place, robot),
        driver_ttl: robot.limits.command_ttl,
    }
}

/// How many of each there are.
fn devices(robot: &Robot) -> Devices {
    let batteries = robot.io.as_ref().map_or(0, |io| io.battery.len());
    Devices {
        lidars: robot.lidar.len(),
        imus: robot.imu.len(),
        batteries: batteries + usize::from(robot.power.is_some()),
    }
}

/// What operators may command of ROS.
fn operator(robot: &Robot) -> operator::Config {
    let io = robot.io.as_ref();
    let modbus = io.iter().flat_map(|io| &io.modbus).flat_map(|bus| &bus.driver.signals);
    let modbus = modbus.filter(|signal| signal.output).map(|signal| signal.name.clone());
    let serial = io.iter().flat_map(|io| &io.serial).flat_map(|line| line.driver.signals());
    let serial = serial.filter(|signal| signal.output).map(|signal| signal.name.clone());
    let gpio = io.iter().flat_map(|io| &io.gpio).filter(|line| line.output).map(|line| line.name.clone());
    let w1 = io.iter().flat_map(|io| &io.w1).filter(|keys| keys.output).map(|keys| keys.name.clone());
    let power = io.iter().flat_map(|io| &io.power).map(|keys| keys.name.clone());
    operator::Config {
        steering: robot.base.is_none(),
        power: robot.power.is_some(),
        outputs: modbus.chain(serial).chain(gpio).chain(w1).chain(power).collect(),
    }
}

/// Settings that programs of ROS ask for.
fn parameters(place: &RobotLocation, robot: &Robot) -> Vec<Parameter> {
    let parameter =
        |name: &str, value, description: &str| Parameter { name: name.into(), value, description: description.into() };
    let (limits, geometry) = (&robot.limits, &robot.geometry);
    let corners = scene::corners(geometry).concat();
    let mut all = vec![
        parameter("use_sim_time", Value::Bool(false), "Stamps are the time of the robot's clock, also in simulation."),
        parameter("robot", Value::Text(robot.general.name.clone()), "Name of the robot."),
        parameter("simulated", Value::Bool(place.sim), "True in simulation."),
        parameter("commands", Value::Bool(robot.ros2.commands), "True if ROS may command the robot."),
        parameter("footprint", Value::Doubles(corners), "Corners of the outline in base_link: x, y, ...; m."),
    ];
    let doubles = [
        ("limits.speed_mps", limits.speed_mps, "Greatest speed of a command, m/s."),
        ("limits.speed_manual_mps", limits.speed_manual_mps, "Greatest speed under /cmd_vel, m/s."),
        ("limits.speed_autonomous_mps", limits.speed_autonomous_mps, "Greatest speed under the planner, m/s."),
        ("limits.rotation_radps", limits.rotation_radps, "Greatest rotation of a base without steering, rad/s."),
        ("limits.steering_rad", limits.steering_rad, "Greatest angle of the steered wheel of a base that steers, rad."),
        ("limits.acceleration_mps2", limits.acceleration_mps2, "Greatest acceleration, m/s^2."),
        ("limits.deceleration_mps2", limits.deceleration_mps2, "Deceleration of a commanded stop, m/s^2."),
        ("geometry.wheelbase_m", geometry.wheelbase_m, "Fixed to steered axle, m."),
        ("geometry.track_m", geometry.track_m, "Distance of the front wheels, m."),
        ("geometry.wheel_radius_m", geometry.wheel_radius_m, "Radius of the wheels, m."),
        ("geometry.length_m", geometry.length_m(), "Bumper to bumper, m."),
        ("geometry.width_m", geometry.width_m(), "Width, m."),
        ("command_ttl_s", robot.ros2.command_ttl.as_secs_f64(), "Silence of /cmd_vel after which the robot stops, s."),
    ];
    all.extend(doubles.map(|(name, value, text)| parameter(name, Value::Double(value), text)));
    all
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
        body: [-geometry.rear_m(), geometry.front_m(), geometry.width_m() / 2.0],
        wheel_radius: geometry.wheel_radius_m,
        wheels: wheels(robot),
        sensors: robot.lidar.iter().map(lidar).collect(),
    }
}

fn wheels(robot: &Robot) -> Vec<Wheel> {
    let Geometry { wheelbase_m, track_m, driven, steered, .. } = robot.geometry;
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
        steering: steered.then(|| Steering { axis: "steering".into(), x }),
    };
    let Steered { one_steered, one_fixed, end, driven_left_m } = steered;
    let drives_steered = driven == DrivenAxle::Steered;
    let (x, ends) = match end {
        End::Front => (wheelbase_m, ["rear", "front"]),
        End::Rear => (-wheelbase_m, ["front", "rear"]),
    };
    let places = |end: &str, one: bool| {
        let both = || ["left", "right"].map(|side| format!("{end}_{side}"));
        let places = |[left, right]: [String; 2]| vec![(left, track_m / 2.0), (right, -track_m / 2.0)];
        if one { vec![(end.to_owned(), 0.0)] } else { places(both()) }
    };
    let [fixed, steered] = [places(ends[0], one_fixed), places(ends[1], one_steered || drives_steered)];
    // One beside the middle is one of both, or a further one.
    let beside = driven_left_m != 0.0;
    let is_driven = |y: f64| !drives_steered && (!beside || (y - driven_left_m).abs() < 1e-3);
    let further = beside && !fixed.iter().any(|(_, y)| is_driven(*y));
    let further = further.then(|| wheel("driven", 0.0, driven_left_m, true, false));
    let fixed = fixed.iter().map(|(name, y)| wheel(name, 0.0, *y, is_driven(*y), false));
    let steered = steered.iter().map(|(name, y)| wheel(name, x, *y, drives_steered, true));
    fixed.chain(further).chain(steered).collect()
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

    #[test]
    fn wheels_of_a_base_that_steers_are_where_it_has_them() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee");
        let wheels = |sets: &[&str]| {
            // The steered wheel is behind the axle, and within the outline.
            let sets = sets.iter().chain(&["geometry.rear_overhang_m=0.75"]);
            let sets: Vec<String> = sets.map(|set| (*set).to_owned()).collect();
            let robot = Config::load(&config, true, &sets).unwrap().robot;
            let wheel = |wheel: Wheel| {
                let steered = wheel.steering.map(|steering| steering.x);
                (wheel.name, wheel.place.x, wheel.place.y, wheel.axis.is_some(), steered)
            };
            super::wheels(&robot).into_iter().map(wheel).collect::<Vec<_>>()
        };
        let of = |name: &str, x, y, driven, steered| (format!("{name}_wheel"), x, y, driven, steered);
        let left = ["base.kind=\"tricycle\"", "base.steered=\"rear\"", "base.driven_left_m=0.25"];
        let fixed = [of("front_left", 0.0, 0.25, true, None), of("front_right", 0.0, -0.25, false, None)];
        let steered = of("rear", -0.6, 0.0, false, Some(-0.6));
        assert_eq!(wheels(&left), [fixed[0].clone(), fixed[1].clone(), steered.clone()]);
        let inside = ["base.kind=\"tricycle\"", "base.steered=\"rear\"", "base.driven_left_m=0.1"];
        let found = wheels(&inside);
        assert_eq!(found[2..], [of("driven", 0.0, 0.1, true, None), steered]);
        assert!(!found[0].3 && !found[1].3, "{found:?}");
    }
}
