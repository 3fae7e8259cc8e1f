//! How samples, codes and memories are declared: the struct once, the rest derived.

/// Declares a fixed-layout struct that may live in shared memory, with its reflection. A field may be marked
/// `#[identity]`, `#[machine]`, `#[topic]` or `#[padding]`, see [`FieldClass`](crate::wire::FieldClass).
///
/// It has no byte between its fields, and any bytes of its size are a value of it; the compiler refuses others. So a
/// process may send its bytes as they lie in memory and read them where another one has put them.
#[macro_export]
macro_rules! sample {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$attribute:ident $(= $doc:literal)?])* pub $field:ident : $kind:ty),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(
            Debug,
            Clone,
            Copy,
            $crate::bytemuck::Pod,
            $crate::bytemuck::Zeroable,
        )]
        #[bytemuck(crate = "::shared_types::bytemuck")]
        #[repr(C)]
        pub struct $name { $($($(#[doc = $doc])?)* pub $field: $kind),+ }

        $crate::reflect!($name { $([$($attribute)*] $field: $kind),+ });
    };
}

/// Declares a struct that is published in packed form as part of a service's state: reflection
/// and packing, without a place of its own in shared memory. Fields may be private.
#[macro_export]
macro_rules! memory {
    ($(#[$meta:meta])* $vis:vis struct $name:ident {
        $($(#[$attribute:ident $(= $doc:literal)?])* $field_vis:vis $field:ident : $kind:ty),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy)]
        #[repr(C)]
        $vis struct $name { $($($(#[doc = $doc])?)* $field_vis $field: $kind),+ }

        $crate::reflect!($name { $([$($attribute)*] $field: $kind),+ });
    };
}

/// Reflection, packing and an all-zero `Default` for a `repr(C)` struct; used by
/// [`sample!`](crate::sample) and [`memory!`](crate::memory).
#[macro_export]
macro_rules! reflect {
    ($name:ident { $([$($attribute:ident)*] $field:ident : $kind:ty),+ }) => {
        impl $name {
            const FIELDS: &'static [$crate::wire::Field] = &[$($crate::wire::Field {
                name: stringify!($field),
                class: $crate::wire::FieldClass::of(&[$(stringify!($attribute)),*]),
                kind: <$kind as $crate::wire::Value>::KIND,
                count: <$kind as $crate::wire::Value>::COUNT,
                repeated: <$kind as $crate::wire::Value>::REPEATED,
                offset: core::mem::offset_of!($name, $field),
                packed_size: <$kind as $crate::wire::Value>::PACKED_SIZE
                    / <$kind as $crate::wire::Value>::COUNT,
            }),+];
        }

        impl $crate::wire::Wire for $name {
            const SCHEMA: $crate::wire::Schema = $crate::wire::Schema {
                name: stringify!($name),
                fields: Self::FIELDS,
                size: core::mem::size_of::<$name>(),
                layout_hash: $crate::wire::layout_hash(
                    stringify!($name), Self::FIELDS, core::mem::size_of::<$name>()),
            };
            fn visit<V: $crate::wire::Visitor>(&self, visitor: &mut V) {
                let mut fields = Self::FIELDS.iter();
                $(if let Some(field) = fields.next() {
                    <$kind as $crate::wire::Value>::visit_run(
                        core::slice::from_ref(&self.$field), field, visitor);
                })+
            }
            fn fill<F: $crate::wire::Filler>(&mut self, filler: &mut F) -> Result<(), F::Error> {
                let mut fields = Self::FIELDS.iter();
                $(if let Some(field) = fields.next() {
                    <$kind as $crate::wire::Value>::fill_run(
                        core::slice::from_mut(&mut self.$field), field, filler)?;
                })+
                Ok(())
            }
        }

        impl $crate::wire::Value for $name {
            const KIND: $crate::wire::Kind =
                $crate::wire::Kind::Message(&<$name as $crate::wire::Wire>::SCHEMA);
            const PACKED_SIZE: usize = 0 $(+ <$kind as $crate::wire::Value>::PACKED_SIZE)+;
            fn visit_run<V: $crate::wire::Visitor>(
                values: &[Self], field: &'static $crate::wire::Field, visitor: &mut V,
            ) {
                for value in values {
                    visitor.message(field, value);
                }
            }
            fn fill_run<F: $crate::wire::Filler>(
                values: &mut [Self], field: &'static $crate::wire::Field, filler: &mut F,
            ) -> Result<(), F::Error> {
                for value in values {
                    filler.message(field, value)?;
                }
                Ok(())
            }
            fn pack(&self, out: &mut [u8]) {
                let rest = out;
                $(let (head, rest) =
                    rest.split_at_mut(<$kind as $crate::wire::Value>::PACKED_SIZE);
                <$kind as $crate::wire::Value>::pack(&self.$field, head);)+
                debug_assert!(rest.is_empty());
            }
            fn unpack(from: &[u8]) -> Self {
                let rest = from;
                $(let (head, rest) = rest.split_at(<$kind as $crate::wire::Value>::PACKED_SIZE);
                let $field = <$kind as $crate::wire::Value>::unpack(head);)+
                debug_assert!(rest.is_empty());
                Self { $($field),+ }
            }
        }

        impl Default for $name {
            fn default() -> Self {
                <Self as $crate::wire::Value>::unpack(
                    &[0; <Self as $crate::wire::Value>::PACKED_SIZE])
            }
        }
    };
}

/// Declares a named 32-bit code. Any bit pattern is a valid value, so a foreign writer cannot
/// cause undefined behaviour; unknown codes show as their number.
#[macro_export]
macro_rules! code {
    ($(#[$meta:meta])* pub enum $name:ident {
        $($(#[$variant_meta:meta])* $variant:ident = $value:literal),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(
            Clone,
            Copy,
            PartialEq,
            Eq,
            PartialOrd,
            Ord,
            Hash,
            Default,
            $crate::bytemuck::Pod,
            $crate::bytemuck::Zeroable,
        )]
        #[bytemuck(crate = "::shared_types::bytemuck")]
        #[repr(C)]
        pub struct $name(pub u32);

        #[allow(non_upper_case_globals, reason = "the constants stand for enum variants")]
        impl $name {
            $($(#[$variant_meta])* pub const $variant: Self = Self($value);)+
            const VARIANTS: &'static [(&'static str, u32)] = &[$((stringify!($variant), $value)),+];

            /// Name of the code, if it is a known one.
            #[must_use]
            pub fn name(self) -> Option<&'static str> {
                Self::VARIANTS.iter().find(|(_, code)| *code == self.0).map(|(name, _)| *name)
            }
        }

        impl core::fmt::Debug for $name {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                match self.name() {
                    Some(name) => f.write_str(name),
                    None => write!(f, concat!(stringify!($name), "({})"), self.0),
                }
            }
        }

        impl From<$name> for u64 {
            fn from(code: $name) -> Self {
                Self::from(code.0)
            }
        }

        impl $crate::wire::Value for $name {
            const KIND: $crate::wire::Kind =
                $crate::wire::Kind::Enum(&$crate::wire::EnumSchema {
                    name: stringify!($name),
                    variants: Self::VARIANTS,
                });
            const PACKED_SIZE: usize = 4;
            fn visit_run<V: $crate::wire::Visitor>(
                values: &[Self], field: &'static $crate::wire::Field, visitor: &mut V,
            ) {
                $crate::wire::visit_widened(values, field, visitor);
            }
            fn fill_run<F: $crate::wire::Filler>(
                values: &mut [Self], field: &'static $crate::wire::Field, filler: &mut F,
            ) -> Result<(), F::Error> {
                $crate::wire::fill_widened(
                    values, field, filler, |wide| Self($crate::wire::narrow(wide)))
            }
            fn pack(&self, out: &mut [u8]) {
                self.0.pack(out);
            }
            fn unpack(from: &[u8]) -> Self {
                Self(u32::unpack(from))
            }
        }
    };
}
