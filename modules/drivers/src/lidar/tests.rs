//! The driver with emulated lidars on its lines.

use super::*;
use lidar::emulated::Device as Emulated;
use lidar::ld::NoEcho;
use lidar::sick::{Dialect, Family};
use lidar::{hokuyo, ld, rplidar, sick};
use messages::Message;
use module::bench::Bench;
use module::{Action, Output, Shell, ShellConfig};

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
        dialect: Dialect::Binary,
    };
    Device { name: name.into(), bus: format!("lidar.{name}"), baud: Some(model.usual_baud()), keys }
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
    for n in 0..4 {
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
