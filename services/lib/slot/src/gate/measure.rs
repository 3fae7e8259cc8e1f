//! One axis over one part of the shadow window.

use super::fit::{Estimate, Fit};
use super::{GateLimits, Phase, Refusal, Worst};

/// Commands whose mean is one point of the slope.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Block {
    since_ns: u64,
    count: f64,
    sum: [f64; 2],
}

/// Everything in units of the largest command.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Measure {
    count: u64,
    worst: Worst,
    squares: f64,
    /// Times of a block's length with more than the largest disagreement, and when the last began.
    outliers: u64,
    outlier_ns: Option<u64>,
    /// Least and most of the owner's commands.
    range: Option<[f64; 2]>,
    /// Candidate over owner, each command.
    commands: Fit,
    /// The same of means over blocks.
    blocks: Fit,
    block: Block,
    /// The same of changes from block to block, which show a sign where levels wander too slowly.
    swings: Fit,
    last_means: Option<[f64; 2]>,
    /// The same of changes since the owner's last command.
    changes: Fit,
    last_owner: Option<f64>,
}

impl Measure {
    pub(super) fn add(&mut self, limits: &GateLimits, at_ns: u64, candidate: f64, owner: f64) {
        self.count += 1;
        let value = (candidate - owner).abs();
        self.squares += value * value;
        if value > self.worst.value {
            self.worst = Worst { value, at_ns };
        }
        let known = |since_ns: u64| at_ns.saturating_sub(since_ns) < limits.block_ns;
        if value > limits.peak && !self.outlier_ns.is_some_and(known) {
            self.outliers += 1;
            self.outlier_ns = Some(at_ns);
        }
        let [least, most] = self.range.unwrap_or([owner; 2]);
        self.range = Some([least.min(owner), most.max(owner)]);
        self.commands.add(owner, candidate);
        if let Some(last) = self.last_owner.replace(owner) {
            self.changes.add(owner - last, candidate - last);
        }
        let Block { since_ns, count, sum } = self.block;
        if count > 0.0 && at_ns.saturating_sub(since_ns) >= limits.block_ns {
            let [owner, candidate] = sum.map(|sum| sum / count);
            self.blocks.add(owner, candidate);
            if let Some([owner0, candidate0]) = self.last_means.replace([owner, candidate]) {
                self.swings.add(owner - owner0, candidate - candidate0);
            }
            self.block = Block::default();
        }
        let Block { since_ns, count, sum } = &mut self.block;
        if *count < 1.0 {
            *since_ns = at_ns;
        }
        *count += 1.0;
        sum[0] += owner;
        sum[1] += candidate;
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    pub(super) fn worst(&self) -> Worst {
        self.worst
    }

    pub(super) fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }

    pub(super) fn slope(&self, limits: &GateLimits) -> Option<Estimate> {
        self.blocks.slope(limits.activity_min)
    }

    /// The owner's largest departure from its mean.
    fn swing(&self) -> f64 {
        let mean = self.commands.mean();
        self.range.map_or(0.0, |[least, most]| (most - mean).max(mean - least))
    }

    /// Largest disagreement allowed: the owner's own swing adds to it.
    pub(super) fn peak_max(&self, limits: &GateLimits) -> f64 {
        limits.peak + limits.peak_of_swing * self.swing()
    }

    /// Largest root mean square allowed: the owner's own activity adds to it.
    pub(super) fn rms_max(&self, limits: &GateLimits) -> f64 {
        limits.rms + limits.rms_of_activity * self.commands.activity()
    }

    /// # Errors
    /// The first reason against the candidate.
    pub(super) fn judge(
        &self,
        limits: &GateLimits,
        phase: Phase,
        axis: &'static str,
        until_ns: u64,
    ) -> Result<(), Refusal> {
        if phase == Phase::Free {
            self.judge_slopes(limits, axis, until_ns)?;
        }
        let Worst { value, at_ns } = self.worst;
        let limit = self.peak_max(limits);
        let pardoned = limits.outlier_share > 0.0
            && self.outliers as f64 <= 1.0 + limits.outlier_share * self.count as f64
            && value <= limits.outlier;
        if value > limit && !pardoned {
            return Err(Refusal::TooFar { phase, axis, value, limit, at_ns });
        }
        let (value, limit) = (self.rms(), self.rms_max(limits));
        if value > limit {
            return Err(Refusal::TooFarOnTheWhole { phase, axis, value, limit, at_ns: until_ns });
        }
        let mean = self.commands.difference();
        if mean.value.abs() - mean.margin > limits.bias {
            let (value, limit) = (mean.value, limits.bias);
            return Err(Refusal::TooFarOnAverage { phase, axis, value, limit, at_ns: until_ns });
        }
        Ok(())
    }

    fn judge_slopes(
        &self,
        limits: &GateLimits,
        axis: &'static str,
        at_ns: u64,
    ) -> Result<(), Refusal> {
        let (min, max) = (limits.slope_min, limits.slope_max);
        if let Some(slope) = self.slope(limits)
            && (slope.most() < min || slope.least() > max)
        {
            let Estimate { value, margin } = slope;
            return Err(Refusal::WrongSlope { axis, value, margin, min, max, at_ns });
        }
        // A candidate that continues from what is applied has the owner's level whatever its sign.
        for changes in [&self.swings, &self.changes] {
            let slope = changes.slope(limits.activity_min).filter(|_| min.is_finite());
            if let Some(Estimate { value, margin }) = slope.filter(|slope| slope.most() < 0.0) {
                return Err(Refusal::WrongWay { axis, value, margin, at_ns });
            }
        }
        Ok(())
    }
}
