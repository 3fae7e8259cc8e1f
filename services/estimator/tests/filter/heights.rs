//! Barometer and range finder: what they correct, and that readings are replayed with late fixes.

use estimator::{Filter, FilterConfig, InitialState, Scalar, Verdict};
use nalgebra::Vector3;

use super::world::{STEP_NS, Sensors, Truth, figure_eight, hover};

/// Steps between two readings: 50 Hz.
const STEPS_PER_READING: usize = 20;
/// Fixes are lost from here on.
const DROP_OUT_STEP: usize = 4000;

fn filter_and_sensors(truth: &[Truth], seed: usize) -> (Filter, Sensors) {
    let mut sensors = Sensors::new(seed, &InitialState::default());
    let initial = sensors.initial(&truth[0]);
    (Filter::new(FilterConfig::default(), &initial).expect("default is valid"), sensors)
}

fn range_m(truth: &Truth) -> f64 {
    truth.p.z / (truth.q * Vector3::z()).z
}

/// Error of the height and its 1σ \[m\] after ten seconds without fixes, with these sensors.
fn after_a_drop_out(truth: &[Truth], seed: usize, with: &[Scalar]) -> (f64, f64) {
    let (mut filter, mut sensors) = filter_and_sensors(truth, seed);
    let config = FilterConfig::default().barometer;
    let mut bias_m = sensors.normal(config.initial_bias_sigma_m).x;
    for (step, truth) in truth.iter().enumerate() {
        let time_ns = step as u64 * STEP_NS;
        filter.on_imu(&sensors.imu(step, truth));
        if step % 10 == 0 && step < DROP_OUT_STEP {
            filter.on_pose_fix(&sensors.fix(step, truth));
        }
        if step % STEPS_PER_READING == 0 {
            bias_m += sensors.normal(config.bias_walk_m_s_sqrt_hz * 0.02_f64.sqrt()).x;
            let height_m = truth.p.z + bias_m + sensors.normal(config.noise_m).x;
            let distance_m = range_m(truth) + sensors.normal(0.02).x;
            for of in with {
                let value = if *of == Scalar::Barometer { height_m } else { distance_m };
                filter.on_scalar(*of, time_ns, value);
            }
        }
    }
    let estimate = filter.estimate();
    (estimate.position_w.z - truth.last().expect("a flight").p.z, estimate.sigmas[2])
}

#[test]
fn heights_bound_the_drift_without_fixes_as_closely_as_they_claim() {
    let truth = figure_eight(14);
    let cases: [(&[Scalar], f64, f64); 4] = [
        (&[], 0.05, 3.0),
        (&[Scalar::Barometer], 0.03, 0.06),
        (&[Scalar::RangeFinder], 0.002, 0.01),
        (&[Scalar::Barometer, Scalar::RangeFinder], 0.002, 0.01),
    ];
    let mut claimed_m = Vec::new();
    for (with, least_m, most_m) in cases {
        let flown: Vec<_> = (0..60).map(|seed| after_a_drop_out(&truth, seed, with)).collect();
        let sigma_m = flown[0].1;
        println!("{with:?}: 1 sigma of the height after ten seconds without a fix: {sigma_m:.4} m");
        assert!((least_m..most_m).contains(&sigma_m), "{with:?}: claims {sigma_m} m");
        claimed_m.push(sigma_m);
        // Mean of 60 squares: χ²(60)/60 lies within 0.6 and 1.5 but for one time in a hundred.
        let share = |(error, sigma): &(f64, f64)| (error / sigma) * (error / sigma);
        let nees = flown.iter().map(share).sum::<f64>() / 60.0;
        assert!((0.55..1.6).contains(&nees), "{with:?}: {nees}");
    }
    let [none, barometer, finder, both] = claimed_m[..] else { panic!("four cases") };
    assert!(none > 1.4 * barometer && barometer > 4.0 * finder && finder >= both, "{claimed_m:?}");
}

#[test]
fn a_late_fix_and_the_readings_since_give_what_an_undelayed_fix_gives() {
    let truth = figure_eight(3);
    let (mut late, mut sensors) = filter_and_sensors(&truth, 8);
    let mut prompt = late.clone();
    let (mut under_way, mut compared) = (None, 0);
    for (step, truth) in truth.iter().enumerate() {
        let time_ns = step as u64 * STEP_NS;
        let sample = sensors.imu(step, truth);
        let fix = (step % 70 == 0).then(|| sensors.fix(step, truth));
        let height_m = truth.p.z + 0.3 + sensors.normal(0.1).x;
        let distance_m = range_m(truth) + sensors.normal(0.02).x;
        for filter in [&mut late, &mut prompt] {
            filter.on_imu(&sample);
        }
        if let Some(fix) = fix {
            assert_eq!(prompt.on_pose_fix(&fix), Verdict::Accepted);
            under_way = Some(fix);
        }
        // Never at the instant of a fix, where the order would be another.
        if step % 7 == 3 {
            for filter in [&mut late, &mut prompt] {
                filter.on_scalar(Scalar::Barometer, time_ns, height_m);
                filter.on_scalar(Scalar::RangeFinder, time_ns, distance_m);
            }
        }
        if step % 70 == 37
            && let Some(fix) = under_way.take()
        {
            assert_eq!(late.on_pose_fix(&fix), Verdict::Accepted);
            let (a, b) = (late.estimate(), prompt.estimate());
            let apart = (a.position_w - b.position_w).norm().max(a.q_wb.angle_to(&b.q_wb));
            let covariances = (late.covariance() - prompt.covariance()).abs().max();
            assert!(apart.max(covariances) < 1e-9, "{step}: {apart:e}, {covariances:e}");
            compared += 1;
        }
    }
    assert!(compared >= 42);
}

#[test]
fn a_restored_filter_goes_on_with_its_biases_and_readings_bit_for_bit() {
    let truth = figure_eight(2);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 3);
    let mut twin = filter.clone();
    for (step, truth) in truth.iter().enumerate() {
        if step % 100 == 15 {
            let memory = filter.memory();
            twin =
                Filter::new(FilterConfig::default(), &InitialState::default()).expect("a filter");
            twin.restore(&memory).expect("its own memory");
        }
        let (sample, fix) = (sensors.imu(step, truth), sensors.fix(step, truth));
        let height_m = truth.p.z - 0.4 + sensors.normal(0.1).x;
        for filter in [&mut filter, &mut twin] {
            filter.on_imu(&sample);
            if step % 10 == 0 {
                filter.on_pose_fix(&fix);
            }
            if step % STEPS_PER_READING == 0 {
                filter.on_scalar(Scalar::Barometer, step as u64 * STEP_NS, height_m);
            }
        }
        assert_eq!(filter.memory(), twin.memory(), "{step}");
    }
    assert!(filter.estimate().counters.scalars[0].accepted >= 98);
}

#[test]
fn readings_that_no_sensor_can_mean_are_refused_and_counted() {
    let truth = hover(1);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 1);
    for (step, truth) in truth[..100].iter().enumerate() {
        filter.on_imu(&sensors.imu(step, truth));
    }
    let now_ns = 99 * STEP_NS;
    let mut at = |time_ns, value| filter.on_scalar(Scalar::RangeFinder, time_ns, value);
    assert_eq!(at(now_ns, f64::NAN), Verdict::NotFinite);
    assert_eq!(at(now_ns, -0.1), Verdict::OutOfRange);
    assert_eq!(at(now_ns, 1e4), Verdict::OutOfRange);
    assert_eq!(at(now_ns + 2 * STEP_NS, 1.0), Verdict::Ahead);
    assert_eq!(at(now_ns + STEP_NS, 1.0), Verdict::Accepted, "less than a period ahead");
    assert_eq!(at(now_ns, 1.0), Verdict::OutOfOrder);
    let counts = filter.estimate().counters.scalars[1];
    assert_eq!((counts.accepted, counts.refused()), (1, 5));
}

#[test]
fn what_stands_on_the_ground_is_taken_for_no_height() {
    let truth = hover(3);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 4);
    for (step, truth) in truth.iter().enumerate() {
        filter.on_imu(&sensors.imu(step, truth));
        if step % 10 == 0 {
            filter.on_pose_fix(&sensors.fix(step, truth));
        }
        if step % STEPS_PER_READING == 0 {
            // A table of 0.7 m is below for the second second.
            let table_m = if (1000..2000).contains(&step) { 0.7 } else { 0.0 };
            let verdict = filter.on_scalar(
                Scalar::RangeFinder,
                step as u64 * STEP_NS,
                range_m(truth) - table_m,
            );
            let expected = if table_m > 0.0 { Verdict::Gated } else { Verdict::Accepted };
            assert_eq!(verdict, expected, "{step}");
        }
    }
    assert!((filter.estimate().position_w.z - 1.0).abs() < 0.005);
}

#[test]
fn a_late_reading_has_its_own_verdict_and_a_silent_imu_refuses_it() {
    let truth = hover(2);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 5);
    for (step, truth) in truth[..500].iter().enumerate() {
        filter.on_imu(&sensors.imu(step, truth));
        if step % 10 == 0 {
            filter.on_pose_fix(&sensors.fix(step, truth));
        }
    }
    let at = |step: u64| step * STEP_NS;
    assert_eq!(filter.on_scalar(Scalar::Barometer, at(498), 1.2), Verdict::Accepted);
    let before = filter.estimate();
    assert_eq!(filter.on_scalar(Scalar::RangeFinder, at(496), 2.0), Verdict::Gated);
    assert_eq!(filter.estimate().position_w, before.position_w);
    assert_eq!(filter.on_scalar(Scalar::RangeFinder, at(497), 1.0), Verdict::Accepted);
    // The last inertial sample is of step 499.
    assert_eq!(filter.on_scalar(Scalar::RangeFinder, at(501), 1.0), Verdict::Ahead);
}

#[test]
fn a_bias_that_has_jumped_is_opened_again_after_some_refusals() {
    let truth = hover(6);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 2);
    let mut verdicts = Vec::new();
    for (step, truth) in truth.iter().enumerate() {
        let time_ns = step as u64 * STEP_NS;
        filter.on_imu(&sensors.imu(step, truth));
        if step % 10 == 0 {
            filter.on_pose_fix(&sensors.fix(step, truth));
        }
        if step % STEPS_PER_READING == 0 {
            let bias_m = if step < 3000 { 0.2 } else { 1.5 };
            let height_m = truth.p.z + bias_m + sensors.normal(0.1).x;
            verdicts.push(filter.on_scalar(Scalar::Barometer, time_ns, height_m));
        }
    }
    let gated = verdicts.iter().filter(|verdict| **verdict == Verdict::Gated).count();
    assert!((10..=25).contains(&gated), "{gated}");
    assert_eq!(verdicts.last(), Some(&Verdict::Accepted));
    assert!((filter.estimate().position_w.z - 1.0).abs() < 0.01);
}
