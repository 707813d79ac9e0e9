//! Planned path.

use kinematics::Direction;
use kinematics::Twist;
use navitools::{Arc, Pose};

/// Turn between two poses of a path on which the robot turns on the spot, rad, at most.
const TURN_SPACING_RAD: f64 = 0.1;

/// Part of a path: motion with a constant velocity in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Move {
    /// Arc or straight line, forwards or in reverse.
    Arc(Arc),
    /// Turn on the spot, rad, counter-clockwise.
    Turn(f64),
    /// Straight to the side without a turn, m, to the left.
    Aside(f64),
}

impl Move {
    /// Signed size: m along the robot or to its left, rad counter-clockwise.
    #[must_use]
    pub fn size(self) -> f64 {
        match self {
            Self::Arc(arc) => arc.length,
            Self::Turn(size) | Self::Aside(size) => size,
        }
    }

    /// The same motion with another signed size.
    #[must_use]
    pub fn with(self, size: f64) -> Self {
        match self {
            Self::Arc(arc) => Self::Arc(Arc { length: size, ..arc }),
            Self::Turn(_) => Self::Turn(size),
            Self::Aside(_) => Self::Aside(size),
        }
    }

    /// Size without its sign, m or rad.
    #[must_use]
    pub fn extent(self) -> f64 {
        libm::fabs(self.size())
    }

    /// Distance that the middle of the rear axle moves, m.
    #[must_use]
    pub fn length(self) -> f64 {
        if let Self::Turn(_) = self { 0.0 } else { self.extent() }
    }

    /// Curvature, 1/m, positive to the left; 0 on the spot and to the side.
    #[must_use]
    pub fn curvature(self) -> f64 {
        if let Self::Arc(arc) = self { arc.curvature } else { 0.0 }
    }

    /// Direction of travel.
    #[must_use]
    pub fn direction(self) -> Direction {
        match (self, self.size() < 0.0) {
            (Self::Arc(_), false) => Direction::Forward,
            (Self::Arc(_), true) => Direction::Backward,
            (Self::Aside(_), false) => Direction::Left,
            (Self::Aside(_), true) => Direction::Right,
            (Self::Turn(_), false) => Direction::TurnLeft,
            (Self::Turn(_), true) => Direction::TurnRight,
        }
    }

    /// Motion for each unit of the size.
    pub(crate) fn twist(self) -> Twist {
        match self {
            Self::Arc(arc) => Twist { vx: 1.0, vy: 0.0, omega: arc.curvature },
            Self::Turn(_) => Twist { vx: 0.0, vy: 0.0, omega: 1.0 },
            Self::Aside(_) => Twist { vx: 0.0, vy: 1.0, omega: 0.0 },
        }
    }

    /// Pose at the end of the motion that begins at `start`; exact.
    #[must_use]
    pub fn from(self, start: Pose) -> Pose {
        match self {
            Self::Arc(arc) => start.along(arc.motion()),
            Self::Turn(angle) => Pose { theta: start.theta + angle, ..start },
            Self::Aside(length) => {
                let (sin, cos) = start.theta.sin_cos();
                Pose { x: start.x - length * sin, y: start.y + length * cos, ..start }
            }
        }
    }
}

impl From<Arc> for Move {
    fn from(arc: Arc) -> Self {
        Self::Arc(arc)
    }
}

/// Pose on a path, and the motion from there to the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Pose of the rear axle's middle in the map.
    pub pose: Pose,
    /// Curvature up to the next point, 1/m, positive to the left; the last point has that of the previous one.
    pub curvature: f64,
    /// Direction of travel up to the next point; the last point has that of the previous one.
    pub direction: Direction,
    /// Distance driven so far, m, in all directions together; it stays on the spot.
    pub s: f64,
}

/// Poses of a path as they are driven, each with the direction in which it is driven to; where the direction changes, a
/// pose occurs twice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Poses {
    /// Poses in order.
    pub poses: Vec<(Pose, Direction)>,
    /// True if the path has less than the whole margin beside it.
    pub narrow: bool,
}

/// Path of arcs and straight lines, and for bases that can turns on the spot and moves to the side, from the start to
/// the goal; the curvature is within the limit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    pub(crate) points: Vec<PathPoint>,
    pub(crate) moves: Vec<Move>,
    pub(crate) cost: f32,
    pub(crate) clearance: f64,
    pub(crate) margin: f64,
}

impl Path {
    /// Poses, the start first, at most 5 cm apart, and 0.1 rad on the spot. At least two, or one if the start is the
    /// goal.
    #[must_use]
    pub fn points(&self) -> &[PathPoint] {
        &self.points
    }

    /// Parts, from the start.
    #[must_use]
    pub fn moves(&self) -> &[Move] {
        &self.moves
    }

    /// Length, m, in all directions together; turns on the spot have none.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.points.last().map_or(0.0, |last| last.s)
    }

    /// Indices of the points at which the direction of travel changes: the robot stops there.
    pub fn cusps(&self) -> impl Iterator<Item = usize> {
        let changes = |pair: &[PathPoint]| pair[0].direction != pair[1].direction;
        self.points.windows(2).enumerate().filter(move |(_, pair)| changes(pair)).map(|(at, _)| at + 1)
    }

    /// Smallest distance of the footprint from an obstacle on the path, m, at most 1 m; 0 if it touches one at the
    /// start. Measured at poses that are at most 10 cm apart, and so close that nothing is touched in between.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        self.clearance
    }

    /// Margin on all sides with which the path was searched, m: less than that of the limits where no path has it.
    #[must_use]
    pub fn margin(&self) -> f64 {
        self.margin
    }

    /// Cost in the search: weighted metres.
    #[must_use]
    pub fn cost(&self) -> f32 {
        self.cost
    }

    /// Fills in points and their derived values from `start` and the parts.
    pub(crate) fn lay(&mut self, start: Pose, spacing: f64) {
        self.points.clear();
        let (mut pose, mut s) = (start, 0.0);
        for part in &self.moves {
            let (curvature, direction, length) = (part.curvature(), part.direction(), part.length());
            let spacing = if direction.turns() { TURN_SPACING_RAD } else { spacing };
            let pieces = libm::ceil(part.extent() / spacing).max(1.0);
            for piece in 0..pieces as u32 {
                let share = f64::from(piece) / pieces;
                let at = part.with(part.size() * share).from(pose);
                self.points.push(PathPoint { pose: at, curvature, direction, s: s + length * share });
            }
            pose = part.from(pose);
            s += length;
        }
        let last = self.points.last().map(|last| (last.curvature, last.direction));
        let (curvature, direction) = last.unwrap_or((0.0, Direction::Forward));
        self.points.push(PathPoint { pose, curvature, direction, s });
    }
}
