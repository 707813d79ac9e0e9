//! Homing of an emulated drive: the motion of [`Method::plan`], with the switches that the drive senses.

use super::Sensed;
use crate::axis::modes::method::{Direction, Method, Plan, Switch};

/// Progress of homing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Homing {
    /// Not started, or interrupted.
    Idle,
    /// Towards the switch; `turns` more limits may reverse it.
    Search { plan: Plan, direction: Direction, turns: u8 },
    /// At the switch's edge.
    Leg { plan: Plan, at: usize },
    /// The next index pulse.
    Index { direction: Direction },
    /// Home is where it is.
    Here,
    /// On the way from the switch to where home is.
    Offset { target: f64 },
    /// Done.
    Attained,
    /// Ended without success.
    Failed,
}

/// Motion that homing requests.
pub(super) enum Wish {
    /// Run at this speed.
    Run(f64),
    /// Come to a stop.
    Stop,
    /// The position is the home position.
    Here,
    /// Go there; there is home.
    Go(f64),
}

impl Homing {
    pub fn start(method: Option<Method>, sensed: &Sensed) -> Self {
        let Some(plan) = method.map(Method::plan) else {
            return Self::Failed;
        };
        match (plan.search, plan.index) {
            (Some((switch, direction)), _) if !sensed.closed(switch) => Self::Search { plan, direction, turns: 2 },
            (Some(_), _) => Self::Leg { plan, at: 0 },
            (None, Some(direction)) => Self::Index { direction },
            (None, None) => Self::Here,
        }
    }

    pub fn interrupt(&mut self) {
        if self.runs() {
            *self = Self::Idle;
        }
    }

    pub fn runs(self) -> bool {
        !matches!(self, Self::Idle | Self::Attained | Self::Failed)
    }

    /// Ends homing as failed.
    pub fn fail(&mut self) {
        if self.runs() {
            *self = Self::Failed;
        }
    }

    /// One step, with the speeds of the search and of the edge; `index`: an index pulse occurred in this step.
    pub fn step(&mut self, sensed: &Sensed, index: bool, [fast, slow]: [f64; 2]) -> Wish {
        *self = self.next(sensed, index);
        match *self {
            Self::Search { direction, .. } => Wish::Run(direction.sign() * fast),
            Self::Leg { plan, at } => match plan.legs[at] {
                Some(leg) => Wish::Run(leg.direction.sign() * slow),
                None => Wish::Stop,
            },
            Self::Index { direction } => Wish::Run(direction.sign() * slow),
            Self::Here => {
                *self = Self::Attained;
                Wish::Here
            }
            Self::Offset { target } => Wish::Go(target),
            Self::Idle | Self::Attained | Self::Failed => Wish::Stop,
        }
    }

    fn next(self, sensed: &Sensed, index: bool) -> Self {
        match self {
            Self::Search { plan: plan @ Plan { search: Some((switch, _)), .. }, .. } if sensed.closed(switch) => {
                Self::Leg { plan, at: 0 }.next(sensed, index)
            }
            Self::Search { plan, direction, turns } if sensed.closed(limit(direction)) => match turns {
                1 => Self::Failed,
                _ => Self::Search { plan, direction: direction.reversed(), turns: turns - 1 },
            },
            Self::Leg { plan, at } => {
                let closed = plan.search.is_some_and(|(switch, _)| sensed.closed(switch));
                match (plan.legs.get(at).copied().flatten(), plan.index) {
                    (Some(leg), _) if leg.active == closed => Self::Leg { plan, at: at + 1 }.next(sensed, index),
                    (Some(leg), _) if plan.search.map(|(switch, _)| switch) != Some(limit(leg.direction)) => {
                        if sensed.closed(limit(leg.direction)) { Self::Failed } else { self }
                    }
                    (Some(_), _) => self,
                    (None, Some(direction)) => Self::Index { direction },
                    (None, None) => Self::Here,
                }
            }
            Self::Index { .. } if index => Self::Here,
            Self::Index { direction } if sensed.closed(limit(direction)) => Self::Failed,
            _ => self,
        }
    }

    /// Bits 10, 12 and 13 of the statusword.
    pub fn status(self, stopped: bool) -> u16 {
        let stopped = u16::from(stopped) << 10;
        match self {
            Self::Search { .. } | Self::Leg { .. } | Self::Index { .. } | Self::Here | Self::Offset { .. } => 0,
            Self::Idle => 1 << 10,
            Self::Attained => 1 << 12 | stopped,
            Self::Failed => 1 << 13 | stopped,
        }
    }
}

fn limit(direction: Direction) -> Switch {
    match direction {
        Direction::Negative => Switch::NegativeLimit,
        Direction::Positive => Switch::PositiveLimit,
    }
}
