//! What two series have to do with one another, and how well that is known.
//!
//! Samples of a flight are not independent, so each figure has a margin of three standard errors, in
//! which series count as ones that remember (of order one): with the correlation ρ of neighbours a mean
//! of n is as uncertain as one of n (1 − ρ)/(1 + ρ), a slope with ρ of x times ρ of what is left over
//! (Bartlett).

/// Below this a difference of commands over the largest is that of their last digits.
const ROUNDING: f64 = 1e-9;

/// A figure and how far it can be off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Best guess.
    pub value: f64,
    /// Three standard errors; infinite if the series is too short to estimate it.
    pub margin: f64,
}

impl Estimate {
    /// The least it can be.
    #[must_use]
    pub fn least(&self) -> f64 {
        self.value - self.margin
    }

    /// The most it can be.
    #[must_use]
    pub fn most(&self) -> f64 {
        self.value + self.margin
    }
}

/// Running sums of two series, from which nothing has to be kept.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Fit {
    count: f64,
    /// Everything is counted from the first pair, or a steady thrust would drown its own noise.
    first: [f64; 2],
    last: [f64; 2],
    sum: [f64; 2],
    /// Σxx, Σxy, Σyy.
    product: [f64; 3],
    /// Σx(k)x(k+1), Σ(x(k)y(k+1) + y(k)x(k+1)), Σy(k)y(k+1).
    neighbours: [f64; 3],
}

impl Fit {
    pub(super) fn add(&mut self, x: f64, y: f64) {
        if self.count < 1.0 {
            self.first = [x, y];
        }
        let (x, y) = (x - self.first[0], y - self.first[1]);
        let [x0, y0] = self.last;
        self.count += 1.0;
        self.last = [x, y];
        for (sum, value) in self.sum.iter_mut().zip([x, y]) {
            *sum += value;
        }
        for (sum, value) in self.product.iter_mut().zip([x * x, x * y, y * y]) {
            *sum += value;
        }
        for (sum, value) in self.neighbours.iter_mut().zip([x0 * x, x0 * y + y0 * x, y0 * y]) {
            *sum += value;
        }
    }

    /// Mean of x.
    pub(super) fn mean(&self) -> f64 {
        self.first[0] + self.sum[0] / self.count.max(1.0)
    }

    /// Standard deviation of x.
    pub(super) fn activity(&self) -> f64 {
        (self.centred()[0].max(0.0) / self.count.max(1.0)).sqrt()
    }

    /// Σ(x−x̄)², Σ(x−x̄)(y−ȳ), Σ(y−ȳ)².
    fn centred(&self) -> [f64; 3] {
        let [x, y] = self.sum;
        let [xx, xy, yy] = self.product;
        let n = self.count.max(1.0);
        [xx - x * x / n, xy - x * y / n, yy - y * y / n]
    }

    /// Variance of b y + a x, and the correlation of its neighbours.
    fn spread(&self, [a, b]: [f64; 2]) -> (f64, f64) {
        let of = |[xx, xy, yy]: [f64; 3]| b * b * yy + a * b * xy + a * a * xx;
        let [xx, xy, yy] = self.centred();
        let squares = of([xx, 2.0 * xy, yy]).max(0.0);
        // Σ(p(k)−p̄)(q(k+1)−q̄): of p there is all but the last, of q all but the first, which is 0.
        let n = self.count.max(1.0);
        let ([sx, sy], [lx, ly]) = (self.sum, self.last);
        let (mx, my) = (sx / n, sy / n);
        let less = |[mp, mq]: [f64; 2], sp: f64, lp: f64, sq: f64| {
            (n - 1.0) * mp * mq - mq * (sp - lp) - mp * sq
        };
        let [nxx, nxy, nyy] = self.neighbours;
        let lagged = of([
            nxx + less([mx, mx], sx, lx, sx),
            nxy + less([mx, my], sx, lx, sy) + less([my, mx], sy, ly, sx),
            nyy + less([my, my], sy, ly, sy),
        ]);
        let rho = if squares > n * ROUNDING * ROUNDING { lagged / squares } else { 0.0 };
        // A short series looks less persistent than it is (Kendall).
        let rho = if rho > 0.0 { (rho + (1.0 + 3.0 * rho) / n).min(1.0) } else { 0.0 };
        (squares / n, rho)
    }

    /// Factor on a standard error for neighbours that resemble one another and for few of them.
    fn caution(&self, rho: f64) -> f64 {
        if self.count < 4.0 || rho >= 0.99 {
            return f64::INFINITY;
        }
        3.0 * (1.0 + 6.0 / (self.count - 2.0)) * ((1.0 + rho) / (1.0 - rho)).sqrt()
    }

    /// Mean of y − x.
    pub(super) fn difference(&self) -> Estimate {
        let n = self.count.max(1.0);
        let value = self.first[1] - self.first[0] + (self.sum[1] - self.sum[0]) / n;
        let (variance, rho) = self.spread([-1.0, 1.0]);
        Estimate { value, margin: margin(self.caution(rho), (variance / n).sqrt()) }
    }

    /// Slope of y over x; `None` if x hardly moves: by less than `activity`, a standard deviation.
    pub(super) fn slope(&self, activity: f64) -> Option<Estimate> {
        let [xx, xy, _] = self.centred();
        let n = self.count;
        if n < 4.0 || xx <= 0.0 || xx < n * activity * activity {
            return None;
        }
        let value = xy / xx;
        let (variance, rho) = self.spread([-value, 1.0]);
        let error = (variance * n / (n - 2.0) / xx).sqrt();
        // What is left over misleads a slope as far as it resembles x from sample to sample.
        let caution = self.caution(rho * self.spread([1.0, 0.0]).1);
        Some(Estimate { value, margin: margin(caution, error) })
    }
}

/// Nothing is sure that has no error either, if there were too few to have one.
fn margin(caution: f64, error: f64) -> f64 {
    if caution.is_finite() { caution * error } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform in ±1, the same each time.
    fn noise() -> impl FnMut() -> f64 {
        let mut state = 7_u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    fn series(n: usize, memory: f64) -> Vec<f64> {
        let (mut next, mut state) = (noise(), 0.0);
        (0..n)
            .map(|_| {
                state = memory * state + next();
                state
            })
            .collect()
    }

    /// Straight from the definitions.
    fn residual_correlation(x: &[f64], y: &[f64], slope: f64) -> f64 {
        let n = x.len() as f64;
        let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
        let (mx, my) = (mean(x), mean(y));
        let e: Vec<f64> = x.iter().zip(y).map(|(x, y)| (y - my) - slope * (x - mx)).collect();
        let lagged: f64 = e.windows(2).map(|pair| pair[0] * pair[1]).sum();
        lagged / e.iter().map(|e| e * e).sum::<f64>()
    }

    #[test]
    fn sums_in_passing_give_what_the_definitions_give() {
        let x = series(300, 0.5);
        let y: Vec<f64> = x.iter().zip(series(300, 0.8)).map(|(x, e)| 40.0 + 0.7 * x + e).collect();
        let mut fit = Fit::default();
        x.iter().zip(&y).for_each(|(x, y)| fit.add(*x, *y));
        for slope in [0.0, 0.7, 1.0] {
            let rho = residual_correlation(&x, &y, slope);
            let expected = rho + (1.0 + 3.0 * rho) / 300.0;
            let (_, found) = fit.spread([-slope, 1.0]);
            assert!((found - expected).abs() < 1e-9, "{found} and {expected} at {slope}");
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / 300.0;
        assert!((fit.mean() - mean(&x)).abs() < 1e-12);
        assert!((fit.difference().value - (mean(&y) - mean(&x))).abs() < 1e-12);
    }

    /// Of series that have nothing to do with one another, hardly one in a hundred seems to.
    #[test]
    fn the_margin_holds_for_series_that_remember_as_for_those_that_do_not() {
        for memory in [0.0, 0.5, 0.9] {
            let (x, y) = (series(60_000, memory), series(90_000, memory));
            let mut seen = [0; 2];
            for (x, y) in x.chunks(200).zip(y[30_000..].chunks(200)) {
                let mut fit = Fit::default();
                x.iter().zip(y).for_each(|(x, y)| fit.add(*x, *y));
                let slope = fit.slope(0.0).expect("x moves");
                seen[0] += usize::from(slope.value.abs() > slope.margin);
                let mean = fit.difference();
                seen[1] += usize::from(mean.value.abs() > mean.margin);
            }
            assert!(seen.iter().all(|count| *count <= 6), "{seen:?} of 300, memory {memory}");
        }
    }

    #[test]
    fn what_has_no_spread_is_known_at_once_and_a_few_are_nothing() {
        let mut fit = Fit::default();
        for k in 0..20 {
            let x = f64::from(k % 5);
            fit.add(x, x + 0.1);
        }
        assert!((fit.difference().value - 0.1).abs() < 1e-12 && fit.difference().margin < 1e-6);
        let slope = fit.slope(0.0).expect("x moves");
        assert!((slope.value - 1.0).abs() < 1e-12 && slope.margin < 1e-6, "{slope:?}");
        assert!(fit.slope(10.0).is_none(), "x moves less");
        let mut fit = Fit::default();
        (0..3).for_each(|k| fit.add(f64::from(k), 0.0));
        assert!(fit.slope(0.0).is_none() && fit.difference().margin.is_infinite());
    }
}
