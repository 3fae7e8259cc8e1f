//! One number for the layout of everything that travels: builds with the same can fly together.

use core::convert::Infallible;
use shared_types::wire::{HASH_SEED, Wire as _, hash_bytes};
use shared_types::{
    ClockRecord, Handover, Hello, Progress, Registry, Sample, Topic, TopicVisitor, topics,
};

/// Argument at which an executable of a run prints its [`layout_hash`] and ends.
pub const LAYOUT_ARGUMENT: &str = "--layout";

/// Hash of the layouts of all topics and services.
#[must_use]
pub fn layout_hash() -> u64 {
    struct Fold(u64);
    impl TopicVisitor for Fold {
        type Error = Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
            self.0 = hash_bytes(self.0, topic.info.name.as_bytes());
            self.0 = hash_bytes(self.0, &T::SCHEMA.layout_hash.to_le_bytes());
            Ok(())
        }
    }
    let mut fold = Fold(HASH_SEED);
    let Ok(()) = topics::visit_all(&mut fold);
    let services = [
        ClockRecord::SCHEMA.layout_hash,
        Registry::SCHEMA.layout_hash,
        Hello::SCHEMA.layout_hash,
        Progress::SCHEMA.layout_hash,
        Handover::SCHEMA.layout_hash,
    ];
    services.iter().fold(fold.0, |hash, layout| hash_bytes(hash, &layout.to_le_bytes()))
}
