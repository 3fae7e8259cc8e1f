//! `morphquad bench rate`: the highest rate that each loop holds on this machine.

use super::BenchError;
use super::fleet::{Flight, Flown};
use super::report::{LoopReport, LoopsReport, MAX_MISS_SHARE};
use super::series::Rank;
use figures::results::Table;
use runtime::rate::MAX_RATE_HZ;
use scenario::process::OWN_EXECUTABLE;
use serde::Serialize;
use std::process::Command;

/// Rates between the last that was held and the first that was not.
const BISECTIONS: u32 = 3;

/// One flight with a loop at a rate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trial {
    /// The loop.
    pub name: String,
    /// As asked for \[Hz\].
    pub rate_hz: f64,
    /// As flown \[Hz\].
    pub achieved_hz: Option<f64>,
    /// Steps after the warm-up.
    pub steps: u64,
    /// Releases after it, those that were left out among them.
    pub releases: u64,
    /// Of its releases.
    pub miss_share: f64,
    /// Lateness, median and 99 % \[us\].
    pub lateness_us: [f64; 2],
    /// Compute time, 99 % \[us\].
    pub compute_us: f64,
    /// True if it missed few enough.
    pub holds: bool,
    /// Why it was not flown, or not to its end.
    pub lost: Option<String>,
}

/// What is known of a loop.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ladder {
    /// The loop.
    pub name: String,
    /// The highest rate that it held \[Hz\].
    pub highest_hz: Option<f64>,
    /// Why no higher one was tried, if that was not for misses.
    pub stopped: Option<String>,
    /// In the order flown.
    pub trials: Vec<Trial>,
}

impl Trial {
    /// Both flights as one; of figures the worse.
    fn and(self, other: Self) -> Self {
        let missed = |t: &Self| t.miss_share * t.releases as f64;
        let releases = self.releases + other.releases;
        let miss_share = (missed(&self) + missed(&other)) / releases.max(1) as f64;
        let mut achieved_hz = other.achieved_hz.or(self.achieved_hz);
        if let (Some(a), Some(b)) = (self.achieved_hz, other.achieved_hz) {
            achieved_hz = Some(f64::midpoint(a, b));
        }
        let worse = |a: f64, b: f64| a.max(b);
        let lost = self.lost.or(other.lost);
        Self {
            achieved_hz,
            steps: self.steps + other.steps,
            releases,
            miss_share,
            lateness_us: [0, 1].map(|i| worse(self.lateness_us[i], other.lateness_us[i])),
            compute_us: worse(self.compute_us, other.compute_us),
            holds: miss_share <= MAX_MISS_SHARE && lost.is_none(),
            lost,
            ..other
        }
    }
}

/// Flies a rate; one that is not held has a second chance, and both count together: one hiccup of the
/// machine is more than a thousandth of a short flight.
fn try_rate(
    rate_hz: f64,
    fly: &mut dyn FnMut(f64) -> Result<Trial, BenchError>,
) -> Result<Trial, BenchError> {
    let trial = fly(rate_hz)?;
    if trial.holds || trial.lost.is_some() {
        return Ok(trial);
    }
    Ok(trial.and(fly(rate_hz)?))
}

/// Doubles the rate of a loop until it is not held, then looks closer. `fly` flies it at a rate.
///
/// # Errors
/// [`BenchError`] of a flight.
pub fn climb(
    name: &str,
    from_hz: f64,
    fly: &mut dyn FnMut(f64) -> Result<Trial, BenchError>,
) -> Result<Ladder, BenchError> {
    let mut ladder =
        Ladder { name: name.to_owned(), highest_hz: None, stopped: None, trials: Vec::new() };
    let mut too_fast_hz = None;
    let mut rate_hz = from_hz;
    while too_fast_hz.is_none() && rate_hz <= MAX_RATE_HZ {
        let trial = try_rate(rate_hz, fly)?;
        if trial.steps == 0 && trial.lost.is_some() {
            // Refused: the machine had no part in it.
            ladder.stopped.clone_from(&trial.lost);
            break;
        }
        if trial.holds {
            ladder.highest_hz = Some(rate_hz);
        } else {
            too_fast_hz = Some(rate_hz);
        }
        ladder.trials.push(trial);
        rate_hz *= 2.0;
    }
    if too_fast_hz.is_none() && ladder.stopped.is_none() {
        ladder.stopped = Some(format!("no loop may run at more than {MAX_RATE_HZ} Hz"));
    }
    for _ in 0..BISECTIONS {
        let (Some(held_hz), Some(taxed_hz)) = (ladder.highest_hz, too_fast_hz) else { break };
        let middle_hz = libm::sqrt(held_hz * taxed_hz).round();
        if middle_hz <= held_hz || middle_hz >= taxed_hz {
            break;
        }
        let trial = try_rate(middle_hz, fly)?;
        if trial.holds {
            ladder.highest_hz = Some(middle_hz);
        } else {
            too_fast_hz = Some(middle_hz);
        }
        ladder.trials.push(trial);
    }
    Ok(ladder)
}

/// Flies once: `arguments` are the flight's, and the loop's rate comes last.
///
/// # Errors
/// [`BenchError`].
pub fn fly(arguments: &[String], name: &str, rate_hz: f64) -> Result<Trial, BenchError> {
    let rate = format!("{name}={rate_hz}");
    let arguments: Vec<String> =
        arguments.iter().cloned().chain(["--rate".to_owned(), rate]).collect();
    let trial = Trial {
        name: name.to_owned(),
        rate_hz,
        achieved_hz: None,
        steps: 0,
        releases: 1,
        miss_share: 1.0,
        lateness_us: [0.0; 2],
        compute_us: 0.0,
        holds: false,
        lost: None,
    };
    Ok(match Flight::start(Command::new(OWN_EXECUTABLE), &arguments)?.wait()? {
        Flown::Measured(report) => of(&report, name, trial),
        Flown::Refused(why) => Trial { lost: Some(why), ..trial },
        // Whatever killed it, the rate was not held.
        Flown::Lost(why) => Trial { lost: Some(why), steps: 1, ..trial },
    })
}

/// The loop that a name of `--rate` means.
fn named<'a>(report: &'a LoopsReport, name: &str) -> Option<&'a LoopReport> {
    report.loops.iter().find(|l| l.name == name || l.role == name)
}

fn of(report: &LoopsReport, name: &str, trial: Trial) -> Trial {
    let Some(found) = named(report, name) else {
        return Trial { lost: Some("it has not stepped".to_owned()), steps: 1, ..trial };
    };
    let at = |figure: &str, rank| found.figures.get(figure).map_or(0.0, |f| f.flown.at(rank));
    let miss_share = found.counts.miss_share();
    Trial {
        achieved_hz: found.achieved_hz,
        steps: found.counts.steps,
        releases: found.counts.releases(),
        miss_share,
        lateness_us: [at("lateness", Rank::P50), at("lateness", Rank::P99)],
        compute_us: at("compute", Rank::P99),
        holds: miss_share <= MAX_MISS_SHARE,
        ..trial
    }
}

/// For people.
#[must_use]
pub fn table(ladders: &[Ladder]) -> Table {
    let mut table = Table::new([
        "loop",
        "Hz",
        "flown",
        "steps",
        "missed",
        "late p50",
        "late p99",
        "compute p99",
        "holds",
    ]);
    for ladder in ladders {
        let mut trials: Vec<&Trial> = ladder.trials.iter().collect();
        trials.sort_by(|a, b| a.rate_hz.total_cmp(&b.rate_hz));
        for trial in trials {
            let achieved =
                trial.achieved_hz.map_or_else(|| "-".to_owned(), |hz| format!("{hz:.1}"));
            table.push([
                trial.name.clone(),
                trial.rate_hz.to_string(),
                achieved,
                trial.steps.to_string(),
                format!("{:.3} %", 100.0 * trial.miss_share),
                super::us(trial.lateness_us[0]),
                super::us(trial.lateness_us[1]),
                super::us(trial.compute_us),
                if trial.holds { "yes" } else { "no" }.to_owned(),
            ]);
        }
    }
    table
}

/// Why flights were not flown to their end, a line each.
#[must_use]
pub fn losses(ladders: &[Ladder]) -> Vec<String> {
    let trials = ladders.iter().flat_map(|ladder| &ladder.trials);
    let lost = trials.filter_map(|trial| Some((trial, trial.lost.as_ref()?)));
    lost.map(|(trial, why)| format!("{} at {} Hz: {why}", trial.name, trial.rate_hz)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(rate_hz: f64, holds: bool) -> Trial {
        Trial {
            name: "a".to_owned(),
            rate_hz,
            achieved_hz: Some(rate_hz),
            steps: 100,
            releases: 100,
            miss_share: if holds { 0.0 } else { 0.5 },
            lateness_us: [1.0, 2.0],
            compute_us: 3.0,
            holds,
            lost: None,
        }
    }

    #[test]
    fn the_ladder_ends_between_the_last_rate_held_and_the_first_that_was_not() {
        let mut flown = Vec::new();
        let mut fly = |hz: f64| {
            flown.push(hz);
            Ok(trial(hz, hz <= 1300.0))
        };
        let ladder = climb("a", 100.0, &mut fly).unwrap();
        // What is not held is flown again.
        let expected = [100.0, 200.0, 400.0, 800.0, 1600.0, 1600.0, 1131.0, 1345.0, 1345.0, 1233.0];
        assert_eq!(flown, expected);
        assert_eq!((ladder.highest_hz, ladder.stopped), (Some(1233.0), None));
    }

    #[test]
    fn a_hiccup_in_one_of_two_flights_is_judged_by_both() {
        let short = |misses: f64| Trial {
            steps: 1000,
            releases: 1000,
            miss_share: misses / 1000.0,
            holds: misses <= 1.0,
            ..trial(100.0, true)
        };
        let mut flights = [2.0, 0.0, 2.0, 1.0].into_iter().map(short);
        let mut fly = |_| Ok(flights.next().unwrap());
        let first = try_rate(100.0, &mut fly).unwrap();
        assert!(first.holds && first.steps == 2000, "{first:?}");
        let second = try_rate(100.0, &mut fly).unwrap();
        assert!(!second.holds && (second.miss_share - 0.0015).abs() < 1e-12, "{second:?}");
        // What was left out is half of the first flight's releases, and a quarter of both.
        let half = Trial { steps: 1000, releases: 2000, ..trial(100.0, false) };
        let whole = Trial { steps: 2000, releases: 2000, ..trial(100.0, true) };
        assert!((half.and(whole).miss_share - 0.25).abs() < 1e-12);
    }

    #[test]
    fn a_rate_that_the_scenario_refuses_ends_the_ladder_with_the_reason() {
        let refused = |hz: f64| Trial {
            steps: 0,
            lost: Some("too fast for it".to_owned()),
            ..trial(hz, false)
        };
        let mut fly = |hz: f64| Ok(if hz > 300.0 { refused(hz) } else { trial(hz, true) });
        let ladder = climb("a", 100.0, &mut fly).unwrap();
        assert_eq!(ladder.highest_hz, Some(200.0));
        assert_eq!(ladder.stopped.as_deref(), Some("too fast for it"));
        let mut all = |hz: f64| Ok(trial(hz, true));
        let ladder = climb("a", 4000.0, &mut all).unwrap();
        assert!(ladder.highest_hz == Some(8000.0) && ladder.stopped.is_some());
        let mut none = |hz: f64| Ok(trial(hz, false));
        assert_eq!(climb("a", 4000.0, &mut none).unwrap().highest_hz, None);
    }
}
