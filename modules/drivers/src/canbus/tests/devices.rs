//! CANopen devices with inputs and outputs: read, written, lost, and an input that stops the robot.

use super::*;
use crate::io::{Canopen, CanopenKeys, Format, ObjectKeys, ObjectKind};
use canopen::Dictionary;
use canopen::dictionary::{Access, DataType, Entry};
use messages::lowlevel::{CmdNodeIo, DataNodeIo, NodeTarget};

const NODE: u8 = 5;

fn signal(name: &str, kind: ObjectKind, channel: u16) -> ObjectKeys {
    ObjectKeys { name: name.into(), kind, channel: Some(channel), ..ObjectKeys::usual() }
}

/// An I/O module with an emergency stop, a lamp that is on while nobody commands it, and a measured level.
fn plc(pdo: bool) -> Canopen {
    let mut lamp = signal("lamp", ObjectKind::DigitalOut, 1);
    lamp.limits.safe = Some(1.0);
    let level = ObjectKeys { scale: 0.01, ..signal("level", ObjectKind::AnalogueIn, 0) };
    let charge = ObjectKeys { index: Some(0x2081), format: Format::U8, ..signal("charge", ObjectKind::Object, 0) };
    let charge = ObjectKeys { channel: None, scale: 0.01, ..charge };
    let signals = vec![signal("estop", ObjectKind::DigitalIn, 3), lamp, level, charge];
    Canopen { name: "canopen.plc".into(), keys: CanopenKeys { node: NODE, pdo, signals, ..CanopenKeys::usual() } }
}

fn dictionary(profile: i64) -> Dictionary {
    let number = |index, sub, data_type, value| Entry::new(index, sub, data_type, Access::ReadWrite, value);
    Dictionary::new(NODE)
        .with(&[
            number(0x1000, 0, DataType::U32, profile),
            number(0x1016, 1, DataType::U32, 0),
            number(0x1017, 0, DataType::U16, 0),
            number(0x1029, 1, DataType::U8, 0),
            number(0x2081, 0, DataType::U8, 87),
            number(0x6000, 1, DataType::U8, 0x08).mappable(),
            number(0x6200, 1, DataType::U8, 0),
            number(0x6206, 1, DataType::U8, 0),
            number(0x6207, 1, DataType::U8, 0),
            number(0x6401, 1, DataType::I16, -150).mappable(),
            number(0x6423, 0, DataType::Bool, 0),
        ])
        .with_tpdo(1, 0x180, &[0x6000_0108], false)
        .with_tpdo(2, 0x280, &[0x6401_0110], false)
}

/// The robot with this device; `stops`: its emergency stop is an input of `[stop]`.
fn robot(device: Canopen, profile: i64, stops: bool) -> Robot {
    let input = StopInput { signal: Some("estop".into()), axis: None, bit: None };
    let stop = Stop { inputs: if stops { vec![input] } else { Vec::new() }, ..config().stop };
    let mut robot = Robot::with(epos::dictionary(1), Config { devices: vec![device], stop, ..config() });
    let mut node = Node::new(dictionary(profile), MS);
    node.power_on(robot.bench.now());
    robot.output = Some(node);
    robot
}

/// Another device takes its place.
fn replace(robot: &mut Robot, dictionary: Dictionary) {
    let mut node = Node::new(dictionary, MS);
    node.power_on(robot.bench.now());
    robot.output = Some(node);
}

/// A frame of another node under the identifier of its first TPDO.
fn foreign_tpdo(robot: &mut Robot, byte: u8) {
    robot.bench.can(PortId(0), can::Frame::standard(0x180 + u16::from(NODE), &[byte]));
    robot.exchange();
}

/// A value, NaN while it is unknown.
fn value(robot: &Robot, name: &str) -> f64 {
    let message: &DataNodeIo = robot.nodes.as_ref().expect("ten times a second");
    message.values.iter().find(|value| value.name == name).expect("all signals").value
}

fn order(robot: &mut Robot, name: &str, target: f64) {
    let outputs = vec![NodeTarget { name: name.into(), target }];
    robot.bench.message(CmdNodeIo { timestamp: 0, outputs });
    robot.exchange();
}

fn set(robot: &mut Robot, index: u16, sub: u8, value: i64) {
    robot.output.as_mut().unwrap().set(index, sub, value);
}

fn get(robot: &Robot, index: u16, sub: u8) -> Option<i64> {
    robot.output.as_ref().unwrap().get(index, sub)
}

#[test]
fn inputs_are_read_with_and_without_pdos_and_outputs_follow_and_fall_back() {
    for pdo in [true, false] {
        let mut robot = robot(plc(pdo), 0x000F_0191, false);
        robot.pass(3000);
        assert!(robot.motion().homed, "{}", robot.reason());
        let all = ["estop", "lamp", "level", "charge"].map(|name| value(&robot, name));
        assert_eq!(all, [1.0, 1.0, -1.5, 0.87], "{pdo}");
        assert_eq!(get(&robot, 0x6423, 0), Some(i64::from(pdo)));
        assert_eq!([0x6206, 0x6207, 0x6200].map(|index| get(&robot, index, 1)), [Some(0xFF), Some(2), Some(2)]);
        set(&mut robot, 0x6000, 1, 0);
        let begin = robot.bench.now();
        while value(&robot, "estop") == 1.0 {
            robot.pass(1);
        }
        let took = robot.bench.now().since(begin);
        let bound = if pdo { Duration::from_millis(12) } else { Duration::from_millis(115) };
        assert!(took <= bound, "{pdo}: {took:?}");
        order(&mut robot, "lamp", 0.0);
        robot.pass(20);
        assert_eq!((get(&robot, 0x6200, 1), value(&robot, "lamp")), (Some(0), 0.0));
        robot.pass(950);
        assert_eq!(get(&robot, 0x6200, 1), Some(0));
        robot.pass(100);
        assert_eq!(get(&robot, 0x6200, 1), Some(2), "its safe value, one second after the last order");
    }
}

#[test]
fn an_input_of_stop_that_opens_is_silent_or_missing_stops_the_robot() {
    for pdo in [true, false] {
        let mut robot = robot(plc(pdo), 0x0191, true);
        robot.pass(4000);
        robot.press(0.4);
        robot.drive(0.4, 300);
        assert!(robot.moves(), "{}", robot.reason());
        set(&mut robot, 0x6000, 1, 0);
        let begin = robot.bench.now();
        while robot.holds().first().is_none_or(|(hold, _)| *hold != Hold::PauseInput) {
            robot.command(0.4, 0.0);
            robot.pass(1);
        }
        let took = robot.bench.now().since(begin);
        let bound = if pdo { Duration::from_millis(5) } else { Duration::from_millis(105) };
        assert!(took <= bound, "{pdo}: {took:?}");
        set(&mut robot, 0x6000, 1, 8);
        robot.drive(0.4, 1000);
        // And the source must send zero first, as it went on commanding.
        assert_eq!(robot.holds(), [(Hold::PauseLatched, ""), (Hold::NotReleased, "test")]);
        robot.press(0.4);
        robot.drive(0.4, 300);
        assert!(robot.moves(), "{}", robot.reason());
        // It is unplugged.
        robot.output.as_mut().unwrap().power_off();
        let begin = robot.bench.now();
        while robot.holds().first() != Some(&(Hold::PauseInputUnknown, "io.estop")) {
            robot.command(0.4, 0.0);
            robot.pass(1);
        }
        let took = robot.bench.now().since(begin);
        assert!(took <= Duration::from_millis(501), "{took:?}");
        robot.pass(200);
        assert!(value(&robot, "level").is_nan() && robot.errors.contains(&(Fault::IoDeviceLost, Severity::Error)));
        let now = robot.bench.now();
        robot.output.as_mut().unwrap().power_on(now);
        robot.pass(3000);
        assert_eq!((value(&robot, "level"), robot.holds()), (-1.5, vec![(Hold::PauseLatched, "")]));
    }
}

#[test]
fn another_device_is_refused_and_its_input_never_lets_the_robot_move() {
    let mut robot = robot(plc(true), 0x0192, true);
    robot.pass(3000);
    robot.press(0.4);
    robot.drive(0.4, 500);
    assert!(robot.holds().contains(&(Hold::PauseInputUnknown, "io.estop")) && !robot.moves(), "{:?}", robot.holds());
    assert!(robot.errors.contains(&(Fault::IoDeviceLost, Severity::Error)) && value(&robot, "estop").is_nan());
}

#[test]
fn a_tpdo_or_an_answer_of_another_length_is_dropped_and_reported() {
    let mut robot = robot(plc(true), 0x0191, true);
    robot.pass(3000);
    for len in [0, 2, 8] {
        let frame = can::Frame::standard(0x180 + u16::from(NODE), &[0; 8][..len]);
        robot.bench.can(PortId(0), frame);
        robot.exchange();
    }
    robot.pass(50);
    assert_eq!((value(&robot, "estop"), robot.holds().contains(&(Hold::PauseInput, "io.estop"))), (1.0, false));
    assert!(robot.errors.contains(&(Fault::CanMalformed, Severity::Warning)), "{:?}", robot.errors);
    // The object is another one: four bytes.
    replace(&mut robot, dictionary(0x0191).with(&[Entry::new(0x6401, 1, DataType::I32, Access::ReadOnly, 7)]));
    robot.pass(3000);
    assert!(value(&robot, "level").is_nan() && value(&robot, "estop") == 1.0);
    assert!(robot.errors.contains(&(Fault::IoDeviceRefused, Severity::Error)));
}

#[test]
fn a_digital_input_of_another_length_is_not_known() {
    let mut robot = robot(plc(false), 0x0191, true);
    replace(&mut robot, dictionary(0x0191).with(&[Entry::new(0x6000, 1, DataType::U32, Access::ReadOnly, 8)]));
    robot.pass(3000);
    assert!(robot.holds().contains(&(Hold::PauseInputUnknown, "io.estop")) && value(&robot, "estop").is_nan());
    assert!(robot.errors.contains(&(Fault::IoDeviceRefused, Severity::Error)));
}

#[test]
fn a_device_that_restarts_at_once_stops_the_robot() {
    let mut robot = robot(plc(true), 0x0191, true);
    robot.pass(4000);
    robot.press(0.4);
    robot.drive(0.4, 300);
    assert!(robot.moves(), "{}", robot.reason());
    let now = robot.bench.now();
    robot.output.as_mut().unwrap().power_on(now);
    robot.pass(10);
    assert_eq!(robot.holds().first(), Some(&(Hold::PauseInputUnknown, "io.estop")));
    robot.pass(3000);
    assert_eq!((value(&robot, "estop"), robot.holds()), (1.0, vec![(Hold::PauseLatched, "")]));
}

#[test]
fn a_tpdo_that_the_device_has_switched_off_is_of_another_node() {
    let mut robot = robot(plc(true), 0x0191, true);
    replace(&mut robot, dictionary(0x0191).with_tpdo(1, 0x8000_0180, &[0x6000_0108], false));
    robot.pass(3000);
    foreign_tpdo(&mut robot, 0);
    robot.pass(50);
    assert_eq!((value(&robot, "estop"), robot.holds().contains(&(Hold::PauseInput, "io.estop"))), (1.0, false));
}

/// Read of the first entry of the first mapping.
const MAPPING: [u8; 4] = [0x40, 0x00, 0x1A, 1];

/// The robot 6 s after its start, while this number of these reads is lost, and the number of reads.
fn with_lost_reads(count: usize) -> (Robot, usize) {
    let mut robot = robot(plc(true), 0x0191, true);
    let own = can::Id::Standard(0x600 + u16::from(NODE));
    robot.lost = vec![(own, MAPPING); count];
    robot.pass(6000);
    let is_read = |frame: &can::Frame| frame.id() == own && frame.data().starts_with(&MAPPING);
    let asked = robot.frames.iter().filter(|(_, frame)| is_read(frame)).count();
    (robot, asked)
}

#[test]
fn a_mapping_whose_read_has_no_answer_is_read_again() {
    let (mut robot, asked) = with_lost_reads(2);
    assert_eq!((asked, value(&robot, "estop")), (3, 1.0));
    foreign_tpdo(&mut robot, 0);
    assert!(robot.holds().contains(&(Hold::PauseInput, "io.estop")), "a TPDO is taken: {:?}", robot.holds());
}

#[test]
fn a_tpdo_whose_mapping_is_never_answered_is_given_up_and_its_inputs_are_read_by_sdo() {
    let (mut robot, asked) = with_lost_reads(usize::from(u8::MAX));
    assert_eq!((asked, value(&robot, "estop")), (3, 1.0));
    assert!(robot.notes.iter().any(|note| note.contains("the mapping of TPDO 1")), "{:?}", robot.notes);
    foreign_tpdo(&mut robot, 0);
    assert!(!robot.holds().contains(&(Hold::PauseInput, "io.estop")), "{:?}", robot.holds());
    // The next TPDO is taken: no read of the object would be in time for all of them.
    for level in [5, 6, 7] {
        set(&mut robot, 0x6401, 1, 100 * level);
        robot.pass(12);
        assert_eq!(value(&robot, "level"), level as f64);
        robot.pass(101);
    }
    set(&mut robot, 0x6000, 1, 0);
    robot.pass(105);
    assert_eq!(value(&robot, "estop"), 0.0);
    // At its next start the mapping is read again.
    robot.lost.clear();
    let now = robot.bench.now();
    robot.output.as_mut().unwrap().power_on(now);
    robot.pass(3000);
    foreign_tpdo(&mut robot, 0);
    assert!(robot.holds().contains(&(Hold::PauseInput, "io.estop")), "{:?}", robot.holds());
}

#[test]
fn an_answer_that_may_be_older_than_a_tpdo_does_not_close_an_input() {
    let mut robot = robot(plc(true), 0x0191, true);
    robot.pass(3000);
    robot.output = None;
    robot.frames.clear();
    let is_asked = |robot: &Robot| robot.frames.iter().any(|(_, frame)| frame.data().starts_with(&[0x40, 0, 0x60, 1]));
    for _ in 0..100 {
        if !is_asked(&robot) {
            robot.pass(1);
        }
    }
    assert!(is_asked(&robot));
    robot.pass(1);
    foreign_tpdo(&mut robot, 0);
    robot.bench.can(PortId(0), can::Frame::standard(0x580 + u16::from(NODE), &[0x4F, 0, 0x60, 1, 8, 0, 0, 0]));
    robot.exchange();
    assert!(robot.holds().contains(&(Hold::PauseInput, "io.estop")), "{:?}", robot.holds());
}

#[test]
fn mappings_are_read_again_after_another_master() {
    let mut robot = robot(plc(true), 0x0191, true);
    robot.pass(3000);
    let request = can::Frame::standard(0x600 + u16::from(NODE), &[0x40, 0, 0x1A, 1, 0, 0, 0, 0]);
    robot.bench.can(PortId(0), request);
    robot.exchange();
    foreign_tpdo(&mut robot, 0);
    assert!(!robot.holds().contains(&(Hold::PauseInput, "io.estop")), "{:?}", robot.holds());
    robot.pass(13_000);
    assert_eq!(value(&robot, "estop"), 1.0);
    set(&mut robot, 0x6000, 1, 0);
    robot.pass(10);
    assert!(robot.holds().contains(&(Hold::PauseInput, "io.estop")), "{:?}", robot.holds());
}

#[test]
fn an_order_names_all_outputs_with_what_they_take_or_they_get_their_safe_values() {
    let mut device = plc(true);
    let mut robot_of = |min| {
        device.keys.signals[1].limits.min = min;
        let mut robot = robot(device.clone(), 0x0191, false);
        robot.pass(3000);
        order(&mut robot, "lamp", 0.0);
        robot.pass(20);
        robot
    };
    assert_eq!(get(&robot_of(1.0), 0x6200, 1), Some(2), "less than its least value");
    let mut robot = robot_of(0.0);
    assert_eq!(get(&robot, 0x6200, 1), Some(0));
    order(&mut robot, "horn", 0.0);
    robot.pass(20);
    assert_eq!(get(&robot, 0x6200, 1), Some(2));
}

#[test]
fn outputs_have_their_safe_values_when_the_module_ends() {
    let mut robot = robot(plc(true), 0x0191, false);
    robot.pass(3000);
    order(&mut robot, "lamp", 0.0);
    robot.pass(20);
    assert_eq!(get(&robot, 0x6200, 1), Some(0));
    robot.bench.message(common::CmdState {
        module: NAME.into(),
        state: State::Terminate as i8,
        ..common::CmdState::default()
    });
    robot.pass(2000);
    assert!(robot.ended);
    assert_eq!(get(&robot, 0x6200, 1), Some(2));
}
