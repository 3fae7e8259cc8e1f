//! Memory that a process can still have: of the machine, and of the control groups that it is in, as a container is one.
//!
//! A file system of shared memory reports how large it may become and not whether there is memory
//! for it. A page that a group may not have ends one of its processes, whichever the kernel
//! chooses.

use crate::control_group::{Group, groups_of, number_in};
use std::fs;
use std::path::{Path, PathBuf};

/// Memory that can still be had, and what bounds it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Available {
    /// What is left \[MB\].
    pub mb: u64,
    /// File of the kernel that reports it.
    pub by: PathBuf,
}

impl Available {
    /// To this process; none where the system does not report it.
    #[must_use]
    pub fn here() -> Option<Self> {
        Self::below(Path::new("/"))
    }

    /// The same where the kernel's files are below `root`.
    #[must_use]
    pub fn below(root: &Path) -> Option<Self> {
        groups(root).chain(of_machine(root)).min_by_key(|found| found.mb)
    }
}

fn of_machine(root: &Path) -> Option<Available> {
    let by = root.join("proc/meminfo");
    let text = fs::read_to_string(&by).ok()?;
    Some(Available { mb: field(&text, "MemAvailable:")? >> 10, by })
}

/// Value of a line that begins with `name`.
fn field(text: &str, name: &str) -> Option<u64> {
    let values = text.lines().find_map(|line| line.strip_prefix(name));
    values?.split_whitespace().next()?.parse().ok()
}

/// What is left to each group with a limit that the process is in.
fn groups(root: &Path) -> impl Iterator<Item = Available> {
    groups_of(root, "memory").into_iter().filter_map(|group| left_to(&group))
}

/// What is left to a group; none without a limit.
fn left_to(Group { folder, is_unified }: &Group) -> Option<Available> {
    // Files of the limit and of what is used, and what stands before the names that count the groups below too.
    let (limit, used, prefix) = if *is_unified {
        ("memory.max", "memory.current", "")
    } else {
        ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_")
    };
    let by = folder.join(limit);
    let (limit, used) = (number_in(&by)?, number_in(&folder.join(used))?);
    let stat = fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
    let pages = |name: &str| field(&stat, &format!("{prefix}{name} ")).unwrap_or(0);
    // Files that the kernel keeps as long as there is room are given back first; shared memory is not among them.
    let kept = pages("active_file") + pages("inactive_file");
    let left = limit.saturating_sub(used.saturating_sub(kept));
    Some(Available { mb: left >> 20, by })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control_group::root_with;

    const MB: u64 = 1 << 20;

    /// What is left where the kernel's files have these texts.
    fn available(files: &[(&str, &str)]) -> Option<(u64, String)> {
        let root = root_with(files);
        let found = Available::below(root.path())?;
        let by = found.by.strip_prefix(root.path()).unwrap();
        Some((found.mb, by.display().to_string()))
    }

    const MACHINE: (&str, &str) =
        ("proc/meminfo", "MemTotal: 9000000 kB\nMemAvailable:  4096000 kB\n");

    #[test]
    fn without_a_limit_the_machine_decides_what_is_left() {
        assert_eq!(available(&[]), None);
        let by_machine = Some((4000, "proc/meminfo".to_owned()));
        assert_eq!(available(&[MACHINE]), by_machine);
        let unlimited = [
            MACHINE,
            ("proc/self/cgroup", "0::/a\n"),
            ("sys/fs/cgroup/a/memory.max", "max\n"),
            ("sys/fs/cgroup/a/memory.current", "1\n"),
        ];
        assert_eq!(available(&unlimited), by_machine);
    }

    #[test]
    fn the_narrowest_group_counts_and_pages_of_files_are_given_back() {
        let (limit, used) = ((512 * MB).to_string(), (300 * MB).to_string());
        let stat = format!("anon 1\ninactive_file {}\nactive_file {}\n", 30 * MB, 20 * MB);
        let (wide, little) = ((900 * MB).to_string(), MB.to_string());
        let mut files = vec![
            MACHINE,
            ("proc/self/cgroup", "1:name=systemd:/\n0::/a/b\n"),
            ("sys/fs/cgroup/a/memory.max", limit.as_str()),
            ("sys/fs/cgroup/a/memory.current", used.as_str()),
            ("sys/fs/cgroup/a/memory.stat", stat.as_str()),
            ("sys/fs/cgroup/a/b/memory.max", wide.as_str()),
            ("sys/fs/cgroup/a/b/memory.current", little.as_str()),
        ];
        let expected = Some((262, "sys/fs/cgroup/a/memory.max".to_owned()));
        assert_eq!(available(&files), expected);
        // The wider one no longer is once it is used.
        let full = (950 * MB).to_string();
        files[6].1 = &full;
        assert_eq!(available(&files), Some((0, "sys/fs/cgroup/a/b/memory.max".to_owned())));
    }

    #[test]
    fn a_container_whose_group_is_named_as_on_the_host_has_its_limit_at_the_mount() {
        let (limit, used) = ((200 * MB).to_string(), (50 * MB).to_string());
        let stat = format!("inactive_file 0\ntotal_inactive_file {}\n", 10 * MB);
        for line in ["4:memory:/docker/0123\n", "4:cpu,memory:/\n"] {
            let found = available(&[
                MACHINE,
                ("proc/self/cgroup", line),
                ("sys/fs/cgroup/memory/memory.limit_in_bytes", &limit),
                ("sys/fs/cgroup/memory/memory.usage_in_bytes", &used),
                ("sys/fs/cgroup/memory/memory.stat", &stat),
            ]);
            let by = "sys/fs/cgroup/memory/memory.limit_in_bytes".to_owned();
            assert_eq!(found, Some((160, by)), "{line}");
        }
    }
}
