//! An engine and its emulated device, in virtual time, and the campaign of faults.

use crate::emulated::{Emulated, Faults, Truth};
use crate::engine::{Imu, Model};
use crate::event::{Event, Fault, Sample, State, Status};
use base::i2c::Address;
use base::{Duration, Instant};
use std::vec::Vec;
use testing::Random;

pub struct Bench {
    pub now: Instant,
    pub engine: Imu,
    pub device: Emulated,
    pub truth: Truth,
    /// All events but samples.
    pub seen: Vec<(Instant, Event)>,
    pub samples: Vec<Sample>,
    random: Random,
}

pub fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

pub fn bno055() -> Model {
    Model::Bno055 { address: Address::new(crate::bno055::ADDRESS).expect("an address of 7 bits") }
}

impl Bench {
    pub fn new(model: Model) -> Self {
        Self {
            now: Instant::from_millis(10_000),
            engine: Imu::new(model),
            device: Emulated::new(model),
            truth: Truth::default(),
            seen: Vec::new(),
            samples: Vec::new(),
            random: Random::new(3),
        }
    }

    /// One millisecond; what is measured has noise of up to 0.02 m/s² and 0.005 rad/s.
    pub fn step(&mut self) {
        self.now += ms(1);
        let now = self.now;
        let mut noise = |most: f64| most * (self.random.below(2001) as f64 / 1000.0 - 1.0);
        let acceleration_mps2 = self.truth.acceleration_mps2.map(|value| value + noise(0.02));
        let rotation_radps = self.truth.rotation_radps.map(|value| value + noise(0.005));
        self.device.set(Truth { acceleration_mps2, rotation_radps, ..self.truth });
        self.device.handle_timeout(now);
        let mut bytes = [0; 256];
        let count = self.device.poll_tx(&mut bytes);
        // In two parts: a port splits where it likes.
        let (first, second) = bytes[..count].split_at(count / 3);
        self.engine.handle_rx(now, first);
        self.engine.handle_rx(now, second);
        while let Some(frame) = self.device.poll_frame() {
            self.engine.handle_frame(now, &frame);
        }
        self.engine.handle_timeout(now);
        while let Some(transfer) = self.engine.poll_transfer() {
            let outcome = self.device.handle_transfer(now, &transfer);
            self.engine.handle_outcome(now, &outcome);
            self.engine.handle_timeout(now);
        }
        while let Some(event) = self.engine.poll_event() {
            match event {
                Event::Sample(sample) => self.samples.push(sample),
                event => self.seen.push((now, event)),
            }
        }
        assert!(self.engine.poll_timeout().is_none_or(|at| at > now), "due at {now:?}, after it was served");
    }

    pub fn pass(&mut self, duration: Duration) {
        let end = self.now + duration;
        while self.now < end {
            self.step();
        }
    }

    /// Waits until it runs without a fault.
    pub fn run(&mut self) {
        let end = self.now + ms(4000);
        while self.engine.state() != State::Running {
            self.step();
            assert!(self.now < end, "not running: {:?}", self.seen);
        }
        self.pass(ms(700));
        self.seen.clear();
        self.samples.clear();
    }

    pub fn has(&self, wanted: Event) -> bool {
        self.seen.iter().any(|(_, seen)| *seen == wanted)
    }

    /// Injects every fault of [`ALL`], those of the device, and a silence of 60 s: 20 or more.
    pub fn suffers_all(&mut self, own: &[Cause]) {
        assert!(ALL.len() + own.len() + 1 >= 20);
        for (name, set) in ALL.iter().chain(own) {
            self.suffers(name, ms(3000), *set);
        }
        self.suffers("silence of 60 s", Duration::from_secs(60), |faults| faults.cut = true);
    }

    /// Injects a fault for this time: it is reported within one second, and gone two seconds after its end.
    pub fn suffers(&mut self, name: &str, duration: Duration, set: impl FnOnce(&mut Faults)) {
        self.run();
        let since = self.now;
        set(self.device.faults());
        self.pass(duration);
        let is_report = |event: &Event| matches!(event, Event::Lost { .. } | Event::Fault { active: true, .. });
        let report = self.seen.iter().find(|(_, event)| is_report(event));
        let (at, what) = report.unwrap_or_else(|| panic!("{name}: not reported: {:?}", self.seen));
        let after = at.since(since);
        assert!(after <= ms(1000), "{name}: {what:?} after {after:?}");
        std::println!("{name:32} {:4} ms  {what:?}", after.as_millis());
        let late = self.samples.iter().filter(|sample| sample.at > since + ms(1500));
        let good = late.filter(|sample| sample.status == Status::Ok).count();
        assert_eq!(good, 0, "{name}: samples that count as good");
        *self.device.faults() = Faults::default();
        let ended = self.now;
        self.seen.clear();
        self.pass(ms(2000));
        let active: Vec<Fault> = Fault::ALL.iter().copied().filter(|fault| self.engine.is_active(*fault)).collect();
        assert_eq!((self.engine.state(), &active[..]), (State::Running, &[][..]), "{name}: {:?}", self.seen);
        let last = self.seen.last().map_or(ended, |(at, _)| *at);
        std::println!("{:32} {:4} ms  again without fault", "", last.since(ended).as_millis());
        self.samples.clear();
        self.pass(ms(300));
        assert!(self.samples.len() > 20, "{name}: {}", self.samples.len());
        assert!(self.samples.iter().all(|sample| sample.status == Status::Ok), "{name}");
        self.seen.clear();
    }
}

impl Bench {
    /// Disturbs the line until that is reported, each time with other random numbers and at another phase: times until
    /// the report, in ascending order. It is gone two seconds after its end each time.
    pub fn disturbed(&mut self, name: &str, trials: u64, set: impl Fn(&mut Faults)) -> Vec<Duration> {
        let mut after = Vec::new();
        for trial in 0..trials {
            self.run();
            self.pass(ms(trial * 37 % 101));
            let since = self.now;
            set(self.device.faults());
            while self.seen.is_empty() {
                self.step();
                assert!(self.now.since(since) < ms(60_000), "{name}: not reported");
            }
            after.push(self.now.since(since));
            *self.device.faults() = Faults::default();
            self.pass(ms(2000));
            assert!(Fault::ALL.iter().all(|fault| !self.engine.is_active(*fault)), "{name}: {:?}", self.seen);
        }
        after.sort_unstable();
        let [median, last] = [after.len() / 2, after.len() - 1].map(|n| after[n].as_millis());
        let within = after.partition_point(|after| *after <= ms(1000));
        std::println!("{name:32} {within} of {trials} in 1 s, median {median}, worst {last} ms");
        after
    }

    /// A single disturbance of the line, such as a plug making contact, does not count.
    pub fn shrugs_off(&mut self, name: &str) {
        for trial in 0..20 {
            self.run();
            self.pass(ms(trial * 37 % 101));
            self.device.faults().noise_ppm = 500_000;
            self.pass(ms(60));
            *self.device.faults() = Faults::default();
            self.pass(ms(2000));
            assert!(!self.has(Event::Fault { fault: Fault::Noise, active: true }), "{name}: {:?}", self.seen);
        }
    }
}

/// A fault: its name, and how it is set.
pub type Cause = (&'static str, fn(&mut Faults));

/// Faults that every device can have.
pub const ALL: [Cause; 13] = [
    ("no supply", |faults| faults.unpowered = true),
    ("line cut", |faults| faults.cut = true),
    ("half of all is wrong", |faults| faults.noise_ppm = 500_000),
    ("half of each message", |faults| faults.halves = true),
    ("a data bit is stuck", |faults| faults.stuck_bits = 0x40),
    ("all bytes 0", |faults| faults.constant = Some(0)),
    ("all bytes 0xFF", |faults| faults.constant = Some(0xFF)),
    ("measurements are repeated", |faults| faults.frozen = true),
    ("a tenth of the acceleration", |faults| faults.acceleration_excess = -0.9),
    ("twice the acceleration", |faults| faults.acceleration_excess = 1.0),
    ("acceleration out of range", |faults| faults.saturated_acceleration = true),
    ("rotation out of range", |faults| faults.saturated_rotation = true),
    ("no acceleration", |faults| faults.without_acceleration = true),
];
