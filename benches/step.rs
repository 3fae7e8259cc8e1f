//! One step of each service on what `figure8-morph` gives it, without transport.

mod tape;

use criterion::{Criterion, criterion_group, criterion_main};
use tape::Flight;

fn steps(criterion: &mut Criterion) {
    let flight = Flight::fly("figure8-morph").expect("a shipped scenario flies");
    let mut group = criterion.benchmark_group("step");
    for node in flight.graph.nodes() {
        let mut replay = flight.replay(*node).expect("it was built to fly");
        group.bench_function(node.role.label(), |b| b.iter_custom(|steps| replay.run(steps)));
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
