//! From a recording to the lidar's place on the robot, or to what is missing in it.

use super::odometry::{Errors, Velocity, Way};
use super::solve::{Hit, Solution, again, solve};
use super::walls::{Beam, Wall, apart, find, follow};
use std::fmt;

/// What was recorded. Times count from the same instant, s.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Velocities of the body, in order.
    pub velocities: Vec<Velocity>,
    /// Beams that hit something, in order.
    pub beams: Vec<Beam>,
}

/// Time for which the robot stands at the begin, s.
pub const STILL_S: f64 = 1.0;
/// Beams of that time from which walls are found.
const STILL_BEAMS: usize = 300;
/// Longest pause between two velocities, s.
const GAP_S: f64 = 0.3;
/// Beams of a revolution on a wall that are used.
const USED: usize = 16;
/// Points within this distance of a wall are on it, once the place is nearly known, m.
const ON_WALL_M: f64 = 0.06;
/// Smallest way and turn that can determine anything, m and rad.
const TRAVEL_MIN_M: f64 = 0.5;
const TURN_MIN_RAD: f64 = 0.5;
/// Standard deviations of what is determined: of the direction, rad, and of the place, m.
pub const THETA_MAX_RAD: f64 = 0.005;
pub const PLACE_MAX_M: f64 = 0.010;
/// Points of walls that do not move, and wheels that do not slip, fit this well, m.
const RMS_MAX_M: f64 = 0.030;
/// Share of the beams on a followed wall that must fit the solution.
const SHARE_MIN: f64 = 0.6;
/// Distance by which a wall may seem to have moved, m, and its direction, rad.
const SLIP_MAX_M: f64 = 0.03;
const SLIP_MAX_RAD: f64 = 0.02;
/// Errors beyond which the odometry is useless: of way and turn, and the rotation per metre, rad.
const ERRORS_MAX: [f64; 3] = [0.1, 0.12, 0.12];

/// Why nothing can be said yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// The robot did not stand for long enough at the begin, or no beams came meanwhile.
    NotStill,
    /// No straight wall was seen while it stood.
    NoWall,
    /// No velocities came for so long, s.
    Gap(f64),
    /// The walls were lost, or the robot has not moved.
    Unsolved,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotStill => write!(f, "the robot must stand for {STILL_S:.0} s before it moves"),
            Self::NoWall => write!(f, "no straight wall of 0.8 m or more is seen from where the robot stands"),
            Self::Gap(gap) => write!(f, "no velocity was measured for {gap:.1} s"),
            Self::Unsolved => write!(f, "the walls were lost from sight, or the robot has not moved"),
        }
    }
}

/// Why a quantity is not determined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lack {
    /// The way is too short, m.
    Travel(f64),
    /// The robot has turned too little, rad.
    Turn(f64),
    /// The direction is not determined; its standard deviation, rad.
    Direction(f64),
    /// Two directions fit; the other one, rad.
    Rival(f64),
    /// The place is not determined; the larger of its standard deviations, m.
    Place(f64),
    /// Walls and motion do not fit: root mean square of the distances, m, and the share of beams that fit.
    Misfit(f64, f64),
    /// A wall is not where it was seen before the robot moved; by how far, m.
    Slip(f64),
    /// The odometry would have to be wrong by more than it can be: in way and turn, and per metre, rad.
    Odometry(Errors),
}

/// What is not known without the direction: the place is measured in the robot's axes.
const ALL: &str = "theta_rad, x_m, y_m";

impl fmt::Display for Lack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Travel(way) => {
                write!(f, "{ALL}: the way of {way:.2} m is too short; drive straight on for 1 m or more")
            }
            Self::Turn(turn) => write!(
                f,
                "x_m, y_m: a turn of {:.0}° is too little; turn by 60° or more, on the spot or along an arc",
                turn.to_degrees()
            ),
            Self::Direction(deviation) => write!(
                f,
                "{ALL}: not determined (±{:.2}°); drive straight on at 30° to 60° to the wall, or along it",
                deviation.to_degrees()
            ),
            Self::Rival(other) => {
                write!(f, "{ALL}: {other:.3} rad fits as well; drive straight on at another angle to the wall, too",)
            }
            Self::Place(deviation) => write!(
                f,
                "x_m, y_m: not determined (±{deviation:.3} m); turn farther, on the spot or along an arc, with the \
                 wall in view"
            ),
            Self::Misfit(rms, share) => write!(
                f,
                "walls and motion do not fit (±{:.0} mm, {:.0} % of the beams): wheels that slip, a wall that is not \
                 straight or moves, or people before it",
                rms * 1000.0,
                share * 100.0
            ),
            Self::Slip(way) => write!(
                f,
                "a wall seems to have moved by {way:.2} m since the robot stood: wheels have slipped; drive again, \
                 slower"
            ),
            Self::Odometry(errors) => write!(
                f,
                "the odometry does not fit the walls: way {:+.0} %, turn {:+.0} %, {:+.2} rad per metre; see \
                 wheel_radius_m, track_m, gear",
                errors.travel * 100.0,
                errors.turn * 100.0,
                errors.drift
            ),
        }
    }
}

impl Lack {
    /// True if the direction is not known by it.
    fn is_of_direction(&self) -> bool {
        !matches!(self, Self::Turn(_) | Self::Place(_))
    }
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The place that fits best, whether it is determined or not.
    pub solution: Solution,
    /// Way, m, and turn, rad, by the odometry.
    pub travelled: f64,
    pub turned: f64,
    /// Share of the beams on followed walls that fit.
    pub share: f64,
    /// What is missing.
    pub lacks: Vec<Lack>,
}

impl Estimate {
    /// True if the direction is determined.
    pub fn has_direction(&self) -> bool {
        !self.lacks.iter().any(Lack::is_of_direction)
    }

    /// True if the place is determined: in the robot's axes it needs the direction.
    pub fn has_place(&self) -> bool {
        self.lacks.is_empty()
    }
}

/// Walls that are seen before the robot moves.
pub fn standing(recording: &Recording) -> Result<Vec<Wall>, Refusal> {
    let end = still_until(recording).ok_or(Refusal::NotStill)?;
    let from = end - 2.0 * STILL_S;
    let still = recording.beams.iter().filter(|beam| (from..end).contains(&beam.at));
    let points: Vec<[f64; 2]> = still.map(Beam::point).collect();
    if points.len() < STILL_BEAMS {
        return Err(Refusal::NotStill);
    }
    let walls = find(&points);
    if walls.is_empty() { Err(Refusal::NoWall) } else { Ok(walls) }
}

/// End of the first time in which the robot stood, if that was long enough.
fn still_until(recording: &Recording) -> Option<f64> {
    let velocities = &recording.velocities;
    let first = velocities.first()?.at;
    let moves = velocities.iter().position(|velocity| !velocity.is_zero());
    let end = velocities[..moves.unwrap_or(velocities.len())].last()?.at;
    // The last zero may be of a robot that has just begun to move.
    let end = if moves.is_some() { end - 0.05 } else { end };
    (end - first >= STILL_S).then_some(end)
}

/// The lidar's place by all that was recorded.
pub fn estimate(recording: &Recording) -> Result<Estimate, Refusal> {
    let velocities = &recording.velocities;
    let gap = velocities.windows(2).map(|pair| pair[1].at - pair[0].at).fold(0.0, f64::max);
    if gap > GAP_S {
        return Err(Refusal::Gap(gap));
    }
    let walls = standing(recording)?;
    let end = still_until(recording).ok_or(Refusal::NotStill)?;
    let way = Way::new(velocities, &Errors::default());
    let beams: Vec<Beam> =
        recording.beams.iter().copied().filter(|beam| beam.at >= end - STILL_S && way.covers(beam.at)).collect();
    let followed = follow(&walls, &beams, &way);
    let first = solve(&hits(&followed), velocities, &walls).ok_or(Refusal::Unsolved)?;
    // Now that the place is nearly known, the walls are found again where they were lost.
    let on = |solution: &Solution| {
        let way = Way::new(velocities, &solution.errors);
        let mut on = Vec::new();
        for beam in &beams {
            let point = solution.still(&way, beam.at, beam.point());
            let distances = solution.walls.iter().map(|wall| wall.behind(point).abs()).enumerate();
            let nearest = distances.min_by(|(_, a), (_, b)| a.total_cmp(b));
            on.extend(nearest.filter(|(_, distance)| *distance < ON_WALL_M).map(|(wall, _)| (wall, *beam)));
        }
        on
    };
    let second = again(&hits(&on(&first)), velocities, &first).ok_or(Refusal::Unsolved)?;
    let on_second = on(&second);
    let solution = again(&hits(&on_second), velocities, &second).ok_or(Refusal::Unsolved)?;
    let share = share(&followed, &solution, velocities);
    let (travelled, turned) = way.extent();
    let mut lacks = judge(&solution, share, travelled, turned);
    lacks.extend(slip(&walls, &solution.walls).map(Lack::Slip));
    Ok(Estimate { solution, travelled, turned, share, lacks })
}

/// By how far a wall seems to have moved, m, if it has: from where it was seen before the motion to where it fits all.
fn slip(before: &[Wall], after: &[Wall]) -> Option<f64> {
    let moved = |(before, after): (&Wall, &Wall)| {
        let way = (before.distance - after.distance).abs();
        let turned = apart(before.normal, after.normal).abs();
        (way > SLIP_MAX_M || turned > SLIP_MAX_RAD).then(|| way.max(turned * before.distance))
    };
    before.iter().zip(after).filter_map(moved).reduce(f64::max)
}

/// Share of the beams on followed walls that fit the solution.
fn share(followed: &[(usize, Beam)], solution: &Solution, velocities: &[Velocity]) -> f64 {
    let way = Way::new(velocities, &solution.errors);
    let fits = |(wall, beam): &&(usize, Beam)| {
        let point = solution.still(&way, beam.at, beam.point());
        solution.walls.get(*wall).is_some_and(|wall| wall.behind(point).abs() < ON_WALL_M)
    };
    followed.iter().filter(fits).count() as f64 / followed.len().max(1) as f64
}

/// Some beams of each wall and revolution, equally far from each other.
fn hits(on: &[(usize, Beam)]) -> Vec<Hit> {
    let mut hits = Vec::new();
    for turn in on.chunk_by(|(_, a), (_, b)| a.revolution == b.revolution) {
        let walls = turn.iter().map(|(wall, _)| *wall).max().unwrap_or(0);
        for wall in 0..=walls {
            let of: Vec<&Beam> = turn.iter().filter(|(at, _)| *at == wall).map(|(_, beam)| beam).collect();
            let step = of.len().div_ceil(USED).max(1);
            hits.extend(of.into_iter().step_by(step).map(|beam| Hit { at: beam.at, point: beam.point(), wall }));
        }
    }
    hits
}

/// What is missing.
fn judge(solution: &Solution, share: f64, travelled: f64, turned: f64) -> Vec<Lack> {
    let mut lacks = Vec::new();
    let errors = solution.errors;
    let [x, y, theta] = solution.deviation;
    if travelled < TRAVEL_MIN_M {
        lacks.push(Lack::Travel(travelled));
    } else if theta > THETA_MAX_RAD {
        lacks.push(Lack::Direction(theta));
    } else if let Some(rival) = solution.rival {
        lacks.push(Lack::Rival(rival));
    }
    if turned < TURN_MIN_RAD {
        lacks.push(Lack::Turn(turned));
    } else if x.max(y) > PLACE_MAX_M && lacks.is_empty() {
        lacks.push(Lack::Place(x.max(y)));
    }
    let sizes = [errors.travel, errors.turn, errors.drift].map(f64::abs);
    if solution.rms > RMS_MAX_M || share < SHARE_MIN {
        lacks.push(Lack::Misfit(solution.rms, share));
    } else if sizes.iter().zip(ERRORS_MAX).any(|(size, most)| *size > most) {
        lacks.push(Lack::Odometry(errors));
    }
    lacks
}
