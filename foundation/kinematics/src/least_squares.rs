//! Least squares of up to three unknowns: orthogonalization by Gram and Schmidt, without squaring the condition.

use crate::WHEELS_MAX;
use heapless::Vec;

/// Maximum number of equations: two for each wheel.
pub(crate) const EQUATIONS_MAX: usize = 2 * WHEELS_MAX;

/// Transposed pseudo-inverse: what each equation adds to the three unknowns.
pub(crate) type Inverse = Vec<[f64; 3], EQUATIONS_MAX>;

/// Sine of the angle below which two directions count as parallel.
const PARALLEL_SIN: f64 = 1e-6;

/// Pseudo-inverse of equations in the first `columns` unknowns, and whether they determine these. An unknown that they
/// leave open is zero.
pub(crate) fn pseudo_inverse(rows: impl Iterator<Item = [f64; 3]>, columns: usize) -> (Inverse, bool) {
    let mut q: Inverse = rows.collect();
    let mut determined = true;
    let mut r = [[0.0; 3]; 3];
    for column in 0..columns {
        let norm = |q: &Inverse| libm::sqrt(q.iter().map(|row| row[column] * row[column]).sum());
        let length = norm(&q);
        for (earlier, coefficients) in r.iter_mut().enumerate().take(column) {
            let overlap: f64 = q.iter().map(|row| row[earlier] * row[column]).sum();
            coefficients[column] = overlap;
            q.iter_mut().for_each(|row| row[column] -= overlap * row[earlier]);
        }
        let rest = norm(&q);
        // False also for NaN, and for a column of nothing but rounding, where a metre or a unit vector would be 1.
        let independent = rest > PARALLEL_SIN * length.max(1.0);
        determined &= independent;
        r[column][column] = if independent { rest } else { 1.0 };
        q.iter_mut().for_each(|row| row[column] = if independent { row[column] / rest } else { 0.0 });
    }
    // The pseudo-inverse is R⁻¹ Qᵀ: back substitution for each row of Q.
    for row in &mut q {
        for column in (0..columns).rev() {
            let later: f64 = (column + 1..columns).map(|later| r[column][later] * row[later]).sum();
            row[column] = (row[column] - later) / r[column][column];
        }
    }
    (q, determined)
}

/// Unknowns that fit the values of the equations best.
pub(crate) fn solve(inverse: &Inverse, values: impl Iterator<Item = f64>) -> [f64; 3] {
    inverse.iter().zip(values).fold([0.0; 3], |mut sum, (row, value)| {
        sum.iter_mut().zip(row).for_each(|(sum, coefficient)| *sum += coefficient * value);
        sum
    })
}

/// Index of the first equation that depends on those before it.
pub(crate) fn dependent(mut rows: impl Iterator<Item = [f64; 3]>) -> Option<usize> {
    let mut directions: Vec<[f64; 3], 3> = Vec::new();
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    rows.position(|row| {
        let rest = directions.iter().fold(row, |rest, direction| {
            let overlap = dot(rest, *direction);
            core::array::from_fn(|n| rest[n] - overlap * direction[n])
        });
        let length = libm::sqrt(dot(rest, rest));
        let independent = length > PARALLEL_SIN * libm::sqrt(dot(row, row));
        // No more than three can be independent.
        !independent || directions.push(rest.map(|component| component / length)).is_err()
    })
}
