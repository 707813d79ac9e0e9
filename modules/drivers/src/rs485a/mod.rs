//! Bus A: the distance boards BR-SD1 and the odometry board BR-SO1.
//!
//! Device    `docs/facts/boards.md` 3, 4
//! Protocol  the 9-bit EIA-485 of `rs485`; boards ask nothing, they are asked
//! Timing    each board on its own grid (2011: 4 Hz), firmware versions in between
//! Silence   after 16 failed transactions a board is lost: reported, asked once a second, its data invalid
//! Data      `LL_DATA_SRFS` and `LL_DATA_IRS` once a round, when all boards have spoken; `LL_DATA_ODO` with each answer
//!           of the SO1; `LL_DATA_BUS` once a second. Timestamps are those of the answer's reception
//!
//! In STOP it asks nothing. It works while one board at least answers: a lost one is reported, all lost is an ERROR.

mod answers;
mod config;
mod odometry;
mod ranges;

pub use config::{Config, ConfigError, Kind, Node, Ranger, Wheels};

use base::{Duration, Fault, Instant, Severity, Ticker};
use messages::lowlevel::{DataBus, Node as NodeMessage};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, State};
use odometry::Follower;
use ranges::Ranges;
use rs485::boards::{GET_VERSION, Instruction, sd1, so1};
use rs485::master::{self, Master, NODES_MAX};
use rs485::node::{Health, RoundTrips};
use rs485::schedule::{Schedule, Turn};
use rs485::word_time;

const PORT: PortId = PortId(0);
/// How often `LL_DATA_BUS` is sent.
const STATISTICS: Duration = Duration::from_secs(1);

/// The driver of bus A.
#[derive(Debug)]
pub struct Rs485a {
    bus: String,
    baud: u32,
    boards: Vec<Board>,
    ports: [PortSpec; 1],
    master: Master,
    schedule: Schedule<NODES_MAX>,
    ranges: Ranges,
    odometry: Follower,
    /// Jumps of the counters since they were told, and until when none is.
    jumps: u32,
    jumps_quiet: Instant,
    state: State,
    /// None until the host has said.
    up: Option<bool>,
    /// A request could not be sent, and none was since.
    stuck: bool,
    /// What the shell was told last: whether it works.
    working: Option<bool>,
    statistics: Ticker,
    /// Words that had crossed the wire when statistics were sent last.
    words: u64,
}

#[derive(Debug)]
struct Board {
    node: Node,
    /// Since the port is up.
    answered: bool,
    /// Answers in a row that said it did not do what it was asked.
    refusals: u32,
    implausible: bool,
    /// What was wrong the last time that it failed, for people.
    fails: &'static str,
}

impl Board {
    fn new(node: Node) -> Self {
        Self { node, answered: false, refusals: 0, implausible: false, fails: "" }
    }
}

impl Rs485a {
    /// A driver that has not started.
    ///
    /// # Errors
    /// When the configuration cannot be.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        let mut master =
            Master::new(master::Config { baud: config.baud, crc: config.crc, ..master::Config::default() });
        for node in &config.nodes {
            master.add_node(node.address, node.timeout);
        }
        Ok(Self {
            ports: [PortSpec { bus: config.bus.clone(), line: Line::Serial { baud: config.baud } }],
            bus: config.bus.clone(),
            baud: config.baud,
            master,
            schedule: Schedule::new(),
            ranges: Ranges::new(&config),
            odometry: Follower::new(&config.wheels),
            jumps: 0,
            jumps_quiet: Instant::ZERO,
            state: State::Init,
            up: None,
            stuck: false,
            working: None,
            statistics: Ticker::new(Instant::NEVER, STATISTICS),
            words: 0,
            boards: config.nodes.into_iter().map(Board::new).collect(),
        })
    }

    fn on_port(&mut self, now: Instant, input: &Input<'_>, out: &mut Actions) {
        match input {
            Input::Up => {
                self.up = Some(true);
                out.clear(Fault::PortDown, self.bus.as_str(), format!("{} is up", self.bus));
                self.schedule = Schedule::new();
                for Board { node, .. } in &self.boards {
                    let turn = Turn { to: node.address, instruction: poll_of(node.kind).code };
                    self.schedule.poll(now, Duration::from_secs_f64(1.0 / node.rate_hz), turn);
                    if self.master.health(node.address) == Health::Lost {
                        self.schedule.lost(now, node.address);
                    }
                    self.schedule.demand(version_of(node.address));
                }
            }
            Input::Down(why) => {
                self.up = Some(false);
                let message = format!("{} is down: {why}; tried again", self.bus);
                out.raise(Severity::Error, Fault::PortDown, self.bus.as_str(), message);
                self.master.cancel();
                self.ranges.forget();
                self.boards.iter_mut().for_each(|board| board.answered = false);
            }
            Input::Words(words) => self.master.handle_rx(now, words),
            Input::Sent => self.master.handle_tx_done(now),
            Input::Can(_) => {}
        }
    }

    /// Whether boards are asked: not in STOP, but in ERROR, to find out when it is over.
    fn asks(&self) -> bool {
        self.up == Some(true) && !matches!(self.state, State::Stop | State::Terminate)
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.master.poll_event() {
            self.on_event(now, &event, out);
        }
        if self.asks()
            && self.master.is_idle()
            && let Some(Turn { to, instruction }) = self.schedule.due(now)
            && let Some(board) = self.boards.iter().find(|board| board.node.address == to)
        {
            let instruction = if instruction == GET_VERSION.code { GET_VERSION } else { poll_of(board.node.kind) };
            // Idle, and without data: never refused.
            let _ = self.master.request(instruction.ask(to, &[]));
        }
        if let Some(transmit) = self.master.poll_tx(now) {
            out.send_words(PORT, transmit.words);
        }
        self.judge(out);
    }

    /// Tells the shell whether the module can work, when that has changed.
    fn judge(&mut self, out: &mut Actions) {
        let lost = |board: &Board| self.master.health(board.node.address) == Health::Lost;
        let working = match self.up {
            None => return,
            Some(false) => false,
            Some(true) if self.boards.iter().any(|board| board.answered && !lost(board)) => true,
            Some(true) if self.boards.iter().all(lost) => false,
            Some(true) => return,
        };
        if self.working.replace(working) != Some(working) {
            if working { out.working() } else { out.failed() }
        }
    }

    fn publish_statistics(&mut self, now: Instant, out: &mut Actions) {
        let bus = self.master.bus_statistics();
        let busy = word_time(self.baud).as_secs_f64() * (bus.words - self.words) as f64;
        self.words = bus.words;
        let nodes = self.boards.iter().map(|board| node_message(&mut self.master, &board.node)).collect();
        out.publish(DataBus {
            timestamp: out.timestamp(now),
            bus: self.bus.clone(),
            load: (busy / STATISTICS.as_secs_f64()).min(1.0),
            frames: count(bus.frames),
            errors: count(bus.errors),
            state: if self.up == Some(true) { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes,
        });
    }

    /// A board's name for reports' subjects, and for people: name, address, bus.
    fn name(&self, address: u8) -> (String, String) {
        let board = self.boards.iter().find(|board| board.node.address == address);
        let name = board.map_or("board", |board| &board.node.name);
        (name.to_owned(), format!("{name} ({address:#04x} on {})", self.bus))
    }
}

impl Module for Rs485a {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.statistics = Ticker::new(now + STATISTICS, STATISTICS),
            Event::Port { port: PORT, input } => self.on_port(now, &input, out),
            Event::State(state) => self.state = state,
            Event::Timer => {
                self.master.handle_timeout(now);
                if self.statistics.due(now) {
                    self.publish_statistics(now, out);
                }
            }
            Event::Port { .. } | Event::Message { .. } | Event::Process(_) => {}
        }
        self.drain(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let turn = if self.asks() && self.master.is_idle() { self.schedule.next() } else { None };
        [self.master.poll_timeout(), turn, Some(self.statistics.next())].into_iter().flatten().min()
    }
}

const fn poll_of(kind: Kind) -> Instruction {
    match kind {
        Kind::Sd1 => sd1::GET_BOTH_DATA,
        Kind::So1 => so1::GET_TICKS,
    }
}

const fn version_of(address: u8) -> Turn {
    Turn { to: address, instruction: GET_VERSION.code }
}

fn node_message(master: &mut Master, node: &Node) -> NodeMessage {
    let recent = master.take_recent(node.address);
    let health = master.health(node.address);
    let statistics = master.statistics(node.address).copied().unwrap_or_default();
    let seconds = |time: fn(&RoundTrips) -> Option<Duration>| time(&recent).map_or(f64::NAN, |time| time.as_secs_f64());
    NodeMessage {
        name: node.name.clone(),
        address: i32::from(node.address),
        state: health as i32,
        requests: count(statistics.requests),
        retries: count(statistics.retries),
        timeouts: count(statistics.timeouts),
        crc_errors: count(statistics.crc_errors),
        round_trip_min: seconds(RoundTrips::min),
        round_trip_mean: seconds(RoundTrips::mean),
        round_trip_max: seconds(RoundTrips::max),
    }
}

fn count(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests;
