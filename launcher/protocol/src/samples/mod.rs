//! `morphquad types`: the samples as another language declares them, from the same reflection that
//! ports compare and recordings carry.

mod python;

pub use python::python;

use shared_types::wire::{Schema, Wire as _};
use shared_types::{
    ClockRecord, Header, Hello, Progress, Registry, Sample, Topic, TopicInfo, TopicVisitor, topics,
};

/// Every topic with the layout of its samples, in table order.
fn topic_schemas() -> Vec<(&'static TopicInfo, &'static Schema)> {
    struct Collect(Vec<(&'static TopicInfo, &'static Schema)>);
    impl TopicVisitor for Collect {
        type Error = core::convert::Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Self::Error> {
            self.0.push((&topic.info, const { &T::SCHEMA }));
            Ok(())
        }
    }
    let mut collect = Collect(Vec::new());
    let Ok(()) = topics::visit_all(&mut collect);
    collect.0
}

/// Services beside the topics, by the first part of their names. What follows the header of a hand-over is a
/// [`shared_types::Handover`] and a state.
fn services() -> [(&'static str, &'static Schema); 5] {
    [
        ("clock", const { &ClockRecord::SCHEMA }),
        ("registry", const { &Registry::SCHEMA }),
        ("hello", const { &Hello::SCHEMA }),
        ("progress", const { &Progress::SCHEMA }),
        ("handover", const { &Header::SCHEMA }),
    ]
}

#[cfg(test)]
mod tests {
    use shared_types::Handover;
    use shared_types::wire::Value as _;

    #[test]
    fn a_hand_over_in_memory_is_its_packed_form() {
        assert_eq!(Handover::PACKED_SIZE, size_of::<Handover>());
    }
}
