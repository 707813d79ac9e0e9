//! Boards that answer and repeat one measurement for ever.
//!
//! While the robot moves, the distance to whatever is ahead of it or behind it changes. A board whose distances stay
//! the same for [`SWEEPS`] sweeps and [`WAY_M`] of travel, one of them an echo ahead or behind, does not measure. A
//! sonar that looks sideways may see a wall at a constant distance, and a sonar without an echo always reads the same:
//! neither proves anything.

use super::config::Config;
use crate::rs485_bus::Kind;
use base::{Duration, Instant};
use messages::lowlevel::DataMotion;
use rs485::boards::Implausible;
use rs485::boards::sd1::{Both, NO_ECHO, SRFS, SWEEP, Srfs};

/// Distance travelled over which equal measurements are implausible, m.
const WAY_M: f64 = 0.3;
/// Number of sweeps that they last at least.
const SWEEPS: u32 = 8;
/// Least cosine of the angle to the robot's axis of a sonar whose distances change with the way.
const ALONG_COS: f64 = 0.5;
/// Maximum time for which a measured speed counts.
const MOTION_MAX: Duration = Duration::from_millis(200);

/// Last measurement of a board, and for how long the board has repeated it.
#[derive(Debug)]
struct Board {
    address: u8,
    /// Channels that look along the robot's axis.
    along: [bool; SRFS],
    srfs: Srfs,
    since: Instant,
    way_m: f64,
}

/// Finds frozen boards.
#[derive(Debug)]
pub struct Frozen {
    boards: Vec<Board>,
    /// Last `LL_DATA_MOTION`: its time, and the absolute speed, m/s.
    motion: (Instant, f64),
}

impl Frozen {
    pub fn new(config: &Config) -> Self {
        let board = |address| {
            let mut along = [false; SRFS];
            for sonar in config.srfs.iter().filter(|sonar| sonar.board == address) {
                if let Some(along) = along.get_mut(usize::from(sonar.channel)) {
                    *along = libm::cos(sonar.theta).abs() >= ALONG_COS;
                }
            }
            Board { address, along, srfs: Srfs::default(), since: Instant::ZERO, way_m: 0.0 }
        };
        let sd1 = config.nodes.iter().filter(|node| node.kind == Kind::Sd1);
        Self { boards: sd1.map(|node| board(node.address)).collect(), motion: (Instant::ZERO, 0.0) }
    }

    /// Processes the robot's measured motion.
    pub fn on_motion(&mut self, now: Instant, motion: &DataMotion) {
        let (since, speed) = self.motion;
        let way = speed * now.since(since).min(MOTION_MAX).as_secs_f64();
        self.boards.iter_mut().for_each(|board| board.way_m += way);
        self.motion = (now, if motion.speed.is_finite() { motion.speed.abs() } else { 0.0 });
    }

    /// Returns the measurement, unless its board is frozen.
    ///
    /// # Errors
    /// The board has repeated it for too long.
    pub fn judge(&mut self, now: Instant, address: u8, both: Both) -> Result<Both, Implausible> {
        let Some(board) = self.boards.iter_mut().find(|board| board.address == address) else { return Ok(both) };
        let hears = board.srfs.iter().zip(board.along).any(|(mm, along)| along && *mm != NO_ECHO);
        if board.srfs != both.srfs || !hears {
            (board.srfs, board.since, board.way_m) = (both.srfs.clone(), now, 0.0);
            return Ok(both);
        }
        let lasts = now.since(board.since);
        if board.way_m < WAY_M || lasts < SWEEP * SWEEPS {
            return Ok(both);
        }
        Err(Implausible::Frozen { millimetres: (1000.0 * board.way_m) as u32 })
    }
}
