//! Each criterion on its own, on motions that are known in closed form.

mod full_torque;

use super::*;
use shared_types::TripCause;
use vehicle::quaternion_from_euler;

const STEP_NS: u64 = 10_000_000;
const STEP_S: f64 = 0.01;

fn judge() -> Judge {
    Judge::new(Limits::default(), &VehicleParameters::default(), 0.011)
}

/// Level hover at rest at 1.5 m, with attitude, thrust and position at their set points.
fn rest(step: u64) -> Moment {
    let weight_n = VehicleParameters::default().weight_n();
    let place = Vector3::new(0.0, 0.0, 1.5);
    Moment {
        now_ns: (step + 1) * STEP_NS,
        elapsed_s: STEP_S,
        morph_angle: MorphAngle::MIN,
        q_wb: UnitQuaternion::identity(),
        rate_b_rad_s: Vector3::zeros(),
        position_w_m: place,
        velocity_w_m_s: Vector3::zeros(),
        setpoint: Some(Setpoint { gamma_rad: Vector3::zeros(), thrust_n: weight_n }),
        asked: Some(Setpoint { gamma_rad: Vector3::zeros(), thrust_n: weight_n }),
        applied: Some(Applied {
            thrust_n: weight_n,
            is_commanded: true,
            clipped_s: 0.0,
            full_s: [0.0; 2],
            lagged_nm: [0.0; 2],
        }),
        asked_every_s: 0.0,
        recovers: [false; 2],
        is_unsteered: false,
        reference: Some(Target {
            position_w_m: place,
            velocity_w_m_s: Vector3::zeros(),
            acceleration_w_m_s2: Vector3::zeros(),
            yaw_rad: 0.0,
        }),
    }
}

/// The first finding about a motion, with the step at which it is made.
fn first(steps: u64, motion: impl Fn(u64) -> Moment) -> Option<(u64, Findings)> {
    let mut judge = judge();
    let found = (0..steps).map(|step| (step, judge.see(&motion(step))));
    found.into_iter().find(|(_, found)| *found != Findings::default())
}

fn rolled(step: u64, roll: f64, rate: f64) -> Moment {
    let q_wb = quaternion_from_euler(&Vector3::new(roll, 0.0, 0.0));
    Moment { q_wb, rate_b_rad_s: Vector3::new(rate, 0.0, 0.0), ..rest(step) }
}

#[test]
fn a_vehicle_at_rest_causes_no_finding() {
    assert_eq!(first(1000, rest), None);
}

#[test]
fn turning_away_to_either_side_is_found_before_the_angle_is_large() {
    // From rest with a quarter of the braking acceleration.
    let (alpha, limit) = (140.0, Limits::default().turn_away_rad);
    for side in [-1.0, 1.0] {
        let motion = |step: u64| {
            let t = step as f64 * STEP_S;
            rolled(step, side * 0.5 * alpha * t * t, side * alpha * t)
        };
        let (step, found) = first(100, motion).unwrap();
        let finding = found.attitude.unwrap();
        assert_eq!((finding.cause, found.position), (TripCause::AttitudeDeparts, None));
        assert!(finding.value > limit);
        let t = step as f64 * STEP_S;
        assert!(0.5 * alpha * t * t < limit, "found at {t} s");
    }
}

/// Roll set point, roll and its rate of a vehicle whose set point is thrown from side to side every 0.2 s and that follows it
/// with 20 rad/s and a damping ratio of 0.7.
fn thrown(step: u64) -> [f64; 3] {
    let (mut roll, mut rate, dt) = (0.0, 0.0, 1e-3);
    let asked = |ms: u64| if (ms / 200).is_multiple_of(2) { 0.35 } else { -0.35 };
    for ms in 0..10 * step {
        let acceleration: f64 = 400.0 * (asked(ms) - roll) - 28.0 * rate;
        rate += acceleration * dt;
        roll += rate * dt;
    }
    [asked(10 * step), roll, rate]
}

#[test]
fn a_set_point_that_is_thrown_from_side_to_side_is_not_the_attitude_loops_fault() {
    let motion = |step: u64| {
        let [asked, roll, rate] = thrown(step);
        let moment = rolled(step, roll, rate);
        let setpoint = moment
            .setpoint
            .map(|setpoint| Setpoint { gamma_rad: Vector3::new(asked, 0.0, 0.0), ..setpoint });
        Moment { setpoint, ..moment }
    };
    let mut judge = judge();
    for step in 0..300 {
        let found = judge.see(&motion(step)).attitude;
        // The oscillation of the body is found long after that of the set point.
        let is_swing = found.is_some_and(|found| found.cause == TripCause::RateOscillates);
        assert!(found.is_none() || is_swing, "{step}: {found:?}");
    }
}

#[test]
fn a_loop_that_goes_on_turning_after_a_step_of_its_set_point_departs() {
    // At 6 rad/s towards a set point that steps to the other side, without braking.
    let motion = |step: u64| {
        let moment = rolled(step, 0.06 * step as f64 - 0.3, 6.0);
        let asked = if step < 8 { 0.3 } else { -0.3 };
        let setpoint = moment
            .setpoint
            .map(|setpoint| Setpoint { gamma_rad: Vector3::new(asked, 0.0, 0.0), ..setpoint });
        Moment { setpoint, ..moment }
    };
    let (step, found) = first(100, motion).unwrap();
    assert_eq!(found.attitude.unwrap().cause, TripCause::AttitudeDeparts);
    assert!((9..14).contains(&step), "{step}");
}

#[test]
fn an_attitude_that_does_not_follow_is_astray_however_its_set_point_jumps_about() {
    let motion = |step: u64| {
        let moment = rolled(step, 0.3, 0.0);
        let asked = if (step / 2).is_multiple_of(2) { -0.1 } else { -0.2 };
        let gamma_rad = Vector3::new(asked, 0.0, 0.0);
        let setpoint = moment.setpoint.map(|setpoint| Setpoint { gamma_rad, ..setpoint });
        Moment { setpoint, ..moment }
    };
    let (step, found) = first(200, motion).unwrap();
    assert_eq!(found.attitude.unwrap().cause, TripCause::AttitudeAstray);
    assert!(step < 100, "{step}");
}

#[test]
fn a_loop_that_turns_away_by_itself_departs_although_its_set_point_steps_across() {
    // Away in roll at 6 rad/s, while the pitch that is asked for is given back.
    let motion = |pitch_rad: f64| {
        move |step: u64| {
            let moment = rolled(step, 0.06 * step as f64 + 0.05, 6.0);
            let pitch_rad = if step == 0 { 0.08 } else { pitch_rad };
            let gamma_rad = Vector3::new(0.0, pitch_rad, 0.0);
            let setpoint = moment.setpoint.map(|setpoint| Setpoint { gamma_rad, ..setpoint });
            Moment { setpoint, ..moment }
        }
    };
    let departs = |pitch_rad: f64| {
        let (step, found) = first(100, motion(pitch_rad)).unwrap();
        assert_eq!(found.attitude.unwrap().cause, TripCause::AttitudeDeparts);
        step
    };
    assert!(departs(0.0) <= departs(0.08) + 1, "{} and {}", departs(0.0), departs(0.08));
}

#[test]
fn a_vehicle_that_follows_a_step_of_its_set_point_does_not_depart() {
    let motion = |step: u64| {
        let t = step as f64 * STEP_S;
        // Critically damped at 25 rad/s, to 0.5 rad.
        let left = 0.5 * (1.0 + 25.0 * t) * libm::exp(-25.0 * t);
        let rate = 0.5 * 625.0 * t * libm::exp(-25.0 * t);
        let moment = rolled(step, 0.5 - left, rate);
        let setpoint = moment.setpoint.unwrap();
        let gamma_rad = Vector3::new(0.5, 0.0, 0.0);
        // A rig, which has no reference, does not bound its set points.
        Moment { setpoint: Some(Setpoint { gamma_rad, ..setpoint }), reference: None, ..moment }
    };
    assert_eq!(first(200, motion), None);
}

#[test]
fn an_overshoot_is_found_before_the_set_point_is_passed() {
    // From 0.3 rad at 20 rad/s, the delay and a braking of 559 rad/s² lead far beyond the set point.
    let finding = judge().see(&rolled(0, -0.3, 20.0)).attitude.unwrap();
    assert_eq!(finding.cause, TripCause::AttitudeDeparts);
    // At the rate of a well damped loop, the vehicle comes to rest before the set point.
    assert_eq!(judge().see(&rolled(0, -0.3, 5.0)), Findings::default());
}

#[test]
fn a_persistent_attitude_error_is_found_after_its_time_limit() {
    let (step, found) = first(200, |step| rolled(step, -0.2, 0.0)).unwrap();
    let finding = found.attitude.unwrap();
    assert_eq!(finding.cause, TripCause::AttitudeAstray);
    // At the first step after half a second; rounding decides between two steps.
    assert!((49..=50).contains(&step), "{step} {finding:?}");
    assert!((0.5..0.511).contains(&finding.lasted_s), "{step} {finding:?}");
}

#[test]
fn a_heading_that_turns_away_is_found() {
    let motion = |step: u64| {
        let yaw = 2.0 * step as f64 * STEP_S;
        let q_wb = quaternion_from_euler(&Vector3::new(0.0, 0.0, yaw));
        Moment { q_wb, rate_b_rad_s: Vector3::new(0.0, 0.0, 2.0), ..rest(step) }
    };
    let (_, found) = first(100, motion).unwrap();
    assert_eq!(found.attitude.unwrap().cause, TripCause::HeadingDeparts);
}

#[test]
fn an_oscillation_of_the_body_is_found_and_the_response_to_a_kick_is_not() {
    let swing = |step: u64| {
        let phase = core::f64::consts::TAU * 6.0 * step as f64 * STEP_S;
        rolled(step, 0.08 * libm::sin(phase), 3.0 * libm::cos(phase))
    };
    let (_, found) = first(200, swing).unwrap();
    assert_eq!(found.attitude.unwrap().cause, TripCause::RateOscillates);
    let kick = |step: u64| {
        let t = step as f64 * STEP_S;
        rolled(step, 5.0 * t * libm::exp(-30.0 * t), 5.0 * (1.0 - 30.0 * t) * libm::exp(-30.0 * t))
    };
    assert_eq!(first(200, kick), None);
}

#[test]
fn a_thrust_error_is_found_by_the_vertical_speed_that_it_causes() {
    let motion = |step: u64| {
        let moment = rest(step);
        let applied = moment.applied.unwrap();
        let applied = Applied { thrust_n: 0.2 * applied.thrust_n, ..applied };
        Moment { applied: Some(applied), ..moment }
    };
    let (step, found) = first(200, motion).unwrap();
    assert_eq!(found.attitude.unwrap().cause, TripCause::ThrustAstray);
    // 0.8 g for 65 ms makes half a metre per second.
    assert!((5..=8).contains(&step), "{step}");
    let guarded = |step: u64| {
        let moment = motion(step);
        let applied = moment.applied.map(|applied| Applied { is_commanded: false, ..applied });
        Moment { applied, ..moment }
    };
    assert_eq!(first(200, guarded), None, "what the gate makes up is not the owner's");
}

#[test]
fn the_position_loop_is_blamed_only_if_the_attitude_followed_its_set_point() {
    let leaves = |step: u64| {
        let (t, moment) = (step as f64 * STEP_S, rest(step));
        let away = Vector3::new(1.75 * t * t, 0.0, 0.0);
        let velocity_w_m_s = Vector3::new(3.5 * t, 0.0, 0.0);
        Moment { position_w_m: moment.position_w_m + away, velocity_w_m_s, ..moment }
    };
    let (_, found) = first(200, leaves).unwrap();
    assert_eq!((found.position.unwrap().cause, found.attitude), (TripCause::PositionDeparts, None));
    let astray = |step: u64| {
        let q_wb = quaternion_from_euler(&Vector3::new(0.0, 0.2, 0.0));
        // For too short a time to be found as a persistent attitude error.
        if step > 40 { Moment { q_wb, ..leaves(step) } } else { rest(step) }
    };
    let (_, found) = first(200, astray).unwrap();
    assert_eq!((found.attitude.unwrap().cause, found.position), (TripCause::PositionDeparts, None));
}

#[test]
fn a_vehicle_that_moves_away_and_is_asked_for_more_is_found_before_it_is_faster() {
    let moving = |asked: Setpoint| {
        let velocity_w_m_s = Vector3::x() * 0.9;
        Moment { velocity_w_m_s, asked: Some(asked), elapsed_s: 0.0, ..rest(0) }
    };
    let level = rest(0).asked.unwrap();
    let [on, back] = [0.35, -0.35].map(|pitch| Setpoint {
        gamma_rad: Vector3::new(0.0, pitch, 0.0),
        thrust_n: 2.0 * level.thrust_n,
    });
    let is_found = |asked: Setpoint| judge().see(&moving(asked)).position.is_some();
    assert_eq!([level, back, on].map(is_found), [false, false, true]);
}

#[test]
fn a_vehicle_that_leans_against_a_steady_wind_brakes_worse_down_the_wind() {
    let tilt_rad = 0.25;
    let lean = Vector3::new(0.0, tilt_rad, 0.0);
    let leaning = |step: u64| {
        let moment = rest(step);
        let thrust_n = moment.asked.unwrap().thrust_n / libm::cos(tilt_rad);
        let setpoint = Some(Setpoint { gamma_rad: lean, thrust_n });
        let applied = Some(Applied { thrust_n, ..moment.applied.unwrap() });
        let q_wb = quaternion_from_euler(&lean);
        Moment { q_wb, setpoint, asked: setpoint, applied, ..moment }
    };
    let mut judge = judge();
    for step in 0..300 {
        assert_eq!(judge.see(&leaning(step)), Findings::default());
    }
    let push = judge.memory().push_w_m_s2;
    let gravity = VehicleParameters::default().gravity_m_s2;
    assert!((push[0] / (-gravity * libm::tan(tilt_rad)) - 1.0).abs() < 0.01, "{push:?}");
    // Blown away at this speed it could still be stopped in still air, and up the wind.
    let blown = |along: f64| Moment {
        velocity_w_m_s: Vector3::x() * along,
        elapsed_s: 0.0,
        ..leaning(300)
    };
    let is_found = |along: f64| judge.clone().see(&blown(along)).position.is_some();
    assert_eq!([-0.9, 0.9].map(is_found), [true, false]);
    let still =
        |along: f64| Moment { velocity_w_m_s: Vector3::x() * along, elapsed_s: 0.0, ..rest(300) };
    let calm = Judge::new(Limits::default(), &VehicleParameters::default(), 0.011);
    assert_eq!([-0.9, 0.9].map(|along| calm.clone().see(&still(along)).position), [None; 2]);
}

#[test]
fn a_vehicle_that_sinks_is_found_while_it_can_still_be_stopped() {
    let motion = |step: u64| {
        let (t, moment) = (step as f64 * STEP_S, rest(step));
        let position_w_m = moment.position_w_m - Vector3::new(0.0, 0.0, 2.0 * t);
        Moment { position_w_m, velocity_w_m_s: Vector3::new(0.0, 0.0, -2.0), ..moment }
    };
    let limits = Limits { excursion_m: 9.0, ..Limits::default() };
    let mut judge = Judge::new(limits, &VehicleParameters::default(), 0.011);
    let found = (0..75).find_map(|step| judge.see(&motion(step)).position.map(|f| (step, f)));
    let (step, finding) = found.unwrap();
    assert_eq!(finding.cause, TripCause::Sinks);
    // The stopping distance v² / 2 g is 0.2 m, and the remaining height is larger.
    assert!(motion(step).position_w_m.z > 0.2, "{finding:?}");
}

#[test]
fn the_position_loop_is_blamed_for_a_set_point_beyond_its_bound_except_on_a_rig() {
    let motion = |step: u64| {
        let moment = rolled(step, 0.6, 0.0);
        let gamma_rad = Vector3::new(0.6, 0.0, 0.0);
        let setpoint = Some(Setpoint { gamma_rad, thrust_n: 1.2 });
        Moment { setpoint, asked: setpoint, ..moment }
    };
    let (step, found) = first(10, motion).unwrap();
    assert_eq!((step, found.asked.unwrap().cause), (0, TripCause::SetpointBeyond));
    assert_eq!(first(20, |step| Moment { reference: None, ..motion(step) }), None);
}

#[test]
fn a_set_point_with_a_thrust_beyond_its_bounds_is_found_at_once_except_on_a_rig() {
    let weight_n = VehicleParameters::default().weight_n();
    let asking = |weights: f64| {
        let moment = rest(0);
        let asked = moment.asked.map(|asked| Setpoint { thrust_n: weights * weight_n, ..asked });
        Moment { asked, ..moment }
    };
    for weights in [0.0, 0.19, 2.11, 4.0] {
        let found = judge().see(&asking(weights));
        assert_eq!(found.asked.unwrap().cause, TripCause::ThrustBeyond, "{weights}");
        let rig = Moment { reference: None, ..asking(weights) };
        assert_eq!(judge().see(&rig), Findings::default());
    }
    for weights in [0.3, 1.0, 2.0] {
        assert_eq!(judge().see(&asking(weights)), Findings::default(), "{weights}");
    }
}

#[test]
fn a_set_point_that_turns_the_heading_away_from_the_reference_is_found() {
    // At one radian per second; the limit of 0.7 rad is reached after 0.7 s.
    let (step, found) = first(200, |step| {
        let moment = rest(step);
        let gamma_rad = Vector3::new(0.0, 0.0, step as f64 * STEP_S);
        let asked = moment.asked.map(|asked| Setpoint { gamma_rad, ..asked });
        Moment { asked, ..moment }
    })
    .unwrap();
    assert_eq!(found.asked.unwrap().cause, TripCause::HeadingAstray);
    assert!((80..=82).contains(&step), "{step}");
}

#[test]
fn a_set_point_that_swings_faster_than_a_position_loop_is_found_within_a_period() {
    let swinging = |frequency_hz: f64, amplitude_rad: f64| {
        move |step: u64| {
            let phase = core::f64::consts::TAU * frequency_hz * step as f64 * STEP_S;
            let gamma_rad = Vector3::new(0.0, amplitude_rad * libm::cos(phase), 0.0);
            let moment = rest(step);
            let asked = moment.asked.map(|asked| Setpoint { gamma_rad, ..asked });
            Moment { asked, ..moment }
        }
    };
    let asked = |frequency_hz: f64, amplitude_rad: f64| {
        let (mut judge, motion) = (judge(), swinging(frequency_hz, amplitude_rad));
        (0..500).find_map(|step| judge.see(&motion(step)).asked.map(|found| (step, found)))
    };
    for (frequency_hz, reversals, earliest) in [(2.5, 2, 30), (1.0, 6, 250)] {
        let (step, found) = asked(frequency_hz, 0.35).unwrap();
        assert_eq!(found.cause, TripCause::SetpointOscillates);
        assert_eq!(found.reversals, reversals);
        assert!((earliest..earliest + 60).contains(&step), "{step}");
    }
    assert_eq!(asked(2.5, 0.17), None, "less than half of the tilt bound");
}

#[test]
fn rotors_that_are_clipped_for_longer_than_the_limit_are_found() {
    for (clipped_s, cause) in [(0.45, None), (0.46, Some(TripCause::RotorsClipped))] {
        let moment = rest(0);
        let applied = moment.applied.map(|applied| Applied { clipped_s, ..applied });
        let found = judge().see(&Moment { applied, ..moment });
        assert_eq!(found.attitude.map(|finding| finding.cause), cause);
    }
}

#[test]
fn after_a_fail_over_where_the_vehicle_is_and_how_it_leans_is_not_the_others_fault() {
    // 0.9 m off, leaning by 50 degrees and on its way.
    let thrown = |recovers: [bool; 2]| {
        let moment = rolled(0, 0.87, 0.0);
        let position_w_m = moment.position_w_m + Vector3::new(0.9, 0.0, 0.0);
        let velocity_w_m_s = Vector3::new(4.0, 0.0, 0.0);
        let gamma_rad = Vector3::new(0.87, 0.0, 0.0);
        let setpoint = moment.setpoint.map(|setpoint| Setpoint { gamma_rad, ..setpoint });
        Moment { position_w_m, velocity_w_m_s, setpoint, recovers, ..moment }
    };
    let found = judge().see(&thrown([false; 2]));
    assert_eq!((found.position.unwrap().cause, found.attitude), (TripCause::PositionDeparts, None));
    assert_eq!(judge().see(&thrown([false, true])), Findings::default());
    // A position controller answers for where it leads the vehicle from then on.
    let found = judge().see(&thrown([true, false]));
    assert_eq!((found.position.unwrap().cause, found.attitude), (TripCause::PositionDeparts, None));
}

#[test]
fn a_moment_with_a_number_that_is_not_finite_is_skipped() {
    let motion = |step: u64| Moment { rate_b_rad_s: Vector3::repeat(f64::NAN), ..rest(step) };
    assert_eq!(first(100, motion), None);
}

#[test]
fn a_restored_judge_continues_bit_for_bit_as_the_original() {
    let swing = |step: u64| {
        let phase = core::f64::consts::TAU * 6.0 * step as f64 * STEP_S;
        rolled(step, 0.08 * libm::sin(phase), 3.0 * libm::cos(phase))
    };
    let (mut first, mut other) = (judge(), judge());
    for step in 0..200 {
        let found = first.see(&swing(step));
        assert_eq!(other.see(&swing(step)), found);
        assert_eq!(other.memory(), first.memory());
        let memory = first.memory();
        other = judge();
        other.restore(&memory);
    }
    let JudgeMemory { push_w_m_s2, velocity_w_m_s, moved_m, asked, .. } = first.memory();
    first.forget(false);
    let kept = first.memory();
    assert_eq!((kept.moved_m, kept.asked, kept.turned_rad), (moved_m, asked, 0.0));
    assert_eq!(kept.body, JudgeMemory::default().body, "of the attitude controller");
    first.forget(true);
    let none = JudgeMemory::default();
    let wind = JudgeMemory { push_w_m_s2, velocity_w_m_s, has_velocity: true, ..none };
    assert_eq!(first.memory(), wind, "all but what no owner has done");
}
