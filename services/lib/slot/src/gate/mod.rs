//! Whether a shadow may fly: its commands beside the owner's, for the same effective instants.
//!
//! While a candidate of another kind *tracks*, it is reset before each step to continue from what
//! was applied, so its disagreement is that of one step. Then it runs *free*: what it would do if it
//! flew is seen there, and only there do a wrong sign and a wrong gain show. A candidate of the same
//! kind restores the owner's state and is free from the start.
//!
//! All disagreement is `|u_candidate − u_owner|` per axis over the largest command. What noise alone
//! could have made is held against no candidate: means and slopes are judged by more than their margins
//! (`fit.rs`). [`GateLimits`] states how much is allowed and why.

mod fit;
mod limits;
mod measure;
mod refusal;

pub use fit::Estimate;
pub use limits::{Axis, GateLimits};
pub use refusal::Refusal;

use measure::Measure;

/// Part of the shadow window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Phase {
    /// Reset to the applied output before each step.
    Tracking,
    /// On its own.
    Free,
}

impl core::fmt::Display for Phase {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Tracking => "one step ahead",
            Self::Free => "running free",
        })
    }
}

/// Commands of candidate and owner for one effective instant, axis by axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// The instant \[ns\].
    pub effective_ns: u64,
    /// Candidate's command.
    pub candidate: [f64; 4],
    /// Owner's command in effect then.
    pub owner: [f64; 4],
    /// Largest command there, the unit of disagreement.
    pub u_max: [f64; 4],
}

/// A disagreement and where it was.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Worst {
    /// Over the largest command.
    pub value: f64,
    /// Effective instant \[ns\].
    pub at_ns: u64,
}

/// What the gate measured, per axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GateFigures {
    /// Instants compared while it tracked.
    pub tracked: u64,
    /// Instants compared while it ran free.
    pub free: u64,
    /// Worst disagreement one step ahead.
    pub tracking_worst: [Worst; 4],
    /// The most that it may be.
    pub tracking_worst_max: [f64; 4],
    /// Worst disagreement running free.
    pub free_worst: [Worst; 4],
    /// The most that it may be.
    pub free_worst_max: [f64; 4],
    /// Its root mean square, over the largest command.
    pub free_rms: [f64; 4],
    /// The most that it may be.
    pub free_rms_max: [f64; 4],
    /// Slope of the candidate's free commands over the owner's; `None` where the owner was quiet.
    pub slope: [Option<Estimate>; 4],
    /// Deadlines missed.
    pub missed: u64,
    /// The most that may be.
    pub missed_max: u64,
}

/// The gate of one shadow window.
#[derive(Debug, Clone, PartialEq)]
pub struct Gate {
    axes: [Axis; 4],
    limits: GateLimits,
    /// Whether there is a tracking phase at all.
    tracks: bool,
    /// One step ahead, running free.
    measured: [[Measure; 4]; 2],
    missed: u64,
    missed_max: u64,
    last_ns: u64,
    first_miss_ns: u64,
    /// What no window makes good: the first of its kind.
    broken: Option<Refusal>,
}

impl Gate {
    /// A gate that has seen nothing. `tracks`: the window begins with a tracking phase.
    #[must_use]
    pub fn new(axes: [Axis; 4], limits: GateLimits, tracks: bool) -> Self {
        Self {
            axes,
            limits,
            tracks,
            measured: Default::default(),
            missed: 0,
            missed_max: 0,
            last_ns: 0,
            first_miss_ns: 0,
            broken: None,
        }
    }

    /// Compares the commands for one effective instant. Where the owner's is not finite there is
    /// nothing to compare with, but the candidate's is still judged.
    ///
    /// # Errors
    /// The candidate did what no controller may do; the verdict will be the same.
    pub fn compare(&mut self, phase: Phase, pair: &Pair) -> Result<(), Refusal> {
        self.last_ns = pair.effective_ns;
        for (axis, value) in self.axes.iter().zip(pair.candidate) {
            let refusal = refuse_value(axis, value, pair.effective_ns);
            self.broken = self.broken.take().or(refusal);
        }
        if let Some(refusal) = &self.broken {
            return Err(refusal.clone());
        }
        if !pair.owner.iter().all(|u| u.is_finite()) {
            return Ok(());
        }
        let limits = self.limits;
        for (i, measure) in self.of_mut(phase).iter_mut().enumerate() {
            let scale = 1.0 / pair.u_max[i].max(f64::MIN_POSITIVE);
            let (candidate, owner) = (pair.candidate[i] * scale, pair.owner[i] * scale);
            measure.add(&limits, pair.effective_ns, candidate, owner);
        }
        Ok(())
    }

    fn of(&self, phase: Phase) -> &[Measure; 4] {
        &self.measured[usize::from(phase == Phase::Free)]
    }

    fn of_mut(&mut self, phase: Phase) -> &mut [Measure; 4] {
        &mut self.measured[usize::from(phase == Phase::Free)]
    }

    fn seen(&self, phase: Phase) -> u64 {
        self.of(phase)[0].count()
    }

    /// The candidate has missed so many deadlines by now, of which so many are no fault of its own.
    pub fn misses(&mut self, missed: u64, allowed: u64, at_ns: u64) {
        if self.missed == 0 {
            self.first_miss_ns = at_ns;
        }
        (self.missed, self.missed_max) = (missed, allowed);
    }

    /// What has been measured so far.
    #[must_use]
    pub fn figures(&self) -> GateFigures {
        let (tracking, free) = (self.of(Phase::Tracking), self.of(Phase::Free));
        let peak_max = |measure: &Measure| measure.peak_max(&self.limits);
        GateFigures {
            tracked: self.seen(Phase::Tracking),
            free: self.seen(Phase::Free),
            tracking_worst: tracking.each_ref().map(Measure::worst),
            tracking_worst_max: tracking.each_ref().map(peak_max),
            free_worst: free.each_ref().map(Measure::worst),
            free_worst_max: free.each_ref().map(peak_max),
            free_rms: free.each_ref().map(Measure::rms),
            free_rms_max: free.each_ref().map(|measure| measure.rms_max(&self.limits)),
            slope: free.each_ref().map(|measure| measure.slope(&self.limits)),
            missed: self.missed,
            missed_max: self.missed_max,
        }
    }

    /// Whether the candidate may fly. What no controller may do is reported first, then missing
    /// deadlines, then disagreement, one step ahead before running free.
    ///
    /// # Errors
    /// The first reason against it.
    pub fn verdict(&self) -> Result<GateFigures, Refusal> {
        if let Some(refusal) = &self.broken {
            return Err(refusal.clone());
        }
        self.judge_effort()?;
        // A candidate that tracks nothing runs, before it joins, the steps that it has missed: not to be judged.
        let phases = if self.tracks { &[Phase::Tracking, Phase::Free][..] } else { &[Phase::Free] };
        for &phase in phases {
            for (axis, measure) in self.axes.iter().zip(self.of(phase)) {
                measure.judge(&self.limits, phase, axis.name, self.last_ns)?;
            }
        }
        Ok(self.figures())
    }

    fn judge_effort(&self) -> Result<(), Refusal> {
        if self.missed > self.missed_max {
            let (missed, limit, at_ns) = (self.missed, self.missed_max, self.first_miss_ns);
            return Err(Refusal::MissedDeadlines { missed, limit, at_ns });
        }
        let limit = self.limits.instants_min;
        for phase in [Phase::Tracking, Phase::Free] {
            let seen = self.seen(phase);
            if seen < limit && (self.tracks || phase == Phase::Free) {
                return Err(Refusal::TooFew { phase, seen, limit });
            }
        }
        Ok(())
    }
}

fn refuse_value(axis: &Axis, value: f64, at_ns: u64) -> Option<Refusal> {
    let Axis { name: axis, min, max } = *axis;
    if !value.is_finite() {
        return Some(Refusal::NotFinite { axis, value, at_ns });
    }
    (value < min || value > max).then_some(Refusal::OutOfBounds { axis, value, min, max, at_ns })
}

#[cfg(test)]
mod tests;
