//! Probes against the emulated devices, against each other's devices, and against hostile bytes.

use super::{BYTES_MAX, Identity, Kind, LIMIT, Probe, farewell};
use crate::emulated::{Device, Faults};
use crate::engine::{Lidar, Protocol};
use crate::event::Health;
use crate::rplidar::{Config, Model, Rplidar};
use crate::sick::{Dialect, Family};
use crate::ydlidar::Ydlidar;
use crate::{hokuyo, ld, rplidar, sick, ydlidar};
use base::{Duration, Instant};
use std::boxed::Box;
use std::string::String;
use std::vec::Vec;

const KINDS: [Kind; 6] =
    [Kind::Ld, Kind::Rplidar, Kind::Cola(Dialect::Text), Kind::Cola(Dialect::Binary), Kind::Scip, Kind::Ydlidar];

/// Moves the bytes until the probe has ended; its requests, and the time that it took.
fn run(probe: &mut Probe, device: &mut dyn Device, now: &mut Instant) -> (Vec<Vec<u8>>, Duration) {
    let (begin, mut requests) = (*now, Vec::new());
    while probe.poll_timeout().is_some() {
        device.handle_timeout(*now);
        let mut bytes = [0; 4096];
        let count = device.poll_tx(*now, &mut bytes);
        probe.handle_rx(*now, &bytes[..count]);
        probe.handle_timeout(*now);
        while let Some(request) = probe.poll_tx() {
            device.handle_rx(*now, &request);
            requests.push(request.to_vec());
        }
        *now += Duration::from_millis(1);
    }
    (requests, now.since(begin))
}

/// What a device at power-on says, asked in this protocol.
fn identity(kind: Kind, device: &mut dyn Device) -> Option<Identity> {
    let (mut probe, mut now) = (Probe::new(kind), Instant::from_millis(1000));
    // Motors spin up.
    for _ in 0..3000 {
        now += Duration::from_millis(1);
        device.handle_timeout(now);
        device.poll_tx(now, &mut [0; 4096]);
    }
    run(&mut probe, device, &mut now);
    probe.identity().cloned()
}

fn devices() -> Vec<(Kind, Box<dyn Device>)> {
    let mut devices: Vec<(Kind, Box<dyn Device>)> = Vec::new();
    for model in ld::Model::ALL {
        devices.push((Kind::Ld, Box::new(ld::emulated::Device::new(model))));
    }
    for model in Model::ALL {
        devices.push((Kind::Rplidar, Box::new(rplidar::emulated::Device::new(model))));
    }
    for model in ydlidar::Model::ALL {
        devices.push((Kind::Ydlidar, Box::new(ydlidar::emulated::Device::new(model))));
    }
    for family in Family::ALL {
        for dialect in [Dialect::Text, Dialect::Binary] {
            devices.push((Kind::Cola(dialect), Box::new(sick::emulated::Device::new(family, dialect))));
        }
    }
    for model in [hokuyo::emulated::Model::URG_04LX, hokuyo::emulated::Model::UTM_30LX] {
        devices.push((Kind::Scip, Box::new(hokuyo::emulated::Device::new(model))));
    }
    devices
}

fn words(text: &[u8]) -> String {
    String::from_utf8_lossy(text).into_owned()
}

#[test]
fn each_device_is_found_in_its_own_protocol_and_in_no_other() {
    for (n, (own, mut device)) in devices().into_iter().enumerate() {
        for kind in KINDS {
            // Each dialect has a connection of its own, a serial line is one for all.
            if let Kind::Cola(_) = own {
                device = devices().swap_remove(n).1;
            }
            assert_eq!(identity(kind, &mut *device).is_some(), kind == own, "{own:?} asked as {kind:?}");
        }
    }
}

#[test]
fn devices_say_model_firmware_serial_number_and_health() {
    let mut a2 = rplidar::emulated::Device::new(Model::A2);
    let found = identity(Kind::Rplidar, &mut a2).unwrap();
    assert_eq!(
        [&found.model, &found.firmware, &found.hardware].map(|text| words(text)),
        ["RPLIDAR model 0x28", "1.20", "7"]
    );
    assert_eq!(words(&found.serial), "8BB6EDF9C7E29BD1A7E39EF26E3F4302");
    // Its firmware has no requests for the configuration.
    assert_eq!((found.rplidar, found.health, found.rate_hz), (Some(Model::A2), Some(Health::Good), None));
    let found = identity(Kind::Rplidar, &mut rplidar::emulated::Device::new(Model::S2)).unwrap();
    assert_eq!((found.rplidar, found.rate_hz), (Some(Model::S2), Some(10.0)));

    for (model, number, rate_hz) in [(ydlidar::Model::X4, 6, None), (ydlidar::Model::G4, 5, Some(10.0))] {
        let found = identity(Kind::Ydlidar, &mut ydlidar::emulated::Device::new(model)).unwrap();
        assert_eq!(
            [&found.model, &found.firmware, &found.hardware, &found.serial].map(|text| words(text)),
            [&*std::format!("YDLIDAR model {number}"), "1.10", "1", "2020062200002209"]
        );
        assert_eq!((found.ydlidar, found.health, found.rate_hz), (Some(number), Some(Health::Good), rate_hz));
    }

    for (dialect, contamination) in [(Dialect::Text, Some(0)), (Dialect::Binary, Some(0))] {
        let mut device = sick::emulated::Device::new(Family::Tim5xx, dialect);
        let found = identity(Kind::Cola(dialect), &mut device).unwrap();
        assert_eq!([&found.model, &found.firmware].map(|text| words(text)), ["TiM551-2050001", "V2.46-18.12.13"]);
        assert_eq!((found.state, found.contamination, found.health), (Some(1), contamination, Some(Health::Good)));
        assert_eq!((words(&found.serial).as_str(), found.rate_hz), ("18520122", Some(15.0)));
    }
    let found = identity(Kind::Scip, &mut hokuyo::emulated::Device::new(hokuyo::emulated::Model::URG_04LX)).unwrap();
    assert_eq!(
        [&found.model, &found.firmware, &found.serial, &found.words].map(|text| words(text)),
        ["URG-04LX(Hokuyo Automatic Co.,Ltd.)", "3.1.00(18/Jan./2007)", "H0614967", "Sensor works well."]
    );
    assert_eq!((found.health, found.rate_hz, words(&found.laser)), (Some(Health::Good), Some(10.0), "OFF".into()));
}

#[test]
fn an_ldrobot_is_known_by_its_packets_and_its_model_by_their_rate() {
    for (model, shown) in
        [(ld::Model::Ld06, ld::Model::Ld19), (ld::Model::Ld19, ld::Model::Ld19), (ld::Model::Stl19p, ld::Model::Stl19p)]
    {
        let found = identity(Kind::Ld, &mut ld::emulated::Device::new(model)).unwrap();
        assert_eq!(found.ld_model(), Some(shown), "{model}: {:?} samples per second", found.samples_per_s);
        let samples = f64::from(model.samples_per_s());
        assert!(found.samples_per_s.is_some_and(|rate| (rate / samples - 1.0).abs() < 0.02), "{found:?}");
        assert!(found.rate_hz.is_some_and(|rate| (rate - 10.0).abs() < 0.2), "{model}: {:?} Hz", found.rate_hz);
    }
}

#[test]
fn what_a_buffer_had_kept_does_not_spoil_the_rates() {
    let (mut device, mut now) = (ld::emulated::Device::new(ld::Model::Stl19p), Instant::from_millis(1000));
    let mut pass = |ms: u32, take: &mut dyn FnMut(Instant, &[u8])| {
        for _ in 0..ms {
            now += Duration::from_millis(1);
            device.handle_timeout(now);
            let mut bytes = [0; 4096];
            let count = device.poll_tx(now, &mut bytes);
            take(now, &bytes[..count]);
        }
        now
    };
    let mut kept = Vec::new();
    pass(3000, &mut |_, _| ());
    pass(200, &mut |_, bytes| kept.extend_from_slice(bytes));
    let opened = pass(4000, &mut |_, _| ());
    let mut probe = Probe::new(Kind::Ld);
    probe.handle_timeout(opened);
    probe.handle_rx(opened, &kept);
    pass(900, &mut |now, bytes| probe.handle_rx(now, bytes));
    let found = probe.identity().expect("it sends");
    assert_eq!(found.ld_model(), Some(ld::Model::Stl19p), "{:?}", found.samples_per_s);
}

#[test]
fn errors_are_said_with_their_codes() {
    let error = Faults { error: true, ..Faults::default() };
    let mut a1 = rplidar::emulated::Device::new(Model::A1);
    *a1.faults() = error;
    assert_eq!(identity(Kind::Rplidar, &mut a1).unwrap().health, Some(Health::Error { code: 0x8002 }));
    let mut g4 = ydlidar::emulated::Device::new(ydlidar::Model::G4);
    *g4.faults() = error;
    assert_eq!(identity(Kind::Ydlidar, &mut g4).unwrap().health, Some(Health::Error { code: 2 }));
    let mut lms = sick::emulated::Device::new(Family::Lms1xx, Dialect::Binary);
    *lms.faults() = Faults { dirty: true, ..Faults::default() };
    let found = identity(Kind::Cola(Dialect::Binary), &mut lms).unwrap();
    assert_eq!((found.contamination, found.health), (Some(1), Some(Health::Warning { code: 1 })));
    let mut urg = hokuyo::emulated::Device::new(hokuyo::emulated::Model::URG_04LX);
    *urg.faults() = error;
    let found = identity(Kind::Scip, &mut urg).unwrap();
    assert_eq!(
        (found.health, words(&found.words)),
        (Some(Health::Error { code: 0 }), "Laser or motor malfunction".into())
    );
}

#[test]
fn nothing_is_asked_that_changes_a_device() {
    use rplidar::wire::request::{GET_HEALTH, GET_INFO, GET_LIDAR_CONF};
    use ydlidar::wire::command::GET_SPEED;
    for (kind, mut device) in devices() {
        let (mut probe, mut now) = (Probe::new(kind), Instant::from_millis(1000));
        for request in run(&mut probe, &mut *device, &mut now).0 {
            let reads = match kind {
                Kind::Ld => false,
                Kind::Rplidar => [GET_INFO, GET_HEALTH, GET_LIDAR_CONF].contains(&request[1]),
                Kind::Ydlidar => [GET_SPEED, ydlidar::wire::command::GET_INFO, ydlidar::wire::command::GET_HEALTH]
                    .contains(&request[1]),
                Kind::Cola(_) => request.windows(4).any(|part| part == b"sRN "),
                Kind::Scip => [&b"VV\n"[..], b"PP\n", b"II\n"].contains(&&request[..]),
            };
            assert!(reads, "{kind:?}: {request:?}");
        }
    }
}

/// Two seconds in which an engine starts the device.
fn start<P: Protocol>(mut engine: Lidar<P>, device: &mut dyn Device, now: &mut Instant) {
    for _ in 0..2000 {
        *now += Duration::from_millis(1);
        device.handle_timeout(*now);
        let mut bytes = [0; 4096];
        let count = device.poll_tx(*now, &mut bytes);
        engine.handle_rx(*now, &bytes[..count]);
        engine.handle_timeout(*now);
        while let Some(request) = engine.poll_tx() {
            device.handle_rx(*now, &request);
        }
        while engine.poll_event().is_some() {}
    }
}

#[test]
fn a_ydlidar_that_scans_is_stopped_and_answers() {
    for model in ydlidar::Model::ALL {
        let (mut device, mut now) = (ydlidar::emulated::Device::new(model), Instant::from_millis(1000));
        start(Ydlidar::new(ydlidar::Config::new(model)), &mut device, &mut now);
        assert!(device.scans(), "{model}");
        let mut probe = Probe::new(Kind::Ydlidar);
        run(&mut probe, &mut device, &mut now);
        assert_eq!(probe.identity().and_then(|found| found.ydlidar), Some(model.number()));
        assert!(!device.scans(), "{model}");
        start(Ydlidar::new(ydlidar::Config::new(model)), &mut device, &mut now);
        for command in farewell(Kind::Ydlidar, None) {
            device.handle_rx(now, &command);
        }
        assert!(!device.scans(), "{model}");
    }
}

#[test]
fn an_rplidar_that_scans_is_stopped_and_answers() {
    for model in Model::ALL {
        let (mut device, mut now) = (rplidar::emulated::Device::new(model), Instant::from_millis(1000));
        start(Rplidar::new(Config::new(model)), &mut device, &mut now);
        assert!(device.scans(), "{model}");
        let mut probe = Probe::new(Kind::Rplidar);
        run(&mut probe, &mut device, &mut now);
        assert_eq!(probe.identity().and_then(|found| found.rplidar), Some(model));
        for request in farewell(Kind::Rplidar, Some(model)) {
            device.handle_rx(now, &request);
        }
        assert!(!device.scans(), "{model}");
    }
}

#[test]
fn a_probe_ends_whatever_arrives() {
    let mut random = 0x9E37_79B9_7F4A_7C15_u64;
    let mut next = || {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random >> 24
    };
    // Begins and ends of frames of all protocols are frequent.
    let letters = [0x54, 0x2C, 0xA5, 0x5A, 0x14, 0x02, 0x03, b'\n', b'V', b's', 0, 0xFF];
    for kind in KINDS {
        for round in 0..4 {
            let (mut probe, mut now) = (Probe::new(kind), Instant::from_millis(1000));
            let (begin, mut sent) = (now, 0);
            while probe.poll_timeout().is_some() {
                let bytes: Vec<u8> = (0..2000)
                    .map(|_| if round % 2 == 0 { next() as u8 } else { letters[next() as usize % letters.len()] })
                    .collect();
                sent += bytes.len();
                probe.handle_rx(now, &bytes);
                assert!(probe.rx.len() <= super::RX_MAX);
                probe.handle_timeout(now);
                while probe.poll_tx().is_some() {}
                now += Duration::from_millis(10);
            }
            assert!(now.since(begin) <= LIMIT + Duration::from_millis(20), "{kind:?}");
            assert!(probe.received() <= BYTES_MAX + 2000 && sent > 0);
            // Without checksums a random answer is possible, and as improbable as 56 right bits.
            assert!(probe.identity().is_none(), "{kind:?}: {:?}", probe.identity());
        }
    }
}

#[test]
fn a_disturbed_line_does_not_make_a_device_of_it() {
    for (own, mut device) in devices() {
        *device.faults() = Faults { wrong_baud: true, ..Faults::default() };
        for kind in KINDS {
            assert_eq!(identity(kind, &mut *device), None, "{own:?} at another rate, asked as {kind:?}");
        }
    }
}

#[test]
fn silence_costs_a_bounded_time() {
    for kind in KINDS {
        let mut device = rplidar::emulated::Device::new(Model::A1);
        *device.faults() = Faults { cut: true, ..Faults::default() };
        let (mut probe, mut now) = (Probe::new(kind), Instant::from_millis(1000));
        let (_, took) = run(&mut probe, &mut device, &mut now);
        assert!(took <= Duration::from_millis(950), "{kind:?}: {took:?}");
        assert_eq!((probe.identity(), probe.received()), (None, 0));
    }
}
