use statrs::statistics::Statistics;

use super::*;
use crate::sensors::DropOut;

const MS: u64 = 1_000_000;

fn level() -> Pose {
    Pose { position_w_m: Vector3::zeros(), q_wb: UnitQuaternion::identity() }
}

/// Moves along x at 1 m/s, so that a position shows when it was true.
fn moving(now_ns: u64) -> Pose {
    Pose { position_w_m: Vector3::new(now_ns as f64 * 1e-9, 0.0, 0.0), ..level() }
}

/// (tick it came out of, fix) for a plant that ticks every `step_ns`.
fn fly(config: &PoseFixConfig, step_ns: u64, until_ns: u64) -> Vec<(u64, PoseSample)> {
    let mut tracker = PoseFix::new(config, 4).unwrap();
    let mut fixes = Vec::new();
    for now_ns in (0..until_ns).step_by(usize::try_from(step_ns).unwrap()) {
        tracker.capture(now_ns, &moving(now_ns));
        while let Some(fix) = tracker.deliver(now_ns) {
            fixes.push((now_ns, fix));
        }
    }
    fixes
}

#[test]
fn a_fix_is_stamped_at_capture_and_arrives_one_latency_later() {
    let config = PoseFixConfig { noise_free: true, ..PoseFixConfig::default() };
    let fixes = fly(&config, MS, 1000 * MS);
    assert_eq!(fixes.len(), 99);
    for (k, (now_ns, fix)) in (0..).zip(&fixes) {
        assert_eq!(fix.captured_ns, k * 10 * MS);
        assert_eq!((fix.arrived_ns, *now_ns), ((k + 1) * 10 * MS, (k + 1) * 10 * MS));
        assert_eq!(fix.pose, moving(fix.captured_ns));
    }
}

#[test]
fn at_150_hz_the_captures_fall_on_its_own_instants_or_the_next_tick() {
    let config = PoseFixConfig { rate_hz: 150, noise_free: true, ..PoseFixConfig::default() };
    let mut tracker = PoseFix::new(&config, 4).unwrap();
    tracker.capture(0, &level());
    assert_eq!(tracker.next_capture_ns(), 6_666_666);
    tracker.capture(6_666_666, &moving(6_666_666));
    assert_eq!(tracker.next_capture_ns(), 13_333_333);
    assert_eq!(tracker.deliver(16_666_665).map(|fix| fix.captured_ns), Some(0));
    assert_eq!(tracker.deliver(16_666_665), None);
    assert_eq!(tracker.deliver(16_666_666).map(|fix| fix.captured_ns), Some(6_666_666));

    let fixes = fly(&config, MS, 2000 * MS);
    // Captures at 0, 7, 14, 20 ms ...: the stamp is the instant that was seen.
    let stamps: Vec<u64> = fixes.iter().take(4).map(|(_, fix)| fix.captured_ns / MS).collect();
    assert_eq!(stamps, [0, 7, 14, 20]);
    assert!((297..=300).contains(&fixes.len()));
    assert!(fixes.iter().all(|(_, fix)| fix.pose == moving(fix.captured_ns)));
}

#[test]
fn the_noise_has_the_configured_spread() {
    let truth = Pose {
        position_w_m: Vector3::new(1.0, -2.0, 3.0),
        q_wb: vehicle::quaternion_from_euler(&Vector3::new(0.2, -0.3, 2.9)),
    };
    let mut tracker = PoseFix::new(&PoseFixConfig::default(), 4).unwrap();
    let (mut position, mut attitude) = (Vec::new(), Vec::new());
    for k in 0..10_000_u64 {
        tracker.capture(k * 10 * MS, &truth);
        if let Some(fix) = tracker.deliver(k * 10 * MS) {
            let error = truth.q_wb.inverse() * fix.pose.q_wb;
            position.extend((fix.pose.position_w_m - truth.position_w_m).iter());
            attitude.extend(error.scaled_axis().iter());
            assert!(fix.pose.q_wb.w >= 0.0 && (fix.pose.q_wb.norm() - 1.0).abs() < 1e-12);
        }
    }
    // 30 000 numbers each: σ is known to 0.4 %, the mean to 0.6 % of σ.
    for (errors, sigma) in [(position, 0.002), (attitude, 0.003)] {
        assert!((errors.as_slice().std_dev() / sigma - 1.0).abs() < 0.02);
        assert!((errors.as_slice().mean() / sigma).abs() < 0.03);
    }
}

#[test]
fn a_scheduled_drop_out_loses_its_captures_and_changes_no_other() {
    let drop_outs = vec![DropOut { from_s: 0.2, until_s: 0.5 }];
    let whole = fly(&PoseFixConfig::default(), MS, 1000 * MS);
    let holed = fly(&PoseFixConfig { drop_outs, ..PoseFixConfig::default() }, MS, 1000 * MS);
    let expected: Vec<_> = whole
        .into_iter()
        .filter(|(_, fix)| !(200 * MS..500 * MS).contains(&fix.captured_ns))
        .collect();
    assert_eq!(holed, expected);
    assert_eq!(holed.len(), 69);
}

#[test]
fn random_drop_outs_lose_the_configured_share() {
    let share = |drop_out_probability| {
        let config = PoseFixConfig { drop_out_probability, ..PoseFixConfig::default() };
        fly(&config, 10 * MS, 100_010 * MS).len()
    };
    assert_eq!((share(0.0), share(1.0)), (10_000, 0));
    // Binomial, n = 10 000, p = 0.7: 1 σ is 46.
    assert!((6800..=7200).contains(&share(0.3)));
}

#[test]
fn a_line_that_cannot_hold_the_latency_is_refused_and_one_that_can_is_not() {
    let refused = PoseFixConfig { rate_hz: 10_000, ..PoseFixConfig::default() };
    let message = PoseFix::new(&refused, 1).unwrap_err().to_string();
    assert!(message.contains("101") && message.contains("latency_s = 0.01"), "{message}");

    let full = PoseFixConfig { rate_hz: 1000, latency_s: 0.031, ..PoseFixConfig::default() };
    assert_eq!(fly(&full, MS, 1000 * MS).len(), 1000 - 31);
    let no_latency = PoseFixConfig { latency_s: 0.0, ..PoseFixConfig::default() };
    assert_eq!(fly(&no_latency, MS, 1000 * MS).len(), 100);
}

#[test]
fn a_caller_that_never_asks_keeps_the_newest_fixes_and_nan_is_lost() {
    let config = PoseFixConfig { noise_free: true, ..PoseFixConfig::default() };
    let mut tracker = PoseFix::new(&config, 4).unwrap();
    for k in 0..100 {
        tracker.capture(k * 10 * MS, &moving(k * 10 * MS));
    }
    let bad = Pose { position_w_m: Vector3::new(f64::NAN, 0.0, 0.0), ..level() };
    tracker.capture(1000 * MS, &bad);
    let kept: Vec<u64> = std::iter::from_fn(|| tracker.deliver(u64::MAX))
        .map(|fix| fix.captured_ns / (10 * MS))
        .collect();
    assert_eq!(kept, (68..100).collect::<Vec<u64>>());
}

#[test]
fn a_restored_tracker_continues_bit_for_bit_with_fixes_under_way() {
    let config = PoseFixConfig {
        rate_hz: 300,
        latency_s: 0.02,
        drop_out_probability: 0.2,
        ..PoseFixConfig::default()
    };
    let mut tracker = PoseFix::new(&config, 4).unwrap();
    let mut twin = tracker.clone();
    let count = allocation_counter::measure(|| {
        for now_ns in (0..500).map(|ms| ms * MS) {
            twin.restore(&tracker.memory());
            tracker.capture(now_ns, &moving(now_ns));
            twin.capture(now_ns, &moving(now_ns));
            assert_eq!(tracker.deliver(now_ns), twin.deliver(now_ns));
            assert_eq!(tracker.memory(), twin.memory());
        }
    });
    assert_eq!(count.count_total, 0);
}
