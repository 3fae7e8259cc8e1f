//! One-sided 95 % limits on a share of which so many of so many were seen (Clopper and Pearson, 1934).

/// Share of chance that a limit leaves out.
const LEFT_OUT: f64 = 0.05;

/// The share is at most this, at 95 %.
#[must_use]
pub fn upper_limit(seen: u32, of: u32) -> f64 {
    if seen >= of {
        return 1.0;
    }
    // The share at which as few as were seen have just a chance of 5 %.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if at_most(seen, of, middle) > LEFT_OUT { low = middle } else { high = middle }
    }
    high
}

/// The share is at least this, at 95 %.
#[must_use]
pub fn lower_limit(seen: u32, of: u32) -> f64 {
    1.0 - upper_limit(of - seen.min(of), of)
}

/// Chance that at most `seen` of `of` come, each with the chance `p`: sum of binomial terms.
fn at_most(seen: u32, of: u32, p: f64) -> f64 {
    let (log_p, log_q) = (libm::log(p), libm::log1p(-p));
    let n = f64::from(of);
    let mut log_choose = 0.0;
    let mut sum = 0.0;
    for k in 0..=seen {
        let k = f64::from(k);
        if k > 0.0 {
            log_choose += libm::log((n - k + 1.0) / k);
        }
        sum += libm::exp(log_choose + k * log_p + (n - k) * log_q);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_the_closed_forms_and_of_the_tables() {
        // Of none seen: 1 − 0.05^(1/n).
        assert!((upper_limit(0, 80) - (1.0 - libm::pow(0.05, 1.0 / 80.0))).abs() < 1e-9);
        // Quantile 0.95 of the beta distribution with 2 and 9 degrees.
        assert!((upper_limit(1, 10) - 0.394_163).abs() < 1e-5);
        assert!((lower_limit(10, 10) - libm::pow(0.05, 0.1)).abs() < 1e-9);
        assert!((upper_limit(5, 5) - 1.0).abs() < 1e-12);
        assert!(lower_limit(0, 5).abs() < 1e-12);
    }
}
