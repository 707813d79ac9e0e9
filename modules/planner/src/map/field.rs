//! Distance field: exact distance of each cell from the nearest occupied one, with a layer of temporary obstacles.
//!
//! The distances of the map are computed once, in whole cells and without rounding (A. Meijster, J. Roerdink, W.
//! Hesselink, A general algorithm for computing distance transforms in linear time, 2000). Temporary obstacles are
//! stamped over them, out to [`REACH_M`]; the next layer first removes the previous one. Everything outside the map is
//! occupied.

use super::{Cell, Frame, Map};

/// Range of a temporary obstacle's effect, from its edge, m: more than any footprint's corner circle and the clearance
/// that planning prefers.
pub const REACH_M: f64 = 1.2;

/// Interpretation of unknown cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unknown {
    /// Occupied.
    #[default]
    Blocked,
    /// Free.
    Free,
}

/// Round temporary obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Middle, x, m.
    pub x: f64,
    /// Middle, y, m.
    pub y: f64,
    /// Radius, m; 0 for a single cell.
    pub radius: f64,
}

/// Distances, m, from the middle of each cell to the middle of the nearest occupied one; occupied cells have 0 or less.
#[derive(Clone, Debug)]
pub struct Field {
    frame: Frame,
    /// Distances with the temporary obstacles.
    live: Vec<f32>,
    /// Distances of the map alone; empty until the first obstacle.
    still: Vec<f32>,
    /// Occupied cells of `live`, a bit for each, in rows of whole words.
    occupied: Vec<u64>,
    /// Rectangles of `live` that differ: columns, rows.
    stamped: Vec<[usize; 4]>,
    /// Distances from the middle of a cell to the cells right of it and above.
    template: Vec<f32>,
    obstacles: Vec<Obstacle>,
    still_identity: u64,
    identity: u64,
}

impl Field {
    /// Computes the field of a map.
    #[must_use]
    pub fn new(map: &Map, unknown: Unknown) -> Self {
        let blocked = |cell: Cell| cell == Cell::Occupied || (cell == Cell::Unknown && unknown == Unknown::Blocked);
        let live = distances(&map.frame, |index| blocked(map.cells[index]));
        let occupied = bits(&live, map.frame.width);
        let identity = live.iter().fold(frame_identity(&map.frame), |mixed, distance| mix(mixed, distance.to_bits()));
        Self {
            frame: map.frame,
            live,
            occupied,
            still: Vec::new(),
            stamped: Vec::new(),
            template: Vec::new(),
            obstacles: Vec::new(),
            still_identity: identity,
            identity,
        }
    }

    /// Position, resolution and size.
    #[must_use]
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Hash of frame and distances: equal for equal fields; fields that differ have the same hash with probability
    /// 2⁻⁶⁴.
    #[must_use]
    pub fn identity(&self) -> u64 {
        self.identity
    }

    /// Distance at a point, m, accurate to one and a half cells; 0 outside the map.
    #[must_use]
    pub fn distance(&self, x: f64, y: f64) -> f32 {
        self.frame.cell(x, y).map_or(0.0, |(column, row)| self.live[self.frame.index(column, row)])
    }

    /// Distance up to which the distances are right, m: farther ones may leave out temporary obstacles.
    pub(crate) fn reach(&self) -> f32 {
        if self.obstacles.is_empty() { f32::INFINITY } else { REACH_M as f32 }
    }

    /// Lower bound of the distance at a point, m, as accurate as [`Field::distance`].
    pub(crate) fn bound(&self, x: f64, y: f64) -> f32 {
        self.distance(x, y).min(self.reach())
    }

    /// Distance of a cell within the frame.
    pub(crate) fn cell(&self, column: usize, row: usize) -> f32 {
        self.live[self.frame.index(column, row)]
    }

    /// True if a cell of a row is occupied, from column `first` to `last`.
    pub(crate) fn is_occupied(&self, row: usize, first: usize, last: usize) -> bool {
        let words = &self.occupied[row * self.frame.width.div_ceil(WORD)..];
        let (from, to) = (first / WORD, last / WORD);
        let (low, high) = (u64::MAX << (first % WORD), u64::MAX >> (WORD - 1 - last % WORD));
        if from == to {
            return words[from] & low & high != 0;
        }
        words[from] & low != 0 || words[to] & high != 0 || words[from + 1..to].iter().any(|word| *word != 0)
    }

    /// Occupied cells of a row from column `first` to `last`.
    pub(crate) fn occupied(&self, row: usize, first: usize, last: usize) -> impl Iterator<Item = usize> + '_ {
        let words = &self.occupied[row * self.frame.width.div_ceil(WORD)..];
        (first / WORD..=last / WORD).flat_map(move |number| {
            let low = if number == first / WORD { u64::MAX << (first % WORD) } else { u64::MAX };
            let high = if number == last / WORD { u64::MAX >> (WORD - 1 - last % WORD) } else { u64::MAX };
            let mut left = words[number] & low & high;
            core::iter::from_fn(move || {
                let bit = left.trailing_zeros() as usize;
                left &= left.wrapping_sub(1);
                (bit < WORD).then_some(number * WORD + bit)
            })
        })
    }

    /// Replaces the temporary obstacles. Those outside the map or with NaN are ignored. Cost: proportional to the area
    /// around all obstacles, about ten microseconds for ten of them.
    pub fn overlay(&mut self, obstacles: &[Obstacle]) {
        if self.obstacles == obstacles {
            return;
        }
        self.obstacles.clear();
        self.obstacles.extend_from_slice(obstacles);
        if self.still.is_empty() {
            self.still.clone_from(&self.live);
        }
        self.identity = obstacles.iter().fold(self.still_identity, |mixed, Obstacle { x, y, radius }| {
            [x, y, radius].into_iter().fold(mixed, |mixed, part| {
                let bits = part.to_bits();
                mix(mix(mixed, bits as u32), (bits >> 32) as u32)
            })
        });
        let mut stamped = std::mem::take(&mut self.stamped);
        for &[left, right, low, high] in &stamped {
            for row in low..=high {
                let cells = row * self.frame.width + left..=row * self.frame.width + right;
                self.live[cells.clone()].copy_from_slice(&self.still[cells]);
            }
            self.update_bits([left, right, low, high]);
        }
        stamped.clear();
        self.stamped = stamped;
        obstacles.iter().for_each(|&obstacle| self.stamp(obstacle));
        for number in 0..self.stamped.len() {
            self.update_bits(self.stamped[number]);
        }
    }

    /// Sets the bits of the words that contain these columns and rows.
    fn update_bits(&mut self, [left, right, low, high]: [usize; 4]) {
        let width = self.frame.width;
        for row in low..=high {
            for word in left / WORD..=right / WORD {
                let cells = &self.live[row * width..][word * WORD..width.min((word + 1) * WORD)];
                self.occupied[row * width.div_ceil(WORD) + word] = word_of(cells);
            }
        }
    }

    fn stamp(&mut self, Obstacle { x, y, radius }: Obstacle) {
        let frame = self.frame;
        let Some((column, row)) = frame.cell(x, y) else { return };
        if !(0.0..=REACH_M * 4.0).contains(&radius) {
            return;
        }
        let reach = ((radius + REACH_M) / frame.resolution) as usize + 1;
        let side = 1 + ((5.0 * REACH_M) / frame.resolution) as usize + 1;
        if self.template.is_empty() {
            let far =
                |i: usize| ((i / side * (i / side) + i % side * (i % side)) as f32).sqrt() * frame.resolution as f32;
            self.template = (0..side * side).map(far).collect();
        }
        let (left, right) = (column.saturating_sub(reach), (column + reach).min(frame.width - 1));
        let (low, high) = (row.saturating_sub(reach), (row + reach).min(frame.height - 1));
        let radius = radius as f32;
        for at in low..=high {
            let away = &self.template[at.abs_diff(row) * side..][..side];
            let cells = &mut self.live[at * frame.width + left..=at * frame.width + right];
            let (before, after) = cells.split_at_mut(column - left);
            let nearer = |cell: &mut f32, away: &f32| *cell = cell.min(away - radius);
            before.iter_mut().rev().zip(&away[1..]).for_each(|(cell, away)| nearer(cell, away));
            after.iter_mut().zip(away).for_each(|(cell, away)| nearer(cell, away));
        }
        self.stamped.push([left, right, low, high]);
    }
}

/// Number of cells in a word.
const WORD: usize = u64::BITS as usize;

/// Bits of at most 64 cells that are occupied, the first one in the lowest bit.
fn word_of(cells: &[f32]) -> u64 {
    cells.iter().rev().fold(0, |word, cell| word << 1 | u64::from(*cell <= 0.0))
}

fn bits(cells: &[f32], width: usize) -> Vec<u64> {
    cells.chunks_exact(width).flat_map(|row| row.chunks(WORD).map(word_of)).collect()
}

/// FNV-1a over 32-bit words.
fn mix(mixed: u64, word: u32) -> u64 {
    (mixed ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3)
}

fn frame_identity(frame: &Frame) -> u64 {
    [frame.x.to_bits(), frame.y.to_bits(), frame.resolution.to_bits(), frame.width as u64, frame.height as u64]
        .into_iter()
        .fold(0xcbf2_9ce4_8422_2325, |mixed, word| mix(mix(mixed, word as u32), (word >> 32) as u32))
}

/// Exact distances, m, of all cells from the nearest blocked one, or from the nearest cell outside.
fn distances(frame: &Frame, blocked: impl Fn(usize) -> bool) -> Vec<f32> {
    let (width, height) = (frame.width, frame.height);
    // First along the columns: number of rows to the nearest blocked cell, which a float holds exactly.
    let mut out = vec![0f32; width * height];
    for row in 0..height {
        for column in 0..width {
            let index = row * width + column;
            let below = if row == 0 { 0.0 } else { out[index - width] };
            out[index] = if blocked(index) { 0.0 } else { below + 1.0 };
        }
    }
    for row in (0..height).rev() {
        for column in 0..width {
            let index = row * width + column;
            let above = if row + 1 == height { 0.0 } else { out[index + width] };
            out[index] = out[index].min(above + 1.0);
        }
    }
    // Then along each row: lower envelope of the parabolas over its columns.
    let resolution = frame.resolution as f32;
    let mut rows = vec![0i64; width];
    let mut envelope: Vec<(i64, i64)> = Vec::with_capacity(width);
    for out in out.chunks_exact_mut(width) {
        rows.iter_mut().zip(out.iter()).for_each(|(rows, out)| *rows = *out as i64);
        let square = |at: i64, of: i64| (at - of) * (at - of) + rows[of as usize] * rows[of as usize];
        envelope.clear();
        envelope.push((0, 0));
        for column in 1..width as i64 {
            while let Some(&(of, from)) = envelope.last()
                && square(from, of) > square(from, column)
            {
                envelope.pop();
            }
            let from = match envelope.last() {
                None => 0,
                // First cell that is nearer to this column's parabola than to the previous one's.
                Some(&(of, _)) => {
                    let (a, b) = (rows[of as usize], rows[column as usize]);
                    (column * column - of * of + b * b - a * a).div_euclid(2 * (column - of)) + 1
                }
            };
            if from < width as i64 {
                envelope.push((column, from));
            }
        }
        let mut piece = envelope.len();
        for column in (0..width as i64).rev() {
            while piece > 1 && envelope[piece - 1].1 > column {
                piece -= 1;
            }
            let edge = (column + 1).min(width as i64 - column);
            let nearest = square(column, envelope[piece - 1].0).min(edge * edge);
            out[column as usize] = (nearest as f32).sqrt() * resolution;
        }
    }
    out
}

#[cfg(test)]
mod tests;
