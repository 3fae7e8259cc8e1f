//! Whatever is wrong with the input, the answer names place, key and remedy, and nothing flies.

use crate::common::processes::left_in_shared_memory;
use crate::common::time::wait_until;
use crate::common::{fly, morphquad};
use std::fs::{self, Permissions};
use std::io::Write as _;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// Exit code for wrong usage or configuration.
const USAGE: i32 = 2;
/// Exit code for an environment that cannot be flown in.
const UNFIT: i32 = 3;

/// Runs and returns exit code and standard error; nothing may be on standard output.
fn complaint(arguments: &[&str]) -> (Option<i32>, String) {
    let output = morphquad(["run"]).args(arguments).arg("--no-record").output();
    let output = output.expect("the executable starts");
    assert!(output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
    // The report is wrapped to the width of the terminal, so that line breaks are ignored.
    let text = String::from_utf8_lossy(&output.stderr).replace(['│', '\n'], " ");
    (output.status.code(), text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// The command is refused and every one of `parts` is in the message.
fn assert_refused(arguments: &[&str], parts: &[&str]) {
    let (code, stderr) = complaint(arguments);
    assert_eq!(code, Some(USAGE), "{arguments:?}: {stderr}");
    for part in parts {
        assert!(stderr.contains(part), "{arguments:?}: no `{part}` in: {stderr}");
    }
}

/// As [`assert_refused`], with the text as a scenario file.
fn assert_file_refused(text: &str, parts: &[&str]) {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("mine.toml");
    fs::write(&path, text).expect("a file");
    assert_refused(&[&path.display().to_string()], parts);
}

#[test]
fn an_unknown_key_is_named_with_its_line_and_the_key_that_was_meant() {
    let text = "[scenario]\nname = \"mine\"\n\n[plant]\nrate_hertz = 1000\n";
    assert_file_refused(text, &["plant.rate_hertz", "mine.toml:5:1", "help:", "`rate_hz`"]);
    assert_refused(
        &["hover", "--set", "plant.rate_hertz=5"],
        &["--set", "plant.rate_hertz", "`rate_hz`"],
    );
    assert_file_refused("[plannt]\n", &["plannt", "mine.toml:1:", "`plant`"]);
}

#[test]
fn a_value_in_another_unit_or_of_another_type_is_refused_with_the_unit_in_the_key() {
    let text = "[start]\nmorph_angle_deg = \"90 deg\"\n";
    assert_file_refused(text, &["start.morph_angle_deg", "mine.toml:2:", "without quotes", "unit"]);
    let text = "[latency]\nwrench_command_ms = 1\n";
    assert_file_refused(text, &["latency.wrench_command_ms", "mine.toml:2:", "wrench_command_s"]);
    assert_refused(&["hover", "--seed", "-4"], &["--seed"]);
    assert_refused(
        &["hover", "--seed", "18446744073709551615"],
        &["--seed", "9223372036854775807"],
    );
    assert_refused(&["hover", "--for", "20 parsecs"], &["--for", "20 parsecs"]);
    assert_refused(&["hover", "--for", "-3s"], &["--for", "-3s", "must not be negative", "20s"]);
}

#[test]
fn an_empty_file_or_a_recording_is_no_scenario_and_the_remedy_is_named() {
    for nothing in ["", "# all usual\n", "[scenario]\n[plant]\n"] {
        assert_file_refused(nothing, &["mine.toml", "no key", "help:", "`morphquad run hover`"]);
    }
    let folder = TempDir::new().expect("a folder");
    let renamed = folder.path().join("flight");
    fs::write(&renamed, b"\x89MCAP0\r\n and so on").expect("a file");
    let renamed = renamed.display().to_string();
    assert_refused(&[&renamed], &["is a recording", "morphquad view", "--verify"]);
    assert_refused(&["nowhere.mcap"], &["named like a recording", "`morphquad view nowhere.mcap`"]);
}

#[test]
fn flags_that_name_a_place_are_named_where_it_cannot_be_used() {
    let flown = fly(&["hover", "--for", "200ms"]);
    let (recording, folder) = (flown.recording_path(), TempDir::new().expect("a folder"));
    let cut = folder.path().join("cut.mcap");
    let whole = fs::read(&recording).expect("a recording");
    fs::write(&cut, &whole[..whole.len() * 9 / 10]).expect("room");
    for (command, file, flag, expected) in [
        ("report", &recording, "--png", "is not a folder"),
        ("recover", &cut, "--out", "is there already"),
    ] {
        let output = morphquad([command]).args([file, Path::new(flag), &cut]).output();
        let output = output.expect("the executable starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(UNFIT), "{command}: {stderr}");
        assert!(stderr.contains(flag) && stderr.contains(expected), "{command}: {stderr}");
    }
    assert!(fs::read(&cut).expect("as it was") == whole[..whole.len() * 9 / 10]);
}

#[test]
fn an_imu_that_is_slower_than_the_attitude_loop_is_refused() {
    for rate in ["10", "20", "99"] {
        let set = format!("plant.imu.rate_hz={rate}");
        assert_refused(
            &["figure8-morph", "--set", &set],
            &["plant.imu.rate_hz", "attitude loop", "100 or more"],
        );
    }
}

#[test]
fn estimates_that_come_too_rarely_for_a_loop_are_refused() {
    let fast = "position_mpc.rate_hz=200";
    for (sets, named) in [
        (["estimator.rate_hz=49", fast], ["estimator.rate_hz", "attitude loop", "50 or more"]),
        (["estimator.rate_hz=60", fast], ["estimator.rate_hz", "position loop", "100 or more"]),
        (["plant.imu.rate_hz=50", fast], ["plant.imu.rate_hz", "position loop", "100 or more"]),
    ] {
        let arguments = ["figure8-morph", "--set", sets[0], "--set", sets[1]];
        assert_refused(&arguments, &named);
    }
    let set = "plant.morph_encoder.rate_hz=1";
    assert_refused(&["hover", "--set", set], &["plant.morph_encoder.rate_hz", "at least 2"]);
}

#[test]
fn a_device_and_a_text_without_an_end_are_refused_and_a_pipe_is_read() {
    assert_refused(&["/dev/zero"], &["/dev/zero", "device", "hover"]);
    let folder = TempDir::new().expect("a folder");
    let long = folder.path().join("long.toml");
    fs::write(&long, "# endless\n".repeat(1 << 19)).expect("room");
    let long = long.display().to_string();
    assert_refused(&[&long], &["long.toml", "longer than 4 MB"]);

    let piped = |text: &str| {
        let mut check = morphquad(["check", "-", "--format", "json"]);
        let mut check = check.stdin(Stdio::piped()).spawn().expect("the executable starts");
        let mut pipe = check.stdin.take().expect("a pipe");
        pipe.write_all(text.as_bytes()).expect("the executable reads");
        drop(pipe);
        check.wait_with_output().expect("it ends")
    };
    let output = piped("[scenario]\nduration_s = 3.0\n");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one object");
    assert_eq!(json["scenario"]["scenario"]["duration_s"], 3.0, "{json}");
    assert!(json["loops"].as_array().is_some_and(|loops| loops.len() == 7), "{json}");
    assert_eq!(piped("duration = 3").status.code(), Some(USAGE));
}

#[test]
fn the_whole_scenario_that_check_writes_is_the_same_flight() {
    let folder = TempDir::new().expect("a folder");
    let mine = folder.path().join("mine.toml");
    let toml = |arguments: &[&str]| {
        let output = morphquad(["check"]).args(arguments).args(["--format", "toml"]).output();
        String::from_utf8(output.expect("the executable starts").stdout).expect("text")
    };
    let whole = toml(&["hover", "--seed", "9", "--set", "plant.rate_hz=500"]);
    fs::write(&mine, &whole).expect("room");
    assert!(whole.contains("seed = 9"), "{whole}");
    assert_eq!(toml(&[&mine.display().to_string()]), whole);
}

#[test]
fn a_start_below_the_ground_is_refused() {
    let set = "start.position_w_m=[0.0,0.0,-3.0]";
    assert_refused(
        &["hover", "--set", set],
        &["start.position_w_m", "below the ground", "plant.ground"],
    );
}

#[test]
fn a_flight_that_never_begins_leaves_no_recording() {
    let folder = TempDir::new().expect("a folder");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let live = format!("--live={}", taken.local_addr().expect("an address"));
    let output = morphquad(["run", "hover", "--no-open", &live, "--record"])
        .arg(folder.path())
        .output()
        .expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(USAGE), "{stderr}");
    assert_eq!(fs::read_dir(folder.path()).expect("the folder").count(), 0, "{stderr}");
}

#[test]
fn too_few_file_descriptors_are_refused_at_once_with_the_number_that_is_needed() {
    let folder = TempDir::new().expect("a folder");
    let fly = format!(
        "ulimit -n 600; exec '{}' run hover --for 1s --record '{}'",
        env!("CARGO_BIN_EXE_morphquad"),
        folder.path().display()
    );
    let output = Command::new("sh").args(["-c", &fly]).output().expect("a shell");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(UNFIT), "{stderr}");
    assert!(stderr.contains("600") && stderr.contains("768"), "{stderr}");
    assert_eq!(fs::read_dir(folder.path()).expect("the folder").count(), 0, "{stderr}");

    // A low limit that may be raised is raised.
    let fly = fly.replace("ulimit -n 600", "ulimit -Sn 256");
    let output = Command::new("sh").args(["-c", &fly]).output().expect("a shell");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
}

#[test]
fn too_few_processes_are_refused_at_once_with_the_number_that_is_needed() {
    const OTHER: u32 = 65534;
    let folder = TempDir::new().expect("a folder");
    let mut limited = Command::new("prlimit");
    let mut executable = PathBuf::from(env!("CARGO_BIN_EXE_morphquad"));
    if rustix::process::geteuid().is_root() {
        // The limit is for users, and theirs is the executable that they can reach.
        let copy = folder.path().join("morphquad");
        fs::set_permissions(folder.path(), Permissions::from_mode(0o755)).expect("our folder");
        fs::copy(executable, &copy).expect("room for it");
        executable = copy;
        limited.uid(OTHER).gid(OTHER);
    }
    limited.arg("--nproc=40").arg(executable).args(["run", "hover", "--for", "1s", "--no-record"]);
    let output = limited.current_dir("/").output().expect("util-linux");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(UNFIT), "{stderr}");
    assert!(stderr.contains("of at most 40 processes and threads"), "{stderr}");
    assert!(stderr.contains("need 48 more: `ulimit -u "), "{stderr}");
}

#[test]
fn a_scenario_without_a_key_is_refused_also_from_standard_input() {
    for text in ["", "# nothing\n", "[scenario]\n"] {
        let mut check = morphquad(["check", "-"]);
        check.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut check = check.spawn().expect("the executable starts");
        let mut input = check.stdin.take().expect("a pipe");
        input.write_all(text.as_bytes()).expect("room for a line");
        drop(input);
        let output = check.wait_with_output().expect("it ends");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(USAGE), "{text:?}: {stderr}");
        assert!(stderr.contains("has no key in it"), "{text:?}: {stderr}");
    }
}

#[test]
fn text_that_is_no_toml_is_refused_at_its_line() {
    assert_file_refused("[plant]\nrate_hz = = 3\n", &["mine.toml:2:"]);
}

#[test]
fn a_rate_that_is_negative_or_zero_or_no_number_is_refused_by_flag_and_by_key() {
    for rate in ["-100", "0", "nan", "inf", "1e9"] {
        let flag = format!("attitude-mpc={rate}");
        assert_refused(&["hover", "--rate", &flag], &["attitude_mpc.rate_hz", "--rate", "help:"]);
        let text = format!("[attitude_mpc]\nrate_hz = {rate}\n");
        assert_file_refused(&text, &["attitude_mpc.rate_hz", "mine.toml:2:", "help:"]);
    }
}

#[test]
fn nan_is_refused_wherever_a_number_is_wanted() {
    for key in
        ["vehicle.mass_kg", "pilot.lead_s", "launcher.stall_timeout_s", "latency.wrench_command_s"]
    {
        assert_refused(&["hover", "--set", &format!("{key}=nan")], &[key, "NaN", "finite"]);
    }
    let script = "disturbance_injector.script=[{kind=\"constant\",load={force_w_n=[0.0,nan,0.0]}}]";
    assert_refused(&["hover", "--set", script], &["disturbance_injector.script", "NaN", "finite"]);
    let text =
        "[[disturbance_injector.script]]\nkind = \"constant\"\nload.force_w_n = [1.0, -inf, 0.0]\n";
    assert_file_refused(text, &["disturbance_injector.script[0]", "mine.toml:3:", "finite"]);
}

#[test]
fn a_missing_file_and_an_unknown_scenario_are_refused_with_the_known_names() {
    assert_refused(&["nowhere/mine.toml"], &["nowhere/mine.toml", "No such file", "hover"]);
    let swap = "attitude=attitude-lqr@1s,config=nowhere/gains.toml";
    assert_refused(&["hover", "--swap", swap], &["nowhere/gains.toml", "No such file", "config"]);
    assert_refused(&["hoover"], &["hoover", "did you mean", "`hover`", "`disturbance`"]);
}

#[test]
fn bounds_that_leave_nothing_between_them_are_refused() {
    let text = "[position_mpc]\nthrust_min_weights = 1.4\nthrust_max_weights = 1.2\n";
    assert_file_refused(
        text,
        &["position_mpc.thrust_min_weights", "mine.toml:2:", "1.4", "1.2", "help:"],
    );
    assert_refused(
        &[
            "hover",
            "--set",
            "position_mpc.thrust_max_weights=0.5",
            "--set",
            "position_mpc.thrust_min_weights=0.8",
        ],
        &["position_mpc.thrust_min_weights", "--set", "help:"],
    );
    let step =
        "[[disturbance_injector.script]]\nkind = \"step\"\nat_s = 2.0\nuntil_s = 1.0\nload = {}\n";
    assert_file_refused(step, &["until_s", "mine.toml:4:", "help:"]);
}

#[test]
fn arms_outside_45_to_160_degrees_are_refused_at_the_start_and_on_the_way() {
    for angle in ["44.9", "160.1", "-90"] {
        assert_refused(
            &["hover", "--set", &format!("start.morph_angle_deg={angle}")],
            &["start.morph_angle_deg", "help:", if angle == "160.1" { "160" } else { "45" }],
        );
        let text = format!("[pilot]\nkind = \"hover\"\nmorph = [[0.0, 90.0], [5.0, {angle}]]\n");
        assert_file_refused(&text, &["pilot.morph", angle, "mine.toml:3:", "from 45 to 160"]);
    }
}

#[test]
fn an_unknown_loop_is_refused_with_the_known_ones() {
    assert_refused(&["hover", "--rate", "attitude=fast"], &["--rate", "fast", "help:"]);
    assert_refused(&["hover", "--rate", "motor=50"], &["motor", "plant", "attitude-mpc", "pilot"]);
    assert_refused(&["hover", "--rate", "plant"], &["--rate plant", "--rate NAME=HZ"]);
}

#[test]
fn an_unknown_service_does_not_start_and_names_the_known_ones() {
    let output = morphquad(["proc", "attitude-lqg", "--run", "/dev/shm/mq-none"])
        .args(["--generation", "0", "--launcher-pid", "1"])
        .output()
        .expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(USAGE), "{stderr}");
    assert!(stderr.contains("attitude-lqg") && stderr.contains("attitude-mpc"), "{stderr}");
}

#[test]
fn a_service_without_its_run_names_the_folder_that_is_missing() {
    let output = morphquad(["proc", "estimator", "--run", "/dev/shm/mq-none"])
        .args(["--generation", "0", "--launcher-pid", &std::process::id().to_string()])
        .output()
        .expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(UNFIT), "{stderr}");
    assert!(stderr.contains("estimator") && stderr.contains("/dev/shm/mq-none"), "{stderr}");
}

#[test]
fn a_recording_folder_that_cannot_be_written_is_named_before_anything_flies() {
    // Below a regular file no user can make a folder, not even root.
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("file");
    fs::write(&file, "").expect("a file");
    for refused in [file.join("flights"), file] {
        let output = morphquad(["run", "hover", "--record"]).arg(&refused).output();
        let output = output.expect("the executable starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(UNFIT), "{stderr}");
        assert!(stderr.contains(&refused.display().to_string()), "{stderr}");
        assert!(stderr.contains("--record"), "no remedy: {stderr}");
    }
}

#[test]
fn two_runs_at_the_same_time_both_fly_and_know_nothing_of_each_other() {
    // At a pace, because of those as fast as the machine one may have to wait for the other.
    let fly = || fly(&["figure8-morph", "--for", "5s", "--speed", "2"]);
    let (one, other) = std::thread::scope(|scope| {
        let one = scope.spawn(fly);
        let other = fly();
        (one.join().expect("no panic"), other)
    });
    one.assert_clean();
    other.assert_clean();
    assert_eq!(one.hash(), other.hash());
    assert_ne!(one.text("run"), other.text("run"));
    for flown in [&one, &other] {
        wait_until("nothing is left", || left_in_shared_memory(flown.text("run")).is_empty());
        assert!(Path::new(flown.text("recording")).exists());
    }
}

#[test]
fn realtime_as_fast_as_possible_is_a_contradiction() {
    assert_refused(
        &["hover", "--clock", "realtime", "--speed", "max"],
        &["scenario.speed", "help:"],
    );
    assert_refused(&["hover", "--clock", "sundial"], &["clock", "sundial", "lockstep", "realtime"]);
    assert_refused(&["hover", "--pin", "left"], &["--pin", "left", "auto"]);
}

#[test]
fn a_processor_that_is_not_there_is_refused_with_those_that_are() {
    let output = morphquad(["run", "hover", "--pin", "1023"]).output().expect("it starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(USAGE), "{stderr}");
    assert!(stderr.contains("--pin 1023") && stderr.contains('0'), "{stderr}");
}

#[test]
fn a_result_that_cannot_be_written_is_an_error() {
    let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("Linux has it");
    for command in [&["list"][..], &["run", "hover", "--for", "100ms", "--no-record"]] {
        let output = morphquad(command)
            .stdout(full.try_clone().expect("a descriptor"))
            .output()
            .expect("the executable starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(UNFIT), "{stderr}");
        assert!(stderr.contains("cannot write the result"), "{stderr}");
    }
}

#[test]
fn horizons_that_do_not_see_the_lag_or_do_not_fit_are_refused_as_written() {
    assert_refused(
        &["hover", "--set", "attitude_mpc.horizon_s=0.03"],
        &["horizon_s", "rotor lags"],
    );
    assert_refused(&["hover", "--set", "attitude_mpc.horizon_s=10"], &["horizon_s", "10"]);
}

#[test]
fn a_pipe_is_refused_by_name_and_not_waited_for() {
    let folder = TempDir::new().expect("a folder");
    let pipe = folder.path().join("pipe.mcap");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.expect("mkfifo").success());
    for command in [&["replay", "--verify"][..], &["replay", "--branch", "@1s"], &["campaign"]] {
        let output = morphquad(command).arg(&pipe).output().expect("the executable starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(USAGE), "{command:?}: {stderr}");
        assert!(stderr.contains("pipe.mcap"), "{command:?}: {stderr}");
    }
}
