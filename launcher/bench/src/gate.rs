//! Figures against limits, and against those of an earlier flight, if the two may be compared at all.

use super::report::{FORMAT, FORMAT_VERSION, Figure, LoopsReport, Terms};
use super::series::Rank;
use figures::results::Table;
use miette::Diagnostic;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A difference below this is within the resolution of a clock \[us\].
const RESOLUTION_US: f64 = 1.0;

/// Why a file cannot be compared with.
#[derive(Debug, Error, Diagnostic)]
pub enum CompareError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    #[diagnostic(help("name a file that `morphquad bench loops --save FILE` has written"))]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file holds something else.
    #[error("{} is no result of `morphquad bench loops`: {what}", path.display())]
    #[diagnostic(help(
        "name a file that `morphquad bench loops --save FILE` of this version has written"
    ))]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The file's figures are of something else.
    #[error("{} cannot be compared with: {}", path.display(), reasons.join("; "))]
    #[diagnostic(help(
        "measure both on one machine, with the same version, scenario, rates, policy, processors and load"
    ))]
    Other {
        /// The file.
        path: PathBuf,
        /// What differs.
        reasons: Vec<String>,
    },
}

/// Reads a saved result.
///
/// # Errors
/// It cannot be read, or is none.
pub fn read(path: &Path) -> Result<LoopsReport, CompareError> {
    let bytes =
        fs::read(path).map_err(|source| CompareError::Read { path: path.to_path_buf(), source })?;
    let foreign = |what: String| CompareError::Foreign { path: path.to_path_buf(), what };
    // The kind first: a file of another kind lacks fields that were never promised.
    let value: serde_json::Value =
        serde_json::from_slice(&bytes).map_err(|error| foreign(error.to_string()))?;
    let kind = (value["format"].as_str(), value["format_version"].as_u64());
    if kind != (Some(FORMAT), Some(FORMAT_VERSION.into())) {
        return Err(foreign(format!(
            "its format is {} {}",
            value["format"], value["format_version"]
        )));
    }
    let report: LoopsReport =
        serde_json::from_value(value).map_err(|error| foreign(error.to_string()))?;
    report.sane().map_err(foreign)?;
    Ok(report)
}

impl LoopsReport {
    /// Checks what an honest result has: quantiles in order, ratios that follow from them.
    fn sane(&self) -> Result<(), String> {
        for (name, figure) in self.every_figure() {
            let at = Rank::ALL.map(|rank| figure.flown.at(rank));
            if figure.flown.n == 0 || !at.is_sorted() || at[0] < 0.0 {
                return Err(format!("the quantiles of {name} are out of order"));
            }
            let again = figure.floor.as_ref().map(|floor| figure.flown.over(floor));
            let ratios = |r: &Option<super::series::Ratios>| {
                Rank::ALL.map(|rank| r.as_ref().and_then(|r| r.at(rank)).unwrap_or(0.0))
            };
            let same = ratios(&again).into_iter().zip(ratios(&figure.ratio));
            if same.into_iter().any(|(a, b)| (a - b).abs() > 1e-6 * a.abs().max(1.0)) {
                return Err(format!("the ratios of {name} do not follow from its figures"));
            }
        }
        Ok(())
    }

    /// Every figure with its name.
    fn every_figure(&self) -> impl Iterator<Item = (String, &Figure)> {
        let loops = self.loops.iter().flat_map(|l| {
            l.figures.iter().map(move |(name, figure)| (format!("{} {name}", l.name), figure))
        });
        let paths = self.paths.iter().flat_map(|path| {
            let figures = [("path", &path.total), ("effect", &path.until_effect)];
            figures.map(|(name, figure)| (format!("{} {name}", path.name), figure))
        });
        loops.chain(paths)
    }

    fn figure(&self, name: &str) -> Option<&Figure> {
        self.every_figure().find(|(known, _)| known == name).map(|(_, figure)| figure)
    }
}

impl Terms {
    /// Everything that forbids a comparison with a result under other terms.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let rates = |terms: &Self| -> String {
            let rates = terms.rates_hz.iter().map(|(role, hz)| format!("{role} at {hz} Hz"));
            rates.collect::<Vec<_>>().join(", ")
        };
        let named_terms = |terms: &Self| {
            let Self { facts, scenario, place, load, .. } = terms;
            [
                ("machine", facts.machine.clone()),
                ("processor", facts.cpu_model.clone()),
                ("number of processors", facts.processors.to_string()),
                ("kernel", facts.kernel.clone()),
                ("version", facts.version.clone()),
                ("place", place.to_line()),
                ("load", load.clone()),
                ("scenario", scenario.clone()),
                ("set of rates", rates(terms)),
            ]
        };
        let pairs = named_terms(self).into_iter().zip(named_terms(other));
        let differ = pairs.filter(|((_, ours), (_, theirs))| ours != theirs);
        let mut reasons: Vec<String> = differ
            .map(|((what, ours), (_, theirs))| format!("its {what} is {theirs}, and not {ours}"))
            .collect();
        if reasons.is_empty() && self.scenario_hash != other.scenario_hash {
            reasons.push(format!("other settings of {} were flown", self.scenario));
        }
        reasons
    }

    /// Refuses an earlier result under other terms.
    ///
    /// # Errors
    /// What differs.
    pub fn require_same(&self, before: &LoopsReport, path: &Path) -> Result<(), CompareError> {
        let reasons = self.differences(&before.terms);
        if reasons.is_empty() {
            return Ok(());
        }
        Err(CompareError::Other { path: path.to_path_buf(), reasons })
    }
}

/// A limit on figures.
#[derive(Debug, Clone, PartialEq)]
pub enum Gate {
    /// Every loop holds its rate.
    Held,
    /// A quantile of one figure, or of all, grows at most by this share from an earlier result.
    Growth {
        /// `lateness`, `compute`, ... `path` or `effect`; all if none.
        figure: Option<String>,
        /// Which quantile.
        rank: Rank,
        /// As a share.
        share: f64,
    },
    /// It is at most this long \[us\].
    Limit {
        /// The figure; all if none.
        figure: Option<String>,
        /// Which quantile.
        rank: Rank,
        /// At most \[us\].
        us: f64,
    },
    /// It is at most this many times its floor.
    Floor {
        /// The figure; all that have a floor if none.
        figure: Option<String>,
        /// Which quantile.
        rank: Rank,
        /// At most.
        times: f64,
    },
}

/// Form of a gate.
const FORM: &str = "write [FIGURE.]RANK:LIMIT, for example p99:+10%, lateness.p99:1.2x, path.p99:500us, \
    or held; a figure is lateness, period, age, hop, wait, compute, path or effect";

impl Gate {
    /// From its written form.
    ///
    /// # Errors
    /// What of it means nothing.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text == "held" {
            return Ok(Self::Held);
        }
        let bad = |what: &str| format!("{what}: {FORM}");
        let (what, limit) = text.split_once(':').ok_or_else(|| bad("there is no limit"))?;
        let (figure, rank) = match Rank::named(what) {
            Some(rank) => (None, Some(rank)),
            None => match what.split_once('.') {
                Some((figure, rank)) => (Some(figure.to_owned()), Rank::named(rank)),
                None => (None, None),
            },
        };
        let rank = rank.ok_or_else(|| bad("there is no such quantile"))?;
        let mut known = super::measure::FIGURES.into_iter().chain(["path", "effect"]);
        if let Some(figure) = &figure
            && !known.any(|known| known == figure)
        {
            return Err(bad(&format!("there is no figure `{figure}`")));
        }
        let number = |text: &str| text.parse::<f64>().ok().filter(|n| n.is_finite() && *n >= 0.0);
        let parsed =
            if let Some(percent) = limit.strip_prefix('+').and_then(|l| l.strip_suffix('%')) {
                number(percent).map(|percent| Self::Growth { figure, rank, share: percent / 100.0 })
            } else if let Some(times) = limit.strip_suffix('x') {
                number(times).map(|times| Self::Floor { figure, rank, times })
            } else if let Some(us) = limit.strip_suffix("us") {
                number(us).map(|us| Self::Limit { figure, rank, us })
            } else {
                let ms = limit.strip_suffix("ms").and_then(number);
                ms.map(|ms| Self::Limit { figure, rank, us: ms * 1e3 })
            };
        parsed.ok_or_else(|| bad(&format!("`{limit}` is not a valid limit")))
    }

    /// True if it needs an earlier result.
    #[must_use]
    pub fn needs_earlier(&self) -> bool {
        matches!(self, Self::Growth { .. })
    }

    /// True if it compares with the machine alone.
    #[must_use]
    pub fn needs_floor(&self) -> bool {
        matches!(self, Self::Floor { .. })
    }

    /// Everything that exceeds it, and what it asks about and was not measured.
    #[must_use]
    pub fn judge(&self, now: &LoopsReport, before: Option<&LoopsReport>) -> Vec<String> {
        let mut failed = self.not_measured(now, before);
        failed.extend(self.exceeded(now, before));
        failed
    }

    /// Without this a loop that stood still, or that could not be followed, would pass every limit.
    fn not_measured(&self, now: &LoopsReport, before: Option<&LoopsReport>) -> Vec<String> {
        let still = now.loops.iter().filter(|l| l.counts.steps == 0);
        let still = still.map(|l| format!("{} ran no step after the warm-up", l.name));
        let (figure, earlier) = match self {
            // Its own check reports such a loop.
            Self::Held => return Vec::new(),
            Self::Growth { figure, .. } => (figure.as_deref(), before),
            Self::Limit { figure, .. } | Self::Floor { figure, .. } => (figure.as_deref(), None),
        };
        let gone = earlier.into_iter().flat_map(|earlier| chosen(earlier, figure));
        let gone = gone.filter(|(name, _)| now.figure(name).is_none());
        let gone = gone.map(|(name, _)| format!("{name} was not measured"));
        let none = figure.filter(|_| chosen(now, figure).next().is_none());
        let none = none.map(|figure| format!("no {figure} was measured"));
        still.chain(gone).chain(none).chain(self.without_floor(now)).collect()
    }

    /// A limit over the floor means something where there is one: for a figure that is named, in all places.
    fn without_floor(&self, now: &LoopsReport) -> Vec<String> {
        let Self::Floor { figure, .. } = self else { return Vec::new() };
        let mut figures = chosen(now, figure.as_deref());
        if figure.is_some() {
            let bare = figures.filter(|(_, measured)| measured.ratio.is_none());
            return bare.map(|(name, _)| format!("{name} has no floor")).collect();
        }
        let none = figures.all(|(_, measured)| measured.ratio.is_none());
        none.then(|| "no figure was measured beside a floor".to_owned()).into_iter().collect()
    }

    fn exceeded(&self, now: &LoopsReport, before: Option<&LoopsReport>) -> Vec<String> {
        match self {
            Self::Held => {
                let taxed = now.overtaxed().map(|l| {
                    let percent = 100.0 * l.counts.miss_share();
                    format!("{} misses {percent:.2} % of its releases at {} Hz", l.name, l.rate_hz)
                });
                taxed.collect()
            }
            Self::Growth { figure, rank, share } => {
                let of = chosen(now, figure.as_deref()).filter_map(|(name, measured)| {
                    let (now_us, before_us) =
                        (measured.flown.at(*rank), before?.figure(&name)?.flown.at(*rank));
                    let most_us = (before_us * (1.0 + share)).max(before_us + RESOLUTION_US);
                    (now_us > most_us).then(|| {
                        let grown = 100.0 * (now_us / before_us - 1.0);
                        format!(
                            "{name} {} is {now_us:.2} us, {grown:.0} % above {before_us:.2} us",
                            rank.label()
                        )
                    })
                });
                of.collect()
            }
            Self::Limit { figure, rank, us } => chosen(now, figure.as_deref())
                .filter(|(_, measured)| measured.flown.at(*rank) > *us)
                .map(|(name, measured)| {
                    format!(
                        "{name} {} is {:.2} us, above {us} us",
                        rank.label(),
                        measured.flown.at(*rank)
                    )
                })
                .collect(),
            Self::Floor { figure, rank, times } => chosen(now, figure.as_deref())
                .filter_map(|(name, measured)| {
                    let ratio = measured.ratio.as_ref()?.at(*rank)?;
                    (ratio > *times).then(|| {
                        format!(
                            "{name} {} is {ratio:.2} x its floor, above {times} x",
                            rank.label()
                        )
                    })
                })
                .collect(),
        }
    }
}

fn chosen<'a>(
    report: &'a LoopsReport,
    figure: Option<&'a str>,
) -> impl Iterator<Item = (String, &'a Figure)> {
    // Names end with the figure.
    report.every_figure().filter(move |(name, _)| {
        figure.is_none_or(|figure| name.rsplit(' ').next() == Some(figure))
    })
}

/// What became of an earlier result's figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Every figure that both have.
    pub rows: Vec<CompareRow>,
}

/// One figure, then and now.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CompareRow {
    /// Loop and figure.
    pub name: String,
    /// Which quantile.
    pub rank: &'static str,
    /// Then \[us\].
    pub before_us: f64,
    /// Now \[us\].
    pub now_us: f64,
    /// Now over then; none if that was nothing.
    pub ratio: Option<f64>,
}

/// Compares with an earlier result under the same terms.
#[must_use]
pub fn compare(now: &LoopsReport, before: &LoopsReport) -> Comparison {
    let mut rows = Vec::new();
    for (name, measured) in now.every_figure() {
        let Some(earlier) = before.figure(&name) else { continue };
        for rank in [Rank::P50, Rank::P99] {
            let (before_us, now_us) = (earlier.flown.at(rank), measured.flown.at(rank));
            let ratio = (before_us > 0.0).then(|| now_us / before_us);
            let (name, rank) = (name.clone(), rank.label());
            rows.push(CompareRow { name, rank, before_us, now_us, ratio });
        }
    }
    Comparison { rows }
}

impl Comparison {
    /// For people.
    #[must_use]
    pub fn table(&self) -> Table {
        let mut table = Table::new(["figure", "rank", "before us", "now us", "x"]);
        for row in &self.rows {
            let (before, now) = (super::us(row.before_us), super::us(row.now_us));
            let ratio = super::ratio(row.ratio);
            table.push([row.name.as_str(), row.rank, &before, &now, &ratio]);
        }
        table
    }
}

#[cfg(test)]
mod tests;
