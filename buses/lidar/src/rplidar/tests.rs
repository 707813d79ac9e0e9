use super::emulated::Device;
use super::wire::{Descriptor, Info, Node, encode, get_conf, request};
use super::{Config, Mode, Model, Requests, Rplidar};
use crate::bench::{Bench, Cause, Seen, ms};
use crate::emulated::Device as _;
use crate::event::{Fault, Health, LostReason, State};
use crate::scan::{Sector, Status};
use base::{Duration, Instant};
use core::f64::consts::TAU;
use std::vec::Vec;
use testing::Random;

fn config(model: Model, mode: Mode) -> Config {
    Config { mode, ..Config::new(model) }
}

fn bench(model: Model, mode: Mode) -> Bench<Requests, Device> {
    Bench::new(Rplidar::new(config(model, mode)), Device::new(model))
}

const ALL: [(Model, Mode); 10] = [
    (Model::A1, Mode::Ultra),
    (Model::A1, Mode::Express),
    (Model::A1, Mode::Standard),
    (Model::A2, Mode::Express),
    (Model::A2, Mode::Standard),
    (Model::A3, Mode::Ultra),
    (Model::A3, Mode::Express),
    (Model::C1, Mode::Dense),
    (Model::C1, Mode::Standard),
    (Model::S2, Mode::Dense),
];

#[test]
fn requests_and_descriptors_are_those_of_the_notes() {
    // LR001: figures of each request and its response descriptor.
    assert_eq!(encode(request::STOP, &[])[..], [0xA5, 0x25]);
    assert_eq!(encode(request::RESET, &[])[..], [0xA5, 0x40]);
    assert_eq!(encode(request::SCAN, &[])[..], [0xA5, 0x20]);
    assert_eq!(encode(request::EXPRESS_SCAN, &[0; 5])[..], [0xA5, 0x82, 5, 0, 0, 0, 0, 0, 0x22]);
    assert_eq!(encode(request::SET_MOTOR_PWM, &660_u16.to_le_bytes())[..], [0xA5, 0xF0, 2, 0x94, 2, 0xC1]);
    assert_eq!(get_conf(0x7C, None)[..], [0xA5, 0x84, 4, 0x7C, 0, 0, 0, 0x59]);
    for (bytes, len, many, kind) in [
        ([0xA5, 0x5A, 0x14, 0, 0, 0, 0x04], 20, false, 0x04),
        ([0xA5, 0x5A, 0x03, 0, 0, 0, 0x06], 3, false, 0x06),
        ([0xA5, 0x5A, 0x04, 0, 0, 0, 0x15], 4, false, 0x15),
        ([0xA5, 0x5A, 0x05, 0, 0, 0x40, 0x81], 5, true, 0x81),
        ([0xA5, 0x5A, 0x54, 0, 0, 0x40, 0x82], 84, true, 0x82),
        ([0xA5, 0x5A, 0x84, 0, 0, 0x40, 0x84], 132, true, 0x84),
    ] {
        let descriptor = Descriptor { len, many, kind };
        assert_eq!(Descriptor::decode(&bytes), Some(descriptor));
        assert_eq!(descriptor.encode(), bytes);
    }
}

#[test]
fn samples_and_identities_survive_their_encoding() {
    let node = Node { starts: true, quality: 15, angle_q6: 23_039, range_q2: 4321 };
    assert_eq!(Node::decode(&node.encode()), Some(node));
    // Both start bits equal; no check bit; an angle of a turn.
    for bytes in [[0x3F, 1, 0, 0, 0], [0x3C, 1, 0, 0, 0], [0x3D, 0, 0, 0, 0], [0x3D, 0x01, 0xB4, 0, 0]] {
        assert_eq!(Node::decode(&bytes), None, "{bytes:?}");
    }
    let info = Info { model: 0x18, firmware: (1, 29), hardware: 7, serial: [9; 16] };
    assert_eq!(Info::decode(&info.encode()), Some(info));
    assert!(info.has_conf() && !Info { firmware: (1, 23), ..info }.has_conf());
}

#[test]
fn every_model_and_mode_starts_and_measures_its_surroundings() {
    for (model, mode) in ALL {
        let mut bench = bench(model, mode);
        // A room of 4 m by 6 m, the device off its middle.
        for n in 0..crate::emulated::DIRECTIONS {
            let (sin, cos) = libm::sincos(n as f64 / crate::emulated::DIRECTIONS as f64 * TAU);
            let x = if cos > 0.0 { 2.5 / cos } else { -1.5 / cos };
            let y = if sin > 0.0 { 3.5 / sin } else { -2.5 / sin };
            bench.device.scene().0[n] = x.min(y) as f32;
        }
        bench.pass(ms(1500));
        let Some((_, Seen::Identity(text))) = bench.seen.first() else { panic!("{:?}", bench.seen) };
        let found = std::format!("RPLIDAR model 0x{}8 firmware 1.{}", model.major(), bench.device.firmware.1);
        assert!(text.starts_with(&found), "{text}");
        assert_eq!(bench.seen[1].1, Seen::Health(Health::Good));
        bench.run();
        bench.pass(ms(1000));
        let revolution = bench.sectors[20].revolution;
        let sectors: Vec<&Sector> = bench.sectors.iter().filter(|it| it.revolution == revolution).collect();
        let expected = if model == Model::S2 || mode == Mode::Standard { 8 } else { 16 };
        assert!((expected..=expected + 2).contains(&sectors.len()), "{model} {mode}: {}", sectors.len());
        let (mut worst, mut missing, mut count) = (0.0_f32, 0, 0);
        for sector in &sectors {
            assert_eq!(sector.status, Status::Ok, "{model} {mode}");
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
        std::println!("{model:10} {mode:8} {count} beams, {missing} not measured, at most {worst:.3} m off");
        assert!(worst < 0.02 && missing * 50 < count, "{model} {mode}: {worst} m, {missing} of {count}");
    }
}

#[test]
fn a_capsule_is_taken_when_it_arrives_and_by_the_next_one_while_the_speed_changes() {
    let modes = [
        (Model::C1, Mode::Dense, ms(12)),
        (Model::S2, Mode::Dense, ms(12)),
        (Model::A1, Mode::Express, ms(18)),
        (Model::A2, Mode::Express, ms(18)),
    ];
    for (model, mode, age) in modes {
        let mut bench = bench(model, mode);
        // Half of all is near, and half is far: the border is where it should be, whichever way a capsule is taken.
        for (n, range) in bench.device.scene().0.iter_mut().enumerate() {
            *range = if n < crate::emulated::DIRECTIONS / 2 { 2.0 } else { 6.0 };
        }
        bench.run();
        bench.pass(ms(1500));
        for slow in [false, true, false] {
            bench.device.faults().motor_slow = slow;
            bench.sectors.clear();
            for _ in 0..900 {
                let before = bench.sectors.len();
                bench.pass(ms(1));
                let now = bench.now;
                for sector in &bench.sectors[before..] {
                    let last = sector.ranges_m.len() - 1;
                    for (k, range) in sector.ranges_m.iter().enumerate().filter(|(_, range)| !range.is_nan()) {
                        let angle = crate::scan::wrap(sector.angle_rad(k));
                        let off = angle.abs().min(TAU / 2.0 - angle.abs());
                        let expected = if angle > 0.0 { 2.0 } else { 6.0 };
                        let is_right = (range - expected).abs() < 0.02 || off < 1.6_f64.to_radians();
                        assert!(
                            is_right,
                            "{model} slow {slow} at {now:?}: {range} m at {} degrees",
                            angle.to_degrees()
                        );
                    }
                    let end = sector.at + Duration::from_secs_f64(last as f64 * sector.beam_time_s);
                    if model != Model::S2 && !slow && bench.sectors.len() > 100 {
                        // A capsule of 8 ms that began just then, its 1.8 or 7.3 ms on the wire, a step of the test and
                        // a sample; not another capsule.
                        assert!(now.since(end) <= age, "{model}: {:?}", now.since(end));
                    }
                }
            }
            assert!(bench.sectors.len() > 15, "{model}: {}", bench.sectors.len());
        }
    }
}

#[test]
fn an_emulated_device_turns_however_long_ago_the_clock_began() {
    for (model, mode) in ALL {
        let mut bench = bench(model, mode);
        // Eleven days.
        bench.now = Instant::from_millis(1_000_000_000);
        bench.run();
        bench.pass(ms(500));
        assert!(bench.sectors.len() > 30, "{model} {mode}: {}", bench.sectors.len());
        assert!(bench.sectors.iter().all(|sector| sector.status == Status::Ok), "{model} {mode}");
    }
}

#[test]
fn twenty_faults_are_reported_within_a_second_and_end_within_two() {
    for (model, mode) in ALL.into_iter().filter(|(_, mode)| *mode != Mode::Standard) {
        std::println!("{model} {mode}");
        bench(model, mode).suffers_all(&OWN);
    }
}

#[test]
fn faults_of_a_bit_of_ten_thousand_are_reported_and_one_disturbance_is_not() {
    for (model, mode) in ALL {
        let name = std::format!("{model} {mode}");
        let mut bench = bench(model, mode);
        bench.shrugs_off(&name);
        let reports = bench.disturbed(&name, 200, |faults| faults.wrong_bits_ppm = 100);
        // An A1, A2 or C1 sends about nine damaged capsules a second: in 0.3 % of all trials they need longer than 1 s.
        // Most bits of a single sample can be wrong without being noticed.
        let (in_1_s, in_2_s) = match (model, mode) {
            (_, Mode::Standard) => (120, 170),
            (Model::A3 | Model::S2, _) => (200, 200),
            _ => (197, 200),
        };
        assert!(reports.within(ms(1000)) >= in_1_s && reports.within(ms(2000)) >= in_2_s, "{name}: {reports:?}");
        assert!(reports.ends == 0 || mode == Mode::Standard, "{name}");
    }
    for (model, mode) in [(Model::A1, Mode::Express), (Model::A3, Mode::Ultra), (Model::C1, Mode::Dense)] {
        let name = std::format!("{model}, 1 of 10,000 bytes");
        bench(model, mode).disturbed(&name, 50, |faults| faults.noise_ppm = 100);
    }
}

#[test]
fn single_samples_suffer_twenty_faults_too() {
    for (model, mode) in ALL.into_iter().filter(|(_, mode)| *mode == Mode::Standard) {
        std::println!("{model} {mode}");
        bench(model, mode).suffers_all(&OWN);
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
fn another_model_is_refused_and_sent_no_scan() {
    let mut bench = bench(Model::A2, Mode::Express);
    bench.device.faults().stranger = true;
    bench.pass(ms(1000));
    assert!(bench.has(&Seen::Lost(LostReason::Identity)), "{:?}", bench.seen);
    assert!(bench.sent.iter().all(|request| request[1] != request::EXPRESS_SCAN));
    assert!(bench.sent.iter().all(|request| request[1] != request::SET_MOTOR_PWM));
}

#[test]
fn a_device_with_an_error_is_reset_every_other_start() {
    let mut bench = bench(Model::A1, Mode::Express);
    bench.device.faults().error = true;
    bench.pass(ms(3000));
    assert!(bench.has(&Seen::Health(Health::Error { code: 0x8002 })));
    assert!(bench.has(&Seen::Lost(LostReason::Device { code: 0x8002 })));
    let resets = bench.sent.iter().filter(|request| request[1] == request::RESET).count();
    let starts = bench.sent.iter().filter(|request| request[1] == request::STOP).count();
    assert!(resets >= 2 && starts > resets, "{resets} of {starts}");
    bench.device.faults().error = false;
    bench.pass(ms(2000));
    assert_eq!(bench.engine.state(), State::Running);
}

#[test]
fn a_mode_that_the_device_does_not_have_is_refused() {
    let mut bench = bench(Model::C1, Mode::Ultra);
    bench.pass(ms(1000));
    assert!(bench.has(&Seen::Lost(LostReason::Refused { code: 0x81 })), "{:?}", bench.seen);
}

#[test]
fn a_slow_motor_marks_its_sectors() {
    for (model, mode) in [(Model::A2, Mode::Standard), (Model::A2, Mode::Express)] {
        let mut bench = bench(model, mode);
        bench.run();
        bench.device.faults().motor_slow = true;
        bench.pass(ms(1000));
        bench.sectors.clear();
        bench.pass(ms(700));
        assert!(bench.has(&Seen::Fault(Fault::Slow, true)));
        assert!(!bench.sectors.is_empty() && bench.sectors.iter().all(|it| it.status == Status::Slow), "{mode}");
    }
}

#[test]
fn hostile_bytes_in_any_state_do_no_harm() {
    for (model, mode) in [(Model::A1, Mode::Standard), (Model::A3, Mode::Ultra)] {
        let mut random = Random::new(7);
        let mut bench = bench(model, mode);
        for n in 0..60_000_u32 {
            let mut bytes: Vec<u8> = (0..random.index(6)).map(|_| random.edge_byte()).collect();
            if random.one_in(60) {
                bytes.extend([0xA5, 0x5A]);
                bytes.extend(random.bytes(5));
            }
            if random.one_in(60) {
                let mut capsule = random.bytes(132);
                super::capsule::seal(&mut capsule);
                bytes.extend(capsule);
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
