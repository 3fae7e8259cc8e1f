//! The result file: one JSON object on a line for each run, by which a soak goes on where it was interrupted.

use crate::SoakError;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// What one run came to.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Outcome {
    /// Of the sources, by git.
    pub(crate) commit: String,
    pub(crate) seed: u64,
    pub(crate) name: String,
    pub(crate) passed: bool,
    pub(crate) seconds: f64,
    /// Everything that a run that did not pass has printed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) log: Option<PathBuf>,
}

/// All outcomes so far.
pub(crate) struct Results {
    path: PathBuf,
    file: File,
    outcomes: Vec<Outcome>,
}

impl Results {
    /// Opens the file, with what is in it already of this commit.
    pub(crate) fn open(path: &Path, commit: &str) -> Result<Self, SoakError> {
        let failed = |source| SoakError::File { path: path.to_owned(), source };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.map_or(Ok(()), std::fs::create_dir_all).map_err(failed)?;
        let known = if path.exists() {
            std::fs::read_to_string(path).map_err(failed)?
        } else {
            String::new()
        };
        // A line that was cut when its writer was killed counts for nothing.
        let known_ones = known.lines().filter_map(|line| serde_json::from_str(line).ok());
        let outcomes = known_ones.filter(|outcome: &Outcome| outcome.commit == commit).collect();
        let mut file = File::options().create(true).append(true).open(path).map_err(failed)?;
        if !known.is_empty() && !known.ends_with('\n') {
            file.write_all(b"\n").map_err(failed)?;
        }
        Ok(Self { path: path.to_owned(), file, outcomes })
    }

    pub(crate) fn has(&self, seed: u64, name: &str) -> bool {
        self.outcomes.iter().any(|outcome| outcome.seed == seed && outcome.name == name)
    }

    pub(crate) fn add(&mut self, outcome: Outcome) -> Result<(), SoakError> {
        let line = serde_json::to_string(&outcome).map_err(SoakError::Json)? + "\n";
        self.file
            .write_all(line.as_bytes())
            .map_err(|source| SoakError::File { path: self.path.clone(), source })?;
        self.outcomes.push(outcome);
        Ok(())
    }

    /// The file of what a run has printed, beside the results.
    pub(crate) fn log(&self, seed: u64, name: &str) -> PathBuf {
        let name = name.replace(['/', ':'], "-");
        self.path.with_extension("logs").join(format!("{seed}-{name}.log"))
    }

    /// A table: runs, findings and the longest run of each, with the seeds of the findings.
    pub(crate) fn table(&self) -> String {
        let mut rows: BTreeMap<&str, (usize, f64, BTreeSet<u64>)> = BTreeMap::new();
        for outcome in &self.outcomes {
            let (runs, longest_s, found) = rows.entry(&outcome.name).or_default();
            *runs += 1;
            *longest_s = longest_s.max(outcome.seconds);
            if !outcome.passed {
                found.insert(outcome.seed);
            }
        }
        let mut table = format!("{:>5} {:>8} {:>8}  name\n", "runs", "findings", "most s");
        for (name, (runs, longest_s, found)) in rows {
            let seeds: Vec<String> = found.iter().map(u64::to_string).collect();
            let seeds = if seeds.is_empty() {
                String::new()
            } else {
                format!("  (seeds {})", seeds.join(", "))
            };
            // Writing to a string cannot fail.
            let _ = writeln!(table, "{runs:>5} {:>8} {longest_s:>8.1}  {name}{seeds}", found.len());
        }
        table
    }
}
