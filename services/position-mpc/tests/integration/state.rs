//! The law's memory, its refusals, its bounds and its allocations.
#![allow(clippy::float_cmp, reason = "where bits must agree, bits are compared")]

use nalgebra::Vector3;
use position_mpc::{
    ConfigError, Horizon, Input, LawStatus, Memory, MpcError, PositionLaw, PositionLawConfig,
    Refusal, Setpoint, SolverKind, TiltBound,
};
use vehicle::VehicleParameters;

fn law(config: &PositionLawConfig) -> PositionLaw {
    PositionLaw::new(*config, &VehicleParameters::default()).unwrap()
}

fn wave(k: u32, rate: f64) -> f64 {
    libm::sin(rate * f64::from(k) * 0.02 + rate)
}

fn reference(k: u32) -> Vec<Vector3<f64>> {
    (0..k % 30).map(|j| Vector3::repeat(wave(k + j, 1.0))).collect()
}

/// A busy made-up flight: a reference of changing length, all headings, foreign setpoints.
fn input(k: u32, points: &[Vector3<f64>]) -> Input<'_> {
    Input {
        position_w_m: Vector3::new(wave(k, 1.1), wave(k, 0.7), wave(k, 2.0)),
        velocity_w_m_s: Vector3::new(wave(k, 3.0), wave(k, 2.5), wave(k, 4.0)),
        gamma_rad: Vector3::new(0.3 * wave(k, 6.0), 0.2 * wave(k, 5.0), 3.1 * wave(k, 0.5)),
        age_s: 1e-4 * f64::from(k % 3),
        reference_w_m: points,
        reference_yaw_rad: wave(k, 0.4),
        applied: k.is_multiple_of(4).then(|| Setpoint {
            gamma_rad: Vector3::new(0.4 * wave(k, 7.0), 0.1, 0.0),
            thrust_n: 1.2 + 1.2 * wave(k, 3.0),
        }),
    }
}

fn configurations() -> [PositionLawConfig; 4] {
    let flight = PositionLawConfig::default();
    let hildreth = PositionLawConfig { solver: SolverKind::Hildreth, ..flight };
    let cone = PositionLawConfig { tilt_bound: TiltBound::Cone, ..flight };
    [flight, PositionLawConfig::flight(100.0), hildreth, cone]
}

#[test]
fn a_fresh_instance_that_restores_the_memory_continues_bit_for_bit() {
    for config in configurations() {
        let mut owner = law(&config);
        for k in 0..57 {
            owner.step(&input(k, &reference(k)));
        }
        let memory: Memory = *owner.memory();
        let mut successor = law(&config);
        successor.restore(&memory).unwrap();
        for k in 57..140 {
            let points = reference(k);
            let (mine, theirs) =
                (owner.step(&input(k, &points)), successor.step(&input(k, &points)));
            assert_eq!(mine, theirs, "step {k}");
            assert_eq!(owner.memory(), successor.memory());
        }
    }
}

#[test]
fn bounds_hold_in_every_step_in_the_frame_without_heading() {
    for config in configurations() {
        let mut law = law(&config);
        for k in 0..300 {
            let output = law.step(&input(k, &reference(k)));
            let beyond =
                (output.command - output.command_max).sup(&(output.command_min - output.command));
            assert!(beyond.max() <= 0.0, "step {k}: {output:?}");
            let tilt = libm::atan(libm::hypot(output.command.x, output.command.y));
            let free = config.tilt_bound == TiltBound::Box;
            assert!(free || tilt <= config.tilt_max_rad + 1e-12, "step {k}: {tilt} rad");
            if config.solver == SolverKind::ActiveSet {
                assert_eq!(output.status, LawStatus::Solved);
                assert!(output.violation <= 1e-9, "step {k}: {output:?}");
            }
        }
        assert!(law.memory().counters.relaxed > 0, "the foreign setpoints lie outside");
    }
}

#[test]
fn no_step_allocates() {
    for config in configurations() {
        let mut law = law(&config);
        let points = reference(29);
        let counted = allocation_counter::measure(|| {
            for k in 0..50 {
                law.step(&input(k, &points));
            }
            let memory = *law.memory();
            law.restore(&memory).unwrap();
        });
        assert_eq!(counted.count_total, 0);
    }
}

#[test]
fn unusable_input_is_refused_and_the_last_setpoint_held() {
    let mut law = law(&PositionLawConfig::default());
    let points = [Vector3::new(0.1, 0.0, 0.0)];
    let last = law.step(&input(3, &points));
    let mut lost = input(5, &points);
    lost.velocity_w_m_s.z = f64::NAN;
    let nowhere = [Vector3::new(0.0, f64::INFINITY, 0.0)];
    for bad in [lost, input(6, &nowhere)] {
        let output = law.step(&Input { applied: None, ..bad });
        assert_eq!(output.status, LawStatus::Refused(Refusal::NotFinite));
        assert_eq!(output.setpoint, last.setpoint);
    }
    assert_eq!(law.memory().counters.refused, 2);
    assert_eq!(law.step(&input(7, &points)).status, LawStatus::Solved);
}

#[test]
fn a_reference_that_ends_is_held_at_its_last_point() {
    let mut with = law(&PositionLawConfig::default());
    let mut without = law(&PositionLawConfig::default());
    let point = Vector3::new(0.3, -0.2, 1.0);
    let all = [point; 20];
    for k in 0..10 {
        let long = with.step(&Input { applied: None, ..input(k, &all) });
        // One point, then none at all.
        let short = Input { applied: None, ..input(k, &all[..usize::from(k == 0)]) };
        assert_eq!(long, without.step(&short));
    }
}

#[test]
fn each_impossible_number_is_refused_by_name() {
    type Spoil = fn(&mut PositionLawConfig);
    let cases: [(&str, Spoil); 9] = [
        ("rate_hz", |c| c.rate_hz = 0.0),
        ("tilt_weight", |c| c.tilt_weight = -1.0),
        ("thrust_weight", |c| c.thrust_weight = f64::NAN),
        ("tilt_max_rad", |c| c.tilt_max_rad = 1.0),
        ("tilt_step_max_rad", |c| c.tilt_step_max_rad = 0.0),
        ("thrust_min_weights", |c| c.thrust_min_weights = 1.1),
        ("thrust_max_weights", |c| c.thrust_max_weights = 0.9),
        ("tilt_delay_s", |c| c.tilt_delay_s = 0.301),
        ("thrust_lag_s", |c| c.thrust_lag_s = f64::INFINITY),
    ];
    for (name, spoil) in cases {
        let mut config = PositionLawConfig::default();
        spoil(&mut config);
        let error = PositionLaw::new(config, &VehicleParameters::default()).unwrap_err();
        assert!(error.to_string().starts_with(name), "{error}");
    }
    let horizon = Horizon { prediction: 100, control: 51 };
    let config = PositionLawConfig { horizon, ..PositionLawConfig::default() };
    let error = PositionLaw::new(config, &VehicleParameters::default()).unwrap_err();
    assert_eq!(error, ConfigError::Engine(MpcError::ControlLimit { control: 51, limit: 50 }));
}

#[test]
fn a_shadow_of_another_kind_starts_from_the_setpoint_in_effect_at_its_heading() {
    let mut shadow = law(&PositionLawConfig::default());
    let yaw = 2.2;
    let inclined = Setpoint { gamma_rad: Vector3::new(0.1, -0.2, yaw), thrust_n: 1.3 };
    // Where the vehicle is where it should be, nothing calls for a change.
    for _ in 0..5 {
        let output = shadow.step(&Input {
            position_w_m: Vector3::zeros(),
            velocity_w_m_s: Vector3::zeros(),
            gamma_rad: inclined.gamma_rad,
            age_s: 0.0,
            reference_w_m: &[Vector3::zeros()],
            reference_yaw_rad: yaw,
            applied: Some(inclined),
        });
        assert!((output.setpoint.gamma_rad - inclined.gamma_rad).amax() < 1e-12);
        assert!((output.setpoint.thrust_n - 1.3).abs() < 1e-12);
    }
}

#[test]
fn after_many_samples_left_out_nothing_of_before_is_under_way() {
    let config = PositionLawConfig { tilt_delay_s: 0.07, ..PositionLawConfig::default() };
    // Near enough that the vehicle has not been lost by the other controller.
    let velocity_w_m_s = Vector3::repeat(0.02);
    let level = |k: u32| Input {
        position_w_m: Vector3::repeat(0.001 * f64::from(k)),
        velocity_w_m_s,
        gamma_rad: Vector3::zeros(),
        applied: None,
        ..input(k, &[])
    };
    let mut flown = law(&config);
    let mut held = Setpoint { gamma_rad: Vector3::zeros(), thrust_n: 1.0 };
    for k in 0..10 {
        held = flown.step(&level(k)).setpoint;
    }
    flown.leave_out(20);
    let ahead = [Vector3::repeat(0.05)];
    let command = |law: &mut PositionLaw, applied| {
        law.step(&Input { reference_w_m: &ahead, applied, ..level(30) }).command
    };
    let fresh = command(&mut law(&config), Some(held));
    let apart = command(&mut flown, Some(held)) - fresh;
    assert!(apart.amax() < 1e-9, "{apart}");
}

#[test]
fn a_light_vehicle_with_much_drag_behind_a_slow_attitude_loop_has_a_law() {
    let vehicle = VehicleParameters { mass_kg: 0.01, drag_n_s_m: 1.0, ..Default::default() };
    let config = PositionLawConfig { tilt_lag_s: 1.0, ..PositionLawConfig::default() };
    let mut law = PositionLaw::new(config, &vehicle).unwrap();
    let points = reference(29);
    assert!((0..20).all(|k| law.step(&input(k, &points)).status == LawStatus::Solved));
}
