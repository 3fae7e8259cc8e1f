//! How long something takes: always the same, or drawn.

use core::fmt;
use serde::{Deserialize, Serialize};

/// Most values that are listed one by one.
const LISTED: usize = 4;

/// How long something takes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Duration {
    /// Always this \[ns\].
    Fixed(u64),
    /// Any time from the first to the second with the same probability \[ns\].
    Uniform(u64, u64),
    /// One of several times \[ns\], each with the share of draws that are for it or one before it.
    Values(Vec<(u64, f64)>),
}

impl Duration {
    /// One of several times \[ns\], drawn with frequencies given by their weights; those without a
    /// weight are never drawn.
    #[must_use]
    pub fn weighted(values: &[(u64, f64)]) -> Self {
        let whole: f64 = values.iter().map(|(_, weight)| weight).sum();
        let mut sum = 0.0;
        let share = |(value_ns, weight): &(u64, f64)| {
            sum += weight;
            (*value_ns, sum / whole)
        };
        Self::Values(values.iter().filter(|(_, weight)| *weight > 0.0).map(share).collect())
    }

    /// The time that a number from [0, 1) draws \[ns\].
    #[must_use]
    pub fn draw_ns(&self, uniform: f64) -> u64 {
        match self {
            Self::Fixed(value_ns) => *value_ns,
            Self::Uniform(least_ns, most_ns) => {
                let range_ns = most_ns.saturating_sub(*least_ns) as f64;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "within the range"
                )]
                let offset_ns = (range_ns * uniform).round() as u64;
                least_ns.saturating_add(offset_ns)
            }
            Self::Values(values) => {
                let drawn = values.iter().find(|(_, share)| uniform < *share);
                drawn.or(values.last()).map_or(0, |(value_ns, _)| *value_ns)
            }
        }
    }
}

impl fmt::Display for Duration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |ns: &u64| *ns as f64 / 1e6;
        match self {
            Self::Fixed(value_ns) => write!(f, "{} ms", ms(value_ns)),
            Self::Uniform(least_ns, most_ns) => write!(f, "{} to {} ms", ms(least_ns), ms(most_ns)),
            Self::Values(values) if values.len() > LISTED => {
                let half = values.iter().find(|(_, share)| *share >= 0.5);
                let ends = [values.first(), half, values.last()];
                let [least, half, most] =
                    ends.map(|end| end.map_or(0.0, |(value_ns, _)| ms(value_ns)));
                write!(f, "{least} to {most} ms, half of the times {half} ms at most,")
            }
            Self::Values(values) => {
                let mut before = 0.0;
                for (index, (value_ns, share)) in values.iter().enumerate() {
                    let comma = if index > 0 { ", " } else { "" };
                    let percent = 100.0 * (share - before);
                    write!(f, "{comma}{} ms ({percent:.4} %)", ms(value_ns))?;
                    before = *share;
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_drawn_as_often_as_its_weight_asks() {
        let duration = Duration::weighted(&[(1, 99.0), (7, 0.0), (12, 1.0)]);
        let draws = (0..10_000).map(|k| duration.draw_ns(f64::from(k) / 1e4));
        assert_eq!(draws.filter(|drawn_ns| *drawn_ns == 12).count(), 100);
        assert_eq!([0.0, 0.5, 0.99, 0.999_999].map(|u| duration.draw_ns(u)), [1, 1, 12, 12]);
    }

    #[test]
    fn a_uniform_time_lies_between_its_ends() {
        let duration = Duration::Uniform(1000, 3000);
        assert_eq!([0.0, 0.25, 0.5, 1.0].map(|u| duration.draw_ns(u)), [1000, 1500, 2000, 3000]);
    }
}
