//! Bus A: the distance boards BR-SD1 and the odometry board BR-SO1.
//!
//! Device    `docs/facts/boards.md` 3, 4
//! Protocol  the 9-bit EIA-485 of `rs485`; boards ask nothing, they are asked
//! Timing    each board on its own grid (2011: 4 Hz), firmware versions in between
//! Silence   after 16 failed transactions a board is lost: reported, asked once a second, its data invalid
//! Data      `LL_DATA_RANGES` once a round, when all boards have answered or failed, and at least once a second: each
//!           reading with the instant at which its transducer fired, and UNKNOWN where its board did not answer well.
//!           `LL_DATA_SRFS` and `LL_DATA_IRS` once a round, the view of 2011; `LL_DATA_ODO` with each answer of the SO1;
//!           `LL_DATA_BUS` once a second. Timestamps of these are those of the answer's reception
//! PAUSE     an SD1 that saw no floor holds the PAUSE line by itself; it lets go when a person commands RUN
//!
//! In STOP it asks nothing. It works while one board at least answers: a lost one is reported, all lost is an ERROR.

mod answers;
mod config;
mod odometry;
mod ranges;

pub use config::{Config, ConfigError, Ranger, Wheels};

use crate::line::{self, Line, PORT};
use crate::rs485_bus::{Kind, Node};
use base::{Duration, Instant};
use messages::{Channel, Message, common::CmdState};
use module::{Actions, Event, Module, PortSpec, State};
use odometry::Follower;
use ranges::Ranges;
use rs485::boards::{Instruction, sd1, so1};
use rs485::master;

/// The module's name.
pub const NAME: &str = "driver_rs485a";

/// The driver of bus A.
#[derive(Debug)]
pub struct Rs485a {
    nodes: Vec<Node>,
    ports: [PortSpec; 1],
    line: Line,
    ranges: Ranges,
    /// When `LL_DATA_RANGES` is published though no board has answered.
    repeat: Instant,
    odometry: Follower,
    /// Jumps of the counters since they were told, and until when none is.
    jumps: u32,
    jumps_quiet: Instant,
}

impl Rs485a {
    /// A driver that has not started.
    ///
    /// # Errors
    /// When the configuration cannot be.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        let bus = master::Config { baud: config.baud, crc: config.crc, ..master::Config::default() };
        let line = Line::new(&config.bus, bus, config.nodes.iter().map(board).collect());
        Ok(Self {
            ports: [line.port()],
            line,
            ranges: Ranges::new(&config),
            repeat: Instant::NEVER,
            odometry: Follower::new(&config.wheels),
            jumps: 0,
            jumps_quiet: Instant::ZERO,
            nodes: config.nodes,
        })
    }

    /// A person who commands RUN has seen why the robot stopped. A board that still sees no floor pulls the line anew.
    fn on_state_command(&mut self, command: &CmdState) {
        let ours = command.module == NAME || command.module == "*";
        if ours && command.manual && command.state == State::Run as i8 {
            for board in self.nodes.iter().filter(|node| node.kind == Kind::Sd1) {
                self.line.demand(board.address, &sd1::CLEAR_PAUSE_SRC);
            }
        }
    }

    /// Nothing is known of the ranges from now on, and that is published.
    fn forget_ranges(&mut self, now: Instant) {
        self.ranges.forget();
        self.repeat = self.repeat.min(now);
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(heard) = self.line.hear(now, out) {
            self.on_heard(now, &heard, out);
        }
        if let Some(turn) = self.line.turn(now) {
            if turn.instruction == sd1::GET_BOTH_DATA.code {
                self.ranges.asked(now, turn.to);
            }
            self.line.ask(turn, &[]);
        }
        self.line.serve(now, out);
        if now >= self.repeat {
            self.publish_readings(now, out);
        }
    }
}

impl Module for Rs485a {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::CmCmdState]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.line.start(now);
                self.repeat = now;
            }
            Event::Port { port: PORT, input } => {
                if self.line.on_port(now, &input, out) == Some(false) {
                    self.forget_ranges(now);
                }
            }
            Event::State(state) => {
                self.line.set_state(state);
                if state == State::Stop {
                    self.forget_ranges(now);
                }
            }
            Event::Timer => self.line.on_timer(now, out),
            Event::Message { message: Message::CmCmdState(command), .. } => self.on_state_command(command),
            Event::Port { .. } | Event::Message { .. } | Event::Heard { .. } | Event::Process(_) => {}
        }
        self.drain(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.line.poll_timeout().into_iter().chain([self.repeat]).min()
    }
}

/// A board as its bus knows it, and the time that it may take to answer.
fn board(node: &Node) -> (line::Board, Duration) {
    let (table, poll): (&[Instruction], _) = match node.kind {
        Kind::Sd1 => (sd1::INSTRUCTIONS, sd1::GET_BOTH_DATA),
        // Other kinds have been refused.
        Kind::So1 | Kind::Sbs1 | Kind::Psc1 => (so1::INSTRUCTIONS, so1::GET_TICKS),
    };
    let period = Duration::from_secs_f64(1.0 / node.rate_hz);
    (line::Board::new(&node.name, node.address, table, vec![(poll, period)]), node.timeout)
}

#[cfg(test)]
mod tests;
