//! Are the types of a file those of this build?

use super::{LayoutChange, ReadError};
use crate::record::schema::{PACKAGE, descriptor_set, full_name};
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
    /// Its descriptors.
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
