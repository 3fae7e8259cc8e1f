//! Rotors and morph servo. Both are linear under a held command (the servo piecewise), so their
//! paths inside a step are known exactly and the integrator only samples them.

use crate::{MorphAngle, VehicleParameters};

/// Thrust behind a first-order lag after a share of its step response, F + (u − F) share.
pub(crate) fn lagged_thrusts(start: &[f64; 4], command: &[f64; 4], share: f64) -> [f64; 4] {
    std::array::from_fn(|i| start[i] + (command[i] - start[i]) * share)
}

/// Morph angle and its rate \[rad/s\] at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Morph {
    pub(crate) beta: MorphAngle,
    pub(crate) rate: f64,
}

impl VehicleParameters {
    /// β `duration_s` \[s\] after the servo is commanded to `command` at `beta`.
    #[must_use]
    pub fn servo_angle_after(
        &self,
        beta: MorphAngle,
        command: MorphAngle,
        duration_s: f64,
    ) -> MorphAngle {
        ServoPath::new(self, beta, command).at(duration_s).beta
    }
}

/// Path of the servo under a held command: β̇ = sat((u − β)/τ, ± rate limit).
#[derive(Debug, Clone, Copy)]
pub(crate) struct ServoPath {
    command: f64,
    /// u − β at the start.
    error: f64,
    lag: f64,
    rate_limit: f64,
}

impl ServoPath {
    /// From `beta` towards `command`.
    pub(crate) fn new(
        parameters: &VehicleParameters,
        beta: MorphAngle,
        command: MorphAngle,
    ) -> Self {
        Self {
            command: command.rad(),
            error: command.rad() - beta.rad(),
            lag: parameters.servo_lag_s,
            rate_limit: parameters.servo_rate_limit_rad_s,
        }
    }

    /// The servo `t` seconds on: at the rate limit until |u − β| = limit · τ, then exponential.
    pub(crate) fn at(&self, t: f64) -> Morph {
        let knee = self.rate_limit * self.lag;
        let slide = ((self.error.abs() - knee) / self.rate_limit).max(0.0);
        let remaining = if t < slide {
            self.error.abs() - self.rate_limit * t
        } else {
            self.error.abs().min(knee) * libm::exp((slide - t) / self.lag)
        };
        let rate = (remaining / self.lag).min(self.rate_limit).copysign(self.error);
        let angle = self.command - remaining.copysign(self.error);
        // Between two angles of the range, so saturation only removes rounding.
        let beta = MorphAngle::saturating_from_rad(angle).unwrap_or(MorphAngle::MIN);
        Morph { beta, rate }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forward Euler with tiny steps, as an independent solution.
    fn by_small_steps(parameters: &VehicleParameters, from: f64, to: f64, time: f64) -> f64 {
        let (n, limit) = (200_000, parameters.servo_rate_limit_rad_s);
        let h = time / f64::from(n);
        (0..n).fold(from, |b, _| b + h * ((to - b) / parameters.servo_lag_s).clamp(-limit, limit))
    }

    #[test]
    fn the_servo_path_solves_its_differential_equation() {
        let parameters = VehicleParameters::default();
        for (from, to) in [(45.0, 160.0), (160.0, 45.0), (90.0, 95.0), (100.0, 100.0)] {
            let start = MorphAngle::from_degrees(from).unwrap();
            let command = MorphAngle::from_degrees(to).unwrap();
            let path = ServoPath::new(&parameters, start, command);
            for time in [0.001, 0.05, 0.14, 0.16, 0.3] {
                let expected = by_small_steps(&parameters, start.rad(), command.rad(), time);
                assert!((path.at(time).beta.rad() - expected).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn the_servo_never_turns_faster_than_its_limit_and_uses_it() {
        let parameters = VehicleParameters::default();
        let path = ServoPath::new(&parameters, MorphAngle::MIN, MorphAngle::MAX);
        let limit = parameters.servo_rate_limit_rad_s;
        assert!((path.at(0.1).rate - limit).abs() < 1e-12);
        assert!((path.at(0.1).beta.degrees() - 115.0).abs() < 1e-10);
        let mut rates = (0..400).map(|ms| path.at(f64::from(ms) * 1e-3).rate);
        assert!(rates.all(|rate| (0.0..=limit).contains(&rate)));
        assert!(path.at(0.4).rate < 1e-3 * limit);
    }
}
