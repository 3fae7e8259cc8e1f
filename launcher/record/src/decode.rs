//! Protobuf wire bytes back to a sample: the counterpart of `encode.rs`, and as strict as that is
//! regular. Every field is there, in the order of its number, and nothing else.

use prost::encoding::{WireType, decode_key, decode_varint};
use shared_types::wire::{Field, FieldClass, Filler, Kind, Wire};
use thiserror::Error;

/// Bytes that are no message of their type.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{type_name}.{field}: {what}")]
pub struct DecodeError {
    /// Type of the message.
    pub type_name: &'static str,
    /// Field at which it cannot be read on; the last one if bytes are left over.
    pub field: &'static str,
    /// What is wrong.
    pub what: &'static str,
}

/// Reads the protobuf form of `T`; padding comes back as zeros.
///
/// # Errors
/// The first field that is missing, out of order, of another kind or out of range.
pub fn decode<T: Wire>(bytes: &[u8]) -> Result<T, DecodeError> {
    let schema = T::SCHEMA;
    let mut value = T::default();
    let mut decoder = Decoder { bytes, type_name: schema.name, fields: schema.fields, at: 0 };
    value.fill(&mut decoder)?;
    if decoder.bytes.is_empty() { Ok(value) } else { Err(decoder.error("bytes are left over")) }
}

struct Decoder<'a> {
    /// What has not been read yet.
    bytes: &'a [u8],
    type_name: &'static str,
    fields: &'static [Field],
    /// Index of the field asked for last; fields come in declaration order.
    at: usize,
}

impl<'a> Decoder<'a> {
    fn error(&self, what: &'static str) -> DecodeError {
        let field = self.fields.get(self.at).map_or("", |field| field.name);
        DecodeError { type_name: self.type_name, field, what }
    }

    /// Reads the key of `field`; false for padding, which is not there.
    fn key(&mut self, field: &Field, expected: WireType) -> Result<bool, DecodeError> {
        while self.fields.get(self.at).is_some_and(|f| f.offset != field.offset) {
            self.at += 1;
        }
        if field.class == FieldClass::Padding {
            return Ok(false);
        }
        let (number, kind) =
            decode_key(&mut self.bytes).map_err(|_| self.error("the message ends before it"))?;
        if number as usize != self.at + 1 {
            return Err(self.error("another field is in its place"));
        }
        if kind == expected { Ok(true) } else { Err(self.error("has another kind")) }
    }

    fn varint(&mut self) -> Result<u64, DecodeError> {
        decode_varint(&mut self.bytes).map_err(|_| self.error("a number is cut"))
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], DecodeError> {
        let (head, rest) = self
            .bytes
            .split_at_checked(length)
            .ok_or_else(|| self.error("the message ends in it"))?;
        self.bytes = rest;
        Ok(head)
    }

    /// The content of a length-delimited field.
    fn delimited(&mut self) -> Result<&'a [u8], DecodeError> {
        let length = self.varint()?;
        let length = usize::try_from(length).map_err(|_| self.error("is too long"))?;
        self.take(length)
    }

    fn double(&mut self) -> Result<f64, DecodeError> {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(self.take(8)?);
        Ok(f64::from_le_bytes(bytes))
    }

    fn integer(&mut self, kind: Kind) -> Result<u64, DecodeError> {
        let raw = self.varint()?;
        let fits = match kind {
            // Codes are `int32` on the wire.
            Kind::Enum(_) => {
                i32::try_from(raw.cast_signed()).ok().map(|c| c.cast_unsigned().into())
            }
            Kind::U32 => u32::try_from(raw).ok().map(u64::from),
            _ => Some(raw),
        };
        fits.ok_or_else(|| self.error("is out of range"))
    }

    /// One number, or several packed into a length-delimited field.
    fn numbers<N>(
        &mut self,
        field: &Field,
        single: WireType,
        values: &mut [N],
        one: impl Fn(&mut Self) -> Result<N, DecodeError>,
    ) -> Result<(), DecodeError> {
        let kind = if field.repeated { WireType::LengthDelimited } else { single };
        if !self.key(field, kind)? {
            return Ok(());
        }
        let mut read = |decoder: &mut Self| {
            values.iter_mut().try_for_each(|value| {
                *value = one(decoder)?;
                Ok(())
            })
        };
        if field.repeated { self.within(read) } else { read(self) }
    }

    /// Runs `read` over the content of a length-delimited field, all of which it must use.
    fn within(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<(), DecodeError>,
    ) -> Result<(), DecodeError> {
        let content = self.delimited()?;
        let rest = core::mem::replace(&mut self.bytes, content);
        read(self)?;
        let left_over = core::mem::replace(&mut self.bytes, rest);
        if left_over.is_empty() { Ok(()) } else { Err(self.error("has more elements")) }
    }
}

impl Filler for Decoder<'_> {
    type Error = DecodeError;

    fn f64s(&mut self, field: &'static Field, values: &mut [f64]) -> Result<(), DecodeError> {
        self.numbers(field, WireType::SixtyFourBit, values, Self::double)
    }

    fn u64s(&mut self, field: &'static Field, values: &mut [u64]) -> Result<(), DecodeError> {
        self.numbers(field, WireType::Varint, values, |decoder| decoder.integer(field.kind))
    }

    fn bytes(&mut self, field: &'static Field, values: &mut [u8]) -> Result<(), DecodeError> {
        if !self.key(field, WireType::LengthDelimited)? {
            return Ok(());
        }
        let content = self.delimited()?;
        if content.len() != values.len() {
            return Err(self.error("has another length"));
        }
        values.copy_from_slice(content);
        Ok(())
    }

    fn message<T: Wire>(
        &mut self,
        field: &'static Field,
        value: &mut T,
    ) -> Result<(), DecodeError> {
        if self.key(field, WireType::LengthDelimited)? {
            *value = decode(self.delimited()?)?;
        }
        Ok(())
    }
}

/// Reads a message that is no sample, field by field.
pub(super) struct Fields<'a> {
    bytes: &'a [u8],
    type_name: &'static str,
}

impl<'a> Fields<'a> {
    pub(super) fn new(type_name: &'static str, bytes: &'a [u8]) -> Self {
        Self { bytes, type_name }
    }

    pub(super) fn varint(&mut self, number: u32, field: &'static str) -> Result<u64, DecodeError> {
        self.key(number, field, WireType::Varint)?;
        decode_varint(&mut self.bytes).map_err(|_| self.error(field, "is cut"))
    }

    pub(super) fn delimited(
        &mut self,
        number: u32,
        field: &'static str,
    ) -> Result<&'a [u8], DecodeError> {
        self.key(number, field, WireType::LengthDelimited)?;
        let length = decode_varint(&mut self.bytes).ok().and_then(|l| usize::try_from(l).ok());
        let split = length.and_then(|length| self.bytes.split_at_checked(length));
        let (content, rest) = split.ok_or_else(|| self.error(field, "is cut"))?;
        self.bytes = rest;
        Ok(content)
    }

    /// After the last field: nothing may be left.
    pub(super) fn finish(self, last: &'static str) -> Result<(), DecodeError> {
        if self.bytes.is_empty() { Ok(()) } else { Err(self.error(last, "bytes are left over")) }
    }

    fn key(&mut self, number: u32, field: &'static str, kind: WireType) -> Result<(), DecodeError> {
        let found = decode_key(&mut self.bytes).ok();
        let expected = found == Some((number, kind));
        if expected { Ok(()) } else { Err(self.error(field, "is not in its place")) }
    }

    fn error(&self, field: &'static str, what: &'static str) -> DecodeError {
        DecodeError { type_name: self.type_name, field, what }
    }
}
