//! Curves of arcs and straight lines, drivable by a car-like robot.

use crate::{Arc, Pose};

/// Up to five segments: a word of Reeds and Shepp, or of Dubins.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Curve {
    arcs: [Arc; 5],
    count: u8,
}

impl Curve {
    /// Creates a curve from at most five segments in the order of driving; segments of length zero are left out.
    pub(crate) fn new(pieces: impl Iterator<Item = Arc>) -> Self {
        let mut curve = Self::default();
        for piece in pieces.filter(|piece| piece.length != 0.0) {
            curve.arcs[usize::from(curve.count)] = piece;
            curve.count += 1;
        }
        curve
    }

    /// Segments in order; a straight line is an arc of curvature 0.
    #[must_use]
    pub fn arcs(&self) -> &[Arc] {
        &self.arcs[..usize::from(self.count)]
    }

    /// Length, m, forwards and in reverse together.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.arcs().iter().map(|arc| libm::fabs(arc.length)).sum()
    }

    /// Number of changes between forwards and reverse.
    #[must_use]
    pub fn cusps(&self) -> usize {
        self.arcs().windows(2).filter(|pair| (pair[0].length < 0.0) != (pair[1].length < 0.0)).count()
    }

    /// End pose of the curve from `start`.
    #[must_use]
    pub fn end(&self, start: Pose) -> Pose {
        self.arcs().iter().fold(start, |pose, arc| pose.along(arc.motion()))
    }
}
