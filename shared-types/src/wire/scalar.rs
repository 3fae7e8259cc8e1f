//! Numbers as fields: shown, filled, packed.

use super::{Field, Filler, Kind, Value, Visitor};

impl Value for f64 {
    const KIND: Kind = Kind::F64;
    const PACKED_SIZE: usize = 8;
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V) {
        visitor.f64s(field, values);
    }
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error> {
        filler.f64s(field, values)
    }
    #[inline]
    fn pack(&self, out: &mut [u8]) {
        out.copy_from_slice(&self.to_le_bytes());
    }
    #[inline]
    fn unpack(from: &[u8]) -> Self {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(from);
        Self::from_le_bytes(bytes)
    }
}

impl Value for u64 {
    const KIND: Kind = Kind::U64;
    const PACKED_SIZE: usize = 8;
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V) {
        visitor.u64s(field, values);
    }
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error> {
        filler.u64s(field, values)
    }
    #[inline]
    fn pack(&self, out: &mut [u8]) {
        out.copy_from_slice(&self.to_le_bytes());
    }
    #[inline]
    fn unpack(from: &[u8]) -> Self {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(from);
        Self::from_le_bytes(bytes)
    }
}

/// Shows a run of at most 512 small integers, widened on the stack.
pub fn visit_widened<T: Copy + Into<u64>, V: Visitor>(
    values: &[T],
    field: &'static Field,
    visitor: &mut V,
) {
    if let [one] = values {
        return visitor.u64s(field, &[(*one).into()]);
    }
    let mut wide = [0_u64; 512];
    let count = values.len().min(wide.len());
    for (slot, value) in wide.iter_mut().zip(values) {
        *slot = (*value).into();
    }
    visitor.u64s(field, &wide[..count]);
}

/// Has a run of at most 512 small integers filled, widened on the stack.
///
/// # Errors
/// The filler's.
pub fn fill_widened<T, F: Filler>(
    values: &mut [T],
    field: &'static Field,
    filler: &mut F,
    narrow: impl Fn(u64) -> T,
) -> Result<(), F::Error> {
    let mut wide = [0_u64; 512];
    let count = values.len().min(wide.len());
    filler.u64s(field, &mut wide[..count])?;
    for (value, wide) in values.iter_mut().zip(wide) {
        *value = narrow(wide);
    }
    Ok(())
}

/// The low half; a filler has made sure that nothing is lost.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "see above")]
pub const fn narrow(wide: u64) -> u32 {
    wide as u32
}

impl Value for u32 {
    const KIND: Kind = Kind::U32;
    const PACKED_SIZE: usize = 4;
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V) {
        visit_widened(values, field, visitor);
    }
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error> {
        fill_widened(values, field, filler, narrow)
    }
    #[inline]
    fn pack(&self, out: &mut [u8]) {
        out.copy_from_slice(&self.to_le_bytes());
    }
    #[inline]
    fn unpack(from: &[u8]) -> Self {
        let mut bytes = [0; 4];
        bytes.copy_from_slice(from);
        Self::from_le_bytes(bytes)
    }
}

impl Value for bool {
    const KIND: Kind = Kind::U32;
    const PACKED_SIZE: usize = 1;
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V) {
        visit_widened(values, field, visitor);
    }
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error> {
        fill_widened(values, field, filler, |wide| wide != 0)
    }
    #[inline]
    fn pack(&self, out: &mut [u8]) {
        out[0] = u8::from(*self);
    }
    #[inline]
    fn unpack(from: &[u8]) -> Self {
        from[0] != 0
    }
}

impl Value for u8 {
    const KIND: Kind = Kind::U8;
    const PACKED_SIZE: usize = 1;
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V) {
        visitor.bytes(field, values);
    }
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error> {
        filler.bytes(field, values)
    }
    #[inline]
    fn pack(&self, out: &mut [u8]) {
        out[0] = *self;
    }
    #[inline]
    fn unpack(from: &[u8]) -> Self {
        from[0]
    }
}

impl Value for i8 {
    const KIND: Kind = Kind::I8;
    const PACKED_SIZE: usize = 1;
    fn visit_run<V: Visitor>(values: &[Self], field: &'static Field, visitor: &mut V) {
        let mut bytes = [0_u8; 512];
        let count = values.len().min(bytes.len());
        for (slot, value) in bytes.iter_mut().zip(values) {
            *slot = value.cast_unsigned();
        }
        visitor.bytes(field, &bytes[..count]);
    }
    fn fill_run<F: Filler>(
        values: &mut [Self],
        field: &'static Field,
        filler: &mut F,
    ) -> Result<(), F::Error> {
        let mut bytes = [0_u8; 512];
        let count = values.len().min(bytes.len());
        filler.bytes(field, &mut bytes[..count])?;
        for (value, byte) in values.iter_mut().zip(bytes) {
            *value = byte.cast_signed();
        }
        Ok(())
    }
    #[inline]
    fn pack(&self, out: &mut [u8]) {
        out[0] = self.cast_unsigned();
    }
    #[inline]
    fn unpack(from: &[u8]) -> Self {
        from[0].cast_signed()
    }
}
