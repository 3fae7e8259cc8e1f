//! Release grids: instant k of a loop at rate r is floor(k·10⁹ / r) nanoseconds, in integers.

use thiserror::Error;

/// Highest rate a loop may ask for \[Hz\].
pub const MAX_RATE_HZ: f64 = 10_000.0;

/// A loop rate, exact to a thousandth of a hertz so that 150 Hz keeps an exact grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate {
    millihertz: u64,
}

/// Why a number is not a rate.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "a rate of {0} Hz is not possible: use a number from 0.001 to 10000 with at most three decimals"
)]
pub struct RateError(pub f64);

impl Rate {
    /// A rate from hertz.
    ///
    /// # Errors
    /// The number is not finite, not in (0, 10000], or finer than 0.001 Hz.
    pub fn from_hz(hz: f64) -> Result<Self, RateError> {
        if !(hz > 0.0 && hz <= MAX_RATE_HZ) {
            return Err(RateError(hz));
        }
        let millihertz = (hz * 1e3).round();
        if millihertz < 1.0 || (millihertz - hz * 1e3).abs() > 1e-6 {
            return Err(RateError(hz));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1..=1e7")]
        Ok(Self { millihertz: millihertz as u64 })
    }

    /// The rate \[Hz\].
    #[must_use]
    pub fn hz(self) -> f64 {
        self.millihertz as f64 / 1e3
    }

    /// Length of the longest interval between two releases \[ns\].
    #[must_use]
    pub fn period_ns(self) -> u64 {
        1_000_000_000_000_u64.div_ceil(self.millihertz)
    }

    /// Instant of release `k` \[ns\].
    #[must_use]
    pub fn release_ns(self, k: u64) -> u64 {
        scaled(k, 1_000_000_000_000, self.millihertz)
    }

    /// Index of the first release at or after `t_ns`.
    #[must_use]
    pub fn first_at_or_after(self, t_ns: u64) -> u64 {
        let k = scaled(t_ns, self.millihertz, 1_000_000_000_000);
        // floor() of the grid may place release k before t or exactly on it.
        if self.release_ns(k) >= t_ns { k } else { k + 1 }
    }
}

/// floor(a·b / c), at most [`u64::MAX`]. Wide division is slow and rarely needed.
fn scaled(a: u64, b: u64, c: u64) -> u64 {
    match a.checked_mul(b) {
        Some(product) => product / c,
        None => u64::try_from(u128::from(a) * u128::from(b) / u128::from(c)).unwrap_or(u64::MAX),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_rate_that_does_not_divide_a_second_keeps_its_grid_for_an_hour() {
        let rate = Rate::from_hz(150.0).unwrap();
        assert_eq!(rate.release_ns(1), 6_666_666);
        assert_eq!(rate.release_ns(3), 20_000_000);
        assert_eq!(rate.release_ns(150 * 3600), 3_600_000_000_000);
    }

    #[test]
    fn impossible_rates_are_refused() {
        for hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 10_001.0, 33.33333] {
            assert!(Rate::from_hz(hz).is_err(), "{hz}");
        }
    }

    proptest! {
        #[test]
        fn the_first_release_at_or_after_an_instant_is_the_first(
            millihertz in 1_u64..10_000_000, t_ns in 0_u64..10_000_000_000_000) {
            let rate = Rate { millihertz };
            let k = rate.first_at_or_after(t_ns);
            prop_assert!(rate.release_ns(k) >= t_ns);
            prop_assert!(k == 0 || rate.release_ns(k - 1) < t_ns);
        }
    }
}
