//! What a sample costs beside its step: packed state, protobuf form, flight hash.

use core::hint::black_box;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use observe::FlightHash;
use record::encode;
use runtime::StateHeader;
use scenario::Scenario;
use scenario::services::Assignment;
use shared_types::{Reference, Role, Sample, StateEstimate, Topic, Truth, topics};

fn pack(criterion: &mut Criterion) {
    let scenario = Scenario::load("figure8-morph", &[]).expect("it is shipped");
    let assignment = Assignment::of(scenario.settings());
    let mut group = criterion.benchmark_group("pack_state");
    for role in Role::STEPPING {
        let component = components::build(&assignment, role, &scenario).expect("it flies");
        let mut bytes = vec![0; component.layout().state_size()];
        group.throughput(Throughput::Bytes(bytes.len() as u64));
        group.bench_function(role.label(), |b| {
            b.iter(|| {
                component.pack(&StateHeader::default(), &mut bytes);
                black_box(&bytes);
            });
        });
    }
    group.finish();
}

/// No field at zero, where protobuf would be at its shortest.
fn filled<T: Sample>() -> T {
    T::unpack(&(1..=63).cycle().take(T::PACKED_SIZE).collect::<Vec<u8>>())
}

fn encode_sample<T: Sample>(criterion: &mut Criterion, topic: &Topic<T>) {
    let (sample, mut out) = (filled::<T>(), Vec::new());
    let mut group = criterion.benchmark_group("encode");
    group.bench_function(BenchmarkId::from_parameter(topic.info.name), |b| {
        b.iter(|| {
            out.clear();
            encode(black_box(&sample), &mut out);
            black_box(out.len())
        });
    });
    group.finish();
}

fn hash_sample<T: Sample>(criterion: &mut Criterion, topic: &Topic<T>) {
    let (sample, mut hash) = (filled::<T>(), FlightHash::default());
    let mut group = criterion.benchmark_group("hash");
    group.bench_function(BenchmarkId::from_parameter(topic.info.name), |b| {
        b.iter(|| hash.add(&topic.info, black_box(&sample)));
    });
    group.finish();
}

fn samples(criterion: &mut Criterion) {
    encode_sample::<StateEstimate>(criterion, &topics::STATE_ESTIMATE);
    encode_sample::<Reference>(criterion, &topics::REFERENCE);
    hash_sample::<StateEstimate>(criterion, &topics::STATE_ESTIMATE);
    hash_sample::<Truth>(criterion, &topics::TRUTH);
}

criterion_group!(benches, pack, samples);
criterion_main!(benches);
