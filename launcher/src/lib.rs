//! The morphquad command: conductor, pilot, supervisor and recorder.

pub mod pilot;
