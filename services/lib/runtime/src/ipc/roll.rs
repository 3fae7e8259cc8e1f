//! Who may publish what: the roll, and what is received from whoever is not on it.
//!
//! A sample counts only if the process that the transport names as its writer sits where the sample
//! says it does. Nothing that a writer fills in is believed, and a stray writer is counted and named.

use super::Ipc;
use crate::input::Source;
use core::cell::{Cell, RefCell};
use iceoryx2::identifiers::UniqueNodeId;
use shared_types::{NodeId, Progress, Role, Roll, RollEntry, Sample, Seat};
use std::rc::Rc;

/// Stray writers that are told apart; further ones count with the last.
const MOST_STRAYS: usize = 16;

/// Splits an identity of the transport for the wire.
pub(super) fn node_id(id: UniqueNodeId) -> NodeId {
    let value = id.value();
    #[expect(clippy::cast_possible_truncation, reason = "both halves are kept")]
    [(value >> 64) as u64, value as u64]
}

/// A process that wrote without sitting where it claimed to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stray {
    /// Its process id, as told by the transport.
    pub pid: u32,
    /// Service it wrote on.
    pub service: Rc<str>,
    /// Samples ignored so far.
    pub samples: u64,
    node: NodeId,
}

/// A reader's view of the roll.
pub(super) struct RollBook {
    port: Box<dyn Source<Roll>>,
    roll: Roll,
    strays: Vec<Stray>,
}

impl core::fmt::Debug for RollBook {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("RollBook").field("entries", &self.entries()).finish_non_exhaustive()
    }
}

impl RollBook {
    pub(super) fn new(port: Box<dyn Source<Roll>>) -> Self {
        Self { port, roll: Roll::default(), strays: Vec::new() }
    }

    pub(super) fn strays(&self) -> &[Stray] {
        &self.strays
    }

    fn find(&mut self, node: NodeId) -> Option<RollEntry> {
        self.entry(node).or_else(|| {
            self.refresh();
            self.entry(node)
        })
    }

    pub(super) fn refresh(&mut self) {
        while let Some(roll) = self.port.receive() {
            self.roll = roll;
        }
    }

    pub(super) fn entries(&self) -> &[RollEntry] {
        let count = usize::try_from(self.roll.count).unwrap_or(0).min(self.roll.entries.len());
        &self.roll.entries[..count]
    }

    fn entry(&self, node: NodeId) -> Option<RollEntry> {
        self.entries().iter().find(|entry| entry.node == node).copied()
    }

    fn count_stray(&mut self, id: UniqueNodeId, service: &Rc<str>) {
        let node = node_id(id);
        let known = |s: &Stray| s.node == node && s.service == *service;
        if let Some(stray) = self.strays.iter_mut().find(|s| known(s)) {
            stray.samples += 1;
        } else if self.strays.len() < MOST_STRAYS {
            let pid = id.pid::<Ipc>().map_or(0, |pid| pid.value().cast_unsigned());
            self.strays.push(Stray { pid, service: Rc::clone(service), samples: 1, node });
        } else if let Some(last) = self.strays.last_mut() {
            last.samples += 1;
        }
    }
}

/// The roll as all readers of a process share it; opened with the first of them.
pub(super) type SharedRoll = Rc<RefCell<Option<RollBook>>>;

/// Lets pass what comes from where it says it does.
pub(super) struct Guard<T> {
    roll: SharedRoll,
    service: Rc<str>,
    accepts: Accepts<T>,
    /// The writer of the last sample: nearly always that of the next.
    last: Cell<Option<(UniqueNodeId, RollEntry)>>,
}

/// Whose samples a reader takes, and how to see whose they claim to be.
pub(super) struct Accepts<T> {
    /// None: everybody on the roll.
    seats: Option<(Role, Option<u32>)>,
    claims: fn(&T, &RollEntry) -> bool,
}

impl<T: Sample> Accepts<T> {
    /// Samples that a role's processes write.
    pub(super) fn from_role(role: Role) -> Self {
        let claims = |sample: &T, entry: &RollEntry| {
            let header = sample.header();
            header.seat == entry.seat && header.generation == entry.generation
        };
        Self { seats: Some((role, None)), claims }
    }

    /// Samples that everybody writes about itself.
    pub(super) fn from_all() -> Self {
        let claims = |sample: &T, entry: &RollEntry| {
            let header = sample.header();
            header.generation == entry.generation
        };
        Self { seats: None, claims }
    }
}

impl Accepts<Progress> {
    /// The progress of one seat.
    pub(super) fn from_seat(seat: Seat) -> Self {
        let claims = |p: &Progress, entry: &RollEntry| p.generation == entry.generation;
        Self { seats: Some((seat.role, Some(seat.index))), claims }
    }
}

impl<T> Guard<T> {
    pub(super) fn new(roll: SharedRoll, service: &str, accepts: Accepts<T>) -> Self {
        Self { roll, service: Rc::from(service), accepts, last: Cell::new(None) }
    }

    /// True if the writer sits where the sample says it does.
    pub(super) fn passes(&self, id: UniqueNodeId, sample: &T) -> bool {
        let last = self.last.get().filter(|(node, _)| *node == id).map(|(_, entry)| entry);
        let entry = last.or_else(|| {
            let entry = self.roll.borrow_mut().as_mut()?.find(node_id(id))?;
            self.last.set(Some((id, entry)));
            Some(entry)
        });
        let passes = entry.is_some_and(|entry| {
            let seated = self.accepts.seats.is_none_or(|(role, seat)| {
                role == entry.role && seat.is_none_or(|seat| seat == entry.seat)
            });
            seated && (self.accepts.claims)(sample, &entry)
        });
        if !passes && let Some(roll) = self.roll.borrow_mut().as_mut() {
            roll.count_stray(id, &self.service);
        }
        passes
    }
}
