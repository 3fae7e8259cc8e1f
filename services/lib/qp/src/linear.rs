//! The few dense kernels of the solvers, on slices: no allocation, one fixed order of sums.

use nalgebra::{DMatrix, Scalar};

use crate::real::Real;

/// a·b, in four interleaved sums (fixed, so the same on every build).
pub(crate) fn dot<A: Copy + Into<T>, T: Real>(a: &[A], b: &[T]) -> T {
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let ends = a4.remainder().iter().zip(b4.remainder());
    let tail = ends.fold(T::ZERO, |sum, (x, y)| sum + (*x).into() * *y);
    let mut sums = [T::ZERO; 4];
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += x[k].into() * y[k];
        }
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + tail
}

/// y += alpha x.
pub(crate) fn axpy<A: Copy + Into<T>, T: Real>(alpha: T, x: &[A], y: &mut [T]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += alpha * (*x).into();
    }
}

/// The Euclidean length; overflow-safe because the vectors of this crate are scaled.
pub(crate) fn norm<T: Real>(a: &[T]) -> T {
    dot(a, a).sqrt()
}

/// Column `j` of a matrix as a slice.
pub(crate) fn column<T: Scalar>(matrix: &DMatrix<T>, j: usize) -> &[T] {
    let height = matrix.nrows();
    &matrix.as_slice()[j * height..(j + 1) * height]
}

/// Column `j` of a matrix as a mutable slice.
pub(crate) fn column_mut<T: Scalar>(matrix: &mut DMatrix<T>, j: usize) -> &mut [T] {
    let height = matrix.nrows();
    &mut matrix.as_mut_slice()[j * height..(j + 1) * height]
}

/// Replaces the lower triangle of a unit-diagonal matrix by its Cholesky factor L, LL' = M.
/// Returns the first pivot at or below `least` with its index.
pub(crate) fn cholesky<T: Real>(matrix: &mut DMatrix<T>, least: f64) -> Result<(), (usize, f64)> {
    let n = matrix.nrows();
    for j in 0..n {
        let (done, rest) = matrix.as_mut_slice().split_at_mut(j * n);
        let target = &mut rest[..n];
        for k in 0..j {
            let source = &done[k * n..(k + 1) * n];
            axpy(-source[j], &source[j..], &mut target[j..]);
        }
        let pivot = target[j];
        if pivot.round() <= least || pivot.round().is_nan() {
            return Err((j, pivot.round()));
        }
        let scale = T::from(1.0) / pivot.sqrt();
        target[j..].iter_mut().for_each(|entry| *entry *= scale);
    }
    Ok(())
}

/// b <- L⁻¹ b, L lower triangular.
pub(crate) fn solve_lower<T: Real>(l: &DMatrix<T>, b: &mut [T]) {
    for j in 0..b.len() {
        let source = column(l, j);
        b[j] /= source[j];
        let pivot = b[j];
        axpy(-pivot, &source[j + 1..], &mut b[j + 1..]);
    }
}

/// b <- L'⁻¹ b, L lower triangular.
pub(crate) fn solve_lower_transposed<T: Real>(l: &DMatrix<T>, b: &mut [T]) {
    for j in (0..b.len()).rev() {
        let source = column(l, j);
        b[j] = (b[j] - dot(&source[j + 1..], &b[j + 1..])) / source[j];
    }
}

/// b <- R⁻¹ b, R the leading upper triangle of `r`, as large as `b`.
pub(crate) fn solve_upper<T: Real>(r: &DMatrix<T>, b: &mut [T]) {
    for j in (0..b.len()).rev() {
        let source = column(r, j);
        b[j] /= source[j];
        let pivot = b[j];
        axpy(-pivot, &source[..j], &mut b[..j]);
    }
}

/// b <- R'⁻¹ b, R the leading upper triangle of `r`, as large as `b`.
pub(crate) fn solve_upper_transposed<T: Real>(r: &DMatrix<T>, b: &mut [T]) {
    for j in 0..b.len() {
        let source = column(r, j);
        b[j] = (b[j] - dot(&source[..j], &b[..j])) / source[j];
    }
}

/// out <- M v.
pub(crate) fn times<T: Real>(matrix: &DMatrix<f64>, v: &[T], out: &mut [T]) {
    out.fill(T::ZERO);
    for (j, &value) in v.iter().enumerate() {
        axpy(value, column(matrix, j), out);
    }
}
