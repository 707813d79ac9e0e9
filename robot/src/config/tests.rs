//! What is wrong in a configuration, and the line that says so.

use super::*;
use base::gpio::LineId;
use drivers::canbus;
use drivers::joydev::{Commands, Gear};
use drivers::rs485_bus::Crc;
use host::ports::settings::CanInterface;
use host::ports::{Direction, GamepadPlace, Transport};
use std::path::PathBuf;

/// The shipped folder, which every checkout has.
fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee")
}

const MODULES: &str = "[[modules]]\nname = \"driver_canbus\"\n";

/// A small robot, one thing on each line that tests replace.
const ROBOT: &str = r#"[robot]
name = "small"
[geometry]
wheelbase_m = 0.6
track_m = 0.5
wheel_radius_m = 0.1
length_m = 0.9
width_m = 0.6
rear_overhang_m = 0.15
ticks_per_turn = 4096
[limits]
speed_mps = 1.2
speed_manual_mps = 0.6
speed_autonomous_mps = 0.8
lateral_acceleration_mps2 = 0.8
steering_rad = 0.61
acceleration_mps2 = 0.5
deceleration_mps2 = 0.8
quick_stop_mps2 = 1.5
steering_rate_radps = 0.7
[can.main]
interface = "can0"
nodes = [
    { id = 1, driver = "epos", axis = "propulsion", gear = 26 },
    { id = 2, driver = "icla", axis = "steering", gear = 180, switch_rad = 0, homing_speed_radps = 0.2 },
]
[rs485.a]
port = "/dev/ttyS1"
transport = "two-byte"
nodes = [
    { address = 0x10, driver = "sd1", rate_hz = 4 },
]
[[srfs]]
id = 0
board = 0x10
channel = 0
x = 0
y = 0.0
theta = 0.0
"#;

fn load(robot: &str, over: &str, sets: &[&str], modules: &str) -> Result<Config, Vec<String>> {
    let robot = Node::parse(Path::new("robot.toml"), robot)?;
    let over = Node::parse(Path::new("sim.toml"), over)?;
    let modules = Node::parse(Path::new("modules.toml"), modules)?;
    Config::merge(robot, Some(over), modules, sets).map_err(|ConfigError(lines)| lines)
}

/// The small robot with `from` replaced by `to` is refused with exactly these lines.
#[track_caller]
fn refused(from: &str, to: &str, lines: &[&str]) {
    assert!(ROBOT.contains(from), "{from}");
    let found = load(&ROBOT.replacen(from, to, 1), "", &[], MODULES).unwrap_err();
    assert_eq!(found, lines);
}

/// The drives of a base without steering in place of the small robot's.
fn based(base: &str, nodes: &[&str]) -> String {
    let (head, rest) = ROBOT.split_once("nodes = [\n").unwrap();
    let (_, rest) = rest.split_once("]\n").unwrap();
    // Its wheels are around the origin, and within the outline.
    let head = head.replace("rear_overhang_m = 0.15", "rear_overhang_m = 0.45");
    format!("{head}nodes = [{}]\n[base]\n{base}\n{rest}", nodes.join(", "))
}

#[test]
fn a_base_names_the_axes_of_its_drives() {
    let epos = |id: usize, axis: &str| format!("{{ id = {id}, driver = \"epos\", axis = \"{axis}\", gear = 26 }}");
    for (base, axes) in [
        ("kind = \"differential\"\ntrack_m = 0.42", &["left", "right"][..]),
        (
            "kind = \"mecanum\"\ntrack_m = 0.4\nwheelbase_m = 0.5",
            &["front_left", "front_right", "rear_left", "rear_right"],
        ),
        (
            "kind = \"skid-steer\"\ntrack_m = 0.6\nwheelbase_m = 0.5",
            &["front_left", "front_right", "rear_left", "rear_right"],
        ),
        (
            "kind = \"skid\"\ntrack_m = 0.6\nwheelbase_m = 0.5",
            &["front_left", "front_right", "rear_left", "rear_right"],
        ),
        ("kind = \"omni\"\nradius_m = 0.2", &["wheel_1", "wheel_2", "wheel_3"]),
        ("kind = \"omni\"\nradius_m = 0.2\nwheels = 4", &["wheel_1", "wheel_2", "wheel_3", "wheel_4"]),
    ] {
        let nodes: Vec<String> = axes.iter().enumerate().map(|(n, axis)| epos(n + 1, axis)).collect();
        let nodes: Vec<&str> = nodes.iter().map(String::as_str).collect();
        let robot = load(&based(base, &nodes), "", &[], MODULES).unwrap().robot;
        assert_eq!(robot.axes(), axes);
        assert!(robot.base.unwrap().chassis(&robot.limits).is_ok(), "{base}");
        let driver = robot.can[0].driver.driver("can.main".into(), robot.base, &robot.geometry, robot.limits).unwrap();
        assert_eq!((driver.wheels.len(), driver.steering.is_none()), (axes.len(), true));
        let missing = &nodes[1..];
        let robot = load(&based(base, missing), "", &[], MODULES).unwrap().robot;
        let without = robot.can[0].driver.driver("can.main".into(), robot.base, &robot.geometry, robot.limits);
        assert!(without.is_none(), "a wheel without a drive");
    }
    let wrong = based("kind = \"differential\"\ntrack_m = 0.42", &[&epos(1, "left"), &epos(2, "propulsion")]);
    let line = wrong.lines().position(|line| line.starts_with("nodes")).unwrap() + 1;
    let expected = format!(
        "robot.toml:{line}: can.main.nodes[1].axis = \"propulsion\": expected an axis of the base: left, right"
    );
    assert_eq!(load(&wrong, "", &[], MODULES).unwrap_err(), [expected]);
    let both = based("kind = \"differential\"\ntrack_m = 0.42", &[&epos(1, "left"), &epos(2, "left")]);
    assert_eq!(load(&both, "", &[], MODULES).unwrap_err().len(), 1, "two drives on one wheel");
}

/// The rectangle of the small robot.
const RECTANGLE: &str = "length_m = 0.9\nwidth_m = 0.6\nrear_overhang_m = 0.15\n";

#[test]
fn an_outline_is_a_polygon_or_a_rectangle() {
    // A notch at the front, which the hull fills.
    let corners = "[[0.75, 0.3], [0.6, 0], [0.75, -0.3], [-0.1, -0.3], [-0.25, 0], [-0.1, 0.25]]";
    let polygon = ROBOT.replace(RECTANGLE, &format!("footprint_m = {corners}\n"));
    let geometry = load(&polygon, "", &[], MODULES).unwrap().robot.geometry;
    assert_eq!(geometry.corners().len(), 5);
    assert!((geometry.footprint_m.unwrap().filled_m2 - 0.045).abs() < 1e-9, "{:?}", geometry.footprint_m);
    let measures = [geometry.length_m(), geometry.width_m(), geometry.rear_m(), geometry.front_m()];
    assert_eq!(measures, [1.0, 0.6, 0.25, 0.75]);
    assert_eq!(geometry.reach_m(), 0.75f64.hypot(0.3));
    let convex = polygon.replace("[0.6, 0]", "[0.8, 0]");
    let convex = load(&convex, "", &[], MODULES).unwrap().robot.geometry.footprint_m.unwrap();
    assert_eq!((convex.shape.corners().len(), convex.filled_m2), (6, 0.0));
    // As a polygon the rectangle is the same outline.
    let rectangle = load(ROBOT, "", &[], MODULES).unwrap().robot;
    let same = "footprint_m = [[-0.15, -0.3], [0.75, -0.3], [0.75, 0.3], [-0.15, 0.3]]\n";
    let same = load(&ROBOT.replace(RECTANGLE, same), "", &[], MODULES).unwrap().robot;
    assert_eq!(same.guard_config().footprint, rectangle.guard_config().footprint);
    assert_eq!(same.geometry.reach_m(), rectangle.geometry.reach_m());
    assert_eq!(same.footprint().corners.len(), 4);
    assert!(rectangle.footprint().corners.is_empty());
}

#[test]
fn an_outline_that_no_robot_has_is_refused() {
    let polygon = |corners: &str, why: &str| {
        refused(
            RECTANGLE,
            &format!("footprint_m = {corners}\n"),
            &[&format!("robot.toml:7: geometry.footprint_m{why}")],
        );
    };
    let number = "a list of 3 to 32 corners [x, y] within -10 to 10";
    polygon("[[1, 1], [-1, 0]]", &format!(" = [2 items]: expected {number}"));
    let many: Vec<String> = (0..33).map(|n| format!("[{n}, {}]", n * n)).collect();
    polygon(&format!("[{}]", many.join(", ")), &format!(" = [33 items]: expected {number}"));
    polygon("[[1, nan], [-1, 0], [0, 1]]", "[0] = [2 items]: expected two numbers from -10 to 10: x, y");
    polygon("[[11, 0], [-1, 0], [0, 1]]", "[0] = [2 items]: expected two numbers from -10 to 10: x, y");
    polygon(
        "[[1, 1], [-1, -1], [1, -1], [-1, 1]]",
        " = [4 items]: expected corners one after the other around the polygon: the edge from [0] meets the one from \
         [2]",
    );
    polygon(
        "[[0.1, 0.3], [0.9, 0.3], [0.9, -0.3], [0.1, -0.3]]",
        " = [4 items]: expected an outline with the reference point [0, 0] in it",
    );
    polygon(
        "[[0.7, 0.3], [0.7, -0.3], [-0.2, 0]]",
        " = [3 items]: expected an outline with the wheel at [0.000, 0.250] in it",
    );
    polygon(
        "[[0.8, 0], [0.2, -0.3], [-0.2, -0.3], [-0.2, 0.3], [0.2, 0.3]]",
        " = [5 items]: expected an outline with the wheel at [0.600, 0.250] in it",
    );
    let nothing = "expected nothing beside footprint_m, from which it follows";
    refused(
        RECTANGLE,
        &format!("{RECTANGLE}footprint_m = [[0.7, 0.3], [0.7, -0.3], [-0.2, -0.3], [-0.2, 0.3]]\n"),
        &[
            &format!("robot.toml:7: geometry.length_m = 0.9: {nothing}"),
            &format!("robot.toml:8: geometry.width_m = 0.6: {nothing}"),
            &format!("robot.toml:9: geometry.rear_overhang_m = 0.15: {nothing}"),
        ],
    );
    refused("width_m = 0.6\n", "", &["robot.toml:3: geometry.width_m: missing, expected a number from 0.1 to 10"]);
    refused(
        "rear_overhang_m = 0.15",
        "rear_overhang_m = 4.35",
        &[
            "robot.toml:9: geometry.rear_overhang_m = 4.35: expected at most length_m, 0.9, so that the reference point is \
           in the outline",
        ],
    );
    refused(
        "rear_overhang_m = 0.15",
        "rear_overhang_m = 0.5",
        &["robot.toml:7: geometry.length_m = 0.9: expected at least 1.100 by rear_overhang_m: a wheel is at [0.600, \
           0.250]"],
    );
    refused(
        "track_m = 0.5",
        "track_m = 0.7",
        &["robot.toml:5: geometry.track_m = 0.7: expected at most the width of the outline, 0.6"],
    );
}

#[test]
fn wheels_of_a_base_are_within_the_outline() {
    let node = |id: usize, axis: &str| format!("{{ id = {id}, driver = \"epos\", axis = \"{axis}\", gear = 26 }}");
    let pair = [node(1, "left"), node(2, "right")];
    let differential = |track: f64| {
        let base = format!("kind = \"differential\"\ntrack_m = {track}");
        based(&base, &[&pair[0], &pair[1]])
    };
    let with = |text: String, from: &str, to: &str| load(&text.replacen(from, to, 1), "", &[], MODULES).map(|_| ());
    let wide = with(differential(0.42), "track_m = 0.5", "track_m = 4.9");
    assert_eq!(
        wide,
        Err(vec!["robot.toml:5: geometry.track_m = 4.9: expected at most the width of the outline, 0.6".to_owned()])
    );
    // The effective track of two rows of wheels may be more than the width, but not anything.
    assert_eq!(with(differential(1.1), "", ""), Ok(()));
    let odd = with(differential(1.5), "", "").unwrap_err();
    assert_eq!(odd, ["robot.toml:8: geometry.width_m = 0.6: expected at least 0.750: a wheel is at [0.000, 0.375]"]);
    let nose = "footprint_m = [[0.6, 0], [-0.2, 0.3], [-0.2, -0.3]]\n";
    let rectangle = RECTANGLE.replace("0.15", "0.45");
    let outside = with(differential(0.5), &rectangle, nose).unwrap_err();
    let expected = "an outline with the wheel at [0.000, 0.250] in it";
    assert_eq!(outside, [format!("robot.toml:7: geometry.footprint_m = [3 items]: expected {expected}")]);
    let mecanum = "kind = \"mecanum\"\ntrack_m = 0.4\nwheelbase_m = 0.5";
    let four = ["front_left", "front_right", "rear_left", "rear_right"];
    let four: Vec<String> = four.iter().enumerate().map(|(n, axis)| node(n + 1, axis)).collect();
    let mecanum = based(mecanum, &four.iter().map(String::as_str).collect::<Vec<_>>());
    let behind = with(mecanum, "rear_overhang_m = 0.45", "rear_overhang_m = 0.15").unwrap_err();
    assert_eq!(behind.len(), 1);
    let why = "robot.toml:9: geometry.rear_overhang_m = 0.15: expected at least 0.250: a wheel is at [-0.250, ";
    assert!(behind[0].starts_with(why), "{behind:?}");
}

#[test]
fn a_base_that_steers_has_a_kind_an_end_and_a_driven_wheel() {
    use settings::robot::{End, Traction};
    let with = |base: &str| {
        let robot = ROBOT.replacen("[limits]", &format!("[base]\n{base}\n[limits]"), 1);
        // Wheels behind the axle are within the outline, too.
        let overhang = if base.contains("\"rear\"") { "rear_overhang_m = 0.75" } else { "rear_overhang_m = 0.15" };
        let robot = robot.replacen("rear_overhang_m = 0.15", overhang, 1);
        load(&robot, "", &[], MODULES).map(|config| config.robot)
    };
    let of = |base: &str| {
        let robot = with(base).unwrap();
        assert_eq!((robot.base, robot.axes()), (None, &["propulsion", "steering"][..]), "{base}");
        let steered = robot.geometry.steered;
        (steered.end, steered.one_fixed, steered.one_steered, robot.geometry.traction())
    };
    let axle = Traction::Fixed { left: 0.0 };
    assert_eq!(with("kind = \"ackermann\"").unwrap().geometry, load(ROBOT, "", &[], MODULES).unwrap().robot.geometry);
    assert_eq!(of("kind = \"ackermann\"\nsteered = \"rear\""), (End::Rear, false, false, axle));
    assert_eq!(of("kind = \"tricycle\""), (End::Front, false, true, axle));
    let fork_lift = "kind = \"tricycle\"\nsteered = \"rear\"\ndriven = \"steered\"";
    assert_eq!(of(fork_lift), (End::Rear, false, true, Traction::Steered));
    let beside = of("kind = \"tricycle\"\ndriven_left_m = -0.3");
    assert_eq!(beside, (End::Front, false, true, Traction::Fixed { left: -0.5 }));
    assert_eq!(of("kind = \"bicycle\"\ndriven = \"fixed\""), (End::Front, true, true, axle));

    let refused = |base: &str, expected: &str| assert_eq!(with(base).unwrap_err(), [expected]);
    assert_eq!(
        with("kind = \"tricycle\"\ndriven_left_m = 0.7").unwrap_err(),
        [
            "robot.toml:8: geometry.width_m = 0.6: expected at least 1.400: a wheel is at [0.000, 0.700]",
            "robot.toml:13: base.driven_left_m = 0.7: expected at most 0.686 either way: in the narrowest curve by \
             limits.steering_rad the wheel would be at its centre, or turn the other way",
        ]
    );
    refused(
        "kind = \"tricycle\"\ndriven_left_m = 0.2\ndriven = \"steered\"",
        "robot.toml:13: base.driven_left_m = 0.2: expected nothing beside driven = \"steered\", a wheel in the middle",
    );
    let unknown = with("kind = \"tank\"\ntrack_m = 0.4").unwrap_err();
    let names = ["differential", "skid-steer", "skid", "mecanum", "omni", "tricycle", "ackermann", "bicycle"];
    assert!(unknown[0].starts_with("robot.toml:12: base.kind = \"tank\": expected "), "{unknown:?}");
    assert!(names.iter().all(|name| unknown[0].contains(&format!("{name:?}"))), "{unknown:?}");
    let twice = ROBOT.replacen("[limits]", "driven = \"front\"\n[base]\nkind = \"tricycle\"\n[limits]", 1);
    let expected = "robot.toml:11: geometry.driven = \"front\": expected nothing beside [base], whose own key is \
                    driven = \"fixed\" or \"steered\"";
    assert_eq!(load(&twice, "", &[], MODULES).unwrap_err(), [expected]);
}

const NO_SECOND_WAY: &str = "\n[stop]\nsecond_way = \"none\"\n";

#[test]
fn what_may_not_be_meant_is_remarked_and_good() {
    let remarks = |robot: &str| load(&format!("{robot}{NO_SECOND_WAY}"), "", &[], MODULES).unwrap().robot.remarks();
    assert!(remarks(ROBOT).is_empty());
    let no_power = "nothing cuts the motors' feed: stop.second_way is \"power\", and there is no table [power]";
    assert_eq!(load(ROBOT, "", &[], MODULES).unwrap().robot.remarks(), [no_power]);
    let gpio = "gpio = { chip = \"gpio-motors\", line = 17 }\n";
    let unused = "stop.gpio cuts nothing: stop.second_way is \"none\"";
    let found = load(&format!("{ROBOT}{NO_SECOND_WAY}{gpio}"), "", &[], MODULES).unwrap().robot.remarks();
    assert_eq!(found, [unused]);
    for (key, was) in [("speed_manual_mps", "0.6"), ("speed_autonomous_mps", "0.8")] {
        let robot = ROBOT.replacen(&format!("{key} = {was}"), &format!("{key} = 1.3"), 1);
        let expected = format!("limits.{key} = 1.3 is above limits.speed_mps = 1.2: more than that is refused");
        assert_eq!(remarks(&robot), [expected]);
    }
    let notched = "[[0.75, 0.3], [0.6, 0], [0.75, -0.3], [-0.1, -0.3], [-0.25, 0], [-0.1, 0.25]]";
    let found = remarks(&ROBOT.replacen(RECTANGLE, &format!("footprint_m = {notched}\n"), 1));
    assert!(matches!(&found[..], [hull] if hull.starts_with("geometry.footprint_m is not convex")), "{found:?}");
}

#[test]
fn a_homing_method_is_one_of_the_standard_or_of_the_maker_and_of_a_steering() {
    let expected = "1 to 14, 17 to 30, 33 to 35, 37 (CiA 402), or below 0 (the maker's)";
    let with = |method: &str| {
        let to = format!("switch_rad = 0, homing_method = {method},");
        load(&ROBOT.replacen("switch_rad = 0,", &to, 1), "", &[], MODULES).err().unwrap_or_default()
    };
    for method in ["99", "0", "15", "36"] {
        assert_eq!(
            with(method),
            [format!("robot.toml:25: can.main.nodes[1].homing_method = {method}: expected {expected}")]
        );
    }
    assert!(["-1", "27", "35", "37"].iter().all(|method| with(method).is_empty()));
    let wheel = ROBOT.replacen(
        "driver = \"epos\", axis = \"propulsion\", gear = 26",
        "driver = \"cia402\", axis = \"propulsion\", gear = 26, eds = \"wheel.eds\", homing_method = 27",
        1,
    );
    let found = load(&wheel, "", &[], MODULES).unwrap_err();
    assert_eq!(found, ["robot.toml:24: can.main.nodes[0].homing_method = 27: expected nothing: a wheel is not homed"]);
}

#[test]
fn a_homing_method_searches_where_the_switch_is() {
    let with = |switch: &str, method: &str, gear: &str| {
        let to = format!("switch_rad = {switch}, homing_method = {method},");
        let robot = ROBOT.replacen("switch_rad = 0,", &to, 1).replacen("gear = 180", &format!("gear = {gear}"), 1);
        load(&(robot + NO_SECOND_WAY), "", &[], MODULES).map(|config| config.robot.remarks())
    };
    for (switch, method, gear) in [
        ("-0.6283", "27", "180"),
        ("-0.6283", "23", "-180"),
        ("0.6283", "23", "180"),
        ("0.6283", "27", "-180"),
        ("-0.6283", "17", "180"),
        ("0.6283", "17", "-180"),
        ("0", "27", "-180"),
        ("0.6283", "35", "180"),
        ("0.6283", "-3", "180"),
    ] {
        assert_eq!(with(switch, method, gear).unwrap(), <[String; 0]>::default(), "{switch} {method} {gear}");
    }
    // A limit switch of the drive could turn the search back.
    let remark = "can.main.nodes[1].homing_method = 27 searches to the left by the sign of gear, and switch_rad = \
                  -0.6283 is on the right, where 23 searches";
    assert_eq!(with("-0.6283", "27", "-180").unwrap(), [remark]);
    let remark = "can.main.nodes[1].homing_method = 27 searches to the right by the sign of gear, and switch_rad = \
                  0.6 is on the left, where 23 searches";
    assert_eq!(with("0.6", "27", "180").unwrap(), [remark]);
    // Straight ahead is not beyond a limit switch.
    for (switch, method, gear, right) in [("-0.6", "17", "-180", "18"), ("-0.6", "2", "180", "1")] {
        let expected = format!("{right}, the limit switch on the side of switch_rad by the sign of gear");
        let found = format!("robot.toml:25: can.main.nodes[1].homing_method = {method}: expected {expected}");
        assert_eq!(with(switch, method, gear).unwrap_err(), [found]);
    }
}

#[test]
fn a_drive_by_its_sheet_has_a_mode_of_its_axis_and_a_wheel_may_have_a_brake() {
    let wheel = |more: &str| {
        let from = "driver = \"epos\", axis = \"propulsion\", gear = 26";
        let to = format!("driver = \"cia402\", axis = \"propulsion\", gear = 26, eds = \"wheel.eds\", {more}");
        load(&ROBOT.replacen(from, &to, 1), "", &[], MODULES).err().unwrap_or_default()
    };
    for mode in ["profile velocity", "cyclic synchronous velocity"] {
        assert_eq!(wheel(&format!("mode = \"{mode}\", brake = \"output\"")), <[String; 0]>::default());
    }
    let expected = "robot.toml:24: can.main.nodes[0].mode = \"profile position\": expected a mode of the velocity";
    assert_eq!(wheel("mode = \"profile position\""), [expected]);
    let steering = |more: &str| {
        let to = format!("driver = \"cia402\", eds = \"steering.eds\", {more}");
        load(&ROBOT.replacen("driver = \"icla\"", &to, 1), "", &[], MODULES).err().unwrap_or_default()
    };
    for mode in ["profile position", "cyclic synchronous position", "interpolated position"] {
        assert_eq!(steering(&format!("mode = \"{mode}\"")), <[String; 0]>::default());
    }
    let mode = "robot.toml:25: can.main.nodes[1].mode = \"profile velocity\": expected a mode of the position";
    assert_eq!(steering("mode = \"profile velocity\""), [mode]);
    let brake = "robot.toml:25: can.main.nodes[1].brake = \"output\": expected \"drive\": the output of a steering is \
                 not switched";
    assert_eq!(steering("brake = \"output\""), [brake]);
}

/// An ODrive of a wheel.
fn odrive(id: u8, axis: &str, more: &str) -> String {
    format!(
        "{{ id = {id}, driver = \"odrive\", axis = \"{axis}\", gear = 8, hardware = \"4.4.58\", firmware = \"0.6.10\", \
         enable_watchdog = 251, watchdog_timeout = 250{more} }}"
    )
}

#[test]
fn a_wheel_may_be_on_a_vesc() {
    let base = "kind = \"differential\"\ntrack_m = 0.42";
    let vesc = |id: u8, axis: &str, more: &str| {
        format!("{{ id = {id}, driver = \"vesc\", axis = \"{axis}\", gear = 8, pole_pairs = 7{more} }}")
    };
    let with = |left: &str| load(&based(base, &[left, &vesc(2, "right", "")]), "", &[], MODULES);
    let robot = with(&vesc(1, "left", "")).unwrap().robot;
    let driver = robot.can[0].driver.driver("can.main".into(), robot.base, &robot.geometry, robot.limits).unwrap();
    let devices: Vec<String> = driver.wheels.iter().map(|wheel| format!("{:?}", wheel.drive)).collect();
    assert!(devices[0].contains("host: 129") && devices[1].contains("host: 130"), "{devices:?}");
    // Its identifiers are none of CANopen, whatever its id.
    let epos = "{ id = 2, driver = \"epos\", axis = \"right\", gear = 26 }";
    for id in [1, 4, 16] {
        assert!(load(&based(base, &[&vesc(id, "left", ""), epos]), "", &[], MODULES).is_ok(), "{id}");
    }
    for (left, found) in [
        (vesc(1, "left", ", eds = \"a.eds\""), "eds = \"a.eds\": expected nothing: this drive is no CANopen node"),
        (vesc(1, "left", "").replace("gear = 8", "gear = 0"), "gear = 0: expected a number that is not 0"),
        (vesc(1, "left", "").replace("pole_pairs = 7", "pole_pairs = 0"), "pole_pairs = 0: expected an integer from 1"),
        (vesc(1, "steering", ""), "axis"),
        (vesc(1, "left", ", host_id = 2"), "host_id = 2: expected one by which no other VESC of the bus is answered"),
        (vesc(1, "left", ", host_id = 130"), "host_id = 130: expected one by which no other VESC"),
    ] {
        let why = with(&left).unwrap_err().join("\n");
        assert!(why.contains(found), "{left}: {why}");
    }
}

#[test]
fn the_guard_counts_on_no_brake_where_a_controller_rolls_without_commands() {
    let base = "kind = \"differential\"\ntrack_m = 0.42";
    let epos = |id: u8, axis: &str| format!("{{ id = {id}, driver = \"epos\", axis = \"{axis}\", gear = 26 }}");
    let brake = ["stop.pause=brake", "stop.brake_mps2=0.8", "stop.coasting_mps2=0.15"];
    for (left, expected) in [(epos(1, "left"), 0.8), (odrive(1, "left", ""), 0.15)] {
        let text = based(base, &[&left, &epos(2, "right")]);
        let robot = load(&text, "", &brake, MODULES).unwrap().robot;
        assert_eq!(robot.power_lost_mps2(), expected, "{left}");
    }
}

#[test]
fn a_wheel_may_be_on_an_odrive_and_share_the_bus_with_canopen() {
    let base = "kind = \"differential\"\ntrack_m = 0.42";
    let epos = "{ id = 2, driver = \"epos\", axis = \"right\", gear = 26 }";
    let with = |left: &str, right: &str| load(&based(base, &[left, right]), "", &[], MODULES);
    let left = odrive(1, "left", "");
    for right in [epos, &odrive(2, "right", "")] {
        let robot = with(&left, right).unwrap().robot;
        let driver = robot.can[0].driver.driver("can.main".into(), robot.base, &robot.geometry, robot.limits).unwrap();
        let Some(canbus::PropulsionDrive::Controller(own)) = driver.wheels.first().map(|wheel| &wheel.drive) else {
            panic!("{:?}", driver.wheels)
        };
        let device = format!("{:?}", own.device);
        assert!(device.starts_with("Odrive(") && device.contains("firmware: [0, 6, 10]"), "{device}");
        assert_eq!((driver.wheels[0].node, own.gear), (1, 8.0));
    }
    for (left, found) in [
        (odrive(64, "left", ""), "id = 64: expected an integer from 1 to 62: that of an ODrive"),
        (odrive(16, "left", ""), "id = 16: expected one whose 32 identifiers no CANopen node of the bus has"),
        (left.replace("0.6.10", "0.6"), "firmware = \"0.6\": expected three numbers with dots: \"0.6.10\""),
        (left.replace("gear = 8", "gear = 0"), "gear = 0: expected a number that is not 0"),
        (left.replace("251", "250"), "watchdog_timeout = 250: expected another endpoint than enable_watchdog"),
        (odrive(1, "left", ", eds = \"a.eds\""), "eds = \"a.eds\": expected nothing: this drive is no CANopen node"),
    ] {
        let wrong = with(&left, epos).unwrap_err();
        assert!(wrong.len() == 1 && wrong[0].ends_with(&format!(": can.main.nodes[0].{found}")), "{wrong:?}");
    }
}

/// A robot on two wheels without a CAN bus, with these tables.
fn on_lines(tables: &str) -> String {
    let begin = ROBOT.find("[can.main]").unwrap();
    let end = ROBOT.find("[rs485.a]").unwrap();
    let base = "[base]\nkind = \"differential\"\ntrack_m = 0.42\n";
    format!("{}{base}{tables}\n{}", &ROBOT[..begin], &ROBOT[end..])
}

/// A VESC on a UART.
fn uart(name: &str, axis: &str) -> String {
    format!(
        "[serial.{name}]\nport = \"/dev/tty-{name}\"\ndriver = \"vesc\"\naxis = \"{axis}\"\nid = 1\ngear = 8\n\
         pole_pairs = 7\n"
    )
}

/// A RoboClaw on a line.
fn roboclaw(m1: &str, m2: &str) -> String {
    let motor = |axis: &str| format!("{{ axis = \"{axis}\", gear = 8, counts_per_turn = 4096 }}");
    format!(
        "[serial.wheels]\nport = \"/dev/ttyACM0\"\ndriver = \"roboclaw\"\nmodel = \"RoboClaw 2x15a v4.1.34\"\n\
         m1 = {}\nm2 = {}\n",
        motor(m1),
        motor(m2)
    )
}

/// The small robot with its steering on a bus of its own, of which it is node 1 as well.
fn on_two_buses() -> String {
    let steering = "    { id = 2, driver = \"icla\", axis = \"steering\", gear = 180, switch_rad = 0, \
                    homing_speed_radps = 0.2 },\n";
    let second = steering.replace("id = 2", "id = 1");
    let second = format!("[can.second]\ninterface = \"can1\"\nbitrate = 250000\nmaster = 100\nnodes = [\n{second}]\n");
    assert!(ROBOT.contains(steering));
    ROBOT.replace(steering, "").replace("[rs485.a]", &(second + "[rs485.a]"))
}

#[test]
fn drives_may_be_on_several_can_buses_with_equal_ids() {
    let robot = load(&on_two_buses(), "", &[], MODULES).unwrap().robot;
    let (bus, driver) = robot.motion(&robot.can).unwrap();
    assert_eq!((bus, driver.bus.as_deref(), driver.bitrate, driver.node_id), (Some(0), Some("can.main"), 500_000, 127));
    let [further] = &driver.further[..] else { panic!("{:?}", driver.further) };
    assert_eq!((further.bus.as_str(), further.bitrate, further.node_id), ("can.second", 250_000, 100));
    assert_eq!(further.axes, [canbus::Axis::Steering]);
    assert_eq!((driver.wheels[0].node, driver.steering.unwrap().node), (1, 1));
    // The one called main is the first, whatever the order of the names.
    let other = on_two_buses().replace("can.second", "can.axle");
    let robot = load(&other, "", &[], MODULES).unwrap().robot;
    let names = |robot: &Robot| robot.buses_of_motion(&robot.can).iter().map(|bus| bus.bus()).collect::<Vec<_>>();
    assert_eq!(names(&robot), ["can.main", "can.axle"]);
    // A bus without drives of the base is not one of its buses.
    let alone = load(&(ROBOT.to_owned() + "[can.axle]\ninterface = \"can1\"\n"), "", &[], MODULES).unwrap().robot;
    assert_eq!(names(&alone), ["can.main"]);
    assert_eq!(alone.motion(&alone.can).unwrap().1.further, []);
}

#[test]
fn what_is_wrong_with_two_buses_is_refused_where_it_is_written() {
    let line = |text: &str, what: &str| text.lines().position(|line| line.contains(what)).unwrap() + 1;
    let twice = on_two_buses().replace(
        "driver = \"icla\", axis = \"steering\", gear = 180, switch_rad = 0, homing_speed_radps = 0.2",
        "driver = \"epos\", axis = \"propulsion\", gear = 25",
    );
    let at = line(&twice, "gear = 25");
    let expected = "can.second.nodes[0].axis = \"propulsion\": expected one that no drive of [can.main] moves";
    assert_eq!(load(&twice, "", &[], MODULES).unwrap_err(), [format!("robot.toml:{at}: {expected}")]);
    let shared = on_two_buses().replace("interface = \"can1\"", "interface = \"can0\"  # shared");
    let at = line(&shared, "# shared");
    let expected = "can.second.interface = \"can0\": expected one that [can.main] does not have";
    assert_eq!(load(&shared, "", &[], MODULES).unwrap_err(), [format!("robot.toml:{at}: {expected}")]);
}

#[test]
fn a_bus_that_is_left_out_of_the_simulation_is_refused() {
    let load = |over: &str| load(&on_two_buses(), over, &[], MODULES);
    let main = "[can.main]\ninterface = \"udp:239.74.163.2\"\n";
    let at = on_two_buses().lines().position(|line| line.contains("interface = \"can1\"")).unwrap() + 1;
    let expected =
        "can.second.interface = \"can1\": expected \"udp:GROUP\", as [can.main] has: both are simulated or none";
    assert_eq!(load(main).unwrap_err(), [format!("robot.toml:{at}: {expected}")]);
    load(&format!("{main}[can.second]\ninterface = \"udp:239.74.163.3\"\n")).unwrap();
}

#[test]
fn output_and_devices_name_their_bus() {
    let tables = |output: &str, device: &str| {
        on_two_buses()
            + &format!(
                "[stop]\nsecond_way = \"canopen\"\n{output}\noutput = {{ node = 1, index = 0x6200 }}\n\
                 [io.canopen.plc]\n\
                 node = 2\n{device}\nsignals = [{{ name = \"estop\", kind = \"digital-in\", channel = 3 }}]\n"
            )
    };
    let third = "[can.third]\ninterface = \"can2\"\n";
    let good = tables("output_bus = \"can.third\"", "bus = \"can.second\"") + third;
    let robot = load(&good, "", &[], MODULES).unwrap().robot;
    let names: Vec<String> = robot.buses_of_motion(&robot.can).iter().map(|bus| bus.bus()).collect();
    assert_eq!(names, ["can.main", "can.second", "can.third"]);
    let (_, driver) = robot.motion(&robot.can).unwrap();
    assert_eq!((driver.stop.output_bus.is_none(), driver.devices[0].keys.bus.as_deref()), (true, Some("can.second")));
    let taken = "a node of its own, which is neither a drive nor the master";
    let bus = "expected the name of a CAN bus of this file, as \"can.main\"";
    for (output, device, expected) in [
        ("", "", format!("stop.output.node = 1: expected {taken}")),
        ("output_bus = \"can.second\"", "", format!("stop.output.node = 1: expected {taken}")),
        ("output_bus = \"can.fourth\"", "", format!("stop.output_bus = \"can.fourth\": {bus}")),
        ("output_bus = \"can.third\"", "bus = \"second\"", format!("io.canopen.plc.bus = \"second\": {bus}")),
    ] {
        let wrong = load(&(tables(output, device) + third), "", &[], MODULES).unwrap_err();
        assert!(wrong.len() == 1 && wrong[0].ends_with(&format!(": {expected}")), "{wrong:?}");
    }
}

const GPIO_STOP: &str = "[stop]\nsecond_way = \"gpio\"\ngpio = { chip = \"/dev/gpiochip0\", line = 17 }\n";

#[test]
fn wheels_may_be_on_serial_lines_with_and_without_a_can_bus() {
    let vescs = uart("left", "left") + &uart("right", "right");
    for (tables, lines) in [(vescs, 2), (roboclaw("left", "right") + GPIO_STOP, 1)] {
        let robot = load(&on_lines(&tables), "", &[], MODULES).unwrap().robot;
        let (bus, driver) = robot.motion(&robot.can).unwrap();
        assert_eq!((bus, driver.bus.as_deref(), driver.lines.len(), driver.wheels.len()), (None, None, lines, 2));
        assert!(driver.wheels.iter().all(|wheel| matches!(wheel.drive, canbus::PropulsionDrive::OnLine { .. })));
    }
    let epos = "[can.main]\ninterface = \"can0\"\n\
                nodes = [{ id = 1, driver = \"epos\", axis = \"left\", gear = 26 }]\n";
    let robot = load(&on_lines(&(uart("right", "right") + epos)), "", &[], MODULES).unwrap().robot;
    let (bus, driver) = robot.motion(&robot.can).unwrap();
    assert_eq!((bus, driver.bus.as_deref(), driver.lines.len()), (Some(0), Some("can.main"), 1));
    let robot = load(&on_lines(&uart("left", "left")), "", &[], MODULES).unwrap().robot;
    assert!(robot.motion(&robot.can).is_none(), "a wheel without a drive");
    // A robot that steers: what drives it may be on a line, the steering is on CAN.
    let steers = ROBOT.replace("    { id = 1, driver = \"epos\", axis = \"propulsion\", gear = 26 },\n", "");
    let robot = load(&(steers + &uart("rear", "propulsion")), "", &[], MODULES).unwrap().robot;
    assert!(robot.motion(&robot.can).is_some_and(|(_, driver)| driver.steering.is_some()));
}

#[test]
fn a_robot_on_serial_lines_rolls_without_commands() {
    let brake = ["stop.pause=brake", "stop.brake_mps2=0.8", "stop.coasting_mps2=0.15"];
    let vescs = on_lines(&(uart("left", "left") + &uart("right", "right")));
    assert_eq!(load(&vescs, "", &brake, MODULES).unwrap().robot.power_lost_mps2(), 0.15);
}

#[test]
fn what_is_wrong_with_a_serial_line_is_refused_where_it_is_written() {
    let (left, right) = (uart("left", "left"), uart("right", "right"));
    let rolls = "a robot with a second way to stop, since its command time limit cannot be proven: ";
    let needs = |keys: &str| format!("serial.wheels.driver = \"roboclaw\": expected {rolls}{keys}");
    let with_power = needs("a table [power], or stop.second_way = \"gpio\" or \"canopen\"");
    let with_way = needs("stop.second_way = \"gpio\" or \"canopen\", or \"power\" with a table [power]");
    let cases = [
        (left.clone() + &uart("right", "left"), "serial.right.axis = \"left\": expected one that no other drive moves"),
        (
            left.clone() + &uart("right", "wheel_1"),
            "serial.right.axis = \"wheel_1\": expected an axis of the base: left, right",
        ),
        (left.replace("gear = 8", "gear = 0") + &right, "serial.left.gear = 0: expected a number that is not 0"),
        (
            left.clone() + &right.replace("tty-right", "tty-left"),
            "serial.right.port = \"/dev/tty-left\": expected a line of its own: another drive has this one",
        ),
        (
            left + &right.replace("axis = \"right\"", "axis = \"steering\""),
            "serial.right.axis = \"steering\": expected \"propulsion\" or a wheel: this driver cannot steer",
        ),
        (
            roboclaw("left", "left") + GPIO_STOP,
            "serial.wheels.m2.axis = \"left\": expected another one than that of m1",
        ),
        (roboclaw("left", "right"), &with_power),
        (roboclaw("left", "right") + "[stop]\nsecond_way = \"none\"\n", &with_way),
        (
            roboclaw("left", "right").replace("RoboClaw 2x15a v4.1.34", "") + GPIO_STOP,
            "serial.wheels.model = \"\": expected model and version, as the device names them",
        ),
    ];
    for (tables, expected) in cases {
        let text = on_lines(&tables);
        let wrong = load(&text, "", &[], MODULES).unwrap_err();
        assert!(wrong[0].starts_with("robot.toml:") && wrong[0].ends_with(&format!(": {expected}")), "{wrong:?}");
    }
    let taken = "[can.main]\ninterface = \"can0\"\n\
                 nodes = [{ id = 1, driver = \"epos\", axis = \"left\", gear = 26 }]\n";
    let both = uart("left", "left") + &right + taken;
    let wrong = load(&on_lines(&both), "", &[], MODULES).unwrap_err();
    assert!(wrong[0].ends_with(": serial.left.axis = \"left\": expected one that no other drive moves"), "{wrong:?}");
}

#[test]
fn a_vesc_that_brakes_at_every_speed_of_the_robot_is_refused() {
    let base = "kind = \"differential\"\ntrack_m = 0.42";
    let on_can = |more: &str| {
        let vesc = |id: usize, axis: &str, more: &str| {
            format!("{{ id = {id}, driver = \"vesc\", axis = \"{axis}\", gear = -8, pole_pairs = 7{more} }}")
        };
        let nodes = [vesc(1, "left", more), vesc(2, "right", "")];
        load(&based(base, &[&nodes[0], &nodes[1]]), "", &[], MODULES).map(drop)
    };
    // A robot that senses nothing drives at 0.3 m/s at most: 1604.3 of a wheel of 0.628 m.
    assert_eq!(on_can(", erpm_min = 1604"), Ok(()));
    let expected = "erpm_min = 1605: expected at most 1604: the robot drives at 0.3 m/s at most, and by gear and \
                    pole_pairs the wheel stands below 0.301 m/s";
    let wrong = on_can(", erpm_min = 1605").unwrap_err();
    assert!(wrong.len() == 1 && wrong[0].ends_with(&format!(": can.main.nodes[0].{expected}")), "{wrong:?}");
    let on_line = on_lines(&(uart("left", "left") + "erpm_min = 1605\n" + &uart("right", "right")));
    let wrong = load(&on_line, "", &[], MODULES).unwrap_err();
    assert!(wrong.len() == 1 && wrong[0].ends_with(&format!(": serial.left.{expected}")), "{wrong:?}");
    // The usual one counts as if it were written.
    let wrong = load(&on_line.replace("gear = 8", "gear = 1"), "", &[], MODULES).unwrap_err();
    assert!(
        wrong.iter().any(|line| line.contains("serial.right.erpm_min: missing, expected at most 200")),
        "{wrong:?}"
    );
}

#[test]
fn a_gamepad_is_configured_by_names_and_codes() {
    use base::gamepad::{ABS_RY, BTN_TL, BTN_TR, BTN_WEST};
    let table = "[gamepad]\ndevice = \"/dev/input/event5\"\ndead_man = \"BTN_TR\"\ncreep = \"BTN_TL\"\n\
                 speed = { axis = \"ABS_RY\", limit = 0.4 }\n\
                 steering = { axis = 0x28, inverted = true }\nslow = { button = \"BTN_WEST\", scale = 0.25 }\n\
         quiet_s = 0\n[limits]";
    let robot = load(&ROBOT.replacen("[limits]", table, 1), "", &[], MODULES).unwrap().robot;
    let (port, driver) = robot.gamepad.map(|gamepad| (gamepad.port, gamepad.driver)).unwrap();
    assert_eq!(port.place, GamepadPlace::Device("/dev/input/event5".into()));
    assert_eq!((driver.speed.axis, driver.speed.limit), (Some(ABS_RY), 0.4));
    assert_eq!((driver.steering.axis, driver.steering.inverted), (Some(0x28), true));
    assert_eq!((driver.steering.dead_zone, driver.steering.limit), (0.1, f64::INFINITY));
    assert_eq!(driver.creep, Some(BTN_TL));
    assert_eq!((driver.dead_man, driver.slow), (Some(BTN_TR), Some(Gear { button: BTN_WEST, scale: 0.25 })));
    assert_eq!((driver.fast, driver.quiet, driver.scale), (None, None, 1.0));
    let within = |commands| {
        let driver = driver.clone().within(&robot.limits, commands);
        [driver.speed.limit, driver.steering.limit, driver.sideways.limit]
    };
    let manual = robot.limits.manual_mps();
    assert_eq!(within(Commands::Motion), [0.4, 0.61, manual], "the limits of a manual source");
    let rotation = robot.limits.rotation_radps;
    assert_eq!(within(Commands::Velocity { sideways: true }), [0.4, rotation, manual]);
    assert!(load(ROBOT, "", &[], MODULES).unwrap().robot.gamepad.is_none());
}

#[test]
fn a_gamepad_that_cannot_be_meant_is_refused() {
    let table = |lines: &str| format!("[gamepad]\n{lines}\n[limits]");
    let refused = |line: &str, why: &str| refused("[limits]", &table(line), &[&format!("robot.toml:12: gamepad{why}")]);
    refused(
        "device = \"js0\"",
        ".device = \"js0\": expected \"auto\", a device file as \"/dev/input/event5\", or \"file:PATH\"",
    );
    refused(
        "device = \"file:\"",
        ".device = \"file:\": expected \"auto\", a device file as \"/dev/input/event5\", or \"file:PATH\"",
    );
    refused(
        "dead_man = \"BTN_LEFT\"",
        ".dead_man = \"BTN_LEFT\": expected a name as \"BTN_TL\", or a code from 0x100 to 0x2ff",
    );
    refused("dead_man = 30", ".dead_man = 30: expected a name as \"BTN_TL\", or a code from 0x100 to 0x2ff");
    refused("speed = { axis = 64 }", ".speed.axis = 64: expected a name as \"ABS_Y\", or a code from 0x0 to 0x3f");
    refused("speed = { dead_zone = 1.0 }", ".speed.dead_zone = 1.0: expected a number from 0 to 0.9");
    refused("steering = { expo = nan }", ".steering.expo = NaN: expected a number from 0 to 1");
    refused(
        "slow = { scale = 0.5 }",
        ".slow.button: missing, expected a name as \"BTN_TL\", or a code from 0x100 to 0x2ff",
    );
    refused("scale = 0", ".scale = 0: expected a number from 0.01 to 1");
    refused("quiet_s = 0.2", ".quiet_s = 0.2: expected 0, or a number from 0.5 to 3600");
    refused(
        "deadman = 1",
        ".deadman: unknown key, expected one of device, grab, speed, steering, sideways, dead_man, creep, scale, slow, \
         fast, quiet_s",
    );
    let twice =
        "speed = { axis = 1 }\nsteering = { axis = \"ABS_Y\" }\ndead_man = 300\nfast = { button = 300, scale = 1 }";
    let found = load(&ROBOT.replacen("[limits]", &table(twice), 1), "", &[], MODULES).unwrap_err();
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(
        found[0].starts_with("robot.toml:13: gamepad.steering = ")
            && found[0].ends_with("another axis than that of the speed")
    );
    assert!(found[1].starts_with("robot.toml:15: gamepad.fast = "), "{found:?}");
    refused("creep = 300\ndead_man = 300", ".creep = 300: expected another button than dead_man, slow and fast");
}

#[test]
fn the_shipped_robot_loads_live_and_simulated() {
    let live = Config::load(&shipped(), false, &[]).unwrap();
    let sim = Config::load(&shipped(), true, &[]).unwrap();
    assert_eq!((live.robot.srfs.len(), live.robot.irs.len()), (16, 4));
    assert_eq!(live.robot.can[0].port.interface, CanInterface::Socket("can0".into()));
    let group = std::net::Ipv4Addr::new(239, 74, 163, 2);
    assert_eq!(sim.robot.can[0].port.interface, CanInterface::Udp { group, port: None });
    assert_eq!(sim.robot.rs485[0].line.port, PathBuf::from("rs485-a"));
    let names = |config: &Config| config.modules.iter().map(|module| module.name().to_owned()).collect::<Vec<_>>();
    let drivers = [
        "logger",
        "driver_power",
        "driver_rs485a",
        "driver_rs485b",
        "estimator",
        "guard",
        "driver_canbus",
        "driver_joydev",
        "driver_aux",
        "planner",
        web::NAME,
    ];
    assert_eq!(names(&live), drivers);
    assert_eq!(names(&sim)[..], [&["simulator"], &drivers[..]].concat());
    let device = |config: &Config| config.robot.gamepad.as_ref().map(|gamepad| gamepad.port.place.clone());
    assert_eq!(device(&live), Some(GamepadPlace::Auto));
    assert_eq!(device(&sim), Some(GamepadPlace::Stream("gamepad".into())));
    assert!(live.robot.power.is_some() && live.robot.beacons.len() == 6);
    assert!(live.modules.iter().all(|module| module.guard.depends.is_empty()));
}

#[test]
fn the_small_robot_loads_with_the_defaults() {
    let robot = load(ROBOT, "", &[], MODULES).unwrap().robot;
    assert_eq!(robot.limits.command_ttl.as_secs_f64(), 0.25);
    assert_eq!((robot.can[0].driver.bitrate, robot.rs485[0].line.baud), (500_000, 115_200));
    assert_eq!(robot.rs485[0].driver.crc, Crc { polynomial: 0x1D, initial: 0xFF, reflected: false, final_xor: 0xFF });
}

#[test]
fn an_unknown_key_is_refused_and_the_known_ones_are_named() {
    refused(
        "name = \"small\"",
        "name = \"small\"\ncolour = \"red\"",
        &["robot.toml:3: robot.colour: unknown key, expected one of name, report_from, print_from, send_from"],
    );
}

#[test]
fn an_unknown_table_is_refused() {
    refused(
        "[limits]",
        "[powder]\nport = \"x\"\n[limits]",
        &["robot.toml:11: powder: unknown key, expected one of robot, bus, geometry, base, limits, stop, can, rs485, \
           serial, i2c, w1, host, io, signals, lidar, imu, srfs, irs, sensors, beacons, estimator, power, gamepad, \
           guard, planner, log, web, ros2, bridge"],
    );
}

#[test]
fn a_missing_key_is_named_with_its_table_s_line() {
    refused("track_m = 0.5\n", "", &["robot.toml:3: geometry.track_m: missing, expected a number from 0.05 to 5"]);
}

#[test]
fn a_number_out_of_range_is_refused() {
    refused(
        "wheelbase_m = 0.6",
        "wheelbase_m = 60",
        &["robot.toml:4: geometry.wheelbase_m = 60: expected a number from 0.05 to 5"],
    );
}

#[test]
fn what_is_not_a_number_is_no_number() {
    refused(
        "speed_mps = 1.2",
        "speed_mps = nan",
        &["robot.toml:12: limits.speed_mps = NaN: expected a number from 0.01 to 10"],
    );
}

#[test]
fn a_wrong_type_is_refused() {
    refused(
        "ticks_per_turn = 4096",
        "ticks_per_turn = \"4096\"",
        &["robot.toml:10: geometry.ticks_per_turn = \"4096\": expected an integer from 1 to 1000000"],
    );
}

#[test]
fn a_table_that_is_none_is_refused() {
    let found = load("robot = 1\n", "", &[], MODULES).unwrap_err();
    assert_eq!(found[0], "robot.toml:1: robot = 1: expected a table");
    assert_eq!(found[1], "robot.toml:1: geometry: missing, expected a table");
}

#[test]
fn a_choice_names_the_choices() {
    let choices = "\"two-byte\" or \"ninth-first\" or \"parity\"";
    let expected = format!("robot.toml:29: rs485.a.transport = \"9bit\": expected {choices}");
    refused("\"two-byte\"", "\"9bit\"", &[expected.as_str()]);
    refused(
        "driver = \"sd1\"",
        "driver = \"sd2\"",
        &["robot.toml:31: rs485.a.nodes[0].driver = \"sd2\": expected \"sd1\" or \"so1\" or \"sbs1\" or \"psc1\""],
    );
}

#[test]
fn a_serial_port_is_set_up_as_it_says() {
    let parity = "\"parity\"\nsetup = [\"/sbin/ctl\", \"--485\"]\nlow_latency = true\n\
                  rs485_direction = { rts_on_send = false, delay_after_ms = 1 }";
    let bus = load(&ROBOT.replacen("\"two-byte\"", parity, 1), "", &[], MODULES).unwrap().robot.rs485.remove(0).line;
    assert_eq!((bus.transport, bus.low_latency), (Transport::Parity, true));
    assert_eq!(bus.setup, ["/sbin/ctl", "--485"]);
    let direction = Direction { rts_on_send: false, rts_after_send: true, delay_before_ms: 0, delay_after_ms: 1 };
    assert_eq!(bus.direction, Some(direction));
    refused(
        "\"two-byte\"",
        "\"parity\"\nrs485_direction = { rts_after_send = true }",
        &["robot.toml:30: rs485.a.rs485_direction.rts_after_send = true: expected the opposite of rts_on_send"],
    );
}

#[test]
fn a_drive_s_keys_are_those_of_its_driver() {
    refused(
        "gear = 26",
        "switch_rad = 0",
        &[
            "robot.toml:24: can.main.nodes[0].gear: missing, expected a number from -1000 to 1000",
            "robot.toml:24: can.main.nodes[0].switch_rad: unknown key, expected one of id, axis, writable, eds, \
             motor_rpm_max, driver, gear",
        ],
    );
    refused("gear = 26", "gear = 0", &["robot.toml:24: can.main.nodes[0].gear = 0: expected a number that is not 0"]);
}

#[test]
fn limits_that_a_motor_cannot_reach_with_its_gear_are_refused() {
    let expected = "robot.toml:24: can.main.nodes[0].motor_rpm_max = 2900: expected at least 2980, by limits.speed_mps \
                    and gear; or a speed_mps of at most 1.168";
    refused("gear = 26", "gear = -26, motor_rpm_max = 2900", &[expected]);
    let of_steering = "robot.toml:25: can.main.nodes[1].motor_rpm_max = 1000: expected at least 1204, by \
                       limits.steering_rate_radps and gear; or a steering_rate_radps of at most 0.581";
    refused("gear = 180", "gear = 180, motor_rpm_max = 1000", &[of_steering]);
    assert!(load(&ROBOT.replacen("gear = 26", "gear = 26, motor_rpm_max = 3000", 1), "", &[], MODULES).is_ok());
    let by_sheet = "driver = \"cia402\", eds = \"wheel.eds\", motor_rpm_max = 4000, axis = \"propulsion\"";
    refused(
        "driver = \"epos\", axis = \"propulsion\", gear = 26",
        by_sheet,
        &["robot.toml:24: can.main.nodes[0].gear: missing, expected the gear of a motor with motor_rpm_max"],
    );
}

#[test]
fn a_drive_moves_the_axis_that_its_driver_can() {
    let from = "axis = \"propulsion\", gear = 26 },\n    { id = 2, driver = \"icla\", axis = \"steering\"";
    let to = "axis = \"steering\", gear = 26 },\n    { id = 2, driver = \"icla\", axis = \"propulsion\"";
    refused(
        from,
        to,
        &[
            "robot.toml:24: can.main.nodes[0].axis = \"steering\": \
             expected \"propulsion\" or a wheel: this driver cannot steer",
            "robot.toml:25: can.main.nodes[1].axis = \"propulsion\": \
             expected \"steering\", which is all that this driver can move",
        ],
    );
}

#[test]
fn two_nodes_of_one_number_are_refused() {
    refused(
        "{ id = 2",
        "{ id = 1",
        &["robot.toml:25: can.main.nodes[1].id = 1: expected one that no other node of the bus has"],
    );
}

#[test]
fn a_ranger_s_board_must_exist() {
    refused(
        "board = 0x10\nchannel",
        "board = 0x12\nchannel",
        &["robot.toml:35: srfs[0].board = 18: expected the address of an sd1 in rs485"],
    );
}

#[test]
fn the_beam_of_a_sonar_is_that_of_the_srf_08_unless_another_is_configured() {
    let beam = |sets: &[&str]| load(ROBOT, "", sets, MODULES).map(|config| config.robot.sensors.srf08.beam_rad);
    assert_eq!(beam(&[]), Ok(0.96));
    assert_eq!(beam(&["sensors.srf08.beam_rad=0.5"]), Ok(0.5));
    refused(
        "[limits]",
        "[sensors.srf08]\nbeam_rad = 0\n[limits]",
        &["robot.toml:12: sensors.srf08.beam_rad = 0: expected a number from 0.05 to 3"],
    );
}

#[test]
fn a_power_controller_has_a_link_of_its_own_and_a_battery_that_can_be() {
    let power = "[power]\ncapacity_ah = 0\ncells = 8\n[limits]";
    refused(
        "[limits]",
        power,
        &[
            "robot.toml:11: power.bus: missing, expected an rs485 bus with one node, whose driver is \"psc1\"",
            "robot.toml:12: power.capacity_ah = 0: expected a number from 0.1 to 10000",
        ],
    );
    refused(
        "[limits]",
        "[power]\nbus = \"rs485.a\"\ncapacity_ah = 40\ncells = 8\n[limits]",
        &["robot.toml:12: power.bus = \"rs485.a\": expected an rs485 bus with one node, whose driver is \"psc1\""],
    );
    let link = "[rs485.link]\nport = \"p\"\ntransport = \"two-byte\"\n\
                nodes = [{ address = 0x40, driver = \"psc1\", rate_hz = 1 }]\n\
                [power]\nbus = \"rs485.link\"\ncapacity_ah = 40\ncells = 8\nhalt_command = [\"halt\"]\n[limits]";
    let robot = load(&ROBOT.replacen("[limits]", link, 1), "", &[], MODULES).unwrap().robot;
    let power = robot.power.unwrap();
    assert_eq!((power.reserve, power.halt.len(), power.reboot.len()), (0.2, 1, 0));
}

#[test]
fn the_output_that_cuts_the_feed_is_a_node_of_its_own() {
    let stop = "[stop]\nsecond_way = \"canopen\"\n";
    refused(
        "[limits]",
        &format!("{stop}[limits]"),
        &["robot.toml:11: stop.output: missing, expected the output that cuts the motors' feed"],
    );
    let rows = [
        ("node = 2", "node = 2: expected a node of its own, which is neither a drive nor the master"),
        ("node = 127", "node = 127: expected a node of its own, which is neither a drive nor the master"),
        ("node = 5, on = 256", "on = 256: expected a value that fits the object"),
        ("node = 5, bits = 12", "bits = 12: expected 8, 16 or 32"),
        ("node = 5, cut = 1", "cut = 1: expected two values that differ"),
    ];
    for (keys, why) in rows {
        let table = format!("{stop}output = {{ index = 0x6200, {keys} }}\n[limits]");
        refused("[limits]", &table, &[&format!("robot.toml:13: stop.output.{why}")]);
    }
    let with = |way: &str| {
        let table = format!("[stop]\nsecond_way = {way:?}\noutput = {{ node = 5, index = 0x6200 }}\n[limits]");
        load(&ROBOT.replacen("[limits]", &table, 1), "", &[], MODULES).unwrap().robot.stop.feed_output()
    };
    let canbus::OutputConfig { node, subindex, bits, on, cut, .. } = with("canopen").unwrap();
    assert_eq!((node, subindex, bits, on, cut), (5, 1, 8, 1, 0));
    assert_eq!(with("power"), None);
}

#[test]
fn an_input_that_stops_the_robot_exists_and_is_read_often_enough() {
    let io = "[io.modbus.plc]\naddress = \"127.0.0.1:1502\"\nperiod_s = PERIOD\nsignals = [\
              { name = \"gate\", table = \"discrete\", address = 0 }, \
              { name = \"volts\", table = \"input\", address = 1 }]\n\
              [[io.gpio]]\nname = \"estop\"\nchip = \"/dev/gpiochip0\"\nline = 1\n";
    let table = |period: &str, inputs: &str| {
        let io = io.replacen("PERIOD", period, 1);
        ROBOT.replacen("[limits]", &format!("[stop]\ninputs = [{inputs}]\n{io}[limits]"), 1)
    };
    let good = "{ signal = \"estop\" }, { signal = \"gate\" }, { axis = \"propulsion\", bit = 16 }";
    let robot = load(&table("0.1", good), "", &[], MODULES).unwrap().robot;
    let sources: Vec<String> = robot.stop.inputs.iter().map(canbus::StopInput::source).collect();
    assert_eq!(sources, ["io.estop", "io.gate", "drive.propulsion.16"]);
    let signal = "an input of [io] that is 0 or 1: a GPIO line, or a bit of a Modbus line or a CANopen device whose \
                  period_s is at most 0.2";
    for (period, input, why) in [
        ("0.1", "{ signal = \"volts\" }", format!(".signal = \"volts\": expected {signal}")),
        ("0.1", "{ signal = \"nothing\" }", format!(".signal = \"nothing\": expected {signal}")),
        ("0.5", "{ signal = \"gate\" }", format!(".signal = \"gate\": expected {signal}")),
        ("0.1", "{ axis = \"left\", bit = 3 }", ".axis = \"left\": expected an axis with a drive of CANopen".into()),
        ("0.1", "{ axis = \"steering\", bit = 32 }", ".bit = 32: expected an integer from 0 to 31".into()),
        ("0.1", "{ bit = 3 }", ".signal: missing, expected a signal of [io], or an axis and a bit".into()),
    ] {
        let errors = load(&table(period, input), "", &[], MODULES).unwrap_err().join("\n");
        assert!(errors.contains(&format!("stop.inputs[0]{why}")), "{input}: {errors}");
    }
    let twice = "{ axis = \"steering\", bit = 3 }, { axis = \"steering\", bit = 3 }";
    let errors = load(&table("0.1", twice), "", &[], MODULES).unwrap_err().join("\n");
    assert!(
        errors.contains("stop.inputs[1].axis = \"steering\": expected an input that no other of the inputs is"),
        "{errors}"
    );
}

#[test]
fn a_canopen_device_is_a_node_of_its_own_whose_signals_exist() {
    let table = |keys: &str, signals: &str| {
        let io = format!("[io.canopen.plc]\n{keys}\nsignals = [\n{signals}\n]\n");
        ROBOT.replacen("[limits]", &format!("[stop]\ninputs = [{{ signal = \"estop\" }}]\n{io}[limits]"), 1)
    };
    let estop = "{ name = \"estop\", kind = \"digital-in\", channel = 3 }";
    let lamp = "{ name = \"lamp\", kind = \"digital-out\", channel = 9, output = false, safe = 0 }";
    let robot = load(&table("node = 5", estop), "", &[], MODULES).unwrap().robot;
    let io = robot.io.as_ref().unwrap();
    assert_eq!(io.stops(&robot.stop).count(), 0, "driver_canbus reads it by itself");
    let (bus, config) = robot.motion(&robot.can).unwrap();
    assert_eq!((bus, config.devices[0].name.as_str(), config.devices[0].keys.node), (Some(0), "canopen.plc", 5));
    let place = config.devices[0].keys.signals[0].place();
    assert_eq!((place.index, place.sub, place.bit), (0x6000, 1, 3));
    let signal = |signal: &str| format!("{estop},\n{signal}");
    let rows = [
        ("node = 2", estop.into(), "node = 2: expected a node that is no drive of [[can.<name>.nodes]]"),
        ("node = 127", estop.into(), "node = 127: expected a node other than the master of [can.<name>]"),
        ("node = 5\nheartbeat_limit_s = 0.05", estop.into(), "heartbeat_limit_s = 0.05: expected a time longer than"),
        (
            "node = 5\nheartbeat_s = 0.5",
            estop.into(),
            "io.canopen.plc.heartbeat_limit_s: missing, expected a time longer",
        ),
        ("node = 5\nage_max_s = 0.1", estop.into(), "age_max_s = 0.1: expected a time longer than period_s"),
        ("node = 5", signal(lamp), "signals[1].output = false: expected a key of kind = \"object\" only"),
        (
            "node = 5",
            signal("{ name = \"lamp\", kind = \"digital-out\", channel = 2032, safe = 0 }"),
            "signals[1].channel = 2032: expected an integer from 0 to 2031",
        ),
        (
            "node = 5",
            signal("{ name = \"valve\", kind = \"analogue-out\", channel = 0, safe = 7 }"),
            "signals[1].safe = 7: expected a value whose number is 0",
        ),
        (
            "node = 5",
            signal("{ name = \"volts\", kind = \"object\", index = 0x6060, format = \"u12\" }"),
            "signals[1].format = \"u12\": expected \"u8\" or \"i8\"",
        ),
        (
            "node = 5",
            signal("{ name = \"flag\", kind = \"object\", index = 0x2000, format = \"bit\", bit = 32 }"),
            "signals[1].bit = 32: expected an integer from 0 to 31",
        ),
        (
            "node = 5",
            signal("{ name = \"x\", kind = \"object\", index = 0x1017, format = \"u16\", output = true, safe = 0 }"),
            "signals[1].index = 4119: expected an object of the device, from 0x2000 on",
        ),
        ("node = 5\nperiod_s = 0.5", estop.into(), "stop.inputs[0].signal = \"estop\": expected an input of [io]"),
    ];
    for (keys, signals, why) in rows {
        let errors = load(&table(keys, &signals), "", &[], MODULES).unwrap_err().join("\n");
        assert!(errors.contains(why) && errors.starts_with("robot.toml:"), "{keys} {signals}: {errors}");
    }
    let second = table("node = 5", estop)
        + "[io.canopen.other]\nnode = 5\nsignals = [{ name = \"a\", kind = \
                 \"digital-in\", channel = 0 }]\n";
    let errors = load(&second, "", &[], MODULES).unwrap_err().join("\n");
    assert!(errors.contains("node = 5: expected a node that no other table [io.canopen.<name>] has"), "{errors}");
}

#[test]
fn the_line_that_cuts_the_feed_is_named_or_numbered() {
    let stop = "[stop]\nsecond_way = \"gpio\"\n";
    let missing = "robot.toml:11: stop.gpio: missing, expected the line that cuts the motors' feed";
    refused("[limits]", &format!("{stop}[limits]"), &[missing]);
    for (line, shown) in [("-1", "-1"), ("\"\"", "\"\""), ("1.5", "1.5")] {
        let table = format!("{stop}gpio = {{ chip = \"/dev/gpiochip0\", line = {line} }}\n[limits]");
        let why = format!("robot.toml:13: stop.gpio.line = {shown}: expected the number of a line, or its name");
        refused("[limits]", &table, &[&why]);
    }
    let with = |way: &str, line: &str| {
        let table = format!("[stop]\nsecond_way = {way:?}\ngpio = {{ chip = \"/dev/gpiochip0\", {line} }}\n[limits]");
        load(&ROBOT.replacen("[limits]", &table, 1), "", &[], MODULES).unwrap().robot.stop.feed_line().cloned()
    };
    let line = |line, active_low| Some(canbus::GpioConfig { chip: "/dev/gpiochip0".into(), line, active_low });
    assert_eq!(with("gpio", "line = 17"), line(LineId::Number(17), false));
    assert_eq!(with("gpio", "line = \"FEED\", active_low = true"), line(LineId::Name("FEED".into()), true));
    assert_eq!(with("power", "line = 17"), None);
}

#[test]
fn the_boards_of_a_real_port_are_simulated_at_another_place() {
    let a = |port: &str, at: &str| {
        let sets = [format!("rs485.a.port={port}"), format!("rs485.a.simulated_at={at}")];
        load(ROBOT, "", &sets.each_ref().map(String::as_str), MODULES)
            .map(|config| config.robot.rs485[0].line.offered().map(PathBuf::from))
    };
    assert_eq!(load(ROBOT, "", &[], MODULES).unwrap().robot.rs485[0].line.offered(), None);
    assert_eq!(a("/dev/ttyS0", "/dev/ttyS1").unwrap(), None);
    assert_eq!(a("/dev/ttyUSB0", "boards").unwrap(), Some("boards".into()));
    for (port, at) in [("rs485-a", "boards"), ("/dev/ttyS0", "/dev/ttyS0")] {
        let why = a(port, at).unwrap_err().join("; ");
        assert!(why.ends_with("expected a place other than port, where that is a device file"), "{why}");
    }
}

#[test]
fn only_a_serial_port_has_another_end_for_the_simulator() {
    let place = "expected a place other than port, where that is a device file";
    for (table, keys, why) in [
        ("lidar.front", "model = \"ld19\"\nport = \"/dev/ttyS0\"", Ok(())),
        ("lidar.front", "model = \"ld19\"\nport = \"lidar-front\"", Err(place)),
        ("lidar.front", "model = \"ld19\"\nport = \"/dev/ttyS1\"", Err(place)),
        ("lidar.front", "model = \"ust-10lx\"\naddress = \"127.0.0.1:10940\"", Err("expected nothing beside address")),
        ("imu.base", "model = \"witmotion\"\nport = \"/dev/ttyS0\"", Ok(())),
        ("imu.base", "model = \"witmotion\"\nport = \"imu-base\"", Err(place)),
    ] {
        let text = format!("[{table}]\n{keys}\nsimulated_at = \"/dev/ttyS1\"\n[limits]");
        match why {
            Ok(()) => drop(load(&ROBOT.replacen("[limits]", &text, 1), "", &[], MODULES).unwrap()),
            Err(why) => {
                refused("[limits]", &text, &[&format!("robot.toml:14: {table}.simulated_at = \"/dev/ttyS1\": {why}")]);
            }
        }
    }
}

#[test]
fn the_chips_of_an_i2c_bus_can_be() {
    let bus = "[i2c.aux]\nbus = \"i2c-1\"\nchips = [\n\
               { address = 0x78, driver = \"max6615\" },\n\
               { address = 0x18, driver = \"lm75\" },\n\
               { address = 0x18, driver = \"max6615\", temperatures = [\n\
               { name = \"box\", channel = 3, limit_c = 60 },\n\
               { name = \"box\", channel = 1, limit_c = 0 }, { name = \"cab\", channel = 1, limit_c = 5 } ], fans = [\n\
               { name = \"fan\", output = 1, follows = [\"bax\"], duty = 2 },\n\
               { name = \"fan\", output = 1, rpm_min = 100 } ] },\n]\n[limits]";
    refused(
        "[limits]",
        bus,
        &[
            "robot.toml:12: i2c.aux.bus = \"i2c-1\": expected \"/dev/i2c-1\", \"gpio:/dev/gpiochip0:SDA:SCL\", or \
             \"unix:PATH\"",
            "robot.toml:14: i2c.aux.chips[0].address = 120: expected an integer from 8 to 119",
            "robot.toml:15: i2c.aux.chips[1].driver = \"lm75\": expected \"max6615\"",
            "robot.toml:16: i2c.aux.chips[2].address = 24: expected one that no other chip of the bus has",
            "robot.toml:17: i2c.aux.chips[2].temperatures[0].channel = 3: expected an integer from 1 to 2",
            "robot.toml:18: i2c.aux.chips[2].temperatures[1].limit_c = 0: expected an integer from 1 to 150",
            "robot.toml:18: i2c.aux.chips[2].temperatures[2].channel = 1: expected one that no other temperature of the \
             chip has",
            "robot.toml:19: i2c.aux.chips[2].fans[0].duty = 2: expected a number from 0 to 1",
            "robot.toml:19: i2c.aux.chips[2].fans[0].follows = [1 items]: expected names of temperatures of this chip",
            "robot.toml:20: i2c.aux.chips[2].fans[1].rpm_min = 100: expected 0, or a number from 230 to 57600",
            "robot.toml:20: i2c.aux.chips[2].fans[1].output = 1: expected one that no other fan of the chip has",
        ],
    );
}

#[test]
fn thermometers_have_the_names_of_the_kernel() {
    refused(
        "[limits]",
        "[w1]\nsensors = [\n{ id = \"28-1\" },\n{ id = \"26-000000000001\" },\n\
         { id = \"28-000000000001\", limit_c = 200 },\n{ id = \"28-000000000001\" },\n]\n[limits]",
        &[
            "robot.toml:13: w1.sensors[0].id = \"28-1\": expected a thermometer as the kernel names it: \
             \"28-0316a2795bff\"",
            "robot.toml:14: w1.sensors[1].id = \"26-000000000001\": expected a thermometer as the kernel names it: \
             \"28-0316a2795bff\"",
            "robot.toml:15: w1.sensors[2].limit_c = 200: expected a number from -50 to 125",
            "robot.toml:16: w1.sensors[3].id = \"28-000000000001\": expected one that no other of the sensors has",
        ],
    );
    let robot = load(&ROBOT.replacen("[limits]", "[w1]\n[limits]", 1), "", &[], MODULES).unwrap().robot;
    assert_eq!(robot.w1.unwrap().port.folder, PathBuf::from("/sys/bus/w1/devices"));
}

#[test]
fn two_beacons_of_one_number_are_refused() {
    refused(
        "[robot]\n",
        "beacons = [{ id = 3, x = 0, y = 0 }, { id = 3, x = 1, y = 0 }]\n[robot]\n",
        &["robot.toml:1: beacons[1].id = 3: expected one that no other of the beacons has"],
    );
}

#[test]
fn an_interface_must_be_one() {
    refused(
        "\"can0\"",
        "\"udp:10.0.0.1:43113\"",
        &["robot.toml:22: can.main.interface = \"udp:10.0.0.1:43113\": \
           expected \"can0\" or another network interface, \"slcan:DEVICE\", or \"udp:GROUP[:PORT]\""],
    );
}

#[test]
fn all_that_is_wrong_is_listed_in_the_order_of_the_file() {
    let robot = ROBOT.replace("name = \"small\"", "name = \"\"").replace("theta = 0.0", "theta = 4.0");
    let found = load(&robot, "[limits]\nspeed_mps = -1\n", &["limits.steering_rad=2"], MODULES).unwrap_err();
    assert_eq!(
        found,
        [
            "robot.toml:2: robot.name = \"\": expected a text",
            "robot.toml:39: srfs[0].theta = 4.0: expected a number from -3.141592653589793 to 3.141592653589793",
            "sim.toml:2: limits.speed_mps = -1: expected a number from 0.01 to 10",
            "--set: limits.steering_rad = 2: expected a number from 0.01 to 1.5",
        ]
    );
}

#[test]
fn broken_toml_is_located() {
    let found = load(&ROBOT.replace("track_m = 0.5", "track_m = "), "", &[], MODULES).unwrap_err();
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].starts_with("robot.toml:5: "), "{found:?}");
}

#[test]
fn later_layers_override_single_keys() {
    let sets = [
        "limits.speed_mps=0.5",
        "can.main.nodes.1.id=7",
        "can.main.interface=udp:239.0.0.1:5000",
        "robot.name = \"n\"",
    ];
    let robot = load(ROBOT, "[limits]\nspeed_mps = 0.9\nsteering_rad = 0.3\n", &sets, MODULES).unwrap().robot;
    assert_eq!((robot.limits.speed_mps, robot.limits.steering_rad, robot.limits.acceleration_mps2), (0.5, 0.3, 0.5));
    assert_eq!((robot.can[0].driver.nodes[1].id, robot.general.name.as_str()), (7, "n"));
    let group = std::net::Ipv4Addr::new(239, 0, 0, 1);
    assert_eq!(robot.can[0].port.interface, CanInterface::Udp { group, port: Some(5000) });
}

#[test]
fn modules_are_overridden_by_name() {
    let modules = load(ROBOT, "", &["modules.driver_canbus.critical=true"], MODULES).unwrap().modules;
    assert!(modules[0].guard.critical);
    let error = load(ROBOT, "", &["modules.driver_canbsu.critical=true"], MODULES).unwrap_err();
    assert_eq!(error, ["--set modules.driver_canbsu.critical=true: driver_canbsu is none of the 1 items"]);
}

#[test]
fn what_is_wrong_is_one_line_whatever_stands_in_a_key_or_a_value() {
    refused(
        "name = \"small\"",
        "name = \"small\"\n\"co\\nlour\" = 1",
        &["robot.toml:3: robot.co\\nlour: unknown key, expected one of name, report_from, print_from, send_from"],
    );
    let lines = load(ROBOT, "", &["a\nb"], MODULES).unwrap_err();
    assert_eq!(lines, ["--set a\\nb: expected table.key=value"]);
    let lines = load(ROBOT, "\"a\\r\" = 2026-01-01", &[], MODULES).unwrap_err();
    assert!(lines.len() == 1 && !lines[0].contains(char::is_control), "{lines:?}");
}

#[test]
fn an_override_must_be_an_assignment_to_something() {
    let error = |set: &str| load(ROBOT, "", &[set], MODULES).unwrap_err();
    assert_eq!(error("limits"), ["--set limits: expected table.key=value"]);
    assert_eq!(error(".x=1"), ["--set .x=1: expected table.key=value"]);
    assert_eq!(error("robot.name.x=1"), ["--set robot.name.x=1: \"small\" has no key x"]);
    assert_eq!(error("can.main.nodes.2.id=1"), ["--set can.main.nodes.2.id=1: 2 is none of the 2 items"]);
    assert_eq!(
        error("robot.nmae=x"),
        ["--set: robot.nmae: unknown key, expected one of name, report_from, print_from, send_from"]
    );
}

#[test]
fn modules_are_checked_too() {
    let modules = "[[modules]]\nname = \"a b\"\n[[modules]]\nname = \"x\"\ndepends = [\"y\"]\nrestart = \"maybe\"\n\
                   cpus = [0, -1]\n[[modules]]\nname = \"x\"\nrt_priority = 100\n";
    assert_eq!(
        load(ROBOT, "", &[], modules).unwrap_err(),
        [
            "modules.toml:2: modules[0].name = \"a b\": expected letters, digits, _ and -",
            "modules.toml:5: modules[1].depends = [1 items]: expected modules listed before x",
            "modules.toml:6: modules[1].restart = \"maybe\": expected \"always\" or \"never\"",
            "modules.toml:7: modules[1].cpus = [2 items]: expected a list of integers from 0 to 1023",
            "modules.toml:9: modules[2].name = \"x\": expected one that no other module has",
            "modules.toml:10: modules[2].rt_priority = 100: expected an integer from 0 to 98",
        ]
    );
}

#[test]
fn what_a_run_writes_down_is_configured() {
    let [real, sim] = [false, true].map(|sim| Config::load(&shipped(), sim, &[]).unwrap().robot.log);
    assert_eq!((real.inputs, sim.inputs), (false, true), "the default in simulation");
    assert_eq!((real.inputs_max_bytes, real.folder), (256_000_000, None));
    let sets = ["log.folder=/var/log/advee".into(), "log.inputs_max_bytes=1e6".into()];
    let log = Config::load(&shipped(), true, &sets).unwrap().robot.log;
    assert_eq!((log.inputs_max_bytes, log.folder), (1_000_000, Some("/var/log/advee".into())));
    let sets = ["log.folder=".into(), "log.inputs_max_bytes=1".into(), "log.inputs=1".into()];
    let ConfigError(lines) = Config::load(&shipped(), true, &sets).unwrap_err();
    assert_eq!(lines.len(), 3, "{lines:?}");
}

#[test]
fn the_web_server_stays_on_this_machine_unless_it_asks_for_credentials() {
    let web = |set: &str| Config::load(&shipped(), true, &[set.into()]).map(|config| config.robot.web);
    assert_eq!(web("robot.name=x").unwrap(), web::settings::Web::default(), "what is shipped is the default");
    assert_eq!(web("web.listen=[::1]:80").unwrap().listen.port(), 80);
    for set in [
        "web.listen=0.0.0.0:8080",
        "web.listen=192.168.1.2:8080",
        "web.listen=localhost:8080",
        "web.hosts=[\"Advee.local\"]",
        "web.hosts=[\"advee.local:80\"]",
        "web.origins=[\"*\"]",
        "web.origins=[\"null\"]",
        "web.origins=[\"https://app.foxglove.dev/\"]",
        "web.viewers=0",
        "web.password=x",
    ] {
        let ConfigError(lines) = web(set).unwrap_err();
        assert_eq!(lines.len(), 1, "{set}: {lines:?}");
    }
    let sets = ["web.listen=0.0.0.0:8080".into(), "web.token_file=web.token".into()];
    assert!(Config::load(&shipped(), true, &sets).unwrap().robot.web.token_file.is_some());
}

#[test]
fn a_robot_without_a_web_server_has_no_such_module() {
    let listed = |set: &str| {
        let config = Config::load(&shipped(), true, &[set.into()]).unwrap();
        config.modules.iter().filter(|module| module.name() == web::NAME).count()
    };
    assert_eq!((listed("web.enabled=true"), listed("web.enabled=false")), (1, 0));
}

#[test]
fn a_robot_that_senses_has_a_guard_before_its_drives() {
    let names = |sets: &[String]| {
        let config = Config::load(&shipped(), true, sets).unwrap();
        let critical = config.critical().any(|name| name == guard::NAME);
        (config.modules.iter().map(|module| module.name().to_owned()).collect::<Vec<_>>(), critical)
    };
    let (without, critical) = names(&["guard.ranging=\"none\"".into()]);
    assert!(!critical && !without.contains(&guard::NAME.to_owned()), "{without:?}");
    let (with, critical) = names(&[]);
    let place = |name: &str| with.iter().position(|other| other == name).unwrap();
    assert!(critical && place(guard::NAME) + 1 == place("driver_canbus"), "{with:?}");
    assert_eq!(with.len(), without.len() + 1);
}

#[test]
fn a_folder_without_files_says_which_are_missing() {
    let ConfigError(lines) = Config::load(Path::new("/nonexistent"), true, &[]).unwrap_err();
    let expected = ["robot.toml", "sim.toml", "modules.toml"]
        .map(|name| format!("/nonexistent/{name}: No such file or directory (os error 2)"));
    assert_eq!(lines, expected);
}

#[test]
fn the_shipped_worlds_load() {
    let hall = world(&shipped(), None, &[]).unwrap();
    assert_eq!((hall.columns.len(), hall.beacons.len(), hall.people.count, hall.start.x), (6, 6, 20, 3.0));
    world(&shipped(), Some(&shipped().join("../worlds/hall.toml")), &[]).unwrap();
    let ConfigError(lines) = world(&shipped(), Some(Path::new("atlantis")), &[]).unwrap_err();
    let why = "conf/worlds/atlantis.toml: No such file or directory (os error 2); a world is a file that --world names";
    assert!(lines[0].contains(why), "{lines:?}");
}

/// The file that modules/web/page/src/map/scenario.test.ts makes.
#[test]
fn a_scenario_of_the_page_is_a_world() {
    let file = shipped().join("../../modules/web/page/src/map/scenario.fixture.toml");
    let (hall, drawn) = (world(&shipped(), None, &[]).unwrap(), world(&shipped(), Some(&file), &[]).unwrap());
    assert_eq!((drawn.start.x, drawn.start.y), (2.5, 6.0));
    assert!((drawn.start.theta.radians() - std::f64::consts::FRAC_PI_2).abs() < 1e-5);
    assert_eq!((drawn.boxes.len(), drawn.walls.len()), (1, hall.walls.len() + 4));
    assert_eq!(drawn.walkers.iter().map(|walker| walker.points.len()).collect::<Vec<_>>(), [2, 1]);
    let (routes, way) = drawn.routes.split_at(hall.routes.len());
    assert_eq!((routes, way[0].name.as_str(), way[0].waypoints.len()), (&hall.routes[..], "scenario", 2));
    assert_eq!((drawn.columns, drawn.beacons, drawn.people), (hall.columns, hall.beacons, hall.people));
}

#[test]
fn boxes_and_walkers_are_read_as_strictly() {
    let refused = |text: &str| {
        let node = Node::parse(Path::new("w.toml"), &format!("start = [0, 0, 0]\n{text}")).unwrap();
        parsed_world(node, Path::new("w.toml"), &[]).unwrap_err().to_string()
    };
    assert!(refused("[[boxes]]\nx = 1\ny = 1\nlength = 0\nwidth = 1\n").contains("w.toml:5: boxes[0].length = 0"));
    assert!(refused("[[boxes]]\nx = 1\ny = 1\nlength = 1\nwidth = 1\nheight = 1\n").contains("height: unknown key"));
    assert!(refused("[[walkers]]\npoints = []\n").contains("walkers[0]: not one or two points"));
    assert!(refused("[[walkers]]\npoints = [[1, 0]]\n").contains("nearer than 1.5 m to the start"));
    let crowd = "[[walkers]]\npoints = [[5, 5]]\n".repeat(201);
    assert!(refused(&crowd).contains("people: not from 0 to 200"));
}

#[test]
fn a_world_that_is_sent_as_text_names_no_file() {
    let read = |text: &str| super::world_without_files(Path::new("scenario"), text).map_err(|error| error.to_string());
    assert_eq!(read("start = [0, 0, 0]\n[[routes]]\nname = \"map\"\n"), Ok(()));
    for map in ["map = \"/etc/passwd\"", "\"map\" = \"hall.yaml\"", "'map' = \"../x.yaml\"", "map.x = 1", "[map]"] {
        let why = read(&format!("start = [0, 0, 0]\n{map}\n")).expect_err(map);
        assert!(why.starts_with("scenario: map: a world that is sent as text names no file"), "{map}: {why}");
    }
    assert!(read("start = [").expect_err("no TOML").starts_with("scenario:1"));
}

#[test]
fn a_world_is_read_as_strictly() {
    let text = "walls = [\n[0, 0, 1],\n[0, 0, 1, 2e4],\n]\ncolumns = 1\ndrops = [3, [[0, \"a\"]]]\nmoon = true\n\
                [[beacons]]\nid = 256\nx = 0\ny = 0\n";
    let ConfigError(lines) =
        settings::read_as::<simulator::world::World>(&Node::parse(Path::new("w.toml"), text).unwrap()).unwrap_err();
    assert_eq!(
        lines,
        [
            "w.toml:1: start: missing, expected a list of 3 numbers within ±10000: x, y, theta",
            "w.toml:2: walls[0] = [3 items]: expected a list of 4 numbers within ±10000",
            "w.toml:3: walls[1] = [4 items]: expected a list of 4 numbers within ±10000",
            "w.toml:5: columns = 1: expected a list",
            "w.toml:6: drops[0] = 3: expected a list of corners [x, y]",
            "w.toml:6: drops[1][0] = [2 items]: expected a list of 2 numbers within ±10000",
            "w.toml:7: moon: unknown key, expected one of start, map, walls, glass, black, shiny, columns, drops, \
             beacons, people, places, routes, boxes, walkers",
            "w.toml:9: beacons[0].id = 256: expected an integer from 0 to 255",
        ]
    );
}

#[test]
fn a_world_s_people_are_a_number_or_a_table_and_can_be_overridden() {
    let read = |text: &str, sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        let path = Path::new("w.toml");
        super::parsed_world(Node::parse(path, &format!("start = [0, 0, 0]\n{text}")).unwrap(), path, &sets)
    };
    let usual = simulator::world::Crowd::default();
    assert_eq!(read("people = 7", &[]).unwrap().people, simulator::world::Crowd { count: 7, ..usual });
    let table = "[people]\ncount = 9\nattentive = 0.5\n";
    let crowd = simulator::world::Crowd { count: 9, attentive: 0.5, ..usual };
    assert_eq!(read(table, &["limits.speed_mps=1"]).unwrap().people, crowd);
    assert_eq!(read(table, &["world.people=0"]).unwrap().people, usual);
    assert_eq!(
        read(table, &["world.people.grouped=1"]).unwrap().people,
        simulator::world::Crowd { grouped: 1.0, ..crowd }
    );
    let ConfigError(lines) = read("people = 1000", &["world.routes=3"]).unwrap_err();
    assert_eq!(lines.len(), 2, "{lines:?}");
    assert_eq!(lines[0], "w.toml:2: people = 1000: expected an integer from 0 to 200");
}

/// Every file in `conf/worlds`.
fn shipped_worlds() -> Vec<(String, simulator::world::World)> {
    let folder = shipped().join("../worlds");
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut names: Vec<_> = names.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).collect();
    names.sort();
    let stem = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_string();
    names.iter().map(|path| (stem(path), world(&shipped(), Some(path), &[]).unwrap())).collect()
}

#[test]
fn every_shipped_world_starts_clear_and_its_routes_have_room() {
    let worlds = shipped_worlds();
    let names: Vec<&str> = worlds.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["corridor", "empty", "foyer", "hall", "warehouse"]);
    let g = Config::load(&shipped(), true, &[]).unwrap().robot.geometry;
    for (name, world) in &worlds {
        let clearance = |pose| world.clearance(pose, -g.rear_m(), g.front_m(), g.width_m() / 2.0);
        assert!(clearance(world.start) >= 0.2, "{name}: it starts {} m from a wall", clearance(world.start));
        assert!(world.routes.iter().any(|route| route.name == "patrol"), "{name}: no route patrol");
        assert!(world.beacons.len() >= 3, "{name}: {} beacons", world.beacons.len());
        for route in &world.routes {
            // Driven straight from one to the next, with the rear axle on each waypoint on the way in and out.
            let ways = route.waypoints.iter().zip(route.waypoints.iter().cycle().skip(1));
            let ways = ways.take(route.waypoints.len() - usize::from(!route.looped));
            for (from, to) in ways {
                let (dx, dy) = (to.x - from.x, to.y - from.y);
                let (length, theta) = (dx.hypot(dy), dy.atan2(dx));
                for step in 0..=(length / 0.1) as u32 {
                    let part = f64::from(step) * 0.1 / length;
                    let pose = navitools::Pose::new(from.x + part * dx, from.y + part * dy, theta);
                    assert!(clearance(pose) >= 0.2, "{name}, {}: {} m at {pose:?}", route.name, clearance(pose));
                }
                let end = navitools::Pose::new(to.x, to.y, theta);
                assert!(clearance(end) >= 0.2, "{name}, {}: {} m at {end:?}", route.name, clearance(end));
            }
        }
    }
}

#[test]
fn the_robot_s_own_map_is_the_hall_s() {
    let hall = world(&shipped(), None, &[]).unwrap();
    let robot = Config::load(&shipped(), false, &[]).unwrap().robot;
    let own: Vec<_> = robot.beacons.iter().map(|beacon| (beacon.id, beacon.x, beacon.y)).collect();
    let its: Vec<_> = hall.beacons.iter().map(|beacon| (beacon.id, beacon.at.x, beacon.at.y)).collect();
    assert_eq!(own, its);
}

/// Inputs and outputs on both kinds of Modbus lines, and of the computer.
const IO: &str = r#"[io.modbus.plc]
address = "127.0.0.1:1502"
signals = [
    { name = "horn", table = "coil", address = 3, output = true, safe = 0 },
    { name = "volts", table = "input", address = 16, scale = 0.01, simulated = 24.5 },
]
[io.modbus.line]
port = "modbus-line"
unit = 5
signals = [ { name = "fan", table = "holding", address = 2, output = true, safe = 50, max = 100 } ]
[[io.gpio]]
name = "button"
chip = "button"
line = 17
[[io.battery]]
name = "main"
voltage = "volts"
"#;

#[test]
fn inputs_and_outputs_bring_their_module_and_without_them_there_is_none() {
    let modules = |robot: &str, modules: &str| -> Vec<String> {
        let config = load(robot, "", &[], modules).unwrap();
        config.modules.iter().map(|module| module.name().to_owned()).collect()
    };
    let with = format!("{ROBOT}{IO}");
    assert_eq!(modules(ROBOT, MODULES), ["driver_canbus"]);
    assert_eq!(modules(&with, MODULES), ["driver_canbus", "driver_io"]);
    let listed = format!("[[modules]]\nname = \"driver_io\"\n{MODULES}");
    assert_eq!(modules(&with, &listed), ["driver_io", "driver_canbus"]);
    assert_eq!(modules(ROBOT, &listed), ["driver_canbus"]);
}

#[test]
fn inputs_and_outputs_that_cannot_be_are_refused() {
    for (from, to, what) in [
        ("safe = 0 }", "}", "io.modbus.plc.signals[0].safe: missing"),
        ("safe = 0 }", "safe = 0.5 }", "safe = 0.5: expected a value that the output has, from min to max"),
        ("safe = 50", "safe = 101", "safe = 101: expected a value that the output has, from min to max"),
        ("\"input\", address = 16", "\"input\", address = 16, output = true, safe = 0", "for an output"),
        ("address = \"127.0.0.1:1502\"", "address = \"here\"", "address = \"here\": expected \"ADDRESS:PORT\""),
        ("port = \"modbus-line\"", "", "io.modbus.line.port: missing"),
        ("unit = 5", "unit = 5\naddress = \"127.0.0.1:1\"", "expected nothing beside port"),
        ("voltage = \"volts\"", "voltage = \"vots\"", "io.battery[0].voltage = \"vots\": expected the name"),
        ("scale = 0.01", "scale = 0", "scale = 0: expected a number other than 0"),
        ("name = \"fan\"", "name = \"horn\"", "io.modbus.line.signals[0].name = \"horn\": expected one that no other"),
        ("name = \"button\"", "name = \"fan\"", "io.gpio[0].name = \"fan\": expected one that no other signal has"),
        (
            "line = 17",
            "line = 17\n[[io.gpio]]\nname = \"b\"\nchip = \"button\"\nline = 17",
            "io.gpio[1].line = 17: expected",
        ),
        ("chip = \"button\"", "chip = \"feed\"", "io.gpio[0].line = 17: expected another one than that of [stop] gpio"),
    ] {
        assert!(IO.contains(from), "{from}");
        let feed = "\n[stop]\nsecond_way = \"gpio\"\ngpio = { chip = \"feed\", line = 17 }\n";
        let robot = format!("{ROBOT}{feed}{}", IO.replacen(from, to, 1));
        let lines = load(&robot, "", &[], MODULES).expect_err(what);
        assert!(lines.iter().any(|line| line.contains(what)), "{what}: {lines:?}");
    }
}

#[test]
fn serial_devices_are_read_and_names_that_other_signals_have_are_refused() {
    let serial = r#"[io.serial.board]
port = "io-board"
answer_end = "0D"
[[io.serial.board.requests]]
name = "temperature"
request = "'>A1?' 0D"
signals = [ { name = "inside", format = "decimal" } ]
"#;
    let robot = load(&format!("{ROBOT}{IO}{serial}"), "", &[], MODULES).unwrap().robot;
    let device = robot.io.unwrap().serial[0].device();
    assert_eq!((&*device.bus, device.baud), ("io.serial.board", Some(9600)));
    for (from, to, what) in [
        ("\"inside\"", "\"volts\"", "io.serial.board.requests[0].signals[0].name = \"volts\": expected a name that no"),
        ("port = \"io-board\"", "", "io.serial.board.port: missing, expected a device file, or address"),
        ("answer_end = \"0D\"", "", "io.serial.board.requests[0].answer_length: missing, expected its bytes"),
        ("answer_end = \"0D\"", "answer_ends = \"0D\"", "answer_ends: unknown key"),
    ] {
        assert!(serial.contains(from), "{from}");
        let text = format!("{ROBOT}{IO}{}", serial.replacen(from, to, 1));
        let lines = load(&text, "", &[], MODULES).unwrap_err();
        assert!(lines.iter().any(|line| line.contains(what)), "{what}: {lines:?}");
    }
}

#[test]
fn what_is_shown_is_shown_by_outputs_in_situations_and_patterns_that_there_are() {
    const SHOW: &str = r#"[[signals.show]]
output = "horn"
when = "reversing"
pattern = "blink 1.5 0.3"
[[signals.show]]
output = "fan"
when = "always"
pattern = "on"
value = 80
value_off = 20
"#;
    assert!(load(&format!("{ROBOT}{IO}{SHOW}"), "", &[], MODULES).is_ok());
    assert!(load(&format!("{ROBOT}{SHOW}"), "", &[], MODULES).is_err(), "there are no outputs");
    let output = "expected the name of an output of [io] that takes value and value_off";
    for (from, to, what) in [
        ("\"horn\"", "\"volts\"", output),
        ("\"horn\"", "\"hron\"", output),
        ("value = 80", "value = 101", output),
        ("value_off = 20", "value_off = -1", output),
        ("\"reversing\"", "\"backwards\"", "signals.show[0].when = \"backwards\": expected"),
        (
            "blink 1.5 0.3",
            "blink",
            "signals.show[0].pattern = \"blink\": expected \"on\", \"off\", \"blink HZ [DUTY]\"",
        ),
        ("blink 1.5 0.3", "blink 20", "no part shorter than 0.05 s"),
    ] {
        assert!(SHOW.contains(from), "{from}");
        let lines = load(&format!("{ROBOT}{IO}{}", SHOW.replacen(from, to, 1)), "", &[], MODULES).unwrap_err();
        assert!(lines.iter().any(|line| line.starts_with("robot.toml:") && line.contains(what)), "{what}: {lines:?}");
    }
}

#[test]
fn switches_need_their_bus_and_power_channels_their_controller() {
    const SWITCHES: &str = r#"[[io.w1]]
name = "light"
id = "3a-000000000007"
channel = "A"
output = true
safe = 0
[[io.w1]]
name = "hatch"
id = "3a-000000000007"
channel = "B"
[w1]
"#;
    let with = |tables: &str| load(&format!("{ROBOT}{tables}"), "", &[], MODULES);
    assert!(with(SWITCHES).is_ok(), "{:?}", with(SWITCHES).err());
    for (from, to, what) in [
        ("[w1]", "", "expected a switch of a robot with a table [w1]"),
        ("\"3a-000000000007\"", "\"28-000000000007\"", "expected a DS2413 as the kernel names it"),
        ("channel = \"B\"", "channel = \"A\"", "expected one that no other entry of this id has"),
        ("channel = \"B\"", "channel = \"C\"", "expected \"A\" or \"B\""),
        ("safe = 0", "", "io.w1[0].safe: missing"),
    ] {
        assert!(SWITCHES.contains(from), "{from}");
        let lines = with(&SWITCHES.replacen(from, to, 1)).unwrap_err();
        assert!(lines.iter().any(|line| line.contains(what)), "{what}: {lines:?}");
    }
    let power = "[[io.power]]\nname = \"stage\"\nchannel = \"audio\"\nsafe = 1\n";
    let lines = with(power).unwrap_err();
    assert!(lines.iter().any(|line| line.contains("a channel of a robot with a table [power]")), "{lines:?}");
    let lines = with(&power.replace("audio", "motors")).unwrap_err();
    assert!(lines.iter().any(|line| line.contains("expected \"monitor\" or \"audio\"")), "{lines:?}");
}

#[test]
fn power_buttons_are_outputs_that_let_go_by_themselves() {
    const POWER: &str = r#"[rs485.power]
port = "/dev/ttyS2"
transport = "two-byte"
[[rs485.power.nodes]]
name = "psc1"
address = 0x40
driver = "psc1"
rate_hz = 1
[power]
capacity_ah = 40
cells = 8
[[power.computers]]
channel = "computer1"
button = "horn"
alive = "button"
"#;
    let with = |io: &str, power: &str| load(&format!("{ROBOT}{io}{power}"), "", &[], MODULES);
    assert!(with(IO, POWER).is_ok(), "{:?}", with(IO, POWER).err());
    let button = "expected the name of an output of [io] with safe = 0 and a hold_s of at most 2";
    for (from, to, what) in [
        ("\"computer1\"", "\"motors\"", "expected \"computer1\" or \"computer2\""),
        ("\"horn\"", "\"button\"", button),
        ("\"horn\"", "\"fan\"", button),
        ("\"button\"", "\"horn\"", "expected the name of an input of [io]"),
    ] {
        assert!(POWER.contains(from), "{from}");
        let lines = with(IO, &POWER.replacen(from, to, 1)).unwrap_err();
        assert!(lines.iter().any(|line| line.contains(what)), "{what}: {lines:?}");
    }
    for (from, to) in [("safe = 0 }", "safe = 1 }"), ("safe = 0 }", "safe = 0, hold_s = 0 }")] {
        let lines = with(&IO.replacen(from, to, 1), POWER).unwrap_err();
        assert!(lines.iter().any(|line| line.contains(button)), "{to}: {lines:?}");
    }
    let lines = with(&format!("[io]\npublish_s = 5\n{IO}"), POWER).unwrap_err();
    assert!(lines.iter().any(|line| line.contains("whose publish_s is at most 2")), "{lines:?}");
    let slow = "[[io.w1]]\nname = \"slow\"\nid = \"3a-000000000007\"\nchannel = \"A\"\noutput = true\nsafe = 0\n[w1]\n";
    let lines = with(&format!("{IO}{slow}"), &POWER.replace("button = \"horn\"", "button = \"slow\"")).unwrap_err();
    assert!(lines.iter().any(|line| line.contains("at most 2, not on 1-Wire")), "{lines:?}");
    let two = format!("{POWER}[[power.computers]]\nchannel = \"computer2\"\nbutton = \"horn\"\n");
    let lines = with(IO, &two).unwrap_err();
    let what = "button = \"horn\": expected one that no other entry has";
    assert!(lines.iter().any(|line| line.contains(what)), "{lines:?}");
    // No situation presses a power button.
    let shown = format!("{POWER}[[signals.show]]\noutput = \"horn\"\nwhen = \"driving\"\npattern = \"on\"\n");
    let lines = with(IO, &shown).unwrap_err();
    let what = "expected an output that is not the power button of a computer";
    assert!(lines.iter().any(|line| line.contains(what)), "{lines:?}");
}

#[test]
fn a_guard_by_lidars_needs_one() {
    let with = |ranging: &str| format!("[guard]\nranging = {ranging:?}\n[limits]");
    for ranging in ["lidar", "sonar+lidar"] {
        let why = format!("robot.toml:12: guard.ranging = {ranging:?}: expected a robot with a table [lidar.<name>]");
        refused("[limits]", &with(ranging), &[&why]);
    }
    let lidar =
        "[lidar.front]\nmodel = \"ust-10lx\"\naddress = \"192.168.0.10:10940\"\ntheta_rad = 0.5\nview_rad = 3.0\n";
    let robot = ROBOT.replacen("[limits]", &format!("{lidar}{}", with("lidar")), 1);
    let config = load(&robot, "", &[], MODULES).unwrap();
    let guard = config.robot.guard_config();
    let [lidar] = guard.lidars() else { panic!("{guard:?}") };
    assert_eq!((lidar.name.as_str(), lidar.view, lidar.mount.theta.radians()), ("front", 3.0, 0.5));
    assert_eq!(guard.sonars(), []);
    assert!(config.critical().any(|name| name == guard::NAME));
}

#[test]
fn fields_of_the_guard_are_polygons_that_its_sensors_reach() {
    let with = |ranging: &str, field: &str| {
        format!("[guard]\nranging = {ranging:?}\nreach_m = 2.0\n[[guard.fields]]\n{field}\n[limits]")
    };
    let polygon = |corners: &str| format!("kind = \"protective\"\npolygon_m = [{corners}]");
    let name = "robot.toml:16: guard.fields[0].polygon_m";
    for (corners, why) in [
        ("[0, 0], [1, 0]", "expected a list of 3 to 64 corners [x, y] within -60 to 60"),
        (
            "[0, 0], [1, 1], [1, 0], [0, 1]",
            "expected corners one after the other around the polygon: the edge from [0] meets the one from [2]",
        ),
        // The front is at 0.75 m.
        ("[0, 0], [2.8, 0], [1, 1]", "expected corners at most reach_m, 2 m, from the robot's outline"),
    ] {
        let count = corners.matches('[').count();
        refused("[limits]", &with("sonar", &polygon(corners)), &[&format!("{name} = [{count} items]: {why}")]);
    }
    let nan = polygon("[0, 0], [1, nan], [1, 1]");
    let why = format!("{name}[1] = [2 items]: expected two numbers from -60 to 60: x, y");
    refused("[limits]", &with("sonar", &nan), &[&why]);
    let good = polygon("[0, -1], [2.7, -0.3], [0.8, -0.3], [0, -0.3]");
    let why = "expected none with ranging = \"none\": nothing would sense what is in them";
    refused("[limits]", &with("none", &good), &[&format!("robot.toml:14: guard.fields = [1 items]: {why}")]);
    let robot = ROBOT.replacen("[limits]", &with("sonar", &good), 1);
    let config = load(&robot, "", &[], MODULES).unwrap();
    let [field] = &config.robot.guard.fields[..] else { panic!("{:?}", config.robot.guard) };
    assert_eq!((field.kind, field.from, field.polygon.len()), (guard::FieldKind::Protective, 0.0, 4));
}

#[test]
fn a_lidar_whose_fields_stop_the_robot_evaluates_some() {
    let table = |model: &str, keys: &str| {
        format!("[lidar.front]\nmodel = {model:?}\naddress = \"192.168.0.10:2112\"\n{keys}\n[limits]")
    };
    let none = "expected none: only a SICK evaluates fields by itself";
    for (model, keys, why) in [
        ("ust-10lx", "stop_fields = [1]", format!("stop_fields = [1 items]: {none}")),
        ("ust-10lx", "stop_outputs = [1]", format!("stop_outputs = [1 items]: {none}")),
        (
            "sick-tim5xx",
            "stop_fields = [1]",
            "stop_fields = [1 items]: expected none: this model reports its outputs, not its fields: stop_outputs"
                .into(),
        ),
        (
            "sick-tim7xx",
            "stop_fields = [0]",
            "stop_fields = [1 items]: expected a list of integers from 1 to 48".into(),
        ),
        (
            "sick-tim7xx",
            "simulated_fields_m = [[[0, 0], [1, 0]]]",
            "simulated_fields_m[0] = [2 items]: expected a list of 3 to 64 corners [x, y] within -50 to 50".into(),
        ),
    ] {
        refused("[limits]", &table(model, keys), &[&format!("robot.toml:14: lidar.front.{why}")]);
    }
    for (model, keys) in [("sick-lms1xx", "stop_fields = [1, 2]"), ("sick-tim5xx", "stop_outputs = [1]")] {
        let robot = ROBOT.replacen("[limits]", &table(model, keys), 1);
        let config = load(&robot, "", &[], MODULES).unwrap();
        assert!(config.robot.lidar[0].stop.stops(), "{model}");
    }
    let without = ROBOT.replacen("[limits]", &table("sick-tim7xx", ""), 1);
    assert!(!load(&without, "", &[], MODULES).unwrap().robot.lidar[0].stop.stops());
}

#[test]
fn an_inertial_unit_is_on_a_bus_of_its_kind_that_it_can_share() {
    let unit = |keys: &str| format!("[imu.base]\n{keys}\n[limits]");
    let i2c = r#"expected the name of an I2C bus of this file, as "i2c.main""#;
    let can = r#"expected the name of a CAN bus of this file, as "can.main""#;
    let table = [
        ("model = \"bno055\"\nbus = \"i2c.main\"", format!("robot.toml:13: imu.base.bus = \"i2c.main\": {i2c}")),
        ("model = \"bno055\"\nbus = \"can.main\"", format!("robot.toml:13: imu.base.bus = \"can.main\": {i2c}")),
        ("model = \"xsens-mti\"\nbus = \"can.b\"", format!("robot.toml:13: imu.base.bus = \"can.b\": {can}")),
        (
            "model = \"witmotion\"\nbus = \"can.main\"",
            "robot.toml:13: imu.base.bus = \"can.main\": expected none: this model has a serial line, port".into(),
        ),
    ];
    for (keys, why) in table {
        refused("[limits]", &unit(keys), &[&why]);
    }
    let bus = |place: &str, chips: &str| format!("[i2c.main]\nbus = {place:?}\n{chips}");
    let on = |bus: String| {
        let units = "[imu.base]\nmodel = \"bno055\"\nbus = \"i2c.main\"\naddress = 0x29\n";
        let robot = ROBOT.replacen("[limits]", &format!("{units}{bus}[limits]"), 1);
        load(&robot, "", &[], MODULES)
    };
    let chips = "chips = [ { address = 0x18, driver = \"max6615\" } ]\n";
    let config = on(bus("/dev/i2c-1", chips)).unwrap();
    let device = config.robot.imu[0].device(&config.robot).unwrap();
    assert_eq!((device.bus.as_str(), device.keys.address), ("i2c.main", 0x29));
    assert!(config.modules.iter().any(|module| module.name() == drivers::imu::NAME));
    // Two lines have one master: alone it may be on them.
    let lines = "gpio:/dev/gpiochip0:2:3";
    assert!(on(bus(lines, "")).is_ok());
    let why = on(bus(lines, chips)).unwrap_err().join("\n");
    assert!(why.contains("two lines have one master"), "{why}");
    let without = load(ROBOT, "", &[], MODULES).unwrap();
    assert!(without.modules.iter().all(|module| module.name() != drivers::imu::NAME));
}
