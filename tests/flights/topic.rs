//! `morphquad topic`: what is shown of a running flight and of a recording, beside independent readers.

use crate::common::processes::{
    Running, all_processes, in_a_terminal, kill, left_in_shared_memory, processes_of,
};
use crate::common::time::wait_until;
use crate::common::{fly, morphquad};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use rustix::process::Signal;
use serde_json::Value;
use shared_types::topics;
use std::io::Read as _;

fn topic(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = morphquad([&["topic"], arguments].concat()).output();
    let output = output.expect("the executable starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn shown(arguments: &[&str]) -> String {
    let (code, out, stderr) = topic(arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {stderr}");
    out
}

fn json(arguments: &[&str]) -> Value {
    let out = shown(&[arguments, &["--format", "json"]].concat());
    serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}"))
}

#[test]
fn a_recording_is_listed_echoed_and_counted_as_an_independent_reader_sees_it() {
    let flown = fly(&["hover", "--for", "1s"]);
    let path = flown.recording_path();
    let file = path.to_str().expect("text");
    let info = json(&["info", file]);
    assert_eq!((&info["complete"], &info["facts"]["seed"]), (&true.into(), &"1".into()));
    let rows = flown.recording().series("truth", &["position_w_m", "header.sequence"]);
    let counted = &info["topics"]["truth"][0];
    assert_eq!(counted["count"], rows.len() as u64);
    assert_eq!((&counted["gaps"], counted["hz"].as_f64()), (&0.into(), Some(1000.0)));
    assert!(shown(&["info", file]).contains("attitude_report"));
    let echoed = json(&["echo", file, "truth", "--from", "500ms", "--every", "10", "--count", "3"]);
    let echoed = echoed.as_array().expect("a list");
    assert_eq!(echoed.len(), 3);
    for (at, sample) in [500, 510, 520].into_iter().zip(echoed) {
        let (row, sample) = (&rows[at], &sample["truth"]);
        let position = sample["position_w_m"].as_array().expect("three");
        for (was, is) in row.values.iter().zip(position) {
            assert_eq!(was.to_bits(), is.as_f64().expect("a number").to_bits());
        }
        assert_eq!(sample["header"]["sequence"].as_f64(), Some(row.values[3]));
    }
    let fields = ["--field", "position_w_m[2]", "--field", "header.sequence", "--count", "2"];
    let echoed = shown(&[&["echo", file, "truth"], &fields[..]].concat());
    let height_m = |row: usize| format!("{:?}", rows[row].values[2]);
    assert_eq!(echoed, format!("0.000000 {} 1\n0.001000 {} 2\n", height_m(0), height_m(1)));
    let (code, _, stderr) = topic(&["echo", file, "truth", "--field", "position_m"]);
    assert!(code == Some(2) && stderr.contains("did you mean `position_w_m`"), "{stderr}");
    let (code, _, stderr) = topic(&["echo", file, "reference", "--field", "yaw_rad"]);
    assert!(code == Some(2) && stderr.contains("did you mean `points[0].yaw_rad`"), "{stderr}");
    let (code, _, stderr) = topic(&["echo", file, "--field", "position_w_m"]);
    assert!(code == Some(2) && stderr.contains("name the topics"), "{stderr}");
    let lines = shown(&["echo", file, "wrench_command", "--count", "2", "--format", "jsonl"]);
    let lines: Vec<Value> = lines.lines().map(|l| serde_json::from_str(l).expect("JSON")).collect();
    assert_eq!(lines.len(), 2);
    let text = shown(&["echo", file, "reference", "--count", "1"]);
    assert!(text.starts_with("reference  #1  released 0.000000 s\n"), "{text}");
    assert!(text.contains("points[0].position_w_m: 0.0 0.0 1.5\n"), "{text}");
    let hz = json(&["hz", file, "imu", "wrench_command"]);
    assert_eq!(hz["wrench_command"][0]["hz"].as_f64(), Some(100.0), "{hz}");
}

#[test]
fn events_are_shown_with_their_instants() {
    let flown = fly(&["hover", "--for", "2s", "--fault", "kill:estimator@1s"]);
    let path = flown.recording_path();
    let file = path.to_str().expect("text");
    let events = json(&["echo", file, "events"]);
    let events: Vec<_> =
        events.as_array().expect("a list").iter().map(|one| &one["events"]).collect();
    let fault = events.iter().find(|one| one["text"] == "fault: estimator is killed on purpose");
    assert_eq!(fault.expect("the fault")["t_s"].as_f64(), Some(1.0), "{events:?}");
    let text = shown(&["echo", file, "events", "--count", "1"]);
    assert!(text.starts_with("events  1.000000 s  info  launcher: fault: estimator"), "{text}");
    // With a topic both are printed; a command that counts samples names the one that prints events.
    let both = shown(&["echo", file, "events", "seating", "pose_fix", "--format", "jsonl"]);
    assert!(both.contains("{\"pose_fix\"") && both.contains("{\"events\""), "{both:.300}");
    let (code, _, stderr) = topic(&["hz", file, "events"]);
    assert!(code == Some(2) && stderr.contains("`morphquad topic echo events`"), "{stderr}");
}

#[test]
fn numbers_of_a_recording_are_drawn_in_each_form_and_never_over_the_recording() {
    let flown = fly(&["hover", "--for", "1s"]);
    let recording = flown.recording_path();
    let plot = |out: &str, signals: &[&str]| {
        let mut command = morphquad(["plot"]);
        command.arg(&recording).args(signals).arg("--out").arg(recording.with_file_name(out));
        let output = command.output().expect("the executable starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let signals = ["truth.position_w_m", "reference.points[0].yaw_rad,truth.morph_angle_rad"];
    for (out, begins) in [("a.png", &b"\x89PNG"[..]), ("a.svg", b"<svg"), ("a.pdf", b"%PDF-1.7")] {
        let (code, stderr) = plot(out, &signals);
        assert_eq!(code, Some(0), "{stderr}");
        let picture = std::fs::read(recording.with_file_name(out)).expect("a picture");
        assert!(picture.starts_with(begins), "{out}");
        let text = String::from_utf8_lossy(&picture);
        let names = ["truth.position_w_m[2]", "reference.points[0].yaw_rad", "t [s]", "yaw [rad]"];
        assert!(out == "a.png" || names.iter().all(|name| text.contains(name)), "{out}");
    }
    for (out, signal, expected) in [
        ("a.png", "truth.position", "did you mean `position_w_m`"),
        ("a.png", "reference.position_w_m", "did you mean `points[0].position_w_m`?"),
        ("a.png", "owner_report.seat", "no topic is called"),
        ("a.gif", "truth.position_w_m", ".png, .svg or .pdf"),
    ] {
        let (code, stderr) = plot(out, &[signal]);
        assert!(code == Some(2) && stderr.contains(expected), "{signal}: {stderr}");
    }
    let (code, stderr) = plot("a.png", &["truth.position_w_m", "--from", "2s", "--to", "1s"]);
    assert!(code == Some(2) && stderr.contains("is not before"), "{stderr}");
    // Of several recordings, side by side; an argument with a point in it that names no recording is a signal, another
    // one a recording.
    let other = recording.with_file_name("other.mcap");
    std::fs::copy(&recording, &other).expect("a copy");
    let other = other.to_str().expect("a name");
    let (code, stderr) = plot("both.svg", &[other, "truth.position_w_m[0]"]);
    let both = std::fs::read_to_string(recording.with_file_name("both.svg")).unwrap_or_default();
    assert!(code == Some(0) && both.contains("other: truth.position_w_m[0]"), "{stderr}");
    for (signals, expected) in [
        (&[other, "trut.position_w_m"][..], "did you mean `truth`"),
        (&["othr", "truth.position_w_m"], "othr"),
    ] {
        let (code, stderr) = plot("a.png", signals);
        assert!(code == Some(2) && stderr.contains(expected), "{stderr}");
    }
    std::fs::copy(&recording, recording.with_file_name("copy.png")).expect("a copy");
    let (code, stderr) = plot("copy.png", &["truth.position_w_m"]);
    assert!(code == Some(2) && stderr.contains("is a recording"), "{stderr}");
}

#[test]
fn tables_hold_every_sample_in_both_forms() {
    let flown = fly(&["hover", "--for", "1s"]);
    let path = flown.recording_path();
    let folder = tempfile::TempDir::new().expect("a folder");
    let out = folder.path().to_str().expect("text");
    let file = path.to_str().expect("text");
    let rows = flown.recording().series("truth", &["velocity_w_m_s", "header.sequence"]);
    let written = json(&["export", file, "truth", "applied_command", "--csv", "--out", out]);
    assert_eq!(written.as_array().map(Vec::len), Some(2), "{written}");
    let mut reader = csv::Reader::from_path(folder.path().join("truth.csv")).expect("a table");
    let heading = |name: &str| -> usize {
        let mut reader = csv::Reader::from_path(folder.path().join("truth.csv")).expect("a table");
        let headings = reader.headers().expect("headings").clone();
        headings.iter().position(|heading| heading == name).expect("a column")
    };
    let columns =
        ["velocity_w_m_s[0]", "velocity_w_m_s[1]", "velocity_w_m_s[2]", "header.sequence"]
            .map(heading);
    let mut count = 0;
    for (record, row) in reader.records().zip(&rows) {
        let record = record.expect("a row");
        assert!((record[0].parse::<f64>().expect("t_s") - row.t_s).abs() < 1e-9);
        for (column, value) in columns.iter().zip(&row.values) {
            let cell: f64 = record[*column].parse().expect("a number");
            assert_eq!(cell.to_bits(), value.to_bits());
        }
        count += 1;
    }
    assert_eq!(count, rows.len());
    // All topics, with nested lists, codes and texts.
    let written = json(&["export", file, "--parquet", "--out", out]);
    for table in written.as_array().expect("a list") {
        let path = table["path"].as_str().expect("a path");
        let reader = SerializedFileReader::new(std::fs::File::open(path).expect("a file"));
        let reader = reader.expect("a parquet file");
        let groups = reader.metadata().row_groups().iter();
        let rows = groups.map(parquet::file::metadata::RowGroupMetaData::num_rows).sum::<i64>();
        assert_eq!(table["rows"].as_i64(), Some(rows), "{path}");
        let read = reader.get_row_iter(None).expect("rows").count();
        assert_eq!(i64::try_from(read), Ok(rows), "{path}");
    }
    assert!(folder.path().join("reference.parquet").is_file());
}

#[test]
fn a_running_flight_has_the_same_hash_with_a_listener_and_without() {
    let mut running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "2"]);
    let run = ["--run", running.id()];
    // Topic by topic as they are drained: on a busy machine many of one come first.
    let echoed = json(&[&["echo", "truth", "imu", "--count", "600"], &run[..]].concat());
    let echoed = echoed.as_array().expect("a list");
    assert_eq!(echoed.len(), 600);
    assert!(echoed.iter().any(|sample| sample["truth"]["position_w_m"][2].as_f64() > Some(1.0)));
    assert!(echoed.iter().any(|sample| sample["imu"].is_object()));
    // A busy machine may keep the flight or the listener from a whole look.
    let mut hz = Value::Null;
    wait_until("a look without a gap", || {
        hz = json(&[&["hz", "wrench_command", "imu", "--for", "1s"], &run[..]].concat());
        let of = |topic: &str| &hz[topic][0];
        ["wrench_command", "imu"]
            .iter()
            .all(|topic| of(topic)["hz"].is_f64() && of(topic)["gaps"] == 0)
    });
    let rate = hz["wrench_command"][0]["hz"].as_f64().expect("a rate");
    assert!((rate - 100.0).abs() < 1e-6, "{hz}");
    let (mut list, mut truth) = (Value::Null, Value::Null);
    wait_until("a rate of the topic", || {
        list = json(&[&["list", "--for", "1s"], &run[..]].concat());
        assert_eq!(list.as_array().map(Vec::len), Some(topics::all().len()));
        let found = list.as_array().expect("a list").iter().find(|t| t["topic"] == "truth");
        truth = found.expect("the topic").clone();
        truth["hz"].is_f64()
    });
    // By the instants in the samples, whenever they come.
    let rate = truth["hz"].as_f64().expect("a rate");
    assert!((rate - 1000.0).abs() < 1e-6, "{list}");
    assert_eq!(processes_of(running.id()).len(), 7, "no process has joined");
    // One that never reads, and one that is killed.
    let mut stalled = morphquad([&["topic", "echo", "--format", "jsonl"], &run[..]].concat())
        .spawn()
        .expect("the executable starts");
    let mut struck = morphquad([&["topic", "echo", "imu"], &run[..]].concat())
        .spawn()
        .expect("the executable starts");
    wait_until("both talk", || {
        let status = json(&[&["hz", "imu", "--for", "100ms"], &run[..]].concat());
        status["imu"][0]["count"].as_u64() > Some(0)
    });
    assert!(kill(struck.id(), Signal::KILL));
    let _ = struck.wait();
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    let _ = stalled.kill();
    let _ = stalled.wait();
    flown.assert_undisturbed();
    flown.assert_is_the_shorter("hover");
    wait_until("nothing is left", || left_in_shared_memory(flown.text("run")).is_empty());
}

#[test]
fn one_look_at_a_run_shows_every_loop_in_text_and_json() {
    let mut running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "2"]);
    let top = |arguments: &[&str]| {
        let command = [&["top", "--once", "--run", running.id()], arguments].concat();
        let output = morphquad(command).output().expect("the executable starts");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let mut look = Value::Null;
    // A busy machine may keep a loop from stepping twice in one look; the monitor publishes nothing while all is well.
    wait_until("a rate of each loop", || {
        look = serde_json::from_str(&top(&["--format", "json"])).expect("JSON");
        let mut loops = look["loops"].as_array().expect("loops").iter();
        loops.all(|one| one["role"] == "monitor" || one["hz"].is_f64())
    });
    assert_eq!((&look["run"], &look["clock"]), (&running.id().into(), &"lockstep".into()));
    let loops = look["loops"].as_array().expect("loops");
    assert_eq!(loops.len(), 7, "{look}");
    // A rate is that of what a loop publishes.
    for one in loops.iter().filter(|one| one["role"] != "monitor") {
        let (name, hz) = (&one["name"], one["hz"].as_f64().expect("a rate"));
        let rate = match one["role"].as_str().expect("a role") {
            "plant" | "estimator" => 1000.0,
            "attitude" => 100.0,
            "disturbance" => 200.0,
            _ => 50.0,
        };
        assert!((hz - rate).abs() < 1e-6, "{name}: {hz}");
        assert_eq!((&one["missed"], &one["late_samples"]), (&0.into(), &0.into()), "{name}");
        assert!(one["lateness"]["max_us"].as_f64() >= one["lateness"]["median_us"].as_f64());
        assert!(one["rss_bytes"].as_u64() > Some(1 << 20) && one["cpu_percent"].is_f64());
    }
    let age = |role: &str| {
        let of_role = loops.iter().find(|one| one["role"] == role).expect("a loop");
        of_role["input_age"]["median_us"].as_f64()
    };
    assert!(age("attitude") > Some(0.0) && age("plant").is_none(), "{look}");
    let text = top(&[]);
    for part in ["attitude-mpc@0", "owner", "LATE", "epoch 1", "running"] {
        assert!(text.contains(part), "{text}");
    }
    assert!(!text.contains('\u{1b}') && text.lines().all(|line| line.len() <= 80), "{text}");
    assert!(kill(running.launcher_pid(), Signal::INT));
    assert_eq!(running.wait().code, Some(130));
    let gone = morphquad(["top", "--once", "--run", "no-such-run"]).output().expect("starts");
    assert_eq!(gone.status.code(), Some(2));
}

/// A read from a terminal that has gone returns at once, with nothing, for ever.
#[test]
fn top_ends_with_its_terminal() {
    let running = Running::start_and_fly(&["hover", "--for", "10m", "--speed", "1"]);
    let top = format!("{} top --run {}", env!("CARGO_BIN_EXE_morphquad"), running.id());
    let is_up = || all_processes().any(|process| process.arguments.join(" ") == top);
    let command = format!("stty rows 30 columns 100; exec {top}");
    let mut terminal = in_a_terminal(&command);
    let mut shown = terminal.stdout.take().expect("its picture");
    let mut picture = Vec::new();
    while !String::from_utf8_lossy(&picture).contains("attitude-mpc") {
        let mut part = [0; 4096];
        let count = shown.read(&mut part).expect("a picture");
        assert!(count > 0, "{}", String::from_utf8_lossy(&picture));
        picture.extend_from_slice(&part[..count]);
    }
    assert!(is_up());
    terminal.kill().expect("it is there");
    terminal.wait().expect("it ends");
    wait_until("top ends", || !is_up());
}

#[test]
fn topics_are_described_without_any_run() {
    let wrench = json(&["info", "wrench_command"]);
    let fields = wrench[0]["fields"].as_array().expect("fields");
    assert!(fields.iter().any(|field| field["name"] == "thrust_n" && field["kind"] == "f64"));
    let described = shown(&["info", "attitude_owner", "imu"]);
    assert!(
        described.contains("owner of the attitude slot") && described.contains("specific_force"),
        "{described}"
    );
    for (arguments, expected) in [
        (&["info", "imus"][..], "did you mean `imu`?"),
        (&["echo", "a.mcap", "b.mcap"], "two recordings"),
        (&["echo", "no-such.mcap"], "no-such.mcap"),
        (&["export", "imu", "--csv"], "name a recording"),
        (&["export", "x.mcap"], "--csv"),
        (&["echo", "imu", "--run", "no-such-run"], "no-such-run"),
    ] {
        let (code, out, stderr) = topic(arguments);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
    }
}
