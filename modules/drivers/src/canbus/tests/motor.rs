//! Current, torque, temperature and load of the drives.

use super::super::{Cia402, Cia402Config};
use super::*;
use canopen::eds::Eds;
use messages::lowlevel::{Axis as Row, Wheel};
use settings::Section as _;
use std::sync::Arc;

const EPOS4: &str = include_str!("../../../../../buses/canopen/eds/others/maxon_epos4_50_15_node1.dcf");
/// SDO read of 0x6078:0.
const READ_CURRENT: [u8; 8] = [0x40, 0x78, 0x60, 0, 0, 0, 0, 0];

impl Robot {
    fn rows(&self) -> (Vec<Row>, Vec<Wheel>) {
        (self.axes.axes.clone(), self.wheels.wheels.clone())
    }

    fn asked(&self, data: [u8; 8]) -> usize {
        self.frames.iter().filter(|(_, frame)| frame.data() == data).count()
    }
}

#[test]
fn the_current_of_the_epos_is_published_and_a_drive_without_one_has_none() {
    let mut robot = Robot::ready();
    robot.epos.node.set(0x6078, 0, -2500);
    robot.drive(0.4, 1000);
    let (axes, wheels) = robot.rows();
    assert_eq!((axes[0].name.as_str(), axes[0].current), ("propulsion", -2.5));
    // Its continuous current limit, 0x6410:1, is 5 A by default.
    assert_eq!((wheels[0].current, wheels[0].load), (-2.5, 0.5));
    let speed = 0.4 / 0.8 * core::f64::consts::TAU;
    assert!((wheels[0].speed - speed).abs() < 0.01 && wheels[0].steering.is_nan(), "{wheels:?}");
    assert!([wheels[0].torque, wheels[0].temperature, wheels[0].rotation].iter().all(|value| value.is_nan()));
    assert_eq!((axes[1].name.as_str(), wheels[1].name.as_str()), ("steering", "steering"));
    assert!(axes[1].current.is_nan() && wheels[1].current.is_nan() && wheels[1].load.is_nan());
    assert!(wheels[1].steering.abs() < 0.01 && wheels[1].speed.is_nan());
}

#[test]
fn it_is_asked_for_five_times_a_second_at_most_and_unknown_of_a_lost_drive() {
    let mut robot = Robot::ready();
    robot.epos.node.set(0x6078, 0, 1000);
    robot.pass(1000);
    robot.frames.clear();
    robot.drive(0.4, 2000);
    let asked = robot.asked(READ_CURRENT);
    assert!((5..=10).contains(&asked), "{asked}");
    robot.epos.alive = false;
    robot.pass(1000);
    let (axes, wheels) = robot.rows();
    assert!(axes[0].nmt_state == -1 && axes[0].current.is_nan() && wheels[0].load.is_nan());
    robot.epos.alive = true;
    robot.pass(4000);
    assert_eq!(robot.rows().0[0].current, 1.0);
}

/// The wheel on a drive by its sheet, of which a device is made after `change`.
fn by_sheet(change: fn(String) -> String) -> Robot {
    let sheet = Eds::parse(EPOS4.as_bytes()).unwrap();
    let keys = Cia402Config {
        gear: Some(-26.0),
        current_object: Some(0x30_D102),
        temperature_object: Some(0x32_0101),
        ..Cia402Config::usual()
    };
    let mut config = config();
    let drive = Cia402 { keys, sheet: Some(Arc::new(sheet)), motor_rpm_max: None };
    config.wheels[0].drive = PropulsionDrive::Cia402 { drive, circumference: 0.8 };
    let device = Eds::parse(change(EPOS4.to_owned()).as_bytes()).unwrap();
    Robot::with(device.dictionary(1), config)
}

#[test]
fn a_drive_by_its_sheet_has_torque_of_the_profile_and_what_its_manual_names() {
    let mut robot = by_sheet(|sheet| sheet);
    for (index, sub, value) in [(0x30D1, 2, 3200), (0x3201, 1, 415), (0x6076, 0, 400), (0x6077, 0, -250)] {
        robot.epos.node.set(index, sub, value);
    }
    robot.pass(5000);
    let (axes, wheels) = robot.rows();
    assert_eq!((axes[0].current, wheels[0].current, wheels[0].temperature), (3.2, 3.2, 41.5));
    // A quarter of 0.4 N m; the load is that of the torque, because the sheet has no rated current.
    assert_eq!((wheels[0].torque, wheels[0].load), (-0.1, 0.25));
}

#[test]
fn an_object_that_the_drive_refuses_is_asked_for_once_and_the_others_go_on() {
    let mut robot = by_sheet(|sheet| sheet.replace("[30D1sub2]", "[30D1sub9]"));
    robot.epos.node.set(0x3201, 1, 415);
    robot.pass(6000);
    let (axes, wheels) = robot.rows();
    assert!(axes[0].current.is_nan() && robot.motion().homed, "{}", robot.reason());
    assert_eq!(wheels[0].temperature, 41.5);
    assert_eq!(robot.asked([0x40, 0xD1, 0x30, 2, 0, 0, 0, 0]), 1);
    let told = "propulsion drive (node 1) does not give 0x30D1:2 (current): it is unknown";
    assert_eq!(robot.notes.iter().filter(|note| *note == told).count(), 1, "{:?}", robot.notes);
}

#[test]
fn an_object_that_the_sheet_does_not_have_refuses_the_drive() {
    let sheet = Some(Arc::new(Eds::parse(EPOS4.as_bytes()).unwrap()));
    let keys = Cia402Config { gear: Some(-26.0), temperature_object: Some(0x5F_FF01), ..Cia402Config::usual() };
    let mut config = config();
    let drive = Cia402 { keys, sheet, motor_rpm_max: None };
    config.wheels[0].drive = PropulsionDrive::Cia402 { drive, circumference: 0.8 };
    let refused = Canbus::new(config).err().map(|error| error.to_string());
    assert!(refused.as_ref().is_some_and(|why| why.contains("0x5FFF:1")), "{refused:?}");
}
