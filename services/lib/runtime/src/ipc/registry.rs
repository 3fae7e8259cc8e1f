//! Which process may publish what: the registry, the launcher, and what is received from all others.
//!
//! A sample counts only if the process that the transport names as its writer sits where the sample
//! claims, or is the launcher where the launcher alone writes. Nothing that a writer fills in is
//! believed, and a stray writer is counted and named.

use super::{Ipc, lead};
use crate::deviations::{life_number, loop_number};
use crate::input::Source;
use core::any::Any;
use core::cell::{Cell, RefCell};
use iceoryx2::identifiers::UniqueNodeId;
use shared_types::{
    Deviation, Header, LoopStats, NodeId, Progress, Registry, RegistryEntry, Role, Sample, Seat,
};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Stray writers that are counted separately, by service; further ones count together, as of process 0.
const MAX_STRAYS: usize = 64;
/// Launchers that one process may come to know without allocating.
const USUAL_LAUNCHERS: usize = 8;
/// Connections that are known not to lead; of further ones the oldest is asked for again.
const MAX_REFUSED: usize = 16;

/// Splits an identity of the transport for the wire.
pub(super) fn node_id(id: UniqueNodeId) -> NodeId {
    let value = id.value();
    #[expect(clippy::cast_possible_truncation, reason = "both halves are kept")]
    [(value >> 64) as u64, value as u64]
}

/// The process of a connection; 0 if the transport does not know it.
pub(super) fn pid_of(id: UniqueNodeId) -> u32 {
    id.pid::<Ipc>().map_or(0, |pid| pid.value().cast_unsigned())
}

/// A process that wrote without sitting where it claimed to, or what is no sample.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stray {
    /// Its process id, as reported by the transport; 0 of several that count together.
    pub pid: u32,
    /// Service it wrote on.
    pub service: Rc<str>,
    /// Samples ignored so far.
    pub samples: u64,
    node: NodeId,
}

/// What all readers of a process share, the registry's own included: which process leads, and which
/// processes wrote without a right to.
#[derive(Debug)]
pub(super) struct Authority {
    leader_file: PathBuf,
    /// Connections that led when their first sample was read: the next launcher does not revoke
    /// what an earlier one has written.
    leaders: RefCell<Vec<NodeId>>,
    /// Connections that did not lead when their first sample was read, the last of them first.
    refused: RefCell<[NodeId; MAX_REFUSED]>,
    strays: RefCell<Vec<Stray>>,
}

impl Authority {
    /// The process that leads when this one joins is accepted even if the next one leads before its samples are read.
    pub(super) fn new(folder: &Path) -> Self {
        let leader_file = lead::path_in(folder);
        let mut leaders = Vec::with_capacity(USUAL_LAUNCHERS);
        leaders.extend(lead::claimed(&leader_file));
        Self {
            leader_file,
            leaders: RefCell::new(leaders),
            refused: RefCell::new([NodeId::default(); MAX_REFUSED]),
            strays: RefCell::new(Vec::with_capacity(MAX_STRAYS + 1)),
        }
    }

    pub(super) fn strays(&self) -> Vec<Stray> {
        self.strays.borrow().clone()
    }

    /// True for the launcher's connection. A launcher claims the lead before it writes anything, so that a connection
    /// that has been turned away once need not be looked up again.
    fn is_leader(&self, node: NodeId) -> bool {
        if self.leaders.borrow().contains(&node) {
            return true;
        }
        let mut refused = self.refused.borrow_mut();
        if refused.contains(&node) {
            return false;
        }
        let leads = lead::claimed(&self.leader_file) == Some(node);
        if leads {
            self.leaders.borrow_mut().push(node);
        } else {
            refused.rotate_right(1);
            refused[0] = node;
        }
        leads
    }

    pub(super) fn count_stray(&self, node: NodeId, pid: u32, service: &Rc<str>) {
        let mut strays = self.strays.borrow_mut();
        let known = |s: &Stray| s.node == node && s.service == *service;
        if let Some(stray) = strays.iter_mut().find(|s| known(s)) {
            stray.samples = stray.samples.saturating_add(1);
        } else if strays.len() < MAX_STRAYS {
            let service = Rc::clone(service);
            strays.push(Stray { pid, service, samples: 1, node });
        } else if let Some(others) = strays.get_mut(MAX_STRAYS) {
            others.samples = others.samples.saturating_add(1);
        } else {
            let (service, node) = (Rc::clone(service), NodeId::default());
            strays.push(Stray { pid: 0, service, samples: 1, node });
        }
    }
}

/// A reader's view of the registry.
pub(super) struct RegistryReader {
    port: Box<dyn Source<Registry>>,
    registry: Registry,
}

impl core::fmt::Debug for RegistryReader {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("RegistryReader").field("entries", &self.entries()).finish_non_exhaustive()
    }
}

impl RegistryReader {
    pub(super) fn new(port: Box<dyn Source<Registry>>) -> Self {
        Self { port, registry: Registry::default() }
    }

    fn find(&mut self, node: NodeId) -> Option<RegistryEntry> {
        self.entry(node).or_else(|| {
            self.refresh();
            self.entry(node)
        })
    }

    pub(super) fn refresh(&mut self) {
        while let Some(registry) = self.port.receive() {
            self.registry = registry;
        }
    }

    pub(super) fn entries(&self) -> &[RegistryEntry] {
        let count =
            usize::try_from(self.registry.count).unwrap_or(0).min(self.registry.entries.len());
        &self.registry.entries[..count]
    }

    fn entry(&self, node: NodeId) -> Option<RegistryEntry> {
        self.entries().iter().find(|entry| entry.node == node).copied()
    }
}

/// The registry as all readers of a process share it; opened with the first of them.
pub(super) type SharedRegistry = Rc<RefCell<Option<RegistryReader>>>;

/// Lets samples pass that come from the seat that they claim.
pub(super) struct Guard<T> {
    authority: Rc<Authority>,
    /// None where only the launcher writes, such as the registry.
    registry: Option<SharedRegistry>,
    service: Rc<str>,
    accepts: Accepts<T>,
    /// The writer of the last sample: nearly always that of the next.
    last: Cell<Option<(UniqueNodeId, RegistryEntry)>>,
}

impl<T> core::fmt::Debug for Guard<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Guard").field("service", &self.service).finish_non_exhaustive()
    }
}

/// The writers from which a reader takes samples.
pub(super) enum Accepts<T> {
    /// The launcher's.
    Launcher,
    /// Those of processes in the registry.
    Registered {
        /// The role, and the seat if it matters; none: every process in the registry.
        seats: Option<(Role, Option<u32>)>,
        /// Whether a sample states the same about its writer as the registry.
        claims: fn(&T, &RegistryEntry) -> bool,
    },
}

impl<T: Sample> Accepts<T> {
    /// Samples that a role's processes write.
    pub(super) fn from_role(role: Role) -> Self {
        let claims = |sample: &T, entry: &RegistryEntry| is_of(sample.header(), entry);
        Self::Registered { seats: Some((role, None)), claims }
    }

    /// Samples that every process writes about itself: their seat is the number of a loop or of its life.
    pub(super) fn from_all() -> Self {
        let claims = |sample: &T, entry: &RegistryEntry| {
            let header = sample.header();
            let own = Seat { role: entry.role, index: entry.seat };
            let numbers = [loop_number(own), life_number(own, entry.generation)];
            header.generation == entry.generation
                && numbers.contains(&header.seat)
                && role_in(sample).is_none_or(|role| role == entry.role)
        };
        Self::Registered { seats: None, claims }
    }
}

/// The role that a sample about a loop names beside its seat.
fn role_in<T: Sample>(sample: &T) -> Option<Role> {
    let sample: &dyn Any = sample;
    let deviation = || sample.downcast_ref::<Deviation>().map(|deviation| deviation.role);
    sample.downcast_ref::<LoopStats>().map(|stats| stats.role).or_else(deviation)
}

impl Accepts<Progress> {
    /// The progress of one seat.
    pub(super) fn from_seat(seat: Seat) -> Self {
        let claims = |p: &Progress, entry: &RegistryEntry| p.generation == entry.generation;
        Self::Registered { seats: Some((seat.role, Some(seat.index))), claims }
    }
}

impl Accepts<Header> {
    /// The published states of one seat, by their headers.
    pub(super) fn states_of(seat: Seat) -> Self {
        Self::Registered { seats: Some((seat.role, Some(seat.index))), claims: is_of }
    }
}

/// True if a header names the seat and the process that the registry has.
fn is_of(header: &Header, entry: &RegistryEntry) -> bool {
    header.seat == entry.seat && header.generation == entry.generation
}

impl<T> Guard<T> {
    pub(super) fn new(
        authority: Rc<Authority>,
        registry: Option<SharedRegistry>,
        service: &str,
        accepts: Accepts<T>,
    ) -> Self {
        Self { authority, registry, service: Rc::from(service), accepts, last: Cell::new(None) }
    }

    /// The sample, if its writer sits where it claims. What has not the size of a sample is none of any process.
    pub(super) fn accepted<'a>(&self, id: UniqueNodeId, sample: Option<&'a T>) -> Option<&'a T> {
        let accepted = sample.filter(|sample| self.passes(id, sample));
        if accepted.is_none() {
            self.authority.count_stray(node_id(id), pid_of(id), &self.service);
        }
        accepted
    }

    fn passes(&self, id: UniqueNodeId, sample: &T) -> bool {
        self.entry(id).is_some_and(|entry| match &self.accepts {
            Accepts::Launcher => true,
            Accepts::Registered { seats, claims } => {
                let sits = |(role, seat): (Role, Option<u32>)| {
                    role == entry.role && seat.is_none_or(|seat| seat == entry.seat)
                };
                seats.is_none_or(sits) && claims(sample, &entry)
            }
        })
    }

    /// What is known of a writer that may write; the launcher is on no line of the registry.
    fn entry(&self, id: UniqueNodeId) -> Option<RegistryEntry> {
        let last = self.last.get().filter(|(node, _)| *node == id).map(|(_, entry)| entry);
        last.or_else(|| {
            let node = node_id(id);
            let entry = match &self.registry {
                Some(registry) => registry.borrow_mut().as_mut()?.find(node)?,
                None => self.authority.is_leader(node).then(RegistryEntry::default)?,
            };
            self.last.set(Some((id, entry)));
            Some(entry)
        })
    }
}
