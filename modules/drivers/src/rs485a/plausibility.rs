//! Boards that answer and do not measure: they repeat one measurement for ever, or their sonars have all become deaf.
//!
//! **Frozen.** While the robot moves, the distance to whatever is ahead of it or behind it changes. A board whose
//! distances stay the same for [`SWEEPS`] sweeps and [`WAY_M`] of travel, one of them an echo ahead or behind, does not
//! measure. Sonars that look sideways may see a wall at a constant distance, so their echoes, [`TOGETHER`] at least,
//! prove it after [`WAY_SIDEWAYS_M`] only.
//!
//! **Deaf.** Working sonars lose their echoes one after the other. If [`TOGETHER`] or more sonars of a board had an
//! echo within [`WEAK_FROM_MM`], and from the next sweep on all of its sonars are silent for [`DEAF_AFTER`], the board
//! is deaf until one of them has an echo again. Silence always reads the same: after fewer echoes it proves nothing,
//! nor does it after weaker ones, since a single wall may leave the range of all sonars at once.

use super::config::Config;
use crate::rs485_bus::Kind;
use base::{Duration, Instant};
use messages::lowlevel::DataMotion;
use rs485::boards::Implausible;
use rs485::boards::sd1::{Both, NO_ECHO, SRFS, SWEEP, Srfs};

/// Distance travelled over which equal measurements are implausible, m: the distance of what is along the axis changes
/// by half of it at least, several times the sonars' resolution.
const WAY_M: f64 = 0.15;
/// Likewise where all echoes come from the side.
const WAY_SIDEWAYS_M: f64 = 1.0;
/// Number of sweeps that they last at least.
const SWEEPS: u32 = 3;
/// Least cosine of the angle to the robot's axis of a sonar whose distances change with the way.
const ALONG_COS: f64 = 0.5;
/// Speed below which the robot counts as standing, m/s: the measured speed of a robot at rest may jitter for hours.
const STANDSTILL_MPS: f64 = 0.02;
/// Maximum time for which a measured speed counts.
const MOTION_MAX: Duration = Duration::from_millis(200);
/// Number of sonars that do not fall silent together, nor see what is beside them at constant distances.
const TOGETHER: usize = 3;
/// Duration of an unexpected silence after which a board is deaf, two sweeps: each sonar has missed twice or more, and
/// a board that was reset has fired each one.
const DEAF_AFTER: Duration = Duration::from_millis(420);
/// Distance from which on an echo is weak, mm: the last of the six metres that a sonar reaches.
const WEAK_FROM_MM: u16 = 5000;
const _: () = assert!(DEAF_AFTER.as_nanos() == 2 * SWEEP.as_nanos());

/// What a board measured last, and for how long.
#[derive(Debug)]
struct Board {
    address: u8,
    /// Channels that look along the robot's axis.
    along: [bool; SRFS],
    srfs: Srfs,
    since: Instant,
    way_m: f64,
    /// Last answer in which each channel had an echo that was not weak.
    heard: [Option<Instant>; SRFS],
    /// Last answer with an echo.
    last: Instant,
    /// Number of sonars with an echo in the sweep before the board fell silent, and the first silent answer.
    silence: Option<(usize, Instant)>,
}

/// Finds boards that do not measure.
#[derive(Debug)]
pub struct Plausibility {
    boards: Vec<Board>,
    /// Last `LL_DATA_MOTION`: its time, and the absolute speed, m/s; 0 at standstill.
    motion: (Instant, f64),
}

impl Plausibility {
    pub fn new(config: &Config) -> Self {
        let board = |address| {
            let mut along = [false; SRFS];
            for sonar in config.srfs.iter().filter(|sonar| sonar.board == address) {
                if let Some(along) = along.get_mut(usize::from(sonar.channel)) {
                    *along = libm::cos(sonar.theta).abs() >= ALONG_COS;
                }
            }
            Board::new(address, along)
        };
        let sd1 = config.nodes.iter().filter(|node| node.kind == Kind::Sd1);
        Self { boards: sd1.map(|node| board(node.address)).collect(), motion: (Instant::ZERO, 0.0) }
    }

    /// Processes the robot's measured motion.
    pub fn on_motion(&mut self, now: Instant, motion: &DataMotion) {
        let (since, speed) = self.motion;
        let way = speed * now.since(since).min(MOTION_MAX).as_secs_f64();
        self.boards.iter_mut().for_each(|board| board.way_m += way);
        let speed = motion.speed.abs();
        self.motion = (now, if speed.is_finite() && speed >= STANDSTILL_MPS { speed } else { 0.0 });
    }

    /// Returns the measurement, unless its board does not measure.
    ///
    /// # Errors
    /// The board has repeated it for too long, or all of its sonars fell silent at once.
    pub fn judge(&mut self, now: Instant, address: u8, both: Both) -> Result<Both, Implausible> {
        let Some(board) = self.boards.iter_mut().find(|board| board.address == address) else { return Ok(both) };
        if let Some(why) = board.deaf(now, &both.srfs).or_else(|| board.frozen(now, &both.srfs)) {
            return Err(why);
        }
        Ok(both)
    }
}

impl Board {
    fn new(address: u8, along: [bool; SRFS]) -> Self {
        let (since, last) = (Instant::ZERO, Instant::ZERO);
        Self { address, along, srfs: Srfs::default(), since, way_m: 0.0, heard: [None; SRFS], last, silence: None }
    }

    fn frozen(&mut self, now: Instant, srfs: &Srfs) -> Option<Implausible> {
        if self.srfs != *srfs {
            (self.srfs, self.since, self.way_m) = (srfs.clone(), now, 0.0);
            return None;
        }
        let heard = || srfs.iter().zip(self.along).filter(|(mm, _)| **mm != NO_ECHO);
        let way = match () {
            () if heard().any(|(_, along)| along) => WAY_M,
            () if heard().count() >= TOGETHER => WAY_SIDEWAYS_M,
            () => return None,
        };
        let is_frozen = self.way_m >= way && now.since(self.since) >= SWEEP * SWEEPS;
        is_frozen.then_some(Implausible::Frozen { millimetres: (1000.0 * self.way_m) as u32 })
    }

    fn deaf(&mut self, now: Instant, srfs: &Srfs) -> Option<Implausible> {
        if srfs.iter().all(|mm| *mm == NO_ECHO) {
            let recently = |at: &&Instant| self.last.since(**at) <= SWEEP;
            let before = || self.heard.iter().flatten().filter(recently).count();
            let (echoes, since) = *self.silence.get_or_insert_with(|| (before(), now));
            let is_deaf = echoes >= TOGETHER && now.since(since) >= DEAF_AFTER;
            return is_deaf.then_some(Implausible::Deaf { echoes });
        }
        (self.last, self.silence) = (now, None);
        for (heard, _) in self.heard.iter_mut().zip(srfs).filter(|(_, mm)| **mm != NO_ECHO && **mm < WEAK_FROM_MM) {
            *heard = Some(now);
        }
        None
    }
}
