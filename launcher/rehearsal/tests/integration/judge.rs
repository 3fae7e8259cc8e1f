//! Challenges, tube and verdict.

use proptest::prelude::*;
use rehearsal::{
    Axis, Challenge, DRAWS, Facts, Flown, Limits, Lost, Measure, Motion, RehearsalRefusal,
    Schedule, Snapshot, Sweep, Track, Tube, Verdict, Wanted, judge, schedule,
};
use shared_types::{PerSlot, Slot};
use vehicle::{MorphAngle, VehicleParameters, quaternion_from_euler};

const FLIP_S: f64 = 0.14;
const END_S: f64 = 3.0;

fn facts() -> Facts {
    Facts {
        vehicle: VehicleParameters::default(),
        morph_angle_rad: MorphAngle::MIN.rad(),
        tilt_max_rad: 0.35,
        period_s: PerSlot::from_fn(|slot| if slot == Slot::Attitude { 0.01 } else { 0.02 }),
        latency_s: 0.002,
        speed_m_s: 1.0,
        acceleration_m_s2: 0.5,
        is_rig: false,
        ground: true,
    }
}

fn snapshot() -> Snapshot {
    serde_json::from_value(serde_json::json!({
        "at_ns": 0, "position_w_m": [0.0, 0.0, 1.5], "velocity_w_m_s": [0.0, 0.0, 0.0],
        "q_wb": [1.0, 0.0, 0.0, 0.0], "body_rate_b_rad_s": [0.0, 0.0, 0.0],
        "morph_angle_rad": 0.8, "morph_rate_rad_s": 0.0, "position_sigma_w_m": [0.01, 0.01, 0.01],
        "velocity_sigma_w_m_s": [0.01, 0.01, 0.01], "attitude_sigma_b_rad": [0.01, 0.01, 0.01],
        "gyro_bias_sigma_rad_s": 0.001, "accelerometer_bias_sigma_m_s2": 0.01,
        "rotor_thrust_n": [0.3, 0.3, 0.3, 0.3], "commanded": true, "force_w_n": [0.05, 0.0, 0.0],
        "torque_b_nm": [0.0, 0.0, 0.0], "guidance": {}
    }))
    .expect("a snapshot")
}

fn schedules(slot: Slot, sweeps: &[Sweep]) -> [Schedule; DRAWS] {
    schedule(slot, &facts(), &snapshot(), (sweeps, &[]), (FLIP_S, END_S))
}

/// A flight with the roll angle `roll_rad(t_s)` and a constant position error of `off_m` along world x.
fn track(roll_rad: impl Fn(f64) -> f64, off_m: f64) -> Track {
    turned(roll_rad, off_m, 0.0)
}

/// The same with a constant heading \[rad\].
fn turned(roll_rad: impl Fn(f64) -> f64, off_m: f64, yaw_rad: f64) -> Track {
    let mut track = Track::default();
    track.tracks(0.0, [0.0; 3]);
    track.wants(Wanted {
        t_s: 0.0,
        position_w_m: [0.0, 0.0, 1.5],
        velocity_w_m_s: [0.0; 3],
        yaw_rad: 0.0,
    });
    for ms in 0..3000 {
        let t_s = f64::from(ms) * 1e-3;
        let q = quaternion_from_euler(&nalgebra::Vector3::new(roll_rad(t_s), 0.0, yaw_rad));
        track.moved(Motion {
            t_s,
            position_w_m: [off_m, 0.0, 1.5],
            velocity_w_m_s: [0.0; 3],
            q_wb: [q.w, q.i, q.j, q.k],
            body_rate_b_rad_s: [0.0; 3],
        });
        if ms % 10 == 0 {
            track.commanded(t_s, [1.0, 0.0, 0.0, 0.0]);
        }
    }
    track
}

fn judged(candidate: &Track, owner: &Track) -> Verdict {
    judged_in(Slot::Attitude, candidate, owner)
}

fn judged_in(slot: Slot, candidate: &Track, owner: &Track) -> Verdict {
    let [schedule, ..] = schedules(slot, &[]);
    let flown = Flown { draw: 0, schedule: &schedule, candidate, owner };
    let done = judge(slot, &facts(), &Tube::default(), &[flown]);
    Verdict::of("my-controller", "attitude-mpc", done)
}

#[test]
fn each_axis_is_disturbed_separately_in_both_directions() {
    for slot in [Slot::Attitude, Slot::Position] {
        let trials: Vec<Challenge> = schedules(slot, &[])
            .iter()
            .flat_map(|s| s.trials.clone())
            .map(|t| t.challenge)
            .collect();
        let axes = match slot {
            Slot::Attitude => [Axis::Roll, Axis::Pitch, Axis::Yaw],
            Slot::Position => [Axis::X, Axis::Y, Axis::Z],
        };
        for (index, axis) in axes.into_iter().enumerate() {
            let of_axis = |challenge: &Challenge| match challenge {
                Challenge::Kick { axis: a, body_rate_b_rad_s: v } if *a == axis => Some(v[index]),
                Challenge::Push { axis: a, force_w_n: v, .. } if *a == axis => Some(v[index]),
                _ => None,
            };
            let sizes: Vec<f64> = trials.iter().filter_map(of_axis).collect();
            assert!(sizes.iter().any(|size| *size > 0.0), "{axis:?}: {sizes:?}");
            assert!(sizes.iter().any(|size| *size < 0.0), "{axis:?}: {sizes:?}");
        }
    }
}

#[test]
fn windows_cover_the_time_from_the_flip_to_the_end_without_gaps() {
    let sweeps = [Sweep { at_s: 0.0, angle_deg: 160.0, over_s: 0.5 }];
    for slot in [Slot::Attitude, Slot::Position] {
        for schedule in schedules(slot, &sweeps) {
            let first = schedule.trials.first().expect("a trial");
            let last = schedule.trials.last().expect("a trial");
            assert_eq!((first.challenge, first.at_s), (Challenge::Flip, FLIP_S));
            assert!((last.until_s - END_S).abs() < 1e-12);
            for pair in schedule.trials.windows(2) {
                assert!((pair[0].until_s - pair[1].at_s).abs() < 1e-12);
                assert!(pair[1].until_s - pair[1].at_s >= 0.25, "{pair:?}");
            }
        }
    }
}

#[test]
fn sweeps_of_the_plan_are_brought_forward_into_the_last_flight_only() {
    let sweeps = [160.0, 45.0].map(|angle_deg| Sweep { at_s: 9.0, angle_deg, over_s: 0.5 });
    let [mean, one, last] = schedules(Slot::Attitude, &sweeps);
    assert!(mean.sweeps.is_empty() && one.sweeps.is_empty());
    assert_eq!(last.sweeps.len(), 2);
    assert!(last.sweeps[0].at_s + 0.5 <= last.sweeps[1].at_s && last.sweeps[1].at_s < END_S);
    let [.., none] = schedules(Slot::Attitude, &[]);
    assert!(none.trials.iter().all(|trial| trial.challenge != Challenge::Sweep));
}

#[test]
fn gust_load_and_reference_together_stay_within_the_lateral_force_at_the_tilt_bound() {
    let limits = Limits::of(&facts());
    let found = schedules(Slot::Attitude, &[]).into_iter().flat_map(|s| s.trials);
    let gust = found.map(|trial| trial.challenge).find_map(|challenge| match challenge {
        Challenge::Gust { force_w_n: [x, y, _], .. } => Some(libm::hypot(x, y)),
        _ => None,
    });
    let mass_kg = facts().vehicle.mass_kg;
    let all_n = gust.expect("a gust") + 0.05 + mass_kg * facts().acceleration_m_s2;
    assert!(all_n <= 0.8 * mass_kg * limits.lateral_m_s2 + 1e-9, "{all_n}");
}

#[test]
fn the_refusal_of_a_tumbling_vehicle_names_challenge_time_number_and_limit() {
    let [schedule, ..] = schedules(Slot::Attitude, &[]);
    let kick = schedule
        .trials
        .iter()
        .find(|trial| matches!(trial.challenge, Challenge::Kick { axis: Axis::Roll, .. }));
    let kick_s = kick.expect("a kick").at_s;
    let tumbles = track(|t_s| (2.0 * (t_s - kick_s)).max(0.0), 0.0);
    let verdict = judged(&tumbles, &track(|_| 0.0, 0.0));
    assert!(!verdict.accepted);
    let expected = "my-controller would lose the vehicle 0.52 s after a kick in roll: tilt 60.0 deg, limit 60.0 deg";
    // π/3 at 2 rad/s is reached 0.5236 s after the kick and seen at the next millisecond, when the next kick
    // has begun, so that the time in the message is not compared.
    assert!(verdict.message.contains("would lose the vehicle"), "{}", verdict.message);
    assert!(
        verdict.message.contains("tilt 60.") && verdict.message.contains("limit 60.0 deg"),
        "{expected}"
    );
    let Some(RehearsalRefusal::Lost { lost: Lost::Tilted { .. }, .. }) = verdict.refusal else {
        panic!("{}", verdict.message)
    };
}

#[test]
fn an_error_beyond_the_owners_share_is_refused_with_number_and_limit() {
    let owner = track(|_| 0.03, 0.02);
    let verdict = judged(&track(|_| 0.15, 0.02), &owner);
    assert!(!verdict.accepted, "{}", verdict.message);
    for word in ["attitude error", "deg, limit", "owner 1.7 deg"] {
        assert!(verdict.message.contains(word), "{word}: {}", verdict.message);
    }
    assert!(judged(&track(|_| 0.031, 0.02), &owner).accepted);
}

#[test]
fn a_position_controller_that_turns_off_the_references_heading_is_refused() {
    let owner = track(|_| 0.0, 0.02);
    let verdict = judged_in(Slot::Position, &turned(|_| 0.0, 0.02, 0.5), &owner);
    assert!(
        verdict.message.contains("heading error 28.6 deg, limit 8.0 deg"),
        "{}",
        verdict.message
    );
    assert!(judged_in(Slot::Position, &turned(|_| 0.0, 0.02, -0.1), &owner).accepted);
}

#[test]
fn a_candidate_as_good_as_an_owner_beyond_the_envelope_passes_and_a_worse_does_not() {
    let tube = Tube::default();
    assert!(0.0605 <= tube.limit(0.04, 0.06) && tube.limit(0.04, 0.06) < 0.07);
}

#[test]
fn a_vehicle_for_which_the_actuation_guard_takes_over_counts_as_lost() {
    let mut silent = track(|_| 0.0, 0.0);
    silent.unguided(0.9);
    let verdict = judged(&silent, &track(|_| 0.0, 0.0));
    assert!(verdict.message.contains("actuation guard took over"), "{}", verdict.message);
    // Before the flip the owner commands, so that it is not the candidate's fault.
    let mut early = track(|_| 0.0, 0.0);
    early.unguided(0.05);
    assert!(judged(&early, &track(|_| 0.0, 0.0)).accepted);
}

#[test]
fn a_command_that_is_not_a_number_is_refused_and_its_verdict_survives_json() {
    let mut nan = track(|_| 0.0, 0.0);
    nan.commanded(2.95, [1.0, f64::NAN, 0.0, 0.0]);
    let verdict = judged(&nan, &track(|_| 0.0, 0.0));
    assert!(!verdict.accepted, "{}", verdict.message);
    let json = serde_json::to_string(&verdict).unwrap();
    assert_eq!(serde_json::from_str::<Verdict>(&json).unwrap(), verdict);
}

proptest! {
    #[test]
    fn a_candidate_as_good_as_the_owner_never_fails(
        envelope in 1e-3..1e3_f64, owner in 0.0..1e4_f64, share in 0.0..=1.0_f64,
    ) {
        prop_assert!(owner * share <= Tube::default().limit(envelope, owner));
    }

    #[test]
    fn a_larger_error_never_turns_a_refusal_into_an_acceptance(
        roll in 0.0..0.5_f64, more in 0.0..0.5_f64, of_owner in 0.0..0.1_f64,
    ) {
        let owner = track(|_| of_owner, 0.0);
        let better = judged(&track(|_| roll, 0.0), &owner).accepted;
        let worse = judged(&track(|_| roll + more, 0.0), &owner).accepted;
        prop_assert!(better || !worse);
    }
}

#[test]
fn limits_follow_from_torque_bounds_and_times() {
    let limits = Limits::of(&facts());
    for axis in 0..3 {
        let stopped = limits.kick_b_rad_s[axis] / limits.acceleration_b_rad_s2[axis];
        assert!((2.0 * stopped - limits.reaction_s).abs() < 1e-12, "half the time of the reaction");
        let angle =
            0.625 * limits.acceleration_b_rad_s2[axis] * limits.reaction_s * limits.reaction_s;
        assert!((limits.stopping_b_rad[axis] - angle).abs() < 1e-12);
    }
    assert!((limits.lateral_m_s2 - 9.81 * libm::tan(0.35)).abs() < 1e-9);
    assert_eq!(Measure::of(Slot::Attitude, true).len(), 5, "a rig has no position");
}
