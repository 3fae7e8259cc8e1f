//! A flight at a glance, as its launcher knows it.

use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunStatus {
    /// Name of the run.
    pub run: String,
    /// Name of the scenario.
    pub scenario: String,
    /// `lockstep` or `realtime`.
    pub clock: String,
    /// The clock runs; before that, processes are getting ready.
    pub started: bool,
    /// Logical time through which every loop is complete \[s\].
    pub flown_s: f64,
    /// Logical time at which the flight ends \[s\].
    pub end_s: f64,
    /// Process that answers.
    pub launcher_pid: u32,
    /// Where the recording is, with a sign in place of what is no text.
    pub recording: Option<String>,
    /// Every loop, in data-flow order.
    pub processes: Vec<ProcessStatus>,
    /// Every slot.
    pub slots: Vec<SlotStatus>,
}

/// A loop and the process that it runs in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProcessStatus {
    /// Service.
    pub name: String,
    /// What it is in the data flow.
    pub role: String,
    /// Its process, if there is one now.
    pub pid: Option<u32>,
    /// Place among those that could fill the role.
    pub seat: u32,
    /// Restarts so far.
    pub generation: u32,
    /// Steps per second of logical time.
    pub rate_hz: f64,
    /// What it is doing.
    pub state: ProcessState,
    /// First instant that it has not yet published completely \[s\].
    pub mark_s: f64,
    /// Wall time since this last advanced \[s\].
    pub mark_age_s: f64,
}

/// What a process is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProcessState {
    /// Not ready for the first time yet.
    Starting,
    /// Flies, in a role without a slot.
    Running,
    /// Flies, and its commands count.
    Owner,
    /// Flies, and takes over when the owner falls silent.
    Fallback,
    /// Flies beside the owner; no consumer follows it.
    Shadow,
    /// Died; its successor is not ready yet.
    Restarting,
    /// Has flown to the end.
    Finished,
}

impl ProcessState {
    /// As shown.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Owner => "owner",
            Self::Fallback => "fallback",
            Self::Shadow => "shadow",
            Self::Restarting => "restarting",
            Self::Finished => "finished",
        }
    }
}

/// A slot and which process commands in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SlotStatus {
    /// `attitude` or `position`.
    pub slot: String,
    /// Epoch of the last owner record; 0 before the first.
    pub epoch: u64,
    /// The process whose commands count.
    pub owner: Option<String>,
    /// The process that takes over when the owner falls silent, or trips.
    pub fallback: Option<String>,
    /// The owner came by a swap and is not proven: the monitor judges it.
    pub watched: bool,
    /// How far a swap is: `steady`, `joining`, `tracking`, `shadowing`, `rehearsing`, `flipping`,
    /// `window`, `reverting` or `ownerless`.
    pub stage: String,
    /// The instance that is under way, `NAME@SEAT`.
    pub candidate: Option<String>,
    /// When the stage is over, if that is known \[s\].
    pub until_s: Option<f64>,
}

impl SlotStatus {
    /// The stages of a swap with the one that it is at in brackets, and until when; empty if none is
    /// under way.
    #[must_use]
    pub fn course(&self) -> String {
        const STAGES: [(&str, &[&str]); 5] = [
            ("join", &["joining"]),
            ("shadow", &["tracking", "shadowing"]),
            ("rehearse", &["rehearsing"]),
            ("flip", &["flipping", "reverting"]),
            ("window", &["window"]),
        ];
        let Some(candidate) = &self.candidate else { return String::new() };
        let until = self.until_s.map_or(String::new(), |s| format!(" until {s:.2} s"));
        let stages = STAGES.map(|(name, stages)| {
            if stages.contains(&self.stage.as_str()) {
                format!("[{name}{until}]")
            } else {
                name.to_owned()
            }
        });
        format!("{candidate}: {}", stages.join(" > "))
    }
}
