//! An executable that misbehaves as a controller when told to: `tests/common/rogue`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use tempfile::TempDir;

/// The executable, built by whoever asks first.
pub(crate) fn rogue() -> &'static str {
    static BUILT: OnceLock<String> = OnceLock::new();
    BUILT.get_or_init(|| {
        let ours = Path::new(env!("CARGO_BIN_EXE_morphquad"));
        let target: PathBuf = ours.ancestors().nth(2).expect("target/PROFILE/morphquad").into();
        let built = Command::new(env!("CARGO"))
            // The whole workspace, as the tests are: another choice of features would build it anew.
            .args(["build", "--release", "--offline", "--workspace", "--example", "rogue"])
            .arg("--target-dir")
            .arg(&target)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .expect("cargo runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        target.join("release/examples/rogue").display().to_string()
    })
}

/// What it is told.
pub(crate) fn config(folder: &TempDir, what: &str, from_s: f64, amount: f64) -> String {
    let path = folder.path().join(format!("{what}-{from_s}-{amount}.toml"));
    let text = format!("what = {what:?}\nfrom_s = {from_s:?}\namount = {amount:?}\n");
    std::fs::write(&path, text).expect("room");
    path.display().to_string()
}
