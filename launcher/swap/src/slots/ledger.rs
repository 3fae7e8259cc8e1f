//! What came of each swap, for the summary, its JSON and the recording.

use super::gatekeeper::Gatekeeper;
use serde::Serialize;
use shared_types::Slot;
use shared_types::time::s_from_ns;
use slot::gate::GateFigures;
use std::fmt::{self, Write as _};

/// How a swap ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SwapEnd {
    /// It had not when the flight did.
    #[default]
    Open,
    /// The candidate did what was asked of it, and has kept what it was given.
    Kept,
    /// The candidate never commanded: it was refused, or failed before.
    Refused,
    /// The candidate has lost the slot, by a fault of its own or a trip.
    TakenBack,
    /// The user ended it, or a fault that is part of the script.
    Withdrawn,
}

/// One request to change which process commands a slot, and what came of it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SwapReport {
    /// `attitude` or `position`.
    pub slot: &'static str,
    /// The program that was to command.
    pub to: String,
    /// The program that commanded before.
    pub from: String,
    /// When it was asked for \[s\].
    pub requested_s: f64,
    /// When the candidate joined \[s\].
    pub joined_s: Option<f64>,
    /// The same kind of controller, which restored its predecessor's state.
    pub same_kind: Option<bool>,
    /// When it began to command \[s\].
    pub flipped_s: Option<f64>,
    /// Epoch since then.
    pub epoch: Option<u64>,
    /// Commands compared one step ahead and running free.
    pub compared: [u64; 2],
    /// Worst disagreement one step ahead and running free, over the largest command.
    pub worst: [f64; 2],
    /// Root mean square of it running free, worst axis.
    pub rms: f64,
    /// What came of flying the candidate ahead, as text; none if that was not called for.
    pub rehearsal: Option<String>,
    /// Difference of the two commands for the instant of the change, as far as it is applied at once,
    /// worst axis over the largest command.
    pub bump: Option<f64>,
    /// How it ended, as text; of one whose candidate has lost the slot since, why.
    pub outcome: String,
    /// It ended as asked for, whatever has become of the candidate since.
    pub done: bool,
    /// How it ended.
    pub ended: SwapEnd,
    /// It was part of the flight's script.
    pub scripted: bool,
}

impl SwapReport {
    /// True if the flight was to show that this swap can be made, and has not.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.scripted && matches!(self.ended, SwapEnd::Refused | SwapEnd::TakenBack)
    }

    pub(super) fn new(slot: Slot, from: &str, to: &str, at_ns: u64, scripted: bool) -> Self {
        Self {
            scripted,
            slot: slot.label(),
            to: to.to_owned(),
            from: from.to_owned(),
            requested_s: s_from_ns(at_ns),
            ..Self::default()
        }
    }

    /// It was refused at once.
    pub(super) fn refuse(&mut self, reason: &dyn fmt::Display) {
        self.outcome = format!("refused: {reason}");
        self.ended = SwapEnd::Refused;
    }

    /// Takes over what was measured.
    pub(super) fn measured(&mut self, gate: &Gatekeeper) {
        let figures: GateFigures = gate.figures();
        let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        self.compared = [figures.tracked, figures.free];
        self.worst = [
            most(&figures.tracking_worst.map(|worst| worst.value)),
            most(&figures.free_worst.map(|worst| worst.value)),
        ];
        self.rms = if figures.free > 0 { most(&figures.free_rms) } else { 0.0 };
        self.bump = gate.bump().map(|bump| most(&bump));
    }
}

/// The swaps as a table, if there were any.
///
/// # Errors
/// If the text cannot be written to.
pub fn write_table(reports: &[SwapReport], out: &mut String) -> fmt::Result {
    if reports.is_empty() {
        return Ok(());
    }
    writeln!(
        out,
        "  {:<9} {:<30} {:>10} {:>10} {:>8} {:>8} {:>8}  outcome",
        "swap", "", "asked s", "flip s", "worst %", "rms %", "bump %",
    )?;
    for report in reports {
        let change = format!("{} -> {}", report.from, report.to);
        let flipped = report.flipped_s.map_or("-".to_owned(), |s| format!("{s:.4}"));
        let bump = report.bump.map_or("-".to_owned(), |bump| format!("{:.4}", 100.0 * bump));
        let worst = 100.0 * report.worst[0].max(report.worst[1]);
        let SwapReport { slot, requested_s, rms, outcome, .. } = report;
        writeln!(
            out,
            "  {slot:<9} {change:<30} {requested_s:>10.4} {flipped:>10} {worst:>8.4} {:>8.4} {bump:>8}  {outcome}",
            100.0 * rms,
        )?;
    }
    Ok(())
}
