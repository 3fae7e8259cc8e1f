//! The summary of a flight: one screen for people, JSON for machines, metadata for the file.

use ::verdict::{End, Verdict};
use hdrhistogram::Histogram;
use host::exit;
use observe::{
    Closing, CommandTally, ENDED, Effort, FLOWN_NS, HASH_FORM, Metrics, Upkeep, describe_end,
    exit_code, seat_name,
};
use record::{SequenceAudit, name_gaps};
use scenario::orders::OrderReport;
use serde_json::{Map, Value, json};
use shared_types::{ClockMode, Role};
use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::path::PathBuf;
use swap::{SwapReport, write_table};

/// Names of the attitude's axes.
const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// What came of a flight.
#[derive(Debug)]
pub struct Summary {
    /// Name of the run.
    pub run_id: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Clock of the flight.
    pub clock: ClockMode,
    /// Seed of every noise source.
    pub seed: u64,
    /// Logical time at which the flight was taken up, 0 unless it is a branch \[ns\].
    pub from_ns: u64,
    /// Logical time through which every loop is complete \[ns\].
    pub flown_ns: u64,
    /// Logical time planned \[ns\].
    pub planned_ns: u64,
    /// Wall time from start to the last sample \[ns\].
    pub wall_ns: u64,
    /// Loops and their rates \[Hz\].
    pub processes: Vec<(Role, f64)>,
    /// Flight hash: what the vehicle did.
    pub hash: String,
    /// Log hash: every sample.
    pub log_hash: String,
    /// What the samples show.
    pub metrics: Metrics,
    /// Sequence audit of every topic.
    pub audit: SequenceAudit,
    /// Crashes that a restart made good.
    pub recovered: u64,
    /// Changes of the process that commands a slot.
    pub swaps: Vec<SwapReport>,
    /// What was ordered of pilot and injector.
    pub orders: Vec<OrderReport>,
    /// What happened on the way.
    pub notices: Vec<String>,
    /// Why the flight ended before its time, if it crashed.
    pub lost: Option<String>,
    /// The user ended it.
    pub interrupted: bool,
    /// The end was moved forward.
    pub cut_short: bool,
    /// Where the recording is.
    pub recording: Option<PathBuf>,
    /// Why the recording is incomplete.
    pub recording_error: Option<String>,
}

impl Summary {
    /// Exit code: 0 if the flight passed, 1 if not, 3 for an incomplete recording, 4 for a crash, 5 if it passed but a
    /// swap of its script was refused or taken back, 130 for an interrupt.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match exit_code(&self.closing(), &self.verdict()) {
            exit::PASS if self.failed_swaps() > 0 => exit::SWAP_FAILED,
            code => code,
        }
    }

    /// Swaps of its script that were refused or taken back.
    #[must_use]
    pub fn failed_swaps(&self) -> usize {
        self.swaps.iter().filter(|swap| swap.has_failed()).count()
    }

    /// The verdict on the flight.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        self.metrics.judge(&self.closing())
    }

    /// The line that every output about this flight begins with.
    #[must_use]
    pub fn line(&self) -> String {
        self.metrics.line(&self.verdict())
    }

    fn closing(&self) -> Closing {
        let end = match &self.lost {
            Some(reason) => End::Crashed(reason.lines().next().unwrap_or_default().to_owned()),
            None if self.interrupted => End::Interrupted,
            None => End::Planned,
        };
        let gaps = self.audit.gaps();
        let dropped = gaps.iter().map(|(_, gaps)| gaps).sum();
        let unrecorded = self.recording_error.as_ref();
        Closing {
            end,
            flown_ns: self.flown_ns,
            dropped: (dropped, if dropped > 0 { name_gaps(&gaps) } else { String::new() }),
            unrecorded: unrecorded.map(|why| why.lines().next().unwrap_or_default().to_owned()),
            ..Closing::default()
        }
    }

    /// Commands outside their bounds.
    #[must_use]
    pub fn violations(&self) -> u64 {
        self.metrics.violations()
    }

    /// Samples that the recorder took.
    #[must_use]
    pub fn recorded(&self) -> u64 {
        self.audit.samples()
    }

    /// Logical seconds per wall second.
    #[must_use]
    pub fn real_time_factor(&self) -> f64 {
        self.flown_ns.saturating_sub(self.from_ns) as f64 / self.wall_ns.max(1) as f64
    }

    /// Key figures as text, for the recording.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let facts = self.metrics.facts(&self.closing());
        let facts = facts.iter().map(|(fact, value)| (fact.key.to_owned(), fact.text(value)));
        let mut map: BTreeMap<String, String> = facts.collect();
        for (key, value) in self.of_the_run() {
            let text = value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned);
            map.insert(key, text);
        }
        map.insert("verdict".to_owned(), self.line());
        let (key, form) = HASH_FORM;
        map.insert(key.to_owned(), form.to_owned());
        let lists = [
            ("misses", self.metrics.misses().to_json()),
            ("swaps", json!(self.swaps)),
            ("orders", json!(self.orders)),
        ];
        let rows = lists.into_iter().filter(|(key, list)| *key == "misses" || *list != json!([]));
        map.extend(rows.map(|(key, list)| (key.to_owned(), list.to_string())));
        map
    }

    /// What no measurement of the vehicle or its loops shows, by key.
    fn of_the_run(&self) -> Map<String, Value> {
        // To as many digits as are reported.
        let rounded = |value: f64, scale: f64| (value * scale).round() / scale;
        let mut map = Map::new();
        let mut put = |key: &str, value: Value| map.insert(key.to_owned(), value);
        put("hash", self.hash.clone().into());
        put("log_hash", self.log_hash.clone().into());
        put(ENDED, describe_end(&self.closing().end).into());
        put(FLOWN_NS, self.flown_ns.into());
        put("real_time_factor", rounded(self.real_time_factor(), 1e2).into());
        for (name, axis) in AXES.iter().zip(self.metrics.step_response().into_iter().flatten()) {
            let settled =
                axis.settling_s.map_or_else(|| "never".into(), |s| rounded(s, 1e4).into());
            put(&format!("{name}_settling_s"), settled);
            put(&format!("{name}_peak_rad"), rounded(axis.peak_rad, 1e5).into());
            put(&format!("{name}_final_error_rad"), rounded(axis.final_error_rad, 1e9).into());
        }
        let gaps = self.audit.gaps();
        if !gaps.is_empty() {
            put("dropped", name_gaps(&gaps).into());
        }
        put("recorded_samples", self.recorded().into());
        put("recovered_crashes", self.recovered.into());
        map
    }

    /// The summary as one JSON object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let mut object = self.metrics.facts(&self.closing()).to_json();
        object.extend(self.of_the_run());
        object.insert("line".to_owned(), self.line().into());
        object.insert("verdict".to_owned(), json!(self.verdict()));
        object.insert("misses".to_owned(), self.metrics.misses().to_json());
        if self.clock == ClockMode::Realtime {
            let upkeep = Upkeep::of(&self.metrics.loops());
            object.insert("upkeep".to_owned(), upkeep.to_json());
        }
        object.insert("run".to_owned(), self.run_id.clone().into());
        object.insert("scenario".to_owned(), self.scenario.clone().into());
        object.insert("seed".to_owned(), self.seed.into());
        let recording = self.recording.as_ref().map(|p| p.display().to_string());
        object.insert("recording".to_owned(), recording.into());
        object.insert("recording_error".to_owned(), self.recording_error.clone().into());
        object.insert("notices".to_owned(), self.notices.clone().into());
        object.insert("swaps".to_owned(), json!(self.swaps));
        object.insert("orders".to_owned(), json!(self.orders));
        object.into()
    }

    fn write_loops(&self, out: &mut String) -> fmt::Result {
        writeln!(
            out,
            "  {:<12} {:>7} {:>8} {:>8} {:>6} {:>6} {:>24}",
            "loop", "Hz", "steps", "skipped", "missed", "late", "step p50 / p99 / max us"
        )?;
        let loops = self.metrics.loops();
        for (role, rate_hz) in &self.processes {
            for stats in loops.iter().filter(|stats| stats.role == *role) {
                let compute = self.metrics.compute(stats).map(quantiles);
                writeln!(
                    out,
                    "  {:<12} {:>7} {:>8} {:>8} {:>6} {:>6} {:>24}",
                    seat_name(stats),
                    rate_hz,
                    stats.steps,
                    stats.skipped,
                    stats.input_deadline_misses,
                    stats.late_samples,
                    compute.unwrap_or_else(|| "-".to_owned()),
                )?;
            }
        }
        Ok(())
    }

    fn write_flight(&self, out: &mut String) -> fmt::Result {
        let tracking = self.metrics.tracking();
        let (_, _, safe) = self.metrics.ticks();
        let gate = self.metrics.gate();
        if tracking.samples > 0 {
            writeln!(
                out,
                "  tracking     rms {:.1} mm, max {:.1} mm, last second {:.1} mm",
                tracking.rms_m * 1e3,
                tracking.max_m * 1e3,
                tracking.last_second_m * 1e3
            )?;
        }
        for (name, axis) in AXES.iter().zip(self.metrics.step_response().into_iter().flatten()) {
            let settled = axis.settling_s.map_or("never".to_owned(), |s| format!("{s:.3} s"));
            writeln!(
                out,
                "  {name:<12} to {:.3} rad: settled {settled}, peak {:.4} rad, final error {:.1e} rad",
                axis.target_rad, axis.peak_rad, axis.final_error_rad
            )?;
        }
        let Effort { relaxed, yielded, unsolved, .. } = self.metrics.effort();
        writeln!(
            out,
            "  constraints  {} violations, {relaxed} relaxed, {yielded} yielded, {unsolved} unsolved; rotors clipped in {:.2} % of ticks",
            self.violations(),
            100.0 * self.metrics.clipped_share()
        )?;
        writeln!(
            out,
            "  gate         {} safe-mode episodes ({safe} ticks), refused {} not finite, {} out of range, {} wrong owner",
            gate.safe_mode_episodes,
            gate.refused_not_finite,
            gate.refused_out_of_range,
            gate.refused_wrong_owner
        )?;
        let estimates = self.metrics.estimates();
        let (imu, fix) = (estimates.imu_overdue(), estimates.fix_overdue());
        if imu.episodes + fix.episodes > 0 {
            writeln!(
                out,
                "  estimate     {} steps without IMU samples ({} times), {} without pose fixes ({} times)",
                imu.steps, imu.episodes, fix.steps, fix.episodes
            )?;
        }
        let CommandTally { ticks, missed, duplicated, wrong_owner } = self.metrics.commands();
        if !self.swaps.is_empty() || wrong_owner + duplicated > 0 {
            writeln!(
                out,
                "  command      {missed} of {ticks} ticks missed, {duplicated} duplicated, {wrong_owner} of a wrong owner"
            )?;
        }
        Ok(())
    }

    fn write_all(&self, out: &mut String) -> fmt::Result {
        let clock = if self.clock == ClockMode::Realtime { "realtime" } else { "lockstep" };
        let totals = self.metrics.totals();
        let (dropped, dropped_of) = self.closing().dropped;
        let verdict = self.verdict();
        writeln!(out, "{}", self.metrics.line(&verdict))?;
        for reason in verdict.reasons().iter().skip(1) {
            writeln!(out, "  also         {}", reason.text)?;
        }
        writeln!(out, "  run          {}, {clock}, seed {}", self.run_id, self.seed)?;
        let from = match self.from_ns {
            0 => String::new(),
            from_ns => format!(", from {:.3} s on", from_ns as f64 * 1e-9),
        };
        writeln!(
            out,
            "  {:.3} s flown of {:.3} s{from} in {:.2} s ({:.1}x real time)",
            self.flown_ns as f64 * 1e-9,
            self.planned_ns as f64 * 1e-9,
            self.wall_ns as f64 * 1e-9,
            self.real_time_factor()
        )?;
        self.write_flight(out)?;
        writeln!(
            out,
            "  timing       {} missed ticks, {} late samples, {} samples unseen by a loop",
            totals.missed, totals.late, totals.unseen
        )?;
        for (place, missed) in self.metrics.misses().places() {
            writeln!(out, "  missed       {place}: {missed}")?;
        }
        writeln!(out, "  samples      {} taken, {} dropped", self.recorded(), dropped)?;
        if dropped > 0 {
            writeln!(out, "  dropped      {dropped_of}")?;
        }
        self.write_loops(out)?;
        if self.clock == ClockMode::Realtime {
            write!(out, "{}", Upkeep::of(&self.metrics.loops()))?;
        }
        write_table(&self.swaps, out)?;
        for order in &self.orders {
            writeln!(out, "  ordered      at {:.3} s {}", order.at_s, order.sentence())?;
        }
        for notice in &self.notices {
            writeln!(out, "  event        {}", abridged(notice).join("\n               "))?;
        }
        if let Some(reason) = &self.lost {
            writeln!(out, "  lost         {}", reason.replace('\n', "\n               "))?;
        }
        match (&self.recording, &self.recording_error) {
            (_, Some(error)) => writeln!(out, "  recording    INCOMPLETE: {error}")?,
            (Some(path), None) => writeln!(out, "  recording    {}", path.display())?,
            (None, None) => writeln!(out, "  recording    none")?,
        }
        writeln!(out, "hash {}", self.hash)
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = String::new();
        self.write_all(&mut text)?;
        f.write_str(&text)
    }
}

fn quantiles(histogram: &Histogram<u64>) -> String {
    let us = |q: f64| histogram.value_at_quantile(q) as f64 * 1e-3;
    format!("{:.1} / {:.1} / {:.0}", us(0.5), us(0.99), histogram.max() as f64 * 1e-3)
}

/// Lines of a notice that are repeated in the summary: of what a process printed at its end, which was reported when it
/// happened, only how it begins and ends.
fn abridged(notice: &str) -> Vec<&str> {
    let mut lines: Vec<&str> = notice.lines().filter(|line| !line.trim().is_empty()).collect();
    if lines.len() > 4 {
        lines.splice(1..lines.len() - 2, ["  ..."]);
    }
    lines
}
