//! An executable that misbehaves as a controller when it is configured to: `tests/common/rogue`.

use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// The executable. `cargo test` builds it with the tests, unless only single ones are selected.
pub(crate) fn rogue() -> &'static str {
    static PATH: OnceLock<String> = OnceLock::new();
    PATH.get_or_init(|| {
        let path = Path::new(env!("CARGO_BIN_EXE_morphquad")).with_file_name("examples/rogue");
        assert!(path.is_file(), "not there: `cargo build --release --example rogue` builds it");
        path.display().to_string()
    })
}

/// As [`config`], from when on a file is there.
pub(crate) fn config_from(folder: &TempDir, what: &str, from: &Path, amount: f64) -> String {
    let path = folder.path().join(format!("{what}-from-a-file.toml"));
    let from = from.display().to_string();
    let text = format!("what = {what:?}\nfrom_file = {from:?}\namount = {amount:?}\n");
    std::fs::write(&path, text).expect("room");
    path.display().to_string()
}

/// Writes the configuration file of the executable and returns its path.
pub(crate) fn config(folder: &TempDir, what: &str, from_s: f64, amount: f64) -> String {
    let path = folder.path().join(format!("{what}-{from_s}-{amount}.toml"));
    let text = format!("what = {what:?}\nfrom_s = {from_s:?}\namount = {amount:?}\n");
    std::fs::write(&path, text).expect("room");
    path.display().to_string()
}
