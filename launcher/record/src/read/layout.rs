//! Are the types of a file those of this build?

use super::{LayoutChange, ReadError};
use crate::schema::{PACKAGE, descriptor_set, full_name};
use core::convert::Infallible;
use prost::Message as _;
use prost_types::{DescriptorProto, FileDescriptorSet};
use shared_types::topics::visit_all;
use shared_types::wire::Schema;
use shared_types::{Sample, Topic, TopicVisitor};
use std::collections::BTreeMap;
use std::path::Path;

/// A channel as the file declares it.
#[derive(Debug, Clone, Default)]
pub(super) struct Channel {
    pub(super) id: u16,
    /// Full name of the message type.
    pub(super) type_name: String,
    pub(super) descriptors: Vec<u8>,
    pub(super) metadata: BTreeMap<String, String>,
}

/// A file and the build that recorded it, for complaints.
#[derive(Debug, Clone, Copy)]
pub(super) struct Origin<'a> {
    pub(super) path: &'a Path,
    pub(super) recorder: &'a str,
}

/// Compares the channels of a file with the floor plan; `channels` is by name, slash included.
pub(super) fn check(
    origin: Origin<'_>,
    channels: &BTreeMap<String, Channel>,
) -> Result<(), ReadError> {
    let mut schemas = Schemas(BTreeMap::new());
    let Ok(()) = visit_all(&mut schemas);
    let path = origin.path.to_owned();
    let recorder = origin.recorder.to_owned();
    for (topic, schema) in &schemas.0 {
        let Some(channel) = channels.get(topic) else {
            let (type_name, what) = (schema.name.to_owned(), "is not in the file");
            return Err(ReadError::Topic { path, topic: topic.clone(), type_name, what, recorder });
        };
        let theirs = channel.metadata.get("layout_hash").map_or("unknown", String::as_str);
        let ours = format!("{:016x}", schema.layout_hash);
        if theirs != ours || channel.type_name != full_name(schema) {
            let (type_name, detail) = difference(schema, channel);
            let (topic, theirs) = (topic.clone(), theirs.to_owned());
            let change = LayoutChange { path, topic, type_name, theirs, ours, recorder, detail };
            return Err(ReadError::Layout(Box::new(change)));
        }
    }
    let foreign = channels.iter().find(|(topic, channel)| {
        let ours = channel.metadata.contains_key("layout_hash");
        ours && !schemas.0.contains_key(*topic)
    });
    foreign.map_or(Ok(()), |(topic, channel)| {
        let type_name = channel.type_name.trim_start_matches(PACKAGE).trim_start_matches('.');
        let (topic, type_name) = (topic.clone(), type_name.to_owned());
        let what = "is unknown to this build";
        Err(ReadError::Topic { path, topic, type_name, what, recorder })
    })
}

struct Schemas(BTreeMap<String, Schema>);

impl TopicVisitor for Schemas {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        self.0.insert(format!("/{}", topic.info.name), topic.schema());
        Ok(())
    }
}

/// The innermost type whose fields differ, and how; the sample itself if they all look alike.
fn difference(schema: &Schema, channel: &Channel) -> (String, String) {
    let ours = descriptor_set(schema);
    let theirs = FileDescriptorSet::decode(channel.descriptors.as_slice()).unwrap_or_default();
    let messages = |set: &FileDescriptorSet| -> Vec<DescriptorProto> {
        set.file.iter().flat_map(|file| file.message_type.clone()).collect()
    };
    let theirs = messages(&theirs);
    // Types come before their use, so the first that differs is the innermost.
    for message in messages(&ours) {
        let Some(other) = theirs.iter().find(|m| m.name() == message.name()) else {
            return (message.name().to_owned(), " (the file does not have it)".to_owned());
        };
        let fields = |m: &DescriptorProto| -> Vec<String> {
            m.field.iter().map(|f| format!("{} {:?}", f.name(), f.r#type())).collect()
        };
        let (here, there) = (fields(&message), fields(other));
        let changed = here.iter().find(|f| !there.contains(f)).map(|f| format!("{f} is new"));
        let gone = there.iter().find(|f| !here.contains(f)).map(|f| format!("{f} is gone"));
        let moved = (here != there).then(|| "fields have moved".to_owned());
        if let Some(detail) = changed.or(gone).or(moved) {
            return (message.name().to_owned(), format!(" ({detail})"));
        }
    }
    (schema.name.to_owned(), String::new())
}

#[cfg(test)]
mod tests {
    use super::{Channel, Origin, Schemas, check};
    use crate::schema::{descriptor_set, full_name};
    use prost::Message as _;
    use prost_types::FileDescriptorSet;
    use shared_types::topics::{WRENCH_COMMAND, visit_all};
    use std::collections::BTreeMap;
    use std::path::Path;

    type Channels = BTreeMap<String, Channel>;

    /// The channels of this build, changed, and what is reported about them.
    fn report_of(change: impl Fn(&mut Channels)) -> String {
        let mut schemas = Schemas(BTreeMap::new());
        let Ok(()) = visit_all(&mut schemas);
        let ours = schemas.0.into_iter().map(|(topic, schema)| {
            let hash = format!("{:016x}", schema.layout_hash);
            let metadata = BTreeMap::from([("layout_hash".to_owned(), hash)]);
            let descriptors = descriptor_set(&schema).encode_to_vec();
            (topic, Channel { id: 1, type_name: full_name(&schema), descriptors, metadata })
        });
        let mut channels = ours.collect();
        change(&mut channels);
        let origin = Origin { path: Path::new("old.mcap"), recorder: "morphquad 0.0.1 (abc)" };
        check(origin, &channels).map_or_else(|error| error.to_string(), |()| "agrees".to_owned())
    }

    fn with_another_hash(channels: &mut Channels) -> &mut Channel {
        let channel = channels.get_mut("/wrench_command").unwrap();
        channel.metadata.insert("layout_hash".to_owned(), "00000000deadbeef".to_owned());
        channel
    }

    #[test]
    fn the_own_types_agree_and_a_changed_one_is_named_with_both_hashes() {
        assert_eq!(report_of(|_| {}), "agrees");
        let report = report_of(|channels| {
            with_another_hash(channels);
        });
        let ours = format!("{:016x}", WRENCH_COMMAND.schema().layout_hash);
        let parts = ["old.mcap", "type WrenchCommand", "morphquad 0.0.1", "deadbeef", &ours];
        assert!(parts.iter().all(|part| report.contains(part)), "{report}");
    }

    #[test]
    fn if_a_nested_type_has_changed_it_is_the_one_named() {
        let report = report_of(|channels| {
            let channel = with_another_hash(channels);
            let mut set = FileDescriptorSet::decode(channel.descriptors.as_slice()).unwrap();
            let header = set.file[0].message_type.iter_mut().find(|m| m.name() == "Header");
            header.unwrap().field.retain(|field| field.name() != "cause_sequence");
            channel.descriptors = set.encode_to_vec();
        });
        assert!(report.contains("type Header of topic /wrench_command changed"), "{report}");
        assert!(report.contains("cause_sequence Uint64 is new"), "{report}");
    }

    #[test]
    fn a_topic_that_only_one_side_has_is_named_with_its_type() {
        let report = report_of(|channels| drop(channels.remove("/loop_stats")));
        assert!(report.contains("/loop_stats of type LoopStats is not in the file"), "{report}");
        let report = report_of(|channels| {
            let (type_name, metadata) =
                ("morphquad.v1.Fuel".to_owned(), channels["/imu"].metadata.clone());
            let channel = Channel { type_name, metadata, ..Channel::default() };
            channels.insert("/fuel".to_owned(), channel);
        });
        assert!(report.contains("/fuel of type Fuel is unknown to this build"), "{report}");
    }
}
