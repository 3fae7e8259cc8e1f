//! The errors of a wrong set-up.

/// A configuration that is refused, with the offending values and the remedy.
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
    /// The control horizon exceeds what the engine is tested for.
    #[error(
        "control horizon {control} exceeds {limit}: lower it or use blocks or Laguerre functions"
    )]
    ControlLimit {
        /// Nc as given, in samples.
        control: usize,
        /// Largest Nc accepted.
        limit: usize,
    },
    /// A Laguerre pole that does not decay.
    #[error("laguerre_pole = {pole} must lie in 0..1, 1 excluded; 0 is the classic form")]
    Pole {
        /// a as given.
        pole: f64,
    },
    /// An empty or an oversized Laguerre basis.
    #[error("laguerre_terms = {terms} must lie in 1..={limit}")]
    Terms {
        /// N as given.
        terms: usize,
        /// Largest N accepted.
        limit: usize,
    },
    /// No blocks of moves, or more than there are samples for them.
    #[error("control_blocks = {terms} must lie in 1..={limit}")]
    Blocks {
        /// N as given.
        terms: usize,
        /// Largest N accepted.
        limit: usize,
    },
    /// More constraint rows than a published working set has room for.
    #[error("{rows} constraint rows exceed {limit}: shorten a horizon or drop a constraint set")]
    Rows {
        /// Rows of the program.
        rows: usize,
        /// Largest number accepted.
        limit: usize,
    },
    /// A number outside its range, or not a number.
    #[error("{name} = {value} must lie in {least}..={most}")]
    OutOfRange {
        /// The parameter.
        name: &'static str,
        value: f64,
        /// Least value accepted.
        least: f64,
        /// Largest value accepted.
        most: f64,
    },
    /// The solver refused its set-up.
    #[error(transparent)]
    Solver(#[from] qp::QpError),
}

/// `Ok` if `value` lies in `least..=most`; NaN lies nowhere.
///
/// # Errors
/// [`MpcError::OutOfRange`] with the name and all numbers.
pub fn within(name: &'static str, value: f64, least: f64, most: f64) -> Result<(), MpcError> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(MpcError::OutOfRange { name, value, least, most })
    }
}
