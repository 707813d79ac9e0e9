//! Drives by data sheets of other makers: what the sheet has they have, in its units, and no more.

use super::*;
use crate::boards::cia402::Cia402Config;
use crate::boards::output::OutputConfig;
use crate::body::{Parameters, Switch};
use canopen::drives::derive::VelocityUnit;
use canopen::drives::motor::{Own, Unit};
use canopen::eds::Eds;
use std::sync::Arc;

/// A drive that states its units: rpm, rpm/s.
const EPOS4: &[u8] = include_bytes!("../../../../../buses/canopen/eds/others/maxon_epos4_50_15_node1.dcf");
/// One that leaves them open, and has no 0x6007.
const SLAVE: &[u8] = include_bytes!("../../../../../buses/canopen/eds/others/ros2_cia402_slave.eds");
/// One without option codes.
const EPOS: &[u8] = include_bytes!("../../../../../buses/canopen/eds/epos_sim.eds");
/// Motor speed at 0.8 m/s, rpm.
const RPM: i64 = 1986;
/// What feeds the motors.
const FEED: OutputConfig = OutputConfig { node: 5, index: 0x6200, sub: 1, bits: 8, on: 1 };

fn wheel(sheet: &[u8]) -> Cia402Config {
    Cia402Config {
        axis: Axis::Wheel(0),
        sheet: Arc::new(Eds::parse(sheet).unwrap()),
        gear: Some(GEAR),
        counts_per_turn: None,
        velocity_unit: None,
        keeps_quick_stop: false,
        stops_without: Vec::new(),
        current: None,
        temperature: None,
        homed: 0,
        brake: false,
    }
}

fn steering(sheet: &[u8], gear: f64) -> Cia402Config {
    let counts_per_turn = Some(4096);
    Cia402Config { axis: Axis::Steering, gear: Some(gear), counts_per_turn, homed: 1 << 15, ..wheel(sheet) }
}

impl Bus {
    /// The propulsion as node 1, the steering as node 2, and what feeds the motors as node 5.
    fn by_sheets(propulsion: Cia402Config, steering: Cia402Config) -> Self {
        Self::of_body(propulsion, steering, &Parameters::default())
    }

    /// The same in a robot that is not the usual one.
    fn of_body(propulsion: Cia402Config, steering: Cia402Config, parameters: &Parameters) -> Self {
        let drive = |name: &str, node, config| {
            let kind = DriveKind::Cia402(Box::new(config));
            DriveConfig { name: name.into(), node, kind }
        };
        let drives = vec![drive("propulsion", 1, propulsion), drive("steering", 2, steering)];
        let mut bus = Self::of(drives, Some(FEED), Config { parameters: *parameters, ..Config::default() });
        bus.boot();
        bus
    }

    /// This propulsion, enabled, with the ramps of [`Bus::enable_propulsion`], `unit` of its velocities to the rpm.
    fn enabled(propulsion: Cia402Config, unit: f64) -> Self {
        let mut bus = Self::by_sheets(propulsion, steering(SLAVE, 180.0));
        for (index, rpm_per_s) in [(0x6083, 1241.0), (0x6084, 1241.0), (0x6085, 3724.0)] {
            bus.write(1, index, 0, 32, (rpm_per_s * unit).round() as i64);
        }
        bus.write(1, 0x6060, 0, 8, 3);
        bus.enable(1);
        bus
    }

    /// The same, driving at 0.8 m/s.
    fn driving(propulsion: Cia402Config, unit: f64) -> Self {
        let mut bus = Self::enabled(propulsion, unit);
        bus.write(1, 0x60FF, 0, 32, (RPM as f64 * unit).round() as i64);
        bus.pass(3000);
        bus
    }

    fn enable(&mut self, node: u8) {
        for (word, state) in [(6, 0x21), (7, 0x23), (15, 0x27)] {
            self.write(node, 0x6040, 0, 16, word);
            assert_eq!(self.status(node) & 0x6F, state);
        }
    }

    /// Writes an object of so many bits by SDO.
    #[track_caller]
    fn write(&mut self, node: u8, index: u16, sub: u8, bits: u8, value: i64) {
        let size = match bits {
            8 => "2F",
            16 => "2B",
            _ => "23",
        };
        let [low, high] = index.to_le_bytes();
        let bytes = (value as u32).to_le_bytes().map(|byte| format!("{byte:02X}")).join(" ");
        let object = format!("{low:02X} {high:02X} {sub:02X}");
        self.sdo(&format!("60{node} {size} {object} {bytes}"), &format!("58{node} 60 {object}"));
    }

    /// Reads an object of at most 32 bits, signed, by SDO.
    #[track_caller]
    fn get(&mut self, node: u8, index: u16, sub: u8) -> i64 {
        let [low, high] = index.to_le_bytes();
        let object = format!("{low:02X} {high:02X} {sub:02X}");
        let answers = self.send(&format!("60{node} 40 {object} 00 00 00 00"));
        let answer = answers.iter().find_map(|text| text.strip_prefix(&format!("58{node} "))).unwrap();
        let bytes: Vec<u8> = answer.split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
        let raw = u32::from_le_bytes([4, 5, 6, 7].map(|at| bytes.get(at).copied().unwrap_or(0)));
        match bytes[0] {
            0x4F => (raw as u8 as i8).into(),
            0x4B => (raw as u16 as i16).into(),
            0x43 => (raw as i32).into(),
            other => panic!("{other:02X}"),
        }
    }

    /// Node 2 moves to this position.
    fn steers_to(&mut self, counts: i64, ms: u64) {
        self.write(2, 0x607A, 0, 32, counts);
        for word in [0x0F, 0x1F, 0x0F] {
            self.write(2, 0x6040, 0, 16, word);
        }
        self.pass(ms);
    }

    /// Homes node 2 by this method; its home is the switch, at so many counts.
    fn homes(&mut self, method: i64, at: i64) {
        for (index, sub, value) in [(0x6099, 1, 20_480), (0x6099, 2, 4096), (0x609A, 0, 200_000), (0x607C, 0, at)] {
            self.write(2, index, sub, 32, value);
        }
        self.write(2, 0x6098, 0, 8, method);
        self.write(2, 0x6060, 0, 8, 6);
        self.enable(2);
        self.write(2, 0x6040, 0, 16, 0x1F);
        self.pass(8000);
    }
}

#[test]
fn a_drive_has_the_units_of_its_sheet_whatever_its_configuration_says() {
    let stated = wheel(EPOS4);
    let wrong = Cia402Config { velocity_unit: Some(VelocityUnit::TenthRpm), ..wheel(EPOS4) };
    let open = Cia402Config { counts_per_turn: Some(4096), ..wheel(SLAVE) };
    let rpm = Cia402Config { velocity_unit: Some(VelocityUnit::Rpm), ..wheel(SLAVE) };
    for (config, unit) in [(stated.clone(), 1.0), (wrong, 1.0), (open, 4096.0 / 60.0), (rpm, 1.0)] {
        let mut bus = Bus::enabled(config.clone(), unit);
        bus.write(1, 0x60FF, 0, 32, (RPM as f64 * unit).round() as i64);
        bus.pass(1000);
        assert!((bus.truth.speed - 0.5).abs() < 0.03, "0.5 m/s² for a second: {}", bus.truth.speed);
        bus.pass(2000);
        assert!((bus.truth.speed - 0.8).abs() < 0.001, "{}", bus.truth.speed);
        let expected = 60.0 * GEAR / core::f64::consts::TAU / 0.1 * unit;
        let circumference = core::f64::consts::TAU * 0.1;
        assert!((config.velocity_units(1, circumference) / expected - 1.0).abs() < 1e-9);
    }
    let reversed = Cia402Config { gear: Some(-GEAR), ..stated };
    assert!((Bus::driving(reversed, 1.0).truth.speed + 0.8).abs() < 0.001);
}

#[test]
fn a_feed_counts_from_the_shaft_behind_the_gear() {
    let text = std::str::from_utf8(SLAVE).unwrap().replace("\r\n", "\n");
    let array = |index: &str, parts: [u32; 2]| {
        let part = |sub, value: u32| {
            format!(
                "[{index}sub{sub}]\nParameterName=p\nObjectType=7\nDataType=7\nAccessType=ro\nDefaultValue={value}\n"
            )
        };
        let head = format!("[{index}]\nParameterName=a\nObjectType=8\nSubNumber=3\n");
        let count =
            format!("[{index}sub0]\nParameterName=n\nObjectType=7\nDataType=5\nAccessType=const\nDefaultValue=2\n");
        head + &count + &part(1, parts[0]) + &part(2, parts[1])
    };
    // 3600 units per turn of the wheel, which is 26 turns of the motor: 3600 units/s are 60 rpm of the wheel.
    let text = text + "\n" + &array("6091", [26, 1]) + &array("6092", [3600, 1]);
    let config = Cia402Config { gear: None, ..wheel(text.as_bytes()) };
    assert!((config.velocity_units(1, 1.0) - 3600.0).abs() < 1e-9);
}

#[test]
fn a_quick_stop_is_what_its_option_code_says() {
    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    bus.write(1, 0x6040, 0, 16, 2);
    let x = bus.truth.x;
    bus.pass(2000);
    let way = bus.truth.x - x;
    assert!((0.213..0.213 + 0.8 * 0.055).contains(&way), "0.8² / (2 · 1.5) m: {way}");
    assert_eq!((bus.truth.speed, bus.status(1) & 0x6F), (0.0, 0x07), "0x605A is 6 by the sheet: kept");

    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    bus.write(1, 0x605A, 0, 16, 1);
    bus.write(1, 0x6040, 0, 16, 2);
    bus.pass(800);
    assert!((0.35..0.45).contains(&bus.truth.speed), "by the deceleration ramp: {}", bus.truth.speed);
    bus.pass(1200);
    assert_eq!((bus.truth.speed, bus.status(1) & 0x4F), (0.0, 0x40));
}

#[test]
fn a_drive_without_an_option_code_rolls_on_unless_its_manual_says_that_it_stops() {
    let epos = Cia402Config { velocity_unit: Some(VelocityUnit::Rpm), ..wheel(EPOS) };
    let mut bus = Bus::driving(epos.clone(), 1.0);
    bus.sdo("601 40 5A 60 00 00 00 00 00", "581 80 5A 60 00 00 00 02 06");
    bus.write(1, 0x6040, 0, 16, 2);
    bus.pass(1000);
    assert_eq!(bus.status(1) & 0x4F, 0x40);
    assert!(bus.truth.speed > 0.6, "{}", bus.truth.speed);

    let vouched = Cia402Config { stops_without: vec![0x605A], keeps_quick_stop: true, ..epos };
    let mut bus = Bus::driving(vouched, 1.0);
    bus.write(1, 0x6040, 0, 16, 2);
    bus.pass(1000);
    assert_eq!((bus.truth.speed, bus.status(1) & 0x6F), (0.0, 0x07));
}

/// Drives with this object written, then without the master's heartbeat for 0.9 s; speed and statusword.
fn left_alone(config: Cia402Config, unit: f64, object: (u16, u8, u8, i64)) -> (f64, u16, Vec<String>) {
    let mut bus = Bus::driving(config, unit);
    bus.write(1, 0x1016, 1, 32, 0x007F_00C8);
    bus.write(1, object.0, object.1, object.2, object.3);
    bus.send("77F 05");
    bus.pass(190);
    assert!(bus.truth.speed > 0.79, "the master is there");
    let sent = bus.pass(900).into_iter().map(|(_, text)| text).collect();
    (bus.truth.speed, bus.status(1) & 0x6F, sent)
}

#[test]
fn the_loss_of_the_master_is_answered_as_the_objects_say() {
    let lost = "081 30 81 11 00 00 00 00 00".to_string();
    let (speed, state, sent) = left_alone(wheel(EPOS4), 1.0, (0x6007, 0, 16, 3));
    assert_eq!((speed, state), (0.0, 0x07), "a quick stop, which is kept");
    assert!(sent.contains(&lost), "{sent:?}");
    let (speed, state, _) = left_alone(wheel(EPOS4), 1.0, (0x6007, 0, 16, 1));
    assert_eq!((speed, state & 0x4F), (0.0, 0x08), "a fault");
    let (speed, state, _) = left_alone(wheel(EPOS4), 1.0, (0x6007, 0, 16, 0));
    assert!(speed > 0.79 && state == 0x27, "nothing: {speed}");

    // Without 0x6007 a drive that stays Operational goes on.
    let rpm = || Cia402Config { velocity_unit: Some(VelocityUnit::Rpm), ..wheel(SLAVE) };
    let (speed, state, sent) = left_alone(rpm(), 1.0, (0x1029, 1, 8, 0));
    assert_eq!((speed, state & 0x4F), (0.0, 0x08), "to Pre-operational, by a fault");
    assert!(sent.contains(&lost), "{sent:?}");
    let (speed, state, _) = left_alone(rpm(), 1.0, (0x1029, 1, 8, 1));
    assert!(speed > 0.79 && state == 0x27, "{speed}");
}

#[test]
fn nmt_stopped_is_a_loss_of_the_master_too() {
    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    bus.send("000 02 01");
    bus.pass(1000);
    assert_eq!(bus.truth.speed, 0.0);
}

#[test]
fn a_wheel_drive_without_feed_is_in_fault_until_it_has_it_again() {
    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    bus.write(5, 0x6200, 1, 8, 0);
    assert_eq!(bus.status(1) & 0x5F, 0x08, "fault, and no voltage on the power stage");
    bus.pass(500);
    assert!((0.65..0.8).contains(&bus.truth.speed), "it rolls: {}", bus.truth.speed);
    bus.write(1, 0x6040, 0, 16, 0x80);
    assert_eq!(bus.status(1) & 0x4F, 0x08, "the cause persists");
    bus.fault("propulsion", "reboot", 0.0, 0.0);
    bus.boot();
    assert_eq!(bus.status(1) & 0x4F, 0x08, "its motor's supply is separate");
    bus.write(5, 0x6200, 1, 8, 1);
    bus.write(1, 0x6040, 0, 16, 0);
    bus.write(1, 0x6040, 0, 16, 0x80);
    assert_eq!(bus.status(1) & 0x5F, 0x50);
}

#[test]
fn drives_by_sheets_have_the_faults_of_the_others() {
    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    bus.fault("propulsion", "unbraked", 0.0, 1.0);
    bus.write(1, 0x6040, 0, 16, 2);
    bus.pass(900);
    assert!(bus.truth.speed > 0.79, "{}", bus.truth.speed);
    bus.pass(1000);
    assert_eq!(bus.truth.speed, 0.0);

    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    bus.fault("propulsion", "runaway", 0.3, 0.0);
    bus.pass(1000);
    assert!((bus.truth.speed - 1.1).abs() < 0.001, "{}", bus.truth.speed);
    bus.fault("propulsion", "none", 0.0, 0.0);
    bus.fault("propulsion", "fault", f64::from(0x2310), 0.0);
    let sent = bus.pass(0);
    assert!(sent.iter().any(|(_, text)| text == "081 10 23 03 00 00 00 00 00"), "{sent:?}");
    bus.pass(2000);
    assert_eq!((bus.truth.speed, bus.status(1) & 0x4F), (0.0, 0x08), "0x605E is 2: by the quick stop ramp");

    for (target, node) in [("propulsion", 1), ("steering", 2)] {
        bus.fault(target, "silent", 0.0, 0.5);
        assert_eq!(bus.send(&format!("60{node} 40 00 10 00 00 00 00 00")), [""; 0]);
        bus.pass(501);
        bus.fault(target, "reboot", 0.0, 0.0);
        let sent = bus.pass(150);
        assert!(sent.iter().any(|(_, text)| *text == format!("70{node} 00")), "{sent:?}");
    }
    // RPDO3 of another version has what RPDO4 has by the sheet.
    bus.sdo("602 40 02 16 02 00 00 00 00", "582 43 02 16 02 20 00 7A 60");
    bus.fault("steering", "layout", 0.0, 0.0);
    bus.pass(150);
    bus.sdo("602 40 02 16 02 00 00 00 00", "582 43 02 16 02 20 00 FF 60");
    bus.fault("steering", "none", 0.0, 0.0);
    bus.pass(150);
    bus.sdo("602 40 02 16 02 00 00 00 00", "582 43 02 16 02 20 00 7A 60");
}

#[test]
fn a_steering_is_homed_to_its_switch_from_whichever_side_its_gear_turns() {
    // At -36 degrees it has 73 728 counts. Methods 17, 21, 22, 27 and 28 search for it downwards, the others upwards.
    let left = [(-180.0, 27), (-180.0, 17), (180.0, 23), (180.0, 18), (180.0, 20)].map(|(gear, to)| (gear, to, 30.0));
    let right = [(180.0, 27), (180.0, 21), (180.0, 28), (-180.0, 23), (-180.0, 24)].map(|(gear, to)| (gear, to, -36.0));
    for (gear, method, at) in left.into_iter().chain(right) {
        let switch = Switch { angle: f64::to_radians(at), left: at > 0.0 };
        let body = Parameters::default().steered(0.61, switch);
        let mut bus = Bus::of_body(wheel(EPOS4), steering(SLAVE, gear), &body);
        let counts = |degrees: f64| (degrees * 4096.0 * gear / 360.0).round() as i64;
        bus.homes(method, counts(at));
        assert_eq!(bus.status(2) & 0xB400, 0x9400, "homed, attained, standing");
        bus.write(2, 0x6060, 0, 8, 1);
        // 40 degrees per second.
        for (index, value) in [(0x6081, 81_920), (0x6083, 819_200), (0x6084, 819_200), (0x6085, 1_638_400)] {
            bus.write(2, index, 0, 32, value);
        }
        let to = -20.0 * at.signum();
        bus.steers_to(counts(to), 1000);
        let way = (bus.truth.steering.to_degrees() - at).abs();
        assert!((34.0..46.0).contains(&way), "50 or 56 degrees at 40 per second: {way}, {gear} {method}");
        bus.pass(1500);
        let degrees = bus.truth.steering.to_degrees();
        assert!((degrees + 19.75 * at.signum()).abs() < 0.1, "{degrees}, {gear} {method}");
        assert_eq!(i64::from(bus.position()), counts(to));
    }
}

#[test]
fn a_search_away_from_the_switch_ends_at_the_stop_as_an_error() {
    for (gear, method) in [(180.0, 23), (-180.0, 27)] {
        let mut bus = Bus::by_sheets(wheel(EPOS4), steering(SLAVE, gear));
        bus.write(2, 0x6065, 0, 32, 2000);
        bus.homes(method, 0);
        assert_eq!(bus.status(2) & 0xB400, 0x2400, "error, standing, not homed: {gear} {method}");
        assert!((bus.truth.steering.to_degrees() - 37.25).abs() < 0.1, "{}", bus.truth.steering.to_degrees());
    }
}

#[test]
fn a_steering_that_its_stop_holds_reports_a_following_error() {
    let mut bus = Bus::by_sheets(wheel(EPOS4), steering(SLAVE, 180.0));
    bus.homes(27, -73_728);
    bus.write(2, 0x6060, 0, 8, 1);
    bus.write(2, 0x6065, 0, 32, 2000);
    for (index, value) in [(0x6081, 81_920), (0x6083, 819_200), (0x6084, 819_200), (0x6085, 1_638_400)] {
        bus.write(2, index, 0, 32, value);
    }
    bus.steers_to(73_728, 3000);
    assert_eq!(bus.status(2) & 0x6F, 0x27, "with its own lag it is far within its window");
    // 40 degrees, and the stop is at 37.5.
    bus.write(2, 0x607A, 0, 32, 81_920);
    bus.write(2, 0x6040, 0, 16, 0x1F);
    let sent = bus.pass(1000);
    assert!(sent.iter().any(|(_, text)| text == "082 11 86 21 00 00 00 00 00"), "{sent:?}");
    assert_eq!(bus.status(2) & 0x4F, 0x08);
}

#[test]
fn a_homing_method_that_the_sheet_does_not_list_is_an_error() {
    for (method, status) in [(37, 0x1400), (20, 0x2400)] {
        let mut bus = Bus::by_sheets(wheel(EPOS4), steering(EPOS4, 180.0));
        bus.write(2, 0x6098, 0, 8, method);
        bus.write(2, 0x6060, 0, 8, 6);
        bus.enable(2);
        bus.write(2, 0x6040, 0, 16, 0x1F);
        bus.pass(100);
        assert_eq!(bus.status(2) & 0x3400, status, "method {method}");
    }
}

#[test]
fn a_mode_that_the_sheet_does_not_offer_is_not_entered() {
    // 0x6502 of this one has profile position and velocity, homing, and cyclic position.
    let mut bus = Bus::by_sheets(wheel(EPOS4), steering(SLAVE, 180.0));
    bus.write(2, 0x6060, 0, 8, 3);
    bus.sdo("602 40 61 60 00 00 00 00 00", "582 4F 61 60 00 03");
    bus.write(2, 0x6060, 0, 8, 9);
    bus.sdo("602 40 61 60 00 00 00 00 00", "582 4F 61 60 00 03");
}

#[test]
fn a_hostile_sheet_makes_a_drive_that_does_nothing() {
    let text = "[MandatoryObjects]\nSupportedObjects=1\n1=0x1000\n\
        [1000]\nParameterName=d\nObjectType=7\nDataType=7\nAccessType=ro\nDefaultValue=0\n";
    let mut bus = Bus::by_sheets(Cia402Config { gear: None, ..wheel(text.as_bytes()) }, steering(text.as_bytes(), 1.0));
    bus.fault("propulsion", "layout", 0.0, 0.0);
    bus.fault("steering", "fault", 1.0, 0.0);
    bus.pass(1000);
    assert_eq!(bus.truth.speed, 0.0);
}

#[test]
fn current_torque_and_temperature_are_in_the_objects_and_units_of_sheet_and_manual() {
    let own = |index, sub, exponent| Some(Own { index, sub, unit: Unit::Decimal(exponent) });
    let config = Cia402Config { current: own(0x30D1, 2, -3), temperature: own(0x3201, 1, -1), ..wheel(EPOS4) };
    let mut bus = Bus::enabled(config, 1.0);
    // Per mille of 0.5 N m.
    bus.write(1, 0x6076, 0, 32, 500);
    let cold = bus.get(1, 0x3201, 1);
    bus.write(1, 0x60FF, 0, 32, RPM);
    bus.pass(300);
    // It accelerates: 8.3 N at the wheel to the ampere (docs/facts/robot.md 1.2), and the same power at the shaft.
    let (milliamperes, per_mille) = (bus.get(1, 0x30D1, 2) as f64, bus.get(1, 0x6077, 0) as f64);
    assert!(milliamperes > 500.0, "{milliamperes}");
    let turns_per_metre = RPM as f64 / 60.0 / 0.8;
    let torque = milliamperes / 1000.0 * 8.3 / (core::f64::consts::TAU * turns_per_metre);
    assert!((per_mille / 1000.0 * 0.5 - torque).abs() < 0.01 * torque, "{per_mille} {torque}");
    bus.pass(60_000);
    assert!(bus.get(1, 0x3201, 1) >= cold, "{cold}");
}

#[test]
fn a_motor_turns_no_faster_than_its_object_permits_and_one_without_a_value_is_not_bounded() {
    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    assert!((bus.get(1, 0x606C, 0) - RPM).abs() <= 1);
    bus.write(1, 0x6080, 0, 32, 1000);
    bus.pass(1500);
    assert!((bus.get(1, 0x606C, 0) - 1000).abs() <= 1, "{}", bus.get(1, 0x606C, 0));
    bus.write(1, 0x6080, 0, 32, 3000);
    bus.pass(1500);
    assert!((bus.get(1, 0x606C, 0) - RPM).abs() <= 1, "{}", bus.get(1, 0x606C, 0));

    let open = String::from_utf8_lossy(EPOS4).replace("[6080]\r\n", "[6080]\n");
    let begin = open.find("[6080]\n").unwrap();
    let end = begin + open[begin + 1..].find("\n[").unwrap() + 1;
    let stated = ["DefaultValue=", "ParameterValue="];
    let section = open[begin..end].lines().filter(|line| !stated.iter().any(|key| line.starts_with(key)));
    let section: String = section.map(|line| line.to_owned() + "\n").collect();
    let open = open[..begin].to_owned() + &section + &open[end..];
    let mut bus = Bus::driving(wheel(open.as_bytes()), 1.0);
    assert!((bus.get(1, 0x606C, 0) - RPM).abs() <= 1, "{}", bus.get(1, 0x606C, 0));
}

#[test]
fn a_brake_holds_its_wheel_against_the_motor_and_without_it() {
    // The sheet has no mask: the output is the master's.
    let braked = Cia402Config { brake: true, ..wheel(EPOS4) };
    let mut bus = Bus::driving(braked, 1.0);
    let stands = |bus: &mut Bus| bus.get(1, 0x606C, 0).abs() <= 1;
    assert!((bus.get(1, 0x606C, 0) - RPM).abs() <= 1, "released by 0");
    bus.write(1, 0x60FE, 1, 32, 1);
    bus.pass(1500);
    assert!(stands(&mut bus) && bus.status(1) & 0x6F == 0x27, "{:04X}", bus.status(1));
    bus.write(1, 0x60FE, 1, 32, 0);
    bus.pass(1500);
    assert!(!stands(&mut bus));
    // Without the motors' feed a spring applies it.
    bus.write(5, 0x6200, 1, 8, 0);
    bus.pass(1500);
    assert!(stands(&mut bus));
    // Another drive has no brake on that output.
    let mut bus = Bus::driving(wheel(EPOS4), 1.0);
    bus.write(1, 0x60FE, 1, 32, 1);
    bus.pass(1500);
    assert!((bus.get(1, 0x606C, 0) - RPM).abs() <= 1);
}
