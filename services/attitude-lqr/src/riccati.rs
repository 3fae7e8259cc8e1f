//! The discrete algebraic Riccati equation of a small system.
//!
//! By doubling, on matrices of fixed size and in a written order: the bits are the same on every
//! processor, which a library that chooses its kernels by the processor does not promise.

use nalgebra::{SMatrix, SVector};

/// Doublings after which the solution of 2²⁴ samples of horizon is as good as that of endlessly many.
const DOUBLINGS: usize = 24;

/// P of `P = AᵀPA − AᵀPB (r + BᵀPB)⁻¹ BᵀPA + Q` for one input; `None` if the pair cannot be stabilised.
///
/// Structure-preserving doubling [Chu, Fan, Lin]: after j turns P is that of a horizon of 2ʲ samples.
#[must_use]
pub fn doubling<const N: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SVector<f64, N>,
    q: &SMatrix<f64, N, N>,
    r: f64,
) -> Option<SMatrix<f64, N, N>> {
    let one = SMatrix::<f64, N, N>::identity();
    let (mut a, mut g, mut h) = (*a, b * b.transpose() / r, *q);
    for _ in 0..DOUBLINGS {
        // A ← A W⁻¹ A, G ← G + A W⁻¹ G Aᵀ, H ← H + Aᵀ H W⁻¹ A with W = 1 + G H.
        let inverse = (one + g * h).try_inverse()?;
        let through = a * inverse;
        let grown = h + a.transpose() * h * inverse * a;
        g += through * g * a.transpose();
        a = through * a;
        let converged = (grown - h).amax() <= f64::EPSILON * grown.amax();
        // Symmetric but for rounding, which must not grow.
        h = (grown + grown.transpose()) * 0.5;
        g = (g + g.transpose()) * 0.5;
        if converged {
            break;
        }
    }
    h.iter().all(|number| number.is_finite()).then_some(h)
}

/// K of `u = −K x`: `(r + BᵀPB)⁻¹ BᵀPA`.
#[must_use]
pub fn gain<const N: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SVector<f64, N>,
    p: &SMatrix<f64, N, N>,
    r: f64,
) -> SVector<f64, N> {
    let weight = r + b.dot(&(p * b));
    (a.transpose() * p * b) / weight
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Vector1};

    #[test]
    fn of_a_scalar_it_is_the_root_of_the_quadratic() {
        // p = a²p − a²p²b²/(r + b²p) + q
        for (a, b, q, r) in [(1.0, 1.0, 1.0, 1.0), (1.2, 0.3, 0.5, 2.0), (0.5, 2.0, 3.0, 0.1)] {
            let p = doubling(&Matrix1::new(a), &Vector1::new(b), &Matrix1::new(q), r).unwrap().x;
            let half: f64 = 0.5 * (r - a * a * r - b * b * q);
            let root = (-half + (half * half + b * b * q * r).sqrt()) / (b * b);
            assert!((p - root).abs() < 1e-12 * root, "{p} {root}");
        }
    }

    #[test]
    fn what_cannot_be_stabilised_has_none() {
        let nothing = doubling(&Matrix1::new(2.0), &Vector1::new(0.0), &Matrix1::new(1.0), 1.0);
        assert_eq!(nothing, None);
    }
}
