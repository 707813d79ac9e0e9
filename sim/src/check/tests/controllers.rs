//! Rules for motor controllers that are no CANopen nodes: the same robot on each of them, read from its own traffic.

use super::wheels::differential;
use super::*;
use base::serial::Word;

/// What turns the wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    VescsOnCan,
    VescsOnUarts,
    RoboClaw,
}

const KINDS: [Kind; 3] = [Kind::VescsOnCan, Kind::VescsOnUarts, Kind::RoboClaw];
/// Process of the simulated devices.
const DEVICES: u32 = 9;
/// Period of commands and answers.
const PERIOD_MS: u64 = 20;

/// CRC-16 of both devices.
fn crc(bytes: &[u8]) -> [u8; 2] {
    let mut crc = 0_u16;
    for bit in bytes.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1)) {
        let feedback = (crc >> 15) as u8 ^ bit;
        crc = crc << 1 ^ if feedback == 1 { 0x1021 } else { 0 };
    }
    crc.to_be_bytes()
}

/// A packet of a VESC on a UART.
fn packet(payload: &[u8]) -> Vec<u8> {
    [&[2, payload.len() as u8], payload, &crc(payload), &[3]].concat()
}

/// The robot on these controllers.
struct Rig {
    kind: Kind,
    bench: Bench,
}

impl Rig {
    fn new(kind: Kind) -> Self {
        let limits = differential();
        let wheels = limits.wheels.iter().zip(0_u8..).map(|(wheel, number)| {
            let vesc = wire::Vesc { id: number + 1, host: number + 129, hold_ma: 10_000, quick_stop_ma: 30_000 };
            let line = format!("serial.{}", wheel.name);
            let protocol = match kind {
                Kind::VescsOnCan => wire::Protocol::VescOnCan(vesc),
                Kind::VescsOnUarts => wire::Protocol::VescOnUart { line, vesc },
                Kind::RoboClaw => wire::Protocol::RoboClaw {
                    line: "serial.wheels".into(),
                    of: wire::RoboClaw { address: 0x80, motor: number },
                },
            };
            wire::Wheel { drive: wire::Drive::of_controller(0, number, protocol), ..wheel.clone() }
        });
        let wheels = wheels.collect();
        let mut bench = Bench::with(Limits { wheels, coasting: Some(0.15), ..limits });
        bench.speed = 0.0;
        Self { kind, bench }
    }

    fn frame(&mut self, pid: u32, id: u32, data: &[u8]) {
        let frame = Frame::new(Id::Extended(id), data).unwrap();
        self.bench.tell(&News::Can { bus: "can", pid, frame });
    }

    fn words(&mut self, bus: &str, pid: u32, bytes: &[u8]) {
        let words: Vec<Word> = bytes.iter().copied().map(Word::data).collect();
        self.bench.tell(&News::Words { bus, pid, words: &words });
    }

    /// The driver commands both wheels, m/s; none: by its quick stop.
    fn command(&mut self, speeds: Option<[f64; 2]>) {
        let units = speeds.unwrap_or([0.0; 2]).map(|speed| (speed * 1000.0) as i32);
        for wheel in 0..2_u8 {
            let units = units[usize::from(wheel)];
            let (payload, value) = match (speeds, units) {
                (None, _) => (7, 30_000),
                (_, 0) => (7, 10_000),
                _ => (8, units),
            };
            let line = ["serial.left", "serial.right"][usize::from(wheel)];
            match self.kind {
                Kind::VescsOnCan => {
                    self.frame(DRIVER, u32::from(payload - 5_u8) << 8 | u32::from(wheel + 1), &value.to_be_bytes());
                }
                Kind::VescsOnUarts => {
                    self.words(line, DRIVER, &packet(&[&[payload][..], &value.to_be_bytes()].concat()));
                }
                Kind::RoboClaw => {}
            }
        }
        if self.kind == Kind::RoboClaw {
            let request = [&[0x80, 37][..], &units[0].to_be_bytes(), &units[1].to_be_bytes()].concat();
            self.words("serial.wheels", DRIVER, &[&request[..], &crc(&request)].concat());
            self.words("serial.wheels", DEVICES, &[0xFF]);
        }
    }

    /// The device of a wheel answers, with an error or without.
    fn answer(&mut self, wheel: u8, error: bool) {
        let values = [&[50][..], &[0; 20], &[if error { 4 } else { 0 }, wheel + 1, 0]].concat();
        match self.kind {
            Kind::VescsOnCan => {
                let host = u32::from(wheel + 129);
                for (part, number) in values.chunks(7).zip(0_u8..) {
                    self.frame(DEVICES, 5 << 8 | host, &[&[7 * number], part].concat());
                }
                let end = [&[wheel + 1, 1, 0, values.len() as u8][..], &crc(&values)].concat();
                self.frame(DEVICES, 7 << 8 | host, &end);
            }
            Kind::VescsOnUarts => {
                let line = ["serial.left", "serial.right"][usize::from(wheel)];
                self.words(line, DEVICES, &packet(&values));
            }
            Kind::RoboClaw => {
                self.words("serial.wheels", DRIVER, &[0x80, 90]);
                let status = [0, 0, if error { 0x10 } else { 0 }, 0];
                let check = crc(&[&[0x80, 90][..], &status].concat());
                self.words("serial.wheels", DEVICES, &[&status[..], &check].concat());
            }
        }
    }

    /// For this time an operator commands 0.4 m/s if `asks`, and the driver commands the wheels; `answers`: what the
    /// device of each answers, in error or not.
    fn run(&mut self, ms: u64, asks: bool, speeds: Option<[f64; 2]>, answers: [Option<bool>; 2]) {
        for step in 0..ms / PERIOD_MS {
            if asks && step % 2 == 0 {
                self.bench.act(&["velocity", "pad", "0.4", "0"]);
            }
            self.command(speeds);
            for (answer, wheel) in answers.into_iter().zip(0..) {
                if let Some(error) = answer {
                    self.answer(wheel, error);
                }
            }
            self.bench.pass(PERIOD_MS);
        }
    }

    fn drive(kind: Kind) -> Self {
        let mut rig = Self::new(kind);
        rig.run(200, false, None, WELL);
        rig.bench.act(&["velocity", "pad", "0", "0"]);
        rig.bench.pass(20);
        rig.bench.act(&["velocity", "pad", "0.4", "0"]);
        rig.bench.speed = 0.4;
        rig.run(600, true, Some([0.4; 2]), WELL);
        assert_eq!(rig.broken(), None, "{kind:?}");
        assert!(rig.bench.checkers.setpoints() > 20, "{kind:?}: {}", rig.bench.checkers.setpoints());
        rig
    }

    fn broken(&self) -> Option<&'static str> {
        self.bench.checkers.violation().map(|violation| violation.rule)
    }
}

/// Both devices answer, and have no error.
const WELL: [Option<bool>; 2] = [Some(false); 2];

#[test]
fn wheels_that_are_not_stopped_are_found_on_each_controller() {
    for kind in KINDS {
        // Its source is silent.
        for (speeds, expected) in [(Some([0.4; 2]), Some("fresh")), (Some([0.0, 0.4]), Some("fresh")), (None, None)] {
            let mut rig = Rig::drive(kind);
            rig.run(200, false, Some([0.4; 2]), WELL);
            assert_eq!(rig.broken(), None, "{kind:?}: a command has 250 ms to live");
            rig.run(200, false, speeds, WELL);
            assert_eq!(rig.broken(), expected, "{kind:?} {speeds:?}");
        }
        // Faster than any source commands.
        let mut rig = Rig::drive(kind);
        rig.run(60, true, Some([0.4, 0.45]), WELL);
        assert_eq!(rig.broken(), Some("fresh"), "{kind:?}");
        // PAUSE is engaged.
        for (speeds, expected) in [(Some([0.4; 2]), Some("pause")), (None, None)] {
            let mut rig = Rig::drive(kind);
            rig.bench.act(&["quiet", "power"]);
            rig.bench.act(&["line", "engaged"]);
            rig.run(100, true, speeds, WELL);
            assert_eq!(rig.broken(), expected, "{kind:?}");
        }
    }
}

#[test]
fn a_controller_that_is_lost_or_in_fault_stops_the_other_wheel_too() {
    for kind in KINDS {
        // A RoboClaw that does not answer is lost with both its wheels.
        for answer in [None, Some(true)].into_iter().filter(|answer| kind != Kind::RoboClaw || answer.is_some()) {
            for (speeds, expected) in [(Some([0.4, 0.0]), Some("drives")), (None, None)] {
                let mut rig = Rig::drive(kind);
                // In time.
                rig.run(if answer.is_none() { 160 } else { 0 }, true, Some([0.4; 2]), [Some(false), answer]);
                rig.run(40, true, speeds, [Some(false), answer]);
                rig.run(200, true, speeds, [Some(false), answer]);
                assert_eq!(rig.broken(), expected, "{kind:?} {answer:?} {speeds:?}");
            }
        }
    }
}

#[test]
fn another_program_that_commands_a_vesc_on_can_stops_the_robot() {
    for (speeds, expected) in [(Some([0.4; 2]), Some("rival")), (None, None)] {
        let mut rig = Rig::drive(Kind::VescsOnCan);
        let frame = rig.bench.checkers.facts.limits.wheels[0].drive.drive_at(200.0).unwrap();
        for _ in 0..5 {
            rig.bench.tell(&News::Can { bus: "can", pid: 0, frame });
            rig.run(20, true, speeds, WELL);
        }
        assert_eq!(rig.broken(), expected);
    }
}
