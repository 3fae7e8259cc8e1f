//! The examination of a machine: enough checks, quick, and honest about what it mends.

use crate::common::morphquad;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

fn doctor(arguments: &[&str]) -> (Option<i32>, Value, String) {
    let folder = TempDir::new().expect("a folder");
    let mut command = morphquad(["doctor", "--record"]);
    command.arg(folder.path()).args(arguments);
    let output = command.output().expect("the executable starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let left = fs::read_dir(folder.path()).expect("the folder is there").count();
    assert_eq!(left, 0, "the trial file is removed");
    (output.status.code(), serde_json::from_str(&text).unwrap_or(Value::Null), text)
}

#[test]
fn there_are_enough_checks_and_each_that_is_not_ok_has_a_remedy() {
    let (code, json, _) = doctor(&["--format", "json"]);
    let checks = json["checks"].as_array().expect("checks");
    assert!(checks.len() >= 25, "{}", checks.len());
    let mut names: Vec<_> = checks.iter().map(|c| c["check"].as_str().expect("a name")).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), checks.len(), "no name comes twice");
    let count = |verdict: &str| checks.iter().filter(|c| c["verdict"] == verdict).count() as u64;
    for (key, verdict) in [("ok", "OK"), ("warn", "WARN"), ("fail", "FAIL")] {
        assert_eq!(json[key].as_u64(), Some(count(verdict)), "{json}");
    }
    for check in checks {
        let remedy = check["remedy"].as_str().expect("a remedy");
        assert_eq!(check["verdict"] == "OK", remedy.is_empty(), "{check}");
    }
    let fit = count("FAIL") == 0;
    assert_eq!(json["fit"].as_bool(), Some(fit));
    assert_eq!(code, Some(if fit { 0 } else { 3 }));
}

#[test]
fn a_folder_in_which_no_user_can_record_makes_the_machine_unfit() {
    // Also for the superuser.
    let output = morphquad(["doctor", "--record", "/proc/self"]).output().expect("it starts");
    assert_eq!(output.status.code(), Some(3));
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().find(|line| line.starts_with("FAIL  disk rate"));
    assert!(line.is_some_and(|line| line.contains(" -> ")), "{text}");
}

#[test]
fn what_dead_runs_have_left_is_listed_first_and_removed_only_if_asked_for() {
    let object = format!("/dev/shm/mqshm-dead{:x}_left", std::process::id());
    let object = Path::new(&object);
    let file = fs::File::create(object).expect("shared memory");
    file.set_modified(std::time::UNIX_EPOCH).expect("an old file");
    let leftovers = |json: &Value| {
        let checks = json["checks"].as_array().expect("checks").clone();
        checks.into_iter().find(|check| check["check"] == "leftovers").expect("it is looked for")
    };
    let (_, json, _) = doctor(&["--format", "json"]);
    assert_eq!(leftovers(&json)["verdict"], "WARN", "{json}");
    assert!(object.exists());
    let (_, json, _) = doctor(&["--fix", "--format", "json"]);
    assert!(!object.exists());
    let fixed = json["fixed"].as_array().expect("a list");
    assert!(!fixed.is_empty(), "{json}");
}
