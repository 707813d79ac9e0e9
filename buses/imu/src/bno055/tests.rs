use super::register::*;
use super::*;
use crate::Model;
use crate::bench::{Bench, Cause, bno055, ms};
use crate::emulated::Faults;
use crate::event::{Event, Fault, Identity, LostReason, State, Status};
use crate::{Imu, REST};
use base::Instant;
use base::i2c::{Address, Bytes, Error, Outcome, Read, Transfer};
use std::vec::Vec;

/// The registers from 0x08 to 0x27, typed by the register map: 0.5, -0.25 and 9.81 m/s², no magnetic field,
/// 0.1, -0.2 and 1 rad/s, Euler angles that are not used, a quarter of a turn to the left.
const MOTION: [u8; 32] = [
    0x32, 0x00, 0xE7, 0xFF, 0xD5, 0x03, // 50, -25, 981
    0, 0, 0, 0, 0, 0, //
    0x5A, 0x00, 0x4C, 0xFF, 0x84, 0x03, // 90, -180, 900
    0, 0, 0, 0, 0, 0, //
    0x41, 0x2D, 0, 0, 0, 0, 0x41, 0x2D, // 11585 of 16384 are √½
];
/// From 0x34 to 0x3D: 27 °C, calibrated but the magnetometer, self-test passed, fusion runs, units, mode IMU.
const STATES: [u8; 10] = [0x1B, 0x3C, 0x0F, 0x00, 0x00, 0x05, 0x00, 0x06, 0x02, 0x08];
/// Firmware 3.17, boot loader 0x15.
const IDENTITY: [u8; 7] = [0xA0, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15];

fn at(ms: u64) -> Instant {
    Instant::from_millis(1000 + ms)
}

fn engine() -> Imu {
    let mut engine = Imu::new(bno055());
    engine.handle_timeout(at(0));
    engine
}

/// What is written in the next transfer, and how much is read.
fn asked(engine: &mut Imu) -> Option<(Vec<u8>, u8)> {
    let Transfer { address, write, read } = engine.poll_transfer()?;
    assert_eq!(address.get(), 0x28);
    Some((write.to_vec(), if let Read::Exactly(count) = read { count } else { 0 }))
}

fn answers(engine: &mut Imu, ms: u64, bytes: &[u8]) {
    engine.handle_outcome(at(ms), &Ok(Bytes::from_slice(bytes).unwrap()));
    engine.handle_timeout(at(ms));
}

fn events(engine: &mut Imu) -> Vec<Event> {
    core::iter::from_fn(|| engine.poll_event()).collect()
}

/// From the start to the first request for a measurement, at 40 ms.
fn started() -> Imu {
    let mut engine = engine();
    let rows: [(&[u8], u8, &[u8], u64); 7] = [
        (&[0x07, 0x00], 0, &[], 0),
        (&[0x00], 7, &IDENTITY, 0),
        (&[0x3D, 0x00], 0, &[], 0),
        (&[0x3B, 0x06], 0, &[], 20),
        (&[0x3E, 0x00], 0, &[], 20),
        (&[0x3D, 0x08], 0, &[], 20),
        (&[0x34], 10, &STATES, 40),
    ];
    for (write, read, answer, ms) in rows {
        engine.handle_timeout(at(ms));
        assert_eq!(asked(&mut engine), Some((write.to_vec(), read)), "at {ms} ms");
        answers(&mut engine, ms, answer);
    }
    engine
}

#[test]
fn it_is_identified_and_configured_with_pauses_for_its_mode() {
    let mut engine = started();
    let identity = Identity { firmware: [3, 0x11], bootloader: 0x15 };
    assert_eq!(events(&mut engine), [Event::Identity(identity)]);
    assert_eq!(asked(&mut engine), Some((std::vec![0x08], 32)));
}

#[test]
fn the_registers_of_the_data_sheet_are_read() {
    let mut engine = started();
    events(&mut engine);
    asked(&mut engine);
    answers(&mut engine, 43, &MOTION);
    let events = events(&mut engine);
    let [Event::Sample(sample), Event::Recovered { after: Duration::ZERO }] = events[..] else { panic!("{events:?}") };
    assert_eq!((sample.at, sample.status, sample.temperature_c), (at(40), Status::Ok, 27.0));
    let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(near(&sample.acceleration_mps2, &[0.5, -0.25, 9.81]), "{sample:?}");
    assert!(near(&sample.rotation_radps, &[0.1, -0.2, 1.0]), "{sample:?}");
    let root = core::f64::consts::FRAC_1_SQRT_2;
    assert!(near(&sample.orientation.unwrap(), &[0.0, 0.0, root, root]), "{sample:?}");
    // The next one is due 10 ms after this one was requested.
    assert_eq!(asked(&mut engine), None);
    assert_eq!(engine.poll_timeout(), Some(at(50)));
}

#[test]
fn what_a_chip_says_of_itself_is_reported() {
    let mut engine = started();
    let states = |calibration, status, error| {
        let mut states = STATES;
        (states[1], states[5], states[6]) = (calibration, status, error);
        states
    };
    let mut due = 40;
    let mut after_ten = |engine: &mut Imu, states: &[u8]| {
        for n in 0..10 {
            engine.handle_timeout(at(due));
            assert_eq!(asked(engine).map(|(write, _)| write), Some(std::vec![0x08]), "{n}");
            let mut motion = MOTION;
            motion[0] = n;
            answers(engine, due, &motion);
            due += 10;
        }
        assert_eq!(asked(engine).map(|(write, _)| write), Some(std::vec![0x34]));
        answers(engine, due - 10, states);
        events(engine)
    };
    let told = after_ten(&mut engine, &states(0x0C, 5, 0));
    assert!(told.contains(&Event::Fault { fault: Fault::Uncalibrated, active: true }), "{told:?}");
    let told = after_ten(&mut engine, &states(0x1C, 5, 0));
    assert!(told.contains(&Event::Fault { fault: Fault::Uncalibrated, active: false }), "{told:?}");
    let told = after_ten(&mut engine, &states(0x3C, 1, 6));
    assert!(told.contains(&Event::Lost { reason: LostReason::Device { code: 6 } }), "{told:?}");
    assert_eq!(engine.state(), State::Resting);
}

#[test]
fn another_chip_is_refused_and_asked_again() {
    let mut engine = engine();
    asked(&mut engine);
    answers(&mut engine, 0, &[]);
    asked(&mut engine);
    answers(&mut engine, 0, &[0xEA, 0, 0, 0, 0, 0, 0]);
    assert_eq!(events(&mut engine), [Event::Lost { reason: LostReason::Identity { chip: 0xEA } }]);
    assert_eq!(asked(&mut engine), None);
    engine.handle_timeout(at(0) + REST);
    assert_eq!(asked(&mut engine), Some((std::vec![0x07, 0x00], 0)));
}

#[test]
fn a_transfer_that_never_ends_is_a_loss_and_its_late_outcome_belongs_to_no_request() {
    let mut engine = started();
    asked(&mut engine);
    answers(&mut engine, 40, &MOTION);
    engine.handle_timeout(at(50));
    assert!(asked(&mut engine).is_some());
    events(&mut engine);
    engine.handle_timeout(at(440));
    assert_eq!(events(&mut engine), [Event::Lost { reason: LostReason::Silent }]);
    engine.handle_timeout(at(700));
    assert_eq!((engine.state(), asked(&mut engine)), (State::Starting, None), "the bus is not free");
    // This could be taken for an identity.
    answers(&mut engine, 710, &IDENTITY);
    assert_eq!(asked(&mut engine), Some((std::vec![0x07, 0x00], 0)));
    assert_eq!(events(&mut engine), []);
}

#[test]
fn faults_are_reported_within_a_second_and_end_within_two() {
    let mut bench = Bench::new(bno055());
    let own: [Cause; 9] = [
        ("not calibrated", |faults| faults.uncalibrated = true),
        ("error", |faults| faults.error = true),
        ("another chip", |faults| faults.stranger = true),
        ("3 of 100 bytes are refused", |faults| faults.noise_ppm = 30_000),
        ("a line of the bus is stuck", |faults| faults.bus = Some(Error::Stuck)),
        ("the clock is held", |faults| faults.bus = Some(Error::Stretched)),
        ("another master has the bus", |faults| faults.bus = Some(Error::Arbitration)),
        ("the adapter fails", |faults| faults.bus = Some(Error::Other)),
        ("it stays reset", |faults| faults.reset = true),
    ];
    bench.suffers_all(&own);
    // A chip is identified at each start-up.
    bench.run();
    bench.device.faults().unpowered = true;
    bench.pass(ms(500));
    *bench.device.faults() = Faults { stranger: true, ..Faults::default() };
    bench.pass(ms(1500));
    assert!(bench.has(Event::Lost { reason: LostReason::Identity { chip: 0x55 } }), "{:?}", bench.seen);
}

#[test]
fn a_chip_that_lost_its_supply_for_a_moment_is_configured_again() {
    let mut bench = Bench::new(bno055());
    bench.run();
    bench.device.faults().unpowered = true;
    bench.pass(ms(20));
    bench.device.faults().unpowered = false;
    bench.pass(ms(1900));
    assert!(matches!(bench.seen[0].1, Event::Lost { .. }), "{:?}", bench.seen);
    assert!(matches!(bench.seen.last().unwrap().1, Event::Recovered { .. }), "{:?}", bench.seen);
    // In between nothing that a chip in the mode CONFIG has in its registers was taken for a measurement.
    assert!(bench.samples.iter().all(|sample| (sample.acceleration_mps2[2] - 9.8).abs() < 0.1));
}

#[test]
fn outcomes_of_any_length_and_kind_do_no_harm() {
    let mut random = testing::Random::new(9);
    let mut engine = engine();
    let mut now = at(0);
    for _ in 0..100_000 {
        now += ms(random.below(12));
        engine.handle_timeout(now);
        let _ = engine.poll_transfer();
        let outcome: Outcome = match random.below(4) {
            0 => Err([Error::NoAddress, Error::Stuck, Error::NoData { at: 255 }][random.index(3)]),
            _ => {
                let length = [0, 7, 10, 32, 36][random.index(5)];
                Ok((0..length).map(|_| random.edge_byte()).collect())
            }
        };
        engine.handle_outcome(now, &outcome);
        while let Some(event) = engine.poll_event() {
            let Event::Sample(sample) = event else { continue };
            assert!(sample.acceleration_mps2.iter().chain(&sample.rotation_radps).all(|value| value.is_finite()));
        }
    }
    assert!(engine.counters().rejected > 1000 && engine.counters().messages > 1000);
}

#[test]
fn two_chips_share_a_bus_by_their_addresses() {
    let other = Model::Bno055 { address: Address::new(0x29).unwrap() };
    let mut bench = Bench::new(other);
    bench.run();
    bench.device = crate::emulated::Emulated::new(bno055());
    bench.pass(ms(1000));
    assert!(bench.has(Event::Lost { reason: LostReason::Silent }), "{:?}", bench.seen);
}

#[test]
fn the_register_map_is_that_of_the_data_sheet() {
    let map = [CHIP_ID, PAGE_ID, ACC_DATA, GYR_DATA, QUA_DATA, TEMP, CALIB_STAT, SYS_STATUS, SYS_ERR, UNIT_SEL];
    assert_eq!(map, [0x00, 0x07, 0x08, 0x14, 0x20, 0x34, 0x35, 0x39, 0x3A, 0x3B]);
    assert_eq!([OPR_MODE, PWR_MODE], [0x3D, 0x3E]);
}
