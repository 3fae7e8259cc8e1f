//! Sets a candidate's commands beside the owner's, and measures the bump of a flip.

use super::facts::CommandScale;
use super::watch::Commanded;
use slot::gate::{Gate, GateFigures, GateLimits, Pair, Phase, Refusal};
use std::collections::VecDeque;
use vehicle::MorphAngle;

/// Realtime: one of so many steps may be missed.
const STEPS_PER_PARDON: u64 = 50;
/// Realtime: how long to wait for what the owner missed; one that reports nothing has missed nothing \[ns\].
const OWNER_REPORT_NS: u64 = 250_000_000;
/// The consumers' limiters let through so much of a change of kind at once, over the largest command.
const STEP_SHARE: f64 = 0.1;
/// Commands kept of each of the two, and readings: more than lockstep lets pass at once.
const KEPT: usize = 2048;

/// A candidate that begins from nothing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tracks {
    /// Its commands depend on set points, of which it may have received none yet.
    pub(super) needs_setpoint: bool,
    /// Until then it tracks \[ns\].
    pub(super) until_ns: u64,
}

/// Since when a candidate knows what it is to do.
#[derive(Debug, Clone, Copy)]
enum HasSetpoint {
    /// From this release on \[ns\].
    Since(u64),
    /// At this release it had received no set point \[ns\].
    NotAt(u64),
}

/// How many steps a loop has missed since its first report.
#[derive(Debug, Clone, Copy, Default)]
struct MissedSteps {
    /// Until then: its own way in, or what a tenant before it missed.
    before: Option<u64>,
    /// In all, and when it reported them \[ns\].
    steps: u64,
    at_ns: u64,
}

impl MissedSteps {
    fn note(&mut self, steps: u64, at_ns: u64) {
        self.before = Some(self.before.map_or(steps, |before| before.min(steps)));
        (self.steps, self.at_ns) = (steps, at_ns);
    }

    fn count(&self) -> u64 {
        self.before.map_or(0, |before| self.steps.saturating_sub(before))
    }
}

/// Two streams of commands of one slot, compared instant by instant.
#[derive(Debug)]
pub(super) struct Gatekeeper {
    scale: CommandScale,
    gate: Gate,
    candidate: u32,
    owner: u32,
    /// What the candidate commands without a set point is not measured.
    has_setpoint: HasSetpoint,
    /// Until then it tracks \[ns\].
    track_until_ns: u64,
    from_candidate: VecDeque<Commanded>,
    from_owner: VecDeque<Commanded>,
    /// Instants and readings of the deployable angle \[rad\].
    angles: VecDeque<(u64, f64)>,
    candidate_missed: MissedSteps,
    /// In the same time.
    owner_missed: MissedSteps,
    /// Realtime: a machine that makes all processes late now and then is no fault of the candidate.
    patient: bool,
    /// Largest step that the consumer makes at the flip, over the largest command.
    step_max: f64,
    /// The flip, once it is known \[ns\], and the bump there, per axis over the largest command.
    flip_ns: Option<u64>,
    bump: Option<[f64; 4]>,
}

impl Gatekeeper {
    pub(super) fn new(
        scale: CommandScale,
        limits: GateLimits,
        (candidate, owner): (u32, u32),
        tracks: Option<Tracks>,
        patient: bool,
    ) -> Self {
        Self {
            scale,
            gate: Gate::new(scale.axes(), limits, tracks.is_some()),
            candidate,
            owner,
            has_setpoint: match tracks {
                Some(Tracks { needs_setpoint: true, .. }) => HasSetpoint::NotAt(0),
                _ => HasSetpoint::Since(0),
            },
            track_until_ns: tracks.map_or(0, |tracks| tracks.until_ns),
            from_candidate: VecDeque::with_capacity(KEPT),
            from_owner: VecDeque::with_capacity(KEPT),
            angles: VecDeque::with_capacity(KEPT),
            candidate_missed: MissedSteps::default(),
            owner_missed: MissedSteps::default(),
            patient,
            // Slopes are asked of another kind only, and so is the limiter.
            step_max: if limits.slope_min.is_finite() { STEP_SHARE } else { f64::INFINITY },
            flip_ns: None,
            bump: None,
        }
    }

    /// Takes a command of either.
    ///
    /// # Errors
    /// The candidate did what no controller may do.
    pub(super) fn take(&mut self, command: &Commanded) -> Result<(), Refusal> {
        let queue = match command.seat {
            seat if seat == self.candidate => &mut self.from_candidate,
            seat if seat == self.owner => &mut self.from_owner,
            _ => return Ok(()),
        };
        push(queue, *command);
        self.compare()
    }

    /// Takes whether the controller on a seat had received a set point at a release.
    ///
    /// # Errors
    /// The candidate did what no controller may do.
    pub(super) fn take_setpoint(
        &mut self,
        seat: u32,
        at_ns: u64,
        something: bool,
    ) -> Result<(), Refusal> {
        if seat == self.candidate && matches!(self.has_setpoint, HasSetpoint::NotAt(_)) {
            self.has_setpoint =
                if something { HasSetpoint::Since(at_ns) } else { HasSetpoint::NotAt(at_ns) };
            return self.compare();
        }
        Ok(())
    }

    /// Takes a reading of the deployable angle \[rad\].
    ///
    /// # Errors
    /// The candidate did what no controller may do.
    pub(super) fn morphs(&mut self, at_ns: u64, angle_rad: f64) -> Result<(), Refusal> {
        push(&mut self.angles, (at_ns, angle_rad));
        self.compare()
    }

    /// Largest command at an instant; `None` until the deployable angle there is known. Whatever the
    /// order in which topics were read, it is the same.
    fn u_max(&self, at_ns: u64) -> Option<[f64; 4]> {
        if !self.scale.morphs() {
            return Some(self.scale.largest(MorphAngle::MIN));
        }
        self.angles.back().filter(|(known_ns, _)| *known_ns >= at_ns)?;
        let then = self.angles.iter().rev().find(|(reading_ns, _)| *reading_ns <= at_ns);
        let (_, angle_rad) = *then.or_else(|| self.angles.front())?;
        Some(self.scale.largest(MorphAngle::saturating_from_rad(angle_rad)?))
    }

    /// Compares everything that both have published commands for.
    fn compare(&mut self) -> Result<(), Refusal> {
        while let Some(candidate) = self.from_candidate.front() {
            let Some(newest) = self.from_owner.back() else { return Ok(()) };
            if newest.effective_ns < candidate.effective_ns {
                return Ok(());
            }
            let Some(u_max) = self.u_max(candidate.release_ns) else { return Ok(()) };
            let is_without_setpoint = match self.has_setpoint {
                HasSetpoint::Since(since_ns) => candidate.release_ns < since_ns,
                HasSetpoint::NotAt(at_ns) if candidate.release_ns <= at_ns => true,
                HasSetpoint::NotAt(_) => return Ok(()),
            };
            let candidate = *candidate;
            self.from_candidate.pop_front();
            if is_without_setpoint {
                continue;
            }
            let before = |owner: &&Commanded| owner.effective_ns <= candidate.effective_ns;
            let Some(owner) = self.from_owner.iter().rev().find(before).copied() else { continue };
            self.measure(&candidate, &owner, u_max)?;
        }
        Ok(())
    }

    fn measure(
        &mut self,
        candidate: &Commanded,
        owner: &Commanded,
        u_max: [f64; 4],
    ) -> Result<(), Refusal> {
        if let Some(flip_ns) = self.flip_ns {
            if candidate.effective_ns >= flip_ns && self.bump.is_none() {
                let over = |i: usize| {
                    let step = (candidate.value[i] - owner.value[i]).abs();
                    (step / u_max[i].max(f64::MIN_POSITIVE)).min(self.step_max)
                };
                self.bump = Some(core::array::from_fn(over));
            }
            return Ok(());
        }
        let tracking = candidate.release_ns < self.track_until_ns;
        let phase = if tracking { Phase::Tracking } else { Phase::Free };
        let pair = Pair {
            effective_ns: candidate.effective_ns,
            candidate: candidate.value,
            owner: owner.value,
            u_max,
        };
        self.gate.compare(phase, &pair)
    }

    /// Takes how many steps either has missed in all.
    pub(super) fn missed(&mut self, seat: u32, steps: u64, at_ns: u64) {
        if self.flip_ns.is_some() {
            return;
        }
        if seat == self.owner {
            self.owner_missed.note(steps, at_ns);
        } else if seat == self.candidate {
            if self.candidate_missed.before.is_none() {
                self.owner_missed.before =
                    self.owner_missed.before.map(|_| self.owner_missed.steps);
            }
            self.candidate_missed.note(steps, at_ns);
        } else {
            return;
        }
        self.judge_missed();
    }

    /// In realtime whatever makes an owner late that flies well makes a candidate late too: no more
    /// than a few steps beyond the owner's are its own.
    fn judge_missed(&mut self) {
        let MissedSteps { at_ns, .. } = self.candidate_missed;
        let behind_ns = at_ns.saturating_sub(self.owner_missed.at_ns);
        if self.patient && (1..OWNER_REPORT_NS).contains(&behind_ns) {
            return;
        }
        let figures = self.gate.figures();
        let own = (figures.tracked + figures.free) / STEPS_PER_PARDON + 1;
        let allowed = if self.patient { own.saturating_add(self.owner_missed.count()) } else { 0 };
        self.gate.misses(self.candidate_missed.count(), allowed, at_ns);
    }

    pub(super) fn verdict(&self) -> Result<GateFigures, Refusal> {
        self.gate.verdict()
    }

    pub(super) fn figures(&self) -> GateFigures {
        self.gate.figures()
    }

    /// From here on only the bump at this instant matters; a later one takes its place.
    pub(super) fn flips_at(&mut self, flip_ns: u64) {
        self.flip_ns = Some(flip_ns);
        self.bump = None;
    }

    /// Difference of the two commands for the instant of the flip, as the consumer's limiter lets it
    /// through, per axis over the largest command; none before it has been seen.
    pub(super) fn bump(&self) -> Option<[f64; 4]> {
        self.bump
    }
}

/// Keeps the newest.
fn push<T>(queue: &mut VecDeque<T>, value: T) {
    if queue.len() == KEPT {
        queue.pop_front();
    }
    queue.push_back(value);
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Slot;
    use vehicle::VehicleParameters;

    const MS: u64 = 1_000_000;
    const CANDIDATE: u32 = 1;
    const OWNER: u32 = 0;

    fn gatekeeper(patient: bool) -> Gatekeeper {
        let scale = CommandScale::of(Slot::Attitude, &VehicleParameters::default());
        let seats = (CANDIDATE, OWNER);
        let mut gatekeeper = Gatekeeper::new(scale, GateLimits::SAME_KIND, seats, None, patient);
        // What they missed before they flew side by side does not count.
        gatekeeper.missed(OWNER, 30, 900 * MS);
        gatekeeper.missed(CANDIDATE, 7, 1000 * MS);
        gatekeeper.missed(OWNER, 30, 1000 * MS);
        gatekeeper
    }

    fn judged(
        gatekeeper: &mut Gatekeeper,
        (at_ms, candidate, owner): (u64, u64, u64),
    ) -> Option<(u64, u64)> {
        gatekeeper.missed(CANDIDATE, 7 + candidate, at_ms * MS);
        gatekeeper.missed(OWNER, 30 + owner, at_ms * MS);
        refused(gatekeeper)
    }

    /// Deadlines missed and allowed, if it is refused for them.
    fn refused(gatekeeper: &Gatekeeper) -> Option<(u64, u64)> {
        match gatekeeper.verdict() {
            Err(Refusal::MissedDeadlines { missed, limit, .. }) => Some((missed, limit)),
            _ => None,
        }
    }

    #[test]
    fn in_lockstep_every_step_that_a_candidate_misses_is_its_own() {
        assert_eq!(judged(&mut gatekeeper(false), (1100, 3, 3)), Some((3, 0)));
    }

    #[test]
    fn in_realtime_what_the_owner_misses_too_is_no_fault_of_the_candidate() {
        let mut gatekeeper = gatekeeper(true);
        assert_eq!(judged(&mut gatekeeper, (1100, 1, 0)), None, "once may happen");
        assert_eq!(judged(&mut gatekeeper, (1200, 10, 9)), None);
        assert_eq!(judged(&mut gatekeeper, (1300, 12, 9)), Some((12, 10)));
    }

    #[test]
    fn an_owner_that_reports_nothing_any_more_excuses_no_candidate() {
        let mut gatekeeper = gatekeeper(true);
        gatekeeper.missed(CANDIDATE, 7 + 4, 1100 * MS);
        assert_eq!(refused(&gatekeeper), None, "the owner has not reported yet");
        gatekeeper.missed(CANDIDATE, 7 + 4, 1400 * MS);
        assert_eq!(refused(&gatekeeper), Some((4, 1)));
    }
}
