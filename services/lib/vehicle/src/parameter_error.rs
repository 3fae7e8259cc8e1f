//! What is wrong with a parameter.

use thiserror::Error;

/// A parameter that no vehicle can have.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{name} = {value} is not usable: {remedy}")]
pub struct ParameterError {
    /// The parameter's name, as spelled in [`VehicleParameters`](crate::VehicleParameters) or the geometry law.
    pub name: &'static str,
    /// The refused value, in the unit its name ends with.
    pub value: f64,
    /// What to write instead.
    pub remedy: &'static str,
}

/// `Ok` for a finite number above zero; NaN is neither.
pub(crate) fn positive(
    name: &'static str,
    value: f64,
    remedy: &'static str,
) -> Result<(), ParameterError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(ParameterError { name, value, remedy })
    }
}
