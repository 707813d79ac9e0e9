//! What the guard makes of a lidar, device to bound: `cargo bench -p guard --bench lidar`.
//!
//! An emulated device, its driver and the guard, in virtual time and in steps of 1 ms. A robot drives at 0.8 m/s
//! between walls 3.5 m away all around.
//!
//! - **Appearances**: a leg is suddenly in the protective field, at a random place and at a random phase of the
//!   revolution. Measured is the time until `LL_DATA_GUARD` permits less than the robot's speed. Goal: at most
//!   `evaluations` revolutions and 20 ms, in all of them. `--count N` (10,000). The leg is one of 12 cm that stands, or
//!   one of 7 cm, the test piece for legs of IEC 61496-3, that walks across at 1.6 m/s while the robot comes. The beam
//!   comes back later to who walks the way in which it turns: of those later than the goal, the ones are counted that
//!   the beam had met `evaluations` times within as many revolutions. Measured is also the time from the beam that met
//!   the leg first, and from the first one of the last turn that it takes.
//! - **Wild beams**: one beam of a thousand measures anything up to 12 m. Counted are false stops: the guard permits
//!   less than half of the robot's speed, or once more after a second without. Goal: one an hour with
//!   `evaluations = 2`.
//!   `--hours H` (20).
//! - **CPU** of the driver for what a device sends, encoding of its messages included. Goal: 3 % of a core at 8,000
//!   points a second; an RPLIDAR A3 sends 15,900, an S2 32,000.
//!
//! `--lidar NAME` measures only that one, `--evaluations N` only with that many, and `--only appearances`, `wild` or
//! `cpu` only that.

#[path = "sys.rs"]
mod sys;

use base::serial::Word;
use base::{Duration, Instant};
use drivers::lidar::{Config, Device, LidarKeys, Lidars, Model, StopKeys};
use guard::{Ackermann, Guard, Lidar, Ranging, Settings};
use lidar::emulated::{DIRECTIONS, Device as Emulated};
use lidar::ld::NoEcho;
use lidar::sick::{Dialect, Family};
use lidar::{hokuyo, ld, rplidar, sick, ydlidar};
use messages::Message;
use messages::lowlevel::{DataGuard, DataMotion, DataScan};
use module::bench::Bench;
use module::{Action, Output, PortId, Shell, ShellConfig};
use navitools::{Point, Pose};
use settings::Section;
use std::f64::consts::TAU;
use testing::Random;

#[global_allocator]
static MEMORY: sys::Counting = sys::Counting::new();

const STEP: Duration = Duration::from_millis(1);
const MOTION: Duration = Duration::from_millis(50);
/// Speed of the robot, m/s.
const SPEED: f64 = 0.8;
/// Distance of the walls, m.
const WALLS_M: f32 = 3.5;
/// Where the lidar sits: 5 cm behind the front.
const LIDAR_X: f64 = 0.7;
/// A leg: its name, its radius, m, and the speed at which it walks across, m/s.
const LEGS: [(&str, f64, f64); 2] = [("12 cm, stands", 0.06, 0.0), ("7 cm, walks", 0.035, 1.6)];
/// What is nearer than the walls by this is a leg, m.
const LEG_BEFORE_WALL_M: f32 = 0.5;
/// Time beyond the revolutions that the goal permits.
const BEYOND: Duration = Duration::from_millis(20);
/// Probability of a wild beam.
const WILD: f64 = 0.001;
/// Longest distance that a wild beam measures, m.
const WILD_M: f64 = 12.0;

/// A lidar, and the time of its revolution.
struct Kind {
    name: &'static str,
    model: Model,
    turn: Duration,
}

const fn kind(name: &'static str, model: Model, turn_ms: u64) -> Kind {
    Kind { name, model, turn: Duration::from_millis(turn_ms) }
}

/// An LD06 sends what an LD19 sends, and a UST what a UTM-30LX sends.
const KINDS: [Kind; 14] = [
    kind("ld19", Model::Ld(ld::Model::Ld19), 100),
    kind("stl-19p", Model::Ld(ld::Model::Stl19p), 100),
    kind("rplidar-a1", Model::Rplidar(rplidar::Model::A1), 100),
    kind("rplidar-a2", Model::Rplidar(rplidar::Model::A2), 100),
    kind("rplidar-a3", Model::Rplidar(rplidar::Model::A3), 100),
    kind("rplidar-c1", Model::Rplidar(rplidar::Model::C1), 100),
    kind("rplidar-s2", Model::Rplidar(rplidar::Model::S2), 100),
    kind("ydlidar-x4", Model::Ydlidar(ydlidar::Model::X4), 143),
    kind("ydlidar-g4", Model::Ydlidar(ydlidar::Model::G4), 100),
    kind("sick-lms1xx", Model::Sick(Family::Lms1xx), 40),
    kind("sick-tim5xx", Model::Sick(Family::Tim5xx), 67),
    kind("sick-tim7xx", Model::Sick(Family::Tim7xx), 67),
    kind("utm-30lx", Model::Hokuyo("UTM-30LX"), 25),
    kind("urg-04lx", Model::Hokuyo("URG-04LX"), 100),
];

impl Kind {
    fn emulated(&self) -> Box<dyn Emulated> {
        match self.model {
            Model::Ld(model) => Box::new(ld::emulated::Device::new(model)),
            Model::Rplidar(model) => Box::new(rplidar::emulated::Device::new(model)),
            Model::Ydlidar(model) => Box::new(ydlidar::emulated::Device::new(model)),
            Model::Sick(family) => Box::new(sick::emulated::Device::new(family, Dialect::Binary)),
            Model::Hokuyo("URG-04LX") => Box::new(hokuyo::emulated::Device::new(hokuyo::emulated::Model::URG_04LX)),
            Model::Hokuyo(_) => Box::new(hokuyo::emulated::Device::new(hokuyo::emulated::Model::UTM_30LX)),
        }
    }

    fn driver(&self) -> Bench {
        let keys = LidarKeys {
            model: self.model,
            x: LIDAR_X,
            y: 0.0,
            theta: 0.0,
            upside_down: false,
            view: None,
            range_max: None,
            no_echo: NoEcho::Unknown,
            mode: None,
            dialect: Dialect::Binary,
        };
        let is_serial = matches!(self.model, Model::Ld(_) | Model::Rplidar(_) | Model::Ydlidar(_));
        let baud = is_serial.then(|| self.model.usual_baud());
        let device = Device { name: "front".into(), bus: "lidar.front".into(), baud, keys, stop: StopKeys::usual() };
        let module = Lidars::new(Config { devices: vec![device] });
        let mut bench = Bench::new(Shell::new(ShellConfig::new(drivers::lidar::NAME), Box::new(module)));
        bench.start();
        bench
    }

    fn guard(&self, evaluations: u32) -> Bench {
        let settings = Settings { ranging: Ranging::Lidar, evaluations, reach: 3.0, ..Settings::usual() };
        let corner = |(x, y)| Point { x, y };
        let config = guard::Config {
            settings,
            footprint: [(-0.15, -0.3), (0.75, -0.3), (0.75, 0.3), (-0.15, 0.3)].map(corner).into(),
            sonars: Vec::new(),
            lidars: vec![Lidar {
                name: "front".into(),
                mount: Pose::new(LIDAR_X, 0.0, 0.0),
                view: self.model.view_rad(),
            }],
            base: Ackermann { wheelbase: 0.6, steering: 0.61, steering_rate: 0.7 }.into(),
            braking: 0.8,
            power_lost: 0.8,
            speed: 1.2,
        };
        let guard = Guard::new(&config).expect("an outline");
        let mut bench = Bench::new(Shell::new(ShellConfig::new(guard::NAME), Box::new(guard)));
        bench.start();
        bench
    }
}

/// Device, driver and guard.
struct Chain {
    device: Box<dyn Emulated>,
    driver: Bench,
    guard: Bench,
    motion: Instant,
    /// Who is there: where, seen from the lidar, the radius, m, and the speed along y, m/s. The robot comes to one who
    /// walks, and one who stands goes with it.
    walker: Option<(Point, f64, f64)>,
    /// Turns of the beam that met it: the first beam and the last one of each.
    met: Vec<(Instant, Instant)>,
    /// Time of a revolution.
    turn: Duration,
}

impl Chain {
    fn new(kind: &Kind, evaluations: u32) -> Self {
        let (device, driver, guard) = (kind.emulated(), kind.driver(), kind.guard(evaluations));
        let (motion, turn) = (Instant::ZERO, kind.turn);
        let mut chain = Self { device, driver, guard, motion, walker: None, met: Vec::new(), turn };
        chain.device.scene().0 = [WALLS_M; DIRECTIONS];
        // Motor and start-up.
        for _ in 0..8000 {
            chain.step();
        }
        chain
    }

    fn now(&self) -> Instant {
        self.guard.now()
    }

    /// Somebody appears, or is gone.
    fn show(&mut self, walker: Option<(Point, f64, f64)>) {
        self.walker = walker;
        let around = &mut self.device.scene().0;
        *around = [WALLS_M; DIRECTIONS];
        if let Some((at, radius, _)) = walker {
            put(around, at, radius);
        }
    }

    /// A step; the guard's last message in it.
    fn step(&mut self) -> Option<DataGuard> {
        if let Some((at, radius, speed)) = self.walker.filter(|(_, _, speed)| *speed != 0.0) {
            let dt = STEP.as_secs_f64();
            let at = Point { x: (at.x - SPEED * dt).max(radius + 0.06), y: at.y + speed * dt };
            self.show(Some((at, radius, speed)));
        }
        self.driver.pass(STEP);
        self.guard.pass(STEP);
        let now = self.now();
        if self.motion <= now {
            self.motion = now + MOTION;
            self.guard.message(DataMotion { speed: SPEED, ..DataMotion::default() });
        }
        feed(self.device.as_mut(), &mut self.driver, now, |_, _| ());
        for (at, action) in self.driver.done() {
            match action {
                Action::Publish(Message::LlDataScan(scan)) => {
                    self.meet(&scan);
                    self.guard.message(scan);
                }
                Action::Send(_, Output::Words(words)) => {
                    let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                    self.device.handle_rx(at, &bytes);
                }
                _ => {}
            }
        }
        self.guard.published().into_iter().rev().find_map(|message| match message {
            Message::LlDataGuard(guard) => Some(guard),
            _ => None,
        })
    }

    /// Takes note of the beams of a sector that met somebody.
    fn meet(&mut self, scan: &DataScan) {
        let begun = Instant::from_nanos(1000 * u64::try_from(scan.timestamp).expect("a time after the start"));
        for (k, _) in scan.ranges.iter().enumerate().filter(|(_, range)| **range < WALLS_M - LEG_BEFORE_WALL_M) {
            let at = begun + Duration::from_secs_f64(k as f64 * scan.beam_time);
            match self.met.last_mut() {
                Some((_, last)) if at.since(*last) < self.turn / 2 => *last = at,
                _ => self.met.push((at, at)),
            }
        }
    }

    fn until(&mut self, most: Duration, wanted: impl Fn(&DataGuard) -> bool) -> Option<Duration> {
        let since = self.now();
        while self.now().since(since) < most {
            if self.step().is_some_and(|guard| wanted(&guard)) {
                return Some(self.now().since(since));
            }
        }
        None
    }
}

/// Hands on what the line has carried.
fn feed(device: &mut dyn Emulated, driver: &mut Bench, now: Instant, mut sent: impl FnMut(Instant, &[Word])) {
    device.handle_timeout(now);
    let mut bytes = [0; 4096];
    let count = device.poll_tx(now, &mut bytes);
    if count > 0 {
        let words: Vec<Word> = bytes[..count].iter().copied().map(Word::data).collect();
        sent(now, &words);
        driver.words(PortId(0), &words);
    }
}

/// A leg at a place seen from the lidar.
fn put(around: &mut [f32; DIRECTIONS], at: Point, radius: f64) {
    for (n, range) in around.iter_mut().enumerate() {
        let (sin, cos) = libm::sincos(n as f64 * TAU / DIRECTIONS as f64);
        let (along, across) = (at.x * cos + at.y * sin, at.y * cos - at.x * sin);
        let within = radius * radius - across * across;
        if along > 0.0 && within > 0.0 {
            *range = range.min((along - libm::sqrt(within)) as f32);
        }
    }
}

fn appearances(kind: &Kind, evaluations: u32, (leg, radius, pace): (&str, f64, f64), count: u32) {
    let mut chain = Chain::new(kind, evaluations);
    let mut random = Random::new(u64::from(evaluations));
    let mut uniform = move || random.below(1 << 32) as f64 / (1u64 << 32) as f64;
    let free = |guard: &DataGuard| guard.forward > SPEED;
    let goal = kind.turn * evaluations + BEYOND;
    let (mut took, mut from_first, mut from_last, mut until_last) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut slow = 0;
    for n in 0..count {
        chain.until(Duration::from_secs(5), free).unwrap_or_else(|| panic!("{}: {n}: it is not free", kind.name));
        for _ in 0..(uniform() * 2.0 * kind.turn.as_secs_f64() * 1e3) as u32 + 1 {
            chain.step();
        }
        let at = Point { x: 0.2 + 0.35 * uniform(), y: 0.6 * (uniform() - 0.5) };
        // One that walks begins at the side, and is still before the robot when it is to be found.
        let (at, speed) = match pace {
            0.0 => (at, 0.0),
            _ => (Point { x: at.x + 0.1, y: at.y / 2.0 + 0.15_f64.copysign(at.y) }, -pace.copysign(at.y)),
        };
        let appeared = chain.now();
        chain.met.clear();
        chain.show(Some((at, radius, speed)));
        let stops = |guard: &DataGuard| guard.forward < SPEED;
        let after = chain.until(Duration::from_secs(2), stops).unwrap_or(Duration::MAX);
        took.push(after);
        let first = |turn: usize| chain.met.get(turn).map(|(first, _)| *first);
        from_first.extend(first(0).map(|first| chain.now().since(first)));
        let last = first(evaluations as usize - 1);
        from_last.extend(last.map(|last| chain.now().since(last)));
        until_last.extend(last.map(|last| last.since(appeared)));
        slow += u32::from(after > goal && last.is_some_and(|last| last.since(appeared) <= kind.turn * evaluations));
        chain.show(None);
    }
    let at = |times: &mut Vec<Duration>, share: f64| {
        times.sort_unstable();
        times.get(((times.len().max(1) - 1) as f64 * share) as usize).map_or(f64::NAN, |time| time.as_secs_f64() * 1e3)
    };
    let late = took.iter().filter(|took| **took > goal).count();
    println!(
        "{:12} evaluations {evaluations}, leg of {leg}: p50 {:.0} ms, p99 {:.0} ms, p100 {:.0} ms of {count}; \
         goal {} ms, later: {late}, of these met in time: {slow}; p100 from the first beam {:.0} ms, \
         from the first one of turn {evaluations} {:.0} ms, until that one {:.0} ms ({})",
        kind.name,
        at(&mut took, 0.5),
        at(&mut took, 0.99),
        at(&mut took, 1.0),
        goal.as_millis(),
        at(&mut from_first, 1.0),
        at(&mut from_last, 1.0),
        at(&mut until_last, 1.0),
        from_last.len(),
    );
}

/// Events of which two belong together if less than a second is between them.
struct Events {
    count: u32,
    last: Instant,
}

impl Events {
    fn add(&mut self, now: Instant) {
        self.count += u32::from(now.since(self.last) > Duration::from_secs(1));
        self.last = now;
    }
}

fn wild(kind: &Kind, evaluations: u32, hours: f64) {
    let mut chain = Chain::new(kind, evaluations);
    let mut random = Random::new(7);
    let mut uniform = move || random.below(1 << 32) as f64 / (1u64 << 32) as f64;
    let end = chain.now() + Duration::from_secs_f64(3600.0 * hours);
    let none = || Events { count: 0, last: Instant::ZERO };
    let (mut stops, mut slows) = (none(), none());
    let mut wild: Vec<usize> = Vec::new();
    // Beams to the next wild one.
    let gap = |uniform: f64| 1 + (libm::log(1.0 - uniform) / libm::log(1.0 - WILD)) as usize;
    let mut next = gap(uniform());
    while chain.now() < end {
        // A device takes its samples of a direction in different steps: each of them is wild with this probability.
        let scene = &mut chain.device.scene().0;
        wild.drain(..).for_each(|place| scene[place] = WALLS_M);
        while next <= DIRECTIONS {
            scene[next - 1] = (WILD_M * uniform()) as f32;
            wild.push(next - 1);
            next += gap(uniform());
        }
        next -= DIRECTIONS;
        let Some(guard) = chain.step() else { continue };
        let now = chain.now();
        if guard.forward < SPEED / 2.0 {
            stops.add(now);
        }
        if guard.forward < SPEED {
            slows.add(now);
        }
    }
    println!(
        "{:12} evaluations {evaluations}: {} false stops, {} bounds below the speed in {hours} h",
        kind.name, stops.count, slows.count
    );
}

/// CPU time of the driver for a minute of what the device sends.
fn cpu(kind: &Kind) {
    let (mut device, mut driver) = (kind.emulated(), kind.driver());
    device.scene().0 = [WALLS_M; DIRECTIONS];
    let mut sent: Vec<(Instant, Vec<Word>)> = Vec::new();
    for _ in 0..70_000 {
        driver.pass(STEP);
        let now = driver.now();
        feed(device.as_mut(), &mut driver, now, |now, words| sent.push((now, words.to_vec())));
        for (at, action) in driver.done() {
            if let Action::Send(_, Output::Words(words)) = action {
                let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                device.handle_rx(at, &bytes);
            }
        }
    }
    // The same again for a driver that sees nothing else: its requests get the same answers.
    let mut driver = kind.driver();
    let (mut points, mut bytes, mut spent) = (0, Vec::new(), 0);
    let allocations = MEMORY.allocations();
    for (now, words) in &sent {
        let before = sys::cpu_ns();
        driver.pass(now.since(driver.now()));
        driver.words(PortId(0), words);
        for message in driver.published() {
            bytes.clear();
            message.encode(&mut bytes).expect("a message that LCM can express");
            if let Message::LlDataScan(scan) = message
                && *now >= Instant::from_millis(10_000)
            {
                points += scan.ranges.len();
            }
        }
        if *now >= Instant::from_millis(10_000) {
            spent += sys::cpu_ns() - before;
        }
    }
    let per_s = points as f64 / 60.0;
    println!(
        "{:12} {per_s:6.0} points/s: {:.2} % of a core, {:.2} % at 8,000 points/s, {} allocations a second",
        kind.name,
        spent as f64 / 60e9 * 100.0,
        spent as f64 / 60e9 * 100.0 / per_s * 8000.0,
        (MEMORY.allocations() - allocations) / 70
    );
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str| {
        let place = arguments.iter().position(|argument| argument == name)?;
        arguments.get(place + 1).cloned()
    };
    let count = value("--count").map_or(10_000, |count| count.parse().expect("a number"));
    let hours = value("--hours").map_or(20.0, |hours| hours.parse().expect("hours"));
    let only = value("--lidar");
    let kinds = || KINDS.iter().filter(|kind| only.as_ref().is_none_or(|only| only == kind.name));
    let part = value("--only");
    let wants = |name: &str| part.as_ref().is_none_or(|part| part == name);
    let only = value("--evaluations").map(|only| only.parse::<u32>().expect("a number"));
    let evaluations = || [1, 2].into_iter().filter(|evaluations| only.is_none_or(|only| only == *evaluations));
    if wants("cpu") {
        kinds().for_each(cpu);
    }
    for kind in kinds().filter(|_| wants("appearances")) {
        for evaluations in evaluations() {
            LEGS.into_iter().for_each(|leg| appearances(kind, evaluations, leg, count));
        }
    }
    // The others' beams are nearer to each other than the directions that are emulated.
    for kind in kinds().filter(|kind| wants("wild") && ["ld19", "rplidar-c1"].contains(&kind.name)) {
        evaluations().for_each(|evaluations| wild(kind, evaluations, hours));
    }
}
