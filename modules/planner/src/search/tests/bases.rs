//! Bases that turn on the spot or go sideways.

use super::*;
use core::f64::consts::{FRAC_PI_2, PI};

/// A courier, and a base of its size that goes sideways.
const COURIER: Footprint = Footprint { length_m: 0.7, width_m: 0.5, rear_m: 0.35 };
const TURNS: Abilities = Abilities { turns: true, sideways: false };
const ALL: Abilities = Abilities { turns: true, sideways: true };

fn limits(abilities: Abilities) -> Limits {
    Limits { abilities, ..Limits::new(COURIER, 0.26) }
}

/// Fails if a path touches an obstacle between start and goal, or has a motion that the base lacks. Each corner moves
/// by 5 mm at most from one checked pose to the next.
#[track_caller]
fn check(field: &Field, start: Pose, goal: Goal, path: &Path, abilities: Abilities) {
    let mut pose = start;
    for part in path.moves() {
        match part {
            Move::Arc(arc) => assert!(libm::fabs(arc.curvature) <= 1.0 / 0.26 + 1e-9, "{arc:?}"),
            Move::Turn(angle) => assert!(abilities.turns && libm::fabs(*angle) < 2.0 * PI, "{part:?}"),
            Move::Aside(_) => assert!(abilities.sideways, "{part:?}"),
        }
        let pieces = libm::ceil(part.extent() * 3.0 / 0.005).max(1.0);
        for piece in 1..=pieces as u32 {
            let at = part.with(part.size() * f64::from(piece) / pieces).from(pose);
            assert!(COURIER.is_free(field, at), "{part:?} touches at {at:?}");
        }
        pose = part.from(pose);
    }
    let end = path.points().last().unwrap().pose;
    assert!(pose.point().distance(end.point()) < 1e-6);
    assert!(libm::hypot(end.x - goal.x, end.y - goal.y) <= goal.tolerance_m + 1e-6, "ends at {end:?}");
    if let Some(heading) = goal.heading {
        let most = if goal.tolerance_m > 0.0 { 5f64.to_radians() } else { 0.0 };
        assert!(libm::fabs(wrap(heading - end.theta.radians())) <= most + 1e-6, "ends at {end:?}");
    }
    for pair in path.points().windows(2) {
        assert!(pair[1].s >= pair[0].s && pair[1].s - pair[0].s <= 0.05 + 1e-9);
        assert!(libm::fabs((pair[1].pose.theta - pair[0].pose.theta).radians()) < 0.25);
    }
}

fn turned(path: &Path) -> f64 {
    path.moves().iter().filter(|part| part.direction().turns()).map(|part| part.extent()).sum()
}

fn aside(path: &Path) -> f64 {
    path.moves().iter().map(|part| if let Move::Aside(_) = part { part.extent() } else { 0.0 }).sum()
}

#[test]
fn the_opposite_heading_is_a_turn_on_the_spot() {
    let field = room(&[]);
    let (start, goal) = (Pose::new(5.0, 4.0, 0.5), pose_goal(5.0, 4.0, 0.5 - PI));
    for abilities in [TURNS, ALL] {
        let mut search = Search::new(limits(abilities));
        let path = search.plan(&field, start, goal, Budget::default()).unwrap();
        check(&field, start, goal, path, abilities);
        assert!(path.length() < 1e-6 && libm::fabs(turned(path) - PI) < 1e-6, "{:?}", path.moves());
    }
}

#[test]
fn the_heading_at_the_goal_is_reached_by_a_turn_there() {
    let field = room(&[]);
    let (start, goal) = (Pose::new(2.0, 4.0, 0.0), pose_goal(8.0, 4.0, PI));
    let mut search = Search::new(limits(TURNS));
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    check(&field, start, goal, path, TURNS);
    assert!(matches!(path.moves().last(), Some(Move::Turn(_))) && turned(path) > 2.0, "{:?}", path.moves());
    assert!(path.cusps().count() == 1 && path.length() < 6.1, "{:?}", path.moves());
}

#[test]
fn a_robot_in_a_dead_end_turns_around_in_it() {
    // 1.1 m wide: the corners sweep a circle of 0.86 m. The way out is long, so that backing out costs more.
    let field = room(&[(0.0, 3.45, 9.0, 3.45), (0.0, 4.55, 9.0, 4.55), (0.5, 3.45, 0.5, 4.55)]);
    let (start, goal) = (Pose::new(1.2, 4.0, PI), pose_goal(7.0, 4.0, 0.0));
    for abilities in [TURNS, ALL] {
        let mut search = Search::new(limits(abilities));
        let path = search.plan(&field, start, goal, Budget::default()).unwrap();
        check(&field, start, goal, path, abilities);
        assert!(turned(path) > 2.0, "{:?}", path.moves());
    }
    // A base of the same curves that only steers.
    let mut search = Search::new(limits(Abilities::default()));
    let path = search.plan(&field, start, goal, Budget::default());
    assert!(path.is_err() || path.is_ok_and(|path| path.cusps().count() > 1));
}

#[test]
fn no_turn_is_planned_where_a_corner_would_touch() {
    // 0.8 m wide, closed at one end: it fits along, and its corners need 0.86 m.
    let field = room(&[(3.0, 3.6, 9.0, 3.6), (3.0, 4.4, 9.0, 4.4), (9.0, 3.6, 9.0, 4.4)]);
    let (start, goal) = (Pose::new(6.0, 4.0, 0.0), pose_goal(6.0, 4.0, PI));
    let mut search = Search::new(limits(TURNS));
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    check(&field, start, goal, path, TURNS);
    // It backs out, turns there and comes back in reverse.
    assert!(path.length() > 5.0 && path.points()[0].direction == Direction::Backward, "{:?}", path.moves());
    let mut pose = start;
    for part in path.moves() {
        assert!(!part.direction().turns() || pose.x < 3.2, "turns at {pose:?}");
        pose = part.from(pose);
    }
}

#[test]
fn a_base_that_goes_sideways_leaves_a_bay_to_the_side() {
    // A bay as long as the robot and 20 cm more, open to the left.
    let field = room(&[(4.5, 3.6, 4.5, 4.2), (4.5, 3.6, 5.4, 3.6), (5.4, 3.6, 5.4, 4.2)]);
    let (start, goal) = (Pose::new(4.95, 3.95, 0.0), pose_goal(4.95, 5.5, 0.0));
    let mut search = Search::new(limits(ALL));
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    check(&field, start, goal, path, ALL);
    assert!(aside(path) > 1.0 && path.length() < 2.0, "{:?}", path.moves());
    // One that only turns has no such way.
    let mut search = Search::new(limits(TURNS));
    let path = search.plan(&field, start, goal, Budget::default());
    assert!(path.map_or(true, |path| path.cusps().count() > 3));
}

#[test]
fn a_short_way_to_the_side_is_driven_to_the_side() {
    let field = room(&[]);
    let (start, goal) = (Pose::new(5.0, 4.0, 1.0), Pose::new(5.0, 4.0, 1.0) * Pose::new(0.0, -0.8, 0.0));
    let goal = pose_goal(goal.x, goal.y, 1.0);
    let mut search = Search::new(limits(ALL));
    let path = search.plan(&field, start, goal, Budget::default()).unwrap();
    check(&field, start, goal, path, ALL);
    let [Move::Aside(length)] = path.moves() else { panic!("{:?}", path.moves()) };
    assert!(libm::fabs(length + 0.8) < 1e-6);
    assert!(path.points().iter().all(|point| point.direction == Direction::Right));
}

#[test]
fn random_ways_of_each_base_touch_nothing() {
    let mut random = testing::Random::new(7);
    let mut number = move |low: f64, high: f64| low + (high - low) * random.below(1 << 20) as f64 / (1 << 20) as f64;
    let mut searches = [Abilities::default(), TURNS, ALL].map(|abilities| (abilities, Search::new(limits(abilities))));
    let mut found = [0; 3];
    for _ in 0..40 {
        let walls: Vec<_> =
            (0..6).map(|_| (number(0.0, 10.0), number(0.0, 8.0), number(0.0, 10.0), number(0.0, 8.0))).collect();
        let field = room(&walls);
        let start = Pose::new(number(0.0, 10.0), number(0.0, 8.0), number(-4.0, 4.0));
        let heading = (number(0.0, 1.0) < 0.7).then(|| number(-7.0, 7.0));
        let tolerance_m = number(-0.3, 0.3).max(0.0);
        let goal = Goal { x: number(0.0, 10.0), y: number(0.0, 8.0), heading, tolerance_m };
        let clear = COURIER.grown(0.02).is_free(&field, start);
        for ((abilities, search), found) in searches.iter_mut().zip(&mut found) {
            let path = search.plan(&field, start, goal, Budget { first: 20_000, better: 5_000 });
            if let Ok(path) = path
                && clear
            {
                check(&field, start, goal, path, *abilities);
                *found += 1;
            }
        }
    }
    assert!(found[0] > 5 && found[1] >= found[0] && found[2] >= found[1], "{found:?}");
}

#[test]
fn the_states_of_each_base_are_found_in_slices_too() {
    let field = room(&[(4.0, 0.0, 4.0, 6.0), (7.0, 2.0, 7.0, 8.0)]);
    let (start, goal) = (Pose::new(1.0, 1.0, 0.0), pose_goal(8.5, 7.0, -FRAC_PI_2));
    for abilities in [TURNS, ALL] {
        let whole = Search::new(limits(abilities)).plan(&field, start, goal, Budget::default()).unwrap().clone();
        let mut search = Search::new(limits(abilities));
        search.begin(&field, start, goal, Budget::default());
        while matches!(search.advance(&field, 7), Status::Searching | Status::Improving(_)) {}
        assert_eq!(search.status(), Status::Found(&whole));
    }
}
