use super::*;
use crate::bench::{Bench, Cause, ms};
use crate::event::{Event, Fault, LostReason, State, Status};
use crate::{Imu, Model};
use base::Instant;
use core::f64::consts::FRAC_1_SQRT_2;
use std::vec::Vec;
use testing::Random;

/// 1 g up, 25.6 °C, by the formulas of the protocol: 2048 of 32768 are 1 g of 16.
const LEVEL: [u8; LENGTH] = [0x55, 0x51, 0x00, 0x00, 0x00, 0x00, 0x00, 0x08, 0x00, 0x0A, 0xB8];
/// 0, 0 and 90 °/s: 1475 of 32768 are 90.03 of 2000.
const TURNS: [u8; LENGTH] = [0x55, 0x52, 0x00, 0x00, 0x00, 0x00, 0xC3, 0x05, 0x00, 0x00, 0x6F];
/// Yaw of 90°: 16384 of 32768 are 90 of 180.
const TO_THE_LEFT: [u8; LENGTH] = [0x55, 0x53, 0x00, 0x00, 0x00, 0x00, 0x00, 0x40, 0x00, 0x00, 0xE8];
/// The same as a quaternion: 23170 of 32768 are √½.
const QUARTER: [u8; LENGTH] = [0x55, 0x59, 0x82, 0x5A, 0x00, 0x00, 0x00, 0x00, 0x82, 0x5A, 0x66];

fn engine() -> Imu {
    let mut engine = Imu::new(Model::WitMotion);
    engine.handle_timeout(Instant::ZERO);
    engine
}

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

fn events(engine: &mut Imu) -> Vec<Event> {
    core::iter::from_fn(|| engine.poll_event()).collect()
}

#[test]
fn packets_typed_from_the_protocol_are_read_and_written() {
    assert_eq!(decode(&LEVEL), Some((ACCELERATION, [0, 0, 2048, 2560])));
    assert_eq!(encode(ACCELERATION, [0, 0, 2048, 2560]), LEVEL);
    assert_eq!(decode(&TURNS), Some((ROTATION, [0, 0, 1475, 0])));
    assert_eq!(decode(&TO_THE_LEFT), Some((ANGLE, [0, 0, 16384, 0])));
    assert_eq!(decode(&QUARTER), Some((QUATERNION, [23170, 0, 0, 23170])));
}

#[test]
fn a_damaged_bit_anywhere_is_refused() {
    for bit in 0..LENGTH * 8 {
        let mut bytes = TURNS;
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(decode(&bytes), None, "bit {bit}");
    }
}

#[test]
fn a_round_is_a_sample_with_the_instant_of_its_first_byte() {
    for (last, kinds) in [(TURNS, 2), (TO_THE_LEFT, 3), (QUARTER, 3)] {
        let mut engine = engine();
        let mut samples = Vec::new();
        for round in 0..4 {
            let round: u64 = 100 * round;
            engine.handle_rx(at(round + 1), &LEVEL[..4]);
            engine.handle_rx(at(round + 2), &LEVEL[4..]);
            engine.handle_rx(at(round + 3), &TURNS);
            if kinds == 3 {
                engine.handle_rx(at(round + 4), &last);
            }
            samples.extend(events(&mut engine).into_iter().filter_map(|event| match event {
                Event::Sample(sample) => Some(sample),
                _ => None,
            }));
        }
        // The first round shows what a round is.
        assert_eq!(samples.iter().map(|sample| sample.at).collect::<Vec<_>>(), [at(101), at(201), at(301)]);
        let sample = samples[0];
        assert!((sample.acceleration_mps2[2] - 9.80665).abs() < 1e-9 && sample.temperature_c == 25.6, "{sample:?}");
        assert!((sample.rotation_radps[2] - 90.0f64.to_radians()).abs() < 0.001, "{sample:?}");
        let near = |q: [f64; 4]| (q[2] - FRAC_1_SQRT_2).abs() < 1e-4 && (q[3] - FRAC_1_SQRT_2).abs() < 1e-4;
        assert_eq!(sample.orientation.map(near), (kinds == 3).then_some(true), "{sample:?}");
    }
}

#[test]
fn a_lost_packet_costs_its_sample_and_no_other() {
    let mut engine = engine();
    let mut counts = Vec::new();
    for round in 0..8 {
        for (n, packet) in [LEVEL, TURNS, QUARTER].iter().enumerate() {
            if (round, n) != (4, 0) {
                engine.handle_rx(at(10 * round), packet);
            }
        }
        let is_sample = |event: &Event| matches!(event, Event::Sample(sample) if sample.orientation.is_some());
        counts.push(events(&mut engine).iter().filter(|event| is_sample(event)).count());
    }
    assert_eq!(counts, [0, 1, 1, 1, 0, 1, 1, 1]);
}

#[test]
fn one_that_does_not_send_its_rotation_is_incomplete() {
    let mut engine = engine();
    for ms in 0..1010 {
        if ms % 10 == 0 {
            engine.handle_rx(at(ms), &LEVEL);
            engine.handle_rx(at(ms), &QUARTER);
        }
        engine.handle_timeout(at(ms));
    }
    assert_eq!(events(&mut engine), [Event::Lost { reason: LostReason::Incomplete }]);
}

#[test]
fn faults_are_reported_within_a_second_and_end_within_two() {
    let own: [Cause; 8] = [
        ("another device", |faults| faults.stranger = true),
        ("wrong bit rate", |faults| faults.wrong_baud = true),
        ("half a packet for ever", |faults| faults.half_for_ever = true),
        ("noise, 3 of 100 bytes", |faults| faults.noise_ppm = 30_000),
        ("bytes lost, 3 of 100", |faults| faults.lost_per_mille = 30),
        ("bytes added, 3 of 100", |faults| faults.added_per_mille = 30),
        ("all bytes are headers", |faults| faults.constant = Some(HEADER)),
        ("no rotation", |faults| faults.without_rotation = true),
    ];
    Bench::new(Model::WitMotion).suffers_all(&own);
}

#[test]
fn faults_of_a_bit_of_ten_thousand_are_reported_and_one_disturbance_is_not() {
    let mut bench = Bench::new(Model::WitMotion);
    bench.shrugs_off("witmotion");
    // Three damaged packets a second: of 200 trials 146 or so take less than 1 s.
    let after = bench.disturbed("witmotion", 200, |faults| faults.wrong_bits_ppm = 100);
    assert!(after[120] <= ms(1000) && after[199] <= ms(8000), "{after:?}");
}

#[test]
fn a_value_at_the_end_of_the_range_marks_its_sample_at_once() {
    let mut bench = Bench::new(Model::WitMotion);
    bench.run();
    bench.truth.rotation_radps[2] = 40.0;
    bench.pass(ms(12));
    assert_eq!(bench.samples.last().unwrap().status, Status::Implausible);
    assert!(bench.has(Event::Fault { fault: Fault::Implausible, active: true }));
}

#[test]
fn hostile_bytes_do_no_harm() {
    let mut random = Random::new(5);
    let mut bench = Bench::new(Model::WitMotion);
    for n in 0..200_000_u32 {
        let mut bytes: Vec<u8> = (0..random.index(6)).map(|_| random.edge_byte()).collect();
        if random.one_in(50) {
            let mut packet = LEVEL;
            packet[1] = 0x50 + random.index(12) as u8;
            random.bytes(4).iter().for_each(|byte| packet[2 + random.index(8)] = *byte);
            packet[LENGTH - 1] = checksum(&packet[..LENGTH - 1]);
            bytes.extend(packet);
        }
        bench.engine.handle_rx(bench.now, &bytes);
        if n % 16 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.counters().rejected > 0);
    bench.pass(ms(2000));
    assert_eq!(bench.engine.state(), State::Running);
}
