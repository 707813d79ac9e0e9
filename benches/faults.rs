//! Fault campaign on real processes: `cargo bench --bench faults`.
//!
//! Simulated robots drive. Repeatedly a module of one is harmed, and two times are measured: until a stop has begun (on
//! the CAN bus: quick stop, zero velocity, or the drive's own emergency for a lost master), and until the module is in
//! RUN again. Bounds: 300 ms for every fault of a critical module; 1 s for 99 of 100 faults; and the robot stands
//! within the time of the table "What stops the robot" of ARCHITECTURE.md. For comparison, the
//! settings of the thesis: hangs are detected by announcements only (2 s, checked every 200 ms).
//!
//! Environment: FAULTS (1000, or as many as 15 minutes take; a given number is not cut short), ROBOTS at a time, SEED.
//! ONLY=text: kinds of fault or modules whose name contains it. CONFIG=conf/courier: another robot, whose every wheel
//! must be stopped on the bus; its standstill is measured, and not compared with the table, whose figures are of
//! `conf/advee`.

#[path = "faults/can.rs"]
mod can;
#[path = "faults/canary.rs"]
mod canary;
#[path = "faults/figures.rs"]
mod figures;
#[path = "faults/kind.rs"]
mod kind;
#[path = "faults/rig.rs"]
mod rig;
#[path = "../advee/tests/support/stands.rs"]
mod stands;
#[path = "../advee/tests/support.rs"]
mod support;
#[path = "faults/table.rs"]
mod table;
#[path = "faults/trial.rs"]
mod trial;

use canary::Canary;
use figures::Times;
use kind::Kind;
use rig::{Ride, Rig, Yard};
use robot::config::SIMULATOR;
use simulator::Random;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use trial::{Ending, Outcome};

/// The robot whose figures the table "What stops the robot" has.
const REFERENCE: &str = "conf/advee";
const FAULTS: usize = 1000;
const ROBOTS: usize = 6;
/// Time limit without FAULTS.
const LIMIT: Duration = Duration::from_secs(15 * 60);
/// Ratio of the other faults to those of the control group.
const CONTROL: usize = 20;
/// Bounds, ms: until a stop has begun, for all; until the module is in RUN, for 99 %.
const STOP_MS: f64 = 300.0;
const RUN_MS: f64 = 1000.0;
/// Lifetime after which a restart is not delayed and leaves no delay for the next one.
const REST: Duration = Duration::from_millis(10_500);
/// Memory limit of a module, at which a memory hog ends, bytes.
const MEMORY_MAX: u32 = 256 << 20;

/// Hangs are found by announcements alone.
const BEATS_OFF: &str = "beat_timeout_s = 60";

/// Harmed module, and kind of fault.
type Fault = (String, Kind);

fn main() {
    let given = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let faults = given("FAULTS").map_or(FAULTS, |faults| faults as usize);
    let limit = if given("FAULTS").is_some() { Duration::MAX } else { LIMIT };
    let robots = given("ROBOTS").map_or(ROBOTS, |robots| robots as usize).max(1);
    let seed = given("SEED").unwrap_or(1);
    let shipped = std::env::var_os("CONFIG").map_or_else(|| REFERENCE.into(), PathBuf::from);
    let reference = shipped == Path::new(REFERENCE);
    // A bench runs in the folder of its package.
    let shipped = support::workspace().join(shipped);
    let folder = Folder::new();
    let saboteur = build(&folder.0);
    let canary = Canary::start();
    let campaign = |name: &str, settings: &str, faults: usize, limit| {
        let config = configure(&shipped, &folder.0.join(name), settings);
        let modules = modules(&config);
        let yard = Yard { config: &config, ride: ride(&config, reference), saboteur: &saboteur, folder: &folder.0 };
        let deck = deck(&modules, faults, &mut Random::stream(seed, faults as u64));
        let campaign = Campaign { yard, canary: &canary, critical: &modules, limit, deck: Mutex::new(deck), seed };
        campaign.run(robots)
    };
    let begin = Instant::now();
    let ours = campaign("ours", &format!("memory_max = {MEMORY_MAX}"), faults, limit);
    println!("{faults} faults, {robots} robots at a time, seed {seed}, {:.0} s", begin.elapsed().as_secs_f64());
    ours.print("beats, looked at every 20 ms");
    let settings = format!("memory_max = {MEMORY_MAX}\n{BEATS_OFF}");
    let control = campaign("control", &settings, faults.div_ceil(CONTROL), Duration::MAX);
    control.print("the thesis's settings: announcements, 2 s, looked at every 200 ms");
    ours.judge();
}

/// Folder of this campaign, removed with its content.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        // In memory like `/run`, where robots have theirs: other writes of the machine must not delay it.
        let memory = Path::new("/dev/shm");
        let parent = if memory.is_dir() { memory.into() } else { std::env::temp_dir() };
        let folder = parent.join(format!("advee-faults-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder");
        Self(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn build(folder: &Path) -> PathBuf {
    let (source, library) = (support::workspace().join("benches/faults/saboteur.c"), folder.join("saboteur.so"));
    let mut cc = Command::new("cc");
    cc.args(["-O1", "-shared", "-fPIC", "-pthread", "-Wno-unused-result", "-o"]).arg(&library).arg(source);
    assert!(cc.status().expect("a C compiler").success(), "saboteur.c is not compiled");
    library
}

/// Configuration of `shipped` with further settings of every module.
fn configure(shipped: &Path, folder: &Path, settings: &str) -> PathBuf {
    fs::create_dir_all(folder).expect("a folder");
    // With the data sheets of its drives.
    for entry in fs::read_dir(shipped).unwrap_or_else(|why| panic!("{}: {why}", shipped.display())) {
        let path = entry.expect("the configuration").path();
        if path.is_file() {
            fs::copy(&path, folder.join(path.file_name().expect("a file"))).expect("the configuration");
        }
    }
    let modules = fs::read_to_string(shipped.join("modules.toml")).expect("the shipped modules");
    // A module's own time limit would be a second one.
    let of_all = |line: &&str| !(settings.contains(BEATS_OFF) && line.starts_with("beat_timeout_s"));
    let modules: String = modules.lines().filter(of_all).map(|line| format!("{line}\n")).collect();
    let modules = modules.replace("\n[[modules]]\n", &format!("\n[[modules]]\n{settings}\n"));
    fs::write(folder.join("modules.toml"), modules).expect("a file");
    folder.into()
}

/// How the robot of a configuration drives, and its wheels on the bus.
fn ride(config: &Path, reference: bool) -> Ride {
    let place = robot::place::RobotLocation {
        config: config.into(),
        run_dir: config.into(),
        lcm_url: String::new(),
        sets: Vec::new(),
        sim: true,
        world: None,
    };
    let limits = robot::checks::limits(&place, base::Duration::from_secs(2)).expect("drives that can be judged");
    let drives = limits.wheels.into_iter().map(|wheel| wheel.drive).collect();
    Ride { drives, homes: limits.steering.is_some(), reference }
}

/// Modules to be harmed, with true if critical. The simulator plays the hardware.
fn modules(config: &Path) -> BTreeMap<String, bool> {
    // Without the web server, which a robot without a page does not run.
    let config = robot::config::Config::load(config, true, &["web.enabled=false".into()]);
    let modules = config
        .expect("a good configuration")
        .modules
        .into_iter()
        .map(|module| (module.guard.name, module.guard.critical));
    modules.filter(|(name, _)| name != SIMULATOR).chain([(watchdog::NAME.into(), true)]).collect()
}

/// All faults with equal frequency, shuffled.
fn deck(modules: &BTreeMap<String, bool>, count: usize, random: &mut Random) -> Vec<Fault> {
    // The watchdog has one thread.
    let can = |fault: &Fault| fault.0 != watchdog::NAME || fault.1 != Kind::Worker;
    let all = Kind::ALL.into_iter().flat_map(|kind| modules.keys().map(move |module| (module.clone(), kind)));
    let only = std::env::var("ONLY").unwrap_or_default();
    let wanted = |fault: &Fault| fault.0.contains(&only) || fault.1.name().contains(&only);
    let all: Vec<Fault> = all.filter(can).filter(wanted).collect();
    assert!(!all.is_empty(), "ONLY={only}: no fault of that name");
    let mut deck: Vec<Fault> = Vec::new();
    while deck.len() < count {
        let mut round = all.clone();
        for index in (1..round.len()).rev() {
            round.swap(index, (random.bits() % (index as u64 + 1)) as usize);
        }
        deck.extend(round);
    }
    deck.truncate(count);
    deck
}

struct Campaign<'a> {
    yard: Yard<'a>,
    canary: &'a Canary,
    critical: &'a BTreeMap<String, bool>,
    limit: Duration,
    deck: Mutex<Vec<Fault>>,
    seed: u64,
}

impl Campaign<'_> {
    fn run(&self, robots: usize) -> Results {
        let results = Mutex::new(Results::default());
        let begin = Instant::now();
        std::thread::scope(|scope| {
            for number in 0..robots {
                let results = &results;
                let mut random = Random::stream(self.seed, 1 << 32 | number as u64);
                scope.spawn(move || self.robot(begin, results, &mut random));
            }
        });
        results.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs robots one after the other until no fault is left; a robot that does not recover is replaced.
    fn robot(&self, begin: Instant, results: &Mutex<Results>, random: &mut Random) {
        static NUMBER: AtomicU16 = AtomicU16::new(0);
        let add = |outcome: Outcome| results.lock().unwrap_or_else(PoisonError::into_inner).add(outcome);
        while !self.is_over(begin) {
            let mut rig = Rig::start(&self.yard, NUMBER.fetch_add(1, Ordering::Relaxed));
            assert!(rig.until_driving(), "the robot does not start:\n{}", rig.lines().join("\n"));
            let mut harmed: BTreeMap<String, Instant> = BTreeMap::new();
            let started = Instant::now();
            while !self.is_over(begin) {
                let rests = |module: &str| harmed.get(module).unwrap_or(&started).elapsed() >= REST;
                let Some((module, kind)) = self.draw(rests) else {
                    rig.turn();
                    continue;
                };
                let phase = Duration::from_secs_f64(0.2 * random.uniform());
                let critical = self.critical[&module];
                let Some(outcome) = trial::run(&mut rig, &module, kind, critical, phase, self.canary) else {
                    self.give_back((module, kind));
                    let why = if rig.all_run() { rig.reason() } else { "a module was not in RUN" };
                    let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
                    *results.unready.entry(why.to_owned()).or_default() += 1;
                    drop(results);
                    if !rig.until_driving() {
                        break;
                    }
                    continue;
                };
                harmed.insert(module.clone(), Instant::now());
                if outcome.ending.is_void() {
                    self.give_back((module, kind));
                }
                if let Some(why) = outcome.objection() {
                    eprintln!("{why}: {outcome:?}\n{}\n", rig.lines().join("\n"));
                }
                add(outcome);
                if !rig.until_driving() {
                    eprintln!("does not drive again:\n{}", rig.lines().join("\n"));
                    results.lock().unwrap_or_else(PoisonError::into_inner).lost += 1;
                    break;
                }
            }
        }
    }

    fn is_over(&self, begin: Instant) -> bool {
        begin.elapsed() >= self.limit || self.deck.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    /// Next fault of a module whose restart delay has expired.
    fn draw(&self, rests: impl Fn(&str) -> bool) -> Option<Fault> {
        let mut deck = self.deck.lock().unwrap_or_else(PoisonError::into_inner);
        let index = deck.iter().position(|(module, _)| rests(module))?;
        Some(deck.remove(index))
    }

    fn give_back(&self, fault: Fault) {
        self.deck.lock().unwrap_or_else(PoisonError::into_inner).push(fault);
    }
}

/// Results of a campaign.
#[derive(Default)]
struct Results {
    kinds: BTreeMap<Kind, Row>,
    /// Faults that were repeated, by reason: their number, and the longest pause.
    void: BTreeMap<&'static str, (usize, Duration)>,
    /// Faults that were postponed because the robot did not drive, by the reason that it gave.
    unready: BTreeMap<String, usize>,
    /// Number of robots that did not drive again.
    lost: usize,
}

#[derive(Clone, Default)]
struct Row {
    faults: usize,
    stop: Times,
    run: Times,
    stands: Times,
    /// Number of stops that took longer than in the table.
    beyond: usize,
    missed: usize,
}

impl Results {
    fn add(&mut self, outcome: Outcome) {
        if let Ending::Void(why) = outcome.ending {
            let (why, pause) = why.told();
            let (count, longest) = self.void.entry(why).or_default();
            (*count, *longest) = (*count + 1, pause.max(*longest));
            return;
        }
        let row = self.kinds.entry(outcome.kind).or_default();
        row.faults += 1;
        row.missed += usize::from(outcome.is_missed());
        if let Some(took) = outcome.stop {
            row.stop.add(took);
        }
        if let Some(took) = outcome.run {
            row.run.add(took);
        }
        if let Some(took) = outcome.stands {
            row.stands.add(took);
            row.beyond += usize::from(outcome.table.is_some_and(|table| took > table));
        }
    }

    fn all(&self) -> Row {
        let mut all = Row::default();
        for row in self.kinds.values() {
            all.faults += row.faults;
            all.missed += row.missed;
            all.stop.append(&row.stop);
            all.run.append(&row.run);
            all.stands.append(&row.stands);
            all.beyond += row.beyond;
        }
        all
    }

    fn print(&self, name: &str) {
        let all = self.all();
        println!("\n{name}");
        let heads = ["ms to stop begun", "ms to standstill", "ms to RUN"].map(|head| format!("{head:>20}")).join("  ");
        println!("{:21} {:>6}  {heads}", "", "");
        let quantiles = vec![format!("{:>6} {:>6} {:>6}", "p50", "p99", "p100"); 3].join("  ");
        println!("{:21} {:>6}  {quantiles}  beyond table  missed", "", "faults");
        for (name, row) in self.kinds.iter().map(|(kind, row)| (kind.name(), row)).chain([("all", &all)]) {
            let columns = [&row.stop, &row.stands, &row.run].map(Times::columns).join("  ");
            println!("{name:21} {:6}  {columns}  {:12}  {:6}", row.faults, row.beyond, row.missed);
        }
        for (why, (count, longest)) in &self.void {
            println!("void and repeated, as {why}: {count}, {} ms at most", longest.as_millis());
        }
        for (why, count) in &self.unready {
            println!("put off, as the robot did not drive ({why}): {count}");
        }
        println!("robots that did not drive again: {}", self.lost);
        println!(
            "stop begun, ms\n{}RUN again, ms\n{}",
            all.stop.histogram(Duration::from_millis(20)),
            all.run.histogram(Duration::from_millis(50))
        );
    }

    fn judge(&self) {
        let all = self.all();
        let held = |value: Option<f64>, bound: f64| match value {
            Some(value) if value <= bound => format!("{value:.0} ms, within {bound:.0}"),
            Some(value) => format!("{value:.0} ms, NOT within {bound:.0}"),
            None => "not measured".into(),
        };
        println!("stop begun at p100: {}", held(all.stop.worst(), STOP_MS));
        println!("beyond the table:   {} of {} stands", all.beyond, all.stands.len());
        println!("RUN again at p99:   {}", held(all.run.p99(), RUN_MS));
        println!("missed:             {}", all.missed + self.lost);
    }
}
