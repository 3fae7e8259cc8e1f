//! Turbulence against its theory.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use statrs::statistics::Statistics;

use super::*;
use crate::{Event, Wind};

const MEAN: [f64; 3] = [1.5, 0.5, 0.0];
const SIGMA: [f64; 3] = [0.7, 0.7, 0.35];
const LENGTH: [f64; 3] = [3.0, 3.0, 1.5];

fn wind(mean_w_m_s: [f64; 3]) -> Event {
    let (sigma_m_s, length_m) = (SIGMA, LENGTH);
    Event::Wind(Wind { at_s: 0.0, until_s: None, mean_w_m_s, sigma_m_s, length_m })
}

/// Gusts about the mean along each axis, at `rate_hz` for `time_s`.
fn record(mean: [f64; 3], rate_hz: u32, time_s: u64, seed: u64) -> [Vec<f64>; 3] {
    let config = InjectorConfig { rate_hz: rate_hz.into(), script: vec![wind(mean)] };
    let mut injector = Injector::new(&config, seed).unwrap();
    let mut axes: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::new());
    for k in 0..time_s * u64::from(rate_hz) {
        let sample = injector.step(k * 1_000_000_000 / u64::from(rate_hz));
        for (axis, channel) in axes.iter_mut().enumerate() {
            channel.push(sample.wind_w_m_s[axis] - mean[axis]);
        }
    }
    axes
}

fn autocorrelation(signal: &[f64], lag: usize) -> f64 {
    let pairs = signal.iter().zip(&signal[lag..]);
    let covariance = pairs.map(|(x, y)| x * y).sum::<f64>() / (signal.len() - lag) as f64;
    covariance / (signal.iter().map(|x| x * x).sum::<f64>() / signal.len() as f64)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and positive")]
fn samples(time_s: f64, rate_hz: u32) -> usize {
    (time_s * f64::from(rate_hz)).round() as usize
}

#[test]
fn the_gusts_have_the_configured_spread_and_correlation_time_at_50_and_200_hz() {
    for (mean, airspeed) in [(MEAN, 2.5_f64.sqrt()), ([0.0; 3], 1.0)] {
        for rate_hz in [50, 200] {
            let axes = record(mean, rate_hz, 20_000, 17);
            for (axis, gust) in axes.iter().enumerate() {
                let tau_s = LENGTH[axis] / airspeed;
                // 20 000 s hold at least 3300 independent values: σ is known to 1.3 %, the
                // correlations to about 0.02.
                let spread = gust.as_slice().std_dev() / SIGMA[axis];
                assert!((spread - 1.0).abs() < 0.04, "{rate_hz} Hz, axis {axis}: {spread}");
                for share in [0.25, 0.5, 1.0, 2.0] {
                    let measured = autocorrelation(gust, samples(share * tau_s, rate_hz));
                    let error = measured - libm::exp(-share);
                    assert!(error.abs() < 0.06, "{rate_hz} Hz, axis {axis}, {share} tau: {error}");
                }
            }
        }
    }
}

#[test]
fn the_gusts_are_stationary_from_their_first_sample_on() {
    let (mut first, mut later) = ([0.0; 3], [0.0; 3]);
    let count = 4000;
    for seed in 0..count {
        let axes = record(MEAN, 50, 1, seed);
        for axis in 0..3 {
            first[axis] += (axes[axis][0] / SIGMA[axis]).powi(2) / count as f64;
            later[axis] += (axes[axis][49] / SIGMA[axis]).powi(2) / count as f64;
        }
    }
    // The variance of 4000 draws is known to 2.2 %.
    for variance in first.into_iter().chain(later) {
        assert!((variance - 1.0).abs() < 0.08, "{variance}");
    }
}

#[test]
fn the_axes_are_independent_of_each_other() {
    let [x, y, z] = record(MEAN, 50, 20_000, 3);
    for (a, b) in [(&x, &y), (&y, &z), (&z, &x)] {
        let product = a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len() as f64;
        let correlation = product / (a.as_slice().std_dev() * b.as_slice().std_dev());
        assert!(correlation.abs() < 0.05, "{correlation}");
    }
}
