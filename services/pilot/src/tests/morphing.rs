//! The schedule of the deployable angle against the servo.

use super::{MS, knots, sweeps, vehicle};
use crate::{MorphSchedule, PilotError};

#[test]
fn a_morph_schedule_is_smooth_within_the_servo_limit_and_exact_at_its_knots() {
    let limit = vehicle().servo_rate_limit_rad_s;
    let schedule = MorphSchedule::new(&sweeps(), limit).unwrap();
    let angle = |t_ns: u64| schedule.angle_rad(t_ns);
    let at_knots =
        [(0, 45.0), (1000, 45.0), (1300, 160.0), (1700, 160.0), (3000, 94.5), (9000, 45.0)];
    for (t_ms, degrees) in at_knots {
        assert!((angle(t_ms * MS) - f64::to_radians(degrees)).abs() < 1e-14, "{t_ms}");
    }
    let (mut peak, mut last_rate, step_s) = (0.0_f64, 0.0, 1e-4);
    for t_ns in (0..4_000 * MS).step_by(100_000) {
        let rate = (angle(t_ns + 100_000) - angle(t_ns)) / step_s;
        // Peak acceleration of the 0.3 s sweep is 1.5 · 1.875 · 3 D / T² = 188 rad/s².
        assert!((rate - last_rate).abs() < 190.0 * step_s, "{t_ns}");
        peak = peak.max(rate.abs());
        last_rate = rate;
    }
    // 1.5 · 115° / 0.3 s = 575 °/s.
    assert!((peak.to_degrees() - 575.0).abs() < 0.01 && peak < limit, "{}", peak.to_degrees());
}

#[test]
fn a_sweep_faster_than_the_servo_is_refused_with_the_time_it_needs() {
    let limit = vehicle().servo_rate_limit_rad_s;
    let fast = knots(&[(0.0, 45.0), (1.0, 45.0), (1.2, 160.0)]);
    let Err(PilotError::MorphTooFast { index, shortest_s, rate_rad_s, .. }) =
        MorphSchedule::new(&fast, limit)
    else {
        panic!("accepted")
    };
    assert_eq!(index, 2);
    assert!((rate_rad_s.to_degrees() - 862.5).abs() < 1e-9);
    assert!((shortest_s - 1.5 * 115.0 / 700.0).abs() < 1e-12);
    let slower = knots(&[(1.0, 45.0), (1.0 + shortest_s + 1e-9, 160.0)]);
    assert!(MorphSchedule::new(&slower, limit).is_ok());
}

#[test]
fn bad_morph_schedules_are_refused() {
    let refused = |list: &[(f64, f64)]| MorphSchedule::new(&knots(list), 12.0).unwrap_err();
    assert!(matches!(refused(&[]), PilotError::Empty { .. }));
    assert!(matches!(refused(&[(0.0, 44.0)]), PilotError::OutOfRange { .. }));
    assert!(matches!(refused(&[(0.0, 160.1)]), PilotError::OutOfRange { .. }));
    assert!(matches!(refused(&[(0.0, f64::NAN)]), PilotError::OutOfRange { .. }));
    assert!(matches!(refused(&[(f64::NAN, 50.0)]), PilotError::OutOfRange { .. }));
    assert!(matches!(refused(&[(-1.0, 50.0)]), PilotError::OutOfRange { .. }));
    let twice = refused(&[(1.0, 50.0), (1.0, 50.0)]);
    assert!(matches!(twice, PilotError::TimesNotIncreasing { index: 1, .. }));
    assert!(MorphSchedule::new(&sweeps(), f64::NAN).is_err());
}
