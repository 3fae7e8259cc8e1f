//! Samples by field: as JSON and as lines for people.

use core::fmt::Write as _;
use serde_json::{Map, Value, json};
use shared_types::wire::{EnumSchema, Field, Kind, Visitor, Wire};
use shared_types::{Header, NO_SEAT};

/// Elements of a list of structs that people are shown.
const SHOWN: usize = 2;

/// Every field of a sample by name, nested as it is.
#[must_use]
pub fn to_json<T: Wire>(value: &T) -> Map<String, Value> {
    let mut fields = ToJson::default();
    value.visit(&mut fields);
    fields.0
}

/// The value at a path such as `points[0].position_w_m[2]`.
#[must_use]
pub fn at<'v>(fields: &'v Map<String, Value>, path: &str) -> Option<&'v Value> {
    let mut found: Option<&Value> = None;
    for name in path.split('.') {
        let (name, places) = name.split_once('[').map_or((name, None), |(n, p)| (n, Some(p)));
        found = match found {
            None => fields.get(name),
            Some(value) => value.get(name),
        };
        for place in places.into_iter().flat_map(|places| places.split('[')) {
            let place: usize = place.strip_suffix(']')?.parse().ok()?;
            found = found?.get(place);
        }
        found?;
    }
    found
}

/// Numbers and names of a value in a row, as people read them.
#[must_use]
pub fn in_a_row(value: &Value) -> String {
    let all = |values: &mut dyn Iterator<Item = &Value>| {
        values.map(in_a_row).collect::<Vec<_>>().join(" ")
    };
    match value {
        Value::Object(fields) => all(&mut fields.values()),
        Value::Array(list) => all(&mut list.iter()),
        value => plain(value),
    }
}

#[derive(Default)]
struct ToJson(Map<String, Value>);

impl ToJson {
    fn put(&mut self, field: &Field, values: impl Iterator<Item = Value>) {
        let mut values = values;
        let value = if field.repeated { values.collect() } else { values.next().into() };
        self.0.insert(field.name.to_owned(), value);
    }
}

/// JSON cannot express what is no number.
fn number(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { json!(value.to_string()) }
}

fn code(kind: &EnumSchema, code: u64) -> Value {
    let known = kind.variants.iter().find(|(_, known)| u64::from(*known) == code);
    known.map_or_else(|| json!(code), |(name, _)| json!(name))
}

/// The name of a code of an enumeration, or the code itself if it has none.
#[must_use]
pub fn enum_text(kind: &EnumSchema, value: u64) -> String {
    plain(&code(kind, value))
}

/// Bytes that spell a word, filled up with zeros.
#[must_use]
pub fn word(bytes: &[u8]) -> Option<&str> {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (word, rest) = bytes.split_at(end);
    let is_word = rest.iter().all(|byte| *byte == 0) && word.iter().all(u8::is_ascii_graphic);
    std::str::from_utf8(word).ok().filter(|_| is_word)
}

impl Visitor for ToJson {
    fn f64s(&mut self, field: &'static Field, values: &[f64]) {
        self.put(field, values.iter().map(|value| number(*value)));
    }
    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        match field.kind {
            Kind::Enum(kind) => self.put(field, values.iter().map(|value| code(kind, *value))),
            _ => self.put(field, values.iter().map(|value| json!(value))),
        }
    }
    fn bytes(&mut self, field: &'static Field, values: &[u8]) {
        match word(values) {
            Some(word) => {
                self.0.insert(field.name.to_owned(), json!(word));
            }
            None => self.put(field, values.iter().map(|value| json!(value))),
        }
    }
    fn message<T: Wire>(&mut self, field: &'static Field, value: &T) {
        let object = Value::Object(to_json(value));
        if !field.repeated {
            self.0.insert(field.name.to_owned(), object);
            return;
        }
        let list = self.0.entry(field.name).or_insert_with(|| Value::Array(Vec::new()));
        if let Value::Array(list) = list {
            list.push(object);
        }
    }
}

/// A sample for people: what and when on the first line, then a line for each field.
#[must_use]
pub fn to_text(topic: &str, header: &Header, fields: &Map<String, Value>) -> String {
    let Header { sequence, release_ns, valid_ns, seat, generation, .. } = *header;
    let seconds = |ns: u64| format!("{:.6}", ns as f64 / 1e9);
    let mut text = format!("{topic}  #{sequence}  released {} s", seconds(release_ns));
    if valid_ns != release_ns {
        let _ = write!(text, ", in effect {} s", seconds(valid_ns));
    }
    if (seat, generation) != (0, 0) {
        let _ = write!(text, ", seat {seat}, generation {generation}");
    }
    text.push('\n');
    for (name, value) in fields.iter().filter(|(name, _)| *name != "header") {
        lines(&mut text, name, value);
    }
    text
}

fn lines(text: &mut String, name: &str, value: &Value) {
    match value {
        Value::Object(fields) => {
            for (field, value) in fields {
                lines(text, &format!("{name}.{field}"), value);
            }
        }
        Value::Array(list) if list.first().is_some_and(Value::is_object) => {
            for (place, value) in list.iter().take(SHOWN).enumerate() {
                lines(text, &format!("{name}[{place}]"), value);
            }
            if list.len() > SHOWN {
                let more = list.len() - SHOWN;
                let _ = writeln!(text, "  {name}: {more} more, --format json shows them");
            }
        }
        value => {
            let _ = writeln!(text, "  {name}: {}", in_a_row(value));
        }
    }
}

fn plain(value: &Value) -> String {
    // No other whole number has this value, and no reader knows it for what it is.
    if value.as_u64() == Some(NO_SEAT.into()) {
        return "none".to_owned();
    }
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Kind of a field, as people call it.
#[must_use]
pub fn kind_of(field: &Field) -> String {
    let one = match field.kind {
        Kind::F64 => "f64".to_owned(),
        Kind::U64 => "u64".to_owned(),
        Kind::U32 => "u32".to_owned(),
        Kind::U8 => "u8".to_owned(),
        Kind::I8 => "i8".to_owned(),
        Kind::Enum(kind) => {
            kind.variants.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(" | ")
        }
        Kind::Message(schema) => schema.name.to_owned(),
    };
    if field.repeated { format!("[{one}; {}]", field.count) } else { one }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Deviation, DeviationKind, Imu, OwnerRecord, Reference, Role};

    #[test]
    fn fields_have_their_names_codes_their_labels_and_lists_their_elements() {
        let header = Header { sequence: 7, release_ns: 1_500_000_000, ..Header::default() };
        let deviation = Deviation {
            header,
            kind: DeviationKind::LateSamples,
            role: Role::Attitude,
            input: Deviation::input_from("imu"),
            ..Deviation::default()
        };
        let fields = to_json(&deviation);
        assert_eq!(fields["kind"], "LateSamples");
        assert_eq!(fields["input"], "imu");
        assert_eq!(fields["header"]["sequence"], 7);
        let text = to_text("deviation", &header, &fields);
        assert!(text.starts_with("deviation  #7  released 1.500000 s"), "{text}");
        assert!(text.contains("\n  kind: LateSamples\n"), "{text}");
        let reference = to_json(&Reference::default());
        assert_eq!(reference["points"].as_array().map(Vec::len), Some(48));
        assert_eq!(reference["points"][0]["position_w_m"], json!([0.0, 0.0, 0.0]));
        assert!(to_text("reference", &header, &reference).contains("46 more"));
    }

    #[test]
    fn a_path_leads_to_a_field_an_element_and_a_field_of_an_element() {
        let mut reference = Reference { count: 7, ..Reference::default() };
        reference.points[1].position_w_m = [1.0, 2.0, 3.5];
        let fields = to_json(&reference);
        assert_eq!(at(&fields, "count"), Some(&json!(7)));
        assert_eq!(at(&fields, "points[1].position_w_m[2]"), Some(&json!(3.5)));
        assert_eq!(in_a_row(at(&fields, "points[1].position_w_m").unwrap()), "1.0 2.0 3.5");
        for path in
            ["", "points[", "points[x]", "points[48]", "count[0]", "points.count", "header."]
        {
            assert_eq!(at(&fields, path), None, "{path}");
        }
    }

    #[test]
    fn a_seat_that_there_is_not_is_none_for_people() {
        let record = OwnerRecord { fallback: NO_SEAT, ..OwnerRecord::default() };
        let text = to_text("attitude_owner", &Header::default(), &to_json(&record));
        assert!(text.contains("\n  fallback: none\n"), "{text}");
    }

    #[test]
    fn what_is_no_number_is_a_word_in_json() {
        let mut imu = Imu::default();
        imu.header.sequence = u64::MAX;
        let text = serde_json::to_string(&to_json(&imu)).unwrap();
        assert!(text.contains("18446744073709551615"), "{text}");
        assert_eq!(number(f64::NAN), "NaN");
        assert_eq!(number(f64::NEG_INFINITY), "-inf");
    }
}
