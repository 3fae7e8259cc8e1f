//! Two flights, sample by sample: where they first differ.

use super::Tape;
use ::observe::Observer;
use replay::{Pair, difference, pairs};
use shared_types::{Header, Role, Sample, Topic, TopicVisitor, topics};
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;

/// The first difference between a recorded flight and another one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Release of the sample \[ns\].
    pub release_ns: u64,
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
    /// What the flight has published.
    again: Tape,
}

/// What a comparison has found.
#[derive(Debug, Default)]
pub struct Likeness {
    /// Samples that are the same.
    pub same: u64,
    /// The earliest difference; of several at one release, that of the first topic.
    pub first: Option<Difference>,
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
        Self { tape, recorded_ns, again: Tape::default() }
    }

    /// What a flight that has got to `flown_ns` has in common with the tape.
    #[must_use]
    pub fn verdict(&self, flown_ns: u64) -> Likeness {
        let mut judge = Judge { compare: self, flown_ns, likeness: Likeness::default() };
        let Ok(()) = topics::visit_all(&mut judge);
        judge.likeness
    }
}

impl Observer for Compare {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        // The supervisor's topics are about loops and their host, not about the flight.
        if topic.info.from != Role::Supervisor {
            self.again.observe(topic, sample);
        }
    }
}

struct Judge<'a> {
    compare: &'a Compare,
    flown_ns: u64,
    likeness: Likeness,
}

impl TopicVisitor for Judge<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let Compare { tape, recorded_ns, again } = self.compare;
        let again = again.samples(topic);
        let Some(begins_ns) = again.iter().map(|s| s.header().release_ns).min() else {
            return Ok(());
        };
        let recorded = tape.samples(topic);
        // A seat counts its samples for itself, and anew for each process that takes it.
        let seats: BTreeSet<u32> =
            again.iter().chain(recorded).map(|sample| sample.header().seat).collect();
        for seat in seats {
            let of_seat = |sample: &&T| sample.header().seat == seat;
            let first = again.iter().find(of_seat).map_or((begins_ns, 0), place);
            let recorded = recorded.iter().filter(of_seat).filter(|s| place(*s) >= first);
            for pair in pairs(recorded, again.iter().filter(of_seat), place) {
                match pair {
                    Pair::Both(old, new) => match difference(old, new, &[]) {
                        None => self.likeness.same += 1,
                        Some(field) => self.note(topic, old.header(), field),
                    },
                    Pair::Recorded(old)
                        if old.header().release_ns < self.flown_ns.min(*recorded_ns) =>
                    {
                        self.only_in_one(topic, old.header(), ["there", "not there"]);
                    }
                    Pair::Again(new) if new.header().release_ns < *recorded_ns => {
                        self.only_in_one(topic, new.header(), ["not there", "there"]);
                    }
                    // Beyond the end of one of the two.
                    Pair::Recorded(_) | Pair::Again(_) => {}
                }
            }
        }
        Ok(())
    }
}

/// Place of a sample among those of its seat.
fn place<T: Sample>(sample: &T) -> (u64, u64) {
    (sample.header().release_ns, sample.header().sequence)
}

impl Judge<'_> {
    fn only_in_one<T>(&mut self, topic: &Topic<T>, header: &Header, [old, new]: [&str; 2]) {
        let field = format!("sample {}", header.sequence);
        self.note(topic, header, (field, old.to_owned(), new.to_owned()));
    }

    fn note<T>(
        &mut self,
        topic: &Topic<T>,
        header: &Header,
        (field, old, new): (String, String, String),
    ) {
        let release_ns = header.release_ns;
        if self.likeness.first.as_ref().is_none_or(|first| release_ns < first.release_ns) {
            let topic = topic.info.name;
            self.likeness.first = Some(Difference { release_ns, topic, field, old, new });
        }
    }
}
