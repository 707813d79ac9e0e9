//! Bit-banged I2C master: `cargo bench -p i2c --bench i2c`.
//!
//! SMBus reads per second in virtual time, compared with the bound of UM10204 table 10 (`docs/i2c.md`): 36 clocks at
//! the mode's frequency and the minimum times of START, repeated START, STOP and the free bus. Goal: 95 %. Pin
//! operations compared with the minimum of the protocol: the same goal. Then the CPU time of a step, the time of a
//! round with the fan controller, and allocations. Goal: no allocation.

#[path = "sys.rs"]
mod sys;

use base::i2c::{Address, Bytes, Read, Transfer};
use base::{Duration, Instant};
use i2c::bitbang::{Config, Levels, Master, Pins};
use i2c::max6615::chip::Chip;
use i2c::max6615::{self, Event, Max6615, register};
use i2c::wire::Wire;
use std::hint::black_box;

#[global_allocator]
static MEMORY: sys::Counting = sys::Counting::new();

const READS: u32 = 10_000;
const ROUNDS: usize = 9;

/// Mode of UM10204 table 10: clock, then t_HD;STA, t_LOW, t_SU;STA, t_SU;STO, t_BUF in ns.
struct Mode {
    hz: u32,
    hold_start: u64,
    low: u64,
    set_up_start: u64,
    set_up_stop: u64,
    free: u64,
}

const MODES: [Mode; 3] = [
    Mode { hz: 100_000, hold_start: 4000, low: 4700, set_up_start: 4700, set_up_stop: 4000, free: 4700 },
    Mode { hz: 400_000, hold_start: 600, low: 1300, set_up_start: 600, set_up_stop: 600, free: 1300 },
    Mode { hz: 1_000_000, hold_start: 260, low: 500, set_up_start: 260, set_up_stop: 260, free: 500 },
];

fn main() {
    for mode in &MODES {
        reads(mode);
    }
    operations();
    round();
    steps();
}

fn address() -> Address {
    Address::new(max6615::ADDRESS).expect("seven bits")
}

fn wire() -> Wire<Chip> {
    Wire::new(Chip::new(address(), [2400.0; 2]))
}

fn read_of(register: u8) -> Transfer {
    Transfer { address: address(), write: [register].into_iter().collect(), read: Read::Exactly(1) }
}

/// Runs a transfer in virtual time.
fn run(master: &mut Master, wire: &mut Wire<Chip>, now: &mut Instant, transfer: Transfer) -> Bytes {
    master.request(*now, transfer).expect("the master is idle");
    while let Some(at) = master.poll_timeout() {
        *now = at;
        wire.advance(at);
        let levels = if master.wants_levels() { wire.get().expect("levels") } else { Levels::HIGH };
        if let Some(lines) = master.handle_timeout(at, levels) {
            wire.drive(lines);
        }
    }
    master.poll_event().expect("an outcome").expect("the chip answers")
}

fn reads(mode: &Mode) {
    let (mut master, mut wire) = (Master::new(Config { hz: mode.hz, ..Config::default() }), wire());
    let mut now = Instant::ZERO;
    for _ in 0..READS {
        assert_eq!(run(&mut master, &mut wire, &mut now, read_of(register::DEVICE))[..], [max6615::DEVICE]);
    }
    let took = now.since(Instant::ZERO).as_secs_f64() / f64::from(READS);
    let around = 2 * mode.hold_start + 2 * mode.low + mode.set_up_start + mode.set_up_stop + mode.free;
    let bound = 36.0 / f64::from(mode.hz) + around as f64 * 1e-9;
    println!(
        "SMBus read byte at {:4} kHz: {:.1} a second, {:.2} % of the bound",
        mode.hz / 1000,
        1.0 / took,
        100.0 * bound / took
    );
}

/// Pin writes and reads of a register read compared with the minimum: START 1 + 1, nine clocks of two edges and a read
/// each for a byte and its ACK, SDA's changes, repeated START 3 + 1, STOP 4 + 1.
fn operations() {
    let (mut master, mut wire) = (Master::new(Config::default()), wire());
    let mut now = Instant::ZERO;
    run(&mut master, &mut wire, &mut now, read_of(register::DEVICE));
    let change = |bytes: &[u8]| {
        let bits = bytes.iter().flat_map(|byte| (0..8).map(move |bit| byte << bit & 0x80 != 0).chain([true]));
        bits.fold((false, 0), |(sda, changes), bit| (bit, changes + u32::from(sda != bit))).1
    };
    // Address and register; address with the read bit, and a byte whose bits are the target's.
    let changes = change(&[address().get() << 1, register::DEVICE]) + change(&[address().get() << 1 | 1]);
    let (sets, gets) = (1 + 36 * 2 + changes + 3 + 4, 1 + 36 + 1 + 1);
    println!(
        "pin operations of a read: {} edges, {} looks; the least: {sets} edges, {gets} looks; {:.2} a byte of four",
        wire.sets,
        wire.gets,
        f64::from(wire.sets + wire.gets) / 4.0
    );
}

fn round() {
    let (mut master, mut wire, mut now) = (Master::new(Config::default()), wire(), Instant::ZERO);
    let mut driver = Max6615::new(max6615::Config::new(address())).expect("a valid configuration");
    for name in ["configuration and round", "round"] {
        let begun = now;
        driver.begin();
        let mut transfers = 0;
        while let Some(transfer) = driver.poll_transfer() {
            let bytes = run(&mut master, &mut wire, &mut now, transfer);
            driver.handle_outcome(&Ok(bytes));
            transfers += 1;
        }
        assert!(std::iter::from_fn(|| driver.poll_event()).any(|event| matches!(event, Event::Reading(_))));
        let took = now.since(begun).as_secs_f64() * 1e3;
        println!("fan controller, {name}: {transfers} transfers, {took:.2} ms of the wire at 100 kHz");
        now += Duration::from_secs(1);
    }
}

/// CPU time of a step of the master alone: the recorded inputs of a wire, replayed.
fn steps() {
    let (mut master, mut wire, mut now) = (Master::new(Config::default()), wire(), Instant::ZERO);
    let mut seen = vec![];
    master.request(now, read_of(register::DEVICE)).expect("the master is idle");
    while let Some(at) = master.poll_timeout() {
        wire.advance(at);
        seen.push(wire.levels());
        if let Some(lines) = master.handle_timeout(at, wire.levels()) {
            wire.drive(lines);
        }
        now = at;
    }
    assert!(master.poll_event().expect("an outcome").is_ok());
    let mut read = || {
        master.request(now, black_box(read_of(register::DEVICE))).expect("the master is idle");
        for levels in &seen {
            now = master.poll_timeout().expect("a transfer under way");
            black_box(master.wants_levels());
            black_box(master.handle_timeout(now, black_box(*levels)));
        }
        assert!(black_box(master.poll_event()).expect("an outcome").is_ok());
    };
    let before = MEMORY.allocations();
    (0..1000).for_each(|_| read());
    let allocations = MEMORY.allocations() - before;
    let mut rounds: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let begin = sys::cpu_ns();
            (0..READS).for_each(|_| read());
            (sys::cpu_ns() - begin) as f64 / (f64::from(READS) * seen.len() as f64)
        })
        .collect();
    rounds.sort_by(f64::total_cmp);
    println!(
        "engine: {:.1} ns of CPU a step (median of {ROUNDS} rounds), {} steps a read, {allocations} allocations in \
         1000 reads",
        rounds[ROUNDS / 2],
        seen.len()
    );
}
