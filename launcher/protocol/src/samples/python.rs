//! The samples as `ctypes` structures.

use super::{services, topic_schemas};
use shared_types::wire::{EnumSchema, Field, Kind, Schema, Wire as _};
use shared_types::{Edge, Handover, NO_SEAT, REGISTRY_LINES, Role, SEATS, TopicInfo};
use std::fmt::Write as _;

const HEAD: &str = r#""""Samples of morphquad as ctypes structures.

Written by `morphquad types --python`; do not edit. A service carries the bytes of a structure; its attribute
`layout` says LAYOUT. After the Header of a hand-over come a Handover and a state.
"""

import ctypes
import enum
import typing


class Topic(typing.NamedTuple):
    """One arrow of the data flow."""

    type: type
    producer: "Role"
    consumers: tuple
    edge: str
    history: int


def seat_label(role, seat):
    """Name of a seat in services: `attitude` for the first, then `attitude-1`."""
    name = Role(role).name.lower()
    return name if seat == 0 else f"{name}-{seat}"
"#;

/// A Python module with every sample, topic, service and constant.
#[must_use]
pub fn python() -> String {
    let topics = topic_schemas();
    let mut module = Module { text: HEAD.to_owned(), declared: Vec::new() };
    module.constants();
    // Of no service: behind the header of a hand-over.
    module.structure(const { &Handover::SCHEMA });
    for schema in topics.iter().map(|(_, s)| *s).chain(services().map(|(_, s)| s)) {
        module.structure(schema);
    }
    module.topics(&topics);
    module.services();
    module.text
}

struct Module {
    text: String,
    /// Names of the classes that are there already.
    declared: Vec<&'static str>,
}

impl Module {
    /// Adds a line; writing to a string cannot fail.
    fn line(&mut self, line: core::fmt::Arguments) {
        let _ = writeln!(self.text, "{line}");
    }

    fn constants(&mut self) {
        self.line(format_args!("\n\nVERSION = \"{}\"", env!("CARGO_PKG_VERSION")));
        self.line(format_args!("SEATS = {SEATS}"));
        self.line(format_args!("NO_SEAT = {NO_SEAT}"));
        self.line(format_args!("REGISTRY_LINES = {REGISTRY_LINES}"));
    }

    /// True the first time.
    fn declares(&mut self, name: &'static str) -> bool {
        let new = !self.declared.contains(&name);
        if new {
            self.declared.push(name);
        }
        new
    }

    /// A structure after those it consists of.
    fn structure(&mut self, schema: &'static Schema) {
        if self.declared.contains(&schema.name) {
            return;
        }
        for field in schema.fields {
            match field.kind {
                Kind::Message(nested) => self.structure(nested),
                Kind::Enum(code) => self.code(code),
                _ => {}
            }
        }
        self.declares(schema.name);
        self.line(format_args!("\n\nclass {}(ctypes.Structure):", schema.name));
        self.line(format_args!("    LAYOUT = \"{:016x}\"", schema.layout_hash));
        self.line(format_args!("    SIZE = {}", schema.size));
        self.line(format_args!("    OFFSETS = {{"));
        for Field { name, offset, .. } in schema.fields {
            self.line(format_args!("        \"{name}\": {offset},"));
        }
        self.line(format_args!("    }}\n    _fields_ = ["));
        for field in schema.fields {
            self.line(format_args!("        (\"{}\", {}),", field.name, type_of(field)));
        }
        self.line(format_args!("    ]"));
    }

    fn code(&mut self, code: &'static EnumSchema) {
        if self.declares(code.name) {
            self.line(format_args!("\n\nclass {}(enum.IntEnum):", code.name));
            for (name, value) in code.variants {
                // A keyword of the language cannot be a name.
                let mark = if matches!(*name, "None" | "True" | "False") { "_" } else { "" };
                self.line(format_args!("    {name}{mark} = {value}"));
            }
        }
    }

    fn topics(&mut self, topics: &[(&TopicInfo, &Schema)]) {
        self.line(format_args!("\n\nTOPICS = {{"));
        for (info, schema) in topics {
            let edge = match info.edge {
                Edge::ZeroLatency => "zero latency",
                Edge::Delayed => "delayed",
                Edge::RecordOnly => "record only",
            };
            let consumers = info.to.iter().map(|role| format!("{}, ", constant(*role)));
            let consumers: String = consumers.collect();
            self.line(format_args!(
                "    \"{}\": Topic({}, {}, ({}), \"{edge}\", {}),",
                info.name,
                schema.name,
                constant(info.from),
                consumers.trim_end(),
                info.history
            ));
        }
        self.line(format_args!("}}"));
    }

    fn services(&mut self) {
        self.line(format_args!("\n# Services beside the topics; those of a seat end in /LABEL."));
        self.line(format_args!("SERVICES = {{"));
        for (name, schema) in services() {
            self.line(format_args!("    \"{name}\": {},", schema.name));
        }
        self.line(format_args!("}}"));
    }
}

fn constant(role: Role) -> String {
    format!("Role.{role:?}")
}

fn type_of(field: &Field) -> String {
    let element = match field.kind {
        Kind::F64 => "ctypes.c_double",
        Kind::U64 => "ctypes.c_uint64",
        Kind::U32 | Kind::Enum(_) => "ctypes.c_uint32",
        Kind::U8 => "ctypes.c_uint8",
        Kind::I8 => "ctypes.c_int8",
        Kind::Message(nested) => nested.name,
    };
    if field.repeated { format!("{element} * {}", field.count) } else { element.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// Python lays out structures by itself, as C does.
    const CHECK: &str = "
import ctypes, sys
sys.path.insert(0, sys.argv[1])
import samples
classes = [c for c in vars(samples).values()
           if isinstance(c, type) and issubclass(c, ctypes.Structure)]
for c in classes:
    assert ctypes.sizeof(c) == c.SIZE, (c, ctypes.sizeof(c))
    for name, _ in c._fields_:
        assert getattr(c, name).offset == c.OFFSETS[name], (c, name)
for name, topic in samples.TOPICS.items():
    assert topic.type in classes
    assert isinstance(topic.producer, samples.Role) and len(topic.type.LAYOUT) == 16
assert samples.seat_label(samples.Role.Attitude, 0) == 'attitude'
assert samples.seat_label(samples.Role.Attitude, 2) == 'attitude-2'
print(len(classes), len(samples.TOPICS))
";

    #[test]
    fn python_lays_out_every_sample_as_this_build_does() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("samples.py"), python()).unwrap();
        let checked = Command::new("python3")
            .args(["-B", "-c", CHECK])
            .arg(folder.path())
            .output()
            .expect("python3 is there, as for the readers of recordings");
        let errors = String::from_utf8_lossy(&checked.stderr);
        assert!(checked.status.success(), "{errors}");
        let counted = String::from_utf8_lossy(&checked.stdout);
        let counted: Vec<usize> = counted.split_whitespace().map(|n| n.parse().unwrap()).collect();
        assert_eq!(counted[1], topic_schemas().len());
        assert!(counted[0] > counted[1], "{counted:?}");
    }

    #[test]
    fn the_module_is_the_same_each_time() {
        assert_eq!(python(), python());
    }
}
