//! From a recording alone: which IMU sample each wrench command descends from, and where the time
//! between them went.
//!
//! Headers name what a step went by (`input_sequence`, `cause_sequence`) and when; `links.rs` looks them
//! up, `chain.rs` follows one command, `segment.rs` defines the spans of a chain, `report.rs` sums up.

mod chain;
mod links;
mod report;
mod segment;

pub use chain::{Broken, Chain, SetpointChain};
pub use report::{Figures, Report, Slowest, Sum};
pub use segment::{SEGMENTS, Segment};

use links::Links;
use record::read::{Closing, ReadError, RecordVisitor, RecordedFlight};
use shared_types::{Header, Sample, Topic, TopicInfo};

/// One command and how far it could be followed.
#[derive(Debug, Clone)]
pub struct Traced {
    /// The command's header.
    pub command: Header,
    /// Its origin, or what is missing.
    pub chain: Result<Chain, Broken>,
}

/// How a recording that has been gone through ends.
#[derive(Debug)]
pub struct Ended {
    /// How the file ends.
    pub closing: Closing,
    /// Last instant of the vehicle in the file \[ns\].
    pub end_ns: u64,
}

/// Follows every wrench command of a recording back to its IMU sample, and shows them in the order recorded.
/// Memory is bounded: links older than a minute are forgotten.
///
/// # Errors
/// The file is damaged.
pub fn trace(flight: &RecordedFlight, see: impl FnMut(&Traced)) -> Result<Ended, ReadError> {
    let mut following = Following { links: Links::default(), settled_ns: 0, see };
    let closing = flight.visit(&mut following)?;
    following.settle(u64::MAX);
    Ok(Ended { closing, end_ns: following.links.end_ns })
}

/// A recorder takes topics in turn, and a command moves the rotors after it was sent: so long is waited
/// before a command is followed \[ns\].
const SETTLE_NS: u64 = 5_000_000_000;
/// No command goes by anything older \[ns\].
const KEEP_NS: u64 = 60_000_000_000;

struct Following<S> {
    links: Links,
    /// Commands before this have been followed \[ns\].
    settled_ns: u64,
    see: S,
}

impl<S: FnMut(&Traced)> Following<S> {
    fn settle(&mut self, until_ns: u64) {
        self.links.sort();
        for command in self.links.take_commands(until_ns) {
            let chain = self.links.follow(&command);
            let chain = chain.and_then(|chain| segment::check(&chain).map(|()| chain));
            (self.see)(&Traced { command, chain });
        }
        self.links.forget(until_ns.saturating_sub(KEEP_NS));
        self.settled_ns = until_ns;
    }
}

impl<S: FnMut(&Traced)> RecordVisitor for Following<S> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        self.links.wants(topic)
    }

    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.links.sample(topic, sample);
        if self.links.end_ns > self.settled_ns.saturating_add(2 * SETTLE_NS) {
            self.settle(self.links.end_ns - SETTLE_NS);
        }
    }
}
