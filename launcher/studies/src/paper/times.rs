//! How long a step of the law takes on this machine.

use super::PaperError;
use super::rig::{Experiment, World};
use attitude_mpc::{AttitudeLaw, Input, Setpoint};
use runtime::clock::mono_now_ns;
use vehicle::VehicleParameters;

/// Times a law goes through the same flight; the paper repeated five times.
const REPETITIONS: usize = 25;

/// Time of one step of a law \[µs\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StepTime {
    /// Least over the repetitions of the mean of a flight.
    pub(super) least_us: f64,
    /// Median over the repetitions of that mean.
    pub(super) median_us: f64,
    /// Largest single step, each at its best repetition.
    pub(super) worst_step_us: f64,
}

/// Flies `experiment` once for its inputs, then times the law on them again and again.
pub(super) fn step_time(experiment: &Experiment) -> Result<StepTime, PaperError> {
    debug_assert!(experiment.world == World::Linear);
    let vehicle = VehicleParameters::default();
    let flown = experiment.run()?;
    let inputs: Vec<Input> = flown
        .samples
        .iter()
        .map(|sample| Input {
            gamma_rad: sample.gamma_rad,
            body_rate_rad_s: sample.body_rate_rad_s,
            age_s: 0.0,
            morph_angle: experiment.morph_angle,
            setpoint: Setpoint { gamma_rad: experiment.target_rad, thrust_n: vehicle.weight_n() },
            applied_torque_nm: Some(sample.previous_nm),
        })
        .collect();
    let mut best = vec![u64::MAX; inputs.len()];
    let mut means = Vec::with_capacity(REPETITIONS);
    for _ in 0..REPETITIONS {
        let mut law = AttitudeLaw::new(experiment.law, &vehicle)?;
        let mut sum: u64 = 0;
        for (input, best) in inputs.iter().zip(&mut best) {
            let start_ns = mono_now_ns();
            std::hint::black_box(law.step(std::hint::black_box(input)));
            let taken_ns = mono_now_ns() - start_ns;
            *best = taken_ns.min(*best);
            sum += taken_ns;
        }
        means.push(sum as f64 * 1e-3 / inputs.len().max(1) as f64);
    }
    means.sort_by(f64::total_cmp);
    let worst_ns = best.iter().max().copied().unwrap_or(0);
    Ok(StepTime {
        least_us: means[0],
        median_us: means[REPETITIONS / 2],
        worst_step_us: worst_ns as f64 * 1e-3,
    })
}
