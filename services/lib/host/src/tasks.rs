//! Processes and threads that may still be started: by this user, and in the control groups of this process.

use crate::control_group::{groups_of, number_in};
use crate::realtime::has_initial_users;
use core::fmt;
use rustix::process::{Resource, geteuid, getrlimit};
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

/// Processes and threads where their number is limited.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tasks {
    /// Those that are there.
    pub used: u64,
    /// As many as may be.
    pub limit: u64,
    /// The kernel's file with the limit; none for that of a user, `ulimit -u`.
    pub by: Option<PathBuf>,
}

impl Tasks {
    /// Where least are left; none where nothing limits them.
    #[must_use]
    pub fn here() -> Option<Self> {
        Self::of_groups(Path::new("/")).chain(Self::of_user()).min_by_key(Self::left)
    }

    /// As many as may still be started.
    #[must_use]
    pub fn left(&self) -> u64 {
        self.limit.saturating_sub(self.used)
    }

    /// What allows so many more.
    #[must_use]
    pub fn remedy(&self, more: u64) -> String {
        let enough = self.used.saturating_add(more);
        match &self.by {
            None => format!("`ulimit -u {enough}`, or raise nproc in /etc/security/limits.conf"),
            Some(by) => format!(
                "write {enough} to {}, or start the container with `--pids-limit {enough}`",
                by.display()
            ),
        }
    }

    fn of_user() -> Option<Self> {
        // The limit does not apply to root, whatever its value; to one that is root of its own namespace only, it does.
        let is_root = geteuid().is_root() && has_initial_users();
        let limit = getrlimit(Resource::Nproc).current.filter(|_| !is_root)?;
        let own = geteuid().as_raw();
        let processes = fs::read_dir("/proc").ok()?.flatten();
        let processes = processes.filter(|entry| {
            entry.file_name().to_string_lossy().parse::<u32>().is_ok()
                && entry.metadata().is_ok_and(|found| found.uid() == own)
        });
        let threads = processes
            .map(|entry| fs::read_dir(entry.path().join("task")).map_or(0, Iterator::count));
        Some(Self { used: threads.sum::<usize>() as u64, limit, by: None })
    }

    fn of_groups(root: &Path) -> impl Iterator<Item = Self> {
        groups_of(root, "pids").into_iter().filter_map(|group| {
            let by = group.folder.join("pids.max");
            let (limit, used) = (number_in(&by)?, number_in(&group.folder.join("pids.current"))?);
            Some(Self { used, limit, by: Some(by) })
        })
    }
}

impl fmt::Display for Tasks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { used, limit, by } = self;
        let whose = if by.is_some() { "this control group" } else { "this user" };
        write!(f, "{whose} has {used} of at most {limit} processes and threads")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control_group::root_with;

    #[test]
    fn the_group_that_leaves_least_counts_whichever_version_it_is_of() {
        let root = root_with(&[
            ("proc/self/cgroup", "5:pids:/a\n4:memory:/a\n0::/b/c\n"),
            ("sys/fs/cgroup/pids/a/pids.max", "max\n"),
            ("sys/fs/cgroup/pids/a/pids.current", "7\n"),
            ("sys/fs/cgroup/pids/pids.max", "300\n"),
            ("sys/fs/cgroup/pids/pids.current", "7\n"),
            ("sys/fs/cgroup/b/pids.max", "100\n"),
            ("sys/fs/cgroup/b/pids.current", "90\n"),
        ]);
        let found: Vec<_> = Tasks::of_groups(root.path()).collect();
        assert_eq!(found.iter().map(Tasks::left).collect::<Vec<_>>(), [293, 10]);
        let by = found[1].by.as_deref().and_then(|by| by.strip_prefix(root.path()).ok());
        assert_eq!(by, Some(Path::new("sys/fs/cgroup/b/pids.max")));
    }
}
