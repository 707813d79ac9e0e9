//! An engine and its emulated device on one line, in virtual time, and the campaign of faults.

use crate::emulated::{Device, Faults};
use crate::engine::{Lidar, Protocol};
use crate::event::{Event, Fault, FieldResult, Health, LostReason, State, Zone};
use crate::scan::{EIGHTH_RAD, Sector, Status};
use base::{Duration, Instant};
use std::string::String;
use std::vec::Vec;

/// What an event was, without what it refers to.
#[derive(Clone, Debug, PartialEq)]
pub enum Seen {
    Identity(String),
    Health(Health),
    Zone(Zone, FieldResult),
    Fault(Fault, bool),
    Lost(LostReason),
    Recovered(Duration),
}

pub struct Bench<P, D> {
    pub now: Instant,
    pub engine: Lidar<P>,
    pub device: D,
    pub seen: Vec<(Instant, Seen)>,
    pub sectors: Vec<Sector>,
    pub sent: Vec<Vec<u8>>,
}

pub fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

impl<P: Protocol, D: Device> Bench<P, D> {
    pub fn new(engine: Lidar<P>, device: D) -> Self {
        Self {
            now: Instant::from_millis(10_000),
            engine,
            device,
            seen: Vec::new(),
            sectors: Vec::new(),
            sent: Vec::new(),
        }
    }

    /// One millisecond.
    pub fn step(&mut self) {
        self.now += ms(1);
        let now = self.now;
        self.device.handle_timeout(now);
        let mut bytes = [0; 4096];
        loop {
            let count = self.device.poll_tx(now, &mut bytes);
            // In two parts: a port splits where it likes.
            let (first, second) = bytes[..count].split_at(count / 3);
            self.engine.handle_rx(now, first);
            self.drain();
            self.engine.handle_rx(now, second);
            self.drain();
            if count < bytes.len() {
                break;
            }
        }
        self.engine.handle_timeout(now);
        self.drain();
        assert!(self.engine.poll_timeout().is_none_or(|at| at > now), "due at {now:?}, after it was served");
    }

    fn drain(&mut self) {
        while let Some(request) = self.engine.poll_tx() {
            self.device.handle_rx(self.now, &request);
            self.sent.push(request.to_vec());
        }
        while let Some(event) = self.engine.poll_event() {
            let seen = match event {
                Event::Sector(sector) => {
                    check(sector, self.now);
                    self.sectors.push(sector.clone());
                    continue;
                }
                Event::Identity(text) => Seen::Identity(String::from_utf8_lossy(text).into_owned()),
                Event::Health(health) => Seen::Health(health),
                Event::Zone { zone, result } => Seen::Zone(zone, result),
                Event::Fault { fault, active } => Seen::Fault(fault, active),
                Event::Lost { reason } => Seen::Lost(reason),
                Event::Recovered { after } => Seen::Recovered(after),
            };
            self.seen.push((self.now, seen));
        }
    }

    pub fn pass(&mut self, duration: Duration) {
        let end = self.now + duration;
        while self.now < end {
            self.step();
        }
    }

    /// Waits until it runs without a fault.
    pub fn run(&mut self) {
        let end = self.now + ms(6000);
        while self.engine.state() != State::Running {
            self.step();
            assert!(self.now < end, "not running: {:?}", self.seen);
        }
        self.pass(ms(700));
        self.seen.clear();
        self.sectors.clear();
    }

    pub fn has(&self, wanted: &Seen) -> bool {
        self.seen.iter().any(|(_, seen)| seen == wanted)
    }

    /// Injects every fault of [`LINE`], those of the device, and a silence of 60 s.
    pub fn suffers_all(&mut self, own: &[Cause]) {
        for (name, set) in LINE.iter().chain(own) {
            self.suffers(name, *set);
        }
        self.suffers_for(Duration::from_secs(60), "silence of 60 s", |faults| faults.mute = true);
    }

    /// Injects a fault for three seconds: it is reported within one second, and gone two seconds after its end.
    pub fn suffers(&mut self, name: &str, set: impl FnOnce(&mut Faults)) {
        self.suffers_for(ms(3000), name, set);
    }

    /// The same for another time.
    pub fn suffers_for(&mut self, duration: Duration, name: &str, set: impl FnOnce(&mut Faults)) {
        self.run();
        let since = self.now;
        set(self.device.faults());
        self.pass(duration);
        let report = self.seen.iter().find(|(_, seen)| matches!(seen, Seen::Lost(_) | Seen::Fault(_, true)));
        let (at, what) = report.unwrap_or_else(|| panic!("{name}: not reported: {:?}", self.seen));
        let after = at.since(since);
        assert!(after <= ms(1000), "{name}: {what:?} after {after:?}");
        std::println!("{name:32} {:4} ms  {what:?}", after.as_millis());

        *self.device.faults() = Faults::default();
        let ended = self.now;
        self.seen.clear();
        self.pass(ms(2000));
        let active: Vec<Fault> = Fault::ALL.iter().copied().filter(|fault| self.engine.is_active(*fault)).collect();
        assert_eq!((self.engine.state(), &active[..]), (State::Running, &[][..]), "{name}: {:?}", self.seen);
        let last = self.seen.last().map_or(ended, |(at, _)| *at);
        std::println!("{:32} {:4} ms  again without fault", "", last.since(ended).as_millis());
        self.sectors.clear();
        self.pass(ms(300));
        assert!(self.sectors.len() > 3, "{name}");
        assert!(self.sectors.iter().all(|sector| sector.status == Status::Ok), "{name}");
        self.seen.clear();
    }
}

/// How a disturbed line was reported, in many trials.
#[derive(Debug)]
pub struct Reports {
    /// Times until a report, in ascending order.
    pub after: Vec<Duration>,
    /// How often nothing was reported any more while the cause stood.
    pub ends: usize,
}

impl Reports {
    /// Trials with a report within this time.
    pub fn within(&self, limit: Duration) -> usize {
        self.after.partition_point(|after| *after <= limit)
    }
}

impl<P: Protocol, D: Device> Bench<P, D> {
    /// Disturbs the line until that is reported, each time with other random numbers and at another phase, and in every
    /// tenth trial for 5 s more. It is gone two seconds after its end each time.
    pub fn disturbed(&mut self, name: &str, trials: u64, set: impl Fn(&mut Faults)) -> Reports {
        let (mut reports, mut stood) = (Reports { after: Vec::new(), ends: 0 }, Duration::ZERO);
        let is_report = |(_, seen): &(Instant, Seen)| matches!(seen, Seen::Lost(_) | Seen::Fault(_, true));
        for trial in 0..trials {
            self.run();
            self.pass(ms(trial * 37 % 101));
            let since = self.now;
            set(self.device.faults());
            while !self.seen.iter().any(is_report) {
                self.step();
                assert!(self.now.since(since) < ms(60_000), "{name}: not reported");
            }
            reports.after.push(self.now.since(since));
            if trial.is_multiple_of(10) {
                for _ in 0..5000 {
                    let was_well = self.is_well();
                    self.step();
                    reports.ends += usize::from(self.is_well() && !was_well);
                }
                stood += ms(5000);
            }
            *self.device.faults() = Faults::default();
            let ended = self.now;
            while !self.is_well() {
                self.step();
                assert!(self.now.since(ended) <= ms(2000), "{name}: {:?}", self.seen);
            }
        }
        reports.after.sort_unstable();
        let [median, last] = [reports.after.len() / 2, reports.after.len() - 1].map(|n| reports.after[n].as_millis());
        let (within, ends, stood) = (reports.within(ms(1000)), reports.ends, stood.as_secs());
        std::println!(
            "{name:32} {within} of {trials} in 1 s, median {median}, worst {last} ms; {ends} ends in {stood} s"
        );
        reports
    }

    /// It measures without a fault.
    fn is_well(&self) -> bool {
        self.engine.state() == State::Running && !Fault::ALL.iter().any(|fault| self.engine.is_active(*fault))
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
            assert!(!self.has(&Seen::Fault(Fault::Noise, true)), "{name}: {:?}", self.seen);
        }
    }
}

/// What holds of every sector.
fn check(sector: &Sector, now: Instant) {
    assert!(!sector.ranges_m.is_empty());
    assert!(sector.intensities.is_empty() || sector.intensities.len() == sector.ranges_m.len());
    assert!(sector.span_rad() <= EIGHTH_RAD + 1e-9, "{} rad", sector.span_rad());
    assert!(sector.angle_min_rad.is_finite() && sector.angle_step_rad != 0.0 && sector.angle_step_rad.is_finite());
    assert!(sector.beam_time_s >= 0.0 && sector.beam_time_s < 0.1, "{} s", sector.beam_time_s);
    assert!(sector.at <= now, "measured at {:?}, now {now:?}", sector.at);
}

/// A fault: its name, and how it is set.
pub type Cause = (&'static str, fn(&mut Faults));

/// Faults that every line can have.
pub const LINE: [Cause; 15] = [
    ("no supply", |faults| faults.unpowered = true),
    ("line cut", |faults| faults.cut = true),
    ("nothing to the engine", |faults| faults.mute = true),
    ("noise, 3 of 100 bytes", |faults| faults.noise_ppm = 30_000),
    ("bytes lost, 3 of 100", |faults| faults.lost_per_mille = 30),
    ("bytes added, 3 of 100", |faults| faults.added_per_mille = 30),
    ("a data bit is stuck", |faults| faults.stuck_bits = 0x40),
    ("all bytes 0", |faults| faults.constant = Some(0)),
    ("all bytes 0xFF", |faults| faults.constant = Some(0xFF)),
    ("wrong bit rate", |faults| faults.wrong_baud = true),
    ("line holds back", |faults| faults.held_back = true),
    ("half a message for ever", |faults| faults.half_for_ever = true),
    ("the last message for ever", |faults| faults.repeats = true),
    ("half of each message", |faults| faults.halves = true),
    ("a line of a tenth of its rate", |faults| faults.slow_line = true),
];
