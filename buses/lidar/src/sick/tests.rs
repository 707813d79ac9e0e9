use super::emulated::Device;
use super::wire::{self, Dialect, Reader, Scan, Writer};
use super::{Cola, Config, Family, Sick};
use crate::bench::{Bench, Cause, Seen, ms};
use crate::emulated::Device as _;
use crate::event::{Event, Fault, FieldResult, Health, LostReason, State, Zone};
use crate::scan::{Sector, Status};
use base::{Duration, Instant};
use core::f64::consts::{FRAC_PI_2, PI};
use std::vec::Vec;
use testing::Random;

/// A scan of a TiM5xx in CoLa A, as recorded in the public project "lidar" of BFH (`HardwareMock.java`).
const SCAN: &str = "sSN LMDscandata 1 1 107375C 0 0 E784 E789 3D611E4A 3D612D1F 0 0 1 0 0 5DC 36 0 1 DIST1 \
3F800000 00000000 FFF92230 2710 10F 1B8 1B3 1B9 1BD 1F9 22B 218 209 1F9 1FB 1F4 1EB 1E0 1D7 1CE 1C6 1BE 1B8 1BB 1B6 \
1B1 193 1A6 201 2B7 2 671 5CE 4FE 0 15A 156 14D 142 149 151 157 15B 1EF 254 6B5 621 5E9 C93 5AE 561 536 506 0 F0 \
176 191 18C 18B 189 18A 18F 18A 18F 191 18C 18B 187 17E 178 160 143 12F 11B 104 EA CA A9 A6 A2 9F A0 9D 9E 9E 9C 9C \
9A 98 98 97 93 93 91 8C 8B 8B 88 8A 83 8B 91 8C 89 8C 8D 88 87 8E 5A 0 0 610 5FE 5ED 5DE 5D6 5D1 5C4 5B6 5B6 5AF \
5A1 596 595 591 592 589 584 57D 57B 579 571 571 56F 56B 577 573 576 56B 56B 56C 56E 577 579 57C 57C 586 58A 58E 595 \
593 59B 0 301 30A 30A 30E 316 31A 31F 323 32D 32F 335 33E 345 350 358 362 369 36F 6A0 6B6 6D1 723 225 206 22C 235 \
21C 1E9 1D2 1C0 1B8 16E 10C 6F9 6E3 6D0 6B0 69D 684 678 65F 652 63B 628 617 607 5FC 5EF 5DB 5D2 5C6 5C0 58D 575 0 \
1A E5 E5 E6 E8 E6 E7 E6 EB E2 E3 EC E7 E2 E7 F0 EA E8 E8 E5 E8 EB EE EF EE F1 F0 F4 F4 F0 F4 F5 F9 F9 F8 FC 101 103 \
106 17D 333 34C 0 5CD 5DC 5E0 5AE 57B 550 54E 58E 192 1C6 1F3 1FC 1F2 1A1 1AA 2 AA6 419 418 562 56A 562 548 535 1 \
RSSI1 3F800000 00000000 FFF92230 2710 10F AA AA AA A3 9A 97 87 8A 8A 8A 8D 8D 8D 90 8D 8D 90 8A 90 8D 93 8D 7D 6A \
5E 0 A0 6D 74 0 80 87 9A B9 AA 8A 84 74 67 80 5B 74 31 25 57 64 67 80 0 44 7A 8A 8A 87 87 80 80 7A 7A 77 7A 74 74 \
77 74 77 6D 74 71 6D 6D 71 6D 6D 77 77 77 7D 80 84 87 8A 8A 90 93 8D 93 93 90 93 93 97 9A A0 A0 A6 A3 9A 93 90 80 \
74 71 64 61 0 0 B3 B6 BD BD BD BD C0 BD C3 C3 C3 C0 C3 C6 C6 C6 C6 C6 C6 CC CC D3 D3 D9 E6 E6 E6 D9 D9 CF CC CC C9 \
C9 C3 C9 C9 C6 C6 C0 BD 0 D6 D6 D3 CF D3 CF D3 CF CF C9 CC CC CC CC CC C9 C6 B6 A3 A0 8D 71 71 84 8D 87 84 87 87 8A \
87 90 9A 9D A3 A6 A3 A3 A0 A6 AA AD AD AD AD AD B0 B0 AD B3 B0 B0 A0 A0 0 80 93 9A 97 9A 97 9A 9A 9D 97 97 A0 9D 97 \
9D A0 9D 9A 93 97 93 93 97 93 93 97 97 97 90 90 93 93 97 97 90 8D 8D 8D 87 57 7A 84 0 AA AD A3 90 8D 9D 90 87 80 93 \
8A 8D 74 44 48 0 48 87 7D 93 A0 A3 A3 A3 0 1 B not defined 0 0 0";

/// Results of three fields of a TiM781S in CoLa B, as recorded in the comments of `sick_scan_xd`
/// (`sick_scan_messages.cpp`): field 1 not valid, fields 2 and 3 free.
const FIELDS: &str = "02020202 0000008e 73534e204c464572656320 0003 \
0001 01 00000000 3f800000 00000000 00000d05 fff92230 00 000000000000 0001 07b2 01 01 08 33 2e 0009ac90 \
0001 02 00000000 3f800000 00000000 00000d05 fff92230 01 000000000000 0001 07b2 01 01 08 34 02 00069f50 \
0001 03 00000000 3f800000 00000000 00000d05 fff92230 01 000000000000 0001 07b2 01 01 08 33 35 0009ac90 ac";

/// Outputs of a TiM781S in CoLa B, as recorded in the comments of `sick_scan_xd` (`sick_scan_messages.cpp`).
const OUTPUTS: &str = "02020202 00000034 73534e204c49446f757470757473746174652000000000 0000 \
01 00000126 00 00000122 00 00000000 01 00000004 02 00000000 0000 45";

/// Outputs of an LMS5xx in CoLa A, with a time, as quoted in the comments of a public driver of that device.
const OUTPUTS_A: &[u8] =
    b"sRA LIDoutputstate 1 E88CDA0F 1 A 1 A 1 A 2 0 2 0 2 0 2 0 2 0 2 0 2 0 2 0 1 7DD 1 1 0 1D 3B 5B8D8";

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
    let digit = |byte: u8| char::from(byte).to_digit(16).unwrap() as u8;
    digits.chunks(2).map(|pair| digit(pair[0]) << 4 | digit(pair[1])).collect()
}

fn bench(family: Family, dialect: Dialect, fields: bool) -> Bench<Cola, Device> {
    let config = Config { fields, ..Config::new(family, dialect) };
    Bench::new(Sick::new(config), Device::new(family, dialect))
}

/// Both fields and outputs are asked for.
fn evaluating(family: Family, dialect: Dialect) -> Bench<Cola, Device> {
    let config = Config { fields: true, outputs: true, ..Config::new(family, dialect) };
    let mut bench = Bench::new(Sick::new(config), Device::new(family, dialect));
    bench.run();
    bench
}

#[test]
fn requests_are_those_of_the_listing() {
    let new = |dialect, name| Writer::<80>::new(dialect, name);
    // LMS500 operating instructions, 10.2.6, without the blank before ETX that devices do not need.
    assert_eq!(new(Dialect::Text, "sRN LCMstate").frame()[..], *b"\x02sRN LCMstate\x03");
    assert_eq!(new(Dialect::Text, "sEN LMDscandata").u8(1).frame()[..], *b"\x02sEN LMDscandata 1\x03");
    let login = new(Dialect::Text, "sMN SetAccessMode").fixed("03").u32(0xF472_4744);
    assert_eq!(login.frame()[..], *b"\x02sMN SetAccessMode 03 F4724744\x03");
    // Length and checksum of binary requests, as in the log of `sick_scan_xd` (doc, timing and log output).
    for (name, length, sum) in
        [("sRN SCdevicestate", 0x11, 0x30), ("sMN LMCstartmeas", 0x10, 0x68), ("sRN DeviceIdent", 0x0F, 0x25)]
    {
        let frame = new(Dialect::Binary, name).frame();
        assert_eq!((&frame[..8], frame.last()), (&[2, 2, 2, 2, 0, 0, 0, length][..], Some(&sum)), "{name}");
    }
}

#[test]
fn values_are_read_as_hexadecimal_or_with_a_sign_as_decimal() {
    let text = |text: &'static str| Reader::new(Dialect::Text, text.as_bytes(), "sRA X").unwrap();
    assert_eq!(text("sRA X FFF92230").i32(), Some(-450_000));
    assert_eq!(text("sRA X -450000").i32(), Some(-450_000));
    assert_eq!((text("sRA X +255").u8(), text("sRA X FF").u8(), text("sRA X 100").u8()), (Some(255), Some(255), None));
    assert_eq!((text("sRA X -1").u16(), text("sRA X G").u16(), text("sRA X").u16()), (None, None, None));
    let mut ident = text("sRA X 10 LMS10x_FieldEval 10 V1.36-21.10.2010");
    assert_eq!((ident.text(), ident.text()), (Some(&b"LMS10x_FieldEval"[..]), Some(&b"V1.36-21.10.2010"[..])));
    assert!(Reader::new(Dialect::Text, b"sRA XY 1", "sRA X").is_none());
}

#[test]
fn a_recorded_scan_is_read() {
    let values = Reader::new(Dialect::Text, SCAN.as_bytes(), "sSN LMDscandata").unwrap();
    let scan = Scan::decode(values).expect("valid");
    assert_eq!((scan.serial, scan.status, scan.telegram, scan.number), (0x0107_375C, 0, 0xE784, 0xE789));
    assert_eq!((scan.scanned_us, scan.sent_us, scan.frequency), (0x3D61_1E4A, 0x3D61_2D1F, 1500));
    assert_eq!((scan.distances.start, scan.distances.step, scan.distances.count), (-450_000, 10_000, 271));
    let distances: Vec<u16> = scan.distances.values().collect();
    assert_eq!((distances[..3].to_vec(), distances[25], distances[270]), ([0x1B8, 0x1B3, 0x1B9].to_vec(), 2, 0x535));
    let intensities: Vec<u16> = scan.intensities.unwrap().values().collect();
    assert_eq!((intensities.len(), intensities[0], intensities[270]), (271, 0xAA, 0xA3));
    // Cut anywhere before the last channel's end it is refused.
    let last = SCAN.find(" 0 1 B not").unwrap();
    for cut in (20..last).step_by(7) {
        let values = Reader::new(Dialect::Text, &SCAN.as_bytes()[..cut], "sSN LMDscandata").unwrap();
        assert!(Scan::decode(values).is_none_or(|scan| scan.distances.count == 271), "cut at {cut}");
    }
}

#[test]
fn recorded_field_results_are_read() {
    let frame = hex(FIELDS);
    let (telegram, sum) = (&frame[8..frame.len() - 1], frame[frame.len() - 1]);
    assert_eq!((telegram.len(), wire::checksum(telegram)), (0x8E, sum));
    let fields = wire::fields(Reader::new(Dialect::Binary, telegram, "sSN LFErec").unwrap()).expect("valid");
    assert_eq!(fields[..], [(1, FieldResult::Unknown), (2, FieldResult::Free), (3, FieldResult::Free)]);
    for cut in 13..telegram.len() {
        assert!(wire::fields(Reader::new(Dialect::Binary, &telegram[..cut], "sSN LFErec").unwrap()).is_none());
    }
}

#[test]
fn recorded_outputs_are_read_with_and_without_a_time() {
    use FieldResult::{Free, Infringed, Unknown};
    let frame = hex(OUTPUTS);
    let (telegram, sum) = (&frame[8..frame.len() - 1], frame[frame.len() - 1]);
    assert_eq!((telegram.len(), wire::checksum(telegram)), (0x34, sum));
    let read = |dialect, telegram: &[u8], name: &str| wire::outputs(Reader::new(dialect, telegram, name).unwrap());
    let outputs = read(Dialect::Binary, telegram, "sSN LIDoutputstate").expect("valid");
    assert_eq!(outputs[..], [(1, Free), (2, Infringed), (3, Infringed), (4, Free), (5, Unknown)]);
    let outputs = read(Dialect::Text, OUTPUTS_A, "sRA LIDoutputstate").expect("valid");
    assert_eq!((outputs.len(), outputs[2], outputs[3]), (11, (3, Free), (4, Unknown)));
    for cut in 19..telegram.len() {
        let cut = read(Dialect::Binary, &telegram[..cut], "sSN LIDoutputstate");
        assert!(cut.is_none_or(|outputs| outputs.iter().zip(1..).all(|((number, _), n)| *number == n)));
    }
    let mut wrong = telegram.to_vec();
    wrong[25] = 3;
    assert!(read(Dialect::Binary, &wrong, "sSN LIDoutputstate").is_none(), "no state of an output");
}

#[test]
fn the_recorded_scan_becomes_sectors() {
    let mut bench = bench(Family::Tim5xx, Dialect::Text, false);
    bench.run();
    let mut scan = Vec::from(*b"\x02");
    scan.extend(SCAN.bytes());
    scan.push(3);
    // The clock of the recording is another than that of the emulated device.
    bench.device.faults().hangs = true;
    bench.pass(ms(50));
    bench.engine.handle_rx(bench.now, &scan);
    bench.pass(ms(10));
    bench.sectors.clear();
    let later = SCAN.replace("3D612D1F", "3D613D1F").replace("3D611E4A", "3D622E4A").replace("E789", "E78A");
    bench.engine.handle_rx(bench.now, b"\x02");
    bench.engine.handle_rx(bench.now, later.as_bytes());
    bench.engine.handle_rx(bench.now, b"\x03");
    bench.pass(ms(1));
    let counts: Vec<usize> = bench.sectors.iter().map(|sector| sector.ranges_m.len()).collect();
    assert_eq!(counts, [46, 46, 46, 46, 46, 41]);
    let sector = &bench.sectors[0];
    assert!((sector.angle_min_rad + 0.75 * PI).abs() < 1e-9, "135° to the right");
    assert_eq!((sector.ranges_m[0], sector.intensities[0]), (0.440, 170.0));
    // 2: dazzled or reserved; 0: no echo.
    assert!(sector.ranges_m[25].is_nan() && sector.ranges_m[29].is_nan());
    // 26 mm is below the range of the model.
    let near = bench.sectors.iter().flat_map(|it| it.ranges_m.iter()).filter(|range| **range == f32::NEG_INFINITY);
    assert_eq!(near.count(), 1);
}

#[test]
fn every_family_and_dialect_starts_and_measures() {
    for family in Family::ALL {
        for dialect in [Dialect::Text, Dialect::Binary] {
            let mut bench = bench(family, dialect, true);
            for (n, range) in bench.device.scene().0.iter_mut().enumerate() {
                *range = 1.5 + n as f32 * 0.01;
            }
            bench.pass(ms(1000));
            let Some((_, Seen::Identity(text))) = bench.seen.first() else { panic!("{:?}", bench.seen) };
            assert!(text.starts_with(family.name_begins()) && text.ends_with("V2.46-18.12.13"), "{text}");
            assert!(bench.has(&Seen::Health(Health::Good)));
            assert_eq!(bench.has(&Seen::Zone(Zone::Field(1), FieldResult::Free)), family != Family::Tim5xx);
            bench.run();
            bench.pass(ms(500));
            let revolution = bench.sectors[9].revolution;
            let sectors: Vec<&Sector> = bench.sectors.iter().filter(|it| it.revolution == revolution).collect();
            assert_eq!((sectors.len(), sectors[0].status), (6, Status::Ok), "{family}");
            for sector in &sectors {
                for (k, range) in sector.ranges_m.iter().enumerate() {
                    let angle = sector.angle_rad(k);
                    let expected = bench.device.scene().range_m(angle);
                    assert!((range - expected).abs() < 0.011 || angle.abs() < 0.01, "{range} {expected} at {angle}");
                }
            }
            assert!(sectors[0].angle_min_rad < -FRAC_PI_2 && sectors[5].angle_min_rad > FRAC_PI_2);
            assert_eq!(bench.engine.counters().rejected, 0);
        }
    }
}

#[test]
fn an_lms1xx_is_logged_in_and_started_and_others_are_not() {
    let mut bench = bench(Family::Lms1xx, Dialect::Text, false);
    bench.run();
    let names: Vec<_> = bench.sent.iter().map(|it| std::string::String::from_utf8_lossy(it).into_owned()).collect();
    let expected = [
        "\x02sRN DeviceIdent\x03",
        "\x02sRN SCdevicestate\x03",
        "\x02sMN SetAccessMode 03 F4724744\x03",
        "\x02sMN LMCstartmeas\x03",
        "\x02sMN Run\x03",
        "\x02sEN LMDscandata 1\x03",
    ];
    assert_eq!(names[..6], expected);
    let mut bench = self::bench(Family::Tim5xx, Dialect::Binary, true);
    bench.run();
    assert!(bench.sent.iter().all(|request| !request.windows(3).any(|part| part == b"sMN")));
}

#[test]
fn an_object_in_a_field_is_reported_on_change() {
    let mut bench = bench(Family::Tim7xx, Dialect::Binary, true);
    bench.run();
    bench.device.scene().0[100] = 0.5;
    bench.pass(ms(200));
    bench.device.scene().0[100] = 3.0;
    bench.pass(ms(200));
    let fields: Vec<&Seen> = bench.seen.iter().map(|(_, seen)| seen).collect();
    let seen = |result| Seen::Zone(Zone::Field(1), result);
    assert_eq!(fields, [&seen(FieldResult::Infringed), &seen(FieldResult::Free)]);
}

#[test]
fn what_is_in_a_field_infringes_it_and_its_output_is_not_active() {
    for (family, has_results) in [(Family::Lms1xx, true), (Family::Tim5xx, false), (Family::Tim7xx, true)] {
        for dialect in [Dialect::Text, Dialect::Binary] {
            let mut bench = evaluating(family, dialect);
            let known = |result| if has_results { result } else { FieldResult::Unknown };
            let (field, output) = (Zone::Field(1), Zone::Output(1));
            let now = |bench: &Bench<Cola, Device>| [field, output].map(|zone| bench.engine.result(zone));
            assert_eq!(now(&bench), [known(FieldResult::Free), FieldResult::Free], "{family} {dialect:?}");
            bench.device.scene().0[700] = 0.9;
            bench.pass(ms(250));
            assert_eq!(now(&bench), [known(FieldResult::Infringed), FieldResult::Infringed]);
            bench.device.scene().0[700] = 1.3;
            bench.pass(ms(250));
            assert_eq!(now(&bench), [known(FieldResult::Free), FieldResult::Free], "beside it");
            // A field that the device does not have, an output that it does not use, and numbers of none.
            for zone in [Zone::Field(2), Zone::Field(0), Zone::Field(200), Zone::Output(2), Zone::Output(17)] {
                assert_eq!(bench.engine.result(zone), FieldResult::Unknown, "{zone}");
            }
            assert_eq!(bench.engine.counters().rejected, 0);
        }
    }
}

#[test]
fn results_are_read_ten_times_a_second_and_one_at_a_time() {
    let mut bench = evaluating(Family::Tim7xx, Dialect::Binary);
    bench.sent.clear();
    bench.pass(ms(1000));
    let asked = |bench: &Bench<Cola, Device>, name: &[u8]| {
        bench.sent.iter().filter(|it| it.windows(name.len()).any(|part| part == name)).count()
    };
    assert!((8..=10).contains(&asked(&bench, b"sRN LFErec")), "{:?}", bench.sent);
    assert!((8..=10).contains(&asked(&bench, b"sRN LIDoutputstate")), "{:?}", bench.sent);
    // What is not configured is not asked for.
    let mut bench = self::bench(Family::Tim7xx, Dialect::Binary, false);
    bench.run();
    assert_eq!((asked(&bench, b"LFErec"), asked(&bench, b"LIDoutputstate")), (0, 0));
}

#[test]
fn a_result_that_is_not_confirmed_is_unknown_within_half_a_second() {
    let faults: [Cause; 6] = [
        ("refuses", |faults| faults.refuses = true),
        ("cut", |faults| faults.cut = true),
        ("nothing reaches it", |faults| faults.deaf = true),
        ("hangs", |faults| faults.hangs = true),
        ("repeats itself", |faults| faults.repeats = true),
        ("holds back", |faults| faults.held_back = true),
    ];
    for (name, set) in faults {
        let mut bench = evaluating(Family::Tim7xx, Dialect::Binary);
        set(bench.device.faults());
        bench.pass(ms(500));
        for zone in [Zone::Field(1), Zone::Output(1)] {
            assert_eq!(bench.engine.result(zone), FieldResult::Unknown, "{name}: {zone}");
        }
        // What the line held back until now is no result of now.
        *bench.device.faults() = crate::emulated::Faults::default();
        bench.pass(ms(3000));
        assert_eq!(bench.engine.result(Zone::Field(1)), FieldResult::Free, "{name}");
    }
}

#[test]
fn a_device_that_only_reports_changes_or_does_not_measure_says_nothing() {
    // A TiM5xx does not answer for its fields: a report alone is not believed.
    let mut bench = evaluating(Family::Tim5xx, Dialect::Binary);
    bench.engine.handle_rx(bench.now, &hex(FIELDS));
    assert_eq!(bench.engine.result(Zone::Field(2)), FieldResult::Unknown);
    let mut bench = evaluating(Family::Lms1xx, Dialect::Binary);
    bench.device.faults().blocked = true;
    bench.pass(ms(300));
    assert_eq!(bench.engine.result(Zone::Field(1)), FieldResult::Unknown, "the optics are blocked");
    assert_eq!(bench.engine.state(), State::Running);
}

#[test]
fn dirty_optics_warn_and_blocked_ones_mark_their_sectors() {
    // An LMS1xx and a TiM5xx are asked for the contamination; of a TiM7xx the scans say it.
    for family in Family::ALL {
        let mut bench = bench(family, Dialect::Text, false);
        bench.run();
        bench.device.faults().dirty = true;
        bench.pass(ms(1000));
        assert!(bench.engine.is_active(Fault::Dirty) && !bench.engine.is_active(Fault::Blocked), "{family}");
        bench.device.faults().blocked = true;
        bench.pass(ms(1000));
        bench.sectors.clear();
        bench.pass(ms(200));
        assert!(bench.engine.is_active(Fault::Blocked), "{family}");
        assert!(!bench.sectors.is_empty() && bench.sectors.iter().all(|it| it.status == Status::Blocked));
    }
}

#[test]
fn twenty_faults_are_reported_within_a_second_and_end_within_two() {
    let own: [Cause; 9] = [
        ("motor stands", |faults| faults.motor_stopped = true),
        ("motor slow", |faults| faults.motor_slow = true),
        ("device hangs", |faults| faults.hangs = true),
        ("error of the device", |faults| faults.error = true),
        ("dirty optics", |faults| faults.dirty = true),
        ("blocked optics", |faults| faults.blocked = true),
        ("hangs, and refuses", |faults| (faults.hangs, faults.refuses) = (true, true)),
        ("stands, and is another model", |faults| (faults.motor_stopped, faults.stranger) = (true, true)),
        ("nothing reaches it, and it stands", |faults| (faults.deaf, faults.motor_stopped) = (true, true)),
    ];
    for (family, dialect) in Family::ALL.into_iter().flat_map(|it| [(it, Dialect::Text), (it, Dialect::Binary)]) {
        std::println!("{family} {dialect:?}");
        bench(family, dialect, true).suffers_all(&own);
    }
}

#[test]
fn another_model_and_a_refusal_are_reported() {
    let mut bench = bench(Family::Tim5xx, Dialect::Binary, false);
    bench.device.faults().stranger = true;
    bench.pass(ms(300));
    assert!(bench.has(&Seen::Lost(LostReason::Identity)), "{:?}", bench.seen);
    (bench.device.faults().stranger, bench.device.faults().refuses) = (false, true);
    bench.pass(ms(500));
    assert!(bench.has(&Seen::Lost(LostReason::Refused { code: 3 })), "{:?}", bench.seen);
    bench.device.faults().refuses = false;
    bench.pass(ms(1000));
    assert_eq!(bench.engine.state(), State::Running);
}

#[test]
fn a_closed_connection_is_reported_at_once() {
    let mut bench = bench(Family::Tim7xx, Dialect::Text, false);
    bench.run();
    bench.engine.handle_closed(bench.now);
    bench.engine.handle_closed(bench.now);
    bench.pass(ms(1));
    assert_eq!(bench.seen[0].1, Seen::Lost(LostReason::Closed));
    bench.pass(ms(1000));
    assert_eq!(bench.engine.state(), State::Running);
}

#[test]
fn hostile_bytes_in_any_state_do_no_harm() {
    for dialect in [Dialect::Text, Dialect::Binary] {
        let mut random = Random::new(3);
        let mut bench = bench(Family::Tim5xx, dialect, true);
        for n in 0..40_000_u32 {
            let mut bytes: Vec<u8> = (0..random.index(6)).map(|_| random.edge_byte()).collect();
            if random.one_in(100) {
                let mut scan = SCAN.as_bytes().to_vec();
                for _ in 0..random.index(3) {
                    let at = random.index(scan.len());
                    scan[at] = random.edge_byte();
                }
                bytes.push(2);
                bytes.extend(scan);
                bytes.push(3);
            }
            if random.one_in(20) {
                let mut telegram = hex(if random.one_in(2) { FIELDS } else { OUTPUTS });
                let (at, end) = (8 + random.index(telegram.len() - 10), telegram.len() - 1);
                telegram[at] = random.edge_byte();
                telegram[end] = wire::checksum(&telegram[8..end]);
                bytes.extend(telegram);
            }
            bench.engine.handle_rx(bench.now, &bytes);
            bench.device.handle_rx(bench.now, &bytes);
            while let Some(event) = bench.engine.poll_event() {
                assert!(!matches!(event, Event::Health(Health::Warning { code: 0 })));
            }
            if n % 8 == 0 {
                bench.step();
            }
        }
        assert!(bench.engine.counters().rejected > 0);
        // An endless telegram.
        for _ in 0..40 {
            bench.engine.handle_rx(bench.now, &[b'x'; 1000]);
        }
        bench.device = Device::new(Family::Tim5xx, dialect);
        bench.pass(Duration::from_secs(6));
        assert_eq!(bench.engine.state(), State::Running);
        assert!(Instant::ZERO < bench.now);
    }
}

/// What an emulated TiM5xx answers to a request without values.
fn answer(dialect: Dialect, request: &str) -> Vec<u8> {
    let mut device = Device::new(Family::Tim5xx, dialect);
    device.handle_rx(Instant::ZERO, &Writer::<80>::new(dialect, request).frame());
    let (mut answer, mut bytes) = (Vec::new(), [0; 64]);
    for at in 0..100 {
        let count = device.poll_tx(Instant::ZERO + ms(at), &mut bytes);
        answer.extend(&bytes[..count]);
    }
    answer
}

/// The forms are those of `sRA SerialNumber 8 16160456`, which a TiM561 answered (log in `SICKAG/sick_scan`, issue 4),
/// and of the values of the scan configuration in `sMN mLMPsetscancfg 00001388 0001 00000271 FFF8C088 0022B6B8`
/// (log in `SICKAG/sick_scan_xd`, issue 449): frequency, sectors, resolution, first and last direction.
#[test]
fn an_emulated_device_answers_with_its_serial_number_and_its_scan_configuration() {
    assert_eq!(answer(Dialect::Text, "sRN SerialNumber"), b"\x02sRA SerialNumber 8 18520122\x03");
    assert_eq!(answer(Dialect::Text, "sRN LMPscancfg"), b"\x02sRA LMPscancfg 5DC 1 2710 FFF92230 225510\x03");
    let serial = "02020202 0000001b 7352412053657269616c4e756d626572 20 0008 3138353230313232";
    let config = "02020202 00000021 735241204c4d507363616e636667 20 000005dc 0001 00002710 fff92230 00225510";
    for (request, telegram) in [("sRN SerialNumber", serial), ("sRN LMPscancfg", config)] {
        let mut telegram = hex(telegram);
        telegram.push(telegram[8..].iter().fold(0, |sum, byte| sum ^ byte));
        assert_eq!(answer(Dialect::Binary, request), telegram, "{request}");
    }
}
