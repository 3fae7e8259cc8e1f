//! A state estimate from publication to effect through the runtime's ports, against the bare transport
//! with the same sample and the same service, in one process; and what of it the stamps of a trace cost.

mod registry;

use core::hint::black_box;
use criterion::{Criterion, criterion_group, criterion_main};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Config, NodeBuilder, ZeroCopySend, ipc};
use registry::{Held, enrol};
use runtime::clock::mono_now_ns;
use runtime::graph::READER_CAPACITY;
use runtime::ipc::{Bus, RECORDER_CAPACITY};
use runtime::namespace::Membership;
use runtime::{Input, Output, Sink as _};
use shared_types::{Header, Role, StateEstimate, topics};
use std::error::Error;
use std::io::Write as _;

const PERIOD_NS: u64 = 1_000_000;
/// Hops per block, and blocks of each kind, in turns.
const BLOCK: u64 = 2_000;
const BLOCKS: usize = 200;

/// Through [`Output`] and [`Input`]: stamped, sequenced, ordered, put into effect.
struct Ported {
    output: Output<StateEstimate>,
    input: Input<StateEstimate>,
    release_ns: u64,
    /// Keeps this process registered, so that the reader accepts its samples.
    registry: Held,
}

impl Ported {
    fn open(bus: &Bus) -> Result<Self, Box<dyn Error>> {
        let mut ported = Self {
            output: Output::default(),
            input: Input::default(),
            release_ns: 0,
            registry: enrol(bus, Role::Estimator)?,
        };
        let reader = bus.reader(&topics::STATE_ESTIMATE, Role::Estimator)?;
        ported.input.connect(Box::new(reader), None);
        ported.output.connect(Box::new(bus.writer(&topics::STATE_ESTIMATE)?), 0);
        // The registry was written before its reader was there.
        ported.registry.1.serve_late_joiners();
        Ok(ported)
    }

    fn hop(&mut self) -> u64 {
        let previous_ns = Some(self.release_ns);
        self.release_ns += PERIOD_NS;
        self.output.write(StateEstimate::default());
        self.output.flush(&Header { release_ns: self.release_ns, ..Header::default() });
        self.input.receive();
        self.input.accept(self.release_ns, previous_ns);
        self.input.latest().map_or(0, |sample| sample.header.sequence)
    }
}

/// A state estimate to the transport alone, which the ports send as bytes.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[repr(C)]
struct Payload {
    sequence: u64,
    rest: [u64; size_of::<StateEstimate>() / 8 - 1],
}

/// The transport as it comes.
struct Bare {
    publisher: Publisher<ipc::Service, Payload, ()>,
    subscriber: Subscriber<ipc::Service, Payload, ()>,
    sequence: u64,
}

impl Bare {
    fn open() -> Result<Self, Box<dyn Error>> {
        let node = NodeBuilder::new().config(Config::global_config()).create::<ipc::Service>()?;
        let service = node
            .service_builder(&"bare".try_into()?)
            .publish_subscribe::<Payload>()
            .subscriber_max_buffer_size(RECORDER_CAPACITY)
            .history_size(topics::STATE_ESTIMATE.info.history)
            .enable_safe_overflow(true)
            .create()?;
        let subscriber = service.subscriber_builder().buffer_size(READER_CAPACITY).create()?;
        let publisher = service.publisher_builder().max_loaned_samples(1).create()?;
        Ok(Self { publisher, subscriber, sequence: 0 })
    }

    fn hop(&mut self) -> u64 {
        self.sequence += 1;
        let sample =
            Payload { sequence: self.sequence, rest: [0; size_of::<StateEstimate>() / 8 - 1] };
        if let Ok(slot) = self.publisher.loan_uninit() {
            let _ = slot.write_payload(sample).send();
        }
        let received = self.subscriber.receive().ok().flatten();
        received.map_or(0, |sample| sample.payload().sequence)
    }
}

/// Median block of each kind, so that a disturbed block decides nothing.
fn compare(ported: &mut Ported, bare: &mut Bare) {
    let block_ns = |hop: &mut dyn FnMut() -> u64| {
        let start_ns = mono_now_ns();
        for _ in 0..BLOCK {
            black_box(hop());
        }
        mono_now_ns() - start_ns
    };
    let (mut with_ports, mut without) = (Vec::new(), Vec::new());
    for _ in 0..BLOCKS {
        with_ports.push(block_ns(&mut || ported.hop()));
        without.push(block_ns(&mut || bare.hop()));
    }
    with_ports.sort_unstable();
    without.sort_unstable();
    let (ports_ns, bare_ns) = (with_ports[BLOCKS / 2] / BLOCK, without[BLOCKS / 2] / BLOCK);
    let ratio = ports_ns as f64 / bare_ns as f64;
    let line = format!("ports {ports_ns} ns, bare {bare_ns} ns, ratio {ratio:.2}");
    let _ = writeln!(std::io::stdout(), "median hop: {line}");
}

/// What a step and its hop do only for `morphquad trace`: three stamps, and the header's fields.
fn tracing(ported: &mut Ported) {
    let stamps = |ported: &Ported| {
        let (receive_mono_ns, start_mono_ns) = (mono_now_ns(), mono_now_ns());
        let origin = ported.input.origin();
        let input_sequence = origin.sequence.wrapping_add(origin.receive_mono_ns);
        let publish_mono_ns = mono_now_ns();
        let Header { release_mono_ns, cause_sequence, .. } = Header::default();
        black_box(Header {
            cause_sequence,
            input_sequence,
            receive_mono_ns,
            release_mono_ns,
            start_mono_ns,
            publish_mono_ns,
            ..Header::default()
        })
    };
    let mut blocks: Vec<u64> = (0..BLOCKS)
        .map(|_| {
            let start_ns = mono_now_ns();
            for _ in 0..BLOCK {
                black_box(stamps(ported));
            }
            (mono_now_ns() - start_ns) / BLOCK
        })
        .collect();
    blocks.sort_unstable();
    let allocations = allocation_counter::measure(|| {
        for _ in 0..BLOCK {
            black_box(ported.hop());
        }
    });
    let line = format!(
        "{} ns a hop for its stamps, {} allocations in {BLOCK} hops",
        blocks[BLOCKS / 2],
        allocations.count_total
    );
    let _ = writeln!(std::io::stdout(), "tracing: {line}");
}

fn hop(criterion: &mut Criterion) {
    let id = format!("bench{:x}", std::process::id());
    let run = Membership::found(&id).expect("shared memory is writable");
    let bus = Bus::join(&run.ipc_config(), "bench").expect("the run is new");
    let _held = bus.create_topic(&topics::STATE_ESTIMATE).expect("the run is new");
    let mut ported = Ported::open(&bus).expect("the topic is there");
    let mut bare = Bare::open().expect("the run is new");
    assert_eq!((ported.hop(), bare.hop()), (1, 1), "a sample goes round");
    let mut group = criterion.benchmark_group("hop");
    group.bench_function("ports", |b| b.iter(|| ported.hop()));
    group.bench_function("bare", |b| b.iter(|| bare.hop()));
    group.finish();
    compare(&mut ported, &mut bare);
    tracing(&mut ported);
}

criterion_group!(benches, hop);
criterion_main!(benches);
