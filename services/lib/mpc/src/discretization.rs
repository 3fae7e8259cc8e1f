//! Exact sampling of the laws' prediction models, in closed form.

/// One axis y'' = g a with the actuator a' = (u - a)/lag and u taking effect `delay_s` late.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedAxis {
    /// g: acceleration per unit of actuator (1/I for a torque, g for a tilt angle).
    pub gain: f64,
    /// First-order lag \[s\], >= 0; 0 is an ideal actuator.
    pub lag_s: f64,
    /// Delay of the command \[s\], within 0..=period.
    pub delay_s: f64,
}

/// Exact hold of one constant command: coefficients of (a, u) in position, rate and actuator.
struct Hold {
    duration: f64,
    position: [f64; 2],
    rate: [f64; 2],
    actuator: [f64; 2],
}

impl LaggedAxis {
    /// a(h) = e a + (1 - e) u with e = exp(-h/lag); rate and position are its integrals.
    fn hold(&self, h: f64) -> Hold {
        let (rise, lagged) = if self.lag_s > 0.0 {
            let rise = -libm::expm1(-h / self.lag_s);
            (rise, self.lag_s * rise)
        } else {
            (1.0, 0.0)
        };
        let twice_lagged = self.lag_s * (h - lagged);
        Hold {
            duration: h,
            position: [self.gain * twice_lagged, self.gain * (0.5 * h * h - twice_lagged)],
            rate: [self.gain * lagged, self.gain * (h - lagged)],
            actuator: [1.0 - rise, rise],
        }
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
            position +=
                hold.duration * rate + hold.position[0] * actuator + hold.position[1] * command;
            rate += hold.rate[0] * actuator + hold.rate[1] * command;
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
        for (gain, lag_s, delay_s, period) in
            [(1e4, 0.015, 0.001, 0.01), (2500.0, 0.03, 0.0, 0.02), (9.81, 0.05, 0.002, 0.002)]
        {
            let axis = LaggedAxis { gain, lag_s, delay_s };
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
            sampled(&LaggedAxis { gain, lag_s: 0.0, delay_s: 0.0 }, period);
        assert_eq!((position, rate[0], rate[1]), ([1.0, 0.0, 0.0, 0.0], period, 1.0));
        assert_eq!((actuator, previous), ([0.0; 4], [0.0; 4]));
        assert!((command[0] - 0.5 * gain * period * period).abs() < 1e-15);
        assert!((command[1] - gain * period).abs() < 1e-13);
    }

    #[test]
    fn the_actuator_copy_follows_the_exponential_and_stays_put_for_no_time() {
        let axis = LaggedAxis { gain: 1.0, lag_s: 0.015, delay_s: 0.0 };
        let after = axis.actuator_after(0.2, 1.0, 0.015);
        assert!((after - (1.0 - 0.8 * libm::exp(-1.0))).abs() < 1e-15);
        assert_eq!(axis.actuator_after(0.2, 1.0, 0.0), 0.2);
    }
}
