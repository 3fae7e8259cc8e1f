//! What changes with the morph angle and the thrust: model, weights, bounds.

use mpc::{
    Bounds, Horizon, IncrementalMpc, LaggedAxis, Measured, Model, Move, MpcError, Weights,
    double_integrator, lagged_double_integrator,
};
use nalgebra::{SVector, Vector3};
use vehicle::{MorphAngle, VehicleParameters};

use crate::config::{AttitudeLawConfig, TorqueBound};

/// The full state x = \[γ, γ̇, τ, u(k−1)\] of the flight model.
pub(crate) type State = SVector<f64, 12>;

/// The prediction engine, of the size its model needs.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one per law, and it is never moved")]
pub(crate) enum Engine {
    /// (8) as printed: x = \[γ, γ̇\].
    Bare(IncrementalMpc<6, 3, 3>),
    /// With rotor lag and command delay: x = \[γ, γ̇, τ, u(k−1)\].
    Lagged(IncrementalMpc<12, 3, 3>),
}

impl Engine {
    pub(crate) fn new(config: &AttitudeLawConfig, horizon: Horizon) -> Result<Self, MpcError> {
        if config.rotor_lag_s > 0.0 || config.command_delay_s > 0.0 {
            Ok(Self::Lagged(IncrementalMpc::new(horizon, config.solver)?))
        } else {
            Ok(Self::Bare(IncrementalMpc::new(horizon, config.solver)?))
        }
    }

    /// Model and weights at `beta`, if it moved by more than the tolerance.
    pub(crate) fn schedule(
        &mut self,
        config: &AttitudeLawConfig,
        vehicle: &VehicleParameters,
        beta: MorphAngle,
    ) {
        let inertia = vehicle.inertia_kg_m2(beta);
        let weights = || Weights::on_increments(increment_weight(config, &inertia));
        let tolerance = config.rebuild_tolerance_rad;
        match self {
            Self::Bare(mpc) => mpc.schedule(beta.rad(), tolerance, |_| {
                (double_integrator(&inertia.map(|i| 1.0 / i), config.period_s()), weights())
            }),
            Self::Lagged(mpc) => {
                mpc.schedule(beta.rad(), tolerance, |_| (lagged(config, &inertia), weights()))
            }
        };
    }

    pub(crate) fn step(
        &mut self,
        now: &Measured<12, 3, 3>,
        reference: impl Fn(usize) -> Vector3<f64>,
        bounds: &Bounds<3>,
    ) -> Move<3> {
        match self {
            Self::Bare(mpc) => {
                let Measured { state_increment, output, u_previous } = *now;
                let state_increment = state_increment.fixed_rows::<6>(0).into_owned();
                mpc.step(&Measured { state_increment, output, u_previous }, reference, bounds)
            }
            Self::Lagged(mpc) => mpc.step(now, reference, bounds),
        }
    }

    pub(crate) fn scheduled(&self) -> Option<f64> {
        match self {
            Self::Bare(mpc) => mpc.scheduled(),
            Self::Lagged(mpc) => mpc.scheduled(),
        }
    }

    pub(crate) fn working_set(&self) -> &[i8] {
        match self {
            Self::Bare(mpc) => mpc.working_set(),
            Self::Lagged(mpc) => mpc.working_set(),
        }
    }

    /// Forgets the schedule and takes the leading part of `set`.
    pub(crate) fn restore(&mut self, set: &[i8]) -> Result<(), MpcError> {
        let length = self.working_set().len();
        match self {
            Self::Bare(mpc) => {
                mpc.forget_schedule();
                mpc.set_working_set(&set[..length])
            }
            Self::Lagged(mpc) => {
                mpc.forget_schedule();
                mpc.set_working_set(&set[..length])
            }
        }
    }
}

/// The actuator of every axis; its gain is left to [`lagged`].
pub(crate) fn actuator(config: &AttitudeLawConfig) -> LaggedAxis {
    LaggedAxis { gain: 1.0, lag_s: config.rotor_lag_s, delay_s: config.command_delay_s }
}

fn lagged(config: &AttitudeLawConfig, inertia: &Vector3<f64>) -> Model<12, 3, 3> {
    let axes = [0, 1, 2].map(|i| LaggedAxis { gain: 1.0 / inertia[i], ..actuator(config) });
    lagged_double_integrator(&axes, config.period_s())
}

/// Diagonal of W.
fn increment_weight(config: &AttitudeLawConfig, inertia: &Vector3<f64>) -> Vector3<f64> {
    let scale = if config.scale_weight_with_inertia {
        AttitudeLawConfig::REFERENCE_INERTIA_KG_M2 / inertia.x
    } else {
        1.0
    };
    let weight = config.increment_weight * scale * scale;
    Vector3::new(weight, weight, weight * config.yaw_weight_factor)
}

/// Bounds at `beta` and `thrust` \[N\]; the increment bound equals the level bound.
pub(crate) fn bounds(
    config: &AttitudeLawConfig,
    vehicle: &VehicleParameters,
    beta: MorphAngle,
    thrust: f64,
) -> Bounds<3> {
    let weight = vehicle.weight_n();
    let full = weight * vehicle.geometry.arm_length_m(beta);
    let u_max = match config.torque_bound {
        TorqueBound::Rotors => {
            let tilt = full * (0.5 * thrust / weight).min(0.5);
            Vector3::new(tilt, tilt, vehicle.yaw_coefficient_m * weight)
        }
        TorqueBound::Paper => Vector3::new(full, full, 2.0 * full),
    };
    Bounds::symmetric(u_max, u_max)
}
