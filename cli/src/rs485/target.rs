//! Which line is meant, and who is known to be on it.

use crate::holder::{Holder, holder};
use crate::{Common, Failed, choice, whole};
use base::Duration;
use host::ports::TerminalConfig;
use host::ports::Transport;
use robot::config::Rs485Bus;
use robot::place::RobotLocation;
use rs485::boards::{BOARDS, Board};
use rs485::crc::Crc8;
use std::fs;
use std::path::PathBuf;

/// How a line is named; what all commands take.
#[derive(clap::Args)]
pub struct Where {
    /// Bus of the configuration: a; may be left out where there is only one
    #[arg(long, value_name = "NAME", conflicts_with = "port")]
    bus: Option<String>,
    /// Serial device, in place of --bus
    #[arg(long, value_name = "PATH")]
    port: Option<PathBuf>,
    /// Bd of --port
    #[arg(long, value_name = "BD", requires = "port", conflicts_with = "bus", default_value = "115200",
          value_parser = clap::value_parser!(u32).range(1200..=4_000_000))]
    baud: u32,
    /// How nine bits cross --port: two-byte, ninth-first or parity
    #[arg(long, requires = "port", conflicts_with = "bus", default_value = "two-byte", value_parser = transport)]
    transport: Transport,
}

fn transport(text: &str) -> Result<Transport, String> {
    let found = Transport::ALL.iter().find(|(name, _)| *name == text);
    found.map(|(_, transport)| *transport).ok_or_else(|| "expected two-byte, ninth-first or parity".into())
}

/// A board that is known to be on the line, or might be.
#[derive(Clone, Debug)]
pub struct Known {
    /// What people call it.
    pub name: String,
    /// Address.
    pub address: u8,
    /// What it is.
    pub board: Option<&'static Board>,
    /// How long it may take to answer.
    pub timeout: Duration,
}

/// A line.
pub struct Target {
    /// For people: `rs485.a`, or the device.
    pub name: String,
    /// The `<BUS>` of `LL_DATA_RAW_<BUS>`, and whether it is configured to be sent; none for a port that is no bus's.
    pub raw: Option<(String, bool)>,
    /// Device.
    pub terminal: TerminalConfig,
    /// Check.
    pub crc: Crc8,
    /// Who is configured to be on it.
    pub known: Vec<Known>,
}

/// A board without an entry gets the contract's default (`docs/facts/boards.md` 1).
pub const TIMEOUT: Duration = Duration::from_millis(20);

impl Where {
    /// Finds the line: the simulated robot's while one runs in the run folder, else as configured.
    pub fn find(&self, common: &Common) -> Result<Target, Failed> {
        if let Some(port) = &self.port {
            return Ok(self.find_port(common, port));
        }
        let (place, robot) = common.robot()?;
        let bus = choice::bus("rs485", self.bus.as_deref(), &robot.rs485, |bus| &bus.name, "--port")?;
        Ok(Target::of(&place, bus))
    }

    /// A port may be one of the robot's: then its boards are known, too.
    fn find_port(&self, common: &Common, port: &PathBuf) -> Target {
        let device = fs::canonicalize(port).ok();
        let configured = common.robot().ok().and_then(|(place, robot)| {
            let mut buses = robot.rs485.iter().map(|bus| Target::of(&place, bus));
            buses.find(|bus| device.is_some() && fs::canonicalize(&bus.terminal.path).ok() == device)
        });
        let mut target = configured.unwrap_or_else(|| Target {
            name: port.display().to_string(),
            raw: None,
            terminal: TerminalConfig::new(port.clone(), self.baud),
            crc: Crc8::SAE_J1850,
            known: Vec::new(),
        });
        let low_latency = true;
        target.terminal = TerminalConfig {
            transport: self.transport,
            low_latency,
            direction: target.terminal.direction,
            setup: target.terminal.setup,
            ..TerminalConfig::new(port.clone(), self.baud)
        };
        target
    }
}

impl Target {
    fn of(place: &RobotLocation, bus: &Rs485Bus) -> Self {
        let known = bus.driver.nodes.iter().map(|node| Known {
            name: node.name.clone(),
            address: node.address,
            board: BOARDS.iter().find(|board| board.name == node.kind.name()),
            timeout: node.timeout,
        });
        Self {
            name: format!("rs485.{}", bus.name),
            raw: Some((bus.name.to_uppercase(), bus.line.raw)),
            terminal: bus.line.terminal(&place.run_dir),
            crc: bus.driver.crc.into(),
            known: known.collect(),
        }
    }

    /// Who holds its device.
    pub fn holder(&self) -> Option<Holder> {
        holder(&self.terminal.path)
    }

    /// The board at an address: as configured, else what the boards' list has there, else a stranger.
    pub fn at(&self, address: u8) -> Known {
        let configured = self.known.iter().find(|known| known.address == address).cloned();
        configured.unwrap_or_else(|| {
            let board = BOARDS.iter().find(|board| board.addresses.contains(&address));
            let name = board.map_or("?", |board| board.name).into();
            Known { name, address, board, timeout: TIMEOUT }
        })
    }

    /// The board that is meant by a name or an address, decimal or 0x….
    pub fn board(&self, text: &str) -> Result<Known, Failed> {
        if let Some(known) = self.known.iter().find(|known| known.name == text) {
            return Ok(known.clone());
        }
        let number: Option<u8> = whole(text);
        if let Some(address) = number.filter(|address| (1..=254).contains(address)) {
            return Ok(self.at(address));
        }
        let named = BOARDS.iter().find(|board| board.name == text);
        if let Some([address]) = named.map(|board| board.addresses)
            && self.known.is_empty()
        {
            return Ok(self.at(*address));
        }
        let names =
            choice::or_one_of(self.known.iter().map(|known| format!("{} ({:#04x})", known.name, known.address)));
        Err(format!("no board {text:?}: expected an address from 1 to 254{names}").into())
    }
}
