//! Where runs live, and which names are theirs.

use rustix::fs::{Mode, OFlags, fstat, open};
use rustix::rand::{GetRandomFlags, getrandom};
use std::fs::File;
use std::io;
use std::path::Path;

/// Where run folders live: memory, so that nothing survives a reboot.
pub const BASE: &str = "/dev/shm";
pub(super) const FOLDER_PREFIX: &str = "mq-";
pub(super) const FOUNDING_PREFIX: &str = ".mq-";
const OBJECT_PREFIX: &str = "mqshm-";

/// The run whose folder has this name. An id never begins as a folder's name does, so that no name can be read as that
/// of two runs.
pub(super) fn run_of_folder(name: &str) -> Option<&str> {
    name.strip_prefix(FOLDER_PREFIX).filter(|id| is_id(id))
}

/// True of the name of a folder whose run is being founded; it gives no information about the run.
pub(super) fn is_being_founded(name: &str) -> bool {
    name.strip_prefix(FOUNDING_PREFIX).is_some_and(is_id)
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

/// 64 random bits as hexadecimal digits, for a name that another user cannot use first.
pub(super) fn random_digits() -> io::Result<String> {
    let mut bytes = [0; 8];
    getrandom(&mut bytes, GetRandomFlags::empty())?;
    Ok(format!("{:016x}", u64::from_ne_bytes(bytes)))
}

/// A folder that may be a run of this user, opened.
///
/// Any user may put anything into [`BASE`]. What belongs to others, is open to them, is a link or lies on another
/// device is no run of this user, and is neither read nor locked, waited for or removed.
pub(super) fn open_own_folder(path: &Path) -> io::Result<File> {
    let flags =
        OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let folder = open(path, flags, Mode::empty())?;
    let found = fstat(&folder)?;
    let base = rustix::fs::stat(path.parent().unwrap_or(path))?;
    let is_own = found.st_uid == rustix::process::geteuid().as_raw();
    let for_others = Mode::from_raw_mode(found.st_mode) & (Mode::RWXG | Mode::RWXO);
    if is_own && for_others.is_empty() && found.st_dev == base.st_dev {
        return Ok(folder.into());
    }
    Err(io::Error::other("it belongs to another user or is open to others"))
}
