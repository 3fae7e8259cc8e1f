//! Topics looked at: of a running flight, without disturbing it, and of a recording.
//!
//! The launcher drains every topic anyway. [`feed`] lets others have a copy: a socket in the run's folder
//! and a thread that owns it. No reader is added to a topic, so no writer has to know of it; a client that
//! does not read fast enough loses samples, and is sent how many. [`live`] is the other end, [`fields`] takes
//! samples apart, and [`tally`] counts them.

pub mod feed;
pub mod fields;
pub mod live;
pub mod tally;
#[cfg(test)]
mod tests;

use core::convert::Infallible;
use serde_json::{Map, Value};
use shared_types::topics::{self, TopicVisitor};
use shared_types::wire::Schema;
use shared_types::{Header, Sample, Topic, TopicInfo};

/// Name of the socket in a run's folder.
pub const SOCKET: &str = "topics.sock";

/// A topic by its name.
#[must_use]
pub fn known(name: &str) -> Option<&'static TopicInfo> {
    let name = name.strip_prefix('/').unwrap_or(name);
    topics::all().into_iter().find(|topic| topic.name == name)
}

/// Place of a topic in the table.
#[must_use]
pub fn place(topic: &TopicInfo) -> usize {
    let mut all = topics::all().into_iter();
    all.position(|known| known.name == topic.name).unwrap_or(usize::MAX)
}

/// Layout of a topic's samples.
#[must_use]
pub fn schema(topic: &TopicInfo) -> Option<Schema> {
    struct Find<'a>(&'a str, Option<Schema>);
    impl TopicVisitor for Find<'_> {
        type Error = Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
            if topic.info.name == self.0 {
                self.1 = Some(T::SCHEMA);
            }
            Ok(())
        }
    }
    let mut find = Find(topic.name, None);
    let Ok(()) = topics::visit_all(&mut find);
    find.1
}

/// A packed sample by field; `None` if it has not the size of this topic's samples.
#[must_use]
pub fn unpack(topic: &TopicInfo, packed: &[u8]) -> Option<(Header, Map<String, Value>)> {
    struct Unpack<'a>(&'a str, &'a [u8], Option<(Header, Map<String, Value>)>);
    impl TopicVisitor for Unpack<'_> {
        type Error = Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
            if topic.info.name == self.0 && self.1.len() == T::PACKED_SIZE {
                let sample = T::unpack(self.1);
                self.2 = Some((*sample.header(), fields::to_json(&sample)));
            }
            Ok(())
        }
    }
    let mut unpack = Unpack(topic.name, packed, None);
    let Ok(()) = topics::visit_all(&mut unpack);
    unpack.2
}

/// The header of a packed sample, which every one begins with.
#[must_use]
pub fn header(packed: &[u8]) -> Option<Header> {
    use shared_types::wire::Value as _;
    packed.get(..Header::PACKED_SIZE).map(Header::unpack)
}
