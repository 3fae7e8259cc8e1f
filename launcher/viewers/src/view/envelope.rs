//! A time series in bounded memory that keeps every peak.

/// Bins at most; at twice as many, neighbours are merged.
const BINS: usize = 2048;

/// Least and greatest value in equal intervals of time, which grow with the flight.
///
/// As long as no two values share an interval the series is as recorded. Peaks never vanish: merging keeps
/// the least and the greatest of both.
#[derive(Debug, Clone, Default)]
pub(crate) struct Envelope {
    /// First instant; until then nothing has been put.
    origin_ns: Option<u64>,
    /// Width of a bin; 0 until the second value gives the spacing.
    width_ns: u64,
    /// Least and greatest; of no value, NaN.
    bins: Vec<[f32; 2]>,
    merged: bool,
}

impl Envelope {
    /// Takes a value; one that is not finite is left out.
    #[expect(clippy::cast_possible_truncation, reason = "a picture needs no more than 24 bits")]
    pub(super) fn put(&mut self, t_ns: u64, value: f64) {
        if !value.is_finite() {
            return;
        }
        let value = value as f32;
        let Some(origin_ns) = self.origin_ns else {
            self.origin_ns = Some(t_ns);
            self.bins.push([value; 2]);
            return;
        };
        let since_ns = t_ns.saturating_sub(origin_ns);
        if self.width_ns == 0 {
            if since_ns == 0 {
                return self.put_at(0, value);
            }
            self.width_ns = since_ns;
        }
        let index = |width_ns: u64| usize::try_from(since_ns / width_ns).unwrap_or(usize::MAX);
        while index(self.width_ns) >= 2 * BINS {
            self.coarsen();
        }
        self.put_at(index(self.width_ns), value);
    }

    fn put_at(&mut self, index: usize, value: f32) {
        if self.bins.len() <= index {
            self.bins.resize(index + 1, [f32::NAN; 2]);
        }
        let [low, high] = &mut self.bins[index];
        self.merged |= !low.is_nan() && (*low, *high) != (value, value);
        (*low, *high) = (low.min(value), high.max(value));
    }

    fn coarsen(&mut self) {
        let merged = self.bins.chunks(2).map(|pair| {
            let [mut low, mut high] = pair[0];
            if let Some([other_low, other_high]) = pair.get(1) {
                // The least of a number and NaN is the number.
                (low, high) = (low.min(*other_low), high.max(*other_high));
            }
            [low, high]
        });
        self.bins = merged.collect();
        self.width_ns = self.width_ns.saturating_mul(2);
        self.merged = true;
    }

    /// First instant \[ns\], width of a bin \[ns\], and least and greatest of each.
    pub(super) fn bins(&self) -> (u64, u64, &[[f32; 2]]) {
        (self.origin_ns.unwrap_or(0), self.width_ns, &self.bins)
    }

    /// Middle of each bin \[s\], its least and its greatest; of a series that is as recorded, the instant.
    pub(crate) fn intervals(&self) -> impl Iterator<Item = (f64, f64, f64)> {
        let (origin_ns, width_ns, bins) = self.bins();
        let middle = if self.merged { 0.5 } else { 0.0 };
        let time_s =
            move |i: usize| (origin_ns as f64 + (i as f64 + middle) * width_ns as f64) * 1e-9;
        let seen = bins.iter().enumerate().filter(|(_, [low, _])| !low.is_nan());
        seen.map(move |(i, [low, high])| (time_s(i), f64::from(*low), f64::from(*high)))
    }

    /// Corners of a line that touches least and greatest of at most `most` bins, of each first the one that is
    /// closer to where the line comes from.
    pub(crate) fn points(&self, most: usize) -> Vec<[f64; 2]> {
        let mut coarse = self.clone();
        while coarse.bins.len() > most.max(1) {
            coarse.coarsen();
        }
        let quarter_s = coarse.width_ns as f64 * 0.25e-9;
        let mut points: Vec<[f64; 2]> = Vec::with_capacity(2 * coarse.bins.len());
        for (t, low, high) in coarse.intervals() {
            let from = points.last().map_or(low, |[_, value]| *value);
            let falls = (from - high).abs() < (from - low).abs();
            let (first, second) = if falls { (high, low) } else { (low, high) };
            if high > low {
                points.extend([[t - quarter_s, first], [t + quarter_s, second]]);
            } else {
                points.push([t, low]);
            }
        }
        points
    }

    /// False if every bin has one value.
    pub(super) fn is_merged(&self) -> bool {
        self.merged
    }
}

#[cfg(test)]
mod tests {
    use super::{BINS, Envelope};

    #[test]
    fn a_series_that_fits_is_as_recorded() {
        let mut envelope = Envelope::default();
        for i in 0..2 * BINS as u64 {
            envelope.put(5_000_000 + i * 10_000_000, i as f64);
        }
        let (origin_ns, width_ns, bins) = envelope.bins();
        assert_eq!((origin_ns, width_ns, envelope.is_merged()), (5_000_000, 10_000_000, false));
        let exact = |i: usize| bins[i].map(f32::to_bits) == [(i as f32).to_bits(); 2];
        assert!((0..2 * BINS).all(exact));
    }

    #[test]
    fn a_single_peak_survives_any_number_of_mergers_at_its_time() {
        let mut envelope = Envelope::default();
        let (peak_at, samples) = (777_777_u64, 1_000_000_u64);
        for i in 0..samples {
            envelope.put(i * 1_000_000, if i == peak_at { 9.0 } else { (i % 2) as f64 });
        }
        let (_, width_ns, bins) = envelope.bins();
        assert!(bins.len() <= 2 * BINS && envelope.is_merged());
        let peaks: Vec<_> = (0..bins.len()).filter(|i| bins[*i][1] > 1.0).collect();
        assert_eq!(peaks, [usize::try_from(peak_at * 1_000_000 / width_ns).unwrap()]);
        assert!(bins.iter().all(|[low, _]| *low == 0.0));
    }

    #[test]
    fn a_line_on_paper_keeps_the_peaks_too() {
        let mut envelope = Envelope::default();
        for i in 0..3000_u64 {
            envelope.put(i * 1_000_000, if i == 1234 { -7.0 } else { 1.0 });
        }
        let points = envelope.points(100);
        assert!(points.len() <= 102, "{}", points.len());
        let peak: Vec<_> = points.iter().filter(|[_, value]| *value < 0.0).collect();
        assert!(peak.len() == 1 && (peak[0][0] - 1.234).abs() < 0.03, "{peak:?}");
        assert_eq!(envelope.intervals().count(), 3000);
        assert_eq!(envelope.intervals().nth(2), Some((0.002, 1.0, 1.0)));
    }

    #[test]
    fn a_line_on_paper_that_rises_and_falls_does_not_go_back() {
        let mut envelope = Envelope::default();
        for i in 0..2000_u64 {
            envelope.put(i * 1_000_000, if i < 1000 { i as f64 } else { 2000.0 - i as f64 });
        }
        let values: Vec<f64> = envelope.points(50).into_iter().map(|[_, value]| value).collect();
        let turns = values.windows(3).filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0);
        assert!(turns.count() <= 2, "{values:?}");
    }

    #[test]
    fn gaps_stay_empty_and_what_is_no_number_is_left_out() {
        let mut envelope = Envelope::default();
        envelope.put(0, 1.0);
        envelope.put(0, 3.0);
        envelope.put(10, f64::NAN);
        envelope.put(10, 2.0);
        envelope.put(30, f64::INFINITY);
        envelope.put(40, 4.0);
        let (_, width_ns, bins) = envelope.bins();
        assert_eq!((width_ns, bins.len()), (10, 5));
        assert_eq!((bins[0], bins[1], bins[4]), ([1.0, 3.0], [2.0; 2], [4.0; 2]));
        assert!(bins[2][0].is_nan() && bins[3][1].is_nan());
    }
}
