//! A ring of five processes: each waits for its predecessor's sample and sends one on.
//!
//! It does nothing else, so a lap is what five hops cost at least: a sample published, a wake-up, a
//! switch of process, a sample received.

use crate::Result;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Config, Node, NodeBuilder, ServiceName, ZeroCopySend, ipc};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use runtime::clock::mono_now_ns;
use runtime::ipc::{Bus, WakeListener, WakeNotifier};
use runtime::namespace::Membership;
use rustix::thread::{CpuSet, sched_setaffinity};
use shared_types::{Role, Seat, StateEstimate};
use std::any::Any;
use std::io::{BufRead as _, Write as _};
use std::path::Path;
use std::time::Duration;

/// Processes in the ring, as in a flight.
pub(crate) const NODES: usize = 5;
/// As in a flight: then shared memory is read again.
const WAIT_LIMIT: Duration = Duration::from_millis(20);

type Ipc = ipc::Service;
type Topic = publish_subscribe::PortFactory<Ipc, Payload, ()>;

/// As large as a state estimate.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[repr(C)]
struct Payload {
    sequence: u64,
    rest: [u64; size_of::<StateEstimate>() / 8 - 1],
}

/// How the processes of a ring wake one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Waking {
    /// The transport's own events.
    Events,
    /// The runtime's wake-ups.
    Runtime,
}

impl Waking {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Events => "iceoryx2 events",
            Self::Runtime => "runtime's wake-ups",
        }
    }
}

/// Services of a ring, held while it turns.
pub(crate) struct Held {
    _services: Vec<Box<dyn Any>>,
}

fn node() -> Result<Node<Ipc>> {
    Ok(NodeBuilder::new().config(Config::global_config()).create::<Ipc>()?)
}

fn name(kind: &str, place: usize) -> Result<ServiceName> {
    Ok(ServiceName::new(&format!("ring/{kind}/{place}"))?)
}

/// Creates what the processes of a ring open.
pub(crate) fn create(bus: &Bus) -> Result<Held> {
    let node = node()?;
    let mut services: Vec<Box<dyn Any>> = Vec::new();
    for (place, role) in Role::STEPPING.into_iter().enumerate().take(NODES) {
        bus.create_wake(Seat::first(role))?;
        let event = node.service_builder(&name("event", place)?).event().create()?;
        let topic = node
            .service_builder(&name("topic", place)?)
            .publish_subscribe::<Payload>()
            .subscriber_max_buffer_size(16)
            .history_size(1)
            .enable_safe_overflow(true)
            .create()?;
        services.push(Box::new((event, topic)));
    }
    services.push(Box::new(node));
    Ok(Held { _services: services })
}

/// Waiting for the predecessor and waking the successor.
enum Wake {
    Events(Box<(Listener<Ipc>, Notifier<Ipc>)>),
    Runtime(WakeListener, WakeNotifier),
}

impl Wake {
    fn open(waking: Waking, bus: &Bus, node: &Node<Ipc>, place: usize) -> Result<Self> {
        let next = (place + 1) % NODES;
        if waking == Waking::Runtime {
            let seat = |place: usize| Seat::first(Role::STEPPING[place]);
            let listener = WakeListener::open(bus, seat(place))?;
            return Ok(Self::Runtime(listener, WakeNotifier::open(bus, seat(next))?));
        }
        let open = |place| -> Result<event::PortFactory<Ipc>> {
            Ok(node.service_builder(&name("event", place)?).event().open()?)
        };
        let listener = open(place)?.listener_builder().create()?;
        let notifier = open(next)?.notifier_builder().create()?;
        Ok(Self::Events(Box::new((listener, notifier))))
    }

    fn wait(&self) {
        match self {
            Self::Events(ends) => drop(ends.0.timed_wait(|_| {}, WAIT_LIMIT)),
            Self::Runtime(listener, _) => _ = listener.wait(WAIT_LIMIT),
        }
    }

    fn wake(&self) {
        match self {
            Self::Events(ends) => drop(ends.1.notify()),
            Self::Runtime(_, notifier) => notifier.wake(),
        }
    }
}

struct Place {
    wake: Wake,
    publisher: Publisher<Ipc, Payload, ()>,
    subscriber: Subscriber<Ipc, Payload, ()>,
}

impl Place {
    fn open(waking: Waking, bus: &Bus, place: usize) -> Result<Self> {
        let node = node()?;
        let open = |place| -> Result<Topic> {
            let builder = node.service_builder(&name("topic", place)?);
            Ok(builder.publish_subscribe::<Payload>().open()?)
        };
        Ok(Self {
            subscriber: open(place)?.subscriber_builder().create()?,
            publisher: open((place + 1) % NODES)?.publisher_builder().create()?,
            wake: Wake::open(waking, bus, &node, place)?,
        })
    }

    fn send(&self, sequence: u64) -> Result<()> {
        let sample = Payload { sequence, rest: [0; size_of::<StateEstimate>() / 8 - 1] };
        self.publisher.loan_uninit()?.write_payload(sample).send()?;
        self.wake.wake();
        Ok(())
    }

    fn receive(&self, sequence: u64) -> Result<()> {
        loop {
            while let Some(sample) = self.subscriber.receive()? {
                if sample.payload().sequence == sequence {
                    return Ok(());
                }
            }
            self.wake.wait();
        }
    }
}

/// A process of the ring. The one in place 0 starts each lap and prints the time that all took.
pub(crate) fn be_a_node(
    place: usize,
    folder: &Path,
    kind: &str,
    laps: u64,
    cpu: &str,
) -> Result<()> {
    let mut set = CpuSet::new();
    set.set(cpu.parse()?);
    sched_setaffinity(None, &set)?;
    let waking = if kind == Waking::Runtime.name() { Waking::Runtime } else { Waking::Events };
    let member = Membership::join(folder)?;
    let bus = Bus::join(&member.ipc_config(), &format!("ring{place}"))?;
    let seat = Place::open(waking, &bus, place)?;
    let mut out = std::io::stdout();
    writeln!(out, "ready")?;
    // The parent lets all go on when all are ready.
    std::io::stdin().lock().read_line(&mut String::new())?;
    let start_ns = mono_now_ns();
    for lap in 1..=laps {
        if place == 0 {
            seat.send(lap)?;
        }
        seat.receive(lap)?;
        if place > 0 {
            seat.send(lap)?;
        }
    }
    writeln!(out, "{}", mono_now_ns() - start_ns)?;
    // No process leaves while another may still read.
    std::io::stdin().lock().read_line(&mut String::new())?;
    Ok(())
}
