//! Bus B: the beacon scanner BR-SBS1.
//!
//! Device    `docs/facts/boards.md` 5
//! Protocol  the 9-bit EIA-485 of `rs485`; the board answers requests only
//! Timing    polled at its rate (2011: 1 Hz), which is that of its sweep; its status every ten seconds
//! Silence   after 16 failed transactions it is lost: reported, polled once a second, nothing is published
//! Data      `LL_DATA_BEACONS` with each answer; each sighting has its own instant and is published once.
//!           `LL_DATA_SCANNER` with each status: rejected pulses and supply; `LL_DATA_BUS` once a second
//! Commands  `LL_DATA_ACTIVE_BEACONS` selects the beacons to look for; sent again to a board that was reset
//!
//! Nothing is polled in STOP.

mod sightings;
mod status;

use crate::line::{self, BusEvent, Line, PORT};
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
use status::ScannerStatus;
use std::fmt;

/// Name of the module.
pub const NAME: &str = "driver_rs485b";
/// Period of reading the board's status, which also reveals a reset.
const DEBUG_PERIOD: Duration = Duration::from_secs(10);

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

/// Driver of bus B.
#[derive(Debug)]
pub struct Rs485b {
    ports: [PortSpec; 1],
    line: Line,
    address: u8,
    sightings: Sightings,
    /// Beacons to look for; empty: all.
    wanted: Vec<u8>,
    /// Beacons that were sent to it, and those being sent.
    sent: Option<Vec<u8>>,
    telling: Vec<u8>,
    status: ScannerStatus,
}

impl Rs485b {
    /// Creates the driver, not started yet.
    ///
    /// # Errors
    /// The configuration is invalid.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        let node = config.node;
        if !(node.rate_hz.is_finite() && node.rate_hz > 0.0) {
            return Err(ConfigError::Rate);
        }
        if !is_list(&config.beacons) {
            return Err(ConfigError::Beacons);
        }
        let polls =
            vec![(GET_BEACON_DATA, Duration::from_secs_f64(1.0 / node.rate_hz)), (GET_DEBUG_DATA, DEBUG_PERIOD)];
        let board = line::Board::new(&node.name, node.address, sbs1::INSTRUCTIONS, polls);
        let bus = master::Config { baud: config.baud, crc: config.crc, ..master::Config::default() };
        let line = Line::new(&config.bus, bus, vec![(board, node.timeout)]);
        Ok(Self {
            ports: [line.port()],
            line,
            address: node.address,
            sightings: Sightings::new(config.baud),
            wanted: config.beacons,
            sent: None,
            telling: Vec::new(),
            status: ScannerStatus::new(&node),
        })
    }

    fn on_active(&mut self, command: &DataActiveBeacons, out: &mut Actions) {
        let ids: Option<Vec<u8>> = command.ids.iter().map(|id| u8::try_from(*id).ok()).collect();
        match ids.filter(|ids| is_list(ids)) {
            Some(ids) => {
                self.wanted = ids;
                self.send_selection();
            }
            None => {
                let why = format!("{} beacons refused: at most {BEACONS} of 0 to 255, none twice", command.ids.len());
                out.report(Severity::Warning, Fault::CommandForbidden, "beacons", why);
            }
        }
    }

    /// Sends the beacons to look for if the board does not have them.
    fn send_selection(&mut self) {
        if self.sent.as_ref() != Some(&self.wanted) {
            self.line.demand(self.address, &SET_BEACON_IDS);
        }
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.line.poll_event(now, out) {
            match event {
                BusEvent::Answer { instruction, data, .. } => self.on_answer(now, instruction, &data, out),
                BusEvent::Recovered => self.sent = None,
                BusEvent::Failed { .. } | BusEvent::Unsolicited { .. } => {}
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
                self.sent = Some(std::mem::take(&mut self.telling));
                self.sightings.select(now, self.sent.as_deref().unwrap_or_default());
            }
            code if code == GET_BEACON_DATA.code => {
                let read = self.sightings.read(now, out.epoch(), data);
                if let Some((beacons, stranger)) = self.line.judge(self.address, read, out) {
                    out.publish(beacons);
                    if stranger {
                        self.sent = None;
                    }
                }
            }
            code if code == GET_DEBUG_DATA.code => {
                if let Some(debug) = self.line.judge(self.address, sbs1::parse_debug(data), out)
                    && self.status.on_debug(now, debug, out)
                {
                    self.sent = None;
                }
            }
            _ => {}
        }
        // With each answer rather than each failure, so that a silent board is not asked more.
        self.send_selection();
    }
}

/// True if this is a valid list of beacons for a scanner.
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
                    // It may be another board, or was switched off meanwhile.
                    self.sent = None;
                    self.send_selection();
                }
            }
            Event::Message { message: Message::LlDataActiveBeacons(command), .. } => self.on_active(command, out),
            Event::State(state) => self.line.set_state(state),
            Event::Timer => self.line.on_timer(now, out),
            Event::Port { .. } | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        self.drain(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.line.poll_timeout()
    }
}

#[cfg(test)]
mod tests;
