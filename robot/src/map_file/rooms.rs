//! The rooms of a world as a map, and a place for a robot in a map.

use super::{WORLD_CELL_M, of_world};
use navitools::Point;
use planner::map::{Cell, Field, Map, Unknown};
use simulator::world::World;
use std::fmt;

/// Clearance at the start of a robot in a map, m, where there is a place that has it: the reference robot turns there
/// at full lock.
const ROOM_M: f64 = 1.4;
/// Least clearance at such a start, m.
const ROOM_LEAST_M: f64 = 0.8;

/// Reason why a map has no place for a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refused {
    /// No place has the least clearance.
    NoRoom,
    /// The start that was given is on a cell that is occupied, unknown, or beyond the map.
    NotFree(Point),
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRoom => write!(
                f,
                "no place in the map is {ROOM_LEAST_M} m from everything; choose one: --set world.start=[X,Y,THETA]"
            ),
            Self::NotFree(at) => write!(f, "start: {:.2}, {:.2} is not on a free cell of the map", at.x, at.y),
        }
    }
}

/// Place for a robot, m: of those with room to turn the one nearest to the middle of the map, else the roomiest.
///
/// # Errors
/// No place is roomy enough.
pub fn start(map: &Map) -> Result<Point, Refused> {
    let (frame, field) = (map.frame(), Field::new(map, Unknown::Blocked));
    let (x, y) =
        (frame.x + frame.width as f64 * frame.resolution / 2.0, frame.y + frame.height as f64 * frame.resolution / 2.0);
    let mut roomiest: Option<(f64, f64, Point)> = None;
    for row in 0..frame.height {
        for column in 0..frame.width {
            let at = frame.centre(column, row);
            let room = f64::from(field.distance(at.0, at.1));
            if room < ROOM_LEAST_M {
                continue;
            }
            // More room than enough does not count.
            let (room, off) = (room.min(ROOM_M), (at.0 - x).hypot(at.1 - y));
            let is_better = roomiest.is_none_or(|(most, least, _)| room > most || (room == most && off < least));
            if is_better {
                roomiest = Some((room, off, Point { x: at.0, y: at.1 }));
            }
        }
    }
    roomiest.map(|(_, _, at)| at).ok_or(Refused::NoRoom)
}

/// Converts a world to a map of what can be reached from its start.
///
/// Free are the cells that are connected with the start's by their sides. Occupied are the other ones around them,
/// unknown all others: what is behind walls, and outside. A world without outer walls is enclosed by the edge of the
/// map, beyond its outermost object. Cells are at multiples of 0.05 m.
///
/// # Errors
/// The world is too large for a map, or something is on its start.
pub fn of_rooms(world: &World) -> Result<Map, String> {
    let drawn = Drawn::new(world)?;
    let Some(begin) = drawn.map.frame().cell(world.start.x, world.start.y) else {
        return Err("start: outside the world".into());
    };
    let Drawn { first, map } = drawn;
    let frame = *map.frame();
    let (width, height) = (frame.width, frame.height);
    let mut solid: Vec<bool> = map.cells().iter().map(|cell| *cell != Cell::Free).collect();
    join(&mut solid, width);
    // The cells at the edge stay free of the robot: they are its walls where the world has none.
    let is_edge = |cell: usize| {
        let (column, row) = (cell % width, cell / width);
        column == 0 || row == 0 || column + 1 == width || row + 1 == height
    };
    let begin = begin.1 * width + begin.0;
    if solid[begin] || is_edge(begin) {
        return Err("start: something is there".into());
    }
    let mut free = vec![false; solid.len()];
    free[begin] = true;
    let mut open = vec![begin];
    while let Some(cell) = open.pop() {
        for next in [cell - 1, cell + 1, cell - width, cell + width] {
            if !solid[next] && !free[next] && !is_edge(next) {
                free[next] = true;
                open.push(next);
            }
        }
    }
    cut(&free, first, &frame)
}

/// World on a grid whose cells are at multiples of [`WORLD_CELL_M`].
struct Drawn {
    /// Multiples at which the first cell is.
    first: [i64; 2],
    map: Map,
}

impl Drawn {
    fn new(world: &World) -> Result<Self, String> {
        let rough = *of_world(world)?.frame();
        // That one begins one cell before the first object. A multiple that is missed by rounding is one.
        let multiple = |at: f64| ((at / WORLD_CELL_M + 1.0 + 1e-6).floor()) as i64 - 3;
        let first = [multiple(rough.x), multiple(rough.y)];
        let [x, y] = first.map(|multiple| multiple as f64 * WORLD_CELL_M);
        let end = |low: f64, count: usize| low + (count as f64 + 3.0) * WORLD_CELL_M;
        let mut map = Map::around((x, y), (end(rough.x, rough.width), end(rough.y, rough.height)), WORLD_CELL_M)
            .map_err(|error| error.to_string())?;
        let flat = |point: &Point| (point.x, point.y);
        world.walls.iter().for_each(|wall| map.wall(flat(&wall.a), flat(&wall.b)));
        world.columns.iter().for_each(|column| map.column(flat(&column.centre), column.radius));
        world.drops.iter().for_each(|drop| map.polygon(&drop.iter().map(flat).collect::<Vec<_>>()));
        Ok(Self { first, map })
    }
}

/// Joins cells that touch only with a corner: of the two others the lower one becomes solid, too.
fn join(solid: &mut [bool], width: usize) {
    let mut is_joined = false;
    while !is_joined {
        is_joined = true;
        // Downwards, as the joined cells are the lower ones.
        for lower in (0..solid.len().saturating_sub(width)).rev() {
            if lower % width + 1 == width {
                continue;
            }
            let (right, above) = (lower + 1, lower + width);
            if solid[lower] != solid[right] && solid[lower] == solid[above + 1] && solid[right] == solid[above] {
                (solid[lower], solid[right]) = (true, true);
                is_joined = false;
            }
        }
    }
}

/// The map of the cells that are free, no larger than they and what is around them.
fn cut(free: &[bool], first: [i64; 2], frame: &planner::map::Frame) -> Result<Map, String> {
    let width = frame.width;
    let places = || free.iter().enumerate().filter(|(_, free)| **free).map(|(cell, _)| (cell % width, cell / width));
    let (low, high) = places().fold(((usize::MAX, usize::MAX), (0, 0)), |(low, high), (column, row)| {
        ((column.min(low.0), row.min(low.1)), (column.max(high.0), row.max(high.1)))
    });
    // None of them is at the edge of the frame.
    let [column, row] = [low.0 - 1, low.1 - 1];
    let at = |first: i64, cell: usize| (first + cell as i64) as f64 * WORLD_CELL_M;
    let cut = planner::map::Frame {
        x: at(first[0], column),
        y: at(first[1], row),
        resolution: WORLD_CELL_M,
        width: high.0 - low.0 + 3,
        height: high.1 - low.1 + 3,
    };
    let mut map = Map::new(cut).map_err(|error| error.to_string())?;
    for (below, left) in (0..cut.height).flat_map(|below| (0..cut.width).map(move |left| (below, left))) {
        let is_free = |column: usize, row: usize| free[row * width + column];
        let (at_column, at_row) = (column + left, row + below);
        let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let near =
            || around(at_row, frame.height).any(|row| around(at_column, width).any(|column| is_free(column, row)));
        let cell = match is_free(at_column, at_row) {
            true => Cell::Free,
            false if near() => Cell::Occupied,
            false => Cell::Unknown,
        };
        map.set(left, below, cell);
    }
    Ok(map)
}
