//! What the law does not know: torques from outside, another lag, another inertia, a full turn.

use crate::rig::{Flight, SIZES, fly, peak, settling};
use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Input, LawStatus, MorphPlan, Setpoint};
use nalgebra::Vector3;
use vehicle::{Disturbance, MorphAngle, VehicleParameters, Wrench, euler_from_quaternion, wrap_pi};

fn law(rate_hz: f64) -> AttitudeLaw {
    AttitudeLaw::new(AttitudeLawConfig::flight(rate_hz), &VehicleParameters::default()).unwrap()
}

fn hover(gamma_rad: Vector3<f64>) -> Setpoint {
    Setpoint { gamma_rad, thrust_n: VehicleParameters::default().weight_n() }
}

#[test]
fn a_constant_torque_is_integrated_away_within_a_second() {
    for rate in [50.0, 100.0, 150.0, 500.0] {
        for beta in SIZES {
            let mut flight = Flight::hover(VehicleParameters::default(), beta);
            flight.disturbance = Disturbance {
                torque_b_nm: Vector3::new(0.01, -0.008, 0.002),
                ..Disturbance::default()
            };
            let trace = fly(&mut flight, &mut law(rate), rate, 1.5, |_, _| hover(Vector3::zeros()));
            let late = trace.t_s.iter().zip(&trace.gamma).filter(|(t, _)| **t > 1.0);
            let worst = late.map(|(_, gamma)| gamma.amax()).fold(0.0, f64::max);
            assert!(worst <= 1e-3, "{rate} Hz, {beta:?}: {worst}");
        }
    }
}

/// Settling and peak of a roll step of 0.2 rad on a vehicle the law misjudges.
fn misjudged(rate: f64, beta: MorphAngle, rotor_lag_s: f64, inertia_scale: f64) -> (f64, f64) {
    let vehicle = VehicleParameters { rotor_lag_s, inertia_scale, ..VehicleParameters::default() };
    let mut flight = Flight::hover(vehicle, beta);
    let target = hover(Vector3::new(0.2, 0.0, 0.0));
    let trace = fly(&mut flight, &mut law(rate), rate, 1.0, |_, _| target);
    (settling(&trace, 0, 0.2, 0.0), peak(&trace, 0))
}

#[test]
fn a_wrong_lag_and_a_wrong_inertia_together_settle_from_100_hz_on() {
    for rate in [100.0, 150.0, 500.0] {
        for beta in SIZES {
            for lag_s in [0.010, 0.015, 0.020] {
                for scale in [0.8, 1.0, 1.5] {
                    let (settled, peaked) = misjudged(rate, beta, lag_s, scale);
                    let case = format!("{rate} Hz {beta:?} {lag_s} s x{scale}");
                    assert!(settled <= 0.4 && peaked <= 0.26, "{case}: {settled} s, {peaked} rad");
                }
            }
        }
    }
}

#[test]
fn three_axes_at_once_settle_as_well_under_a_longer_lag_and_a_larger_inertia() {
    for beta in SIZES {
        let vehicle = VehicleParameters {
            rotor_lag_s: 0.020,
            inertia_scale: 1.5,
            ..VehicleParameters::default()
        };
        let mut flight = Flight::hover(vehicle, beta);
        let target = hover(Vector3::repeat(0.2));
        let trace = fly(&mut flight, &mut law(100.0), 100.0, 1.5, |_, _| target);
        let settled = [0, 1, 2].map(|axis| settling(&trace, axis, 0.2, 0.0));
        let [roll, pitch, yaw] = settled;
        assert!(roll <= 0.4 && pitch <= 0.4 && yaw <= 0.5, "{beta:?}: {settled:?}");
    }
}

#[test]
fn at_50_hz_one_of_them_may_be_wrong() {
    for beta in SIZES {
        for (lag_s, scale) in [(0.010, 1.0), (0.020, 1.0), (0.015, 0.8), (0.015, 1.5)] {
            let (settled, peaked) = misjudged(50.0, beta, lag_s, scale);
            let case = format!("{beta:?} {lag_s} s x{scale}");
            assert!(settled <= 0.5 && peaked <= 0.26, "{case}: {settled} s, {peaked} rad");
        }
    }
}

#[test]
fn a_heading_across_half_a_turn_goes_the_short_way() {
    let mut flight = Flight::hover(VehicleParameters::default(), MorphAngle::MIN);
    let mut longest: f64 = 0.0;
    let trace = fly(&mut flight, &mut law(100.0), 100.0, 9.0, |t, _| {
        hover(Vector3::new(0.0, 0.0, wrap_pi(t.min(7.0))))
    });
    for pair in trace.gamma.windows(2) {
        longest = longest.max(wrap_pi(pair[1].z - pair[0].z).abs());
    }
    assert!(longest < 3e-3, "1 rad/s, never the long way back: {longest} rad in 1 ms");
    let last = trace.gamma.last().unwrap();
    assert!(wrap_pi(last.z - 7.0).abs() < 1e-3, "{last}");
}

#[test]
fn a_morph_sweep_leaves_no_trace_in_hover() {
    let vehicle = VehicleParameters::default();
    let mut flight = Flight::hover(vehicle, MorphAngle::MIN);
    let trace = fly(&mut flight, &mut law(100.0), 100.0, 2.0, |t, flight| {
        flight.morph_command = if t < 1.0 { MorphAngle::MAX } else { MorphAngle::MIN };
        flight.disturbance.torque_b_nm = Vector3::new(0.004, -0.004, 0.001);
        hover(Vector3::zeros())
    });
    let late = trace.t_s.iter().zip(&trace.gamma).filter(|(t, _)| **t > 0.5);
    let worst = late.map(|(_, gamma)| gamma.amax()).fold(0.0, f64::max);
    assert!(worst < 5e-3, "{worst}");
}

#[test]
fn an_unscheduled_law_is_the_scheduled_one_at_its_own_angle_and_another_elsewhere() {
    let fixed = AttitudeLawConfig {
        fixed_morph_angle: Some(MorphAngle::MEDIUM),
        ..AttitudeLawConfig::flight(100.0)
    };
    let vehicle = VehicleParameters::default();
    let [same, other] = [MorphAngle::MEDIUM, MorphAngle::MAX].map(|beta| {
        let last = |mut law: AttitudeLaw| {
            let mut flight = Flight::hover(vehicle, beta);
            let target = hover(Vector3::new(0.2, 0.0, 0.0));
            *fly(&mut flight, &mut law, 100.0, 0.1, |_, _| target).outputs.last().unwrap()
        };
        (last(law(100.0)), last(AttitudeLaw::new(fixed, &vehicle).unwrap()))
    });
    assert_eq!(same.0, same.1);
    assert_ne!(other.0.torque_bound_nm, other.1.torque_bound_nm);
    assert_ne!(other.0.torque_nm, other.1.torque_nm);
}

/// γ at each sample of a `turn` \[rad/s\], with or without a sweep between the smallest and the
/// largest size in 0.3 s.
fn turning(turn: Vector3<f64>, ends: [MorphAngle; 2], morph_preview: bool) -> Vec<Vector3<f64>> {
    let vehicle = VehicleParameters::default();
    let config = AttitudeLawConfig { morph_preview, ..AttitudeLawConfig::flight(100.0) };
    let mut law = AttitudeLaw::new(config, &vehicle).unwrap();
    let mut flight = Flight::hover(vehicle, ends[0]);
    let [from, to] = ends.map(MorphAngle::rad);
    let planned = |t: f64| from + (to - from) * ((t - 1.0) / 0.3).clamp(0.0, 1.0);
    let step = |k: u64| {
        let t_s = k as f64 * 0.01;
        flight.advance(crate::rig::release_ns(k, 100.0));
        flight.morph_command = MorphAngle::saturating_from_rad(planned(t_s)).unwrap();
        let (state, applied) = flight.sampled();
        let gamma_rad = euler_from_quaternion(&state.q_wb);
        let input = Input {
            gamma_rad,
            body_rate_rad_s: state.omega_b,
            age_s: 0.0,
            morph_angle: state.beta,
            setpoint: hover(turn * (t_s - 0.5)),
            applied_torque_nm: Some(applied),
        };
        let path: [f64; 30] = core::array::from_fn(|i| planned(t_s + i as f64 * 0.01));
        let plan = MorphPlan { path_rad: &path, spacing_s: 0.01, age_s: 0.0 };
        let output = law.step_along(&input, Some(&plan));
        assert_eq!(output.status, LawStatus::Solved);
        assert!(output.violation_nm <= 1e-9);
        flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
        gamma_rad
    };
    (0..200).map(step).collect()
}

#[test]
fn a_fast_sweep_in_a_turn_leaves_less_of_a_trace_if_it_is_foreseen() {
    let (small, large) = (MorphAngle::MIN, MorphAngle::MAX);
    for (turn, least_gain) in [(Vector3::new(0.4, 0.0, 0.0), 0.9), (Vector3::z() * 1.5, 2.0)] {
        for [from, to] in [[small, large], [large, small]] {
            let [foreseen, unforeseen] = [true, false].map(|preview| {
                let still = turning(turn, [from; 2], preview);
                let swept = turning(turn, [from, to], preview);
                let traces = swept.iter().zip(&still).skip(95);
                traces.map(|(a, b)| (a - b).amax()).fold(0.0, f64::max)
            });
            let case = format!("{turn} {from:?}: {foreseen} {unforeseen}");
            assert!(foreseen * least_gain < unforeseen, "{case}");
        }
    }
}
