//! Designs and samples that the tests share.
#![allow(dead_code, reason = "each test file uses its own part")]

pub(crate) mod exponential;

use mpc::{
    AxisDesign, Basis, Bounds, Constraints, Coupled, Design, Horizon, IncrementalMpc, Limits,
    Measured, Operating, SolverKind,
};
use nalgebra::{SVector, Vector3};

pub(crate) const HORIZON: Horizon = Horizon { prediction: 20, control: 3 };

/// Three lagged axes with delay at 100 Hz, weighed differently.
pub(crate) fn design(horizon: Horizon) -> Design<3> {
    let axis = |lag_s, output_weight, terminal_factor| AxisDesign {
        lag_s,
        delay_s: 0.001,
        drag_per_s: 0.0,
        basis: Basis::pulses(horizon.control),
        output_weight,
        terminal_factor,
    };
    Design {
        horizon,
        period_s: 0.01,
        axes: [axis(0.015, 1.0, 1.0), axis(0.0, 2.5, 4.0), axis(0.03, 0.7, 1.0)],
        constraints: Constraints::PAPER,
    }
}

/// The paper's three double integrators.
pub(crate) fn bare(horizon: Horizon) -> Design<3> {
    let axis = AxisDesign {
        lag_s: 0.0,
        delay_s: 0.0,
        drag_per_s: 0.0,
        basis: Basis::pulses(horizon.control),
        output_weight: 1.0,
        terminal_factor: 1.0,
    };
    Design { axes: [axis; 3], ..design(horizon) }
}

pub(crate) fn engine(design: &Design<3>) -> IncrementalMpc<3> {
    IncrementalMpc::new(design, SolverKind::ActiveSet).unwrap()
}

pub(crate) fn operating() -> Operating<3> {
    Operating { gain: Vector3::new(1e4, 2e3, -5e3), weight: Vector3::new(0.25, 0.1, 3.0) }
}

pub(crate) fn symmetric(gain: f64) -> Operating<3> {
    Operating { gain: Vector3::repeat(gain), weight: Vector3::repeat(0.25) }
}

pub(crate) fn resting() -> Measured<3> {
    let zero = SVector::zeros();
    Measured {
        output: zero,
        output_increment: zero,
        rate: zero,
        rate_increment: zero,
        actuator_increment: zero,
        input_increment: zero,
        u_previous: zero,
    }
}

pub(crate) fn moving() -> Measured<3> {
    Measured {
        output: Vector3::new(0.02, -0.1, 0.3),
        output_increment: Vector3::new(0.01, 0.003, -0.02),
        rate: Vector3::new(1.0, 0.3, -2.0),
        rate_increment: Vector3::new(0.4, -0.2, 0.1),
        actuator_increment: Vector3::new(1e-3, -2e-3, 4e-3),
        input_increment: Vector3::new(2e-3, 1e-3, -3e-3),
        u_previous: Vector3::new(0.02, -0.03, 0.01),
    }
}

pub(crate) fn boxes(level: f64, increment: f64) -> Limits<'static, 3> {
    let endless = Vector3::repeat(f64::INFINITY);
    Limits {
        inputs: Bounds::symmetric(Vector3::repeat(level), Vector3::repeat(increment)),
        coupled: Coupled::NONE,
        output_min: -endless,
        output_max: endless,
        rate_max: endless,
    }
}
