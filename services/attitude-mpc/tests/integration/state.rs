//! The law's memory, its refusals and its allocations.
#![allow(clippy::float_cmp, reason = "where bits must agree, bits are compared")]

use attitude_mpc::{
    AttitudeLaw, AttitudeLawConfig, Basis, ConfigError, Horizon, HorizonChoice, Input, LawStatus,
    Memory, MpcError, Refusal, Setpoint, SolverKind, TorqueBound,
};
use nalgebra::Vector3;
use vehicle::{MorphAngle, VehicleParameters, Wrench};

fn law(config: &AttitudeLawConfig) -> AttitudeLaw {
    AttitudeLaw::new(*config, &VehicleParameters::default()).unwrap()
}

/// A busy made-up flight: setpoints, morphing, clipped torques, sometimes no report.
fn input(k: u32) -> Input {
    let t = f64::from(k) * 0.01;
    let wave = |rate: f64, phase: f64| libm::sin(rate * t + phase);
    Input {
        gamma_rad: Vector3::new(0.2 * wave(5.0, 0.1), 0.3 * wave(4.0, 1.0), 3.5 * wave(2.0, 0.0)),
        body_rate_rad_s: Vector3::new(wave(5.0, 1.6), wave(4.0, 2.0), 6.0 * wave(2.0, 1.5)),
        age_s: 1e-4 * f64::from(k % 3),
        morph_angle: MorphAngle::saturating_from_rad(1.8 + wave(3.0, 0.0)).unwrap(),
        setpoint: Setpoint {
            gamma_rad: Vector3::new(0.3 * wave(1.0, f64::from(k / 7)), 0.1, wave(0.5, 0.0)),
            thrust_n: 1.2 + 0.8 * wave(7.0, 0.0),
        },
        applied_torque_nm: (!k.is_multiple_of(5)).then(|| Vector3::repeat(0.03 * wave(6.0, 0.3))),
    }
}

fn configurations() -> [AttitudeLawConfig; 7] {
    let flight = AttitudeLawConfig::default();
    [
        flight,
        AttitudeLawConfig::paper(),
        AttitudeLawConfig { solver: SolverKind::Hildreth, ..flight },
        AttitudeLawConfig { rebuild_tolerance_rad: 0.05, ..flight },
        AttitudeLawConfig::flight(1000.0),
        AttitudeLawConfig { torque_bound: TorqueBound::RotorThrusts, ..flight },
        AttitudeLawConfig {
            laguerre: Some([Basis::Laguerre { pole: 0.3, terms: 3 }; 3]),
            ..flight
        },
    ]
}

#[test]
fn a_fresh_instance_that_restores_the_memory_continues_bit_for_bit() {
    for config in configurations() {
        let mut owner = law(&config);
        for k in 0..57 {
            owner.step(&input(k));
        }
        let memory: Memory = *owner.memory();
        let mut successor = law(&config);
        successor.restore(&memory).unwrap();
        for k in 57..140 {
            assert_eq!(owner.step(&input(k)), successor.step(&input(k)), "step {k}, {config:?}");
            assert_eq!(owner.memory(), successor.memory());
        }
    }
}

#[test]
fn bounds_hold_in_every_step_whatever_is_asked() {
    for config in configurations() {
        let mut law = law(&config);
        let (mut relaxed, vehicle) = (false, VehicleParameters::default());
        for k in 0..300 {
            let output = law.step(&input(k));
            let excess = output.torque_nm.abs() - output.torque_bound_nm;
            assert!(excess.max() <= 0.0, "step {k}: {output:?}");
            if config.torque_bound == TorqueBound::RotorThrusts {
                let wrench = Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm };
                let allocator = vehicle.allocator(input(k).morph_angle);
                for thrust in allocator.unlimited_thrusts(&wrench) {
                    let inside = -1e-9..=vehicle.rotor_thrust_max_n + 1e-9;
                    assert!(inside.contains(&thrust), "step {k}: {thrust}");
                }
            }
            if config.solver == SolverKind::ActiveSet {
                assert_eq!(output.status, LawStatus::Solved);
                assert!(output.violation_nm <= 1e-9, "step {k}: {output:?}");
            }
            relaxed |= output.relaxation_nm.max() > 0.0;
        }
        let counters = law.memory().counters;
        assert_eq!(counters.relaxed > 0, relaxed);
        assert_eq!(counters.steps, 300);
    }
}

#[test]
fn no_step_allocates_even_when_the_model_is_rebuilt() {
    for config in configurations() {
        let mut law = law(&config);
        let mut flown = AttitudeLaw::new(config, &VehicleParameters::default()).unwrap();
        flown.step(&input(0));
        let counted = allocation_counter::measure(|| {
            for k in 0..50 {
                law.step(&input(k));
            }
            let memory = *law.memory();
            flown.restore(&memory).unwrap();
        });
        assert_eq!(counted.count_total, 0, "{config:?}");
    }
}

#[test]
fn unusable_input_is_refused_and_the_last_command_held() {
    let mut law = law(&AttitudeLawConfig::default());
    let last = law.step(&input(3));
    let mut steep = input(4);
    steep.gamma_rad.y = -1.21;
    let mut lost = input(5);
    lost.body_rate_rad_s.z = f64::NAN;
    let mut endless = input(6);
    endless.setpoint.thrust_n = f64::INFINITY;
    let cases =
        [(steep, Refusal::SteepPitch), (lost, Refusal::NotFinite), (endless, Refusal::NotFinite)];
    for (bad, refusal) in cases {
        let output = law.step(&bad);
        assert_eq!(output.status, LawStatus::Refused(refusal));
        assert_eq!((output.torque_nm, output.thrust_n), (last.torque_nm, last.thrust_n));
    }
    assert_eq!(law.memory().counters.refused, 3);
    assert_eq!(law.step(&input(7)).status, LawStatus::Solved);
}

#[test]
fn a_report_that_is_not_finite_counts_as_none() {
    let (mut with, mut without) =
        (law(&AttitudeLawConfig::default()), law(&AttitudeLawConfig::default()));
    for k in 0..20 {
        let nan = Some(Vector3::new(0.0, f64::NAN, 0.0));
        let bad = with.step(&Input { applied_torque_nm: nan, ..input(k) });
        assert_eq!(bad, without.step(&Input { applied_torque_nm: None, ..input(k) }));
    }
}

#[test]
fn the_horizon_in_seconds_gives_the_recommended_counts() {
    let samples = |prediction, control| HorizonChoice::Samples(Horizon { prediction, control });
    let pairs = [
        (50.0, 20, 3),
        (100.0, 20, 3),
        (150.0, 20, 3),
        (250.0, 30, 3),
        (500.0, 60, 6),
        (1e3, 120, 12),
    ];
    for (rate_hz, prediction, control) in pairs {
        let seconds = AttitudeLawConfig { rate_hz, ..AttitudeLawConfig::default() };
        let counts = AttitudeLawConfig { horizon: samples(prediction, control), ..seconds };
        let (mut by_time, mut by_count) = (law(&seconds), law(&counts));
        for k in 0..10 {
            assert_eq!(by_time.step(&input(k)), by_count.step(&input(k)));
        }
    }
}

#[test]
fn each_impossible_number_is_refused_by_name() {
    type Spoil = fn(&mut AttitudeLawConfig);
    let cases: [(&str, Spoil); 8] = [
        ("rate_hz", |c| c.rate_hz = 1001.0),
        ("increment_weight", |c| c.increment_weight = 0.0),
        ("yaw_weight_factor", |c| c.yaw_weight_factor = f64::NAN),
        ("rotor_lag_s", |c| c.rotor_lag_s = -0.015),
        ("command_delay_s", |c| c.command_delay_s = 0.011),
        ("report_period_s", |c| c.report_period_s = -1.0),
        ("setpoint_ramp_s", |c| c.setpoint_ramp_s = f64::INFINITY),
        ("horizon_s", |c| c.horizon = HorizonChoice::Seconds(0.0)),
    ];
    for (name, spoil) in cases {
        let mut config = AttitudeLawConfig::default();
        spoil(&mut config);
        let error = AttitudeLaw::new(config, &VehicleParameters::default()).unwrap_err();
        assert!(error.to_string().starts_with(name), "{error}");
    }
    let horizon = HorizonChoice::Samples(Horizon { prediction: 100, control: 51 });
    let config = AttitudeLawConfig { horizon, ..AttitudeLawConfig::default() };
    let error = AttitudeLaw::new(config, &VehicleParameters::default()).unwrap_err();
    assert_eq!(error, ConfigError::Engine(MpcError::ControlLimit { control: 51, limit: 50 }));
    let config = AttitudeLawConfig {
        horizon: HorizonChoice::Samples(Horizon { prediction: 200, control: 20 }),
        angle_max_rad: Some(0.4),
        rate_max_rad_s: Some(9.0),
        ..AttitudeLawConfig::default()
    };
    let error = AttitudeLaw::new(config, &VehicleParameters::default()).unwrap_err();
    assert_eq!(error, ConfigError::Engine(MpcError::Rows { rows: 1317, limit: 1024 }));
}

#[test]
fn a_shadow_of_another_kind_starts_from_the_torque_in_effect() {
    let mut shadow = law(&AttitudeLawConfig::default());
    let torque = Vector3::new(0.02, -0.01, 0.004);
    // Where the vehicle is where it should be, nothing calls for a change.
    let settled = Input {
        gamma_rad: Vector3::zeros(),
        body_rate_rad_s: Vector3::zeros(),
        age_s: 0.0,
        morph_angle: MorphAngle::MIN,
        setpoint: Setpoint { gamma_rad: Vector3::zeros(), thrust_n: 1.2 },
        applied_torque_nm: Some(torque),
    };
    for _ in 0..5 {
        assert!((shadow.step(&settled).torque_nm - torque).amax() < 1e-12);
    }
}
