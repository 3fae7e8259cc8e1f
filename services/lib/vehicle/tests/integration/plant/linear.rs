//! The paper's linear plant against the solution of its equations and the nonlinear plant.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use super::common::{DT, airborne, hover, no_drag, rotors, run};
use nalgebra::Vector3;
use vehicle::{
    Actuation, LinearModel, NonlinearModel, PlantInputs, PlantModel, RigidBodyState, StepStatus,
    VehicleParameters, Wrench, euler_rate_matrix, quaternion_from_euler,
};

fn held(thrust_n: f64, torque_b_nm: Vector3<f64>) -> PlantInputs {
    let wrench = Wrench { thrust_n, torque_b_nm };
    PlantInputs { actuation: Actuation::Wrench(wrench), ..rotors([0.0; 4]) }
}

fn linear() -> LinearModel {
    let vehicle = VehicleParameters::default();
    LinearModel::new(vehicle, &hover(&vehicle)).expect("the default vehicle is valid")
}

#[test]
fn one_long_step_is_the_exact_solution() {
    let mut model = linear();
    let torque = Vector3::new(2e-5, -3e-5, 4e-5);
    run(&mut model, &held(1.5, torque), 0.3, 1);
    let t = 0.3_f64;
    let accel = Vector3::new(0.2, -0.3, 0.2);
    assert!((model.euler_rad() - accel * (t * t / 2.0)).norm() < 1e-8);
    assert!((model.euler_rate_rad_s() - accel * t).norm() < 1e-7);
    // x⁗ = g θ̈ from rest, z̈ = T/m − g.
    let truth = model.truth(&held(1.5, torque));
    let expected = Vector3::new(
        9.81 * accel.y * t.powi(4) / 24.0,
        -9.81 * accel.x * t.powi(4) / 24.0,
        5.0 + (1.5 / 0.12 - 9.81) * t * t / 2.0,
    );
    assert!((truth.state.position_w - expected).norm() < 1e-8);
}

#[test]
fn cutting_a_step_into_pieces_changes_only_rounding() {
    let inputs = held(1.3, Vector3::new(0.01, 0.02, -0.005));
    let (mut whole, mut pieces) = (linear(), linear());
    run(&mut whole, &inputs, 0.02, 5);
    run(&mut pieces, &inputs, 0.001, 100);
    for (a, b) in whole.memory().iter().zip(pieces.memory()) {
        assert!((a - b).abs() < 1e-12);
    }
}

#[test]
fn it_agrees_with_the_nonlinear_plant_near_hover_to_second_order() {
    let vehicle = no_drag();
    let gap = |scale: f64| {
        let f = 0.25 * vehicle.weight_n();
        let thrusts = [f - scale, f + scale, f + 2.0 * scale, f - 2.0 * scale];
        let start = RigidBodyState { rotor_thrust_n: thrusts, ..hover(&vehicle) };
        let mut full = airborne(vehicle, start);
        let mut small = LinearModel::new(vehicle, &start).unwrap();
        run(&mut full, &rotors(thrusts), DT, 200);
        run(&mut small, &rotors(thrusts), DT, 200);
        let s = small.truth(&rotors(thrusts)).state;
        (full.state().position_w - s.position_w).norm() + full.state().q_wb.angle_to(&s.q_wb)
    };
    let (large, small) = (gap(2e-3), gap(1e-3));
    assert!(small > 0.0 && (3.5..4.6).contains(&(large / small)), "{large} {small}");
}

#[test]
fn the_body_rate_it_shows_gives_back_its_euler_rate() {
    let vehicle = VehicleParameters::default();
    let start = RigidBodyState {
        q_wb: quaternion_from_euler(&Vector3::new(0.3, -0.5, 0.8)),
        omega_b: Vector3::new(1.0, -2.0, 0.5),
        ..hover(&vehicle)
    };
    let mut model = LinearModel::new(vehicle, &start).unwrap();
    let inputs = held(1.2, Vector3::new(1e-3, -2e-3, 1e-3));
    let h = 1e-5;
    let omega_before = model.truth(&inputs).state.omega_b;
    run(&mut model, &inputs, h, 1);
    let truth = model.truth(&inputs);
    run(&mut model, &inputs, h, 1);
    let omega_after = model.truth(&inputs).state.omega_b;
    let difference = (omega_after - omega_before) / (2.0 * h);
    assert!((truth.angular_acceleration_b_rad_s2 - difference).norm() < 1e-6);
    let gamma = model.euler_rad();
    let rate = euler_rate_matrix(&gamma).unwrap() * omega_after;
    assert!((rate - model.euler_rate_rad_s()).norm() < 1e-13);
}

#[test]
fn a_restored_model_continues_bit_for_bit_and_nan_is_refused() {
    let inputs = held(1.2, Vector3::new(1e-3, -2e-3, 1e-3));
    let mut first = linear();
    run(&mut first, &PlantInputs { morph_command_rad: 2.0, ..inputs }, DT, 20);
    let mut second = linear();
    assert_eq!(second.restore(&first.memory()), Some(()));
    run(&mut first, &inputs, DT, 20);
    run(&mut second, &inputs, DT, 20);
    assert_eq!(first.memory().map(f64::to_bits), second.memory().map(f64::to_bits));
    assert_eq!(first.step(DT, &held(f64::NAN, Vector3::zeros())), StepStatus::BadInput);
    assert_eq!(first.memory().map(f64::to_bits), second.memory().map(f64::to_bits));
}

#[test]
fn a_plant_does_not_start_from_a_broken_state() {
    let vehicle = VehicleParameters::default();
    let steep = quaternion_from_euler(&Vector3::new(0.0, 1.3, 0.0));
    let start = RigidBodyState { q_wb: steep, ..hover(&vehicle) };
    assert_eq!(LinearModel::new(vehicle, &start).unwrap_err().name, "initial_pitch_rad");
    let nowhere = RigidBodyState { position_w: Vector3::repeat(f64::NAN), ..hover(&vehicle) };
    assert_eq!(LinearModel::new(vehicle, &nowhere).unwrap_err().name, "initial_state");
    let nonlinear = NonlinearModel::new(vehicle, None, nowhere);
    assert_eq!(nonlinear.unwrap_err().name, "initial_state");
}
