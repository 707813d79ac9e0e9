use super::emulated::{Device, Model};
use super::wire::{Parameters, checked, checksum, decode, encode};
use super::{Characters, Config, Hokuyo, Scip};
use crate::bench::{Bench, Cause, Seen, ms};
use crate::emulated::Device as _;
use crate::event::{Health, LostReason, State};
use crate::scan::{Sector, Status};
use base::Duration;
use core::f64::consts::PI;
use std::string::String;
use std::vec::Vec;
use testing::Random;

fn bench(model: Model, characters: Characters) -> Bench<Scip, Device> {
    let name = if model == Model::URG_04LX { "URG-04LX" } else { "UTM-30LX" };
    let config = Config { characters, bytes_per_s: model.bytes_per_s, ..Config::new(name) };
    Bench::new(Hokuyo::new(config), Device::new(model))
}

#[test]
fn numbers_are_encoded_as_in_the_specification() {
    // C-42-03320B, chapter 6: examples of two, three and four characters.
    for (value, text) in [(1234, "CB"), (5432, "1Dh"), (16_000_000, "m2@0")] {
        let mut characters = [0; 4];
        let characters = &mut characters[..text.len()];
        encode(value, characters);
        assert_eq!((&*characters, decode(text.as_bytes())), (text.as_bytes(), Some(value)));
    }
    assert_eq!((decode(b"0/"), decode(b"0p"), decode(b"")), (None, None, Some(0)));
    assert_eq!(decode(b"oooooo"), None, "more than 32 bits");
}

#[test]
fn lines_of_real_sensors_have_their_checksums() {
    // Answers of a URG-04LX to VV, PP and II, from the wiki of the URG Network; status lines of C-42-03320B.
    for line in [
        "VEND:Hokuyo Automatic Co.,Ltd.;[",
        "PROD:SOKUIKI Sensor URG-04LX;[",
        "PROT:SCIP 2.0;N",
        "MODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N",
        "DMIN:20;4",
        "DMAX:5600;_",
        "AMIN:44;7",
        "AMAX:725;o",
        "AFRT:384;6",
        "SCAN:600;e",
        "00P",
        "99b",
    ] {
        let (sum, body) = line.as_bytes().split_last().unwrap();
        let without = body.strip_suffix(b";").unwrap_or(body);
        assert!(
            checked(line.as_bytes()) == Some(body),
            "{line}: {} {}",
            checksum(body) as char,
            checksum(without) as char
        );
        let mut damaged = line.as_bytes().to_vec();
        damaged[0] ^= 1;
        assert_eq!(checked(&damaged), None, "{line} {sum}");
    }
}

#[test]
fn parameters_are_read_and_checked() {
    let mut parameters = Parameters::default();
    for line in ["MODL:X;", "DMIN:20;", "DMAX:5600;", "ARES:1024;", "AMIN:44;", "AMAX:725;", "AFRT: 384;", "SCAN:600;"]
    {
        assert!(parameters.take(line.as_bytes()), "{line}");
    }
    assert_eq!(parameters, Model::URG_04LX.parameters);
    assert!(parameters.is_valid() && parameters.count() == 682);
    assert!(!parameters.take(b"AMAX:-1;") && !parameters.take(b"AMAX:;") && !parameters.take(b"AMAX:123456789;"));
    assert!(!Parameters { last: 1024, ..parameters }.is_valid() && !Parameters { rpm: 0, ..parameters }.is_valid());
}

#[test]
fn every_model_and_encoding_starts_and_measures() {
    for model in [Model::URG_04LX, Model::UTM_30LX] {
        for characters in Characters::ALL {
            let mut bench = bench(model, characters);
            for (n, range) in bench.device.scene().0.iter_mut().enumerate() {
                *range = 0.3 + n as f32 * 0.005;
            }
            bench.device.scene().0[350] = f32::INFINITY;
            bench.pass(ms(1000));
            let Some((_, Seen::Identity(text))) = bench.seen.first() else { panic!("{:?}", bench.seen) };
            assert_eq!(*text, std::format!("{} firmware 3.1.00(18/Jan./2007) serial H0614967", model.name));
            assert!(bench.has(&Seen::Health(Health::Good)));
            bench.run();
            bench.pass(ms(500));
            let revolution = bench.sectors[9].revolution;
            let sectors: Vec<&Sector> = bench.sectors.iter().filter(|it| it.revolution == revolution).collect();
            let count: usize = sectors.iter().map(|it| it.ranges_m.len()).sum();
            assert_eq!((sectors.len(), count, sectors[0].status), (6, model.parameters.count(), Status::Ok));
            for sector in &sectors {
                for (k, range) in sector.ranges_m.iter().enumerate() {
                    let angle = sector.angle_rad(k);
                    let expected = bench.device.scene().range_m(angle);
                    let is_near = (range - expected).abs() < 0.0051 || range.is_nan() && expected.is_infinite();
                    assert!(is_near || angle.abs() < 0.01, "{range} {expected} at {angle}");
                }
            }
            assert!(sectors[0].angle_min_rad < -0.6 * PI && sectors[0].angle_step_rad > 0.0);
            assert_eq!(bench.engine.counters().rejected, 0, "{} {characters}", model.name);
        }
    }
}

#[test]
fn the_start_up_is_that_of_the_specification() {
    let mut bench = bench(Model::URG_04LX, Characters::Three);
    bench.run();
    let sent: Vec<String> = bench.sent.iter().map(|it| String::from_utf8_lossy(it).into_owned()).collect();
    assert_eq!(sent, ["QT\n", "VV\n", "PP\n", "II\n", "BM\n", "MD0044072501000\n"]);
}

#[test]
fn a_rate_that_cannot_carry_the_scans_does_not_make_them_older() {
    // As if the line of a sensor on USB had 115200 bit/s: a scan would take 0.3 s, and one comes every 25 ms.
    let config = Config { bytes_per_s: 11_520, ..Config::new("UTM-30LX") };
    let mut bench = Bench::new(Hokuyo::new(config), Device::new(Model::UTM_30LX));
    bench.run();
    bench.pass(ms(500));
    let last = bench.sectors.last().expect("it measures");
    let age = bench.now.since(last.at);
    assert!(age < ms(60), "{age:?}");
}

#[test]
fn twenty_faults_are_reported_within_a_second_and_end_within_two() {
    let own: [Cause; 6] = [
        ("motor stands", |faults| faults.motor_stopped = true),
        ("motor slow", |faults| faults.motor_slow = true),
        ("device hangs", |faults| faults.hangs = true),
        ("error of the device", |faults| faults.error = true),
        ("error, and it refuses", |faults| (faults.error, faults.refuses) = (true, true)),
        ("stands, and is another model", |faults| (faults.motor_stopped, faults.stranger) = (true, true)),
    ];
    let [two, three] = Characters::ALL;
    for (model, characters) in [(Model::URG_04LX, two), (Model::URG_04LX, three), (Model::UTM_30LX, three)] {
        std::println!("{}, {characters} characters", model.name);
        bench(model, characters).suffers_all(&own);
    }
}

#[test]
fn faults_of_a_bit_of_ten_thousand_are_reported_and_one_disturbance_is_not() {
    for characters in Characters::ALL {
        let name = std::format!("URG-04LX, {characters} characters");
        let mut bench = bench(Model::URG_04LX, characters);
        bench.shrugs_off(&name);
        let reports = bench.disturbed(&name, 200, |faults| faults.wrong_bits_ppm = 100);
        // Of ten scans a second eight are damaged: it is lost most of the time.
        assert!(reports.within(ms(1000)) == 200 && reports.ends <= 5, "{name}: {reports:?}");
        bench.disturbed("1 of 10,000 bytes", 50, |faults| faults.noise_ppm = 100);
    }
}

#[test]
fn another_model_an_error_and_a_refusal_are_reported() {
    let mut bench = bench(Model::UTM_30LX, Characters::Three);
    bench.device.faults().stranger = true;
    bench.pass(ms(500));
    assert!(bench.has(&Seen::Lost(LostReason::Identity)), "{:?}", bench.seen);
    (bench.device.faults().stranger, bench.device.faults().error) = (false, true);
    bench.pass(ms(700));
    assert!(bench.has(&Seen::Health(Health::Error { code: 0 })), "{:?}", bench.seen);
    (bench.device.faults().error, bench.device.faults().refuses) = (false, true);
    bench.pass(ms(700));
    assert!(bench.has(&Seen::Lost(LostReason::Refused { code: 0x3045 })), "{:?}", bench.seen);
    bench.device.faults().refuses = false;
    bench.pass(ms(1000));
    assert_eq!(bench.engine.state(), State::Running);
}

#[test]
fn covered_optics_measure_nothing() {
    let mut bench = bench(Model::URG_04LX, Characters::Three);
    bench.run();
    bench.device.faults().blocked = true;
    bench.pass(ms(300));
    bench.sectors.clear();
    bench.pass(ms(300));
    assert!(bench.sectors.iter().all(|sector| sector.ranges_m.iter().all(|range| range.is_nan())));
}

#[test]
fn hostile_bytes_in_any_state_do_no_harm() {
    let mut random = Random::new(9);
    let mut bench = bench(Model::URG_04LX, Characters::Two);
    for n in 0..60_000_u32 {
        let mut bytes: Vec<u8> = (0..random.index(6)).map(|_| random.edge_byte()).collect();
        if random.one_in(30) {
            let lines = ["99b\n", "00P\n", "\n", "MS0044072501000\n", "AMAX:0;7\n", "0000\n", "PP\n", "0E?\n"];
            bytes.extend(lines[random.index(lines.len())].as_bytes());
        }
        bench.engine.handle_rx(bench.now, &bytes);
        bench.device.handle_rx(bench.now, &bytes);
        while bench.engine.poll_event().is_some() {}
        if n % 8 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.counters().rejected > 0);
    bench.device = Device::new(Model::URG_04LX);
    bench.pass(Duration::from_secs(6));
    assert_eq!(bench.engine.state(), State::Running);
}
