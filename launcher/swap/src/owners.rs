//! Which process sits where, and which commands which slot, as the supervisor publishes it to all of them.

use runtime::ipc::{Bus, IpcSink, PortError, ServiceKind};
use runtime::{SeatMarks, Sink as _};
use shared_types::{
    Flag, Header, NO_SEAT, NodeId, OwnerRecord, REGISTRY_LINES, Registry, RegistryEntry, Role,
    SEATS, Seat, Slot, SlotSpec,
};

/// Keeps the registry.
#[derive(Debug)]
pub struct RegistryWriter {
    sink: IpcSink<Registry>,
    registry: Registry,
}

impl RegistryWriter {
    /// Opens the registry.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn open(bus: &Bus) -> Result<Self, PortError> {
        Ok(Self { sink: bus.open_writer(ServiceKind::Registry)?, registry: Registry::default() })
    }

    /// Goes on with the registry of a launcher that has died.
    pub fn go_on(&mut self, entries: &[RegistryEntry]) {
        for (line, entry) in self.registry.entries.iter_mut().zip(entries) {
            *line = *entry;
        }
        self.registry.count = entries.len().min(REGISTRY_LINES) as u64;
    }

    fn count(&self) -> usize {
        usize::try_from(self.registry.count).unwrap_or(0).min(REGISTRY_LINES)
    }

    fn entries_mut(&mut self) -> &mut [RegistryEntry] {
        let count = self.count();
        &mut self.registry.entries[..count]
    }

    /// All processes that are in it.
    #[must_use]
    pub fn entries(&self) -> &[RegistryEntry] {
        &self.registry.entries[..self.count()]
    }

    /// Enters a process; the one that had the seat before has left it.
    pub fn enter(&mut self, node: NodeId, seat: Seat, generation: u32, period_ns: u64) {
        self.leave(seat);
        if self.count() == REGISTRY_LINES {
            // More seats than lines there are not, so a process has left.
            let gone = self.entries().iter().position(|e| !e.present.is_set()).unwrap_or(0);
            self.registry.entries.copy_within(gone + 1.., gone);
            self.registry.count -= 1;
        }
        let count = self.count();
        self.registry.entries[count] = RegistryEntry {
            node,
            period_ns,
            role: seat.role,
            seat: seat.index,
            generation,
            present: Flag::Yes,
        };
        self.registry.count += 1;
    }

    /// No process has the seat any more, and none waits for it.
    pub fn leave(&mut self, seat: Seat) {
        let of_seat = |e: &&mut RegistryEntry| (e.role, e.seat) == (seat.role, seat.index);
        self.entries_mut().iter_mut().filter(of_seat).for_each(|e| e.present = Flag::No);
    }

    /// Publishes it to all processes.
    pub fn publish(&mut self) {
        self.sink.send(&self.registry);
    }

    /// Sends the last registry to readers that have joined since.
    pub fn serve_late_joiners(&mut self) {
        self.sink.serve_late_joiners();
    }
}

/// One slot's owner records.
#[derive(Debug)]
pub struct SlotOwner {
    /// Role of the slot.
    pub role: Role,
    sink: IpcSink<OwnerRecord>,
    before: OwnerRecord,
    last: OwnerRecord,
}

impl SlotOwner {
    /// The slots of a flight.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn open_all(bus: &Bus) -> Result<Vec<Self>, PortError> {
        let open = |slot: Slot| {
            let SlotSpec { role, owner, .. } = *slot.spec();
            let last = OwnerRecord { slot: role, fallback: NO_SEAT, ..OwnerRecord::default() };
            Ok(Self { role, sink: bus.writer(owner)?, before: last, last })
        };
        Slot::ALL.into_iter().map(open).collect()
    }

    /// The record before the last one, which may still be in effect; of epoch 0 if there is none.
    #[must_use]
    pub fn before(&self) -> &OwnerRecord {
        &self.before
    }

    /// The last record; of epoch 0 before the first.
    #[must_use]
    pub fn last(&self) -> &OwnerRecord {
        &self.last
    }

    /// Epoch of the last record; 0 before the first.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.last.epoch
    }

    /// The first seat owns the slot from the start.
    pub fn begin(&mut self, period_ns: u64, marks: &mut SeatMarks) {
        let header = Header { sequence: 1, ..Header::default() };
        let mut record = OwnerRecord { header, epoch: 1, ..self.last };
        record.period_ns = [0; SEATS];
        record.period_ns[0] = period_ns.max(1);
        self.take(record, marks);
    }

    /// Takes a record that is to be announced.
    pub fn take(&mut self, record: OwnerRecord, marks: &mut SeatMarks) {
        // A record that is published again comes after itself.
        if record.epoch > self.last.epoch {
            self.before = self.last;
        }
        self.last = record;
        if let Some(book) = marks.book(self.role) {
            book.learn(&self.last);
        }
    }

    /// Announces the last record.
    pub fn publish(&mut self) {
        self.sink.send(&self.last);
    }

    /// Sends the last record to readers that have joined since.
    pub fn serve_late_joiners(&mut self) {
        self.sink.serve_late_joiners();
    }
}
