//! A recording, read by field name with a reader that shares no code with the writer.

use mcap::read::{ChunkReader, LinearReader};
use mcap::records::Record;
use mcap::{MAGIC, MessageStream};
use prost_reflect::bytes::Bytes;
use prost_reflect::prost::Message as _;
use prost_reflect::{
    DescriptorPool, DynamicMessage, MessageDescriptor, ReflectMessage as _, Value,
};
use std::collections::BTreeMap;
use std::path::Path;

/// One sample: its instant and the numbers of the fields asked for, in order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    pub(crate) t_s: f64,
    pub(crate) values: Vec<f64>,
}

/// A whole MCAP file.
pub(crate) struct Recording(Vec<u8>);

impl Recording {
    pub(crate) fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path);
        Self(bytes.unwrap_or_else(|error| panic!("{}: {error}", path.display())))
    }

    /// Checks that the file is complete, its checksums included, and counts its messages.
    pub(crate) fn count_messages_of_a_complete_file(&self) -> u64 {
        let summary = mcap::Summary::read(&self.0).expect("a readable end").expect("a summary");
        let counted = summary.stats.expect("statistics").message_count;
        let messages = MessageStream::new(&self.0).expect("a readable start");
        let read =
            messages.inspect(|message| assert!(message.is_ok(), "{message:?}")).count() as u64;
        assert_eq!(read, counted);
        counted
    }

    /// Counts the messages before the place where a killed writer left off.
    pub(crate) fn count_messages_of_a_cut_file(&self) -> usize {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let messages = MessageStream::new_with_options(&self.0, options);
        messages.expect("a readable start").map_while(Result::ok).count()
    }

    /// Counts the messages of the chunks that a killed writer has finished: what is in the torn one no checksum vouches
    /// for.
    pub(crate) fn count_messages_of_whole_chunks(&self) -> u64 {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let records = LinearReader::new_with_options(&self.0, options);
        let is_message = |record: &Record<'_>| matches!(record, Record::Message { .. });
        let count = |record: Record<'_>| match record {
            Record::Chunk { header, data } => {
                let inside = ChunkReader::new(header, &data).expect("a chunk");
                inside.filter(|record| record.as_ref().is_ok_and(is_message)).count()
            }
            record => usize::from(is_message(&record)),
        };
        records.expect("a readable start").map_while(Result::ok).map(count).sum::<usize>() as u64
    }

    /// Instant of the last sample of a topic before the place where a killed writer left off \[s\].
    pub(crate) fn end_of_a_cut_file(&self, topic: &str) -> f64 {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let messages = MessageStream::new_with_options(&self.0, options);
        let messages = messages.expect("a readable start").map_while(Result::ok);
        let of_topic = messages.filter(|m| m.channel.topic.strip_prefix('/') == Some(topic));
        let last = of_topic.last().unwrap_or_else(|| panic!("nothing on {topic}"));
        let sample = DynamicMessage::decode(descriptor(&last.channel), &*last.data);
        row(&sample.expect("a message of its schema"), &[]).t_s
    }

    /// Whether any sample of a topic can be read of a file that is being written, at whatever place it has arrived.
    pub(crate) fn has_begun(&self, topic: &str) -> bool {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let Ok(messages) = MessageStream::new_with_options(&self.0, options) else { return false };
        let mut topics = messages.map_while(Result::ok).map(|message| message.channel);
        topics.any(|channel| channel.topic.strip_prefix('/') == Some(topic))
    }

    /// Whether any message of a file that is being written has a text.
    pub(crate) fn mentions(&self, text: &str) -> bool {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let Ok(messages) = MessageStream::new_with_options(&self.0, options) else { return false };
        let has = |bytes: &[u8]| bytes.windows(text.len()).any(|part| part == text.as_bytes());
        messages.map_while(Result::ok).any(|message| has(&message.data))
    }

    /// Every message of the flight without what depends on the host: stamps (also inside states, of
    /// which the length remains), rescued waits. By channel, seat and sequence; what is derived for
    /// viewers carries the start of the run and is left out.
    pub(crate) fn contents(&self) -> BTreeMap<(String, u64, u64), Vec<u8>> {
        let mut contents = BTreeMap::new();
        let mut types: BTreeMap<u16, MessageDescriptor> = BTreeMap::new();
        let mut events = 0;
        for message in MessageStream::new(&self.0).expect("a readable start") {
            let message = message.expect("an unbroken message");
            if message.channel.metadata.contains_key("derived_from") {
                continue;
            }
            let descriptor =
                types.entry(message.channel.id).or_insert_with(|| descriptor(&message.channel));
            let sample = DynamicMessage::decode(descriptor.clone(), &*message.data);
            let mut sample = sample.expect("a message of its schema");
            if !sample.has_field_by_name("header") {
                // An event: a sentence. Events are kept in the order in which they were recorded.
                let text = sample.get_field_by_name("message").expect("a sentence");
                let text = text.as_str().expect("a text").as_bytes().to_vec();
                events += 1;
                contents.insert((message.channel.topic.clone(), 0, events), text);
                continue;
            }
            let mut number = |name: &str| {
                let header = sample.get_field_by_name_mut("header").expect("a header");
                let header = header.as_message_mut().expect("a nested header");
                for stamp in
                    ["receive_mono_ns", "release_mono_ns", "start_mono_ns", "publish_mono_ns"]
                {
                    header.clear_field_by_name(stamp);
                }
                let mut number = Vec::new();
                flatten(&header.get_field_by_name(name).expect("a number"), &mut number);
                // Seats and sequences are small whole numbers, for which bits are in the same order.
                number[0].to_bits()
            };
            let key = (message.channel.topic.clone(), number("seat"), number("sequence"));
            sample.clear_field_by_name("rescued_waits");
            if let Some(state) = sample.get_field_by_name_mut("state") {
                *state = Value::Bytes(vec![0; state.as_bytes().map_or(0, Bytes::len)].into());
            }
            contents.insert(key, sample.encode_to_vec());
        }
        contents
    }

    /// Writes a copy of a complete file with its checksums in order. `about` may change the metadata
    /// of a channel, `content` the bytes of a message, identified by topic and sequence; a
    /// message left without bytes is left out.
    pub(crate) fn copy_to(
        &self,
        path: &Path,
        about: impl Fn(&str, &mut BTreeMap<String, String>),
        mut content: impl FnMut(&str, u32, &mut Vec<u8>),
    ) {
        let summary = mcap::Summary::read(&self.0).expect("a readable end").expect("a summary");
        let file = std::fs::File::create(path).expect("a new file");
        let mut writer = mcap::Writer::new(file).expect("a writer");
        for index in &summary.metadata_indexes {
            let metadata = mcap::read::metadata(&self.0, index).expect("metadata");
            writer.write_metadata(&metadata).expect("room");
        }
        for index in &summary.attachment_indexes {
            let attachment = mcap::read::attachment(&self.0, index).expect("an attachment");
            writer.attach(&attachment).expect("room");
        }
        let channels: BTreeMap<_, _> = summary.channels.iter().collect();
        let ids: BTreeMap<u16, u16> = channels
            .into_iter()
            .map(|(old, channel)| {
                let schema = channel.schema.as_ref().expect("a schema");
                let mut metadata = channel.metadata.clone();
                about(&channel.topic, &mut metadata);
                let id = writer
                    .add_schema(&schema.name, &schema.encoding, &schema.data)
                    .and_then(|id| writer.add_channel(id, &channel.topic, "protobuf", &metadata));
                (*old, id.expect("a channel"))
            })
            .collect();
        for message in MessageStream::new(&self.0).expect("a readable start") {
            let message = message.expect("an unbroken message");
            let mut data = message.data.to_vec();
            content(&message.channel.topic, message.sequence, &mut data);
            if data.is_empty() {
                continue;
            }
            let header = mcap::records::MessageHeader {
                channel_id: ids[&message.channel.id],
                sequence: message.sequence,
                log_time: message.log_time,
                publish_time: message.publish_time,
            };
            writer.write_to_known_channel(&header, &data).expect("room");
        }
        writer.finish().expect("room");
    }

    /// Samples of a topic, with the numbers of `fields`, or of `header.FIELD`; nested messages are laid flat.
    pub(crate) fn series(&self, topic: &str, fields: &[&str]) -> Vec<Row> {
        let [rows] = self.several([(topic, fields)]);
        assert!(!rows.is_empty(), "nothing on {topic}");
        rows
    }

    /// As [`Recording::series`], of several topics in one reading; a topic may be empty.
    pub(crate) fn several<const N: usize>(&self, wanted: [(&str, &[&str]); N]) -> [Vec<Row>; N] {
        let mut types: BTreeMap<u16, MessageDescriptor> = BTreeMap::new();
        let mut rows = [const { Vec::new() }; N];
        for message in MessageStream::new(&self.0).expect("a readable start") {
            let message = message.expect("an unbroken message");
            let topic = message.channel.topic.trim_start_matches('/');
            let mut asked = wanted.iter().zip(&mut rows).filter(|((name, _), _)| *name == topic);
            let Some(((_, fields), rows)) = asked.next() else { continue };
            let descriptor =
                types.entry(message.channel.id).or_insert_with(|| descriptor(&message.channel));
            let sample = DynamicMessage::decode(descriptor.clone(), &*message.data);
            rows.push(row(&sample.expect("a message of its schema"), fields));
        }
        rows
    }
}

fn descriptor(channel: &mcap::Channel<'_>) -> MessageDescriptor {
    let schema = channel.schema.as_ref().expect("a schema");
    let pool = DescriptorPool::decode(&*schema.data).expect("a descriptor set");
    pool.get_message_by_name(&schema.name).expect("the message in its schema")
}

fn row(sample: &DynamicMessage, fields: &[&str]) -> Row {
    let header = sample.get_field_by_name("header").expect("a header");
    let header = header.as_message().expect("a nested header");
    let mut valid_ns = Vec::new();
    flatten(&header.get_field_by_name("valid_ns").expect("an instant"), &mut valid_ns);
    let mut values = Vec::new();
    for field in fields {
        let value = match field.strip_prefix("header.") {
            Some(field) => header.get_field_by_name(field),
            None => sample.get_field_by_name(field),
        };
        flatten(&value.unwrap_or_else(|| panic!("no field {field}")), &mut values);
    }
    Row { t_s: valid_ns[0] * 1e-9, values }
}

fn flatten(value: &Value, into: &mut Vec<f64>) {
    match value {
        Value::F64(number) => into.push(*number),
        Value::U64(number) => into.push(*number as f64),
        Value::U32(number) => into.push(f64::from(*number)),
        Value::EnumNumber(number) => into.push(f64::from(*number)),
        Value::Bool(flag) => into.push(f64::from(u8::from(*flag))),
        Value::List(list) => list.iter().for_each(|value| flatten(value, into)),
        Value::Message(message) => {
            let descriptor = message.descriptor();
            descriptor.fields().for_each(|field| flatten(&message.get_field(&field), into));
        }
        other => panic!("no number: {other:?}"),
    }
}

/// Length of the record at `at`, its opcode and length included.
pub(crate) fn record_at(bytes: &[u8], at: usize) -> usize {
    let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().expect("eight bytes"));
    9 + usize::try_from(length).expect("a short record")
}

/// Places of the first records of a kind.
pub(crate) fn places(bytes: &[u8], opcode: u8) -> Vec<usize> {
    let next = |at: &usize| Some(at + record_at(bytes, *at)).filter(|at| *at + 9 < bytes.len() - 8);
    let all = std::iter::successors(Some(MAGIC.len()), next);
    all.filter(|at| bytes[*at] == opcode).collect()
}

/// Opcode of a chunk.
pub(crate) const CHUNK: u8 = 0x06;

/// A place in the middle of a chunk in the middle: damage there is found, in an index between two chunks it may not be.
pub(crate) fn middle_of_a_chunk(bytes: &[u8]) -> usize {
    let chunks = places(bytes, CHUNK);
    let chunk = chunks[chunks.len() / 2];
    chunk + record_at(bytes, chunk) / 2
}
