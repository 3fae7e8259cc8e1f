//! Two flights, sample by sample: where they first differ.

use super::{Observer, Tape};
use crate::replay::{first_difference, numbers_of};
use shared_types::{Header, Role, Sample, Topic, TopicVisitor, topics};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;

/// The first difference between a recorded flight and another one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Release of the sample \[ns\].
    pub release_ns: u64,
    /// Topic.
    pub topic: &'static str,
    /// Field, with its index if it is one of several; the sample's number if it is only in one flight.
    pub field: String,
    /// As recorded.
    pub old: String,
    /// As flown now.
    pub new: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { release_ns, topic, field, old, new } = self;
        let t_s = *release_ns as f64 / 1e9;
        write!(f, "at {t_s} s on {topic}: {field} was {old} and is {new}")
    }
}

/// Compares what a flight publishes with a tape. Host stamps, generations and the host's counters
/// are left out.
#[derive(Debug)]
pub struct Compare {
    tape: Arc<Tape>,
    /// What the flight publishes from here on was not recorded \[ns\].
    recorded_ns: u64,
    /// Samples compared so far that are the same.
    same: u64,
    first: Option<Difference>,
    /// Last sequence seen, by topic.
    seen: BTreeMap<&'static str, u64>,
}

impl Default for Compare {
    fn default() -> Self {
        Self::with(Arc::new(Tape::default()), 0)
    }
}

impl Compare {
    /// With a flight that has been recorded up to `recorded_ns`.
    #[must_use]
    pub fn with(tape: Arc<Tape>, recorded_ns: u64) -> Self {
        Self { tape, recorded_ns, same: 0, first: None, seen: BTreeMap::new() }
    }

    /// Samples that are the same, and the earliest difference so far.
    #[must_use]
    pub fn verdict(&self) -> (u64, Option<&Difference>) {
        (self.same, self.first.as_ref())
    }

    /// Looks, at the end of a flight that got to `flown_ns`, for samples that it did not publish.
    pub fn finish(&mut self, flown_ns: u64) {
        let end_ns = flown_ns.min(self.recorded_ns);
        let mut missing = Missing { compare: self, end_ns };
        let Ok(()) = topics::visit_all(&mut missing);
    }

    fn note(&mut self, difference: Difference) {
        if self.first.as_ref().is_none_or(|first| difference.release_ns < first.release_ns) {
            self.first = Some(difference);
        }
    }
}

impl Observer for Compare {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        if topic.info.from == Role::Supervisor {
            // About loops and their host, not about the flight.
            return;
        }
        let header = *sample.header();
        self.seen.insert(topic.info.name, header.sequence);
        let tape = Arc::clone(&self.tape);
        let Some(old) = tape.at(topic, header.sequence) else {
            if header.release_ns >= self.recorded_ns {
                return;
            }
            self.note(Difference {
                release_ns: header.release_ns,
                topic: topic.info.name,
                field: format!("sample {}", header.sequence),
                old: "not there".to_owned(),
                new: "there".to_owned(),
            });
            return;
        };
        let (old, new) = (without_host(old), without_host(sample));
        match difference(&old, &new) {
            None => self.same += 1,
            Some((field, old, new)) => {
                let (release_ns, topic) = (header.release_ns, topic.info.name);
                self.note(Difference { release_ns, topic, field, old, new });
            }
        }
    }
}

struct Missing<'a> {
    compare: &'a mut Compare,
    end_ns: u64,
}

impl TopicVisitor for Missing<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let Some(&seen) = self.compare.seen.get(topic.info.name) else { return Ok(()) };
        let tape = Arc::clone(&self.compare.tape);
        let next = tape.waiting(topic, seen, self.end_ns).next().map(|s| *s.header());
        if let Some(header) = next {
            self.compare.note(Difference {
                release_ns: header.release_ns,
                topic: topic.info.name,
                field: format!("sample {}", header.sequence),
                old: "there".to_owned(),
                new: "not there".to_owned(),
            });
        }
        Ok(())
    }
}

/// A sample as every machine produces it.
fn without_host<T: Sample>(sample: &T) -> T {
    let mut sample = *sample;
    let header = sample.header_mut();
    *header = Header {
        release_mono_ns: 0,
        start_mono_ns: 0,
        publish_mono_ns: 0,
        generation: 0,
        ..*header
    };
    sample
}

/// Name and both values of the first field that differs in any bit.
fn difference<T: Sample>(old: &T, new: &T) -> Option<(String, String, String)> {
    let packed = |sample: &T| {
        let mut bytes = vec![0; T::PACKED_SIZE];
        sample.pack(&mut bytes);
        bytes
    };
    if packed(old) == packed(new) {
        return None;
    }
    first_difference(&numbers_of(old, "", &[]), &numbers_of(new, "", &[]))
}
