//! Exact sampling of the laws' prediction models, in closed form.

/// One axis y'' = g a - d y' with the actuator a' = (u - a)/lag and u taking effect `delay_s` late.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedAxis {
    /// g: acceleration per unit of actuator (1/I for a torque, g for a tilt angle).
    pub gain: f64,
    /// First-order lag \[s\], >= 0; 0 is an ideal actuator.
    pub lag_s: f64,
    /// Delay of the command \[s\], within 0..=period.
    pub delay_s: f64,
    /// d: deceleration per unit of rate \[1/s\], >= 0 and below 1/lag.
    pub drag_per_s: f64,
}

/// Exact hold of one constant command: coefficients of (y', a, u) in position and rate, of (a, u) in the actuator.
struct Hold {
    position: [f64; 3],
    rate: [f64; 3],
    actuator: [f64; 2],
}

impl LaggedAxis {
    /// Largest drag \[1/s\] that the sampled model takes behind such a lag \[s\]: by far slower than the lag.
    #[must_use]
    pub fn drag_max_per_s(lag_s: f64) -> f64 {
        0.5 / lag_s.max(1e-3)
    }

    /// a(h) = e a + (1 - e) u with e = exp(-h/lag); rate and position are its integrals, without drag.
    fn hold(&self, h: f64) -> Hold {
        let (rise, lagged) = if self.lag_s > 0.0 {
            let rise = -libm::expm1(-h / self.lag_s);
            (rise, self.lag_s * rise)
        } else {
            (1.0, 0.0)
        };
        let actuator = [1.0 - rise, rise];
        if self.drag_per_s > 0.0 {
            let [rate, position] = self.slowed(h, lagged);
            return Hold { position, rate, actuator };
        }
        let twice_lagged = self.lag_s * (h - lagged);
        Hold {
            position: [h, self.gain * twice_lagged, self.gain * (0.5 * h * h - twice_lagged)],
            rate: [1.0, self.gain * lagged, self.gain * (h - lagged)],
            actuator,
        }
    }

    /// Coefficients of (y', a, u) in rate and position with drag: what the actuator does, convolved with exp(-d t), and the
    /// integral of that. `lagged` is the integral of exp(-t/lag).
    fn slowed(&self, h: f64, lagged: f64) -> [[f64; 3]; 2] {
        let Self { gain, lag_s, drag_per_s: d, .. } = *self;
        let x = d * h;
        // The integral of exp(-d t), and the integral of that; the difference loses its digits where x is small.
        let once = -libm::expm1(-x) / d;
        let twice = if x < 1e-2 {
            let series = [1.0 / 2.0, -1.0 / 6.0, 1.0 / 24.0, -1.0 / 120.0, 1.0 / 720.0];
            h * h * series.iter().rev().fold(0.0, |sum, term| sum * x + term)
        } else {
            (h - once) / d
        };
        let apart = 1.0 - d * lag_s;
        let rate = (lagged - d * lag_s * once) / apart;
        let position = lag_s * (once - lagged) / apart;
        [
            [1.0 - d * once, gain * rate, gain * (once - rate)],
            [once, gain * position, gain * (twice - position)],
        ]
    }

    /// The actuator after `duration_s` \[s\] of the constant command, from `actuator`.
    #[must_use]
    pub fn actuator_after(&self, actuator: f64, command: f64, duration_s: f64) -> f64 {
        if duration_s <= 0.0 {
            return actuator;
        }
        let [from_actuator, from_command] = self.hold(duration_s).actuator;
        from_actuator * actuator + from_command * command
    }

    /// One period \[s\] from (position, rate, actuator, u(k-1)), with u(k) from `delay_s` on.
    #[must_use]
    pub fn advance(&self, state: [f64; 4], u: f64, period: f64) -> [f64; 4] {
        let [mut position, mut rate, mut actuator, previous] = state;
        for (duration, command) in [(self.delay_s, previous), (period - self.delay_s, u)] {
            if duration <= 0.0 {
                continue;
            }
            let hold = self.hold(duration);
            let [by_rate, by_actuator, by_command] = hold.position;
            position += by_rate * rate + by_actuator * actuator + by_command * command;
            let [by_rate, by_actuator, by_command] = hold.rate;
            rate = by_rate * rate + (by_actuator * actuator + by_command * command);
            actuator = hold.actuator[0] * actuator + hold.actuator[1] * command;
        }
        [position, rate, actuator, u]
    }
}

#[cfg(test)]
#[path = "../tests/common/exponential.rs"]
mod exponential;

#[cfg(test)]
mod tests {
    use super::exponential::exponential;
    use super::*;
    use nalgebra::Matrix5;

    /// d/dt [y, y', a, u(k-1), u(k)] while `active` (3 or 4) drives the actuator.
    fn continuous(axis: &LaggedAxis, active: usize) -> Matrix5<f64> {
        let mut m = Matrix5::zeros();
        m[(0, 1)] = 1.0;
        m[(1, 1)] = -axis.drag_per_s;
        m[(1, 2)] = axis.gain;
        m[(2, 2)] = -1.0 / axis.lag_s;
        m[(2, active)] = 1.0 / axis.lag_s;
        m
    }

    /// Columns of the sampled A, then B.
    fn sampled(axis: &LaggedAxis, period: f64) -> [[f64; 4]; 5] {
        core::array::from_fn(|column| {
            let unit = core::array::from_fn(|row| f64::from(row == column));
            axis.advance(unit, f64::from(column == 4), period)
        })
    }

    #[test]
    fn the_lagged_model_is_the_matrix_exponential_of_its_two_phases() {
        for (gain, lag_s, delay_s, drag_per_s, period) in [
            (1e4, 0.015, 0.001, 0.0, 0.01),
            (2500.0, 0.03, 0.0, 0.0, 0.02),
            (9.81, 0.05, 0.002, 0.0, 0.002),
            (9.81, 0.035, 0.01, 0.4, 0.02),
            (9.81, 0.035, 0.01, 8.0, 0.02),
        ] {
            let axis = LaggedAxis { gain, lag_s, delay_s, drag_per_s };
            let exact = exponential(continuous(&axis, 4) * (period - delay_s))
                * exponential(continuous(&axis, 3) * delay_s);
            for (column, image) in sampled(&axis, period).iter().enumerate() {
                for row in 0..3 {
                    let error = image[row] - exact[(row, column)];
                    assert!(error.abs() <= 1e-12 * gain.max(1.0), "{row} {column}");
                }
                assert_eq!(image[3], f64::from(column == 4));
            }
        }
    }

    #[test]
    fn without_lag_and_delay_the_lagged_model_is_the_papers() {
        let (gain, period) = (1e4, 0.01);
        let [position, rate, actuator, previous, command] =
            sampled(&LaggedAxis { gain, lag_s: 0.0, delay_s: 0.0, drag_per_s: 0.0 }, period);
        assert_eq!((position, rate[0], rate[1]), ([1.0, 0.0, 0.0, 0.0], period, 1.0));
        assert_eq!((actuator, previous), ([0.0; 4], [0.0; 4]));
        assert!((command[0] - 0.5 * gain * period * period).abs() < 1e-15);
        assert!((command[1] - gain * period).abs() < 1e-13);
    }

    #[test]
    fn the_actuator_copy_follows_the_exponential_and_stays_put_for_no_time() {
        let axis = LaggedAxis { gain: 1.0, lag_s: 0.015, delay_s: 0.0, drag_per_s: 0.0 };
        let after = axis.actuator_after(0.2, 1.0, 0.015);
        assert!((after - (1.0 - 0.8 * libm::exp(-1.0))).abs() < 1e-15);
        assert_eq!(axis.actuator_after(0.2, 1.0, 0.0), 0.2);
    }
}
