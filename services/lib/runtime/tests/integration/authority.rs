//! Whose samples count: those of processes in the registry, and of the launcher where it alone writes.

use runtime::executor::StateSink as _;
use runtime::ipc::{
    Bus, IpcSink, LatestPort, ServiceKind, StatePublisher, StateService, StateSubscriber,
    TopicFactory,
};
use runtime::namespace::Membership;
use runtime::{Sink as _, Source as _};
use shared_types::{
    ClockRecord, Flag, Header, PoseFix, Progress, Registry, RegistryEntry, Role, Seat, topics,
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
fn only_those_on_the_roll_are_heard_and_strays_are_counted_with_their_process() {
    let mut run = Run::found("registry");
    let _topic = run.launcher.create_topic(&topics::POSE_FIX).unwrap();
    let mut reader = run.launcher.reader(&topics::POSE_FIX, Role::Plant).unwrap();
    let mut says =
        [&run.plant, &run.stranger].map(|bus| bus.writer(&topics::POSE_FIX).expect("a writer"));
    let mut say = |who: usize, sequence, seat, generation| {
        let header = Header { sequence, seat, generation, ..Header::default() };
        says[who].send(&PoseFix { header, ..PoseFix::default() });
    };
    let mut heard = || {
        let next = core::iter::from_fn(|| reader.receive());
        next.map(|sample| sample.header.sequence).collect::<Vec<_>>()
    };
    say(0, 1, 0, 2);
    assert_eq!(heard(), [], "no process is in the registry");
    run.enter_plant();
    say(0, 2, 0, 2);
    say(1, 3, 0, 2);
    say(0, 4, 1, 2);
    say(0, 5, 0, 3);
    say(0, 6, 0, 2);
    assert_eq!(heard(), [2, 6], "neither a stranger nor a forged seat or generation");
    let told = [3, 1].map(|samples| ("pose_fix".to_owned(), samples));
    assert_eq!(run.strays(), told);
}

#[test]
fn who_leaves_a_run_takes_its_reader_of_the_roll_along() {
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
    let told: Vec<_> =
        run.plant.strays().iter().map(|stray| (stray.service.to_string(), stray.samples)).collect();
    assert_eq!(told, [("registry".to_owned(), 1), ("pose_fix".to_owned(), 1)]);
}

#[test]
fn a_state_counts_only_from_its_seat_and_reaches_a_late_joiner_whole() {
    let mut run = Run::found("states");
    run.enter_plant();
    let kind = ServiceKind::State(PLANT);
    let _service: StateService = run.launcher.create_state_service(kind, 8).unwrap();
    let mut says = [&run.plant, &run.stranger]
        .map(|bus| StatePublisher::open(bus, kind, 5_000).expect("a writer"));
    let bytes: Vec<u8> = (0..5_000_u32).map(|i| i.to_le_bytes()[0] ^ 0x5a).collect();
    let mut say = |who: usize, sequence, seat, generation, state: &[u8]| {
        let header = Header { sequence, seat, generation, ..Header::default() };
        says[who].send(&header, state);
        says[who].serve_late_joiners();
    };
    say(0, 1, 0, GENERATION, &bytes[..10]);
    say(0, 2, 0, GENERATION, &bytes);
    let mut subscriber = StateSubscriber::of_seat(&run.launcher, PLANT).unwrap();
    let mut heard = || {
        let mut seen = Vec::new();
        while subscriber.receive(|header, state| seen.push((header.sequence, state.len()))) {}
        seen
    };
    // The writers look for readers that have joined when they are told to.
    for who in 0..2 {
        say(who, u64::MAX - 1, 9, GENERATION, &[]);
    }
    assert_eq!(heard(), [(2, 5_000)]);
    say(1, u64::MAX, 0, GENERATION, &[0xff; 10]);
    say(0, 3, 1, GENERATION, &[]);
    say(0, 4, 0, GENERATION + 1, &[]);
    say(0, 5, 0, GENERATION, &bytes[..3]);
    assert_eq!(heard(), [(5, 3)], "neither a stranger nor a forged seat or generation");
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
fn clock_and_handovers_count_only_from_who_leads_or_has_led() {
    let mut run = Run::found("leaders");
    run.enter_plant();
    let kind = ServiceKind::Handover(PLANT);
    let _clock = run.launcher.create_service::<ClockRecord>(ServiceKind::Clock, 16).unwrap();
    let _handover = run.launcher.create_state_service(kind, 16).unwrap();
    let mut clock = LatestPort::clock(&run.plant).unwrap();
    let mut handover = StateSubscriber::handovers(&run.plant, PLANT).unwrap();
    let successor = run.join("launcher");
    let mut speakers = [&run.launcher, &run.stranger, &run.plant, &successor].map(|bus| {
        let clock = bus.open_writer::<ClockRecord>(ServiceKind::Clock).expect("a writer");
        (clock, StatePublisher::open(bus, kind, 4).expect("a writer"))
    });
    let mut hear = |who: usize, number: u64| {
        let (speaks, hands_over) = &mut speakers[who];
        speaks.send(&ClockRecord { end_ns: number, ..ClockRecord::default() });
        hands_over.send(&Header { sequence: number, ..Header::default() }, &[0; 4]);
        let (mut told, mut handed) = (None, None);
        clock.for_each_new(|record| told = Some(record.end_ns));
        while handover.receive(|header, _| handed = Some(header.sequence)) {}
        assert_eq!(told, handed);
        told
    };
    assert_eq!(hear(0, 1), Some(1));
    assert_eq!((hear(1, 2), hear(2, 3)), (None, None), "neither leads, in the registry or not");
    successor.lead().unwrap();
    assert_eq!(hear(3, 4), Some(4));
    assert_eq!(hear(0, 5), Some(5), "what a launcher said before the next one led still counts");
    run.stranger.lead().unwrap();
    assert_eq!(hear(1, 6), None, "who spoke before it led never leads");
}
