//! Homing methods by number (CiA 402-2, 11): what each searches, in words and as the motion it makes.

use core::fmt;

/// A direction of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the description
pub enum Direction {
    Negative,
    Positive,
}

impl Direction {
    /// -1 or 1.
    #[must_use]
    pub const fn sign(self) -> f64 {
        match self {
            Self::Negative => -1.0,
            Self::Positive => 1.0,
        }
    }

    /// The other one.
    #[must_use]
    pub const fn reversed(self) -> Self {
        match self {
            Self::Negative => Self::Positive,
            Self::Positive => Self::Negative,
        }
    }
}

/// A switch of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the description
pub enum Switch {
    NegativeLimit,
    PositiveLimit,
    Home,
}

/// A motion until the switch is so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leg {
    /// Whither.
    pub direction: Direction,
    /// Until it is active, or inactive.
    pub active: bool,
}

/// Parts of a homing motion, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// The switch, and the direction in which it is searched at the greater speed while it is inactive. Limits
    /// reverse the search for a home switch.
    pub search: Option<(Switch, Direction)>,
    /// Edge, at the lesser speed: leave it, and for some methods come back.
    pub legs: [Option<Leg>; 2],
    /// The first index pulse in this direction.
    pub index: Option<Direction>,
}

/// A homing method of the standard: 1 to 14, 17 to 30, 33 to 35, 37.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method(i8);

/// Methods of EPOS drives of the first generation, which also have -1 to -4 (current threshold).
pub const EPOS: &[i8] = &[1, 2, 7, 11, 17, 18, 23, 27, 33, 34, 35];

impl Method {
    /// The method of this number; `None`: the standard has none, or leaves it to the manufacturer.
    #[must_use]
    pub const fn of(number: i8) -> Option<Self> {
        match number {
            1..=14 | 17..=30 | 33..=35 | 37 => Some(Self(number)),
            _ => None,
        }
    }

    /// Number, for 0x6098.
    #[must_use]
    pub const fn number(self) -> i8 {
        self.0
    }

    /// The same at the other end: limits, directions and edges exchanged. Methods without a switch have none.
    #[must_use]
    pub const fn mirrored(self) -> Option<Self> {
        let base = match self.0 {
            17..=30 => self.0 - 16,
            number => number,
        };
        let other = match base {
            1 => 2,
            2 => 1,
            3 | 4 => base + 2,
            5 | 6 => base - 2,
            7..=10 => base + 4,
            11..=14 => base - 4,
            _ => return None,
        };
        Some(Self(other + self.0 - base))
    }

    /// True if it ends at an index pulse of the encoder.
    #[must_use]
    pub const fn has_index(self) -> bool {
        matches!(self.0, 1..=14 | 33 | 34)
    }

    /// Reference that the method searches for.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self.0 {
            1 | 17 => "negative limit switch",
            2 | 18 => "positive limit switch",
            3 | 19 => "positive home switch, leaving it",
            4 | 20 => "positive home switch, entering it",
            5 | 21 => "negative home switch, leaving it",
            6 | 22 => "negative home switch, entering it",
            7 | 23 => "home switch, left edge from within, search positive",
            8 | 24 => "home switch, left edge from without, search positive",
            9 | 25 => "home switch, right edge from without, search positive",
            10 | 26 => "home switch, right edge from within, search positive",
            11 | 27 => "home switch, right edge from within, search negative",
            12 | 28 => "home switch, right edge from without, search negative",
            13 | 29 => "home switch, left edge from without, search negative",
            14 | 30 => "home switch, left edge from within, search negative",
            33 => "next index pulse, negative",
            34 => "next index pulse, positive",
            _ => "here",
        }
    }

    /// Motion.
    #[must_use]
    pub const fn plan(self) -> Plan {
        use Direction::{Negative, Positive};
        use Switch::{Home, NegativeLimit, PositiveLimit};
        // Methods 17 to 30 are 1 to 14 without the index pulse.
        let base = if self.0 >= 17 && self.0 <= 30 { self.0 - 16 } else { self.0 };
        let (switch, seek, out, back) = match base {
            1 => (NegativeLimit, Negative, Positive, false),
            2 => (PositiveLimit, Positive, Negative, false),
            3 => (Home, Positive, Negative, false),
            4 => (Home, Positive, Negative, true),
            5 => (Home, Negative, Positive, false),
            6 => (Home, Negative, Positive, true),
            7 => (Home, Positive, Negative, false),
            8 => (Home, Positive, Negative, true),
            9 => (Home, Positive, Positive, true),
            10 => (Home, Positive, Positive, false),
            11 => (Home, Negative, Positive, false),
            12 => (Home, Negative, Positive, true),
            13 => (Home, Negative, Negative, true),
            14 => (Home, Negative, Negative, false),
            33 => return Plan { search: None, legs: [None; 2], index: Some(Negative) },
            34 => return Plan { search: None, legs: [None; 2], index: Some(Positive) },
            _ => return Plan { search: None, legs: [None; 2], index: None },
        };
        let first = Leg { direction: out, active: false };
        let second = Leg { direction: out.reversed(), active: true };
        let last = if back { second.direction } else { out };
        Plan {
            search: Some((switch, seek)),
            legs: [Some(first), if back { Some(second) } else { None }],
            index: if self.has_index() { Some(last) } else { None },
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let index = if self.has_index() && self.0 < 33 { ", then index" } else { "" };
        write!(f, "{} ({}{index})", self.0, self.description())
    }
}
