//! What the module must know of the robot; SI units.

use crate::rs485_bus::{Kind, Node};
use rs485::crc::Crc8;
use rs485::master::NODES_MAX;
use settings::robot::{Geometry, Limits};
use settings::settings;
use std::fmt;

/// Configuration of `driver_rs485a`.
#[derive(Clone, Debug)]
pub struct Config {
    /// The bus's name: `rs485.a`.
    pub bus: String,
    /// bit/s on the wire.
    pub baud: u32,
    /// The check of its frames.
    pub crc: Crc8,
    /// The boards, each with its own address; at most [`NODES_MAX`].
    pub nodes: Vec<Node>,
    /// The sonars, in any order; numbers do not repeat.
    pub srfs: Vec<Ranger>,
    /// The infrared rangers, in any order; numbers do not repeat.
    pub irs: Vec<Ranger>,
    /// The wheels whose ticks the SO1 counts.
    pub wheels: Wheels,
}

settings! {
    /// An item of `srfs` or `irs`: a ranger and where it sits in the robot's frame.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Ranger {
        /// Number in messages.
        id: u8 = required, 0..=255;
        /// Address of the SD1 that serves it.
        board: u8 = required, 1..=254;
        /// Place in the answer of that board: 0 to 7 of `srfs`, 0 and 1 of `irs`.
        channel: u8 = required, 0..=7;
        /// Forward.
        x: f64 = required, -10.0..=10.0;
        /// Left.
        y: f64 = required, -10.0..=10.0;
        /// Direction in which it looks.
        theta: f64 = required, -std::f64::consts::PI..=std::f64::consts::PI;
        /// Full opening angle of its beam, rad; 0 for a line.
        beam: f64 = unset 0.0;
    }
}

/// The front wheels, steered and not driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wheels {
    /// Front to rear axle, m.
    pub wheelbase_m: f64,
    /// Left to right front wheel, m.
    pub track_m: f64,
    /// m.
    pub radius_m: f64,
    /// Counts of a wheel's encoder per turn.
    pub ticks_per_turn: u32,
    /// The robot's top speed, m/s; decides how long a gap between two answers may be, and which jump of a counter no
    /// wheel can make.
    pub speed_max_mps: f64,
}

impl Default for Wheels {
    /// Advee's (`docs/facts/robot.md` 1.2).
    fn default() -> Self {
        Self { wheelbase_m: 0.60, track_m: 0.50, radius_m: 0.100, ticks_per_turn: 4096, speed_max_mps: 1.2 }
    }
}

impl Wheels {
    /// Those of the robot.
    #[must_use]
    pub fn of(geometry: &Geometry, limits: &Limits) -> Self {
        Self {
            wheelbase_m: geometry.wheelbase_m,
            track_m: geometry.track_m,
            radius_m: geometry.wheel_radius_m,
            ticks_per_turn: geometry.ticks_per_turn,
            speed_max_mps: limits.speed_mps,
        }
    }

    /// The way of one tick, m.
    #[must_use]
    pub fn metres_per_tick(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.radius_m / f64::from(self.ticks_per_turn)
    }
}

/// Why a configuration is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// No board, or more than [`NODES_MAX`].
    Nodes(usize),
    /// Two boards of one address, or two SO1: the name of the second.
    Twice(String),
    /// A board of another kind: its name.
    Kind(String),
    /// A board's rate is not above 0: its name.
    Rate(String),
    /// A ranger's board is no SD1 of this bus: the ranger's number.
    NoBoard(u8),
    /// A length, the ticks or the speed of the wheels is not above 0.
    Wheels,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nodes(nodes) => write!(f, "{nodes} boards on one bus: 1 to {NODES_MAX} are possible"),
            Self::Twice(name) => write!(f, "board {name}: its address, or an SO1, is there twice"),
            Self::Kind(name) => write!(f, "{name} on rs485.a: it knows sd1 and so1"),
            Self::Rate(name) => write!(f, "board {name}: its rate must be above 0"),
            Self::NoBoard(id) => write!(f, "ranger {id}: its board is no SD1 of this bus"),
            Self::Wheels => f.write_str("wheels: lengths, ticks per turn and speed must be above 0"),
        }
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    /// Looks at what the module relies on.
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        if !(1..=NODES_MAX).contains(&self.nodes.len()) {
            return Err(ConfigError::Nodes(self.nodes.len()));
        }
        for (i, node) in self.nodes.iter().enumerate() {
            let so1 = |other: &Node| (node.kind, other.kind) == (Kind::So1, Kind::So1);
            if self.nodes[..i].iter().any(|other| other.address == node.address || so1(other)) {
                return Err(ConfigError::Twice(node.name.clone()));
            }
            if !matches!(node.kind, Kind::Sd1 | Kind::So1) {
                return Err(ConfigError::Kind(node.name.clone()));
            }
            if !(node.rate_hz.is_finite() && node.rate_hz > 0.0) {
                return Err(ConfigError::Rate(node.name.clone()));
            }
        }
        let serves = |board| self.nodes.iter().any(|node| node.address == board && node.kind == Kind::Sd1);
        if let Some(orphan) = self.srfs.iter().chain(&self.irs).find(|ranger| !serves(ranger.board)) {
            return Err(ConfigError::NoBoard(orphan.id));
        }
        let Wheels { wheelbase_m, track_m, radius_m, ticks_per_turn, speed_max_mps } = self.wheels;
        let lengths = [wheelbase_m, track_m, radius_m, speed_max_mps, f64::from(ticks_per_turn)];
        if lengths.iter().all(|length| length.is_finite() && *length > 0.0) { Ok(()) } else { Err(ConfigError::Wheels) }
    }
}
