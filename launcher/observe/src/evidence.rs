//! What a flight is judged by, gathered sample by sample: bounded memory, and the same cost for each.
//!
//! Errors and safe-mode episodes wait for some seconds, until it is known whether a process was lost about then.

use super::course_bins::{Bin, Errors, Off};
use ::verdict::{Clipping, Contact, SafeMode, Thresholds, Tracking, worst};
use scenario::Scenario;
use shared_types::time::{ns_from_s, s_from_ns};
use shared_types::{
    AppliedCommand, Disturbance, GateMode, Header, Seating, SeatingKind, StateEstimate, Truth,
};
use std::collections::VecDeque;
use vehicle::{Geometry, MorphAngle};

/// So long before the loss of a process is reported, its lack may show \[ns\].
const BEFORE_NS: u64 = 1_500_000_000;
/// Topics are drained one after the other, each this far ahead of another at most \[ns\].
const SLACK_NS: u64 = 1_000_000_000;
/// A foot this close to the ground touches it, less than it sinks in under the weight \[m\].
const TOUCH_M: f64 = 1e-3;
/// Instants of contact that wait for their reference.
const WAITING_CAPACITY: usize = 1 << 16;
/// A path that leads this close to the ground may touch it \[m\].
const LANDED_M: f64 = 0.05;

/// By what a flight is judged, and what of it is expected.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rules {
    /// Name of the scenario.
    pub(crate) scenario: String,
    /// Logical time planned \[ns\].
    pub(crate) planned_ns: u64,
    /// Limits.
    pub(crate) thresholds: Thresholds,
    /// What the scenario does on purpose: processes killed, loops stopped, and silences of the IMU, from when to when
    /// \[ns\].
    faults_ns: Vec<(u64, u64)>,
    recovery_ns: u64,
    tick_s: f64,
    /// Of a vehicle above ground.
    geometry: Option<Geometry>,
    /// There is a path to keep to, as of every flight that is no rig's.
    has_path: bool,
}

impl Rules {
    /// Those of a scenario.
    pub(crate) fn of(scenario: &Scenario) -> Self {
        let settings = scenario.settings();
        let over_ground =
            matches!(settings.plant.model_kind(), plant::ModelKind::Nonlinear { ground: true });
        let faults =
            settings.fault.iter().map(|fault| (ns_from_s(fault.at_s), ns_from_s(fault.at_s)));
        let silences = settings.plant.imu.drop_outs.iter();
        let silences =
            silences.map(|silence| (ns_from_s(silence.from_s), ns_from_s(silence.until_s)));
        Self {
            scenario: settings.scenario.name.clone(),
            planned_ns: scenario.duration_ns(),
            thresholds: scenario.thresholds(),
            faults_ns: faults.chain(silences).chain(scenario.stops_ns()).collect(),
            recovery_ns: ns_from_s(settings.verdict.recovery_s),
            tick_s: 1.0 / settings.plant.rate_hz,
            geometry: over_ground.then(|| scenario.real_vehicle().geometry),
            has_path: !settings.pilot.is_rig(),
        }
    }

    /// True if a fault is scripted, or a process is known to have been lost, so that `from_ns..=to_ns`
    /// belongs to a recovery.
    fn explains(&self, lost_ns: &VecDeque<u64>, from_ns: u64, to_ns: u64) -> bool {
        let recovers = |begin_ns: u64, at_ns: u64| {
            begin_ns <= to_ns && from_ns <= at_ns.saturating_add(self.recovery_ns)
        };
        self.faults_ns.iter().any(|(begin_ns, end_ns)| recovers(*begin_ns, *end_ns))
            || lost_ns.iter().any(|at_ns| recovers(at_ns.saturating_sub(BEFORE_NS), *at_ns))
    }
}

/// A stretch in which the gate had no valid command.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Episode {
    from_ns: u64,
    count: u64,
}

/// Everything gathered so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Evidence {
    rules: Rules,
    /// Newest instant of the vehicle \[ns\].
    newest_ns: u64,
    /// Instants at which a process was lost, as far back as anything waits for them \[ns\].
    lost_ns: VecDeque<u64>,
    /// Generations of estimator and injector.
    generations: [Option<u32>; 2],
    errors: Errors,
    episodes: VecDeque<Episode>,
    counted: Option<u64>,
    /// Since when the gate has been in safe mode \[ns\].
    safe_from_ns: Option<u64>,
    safe_mode: SafeMode,
    ticks: u64,
    clipped: u64,
    clipped_run: u64,
    clipping: Clipping,
    /// Instants of contact of which it is not known yet whether the path led there \[ns\].
    touching_ns: VecDeque<u64>,
    contact_ticks: u64,
    contact_from_ns: Option<u64>,
    tilt_square: f64,
    cut_ticks: u64,
    cut_at_ns: u64,
}

impl Evidence {
    pub(super) fn of(scenario: &Scenario) -> Self {
        let rules = Rules::of(scenario);
        Self { rules, ..Self::default() }
    }

    pub(super) fn rules(&self) -> &Rules {
        &self.rules
    }

    pub(super) fn judge_by(&mut self, rules: Rules) {
        self.rules = rules;
    }

    /// Forgets what was, and neither what is allowed nor what the gate has counted.
    pub(super) fn anew(self) -> Self {
        let Self { rules, counted, generations, newest_ns, lost_ns, .. } = self;
        Self { rules, newest_ns, lost_ns, generations, counted, ..Self::default() }
    }

    /// Takes note of where the vehicle is, and whether a foot of it touches the ground.
    pub(super) fn truth(&mut self, truth: &Truth) {
        let q = &truth.q_wb;
        self.tilt_square = worst(self.tilt_square, q.x * q.x + q.y * q.y);
        if touches(truth, self.rules.geometry.as_ref()) {
            self.touching_ns.push_back(truth.header.valid_ns);
            if self.touching_ns.len() > WAITING_CAPACITY {
                self.land(u64::MAX, false, 1);
            }
        }
        self.now(truth.header.valid_ns);
    }

    /// Takes note of how far off its path the vehicle was, and how high the path was there.
    pub(super) fn error(&mut self, t_ns: u64, off: Off, wanted_z_m: f64) {
        self.land(t_ns, wanted_z_m <= LANDED_M, usize::MAX);
        self.errors.add(t_ns, off);
    }

    /// Counts what touched the ground until an instant, `count` of it at most; what touched it at that instant
    /// was to be there if the path `is_landed`.
    fn land(&mut self, t_ns: u64, is_landed: bool, count: usize) {
        for _ in 0..count {
            let Some(at_ns) = self.touching_ns.pop_front_if(|at_ns| *at_ns <= t_ns) else { return };
            if at_ns < t_ns || !is_landed {
                self.contact_ticks += 1;
                self.contact_from_ns.get_or_insert(at_ns);
            }
        }
    }

    /// Takes note of what the gate made of a tick.
    pub(super) fn applied(&mut self, applied: &AppliedCommand) {
        let t_ns = applied.header.valid_ns;
        self.ticks += 1;
        self.clip(applied.clipped.is_set(), t_ns);
        let before = self.counted.replace(applied.safe_mode_episodes);
        // A part of a flight begins with what was counted before it.
        let count =
            applied.safe_mode_episodes.saturating_sub(before.unwrap_or(applied.safe_mode_episodes));
        if applied.mode == GateMode::Recover || applied.tripped.is_set() {
            // The trip that it follows, or that follows it, is its explanation.
            self.safe_mode.explained += count;
        } else if count > 0 {
            self.episodes.push_back(Episode { from_ns: t_ns, count });
        }
        match (applied.mode != GateMode::Normal, self.safe_from_ns) {
            (true, from_ns) => {
                let from_ns = *self.safe_from_ns.insert(from_ns.unwrap_or(t_ns));
                let lasted_s = s_from_ns(t_ns.saturating_sub(from_ns)) + self.rules.tick_s;
                if lasted_s > self.safe_mode.longest_s {
                    self.safe_mode.longest_s = lasted_s;
                    self.safe_mode.longest_from_s = s_from_ns(from_ns);
                }
            }
            (false, _) => self.safe_from_ns = None,
        }
        if applied.mode == GateMode::Cut {
            if self.cut_ticks == 0 {
                self.cut_at_ns = t_ns;
            }
            self.cut_ticks += 1;
        }
        self.now(t_ns);
    }

    fn clip(&mut self, is_clipped: bool, t_ns: u64) {
        if !is_clipped {
            self.clipped_run = 0;
            return;
        }
        self.clipped += 1;
        self.clipped_run += 1;
        let lasted_s = self.clipped_run as f64 * self.rules.tick_s;
        if lasted_s > self.clipping.longest_s {
            self.clipping.longest_s = lasted_s;
            self.clipping.longest_from_s = (s_from_ns(t_ns) - lasted_s).max(0.0);
        }
    }

    /// Takes note of a process that is lost from a slot.
    pub(super) fn seated(&mut self, seating: &Seating) {
        if seating.kind == SeatingKind::Lost {
            self.lost(seating.header.release_ns);
        }
    }

    /// Takes note of which process estimates: another generation goes on where one was lost.
    pub(super) fn estimate(&mut self, estimate: &StateEstimate) {
        self.generation(0, &estimate.header);
    }

    /// The same for the one that disturbs.
    pub(super) fn disturbance(&mut self, disturbance: &Disturbance) {
        self.generation(1, &disturbance.header);
    }

    fn generation(&mut self, of: usize, header: &Header) {
        let before = self.generations[of].replace(header.generation);
        if before.is_some_and(|before| before < header.generation) {
            self.lost(header.release_ns);
        }
    }

    fn lost(&mut self, at_ns: u64) {
        self.lost_ns.push_back(at_ns);
    }

    /// Settles what no loss can explain any more.
    fn now(&mut self, t_ns: u64) {
        self.newest_ns = self.newest_ns.max(t_ns);
        let settled_ns = self.newest_ns.saturating_sub(BEFORE_NS + SLACK_NS);
        self.settle(settled_ns);
        let forgotten_ns = settled_ns.saturating_sub(self.rules.recovery_ns + SLACK_NS);
        while self.lost_ns.front().is_some_and(|at_ns| *at_ns < forgotten_ns) {
            self.lost_ns.pop_front();
        }
    }

    fn settle(&mut self, until_ns: u64) {
        let Self { rules, lost_ns, errors, .. } = self;
        errors.settle(until_ns, &|bin: &Bin| rules.explains(lost_ns, bin.begin_ns(), bin.end_ns()));
        while let Some(episode) = self.episodes.front().copied().filter(|e| e.from_ns < until_ns) {
            self.episodes.pop_front();
            if self.rules.explains(&self.lost_ns, episode.from_ns, episode.from_ns) {
                self.safe_mode.explained += episode.count;
            } else {
                if self.safe_mode.unexplained == 0 {
                    self.safe_mode.unexplained_from_s = s_from_ns(episode.from_ns);
                }
                self.safe_mode.unexplained += episode.count;
            }
        }
    }

    /// Settles everything; nothing follows.
    pub(super) fn finish(&mut self) {
        self.land(u64::MAX, false, usize::MAX);
        self.settle(u64::MAX);
    }

    /// How far it was from its path, `end_m` in the last second; none of a rig.
    pub(super) fn tracking(&self, end_m: f64) -> Option<Tracking> {
        self.rules.has_path.then(|| self.errors.tracking(end_m)).flatten()
    }

    pub(super) fn contact(&self) -> Contact {
        Contact {
            total_s: self.contact_ticks as f64 * self.rules.tick_s,
            from_s: s_from_ns(self.contact_from_ns.unwrap_or(0)),
        }
    }

    pub(super) fn safe_mode(&self) -> SafeMode {
        self.safe_mode
    }

    pub(super) fn clipping(&self) -> Clipping {
        Clipping { share: self.clipped as f64 / self.ticks.max(1) as f64, ..self.clipping }
    }

    /// For how long and since when the rotors have been cut \[s\].
    pub(super) fn cut_s(&self) -> (f64, f64) {
        (self.cut_ticks as f64 * self.rules.tick_s, s_from_ns(self.cut_at_ns))
    }

    /// Largest angle between the vehicle's axis and the vertical \[rad\].
    pub(super) fn tilt_rad(&self) -> f64 {
        if self.tilt_square.is_nan() {
            return f64::NAN;
        }
        // cos(tilt) = 1 − 2 (x² + y²)
        libm::acos((1.0 - 2.0 * self.tilt_square).clamp(-1.0, 1.0))
    }

    /// Ticks of the plant, and those with clipped rotors.
    pub(super) fn ticks(&self) -> (u64, u64) {
        (self.ticks, self.clipped)
    }
}

/// True if the lowest arm tip is on the ground, which a tip is on either side of the body.
fn touches(truth: &Truth, geometry: Option<&Geometry>) -> bool {
    let Some(geometry) = geometry else { return false };
    // The arms may swing beyond their stops by a hair.
    let Some(beta) = MorphAngle::saturating_from_rad(truth.morph_angle_rad) else { return true };
    let q = &truth.q_wb;
    // Third row of the rotation: how much of a body axis points up.
    let up_x = 2.0 * (q.x * q.z - q.w * q.y);
    let up_y = 2.0 * (q.y * q.z + q.w * q.x);
    let lowest_m = truth.position_w_m[2] - geometry.arm_length_m(beta) * up_x.abs().max(up_y.abs());
    lowest_m <= TOUCH_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Flag;

    #[test]
    fn a_safe_mode_episode_is_explained_by_the_trip_that_it_follows() {
        let mut evidence = Evidence::default();
        let modes = [
            (GateMode::Normal, 0, false),
            (GateMode::Recover, 1, false),
            (GateMode::Normal, 1, false),
            (GateMode::Level, 2, true),
            (GateMode::Normal, 2, true),
            (GateMode::Level, 3, false),
        ];
        for (t_ns, (mode, safe_mode_episodes, tripped)) in (0..).zip(modes) {
            evidence.applied(&AppliedCommand {
                header: Header { valid_ns: t_ns, ..Header::default() },
                mode,
                safe_mode_episodes,
                tripped: Flag::from(tripped),
                ..AppliedCommand::default()
            });
        }
        evidence.finish();
        let SafeMode { explained, unexplained, .. } = evidence.safe_mode();
        assert_eq!((explained, unexplained), (2, 1));
    }
}
