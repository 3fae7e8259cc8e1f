//! Any attitude law in its loop, on the flight of the attitude MPC's own tests.
#![allow(dead_code, reason = "each test file uses its own part of the rig")]

#[path = "../../../attitude-mpc/tests/rig/mod.rs"]
mod rig;

use controller::attitude::{AttitudeLaw, AttitudeLoop, Measurement, Output, Setpoint, Timing};
use nalgebra::Vector3;
pub(crate) use rig::{Flight, MS, SIZES, Trace, nanoseconds, peak, release_ns, settling};
use vehicle::{MorphAngle, VehicleParameters, Wrench, euler_from_quaternion};

/// Rates at which every law is tried \[Hz\].
pub(crate) const RATES: [f64; 5] = [50.0, 100.0, 150.0, 500.0, 1000.0];

/// Times of the rig: commands and reports of a millisecond, the default vehicle's rotors.
pub(crate) fn timing(rate_hz: f64) -> Timing {
    let rotor_lag_s = VehicleParameters::default().rotor_lag_s;
    Timing { period_s: 1.0 / rate_hz, latency_s: 1e-3, report_s: 1e-3, rotor_lag_s }
}

pub(crate) fn hover(gamma_rad: Vector3<f64>) -> Setpoint {
    Setpoint { gamma_rad, thrust_n: VehicleParameters::default().weight_n() }
}

/// The measurement that a loop gets at `release` \[ns\].
pub(crate) fn measured(flight: &Flight, release: u64) -> Measurement {
    let (state, applied) = flight.sampled();
    Measurement {
        gamma_rad: euler_from_quaternion(&state.q_wb),
        body_rate_rad_s: state.omega_b,
        age_s: (release % MS) as f64 * 1e-9,
        morph_angle: state.beta,
        applied_nm: Some(applied),
    }
}

/// Flies `law` on the set points of `setpoint(t)`; γ each millisecond, and every command.
pub(crate) fn fly<L: AttitudeLaw>(
    flight: &mut Flight,
    law: &mut AttitudeLoop<L>,
    seconds: f64,
    mut setpoint: impl FnMut(f64, &mut Flight) -> Setpoint,
) -> (Trace, Vec<Output>) {
    let mut trace = Trace { t_s: vec![], gamma: vec![], outputs: vec![] };
    let mut outputs = Vec::new();
    let rate_hz = 1.0 / law.timing().period_s;
    let (mut k, mut tick) = (0, 0);
    while tick * MS < nanoseconds(seconds) {
        let release = release_ns(k, rate_hz);
        if release < (tick + 1) * MS {
            flight.advance(release);
            let setpoint = setpoint(release as f64 * 1e-9, flight);
            let output = law.step(&measured(flight, release), &setpoint);
            assert!(output.is_new, "refused at {release} ns");
            let violation = output.torque.bounded();
            assert!(violation.worst_violation() <= 1e-15, "{output:?}");
            let torque_b_nm = output.torque.input;
            flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm });
            outputs.push(output);
            k += 1;
            continue;
        }
        tick += 1;
        flight.advance(tick * MS);
        trace.t_s.push(tick as f64 * 1e-3);
        trace.gamma.push(euler_from_quaternion(&flight.sampled().0.q_wb));
    }
    (trace, outputs)
}

/// Settling and peak of each axis for steps of 0.2 rad about `axes`, 0.1 s after the start, on a vehicle
/// that the law does not know.
pub(crate) fn stepped<L: AttitudeLaw>(
    law: &mut AttitudeLoop<L>,
    flown: VehicleParameters,
    beta: MorphAngle,
    axes: Vector3<f64>,
) -> [(f64, f64); 3] {
    let mut flight = Flight::hover(flown, beta);
    let target = axes * 0.2;
    let (trace, _) = fly(&mut flight, law, 1.6, |t, _| {
        hover(if t > 0.1 - 1e-6 { target } else { Vector3::zeros() })
    });
    [0, 1, 2].map(|axis| (settling(&trace, axis, target[axis], 0.1), peak(&trace, axis)))
}

/// A busy made-up flight: morphing, clipped torques, sometimes no report, a wrapped heading.
pub(crate) fn busy(k: u32) -> (Measurement, Setpoint) {
    let t = f64::from(k) * 0.01;
    let wave = |rate: f64, phase: f64| libm::sin(rate * t + phase);
    let measurement = Measurement {
        gamma_rad: Vector3::new(0.2 * wave(5.0, 0.1), 0.3 * wave(4.0, 1.0), 3.1 * wave(2.0, 0.0)),
        body_rate_rad_s: Vector3::new(wave(5.0, 1.6), wave(4.0, 2.0), 6.0 * wave(2.0, 1.5)),
        age_s: 1e-4 * f64::from(k % 3),
        morph_angle: MorphAngle::saturating_from_rad(1.8 + wave(3.0, 0.0)).unwrap(),
        applied_nm: (!k.is_multiple_of(5)).then(|| Vector3::repeat(0.03 * wave(6.0, 0.3))),
    };
    let gamma_rad = Vector3::new(0.3 * wave(1.0, f64::from(k / 7)), 0.1, 3.1 * wave(0.5, 0.0));
    (measurement, Setpoint { gamma_rad, thrust_n: 1.2 + 0.8 * wave(7.0, 0.0) })
}

/// Memory, refusals, bounds and allocations, which are the same for every law.
pub(crate) fn assert_well_behaved<L: AttitudeLaw>(make: impl Fn() -> AttitudeLoop<L>) {
    let (mut owner, mut successor) = (make(), make());
    for k in 0..57 {
        let (measurement, setpoint) = busy(k);
        owner.step(&measurement, &setpoint);
    }
    successor.restore(&owner.memory()).unwrap();
    for k in 57..140 {
        let (measurement, setpoint) = busy(k);
        let output = owner.step(&measurement, &setpoint);
        assert_eq!(output, successor.step(&measurement, &setpoint), "step {k}");
        let report = output.torque.bounded();
        assert!(report.worst_violation() <= 1e-15, "step {k}: {output:?}");
    }
    let (mut bad, setpoint) = busy(140);
    bad.body_rate_rad_s.z = f64::NAN;
    let last = owner.step(&busy(140).0, &setpoint);
    let held = owner.step(&bad, &setpoint);
    assert!(!held.is_new && held.torque.input == last.torque.input);
    bad = busy(140).0;
    bad.gamma_rad.y = 1.21;
    assert!(!owner.step(&bad, &setpoint).is_new, "too steep for Euler rates");
    assert!(owner.step(&busy(141).0, &setpoint).is_new);
    let counted = allocation_counter::measure(|| {
        for k in 0..50 {
            let (measurement, setpoint) = busy(k);
            owner.track(&Vector3::zeros(), 1.0);
            owner.step(&measurement, &setpoint);
        }
        owner.restore(&successor.memory()).unwrap();
    });
    assert_eq!(counted.count_total, 0);
}

/// Flies the attitude MPC through turns and steps, with `shadow` beside it that is given only what
/// the plant applied; largest difference of torque in shares of the bound: while it tracks, and in
/// the second after it has stopped.
pub(crate) fn shadowed<L: AttitudeLaw>(shadow: &mut AttitudeLoop<L>, beta: MorphAngle) -> [f64; 2] {
    let rate_hz = 1.0 / shadow.timing().period_s;
    let vehicle = VehicleParameters::default();
    let config = attitude_mpc::AttitudeLawConfig::flight(rate_hz);
    let mut owner = attitude_mpc::AttitudeLaw::new(config, &vehicle).unwrap();
    let mut flight = Flight::hover(vehicle, beta);
    flight.disturbance.torque_b_nm = Vector3::new(0.004, -0.003, 0.001);
    let mut worst = [0.0_f64; 2];
    for k in 0.. {
        let release = release_ns(k, rate_hz);
        let t_s = release as f64 * 1e-9;
        if t_s > 2.5 {
            break;
        }
        flight.advance(release);
        let measurement = measured(&flight, release);
        // Gentle: what a set point of flight does in a tenth of a second.
        let gamma_rad = Vector3::new(0.1 * libm::sin(3.0 * t_s), -0.05, 0.2 * t_s);
        let setpoint = hover(gamma_rad);
        let output = owner.step(&attitude_mpc::Input {
            gamma_rad: measurement.gamma_rad,
            body_rate_rad_s: measurement.body_rate_rad_s,
            age_s: measurement.age_s,
            morph_angle: measurement.morph_angle,
            setpoint: attitude_mpc::Setpoint { gamma_rad, thrust_n: setpoint.thrust_n },
            applied_torque_nm: measurement.applied_nm,
        });
        flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
        if t_s < 0.5 {
            continue;
        }
        let tracks = t_s < 1.5;
        if tracks {
            shadow.track(&measurement.applied_nm.unwrap(), output.thrust_n);
        }
        let shadowed = shadow.step(&measurement, &setpoint);
        let apart = shadowed.torque.input - output.torque_nm;
        if t_s > 1.0 {
            let share = apart.component_div(&output.torque_bound_nm).amax();
            let phase = &mut worst[usize::from(!tracks)];
            *phase = phase.max(share);
        }
    }
    worst
}

/// Three axes at once settle in 1.1 s and peak by 0.27 at most on vehicles that the law takes for others.
pub(crate) fn assert_settles_on_other_vehicles<L: AttitudeLaw>(
    usual: impl Fn(f64) -> AttitudeLoop<L>,
) {
    for rate_hz in [100.0, 150.0, 500.0, 1000.0] {
        for beta in SIZES {
            for (rotor_lag_s, inertia_scale) in [0.010, 0.015, 0.020]
                .into_iter()
                .flat_map(|lag_s| [0.8, 1.0, 1.5].map(|i| (lag_s, i)))
            {
                let flown = VehicleParameters {
                    rotor_lag_s,
                    inertia_scale,
                    ..VehicleParameters::default()
                };
                let marks = stepped(&mut usual(rate_hz), flown, beta, Vector3::repeat(1.0));
                let case = format!("{rate_hz} Hz {beta:?} {rotor_lag_s} s x{inertia_scale}");
                for (settled, peaked) in marks {
                    assert!(settled <= 1.1 && peaked <= 0.27, "{case}: {marks:?}");
                }
            }
        }
    }
}

/// Of a constant torque a milliradian is left after two seconds.
pub(crate) fn assert_integrates<L: AttitudeLaw>(usual: impl Fn(f64) -> AttitudeLoop<L>) {
    for rate_hz in [100.0, 150.0, 500.0, 1000.0] {
        for beta in SIZES {
            let mut flight = Flight::hover(VehicleParameters::default(), beta);
            flight.disturbance.torque_b_nm = Vector3::new(0.01, -0.008, 0.002);
            let level = |_: f64, _: &mut Flight| hover(Vector3::zeros());
            let (trace, _) = fly(&mut flight, &mut usual(rate_hz), 3.0, level);
            let late = trace.t_s.iter().zip(&trace.gamma).filter(|(t, _)| **t > 2.0);
            let worst = late.map(|(_, gamma)| gamma.amax()).fold(0.0, f64::max);
            assert!(worst <= 1e-3, "{rate_hz} Hz, {beta:?}: {worst}");
        }
    }
}

/// Peak \[rad\], settling \[s\] and saturated steps of a turn by 2 rad that takes all the torque there is.
pub(crate) fn turned<L: AttitudeLaw>(mut law: AttitudeLoop<L>) -> (f64, f64, usize) {
    let mut flight = Flight::hover(VehicleParameters::default(), MorphAngle::MAX);
    let target = hover(Vector3::new(0.0, 0.0, 2.0));
    let (trace, outputs) = fly(&mut flight, &mut law, 4.0, |_, _| target);
    let at_bound = outputs.iter().filter(|output| output.torque.clipped > 0).count();
    (peak(&trace, 2), settling(&trace, 2, 2.0, 0.0), at_bound)
}
