//! Bus A: the distance boards BR-SD1 and the odometry board BR-SO1.
//!
//! Device    `docs/facts/boards.md` 3, 4
//! Protocol  the 9-bit EIA-485 of `rs485`; boards answer requests only
//! Timing    each board at its own period (2011: 4 Hz), a distance board faster while the robot drives (`pace`);
//!           firmware versions in between
//! Silence   after 16 failed transactions a board is lost: reported, polled once a second, its data invalid
//! Data      `LL_DATA_RANGES` once a round, when all boards have answered or failed, while the robot drives with each
//!           answer or failure of a board that looks in the direction of travel, and at least once a second: each
//!           reading with the instant at which its transducer fired, and UNKNOWN if its board did not answer properly.
//!           `LL_DATA_SRFS` and `LL_DATA_IRS` once a round, as in 2011; `LL_DATA_ODO` with each answer of the SO1;
//!           `LL_DATA_BUS` once a second. Timestamps of these are those of the answer's reception
//! PAUSE     an SD1 that saw no floor holds the PAUSE line by itself until a person commands RUN; while `LL_EVENT_STOP`
//!           names it, it is asked which sensor that was, and the corner is reported
//!
//! Nothing is polled in STOP. The module works while at least one board answers: a lost one is reported, the loss of
//! all is an ERROR.

mod answers;
mod config;
mod floor;
mod odometry;
mod pace;
mod plausibility;
mod ranges;

pub use config::{Config, ConfigError, Ranger, Wheels};

use crate::line::{self, Line, PORT};
use crate::rs485_bus::{Kind, Node};
use base::{Duration, Instant};
use floor::Floor;
use messages::common::CmdState;
use messages::lowlevel::DataMotion;
use messages::{Channel, Message};
use module::{Actions, Event, Module, PortSpec, State};
use odometry::Follower;
use pace::Pace;
use plausibility::Plausibility;
use ranges::Ranges;
use rs485::boards::{Instruction, sd1, so1};
use rs485::master;

/// Name of the module.
pub const NAME: &str = "driver_rs485a";

/// Driver of bus A.
#[derive(Debug)]
pub struct Rs485a {
    nodes: Vec<Node>,
    ports: [PortSpec; 1],
    line: Line,
    ranges: Ranges,
    pace: Pace,
    plausibility: Plausibility,
    floor: Floor,
    /// Time at which `LL_DATA_RANGES` is published even if no board has answered.
    repeat: Instant,
    odometry: Follower,
    /// Number of jumps of the counters since the last report, and the earliest time of the next one.
    jumps: u32,
    jumps_quiet: Instant,
}

impl Rs485a {
    /// Creates the driver, not started yet.
    ///
    /// # Errors
    /// The configuration is invalid.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        let bus = master::Config { baud: config.baud, crc: config.crc, ..master::Config::default() };
        let line = Line::new(&config.bus, bus, config.nodes.iter().map(board).collect());
        Ok(Self {
            ports: [line.port()],
            line,
            ranges: Ranges::new(&config),
            pace: Pace::new(&config),
            plausibility: Plausibility::new(&config),
            floor: Floor::new(&config.nodes),
            repeat: Instant::NEVER,
            odometry: Follower::new(&config.wheels),
            jumps: 0,
            jumps_quiet: Instant::ZERO,
            nodes: config.nodes,
        })
    }

    /// A person who commands RUN has seen why the robot stopped. A board that still sees no floor engages the line
    /// again.
    fn on_state_command(&mut self, command: &CmdState) {
        let ours = command.module == NAME || command.module == "*";
        if ours && command.manual && command.state == State::Run as i8 {
            for board in self.nodes.iter().filter(|node| node.kind == Kind::Sd1) {
                self.line.demand(board.address, &sd1::CLEAR_PAUSE_SRC);
            }
        }
    }

    /// The boards that look in the direction of travel are polled faster.
    fn on_motion(&mut self, now: Instant, motion: &DataMotion) {
        self.plausibility.on_motion(now, motion);
        if self.pace.on_motion(motion) {
            self.ranges.begin_round();
            for (address, period) in self.pace.periods() {
                self.line.set_period(now, address, period);
            }
        }
    }

    /// Marks all ranges as unknown and publishes that.
    fn forget_ranges(&mut self, now: Instant) {
        self.ranges.forget();
        self.repeat = self.repeat.min(now);
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.line.poll_event(now, out) {
            self.on_bus_event(now, &event, out);
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
        &[Channel::CmCmdState, Channel::LlDataMotion, Channel::LlEventStop]
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
            Event::Message { message: Message::LlDataMotion(motion), .. } => self.on_motion(now, motion),
            Event::Message { message: Message::LlEventStop(stop), .. } => {
                for board in self.floor.on_stop(now, stop) {
                    self.line.demand(board, &sd1::GET_PAUSE_SRC);
                }
            }
            Event::Port { .. } | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        self.drain(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.line.poll_timeout().into_iter().chain([self.repeat]).min()
    }
}

/// Converts a board and its response timeout for the bus.
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
