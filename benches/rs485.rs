//! EIA-485 engine: `cargo bench -p rs485 --bench rs485`.
//!
//! Poll cycle of bus A (two SD1, one SO1, polled as fast as possible) in virtual wire time, compared with the wire's
//! limit: the words of requests and answers, two words of turnaround before each request, and the boards' answer delay
//! of 200 us. Goal: 95 %. Then the CPU time of one transaction in the master and its schedule, with all calls of a
//! driver, and its allocations. Goals: 2 us, no allocation.

#[path = "sys.rs"]
mod sys;

use base::serial::Word;
use base::{Duration, Instant};
use rs485::boards::{Instruction, sd1, so1};
use rs485::frame::{OVERHEAD, Status};
use rs485::master::{Config, Event, Master};
use rs485::schedule::{Schedule, Turn};
use rs485::slave::{self, Slave};
use rs485::word_time;
use std::hint::black_box;

#[global_allocator]
static MEMORY: sys::Counting = sys::Counting::new();

const BOARDS: [u8; 3] = [sd1::FRONT, sd1::REAR, so1::ADDRESS];
const DELAY: Duration = Duration::from_micros(200);
const TRANSACTIONS: u32 = 300_000;
const ROUNDS: usize = 9;

fn main() {
    for baud in [115_200, 921_600] {
        poll_cycle(baud);
    }
    for (name, board) in [("SD1, 20 bytes", sd1::FRONT), ("SO1, 4 bytes", so1::ADDRESS)] {
        engine(name, board);
    }
}

const fn poll_of(board: u8) -> Instruction {
    if board == so1::ADDRESS { so1::GET_TICKS } else { sd1::GET_BOTH_DATA }
}

fn answer_of(board: u8) -> Vec<u8> {
    if board == so1::ADDRESS {
        return so1::build_ticks(&[1000, -1000].into_iter().collect()).to_vec();
    }
    sd1::Both { srfs: (0..8).map(|n| 500 + n).collect(), irs: [120, 121].into_iter().collect() }.build().to_vec()
}

fn master(baud: u32) -> (Master, Schedule<3>) {
    let mut master = Master::new(Config { baud, ..Config::default() });
    let mut schedule = Schedule::new();
    for board in BOARDS {
        assert!(master.add_node(board, Duration::from_millis(20)));
        let turn = Turn { to: board, instruction: poll_of(board).code };
        assert!(schedule.poll(Instant::ZERO, Duration::from_micros(1), turn));
    }
    (master, schedule)
}

fn poll_cycle(baud: u32) {
    const CYCLES: u32 = 1000;
    let word = word_time(baud);
    let (mut master, mut schedule) = master(baud);
    let mut boards =
        BOARDS.map(|address| Slave::new(slave::Config { baud, delay: DELAY, ..slave::Config::new(address) }));
    let mut now = Instant::ZERO;
    let mut answered = 0;
    for _ in 0..CYCLES * BOARDS.len() as u32 {
        let turn = schedule.due(now).expect("every poll is due");
        master.request(poll_of(turn.to).ask(turn.to, &[])).expect("the master is idle");
        now = now.max(master.poll_timeout().expect("a request waits for silence"));
        master.handle_timeout(now);
        let request = master.poll_tx(now).expect("the wire is silent").words.to_vec();
        now += word * request.len() as u32;
        master.handle_tx_done(now);
        let board = boards.iter_mut().find(|board| board.config().address == turn.to).expect("a board that is polled");
        board.handle_rx(now, &request);
        board.poll_request().expect("the request arrives");
        board.respond(Status::Ok, &answer_of(turn.to));
        now = board.poll_timeout().expect("it owes an answer");
        let answer = board.poll_tx(now).expect("the answer is due").words.to_vec();
        for heard in answer {
            now += word;
            master.handle_rx(now, &[heard]);
        }
        answered += u32::from(matches!(master.poll_event(), Some(Event::Reply { status: Status::Ok, .. })));
    }
    let words: usize = BOARDS.iter().map(|board| 2 + OVERHEAD + OVERHEAD + answer_of(*board).len()).sum();
    let bound = (word * words as u32 + DELAY * BOARDS.len() as u32).as_secs_f64();
    let cycle = now.since(Instant::ZERO).as_secs_f64() / f64::from(CYCLES);
    println!(
        "poll cycle of bus A at {baud:6} Bd: {:.3} ms, {:.2} % of the wire's limit ({answered} of {} answered)",
        cycle * 1e3,
        100.0 * bound / cycle,
        CYCLES * BOARDS.len() as u32,
    );
}

/// CPU time of a transaction: the calls of a driver, with the answer in one read.
fn engine(name: &str, board: u8) {
    let (mut master, mut schedule) = master(115_200);
    let mut slave = Slave::new(slave::Config::new(board));
    let mut request = rs485::frame::Words::new();
    rs485::frame::Frame { address: board, instruction: poll_of(board).code, flags: 0, data: &[] }
        .encode(Config::default().crc, &mut request);
    slave.handle_rx(Instant::ZERO, &request);
    slave.poll_request().expect("a request");
    slave.respond(Status::Ok, &answer_of(board));
    let answer: Vec<Word> = slave.poll_tx(Instant::NEVER).expect("an answer").words.to_vec();
    let mut now = Instant::ZERO;
    let mut run = |transactions: u32| {
        for _ in 0..transactions {
            black_box(schedule.due(now));
            master.request(poll_of(board).ask(board, &[])).expect("the master is idle");
            now = now.max(master.poll_timeout().expect("a request waits for silence"));
            master.handle_timeout(now);
            black_box(master.poll_tx(now).expect("the request is due").words.len());
            now += Duration::from_micros(500);
            master.handle_tx_done(now);
            black_box(master.poll_timeout());
            now += Duration::from_millis(3);
            master.handle_rx(now, black_box(&answer));
            let Some(Event::Reply { status: Status::Ok, data, .. }) = black_box(master.poll_event()) else {
                panic!("no answer");
            };
            black_box(data);
            assert!(master.poll_event().is_none());
        }
    };
    run(1000);
    let before = MEMORY.allocations();
    run(1000);
    let allocations = MEMORY.allocations() - before;
    let mut rounds: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let begin = sys::cpu_ns();
            run(TRANSACTIONS);
            (sys::cpu_ns() - begin) as f64 / f64::from(TRANSACTIONS)
        })
        .collect();
    rounds.sort_by(f64::total_cmp);
    println!(
        "engine, a transaction with an {name}: {:.0} ns of CPU (median of {ROUNDS} rounds), {allocations} \
         allocations in 1000",
        rounds[ROUNDS / 2]
    );
}
