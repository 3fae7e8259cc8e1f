//! A crate that `new-controller` writes is built against this source tree, and flies.

mod common;

use common::{fly, morphquad, turn};
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// Folder of this build's artifacts, which the new crate shares as far as they are the same.
fn target_dir() -> PathBuf {
    let executable = Path::new(env!("CARGO_BIN_EXE_morphquad"));
    executable.ancestors().nth(2).expect("target/PROFILE/morphquad").to_path_buf()
}

/// Writes and builds a controller; its executable.
fn build(folder: &TempDir, slot: &str) -> PathBuf {
    let (name, dir) = (format!("fresh-{slot}"), folder.path().join(slot));
    let written = morphquad(["new-controller", &name, "--slot", slot, "--dir"])
        .arg(&dir)
        .output()
        .expect("the executable starts");
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    let built = Command::new(env!("CARGO"))
        .args(["build", "--release", "--offline", "--target-dir"])
        .arg(target_dir())
        // Its dependencies are built once more, with the features that it alone asks for. In lockstep a
        // flight waits for a slow step, so they need no optimisation.
        .env("CARGO_PROFILE_RELEASE_OPT_LEVEL", "0")
        .current_dir(&dir)
        .output()
        .expect("cargo runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    target_dir().join("release").join(name)
}

#[test]
fn a_new_controller_builds_and_says_what_it_is_started_with() {
    let folder = TempDir::new().expect("a folder");
    let executable = build(&folder, "attitude");
    let help = Command::new(&executable).arg("--help").output().expect("it starts");
    let help = String::from_utf8_lossy(&help.stdout);
    assert!(help.contains("fresh-attitude") && help.contains("--await-handover"), "{help}");
    let alone = Command::new(&executable).output().expect("it starts");
    assert_eq!(alone.status.code(), Some(2));
    let nowhere = ["--slot", "attitude", "--run", "/dev/shm/mq-none", "--generation", "0"];
    let lost = Command::new(&executable)
        .args(nowhere)
        .args(["--launcher-pid", &std::process::id().to_string()])
        .output()
        .expect("it starts");
    assert_eq!(lost.status.code(), Some(3));
    let said = String::from_utf8_lossy(&lost.stderr);
    assert!(said.contains("fresh-attitude") && said.contains("mq-none"), "{said}");
}

#[test]
fn a_new_controller_of_each_slot_takes_it_over_without_a_bump() {
    let _turn = turn();
    let folder = TempDir::new().expect("a folder");
    for slot in ["attitude", "position"] {
        let executable = build(&folder, slot);
        let swap = format!("{slot}={}@1s,shadow=1s,rollback=500ms", executable.display());
        let flown = fly(&["hover", "--for", "5s", "--no-record", "--swap", &swap]);
        assert_eq!(flown.code, Some(0), "{}", flown.said());
        let swap = &flown.summary()["swaps"][0];
        assert_eq!((&swap["done"], &swap["same_kind"]), (&true.into(), &false.into()), "{swap}");
        assert!(swap["bump"].as_f64() <= Some(0.1), "{swap}");
        assert_eq!(flown.summary()["unguided_ticks"], 0, "{}", flown.said());
        assert!(flown.number("position_max_m") < 0.1, "{}", flown.said());
    }
}
