//! The law on the nonlinear vehicle: steps, misjudged vehicles, loads, saturation, a flying MPC.

use crate::loops::{
    RATES, SIZES, assert_integrates, assert_settles_on_other_vehicles, assert_well_behaved,
    shadowed, stepped, timing, turned,
};
use attitude_lqr::settings::Settings;
use attitude_lqr::{AttitudeLoop, LqrLaw};
use nalgebra::Vector3;
use vehicle::VehicleParameters;

fn built(settings: &Settings, rate_hz: f64) -> AttitudeLoop<LqrLaw> {
    let vehicle = VehicleParameters::default();
    let config = settings.law_config(timing(rate_hz));
    let law = LqrLaw::new(config, &vehicle).unwrap();
    AttitudeLoop::new(law, &vehicle, config.timing, 0.0)
}

fn usual(rate_hz: f64) -> AttitudeLoop<LqrLaw> {
    built(&Settings::default(), rate_hz)
}

#[test]
fn three_axes_at_once_settle_at_every_rate_and_size() {
    for rate_hz in RATES {
        let (tilt_s, yaw_s) = if rate_hz < 75.0 { (0.32, 0.70) } else { (0.2, 0.8) };
        for beta in SIZES {
            let vehicle = VehicleParameters::default();
            let marks = stepped(&mut usual(rate_hz), vehicle, beta, Vector3::repeat(1.0));
            let [roll, pitch, yaw] = marks;
            let case = format!("{rate_hz} Hz, {beta:?}: {marks:?}");
            assert!(roll.0 <= tilt_s && pitch.0 <= tilt_s && yaw.0 <= yaw_s, "{case}");
            assert!(roll.1.max(pitch.1) <= 0.225 && yaw.1 <= 0.21, "{case}");
        }
    }
}

#[test]
fn another_lag_and_another_inertia_together_settle_too() {
    assert_settles_on_other_vehicles(usual);
}

#[test]
fn a_constant_torque_is_integrated_away() {
    assert_integrates(usual);
}

#[test]
fn a_turn_that_takes_all_the_torque_there_is_does_not_wind_the_integral_up() {
    let of = |windup_s| turned(built(&Settings { windup_s, ..Settings::default() }, 100.0));
    let (with, without) = (of(Settings::default().windup_s), of(1e3));
    assert!(with.2 >= 15, "not saturated: {with:?}");
    assert!(with.0 <= 2.1 && with.1 <= 2.0, "{with:?}, without {without:?}");
    assert!(with.1 < without.1 || with.0 < without.0, "{with:?}, without {without:?}");
}

#[test]
fn memory_bounds_refusals_and_allocations_are_in_order() {
    for rate_hz in RATES {
        assert_well_behaved(|| usual(rate_hz));
    }
}

/// Tracking means one step ahead from what is applied: what is left are the laws' own answers.
#[test]
fn beside_a_flying_mpc_it_agrees_while_it_tracks_and_after() {
    for rate_hz in [100.0, 500.0, 1000.0] {
        for beta in SIZES {
            let worst = shadowed(&mut usual(rate_hz), beta);
            assert!(worst[0] <= 0.05 && worst[1] <= 0.1, "{rate_hz} Hz, {beta:?}: {worst:?}");
        }
    }
}

#[test]
fn each_impossible_number_is_refused_by_name() {
    type Spoil = fn(&mut Settings);
    let cases: [(&str, Spoil); 4] = [
        ("rate_hz", |s| s.rate_hz = Some(1001.0)),
        ("angle_error_rad", |s| s.angle_error_rad = 0.0),
        ("torque_rise_s", |s| s.torque_rise_s = Some([0.01, f64::NAN, 0.01])),
        ("integral_s", |s| s.integral_s[2] = -1.0),
    ];
    for (name, spoil) in cases {
        let mut settings = Settings::default();
        spoil(&mut settings);
        let config = settings.law_config(timing(100.0));
        let vehicle = VehicleParameters::default();
        let error = LqrLaw::new(config, &vehicle).unwrap_err();
        assert!(error.to_string().starts_with(name), "{error}");
    }
}
