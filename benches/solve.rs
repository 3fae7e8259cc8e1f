//! The two control laws alone, on a closed-loop flight that is fast enough to meet their bounds.

mod flight;

use core::hint::black_box;
use criterion::{Criterion, criterion_group, criterion_main};
use flight::{Laws, RecordedInputs, fly, laws};
use std::io::Write as _;

fn solve(criterion: &mut Criterion) {
    let RecordedInputs { attitude: attitude_inputs, position: position_samples, constrained } =
        fly();
    let _ = writeln!(
        std::io::stdout(),
        "at a bound: attitude in {} of {} samples, position in {} of {}",
        constrained[0],
        attitude_inputs.len(),
        constrained[1],
        position_samples.len(),
    );
    let Laws { mut attitude, mut position } = laws();
    let (attitude_start, position_start) = (*attitude.memory(), *position.memory());
    let mut group = criterion.benchmark_group("solve");
    let mut k = 0;
    group.bench_function("attitude", |b| {
        b.iter(|| {
            if k % attitude_inputs.len() == 0 {
                let _ = attitude.restore(&attitude_start);
            }
            k += 1;
            black_box(attitude.step(&attitude_inputs[(k - 1) % attitude_inputs.len()]))
        });
    });
    let mut k = 0;
    group.bench_function("position", |b| {
        b.iter(|| {
            if k % position_samples.len() == 0 {
                let _ = position.restore(&position_start);
            }
            k += 1;
            black_box(position.step(&position_samples[(k - 1) % position_samples.len()].input()))
        });
    });
    group.finish();
}

criterion_group!(benches, solve);
criterion_main!(benches);
