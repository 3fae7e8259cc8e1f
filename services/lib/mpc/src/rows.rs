//! The constraint rows `lower <= A η <= upper` of the program, in one fixed order.

use nalgebra::{DMatrix, SVector};

use crate::constraints::{Bounds, Coupled, FirstMove};
use crate::engine::Measured;
use crate::model::{Constraints, Design, Hardness};
use crate::response::{AxisResponse, STATE};

/// Bounds of one step, in the engine's units.
#[derive(Debug, Clone, Copy)]
pub struct Limits<'a, const N: usize> {
    /// On u and Δu. Without a hard set on levels the first pair is only what a fallback is
    /// clipped to.
    pub inputs: Bounds<N>,
    /// On rows that inputs share.
    pub coupled: Coupled<'a, N>,
    /// Least y.
    pub output_min: SVector<f64, N>,
    /// Largest y.
    pub output_max: SVector<f64, N>,
    /// Largest |y'|.
    pub rate_max: SVector<f64, N>,
}

/// How limits and gains go on over the horizon, sample by sample.
#[derive(Debug, Clone, Copy)]
pub struct Ahead<'a, const N: usize> {
    /// Gain in the period from k+j to k+j+1 over the gain at k, j in 0..Np.
    pub gain: &'a [SVector<f64, N>],
    /// Gain at k+j over the gain at k, j in 1..=Np.
    pub gain_at: &'a [SVector<f64, N>],
    /// Bounds on u(k+j) and Δu(k+j), j in 0..Nc; the last ones go on.
    pub inputs: &'a [Bounds<N>],
    /// Factor of each input in the coupled rows at k+j, j in 0..Nc; the last one goes on.
    pub coupling: &'a [SVector<f64, N>],
}

impl<const N: usize> Ahead<'_, N> {
    fn inputs_at(&self, m: usize) -> &Bounds<N> {
        &self.inputs[m.min(self.inputs.len() - 1)]
    }

    pub(crate) fn coupling_at(&self, m: usize) -> &SVector<f64, N> {
        &self.coupling[m.min(self.coupling.len() - 1)]
    }
}

/// What the bounds of one step are made of.
pub(crate) struct Step<'a, const N: usize> {
    pub(crate) limits: &'a Limits<'a, N>,
    pub(crate) first: &'a FirstMove<N>,
    pub(crate) now: &'a Measured<N>,
    pub(crate) gain: &'a SVector<f64, N>,
    pub(crate) z: &'a [[f64; STATE]; N],
    pub(crate) ahead: Option<&'a Ahead<'a, N>>,
}

impl<const N: usize> Step<'_, N> {
    fn inputs(&self, m: usize) -> &Bounds<N> {
        self.ahead.map_or(&self.limits.inputs, |ahead| ahead.inputs_at(m))
    }
}

/// Where each set of rows begins.
#[derive(Debug, Clone)]
pub(crate) struct Rows<const N: usize> {
    constraints: Constraints<N>,
    prediction: usize,
    /// See [`Design::bounded`].
    bounded: Vec<[usize; 2]>,
    /// The first level and the first increment have the same normal: where both are hard they are
    /// one row with the tighter bounds.
    merged: bool,
    /// First row of levels, increments, coupled, outputs, rates, and the end.
    starts: [usize; 6],
}

impl<const N: usize> Rows<N> {
    pub(crate) fn new(design: &Design<N>) -> Self {
        let Design { horizon, constraints, .. } = design;
        let prediction = horizon.prediction;
        let bounded = design.bounded();
        let control = bounded.len();
        let hard = |set: Option<Hardness>| set.is_some_and(Hardness::is_hard);
        let ends_at_once = bounded.first() == Some(&[0, 0]);
        let merged = ends_at_once && hard(constraints.levels) && hard(constraints.increments);
        let counts = [
            constraints.levels.map_or(0, |_| N * control),
            constraints.increments.map_or(0, |_| N * (control - usize::from(merged))),
            constraints.coupled.map_or(0, |(normals, _)| normals.len() * control),
            constraints.outputs.map_or(0, |_| N * prediction),
            constraints.rates.map_or(0, |_| N * prediction),
        ];
        let mut starts = [0; 6];
        for (set, count) in counts.into_iter().enumerate() {
            starts[set + 1] = starts[set] + count;
        }
        Self { constraints: *constraints, prediction, bounded, merged, starts }
    }

    pub(crate) fn has_soft(&self) -> bool {
        let Constraints { levels, increments, coupled, outputs, rates } = self.constraints;
        let sets = [levels, increments, coupled.map(|(_, hardness)| hardness), outputs, rates];
        sets.into_iter().flatten().any(|hardness| !hardness.is_hard())
    }

    pub(crate) fn has_soft_levels(&self) -> bool {
        self.constraints.levels.is_some_and(|hardness| !hardness.is_hard())
    }

    pub(crate) fn has_hard_increments(&self) -> bool {
        self.constraints.increments.is_some_and(Hardness::is_hard)
    }

    pub(crate) fn has_hard_coupled(&self) -> bool {
        self.constraints.coupled.is_some_and(|(_, hardness)| hardness.is_hard())
    }

    pub(crate) fn count(&self) -> usize {
        self.starts[5]
    }

    /// Rows that outputs and coupled inputs give the program change with the gain's path.
    pub(crate) fn vary(&self) -> bool {
        self.constraints.coupled.is_some() || self.constraints.outputs.is_some()
    }

    /// Writes A; `coupling(j)` is [`Ahead::coupling`].
    pub(crate) fn write(
        &self,
        axes: &[AxisResponse; N],
        coupling: impl Fn(usize) -> SVector<f64, N>,
        a: &mut DMatrix<f64>,
    ) {
        let Constraints { levels, increments, coupled, outputs, rates } = self.constraints;
        let skipped = usize::from(self.merged);
        let mut at = 0;
        for (i, axis) in axes.iter().enumerate() {
            for term in 0..axis.terms {
                let column = at + term;
                if levels.is_some() {
                    for (m, [_, level]) in self.bounded.iter().enumerate() {
                        a[(N * m + i, column)] = axis.levels[level * axis.terms + term];
                    }
                }
                if increments.is_some() {
                    for (m, [moved, _]) in self.bounded.iter().enumerate().skip(skipped) {
                        let row = self.starts[1] + N * (m - skipped) + i;
                        a[(row, column)] = axis.moves[moved * axis.terms + term];
                    }
                }
                if let Some((normals, _)) = coupled {
                    for (m, [_, level]) in self.bounded.iter().enumerate() {
                        let level = axis.levels[level * axis.terms + term] * coupling(*level)[i];
                        for (r, normal) in normals.iter().enumerate() {
                            let row = self.starts[2] + normals.len() * m + r;
                            a[(row, column)] = normal[i] * level;
                        }
                    }
                }
                for j in 0..self.prediction {
                    if outputs.is_some() {
                        a[(self.starts[3] + N * j + i, column)] = axis.step(term, j);
                    }
                    if rates.is_some() {
                        a[(self.starts[4] + N * j + i, column)] = axis.rate(term, j);
                    }
                }
            }
            at += axis.terms;
        }
    }

    /// Writes the bounds of every row. Bounds on outputs need the free paths of `axes`, which are
    /// computed here.
    pub(crate) fn fill(
        &self,
        step: &Step<'_, N>,
        axes: &mut [AxisResponse; N],
        lower: &mut [f64],
        upper: &mut [f64],
    ) {
        self.fill_levels(step, lower, upper);
        self.fill_increments(step, lower, upper);
        self.fill_coupled(step, lower, upper);
        for (i, axis) in axes.iter_mut().enumerate() {
            self.fill_outputs(step, i, axis, lower, upper);
            self.fill_rates(step, i, axis, lower, upper);
        }
    }

    fn fill_levels(&self, step: &Step<'_, N>, lower: &mut [f64], upper: &mut [f64]) {
        if self.constraints.levels.is_none() {
            return;
        }
        let (first, u) = (step.first, &step.now.u_previous);
        for (m, [_, level]) in self.bounded.iter().enumerate() {
            let bounds = step.inputs(*level);
            for i in 0..N {
                let row = N * m + i;
                (lower[row], upper[row]) = if m == 0 && self.merged {
                    (first.lower[i], first.upper[i])
                } else {
                    (bounds.u_min[i] - u[i], bounds.u_max[i] - u[i])
                };
            }
        }
    }

    fn fill_increments(&self, step: &Step<'_, N>, lower: &mut [f64], upper: &mut [f64]) {
        if self.constraints.increments.is_none() {
            return;
        }
        let skipped = usize::from(self.merged);
        for (m, [moved, _]) in self.bounded.iter().enumerate().skip(skipped) {
            let bounds = step.inputs(*moved);
            for i in 0..N {
                let row = self.starts[1] + N * (m - skipped) + i;
                let missing = match m {
                    0 => step.first.relaxation[i],
                    _ if step.ahead.is_some() => bounds.missing_since(step.inputs(moved - 1), i),
                    _ => 0.0,
                };
                let reach = bounds.du_max[i] + missing;
                (lower[row], upper[row]) = (-reach, reach);
            }
        }
    }

    fn fill_coupled(&self, step: &Step<'_, N>, lower: &mut [f64], upper: &mut [f64]) {
        let Some((normals, _)) = self.constraints.coupled else { return };
        let (lows, highs) = (step.limits.coupled.lower, step.limits.coupled.upper);
        let u = &step.now.u_previous;
        for (m, [_, level]) in self.bounded.iter().enumerate() {
            let scaled = step.ahead.map_or(*u, |ahead| u.component_mul(ahead.coupling_at(*level)));
            let start = self.starts[2] + normals.len() * m;
            for (r, normal) in normals.iter().enumerate() {
                let held: f64 = normal.iter().zip(&scaled).map(|(n, u)| n * u).sum();
                (lower[start + r], upper[start + r]) = (lows[r] - held, highs[r] - held);
            }
        }
    }

    fn fill_outputs(
        &self,
        step: &Step<'_, N>,
        i: usize,
        axis: &mut AxisResponse,
        lower: &mut [f64],
        upper: &mut [f64],
    ) {
        if self.constraints.outputs.is_none() {
            return;
        }
        let ratio = |j: usize| step.ahead.map_or(1.0, |ahead| ahead.gain[j][i]);
        for (j, free) in axis.free_path(&step.z[i], ratio).iter().enumerate() {
            let row = self.starts[3] + N * j + i;
            let y = step.now.output[i] + free;
            let ends = [step.limits.output_min[i], step.limits.output_max[i]];
            let [a, b] = ends.map(|end| (end - y) / step.gain[i]);
            (lower[row], upper[row]) = (a.min(b), a.max(b));
        }
    }

    fn fill_rates(
        &self,
        step: &Step<'_, N>,
        i: usize,
        axis: &AxisResponse,
        lower: &mut [f64],
        upper: &mut [f64],
    ) {
        if self.constraints.rates.is_none() {
            return;
        }
        for j in 0..self.prediction {
            let row = self.starts[4] + N * j + i;
            let ratio = step.ahead.map_or(1.0, |ahead| ahead.gain_at[j][i]);
            let reach = step.limits.rate_max[i] / ratio;
            let free = step.now.rate[i] + axis.free_rate(&step.z[i], j);
            let [a, b] = [-reach, reach].map(|end| (end - free) / step.gain[i]);
            (lower[row], upper[row]) = (a.min(b), a.max(b));
        }
    }

    /// Writes the compliance of hard rows on outputs and rates: that of `penalty`, or none. True if
    /// there are such rows.
    pub(crate) fn yield_states(
        &self,
        penalty: Option<f64>,
        gain: &SVector<f64, N>,
        out: &mut [f64],
    ) -> bool {
        let mut any = false;
        for (index, set) in [(3, self.constraints.outputs), (4, self.constraints.rates)] {
            if set != Some(Hardness::Hard) {
                continue;
            }
            any = true;
            let rows = &mut out[self.starts[index]..self.starts[index + 1]];
            for (row, compliance) in rows.iter_mut().enumerate() {
                let gain = gain[row % N];
                *compliance = penalty.map_or(0.0, |penalty| 0.5 / (penalty * gain * gain));
            }
        }
        any
    }

    /// Compliance of every row for gains g and increment weights w; true if one is soft.
    pub(crate) fn compliance(
        &self,
        gain: &SVector<f64, N>,
        weight: &SVector<f64, N>,
        out: &mut [f64],
    ) -> bool {
        let Constraints { levels, increments, coupled, outputs, rates } = self.constraints;
        // The price of a row is penalty · scale · s² in (15): s counts in increments that cost 1,
        // or in outputs, and output rows are divided by the gain.
        let mut soft = false;
        let mut set = |index: usize, hardness: Option<Hardness>, scale: &dyn Fn(usize) -> f64| {
            let Some(Hardness::Soft { penalty }) = hardness else { return };
            soft = true;
            let rows = &mut out[self.starts[index]..self.starts[index + 1]];
            for (row, compliance) in rows.iter_mut().enumerate() {
                *compliance = 0.5 / (penalty * scale(row % N));
            }
        };
        let mean = weight.mean();
        set(0, levels, &|i| weight[i]);
        set(1, increments, &|i| weight[i]);
        set(2, coupled.map(|(_, hardness)| hardness), &|_| mean);
        set(3, outputs, &|i| gain[i] * gain[i]);
        set(4, rates, &|i| gain[i] * gain[i]);
        soft
    }
}
