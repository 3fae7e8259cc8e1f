//! Steps of 0.2 rad on the nonlinear vehicle, at every rate and size, with the flight defaults.

use crate::rig::{Flight, SIZES, Trace, fly, peak, settling};
use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Setpoint};
use nalgebra::Vector3;
use vehicle::{MorphAngle, VehicleParameters};

const STEP_RAD: f64 = 0.2;
const STEP_AT_S: f64 = 0.1;

fn step_flight(rate_hz: f64, beta: MorphAngle, target: Vector3<f64>) -> Trace {
    let vehicle = VehicleParameters::default();
    let mut law = AttitudeLaw::new(AttitudeLawConfig::flight(rate_hz), &vehicle).unwrap();
    let mut flight = Flight::hover(vehicle, beta);
    fly(&mut flight, &mut law, rate_hz, 0.8, |t, _| {
        let gamma_rad = if t > STEP_AT_S - 1e-6 { target } else { Vector3::zeros() };
        Setpoint { gamma_rad, thrust_n: vehicle.weight_n() }
    })
}

/// Settling and peak of each axis.
fn marks(rate_hz: f64, beta: MorphAngle, target: Vector3<f64>) -> [(f64, f64); 3] {
    let trace = step_flight(rate_hz, beta, target);
    [0, 1, 2].map(|axis| (settling(&trace, axis, target[axis], STEP_AT_S), peak(&trace, axis)))
}

#[test]
fn one_axis_at_a_time_settles_within_its_mark_at_every_rate_and_size() {
    for rate in [50.0, 100.0, 150.0, 500.0] {
        for beta in SIZES {
            for (axis, settles_s, peaks_rad) in [(0, 0.13, 0.21), (1, 0.13, 0.21), (2, 0.45, 0.235)]
            {
                let mut target = Vector3::zeros();
                target[axis] = STEP_RAD;
                let all = marks(rate, beta, target);
                let (settled, peaked) = all[axis];
                let case = format!("{rate} Hz, {beta:?}, axis {axis}: {all:?}");
                assert!(settled <= settles_s && peaked <= peaks_rad, "{case}");
                for other in (0..3).filter(|other| *other != axis) {
                    assert!(all[other].0 <= 0.0, "the others stay: {case}");
                }
            }
        }
    }
}

#[test]
fn three_axes_at_once_settle_within_their_marks_although_they_share_the_rotors() {
    for (rate, tilt_settles_s) in [(50.0, 0.35), (100.0, 0.13), (150.0, 0.13), (500.0, 0.13)] {
        for beta in SIZES {
            let [roll, pitch, yaw] = marks(rate, beta, Vector3::repeat(STEP_RAD));
            let case = format!("{rate} Hz, {beta:?}: {roll:?} {pitch:?} {yaw:?}");
            for (settled, peaked) in [roll, pitch] {
                assert!(settled <= tilt_settles_s && peaked <= 0.21, "{case}");
            }
            assert!(yaw.0 <= 0.45 && yaw.1 <= 0.235, "{case}");
        }
    }
}

#[test]
fn every_rate_between_the_tested_ones_flies_as_well() {
    for rate in [60.0, 75.0, 90.0, 120.0, 180.0, 200.0, 333.0, 400.0, 1000.0] {
        for beta in SIZES {
            let [roll, pitch, yaw] = marks(rate, beta, Vector3::repeat(STEP_RAD));
            let case = format!("{rate} Hz, {beta:?}: {roll:?} {pitch:?} {yaw:?}");
            for (settled, peaked) in [roll, pitch, yaw] {
                assert!(settled <= 0.45 && peaked <= 0.245, "{case}");
            }
        }
    }
}
