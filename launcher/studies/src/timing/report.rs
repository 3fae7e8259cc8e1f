//! The study as tables, a picture and files.

use super::{Flown, KINDS, Kind, Study, Sweep, TIMES_S};
use figures::figure::{Axis, Colour, Curve, Dash, Figure, Level, Panel};
use figures::results::{ResultsError, ResultsFolder, Table};
use serde_json::{Value, json};

/// Error beyond which a picture shows no difference any more \[mm\].
const SHOWN_MM: f64 = 1e3;

fn ms(time_s: f64) -> String {
    format!("{:.2}", time_s * 1e3)
}

/// A limit \[ms\].
fn limit(sweep: &Sweep, index: usize) -> String {
    match sweep.limits_s[index] {
        None => format!("< {}", ms(TIMES_S[0])),
        Some(time_s) if time_s >= TIMES_S[1] => format!("> {}", ms(TIMES_S[1])),
        Some(time_s) => ms(time_s),
    }
}

/// What each loop bears: a row for each sweep.
#[must_use]
pub fn table(study: &Study) -> Table {
    let mut table = Table::new([
        "loop",
        "period ms",
        "what",
        "on time up to ms",
        "passes up to ms",
        "not lost up to ms",
    ]);
    for sweep in &study.sweeps {
        let [on_time, passes, survives] = [0, 1, 2].map(|index| limit(sweep, index));
        let (period, what) = (ms(sweep.period_s), sweep.kind.label().to_owned());
        table.push([sweep.name.clone(), period, what, on_time, passes, survives]);
    }
    table
}

/// The eigenvalues' prediction for the attitude loop, in a sentence; nothing if it was not computed.
#[must_use]
pub fn prediction(study: &Study) -> String {
    study.predicted_s.map_or(String::new(), |time_s| {
        format!(
            "by its eigenvalues the attitude MPC's loop is stable up to a command that is in effect {} ms after its release\n",
            ms(time_s)
        )
    })
}

/// Every flight, a row each.
#[must_use]
pub fn flights(study: &Study) -> Table {
    let mut table =
        Table::new(["loop", "what", "time_s", "rms_m", "max_m", "missed", "late", "verdict"]);
    for sweep in &study.sweeps {
        for Flown { time_s, rms_m, max_m, missed, late, grade } in &sweep.flights {
            table.push([
                sweep.name.clone(),
                sweep.kind.label().to_owned(),
                format!("{time_s:.6}"),
                format!("{rms_m:.6}"),
                format!("{max_m:.6}"),
                missed.to_string(),
                late.to_string(),
                grade.to_string(),
            ]);
        }
    }
    table
}

/// Position error over the time that each loop takes, a panel for each kind.
#[must_use]
pub fn figure(study: &Study) -> Figure {
    let mut figure = Figure::new(format!("{}: what loops bear", study.plan.scenario), 2);
    for kind in KINDS {
        let title = match kind {
            Kind::Step => "every step takes the time",
            Kind::Jitter => "every step begins late by up to the time",
        };
        let [x, y] = [Axis::log("time [ms]"), Axis::log("position error, RMS [mm]")];
        let least_mm = study.usual.rms_m * 1e3;
        let mut panel = Panel::new(title, x, y.range(0.5 * least_mm, SHOWN_MM));
        let colours = [Colour::Green, Colour::Orange, Colour::Blue];
        let of_kind = study.sweeps.iter().filter(|sweep| sweep.kind == kind);
        for (sweep, colour) in of_kind.zip(colours) {
            let error_mm = |flown: &Flown| (flown.rms_m * 1e3).min(SHOWN_MM);
            let points = sweep.flights.iter().map(|flown| [flown.time_s * 1e3, error_mm(flown)]);
            panel = panel.curve(Curve::new(&sweep.name, colour, points.collect()));
        }
        panel = panel.level(Level::new("on time", Colour::Black, Dash::Dotted, least_mm));
        figure = figure.panel(panel);
    }
    figure
}

/// Every number, for machines.
#[must_use]
pub fn to_json(study: &Study) -> Value {
    let flown = |flown: &Flown| {
        json!({
            "time_s": flown.time_s,
            "rms_m": flown.rms_m,
            "max_m": flown.max_m,
            "missed": flown.missed,
            "late": flown.late,
            "verdict": flown.grade,
        })
    };
    let sweep = |sweep: &Sweep| {
        let [on_time_s, passes_s, survives_s] = sweep.limits_s;
        json!({
            "loop": sweep.name,
            "role": sweep.role.label(),
            "period_s": sweep.period_s,
            "what": sweep.kind.label(),
            "on_time_s": on_time_s,
            "passes_s": passes_s,
            "survives_s": survives_s,
            "flights": sweep.flights.iter().map(flown).collect::<Vec<_>>(),
        })
    };
    json!({
        "scenario": study.plan.scenario,
        "flags": study.plan.flags,
        "times_s": TIMES_S,
        "usual": flown(&study.usual),
        "stable_up_to_s": study.predicted_s,
        "sweeps": study.sweeps.iter().map(sweep).collect::<Vec<_>>(),
    })
}

/// Writes tables, picture and JSON.
///
/// # Errors
/// A file that cannot be written.
pub fn write(study: &Study, folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    folder.table("timing", &table(study))?;
    folder.table("timing-flights", &flights(study))?;
    folder.figure("timing", &figure(study))?;
    folder.json("timing", &to_json(study))
}
