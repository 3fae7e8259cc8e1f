//! A fix that arrives late counts as if it had come at once.

use estimator::{Filter, FilterConfig, InitialState, PoseFixSample, Verdict};

use super::world::{STEP_NS, Sensors, Truth, figure_eight};

fn filter_and_sensors(truth: &[Truth], seed: usize) -> (Filter, Sensors) {
    let mut sensors = Sensors::new(seed, &InitialState::default());
    let initial = sensors.initial(&truth[0]);
    (Filter::new(FilterConfig::default(), &initial).expect("default is valid"), sensors)
}

/// Largest difference of nominal states and covariances.
fn difference(left: &Filter, right: &Filter) -> f64 {
    let (a, b) = (left.estimate(), right.estimate());
    assert_eq!(a.time_ns, b.time_ns);
    (a.position_w - b.position_w)
        .norm()
        .max((a.velocity_w - b.velocity_w).norm())
        .max(a.q_wb.angle_to(&b.q_wb))
        .max((a.gyro_bias_b - b.gyro_bias_b).norm())
        .max((a.accel_bias_b - b.accel_bias_b).norm())
        .max((left.covariance() - right.covariance()).abs().max())
}

#[test]
fn a_late_fix_gives_what_an_undelayed_fix_and_propagation_give() {
    let truth = figure_eight(3);
    for latency in [1_usize, 10, 37, 63] {
        let (mut late, mut sensors) = filter_and_sensors(&truth, 8);
        let mut prompt = late.clone();
        let mut under_way = None;
        let mut compared = 0;
        for (step, truth) in truth.iter().enumerate() {
            let sample = sensors.imu(step, truth);
            late.on_imu(&sample);
            prompt.on_imu(&sample);
            if step % 70 == 0 {
                let fix = sensors.fix(step, truth);
                assert_eq!(prompt.on_pose_fix(&fix), Verdict::Accepted);
                assert!(difference(&late, &prompt) > 1e-6, "the fix must matter");
                under_way = Some(fix);
            }
            if step % 70 == latency
                && let Some(fix) = under_way.take()
            {
                assert_eq!(late.on_pose_fix(&fix), Verdict::Accepted);
                let apart = difference(&late, &prompt);
                assert!(apart <= 1e-9, "latency {latency}, step {step}: {apart:e}");
                compared += 1;
            }
        }
        assert!(compared >= 42);
    }
}

#[test]
fn a_fix_captured_between_two_samples_is_applied_at_its_own_instant() {
    // At 2 m/s half a sample is 1 mm: a filter that snaps to a sample would be biased by that.
    let truth = figure_eight(6);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 9);
    let mut sum = 0.0;
    let mut looks = 0.0;
    for step in 0..5990 {
        filter.on_imu(&sensors.imu(step, &truth[step]));
        if step % 10 == 5 && step > 20 {
            let (before, after) = (&truth[step - 11], &truth[step - 10]);
            let fix = PoseFixSample {
                captured_ns: (step as u64 - 10) * STEP_NS - STEP_NS / 2,
                position_w: (before.p + after.p) / 2.0,
                q_wb: before.q.slerp(&after.q, 0.5),
            };
            assert_eq!(filter.on_pose_fix(&fix), Verdict::Accepted);
        }
        if step > 3000 {
            let along = truth[step].v.normalize();
            sum += (filter.estimate().position_w - truth[step].p).dot(&along);
            looks += 1.0;
        }
    }
    assert!((sum / looks).abs() < 1e-4, "mean error along the path {}", sum / looks);
}

#[test]
fn fixes_out_of_order_too_old_or_from_the_future_are_refused_and_counted() {
    let truth = figure_eight(1);
    let (mut filter, mut sensors) = filter_and_sensors(&truth, 10);
    for (step, truth) in truth.iter().take(501).enumerate() {
        filter.on_imu(&sensors.imu(step, truth));
    }
    let mut at = |step: usize| sensors.fix(step, &truth[step]);
    let before = filter.estimate();
    assert_eq!(filter.on_pose_fix(&at(100)), Verdict::TooOld);
    assert_eq!(filter.on_pose_fix(&at(501)), Verdict::Ahead);
    assert_eq!(filter.estimate().position_w, before.position_w);
    assert_eq!(filter.on_pose_fix(&at(480)), Verdict::Accepted);
    let before = filter.estimate();
    assert_eq!(filter.on_pose_fix(&at(480)), Verdict::OutOfOrder);
    assert_eq!(filter.on_pose_fix(&at(470)), Verdict::OutOfOrder);
    let after = filter.estimate();
    assert_eq!(after.position_w, before.position_w);
    let counts = after.counters.pose_fix;
    assert_eq!((counts.accepted, counts.too_old, counts.ahead, counts.out_of_order), (1, 1, 1, 2));
}
