//! A report agrees with the samples, fails by a gate that does not hold, and names what it cannot read.

use crate::common::misdeeds::{config_from, rogue};
use crate::common::{Flown, fly, morphquad};
use observe::FACTS;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Exit code, stdout and stderr of `morphquad report`.
fn report(file: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = morphquad(["report"]).arg(file).args(arguments).output();
    let output = output.expect("the executable starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn number<'a>(json: &'a Value, key: &str) -> &'a Value {
    let mut numbers = json["numbers"].as_array().expect("numbers").iter();
    numbers.find(|number| number["key"] == key).unwrap_or_else(|| panic!("no {key} in {json}"))
}

#[test]
fn a_report_opens_with_its_verdict_and_its_numbers_are_those_of_the_flight() {
    let swap = ["--swap", "attitude=attitude-lqr@1s,shadow=1s,rollback=0.5s"];
    let flown = fly(&[&["figure8-morph", "--for", "4s"], &swap[..]].concat());
    let folder = tempfile::tempdir().expect("a folder");
    let page = folder.path().join("report.html");
    let pictures = folder.path().join("pictures");
    let (code, out, err) = report(
        &flown.recording_path(),
        &["--html", &page.display().to_string(), "--png", &pictures.display().to_string()],
    );
    assert_eq!(code, Some(0), "{err}");
    assert!(out.starts_with("PASSED  figure8-morph: "), "{out:.200}");
    let page = fs::read_to_string(page).expect("the page");
    assert!(page.contains("<strong>PASSED  figure8-morph: "), "the page has no verdict");
    assert!(page.matches("<svg").count() >= 6 && !page.contains("http-equiv=\"refresh\""));
    for name in ["tracking", "constraints", "disturbance", "loops", "waterfall", "tails"] {
        let bytes = fs::read(pictures.join(format!("{name}.png"))).expect(name);
        assert!(bytes.starts_with(b"\x89PNG"), "{name}");
    }

    let (_, out, _) = report(&flown.recording_path(), &["--format", "json"]);
    let json: Value = serde_json::from_str(&out).expect("JSON");
    for key in FACTS.iter().map(|fact| fact.key).chain(["line", "verdict", "hash", "log_hash"]) {
        assert_eq!(json[key], flown.summary()[key], "{key}");
        // Of a rig alone.
        assert_eq!(json[key].is_null(), key == "attitude_end_rad", "{key}");
    }
    let value = |key: &str| number(&json, key)["value"].as_str().expect("a value").to_owned();
    assert_eq!(value("hash"), flown.hash());
    assert_eq!(value("position_max_m"), format!("{:.1} mm", flown.number("position_max_m") * 1e3));
    assert_eq!(value("samples"), flown.number("recorded_samples").to_string());
    assert_eq!(number(&json, "constraint_violations")["gate"], "0");
    assert!(json["swaps"][0]["done"].as_bool().expect("a swap"), "{}", json["swaps"]);
    let flip = &json["responses"][0];
    assert!(flip["what"].as_str().expect("words").contains("seat 1 commands"), "{flip}");
    let commands = json["numbers"].as_array().expect("numbers").iter().map(|n| &n["command"]);
    assert!(commands.clone().all(|command| command.as_str().is_some_and(|c| !c.is_empty())));
}

#[test]
fn the_command_that_a_report_names_flies_the_same_flight_again() {
    // As a user would: with settings that no scenario has, a flight is not flown again but verified.
    let folder = tempfile::tempdir().expect("a folder");
    let arguments = ["run", "hover", "--seed", "7", "--format", "json", "--record"];
    let output = morphquad(arguments).arg(folder.path()).output().expect("the executable starts");
    let flown = Flown::new(&output, folder);
    let (_, out, _) = report(&flown.recording_path(), &["--format", "json"]);
    let json: Value = serde_json::from_str(&out).expect("JSON");
    let command = json["again"].as_str().expect("a command");
    assert_eq!(command, "morphquad run hover --seed 7");
    let numbers = number(&json, "position_rms_m")["command"].as_str().expect("a command");
    assert!(numbers.starts_with("morphquad report "), "{numbers}");
    let arguments: Vec<_> = command.split(' ').skip(2).collect();
    assert_eq!(fly(&arguments).hash(), number(&json, "hash")["value"].as_str().expect("a hash"));
}

#[test]
fn a_cut_file_fails_and_shows_where_and_a_folder_is_judged_as_a_whole() {
    let flown = fly(&["hover", "--for", "2s"]);
    let folder = tempfile::tempdir().expect("a folder");
    let whole = fs::read(flown.recording_path()).expect("the recording");
    fs::write(folder.path().join("a.mcap"), &whole).expect("a disk with room");
    let (code, out, _) = report(folder.path(), &[]);
    assert_eq!(code, Some(0), "{out}");
    assert!(out.starts_with("PASSED  1 of 1 flights pass."), "{out}");
    fs::write(folder.path().join("b.mcap"), &whole[..whole.len() * 2 / 3]).expect("room");
    let (code, out, _) = report(folder.path(), &[]);
    assert_eq!(code, Some(1), "{out}");
    let failed = folder.path().join("b.mcap");
    let failed = format!("FAILED  1 of 2 flights pass, not {}", failed.display());
    assert!(out.starts_with(&format!("{failed}.")), "{out}");
    assert!(
        out.contains("b.mcap: INCOMPLETE  hover: flown 1.")
            && out.contains(": the file ends at 1."),
        "{out}"
    );
    fs::write(folder.path().join("c.mcap"), b"something else").expect("room");
    // The others are reported all the same.
    let (code, out, _) = report(folder.path(), &[]);
    assert_eq!(code, Some(2), "{out}");
    assert!(out.starts_with(&format!("{failed}, and a file cannot be read.")), "{out}");
    assert!(
        out.contains("a.mcap: PASSED") && out.contains("c.mcap is no morphquad recording"),
        "{out}"
    );
    // A complete copy stands for the file that it was made of.
    let cut = folder.path().join("b.mcap");
    let recovered = morphquad(["recover"]).arg(cut).output().expect("the executable starts");
    assert!(recovered.status.success(), "{recovered:?}");
    let (_, out, _) = report(folder.path(), &[]);
    assert!(out.starts_with("FAILED  1 of 2 flights pass, not "), "{out}");
    assert!(
        out.contains("b.mcap: recovered as ") && out.contains("b-recovered.mcap: INCOMPLETE"),
        "{out}"
    );
}

#[test]
fn a_vehicle_that_is_blown_away_and_comes_back_has_not_passed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("shove.toml");
    let shove = r#"
        [scenario]
        name = "shove"
        duration_s = 12.0

        [start]
        position_w_m = [0.0, 0.0, 5.0]

        [[disturbance_injector.script]]
        kind = "wind"
        at_s = 2.0
        until_s = 3.5
        mean_w_m_s = [14.0, 0.0, 0.0]
    "#;
    fs::write(&path, shove).expect("room");
    let flown = fly(&[path.to_str().expect("UTF-8")]);
    let (code, out, _) = report(&flown.recording_path(), &["--format", "json"]);
    let json: Value = serde_json::from_str(&out).expect("JSON");
    let largest = number(&json, "tracking_max_m");
    assert_eq!((code, &largest["holds"]), (Some(1), &Value::from(false)), "{largest}");
    let line = json["line"].as_str().expect("a line");
    assert!(line.starts_with("FAILED  shove: tracking error "), "{line}");
    let what: Vec<_> = json["responses"].as_array().expect("responses").iter().collect();
    let began = "wind of (14.000, 0.000, 0.000) m/s on average begins";
    assert!(what[0]["what"] == began && what[0]["at_s"] == 2.0, "{what:?}");
}

#[test]
fn a_folder_without_recordings_is_named_with_the_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let (code, _, err) = report(folder.path(), &[]);
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains(&*folder.path().display().to_string()) && err.contains("*.mcap"), "{err}");
}

#[test]
fn several_files_are_refused_with_their_folder_as_the_remedy() {
    let (code, out, err) = report(Path::new("flights/a.mcap"), &["flights/b.mcap"]);
    assert_eq!((code, out.as_str()), (Some(2), ""), "{err}");
    assert!(err.contains("`morphquad report flights`"), "{err}");
}

/// A flight in simulated time is to be one flight however often it is flown; a user's executable need not keep to that.
#[test]
fn an_executable_that_differs_from_run_to_run_is_named_with_where_it_does() {
    let folder = TempDir::new().expect("a folder");
    let switch = folder.path().join("switch");
    let config = config_from(&folder, "offset", &switch, 0.01);
    let swap = format!("attitude={}@1s,shadow=600ms,rollback=300ms,config={config}", rogue());
    let flight = ["hover", "--for", "3s", "--swap", &swap];
    let keep = |flown: &Flown, name: &str| {
        let path = folder.path().join(name);
        fs::copy(flown.recording_path(), &path).expect("room");
        path
    };
    let first = keep(&fly(&flight), "first.mcap");
    keep(&fly(&flight), "second.mcap");
    let parted = |file: &Path| {
        let (code, out, err) = report(file, &["--format", "json"]);
        assert_eq!(code, Some(0), "{err}");
        let report: Value = serde_json::from_str(&out).expect("JSON");
        report["parted"].clone()
    };
    assert_eq!(parted(&first), Value::Null);
    fs::write(&switch, "").expect("room");
    let third = keep(&fly(&flight), "third.mcap");
    for file in [&first, &third] {
        let parted = parted(file);
        assert_eq!(
            (&parted["writer"], &parted["topic"]),
            (&"rogue@1".into(), &"wrench_command".into())
        );
        assert_eq!(parted["at_s"], 1.0, "its first command");
        let (_, text, _) = report(file, &[]);
        assert!(text.contains("rogue@1 differs from run to run"), "{text:.2000}");
    }
    let (_, text, _) = report(folder.path(), &[]);
    assert_eq!(text.matches("rogue@1 differs from run to run").count(), 3, "{text}");
}
