//! The two kinds of record that are no topic: published states and events.

use super::decode::{DecodeError, Fields, decode};
use super::encode::{encode_bytes, encode_nested};
use super::schema::{PACKAGE, add_message, empty_file, plain_field};
use prost::encoding::{WireType, encode_key, encode_varint, uint64};
use prost_types::field_descriptor_proto::Type;
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};
use shared_types::Header;
use shared_types::wire::Wire as _;

/// Full name of the message on `/state/...`.
pub(super) const STATE_NAME: &str = "morphquad.v1.ServiceState";

/// Schema of the message on `/events`.
#[must_use]
pub fn log_schema() -> (&'static str, FileDescriptorSet) {
    (LOG_NAME, log_descriptor())
}

/// Full name of the message on `/events`; viewers show it in their log panel.
pub(super) const LOG_NAME: &str = "foxglove.Log";

/// `ServiceState { Header header = 1; uint64 layout_hash = 2; bytes state = 3; }`
pub(super) fn state_descriptor() -> FileDescriptorSet {
    let mut file = empty_file("ServiceState");
    add_message(&mut file, &Header::SCHEMA);
    let header = FieldDescriptorProto {
        type_name: Some(format!(".{PACKAGE}.Header")),
        ..plain_field(1, "header", Type::Message, false)
    };
    let layout_hash = plain_field(2, "layout_hash", Type::Uint64, false);
    let state = plain_field(3, "state", Type::Bytes, false);
    file.message_type.push(message("ServiceState", vec![header, layout_hash, state]));
    FileDescriptorSet { file: vec![file] }
}

pub(super) fn encode_state(header: &Header, layout_hash: u64, state: &[u8], out: &mut Vec<u8>) {
    encode_nested(1, header, out);
    uint64::encode(2, &layout_hash, out);
    encode_bytes(3, state, out);
}

/// Reads what [`encode_state`] wrote.
pub(super) fn decode_state(bytes: &[u8]) -> Result<(Header, u64, &[u8]), DecodeError> {
    let mut reader = Fields::new("ServiceState", bytes);
    let header = decode(reader.delimited(1, "header")?)?;
    let layout_hash = reader.varint(2, "layout_hash")?;
    let state = reader.delimited(3, "state")?;
    reader.finish("state")?;
    Ok((header, layout_hash, state))
}

/// How bad an event is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// For developers.
    Debug,
    /// Worth knowing.
    Info,
    /// The flight goes on, but not as planned.
    Warning,
    /// Something failed.
    Error,
    /// The flight ends.
    Fatal,
}

/// Something that happened in a flight, as text.
#[derive(Debug, Clone, Copy)]
pub struct Event<'a> {
    /// Logical instant \[ns\].
    pub logical_ns: u64,
    /// How bad it is.
    pub severity: Severity,
    /// Its source.
    pub source: &'a str,
    /// One sentence.
    pub text: &'a str,
}

/// Levels of `foxglove.Log` in order of their number.
const LEVELS: [&str; 6] = ["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"];

impl Severity {
    const fn level(self) -> u64 {
        match self {
            Self::Debug => 1,
            Self::Info => 2,
            Self::Warning => 3,
            Self::Error => 4,
            Self::Fatal => 5,
        }
    }
}

/// The well-known schema `foxglove.Log`, with the time stamp type it imports.
pub(super) fn log_descriptor() -> FileDescriptorSet {
    let timestamp = FileDescriptorProto {
        name: Some("google/protobuf/timestamp.proto".to_owned()),
        package: Some("google.protobuf".to_owned()),
        syntax: Some("proto3".to_owned()),
        message_type: vec![message(
            "Timestamp",
            vec![
                plain_field(1, "seconds", Type::Int64, false),
                plain_field(2, "nanos", Type::Int32, false),
            ],
        )],
        ..FileDescriptorProto::default()
    };
    let typed = |number, name, kind, type_name: &str| FieldDescriptorProto {
        type_name: Some(type_name.to_owned()),
        ..plain_field(number, name, kind, false)
    };
    let mut log = message(
        "Log",
        vec![
            typed(1, "timestamp", Type::Message, ".google.protobuf.Timestamp"),
            typed(2, "level", Type::Enum, ".foxglove.Log.Level"),
            plain_field(3, "message", Type::String, false),
            plain_field(4, "name", Type::String, false),
            plain_field(5, "file", Type::String, false),
            plain_field(6, "line", Type::Fixed32, false),
        ],
    );
    log.enum_type.push(EnumDescriptorProto {
        name: Some("Level".to_owned()),
        value: (0..).zip(LEVELS).map(|(number, name)| level_value(number, name)).collect(),
        ..EnumDescriptorProto::default()
    });
    let file = FileDescriptorProto {
        name: Some("foxglove/Log.proto".to_owned()),
        package: Some("foxglove".to_owned()),
        dependency: timestamp.name.iter().cloned().collect(),
        message_type: vec![log],
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![timestamp, file] }
}

/// `stamp_ns` is Unix time. Fields 5 and 6 (source file and line) stay empty.
pub fn encode_log(event: &Event<'_>, stamp_ns: u64, out: &mut Vec<u8>) {
    let mut timestamp = Vec::with_capacity(16);
    uint64::encode(1, &(stamp_ns / 1_000_000_000), &mut timestamp);
    uint64::encode(2, &(stamp_ns % 1_000_000_000), &mut timestamp);
    encode_bytes(1, &timestamp, out);
    encode_key(2, WireType::Varint, out);
    encode_varint(event.severity.level(), out);
    encode_bytes(3, event.text.as_bytes(), out);
    encode_bytes(4, event.source.as_bytes(), out);
}

/// Reads what [`encode_log`] wrote: Unix time \[ns\], level, text and source.
///
/// # Errors
/// Bytes that are not such a message: names the field.
pub fn decode_log(bytes: &[u8]) -> Result<(u64, u64, String, String), DecodeError> {
    let mut reader = Fields::new("Log", bytes);
    let mut stamp = Fields::new("Timestamp", reader.delimited(1, "timestamp")?);
    let seconds = stamp.varint(1, "seconds")?;
    let nanos = stamp.varint(2, "nanos")?;
    stamp.finish("nanos")?;
    let level = reader.varint(2, "level")?;
    let text = String::from_utf8_lossy(reader.delimited(3, "message")?).into_owned();
    let source = String::from_utf8_lossy(reader.delimited(4, "name")?).into_owned();
    reader.finish("name")?;
    let stamp_ns = seconds.saturating_mul(1_000_000_000).saturating_add(nanos);
    Ok((stamp_ns, level, text, source))
}

fn message(name: &str, field: Vec<FieldDescriptorProto>) -> DescriptorProto {
    DescriptorProto { name: Some(name.to_owned()), field, ..DescriptorProto::default() }
}

fn level_value(number: i32, name: &str) -> EnumValueDescriptorProto {
    EnumValueDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        ..EnumValueDescriptorProto::default()
    }
}

#[cfg(test)]
mod tests {
    use super::{Event, Severity, decode_log, decode_state, encode_log, encode_state};
    use shared_types::Header;

    #[test]
    fn bytes_behind_the_last_field_are_refused() {
        let mut state = Vec::new();
        encode_state(&Header::default(), 7, &[1, 2, 3], &mut state);
        assert_eq!(
            decode_state(&state).map(|(_, hash, state)| (hash, state)),
            Ok((7, &[1, 2, 3][..]))
        );
        let mut log = Vec::new();
        let event =
            Event { logical_ns: 5, severity: Severity::Info, source: "pilot", text: "gust" };
        encode_log(&event, 5, &mut log);
        assert!(decode_log(&log).is_ok());
        for extra in [&[8, 1][..], &[0], &[0, 0, 0]] {
            let text = |error: super::DecodeError| error.to_string();
            let state = decode_state(&[&state, extra].concat()).map(drop).map_err(text);
            assert_eq!(state, Err("ServiceState.state: bytes are left over".to_owned()));
            let log = decode_log(&[&log, extra].concat()).map(drop).map_err(text);
            assert_eq!(log, Err("Log.name: bytes are left over".to_owned()));
        }
    }
}
