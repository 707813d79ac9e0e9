//! The life cycle of the robot's node beside a lifecycle node of unmodified ROS 2 (rclpy on Fast DDS), and its
//! heartbeat as Cyclone DDS reads it.

use crate::ros2_peers::{Peer, courier, domain, number};
use crate::support;
use serde_json::json;

#[test]
fn a_lifecycle_manager_governs_the_node_as_it_governs_one_of_rclpy() {
    let needed = ["rclpy", "lifecycle_msgs", "cyclonedds"];
    let Some(python) = testing::peer_or_skip(testing::python(&needed)) else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true", "--set", "ros2.managed=true"]);
        let peer = Peer::start(&python, "ros2_lifecycle.py", &[&domain.to_string()]);
        let bond = Peer::start(&python, "ros2_cyclone_bond.py", &[&domain.to_string()]);
        let mut fastest = 0.0_f64;
        let seen = peer.finish(&mut robot, |robot| fastest = fastest.max(robot.view.speed().abs()));
        let states = ["unconfigured", "inactive", "active", "inactive", "unconfigured", "finalized"];
        assert_eq!((&seen["states"], &seen["differences"]), (&json!(states), &json!([])), "{seen}");
        assert_eq!(seen["impossible"], json!(vec![[false, false]; 6]), "{seen}");
        assert_eq!((&seen["possible"], &seen["events"]), (&json!(vec![[true, true]; 5]), &json!([])), "{seen}");
        // It moves while it is active, and then only.
        assert!(number(&seen["before"]) < 0.01 && fastest > 0.1 && number(&seen["after"]) < 0.01, "{seen} {fastest}");
        let bond = bond.finish(&mut robot, |_| ());
        assert_eq!((&bond["bonds"], &bond["instances"], &bond["broken"]), (&json!(["courier"]), &json!(1), &json!(1)));
        let gaps = bond["gaps"].as_array().expect("a list");
        assert!(!gaps.is_empty() && gaps.iter().all(|gap| number(gap) > 0.249) && bond["period"] == 0.25, "{bond}");
    });
}
