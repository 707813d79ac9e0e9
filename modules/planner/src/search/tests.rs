use super::*;
use crate::map::{Map, Unknown};

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

/// A path is one: it begins and ends where it should, is drivable, and free.
fn check(field: &Field, start: Pose, path: &Path) {
    let points = path.points();
    assert_eq!(points[0].pose, start);
    let mut pose = start;
    for arc in path.arcs() {
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
fn across_an_empty_room_the_way_is_as_short_as_a_car_can() {
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
