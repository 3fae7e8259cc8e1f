//! The maps and limits as tables, pictures and files.

use super::{Answer, Bench, Model, Point, QUANTITIES, Quantity, Range, Study};
use figures::figure::{Axis, Figure, HeatMap, Panel, Shade};
use figures::results::{ResultsError, ResultsFolder, Table};
use serde_json::{Value, json};

/// The stable range of every quantity by both methods.
#[must_use]
pub fn table(study: &Study) -> Table {
    let mut table = Table::new(["model", "r_w", "quantity", "linear", "nonlinear, rotors"]);
    for limits in &study.limits {
        table.push([
            model_name(limits.model).to_owned(),
            limits.increment_weight.to_string(),
            quantity_name(limits.quantity).to_owned(),
            range(limits.linear, limits.quantity),
            range(limits.simulated, limits.quantity),
        ]);
    }
    table
}

fn range(range: Range, quantity: Quantity) -> String {
    let show = |value: f64| match quantity {
        Quantity::Lag => format!("{:.1} ms", value * 1e3),
        Quantity::Inertia | Quantity::Delay => format!("{value:.2}"),
    };
    match range {
        Range { stable: false, .. } => "nowhere".to_owned(),
        Range { from: None, to: None, .. } => "everywhere".to_owned(),
        Range { from: None, to: Some(to), .. } => format!("up to {}", show(to)),
        Range { from: Some(from), to: None, .. } => format!("from {}", show(from)),
        Range { from: Some(from), to: Some(to), .. } => format!("{} to {}", show(from), show(to)),
    }
}

/// What each model is worth on the vehicle as it is.
#[must_use]
pub fn settling_table(study: &Study) -> Table {
    let mut table = Table::new(["model", "r_w", "step of 0.2 rad on the vehicle as it is"]);
    for settling in &study.settling {
        let answer = match settling.answer {
            Answer::Settled(settling_s) => format!("settles in {settling_s:.3} s"),
            Answer::Slow => "not yet settled after 6 s".to_owned(),
            Answer::LimitCycle(extent_rad) => format!("limit cycle of {extent_rad:.2} rad"),
            Answer::Lost => "lost".to_owned(),
        };
        let weight = settling.increment_weight.to_string();
        table.push([model_name(settling.model).to_owned(), weight, answer]);
    }
    table
}

/// True for the points wanted.
type Choice = fn(&&Point) -> bool;

/// Where the methods differ: how many points of each map only one of them calls stable, and the
/// ranges of value and `r_w` in which these lie.
#[must_use]
pub fn differences(study: &Study) -> Table {
    let mut table = Table::new(["model", "quantity", "points", "stable by", "differ", "where"]);
    let tests: [(&str, Choice); 2] = [
        ("linear alone", |p| p.spectral_radius < 1.0 && !p.answer.is_stable()),
        ("nonlinear alone", |p| p.spectral_radius >= 1.0 && p.answer.is_stable()),
    ];
    for (model, quantity) in maps() {
        for (method, test) in tests {
            let differ: Vec<_> = of(study, model, quantity).filter(test).collect();
            let span = |value: fn(&Point) -> f64| {
                let values = differ.iter().map(|point| value(point));
                values.fold([f64::MAX, f64::MIN], |[l, m], v| [l.min(v), m.max(v)])
            };
            let ([from, to], [least, most]) = (span(|p| p.value), span(|p| p.increment_weight));
            let shown = [from, to].map(|value| cell_name(quantity, value));
            let place = format!("{} to {}, r_w {least:.2} to {most:.2}", shown[0], shown[1]);
            table.push([
                model_name(model).to_owned(),
                quantity_name(quantity).to_owned(),
                of(study, model, quantity).count().to_string(),
                method.to_owned(),
                differ.len().to_string(),
                if differ.is_empty() { String::new() } else { place },
            ]);
        }
    }
    table
}

/// Every point, a row each.
#[must_use]
pub fn points(study: &Study) -> Table {
    let mut table = Table::new([
        "model",
        "quantity",
        "r_w",
        "value",
        "spectral_radius",
        "answer",
        "settling_s",
        "cycle_rad",
    ]);
    for point in &study.points {
        let (answer, settling, cycle) = match point.answer {
            Answer::Settled(settling_s) => ("settled", format!("{settling_s:.3}"), String::new()),
            Answer::Slow => ("slow", String::new(), String::new()),
            Answer::LimitCycle(extent) => ("limit cycle", String::new(), format!("{extent:.4}")),
            Answer::Lost => ("lost", String::new(), String::new()),
        };
        table.push([
            model_name(point.model).to_owned(),
            quantity_name(point.quantity).to_owned(),
            format!("{:.5}", point.increment_weight),
            format!("{:.5}", point.value),
            format!("{:.6}", point.spectral_radius),
            answer.to_owned(),
            settling,
            cycle,
        ]);
    }
    table
}

/// Everything, for machines.
#[must_use]
pub fn to_json(study: &Study) -> Value {
    json!({
        "rate_hz": study.bench.rate_hz,
        "morph_angle_deg": study.bench.morph_angle.rad().to_degrees(),
        "limits": study.limits,
        "settling": study.settling,
        "points": study.points,
    })
}

/// Largest eigenvalue of the linear loop; the thick line divides stable from unstable.
#[must_use]
pub fn linear_figure(study: &Study) -> Figure {
    let shade = Shade::Around(1.0, 0.5);
    let title = "largest eigenvalue; blue: stable; 1.5: or more";
    figure(study, title, shade, Some(1.0), |point| point.spectral_radius.min(1.5))
}

/// Settling time of the nonlinear vehicle \[s\]; grey does not settle.
#[must_use]
pub fn simulated_figure(study: &Study) -> Figure {
    let title = "settling time of a roll step [s], nonlinear with rotors; grey: never";
    figure(study, title, Shade::RisingLog(0.05, 3.0), None, |point| match point.answer {
        Answer::Settled(settling_s) => settling_s,
        Answer::Slow => 3.0,
        Answer::LimitCycle(_) | Answer::Lost => f64::NAN,
    })
}

fn figure(
    study: &Study,
    what: &str,
    shade: Shade,
    divide: Option<f64>,
    value: impl Fn(&Point) -> f64,
) -> Figure {
    let Bench { rate_hz, morph_angle, .. } = &study.bench;
    let angle_deg = morph_angle.rad().to_degrees();
    let title = format!("attitude loop at {rate_hz} Hz, {angle_deg:.1} deg: {what}");
    let mut figure = Figure::new(title, 2).panel_px(520.0, 340.0);
    for (model, quantity) in maps() {
        let title = format!("{}: {}", quantity_name(quantity), model_name(model));
        let x = Axis::new(axis_name(quantity));
        let values = study.grid.values(quantity);
        let rows = study.grid.weights.iter().map(|weight| {
            let row = of(study, model, quantity);
            row.filter(|p| p.increment_weight.total_cmp(weight).is_eq()).map(&value).collect()
        });
        let heat = HeatMap {
            columns: named(values, |v| cell_name(quantity, v)),
            rows: named(&study.grid.weights, |weight| format!("{weight:.2}")),
            values: rows.collect(),
            decimals: None,
            shade,
            divide,
        };
        figure = figure.panel(Panel::new(title, x, Axis::new("r_w [rad²/(N m)²]")).heat(heat));
    }
    figure
}

/// Names for at most a dozen cells; the others have none, so that names do not overlap.
fn named(values: &[f64], name: impl Fn(f64) -> String) -> Vec<String> {
    let every = values.len().div_ceil(12).next_power_of_two();
    let named = values.iter().enumerate();
    named.map(|(i, v)| if i % every == 0 { name(*v) } else { " ".repeat(i) }).collect()
}

fn cell_name(quantity: Quantity, value: f64) -> String {
    match quantity {
        Quantity::Lag => format!("{:.0}", value * 1e3),
        Quantity::Inertia => format!("{value:.1}"),
        Quantity::Delay => format!("{value:.2}"),
    }
}

/// Writes tables, JSON and pictures.
///
/// # Errors
/// A file that cannot be written.
pub fn write(study: &Study, folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    folder.table("stability-limits", &table(study))?;
    folder.table("stability-settling", &settling_table(study))?;
    folder.table("stability-map", &points(study))?;
    folder.json("stability", &to_json(study))?;
    folder.figure("stability-linear", &linear_figure(study))?;
    folder.figure("stability-nonlinear", &simulated_figure(study))
}

fn maps() -> impl Iterator<Item = (Model, Quantity)> {
    QUANTITIES.into_iter().flat_map(|q| [Model::Bare, Model::LagAndDelay].map(|m| (m, q)))
}

fn of(study: &Study, model: Model, quantity: Quantity) -> impl Iterator<Item = &Point> {
    study.points.iter().filter(move |p| (p.model, p.quantity) == (model, quantity))
}

fn model_name(model: Model) -> &'static str {
    match model {
        Model::Bare => "bare",
        Model::Lag => "lag modelled",
        Model::LagAndDelay => "lag and delay modelled",
    }
}

fn quantity_name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Lag => "rotor lag",
        Quantity::Inertia => "inertia",
        Quantity::Delay => "unmodelled delay",
    }
}

fn axis_name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Lag => "rotor lag [ms]",
        Quantity::Inertia => "inertia / modelled inertia",
        Quantity::Delay => "unmodelled delay [control periods]",
    }
}
