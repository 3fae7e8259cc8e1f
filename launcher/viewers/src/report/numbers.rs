//! Every number of a report, judged.

use super::observe::Observed;
use crate::trace;
use crate::view::Gathered;
use ::verdict::CHECKS;
use document::shell_path;
use observe::{Fact, Part, kept_hash};
use record::Clock;
use record::read::{Closing, RecordedFlight};
use scenario::{Override, Scenario, shipped};
use serde::Serialize;

/// One number with what it is measured by.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Number {
    /// Part of the report that it belongs to.
    pub section: &'static str,
    /// Name for machines.
    pub key: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// With its unit.
    pub value: String,
    /// What it must be; empty if it is only reported.
    pub gate: String,
    /// Whether it is.
    pub holds: Option<bool>,
    /// Computes it again.
    pub command: String,
}

/// Collects numbers of one section after the other.
struct Numbers<'a> {
    observed: &'a Observed,
    section: &'static str,
    command: String,
    all: Vec<Number>,
}

impl Numbers<'_> {
    fn section(&mut self, section: &'static str, command: &str) {
        self.section = section;
        command.clone_into(&mut self.command);
    }

    fn add(
        &mut self,
        (key, name): (&'static str, &'static str),
        value: String,
        gate: Option<(String, bool)>,
    ) {
        let (section, command) = (self.section, self.command.clone());
        let (gate, holds) = gate.map_or((String::new(), None), |(gate, holds)| (gate, Some(holds)));
        self.all.push(Number { section, key, name, value, gate, holds, command });
    }

    fn report(&mut self, names: (&'static str, &'static str), value: String) {
        self.add(names, value, None);
    }

    /// Every fact of a part, with the limit of the check that judges it.
    fn facts(&mut self, part: Part) {
        for (fact, value) in self.observed.facts.iter().filter(|(fact, _)| fact.part == part) {
            let gate = fact.check.and_then(|key| self.gate(key));
            self.add((fact.key, fact.name), self.describe(fact, value), gate);
        }
    }

    /// A fact as text, with when or where it was so from its check.
    fn describe(&self, fact: &Fact, value: f64) -> String {
        let check = CHECKS.iter().find(|check| Some(check.key) == fact.check && value > 0.0);
        let detail = check.map(|check| (check.detail)(&self.observed.outcome));
        fact.text_with_unit(value) + &detail.unwrap_or_default()
    }

    /// The limit of a check, and whether it is kept.
    fn gate(&self, key: &str) -> Option<(String, bool)> {
        let verdict = self.observed.verdict();
        let check = CHECKS.iter().find(|check| check.key == key)?;
        let limit = verdict.thresholds().limit(key)?;
        let holds = verdict.reasons().iter().all(|reason| reason.key != key || verdict.passed());
        let gate = if limit > 0.0 {
            format!("at most {}", check.unit.text(limit))
        } else {
            "0".to_owned()
        };
        Some((gate, holds))
    }
}

/// All of them, in the order shown.
pub(super) fn numbers(
    flight: &RecordedFlight,
    gathered: &Gathered,
    observed: &Observed,
    latency: &trace::Report,
) -> Vec<Number> {
    let file = shell_path(flight.path());
    let mut numbers = Numbers { observed, section: "", command: String::new(), all: Vec::new() };
    let again = format!("morphquad report {file}");
    numbers.section("flight", &again);
    of_flight(flight, gathered, observed, &mut numbers);
    numbers.section("constraints", &again);
    of_constraints(gathered, observed, &mut numbers);
    numbers.section("timing", &again);
    numbers.facts(Part::Timing);
    numbers.section("latency", &format!("morphquad trace {file}"));
    of_latency(latency, &mut numbers);
    numbers.section("recording", &format!("morphquad replay {file} --hash"));
    of_recording(gathered, observed, &mut numbers);
    numbers.all
}

/// The command that flies it again: by name if it is a shipped scenario with at most another seed, to which nothing was
/// ordered in flight.
pub(super) fn flown_again(flight: &RecordedFlight, closing: &Closing) -> String {
    if flight.branched().is_some() {
        return "nothing, for it is a branch of another recording".to_owned();
    }
    if flight.continued().is_some() {
        return "nothing, for it begins in the middle of a flight".to_owned();
    }
    let settings = &flight.scenario().settings().scenario;
    let seed = format!("scenario.seed={}", settings.seed);
    let realtime = matches!(flight.clock(), Clock::Realtime { .. });
    let clock = if realtime { "realtime" } else { "lockstep" };
    let clock = format!("scenario.clock=\"{clock}\"");
    let overrides = [Override::set(&seed), Override::set(&clock)];
    let overrides: Result<Vec<_>, _> = overrides.into_iter().collect();
    let text = shipped::text(&settings.name);
    let shipped = text.zip(overrides.ok());
    let shipped =
        shipped.and_then(|(text, all)| Scenario::from_text(&settings.name, text, &all).ok());
    let is_shipped =
        shipped.is_some_and(|shipped| shipped.to_toml() == flight.scenario().to_toml());
    let is_empty = |key: &str| closing.summary.get(key).is_none_or(|list| list == "[]");
    if is_shipped && is_empty("orders") && is_empty("swaps") {
        let clock = if realtime { " --clock realtime" } else { "" };
        return format!("morphquad run {} --seed {}{clock}", settings.name, settings.seed);
    }
    if closing.has_holes() {
        return "nothing, for the file has holes".to_owned();
    }
    format!("morphquad replay {} --verify", shell_path(flight.path()))
}

fn of_flight(
    flight: &RecordedFlight,
    gathered: &Gathered,
    observed: &Observed,
    numbers: &mut Numbers<'_>,
) {
    let metrics = &observed.metrics;
    numbers.report(("ended", "ended"), observe::describe_end(&observed.outcome.end));
    let planned_s = flight.scenario().duration_ns() as f64 * 1e-9;
    numbers.report(("planned_s", "planned"), format!("{planned_s:.3} s"));
    numbers.facts(Part::Flight);
    for (axis, response) in
        ["roll", "pitch", "yaw"].iter().zip(metrics.step_response().into_iter().flatten())
    {
        let settled = response.settling_s.map_or("never".to_owned(), |s| format!("{s:.3} s"));
        let value = format!(
            "settled {settled}, peak {:.4} rad, at the end {:.1e} rad off",
            response.peak_rad, response.final_error_rad
        );
        let names = match *axis {
            "roll" => ("roll_step", "step of the roll"),
            "pitch" => ("pitch_step", "step of the pitch"),
            _ => ("yaw_step", "step of the yaw"),
        };
        numbers.report(names, value);
    }
    let wind = gathered.uses.wind_max_m_s;
    numbers.report(("wind_max_m_s", "strongest wind"), format!("{wind:.2} m/s"));
}

fn of_constraints(gathered: &Gathered, observed: &Observed, numbers: &mut Numbers<'_>) {
    numbers.facts(Part::Constraints);
    // Below the tolerance it is rounding.
    let worst = observed.metrics.effort().worst_violation.max(0.0);
    let names = ("worst_violation", "furthest outside a bound, rounding included");
    numbers.report(names, format!("{worst:.1e}"));
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let uses = &gathered.uses;
    let names = [
        ("torque_use_roll", "most of the bound on the torque used, roll"),
        ("torque_use_pitch", "most of the bound on the torque used, pitch"),
        ("torque_use_yaw", "most of the bound on the torque used, yaw"),
    ];
    for (names, share) in names.into_iter().zip(uses.torque) {
        numbers.report(names, percent(share));
    }
    let names = [
        ("increment_use_roll", "most of the bound on its increment, roll"),
        ("increment_use_pitch", "most of the bound on its increment, pitch"),
        ("increment_use_yaw", "most of the bound on its increment, yaw"),
    ];
    for (names, share) in names.into_iter().zip(uses.increment) {
        numbers.report(names, percent(share));
    }
    numbers.report(("thrust_use", "most of the bound on the thrust used"), percent(uses.thrust));
    numbers.report(("tilt_use", "most of the bound on the tilt used"), percent(uses.tilt));
    numbers.report(("rotor_use", "most of a rotor's largest thrust used"), percent(uses.rotor));
}

fn of_latency(latency: &trace::Report, numbers: &mut Numbers<'_>) {
    let value = format!("{} of {}", latency.traced, latency.commands);
    numbers.report(("traced", "commands traced to their sensor"), value);
    let place = trace::SEGMENTS.iter().position(|s| s.key == "sensor_to_command");
    if let Some(figures) = place.and_then(|place| latency.segments.get(place)) {
        let us = |ns: u64| format!("{} µs", figures::figure::us(ns as f64 * 1e-3));
        numbers.report(("latency_p50", "sensor due to command sent, median"), us(figures.p50_ns));
        numbers.report(("latency_p99", "sensor due to command sent, 99 %"), us(figures.p99_ns));
        numbers.report(("latency_p999", "sensor due to command sent, 99.9 %"), us(figures.p999_ns));
        numbers.report(("latency_max", "sensor due to command sent, slowest"), us(figures.max_ns));
    }
    let age = latency.age.max_ns as f64 * 1e-6;
    numbers.report(
        ("age_max", "oldest sensor sample behind a command, in logical time"),
        format!("{age:.3} ms"),
    );
}

fn of_recording(gathered: &Gathered, observed: &Observed, numbers: &mut Numbers<'_>) {
    numbers.report(("samples", "samples in the file"), observed.samples().to_string());
    let stored = |key: &str| kept_hash(&gathered.closing.summary, key);
    for (names, key, hash) in [
        (("hash", "flight hash"), "hash", &observed.flight_hash),
        (("log_hash", "hash of all samples"), "log_hash", &observed.log_hash),
    ] {
        let gate = stored(key).map(|kept| ("as the flight had it".to_owned(), kept == hash));
        numbers.add(names, hash.clone(), gate);
    }
}
