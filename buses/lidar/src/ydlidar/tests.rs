use super::emulated::Device;
use super::wire::{HEAD, Packet, SAMPLES_MAX, answer, command, correction_rad, far_rad, radians};
use super::{Commands, Config, Model, Ydlidar};
use crate::bench::{Bench, Cause, LINE, Seen, ms};
use crate::emulated::{DIRECTIONS, Device as _, Faults};
use crate::event::{Fault, Health, LostReason, State};
use crate::ld::NoEcho;
use crate::rplidar::wire::{Descriptor, Info, encode};
use crate::scan::{Sector, Status};
use base::{Duration, Instant};
use core::f64::consts::TAU;
use std::vec::Vec;
use testing::Random;

/// `YDLidar-SDK`, *Communication Protocol*, "example": a packet that starts a revolution.
const START: [u8; 12] = [0xAA, 0x55, 0x01, 0x01, 0x53, 0xAE, 0x53, 0xAE, 0xAB, 0x54, 0x00, 0x00];

/// A packet of 40 samples as a device sent it, from a public script that explains the protocol.
const RECORDED: [u8; 90] = [
    0xAA, 0x55, 0x00, 0x28, 0xE1, 0x4B, 0x2B, 0x51, 0xF8, 0x28, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x4C, 0x4F, 0x00, 0x00, 0x48, 0x59, 0xA8, 0x59, 0xCC, 0x59, 0xCC, 0x59, 0x00, 0x00, 0x54, 0x57, 0x00, 0x00, 0xC0,
    0x54, 0x00, 0x00, 0x58, 0x52, 0x68, 0x51, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0xF8, 0x32, 0x98, 0x32, 0x4C, 0x32, 0x04, 0x32, 0xC8, 0x31, 0x70, 0x31,
];

fn bench(model: Model) -> Bench<Commands, Device> {
    Bench::new(Ydlidar::new(Config::new(model)), Device::new(model))
}

#[test]
fn commands_and_answers_are_those_of_the_manuals() {
    // G4 manual, chart 1 and the figures of each command and its answer; X4 manual V1.6, chapter 3.
    for (number, bytes) in [
        (command::SCAN, [0xA5, 0x60]),
        (command::STOP, [0xA5, 0x65]),
        (command::GET_INFO, [0xA5, 0x90]),
        (command::GET_HEALTH, [0xA5, 0x91]),
        (command::GET_SPEED, [0xA5, 0x0D]),
        (command::GET_RATE, [0xA5, 0xD1]),
        (Model::G4.restart(), [0xA5, 0x40]),
        (Model::X4.restart(), [0xA5, 0x80]),
    ] {
        assert_eq!(encode(number, &[])[..], bytes);
    }
    for (bytes, len, many, kind) in [
        ([0xA5, 0x5A, 0x05, 0, 0, 0x40, 0x81], 5, true, answer::PACKETS),
        ([0xA5, 0x5A, 0x14, 0, 0, 0, 0x04], 20, false, answer::VALUE),
        ([0xA5, 0x5A, 0x03, 0, 0, 0, 0x06], 3, false, answer::HEALTH),
        ([0xA5, 0x5A, 0x01, 0, 0, 0, 0x04], 1, false, answer::VALUE),
    ] {
        let descriptor = Descriptor { len, many, kind };
        assert_eq!(Descriptor::decode(&bytes), Some(descriptor));
        assert_eq!(descriptor.encode(), bytes);
    }
}

#[test]
fn the_examples_of_the_documents_are_read_and_written() {
    let packet = Packet::decode(&START).expect("valid");
    assert_eq!((packet.starts, packet.speed, &packet.samples[..]), (true, 0, &[0][..]));
    assert_eq!((packet.first_q6, packet.last_q6), (0xAE53 >> 1, 0xAE53 >> 1));
    assert_eq!(packet.encode()[..], START);

    let packet = Packet::decode(&RECORDED).expect("valid");
    assert_eq!((packet.starts, packet.samples.len()), (false, 40));
    assert_eq!([packet.first_q6, packet.last_q6].map(|q6| f64::from(q6) / 64.0), [151.75, 162.328_125]);
    let mm: Vec<f64> = packet.samples.iter().map(|range| f64::from(*range) / 4.0).filter(|mm| *mm > 0.0).collect();
    assert_eq!(
        mm,
        [
            5075.0, 5714.0, 5738.0, 5747.0, 5747.0, 5589.0, 5424.0, 5270.0, 5210.0, 3262.0, 3238.0, 3219.0, 3201.0,
            3186.0, 3164.0
        ]
    );
    assert_eq!(packet.encode()[..], RECORDED);

    // "Distance analysis" and "Angle analysis": the sample E5 6F, and the angles of 28 E5 6F BD 79.
    assert_eq!(f64::from(u16::from_le_bytes([0xE5, 0x6F])) / 4.0, 7161.25);
    let packet = Packet {
        starts: false,
        speed: 0,
        first_q6: 0x6FE5 >> 1,
        last_q6: 0x79BD >> 1,
        samples: core::iter::repeat_n(0, 40).collect(),
    };
    assert_eq!(packet.encode()[3..8], [0x28, 0xE5, 0x6F, 0xBD, 0x79]);
    let degrees = |q6: u16| f64::from(q6) / 64.0;
    let near = |value: f64, expected: f64, within: f64| assert!((value - expected).abs() < within, "{value}");
    near(degrees(packet.first_q6), 223.78, 0.01);
    near(degrees(packet.last_q6), 243.47, 0.01);
    near(degrees(packet.span_q6()), 19.69, 0.01);
    near(correction_rad(1000.0).to_degrees(), -6.7622, 1e-4);
    near(correction_rad(8000.0).to_degrees(), -7.8374, 1e-4);
    near(degrees(packet.first_q6) + correction_rad(1000.0).to_degrees(), 217.0178, 0.01);
    near(degrees(packet.last_q6) + correction_rad(8000.0).to_degrees(), 235.6326, 0.01);
    assert_eq!(correction_rad(0.0), 0.0);
    near(correction_rad(1e9), far_rad(), 1e-6);
}

#[test]
fn identities_survive_their_encoding() {
    let info =
        Info { model: 6, firmware: (1, 10), hardware: 1, serial: *b"\x02\0\x02\0\0\x06\x02\x02\0\0\0\0\x02\x02\0\x09" };
    assert_eq!(Info::decode(&info.encode()), Some(info));
    // Issue of YDLidar-SDK: an X4 with this serial number, as the SDK prints it.
    assert_eq!(&super::serial(&info)[..], b"2020062200002209");
}

#[test]
fn a_damaged_bit_anywhere_is_refused() {
    for bit in 0..RECORDED.len() * 8 {
        let mut bytes = RECORDED;
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(Packet::decode(&bytes), None, "bit {bit}");
    }
    for end in 0..RECORDED.len() {
        assert_eq!(Packet::decode(&RECORDED[..end]), None, "{end} bytes");
    }
}

#[test]
fn every_model_starts_and_measures_its_surroundings() {
    for model in Model::ALL {
        let mut bench = bench(model);
        // A room of 4 m by 6 m, the device off its middle.
        for n in 0..DIRECTIONS {
            let (sin, cos) = libm::sincos(n as f64 / DIRECTIONS as f64 * TAU);
            let x = if cos > 0.0 { 2.5 / cos } else { -1.5 / cos };
            let y = if sin > 0.0 { 3.5 / sin } else { -2.5 / sin };
            bench.device.scene().0[n] = x.min(y) as f32;
        }
        bench.pass(ms(1500));
        let Some((_, Seen::Identity(text))) = bench.seen.first() else { panic!("{:?}", bench.seen) };
        let number = model.number();
        assert_eq!(*text, std::format!("YDLIDAR model {number} firmware 1.10 hardware 1 serial 2020062200002209"));
        assert_eq!(bench.seen[1].1, Seen::Health(Health::Good));
        bench.run();
        bench.pass(ms(1000));
        let revolution = bench.sectors[20].revolution;
        let sectors: Vec<&Sector> = bench.sectors.iter().filter(|it| it.revolution == revolution).collect();
        assert!((16..=18).contains(&sectors.len()), "{model}: {}", sectors.len());
        let (mut worst, mut missing, mut count) = (0.0_f32, 0, 0);
        for sector in &sectors {
            assert_eq!(sector.status, Status::Ok, "{model}");
            assert!(sector.angle_step_rad < 0.0, "clockwise");
            let period = sector.beam_time_s * f64::from(model.samples_per_s());
            // The angles of few samples differ more: each is corrected for its range.
            assert!((period - 1.0).abs() < 0.05 + 0.5 / sector.ranges_m.len() as f64, "{model}: {period}");
            for (k, range) in sector.ranges_m.iter().enumerate() {
                count += 1;
                // The nearest difference to any direction within one step: the grid, and the quantum of the scene.
                let reach = sector.angle_step_rad.abs().max(TAU / 720.0);
                let near = (-8..=8).map(|part| sector.angle_rad(k) + f64::from(part) / 8.0 * reach);
                let expected = near.map(|angle| bench.device.scene().range_m(angle));
                let off = expected.map(|it| (range - it).abs()).fold(f32::MAX, f32::min);
                if range.is_nan() { missing += 1 } else { worst = worst.max(off) }
            }
        }
        std::println!("{model:10} {count} beams, {missing} not measured, at most {worst:.3} m off");
        assert!(worst < 0.02 && missing * 50 < count, "{model}: {worst} m, {missing} of {count}");
        let beams = f64::from(model.samples_per_s()) / if model == Model::X4 { 7.0 } else { 10.0 };
        assert!((f64::from(count) - beams).abs() < 0.03 * beams, "{model}: {count} of {beams}");
        let next = bench.sectors.iter().find(|sector| sector.revolution == revolution + 1).map(|sector| sector.at);
        let turn = next.map(|next| next.since(sectors[0].at)).unwrap_or_default();
        let expected = if model == Model::X4 { Duration::from_micros(142_857) } else { ms(100) };
        assert!(turn.abs_diff(expected) < ms(6), "{model}: {turn:?}");
    }
}

#[test]
fn beams_are_as_old_as_their_packet_and_the_line_make_them() {
    for model in Model::ALL {
        let mut bench = bench(model);
        bench.run();
        let mut oldest = Duration::ZERO;
        for _ in 0..1500 {
            let before = bench.sectors.len();
            bench.pass(ms(1));
            for sector in &bench.sectors[before..] {
                let last = (sector.ranges_m.len() - 1) as f64 * sector.beam_time_s;
                let age = bench.now.since(sector.at + Duration::from_secs_f64(last));
                assert!(age >= ms(1), "{model}: {age:?}");
                oldest = oldest.max(age);
            }
        }
        // A packet of 8 ms (X4) or 9 ms (G4), 7 ms on the wire, a sample, and a step of the test.
        assert!((ms(12)..ms(18)).contains(&oldest), "{model}: {oldest:?}");
    }
}

#[test]
fn near_and_far_are_where_they_are() {
    // Half of all is near, and half is far: beams of both lie beside the head by different angles.
    for model in Model::ALL {
        let mut bench = bench(model);
        for (n, range) in bench.device.scene().0.iter_mut().enumerate() {
            *range = if n < DIRECTIONS / 2 { 0.5 } else { 6.0 };
        }
        bench.run();
        bench.pass(ms(1500));
        let mut count = 0;
        for sector in &bench.sectors {
            for (k, range) in sector.ranges_m.iter().enumerate().filter(|(_, range)| !range.is_nan()) {
                let angle = sector.angle_rad(k);
                let off = angle.abs().min(TAU / 2.0 - angle.abs());
                let expected = if angle > 0.0 { 0.5 } else { 6.0 };
                count += 1;
                let degrees = angle.to_degrees();
                // A sector has one grid, and the beams of both lie closer where they meet.
                assert!(
                    (range - expected).abs() < 0.01 || off < 4.0_f64.to_radians(),
                    "{model}: {range} m at {degrees}°"
                );
            }
        }
        assert!(count > 3000, "{model}: {count}");
    }
}

#[test]
fn a_beam_without_echo_points_to_where_it_would_have_met_something_far() {
    let mut bench =
        Bench::new(Ydlidar::new(Config { no_echo: NoEcho::Nothing, ..Config::new(Model::X4) }), Device::new(Model::X4));
    // A post of 4° at 9 m to the left; nothing else.
    for (n, range) in bench.device.scene().0.iter_mut().enumerate() {
        *range = if n.abs_diff(DIRECTIONS / 4) <= 4 { 9.0 } else { f32::INFINITY };
    }
    bench.run();
    bench.pass(ms(1000));
    for sector in &bench.sectors {
        for (k, range) in sector.ranges_m.iter().enumerate() {
            let off = (sector.angle_rad(k) - TAU / 4.0).abs().to_degrees();
            assert!(range.is_finite() || off > 1.0, "free at {off}° from the middle of the post");
            assert!(*range == f32::INFINITY || off < 3.5, "{range} m at {off}°");
        }
    }
}

#[test]
fn the_rate_of_a_g4_is_asked_for() {
    for (rate, samples_per_s, range_min_m) in [(0, 4000.0, 0.1), (1, 8000.0, 0.26), (2, 9000.0, 0.28)] {
        let mut bench = bench(Model::G4);
        bench.device.rate = rate;
        bench.run();
        bench.pass(ms(500));
        let sector = bench.sectors.last().expect("measures");
        assert!((sector.beam_time_s * samples_per_s - 1.0).abs() < 0.05, "{rate}");
        assert_eq!((sector.range_min_m, sector.status), (range_min_m, Status::Ok), "{rate}");
    }
    let mut bench = bench(Model::G4);
    bench.device.rate = 7;
    bench.pass(ms(1000));
    assert!(bench.has(&Seen::Lost(LostReason::Refused { code: 7 })), "{:?}", bench.seen);
}

#[test]
fn an_emulated_device_turns_however_long_ago_the_clock_began() {
    for model in Model::ALL {
        let mut bench = bench(model);
        // Eleven days.
        bench.now = Instant::from_millis(1_000_000_000);
        bench.run();
        bench.pass(ms(500));
        assert!(bench.sectors.len() > 25, "{model}: {}", bench.sectors.len());
        assert!(bench.sectors.iter().all(|sector| sector.status == Status::Ok), "{model}");
    }
}

const OWN: [Cause; 6] = [
    ("motor stands", |faults| faults.motor_stopped = true),
    ("motor slow", |faults| faults.motor_slow = true),
    ("device hangs", |faults| faults.hangs = true),
    ("error of the device", |faults| faults.error = true),
    ("nothing reaches it, and it hangs", |faults| (faults.deaf, faults.hangs) = (true, true)),
    ("another model after a power cycle", |faults| (faults.stranger, faults.error) = (true, true)),
];

#[test]
fn twenty_faults_are_reported_within_a_second_and_end_within_two() {
    for model in Model::ALL {
        std::println!("{model}");
        let mut bench = bench(model);
        for (name, set) in LINE.into_iter().chain(OWN) {
            bench.suffers(name, set);
        }
    }
}

#[test]
fn another_model_is_refused_and_sent_no_scan() {
    let mut bench = bench(Model::X4);
    bench.device.faults().stranger = true;
    bench.pass(ms(1000));
    assert!(bench.has(&Seen::Lost(LostReason::Identity)), "{:?}", bench.seen);
    assert!(bench.sent.iter().all(|command| command[1] != command::SCAN));
    // Manuals have another number, the same for several models.
    assert!(Model::ALL.into_iter().all(|model| model.may_have(4) && !model.may_have(8)));
    assert!(!Model::X4.may_have(Model::G4.number()) && !Model::G4.may_have(Model::X4.number()));
}

#[test]
fn a_device_with_an_error_is_restarted_every_other_start() {
    for model in Model::ALL {
        let mut bench = bench(model);
        bench.device.faults().error = true;
        bench.pass(ms(3000));
        assert!(bench.has(&Seen::Health(Health::Error { code: 2 })));
        assert!(bench.has(&Seen::Lost(LostReason::Device { code: 2 })));
        let restarts = bench.sent.iter().filter(|command| command[1] == model.restart()).count();
        let starts = bench.sent.iter().filter(|command| command[1] == command::STOP).count();
        assert!(restarts >= 2 && starts > restarts, "{restarts} of {starts}");
        bench.device.faults().error = false;
        bench.pass(ms(2500));
        assert_eq!(bench.engine.state(), State::Running);
    }
}

#[test]
fn a_warning_is_told_and_measured_with() {
    let mut bench = bench(Model::G4);
    bench.device.faults().dirty = true;
    bench.pass(ms(1500));
    assert!(bench.has(&Seen::Health(Health::Warning { code: 4 })));
    assert_eq!(bench.engine.state(), State::Running);
}

#[test]
fn a_slow_motor_marks_its_sectors() {
    for model in Model::ALL {
        let mut bench = bench(model);
        bench.run();
        bench.device.faults().motor_slow = true;
        bench.pass(ms(1000));
        bench.sectors.clear();
        bench.pass(ms(700));
        assert!(bench.has(&Seen::Fault(Fault::Slow, true)));
        assert!(!bench.sectors.is_empty() && bench.sectors.iter().all(|it| it.status == Status::Slow), "{model}");
    }
}

#[test]
fn a_speed_that_the_device_says_counts_too() {
    let mut bench = scanning(Model::G4);
    for (tenths, is_slow) in [(0, false), (30, true), (100, false), (127, false), (44, true)] {
        for n in 0..18_u16 {
            let first = n * 1280 % 23_040;
            if n == 0 {
                let start = Packet { starts: true, speed: tenths, ..packet(23_039, 23_039, 1) };
                bench.engine.handle_rx(bench.now, &start.encode());
            }
            bench.engine.handle_rx(bench.now, &packet(first, first + 1248, 40).encode());
            bench.step();
        }
        assert_eq!(bench.engine.is_active(Fault::Slow), is_slow, "{tenths}");
    }
}

/// An engine that was answered and scans, and what it is fed after that.
fn scanning(model: Model) -> Bench<Commands, Device> {
    let mut bench = bench(model);
    bench.run();
    *bench.device.faults() = Faults { mute: true, ..Faults::default() };
    bench.pass(ms(30));
    bench.seen.clear();
    bench.sectors.clear();
    bench
}

fn packet(first_q6: u16, last_q6: u16, count: usize) -> Packet {
    let samples = core::iter::repeat_n(8000, count).collect();
    Packet { starts: false, speed: 0, first_q6, last_q6, samples }
}

#[test]
fn packets_that_do_not_turn_measure_nothing() {
    // A motor that stands, and a device that repeats itself, with packets of all lengths.
    for (first, last, count) in [(640, 640, 40), (640, 1280, 40), (640, 640, 1), (640, 672, 2)] {
        let mut bench = scanning(Model::X4);
        let bytes = packet(first, last, count).encode();
        let mut valid = 0;
        for _ in 0..600 {
            bench.engine.handle_rx(bench.now, &bytes);
            bench.step();
            valid += usize::from(bench.engine.state() == State::Running);
        }
        assert!(bench.has(&Seen::Lost(LostReason::Stalled)), "{first} {last} {count}: {:?}", bench.seen);
        assert!(valid < 500 && bench.sectors.len() <= 2, "{first} {last} {count}: {}", bench.sectors.len());
    }
}

#[test]
fn packets_that_turn_too_fast_or_back_are_refused() {
    // 40 samples on half a turn are 64 turns a second; one that goes back is as far ahead as nearly a turn.
    for packets in [[packet(0, 11_520, 40), packet(11_520, 23_039, 40)], [packet(900, 450, 40), packet(420, 10, 40)]] {
        let mut bench = scanning(Model::X4);
        for n in 0..20 {
            bench.engine.handle_rx(bench.now, &packets[n % 2].encode());
            bench.step();
        }
        assert!(bench.sectors.is_empty() && bench.engine.counters().rejected >= 20);
    }
}

#[test]
fn a_damaged_packet_is_not_measured_and_the_next_one_is() {
    let mut bench = scanning(Model::X4);
    // The one before the first.
    bench.engine.handle_rx(bench.now, &packet(21_760, 23_008, 40).encode());
    let before = *bench.engine.counters();
    let mut stream = Vec::new();
    for n in 0..30_u16 {
        let mut bytes = packet(n * 1280 % 23_040, (n * 1280 + 1248) % 23_040, 40).encode();
        match n {
            // A wrong checksum; samples cut off; a length that is too great; a header within.
            7 => bytes[9] ^= 0x10,
            11 => bytes.truncate(61),
            15 => bytes[3] = 41,
            19 => bytes[20..24].copy_from_slice(&[0xAA, 0x55, 0x00, 0x05]),
            _ => {}
        }
        stream.extend_from_slice(&bytes);
    }
    for bytes in stream.chunks(80) {
        bytes.iter().for_each(|byte| bench.engine.handle_rx(bench.now, &[*byte]));
        bench.step();
    }
    let after = bench.engine.counters();
    assert_eq!(after.messages - before.messages, 26);
    assert!((4..=6).contains(&(after.rejected - before.rejected)), "{after:?}");
    let ranges = bench.sectors.iter().flat_map(|sector| &sector.ranges_m);
    assert!(ranges.clone().count() > 900 && ranges.clone().all(|range| range.is_nan() || *range == 2.0));
}

#[test]
fn too_near_is_not_free_and_not_anywhere() {
    let mut bench = scanning(Model::X4);
    for n in 0..30_u16 {
        let mut packet = packet(n * 1280 % 23_040, (n * 1280 + 1248) % 23_040, 40);
        // 1 mm, which would be 87° before the head.
        packet.samples.iter_mut().for_each(|range| *range = 4);
        bench.engine.handle_rx(bench.now, &packet.encode());
        bench.step();
    }
    assert!((20..=40).contains(&bench.sectors.len()), "{}", bench.sectors.len());
    assert!(bench.sectors.iter().all(|sector| sector.ranges_m.iter().all(|range| *range == f32::NEG_INFINITY)));
}

#[test]
fn hostile_bytes_in_any_state_do_no_harm() {
    for model in Model::ALL {
        let mut random = Random::new(7);
        let mut bench = bench(model);
        for n in 0..60_000_u32 {
            let mut bytes: Vec<u8> = (0..random.index(6)).map(|_| random.edge_byte()).collect();
            if random.one_in(60) {
                bytes.extend([0xA5, 0x5A]);
                bytes.extend(random.bytes(5));
            }
            if random.one_in(60) {
                let count = 1 + random.index(SAMPLES_MAX);
                let samples = random.bytes(2 * count);
                let packet = Packet {
                    starts: random.one_in(8),
                    speed: random.edge_byte() & 0x7F,
                    first_q6: (random.index(23_040)) as u16,
                    last_q6: (random.index(23_040)) as u16,
                    samples: samples.chunks_exact(2).map(|word| u16::from_le_bytes([word[0], word[1]])).collect(),
                };
                bytes.extend(packet.encode());
            }
            bench.engine.handle_rx(bench.now, &bytes);
            bench.device.handle_rx(bench.now, &bytes);
            while bench.engine.poll_event().is_some() {}
            if n % 8 == 0 {
                bench.step();
            }
        }
        assert!(bench.engine.counters().rejected > 0);
        bench.device = Device::new(model);
        bench.pass(Duration::from_secs(6));
        assert_eq!(bench.engine.state(), State::Running);
    }
}

#[test]
fn any_bytes_decode_to_a_packet_that_encodes_to_them_or_to_none() {
    let mut random = Random::new(11);
    let mut valid = 0;
    for _ in 0..20_000 {
        let count = 1 + random.index(SAMPLES_MAX);
        let mut bytes = random.bytes(HEAD + 2 * count);
        bytes[..2].copy_from_slice(&[0xAA, 0x55]);
        bytes[2] &= 1;
        bytes[3] = count as u8;
        (bytes[4], bytes[6]) = (bytes[4] | 1, bytes[6] | 1);
        let sum = bytes.chunks_exact(2).fold(0, |sum, word| sum ^ u16::from_le_bytes([word[0], word[1]]));
        let [low, high] = sum.to_le_bytes();
        (bytes[8], bytes[9]) = (bytes[8] ^ low, bytes[9] ^ high);
        if let Some(packet) = Packet::decode(&bytes) {
            valid += 1;
            assert_eq!(packet.encode()[..], bytes);
            assert!(radians(f64::from(packet.first_q6)) < TAU && radians(f64::from(packet.last_q6)) < TAU);
        }
    }
    assert!(valid > 5000, "{valid}");
}
