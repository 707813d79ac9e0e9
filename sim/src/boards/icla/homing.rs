//! Homing to the mechanical switch at the negative end (docs/facts/canopen.md 1.9).

use crate::body::Body;
use canopen::Dictionary;

/// How far homing has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Homing {
    /// Not started, or interrupted.
    Idle,
    /// Towards the switch; `off`: its edge is taken on the way back.
    Search { off: bool },
    /// Off the switch.
    Leave,
    /// Home is where it is.
    Here,
    /// Done.
    Attained,
    /// It came to no end.
    Failed,
}

/// What homing wants of the motion.
pub(super) enum Demand {
    /// Run at this speed.
    Run(f64),
    /// Come to a stop.
    Stop,
    /// The position is the home position.
    Here,
}

impl Homing {
    /// Homing by the method of 0x6098.
    pub fn start(objects: &Dictionary, body: &Body) -> Self {
        match (objects.get(0x6098, 0), body.switch_closed()) {
            (Some(17 | 27), false) => Self::Search { off: true },
            (Some(17 | 27), true) => Self::Leave,
            // Onto the switch from off it: when it is closed already, the edge was passed.
            (Some(28), false) => Self::Search { off: false },
            (Some(35 | 37), _) => Self::Here,
            _ => Self::Failed,
        }
    }

    pub fn interrupt(&mut self) {
        if self.runs() {
            *self = Self::Idle;
        }
    }

    pub fn runs(self) -> bool {
        matches!(self, Self::Search { .. } | Self::Leave | Self::Here)
    }

    /// One step, with the speeds of the search for the switch and for its edge.
    pub fn step(&mut self, closed: bool, stalled: bool, [search, edge]: [f64; 2]) -> Demand {
        if stalled && self.runs() {
            *self = Self::Failed;
        }
        let (next, demand) = match (*self, closed) {
            (Self::Search { .. }, false) => (*self, Demand::Run(-search)),
            (Self::Search { off: true }, true) | (Self::Leave, true) => (Self::Leave, Demand::Run(edge)),
            (Self::Search { off: false }, true) | (Self::Leave, false) | (Self::Here, _) => {
                (Self::Attained, Demand::Here)
            }
            (Self::Idle | Self::Attained | Self::Failed, _) => (*self, Demand::Stop),
        };
        *self = next;
        demand
    }

    /// Bits 10, 12 and 13 of the statusword.
    pub fn status(self, stopped: bool) -> u16 {
        let stopped = u16::from(stopped) << 10;
        match self {
            Self::Search { .. } | Self::Leave | Self::Here => 0,
            Self::Idle => 1 << 10,
            Self::Attained => 1 << 12 | stopped,
            Self::Failed => 1 << 13 | stopped,
        }
    }
}
