//! Seconds as people write them, and nanoseconds as the flight counts them.

/// Nanoseconds of a time in seconds, to the nearest; 0 for a negative time and for NaN, and `u64::MAX` for one
/// that is too long.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
pub fn ns_from_s(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

/// Seconds of a time in nanoseconds. A division, because it is rounded correctly: 300 000 000 ns are the same
/// number as a configured 0.3 s.
#[must_use]
pub fn s_from_ns(time_ns: u64) -> f64 {
    time_ns as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_the_nearest_nanosecond_and_back() {
        assert_eq!(ns_from_s(2.01), 2_010_000_000);
        assert_eq!(ns_from_s(0.6e-9), 1);
        assert_eq!(s_from_ns(300_000_000).to_bits(), 0.3_f64.to_bits());
    }

    #[test]
    fn a_time_that_cannot_be_counted_saturates() {
        assert_eq!([-1.0, f64::NAN].map(ns_from_s), [0, 0]);
        assert_eq!([f64::INFINITY, 1e12].map(ns_from_s), [u64::MAX; 2]);
    }
}
