//! The nonlinear plant against closed forms and invariants.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use super::common::{DT, airborne, asymmetric, falling, hover, no_drag, rotors, run};
use nalgebra::{UnitQuaternion, Vector3};
use vehicle::{
    Disturbance, MorphAngle, NonlinearModel, PlantInputs, PlantModel, RigidBodyState, StepStatus,
    VehicleParameters, euler_rate_matrix, quaternion_from_euler,
};

/// Angular momentum in W \[kg m²/s\] of the present state.
fn momentum_w(model: &NonlinearModel) -> Vector3<f64> {
    let s = model.state();
    s.q_wb * model.parameters().inertia_kg_m2(s.beta).component_mul(&s.omega_b)
}

#[test]
fn a_free_fall_matches_the_closed_form() {
    let velocity_w = Vector3::new(1.0, -2.0, 3.0);
    let start = RigidBodyState { velocity_w, ..falling(&no_drag()) };
    let mut model = airborne(no_drag(), start);
    run(&mut model, &rotors([0.0; 4]), DT, 1000);
    let expected = start.position_w + velocity_w - Vector3::new(0.0, 0.0, 0.5 * 9.81);
    assert!((model.state().position_w - expected).norm() < 1e-12);
    assert!(model.truth(&rotors([0.0; 4])).specific_force_b_m_s2.norm() < 1e-14);
}

#[test]
fn a_spin_about_each_principal_axis_keeps_its_rate_and_turns_by_rate_times_time() {
    for axis in 0..3 {
        let mut omega_b = Vector3::zeros();
        omega_b[axis] = 6.0;
        let mut model = airborne(asymmetric(), RigidBodyState { omega_b, ..falling(&no_drag()) });
        run(&mut model, &rotors([0.0; 4]), DT, 1000);
        let expected = UnitQuaternion::from_scaled_axis(omega_b);
        assert!((model.state().omega_b - omega_b).norm() < 1e-14);
        // RK4 turns by ωh(1 − (ωh/2)⁴/120): 4e-12 rad after these thousand steps.
        assert!(model.state().q_wb.angle_to(&expected) < 1e-10);
        assert!(model.state().q_wb.w >= 0.0);
    }
}

#[test]
fn a_torque_free_tumble_conserves_energy_and_angular_momentum() {
    let omega_b = Vector3::new(3.0, 9.0, -4.0);
    let mut model = airborne(asymmetric(), RigidBodyState { omega_b, ..falling(&no_drag()) });
    let energy = |m: &NonlinearModel| {
        let omega = &m.state().omega_b;
        0.5 * m.parameters().inertia_kg_m2(MorphAngle::MIN).component_mul(omega).dot(omega)
    };
    let (momentum_0, energy_0) = (momentum_w(&model), energy(&model));
    run(&mut model, &rotors([0.0; 4]), DT, 2000);
    assert!((momentum_w(&model) - momentum_0).norm() < 1e-9 * momentum_0.norm());
    assert!((energy(&model) - energy_0).abs() < 1e-9 * energy_0);
    // It did tumble: no axis kept its rate.
    assert!((model.state().omega_b - omega_b).amin() > 0.1);
}

#[test]
fn morphing_while_spinning_conserves_angular_momentum() {
    for omega_b in [Vector3::new(0.0, 0.0, 8.0), Vector3::new(2.0, -3.0, 5.0)] {
        let mut model = airborne(no_drag(), RigidBodyState { omega_b, ..falling(&no_drag()) });
        let momentum_0 = momentum_w(&model);
        let grow = PlantInputs { morph_command_rad: 9.0, ..rotors([0.0; 4]) };
        run(&mut model, &grow, DT, 400);
        assert!(MorphAngle::MAX.rad() - model.state().beta.rad() < 1e-5);
        // One step straddles the knee of the servo's rate: there İ bends by 600 rad/s² dI/dβ and
        // a step of 1 ms misses a few 1e-6 of I.
        let drift = (momentum_w(&model) - momentum_0).norm() / momentum_0.norm();
        assert!(drift < 1e-5, "{drift}");
        // Six times the inertia, a sixth of the rate.
        assert!((model.state().omega_b.norm() * 6.0 / omega_b.norm() - 1.0).abs() < 1e-3);
    }
}

#[test]
fn a_morph_below_the_servo_limit_conserves_angular_momentum_to_fourth_order() {
    let drift = |dt: f64, steps: u32| {
        let omega_b = Vector3::new(2.0, -3.0, 5.0);
        let mut model = airborne(no_drag(), RigidBodyState { omega_b, ..falling(&no_drag()) });
        let momentum_0 = momentum_w(&model);
        let command = MorphAngle::MIN.rad() + 0.2;
        run(&mut model, &PlantInputs { morph_command_rad: command, ..rotors([0.0; 4]) }, dt, steps);
        (momentum_w(&model) - momentum_0).norm() / momentum_0.norm()
    };
    let (coarse, fine) = (drift(DT, 100), drift(0.5 * DT, 200));
    // İ/I starts at 40 1/s: (İ/I dt)⁵/120 over the 20 ms in which the servo moves.
    assert!(coarse < 1e-6, "{coarse}");
    assert!((14.0..19.0).contains(&(coarse / fine)), "{coarse} {fine}");
}

#[test]
fn hover_trim_is_an_equilibrium() {
    let vehicle = VehicleParameters::default();
    let start = hover(&vehicle);
    let inputs = rotors(start.rotor_thrust_n);
    let mut model = airborne(vehicle, start);
    run(&mut model, &inputs, DT, 5000);
    assert!((model.state().position_w - start.position_w).norm() < 1e-12);
    assert!(model.state().q_wb.angle() < 1e-14);
    let up = Vector3::new(0.0, 0.0, 9.81);
    assert!((model.truth(&inputs).specific_force_b_m_s2 - up).norm() < 1e-13);
}

#[test]
fn a_fall_with_drag_follows_the_exponential_to_terminal_velocity() {
    let vehicle = VehicleParameters { drag_n_s_m: 0.5, ..VehicleParameters::default() };
    let mut model = airborne(vehicle, falling(&vehicle));
    let terminal = 0.12 * 9.81 / 0.5;
    for second in 1..=4 {
        run(&mut model, &rotors([0.0; 4]), DT, 1000);
        let expected = -terminal * (1.0 - (-f64::from(second) * 0.5 / 0.12).exp());
        assert!((model.state().velocity_w.z - expected).abs() < 1e-11);
    }
    assert!((model.state().velocity_w.z + terminal).abs() < 1e-6);
}

#[test]
fn a_hovering_vehicle_is_carried_along_by_the_wind() {
    let vehicle = VehicleParameters::default();
    let start = hover(&vehicle);
    let wind_w_m_s = Vector3::new(1.5, -0.5, 0.2);
    let disturbance = Disturbance { wind_w_m_s, ..Disturbance::default() };
    let inputs = PlantInputs { disturbance, ..rotors(start.rotor_thrust_n) };
    let mut model = airborne(vehicle, start);
    run(&mut model, &inputs, DT, 1000);
    let expected = wind_w_m_s * (1.0 - (-0.05_f64 / 0.12).exp());
    assert!((model.state().velocity_w - expected).norm() < 1e-12);
}

#[test]
fn rotors_answer_a_step_with_their_lag_and_stop_at_their_limits() {
    let mut model = airborne(no_drag(), falling(&no_drag()));
    let f_max = no_drag().rotor_thrust_max_n;
    run(&mut model, &rotors([0.5, 100.0, -3.0, 0.0]), DT, 15);
    let share = 1.0 - (-1.0_f64).exp();
    let expected = [0.5 * share, f_max * share, 0.0, 0.0];
    for (thrust, expected) in model.state().rotor_thrust_n.iter().zip(expected) {
        assert!((thrust - expected).abs() < 1e-14);
    }
}

#[test]
fn a_weak_rotor_tilts_by_equation_1() {
    let vehicle = no_drag();
    let start = hover(&vehicle);
    let disturbance =
        Disturbance { rotor_efficiency: [1.0, 0.5, 1.0, 1.0], ..Disturbance::default() };
    let inputs = PlantInputs { disturbance, ..rotors(start.rotor_thrust_n) };
    let truth = airborne(vehicle, start).truth(&inputs);
    let lost = 0.125 * vehicle.weight_n();
    let torque = Vector3::new(-0.095 * lost, 0.0, -0.016 * lost);
    assert!((truth.wrench.torque_b_nm - torque).norm() < 1e-9);
    assert!((truth.acceleration_w_m_s2.z + lost / 0.12).abs() < 1e-12);
}

/// (2), (4) and (5) as printed, in Euler angles: rate of (p, v, γ, ω) under a held wrench.
fn printed_rate(x: &[Vector3<f64>; 4], inertia: &Vector3<f64>) -> [Vector3<f64>; 4] {
    let [_, v, gamma, omega] = x;
    let thrust = HELD.iter().sum::<f64>();
    let (sf, cf) = gamma.x.sin_cos();
    let (st, ct) = gamma.y.sin_cos();
    let (sp, cp) = gamma.z.sin_cos();
    let r1 = Vector3::new(cf * cp * st + sf * sp, cf * sp * st - cp * sf, cf * ct);
    let tau = Vector3::new(
        0.095 * (HELD[1] - HELD[3]),
        0.095 * (HELD[2] - HELD[0]),
        0.016 * (HELD[1] + HELD[3] - HELD[0] - HELD[2]),
    );
    let spin = inertia.component_mul(omega);
    let r2 = euler_rate_matrix(gamma).expect("this flight stays below 1.2 rad of pitch");
    [
        *v,
        r1 * thrust / 0.12 - Vector3::new(0.0, 0.0, 9.81),
        r2 * omega,
        (tau - omega.cross(&spin)).component_div(inertia),
    ]
}

const HELD: [f64; 4] = [0.2930, 0.2955, 0.2950, 0.2940];

#[test]
fn the_quaternion_form_flies_like_the_printed_euler_form() {
    let vehicle = no_drag();
    let inertia = Vector3::new(1e-4, 1e-4, 2e-4);
    let omega_b = Vector3::new(0.5, -0.4, 0.6);
    let gamma = Vector3::new(0.2, -0.3, 0.4);
    let start = RigidBodyState {
        omega_b,
        q_wb: quaternion_from_euler(&gamma),
        rotor_thrust_n: HELD,
        ..hover(&vehicle)
    };
    let mut model = airborne(vehicle, start);
    run(&mut model, &rotors(HELD), DT, 500);

    // Explicit midpoint, a method of its own, error ~ 1e-8 at this step.
    let mut x = [start.position_w, start.velocity_w, gamma, omega_b];
    let h = 1e-4;
    for _ in 0..5000 {
        let k1 = printed_rate(&x, &inertia);
        let half: [_; 4] = std::array::from_fn(|i| x[i] + k1[i] * (0.5 * h));
        let k2 = printed_rate(&half, &inertia);
        x = std::array::from_fn(|i| x[i] + k2[i] * h);
    }
    let s = model.state();
    assert!((s.position_w - x[0]).norm() < 1e-6);
    assert!((s.velocity_w - x[1]).norm() < 1e-6);
    assert!(s.q_wb.angle_to(&quaternion_from_euler(&x[2])) < 1e-6);
    assert!((s.omega_b - x[3]).norm() < 1e-6);
}

/// Distance of two states over body motion only, SI units mixed.
fn error(a: &RigidBodyState, b: &RigidBodyState) -> f64 {
    let q = a.q_wb.angle_to(&b.q_wb);
    (a.position_w - b.position_w).norm()
        + (a.velocity_w - b.velocity_w).norm()
        + (a.omega_b - b.omega_b).norm()
        + q
}

#[test]
fn halving_the_step_divides_the_error_of_a_tumble_by_sixteen() {
    let vehicle = VehicleParameters { geometry: asymmetric().geometry, ..Default::default() };
    // Rotors in transient and a large spin about the unstable axis.
    let omega_b = Vector3::new(12.0, 35.0, -20.0);
    let after = |dt: f64, steps: u32| {
        let start = RigidBodyState { omega_b, ..hover(&vehicle) };
        let mut model = airborne(vehicle, start);
        run(&mut model, &rotors([0.5, 0.3, 0.0, 0.9]), dt, steps);
        *model.state()
    };
    let exact = after(0.125e-3, 1600);
    let errors =
        [(2e-3, 100), (1e-3, 200), (0.5e-3, 400)].map(|(dt, n)| error(&after(dt, n), &exact));
    for pair in errors.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((14.0..18.5).contains(&ratio), "ratio {ratio}, errors {errors:?}");
    }
}

#[test]
fn the_true_accelerations_are_the_derivatives_of_the_true_rates() {
    let vehicle = VehicleParameters::default();
    let start = RigidBodyState {
        omega_b: Vector3::new(3.0, -2.0, 4.0),
        velocity_w: Vector3::new(1.0, 2.0, 3.0),
        ..hover(&vehicle)
    };
    let grow = PlantInputs { morph_command_rad: 2.0, ..rotors([0.4, 0.3, 0.2, 0.3]) };
    let mut model = airborne(vehicle, start);
    run(&mut model, &grow, DT, 10);
    let before = *model.state();
    let h = 1e-5;
    run(&mut model, &grow, h, 1);
    let truth = model.truth(&grow);
    run(&mut model, &grow, h, 1);
    let after = model.state();
    let linear = (after.velocity_w - before.velocity_w) / (2.0 * h);
    let angular = (after.omega_b - before.omega_b) / (2.0 * h);
    // Central differences: h² of the rotors' curvature, and rounding of 1e-10.
    assert!((truth.acceleration_w_m_s2 - linear).norm() < 1e-4);
    assert!((truth.angular_acceleration_b_rad_s2 - angular).norm() < 1e-2);
}

#[test]
fn unusable_inputs_are_refused_and_change_nothing() {
    let vehicle = VehicleParameters::default();
    let mut model = airborne(vehicle, hover(&vehicle));
    let before = model.memory();
    let good = rotors([0.3; 4]);
    let torque_b_nm = Vector3::new(0.0, f64::NAN, 0.0);
    let bad = [
        rotors([0.3, f64::NAN, 0.3, 0.3]),
        PlantInputs { morph_command_rad: f64::NAN, ..good },
        PlantInputs { disturbance: Disturbance { torque_b_nm, ..good.disturbance }, ..good },
    ];
    for inputs in &bad {
        assert_eq!(model.step(DT, inputs), StepStatus::BadInput);
        assert!(model.truth(inputs).acceleration_w_m_s2.norm().is_finite());
    }
    for dt in [0.0, -1e-3, f64::NAN, 0.1] {
        assert_eq!(model.step(dt, &good), StepStatus::BadInput);
    }
    let force_w_n = Vector3::new(f64::MAX, 0.0, 0.0);
    let blow = PlantInputs { disturbance: Disturbance { force_w_n, ..good.disturbance }, ..good };
    assert_eq!(model.step(DT, &blow), StepStatus::Diverged);
    assert_eq!(model.memory().map(f64::to_bits), before.map(f64::to_bits));
}

#[test]
fn a_restored_model_continues_bit_for_bit() {
    let vehicle = VehicleParameters::default();
    let start = RigidBodyState { omega_b: Vector3::new(1.0, 2.0, 3.0), ..hover(&vehicle) };
    let inputs = PlantInputs { morph_command_rad: 2.0, ..rotors([0.5, 0.3, 0.2, 0.4]) };
    let mut first = airborne(vehicle, start);
    run(&mut first, &inputs, DT, 50);
    let mut second = airborne(vehicle, hover(&vehicle));
    assert_eq!(second.restore(&first.memory()), Some(()));
    run(&mut first, &inputs, DT, 50);
    run(&mut second, &inputs, DT, 50);
    assert_eq!(first.memory().map(f64::to_bits), second.memory().map(f64::to_bits));
    let mut spoiled = first.memory();
    spoiled[6] = f64::NAN;
    assert_eq!(second.restore(&spoiled), None);
    assert_eq!(first.memory().map(f64::to_bits), second.memory().map(f64::to_bits));
}
