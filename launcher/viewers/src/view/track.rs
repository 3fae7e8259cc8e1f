//! A vector over time in bounded memory, for a moving picture.

/// Frames at most; at twice as many, every second one is dropped.
const FRAMES: usize = 8192;
/// Time between frames at first \[ns\].
const STEP_NS: u64 = 10_000_000;

/// The first value of each step of time; steps without one keep the value before.
#[derive(Debug, Clone)]
pub(super) struct Track<const N: usize> {
    step_ns: u64,
    frames: Vec<Option<[f32; N]>>,
}

impl<const N: usize> Default for Track<N> {
    fn default() -> Self {
        Self { step_ns: STEP_NS, frames: Vec::new() }
    }
}

impl<const N: usize> Track<N> {
    /// Takes a value at an instant since the beginning of the picture.
    #[expect(clippy::cast_possible_truncation, reason = "a picture needs no more than 24 bits")]
    pub(super) fn put(&mut self, since_ns: u64, value: [f64; N]) {
        if !value.iter().all(|v| v.is_finite()) {
            return;
        }
        let index = |step_ns: u64| usize::try_from(since_ns / step_ns).unwrap_or(usize::MAX);
        while index(self.step_ns) >= 2 * FRAMES {
            self.coarsen();
        }
        let index = index(self.step_ns);
        if self.frames.len() <= index {
            self.frames.resize(index + 1, None);
        }
        self.frames[index].get_or_insert(value.map(|v| v as f32));
    }

    fn coarsen(&mut self) {
        self.frames =
            self.frames.chunks(2).map(|pair| pair.iter().flatten().next().copied()).collect();
        self.step_ns = self.step_ns.saturating_mul(2);
    }

    /// Time between frames \[ns\].
    pub(super) fn step_ns(&self) -> u64 {
        self.step_ns
    }

    /// Number of frames.
    pub(super) fn len(&self) -> usize {
        self.frames.len()
    }

    /// Frames `first` to `end`, `step_ns` apart, one after the other; none if there never was a value.
    pub(super) fn values(&self, step_ns: u64, first: usize, end: usize) -> Vec<f32> {
        let Some(mut last) = self.frames.iter().flatten().next().copied() else {
            return Vec::new();
        };
        let merged = usize::try_from(step_ns / self.step_ns).unwrap_or(1).max(1);
        let at = |i: usize| {
            let frames = self.frames.get(i * merged..)?;
            frames.iter().take(merged).flatten().next().copied()
        };
        last = (0..first).rev().find_map(at).unwrap_or(last);
        let held = (first..end).map(|i| {
            last = at(i).unwrap_or(last);
            last
        });
        held.flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{FRAMES, STEP_NS, Track};

    #[test]
    fn frames_hold_until_the_next_and_tracks_of_different_length_share_a_step() {
        let mut seldom = Track::<2>::default();
        seldom.put(STEP_NS, [1.0, 2.0]);
        seldom.put(3 * STEP_NS, [3.0, 4.0]);
        let values = seldom.values(STEP_NS, 0, 5);
        assert_eq!(values, [1.0, 2.0, 1.0, 2.0, 1.0, 2.0, 3.0, 4.0, 3.0, 4.0]);
        assert_eq!(seldom.values(STEP_NS, 2, 4), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(seldom.values(2 * STEP_NS, 0, 2), [1.0, 2.0, 3.0, 4.0]);
        assert!(Track::<2>::default().values(STEP_NS, 0, 3).is_empty());
    }

    #[test]
    fn an_hour_takes_no_more_memory_than_a_minute() {
        let mut track = Track::<1>::default();
        for i in 0..3_600_000_u64 {
            track.put(i * 1_000_000, [i as f64]);
        }
        assert!(track.len() <= 2 * FRAMES, "{}", track.len());
        let step_ns = track.step_ns();
        let count = track.len();
        let values = track.values(step_ns, 0, count);
        let exact = |(i, value): (usize, &f32)| {
            value.to_bits() == ((i as u64 * step_ns / 1_000_000) as f32).to_bits()
        };
        assert!(values.iter().enumerate().all(exact));
    }
}
