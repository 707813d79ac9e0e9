//! Paths that are found, and reasons why others are not.

use super::*;
use crate::map::{Map, Unknown};
use kinematics::Direction;
use navitools::Arc;

pub(crate) const ADVEE: Footprint = Footprint { length_m: 0.90, width_m: 0.60, rear_m: 0.15 };
const RADIUS: f64 = 0.857;

fn limits() -> Limits {
    Limits::new(ADVEE, RADIUS)
}

/// Walls of `(x1, y1, x2, y2)` in a room of 10 m by 8 m.
fn room(walls: &[(f64, f64, f64, f64)]) -> Field {
    let mut map = Map::around((0.0, 0.0), (10.0, 8.0), 0.05).unwrap();
    for &(ax, ay, bx, by) in walls {
        map.wall((ax, ay), (bx, by));
    }
    Field::new(&map, Unknown::Blocked)
}

fn pose_goal(x: f64, y: f64, theta: f64) -> Goal {
    Goal { x, y, heading: Some(theta), tolerance_m: 0.0 }
}

/// Checks that a path begins and ends at the right poses, is drivable, and free.
fn check(field: &Field, start: Pose, path: &Path) {
    let points = path.points();
    assert_eq!(points[0].pose, start);
    let mut pose = start;
    for arc in path.moves() {
        let Move::Arc(arc) = arc else { panic!("{arc:?} of a robot that steers") };
        assert!(libm::fabs(arc.curvature) <= 1.0 / RADIUS + 1e-9, "{arc:?}");
        let pieces = libm::ceil(libm::fabs(arc.length) / 0.01).max(1.0);
        for _ in 0..pieces as u32 {
            pose = pose.along(Arc { length: arc.length / pieces, ..*arc }.motion());
            assert!(ADVEE.is_free(field, pose), "touches at {pose:?}");
        }
    }
    let end = points[points.len() - 1].pose;
    assert!(pose.point().distance(end.point()) < 1e-6);
    for pair in points.windows(2) {
        let way = pair[1].s - pair[0].s;
        assert!(way > 0.0 && way <= 0.05 + 1e-9);
        assert!(pair[0].pose.point().distance(pair[1].pose.point()) <= way + 1e-9);
    }
}

#[test]
fn across_an_empty_room_the_path_is_the_shortest_of_a_car() {
    let field = room(&[]);
    let start = Pose::new(1.0, 1.0, 0.0);
    let mut search = Search::new(limits());
    let path = search.plan(&field, start, pose_goal(8.0, 6.0, 0.0), Budget::default()).unwrap();
    check(&field, start, path);
    let shortest = reeds_shepp_length(start, Pose::new(8.0, 6.0, 0.0), RADIUS);
    assert!(path.length() < shortest * 1.05, "{} {shortest}", path.length());
    let end = path.points().last().unwrap().pose;
    assert!(end.point().distance(navitools::Point { x: 8.0, y: 6.0 }) < 1e-6);
}

#[test]
fn without_a_heading_the_path_ends_at_the_point() {
    let field = room(&[(4.0, 0.0, 4.0, 6.0)]);
    let start = Pose::new(1.0, 1.0, 0.0);
    let goal = Goal { x: 8.0, y: 1.5, heading: None, tolerance_m: 0.0 };
    let mut search = Search::new(limits());
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    check(&field, start, path);
    let end = path.points().last().unwrap().pose;
    assert!(libm::hypot(end.x - 8.0, end.y - 1.5) < 1e-6 && path.cusps().count() == 0);
}

#[test]
fn a_parking_place_is_entered_in_reverse_when_it_must_be() {
    // Bay of 1 m by 1.3 m in the lower wall, to be left forwards.
    let field = room(&[(3.0, 1.5, 5.0, 1.5), (5.0, 1.5, 5.0, 0.2), (6.0, 0.2, 6.0, 1.5), (6.0, 1.5, 10.0, 1.5)]);
    let start = Pose::new(2.0, 4.0, 0.0);
    let goal = pose_goal(5.5, 0.4, core::f64::consts::FRAC_PI_2);
    let mut search = Search::new(limits());
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    check(&field, start, path);
    assert!(path.points().last().unwrap().direction == Direction::Backward && path.cusps().count() % 2 == 1);
}

#[test]
fn a_narrow_bay_is_left_in_short_moves() {
    // Bay of 1.25 m by 0.8 m beside the way, parallel to it: no step of 15 cm has room in it.
    let bay = [(1.0, 1.2, 3.0, 1.2), (3.0, 1.2, 3.0, 0.4), (3.0, 0.4, 4.25, 0.4), (4.25, 0.4, 4.25, 1.2)];
    let field = room(&[&bay[..], &[(4.25, 1.2, 9.0, 1.2)]].concat());
    let start = Pose::new(3.35, 0.825, 0.0);
    let mut search = Search::new(limits());
    let path = search.plan(&field, start, pose_goal(7.0, 3.0, 0.0), Budget::default()).unwrap();
    check(&field, start, path);
    assert!(path.cusps().count() >= 4);
}

#[test]
fn a_door_is_passed_if_the_robot_fits_through() {
    for (door, fits) in [(1.0, true), (0.75, true), (0.55, false)] {
        let field = room(&[(5.0, 0.0, 5.0, 4.0 - door / 2.0), (5.0, 4.0 + door / 2.0, 5.0, 8.0)]);
        let start = Pose::new(2.0, 2.0, 0.0);
        let mut search = Search::new(limits());
        let path = search.plan(&field, start, pose_goal(8.0, 5.0, 0.0), Budget::default());
        match path {
            Ok(path) => check(&field, start, path),
            Err(why) => assert_eq!(why, SearchError::Unreachable),
        }
        assert_eq!(search.status() != Status::NoPath(SearchError::Unreachable), fits, "{door}");
    }
}

#[test]
fn the_margin_is_given_up_in_steps_where_nothing_else_leads_to_the_goal() {
    // Passages between cells of 1 cm, and the largest margin with which the robot fits through.
    for (passage, margin) in [(0.70, 0.02), (0.63, 0.01), (0.615, 0.005), (0.606, 0.0)] {
        let mut map = Map::around((0.0, 0.0), (5.0, 3.0), 0.002).unwrap();
        for side in [-1.0, 1.0] {
            let edge = 1.5 + side * (passage / 2.0 + 0.001);
            map.polygon(&[(2.4, edge), (2.6, edge), (2.6, edge + side), (2.4, edge + side)]);
        }
        let field = Field::new(&map, Unknown::Blocked);
        let mut search = Search::new(limits());
        let start = Pose::new(0.5, 1.5, 0.0);
        let path = search.plan(&field, start, pose_goal(4.0, 1.5, 0.0), Budget::default()).unwrap();
        check(&field, start, path);
        assert_eq!(path.margin(), margin, "{passage}");
        assert!(path.clearance() >= margin / 4.0 && path.clearance() < 0.03 + margin, "{}", path.clearance());
        search.keep_margin(true);
        let kept = search.plan(&field, start, pose_goal(4.0, 1.5, 0.0), Budget::default()).map(Path::margin);
        assert_eq!(kept.is_ok(), margin == 0.02, "{passage} {kept:?}");
    }
}

#[test]
fn an_impossible_request_has_its_reason() {
    let field = room(&[(5.0, 0.0, 5.0, 8.0), (2.0, 5.0, 3.0, 5.0)]);
    let mut search = Search::new(limits());
    let mut why = |start: Pose, goal: Goal, first: u32| {
        search.plan(&field, start, goal, Budget { first, better: 0 }).map(|_| ()).unwrap_err()
    };
    let start = Pose::new(2.0, 2.0, 0.0);
    let most = Budget::default().first;
    assert_eq!(why(start, pose_goal(8.0, 5.0, 0.0), most), SearchError::Unreachable);
    assert_eq!(why(start, pose_goal(2.5, 5.0, 0.0), most), SearchError::GoalBlocked);
    assert_eq!(why(start, Goal { heading: None, ..pose_goal(2.5, 5.0, 0.0) }, most), SearchError::GoalBlocked);
    assert_eq!(why(start, pose_goal(50.0, 5.0, 0.0), most), SearchError::GoalBlocked);
    assert_eq!(why(start, pose_goal(4.7, 4.0, 0.0), most), SearchError::GoalBlocked);
    assert_eq!(why(Pose::new(-3.0, 2.0, 0.0), pose_goal(2.0, 3.0, 0.0), most), SearchError::StartBlocked);
    assert_eq!(why(start, pose_goal(2.0, 3.0, 3.0), 1), SearchError::Budget);
    for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(why(start, pose_goal(odd, 3.0, 0.0), most), SearchError::Invalid);
        assert_eq!(why(start, pose_goal(2.0, 3.0, odd), most), SearchError::Invalid);
        assert_eq!(why(start, Goal { tolerance_m: odd, ..pose_goal(2.0, 3.0, 0.0) }, most), SearchError::Invalid);
        assert_eq!(why(Pose::new(2.0, odd, 0.0), pose_goal(2.0, 3.0, 0.0), most), SearchError::Invalid);
    }
    assert_ne!(why(start, pose_goal(1e300, 3.0, 0.0), most), SearchError::Budget);
    let broken = Limits { radius_m: 0.0, ..limits() };
    let path = Search::new(broken).plan(&field, start, pose_goal(2.0, 3.0, 0.0), Budget::default()).cloned();
    assert_eq!(path, Err(SearchError::Invalid));
}

#[test]
fn boxed_in_is_start_blocked_or_unreachable_and_touching_is_left() {
    let mut search = Search::new(limits());
    // The nose is 10 cm in a wall: out in reverse.
    let field = room(&[(3.0, 2.0, 3.0, 4.0)]);
    let start = Pose::new(2.35, 3.0, 0.0);
    assert!(!ADVEE.is_free(&field, start));
    let path = search.plan(&field, start, pose_goal(6.0, 6.0, 0.0), Budget::default()).unwrap();
    assert!(path.points()[0].direction == Direction::Backward, "away from the wall");
    assert_eq!(path.clearance(), 0.0);
    let free_from = path.points().iter().position(|point| ADVEE.is_free(&field, point.pose)).unwrap();
    assert!(path.points()[free_from].s < 0.4);
    assert!(path.points()[free_from..].iter().all(|point| ADVEE.is_free(&field, point.pose)));
    // A wall before and one behind, both touched.
    let field = room(&[(3.0, 2.0, 3.0, 4.0), (2.25, 2.0, 2.25, 4.0), (2.0, 2.6, 3.2, 2.6), (2.0, 3.4, 3.2, 3.4)]);
    let path = search.plan(&field, start, pose_goal(6.0, 6.0, 0.0), Budget::default());
    assert_eq!(path.map(|_| ()), Err(SearchError::StartBlocked));
    // In a box that is not touched.
    let field = room(&[(1.0, 2.0, 3.5, 2.0), (3.5, 2.0, 3.5, 4.0), (3.5, 4.0, 1.0, 4.0), (1.0, 4.0, 1.0, 2.0)]);
    let path = search.plan(&field, Pose::new(2.0, 3.0, 0.0), pose_goal(6.0, 6.0, 0.0), Budget::default());
    assert_eq!(path.map(|_| ()), Err(SearchError::Unreachable));
}

#[test]
fn a_goal_too_near_to_a_wall_is_met_within_its_tolerance() {
    let field = room(&[]);
    let start = Pose::new(2.0, 2.0, 0.0);
    let goal = pose_goal(9.4, 4.0, 0.0);
    let mut search = Search::new(limits());
    assert_eq!(search.plan(&field, start, goal, Budget::default()).map(|_| ()), Err(SearchError::GoalBlocked));
    for heading in [Some(0.0), None] {
        // Twice: the second search reuses results.
        for _ in 0..2 {
            let goal = Goal { tolerance_m: 0.4, heading, ..goal };
            let path = search.plan(&field, start, goal, Budget::default()).unwrap();
            check(&field, start, path);
            let end = path.points().last().unwrap().pose;
            assert!(libm::hypot(end.x - 9.4, end.y - 4.0) <= 0.4 + 1e-6);
            let turned = libm::fabs(end.theta.radians());
            assert!(heading.is_none() || turned <= 5f64.to_radians() + 1e-9, "{turned}");
        }
    }
}

#[test]
fn an_incremental_search_has_the_same_result() {
    let field = room(&[(4.0, 0.0, 4.0, 6.0), (7.0, 2.0, 7.0, 8.0)]);
    let (start, goal) = (Pose::new(1.0, 1.0, 0.0), pose_goal(8.5, 7.0, 1.0));
    let whole = Search::new(limits()).plan(&field, start, goal, Budget::default()).unwrap().clone();
    for piece in [1, 7, 100, 5000] {
        let mut search = Search::new(limits());
        search.begin(&field, start, goal, Budget::default());
        assert_eq!(search.status(), Status::Searching);
        let mut calls = 0;
        let path = loop {
            let before = search.work();
            calls += 1;
            assert!(calls < 1_000_000);
            match search.advance(&field, piece) {
                Status::Found(path) => break path.clone(),
                Status::NoPath(why) => panic!("{why}"),
                Status::Improving(path) => assert!(path.cost() >= whole.cost()),
                Status::Searching => {}
            }
            assert!(search.work() - before < piece + 500, "{} of {piece}", search.work() - before);
        };
        assert_eq!(path, whole);
        // And once more, with warm buffers.
        assert_eq!(search.plan(&field, start, goal, Budget::default()), Ok(&whole));
    }
}

#[test]
fn temporary_obstacles_are_avoided() {
    let mut field = room(&[]);
    let (start, goal) = (Pose::new(1.0, 4.0, 0.0), pose_goal(8.5, 4.0, 0.0));
    let mut search = Search::new(limits());
    let straight = search.plan(&field, start, goal, Budget::default()).unwrap().length();
    assert!(libm::fabs(straight - 7.5) < 1e-3, "{straight}");
    field.overlay(&[crate::map::Obstacle { x: 5.0, y: 4.0, radius: 0.3 }]);
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    check(&field, start, path);
    assert!(path.length() > 7.55 && path.length() < 8.5 && path.clearance() > 0.02, "{}", path.length());
    // A ring of people around the goal.
    let ring = (0..12).map(|i| {
        let (sin, cos) = libm::sincos(f64::from(i) * core::f64::consts::PI / 6.0);
        crate::map::Obstacle { x: 8.5 + 1.3 * cos, y: 4.0 + 1.3 * sin, radius: 0.3 }
    });
    field.overlay(&ring.collect::<Vec<_>>());
    assert_eq!(search.plan(&field, start, goal, Budget::default()).map(|_| ()), Err(SearchError::Unreachable));
    field.overlay(&[]);
    assert_eq!(search.plan(&field, start, goal, Budget::default()).unwrap().length(), straight);
}

#[test]
fn random_requests_end_with_a_valid_path_or_a_reason() {
    let mut seed = 11u32;
    let mut random = move |low: f64, high: f64| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        low + (high - low) * f64::from(seed >> 8) / f64::from(1 << 24)
    };
    let mut search = Search::new(limits());
    let mut found = 0;
    for _ in 0..60 {
        let walls: Vec<_> =
            (0..6).map(|_| (random(0.0, 10.0), random(0.0, 8.0), random(0.0, 10.0), random(0.0, 8.0))).collect();
        let field = room(&walls);
        let start = Pose::new(random(-0.5, 10.5), random(-0.5, 8.5), random(-4.0, 4.0));
        let heading = (random(0.0, 1.0) < 0.7).then(|| random(-7.0, 7.0));
        let goal =
            Goal { x: random(-0.5, 10.5), y: random(-0.5, 8.5), heading, tolerance_m: random(-0.3, 0.3).max(0.0) };
        let budget = Budget { first: 20_000, better: 2_000 };
        let clear = ADVEE.grown(0.02).is_free(&field, start);
        let fits = search.fits(&field, &goal);
        let planned = search.plan(&field, start, goal, budget);
        assert_eq!(fits, planned.map(|_| ()) != Err(SearchError::GoalBlocked), "{goal:?}");
        if let Ok(path) = planned
            && clear
        {
            check(&field, start, path);
            found += 1;
        }
    }
    assert!(found > 5, "{found}");
}

#[test]
fn the_footprint_check_equals_a_test_of_each_cell() {
    let mut seed = 5u32;
    let mut random = move |high: f64| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) * high
    };
    for footprint in [
        ADVEE,
        Footprint { length_m: 0.4, width_m: 1.0, rear_m: 0.0 },
        Footprint { length_m: 3.0, width_m: 0.5, rear_m: 1.0 },
    ] {
        let (mut free, mut touching) = (0, 0);
        for _ in 0..40 {
            let mut map = Map::around((0.0, 0.0), (6.0, 6.0), 0.05).unwrap();
            (0..12).for_each(|_| map.column((random(6.0), random(6.0)), random(0.2)));
            let field = Field::new(&map, Unknown::Blocked);
            for _ in 0..200 {
                let pose = Pose::new(random(6.0), random(6.0), random(6.3));
                let seen = footprint.is_free(&field, pose);
                // Points all over the rectangle, 1 cm apart: no point in an occupied cell or off the map.
                let points = |length: f64| 0..=libm::ceil(length / 0.01) as u32;
                let touches = points(footprint.length_m).any(|i| {
                    points(footprint.width_m).any(|j| {
                        let x = (f64::from(i) * 0.01).min(footprint.length_m) - footprint.rear_m;
                        let y = (f64::from(j) * 0.01).min(footprint.width_m) - footprint.width_m / 2.0;
                        let at = pose * navitools::Point { x, y };
                        map.at(at.x, at.y) != Some(crate::map::Cell::Free)
                    })
                });
                // A cell that touches only between the points penetrates less than their distance.
                assert!(!(seen && touches), "{pose:?} touches");
                let inner = footprint.grown(-0.015);
                assert!(seen || touches || inner.is_free(&field, pose), "{pose:?} is free");
                free += u32::from(seen);
                touching += u32::from(touches);
            }
        }
        assert!(free > 100 && touching > 100, "{free} {touching}");
    }
}

/// A robot with its body to the right, and a nose: its rectangle, on both sides of the axis, is much wider.
fn to_the_right() -> Limits {
    let corners = [(0.3, -0.25), (0.5, -0.1), (0.3, 0.1), (-0.15, 0.1), (-0.15, -0.25)];
    let shape = kinematics::Shape::hull(&corners.map(|(x, y)| navitools::Point { x, y })).expect("an outline");
    Limits::shaped(&shape, 0.4)
}

#[test]
fn a_gap_that_only_the_polygon_fits_is_passed() {
    let field = room(&[(5.0, 0.0, 5.0, 3.7), (5.0, 4.15, 5.0, 8.0)]);
    let (start, goal) = (Pose::new(2.0, 2.0, 0.0), pose_goal(8.0, 6.0, 0.0));
    let limits = to_the_right();
    let mut search = Search::new(Limits { shape: None, ..limits });
    let blocked = search.plan(&field, start, goal, Budget::default()).map(Path::length);
    assert_eq!(blocked, Err(SearchError::Unreachable), "its rectangle");
    let mut search = Search::new(limits);
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    let mut pose = start;
    for part in path.moves() {
        let pieces = libm::ceil(part.extent() / 0.01).max(1.0);
        for _ in 0..pieces as u32 {
            pose = part.with(part.size() / pieces).from(pose);
            assert!(limits.is_free(&field, pose), "touches at {pose:?}");
        }
    }
    assert!(pose.point().distance(navitools::Point { x: 8.0, y: 6.0 }) < 1e-6);
    // On the other side of the axis the body would not fit in.
    assert!(!limits.is_free(&field, Pose::new(5.0, 3.85, 0.0)) && limits.is_free(&field, Pose::new(5.0, 4.01, 0.0)));
}

#[test]
fn a_base_turns_on_the_spot_where_only_the_polygon_can() {
    // A round body by 24 corners between walls; the corners of its square would touch.
    let corner = |n: u32| {
        let (y, x) = libm::sincos(f64::from(n) / 24.0 * core::f64::consts::TAU);
        navitools::Point { x: 0.3 * x, y: 0.3 * y }
    };
    let shape = kinematics::Shape::hull(&(0..24).map(corner).collect::<Vec<_>>()).expect("an outline");
    let abilities = Abilities { turns: true, ..Abilities::default() };
    let round = Limits { abilities, ..Limits::shaped(&shape, 0.3) };
    let ends = [(2.0, 3.6, 2.0, 4.4), (8.0, 3.6, 8.0, 4.4)];
    let field = room(&[(2.0, 3.6, 8.0, 3.6), (2.0, 4.4, 8.0, 4.4), ends[0], ends[1]]);
    let (start, goal) = (Pose::new(5.0, 4.0, 0.0), pose_goal(6.0, 4.0, core::f64::consts::PI));
    let path = Search::new(round).plan(&field, start, goal, Budget::default()).map(|path| path.moves().to_vec());
    let path = path.expect("a path");
    assert!(path.iter().any(|part| matches!(part, Move::Turn(_))), "{path:?}");
    assert!(Search::new(Limits { shape: None, ..round }).plan(&field, start, goal, Budget::default()).is_err());
}

#[test]
fn the_check_of_a_polygon_equals_a_test_of_each_cell() {
    let mut seed = 7u32;
    let mut random = move |high: f64| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) * high
    };
    let limits = to_the_right();
    let shape = limits.shape.expect("an outline");
    let (mut free, mut touching) = (0, 0);
    for _ in 0..40 {
        let mut map = Map::around((0.0, 0.0), (6.0, 6.0), 0.05).unwrap();
        (0..12).for_each(|_| map.column((random(6.0), random(6.0)), random(0.2)));
        let field = Field::new(&map, Unknown::Blocked);
        for _ in 0..200 {
            let pose = Pose::new(random(6.0), random(6.0), random(6.3));
            let seen = limits.is_free(&field, pose);
            let points = |most: u32, from: f64| (0..=most).map(move |n| from + f64::from(n) * 0.01);
            let points = points(65, -0.15).flat_map(|x| points(35, -0.25).map(move |y| navitools::Point { x, y }));
            let blocked = |within: f64| {
                points.clone().filter(|point| shape.outside(*point) <= within).any(|point| {
                    let at = pose * point;
                    map.at(at.x, at.y) != Some(crate::map::Cell::Free)
                })
            };
            let touches = blocked(0.0);
            assert!(!(seen && touches), "{pose:?} touches");
            // A cell that touches only between the points penetrates by less than its own size.
            let near =
                limits.body(0.0, &field).depth(&field, pose.x, pose.y, pose.theta.sin_cos().0, pose.theta.sin_cos().1);
            assert!(seen || touches || near < 0.05 || near == f64::INFINITY, "{pose:?} is free: {near}");
            assert!(seen == (near <= 1e-9), "{pose:?}: {near}");
            free += u32::from(seen);
            touching += u32::from(touches);
        }
    }
    assert!(free > 100 && touching > 100, "{free} {touching}");
}

mod bases;
