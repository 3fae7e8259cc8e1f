//! Machines made of a few files, for the tests of the checks.

use super::{Finding, Machine, Verdict};
use std::fs;
use tempfile::TempDir;

pub(super) type Check = fn(&Machine) -> Finding;

/// A machine with these files alone.
pub(super) fn machine(files: &[(&str, &str)]) -> (TempDir, Machine) {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = folder.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let root = folder.path().to_path_buf();
    (folder, Machine { root })
}

pub(super) fn verdict(check: Check, files: &[(&str, &str)]) -> Verdict {
    let (_folder, machine) = machine(files);
    let finding = check(&machine);
    assert_eq!(finding.verdict == Verdict::Ok, finding.remedy.is_empty(), "{finding:?}");
    finding.verdict
}
