//! A fresh law beside one that flies, given only what the plant applied.

use crate::rig::{Flight, MS, SIZES, release_ns};
use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Input, LawStatus, Setpoint};
use nalgebra::Vector3;
use vehicle::{VehicleParameters, Wrench, euler_from_quaternion};

/// What is left of the torque that the shadow did not know \[shares of the bound\]: 15 ms of rotor
/// lag forget it by e⁻¹² in the 0.22 s before the comparison.
const TOLERANCE: f64 = 1e-5;

#[test]
fn a_fresh_law_that_tracks_a_flying_one_commands_the_same_one_step_ahead() {
    let vehicle = VehicleParameters::default();
    for rate_hz in [50.0, 100.0, 300.0, 500.0, 1000.0] {
        for beta in SIZES {
            let config = AttitudeLawConfig::flight(rate_hz);
            let mut owner = AttitudeLaw::new(config, &vehicle).unwrap();
            let mut shadow = AttitudeLaw::new(config, &vehicle).unwrap();
            let mut flight = Flight::hover(vehicle, beta);
            flight.disturbance.torque_b_nm = Vector3::new(0.004, -0.003, 0.001);
            let (mut worst, mut busiest): (f64, f64) = (0.0, 0.0);
            for k in 0.. {
                let release = release_ns(k, rate_hz);
                let t_s = release as f64 * 1e-9;
                if t_s > 1.0 {
                    break;
                }
                flight.advance(release);
                let (state, applied) = flight.sampled();
                let gamma_rad = Vector3::new(0.15 * libm::sin(6.0 * t_s), -0.1, 0.3 * t_s);
                let input = Input {
                    gamma_rad: euler_from_quaternion(&state.q_wb),
                    body_rate_rad_s: state.omega_b,
                    age_s: (release % MS) as f64 * 1e-9,
                    morph_angle: state.beta,
                    setpoint: Setpoint { gamma_rad, thrust_n: vehicle.weight_n() },
                    applied_torque_nm: Some(applied),
                };
                let output = owner.step(&input);
                flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
                if t_s < 0.5 {
                    continue;
                }
                shadow.track(&applied, output.thrust_n);
                let tracked = shadow.step(&input);
                if t_s > 0.72 {
                    assert_eq!(tracked.status, LawStatus::Solved);
                    let apart = tracked.torque_nm - output.torque_nm;
                    worst = worst.max(apart.component_div(&output.torque_bound_nm).amax());
                    let share = output.torque_nm.component_div(&output.torque_bound_nm).amax();
                    busiest = busiest.max(share);
                }
            }
            assert!(worst <= TOLERANCE, "{rate_hz} Hz, {beta:?}: {worst}");
            assert!(busiest > 0.05, "{rate_hz} Hz, {beta:?}: nothing to track, {busiest}");
        }
    }
}

#[test]
fn a_refused_step_while_tracking_holds_what_is_applied() {
    let vehicle = VehicleParameters::default();
    let mut law = AttitudeLaw::new(AttitudeLawConfig::default(), &vehicle).unwrap();
    let mut input = Input {
        gamma_rad: Vector3::zeros(),
        body_rate_rad_s: Vector3::zeros(),
        age_s: 0.0,
        morph_angle: SIZES[0],
        setpoint: Setpoint { gamma_rad: Vector3::zeros(), thrust_n: 1.2 },
        applied_torque_nm: Some(Vector3::zeros()),
    };
    law.step(&input);
    let applied = Vector3::new(0.01, -0.02, 0.003);
    law.track(&applied, 1.1);
    input.gamma_rad.x = f64::NAN;
    input.applied_torque_nm = Some(applied);
    let held = law.step(&input);
    assert!(matches!(held.status, LawStatus::Refused(_)));
    assert!((held.torque_nm - applied).amax() <= 0.0 && (held.thrust_n - 1.1).abs() <= 0.0);
}
