//! Every field of every topic, through bytes and an independent protobuf reader and back.

use proptest::prelude::{
    ProptestConfig, any, prop_assert, prop_assert_eq, prop_assert_ne, proptest,
};
use proptest::test_runner::TestCaseError;
use prost_reflect::{DescriptorPool, DynamicMessage, Value as Read};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use record::{decode, descriptor_set, encode, full_name};
use shared_types::topics::visit_all;
use shared_types::wire::{Field, FieldClass, Kind, Schema, Value as _, Visitor, Wire};
use shared_types::{Imu, Sample, Topic, TopicVisitor};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::convert::Infallible;

/// Compares a value with what the reader made of its bytes.
struct Compare<'a> {
    read: &'a DynamicMessage,
    elements_seen: BTreeMap<&'static str, usize>,
    compared: usize,
}

impl Compare<'_> {
    fn field(&self, field: &Field) -> Cow<'_, Read> {
        let found = self.read.get_field_by_name(field.name);
        found.unwrap_or_else(|| panic!("{} is missing", field.name))
    }

    fn numbers(&mut self, field: &'static Field, expected: &[Read]) {
        if field.class == FieldClass::Padding {
            assert!(self.read.get_field_by_name(field.name).is_none());
            return;
        }
        let read = self.field(field);
        let read = if field.repeated { read.as_list().unwrap() } else { &[read.into_owned()] };
        // Bit patterns, because random doubles include NaN.
        let bits = |value: &Read| match value {
            Read::F64(number) => Read::U64(number.to_bits()),
            other => other.clone(),
        };
        assert!(read.iter().map(bits).eq(expected.iter().map(bits)), "{}", field.name);
        self.compared += expected.len();
    }
}

impl Visitor for Compare<'_> {
    fn f64s(&mut self, field: &'static Field, values: &[f64]) {
        self.numbers(field, &values.iter().map(|v| Read::F64(*v)).collect::<Vec<_>>());
    }

    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        let narrow = |value: u64| u32::try_from(value).unwrap();
        let expected = values.iter().map(|&value| match field.kind {
            // Any bit of it makes a flag true.
            Kind::Enum(code) if code.name == "Flag" => Read::Bool(value != 0),
            Kind::Enum(_) => Read::EnumNumber(narrow(value).cast_signed()),
            Kind::U32 => Read::U32(narrow(value)),
            _ => Read::U64(value),
        });
        self.numbers(field, &expected.collect::<Vec<_>>());
    }

    fn bytes(&mut self, field: &'static Field, values: &[u8]) {
        assert_eq!(&self.field(field).as_bytes().unwrap()[..], values);
        self.compared += values.len();
    }

    fn message<T: Wire>(&mut self, field: &'static Field, value: &T) {
        let read = self.field(field).into_owned();
        let index = self.elements_seen.entry(field.name).or_default();
        let nested = if field.repeated { &read.as_list().unwrap()[*index] } else { &read };
        *index += 1;
        self.compared += compare(value, nested.as_message().unwrap());
    }
}

/// Panics at the first difference; else returns how many numbers agree.
fn compare<T: Wire>(value: &T, read: &DynamicMessage) -> usize {
    assert_eq!(read.unknown_fields().count(), 0, "numbers outside the schema");
    let mut compare = Compare { read, elements_seen: BTreeMap::new(), compared: 0 };
    value.visit(&mut compare);
    compare.compared
}

fn random<T: Wire>(rng: &mut ChaCha8Rng) -> T {
    let mut packed = vec![0; T::PACKED_SIZE];
    rng.fill_bytes(&mut packed);
    T::unpack(&packed)
}

fn round_trip<T: Wire>(value: &T) -> usize {
    let schema = T::SCHEMA;
    let pool = DescriptorPool::from_file_descriptor_set(descriptor_set(&schema)).unwrap();
    let message = pool.get_message_by_name(&full_name(&schema)).unwrap();
    let mut bytes = Vec::new();
    encode(value, &mut bytes);
    let read = DynamicMessage::decode(message, bytes.as_slice()).unwrap();
    compare(value, &read)
}

#[test]
fn every_field_of_every_topic_survives_with_any_content() {
    struct RoundTrip(ChaCha8Rng);
    impl TopicVisitor for RoundTrip {
        type Error = Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
            // Header alone has nine numbers.
            assert!(round_trip(&T::default()) > 9, "{}", topic.info.name);
            for _ in 0..20 {
                round_trip(&random::<T>(&mut self.0));
            }
            Ok(())
        }
    }
    visit_all(&mut RoundTrip(ChaCha8Rng::seed_from_u64(1))).unwrap();
}

shared_types::memory! {
    struct Corner {
        small: [i8; 3],
        raw: [u8; 200],
        wide: [f64; 40],
        pair: [u32; 2],
        #[padding]
        reserved: u32,
        truth: bool,
    }
}

shared_types::memory! {
    struct Nest {
        corners: [Corner; 3],
        last: u64,
    }
}

#[test]
fn bytes_long_nested_messages_and_padding_in_the_middle_survive() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..20 {
        let nest: Nest = random(&mut rng);
        assert_eq!(round_trip(&nest), 3 * (3 + 200 + 40 + 2 + 1) + 1);
    }
}

/// Packed form without padding, which does not travel.
fn packed<T: Wire>(value: &T) -> Vec<u8> {
    let mut bytes = vec![0; T::PACKED_SIZE];
    value.pack(&mut bytes);
    bytes
}

/// Bytes of padding in a struct, those of nested ones included.
fn padding(schema: &Schema) -> usize {
    let of = |field: &Field| match field.kind {
        Kind::Message(nested) => field.count * padding(nested),
        _ if field.class == FieldClass::Padding => 4,
        _ => 0,
    };
    schema.fields.iter().map(of).sum()
}

fn comes_back<T: Wire>(pattern: &[u8]) -> Result<(), TestCaseError> {
    let bytes: Vec<u8> = pattern.iter().copied().cycle().take(T::PACKED_SIZE).collect();
    let value = T::unpack(&bytes);
    let mut wire = Vec::new();
    encode(&value, &mut wire);
    let back = decode::<T>(&wire).map_err(|error| TestCaseError::fail(error.to_string()))?;
    let mut again = Vec::new();
    encode(&back, &mut again);
    prop_assert_eq!(&wire, &again);
    // Padding becomes zero; all else keeps its bits.
    let changed = packed(&value).iter().zip(packed(&back)).filter(|(a, b)| **a != *b).count();
    prop_assert!(changed <= padding(&T::SCHEMA), "{}: {changed} bytes differ", T::SCHEMA.name);
    // Whatever is missing or too much is named.
    for cut in [wire.len() - 1, wire.len() / 2, 0] {
        prop_assert!(decode::<T>(&wire[..cut]).is_err());
    }
    wire.push(0);
    prop_assert!(decode::<T>(&wire).is_err());
    Ok(())
}

struct ComesBack(Vec<u8>);

impl TopicVisitor for ComesBack {
    type Error = TestCaseError;
    fn visit<T: Sample>(&mut self, _topic: &'static Topic<T>) -> Result<(), TestCaseError> {
        comes_back::<T>(&self.0)
    }
}

#[test]
fn every_bit_of_every_topic_comes_back_even_of_numbers_that_are_none() {
    visit_all(&mut ComesBack(vec![0xff])).unwrap();
    visit_all(&mut ComesBack(vec![0, 0, 0, 0, 0, 0, 0xf0, 0x7f])).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_sample_that_was_written_can_be_read(
        pattern in proptest::collection::vec(any::<u8>(), 1..400),
    ) {
        visit_all(&mut ComesBack(pattern.clone()))?;
        comes_back::<Nest>(&pattern)?;
    }

    #[test]
    fn a_message_with_a_changed_byte_is_refused_or_reads_as_another(
        pattern in proptest::collection::vec(any::<u8>(), 1..400),
        at in any::<proptest::sample::Index>(),
        flip in 1_u8..,
    ) {
        let bytes: Vec<u8> = pattern.iter().copied().cycle().take(Imu::PACKED_SIZE).collect();
        let mut wire = Vec::new();
        encode(&Imu::unpack(&bytes), &mut wire);
        let at = at.index(wire.len());
        wire[at] ^= flip;
        if let Ok(changed) = decode::<Imu>(&wire) {
            prop_assert_ne!(packed(&changed), packed(&Imu::unpack(&bytes)));
        }
    }
}

#[test]
fn the_same_sample_gives_the_same_bytes() {
    let nest: Nest = random(&mut ChaCha8Rng::seed_from_u64(3));
    let (mut once, mut again) = (Vec::new(), Vec::with_capacity(9000));
    encode(&nest, &mut once);
    encode(&nest, &mut again);
    assert_eq!(once, again);
}
