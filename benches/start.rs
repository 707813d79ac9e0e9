//! Cost of the whole simulated robot: `cargo bench --bench start`.
//!
//! Cold start of `advee up --sim` until all modules are in RUN (without homing of the steering); proportional memory of
//! all processes together; their CPU time while the robot stands. Goals: 1 s, 40 MB, 5 % of a core.

#[path = "../advee/tests/support.rs"]
mod support;

use std::fs;
use std::time::Duration;
use support::Robot;

const STARTS: usize = 11;
const IDLE_S: f64 = 10.0;

fn main() {
    let mut starts: Vec<Duration> =
        (0..STARTS).map(|_| Robot::start(&[]).until("all modules RUN", 20.0, support::View::all_run)).collect();
    starts.sort();
    let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
    println!(
        "start to all modules RUN: median {:.0} ms, min {:.0}, max {:.0} ({STARTS} starts)",
        ms(starts[STARTS / 2]),
        ms(starts[0]),
        ms(starts[STARTS - 1])
    );

    let mut robot = Robot::ready(&[]);
    robot.pass(2.0);
    let pids = robot.processes();
    let before = cpu_ticks(&pids);
    robot.pass(IDLE_S);
    let used = (cpu_ticks(&pids) - before) as f64 / ticks_per_second() / IDLE_S;
    println!("{} processes: {:.1} MB PSS together", pids.len(), pss_kib(&pids) as f64 / 1024.0);
    println!("standing: {:.1} % of a core, all processes over {IDLE_S} s", used * 100.0);
    for pid in pids {
        let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let words: Vec<_> = line.split(|byte| *byte == 0).map(String::from_utf8_lossy).collect();
        let name = words.iter().skip_while(|word| **word != "run").nth(1).map_or("up", |word| word);
        println!("  {name:15} {:5.1} MB PSS", pss_kib(&[pid]) as f64 / 1024.0);
    }
}

fn pss_kib(pids: &[u32]) -> u64 {
    let of = |pid: &u32| {
        let text = fs::read_to_string(format!("/proc/{pid}/smaps_rollup")).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("Pss:"));
        line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok()).unwrap_or(0)
    };
    pids.iter().map(of).sum()
}

/// User and system time of all processes, in clock ticks (proc(5), stat, fields 14 and 15).
fn cpu_ticks(pids: &[u32]) -> u64 {
    let of = |pid: &u32| {
        let text = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let after_name = text.rsplit(')').next().unwrap_or_default();
        after_name.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum::<u64>()
    };
    pids.iter().map(of).sum()
}

fn ticks_per_second() -> f64 {
    let ticks = nix::unistd::sysconf(nix::unistd::SysconfVar::CLK_TCK).ok().flatten();
    ticks.unwrap_or(100) as f64
}
