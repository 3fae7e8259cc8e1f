//! One step of each service on what `figure8-morph` gives it, without transport: taking in samples,
//! the step, handing over what is published, packing the state.
//!
//! First the single steps of the flight, each the best of a few replays, then criterion's means.

#[allow(dead_code, reason = "each bench uses its own part")]
mod tape;

use criterion::{Criterion, criterion_group, criterion_main};
use std::io::Write as _;
use tape::{Flight, Replay};

const REPLAYS: usize = 7;

/// Median, 99th percentile and maximum over the steps of a flight.
fn print_single_steps(role: &str, replay: &mut Replay<'_>) {
    let mut best = replay.each_step_ns();
    for _ in 1..REPLAYS {
        for (best, again) in best.iter_mut().zip(replay.each_step_ns()) {
            *best = again.min(*best);
        }
    }
    best.sort_unstable();
    let us = |rank: usize| best[rank.min(best.len() - 1)] as f64 * 1e-3;
    let (median, p99, max) = (us(best.len() / 2), us(best.len() * 99 / 100), us(best.len()));
    let _ = writeln!(
        std::io::stdout(),
        "{role}: {} steps, median {median:.2} us, p99 {p99:.2} us, max {max:.2} us",
        best.len()
    );
}

fn steps(criterion: &mut Criterion) {
    let flight = Flight::fly("figure8-morph").expect("a shipped scenario flies");
    for node in flight.graph.nodes() {
        let mut replay = flight.replay(*node).expect("it was built to fly");
        print_single_steps(node.role.label(), &mut replay);
    }
    let mut group = criterion.benchmark_group("step");
    for node in flight.graph.nodes() {
        let mut replay = flight.replay(*node).expect("it was built to fly");
        group.bench_function(node.role.label(), |b| b.iter_custom(|steps| replay.run(steps)));
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
