//! What changes with the morph angle and the thrust: units, gains, weights, limits.

use mpc::{
    AxisDesign, Basis, Bounds, Constraints, Coupled, Design, Hardness, LaggedAxis, Limits,
    Operating,
};
use nalgebra::Vector3;
use vehicle::{MorphAngle, VehicleParameters};

use crate::config::{AttitudeLawConfig, ConfigError, TorqueBound};

/// Rotor thrusts beside T/4 by the shares (τx/2L, τy/2L, τz/4k): M⁻¹ of (1).
static SHARES: [[f64; 3]; 4] =
    [[0.0, -1.0, -1.0], [1.0, 0.0, 1.0], [0.0, 1.0, -1.0], [-1.0, 0.0, 1.0]];

/// The actuator of every axis, its gain left to the schedule.
pub(crate) fn actuator(config: &AttitudeLawConfig) -> LaggedAxis {
    LaggedAxis {
        gain: 1.0,
        lag_s: config.rotor_lag_s,
        delay_s: config.command_delay_s,
        drag_per_s: 0.0,
    }
}

/// What the engine is built from.
pub(crate) fn design(config: &AttitudeLawConfig) -> Result<Design<3>, ConfigError> {
    let horizon = config.horizon.samples(config.rate_hz)?;
    let pulses = [Basis::pulses(horizon.control); 3];
    let axes = core::array::from_fn(|i| AxisDesign {
        lag_s: config.rotor_lag_s,
        delay_s: config.command_delay_s,
        drag_per_s: 0.0,
        basis: config.laguerre.unwrap_or(pulses)[i],
        output_weight: config.output_weight[i],
        terminal_factor: config.terminal_factor,
    });
    let hardness =
        |penalty: Option<f64>| penalty.map_or(Hardness::Hard, |penalty| Hardness::Soft { penalty });
    let level = hardness(config.level_penalty);
    let by_rotor = config.torque_bound == TorqueBound::RotorThrusts;
    let constraints = Constraints {
        levels: (!by_rotor).then_some(level),
        increments: config.increment_bound.then(|| hardness(config.increment_penalty)),
        coupled: by_rotor.then_some((&SHARES, level)),
        outputs: config.angle_max_rad.map(|_| hardness(config.state_penalty)),
        rates: config.rate_max_rad_s.map(|_| hardness(config.state_penalty)),
    };
    let design = Design { horizon, period_s: config.period_s(), axes, constraints };
    design.horizon.check()?;
    Ok(design.bounded_while_moving())
}

/// The engine's unit of torque \[N m\].
///
/// Against bounds on torques it is the inertia: the gain is then 1 at every size, and with weights
/// that scale with the inertia no matrix ever changes. Against bounds on rotors it is the torque
/// per newton of thrust, so that the rows stay.
pub(crate) fn unit(
    config: &AttitudeLawConfig,
    vehicle: &VehicleParameters,
    beta: MorphAngle,
) -> Vector3<f64> {
    match config.torque_bound {
        TorqueBound::RotorThrusts => {
            let arms = 2.0 * vehicle.geometry.arm_length_m(beta);
            Vector3::new(arms, arms, 4.0 * vehicle.yaw_coefficient_m)
        }
        TorqueBound::Rotors | TorqueBound::Paper => vehicle.inertia_kg_m2(beta),
    }
}

/// Gains and weights for `unit` at `beta`.
pub(crate) fn operating(
    config: &AttitudeLawConfig,
    vehicle: &VehicleParameters,
    beta: MorphAngle,
    unit: &Vector3<f64>,
) -> Operating<3> {
    let inertia = vehicle.inertia_kg_m2(beta);
    let scaled = if config.scale_weight_with_inertia {
        // In this order the quotient of two inertias comes first, which stays the same.
        unit / inertia.x * AttitudeLawConfig::REFERENCE_INERTIA_KG_M2
    } else {
        *unit
    };
    let factors = Vector3::new(1.0, config.pitch_weight_factor, config.yaw_weight_factor);
    Operating {
        gain: unit.component_div(&inertia),
        weight: scaled.component_mul(&scaled).component_mul(&factors) * config.increment_weight,
    }
}

/// Bounds on torque and its increment \[N m\] at `beta` and `thrust` \[N\]; the increment bound
/// equals the level bound.
pub(crate) fn torque_bounds(
    config: &AttitudeLawConfig,
    vehicle: &VehicleParameters,
    beta: MorphAngle,
    thrust: f64,
) -> Vector3<f64> {
    let weight = vehicle.weight_n();
    let arm = vehicle.geometry.arm_length_m(beta);
    match config.torque_bound {
        TorqueBound::Rotors => vehicle.torque_bound_nm(beta, thrust),
        TorqueBound::Paper => Vector3::new(1.0, 1.0, 2.0) * (weight * arm),
        TorqueBound::RotorThrusts => {
            // The box around what four rotors can give beside `thrust`.
            let spare = thrust.min(4.0 * vehicle.rotor_thrust_max_n - thrust).max(0.0);
            let tilt = arm * spare.min(vehicle.rotor_thrust_max_n);
            Vector3::new(tilt, tilt, vehicle.yaw_coefficient_m * spare)
        }
    }
}

/// Numbers behind the limits of one step, in engine units.
pub(crate) struct StepLimits {
    inputs: Bounds<3>,
    lower: [f64; 4],
    upper: [f64; 4],
    angle_max: Vector3<f64>,
    rate_max: Vector3<f64>,
}

impl StepLimits {
    pub(crate) fn new(
        config: &AttitudeLawConfig,
        vehicle: &VehicleParameters,
        bound: &Vector3<f64>,
        unit: &Vector3<f64>,
        thrust: f64,
    ) -> Self {
        let level = bound.component_div(unit);
        let share = 0.25 * thrust;
        let angle = config.angle_max_rad.unwrap_or(f64::INFINITY);
        let rate = config.rate_max_rad_s.unwrap_or(f64::INFINITY);
        Self {
            inputs: Bounds::symmetric(level, level),
            lower: [-share; 4],
            upper: [vehicle.rotor_thrust_max_n - share; 4],
            // A heading has no bound: its zero is arbitrary.
            angle_max: Vector3::new(angle, angle, f64::INFINITY),
            rate_max: Vector3::repeat(rate),
        }
    }

    pub(crate) fn limits(&self, config: &AttitudeLawConfig) -> Limits<'_, 3> {
        let coupled = if config.torque_bound == TorqueBound::RotorThrusts {
            Coupled { normals: &SHARES, lower: &self.lower, upper: &self.upper }
        } else {
            Coupled::NONE
        };
        Limits {
            inputs: self.inputs,
            coupled,
            output_min: -self.angle_max,
            output_max: self.angle_max,
            rate_max: self.rate_max,
        }
    }
}
