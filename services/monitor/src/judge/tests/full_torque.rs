//! Full torque that turns the vehicle beyond its set point.

use super::*;

/// A vehicle that is `from_rad` off in roll (0) or pitch (1), whose rotors give full torque about that axis from rest on,
/// `ms` afterwards.
fn slammed(ms: u64, (axis, side): (usize, f64), beta: MorphAngle, from_rad: f64) -> Moment {
    let vehicle = VehicleParameters::default();
    let full_nm = vehicle.torque_bound_nm(beta, vehicle.weight_n())[axis];
    let (alpha, lag) = (full_nm / vehicle.inertia_kg_m2(beta)[axis], vehicle.rotor_lag_s);
    let t = ms as f64 * 1e-3;
    let settled = -libm::expm1(-t / lag);
    let of_axis = |value: f64| {
        let mut all = [0.0; 3];
        all[axis] = value;
        all
    };
    let angle = from_rad + side * alpha * (0.5 * t * t - lag * (t - lag * settled));
    let pair = |value: f64| [of_axis(value)[0], of_axis(value)[1]];
    let moment = rest(ms / 10);
    let applied = moment.applied.map(|applied| Applied {
        full_s: pair(side * t),
        lagged_nm: pair(side * full_nm * settled),
        ..applied
    });
    Moment {
        now_ns: (100 + ms) * 1_000_000,
        morph_angle: beta,
        q_wb: quaternion_from_euler(&of_axis(angle).into()),
        rate_b_rad_s: of_axis(side * alpha * (t - lag * settled)).into(),
        applied,
        ..moment
    }
}

#[test]
fn full_torque_to_either_side_is_found_within_20_ms_in_every_phase() {
    // Folded and spread, about both axes and to both sides, from either side of the set point.
    for case in 0..240 {
        let beta = [MorphAngle::MIN, MorphAngle::MAX][case % 2];
        let about = (case / 2 % 2, [-1.0, 1.0][case / 4 % 2]);
        let from_rad = [-0.02, 0.0, 0.02][case / 8 % 3];
        let phase_ms = case as u64 / 24;
        let mut judge = judge();
        assert_eq!(judge.see(&rest(0)), Findings::default());
        let found = (0..4)
            .map(|step| phase_ms + 10 * step)
            .find(|ms| judge.see(&slammed(*ms, about, beta, from_rad)).commanded.is_some());
        assert!(
            found.is_some_and(|ms| ms <= 20),
            "{about:?} {beta:?} {from_rad} {phase_ms}: {found:?}"
        );
    }
}

#[test]
fn full_torque_that_answers_or_holds_is_no_finding() {
    let slam = slammed(25, (0, 1.0), MorphAngle::MIN, 0.0);
    let found = |moment: Moment| {
        let mut judge = judge();
        assert_eq!(judge.see(&rest(9)), Findings::default());
        judge.see(&moment).commanded.is_some()
    };
    assert!(found(slam));
    let rolled = |roll: f64, rate: f64| Moment {
        q_wb: quaternion_from_euler(&Vector3::new(roll, 0.0, 0.0)),
        rate_b_rad_s: Vector3::new(rate, 0.0, 0.0),
        ..slam
    };
    assert!(!found(rolled(-0.05, 4.0)), "it is turned back to its set point");
    assert!(!found(rolled(0.0, -4.0)), "it is braked");
    assert!(!found(rolled(0.0, 0.05)), "the torque holds against a load");
    assert!(!found(Moment { recovers: [false, true], ..slam }), "the set point is a fallback's");
    // The set point has just moved to the other side.
    let asked = |roll: f64, moment: Moment| Moment {
        setpoint: moment
            .setpoint
            .map(|setpoint| Setpoint { gamma_rad: Vector3::new(roll, 0.0, 0.0), ..setpoint }),
        ..moment
    };
    let mut judge = judge();
    judge.see(&asked(0.05, rest(9)));
    assert_eq!(judge.see(&asked(-0.01, slam)).commanded, None);
}
