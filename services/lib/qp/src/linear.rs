//! The few dense kernels of the solvers, on slices: no allocation, one fixed order of sums.

use nalgebra::DMatrix;

/// a·b, in four interleaved sums (fixed, so the same on every build).
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    let mut sums = [0.0; 4];
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + tail
}

/// y += alpha x.
pub(crate) fn axpy(alpha: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += alpha * x;
    }
}

/// The Euclidean length; overflow-safe because the vectors of this crate are scaled.
pub(crate) fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// Column `j` of a matrix as a slice.
pub(crate) fn column(matrix: &DMatrix<f64>, j: usize) -> &[f64] {
    let height = matrix.nrows();
    &matrix.as_slice()[j * height..(j + 1) * height]
}

/// Column `j` of a matrix as a mutable slice.
pub(crate) fn column_mut(matrix: &mut DMatrix<f64>, j: usize) -> &mut [f64] {
    let height = matrix.nrows();
    &mut matrix.as_mut_slice()[j * height..(j + 1) * height]
}

/// Replaces the lower triangle of a unit-diagonal matrix by its Cholesky factor L, LL' = M.
/// Returns the first pivot at or below `least` with its index.
pub(crate) fn cholesky(matrix: &mut DMatrix<f64>, least: f64) -> Result<(), (usize, f64)> {
    let n = matrix.nrows();
    for j in 0..n {
        let (done, rest) = matrix.as_mut_slice().split_at_mut(j * n);
        let target = &mut rest[..n];
        for k in 0..j {
            let source = &done[k * n..(k + 1) * n];
            axpy(-source[j], &source[j..], &mut target[j..]);
        }
        let pivot = target[j];
        if pivot <= least || pivot.is_nan() {
            return Err((j, pivot));
        }
        let scale = 1.0 / pivot.sqrt();
        target[j..].iter_mut().for_each(|entry| *entry *= scale);
    }
    Ok(())
}

/// b <- L⁻¹ b, L lower triangular.
pub(crate) fn solve_lower(l: &DMatrix<f64>, b: &mut [f64]) {
    for j in 0..b.len() {
        let source = column(l, j);
        b[j] /= source[j];
        let pivot = b[j];
        axpy(-pivot, &source[j + 1..], &mut b[j + 1..]);
    }
}

/// b <- L'⁻¹ b, L lower triangular.
pub(crate) fn solve_lower_transposed(l: &DMatrix<f64>, b: &mut [f64]) {
    for j in (0..b.len()).rev() {
        let source = column(l, j);
        b[j] = (b[j] - dot(&source[j + 1..], &b[j + 1..])) / source[j];
    }
}

/// b <- R⁻¹ b, R the leading upper triangle of `r`, as large as `b`.
pub(crate) fn solve_upper(r: &DMatrix<f64>, b: &mut [f64]) {
    for j in (0..b.len()).rev() {
        let source = column(r, j);
        b[j] /= source[j];
        let pivot = b[j];
        axpy(-pivot, &source[..j], &mut b[..j]);
    }
}

/// b <- R'⁻¹ b, R the leading upper triangle of `r`, as large as `b`.
pub(crate) fn solve_upper_transposed(r: &DMatrix<f64>, b: &mut [f64]) {
    for j in 0..b.len() {
        let source = column(r, j);
        b[j] = (b[j] - dot(&source[..j], &b[..j])) / source[j];
    }
}

/// out <- M v.
pub(crate) fn times(matrix: &DMatrix<f64>, v: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (j, &value) in v.iter().enumerate() {
        axpy(value, column(matrix, j), out);
    }
}
