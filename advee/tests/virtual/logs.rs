//! Logger beside the whole robot, on a disk that loses unsynchronized data in a power cut.

use super::{at, place};
use base::{Duration, Epoch, Instant};
use logger::recover::recover;
use mcap::MessageStream;
use module::State;
use robot::topology::virtual_machine_logged;
use sim::host::{Config, Disk, Virtual};
use std::io::Cursor;

const EPOCH_US: i64 = 1_795_302_110_000_000;

fn machine(seed: u64) -> Virtual {
    let config = Config { seed, epoch: Epoch { offset_us: EPOCH_US }, ..Config::default() };
    let mut machine = virtual_machine_logged(&place(), config).unwrap();
    machine.spawn("watchdog", State::Run).unwrap();
    machine
}

/// Log time and topic of every message left on a disk.
fn left(disk: &Disk) -> Vec<(Instant, String)> {
    let mut left = Vec::new();
    for file in disk.files.values() {
        let mut whole = Vec::new();
        let report = recover(Cursor::new(&file.bytes), &mut whole, &mut |_, _| {}).unwrap();
        let before = left.len();
        for message in MessageStream::new(&whole).unwrap() {
            let message = message.unwrap();
            let since = message.log_time - EPOCH_US as u64 * 1000;
            left.push((Instant::from_nanos(since), message.channel.topic.clone()));
        }
        assert_eq!(report.messages, (left.len() - before) as u64);
    }
    left
}

#[test]
fn a_power_cut_costs_the_robot_s_log_a_quarter_of_a_second() {
    for seed in 1..=5 {
        let mut machine = machine(seed);
        let cut = at(4.0 + 0.137 * seed as f64);
        machine.run_until(cut);
        let disk = machine.disk("log").unwrap();
        disk.cut();
        let messages = left(disk);
        let last = messages.last().unwrap().0;
        assert!(cut.since(last) <= Duration::from_millis(260), "{:?} are lost", cut.since(last));
        for topic in ["LL_DATA_ODO", "/LL_DATA_ODO", "/odometry", "/tf", "CM_DATA_PROCESSES"] {
            assert!(messages.iter().any(|(_, of)| of == topic), "{topic}");
        }
    }
}
