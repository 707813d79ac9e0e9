//! Hashes of the types that the robot announces on ROS 2, beside those of unmodified ROS 2 (rclpy on Fast DDS).

use crate::ros2_peers::{Peer, courier, domain, number};
use crate::ros2_record::sense;
use crate::support::{self, workspace};
use serde_json::json;
use std::path::PathBuf;
use std::process::Command;

fn python() -> Option<PathBuf> {
    let needed = ["rclpy", "advee_msgs", "bond", "nav2_msgs", "std_srvs", "tf2_msgs", "visualization_msgs"];
    testing::peer_or_skip(testing::python(&needed))
}

/// Topics whose types are compared at least, as DDS names them.
const TOPICS: [&str; 32] = [
    "ros_discovery_info",
    "rq/courier/change_stateRequest",
    "rq/courier/get_parametersRequest",
    "rq/courier/pauseRequest",
    "rq/navigate_through_poses/_action/send_goalRequest",
    "rq/navigate_to_pose/_action/cancel_goalRequest",
    "rr/courier/pauseReply",
    "rr/navigate_to_pose/_action/get_resultReply",
    "rt/advee/guard",
    "rt/advee/holds",
    "rt/advee/processes",
    "rt/advee/state",
    "rt/amcl_pose",
    "rt/battery_state",
    "rt/bond",
    "rt/clock",
    "rt/cmd_vel",
    "rt/courier/transition_event",
    "rt/diagnostics",
    "rt/goal_pose",
    "rt/imu",
    "rt/joint_states",
    "rt/map",
    "rt/navigate_to_pose/_action/feedback",
    "rt/navigate_to_pose/_action/status",
    "rt/odom",
    "rt/range/sonar_1",
    "rt/rosout",
    "rt/scan",
    "rt/scene",
    "rt/temperature_case",
    "rt/tf_static",
];

#[test]
fn all_that_the_robot_announces_has_the_hash_that_ros_has_for_the_type() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true", "--set", "ros2.managed=true"]);
        let domain = domain.to_string();
        let peer = Peer::start(&python, "ros2_hashes.py", &[&[&*domain][..], &TOPICS[..]].concat());
        let mut n = 0;
        let seen = peer.finish(&mut robot, |robot| {
            n += 1;
            sense(robot, n);
        });
        assert_eq!(seen["differ"], json!({}), "{seen}");
        assert!(number(&seen["types"]) > 55.0, "{seen}");
    });
}

#[test]
fn the_table_of_hashes_is_what_rosidl_makes_of_the_types() {
    let Some(python) = python() else { return };
    let checked = Command::new(python).arg(workspace().join("tools/ros2-hashes")).arg("--check").output();
    let checked = checked.expect("python is there");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}
