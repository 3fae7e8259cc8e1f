//! Whether a shadow may fly: its commands beside the owner's, for the same effective instants.
//!
//! While a candidate of another kind *tracks*, it is reset before each step to continue from what
//! was applied, so its disagreement is that of one step. Then it runs *free*: what it would do if it
//! flew is seen there, and only there do a wrong sign and a wrong gain show. A candidate of the same
//! kind restores the owner's state and is free from the start.
//!
//! All disagreement is `|u_candidate − u_owner|` per axis over `u_max`.

mod limits;
mod refusal;

pub use limits::{Axis, GateLimits};
pub use refusal::Refusal;

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
}

/// A disagreement and where it was.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Worst {
    /// Over `u_max`.
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
    /// Worst disagreement running free.
    pub free_worst: [Worst; 4],
    /// Its root mean square, over `u_max`.
    pub free_rms: [f64; 4],
    /// Slope of the candidate's free commands over the owner's; `None` where the owner was quiet.
    pub slope: [Option<f64>; 4],
    /// Deadlines missed.
    pub missed: u64,
}

/// Running sums of one axis over the free window, in units of `u_max`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Sums {
    owner: f64,
    candidate: f64,
    owner_squared: f64,
    product: f64,
    difference_squared: f64,
}

impl Sums {
    fn add(&mut self, candidate: f64, owner: f64) {
        self.owner += owner;
        self.candidate += candidate;
        self.owner_squared += owner * owner;
        self.product += owner * candidate;
        self.difference_squared += (candidate - owner) * (candidate - owner);
    }

    fn rms(&self, count: f64) -> f64 {
        (self.difference_squared / count).sqrt()
    }

    /// Least-squares slope of candidate over owner, if the owner moves by `activity` or more.
    fn slope(&self, count: f64, activity: f64) -> Option<f64> {
        let variance = (self.owner_squared - self.owner * self.owner / count) / count;
        let covariance = (self.product - self.owner * self.candidate / count) / count;
        (variance >= activity * activity && variance > 0.0).then(|| covariance / variance)
    }
}

/// The gate of one shadow window.
#[derive(Debug, Clone, PartialEq)]
pub struct Gate {
    axes: [Axis; 4],
    limits: GateLimits,
    /// Whether there is a tracking phase at all.
    tracks: bool,
    figures: GateFigures,
    sums: [Sums; 4],
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
            figures: GateFigures::default(),
            sums: [Sums::default(); 4],
            last_ns: 0,
            first_miss_ns: 0,
            broken: None,
        }
    }

    /// Compares the commands for one effective instant. Where the owner's is not finite there is
    /// nothing to compare with, but the candidate's is still judged.
    ///
    /// # Errors
    /// The candidate did what no controller may do; the verdict will say the same.
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
        let (count, worst) = match phase {
            Phase::Tracking => (&mut self.figures.tracked, &mut self.figures.tracking_worst),
            Phase::Free => (&mut self.figures.free, &mut self.figures.free_worst),
        };
        *count += 1;
        for (i, axis) in self.axes.iter().enumerate() {
            let scale = 1.0 / axis.u_max().max(f64::MIN_POSITIVE);
            let (candidate, owner) = (pair.candidate[i] * scale, pair.owner[i] * scale);
            let value = (candidate - owner).abs();
            if value > worst[i].value {
                worst[i] = Worst { value, at_ns: pair.effective_ns };
            }
            if phase == Phase::Free {
                self.sums[i].add(candidate, owner);
            }
        }
        Ok(())
    }

    /// The candidate gave no command for an instant in time.
    pub fn miss(&mut self, at_ns: u64) {
        if self.figures.missed == 0 {
            self.first_miss_ns = at_ns;
        }
        self.figures.missed += 1;
    }

    /// What has been measured so far.
    #[must_use]
    pub fn figures(&self) -> GateFigures {
        let count = self.figures.free.max(1) as f64;
        GateFigures {
            free_rms: self.sums.map(|sums| sums.rms(count)),
            slope: self.sums.map(|sums| sums.slope(count, self.limits.activity_min)),
            ..self.figures
        }
    }

    /// Whether the candidate may fly. What no controller may do is told first, then missing
    /// deadlines, then disagreement, one step ahead before running free.
    ///
    /// # Errors
    /// The first reason against it.
    pub fn verdict(&self) -> Result<GateFigures, Refusal> {
        if let Some(refusal) = &self.broken {
            return Err(refusal.clone());
        }
        let figures = self.figures();
        self.judge_effort(&figures)?;
        self.judge_instants(Phase::Tracking, &figures.tracking_worst, self.limits.tracking)?;
        self.judge_slopes(&figures)?;
        self.judge_instants(Phase::Free, &figures.free_worst, self.limits.free_peak)?;
        self.judge_rms(&figures)?;
        Ok(figures)
    }

    fn judge_effort(&self, figures: &GateFigures) -> Result<(), Refusal> {
        let limit = self.limits.missed_max;
        if figures.missed > limit {
            let (missed, at_ns) = (figures.missed, self.first_miss_ns);
            return Err(Refusal::MissedDeadlines { missed, limit, at_ns });
        }
        let limit = self.limits.instants_min;
        if self.tracks && figures.tracked < limit {
            return Err(Refusal::TooFew { phase: Phase::Tracking, seen: figures.tracked, limit });
        }
        if figures.free < limit {
            return Err(Refusal::TooFew { phase: Phase::Free, seen: figures.free, limit });
        }
        Ok(())
    }

    fn judge_instants(&self, phase: Phase, all: &[Worst; 4], limit: f64) -> Result<(), Refusal> {
        for (axis, worst) in self.axes.iter().zip(all) {
            if worst.value > limit {
                let Worst { value, at_ns } = *worst;
                return Err(Refusal::TooFar { phase, axis: axis.name, value, limit, at_ns });
            }
        }
        Ok(())
    }

    fn judge_slopes(&self, figures: &GateFigures) -> Result<(), Refusal> {
        let (min, max) = (self.limits.slope_min, self.limits.slope_max);
        for (axis, slope) in self.axes.iter().zip(figures.slope) {
            if let Some(value) = slope.filter(|slope| !(min..=max).contains(slope)) {
                let at_ns = self.last_ns;
                return Err(Refusal::WrongSlope { axis: axis.name, value, min, max, at_ns });
            }
        }
        Ok(())
    }

    fn judge_rms(&self, figures: &GateFigures) -> Result<(), Refusal> {
        for (axis, value) in self.axes.iter().zip(figures.free_rms) {
            let (limit, at_ns) = (self.limits.free_rms, self.last_ns);
            if value > limit {
                return Err(Refusal::TooFarOnTheWhole { axis: axis.name, value, limit, at_ns });
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
