use super::emulated::Device;
use super::wire::{self, LENGTH, Packet};
use super::{Config, LdLidar, Model, NoEcho};
use crate::bench::{Bench, Cause, Seen, ms};
use crate::emulated::Device as _;
use crate::event::{Fault, LostReason, State};
use crate::scan::Status;
use crate::{Event, Sector};
use base::{Duration, Instant};
use core::f64::consts::TAU;
use std::vec::Vec;
use testing::Random;

/// LDROBOT, *LD19 Development Manual*, section 3, and the same in that of the LD06: example packet and its values.
const EXAMPLE: [u8; LENGTH] = [
    0x54, 0x2C, 0x68, 0x08, 0xAB, 0x7E, 0xE0, 0x00, 0xE4, 0xDC, 0x00, 0xE2, 0xD9, 0x00, 0xE5, 0xD5, 0x00, 0xE3, 0xD3,
    0x00, 0xE4, 0xD0, 0x00, 0xE9, 0xCD, 0x00, 0xE4, 0xCA, 0x00, 0xE2, 0xC7, 0x00, 0xE9, 0xC5, 0x00, 0xE5, 0xC2, 0x00,
    0xE5, 0xC0, 0x00, 0xE5, 0xBE, 0x82, 0x3A, 0x1A, 0x50,
];

fn lidar(model: Model, no_echo: NoEcho) -> LdLidar {
    LdLidar::new(Config { model, no_echo })
}

fn bench(model: Model) -> Bench<super::Packets, Device> {
    Bench::new(lidar(model, NoEcho::Unknown), Device::new(model))
}

#[test]
fn the_example_of_the_manual_is_read_and_written() {
    let packet = Packet::decode(&EXAMPLE).expect("valid");
    assert_eq!((packet.speed, packet.start_angle, packet.end_angle), (2152, 32_427, 33_470));
    assert_eq!(packet.timestamp_ms, 6714);
    let first = packet.samples[..3].iter().map(|sample| (sample.range_mm, sample.intensity));
    assert_eq!(first.collect::<Vec<_>>(), [(224, 228), (220, 226), (217, 229)]);
    assert_eq!(packet.encode(), EXAMPLE);
    // The first entries of the manual's table, and its last.
    assert_eq!([0, 1, 2, 3, 255].map(|byte| wire::crc(&[byte])), [0x00, 0x4D, 0x9A, 0xD7, 0xA8]);
}

#[test]
fn a_damaged_bit_anywhere_is_refused() {
    for bit in 0..LENGTH * 8 {
        let mut bytes = EXAMPLE;
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(Packet::decode(&bytes), None, "bit {bit}");
    }
}

#[test]
fn sectors_cover_the_circle_clockwise_with_the_instants_of_their_beams() {
    for (model, beams) in [(Model::Ld06, 450), (Model::Ld19, 450), (Model::Stl19p, 500)] {
        let mut bench = bench(model);
        for (n, range) in bench.device.scene().0.iter_mut().enumerate() {
            *range = 1.0 + n as f32 * 0.01;
        }
        bench.run();
        bench.pass(Duration::from_secs(2));
        let revolution = bench.sectors[9].revolution;
        let of = |sector: &&Sector| sector.revolution == revolution;
        let sectors: Vec<&Sector> = bench.sectors.iter().filter(of).collect();
        assert_eq!(sectors.len(), 8, "{model}");
        let count: usize = sectors.iter().map(|sector| sector.ranges_m.len()).sum();
        assert!(count.abs_diff(beams) <= 1, "{model}: {count}");
        for sector in &sectors {
            assert_eq!(sector.status, Status::Ok);
            assert!(sector.angle_step_rad < 0.0, "clockwise");
            for (k, range) in sector.ranges_m.iter().enumerate() {
                let expected = bench.device.scene().range_m(sector.angle_rad(k));
                // A direction of the scene is 0.5°, which is 1 cm; at the front it jumps.
                let jump = sector.angle_rad(k).abs() < TAU / 180.0;
                assert!((range - expected).abs() < 0.0151 || jump, "{range} {expected}");
            }
            let period = sector.beam_time_s * f64::from(model.samples_per_s());
            assert!((period - 1.0).abs() < 0.01, "{period}");
        }
        // A revolution takes 100 ms.
        let next = bench.sectors.iter().filter(|sector| sector.revolution == revolution + 1);
        let starts: Vec<Instant> = next.map(|sector| sector.at).collect();
        assert!(starts[0].since(sectors[0].at).abs_diff(ms(100)) < ms(2), "{starts:?}");
    }
}

#[test]
fn an_absent_device_is_reported_once_and_found_when_it_comes() {
    let mut bench = bench(Model::Ld19);
    bench.device.faults().unpowered = true;
    bench.pass(ms(1000));
    assert_eq!(bench.seen.iter().map(|(_, seen)| seen).collect::<Vec<_>>(), [&Seen::Lost(LostReason::Silent)]);
    bench.pass(Duration::from_secs(60));
    assert_eq!(bench.seen.len(), 1);
    bench.device.faults().unpowered = false;
    bench.pass(ms(2000));
    assert!(matches!(bench.seen.last(), Some((_, Seen::Recovered(_)))), "{:?}", bench.seen);
}

#[test]
fn twenty_faults_are_reported_within_a_second_and_end_within_two() {
    let own: [Cause; 5] = [
        ("motor stands", |faults| faults.motor_stopped = true),
        ("motor slow", |faults| faults.motor_slow = true),
        ("device hangs", |faults| faults.hangs = true),
        ("hangs, and the line is noisy", |faults| (faults.hangs, faults.noise_ppm) = (true, 500_000)),
        ("noise, every other byte", |faults| faults.noise_ppm = 500_000),
    ];
    for model in Model::ALL {
        std::println!("{model}");
        bench(model).suffers_all(&own);
    }
}

#[test]
fn faults_of_a_bit_of_ten_thousand_are_reported_and_one_disturbance_is_not() {
    for model in Model::ALL {
        let mut bench = bench(model);
        bench.shrugs_off(model.name());
        let reports = bench.disturbed(model.name(), 200, |faults| faults.wrong_bits_ppm = 100);
        assert_eq!((reports.within(ms(1000)), reports.ends), (200, 0));
    }
    bench(Model::Ld19).disturbed("ld19, 1 of 10,000 bytes", 50, |faults| faults.noise_ppm = 100);
}

#[test]
fn a_slow_motor_marks_its_sectors() {
    let mut bench = bench(Model::Ld06);
    bench.run();
    bench.device.faults().motor_slow = true;
    bench.pass(ms(500));
    bench.sectors.clear();
    bench.pass(ms(1000));
    assert!(bench.has(&Seen::Fault(Fault::Slow, true)));
    assert!(!bench.sectors.is_empty() && bench.sectors.iter().all(|sector| sector.status != Status::Ok));
}

#[test]
fn covered_optics_measure_nothing_and_are_not_free() {
    for (no_echo, is_free) in [(NoEcho::Unknown, false), (NoEcho::Nothing, true)] {
        let mut bench = Bench::new(lidar(Model::Ld19, no_echo), Device::new(Model::Ld19));
        bench.run();
        bench.device.faults().blocked = true;
        bench.pass(ms(300));
        bench.sectors.clear();
        bench.pass(ms(300));
        let mut ranges = bench.sectors.iter().flat_map(|sector| sector.ranges_m.iter());
        assert!(ranges.all(|range| if is_free { *range == f32::INFINITY } else { range.is_nan() }));
    }
}

#[test]
fn hostile_bytes_in_any_state_do_no_harm() {
    let mut random = Random::new(5);
    let mut bench = bench(Model::Ld06);
    for n in 0..200_000_u32 {
        let mut bytes: Vec<u8> = (0..random.index(6)).map(|_| random.edge_byte()).collect();
        if random.one_in(50) {
            let mut packet = EXAMPLE;
            random.bytes(4).iter().for_each(|byte| packet[2 + random.index(44)] = *byte);
            packet[LENGTH - 1] = wire::crc(&packet[..LENGTH - 1]);
            bytes.extend(packet);
        }
        bench.engine.handle_rx(bench.now, &bytes);
        while let Some(event) = bench.engine.poll_event() {
            assert!(!matches!(event, Event::Identity(_)));
        }
        if n % 16 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.counters().rejected > 0);
    bench.pass(ms(2000));
    assert_eq!(bench.engine.state(), State::Running);
}
