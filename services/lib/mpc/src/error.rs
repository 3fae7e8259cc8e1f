//! What a wrong set-up is told.

/// A configuration the engine refuses, with the offending values and the remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MpcError {
    /// The control horizon is empty or longer than the prediction horizon.
    #[error("control horizon {control} must lie in 1..={prediction} (the prediction horizon)")]
    ControlHorizon {
        /// Nc as given, in samples.
        control: usize,
        /// Np as given, in samples.
        prediction: usize,
    },
    /// The prediction horizon exceeds what the engine is tested for.
    #[error("prediction horizon {prediction} exceeds {limit}: lower the rate or the horizon")]
    PredictionHorizon {
        /// Np as given, in samples.
        prediction: usize,
        /// Largest Np accepted.
        limit: usize,
    },
    /// A parameter is not finite or outside its range.
    #[error("{name} = {value} must be {range}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted, in words.
        range: &'static str,
    },
    /// The solver refused its set-up.
    #[error(transparent)]
    Solver(#[from] qp::QpError),
}
