//! Durations as they were measured: every one counts, none is left out.

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

/// Longest duration that is resolved \[ns\]; longer ones count as this.
const MAX_DURATION_NS: u64 = 600_000_000_000;

/// A histogram of durations to three digits.
#[derive(Debug, Clone, PartialEq)]
pub struct Series(Histogram<u64>);

/// Summary of a series: its length and where its values lie \[us\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quantiles {
    /// How many values.
    pub n: u64,
    /// Half of them are at most this.
    pub p50_us: f64,
    /// 90 % are at most this.
    pub p90_us: f64,
    /// 99 % are at most this.
    pub p99_us: f64,
    /// 99.9 % are at most this.
    pub p999_us: f64,
    /// All are at most this.
    pub max_us: f64,
}

/// A quantile by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rank {
    /// Median.
    P50,
    /// 90 %.
    P90,
    /// 99 %.
    P99,
    /// 99.9 %.
    P999,
    /// The largest.
    Max,
}

impl Rank {
    /// From the smallest to the largest.
    pub const ALL: [Self; 5] = [Self::P50, Self::P90, Self::P99, Self::P999, Self::Max];

    /// As it is written.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::P50 => "p50",
            Self::P90 => "p90",
            Self::P99 => "p99",
            Self::P999 => "p99.9",
            Self::Max => "max",
        }
    }

    /// The quantile that is written so.
    #[must_use]
    pub fn named(label: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|rank| rank.label() == label)
    }
}

impl Default for Series {
    fn default() -> Self {
        let empty = Histogram::new_with_bounds(1, MAX_DURATION_NS, 3);
        Self(empty.unwrap_or_else(|_| unreachable!("constant bounds are valid")))
    }
}

impl Series {
    /// Takes a duration \[ns\].
    pub fn record(&mut self, ns: u64) {
        self.0.saturating_record(ns);
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.0.len()
    }

    /// True if there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Where the values lie; none if there are none.
    #[must_use]
    pub fn quantiles(&self) -> Option<Quantiles> {
        if self.is_empty() {
            return None;
        }
        let max_ns = self.0.max();
        // A bin's upper edge may lie above the largest value.
        let us = |quantile: f64| self.0.value_at_quantile(quantile).min(max_ns) as f64 / 1e3;
        Some(Quantiles {
            n: self.0.len(),
            p50_us: us(0.5),
            p90_us: us(0.9),
            p99_us: us(0.99),
            p999_us: us(0.999),
            max_us: max_ns as f64 / 1e3,
        })
    }

    /// Duration \[ns\] and how often, of each bin that has any.
    pub fn bins(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        self.0.iter_recorded().map(|bin| (bin.value_iterated_to(), bin.count_at_value()))
    }
}

impl FromIterator<u64> for Series {
    fn from_iter<I: IntoIterator<Item = u64>>(durations_ns: I) -> Self {
        let mut series = Self::default();
        durations_ns.into_iter().for_each(|ns| series.record(ns));
        series
    }
}

impl Quantiles {
    /// One of them \[us\].
    #[must_use]
    pub fn at(&self, rank: Rank) -> f64 {
        match rank {
            Rank::P50 => self.p50_us,
            Rank::P90 => self.p90_us,
            Rank::P99 => self.p99_us,
            Rank::P999 => self.p999_us,
            Rank::Max => self.max_us,
        }
    }

    /// Each of them over the same one of `floor`; none where the floor is zero.
    #[must_use]
    pub fn over(&self, floor: &Self) -> Ratios {
        let ratio = |rank| Some(floor.at(rank)).filter(|at| *at > 0.0).map(|at| self.at(rank) / at);
        Ratios {
            p50: ratio(Rank::P50),
            p90: ratio(Rank::P90),
            p99: ratio(Rank::P99),
            p999: ratio(Rank::P999),
            max: ratio(Rank::Max),
        }
    }

    /// Sums, quantile by quantile. The quantile of a sum is at most about that where the parts are not
    /// slow together.
    #[must_use]
    pub fn sum<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Option<Self> {
        parts.into_iter().copied().reduce(|a, b| Self {
            n: a.n.min(b.n),
            p50_us: a.p50_us + b.p50_us,
            p90_us: a.p90_us + b.p90_us,
            p99_us: a.p99_us + b.p99_us,
            p999_us: a.p999_us + b.p999_us,
            max_us: a.max_us + b.max_us,
        })
    }
}

/// Quantiles over those of a floor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ratios {
    /// Of the medians.
    pub p50: Option<f64>,
    /// Of the 90 %.
    pub p90: Option<f64>,
    /// Of the 99 %.
    pub p99: Option<f64>,
    /// Of the 99.9 %.
    pub p999: Option<f64>,
    /// Of the largest.
    pub max: Option<f64>,
}

impl Ratios {
    /// One of them.
    #[must_use]
    pub fn at(&self, rank: Rank) -> Option<f64> {
        match rank {
            Rank::P50 => self.p50,
            Rank::P90 => self.p90,
            Rank::P99 => self.p99,
            Rank::P999 => self.p999,
            Rank::Max => self.max,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_thousand_known_values_are_those_of_the_sorted_list() {
        let all: Series = (1..=1000).rev().map(|us| us * 1000).collect();
        let all = all.quantiles().unwrap();
        assert_eq!(all.n, 1000);
        let expected = [(Rank::P50, 500.0), (Rank::P90, 900.0), (Rank::P99, 990.0)];
        for (rank, us) in expected.into_iter().chain([(Rank::P999, 999.0), (Rank::Max, 1000.0)]) {
            assert!((all.at(rank) / us - 1.0).abs() < 2e-3, "{}: {}", rank.label(), all.at(rank));
        }
    }

    #[test]
    fn one_slow_value_is_never_left_out() {
        let mut series: Series = core::iter::repeat_n(10_000, 9999).collect();
        series.record(5_000_000_000);
        let quantiles = series.quantiles().unwrap();
        assert!(
            (quantiles.max_us / 5e6 - 1.0).abs() < 1e-3 && quantiles.p999_us < 10.1,
            "{quantiles:?}"
        );
    }

    #[test]
    fn values_beyond_the_scale_and_zeros_are_counted_too() {
        let series: Series = [0, u64::MAX, 3].into_iter().collect();
        let quantiles = series.quantiles().unwrap();
        assert_eq!((quantiles.n, series.bins().map(|(_, n)| n).sum::<u64>()), (3, 3));
        assert!(quantiles.p50_us <= 0.003 && quantiles.max_us >= 6e8, "{quantiles:?}");
        assert_eq!(Series::default().quantiles(), None);
    }

    #[test]
    fn a_ratio_is_the_quantile_over_that_of_the_floor_and_none_over_nothing() {
        let quantiles = |ns: [u64; 3]| ns.into_iter().collect::<Series>().quantiles().unwrap();
        let (flown, floor) = (quantiles([2000, 4000, 6000]), quantiles([1000, 1000, 1000]));
        let ratio = flown.over(&floor);
        assert!((ratio.p50.unwrap() - 4.0).abs() < 0.01, "{ratio:?}");
        assert!((ratio.max.unwrap() - flown.max_us / floor.max_us).abs() < 1e-12);
        let nothing = quantiles([0, 0, 0]);
        assert_eq!(flown.over(&nothing).at(Rank::P99), None);
        let sum = Quantiles::sum([&flown, &floor]).unwrap();
        assert!((sum.p50_us - flown.p50_us - floor.p50_us).abs() < 1e-12 && sum.n == 3);
    }

    #[test]
    fn every_rank_is_found_by_its_name() {
        for rank in Rank::ALL {
            assert_eq!(Rank::named(rank.label()), Some(rank));
        }
        assert_eq!(Rank::named("p98"), None);
    }
}
