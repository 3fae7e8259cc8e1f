//! The sections of a scenario that belong to no service, as types.

pub use super::clock::{Clock, Speed};
pub use super::launcher_settings::LauncherSettings;
pub use super::ordered::OrderSettings;
pub use super::rehearsal::RehearsalSettings;
pub use super::script::{FaultKind, FaultSettings, StandbySettings, SwapSettings};
pub use super::start::StartSettings;
pub use super::timing::TimingSettings;
pub use super::vehicle::{GeometrySettings, VehicleSettings};
pub use super::verdict::VerdictSettings;
use ::controller::ControllerSection as _;
use garde::Validate;
pub use host::realtime::Policy;
use runtime::MissPolicy;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::Role;
use std::collections::BTreeMap;

macro_rules! settings {
    ($($name:ident $how:ident $type:ty,)*) => {
        /// A whole scenario.
        #[derive(Debug, Clone)]
        pub struct Settings {
            $(
                #[doc = concat!("What the scenario sets under `", stringify!($name), "`.")]
                pub $name: $type,
            )*
        }

        /// Names of the sections.
        pub(super) const SECTIONS: &[&str] = &[$(stringify!($name)),*];
    };
}
with_sections!(settings);

impl Settings {
    /// True if something is to be done to the running flight.
    #[must_use]
    pub fn is_scripted(&self) -> bool {
        let slots = self.swap.is_empty() && self.standby.is_empty() && self.fault.is_empty();
        !(slots && self.order.is_empty())
    }

    /// Names and paths of the processes that join the flight.
    pub(super) fn candidates(&self) -> impl Iterator<Item = &str> {
        let swaps = self.swap.iter().map(|swap| swap.to.as_str());
        swaps.chain(self.standby.iter().map(|standby| standby.name.as_str()))
    }

    /// True if no state describes all of what the flight goes through: it is resumed by flying it from the start.
    #[must_use]
    pub fn is_more_than_states(&self) -> bool {
        self.is_scripted() || !self.timing.is_empty()
    }

    /// Thresholds of the monitor for the position controllers as they are configured here.
    #[must_use]
    pub fn monitor_limits(&self) -> ::monitor::Limits {
        macro_rules! bounds {
            ([] $($name:literal $section:ident $settings:ty,)*) => {
                [$(self.$section.thrust_weights(),)*]
            };
        }
        // What is left to the laws is within the monitor's own thresholds.
        let weights = with_controllers!(bounds []).into_iter().fold([1.0_f64; 2], |all, own| {
            [all[0].min(own[0].unwrap_or(1.0)), all[1].max(own[1].unwrap_or(1.0))]
        });
        self.monitor.limits(weights)
    }
}

/// Who fills the slots, by the name of a service; the first of `morphquad check`'s list if left out.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct ControllerSettings {
    /// Position slot.
    #[garde(skip)]
    pub position: Option<String>,
    /// Attitude slot.
    #[garde(skip)]
    pub attitude: Option<String>,
}

impl ControllerSettings {
    /// The setting of each slot.
    #[must_use]
    pub fn slots(&self) -> [(Role, Option<&str>); 2] {
        [(Role::Position, self.position.as_deref()), (Role::Attitude, self.attitude.as_deref())]
    }
}

/// What is flown, for how long and on which clock.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct ScenarioSettings {
    /// What the flight is called; that of its file if left out.
    #[garde(length(min = 1, max = 64))]
    pub name: String,
    /// One line.
    #[garde(length(max = 200))]
    pub description: String,
    /// Logical time of the flight \[s\].
    #[garde(range(min = 0.001, max = 1e6))]
    pub duration_s: f64,
    /// Seed of everything random.
    #[garde(skip)]
    pub seed: u64,
    /// Clock.
    #[garde(skip)]
    pub clock: Clock,
    /// Logical seconds per wall second; `max` on lockstep and 1 on realtime if left out.
    #[garde(skip)]
    #[schemars(with = "Option<f64>", range(min = 0.001, max = 1000.0))]
    pub speed: Option<Speed>,
}

impl Default for ScenarioSettings {
    fn default() -> Self {
        Self {
            name: "unnamed".to_owned(),
            description: String::new(),
            duration_s: 20.0,
            seed: 1,
            clock: Clock::Lockstep,
            speed: None,
        }
    }
}

impl ScenarioSettings {
    /// True if the scenario explicitly asks to be flown as fast as possible.
    #[must_use]
    pub fn is_unpaced(&self) -> bool {
        self.speed == Some(Speed::Max)
    }

    /// Logical seconds per wall second; `None` for as fast as possible.
    #[must_use]
    pub fn pace(&self) -> Option<f64> {
        match (self.speed, self.clock) {
            (Some(Speed::Max), _) | (None, Clock::Lockstep) => None,
            (Some(Speed::Times(factor)), _) => Some(factor),
            (None, Clock::Realtime) => Some(1.0),
        }
    }
}

/// Declared latencies: from a step to its output taking effect.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct LatencySettings {
    /// Attitude controller to plant \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub wrench_command_s: f64,
    /// Position controller to attitude controller \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub attitude_setpoint_s: f64,
    /// Attitude controller back to position controller \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub applied_setpoint_s: f64,
    /// Monitor to the consumers of a slot \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub trip_s: f64,
}

impl Default for LatencySettings {
    fn default() -> Self {
        Self {
            wrench_command_s: 0.001,
            attitude_setpoint_s: 0.001,
            applied_setpoint_s: 0.001,
            trip_s: 0.001,
        }
    }
}

/// What each loop does when the wall clock gets ahead of it.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct RealtimeSettings {
    /// How loops are scheduled: `fifo`, `deadline` or, like any program, `other`.
    #[garde(skip)]
    #[schemars(with = "String")]
    pub policy: Policy,
    /// Priority of the slowest loops under `fifo`; each faster rate has one more. 0 for none.
    #[garde(range(max = 90))]
    pub priority: u8,
    /// Share of each period that a loop may compute under `deadline`.
    #[garde(range(min = 0.01, max = 0.95))]
    pub budget_share: f64,
    /// Processors for all loops; any if empty.
    #[garde(skip)]
    pub cpus: Vec<usize>,
    /// Keep the memory of the loops' processes in place, all of it touched before the flight.
    #[garde(skip)]
    pub lock_memory: bool,
    /// By how much the system may put off a loop's timers \[s\]; 0 for what it is used to.
    #[garde(range(min = 0.0, max = 0.01))]
    pub timer_slack_s: f64,
    /// Topics with a latency whose samples take effect when they are published instead: the shortest
    /// way that the machine has, for a flight that no other is like.
    #[garde(skip)]
    pub asap: Vec<String>,
    /// Refuse to fly if the system does not grant all of this.
    #[garde(skip)]
    pub strict: bool,
    /// Plant.
    #[garde(dive)]
    pub plant: LoopSettings,
    /// Estimator.
    #[garde(dive)]
    pub estimator: LoopSettings,
    /// Position controller.
    #[garde(dive)]
    pub position_mpc: LoopSettings,
    /// Attitude controller.
    #[garde(dive)]
    pub attitude_mpc: LoopSettings,
    /// Disturbance injector.
    #[garde(dive)]
    pub disturbance_injector: LoopSettings,
    /// Pilot.
    #[garde(dive)]
    pub pilot: LoopSettings,
    /// Monitor.
    #[garde(dive)]
    pub monitor: LoopSettings,
}

/// One loop against the wall clock.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct LoopSettings {
    /// What to do about missed releases; what suits the loop if left out.
    #[garde(skip)]
    pub miss_policy: Option<Miss>,
    /// Priority under `fifo` of this loop alone; by its rate if left out.
    #[garde(range(max = 99))]
    pub priority: Option<u8>,
    /// Share of its period under `deadline` of this loop alone.
    #[garde(range(min = 0.01, max = 0.95))]
    pub budget_share: Option<f64>,
    /// Processors of this loop alone.
    #[garde(skip)]
    pub cpus: Option<Vec<usize>>,
    /// Wait for inputs without latency at most this long after the release, in logical time \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub input_deadline_s: Option<f64>,
    /// The same for one input alone: `TOPIC_s`, any topic that the loop reads; 0 never waits.
    #[garde(skip)]
    pub deadline: BTreeMap<String, f64>,
}

/// What to do about missed releases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Miss {
    /// [`MissPolicy::Skip`].
    Skip,
    /// [`MissPolicy::CatchUp`].
    CatchUp,
    /// [`MissPolicy::Hold`].
    Hold,
}

impl From<Miss> for MissPolicy {
    fn from(miss: Miss) -> Self {
        match miss {
            Miss::Skip => Self::Skip,
            Miss::CatchUp => Self::CatchUp,
            Miss::Hold => Self::Hold,
        }
    }
}

impl Default for RealtimeSettings {
    fn default() -> Self {
        let usual = LoopSettings::default;
        Self {
            policy: Policy::Fifo,
            priority: 10,
            budget_share: 0.25,
            cpus: Vec::new(),
            lock_memory: true,
            timer_slack_s: 1e-6,
            asap: Vec::new(),
            strict: false,
            plant: usual(),
            estimator: usual(),
            position_mpc: usual(),
            attitude_mpc: usual(),
            disturbance_injector: usual(),
            pilot: usual(),
            monitor: usual(),
        }
    }
}

impl RealtimeSettings {
    /// The settings of the loop that fills `role`.
    #[must_use]
    pub fn of(&self, role: Role) -> Option<&LoopSettings> {
        match role {
            Role::Plant => Some(&self.plant),
            Role::Estimator => Some(&self.estimator),
            Role::Position => Some(&self.position_mpc),
            Role::Attitude => Some(&self.attitude_mpc),
            Role::Disturbance => Some(&self.disturbance_injector),
            Role::Pilot => Some(&self.pilot),
            Role::Monitor => Some(&self.monitor),
            _ => None,
        }
    }

    /// How long the step of `role` waits for `topic`, if the scenario sets it \[s\].
    #[must_use]
    pub fn deadline_s(&self, role: Role, topic: &str) -> Option<f64> {
        let deadlines = &self.of(role)?.deadline;
        deadlines.iter().find(|(key, _)| topic_of(key) == Some(topic)).map(|(_, s)| *s)
    }
}

/// Topic that a key `TOPIC_s` names.
pub(super) fn topic_of(key: &str) -> Option<&str> {
    key.strip_suffix("_s")
}
