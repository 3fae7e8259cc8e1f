//! The cascade on the nonlinear vehicle: disturbances that are not in its model, and a moving reference.

use crate::cascade::{Cascade, Flight, Trace};
use nalgebra::Vector3;
use position_mpc::PositionLawConfig;
use vehicle::{MorphAngle, NonlinearModel, RigidBodyState, VehicleParameters};

const SIZES: [MorphAngle; 3] = [MorphAngle::MIN, MorphAngle::MEDIUM, MorphAngle::MAX];
/// Position and attitude rate \[Hz\].
const RATES: [(f64, f64); 4] = [(50.0, 100.0), (50.0, 150.0), (100.0, 100.0), (100.0, 500.0)];

fn cascade((position_hz, attitude_hz): (f64, f64), beta: MorphAngle) -> Cascade {
    let flight = Flight::hover(VehicleParameters::default(), beta);
    Cascade::new(flight, &PositionLawConfig::flight(position_hz), attitude_hz)
}

fn stay(_: f64) -> (Vector3<f64>, f64) {
    (Vector3::zeros(), 0.0)
}

/// A figure of eight, 2 m by 1 m in 6 s, flown into over two seconds, while the heading turns.
fn eight(t: f64) -> (Vector3<f64>, f64) {
    let (s, ramp) = (t * std::f64::consts::TAU / 6.0, (0.5 * t).min(1.0));
    let grow = ramp * ramp * (3.0 - 2.0 * ramp);
    let rise = 0.2 * (1.0 - libm::cos(s));
    (Vector3::new(libm::sin(s), 0.5 * libm::sin(2.0 * s), rise) * grow, 0.7 * t)
}

#[test]
fn a_constant_force_leaves_no_position_error() {
    for rates in RATES {
        for beta in SIZES {
            let mut cascade = cascade(rates, beta);
            cascade.flight.disturbance.force_w_n = Vector3::new(0.15, -0.10, -0.20);
            let trace = cascade.fly(10.0, &stay, |_, _| {});
            let mean = trace.mean_error_m(8.0);
            assert!(mean <= 0.005, "{rates:?} {beta:?}: {mean} m");
        }
    }
}

#[test]
fn half_as_much_mass_again_is_carried() {
    for rates in RATES {
        for beta in SIZES {
            let mut cascade = cascade(rates, beta);
            let believed = VehicleParameters::default();
            let start = RigidBodyState::hover(&believed, Vector3::zeros(), beta);
            let heavy = VehicleParameters { mass_kg: 1.5 * believed.mass_kg, ..believed };
            cascade.flight.plant = NonlinearModel::new(heavy, None, start).unwrap();
            let trace = cascade.fly(6.0, &stay, |_, _| {});
            let (worst, late) = (trace.worst_error_m(0.0), trace.mean_error_m(5.0));
            assert!(worst <= 0.1 && late <= 0.005, "{rates:?} {beta:?}: {worst} m, {late} m");
        }
    }
}

#[test]
fn a_rotor_at_half_its_efficiency_is_caught() {
    for rates in RATES {
        for beta in SIZES {
            for rotor in 0..4 {
                let mut cascade = cascade(rates, beta);
                let trace = cascade.fly(4.0, &stay, |t, flight| {
                    flight.disturbance.rotor_efficiency[rotor] = if t < 1.0 { 1.0 } else { 0.5 };
                });
                let worst = trace.worst_error_m(0.0);
                assert!(worst <= 0.06, "{rates:?} {beta:?} rotor {rotor}: {worst} m");
            }
        }
    }
}

fn morphing_eight(rates: (f64, f64), sweep: bool) -> Trace {
    cascade(rates, MorphAngle::MIN).fly(12.0, &eight, |t, flight| {
        let large = sweep && (t % 4.0) >= 2.0;
        flight.morph_command = if large { MorphAngle::MAX } else { MorphAngle::MIN };
    })
}

#[test]
fn a_figure_of_eight_is_tracked_and_a_morph_sweep_leaves_no_trace_in_it() {
    for rates in RATES {
        let (swept, plain) = (morphing_eight(rates, true), morphing_eight(rates, false));
        let (mean, worst) = (swept.mean_error_m(2.0), swept.worst_error_m(2.0));
        assert!(mean <= 0.02 && worst <= 0.05, "{rates:?}: {mean} m, worst {worst} m");
        let cost = worst - plain.worst_error_m(2.0);
        assert!(cost <= 0.005, "{rates:?}: the sweep costs {cost} m");
        let heading = swept.yaw_error_rad.iter().fold(0.0, |w: f64, e| w.max(e.abs()));
        assert!(heading <= 0.1, "{rates:?}: {heading} rad behind a heading that turns");
    }
}

#[test]
fn the_law_flies_at_every_heading() {
    for degrees in [-150_i32, -90, 45, 135, 180] {
        let yaw = f64::from(degrees).to_radians();
        let mut cascade = cascade((50.0, 100.0), MorphAngle::MIN);
        let turned = |t: f64| (Vector3::new(if t < 3.0 { 0.0 } else { 0.3 }, 0.0, 0.0), yaw);
        let trace = cascade.fly(7.0, &turned, |_, _| {});
        let late = trace.mean_error_m(6.0);
        assert!(late <= 0.005, "{degrees}: {late} m");
    }
}

#[test]
fn the_noise_of_an_estimate_leaves_room_for_a_failing_rotor() {
    for rates in [(50.0, 50.0), (50.0, 100.0), (100.0, 100.0), (100.0, 500.0)] {
        for beta in SIZES {
            let mut cascade = cascade(rates, beta);
            cascade.noise_gain = 1.0;
            let trace = cascade.fly(6.0, &stay, |t, flight| {
                flight.disturbance.rotor_efficiency[0] = if t < 3.0 { 1.0 } else { 0.5 };
            });
            let worst = trace.worst_error_m(0.0);
            assert!(worst <= 0.06, "{rates:?} {beta:?}: {worst} m");
            let steps = trace.outputs.windows(2);
            let moved = steps.map(|pair| (pair[1].command.x - pair[0].command.x).abs());
            let mean_rad = moved.sum::<f64>() / (trace.outputs.len() - 1) as f64;
            assert!(mean_rad <= 0.025, "{rates:?} {beta:?}: {mean_rad} rad from sample to sample");
        }
    }
}
