//! Poll cycle of EIA-485 on a pseudo-terminal: `cargo bench -p advee --bench rs485_pty`.
//!
//! Two live hosts as on the robot: a master that polls an SD1 for all its distances as fast as it may, and the
//! simulator with that board, which simulates the wire's time (a pseudo-terminal has none) and answers after 200 us.
//! The bound is that of the wire: the words of request and answer, two words of silence, the board's delay. Goal: 90 %.

use base::{Duration, Instant};
use host::ports::{PortConfig, TerminalConfig};
use host::{HostConfig, run};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, Shell, ShellConfig, State};
use navitools::{Point, Pose};
use nix::sys::pthread::pthread_kill;
use nix::sys::signal::{Signal, raise};
use rs485::boards::sd1;
use rs485::frame::OVERHEAD;
use rs485::master::{Config, Event as Happened, Master};
use rs485::{crc::Crc8, slave, word_time};
use simulator::boards::sd1::Sd1Config;
use simulator::{BoardConfig, BoardKind, SerialConfig, Simulator};
use std::os::unix::thread::JoinHandleExt;
use std::sync::{Arc, Mutex};
use std::thread;

/// Two words of silence (`docs/facts/boards.md` 1).
const TURNAROUND_WORDS: u32 = 2;
const ROUND: Duration = Duration::from_secs(3);
const ROUNDS: usize = 5;

/// Time of each good answer, and number of failed polls.
#[derive(Default)]
struct Log {
    at: Vec<Instant>,
    failed: u64,
}

/// Polls again as soon as it has an answer, until its time is over.
struct Poller {
    ports: [PortSpec; 1],
    master: Master,
    up: bool,
    end: Option<Instant>,
    log: Arc<Mutex<Log>>,
}

impl Module for Poller {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => out.working(),
            Event::Port { input: Input::Up, .. } => {
                self.up = true;
                self.end = Some(now + ROUND);
            }
            Event::Port { input: Input::Words(words), .. } => self.master.handle_rx(now, words),
            Event::Port { input: Input::Sent, .. } => self.master.handle_tx_done(now),
            Event::Timer => {
                self.master.handle_timeout(now);
                if self.end.is_some_and(|end| end <= now) {
                    (self.up, self.end) = (false, None);
                    // To this thread, in which the host runs.
                    raise(Signal::SIGTERM).expect("a signal");
                }
            }
            _ => {}
        }
        while let Some(event) = self.master.poll_event() {
            let mut log = self.log.lock().expect("the log");
            match event {
                Happened::Reply { .. } => log.at.push(now),
                Happened::Silent { .. } | Happened::Garbled { .. } | Happened::Unsent { .. } => log.failed += 1,
                _ => {}
            }
        }
        if self.up && self.master.is_idle() {
            self.master.request(sd1::GET_BOTH_DATA.ask(sd1::FRONT, &[])).expect("idle");
        }
        if let Some(transmit) = self.master.poll_tx(now) {
            out.send_words(PortId(0), transmit.words);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        [self.master.poll_timeout(), self.end].into_iter().flatten().min()
    }
}

fn main() {
    // A first run warms up.
    for baud in [115_200, 921_600] {
        let _ = round(baud);
        let mut rounds: Vec<Round> = (0..ROUNDS).map(|_| round(baud)).collect();
        rounds.sort_by(|a, b| a.share().total_cmp(&b.share()));
        let [least, .., greatest] = &rounds[..] else { return };
        let middle = &rounds[ROUNDS / 2];
        println!(
            "{baud:>7} Bd: {:.3} ms a poll, the wire's bound {:.3} ms: {:.1} % ({:.1} to {:.1} % in {ROUNDS} runs of \
             {} s); median poll {:.3} ms, {:.1} %; {} polls failed",
            middle.mean_ms,
            middle.bound_ms,
            middle.share(),
            least.share(),
            greatest.share(),
            ROUND.as_secs(),
            middle.median_ms,
            100.0 * middle.bound_ms / middle.median_ms,
            rounds.iter().map(|round| round.failed).sum::<u64>(),
        );
    }
}

/// Module in a separate host, on an LCM bus without other participants.
fn host(name: &str, module: Box<dyn Module>, port: PortConfig, lcm: u16) {
    let mut config = ShellConfig::new(name);
    config.wanted = State::Run;
    let lcm_url = format!("udpm://239.255.76.67:{}?ttl=0", 30_000 + 4 * (std::process::id() as u16 % 5000) + lcm);
    let place = HostConfig {
        lcm_url,
        ports: vec![port],
        raw: Vec::new(),
        policy: module::admission::Policy::default(),
        launch: None,
        beats: None,
        inputs: None,
    };
    run(Shell::new(config, module), place).expect("a host");
}

/// Robot with one SD1, of eight sonars and two floor sensors.
fn simulator(baud: u32) -> Simulator {
    let sd1 = Sd1Config {
        srfs: (0..sd1::SRFS).map(|n| Pose::new(0.7, 0.0, n as f64)).collect(),
        irs: vec![Point { x: 0.7, y: 0.3 }, Point { x: 0.7, y: -0.3 }],
    };
    let boards = vec![BoardConfig { name: "sd1_front".into(), address: sd1::FRONT, kind: BoardKind::Sd1(sd1) }];
    let serial = vec![SerialConfig { bus: "rs485.a".into(), baud, crc: Crc8::SAE_J1850, real: false, boards }];
    Simulator::new(simulator::Config { serial, wire_time: true, ..simulator::Config::default() })
}

struct Round {
    mean_ms: f64,
    median_ms: f64,
    bound_ms: f64,
    failed: u64,
}

impl Round {
    fn share(&self) -> f64 {
        100.0 * self.bound_ms / self.mean_ms
    }
}

fn round(baud: u32) -> Round {
    let link = std::env::temp_dir().join(format!("advee-bench-pty-{}-{baud}", std::process::id()));
    let simulator = {
        let link = link.clone();
        thread::spawn(move || host("simulator", Box::new(simulator(baud)), PortConfig::Pseudo { link, baud }, 1))
    };
    while !link.exists() {
        thread::yield_now();
    }
    let log = Arc::new(Mutex::new(Log::default()));
    let poller = Poller {
        ports: [PortSpec { bus: "rs485.a".into(), line: Line::Serial { baud } }],
        master: Master::new(Config { baud, ..Config::default() }),
        up: false,
        end: None,
        log: log.clone(),
    };
    host("poller", Box::new(poller), PortConfig::Terminal(TerminalConfig::new(link, baud)), 2);
    pthread_kill(simulator.as_pthread_t(), Signal::SIGTERM).expect("the simulator runs");
    simulator.join().expect("the simulator ends in good order");
    let log = log.lock().expect("the log");
    let mut cycles: Vec<f64> = log.at.windows(2).map(|pair| pair[1].since(pair[0]).as_secs_f64() * 1e3).collect();
    let mean_ms = cycles.iter().sum::<f64>() / cycles.len() as f64;
    cycles.sort_by(f64::total_cmp);
    let words = 2 * OVERHEAD + 2 + 2 * sd1::SRFS + sd1::IRS;
    let wire = word_time(baud) * (words as u32 + TURNAROUND_WORDS) + slave::Config::new(sd1::FRONT).delay;
    Round { mean_ms, median_ms: cycles[cycles.len() / 2], bound_ms: wire.as_secs_f64() * 1e3, failed: log.failed }
}
