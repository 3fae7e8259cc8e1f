//! Smooth starts and stops: how far along a path one is, as a function of time.

/// Rest-to-rest blend of least squared jerk, h(τ) = 10τ³ − 15τ⁴ + 6τ⁵ (Flash and Hogan, "The
/// coordination of arm movements", 1985): \[h, h', h''\] with τ clamped to \[0, 1\].
pub(super) fn minimum_jerk(tau: f64) -> [f64; 3] {
    let tau = tau.clamp(0.0, 1.0);
    let rest = 1.0 - tau;
    [
        tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0)),
        30.0 * tau * tau * rest * rest,
        60.0 * tau * rest * (1.0 - 2.0 * tau),
    ]
}

/// Where |h''| is largest, at the roots of 1 − 6τ + 6τ², and between them where h' is.
pub(super) const MINIMUM_JERK_PEAKS: [f64; 3] =
    [0.211_324_865_405_187_1, 0.5, 0.788_675_134_594_812_9];

/// ∫₀^τ h = 5/2 τ⁴ − 3 τ⁵ + τ⁶; one half at τ = 1.
fn minimum_jerk_integral(tau: f64) -> f64 {
    let squared = tau * tau;
    squared * squared * (2.5 + tau * (tau - 3.0))
}

/// s(t) with ṡ rising from 0 to 1 over the lead-in and falling back to 0 over the lead-out, each
/// along [`minimum_jerk`]; s is three times continuously differentiable.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeScaling {
    lead_in_s: f64,
    lead_out_s: f64,
    /// Infinite if it never stops.
    lead_out_start_s: f64,
}

impl TimeScaling {
    /// Never stops.
    pub(super) fn endless(lead_in_s: f64) -> Self {
        Self { lead_in_s, lead_out_s: 1.0, lead_out_start_s: f64::INFINITY }
    }

    /// Comes to rest at s = `end_s`, which must leave room for both leads.
    pub(super) fn ending_at(end_s: f64, lead_in_s: f64, lead_out_s: f64) -> Self {
        Self { lead_in_s, lead_out_s, lead_out_start_s: end_s + 0.5 * (lead_in_s - lead_out_s) }
    }

    /// Smallest `end_s` that leaves room for both leads.
    pub(super) fn shortest_end_s(lead_in_s: f64, lead_out_s: f64) -> f64 {
        0.5 * (lead_in_s + lead_out_s)
    }

    /// Instant at which it begins to slow down \[s\]; infinite if it never does.
    pub(super) fn lead_out_start_s(&self) -> f64 {
        self.lead_out_start_s
    }

    /// \[s, ṡ, s̈\] at `t_s`.
    pub(super) fn at(&self, t_s: f64) -> [f64; 3] {
        let Self { lead_in_s, lead_out_s, lead_out_start_s } = *self;
        if t_s <= 0.0 {
            return [0.0; 3];
        }
        if t_s < lead_in_s {
            let tau = t_s / lead_in_s;
            let [h, slope, _] = minimum_jerk(tau);
            return [lead_in_s * minimum_jerk_integral(tau), h, slope / lead_in_s];
        }
        if t_s < lead_out_start_s {
            return [t_s - 0.5 * lead_in_s, 1.0, 0.0];
        }
        let tau = ((t_s - lead_out_start_s) / lead_out_s).min(1.0);
        let [h, slope, _] = minimum_jerk(tau);
        let left = lead_out_s * (tau - minimum_jerk_integral(tau));
        [lead_out_start_s - 0.5 * lead_in_s + left, 1.0 - h, -slope / lead_out_s]
    }
}

#[cfg(test)]
mod tests {
    use super::{TimeScaling, minimum_jerk};

    #[test]
    fn the_blend_satisfies_its_six_boundary_conditions() {
        for (tau, value) in [(0.0, 0.0), (1.0, 1.0)] {
            let [h, slope, bend] = minimum_jerk(tau);
            assert!((h - value).abs() + slope.abs() + bend.abs() < 1e-15);
        }
        let [value, slope, bend] = minimum_jerk(0.5);
        assert!((value - 0.5).abs() < 1e-15 && (slope - 1.875).abs() < 1e-15 && bend == 0.0);
    }

    #[test]
    fn the_speed_integrates_to_the_way_and_the_acceleration_to_the_speed() {
        let scaling = TimeScaling::ending_at(5.0, 2.0, 1.0);
        let step = 1e-3;
        let (mut way, mut speed) = (0.0, 0.0);
        for i in 0..7000 {
            // Simpson's rule is exact up to cubics, so its error is about step^4.
            let t = f64::from(i) * step;
            let [a, b, c] = [scaling.at(t), scaling.at(t + 0.5 * step), scaling.at(t + step)];
            way += step / 6.0 * (a[1] + 4.0 * b[1] + c[1]);
            speed += step / 6.0 * (a[2] + 4.0 * b[2] + c[2]);
            assert!((way - c[0]).abs() < 1e-10, "way at {t}: {way} against {}", c[0]);
            assert!((speed - c[1]).abs() < 1e-10, "speed at {t}: {speed} against {}", c[1]);
        }
        assert!((way - 5.0).abs() < 1e-10 && speed.abs() < 1e-10);
    }
}
