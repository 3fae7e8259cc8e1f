//! Detects oscillations by counting sign reversals at large amplitude.

/// Reversals within the window that count as an oscillation: three whole periods. The response to a step
/// or to a kick has one or two.
pub(crate) const REVERSALS: usize = 6;

shared_types::memory! {
    /// State of the oscillation detector of one axis.
    #[derive(PartialEq)]
    pub struct SwingMemory {
        /// Instants of the last reversals, oldest first; 0 for none \[ns\].
        pub at_ns: [u64; 6],
        /// Sign of the last large amplitude: -1, 1, or 0 for none yet.
        pub side: f64,
    }
}

/// Oscillation detector of one quantity.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Swings(SwingMemory);

impl Swings {
    /// Takes the quantity at `now_ns`; only values beyond ±`amplitude`, in the same unit, count. True while
    /// the last [`REVERSALS`] reversals lie within `window_ns`.
    pub(crate) fn see(&mut self, now_ns: u64, value: f64, amplitude: f64, window_ns: u64) -> bool {
        if value.abs() > amplitude {
            let side = 1.0_f64.copysign(value);
            if side * self.0.side < 0.0 {
                self.0.at_ns.rotate_left(1);
                self.0.at_ns[REVERSALS - 1] = now_ns;
            }
            self.0.side = side;
        }
        let oldest_ns = self.0.at_ns[0];
        oldest_ns > 0 && now_ns.saturating_sub(oldest_ns) <= window_ns
    }

    pub(crate) fn memory(self) -> SwingMemory {
        self.0
    }

    pub(crate) fn restored(memory: &SwingMemory) -> Self {
        Self(*memory)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Instant at which a sine of this frequency is detected as an oscillation \[ms\], within two seconds.
    fn called(frequency_hz: f64, amplitude: f64) -> Option<u64> {
        let mut swings = Swings::default();
        (0..200).map(|k| 10 * k).find(|ms| {
            let phase = core::f64::consts::TAU * frequency_hz * *ms as f64 * 1e-3;
            swings.see(ms * MS, amplitude * libm::sin(phase), 2.0, 1000 * MS)
        })
    }

    #[test]
    fn six_large_reversals_within_a_second_are_an_oscillation() {
        assert!(called(5.0, 3.0).is_some_and(|ms| (500..800).contains(&ms)));
        assert_eq!(called(5.0, 1.9), None, "it never gets to a side");
        assert_eq!(called(2.0, 9.0), None, "it is too slow");
    }
}
