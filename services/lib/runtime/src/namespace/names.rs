//! Where runs live, and which names are theirs.

use rustix::fs::{Mode, OFlags, fstat, open};
use rustix::io::Errno;
use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Where run folders live: memory, so that nothing survives a reboot.
pub const BASE: &str = "/dev/shm";
pub(super) const FOLDER_PREFIX: &str = "mq-";
pub(super) const UNBORN_PREFIX: &str = ".mq-";
const OBJECT_PREFIX: &str = "mqshm-";

/// The run whose folder, founded or about to be, has this name; none if it is another's or nobody's. A run is named once
/// only: a folder that is named as if it were of two could have the objects of the other wiped.
pub(super) fn run_of_folder(name: &str) -> Option<&str> {
    let id = name.strip_prefix('.').unwrap_or(name).strip_prefix(FOLDER_PREFIX)?;
    is_id(id).then_some(id)
}

/// The run to which a shared-memory object of this name belongs.
pub(super) fn run_of_object(name: &str) -> Option<&str> {
    let (id, _) = name.strip_prefix(OBJECT_PREFIX)?.split_once('_')?;
    is_id(id).then_some(id)
}

/// Letters, digits and dashes: an underscore ends the id in the name of an object.
fn is_id(id: &str) -> bool {
    let is_whole = id.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-');
    is_whole && !id.is_empty() && !id.starts_with(FOLDER_PREFIX)
}

/// How the names of a run's shared-memory objects begin.
pub(super) fn object_prefix(id: &str) -> String {
    format!("{OBJECT_PREFIX}{id}_")
}

/// A folder that may be a run of this user, opened.
///
/// Anybody may put anything into [`BASE`]. What belongs to others, is open to them, is a link or lies on another device
/// is no run of this user, and is neither read nor locked, waited for or removed.
pub(super) fn open_own_folder(path: &Path) -> Option<File> {
    let flags =
        OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let folder = open(path, flags, Mode::empty()).ok()?;
    let found = fstat(&folder).ok()?;
    let base = rustix::fs::stat(path.parent()?).ok()?;
    let is_own = found.st_uid == rustix::process::geteuid().as_raw();
    let for_others = Mode::from_raw_mode(found.st_mode) & (Mode::RWXG | Mode::RWXO);
    let is_run = is_own && for_others.is_empty() && found.st_dev == base.st_dev;
    is_run.then(|| folder.into())
}

/// Refuses a folder of another user, who could have its reader believe anything. The system's administrator may join
/// every run.
pub(super) fn require_own(path: &Path) -> io::Result<()> {
    use std::os::unix::fs::MetadataExt as _;
    let found = fs::symlink_metadata(path)?;
    let own = rustix::process::geteuid();
    if found.is_dir() && (found.uid() == own.as_raw() || own.is_root()) {
        return Ok(());
    }
    let error = if found.is_dir() { Errno::PERM } else { Errno::NOTDIR };
    Err(error.into())
}
