//! `morphquad study`: what is on stdout, in the folder and in the exit code.

use crate::common::morphquad;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Exit code, stdout and stderr; without a folder the results go where no test looks.
fn study(arguments: &str, out: Option<&Path>) -> (Option<i32>, String, String) {
    let scratch = TempDir::new().expect("a folder");
    let mut command = morphquad(["study"].into_iter().chain(arguments.split_whitespace()));
    command.arg("--out").arg(out.unwrap_or(scratch.path()));
    let output = command.output().expect("the executable starts");
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("text");
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// Every file of a folder by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).expect("the folder is there").map(|e| e.expect("an entry"));
    let file = |entry: fs::DirEntry| {
        let name = entry.file_name().into_string().expect("a name");
        (name, fs::read(entry.path()).expect("a file"))
    };
    entries.map(file).collect()
}

fn assert_same_twice(arguments: &str, names: &[&str]) -> (String, Value) {
    let scratch = TempDir::new().expect("a folder");
    let runs = ["first", "second"].map(|name| {
        let folder = scratch.path().join("deep").join(name);
        let (code, out, stderr) = study(arguments, Some(&folder));
        assert_eq!((code, stderr.as_str()), (Some(0), ""), "{out}");
        (out, files(&folder))
    });
    let [(out, first), (_, second)] = runs;
    assert_eq!(first.keys().map(String::as_str).collect::<Vec<_>>(), names);
    assert!(first == second, "the files of two runs differ");
    for (name, content) in &first {
        assert!(content.len() > 100, "{name}");
        assert!(!name.contains(".svg") || content.starts_with(b"<svg"), "{name}");
    }
    let json = first.iter().find(|(name, _)| name.contains(".json")).expect("a JSON file").1;
    (out, serde_json::from_slice(json).expect("JSON"))
}

#[test]
fn a_quick_morphing_study_holds_its_marks_and_leaves_the_same_files_each_time() {
    let names = ["morphing-flights.csv", "morphing.csv", "morphing.json", "morphing.svg"];
    let (out, json) = assert_same_twice("morphing --quick --seeds 2", &names);
    assert_eq!(out.lines().filter(|line| line.ends_with("holds")).count(), 4, "{out}");
    assert!(!out.contains("FAILS"), "{out}");
    assert_eq!(json["marks"].as_array().map(Vec::len), Some(4));
    // Two states, four laws, two sweeps.
    assert_eq!(json["cells"].as_array().map(Vec::len), Some(16));
    let of_45 = json["cells"].as_array().expect("cells").iter();
    let mut of_45 = of_45.filter(|cell| cell["model"] == "fixed 45 deg");
    assert!(of_45.all(|cell| cell["verdict"] == "lost"));
}

#[test]
fn a_quick_stability_study_shows_limits_and_leaves_the_same_files_each_time() {
    let names = [
        "stability-limits.csv",
        "stability-linear.svg",
        "stability-map.csv",
        "stability-nonlinear.svg",
        "stability-settling.csv",
        "stability.json",
    ];
    let (out, json) = assert_same_twice("stability --quick", &names);
    assert!(out.contains("rotor lag"), "{out}");
    // Two models, two weights, three quantities.
    assert_eq!(json["limits"].as_array().map(Vec::len), Some(12));
}

#[test]
fn random_flights_are_the_same_twice_and_the_worst_can_be_flown_again() {
    let names = ["random-flights.csv", "random-flights.json", "random-flights.svg"];
    let (out, json) =
        assert_same_twice("random --seeds 1..2 --set scenario.duration_s=5.0", &names);
    assert!(out.contains("90 % within mm"), "{out}");
    let flights = json["flights"].as_array().expect("flights");
    let left_out = json["left_out"].as_array().expect("a list");
    assert_eq!(flights.len() + left_out.len(), 2);
    let flight = &flights[0];
    let again = flight["again"].as_str().expect("a command");
    let again = again.strip_prefix("morphquad ").expect("the command");
    let shell = format!("\"$0\" {again} --in-process --no-record --format json");
    let mut command = std::process::Command::new("sh");
    command.args(["-c", &shell, env!("CARGO_BIN_EXE_morphquad")]);
    let output = command.output().expect("a shell");
    let summary: Value = serde_json::from_slice(&output.stdout).expect("a summary");
    let apart = flight["max_m"].as_f64().zip(summary["tracking_max_m"].as_f64());
    assert!(apart.is_some_and(|(studied, flown)| (studied - flown).abs() < 1e-6), "{apart:?}");
}

#[test]
fn json_on_stdout_is_one_object_and_nothing_else() {
    for arguments in ["morphing --quick --seeds 1 --format json", "stability --quick --format json"]
    {
        let (code, out, stderr) = study(arguments, None);
        assert_eq!((code, stderr.as_str()), (Some(0), ""), "{arguments}");
        assert!(serde_json::from_str::<Value>(&out).expect("JSON").is_object());
    }
}

#[test]
fn the_stability_of_other_sizes_and_rates_can_be_asked_for() {
    let (code, out, stderr) = study("stability --quick --rate 150 --angle 160", None);
    assert_eq!(code, Some(0), "{stderr}");
    assert!(out.contains("150 Hz, 160 degrees"), "{out}");
}

#[test]
fn impossible_requests_end_with_2_and_a_remedy_and_an_unwritable_folder_with_3() {
    for (bad, flag, remedy) in [
        ("stability --angle 200", "--angle", "help:"),
        ("stability --rate 5000", "--rate", "give 50 to 1000 Hz"),
        ("stability --rate nan", "--rate", "give 50 to 1000 Hz"),
        ("random --seeds 9..1", "--seeds", "the smaller seed first"),
        ("random --seeds 0..9000000", "--seeds", "split it"),
        ("random --set position_mpc.tilt_wait=2", "tilt_wait", "tilt_weight"),
        ("random --controller position=nothing", "nothing", "position-pid"),
    ] {
        let (code, out, stderr) = study(bad, None);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{bad}: {stderr}");
        assert!(stderr.contains(flag) && stderr.contains(remedy), "{bad}: {stderr}");
    }
    for bad in ["morphing --seeds 0", "morphing --seeds many", "stability --rate fast", "mopping"] {
        let (code, out, _) = study(bad, None);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{bad}");
    }
    for command in ["morphing --quick", "stability --quick"] {
        let (code, out, stderr) = study(command, Some(Path::new("/dev/null/results")));
        assert_eq!((code, out.as_str()), (Some(3), ""), "{command}: {stderr}");
        assert!(stderr.contains("/dev/null/results") && stderr.contains("--out"), "{stderr}");
    }
}
