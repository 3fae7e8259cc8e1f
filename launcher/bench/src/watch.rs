//! `morphquad bench watch`: what being watched costs a flight. Flights without and with a recording and
//! somebody who asks how it goes take turns, so that the machine's moods meet both alike; with viewers of
//! the live page see [`super::turns`].

use super::BenchError;
use super::fleet::{Flight, Flown};
use super::report::LoopsReport;
use super::series::Rank;
use core::time::Duration;
use figures::results::Table;
use protocol::control::client::Conversation;
use protocol::control::{Request, runs};
use serde::Serialize;
use std::path::Path;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;

/// From one question about the flight to the next, as `top` asks.
const ASK_EVERY: Duration = Duration::from_millis(500);
/// Figures of each loop that are compared.
const FIGURES: [&str; 2] = ["lateness", "compute"];

/// The 99 % of one figure, flight by flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pairs {
    /// Loop or path.
    pub name: String,
    /// What of it.
    pub figure: &'static str,
    /// Unwatched and watched, in the same round \[us\].
    pub p99_us: Vec<[f64; 2]>,
}

/// How much more a figure is when somebody watches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Change {
    /// Median of the rounds' ratios.
    pub ratio: f64,
    /// Between these it lies with 95 % certainty, whatever the distribution; none of fewer than six rounds.
    pub between: Option<[f64; 2]>,
}

/// All of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct WatchReport {
    /// Each figure.
    pub pairs: Vec<Pairs>,
    /// Questions that were answered to whoever watched.
    pub answers: u64,
    /// Messages that viewers of the live page were sent.
    pub received: u64,
}

/// 99 % of a figure: loop or path, which figure, and how much \[us\].
pub(super) type Told = (String, &'static str, f64);

/// Flies this many rounds of two flights, and watches one of each.
///
/// # Errors
/// [`BenchError`] of a flight.
pub fn measure(
    words: &[String],
    rounds: usize,
    folder: &Path,
    done: &dyn Fn(),
) -> Result<WatchReport, BenchError> {
    let mut report = WatchReport::default();
    for round in 0..rounds {
        // Whoever is first finds the machine as the other has left it.
        let order = if round.is_multiple_of(2) { [false, true] } else { [true, false] };
        let mut flown = [None, None];
        for watched in order {
            flown[usize::from(watched)] = Some(fly(words, watched.then_some(folder), &mut report)?);
            done();
        }
        if let [Some(alone), Some(watched)] = flown {
            report.take(&p99s(&alone), &p99s(&watched));
        }
    }
    Ok(report)
}

fn fly(
    words: &[String],
    folder: Option<&Path>,
    report: &mut WatchReport,
) -> Result<LoopsReport, BenchError> {
    let mut words = words.to_vec();
    words.extend(folder.map(|folder| format!("--record={}", folder.display())));
    let flight = Flight::start(&words)?;
    let (going, over) = mpsc::channel();
    let (flown, answers) = thread::scope(|scope| {
        let asking = folder.map(|_| scope.spawn(move || keep_asking(&over)));
        let flown = flight.wait();
        drop(going);
        (flown, asking.and_then(|asking| asking.join().ok()).unwrap_or(0))
    });
    report.answers += answers;
    if let Some(folder) = folder {
        wipe(folder);
    }
    match flown? {
        Flown::Measured(report) => Ok(*report),
        Flown::Refused(why) | Flown::Lost(why) => {
            Err(BenchError::Peer(format!("did not fly to its end: {why}")))
        }
    }
}

/// Asks every run that there is how it goes, as `ps` does; how often it was told.
fn keep_asking(over: &Receiver<()>) -> u64 {
    let mut answers = 0;
    while over.recv_timeout(ASK_EVERY) == Err(RecvTimeoutError::Timeout) {
        for run in runs::living() {
            let asked = Conversation::ask(&run, &Request::Ps);
            answers += u64::from(asked.is_ok_and(|mut talk| talk.hear().is_ok()));
        }
    }
    answers
}

/// A recording is measured and not kept.
fn wipe(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let _ = std::fs::remove_file(entry.path());
    }
}

fn p99s(report: &LoopsReport) -> Vec<Told> {
    let mut all = Vec::new();
    for told in &report.loops {
        for name in FIGURES {
            if let Some(figure) = told.figures.get(name) {
                all.push((told.name.clone(), name, figure.flown.at(Rank::P99)));
            }
        }
    }
    for path in &report.paths {
        all.push((path.name.clone(), "path", path.total.flown.at(Rank::P99)));
    }
    all
}

impl WatchReport {
    pub(super) fn take(&mut self, alone: &[Told], watched: &[Told]) {
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
    #[must_use]
    pub fn overall(&self) -> Option<Change> {
        let rounds = self.pairs.iter().map(|p| p.p99_us.len()).min()?;
        let ratios = (0..rounds).map(|round| {
            let logs = self.pairs.iter().filter_map(|p| ratio(p.p99_us[round])).map(libm::log);
            let logs: Vec<f64> = logs.collect();
            libm::exp(logs.iter().sum::<f64>() / logs.len().max(1) as f64)
        });
        Change::of(ratios.collect())
    }

    /// For people.
    #[must_use]
    pub fn table(&self) -> Table {
        let mut table =
            Table::new(["", "99 % of", "rounds", "alone us", "watched us", "x", "95 % between"]);
        for pairs in &self.pairs {
            let change = Change::of(pairs.p99_us.iter().copied().filter_map(ratio).collect());
            let of = |index: usize| median(pairs.p99_us.iter().map(|p| p[index]).collect());
            table.push([
                pairs.name.clone(),
                pairs.figure.to_owned(),
                pairs.p99_us.len().to_string(),
                of(0).map_or_else(String::new, super::us),
                of(1).map_or_else(String::new, super::us),
                super::ratio(change.map(|change| change.ratio)),
                change.map_or_else(String::new, |change| change.told()),
            ]);
        }
        table
    }
}

fn ratio([alone_us, watched_us]: [f64; 2]) -> Option<f64> {
    (alone_us > 0.0 && watched_us > 0.0).then(|| watched_us / alone_us)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n.is_multiple_of(2) => Some(f64::midpoint(values[middle - 1], values[middle])),
        _ => Some(values[middle]),
    }
}

impl Change {
    /// Of rounds' ratios; none of none.
    #[must_use]
    pub fn of(mut ratios: Vec<f64>) -> Option<Self> {
        ratios.sort_by(f64::total_cmp);
        let rank = rank_of_median(ratios.len());
        let between = rank.map(|rank| [ratios[rank], ratios[ratios.len() - 1 - rank]]);
        Some(Self { ratio: median(ratios)?, between })
    }

    /// The interval in words.
    #[must_use]
    pub fn told(&self) -> String {
        self.between.map_or_else(String::new, |[low, high]| format!("{low:.3} .. {high:.3}"))
    }
}

/// How many of so many values may be left out at each end so that those between hold the median with 95 %
/// certainty: the sign test turned round.
fn rank_of_median(count: usize) -> Option<usize> {
    let (mut below, mut term, mut rank) = (0.0, libm::exp2(-(count as f64)), None);
    for left_out in 0..count.div_ceil(2) {
        below += term;
        if below > 0.025 {
            break;
        }
        rank = Some(left_out);
        term *= (count - left_out) as f64 / (left_out + 1) as f64;
    }
    rank
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_median_is_that_of_the_sign_test() {
        // Tables of the binomial distribution.
        let of = |count| rank_of_median(count);
        assert_eq!(
            [of(5), of(6), of(9), of(20), of(100)],
            [None, Some(0), Some(1), Some(5), Some(39)]
        );
        let change = Change::of((1..=20).map(f64::from).collect()).unwrap();
        assert_eq!((change.ratio, change.between), (10.5, Some([6.0, 15.0])));
        assert_eq!(Change::of(Vec::new()), None);
    }

    #[test]
    fn rounds_are_compared_pair_by_pair_and_all_figures_together_by_their_geometric_mean() {
        let mut report = WatchReport::default();
        let told = |plant: f64, attitude: f64| {
            vec![
                ("plant".to_owned(), "lateness", plant),
                ("attitude".to_owned(), "compute", attitude),
            ]
        };
        for _ in 0..6 {
            report.take(&told(10.0, 5.0), &told(20.0, 10.0));
            report.take(&told(100.0, 8.0), &told(50.0, 4.0));
            report.take(&told(1.0, 8.0), &told(4.0, 2.0));
        }
        let overall = report.overall().unwrap();
        assert!((overall.ratio - 1.0).abs() < 1e-12, "{overall:?}");
        assert_eq!(report.pairs[0].p99_us.len(), 18);
        assert!(report.table().to_string().contains("2.00"));
    }
}
