//! The outline of a robot as a polygon.

use crate::corners::{Corners, area};
use crate::{Entry, Rule};
use kinematics::{Point, Shape};

/// Corners of an outline at most.
pub const FOOTPRINT_CORNERS_MAX: usize = 32;
/// Coordinates of a corner, m, either way.
const CORNER_MAX_M: f64 = 10.0;
/// Part of the area by which a polygon with a notch is less than its hull; less is rounding.
const NOTCH_MIN: f64 = 1e-6;

/// An outline as it is written, and its convex hull, by which the robot moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// The convex hull, in the robot's frame, m.
    pub shape: Shape,
    /// Area of the hull that the polygon does not have, m²; 0 of a convex one.
    pub filled_m2: f64,
}

/// 3 to 32 corners one after the other around the outline.
pub(crate) struct Outline;

impl Outline {
    const CORNERS: Corners = Corners(-CORNER_MAX_M..=CORNER_MAX_M);
}

impl Rule<Footprint> for Outline {
    fn read(&self, entry: &Entry<'_>) -> Option<Footprint> {
        let corners: Vec<[f64; 2]> = Self::CORNERS.read_at_most(FOOTPRINT_CORNERS_MAX, entry)?;
        let points: Vec<Point> = corners.iter().map(|&[x, y]| Point { x, y }).collect();
        let Some(shape) = Shape::hull(&points) else {
            entry.refuse(self.expected());
            return None;
        };
        let missing = shape.area() - area(&corners);
        let filled_m2 = if missing > NOTCH_MIN * shape.area() { missing } else { 0.0 };
        Some(Footprint { shape, filled_m2 })
    }

    fn expected(&self) -> String {
        Self::CORNERS.expected_at_most(FOOTPRINT_CORNERS_MAX)
    }

    fn stand_in(&self) -> Footprint {
        // It holds all that is asked of one, so that nothing else is reported of it.
        let side = CORNER_MAX_M;
        let corners = [(-side, -side), (side, -side), (side, side), (-side, side)].map(|(x, y)| Point { x, y });
        let shape = Shape::hull(&corners).expect("a square has an area");
        Footprint { shape, filled_m2: 0.0 }
    }

    fn shown(&self, footprint: &Footprint) -> String {
        let corners: Vec<[f64; 2]> = footprint.shape.corners().iter().map(|corner| [corner.x, corner.y]).collect();
        format!("{corners:?}")
    }
}
