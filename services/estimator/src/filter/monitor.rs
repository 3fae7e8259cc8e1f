//! Are the innovations what the covariance promises? Gate counter and windowed NIS.
//!
//! NIS: normalised innovation squared, zᵀz with the whitened innovation z = L⁻¹r, S = L Lᵀ. In a
//! consistent filter the z are independent standard normals, so over a window of N fixes
//! N·mean(zᵀz) is χ²(6N) and N·|mean z|² is χ²(6) (Bar-Shalom, Li, Kirubarajan, *Estimation with
//! Applications to Tracking and Navigation*, 2001, section 5.4). The first finds noise that is larger
//! than promised, the second a bias, such as a jump of the gyro's, long before single fixes show it.
//! They ask for different things. After a bias the belief is wrong, and is re-opened. Larger noise is
//! believed from then on, by the mean NIS over what it should be: a belief that were re-opened would
//! follow that noise, and its velocity with it.

use nalgebra::Vector6;

use super::config::{FilterConfig, MAX_NIS_WINDOW};

/// What the monitor asks for after a fix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Advice {
    Keep,
    /// Re-open: the gate has been shut for too long; wider at each level.
    ReopenGate {
        level: u32,
    },
    /// Re-open: the innovations have a mean.
    ReopenBiased,
    /// Fixes are noisier than was believed.
    Noisier,
}

/// Largest factor on the variance of fixes.
const MAX_NOISE_SCALE: f64 = 100.0;
/// Degrees of freedom of a fix, the mean of its NIS.
const FREEDOM: f64 = 6.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Monitor {
    /// Whitened innovations, a ring from `next`.
    pub(super) window: [Vector6<f64>; MAX_NIS_WINDOW],
    pub(super) next: usize,
    pub(super) filled: usize,
    pub(super) rejections_in_row: u64,
    pub(super) reopen_level: u32,
    pub(super) alarm: bool,
    pub(super) last_nis: f64,
    /// Factor on the variance of fixes that they have shown, at least 1.
    pub(super) noise_scale: f64,
}

impl Monitor {
    pub(super) fn new() -> Self {
        Self {
            window: [Vector6::zeros(); MAX_NIS_WINDOW],
            next: 0,
            filled: 0,
            rejections_in_row: 0,
            reopen_level: 0,
            alarm: false,
            last_nis: 0.0,
            noise_scale: 1.0,
        }
    }

    /// Takes in a fix's whitened innovation and advises what to do about the covariance.
    pub(super) fn observe(&mut self, z: &Vector6<f64>, config: &FilterConfig) -> Advice {
        let nis = z.norm_squared();
        let gated = nis > config.fix_gate;
        self.last_nis = nis;
        // A refused fix counts as one at the gate: a single wild one must not raise the alarm.
        let clipped = if gated { z * f64::sqrt(config.fix_gate / nis) } else { *z };
        self.window[self.next] = clipped;
        self.next = (self.next + 1) % config.nis_window;
        self.filled = (self.filled + 1).min(config.nis_window);
        self.rejections_in_row = if gated { self.rejections_in_row.saturating_add(1) } else { 0 };
        if !gated {
            self.reopen_level = 0;
        }
        self.advise(config)
    }

    fn advise(&mut self, config: &FilterConfig) -> Advice {
        if self.rejections_in_row >= config.reopen_after_rejections {
            let level = self.reopen_level;
            self.reopen_level = (level + 1).min(u32::from(u8::MAX));
            self.rejections_in_row = 0;
            self.filled = 0;
            self.next = 0;
            return Advice::ReopenGate { level };
        }
        if self.filled < config.nis_window {
            return Advice::Keep;
        }
        let window = &self.window[..config.nis_window];
        let count = config.nis_window as f64;
        let mean_nis = window.iter().map(Vector6::norm_squared).sum::<f64>() / count;
        let mean = window.iter().fold(Vector6::zeros(), |sum, z| sum + z) / count;
        // A mean of larger noise is larger, too.
        let noise = ((mean_nis - mean.norm_squared()) / FREEDOM).max(1.0);
        let is_biased = count * mean.norm_squared() > config.nis_bias_alarm * noise;
        let is_noisy = mean_nis > config.nis_mean_alarm;
        let is_quiet = mean_nis < config.nis_mean_quiet && self.noise_scale > 1.0;
        self.alarm = is_biased || is_noisy;
        if !(self.alarm || is_quiet) {
            return Advice::Keep;
        }
        self.filled = 0;
        self.next = 0;
        if is_biased {
            return Advice::ReopenBiased;
        }
        self.noise_scale = (self.noise_scale * mean_nis / FREEDOM).clamp(1.0, MAX_NOISE_SCALE);
        if is_noisy { Advice::Noisier } else { Advice::Keep }
    }
}

#[cfg(test)]
mod tests {
    use statrs::distribution::{ChiSquared, ContinuousCDF};

    use super::*;

    fn quantile(freedom: f64, probability: f64) -> f64 {
        ChiSquared::new(freedom).unwrap().inverse_cdf(probability)
    }

    #[test]
    fn the_default_thresholds_are_the_quantiles_they_claim() {
        let config = FilterConfig::default();
        let window = config.nis_window as f64;
        assert!((config.fix_gate - quantile(6.0, 0.999)).abs() < 1e-2);
        assert!((config.morph_gate - quantile(1.0, 0.999)).abs() < 1e-2);
        let mean = quantile(6.0 * window, 1.0 - 1e-6) / window;
        assert!((config.nis_mean_alarm - mean).abs() < 1e-2, "{mean}");
        let quiet = quantile(6.0 * window, 1e-6) / window;
        assert!((config.nis_mean_quiet - quiet).abs() < 1e-2, "{quiet}");
        let bias = quantile(6.0, 1.0 - 1e-6);
        assert!((config.nis_bias_alarm - bias).abs() < 1e-2, "{bias}");
    }

    #[test]
    fn a_small_steady_innovation_alarms_though_every_fix_passes_the_gate() {
        let config = FilterConfig::default();
        let mut monitor = Monitor::new();
        let z = Vector6::new(0.0, 0.0, 0.0, 1.5, 0.0, 0.0);
        let advice: Vec<Advice> = (0..25).map(|_| monitor.observe(&z, &config)).collect();
        assert_eq!(advice[23], Advice::Keep);
        assert_eq!(advice[24], Advice::ReopenBiased);
        assert!((monitor.noise_scale - 1.0).abs() < 1e-12);
        assert!(monitor.alarm);
    }

    #[test]
    fn larger_noise_without_a_bias_is_believed_until_it_has_gone() {
        let config = FilterConfig::default();
        let mut monitor = Monitor::new();
        // What the filter whitens with is what the monitor believes.
        let mut observe = |variance: f64, fixes: i32| -> (usize, f64) {
            let noisier = (0..fixes).filter(|k| {
                let size = f64::sqrt(variance / monitor.noise_scale);
                let z = Vector6::repeat(f64::from(1 - 2 * (k % 2)) * size);
                let advice = monitor.observe(&z, &config);
                assert_ne!(advice, Advice::ReopenBiased);
                advice == Advice::Noisier
            });
            (noisier.count(), monitor.noise_scale)
        };
        assert_eq!(observe(1.5, 500), (0, 1.0), "within what chance allows");
        let (count, scale) = observe(1.7, 500);
        // Once, as soon as the window has enough of it.
        assert!(count == 1 && (1.6..=1.7).contains(&scale), "{count} {scale}");
        assert_eq!(observe(1.0, 500), (0, scale), "within what chance allows");
        assert_eq!(observe(0.5, 500), (0, 1.0));
    }

    #[test]
    fn the_alarm_ends_with_the_first_consistent_window() {
        let config = FilterConfig::default();
        let mut monitor = Monitor::new();
        let biased = Vector6::repeat(2.0_f64.sqrt());
        (0..25).for_each(|_| _ = monitor.observe(&biased, &config));
        assert!(monitor.alarm);
        let balanced = |k: i32| Vector6::repeat(f64::from(1 - 2 * (k % 2)));
        (0..24).for_each(|k| _ = monitor.observe(&balanced(k), &config));
        assert!(monitor.alarm);
        monitor.observe(&balanced(24), &config);
        assert!(!monitor.alarm);
    }

    #[test]
    fn one_wild_fix_neither_alarms_nor_reopens() {
        let config = FilterConfig::default();
        let mut monitor = Monitor::new();
        for k in 0..100 {
            let sign = f64::from(1 - 2 * (k % 2));
            let z = if k == 50 { Vector6::repeat(1e6) } else { Vector6::repeat(sign) };
            assert_eq!(monitor.observe(&z, &config), Advice::Keep, "{k}");
        }
    }

    #[test]
    fn ten_rejections_in_a_row_reopen_wider_each_time() {
        let config = FilterConfig::default();
        let mut monitor = Monitor::new();
        let wild = Vector6::repeat(100.0);
        let levels: Vec<u32> = (0..30)
            .filter_map(|_| match monitor.observe(&wild, &config) {
                Advice::ReopenGate { level } => Some(level),
                _ => None,
            })
            .collect();
        assert_eq!(levels, [0, 1, 2]);
        monitor.observe(&Vector6::zeros(), &config);
        assert_eq!(monitor.reopen_level, 0);
    }
}
