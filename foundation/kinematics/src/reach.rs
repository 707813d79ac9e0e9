//! What a base can do next: the paths that it can take within the reaction time, for any kind of base.

use crate::Twist;
use alloc::vec::Vec;

/// Way in which a base moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Along x.
    Forward,
    /// Against x.
    Backward,
    /// Along y.
    Left,
    /// Against y.
    Right,
    /// On the spot, counter-clockwise; the unit of its path is 1 rad.
    TurnLeft,
    /// On the spot, clockwise; the unit of its path is 1 rad.
    TurnRight,
}

impl Direction {
    /// All of them, each beside its opposite.
    pub const ALL: [Self; 6] =
        [Self::Forward, Self::Backward, Self::Left, Self::Right, Self::TurnLeft, Self::TurnRight];

    /// Unit vector of the motion in the robot's frame; zero for a rotation on the spot.
    #[must_use]
    pub fn ahead(self) -> (f64, f64) {
        match self {
            Self::Forward => (1.0, 0.0),
            Self::Backward => (-1.0, 0.0),
            Self::Left => (0.0, 1.0),
            Self::Right => (0.0, -1.0),
            Self::TurnLeft | Self::TurnRight => (0.0, 0.0),
        }
    }

    /// The opposite direction.
    #[must_use]
    pub fn opposite(self) -> Self {
        Self::ALL[self as usize ^ 1]
    }

    /// True for a rotation on the spot.
    #[must_use]
    pub fn turns(self) -> bool {
        matches!(self, Self::TurnLeft | Self::TurnRight)
    }
}

/// Measured motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Velocity, m/s and rad/s.
    pub velocity: Twist,
    /// Angle of the steering, rad; of a base without one 0.
    pub steering: f64,
}

/// A kind of base.
pub trait Kinematics {
    /// Adds the paths in a direction that the base can take within `reaction` s from the measured motion, the one
    /// without any change first; none if the base cannot move in that direction. A path's unit is 1 m, on the spot 1
    /// rad.
    fn reachable(&self, direction: Direction, motion: &Motion, reaction: f64, paths: &mut Vec<Twist>);

    /// Velocity in the robot's frame that belongs to a measured speed and steering angle, m/s and rad.
    fn velocity(&self, speed: f64, steering: f64) -> Twist;
}

/// A base with a steered axle: its reference point is the middle of the other one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ackermann {
    /// Distance of the axles, m.
    pub wheelbase: f64,
    /// Greatest angle of the equivalent single wheel, rad.
    pub steering: f64,
    /// Greatest rate of that angle, rad/s.
    pub steering_rate: f64,
}

impl Kinematics for Ackermann {
    fn reachable(&self, direction: Direction, motion: &Motion, reaction: f64, paths: &mut Vec<Twist>) {
        let sign = match direction {
            Direction::Forward => 1.0,
            Direction::Backward => -1.0,
            _ => return,
        };
        let turn = self.steering_rate * reaction;
        // A hand's breadth beyond the end stop is measured, too, when the stop is worn.
        let most = self.steering.max(motion.steering.abs());
        for angle in [motion.steering, motion.steering - turn, motion.steering + turn] {
            let path = self.velocity(1.0, angle.clamp(-most, most));
            paths.push(Twist { vx: sign, vy: 0.0, omega: sign * path.omega });
        }
    }

    fn velocity(&self, speed: f64, steering: f64) -> Twist {
        Twist { vx: speed, vy: 0.0, omega: speed * libm::tan(steering) / self.wheelbase }
    }
}

/// Base of a robot: it drives on the curves of a base that steers, and may have turns on the spot and moves to the side
/// beside them, each by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base {
    /// Curves.
    pub curves: Ackermann,
    /// It turns on the spot.
    pub turns: bool,
    /// It goes sideways.
    pub sideways: bool,
}

impl From<Ackermann> for Base {
    /// A base that steers.
    fn from(curves: Ackermann) -> Self {
        Self { curves, turns: false, sideways: false }
    }
}

impl Kinematics for Base {
    fn reachable(&self, direction: Direction, motion: &Motion, reaction: f64, paths: &mut Vec<Twist>) {
        let (vx, vy, omega) = match direction {
            Direction::Left if self.sideways => (0.0, 1.0, 0.0),
            Direction::Right if self.sideways => (0.0, -1.0, 0.0),
            Direction::TurnLeft if self.turns => (0.0, 0.0, 1.0),
            Direction::TurnRight if self.turns => (0.0, 0.0, -1.0),
            _ => return self.curves.reachable(direction, motion, reaction, paths),
        };
        paths.push(Twist { vx, vy, omega });
    }

    fn velocity(&self, speed: f64, steering: f64) -> Twist {
        self.curves.velocity(speed, steering)
    }
}

/// Any base, by a table: the paths of each direction, the usual one first, whatever its motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Paths, in the order of [`Direction::ALL`].
    pub paths: [Vec<Twist>; 6],
}

impl Kinematics for Table {
    fn reachable(&self, direction: Direction, _: &Motion, _: f64, paths: &mut Vec<Twist>) {
        paths.extend_from_slice(&self.paths[direction as usize]);
    }

    fn velocity(&self, speed: f64, _: f64) -> Twist {
        Twist { vx: speed, ..Twist::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    const BASE: Ackermann = Ackermann { wheelbase: 0.6, steering: 0.61, steering_rate: 0.7 };

    fn reachable(direction: Direction, steering: f64) -> Vec<Twist> {
        let mut paths = Vec::new();
        BASE.reachable(direction, &Motion { steering, ..Motion::default() }, 0.1, &mut paths);
        paths
    }

    #[test]
    fn the_steering_moves_by_its_rate_and_no_farther_than_its_stop() {
        let angles = |direction, steering| {
            let angle = |path: &Twist| libm::atan(path.omega / path.vx * BASE.wheelbase);
            reachable(direction, steering)
                .iter()
                .map(angle)
                .map(|angle| (angle * 1e6).round() / 1e6)
                .collect::<Vec<_>>()
        };
        assert_eq!(angles(Direction::Forward, 0.0), [0.0, -0.07, 0.07]);
        assert_eq!(angles(Direction::Backward, 0.58), [0.58, 0.51, 0.61]);
        assert_eq!(angles(Direction::Forward, 0.63), [0.63, 0.56, 0.63], "beyond the stop as it was measured");
    }

    #[test]
    fn other_bases_turn_on_the_spot_and_go_sideways_beside_the_same_curves() {
        let base = Base { turns: true, ..BASE.into() };
        for base in [base, Base { sideways: true, ..base }] {
            let of = |direction| {
                let mut paths = Vec::new();
                base.reachable(direction, &Motion::default(), 0.1, &mut paths);
                paths
            };
            assert_eq!(
                [Direction::Forward, Direction::Backward].map(of),
                [Direction::Forward, Direction::Backward].map(|direction| reachable(direction, 0.0))
            );
            let one = |vy, omega| vec![Twist { vx: 0.0, vy, omega }];
            assert_eq!([Direction::TurnLeft, Direction::TurnRight].map(of), [one(0.0, 1.0), one(0.0, -1.0)]);
            let aside = if base.sideways { [one(1.0, 0.0), one(-1.0, 0.0)] } else { [vec![], vec![]] };
            assert_eq!([Direction::Left, Direction::Right].map(of), aside);
        }
    }

    #[test]
    fn a_steered_base_moves_neither_sideways_nor_on_the_spot() {
        for direction in &Direction::ALL[2..] {
            assert_eq!(reachable(*direction, 0.1), []);
        }
    }
}
