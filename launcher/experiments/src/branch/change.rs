//! What may be changed in flight.

use document::ScenarioError;
use miette::Diagnostic;
use scenario::services::{self, Assignment};
use scenario::{Override, Scenario};
use shared_types::Slot;
use thiserror::Error;

/// Keys, or sections, that a flight cannot be taken up with, and why. Everything else takes effect
/// at the branch, unless a component refuses its memory under it.
const FIXED: [(&str, &str); 15] = [
    ("start", "is where the flight began, and it is past"),
    ("scenario.seed", "is changed by --seed, or --seeds for many branches"),
    ("scenario.clock", "is lockstep in a branch, whose flight is in one process"),
    ("scenario.speed", "does nothing in a branch, which flies as fast as it can"),
    ("realtime", "does nothing in a branch, which flies in lockstep"),
    ("launcher", "does nothing in a branch, which has no processes"),
    ("plant.model", "decides what the vehicle's state is"),
    ("plant.imu.rate_hz", "is in the sensor's memory"),
    ("plant.imu.gyro_initial_bias_rad_s", "was drawn at the start"),
    ("plant.imu.accelerometer_initial_bias_m_s2", "was drawn at the start"),
    ("plant.pose_fix", "is in the sensor's memory, with the fixes on their way"),
    ("plant.morph_encoder.rate_hz", "is in the sensor's memory"),
    ("plant.barometer.rate_hz", "is in the sensor's memory"),
    ("plant.barometer.initial_bias_m", "was drawn at the start"),
    ("plant.range_finder.rate_hz", "is in the sensor's memory"),
];

/// Control periods that a candidate shadows before it takes a slot in a scripted flight: it tracks in half of them,
/// and a gate needs ten commands of either half.
const SHADOW_PERIODS: u64 = 24;

/// What is changed at a branch.
#[derive(Debug, Clone, Default)]
pub struct Change {
    /// `KEY=VALUE` of the scenario.
    pub set: Vec<String>,
    /// `SLOT=NAME`: the service that fills a slot from now on.
    pub swap: Vec<String>,
    /// Draw from the streams of this seed from now on.
    pub seed: Option<u64>,
    /// Fly until then.
    pub duration: Option<core::time::Duration>,
}

/// A change that cannot be made.
#[derive(Debug, Error, Diagnostic)]
pub enum ChangeError {
    /// It would not take effect, or not at the branch.
    #[error("--set {setting}: {key} {reason}")]
    #[diagnostic(help("leave it away, or fly from the start with `morphquad run --set`"))]
    Fixed {
        /// As asked for.
        setting: String,
        /// Key that is fixed.
        key: &'static str,
        /// Why.
        reason: &'static str,
    },
    /// Where slots change hands, or loops take time.
    #[error(
        "--set {setting}: where slots change hands or loops take time it cannot be set at a branch"
    )]
    #[diagnostic(help(
        "swap a controller, take another seed, or fly it from the start with the setting"
    ))]
    Scripted {
        /// As asked for.
        setting: String,
    },
    /// No controller of that name.
    #[error("--swap {swap}: {what}")]
    #[diagnostic(help("write --swap SLOT=NAME with {known}"))]
    Swap {
        /// As asked for.
        swap: String,
        /// What is wrong.
        what: String,
        /// Slots and the services that can fill them.
        known: String,
    },
    /// Another kind of flight.
    #[error("a rig and a flight with a position loop cannot follow one another")]
    #[diagnostic(help("choose a pilot of the same kind"))]
    Kind,
    /// Nothing would be flown.
    #[error("the flight would end at {end_s} s, before the branch at {at_s} s")]
    #[diagnostic(help("give a longer flight: --set scenario.duration_s=..."))]
    Short {
        /// End asked for \[s\].
        end_s: f64,
        /// The branch \[s\].
        at_s: f64,
    },
    /// The scenario refuses it.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scenario(#[from] ScenarioError),
}

impl Change {
    /// True if the flight goes on as it was `recorded`; one swapped for its like is no change.
    #[must_use]
    pub fn is_none(&self, recorded: &Scenario) -> bool {
        let same_assignment = self
            .assignment(recorded)
            .is_ok_and(|assignment| assignment == Assignment::of(recorded.settings()));
        // The controller that has the slot at the instant need not be the one that was assigned.
        let same_assignment =
            same_assignment && (self.swap.is_empty() || !recorded.settings().is_more_than_states());
        self.set.is_empty() && self.seed.is_none() && self.duration.is_none() && same_assignment
    }

    /// True if steps may differ from those recorded; a flight that only ends elsewhere has the same.
    #[must_use]
    pub fn changes_steps(&self, recorded: &Scenario) -> bool {
        !Self { duration: None, ..self.clone() }.is_none(recorded)
    }

    /// Services that fly from the branch on.
    fn assignment(&self, recorded: &Scenario) -> Result<Assignment, ChangeError> {
        let mut assignment = Assignment::of(recorded.settings());
        for swap in &self.swap {
            let (slot, name) = swap.split_once('=').unwrap_or((swap, ""));
            let filled = services::filling(slot.trim(), name.trim());
            let (role, name) = filled.map_err(|what| ChangeError::Swap {
                swap: swap.clone(),
                what: what.to_owned(),
                known: services::fillings().join(" or "),
            })?;
            let _ = assignment.swap(role, name);
        }
        Ok(assignment)
    }

    /// The scenario from `at_ns` on.
    pub(super) fn apply(&self, recorded: &Scenario, at_ns: u64) -> Result<Scenario, ChangeError> {
        let mut edits = vec![Override::clock("lockstep"), Override::speed("max")];
        let scripted = recorded.settings().is_more_than_states();
        for setting in &self.set {
            if scripted {
                return Err(ChangeError::Scripted { setting: setting.clone() });
            }
            refuse_fixed(setting)?;
            edits.push(Override::set(setting)?);
        }
        let assignment = self.assignment(recorded)?;
        if scripted {
            // One more line of the script: the controller that takes the slot does so by the protocol.
            for swap in &self.swap {
                let shadow_ns = shadow_ns(recorded, swap.split('=').next().unwrap_or_default());
                let line = format!("{swap}@{at_ns}ns,shadow={shadow_ns}ns,rollback=0s,force");
                edits.push(Override::swap(&line)?);
            }
        } else if assignment != Assignment::of(recorded.settings()) {
            for role in Slot::ALL.map(Slot::role) {
                let name = assignment.name(role);
                edits.push(Override::controller(&format!("{}={name}", role.label()))?);
            }
        }
        // What lies before is flown again, with the seed of then.
        edits.extend(self.seed.filter(|_| !scripted).map(Override::seed));
        edits.extend(self.duration.map(Override::duration));
        let scenario = Scenario::from_text("the recorded scenario", recorded.to_toml(), &edits)?;
        if scenario.settings().pilot.is_rig() != recorded.settings().pilot.is_rig() {
            return Err(ChangeError::Kind);
        }
        if scenario.duration_ns() <= at_ns {
            let end_s = scenario.duration_ns() as f64 / 1e9;
            return Err(ChangeError::Short { end_s, at_s: at_ns as f64 / 1e9 });
        }
        Ok(scenario)
    }
}

/// Shortest time in which a gate sees enough of a controller of a slot \[ns\].
fn shadow_ns(recorded: &Scenario, slot: &str) -> u64 {
    let role = Slot::named(slot.trim()).map(Slot::role);
    let graph = recorded.graph().ok();
    let node = role.and_then(|role| graph.as_ref()?.node(role).copied());
    node.map_or(0, |node| SHADOW_PERIODS * node.rate.period_ns())
}

fn refuse_fixed(setting: &str) -> Result<(), ChangeError> {
    let asked = setting.split('=').next().unwrap_or_default().trim();
    let within = |outer: &str, inner: &str| {
        inner.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    let found = FIXED.iter().find(|(key, _)| within(key, asked) || within(asked, key));
    found.map_or(Ok(()), |&(key, reason)| {
        Err(ChangeError::Fixed { setting: setting.to_owned(), key, reason })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_behind_cannot_be_changed_neither_by_key_nor_by_section() {
        for setting in [
            "scenario.seed=9",
            "start.yaw_deg=3",
            "start={}",
            "plant.imu={}",
            "plant.imu.rate_hz=5",
        ] {
            assert!(matches!(refuse_fixed(setting), Err(ChangeError::Fixed { .. })), "{setting}");
        }
        for setting in ["startle=1", "plant.imu.noise_free=true", "vehicle.mass_kg=1"] {
            assert!(refuse_fixed(setting).is_ok(), "{setting}");
        }
    }
}
