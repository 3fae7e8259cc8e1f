//! The figures as a table or as JSON.

use core::fmt::Write as _;
use serde_json::{Value, json};

use crate::measure::{Figures, Times};
use crate::series::Group;

/// All that was measured.
#[derive(Debug)]
pub(crate) struct Report<'a> {
    pub(crate) cpu: usize,
    pub(crate) floor: Times,
    pub(crate) groups: &'a [Group],
    /// By group, then solver.
    pub(crate) results: Vec<Vec<Figures>>,
    /// Why there are no instruction counts.
    pub(crate) counts: Option<String>,
}

fn us(ns: u64) -> f64 {
    ns as f64 * 1e-3
}

/// Ours, to which the others are compared.
fn ours(results: &[Figures]) -> Option<&Figures> {
    results.iter().find(|figures| figures.solver == crate::contenders::ALL[0].0)
}

impl Report<'_> {
    pub(crate) fn text(&self) -> Result<String, core::fmt::Error> {
        let mut out = String::new();
        writeln!(
            out,
            "one thread on processor {}; times in us with the null call of {:.3} (max {:.3}) in them",
            self.cpu,
            us(self.floor.median),
            us(self.floor.max)
        )?;
        if let Some(reason) = &self.counts {
            writeln!(out, "{reason}")?;
        }
        for (group, results) in self.groups.iter().zip(&self.results) {
            table(&mut out, group, results)?;
        }
        Ok(out)
    }

    pub(crate) fn json(&self) -> String {
        let group = |(group, results): (&Group, &Vec<Figures>)| {
            json!({
                "name": group.name,
                "series": group.series.len(),
                "ticks": group.ticks(),
                "hessian_changes": group.varies(),
                "solvers": results.iter().map(|one| solver(group, one, results)).collect::<Vec<_>>(),
            })
        };
        let groups: Vec<Value> = self.groups.iter().zip(&self.results).map(group).collect();
        let all = json!({
            "cpu": self.cpu,
            "null_call_ns": times(self.floor),
            "instructions": self.counts.as_ref().map_or("counted", String::as_str),
            "groups": groups,
        });
        format!("{all:#}\n")
    }
}

fn table(out: &mut String, group: &Group, results: &[Figures]) -> core::fmt::Result {
    let constrained = results.first().map_or(0, |one| one.accuracy.constrained);
    writeln!(
        out,
        "\n{}: {} series, {} ticks, {:.0} % at a bound{}",
        group.name,
        group.series.len(),
        group.ticks(),
        100.0 * constrained as f64 / group.ticks() as f64,
        if group.varies() { ", a new Hessian is part of its tick" } else { "" },
    )?;
    writeln!(
        out,
        "  {:<12}{:>9}{:>10}{:>10}{:>16}{:>9}{:>10}{:>9}{:>6}{:>10}{:>9}{:>9}  {:<18}",
        "solver",
        "median",
        "p99",
        "max",
        "typical",
        "cold",
        "cold max",
        "instr",
        "iter",
        "1st move",
        "KKT",
        "unsolved",
        "ours/its"
    )?;
    for one in results {
        let a = &one.accuracy;
        let ratio = |pick: fn(Times) -> u64| {
            ours(results).map_or(f64::NAN, |ours| pick(ours.hot) as f64 / pick(one.hot) as f64)
        };
        writeln!(
            out,
            "  {:<12}{:>9.3}{:>10.3}{:>10.3}{:>9.3} ± {:<4.3}{:>9.3}{:>10.3}{:>9}{:>6}{:>10}{:>9.0e}{:>9}  {:.2} / {:.2} / {:.2}",
            one.solver,
            us(one.hot.median),
            us(one.hot.p99),
            us(one.hot.max),
            us(one.typical),
            us(one.deviation),
            us(one.cold.median),
            us(one.cold.max),
            one.instructions.map_or_else(|| "-".to_owned(), |count| count.to_string()),
            a.worst_iterations,
            a.first_move.map_or_else(|| "-".to_owned(), |error| format!("{error:.0e}")),
            a.residual,
            a.unsolved,
            ratio(|times| times.median),
            ratio(|times| times.p99),
            ratio(|times| times.max),
        )?;
    }
    Ok(())
}

fn times(times: Times) -> Value {
    json!({ "median": times.median, "p99": times.p99, "max": times.max })
}

fn solver(group: &Group, one: &Figures, results: &[Figures]) -> Value {
    let a = &one.accuracy;
    let ratio = |pick: fn(Times) -> u64| {
        ours(results).map(|ours| pick(ours.hot) as f64 / pick(one.hot) as f64)
    };
    json!({
        "name": one.solver,
        "hot_ns": times(one.hot),
        "typical_ns": one.typical,
        "deviation_ns": one.deviation,
        "fewest_replays": one.fewest_replays,
        "cold_ns": times(one.cold),
        "instructions_per_tick": one.instructions,
        "worst_iterations": a.worst_iterations,
        "first_move_error_rate_bounds": a.first_move,
        "kkt_residual": a.residual,
        "unsolved": a.unsolved,
        "constrained_share": a.constrained as f64 / group.ticks() as f64,
        "ours_over_this": {
            "median": ratio(|times| times.median),
            "p99": ratio(|times| times.p99),
            "max": ratio(|times| times.max),
        },
    })
}
