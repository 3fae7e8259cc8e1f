//! Structs as lists of named numbers, to name where two of them differ.

use core::fmt;
use runtime::Layout;
use runtime::service::StateParts;
use shared_types::wire::{FieldClass, Kind, Schema, Value as _, Wire};

/// A number as a sample holds it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Number {
    /// A double; two of them are the same if all their bits are.
    Float(f64),
    /// An unsigned number or a code.
    Integer(u64),
}

impl Number {
    /// True if not a bit differs.
    #[must_use]
    pub fn is_same(self, other: Self) -> bool {
        match (self, other) {
            (Self::Float(a), Self::Float(b)) => a.to_bits() == b.to_bits(),
            (Self::Integer(a), Self::Integer(b)) => a == b,
            _ => false,
        }
    }

    /// The value for arithmetic.
    #[must_use]
    pub fn value(self) -> f64 {
        match self {
            Self::Float(value) => value,
            Self::Integer(value) => value as f64,
        }
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Float(value) => write!(f, "{value:?} (0x{:016x})", value.to_bits()),
            Self::Integer(value) => write!(f, "{value}"),
        }
    }
}

/// A field's full name and its value.
pub(crate) type Named = (String, Number);

/// Every number of a value, in declaration order; machine fields and padding are left out, except
/// for those in `keep`.
pub(crate) fn numbers_of<T: Wire>(value: &T, prefix: &str, keep: &[&str]) -> Vec<Named> {
    let mut packed = vec![0; T::PACKED_SIZE];
    value.pack(&mut packed);
    numbers_of_packed(&T::SCHEMA, &packed, prefix, keep)
}

/// As [`numbers_of`], of a value in packed form.
fn numbers_of_packed(schema: &Schema, packed: &[u8], prefix: &str, keep: &[&str]) -> Vec<Named> {
    let (mut out, mut rest) = (Vec::new(), packed);
    for field in schema.fields {
        let values;
        (values, rest) = rest.split_at(field.packed_size * field.count);
        let left_out = field.class == FieldClass::Padding
            || (field.class == FieldClass::Machine && !keep.contains(&field.name));
        if left_out {
            continue;
        }
        for (index, value) in values.chunks_exact(field.packed_size).enumerate() {
            let place = if field.repeated { format!("[{index}]") } else { String::new() };
            let name = format!("{prefix}{}{place}", field.name);
            match field.kind {
                Kind::Message(schema) => {
                    out.extend(numbers_of_packed(schema, value, &format!("{name}."), keep));
                }
                Kind::F64 => out.push((name, Number::Float(f64::unpack(value)))),
                _ => {
                    let mut wide = [0; 8];
                    wide[..value.len()].copy_from_slice(value);
                    out.push((name, Number::Integer(u64::from_le_bytes(wide))));
                }
            }
        }
    }
    out
}

/// Name and both values of the first number that differs in any bit.
pub(crate) fn first_difference(old: &[Named], new: &[Named]) -> Option<(String, String, String)> {
    let mut pairs = old.iter().zip(new);
    let ((field, old), (_, new)) = pairs.find(|((_, old), (_, new))| !old.is_same(*new))?;
    Some((field.clone(), old.to_string(), new.to_string()))
}

/// Every number of a packed state: counts, output sequences, latches and memory. The stamps and the
/// generation of a latched sample are those of whichever copy arrived, and are left out.
pub(super) fn numbers_of_state(layout: &Layout, state: &StateParts<'_>) -> Vec<Named> {
    let mut out = numbers_of(&state.header, "header.", &[]);
    for (index, sequence) in state.sequences.chunks_exact(8).enumerate() {
        out.push((format!("output_sequence[{index}]"), Number::Integer(u64::unpack(sequence))));
    }
    for (input, latch) in layout.latches(state) {
        let prefix = format!("latch.{}.", input.topic.name);
        out.push((format!("{prefix}present"), Number::Integer(latch.is_some().into())));
        if let Some(sample) = latch {
            out.extend(numbers_of_packed(input.sample, sample, &prefix, &[]));
        }
    }
    out.extend(numbers_of_packed(layout.memory, state.memory, "memory.", &["owner"]));
    out
}
