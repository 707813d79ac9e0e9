//! Mazes that are solvable by construction: each is built around a path along which the robot's rectangle was driven.
//!
//! The generator shares nothing with the search: its path consists of arcs laid cell by cell or at random, its
//! rectangle is tested against cells at each centimetre, and no wall is drawn where the rectangle has been. So each
//! maze has a path by construction, whose length is the reference for the planner's.

use navitools::{Motion, Pose};
use planner::map::{Cell, Map};

/// Side of the square, m, and of a cell, m.
pub const SIDE_M: f64 = 20.0;
pub const CELL_M: f64 = 0.05;
/// The reference robot (docs/facts/robot.md 1.2), m.
pub const LENGTH_M: f64 = 0.90;
pub const WIDTH_M: f64 = 0.60;
pub const REAR_M: f64 = 0.15;
pub const RADIUS_M: f64 = 0.857;
/// Margin on all sides of the path, beyond the cells that the robot touches, m.
const AROUND_M: f64 = 0.06;

/// Map with a path through it.
pub struct Maze {
    pub map: Map,
    pub start: Pose,
    pub goal: Pose,
    /// Length of the path it was built around, m.
    pub way_m: f64,
    pub kind: &'static str,
}

/// Maze of a number: a labyrinth of corridors, or a hall full of blocks.
pub fn maze(number: u64) -> Maze {
    let mut random = Random(number.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d);
    if number.is_multiple_of(2) { labyrinth(&mut random) } else { blocks(&mut random) }
}

/// Splitmix64.
pub struct Random(u64);

impl Random {
    #[allow(dead_code, reason = "for the bench alone")]
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Cells touched by the robot, which stay free.
struct Swept {
    cells: Vec<bool>,
    count: usize,
}

impl Swept {
    fn new() -> Self {
        let count = (SIDE_M / CELL_M).round() as usize;
        Self { cells: vec![false; count * count], count }
    }

    /// Marks the cells of the rectangle at a pose; false if it would leave the square.
    fn stand(&mut self, pose: Pose) -> bool {
        let around = AROUND_M + CELL_M;
        let (sin, cos) = pose.theta.sin_cos();
        // The corners show whether all of it is inside, off the outer wall.
        let ends = [-REAR_M - around, LENGTH_M - REAR_M + around];
        let sides = [-WIDTH_M / 2.0 - around, WIDTH_M / 2.0 + around];
        for (along, across) in ends.into_iter().flat_map(|along| sides.map(|across| (along, across))) {
            let corner = (pose.x + along * cos - across * sin, pose.y + along * sin + across * cos);
            if [corner.0, corner.1].iter().any(|at| !(CELL_M..=SIDE_M - CELL_M).contains(at)) {
                return false;
            }
        }
        let reach = LENGTH_M + around;
        let cell = |at: f64| ((at.max(0.0) / CELL_M) as usize).min(self.count - 1);
        for row in cell(pose.y - reach)..=cell(pose.y + reach) {
            for column in cell(pose.x - reach)..=cell(pose.x + reach) {
                let (dx, dy) = ((column as f64 + 0.5) * CELL_M - pose.x, (row as f64 + 0.5) * CELL_M - pose.y);
                let (along, across) = (dx * cos + dy * sin, dy * cos - dx * sin);
                let inside = along > -REAR_M - around && along < LENGTH_M - REAR_M + around;
                if inside && across.abs() < WIDTH_M / 2.0 + around {
                    self.cells[row * self.count + column] = true;
                }
            }
        }
        true
    }

    /// Drives an arc in steps of a centimetre; `None` if it leaves the square.
    fn drive(&mut self, from: Pose, length: f64, curvature: f64) -> Option<Pose> {
        let steps = (length.abs() / 0.01).ceil().max(1.0);
        let step = Motion { translation: length / steps, rotation: length / steps * curvature };
        let mut pose = from;
        for _ in 0..steps as u32 {
            pose = pose.along(step);
            if !self.stand(pose) {
                return None;
            }
        }
        Some(pose)
    }

    /// Removes walls where the robot has been.
    fn clear(&self, map: &mut Map) {
        for (index, _) in self.cells.iter().enumerate().filter(|(_, swept)| **swept) {
            map.set(index % self.count, index / self.count, Cell::Free);
        }
    }
}

fn square() -> Map {
    let mut map = Map::around((0.0, 0.0), (SIDE_M, SIDE_M), CELL_M).expect("a small map");
    let edge = SIDE_M - CELL_M / 2.0;
    let low = CELL_M / 2.0;
    for (a, b) in
        [((low, low), (edge, low)), ((edge, low), (edge, edge)), ((edge, edge), (low, edge)), ((low, edge), (low, low))]
    {
        map.wall(a, b);
    }
    map
}

/// Corridors of 1.82 to 2.5 m in a tree, some with a second path; from one room to the farthest one. The path turns by
/// quarter circles within a room, so that the corridors' walls are not in the way.
fn labyrinth(random: &mut Random) -> Maze {
    let rooms = [8, 9, 10, 11][random.below(4)];
    let side = SIDE_M / rooms as f64;
    let count = rooms * rooms;
    // Open to the right, open upwards.
    let mut open = vec![[false; 2]; count];
    let mut seen = vec![false; count];
    let mut trail = vec![random.below(count)];
    seen[trail[0]] = true;
    while let Some(&room) = trail.last() {
        let new: Vec<usize> = neighbours(room, rooms).into_iter().flatten().filter(|next| !seen[*next]).collect();
        if new.is_empty() {
            trail.pop();
            continue;
        }
        let next = new[random.below(new.len())];
        seen[next] = true;
        open[room.min(next)][usize::from(room.abs_diff(next) == rooms)] = true;
        trail.push(next);
    }
    for _ in 0..rooms / 2 {
        let room = random.below(count);
        let up = random.below(2);
        if if up == 1 { room + rooms < count } else { room % rooms + 1 < rooms } {
            open[room][up] = true;
        }
    }
    let passes = |a: usize, b: usize| open[a.min(b)][usize::from(a.abs_diff(b) == rooms)];
    let steps = |from: usize| {
        let mut before = vec![usize::MAX; count];
        let mut order = vec![from];
        before[from] = from;
        let mut at = 0;
        while at < order.len() {
            let room = order[at];
            at += 1;
            for next in neighbours(room, rooms).into_iter().flatten() {
                if passes(room, next) && before[next] == usize::MAX {
                    before[next] = room;
                    order.push(next);
                }
            }
        }
        (before, order[count - 1])
    };
    let (_, from) = steps(random.below(count));
    let (before, to) = steps(from);
    let mut way = vec![to];
    while way[way.len() - 1] != from {
        way.push(before[way[way.len() - 1]]);
    }
    way.reverse();
    let mut map = square();
    for (room, open) in open.iter().enumerate() {
        let (x, y) = ((room % rooms) as f64 * side, (room / rooms) as f64 * side);
        if !open[0] && room % rooms + 1 < rooms {
            map.wall((x + side, y), (x + side, y + side));
        }
        if !open[1] && room / rooms + 1 < rooms {
            map.wall((x, y + side), (x + side, y + side));
        }
    }
    let centre = |room: usize| (((room % rooms) as f64 + 0.5) * side, ((room / rooms) as f64 + 0.5) * side);
    let heading = |a: usize, b: usize| {
        let ((ax, ay), (bx, by)) = (centre(a), centre(b));
        libm::atan2(by - ay, bx - ax)
    };
    let mut swept = Swept::new();
    let (x, y) = centre(from);
    let first = heading(way[0], way[1]);
    let (sin, cos) = libm::sincos(first);
    // The robot's middle is in the middle of the room.
    let back = LENGTH_M / 2.0 - REAR_M;
    let start = Pose::new(x - back * cos, y - back * sin, first);
    let (mut pose, mut way_m) = (start, side / 2.0 + back);
    assert!(swept.stand(pose), "a room is inside");
    pose = swept.drive(pose, way_m, 0.0).expect("a room is inside");
    for trio in way.windows(3) {
        let turn = navitools::wrap(heading(trio[1], trio[2]) - heading(trio[0], trio[1]));
        let length = if turn.abs() < 0.1 { side } else { side / 2.0 * turn.abs() };
        pose = swept.drive(pose, length, turn / length).expect("rooms are inside");
        way_m += length;
    }
    pose = swept.drive(pose, side / 2.0 - back, 0.0).expect("a room is inside");
    way_m += side / 2.0 - back;
    // The path crosses no wall that must be removed; posts and boxes are placed elsewhere.
    let walls = map.clone();
    for _ in 0..rooms * 3 {
        map.column((random.between(0.3, SIDE_M - 0.3), random.between(0.3, SIDE_M - 0.3)), random.between(0.02, 0.15));
    }
    swept.clear(&mut map);
    let kept = walls.cells().iter().zip(map.cells()).all(|(wall, cell)| *wall == Cell::Free || *cell == Cell::Occupied);
    assert!(kept, "the way goes through no wall");
    Maze { map, start, goal: pose, way_m, kind: "labyrinth" }
}

fn neighbours(room: usize, rooms: usize) -> [Option<usize>; 4] {
    let (column, row) = (room % rooms, room / rooms);
    [
        (column > 0).then(|| room - 1),
        (column + 1 < rooms).then_some(room + 1),
        (row > 0).then(|| room - rooms),
        (row + 1 < rooms).then_some(room + rooms),
    ]
}

/// Random drive of 25 to 60 m, partly in reverse, and boxes and walls where it has not been.
fn blocks(random: &mut Random) -> Maze {
    let (swept, start, goal, way_m) = loop {
        if let Some(drive) = random_drive(random) {
            break drive;
        }
    };
    let mut map = square();
    for _ in 0..260 {
        let (x, y) = (random.between(0.0, SIDE_M), random.between(0.0, SIDE_M));
        let (sin, cos) = libm::sincos(random.between(0.0, 3.2));
        let (long, wide) = (random.between(0.1, 1.6), random.between(0.03, 0.5));
        let corner = |a: f64, b: f64| (x + a * long * cos - b * wide * sin, y + a * long * sin + b * wide * cos);
        map.polygon(&[corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)]);
    }
    swept.clear(&mut map);
    Maze { map, start, goal, way_m, kind: "blocks" }
}

fn random_drive(random: &mut Random) -> Option<(Swept, Pose, Pose, f64)> {
    let mut swept = Swept::new();
    let start = Pose::new(random.between(2.0, 18.0), random.between(2.0, 18.0), random.between(-3.1, 3.1));
    swept.stand(start).then_some(())?;
    let (mut pose, mut way) = (start, 0.0);
    let long = random.between(25.0, 60.0);
    let mut ahead = 1.0;
    let mut stuck = 0;
    while way < long {
        if random.below(8) == 0 {
            ahead = -ahead;
        }
        let curvature = random.between(-1.0, 1.0) / (RADIUS_M * 1.02);
        let length = ahead * random.between(0.4, 3.0);
        let mut trial = Swept { cells: swept.cells.clone(), count: swept.count };
        match trial.drive(pose, length, curvature) {
            Some(next) => {
                (swept, pose) = (trial, next);
                way += length.abs();
            }
            None if stuck > 50 => return None,
            None => stuck += 1,
        }
    }
    // A minimum distance, so that planning is not trivial.
    (start.point().distance(pose.point()) > 7.0).then_some((swept, start, pose, way))
}
