//! Drop-outs, jumps and wild fixes: the filter stays inside its promise and comes back.

use estimator::{Filter, FilterConfig, InitialState, Verdict};
use nalgebra::{UnitQuaternion, Vector3};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::consistency::{assert_consistent, means};
use super::world::{
    STEP_NS, STEPS_PER_FIX, Script, Sensors, error, figure_eight, fly, hover, nees,
};

#[test]
fn a_drop_out_of_two_seconds_stays_inside_three_sigma_and_recovers() {
    let truth = figure_eight(14);
    let (mut worst, mut worst_after, mut looks, mut outside) = (0.0_f64, 0.0_f64, 0.0, 0.0);
    for seed in 0..20 {
        let script = Script { drop_out: (8000, 10_000), ..Script::nominal(3000 + seed) };
        fly(&truth, &script, |instant| {
            let position = error(instant).fixed_rows::<3>(0).into_owned();
            // Until the first fix after the drop-out has arrived.
            if (8010..10_010).contains(&instant.step) {
                worst = worst.max(position.norm());
                let sigmas = instant.filter.estimate().sigmas;
                looks += 3.0;
                outside += (0..3).filter(|i| position[*i].abs() > 3.0 * sigmas[*i]).count() as f64;
            }
            if instant.step >= 12_000 {
                worst_after = worst_after.max(position.norm());
            }
            assert!(instant.filter.estimate().counters.nis_alarms == 0);
        });
    }
    println!("drop-out: worst {worst:.3} m, after {worst_after:.4} m, outside {outside}/{looks}");
    assert!(worst <= 0.4 && worst_after <= 0.05, "{worst} {worst_after}");
    // A Gaussian error is outside 3 sigma in 0.27 % of all cases; errors last, so whole runs are.
    assert!(outside <= 0.01 * looks, "{outside} of {looks}");
}

#[test]
fn fixes_noisier_than_configured_are_found_and_velocity_does_not_follow_them() {
    let truth = figure_eight(14);
    let worst_m_s = |fix_noise: f64| {
        let (mut worst, mut alarms) = (0.0_f64, 0);
        for seed in 0..10 {
            let script = Script { fix_noise, ..Script::nominal(4000 + seed) };
            let end = fly(&truth, &script, |instant| {
                if instant.step >= 4000 {
                    worst = worst.max(error(instant).fixed_rows::<3>(3).norm());
                }
            });
            alarms += end.estimate().counters.nis_alarms;
            assert_eq!(end.estimate().counters.reopened, 0, "noise is no wrong belief");
        }
        (worst, alarms)
    };
    let ((as_configured, none), (noisier, some)) = (worst_m_s(1.0), worst_m_s(1.3));
    println!(
        "velocity error: {as_configured:.4} m/s as configured, {noisier:.4} m/s at 1.3 times the noise"
    );
    assert!(none == 0 && some > 0, "{none} and {some} alarms");
    assert!(noisier <= 1.3 * as_configured, "{noisier} {as_configured}");
}

#[test]
fn a_drop_out_raises_the_flag_for_as_long_as_it_lasts() {
    let script = Script { drop_out: (2000, 2500), ..Script::nominal(1) };
    fly(&figure_eight(3), &script, |instant| {
        let overdue = instant.filter.estimate().alarms.fix_overdue;
        let wanted = (1990 + 100 + 1..2510).contains(&instant.step);
        assert_eq!(overdue, wanted, "step {}", instant.step);
    });
}

#[test]
fn half_a_minute_without_fixes_is_survived() {
    let truth = figure_eight(40);
    let script = Script { drop_out: (6000, 36_000), ..Script::nominal(3500) };
    fly(&truth, &script, |instant| {
        if instant.step >= 38_000 {
            assert!(error(instant).fixed_rows::<3>(0).norm() < 0.02);
            assert!(error(instant).fixed_rows::<3>(6).norm() < 5e-3);
        }
    });
}

#[test]
fn a_gap_in_the_inertial_samples_is_counted_and_recovered_from() {
    let truth = figure_eight(10);
    let script = Script { imu_gap: (5000, 5300), ..Script::nominal(3600) };
    let end = fly(&truth, &script, |instant| {
        if instant.step == 5310 || instant.step >= 7000 {
            assert!(nees(instant)[0] < 50.0, "step {}", instant.step);
        }
        if instant.step >= 7000 {
            assert!(error(instant).fixed_rows::<3>(0).norm() < 0.02);
        }
    });
    assert_eq!(end.estimate().counters.imu_gaps, 1);
    assert!(end.estimate().counters.pose_fix.ahead > 25);
}

#[test]
fn while_the_imu_is_silent_the_belief_keeps_its_instant_and_sigma_covers_the_error() {
    const GAP: std::ops::Range<usize> = 5000..5300;
    let truth = figure_eight(6);
    let script = Script { imu_gap: (GAP.start, GAP.end), ..Script::nominal(3600) };
    let (mut before, mut sigma) = (0, 0.0);
    fly(&truth, &script, |instant| {
        let now_ns = instant.step as u64 * STEP_NS;
        let estimate = instant.filter.estimate_at(now_ns);
        let silent_ns = now_ns - estimate.time_ns;
        assert_eq!(estimate.alarms.imu_overdue, silent_ns > 20_000_000, "step {}", instant.step);
        if !GAP.contains(&instant.step) {
            assert_eq!(estimate, instant.filter.estimate(), "step {}", instant.step);
            before = estimate.time_ns;
            return;
        }
        assert_eq!(estimate.time_ns, before, "the belief's instant moves without a sample");
        let attitude = error(instant).fixed_rows::<3>(6).norm();
        let sigma_rad = Vector3::from_column_slice(&estimate.sigmas[6..9]).norm();
        assert!(attitude < 3.0 * sigma_rad, "step {}: {attitude}, {sigma_rad}", instant.step);
        assert!(estimate.sigmas[6] >= sigma, "step {}", instant.step);
        sigma = estimate.sigmas[6];
        assert_eq!(estimate.counters.imu_gaps, u64::from(estimate.alarms.imu_overdue));
    });
    assert!(sigma > 0.5, "{sigma} rad after 0.3 s without a sample");
}

#[test]
fn a_jump_of_the_gyro_bias_alarms_reopens_and_is_learned_again() {
    const FLIP: usize = 10_000;
    const RUNS: usize = 50;
    let truth = figure_eight(20);
    let axes = [Vector3::x(), -Vector3::y(), Vector3::z(), Vector3::new(0.6, 0.0, -0.8)];
    let script = |seed: usize| Script {
        flip: (FLIP, axes[seed % axes.len()] * 0.02),
        ..Script::nominal(4000 + seed)
    };
    // 2500 looks: a sound filter exceeds this in one test of forty at most.
    let bound = ChiSquared::new(15.0).unwrap().inverse_cdf(1.0 - 1e-5);
    let mut alarm_steps = [None; RUNS];
    let (mut worst, mut gated) = (0.0_f64, 0);
    let means = means(&truth, RUNS, script, |seed, instant| {
        if instant.step < FLIP {
            return;
        }
        let estimate = instant.filter.estimate();
        let alarm_step = &mut alarm_steps[seed];
        if estimate.alarms.nis && alarm_step.is_none() {
            *alarm_step = Some(instant.step - FLIP);
            assert!(estimate.sigmas[9] >= 0.02 && estimate.sigmas[6] >= 0.01, "not re-opened");
        }
        worst = worst.max(error(instant).fixed_rows::<3>(6).norm());
        gated = gated.max(estimate.counters.pose_fix.gated);
        if instant.step >= FLIP + 5000 && instant.step % 100 == 0 {
            assert!(nees(instant)[0] < bound, "seed {seed}, step {}", instant.step);
        }
    });
    let latest = alarm_steps.iter().map(|step| step.expect("an alarm")).max().unwrap();
    println!("flip: alarm after at most {latest} ms, attitude {worst:.4} rad, gated {gated}");
    assert!(latest <= 500, "{latest}");
    assert!(worst <= 0.03, "{worst}");
    // 2000 fixes at 0.999 lose about two to the gate; ten in a row would be a lock-out.
    assert!(gated < 10, "{gated}");
    assert_consistent(&means, 15, 20, RUNS);
}

#[test]
fn a_step_of_the_tracker_frame_cannot_lock_the_gate() {
    let offset = Vector3::new(30.0, -20.0, 5.0);
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0);
    let truth = hover(8);
    let mut sensors = Sensors::new(5, &InitialState::default());
    let initial = sensors.initial(&truth[0]);
    let mut filter = Filter::new(FilterConfig::default(), &initial).unwrap();
    for (step, truth) in truth.iter().enumerate() {
        filter.on_imu(&sensors.imu(step, truth));
        if step % STEPS_PER_FIX == 0 {
            let mut fix = sensors.fix(step, truth);
            if step >= 2000 {
                fix.position_w = turn * fix.position_w + offset;
                fix.q_wb = turn * fix.q_wb;
            }
            filter.on_pose_fix(&fix);
        }
    }
    let estimate = filter.estimate();
    println!("frame step: {} fixes gated", estimate.counters.pose_fix.gated);
    assert!(estimate.counters.pose_fix.gated < 200);
    let wanted = turn * truth[0].p + offset;
    assert!((estimate.position_w - wanted).norm() < 0.02, "{}", estimate.position_w);
    assert!(estimate.q_wb.angle_to(&(turn * truth[0].q)) < 0.02);
}

#[test]
fn a_single_wild_fix_is_gated_and_moves_nothing() {
    let truth = hover(3);
    let mut sensors = Sensors::new(6, &InitialState::default());
    let initial = sensors.initial(&truth[0]);
    let mut filter = Filter::new(FilterConfig::default(), &initial).unwrap();
    for (step, truth) in truth.iter().enumerate() {
        filter.on_imu(&sensors.imu(step, truth));
        if step % STEPS_PER_FIX == 0 {
            let mut fix = sensors.fix(step, truth);
            if step == 2000 {
                let before = filter.estimate();
                fix.position_w.x += 0.5;
                assert_eq!(filter.on_pose_fix(&fix), Verdict::Gated);
                let after = filter.estimate();
                assert_eq!((after.position_w, after.q_wb), (before.position_w, before.q_wb));
                assert!(after.alarms.fix_gated);
            } else {
                filter.on_pose_fix(&fix);
            }
        }
    }
    assert_eq!(filter.estimate().counters.reopened, 0);
    assert_eq!(filter.estimate().counters.nis_alarms, 0);
}
