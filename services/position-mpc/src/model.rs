//! Prediction model, weights and limits, all constant: the translation does not see the morph.

use mpc::{
    AxisDesign, Bounds, Constraints, Coupled, Design, Hardness, LaggedAxis, Limits, Operating,
};
use nalgebra::Vector3;
use vehicle::VehicleParameters;

use crate::cone::{self, TiltBound};
use crate::config::PositionLawConfig;
use crate::transport::Transport;

/// The transports of θ₀, φ₀ and T₀ to the vehicle. The tilt stands behind the attitude loop, here a lag and a delay, the thrust
/// behind the rotors; without them the outer loop overshoots.
/// The air slows the vehicle along all three axes alike.
pub(crate) fn transports(config: &PositionLawConfig, drag_per_s: f64) -> [Transport; 3] {
    let way = |lag_s: f64, delay_s| {
        // Behind an actuator that is nearly as slow as the drag itself the model has less of it.
        let drag_per_s = drag_per_s.min(LaggedAxis::drag_max_per_s(lag_s));
        let way = LaggedAxis { gain: 1.0, lag_s, delay_s, drag_per_s };
        Transport::new(way, config.period_s())
    };
    let tilt = way(config.tilt_lag_s, config.tilt_delay_s);
    let thrust = way(config.thrust_lag_s, config.thrust_delay_s);
    [tilt, tilt, thrust]
}

/// What the engine is built from: it predicts from the sample at which a command of now begins to act.
pub(crate) fn design(config: &PositionLawConfig, drag_per_s: f64) -> Design<3> {
    let transports = transports(config, drag_per_s);
    let axes = core::array::from_fn(|i| AxisDesign {
        lag_s: transports[i].axis.lag_s,
        delay_s: transports[i].axis.delay_s,
        drag_per_s: transports[i].axis.drag_per_s,
        basis: config.moves[i],
        output_weight: config.output_weight[i],
        terminal_factor: config.terminal_factor,
    });
    let hardness =
        |penalty: Option<f64>| penalty.map_or(Hardness::Hard, |penalty| Hardness::Soft { penalty });
    let constraints = Constraints {
        levels: Some(hardness(config.level_penalty)),
        increments: Some(hardness(config.increment_penalty)),
        coupled: (config.tilt_bound == TiltBound::Cone)
            .then_some((&cone::NORMALS[..], hardness(config.level_penalty))),
        rates: config.speed_max_m_s.map(|_| hardness(config.state_penalty)),
        ..Constraints::PAPER
    };
    Design { horizon: config.horizon, period_s: config.period_s(), axes, constraints }
        .bounded_while_moving()
}

/// The axes x, y, z with the actuators θ₀, φ₀, T₀: ẍ = g θ₀, ÿ = −g φ₀, z̈ = T₀/m − g, (3) for any tilt of a vehicle that is
/// carried. Gravity drops out of the increments.
pub(crate) fn operating(config: &PositionLawConfig, vehicle: &VehicleParameters) -> Operating<3> {
    let g = vehicle.gravity_m_s2;
    Operating {
        gain: Vector3::new(g, -g, 1.0 / vehicle.mass_kg),
        weight: Vector3::new(config.tilt_weight, config.tilt_weight, config.thrust_weight),
    }
}

/// Without the cone, which the law adds.
pub(crate) fn limits(
    config: &PositionLawConfig,
    vehicle: &VehicleParameters,
) -> Limits<'static, 3> {
    // A tangent moves by at least what its angle does, so that the bound on the change is kept as well.
    let (tilt, step) = (libm::tan(config.tilt_max_rad), config.tilt_step_max_rad);
    let weight = vehicle.weight_n();
    let endless = Vector3::repeat(f64::INFINITY);
    Limits {
        inputs: Bounds {
            u_min: Vector3::new(-tilt, -tilt, config.thrust_min_weights * weight),
            u_max: Vector3::new(tilt, tilt, config.thrust_max_weights * weight),
            du_max: Vector3::new(step, step, config.thrust_step_max_weights * weight),
        },
        coupled: Coupled::NONE,
        output_min: -endless,
        output_max: endless,
        rate_max: Vector3::repeat(config.speed_max_m_s.unwrap_or(f64::INFINITY)),
    }
}
