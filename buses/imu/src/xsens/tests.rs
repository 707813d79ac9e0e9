use super::*;
use crate::bench::{Bench, Cause, ms};
use crate::event::{Event, Fault, LostReason, Sample, State};
use crate::{Imu, Model};
use base::Instant;
use base::can::{Frame, Id};
use core::f64::consts::FRAC_1_SQRT_2;
use std::vec::Vec;
use testing::Random;

/// 0, 0 and 1 rad/s: 512 digits (MT1604P, 6.4.2).
const TURNS: [u8; 6] = [0, 0, 0, 0, 0x02, 0x00];
/// 0, -0.5 and 9.80859375 m/s²: -128 and 2511 digits (6.4.4).
const LEVEL: [u8; 6] = [0, 0, 0xFF, 0x80, 0x09, 0xCF];
/// A quarter of a turn to the left: 23170 of 32767 are √½ (6.3.1).
const QUARTER: [u8; 8] = [0x5A, 0x82, 0, 0, 0, 0, 0x5A, 0x82];

fn engine() -> Imu {
    let mut engine = Imu::new(Model::Xsens);
    engine.handle_timeout(Instant::ZERO);
    engine
}

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

fn samples(engine: &mut Imu) -> Vec<Sample> {
    let sample = |event| if let Event::Sample(sample) = event { Some(sample) } else { None };
    core::iter::from_fn(|| engine.poll_event()).filter_map(sample).collect()
}

#[test]
fn frames_typed_from_the_protocol_make_a_sample() {
    let mut engine = engine();
    let frames: [(u16, &[u8]); 4] = [(0x021, &QUARTER), (0x051, &[0x19, 0x80]), (0x032, &TURNS), (0x034, &LEVEL)];
    for (n, (number, data)) in (1..).zip(frames) {
        engine.handle_frame(at(n), &Frame::standard(number, data));
    }
    let samples = samples(&mut engine);
    let [sample] = samples[..] else { panic!("{samples:?}") };
    assert_eq!((sample.at, sample.temperature_c), (at(3), 25.5));
    assert_eq!((sample.rotation_radps, sample.acceleration_mps2), ([0.0, 0.0, 1.0], [0.0, -0.5, 9.80859375]));
    let [x, y, z, w] = sample.orientation.unwrap();
    assert!(x == 0.0 && y == 0.0 && (z - FRAC_1_SQRT_2).abs() < 1e-4 && (w - FRAC_1_SQRT_2).abs() < 1e-4);
}

#[test]
fn an_orientation_that_is_not_valid_or_old_is_not_used() {
    let mut engine = engine();
    let mut take = |ms: u64, number: u16, data: &[u8]| {
        engine.handle_frame(at(ms), &Frame::standard(number, data));
        engine.handle_frame(at(ms), &Frame::standard(0x032, &TURNS));
        engine.handle_frame(at(ms), &Frame::standard(0x034, &LEVEL));
        samples(&mut engine).last().unwrap().orientation.is_some()
    };
    assert!(take(1, 0x021, &QUARTER));
    assert!(!take(2, 0x011, &[0, 0, 0, 1]), "the filter is not valid");
    assert!(take(3, 0x011, &[0, 0, 0, 3]));
    assert!(!take(150, 0x005, &[0; 4]), "old");
}

#[test]
fn frames_of_others_are_left_alone_and_wrong_lengths_are_counted() {
    let mut engine = engine();
    for number in [0x000, 0x080, 0x181, 0x581, 0x701] {
        engine.handle_frame(at(1), &Frame::standard(number, &[0; 8]));
    }
    engine.handle_frame(at(1), &Frame::new(Id::Extended(0x032), &TURNS).unwrap());
    assert_eq!((engine.counters().messages, engine.counters().rejected), (0, 0));
    engine.handle_frame(at(1), &Frame::standard(0x032, &TURNS[..5]));
    engine.handle_frame(at(1), &Frame::standard_remote(0x032, 6));
    assert_eq!((engine.counters().messages, engine.counters().rejected), (0, 2));
}

#[test]
fn faults_are_reported_within_a_second_and_end_within_two() {
    let mut bench = Bench::new(Model::Xsens);
    let own: [Cause; 8] = [
        ("another device", |faults| faults.stranger = true),
        ("error", |faults| faults.error = true),
        ("wrong bit rate", |faults| faults.wrong_baud = true),
        ("half a frame for ever", |faults| faults.half_for_ever = true),
        ("3 of 100 frames lack a byte", |faults| faults.noise_ppm = 30_000),
        ("remote frames", |faults| faults.remote = true),
        ("extended identifiers", |faults| faults.extended = true),
        ("no rotation", |faults| faults.without_rotation = true),
    ];
    bench.suffers_all(&own);
    bench.run();
    bench.device.faults().error = true;
    bench.pass(ms(100));
    assert!(bench.has(Event::Fault { fault: Fault::Device, active: true }));
}

#[test]
fn faults_of_a_bit_of_ten_thousand_are_reported_and_one_disturbance_is_not() {
    let mut bench = Bench::new(Model::Xsens);
    bench.shrugs_off("xsens");
    // Four damaged frames a second, if they are passed on.
    let after = bench.disturbed("xsens", 200, |faults| faults.wrong_bits_ppm = 100);
    assert!(after[150] <= ms(1000) && after[199] <= ms(8000), "{after:?}");
}

#[test]
fn one_without_acceleration_is_incomplete() {
    let mut engine = engine();
    for ms in 0..1010 {
        engine.handle_frame(at(ms), &Frame::standard(0x032, &TURNS));
        engine.handle_timeout(at(ms));
    }
    assert_eq!(engine.poll_event(), Some(Event::Lost { reason: LostReason::Incomplete }));
}

#[test]
fn hostile_frames_do_no_harm() {
    let mut random = Random::new(5);
    let mut bench = Bench::new(Model::Xsens);
    for n in 0..200_000_u32 {
        let number = [id::ERROR, id::STATUS, id::QUATERNION, id::RATE_OF_TURN, id::ACCELERATION][random.index(5)];
        let length = random.index(9);
        let data = random.bytes(length);
        bench.engine.handle_frame(bench.now, &Frame::standard(number, &data));
        if n % 16 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.counters().rejected > 0);
    bench.pass(ms(2000));
    assert_eq!(bench.engine.state(), State::Running);
}
