//! The robot's actions, services and parameters, with clients of unmodified ROS 2 (rclpy on Fast DDS).

use crate::ros2_peers::{Peer, courier, domain, number};
use crate::support::{self, Robot};
use serde_json::{Value as Json, json};
use std::path::PathBuf;

fn python() -> Option<PathBuf> {
    let needed = ["rclpy", "nav_msgs", "std_srvs", "nav2_msgs"];
    testing::peer_or_skip(testing::python(&needed))
}

/// Goals of the test with many.
const MANY: usize = 100;

/// Starts a part of the peer's program, with two places: 0.4 m and 1.5 m ahead of the robot.
fn start(python: &std::path::Path, part: &str, domain: u32, robot: &Robot) -> Peer {
    let at = robot.view.truth.as_ref().expect("it is simulated");
    let ahead = |way: f64| [at.x + way * at.theta.cos(), at.y + way * at.theta.sin()];
    let ([x, y], [far_x, far_y]) = (ahead(0.4), ahead(1.5));
    let numbers = [x, y, at.theta, far_x, far_y].map(|number| number.to_string());
    let domain = domain.to_string();
    let count = MANY.to_string();
    let args = [part, &domain, &numbers[0], &numbers[1], &numbers[2], &numbers[3], &numbers[4], &count];
    Peer::start(python, "ros2_actions.py", &args)
}

#[test]
fn goals_are_rejected_and_nothing_moves_without_leave() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &[]);
        let mut fastest = 0.0_f64;
        let seen = start(&python, "refused", domain, &robot)
            .finish(&mut robot, |robot| fastest = fastest.max(robot.view.speed().abs()));
        assert_eq!((&seen["accepted"], &seen["operator"]), (&json!([false, false]), &json!([])), "{seen}");
        assert!(number(&seen["speed"]) < 0.01 && fastest < 0.01, "{seen} {fastest}");
        assert!(!robot.view.seen.contains_key("ML_CMD_GOAL"));
    });
}

#[test]
fn goals_are_driven_to_replaced_and_cancelled_with_feedback_and_results() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true"]);
        let from = robot.view.truth.clone().expect("it is simulated");
        let seen = start(&python, "navigate", domain, &robot).finish(&mut robot, |_| ());
        assert_eq!((&seen["frame"], &seen["tree"]), (&json!(false), &json!(false)), "{seen}");
        let feedback = |n: usize| number(&seen["feedback"][n]);
        assert_eq!((&seen["feedback"][0], &seen["feedback"][5]), (&json!("map"), &json!(0)), "{seen}");
        assert!((feedback(1) - from.x).hypot(feedback(2) - from.y) < 1.5, "{seen}");
        assert!((0.05..60.0).contains(&feedback(3)) && (0.5..3.0).contains(&feedback(4)), "{seen}");
        let replaced = json!(["ABORTED", 9000, "it was replaced by a newer goal"]);
        let (reached, cancelled) = (json!(["SUCCEEDED", 0, ""]), json!(["CANCELED", 0, ""]));
        let expected = [
            ("replaced", replaced),
            ("cancel", json!([0, 1])),
            ("cancelled", cancelled),
            ("again", json!(true)),
            ("reached", reached.clone()),
            ("later", reached.clone()),
            ("through", reached),
            ("waypoints", json!([1, 1])),
        ];
        for (name, expected) in expected {
            assert_eq!(seen[name], expected, "{name}: {seen}");
        }
        let left: Vec<u64> = seen["left"].as_array().into_iter().flatten().filter_map(Json::as_u64).collect();
        assert_eq!(left, [1, 2], "{seen}");
        // The last goal was the place 0.4 m ahead of the start.
        let to = robot.view.truth.clone().expect("it is simulated");
        let way = (to.x - from.x).hypot(to.y - from.y);
        assert!((0.0..1.0).contains(&way), "{seen} {way}");
        println!("{seen}");
    });
}

#[test]
fn of_many_goals_none_is_lost_and_none_is_doubled() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true"]);
        let seen = start(&python, "many", domain, &robot).finish(&mut robot, |_| ());
        println!("{seen}");
        let count = |name: &str| seen[name].as_u64().unwrap_or_default() as usize;
        let outcome = |name: &str| seen["outcomes"][name].as_u64().unwrap_or_default() as usize;
        assert_eq!(count("accepted"), MANY, "{seen}");
        assert!(count("feedback") > MANY / 20, "{seen}");
        assert_eq!(outcome("ABORTED") + outcome("CANCELED") + outcome("SUCCEEDED"), MANY, "{seen}");
        // A goal may be reached before it is replaced or cancelled.
        let cancels = count("cancels");
        assert!(outcome("CANCELED") <= cancels && outcome("ABORTED") > MANY / 3 && cancels > MANY / 4, "{seen}");
        let commands = robot.view.seen.get("ML_CMD_GOAL").copied().unwrap_or_default() as usize;
        assert_eq!(commands, MANY + cancels, "each once: {seen}");
    });
}

#[test]
fn parameters_are_read_and_operators_pause_and_release_by_services() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &["--set", "ros2.commands=true"]);
        let seen = start(&python, "operate", domain, &robot).finish(&mut robot, |_| ());
        let names: Vec<&str> = seen["parameters"].as_array().into_iter().flatten().filter_map(Json::as_str).collect();
        for name in ["use_sim_time", "robot", "footprint", "limits.speed_mps"] {
            assert!(names.contains(&name), "{seen}");
        }
        assert_eq!(seen["values"], json!(["courier", 0.8, false, 0]), "{seen}");
        assert_eq!(seen["types"], json!([4, 3, 1, 0]), "{seen}");
        assert_eq!(seen["read_only"], json!([true, true, true, false]), "{seen}");
        let reason = "read only: the settings of the robot are in robot.toml";
        assert_eq!(seen["set"], json!([[false, reason]]), "{seen}");
        assert_eq!(seen["set_atomically"], json!(false), "{seen}");
        assert_eq!(seen["pause"], json!([true, "driver_canbus is commanded into PAUSE: the robot stops"]), "{seen}");
        assert!(number(&seen["moved_in_pause"]) < 0.01, "{seen}");
        assert_eq!((&seen["resume"], &seen["release"][0]), (&json!(true), &json!(true)), "{seen}");
        assert_eq!(seen["reached"], json!(["SUCCEEDED", 0, ""]), "{seen}");
    });
}

#[test]
fn a_client_of_cyclone_gets_its_answer_by_the_header_in_the_content() {
    let Some(python) = testing::peer_or_skip(testing::python(&["cyclonedds"])) else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &[]);
        let peer = Peer::start(&python, "ros2_cyclone_service.py", &[&domain.to_string()]);
        let seen = peer.finish(&mut robot, |_| ());
        assert_eq!(seen["answers"], json!([[77, 1], [77, 2], [77, 3]]), "{seen}");
        assert_eq!(seen["names"], json!(["limits.speed_mps"]), "{seen}");
    });
}
