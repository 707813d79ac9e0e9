//! Drives by their data sheets alone: a wheel's DCF and a steering's EDS of other makers.

use super::super::{Axis, Cia402, Cia402Config, ConfigError, PropulsionDrive, SteeringDrive, VelocityUnit};
use super::*;
use canopen::axis::status;
use canopen::dictionary::{Access, DataType, Entry};
use canopen::drives::derive::{Reason, Refusal};
use canopen::eds::Eds;
use settings::Section as _;
use std::sync::Arc;

const EPOS4: &[u8] = include_bytes!("../../../../../buses/canopen/eds/others/maxon_epos4_50_15_node1.dcf");
const ICLA: &[u8] = include_bytes!("../../../../../buses/canopen/eds/icla_sim.eds");
const EPOS: &[u8] = include_bytes!("../../../../../buses/canopen/eds/epos_sim.eds");
/// m.
const CIRCUMFERENCE: f64 = 0.6283;

fn drive(sheet: &[u8], keys: Cia402Config) -> Cia402 {
    Cia402 { keys, sheet: Some(Arc::new(Eds::parse(sheet).unwrap())), motor_rpm_max: None }
}

fn without_sheet() -> Cia402 {
    Cia402 { keys: Cia402Config::usual(), sheet: None, motor_rpm_max: None }
}

fn wheel(sheet: &[u8], keys: Cia402Config) -> PropulsionDrive {
    PropulsionDrive::Cia402 { drive: drive(sheet, keys), circumference: CIRCUMFERENCE }
}

/// Both axes by sheets; the wheel states its units, the steering does not.
fn by_sheets() -> Config {
    let usual = Cia402Config { gear: Some(-26.0), ..Cia402Config::usual() };
    let steering = Cia402Config {
        gear: Some(180.0),
        counts_per_turn: Some(4096),
        velocity_unit: VelocityUnit::Rpm,
        homed_bit: Some(15),
        ..Cia402Config::usual()
    };
    let mut config = config();
    config.wheels[0].drive = wheel(EPOS4, usual);
    steering_of(&mut config).drive = SteeringDrive::Cia402(drive(ICLA, steering));
    config
}

fn refusal(config: Config) -> Option<Refusal> {
    match Canbus::new(config).err() {
        Some(ConfigError::Drive { axis: Axis::Propulsion, refusal }) => Some(refusal),
        Some(other) => panic!("{other}"),
        None => None,
    }
}

#[test]
fn a_robot_of_other_drives_is_homed_driven_and_stopped() {
    let mut robot = Robot::with(Eds::parse(EPOS4).unwrap().dictionary(1), by_sheets());
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
    assert_eq!(robot.icla.node.get(0x607C, 0), Some((-0.628 * 4096.0 * 180.0 / core::f64::consts::TAU).round() as i64));
    robot.drive(0.4, 500);
    // 60 rpm are a turn per second: 0.4 m/s of a wheel behind a gear that turns the other way.
    let rpm = (0.4 * 60.0 * -26.0 / CIRCUMFERENCE).round() as i64;
    assert_eq!((robot.epos.node.get(0x60FF, 0), robot.epos.node.get(0x6060, 0)), (Some(rpm), Some(3)));
    assert!(robot.moves(), "{}", robot.reason());
    assert!((robot.motion().speed - 0.4).abs() < 1e-3, "{}", robot.motion().speed);
    robot.command(0.4, 0.2);
    robot.pass(100);
    let counts = (0.2 * 4096.0 * 180.0 / core::f64::consts::TAU).round() as i64;
    assert_eq!(robot.icla.node.get(0x607A, 0), Some(counts));
    // Silence of the source: by the option code that was written, the drive stays in Quick Stop Active.
    robot.pass(400);
    assert_eq!(robot.epos.node.get(0x605A, 0), Some(6));
    assert_eq!(robot.epos.power.state(), PowerState::QuickStopActive);
    assert_eq!(robot.notes.iter().filter(|note| note.contains("second way")).count(), 0);
    assert_ne!(robot.icla.node.get(0x6041, 0).unwrap() as u16 & status::REMOTE, 0);
}

#[test]
fn an_option_that_another_program_changes_is_written_again() {
    let mut robot = Robot::with(Eds::parse(EPOS4).unwrap().dictionary(1), by_sheets());
    robot.pass(3000);
    robot.epos.node.set(0x6007, 0, 0);
    robot.pass(11_000);
    assert_eq!(robot.epos.node.get(0x6007, 0), Some(3));
    assert!(robot.errors.iter().any(|(fault, _)| *fault == Fault::DriveParameter), "{:?}", robot.errors);
}

#[test]
fn a_drive_that_does_not_stop_by_itself_needs_a_second_way_or_its_manual() {
    let keys = Cia402Config { gear: Some(26.0), velocity_unit: VelocityUnit::Rpm, ..Cia402Config::usual() };
    let with = |keys: &Cia402Config, second_way| {
        let mut config = config();
        config.wheels[0].drive = wheel(EPOS, keys.clone());
        config.stop.second_way = second_way;
        config.has_pause_line = second_way == SecondWay::Power;
        config
    };
    let missing = Refusal { index: 0x605A, sub: 0, reason: Reason::Missing };
    assert_eq!(refusal(with(&keys, SecondWay::None)), Some(missing));
    assert_eq!(refusal(with(&keys, SecondWay::Power)), None);
    let manual = Cia402Config { stops_without: vec![0x605A, 0x605E, 0x6007], ..keys.clone() };
    assert_eq!(refusal(with(&manual, SecondWay::None)), None);
    let fast = Cia402Config { gear: Some(260.0), ..keys.clone() };
    let reason = Reason::OutOfLimits { value: 29_795, low: 1, high: 25_000 };
    let expected = Refusal { index: 0x607F, sub: 0, reason };
    assert_eq!(refusal(with(&fast, SecondWay::Power)), Some(expected));
    // What it lacks is told at the start.
    let mut robot = Robot::with(epos::dictionary(1), with(&keys, SecondWay::Power));
    robot.pass(1);
    let told: Vec<_> = robot.notes.iter().filter(|note| note.contains("relies on the second way to stop")).collect();
    assert_eq!(told.len(), 3, "{:?}", robot.notes);
    let mut without = by_sheets();
    without.wheels[0].drive =
        PropulsionDrive::Cia402 { drive: Cia402 { keys, ..without_sheet() }, circumference: CIRCUMFERENCE };
    assert!(matches!(Canbus::new(without).err(), Some(ConfigError::NoSheet(Axis::Propulsion))));
}

/// A drive that permits less than the limits demand would bound the speed in silence.
#[test]
fn the_speed_that_a_drive_permits_its_motor_is_compared_at_each_boot_up_or_written() {
    let permits = |rpm| {
        let stored = Entry::new(0x6080, 0, DataType::U32, Access::ReadWrite, rpm);
        Eds::parse(EPOS4).unwrap().dictionary(1).with(&[stored])
    };
    let boots = |robot: &mut Robot| {
        robot.pass(3000);
        let refused = robot.errors.iter().any(|(fault, _)| *fault == Fault::DriveMismatch);
        (robot.motion().homed, refused)
    };
    // 1.2 m/s, 26 turns of the motor in 0.6283 m: 2979.5 rpm.
    let mut slow = Robot::with(permits(2979), by_sheets());
    assert_eq!(boots(&mut slow), (false, true));
    let words = "permits 2979 rpm of its motor (0x6080), the limits of the robot demand 2980 rpm";
    assert!(slow.reason().contains(words), "{}", slow.reason());
    assert_eq!(boots(&mut Robot::with(permits(2980), by_sheets())), (true, false));

    let mut config = by_sheets();
    let PropulsionDrive::Cia402 { drive, .. } = &mut config.wheels[0].drive else { panic!() };
    drive.motor_rpm_max = Some(3000.7);
    let mut written = Robot::with(permits(1300), config);
    assert_eq!(boots(&mut written), (true, false));
    assert_eq!(written.epos.node.get(0x6080, 0), Some(3000));
    // It is read back like the ramps.
    written.epos.node.set(0x6080, 0, 100);
    written.pass(11_000);
    assert_eq!(written.epos.node.get(0x6080, 0), Some(3000));
}
