//! The examples of ROS 2 in `examples/ros2`, which drive the courier around a rectangle in the hall.

use crate::ros2_peers::{Peer, courier_in, domain};
use crate::support;

/// Drives around a rectangle of 1.5 m by 0.8 m, whose corners are cut off.
fn goes_around(script: &str, packages: &[&str]) {
    let Some(python) = testing::peer_or_skip(testing::python(packages)) else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier_in("hall", domain, &["--set", "ros2.commands=true"]);
        let start = robot.view.truth.clone().expect("it is simulated");
        let (mut last, mut way, mut farthest) = (start.clone(), 0.0, 0.0_f64);
        let example = Peer::example(&python, script, domain, &["1.5", "0.8"]);
        let said = example.end(&mut robot, |robot| {
            let Some(now) = robot.view.truth.clone() else { return };
            way += (now.x - last.x).hypot(now.y - last.y);
            farthest = farthest.max((now.x - start.x).hypot(now.y - start.y));
            last = now;
        });
        robot.until("the robot stands", 5.0, |view| view.speed().abs() < 0.01);
        let end = robot.view.truth.clone().expect("it is simulated");
        let off = (end.x - start.x).hypot(end.y - start.y);
        println!("{said}by the truth {way:.2} m, {farthest:.2} m away at most, {off:.2} m from the start at the end");
        assert!(way > 3.0 && farthest > 1.2 && off < 0.5, "{way} {farthest} {off} {said}");
        assert_eq!(end.collisions, start.collisions, "{said}");
        assert!(said.contains("around: "), "{said}");
    });
}

#[test]
fn a_node_as_in_the_tutorials_of_ros_goes_around() {
    goes_around("around.py", &["rclpy", "geometry_msgs", "nav_msgs", "sensor_msgs"]);
}

#[test]
fn a_program_on_cyclone_dds_alone_goes_around() {
    goes_around("around_cyclone.py", &["cyclonedds"]);
}
