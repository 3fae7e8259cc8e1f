//! `morphquad paper`: the real executable, its files, and its messages when it cannot write them.

use crate::common::morphquad;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Output;
use tempfile::TempDir;

/// Exit code for wrong usage or configuration.
const USAGE: i32 = 2;
/// Exit code for an environment that cannot be worked in.
const UNFIT: i32 = 3;
/// The only files with times of this machine in them.
const MEASURED: [&str; 4] =
    ["figure-4.svg", "paper.html", "summary.json", "test2-compute-time.csv"];

fn paper(out: &Path, arguments: &[&str]) -> Output {
    let out = out.display().to_string();
    let mut command = morphquad(["paper", "--out", &out]);
    command.args(arguments).output().expect("the executable starts")
}

fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
    let named = |entry: fs::DirEntry| {
        let name = entry.file_name().into_string().expect("a name");
        (name, fs::read(entry.path()).expect("a file"))
    };
    entries.map(named).collect()
}

/// Standard error, unwrapped.
fn stderr_text(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).replace(['│', '\n'], " ");
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn two_runs_pass_and_write_the_same_bytes_but_for_the_compute_times() {
    let folders = [TempDir::new().expect("a folder"), TempDir::new().expect("a folder")];
    let [first, second] = folders.each_ref().map(|folder| {
        let output = paper(&folder.path().join("deep/down"), &[]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr_text(&output));
        let text = String::from_utf8(output.stdout).expect("text");
        for expected in ["Test I:", "Test II:", "Test III:", "Not matched:", "figure-6.svg"] {
            assert!(text.contains(expected), "{expected}\n{text}");
        }
        assert!(!text.contains("FAILS"), "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= 150), "{text}");
        files(&folder.path().join("deep/down"))
    });
    assert_eq!(first.keys().collect::<Vec<_>>(), second.keys().collect::<Vec<_>>());
    for (name, bytes) in &first {
        let same = *bytes == second[name];
        assert!(same || MEASURED.contains(&name.as_str()), "{name} differs");
    }
    for name in [
        "figure-3.svg",
        "figure-4.svg",
        "figure-5.svg",
        "figure-6.svg",
        "paper.html",
        "test1-rates.csv",
        "test1-trajectories.csv",
        "test2-trajectories.json",
        "test3-rotors-1khz.csv",
    ] {
        assert!(first.contains_key(name), "{name} in {:?}", first.keys());
    }
}

#[test]
fn one_test_alone_is_printed_as_json_and_its_tables_are_rectangular() {
    let folder = TempDir::new().expect("a folder");
    let output = paper(folder.path(), &["--test", "3", "--format", "json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr_text(&output));
    let summary: Value = serde_json::from_slice(&output.stdout).expect("json");
    assert_eq!(summary["holds"], true);
    assert_eq!(summary["tests"].as_array().map(Vec::len), Some(1));
    let rows = &summary["tests"][0]["sections"]["test3-disturbance"]["rows"];
    let recoveries: Vec<_> = (0..3).map(|i| rows[i]["ours"].as_f64()).collect();
    assert_eq!(recoveries, [Some(0.05), Some(0.06), Some(0.06)]);

    let written = files(folder.path());
    for (name, bytes) in &written {
        assert!(
            name.starts_with("test3-")
                || MEASURED.contains(&name.as_str())
                || name.starts_with("figure-"),
            "{name}"
        );
        let text = std::str::from_utf8(bytes).expect("text");
        match name.rsplit('.').next() {
            Some("json") => assert!(serde_json::from_str::<Value>(text).is_ok(), "{name}"),
            Some("html") => {
                assert!(text.matches("<svg").count() == 2 && text.contains("cannot be matched"));
            }
            Some("svg") => {
                assert!(text.starts_with("<svg") && text.ends_with("</svg>"), "{name}");
                assert!(text.contains(" viewBox=\"0 0 "), "{name} does not scale");
                assert!(!text.contains("NaN") && !text.contains("inf"), "{name}");
            }
            _ => {
                // The reader refuses rows of different length.
                let rows: Result<Vec<_>, _> =
                    csv::Reader::from_reader(text.as_bytes()).records().collect();
                assert!(rows.is_ok_and(|rows| !rows.is_empty()), "{name}");
            }
        }
    }
    let samples = &written["test3-trajectories.csv"];
    let samples = String::from_utf8_lossy(samples);
    assert!(samples.starts_with("run,t_s,phi_rad,theta_rad,psi_rad,u_x_nm"), "{samples:.200}");
}

#[test]
fn what_is_no_test_or_no_form_is_named_and_nothing_is_written() {
    let folder = TempDir::new().expect("a folder");
    for (arguments, expected) in [
        (vec!["--test", "4"], "4"),
        (vec!["--test", "0"], "0"),
        (vec!["--test", "two"], "two"),
        (vec!["--format", "xml"], "xml"),
        (vec!["--outt", "x"], "--out"),
        (vec!["hover"], "hover"),
    ] {
        let output = paper(&folder.path().join("new"), &arguments);
        assert_eq!(output.status.code(), Some(USAGE), "{arguments:?}");
        assert!(
            output.stdout.is_empty() && stderr_text(&output).contains(expected),
            "{}",
            stderr_text(&output)
        );
    }
    assert!(!folder.path().join("new").exists());
}

#[test]
fn a_folder_that_cannot_be_and_a_full_disk_are_named_with_the_remedy() {
    let output = paper(Path::new("/dev/null/paper"), &["--test", "1"]);
    assert_eq!(output.status.code(), Some(UNFIT));
    let stderr = stderr_text(&output);
    assert!(output.stdout.is_empty() && stderr.contains("/dev/null/paper"), "{stderr}");
    assert!(stderr.contains("--out DIR"), "{stderr}");

    let folder = TempDir::new().expect("a folder");
    std::os::unix::fs::symlink("/dev/full", folder.path().join("figure-5.svg")).expect("a link");
    let output = paper(folder.path(), &["--test", "3"]);
    assert_eq!(output.status.code(), Some(UNFIT));
    let stderr = stderr_text(&output);
    assert!(output.stdout.is_empty() && stderr.contains("figure-5.svg"), "{stderr}");
    assert!(stderr.contains("space") && stderr.contains("--out DIR"), "{stderr}");
}
