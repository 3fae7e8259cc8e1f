//! Records in the executable what it was built from; the library does without, so that a commit does not rebuild it.

use std::path::Path;
use std::process::Command;

/// Crates whose version may change a flight's numbers or its recording.
const CRATES: [&str; 7] = ["faer", "iceoryx2", "libm", "mcap", "nalgebra", "rand_chacha", "zstd"];

fn main() {
    let describe = ["describe", "--always", "--dirty", "--abbrev=12"];
    println!("cargo::rustc-env=MORPHQUAD_GIT={}", first_line("git", &describe));
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    println!("cargo::rustc-env=MORPHQUAD_RUSTC={}", first_line(&rustc, &["--version"]));
    let lock = std::fs::read_to_string("Cargo.lock").unwrap_or_default();
    println!("cargo::rustc-env=MORPHQUAD_CRATES={}", versions(&lock).join(", "));

    // Any of these can turn a clean tree dirty, or back. A missing path would mean "always".
    let watched =
        ["launcher", "shared-types", "services", "Cargo.lock", ".git/index", ".git/logs/HEAD"];
    for path in watched.iter().filter(|path| Path::new(path).exists()) {
        println!("cargo::rerun-if-changed={path}");
    }
}

fn first_line(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().ok();
    let text = output.filter(|o| o.status.success()).map(|o| o.stdout).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    text.lines().next().unwrap_or("unknown").to_owned()
}

/// `name version` of each of [`CRATES`] in a lock file.
fn versions(lock: &str) -> Vec<String> {
    let mut found = Vec::new();
    for package in lock.split("[[package]]") {
        let value = |key: &str| {
            let line = package.lines().find_map(|line| line.strip_prefix(key))?;
            Some(line.trim_start_matches(" = ").trim_matches('"'))
        };
        if let (Some(name), Some(version)) = (value("name"), value("version"))
            && CRATES.contains(&name)
        {
            found.push(format!("{name} {version}"));
        }
    }
    found
}
