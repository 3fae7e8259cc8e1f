//! What loops make of their inputs and of their rate.

use mpc::QpStatus;
use nalgebra::Vector3;
use shared_types::{Sample, SolveStatus, StateEstimate};
use vehicle::{euler_from_quaternion, rotation};

/// γ = (φ, θ, ψ) of an estimate \[rad\], intrinsic z-y-x.
#[must_use]
pub fn gamma_rad(estimate: &StateEstimate) -> Vector3<f64> {
    euler_from_quaternion(&rotation(estimate.q_wb.to_array()))
}

/// Time since the instant that a sample describes \[s\].
#[must_use]
pub fn age_s(sample: &impl Sample, now_ns: u64) -> f64 {
    now_ns.saturating_sub(sample.described_ns()) as f64 * 1e-9
}

/// Period of a positive rate, rounded up \[ns\].
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
pub fn period_ns(rate_hz: f64) -> u64 {
    (1e9 / rate_hz).ceil() as u64
}

/// How a report calls the reason for a fallback.
#[must_use]
pub fn fallback_status(status: QpStatus) -> SolveStatus {
    match status {
        QpStatus::Infeasible => SolveStatus::Infeasible,
        QpStatus::NotFinite => SolveStatus::NotFinite,
        _ => SolveStatus::IterationLimit,
    }
}
