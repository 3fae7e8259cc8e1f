//! The launcher's recorder under more than any flight gives it, killed, and on a disk that is full: what is in
//! the file is all there was, and what is not is named.

#[allow(dead_code, reason = "each user takes its own part")]
mod burst;
mod common;

use burst::Burst;
use common::processes::{Running, kill, processes_of};
use common::recording::Recording;
use common::time::wait_until;
use common::{Flown, morphquad, rounds};
use mcap::MessageStream;
use record::read::RecordedFlight;
use runtime::ipc::RECORDER_CAPACITY;
use rustix::process::{Pid, Resource, Rlimit, Signal, prlimit};
use scenario::{Override, Scenario};
use serde_json::Value;
use simulate::{Pin, RunOptions, Speed};
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::Child;
use std::time::Duration;
use viewers::report::Report;

/// Messages by topic, slash left out, of which no other topic's are a repetition.
fn counted(path: &Path) -> BTreeMap<String, u64> {
    let bytes = std::fs::read(path).expect("the recording");
    let mut counts = BTreeMap::new();
    for message in MessageStream::new(&bytes).expect("a readable start") {
        let channel = message.expect("an unbroken message").channel;
        if !channel.metadata.contains_key("derived_from") {
            *counts.entry(channel.topic.trim_start_matches('/').to_owned()).or_insert(0) += 1;
        }
    }
    counts
}

fn metadata(path: &Path, name: &str) -> BTreeMap<String, String> {
    let bytes = std::fs::read(path).expect("the recording");
    let summary = mcap::Summary::read(&bytes).expect("an end").expect("a summary");
    let index = summary.metadata_indexes.iter().find(|index| index.name == name);
    mcap::read::metadata(&bytes, index.expect("it is there")).expect("metadata").metadata
}

/// The transport is configured once per process, so all of it is one test.
#[test]
fn whatever_fits_the_rings_is_recorded_at_any_rate_and_what_does_not_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let duration = Override::duration(Duration::from_secs(2));
    let options = RunOptions {
        scenario: Scenario::load("figure8-morph", &[duration]).expect("it is shipped"),
        speed: Speed::Max,
        record: Some(folder.path().to_owned()),
        name: None,
        pin: Pin::None,
        disorder: None,
        live: None,
        progress: false,
    };
    let mut burst = Burst::prepare(options, "b0rec").expect("room for its rings");
    let mut most = 0;
    for _ in 0..4 {
        // Nothing is drained before everything is there: faster than this cannot be offered.
        most = most.max(burst.fill());
        burst.drain();
    }
    assert!(most > RECORDER_CAPACITY as u64, "{most}");
    // Twice what fits, from where the rings are empty.
    burst.fill();
    burst.fill_again();
    let offered = burst.offered();
    let all: u64 = offered.values().sum();
    let summary = burst.finish().expect("a summary");
    let path = summary.recording.clone().expect("a recording");
    let (gaps, in_file) = (summary.audit.gaps(), counted(&path));
    let lost: u64 = gaps.iter().map(|(_, lost)| lost).sum();
    println!("{all} offered, {lost} lost: {gaps:?}");
    assert!(lost > 0 && gaps.iter().any(|(topic, _)| *topic == "imu"), "{gaps:?}");
    for (topic, offered) in &offered {
        if topic.starts_with("state/") {
            // The first of each quarter of a second, of which one or more fit the rings.
            let recorded = in_file.get(topic).copied().unwrap_or(0);
            assert!((1..=*offered).contains(&recorded), "{topic}: {recorded} of {offered}");
            continue;
        }
        let lost = gaps.iter().find(|(lost, _)| lost == topic).map_or(0, |(_, lost)| *lost);
        assert_eq!(in_file.get(topic), Some(&(offered - lost)), "{topic}");
    }
    // The summary, the recording and a report of it state that, topic by topic.
    let (topic, count) = gaps[0];
    let named = format!("{count} of {topic}");
    assert!(summary.to_string().contains(&named), "{summary}");
    assert_eq!(summary.exit_code(), 1, "{summary}");
    let json = summary.to_json();
    assert!(json["dropped"].as_str().is_some_and(|text| text.contains(&named)), "{json}");
    assert_eq!(metadata(&path, "summary")["dropped_samples"], lost.to_string());
    let audit: Value = serde_json::from_str(&metadata(&path, "audit")[&format!("/{topic}#0")])
        .expect("totals in JSON");
    assert_eq!(audit["gaps"], count);
    let report = Report::of(&RecordedFlight::open(&path).expect("a recording")).expect("flown");
    assert!(report.line == summary.line() && report.to_string().contains(&named), "{report}");
    let output = morphquad(["replay"]).arg(&path).arg("--hash").output().expect("it starts");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Longest part of a flight that a killed launcher may lose \[s\].
const MAY_BE_LOST_S: f64 = 0.1;
/// Time runs so slowly that a recorder that does not get to the processor or the disk for nearly a second loses no more.
const SLOWLY: [&str; 2] = ["--speed", "0.1"];

/// A client that is shown every sample of a topic right after the launcher has taken it.
struct Listener(Child);

impl Listener {
    fn start(run: &str, topic: &str) -> Self {
        let listener =
            morphquad(["topic", "echo", topic, "--format", "jsonl", "--run", run]).spawn();
        Self(listener.expect("the executable starts"))
    }

    /// Instant of the last sample received \[s\], once there are no more.
    fn end(mut self, topic: &str) -> f64 {
        let lines = BufReader::new(self.0.stdout.take().expect("a pipe")).lines();
        let last = lines.map_while(Result::ok).filter(|line| line.ends_with('}')).last();
        self.0.wait().expect("an end");
        let last: Value =
            serde_json::from_str(&last.expect("something was received")).expect("JSON");
        last[topic]["header"]["release_ns"].as_f64().expect("an instant") * 1e-9
    }
}

fn in_realtime(more: &[&str]) -> Running {
    let no_grace = ["--set", "launcher.launcher_grace_s=0"];
    let base = ["figure8-morph", "--clock", "realtime", "--for", "60s"];
    Running::start_and_fly(&[&base[..], &no_grace, more].concat())
}

/// The launcher is killed; what it had taken is in the file but for its last moments, and can be recovered. What it has
/// not taken because the machine was busy is not its loss.
#[test]
fn a_killed_launcher_loses_less_than_a_tenth_of_a_second() {
    for _ in 0..rounds(1) {
        let mut running = in_realtime(&SLOWLY);
        let path = running.recording_path().expect("it records");
        let listener = Listener::start(running.id(), "truth");
        running.fly_on(0.3);
        running.kill_launcher();
        let received_s = listener.end("truth");
        let id = running.id().to_owned();
        wait_until("all processes leave", || processes_of(&id).is_empty());
        let lost_s = received_s - Recording::read(&path).end_of_a_cut_file("truth");
        println!("{:.0} ms of what it had taken", lost_s * 1e3);
        assert!(lost_s < MAY_BE_LOST_S, "{lost_s}");
        assert_recoverable(&path);
        assert_no_sample_was_taken(&path);
        running.wait();
    }
}

/// The file grows no further from some moment on, as on a full disk; then the launcher is killed, or the
/// flight ends.
#[test]
fn a_disk_that_fills_leaves_a_readable_file_and_a_summary_of_what_it_lacks() {
    for ending in [Signal::KILL, Signal::INT] {
        let mut running = in_realtime(&SLOWLY);
        let path = running.recording_path().expect("it records");
        running.fly_on(0.1);
        let size = || std::fs::metadata(&path).expect("the recording").len();
        let full = Some(size() + 200_000);
        let launcher = i32::try_from(running.launcher_pid()).ok().and_then(Pid::from_raw);
        let limit = Rlimit { current: full, maximum: full };
        prlimit(launcher, Resource::Fsize, limit).expect("our own child");
        wait_until("the disk is full", || Some(size()) >= full);
        // It goes on for a while with what cannot be written any more.
        let full_s = running.flown_s();
        wait_until("more of the flight", || running.flown_s() > full_s.map(|s| s + 0.05));
        assert!(kill(running.launcher_pid(), ending));
        let flown = running.wait();
        let (until_s, messages) = assert_recoverable(&path);
        assert!(until_s > 0.0 && messages > 1000, "{until_s} {messages}");
        if ending == Signal::INT {
            let understated_s = until_s - assert_incomplete(&flown, until_s);
            assert!((-1e-3..MAY_BE_LOST_S).contains(&understated_s), "{understated_s}");
        }
    }
}

/// The summary states that the recording is incomplete; returns the instant up to which it is complete \[s\].
fn assert_incomplete(flown: &Flown, until_s: f64) -> f64 {
    assert_eq!(flown.code, Some(130), "{}", flown.output_text());
    let error = flown.text("recording_error");
    assert!(error.contains("is incomplete") && error.contains("File too large"), "{error}");
    let (_, rest) = error.split_once("everything up to ").expect("an instant");
    let complete_until_s: f64 =
        rest.split(' ').next().and_then(|s| s.parse().ok()).expect("a number");
    // It promises what was handed over at the last flush; more may be there.
    assert!(
        complete_until_s > 0.0 && complete_until_s <= until_s + 1e-3,
        "{complete_until_s} {until_s}"
    );
    complete_until_s
}

/// What is torn off differs from topic to topic, and makes no tick another owner's.
fn assert_no_sample_was_taken(path: &Path) {
    let output = morphquad(["report", "--format", "json"]).arg(path).output();
    let json: Value = serde_json::from_slice(&output.expect("it starts").stdout).expect("JSON");
    let numbers = json["numbers"].as_array().expect("numbers");
    for key in ["wrong_owner_ticks", "duplicated_ticks"] {
        let number = numbers.iter().find(|number| number["key"] == key);
        assert_eq!(number.expect(key)["value"], "0", "{key}");
    }
}

/// Recovers a cut file: instant of the last sample \[s\], and messages in the new one, which is complete.
fn assert_recoverable(path: &Path) -> (f64, u64) {
    let folder = tempfile::tempdir().expect("a folder");
    let whole = folder.path().join("whole.mcap");
    let output = morphquad(["recover", "--format", "json", "--out"]).arg(&whole).arg(path).output();
    let output = output.expect("the executable starts");
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(output.status.code(), Some(0), "{json}");
    assert_eq!(json["gaps"], 0, "{json}");
    let messages = Recording::read(&whole).count_messages_of_a_complete_file();
    assert_eq!(json["messages"], messages, "{json}");
    assert_eq!(messages, Recording::read(path).count_messages_of_whole_chunks(), "{json}");
    (json["end_s"].as_f64().expect("an instant"), messages)
}
