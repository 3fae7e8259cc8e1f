//! `cargo run --release -p soak` runs what `tests/soak.toml` names, one after the other and round after round, for the
//! duration given by `--for`. A failure is a finding and no error of the soak: its exit code shows only whether the
//! tests could be run.

mod list;
mod results;

use clap::Parser;
use list::{Item, List};
use results::{Outcome, Results};
use runtime::clock::mono_now_ns;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Duration;
use thiserror::Error;

/// Runs the tests that need a machine for themselves, and writes what came of each to a file.
#[derive(Debug, Parser)]
struct Arguments {
    /// How long to go on; what has begun is finished
    #[arg(long = "for", value_name = "TIME", default_value = "30m", value_parser = humantime::parse_duration)]
    duration: Duration,
    /// Seed of the first round; the next one has the next seed
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// File to write to; what it has of these seeds already is not run again
    #[arg(long, value_name = "FILE", default_value = "target/soak/results.jsonl")]
    results: PathBuf,
    /// Only what has this in its name
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
}

/// Why nothing could be run.
#[derive(Debug, Error)]
pub(crate) enum SoakError {
    /// The list, the results or a log.
    #[error("cannot use {}: {source}", path.display())]
    File {
        /// File.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not a list.
    #[error("{} is not a list of tests: {error}", path.display())]
    List {
        /// File.
        path: PathBuf,
        /// What is wrong, and where.
        error: String,
    },
    /// Cargo does not start.
    #[error("cargo does not start: {0}")]
    Cargo(std::io::Error),
    /// Git does not start.
    #[error("git does not start: {0}")]
    Git(std::io::Error),
    /// Cargo has built no such executable.
    #[error(
        "cargo has not built the tests `{executable}` of the package `{package}`, which tests/soak.toml names, and \
         says why above"
    )]
    Build {
        /// Package.
        package: String,
        /// Name of the tests.
        executable: String,
    },
    /// Nothing is called so.
    #[error(
        "nothing in tests/soak.toml has `{0}` in its name: leave out --only, or take a part of a name there"
    )]
    Nothing(String),
    /// An outcome cannot be written.
    #[error("an outcome is no JSON: {0}")]
    Json(serde_json::Error),
}

fn main() -> ExitCode {
    match soak(&Arguments::parse()) {
        Ok(table) => {
            #[expect(clippy::print_stdout, reason = "the result")]
            {
                print!("{table}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("soak: {error}");
            ExitCode::from(2)
        }
    }
}

fn soak(arguments: &Arguments) -> Result<String, SoakError> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let items = List::read(&root.join("tests/soak.toml"))?.build(root, &arguments.only)?;
    if items.is_empty() {
        return Err(SoakError::Nothing(arguments.only.clone()));
    }
    let commit = commit(root)?;
    let mut results = Results::open(&arguments.results, &commit)?;
    let began_ns = mono_now_ns();
    for seed in arguments.seed.. {
        for item in list::shuffled(&items, seed) {
            if results.has(seed, &item.name) {
                continue;
            }
            if since(began_ns) >= arguments.duration {
                return Ok(results.table());
            }
            let outcome = run(root, &item, (seed, &commit), &results)?;
            let word = if outcome.passed { "passed" } else { "FINDING" };
            eprintln!("{word:>8} {:>7.1} s  seed {seed}  {}", outcome.seconds, outcome.name);
            results.add(outcome)?;
        }
    }
    Ok(results.table())
}

/// What git calls the sources.
fn commit(root: &Path) -> Result<String, SoakError> {
    let describe = ["describe", "--always", "--dirty", "--abbrev=12"];
    let output = Command::new("git").args(describe).current_dir(root).output();
    let output = output.map_err(SoakError::Git)?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

fn since(began_ns: u64) -> Duration {
    Duration::from_nanos(mono_now_ns().saturating_sub(began_ns))
}

/// Runs one of them. What it prints is kept if it does not pass.
fn run(
    root: &Path,
    item: &Item,
    (seed, commit): (u64, &str),
    results: &Results,
) -> Result<Outcome, SoakError> {
    let log = results.log(seed, &item.name);
    let failed = |source| SoakError::File { path: log.clone(), source };
    let folder = log.parent().unwrap_or(root);
    std::fs::create_dir_all(folder).map_err(failed)?;
    let file = File::create(&log).map_err(failed)?;
    let mut command = item.command(root, seed);
    command.stderr(Stdio::from(file.try_clone().map_err(failed)?)).stdout(Stdio::from(file));
    let began_ns = mono_now_ns();
    let ended_well = command.status().map_err(failed)?.success();
    let text = std::fs::read_to_string(&log).unwrap_or_default();
    // A name that no test has is no failure to the executable.
    let passed = ended_well && (!item.is_test || text.contains("test result: ok. 1 passed"));
    let seconds = since(began_ns).as_secs_f64();
    if passed {
        std::fs::remove_file(&log).map_err(failed)?;
    }
    let log = (!passed).then_some(log);
    let commit = commit.to_owned();
    Ok(Outcome { commit, seed, name: item.name.clone(), passed, seconds, log })
}
