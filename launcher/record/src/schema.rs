//! Protobuf descriptors, derived from the reflection of a sample.
//!
//! A field's number is its position in the struct, from 1; padding keeps its number and is left out. Each set is
//! self-contained, so a channel needs no other file. Flags are `bool`, which viewers plot.

use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};
use shared_types::Flag;
use shared_types::wire::{EnumSchema, Field, FieldClass, Kind, Schema, Value};

/// Package of every recorded sample.
pub const PACKAGE: &str = "morphquad.v1";

/// Full protobuf name of a sample's message.
#[must_use]
pub fn full_name(schema: &Schema) -> String {
    format!("{PACKAGE}.{}", schema.name)
}

/// The message of `schema` with everything it refers to, as one file in package [`PACKAGE`].
#[must_use]
pub fn descriptor_set(schema: &Schema) -> FileDescriptorSet {
    let mut file = empty_file(schema.name);
    add_message(&mut file, schema);
    FileDescriptorSet { file: vec![file] }
}

/// A file of [`PACKAGE`] without content.
pub(super) fn empty_file(name: &str) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(format!("morphquad/v1/{name}.proto")),
        package: Some(PACKAGE.to_owned()),
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    }
}

/// Adds a message and, before it, the types it uses; a type already present is left alone.
pub(super) fn add_message(file: &mut FileDescriptorProto, schema: &Schema) {
    if file.message_type.iter().any(|message| message.name() == schema.name) {
        return;
    }
    for field in schema.fields {
        match field.kind {
            Kind::Message(nested) => add_message(file, nested),
            Kind::Enum(code) if !is_flag(code) => add_enum(file, code),
            _ => {}
        }
    }
    let fields = (1..).zip(schema.fields).filter(|(_, field)| field.class != FieldClass::Padding);
    file.message_type.push(DescriptorProto {
        name: Some(schema.name.to_owned()),
        field: fields.map(|(number, field)| field_descriptor(number, field)).collect(),
        ..DescriptorProto::default()
    });
}

fn field_descriptor(number: i32, field: &Field) -> FieldDescriptorProto {
    let (kind, type_name) = match field.kind {
        Kind::F64 => (Type::Double, None),
        Kind::U64 => (Type::Uint64, None),
        Kind::U32 => (Type::Uint32, None),
        Kind::U8 | Kind::I8 => (Type::Bytes, None),
        Kind::Enum(code) if is_flag(code) => (Type::Bool, None),
        Kind::Enum(code) => (Type::Enum, Some(code.name)),
        Kind::Message(nested) => (Type::Message, Some(nested.name)),
    };
    // A run of bytes is one value of type `bytes`, not a repeated one.
    let repeated = field.repeated && kind != Type::Bytes;
    FieldDescriptorProto {
        type_name: type_name.map(|name| format!(".{PACKAGE}.{name}")),
        ..plain_field(number, field.name, kind, repeated)
    }
}

/// True for [`Flag`], whose codes are a `bool` on the wire as they are in memory.
fn is_flag(code: &EnumSchema) -> bool {
    matches!(<Flag as Value>::KIND, Kind::Enum(flag) if flag.name == code.name)
}

/// A field without a type name; proto3 packs repeated numbers by itself.
pub(super) fn plain_field(
    number: i32,
    name: &str,
    kind: Type,
    repeated: bool,
) -> FieldDescriptorProto {
    let label = if repeated { Label::Repeated } else { Label::Optional };
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(label.into()),
        r#type: Some(kind.into()),
        ..FieldDescriptorProto::default()
    }
}

fn add_enum(file: &mut FileDescriptorProto, code: &EnumSchema) {
    if file.enum_type.iter().any(|known| known.name() == code.name) {
        return;
    }
    // proto3 wants the zero value first, and wants one.
    let (zero, rest): (Vec<_>, Vec<_>) = code.variants.iter().partition(|(_, value)| *value == 0);
    let unnamed = if zero.is_empty() { Some(("Unspecified", 0)) } else { None };
    let values = unnamed.into_iter().chain(zero).chain(rest);
    let prefix = shouting(code.name);
    file.enum_type.push(EnumDescriptorProto {
        name: Some(code.name.to_owned()),
        value: values
            .map(|(name, value)| EnumValueDescriptorProto {
                // Values share their enum's scope, so the prefix keeps two enums apart.
                name: Some(format!("{prefix}_{}", shouting(name))),
                number: Some(value.cast_signed()),
                options: None,
            })
            .collect(),
        ..EnumDescriptorProto::default()
    });
}

/// `SolveStatus` -> `SOLVE_STATUS`.
fn shouting(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 4);
    for (i, letter) in name.chars().enumerate() {
        if i > 0 && letter.is_ascii_uppercase() {
            out.push('_');
        }
        out.push(letter.to_ascii_uppercase());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{add_enum, descriptor_set, empty_file};
    use prost_reflect::DescriptorPool;
    use prost_types::DescriptorProto;
    use shared_types::header::Sample;
    use shared_types::topics::visit_all;
    use shared_types::wire::{EnumSchema, FieldClass, Kind, Schema, Wire as _};
    use shared_types::{AttitudeReport, Topic, TopicVisitor};
    use std::collections::BTreeMap;
    use std::convert::Infallible;

    #[test]
    fn an_independent_parser_accepts_the_descriptors_of_every_topic() {
        struct Check;
        impl TopicVisitor for Check {
            type Error = Infallible;
            fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
                let schema = topic.schema();
                let pool = DescriptorPool::from_file_descriptor_set(descriptor_set(&schema));
                let pool = pool.unwrap_or_else(|e| panic!("{}: {e}", topic.info.name));
                let message = pool.get_message_by_name(&super::full_name(&schema)).unwrap();
                for (i, field) in schema.fields.iter().enumerate() {
                    let found = message.get_field(u32::try_from(i + 1).unwrap());
                    let name = found.map(|f| f.name().to_owned());
                    let expected =
                        (field.class != FieldClass::Padding).then(|| field.name.to_owned());
                    assert_eq!(name, expected, "{}", topic.info.name);
                }
                Ok(())
            }
        }
        visit_all(&mut Check).unwrap();
    }

    #[test]
    fn one_name_means_one_layout_in_the_whole_floor_plan() {
        fn walk(schema: &Schema, seen: &mut BTreeMap<&'static str, u64>) {
            let hash = *seen.entry(schema.name).or_insert(schema.layout_hash);
            assert_eq!(hash, schema.layout_hash, "two types are called {}", schema.name);
            for field in schema.fields {
                if let Kind::Message(nested) = field.kind {
                    walk(nested, seen);
                }
            }
        }
        struct Walk(BTreeMap<&'static str, u64>);
        impl TopicVisitor for Walk {
            type Error = Infallible;
            fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
                walk(&topic.schema(), &mut self.0);
                Ok(())
            }
        }
        visit_all(&mut Walk(BTreeMap::new())).unwrap();
    }

    #[test]
    fn an_enum_starts_with_zero_even_if_its_code_does_not() {
        let mut file = empty_file("Test");
        let without_zero = EnumSchema { name: "GateKind", variants: &[("Far", 7), ("Near", 2)] };
        let zero_last = EnumSchema { name: "Side", variants: &[("Left", 1), ("Right", 0)] };
        add_enum(&mut file, &without_zero);
        add_enum(&mut file, &zero_last);
        let values = |i: usize| -> Vec<_> {
            file.enum_type[i].value.iter().map(|v| (v.name(), v.number())).collect()
        };
        let first = [("GATE_KIND_UNSPECIFIED", 0), ("GATE_KIND_FAR", 7), ("GATE_KIND_NEAR", 2)];
        assert_eq!(values(0), first);
        assert_eq!(values(1), [("SIDE_RIGHT", 0), ("SIDE_LEFT", 1)]);
    }

    #[test]
    fn types_come_once_and_before_their_use() {
        let set = descriptor_set(&AttitudeReport::SCHEMA);
        let names: Vec<_> = set.file[0].message_type.iter().map(DescriptorProto::name).collect();
        assert_eq!(names, ["Header", "SolveReport", "AttitudeReport"]);
        assert_eq!(set.file[0].enum_type[0].value[1].name(), "SOLVE_STATUS_ITERATION_LIMIT");
    }
}
