//! What can go wrong with a recording.

use std::path::{Path, PathBuf};

/// Failure of a recording; each names the file, the cause and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file could not be created.
    #[error("cannot create recording {}: {cause}; use --record DIR with a writable folder", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// The system's error.
        cause: std::io::Error,
    },
    /// A write failed. The flight goes on; what is on disk so far can be read.
    #[error("recording {} stopped: {}; free space or use --record DIR", path.display(), cause_text(cause))]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system or the format's writer.
        cause: mcap::McapError,
    },
    /// Reported at the end of a recording that had stopped earlier.
    #[error(
        "recording {} is incomplete: it stopped with \"{cause}\", holds everything up to {:.3} s and \
         misses at most the last {unrecorded} records; free space or use --record DIR",
        path.display(), *until_ns as f64 * 1e-9
    )]
    Incomplete {
        /// The file.
        path: PathBuf,
        /// What was reported when it stopped.
        cause: String,
        /// Release of the newest sample that was handed to the system before \[ns\].
        until_ns: u64,
        /// Samples, states, events and what is derived of them since.
        unrecorded: u64,
    },
}

impl RecordError {
    pub(super) fn write(path: &Path, cause: impl Into<mcap::McapError>) -> Self {
        Self::Write { path: path.to_owned(), cause: cause.into() }
    }
}

/// The cause as text; the format's writer hides the system's error behind a general phrase.
pub(super) fn cause_text(cause: &mcap::McapError) -> String {
    match cause {
        mcap::McapError::Io(system) => system.to_string(),
        other => other.to_string(),
    }
}
