//! Who sits where, and who commands which slot, as the supervisor tells everybody.

use runtime::ipc::{Bus, IpcSink, PortError, ServiceKind};
use runtime::{SeatMarks, Sink as _};
use shared_types::{
    Flag, Header, NO_SEAT, NodeId, OwnerRecord, ROLL_LINES, Role, Roll, RollEntry, SEATS, Seat,
    topics,
};

/// Keeps the roll.
#[derive(Debug)]
pub struct RollKeeper {
    sink: IpcSink<Roll>,
    roll: Roll,
}

impl RollKeeper {
    /// Opens the roll.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn open(bus: &Bus) -> Result<Self, PortError> {
        Ok(Self { sink: bus.open_writer(ServiceKind::Roll)?, roll: Roll::default() })
    }

    /// Goes on with the roll of a launcher that has died.
    pub fn go_on(&mut self, entries: &[RollEntry]) {
        for (line, entry) in self.roll.entries.iter_mut().zip(entries) {
            *line = *entry;
        }
        self.roll.count = entries.len().min(ROLL_LINES) as u64;
    }

    fn count(&self) -> usize {
        usize::try_from(self.roll.count).unwrap_or(0).min(ROLL_LINES)
    }

    fn entries_mut(&mut self) -> &mut [RollEntry] {
        let count = self.count();
        &mut self.roll.entries[..count]
    }

    /// Everybody who is on it.
    #[must_use]
    pub fn entries(&self) -> &[RollEntry] {
        &self.roll.entries[..self.count()]
    }

    /// Enters a process; whoever had the seat before has left it.
    pub fn enter(&mut self, node: NodeId, seat: Seat, generation: u32, period_ns: u64) {
        self.leave(seat);
        if self.count() == ROLL_LINES {
            // More seats than lines there are not, so somebody has left.
            let gone = self.entries().iter().position(|e| !e.present.is_set()).unwrap_or(0);
            self.roll.entries.copy_within(gone + 1.., gone);
            self.roll.count -= 1;
        }
        let count = self.count();
        self.roll.entries[count] = RollEntry {
            node,
            period_ns,
            role: seat.role,
            seat: seat.index,
            generation,
            present: Flag::Yes,
        };
        self.roll.count += 1;
    }

    /// Nobody has the seat any more, and nobody waits for it.
    pub fn leave(&mut self, seat: Seat) {
        let of_seat = |e: &&mut RollEntry| (e.role, e.seat) == (seat.role, seat.index);
        self.entries_mut().iter_mut().filter(of_seat).for_each(|e| e.present = Flag::No);
    }

    /// Tells everybody.
    pub fn publish(&mut self) {
        self.sink.send(&self.roll);
    }

    /// Sends the last word to readers that have joined since.
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
    last: OwnerRecord,
}

impl SlotOwner {
    /// The slots of a flight.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn open_all(bus: &Bus) -> Result<Vec<Self>, PortError> {
        let slots =
            [(Role::Attitude, &topics::ATTITUDE_OWNER), (Role::Position, &topics::POSITION_OWNER)];
        let open = |(role, topic)| {
            let last = OwnerRecord { slot: role, fallback: NO_SEAT, ..OwnerRecord::default() };
            Ok(Self { role, sink: bus.writer(topic)?, last })
        };
        slots.into_iter().map(open).collect()
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
