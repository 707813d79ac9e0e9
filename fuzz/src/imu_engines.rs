//! Engines of inertial measurement units and their emulated devices on disturbed lines.

use arbitrary::Arbitrary;
use base::can::Frame;
use base::i2c::{Address, Error};
use base::{Duration, Instant};
use imu::emulated::{Emulated, Faults, Truth};
use imu::{Event, Imu, Model, State, bno055, witmotion, xsens};

#[derive(Arbitrary, Debug)]
enum Step<'a> {
    /// Bytes, a frame or an outcome from nowhere, as they are.
    Receive { number: u16, bytes: &'a [u8] },
    /// The same as a packet or a frame of the protocol that is valid.
    Framed { kind: u8, values: [i16; 4] },
    /// A transfer fails.
    Fails { error: u8 },
    /// Time passes; what is sent arrives.
    Pass { ms: u8 },
    /// Time passes without a call of the engine.
    Hang { ms: u16 },
    Closed,
    Fault { number: u8, on: bool },
}

fn set(faults: &mut Faults, number: u8, on: bool) {
    match number % 24 {
        0 => faults.unpowered = on,
        1 => faults.cut = on,
        2 => faults.noise_ppm = if on { 30_000 } else { 0 },
        3 => faults.frozen = on,
        4 => faults.uncalibrated = on,
        5 => faults.error = on,
        6 => faults.stranger = on,
        7 => faults.acceleration_excess = if on { 30.0 } else { 0.0 },
        8 => faults.wrong_bits_ppm = if on { 3000 } else { 0 },
        9 => faults.lost_per_mille = if on { 30 } else { 0 },
        10 => faults.added_per_mille = if on { 30 } else { 0 },
        11 => faults.stuck_bits = u8::from(on),
        12 => faults.constant = on.then_some(number),
        13 => faults.wrong_baud = on,
        14 => faults.halves = on,
        15 => faults.half_for_ever = on,
        16 => faults.bus = on.then_some(Error::Stuck),
        17 => faults.reset = on,
        18 => faults.remote = on,
        19 => faults.extended = on,
        20 => faults.without_acceleration = on,
        21 => faults.without_rotation = on,
        22 => faults.saturated_acceleration = on,
        _ => faults.saturated_rotation = on,
    }
}

/// What holds of every event.
fn drain(engine: &mut Imu, now: Instant) {
    while let Some(event) = engine.poll_event() {
        let Event::Sample(sample) = event else { continue };
        assert!(sample.at <= now, "measured at {:?}, now {now:?}", sample.at);
        assert!(sample.acceleration_mps2.iter().all(|value| value.abs() < 400.0));
        assert!(sample.rotation_radps.iter().all(|value| value.abs() < 70.0));
        if let Some(orientation) = sample.orientation {
            let length: f64 = orientation.iter().map(|part| part * part).sum();
            assert!((length - 1.0).abs() < 1e-9, "{orientation:?}");
        }
    }
}

fn pass(engine: &mut Imu, device: &mut Emulated, now: &mut Instant, ms: u32) {
    for _ in 0..ms {
        *now += Duration::from_millis(1);
        // What stays the same counts as frozen.
        let ripple = if now.as_nanos() / 1_000_000 % 20 < 10 { 0.0 } else { 0.05 };
        device.set(Truth { acceleration_mps2: [ripple, 0.0, imu::GRAVITY_MPS2], ..Truth::default() });
        device.handle_timeout(*now);
        let mut bytes = [0; 512];
        let count = device.poll_tx(&mut bytes);
        engine.handle_rx(*now, &bytes[..count]);
        while let Some(frame) = device.poll_frame() {
            engine.handle_frame(*now, &frame);
        }
        engine.handle_timeout(*now);
        while let Some(transfer) = engine.poll_transfer() {
            engine.handle_outcome(*now, &device.handle_transfer(*now, &transfer));
            engine.handle_timeout(*now);
        }
        drain(engine, *now);
        assert!(engine.poll_timeout().is_none_or(|due| due > *now), "due after it was served");
    }
}

/// A frame of the device.
fn frame(kind: u8, values: [i16; 4]) -> Frame {
    let mut data = [0; 8];
    data.chunks_exact_mut(2).zip(values).for_each(|(place, value)| place.copy_from_slice(&value.to_be_bytes()));
    let (number, length) = [
        (xsens::id::ERROR, 1),
        (xsens::id::STATUS, 4),
        (xsens::id::QUATERNION, 8),
        (xsens::id::RATE_OF_TURN, 6),
        (xsens::id::ACCELERATION, 6),
        (xsens::id::TEMPERATURE, 2),
    ][usize::from(kind % 6)];
    Frame::standard(number, &data[..length])
}

/// Engines of inertial measurement units with arbitrary bytes, frames and outcomes, valid ones, hangs, closed ports and
/// faults, at any time.
///
/// Samples are bounded, finite and not from the future; an orientation has the length 1. After a call and its draining
/// nothing is due. With a device at power-on the engine runs again.
pub fn imu_engines(data: &[u8]) {
    let Some((kind, steps)) = crate::input::<(u8, Vec<Step<'_>>)>(data) else { return };
    let address = Address::new(bno055::ADDRESS).expect("an address of 7 bits");
    let model = [Model::Bno055 { address }, Model::WitMotion, Model::Xsens][usize::from(kind % 3)];
    let (mut engine, mut device, mut now) = (Imu::new(model), Emulated::new(model), Instant::from_millis(1000));
    for step in &steps[..steps.len().min(60)] {
        match step {
            Step::Receive { number, bytes } => {
                engine.handle_rx(now, bytes);
                engine.handle_frame(now, &Frame::standard(*number, bytes));
                engine.handle_outcome(now, &Ok(bytes.iter().copied().take(36).collect()));
            }
            Step::Framed { kind, values } => {
                engine.handle_rx(now, &witmotion::encode(0x50 + kind % 16, *values));
                engine.handle_frame(now, &frame(*kind, *values));
            }
            Step::Fails { error } => {
                let errors = [Error::NoAddress, Error::NoData { at: *error }, Error::Arbitration, Error::Stuck];
                engine.handle_outcome(now, &Err(errors[usize::from(error % 4)]));
            }
            Step::Pass { ms } => pass(&mut engine, &mut device, &mut now, u32::from(*ms)),
            Step::Hang { ms } => now += Duration::from_millis(u64::from(*ms)),
            Step::Closed => engine.handle_closed(now),
            Step::Fault { number, on } => set(device.faults(), *number, *on),
        }
        drain(&mut engine, now);
    }
    // Whatever came before: with a device at power-on it runs again.
    device = Emulated::new(model);
    engine.handle_closed(now);
    pass(&mut engine, &mut device, &mut now, 3000);
    assert_eq!(engine.state(), State::Running);
}
