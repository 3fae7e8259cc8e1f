//! `morphquad campaign` as its users meet it: killed, continued, its worst case flown again.

use crate::common::processes::kill;
use crate::common::time::wait_until;
use crate::common::{morphquad, rounds};
use rustix::process::Signal;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// 72 flights, some of which no vehicle survives and some of which no scenario allows.
const FILE: &str = r#"
    scenario = "figure8-morph"
    seeds = "0..11"
    worst = 3
    [set]
    scenario.duration_s = 2.0
    [grid]
    "plant.mismatch.mass_scale" = [1.0, 3.0, 50.0]
    attitude_mpc.prediction_horizon = [16, 20]
"#;
const CASES: usize = 72;
/// Exit code of a campaign in which a vehicle was lost.
const LOST: i32 = 1;

struct Bench {
    scratch: TempDir,
}

impl Bench {
    fn new(file: &str) -> Self {
        let scratch = TempDir::new().expect("a folder");
        fs::write(scratch.path().join("test.toml"), file).expect("a campaign file");
        Self { scratch }
    }

    fn out(&self, name: &str) -> PathBuf {
        self.scratch.path().join(name)
    }

    fn command(&self, out: &str, flags: &[&str]) -> Command {
        let mut command = morphquad(["campaign"]);
        command.arg(self.scratch.path().join("test.toml")).args(flags);
        command.args(["--format", "json", "--out"]).arg(self.out(out));
        command
    }

    fn run(&self, out: &str, flags: &[&str]) -> (Option<i32>, Value, String) {
        let output = self.command(out, flags).output().expect("the executable starts");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        let json = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        (output.status.code(), json, stderr)
    }

    fn tables(&self, out: &str) -> [Vec<u8>; 2] {
        let read = |name: &str| fs::read(self.out(out).join(name)).expect("a table");
        ["cases.csv", "cases.parquet"].map(read)
    }
}

fn lines(journal: &Path) -> usize {
    fs::read_to_string(journal).map_or(0, |text| text.matches('\n').count())
}

#[test]
fn killed_at_any_moment_and_started_again_it_makes_the_same_tables() {
    let bench = Bench::new(FILE);
    let (code, undisturbed, stderr) = bench.run("whole", &[]);
    assert_eq!(code, Some(LOST), "{stderr}");
    assert_eq!((&undisturbed["cases"], &undisturbed["resumed"]), (&CASES.into(), &0.into()));
    let outcomes = &undisturbed["outcomes"];
    assert_eq!((&outcomes["REFUSED"], &outcomes["CRASHED"]), (&24.into(), &0.into()));
    assert!(outcomes["LOST"].as_u64() > Some(0) && outcomes["PASSED"].as_u64() > Some(0));

    let journal = bench.out("killed").join("journal.jsonl");
    let mut before = 0;
    for _ in 0..rounds(4) {
        let mut child = bench.command("killed", &[]).spawn().expect("the executable starts");
        wait_until("a case more is flown", || lines(&journal) > before + 1);
        assert!(kill(child.id(), Signal::KILL));
        let _ = child.wait();
        let after = lines(&journal);
        assert!(after > before, "nothing was kept");
        before = after;
        if after >= CASES {
            break;
        }
    }
    let (code, resumed, stderr) = bench.run("killed", &[]);
    assert_eq!(code, Some(LOST), "{stderr}");
    assert_eq!(resumed["resumed"].as_u64(), Some(before as u64 - 1), "{resumed}");
    assert_eq!(lines(&journal), CASES + 1, "a case was flown twice");
    assert!(bench.tables("killed") == bench.tables("whole"), "the tables differ");
    assert_eq!(resumed["worst"], undisturbed["worst"]);
}

#[test]
fn the_command_of_a_worst_case_flies_it_again_with_a_recording() {
    let file = FILE.replace("0..11", "5").replace(", 50.0]", "]");
    let bench = Bench::new(&file);
    let (code, json, stderr) = bench.run("out", &[]);
    assert_eq!(code, Some(LOST), "{stderr}");
    for worst in json["worst"].as_array().expect("a list") {
        let command = worst["command"].as_str().expect("a command");
        let again = command.replacen("morphquad", env!("CARGO_BIN_EXE_morphquad"), 1);
        let records = bench.out("recordings");
        let again = format!("{again} --format json --record '{}'", records.display());
        let output = Command::new("sh").args(["-c", &again]).output().expect("a shell");
        let flown: Value = serde_json::from_slice(&output.stdout).expect("a summary");
        assert_eq!(flown["hash"], worst["hash"], "{command}");
        assert!(Path::new(flown["recording"].as_str().expect("a recording")).exists());
    }
}

#[test]
fn an_interrupt_keeps_what_was_flown_and_another_file_is_refused_until_restart() {
    let long = FILE.replace("duration_s = 2.0", "duration_s = 60.0");
    let bench = Bench::new(&long);
    let child = bench.command("out", &[]).spawn().expect("the executable starts");
    let journal = bench.out("out").join("journal.jsonl");
    wait_until("a case is flown", || lines(&journal) > 1);
    assert!(kill(child.id(), Signal::INT));
    let output = child.wait_with_output().expect("an end");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    let complaint: Value = serde_json::from_slice(&output.stdout).expect("a complaint");
    assert!(stderr.contains("kept") && complaint["exit"] == 130, "{stderr} {complaint}");
    assert!(!bench.out("out").join("cases.csv").exists());

    let other = FILE.replace("0..11", "0..1");
    fs::write(bench.scratch.path().join("test.toml"), other).expect("a campaign file");
    let (code, _, stderr) = bench.run("out", &[]);
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("another campaign") && stderr.contains("--restart"), "{stderr}");
    let (code, json, stderr) = bench.run("out", &["--restart"]);
    assert_eq!(
        (code, &json["cases"], &json["resumed"]),
        (Some(LOST), &12.into(), &0.into()),
        "{stderr}"
    );
}

#[test]
fn the_shipped_campaign_flies() {
    let shipped = include_str!("../../launcher/campaigns/robustness.toml");
    let brief = shipped.replace("duration_s = 10.0", "duration_s = 0.5").replace("0..9", "0..0");
    let (code, json, stderr) = Bench::new(&brief).run("out", &[]);
    assert_eq!(code, Some(0), "{stderr}");
    assert_eq!((&json["cases"], &json["outcomes"]["PASSED"]), (&36.into(), &36.into()));
}

#[test]
fn a_file_that_is_none_ends_with_2_and_an_unwritable_folder_with_3() {
    for (file, named) in [
        ("scenario = \"hoover\"", "hoover"),
        ("scenario = \"hover\"\nseeds = \"9..0\"", "backwards"),
        ("scenario = \"hover\"\n[set]\nplant.rate = 5", "rate"),
        ("scenario = \"hover\"\n[grid]\nplant.rate_hz = 5", "list"),
        // Keys that do not exist are known before the first case flies.
        ("scenario = \"hover\"\n[grid]\nplant.rate = [1, 2]", "test.toml:3:"),
        ("scenario = \"hover\"\n[grid]\nplant = { rate = [1, 2] }", "test.toml:3:"),
        ("scenario = \"hover\"\n[grid]\nrotor.lag_s = [1, 2]", "rotor"),
        ("scenario = \"hover\"\n[set]\nplant.rate_hertz = 5", "test.toml:3:"),
    ] {
        let (code, json, stderr) = Bench::new(file).run("out", &[]);
        assert_eq!((code, &json["exit"]), (Some(2), &2.into()), "{stderr}");
        assert!(stderr.contains(named) && stderr.contains("help"), "{stderr}");
    }
    // A value that no case can have is an outcome: no case flies, and the table states why.
    let none = Bench::new("scenario = \"hover\"\n[grid]\nplant.rate_hz = [-1, -2]");
    let (code, json, stderr) = none.run("out", &[]);
    assert_eq!((code, &json["outcomes"]["REFUSED"]), (Some(2), &2.into()), "{stderr}");
    let bench = Bench::new("scenario = \"hover\"");
    let mut command = morphquad(["campaign"]);
    command.arg(bench.scratch.path().join("test.toml")).args(["--out", "/dev/null/out"]);
    let output = command.output().expect("the executable starts");
    assert_eq!(output.status.code(), Some(3));
}
