//! A fresh law beside one that flies, given only what the attitude loop applied.

use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

use crate::cascade::{Cascade, Flight};
use nalgebra::Vector3;
use position_mpc::{Input, LawStatus, Output, PositionLaw, PositionLawConfig, Setpoint};
use vehicle::{MorphAngle, VehicleParameters};

/// Shares of the bounds: what is left of a thrust that the shadow did not know, and rounding.
const TOLERANCE: f64 = 1e-6;

fn circle(t: f64) -> (Vector3<f64>, f64) {
    (
        Vector3::new(0.4 * libm::sin(t), 0.4 * (1.0 - libm::cos(t)), 0.1 * libm::sin(2.0 * t)),
        0.5 * t,
    )
}

/// Flies a circle with a shadow that joins after a second; the attitude loop's report is `late` by
/// so many samples of this law. Worst difference in the last two seconds.
fn shadowed(rates: (f64, f64), late: usize) -> f64 {
    let (position_hz, attitude_hz) = rates;
    let vehicle = VehicleParameters::default();
    let config = PositionLawConfig::flight(position_hz);
    let mut flight = Flight::hover(vehicle, MorphAngle::MIN);
    flight.disturbance.force_w_n = Vector3::new(0.1, -0.05, -0.1);
    let mut cascade = Cascade::new(flight, &config, attitude_hz);
    let mut shadow = PositionLaw::new(config, &vehicle).unwrap();
    let worst = Rc::new(Cell::new(0.0_f64));
    let seen = Rc::clone(&worst);
    let mut steps: u32 = 0;
    let mut reports = VecDeque::new();
    cascade.watch = Box::new(move |input: &Input<'_>, output: &Output| {
        let now = input.applied.unwrap();
        reports.push_front(now);
        reports.truncate(late + 1);
        let reported: Setpoint = *reports.back().unwrap();
        steps += 1;
        let t_s = f64::from(steps) / position_hz;
        if t_s < 1.0 {
            return;
        }
        shadow.track(&reported, late);
        let tracked = shadow.step(&Input { applied: Some(reported), ..*input });
        assert_eq!(tracked.status, LawStatus::Solved);
        if t_s > 2.0 {
            let room = (output.command_max - output.command_min) * 0.5;
            let apart = (tracked.command - output.command).component_div(&room).amax();
            seen.set(seen.get().max(apart));
            let turned = tracked.setpoint.gamma_rad - output.setpoint.gamma_rad;
            assert!(turned.amax() < 1e-6, "the set point is the command, rotated: {turned}");
        }
    });
    cascade.fly(4.0, &circle, |_, _| {});
    worst.get()
}

/// A vehicle that is to be at the origin and hovers elsewhere, under this set point.
fn at_rest(position_w_m: Vector3<f64>, applied: Setpoint) -> Input<'static> {
    const ORIGIN: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);
    Input {
        position_w_m,
        velocity_w_m_s: Vector3::zeros(),
        gamma_rad: Vector3::zeros(),
        age_s: 0.0,
        reference_w_m: &[ORIGIN],
        reference_yaw_rad: 0.0,
        applied: Some(applied),
    }
}

#[test]
fn a_vehicle_that_another_controller_left_beside_its_path_is_brought_back_gently() {
    let config = PositionLawConfig::default();
    let vehicle = VehicleParameters::default();
    let level = Setpoint { gamma_rad: Vector3::zeros(), thrust_n: vehicle.weight_n() };
    let beside = at_rest(Vector3::x() * 0.06, level);
    let tilt_rad = |tracks: bool| {
        let mut law = PositionLaw::new(config, &vehicle).unwrap();
        if tracks {
            law.track(&level, 0);
        }
        let first = law.step(&beside).setpoint.gamma_rad.y;
        (first, law)
    };
    let ((at_once, _), (gently, mut law)) = (tilt_rad(false), tilt_rad(true));
    assert!(0.6 * at_once < gently && gently < 0.0, "{gently} rad, and at once {at_once} rad");
    // Within 10 mm nothing is held back.
    assert!((Vector3::from(law.memory().beside_w_m) - Vector3::x() * 0.05).amax() < 1e-12);
    for _ in 0..150 {
        law.step(&beside);
    }
    assert!(law.memory().beside_w_m[0] < 2e-4, "{}", law.memory().beside_w_m[0]);
}

#[test]
fn a_vehicle_that_is_far_from_its_path_is_brought_back_at_once() {
    let vehicle = VehicleParameters::default();
    let level = Setpoint { gamma_rad: Vector3::zeros(), thrust_n: vehicle.weight_n() };
    for (distance_m, fading_m) in [(0.08, 0.07), (0.15, 0.05), (0.2, 0.0), (0.4, 0.0)] {
        let far = at_rest(Vector3::y() * distance_m, level);
        let mut law = PositionLaw::new(PositionLawConfig::default(), &vehicle).unwrap();
        law.track(&level, 0);
        let roll_rad = law.step(&far).setpoint.gamma_rad.x;
        // The bound of 2.8 rad/s, or twice that.
        let is_caught = distance_m > 0.15;
        let bound_rad = if is_caught { 0.112 } else { 0.056 };
        assert!(roll_rad <= bound_rad, "{distance_m} m: {roll_rad} rad");
        assert_eq!(roll_rad > 0.1, is_caught, "{distance_m} m: {roll_rad} rad");
        let beside = Vector3::from(law.memory().beside_w_m);
        assert!((beside - Vector3::y() * fading_m).amax() < 1e-12, "{distance_m} m: {beside}");
    }
}

#[test]
fn a_fresh_law_that_tracks_a_flying_one_commands_the_same_one_step_ahead() {
    for rates in [(50.0, 100.0), (50.0, 500.0), (100.0, 100.0), (200.0, 200.0)] {
        for late in [0, 1, 3] {
            let worst = shadowed(rates, late);
            assert!(worst <= TOLERANCE, "{rates:?}, late {late}: {worst}");
        }
    }
}
