//! Bus B: the beacon scanner BR-SBS1.
//!
//! Device    `docs/facts/boards.md` 5
//! Protocol  the 9-bit EIA-485 of `rs485`; the board asks nothing, it is asked
//! Timing    asked at its rate (2011: 1 Hz), which is that of its sweep; how it is, every ten seconds
//! Silence   after 16 failed transactions it is lost: reported, asked once a second, nothing is published
//! Data      `LL_DATA_BEACONS` with each answer; each sighting has its own instant and is published once.
//!           `LL_DATA_BUS` once a second
//! Commands  `LL_DATA_ACTIVE_BEACONS` says which beacons to look for; a board that was reset is told again
//!
//! In STOP it asks nothing.

mod sightings;

use crate::line::{self, Heard, Line, PORT};
use crate::rs485_bus::Node;
use base::{Duration, Fault, Instant, Severity};
use messages::lowlevel::DataActiveBeacons;
use messages::{Channel, Message};
use module::{Actions, Event, Module, PortSpec};
use rs485::boards::sbs1::{self, BEACONS, GET_BEACON_DATA, GET_DEBUG_DATA, SET_BEACON_IDS};
use rs485::crc::Crc8;
use rs485::master;
use rs485::schedule::Turn;
use sightings::Sightings;
use std::fmt;

/// The module's name.
pub const NAME: &str = "driver_rs485b";
/// The board is asked how it is this often; that it was reset is known from it.
const DEBUG: Duration = Duration::from_secs(10);

/// Configuration of `driver_rs485b`; SI units.
#[derive(Clone, Debug)]
pub struct Config {
    /// The bus's name: `rs485.b`.
    pub bus: String,
    /// bit/s on the wire.
    pub baud: u32,
    /// The check of its frames.
    pub crc: Crc8,
    /// The scanner.
    pub node: Node,
    /// Beacons to look for until somebody commands others; none: all. At most [`BEACONS`], none twice.
    pub beacons: Vec<u8>,
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// The scanner's rate is not above 0.
    Rate,
    /// More beacons than the scanner can be told, or one twice.
    Beacons,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rate => f.write_str("the scanner's rate must be above 0"),
            Self::Beacons => write!(f, "beacons: at most {BEACONS}, none twice"),
        }
    }
}

impl std::error::Error for ConfigError {}

/// The driver of bus B.
#[derive(Debug)]
pub struct Rs485b {
    ports: [PortSpec; 1],
    line: Line,
    address: u8,
    sightings: Sightings,
    /// Which beacons it shall look for; none: all.
    wanted: Vec<u8>,
    /// What it was told, and what it is being told.
    told: Option<Vec<u8>>,
    telling: Vec<u8>,
    /// Its count of sweeps, which falls when it is reset.
    sweeps: Option<u16>,
}

impl Rs485b {
    /// A driver that has not started.
    ///
    /// # Errors
    /// When the configuration cannot be.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        let node = config.node;
        if !(node.rate_hz.is_finite() && node.rate_hz > 0.0) {
            return Err(ConfigError::Rate);
        }
        if !is_list(&config.beacons) {
            return Err(ConfigError::Beacons);
        }
        let polls = vec![(GET_BEACON_DATA, Duration::from_secs_f64(1.0 / node.rate_hz)), (GET_DEBUG_DATA, DEBUG)];
        let board = line::Board::new(&node.name, node.address, sbs1::INSTRUCTIONS, polls);
        let bus = master::Config { baud: config.baud, crc: config.crc, ..master::Config::default() };
        let line = Line::new(&config.bus, bus, vec![(board, node.timeout)]);
        Ok(Self {
            ports: [line.port()],
            line,
            address: node.address,
            sightings: Sightings::new(config.baud),
            wanted: config.beacons,
            told: None,
            telling: Vec::new(),
            sweeps: None,
        })
    }

    fn on_active(&mut self, command: &DataActiveBeacons, out: &mut Actions) {
        let ids: Option<Vec<u8>> = command.ids.iter().map(|id| u8::try_from(*id).ok()).collect();
        match ids.filter(|ids| is_list(ids)) {
            Some(ids) => {
                self.wanted = ids;
                self.tell();
            }
            None => {
                let why = format!("{} beacons refused: at most {BEACONS} of 0 to 255, none twice", command.ids.len());
                out.report(Severity::Warning, Fault::CommandForbidden, "beacons", why);
            }
        }
    }

    /// Has the board told which beacons to look for, where it does not know.
    fn tell(&mut self) {
        if self.told.as_ref() != Some(&self.wanted) {
            self.line.demand(self.address, &SET_BEACON_IDS);
        }
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(heard) = self.line.hear(now, out) {
            match heard {
                Heard::Answer { instruction, data, .. } => self.on_answer(now, instruction, &data, out),
                Heard::Back => self.told = None,
                Heard::Failed { .. } | Heard::Unasked { .. } => {}
            }
        }
        if let Some(turn) = self.line.turn(now) {
            self.ask(turn);
        }
        self.line.serve(now, out);
    }

    fn ask(&mut self, turn: Turn) {
        if turn.instruction == SET_BEACON_IDS.code {
            self.telling.clone_from(&self.wanted);
            self.line.ask(turn, &self.telling);
        } else {
            self.line.ask(turn, &[]);
        }
    }

    fn on_answer(&mut self, now: Instant, instruction: u8, data: &[u8], out: &mut Actions) {
        match instruction {
            code if code == SET_BEACON_IDS.code => {
                self.told = Some(std::mem::take(&mut self.telling));
                self.sightings.looks_for(now, self.told.as_deref().unwrap_or_default());
            }
            code if code == GET_BEACON_DATA.code => {
                let read = self.sightings.read(now, out.epoch(), data);
                if let Some((beacons, stranger)) = self.line.judge(self.address, read, out) {
                    out.publish(beacons);
                    if stranger {
                        self.told = None;
                    }
                }
            }
            code if code == GET_DEBUG_DATA.code => {
                if let Some(debug) = self.line.judge(self.address, sbs1::parse_debug(data), out)
                    && self.sweeps.replace(debug.sweeps).is_some_and(|before| debug.sweeps < before)
                {
                    self.told = None;
                }
            }
            _ => {}
        }
        // With each answer, not with each failure: a board that is silent is not asked more.
        self.tell();
    }
}

/// Whether a scanner can be told these beacons.
fn is_list(ids: &[u8]) -> bool {
    ids.len() <= BEACONS && ids.iter().enumerate().all(|(place, id)| !ids[..place].contains(id))
}

impl Module for Rs485b {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::LlDataActiveBeacons]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.line.start(now),
            Event::Port { port: PORT, input } => {
                if self.line.on_port(now, &input, out) == Some(true) {
                    // It may be another board, or the same one switched off meanwhile.
                    self.told = None;
                    self.tell();
                }
            }
            Event::Message { message: Message::LlDataActiveBeacons(command), .. } => self.on_active(command, out),
            Event::State(state) => self.line.set_state(state),
            Event::Timer => self.line.on_timer(now, out),
            Event::Port { .. } | Event::Message { .. } | Event::Heard { .. } | Event::Process(_) => {}
        }
        self.drain(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.line.poll_timeout()
    }
}

#[cfg(test)]
mod tests;
