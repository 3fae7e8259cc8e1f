//! A flight as the page wants it: one JSON object.

use super::collect::{Collect, Frames};
use super::happening::{Happening, Owners, end, winds};
use super::json;
use super::panel::{Panels, Uses};
use crate::report::Observed;
use ::verdict::Verdict;
use observe::LoopLedger;
use record::Clock;
use record::read::{Closing, ReadError, RecordedFlight};
use serde_json::{Value, json};
use shared_types::time::s_from_ns;
use std::collections::BTreeMap;
use std::path::PathBuf;
use thiserror::Error;

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
    loops: LoopLedger,
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
    let most_n = flight.scenario().modelled_vehicle().rotor_thrust_max_n;
    let mut collect = Collect::new(owners, flight.epoch_unix_ns(), flight.clock(), most_n);
    let closing = flight.visit(&mut collect)?;
    collect.finish();
    let Some(span_ns) = collect.span_ns else {
        return Err(ViewError::NothingFlown { path: flight.path().to_owned() });
    };
    let Collect { owners, panels, frames, mut happenings, loops, uses, .. } = collect;
    happenings.extend(owners.happenings);
    let script = &flight.scenario().settings().disturbance_injector.script;
    happenings.extend(winds(script, span_ns.1 as f64 * 1e-9));
    if let Some(script) = flight.scenario().timing() {
        end(&mut happenings, &script, span_ns.1 as f64 * 1e-9);
    }
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
        let observed = Observed::of(flight)?;
        let counted = if closing.summary.is_empty() { observed.summary() } else { closing.summary };
        let (from_ns, to_ns) = span_ns;
        let vehicle = flight.scenario().modelled_vehicle();
        let (from_s, to_s) = (s_from_ns(from_ns), s_from_ns(to_ns));
        let name = flight.path().file_name().map(|name| name.to_string_lossy().into_owned());
        let fact = |key: &str| flight.facts().get(key).cloned().unwrap_or_default();
        let json = json!({
            "format": 1,
            "file": name,
            "title": format!("{} · run {}", fact("scenario"), fact("run_id")),
            "from_s": from_s,
            "to_s": to_s,
            "outcome": outcome(&observed.line(), observed.verdict()),
            "facts": facts(flight, &counted),
            "vehicle": json::vehicle(&vehicle),
            "frames": json::frames(&frames, 0, false),
            "charts": json::charts(&panels),
            "events": json!(happenings),
            "loops": json::loops(&loops.seats()),
        });
        Ok(Self { json })
    }

    /// As the page reads it.
    #[must_use]
    pub fn to_json(&self) -> &Value {
        &self.json
    }
}

/// The verdict: a word for the colour, a sentence, and everything for machines.
fn outcome(line: &str, verdict: &Verdict) -> Value {
    json!({ "is_good": verdict.passed(), "text": line, "verdict": verdict })
}

/// Names and values for people.
fn facts(flight: &RecordedFlight, counted: &BTreeMap<String, String>) -> Value {
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
    let entries = shown.into_iter().filter_map(|(key, name)| Some((name, counted.get(key)?)));
    facts.extend(entries.map(|(name, value)| (name, value.clone())));
    json!(facts)
}
