//! Inertial measurement units of the whole robot: a courier with one of each kind, on a line of its own, on an I2C bus
//! and on the CAN bus of its drives.

use super::bases::Base;
use base::{Duration, Instant};
use messages::Message;
use messages::lowlevel::DataImu;
use messages::middlelevel::DataEstimate;
use messages::simulation::{CmdFault, DataTruth};
use module::admission::{Process, Sender, Way};
use navitools::wrap;
use sim::host::News;
use std::cell::RefCell;
use std::rc::Rc;

const UNITS: [&str; 7] = [
    "i2c.main.bus=unix:i2c-main",
    "imu.chip.model=bno055",
    "imu.chip.bus=i2c.main",
    "imu.serial.model=witmotion",
    "imu.serial.port=imu-serial",
    "imu.can.model=xsens-mti",
    "imu.can.bus=can.main",
];
const NAMES: [&str; 3] = ["can", "chip", "serial"];

#[derive(Default)]
struct Observed {
    /// Modules, and what they reported.
    reports: Vec<(Instant, String)>,
    units: Vec<DataImu>,
    truths: Vec<DataTruth>,
    estimate: DataEstimate,
}

struct Rig {
    base: Base,
    observed: Rc<RefCell<Observed>>,
}

impl Rig {
    /// A courier that has stood long enough for the zeros to be known; `sets` as well.
    fn new(sets: &[&str]) -> Self {
        let mut base = Base::with("courier", 2, sets);
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        base.machine.observe(move |now, news| {
            let mut keep = keep.borrow_mut();
            match news {
                News::Report { module, report } => {
                    let told = format!("{module} {:?} {} {}", report.severity, report.fault.name(), report.subject);
                    keep.reports.push((now, told));
                }
                News::Message { message: Message::LlDataImu(imu), .. } => keep.units.push(imu.clone()),
                News::Message { message: Message::SimDataTruth(truth), .. } => keep.truths.push(truth.clone()),
                News::Message { message: Message::MlDataEstimate(estimate), .. } => keep.estimate = estimate.clone(),
                _ => {}
            }
        });
        base.pass(3.0);
        Self { base, observed }
    }

    fn units(&self, name: &str) -> Vec<DataImu> {
        self.observed.borrow().units.iter().filter(|imu| imu.name == name).cloned().collect()
    }

    fn last(&self, name: &str) -> DataImu {
        self.units(name).pop().unwrap_or_else(|| panic!("nothing of {name}"))
    }

    /// Time from `since` to the first report that contains `what`.
    fn told(&self, since: Instant, what: &str) -> Option<Duration> {
        let observed = self.observed.borrow();
        let told = observed.reports.iter().find(|(at, told)| *at >= since && told.contains(what));
        told.map(|(at, _)| at.since(since))
    }

    fn fault(&mut self, target: &str, fault: &str, value: f64, duration: f64) -> Instant {
        let now = self.base.machine.now();
        let fault = CmdFault { target: target.into(), fault: fault.into(), value, duration, ..CmdFault::default() };
        self.base.machine.inject(now, fault);
        now
    }

    fn clear(&mut self) {
        let mut observed = self.observed.borrow_mut();
        (observed.units, observed.truths) = (Vec::new(), Vec::new());
    }
}

#[test]
fn what_is_published_is_how_the_body_moves_within_noise() {
    let mut rig = Rig::new(&UNITS);
    for name in NAMES {
        assert_eq!(rig.last(name).status, DataImu::OK, "{name}");
    }
    rig.base.drive((0.2, 0.0, 0.5), 8.0);
    rig.base.pass(3.0);
    rig.clear();
    rig.base.pass(4.0);
    let (first, last) = {
        let truths = &rig.observed.borrow().truths;
        (truths[0].clone(), truths.last().unwrap().clone())
    };
    let seconds = (last.timestamp - first.timestamp) as f64 * 1e-6;
    let turned = wrap(last.theta - first.theta) / seconds;
    assert!((0.4..0.6).contains(&turned), "{turned} rad/s");
    for name in NAMES {
        let units = rig.units(name);
        let within: Vec<&DataImu> =
            units.iter().filter(|imu| (first.timestamp..last.timestamp).contains(&imu.timestamp)).collect();
        let rate = within.len() as f64 / seconds;
        assert!((95.0..101.0).contains(&rate), "{name}: {rate} Hz");
        assert!(within.iter().all(|imu| imu.status == DataImu::OK && imu.oriented), "{name}");
        let mean = |of: &dyn Fn(&DataImu) -> f64| within.iter().map(|imu| of(imu)).sum::<f64>() / within.len() as f64;
        // The zero is learned to the mean of a second; the noise of a measurement is 0.003 rad/s and a digit.
        for (axis, truth) in [(0, 0.0), (1, 0.0), (2, turned)] {
            let measured = mean(&|imu| imu.rotation[axis]);
            assert!((measured - truth).abs() < 0.004, "{name}, axis {axis}: {measured} rad/s, in truth {truth}");
        }
        assert!(within.iter().all(|imu| (imu.rotation[2] - turned).abs() < 0.05), "{name}");
        // In a curve at a constant speed it is accelerated to its middle, to the left.
        for (axis, truth) in [(0, 0.0), (1, last.speed * turned), (2, 9.81)] {
            let measured = mean(&|imu| imu.acceleration[axis]);
            assert!((measured - truth).abs() < 0.02, "{name}, axis {axis}: {measured} m/s², in truth {truth}");
        }
        let yaw = |imu: &DataImu| 2.0 * imu.orientation[2].atan2(imu.orientation[3]);
        // Its frames are nothing to the drives.
        let by_canbus = |(_, told): &&(Instant, String)| told.starts_with("driver_canbus");
        let reports = rig.observed.borrow().reports.clone();
        assert_eq!(reports.iter().find(by_canbus), None);
        let around = wrap(yaw(within.last().unwrap()) - yaw(within[0])) / seconds;
        assert!((around - turned).abs() < 0.02, "{name}: {around} rad/s");
    }
}

#[test]
fn a_unit_that_is_lost_is_reported_within_a_second_and_recovers_within_two() {
    let mut rig = Rig::new(&UNITS);
    for name in NAMES {
        let target = format!("imu.{name}");
        let cut = rig.fault(&target, "silent", 0.0, 2.0);
        rig.base.pass(5.0);
        let lost = rig.told(cut, &format!("driver_imu Error ImuLost {target}"));
        assert!(lost.is_some_and(|lost| lost <= Duration::from_secs(1)), "{name}: {lost:?}");
        let back = rig.told(cut, &format!("driver_imu Notice ImuLost {target}"));
        let within = Duration::from_secs(2)..=Duration::from_secs(4);
        assert!(back.is_some_and(|back| within.contains(&back)), "{name}: {back:?}");
        assert_eq!(rig.last(name).status, DataImu::OK, "{name}");
    }
    let faults = [
        ("imu.serial", "garbled", 0.02, "ImuDisturbed"),
        ("imu.can", "stuck", 0.0, "ImuFrozen"),
        ("imu.chip", "wrong", 0.0, "ImuImplausible"),
        ("imu.chip", "reboot", 0.0, "ImuLost"),
    ];
    for (target, fault, value, reported) in faults {
        let since = rig.fault(target, fault, value, 1.5);
        rig.base.pass(4.0);
        let told = rig.told(since, &format!("{reported} {target}"));
        assert!(told.is_some_and(|told| told <= Duration::from_secs(1)), "{target} {fault}: {told:?}");
        let again = rig.told(since, &format!("Notice {reported} {target}"));
        assert!(again.is_some_and(|again| again <= Duration::from_millis(3500)), "{target} {fault}: {again:?}");
    }
}

#[test]
fn a_zero_that_is_too_far_off_is_found_while_the_robot_stands() {
    let mut rig = Rig::new(&UNITS);
    let since = rig.fault("imu.serial", "biased", 0.2, 4.0);
    rig.base.pass(3.0);
    let told = rig.told(since, "ImuImplausible imu.serial");
    assert!(told.is_some_and(|told| told <= Duration::from_secs(3)), "{told:?}");
    assert_eq!(rig.last("serial").status, DataImu::IMPLAUSIBLE);
    rig.base.pass(4.0);
    assert_eq!(rig.last("serial").status, DataImu::OK);
}

const ONE: [&str; 2] = ["imu.base.model=witmotion", "imu.base.port=imu-base"];

#[test]
fn only_its_driver_is_believed() {
    // Rotation of the estimate, while somebody says for two seconds that the robot that stands turns at 2 rad/s.
    let turned = |pid: fn(&Rig) -> u32| {
        let mut rig = Rig::new(&ONE);
        // The beacons have been seen by then.
        rig.base.pass(6.0);
        let process = Some(Process { pid: pid(&rig), uid: 0 });
        let (begin, before) = (rig.base.machine.now(), rig.observed.borrow().estimate.theta);
        // Each a millisecond newer than one of the driver.
        let clock = rig.last("base").timestamp + 1000;
        for n in 0..200 {
            let at = n * Duration::from_millis(10);
            let timestamp = clock + (at.as_nanos() / 1000) as i64;
            let imu = DataImu { timestamp, name: "base".into(), rotation: [0.0, 0.0, 2.0], ..DataImu::default() };
            rig.base.machine.inject_by(begin + at, Sender { way: Way::Memory, process }, imu);
        }
        rig.base.pass(2.0);
        wrap(rig.observed.borrow().estimate.theta - before).abs()
    };
    let of_nobody = turned(|_| 0);
    let of_its_driver = turned(|rig| rig.base.machine.pid("driver_imu").unwrap());
    assert!(of_nobody < 0.02, "{of_nobody} rad");
    assert!(of_its_driver > 0.3, "{of_its_driver} rad");
}

#[test]
fn a_wheel_that_counts_wrongly_turns_the_estimate_only_where_there_is_no_unit() {
    let off = |sets: &[&str]| {
        let mut rig = Rig::new(sets);
        rig.base.pass(4.0);
        // No bearing corrects it.
        rig.fault("sbs1", "silent", 0.0, 30.0);
        let begin = rig.fault("left", "encoder", 1.5, 30.0);
        rig.base.drive((0.3, 0.0, 0.0), 6.0);
        rig.base.pass(6.0);
        let observed = rig.observed.borrow();
        let (truth, estimate) = (observed.truths.last().unwrap(), &observed.estimate);
        (wrap(estimate.theta - truth.theta).abs(), rig.told(begin, "estimator Warning RotationDisagrees rotation"))
    };
    let (by_wheels, none) = off(&[]);
    let (by_unit, told) = off(&ONE);
    assert!(by_wheels > 0.5 && none.is_none(), "{by_wheels} rad, {none:?}");
    assert!(by_unit < 0.1, "{by_unit} rad");
    assert!(told.is_some_and(|told| told < Duration::from_secs(3)), "{told:?}");
}
