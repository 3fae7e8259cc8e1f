//! What a law hands to the engine: horizon, model and weights.

use nalgebra::{SMatrix, SVector};

use crate::MpcError;

/// Prediction and control horizon, Np and Nc, in samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Horizon {
    /// Np: samples over which the output error is weighed.
    pub prediction: usize,
    /// Nc <= Np: samples in which the input may still move.
    pub control: usize,
}

impl Horizon {
    /// Largest prediction horizon accepted.
    pub const PREDICTION_LIMIT: usize = 100;

    /// Checks 1 <= Nc <= Np <= [`Self::PREDICTION_LIMIT`].
    ///
    /// # Errors
    /// [`MpcError::ControlHorizon`] or [`MpcError::PredictionHorizon`] outside that range.
    pub const fn check(&self) -> Result<(), MpcError> {
        let Self { prediction, control } = *self;
        if prediction > Self::PREDICTION_LIMIT {
            return Err(MpcError::PredictionHorizon { prediction, limit: Self::PREDICTION_LIMIT });
        }
        if control == 0 || control > prediction {
            return Err(MpcError::ControlHorizon { control, prediction });
        }
        Ok(())
    }
}

/// x(k+1) = A x(k) + B u(k), y(k) = C x(k), equation (9).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model<const NX: usize, const NU: usize, const NY: usize> {
    /// A, of the sampled model.
    pub a: SMatrix<f64, NX, NX>,
    /// B, of the sampled model.
    pub b: SMatrix<f64, NX, NU>,
    /// C.
    pub c: SMatrix<f64, NY, NX>,
}

/// Diagonal weights of the cost (15), which has Q = 1 in the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights<const NU: usize, const NY: usize> {
    /// Diagonal of Q, on each output error.
    pub output: SVector<f64, NY>,
    /// Diagonal of W, on each input increment; unit (output unit / input unit)^2.
    pub increment: SVector<f64, NU>,
}

impl<const NU: usize, const NY: usize> Weights<NU, NY> {
    /// The paper's cost: Q = 1 and the given W.
    #[must_use]
    pub fn on_increments(increment: SVector<f64, NU>) -> Self {
        Self { output: SVector::repeat(1.0), increment }
    }
}
