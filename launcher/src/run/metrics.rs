//! What the flight achieved, from the samples alone.

use super::misses::MissLog;
use super::response::{AxisResponse, StepResponse};
use crate::scenario::Scenario;
use hdrhistogram::Histogram;
use shared_types::{
    AppliedCommand, AttitudeSetpoint, ControllerReport, Deviation, GateMode, LoopStats, Reference,
    Role, Sample, SolveStatus, StateEstimate, Topic, Truth, WrenchCommand,
};
use std::any::Any;
use std::collections::{BTreeMap, VecDeque};

/// Largest bound violation that rounding explains.
pub const VIOLATION_TOLERANCE: f64 = 1e-9;
/// Mean distance from the path in the last second from which a vehicle counts as lost \[m\]: its own
/// size and more, far beyond what wind or a failing rotor does to one that is under control.
const LOST_M: f64 = 1.0;
/// Error of an angle at the end of a rig flight from which the vehicle counts as lost \[rad\].
const LOST_RAD: f64 = 1.0;
/// Truth samples that wait for their reference.
const WAITING_CAPACITY: usize = 1 << 16;

/// Position error against the reference.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tracking {
    /// Truth samples compared.
    pub samples: u64,
    /// Root mean square over the flight \[m\].
    pub rms_m: f64,
    /// Largest \[m\].
    pub max_m: f64,
    /// Mean over the last second \[m\].
    pub last_second_m: f64,
}

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

/// Everything the summary tells about the flight.
#[derive(Debug, Clone)]
pub struct Metrics {
    references: VecDeque<Reference>,
    waiting: VecDeque<(u64, [f64; 3])>,
    squares: f64,
    tracking: Tracking,
    recent: VecDeque<(u64, f64)>,
    efforts: BTreeMap<&'static str, Effort>,
    compute: BTreeMap<&'static str, Histogram<u64>>,
    loops: BTreeMap<u32, LoopStats>,
    gate: AppliedCommand,
    clipped_ticks: u64,
    ticks: u64,
    safe_ticks: u64,
    /// Largest x² + y² of the attitude quaternion.
    tilt_square: f64,
    response: Option<StepResponse>,
    misses: MissLog,
}

impl Default for Metrics {
    fn default() -> Self {
        Self {
            references: VecDeque::new(),
            waiting: VecDeque::with_capacity(1024),
            squares: 0.0,
            tracking: Tracking::default(),
            recent: VecDeque::new(),
            efforts: BTreeMap::new(),
            compute: BTreeMap::new(),
            loops: BTreeMap::new(),
            gate: AppliedCommand::default(),
            clipped_ticks: 0,
            ticks: 0,
            safe_ticks: 0,
            tilt_square: 0.0,
            response: None,
            misses: MissLog::default(),
        }
    }
}

impl Metrics {
    /// Metrics that suit a scenario's kind of flight.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        if scenario.settings().pilot.is_rig() { Self::of_rig() } else { Self::default() }
    }

    /// Metrics of a flight whose pilot writes attitudes: tracking is of attitude, not position.
    #[must_use]
    pub fn of_rig() -> Self {
        Self { response: Some(StepResponse::default()), ..Self::default() }
    }

    /// Forgets how the vehicle has flown so far, and not what it is to do: errors, efforts and
    /// clipping are judged from here on. An attitude step is still the whole one.
    pub fn judge_from_here(&mut self) {
        let before = core::mem::take(self);
        let Self { references, loops, gate, response, .. } = before;
        *self = Self { references, loops, gate, response, ..Self::default() };
    }

    /// Answer to the last attitude step of a rig flight.
    #[must_use]
    pub fn step_response(&self) -> Option<[AxisResponse; 3]> {
        self.response.as_ref().and_then(StepResponse::axes)
    }

    /// Takes note of a sample.
    pub fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            self.observe_truth(truth);
        } else if let Some(estimate) = any.downcast_ref::<StateEstimate>() {
            self.time("estimator", estimate);
        } else if let Some(reference) = any.downcast_ref::<Reference>() {
            self.references.push_back(*reference);
            self.compare(false);
        } else if let Some(report) = any.downcast_ref::<ControllerReport>() {
            self.observe_report(topic.info.name, report);
        } else if let Some(applied) = any.downcast_ref::<AppliedCommand>() {
            self.observe_applied(applied);
        } else if let Some(stats) = any.downcast_ref::<LoopStats>() {
            self.loops.insert(stats.role.0, *stats);
        } else if let Some(deviation) = any.downcast_ref::<Deviation>() {
            self.misses.observe(deviation, self.response.is_some());
        } else if any.is::<WrenchCommand>() {
            self.time("attitude", sample);
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
        let histogram = self.compute.entry(name).or_insert_with(new_histogram);
        histogram.saturating_record(compute_ns.max(1));
    }

    fn observe_truth(&mut self, truth: &Truth) {
        self.time("plant", truth);
        let q = &truth.q_wb;
        self.tilt_square = self.tilt_square.max(q.x * q.x + q.y * q.y);
        if let Some(response) = &mut self.response {
            response.observe_truth(truth);
            return;
        }
        if self.waiting.len() < WAITING_CAPACITY {
            self.waiting.push_back((truth.header.valid_ns, truth.position_w_m));
        }
        self.compare(false);
    }

    fn observe_report(&mut self, topic: &'static str, report: &ControllerReport) {
        let effort = self.efforts.entry(topic).or_default();
        let violation = report.worst_violation();
        effort.steps += 1;
        effort.worst_violation = effort.worst_violation.max(violation);
        effort.violations += u64::from(violation > VIOLATION_TOLERANCE);
        effort.relaxed += u64::from(report.relaxation.iter().any(|r| *r > 0.0));
        effort.yielded += u64::from(report.yielded > 0);
        effort.unsolved += u64::from(report.status != SolveStatus::Solved);
        effort.most_iterations = effort.most_iterations.max(report.iterations);
    }

    fn observe_applied(&mut self, applied: &AppliedCommand) {
        self.ticks += 1;
        self.clipped_ticks += u64::from(applied.clipped.is_set());
        self.safe_ticks += u64::from(applied.mode != GateMode::Normal);
        self.gate = *applied;
    }

    /// Compares waiting truths with the reference in effect at their instant.
    fn compare(&mut self, finished: bool) {
        while let Some(&(t_ns, position)) = self.waiting.front() {
            while self.references.get(1).is_some_and(|r| r.header.valid_ns <= t_ns) {
                self.references.pop_front();
            }
            let settled = self.references.len() > 1 || finished;
            let Some(reference) = self.references.front().filter(|r| r.header.valid_ns <= t_ns)
            else {
                if finished || self.references.front().is_some_and(|r| r.header.valid_ns > t_ns) {
                    self.waiting.pop_front();
                    continue;
                }
                return;
            };
            if !settled {
                return;
            }
            let error_m = distance(&reference_at(reference, t_ns), &position);
            self.waiting.pop_front();
            self.add_error(t_ns, error_m);
        }
    }

    fn add_error(&mut self, t_ns: u64, error_m: f64) {
        self.tracking.samples += 1;
        self.squares += error_m * error_m;
        self.tracking.max_m = self.tracking.max_m.max(error_m);
        self.recent.push_back((t_ns, error_m));
        while self.recent.front().is_some_and(|(t, _)| t + 1_000_000_000 <= t_ns) {
            self.recent.pop_front();
        }
    }

    /// Closes the comparison at the end of the flight.
    pub fn finish(&mut self) {
        self.compare(true);
        let samples = self.tracking.samples.max(1) as f64;
        self.tracking.rms_m = (self.squares / samples).sqrt();
        let recent = self.recent.len().max(1) as f64;
        self.tracking.last_second_m = self.recent.iter().map(|(_, e)| e).sum::<f64>() / recent;
    }

    /// Position error against the reference; call [`Metrics::finish`] first.
    #[must_use]
    pub fn tracking(&self) -> Tracking {
        self.tracking
    }

    /// Efforts by report topic.
    #[must_use]
    pub fn efforts(&self) -> &BTreeMap<&'static str, Effort> {
        &self.efforts
    }

    /// Time from start of step to publication by loop \[ns\].
    #[must_use]
    pub fn compute(&self) -> &BTreeMap<&'static str, Histogram<u64>> {
        &self.compute
    }

    /// Last totals of one loop.
    #[must_use]
    pub fn loop_stats(&self, role: Role) -> Option<&LoopStats> {
        self.loops.get(&role.0)
    }

    /// Where deadlines were missed.
    #[must_use]
    pub fn misses(&self) -> &MissLog {
        &self.misses
    }

    /// Instant \[ns\] and text of misses that nobody has been told of.
    pub fn take_news(&mut self) -> Vec<(u64, String)> {
        self.misses.take_news()
    }

    /// The gate's last word, its counters included.
    #[must_use]
    pub fn gate(&self) -> &AppliedCommand {
        &self.gate
    }

    /// The vehicle ended far from its path, tumbling or with its rotors off; call
    /// [`Metrics::finish`] first.
    #[must_use]
    pub fn vehicle_lost(&self) -> bool {
        let on_path = self.tracking.last_second_m <= LOST_M;
        let mut axes = self.step_response().into_iter().flatten();
        let tumbled = axes.any(|axis| axis.final_error_rad.abs() > LOST_RAD);
        !on_path || tumbled || self.gate.mode == GateMode::Cut
    }

    /// Commands outside their bounds.
    #[must_use]
    pub fn violations(&self) -> u64 {
        self.effort().violations
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
        // cos(tilt) = 1 − 2 (x² + y²)
        libm::acos((1.0 - 2.0 * self.tilt_square).clamp(-1.0, 1.0))
    }

    /// Share of plant ticks in which rotors were clipped.
    #[must_use]
    pub fn clipped_share(&self) -> f64 {
        self.clipped_ticks as f64 / self.ticks.max(1) as f64
    }

    /// Plant ticks in all, with clipped rotors, and outside the gate's normal mode.
    #[must_use]
    pub fn ticks(&self) -> (u64, u64, u64) {
        (self.ticks, self.clipped_ticks, self.safe_ticks)
    }
}

fn new_histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, 60_000_000_000, 3)
        .unwrap_or_else(|_| unreachable!("constant bounds are valid"))
}

fn reference_at(reference: &Reference, t_ns: u64) -> [f64; 3] {
    let ahead_ns = t_ns.saturating_sub(reference.header.valid_ns);
    let spacing_ns = reference.spacing_ns.max(1);
    let count = usize::try_from(reference.count).unwrap_or(1).clamp(1, reference.points.len());
    let index = usize::try_from(ahead_ns / spacing_ns).unwrap_or(count).min(count - 1);
    let point = &reference.points[index];
    let rest_ns = ahead_ns.saturating_sub(index as u64 * spacing_ns).min(spacing_ns);
    let rest_s = if index + 1 == count { 0.0 } else { rest_ns as f64 * 1e-9 };
    core::array::from_fn(|i| point.position_w_m[i] + point.velocity_w_m_s[i] * rest_s)
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::topics;

    fn truth(t_ms: u64, x_m: f64) -> Truth {
        let mut truth = Truth { position_w_m: [x_m, 0.0, 0.0], ..Truth::default() };
        truth.header.valid_ns = t_ms * 1_000_000;
        truth
    }

    fn reference(t_ms: u64, x_m: f64, speed_m_s: f64) -> Reference {
        let mut reference = Reference { spacing_ns: 20_000_000, count: 2, ..Reference::default() };
        reference.header.valid_ns = t_ms * 1_000_000;
        for (i, point) in reference.points.iter_mut().take(2).enumerate() {
            point.position_w_m = [x_m + i as f64 * 0.02 * speed_m_s, 0.0, 0.0];
            point.velocity_w_m_s = [speed_m_s, 0.0, 0.0];
        }
        reference
    }

    #[test]
    fn errors_do_not_depend_on_the_order_in_which_topics_are_drained() {
        let mut first = Metrics::default();
        let mut second = Metrics::default();
        for t in 0..40 {
            first.observe(&topics::TRUTH, &truth(t, 0.001 * t as f64 + 0.01));
        }
        for t in [0, 20, 40] {
            let reference = reference(t, 0.001 * t as f64, 1.0);
            first.observe(&topics::REFERENCE, &reference);
            second.observe(&topics::REFERENCE, &reference);
        }
        for t in 0..40 {
            second.observe(&topics::TRUTH, &truth(t, 0.001 * t as f64 + 0.01));
        }
        for metrics in [&mut first, &mut second] {
            metrics.finish();
            let tracking = metrics.tracking();
            assert_eq!(tracking.samples, 40);
            assert!((tracking.rms_m - 0.01).abs() < 1e-12);
            assert!((tracking.max_m - 0.01).abs() < 1e-12);
        }
    }

    #[test]
    fn what_is_judged_from_here_on_forgets_errors_and_not_where_the_vehicle_is_to_be() {
        let mut metrics = Metrics::default();
        metrics.observe(&topics::REFERENCE, &reference(0, 0.0, 1.0));
        metrics.observe(&topics::REFERENCE, &reference(20, 0.02, 1.0));
        for t in 0..20 {
            metrics.observe(&topics::TRUTH, &truth(t, 0.001 * t as f64 + 0.5));
        }
        metrics.judge_from_here();
        for t in 20..30 {
            metrics.observe(&topics::TRUTH, &truth(t, 0.001 * t as f64 + 0.01));
        }
        metrics.finish();
        assert_eq!(metrics.tracking().samples, 10);
        assert!((metrics.tracking().max_m - 0.01).abs() < 1e-12);
    }

    #[test]
    fn a_command_outside_its_bounds_is_a_violation_and_so_is_a_nan() {
        let mut metrics = Metrics::default();
        let mut report =
            ControllerReport { input_max: [1.0; 3], increment_max: [1.0; 3], ..Default::default() };
        metrics.observe(&topics::ATTITUDE_REPORT, &report);
        report.input[1] = 1.0 + 1e-6;
        report.previous_input[1] = 0.5;
        metrics.observe(&topics::ATTITUDE_REPORT, &report);
        report.input[1] = f64::NAN;
        metrics.observe(&topics::ATTITUDE_REPORT, &report);
        assert_eq!(metrics.efforts()["attitude_report"].violations, 2);
    }
}
