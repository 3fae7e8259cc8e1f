//! The keys of a scenario, described by the types that read them: what each is called, takes and means.

use ::pilot::settings as pilot;
use disturbance_injector as event;
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema};
use serde_json::{Map, Value};

/// A section of a scenario.
#[derive(Debug, Clone)]
pub struct Section {
    /// As it stands in brackets.
    pub name: &'static str,
    /// What it is for.
    pub meaning: String,
    /// What can be set in it.
    pub keys: Vec<Key>,
}

/// What can be set.
#[derive(Debug, Clone)]
pub struct Key {
    /// Dotted, from the section on; of each entry of a list, `LIST[].KEY`.
    pub name: String,
    /// The word for `kind` beside which alone the key has a place.
    pub kind: Option<&'static str>,
    /// Form of the value.
    pub takes: String,
    /// Least and largest number.
    pub range: [Option<f64>; 2],
    /// Value if left out; none if that depends on the rest.
    pub default: Option<Value>,
    /// Whether it has to be set.
    pub is_required: bool,
    /// What it means, with its unit.
    pub meaning: String,
    /// How many parts of the name, from the first on, lead to what is there only if the scenario writes it.
    pub(crate) written_tables: usize,
}

/// All sections in the order of the alphabet.
#[must_use]
pub fn sections() -> Vec<Section> {
    macro_rules! described {
        (@ section $name:ident $type:ty) => { section::<$type>(stringify!($name)) };
        (@ list $name:ident $type:ty) => { list::<$type>(stringify!($name)) };
        (@ $how:ident $name:ident $type:ty) => { $how(stringify!($name)) };
        ($($name:ident $how:ident $type:ty,)*) => { vec![$(described!(@ $how $name $type)),*] };
    }
    let mut sections = with_sections!(described);
    sections.sort_by_key(|section| section.name);
    sections
}

fn section<T: JsonSchema>(name: &'static str) -> Section {
    let schema = schema::<T>();
    let mut keys = Vec::new();
    walk(name, &schema, (None, 0), &mut keys);
    Section { name, meaning: meaning(&schema), keys }
}

/// A section of which there may be several.
fn list<T: IntoIterator<Item: JsonSchema>>(name: &'static str) -> Section {
    let schema = schema::<T::Item>();
    let mut keys = Vec::new();
    walk(&format!("{name}[]"), &schema, (None, 0), &mut keys);
    Section { name, meaning: meaning(&schema), keys }
}

fn pilot(name: &'static str) -> Section {
    let meaning = "Where to fly and how wide to spread the arms.".to_owned();
    let mut section = Section { meaning, ..section::<pilot::Common>(name) };
    section.keys.push(kind(&format!("{name}.kind"), &pilot::KINDS));
    let kinds = [
        ("hover", schema::<pilot::Hover>()),
        ("figure8", schema::<pilot::Figure8>()),
        ("waypoints", schema::<pilot::Waypoints>()),
        ("trajectory", schema::<pilot::Trajectory>()),
        ("attitude_step", schema::<pilot::Step>()),
    ];
    for (kind, schema) in kinds {
        walk(name, &schema, (Some(kind), 0), &mut section.keys);
    }
    section
}

fn injector(name: &'static str) -> Section {
    let mut section = section::<event::settings::Settings>(name);
    macro_rules! described {
        ($($kind:ident $variant:ident,)*) => {
            [$((stringify!($kind), schema::<event::$variant>())),*]
        };
    }
    let kinds = with_events!(described);
    let list = format!("{name}.script");
    section.keys.retain(|key| key.name != list);
    let script = format!("{list}[]");
    section.keys.push(kind(&format!("{script}.kind"), &kinds.each_ref().map(|(kind, _)| *kind)));
    for (kind, schema) in kinds {
        walk(&script, &schema, (Some(kind), 0), &mut section.keys);
    }
    section
}

/// The key that decides which others there are.
fn kind(name: &str, values: &[&str]) -> Key {
    Key {
        name: name.to_owned(),
        kind: None,
        takes: values.join(" | "),
        range: [None, None],
        default: None,
        is_required: true,
        meaning: "Which of them it is; the keys below that name one belong to it alone.".to_owned(),
        written_tables: 0,
    }
}

/// The type without references to others.
fn schema<T: JsonSchema>() -> Value {
    let settings =
        SchemaSettings::draft2020_12().with(|settings| settings.inline_subschemas = true);
    Schema::to_value(settings.into_generator().into_root_schema_for::<T>())
}

/// Every key of a table and of the tables in it, beside the `kind` to which they belong, with how many tables of the prefix
/// have to be written.
fn walk(
    prefix: &str,
    schema: &Value,
    (kind, written_tables): (Option<&'static str>, usize),
    keys: &mut Vec<Key>,
) {
    let Some(Value::Object(properties)) = schema.get("properties") else { return };
    let required = schema.get("required").and_then(Value::as_array);
    for (property, value) in properties {
        let name = format!("{prefix}.{property}");
        let is_optional = may_be_left_out(value);
        let value = present(value);
        let entry = value.get("items").filter(|items| items.get("properties").is_some());
        let variants = value.get("oneOf").and_then(Value::as_array).into_iter().flatten();
        let mut tables = variants.filter(|variant| variant.get("properties").is_some()).peekable();
        if let Some(entry) = entry {
            walk(&format!("{name}[]"), entry, (kind, written_tables), keys);
        } else if tables.peek().is_some() {
            let before = keys.len();
            // The first part below names which of them it is, and is there only if it is written.
            let as_written = (kind, name.split('.').count() + 1);
            for table in tables {
                walk(&name, table, as_written, keys);
            }
            // One of them is enough.
            for key in keys.iter_mut().skip(before) {
                key.is_required = false;
            }
        } else if value.get("properties").is_some() {
            let within = if is_optional { name.split('.').count() } else { written_tables };
            walk(&name, &value, (kind, within), keys);
        } else {
            let default = value.get("default").filter(|default| !default.is_null()).cloned();
            let is_required =
                required.is_some_and(|names| names.iter().any(|name| name == property.as_str()));
            let (takes, range) = form(&value);
            // The meaning of a field of a variant is that of the variant.
            let meaning = Some(meaning(&value)).filter(|text| !text.is_empty());
            let meaning = meaning.unwrap_or_else(|| self::meaning(schema));
            keys.push(Key {
                name,
                kind,
                takes,
                range,
                default,
                is_required,
                meaning,
                written_tables,
            });
        }
    }
}

/// Whether there may be no value at all.
fn may_be_left_out(value: &Value) -> bool {
    let kinds = value.get("type").and_then(Value::as_array);
    value.get("anyOf").is_some()
        || kinds.is_some_and(|kinds| kinds.iter().any(|kind| kind == "null"))
}

/// What a value that may be left out is if it is there.
fn present(value: &Value) -> Value {
    let is_null = |kind: &Value| kind.get("type").is_some_and(|kind| kind == "null");
    let choices = value.get("anyOf").and_then(Value::as_array);
    let Some(choice) = choices.and_then(|kinds| kinds.iter().find(|kind| !is_null(kind))) else {
        return value.clone();
    };
    let mut merged = choice.as_object().cloned().unwrap_or_default();
    let own = value.as_object().into_iter().flatten().filter(|(name, _)| *name != "anyOf");
    merged.extend(own.map(|(name, value)| (name.clone(), value.clone())));
    Value::Object(merged)
}

/// Text for what a value may be, and its range.
fn form(value: &Value) -> (String, [Option<f64>; 2]) {
    let number = |value: &Value, name: &str| value.get(name).and_then(Value::as_f64);
    let range = |value: &Value| [number(value, "minimum"), number(value, "maximum")];
    let values = values(value);
    if !values.is_empty() {
        return (values.join(" | "), [None, None]);
    }
    let kinds = match value.get("type") {
        Some(Value::Array(kinds)) => kinds.iter().filter_map(Value::as_str).collect(),
        Some(Value::String(kind)) => vec![kind.as_str()],
        _ => Vec::new(),
    };
    let text = |text: &str| text.to_owned();
    match kinds.into_iter().find(|kind| *kind != "null") {
        Some("number") => (text("number"), range(value)),
        Some("integer") => (text("whole number"), range(value)),
        Some("boolean") => (text("true | false"), [None, None]),
        Some("string") => (text("text"), [None, None]),
        Some("array") => {
            let (one, range) =
                value.get("items").map_or_else(|| (text("value"), [None, None]), form);
            let count = value.get("minItems").filter(|least| value.get("maxItems") == Some(*least));
            match count.and_then(Value::as_u64) {
                Some(count) => (format!("[{one}; {count}]"), range),
                None => (format!("[{one}, ...]"), range),
            }
        }
        _ => match value.get("additionalProperties").filter(|value| value.is_object()) {
            Some(values) => (format!("table of {}s", form(values).0), range(values)),
            None => (text("value"), [None, None]),
        },
    }
}

/// The values of an enumeration.
fn values(value: &Value) -> Vec<String> {
    let word = |value: &Value| value.as_str().map(str::to_owned);
    if let Some(Value::Array(values)) = value.get("enum") {
        return values.iter().filter_map(word).collect();
    }
    let Some(Value::Array(variants)) = value.get("oneOf") else { return Vec::new() };
    let of_variant = |variant: &Value| match variant.get("const") {
        Some(one) => word(one).into_iter().collect(),
        None => values(variant),
    };
    variants.iter().flat_map(of_variant).collect()
}

/// The description of a type or field, in one line.
fn meaning(value: &Value) -> String {
    let text = value.get("description").and_then(Value::as_str).unwrap_or_default();
    let first = text.split("\n\n").next().unwrap_or_default();
    let mut text = first.replace('\n', " ");
    // A link is a name here.
    let mut from = 0;
    while let Some(begin) = text[from..].find("[`").map(|at| from + at) {
        let name = text[begin + 2..].find('`').map(|length| begin + 2 + length);
        let Some(end) = name.filter(|end| text[*end..].starts_with("`]")) else {
            from = begin + 2;
            continue;
        };
        text.remove(end + 1);
        text.remove(begin);
    }
    for (escaped, bare) in [("\\[", "["), ("\\]", "]")] {
        text = text.replace(escaped, bare);
    }
    text
}

impl Key {
    /// The range as text; empty if any number will do.
    #[must_use]
    pub fn range_text(&self) -> String {
        match self.range {
            [None, None] => String::new(),
            [Some(least), None] => format!(" of at least {least}"),
            [None, Some(most)] => format!(" of at most {most}"),
            [Some(least), Some(most)] => format!(" from {least} to {most}"),
        }
    }

    /// The value if left out, as a scenario has it.
    #[must_use]
    pub fn default_in_toml(&self) -> Option<String> {
        self.default.as_ref().map(in_toml)
    }

    /// As an object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let Self { name, kind, takes, range: [least, most], default, is_required, meaning, .. } =
            self;
        Value::Object(Map::from_iter([
            ("key".to_owned(), name.as_str().into()),
            ("kind".to_owned(), (*kind).into()),
            ("takes".to_owned(), takes.as_str().into()),
            ("least".to_owned(), (*least).into()),
            ("most".to_owned(), (*most).into()),
            ("default".to_owned(), default.clone().into()),
            ("required".to_owned(), (*is_required).into()),
            ("meaning".to_owned(), meaning.as_str().into()),
        ]))
    }
}

/// A default as a scenario has it.
fn in_toml(value: &Value) -> String {
    match value {
        Value::Array(list) => {
            format!("[{}]", list.iter().map(in_toml).collect::<Vec<_>>().join(", "))
        }
        // A conversion of units leaves digits that mean nothing.
        Value::Number(number) if number.is_f64() => {
            let number = number.as_f64().unwrap_or_default();
            format!("{:?}", format!("{number:.12e}").parse::<f64>().unwrap_or(number))
        }
        Value::Object(table) if table.is_empty() => "{}".to_owned(),
        value => value.to_string(),
    }
}

#[cfg(test)]
mod tests;
