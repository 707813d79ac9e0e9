//! A robot whose drives are files of its user, in the folder `drives`: it is homed, driven and stopped as the shipped
//! one.

use super::*;
use std::fs;

const EPOS: &str = include_str!("../../../modules/drivers/src/canbus/drives/epos.toml");
const ICLA: &str = include_str!("../../../modules/drivers/src/canbus/drives/icla.toml");
/// A wheel by its data sheet, which turns backwards.
const WHEEL: &str = "form = \"sheet\"\neds = \"wheel.dcf\"\ngear = -26\nvendor = 0x0000_00FB\n";
const HOMED: &str = "switch_rad = -0.6283\nhoming_speed_radps = 0.1745\n";

/// The shipped robot in a folder of this name, with these drives, of the propulsion and of the steering, and files.
fn robot(name: &str, drives: [&str; 2], files: &[(&str, &str)]) -> RobotLocation {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("drive-tables-{name}-{}", std::process::id()));
    let of_drives = folder.join("drives");
    fs::create_dir_all(&of_drives).unwrap();
    for (sheet, name) in [("others/maxon_epos4_50_15_node1.dcf", "wheel.dcf"), ("icla_sim.eds", "steering.eds")] {
        fs::copy(root.join("buses/canopen/eds").join(sheet), of_drives.join(name)).unwrap();
    }
    for (name, text) in files {
        fs::write(of_drives.join(name), text).unwrap();
    }
    let shipped = root.join("conf/advee");
    for file in ["modules.toml", "sim.toml"] {
        fs::copy(shipped.join(file), folder.join(file)).unwrap();
    }
    let node =
        |(id, axis, keys): (u8, &str, &str)| format!("[[can.main.nodes]]\nid = {id}\naxis = \"{axis}\"\n{keys}\n");
    let nodes = [(1, "propulsion", drives[0]), (2, "steering", drives[1])].map(node).concat();
    let robot = fs::read_to_string(shipped.join("robot.toml")).unwrap();
    let (begin, end) = (robot.find("[[can.main.nodes]]").unwrap(), robot.find("[sensors]").unwrap());
    fs::write(folder.join("robot.toml"), robot[..begin].to_owned() + &nodes + &robot[end..]).unwrap();
    RobotLocation { config: folder, ..place() }
}

/// It is homed, drives as commanded both ways, and stands when its source is silent.
fn drives(name: &str, place: &RobotLocation) {
    let mut robot = Robot::at(place, Config { seed: 1, lcm_jitter: Duration::from_micros(200), ..Config::default() });
    robot.machine.run_until(at(12.0));
    assert!(robot.motion().homed, "{name}: {}", robot.motion().reason);
    for (speed, steering) in [(0.4, 0.3), (-0.3, -0.3)] {
        robot.drive(speed, steering, 4.0);
        robot.pass(3.9);
        assert!((robot.speed() - speed).abs() < 0.005, "{name}: {} m/s, {}", robot.speed(), robot.motion().reason);
        assert!((robot.motion().speed - speed).abs() < 0.02, "{name}: {} m/s", robot.motion().speed);
        assert!((robot.motion().steering - steering).abs() < 0.01, "{name}: {} rad", robot.motion().steering);
    }
    robot.pass(2.0);
    assert_eq!(robot.speed(), 0.0, "{name}");
}

/// What refuses it before it starts.
fn refusal(place: &RobotLocation) -> String {
    let config = robot::config::Config::load(&place.config, true, &[]).unwrap();
    robot::preflight::check(place, &config, &simulator::world::World::default()).unwrap_err().to_string()
}

#[test]
fn drives_by_a_data_sheet_and_by_objects_with_one_drive_the_robot() {
    // Homed and driven by the objects of its file, and simulated by its data sheet.
    let steering = ICLA.replace("simulated = \"icla\"", "eds = \"steering.eds\"\ngear = 180");
    let files = [("wheel.toml", WHEEL), ("turn.toml", &steering)];
    let nodes = ["driver = \"wheel\"", &format!("driver = \"turn\"\n{HOMED}")];
    drives("sheet", &robot("sheet", nodes, &files));
}

#[test]
fn a_file_in_place_of_a_built_in_table_and_one_beside_it_drive_the_robot() {
    let wheel = EPOS.replace("velocity_unit", "gear = 20\nvelocity_unit");
    assert_ne!(wheel, EPOS);
    let files = [("epos.toml", wheel.as_str()), ("turn.toml", ICLA)];
    // The node's own gear counts.
    let nodes = ["driver = \"epos\"\ngear = 26", &format!("driver = \"turn\"\ngear = 180\n{HOMED}")];
    let place = robot("objects", nodes, &files);
    drives("objects", &place);
    let (_, notices) = robot::config::Config::load_with_notices(&place.config, true, &[]).unwrap();
    assert!(notices.iter().any(|line| line.ends_with("drives/epos.toml: replaces the built-in table \"epos\"")));
}

#[test]
fn a_table_of_objects_without_a_drive_to_simulate_is_refused_in_simulation() {
    let files = [("turn.toml", &*ICLA.replace("simulated = \"icla\"\n", ""))];
    let nodes = ["driver = \"epos\"\ngear = 26", &format!("driver = \"turn\"\ngear = 180\n{HOMED}")];
    let place = robot("neither", nodes, &files);
    let refused = refusal(&place);
    assert!(refused.contains("the steering drive cannot be simulated: drives/turn.toml has neither eds"), "{refused}");
}

#[test]
fn what_is_wrong_in_the_folder_is_named_with_file_and_line() {
    let files = [("turn.toml", "form = \"objects\"\nmod = 3\n"), ("wheel.toml", WHEEL)];
    let nodes = ["driver = \"epos\"\ngear = 26", &format!("driver = \"icla\"\ngear = 180\n{HOMED}")];
    let place = robot("wrong", nodes, &files);
    let lines = robot::config::Config::load(&place.config, true, &[]).unwrap_err().0;
    let named = |text: &str| lines.iter().any(|line| line.contains(text));
    assert!(named("drives/turn.toml:2: mod: unknown key, expected one of form, mode,"), "{lines:?}");
    assert!(named("drives/turn.toml:1: rpdo: missing"), "{lines:?}");
    // A sheet that is not there is named by the file that names it.
    let nodes = ["driver = \"wheel\"", &format!("driver = \"icla\"\ngear = 180\n{HOMED}")];
    let place = self::robot("no-sheet", nodes, &[("wheel.toml", &WHEEL.replace("wheel.dcf", "other.dcf"))]);
    let refused = refusal(&place);
    let expected = "drives/wheel.toml:2: can.main.nodes[0].eds = \"drives/other.dcf\": expected a data sheet: ";
    assert!(refused.contains(expected), "{refused}");
}
