//! All outputs agree on the verdict of a flight and its reason: text, JSON, exit code, the report on its
//! recording, its page, its case in a campaign and the last event of the recording.

use crate::common::processes::{Running, kill};
use crate::common::recording::Recording;
use crate::common::{Flown, Place, judged, morphquad};
use rustix::process::Signal;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use tempfile::TempDir;

/// A flight and its expected verdict: name, scenario, exit code, grade, and the beginning of its reason.
type Flight = (&'static str, &'static str, i32, &'static str, &'static str);

/// The vehicle hovers in still air unless the scenario sets another.
const FLIGHTS: [Flight; 9] = [
    (
        "good",
        "[[disturbance_injector.script]]\nkind = \"wind\"\nmean_w_m_s = [1.0, 0.0, 0.0]\n",
        0,
        "PASSED",
        "flown 5.000 s, tracking error ",
    ),
    (
        "killed",
        "[[fault]]\nkind = \"kill\"\nname = \"attitude-mpc\"\nat_s = 2.0\n",
        0,
        "PASSED",
        "flown 5.000 s, tracking error ",
    ),
    (
        "hurried",
        "[pilot]\nkind = \"figure8\"\nperiod_s = 1.6\nlead_in_s = 0.8\nlead_out_s = 0.8\n\
         center_w_m = [0.0, 0.0, 5.0]\n\
         [start]\nposition_w_m = [0.0, 0.0, 5.0]\n",
        1,
        "FAILED",
        "tracking error ",
    ),
    (
        "blown",
        "[start]\nposition_w_m = [0.0, 0.0, 5.0]\n[[disturbance_injector.script]]\nkind = \"wind\"\n\
         at_s = 0.5\nuntil_s = 1.5\nmean_w_m_s = [14.0, 0.0, 0.0]\n",
        1,
        "FAILED",
        "tracking error ",
    ),
    (
        "lying",
        "[start]\nposition_w_m = [0.0, 0.0, 0.1]\n[[disturbance_injector.script]]\nkind = \"step\"\n\
         at_s = 0.5\nuntil_s = 3.5\nload = { force_w_n = [0.0, 0.0, -6.0] }\n",
        1,
        "FAILED",
        "ground contact ",
    ),
    (
        "tilted",
        "[start]\nposition_w_m = [0.0, 0.0, 5.0]\n[[disturbance_injector.script]]\nkind = \"kick\"\n\
         at_s = 1.0\nbody_rate_b_rad_s = [25.0, 0.0, 0.0]\n[verdict]\ntracking_max_m = 1.0\n\
         tracking_sustained_max_m = 1.0\n",
        1,
        "FAILED",
        "tilt ",
    ),
    (
        "clipped",
        "[start]\nposition_w_m = [0.0, 0.0, 5.0]\n[[disturbance_injector.script]]\nkind = \"step\"\n\
         at_s = 1.0\nuntil_s = 1.9\nload = { torque_b_nm = [0.0, 0.0, 0.03] }\n\
         [verdict]\ntracking_max_m = 5.0\ntracking_sustained_max_m = 5.0\ntracking_rms_max_m = 5.0\n\
         heading_max_rad = 3.2\nclipped_max_share = 0.5\nclipped_max_s = 0.1\n",
        1,
        "FAILED",
        "rotors clipped without a break ",
    ),
    (
        // The noise of the estimated velocity alone is more than that.
        "unsolvable",
        "[position_mpc]\nspeed_max_m_s = 0.01\n",
        1,
        "FAILED",
        "steps without a solved optimum 99.6 % of position, limit 5 %",
    ),
    (
        // Half the weight to the side, which no tilt within the bound holds.
        "pushed",
        "[[disturbance_injector.script]]\nkind = \"constant\"\n\
         load = { force_w_n = [0.6, 0.0, 0.0] }\n",
        1,
        "LOST",
        "mean distance off its path in the last second ",
    ),
];

struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new() -> Self {
        Self { folder: TempDir::new().expect("a folder") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).expect("room");
        path
    }

    /// Writes the scenario of a flight of five seconds and returns its path.
    fn scenario(&self, (name, text, ..): &Flight) -> PathBuf {
        let head = format!("[scenario]\nname = \"{name}\"\nduration_s = 5.0\n");
        self.write(&format!("{name}.toml"), &(head + text))
    }
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn ask(arguments: &[&str], about: &Path) -> Output {
    morphquad(arguments).arg(about).output().expect("the executable starts")
}

fn json(output: &Output) -> Value {
    let stderr = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {stderr}"))
}

fn first_line(output: &Output) -> String {
    text(output).lines().next().unwrap_or_default().to_owned()
}

/// Asserts that every command that reads a recording gives exactly the verdict of `expected`.
fn assert_all_readers_agree(recording: &Path, expected: &Value, bench: &Bench) {
    let line = expected["line"].as_str().expect("a line");
    let verdict = &expected["verdict"];
    let passed = verdict["verdict"] == "PASSED";
    let report = ask(&["report"], recording);
    assert_eq!(first_line(&report), line);
    assert_eq!(report.status.code(), Some(i32::from(!passed)), "{line}");
    let report = json(&ask(&["report", "--format", "json"], recording));
    assert_eq!((&report["verdict"], &report["line"]), (verdict, &line.into()));
    assert_eq!(report["pass"], passed, "{line}");
    let page = bench.path("page.html");
    let viewed = morphquad(["view"]).arg(recording).arg("--out").arg(&page).output();
    assert!(viewed.expect("the executable starts").status.success());
    let page = fs::read_to_string(page).expect("the page");
    let (_, flight) = page.split_once("type=\"application/json\">").expect("the flight");
    let (flight, _) = flight.split_once("</script>").expect("its end");
    let flight: Value = serde_json::from_str(flight).expect("JSON");
    let outcome = &flight["outcome"];
    assert_eq!((&outcome["text"], &outcome["is_good"]), (&line.into(), &passed.into()));
    assert_eq!(&outcome["verdict"], verdict);
}

/// Asserts that the last event of a recording is the verdict line of its flight.
fn assert_last_event_is(recording: &Path, line: &str) {
    let echo = morphquad(["topic", "echo", "events", "--format", "jsonl"]).arg(recording).output();
    let echo = text(&echo.expect("the executable starts"));
    let last: Value = serde_json::from_str(echo.lines().last().expect("an event")).expect("JSON");
    assert_eq!(last["events"]["text"], line);
}

/// Flies a flight and asserts that all outputs give the expected verdict, as text and as JSON.
fn assert_one_verdict(flight: &Flight, bench: &Bench) {
    let (name, _, code, verdict, reason) = *flight;
    let scenario = bench.scenario(flight);
    let records = bench.path(name);
    let record = ["run", "--in-process", "--format", "json", "--record"];
    let flown = morphquad(record).arg(&records).arg(&scenario).output().expect("it starts");
    let summary = json(&flown);
    let line = summary["line"].as_str().expect("a line").to_owned();
    assert!(line.starts_with(&format!("{verdict}  {name}: {reason}")), "{line}");
    assert_eq!(flown.status.code(), Some(code), "{line}");
    assert_eq!(summary["verdict"]["verdict"], verdict, "{line}");
    assert!(summary["verdict"]["reasons"][0]["limit"].is_number(), "{summary}");
    let as_text = ask(&["run", "--in-process", "--no-record"], &scenario);
    assert_eq!((first_line(&as_text), as_text.status.code()), (line.clone(), Some(code)));
    let recording = PathBuf::from(summary["recording"].as_str().expect("a recording"));
    assert_all_readers_agree(&recording, &summary, bench);
    assert_last_event_is(&recording, &line);
    let campaign = format!("scenario = {:?}\n", scenario.display().to_string());
    let campaign = bench.write("campaign.toml", &campaign);
    let out = bench.path(&format!("{name}-campaign"));
    let command = ["campaign", "--out", out.to_str().expect("UTF-8"), "--format"];
    let of_format = |format| ask(&[&command[..], &[format]].concat(), &campaign);
    let (campaign, as_text) = (of_format("json"), of_format("text"));
    let table = json(&campaign);
    assert_eq!(campaign.status.code(), Some(code), "{table}");
    assert_eq!(table["line"], first_line(&as_text));
    let worst = &table["worst"][0];
    assert_eq!(worst["outcome"], verdict, "{table}");
    let case_reason = worst["reason"].as_str().expect("a reason");
    assert_eq!(format!("{verdict}  {name}: {case_reason}"), line);
    assert!(table["line"].as_str().is_some_and(|line| line.contains(case_reason)), "{table}");
}

#[test]
fn all_outputs_agree_on_the_verdicts_of_nine_flights() {
    let bench = Bench::new();
    for flight in &FLIGHTS {
        assert_one_verdict(flight, &bench);
    }
}

/// Flies a scenario in processes with these flags; returns the summary, the exit code and the recording.
fn fly(name: &str, flags: &[&str], bench: &Bench) -> (Value, Option<i32>, PathBuf) {
    let record = ["run", "--format", "json", "--record"];
    let flown = morphquad(record).arg(bench.path(name)).args(flags).args(judged(flags)).output();
    let flown = flown.expect("the executable starts");
    let summary = json(&flown);
    let recording = PathBuf::from(summary["recording"].as_str().expect("a recording"));
    (summary, flown.status.code(), recording)
}

#[test]
fn all_outputs_report_a_flight_as_crashed_after_the_plant_died() {
    let bench = Bench::new();
    let flags = ["hover", "--for", "3s", "--fault", "kill:plant@1s"];
    let (summary, code, recording) = fly("crashed", &flags, &bench);
    assert_eq!((code, &summary["verdict"]["verdict"]), (Some(4), &"CRASHED".into()), "{summary}");
    let line = summary["line"].as_str().expect("a line");
    assert!(line.starts_with("CRASHED  hover: flown ") && line.contains("plant"), "{line}");
    assert_all_readers_agree(&recording, &summary, &bench);
    assert_last_event_is(&recording, line);
}

#[test]
fn all_outputs_report_an_interrupted_flight_as_incomplete() {
    let bench = Bench::new();
    let mut running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "15"]);
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!((flown.code, flown.verdict()), (Some(130), "INCOMPLETE"), "{}", flown.output_text());
    assert!(
        flown.reason().contains(" s of 600.000 s planned: interrupted"),
        "{}",
        flown.output_text()
    );
    assert_all_readers_agree(&flown.recording_path(), flown.summary(), &bench);
    assert_last_event_is(&flown.recording_path(), flown.text("line"));
}

#[test]
fn all_outputs_report_a_flight_with_missed_deadlines_as_failed() {
    let _place = Place::for_realtime();
    let bench = Bench::new();
    // No machine can fly a thousand times faster than realtime.
    let flags = ["hover", "--clock", "realtime", "--speed", "1000", "--for", "30s"];
    // Setting any limit, even to its default, keeps the test harness from relaxing the verdict.
    let strict = ["--set", "verdict.lost_m=1.0"];
    let (summary, code, recording) = fly("missed", &[&flags[..], &strict].concat(), &bench);
    let reasons = summary["verdict"]["reasons"].as_array().expect("reasons");
    let missed = reasons.iter().find(|reason| reason["key"] == "missed_max_share");
    assert!(missed.is_some() && code == Some(1), "{code:?} {summary}");
    assert_all_readers_agree(&recording, &summary, &bench);
}

/// The attitude controller takes 80 ms for a step, fourteen times. No process dies and none is stopped, so that nothing
/// explains why the actuation guard had to take over.
fn overrun_fourteen_times() -> Flown {
    // As above.
    let flags = ["hover", "--for", "6s", "--in-process", "--set", "verdict.lost_m=1.0"];
    let overruns: Vec<String> = (0..14)
        .map(|k| format!("--timing=attitude:step=80ms@{}ms..{}ms", 1000 + 200 * k, 1005 + 200 * k))
        .collect();
    let overruns: Vec<&str> = overruns.iter().map(String::as_str).collect();
    crate::common::fly(&[&flags[..], &overruns].concat())
}

/// The reason about safe-mode episodes in the verdict of a flight; null if there is none.
fn episodes(flown: &Flown) -> Value {
    let reasons = flown.summary()["verdict"]["reasons"].as_array().expect("reasons");
    let found = reasons.iter().find(|reason| reason["key"] == "safe_mode_max");
    found.cloned().unwrap_or(Value::Null)
}

#[test]
fn all_outputs_report_fourteen_unexplained_safe_mode_episodes_as_failed() {
    let bench = Bench::new();
    let flown = overrun_fourteen_times();
    let episodes = episodes(&flown);
    let counts = (&episodes["measured"], &episodes["limit"]);
    assert_eq!(
        (counts, flown.code),
        ((&14.0.into(), &2.0.into()), Some(1)),
        "{}",
        flown.output_text()
    );
    assert_all_readers_agree(&flown.recording_path(), flown.summary(), &bench);
    assert_last_event_is(&flown.recording_path(), flown.text("line"));
}

/// The flight itself passed, so that only the commands that read the file are compared.
#[test]
fn all_readers_agree_on_the_verdict_of_a_truncated_or_altered_recording() {
    let bench = Bench::new();
    let flags = ["hover", "--in-process", "--for", "3s"];
    let (summary, code, recording) = fly("good", &flags, &bench);
    assert_eq!((code, &summary["verdict"]["verdict"]), (Some(0), &"PASSED".into()), "{summary}");
    let verdict_of = |path: &Path| -> Value {
        let report = json(&ask(&["report", "--format", "json"], path));
        serde_json::json!({ "line": report["line"], "verdict": report["verdict"] })
    };

    let whole = fs::read(&recording).expect("the recording");
    let cut = bench.path("cut.mcap");
    fs::write(&cut, &whole[..whole.len() * 2 / 3]).expect("room");
    let of_cut = verdict_of(&cut);
    assert_eq!(of_cut["verdict"]["verdict"], "INCOMPLETE", "{of_cut}");
    assert_all_readers_agree(&cut, &of_cut, &bench);

    // Without their messages no reader can determine which seat gave three applied commands; what is wrong is that they
    // are missing.
    let stolen = bench.path("stolen.mcap");
    Recording::read(&recording).copy_to(
        &stolen,
        |_, _| {},
        |topic, sequence, bytes| {
            if topic == "/wrench_command" && (100..103).contains(&sequence) {
                bytes.clear();
            }
        },
    );
    let of_stolen = verdict_of(&stolen);
    let reason = of_stolen["verdict"]["reasons"][0]["text"].as_str().expect("a reason");
    assert_eq!(of_stolen["verdict"]["verdict"], "FAILED", "{of_stolen}");
    assert_eq!(reason, "samples that the recorder lost 3 (3 of wrench_command), limit 0");
    assert_all_readers_agree(&stolen, &of_stolen, &bench);
}

#[test]
fn a_recording_is_judged_by_the_limits_that_its_flight_was_given() {
    let bench = Bench::new();
    let strict = ["hover", "--in-process", "--for", "2s", "--set", "verdict.tracking_max_m=0.001"];
    let (summary, code, recording) = fly("strict", &strict, &bench);
    assert_eq!((code, &summary["verdict"]["verdict"]), (Some(1), &"FAILED".into()), "{summary}");
    let line = summary["line"].as_str().expect("a line");
    assert!(line.contains(", limit 0.001 m"), "{line}");
    assert_eq!(summary["verdict"]["thresholds"]["tracking_max_m"]["why"], "set in [verdict]");
    assert_all_readers_agree(&recording, &summary, &bench);
}
