//! Estimator compared with the theoretical bound: `cargo bench -p estimator --bench estimator`.
//!
//! Rows of docs/facts/robot.md 3.3 and goals of docs/navigation.md, which contains this output. Each row is run with
//! many seeds; `--seeds N` (default 100) sets their number.
#![allow(clippy::disallowed_methods, reason = "a bench asks the time")]
#![allow(clippy::needless_range_loop, reason = "rows and columns of matrices are read best by their places")]

#[path = "estimator/matrix.rs"]
mod matrix;
#[path = "estimator/trial.rs"]
mod trial;
#[path = "estimator/truth.rs"]
mod truth;

use trial::{Outcome, SWEEPS, Sought, at, feed, filter, known, unknown};
use truth::Row;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let seeds = args.iter().position(|arg| arg == "--seeds").and_then(|place| args.get(place + 1)?.parse().ok());
    let seeds: u64 = seeds.unwrap_or(100);
    println!("{seeds} runs a row, hall 20 × 12 m, 0.6 m/s; error, bound: root of the mean square, m\n");
    println!(
        "| row | bound | error | error / bound (spread over runs) | goal | NEES / 3 | worst | knowing nothing / \
         bound | textbook EKF / bound |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (row, goal) in rows() {
        print_row(&row, goal, seeds);
    }
    println!(
        "\n| from nothing | fixed within 5 s of three beacons | possible | median, longest, s | first fix wrong | \
         ever wrong | covariance too small, at most |"
    );
    println!("|---|---|---|---|---|---|---|");
    for row in searches() {
        print_search(&row, seeds * 4);
    }
    println!(
        "\n| put elsewhere after 60 s | within 3 sweeps: not FINE | not relied on | possible | median, longest, s | \
         back within 5 s | possible | median, longest, s | ever wrong |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for row in searches() {
        print_kidnapping(&Row { kidnapped: Some(60.0), length: 90.0, ..row }, "driving", seeds * 4);
    }
    for row in searches() {
        print_kidnapping(&Row { kidnapped: Some(60.0), stands: 50.0, length: 90.0, ..row }, "standing", seeds * 4);
    }
    println!();
    print_cost();
}

fn rows() -> Vec<(Row, f64)> {
    let easy = Row::EASY;
    let degrees = |degrees: f64| degrees.to_radians();
    vec![
        (Row { name: "3 beacons, 0.5°", beacons: 3, ..easy }, 1.05),
        (Row { name: "4 beacons, 0.25°", sigma: degrees(0.25), ..easy }, 1.05),
        (easy, 1.05),
        (Row { name: "4 beacons, 1°", sigma: degrees(1.0), ..easy }, 1.05),
        (Row { name: "4 beacons, 2°", sigma: degrees(2.0), ..easy }, 1.05),
        (Row { name: "6 beacons, 0.5°", beacons: 6, ..easy }, 1.05),
        (Row { name: "half hidden", hidden: 0.5, ..easy }, 1.05),
        (Row { name: "5 % wild", wild: 0.05, ..easy }, 1.05),
        (Row { name: "half hidden, 10 % wild", hidden: 0.5, wild: 0.1, ..easy }, 1.15),
        (Row { name: "stamps 0.25 s late", late: 0.25, ..easy }, 1.15),
        (Row { name: "stamps 0.5 s late", late: 0.5, ..easy }, 1.15),
        (Row { name: "scale 3 % off", scale: 0.03, ..easy }, 1.15),
        (Row { name: "all together", hidden: 0.5, wild: 0.1, late: 0.5, scale: 0.03, ..easy }, 1.15),
    ]
}

fn searches() -> [Row; 3] {
    let easy = Row { length: 30.0, turn: 0.03, ..Row::EASY };
    [
        Row { name: "6 beacons, 0.5°", beacons: 6, ..easy },
        Row { name: "4 beacons, 0.5°", ..easy },
        Row { name: "4 beacons, all together", hidden: 0.5, wild: 0.1, late: 0.5, scale: 0.03, ..easy },
    ]
}

/// Results of `f` for each seed, on all processors.
fn each<T: Send>(seeds: u64, f: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let workers = std::thread::available_parallelism().map_or(1, |count| count.get() as u64).min(seeds.max(1));
    let part = |worker: u64| (0..seeds).filter(|seed| seed % workers == worker).map(&f).collect::<Vec<T>>();
    std::thread::scope(|scope| {
        let part = &part;
        let handles: Vec<_> = (0..workers).map(|worker| scope.spawn(move || part(worker))).collect();
        handles.into_iter().flat_map(|handle| handle.join().expect("a trial")).collect()
    })
}

fn print_row(row: &Row, goal: f64, seeds: u64) {
    let outcomes = each(seeds, |seed| known(row, seed));
    let mean = |f: fn(&Outcome) -> f64| outcomes.iter().map(f).sum::<f64>() / outcomes.len() as f64;
    let (ours, peer, bound) = (mean(|o| o.ours), mean(|o| o.peer), mean(|o| o.bound));
    let mut ratios: Vec<f64> = outcomes.iter().map(|o| (o.ours / o.bound).sqrt()).collect();
    ratios.sort_by(f64::total_cmp);
    let (low, high) = (ratios[ratios.len() / 20], ratios[ratios.len() - 1 - ratios.len() / 20]);
    let worst = outcomes.iter().map(|o| o.worst).fold(0.0, f64::max);
    let ratio = (ours / bound).sqrt();
    println!(
        "| {} | {:.4} | {:.4} | {ratio:.3} ({low:.2} to {high:.2}) | {goal} | {:.2} | {worst:.2} | {:.3} | {:.2} |",
        row.name,
        bound.sqrt(),
        ours.sqrt(),
        mean(|o| o.nees),
        (mean(|o| o.knowing_nothing) / bound).sqrt(),
        (peer / bound).sqrt()
    );
}

/// Median and maximum; "never" is infinite.
fn spread(mut times: Vec<f64>) -> (f64, f64) {
    times.sort_by(f64::total_cmp);
    (times[times.len() / 2], times[times.len() - 1])
}

fn within(times: &[f64], limit: f64) -> f64 {
    100.0 * times.iter().filter(|time| **time <= limit).count() as f64 / times.len() as f64
}

fn times(all: &[Sought], f: fn(&Sought) -> Option<f64>) -> Vec<f64> {
    all.iter().map(|sought| f(sought).unwrap_or(f64::INFINITY)).collect()
}

fn print_search(row: &Row, seeds: u64) {
    let all = each(seeds, |seed| unknown(row, 10_000 + seed));
    let (found, possible) = (times(&all, |sought| sought.found), times(&all, |sought| sought.enough));
    let first = all.iter().filter(|sought| sought.first_wrong).count();
    let wrong = all.iter().filter(|sought| sought.wrong > 0.0).count();
    let dishonest = all.iter().map(|sought| sought.dishonest).fold(0.0, f64::max);
    let (median, longest) = spread(found.clone());
    println!(
        "| {} | {:.1} % of {seeds} | {:.1} % | {median:.2}, {longest:.2} | {first} | {wrong} | {dishonest:.2} s |",
        row.name,
        within(&found, 5.0),
        within(&possible, 5.0)
    );
}

fn print_kidnapping(row: &Row, how: &str, seeds: u64) {
    let all = each(seeds, |seed| unknown(row, 20_000 + seed));
    let (uneasy, noticed) = (times(&all, |sought| sought.uneasy), times(&all, |sought| sought.noticed));
    let (found, possible) = (times(&all, |sought| sought.found), times(&all, |sought| sought.enough));
    let wrong = all.iter().filter(|sought| sought.wrong > 0.0).count();
    let four = all.iter().filter(|sought| sought.told >= 4).count();
    // The last sighting of a sweep is processed with the odometry after it.
    let limit = SWEEPS + truth::STEP;
    let (uneasy, relied) = (within(&uneasy, limit), within(&noticed, limit));
    let ((notice, latest), (median, longest)) = (spread(noticed), spread(found.clone()));
    println!(
        "| {}, {how} | {uneasy:.1} % of {seeds} | {relied:.1} % | {:.1} % | {notice:.2}, {latest:.2} | {:.1} % | \
         {:.1} % | {median:.2}, {longest:.2} | {wrong} |",
        row.name,
        100.0 * four as f64 / all.len() as f64,
        within(&found, 5.0),
        within(&possible, 5.0)
    );
}

/// Time on one core: a robot with odometry at 20 Hz and six beacons, sighted once a second.
fn print_cost() {
    let row = Row { beacons: 6, length: 600.0, ..Row::EASY };
    let run = truth::run(&row, 1);
    let mut filter = filter(&row, false);
    let begin = std::time::Instant::now();
    for (stamp, measured) in &run.measured {
        match measured {
            truth::Measured::Odometry(rates) => {
                for part in 1..=5 {
                    let _ = filter.odometry(at(stamp - 0.25 + 0.05 * f64::from(part)), *rates);
                    std::hint::black_box(filter.estimate(at(*stamp)));
                }
            }
            truth::Measured::Bearing { .. } => feed(&mut filter, *stamp, measured),
        }
    }
    let spent = begin.elapsed().as_secs_f64();
    println!(
        "{:.2} µs for each way (20 Hz) with an estimate, bearings (six a second) and their re-runs included",
        spent * 1e6 / (row.length * 20.0)
    );
}
