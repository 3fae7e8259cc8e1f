//! What is flown: one TOML text, edited by the command line, typed, checked, wired.
//!
//! [`Scenario::load`] is the way in; every complaint ([`Problem`]) has a place, a key and a remedy.
//! Open [`settings`] for the keys, [`pilot`] for the manoeuvres, `check` for the rules that span
//! sections and [`wiring`] for the graph. Each service owns the type of its section.

#[macro_use]
mod sections;

mod begin;
pub mod candidate;
mod check;
mod clock;
mod deadlines;
mod document;
mod embedded;
pub mod keys;
pub mod needs;
mod ordered;
pub mod orders;
mod overrides;
mod patience;
pub mod pilot;
mod pilot_error;
mod problem;
pub mod process;
pub mod rehearsal;
mod rights;
pub mod script;
pub mod services;
pub mod settings;
mod shell;
pub mod shipped;
pub mod start;
mod suggest;
#[cfg(test)]
mod tests;
mod text;
pub mod trajectory;
mod trajectory_file;
mod typed;
mod vehicle;
mod verdict;
pub mod wiring;

pub use begin::is_recording;
pub use check::TESTED_RATES_HZ;
pub use overrides::Override;
pub use pilot::Plan;
pub use problem::{Problem, ScenarioError};
pub use settings::Settings;
pub use shell::{shell_path, shell_word};
pub use suggest::remedy as suggestion;
pub use wiring::WiringError;
pub use wiring::delayed_topics;

use ::monitor::MonitorConfig;
use ::pilot::TakenUp;
use ::vehicle::{MorphAngle, ParameterError, VehicleParameters};
use attitude_lqr::LqrConfig;
use attitude_mpc::settings::Surroundings;
use attitude_mpc::{AttitudeLawConfig, TorqueBound};
use attitude_pid::PidConfig;
use controller::attitude::Timing;
use document::{Document, Edit, Texts};
use estimator::{FilterConfig, InitialState};
use host::Flight;
use host::flight::{Clock, Facts};
use host::realtime::Realtime;
use pilot::Frame;
use plant::gate::UnprovenRange;
use position_mpc::Landing;
use position_mpc::PositionLawConfig;
use position_pid::PositionPidConfig;
use position_pid::settings::Shared;
use runtime::Graph;
use services::Crew;
use shared_types::Role;
use shared_types::time::ns_from_s;
use std::path::Path;

/// A scenario that can be flown.
#[derive(Debug, Clone)]
pub struct Scenario {
    settings: Settings,
    effective: String,
    warnings: Vec<Problem>,
    absent: Vec<Problem>,
}

impl Scenario {
    /// Reads a shipped scenario by name, or a file by path, and applies `overrides` in order.
    ///
    /// # Errors
    /// Everything that is wrong: an unknown name, an unreadable file, an unknown key, a wrong type,
    /// a value out of range, or settings that do not fit one another.
    pub fn load(name_or_path: &str, overrides: &[Override]) -> Result<Self, ScenarioError> {
        if let Some(text) = shipped::text(name_or_path) {
            return Self::from_text(name_or_path, text, overrides);
        }
        let text = text::read(name_or_path)?;
        let table: Option<toml::Table> = text.parse().ok();
        // A flight is called as its scenario is, and that as its file unless it says otherwise.
        let is_nameless = table.as_ref().is_some_and(|table| match table.get("scenario") {
            Some(scenario) => scenario.as_table().is_some_and(|own| !own.contains_key("name")),
            None => true,
        });
        let stem = Path::new(name_or_path).file_stem().and_then(|stem| stem.to_str());
        let is_a_name = |stem: &&str| stem.len() <= 64 && !stem.contains(char::is_control);
        let stem = stem.filter(is_a_name);
        let own = stem.filter(|_| is_nameless).map(|stem| {
            let value = toml::Value::from(stem).to_string();
            Override(Edit::embedded(name_or_path, "scenario.name".to_owned(), value))
        });
        let overrides: Vec<Override> = own.into_iter().chain(overrides.iter().cloned()).collect();
        let scenario = Self::from_text(name_or_path, &text, &overrides)?;
        if table.is_some_and(|table| text::says_nothing(&table)) {
            let remedy = "write what is to be other than usual, such as `duration_s = 5.0` under `[scenario]`; \
                          `morphquad run hover` flies a scenario that is there";
            return Err(Problem::new(name_or_path, "has no key in it", remedy, None).into());
        }
        Ok(scenario)
    }

    /// As [`load`](Self::load), from a stream that complaints call `name`.
    ///
    /// # Errors
    /// As [`load`](Self::load), and if it cannot be read.
    pub fn read(
        name: &str,
        from: impl std::io::Read,
        overrides: &[Override],
    ) -> Result<Self, ScenarioError> {
        let text = text::read_all(from).map_err(|error| {
            let remedy = "`morphquad check hover --format toml` writes one that can be read";
            Problem::new(name, format!("cannot be read: {error}"), remedy, None)
        })?;
        Self::from_text(name, &text, overrides)
    }

    /// As [`load`](Self::load), from a text that complaints call `name`.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn from_text(
        name: &str,
        text: &str,
        overrides: &[Override],
    ) -> Result<Self, ScenarioError> {
        let mut edits: Vec<Edit> = overrides.iter().map(|edit| edit.0.clone()).collect();
        let written = Texts::new(name, text, &edits);
        let mut document = Document::parse(&written, &edits)?;
        let embedded = embedded::embedded(&document)?;
        let texts;
        if !embedded.is_empty() {
            edits.extend(embedded);
            texts = Texts::new(name, text, &edits);
            document = Document::parse(&texts, &edits)?;
            document.remove("pilot", "file");
        }
        let refuse = |problems| ScenarioError::from_problems(problems);
        let settings = match typed::settings(&document) {
            Ok(settings) => settings,
            Err(problems) => return Err(refuse(problems).unwrap_or_else(|| unwritable(name))),
        };
        let mut effective = document.to_table().map_err(|_| unwritable(name))?;
        // The processes of a flight read it under another name.
        let own = effective.entry("scenario").or_insert_with(|| toml::Table::new().into());
        if let Some(own) = own.as_table_mut() {
            own.entry("name").or_insert_with(|| settings.scenario.name.clone().into());
        }
        let effective = toml::to_string(&effective).map_err(|_| unwritable(name))?;
        if effective.len() as u64 > text::LONGEST {
            let what = format!("with all of its rows it has more than {} MB", text::LONGEST >> 20);
            let remedy = "give fewer rows, or numbers with fewer digits";
            return Err(Problem::new(name, what, remedy, document.place_of("pilot")).into());
        }
        let mut scenario = Self { settings, effective, warnings: Vec::new(), absent: Vec::new() };
        let (errors, warnings) = check::check(&scenario, &document);
        let placed = |(key, what, remedy): problem::Complaint| {
            let place = document.place_of(&key);
            Problem::new(key, what, remedy, place)
        };
        let (absent, doubtful) = script::candidates(&scenario.settings);
        scenario.absent = absent.into_iter().map(placed).collect();
        refuse(errors).map_or(Ok(()), Err)?;
        scenario.warnings = warnings;
        let doubtful = doubtful.into_iter().map(placed).map(Problem::into_warning);
        scenario.warnings.extend(doubtful);
        Ok(scenario)
    }

    /// Every section, typed.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What can be flown, but perhaps not well.
    #[must_use]
    pub fn warnings(&self) -> &[Problem] {
        &self.warnings
    }

    /// Refuses swaps to controllers that are not there. A flight asks once, before it starts: what its
    /// processes load later must not depend on which executables exist by then.
    ///
    /// # Errors
    /// Each candidate that nobody on this machine answers to.
    pub fn require_candidates(&self) -> Result<(), ScenarioError> {
        ScenarioError::from_problems(self.absent.clone()).map_or(Ok(()), Err)
    }

    /// The text with every override in it, for the processes of a run to read back.
    #[must_use]
    pub fn to_toml(&self) -> &str {
        &self.effective
    }

    /// Logical end of the flight \[ns\].
    #[must_use]
    pub fn duration_ns(&self) -> u64 {
        ns_from_s(self.settings.scenario.duration_s)
    }

    /// Where the pilot flies; none on a rig.
    #[must_use]
    pub fn trajectory(&self) -> Option<::pilot::Trajectory> {
        match self.plan() {
            Plan::Flight(config) => ::pilot::Trajectory::new(&config.trajectory).ok(),
            Plan::Rig(_) => None,
        }
    }

    /// Which part of the pilot's plan is flown: its first and last instant \[ns\].
    pub(crate) fn flown_of_the_plan_ns(&self) -> [u64; 2] {
        let at_ns = self.settings.start.at_ns();
        [at_ns, at_ns.saturating_add(self.duration_ns())]
    }

    /// What the processes of a run must know of the flight.
    ///
    /// # Errors
    /// As [`graph`](Self::graph).
    pub fn flight(&self) -> Result<Flight, WiringError> {
        let graph = self.graph()?;
        let settings::RealtimeSettings { policy, lock_memory, timer_slack_s, strict, .. } =
            self.settings.realtime;
        let timer_slack_ns = ns_from_s(timer_slack_s);
        Ok(Flight::new(Facts {
            clock: match self.settings.scenario.clock {
                settings::Clock::Lockstep => Clock::Lockstep,
                settings::Clock::Realtime => Clock::Realtime,
            },
            realtime: Realtime { policy, lock_memory, timer_slack_ns, strict },
            claims: &rights::claims(&self.settings.realtime, &graph),
            grace_s: self.settings.launcher.launcher_grace_s,
            start_yaw_rad: self.start_yaw_rad(),
            vehicle: &self.modelled_vehicle(),
            graph: &graph,
        }))
    }

    /// Loops and arrows.
    ///
    /// # Errors
    /// None for a scenario that has been loaded, which checks this.
    pub fn graph(&self) -> Result<Graph, WiringError> {
        wiring::graph(&self.settings)
    }

    /// The vehicle as it is modelled.
    #[must_use]
    pub fn modelled_vehicle(&self) -> VehicleParameters {
        self.settings.vehicle.parameters()
    }

    /// The vehicle as it is.
    #[must_use]
    pub fn real_vehicle(&self) -> VehicleParameters {
        self.settings.plant.mismatch.real_vehicle(self.modelled_vehicle())
    }

    /// β at the start.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn start_morph_angle(&self) -> Result<MorphAngle, ParameterError> {
        MorphAngle::from_degrees(self.settings.start.morph_angle_deg)
    }

    /// Heading at the start \[rad\].
    #[must_use]
    pub fn start_yaw_rad(&self) -> f64 {
        self.settings.start.yaw_deg.to_radians()
    }

    /// What the plant is built from.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn plant_config(&self) -> Result<plant::PlantConfig, ParameterError> {
        let settings = &self.settings.plant;
        let believed = self.modelled_vehicle();
        let limits = self.settings.watch_limits();
        let weights = limits.setpoint_thrust_weights;
        let unproven = UnprovenRange {
            believed,
            thrust_n: weights.map(|weights| weights * believed.weight_n()),
            tilt_rad: limits.tilt_rad,
        };
        let keeps_to_rotors =
            self.attitude_law().is_ok_and(|law| law.torque_bound == TorqueBound::Rotors);
        Ok(plant::PlantConfig {
            vehicle: self.real_vehicle(),
            model: settings.model_kind(),
            imu: settings.imu.clone(),
            pose_fix: settings.pose_fix.clone(),
            morph_encoder: settings.morph_encoder.clone(),
            gate: settings.gate.clone(),
            unproven: (self.settings.watch.enabled && keeps_to_rotors).then_some(unproven),
            position_w_m: self.settings.start.position_w_m.into(),
            yaw_rad: self.start_yaw_rad(),
            morph_angle: self.start_morph_angle()?,
            motion: self.settings.start.motion(),
            seed: self.settings.scenario.seed,
        })
    }

    /// What the estimator is built from.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn filter(&self) -> Result<(FilterConfig, InitialState), estimator::ConfigError> {
        let Settings { estimator, plant, start, vehicle, .. } = &self.settings;
        let config = estimator.filter_config(vehicle.gravity_m_s2, plant.imu.rate_hz.into())?;
        let morph_angle_rad = start.morph_angle_deg.to_radians();
        let yaw_rad = self.start_yaw_rad();
        let (position_w_m, velocity_w, attitude) = start.belief();
        let initial = estimator.initial_state(position_w_m, yaw_rad, morph_angle_rad);
        let q_wb = attitude.unwrap_or(initial.q_wb);
        Ok((config, InitialState { velocity_w, q_wb, ..initial }))
    }

    /// What the attitude controller is built from.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn attitude_law(&self) -> Result<AttitudeLawConfig, attitude_mpc::ConfigError> {
        let settings = &self.settings;
        let rig = settings.pilot.is_rig();
        settings.attitude_mpc.law_config(Surroundings {
            rotor_lag_s: settings.vehicle.rotor_lag_s,
            wrench_latency_s: settings.latency.wrench_command_s,
            report_period_s: 1.0 / settings.plant.rate_hz,
            setpoint_period_s: if rig { 0.0 } else { 1.0 / self.slot_rate_hz(Role::Position) },
        })
    }

    /// What the position controller is built from; it flies unless the pilot has a rig.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn position_law(&self) -> Result<PositionLawConfig, position_mpc::ConfigError> {
        self.settings.position_mpc.law_config(self.settings.vehicle.rotor_lag_s)
    }

    /// Rate of the loop in a slot \[Hz\].
    #[must_use]
    pub fn slot_rate_hz(&self, role: Role) -> f64 {
        Crew::of(&self.settings).rate_hz(role, &self.settings)
    }

    /// Times on the way of an attitude command at the rate of `[attitude_mpc]`.
    fn attitude_timing(&self) -> Timing {
        Timing {
            period_s: 1.0 / self.settings.attitude_mpc.rate_hz,
            latency_s: self.settings.latency.wrench_command_s,
            report_s: 1.0 / self.settings.plant.rate_hz,
            rotor_lag_s: self.settings.vehicle.rotor_lag_s,
        }
    }

    /// What the attitude LQR is built from.
    #[must_use]
    pub fn attitude_lqr(&self) -> LqrConfig {
        self.settings.attitude_lqr.law_config(self.attitude_timing())
    }

    /// What the attitude PID is built from.
    #[must_use]
    pub fn attitude_pid(&self) -> PidConfig {
        self.settings.attitude_pid.law_config(self.attitude_timing())
    }

    /// What the position PID is built from; its bounds are those of the position MPC unless it has its
    /// own.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn position_pid(&self) -> Result<PositionPidConfig, position_mpc::ConfigError> {
        let mpc = self.position_law()?;
        Ok(self.settings.position_pid.law_config(&Shared {
            rate_hz: mpc.rate_hz,
            tilt_max_rad: mpc.tilt_max_rad,
            tilt_step_max_rad: mpc.tilt_step_max_rad,
            thrust_weights: [mpc.thrust_min_weights, mpc.thrust_max_weights],
            thrust_step_max_weights: mpc.thrust_step_max_weights,
        }))
    }

    /// What the monitor is built from; `landing` is what position controllers fly without a reference.
    #[must_use]
    pub fn monitor_config(&self, landing: Landing) -> MonitorConfig {
        let Settings { watch, latency, .. } = &self.settings;
        MonitorConfig {
            limits: self.settings.watch_limits(),
            period_s: 1.0 / watch.rate_hz,
            latency_s: latency.trip_s,
            landing,
        }
    }

    /// What the pilot is built from.
    #[must_use]
    pub fn plan(&self) -> Plan {
        let Settings { pilot, start, scenario, .. } = &self.settings;
        pilot.plan(&Frame {
            position_w_m: start.position_w_m,
            yaw_deg: start.yaw_deg,
            morph_angle_deg: start.morph_angle_deg,
            duration_s: start.plan_s.unwrap_or(scenario.duration_s),
            taken_up: TakenUp { at_ns: start.at_ns(), order: start.guidance.order() },
        })
    }
}

fn unwritable(name: &str) -> ScenarioError {
    let remedy = "write times as numbers of seconds; dates have no place in a scenario";
    Problem::new(name, "the scenario cannot be written back as TOML", remedy, None).into()
}
