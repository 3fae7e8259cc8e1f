//! The flight hash: what the vehicle did, and nothing about the machine it was computed on.

use shared_types::wire::{Field, Visitor, Wire};
use shared_types::{Header, Sample, TopicInfo};
use std::collections::BTreeMap;

/// Hashes logical time and physical values of every topic marked for it. Identity, sequence, epoch
/// and host stamps stay out, so that a swapped controller or another machine gives the same hash.
#[derive(Debug, Clone, Default)]
pub struct FlightHash {
    topics: BTreeMap<&'static str, blake3::Hasher>,
}

/// Fields of hashed samples that tell who commanded, not what happened.
const IDENTITY_FIELDS: [&str; 3] = ["command_sequence", "command_cause_sequence", "epoch"];

struct Feed<'a>(&'a mut blake3::Hasher);

impl Visitor for Feed<'_> {
    fn f64s(&mut self, _field: &'static Field, values: &[f64]) {
        for value in values {
            self.0.update(&value.to_le_bytes());
        }
    }
    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        if !IDENTITY_FIELDS.contains(&field.name) {
            for value in values {
                self.0.update(&value.to_le_bytes());
            }
        }
    }
    fn bytes(&mut self, _field: &'static Field, values: &[u8]) {
        self.0.update(values);
    }
    fn message<T: Wire>(&mut self, field: &'static Field, value: &T) {
        if field.name != "header" {
            value.visit(self);
        }
    }
}

impl FlightHash {
    /// Adds a sample; per topic they must come in sequence.
    pub fn add<T: Sample>(&mut self, topic: &TopicInfo, sample: &T) {
        if !topic.in_flight_hash {
            return;
        }
        let hasher = self.topics.entry(topic.name).or_default();
        let Header { release_ns, valid_ns, .. } = sample.header();
        hasher.update(&release_ns.to_le_bytes());
        hasher.update(&valid_ns.to_le_bytes());
        sample.visit(&mut Feed(hasher));
    }

    /// 128 bits over all topics, in name order, as hexadecimal.
    #[must_use]
    pub fn hex(&self) -> String {
        let mut all = blake3::Hasher::new();
        for (name, hasher) in &self.topics {
            all.update(name.as_bytes());
            all.update(hasher.finalize().as_bytes());
        }
        all.finalize().to_hex().as_str()[..32].to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Truth, topics};

    fn hash_of(change: impl Fn(&mut Truth)) -> String {
        let mut truth = Truth::default();
        truth.header.release_ns = 5;
        truth.position_w_m = [1.0, 2.0, 3.0];
        change(&mut truth);
        let mut hash = FlightHash::default();
        hash.add(&topics::TRUTH.info, &truth);
        hash.hex()
    }

    #[test]
    fn the_hash_sees_values_and_logical_time_and_not_the_host() {
        let plain = hash_of(|_| {});
        assert_eq!(plain.len(), 32);
        assert_eq!(plain, hash_of(|t| t.header.publish_mono_ns = 77));
        assert_eq!(plain, hash_of(|t| t.header.sequence = 9));
        assert_eq!(plain, hash_of(|t| t.header.generation = 3));
        assert_ne!(plain, hash_of(|t| t.position_w_m[2] = f64::from_bits(3.0_f64.to_bits() + 1)));
        assert_ne!(plain, hash_of(|t| t.header.release_ns = 6));
    }

    #[test]
    fn topics_outside_the_hash_do_not_change_it() {
        let mut hash = FlightHash::default();
        let empty = hash.hex();
        hash.add(&topics::IMU.info, &shared_types::Imu::default());
        assert_eq!(hash.hex(), empty);
    }
}
