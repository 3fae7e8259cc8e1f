//! The head of a recording: facts, scenario and a channel for every topic of the floor plan.

use super::sink::Sink;
use super::{Facts, SequenceAudit, Stream, messages, schema};
use crate::scene;
use mcap::records::Metadata;
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, McapResult, WriteOptions, Writer};
use prost_types::FileDescriptorSet;
use shared_types::topics::{Topic, TopicVisitor, visit_all};
use shared_types::{Role, Sample};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::BufWriter;

pub(super) type FileWriter = Writer<NoSeek<BufWriter<Sink>>>;

/// A channel that carries headers, hence sequence numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Channel {
    pub(super) id: u16,
    pub(super) stream: Stream,
}

pub(super) struct Opened {
    pub(super) writer: FileWriter,
    /// By topic name.
    pub(super) channels: BTreeMap<&'static str, Channel>,
    /// By the label of the role.
    pub(super) state_ids: BTreeMap<&'static str, u16>,
    pub(super) events_id: u16,
    /// Of what is derived for viewers, by the index of the scene's channel.
    pub(super) scene_ids: [u16; scene::CHANNELS.len()],
    pub(super) audit: SequenceAudit,
}

/// How every file is written.
pub(super) fn options() -> WriteOptions {
    WriteOptions::new()
        // The fastest of its levels that are not negative: a quarter shorter than LZ4, and the writer still keeps up with
        // a flight in one process.
        .compression(Some(Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .chunk_size(Some(1 << 19))
        .calculate_chunk_crcs(true)
        .library(concat!("morphquad ", env!("CARGO_PKG_VERSION")))
}

/// Starts the file and hands metadata and attachments to the system; channels go with the first samples.
pub(super) fn open(sink: BufWriter<Sink>, facts: &Facts) -> McapResult<Opened> {
    let mut writer = options().disable_seeking(true).create(NoSeek::new(sink))?;
    // First in the file, so that a crash keeps them.
    writer.write_metadata(&Metadata { name: "run".to_owned(), metadata: facts.to_metadata() })?;
    if let Some(branch) = &facts.branch {
        let metadata = branch.to_metadata();
        writer.write_metadata(&Metadata { name: "branch".to_owned(), metadata })?;
    }
    let attachments = [
        ("scenario.toml", "application/toml", facts.scenario_toml.as_str()),
        ("foxglove-layout.json", "application/json", scene::LAYOUT),
    ];
    for (name, media_type, text) in attachments {
        writer.attach(&Attachment {
            log_time: facts.epoch_unix_ns,
            create_time: facts.epoch_unix_ns,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(text.as_bytes()),
        })?;
    }
    // Before the first chunk has begun: a chunk without messages is stamped 0, and Lichtblick would have
    // the flight begin in 1970.
    writer.flush()?;

    let mut registry =
        Registry { writer, audit: SequenceAudit::default(), channels: BTreeMap::new() };
    visit_all(&mut registry)?;
    let state = messages::state_descriptor();
    let mut state_ids = BTreeMap::new();
    for role in Role::STEPPING {
        let name = format!("/state/{}", role.label());
        let about = BTreeMap::from([("from".to_owned(), role.label().to_owned())]);
        let id = registry.add_unaudited(&name, (messages::STATE_NAME, &state), &about)?;
        state_ids.insert(role.label(), id);
    }
    let mut scene_ids = [0; scene::CHANNELS.len()];
    for (id, channel) in scene_ids.iter_mut().zip(&scene::CHANNELS) {
        *id = registry.add_derived(channel)?;
    }
    let log = (messages::LOG_NAME, &messages::log_descriptor());
    let events_id = registry.add_unaudited("/events", log, &BTreeMap::new())?;
    let Registry { writer, audit, channels } = registry;
    Ok(Opened { writer, channels, state_ids, events_id, scene_ids, audit })
}

/// Adds a channel for every topic.
struct Registry {
    writer: FileWriter,
    audit: SequenceAudit,
    channels: BTreeMap<&'static str, Channel>,
}

impl Registry {
    fn add_unaudited(
        &mut self,
        name: &str,
        (schema_name, set): (&str, &FileDescriptorSet),
        about: &BTreeMap<String, String>,
    ) -> McapResult<u16> {
        let data = prost::Message::encode_to_vec(set);
        let schema_id = self.writer.add_schema(schema_name, "protobuf", &data)?;
        self.writer.add_channel(schema_id, name, "protobuf", about)
    }

    /// A channel that names the topic whose samples its messages repeat in another form, and how often.
    fn add_derived(&mut self, channel: &scene::Channel) -> McapResult<u16> {
        let schema_id = match (channel.schema)() {
            Some(schema) => self.writer.add_schema(&schema.name, &schema.encoding, &schema.data)?,
            None => 0,
        };
        let about = BTreeMap::from([
            ("summary".to_owned(), channel.summary.to_owned()),
            ("derived_from".to_owned(), format!("/{}", channel.from)),
            ("period_ns".to_owned(), channel.period_ns.to_string()),
        ]);
        self.writer.add_channel(schema_id, channel.name, "protobuf", &about)
    }

    fn add(
        &mut self,
        name: String,
        schema: (&str, &FileDescriptorSet),
        about: &BTreeMap<String, String>,
    ) -> McapResult<Channel> {
        let id = self.add_unaudited(&name, schema, about)?;
        Ok(Channel { id, stream: self.audit.register(name) })
    }
}

impl TopicVisitor for Registry {
    type Error = mcap::McapError;

    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> McapResult<()> {
        let info = &topic.info;
        let layout = topic.schema();
        let about = BTreeMap::from([
            ("summary".to_owned(), info.summary.to_owned()),
            ("from".to_owned(), info.from.label().to_owned()),
            ("layout_hash".to_owned(), format!("{:016x}", layout.layout_hash)),
        ]);
        let (name, set) = (schema::full_name(&layout), schema::descriptor_set(&layout));
        let channel = self.add(format!("/{}", info.name), (&name, &set), &about)?;
        self.channels.insert(info.name, channel);
        Ok(())
    }
}
