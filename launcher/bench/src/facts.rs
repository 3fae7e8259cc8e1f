//! Of which machine and which build figures are.

use record::Machine;
use serde::{Deserialize, Serialize};

/// What must be the same for figures to be compared, and what is good to know.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BenchFacts {
    /// Version of the executable.
    pub version: String,
    /// Commit it was built from.
    pub git: String,
    /// Release of the kernel.
    pub kernel: String,
    /// Model of the first processor.
    pub cpu_model: String,
    /// Processors of the machine.
    pub processors: usize,
    /// A name of the machine that reveals nothing about it.
    pub machine: String,
}

impl BenchFacts {
    /// Of this machine and this executable.
    #[must_use]
    pub fn read() -> Self {
        let Machine { kernel, cpu_model } = Machine::read();
        let id = std::fs::read("/etc/machine-id").unwrap_or_default();
        let machine = blake3::hash(&id).to_hex().chars().take(12).collect();
        let possible = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            git: record::build::declared().git.to_owned(),
            kernel,
            cpu_model,
            processors: possible.lines().filter(|line| line.starts_with("processor")).count(),
            machine,
        }
    }

    /// In a line.
    #[must_use]
    pub fn to_line(&self) -> String {
        let Self { version, git, kernel, cpu_model, processors, .. } = self;
        format!("morphquad {version} ({git}), {cpu_model}, {processors} processors, Linux {kernel}")
    }
}
