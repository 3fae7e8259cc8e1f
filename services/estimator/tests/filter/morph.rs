//! The morph angle is followed at rest and through a sweep.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use estimator::{Filter, FilterConfig, InitialState, MorphAngleSample};

use super::world::{STEP_NS, Sensors, hover};

const SIGMA_RAD: f64 = 1.745e-3;

/// β and β̇ at `t` of a servo with a lag of 20 ms that sweeps from 45° to 160° in 0.3 s from t = 1.
fn swept(t: f64) -> (f64, f64) {
    let (low, high) = (45.0_f64.to_radians(), 160.0_f64.to_radians());
    let (rate, lag) = ((high - low) / 0.3, 0.02);
    // Response of the lag to a ramp that starts at zero.
    let ramp = |t: f64| if t <= 0.0 { 0.0 } else { t - lag * (1.0 - (-t / lag).exp()) };
    let slope = |t: f64| if t <= 0.0 { 0.0 } else { 1.0 - (-t / lag).exp() };
    let (up, down) = (t - 1.0, t - 1.3);
    (low + rate * (ramp(up) - ramp(down)), rate * (slope(up) - slope(down)))
}

#[test]
fn a_fast_sweep_is_followed_and_rest_is_quiet() {
    let truth = hover(3);
    let mut sensors = Sensors::new(11, &InitialState::default());
    let initial = sensors.initial(&truth[0]);
    let mut filter = Filter::new(FilterConfig::default(), &initial).unwrap();
    let (mut worst, mut squares, mut rate_squares, mut looks) = (0.0_f64, 0.0, 0.0, 0.0);
    for (step, truth) in truth.iter().enumerate() {
        let time_ns = step as u64 * STEP_NS;
        let (angle, rate) = swept(step as f64 * 1e-3);
        filter.on_imu(&sensors.imu(step, truth));
        if step.is_multiple_of(5) {
            let angle_rad = angle + sensors.normal(SIGMA_RAD).x;
            filter.on_morph_angle(&MorphAngleSample { time_ns, angle_rad });
        }
        let estimate = filter.estimate();
        if step > 50 {
            worst = worst.max((estimate.beta_rad - angle).abs());
        }
        if (100..1000).contains(&step) || step > 1600 {
            squares += (estimate.beta_rad - angle).powi(2);
            rate_squares += (estimate.beta_rate_rad_s - rate).powi(2);
            looks += 1.0;
        }
    }
    let (rest, rest_rate) = (f64::sqrt(squares / looks), f64::sqrt(rate_squares / looks));
    println!("morph: sweep {worst:.4} rad, rest {rest:.5} rad, {rest_rate:.3} rad/s");
    assert!(worst < 0.03, "{worst}");
    assert!(rest < 2.5e-3, "{rest}");
    assert!(rest_rate < 0.5, "{rest_rate}");
}
