//! Heuristic: cost to the goal for a round robot that can turn on the spot.
//!
//! Dijkstra from the goal over a grid of 10 cm, for the footprint's middle, with the same proximity cost as the search.
//! Lazy: it expands only as far as requested, and is kept for the next search to the same goal.

use super::lattice::ProximityCost;
use crate::map::Field;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Smallest cell of the grid, m.
const CELL_M: f64 = 0.1;

/// Costs to the goal, as far as they are known.
#[derive(Debug, Default)]
pub(crate) struct Reach {
    /// Cells of the field per cell, in each dimension.
    factor: usize,
    width: usize,
    height: usize,
    cell_m: f32,
    /// Lowest known cost; final up to `frontier`.
    cost: Vec<f32>,
    /// Cost of a metre in a cell; infinite if blocked, NaN if not evaluated yet.
    toll: Vec<f32>,
    queue: BinaryHeap<Reverse<u64>>,
    /// Cost up to which all values are final.
    frontier: f32,
}

impl Reach {
    /// Resets for a field; the goals follow.
    pub(crate) fn begin(&mut self, field: &Field) {
        let frame = field.frame();
        self.factor = (libm::round(CELL_M / frame.resolution) as usize).max(1);
        self.width = frame.width.div_ceil(self.factor);
        self.height = frame.height.div_ceil(self.factor);
        self.cell_m = (frame.resolution * self.factor as f64) as f32;
        self.frontier = 0.0;
        self.queue.clear();
        self.cost.clear();
        self.cost.resize(self.width * self.height, f32::INFINITY);
        self.toll.clear();
        self.toll.resize(self.width * self.height, f32::NAN);
    }

    /// Adds a position of the footprint's middle at the goal.
    pub(crate) fn goal(&mut self, field: &Field, x: f64, y: f64) {
        if let Some(cell) = self.cell(field, x, y) {
            self.offer(cell, 0.0);
        }
    }

    /// Cost from a point to the goal, m: exact on this grid if it is known already or becomes known within `pops`
    /// steps, else a lower bound. Infinite if there is no path. The steps are subtracted from `pops`.
    pub(crate) fn cost(&mut self, field: &Field, toll: &ProximityCost, x: f64, y: f64, pops: &mut u32) -> f32 {
        let Some(cell) = self.cell(field, x, y) else { return f32::INFINITY };
        loop {
            let known = self.cost[cell as usize];
            if known <= self.frontier {
                return known;
            }
            if *pops == 0 {
                return self.frontier;
            }
            *pops -= 1;
            if !self.step(field, toll) {
                return self.cost[cell as usize];
            }
        }
    }

    fn cell(&self, field: &Field, x: f64, y: f64) -> Option<u32> {
        let (column, row) = field.frame().cell(x, y)?;
        Some((row / self.factor * self.width + column / self.factor) as u32)
    }

    fn offer(&mut self, cell: u32, cost: f32) {
        if cost < self.cost[cell as usize] {
            self.cost[cell as usize] = cost;
            // Costs are not negative, so their bit patterns have the same order.
            self.queue.push(Reverse(u64::from(cost.to_bits()) << 32 | u64::from(cell)));
        }
    }

    /// Settles a cell; false if the queue is empty: all other cells are unreachable.
    fn step(&mut self, field: &Field, toll: &ProximityCost) -> bool {
        let Some(Reverse(first)) = self.queue.pop() else {
            self.frontier = f32::INFINITY;
            return false;
        };
        let (cost, cell) = (f32::from_bits((first >> 32) as u32), first as u32);
        self.frontier = cost;
        if cost > self.cost[cell as usize] {
            return true;
        }
        let (column, row) = (cell as usize % self.width, cell as usize / self.width);
        for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
            let (Some(column), Some(row)) = (column.checked_add_signed(dx), row.checked_add_signed(dy)) else {
                continue;
            };
            if column >= self.width || row >= self.height {
                continue;
            }
            let length = if dx != 0 && dy != 0 { core::f32::consts::SQRT_2 } else { 1.0 } * self.cell_m;
            let next = (row * self.width + column) as u32;
            let per_metre = self.toll_of(field, toll, column, row);
            if per_metre.is_finite() {
                self.offer(next, cost + length * per_metre);
            }
        }
        true
    }

    /// The cost factor of a cell is that of its best part, so that the heuristic does not overestimate.
    fn toll_of(&mut self, field: &Field, toll: &ProximityCost, column: usize, row: usize) -> f32 {
        let index = row * self.width + column;
        if self.toll[index].is_nan() {
            let frame = field.frame();
            let columns = column * self.factor..((column + 1) * self.factor).min(frame.width);
            let mut best = 0f32;
            for row in row * self.factor..((row + 1) * self.factor).min(frame.height) {
                best = columns.clone().fold(best, |best, column| best.max(field.cell(column, row)));
            }
            self.toll[index] = if best <= toll.inner { f32::INFINITY } else { toll.at(best) };
        }
        self.toll[index]
    }
}
