//! Estimator over recordings of unknown robots: `cargo bench -p estimator --bench recordings`.
//!
//! `--seeds N` (default 25) recordings of each kind, from seed `--from S` (default 0), on `--jobs J` threads (default
//! 1). Prints the table of docs/navigation.md, and each seed with a wrong pose.
#![allow(clippy::disallowed_methods, reason = "a bench asks the time")]
#![allow(clippy::needless_range_loop, reason = "rows and columns of matrices are read best by their places")]

#[path = "estimator/matrix.rs"]
#[allow(dead_code, reason = "the other bench uses all of it")]
mod matrix;
#[path = "estimator/robots.rs"]
mod robots;
#[path = "estimator/truth.rs"]
#[allow(dead_code, reason = "the other bench uses all of it")]
mod truth;

use robots::{KINDS, Kind, Outcome, outcome};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let number = |name: &str, usual: u64| {
        let place = args.iter().position(|arg| arg == name);
        place.and_then(|place| args.get(place + 1)?.parse().ok()).unwrap_or(usual)
    };
    let (seeds, from, jobs) = (number("--seeds", 25), number("--from", 0), number("--jobs", 1).max(1));
    println!("{seeds} recordings of each kind from seed {from}, {} s each\n", robots::LENGTH);
    println!(
        "| recordings | told everything, m | told nothing / everything | NEES / 3 (5 to 95 %) | nothing / gated filter \
         that knows | located | FINE | first pose wrong | wrong, s: FINE | COARSE | doubts | time of a recording, ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for kind in &KINDS {
        let begin = std::time::Instant::now();
        let outcomes = each(seeds, from, jobs, kind);
        print_row(kind, from, &outcomes, begin.elapsed().as_secs_f64() * jobs as f64);
        if args.iter().any(|arg| arg == "--list") {
            outcomes.iter().zip(from..).for_each(|(outcome, seed)| print_run(seed, outcome));
        }
    }
}

/// Outcomes of the seeds, in their order.
fn each(seeds: u64, from: u64, jobs: u64, kind: &Kind) -> Vec<Outcome> {
    let part = |job: u64| (0..seeds).filter(|seed| seed % jobs == job).map(|seed| outcome(kind, from + seed)).collect();
    let mut parts: Vec<std::vec::IntoIter<Outcome>> = std::thread::scope(|scope| {
        let part = &part;
        let handles: Vec<_> = (0..jobs).map(|job| scope.spawn(move || -> Vec<Outcome> { part(job) })).collect();
        handles.into_iter().map(|handle| handle.join().expect("a run").into_iter()).collect()
    });
    (0..seeds).filter_map(|seed| parts[(seed % jobs) as usize].next()).collect()
}

/// The middle and the bounds of nine tenths.
fn spread(mut values: Vec<f64>) -> (f64, f64, f64) {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    (values[last / 20], values[values.len() / 2], values[last - last / 20])
}

fn print_row(kind: &Kind, from: u64, outcomes: &[Outcome], seconds: f64) {
    let count = outcomes.len() as f64;
    let mean = |f: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(f).sum::<f64>() / count;
    let root = |f: &dyn Fn(&Outcome) -> f64| libm::sqrt(mean(f));
    let (everything, nothing) = (root(&|o| o.everything.square), root(&|o| o.nothing.square));
    let (low, _, high) = spread(outcomes.iter().map(|o| o.nothing.nees).collect());
    let first = outcomes.iter().filter(|o| o.nothing.first_wrong).count();
    println!(
        "| {} | {everything:.3} | {:.3} | {:.2} ({low:.2} to {high:.2}; told everything {:.2}) | {:.3} | {:.1} % \
         | {:.1} % | {first} | {:.1} in {} | {:.1} | {:.2} | {:.0} |",
        kind.name,
        nothing / everything,
        mean(&|o| o.nothing.nees),
        mean(&|o| o.everything.nees),
        nothing / root(&|o| o.gated),
        100.0 * mean(&|o| o.nothing.located),
        100.0 * mean(&|o| o.nothing.fine),
        outcomes.iter().map(|o| o.nothing.wrong_fine).sum::<f64>(),
        outcomes.iter().filter(|o| o.nothing.wrong_fine > 0.0).count(),
        mean(&|o| o.nothing.wrong_coarse) * count,
        mean(&|o| o.nothing.counts.doubted as f64),
        1e3 * seconds / count
    );
    let wrong = (from..).zip(outcomes).filter(|(_, o)| o.nothing.wrong_fine > 0.0);
    wrong.for_each(|(seed, outcome)| print_run(seed, outcome));
}

fn print_run(seed: u64, outcome: &Outcome) {
    let Outcome { nothing, everything, gated, found, delay } = outcome;
    let config = &found.config;
    println!(
        "  seed {seed}: error {:.3} told {:.3} gated {:.3}, NEES/3 {:.2} told {:.2}, FINE {:.1} s wrong, COARSE {:.1} s \
         wrong, first wrong {}, doubts {}; bearing {:.4} lasting {} {} wild {:.3} turn {:.4} along {:.4} \
         delay {delay:.3} hold {}",
        libm::sqrt(nothing.square),
        libm::sqrt(everything.square),
        libm::sqrt(*gated),
        nothing.nees,
        everything.nees,
        nothing.wrong_fine,
        nothing.wrong_coarse,
        nothing.first_wrong,
        nothing.counts.doubted,
        config.bearing,
        config.lasting,
        config.lasting_s,
        config.wild,
        config.odometry.turn_per_s,
        config.odometry.along_per_s,
        found.hold,
    );
}
