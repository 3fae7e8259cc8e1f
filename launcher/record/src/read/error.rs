//! What can be wrong with a file that should be a recording.

use crate::DecodeError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a recording cannot be read; each names the file, what is wrong and the remedy.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The system cannot read it.
    #[error("cannot read {}: {cause}; give the path of a recording; `recordings list` shows which there are", path.display())]
    System {
        /// The file.
        path: PathBuf,
        /// The system's error.
        cause: std::io::Error,
    },
    /// Nothing in it.
    #[error("{} is empty: the run that made it died at once; fly again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Something else.
    #[error("{} is no morphquad recording: {what}; give a file that `morphquad run` wrote", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it lacks.
        what: String,
    },
    /// Cut before the first sample can be understood.
    #[error("{} is cut in its head, after {length} bytes: {what} is missing; fly again", path.display())]
    CutHead {
        /// The file.
        path: PathBuf,
        /// Its length \[bytes\].
        length: u64,
        /// What the head lacks.
        what: String,
    },
    /// Bytes that have changed since they were written.
    #[error("{} is damaged near byte {at} of {length}: {what}; copy it again from where it was recorded, or let `morphquad recover` save what can be read", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// How far it was read \[bytes\].
        at: u64,
        /// Its length \[bytes\].
        length: u64,
        /// What does not fit.
        what: String,
    },
    /// Recovered around damage.
    #[error("{} is what could be read of {from}, and {left_out} parts are missing in the middle: only a recording without holes can be flown again; copy that file again from where it was recorded, or look at this one with `report`, `view` or `topic`", path.display())]
    Holed {
        /// The file.
        path: PathBuf,
        /// The damaged file.
        from: String,
        /// Records and chunks that could not be read.
        left_out: u64,
    },
    /// A type has changed since.
    #[error(transparent)]
    Layout(#[from] Box<LayoutChange>),
    /// A topic that only one of the two builds has.
    #[error(
        "{}: topic {topic} of type {type_name} {what}; it was recorded by {recorder}: read it with that build",
        path.display()
    )]
    Topic {
        /// The file.
        path: PathBuf,
        topic: String,
        type_name: String,
        /// Which of the two lacks it.
        what: &'static str,
        /// Version of the recording build.
        recorder: String,
    },
    /// The scenario cannot be flown by this build.
    #[error("{}: the scenario in it is none for this build: {reason}; recorded by {recorder}", path.display())]
    Scenario {
        /// The file.
        path: PathBuf,
        /// The first complaint.
        reason: String,
        /// Version of the recording build.
        recorder: String,
    },
    /// What has to be kept of it is more than there is memory.
    #[error(
        "{} has {:.1} GB, of which up to {:.1} GB of memory would be filled, and {:.1} GB are free: end other \
         programs, or take a shorter recording; `report`, `trace`, `view`, `topic` and `replay --hash` take any length",
        path.display(), *length as f64 * 1e-9, *needed as f64 * 1e-9, *free as f64 * 1e-9
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its length \[bytes\].
        length: u64,
        /// Memory for its samples \[bytes\].
        needed: u64,
        /// Memory that there is \[bytes\].
        free: u64,
    },
    /// A record that is no message of its type.
    #[error("{}: a record on {topic} is not what its type describes: {error}", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// Where it was found.
        topic: String,
        /// The field.
        error: DecodeError,
    },
}

/// A type that file and build lay out differently.
#[derive(Debug, Error)]
#[error(
    "{}: type {type_name} of topic {topic} changed: the file, recorded by {recorder}, has layout {theirs}, \
     this build {ours}{detail}; read it with the build that recorded it",
    path.display()
)]
pub struct LayoutChange {
    /// The file.
    pub path: PathBuf,
    /// Topic it was found on.
    pub topic: String,
    /// Type that changed, the innermost that shows a difference.
    pub type_name: String,
    /// Layout hash in the file.
    pub theirs: String,
    /// Layout hash of this build.
    pub ours: String,
    /// Version of the recording build.
    pub recorder: String,
    /// What differs, as far as the file shows.
    pub detail: String,
}

impl ReadError {
    pub(super) fn system(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |cause| Self::System { path, cause }
    }
}
