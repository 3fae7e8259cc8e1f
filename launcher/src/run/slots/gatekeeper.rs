//! Sets a candidate's commands beside the owner's, and measures the bump of a flip.

use super::facts::Yardstick;
use super::watch::Commanded;
use slot::gate::{Gate, GateFigures, GateLimits, Pair, Phase, Refusal};
use std::collections::VecDeque;
use vehicle::MorphAngle;

/// Realtime: one of so many steps may be missed.
const STEPS_PER_PARDON: u64 = 50;
/// The consumers' limiters let through so much of a change of kind at once, over the largest command.
const STEP_SHARE: f64 = 0.1;
/// Commands kept of each of the two, and readings: more than lockstep lets pass at once.
const KEPT: usize = 2048;

/// A candidate that begins from nothing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tracks {
    /// Its commands depend on set points, of which it may have heard none yet.
    pub(super) needs_setpoint: bool,
    /// Until then it tracks \[ns\].
    pub(super) until_ns: u64,
}

/// Since when a candidate knows what it is to do.
#[derive(Debug, Clone, Copy)]
enum Hearing {
    /// From this release on \[ns\].
    Since(u64),
    /// At this release it had heard nothing \[ns\].
    NotAt(u64),
}

/// Two streams of commands of one slot, compared instant by instant.
#[derive(Debug)]
pub(super) struct Gatekeeper {
    yardstick: Yardstick,
    gate: Gate,
    candidate: u32,
    owner: u32,
    /// What the candidate says without a set point is not measured.
    hearing: Hearing,
    /// Until then it tracks \[ns\].
    track_until_ns: u64,
    from_candidate: VecDeque<Commanded>,
    from_owner: VecDeque<Commanded>,
    /// Instants and readings of the deployable angle \[rad\].
    angles: VecDeque<(u64, f64)>,
    /// Steps that the candidate had missed when it was first heard of.
    missed_before: Option<u64>,
    /// Realtime: a machine that makes everybody late now and then is no fault of the candidate.
    patient: bool,
    /// Largest step that the consumer makes at the flip, over the largest command.
    step_max: f64,
    /// The flip, once it is known \[ns\], and the bump there, per axis over the largest command.
    flip_ns: Option<u64>,
    bump: Option<[f64; 4]>,
}

impl Gatekeeper {
    pub(super) fn new(
        yardstick: Yardstick,
        limits: GateLimits,
        (candidate, owner): (u32, u32),
        tracks: Option<Tracks>,
        patient: bool,
    ) -> Self {
        Self {
            yardstick,
            gate: Gate::new(yardstick.axes(), limits, tracks.is_some()),
            candidate,
            owner,
            hearing: match tracks {
                Some(Tracks { needs_setpoint: true, .. }) => Hearing::NotAt(0),
                _ => Hearing::Since(0),
            },
            track_until_ns: tracks.map_or(0, |tracks| tracks.until_ns),
            from_candidate: VecDeque::with_capacity(KEPT),
            from_owner: VecDeque::with_capacity(KEPT),
            angles: VecDeque::with_capacity(KEPT),
            missed_before: None,
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

    /// Takes whether whoever sits there had heard a set point at a release.
    ///
    /// # Errors
    /// The candidate did what no controller may do.
    pub(super) fn hears(&mut self, seat: u32, at_ns: u64, something: bool) -> Result<(), Refusal> {
        if seat == self.candidate && matches!(self.hearing, Hearing::NotAt(_)) {
            self.hearing = if something { Hearing::Since(at_ns) } else { Hearing::NotAt(at_ns) };
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
        if !self.yardstick.morphs() {
            return Some(self.yardstick.largest(MorphAngle::MIN));
        }
        self.angles.back().filter(|(known_ns, _)| *known_ns >= at_ns)?;
        let then = self.angles.iter().rev().find(|(reading_ns, _)| *reading_ns <= at_ns);
        let (_, angle_rad) = *then.or_else(|| self.angles.front())?;
        Some(self.yardstick.largest(MorphAngle::saturating_from_rad(angle_rad)?))
    }

    /// Compares all that both have said something about.
    fn compare(&mut self) -> Result<(), Refusal> {
        while let Some(candidate) = self.from_candidate.front() {
            let Some(newest) = self.from_owner.back() else { return Ok(()) };
            if newest.effective_ns < candidate.effective_ns {
                return Ok(());
            }
            let Some(u_max) = self.u_max(candidate.release_ns) else { return Ok(()) };
            let deaf = match self.hearing {
                Hearing::Since(since_ns) => candidate.release_ns < since_ns,
                Hearing::NotAt(at_ns) if candidate.release_ns <= at_ns => true,
                Hearing::NotAt(_) => return Ok(()),
            };
            let candidate = *candidate;
            self.from_candidate.pop_front();
            if deaf {
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

    /// Takes how many steps the candidate has missed in all.
    pub(super) fn missed(&mut self, seat: u32, steps: u64, at_ns: u64) {
        if seat != self.candidate || self.flip_ns.is_some() {
            return;
        }
        // What it missed on its way in is no fault of its own.
        let before = *self.missed_before.get_or_insert(steps);
        let figures = self.gate.figures();
        let pardoned =
            if self.patient { 1 + (figures.tracked + figures.free) / STEPS_PER_PARDON } else { 0 };
        let known = figures.missed;
        for _ in known..steps.saturating_sub(before).saturating_sub(pardoned) {
            self.gate.miss(at_ns);
        }
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
