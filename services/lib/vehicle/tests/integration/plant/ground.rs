//! The vehicle on the ground.

use super::common::{DT, airborne, hover, no_drag, rotors, run};
use nalgebra::Vector3;
use vehicle::{
    Disturbance, GroundContact, MAX_NONLINEAR_STEP_S, MorphAngle, NonlinearModel, PlantInputs,
    PlantModel, RigidBodyState, VehicleParameters,
};

fn parked() -> RigidBodyState {
    let vehicle = VehicleParameters::default();
    let at_rest = RigidBodyState::hover(&vehicle, Vector3::zeros(), MorphAngle::MIN);
    RigidBodyState { rotor_thrust_n: [0.0; 4], ..at_rest }
}

fn on_ground(vehicle: VehicleParameters, state: RigidBodyState) -> NonlinearModel {
    let ground = Some(GroundContact::default());
    NonlinearModel::new(vehicle, ground, state).expect("the tests' vehicles are valid")
}

#[test]
fn a_parked_vehicle_stays_where_it_is() {
    let mut model = on_ground(VehicleParameters::default(), parked());
    run(&mut model, &rotors([0.0; 4]), DT, 5000);
    assert!(model.state().position_w.norm() < 1e-14);
    assert!(model.state().velocity_w.norm() < 1e-14);
    assert!(model.state().q_wb.angle() < 1e-14);
    // The ground carries it: an accelerometer reads g.
    let truth = model.truth(&rotors([0.0; 4]));
    assert!((truth.specific_force_b_m_s2 - Vector3::new(0.0, 0.0, 9.81)).norm() < 1e-12);
}

#[test]
fn a_dropped_and_tilted_vehicle_comes_to_rest_level_on_the_ground() {
    // Up to the longest step, which the contact must survive.
    for (beta, dt, steps) in [
        (MorphAngle::MIN, DT, 4000),
        (MorphAngle::MAX, DT, 4000),
        (MorphAngle::MIN, MAX_NONLINEAR_STEP_S, 2000),
    ] {
        let start = RigidBodyState {
            position_w: Vector3::new(0.0, 0.0, 0.4),
            velocity_w: Vector3::new(0.8, 0.0, 0.0),
            omega_b: Vector3::new(0.5, -0.3, 1.0),
            beta,
            ..parked()
        };
        let mut model = on_ground(VehicleParameters::default(), start);
        let inputs = PlantInputs { morph_command_rad: beta.rad(), ..rotors([0.0; 4]) };
        run(&mut model, &inputs, dt, steps);
        let s = model.state();
        assert!(s.position_w.z.abs() < 1e-9);
        assert!(s.velocity_w.norm() < 1e-9 && s.omega_b.norm() < 1e-9);
        assert!((s.q_wb * Vector3::z() - Vector3::z()).norm() < 1e-9);
    }
}

#[test]
fn a_slide_ends_after_the_distance_of_coulomb_friction() {
    let start = RigidBodyState { velocity_w: Vector3::new(1.0, 0.0, 0.0), ..parked() };
    let mut model = on_ground(no_drag(), start);
    run(&mut model, &rotors([0.0; 4]), DT, 2000);
    let coulomb = 1.0 / (2.0 * 0.6 * 9.81);
    // The finite slope below 44 mm/s adds about v²/(2 μ g), 0.2 % here.
    assert!((model.state().position_w.x / coulomb - 1.0).abs() < 0.01);
    assert!(model.state().velocity_w.norm() < 1e-6);
}

#[test]
fn thrust_above_the_weight_lifts_off() {
    let weight = VehicleParameters::default().weight_n();
    let mut model = on_ground(VehicleParameters::default(), parked());
    run(&mut model, &rotors([0.24 * weight; 4]), DT, 1000);
    assert!(model.state().position_w.z < 1e-3);
    run(&mut model, &rotors([0.35 * weight; 4]), DT, 1000);
    assert!(model.state().position_w.z > 1.0);
}

#[test]
fn the_ground_is_not_felt_in_the_air_and_can_be_switched_off() {
    let vehicle = VehicleParameters::default();
    let mut over_ground = on_ground(vehicle, hover(&vehicle));
    let mut over_nothing = airborne(vehicle, hover(&vehicle));
    let force_w_n = Vector3::new(0.1, 0.2, -0.1);
    let disturbance = Disturbance { force_w_n, ..Disturbance::default() };
    let inputs = PlantInputs { disturbance, ..rotors([0.29; 4]) };
    run(&mut over_ground, &inputs, DT, 500);
    run(&mut over_nothing, &inputs, DT, 500);
    assert_eq!(over_ground.memory().map(f64::to_bits), over_nothing.memory().map(f64::to_bits));
    run(&mut over_nothing, &rotors([0.0; 4]), DT, 2000);
    assert!(over_nothing.state().position_w.z < -1.0);
}
