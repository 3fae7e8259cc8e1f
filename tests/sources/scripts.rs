//! The scripts of the gate decide nothing by luck.

use std::fs;
use std::path::Path;

/// Commands that may end before they have read all of their input. What writes to them then ends by SIGPIPE, or does
/// not, as the two happen to be scheduled, and with `pipefail` so does the script.
const EARLY: [&str; 4] = ["head", "grep -q", "grep -m", "grep --quiet"];

/// Commands of a line behind a pipe that may end before what writes to them.
fn ended_early(line: &str) -> Vec<&str> {
    // One command instead of another, `||`, reads nothing of it.
    let pipelines = line.split("||");
    let readers = pipelines.flat_map(|pipeline| pipeline.split('|').skip(1)).map(str::trim_start);
    readers.filter(|reader| EARLY.iter().any(|early| reader.starts_with(early))).collect()
}

#[test]
fn no_script_ends_a_pipe_before_its_writer_has_written() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let gate = fs::read_dir(root.join(".ci"))
        .expect("readable")
        .map(|entry| entry.expect("readable").path());
    let helpers = ["javascript/setup.sh", "page/browser.sh", "python/setup.sh"];
    let scripts: Vec<_> =
        gate.chain(helpers.iter().map(|name| root.join("tests").join(name))).collect();
    assert!(scripts.len() > helpers.len());
    for script in scripts {
        let text = fs::read_to_string(&script).expect("readable");
        for (number, line) in text.lines().enumerate() {
            let found = ended_early(line);
            assert!(
                found.is_empty(),
                "{}:{}: {found:?} may end by luck",
                script.display(),
                number + 1
            );
        }
    }
    assert_eq!(ended_early("sort -rn times | head -n 10 | awk '{ print }'"), ["head -n 10 "]);
    assert!(ended_early("head -n 1 log || grep -q word log").is_empty());
}

#[test]
fn the_gate_runs_every_test_executable_of_the_root_package() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let script = fs::read_to_string(root.join(".ci/tests")).expect("readable");
    let mut named: Vec<&str> = script.split("--test ").skip(1).filter_map(first_word).collect();
    let entries = fs::read_dir(root.join("tests")).expect("readable");
    let mut targets: Vec<String> = entries
        .map(|entry| entry.expect("readable").path())
        .filter(|path| {
            path.extension().is_some_and(|end| end == "rs") || path.join("main.rs").is_file()
        })
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    targets.sort();
    assert!(targets.len() > 3);
    named.sort_unstable();
    assert_eq!(named, targets);
}

/// The word with which a text begins.
fn first_word(text: &str) -> Option<&str> {
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '-' && c != '_').next()
}
