//! Map files and path search.

use navitools::Pose;
use planner::map::{Field, Map, Obstacle, Unknown, pgm, yaml};
use planner::path::Move;
use planner::search::{Budget, Footprint, Goal, Limits, Search};

type Request = ([f64; 3], (f64, f64, Option<f64>), f64, [f64; 4], Vec<[f64; 4]>, Vec<[f64; 3]>);

/// Map files, and requests to plan on a small map with arbitrary walls and obstacles.
///
/// A picture has all its pixels; a path keeps the curvature limit and is finite.
pub fn plan(data: &[u8]) {
    let Some(input) = crate::input::<(&[u8], &str, Request)>(data) else { return };
    let (picture, text, (start, goal, tolerance_m, [length_m, width_m, rear_m, radius], walls, obstacles)) = input;
    let (picture, info) = (pgm::read(picture), yaml::read(text));
    if let Ok(picture) = &picture {
        assert_eq!(picture.grey.len(), picture.width * picture.height);
        let _ = info.map(|info| info.map(picture));
    }
    let Ok(mut map) = Map::around((0.0, 0.0), (6.0, 5.0), 0.1) else { return };
    for [ax, ay, bx, by] in walls {
        map.wall((ax, ay), (bx, by));
        map.column((bx, ax), ay);
        map.polygon(&[(ax, ay), (bx, by), (by, ax)]);
    }
    let mut field = Field::new(&map, Unknown::Blocked);
    field.overlay(&obstacles.iter().map(|&[x, y, radius]| Obstacle { x, y, radius }).collect::<Vec<_>>());
    let mut search = Search::new(Limits::new(Footprint { length_m, width_m, rear_m }, radius));
    let goal = Goal { x: goal.0, y: goal.1, heading: goal.2, tolerance_m };
    let start = Pose::new(start[0], start[1], start[2]);
    if let Ok(path) = search.plan(&field, start, goal, Budget { first: 300, better: 100 }) {
        let is_sane = |part: &Move| part.curvature().abs() * radius <= 1.0 + 1e-9 && part.size().is_finite();
        assert!(path.moves().iter().all(is_sane));
        assert!(path.points().iter().all(|point| point.pose.x.is_finite() && point.pose.y.is_finite()));
    }
}
