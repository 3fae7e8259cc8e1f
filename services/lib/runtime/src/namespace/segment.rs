//! The one segment of the transport that it opens to all users.
//!
//! Every node of a run opens it to take a number. A process that can write to it, or shorten it, can keep a run's
//! next process from joining, so that nothing replaces a controller that has died. The transport has no setting for
//! it, but takes the segment as it finds it; so the run is founded with one that is its owner's alone.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

/// Its name behind the prefix, in iceoryx2 0.10.0, whose version is pinned.
const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
/// The version, 16 bits for each part, and how many nodes there have been.
const CONTENT: [u64; 2] = [10 << 16, 0];

/// Makes the segment of the run whose objects have this prefix in `base`.
pub(super) fn make_private(base: &Path, prefix: &str) -> io::Result<()> {
    let mut file =
        OpenOptions::new().write(true).create_new(true).mode(0o600).open(path(base, prefix))?;
    file.write_all(CONTENT.map(u64::to_ne_bytes).as_flattened())
}

/// Removes it, if the run could not be founded.
pub(super) fn remove(base: &Path, prefix: &str) {
    let _ = fs::remove_file(path(base, prefix));
}

fn path(base: &Path, prefix: &str) -> PathBuf {
    base.join(format!("{prefix}{NAME}"))
}

#[cfg(test)]
mod tests {
    use super::super::BASE;
    use super::*;
    use iceoryx2::prelude::{Config, FileName, NodeBuilder, SemanticString as _, ipc};

    #[test]
    fn the_transport_makes_a_segment_of_this_name_and_content() {
        let prefix = format!("mqshm-segment{}_", std::process::id());
        let root = tempfile::tempdir().unwrap();
        let mut config = Config::default();
        config.global.prefix = FileName::new(prefix.as_bytes()).unwrap();
        config.global.set_root_path(&root.path().to_str().unwrap().try_into().unwrap());
        drop(NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap());
        let bytes = fs::read(path(Path::new(BASE), &prefix));
        for entry in fs::read_dir(BASE).unwrap().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                fs::remove_file(entry.path()).unwrap();
            }
        }
        let [version, _] = CONTENT.map(u64::to_ne_bytes);
        let bytes = bytes.unwrap();
        assert_eq!((&bytes[..8], bytes.len()), (&version[..], size_of_val(&CONTENT)));
    }
}
