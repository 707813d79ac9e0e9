//! The wires of the machine, by the names of their buses.

use super::can::CanWire;
use super::config::Config;
use super::gamepad::GamepadWire;
use super::i2c::I2cWire;
use super::news::Traffic;
use super::owner::Owner;
use super::serial::{self, SerialWire};
use super::served::Served;
use super::store::Store;
use super::thermal::Zones;
use super::w1::Thermometers;
use base::Instant;
use base::serial::Word;
use module::Line;
use simulator::Random;
use simulator::disturbance::Disturbance;
use simulator::faults::InjectedFault;
use std::rc::Rc;

/// A wire.
pub(super) struct Wire {
    pub bus: Rc<str>,
    pub kind: Kind,
    disturbance: Disturbance,
    random: Random,
    /// Number of dropped items already reported.
    told_dropped: u64,
}

/// Kind of wire.
pub(super) enum Kind {
    Can(CanWire),
    Serial(SerialWire),
    I2c(I2cWire),
    OneWire(Served<Thermometers>),
    Thermal(Served<Zones>),
    Gamepad(GamepadWire),
    /// A digital output: what one end sends reaches the other at once.
    Gpio(Vec<Owner>),
    Store(Served<Store>),
}

impl Wire {
    /// Injects a fault into the wire; false if a wire of its kind has no such fault.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        let own = match &mut self.kind {
            Kind::Can(wire) => wire.inject(now, injected, until),
            Kind::Serial(_) => false,
            // Faults concern their chips only.
            Kind::I2c(_) | Kind::OneWire(_) | Kind::Thermal(_) | Kind::Gamepad(_) | Kind::Gpio(_) | Kind::Store(_) => {
                return false;
            }
        };
        // On a CAN bus noise destroys frames, which are retransmitted; the wire handles that itself.
        let common = !matches!(injected, InjectedFault::Reorder(_)) && (!own || injected == InjectedFault::None);
        common && self.disturbance.inject(now, injected, until) || own
    }

    /// Arrival time and number of copies of data sent now; `None` if it is lost.
    pub fn passes(&mut self, now: Instant) -> Option<(Instant, u32)> {
        if self.random.chance(self.disturbance.loss(now)) {
            return None;
        }
        let twice = self.disturbance.duplicates(now, &mut self.random);
        Some((self.disturbance.arrival(now, now), 1 + u32::from(twice)))
    }

    /// Number of items dropped since the last call, if any.
    pub fn dropped(&mut self) -> Option<u64> {
        let count = self.traffic().dropped - self.told_dropped;
        self.told_dropped += count;
        (count > 0).then_some(count)
    }

    /// Noise on a serial line.
    pub fn garble(&mut self, now: Instant, words: &mut [Word]) {
        self.disturbance.garble(now, words, &mut self.random);
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        match &self.kind {
            Kind::Can(wire) => wire.poll_timeout(),
            Kind::Serial(wire) => wire.poll_timeout(),
            Kind::I2c(wire) => wire.poll_timeout(),
            Kind::OneWire(wire) => wire.poll_timeout(),
            Kind::Thermal(wire) => wire.poll_timeout(),
            Kind::Store(wire) => wire.poll_timeout(),
            Kind::Gamepad(_) | Kind::Gpio(_) => None,
        }
    }

    fn rate(&self) -> Line {
        match &self.kind {
            Kind::Can(wire) => Line::Can { bitrate: wire.bitrate },
            Kind::Serial(wire) => Line::Serial { baud: wire.baud },
            Kind::I2c(wire) => Line::I2c { hz: wire.hz },
            Kind::OneWire(_) => Line::OneWire,
            Kind::Thermal(_) => Line::Thermal,
            Kind::Gamepad(_) => Line::Gamepad,
            Kind::Gpio(_) => Line::Gpio,
            Kind::Store(_) => Line::Store,
        }
    }

    pub fn traffic(&self) -> Traffic {
        match &self.kind {
            Kind::Can(wire) => wire.traffic,
            Kind::Serial(wire) => wire.traffic,
            Kind::I2c(wire) => wire.traffic,
            Kind::OneWire(wire) => wire.traffic,
            Kind::Thermal(wire) => wire.traffic,
            Kind::Store(wire) => wire.traffic,
            Kind::Gamepad(_) | Kind::Gpio(_) => Traffic::default(),
        }
    }

    pub fn ports(&self) -> &[Owner] {
        match &self.kind {
            Kind::Can(wire) => &wire.ports,
            Kind::Serial(wire) => &wire.ports,
            Kind::I2c(wire) => &wire.ports,
            Kind::OneWire(wire) => &wire.ports,
            Kind::Thermal(wire) => &wire.ports,
            Kind::Gamepad(wire) => &wire.ports,
            Kind::Gpio(ports) => ports,
            Kind::Store(wire) => &wire.ports,
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
            Kind::I2c(wire) => {
                wire.join(owner, emulates);
                true
            }
            Kind::OneWire(wire) => {
                wire.ports.push(owner);
                if emulates {
                    wire.server.emulated_by(owner);
                }
                true
            }
            Kind::Thermal(wire) => {
                wire.ports.push(owner);
                if emulates {
                    wire.server.emulated_by(owner);
                }
                true
            }
            Kind::Gamepad(wire) => {
                wire.ports.push(owner);
                true
            }
            Kind::Gpio(ports) => {
                ports.push(owner);
                true
            }
            Kind::Store(wire) => {
                wire.ports.push(owner);
                true
            }
        }
    }

    /// A process has ended; true if a gamepad that it simulated disappears with it.
    pub fn close(&mut self, pid: u32) -> bool {
        match &mut self.kind {
            Kind::Can(wire) => wire.close(pid),
            Kind::Serial(wire) => wire.close(pid),
            Kind::I2c(wire) => wire.close(pid),
            Kind::OneWire(wire) => wire.close(pid),
            Kind::Thermal(wire) => wire.close(pid),
            Kind::Store(wire) => wire.close(pid),
            Kind::Gpio(ports) => ports.retain(|owner| owner.pid != pid),
            Kind::Gamepad(wire) => return wire.close(pid),
        }
        false
    }
}

/// Wire of a bus, created on first use.
pub(super) fn open(wires: &mut Vec<Wire>, config: &Config, bus: &str, line: Line) -> Result<usize, String> {
    if let Some(place) = wires.iter().position(|wire| &*wire.bus == bus) {
        let there = wires[place].rate();
        return if there == line { Ok(place) } else { Err(format!("bus {bus} is {there:?}, not {line:?}")) };
    }
    let stream = 2 * wires.len() as u64;
    let random = Random::stream(config.seed, 16 + stream);
    let kind = match line {
        Line::Can { bitrate } => Kind::Can(CanWire::new(bitrate, random, config.can_loss)),
        Line::Serial { baud } => {
            let is_among = |names: &[String]| names.iter().any(|name| name == bus);
            let mut wire = SerialWire::new(baud, is_among(&config.full_duplex), random);
            if is_among(&config.usb) {
                wire.piece = serial::PACKET;
            }
            Kind::Serial(wire)
        }
        Line::I2c { hz } => Kind::I2c(I2cWire::new(hz)),
        Line::OneWire => Kind::OneWire(Served::default()),
        Line::Thermal => Kind::Thermal(Served::default()),
        Line::Gamepad => Kind::Gamepad(GamepadWire::default()),
        Line::Gpio => Kind::Gpio(Vec::new()),
        Line::Store => Kind::Store(Served::default()),
    };
    let (disturbance, random) = (Disturbance::default(), Random::stream(config.seed, 17 + stream));
    wires.push(Wire { bus: bus.into(), kind, disturbance, random, told_dropped: 0 });
    Ok(wires.len() - 1)
}
