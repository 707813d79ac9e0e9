//! Paths in random clutter, checked against every occupied cell by an oracle of its own: the rectangle, every 2 mm of a
//! corner's way. `CLUTTER=1000` checks that many worlds instead of some; `CLUTTER_FIRST` is the first one.

#![allow(clippy::disallowed_methods, reason = "the number of worlds is handed in by the environment")]

use navitools::{Arc, Point, Pose};
use planner::map::{Cell, Field, Map, Unknown};
use planner::path::{Move, Path};
use planner::search::{Budget, Footprint, Goal, Limits, Search};

/// The reference robot, a long narrow one, and one as wide as it is long.
const ROBOTS: [(Footprint, f64); 3] = [
    (Footprint { length_m: 0.90, width_m: 0.60, rear_m: 0.15 }, 0.857),
    (Footprint { length_m: 1.20, width_m: 0.50, rear_m: 0.20 }, 1.0),
    (Footprint { length_m: 0.50, width_m: 0.50, rear_m: 0.10 }, 0.4),
];
/// Penetration that is rounding, m.
const ROUNDING_M: f64 = 1e-6;

/// Splitmix64.
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn pose(&mut self, side: f64) -> Pose {
        Pose::new(self.between(0.5, side - 0.5), self.between(0.5, side - 0.5), self.between(-3.2, 3.2))
    }
}

/// A room with boxes and posts, and its side, m.
fn clutter(random: &mut Random) -> (Map, f64) {
    let side = random.between(6.0, 9.0);
    let resolution = [0.025, 0.05, 0.05, 0.1][random.between(0.0, 4.0) as usize];
    let mut map = Map::around((0.0, 0.0), (side, side), resolution).expect("a small map");
    for _ in 0..random.between(8.0, 40.0) as u32 {
        let (x, y) = (random.between(0.0, side), random.between(0.0, side));
        let (sin, cos) = libm::sincos(random.between(0.0, 3.2));
        let (long, wide) = (random.between(0.02, 0.6), random.between(0.02, 0.2));
        let corner = |a: f64, b: f64| (x + a * long * cos - b * wide * sin, y + a * long * sin + b * wide * cos);
        map.polygon(&[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
        map.column((random.between(0.0, side), random.between(0.0, side)), random.between(0.0, 0.1));
    }
    (map, side)
}

/// Deepest penetration of an occupied cell, m, and of the outside of the map.
struct Oracle<'a> {
    map: &'a Map,
    footprint: Footprint,
}

impl Oracle<'_> {
    fn depth(&self, pose: Pose) -> f64 {
        let Footprint { length_m, width_m, rear_m } = self.footprint;
        let frame = self.map.frame();
        let ends = [-rear_m, length_m - rear_m];
        let corners = ends.map(|x| [width_m / 2.0, -width_m / 2.0].map(|y| pose * Point { x, y }));
        let corners = corners.as_flattened();
        let extent = |of: &dyn Fn(&Point) -> f64| {
            corners.iter().map(of).fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at), high.max(at)))
        };
        let (low_x, high_x) = extent(&|corner| corner.x);
        let (low_y, high_y) = extent(&|corner| corner.y);
        let (right, top) =
            (frame.x + frame.width as f64 * frame.resolution, frame.y + frame.height as f64 * frame.resolution);
        let mut deepest =
            [frame.x - low_x, high_x - right, frame.y - low_y, high_y - top].into_iter().fold(0.0, f64::max);
        let cell =
            |at: f64, origin: f64, count: usize| (((at - origin) / frame.resolution).max(0.0) as usize).min(count - 1);
        let (sin, cos) = pose.theta.sin_cos();
        for row in cell(low_y, frame.y, frame.height)..=cell(high_y, frame.y, frame.height) {
            for column in cell(low_x, frame.x, frame.width)..=cell(high_x, frame.x, frame.width) {
                if self.map.cells()[row * frame.width + column] == Cell::Free {
                    continue;
                }
                let (cx, cy) = frame.centre(column, row);
                let half = frame.resolution / 2.0;
                // Overlap along the axes of the grid, then along those of the robot.
                let grid = [high_x - cx + half, cx + half - low_x, high_y - cy + half, cy + half - low_y];
                let spread = half * (libm::fabs(sin) + libm::fabs(cos));
                let (dx, dy) = (cx - pose.x, cy - pose.y);
                let (along, across) = (dx * cos + dy * sin, dy * cos - dx * sin);
                let robot = [
                    length_m - rear_m + spread - along,
                    along + rear_m + spread,
                    width_m / 2.0 + spread - across,
                    across + width_m / 2.0 + spread,
                ];
                deepest = grid.into_iter().chain(robot).fold(f64::MAX, f64::min).max(deepest);
            }
        }
        deepest
    }

    /// Deepest penetration along a path, m.
    fn along(&self, start: Pose, path: &Path) -> f64 {
        let Footprint { length_m, width_m, .. } = self.footprint;
        let mut deepest = self.depth(start);
        let mut from = start;
        for part in path.moves() {
            let Move::Arc(arc) = part else { panic!("{part:?} of a robot that steers") };
            let corner = 1.0 + libm::fabs(arc.curvature) * libm::hypot(length_m, width_m);
            let count = libm::ceil(libm::fabs(arc.length) * corner / 0.002).max(1.0);
            for part in 1..=count as u32 {
                let way = Arc { length: arc.length * f64::from(part) / count, ..*arc };
                deepest = deepest.max(self.depth(from.along(way.motion())));
            }
            from = from.along(arc.motion());
        }
        deepest
    }
}

#[test]
fn no_path_touches_an_occupied_cell() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (worlds, first) = (number("CLUTTER").unwrap_or(120), number("CLUTTER_FIRST").unwrap_or(0));
    let (mut found, mut why_not, mut wrong) = (0, std::collections::BTreeMap::new(), Vec::new());
    for world in first..first + worlds {
        let mut random = Random(world.wrapping_mul(0xd134_2543_de82_ef95));
        let (map, side) = clutter(&mut random);
        let (footprint, radius_m) = ROBOTS[random.between(0.0, 3.0) as usize];
        let oracle = Oracle { map: &map, footprint };
        let field = Field::new(&map, Unknown::Blocked);
        let mut search = Search::new(Limits::new(footprint, radius_m));
        for request in 0..5 {
            let (start, end) = (random.pose(side), random.pose(side));
            let heading = (random.between(0.0, 1.0) < 0.6).then(|| end.theta.radians());
            if oracle.depth(start) > 0.0 {
                continue;
            }
            let goal = Goal { x: end.x, y: end.y, heading, tolerance_m: 0.0 };
            match search.plan(&field, start, goal, Budget { first: 50_000, better: 5_000 }) {
                Ok(path) => {
                    found += 1;
                    let deepest = oracle.along(start, path);
                    if deepest > ROUNDING_M {
                        wrong.push(format!("world {world}, request {request}: {:.1} mm deep", 1e3 * deepest));
                    }
                }
                Err(why) => *why_not.entry(why.to_string()).or_insert(0) += 1,
            }
        }
    }
    println!("{found} paths, no path: {why_not:?}");
    assert!(wrong.is_empty(), "{} of {found} paths touch:\n{}", wrong.len(), wrong.join("\n"));
    assert!(found as u64 > worlds / 2, "{found}");
}
