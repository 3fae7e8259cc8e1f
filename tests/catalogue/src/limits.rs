//! One-sided 95 % confidence limits on a probability, from the number of successes in independent trials
//! (Clopper and Pearson, 1934).

/// Probability that a limit does not hold: one minus the confidence level.
const LEFT_OUT: f64 = 0.05;

/// Upper confidence limit on the probability of an event seen `seen` times in `of` trials; 1 if there are no
/// trials.
#[must_use]
pub fn upper_limit(seen: u32, of: u32) -> f64 {
    if seen >= of {
        return 1.0;
    }
    // Bisection for the probability at which so few events or fewer are seen in 5 % of all experiments.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if at_most(seen, of, middle) > LEFT_OUT { low = middle } else { high = middle }
    }
    high
}

/// Lower confidence limit on the probability of an event seen `seen` times in `of` trials; 0 if there are no
/// trials.
#[must_use]
pub fn lower_limit(seen: u32, of: u32) -> f64 {
    1.0 - upper_limit(of - seen.min(of), of)
}

/// Binomial distribution function: the probability of at most `seen` events in `of` trials with the
/// probability `p` each.
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
    fn limits_agree_with_closed_forms_and_quantiles_of_the_beta_distribution() {
        // For no event in n trials the upper limit is 1 − 0.05^(1/n).
        assert!((upper_limit(0, 80) - (1.0 - libm::pow(0.05, 1.0 / 80.0))).abs() < 1e-9);
        // The 0.95 quantile of the beta distribution with the parameters 2 and 9.
        assert!((upper_limit(1, 10) - 0.394_163).abs() < 1e-5);
        assert!((lower_limit(10, 10) - libm::pow(0.05, 0.1)).abs() < 1e-9);
        assert!((upper_limit(5, 5) - 1.0).abs() < 1e-12);
        assert!(lower_limit(0, 5).abs() < 1e-12);
    }
}
