//! The driver with emulated devices on its lines.

use super::*;
use imu::emulated::{Emulated, Truth};
use module::bench::Bench;
use module::{Action, Output, Shell, ShellConfig};
use std::f64::consts::PI;

fn device(name: &str, model: Model) -> Device {
    let (bus, line) = match model {
        Model::Bno055 => ("i2c.main".into(), Line::I2c { hz: 100_000 }),
        Model::WitMotion => (format!("imu.{name}"), Line::Serial { baud: 115_200 }),
        Model::Xsens => ("can.main".into(), Line::Can { bitrate: 500_000 }),
    };
    let keys = ImuKeys { model, address: imu::bno055::ADDRESS, roll: 0.0, pitch: 0.0, yaw: 0.0 };
    Device { name: name.into(), bus, line, keys }
}

/// One of each, and a second chip on the I2C bus.
fn devices() -> Vec<Device> {
    let mut second = device("second", Model::Bno055);
    second.keys.address += 1;
    vec![device("chip", Model::Bno055), second, device("serial", Model::WitMotion), device("can", Model::Xsens)]
}

struct Rig {
    bench: Bench,
    emulated: Vec<(Device, Emulated)>,
    /// In the robot frame.
    truth: Truth,
    velocity: Option<DataVelocity>,
    log: Vec<(Instant, Action)>,
    random: u64,
}

impl Rig {
    fn new(devices: Vec<Device>) -> Self {
        let emulate = |device: Device| (device.clone(), Emulated::new(device.model().unwrap()));
        let emulated = devices.iter().cloned().map(emulate).collect();
        let module = Imus::new(Config { devices });
        let bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(module)));
        let velocity = Some(DataVelocity::default());
        let mut rig =
            Self { bench, emulated, truth: Truth::default(), velocity, log: Vec::new(), random: 0x9E37_79B9_7F4A_7C15 };
        rig.bench.start();
        rig
    }

    fn noise(&mut self, most: f64) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        most * ((self.random >> 16) % 2001) as f64 / 1000.0 - most
    }

    /// Lets time pass in steps of 1 ms.
    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.bench.pass(Duration::from_millis(1));
            let now = self.bench.now();
            if let Some(velocity) = self.velocity.clone().filter(|_| now.as_nanos().is_multiple_of(50_000_000)) {
                self.bench.message(velocity);
            }
            for n in 0..self.emulated.len() {
                self.let_measure(now, n);
            }
            self.transfer(now);
        }
    }

    fn let_measure(&mut self, now: Instant, n: usize) {
        let mut noise = [0.0; 6];
        noise.iter_mut().for_each(|noise| *noise = self.noise(0.01));
        let (device, emulated) = &mut self.emulated[n];
        let ImuKeys { roll, pitch, yaw, .. } = device.keys;
        let mount = Rotation::from_angles(roll, pitch, yaw);
        let device_from_robot = mount.inverse();
        let mut acceleration_mps2 = device_from_robot.apply(self.truth.acceleration_mps2);
        let mut rotation_radps = device_from_robot.apply(self.truth.rotation_radps);
        acceleration_mps2.iter_mut().zip(&noise).for_each(|(value, noise)| *value += noise);
        rotation_radps.iter_mut().zip(&noise[3..]).for_each(|(value, noise)| *value += noise);
        let orientation = Rotation::new(self.truth.orientation).unwrap().after(mount).quaternion();
        emulated.set(Truth { acceleration_mps2, rotation_radps, orientation, ..self.truth });
        emulated.handle_timeout(now);
        let port =
            PortId(self.bench.shell.module().ports().iter().position(|port| port.bus == device.bus).unwrap() as u8);
        let mut bytes = [0; 256];
        let count = emulated.poll_tx(&mut bytes);
        let words: Vec<Word> = bytes[..count].iter().copied().map(Word::data).collect();
        if !words.is_empty() {
            self.bench.words(port, &words);
        }
        while let Some(frame) = self.emulated[n].1.poll_frame() {
            self.bench.can(port, frame);
        }
    }

    /// Makes the transfers that were requested, until there are no more.
    fn transfer(&mut self, now: Instant) {
        loop {
            let done = self.bench.done();
            let mut asked = false;
            for (at, action) in done {
                if let Action::Send(port, Output::I2c(transfer)) = &action {
                    let outcomes = self.emulated.iter_mut().map(|(_, device)| device.handle_transfer(now, transfer));
                    // All are asked; the one at the address answers.
                    let outcomes: Vec<_> = outcomes.collect();
                    let outcome = outcomes.into_iter().find(Result::is_ok);
                    self.bench.i2c(*port, &outcome.unwrap_or(Err(base::i2c::Error::NoAddress)));
                    asked = true;
                }
                self.log.push((at, action));
            }
            if !asked {
                return;
            }
        }
    }

    fn faults(&mut self, name: &str) -> &mut imu::emulated::Faults {
        self.emulated.iter_mut().find(|(device, _)| device.name == name).unwrap().1.faults()
    }

    /// What was published since it was asked last, of a device.
    fn published(&mut self, name: &str) -> Vec<(Instant, DataImu)> {
        let message = |(at, action): &(Instant, Action)| match action {
            Action::Publish(Message::LlDataImu(message)) if message.name == name => Some((*at, message.clone())),
            _ => None,
        };
        self.log.iter().filter_map(message).collect()
    }

    fn last(&mut self, name: &str) -> DataImu {
        self.published(name).pop().unwrap_or_else(|| panic!("nothing of {name}")).1
    }

    /// Reports of a fault since the log was cleared: raised, or cleared.
    fn reports(&self, fault: Fault) -> Vec<(Instant, String, bool)> {
        let report = |(at, action): &(Instant, Action)| match action {
            Action::Report(report) if report.fault == fault => {
                Some((*at, report.subject.clone(), report.severity != Severity::Notice))
            }
            _ => None,
        };
        self.log.iter().filter_map(report).collect()
    }
}

fn near(a: [f64; 3], b: [f64; 3], most: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most)
}

#[test]
fn every_protocol_is_published_at_its_rate_with_its_instant() {
    let mut rig = Rig::new(devices());
    rig.run(3000);
    rig.log.clear();
    rig.velocity = None;
    rig.truth.rotation_radps = [0.1, -0.2, 0.5];
    rig.truth.acceleration_mps2 = [0.4, -0.3, 9.81];
    rig.run(1000);
    for name in ["chip", "second", "serial", "can"] {
        let published = rig.published(name);
        assert!((95..=101).contains(&published.len()), "{name}: {}", published.len());
        let mut before = i64::MIN;
        for (at, message) in &published[2..] {
            assert_eq!((message.status, message.oriented), (DataImu::OK, true), "{name}");
            assert!(near(message.rotation, [0.1, -0.2, 0.5], 0.02), "{name}: {message:?}");
            assert!(near(message.acceleration, [0.4, -0.3, 9.81], 0.02), "{name}: {message:?}");
            assert!((message.temperature - 25.0).abs() < 0.1, "{name}: {message:?}");
            let age_us = (at.as_nanos() / 1000) as i64 - message.timestamp;
            assert!(message.timestamp > before && (0..12_000).contains(&age_us), "{name}: {age_us} µs");
            before = message.timestamp;
        }
    }
    assert!(rig.reports(Fault::ImuLost).is_empty());
}

#[test]
fn values_are_in_the_robot_frame_however_a_device_is_mounted() {
    for (roll, pitch, yaw) in [(0.0, 0.0, PI / 2.0), (PI, 0.0, 0.0), (0.3, -0.4, 2.0), (0.0, PI / 2.0, 0.0)] {
        let mut tilted = device("serial", Model::WitMotion);
        (tilted.keys.roll, tilted.keys.pitch, tilted.keys.yaw) = (roll, pitch, yaw);
        let mut rig = Rig::new(vec![tilted]);
        rig.run(3000);
        let heading = Rotation::from_angles(0.0, 0.0, 1.0).quaternion();
        rig.velocity = None;
        rig.truth = Truth {
            rotation_radps: [0.1, -0.2, 0.5],
            acceleration_mps2: [0.4, -0.3, 9.81],
            orientation: heading,
            ..rig.truth
        };
        rig.run(100);
        let message = rig.last("serial");
        assert!(near(message.rotation, [0.1, -0.2, 0.5], 0.02), "{message:?}");
        assert!(near(message.acceleration, [0.4, -0.3, 9.81], 0.02), "{message:?}");
        let product: f64 = message.orientation.iter().zip(heading).map(|(a, b)| a * b).sum();
        assert!(message.oriented && product.abs() > 1.0 - 1e-6, "{message:?}");
    }
}

#[test]
fn the_zero_is_learned_at_standstill_and_only_there() {
    let mut rig = Rig::new(vec![device("can", Model::Xsens)]);
    // It moves as far as the driver knows, so what it measures is motion.
    rig.velocity = Some(DataVelocity { omega: 0.03, ..DataVelocity::default() });
    rig.truth.rotation_radps[2] = 0.03;
    rig.run(3000);
    let message = rig.last("can");
    assert_eq!(message.status, DataImu::UNCALIBRATED);
    assert!((message.rotation[2] - 0.03).abs() < 0.012, "{message:?}");
    // The same while it stands is the zero.
    for unknown in [None, Some(DataVelocity { omega: f64::NAN, ..DataVelocity::default() })] {
        rig.velocity = unknown;
        rig.run(3000);
        assert_eq!(rig.last("can").status, DataImu::UNCALIBRATED, "unknown is not standing");
    }
    rig.velocity = Some(DataVelocity::default());
    rig.run(1700);
    let message = rig.last("can");
    assert!(message.status == DataImu::OK && message.rotation[2].abs() < 0.014, "{message:?}");
    assert!(rig.reports(Fault::ImuImplausible).is_empty());
}

#[test]
fn one_that_turns_while_the_robot_stands_is_implausible_until_it_does_not() {
    let mut rig = Rig::new(vec![device("serial", Model::WitMotion)]);
    rig.run(3000);
    rig.truth.rotation_radps[2] = 0.2;
    rig.log.clear();
    rig.run(3000);
    assert_eq!(rig.last("serial").status, DataImu::IMPLAUSIBLE);
    let raised = rig.reports(Fault::ImuImplausible);
    assert!(raised.len() == 1 && raised[0].1 == "imu.serial" && raised[0].2, "{raised:?}");
    rig.truth.rotation_radps[2] = 0.0;
    rig.run(3000);
    assert_eq!(rig.last("serial").status, DataImu::OK);
    assert!(!rig.reports(Fault::ImuImplausible)[1].2);
}

#[test]
fn one_that_is_cut_off_is_reported_within_a_second_and_measures_again_within_two() {
    let mut rig = Rig::new(devices());
    rig.run(3000);
    for name in ["chip", "second", "serial", "can"] {
        rig.log.clear();
        let cut = rig.bench.now();
        rig.faults(name).cut = true;
        rig.run(3000);
        let subject = format!("imu.{name}");
        let lost = rig.reports(Fault::ImuLost);
        let within = |reports: &[(Instant, String, bool)], raised, from: Instant, ms| {
            reports.len() == 1
                && reports.iter().all(|(at, about, is)| {
                    (about, *is) == (&subject, raised) && at.since(from) <= Duration::from_millis(ms)
                })
        };
        assert!(within(&lost, true, cut, 1000), "{name}: {lost:?}");
        assert!(rig.published(name).iter().all(|(at, _)| at.since(cut) < Duration::from_millis(50)), "{name}");
        rig.log.clear();
        let whole = rig.bench.now();
        rig.faults(name).cut = false;
        rig.run(2000);
        let back = rig.reports(Fault::ImuLost);
        assert!(within(&back, false, whole, 2000), "{name}: {back:?}");
        assert!(rig.published(name).len() > 50, "{name}");
    }
}

#[test]
fn an_error_is_reported_with_its_code_and_what_it_means() {
    let mut rig = Rig::new(devices());
    rig.run(3000);
    rig.log.clear();
    rig.faults("can").error = true;
    rig.faults("chip").error = true;
    rig.run(500);
    let text = |fault| {
        let report = |(_, action): &(Instant, Action)| match action {
            Action::Report(report) if report.fault == fault => Some(report.message.clone()),
            _ => None,
        };
        rig.log.iter().find_map(report).unwrap_or_default()
    };
    let error = "imu can: it reports an error, code 1, overflow of its output buffer; nothing goes by it";
    assert_eq!(text(Fault::ImuError), error);
    let lost = "imu chip reports an error, code 3, self-test failed, and does not measure: nothing goes by it";
    assert_eq!(text(Fault::ImuLost), lost);
}

#[test]
fn what_is_wrong_with_a_device_is_a_fault_of_its_name_and_its_status() {
    let mut rig = Rig::new(devices());
    rig.run(3000);
    rig.log.clear();
    rig.faults("serial").noise_ppm = 20_000;
    rig.faults("can").frozen = true;
    rig.faults("chip").uncalibrated = true;
    rig.faults("second").acceleration_excess = -0.9;
    rig.run(1000);
    let expected = [
        (Fault::ImuDisturbed, "serial", DataImu::FAULT),
        (Fault::ImuFrozen, "can", DataImu::IMPLAUSIBLE),
        (Fault::ImuUncalibrated, "chip", DataImu::UNCALIBRATED),
        (Fault::ImuImplausible, "second", DataImu::IMPLAUSIBLE),
    ];
    for (fault, name, status) in expected {
        let reports = rig.reports(fault);
        assert!(reports.len() == 1 && reports[0].1 == format!("imu.{name}"), "{name}: {reports:?}");
        assert_eq!(rig.last(name).status, status, "{name}");
    }
    rig.emulated.iter_mut().for_each(|(_, emulated)| *emulated.faults() = Default::default());
    rig.run(2000);
    for (fault, name, _) in expected {
        assert!(rig.reports(fault).last().is_some_and(|(_, _, raised)| !raised), "{name}");
        assert_eq!(rig.last(name).status, DataImu::OK, "{name}");
    }
}

#[test]
fn a_bus_that_is_down_loses_all_its_devices_and_no_other() {
    let mut rig = Rig::new(devices());
    rig.run(3000);
    rig.log.clear();
    rig.bench.event(Event::Port { port: PortId(0), input: Input::Down("no such device") });
    rig.transfer(rig.bench.now());
    let lost: Vec<String> = rig.reports(Fault::ImuLost).into_iter().map(|(_, subject, _)| subject).collect();
    assert_eq!(lost, ["imu.chip", "imu.second"]);
    rig.run(500);
    assert!(rig.published("chip").is_empty() && rig.published("can").len() > 40);
    rig.bench.event(Event::Port { port: PortId(0), input: Input::Up });
    rig.run(2000);
    assert!(rig.published("chip").len() > 100 && rig.published("second").len() > 100);
}

#[test]
fn in_stop_nothing_is_published() {
    let mut rig = Rig::new(vec![device("can", Model::Xsens)]);
    rig.run(2000);
    let state = |state: State| messages::common::CmdState {
        module: NAME.into(),
        state: state as i8,
        manual: true,
        ..Default::default()
    };
    rig.bench.message(state(State::Stop));
    rig.run(100);
    rig.log.clear();
    rig.run(1000);
    assert!(rig.published("can").is_empty());
    rig.bench.message(state(State::Run));
    rig.run(1000);
    assert!(rig.published("can").len() > 90);
}
