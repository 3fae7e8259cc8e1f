//! Prediction model, weights and bounds, all constant: the translation does not see the morph.

use mpc::{Bounds, LaggedAxis, Model, Weights, lagged_double_integrator};
use nalgebra::Vector3;
use vehicle::VehicleParameters;

use crate::config::PositionLawConfig;

/// The axes x, y, z with the actuators θ₀, φ₀, T: (3) corrected, ẍ = g θ, ÿ = −g φ, z̈ = T/m − g.
///
/// Gravity drops out of the increments. The tilt stands behind the attitude loop, here a lag and
/// a delay, the thrust behind the rotors; without them the outer loop overshoots.
pub(crate) fn axes(config: &PositionLawConfig, vehicle: &VehicleParameters) -> [LaggedAxis; 3] {
    let tilt = |gain| LaggedAxis { gain, lag_s: config.tilt_lag_s, delay_s: config.tilt_delay_s };
    [
        tilt(vehicle.gravity_m_s2),
        tilt(-vehicle.gravity_m_s2),
        LaggedAxis {
            gain: 1.0 / vehicle.mass_kg,
            lag_s: config.thrust_lag_s,
            delay_s: config.thrust_delay_s,
        },
    ]
}

pub(crate) fn model(
    config: &PositionLawConfig,
    vehicle: &VehicleParameters,
) -> (Model<12, 3, 3>, Weights<3, 3>) {
    let weight = Vector3::new(config.tilt_weight, config.tilt_weight, config.thrust_weight);
    let model = lagged_double_integrator(&axes(config, vehicle), config.period_s());
    (model, Weights::on_increments(weight))
}

pub(crate) fn bounds(config: &PositionLawConfig, vehicle: &VehicleParameters) -> Bounds<3> {
    let (tilt, step, weight) = (config.tilt_max_rad, config.tilt_step_max_rad, vehicle.weight_n());
    Bounds {
        u_min: Vector3::new(-tilt, -tilt, config.thrust_min_weights * weight),
        u_max: Vector3::new(tilt, tilt, config.thrust_max_weights * weight),
        du_max: Vector3::new(step, step, config.thrust_step_max_weights * weight),
    }
}
