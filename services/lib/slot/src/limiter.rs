//! Takes the step out of a change of kind.
//!
//! Two controllers of different kinds disagree about the command for the same instant, however well
//! the new one has been prepared. What the difference `d = u_new(T) − u_old(T)` has beyond ±limit is
//! taken out of the new one's commands at T and let back in linearly:
//!
//! ```text
//!   u(t) = u_new(t) − e (1 − (t − T)/D),   e = d − clamp(d, ±limit),   T ≤ t < T + D
//! ```

shared_types::memory! {
    /// A [`Limiter`]'s memory as plain numbers.
    #[derive(PartialEq)]
    pub struct LimiterMemory {
        /// What was taken out at T, in the command's units.
        pub excess: [f64; 4],
        /// T \[ns\].
        pub since_ns: u64,
    }
}

/// The limiter of one slot's consumer.
#[derive(Debug, Clone, PartialEq)]
pub struct Limiter {
    limit: [f64; 4],
    over_ns: u64,
    memory: LimiterMemory,
}

impl Limiter {
    /// Lets a difference of ±`limit` per axis (in the command's units) through at once and the rest
    /// over the time `over_ns`.
    #[must_use]
    pub fn new(limit: [f64; 4], over_ns: u64) -> Self {
        Self { limit, over_ns, memory: LimiterMemory::default() }
    }

    /// A change of kind at `now_ns`, from what would have been commanded to what is now. Numbers
    /// that are not finite engage nothing.
    pub fn engage(&mut self, now_ns: u64, u_old: &[f64; 4], u_new: &[f64; 4]) {
        let mut excess = [0.0; 4];
        for (axis, excess) in excess.iter_mut().enumerate() {
            let d = u_new[axis] - u_old[axis];
            let limit = self.limit[axis].max(0.0);
            if d.is_finite() && d.abs() > limit {
                *excess = d - d.clamp(-limit, limit);
            }
        }
        self.memory = LimiterMemory { excess, since_ns: now_ns };
    }

    /// The command to apply at `now_ns` in place of `u`; the same bits where nothing is taken out.
    #[must_use]
    pub fn apply(&self, now_ns: u64, u: &[f64; 4]) -> [f64; 4] {
        let age_ns = now_ns.saturating_sub(self.memory.since_ns);
        if age_ns >= self.over_ns {
            return *u;
        }
        let share = 1.0 - age_ns as f64 / self.over_ns as f64;
        let mut limited = *u;
        for (u, excess) in limited.iter_mut().zip(self.memory.excess) {
            if excess.abs() > 0.0 {
                *u -= excess * share;
            }
        }
        limited
    }

    /// True if it still changes commands at `now_ns`.
    #[must_use]
    pub fn is_engaged(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.memory.since_ns) < self.over_ns
            && self.memory.excess.iter().any(|excess| excess.abs() > 0.0)
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> LimiterMemory {
        self.memory
    }

    /// Continues from a memory.
    pub fn restore(&mut self, memory: &LimiterMemory) {
        self.memory = *memory;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMIT: [f64; 4] = [1.0, 0.1, 0.1, 0.02];

    #[test]
    fn a_difference_within_the_limit_leaves_every_bit_alone() {
        let mut limiter = Limiter::new(LIMIT, 100);
        limiter.engage(0, &[5.0, 0.0, 0.0, 0.0], &[5.9, 0.1, -0.1, -0.019]);
        for now_ns in [0, 1, 50, 99, 100] {
            let u = [5.9, -0.0, f64::MIN_POSITIVE, 1e300];
            assert_eq!(limiter.apply(now_ns, &u).map(f64::to_bits), u.map(f64::to_bits));
        }
        assert!(!limiter.is_engaged(0));
    }

    #[test]
    fn the_rest_of_the_difference_comes_back_along_a_line() {
        let mut limiter = Limiter::new(LIMIT, 100);
        limiter.engage(1000, &[0.0; 4], &[3.0, -0.5, 0.0, 0.0]);
        let u = [3.0, -0.5, 0.0, 0.0];
        let near = |at_ns: u64, expected: [f64; 2]| {
            let applied = limiter.apply(at_ns, &u);
            assert!((applied[0] - expected[0]).abs() < 1e-12, "{applied:?} at {at_ns}");
            assert!((applied[1] - expected[1]).abs() < 1e-12, "{applied:?} at {at_ns}");
        };
        near(1000, [1.0, -0.1]);
        near(1025, [1.5, -0.2]);
        near(1050, [2.0, -0.3]);
        near(1100, [3.0, -0.5]);
        assert!(limiter.is_engaged(1099) && !limiter.is_engaged(1100));
    }

    #[test]
    fn numbers_that_are_not_finite_engage_nothing() {
        let mut limiter = Limiter::new(LIMIT, 100);
        limiter.engage(0, &[f64::NAN, 0.0, 0.0, 0.0], &[1.0, f64::INFINITY, 5.0, 0.0]);
        let applied = limiter.apply(0, &[1.0, 2.0, 5.0, 0.0]);
        assert_eq!(applied[..2], [1.0, 2.0]);
        assert!((applied[2] - 0.1).abs() < 1e-12);
    }

    #[test]
    fn no_time_to_come_back_means_no_limiter() {
        let mut limiter = Limiter::new(LIMIT, 0);
        limiter.engage(0, &[0.0; 4], &[9.0; 4]);
        assert_eq!(limiter.apply(0, &[9.0; 4]).map(f64::to_bits), [9.0_f64.to_bits(); 4]);
    }

    proptest! {
        #[test]
        fn the_step_at_the_flip_is_never_more_than_the_limit(
            old in prop::array::uniform4(-10.0..10.0f64),
            new in prop::array::uniform4(-10.0..10.0f64),
            age_ns in 0..300_u64,
        ) {
            let mut limiter = Limiter::new(LIMIT, 200);
            limiter.engage(7, &old, &new);
            let at_flip = limiter.apply(7, &new);
            let later = limiter.apply(7 + age_ns, &new);
            for axis in 0..4 {
                prop_assert!((at_flip[axis] - old[axis]).abs() <= LIMIT[axis] + 1e-12);
                // On the way it stays between where it was at T and where it is going.
                let (low, high) = (at_flip[axis].min(new[axis]), at_flip[axis].max(new[axis]));
                prop_assert!(later[axis] >= low - 1e-12 && later[axis] <= high + 1e-12);
            }
        }
    }
}
