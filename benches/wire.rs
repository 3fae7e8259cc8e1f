//! What a sample costs beside its step: packed state, protobuf form, flight hash.

use core::hint::black_box;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use observe::FlightHash;
use record::encode;
use runtime::service::{pack_state, state_size};
use runtime::{Service, StateHeader};
use scenario::Scenario;
use scenario::components::{self, Component, ComponentVisitor};
use shared_types::{Reference, Role, Sample, StateEstimate, Topic, Truth, topics};

struct PackState<'a> {
    criterion: &'a mut Criterion,
    role: Role,
}

impl ComponentVisitor for PackState<'_> {
    type Output = ();
    fn visit<S: Service + 'static>(self, component: Component<S>) {
        let (inputs, outputs) = (S::Inputs::default(), S::Outputs::default());
        let mut bytes = vec![0; state_size::<S>()];
        let mut group = self.criterion.benchmark_group("pack_state");
        group.throughput(Throughput::Bytes(bytes.len() as u64));
        group.bench_function(self.role.label(), |b| {
            b.iter(|| {
                let header = StateHeader::default();
                pack_state(&component.service, &header, &inputs, &outputs, &mut bytes);
                black_box(&bytes);
            });
        });
        group.finish();
    }
}

fn pack(criterion: &mut Criterion) {
    let scenario = Scenario::load("figure8-morph", &[]).expect("it is shipped");
    for role in Role::STEPPING {
        components::build(role, &scenario, PackState { criterion, role }).expect("it flies");
    }
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
