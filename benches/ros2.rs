//! ROS 2 at the robot's wheels, and the network at its control loop: `cargo bench -p advee --bench ros2`.
//!
//! The simulated courier, in an empty world, as a node of ROS 2 that may be commanded:
//!
//! - `latency`: from the publication of a changed velocity until it is in a drive's set-point on the CAN bus, by
//!   `/cmd_vel` and by `LL_CMD_VELOCITY` over LCM, in blocks of 100 that take turns by chance. `/cmd_vel` is published
//!   by the crate `rtps` in this process and, where `tools/venv` has installed it, by rclpy. Goal: p99 of the former at
//!   most 3 ms above that of LCM.
//! - `silence`: the publisher ends at speed, without a word; time from its last command until the stop has begun on the
//!   CAN bus. Goal: 300 ms.
//! - `flood`: 50 000 datagrams/s of RTPS, one half discovery, one half malformed, from a core in another network
//!   namespace; at the port of `ros2`, and at a closed port of the same address, in pairs. Judged are the period of
//!   `LL_DATA_VELOCITY` and the latency of `LL_CMD_VELOCITY`. Goal: p99 at most 1.1 times that at the closed port.
//!   Needs root.
//!
//! Times on the CAN bus are those at which the kernel received the frames. Environment: SAMPLES (1000) for each way,
//! TIMES (50) of silence, PAIRS (10) of floods with SECONDS (5) each, SEED. ONLY: one of the three names.

#[allow(dead_code, reason = "the other bench judges the frames itself")]
#[path = "faults/can.rs"]
mod can;
#[path = "ros2/figures.rs"]
mod figures;
#[path = "ros2/flood.rs"]
mod flood;
// The hosts come from the tests of the crate that implements the bus.
#[path = "../foundation/lcm/tests/common/hosts.rs"]
mod hosts;
#[path = "ros2/publisher.rs"]
mod publisher;
#[path = "ros2/rig.rs"]
mod rig;
#[path = "../advee/tests/support.rs"]
mod support;

use figures::{Samples, verdict};
use rig::{Rig, Way};
use std::ops::Range;
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::time::Duration;
use testing::Random;

/// First argument of the process with a network namespace of its own.
const WITHIN: &str = "within";
/// Commands of one way until the next one has its turn.
const BLOCK: usize = 100;
/// Time between two commands, µs.
const SPACING: Range<u64> = 20_000..60_000;
/// Bounds, ms: p99 above that of LCM; until a stop has begun.
const ABOVE_MS: f64 = 3.0;
const STOP_MS: f64 = 300.0;

fn main() {
    let given = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let count = |name: &str, usual: usize| given(name).map_or(usual, |count| count as usize);
    let only = std::env::var("ONLY").unwrap_or_default();
    let wanted = |name: &str| only.is_empty() || only == name;
    let seed = given("SEED").unwrap_or(1);
    if std::env::args().nth(1).is_some_and(|argument| argument == WITHIN) {
        let time = Duration::from_secs(given("SECONDS").unwrap_or(5));
        return flood::print(&flood::measure(count("PAIRS", 10), time, seed));
    }
    if wanted("latency") {
        measure_latency(count("SAMPLES", 1000), seed);
    }
    if wanted("silence") {
        measure_silence(count("TIMES", 50), seed);
    }
    if wanted("flood") {
        enter();
    }
}

/// Continues in a network namespace of its own.
fn enter() {
    if let Err(why) = flood::may() {
        println!("\nflood: skipped: {why}");
        return;
    }
    let me = std::env::current_exe().expect("my own path");
    let error = Command::new("unshare").arg("-n").arg(me).arg(WITHIN).exec();
    panic!("unshare: {error}");
}

fn measure_latency(count: usize, seed: u64) {
    let mut rig = Rig::start(seed, &[]);
    let mut rows = vec![(Way::Lcm, Samples::default()), (Way::Rtps, Samples::default())];
    match rig.start_rclpy() {
        Ok(()) => rows.push((Way::Rclpy, Samples::default())),
        Err(why) => println!("rclpy: skipped: {why}"),
    }
    rig.join();
    let mut random = Random::new(seed);
    let rounds = count.div_ceil(BLOCK);
    for round in 1..=rounds {
        for end in (1..rows.len()).rev() {
            rows.swap(end, random.index(end + 1));
        }
        for (way, row) in &mut rows {
            rig.begin(*way);
            let block = rig.drive(*way, SPACING, |number| number < BLOCK);
            rig.leave(*way);
            eprintln!("round {round} of {rounds}: {way:?}: p50 {:.2}, p99 {:.2} ms", block.at(0.5), block.at(0.99));
            row.append(&block);
        }
    }
    rig.end_publishers();
    rows.sort_by_key(|(way, _)| *way);
    print_latency(&rows);
}

fn print_latency(rows: &[(Way, Samples)]) {
    println!("\n| from a changed velocity to the wheel | samples | p50, ms | p99, ms | max, ms | not answered |");
    println!("|---|---|---|---|---|---|");
    for (way, row) in rows {
        let what = match way {
            Way::Lcm => "`LL_CMD_VELOCITY` over LCM",
            Way::Rtps => "`/cmd_vel`, published by the crate `rtps`",
            Way::Rclpy => "`/cmd_vel`, published by rclpy",
        };
        let [p50, p99, max] = [0.5, 0.99, 1.0].map(|share| row.at(share));
        println!("| {what} | {} | {p50:.2} | {p99:.2} | {max:.2} | {} |", row.ms.len(), row.lost);
    }
    let p99 = |wanted: Way| rows.iter().find(|(way, _)| *way == wanted).map_or(f64::NAN, |(_, row)| row.at(0.99));
    let above = p99(Way::Rtps) - p99(Way::Lcm);
    println!("\np99 of `/cmd_vel` above that of LCM: {above:.2} ms, goal {ABOVE_MS}: {}", verdict(above, ABOVE_MS));
}

fn measure_silence(times: usize, seed: u64) {
    let mut rig = Rig::start(seed, &[]);
    let mut row = Samples::default();
    for time in 1..=times {
        match rig.fall_silent() {
            Some(took) => {
                eprintln!("silence {time} of {times}: {:.1} ms", took.as_secs_f64() * 1e3);
                row.add(took);
            }
            None => row.lost += 1,
        }
    }
    // A stop that did not come is not within the bound.
    let worst = if row.lost == 0 { row.at(1.0) } else { f64::INFINITY };
    println!("\n| `/cmd_vel` falls silent at speed | times | p50, ms | p100, ms | goal |");
    println!("|---|---|---|---|---|");
    let (count, word) = (row.ms.len() + row.lost, verdict(worst, STOP_MS));
    println!("| until the stop has begun | {count} | {:.0} | {worst:.0} | {STOP_MS:.0}: {word} |", row.at(0.5));
}
