//! Which samples count: those of processes in the registry, and of the launcher where it alone writes.

use iceoryx2::prelude::{Config, FilePath, NodeBuilder, SemanticString as _, ipc};
use runtime::executor::StateSink as _;
use runtime::ipc::{
    Bus, IpcSink, LatestPort, ServiceKind, StatePublisher, StateService, StateSubscriber,
    TopicFactory,
};
use runtime::namespace::Membership;
use runtime::{Sink as _, Source as _, life_number};
use shared_types::{
    ClockRecord, Deviation, Flag, Header, LoopStats, PoseFix, Progress, Registry, RegistryEntry,
    Role, Seat, Seating, topics,
};

/// A run with a launcher, a plant that is in the registry as its third process, and a stranger.
struct Run {
    launcher: Bus,
    plant: Bus,
    stranger: Bus,
    registry: IpcSink<Registry>,
    _registry_service: TopicFactory<Registry>,
    /// Dropped last, because it wipes.
    membership: Membership,
}

const PLANT: Seat = Seat::first(Role::Plant);
const GENERATION: u32 = 2;

impl Run {
    fn found(name: &str) -> Self {
        let id = format!("test-{name}-{}", std::process::id());
        let membership = Membership::found(&id).expect("memory for a run");
        let join = |name| Bus::join(&membership.ipc_config(), name).expect("a connection");
        let (launcher, plant, stranger) = (join("launcher"), join("plant"), join("stranger"));
        launcher.lead().expect("the run's folder can be written");
        let registry_service =
            launcher.create_service::<Registry>(ServiceKind::Registry, 2).expect("memory");
        let registry = launcher.open_writer::<Registry>(ServiceKind::Registry).expect("a writer");
        // Its reader is open before the first registry is written.
        launcher.read_registry(|_| ()).expect("a reader");
        Self {
            launcher,
            plant,
            stranger,
            registry,
            _registry_service: registry_service,
            membership,
        }
    }

    fn join(&self, name: &str) -> Bus {
        Bus::join(&self.membership.ipc_config(), name).expect("a connection")
    }

    /// A registry with the process of a connection as the plant.
    fn registry_with(bus: &Bus) -> Registry {
        let mut registry = Registry { count: 1, ..Registry::default() };
        registry.entries[0] = RegistryEntry {
            node: bus.identity(),
            role: PLANT.role,
            generation: GENERATION,
            present: Flag::Yes,
            ..RegistryEntry::default()
        };
        registry
    }

    fn enter_plant(&mut self) {
        self.registry.send(&Self::registry_with(&self.plant));
    }

    /// Service, and samples of it that were ignored, by writer.
    fn strays(&self) -> Vec<(String, u64)> {
        let own = std::process::id();
        let strays = self.launcher.strays();
        assert!(strays.iter().all(|stray| stray.pid == own), "{strays:?}");
        strays.iter().map(|stray| (stray.service.to_string(), stray.samples)).collect()
    }
}

#[test]
fn only_registered_writers_are_read_and_strays_are_counted_with_their_process() {
    let mut run = Run::found("registry");
    let _topic = run.launcher.create_topic(&topics::POSE_FIX).unwrap();
    let mut reader = run.launcher.reader(&topics::POSE_FIX, Role::Plant).unwrap();
    let mut writers =
        [&run.plant, &run.stranger].map(|bus| bus.writer(&topics::POSE_FIX).expect("a writer"));
    let mut send = |index: usize, sequence, seat, generation| {
        let header = Header { sequence, seat, generation, ..Header::default() };
        writers[index].send(&PoseFix { header, ..PoseFix::default() });
    };
    let mut received = || {
        let next = core::iter::from_fn(|| reader.receive());
        next.map(|sample| sample.header.sequence).collect::<Vec<_>>()
    };
    send(0, 1, 0, 2);
    assert_eq!(received(), [], "no process is in the registry");
    run.enter_plant();
    send(0, 2, 0, 2);
    send(1, 3, 0, 2);
    send(0, 4, 1, 2);
    send(0, 5, 0, 3);
    send(0, 6, 0, 2);
    assert_eq!(received(), [2, 6], "neither a stranger nor a forged seat or generation");
    let expected = [3, 1].map(|samples| ("pose_fix".to_owned(), samples));
    assert_eq!(run.strays(), expected);
}

#[test]
fn bytes_that_are_no_sample_are_ignored_even_of_a_process_in_the_registry() {
    let mut run = Run::found("length");
    let _topic = run.launcher.create_topic(&topics::POSE_FIX).unwrap();
    let mut reader = run.launcher.reader(&topics::POSE_FIX, Role::Plant).unwrap();
    // The transport's own ports: those of this crate send whole samples only.
    let file = run.membership.ipc_config();
    let file = FilePath::new(file.as_os_str().as_encoded_bytes()).unwrap();
    let config = Config::from_file(&file).unwrap();
    let node = NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap();
    let service = node.service_builder(&"pose_fix".try_into().unwrap());
    let service = service.publish_subscribe::<[u8]>().open().unwrap();
    let size = size_of::<PoseFix>();
    let publisher = service.publisher_builder().initial_max_slice_len(size + 8).create().unwrap();
    let id = node.id().value();
    let mut registry = Run::registry_with(&run.plant);
    #[expect(clippy::cast_possible_truncation, reason = "both halves are kept")]
    let halves = [(id >> 64) as u64, id as u64];
    registry.entries[0].node = halves;
    run.registry.send(&registry);
    let header = Header { sequence: 1, generation: GENERATION, ..Header::default() };
    let mut bytes = bytemuck::bytes_of(&PoseFix { header, ..PoseFix::default() }).to_vec();
    bytes.resize(size + 8, 0);
    for length in [0, size - 1, size + 8, size] {
        let slot = publisher.loan_slice_uninit(length).unwrap();
        slot.write_from_slice(&bytes[..length]).send().unwrap();
    }
    let received = core::iter::from_fn(|| reader.receive()).map(|fix| fix.header.sequence);
    assert_eq!(received.collect::<Vec<_>>(), [1], "only the whole one");
    assert_eq!(run.strays(), [("pose_fix".to_owned(), 3)]);
}

#[test]
fn what_a_process_reports_of_another_loop_is_ignored_and_only_a_launcher_seats() {
    let mut run = Run::found("reports");
    run.enter_plant();
    let _stats = run.launcher.create_topic(&topics::LOOP_STATS).unwrap();
    let _deviations = run.launcher.create_topic(&topics::DEVIATION).unwrap();
    let _seatings = run.launcher.create_topic(&topics::SEATING).unwrap();
    let mut stats = run.launcher.reader(&topics::LOOP_STATS, Role::Supervisor).unwrap();
    let mut deviations = run.launcher.reader(&topics::DEVIATION, Role::Supervisor).unwrap();
    let mut seatings = run.launcher.reader(&topics::SEATING, Role::Supervisor).unwrap();
    let mut send_stats = run.plant.writer(&topics::LOOP_STATS).unwrap();
    let mut send_deviation = run.plant.writer(&topics::DEVIATION).unwrap();
    let mut send_seating = run.plant.writer(&topics::SEATING).unwrap();
    let (own, other) = (Role::Plant, Role::Attitude);
    let header = |number: u32, sequence| Header {
        seat: number,
        sequence,
        generation: GENERATION,
        ..Header::default()
    };
    for (sequence, number, role) in [(1, own.0, own), (2, own.0, other), (3, other.0, own)] {
        let header = header(number, sequence);
        send_stats.send(&LoopStats { header, role, ..LoopStats::default() });
    }
    let life = life_number(PLANT, GENERATION);
    let other_life = life_number(Seat::first(other), GENERATION);
    for (sequence, number, role) in [(1, life, own), (2, life, other), (3, other_life, own)] {
        let header = header(number, sequence);
        send_deviation.send(&Deviation { header, role, ..Deviation::default() });
    }
    send_seating.send(&Seating { header: header(life, 1), ..Seating::default() });
    let sequences = core::iter::from_fn(|| stats.receive()).map(|one| one.header.sequence);
    assert_eq!(sequences.collect::<Vec<_>>(), [1]);
    let sequences = core::iter::from_fn(|| deviations.receive()).map(|one| one.header.sequence);
    assert_eq!(sequences.collect::<Vec<_>>(), [1]);
    assert!(seatings.receive().is_none());
}

#[test]
fn a_process_that_leaves_a_run_takes_its_reader_of_the_registry_along() {
    let run = Run::found("leaving");
    let readers =
        || run.launcher.open_service::<Registry>(ServiceKind::Registry).unwrap().readers();
    let before = readers();
    let passing = run.join("passing");
    passing.read_registry(|_| ()).unwrap();
    assert_eq!(readers(), before + 1);
    drop(passing);
    assert_eq!(readers(), before);
}

#[test]
fn a_roll_counts_only_from_the_connection_that_leads() {
    let run = Run::found("forged-registry");
    let _topic = run.launcher.create_topic(&topics::POSE_FIX).unwrap();
    let mut reader = run.plant.reader(&topics::POSE_FIX, Role::Plant).unwrap();
    let mut forged = run.stranger.open_writer::<Registry>(ServiceKind::Registry).unwrap();
    forged.send(&Run::registry_with(&run.stranger));
    let mut poses = run.stranger.writer(&topics::POSE_FIX).unwrap();
    let header = Header { generation: GENERATION, ..Header::default() };
    poses.send(&PoseFix { header, ..PoseFix::default() });
    assert!(reader.receive().is_none());
    let strays: Vec<_> =
        run.plant.strays().iter().map(|stray| (stray.service.to_string(), stray.samples)).collect();
    assert_eq!(strays, [("registry".to_owned(), 1), ("pose_fix".to_owned(), 1)]);
}

#[test]
fn a_state_counts_only_from_its_seat_and_reaches_a_late_joiner_whole() {
    let mut run = Run::found("states");
    run.enter_plant();
    let kind = ServiceKind::State(PLANT);
    let _service: StateService = run.launcher.create_state_service(kind, 8).unwrap();
    let mut writers = [&run.plant, &run.stranger]
        .map(|bus| StatePublisher::open(bus, kind, 5_000).expect("a writer"));
    let bytes: Vec<u8> = (0..5_000_u32).map(|i| i.to_le_bytes()[0] ^ 0x5a).collect();
    let mut send = |index: usize, sequence, seat, generation, state: &[u8]| {
        let header = Header { sequence, seat, generation, ..Header::default() };
        writers[index].send(&header, state);
        writers[index].serve_late_joiners();
    };
    send(0, 1, 0, GENERATION, &bytes[..10]);
    send(0, 2, 0, GENERATION, &bytes);
    let mut subscriber = StateSubscriber::of_seat(&run.launcher, PLANT).unwrap();
    let mut received = || {
        let mut seen = Vec::new();
        while subscriber.receive(|header, state| seen.push((header.sequence, state.len()))) {}
        seen
    };
    // Writers look for new readers only when asked to.
    for index in 0..2 {
        send(index, u64::MAX - 1, 9, GENERATION, &[]);
    }
    assert_eq!(received(), [(2, 5_000)]);
    send(1, u64::MAX, 0, GENERATION, &[0xff; 10]);
    send(0, 3, 1, GENERATION, &[]);
    send(0, 4, 0, GENERATION + 1, &[]);
    send(0, 5, 0, GENERATION, &bytes[..3]);
    assert_eq!(received(), [(5, 3)], "neither a stranger nor a forged seat or generation");
}

#[test]
fn the_furthest_mark_counts_whatever_the_order_of_a_process_and_its_successor() {
    let mut run = Run::found("marks");
    run.enter_plant();
    let kind = ServiceKind::Progress(PLANT);
    let _service = run.launcher.create_service::<Progress>(kind, 4).unwrap();
    let mut port = LatestPort::progress(&run.launcher, PLANT).unwrap();
    assert!(port.latest().is_none());
    let [mut old, mut new] =
        [(), ()].map(|()| run.plant.open_writer::<Progress>(kind).expect("a writer"));
    let progress = Progress { generation: GENERATION, ..Progress::default() };
    for (a, b) in [(40, 50), (70, 60)] {
        old.send(&Progress { mark_ns: a, ..progress });
        new.send(&Progress { mark_ns: b, ..progress });
        let mut furthest = 0;
        port.for_each_new(|p| furthest = p.mark_ns.max(furthest));
        assert_eq!(furthest, a.max(b));
    }
    assert!(port.latest().is_some());
}

#[test]
fn clock_and_handovers_count_only_from_a_launcher_that_leads_or_has_led() {
    let mut run = Run::found("leaders");
    run.enter_plant();
    let kind = ServiceKind::Handover(PLANT);
    let _clock = run.launcher.create_service::<ClockRecord>(ServiceKind::Clock, 16).unwrap();
    let _handover = run.launcher.create_state_service(kind, 16).unwrap();
    let mut clock = LatestPort::clock(&run.plant).unwrap();
    let mut handover = StateSubscriber::handovers(&run.plant, PLANT).unwrap();
    let successor = run.join("launcher");
    let mut writers = [&run.launcher, &run.stranger, &run.plant, &successor].map(|bus| {
        let clock = bus.open_writer::<ClockRecord>(ServiceKind::Clock).expect("a writer");
        (clock, StatePublisher::open(bus, kind, 4).expect("a writer"))
    });
    let mut receive = |index: usize, number: u64| {
        let (clock_writer, handover_writer) = &mut writers[index];
        clock_writer.send(&ClockRecord { end_ns: number, ..ClockRecord::default() });
        handover_writer.send(&Header { sequence: number, ..Header::default() }, &[0; 4]);
        let (mut end_ns, mut handed) = (None, None);
        clock.for_each_new(|record| end_ns = Some(record.end_ns));
        while handover.receive(|header, _| handed = Some(header.sequence)) {}
        assert_eq!(end_ns, handed);
        end_ns
    };
    assert_eq!(receive(0, 1), Some(1));
    assert_eq!(
        (receive(1, 2), receive(2, 3)),
        (None, None),
        "neither leads, in the registry or not"
    );
    successor.lead().unwrap();
    assert_eq!(receive(3, 4), Some(4));
    assert_eq!(receive(0, 5), Some(5), "what a launcher said before the next one led still counts");
    run.stranger.lead().unwrap();
    assert_eq!(receive(1, 6), None, "who spoke before it led never leads");
}
