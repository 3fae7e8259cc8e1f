//! What the gate compares, and what it allows.

/// One coordinate of a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Its name, with unit, for messages.
    pub name: &'static str,
    /// Least a command may be.
    pub min: f64,
    /// Most a command may be.
    pub max: f64,
}

/// What a candidate must keep to. Disagreements are over the largest command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GateLimits {
    /// Root mean square of the disagreement, plus `rms_of_activity` of the owner's own standard
    /// deviation.
    pub rms: f64,
    /// See `rms`.
    pub rms_of_activity: f64,
    /// Largest disagreement, plus `peak_of_swing` of the owner's own largest departure from its mean.
    pub peak: f64,
    /// See `peak`.
    pub peak_of_swing: f64,
    /// As many times as this share of the instants, and once, the disagreement may be more than `peak`
    /// for as long as `block_ns`.
    pub outlier_share: f64,
    /// Most it may be there.
    pub outlier: f64,
    /// Mean of the disagreement, by more than its margin.
    pub bias: f64,
    /// Least slope of the candidate's free commands over the owner's, by more than its margin.
    pub slope_min: f64,
    /// Most of it.
    pub slope_max: f64,
    /// Standard deviation of the owner's free commands, over the largest, below which a slope would be
    /// that of a settling tail or of rounding and is not asked.
    pub activity_min: f64,
    /// Commands are averaged over this time before the slope is asked, and a loop that was off may be so for as
    /// long \[ns\].
    pub block_ns: u64,
    /// Fewest instants to compare in each phase that there is.
    pub instants_min: u64,
}

impl GateLimits {
    /// A new instance of the owner's kind, from the owner's state: the design's 1 %. In lockstep it
    /// agrees to the bit.
    pub const SAME_KIND: Self = Self {
        rms: 0.01,
        rms_of_activity: 0.0,
        peak: 0.01,
        peak_of_swing: 0.0,
        outlier_share: 0.0,
        outlier: 0.0,
        bias: 0.01,
        slope_min: f64::NEG_INFINITY,
        slope_max: f64::INFINITY,
        activity_min: f64::INFINITY,
        block_ns: 50_000_000,
        instants_min: 10,
    };

    /// Another kind: the design's 10 %, as the typical disagreement; the limiter sees to the step at
    /// the flip itself. Two good controllers differ by their bandwidths, so where the owner works hard
    /// they may differ in proportion, for a moment from one bound to the other. In the long run they
    /// hold the same loads: a lasting difference is a fault at half the size. What is wrong with sign or
    /// gain is small in quiet flight, so there slopes are asked: of commands averaged over 50 ms, for
    /// one controller passes on noise that another smooths; and of changes since the owner's last
    /// command, of which the sign must be the same. The shipped controllers have slopes of 0.25 to 2.5
    /// against one another, and `tests/integration/shadow.rs` flies good and bad ones against these numbers.
    pub const OTHER_KIND: Self = Self {
        rms: 0.10,
        rms_of_activity: 1.5,
        peak: 0.30,
        peak_of_swing: 2.0,
        bias: 0.05,
        slope_min: 0.1,
        slope_max: 2.75,
        activity_min: 5e-4,
        ..Self::SAME_KIND
    };

    /// In realtime one of the two may now and then step without its newest inputs, and is somewhere
    /// else for an instant.
    #[must_use]
    pub fn patient(self) -> Self {
        Self { outlier_share: 0.02, outlier: self.outlier.max(0.30), ..self }
    }

    /// A disagreement that a user allows, whatever the owner does.
    #[must_use]
    pub fn within(self, max_bump: f64) -> Self {
        let share = max_bump / self.rms;
        Self {
            rms: max_bump,
            rms_of_activity: 0.0,
            peak: share * self.peak,
            peak_of_swing: 0.0,
            bias: share * self.bias,
            ..self
        }
    }
}
