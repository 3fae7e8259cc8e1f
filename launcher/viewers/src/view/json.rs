//! Parts of a flight as the page reads them.
//!
//! A recording is sent at once; of a running flight first everything so far, and then again and again
//! what has come since an instant, with the index of the first value of each part.

use super::collect::Frames;
use super::panel::{Panel, Panels, Series};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use figures::figure::{Colour, Dash};
use observe::seat_name;
use serde_json::{Value, json};
use shared_types::LoopStats;
use shared_types::time::s_from_ns;
use vehicle::VehicleParameters;

pub(crate) fn vehicle(vehicle: &VehicleParameters) -> Value {
    let arm = vehicle.geometry.arm_length_m;
    json!({
        "mass_kg": vehicle.mass_kg,
        "gravity_m_s2": vehicle.gravity_m_s2,
        "rotor_thrust_max_n": vehicle.rotor_thrust_max_n,
        "arm_length_m": [arm.c0, arm.c1, arm.c2],
    })
}

/// Everything that moves, from `from_ns` after the beginning on; of a flight that goes on, only as far as it is
/// known where the vehicle was to be.
pub(crate) fn frames(frames: &Frames, from_ns: u64, goes_on: bool) -> Value {
    let Frames { body, wanted_w_m, rotor_thrust_n, world } = frames;
    let steps = [body.step_ns(), wanted_w_m.step_ns(), rotor_thrust_n.step_ns(), world.step_ns()];
    let step_ns = steps.into_iter().max().unwrap_or(body.step_ns());
    let factor = usize::try_from(step_ns / body.step_ns()).unwrap_or(1).max(1);
    let known = match wanted_w_m.len() {
        wanted @ 1.. if goes_on => body.len().min(wanted),
        _ => body.len(),
    };
    let count = known.div_ceil(factor);
    let first = usize::try_from(from_ns / step_ns).unwrap_or(usize::MAX).min(count);
    json!({
        "step_s": s_from_ns(step_ns),
        "first": first,
        "count": count,
        "body": packed(&body.values(step_ns, first, count)),
        "wanted_w_m": packed(&wanted_w_m.values(step_ns, first, count)),
        "rotor_thrust_n": packed(&rotor_thrust_n.values(step_ns, first, count)),
        "world": packed(&world.values(step_ns, first, count)),
    })
}

/// The charts of a recording, without what has no values.
pub(crate) fn charts(panels: &Panels) -> Value {
    let charts = panels.in_order().into_iter().filter(|(group, panel)| {
        // A group's name stands on its first panel, which therefore is shown even without data.
        !group.is_empty() || !panel.is_empty()
    });
    let seen = |series: &&Series| !series.envelope.bins().2.is_empty();
    charts.map(|(group, panel)| chart(group, panel, panel.series.iter().filter(seen))).collect()
}

/// Every chart with every series, to be added to.
pub(crate) fn all_charts(panels: &Panels) -> Value {
    let charts = panels.in_order().into_iter();
    charts.map(|(group, panel)| chart(group, panel, panel.series.iter())).collect()
}

/// The values of every series of every chart from `from_ns` on.
pub(crate) fn charts_since(panels: &Panels, from_ns: u64) -> Value {
    let series = |panel: &Panel| -> Value {
        panel.series.iter().map(|series| values(series, from_ns)).collect()
    };
    let charts = panels.in_order().into_iter();
    charts.map(|(_, panel)| json!({ "series": series(panel) })).collect()
}

fn chart<'a>(group: &str, panel: &Panel, series: impl Iterator<Item = &'a Series>) -> Value {
    let levels = panel.levels.iter().map(|(name, at)| json!({ "name": name, "at": at }));
    json!({
        "group": group,
        "title": panel.title,
        "unit": panel.unit,
        "log": panel.log,
        "levels": levels.collect::<Value>(),
        "series": series.map(whole_series).collect::<Value>(),
    })
}

fn whole_series(series: &Series) -> Value {
    let mut json = values(series, 0);
    json["name"] = series.name.into();
    json["colour"] = colour(series.colour).into();
    json["dash"] = match series.dash {
        Dash::Solid => json!([]),
        Dash::Dashed => json!([6, 4]),
        Dash::Dotted => json!([2, 3]),
        Dash::DashDot => json!([6, 3, 2, 3]),
    };
    json["is_bound"] = series.is_bound.into();
    json
}

fn values(series: &Series, from_ns: u64) -> Value {
    let (origin_ns, width_ns, bins) = series.envelope.bins();
    let first = from_ns.saturating_sub(origin_ns).checked_div(width_ns).unwrap_or(0);
    let first = usize::try_from(first).unwrap_or(usize::MAX).min(bins.len());
    let side = |i: usize| packed(&bins[first..].iter().map(|bin| bin[i]).collect::<Vec<f32>>());
    let mut json = json!({
        "from_s": s_from_ns(origin_ns),
        "width_s": s_from_ns(width_ns),
        "first": first,
        "least": side(0),
    });
    if series.envelope.is_merged() {
        json["greatest"] = side(1).into();
    }
    json
}

/// Totals of each seat's loop.
pub(crate) fn loops(loops: &[LoopStats]) -> Value {
    loops.iter().map(loop_totals).collect()
}

fn colour(colour: Colour) -> &'static str {
    match colour {
        Colour::Black => "black",
        Colour::Grey => "grey",
        Colour::Red => "red",
        Colour::Blue => "blue",
        Colour::Green => "green",
        Colour::Orange => "orange",
        Colour::Purple => "purple",
        Colour::Sky => "sky",
    }
}

fn loop_totals(stats: &LoopStats) -> Value {
    json!({
        "name": seat_name(stats),
        "steps": stats.steps,
        "skipped": stats.skipped,
        "missed": stats.input_deadline_misses,
        "late": stats.late_samples,
        "lost": stats.lost_samples,
        "restarts": stats.generation,
    })
}

/// Numbers as bytes, least significant first, in letters.
fn packed(values: &[f32]) -> String {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    STANDARD.encode(bytes)
}
