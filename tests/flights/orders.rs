//! Where to go, how wide to spread the arms, what to disturb: ordered by a script and live.

use crate::common::processes::{Running, kill, ps};
use crate::common::recording::{Recording, Row};
use crate::common::time::{wait_for, wait_until};
use crate::common::{Flown, distance, fly, morphquad};
use rustix::process::Signal;
use serde_json::Value;

/// A lively flight in wind that is led away twice, folds out of its schedule and suffers a push.
const LED: &[&str] = &[
    "figure8-morph",
    "--for",
    "14s",
    "--goto",
    "1,-1,2,90@3.3s",
    "--morph",
    "100@5100ms,over=1s",
    "--goto",
    "-1,0.5,1@6.5s",
];

const GOALS_M: [[f64; 3]; 2] = [[1.0, -1.0, 2.0], [-1.0, 0.5, 1.0]];

fn led(more: &[&str]) -> Flown {
    fly(&[LED, more].concat())
}

/// The first point of each reference: position, velocity, heading.
fn references(flown: &Flown) -> Vec<Row> {
    let mut rows = flown.recording().series("reference", &["points"]);
    for row in &mut rows {
        row.values.truncate(7);
    }
    rows
}

fn verify(flown: &Flown) -> Value {
    let mut command = morphquad(["replay"]);
    command.arg(flown.recording_path()).args(["--hash", "--verify", "--format", "json"]);
    let output = command.output().expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(output.status.code(), Some(0), "{json} {stderr}");
    assert_eq!(json["verify"]["identical"], true, "{json}");
    json
}

/// Exit code, answer and complaint of a command to a run.
fn run_command(arguments: &[&str], run: &Running) -> (Option<i32>, String, String) {
    let output = morphquad(arguments.iter().chain(&["--run", run.id()])).output();
    let output = output.expect("the executable starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// Samples of an arc that begins and ends at rest, with positions alone: `t,x,y,z`.
fn arc() -> Vec<[f64; 4]> {
    let sample = |i: u32| {
        let t_s = 0.1 * f64::from(i);
        let tau = t_s / 6.0;
        let way = tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0));
        [t_s, 2.0 * way, 4.0 * way * (1.0 - way), 1.4 + 0.3 * way]
    };
    (0..=60).map(sample).collect()
}

#[test]
fn a_trajectory_from_a_file_is_flown_as_given_verified_and_left_by_an_order() {
    let folder = tempfile::tempdir().expect("a folder");
    let rows =
        arc().iter().map(|row| format!("{row:?}").replace(['[', ']'], "")).collect::<Vec<_>>();
    let (scenario, table) = (folder.path().join("arc.toml"), folder.path().join("arc.csv"));
    std::fs::write(table, format!("t,x,y,z\n{}\n", rows.join("\n"))).expect("a table");
    let text = "[pilot]\nkind = \"trajectory\"\nfile = \"arc.csv\"\n";
    std::fs::write(&scenario, text).expect("a scenario");
    let flight = [scenario.to_str().expect("text"), "--for", "12s", "--goto", "0.5,0.5,1@6.5s"];
    let flown = fly(&flight);
    flown.assert_clean();
    assert_eq!((flown.verdict(), flown.text("scenario")), ("PASSED", "arc"));
    assert!(flown.number("position_rms_m") < 0.02, "{}", flown.output_text());
    let references = references(&flown);
    for [t_s, x_m, y_m, z_m] in arc() {
        let row = references.iter().find(|row| (row.t_s - t_s).abs() < 1e-9).expect("a reference");
        assert!(distance(&row.values[..3], &[x_m, y_m, z_m]) < 1e-9, "{t_s} {row:?}");
    }
    let last = references.last().expect("a reference");
    assert!(distance(&last.values[..3], &[0.5, 0.5, 1.0]) < 1e-9, "{last:?}");
    // The recording has all that was flown, and the files are not there any more.
    drop(folder);
    verify(&flown);
}

#[test]
fn a_led_flight_is_smooth_clean_and_where_it_was_ordered_to_be() {
    let flown = led(&[]);
    flown.assert_clean();
    let rows = references(&flown);
    for pair in rows.windows(2) {
        let [a, b] = pair else { unreachable!() };
        let dt_s = b.t_s - a.t_s;
        let mean: Vec<f64> = (0..3).map(|i| (b.values[i] - a.values[i]) / dt_s).collect();
        // The published velocity is that of the published path, across every order.
        for i in 0..3 {
            let between = f64::midpoint(a.values[3 + i], b.values[3 + i]);
            assert!((mean[i] - between).abs() < 2e-3, "at {} s: {mean:?}", a.t_s);
        }
        let change = distance(&b.values[3..6], &a.values[3..6]) / dt_s;
        assert!(change < 2.3, "{change} m/s2 at {} s", a.t_s);
        assert!((b.values[6] - a.values[6]).abs() < 0.9 * dt_s, "turns too fast at {} s", a.t_s);
    }
    let truth = flown.recording().series("truth", &["position_w_m"]);
    let at = |t_s: f64| truth.iter().find(|row| row.t_s >= t_s).expect("flown").values.clone();
    assert!(distance(&at(6.5), &GOALS_M[0]) < 0.15, "{:?}", at(6.5));
    assert!(distance(&at(13.9), &GOALS_M[1]) < 0.05, "{:?}", at(13.9));
    let heading = references(&flown).last().expect("some").values[6];
    assert!((heading.to_degrees() - 90.0).abs() < 1e-6, "{heading}");
    // The schedule of the scenario would have swept to 160 degrees by 7 s.
    let arms = flown.recording().series("morph_command", &["angle_rad"]);
    let last = arms.last().expect("some").values[0].to_degrees();
    assert!((last - 100.0).abs() < 1e-9, "{last}");
    let orders = flown.summary()["orders"].as_array().expect("orders");
    let texts: Vec<_> = orders.iter().map(|o| o["order"].as_str().expect("words")).collect();
    assert_eq!(
        texts,
        ["goto 1 -1 2 m, heading 90 deg", "morph 100 deg over 1 s", "goto -1 0.5 1 m"]
    );
    assert!(orders.iter().all(|order| order["scripted"] == true), "{orders:?}");
    assert!(orders[0]["done_s"].as_f64() < Some(7.5), "{orders:?}");
    verify(&flown);
}

#[test]
fn a_led_flight_is_the_same_in_one_process_and_in_disorder() {
    let processes = led(&[]);
    let alone = led(&["--in-process"]);
    assert_eq!(alone.hash(), processes.hash());
    assert_eq!(alone.text("log_hash"), processes.text("log_hash"));
    assert_eq!(alone.summary()["orders"], processes.summary()["orders"]);
    assert_eq!(led(&["--disorder", "5"]).hash(), processes.hash());
    assert_ne!(fly(&["figure8-morph", "--for", "14s"]).hash(), processes.hash());
}

#[test]
fn a_led_flight_can_be_taken_up_in_the_middle() {
    let flown = led(&[]);
    for at in ["@3s", "@4s", "@8s"] {
        let mut command = morphquad(["replay"]);
        command.arg(flown.recording_path()).args(["--branch", at, "--format", "json"]);
        let output = command.output().expect("the executable starts");
        let json: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{at}: {json} {stderr}");
        assert!(json.to_string().contains(flown.hash()), "{at}: {json}");
    }
}

#[test]
fn an_injector_that_dies_goes_on_with_what_was_ordered() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("pushed.toml");
    let order = "[scenario]\nname = \"pushed\"\nduration_s = 5.0\n[[order]]\nat_s = 1.0\ndisturb = { load = { wind = { mean_w_m_s = [1.0, 0.0, 0.0], sigma_w_m_s = [0.5, 0.5, 0.5] } }, for_s = 3.0 }\n[[order]]\nat_s = 2.0\ndisturb = { load = { force_w_n = [0.0, 0.1, 0.0] }, for_s = 1.0 }\n";
    std::fs::write(&path, order).expect("room");
    let path = path.to_str().expect("text");
    let calm = fly(&[path]);
    calm.assert_clean();
    let wind = calm.recording().series("disturbance", &["wind_w_m_s", "force_w_n"]);
    for row in &wind {
        let (blows, pushes) = (row.values[0] != 0.0, row.values[4] > 0.0);
        assert_eq!(blows, (0.9999..3.9999).contains(&row.t_s), "wind at {} s", row.t_s);
        assert_eq!(pushes, (1.9999..2.9999).contains(&row.t_s), "force at {} s", row.t_s);
    }
    let died = fly(&[path, "--fault", "kill:disturbance-injector@2.5s"]);
    assert_eq!(
        died.number("recovered_crashes").to_bits(),
        1.0_f64.to_bits(),
        "{}",
        died.output_text()
    );
    assert_eq!(died.hash(), calm.hash());
    verify(&died);
}

/// Waits until a run has flown for longer than this, as its launcher reports it; if it never does, the failure shows
/// `diagnostics`.
fn wait_until_flown(run: &str, launcher_pid: u32, flown_s: f64, diagnostics: impl Fn() -> String) {
    wait_for("it has flown for long enough", || {
        let status = ps(run).unwrap_or(Value::Null);
        let is_led = status["launcher_pid"] == launcher_pid;
        let is_far = is_led && status["flown_s"].as_f64() > Some(flown_s);
        if is_far { Ok(()) } else { Err(format!("({flown_s} s): {status} {}", diagnostics())) }
    });
}

fn assert_led_live(pace: &[&str]) {
    let mut running = Running::start_and_fly(&[&["hover", "--for", "600s"][..], pace].concat());
    let done = |arguments: &[&str]| -> Value {
        let with_format = [arguments, &["--format", "json"]].concat();
        let (code, out, diagnostics) = run_command(&with_format, &running);
        assert_eq!(code, Some(0), "{arguments:?}: {out} {diagnostics}");
        serde_json::from_str(&out).expect("one JSON object")
    };
    let until =
        |flown_s| wait_until_flown(running.id(), running.launcher_pid(), flown_s, String::new);
    let seconds =
        |reply: &Value, key: &str| reply[key].as_f64().unwrap_or_else(|| panic!("{reply}"));
    let went = done(&["goto", "0.6", "-0.4", "1.8", "45"]);
    assert_eq!(went["reply"], "ordered", "{went}");
    assert!(seconds(&went, "begins_s") > seconds(&went, "at_s"), "{went}");
    let morphed = done(&["morph", "120", "--over", "1500ms"]);
    done(&["disturb", "force", "0", "0", "-0.1", "--for", "500ms", "--in", "100ms"]);
    let blows = done(&["disturb", "wind", "1", "0", "0", "--gust", "0.3"]);
    let refused = |arguments: &[&str], expected: &str| {
        let (code, out, diagnostics) = run_command(arguments, &running);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{arguments:?}: {diagnostics}");
        assert!(diagnostics.contains(expected), "{diagnostics}");
    };
    refused(&["goto", "0", "0", "-1"], "from 0.2 to 100");
    refused(&["goto", "1000", "0", "1"], "from -100 to 100");
    refused(&["morph", "161"], "from 45 to 160");
    refused(&["morph", "160", "--over", "10ms"], "at least");
    refused(&["disturb", "payload", "-1"], "from 0 to 10");
    until(seconds(&blows, "begins_s"));
    let calm = done(&["disturb", "off"]);
    let last_s = seconds(&went, "done_s").max(seconds(&morphed, "done_s"));
    until(last_s.max(seconds(&calm, "begins_s")) + 0.1);
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!(flown.code, Some(130), "{}", flown.output_text());
    let orders = flown.summary()["orders"].as_array().expect("orders");
    assert_eq!(orders.len(), 5, "{orders:?}");
    assert!(orders.iter().all(|order| order["scripted"] == false), "{orders:?}");
    let last = references(&flown).pop().expect("some").values;
    assert!(distance(&last[..3], &[0.6, -0.4, 1.8]) < 1e-9, "{last:?}");
    let arms = flown.recording().series("morph_command", &["angle_rad"]);
    let angle_deg = arms.last().expect("some").values[0].to_degrees();
    assert!((angle_deg - 120.0).abs() < 1e-9, "{angle_deg}");
    let air = flown.recording().series("disturbance", &["wind_w_m_s", "force_w_n"]);
    assert!(air.iter().any(|row| row.values[0] != 0.0));
    assert!(air.last().expect("some").values.iter().all(|value| *value == 0.0));
    verify(&flown);
}

#[test]
fn a_running_flight_is_led_live_and_its_recording_verifies() {
    assert_led_live(&["--speed", "4"]);
}

#[test]
fn a_realtime_run_is_led_live_and_its_recording_verifies() {
    assert_led_live(&["--clock", "realtime"]);
}

#[test]
fn orders_to_no_run_end_with_2() {
    for arguments in [&["goto", "0", "0", "1"][..], &["morph", "90"], &["disturb", "off"]] {
        let output = morphquad([arguments, &["--run", "no-such-run"]].concat()).output();
        let output = output.expect("the executable starts");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("no-such-run"));
    }
}

#[test]
fn an_order_by_hand_to_a_run_that_is_adopted_still_holds() {
    let grace = ["--set", "launcher.launcher_grace_s=600"];
    let running = Running::start_and_fly(
        &[&["hover", "--clock", "realtime", "--for", "600s"][..], &grace].concat(),
    );
    let (code, out, stderr) =
        run_command(&["goto", "0.5", "0", "1.7", "--format", "json"], &running);
    assert_eq!(code, Some(0), "{stderr}");
    let went: Value = serde_json::from_str(&out).expect("JSON");
    running.kill_launcher();
    let run = running.id().to_owned();
    let folder = tempfile::TempDir::new().expect("a folder");
    let log = folder.path().join("words");
    let adopter = morphquad(["adopt", &run, "--format", "json", "--record"])
        .arg(folder.path())
        .stderr(std::fs::File::create(&log).expect("room"))
        .spawn()
        .expect("the executable starts");
    let there_s = went["done_s"].as_f64().expect("an instant") + 0.1;
    let diagnostics = || std::fs::read_to_string(&log).expect("its output");
    wait_until_flown(&run, adopter.id(), there_s, diagnostics);
    // On a busy machine that is so at once, before the pilot that it has started has published anything.
    wait_until("a reference of the next pilot", || {
        let mut files = std::fs::read_dir(folder.path()).expect("a folder").flatten();
        let recording =
            files.find(|file| file.path().extension().is_some_and(|kind| kind == "mcap"));
        recording.is_some_and(|file| Recording::read(&file.path()).has_begun("reference"))
    });
    assert!(kill(adopter.id(), Signal::INT));
    let adopted = Flown::new(&adopter.wait_with_output().expect("an end"), folder);
    assert_eq!(adopted.code, Some(130), "{}", adopted.output_text());
    let last = references(&adopted).pop().expect("some").values;
    assert!(distance(&last[..3], &[0.5, 0.0, 1.7]) < 1e-9, "{last:?}");
}
