//! The law over an attitude MPC and the nonlinear vehicle, each edge 1 ms late, perfect state.
#![allow(clippy::unwrap_used, reason = "a set-up that fails is a failed test")]

#[path = "../../attitude-mpc/tests/rig/mod.rs"]
mod rig;

use attitude_mpc::{AttitudeLaw, AttitudeLawConfig};
use controller::SetpointBounds;
use nalgebra::Vector3;
use position_mpc::PositionLawConfig;
use position_pid::settings::Settings;
use position_pid::{Input, Output, PositionPidConfig, PositionPidLaw, Setpoint, Target};
use rig::{Flight, MS, SIZES, nanoseconds, release_ns};
use vehicle::{
    MorphAngle, NonlinearModel, RigidBodyState, VehicleParameters, Wrench, euler_from_quaternion,
};

/// Position and attitude rate \[Hz\].
const RATES: [(f64, f64); 5] =
    [(50.0, 50.0), (50.0, 100.0), (100.0, 100.0), (200.0, 500.0), (500.0, 500.0)];

/// Desired position \[m\] and heading \[rad\] at a time \[s\].
type Reference = fn(f64) -> (Vector3<f64>, f64);

fn config(rate_hz: f64, settings: &Settings) -> PositionPidConfig {
    let bounds = PositionLawConfig::flight(50.0);
    let bounds = SetpointBounds {
        tilt_max_rad: bounds.tilt_max_rad,
        thrust_weights: [bounds.thrust_min_weights, bounds.thrust_max_weights],
        thrust_step_max_weights: bounds.thrust_step_max_weights,
    };
    settings.law_config(rate_hz, &bounds)
}

fn law(rate_hz: f64) -> PositionPidLaw {
    let config = config(rate_hz, &Settings::default());
    PositionPidLaw::new(config, &VehicleParameters::default()).unwrap()
}

/// The reference as a target, its motion by differences.
fn target(reference: Reference, t_s: f64, lead_s: f64) -> Target {
    let at = |t_s: f64| reference(t_s).0;
    let h = 1e-3;
    let ahead = t_s + lead_s;
    Target {
        position_w_m: at(t_s),
        velocity_w_m_s: (at(t_s + h) - at(t_s - h)) / (2.0 * h),
        acceleration_w_m_s2: (at(ahead + h) - at(ahead) * 2.0 + at(ahead - h)) / (h * h),
        yaw_rad: reference(t_s).1,
    }
}

/// Time \[s\] and position error \[m\] each millisecond.
fn fly(
    mut flight: Flight,
    settings: &Settings,
    (position_hz, attitude_hz): (f64, f64),
    seconds: f64,
    reference: Reference,
    mut script: impl FnMut(f64, &mut Flight),
) -> Vec<(f64, Vector3<f64>)> {
    let believed = VehicleParameters::default();
    let config = config(position_hz, settings);
    let mut position = PositionPidLaw::new(config, &believed).unwrap();
    let ramp = AttitudeLawConfig {
        setpoint_ramp_s: 1.0 / position_hz,
        ..AttitudeLawConfig::flight(attitude_hz)
    };
    let mut attitude = AttitudeLaw::new(ramp, &believed).unwrap();
    let mut in_effect = Setpoint { gamma_rad: Vector3::zeros(), thrust_n: believed.weight_n() };
    let mut coming: Option<(u64, Setpoint)> = None;
    let (mut p, mut a, mut tick, mut trace) = (0, 0, 0, Vec::new());
    while tick * MS < nanoseconds(seconds) {
        let (next_p, next_a) = (release_ns(p, position_hz), release_ns(a, attitude_hz));
        let next = next_p.min(next_a).min(tick * MS);
        let t_s = next as f64 * 1e-9;
        script(t_s, &mut flight);
        flight.advance(next);
        if let Some((_, setpoint)) = coming.take_if(|(at, _)| *at <= next) {
            in_effect = setpoint;
        }
        let (state, applied) = flight.sampled();
        let (gamma_rad, age_s) = (euler_from_quaternion(&state.q_wb), (next % MS) as f64 * 1e-9);
        if next == next_p {
            let output = position.step(&Input {
                position_w_m: state.position_w,
                velocity_w_m_s: state.velocity_w,
                gamma_rad,
                age_s,
                target: target(reference, t_s, config.lead_s),
                applied: Some(in_effect),
            });
            assert_within_bounds(&output);
            coming = Some((next + MS, output.setpoint));
            p += 1;
        }
        if next == next_a {
            let output = attitude.step(&attitude_mpc::Input {
                gamma_rad,
                body_rate_rad_s: state.omega_b,
                age_s,
                morph_angle: state.beta,
                setpoint: attitude_mpc::Setpoint {
                    gamma_rad: in_effect.gamma_rad,
                    thrust_n: in_effect.thrust_n,
                },
                applied_torque_nm: Some(applied),
            });
            flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
            a += 1;
        }
        if next == tick * MS {
            trace.push((t_s, flight.sampled().0.position_w - reference(t_s).0));
            tick += 1;
        }
    }
    trace
}

fn assert_within_bounds(output: &Output) {
    assert!(output.is_new);
    let report = output.command.bounded();
    assert!(report.worst_violation() <= 1e-15, "{output:?}");
}

fn worst_m(trace: &[(f64, Vector3<f64>)], from_s: f64) -> f64 {
    trace.iter().filter(|(t, _)| *t > from_s).map(|(_, e)| e.norm()).fold(0.0, f64::max)
}

fn stay(_: f64) -> (Vector3<f64>, f64) {
    (Vector3::zeros(), 0.0)
}

/// A figure of eight, 2 m by 1 m in 6 s, flown into over two seconds, while the heading turns.
fn eight(t: f64) -> (Vector3<f64>, f64) {
    let (s, ramp) = (t * std::f64::consts::TAU / 6.0, (0.5 * t).clamp(0.0, 1.0));
    let grow = ramp * ramp * ramp * (10.0 + ramp * (6.0 * ramp - 15.0));
    let rise = 0.2 * (1.0 - libm::cos(s));
    (Vector3::new(libm::sin(s), 0.5 * libm::sin(2.0 * s), rise) * grow, 0.7 * t)
}

#[test]
fn a_constant_force_leaves_no_position_error() {
    for rates in RATES {
        for beta in SIZES {
            let mut flight = Flight::hover(VehicleParameters::default(), beta);
            flight.disturbance.force_w_n = Vector3::new(0.15, -0.10, -0.20);
            let trace = fly(flight, &Settings::default(), rates, 10.0, stay, |_, _| {});
            let (worst, late) = (worst_m(&trace, 0.0), worst_m(&trace, 8.0));
            assert!(worst <= 0.25 && late <= 0.005, "{rates:?} {beta:?}: {worst} m, {late} m");
        }
    }
}

#[test]
fn half_as_much_mass_again_is_carried() {
    for rates in RATES {
        let believed = VehicleParameters::default();
        let mut flight = Flight::hover(believed, MorphAngle::MIN);
        let start = RigidBodyState::hover(&believed, Vector3::zeros(), MorphAngle::MIN);
        let heavy = VehicleParameters { mass_kg: 1.5 * believed.mass_kg, ..believed };
        flight.plant = NonlinearModel::new(heavy, None, start).unwrap();
        let trace = fly(flight, &Settings::default(), rates, 8.0, stay, |_, _| {});
        let (worst, late) = (worst_m(&trace, 0.0), worst_m(&trace, 7.0));
        assert!(worst <= 0.4 && late <= 0.01, "{rates:?}: {worst} m, {late} m");
    }
}

#[test]
fn a_figure_of_eight_with_sweeps_and_a_turning_heading_is_tracked() {
    for rates in RATES {
        let flight = Flight::hover(VehicleParameters::default(), MorphAngle::MIN);
        let trace = fly(flight, &Settings::default(), rates, 12.0, eight, |t, flight| {
            let large = (t % 4.0) >= 2.0;
            flight.morph_command = if large { MorphAngle::MAX } else { MorphAngle::MIN };
        });
        let worst = worst_m(&trace, 2.0);
        assert!(worst <= 0.08, "{rates:?}: {worst} m");
    }
}

#[test]
fn a_push_beyond_the_tilt_bound_does_not_wind_the_integral_up() {
    let pushed = |windup_s: f64| {
        let settings = Settings { windup_s, ..Settings::default() };
        let flight = Flight::hover(VehicleParameters::default(), MorphAngle::MIN);
        let trace = fly(flight, &settings, (50.0, 100.0), 12.0, stay, |t, flight| {
            let push_n = if (1.0..2.0).contains(&t) { 0.6 } else { 0.0 };
            flight.disturbance.force_w_n.x = push_n;
        });
        // Past the place it comes back to, on the other side.
        let beyond = trace.iter().map(|(_, error)| -error.x).fold(0.0, f64::max);
        (beyond, worst_m(&trace, 8.0))
    };
    let (with, without) = (pushed(Settings::default().windup_s), pushed(1e3));
    assert!(with.0 <= 0.7 * without.0, "{with:?}, without {without:?}");
    assert!(with.1 <= 0.05, "{with:?}, without {without:?}");
}

/// A busy made-up flight, with foreign set points.
fn busy(k: u32) -> Input {
    let wave = |rate: f64| libm::sin(rate * f64::from(k) * 0.02 + rate);
    Input {
        position_w_m: Vector3::new(wave(1.1), wave(0.7), wave(2.0)),
        velocity_w_m_s: Vector3::new(wave(3.0), wave(2.5), wave(4.0)),
        gamma_rad: Vector3::new(0.3 * wave(6.0), 0.2 * wave(5.0), 3.1 * wave(0.5)),
        age_s: 1e-4 * f64::from(k % 3),
        target: Target {
            position_w_m: Vector3::repeat(wave(1.0)),
            velocity_w_m_s: Vector3::repeat(wave(1.5)),
            acceleration_w_m_s2: Vector3::repeat(2.0 * wave(2.0)),
            yaw_rad: wave(0.4),
        },
        applied: k.is_multiple_of(4).then(|| Setpoint {
            gamma_rad: Vector3::new(0.4 * wave(7.0), 0.1, 0.0),
            thrust_n: 1.2 + 1.2 * wave(3.0),
        }),
    }
}

#[test]
fn a_fresh_instance_that_restores_the_memory_continues_bit_for_bit_within_bounds() {
    let (mut owner, mut successor) = (law(50.0), law(50.0));
    for k in 0..57 {
        owner.step(&busy(k));
    }
    successor.restore(owner.memory()).unwrap();
    for k in 57..300 {
        let output = owner.step(&busy(k));
        assert_within_bounds(&output);
        assert_eq!(output, successor.step(&busy(k)), "step {k}");
        assert_eq!(owner.memory(), successor.memory());
    }
    let mut broken = *owner.memory();
    broken.wish[1] = f64::NAN;
    assert!(successor.restore(&broken).is_err());
}

#[test]
fn no_step_allocates_and_unusable_input_holds_the_last_setpoint() {
    let mut law = law(50.0);
    let counted = allocation_counter::measure(|| {
        for k in 0..50 {
            law.track();
            law.step(&busy(k));
        }
        let memory = *law.memory();
        law.restore(&memory).unwrap();
    });
    assert_eq!(counted.count_total, 0);
    let last = law.step(&busy(51));
    let mut lost = busy(52);
    lost.velocity_w_m_s.z = f64::NAN;
    let held = law.step(&lost);
    assert!(!held.is_new && held.setpoint == last.setpoint);
    assert_eq!(law.memory().refused, 1);
    assert!(law.step(&busy(53)).is_new);
}

#[test]
fn a_shadow_continues_from_the_setpoint_in_effect_at_its_heading() {
    let mut shadow = law(50.0);
    let yaw = 2.2;
    let inclined = Setpoint { gamma_rad: Vector3::new(0.1, -0.2, yaw), thrust_n: 1.3 };
    // Where the vehicle is where it should be, nothing calls for a change.
    for _ in 0..5 {
        shadow.track();
        let output = shadow.step(&Input {
            position_w_m: Vector3::zeros(),
            velocity_w_m_s: Vector3::zeros(),
            gamma_rad: Vector3::new(0.0, 0.0, yaw),
            age_s: 0.0,
            target: Target {
                position_w_m: Vector3::zeros(),
                velocity_w_m_s: Vector3::zeros(),
                acceleration_w_m_s2: Vector3::zeros(),
                yaw_rad: yaw,
            },
            applied: Some(inclined),
        });
        let turned = output.setpoint.gamma_rad - inclined.gamma_rad;
        assert!(turned.amax() < 0.03, "a lean is answered through the lift: {turned}");
        assert!((output.setpoint.thrust_n - 1.3).abs() < 0.03, "{output:?}");
    }
}

#[test]
fn each_impossible_number_is_refused_by_name() {
    type Spoil = fn(&mut Settings);
    let cases: [(&str, Spoil); 5] = [
        ("rate_hz", |s| s.rate_hz = Some(1001.0)),
        ("position_gain_s", |s| s.position_gain_s[1] = 0.0),
        ("velocity_gain_s", |s| s.velocity_gain_s[2] = f64::NAN),
        ("tilt_max_rad", |s| s.tilt_max_rad = Some(1.0)),
        ("thrust_max_weights", |s| s.thrust_max_weights = Some(0.9)),
    ];
    for (name, spoil) in cases {
        let mut settings = Settings::default();
        spoil(&mut settings);
        let made = PositionPidLaw::new(config(50.0, &settings), &VehicleParameters::default());
        let error = made.unwrap_err();
        assert!(error.to_string().starts_with(name), "{error}");
    }
}
