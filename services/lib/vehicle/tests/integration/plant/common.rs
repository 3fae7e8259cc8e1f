//! Shared by the plant tests.

use nalgebra::Vector3;
use vehicle::{
    Actuation, Disturbance, Geometry, MorphAngle, NonlinearModel, PlantInputs, PlantModel,
    Quadratic, RigidBodyState, StepStatus, VehicleParameters,
};

pub(crate) const DT: f64 = 1e-3;

/// The default vehicle in a vacuum.
pub(crate) fn no_drag() -> VehicleParameters {
    VehicleParameters { drag_n_s_m: 0.0, ..VehicleParameters::default() }
}

/// Three different principal inertias that do not depend on β.
pub(crate) fn asymmetric() -> VehicleParameters {
    let geometry = Geometry {
        inertia_xx_kg_m2: Quadratic::constant(1e-4),
        inertia_yy_kg_m2: Quadratic::constant(2e-4),
        inertia_zz_kg_m2: Quadratic::constant(2.7e-4),
        ..Geometry::default()
    };
    VehicleParameters { geometry, ..no_drag() }
}

/// In the air, level, at rest, at the smallest size, rotors at hover.
pub(crate) fn hover(parameters: &VehicleParameters) -> RigidBodyState {
    RigidBodyState::hover(parameters, Vector3::new(0.0, 0.0, 5.0), MorphAngle::MIN)
}

/// As [`hover`] with the rotors off.
pub(crate) fn falling(parameters: &VehicleParameters) -> RigidBodyState {
    RigidBodyState { rotor_thrust_n: [0.0; 4], ..hover(parameters) }
}

/// Held thrusts, the smallest size, calm air.
pub(crate) fn rotors(thrusts: [f64; 4]) -> PlantInputs {
    PlantInputs {
        actuation: Actuation::Rotors(thrusts),
        morph_command_rad: MorphAngle::MIN.rad(),
        disturbance: Disturbance::default(),
    }
}

/// Without ground, at `state`.
pub(crate) fn airborne(parameters: VehicleParameters, state: RigidBodyState) -> NonlinearModel {
    NonlinearModel::new(parameters, None, state).expect("the tests' vehicles are valid")
}

/// `steps` steps of `dt`, each of which must succeed.
pub(crate) fn run(model: &mut dyn PlantModel, inputs: &PlantInputs, dt: f64, steps: u32) {
    for _ in 0..steps {
        assert_eq!(model.step(dt, inputs), StepStatus::Advanced);
    }
}
