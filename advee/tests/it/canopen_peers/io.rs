//! Robot with a device of CiA 401: `examples/canopen_io.py` on CANopen for Python, by the tables of
//! `examples/canopen_io.toml`, and two wheels of a foreign data sheet.

use super::sheets::{self, Command, Drives};
use crate::support::{self, Robot, workspace};
use messages::Hold;
use std::fs;

const NODE: u8 = 20;
const WHEEL: &str = "ros2_cia402_slave.eds";
/// Time after which a wheel is commanded to stop when the device is gone, s: its heartbeat is missing for 0.3 s.
const LOST_WITHIN: f64 = 0.5;
/// The same after its input has opened, s: by its TPDO.
const OPEN_WITHIN: f64 = 0.2;

#[test]
fn a_device_of_cia_401_stops_the_robot_by_its_input_and_by_its_silence_and_takes_its_output() {
    support::undisturbed(|| {
        let _skipped = stopped_by_its_device();
    });
}

fn stopped_by_its_device() -> Option<()> {
    let (sheet, given) = (workspace().join(sheets::FOLDER).join(WHEEL), sheets::given(WHEEL));
    let folder = sheets::robot(&sheet, given);
    let tables = fs::read_to_string(workspace().join("examples/canopen_io.toml")).expect("the example");
    let robot_toml = folder.join("robot.toml");
    let own = fs::read_to_string(&robot_toml).expect("a file");
    fs::write(&robot_toml, own + &tables).expect("a file");

    let mut robot = Robot::of(&folder);
    let config = folder.to_str().expect("UTF-8");
    let mut drives = Drives::start(robot.port, &[1, 2], &sheet)?.expect("CANopen for Python loads it");
    let bus = format!("udp:239.74.163.2:{}", ::robot::topology::can_port_beside(robot.port));
    let mut device = Drives::run("examples/canopen_io.py", &[bus, NODE.to_string()], 1)?.expect("it starts");
    device.until(NODE, "operational", |line| line.text == "nmt operational");

    // At the start the gate is open.
    robot.until("the open gate", 20.0, |view| view.causes().contains(&Hold::PauseInput));
    device.script.say("input 0 1");
    robot.until("the closed gate", 20.0, |view| !view.causes().contains(&Hold::PauseInput));

    let forward = sheets::velocities(given, 0.2, 0.0);
    let drive = ["--config", config, "drive", "0.2", "0", "--for", "60"];
    let mut command = Command(robot.spawn(&drive));
    drives.until_velocity(1, forward[0]);

    // It opens while the robot drives: a stop that does not end by itself.
    drives.anew();
    device.anew();
    device.script.say("input 0 0");
    let opened = device.until(NODE, "its input", |line| line.text == "inputs 0").at;
    for node in [1, 2] {
        let stopped = drives.until(node, "quick stop", |line| line.text == "state quick stop active").at;
        assert!(stopped - opened <= OPEN_WITHIN, "node {node} stopped after {} s", stopped - opened);
        drives.until(node, "standing", |line| line.number("velocity") == Some(0));
    }
    robot.until("the open gate", 5.0, |view| view.causes().contains(&Hold::PauseInput));
    drives.anew();
    device.script.say("input 0 1");
    robot.until("the latched PAUSE", 5.0, |view| view.causes().contains(&Hold::PauseLatched));
    robot.pass(0.5);
    drives.read();
    assert!(!drives.has(|line| line.number("target").is_some_and(|target| target != 0)), "it resumes by itself");
    support::signal(command.0.id() as i32, "INT");
    command.0.wait().expect("it ends");

    // An output, as long as somebody commands it.
    device.anew();
    let light = Command(robot.spawn(&["--config", config, "io", "warning_light", "1", "--for", "1"]));
    device.until(NODE, "the light", |line| line.text == "outputs 1");
    device.until(NODE, "its safe value", |line| line.text == "outputs 0");
    drop(light);

    // It dies while the robot drives again.
    let _command = Command(robot.spawn(&drive));
    drives.until_velocity(1, forward[0]);
    drives.anew();
    let died = sheets::monotonic();
    drop(device);
    for node in [1, 2] {
        let stopped = drives.until(node, "quick stop", |line| line.text == "state quick stop active").at;
        assert!(stopped - died <= LOST_WITHIN, "node {node} stopped after {} s", stopped - died);
        drives.until(node, "standing", |line| line.number("velocity") == Some(0));
    }
    robot.until("its input is unknown", 5.0, |view| view.causes().contains(&Hold::PauseInputUnknown));
    robot.until("the loss is reported", 10.0, |view| {
        view.errors.iter().any(|error| error.message.contains("canopen.module (node 20)"))
    });
    drop(robot);
    fs::remove_dir_all(&folder).expect("the folder is there");
    Some(())
}
