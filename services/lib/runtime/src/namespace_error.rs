//! What fails in the folder of a run.

use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a run's folder cannot be used.
#[derive(Debug, Error)]
#[error("{action} {path}: {source}; the run's folder must be writable by you and have free space")]
pub struct NamespaceError {
    action: &'static str,
    path: PathBuf,
    source: io::Error,
}

pub(crate) fn failed<'a>(
    action: &'static str,
    path: &'a Path,
) -> impl FnOnce(io::Error) -> NamespaceError + 'a {
    move |source| NamespaceError { action, path: path.to_path_buf(), source }
}
