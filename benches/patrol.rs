//! Patrol among visitors: `cargo bench -p advee --bench patrol`.
//!
//! The whole shipped robot, in virtual time, drives the route `patrol` of the world `WORLD` (default `hall`)
//! autonomously: first half an hour without visitors, then `HOURS` robot-hours (default 1, for a report: 10) among the
//! world's visitors, half an hour per seed from `SEED` (default 1) on, and the same hours without a guard
//! (`guard.ranging = "none"`, and no bound where nothing is sensed).
//!
//! Printed: every contact with the moving party and which sonars had answered, distance, speed relative to the empty
//! world's, waypoints relative to those without guard, goals given up, how often an operator had to resume the planner
//! after a visitor had walked into the robot, and the time that each cause held or slowed the robot. Then the planner's
//! inputs of the first half hour are replayed to a new one, and every step of its control loop is timed. `SETS` has
//! further overrides of the configuration. With `BOARD_FAULTS=1` one fault of the sonar boards follows another, the
//! runs without guard are left out, and contacts alone decide: standing is right then. `GUARDED_ONLY=1` leaves
//! them out, too, and with them the comparison of the waypoints.
//!
//! Goals: no contact that the robot moved into at more than 0.05 m/s, persons whom no sonar had answered until the
//! guard's reaction time before it apart; at least 0.15 m/s, 90 % of the waypoints without guard, no goal given up;
//! control step 20 µs in the mean, 0.5 ms at the 99th percentile. The bench fails if one is missed.

#[path = "patrol/rig.rs"]
mod rig;

use base::{Duration, Epoch};
use messages::Hold;
use messages::simulation::CmdFault;
use module::Call;
use module::{Actions, Event};
use record::{Item, Reader};
use rig::Patrol;
use robot::recording;
use simulator::people::{Contact, Mover};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::process::ExitCode;
use std::rc::Rc;
use std::time::Instant;
use testing::Random;

/// Duration of a run, s.
const RUN: f64 = 1800.0;
/// Speed of the robot towards what it touches above which a contact counts, m/s.
const CONTACT_MPS: f64 = 0.05;
/// Reaction time of the guard, s (`guard.reaction_s`): what no sonar has answered before is met without braking.
const REACTION_S: f64 = 0.12;
/// Time after a fault in which a contact is printed with it, s.
const FAULT_FELT_S: f64 = 3.0;
const BOARDS: [&str; 2] = ["sd1_front", "sd1_rear"];
/// Faults of a board of sonars, on the wire and in its transducers, with the range of their magnitudes: those of
/// `scenarios/default.toml`.
const FAULTS_OF_BOARDS: [(&str, f64, f64); 11] = [
    ("silent", 0.0, 0.0),
    ("slow", 0.005, 0.1),
    ("garbled", 0.01, 0.5),
    ("bad_crc", 0.0, 0.0),
    ("bad_length", 0.0, 0.0),
    ("babble", 0.0, 1.0),
    ("clash", 0.0, 0.0),
    ("reset", 0.0, 0.0),
    ("blind", 0.0, 0.0),
    ("stuck", 0.0, 0.0),
    ("crosstalk", 0.05, 0.5),
];
/// Overrides of a robot that is not bounded by what it senses.
const UNGUARDED: [&str; 2] = ["guard.ranging=\"none\"", "guard.speed_blind_mps=2.0"];

fn main() -> ExitCode {
    let number = |name: &str| std::env::var(name).ok().and_then(|value| value.parse::<f64>().ok());
    let world = std::env::var("WORLD").unwrap_or_else(|_| "hall".into());
    let first = number("SEED").map_or(1, |seed| seed as u64);
    let runs = (number("HOURS").unwrap_or(1.0) * 3600.0 / RUN).round().max(1.0) as u64;
    let told = Rc::new(RefCell::new(Vec::new()));
    let ill = number("BOARD_FAULTS").is_some();
    let guarded_only = ill || number("GUARDED_ONLY").is_some();
    let empty = run(&world, Some(0), first, None, &[], false);
    println!("nobody there: {empty}");
    let (mut all, mut unguarded) = (Total::default(), Total::default());
    for seed in first..first + runs {
        let keep = told.clone();
        let write = move |bytes: &[u8]| {
            keep.borrow_mut().extend_from_slice(bytes);
            true
        };
        let sink = (seed == first).then(|| Box::new(write) as record::Sink);
        let one = run(&world, None, seed, sink, &[], ill);
        println!("seed {seed}: {one}");
        one.print_contacts();
        if 2 * one.told.1 > one.told.0 {
            println!("  it stands at {:.2}, {:.2}, {:.2} rad:", one.at.0, one.at.1, one.at.2);
            for (at, words) in one.words.iter().rev().take(8).rev() {
                println!("  {at:8.1} s  {words}");
            }
        }
        all.add(one);
        if guarded_only {
            continue;
        }
        let one = run(&world, None, seed, None, &UNGUARDED, false);
        println!("  without guard: {one}");
        one.print_contacts();
        unguarded.add(one);
    }
    println!("all: {all}");
    all.print_causes();
    if ill {
        return verdict(all.own_contacts().0 == 0);
    }
    let steps = Steps::of(&told.borrow());
    println!("control step: {steps}");
    println!("speed beside the empty world's: {:.0} %", 100.0 * all.speed() / empty.speed());
    let mut share = 1.0;
    if !guarded_only {
        println!("without guard: {unguarded}");
        unguarded.print_causes();
        share = f64::from(all.waypoints) / f64::from(unguarded.waypoints);
        println!("waypoints beside those without guard: {:.0} %", 100.0 * share);
    }
    let drives = all.own_contacts().0 == 0 && all.failed == 0 && all.speed() >= 0.15 && share >= 0.9;
    verdict(drives && steps.mean_us <= 20.0 && steps.p99_us <= 500.0)
}

fn verdict(good: bool) -> ExitCode {
    println!("{}", if good { "all figures reached" } else { "NOT all figures reached" });
    if good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Time, s, of a contact, and the sonars that had answered: number, distance in m.
type Touch = (f64, Contact, Vec<(i32, f64)>);

#[derive(Default)]
struct Total {
    seconds: f64,
    way: f64,
    waypoints: u32,
    failed: u32,
    let_go: u32,
    told: (u32, u32),
    contacts: Vec<Touch>,
    causes: BTreeMap<(&'static str, Option<Hold>), f64>,
    /// Last texts of the planner, and the pose of the robot.
    words: Vec<(f64, String)>,
    at: (f64, f64, f64),
    took: f64,
    /// Begin and end, s, of each fault of a board.
    faults: Vec<(f64, f64, String)>,
}

fn run(world: &str, people: Option<u32>, seed: u64, sink: Option<record::Sink>, more: &[&str], ill: bool) -> Total {
    let begin = Instant::now();
    let sets = std::env::var("SETS").unwrap_or_default();
    let more: Vec<&str> = sets.split_whitespace().chain(more.iter().copied()).collect();
    let mut robot = Patrol::with(world, people, seed, sink, &more);
    robot.go();
    assert!(robot.planner_runs(), "modules.toml has a planner");
    let before = robot.seen();
    let mut faults = Vec::new();
    if ill {
        let mut chance = Random::new(seed);
        let end = robot.machine.now() + Duration::from_secs_f64(RUN);
        while robot.machine.now() < end {
            let fault = fault_of_a_board(&mut chance);
            let lasts = fault.duration;
            let now = robot.machine.now();
            let since = now.as_nanos() as f64 / 1e9;
            faults.push((since, since + lasts, format!("{} {} {:.3}", fault.target, fault.fault, fault.value)));
            robot.machine.inject(now, fault);
            robot.patrol((lasts + between(&mut chance, 1.0, 30.0)).min(end.since(now).as_secs_f64()));
        }
    } else {
        robot.patrol(RUN);
    }
    let seen = robot.seen();
    assert!(seen.waypoints > 0, "it does not drive: {}", seen.goal.message);
    Total {
        seconds: RUN,
        way: seen.way - before.way,
        waypoints: seen.waypoints,
        failed: seen.failed,
        let_go: robot.let_go,
        told: seen.told,
        contacts: seen.contacts.into_iter().zip(seen.answered).map(|((at, one), by)| (at, one, by)).collect(),
        causes: seen.causes,
        words: seen.words,
        at: (seen.truth.x, seen.truth.y, seen.truth.theta),
        took: begin.elapsed().as_secs_f64(),
        faults,
    }
}

/// Any fault of one of the sonar boards, for 0.5 to 20 s.
fn fault_of_a_board(chance: &mut Random) -> CmdFault {
    let target = BOARDS[chance.index(BOARDS.len())].into();
    let (fault, least, most) = FAULTS_OF_BOARDS[chance.index(FAULTS_OF_BOARDS.len())];
    let (value, duration) = (between(chance, least, most), between(chance, 0.5, 20.0));
    CmdFault { timestamp: 0, target, fault: fault.into(), value, duration }
}

fn between(chance: &mut Random, least: f64, most: f64) -> f64 {
    least + (most - least) * chance.below(1 << 20) as f64 / f64::from(1 << 20)
}

impl Total {
    fn add(&mut self, other: Self) {
        self.seconds += other.seconds;
        self.way += other.way;
        self.waypoints += other.waypoints;
        self.failed += other.failed;
        self.let_go += other.let_go;
        self.told = (self.told.0 + other.told.0, self.told.1 + other.told.1);
        self.contacts.extend(other.contacts);
        for (cause, seconds) in other.causes {
            *self.causes.entry(cause).or_default() += seconds;
        }
        self.took += other.took;
    }

    fn speed(&self) -> f64 {
        self.way / self.seconds
    }

    /// Contacts that the robot moved into, and those with a person whom no sonar had answered in time. What stands in
    /// the map needs no answer.
    fn own_contacts(&self) -> (usize, usize) {
        let own = |contact: &Contact| contact.mover == Mover::Robot && contact.robot_mps > CONTACT_MPS;
        let known = |contact: &Contact, by: &[(i32, f64)]| {
            contact.person.is_none() || by.iter().any(|(_, before)| *before >= REACTION_S)
        };
        let own = self.contacts.iter().filter(|(_, contact, _)| own(contact));
        let (answered, not): (Vec<_>, Vec<_>) = own.partition(|(_, contact, by)| known(contact, by));
        (answered.len(), not.len())
    }

    fn print_contacts(&self) {
        for (at, contact, answered) in &self.contacts {
            let by = answered.iter().map(|(sonar, before)| format!("{sonar} {before:.2} s before"));
            println!("  {at:8.1} s  {contact}; answered by: {}", by.collect::<Vec<_>>().join(", "));
            for (since, until, fault) in &self.faults {
                if since <= at && *at <= until + FAULT_FELT_S {
                    println!("             {fault}, from {since:.1} to {until:.1} s");
                }
            }
        }
    }

    fn print_causes(&self) {
        for ((whose, cause), seconds) in &self.causes {
            let share = 100.0 * seconds / self.seconds;
            println!("  {whose}: {} {share:.1} %", cause.map_or("none".into(), |cause| format!("{cause:?}")));
        }
    }
}

impl std::fmt::Display for Total {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (own, unanswered) = self.own_contacts();
        let Self { seconds, way, waypoints, failed, let_go, told, contacts, took, .. } = self;
        write!(
            f,
            "{:.1} h, {way:.0} m, {:.3} m/s, {waypoints} waypoints, {failed} goals given up, contacts: {own} by the robot, \
             {unanswered} with whom no sonar had answered, {} others; in the way {:.0} %; let go by hand {let_go} times; \
             {:.0} x real time",
            seconds / 3600.0,
            self.speed(),
            contacts.len() - own - unanswered,
            100.0 * f64::from(told.1) / f64::from(told.0.max(1)),
            seconds / took
        )
    }
}

/// Durations of the control loop's steps.
struct Steps {
    count: usize,
    mean_us: f64,
    p99_us: f64,
    most_us: f64,
}

impl Steps {
    /// Replays recorded inputs to a planner.
    fn of(told: &[u8]) -> Self {
        let mut reader = Reader::open(told).expect("a recording");
        let mut shell = recording::rebuild(reader.header(), &[]).expect("the recorded configuration");
        let mut took = Vec::new();
        let mut out = Actions::new(Epoch::default());
        while let Some(Item::Record(record)) = reader.read().expect("a whole recording") {
            let time = |call: Call<'_>| {
                let step = matches!(call, Call::Event(Event::Timer));
                let begin = Instant::now();
                call.tell(&mut shell, record.at, &mut out);
                let spent = begin.elapsed().as_secs_f64() * 1e6;
                out.drain().for_each(drop);
                if step {
                    took.push(spent);
                }
            };
            record.call(time).expect("a whole record");
        }
        took.sort_by(f64::total_cmp);
        let count = took.len();
        let at = |share: f64| took.get((count as f64 * share) as usize).copied().unwrap_or(f64::NAN);
        let mean_us = took.iter().sum::<f64>() / count as f64;
        Self { count, mean_us, p99_us: at(0.99), most_us: at(1.0 - 0.5 / count as f64) }
    }
}

impl std::fmt::Display for Steps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { count, mean_us, p99_us, most_us } = self;
        write!(f, "mean {mean_us:.1} us, p99 {p99_us:.0} us, most {most_us:.0} us, of {count}")
    }
}
