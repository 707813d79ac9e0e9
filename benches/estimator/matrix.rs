//! Small matrices for the bound and the reference EKF.

/// Dimension of the bound's state.
pub const N: usize = 6;
pub type Matrix = [[f64; N]; N];

/// F P Fᵀ.
pub fn predict<const M: usize>(p: &[[f64; M]; M], f: &[[f64; M]; M]) -> [[f64; M]; M] {
    let fp: [[f64; M]; M] =
        std::array::from_fn(|row| std::array::from_fn(|column| (0..M).map(|k| f[row][k] * p[k][column]).sum()));
    std::array::from_fn(|row| std::array::from_fn(|column| (0..M).map(|k| fp[row][k] * f[column][k]).sum()))
}

pub fn add<const M: usize>(a: &[[f64; M]; M], b: &[[f64; M]; M]) -> [[f64; M]; M] {
    std::array::from_fn(|row| std::array::from_fn(|column| a[row][column] + b[row][column]))
}

/// Updates a covariance with a measurement of variance `r` and derivatives `by`; returns its gain and expected
/// variance.
pub fn update<const M: usize>(p: &mut [[f64; M]; M], by: &[f64; M], r: f64) -> ([f64; M], f64) {
    let ph: [f64; M] = std::array::from_fn(|row| (0..M).map(|k| p[row][k] * by[k]).sum());
    let s = r + (0..M).map(|k| by[k] * ph[k]).sum::<f64>();
    for row in 0..M {
        for column in 0..M {
            p[row][column] -= ph[row] * ph[column] / s;
        }
    }
    (ph.map(|value| value / s), s)
}

/// eᵀ P⁻¹ e in three dimensions.
pub fn normalized(p: &[[f64; 3]; 3], e: [f64; 3]) -> f64 {
    let minor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        p[r1][c1] * p[r2][c2] - p[r1][c2] * p[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| p[0][c] * minor(0, c)).sum();
    (0..3).map(|r| (0..3).map(|c| e[r] * minor(c, r) / determinant * e[c]).sum::<f64>()).sum()
}
