//! The study as tables, a picture and files.

use super::{Flown, RANGES, SCENARIO, Study};
use figures::figure::{Axis, Colour, Curve, Dash, Figure, Level, Panel};
use figures::results::{ResultsError, ResultsFolder, Table};
use serde_json::{Value, json};

/// Beyond this a flight is looked at one by one \[m\].
pub const FAR_M: f64 = 0.3;
/// Flights that are named as the worst.
const WORST: usize = 5;
/// Shares of the flights of which the largest error is reported.
const SHARES: [f64; 4] = [0.5, 0.9, 0.95, 1.0];

/// How far from their path the flights were: one row.
#[must_use]
pub fn table(study: &Study) -> Table {
    let shares = SHARES.map(|share| format!("{:.0} % within mm", share * 100.0));
    let fixed = ["flown", "left out", "lost", "> 0.3 m"].map(str::to_owned);
    let mut table = Table::new(fixed.into_iter().chain(shares));
    let counts = [study.flights.len(), study.left_out.len(), study.lost(), study.beyond(FAR_M)];
    let counts = counts.map(|count| count.to_string());
    let errors = SHARES.map(|share| format!("{:.1}", study.quantile_m(share) * 1e3));
    table.push(counts.into_iter().chain(errors));
    table
}

/// The worst flights, and the commands that fly them again.
#[must_use]
pub fn worst(study: &Study) -> Vec<String> {
    let mut flights: Vec<&Flown> = study.flights.iter().collect();
    flights.sort_by(|a, b| b.is_lost().cmp(&a.is_lost()).then(b.max_m.total_cmp(&a.max_m)));
    let line = |flown: &&Flown| {
        let Flown { grade, max_m, flags, .. } = flown;
        format!("{grade}, {:.1} mm: morphquad run {SCENARIO} {flags}", max_m * 1e3)
    };
    flights.iter().take(WORST).map(line).collect()
}

/// The members that were left out, and why.
#[must_use]
pub fn left_out(study: &Study) -> Vec<String> {
    let line =
        |(draw, why): &(super::Draw, String)| format!("seed {}: it would take {why}", draw.seed);
    study.left_out.iter().map(line).collect()
}

/// Every flight, a row each, with what was drawn for it.
#[must_use]
pub fn flights(study: &Study) -> Table {
    let drawn = RANGES.map(|range| range.name.to_owned());
    let fixed = ["seed", "verdict", "rms_m", "max_m", "tilt_rad", "rotor"].map(str::to_owned);
    let mut table = Table::new(fixed.into_iter().chain(drawn));
    for Flown { draw, rms_m, max_m, tilt_rad, grade, .. } in &study.flights {
        let head = [
            draw.seed.to_string(),
            grade.to_string(),
            format!("{rms_m:.6}"),
            format!("{max_m:.6}"),
            format!("{tilt_rad:.4}"),
            draw.rotor.to_string(),
        ];
        table.push(head.into_iter().chain(draw.values.map(|value| format!("{value:?}"))));
    }
    table
}

/// Share of the flights that stay within an error, over that error.
#[must_use]
pub fn figure(study: &Study) -> Figure {
    let mut errors: Vec<f64> = study.flights.iter().map(|flown| flown.max_m * 1e3).collect();
    errors.sort_by(f64::total_cmp);
    let count = errors.len().max(1) as f64;
    let points = errors.iter().enumerate();
    let points = points.map(|(i, error)| [*error, 100.0 * (i + 1) as f64 / count]).collect();
    let x = Axis::log("largest position error [mm]");
    let y = Axis::new("flights within it [%]").range(0.0, 100.0);
    let panel = Panel::new("", x, y)
        .curve(Curve::new("flights", Colour::Blue, points))
        .level(Level::new("90 %", Colour::Black, Dash::Dotted, 90.0));
    Figure::new(format!("{SCENARIO}, random vehicles and weather"), 1).panel(panel)
}

/// Every number, for machines.
#[must_use]
pub fn to_json(study: &Study) -> Value {
    let range =
        |range: &super::Range| json!({"name": range.name, "range": [range.least, range.most]});
    let flight = |flown: &Flown| {
        json!({
            "seed": flown.draw.seed,
            "verdict": flown.grade,
            "rms_m": flown.rms_m,
            "max_m": flown.max_m,
            "tilt_rad": flown.tilt_rad,
            "rotor": flown.draw.rotor,
            "drawn": flown.draw.values,
            "again": format!("morphquad run {SCENARIO} {}", flown.flags),
        })
    };
    let quantile = |share: f64| json!({"share": share, "max_m": study.quantile_m(share)});
    json!({
        "seeds": study.plan.seeds,
        "flags": study.plan.flags,
        "ranges": RANGES.iter().map(range).collect::<Vec<_>>(),
        "lost": study.lost(),
        "beyond_0_3_m": study.beyond(FAR_M),
        "quantiles": SHARES.map(quantile),
        "left_out": left_out(study),
        "flights": study.flights.iter().map(flight).collect::<Vec<_>>(),
    })
}

/// Writes tables, picture and JSON.
///
/// # Errors
/// A file that cannot be written.
pub fn write(study: &Study, folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    folder.table("random-flights", &flights(study))?;
    folder.figure("random-flights", &figure(study))?;
    folder.json("random-flights", &to_json(study))
}
