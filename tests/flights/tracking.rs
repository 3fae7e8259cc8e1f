//! How close the shipped figure eight is followed where loops are slow, set points late or bounds reached.

use crate::common::fly;

/// Root mean square of the distance from the path \[m\].
fn rms_m(arguments: &[&str]) -> f64 {
    let flown = fly(&[&["figure8-morph", "--in-process", "--no-record"], arguments].concat());
    flown.summary()["tracking_rms_m"].as_f64().unwrap_or_else(|| panic!("{}", flown.output_text()))
}

#[test]
fn late_set_points_and_other_rates_cost_less_than_the_error_of_the_shipped_ones() {
    let shipped_m = rms_m(&[]);
    let late = |latency_s: &str| format!("latency.attitude_setpoint_s={latency_s}");
    let rates = |position_hz: &str, attitude_hz: &str| {
        [
            format!("position_mpc.rate_hz={position_hz}"),
            format!("attitude_mpc.rate_hz={attitude_hz}"),
        ]
    };
    let mut settings: Vec<Vec<String>> = ["0.032", "0.05"].map(|way| vec![late(way)]).into();
    let pairs = [("15", "100"), ("200", "100"), ("200", "50"), ("50", "25")];
    settings.extend(pairs.map(|(position, attitude)| rates(position, attitude).into()));
    for set in &settings {
        let arguments: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
        let error_m = rms_m(&arguments);
        assert!(error_m <= 2.0 * shipped_m, "{set:?}: {error_m} m, shipped {shipped_m} m");
    }
}

#[test]
fn a_bound_that_is_reached_leaves_the_mpc_closer_than_the_pid() {
    for period_s in ["8", "5", "4.5", "4"] {
        let period = format!("pilot.period_s={period_s}");
        for weather in [&[][..], &["--set", "disturbance_injector.script=[]"]] {
            let arguments = [&["--set", &period], weather].concat();
            let mpc_m = rms_m(&arguments);
            let pid_m =
                rms_m(&[&arguments[..], &["--controller", "position=position-pid"]].concat());
            assert!(mpc_m <= pid_m, "{arguments:?}: {mpc_m} m by the MPC, {pid_m} m by the PID");
        }
    }
}

#[test]
fn figure_eights_are_followed_to_millimetres_as_far_as_the_tilt_bound_lets() {
    let calm: [(&str, f64); 7] = [
        ("8", 1.8),
        ("6", 2.5),
        ("5", 3.3),
        ("4.5", 11.5),
        ("4.25", 24.0),
        ("4", 59.0),
        ("3.5", 174.0),
    ];
    let wind = [("8", 4.2), ("5", 4.6), ("4.5", 18.0)];
    let still = ["--set", "disturbance_injector.script=[]"];
    for (courses, weather) in [(&calm[..], &still[..]), (&wind[..], &[])] {
        for (period_s, most_mm) in courses {
            let period = format!("pilot.period_s={period_s}");
            let error_mm = rms_m(&[&["--set", &period], weather].concat()) * 1e3;
            assert!(error_mm <= *most_mm, "{period} {weather:?}: {error_mm} mm");
        }
    }
}

#[test]
fn a_cone_bounds_the_tilt_itself_and_a_box_each_of_its_angles() {
    let period = ["figure8-morph", "--in-process", "--no-record", "--set", "pilot.period_s=4"];
    let tilt_rad = |bound: &str| {
        let bound = format!("position_mpc.tilt_bound={bound}");
        let flown = fly(&[&period[..], &["--set", &bound]].concat());
        flown.summary()["tilt_max_rad"]
            .as_f64()
            .unwrap_or_else(|| panic!("{}", flown.output_text()))
    };
    // The attitude loop overshoots by a little.
    let (boxed_rad, cone_rad) = (tilt_rad("box"), tilt_rad("cone"));
    assert!(cone_rad < 0.37 && boxed_rad > 0.4, "{boxed_rad} rad, {cone_rad} rad");
}
