//! Prediction (11) of one axis of the incremental model (10), for gain 1.
//!
//! The increments z = \[Δy, Δy', g Δa, g Δu(k−1)\] of an axis follow z(j+1) = A z(j) + B g Δu(j), and
//! y(j+1) = y(j) + Δy(j+1). A and B do not depend on the gain g in these coordinates, so the
//! responses are computed once. In momentum instead of rate the same holds while the gain changes:
//! only the step from Δy of a period to y is then weighed by the gain of that period.

use nalgebra::DMatrix;

use crate::{AxisDesign, LaggedAxis};

/// Length of z.
pub(crate) const STATE: usize = 4;

#[derive(Debug, Clone)]
pub(crate) struct AxisResponse {
    pub(crate) terms: usize,
    prediction: usize,
    /// L(m), `terms` for each of the Np samples.
    pub(crate) moves: Vec<f64>,
    /// Prefix sums of `moves`: u(k+m) − u(k−1).
    pub(crate) levels: Vec<f64>,
    /// Δy(j+1) by unit of each function: Np numbers for each of them.
    period: Vec<f64>,
    /// The same for each entry of z(0).
    period_free: [Vec<f64>; STATE],
    /// y'(j+1) − y'(0) by unit of each function, and of each entry of z(0).
    pub(crate) rate: Vec<f64>,
    rate_free: [Vec<f64>; STATE],
    /// 2 q(j), weights of the errors at 1..=Np.
    weight: Vec<f64>,
    /// ζ without W.
    hessian: DMatrix<f64>,
    /// Gradient by the errors y − r at 1..=Np, and by z(0): the gains of the horizon.
    gain_error: Vec<f64>,
    gain_state: Vec<[f64; STATE]>,
    /// H of (11) with the gain's own path, and H scaled by the weights.
    step: Vec<f64>,
    weighted: Vec<f64>,
    free: Vec<f64>,
    errors: Vec<f64>,
}

impl AxisResponse {
    pub(crate) fn new(axis: &AxisDesign, prediction: usize, period_s: f64) -> Self {
        let model = axis.sampled();
        let terms = axis.basis.terms();
        let moves = axis.basis.sequence(prediction);
        let mut levels = moves.clone();
        for i in terms..levels.len() {
            levels[i] += levels[i - terms];
        }
        let (mut period, mut rate) = (Vec::new(), Vec::new());
        for term in 0..terms {
            let increment = |m: usize| moves[m * terms + term];
            let (own, rates) = run(&model, [0.0; STATE], increment, prediction, period_s);
            period.extend(own);
            rate.extend(rates);
        }
        let free: [_; STATE] = core::array::from_fn(|entry| {
            let mut unit = [0.0; STATE];
            unit[entry] = 1.0;
            run(&model, unit, |_| 0.0, prediction, period_s)
        });
        let mut weight = vec![2.0 * axis.output_weight; prediction];
        if let Some(last) = weight.last_mut() {
            *last *= axis.terminal_factor;
        }
        let mut response = Self {
            terms,
            prediction,
            moves,
            levels,
            period,
            period_free: free.clone().map(|(period, _)| period),
            rate,
            rate_free: free.map(|(_, rate)| rate),
            weight,
            hessian: DMatrix::zeros(terms, terms),
            gain_error: Vec::new(),
            gain_state: Vec::new(),
            step: vec![0.0; terms * prediction],
            weighted: vec![0.0; terms * prediction],
            free: vec![0.0; prediction],
            errors: vec![0.0; prediction],
        };
        response.vary(|_| 1.0);
        response.gain_error.clone_from(&response.weighted);
        let by_entry = response.period_free.clone().map(|period| prefix_sums(&period));
        response.gain_state = (0..terms)
            .map(|term| {
                by_entry.clone().map(|path| dot(response.row(&response.gain_error, term), &path))
            })
            .collect();
        response
    }

    fn row<'a>(&self, matrix: &'a [f64], term: usize) -> &'a [f64] {
        &matrix[term * self.prediction..(term + 1) * self.prediction]
    }

    /// H and ζ for a gain that is `ratio(j)` times that at k in the period from k+j to k+j+1.
    pub(crate) fn vary(&mut self, ratio: impl Fn(usize) -> f64) {
        let length = self.prediction;
        for term in 0..self.terms {
            let at = term * length;
            let mut sum = 0.0;
            for j in 0..length {
                sum += ratio(j) * self.period[at + j];
                self.step[at + j] = sum;
                self.weighted[at + j] = self.weight[j] * sum;
            }
        }
        for i in 0..self.terms {
            for j in 0..=i {
                let entry = dot(self.row(&self.weighted, i), self.row(&self.step, j));
                (self.hessian[(i, j)], self.hessian[(j, i)]) = (entry, entry);
            }
        }
    }

    /// Writes the block of ζ = 2(HᵀQH + W) that starts at `at`, for gain g and weight w.
    ///
    /// The functions are orthonormal, so Σ Δu² over all time is the sum of their squared
    /// coefficients: W weighs these, and ζ is positive definite whatever the functions.
    pub(crate) fn hessian(&self, gain: f64, weight: f64, at: usize, zeta: &mut DMatrix<f64>) {
        let squared = gain * gain;
        for i in 0..self.terms {
            for j in 0..self.terms {
                zeta[(at + i, at + j)] = squared * self.hessian[(i, j)];
            }
            zeta[(at + i, at + i)] += 2.0 * weight;
        }
    }

    /// η = 2HᵀQ(F x − Rs) while the gain stays: `errors` are y(k) − r(k+j), `z` the increments.
    pub(crate) fn gradient(
        &mut self,
        gain: f64,
        errors: impl Iterator<Item = f64>,
        z: &[f64; STATE],
        eta: &mut [f64],
    ) {
        for (own, error) in self.errors.iter_mut().zip(errors) {
            *own = error;
        }
        for (term, (eta, by_state)) in eta.iter_mut().zip(&self.gain_state).enumerate() {
            let by_error = dot(self.row(&self.gain_error, term), &self.errors);
            *eta = gain * (by_error + dot(by_state, z));
        }
    }

    /// The same for the gains of the last [`Self::vary`], which `ratio` gives again.
    pub(crate) fn gradient_varied(
        &mut self,
        gain: f64,
        errors: impl Iterator<Item = f64>,
        z: &[f64; STATE],
        ratio: impl Fn(usize) -> f64,
        eta: &mut [f64],
    ) {
        self.free_path(z, ratio);
        for ((own, error), free) in self.errors.iter_mut().zip(errors).zip(&self.free) {
            *own = error + free;
        }
        for (term, eta) in eta.iter_mut().enumerate() {
            *eta = gain * dot(self.row(&self.weighted, term), &self.errors);
        }
    }

    /// y(k+j) − y(k) for j in 1..=Np if the input does not move, with the gain's path.
    pub(crate) fn free_path(&mut self, z: &[f64; STATE], ratio: impl Fn(usize) -> f64) -> &[f64] {
        let mut sum = 0.0;
        for j in 0..self.prediction {
            let period: f64 = (0..STATE).map(|entry| self.period_free[entry][j] * z[entry]).sum();
            sum += ratio(j) * period;
            self.free[j] = sum;
        }
        &self.free
    }

    /// y'(k+j+1) − y'(k) if the input does not move (momentum over the gain at k).
    pub(crate) fn free_rate(&self, z: &[f64; STATE], j: usize) -> f64 {
        (0..STATE).map(|entry| self.rate_free[entry][j] * z[entry]).sum()
    }

    /// y(k+j+1) by unit of function `term` at gain 1, as of the last [`Self::vary`].
    pub(crate) fn step(&self, term: usize, j: usize) -> f64 {
        self.step[term * self.prediction + j]
    }

    /// y'(k+j+1) by unit of function `term` at gain 1.
    pub(crate) fn rate(&self, term: usize, j: usize) -> f64 {
        self.rate[term * self.prediction + j]
    }
}

/// Δy and the sum of Δy' after each of `samples` periods from `z` under the increments `moves`.
fn run(
    model: &LaggedAxis,
    mut z: [f64; STATE],
    moves: impl Fn(usize) -> f64,
    samples: usize,
    period_s: f64,
) -> (Vec<f64>, Vec<f64>) {
    let (mut period, mut rates) = (Vec::with_capacity(samples), Vec::with_capacity(samples));
    let mut rate = 0.0;
    for m in 0..samples {
        z = model.advance(z, moves(m), period_s);
        rate += z[1];
        period.push(z[0]);
        rates.push(rate);
    }
    (period, rates)
}

fn prefix_sums(values: &[f64]) -> Vec<f64> {
    let sum = |sum: &mut f64, value: &f64| {
        *sum += value;
        Some(*sum)
    };
    values.iter().scan(0.0, sum).collect()
}

/// a·b in four interleaved sums, the same on every build.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    let mut sums = [0.0; 4];
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + tail
}
