//! What the recorder takes: samples and states of a flight, offered through shared memory faster than a
//! flight publishes them, to what a launcher drains and records with. Shared with `cargo bench --bench recorder`.

use flight::tap::Tap;
use observe::{Metrics, Observer};
use protocol::control::runs::note_measurement;
use record::{Clock, Facts, Recorder};
use runtime::clock::mono_now_ns;
use runtime::ipc::{
    Bus, IpcSink, PortError, RECORDER_CAPACITY, STATE_DEPTH, ServiceKind, StatePublisher,
};
use runtime::namespace::Membership;
use runtime::{Graph, Sink as _, StateHeader, StateSink as _};
use shared_types::wire::Value as _;
use shared_types::{Edge, Header, Registry, Role, Sample, Seat, Topic, TopicInfo, topics};
use simulate::alone::{End, Ended, sum_up};
use simulate::in_process::{Conclusion, InProcess, StateSource};
use simulate::setup::{RunError, RunOptions, facts, recording_path, system};
use simulate::{Sinks, Summary};
use std::any::Any;
use std::collections::BTreeMap;
use std::path::PathBuf;
use swap::services::HeldServices;

/// What one producer has published, to be published again and again.
trait Lane: Any {
    /// Topic, or `state/` and a role.
    fn name(&self) -> String;
    /// Samples that the recorder's reader keeps.
    fn depth(&self) -> u64;
    fn open(&mut self, buses: &Buses<'_>) -> Result<(), PortError>;
    /// Publishes the next one, `later_ns` after its time.
    fn send(&mut self, later_ns: u64);
}

/// Headers of a lane, counted on where it begins anew.
#[derive(Default)]
struct Numbers {
    next: usize,
    round: u64,
    /// First and last sequence of each seat.
    spans: BTreeMap<u32, (u64, u64)>,
}

impl Numbers {
    fn learn(&mut self, header: &Header) {
        let span = self.spans.entry(header.seat).or_insert((header.sequence, header.sequence));
        span.1 = header.sequence;
    }

    /// Place of the next one in a lane of `length`.
    fn take(&mut self, length: usize) -> usize {
        if self.next == length {
            (self.next, self.round) = (0, self.round + 1);
        }
        self.next += 1;
        self.next - 1
    }

    fn set(&self, header: &mut Header, later_ns: u64) {
        let (first, last) = self.spans.get(&header.seat).copied().unwrap_or_default();
        header.sequence += self.round * (last - first + 1);
        header.release_ns += later_ns;
        header.valid_ns += later_ns;
        header.publish_mono_ns = mono_now_ns();
    }
}

struct Samples<T: Sample> {
    topic: &'static Topic<T>,
    samples: Vec<T>,
    numbers: Numbers,
    /// By the role of the process that publishes; what only one process does is under that one.
    sinks: BTreeMap<u32, IpcSink<T>>,
}

impl<T: Sample> Samples<T> {
    /// Role of the process that publishes a sample.
    fn writer_of(&self, sample: &T) -> u32 {
        /// Loops and their lives are numbered so that this is left of the number's division by it.
        const ROLES: u32 = 8;
        let producer = self.topic.info.from;
        if is_about_itself(&self.topic.info) { sample.header().seat % ROLES } else { producer.0 }
    }
}

/// Whether each process publishes what it has to report of itself.
fn is_about_itself(topic: &TopicInfo) -> bool {
    topic.from == Role::Supervisor
        && topic.edge == Edge::RecordOnly
        && topic.name != topics::SEATING.info.name
}

impl<T: Sample> Lane for Samples<T> {
    fn name(&self) -> String {
        self.topic.info.name.to_owned()
    }

    fn depth(&self) -> u64 {
        RECORDER_CAPACITY as u64
    }

    fn open(&mut self, buses: &Buses<'_>) -> Result<(), PortError> {
        if is_about_itself(&self.topic.info) {
            for (role, bus) in &buses.others {
                self.sinks.insert(role.0, bus.writer(self.topic)?);
            }
            return Ok(());
        }
        let bus = buses.of(buses.graph.producer(&self.topic.info));
        self.sinks.insert(self.topic.info.from.0, bus.writer(self.topic)?);
        Ok(())
    }

    fn send(&mut self, later_ns: u64) {
        let mut sample = self.samples[self.numbers.take(self.samples.len())];
        self.numbers.set(sample.header_mut(), later_ns);
        let writer = self.writer_of(&sample);
        if let Some(sink) = self.sinks.get_mut(&writer) {
            sink.send(&sample);
        }
    }
}

struct States {
    role: Role,
    states: Vec<(Header, Vec<u8>)>,
    numbers: Numbers,
    sink: Option<StatePublisher>,
}

impl Lane for States {
    fn name(&self) -> String {
        format!("state/{}", self.role.label())
    }

    fn depth(&self) -> u64 {
        STATE_DEPTH as u64
    }

    fn open(&mut self, buses: &Buses<'_>) -> Result<(), PortError> {
        let longest = self.states.iter().map(|(_, state)| state.len()).max().unwrap_or(0);
        let kind = ServiceKind::State(Seat::first(self.role));
        self.sink = Some(StatePublisher::open(buses.of(self.role), kind, longest)?);
        Ok(())
    }

    fn send(&mut self, later_ns: u64) {
        let place = self.numbers.take(self.states.len());
        let (header, state) = &mut self.states[place];
        let mut header = *header;
        self.numbers.set(&mut header, later_ns);
        let head = &mut state[..StateHeader::PACKED_SIZE];
        let (release_ns, state_sequence) = (header.release_ns, header.sequence);
        StateHeader { release_ns, state_sequence, ..StateHeader::unpack(head) }.pack(head);
        if let Some(sink) = &mut self.sink {
            sink.send(&header, state);
        }
    }
}

/// A flight as it was published.
#[derive(Default)]
struct Tape {
    lanes: Vec<Box<dyn Lane>>,
    /// Lane of each sample and state.
    order: Vec<usize>,
}

impl Tape {
    fn lane<L: Lane>(&mut self, name: &str, new: impl FnOnce() -> L) -> &mut L {
        let known = self.lanes.iter().position(|lane| lane.name() == name);
        let place = known.unwrap_or_else(|| {
            self.lanes.push(Box::new(new()));
            self.lanes.len() - 1
        });
        self.order.push(place);
        let lane: &mut dyn Any = &mut *self.lanes[place];
        match lane.downcast_mut() {
            Some(lane) => lane,
            None => unreachable!("a name belongs to one kind of sample"),
        }
    }
}

impl Observer for Tape {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let new = || Samples {
            topic,
            samples: Vec::new(),
            numbers: Numbers::default(),
            sinks: BTreeMap::new(),
        };
        let lane: &mut Samples<T> = self.lane(topic.info.name, new);
        lane.numbers.learn(sample.header());
        lane.samples.push(*sample);
    }

    fn wants_states(&self) -> bool {
        true
    }

    fn observe_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        let new = || States { role, states: Vec::new(), numbers: Numbers::default(), sink: None };
        let lane: &mut States = self.lane(&format!("state/{}", role.label()), new);
        lane.numbers.learn(header);
        lane.states.push((*header, state.to_vec()));
    }
}

/// A connection for every role: a connection is one process in the registry.
struct Buses<'a> {
    graph: &'a Graph,
    own: &'a Bus,
    others: BTreeMap<Role, Bus>,
}

impl Buses<'_> {
    fn of(&self, role: Role) -> &Bus {
        self.others.get(&role).unwrap_or(self.own)
    }
}

/// A recorder with a flight that is offered to it, on and on.
pub(crate) struct Burst {
    tape: Tape,
    next: usize,
    round: u64,
    duration_ns: u64,
    /// By lane: offered so far, and since the last drain.
    offered: Vec<(u64, u64)>,
    tap: Tap,
    options: RunOptions,
    id: String,
    path: Option<PathBuf>,
    begun_mono_ns: u64,
    _buses: BTreeMap<Role, Bus>,
    _registry: IpcSink<Registry>,
    _services: HeldServices,
    _bus: Bus,
    /// Dropped last, because it wipes.
    _membership: Membership,
}

impl core::fmt::Debug for Burst {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Burst").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Burst {
    /// Flies the scenario in this process, keeps what it publishes, and opens everything that a
    /// launcher drains; `id` names a run of its own. A process can do this once, as its first use of
    /// the transport.
    pub(crate) fn prepare(options: RunOptions, id: &str) -> Result<Self, RunError> {
        scenario::needs::MemoryNeed::LOCKSTEP.look(0).map_err(RunError::from)?;
        let not_ready =
            |error: simulate::in_process::InProcessError| RunError::NotReady(error.to_string());
        let scenario = &options.scenario;
        let mut flight =
            InProcess::new(scenario, StateSource::Estimator, Tape::default()).map_err(not_ready)?;
        flight.fly_until(u64::MAX).map_err(not_ready)?;
        flight.finish();
        let mut tape: Tape = flight.seen(core::mem::take);
        let graph = scenario.graph().map_err(|error| RunError::Wiring(error.to_string()))?;
        let membership = Membership::found(id)?;
        note_measurement(membership.folder()).map_err(system("write the run's folder"))?;
        let bus = Bus::join(&membership.ipc_config(), "launcher")?;
        bus.lead()?;
        let services = HeldServices::create(&bus)?;
        let path = options.record.as_deref().map(|dir| recording_path(dir, id)).transpose()?;
        // In realtime no process waits for the recorder, but the recorder has a disk to fill.
        let facts = Facts { clock: Clock::Realtime { speed: 1.0 }, ..facts(id, &options) };
        let mut recording =
            path.as_deref().map(|path| Recorder::create(path, &facts)).transpose()?;
        if let Some(recording) = &mut recording {
            recording.set_start(mono_now_ns());
        }
        let roles: Vec<Role> = graph.nodes().iter().map(|node| node.role).collect();
        let sinks = Sinks::new(&roles, Metrics::of(scenario), recording);
        let tap = Tap::open(&bus, &graph, sinks)?;
        let mut others = BTreeMap::new();
        let mut registry = Registry::default();
        for (entry, &role) in registry.entries.iter_mut().zip(&roles) {
            let bus = Bus::join(&membership.ipc_config(), role.label())?;
            (entry.node, entry.role) = (bus.identity(), role);
            registry.count += 1;
            others.insert(role, bus);
        }
        let mut announce = bus.open_writer::<Registry>(ServiceKind::Registry)?;
        announce.send(&registry);
        let buses = Buses { graph: &graph, own: &bus, others };
        for lane in &mut tape.lanes {
            lane.open(&buses)?;
        }
        let Buses { others, .. } = buses;
        Ok(Self {
            offered: vec![(0, 0); tape.lanes.len()],
            tape,
            next: 0,
            round: 0,
            duration_ns: scenario.duration_ns(),
            tap,
            id: id.to_owned(),
            path,
            begun_mono_ns: mono_now_ns(),
            options,
            _buses: others,
            _registry: announce,
            _services: services,
            _bus: bus,
            _membership: membership,
        })
    }

    /// Publishes the next `count` samples and states of the flight as fast as it can.
    pub(crate) fn offer(&mut self, count: u64) {
        for _ in 0..count {
            self.offer_one();
        }
    }

    /// Publishes as many samples and states as the recorder's readers keep, and returns how many.
    pub(crate) fn fill(&mut self) -> u64 {
        let mut count = 0;
        loop {
            let lane = self.tape.order[self.next];
            if self.offered[lane].1 == self.tape.lanes[lane].depth() {
                return count;
            }
            self.offer_one();
            count += 1;
        }
    }

    /// As [`fill`](Self::fill), whatever waits to be drained: what has not been drained is pushed out.
    pub(crate) fn fill_again(&mut self) -> u64 {
        self.forget_waiting();
        self.fill()
    }

    fn forget_waiting(&mut self) {
        for (_, waiting) in &mut self.offered {
            *waiting = 0;
        }
    }

    fn offer_one(&mut self) {
        let lane = self.tape.order[self.next];
        self.tape.lanes[lane].send(self.round * self.duration_ns);
        self.offered[lane].0 += 1;
        self.offered[lane].1 += 1;
        self.next += 1;
        if self.next == self.tape.order.len() {
            (self.next, self.round) = (0, self.round + 1);
        }
    }

    /// What the launcher does every millisecond.
    pub(crate) fn drain(&mut self) {
        self.tap.drain(mono_now_ns());
        self.forget_waiting();
    }

    /// Samples and states of the flight, once.
    pub(crate) fn per_flight(&self) -> usize {
        self.tape.order.len()
    }

    /// So many of each topic, and of each role's states under `state/`, so far.
    pub(crate) fn offered(&self) -> BTreeMap<String, u64> {
        let names = self.tape.lanes.iter().map(|lane| lane.name());
        names.zip(self.offered.iter().map(|(all, _)| *all)).collect()
    }

    /// Ends the recording as a flight does.
    pub(crate) fn finish(mut self) -> Result<Summary, RunError> {
        self.drain();
        let flown_ns = self.options.scenario.duration_ns();
        let ended = Ended {
            id: self.id,
            path: self.path,
            wall_ns: mono_now_ns().saturating_sub(self.begun_mono_ns),
            from_ns: 0,
            flown_ns,
            end: Ok(End::Flown),
            conclusion: Conclusion::default(),
        };
        sum_up(self.tap.sinks, &self.options, ended)
    }
}
