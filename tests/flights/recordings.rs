//! Recordings by name: the latest, the beginning of a name, a name of one's own.

use crate::common::morphquad;
use serde_json::Value;
use std::path::Path;
use std::process::Output;
use tempfile::TempDir;

fn ask(folder: &Path, command_line: &str) -> Output {
    let arguments: Vec<&str> = command_line.split(' ').collect();
    morphquad(&arguments).current_dir(folder).output().expect("the executable starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn fly(folder: &Path, seed: u64, name: &str) {
    let command_line = format!("run hover --for 300ms --in-process --seed {seed} --name {name}");
    let flown = ask(folder, &command_line);
    assert_eq!(flown.status.code(), Some(0), "{}", text(&flown.stderr));
    assert!(folder.join("recordings").join(name).with_extension("mcap").exists());
}

#[test]
fn the_latest_recording_and_the_beginning_of_a_name_stand_for_a_file() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    fly(folder, 1, "windy-1");
    fly(folder, 2, "windy-2");
    for (command_line, file) in [
        ("report --format json", "windy-2"),
        ("report latest --format json", "windy-2"),
        ("report windy-1 --format json", "windy-1"),
        ("trace windy-1 --format json", "windy-1"),
        ("replay latest --hash --format json", "windy-2"),
        ("recordings show latest --format json", "windy-2"),
    ] {
        let output = ask(folder, command_line);
        assert_eq!(output.status.code(), Some(0), "{command_line}: {}", text(&output.stderr));
        let json: Value = serde_json::from_slice(&output.stdout).expect("one object");
        assert_eq!(json["file"], format!("recordings/{file}.mcap"), "{command_line}: {json}");
    }
    let implied = ask(folder, "report");
    let stderr = text(&implied.stderr);
    assert!(stderr.contains("the latest recording, recordings/windy-2.mcap"), "{stderr}");
    let several = ask(folder, "topic info windy");
    let stderr = text(&several.stderr);
    assert_eq!(several.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("windy-2, windy-1"), "{stderr}");
}

#[test]
fn a_command_that_is_printed_can_be_copied_into_a_shell() {
    let folder = TempDir::new().expect("a folder");
    let flown = morphquad(["run", "hover", "--for", "300ms", "--in-process", "--seed", "2"])
        .args(["--set", "scenario.name=\"mine\"", "--record", "sp ace", "--name", "one"])
        .current_dir(folder.path())
        .output()
        .expect("the executable starts");
    assert_eq!(flown.status.code(), Some(0), "{}", text(&flown.stderr));
    let report = morphquad(["report", "sp ace/one.mcap", "--format", "json"])
        .current_dir(folder.path())
        .output();
    let report: Value =
        serde_json::from_slice(&report.expect("it starts").stdout).expect("one object");
    let again = report["again"].as_str().expect("a command");
    let (program, arguments) = again.split_once(' ').expect("words");
    assert_eq!(program, "morphquad");
    let shell = format!("\"$0\" {arguments}");
    let output = std::process::Command::new("sh")
        .args(["-c", &shell, env!("CARGO_BIN_EXE_morphquad")])
        .current_dir(folder.path())
        .output()
        .expect("a shell");
    assert_eq!(output.status.code(), Some(0), "{again}: {}", text(&output.stderr));
}

#[test]
fn a_list_has_every_recording_and_a_name_is_never_given_twice() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    for command_line in ["recordings list", "report", "view --no-open"] {
        let output = ask(folder, command_line);
        let output_text = text(&output.stdout) + &text(&output.stderr);
        assert!(output_text.contains("`morphquad run` makes one"), "{command_line}: {output_text}");
    }
    fly(folder, 7, "one");
    std::fs::write(folder.join("recordings/none.mcap"), "no recording").expect("room");
    let mut cut = std::fs::read(folder.join("recordings/one.mcap")).expect("a recording");
    // Behind the first chunk.
    cut.truncate(cut.len() * 9 / 10);
    std::fs::write(folder.join("recordings/half.mcap"), cut).expect("room");
    let list = text(&ask(folder, "recordings list").stdout);
    let of = |name: &str| list.lines().find(|line| line.starts_with(name)).expect("a line");
    let columns: Vec<&str> = of("one").split_whitespace().collect();
    assert!(columns.contains(&"hover") && columns.contains(&"7"), "{list}");
    assert!(columns.contains(&"PASSED"), "{list}");
    assert!(of("half").split_whitespace().any(|column| column == "cut"), "{list}");
    assert!(of("none").contains("cannot be read"), "{list}");
    let json = ask(folder, "recordings list --format json").stdout;
    let json: Value = serde_json::from_slice(&json).expect("a list");
    let lines = json.as_array().expect("a list").iter().map(|recording| &recording["line"]);
    let passed =
        lines.filter(|line| line.as_str().is_some_and(|line| line.starts_with("PASSED  hover")));
    assert_eq!((json.as_array().map(Vec::len), passed.count()), (Some(3), 1), "{json}");

    let again = ask(folder, "run hover --for 300ms --in-process --name one");
    let stderr = text(&again.stderr);
    assert_eq!(again.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("recordings/one.mcap") && stderr.contains("--name"), "{stderr}");
    for name in ["../one", "latest", "hover", "imu", "_one", ""] {
        let output = morphquad(["run", "hover", "--name", name]).current_dir(folder).output();
        let output = output.expect("the executable starts");
        assert_eq!(output.status.code(), Some(2), "{name}: {}", text(&output.stderr));
    }
}
