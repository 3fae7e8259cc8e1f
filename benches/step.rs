//! One step of each service on what `figure8-morph` gives it, without transport: taking in samples,
//! the step, handing over what is published, packing the state. Slots are filled by each service in turn.
//!
//! First the single steps of the flight, each the best of a few replays, then criterion's means.

#[allow(dead_code, reason = "each bench uses its own part")]
mod tape;

use criterion::{Criterion, criterion_group, criterion_main};
use scenario::Override;
use scenario::services::names_for;
use shared_types::{Role, Slot};
use std::io::Write as _;
use tape::{Flight, Replay};

const SCENARIO: &str = "figure8-morph";
const REPLAYS: usize = 7;

/// Median, 99th percentile and maximum over the steps of a flight.
fn print_single_steps(name: &str, replay: &mut Replay<'_>) {
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
        "{name}: {} steps, median {median:.2} us, p99 {p99:.2} us, max {max:.2} us",
        best.len()
    );
}

/// Assignments that have each service of a slot once, the default one first.
fn assignments() -> impl Iterator<Item = Vec<Override>> {
    let slots = Slot::ALL.map(Slot::role);
    let most = slots.into_iter().map(|slot| names_for(slot).count()).max().unwrap_or(0);
    (0..most).map(move |index| {
        let pick = |slot: Role| {
            let name = names_for(slot).nth(index).or(names_for(slot).next())?;
            Override::controller(&format!("{}={name}", slot.label())).ok()
        };
        slots.into_iter().filter_map(pick).collect()
    })
}

fn steps(criterion: &mut Criterion) {
    let mut printed = Vec::new();
    for assignment in assignments() {
        let flight = Flight::fly_with(SCENARIO, &assignment).expect("a shipped scenario flies");
        for node in flight.graph.nodes() {
            let name = flight.name(node.role);
            if !printed.contains(&name) {
                let mut replay = flight.replay(*node).expect("it was built to fly");
                print_single_steps(name, &mut replay);
                printed.push(name);
            }
        }
    }
    let flight = Flight::fly(SCENARIO).expect("a shipped scenario flies");
    let mut group = criterion.benchmark_group("step");
    for node in flight.graph.nodes() {
        let mut replay = flight.replay(*node).expect("it was built to fly");
        group.bench_function(node.role.label(), |b| b.iter_custom(|steps| replay.run(steps)));
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
