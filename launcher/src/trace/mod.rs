//! From a recording alone: which IMU sample each wrench command descends from, and where the time
//! between them went.
//!
//! Headers name what a step went by (`input_sequence`, `cause_sequence`) and when; `links.rs` looks them
//! up, `chain.rs` follows one command, `segment.rs` says which spans a chain has, `report.rs` sums up.

mod chain;
mod links;
mod report;
mod segment;

pub use chain::{Broken, Chain, SetpointChain};
pub use report::{Figures, Report, Slowest};
pub use segment::{SEGMENTS, Segment};

use crate::record::read::{Closing, ReadError, RecordedFlight};
use links::Links;
use shared_types::Header;

/// One command and how far it could be followed.
#[derive(Debug, Clone)]
pub struct Traced {
    /// The command's header.
    pub command: Header,
    /// Its origin, or what is missing.
    pub chain: Result<Chain, Broken>,
}

/// Every command of a recording.
#[derive(Debug)]
pub struct Trace {
    /// In the order recorded.
    pub commands: Vec<Traced>,
    /// How the file ends.
    pub closing: Closing,
    /// Last instant of the vehicle in the file \[ns\].
    pub end_ns: u64,
}

/// Follows every wrench command of a recording back to its IMU sample.
///
/// # Errors
/// The file is damaged.
pub fn trace(flight: &RecordedFlight) -> Result<Trace, ReadError> {
    let mut links = Links::default();
    let closing = flight.visit(&mut links)?;
    links.sort();
    let commands = links
        .commands
        .iter()
        .map(|command| Traced { command: *command, chain: links.follow(command) });
    Ok(Trace { commands: commands.collect(), closing, end_ns: links.end_ns })
}
