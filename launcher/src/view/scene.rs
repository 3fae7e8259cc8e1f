//! A flight as the page wants it: one JSON object.

use super::collect::{Collect, Frames};
use super::happening::{Happening, Owners};
use super::panel::{Panel, Panels, Series, Uses};
use crate::figure::{Colour, Dash};
use crate::record::Clock;
use crate::record::read::{Closing, ReadError, RecordedFlight};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use shared_types::LoopStats;
use std::path::PathBuf;
use thiserror::Error;
use vehicle::VehicleParameters;

/// Why there is no page of a recording.
#[derive(Debug, Error)]
pub enum ViewError {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// It can, and there is no vehicle in it.
    #[error("{}: no sample of the topic truth is in it, so there is nothing to show; fly again, or show a run that got further", path.display())]
    NothingFlown {
        /// The file.
        path: PathBuf,
    },
}

/// Everything that the page shows of a flight, decimated to what a screen can resolve.
#[derive(Debug)]
pub struct Scene {
    json: Value,
}

/// Everything that a recording shows, in bounded memory.
#[derive(Debug)]
pub(crate) struct Gathered {
    pub(crate) panels: Panels,
    frames: Frames,
    /// In the order of time.
    pub(crate) happenings: Vec<Happening>,
    /// Last totals of each loop.
    loops: Vec<LoopStats>,
    pub(crate) uses: Uses,
    /// First and last instant of the vehicle \[ns\].
    pub(crate) span_ns: (u64, u64),
    pub(crate) closing: Closing,
}

/// Goes through a recording, twice.
///
/// # Errors
/// The file is damaged, or nothing was flown.
pub(crate) fn gather(flight: &RecordedFlight) -> Result<Gathered, ViewError> {
    let mut owners = Owners::default();
    flight.visit(&mut owners)?;
    let epoch_unix_ns = flight.facts().get("epoch_unix_ns").and_then(|t| t.parse().ok());
    let most_n = flight.scenario().modelled_vehicle().rotor_thrust_max_n;
    let mut collect = Collect::new(&owners, epoch_unix_ns.unwrap_or(0), flight.clock(), most_n);
    let closing = flight.visit(&mut collect)?;
    collect.finish();
    let Some(span_ns) = collect.span_ns else {
        return Err(ViewError::NothingFlown { path: flight.path().to_owned() });
    };
    let Collect { panels, frames, mut happenings, loops, uses, .. } = collect;
    happenings.extend(owners.happenings);
    happenings.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok(Gathered { panels, frames, happenings, loops, uses, span_ns, closing })
}

impl Scene {
    /// Reads a recording, in bounded memory.
    ///
    /// # Errors
    /// The file is damaged, or nothing was flown.
    pub fn read(flight: &RecordedFlight) -> Result<Self, ViewError> {
        let gathered = gather(flight)?;
        let Gathered { panels, frames, happenings, loops, span_ns, closing, .. } = gathered;
        let (from_ns, to_ns) = span_ns;
        let vehicle = flight.scenario().modelled_vehicle();
        let (from_s, to_s) = (seconds(from_ns), seconds(to_ns));
        let name = flight.path().file_name().map(|name| name.to_string_lossy().into_owned());
        let fact = |key: &str| flight.facts().get(key).cloned().unwrap_or_default();
        let charts = panels.in_order().into_iter().filter(|(group, panel)| {
            // A group's name stands on its first panel, which therefore is shown even without data.
            !group.is_empty() || !panel.is_empty()
        });
        let json = json!({
            "format": 1,
            "file": name,
            "title": format!("{} · run {}", fact("scenario"), fact("run_id")),
            "from_s": from_s,
            "to_s": to_s,
            "outcome": outcome(&closing, to_s),
            "facts": facts(flight, &closing),
            "vehicle": vehicle_json(&vehicle),
            "frames": frames_json(frames),
            "charts": charts.map(|(group, panel)| panel_json(group, panel)).collect::<Value>(),
            "events": json!(happenings),
            "loops": loops.iter().map(loop_json).collect::<Value>(),
        });
        Ok(Self { json })
    }

    /// As the page reads it.
    #[must_use]
    pub fn to_json(&self) -> &Value {
        &self.json
    }
}

/// How the flight ended: a word for the colour, and a sentence.
fn outcome(closing: &Closing, to_s: f64) -> Value {
    let told = closing.summary.get("outcome").cloned();
    match told {
        Some(text) if text == "flown" => json!({ "is_good": true, "text": text }),
        Some(text) => json!({ "is_good": false, "text": text }),
        None if closing.complete => json!({ "is_good": false, "text": "the file has no summary" }),
        None => json!({
            "is_good": false,
            "text": format!("the file is cut at {to_s:.3} s: what came later is not in it"),
        }),
    }
}

/// Names and values for people.
fn facts(flight: &RecordedFlight, closing: &Closing) -> Value {
    let clock = match flight.clock() {
        Clock::Lockstep => "lockstep".to_owned(),
        Clock::Realtime { speed } => format!("realtime, speed {speed}"),
    };
    let fact = |key: &str| flight.facts().get(key).cloned().unwrap_or_default();
    let mut facts = vec![
        ("run", fact("run_id")),
        ("scenario", fact("scenario")),
        ("clock", clock),
        ("seed", fact("seed")),
        ("build", format!("{} ({})", fact("version"), fact("git"))),
        ("machine", fact("cpu_model")),
        ("kernel", fact("kernel")),
    ];
    facts.extend(flight.branched().map(|branched| ("branch", branched.to_string())));
    facts.extend(flight.continued().map(|continued| ("part", continued.to_string())));
    let shown = [
        ("position_rms_m", "tracking rms [m]"),
        ("position_max_m", "tracking max [m]"),
        ("constraint_violations", "constraint violations"),
        ("missed_ticks", "missed ticks"),
        ("late_samples", "late samples"),
        ("dropped_samples", "samples dropped"),
        ("safe_mode_episodes", "safe-mode episodes"),
        ("hash", "hash"),
    ];
    let told = shown.into_iter().filter_map(|(key, name)| Some((name, closing.summary.get(key)?)));
    facts.extend(told.map(|(name, value)| (name, value.clone())));
    json!(facts)
}

fn vehicle_json(vehicle: &VehicleParameters) -> Value {
    let arm = vehicle.geometry.arm_length_m;
    json!({
        "mass_kg": vehicle.mass_kg,
        "gravity_m_s2": vehicle.gravity_m_s2,
        "rotor_thrust_max_n": vehicle.rotor_thrust_max_n,
        "arm_length_m": [arm.c0, arm.c1, arm.c2],
    })
}

fn frames_json(frames: Frames) -> Value {
    let Frames { body, wanted_w_m, rotor_thrust_n, world } = frames;
    let steps = [body.step_ns(), wanted_w_m.step_ns(), rotor_thrust_n.step_ns(), world.step_ns()];
    let step_ns = steps.into_iter().max().unwrap_or(body.step_ns());
    let factor = usize::try_from(step_ns / body.step_ns()).unwrap_or(1).max(1);
    let count = body.len().div_ceil(factor);
    json!({
        "step_s": seconds(step_ns),
        "count": count,
        "body": packed(&body.values(step_ns, count)),
        "wanted_w_m": packed(&wanted_w_m.values(step_ns, count)),
        "rotor_thrust_n": packed(&rotor_thrust_n.values(step_ns, count)),
        "world": packed(&world.values(step_ns, count)),
    })
}

fn panel_json(group: &str, panel: &Panel) -> Value {
    let seen = panel.series.iter().filter(|series| !series.envelope.bins().2.is_empty());
    let levels = panel.levels.iter().map(|(name, at)| json!({ "name": name, "at": at }));
    json!({
        "group": group,
        "title": panel.title,
        "unit": panel.unit,
        "log": panel.log,
        "levels": levels.collect::<Value>(),
        "series": seen.map(series_json).collect::<Value>(),
    })
}

fn series_json(series: &Series) -> Value {
    let (origin_ns, width_ns, bins) = series.envelope.bins();
    let side = |i: usize| packed(&bins.iter().map(|bin| bin[i]).collect::<Vec<f32>>());
    let mut json = json!({
        "name": series.name,
        "colour": colour(series.colour),
        "dash": match series.dash {
            Dash::Solid => json!([]),
            Dash::Dashed => json!([6, 4]),
            Dash::Dotted => json!([2, 3]),
            Dash::DashDot => json!([6, 3, 2, 3]),
        },
        "is_bound": series.is_bound,
        "from_s": seconds(origin_ns),
        "width_s": seconds(width_ns),
        "least": side(0),
    });
    if series.envelope.is_merged() {
        json["greatest"] = side(1).into();
    }
    json
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

fn loop_json(stats: &LoopStats) -> Value {
    json!({
        "name": stats.role.label(),
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

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}
