//! Engines of lidars and their emulated devices on disturbed lines: what the targets `lidar_*` have in common.
//!
//! Arbitrary bytes, framed ones, hangs, closed connections and faults, at any time. Sectors are at most an eighth,
//! bounded, finite and not from the future. After a call and its draining nothing is due. With a device at power-on the
//! engine runs again. A probe that is fed the same ends, with few requests.

use arbitrary::Arbitrary;
use base::{Duration, Instant};
use lidar::emulated::{Device, Faults};
use lidar::probe::{Kind, LIMIT, Probe};
use lidar::{BEAMS_MAX, EIGHTH_RAD, Event, Lidar, Protocol, State};

/// Time in which an engine and a device talk to each other before the last device is there, at most.
const TALK_MS: u32 = 3000;
/// Time in which neither is called, at most: a device makes up for all of it.
const HANG_MS: u32 = 5000;

#[derive(Arbitrary, Debug)]
pub enum Step<'a> {
    /// Bytes from nowhere, as they are.
    Receive {
        to_device: bool,
        bytes: &'a [u8],
    },
    /// Bytes from nowhere in a frame of the protocol whose checksum is right.
    Framed {
        bytes: &'a [u8],
    },
    /// Time passes; what is sent arrives.
    Pass {
        ms: u8,
    },
    /// Time passes without a call of the engine.
    Hang {
        ms: u16,
    },
    Closed,
    Fault {
        number: u8,
        on: bool,
    },
}

fn set(faults: &mut Faults, number: u8, on: bool) {
    let per_mille = if on { 30 } else { 0 };
    match number % 24 {
        0 => faults.unpowered = on,
        1 => faults.cut = on,
        2 => faults.mute = on,
        3 => faults.deaf = on,
        4 => faults.noise_ppm = 1000 * u32::from(per_mille),
        5 => faults.lost_per_mille = per_mille,
        6 => faults.added_per_mille = per_mille,
        7 => faults.stuck_bits = u8::from(on),
        8 => faults.constant = on.then_some(number),
        9 => faults.wrong_baud = on,
        10 => faults.held_back = on,
        11 => faults.half_for_ever = on,
        12 => faults.repeats = on,
        13 => faults.slow_line = on,
        14 => faults.hangs = on,
        15 => faults.motor_stopped = on,
        16 => faults.motor_slow = on,
        17 => faults.error = on,
        18 => faults.refuses = on,
        19 => faults.stranger = on,
        20 => faults.wrong_bits_ppm = 100 * u32::from(per_mille),
        21 => faults.halves = on,
        22 => faults.dirty = on,
        _ => faults.blocked = on,
    }
}

/// What holds of every event.
fn drain<P: Protocol>(engine: &mut Lidar<P>, now: Instant) {
    while let Some(event) = engine.poll_event() {
        let Event::Sector(sector) = event else { continue };
        let beams = sector.ranges_m.len();
        assert!(beams > 0 && beams <= BEAMS_MAX);
        assert!(sector.intensities.is_empty() || sector.intensities.len() == beams);
        assert!(sector.span_rad() <= EIGHTH_RAD + 1e-9, "{} rad", sector.span_rad());
        assert!(sector.angle_min_rad.is_finite() && sector.angle_step_rad.is_finite() && sector.angle_step_rad != 0.0);
        assert!(sector.beam_time_s >= 0.0 && sector.beam_time_s.is_finite());
        assert!(sector.at <= now, "measured at {:?}, now {now:?}", sector.at);
        assert!(sector.ranges_m.iter().all(|range| range.is_nan() || *range >= 0.0 || range.is_infinite()));
    }
}

fn pass<P: Protocol>(engine: &mut Lidar<P>, device: &mut impl Device, now: &mut Instant, ms: u32) {
    let mut bytes = [0; 4096];
    for _ in 0..ms {
        *now += Duration::from_millis(1);
        device.handle_timeout(*now);
        loop {
            let count = device.poll_tx(*now, &mut bytes);
            engine.handle_rx(*now, &bytes[..count]);
            drain(engine, *now);
            if count < bytes.len() {
                break;
            }
        }
        engine.handle_timeout(*now);
        while let Some(request) = engine.poll_tx() {
            device.handle_rx(*now, &request);
        }
        drain(engine, *now);
        assert!(engine.poll_timeout().is_none_or(|due| due > *now), "due after it was served");
    }
}

/// A probe that is fed whatever arrives: its requests and its time are bounded.
pub fn probe(steps: &[Step<'_>], kind: Kind, frame: impl Fn(&[u8]) -> Vec<u8>) {
    let mut probe = Probe::new(kind);
    let begin = Instant::from_millis(1000);
    let (mut now, mut requests) = (begin, 0);
    probe.handle_timeout(now);
    for step in steps {
        match step {
            Step::Receive { to_device: false, bytes } => probe.handle_rx(now, bytes),
            Step::Framed { bytes } => probe.handle_rx(now, &frame(bytes)),
            Step::Pass { ms } => now += Duration::from_millis(u64::from(*ms)),
            Step::Hang { ms } => now += Duration::from_millis(u64::from(*ms)),
            Step::Receive { .. } | Step::Closed | Step::Fault { .. } => {}
        }
        probe.handle_timeout(now);
        while probe.poll_tx().is_some() {
            requests += 1;
        }
        assert!(probe.poll_timeout().is_none_or(|due| due > now), "due after it was served");
    }
    probe.handle_timeout(begin.max(now) + LIMIT);
    assert!(requests <= 20 && probe.poll_timeout().is_none(), "it ends");
}

/// An engine and its device, disturbed by the steps.
pub fn run<P: Protocol, D: Device>(
    steps: &[Step<'_>],
    mut engine: Lidar<P>,
    new: impl Fn() -> D,
    frame: impl Fn(&[u8]) -> Vec<u8>,
) {
    let mut device = new();
    let (mut now, mut talk_ms, mut hang_ms) = (Instant::from_millis(1000), TALK_MS, HANG_MS);
    for step in steps {
        match step {
            Step::Receive { to_device: true, bytes } => device.handle_rx(now, bytes),
            Step::Receive { bytes, .. } => engine.handle_rx(now, bytes),
            Step::Framed { bytes } => engine.handle_rx(now, &frame(bytes)),
            Step::Pass { ms } => {
                let ms = u32::from(*ms).min(talk_ms);
                pass(&mut engine, &mut device, &mut now, ms);
                talk_ms -= ms;
            }
            Step::Hang { ms } => {
                let ms = u32::from(*ms).min(hang_ms);
                now += Duration::from_millis(u64::from(ms));
                hang_ms -= ms;
            }
            Step::Closed => engine.handle_closed(now),
            Step::Fault { number, on } => set(device.faults(), *number, *on),
        }
        drain(&mut engine, now);
    }
    // Whatever came before: with a device at power-on it runs again. What ran before is silent for longer than allowed.
    device = new();
    pass(&mut engine, &mut device, &mut now, 1000);
    for _ in 0..500 {
        if engine.state() == State::Running {
            return;
        }
        pass(&mut engine, &mut device, &mut now, 10);
    }
    panic!("{:?} after 6 s with a device at power-on", engine.state());
}

/// The model, or the mode, and at most 60 steps.
pub fn input(data: &[u8]) -> Option<(usize, Vec<Step<'_>>)> {
    let (kind, mut steps) = crate::input::<(u8, Vec<Step<'_>>)>(data)?;
    steps.truncate(60);
    Some((usize::from(kind), steps))
}
