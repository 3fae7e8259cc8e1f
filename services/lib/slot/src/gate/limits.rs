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

impl Axis {
    /// Largest size of a command, the unit of disagreement.
    #[must_use]
    pub fn u_max(&self) -> f64 {
        self.min.abs().max(self.max.abs())
    }
}

/// What a candidate must keep to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GateLimits {
    /// Largest disagreement one step ahead, over `u_max`.
    pub tracking: f64,
    /// Root mean square of the disagreement while running free, over `u_max`.
    pub free_rms: f64,
    /// Largest disagreement while running free, over `u_max`.
    pub free_peak: f64,
    /// Least slope of the candidate's free commands over the owner's; not asked if they are to be
    /// equal anyway.
    pub slope_min: f64,
    /// Most of it.
    pub slope_max: f64,
    /// Standard deviation of the owner's free commands, over `u_max`, below which a slope would be
    /// that of rounding and is not asked.
    pub activity_min: f64,
    /// Fewest instants to compare in each phase that there is.
    pub instants_min: u64,
    /// Deadlines that may be missed.
    pub missed_max: u64,
}

impl GateLimits {
    /// A new instance of the owner's kind, from the owner's state: the design's 1 %. In lockstep it
    /// agrees to the bit.
    pub const SAME_KIND: Self = Self {
        tracking: 0.01,
        free_rms: 0.01,
        free_peak: 0.01,
        slope_min: f64::NEG_INFINITY,
        slope_max: f64::INFINITY,
        activity_min: f64::INFINITY,
        instants_min: 10,
        missed_max: 0,
    };

    /// Another kind. One step ahead the design's 10 %. Running free, the flip comes at an instant
    /// like any other, so the *typical* disagreement must be within the bump that is allowed there
    /// (10 % rms) and the worst within thrice that: in a manoeuvre two good controllers differ by
    /// their bandwidths for a moment. Such a difference is small in quiet flight whatever the sign,
    /// so the slope is asked too: controllers whose bandwidths differ by two have slopes around 1/4
    /// and 4 at the edges, a wrong sign has a negative one, and a gain wrong by ten lies outside.
    /// `tests/shadow.rs` flies good and bad ones against these numbers.
    pub const OTHER_KIND: Self = Self {
        tracking: 0.10,
        free_rms: 0.10,
        free_peak: 0.30,
        slope_min: 0.2,
        slope_max: 5.0,
        activity_min: 1e-4,
        instants_min: 10,
        missed_max: 0,
    };
}
