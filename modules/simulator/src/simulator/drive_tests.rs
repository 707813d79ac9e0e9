//! The drives on the CAN bus: transcripts typed from docs/facts/canopen.md, not made by the master.

use super::*;
use crate::boards::drive::DriveKind;
use crate::boards::icla::Gearing;
use base::can::{Frame, Id};
use module::bench::Bench;
use module::{Action, Shell, ShellConfig};

mod by_sheet;

/// Motor turns per turn of the wheel.
const GEAR: f64 = 26.0;

/// Propulsion is node 1, steering node 2.
struct Bus {
    bench: Bench,
    truth: simulation::DataTruth,
}

/// `501 0F 00`: identifier and data.
fn frame(text: &str) -> Frame {
    let mut tokens = text.split_whitespace();
    let id = u16::from_str_radix(tokens.next().unwrap(), 16).unwrap();
    let data: Vec<u8> = tokens.map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
    Frame::standard(id, &data)
}

fn text(frame: &Frame) -> String {
    let Id::Standard(id) = frame.id() else { panic!("{frame:?}") };
    frame.data().iter().fold(format!("{id:03X}"), |text, byte| text + &format!(" {byte:02X}"))
}

impl Bus {
    fn new() -> Self {
        Self::with(false)
    }

    fn with(wire_time: bool) -> Self {
        let drive = |name: &str, node, kind| DriveConfig { name: name.into(), node, kind };
        let propulsion = drive("propulsion", 1, DriveKind::Epos { wheel: 0, gear: GEAR });
        let steering = drive("steering", 2, DriveKind::Icla(Gearing::default()));
        Self::of(vec![propulsion, steering], None, Config { wire_time, ..Config::default() })
    }

    fn of(drives: Vec<DriveConfig>, output: Option<OutputConfig>, config: Config) -> Self {
        let can = CanConfig { bus: "can.main".into(), bitrate: 1_000_000, drives, output, devices: Vec::new() };
        let mut world = World::hall(200.0, 200.0);
        world.start = navitools::Pose::new(100.0, 100.0, 0.0);
        let config = Config { can: Some(can), world, ..config };
        let mut bench = Bench::new(Shell::new(ShellConfig::new("simulator"), Box::new(Simulator::new(config))));
        bench.start();
        Self { bench, truth: simulation::DataTruth::default() }
    }

    /// Lets time pass; answers what the drives sent, each with its time in ms.
    fn pass(&mut self, ms: u64) -> Vec<(f64, String)> {
        self.bench.pass(Duration::from_millis(ms));
        let mut sent = Vec::new();
        for (at, action) in self.bench.done() {
            match action {
                Action::Send(_, Output::Can(frame)) => {
                    sent.push((at.as_nanos() as f64 / 1e6, text(&frame)));
                }
                Action::Publish(Message::SimDataTruth(truth)) => self.truth = truth,
                _ => {}
            }
        }
        sent
    }

    /// Sends a frame; answers what comes back at once.
    fn send(&mut self, request: &str) -> Vec<String> {
        self.bench.can(PortId(0), frame(request));
        self.pass(0).into_iter().map(|(_, text)| text).collect()
    }

    /// Sends an SDO request and demands this answer.
    #[track_caller]
    fn sdo(&mut self, request: &str, answer: &str) {
        let answers = self.send(request);
        assert!(answers.iter().any(|text| text.starts_with(answer)), "{request}: {answers:?}");
    }

    fn fault(&mut self, target: &str, fault: &str, value: f64, duration: f64) {
        let (target, fault) = (target.into(), fault.into());
        self.bench.message(simulation::CmdFault { timestamp: 0, target, fault, value, duration });
    }

    fn boot(&mut self) {
        self.pass(200);
        self.send("000 01 00");
    }

    /// The statusword, read by SDO.
    fn status(&mut self, node: u8) -> u16 {
        let answers = self.send(&format!("60{node} 40 41 60 00 00 00 00 00"));
        let answer = answers.iter().find(|text| text.starts_with(&format!("58{node} 4B"))).unwrap().clone();
        let byte = |at: usize| u16::from_str_radix(&answer[at..at + 2], 16).unwrap();
        byte(16) | byte(19) << 8
    }

    fn position(&mut self) -> i32 {
        let answers = self.send("602 40 64 60 00 00 00 00 00");
        let answer = answers.iter().find(|text| text.starts_with("582 43")).unwrap().clone();
        let byte = |i: usize| i32::from_str_radix(&answer[16 + 3 * i..18 + 3 * i], 16).unwrap();
        byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24
    }

    /// Propulsion in profile velocity, enabled, with ramps of 0.5 and a quick stop of 1.5 m/s².
    fn enable_propulsion(&mut self) {
        self.boot();
        self.sdo("601 2F 60 60 00 03 00 00 00", "581 60 60 60 00");
        // 1241 and 3724 rpm/s at 2483 rpm per m/s.
        self.sdo("601 23 83 60 00 D9 04 00 00", "581 60 83 60 00");
        self.sdo("601 23 84 60 00 D9 04 00 00", "581 60 84 60 00");
        self.sdo("601 23 85 60 00 8C 0E 00 00", "581 60 85 60 00");
        self.send("501 06 00 00 00 00 00");
        self.send("501 0F 00 00 00 00 00");
        self.pass(50);
        assert_eq!(self.status(1) & 0x6F, 0x27);
    }

    /// As the above, and at 0.8 m/s.
    fn drive(&mut self) {
        self.enable_propulsion();
        self.send("501 0F 00 C2 07 00 00"); // 1986 rpm
        self.pass(3000);
        assert!((self.truth.speed - 0.8).abs() < 0.001, "{}", self.truth.speed);
    }

    fn home(&mut self) {
        self.boot();
        self.sdo("602 2F 60 60 00 06 00 00 00", "582 60 60 60 00");
        self.sdo("602 2F 98 60 00 1B 00 00 00", "582 60 98 60 00"); // method 27
        self.sdo("602 23 7C 60 00 00 E0 FE FF", "582 60 7C 60 00"); // -73728 counts: -36 deg
        for word in ["06", "07", "0F", "1F"] {
            self.send(&format!("202 {word} 00"));
        }
    }
}

#[test]
fn both_drives_boot_up_and_say_who_they_are() {
    let mut bus = Bus::new();
    let sent = bus.pass(150);
    assert_eq!(sent, [(100.0, "701 00".to_string()), (100.0, "702 00".to_string())]);
    bus.sdo("601 40 00 10 00 00 00 00 00", "581 43 00 10 00 92 01 02 00");
    bus.sdo("601 40 18 10 01 00 00 00 00", "581 43 18 10 01 FB 00 00 00");
    bus.sdo("601 40 03 20 01 00 00 00 00", "581 4B 03 20 01 33 20"); // firmware 2033h
    bus.sdo("602 40 01 16 02 00 00 00 00", "582 43 01 16 02 20 00 7A 60"); // RPDO2: target position
    // TPDO1 is on, TPDO2 to 4 of the EPOS are off.
    bus.sdo("601 40 00 18 01 00 00 00 00", "581 43 00 18 01 81 01 00 40");
    bus.sdo("601 40 03 18 01 00 00 00 00", "581 43 03 18 01 81 04 00 C0");
    bus.sdo("601 40 61 60 00 00 00 00 00", "581 4F 61 60 00 01"); // mode 1
    bus.sdo("601 40 5A 60 00 00 00 00 00", "581 80 5A 60 00 00 00 02 06"); // no 0x605A
}

#[test]
fn the_epos_shows_refresh_and_measure_init_on_its_way() {
    let mut bus = Bus::new();
    bus.pass(200);
    bus.sdo("601 2F 60 60 00 03 00 00 00", "581 60 60 60 00");
    let mut told: Vec<String> = bus.send("000 01 01");
    told.extend(bus.send("501 06 00 00 00 00 00"));
    told.extend(bus.send("501 0F 00 00 00 00 00"));
    told.extend(bus.pass(60).into_iter().map(|(at, text)| format!("{} {text}", at - 200.0)));
    let expected = [
        "181 40 13",    // switch on disabled; remote, standing
        "181 21 13",    // ready
        "181 23 53",    // refresh
        "20 181 33 13", // measure init
        "40 181 37 17", // operation enabled, target reached
    ];
    assert_eq!(told, expected);
}

#[test]
fn profile_velocity_follows_its_ramp() {
    let mut bus = Bus::new();
    bus.enable_propulsion();
    bus.send("501 0F 00 C2 07 00 00");
    bus.pass(1000);
    assert!((bus.truth.speed - 0.5).abs() < 0.03, "0.5 m/s² for a second: {}", bus.truth.speed);
    bus.pass(2000);
    assert!((bus.truth.speed - 0.8).abs() < 0.001);
    assert_eq!(bus.status(1) & 0x1400, 0x0400, "reached, not standing");
    bus.send("501 0F 01 C2 07 00 00"); // halt
    bus.pass(1700);
    assert_eq!(bus.truth.speed, 0.0);
}

#[test]
fn a_quick_stop_brakes_at_its_deceleration_and_is_kept() {
    let mut bus = Bus::new();
    bus.drive();
    let x = bus.truth.x;
    bus.send("501 0B 00 00 00 00 00");
    assert_eq!(bus.status(1) & 0x6F, 0x07);
    bus.pass(2000);
    // 0.8² / (2 · 1.5) m, and what is driven until the next telling of the truth at most.
    let way = bus.truth.x - x;
    assert!((0.213..0.213 + 0.8 * 0.055).contains(&way), "{way}");
    assert_eq!((bus.truth.speed, bus.status(1) & 0x6F), (0.0, 0x07));
    bus.send("501 0F 00 C2 07 00 00");
    bus.pass(2000);
    assert!(bus.truth.speed > 0.7, "resumed from Quick Stop Active");
}

#[test]
fn power_off_lets_it_coast() {
    let mut bus = Bus::new();
    bus.drive();
    let x = bus.truth.x;
    bus.send("501 00 00 00 00 00 00");
    assert_eq!(bus.status(1) & 0x4F, 0x40);
    bus.pass(10_000);
    let way = bus.truth.x - x;
    let expected = 0.8 * 0.8 / (2.0 * Parameters::default().coasting());
    assert!((expected - 0.005..expected + 0.05).contains(&way), "{way} {expected}");
}

#[test]
fn a_lost_heartbeat_stops_the_propulsion_by_itself() {
    let mut bus = Bus::new();
    bus.drive();
    bus.sdo("601 23 16 10 01 C8 00 7F 00", "581 60 16 10 01"); // node 127 within 200 ms
    for _ in 0..10 {
        bus.send("77F 05");
        bus.pass(50);
    }
    let heard = bus.bench.now().as_nanos() as f64 / 1e6 - 50.0;
    let sent = bus.pass(300);
    let (at, _) = sent.iter().find(|(_, text)| text == "081 30 81 10 00 00 00 00 00").unwrap();
    assert!((at - heard - 200.0).abs() < 1e-6, "{heard}: {sent:?}");
    // 150 ms of braking at 1.5 m/s².
    assert!((0.5..0.65).contains(&bus.truth.speed), "{}", bus.truth.speed);
    assert_eq!(bus.status(1) & 0x4F, 0x0F, "fault reaction");
    bus.pass(1000);
    assert_eq!((bus.truth.speed, bus.status(1) & 0x4F), (0.0, 0x08));
    // Out of the fault by an edge of bit 7; the emergency is taken back.
    let sent = bus.send("501 80 00 00 00 00 00");
    assert!(sent.contains(&"081 00 00 00 00 00 00 00 00".to_string()), "{sent:?}");
    assert_eq!(bus.status(1) & 0x4F, 0x40);
}

#[test]
fn homing_finds_the_switch_and_counts_from_it() {
    let mut bus = Bus::new();
    bus.home();
    assert_eq!(bus.status(2) & 0xB400, 0, "running, not homed");
    // 36 deg at 10 deg/s; back off the switch at 2 deg/s.
    bus.pass(3500);
    assert!((-35.5..-33.0).contains(&bus.truth.steering.to_degrees()), "{}", bus.truth.steering.to_degrees());
    bus.pass(3000);
    assert_eq!(bus.status(2) & 0xB400, 0x9400, "homed, attained, standing");
    let position = f64::from(bus.position()) / 2048.0;
    let true_angle = bus.truth.steering.to_degrees();
    assert!((position - true_angle).abs() < 0.3, "within the play of {true_angle}: {position}");

    // Profile position with the handshake: to the middle.
    bus.sdo("602 2F 60 60 00 01 00 00 00", "582 60 60 60 00");
    bus.send("302 0F 00 00 00 00 00");
    bus.send("302 1F 00 00 00 00 00");
    assert_eq!(bus.status(2) & 0x1400, 0x1000, "acknowledged, under way");
    bus.send("302 0F 00 00 00 00 00");
    assert_eq!(bus.status(2) & 0x1400, 0);
    bus.pass(4000);
    assert_eq!((bus.status(2) & 0x1400, bus.position()), (0x0400, 0));
    assert!((bus.truth.steering.to_degrees() + 0.25).abs() < 0.05, "half the play: {}", bus.truth.steering);
}

#[test]
fn homing_without_its_switch_is_an_error_not_a_crash() {
    let mut bus = Bus::new();
    bus.home();
    bus.send("202 0F 00");
    assert_eq!(bus.status(2) & 0x3400, 0x0400, "interrupted");
    bus.sdo("602 2F 98 60 00 18 00 00 00", "582 60 98 60 00"); // method 24: the switch is not on that side
    bus.send("202 1F 00");
    bus.pass(100);
    assert_eq!(bus.status(2) & 0x3400, 0x2400);
}

#[test]
fn a_lost_heartbeat_stops_the_steering_by_itself() {
    let mut bus = Bus::new();
    bus.home();
    bus.sdo("602 23 16 10 01 C8 00 7F 00", "582 60 16 10 01");
    bus.send("77F 05");
    bus.pass(190);
    assert_eq!(bus.status(2) & 0x6F, 0x27);
    let sent = bus.pass(15);
    assert!(sent.iter().any(|(_, text)| text == "082 30 81 11 00 00 00 00 00"), "{sent:?}");
    bus.pass(500);
    assert_eq!(bus.status(2) & 0x4F, 0x40, "braked, then off: 0x605A is 2");
    let stands = bus.truth.steering;
    bus.pass(500);
    assert_eq!(bus.truth.steering, stands);
}

fn fault(bus: &mut Bus, target: &str, fault: &str, value: f64, duration: f64) {
    let (target, fault) = (target.into(), fault.into());
    bus.bench.message(simulation::CmdFault { timestamp: 0, target, fault, value, duration });
}

#[test]
fn drives_have_the_faults_that_are_asked_for() {
    let mut bus = Bus::new();
    bus.drive();
    fault(&mut bus, "propulsion", "fault", f64::from(0x2310), 0.0);
    let sent = bus.pass(0);
    assert!(sent.iter().any(|(_, text)| text == "081 10 23 02 00 00 00 00 00"), "{sent:?}");
    assert_eq!(bus.status(1) & 0x4F, 0x08, "overcurrent switches off at once");

    fault(&mut bus, "steering", "reboot", 0.0, 0.0);
    let sent = bus.pass(150);
    assert!(sent.iter().any(|(_, text)| text == "702 00"), "{sent:?}");

    fault(&mut bus, "steering", "silent", 0.0, 0.5);
    assert_eq!(bus.send("602 40 00 10 00 00 00 00 00"), [""; 0]);
    bus.pass(501);
    bus.sdo("602 40 00 10 00 00 00 00 00", "582 43 00 10 00 92 01 02 00");
}

#[test]
fn an_over_current_and_a_generic_fault_switch_off_and_the_robot_rolls() {
    for code in [0x2310, 0x1000] {
        let mut bus = Bus::new();
        bus.drive();
        let x = bus.truth.x;
        fault(&mut bus, "propulsion", "fault", f64::from(code), 0.0);
        bus.pass(0);
        assert_eq!(bus.status(1) & 0x5F, 0x08, "{code:04X}: fault, and no voltage on the power stage");
        bus.pass(10_000);
        // Nothing brakes but rolling friction: more than twice the way of the deceleration ramp (0.64 m).
        let expected = 0.8 * 0.8 / (2.0 * Parameters::default().coasting());
        let way = bus.truth.x - x;
        assert!((expected - 0.005..expected + 0.05).contains(&way), "{code:04X}: {way} {expected}");
        // Reset, and enabled again: by the master alone.
        bus.send("501 80 00 00 00 00 00");
        assert_eq!(bus.status(1) & 0x4F, 0x40);
    }
}

#[test]
fn a_fault_of_communication_brakes_on_the_quick_stop_ramp() {
    let mut bus = Bus::new();
    bus.drive();
    let x = bus.truth.x;
    fault(&mut bus, "propulsion", "fault", f64::from(0x8611), 0.0);
    bus.pass(0);
    assert_eq!(bus.status(1) & 0x5F, 0x1F, "fault reaction under power");
    bus.pass(2000);
    let way = bus.truth.x - x;
    assert!((0.213..0.213 + 0.8 * 0.055).contains(&way), "{way}");
    assert_eq!(bus.status(1) & 0x4F, 0x08);
}

#[test]
fn the_epos_homes_here_and_moves_by_its_offset() {
    let mut bus = Bus::new();
    bus.boot();
    bus.sdo("601 2F 60 60 00 06 00 00 00", "581 60 60 60 00");
    bus.sdo("601 2F 98 60 00 23 00 00 00", "581 60 98 60 00"); // method 35
    bus.sdo("601 23 7C 60 00 D0 07 00 00", "581 60 7C 60 00"); // 2000 quadcounts: a turn of the motor
    for word in ["06", "0F"] {
        bus.send(&format!("201 {word} 00"));
    }
    bus.pass(50);
    bus.send("201 1F 00");
    assert_eq!(bus.status(1) & 0x3400, 0, "on its way");
    bus.pass(4000);
    assert_eq!(bus.status(1) & 0x3400, 0x1400, "attained, standing");
    let turn = 1.0 / Parameters::default().motor_turns_per_metre(GEAR);
    let went = bus.truth.x - 100.0;
    assert!((went - turn).abs() < 0.05 * turn, "{went} {turn}");
}

#[test]
fn a_steering_drive_of_another_layout_takes_its_place() {
    let mut bus = Bus::new();
    bus.boot();
    bus.sdo("602 40 01 16 02 00 00 00 00", "582 43 01 16 02 20 00 7A 60");
    fault(&mut bus, "steering", "layout", 0.0, 0.0);
    let sent = bus.pass(150);
    assert!(sent.iter().any(|(_, text)| text == "702 00"), "{sent:?}");
    bus.sdo("602 40 01 16 02 00 00 00 00", "582 43 01 16 02 08 00 60 60");
    bus.sdo("602 40 02 16 02 00 00 00 00", "582 43 02 16 02 20 00 7A 60");
    fault(&mut bus, "steering", "none", 0.0, 0.0);
    bus.pass(150);
    bus.sdo("602 40 01 16 02 00 00 00 00", "582 43 01 16 02 20 00 7A 60");
}

#[test]
fn standing_still_it_wakes_for_the_truth_and_the_heartbeats_alone() {
    let mut bus = Bus::new();
    bus.enable_propulsion();
    bus.pass(1000);
    let mut wakes = 0;
    let end = bus.bench.now() + Duration::from_secs(10);
    while bus.bench.step(end) {
        wakes += 1;
    }
    assert!(wakes <= 10 * 23, "{wakes} in 10 s");
}

#[test]
fn a_babbling_drive_takes_half_of_the_bus_until_it_is_well() {
    let mut bus = Bus::new();
    bus.boot();
    bus.fault("propulsion", "babble", 0.0, 0.1);
    let sent = bus.pass(200);
    let count = sent.iter().filter(|(_, text)| text.starts_with("281 00 00")).count();
    // A frame in 262 us.
    assert_eq!(count, 382);
    bus.fault("steering", "babble", 130.0, 0.0);
    assert!(bus.pass(10).iter().filter(|(_, text)| text.starts_with("082 00")).count() >= 38);
    bus.fault("steering", "none", 0.0, 0.0);
    assert_eq!(bus.pass(10), []);
}

#[test]
fn a_second_node_with_a_drive_s_number_boots_up_and_answers_too() {
    let mut bus = Bus::new();
    bus.boot();
    bus.fault("steering", "clash", 0.0, 0.0);
    let sent: Vec<_> = bus.pass(1).into_iter().map(|(_, text)| text).collect();
    assert!(sent.contains(&"702 00".to_string()), "{sent:?}");
    let ask = |bus: &mut Bus| {
        let answers = bus.send("602 40 00 10 00 00 00 00 00");
        answers.iter().filter(|text| text.starts_with("582 43 00 10 00")).count()
    };
    assert_eq!(ask(&mut bus), 2);
    bus.fault("steering", "none", 0.0, 0.0);
    assert_eq!(ask(&mut bus), 1);
}

#[test]
fn without_a_wire_its_faults_are_lost_frames_and_with_one_they_are_the_wire_s() {
    let ask = |bus: &mut Bus| bus.send("601 40 00 10 00 00 00 00 00").len();
    for imitates in [true, false] {
        let mut bus = Bus::with(imitates);
        bus.boot();
        bus.fault("can.main", "cut", 0.0, 0.05);
        assert_eq!(ask(&mut bus), usize::from(!imitates));
        bus.pass(60);
        assert_eq!(ask(&mut bus), 1);
        bus.fault("can.main", "bus_off", 0.0, 0.0);
        assert_eq!(ask(&mut bus), usize::from(!imitates));
        bus.pass(110);
        // The second from now on is the answer.
        bus.fault("can.main", "lose", 2.0, 0.0);
        assert_eq!([ask(&mut bus), ask(&mut bus)], [usize::from(!imitates), 1]);
        bus.fault("can.main", "noise", 1e-3, 0.0);
        let answers: usize = (0..1000).map(|_| ask(&mut bus)).sum();
        // Request and answer, some 125 bits each, must get through.
        assert!(if imitates { (700..850).contains(&answers) } else { answers == 1000 }, "{answers}");
        bus.fault("can.main", "none", 0.0, 0.0);
        bus.fault("can.main", "corrupt", 2.0, 0.0);
        assert_eq!((0..10).map(|_| ask(&mut bus)).sum::<usize>(), if imitates { 0 } else { 10 });
    }
}
