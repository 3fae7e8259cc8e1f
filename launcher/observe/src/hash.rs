//! The two hashes of a flight: what the vehicle did, and everything that was published.
//!
//! Both are chains of samples, one per topic and seat, combined in the order of the topics' numbers and of seats; no
//! name of a topic, type or field is part of them. As a chain has its samples in the order of their sequence, hence of
//! time, this is the order (time, topic, sequence) without anything to sort.

use shared_types::wire::{Field, FieldClass, Kind, Visitor, Wire};
use shared_types::{Header, Sample, TopicInfo, topics};
use std::collections::BTreeMap;
use std::marker::PhantomData;

/// Hashes logical time and what happened, of every topic marked for it. Headers and fields of
/// [`FieldClass::Identity`] stay out, so that a swapped controller or another machine gives the same hash.
#[derive(Debug, Clone, Default)]
pub struct FlightHash(Chains);

/// Hashes every sample of every topic, except for fields of [`FieldClass::Machine`].
#[derive(Debug, Clone, Default)]
pub struct LogHash(Chains);

/// Form of the two hashes. Those of a recording of another form cannot be compared with ours.
pub const HASH_FORM: (&str, &str) = ("hash_form", "2");

/// A hash that the summary of a recording keeps, if it is of today's form.
#[must_use]
pub fn kept_hash<'a>(summary: &'a BTreeMap<String, String>, key: &str) -> Option<&'a str> {
    let (form_key, form) = HASH_FORM;
    let is_comparable = summary.get(form_key).is_some_and(|kept| kept == form);
    summary.get(key).filter(|_| is_comparable).map(String::as_str)
}

/// Bytes that are hashed at once: whole subtrees, whose blocks the hash works on side by side.
const BATCH: usize = 16 * 1024;

/// One hash per topic and seat, in the order of their first samples.
#[derive(Debug, Clone, Default)]
struct Chains(Vec<(Key, Chain)>);

/// Number of a topic, and seat.
type Key = (u32, u32);

#[derive(Debug, Clone, Default)]
struct Chain {
    hasher: blake3::Hasher,
    /// Not hashed yet.
    buffer: Vec<u8>,
}

impl Chains {
    fn add<T: Sample, S: Skips>(&mut self, key: Key, head: &[u64], sample: &T) {
        let Chain { hasher, buffer } = self.chain(key);
        append(buffer, head.iter().map(|word| word.to_le_bytes()));
        sample.visit(&mut Feed { out: buffer, skips: PhantomData::<S> });
        if let Some(batch) = buffer.get(..BATCH) {
            hasher.update(batch);
            buffer.drain(..BATCH);
        }
    }

    fn chain(&mut self, key: Key) -> &mut Chain {
        let at = self.0.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
            self.0.push((key, Chain::default()));
            self.0.len() - 1
        });
        &mut self.0[at].1
    }

    /// 128 bits over all chains as hexadecimal.
    fn hex(&self) -> String {
        let mut all = blake3::Hasher::new();
        let mut chains: Vec<_> = self.0.iter().collect();
        chains.sort_by_key(|(key, _)| *key);
        for ((topic, seat), Chain { hasher, buffer }) in chains {
            all.update(&topic.to_le_bytes());
            all.update(&seat.to_le_bytes());
            all.update(hasher.clone().update(buffer).finalize().as_bytes());
        }
        all.finalize().to_hex().as_str()[..32].to_owned()
    }
}

/// Appends words; room for all of them is made once.
fn append(out: &mut Vec<u8>, words: impl ExactSizeIterator<Item = [u8; 8]>) {
    out.reserve(8 * words.len());
    words.for_each(|word| out.extend_from_slice(&word));
}

/// What a hash leaves out. A type, so that the compiler can settle for each type of sample which fields these are.
trait Skips {
    /// True for a field that is left out.
    fn skips(field: &Field) -> bool;
}

struct Feed<'a, S> {
    out: &'a mut Vec<u8>,
    skips: PhantomData<S>,
}

impl<S: Skips> Visitor for Feed<'_, S> {
    fn f64s(&mut self, field: &'static Field, values: &[f64]) {
        if !S::skips(field) {
            append(self.out, values.iter().map(|value| value.to_le_bytes()));
        }
    }
    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        if !S::skips(field) {
            append(self.out, values.iter().map(|value| value.to_le_bytes()));
        }
    }
    fn bytes(&mut self, field: &'static Field, values: &[u8]) {
        if field.class == FieldClass::Topic {
            append(self.out, core::iter::once(number_of(values).to_le_bytes()));
        } else if !S::skips(field) {
            self.out.extend_from_slice(values);
        }
    }
    fn message<T: Wire>(&mut self, field: &'static Field, value: &T) {
        if !S::skips(field) {
            value.visit(self);
        }
    }
}

/// Number of the topic of a name that zeros may follow; 0 for none.
fn number_of(name: &[u8]) -> u64 {
    let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
    let found = topics::all().into_iter().find(|info| info.name.as_bytes() == name);
    found.map_or(0, |info| info.id.into())
}

/// True for headers, of which the hashes take what they need by themselves.
fn is_header(field: &Field) -> bool {
    matches!(field.kind, Kind::Message(schema) if schema.layout_hash == Header::SCHEMA.layout_hash)
}

impl Skips for FlightHash {
    fn skips(field: &Field) -> bool {
        is_header(field) || field.class != FieldClass::Flight
    }
}

impl Skips for LogHash {
    fn skips(field: &Field) -> bool {
        is_header(field) || matches!(field.class, FieldClass::Machine | FieldClass::Padding)
    }
}

/// 64 bits over what the log hash has of a sample, of whichever topic it is.
#[must_use]
pub fn fingerprint<T: Sample>(sample: &T) -> u64 {
    let mut buffer = Vec::new();
    append(&mut buffer, log_head(sample).map(u64::to_le_bytes).into_iter());
    sample.visit(&mut Feed { out: &mut buffer, skips: PhantomData::<LogHash> });
    let hash = blake3::hash(&buffer);
    hash.as_bytes().first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

/// All of a header that is not the machine's, without comparing names sample by sample.
fn log_head<T: Sample>(sample: &T) -> [u64; 6] {
    let Header { sequence, release_ns, valid_ns, cause_sequence, input_sequence, seat, .. } =
        *sample.header();
    [sequence, release_ns, valid_ns, cause_sequence, input_sequence, seat.into()]
}

impl FlightHash {
    /// Adds a sample; per topic they must come in sequence.
    pub fn add<T: Sample>(&mut self, topic: &TopicInfo, sample: &T) {
        if topic.in_flight_hash {
            let Header { release_ns, valid_ns, .. } = *sample.header();
            self.0.add::<T, Self>((topic.id, 0), &[release_ns, valid_ns], sample);
        }
    }

    /// 128 bits as hexadecimal.
    #[must_use]
    pub fn hex(&self) -> String {
        self.0.hex()
    }
}

impl LogHash {
    /// Adds a sample; per topic and seat they must come in sequence.
    pub fn add<T: Sample>(&mut self, topic: &TopicInfo, sample: &T) {
        let seat = sample.header().seat;
        self.0.add::<T, Self>((topic.id, seat), &log_head(sample), sample);
    }

    /// 128 bits as hexadecimal.
    #[must_use]
    pub fn hex(&self) -> String {
        self.0.hex()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::convert::Infallible;
    use shared_types::wire::Schema;
    use shared_types::{LoopStats, OwnerRecord, Topic, TopicVisitor, Truth, topics};

    /// Adds one sample of each topic to hashes of its own.
    struct Each;

    impl TopicVisitor for Each {
        type Error = Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
            let (mut flight, mut log) = (FlightHash::default(), LogHash::default());
            let nothing = (flight.hex(), log.hex());
            flight.add(&topic.info, &T::default());
            log.add(&topic.info, &T::default());
            let name = topic.info.name;
            assert_eq!(flight.hex() != nothing.0, topic.info.in_flight_hash, "{name}");
            assert_ne!(log.hex(), nothing.1, "{name}");
            Ok(())
        }
    }

    #[test]
    fn each_hashed_topic_is_in_the_flight_hash_and_every_topic_in_the_log_hash() {
        let Ok(()) = topics::visit_all(&mut Each);
    }

    /// Gives each byte of a packed sample another number, but for padding, which shifts nothing.
    fn number(schema: &Schema, numbers: &mut impl Iterator<Item = u8>, packed: &mut Vec<u8>) {
        for field in schema.fields {
            for _ in 0..field.count {
                match field.kind {
                    Kind::Message(nested) => number(nested, numbers, packed),
                    _ if field.class == FieldClass::Padding => {
                        packed.extend(core::iter::repeat_n(0, field.packed_size));
                    }
                    _ => packed.extend(numbers.by_ref().take(field.packed_size)),
                }
            }
        }
    }

    /// Adds a sample of each topic up to a number, whose every byte depends on its place.
    struct UpTo(u32, FlightHash, LogHash);

    impl UpTo {
        fn hashes(number: u32) -> (String, String) {
            let mut all = Self(number, FlightHash::default(), LogHash::default());
            let Ok(()) = topics::visit_all(&mut all);
            (all.1.hex(), all.2.hex())
        }
    }

    impl TopicVisitor for UpTo {
        type Error = Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
            if topic.info.id > self.0 {
                return Ok(());
            }
            let mut bytes = Vec::with_capacity(T::PACKED_SIZE);
            number(&T::SCHEMA, &mut (1..=250).cycle(), &mut bytes);
            let sample = T::unpack(&bytes);
            self.1.add(&topic.info, &sample);
            self.2.add(&topic.info, &sample);
            Ok(())
        }
    }

    /// A new topic is in no flight of before, so that it adds a line here and leaves the others as they are.
    #[test]
    fn what_is_hashed_of_each_topic_changes_with_the_form_alone() {
        let flight = "979e9a97643de1e4e46ed644f7304f2c";
        for (number, log) in
            [(23, "6d8b1fc494f47b20f9a9aca77a0d575c"), (25, "9776a82ffd3e25bc32b02b10439c388a")]
        {
            let hashes = UpTo::hashes(number);
            assert_eq!(("2", flight, log), (HASH_FORM.1, hashes.0.as_str(), hashes.1.as_str()));
        }
        assert_eq!(UpTo::hashes(25), UpTo::hashes(u32::MAX), "a topic without a line");
    }

    #[test]
    fn a_topic_that_a_sample_names_is_hashed_by_its_number() {
        let of = |name: &str| {
            let mut padded = name.as_bytes().to_vec();
            padded.resize(24, 0);
            number_of(&padded)
        };
        assert_eq!(of("truth"), u64::from(topics::TRUTH.info.id));
        assert_eq!((of(""), of("tru")), (0, 0));
    }

    fn hash_of(change: impl Fn(&mut Truth)) -> (String, String) {
        let mut truth = Truth::default();
        truth.header.release_ns = 5;
        truth.position_w_m = [1.0, 2.0, 3.0];
        change(&mut truth);
        let (mut flight, mut log) = (FlightHash::default(), LogHash::default());
        flight.add(&topics::TRUTH.info, &truth);
        log.add(&topics::TRUTH.info, &truth);
        (flight.hex(), log.hex())
    }

    #[test]
    fn both_hashes_see_values_and_logical_time_and_not_the_host() {
        let plain = hash_of(|_| {});
        assert_eq!((plain.0.len(), plain.1.len()), (32, 32));
        assert_eq!(plain, hash_of(|t| t.header.publish_mono_ns = 77));
        assert_eq!(plain, hash_of(|t| t.header.receive_mono_ns = 77));
        assert_eq!(plain, hash_of(|t| t.header.generation = 3));
        let changes: [fn(&mut Truth); 2] = [
            |t| t.position_w_m[2] = f64::from_bits(3.0_f64.to_bits() + 1),
            |t| t.header.release_ns = 6,
        ];
        for change in changes {
            let changed = hash_of(change);
            assert!(changed.0 != plain.0 && changed.1 != plain.1, "{changed:?}");
        }
    }

    #[test]
    fn only_the_log_hash_sees_sequences_and_topics_that_are_not_the_flight() {
        let (plain, renumbered) = (hash_of(|_| {}), hash_of(|t| t.header.sequence = 9));
        assert_eq!(plain.0, renumbered.0);
        assert_ne!(plain.1, renumbered.1);
        let (mut flight, mut log) = (FlightHash::default(), LogHash::default());
        let empty = (flight.hex(), log.hex());
        flight.add(&topics::IMU.info, &shared_types::Imu::default());
        log.add(&topics::IMU.info, &shared_types::Imu::default());
        assert_eq!(flight.hex(), empty.0);
        assert_ne!(log.hex(), empty.1);
    }

    #[test]
    fn the_log_hash_knows_what_is_the_machines() {
        let hash = |stats: LoopStats, record: OwnerRecord| {
            let mut log = LogHash::default();
            log.add(&topics::LOOP_STATS.info, &stats);
            log.add(&topics::ATTITUDE_OWNER.info, &record);
            log.hex()
        };
        let (stats, record) = (LoopStats::default(), OwnerRecord::default());
        let plain = hash(stats, record);
        assert_eq!(plain, hash(LoopStats { rescued_waits: 4, generation: 2, ..stats }, record));
        assert_ne!(plain, hash(LoopStats { late_samples: 1, ..stats }, record));
        assert_ne!(plain, hash(stats, OwnerRecord { epoch: 1, ..record }));
        assert_ne!(plain, hash(stats, OwnerRecord { owner: 1, ..record }));
    }

    #[test]
    fn a_hash_of_another_form_is_not_compared() {
        let of = |pairs: &[(&str, &str)]| {
            pairs.iter().map(|(key, text)| ((*key).to_owned(), (*text).to_owned())).collect()
        };
        assert_eq!(kept_hash(&of(&[("hash", "ab")]), "hash"), None, "before there were forms");
        assert_eq!(kept_hash(&of(&[("hash", "ab"), ("hash_form", "1")]), "hash"), None);
        assert_eq!(kept_hash(&of(&[("hash", "ab"), HASH_FORM]), "hash"), Some("ab"));
        assert_eq!(kept_hash(&of(&[HASH_FORM]), "hash"), None, "a cut file");
    }

    #[test]
    fn each_seat_of_a_topic_is_a_chain_of_its_own() {
        let sample = |seat, steps| {
            let header = Header { seat, ..Header::default() };
            LoopStats { header, steps, ..LoopStats::default() }
        };
        let hash = |order: [LoopStats; 3]| {
            let mut log = LogHash::default();
            for stats in &order {
                log.add(&topics::LOOP_STATS.info, stats);
            }
            log.hex()
        };
        let (a, b, c) = (sample(1, 1), sample(1, 2), sample(2, 1));
        assert_eq!(hash([a, b, c]), hash([a, c, b]));
        assert_ne!(hash([a, b, c]), hash([b, a, c]));
    }
}
