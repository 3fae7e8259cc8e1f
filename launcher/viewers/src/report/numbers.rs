//! Every number of a report, judged.

use super::observe::Observed;
use crate::trace;
use crate::view::Gathered;
use ::verdict::CHECKS;
use observe::Effort;
use record::Clock;
use record::read::{Closing, RecordedFlight};
use scenario::{Override, Scenario};
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
    /// What it must be; empty if it is only told.
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

    fn tell(&mut self, names: (&'static str, &'static str), value: String) {
        self.add(names, value, None);
    }

    /// A number that the verdict rests on, with its limit.
    fn judged(&mut self, names: (&'static str, &'static str), value: String, key: &str) {
        let verdict = self.observed.verdict();
        let check = CHECKS.iter().find(|check| check.key == key);
        let gate = check.zip(verdict.thresholds().limit(key)).map(|(check, limit)| {
            let holds =
                verdict.reasons().iter().all(|reason| reason.key != key || verdict.passed());
            let gate = if limit > 0.0 {
                format!("at most {}", check.unit.tell(limit))
            } else {
                "0".to_owned()
            };
            (gate, holds)
        });
        self.add(names, value, gate);
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
    let mut numbers = Numbers { observed, section: "", command: String::new(), all: Vec::new() };
    let again = format!("morphquad report {file}");
    numbers.section("flight", &again);
    of_flight(flight, gathered, observed, &mut numbers);
    numbers.section("constraints", &again);
    of_constraints(gathered, observed, &mut numbers);
    numbers.section("timing", &again);
    of_timing(observed, &mut numbers);
    of_commands(observed, &mut numbers);
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
    numbers: &mut Numbers<'_>,
) {
    let metrics = &observed.metrics;
    numbers.tell(("ended", "ended"), observe::told_end(&observed.outcome.end));
    let planned_s = flight.scenario().duration_ns() as f64 * 1e-9;
    let flown_s = gathered.closing.summary.get("flown_s").cloned();
    let flown_s = flown_s.unwrap_or_else(|| format!("{:.3}", gathered.span_ns.1 as f64 * 1e-9));
    numbers.tell(("flown_s", "flown"), format!("{flown_s} s of {planned_s:.3} s"));
    if let Some(tracking) = observed.outcome.tracking {
        numbers.tell(("position_rms_m", "tracking error, rms"), mm(metrics.tracking().rms_m));
        let names = ("position_max_m", "tracking error, largest");
        numbers.judged(names, mm(tracking.max_m), "tracking_max_m");
        let names = ("position_sustained_m", "tracking error, largest mean over a second");
        numbers.judged(names, mm(tracking.sustained_m), "tracking_sustained_max_m");
        let names = ("position_recovering_m", "tracking error, largest during a recovery");
        numbers.judged(names, mm(tracking.recovering_m), "recovery_max_m");
        let heading = format!("{:.3} rad", tracking.heading_rad);
        numbers.judged(("heading_max_rad", "heading error, largest"), heading, "heading_max_rad");
        let names = ("position_last_second_m", "error in the last second, mean");
        numbers.judged(names, mm(tracking.end_m), "lost_m");
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
        numbers.tell(names, value);
    }
    if let Some(turned_rad) = observed.outcome.turned_rad {
        let names = ("attitude_end_rad", "error of an angle at the end, largest");
        numbers.judged(names, format!("{turned_rad:.4} rad"), "attitude_end_max_rad");
    }
    let tilt = format!("{:.3} rad", observed.outcome.tilt_rad);
    numbers.judged(("tilt_max_rad", "largest tilt"), tilt, "tilt_max_rad");
    let contact = format!("{:.3} s", observed.outcome.contact.total_s);
    numbers.judged(
        ("contact_s", "time on the ground where its path is not"),
        contact,
        "contact_max_s",
    );
    let wind = gathered.uses.wind_max_m_s;
    numbers.tell(("wind_max_m_s", "strongest wind"), format!("{wind:.2} m/s"));
    let cut = format!("{:.3} s", observed.outcome.cut_s);
    numbers.judged(("rotors_cut_s", "time with the rotors cut"), cut, "cut_max_s");
}

fn of_constraints(gathered: &Gathered, observed: &Observed, numbers: &mut Numbers<'_>) {
    let metrics = &observed.metrics;
    let Effort { steps, violations, worst_violation, relaxed, yielded, unsolved, most_iterations } =
        metrics.effort();
    let names = ("constraint_violations", "commands outside their bounds");
    numbers.judged(names, violations.to_string(), "violations_max");
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
    let share = format!("{:.2} %", 100.0 * observed.outcome.unsolved.share);
    let names = ("unsolved_share", "such steps, of the controller with most");
    numbers.judged(names, share, "unsolved_max_share");
    numbers.tell(("most_iterations", "most iterations in a step"), most_iterations.to_string());
    let clipping = observed.outcome.clipping;
    let share = format!("{:.2} %", 100.0 * clipping.share);
    numbers.judged(("clipped_share", "ticks with clipped rotors"), share, "clipped_max_share");
    let longest = format!("{:.3} s", clipping.longest_s);
    numbers.judged(("clipped_s", "longest stretch with clipped rotors"), longest, "clipped_max_s");
}

fn of_timing(observed: &Observed, numbers: &mut Numbers<'_>) {
    let loops = observed.metrics.loops();
    let stats = || loops.iter();
    let outcome = &observed.outcome;
    let missed = stats().map(|s| s.skipped + s.input_deadline_misses).sum::<u64>();
    let late = stats().map(|s| s.late_samples).sum::<u64>();
    let unseen = stats().map(|s| s.lost_samples).sum::<u64>();
    numbers.tell(("missed_ticks", "missed deadlines and skipped releases"), missed.to_string());
    let of_worst = |misses: &::verdict::Misses| match misses.of.as_str() {
        "" => "0 %".to_owned(),
        of => format!("{:.2} % of {of}", 100.0 * misses.share),
    };
    let names = ("missed_share", "the same, of the loop that missed most");
    numbers.judged(names, of_worst(&outcome.missed), "missed_max_share");
    numbers.tell(("late_samples", "samples after their step"), late.to_string());
    let names = ("late_share", "the same, of the loop that got most");
    numbers.judged(names, of_worst(&outcome.late), "late_max_share");
    numbers.tell(("unseen_samples", "samples that a loop never saw"), unseen.to_string());
    let safe_mode = outcome.safe_mode;
    let names = ("safe_mode_episodes", "safe-mode episodes that nothing explains");
    numbers.judged(names, safe_mode.unexplained.to_string(), "safe_mode_max");
    let names =
        ("safe_mode_explained", "those that a fault, a trip or the loss of a process explains");
    numbers.tell(names, safe_mode.explained.to_string());
    let longest = format!("{:.3} s", safe_mode.longest_s);
    numbers.judged(("safe_mode_s", "longest safe-mode episode"), longest, "safe_mode_max_s");
    let restarts = stats().map(|s| s.generation).sum::<u64>().to_string();
    numbers.tell(("restarts", "processes started again"), restarts);
}

/// Who commanded: where a file is cut, up to where nothing about a tick is missing.
fn of_commands(observed: &Observed, numbers: &mut Numbers<'_>) {
    let (outcome, commands) = (&observed.outcome, observed.metrics.commands());
    let names = ("wrong_owner_ticks", "ticks commanded by a wrong owner");
    numbers.judged(names, outcome.wrong_owner.to_string(), "wrong_owner_max");
    let names = ("duplicated_ticks", "ticks with two commands");
    numbers.judged(names, outcome.duplicated.to_string(), "duplicated_max");
    numbers.tell(("missed_commands", "ticks without a valid command"), commands.missed.to_string());
}

fn of_latency(latency: &trace::Report, numbers: &mut Numbers<'_>) {
    let value = format!("{} of {}", latency.traced, latency.commands);
    numbers.tell(("traced", "commands traced to their sensor"), value);
    let place = trace::SEGMENTS.iter().position(|s| s.key == "sensor_to_command");
    if let Some(figures) = place.and_then(|place| latency.segments.get(place)) {
        let us = |ns: u64| format!("{} µs", figures::figure::us(ns as f64 * 1e-3));
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

fn of_recording(gathered: &Gathered, observed: &Observed, numbers: &mut Numbers<'_>) {
    numbers.tell(("samples", "samples in the file"), observed.samples().to_string());
    let (gaps, named) = observed.gaps();
    let named = if gaps == 0 { "0".to_owned() } else { named };
    numbers.judged(("gaps", "samples and states lost"), named, "dropped_max");
    let stored = |key: &str| gathered.closing.summary.get(key);
    for (names, key, hash) in [
        (("hash", "flight hash"), "hash", &observed.flight_hash),
        (("log_hash", "hash of all samples"), "log_hash", &observed.log_hash),
    ] {
        let gate = stored(key).map(|stored| ("as the flight had it".to_owned(), stored == hash));
        numbers.add(names, hash.clone(), gate);
    }
}
