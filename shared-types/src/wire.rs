//! What a reader needs to know about a sample's bytes: names, kinds, offsets, and a hash of them.
//!
//! [`sample!`](crate::sample) declares a struct once and derives from it the shared-memory layout,
//! the reflection used by the recorder and the packed form used for published states.

mod scalar;

pub use scalar::{fill_widened, narrow, visit_widened};

use bytemuck::Pod;

/// The kind of one field, as a reader sees it.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    /// IEEE 754 double.
    F64,
    /// Unsigned 64-bit integer.
    U64,
    /// Unsigned 32-bit integer.
    U32,
    /// One byte.
    U8,
    /// Signed 8-bit integer.
    I8,
    /// A named 32-bit code.
    Enum(&'static EnumSchema),
    /// A nested struct.
    Message(&'static Schema),
}

/// What a field shows about a flight. The hashes of a flight, and whatever compares two flights, go by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldClass {
    /// What happened.
    Flight,
    /// Which process commanded: `#[identity]`. A swap between equal controllers changes nothing else.
    Identity,
    /// When the machine let it happen, and what it interrupted: `#[machine]`. Two runs of one flight differ in it.
    Machine,
    /// The name of a topic, padded with zeros: `#[topic]`. In a hash the topic's number stands for it.
    Topic,
    /// Nothing: `#[padding]`. It keeps the size a multiple of eight bytes, and is not recorded.
    Padding,
}

impl FieldClass {
    /// Of the attributes of a field's declaration.
    ///
    /// # Panics
    /// In the compiler, if an attribute is another one, or if there are two.
    #[must_use]
    pub const fn of(attributes: &[&str]) -> Self {
        let (mut class, mut marks) = (Self::Flight, 0);
        let mut i = 0;
        while i < attributes.len() {
            let attribute = attributes[i].as_bytes();
            i += 1;
            class = match attribute {
                b"doc" => continue,
                b"identity" => Self::Identity,
                b"machine" => Self::Machine,
                b"topic" => Self::Topic,
                b"padding" => Self::Padding,
                _ => panic!("marks of a field: #[identity], #[machine], #[topic], #[padding]"),
            };
            marks += 1;
        }
        assert!(marks < 2, "a field has one mark");
        class
    }
}

/// One field of a [`Schema`].
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Field name, unit included.
    pub name: &'static str,
    /// What it shows about a flight.
    pub class: FieldClass,
    /// Kind of the value, or of each element.
    pub kind: Kind,
    /// Number of elements; 1 for a scalar.
    pub count: usize,
    /// True if the field is an array.
    pub repeated: bool,
    /// Byte offset within the struct.
    pub offset: usize,
    /// Bytes of each element in packed form.
    pub packed_size: usize,
}

/// The layout of one struct.
#[derive(Debug, Clone, Copy)]
pub struct Schema {
    /// Type name.
    pub name: &'static str,
    /// Fields in declaration order.
    pub fields: &'static [Field],
    /// Size in bytes.
    pub size: usize,
    /// Hash of name, fields, kinds, counts, offsets and size, nested types included.
    pub layout_hash: u64,
}

impl Schema {
    /// True if every double of a packed value is a finite number, those of nested structs too.
    #[must_use]
    pub fn is_finite(&self, packed: &[u8]) -> bool {
        let mut rest = packed;
        self.fields.iter().all(|field| {
            let (run, after) = rest.split_at(rest.len().min(field.count * field.packed_size));
            rest = after;
            match field.kind {
                Kind::F64 => {
                    run.chunks_exact(f64::PACKED_SIZE).all(|bytes| f64::unpack(bytes).is_finite())
                }
                Kind::Message(schema) => {
                    run.chunks_exact(field.packed_size).all(|bytes| schema.is_finite(bytes))
                }
                Kind::U64 | Kind::U32 | Kind::U8 | Kind::I8 | Kind::Enum(_) => true,
            }
        })
    }
}

/// The values of a named code.
#[derive(Debug, Clone, Copy)]
pub struct EnumSchema {
    /// Type name.
    pub name: &'static str,
    /// Variant names and their codes.
    pub variants: &'static [(&'static str, u32)],
}

/// FNV-1a over bytes, usable in constants.
#[must_use]
pub const fn hash_bytes(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    // A separator keeps ("ab", "c") apart from ("a", "bc").
    (hash ^ 0xff).wrapping_mul(0x0000_0100_0000_01b3)
}

/// Start value of [`hash_bytes`].
pub const HASH_SEED: u64 = 0xcbf2_9ce4_8422_2325;

const fn hash_kind(hash: u64, kind: Kind) -> u64 {
    match kind {
        Kind::F64 => hash_bytes(hash, b"f64"),
        Kind::U64 => hash_bytes(hash, b"u64"),
        Kind::U32 => hash_bytes(hash, b"u32"),
        Kind::U8 => hash_bytes(hash, b"u8"),
        Kind::I8 => hash_bytes(hash, b"i8"),
        Kind::Enum(schema) => {
            let mut hash = hash_bytes(hash, schema.name.as_bytes());
            let mut i = 0;
            while i < schema.variants.len() {
                hash = hash_bytes(hash, schema.variants[i].0.as_bytes());
                hash = hash_bytes(hash, &schema.variants[i].1.to_le_bytes());
                i += 1;
            }
            hash
        }
        Kind::Message(schema) => hash_bytes(hash, &schema.layout_hash.to_le_bytes()),
    }
}

/// Layout hash of a struct.
#[must_use]
pub const fn layout_hash(name: &str, fields: &[Field], size: usize) -> u64 {
    let mut hash = hash_bytes(HASH_SEED, name.as_bytes());
    let mut i = 0;
    while i < fields.len() {
        let field = &fields[i];
        hash = hash_bytes(hash, field.name.as_bytes());
        hash = hash_kind(hash, field.kind);
        hash = hash_bytes(hash, &(field.count as u64).to_le_bytes());
        hash = hash_bytes(hash, &(field.offset as u64).to_le_bytes());
        i += 1;
    }
    hash_bytes(hash, &(size as u64).to_le_bytes())
}

/// Walks the fields of a value in declaration order.
pub trait Visitor {
    /// Doubles.
    fn f64s(&mut self, field: &'static Field, values: &[f64]);
    /// Unsigned integers and codes, widened.
    fn u64s(&mut self, field: &'static Field, values: &[u64]);
    /// Bytes.
    fn bytes(&mut self, field: &'static Field, values: &[u8]);
    /// One nested struct; called once per element of an array.
    fn message<T: Wire>(&mut self, field: &'static Field, value: &T);
}

/// Fills the fields of a value in declaration order: the counterpart of [`Visitor`].
pub trait Filler {
    /// Why a field cannot be filled.
    type Error;
    /// Doubles.
    ///
    /// # Errors
    /// The field has no such value; so for the others.
    fn f64s(&mut self, field: &'static Field, values: &mut [f64]) -> Result<(), Self::Error>;
    /// Unsigned integers and codes, widened; those of a field of 32 bits must fit into them.
    ///
    /// # Errors
    /// As [`Filler::f64s`].
    fn u64s(&mut self, field: &'static Field, values: &mut [u64]) -> Result<(), Self::Error>;
    /// Bytes.
    ///
    /// # Errors
    /// As [`Filler::f64s`].
    fn bytes(&mut self, field: &'static Field, values: &mut [u8]) -> Result<(), Self::Error>;
    /// One nested struct; called once per element of an array.
    ///
    /// # Errors
    /// As [`Filler::f64s`].
    fn message<T: Wire>(&mut self, field: &'static Field, value: &mut T)
    -> Result<(), Self::Error>;
}

/// A value that can be a field of a sample.
pub trait Value: Copy + core::fmt::Debug + 'static {
    /// Kind of the innermost element.
    const KIND: Kind;
    /// Number of innermost elements.
    const COUNT: usize = 1;
    /// True for arrays.
    const REPEATED: bool = false;
    /// Bytes in packed form.
    const PACKED_SIZE: usize;

    /// Shows a run of values to a visitor.
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V);
    /// Has a run of values filled.
    ///
    /// # Errors
    /// The filler's.
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error>;
    /// Writes the packed little-endian form; `out` holds exactly [`Value::PACKED_SIZE`] bytes.
    fn pack(&self, out: &mut [u8]);
    /// Reads the packed form back.
    fn unpack(from: &[u8]) -> Self;
}

/// A struct declared with [`sample!`](crate::sample).
pub trait Wire: Value + Default {
    /// Its layout.
    const SCHEMA: Schema;
    /// Shows each field to a visitor.
    fn visit<V: Visitor>(&self, visitor: &mut V);
    /// Has each field filled.
    ///
    /// # Errors
    /// The filler's first.
    fn fill<F: Filler>(&mut self, filler: &mut F) -> Result<(), F::Error>;
}

/// A struct whose bytes lie in memory that processes share: declared with [`sample!`](crate::sample).
pub trait Shared: Wire + Pod {}

impl<T: Wire + Pod> Shared for T {}

impl<T: Value, const N: usize> Value for [T; N] {
    const KIND: Kind = T::KIND;
    const COUNT: usize = T::COUNT * N;
    const REPEATED: bool = true;
    const PACKED_SIZE: usize = T::PACKED_SIZE * N;
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V) {
        T::visit_run(values.as_flattened(), field, visitor);
    }
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error> {
        T::fill_run(values.as_flattened_mut(), field, filler)
    }
    fn pack(&self, out: &mut [u8]) {
        for (value, slot) in self.iter().zip(out.chunks_exact_mut(T::PACKED_SIZE)) {
            value.pack(slot);
        }
    }
    fn unpack(from: &[u8]) -> Self {
        core::array::from_fn(|i| T::unpack(&from[i * T::PACKED_SIZE..(i + 1) * T::PACKED_SIZE]))
    }
}

#[cfg(test)]
mod tests {
    use super::{Value as _, Wire as _};

    crate::memory! {
        struct Inner {
            count: u32,
            rates_rad_s: [f64; 2],
            primed: bool,
        }
    }

    crate::memory! {
        struct Outer {
            before: u64,
            inner: [Inner; 2],
            after_s: f64,
        }
    }

    #[test]
    fn each_double_of_a_packed_value_must_be_finite_and_nothing_else() {
        let whole = Outer { before: u64::MAX, ..Outer::default() };
        for index in 0..=5 {
            for number in [0.0, f64::MAX, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut value = whole;
                match index {
                    0..=3 => value.inner[index / 2].rates_rad_s[index % 2] = number,
                    4 => value.after_s = number,
                    _ => value.before = number.to_bits(),
                }
                let mut packed = [0; Outer::PACKED_SIZE];
                value.pack(&mut packed);
                let expected = number.is_finite() || index == 5;
                assert_eq!(Outer::SCHEMA.is_finite(&packed), expected, "{index}: {number}");
            }
        }
    }
}
