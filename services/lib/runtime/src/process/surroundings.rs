//! Which processes one waits for and wakes, and which seats command the slots around it.

use super::Process;
use crate::graph::{Graph, Node, Roles};
use crate::input::Source as _;
use crate::ipc::{Bus, IpcSource, LatestPort, PortError, WakeNotifier};
use shared_types::wire::hash_bytes;
use shared_types::{OwnerRecord, Progress, RegistryEntry, Role, Seat, Slot, SlotSpec};

/// How far a seat has got, and how to wake the process that sits there.
pub(super) struct Neighbour {
    seat: Seat,
    progress: Option<LatestPort<Progress>>,
    wake: Option<WakeNotifier>,
    /// Generation and period \[ns\] of the process that sits there.
    present: Option<(u32, u64)>,
}

/// A slot's owner records, for a process that waits for the slot or sits in it.
pub(super) struct SlotReader {
    role: Role,
    records: IpcSource<OwnerRecord>,
}

impl Neighbour {
    /// Every seat that a process of `role` waits for or wakes.
    pub(super) fn open_all(bus: &Bus, graph: &Graph, role: Role) -> Result<Vec<Self>, PortError> {
        let mut neighbours = Vec::new();
        for node in graph.nodes().iter().filter(|n| n.role != role) {
            let upstream = graph.reads_marks(role, node.role);
            let downstream = graph.waits_for(node.role, role);
            for seat in Seat::all(node.role).filter(|_| upstream || downstream) {
                neighbours.push(Neighbour {
                    seat,
                    progress: upstream.then(|| LatestPort::progress(bus, seat)).transpose()?,
                    wake: downstream.then(|| WakeNotifier::open(bus, seat)).transpose()?,
                    present: None,
                });
            }
        }
        Ok(neighbours)
    }
}

impl SlotReader {
    /// The slots that a process of `role` waits for, or sits in.
    pub(super) fn open_all(bus: &Bus, graph: &Graph, role: Role) -> Result<Vec<Self>, PortError> {
        let mut slots = Vec::new();
        for SlotSpec { role: slot, owner, .. } in Slot::ALL.map(Slot::spec) {
            let slot = *slot;
            let waited = graph.node(slot).is_some() && graph.waits_for(role, slot);
            if waited || slot == role {
                let records = bus.reader(owner, Role::Supervisor)?;
                slots.push(SlotReader { role: slot, records });
            }
        }
        Ok(slots)
    }
}

impl Process<'_> {
    /// Learns which processes have come and gone, and which seat owns which slot from when.
    pub(super) fn look_around(&mut self) {
        let (marks, neighbours) = (&mut self.marks, &mut self.neighbours);
        let (mut has_come, mut registered) = (false, 0_u64);
        // Without a registry no sample would be accepted, so the ports could not have been opened.
        let _ = self.bus.read_registry(|entries| {
            marks.learn_registry(entries);
            registered = fingerprint(entries);
            for neighbour in neighbours {
                let Seat { role, index } = neighbour.seat;
                let of_seat = |entry: &&RegistryEntry| (entry.role, entry.seat) == (role, index);
                let entry = entries.iter().rev().find(of_seat).filter(|e| e.present.is_set());
                let present = entry.map(|entry| (entry.generation, entry.period_ns));
                has_come |= present.is_some() && present != neighbour.present;
                neighbour.present = present;
            }
        });
        let done_ns = self.executor.previous_ns().unwrap_or(0);
        for slot in &mut self.slots {
            if let Some(book) = self.marks.book(slot.role) {
                while let Some(record) = slot.records.receive() {
                    book.learn(&record);
                }
                book.forget_before(done_ns);
                if slot.role == self.seat.role {
                    self.leave_ns = book.released_ns(self.seat.index).unwrap_or(u64::MAX);
                }
            }
        }
        // Also a process that shares the slot, and one that is no neighbour, has ports that others connect to.
        if core::mem::replace(&mut self.registered, registered) != registered {
            self.upkeep.note_change();
        }
        if has_come {
            // Its ports are open and empty.
            self.serve_again();
            self.wake_present();
        }
    }

    /// Reads the marks of these roles and adds those that have moved theirs.
    pub(super) fn read_marks(&mut self, of: Roles, moved: &mut Roles) {
        for neighbour in &mut self.neighbours {
            let Seat { role, index } = neighbour.seat;
            if let Some(progress) = &mut neighbour.progress
                && of.contains(role)
                && self.marks.concerns(role, index)
            {
                // A restarted producer starts again below what its predecessor finished, and the
                // reports of both may be waiting here in any order.
                let (marks, opened_mono_ns) = (&mut self.marks, self.opened_mono_ns);
                progress.for_each_new(|progress| {
                    if marks.update(neighbour.seat, progress, opened_mono_ns) {
                        moved.insert(role);
                    }
                });
            }
        }
    }

    /// Publishes the mark and wakes those whose next release it may unblock.
    pub(super) fn announce(&mut self, before_ns: u64, after_ns: u64) {
        self.serve_and_send(after_ns);
        self.wake_roles(|graph, from| graph.wakes(from, before_ns, after_ns).collect());
    }

    /// Wakes those whose next release the mark may unblock, and the quiet ones among them only if it is time.
    pub(super) fn wake_lockstep(&self, before_ns: u64, after_ns: u64) {
        let woken_from_ns = |node: &Node| {
            let may_be_quiet = self.graph.quiet_limit_ns(node.role) > 0;
            if may_be_quiet { self.marks.woken_from_ns(node) } else { 0 }
        };
        self.wake_roles(|graph, from| {
            graph.lockstep_wakes(from, before_ns, after_ns, woken_from_ns).collect()
        });
    }

    /// Wakes the processes of some roles. None waits for a shadow; and one that runs at another rate
    /// than the graph's is always worth waking.
    fn wake_roles(&self, roles_of: impl Fn(&Graph, Role) -> Roles) {
        let Seat { role, index } = self.seat;
        if !self.marks.concerns(role, index) {
            return;
        }
        let roles = roles_of(&self.graph, role);
        for neighbour in &self.neighbours {
            let Some((_, period_ns)) = neighbour.present else { continue };
            let role = neighbour.seat.role;
            let usual = self.graph.node(role).is_some_and(|n| n.rate.period_ns() == period_ns);
            if let Some(wake) = &neighbour.wake
                && (roles.contains(role) || !usual)
            {
                wake.wake();
            }
        }
    }

    /// Publishes the mark and wakes every neighbour: after a start or a take-over no process knows
    /// what the predecessor had already announced.
    pub(super) fn publish_progress(&mut self) {
        self.serve_and_send(self.executor.mark_ns());
        self.wake_present();
    }

    fn wake_present(&self) {
        let present = self.neighbours.iter().filter(|n| n.present.is_some());
        present.filter_map(|n| n.wake.as_ref()).for_each(WakeNotifier::wake);
    }
}

/// Distinguishes one set of registered processes from another.
fn fingerprint(entries: &[RegistryEntry]) -> u64 {
    let mut bytes = [0; 16];
    entries.iter().filter(|entry| entry.present.is_set()).fold(0, |hash, entry| {
        let numbers = [entry.role.0, entry.seat, entry.generation];
        for (slot, number) in bytes.chunks_exact_mut(4).zip(numbers) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        hash_bytes(hash, &bytes)
    })
}
