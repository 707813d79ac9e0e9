//! Ends, symmetry, and comparison with every drivable path of a few segments.

use super::*;
use crate::Motion;

const RADIUS: f64 = 0.857;

fn lattice(mut visit: impl FnMut(Pose)) {
    for x in -8..=8 {
        for y in -8..=8 {
            for turn in -12..12 {
                let (x, y, theta) = (f64::from(x), f64::from(y), f64::from(turn) * PI / 12.0);
                visit(Pose::new(x * RADIUS / 2.0, y * RADIUS / 2.0, theta));
                visit(Pose::new(x * 0.313 + 0.01, y * 0.2717, theta + 0.1));
            }
        }
    }
}

#[test]
fn every_path_ends_at_its_target_and_never_reverses() {
    let from = Pose::new(1.0, -2.0, 0.7);
    lattice(|relative| {
        let to = from * relative;
        let curve = dubins(from, to, RADIUS);
        let end = curve.end(from);
        let off = end.point().distance(to.point()) + libm::fabs((end.theta - to.theta).radians());
        assert!(off < 1e-6, "{relative:?}: {curve:?}");
        assert!(curve.arcs().iter().all(|piece| piece.length > 0.0) && curve.cusps() == 0);
        assert!(libm::fabs(curve.length() - dubins_length(from, to, RADIUS)) < 1e-9);
    });
}

#[test]
fn the_reversed_problem_has_the_same_length() {
    lattice(|to| {
        let there = dubins_length(Pose::default(), to, RADIUS);
        let about = |pose: Pose| Pose::new(pose.x, pose.y, pose.theta.radians() + PI);
        let back = dubins_length(about(to), about(Pose::default()), RADIUS);
        assert!(libm::fabs(there - back) < 1e-6, "{to:?}: {there} {back}");
    });
}

#[test]
fn no_path_of_four_segments_is_shorter() {
    const LENGTHS: [f64; 7] = [0.2, PI / 8.0, PI / 4.0, PI / 2.0, 2.0, 3.0, 5.0];
    fn drive(at: Pose, driven: f64, left: u32) {
        assert!(dubins_length(Pose::default(), at, 1.0) < driven + 1e-7, "{at:?} in {driven}");
        if left == 0 {
            return;
        }
        for curvature in [-1.0, 0.0, 1.0] {
            for length in LENGTHS {
                drive(
                    at.along(Motion { translation: length, rotation: length * curvature }),
                    driven + length,
                    left - 1,
                );
            }
        }
    }
    drive(Pose::default(), 0.0, 4);
}

#[test]
fn known_paths() {
    let length = |x, y, degrees: f64| dubins_length(Pose::default(), Pose::new(x, y, degrees.to_radians()), 1.0);
    assert_eq!(length(0.0, 0.0, 0.0), 0.0);
    assert!(libm::fabs(length(0.0, 2.0, 180.0) - PI) < 1e-9);
    // On the spot, a half turn: a sixth left, five sixths right, a sixth left.
    assert!(libm::fabs(length(0.0, 0.0, 180.0) - 7.0 * PI / 3.0) < 1e-9);
    assert_eq!(length(f64::NAN, 0.0, 0.0), f64::INFINITY);
}
