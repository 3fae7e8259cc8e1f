//! What is done to a flight on purpose, at logical times: swaps and standbys of controllers, faults of processes.

#[cfg(test)]
mod tests;

use super::settings::Settings;
use crate::candidate::{Candidate, NoCandidate, name_of, unstartable};
use crate::services::Assignment;
use document::{Complaint, suggestion};
use garde::Validate;
use runtime::Graph;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use shared_types::Slot;
use std::fs;
use std::path::{Path, PathBuf};

/// Control periods that a flip may take after the shadow window.
const FLIP_PERIODS: f64 = 3.0;

/// One `[[swap]]`: another controller shadows the owner of a slot and then takes over.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct SwapSettings {
    /// Slot.
    #[garde(skip)]
    #[schemars(schema_with = "slot_schema")]
    pub slot: Slot,
    /// Name of a controller, or path of an executable.
    #[garde(length(min = 1, max = 4096))]
    pub to: String,
    /// When it joins \[s\].
    #[garde(range(min = 0.001, max = 1e6))]
    pub at_s: f64,
    /// How long it shadows before it may take over \[s\].
    #[serde(default = "shadow_s")]
    #[garde(range(min = 0.0, max = 3600.0))]
    pub shadow_s: f64,
    /// How long the old owner stays warm afterwards \[s\].
    #[serde(default = "rollback_s")]
    #[garde(range(min = 0.0, max = 3600.0))]
    pub rollback_s: f64,
    /// How far (rms) the candidate may disagree with the owner, as a share of the largest command, however hard that
    /// works; if left out, 0.01 for the same kind of controller, and 0.1 and more where the owner works hard for another.
    #[garde(range(min = 0.0, max = 2.0))]
    pub max_bump: Option<f64>,
    /// Take over whatever the gate and the rehearsal decide.
    #[serde(default)]
    #[garde(skip)]
    pub force: bool,
    /// Whether it is flown ahead before the flip; if left out, it is when it is of another kind or
    /// build than the owner.
    #[garde(skip)]
    pub rehearse: Option<bool>,
    /// File that configures the controller, if not the flight's.
    #[garde(skip)]
    pub config: Option<PathBuf>,
}

fn slot_schema(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "string", "enum": Slot::ALL.map(Slot::label) })
}

/// Default time that a candidate shadows \[s\].
pub const SHADOW_S: f64 = 1.0;
/// The same of a standby, which does not command yet \[s\].
pub const STANDBY_SHADOW_S: f64 = 0.5;

fn shadow_s() -> f64 {
    SHADOW_S
}

fn rollback_s() -> f64 {
    0.5
}

/// One `[[standby]]`: another instance is kept warm beside the owner of a slot.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct StandbySettings {
    /// Slot.
    #[garde(skip)]
    #[schemars(schema_with = "slot_schema")]
    pub slot: Slot,
    /// Name of a controller, or path of an executable.
    #[garde(length(min = 1, max = 4096))]
    pub name: String,
    /// When it joins \[s\].
    #[serde(default = "standby_s")]
    #[garde(range(min = 0.001, max = 1e6))]
    pub at_s: f64,
    /// How long it shadows before it counts as a fallback \[s\].
    #[serde(default = "standby_shadow_s")]
    #[garde(range(min = 0.0, max = 3600.0))]
    pub shadow_s: f64,
    /// Whether it is flown ahead before it may stand by; if left out, it is when it is of another kind
    /// or build than the owner.
    #[garde(skip)]
    pub rehearse: Option<bool>,
}

/// As soon as all fly.
fn standby_s() -> f64 {
    0.1
}

fn standby_shadow_s() -> f64 {
    STANDBY_SHADOW_S
}

/// One `[[fault]]`: a signal to a process.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct FaultSettings {
    /// What happens.
    #[garde(skip)]
    pub kind: FaultKind,
    /// Whom it happens to.
    #[garde(length(min = 1, max = 4096))]
    pub name: String,
    /// When \[s\].
    #[garde(range(min = 0.001, max = 1e6))]
    pub at_s: f64,
}

/// What happens to a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FaultKind {
    /// It is killed.
    Kill,
    /// It is stopped and never goes on.
    Stop,
}

impl FaultKind {
    /// As written in scenarios.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Kill => "kill",
            Self::Stop => "stop",
        }
    }
}

/// What no flight can do, whatever executables there are.
pub(super) fn check(settings: &Settings, graph: &Graph) -> Vec<Complaint> {
    let mut complaints = Vec::new();
    let end_s = settings.scenario.duration_s;
    for (index, swap) in settings.swap.iter().enumerate() {
        let Some(node) = graph.node(swap.slot.role()) else {
            let what = format!("this flight has no {} loop", swap.slot.label());
            let remedy = "swap the attitude slot, or fly another pilot".to_owned();
            complaints.push((format!("swap[{index}].slot"), what, remedy));
            continue;
        };
        let flip_s = swap.at_s + swap.shadow_s;
        let over_s = |other: &SwapSettings| {
            let periods_s = FLIP_PERIODS / node.rate.hz();
            other.at_s + other.shadow_s + other.rollback_s + periods_s
        };
        let others = settings.swap.iter().enumerate();
        let busy = others
            .filter(|(i, other)| *i != index && other.slot == swap.slot)
            .find(|(i, other)| (other.at_s, *i) < (swap.at_s, index) && over_s(other) > swap.at_s);
        if flip_s >= end_s {
            let what = format!(
                "would take over at {flip_s} s at the earliest, and the flight ends at {end_s} s"
            );
            let remedy = "join earlier, shadow shorter or fly longer".to_owned();
            complaints.push((format!("swap[{index}].at_s"), what, remedy));
        } else if let Some((_, other)) = busy {
            let what = format!(
                "the {} slot is busy until {:.3} s with the swap at {} s",
                swap.slot.label(),
                over_s(other),
                other.at_s
            );
            let remedy =
                "join later, or shorten shadow_s or rollback_s of the swap before".to_owned();
            complaints.push((format!("swap[{index}].at_s"), what, remedy));
        }
    }
    complaints.extend(check_standbys(settings, graph));
    complaints.extend(check_faults(settings, graph));
    complaints
}

fn check_standbys(settings: &Settings, graph: &Graph) -> Vec<Complaint> {
    let mut complaints = Vec::new();
    let end_s = settings.scenario.duration_s;
    for (index, standby) in settings.standby.iter().enumerate() {
        let slot = standby.slot;
        let key = |name| format!("standby[{index}].{name}");
        if graph.node(slot.role()).is_none() {
            let what = format!("this flight has no {} loop", slot.label());
            complaints.push((key("slot"), what, "leave it away, or fly another pilot".to_owned()));
        } else if standby.at_s >= end_s {
            let what = format!("is past the end of the flight at {end_s} s");
            complaints.push((key("at_s"), what, "give an earlier time".to_owned()));
        } else if settings.standby[..index].iter().any(|other| other.slot == slot) {
            let what = format!("the {} slot has a standby already, and keeps one", slot.label());
            complaints.push((key("slot"), what, "leave one of the two away".to_owned()));
        }
    }
    complaints
}

fn check_faults(settings: &Settings, graph: &Graph) -> Vec<Complaint> {
    let mut complaints = Vec::new();
    let end_s = settings.scenario.duration_s;
    let assignment = Assignment::of(settings);
    let candidates = settings.candidates().map(name_of);
    let flown = graph.nodes().iter().map(|node| assignment.name(node.role));
    let names = flown.chain(candidates);
    let mut known: Vec<&str> = Vec::new();
    for name in names {
        if !known.contains(&name) {
            known.push(name);
        }
    }
    for (index, fault) in settings.fault.iter().enumerate() {
        if !known.contains(&fault.name.as_str()) {
            let what = format!("no process of this flight is called {}", fault.name);
            let remedy = suggestion(&fault.name, known.iter().copied());
            complaints.push((format!("fault[{index}].name"), what, remedy));
        }
        if fault.at_s >= end_s {
            let what = format!("is past the end of the flight at {end_s} s");
            complaints.push((
                format!("fault[{index}].at_s"),
                what,
                "give an earlier time".to_owned(),
            ));
        }
    }
    complaints
}

/// Why a candidate cannot be configured by a file, and what to do about it. A service reads it as a scenario.
fn unusable(path: &Path, is_service: bool) -> Option<(String, &'static str)> {
    let give = "give the path of the candidate's configuration";
    let text = match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => return Some(("is not a file".to_owned(), give)),
        Ok(_) => fs::read(path),
        Err(error) => Err(error),
    };
    match text.map(|text| String::from_utf8(text).map(|text| text.parse::<toml::Table>())) {
        Err(error) => Some((format!("cannot be read: {error}"), give)),
        Ok(Ok(Ok(_))) => None,
        Ok(_) => is_service.then(|| ("is no scenario".to_owned(), "`check` says what is wrong")),
    }
}

/// Candidates that this machine does not have, with configurations of theirs that cannot be read; and those that
/// are there and will hardly be started.
pub(super) fn candidates(settings: &Settings) -> (Vec<Complaint>, Vec<Complaint>) {
    let (mut absent, mut doubtful) = (Vec::new(), Vec::new());
    let swaps = settings.swap.iter().enumerate();
    let swaps = swaps.map(|(index, swap)| (format!("swap[{index}].to"), swap.slot, &swap.to));
    let standbys = settings.standby.iter().enumerate();
    let standbys = standbys.map(|(index, s)| (format!("standby[{index}].name"), s.slot, &s.name));
    for (key, slot, name) in swaps.chain(standbys) {
        match Candidate::find(slot, name) {
            Err(NoCandidate { what, remedy }) => absent.push((key, what, remedy)),
            Ok(Candidate::Service(_)) => {}
            Ok(Candidate::Executable(path)) => {
                let doubt = unstartable(&path).map(|why| {
                    let remedy = "it will be refused if the system does not start it: give the path of an executable";
                    (key, format!("{} {why}", path.display()), remedy.to_owned())
                });
                doubtful.extend(doubt);
            }
        }
    }
    let configs = settings.swap.iter().enumerate().filter_map(|(index, swap)| {
        let path = swap.config.as_ref()?;
        let is_service = matches!(Candidate::find(swap.slot, &swap.to), Ok(Candidate::Service(_)));
        let (why, remedy) = unusable(path, is_service)?;
        let what = format!("{} {why}", path.display());
        Some((format!("swap[{index}].config"), what, remedy.to_owned()))
    });
    absent.extend(configs);
    (absent, doubtful)
}
