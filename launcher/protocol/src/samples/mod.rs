//! `morphquad types`: the samples as another language declares them, from the same reflection that
//! ports compare and recordings carry.

mod python;

pub use python::python;

use shared_types::wire::{Schema, Wire};
use shared_types::{
    ClockRecord, Handover, Hello, Progress, Registry, Sample, Topic, TopicInfo, TopicVisitor,
    topics,
};

/// A type that travels, as the transport and a reader know it.
#[derive(Debug, Clone, Copy)]
struct Travelling {
    schema: &'static Schema,
    /// What the transport calls it, which both ends must.
    type_name: &'static str,
}

impl Travelling {
    fn of<T: Wire>() -> Self {
        Self { schema: const { &T::SCHEMA }, type_name: core::any::type_name::<T>() }
    }
}

/// Every topic with its type, in table order.
fn travelling_topics() -> Vec<(&'static TopicInfo, Travelling)> {
    struct Collect(Vec<(&'static TopicInfo, Travelling)>);
    impl TopicVisitor for Collect {
        type Error = core::convert::Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Self::Error> {
            self.0.push((&topic.info, Travelling::of::<T>()));
            Ok(())
        }
    }
    let mut collect = Collect(Vec::new());
    let Ok(()) = topics::visit_all(&mut collect);
    collect.0
}

/// Services beside the topics, by the first part of their names. A hand-over is the packed form of
/// its type, which without padding is the form in memory, and a state after it.
fn services() -> [(&'static str, Travelling); 5] {
    [
        ("clock", Travelling::of::<ClockRecord>()),
        ("registry", Travelling::of::<Registry>()),
        ("hello", Travelling::of::<Hello>()),
        ("progress", Travelling::of::<Progress>()),
        ("handover", Travelling::of::<Handover>()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::wire::Value as _;

    #[test]
    fn a_hand_over_in_memory_is_its_packed_form() {
        assert_eq!(Handover::PACKED_SIZE, size_of::<Handover>());
    }

    #[test]
    fn every_topic_is_there_under_the_name_of_its_rust_type() {
        let travelling = travelling_topics();
        assert_eq!(travelling.len(), topics::all().len());
        for (info, of) in travelling {
            let last = of.type_name.rsplit("::").next();
            assert_eq!(last, Some(of.schema.name), "{}", info.name);
            assert!(of.type_name.starts_with("shared_types::"), "{}", of.type_name);
        }
    }
}
