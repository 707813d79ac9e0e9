//! Fault campaign in virtual time: `cargo bench -p advee --bench wheel_faults`.
//!
//! Robots of each kinematics drive, each until a fault: a module dies or hangs, the bus of the drives is lost, a drive
//! refuses, a wheel runs away. Measured is the time from the fault until every other wheel is stopped on the wire: by a
//! quick stop, disabled, by velocity 0, or by its drive's own report. Bound: 300 ms for each. A module on which the
//! motion does not depend stops nothing: half a second after its fault the operator commands zero, and measured is the
//! time from there until every wheel's target has decreased by a tenth.
//!
//! Environment: FAULTS (1000) of each robot, SEED (1), CONFIG=conf/courier: this robot alone, CONFIG=skid-steer: the
//! porter on wheels that do not go sideways; NUMBER=17: this fault alone, as when it was one of many; ONLY=text: kinds
//! of fault whose name contains it.

#[allow(dead_code, reason = "the live campaign uses the rest")]
#[path = "faults/figures.rs"]
mod figures;
#[path = "../advee/tests/support/wheel_faults.rs"]
mod wheel_faults;

use figures::Times;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use wheel_faults::{Fault, Kind, Outcome, SKID_STEER, STOP_MAX, Subject};

/// Robots, one of each kinematics.
const ROBOTS: [&str; 7] = ["advee", "courier", "tug", "porter", "tripod", "rover", SKID_STEER];
const FAULTS: u64 = 1000;

fn main() {
    let given = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (faults, seed, number) = (given("FAULTS").unwrap_or(FAULTS), given("SEED").unwrap_or(1), given("NUMBER"));
    let only = std::env::var("ONLY").unwrap_or_default();
    let config = std::env::var("CONFIG").ok();
    let config = config.as_deref().and_then(|config| Path::new(config).file_name()?.to_str());
    let mut late = 0;
    for name in ROBOTS.into_iter().filter(|name| config.is_none_or(|config| config == *name)) {
        let numbers = number.map_or(0..faults, |number| number..number + 1);
        late += campaign(&Subject::new(name), seed, numbers, &only);
    }
    println!("late or missed: {late}");
}

/// Row of the table.
#[derive(Default)]
struct Row {
    faults: usize,
    stop: Times,
    missed: usize,
    unmoved: usize,
}

/// True if the stop came too late, or not at all.
fn is_late(outcome: &Outcome) -> bool {
    match outcome {
        Outcome::Stopped(took) => *took > STOP_MAX,
        Outcome::Missed(_) => true,
        Outcome::Unmoved => false,
    }
}

/// Number of faults after which a wheel stopped late, or did not stop.
fn campaign(subject: &Subject, seed: u64, numbers: std::ops::Range<u64>, only: &str) -> usize {
    let begin = Instant::now();
    let (next, outcomes) = (AtomicU64::new(numbers.start), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= numbers.end {
                        break;
                    }
                    let fault = subject.fault(seed, number);
                    if fault.kind.name().contains(only) {
                        let outcome = subject.run(&fault);
                        outcomes.lock().expect("no thread has failed").push((fault, outcome));
                    }
                }
            });
        }
    });
    let mut outcomes: Vec<(Fault, Outcome)> = outcomes.into_inner().expect("no thread has failed");
    outcomes.sort_by_key(|(fault, _)| fault.number);
    let mut rows = BTreeMap::<Kind, Row>::new();
    for (fault, outcome) in &outcomes {
        let row = rows.entry(fault.kind).or_default();
        row.faults += 1;
        match outcome {
            Outcome::Stopped(took) => row.stop.add(*took),
            Outcome::Missed(_) => row.missed += 1,
            Outcome::Unmoved => row.unmoved += 1,
        }
    }
    let name = &subject.name;
    println!("\n{name}: {} faults, seed {seed}, {:.0} s", outcomes.len(), begin.elapsed().as_secs_f64());
    for (fault, outcome) in outcomes.iter().filter(|(_, outcome)| is_late(outcome)) {
        println!("  late: SEED={seed} CONFIG=conf/{name} NUMBER={}: {fault}: {outcome:?}", fault.number);
    }
    println!("{:20} {:>6}  {:>6} {:>6} {:>6}  late  missed  stood", "ms to the stop", "faults", "p50", "p99", "p100");
    let late = |kind: Option<Kind>| {
        outcomes
            .iter()
            .filter(|(fault, outcome)| is_late(outcome) && kind.is_none_or(|kind| kind == fault.kind))
            .count()
    };
    for (kind, row) in &rows {
        let Row { faults, stop, missed, unmoved } = row;
        let (columns, late) = (stop.columns(), late(Some(*kind)) - missed);
        println!("{:20} {faults:6}  {columns}  {late:4}  {missed:6}  {unmoved:5}", kind.name());
    }
    late(None)
}
