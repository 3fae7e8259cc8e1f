//! The one segment of the transport that it opens to all users.
//!
//! Every node of a run opens it to take a number. Whoever can write to it, or shorten it, can keep a run's next process
//! from joining, so that nothing replaces a controller that has died.

use iceoryx2::prelude::{Config, FileName, NodeBuilder, SemanticString as _, SignalHandlingMode};
use rustix::rand::{GetRandomFlags, getrandom};
use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use super::Ipc;
use crate::namespace::BASE;

const SUFFIX: &str = ".global_mgmt";

/// Makes the segment of the run that `config` describes, open to its owner alone, if there is none.
///
/// The transport has no setting for it, and a file that was open to all for an instant may be kept open for ever. So the
/// transport makes one under another name, which is read, written to a file of ours, and removed.
pub(super) fn close(config: &Config) -> io::Result<()> {
    let prefix = config.global.prefix.to_string();
    if find(&prefix)?.is_some() {
        return Ok(());
    }
    let other = other_prefix(&prefix)?;
    let mut beside = config.clone();
    beside.global.prefix = FileName::new(other.as_bytes()).map_err(failed)?;
    let node = NodeBuilder::new()
        .config(&beside)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .map_err(failed)?;
    drop(node);
    let Some((open, rest)) = find(&other)? else {
        return Err(io::Error::new(ErrorKind::NotFound, "the transport has made no segment"));
    };
    let bytes = fs::read(&open);
    fs::remove_file(&open)?;
    let closed = Path::new(BASE).join(format!("{prefix}{rest}"));
    OpenOptions::new().write(true).create_new(true).mode(0o600).open(closed)?.write_all(&bytes?)
}

/// The segment of the run whose objects have this prefix, and its name behind the prefix.
fn find(prefix: &str) -> io::Result<Option<(PathBuf, String)>> {
    for entry in fs::read_dir(BASE)? {
        let entry = entry?;
        let name = entry.file_name();
        let rest = name.to_str().and_then(|name| name.strip_prefix(prefix));
        if let Some(rest) = rest.filter(|rest| rest.ends_with(SUFFIX)) {
            return Ok(Some((entry.path(), rest.to_owned())));
        }
    }
    Ok(None)
}

/// A prefix of the same run that cannot be guessed either.
fn other_prefix(prefix: &str) -> io::Result<String> {
    let mut secret = [0; 8];
    getrandom(&mut secret, GetRandomFlags::empty())?;
    let run = prefix.trim_end_matches('_').rsplit_once('_').map_or(prefix, |(run, _)| run);
    Ok(format!("{run}_{:016x}_", u64::from_le_bytes(secret)))
}

fn failed(error: impl core::fmt::Debug) -> io::Error {
    io::Error::other(format!("{error:?}"))
}
