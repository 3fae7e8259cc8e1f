//! The three passes over a group: how right, how fast when hot, how fast when cold.

use core::hint::black_box;
use qp::kkt_residuals;
use runtime::clock::mono_now_ns;

use crate::contenders::{Contender, Entry};
use crate::series::{Group, Series};

/// More than the caches that belong to one core.
const EVICTED_BYTES: usize = 32 << 20;
const LINE_BYTES: usize = 64;
/// Enough that hardly any tick is interrupted in all of them.
const MIN_REPLAYS: usize = 5;
const COLD_REPLAYS: usize = 3;

/// How much measuring is wanted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Time for the hot pass of one solver on one group \[ns\].
    pub(crate) budget_ns: u64,
    /// Replays of a series, at most.
    pub(crate) most_replays: usize,
    /// Ticks of a group that are met with cold caches.
    pub(crate) cold_ticks: usize,
}

/// What the answers were worth.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Accuracy {
    /// Ticks that the solver itself reported as not solved.
    pub(crate) unsolved: usize,
    pub(crate) worst_iterations: u32,
    /// In units of the rate bound; `None` where no solution is known.
    pub(crate) first_move: Option<f64>,
    /// Worst relative residual of the optimality conditions.
    pub(crate) residual: f64,
    /// Ticks with a row at a bound.
    pub(crate) constrained: usize,
}

/// Times in ns.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Times {
    pub(crate) median: u64,
    pub(crate) p99: u64,
    pub(crate) max: u64,
}

/// One solver on one group.
#[derive(Debug, Clone)]
pub(crate) struct Figures {
    pub(crate) solver: &'static str,
    pub(crate) accuracy: Accuracy,
    /// Best repetition of each tick, then over ticks.
    pub(crate) hot: Times,
    /// Median repetition of each tick, then the median over ticks, and its median absolute
    /// deviation within a tick \[ns\]: what the machine adds.
    pub(crate) typical: u64,
    pub(crate) deviation: u64,
    pub(crate) fewest_replays: usize,
    pub(crate) cold: Times,
    /// Instructions per tick, filled in by a counted run.
    pub(crate) instructions: Option<u64>,
}

/// All passes of one solver over one group.
pub(crate) fn figures(group: &Group, entry: Entry, effort: Effort) -> Figures {
    let (solver, make) = entry;
    let mut accuracy = Accuracy::default();
    let (mut best, mut typical, mut deviation) = (Vec::new(), Vec::new(), Vec::new());
    let mut cold = Vec::new();
    let mut fewest_replays = usize::MAX;
    let budget_ns = effort.budget_ns / group.series.len() as u64;
    let stride = group.ticks().div_ceil(effort.cold_ticks);
    let mut waste = vec![0_u64; EVICTED_BYTES / 8];
    for series in &group.series {
        let mut contender = make(series);
        judge(series, contender.as_mut(), &mut accuracy);
        let samples = replay(series, contender.as_mut(), budget_ns, effort.most_replays);
        fewest_replays = fewest_replays.min(samples.len());
        for tick in 0..series.ticks.len() {
            let mut times: Vec<u64> = samples.iter().map(|replay| replay[tick]).collect();
            best.push(times.iter().copied().min().unwrap_or(0));
            let middle = median(&mut times);
            for time in &mut times {
                *time = time.abs_diff(middle);
            }
            typical.push(middle);
            deviation.push(median(&mut times));
        }
        cold.extend(met_cold(series, contender.as_mut(), stride, &mut waste));
    }
    Figures {
        solver,
        accuracy,
        hot: over_ticks(&mut best),
        typical: median(&mut typical),
        deviation: median(&mut deviation),
        fewest_replays,
        cold: over_ticks(&mut cold),
        instructions: None,
    }
}

/// One timed call.
#[inline(never)]
fn timed(contender: &mut dyn Contender, series: &Series, tick: usize) -> u64 {
    let tick = black_box(&series.ticks[tick]);
    let start_ns = mono_now_ns();
    black_box(contender.run(tick));
    mono_now_ns() - start_ns
}

/// Replays the series from its start until the time is over: in each replay, tick k starts from
/// what tick k-1 left behind.
fn replay(
    series: &Series,
    contender: &mut dyn Contender,
    budget_ns: u64,
    most: usize,
) -> Vec<Vec<u64>> {
    let start_ns = mono_now_ns();
    let mut samples = Vec::new();
    loop {
        // One replay may have been interrupted; only what is far too slow has but one.
        let allowed_ns = budget_ns * if samples.len() < MIN_REPLAYS { 20 } else { 1 };
        let over = mono_now_ns() - start_ns >= allowed_ns || samples.len() >= most;
        if over && !samples.is_empty() {
            return samples;
        }
        contender.rewind(series);
        let tick = |k| {
            contender.load(series, k);
            timed(contender, series, k)
        };
        samples.push((0..series.ticks.len()).map(tick).collect());
    }
}

/// Replays in which every `stride`-th tick finds the core's own caches filled with other data; the
/// best of them, because one may be interrupted.
fn met_cold(
    series: &Series,
    contender: &mut dyn Contender,
    stride: usize,
    waste: &mut [u64],
) -> Vec<u64> {
    let mut best = vec![u64::MAX; series.ticks.len()];
    for _ in 0..COLD_REPLAYS {
        contender.rewind(series);
        for (k, best) in best.iter_mut().enumerate() {
            contender.load(series, k);
            if k % stride == stride / 2 {
                waste.iter_mut().step_by(LINE_BYTES / 8).for_each(|w| *w = w.wrapping_add(1));
                black_box(&mut *waste);
                *best = timed(contender, series, k).min(*best);
            } else {
                black_box(contender.run(&series.ticks[k]));
            }
        }
    }
    best.retain(|time| *time < u64::MAX);
    best
}

/// One untimed replay that looks at every answer.
fn judge(series: &Series, contender: &mut dyn Contender, accuracy: &mut Accuracy) {
    contender.rewind(series);
    for (k, tick) in series.ticks.iter().enumerate() {
        contender.load(series, k);
        let verdict = contender.run(tick);
        accuracy.unsolved += usize::from(!verdict.solved);
        accuracy.worst_iterations = accuracy.worst_iterations.max(verdict.iterations);
        let (x, multipliers) = contender.answer();
        if x.is_empty() {
            accuracy.residual = f64::INFINITY;
            continue;
        }
        let hessian = series.hessian_at(k);
        let (f, lower, upper) = (&tick.f, &tick.lower, &tick.upper);
        let residuals = kkt_residuals(hessian, &series.rows, f, lower, upper, &x, &multipliers);
        accuracy.residual = accuracy.residual.max(residuals.worst());
        let mut held = multipliers.iter().any(|multiplier| *multiplier != 0.0);
        if let Some(recorded) = &series.recorded {
            held = recorded.ticks[k].sides.iter().any(|side| *side != 0);
            let error = recorded.first_move_error(k, &x);
            accuracy.first_move = Some(accuracy.first_move.unwrap_or(0.0).max(error));
        }
        accuracy.constrained += usize::from(held);
    }
}

/// What the clock and the call cost without any solver.
pub(crate) fn floor(group: &Group, contender: &mut dyn Contender) -> Times {
    let mut times = Vec::new();
    for series in &group.series {
        let samples = replay(series, contender, 20_000_000, 200);
        times.extend(
            (0..series.ticks.len())
                .map(|k| samples.iter().map(|replay| replay[k]).min().unwrap_or(0)),
        );
    }
    over_ticks(&mut times)
}

fn over_ticks(times: &mut [u64]) -> Times {
    times.sort_unstable();
    let rank = |share: f64| {
        let position = (share * times.len() as f64).ceil();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between zero and the length"
        )]
        let index = (position as usize).saturating_sub(1);
        times.get(index).copied().unwrap_or(0)
    };
    Times { median: rank(0.5), p99: rank(0.99), max: rank(1.0) }
}

fn median(times: &mut [u64]) -> u64 {
    over_ticks(times).median
}
