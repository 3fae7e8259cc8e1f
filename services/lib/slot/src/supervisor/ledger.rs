//! The records that have been written, and whether the consumer has confirmed the last of them.

use super::instances::Instance;
use crate::record::{Record, Seat};

/// Records remembered, to find the owner that an epoch in the consumer's report refers to.
const REMEMBERED: usize = 6;

/// A record that waits for its confirmation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Outstanding {
    /// Without it until then the record is written again \[ns\].
    pub(super) until_ns: u64,
    /// How often the same has been written.
    pub(super) tries: u32,
}

/// Everything written so far that still matters.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub(super) struct Ledger {
    newest: Option<Record>,
    /// (epoch, owner's seat), newest first.
    owners: [Option<(u64, Seat)>; REMEMBERED],
    pub(super) outstanding: Option<Outstanding>,
    /// The seat that the consumer follows, as far as it has reported.
    pub(super) in_force: Option<(Seat, Instance)>,
}

impl Ledger {
    pub(super) fn newest(&self) -> Option<&Record> {
        self.newest.as_ref()
    }

    pub(super) fn epoch(&self) -> u64 {
        self.newest.map_or(0, |record| record.epoch)
    }

    pub(super) fn effective_ns(&self) -> u64 {
        self.newest.map_or(0, |record| record.effective_ns)
    }

    pub(super) fn owner(&self) -> Option<Seat> {
        self.newest.map(|record| record.owner)
    }

    /// Goes on from a record that another has written and the consumer follows.
    pub(super) fn take_up(&mut self, record: Record) {
        self.owners[0] = Some((record.epoch, record.owner));
        self.newest = Some(record);
    }

    pub(super) fn write(&mut self, record: Record, outstanding: Outstanding) {
        self.owners.rotate_right(1);
        self.take_up(record);
        self.outstanding = Some(outstanding);
    }

    /// The seat that owned the slot in an epoch.
    pub(super) fn owner_of(&self, epoch: u64) -> Option<Seat> {
        self.owners.iter().flatten().find(|(of, _)| *of == epoch).map(|(_, seat)| *seat)
    }
}
