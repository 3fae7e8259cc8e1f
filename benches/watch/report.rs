//! What being watched costs: flights or stretches with and without viewers, pair by pair.

use figures::figure::us;
use figures::results::Table;
use serde::Serialize;
use statrs::distribution::{Binomial, DiscreteCDF as _};
use statrs::statistics::{Data, Median as _};

/// The 99 % of one figure, flight by flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Pairs {
    /// Loop or path.
    pub(crate) name: String,
    /// What of it.
    pub(crate) figure: &'static str,
    /// Unwatched and watched, in the same round \[us\].
    pub(crate) p99_us: Vec<[f64; 2]>,
}

/// How much more a figure is when a client watches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Change {
    /// Median of the rounds' ratios.
    pub(crate) ratio: f64,
    /// Between these it lies with 95 % certainty, whatever the distribution; none of fewer than six rounds.
    pub(crate) between: Option<[f64; 2]>,
}

/// All of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct WatchReport {
    /// Each figure.
    pub(crate) pairs: Vec<Pairs>,
    /// Questions of watching clients that were answered.
    pub(crate) answers: u64,
    /// Messages that viewers of the live page were sent.
    pub(crate) received: u64,
}

/// 99 % of a figure: loop or path, which figure, and how much \[us\].
pub(crate) type FigureP99 = (String, &'static str, f64);

impl WatchReport {
    pub(crate) fn take(&mut self, alone: &[FigureP99], watched: &[FigureP99]) {
        for (name, figure, alone_us) in alone {
            let same = watched.iter().find(|(n, f, _)| n == name && f == figure);
            let Some((_, _, watched_us)) = same else { continue };
            let known = self.pairs.iter().position(|p| p.name == *name && p.figure == *figure);
            let at = known.unwrap_or_else(|| {
                let (name, p99_us) = (name.clone(), Vec::new());
                self.pairs.push(Pairs { name, figure, p99_us });
                self.pairs.len() - 1
            });
            self.pairs[at].p99_us.push([*alone_us, *watched_us]);
        }
    }

    /// Of all figures of the loops together: of each round the geometric mean of their ratios.
    pub(crate) fn overall(&self) -> Option<Change> {
        let rounds = self.pairs.iter().map(|p| p.p99_us.len()).min()?;
        let ratios = (0..rounds).map(|round| {
            let logs = self.pairs.iter().filter_map(|p| ratio(p.p99_us[round])).map(f64::ln);
            let logs: Vec<f64> = logs.collect();
            (logs.iter().sum::<f64>() / logs.len().max(1) as f64).exp()
        });
        Change::of(ratios.collect())
    }

    /// For people.
    pub(crate) fn table(&self) -> Table {
        let mut table =
            Table::new(["", "99 % of", "rounds", "alone us", "watched us", "x", "95 % between"]);
        for pairs in &self.pairs {
            let change = Change::of(pairs.p99_us.iter().copied().filter_map(ratio).collect());
            let of = |index: usize| median(pairs.p99_us.iter().map(|p| p[index]).collect());
            table.push([
                pairs.name.clone(),
                pairs.figure.to_owned(),
                pairs.p99_us.len().to_string(),
                of(0).map_or_else(String::new, us),
                of(1).map_or_else(String::new, us),
                change.map_or_else(|| "-".to_owned(), |change| format!("{:.2}", change.ratio)),
                change.map_or_else(String::new, |change| change.interval()),
            ]);
        }
        table
    }
}

fn ratio([alone_us, watched_us]: [f64; 2]) -> Option<f64> {
    (alone_us > 0.0 && watched_us > 0.0).then(|| watched_us / alone_us)
}

fn median(values: Vec<f64>) -> Option<f64> {
    (!values.is_empty()).then(|| Data::new(values).median())
}

impl Change {
    /// Of rounds' ratios; none of none.
    pub(crate) fn of(mut ratios: Vec<f64>) -> Option<Self> {
        ratios.sort_by(f64::total_cmp);
        let rank = rank_of_median(ratios.len());
        let between = rank.map(|rank| [ratios[rank], ratios[ratios.len() - 1 - rank]]);
        Some(Self { ratio: median(ratios)?, between })
    }

    /// The interval as text.
    pub(crate) fn interval(&self) -> String {
        self.between.map_or_else(String::new, |[low, high]| format!("{low:.3} .. {high:.3}"))
    }
}

/// How many of so many values may be left out at each end so that those between hold the median with 95 %
/// certainty: the sign test turned round.
fn rank_of_median(count: usize) -> Option<usize> {
    let binomial = Binomial::new(0.5, count as u64).ok()?;
    (0..count.div_ceil(2)).take_while(|rank| binomial.cdf(*rank as u64) <= 0.025).last()
}
