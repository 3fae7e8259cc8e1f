//! One interface for everything that can stand in for the vehicle.

use crate::{Disturbance, MODEL_MEMORY_LEN, Truth, Wrench};

/// Held command to the rotors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Actuation {
    /// Commanded thrusts `F_i` \[N\]; 1 front, 2 left, 3 rear, 4 right.
    Rotors([f64; 4]),
    /// Commanded wrench.
    Wrench(Wrench),
}

impl Actuation {
    /// True if every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        match self {
            Self::Rotors(thrusts) => thrusts.iter().all(|f| f.is_finite()),
            Self::Wrench(wrench) => wrench.is_finite(),
        }
    }
}

/// What is held constant over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantInputs {
    /// Command to the rotors.
    pub actuation: Actuation,
    /// Commanded morph angle \[rad\], brought into the linkage's range.
    pub morph_command_rad: f64,
    /// What acts from outside.
    pub disturbance: Disturbance,
}

impl PlantInputs {
    /// True if a model can step with it.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.actuation.is_finite()
            && self.morph_command_rad.is_finite()
            && self.disturbance.is_usable()
    }
}

/// How a step ended. In the last two cases the model is as it was before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
pub enum StepStatus {
    /// Time went on.
    Advanced,
    /// The step length is outside the model's range, or an input is NaN, infinite or negative
    /// where it must not be.
    BadInput,
    /// The state would no longer be finite.
    Diverged,
}

/// A model of the vehicle that can be integrated. Its whole memory is an array, so that a successor
/// continues with the same bits.
pub trait PlantModel: std::fmt::Debug + Send {
    /// Advances by `dt_s` with `inputs` held.
    fn step(&mut self, dt_s: f64, inputs: &PlantInputs) -> StepStatus;

    /// What a perfect observer sees now, with `inputs` in effect. Unusable inputs count as none:
    /// the last actuation, calm air.
    fn truth(&self, inputs: &PlantInputs) -> Truth;

    /// The whole memory; unused places are zero.
    fn memory(&self) -> [f64; MODEL_MEMORY_LEN];

    /// Takes over a memory of the same kind of model, bit for bit. `None`, and no change, if it is
    /// not one.
    fn restore(&mut self, memory: &[f64; MODEL_MEMORY_LEN]) -> Option<()>;
}
