//! Prediction (11) of the incremental model (10), kept as step responses.
//!
//! With the integrator embedded, y(k+j) = y + Σ C Aⁱ Δx + Σ S Δu, where S(j), the response j
//! samples after a unit step of u, obeys S(j) = S(j−1) + C A^(j−1) B. H of (11) is the block
//! Toeplitz matrix of the S(j) and is never stored. F x(k) is propagated sample by sample: A moves
//! with every change of the scheduling parameter, and Np products with Δx cost less than
//! rebuilding F.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use crate::{Model, Weights};

/// Step responses S(1)..S(Np) of a model.
#[derive(Debug, Clone)]
pub(crate) struct StepResponse<const NU: usize, const NY: usize> {
    blocks: Vec<SMatrix<f64, NY, NU>>,
}

impl<const NU: usize, const NY: usize> StepResponse<NU, NY> {
    /// Room for `prediction` samples.
    pub(crate) fn new(prediction: usize) -> Self {
        Self { blocks: vec![SMatrix::zeros(); prediction] }
    }

    /// Recomputes S(1)..S(Np) in place.
    pub(crate) fn rebuild<const NX: usize>(&mut self, model: &Model<NX, NU, NY>) {
        let mut impulse = model.b; // A^(j−1) B
        let mut step = SMatrix::<f64, NY, NU>::zeros();
        for block in &mut self.blocks {
            step += model.c * impulse;
            *block = step;
            impulse = model.a * impulse;
        }
    }

    /// ζ = 2(Hᵀ Q H + W) of (16), into `zeta` (NU Nc square, ordered by time, then input).
    ///
    /// Toeplitz: block (i, j) is block (i+1, j+1) plus the one term that reaches the horizon.
    pub(crate) fn hessian(&self, weights: &Weights<NU, NY>, zeta: &mut DMatrix<f64>) {
        let prediction = self.blocks.len();
        let control = zeta.nrows() / NU;
        let q = SMatrix::<f64, NY, NY>::from_diagonal(&weights.output);
        for offset in 0..control {
            let mut block = SMatrix::<f64, NU, NU>::zeros();
            // i >= j = i - offset: start where the lower of the two moves comes last.
            let last = control - 1;
            for s in 0..prediction - last {
                block += self.blocks[s].transpose() * q * self.blocks[s + offset];
            }
            for i in (offset..control).rev() {
                if i < last {
                    let s = prediction - 1 - i;
                    block += self.blocks[s].transpose() * q * self.blocks[s + offset];
                }
                let j = i - offset;
                zeta.fixed_view_mut::<NU, NU>(NU * i, NU * j).copy_from(&(block * 2.0));
                zeta.fixed_view_mut::<NU, NU>(NU * j, NU * i).copy_from(&(block.transpose() * 2.0));
            }
        }
        for i in 0..NU * control {
            zeta[(i, i)] += 2.0 * weights.increment[i % NU];
        }
    }

    /// η = -2 Hᵀ Q (Rs - F x) of (16), from the errors of the free response.
    pub(crate) fn gradient(
        &self,
        weights: &Weights<NU, NY>,
        errors: &[SVector<f64, NY>],
        eta: &mut DVector<f64>,
    ) {
        let control = eta.len() / NU;
        for i in 0..control {
            let mut block = SVector::<f64, NU>::zeros();
            for (response, error) in self.blocks.iter().zip(&errors[i..]) {
                block += response.tr_mul(&weights.output.component_mul(error));
            }
            eta.fixed_rows_mut::<NU>(NU * i).copy_from(&(block * -2.0));
        }
    }
}

/// Rs - F x(k): the errors that remain if the input does not move, for k+1..=k+Np.
pub(crate) fn free_errors<const NX: usize, const NU: usize, const NY: usize>(
    model: &Model<NX, NU, NY>,
    state_increment: &SVector<f64, NX>,
    output: &SVector<f64, NY>,
    reference: impl Fn(usize) -> SVector<f64, NY>,
    errors: &mut [SVector<f64, NY>],
) {
    let mut increment = *state_increment;
    let mut y = *output;
    for (ahead, error) in errors.iter_mut().enumerate() {
        increment = model.a * increment;
        y += model.c * increment;
        *error = reference(ahead + 1) - y;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, RowVector2, Vector1, Vector2};

    use super::*;

    const PREDICTION: usize = 7;
    const CONTROL: usize = 3;

    /// Two inputs, two outputs, everything coupled and nothing symmetric.
    fn model() -> Model<3, 2, 2> {
        Model {
            a: SMatrix::<f64, 3, 3>::new(0.9, 0.2, -0.1, 0.05, 0.8, 0.3, 0.0, -0.4, 0.7),
            b: SMatrix::<f64, 3, 2>::new(1.0, 0.3, -0.2, 0.8, 0.5, 0.1),
            c: SMatrix::<f64, 2, 3>::new(1.0, 0.0, 0.2, 0.1, 0.7, 0.0),
        }
    }

    fn power(a: &DMatrix<f64>, exponent: usize) -> DMatrix<f64> {
        (0..exponent).fold(DMatrix::identity(5, 5), |product, _| product * a)
    }

    /// F and H of (11) from powers of the augmented matrices of (10), as printed.
    fn explicit() -> (DMatrix<f64>, DMatrix<f64>) {
        let Model { a, b, c } = model();
        let mut big_a = DMatrix::<f64>::zeros(5, 5);
        big_a.view_mut((0, 0), (3, 3)).copy_from(&a);
        big_a.view_mut((3, 0), (2, 3)).copy_from(&(c * a));
        big_a.view_mut((3, 3), (2, 2)).copy_from(&Matrix2::identity());
        let mut big_b = DMatrix::<f64>::zeros(5, 2);
        big_b.view_mut((0, 0), (3, 2)).copy_from(&b);
        big_b.view_mut((3, 0), (2, 2)).copy_from(&(c * b));
        let mut big_c = DMatrix::<f64>::zeros(2, 5);
        big_c.view_mut((0, 3), (2, 2)).copy_from(&Matrix2::identity());
        let mut f = DMatrix::zeros(2 * PREDICTION, 5);
        let mut h = DMatrix::zeros(2 * PREDICTION, 2 * CONTROL);
        for j in 0..PREDICTION {
            f.view_mut((2 * j, 0), (2, 5)).copy_from(&(&big_c * power(&big_a, j + 1)));
            for i in 0..=j.min(CONTROL - 1) {
                let block = &big_c * power(&big_a, j - i) * &big_b;
                h.view_mut((2 * j, 2 * i), (2, 2)).copy_from(&block);
            }
        }
        (f, h)
    }

    #[test]
    fn condensing_equals_the_explicit_matrices_of_equations_10_11_and_16() {
        let (f, h) = explicit();
        let weights =
            Weights { output: Vector2::new(1.0, 2.5), increment: Vector2::new(0.3, 0.07) };
        let q =
            DMatrix::from_diagonal(&DVector::from_fn(2 * PREDICTION, |i, _| weights.output[i % 2]));
        let w =
            DMatrix::from_diagonal(&DVector::from_fn(2 * CONTROL, |i, _| weights.increment[i % 2]));
        let mut response = StepResponse::<2, 2>::new(PREDICTION);
        response.rebuild(&model());
        let mut zeta = DMatrix::zeros(2 * CONTROL, 2 * CONTROL);
        response.hessian(&weights, &mut zeta);
        assert!((&zeta - (h.transpose() * &q * &h + w) * 2.0).amax() < 1e-12);
        assert_eq!(zeta, zeta.transpose(), "the solver refuses anything else");

        let dx = SVector::<f64, 3>::new(0.3, -0.7, 0.2);
        let y = Vector2::new(0.4, -1.1);
        let reference = |ahead: usize| Vector2::new(ahead as f64, 1.0 / ahead as f64);
        let mut errors = [SVector::<f64, 2>::zeros(); PREDICTION];
        free_errors(&model(), &dx, &y, reference, &mut errors);
        let state = DVector::from_iterator(5, dx.iter().chain(y.iter()).copied());
        let rs = DVector::from_fn(2 * PREDICTION, |i, _| reference(i / 2 + 1)[i % 2]);
        let expected = rs - f * state;
        for (j, error) in errors.iter().enumerate() {
            assert!((error - expected.fixed_rows::<2>(2 * j)).amax() < 1e-12);
        }
        let mut eta = DVector::zeros(2 * CONTROL);
        response.gradient(&weights, &errors, &mut eta);
        assert!((eta - h.transpose() * q * expected * -2.0).amax() < 1e-11);
    }

    #[test]
    fn the_step_response_of_an_integrator_is_the_ramp() {
        let model = Model::<2, 1, 1> {
            a: Matrix2::new(1.0, 0.1, 0.0, 1.0),
            b: Vector2::new(0.0, 1.0),
            c: RowVector2::new(0.0, 1.0),
        };
        let mut response = StepResponse::<1, 1>::new(5);
        response.rebuild(&model);
        for (index, block) in response.blocks.iter().enumerate() {
            assert_eq!(*block, Vector1::new(index as f64 + 1.0));
        }
    }
}
