//! The chain as processes, over bare iceoryx2: a service for each topic, an event for each node.

use crate::Result;
use crate::chain::{Node, Port, Sample, Topic};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    BackpressureStrategy, Config, FileDescriptorBased as _, NodeBuilder, Path as IoxPath,
    SemanticString as _, ServiceName, ipc,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::BorrowedFd;
use std::any::Any;
use std::path::Path;

/// Samples that a reader may be behind by.
const DEPTH: usize = 1024;
/// How long the recorder sleeps when there is nothing \[ns\].
const PAUSE_NS: i64 = 1_000_000;

type Ipc = ipc::Service;
type Service = publish_subscribe::PortFactory<Ipc, Sample, ()>;

fn config(folder: &Path) -> Result<Config> {
    let mut config = Config::default();
    let folder = folder.to_str().ok_or("a folder's name")?;
    config.global.set_root_path(&IoxPath::new(folder.as_bytes())?);
    // Shared memory has one namespace: two runs must not meet in it.
    let prefix: String = folder.chars().filter(char::is_ascii_alphanumeric).collect();
    config.global.prefix = iceoryx2::prelude::FileName::new(format!("peers_{prefix}_").as_bytes())?;
    Ok(config)
}

fn node(folder: &Path) -> Result<iceoryx2::node::Node<Ipc>> {
    Ok(NodeBuilder::new().config(&config(folder)?).create::<Ipc>()?)
}

fn topic(node: &iceoryx2::node::Node<Ipc>, topic: Topic, records: bool) -> Result<Service> {
    let name = ServiceName::new(&format!("topic/{}", topic.name()))?;
    let builder = node.service_builder(&name).publish_subscribe::<Sample>();
    Ok(builder
        .subscriber_max_buffer_size(DEPTH)
        .history_size(0)
        .max_publishers(1)
        .max_subscribers(3)
        // A recorder must not lose any: its publishers wait for it.
        .enable_safe_overflow(!records)
        .open_or_create()?)
}

fn wake(node: &iceoryx2::node::Node<Ipc>, of: Node) -> Result<event::PortFactory<Ipc>> {
    let name = ServiceName::new(&format!("wake/{}", of.name()))?;
    Ok(node.service_builder(&name).event().open_or_create()?)
}

/// A node's ports.
pub struct Ports {
    subscribers: Vec<Subscriber<Ipc, Sample, ()>>,
    publishers: Vec<(Topic, Publisher<Ipc, Sample, ()>)>,
    notifiers: Vec<(Node, Notifier<Ipc>)>,
    listener: Listener<Ipc>,
    /// Dropped last.
    _held: Vec<Box<dyn Any>>,
}

impl Ports {
    pub fn open(folder: &Path, own: Node, records: bool) -> Result<Self> {
        let node = node(folder)?;
        let mut held: Vec<Box<dyn Any>> = Vec::new();
        let (mut subscribers, mut publishers) = (Vec::new(), Vec::new());
        for of in Topic::ALL {
            if of.from() != own && !of.to().contains(&own) {
                continue;
            }
            let service = topic(&node, of, records)?;
            if of.from() == own {
                let strategy = if records {
                    BackpressureStrategy::RetryUntilDelivered
                } else {
                    BackpressureStrategy::DiscardData
                };
                let builder = service.publisher_builder().backpressure_strategy(strategy);
                publishers.push((of, builder.create()?));
            } else {
                subscribers.push(service.subscriber_builder().create()?);
            }
            held.push(Box::new(service));
        }
        let mut notifiers = Vec::new();
        for other in Node::ALL.into_iter().filter(|other| *other != own) {
            if publishers.iter().any(|(topic, _)| topic.to().contains(&other)) {
                let event = wake(&node, other)?;
                notifiers.push((other, event.notifier_builder().create()?));
                held.push(Box::new(event));
            }
        }
        let event = wake(&node, own)?;
        let listener = event.listener_builder().create()?;
        held.push(Box::new(event));
        held.push(Box::new(node));
        Ok(Self { subscribers, publishers, notifiers, listener, _held: held })
    }
}

impl Port for Ports {
    fn send(&mut self, sample: &Sample) -> Result<()> {
        let of = sample.topic();
        let publisher = self.publishers.iter().find(|(topic, _)| Some(*topic) == of);
        let (_, publisher) = publisher.ok_or("a topic of another node")?;
        publisher.loan_uninit()?.write_payload(*sample).send()?;
        for node in sample.needed_by() {
            if let Some((_, notifier)) = self.notifiers.iter().find(|(other, _)| *other == node) {
                notifier.notify()?;
            }
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Sample>> {
        for subscriber in &self.subscribers {
            while let Some(sample) = subscriber.receive()? {
                let sample = *sample.payload();
                // All readers of a topic get all of it; what a node does not need it was not woken for.
                if sample.topic() != Some(Topic::Estimate) || self.needs(&sample) {
                    return Ok(Some(sample));
                }
            }
        }
        Ok(None)
    }

    /// The listener's own limit of a wait is one of the socket, which the kernel rounds to its ticks of some milliseconds:
    /// no plant could keep its rate by it.
    fn wait(&mut self, until_ns: Option<u64>) -> Result<()> {
        #[expect(unsafe_code, reason = "the listener, which owns it, outlives the call")]
        // SAFETY: the descriptor is the listener's, which is borrowed for the whole call.
        let descriptor =
            unsafe { BorrowedFd::borrow_raw(self.listener.file_descriptor().native_handle()) };
        let limit = until_ns.map(crate::node::left_until);
        poll(&mut [PollFd::new(&descriptor, PollFlags::IN)], limit.as_ref())?;
        self.listener.try_wait(|_| {})?;
        Ok(())
    }
}

impl Ports {
    fn needs(&self, sample: &Sample) -> bool {
        // The position loop publishes set points, the attitude loop wrenches.
        let own = self.publishers.first().map(|(topic, _)| topic.from());
        sample.needed_by().any(|node| Some(node) == own)
    }
}

/// The recorder's end.
pub struct Inbox {
    subscribers: Vec<Subscriber<Ipc, Sample, ()>>,
    turn: usize,
    _held: Vec<Box<dyn Any>>,
}

impl Inbox {
    pub fn open(folder: &Path) -> Result<Self> {
        let node = node(folder)?;
        let mut held: Vec<Box<dyn Any>> = Vec::new();
        let mut subscribers = Vec::new();
        for of in Topic::ALL {
            let service = topic(&node, of, true)?;
            subscribers.push(service.subscriber_builder().create()?);
            held.push(Box::new(service));
        }
        held.push(Box::new(node));
        Ok(Self { subscribers, turn: 0, _held: held })
    }

    pub fn next(&mut self) -> Result<Sample> {
        loop {
            for _ in 0..self.subscribers.len() {
                if let Some(sample) = self.subscribers[self.turn].receive()? {
                    return Ok(*sample.payload());
                }
                self.turn = (self.turn + 1) % self.subscribers.len();
            }
            let pause = rustix::time::Timespec { tv_sec: 0, tv_nsec: PAUSE_NS };
            let _ = rustix::thread::nanosleep(&pause);
        }
    }
}
