//! No allocation, exact restore, and no input that poisons the state.

use estimator::{
    ConfigError, Filter, FilterConfig, FilterMemory, ImuSample, InitialState, MemoryError,
    MorphAngleSample, PoseFixSample, Scalar, Verdict,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::world::{STEP_NS, STEPS_PER_FIX, Sensors, Truth, figure_eight};

fn filter_and_sensors(truth: &[Truth], seed: usize) -> (Filter, Sensors) {
    let mut sensors = Sensors::new(seed, &InitialState::default());
    let initial = sensors.initial(&truth[0]);
    (Filter::new(FilterConfig::default(), &initial).expect("default is valid"), sensors)
}

/// One tick with everything: inertial sample, late fix, encoder, heights.
fn tick(filters: &mut [&mut Filter], sensors: &mut Sensors, truth: &[Truth], step: usize) {
    let sample = sensors.imu(step, &truth[step]);
    let angle_rad = 1.0 + sensors.normal(1e-3).x;
    let (height_m, range_m) = (truth[step].p.z + 0.3 + sensors.normal(0.1).x, truth[step].p.z);
    let fix =
        (step % STEPS_PER_FIX == 3 && step > 20).then(|| sensors.fix(step - 10, &truth[step - 10]));
    for filter in filters {
        filter.on_imu(&sample);
        if step.is_multiple_of(5) {
            filter.on_morph_angle(&MorphAngleSample { time_ns: sample.time_ns, angle_rad });
        }
        if step % 20 == 4 {
            filter.on_scalar(Scalar::Barometer, sample.time_ns, height_m);
        }
        if step % 7 == 1 {
            filter.on_scalar(Scalar::RangeFinder, sample.time_ns, range_m);
        }
        if let Some(fix) = &fix {
            filter.on_pose_fix(fix);
        }
    }
}

#[test]
fn a_restored_filter_continues_bit_for_bit() {
    let truth = figure_eight(2);
    for cut in [0, 1, 7, 40, 63, 64, 65, 500, 1234] {
        let (mut original, mut sensors) = filter_and_sensors(&truth, 12);
        (0..cut).for_each(|step| tick(&mut [&mut original], &mut sensors, &truth, step));
        let memory = original.memory();
        let mut successor = Filter::new(FilterConfig::default(), &InitialState::default()).unwrap();
        successor.restore(&memory).unwrap();
        assert_eq!(successor.memory(), memory);
        for step in cut..truth.len() {
            tick(&mut [&mut original, &mut successor], &mut sensors, &truth, step);
            assert_eq!(original.estimate(), successor.estimate(), "cut {cut}, step {step}");
        }
        assert_eq!(original.memory(), successor.memory());
    }
}

#[test]
fn the_memory_is_small_enough_to_publish_often() {
    assert!(size_of::<FilterMemory>() < 16_000, "{}", size_of::<FilterMemory>());
    assert_eq!(size_of::<FilterMemory>() % 8, 0);
}

#[test]
fn no_step_allocates() {
    let truth = figure_eight(1);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 13);
    let counted = allocation_counter::measure(|| {
        (0..1000).for_each(|step| tick(&mut [&mut filter], &mut sensors, &truth, step));
        let memory = filter.memory();
        filter.restore(&memory).unwrap();
        let counters = filter.estimate().counters;
        assert!(counters.pose_fix.accepted > 90 && counters.scalars[0].accepted > 40);
    });
    assert_eq!(counted.count_total, 0);
}

#[test]
fn bad_samples_are_refused_counted_and_leave_the_estimate_alone() {
    let truth = figure_eight(1);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 14);
    (0..200).for_each(|step| tick(&mut [&mut filter], &mut sensors, &truth, step));
    let before = filter.estimate();
    let good = sensors.imu(200, &truth[200]);
    let with_gyro = |x| ImuSample { gyro_rad_s: Vector3::new(0.0, x, 0.0), ..good };
    let with_accel = |x| ImuSample { accel_m_s2: Vector3::new(0.0, 0.0, x), ..good };
    assert_eq!(filter.on_imu(&with_gyro(f64::NAN)), Verdict::NotFinite);
    assert_eq!(filter.on_imu(&with_accel(f64::INFINITY)), Verdict::NotFinite);
    assert_eq!(filter.on_imu(&with_gyro(35.1)), Verdict::OutOfRange);
    assert_eq!(filter.on_imu(&with_accel(-158.0)), Verdict::OutOfRange);
    assert_eq!(filter.on_imu(&ImuSample { time_ns: 199 * STEP_NS, ..good }), Verdict::OutOfOrder);
    assert_eq!(filter.on_imu(&ImuSample { time_ns: 5, ..good }), Verdict::OutOfOrder);
    let after = filter.estimate();
    let counts = after.counters.imu;
    assert_eq!((counts.not_finite, counts.out_of_range, counts.out_of_order), (2, 2, 2));
    assert_eq!(counts.refused(), 6);
    let restored = estimator::Estimate { counters: before.counters, ..after };
    assert_eq!(restored, before);
    assert_eq!(filter.on_imu(&good), Verdict::Accepted);
}

#[test]
fn a_bad_configuration_names_the_parameter() {
    let initial = InitialState::default();
    let new = |config| Filter::new(config, &initial).err();
    let config = FilterConfig { fix_position_sigma_m: 0.0, ..FilterConfig::default() };
    let wanted = ConfigError::NotPositive { name: "fix_position_sigma_m", value: 0.0 };
    assert_eq!(new(config), Some(wanted));
    let config = FilterConfig { fix_latency_ns: 100_000_000, ..FilterConfig::default() };
    assert!(matches!(new(config), Some(ConfigError::LatencyTooLong { .. })));
    let config = FilterConfig { nis_window: 33, ..FilterConfig::default() };
    assert_eq!(new(config), Some(ConfigError::Window(33)));
    let lost = InitialState { velocity_w: Vector3::new(f64::NAN, 0.0, 0.0), ..initial };
    let refused = Filter::new(FilterConfig::default(), &lost).err();
    assert_eq!(refused, Some(ConfigError::Initial("velocity_w")));
}

#[test]
fn a_memory_of_another_configuration_is_refused_and_changes_nothing() {
    let truth = figure_eight(1);
    let (mut long, mut sensors) = filter_and_sensors(&truth, 15);
    (0..900).for_each(|step| tick(&mut [&mut long], &mut sensors, &truth, step));
    let config = FilterConfig { nis_window: 5, ..FilterConfig::default() };
    let mut short = Filter::new(config, &InitialState::default()).unwrap();
    let before = short.memory();
    assert!(matches!(short.restore(&long.memory()), Err(MemoryError::OutOfRange(_))));
    assert_eq!(short.memory(), before);
}

fn any_vector() -> impl Strategy<Value = Vector3<f64>> {
    let component = prop_oneof![
        3 => -30.0..30.0,
        1 => any::<f64>(),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
    ];
    [component.clone(), component.clone(), component].prop_map(Vector3::from)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(64) })]

    #[test]
    fn no_sequence_of_samples_poisons_the_state(
        events in prop::collection::vec((0..6_u8, any_vector(), any_vector(), 0..60_000_000_u64), 1..200)
    ) {
        let mut filter = Filter::new(FilterConfig::default(), &InitialState::default()).unwrap();
        let mut now = 0_u64;
        for (kind, a, b, dt) in events {
            let back = now.saturating_sub(dt / 2);
            match kind {
                0 | 1 => {
                    now += dt / if kind == 0 { 50 } else { 1 };
                    filter.on_imu(&ImuSample { time_ns: now, gyro_rad_s: a, accel_m_s2: b });
                }
                2 => {
                    let raw = Quaternion::new(a.x, b.x, b.y, b.z);
                    let q_wb = if dt % 2 == 0 {
                        UnitQuaternion::new_unchecked(raw)
                    } else {
                        UnitQuaternion::identity()
                    };
                    filter.on_pose_fix(&PoseFixSample { captured_ns: back, position_w: a, q_wb });
                }
                3 => {
                    filter.on_scalar(Scalar::Barometer, back, a.x);
                }
                4 => {
                    filter.on_scalar(Scalar::RangeFinder, now.max(back), b.z);
                }
                _ => {
                    filter.on_morph_angle(&MorphAngleSample { time_ns: now, angle_rad: a.x });
                }
            }
            let estimate = filter.estimate();
            let numbers = [estimate.position_w, estimate.velocity_w, estimate.body_rate_b];
            prop_assert!(numbers.iter().flatten().all(|x| x.is_finite()));
            prop_assert!(estimate.sigmas.iter().all(|x| x.is_finite() && *x > 0.0));
            prop_assert!((estimate.q_wb.coords.norm() - 1.0).abs() < 1e-9);
            prop_assert!(estimate.beta_rad.is_finite() && estimate.beta_rate_rad_s.is_finite());
        }
    }
}
