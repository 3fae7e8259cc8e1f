//! Every number of a report, judged.

use super::observe::Observed;
use crate::record::Clock;
use crate::record::read::{Closing, RecordedFlight};
use crate::run::{Effort, LOST_M, Metrics};
use crate::scenario::{Override, Scenario};
use crate::trace;
use crate::view::Gathered;
use serde::Serialize;
use shared_types::GateMode;

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
    /// What it must be; empty if it is only told.
    pub gate: &'static str,
    /// Whether it is.
    pub holds: Option<bool>,
    /// Computes it again.
    pub command: String,
}

/// Collects numbers of one section after the other.
struct Numbers {
    section: &'static str,
    command: String,
    all: Vec<Number>,
}

impl Numbers {
    fn section(&mut self, section: &'static str, command: &str) {
        self.section = section;
        command.clone_into(&mut self.command);
    }

    fn add(
        &mut self,
        (key, name): (&'static str, &'static str),
        value: String,
        gate: Option<(&'static str, bool)>,
    ) {
        let (section, command) = (self.section, self.command.clone());
        let (gate, holds) = gate.map_or(("", None), |(gate, holds)| (gate, Some(holds)));
        self.all.push(Number { section, key, name, value, gate, holds, command });
    }

    fn tell(&mut self, names: (&'static str, &'static str), value: String) {
        self.add(names, value, None);
    }

    /// A count that must be zero.
    fn none(&mut self, names: (&'static str, &'static str), count: u64) {
        self.add(names, count.to_string(), Some(("0", count == 0)));
    }
}

/// All of them, in the order told.
pub(super) fn numbers(
    flight: &RecordedFlight,
    gathered: &Gathered,
    observed: &Observed,
    latency: &trace::Report,
) -> Vec<Number> {
    let file = flight.path().display();
    let mut numbers = Numbers { section: "", command: String::new(), all: Vec::new() };
    let again = format!("morphquad report {file}");
    numbers.section("flight", &again);
    of_flight(flight, gathered, observed, &mut numbers);
    numbers.section("constraints", &again);
    of_constraints(gathered, observed, &mut numbers);
    numbers.section("timing", &again);
    of_timing(flight, observed, &mut numbers);
    of_commands(gathered, &observed.metrics, &mut numbers);
    numbers.section("latency", &format!("morphquad trace {file}"));
    of_latency(latency, &mut numbers);
    numbers.section("recording", &format!("morphquad replay {file} --hash"));
    of_recording(gathered, observed, &mut numbers);
    numbers.all
}

/// The command that flies it again: by name if it is a shipped scenario with at most another seed.
pub(super) fn flown_again(flight: &RecordedFlight, closing: &Closing) -> String {
    let settings = &flight.scenario().settings().scenario;
    let seed = format!("scenario.seed={}", settings.seed);
    let realtime = matches!(flight.clock(), Clock::Realtime { .. });
    let clock = if realtime { "realtime" } else { "lockstep" };
    let clock = format!("scenario.clock=\"{clock}\"");
    let overrides = [Override::set(&seed), Override::set(&clock)];
    let overrides: Result<Vec<_>, _> = overrides.into_iter().collect();
    let shipped = overrides.ok().and_then(|all| Scenario::load(&settings.name, &all).ok());
    let is_shipped =
        shipped.is_some_and(|shipped| shipped.to_toml() == flight.scenario().to_toml());
    if is_shipped && flight.branched().is_none() {
        let clock = if realtime { " --clock realtime" } else { "" };
        return format!("morphquad run {} --seed {}{clock}", settings.name, settings.seed);
    }
    if closing.has_holes() {
        return "nothing, for the file has holes".to_owned();
    }
    format!("morphquad replay {} --verify", flight.path().display())
}

fn mm(metres: f64) -> String {
    format!("{:.1} mm", metres * 1e3)
}

fn of_flight(
    flight: &RecordedFlight,
    gathered: &Gathered,
    observed: &Observed,
    numbers: &mut Numbers,
) {
    let metrics = &observed.metrics;
    let told = gathered.closing.summary.get("outcome").cloned();
    let outcome = told.unwrap_or_else(|| {
        let until_s = gathered.span_ns.1 as f64 * 1e-9;
        format!("unknown: the file ends at {until_s:.3} s, {}", gathered.closing)
    });
    let good = outcome == "flown";
    numbers.add(("outcome", "outcome"), outcome, Some(("flown", good)));
    let planned_s = flight.scenario().duration_ns() as f64 * 1e-9;
    let flown_s = gathered.closing.summary.get("flown_s").cloned();
    let flown_s = flown_s.unwrap_or_else(|| format!("{:.3}", gathered.span_ns.1 as f64 * 1e-9));
    numbers.tell(("flown_s", "flown"), format!("{flown_s} s of {planned_s:.3} s"));
    let tracking = metrics.tracking();
    if tracking.samples > 0 {
        numbers.tell(("position_rms_m", "tracking error, rms"), mm(tracking.rms_m));
        let gate = Some(("at most 1 m", tracking.max_m <= LOST_M));
        numbers.add(("position_max_m", "tracking error, largest"), mm(tracking.max_m), gate);
        let off = tracking.last_second_m;
        let gate = Some(("at most 1 m", off <= LOST_M));
        numbers.add(("position_last_second_m", "error in the last second, mean"), mm(off), gate);
    }
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
        numbers.add(names, value, Some(("settled at the end", response.settling_s.is_some())));
    }
    numbers.tell(
        ("tilt_max_deg", "largest tilt"),
        format!("{:.1}°", metrics.tilt_max_rad().to_degrees()),
    );
    let wind = gathered.uses.wind_max_m_s;
    numbers.tell(("wind_max_m_s", "strongest wind"), format!("{wind:.2} m/s"));
    let cut = metrics.gate().mode == GateMode::Cut;
    let rotors = if cut { "cut" } else { "on" };
    numbers.add(("rotors", "rotors at the end"), rotors.to_owned(), Some(("on", !cut)));
}

fn of_constraints(gathered: &Gathered, observed: &Observed, numbers: &mut Numbers) {
    let metrics = &observed.metrics;
    let Effort { steps, violations, worst_violation, relaxed, yielded, unsolved, most_iterations } =
        metrics.effort();
    numbers.none(("constraint_violations", "commands outside their bounds"), violations);
    numbers.tell(("controller_steps", "of controller steps"), steps.to_string());
    // Below the tolerance it is rounding.
    numbers.tell(
        ("worst_violation", "furthest outside, rounding included"),
        format!("{:.1e}", worst_violation.max(0.0)),
    );
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let uses = &gathered.uses;
    let names = [
        ("torque_use_roll", "most of the bound on the torque used, roll"),
        ("torque_use_pitch", "most of the bound on the torque used, pitch"),
        ("torque_use_yaw", "most of the bound on the torque used, yaw"),
    ];
    for (names, share) in names.into_iter().zip(uses.torque) {
        numbers.tell(names, percent(share));
    }
    let names = [
        ("increment_use_roll", "most of the bound on its increment, roll"),
        ("increment_use_pitch", "most of the bound on its increment, pitch"),
        ("increment_use_yaw", "most of the bound on its increment, yaw"),
    ];
    for (names, share) in names.into_iter().zip(uses.increment) {
        numbers.tell(names, percent(share));
    }
    numbers.tell(("thrust_use", "most of the bound on the thrust used"), percent(uses.thrust));
    numbers.tell(("tilt_use", "most of the bound on the tilt used"), percent(uses.tilt));
    numbers.tell(("rotor_use", "most of a rotor's largest thrust used"), percent(uses.rotor));
    numbers.tell(("relaxed_steps", "steps with a relaxed increment bound"), relaxed.to_string());
    numbers.tell(("yielded_steps", "steps that left a soft bound"), yielded.to_string());
    numbers.tell(("unsolved_steps", "steps without a solved optimum"), unsolved.to_string());
    numbers.tell(("most_iterations", "most iterations in a step"), most_iterations.to_string());
    numbers.tell(
        ("clipped_share", "ticks with clipped rotors"),
        format!("{:.2} %", 100.0 * metrics.clipped_share()),
    );
}

fn of_timing(flight: &RecordedFlight, observed: &Observed, numbers: &mut Numbers) {
    let metrics = &observed.metrics;
    let loops = metrics.loops();
    let stats = || loops.iter();
    let missed = stats().map(|s| s.skipped + s.input_deadline_misses).sum::<u64>();
    let late = stats().map(|s| s.late_samples).sum::<u64>();
    let unseen = stats().map(|s| s.lost_samples).sum::<u64>();
    // Whoever kills a process on purpose wants to see what it costs.
    let unharmed = flight.scenario().settings().fault.is_empty();
    if flight.clock() == Clock::Lockstep && unharmed {
        numbers.none(("missed_ticks", "missed deadlines and skipped releases"), missed);
        numbers.none(("late_samples", "samples after their step"), late);
    } else {
        numbers.tell(("missed_ticks", "missed deadlines and skipped releases"), missed.to_string());
        numbers.tell(("late_samples", "samples after their step"), late.to_string());
    }
    numbers.tell(("unseen_samples", "samples that a loop never saw"), unseen.to_string());
    let names = ("safe_mode_episodes", "safe-mode episodes");
    let episodes = metrics.gate().safe_mode_episodes;
    if unharmed {
        numbers.none(names, episodes);
    } else {
        numbers.tell(names, episodes.to_string());
    }
    let restarts = stats().map(|s| s.generation).sum::<u64>().to_string();
    numbers.tell(("restarts", "processes started again"), restarts);
}

/// Who commanded: where a file is cut, up to where nothing about a tick is missing.
fn of_commands(gathered: &Gathered, metrics: &Metrics, numbers: &mut Numbers) {
    let complete = gathered.closing.complete;
    let commands = if complete { metrics.commands() } else { metrics.settled_commands() };
    numbers.none(("wrong_owner_ticks", "ticks commanded by a wrong owner"), commands.wrong_owner);
    numbers.none(("duplicated_ticks", "ticks with two commands"), commands.duplicated);
    numbers.tell(("missed_commands", "ticks without a valid command"), commands.missed.to_string());
}

fn of_latency(latency: &trace::Report, numbers: &mut Numbers) {
    let value = format!("{} of {}", latency.traced, latency.commands);
    let names = ("traced", "commands traced to their sensor");
    numbers.add(names, value, Some(("all", latency.untraced.is_empty() && latency.commands > 0)));
    let place = trace::SEGMENTS.iter().position(|s| s.key == "sensor_to_command");
    if let Some(figures) = place.and_then(|place| latency.segments.get(place)) {
        let us = |ns: u64| format!("{} µs", crate::figure::us(ns as f64 * 1e-3));
        numbers.tell(("latency_p50", "sensor due to command sent, median"), us(figures.p50_ns));
        numbers.tell(("latency_p99", "sensor due to command sent, 99 %"), us(figures.p99_ns));
        numbers.tell(("latency_p999", "sensor due to command sent, 99.9 %"), us(figures.p999_ns));
        numbers.tell(("latency_max", "sensor due to command sent, slowest"), us(figures.max_ns));
    }
    let age = latency.age.max_ns as f64 * 1e-6;
    numbers.tell(
        ("age_max", "oldest sensor sample behind a command, in logical time"),
        format!("{age:.3} ms"),
    );
}

fn of_recording(gathered: &Gathered, observed: &Observed, numbers: &mut Numbers) {
    numbers.tell(("samples", "samples in the file"), observed.samples().to_string());
    let (gaps, named) = observed.gaps();
    let named = if gaps == 0 { "0".to_owned() } else { named };
    numbers.add(("gaps", "samples and states lost"), named, Some(("0", gaps == 0)));
    let stored = |key: &str| gathered.closing.summary.get(key);
    for (names, key, hash) in [
        (("hash", "flight hash"), "hash", &observed.flight_hash),
        (("log_hash", "hash of all samples"), "log_hash", &observed.log_hash),
    ] {
        let gate = stored(key).map(|stored| ("as the flight had it", stored == hash));
        numbers.add(names, hash.clone(), gate);
    }
}

/// Pass or fail, and why.
pub(super) fn sentence(
    scenario: &str,
    numbers: &[Number],
    observed: &Observed,
    latency: &trace::Report,
) -> String {
    let failed: Vec<_> = numbers.iter().filter(|number| number.holds == Some(false)).collect();
    if !failed.is_empty() {
        let told = failed.iter().map(|n| format!("{}: {} (gate: {})", n.name, n.value, n.gate));
        return format!("FAIL: {scenario}: {}.", told.collect::<Vec<_>>().join("; "));
    }
    let metrics = &observed.metrics;
    let samples = observed.samples();
    let tracking = metrics.tracking();
    let flown = match (tracking.samples, metrics.step_response()) {
        (1.., _) => format!("stayed within {} of its path", mm(tracking.max_m)),
        (_, Some(axes)) => {
            let worst = axes.iter().map(|a| a.final_error_rad.abs()).fold(0.0, f64::max);
            format!("ended {worst:.1e} rad from its set point")
        }
        _ => "was flown".to_owned(),
    };
    format!(
        "PASS: {scenario} {flown}, kept every bound in {} controller steps, lost none of {samples} samples, \
         and all {} commands trace to their sensor.",
        metrics.effort().steps,
        latency.commands
    )
}
