//! Drives by their data sheets alone: a wheel's DCF and a steering's EDS of other makers.

use super::super::{
    Axis, BrakeControl, Cia402, Cia402Config, ConfigError, DriveMode, PropulsionDrive, SteeringDrive, VelocityUnit,
};
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

/// The source was late: its next command finds the wheel at speed, and the drive has not shown its quick stop yet.
#[test]
fn a_ramp_of_the_driver_begins_at_the_speed_of_the_wheel_also_if_the_quick_stop_has_just_begun() {
    let mode = Some(DriveMode::CyclicVelocity);
    let mut config = by_sheets();
    config.wheels[0].drive = wheel(EPOS4, Cia402Config { gear: Some(-26.0), mode, ..Cia402Config::usual() });
    let mut robot = Robot::with(Eds::parse(EPOS4).unwrap().dictionary(1), config);
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
    robot.drive(0.4, 1500);
    let rpm = (0.4 * 60.0 * -26.0 / CIRCUMFERENCE).round() as i32;
    let last = |robot: &Robot| {
        let is_it = |frame: &can::Frame| frame.id() == can::Id::Standard(0x201) && frame.data().len() == 6;
        let (_, frame) = robot.frames.iter().rev().find(|(_, frame)| is_it(frame)).expect("it was sent");
        let data = frame.data();
        (data[0], i32::from_le_bytes([data[2], data[3], data[4], data[5]]))
    };
    assert_eq!(last(&robot), (0x0F, rpm), "{}", robot.reason());
    // The drive is slow to obey.
    robot.epos.stubborn = true;
    robot.pass(220);
    assert_eq!(last(&robot), (0x02, 0));
    robot.press(0.4);
    let (word, setpoint) = last(&robot);
    assert_eq!(word, 0x0F, "{}", robot.reason());
    assert!((setpoint - rpm).abs() <= rpm.abs() / 10, "{setpoint} instead of {rpm}");
}

/// A sheet, and a robot whose wheel's brake is on the output of its drive, and needs 300 ms.
fn with_brake(mask: bool) -> (Eds, Config) {
    let release = Duration::from_millis(300);
    let mut text = String::from_utf8_lossy(EPOS4).replace("\r\n", "\n");
    if mask {
        let section = "[60FEsub2]\nParameterName=Mask\nObjectType=0x7\nDataType=0x7\nAccessType=rww\nDefaultValue=0\n";
        text = text.replace("[60FE]\nSubNumber=2", "[60FE]\nSubNumber=3");
        text = text.replace("[60FEsub1]\n", &format!("{section}PDOMapping=0\n\n[60FEsub1]\n"));
    }
    let mut config = by_sheets();
    let keys = Cia402Config {
        gear: Some(-26.0),
        brake: BrakeControl::Output,
        brake_release: release,
        ..Cia402Config::usual()
    };
    config.wheels[0].drive = wheel(text.as_bytes(), keys);
    (Eds::parse(text.as_bytes()).unwrap(), config)
}

/// The same, ready; `objects`: what is stored in the device.
fn braked(objects: &[Entry], mask: bool) -> Robot {
    let (sheet, config) = with_brake(mask);
    let mut robot = Robot::with(sheet.dictionary(1).with(objects), config);
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
    robot
}

fn output(robot: &Robot) -> i64 {
    robot.epos.node.get(0x60FE, 1).unwrap()
}

#[test]
fn a_brake_is_released_before_the_wheel_turns_and_set_before_its_drive_is_off() {
    for mask in [false, true] {
        // Another output of the drive is on.
        let mut robot = braked(&[Entry::new(0x60FE, 1, DataType::U32, Access::ReadWrite, 0x1_0000)], mask);
        // It stands without torque.
        assert_eq!(output(&robot), 0x1_0001);
        assert_eq!(robot.epos.node.get(0x60FE, 2), mask.then_some(1));
        robot.frames.clear();
        robot.drive(0.4, 1000);
        assert!(robot.moves(), "{}", robot.reason());
        assert_eq!(output(&robot), 0x1_0000);
        let rpdo = |data: &[u8]| data.starts_with(&[0x0F]) && data.len() == 6;
        let first = |found: &dyn Fn(&can::Frame) -> bool| {
            let (at, _) = robot.frames.iter().find(|(_, frame)| found(frame)).expect("it was sent");
            *at
        };
        let is = |frame: &can::Frame, id| frame.id() == can::Id::Standard(id);
        let enabled = first(&|frame| is(frame, 0x201) && rpdo(frame.data()));
        let moved = first(&|frame| is(frame, 0x201) && rpdo(frame.data()) && frame.data()[2..] != [0; 4]);
        let released = first(&|frame| is(frame, 0x601) && frame.data() == [0x23, 0xFE, 0x60, 1, 0, 0, 1, 0]);
        assert!(enabled < released && moved.since(released) >= Duration::from_millis(300), "{:?}", robot.reason());
        assert!(moved.since(released) < Duration::from_millis(350), "{:?}", moved.since(released));
        // It is a holding brake: a stop is the drive's, with torque.
        robot.pass(1000);
        assert_eq!((robot.epos.power.state(), output(&robot)), (PowerState::QuickStopActive, 0x1_0000));

        robot.frames.clear();
        let state = State::Terminate as i8;
        robot.bench.message(common::CmdState { module: NAME.into(), state, manual: true, ..Default::default() });
        robot.exchange();
        robot.pass(1000);
        assert!(robot.ended);
        assert_eq!((robot.epos.power.state(), output(&robot)), (PowerState::SwitchOnDisabled, 0x1_0001));
        let at = |found: &dyn Fn(&can::Frame) -> bool| robot.frames.iter().position(|(_, frame)| found(frame));
        let set = at(&|frame| is(frame, 0x601) && frame.data() == [0x23, 0xFE, 0x60, 1, 1, 0, 1, 0]);
        // Neither enabled nor in quick stop: bits 1 to 3.
        let off = at(&|frame| is(frame, 0x201) && !matches!(frame.data()[0] & 0x0E, 0x0E | 0x02 | 0x0A));
        assert!(set.is_some() && set < off, "{set:?}, {off:?}");
    }
}

#[test]
fn a_brake_that_is_not_known_to_be_released_holds_the_robot() {
    // The output cannot be written, although the sheet says so.
    let mut robot = braked(&[Entry::new(0x60FE, 1, DataType::U32, Access::ReadOnly, 1)], false);
    robot.drive(0.4, 800);
    assert_eq!(robot.epos.power.state(), PowerState::OperationEnabled, "{}", robot.reason());
    assert_eq!(robot.epos.node.get(0x60FF, 0), Some(0));
    robot.drive(0.4, 400);
    assert_eq!(robot.epos.power.state(), PowerState::QuickStopActive);
    assert!(robot.reason().contains("does not release its brake"), "{}", robot.reason());
    assert_eq!(robot.holds().first().map(|hold| hold.0), Some(Hold::DriveStuck));
    assert!(robot.errors.iter().any(|(fault, _)| *fault == Fault::DriveFault), "{:?}", robot.errors);
    robot.drive(0.4, 3000);
    assert!(!robot.moves());

    // Another program sets it while the robot drives: it is released again, after a stop.
    let mut robot = braked(&[], false);
    robot.drive(0.4, 1500);
    assert!(robot.moves(), "{}", robot.reason());
    robot.epos.node.set(0x60FE, 1, 1);
    let again = (0..24).find(|_| {
        robot.drive(0.4, 50);
        output(&robot) == 0
    });
    assert!(again.is_some(), "it is read once a second");
    assert_eq!(robot.epos.node.get(0x60FF, 0), Some(0), "its time of release passes anew");
    robot.drive(0.4, 600);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_brake_is_not_set_while_the_wheel_rolls_without_torque() {
    let mut robot = braked(&[], false);
    robot.drive(0.4, 1500);
    assert!(robot.moves());
    // It is in fault, and rolls on.
    robot.epos.stubborn = true;
    let now = robot.bench.now();
    robot.epos.fault(now, 0x2310);
    robot.pass(3000);
    assert_ne!(robot.epos.node.get(0x606C, 0), Some(0));
    assert_eq!(output(&robot), 0);
    robot.epos.node.set(0x606C, 0, 0);
    robot.pass(1000);
    assert_eq!(output(&robot), 1);
    // Another program releases it, and the wheel rolls away: now it is too late to set it.
    robot.epos.node.set(0x606C, 0, -500);
    robot.pass(500);
    robot.epos.node.set(0x60FE, 1, 0);
    robot.pass(3000);
    assert_eq!(output(&robot), 0);
    robot.epos.node.set(0x606C, 0, 0);
    robot.pass(2000);
    assert_eq!(output(&robot), 1);
}

/// A robot on a slope rolls as soon as its drive has no torque: to read the outputs first would take too long.
#[test]
fn a_brake_is_set_at_once_where_its_drive_loses_its_torque_at_standstill() {
    for mask in [false, true] {
        let mut robot = braked(&[Entry::new(0x60FE, 1, DataType::U32, Access::ReadWrite, 0x1_0000)], mask);
        robot.drive(0.4, 1000);
        robot.pass(1500);
        assert_eq!((robot.epos.power.state(), output(&robot)), (PowerState::QuickStopActive, 0x1_0000));
        robot.frames.clear();
        let now = robot.bench.now();
        robot.epos.fault(now, 0x2310);
        robot.pass(50);
        let access = |first: u8| {
            let is_it = |frame: &can::Frame| {
                frame.id() == can::Id::Standard(0x601) && frame.data().starts_with(&[first, 0xFE, 0x60])
            };
            robot.frames.iter().position(|(_, frame)| is_it(frame))
        };
        let (set, read) = (access(0x23), access(0x40));
        assert!(set.is_some() && set < read, "{set:?}, {read:?}");
        assert_eq!(output(&robot), 0x1_0001);
    }
}

/// With a logic supply of its own the drive stays in Quick Stop Active, and holds nothing.
#[test]
fn a_brake_is_set_at_standstill_while_the_motors_feed_is_cut() {
    let (sheet, config) = with_brake(false);
    let mut robot = Robot::with(sheet.dictionary(1), Config { has_pause_line: true, ..config });
    let live = |robot: &mut Robot, engaged: bool, speed: Option<f64>, ms: u32| {
        for _ in 0..ms / 50 {
            let source = if engaged { "button" } else { "" };
            robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged, source: source.into() });
            if let Some(speed) = speed {
                robot.command(speed, 0.0);
            }
            robot.pass(50);
        }
    };
    live(&mut robot, false, None, 3000);
    assert!(robot.motion().homed, "{}", robot.reason());
    live(&mut robot, false, Some(0.4), 1000);
    assert!(robot.moves(), "{}", robot.reason());
    live(&mut robot, true, None, 500);
    assert_eq!((robot.epos.power.state(), output(&robot)), (PowerState::QuickStopActive, 1));
    // It is released again before the next motion.
    live(&mut robot, false, None, 500);
    robot.press(0.4);
    live(&mut robot, false, Some(0.4), 1000);
    assert!(robot.moves(), "{}", robot.reason());
    assert_eq!(output(&robot), 0);
}

#[test]
fn a_brake_output_is_one_of_the_sheet() {
    let with = |sheet: &[u8]| {
        let keys = Cia402Config {
            gear: Some(26.0),
            velocity_unit: VelocityUnit::Rpm,
            brake: BrakeControl::Output,
            ..Cia402Config::usual()
        };
        let mut config = config();
        (config.stop.second_way, config.has_pause_line) = (SecondWay::Power, true);
        config.wheels[0].drive = wheel(sheet, keys);
        refusal(config)
    };
    assert_eq!(with(EPOS4), None);
    assert_eq!(with(EPOS), Some(Refusal { index: 0x60FE, sub: 1, reason: Reason::Missing }));
    let fixed = String::from_utf8_lossy(EPOS4).replace("\r\n", "\n");
    let begin = fixed.find("[60FEsub1]\n").unwrap();
    let fixed = fixed[..begin].to_owned() + &fixed[begin..].replacen("AccessType=rww", "AccessType=ro", 1);
    let refused = Refusal { index: 0x60FE, sub: 1, reason: Reason::NotWritable };
    assert_eq!(with(fixed.as_bytes()), Some(refused));
}
