//! Ends, symmetry, and comparison with every drivable path of a few segments, forwards and in reverse.

use super::*;
use crate::Motion;

const RADIUS: f64 = 0.857;

fn misses(at: Pose, to: Pose) -> f64 {
    at.point().distance(to.point()) + libm::fabs((at.theta - to.theta).radians())
}

/// Poses on a lattice, including special ones (same place, half turns, on the circles), and some between.
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
fn every_word_ends_at_its_target_and_the_shortest_is_among_them() {
    let from = Pose::new(1.0, -2.0, 0.7);
    let mut seen = [false; 6];
    lattice(|relative| {
        let to = from * relative;
        let (mut shortest, mut words) = (f64::INFINITY, 0);
        reeds_shepp_words(from, to, RADIUS, |curve| {
            assert!(misses(curve.end(from), to) < 1e-7, "{relative:?}: {curve:?}");
            assert!(curve.arcs().iter().all(|piece| libm::fabs(piece.curvature) < 1.0 / RADIUS + 1e-12));
            shortest = shortest.min(curve.length());
            words += 1;
        });
        let best = reeds_shepp(from, to, RADIUS);
        assert!(words > 0 && words <= 48, "{relative:?}: {words}");
        assert!(libm::fabs(best.length() - shortest) < 1e-7, "{relative:?}");
        assert!(libm::fabs(best.length() - reeds_shepp_length(from, to, RADIUS)) < 1e-7);
        assert!(best.length() + 1e-9 >= from.point().distance(to.point()));
        seen[best.arcs().len()] = true;
    });
    assert_eq!(seen, [true; 6], "the lattice has shortest words of nought to five pieces");
}

#[test]
fn the_reversed_path_has_the_same_length() {
    lattice(|to| {
        let there = reeds_shepp_length(Pose::default(), to, RADIUS);
        let back = reeds_shepp_length(to, Pose::default(), RADIUS);
        let mirrored = reeds_shepp_length(Pose::default(), Pose::new(to.x, -to.y, -to.theta.radians()), RADIUS);
        assert!(libm::fabs(there - back) < 1e-7 && libm::fabs(there - mirrored) < 1e-7, "{to:?}: {there} {back}");
        assert!(there <= crate::dubins_length(Pose::default(), to, RADIUS) + 1e-7, "{to:?}");
    });
}

#[test]
fn no_path_of_four_segments_is_shorter() {
    // All words of up to four segments from three turns, both directions, and lengths in steps of π/8 and some between.
    const LENGTHS: [f64; 6] = [0.2, PI / 8.0, PI / 4.0, PI / 2.0, 2.0, 3.0];
    fn drive(at: Pose, driven: f64, left: u32) {
        assert!(reeds_shepp_length(Pose::default(), at, 1.0) < driven + 1e-7, "{at:?} in {driven}");
        if left == 0 {
            return;
        }
        for curvature in [-1.0, 0.0, 1.0] {
            for length in LENGTHS.into_iter().flat_map(|length| [length, -length]) {
                let way = Motion { translation: length, rotation: length * curvature };
                drive(at.along(way), driven + libm::fabs(length), left - 1);
            }
        }
    }
    drive(Pose::default(), 0.0, 4);
}

#[test]
fn known_paths() {
    let length = |x, y, degrees: f64| reeds_shepp_length(Pose::default(), Pose::new(x, y, degrees.to_radians()), 1.0);
    for (x, y, degrees, known) in [
        (0.0, 0.0, 0.0, 0.0),
        (-3.0, 0.0, 0.0, 3.0),
        (0.0, 2.0, 180.0, PI),
        // On the spot, a half turn in three: a third of a circle each.
        (0.0, 0.0, 180.0, PI),
        (1.0, 1.0, 90.0, PI / 2.0),
    ] {
        assert!(libm::fabs(length(x, y, degrees) - known) < 1e-9, "{x} {y} {degrees}: {}", length(x, y, degrees));
    }
    assert_eq!(length(f64::NAN, 0.0, 0.0), f64::INFINITY);
    assert!(reeds_shepp(Pose::default(), Pose::new(f64::INFINITY, 0.0, 0.0), 1.0).arcs().is_empty());
}
