//! Engines of lidars and their emulated devices on disturbed lines.

use arbitrary::Arbitrary;
use base::{Duration, Instant};
use lidar::emulated::{Device, Faults};
use lidar::probe::{Kind, LIMIT, Probe};
use lidar::{BEAMS_MAX, EIGHTH_RAD, Event, Lidar, Protocol, State};
use lidar::{hokuyo, ld, rplidar, sick};

#[derive(Arbitrary, Debug)]
enum Step<'a> {
    /// Bytes from nowhere, as they are.
    Receive { to_device: bool, bytes: &'a [u8] },
    /// Bytes from nowhere in a frame of the protocol whose checksum is right.
    Framed { bytes: &'a [u8] },
    /// Time passes; what is sent arrives.
    Pass { ms: u8 },
    /// Time passes without a call of the engine.
    Hang { ms: u16 },
    Closed,
    Fault { number: u8, on: bool },
}

fn set(faults: &mut Faults, number: u8, on: bool) {
    let per_mille = if on { 30 } else { 0 };
    match number % 20 {
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
        _ => faults.stranger = on,
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
fn probe(steps: &[Step<'_>], kind: Kind, frame: impl Fn(&[u8]) -> Vec<u8>) {
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

fn run<P: Protocol, D: Device>(
    steps: &[Step<'_>],
    mut engine: Lidar<P>,
    new: impl Fn() -> D,
    frame: impl Fn(&[u8]) -> Vec<u8>,
) {
    let mut device = new();
    let mut now = Instant::from_millis(1000);
    for step in steps {
        match step {
            Step::Receive { to_device: true, bytes } => device.handle_rx(now, bytes),
            Step::Receive { bytes, .. } => engine.handle_rx(now, bytes),
            Step::Framed { bytes } => engine.handle_rx(now, &frame(bytes)),
            Step::Pass { ms } => pass(&mut engine, &mut device, &mut now, u32::from(*ms)),
            Step::Hang { ms } => now += Duration::from_millis(u64::from(*ms)),
            Step::Closed => engine.handle_closed(now),
            Step::Fault { number, on } => set(device.faults(), *number, *on),
        }
        drain(&mut engine, now);
    }
    // Whatever came before: with a device at power-on it runs again.
    device = new();
    pass(&mut engine, &mut device, &mut now, 6000);
    assert_eq!(engine.state(), State::Running);
}

/// A packet of LDROBOT with these bytes.
fn packet(bytes: &[u8]) -> Vec<u8> {
    let mut packet = vec![ld::wire::HEADER, ld::wire::TYPE_AND_COUNT];
    packet.extend(bytes.iter().copied().chain(std::iter::repeat(0)).take(ld::wire::LENGTH - 3));
    packet.push(ld::wire::crc(&packet));
    packet
}

/// A capsule of 84 bytes, or a descriptor and an answer.
fn capsule(bytes: &[u8]) -> Vec<u8> {
    if let [0xA5, rest @ ..] = bytes {
        return [&[0xA5, 0x5A], rest].concat();
    }
    let mut capsule: Vec<u8> = bytes.iter().copied().chain(std::iter::repeat(0)).take(84).collect();
    let sum = capsule[2..].iter().fold(0, |sum, byte| sum ^ byte);
    (capsule[0], capsule[1]) = (0xA0 | sum & 0xF, 0x50 | sum >> 4);
    capsule
}

/// A telegram of CoLa B.
fn telegram(bytes: &[u8]) -> Vec<u8> {
    let mut frame = vec![sick::wire::STX; 4];
    frame.extend((bytes.len() as u32).to_be_bytes());
    frame.extend(bytes);
    frame.push(sick::wire::checksum(bytes));
    frame
}

/// Lines with their checksums.
fn lines(bytes: &[u8]) -> Vec<u8> {
    let line = |line: &[u8]| match line {
        [] => vec![b'\n'],
        _ => [line, &[hokuyo::wire::checksum(line), b'\n']].concat(),
    };
    bytes.split(|byte| *byte == b'\n').flat_map(line).collect()
}

/// Engines of lidars with arbitrary bytes, framed ones, hangs, closed connections and faults, at any time.
///
/// Sectors are at most an eighth, bounded, finite and not from the future. After a call and its draining nothing is
/// due. With a device at power-on the engine runs again. A probe that is fed the same ends, with few requests.
pub fn lidar_engines(data: &[u8]) {
    let Some((kind, steps)) = crate::input::<(u8, Vec<Step<'_>>)>(data) else { return };
    let steps = &steps[..steps.len().min(60)];
    match kind % 6 {
        0 => probe(steps, Kind::Ld, packet),
        1 | 2 => probe(steps, Kind::Rplidar, capsule),
        3 => probe(steps, Kind::Cola(sick::Dialect::Binary), telegram),
        4 => probe(steps, Kind::Cola(sick::Dialect::Text), telegram),
        _ => probe(steps, Kind::Scip, lines),
    }
    // Model and mode.
    let other = usize::from(kind / 6);
    match kind % 6 {
        0 => {
            let model = [ld::Model::Ld19, ld::Model::Ld06, ld::Model::Stl19p][other % 3];
            let no_echo = [ld::NoEcho::Unknown, ld::NoEcho::Nothing][other % 2];
            let config = ld::Config { model, no_echo };
            run(steps, ld::LdLidar::new(config), || ld::emulated::Device::new(model), packet);
        }
        1 | 2 => {
            use rplidar::{Mode, Model};
            let (model, mode) = match kind % 6 {
                1 => [(Model::A2, Mode::Express), (Model::A3, Mode::Ultra), (Model::C1, Mode::Dense)][other % 3],
                _ => [(Model::A1, Mode::Standard), (Model::A1, Mode::Ultra), (Model::S2, Mode::Dense)][other % 3],
            };
            let config = rplidar::Config { mode, ..rplidar::Config::new(model) };
            run(steps, rplidar::Rplidar::new(config), || rplidar::emulated::Device::new(model), capsule);
        }
        3 | 4 => {
            let dialect = if kind % 6 == 3 { sick::Dialect::Binary } else { sick::Dialect::Text };
            let family = [sick::Family::Tim5xx, sick::Family::Lms1xx, sick::Family::Tim7xx][other % 3];
            let usual = sick::Config::new(family, dialect);
            let config = sick::Config { fields: true, outputs: true, ..usual };
            run(steps, sick::Sick::new(config), || sick::emulated::Device::new(family, dialect), telegram);
        }
        _ => {
            use hokuyo::emulated::Model;
            let (name, model) = [("URG-04LX", Model::URG_04LX), ("UTM-30LX", Model::UTM_30LX)][other % 2];
            let new = || hokuyo::emulated::Device::new(model);
            run(steps, hokuyo::Hokuyo::new(hokuyo::Config::new(name)), new, lines);
        }
    }
}
