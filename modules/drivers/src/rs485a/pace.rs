//! Rates at which the distance boards are polled: faster while their readings matter sooner.
//!
//! A board finishes a slot every 70 ms, however often it is polled, and each of its sonars fires once in a sweep of 210
//! ms; crosstalk forbids more. Polling cannot add readings. It decides how old they are when they arrive: at 4 Hz 178
//! ms on average and 278 ms at most since they fired, at 20 Hz 95 ms and 115 ms. So while the robot drives, the boards
//! that look in the direction of travel are polled at 20 Hz, faster than slots end, and the others at 10 Hz. That uses
//! 9 % of a line of 115,200 Bd (`docs/facts/boards.md` 1: 32 words a poll). At standstill all are polled at their
//! configured rates.

use super::config::Config;
use crate::rs485_bus::Kind;
use base::Duration;
use messages::lowlevel::DataMotion;

/// Period of boards that look in the direction of travel.
const LEADING_PERIOD: Duration = Duration::from_millis(50);
/// Longest period of the others while the robot drives.
const OTHERS_PERIOD: Duration = Duration::from_millis(100);
/// A board looks in a direction if the cosine of the angle to the axis of any of its sonars is above this: 66°.
const LOOKS_COS: f64 = 0.4;
/// Speed above which the robot drives, m/s; the drive's resolution is 0.012 m/s.
const DRIVES_MPS: f64 = 0.02;

/// The robot's motion, as far as it matters here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Travel {
    /// It stands, or `LL_DATA_MOTION` was never received.
    #[default]
    Standing,
    Forward,
    Backward,
}

#[derive(Debug)]
struct Board {
    address: u8,
    /// Configured period.
    period: Duration,
    looks_forward: bool,
    looks_backward: bool,
}

/// Poll rates of all SD1 boards.
#[derive(Debug)]
pub struct Pace {
    boards: Vec<Board>,
    travel: Travel,
}

impl Pace {
    /// All boards at their configured rates.
    pub fn new(config: &Config) -> Self {
        let board = |address: u8, rate_hz: f64| {
            let looks = |sign: f64| {
                let mut sonars = config.srfs.iter().filter(|sonar| sonar.board == address);
                sonars.any(|sonar| sign * libm::cos(sonar.theta) > LOOKS_COS)
            };
            let period = Duration::from_secs_f64(1.0 / rate_hz);
            Board { address, period, looks_forward: looks(1.0), looks_backward: looks(-1.0) }
        };
        let sd1 = config.nodes.iter().filter(|node| node.kind == Kind::Sd1);
        Self { boards: sd1.map(|node| board(node.address, node.rate_hz)).collect(), travel: Travel::Standing }
    }

    /// Processes the robot's motion; true if the periods have changed.
    pub fn on_motion(&mut self, motion: &DataMotion) -> bool {
        let speed = if motion.speed_target == 0.0 { motion.speed } else { motion.speed_target };
        let travel = match speed {
            speed if speed > DRIVES_MPS => Travel::Forward,
            speed if speed < -DRIVES_MPS => Travel::Backward,
            _ => Travel::Standing,
        };
        std::mem::replace(&mut self.travel, travel) != travel
    }

    /// True if a board looks in the direction of travel.
    pub fn is_leading(&self, address: u8) -> bool {
        self.boards.iter().any(|board| board.address == address && self.leads(board))
    }

    /// Period of each board by its address.
    pub fn periods(&self) -> impl Iterator<Item = (u8, Duration)> + '_ {
        let period = |board: &Board| match self.travel {
            Travel::Standing => board.period,
            _ if self.leads(board) => board.period.min(LEADING_PERIOD),
            _ => board.period.min(OTHERS_PERIOD),
        };
        self.boards.iter().map(move |board| (board.address, period(board)))
    }

    fn leads(&self, board: &Board) -> bool {
        match self.travel {
            Travel::Standing => false,
            Travel::Forward => board.looks_forward,
            Travel::Backward => board.looks_backward,
        }
    }
}
