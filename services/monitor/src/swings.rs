//! Detects oscillations by counting sign reversals at large amplitude.

/// Most reversals that an oscillation consists of.
const REVERSALS_MAX: usize = 6;

/// Longest time from one side to the other that is part of an oscillation \[ns\]: half a period of 0.75 Hz.
const SIDE_NS: u64 = 667_000_000;

/// So many reversals within a window are an oscillation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Oscillation {
    /// At least 1 and at most [`REVERSALS_MAX`].
    pub(crate) reversals: usize,
    pub(crate) window_ns: u64,
}

shared_types::memory! {
    /// State of the oscillation detector of one axis.
    #[derive(PartialEq)]
    pub struct SwingMemory {
        /// Instants of the last reversals, oldest first; 0 for none \[ns\].
        pub at_ns: [u64; 6],
        /// Sign of the last large amplitude: -1, 1, or 0 for none yet.
        pub side: f64,
        /// When that was \[ns\].
        pub side_ns: u64,
    }
}

/// Oscillation detector of one quantity.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Swings(SwingMemory);

impl Swings {
    /// Takes the quantity at `now_ns`; only values beyond ±`amplitude`, in the same unit, count.
    pub(crate) fn see(&mut self, now_ns: u64, value: f64, amplitude: f64) {
        if value.abs() > amplitude {
            let side = 1.0_f64.copysign(value);
            let is_recent = now_ns.saturating_sub(self.0.side_ns) <= SIDE_NS;
            if side * self.0.side < 0.0 && is_recent {
                self.0.at_ns.rotate_left(1);
                self.0.at_ns[REVERSALS_MAX - 1] = now_ns;
            }
            (self.0.side, self.0.side_ns) = (side, now_ns);
        }
    }

    /// True while the last reversals lie so close together at `now_ns`.
    pub(crate) fn are(&self, oscillation: &Oscillation, now_ns: u64) -> bool {
        let first = REVERSALS_MAX.saturating_sub(oscillation.reversals);
        let first_ns = self.0.at_ns.get(first).copied().unwrap_or(0);
        first_ns > 0 && now_ns.saturating_sub(first_ns) <= oscillation.window_ns
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

    /// Instant at which a sine of this frequency is such an oscillation \[ms\], within two seconds.
    fn called(oscillation: &Oscillation, frequency_hz: f64, amplitude: f64) -> Option<u64> {
        let mut swings = Swings::default();
        (0..200).map(|k| 10 * k).find(|ms| {
            let phase = core::f64::consts::TAU * frequency_hz * *ms as f64 * 1e-3;
            swings.see(ms * MS, amplitude * libm::sin(phase), 2.0);
            swings.are(oscillation, ms * MS)
        })
    }

    #[test]
    fn so_many_large_reversals_within_the_window_are_an_oscillation() {
        let slow = Oscillation { reversals: 6, window_ns: 1000 * MS };
        assert!(called(&slow, 5.0, 3.0).is_some_and(|ms| (500..800).contains(&ms)));
        assert_eq!(called(&slow, 5.0, 1.9), None, "it never gets to a side");
        assert_eq!(called(&slow, 2.0, 9.0), None, "it is too slow");
        let fast = Oscillation { reversals: 2, window_ns: 250 * MS };
        assert!(called(&fast, 2.5, 3.0).is_some_and(|ms| (350..500).contains(&ms)));
        assert_eq!(called(&fast, 1.9, 9.0), None, "it is too slow");
        let mut swings = Swings::default();
        for (ms, value) in [(0, 3.0), (2000, -3.0), (2200, 3.0)] {
            swings.see(ms * MS, value, 2.0);
            assert!(!swings.are(&fast, ms * MS), "what was long ago is no side of it");
        }
    }
}
