//! The control groups that a process is in, as a container is one.

use std::fs;
use std::path::{Path, PathBuf};

/// A group that the process is in.
pub(crate) struct Group {
    /// Its folder.
    pub(crate) folder: PathBuf,
    /// Whether it is of version 2.
    pub(crate) is_unified: bool,
}

/// The groups that a controller, such as `memory`, limits, where the kernel's files are below `root`.
pub(crate) fn groups_of(root: &Path, controller: &str) -> Vec<Group> {
    let text = fs::read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    let mut found = Vec::new();
    for line in text.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(group)) = (parts.next(), parts.next()) else { continue };
        let mounts = match controllers {
            "" => vec!["sys/fs/cgroup".to_owned(), "sys/fs/cgroup/unified".to_owned()],
            listed if listed.split(',').any(|one| one == controller) => {
                vec![format!("sys/fs/cgroup/{controller}")]
            }
            _ => continue,
        };
        let (is_unified, group) =
            (controllers.is_empty(), Path::new(group.trim_start_matches('/')));
        for mount in mounts {
            // In a container the path may be that of the host, which is not there; its own group is the mount then.
            let folders = group.ancestors().map(|above| root.join(&mount).join(above));
            found.extend(folders.map(|folder| Group { folder, is_unified }));
        }
    }
    found
}

/// The number that a file of a group consists of; none for `max`, and where there is no such file.
pub(crate) fn number_in(file: &Path) -> Option<u64> {
    fs::read_to_string(file).ok()?.trim().parse().ok()
}

/// A folder in which the kernel's files have these texts.
#[cfg(test)]
pub(crate) fn root_with(files: &[(&str, &str)]) -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = root.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    root
}
