//! The wires of the machine, by the names of their busses.

use super::can::CanWire;
use super::config::Config;
use super::news::Traffic;
use super::serial::SerialWire;
use crate::random::Random;
use base::Instant;
use module::{Line, PortId};
use std::rc::Rc;

/// A port of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Owner {
    pub pid: u32,
    pub port: PortId,
}

/// A wire and when it is to be served.
pub(super) struct Wire {
    pub bus: Rc<str>,
    pub kind: Kind,
    pub due: Option<(Instant, u64)>,
}

/// What kind of wire.
pub(super) enum Kind {
    Can(CanWire),
    Serial(SerialWire),
}

impl Wire {
    pub fn poll_timeout(&self) -> Option<Instant> {
        match &self.kind {
            Kind::Can(wire) => wire.poll_timeout(),
            Kind::Serial(wire) => wire.poll_timeout(),
        }
    }

    fn rate(&self) -> Line {
        match &self.kind {
            Kind::Can(wire) => Line::Can { bitrate: wire.bitrate },
            Kind::Serial(wire) => Line::Serial { baud: wire.baud },
        }
    }

    pub fn traffic(&self) -> Traffic {
        match &self.kind {
            Kind::Can(wire) => wire.traffic,
            Kind::Serial(wire) => wire.traffic,
        }
    }

    pub fn ports(&self) -> &[Owner] {
        match &self.kind {
            Kind::Can(wire) => &wire.ports,
            Kind::Serial(wire) => &wire.ports,
        }
    }

    /// Opens a port of a module, which may be the one that emulates the boards; false while its controller is bus-off.
    pub fn join(&mut self, owner: Owner, module: &Rc<str>, emulates: bool) -> bool {
        match &mut self.kind {
            Kind::Can(wire) => wire.join(owner, module, emulates),
            Kind::Serial(wire) => {
                wire.ports.push(owner);
                true
            }
        }
    }
}

/// The wire of a bus, made when it is first asked for.
pub(super) fn open(wires: &mut Vec<Wire>, config: &Config, bus: &str, line: Line) -> Result<usize, String> {
    if let Some(place) = wires.iter().position(|wire| &*wire.bus == bus) {
        let there = wires[place].rate();
        return if there == line { Ok(place) } else { Err(format!("bus {bus} is {there:?}, not {line:?}")) };
    }
    let random = Random::stream(config.seed, 16 + wires.len() as u64);
    let kind = match line {
        Line::Can { bitrate } => Kind::Can(CanWire::new(bitrate, random, config.can_loss)),
        Line::Serial { baud } => {
            Kind::Serial(SerialWire::new(baud, config.full_duplex.iter().any(|name| name == bus), random))
        }
    };
    wires.push(Wire { bus: bus.into(), kind, due: None });
    Ok(wires.len() - 1)
}
