//! Protobuf wire bytes of a sample, written field by field while visiting it.
//!
//! Every field is written, zeros included, in the order of its number: the same sample always gives
//! the same bytes.

use prost::encoding::{WireType, double, encode_key, encode_varint, encoded_len_varint, uint64};
use shared_types::wire::{Field, FieldClass, Kind, Visitor, Wire};

/// Appends the protobuf form of `value` to `out`; numbering as in `schema.rs`.
pub fn encode<T: Wire>(value: &T, out: &mut Vec<u8>) {
    value.visit(&mut Encoder { out, fields: T::SCHEMA.fields, at: 0 });
}

/// Appends `value` as the nested message with number `number`.
pub(super) fn encode_nested<T: Wire>(number: u32, value: &T, out: &mut Vec<u8>) {
    encode_key(number, WireType::LengthDelimited, out);
    let length_at = out.len();
    // Most nested messages are shorter than 128 bytes, whose length is one byte.
    out.push(0);
    encode(value, out);
    let length = out.len() - length_at - 1;
    let extra = encoded_len_varint(length as u64) - 1;
    if extra > 0 {
        out.resize(out.len() + extra, 0);
        out.copy_within(length_at + 1..length_at + 1 + length, length_at + 1 + extra);
    }
    encode_varint(length as u64, &mut &mut out[length_at..=length_at + extra]);
}

struct Encoder<'a> {
    out: &'a mut Vec<u8>,
    fields: &'static [Field],
    /// Index of the field visited last; fields come in declaration order.
    at: usize,
}

impl Encoder<'_> {
    /// Number of a field; `None` for padding. Fields are distinguished by their offset, because a constant may have
    /// several addresses.
    fn number(&mut self, field: &Field) -> Option<u32> {
        while self.fields.get(self.at).is_some_and(|f| f.offset != field.offset) {
            self.at += 1;
        }
        debug_assert!(self.at < self.fields.len(), "{} is not in the schema", field.name);
        if field.class == FieldClass::Padding { None } else { u32::try_from(self.at + 1).ok() }
    }
}

/// Codes are `int32` on the wire: beyond its range they turn negative, i.e. ten bytes long.
fn code_varint(code: u64) -> u64 {
    #[expect(clippy::cast_possible_truncation, reason = "codes are 32 bits wide, widened to visit")]
    let code = code as u32;
    i64::from(code.cast_signed()).cast_unsigned()
}

impl Visitor for Encoder<'_> {
    fn f64s(&mut self, field: &'static Field, values: &[f64]) {
        let Some(number) = self.number(field) else { return };
        match values {
            [value] if !field.repeated => double::encode(number, value, self.out),
            _ => double::encode_packed(number, values, self.out),
        }
    }

    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        let Some(number) = self.number(field) else { return };
        let is_code = matches!(field.kind, Kind::Enum(_));
        let wire = |value: u64| if is_code { code_varint(value) } else { value };
        match values {
            // `uint32` and `uint64` share their wire form.
            [value] if !field.repeated => uint64::encode(number, &wire(*value), self.out),
            _ if !is_code => uint64::encode_packed(number, values, self.out),
            _ => {
                encode_key(number, WireType::LengthDelimited, self.out);
                let length: usize = values.iter().map(|v| encoded_len_varint(wire(*v))).sum();
                encode_varint(length as u64, self.out);
                for value in values {
                    encode_varint(wire(*value), self.out);
                }
            }
        }
    }

    fn bytes(&mut self, field: &'static Field, values: &[u8]) {
        let Some(number) = self.number(field) else { return };
        encode_bytes(number, values, self.out);
    }

    fn message<T: Wire>(&mut self, field: &'static Field, value: &T) {
        let Some(number) = self.number(field) else { return };
        encode_nested(number, value, self.out);
    }
}

/// Appends a length-delimited run of bytes.
pub(super) fn encode_bytes(number: u32, values: &[u8], out: &mut Vec<u8>) {
    encode_key(number, WireType::LengthDelimited, out);
    encode_varint(values.len() as u64, out);
    out.extend_from_slice(values);
}
