//! Structs as lists of named numbers, to say where two of them differ.

use core::fmt;
use observe::MACHINE_FIELDS;
use runtime::input::{Input, InputSet as _, InputVisitor};
use runtime::service::{Service, StateHeader};
use shared_types::wire::{Field, Value as _, Visitor, Wire};
use shared_types::{Sample, Topic};
use std::convert::Infallible;

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
    let mut walk = Walk { prefix: prefix.to_owned(), keep, out: Vec::new(), seen: ("", 0) };
    value.visit(&mut walk);
    walk.out
}

struct Walk<'a> {
    prefix: String,
    keep: &'a [&'a str],
    out: Vec<Named>,
    /// Nested field visited last, and how many of its elements.
    seen: (&'static str, usize),
}

impl Walk<'_> {
    fn is_left_out(&self, field: &Field) -> bool {
        let name = field.name;
        name == "reserved" || (MACHINE_FIELDS.contains(&name) && !self.keep.contains(&name))
    }

    fn add(&mut self, field: &Field, values: impl Iterator<Item = Number>) {
        if self.is_left_out(field) {
            return;
        }
        for (index, value) in values.enumerate() {
            let place = if field.repeated { format!("[{index}]") } else { String::new() };
            self.out.push((format!("{}{}{place}", self.prefix, field.name), value));
        }
    }
}

impl Visitor for Walk<'_> {
    fn f64s(&mut self, field: &'static Field, values: &[f64]) {
        self.add(field, values.iter().map(|value| Number::Float(*value)));
    }
    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        self.add(field, values.iter().map(|value| Number::Integer(*value)));
    }
    fn bytes(&mut self, field: &'static Field, values: &[u8]) {
        self.add(field, values.iter().map(|value| Number::Integer((*value).into())));
    }
    fn message<T: Wire>(&mut self, field: &'static Field, value: &T) {
        if self.is_left_out(field) {
            return;
        }
        let index = if self.seen.0 == field.name { self.seen.1 + 1 } else { 0 };
        self.seen = (field.name, index);
        let place = if field.repeated { format!("[{index}]") } else { String::new() };
        let prefix = format!("{}{}{place}.", self.prefix, field.name);
        self.out.extend(numbers_of(value, &prefix, self.keep));
    }
}

/// Name and both values of the first number that differs in any bit.
pub(crate) fn first_difference(old: &[Named], new: &[Named]) -> Option<(String, String, String)> {
    let mut pairs = old.iter().zip(new);
    let ((field, old), (_, new)) = pairs.find(|((_, old), (_, new))| !old.is_same(*new))?;
    Some((field.clone(), old.to_string(), new.to_string()))
}

/// Every number of a packed state: counts, output sequences, latches and memory. The stamps and the
/// generation of a latched sample are those of whichever copy arrived, and are left out.
pub(super) fn numbers_of_state<S: Service>(state: &[u8]) -> Vec<Named> {
    let (head, rest) = state.split_at(StateHeader::PACKED_SIZE);
    let (sequences, rest) = rest.split_at(8 * <S::Outputs as runtime::OutputSet>::COUNT);
    let (latches, memory) = rest.split_at(<S::Inputs as runtime::InputSet>::LATCH_SIZE);
    let mut out = numbers_of(&StateHeader::unpack(head), "header.", &[]);
    for (index, sequence) in sequences.chunks_exact(8).enumerate() {
        out.push((format!("output_sequence[{index}]"), Number::Integer(u64::unpack(sequence))));
    }
    let mut inputs = S::Inputs::default();
    inputs.unpack_latches(latches);
    let Ok(()) = inputs.visit(&mut Latches(&mut out));
    out.extend(numbers_of(&S::Memory::unpack(memory), "memory.", &["owner"]));
    out
}

struct Latches<'a>(&'a mut Vec<Named>);

impl InputVisitor for Latches<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let prefix = format!("latch.{}.", topic.info.name);
        let present = u64::from(input.latest().is_some());
        self.0.push((format!("{prefix}present"), Number::Integer(present)));
        if let Some(latest) = input.latest() {
            self.0.extend(numbers_of(latest, &prefix, &[]));
        }
        Ok(())
    }
}
