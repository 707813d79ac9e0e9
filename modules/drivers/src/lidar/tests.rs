//! The driver with emulated lidars on its lines.

use super::*;
use lidar::emulated::Device as Emulated;
use lidar::ld::NoEcho;
use lidar::sick::{Dialect, Family};
use lidar::{hokuyo, ld, rplidar, sick, ydlidar};
use messages::Message;
use messages::lowlevel::EventStop;
use module::bench::Bench;
use module::{Action, Output, Shell, ShellConfig};
use settings::Section;

fn device(name: &str, model: Model) -> Device {
    let keys = LidarKeys {
        model,
        x: 0.3,
        y: -0.1,
        theta: 0.5,
        upside_down: false,
        view: None,
        range_max: Some(6.0),
        no_echo: NoEcho::Unknown,
        mode: None,
        dialect: Dialect::Binary,
    };
    let (bus, baud) = (format!("lidar.{name}"), Some(model.usual_baud()));
    Device { name: name.into(), bus, baud, keys, stop: StopKeys::usual() }
}

/// One of each protocol.
fn devices() -> Vec<(Device, Box<dyn Emulated>)> {
    let tcp = |device: Device| Device { baud: None, ..device };
    vec![
        (device("ld", Model::Ld(ld::Model::Ld19)), Box::new(ld::emulated::Device::new(ld::Model::Ld19))),
        (
            device("rplidar", Model::Rplidar(rplidar::Model::C1)),
            Box::new(rplidar::emulated::Device::new(rplidar::Model::C1)),
        ),
        (
            tcp(device("sick", Model::Sick(Family::Tim5xx))),
            Box::new(sick::emulated::Device::new(Family::Tim5xx, Dialect::Binary)),
        ),
        (
            tcp(device("hokuyo", Model::Hokuyo("UTM-30LX"))),
            Box::new(hokuyo::emulated::Device::new(hokuyo::emulated::Model::UTM_30LX)),
        ),
        (
            device("ydlidar", Model::Ydlidar(ydlidar::Model::G4)),
            Box::new(ydlidar::emulated::Device::new(ydlidar::Model::G4)),
        ),
    ]
}

struct Rig {
    bench: Bench,
    emulated: Vec<Box<dyn Emulated>>,
    log: Vec<(Instant, Action)>,
}

impl Rig {
    fn new(devices: Vec<(Device, Box<dyn Emulated>)>) -> Self {
        let (devices, emulated) = devices.into_iter().unzip();
        let module = Lidars::new(Config { devices });
        let bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(module)));
        let mut rig = Self { bench, emulated, log: Vec::new() };
        rig.bench.start();
        rig
    }

    /// Lets time pass in steps of 1 ms.
    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.bench.pass(Duration::from_millis(1));
            let now = self.bench.now();
            for (n, emulated) in self.emulated.iter_mut().enumerate() {
                emulated.handle_timeout(now);
                let mut bytes = [0; 1024];
                let count = emulated.poll_tx(now, &mut bytes);
                let words: Vec<Word> = bytes[..count].iter().copied().map(Word::data).collect();
                if !words.is_empty() {
                    self.bench.words(PortId(n as u8), &words);
                }
            }
            for (at, action) in self.bench.done() {
                if let Action::Send(port, Output::Words(words)) = &action {
                    let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                    self.emulated[usize::from(port.0)].handle_rx(at, &bytes);
                }
                self.log.push((at, action));
            }
        }
    }

    /// What was published since it was asked last.
    fn scans(&mut self) -> Vec<(Instant, DataScan)> {
        let log = std::mem::take(&mut self.log);
        let scan = |(at, action)| match action {
            Action::Publish(Message::LlDataScan(scan)) => Some((at, scan)),
            _ => None,
        };
        log.into_iter().filter_map(scan).collect()
    }

    /// Reports of a fault since the log was taken last: raised, or cleared.
    fn reports(&self, fault: Fault) -> Vec<(Instant, bool)> {
        let report = |(at, action): &(Instant, Action)| match action {
            Action::Report(report) if report.fault == fault => Some((*at, report.severity != Severity::Notice)),
            _ => None,
        };
        self.log.iter().filter_map(report).collect()
    }
}

#[test]
fn every_protocol_is_published_in_sectors_with_their_place_and_instant() {
    let mut rig = Rig::new(devices());
    // Their motors have their speed then.
    rig.run(3000);
    assert!(rig.reports(Fault::LidarSpeed).is_empty(), "it spins up");
    rig.scans();
    rig.run(3000);
    let scans = rig.scans();
    for (device, _) in devices() {
        let own: Vec<_> = scans.iter().filter(|(_, scan)| scan.name == device.name).collect();
        assert!(own.len() > 40, "{}: {} sectors", device.name, own.len());
        let mut before = (0, i64::MIN);
        for (at, scan) in &own {
            assert_eq!((scan.x, scan.y, scan.theta, scan.status), (0.3, -0.1, 0.5, DataScan::OK), "{}", device.name);
            assert!(scan.range_max <= 6.0 && scan.range_min > 0.0, "{scan:?}");
            let span = scan.angle_step.abs() * (scan.ranges.len() - 1) as f64;
            assert!(span <= lidar::EIGHTH_RAD + 1e-9 && !scan.ranges.is_empty(), "{}: {span}", device.name);
            assert!((scan.revolution, scan.timestamp) > before, "{}", device.name);
            before = (scan.revolution, scan.timestamp);
            // The round wall of the emulated surroundings, and at most three tenths of a second ago.
            let measured = scan.ranges.iter().filter(|range| range.is_finite());
            assert!(measured.clone().all(|range| (range - 3.0).abs() < 0.05), "{}: {:?}", device.name, scan.ranges);
            let age_us = (at.as_nanos() / 1000) as i64 - scan.timestamp;
            assert!((0..300_000).contains(&age_us), "{}: {age_us} µs old", device.name);
        }
        let beams: usize = own.iter().map(|(_, scan)| scan.ranges.len()).sum();
        let measured = own.iter().flat_map(|(_, scan)| &scan.ranges).filter(|range| range.is_finite()).count();
        assert!(measured * 10 > beams * 7, "{}: {measured} of {beams}", device.name);
    }
}

#[test]
fn an_rplidar_is_asked_for_the_mode_that_is_configured() {
    let beams = |mode| {
        let mut device = device("rplidar", Model::Rplidar(rplidar::Model::A1));
        device.keys.mode = mode;
        let emulated: Box<dyn Emulated> = Box::new(rplidar::emulated::Device::new(rplidar::Model::A1));
        let mut rig = Rig::new(vec![(device, emulated)]);
        rig.run(4000);
        rig.scans();
        rig.run(1000);
        rig.scans().iter().map(|(_, scan)| scan.ranges.len()).sum::<usize>()
    };
    let [usual, express, standard] = [None, Some(rplidar::Mode::Express), Some(rplidar::Mode::Standard)].map(beams);
    assert_eq!(usual, express);
    // 508 µs for a sample in place of 254 µs.
    assert!(standard > 1000 && standard * 3 < express * 2, "{standard} and {express} beams/s");
}

#[test]
fn one_that_hangs_upside_down_sees_the_other_way_round() {
    let mut rig = Rig::new(devices().into_iter().take(1).collect());
    // Something at 1 m, a quarter of a turn to the left of the front.
    let left = |emulated: &mut Box<dyn Emulated>| {
        let quarter = lidar::emulated::DIRECTIONS / 4;
        emulated.scene().0[quarter - 20..quarter + 20].fill(1.0);
    };
    let near = |rig: &mut Rig| {
        rig.run(2000);
        let scans = rig.scans();
        let (mut sum, mut count) = (0.0, 0.0);
        for (_, scan) in &scans {
            for (n, range) in scan.ranges.iter().enumerate() {
                if *range < 2.0 {
                    sum += navitools::wrap(scan.angle_min + n as f64 * scan.angle_step);
                    count += 1.0;
                }
            }
        }
        sum / count
    };
    rig.emulated.iter_mut().for_each(left);
    let upright = near(&mut rig);
    let (mut upside, emulated) = devices().remove(0);
    upside.keys.upside_down = true;
    let mut rig = Rig::new(vec![(upside, emulated)]);
    rig.emulated.iter_mut().for_each(left);
    let turned = near(&mut rig);
    let quarter = std::f64::consts::FRAC_PI_2;
    assert!((upright - quarter).abs() < 0.05 && (turned + quarter).abs() < 0.05, "{upright} {turned}");
}

#[test]
fn a_lidar_that_is_cut_off_is_reported_within_a_second_and_measures_again_by_itself() {
    for n in 0..devices().len() {
        let mut all = devices();
        let (device, emulated) = all.remove(n);
        let name = device.name.clone();
        let mut rig = Rig::new(vec![(device, emulated)]);
        rig.run(4000);
        rig.scans();
        let cut = rig.bench.now();
        rig.emulated[0].faults().cut = true;
        rig.run(10_000);
        let lost = rig.reports(Fault::LidarLost);
        let within = |times: &[(Instant, bool)], raised, from: Instant, ms| {
            times.first().is_some_and(|(at, is)| *is == raised && at.since(from) <= Duration::from_millis(ms))
        };
        assert!(within(&lost, true, cut, 1000), "{name}: {lost:?}");
        assert!(rig.scans().iter().all(|(at, _)| at.since(cut) < Duration::from_millis(500)), "{name}");
        let whole = rig.bench.now();
        rig.emulated[0].faults().cut = false;
        rig.run(4000);
        let back = rig.reports(Fault::LidarLost);
        assert!(within(&back, false, whole, 2000), "{name}: {back:?}");
        assert!(rig.scans().len() > 10, "{name}");
    }
}

#[test]
fn what_a_lidar_says_of_itself_is_a_fault_of_its_name() {
    let mut rig = Rig::new(devices());
    rig.run(4000);
    rig.scans();
    // Only the SICK knows its optics.
    rig.emulated[2].faults().blocked = true;
    rig.emulated[0].faults().motor_slow = true;
    rig.run(1500);
    assert_eq!(rig.reports(Fault::LidarBlocked).len(), 1);
    assert_eq!(rig.reports(Fault::LidarSpeed).len(), 1);
    let scans = rig.scans();
    let last = |name: &str| scans.iter().rev().find(|(_, scan)| scan.name == name).map(|(_, scan)| scan.status);
    assert_eq!((last("sick"), last("ld")), (Some(DataScan::BLOCKED), Some(DataScan::SLOW)));
    rig.emulated[2].faults().blocked = false;
    rig.run(1500);
    assert!(rig.reports(Fault::LidarBlocked).iter().any(|(_, raised)| !raised));
}

/// Texts of the reports of a fault since the log was taken last, with their severity.
fn texts(rig: &Rig, fault: Fault) -> Vec<(Severity, &str)> {
    let reports = rig.log.iter().filter_map(|(_, action)| match action {
        Action::Report(report) if report.fault == fault => Some(report),
        _ => None,
    });
    reports.map(|report| (report.severity, report.message.as_str())).collect()
}

#[test]
fn an_error_is_reported_with_its_code_and_what_it_means() {
    let mut rig = Rig::new(devices());
    rig.run(3000);
    rig.log.clear();
    rig.emulated.iter_mut().for_each(|emulated| emulated.faults().error = true);
    rig.run(1500);
    let mut told = texts(&rig, Fault::LidarError);
    told.sort_unstable();
    let expected = [
        "lidar hokuyo reports an error: code 12592, status 10",
        "lidar rplidar reports an error: code 32770, it protects itself from damage",
        "lidar sick reports an error: code 1, device state in its scans: error",
        // Its codes are in no document.
        "lidar ydlidar reports an error: code 2",
    ];
    assert_eq!(told, expected.map(|text| (Severity::Error, text)));
    rig.log.clear();
    rig.emulated.iter_mut().for_each(|emulated| emulated.faults().error = false);
    rig.run(2000);
    let ended = texts(&rig, Fault::LidarError);
    assert!(ended.len() == 4 && ended.iter().all(|(severity, _)| *severity == Severity::Notice), "{ended:?}");
}

#[test]
fn a_lidar_that_warns_is_a_warning_until_it_does_not_and_dirty_optics_are_that_alone() {
    let mut rig = Rig::new(devices());
    rig.emulated.iter_mut().for_each(|emulated| emulated.faults().dirty = true);
    rig.run(3000);
    let expected =
        ["lidar rplidar warns: code 1, it may fail soon; it measures", "lidar ydlidar warns: code 4; it measures"];
    let mut told = texts(&rig, Fault::LidarWarning);
    told.sort_unstable();
    assert_eq!(told, expected.map(|text| (Severity::Warning, text)));
    assert_eq!(texts(&rig, Fault::LidarDirty).len(), 1);
    rig.log.clear();
    // Its health is read at a start.
    rig.emulated.iter_mut().for_each(|emulated| (emulated.faults().dirty, emulated.faults().unpowered) = (false, true));
    rig.run(1000);
    rig.emulated.iter_mut().for_each(|emulated| emulated.faults().unpowered = false);
    rig.run(2000);
    let mut told = texts(&rig, Fault::LidarWarning);
    told.sort_unstable();
    let expected = ["lidar rplidar no longer warns", "lidar ydlidar no longer warns"];
    assert_eq!(told, expected.map(|text| (Severity::Notice, text)));
}

/// An LDROBOT whose range of 0 is to mean that nothing was received.
fn nothing_is_free() -> Rig {
    let (mut device, emulated) = devices().swap_remove(0);
    device.keys.no_echo = NoEcho::Nothing;
    Rig::new(vec![(device, emulated)])
}

#[test]
fn a_lidar_that_receives_nothing_in_any_direction_is_taken_for_covered_and_frees_nothing() {
    let mut rig = nothing_is_free();
    rig.run(4000);
    rig.scans();
    // A wide place: nothing is there in most directions.
    rig.emulated[0].scene().0[60..].fill(f32::INFINITY);
    rig.run(1000);
    assert!(rig.reports(Fault::LidarBlocked).is_empty());
    let scans = rig.scans();
    assert!(scans.iter().all(|(_, scan)| scan.status == DataScan::OK));
    let free = scans.iter().flat_map(|(_, scan)| &scan.ranges).filter(|range| **range == f32::INFINITY).count();
    assert!(free > 1000, "{free}");

    let covered = rig.bench.now();
    rig.emulated[0].faults().blocked = true;
    rig.run(1500);
    let reports = rig.reports(Fault::LidarBlocked);
    assert_eq!(reports.iter().map(|(_, raised)| *raised).collect::<Vec<_>>(), [true]);
    assert!(reports[0].0.since(covered) <= Duration::from_millis(300), "{reports:?}");
    let scans = rig.scans();
    let late: Vec<_> = scans.iter().filter(|(at, _)| at.since(covered) > Duration::from_millis(300)).collect();
    assert!(late.len() > 50 && late.iter().all(|(_, scan)| scan.status == DataScan::BLOCKED), "{}", late.len());

    rig.emulated[0].faults().blocked = false;
    rig.run(1000);
    assert_eq!(rig.reports(Fault::LidarBlocked).last().map(|(_, raised)| *raised), Some(false));
    assert_eq!(rig.scans().last().map(|(_, scan)| scan.status), Some(DataScan::OK));
}

#[test]
fn a_lidar_that_is_covered_from_the_start_on_frees_nothing_and_is_reported() {
    let mut rig = nothing_is_free();
    rig.emulated[0].faults().blocked = true;
    rig.run(6000);
    assert_eq!(rig.reports(Fault::LidarBlocked).len(), 1);
    let scans = rig.scans();
    assert!(scans.len() > 100 && scans.iter().all(|(_, scan)| scan.status != DataScan::OK), "{}", scans.len());
}

#[test]
fn a_lidar_that_is_cut_off_is_lost_and_not_taken_for_covered() {
    let mut rig = nothing_is_free();
    rig.run(4000);
    // At any time of the windows in which the engine counts.
    for n in 0..10 {
        rig.scans();
        rig.emulated[0].faults().cut = true;
        rig.run(700);
        assert!(rig.reports(Fault::LidarLost).iter().any(|(_, raised)| *raised), "{n}");
        assert!(rig.reports(Fault::LidarBlocked).is_empty(), "{n}");
        rig.emulated[0].faults().cut = false;
        rig.run(2050);
    }
}

#[test]
fn a_line_that_is_down_sends_nothing_and_counts_as_lost() {
    let mut rig = Rig::new(devices().into_iter().take(1).collect());
    rig.run(3000);
    rig.scans();
    rig.bench.event(Event::Port { port: PortId(0), input: Input::Down("no such device") });
    rig.run(300);
    assert_eq!(rig.reports(Fault::LidarLost).len(), 1);
    assert!(rig.scans().is_empty());
    rig.bench.event(Event::Port { port: PortId(0), input: Input::Up });
    rig.run(3000);
    assert!(rig.scans().len() > 40);
}

#[test]
fn what_is_outside_of_the_view_that_is_used_is_not_measured() {
    let (mut device, emulated) = devices().swap_remove(0);
    assert_eq!(device.keys.view_rad(), std::f64::consts::TAU);
    device.keys.view = Some(2.0);
    let mut rig = Rig::new(vec![(device, emulated)]);
    rig.run(3000);
    let (mut within, mut outside) = (0, 0);
    for (_, scan) in rig.scans() {
        for (k, range) in scan.ranges.iter().enumerate() {
            let angle = navitools::wrap(scan.angle_min + k as f64 * scan.angle_step);
            match angle.abs() <= 1.0 {
                true => within += u32::from(!range.is_nan()),
                false => outside += u32::from(!range.is_nan()),
            }
        }
    }
    assert!(within > 1000 && outside == 0, "{within} {outside}");
}

/// A SICK whose field 1, a square of 2 m, or its output stops the robot.
fn stopping(family: Family, fields: &[u16], outputs: &[u16]) -> Rig {
    let (stop_fields, stop_outputs) = (fields.to_vec(), outputs.to_vec());
    let stop = StopKeys { stop_fields, stop_outputs, ..StopKeys::usual() };
    let device = Device { baud: None, stop, ..device("front", Model::Sick(family)) };
    let emulated = Box::new(sick::emulated::Device::new(family, Dialect::Binary));
    Rig::new(vec![(device, emulated)])
}

/// What was published of PAUSE since the log was taken last: when, and whether it is engaged.
fn stops(rig: &Rig) -> Vec<(Instant, bool)> {
    let stop = |(at, action): &(Instant, Action)| match action {
        Action::Publish(Message::LlEventStop(EventStop { engaged, source, .. })) => {
            assert_eq!(source, "lidar.front");
            Some((*at, *engaged))
        }
        _ => None,
    };
    rig.log.iter().filter_map(stop).collect()
}

#[test]
fn a_field_that_is_infringed_engages_pause_at_once_and_says_so_ten_times_a_second() {
    let one = &[1][..];
    for (family, fields, outputs) in
        [(Family::Tim7xx, one, &[][..]), (Family::Lms1xx, one, one), (Family::Tim5xx, &[][..], one)]
    {
        let mut rig = stopping(family, fields, outputs);
        rig.run(3000);
        let begin = stops(&rig);
        assert!(begin.len() > 10 && begin.iter().all(|(_, engaged)| !engaged), "{family}: {begin:?}");
        assert!(rig.reports(Fault::LidarNoResult).is_empty());
        rig.log.clear();
        let since = rig.bench.now();
        rig.emulated[0].scene().0[0..20].fill(0.8);
        rig.run(1000);
        let told = stops(&rig);
        let first = told.iter().find(|(_, engaged)| *engaged).expect("engaged").0;
        assert!(first.since(since) <= Duration::from_millis(250), "{family}: after {:?}", first.since(since));
        assert!(told.len() >= 9 && told.iter().rev().take(7).all(|(_, engaged)| *engaged), "{told:?}");
        assert!(told.windows(2).all(|two| two[1].0.since(two[0].0) <= Duration::from_millis(100)), "{told:?}");
        rig.emulated[0].scene().0[0..20].fill(3.0);
        rig.run(500);
        assert!(stops(&rig).last().is_some_and(|(_, engaged)| !engaged), "{family}");
        assert!(rig.reports(Fault::LidarNoResult).is_empty());
    }
}

#[test]
fn without_a_valid_result_pause_is_engaged_within_half_a_second_whatever_is_wrong() {
    type Set = fn(&mut lidar::emulated::Faults);
    let faults: [(&str, Set); 7] = [
        ("cut", |faults| faults.cut = true),
        ("refuses", |faults| faults.refuses = true),
        ("nothing reaches it", |faults| faults.deaf = true),
        ("hangs", |faults| faults.hangs = true),
        ("repeats itself", |faults| faults.repeats = true),
        ("held back", |faults| faults.held_back = true),
        ("blocked", |faults| faults.blocked = true),
    ];
    for (name, set) in faults {
        let mut rig = stopping(Family::Tim7xx, &[1], &[]);
        rig.run(3000);
        assert!(stops(&rig).last().is_some_and(|(_, engaged)| !engaged), "{name}");
        rig.log.clear();
        set(rig.emulated[0].faults());
        rig.run(501);
        assert!(stops(&rig).last().is_some_and(|(_, engaged)| *engaged), "{name}: {:?}", stops(&rig));
        *rig.emulated[0].faults() = lidar::emulated::Faults::default();
        rig.run(4000);
        assert!(stops(&rig).last().is_some_and(|(_, engaged)| !engaged), "{name}: it is well again");
    }
}

#[test]
fn a_field_that_the_device_does_not_have_is_not_free_and_is_reported() {
    let mut rig = stopping(Family::Tim7xx, &[1, 2], &[]);
    rig.run(4000);
    assert!(stops(&rig).is_empty(), "not known yet, and `driver_canbus` takes silence for what it is");
    assert_eq!(rig.reports(Fault::LidarNoResult).len(), 1);
    // Nor is one whose line is down.
    let mut rig = stopping(Family::Tim7xx, &[1], &[]);
    rig.run(3000);
    rig.bench.event(Event::Port { port: PortId(0), input: Input::Down("no such device") });
    rig.log.clear();
    rig.run(10);
    assert!(stops(&rig).last().is_some_and(|(_, engaged)| *engaged));
    // What is infringed from the start on is said, whatever is not known.
    let mut rig = stopping(Family::Tim7xx, &[1, 2], &[]);
    rig.emulated[0].scene().0[0..20].fill(0.8);
    rig.run(4000);
    assert!(stops(&rig).len() > 10 && stops(&rig).iter().all(|(_, engaged)| *engaged));
}

#[test]
fn in_stop_the_fields_are_not_known_and_without_keys_nothing_is_said() {
    let mut rig = stopping(Family::Tim7xx, &[1], &[]);
    rig.run(3000);
    assert!(stops(&rig).last().is_some_and(|(_, engaged)| !engaged));
    rig.bench.message(messages::common::CmdState {
        timestamp: 0,
        module: NAME.into(),
        state: State::Stop as i8,
        manual: true,
        source: "test".into(),
    });
    rig.run(10);
    assert!(stops(&rig).last().is_some_and(|(_, engaged)| *engaged));
    let mut rig = Rig::new(devices());
    rig.run(3000);
    assert!(stops(&rig).is_empty());
}
