//! Planner on solvable mazes: `cargo bench -p planner --bench plan [-- MAZES --each]`.
//!
//! 20 m by 20 m at 5 cm, the reference robot, full knowledge; half labyrinths of corridors, half halls full of blocks,
//! made by `plan/maze.rs`, which knows a path through each. Goals: all of 100 solved, 99 % within 100 ms of CPU time on
//! one core. A plan is everything from the request to the smoothed path, with the distance field given, as on the
//! robot. `first` is the first drivable path. Lengths are relative to that of the path around which the maze was built,
//! which meanders in the halls, and to the shortest path of a disc, 0.6 m wide, that turns on the spot: a lower bound
//! for the robot.

#[path = "plan/maze.rs"]
mod maze;
#[path = "sys.rs"]
mod sys;

use maze::{CELL_M, LENGTH_M, Maze, RADIUS_M, REAR_M, WIDTH_M, maze};
use navitools::{Point, Pose, dubins_length, reeds_shepp_length};
use planner::map::{Cell, Field, Map, Unknown};
use planner::path::Path;
use planner::search::{Budget, Footprint, Goal, Limits, Search, Status};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::hint::black_box;

#[global_allocator]
static MEMORY: sys::Counting = sys::Counting::new();

const ROUNDS: usize = 3;
/// Work units of a step of the module's control loop (`route.rs`).
const SLICE: u32 = 200;

fn main() {
    curves();
    large();
    let mazes: u64 = std::env::args().skip(1).find_map(|text| text.parse().ok()).unwrap_or(100);
    let each = std::env::args().any(|text| text == "--each");
    let footprint = Footprint { length_m: LENGTH_M, width_m: WIDTH_M, rear_m: REAR_M };
    let mut rows: Vec<Row> = Vec::new();
    let mut failed = Vec::new();
    for number in 0..mazes {
        let maze = maze(number);
        let Pose { x, y, theta } = maze.goal;
        let goal = Goal { x, y, heading: Some(theta.radians()), tolerance_m: 0.0 };
        // Minimum of some rounds: other programs only add to it, through caches. Each begins without prior results.
        let (mut field_ms, mut first_ms, mut plan_ms, mut again_ms) = (f64::MAX, f64::MAX, f64::MAX, f64::MAX);
        let (mut first_length, mut expansions, mut allocations) = (0.0, 0, 0);
        let mut path = None;
        for _ in 0..ROUNDS {
            let begun = cpu_ns();
            let field = Field::new(&maze.map, Unknown::Blocked);
            field_ms = field_ms.min(milliseconds(begun));
            let mut search = Search::new(Limits::new(footprint, RADIUS_M));
            let begun = cpu_ns();
            search.begin(&field, maze.start, goal, Budget::default());
            let mut first = None;
            let found = loop {
                match search.advance(&field, 500) {
                    Status::Searching => {}
                    Status::Improving(path) => {
                        first.get_or_insert((milliseconds(begun), path.length()));
                    }
                    Status::Found(path) => break Ok(path.clone()),
                    Status::NoPath(why) => break Err(why),
                }
            };
            plan_ms = plan_ms.min(milliseconds(begun));
            let first = first.unwrap_or((plan_ms, found.as_ref().map_or(0.0, Path::length)));
            first_ms = first_ms.min(first.0);
            (first_length, expansions) = (first.1, search.expansions());
            path = Some(found);
            // The same request again, as after an obstacle on the path.
            let (begun, before) = (cpu_ns(), MEMORY.allocations());
            let _ = black_box(search.plan(&field, maze.start, goal, Budget::default()));
            allocations = MEMORY.allocations() - before;
            again_ms = again_ms.min(milliseconds(begun));
        }
        let mut slices = Vec::new();
        let field = Field::new(&maze.map, Unknown::Blocked);
        let mut search = Search::new(Limits::new(footprint, RADIUS_M));
        search.begin(&field, maze.start, goal, Budget::default());
        let mut searching = true;
        while searching {
            let begun = cpu_ns();
            searching = matches!(search.advance(&field, SLICE), Status::Searching | Status::Improving(_));
            slices.push(milliseconds(begun));
        }
        slices.sort_by(f64::total_cmp);
        let path = match path {
            Some(Ok(path)) => path,
            Some(Err(why)) => {
                failed.push((number, why));
                continue;
            }
            None => continue,
        };
        if each {
            println!("{number}: {first_ms:.1} then {plan_ms:.1} ms, {expansions} states, {:.1} m", path.length());
        }
        rows.push(Row {
            kind: maze.kind,
            field_ms,
            first_ms,
            plan_ms,
            again_ms,
            slice_ms: slices[slices.len() / 2],
            longest_ms: slices[slices.len() - 1],
            allocations: allocations as f64,
            expansions: f64::from(expansions),
            length: path.length(),
            ratio: path.length() / maze.way_m,
            bound: path.length() / round_way(&maze),
            gained: path.length() / first_length,
            cusps: path.cusps().count() as f64,
            clearance: path.clearance(),
        });
    }
    for (number, why) in &failed {
        println!("maze {number}: {why}");
    }
    println!("| mazes | solved | | p50 | p99 | most |\n|---|---|---|---|---|---|");
    for kind in ["labyrinth", "blocks"] {
        let of = |value: Figure| {
            let mut values: Vec<f64> = rows.iter().filter(|row| row.kind == kind).map(value).collect();
            values.sort_by(f64::total_cmp);
            let at = |part: f64| values.get(((values.len() as f64 * part).ceil() as usize).max(1) - 1).copied();
            [at(0.5), at(0.99), values.last().copied()].map(|value| value.unwrap_or(f64::NAN))
        };
        let solved = rows.iter().filter(|row| row.kind == kind).count();
        let figures: [(&str, Figure); 14] = [
            ("first way, ms", |row| row.first_ms),
            ("plan, ms", |row| row.plan_ms),
            ("plan to the same goal again, ms", |row| row.again_ms),
            ("its allocations", |row| row.allocations),
            ("slice of the module, median, ms", |row| row.slice_ms),
            ("longest slice, ms", |row| row.longest_ms),
            ("states expanded", |row| row.expansions),
            ("length, m", |row| row.length),
            ("length / known way", |row| row.ratio),
            ("length / round robot's way", |row| row.bound),
            ("length / first way", |row| row.gained),
            ("cusps", |row| row.cusps),
            ("clearance, m", |row| row.clearance),
            ("distance field, ms", |row| row.field_ms),
        ];
        for (name, value) in figures {
            let [p50, p99, most] = of(value);
            println!("| {kind} | {solved} | {name} | {p50:.2} | {p99:.2} | {most:.2} |");
        }
    }
    let plans = |rows: &[Row]| {
        let mut values: Vec<f64> = rows.iter().map(|row| row.plan_ms).collect();
        values.sort_by(f64::total_cmp);
        values.get((values.len() * 99).div_ceil(100).max(1) - 1).copied().unwrap_or(f64::NAN)
    };
    println!("solved {} of {mazes}, p99 of all {:.1} ms", rows.len(), plans(&rows));
}

/// Column of the table.
type Figure = fn(&Row) -> f64;

struct Row {
    kind: &'static str,
    field_ms: f64,
    first_ms: f64,
    plan_ms: f64,
    again_ms: f64,
    slice_ms: f64,
    longest_ms: f64,
    allocations: f64,
    expansions: f64,
    length: f64,
    ratio: f64,
    bound: f64,
    gained: f64,
    cusps: f64,
    clearance: f64,
}

/// CPU time of this thread, ns. The kernel updates the count on a yield.
fn cpu_ns() -> u64 {
    std::thread::yield_now();
    sys::cpu_ns()
}

fn milliseconds(begun: u64) -> f64 {
    (cpu_ns() - begun) as f64 / 1e6
}

/// Shortest path from start to goal for the robot's middle with a disc of the robot's width around it: Dijkstra with
/// sixteen directions, at most 2.8 % too long.
fn round_way(maze: &Maze) -> f64 {
    let (width, cells) = (maze.map.frame().width as i64, maze.map.cells());
    let radius = (WIDTH_M / 2.0 / CELL_M) as i64;
    let mut blocked = vec![false; cells.len()];
    for at in (0..cells.len() as i64).filter(|at| cells[*at as usize] != Cell::Free) {
        for (dy, dx) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx))) {
            let (x, y) = (at % width + dx, at / width + dy);
            if dx * dx + dy * dy < radius * radius && (0..width).contains(&x) && (0..width).contains(&y) {
                blocked[(y * width + x) as usize] = true;
            }
        }
    }
    let middle = |pose: Pose| {
        let at = pose * Point { x: LENGTH_M / 2.0 - REAR_M, y: 0.0 };
        (at.y / CELL_M) as i64 * width + (at.x / CELL_M) as i64
    };
    let (start, goal) = (middle(maze.start), middle(maze.goal));
    let mut least = vec![f64::INFINITY; cells.len()];
    let mut queue = BinaryHeap::from([(Reverse(0u64), start)]);
    least[start as usize] = 0.0;
    while let Some((Reverse(_), at)) = queue.pop() {
        if at == goal {
            break;
        }
        for (dx, dy) in (-2i64..=2).flat_map(|dx| (-2i64..=2).map(move |dy| (dx, dy))) {
            // Neighbours, and knight's moves.
            let straight = dx.abs().max(dy.abs()) == 1;
            if !(straight || dx.abs() + dy.abs() == 3) {
                continue;
            }
            let next = at + dy * width + dx;
            let free = (0..cells.len() as i64).contains(&next) && !blocked[next as usize];
            let length = least[at as usize] + CELL_M * ((dx * dx + dy * dy) as f64).sqrt();
            if free && length < least[next as usize] {
                least[next as usize] = length;
                queue.push((Reverse(length.to_bits()), next));
            }
        }
    }
    least[goal as usize]
}

/// A map of 4 million cells: 100 m by 100 m at 5 cm, with 1500 boxes, and requests across it, those without a way
/// included. Time from the map to the path, and the most memory in use meanwhile, that of the map included.
fn large() {
    const CELLS: f64 = 2000.0 * 2000.0;
    let mut random = maze::Random::new(1);
    let mut map = Map::around((0.0, 0.0), (100.0, 100.0), CELL_M).expect("a map");
    let before = MEMORY.bytes() - CELLS as u64;
    for _ in 0..1500 {
        let (x, y) = (random.between(0.0, 100.0), random.between(0.0, 100.0));
        let (sin, cos) = libm::sincos(random.between(0.0, 3.2));
        let (long, wide) = (random.between(0.1, 1.2), random.between(0.05, 0.4));
        let corner = |a: f64, b: f64| (x + a * long * cos - b * wide * sin, y + a * long * sin + b * wide * cos);
        map.polygon(&[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    }
    let footprint = Footprint { length_m: LENGTH_M, width_m: WIDTH_M, rear_m: REAR_M };
    let (mut times, mut bytes, mut found) = (Vec::new(), Vec::new(), 0);
    for _ in 0..60 {
        let mut place = || (random.between(2.0, 98.0), random.between(2.0, 98.0), random.between(-3.0, 3.0));
        let (start, end) = (place(), place());
        let goal = Goal { x: end.0, y: end.1, heading: Some(end.2), tolerance_m: 0.0 };
        let _ = MEMORY.take_most();
        let begun = cpu_ns();
        let field = Field::new(&map, Unknown::Blocked);
        let mut search = Search::new(Limits::new(footprint, RADIUS_M));
        found += u32::from(search.plan(&field, Pose::new(start.0, start.1, start.2), goal, Budget::default()).is_ok());
        times.push(milliseconds(begun));
        bytes.push((MEMORY.take_most() - before) as f64 / CELLS);
    }
    for (name, mut values) in [("ms", times), ("bytes a cell", bytes)] {
        values.sort_by(f64::total_cmp);
        let (median, most) = (values[values.len() / 2], values[values.len() - 1]);
        println!("4 million cells, {found} of 60 found: {median:.1} {name}, at most {most:.1}");
    }
}

/// Time of one length of a shortest path between random poses.
fn curves() {
    let poses: Vec<Pose> = (0..1000)
        .map(|i| {
            let i = f64::from(i);
            Pose::new((i * 0.37) % 7.0 - 3.5, (i * 0.71) % 7.0 - 3.5, (i * 1.3) % 6.2)
        })
        .collect();
    for (name, length) in [("Reeds-Shepp", reeds_shepp_length as fn(Pose, Pose, f64) -> f64), ("Dubins", dubins_length)]
    {
        let begun = cpu_ns();
        for _ in 0..100 {
            for pose in &poses {
                black_box(length(Pose::default(), *pose, RADIUS_M));
            }
        }
        println!("{name}: {:.2} us a length", milliseconds(begun) * 1e3 / 1e5);
    }
}
