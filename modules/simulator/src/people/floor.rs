//! Walkable floor: a grid, the objects near each cell, and the path from each cell to a place.

use crate::random::Random;
use crate::world::{Segment, World, nearest};
use navitools::Point;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A cell's side, m; greater where the world is so great that there would be more than [`CELLS`].
const CELL: f64 = 0.4;
const CELLS: f64 = 20_000.0;
/// The middle of a cell that people walk through is this far from everything, m.
const MARGIN: f64 = 0.3;
/// Distance within which an object counts as near, m; beyond the diagonal of a cell.
const NEAR: f64 = 1.0;
/// Look-ahead of a walker, cells.
const AHEAD: u32 = 2;
/// Distance of an unreachable cell.
const NO_WAY: u32 = u32::MAX;

/// The grid.
#[derive(Clone, Debug, Default)]
pub(crate) struct Floor {
    cell: f64,
    origin: Point,
    columns: usize,
    rows: usize,
    free: Vec<bool>,
    /// Objects near a cell: indices of [`Floor::solids`], and the begin of each cell's list.
    near: Vec<u16>,
    begins: Vec<usize>,
    /// Walls, edges, columns as walls without length; and how thick.
    solids: Vec<(Segment, f64)>,
}

/// Distance from each cell to a place, in fifths of a cell.
#[derive(Clone, Debug)]
pub(crate) struct Field(Vec<u32>);

impl Floor {
    pub fn new(world: &World) -> Self {
        let walls = world.walls.iter().map(|wall| (*wall, 0.0));
        let columns = world.columns.iter().map(|c| (Segment { a: c.centre, b: c.centre }, c.radius));
        let edges = world.edges().map(|edge| (edge, 0.0));
        let solids: Vec<_> = walls.chain(edges).chain(columns).take(usize::from(u16::MAX)).collect();
        let corners = solids.iter().flat_map(|(wall, _)| [wall.a, wall.b]);
        let corners = corners.chain(world.places.iter().copied()).chain([world.start.point()]);
        let (mut least, mut most) = (world.start.point(), world.start.point());
        for corner in corners {
            least = Point { x: least.x.min(corner.x), y: least.y.min(corner.y) };
            most = Point { x: most.x.max(corner.x), y: most.y.max(corner.y) };
        }
        let (width, depth) = (most.x - least.x, most.y - least.y);
        let cell = CELL.max(libm::sqrt(width * depth / CELLS)).max(width.max(depth) / CELLS);
        let count = |length: f64| (libm::ceil(length / cell) as usize).max(1);
        let (columns, rows) = (count(width), count(depth));
        let mut floor = Self { cell, origin: least, columns, rows, solids, ..Self::default() };
        floor.survey(world);
        floor
    }

    fn survey(&mut self, world: &World) {
        for place in 0..self.columns * self.rows {
            let middle = self.middle(place);
            self.begins.push(self.near.len());
            let mut least = f64::INFINITY;
            for (number, (wall, radius)) in self.solids.iter().enumerate() {
                let gap = nearest(wall, middle).distance(middle) - radius;
                least = least.min(gap);
                if gap < NEAR + self.cell {
                    self.near.push(number as u16);
                }
            }
            self.free.push(least > MARGIN && world.floor(middle));
        }
        self.begins.push(self.near.len());
        // People do not walk behind the walls.
        let ways = self.field(world.start.point());
        for (free, way) in self.free.iter_mut().zip(&ways.0) {
            *free &= *way != NO_WAY;
        }
    }

    fn middle(&self, place: usize) -> Point {
        let (column, row) = ((place % self.columns) as f64, (place / self.columns) as f64);
        Point { x: self.origin.x + (column + 0.5) * self.cell, y: self.origin.y + (row + 0.5) * self.cell }
    }

    /// The cell of a point; outside the one at the edge.
    fn place(&self, point: Point) -> usize {
        // As casts saturate.
        let number = |offset: f64, count: usize| ((offset / self.cell) as usize).min(count - 1);
        let column = number(point.x - self.origin.x, self.columns);
        number(point.y - self.origin.y, self.rows) * self.columns + column
    }

    /// The nearest points of what is near a point, and how thick that is around them.
    pub fn near(&self, point: Point) -> impl Iterator<Item = (Point, f64)> + '_ {
        let place = self.place(point);
        let near = &self.near[self.begins[place]..self.begins[place + 1]];
        near.iter().map(move |number| {
            let (wall, radius) = &self.solids[usize::from(*number)];
            (nearest(wall, point), *radius)
        })
    }

    /// A place with room, if there is one.
    pub fn somewhere(&self, random: &mut Random) -> Option<Point> {
        let places = self.free.len() as f64;
        let drawn = (0..200).map(|_| (random.uniform() * places) as usize);
        drawn.into_iter().find(|place| self.free[*place]).map(|place| self.middle(place))
    }

    fn neighbours(&self, place: usize) -> impl Iterator<Item = (usize, u32)> + '_ {
        const STEPS: [(isize, isize, u32); 8] =
            [(1, 0, 5), (0, 1, 5), (-1, 0, 5), (0, -1, 5), (1, 1, 7), (-1, 1, 7), (-1, -1, 7), (1, -1, 7)];
        let (column, row) = (place % self.columns, place / self.columns);
        STEPS.into_iter().filter_map(move |(dx, dy, cost)| {
            let column = column.checked_add_signed(dx).filter(|column| *column < self.columns)?;
            let row = row.checked_add_signed(dy).filter(|row| *row < self.rows)?;
            Some((row * self.columns + column, cost))
        })
    }

    /// The ways to a place (Dijkstra 1959).
    pub fn field(&self, to: Point) -> Field {
        let mut distance = vec![NO_WAY; self.free.len()];
        let mut open = BinaryHeap::from([Reverse((0, self.place(to)))]);
        distance[self.place(to)] = 0;
        while let Some(Reverse((way, place))) = open.pop() {
            if way > distance[place] {
                continue;
            }
            for (next, cost) in self.neighbours(place) {
                if self.free[next] && way + cost < distance[next] {
                    distance[next] = way + cost;
                    open.push(Reverse((way + cost, next)));
                }
            }
        }
        Field(distance)
    }

    /// Next point on the path of a field; `None` near its end, or where it has no path.
    pub fn aim(&self, field: &Field, from: Point) -> Option<Point> {
        let mut place = self.place(from);
        for _ in 0..AHEAD {
            let (next, _) = self.neighbours(place).min_by_key(|(next, _)| field.0[*next])?;
            if field.0[next] == 0 || field.0[next] == NO_WAY {
                return None;
            }
            place = next;
        }
        Some(self.middle(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_leads_round_what_is_in_the_way() {
        let p = |x, y| Point { x, y };
        let mut world = World::hall(10.0, 6.0);
        world.walls.push(Segment { a: p(5.0, 0.0), b: p(5.0, 4.5) });
        let floor = Floor::new(&world);
        let goal = p(8.0, 1.0);
        let field = floor.field(goal);
        let (mut at, mut way) = (p(2.0, 1.0), 0.0);
        while let Some(aim) = floor.aim(&field, at) {
            let (dx, dy) = (aim.x - at.x, aim.y - at.y);
            let distance = at.distance(aim);
            at = p(at.x + 0.1 * dx / distance, at.y + 0.1 * dy / distance);
            // As people do: walls push.
            for (wall, _) in floor.near(at) {
                let gap = wall.distance(at);
                let back = (0.25 - gap).max(0.0) / gap;
                at = p(at.x + back * (at.x - wall.x), at.y + back * (at.y - wall.y));
            }
            way += 0.1;
            assert!(way < 15.0, "{at:?}");
        }
        assert!(at.distance(goal) < 1.0 && way > 9.0, "{at:?} after {way}");
        assert!(floor.aim(&floor.field(p(-50.0, 0.0)), goal).is_some(), "beyond the walls is their inside");
    }

    #[test]
    fn nobody_is_behind_the_walls() {
        let p = |x, y| Point { x, y };
        let mut world = World::hall(20.0, 12.0);
        world.start = navitools::Pose::new(2.0, 2.0, 0.0);
        world.walls.push(Segment { a: p(10.0, 0.0), b: p(10.0, 12.0) });
        let floor = Floor::new(&world);
        let mut random = Random::new(1);
        assert!((0..200).all(|_| floor.somewhere(&mut random).unwrap().x < 10.0));
    }

    #[test]
    fn nobody_walks_where_there_is_no_floor_or_no_room() {
        let p = |x, y| Point { x, y };
        let mut world = World::hall(10.0, 6.0);
        world.start = navitools::Pose::new(1.0, 1.0, 0.0);
        world.drops.push(vec![p(3.0, 1.0), p(7.0, 1.0), p(7.0, 5.0), p(3.0, 5.0)]);
        let floor = Floor::new(&world);
        let mut random = Random::new(1);
        for _ in 0..500 {
            let place = floor.somewhere(&mut random).unwrap();
            assert!(
                world.floor(place)
                    && world.clearance(navitools::Pose::new(place.x, place.y, 0.0), 0.0, 0.0, 0.0) > 0.29
            );
        }
    }
}
