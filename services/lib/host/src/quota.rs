//! How much processor time the control groups leave to a process that is in them.

use crate::control_group::{Group, groups_of, number_in};
use std::fs;
use std::path::{Path, PathBuf};

/// The tightest limit.
#[derive(Debug, Clone, PartialEq)]
pub struct Quota {
    /// Processors that all of the group's processes may keep busy together.
    pub processors: f64,
    /// File of the kernel that sets it.
    pub by: PathBuf,
}

impl Quota {
    /// Of this process, where the kernel's files are below `root`; none without a limit.
    #[must_use]
    pub fn below(root: &Path) -> Option<Self> {
        let limits = groups_of(root, "cpu").into_iter().filter_map(|group| limit_of(&group));
        limits.min_by(|a, b| a.processors.total_cmp(&b.processors))
    }
}

fn limit_of(Group { folder, is_unified }: &Group) -> Option<Quota> {
    if *is_unified {
        let by = folder.join("cpu.max");
        let text = fs::read_to_string(&by).ok()?;
        let mut fields = text.split_whitespace().map(str::parse::<f64>);
        let (Some(Ok(quota)), Some(Ok(period))) = (fields.next(), fields.next()) else {
            return None;
        };
        return Some(Quota { processors: quota / period, by });
    }
    let by = folder.join("cpu.cfs_quota_us");
    // It is -1 without a limit, which is not a number of this kind.
    let (quota, period) = (number_in(&by)?, number_in(&folder.join("cpu.cfs_period_us"))?);
    Some(Quota { processors: quota as f64 / period as f64, by })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control_group::root_with;

    fn quota(files: &[(&str, &str)]) -> Option<(f64, String)> {
        let root = root_with(files);
        let Quota { processors, by } = Quota::below(root.path())?;
        Some((processors, by.strip_prefix(root.path()).unwrap().display().to_string()))
    }

    #[test]
    fn the_tightest_group_above_limits_the_processor_time() {
        let own = ("proc/self/cgroup", "0::/user.slice/session.scope\n");
        let unlimited = ("sys/fs/cgroup/user.slice/session.scope/cpu.max", "max 100000\n");
        assert_eq!(quota(&[own, unlimited]), None);
        let above = ("sys/fs/cgroup/user.slice/cpu.max", "50000 100000\n");
        let expected = Some((0.5, above.0.to_owned()));
        assert_eq!(quota(&[own, unlimited, above]), expected);
    }

    #[test]
    fn a_container_of_version_1_is_limited_where_its_group_is_mounted() {
        let own = ("proc/self/cgroup", "4:cpu,cpuacct:/docker/1234\n");
        let period = ("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
        let file = "sys/fs/cgroup/cpu/cpu.cfs_quota_us";
        assert_eq!(quota(&[own, period, (file, "-1\n")]), None);
        assert_eq!(quota(&[own, period, (file, "150000\n")]), Some((1.5, file.to_owned())));
    }
}
