//! Where two recordings of one scenario part, if they are not of one flight.
//!
//! In simulated time the outputs of each process are a function of its inputs, and a flight is a function of its
//! scenario and of what is ordered in flight: two recordings of it differ only if the orders do, or if a process does not
//! keep to that or was changed in between. What differs first is the order, or the output of that process, since the
//! outputs of all others follow from inputs that are still the same.

use super::ReplayError;
use super::lives::Instance;
use observe::{FLOWN_NS, fingerprint, kept_hash};
use record::Clock;
use record::read::{RecordVisitor, RecordedFlight};
use scenario::services::Assignment;
use shared_types::time::s_from_ns;
use shared_types::{Edge, Header, Role, Sample, Seating, SeatingKind, Topic, TopicInfo};
use std::any::Any;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::fmt;

/// The first sample that two flights do not have in common.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parting {
    /// Release of the sample \[ns\].
    pub release_ns: u64,
    /// Its topic.
    pub topic: &'static str,
    /// The process that has published it.
    pub writer: Instance,
    /// What this tells.
    pub cause: Cause,
}

/// Why two flights of a scenario part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// An executable of a user's did something else, or a service with a configuration of its own.
    Brought,
    /// The launcher did: it was ordered something else, or a process came or went at another instant.
    Launcher,
    /// A service of this build did, which is a defect.
    Service,
}

impl fmt::Display for Parting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { release_ns, topic, writer, cause } = self;
        let at_s = s_from_ns(*release_ns);
        write!(f, "the two part at {at_s:.3} s, in what {writer} has published on {topic}: ")?;
        match cause {
            Cause::Brought => write!(
                f,
                "{writer} differs from run to run, or it or its configuration was changed between the two. Only if its \
                 outputs follow from its inputs alone can the flight be flown again."
            ),
            Cause::Launcher => f.write_str(
                "the two were not ordered the same in flight, or a process came or went at another instant.",
            ),
            Cause::Service => f.write_str(
                "nothing that a user brings has differed before. The two were flown by different builds, or this is a \
                 defect: please report it.",
            ),
        }
    }
}

/// True if two recordings are whole flights of the same scenario by the same build in simulated time, so that they are
/// to be one flight.
#[must_use]
pub fn are_of_one_scenario(one: &RecordedFlight, other: &RecordedFlight) -> bool {
    let is_whole = |flight: &RecordedFlight| {
        flight.clock() == Clock::Lockstep
            && flight.branched().is_none()
            && flight.continued().is_none()
    };
    let build =
        |flight: &RecordedFlight| ["version", "git"].map(|key| flight.facts().get(key).cloned());
    is_whole(one)
        && is_whole(other)
        && build(one) == build(other)
        && one.scenario().to_toml() == other.scenario().to_toml()
}

/// Where two recordings of one scenario part; none if they are of one flight, or if that of one is not known, as
/// of a file that is cut.
///
/// # Errors
/// A recording cannot be read.
pub fn parting(
    one: &RecordedFlight,
    other: &RecordedFlight,
) -> Result<Option<Parting>, ReplayError> {
    let (Some(end), Some(other_end)) = (End::of(one), End::of(other)) else { return Ok(None) };
    if end.log_hash == other_end.log_hash {
        return Ok(None);
    }
    // One that was interrupted is to be the beginning of the other.
    let until_ns = end.flown_ns.min(other_end.flown_ns);
    let (one, other) = (Prints::of(one, until_ns)?, Prints::of(other, until_ns)?);
    Ok(one.first_unlike(&other))
}

/// What a flight has left of its end.
struct End {
    log_hash: String,
    flown_ns: u64,
}

impl End {
    fn of(flight: &RecordedFlight) -> Option<Self> {
        let summary = flight.closing_summary()?;
        let log_hash = kept_hash(&summary, "log_hash")?.to_owned();
        Some(Self { log_hash, flown_ns: summary.get(FLOWN_NS)?.parse().ok()? })
    }
}

/// The samples of a flight but for reports about its loops, in the order in which a difference can come about.
struct Prints {
    samples: Vec<Print>,
    /// By role, seat and generation: the controller that took the seat in flight, and whether it is a service as shipped.
    seated: BTreeMap<(Role, u32, u32), (String, bool)>,
    /// What flew from the start.
    assignment: Assignment,
    /// What comes from here on is left out \[ns\].
    until_ns: u64,
}

struct Print {
    topic: &'static TopicInfo,
    release_ns: u64,
    sequence: u64,
    seat: u32,
    generation: u32,
    /// All of it but what the machine determines.
    value: u64,
}

impl RecordVisitor for Prints {
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let Header { release_ns, sequence, seat, generation, .. } = *sample.header();
        let seating = (sample as &dyn Any).downcast_ref::<Seating>();
        if release_ns < self.until_ns {
            let (topic, value) = (&topic.info, fingerprint(sample));
            let is_order = topic.edge == Edge::Delayed
                || seating.is_some_and(|seating| seating.kind != SeatingKind::Lost);
            // What has become of a loop is reported where the machine has come to it.
            if topic.from != Role::Supervisor || is_order {
                let print = Print { topic, release_ns, sequence, seat, generation, value };
                self.samples.push(print);
            }
        }
        if let Some(seating) = seating {
            let name = seating.controller_name().to_owned();
            let key = (seating.role, seating.seat, seating.generation);
            let is_shipped = seating.built_in.is_set() && !seating.configured.is_set();
            self.seated.insert(key, (name, is_shipped));
        }
    }
}

impl Prints {
    fn of(flight: &RecordedFlight, until_ns: u64) -> Result<Self, ReplayError> {
        let assignment = Assignment::of(flight.scenario().settings());
        let mut prints =
            Self { samples: Vec::new(), seated: BTreeMap::new(), assignment, until_ns };
        flight.require_memory()?;
        flight.visit(&mut prints)?;
        let mut samples = core::mem::take(&mut prints.samples);
        samples.sort_by_cached_key(|print| prints.place(print));
        prints.samples = samples;
        Ok(prints)
    }

    /// Of the samples of one release the launcher's come first, who commands and what is ordered, since it gives them
    /// before that; then what users bring, from which the others may follow.
    fn place(&self, print: &Print) -> (u64, u8, u32, u32, u64) {
        let rank = match self.writer(print).1 {
            Cause::Launcher => 0,
            Cause::Brought => 1,
            Cause::Service => 2,
        };
        (print.release_ns, rank, print.topic.id, print.seat, print.sequence)
    }

    /// The controller that has published a sample, and what it means if that is the first one to differ.
    fn writer(&self, print: &Print) -> (&str, Cause) {
        let Print { topic, seat, generation, .. } = *print;
        let role = topic.from;
        let seated = self.seated.range((role, seat, 0)..=(role, seat, generation)).next_back();
        match seated {
            _ if role == Role::Supervisor => (role.label(), Cause::Launcher),
            Some((_, (name, true))) => (name, Cause::Service),
            Some((_, (name, false))) => (name, Cause::Brought),
            // What a flight begins with is always a service.
            None => (self.assignment.name(role), Cause::Service),
        }
    }

    fn first_unlike(&self, other: &Self) -> Option<Parting> {
        let (mut own, mut its) = (self.samples.iter().peekable(), other.samples.iter().peekable());
        loop {
            let (flight, print) = match (own.peek(), its.peek()) {
                (None, None) => return None,
                (Some(print), None) => (self, *print),
                (None, Some(print)) => (other, *print),
                (Some(a), Some(b)) => match self.place(a).cmp(&other.place(b)) {
                    Ordering::Equal if a.value == b.value => {
                        own.next();
                        its.next();
                        continue;
                    }
                    Ordering::Equal | Ordering::Less => (self, *a),
                    Ordering::Greater => (other, *b),
                },
            };
            let (name, cause) = flight.writer(print);
            let Print { topic, release_ns, seat, .. } = *print;
            let writer = Instance { role: topic.from, seat, name: name.to_owned() };
            return Some(Parting { release_ns, topic: topic.name, writer, cause });
        }
    }
}
