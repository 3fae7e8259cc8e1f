//! The study as a table, a picture and files.

use super::{Candidate, PERIODS_S, Robustness, Study};
use figures::figure::{Axis, Colour, Curve, Figure, Mark, Panel};
use figures::results::{ResultsError, ResultsFolder, Table};
use serde_json::{Value, json};

fn settings(candidate: &Candidate) -> String {
    let short = |flag: &String| flag.replacen("position_mpc.", "", 1);
    let flags: Vec<String> = candidate.flags.iter().map(short).collect();
    if flags.is_empty() { "shipped".to_owned() } else { flags.join(" ") }
}

/// The Pareto front, a row each, the closest first, and the shipped set.
#[must_use]
pub fn table(study: &Study) -> Table {
    let headings =
        ["closeness", "lost", "90 % within mm", "judged lost", "90 % within mm", "settings"];
    let mut table = Table::new(headings);
    let cells_of = |robustness: Option<Robustness>| {
        let cells = robustness.map(|Robustness { lost, within_m }| {
            [lost.to_string(), format!("{:.1}", within_m * 1e3)]
        });
        cells.unwrap_or_else(|| ["-"; 2].map(str::to_owned))
    };
    let shipped = study.candidates.first().filter(|shipped| !study.is_on_front(shipped));
    for candidate in study.front().into_iter().chain(shipped) {
        let ([lost, within], [judged_lost, judged_within]) =
            (cells_of(Some(candidate.random)), cells_of(candidate.judged));
        let closeness = format!("{:.3}", candidate.closeness);
        let settings = settings(candidate);
        table.push([closeness, lost, within, judged_lost, judged_within, settings]);
    }
    table
}

/// Every candidate, a row each.
#[must_use]
pub fn candidates(study: &Study) -> Table {
    let courses = ["calm", "wind"]
        .into_iter()
        .flat_map(|weather| PERIODS_S.map(|period_s| format!("rms {weather} {period_s} s [m]")));
    let fixed = ["settings", "closeness", "lost", "90 % within m"].map(str::to_owned);
    let mut table = Table::new(fixed.into_iter().chain(courses));
    for candidate in &study.candidates {
        let Robustness { lost, within_m } = candidate.random;
        let head = [
            settings(candidate),
            format!("{:.4}", candidate.closeness),
            lost.to_string(),
            format!("{within_m:.4}"),
        ];
        let errors = candidate.rms_m.iter().map(|rms_m| format!("{rms_m:.6}"));
        table.push(head.into_iter().chain(errors));
    }
    table
}

/// What 90 % of the random flights stay within, over closeness.
#[must_use]
pub fn figure(study: &Study) -> Figure {
    let place = |candidate: &Candidate| [candidate.closeness, candidate.random.within_m * 1e3];
    let all: Vec<[f64; 2]> = study.candidates.iter().map(place).collect();
    let front = study.front().into_iter().map(place).collect();
    let shipped = all.first().copied().into_iter().collect();
    let panel = Panel::new(
        "",
        Axis::new("closeness: rms error over the shipped set's"),
        Axis::new("90 % of random flights within [mm]"),
    )
    .curve(Curve::new("candidates", Colour::Grey, all).mark(Mark::Dots(2.5)))
    .curve(Curve::new("Pareto front", Colour::Blue, front))
    .curve(Curve::new("shipped", Colour::Red, shipped).mark(Mark::Crosses(5.0)));
    Figure::new("position MPC: closeness and robustness".to_owned(), 1).panel(panel)
}

/// Every number, for machines.
#[must_use]
pub fn to_json(study: &Study) -> Value {
    let robustness =
        |of: Robustness| json!({"lost": of.lost, "ninety_percent_within_m": of.within_m});
    let candidate = |candidate: &Candidate| {
        json!({
            "set": candidate.flags,
            "rms_m": candidate.rms_m,
            "closeness": candidate.closeness,
            "random": robustness(candidate.random),
            "judged": candidate.judged.map(robustness),
            "front": study.is_on_front(candidate),
        })
    };
    json!({
        "seed": study.plan.seed,
        "seeds": study.plan.seeds,
        "judged_seeds": study.plan.judged,
        "periods_s": PERIODS_S,
        "candidates": study.candidates.iter().map(candidate).collect::<Vec<_>>(),
    })
}

/// Writes tables, picture and JSON.
///
/// # Errors
/// A file that cannot be written.
pub fn write(study: &Study, folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    folder.table("tuning", &candidates(study))?;
    folder.figure("tuning", &figure(study))?;
    folder.json("tuning", &to_json(study))
}
