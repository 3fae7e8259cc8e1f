//! What is to be run: `tests/soak.toml`, and the executables that cargo builds of it.

use crate::SoakError;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Tests and scripts by name.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct List {
    #[serde(default)]
    test: Vec<Tests>,
    #[serde(default)]
    script: Vec<Script>,
}

/// Ignored tests of one executable.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tests {
    package: String,
    executable: String,
    names: Vec<String>,
}

/// A script that does more if `MORPHQUAD_SOAK` is set.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Script {
    path: String,
}

/// One thing to run, and how.
#[derive(Debug, Clone)]
pub(crate) struct Item {
    pub(crate) name: String,
    pub(crate) is_test: bool,
    program: PathBuf,
    arguments: Vec<String>,
}

impl Item {
    /// The command, with its seed in the environment.
    pub(crate) fn command(&self, root: &Path, seed: u64) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).current_dir(root).stdin(Stdio::null());
        command.env("MORPHQUAD_SOAK", "1").env("MORPHQUAD_SEED", seed.to_string());
        command
    }
}

impl List {
    pub(crate) fn read(path: &Path) -> Result<Self, SoakError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| SoakError::File { path: path.to_owned(), source })?;
        toml::from_str(&text)
            .map_err(|error| SoakError::List { path: path.to_owned(), error: error.to_string() })
    }

    /// Builds the executables and returns every item with `only` in its name.
    pub(crate) fn build(&self, root: &Path, only: &str) -> Result<Vec<Item>, SoakError> {
        let mut items = Vec::new();
        for Tests { package, executable, names } in &self.test {
            let names: Vec<&String> = names.iter().filter(|name| name.contains(only)).collect();
            if names.is_empty() {
                continue;
            }
            let program = built(root, package, executable)?;
            items.extend(names.into_iter().map(|name| Item {
                name: format!("{executable}::{name}"),
                is_test: true,
                program: program.clone(),
                arguments: ["--ignored", "--exact", "--nocapture", name].map(String::from).into(),
            }));
        }
        let scripts = self.script.iter().filter(|script| script.path.contains(only));
        items.extend(scripts.map(|script| Item {
            name: script.path.clone(),
            is_test: false,
            program: root.join(&script.path),
            arguments: Vec::new(),
        }));
        Ok(items)
    }
}

/// A test executable, built, with the examples that its tests start.
fn built(root: &Path, package: &str, executable: &str) -> Result<PathBuf, SoakError> {
    let output = Command::new(env!("CARGO"))
        .args(["test", "--release", "--no-run", "--message-format=json", "--package", package])
        .args(["--test", executable, "--examples"])
        .current_dir(root)
        .stderr(Stdio::inherit())
        .output()
        .map_err(SoakError::Cargo)?;
    let text = String::from_utf8_lossy(&output.stdout);
    let messages = text.lines().filter_map(|line| serde_json::from_str(line).ok());
    let path = messages
        .filter(|message: &serde_json::Value| {
            message["target"]["name"] == executable && message["target"]["kind"][0] == "test"
        })
        .find_map(|message| message["executable"].as_str().map(PathBuf::from));
    path.filter(|_| output.status.success()).ok_or_else(|| SoakError::Build {
        package: package.to_owned(),
        executable: executable.to_owned(),
    })
}

/// The order of a round (Fisher and Yates), which follows from its seed.
pub(crate) fn shuffled(items: &[Item], seed: u64) -> Vec<Item> {
    let mut items = items.to_vec();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for last in (1..items.len()).rev() {
        let other = random.next_u64() % (last as u64 + 1);
        items.swap(last, usize::try_from(other).unwrap_or(last));
    }
    items
}
