//! Pieces and samples that users bring, against powers, closed forms and refusals.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "powers below 8 and instants of seconds"
)]

use super::{MS, distance, round};
use crate::{COEFFICIENTS, PathSample, Piece, PilotError, Trajectory, TrajectoryConfig};
use core::f64::consts::{PI, TAU};

/// Coefficients of a motion that never rests; the higher the power, the smaller they are.
fn coefficients(seed: f64) -> [f64; COEFFICIENTS] {
    core::array::from_fn(|k| (seed + 1.7 * k as f64).sin() / f64::from(1 << k))
}

fn piece(duration_s: f64) -> Piece {
    let position_w = [0.3, 1.1, 2.9].map(coefficients);
    Piece { duration_s, position_w, yaw: coefficients(4.0) }
}

/// Σ c t^k and its derivatives, power by power.
fn powers(c: &[f64; COEFFICIENTS], t: f64) -> [f64; 3] {
    let sum = |order: i32| {
        let term = |(k, c): (i32, &f64)| {
            let factor = (0..order).map(|i| f64::from(k - i)).product::<f64>();
            if k < order { 0.0 } else { c * factor * t.powi(k - order) }
        };
        (0..).zip(c).map(term).sum()
    };
    [sum(0), sum(1), sum(2)]
}

/// What goes on from the end of `piece` for another second: the same polynomial, moved.
fn next(piece: &Piece) -> Piece {
    let shifted = |c: &[f64; COEFFICIENTS]| {
        let binomial = |n: usize, k: usize| {
            (0..k).fold(1.0, |product, i| product * (n - i) as f64 / (i + 1) as f64)
        };
        core::array::from_fn(|k| {
            (k..COEFFICIENTS)
                .map(|n| c[n] * binomial(n, k) * piece.duration_s.powi((n - k) as i32))
                .sum()
        })
    };
    Piece {
        duration_s: 1.0,
        position_w: piece.position_w.each_ref().map(shifted),
        yaw: shifted(&piece.yaw),
    }
}

#[test]
fn pieces_are_the_sums_of_their_powers_across_joints() {
    let first = piece(0.7);
    let config = TrajectoryConfig::Pieces(vec![first, next(&first)]);
    let trajectory = Trajectory::new(&config).unwrap();
    assert!(trajectory.rest_s().is_some_and(|rest_s| rest_s > 1.7));
    for t_ns in (0..1_700 * MS).step_by(13_700_000) {
        let point = trajectory.at(t_ns);
        let t_s = t_ns as f64 * 1e-9;
        let expected = first.position_w.each_ref().map(|c| powers(c, t_s));
        assert!(distance(point.position_w_m, expected.map(|axis| axis[0])) < 1e-12, "{t_s}");
        assert!(distance(point.velocity_w_m_s, expected.map(|axis| axis[1])) < 1e-12, "{t_s}");
        assert!(distance(point.acceleration_w_m_s2, expected.map(|axis| axis[2])) < 1e-12, "{t_s}");
        assert!((point.yaw_rad - powers(&first.yaw, t_s)[0]).abs() < 1e-12, "{t_s}");
    }
}

#[test]
fn what_moves_at_the_end_of_the_last_piece_comes_to_rest() {
    let trajectory = Trajectory::new(&TrajectoryConfig::Pieces(vec![piece(1.0)])).unwrap();
    let (before, after) = (trajectory.at(1_000 * MS - 1), trajectory.at(1_000 * MS));
    assert!(distance(before.velocity_w_m_s, [0.0; 3]) > 0.1);
    assert!(distance(before.velocity_w_m_s, after.velocity_w_m_s) < 1e-7);
    assert!(distance(before.acceleration_w_m_s2, after.acceleration_w_m_s2) < 1e-6);
    let rest_ns = (trajectory.rest_s().unwrap() * 1e9) as u64 + MS;
    let (rest, later) = (trajectory.at(rest_ns), trajectory.at(30_000 * MS));
    assert_eq!(rest, later);
    let turned = |t_ns: u64| trajectory.at(t_ns).yaw_rad;
    let rate = (turned(1_000 * MS) - turned(999 * MS), turned(1_001 * MS) - turned(1_000 * MS));
    assert!(rate.0.abs() > 1e-4 && (rate.0 - rate.1).abs() < 0.05 * rate.0.abs(), "{rate:?}");
    assert!(distance(rest.velocity_w_m_s, [0.0; 3]) < 1e-15);
    assert!(distance(rest.position_w_m, after.position_w_m) < 2.0);
}

#[test]
fn a_piece_that_does_not_join_is_refused_with_the_gap() {
    let first = piece(0.7);
    let mut second = next(&first);
    second.position_w[1][0] += 0.02;
    let error = Trajectory::new(&TrajectoryConfig::Pieces(vec![first, second])).unwrap_err();
    let PilotError::Disjoint { index: 1, gap, unit: "m", .. } = error else { panic!("{error}") };
    assert!((gap - 0.02).abs() < 1e-9, "{gap}");
    // The velocity, the heading and its rate must join as well; whole turns of a heading do.
    let changed = |change: fn(&mut Piece)| {
        let mut second = next(&first);
        change(&mut second);
        Trajectory::new(&TrajectoryConfig::Pieces(vec![first, second]))
    };
    let faster = changed(|piece| piece.position_w[0][1] += 0.2);
    let aside = changed(|piece| piece.yaw[0] += 3.0);
    let turning = changed(|piece| piece.yaw[1] += 0.3);
    for (refused, wanted) in [(faster, "m/s"), (aside, "rad"), (turning, "rad/s")] {
        let refused = refused.unwrap_err();
        assert!(matches!(refused, PilotError::Disjoint { index: 1, unit, .. } if unit == wanted));
    }
    let turned = changed(|piece| piece.yaw[0] -= 2.0 * TAU).unwrap();
    let whole = Trajectory::new(&TrajectoryConfig::Pieces(vec![first, next(&first)])).unwrap();
    let (turned, whole) = (turned.at(1_200 * MS).yaw_rad, whole.at(1_200 * MS).yaw_rad);
    assert!((turned - whole).abs() < 1e-12, "{turned} {whole}");
    let mut second = next(&first);
    second.position_w[2][1] = f64::NAN;
    let refused = Trajectory::new(&TrajectoryConfig::Pieces(vec![first, second]));
    assert!(matches!(refused, Err(PilotError::Disjoint { index: 1, .. })), "{refused:?}");
}

#[test]
fn pieces_and_samples_that_cannot_be_are_refused_by_name() {
    let with = |change: fn(&mut Piece)| {
        let mut piece = piece(1.0);
        change(&mut piece);
        TrajectoryConfig::Pieces(vec![piece])
    };
    let sample = |t_s: f64, x_m: f64| PathSample { position_w_m: [x_m, 0.0, 1.0], ..round(t_s) };
    let cases = [
        (with(|p| p.duration_s = 0.0), "trajectory.pieces[0].duration_s"),
        (with(|p| p.duration_s = f64::NAN), "trajectory.pieces[0].duration_s"),
        (with(|p| p.position_w[1][7] = f64::INFINITY), "trajectory.pieces[0].position_w[1]"),
        (with(|p| p.position_w[0][7] = 1e6), "trajectory.pieces[0].position_w[0]"),
        (with(|p| p.yaw[3] = f64::NAN), "trajectory.pieces[0].yaw"),
        (TrajectoryConfig::Pieces(Vec::new()), "trajectory.pieces"),
        (TrajectoryConfig::Samples(Vec::new()), "trajectory.samples"),
        (TrajectoryConfig::Samples(vec![round(1.0), round(1.0)]), "trajectory.samples[1].t_s"),
        (TrajectoryConfig::Samples(vec![sample(0.0, f64::NAN)]), "trajectory.samples[0]"),
    ];
    for (config, parameter) in cases {
        let error = Trajectory::new(&config).unwrap_err().to_string();
        assert!(error.contains(parameter), "{parameter}: {error}");
    }
}

#[test]
fn samples_are_passed_through_whatever_is_given_with_them() {
    let spacing_s = |i: u32| if i.is_multiple_of(3) { 0.05 } else { 0.08 };
    // From 3 s on, as in a log of something longer.
    let t_s = (0..120).scan(3.0, |t_s, i| {
        *t_s += spacing_s(i);
        Some(*t_s)
    });
    let whole: Vec<PathSample> = t_s.map(round).collect();
    let positions: Vec<PathSample> = whole
        .iter()
        .map(|s| PathSample { velocity_w_m_s: None, acceleration_w_m_s2: None, ..*s })
        .collect();
    let velocities: Vec<PathSample> =
        whole.iter().map(|s| PathSample { acceleration_w_m_s2: None, ..*s }).collect();
    // Errors of interpolation, by the powers of the spacing that theory gives: 1.5e-7 m and 1.3e-4 m/s² at 0.08 s.
    for (samples, bounds) in [
        (whole, [1e-9, 1e-8, 1e-6]),
        (velocities, [1e-8, 1e-5, 2e-3]),
        (positions, [2e-6, 1e-4, 1e-2]),
    ] {
        let trajectory = Trajectory::new(&TrajectoryConfig::Samples(samples.clone())).unwrap();
        let begin_s = samples[0].t_s;
        for sample in &samples[..119] {
            let t_ns = ((sample.t_s - begin_s) * 1e9).round() as u64;
            let point = trajectory.at(t_ns);
            assert!(distance(point.position_w_m, sample.position_w_m) < 1e-8);
        }
        for t_ns in (0..7_000 * MS).step_by(1_730_000) {
            let (point, wanted) = (trajectory.at(t_ns), round(begin_s + t_ns as f64 * 1e-9));
            let off = [
                distance(point.position_w_m, wanted.position_w_m),
                distance(point.velocity_w_m_s, wanted.velocity_w_m_s.unwrap()),
                distance(point.acceleration_w_m_s2, wanted.acceleration_w_m_s2.unwrap()),
            ];
            assert!(off.iter().zip(&bounds).all(|(off, bound)| off < bound), "{t_ns} {off:?}");
        }
    }
}

#[test]
fn positions_of_a_cubic_give_the_cubic() {
    let cubic = |t: f64| 0.4 + t * (0.3 + t * (-0.2 + 0.05 * t));
    let sample = |t_s: f64| PathSample {
        t_s,
        position_w_m: [cubic(t_s), -cubic(t_s), 1.0],
        yaw_rad: cubic(t_s),
        velocity_w_m_s: None,
        acceleration_w_m_s2: None,
    };
    let samples = [0.0, 0.3, 0.5, 1.1, 1.7, 2.0].map(sample);
    let trajectory = Trajectory::new(&TrajectoryConfig::Samples(samples.to_vec())).unwrap();
    for t_ns in (0..2_000 * MS).step_by(17_000_000) {
        let point = trajectory.at(t_ns);
        let expected = cubic(t_ns as f64 * 1e-9);
        assert!(distance(point.position_w_m, [expected, -expected, 1.0]) < 1e-13, "{t_ns}");
        assert!((point.yaw_rad - expected).abs() < 1e-13, "{t_ns}");
    }
}

#[test]
fn a_heading_that_is_written_within_a_turn_goes_on_the_shorter_way() {
    let sample = |i: u32| {
        let t_s = 0.1 * f64::from(i);
        let turned = 0.5 * t_s;
        PathSample { yaw_rad: turned.sin().atan2(turned.cos()), ..round(t_s) }
    };
    let samples: Vec<PathSample> = (0..200).map(sample).collect();
    let trajectory = Trajectory::new(&TrajectoryConfig::Samples(samples)).unwrap();
    for t_ns in (0..19_800 * MS).step_by(37_000_000) {
        assert!((trajectory.at(t_ns).yaw_rad - 0.5e-9 * t_ns as f64).abs() < 1e-9, "{t_ns}");
    }
    assert!(trajectory.at(19_800 * MS).yaw_rad > 3.0 * PI);
}

#[test]
fn the_least_and_the_largest_height_are_those_of_a_dense_look() {
    for config in super::shapes() {
        let trajectory = Trajectory::new(&config).unwrap();
        let windows = [(0, 700), (0, 3_100), (2_300, 3_700), (0, 22_000), (23_000, 24_000)];
        for (from_ns, until_ns) in windows.map(|(from, until)| (from * MS, until * MS)) {
            let heights = || {
                let instants = (from_ns..=until_ns).step_by(1_000_000);
                instants.map(|t_ns| trajectory.at(t_ns).position_w_m[2])
            };
            let dense = [heights().fold(9.0, f64::min), heights().fold(-9.0, f64::max)];
            let found = trajectory.heights_m([from_ns, until_ns]);
            let off = found.iter().zip(&dense).map(|(found, dense)| (found - dense).abs());
            assert!(off.fold(0.0, f64::max) < 2e-5, "{until_ns}: {found:?} {dense:?} {config:?}");
        }
    }
}

#[test]
fn a_large_acceleration_at_the_end_carries_the_reference_nowhere() {
    // A round in 1.5 s: 4.2 m/s and 17.5 m/s².
    let turn = TAU / 1.5;
    let sample = |i: u32| {
        let t_s = 0.01 * f64::from(i);
        let (sin, cos) = (turn * t_s).sin_cos();
        PathSample {
            t_s,
            position_w_m: [cos, sin, 1.5],
            yaw_rad: 0.0,
            velocity_w_m_s: None,
            acceleration_w_m_s2: None,
        }
    };
    let samples = (0..=150).map(sample).collect();
    let trajectory = Trajectory::new(&TrajectoryConfig::Samples(samples)).unwrap();
    let speed_m_s = trajectory.peak_speed_m_s([0, 60_000 * MS]);
    assert!(speed_m_s < 1.5 * turn, "{speed_m_s}");
    let rest = trajectory.at(60_000 * MS);
    assert!(distance(rest.position_w_m, [1.0, 0.0, 1.5]) < 2.5, "{rest:?}");
    assert!(trajectory.rest_s().unwrap() < 2.6, "{:?}", trajectory.rest_s());
}
