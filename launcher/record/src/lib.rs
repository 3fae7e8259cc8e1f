//! Recording of a flight: one MCAP file that any viewer opens, derived from the floor plan.
//!
//! [`Recording`] writes, [`Recorder`] has it written by a thread of its own; [`descriptor_set`] and [`encode`] turn the reflection of a sample into
//! protobuf, [`decode`] turns it back; [`read`] opens a recording again;
//! [`SequenceAudit`] proves that nothing is missing. A new topic needs no change here.

mod audit;
pub mod build;
mod decode;
mod disk_sync;
mod encode;
mod error;
mod facts;
mod keyframes;
mod messages;
pub mod named;
mod open;
pub mod read;
mod recorder;
mod recording;
pub mod scene;
mod schema;
mod sink;

pub use audit::{SequenceAudit, SequenceCheck, Stream, Tally, content, name_gaps};
pub use decode::{DecodeError, decode};
pub use encode::encode;
pub use error::RecordError;
pub use facts::{Branched, Clock, Continued, Facts, Machine};
pub use keyframes::{KEYFRAME_PERIOD_NS, Keyframes};
pub use messages::{Event, Severity};
pub use messages::{decode_log, encode_log, log_schema};
pub use recorder::Recorder;
pub use recording::Recording;
pub use schema::{PACKAGE, descriptor_set, full_name};
