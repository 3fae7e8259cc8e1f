//! Ports over iceoryx2: services by topic, layout checks, sources and sinks.
//!
//! The launcher creates and holds every service before it starts a process; processes only open.
//! (A process killed while *creating* a service would leave it unusable.) Every stream overflows:
//! a stopped reader never blocks a writer.

mod bare;
mod error;
mod lead;
mod names;
mod payload;
mod ports;
mod registry;
mod state;
mod sweeper;
mod turns;
mod wake;

pub use bare::{BareEvents, BareListener, BareNotifier, BareReader, BareWriter};
pub use error::PortError;
pub use names::ServiceKind;
pub use ports::{IpcSink, IpcSource, LatestPort, TopicFactory};
pub use registry::Stray;
use registry::{Authority, SharedRegistry};
pub use state::{StatePublisher, StateService, StateSubscriber};
pub use sweeper::Sweeper;
pub use turns::{NumberedAnswer, NumberedOrder, Order, TurnGiver, TurnTaker};
pub use wake::{WakeListener, WakeNotifier};

use crate::clock::{mono_now_ns, sleep_until};
use crate::graph::READER_CAPACITY;
use crate::namespace::{Reservation, SpareLinks};
use iceoryx2::prelude::{
    Config, FilePath, LogLevel, MessagingPattern, Node as IpcNode, NodeBuilder, SemanticString,
    Service as _, ServiceName, SignalHandlingMode, ipc, set_log_level,
};
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use shared_types::wire::Schema;
use shared_types::{Edge, NodeId, Role, Sample, Seat, Topic, TopicInfo, topics};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// The service variant used throughout.
pub type Ipc = ipc::Service;

/// Samples a recorder's reader keeps of a topic that has one sample per step.
pub const RECORDER_CAPACITY: usize = 2048;
/// The same of deviations: a loop of 1 kHz that catches up with half a second reports up to six in each step.
const DEVIATION_CAPACITY: usize = 2 * RECORDER_CAPACITY;
/// Samples of `topic` that a recorder's reader keeps.
#[must_use]
pub fn recorder_capacity(topic: &TopicInfo) -> usize {
    if topic.name == topics::DEVIATION.info.name { DEVIATION_CAPACITY } else { RECORDER_CAPACITY }
}

/// Published states that a recorder's reader keeps.
pub const STATE_DEPTH: usize = 512;
/// States offered to a successor that wait for it.
pub const HANDOVER_DEPTH: usize = 2;
const LAYOUT_KEY: &str = "layout";
/// Processes of a run, its launcher, observers and restarts on the way out.
const MAX_NODES: usize = 32;
/// Recorder and two observers.
const WATCHERS: usize = 3;
/// Processes that may take part at once, and those that have just died.
const MAX_PROCESSES: usize = Seat::TOTAL + 3;

/// For how long a process waits for room in a service, and how often it looks \[ns\]: freeing what the dead have left
/// takes tenths of a second.
const ROOM_LIMIT_NS: u64 = 3_000_000_000;
const ROOM_LOOK_NS: u64 = 2_000_000;

/// Connections that may write where the launcher alone is believed.
const LAUNCHERS: usize = 4;

/// How many readers and writers a service is made for.
#[derive(Debug, Clone, Copy)]
struct Crowd {
    readers: usize,
    writers: usize,
}

impl Crowd {
    /// A service between the launcher and all processes.
    const ALL: Self = Self { readers: MAX_PROCESSES + WATCHERS, writers: MAX_PROCESSES };
    /// A service that the launcher alone writes; there is room for dead ones, and each look at an empty port walks over
    /// it.
    const ANNOUNCED: Self = Self { readers: MAX_PROCESSES + WATCHERS, writers: LAUNCHERS };
    /// A service of one seat's states.
    const STATES: Self = Self { readers: 4, writers: 8 };

    fn of(topic: &TopicInfo) -> Self {
        let seats: u32 = topic.to.iter().map(|role| role.seats()).sum();
        let readers = usize::try_from(seats).unwrap_or(0) + WATCHERS;
        match (topic.from, topic.edge) {
            (Role::Supervisor, Edge::RecordOnly) => Self { readers, writers: MAX_PROCESSES },
            // A process that waits for a slot reads its records beside the component that judges by them.
            (Role::Supervisor, _) => {
                Self { readers: 2 * MAX_PROCESSES + WATCHERS, writers: LAUNCHERS }
            }
            _ => Self { readers, writers: 8 },
        }
    }
}

/// The transport's node behind an object: dropping a node instantiates much generic code in each crate that does so.
trait Connection: core::fmt::Debug {
    fn node(&self) -> &IpcNode<Ipc>;
}

impl Connection for IpcNode<Ipc> {
    fn node(&self) -> &Self {
        self
    }
}

/// A process's connection to its run.
#[derive(Debug)]
pub struct Bus {
    connection: Box<dyn Connection>,
    /// Where the run keeps what is not the transport's.
    folder: PathBuf,
    /// For how long a port waits until its service admits it \[ns\].
    room_limit_ns: u64,
    /// Which process leads, for all readers of this process.
    authority: Rc<Authority>,
    /// Which process sits where, for all readers of this process.
    registry: SharedRegistry,
}

impl Bus {
    /// Joins the run whose transport configuration is `config_file`, in the run's folder. A process may take
    /// part in several runs at once, each with a connection of its own.
    ///
    /// # Errors
    /// The configuration cannot be read or the node cannot be created.
    pub fn join(config_file: &Path, name: &str) -> Result<Self, PortError> {
        set_log_level(LogLevel::Fatal);
        let file = FilePath::new(config_file.as_os_str().as_encoded_bytes())
            .map_err(PortError::transport(name, "name the configuration file"))?;
        let config = Config::from_file(&file)
            .map_err(PortError::transport(name, "read the transport configuration"))?;
        // The transport falls back on the configuration of the process when it removes what a node has
        // left that died while it was created; the first run of a process is the one that does so.
        Config::setup_global_config_from_file(&file)
            .map_err(PortError::transport(name, "read the transport configuration"))?;
        let node_name = name.try_into().map_err(PortError::transport(name, "name the node"))?;
        let node = NodeBuilder::new()
            .name(&node_name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(PortError::transport(name, "create a node"))?;
        let folder = config_file.parent().unwrap_or(Path::new(".")).to_path_buf();
        let authority = Rc::new(Authority::new(&folder));
        Ok(Self {
            connection: Box::new(node),
            folder,
            room_limit_ns: 0,
            authority,
            registry: SharedRegistry::default(),
        })
    }

    /// Lets each port wait for seconds until its service admits it: the launcher frees what dead processes have left.
    #[must_use]
    pub fn waiting_for_room(self) -> Self {
        Self { room_limit_ns: ROOM_LIMIT_NS, ..self }
    }

    /// Makes a port as soon as its service admits it.
    fn with_room<P: ?Sized>(
        &self,
        make: &dyn Fn() -> Result<Box<P>, PortError>,
    ) -> Result<Box<P>, PortError> {
        let give_up_ns = mono_now_ns().saturating_add(self.room_limit_ns);
        loop {
            match make() {
                Err(PortError::Full { .. }) if mono_now_ns() < give_up_ns => {
                    sleep_until(mono_now_ns() + ROOM_LOOK_NS);
                }
                made => return made,
            }
        }
    }

    /// Opens a service for reading, as soon as it admits a reader.
    fn reader_on(
        &self,
        service: &str,
        schema: &Schema,
        capacity: Option<usize>,
    ) -> Result<Box<dyn payload::Reader>, PortError> {
        let opened = self.open(service, schema)?;
        self.with_room(&|| opened.reader(capacity))
    }

    /// Opens a service for writing samples of up to so many bytes, as soon as it admits a writer.
    fn writer_on(
        &self,
        service: &str,
        schema: &Schema,
        size: usize,
    ) -> Result<Box<dyn payload::Writer>, PortError> {
        let opened = self.open(service, schema)?;
        self.with_room(&|| opened.writer(size))
    }

    /// Makes this connection the launcher's, before it writes anything: what only the launcher may
    /// write is accepted from it alone from now on, and what a launcher before it has written still
    /// counts.
    ///
    /// # Errors
    /// The run's folder cannot be written.
    pub fn lead(&self) -> Result<(), PortError> {
        lead::claim(&self.folder, self.identity())
            .map_err(|error| PortError::Lead { folder: self.folder.clone(), source: error })
    }

    /// Links the files of all services that the run has now.
    ///
    /// # Errors
    /// The run's folder cannot be written.
    pub fn spare_services(&self) -> Result<SpareLinks, PortError> {
        SpareLinks::make(&self.folder)
            .map_err(|source| PortError::Spare { folder: self.folder.clone(), source })
    }

    /// What takes the memory of the run's objects before it is written to.
    #[must_use]
    pub fn reservation(&self) -> Reservation {
        Reservation::new(&self.folder)
    }

    fn node(&self) -> &IpcNode<Ipc> {
        self.connection.node()
    }

    /// This connection as the transport names it to others.
    #[must_use]
    pub fn identity(&self) -> NodeId {
        registry::node_id(*self.node().id())
    }

    /// Creates a topic's service (launcher only).
    ///
    /// # Errors
    /// The transport refuses, most likely for lack of shared memory.
    pub fn create_topic<T: Sample>(
        &self,
        topic: &'static Topic<T>,
    ) -> Result<TopicFactory<T>, PortError> {
        let TopicInfo { name, history, .. } = topic.info;
        let depth = (recorder_capacity(&topic.info), history);
        self.create(name, &T::SCHEMA, depth, Crowd::of(&topic.info)).map(TopicFactory::new)
    }

    /// Opens a topic's service after comparing layouts.
    ///
    /// # Errors
    /// [`PortError::Layout`] if two builds disagree.
    pub fn open_topic<T: Sample>(
        &self,
        topic: &'static Topic<T>,
    ) -> Result<TopicFactory<T>, PortError> {
        self.open(topic.info.name, &T::SCHEMA).map(TopicFactory::new)
    }

    /// False once a service is gone: a process that has opened it keeps it, and none can open it any more.
    #[must_use]
    pub fn has_service(&self, service: &str) -> bool {
        let pattern = MessagingPattern::PublishSubscribe;
        let exists = |name| Ipc::does_exist(&name, self.node().config(), pattern).unwrap_or(true);
        service_name(service).is_ok_and(exists)
    }

    /// Compares the layout that a type has here with the one that a service was created with.
    fn check_layout(&self, service: &str, schema: &Schema) -> Result<(), PortError> {
        let ours = layout_text(schema);
        let theirs = self.layout_of(&service_name(service)?)?;
        if theirs == ours {
            return Ok(());
        }
        let (service, type_name) = (service.to_owned(), schema.name);
        Err(PortError::Layout { service, type_name, ours, theirs })
    }

    /// Layout that a service was created with.
    fn layout_of(&self, name: &ServiceName) -> Result<String, PortError> {
        let service = name.as_str();
        let details = Ipc::details(name, self.node().config(), MessagingPattern::PublishSubscribe)
            .map_err(PortError::transport(service, "look up the service"))?
            .ok_or_else(|| PortError::Transport {
                service: service.to_owned(),
                action: "find the service",
                reason: "this run has no such topic, or another program has removed it".to_owned(),
            })?;
        let key = layout_key(service)?;
        Ok(details
            .static_details
            .attributes()
            .key_value(&key, 0)
            .map_or_else(|| "unknown".to_owned(), ToString::to_string))
    }
}

fn layout_text(schema: &Schema) -> String {
    format!("{:016x}", schema.layout_hash)
}

fn layout_key(service: &str) -> Result<AttributeKey, PortError> {
    LAYOUT_KEY.try_into().map_err(PortError::transport(service, "name a key"))
}

/// Attribute with which a service states how its type is laid out.
fn layout_attribute(
    service: &str,
    schema: &Schema,
) -> Result<(AttributeKey, AttributeValue), PortError> {
    let text = layout_text(schema);
    let value = text.as_str().try_into().map_err(PortError::transport(service, "set a key"))?;
    Ok((layout_key(service)?, value))
}

fn service_name(name: &str) -> Result<ServiceName, PortError> {
    ServiceName::new(name).map_err(PortError::transport(name, "name the service"))
}

/// Buffer of a reader in flight.
pub(crate) const FLYING_CAPACITY: usize = READER_CAPACITY;
