//! What the flight achieved, from the samples alone.

use super::command_audit::{CommandAudit, CommandTally};
use super::estimate_log::EstimateLog;
use super::evidence::{Evidence, Rules};
use super::loops::{LoopLedger, Totals};
use super::misses::{MissLog, TIMING};
use super::response::{AxisResponse, StepResponse};
use super::tracking::{Tracker, Tracking};
use hdrhistogram::Histogram;
use record::Severity;
use runtime::seat_of_loop;
use scenario::Scenario;
use shared_types::{
    AppliedCommand, AttitudeReport, AttitudeSetpoint, ControllerReport, Deviation, Disturbance,
    GateMode, Header, LoopStats, OwnerRecord, PositionReport, Reference, Role, Sample, Seating,
    SolveStatus, StateEstimate, Topic, TopicInfo, Truth, WrenchCommand,
};
use std::any::Any;
use std::collections::BTreeMap;
use verdict::Misses;

/// An event that follows from the samples.
#[derive(Debug, Clone)]
pub struct News {
    /// Instant \[ns\].
    pub at_ns: u64,
    /// How bad it is.
    pub severity: Severity,
    /// What it is about.
    pub source: &'static str,
    /// As text.
    pub text: String,
}

/// Largest bound violation that rounding explains.
pub const VIOLATION_TOLERANCE: f64 = 1e-9;
/// Effort and verdicts of one controller.
#[derive(Debug, Clone, Copy, Default)]
pub struct Effort {
    /// Steps reported.
    pub steps: u64,
    /// Steps whose command left its bounds.
    pub violations: u64,
    /// Largest violation, in input units.
    pub worst_violation: f64,
    /// Steps whose increment bound was relaxed because the input bounds shrank.
    pub relaxed: u64,
    /// Steps in which a soft constraint was left.
    pub yielded: u64,
    /// Steps without a solved optimum.
    pub unsolved: u64,
    /// Most iterations in one step.
    pub most_iterations: u64,
}

/// Everything that the summary reports about the flight.
#[derive(Debug, Clone, Default)]
pub struct Metrics {
    tracker: Tracker,
    efforts: BTreeMap<&'static str, Effort>,
    /// By loop and seat.
    compute: BTreeMap<(&'static str, u32), Histogram<u64>>,
    loops: LoopLedger,
    /// Slot, instant \[ns\] and seat of each owner.
    owners: Vec<(Role, u64, u32)>,
    gate: AppliedCommand,
    safe_ticks: u64,
    evidence: Evidence,
    response: Option<StepResponse>,
    misses: MissLog,
    estimates: EstimateLog,
    commands: CommandAudit,
}

impl Metrics {
    /// Metrics that suit a scenario's kind of flight.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        // The pilot of a rig writes attitudes: tracking is of attitude, not position.
        let response = scenario.settings().pilot.is_rig().then(StepResponse::default);
        Self { response, evidence: Evidence::of(scenario), ..Self::default() }
    }

    /// Forgets how the vehicle has flown so far, and not what it is to do: errors, efforts and
    /// clipping are judged from here on. An attitude step is still the whole one.
    pub fn judge_from_here(&mut self) {
        let before = core::mem::take(self);
        let Self { tracker, loops, owners, gate, response, commands, evidence, .. } = before;
        let (tracker, commands, evidence) = (tracker.anew(), commands.anew(), evidence.anew());
        *self =
            Self { tracker, loops, owners, gate, evidence, response, commands, ..Self::default() };
    }

    /// Judges by what another scenario allows, of the same kind of flight.
    pub fn judge_by(&mut self, scenario: &Scenario) {
        self.evidence.judge_by(Rules::of(scenario));
    }

    /// Answer to the last attitude step of a rig flight.
    #[must_use]
    pub fn step_response(&self) -> Option<[AxisResponse; 3]> {
        self.response.as_ref().and_then(StepResponse::axes)
    }

    /// How far the attitude of a rig flight is off its set point, along the worst axis \[rad\].
    pub(super) fn attitude_error_rad(&self) -> Option<f64> {
        self.response.as_ref().map(StepResponse::error_rad)
    }

    /// Takes note of a sample.
    pub fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            self.observe_truth(truth);
        } else if let Some(estimate) = any.downcast_ref::<StateEstimate>() {
            self.time("estimator", estimate);
            self.evidence.estimate(estimate);
            self.estimates.observe(estimate);
        } else if let Some(reference) = any.downcast_ref::<Reference>() {
            self.tracker.observe_reference(reference);
            self.tracker.compare(false, &mut self.evidence);
        } else if let Some(report) = any.downcast_ref::<AttitudeReport>() {
            self.observe_report(&topic.info, report);
        } else if let Some(report) = any.downcast_ref::<PositionReport>() {
            self.observe_report(&topic.info, report);
        } else if let Some(record) = any.downcast_ref::<OwnerRecord>() {
            self.owners.push((record.slot, record.header.valid_ns, record.owner));
            self.commands.record(record);
        } else if let Some(applied) = any.downcast_ref::<AppliedCommand>() {
            self.observe_applied(applied);
        } else if let Some(stats) = any.downcast_ref::<LoopStats>() {
            self.loops.observe(stats);
        } else if let Some(seating) = any.downcast_ref::<Seating>() {
            self.loops.seated(seating);
            self.evidence.seated(seating);
        } else if let Some(deviation) = any.downcast_ref::<Deviation>() {
            self.misses.observe(deviation, self.response.is_some());
        } else if let Some(disturbance) = any.downcast_ref::<Disturbance>() {
            self.evidence.disturbance(disturbance);
        } else if let Some(command) = any.downcast_ref::<WrenchCommand>() {
            self.time("attitude", sample);
            self.commands.command(command);
        } else if let Some(setpoint) = any.downcast_ref::<AttitudeSetpoint>() {
            self.time("position", sample);
            if let Some(response) = &mut self.response {
                response.observe_setpoint(setpoint);
            }
        }
    }

    fn time<T: Sample>(&mut self, name: &'static str, sample: &T) {
        let header = sample.header();
        if header.publish_mono_ns == 0 {
            // Flown without a clock.
            return;
        }
        let compute_ns = header.publish_mono_ns.saturating_sub(header.start_mono_ns);
        let histogram = self.compute.entry((name, header.seat)).or_insert_with(new_histogram);
        histogram.saturating_record(compute_ns.max(1));
    }

    fn observe_truth(&mut self, truth: &Truth) {
        self.time("plant", truth);
        self.evidence.truth(truth);
        if let Some(response) = &mut self.response {
            response.observe_truth(truth);
            return;
        }
        self.tracker.observe_truth(truth);
        self.tracker.compare(false, &mut self.evidence);
    }

    /// True if the controller that published this owned the slot then; a shadow's errors do no harm.
    fn is_owner(&self, slot: Role, header: &Header) -> bool {
        let of_slot = self.owners.iter().rev().filter(|(of, ..)| *of == slot);
        let owner = of_slot.clone().find(|(_, from_ns, _)| *from_ns <= header.valid_ns);
        owner.is_none_or(|(.., seat)| *seat == header.seat)
    }

    fn observe_report<R: ControllerReport>(&mut self, topic: &TopicInfo, report: &R) {
        if !self.is_owner(topic.from, report.header()) {
            return;
        }
        let effort = self.efforts.entry(topic.name).or_default();
        let (violation, solve) = (report.worst_violation(), report.solve());
        effort.steps += 1;
        effort.worst_violation = effort.worst_violation.max(violation);
        effort.violations += u64::from(violation > VIOLATION_TOLERANCE);
        effort.relaxed += u64::from(report.bounded().relaxation.iter().any(|r| *r > 0.0));
        effort.yielded += u64::from(solve.yielded > 0);
        effort.unsolved += u64::from(solve.status != SolveStatus::Solved);
        effort.most_iterations = effort.most_iterations.max(solve.iterations);
    }

    fn observe_applied(&mut self, applied: &AppliedCommand) {
        self.evidence.applied(applied);
        self.safe_ticks += u64::from(applied.mode != GateMode::Normal);
        self.gate = *applied;
        self.commands.applied(applied);
    }

    /// The seats whose commands were applied, tick by tick.
    #[must_use]
    pub fn commands(&self) -> CommandTally {
        self.commands.tally()
    }

    /// The same of the ticks that no record can contradict any more, a second before the last one.
    #[must_use]
    pub fn settled_commands(&self) -> CommandTally {
        self.commands.settled()
    }

    /// Closes the comparison with the reference at the end of the flight.
    pub fn finish(&mut self) {
        self.tracker.finish(&mut self.evidence);
        self.evidence.finish();
    }

    /// Position error against the reference; call [`Metrics::finish`] first.
    #[must_use]
    pub fn tracking(&self) -> Tracking {
        self.tracker.tracking()
    }

    /// The same; none for a rig.
    pub(super) fn tracked(&self) -> Option<Tracking> {
        Some(self.tracking()).filter(|tracking| tracking.samples > 0)
    }

    /// What all loops together counted.
    #[must_use]
    pub fn totals(&self) -> Totals {
        Totals::of(&self.loops())
    }

    /// Efforts by report topic.
    #[must_use]
    pub fn efforts(&self) -> &BTreeMap<&'static str, Effort> {
        &self.efforts
    }

    /// Time from start of step to publication on the seat that these totals are of \[ns\].
    #[must_use]
    pub fn compute(&self, stats: &LoopStats) -> Option<&Histogram<u64>> {
        self.compute.get(&(stats.role.label(), seat_of_loop(stats.header.seat)))
    }

    /// Totals of every seat's loop, whichever process sat there.
    #[must_use]
    pub fn loops(&self) -> Vec<LoopStats> {
        self.loops.seats()
    }

    /// Where deadlines were missed.
    #[must_use]
    pub fn misses(&self) -> &MissLog {
        &self.misses
    }

    /// How long estimates stood on no sensor.
    #[must_use]
    pub fn estimates(&self) -> &EstimateLog {
        &self.estimates
    }

    /// What has not been taken yet.
    pub fn take_news(&mut self) -> Vec<News> {
        let misses = self.misses.take_news().into_iter();
        let misses = misses.map(|(at_ns, text)| News {
            at_ns,
            severity: Severity::Warning,
            source: TIMING,
            text,
        });
        let estimates = self.estimates.take_news().into_iter();
        let source = Role::Estimator.label();
        let estimates =
            estimates.map(|(at_ns, severity, text)| News { at_ns, severity, source, text });
        misses.chain(estimates).collect()
    }

    /// The gate's last sample, its counters included.
    #[must_use]
    pub fn gate(&self) -> &AppliedCommand {
        &self.gate
    }

    pub(super) fn evidence(&self) -> &Evidence {
        &self.evidence
    }

    /// By what the flight is judged.
    pub(super) fn rules(&self) -> &Rules {
        self.evidence.rules()
    }

    /// Commands outside their bounds.
    #[must_use]
    pub fn violations(&self) -> u64 {
        self.effort().violations
    }

    /// Steps without a solved optimum, of the controller with the largest share of them.
    #[must_use]
    pub fn unsolved(&self) -> Misses {
        let by_controller = self.efforts.iter().filter(|(_, effort)| effort.unsolved > 0);
        let misses = by_controller.map(|(topic, effort)| Misses {
            count: effort.unsolved,
            share: effort.unsolved as f64 / effort.steps as f64,
            of: topic.trim_end_matches("_report").to_owned(),
        });
        misses.max_by(|a, b| a.share.total_cmp(&b.share)).unwrap_or_default()
    }

    /// Effort and verdicts of all controllers together.
    #[must_use]
    pub fn effort(&self) -> Effort {
        self.efforts.values().fold(Effort::default(), |all, one| Effort {
            steps: all.steps + one.steps,
            violations: all.violations + one.violations,
            worst_violation: all.worst_violation.max(one.worst_violation),
            relaxed: all.relaxed + one.relaxed,
            yielded: all.yielded + one.yielded,
            unsolved: all.unsolved + one.unsolved,
            most_iterations: all.most_iterations.max(one.most_iterations),
        })
    }

    /// Largest angle between the vehicle's axis and the vertical \[rad\].
    #[must_use]
    pub fn tilt_max_rad(&self) -> f64 {
        self.evidence.tilt_rad()
    }

    /// Share of plant ticks in which rotors were clipped.
    #[must_use]
    pub fn clipped_share(&self) -> f64 {
        self.evidence.clipping().share
    }

    /// Plant ticks in all, with clipped rotors, and outside the gate's normal mode.
    #[must_use]
    pub fn ticks(&self) -> (u64, u64, u64) {
        let (ticks, clipped) = self.evidence.ticks();
        (ticks, clipped, self.safe_ticks)
    }
}

fn new_histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, 60_000_000_000, 3)
        .unwrap_or_else(|_| unreachable!("constant bounds are valid"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::topics;

    #[test]
    fn a_command_outside_its_bounds_is_a_violation_and_so_is_a_nan() {
        let mut metrics = Metrics::default();
        let mut report = AttitudeReport {
            torque_max_b_nm: [1.0; 3],
            torque_increment_max_b_nm: [1.0; 3],
            ..AttitudeReport::default()
        };
        metrics.observe(&topics::ATTITUDE_REPORT, &report);
        report.torque_b_nm[1] = 1.0 + 1e-6;
        report.previous_torque_b_nm[1] = 0.5;
        metrics.observe(&topics::ATTITUDE_REPORT, &report);
        report.torque_b_nm[1] = f64::NAN;
        metrics.observe(&topics::ATTITUDE_REPORT, &report);
        assert_eq!(metrics.efforts()["attitude_report"].violations, 2);
    }
}
