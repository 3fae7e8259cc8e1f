//! Which connection is the launcher's: a file in the run's folder names it, which only its user can write.
//!
//! A process id would be no proof, since ids are used again; the transport never gives the same identity twice, and no
//! client of it can choose its own.

use shared_types::NodeId;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Digits of an identity in the file.
const DIGITS: usize = 32;

/// The file's path in a run's folder.
pub(super) fn path_in(folder: &Path) -> PathBuf {
    folder.join("launcher.node")
}

/// Names `node` as the launcher's connection, whole or not at all.
///
/// # Errors
/// The folder cannot be written.
pub(super) fn claim(folder: &Path, [high, low]: NodeId) -> io::Result<()> {
    let fresh = folder.join(".launcher.node");
    fs::write(&fresh, format!("{high:016x}{low:016x}\n"))?;
    fs::rename(fresh, path_in(folder))
}

/// The launcher's connection; none as long as none has been named. Allocates nothing.
pub(super) fn claimed(path: &Path) -> Option<NodeId> {
    let mut digits = [0; DIGITS];
    File::open(path).and_then(|mut file| file.read_exact(&mut digits)).ok()?;
    let (high, low) = core::str::from_utf8(&digits).ok()?.split_at_checked(DIGITS / 2)?;
    Some([u64::from_str_radix(high, 16).ok()?, u64::from_str_radix(low, 16).ok()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_connection_that_claimed_to_lead_is_found() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = path_in(folder.path());
        assert_eq!(claimed(&path), None);
        for node in [[7, u64::MAX], [u64::MAX - 1, 0]] {
            claim(folder.path(), node).unwrap();
            assert_eq!(claimed(&path), Some(node));
        }
        for spoilt in ["", "0123456789abcdef", "0123456789abcdef_123456789abcdef"] {
            fs::write(&path, spoilt).unwrap();
            assert_eq!(claimed(&path), None, "{spoilt}");
        }
    }
}
