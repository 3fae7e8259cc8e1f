//! The morphquad command: conductor, pilot, supervisor and recorder.
