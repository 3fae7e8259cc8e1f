//! The rigs of the paper's tests with the flight controller, judged on the recorded truth.

#![allow(clippy::print_stdout, reason = "the numbers reached, for `--nocapture`")]

use crate::common::recording::{Recording, Row};
use crate::common::{distance, euler_rad, fly};

/// `pilot.at_s` of the shipped rig.
const STEP_AT_S: f64 = 0.2;
const STEP_RAD: f64 = 0.2;
/// Half width of the band in which the angle counts as settled.
const BAND_RAD: f64 = 0.004;
const RATES_HZ: [&str; 6] = ["50", "100", "150", "200", "500", "1000"];
const MORPH_ANGLES_DEG: [&str; 3] = ["45", "94.5", "160"];
const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// Euler angles of the truth.
struct Response(Vec<(f64, [f64; 3])>);

impl Response {
    fn read(recording: &Recording) -> Self {
        let rows = recording.series("truth", &["q_wb"]);
        Self(rows.iter().map(|Row { t_s, values }| (*t_s, euler_rad(values))).collect())
    }

    /// Time from the step after which an axis never leaves the band again.
    fn settled_after_s(&self, axis: usize) -> f64 {
        let outside = |(_, angles): &&(f64, [f64; 3])| (angles[axis] - STEP_RAD).abs() > BAND_RAD;
        let last = self.0.iter().rfind(outside).expect("it starts at rest");
        let end_s = self.0.last().expect("a flight").0;
        if end_s - last.0 < 0.2 { f64::INFINITY } else { last.0 - STEP_AT_S }
    }

    fn peak_rad(&self, axis: usize) -> f64 {
        self.0.iter().map(|(_, angles)| angles[axis]).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Largest error of any axis from `t_s` on.
    fn worst_error_from_rad(&self, t_s: f64) -> f64 {
        let errors = self.0.iter().filter(|(t, _)| *t >= t_s).flat_map(|(_, angles)| *angles);
        errors.map(|angle| (angle - STEP_RAD).abs()).fold(0.0, f64::max)
    }
}

fn step(more: &[&str]) -> Response {
    let flown = fly(&[&["attitude-step", "--in-process"], more].concat());
    flown.assert_clean();
    Response::read(&flown.recording())
}

/// Calls `judge` with the response at every rate and size; `axes` is a list as the scenario has it.
fn for_every_rate_and_size(axes: &str, judge: impl Fn(&str, &Response, &str)) {
    for rate in RATES_HZ {
        for angle in MORPH_ANGLES_DEG {
            let response = step(&[
                "--rate",
                &format!("attitude-mpc={rate}"),
                "--set",
                &format!("start.morph_angle_deg={angle}"),
                "--set",
                &format!("pilot.axes={axes}"),
            ]);
            let settled = [0, 1, 2].map(|axis| response.settled_after_s(axis));
            let peak = [0, 1, 2].map(|axis| response.peak_rad(axis));
            let case = format!("{axes} {rate} Hz {angle} deg: {settled:.3?} s, {peak:.4?} rad");
            println!("{case}");
            judge(rate, &response, &case);
        }
    }
}

#[test]
fn roll_and_pitch_one_at_a_time_settle_within_130_ms_at_every_rate_and_size() {
    for axis in [0, 1] {
        for_every_rate_and_size(&format!("[\"{}\"]", AXES[axis]), |_, response, case| {
            assert!(response.settled_after_s(axis) <= 0.13, "{case}");
            assert!(response.peak_rad(axis) <= 0.21, "{case}");
        });
    }
}

#[test]
fn yaw_alone_settles_within_450_ms_without_much_overshoot() {
    for_every_rate_and_size("[\"yaw\"]", |_, response, case| {
        assert!(response.settled_after_s(2) <= 0.45, "{case}");
        assert!(response.peak_rad(2) <= 0.235, "{case}");
    });
}

#[test]
fn all_axes_at_once_settle_in_roll_and_pitch_within_130_ms_and_350_ms_at_50_hz() {
    for_every_rate_and_size("[\"roll\",\"pitch\",\"yaw\"]", |rate, response, case| {
        let limit_s = if rate == "50" { 0.35 } else { 0.13 };
        for axis in [0, 1] {
            assert!(response.settled_after_s(axis) <= limit_s, "{case}");
            assert!(response.peak_rad(axis) <= 0.21, "{case}");
        }
        assert!(response.settled_after_s(2) <= 0.45, "{case}");
        assert!(response.peak_rad(2) <= 0.235, "{case}");
    });
}

#[test]
fn a_constant_torque_leaves_no_steady_error() {
    let torque = "disturbance_injector.script=\
                  [{kind=\"constant\",load={torque_b_nm=[0.01,-0.008,0.002]}}]";
    for angle in MORPH_ANGLES_DEG {
        let size = format!("start.morph_angle_deg={angle}");
        let response = step(&["--for", "3s", "--set", torque, "--set", &size]);
        let error_rad = response.worst_error_from_rad(STEP_AT_S + 1.0);
        println!("{angle} deg: {error_rad:.2e} rad");
        assert!(error_rad <= 1e-3, "{angle} deg: {error_rad}");
    }
}

#[test]
fn another_rotor_lag_or_inertia_than_modelled_still_settles_within_400_ms() {
    for mismatch in
        ["rotor_lag_s=0.010", "rotor_lag_s=0.020", "inertia_scale=0.8", "inertia_scale=1.5"]
    {
        for angle in MORPH_ANGLES_DEG {
            let mismatch = format!("plant.mismatch.{mismatch}");
            let size = format!("start.morph_angle_deg={angle}");
            let response = step(&["--for", "2s", "--set", &mismatch, "--set", &size]);
            let settled = [0, 1, 2].map(|axis| response.settled_after_s(axis));
            println!("{mismatch} {angle} deg: {settled:.3?} s");
            assert!(settled[0] <= 0.4 && settled[1] <= 0.4, "{mismatch} {angle}: {settled:?}");
            assert!(settled[2].is_finite(), "{mismatch} {angle}: {settled:?}");
        }
    }
}

/// Truth of a hover over (0, 0, 1.5) m.
fn hover(settings: &[&str]) -> Vec<Row> {
    let flags = settings.iter().flat_map(|setting| ["--set", setting]);
    let flown = fly(&["hover", "--in-process"].into_iter().chain(flags).collect::<Vec<_>>());
    flown.assert_clean();
    flown.recording().series("truth", &["position_w_m"])
}

fn largest_error_m(rows: &[Row]) -> f64 {
    rows.iter().map(|row| distance(&row.values, &[0.0, 0.0, 1.5])).fold(0.0, f64::max)
}

#[test]
fn a_constant_force_leaves_no_steady_position_error() {
    let rows = hover(&[
        "disturbance_injector.script=[{kind=\"constant\",load={force_w_n=[0.15,-0.10,-0.20]}}]",
    ]);
    let late: Vec<_> = rows.iter().filter(|row| row.t_s >= 8.0).collect();
    let mean = [0, 1, 2].map(|i| late.iter().map(|r| r.values[i]).sum::<f64>() / late.len() as f64);
    let error_m = distance(&mean, &[0.0, 0.0, 1.5]);
    println!("{late} samples, {error_m:.5} m", late = late.len());
    assert!(late.len() >= 1990 && error_m <= 0.005, "{error_m}");
}

#[test]
fn a_rotor_at_half_its_thrust_moves_a_hovering_vehicle_by_60_mm_at_most() {
    for rotor in 1..=4 {
        let weak = format!(
            "disturbance_injector.script=\
             [{{kind=\"rotor_efficiency\",at_s=2.0,rotor={rotor},efficiency=0.5}}]"
        );
        let error_m = largest_error_m(&hover(&[&weak]));
        println!("rotor {rotor}: {error_m:.4} m");
        assert!(error_m <= 0.06, "rotor {rotor}: {error_m}");
    }
}

#[test]
fn half_as_much_mass_again_moves_a_hovering_vehicle_by_400_mm_at_most() {
    let error_m = largest_error_m(&hover(&["plant.mismatch.mass_scale=1.5"]));
    println!("{error_m:.4} m");
    // Trimmed for two thirds of its weight it must sink at first, or the scale did nothing.
    assert!((0.01..=0.4).contains(&error_m), "{error_m}");
}
