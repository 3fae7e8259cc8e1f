//! Measurement model of the morph angle's encoder: a Kalman filter of its own on (β, β̇).
//!
//! β̈ is taken for white noise (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2), strong enough for
//! the ends of a sweep to pass the gate.

use super::config::{FilterConfig, InitialState};
use super::sample::{MorphAngleSample, Verdict};

/// 1σ before the first reading: the initial angle is known to a degree and at rest.
const INITIAL_SIGMA: [f64; 2] = [0.02, 0.5];
/// 1σ after a re-opening: the servo's fastest rate, 700 °/s, and what it covers in 40 ms.
const REOPENED_SIGMA: [f64; 2] = [0.5, 12.0];

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MorphFilter {
    pub(super) time_ns: u64,
    /// A first reading has been taken.
    pub(super) started: bool,
    pub(super) angle: f64,
    pub(super) rate: f64,
    /// P: angle, cross, rate.
    pub(super) covariance: [f64; 3],
    pub(super) rejections_in_row: u64,
}

impl MorphFilter {
    pub(super) fn new(initial: &InitialState) -> Self {
        Self {
            time_ns: initial.time_ns,
            started: false,
            angle: initial.morph_angle_rad,
            rate: 0.0,
            covariance: diagonal(INITIAL_SIGMA),
            rejections_in_row: 0,
        }
    }

    pub(super) fn update(&mut self, sample: &MorphAngleSample, config: &FilterConfig) -> Verdict {
        if !sample.angle_rad.is_finite() {
            return Verdict::NotFinite;
        }
        if !(config.morph_min_rad..=config.morph_max_rad).contains(&sample.angle_rad) {
            return Verdict::OutOfRange;
        }
        if sample.time_ns < self.time_ns || (self.started && sample.time_ns == self.time_ns) {
            return Verdict::OutOfOrder;
        }
        self.predict(sample.time_ns, config);
        self.started = true;
        let residual = sample.angle_rad - self.angle;
        let variance = self.covariance[0] + config.morph_sigma_rad * config.morph_sigma_rad;
        if residual * residual > config.morph_gate * variance {
            self.reject(config);
            return Verdict::Gated;
        }
        self.rejections_in_row = 0;
        self.correct(residual, variance);
        Verdict::Accepted
    }

    /// Angle \[rad\] and rate \[rad/s\] at `time_ns`; past the coasting limit the angle is held and the
    /// rate is zero.
    pub(super) fn at(&self, time_ns: u64, config: &FilterConfig) -> (f64, f64) {
        let age_ns = time_ns.saturating_sub(self.time_ns);
        let ahead = self.rate * age_ns.min(config.morph_coast_ns) as f64 * 1e-9;
        let angle = (self.angle + ahead).clamp(config.morph_min_rad, config.morph_max_rad);
        (angle, if age_ns > config.morph_coast_ns { 0.0 } else { self.rate })
    }

    /// F = [1 dt; 0 1], Q = q² [dt³/3 dt²/2; dt²/2 dt].
    fn predict(&mut self, time_ns: u64, config: &FilterConfig) {
        let age_ns = time_ns.saturating_sub(self.time_ns);
        let (angle, rate) = self.at(time_ns, config);
        let dt = age_ns as f64 * 1e-9;
        let q = config.morph_accel_noise_rad_s2_rthz * config.morph_accel_noise_rad_s2_rthz;
        let [pp, pr, rr] = self.covariance;
        self.covariance = [
            pp + dt * (2.0 * pr + dt * rr) + q * dt * dt * dt / 3.0,
            pr + dt * rr + q * dt * dt / 2.0,
            rr + q * dt,
        ];
        (self.time_ns, self.angle, self.rate) = (time_ns, angle, rate);
        if age_ns > config.morph_coast_ns {
            // Nothing is known of what happened meanwhile, and the polynomial would overflow.
            self.covariance = diagonal(REOPENED_SIGMA);
        }
    }

    fn reject(&mut self, config: &FilterConfig) {
        self.rejections_in_row = self.rejections_in_row.saturating_add(1);
        if self.rejections_in_row >= config.reopen_after_rejections {
            self.rejections_in_row = 0;
            self.covariance = diagonal(REOPENED_SIGMA);
        }
    }

    fn correct(&mut self, residual: f64, variance: f64) {
        let [pp, pr, rr] = self.covariance;
        let (k_angle, k_rate) = (pp / variance, pr / variance);
        self.angle += k_angle * residual;
        self.rate += k_rate * residual;
        self.covariance = [(1.0 - k_angle) * pp, (1.0 - k_angle) * pr, rr - k_rate * pr];
    }
}

fn diagonal([angle, rate]: [f64; 2]) -> [f64; 3] {
    [angle * angle, 0.0, rate * rate]
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 5_000_000;

    fn reading(k: u64, angle_rad: f64) -> MorphAngleSample {
        MorphAngleSample { time_ns: k * PERIOD_NS, angle_rad }
    }

    #[test]
    fn an_exact_constant_rate_is_found_exactly() {
        let config = FilterConfig::default();
        let mut filter = MorphFilter::new(&InitialState::default());
        for k in 0..60 {
            let angle = 0.8 + 2.0 * k as f64 * 5e-3;
            assert_eq!(filter.update(&reading(k, angle), &config), Verdict::Accepted);
        }
        let (angle, rate) = filter.at(60 * PERIOD_NS, &config);
        assert!((rate - 2.0).abs() < 1e-6 && (angle - 1.4).abs() < 1e-6, "{angle} {rate}");
    }

    #[test]
    fn readings_out_of_range_or_order_change_nothing() {
        let config = FilterConfig::default();
        let mut filter = MorphFilter::new(&InitialState::default());
        filter.update(&reading(3, 0.8), &config);
        let before = filter;
        let cases = [
            (reading(4, f64::NAN), Verdict::NotFinite),
            (reading(4, 0.1), Verdict::OutOfRange),
            (reading(3, 0.8), Verdict::OutOfOrder),
            (reading(2, 0.8), Verdict::OutOfOrder),
        ];
        for (sample, wanted) in cases {
            assert_eq!(filter.update(&sample, &config), wanted);
            assert_eq!(filter, before);
        }
    }

    #[test]
    fn without_readings_the_angle_coasts_and_then_holds() {
        let config = FilterConfig::default();
        let mut filter = MorphFilter::new(&InitialState::default());
        filter.rate = 10.0;
        let (coasting, _) = filter.at(10_000_000, &config);
        assert!((coasting - filter.angle - 0.1).abs() < 1e-12);
        assert_eq!(filter.at(u64::MAX, &config), (filter.angle + 0.2, 0.0));
        assert_eq!(filter.update(&reading(u64::MAX / PERIOD_NS, 1.0), &config), Verdict::Accepted);
        assert!((filter.angle - 1.0).abs() < 1e-4);
    }
}
