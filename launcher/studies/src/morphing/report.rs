//! The study as a table, a picture and files.

use super::{Cell, Conditions, Law, Mark, Study, Verdict, marks};
use figures::figure::{Axis, Colour, Curve, Dash, Figure, Level, Panel};
use figures::results::{ResultsError, ResultsFolder, Table};
use serde_json::{Value, json};
use simulate::in_process::StateSource;

/// Least and largest error that the picture resolves \[mm\]; what is beyond is drawn there.
const SHOWN_MM: [f64; 2] = [1.0, 300.0];
/// Room for half a mark beyond them.
const ROOM: f64 = 1.3;

/// One row per law and conditions, one column per sweep: root mean square of the position error
/// \[mm\], ratio to the flight without morph (mean of the seeds), and what went wrong.
#[must_use]
pub fn table(study: &Study) -> Table {
    let sweeps = study.plan.sweeps_s.iter().map(|sweep_s| format!("{sweep_s} s"));
    let fixed = ["air", "state", "lag real", "modelled", "model"].map(str::to_owned);
    let mut table = Table::new(fixed.into_iter().chain(sweeps));
    let rows = study.cells.chunk_by(|a, b| (a.law, a.conditions) == (b.law, b.conditions));
    for row in rows {
        let Conditions { wind, lag_modelled, lag_real, state } = row[0].conditions;
        let yes = |yes: bool| if yes { "yes" } else { "no" }.to_owned();
        let head = [air(wind), state_name(state), yes(lag_real), yes(lag_modelled)];
        table.push(head.into_iter().chain([law_name(row[0].law)]).chain(row.iter().map(brief)));
    }
    table
}

/// As in the table: `5.1 x1.02`, or what went wrong with it.
fn brief(cell: &Cell) -> String {
    let rms_mm = cell.rms_m() * 1e3;
    match cell.verdict() {
        Verdict::Lost => "lost".to_owned(),
        Verdict::LimitCycle => format!("{rms_mm:.1} x{:.2} cycle", cell.mean_ratio()),
        Verdict::Flown => format!("{rms_mm:.1} x{:.2}", cell.mean_ratio()),
    }
}

/// The marks as a table.
#[must_use]
pub fn mark_table(marks: &[Mark]) -> Table {
    let mut table = Table::new(["mark, scheduled law in calm air", "worst", "limit", "at", ""]);
    for mark in marks {
        let verdict = if mark.holds { "holds" } else { "FAILS" };
        let [value, limit] = [mark.value, mark.limit].map(|v| format!("{v:.4}"));
        table.push([mark.name, &value, &limit, &format!("{} s", mark.sweep_s), verdict]);
    }
    table
}

/// Every cell with all its numbers, for machines.
#[must_use]
pub fn to_json(study: &Study) -> Value {
    let cell = |cell: &Cell| {
        json!({
            "model": law_name(cell.law),
            "sweep_s": cell.sweep_s,
            "air": air(cell.conditions.wind),
            "state": state_name(cell.conditions.state),
            "lag_real": cell.conditions.lag_real,
            "lag_modelled": cell.conditions.lag_modelled,
            "verdict": cell.verdict(),
            "rms_m": cell.rms_m(),
            "peak_m": cell.peak_m(),
            "mean_ratio": cell.mean_ratio(),
            "worst_ratio": cell.worst_ratio(),
            "ratios": cell.ratios,
            "flights": cell.flights,
        })
    };
    json!({
        "sweeps_s": study.plan.sweeps_s,
        "marks": marks(study),
        "cells": study.cells.iter().map(cell).collect::<Vec<_>>(),
    })
}

/// Every flight, a row each.
#[must_use]
pub fn flights(study: &Study) -> Table {
    let mut table = Table::new([
        "model",
        "sweep_s",
        "air",
        "state",
        "lag_real",
        "lag_modelled",
        "seed",
        "verdict",
        "rms_m",
        "peak_m",
        "sweep_rms_m",
        "ratio",
        "oscillation_rad_s",
    ]);
    for cell in &study.cells {
        let sweep = study.plan.sweeps_s.iter().position(|s| s.total_cmp(&cell.sweep_s).is_eq());
        for (flown, ratio) in cell.flights.iter().zip(&cell.ratios) {
            let window_m = sweep.map_or(f64::NAN, |sweep| flown.window_rms_m[sweep]);
            let verdict = json!(flown.verdict).as_str().unwrap_or_default().to_owned();
            table.push([
                law_name(cell.law),
                cell.sweep_s.to_string(),
                air(cell.conditions.wind),
                state_name(cell.conditions.state),
                cell.conditions.lag_real.to_string(),
                cell.conditions.lag_modelled.to_string(),
                flown.seed.to_string(),
                verdict,
                format!("{:.6}", flown.rms_m),
                format!("{:.6}", flown.peak_m),
                format!("{window_m:.6}"),
                format!("{ratio:.4}"),
                format!("{:.4}", flown.oscillation_rad_s),
            ]);
        }
    }
    table
}

/// Error over sweep time, one panel for each air and state, one curve per law; dashed where lag is
/// real and not modelled.
#[must_use]
pub fn figure(study: &Study) -> Figure {
    let mut figure = Figure::new("figure8-morph: position error over the time of a sweep", 2)
        .panel_px(430.0, 300.0);
    for wind in [false, true] {
        for state in [StateSource::Truth, StateSource::Estimator] {
            let of = |lag_modelled| Conditions { wind, lag_modelled, lag_real: true, state };
            if !study.plan.conditions.contains(&of(true)) {
                continue;
            }
            let title = format!("{} air, state: {}", air(wind), state_name(state));
            let x = Axis::log("time of a sweep [s]").range(0.25, 5.0);
            let [least, most] = SHOWN_MM;
            let y = Axis::log("position RMS [mm]").range(least / ROOM, most * ROOM);
            let mut panel = Panel::new(title, x, y);
            for (law, colour) in study.plan.laws.iter().zip(Colour::SERIES) {
                for (lag_modelled, dash) in [(true, Dash::Solid), (false, Dash::Dashed)] {
                    panel = draw(panel, study, (*law, of(lag_modelled)), (colour, dash));
                }
            }
            if !wind {
                let limit_mm = if state == StateSource::Truth { 6.0 } else { 30.0 };
                panel = panel.level(Level::new("mark", Colour::Black, Dash::Dotted, limit_mm));
            }
            figure = figure.panel(panel);
        }
    }
    figure
}

/// A line through the cells of a law; dots in its colour where it flew, black marks elsewhere.
fn draw(
    panel: Panel,
    study: &Study,
    (law, conditions): (Law, Conditions),
    (colour, dash): (Colour, Dash),
) -> Panel {
    use figures::figure::Mark as Drawn;
    let cells: Vec<_> =
        study.cells.iter().filter(|c| (c.law, c.conditions) == (law, conditions)).collect();
    if cells.is_empty() {
        return panel;
    }
    let point = |cell: &Cell| {
        let lost = cell.verdict() == Verdict::Lost;
        let rms_mm = if lost { SHOWN_MM[1] } else { cell.rms_m() * 1e3 };
        [cell.sweep_s, rms_mm.clamp(SHOWN_MM[0], SHOWN_MM[1])]
    };
    let points = |verdict: Option<Verdict>| {
        let chosen = cells.iter().filter(|c| verdict.is_none_or(|v| c.verdict() == v));
        chosen.map(|cell| point(cell)).collect::<Vec<_>>()
    };
    let model = if conditions.lag_modelled { "" } else { ", lag not modelled" };
    let name = format!("{}{model}", law_name(law));
    let black = |name, verdict| Curve::new(name, Colour::Black, points(Some(verdict)));
    panel
        .curve(Curve::new(name, colour, points(None)).mark(Drawn::Line(dash)))
        .curve(Curve::new("", colour, points(Some(Verdict::Flown))).mark(Drawn::Dots(3.5)))
        .curve(black("limit cycle", Verdict::LimitCycle).mark(Drawn::Crosses(4.0)))
        .curve(black("lost", Verdict::Lost).mark(Drawn::Dots(5.0)))
}

/// Writes table, flights, JSON and picture.
///
/// # Errors
/// A file that cannot be written.
pub fn write(study: &Study, folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    folder.table("morphing", &table(study))?;
    folder.table("morphing-flights", &flights(study))?;
    folder.json("morphing", &to_json(study))?;
    folder.figure("morphing", &figure(study))
}

fn air(wind: bool) -> String {
    if wind { "windy" } else { "calm" }.to_owned()
}

fn state_name(state: StateSource) -> String {
    match state {
        StateSource::Truth => "perfect",
        StateSource::Estimator => "estimator",
    }
    .to_owned()
}

fn law_name(law: Law) -> String {
    match law {
        Law::Scheduled => "scheduled".to_owned(),
        Law::Fixed(angle_deg) => format!("fixed {angle_deg} deg"),
    }
}
