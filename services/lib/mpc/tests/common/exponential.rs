//! The exponential of a matrix by scaling, Taylor's series and squaring, for small sizes.

use nalgebra::SMatrix;

pub(crate) fn exponential<const N: usize>(matrix: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let (mut scaled, mut squarings) = (matrix, 0);
    while scaled.amax() * N as f64 > 0.5 {
        scaled *= 0.5;
        squarings += 1;
    }
    let mut term = SMatrix::identity();
    let mut sum = term;
    for order in 1..=18 {
        term = term * scaled / f64::from(order);
        sum += term;
    }
    (0..squarings).fold(sum, |root, _| root * root)
}
