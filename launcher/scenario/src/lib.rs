//! What is flown: one TOML text, edited by the command line, typed, checked, wired.
//!
//! [`Scenario::load`] is the way in; every complaint ([`Problem`]) has a place, a key and a remedy.
//! Open [`settings`] for the keys, [`pilot::settings`] for the manoeuvres, `check` for the rules that span
//! sections and [`wiring`] for the graph. Each service owns the type of its section.

#[macro_use]
mod sections;

pub mod candidate;
mod check;
mod clock;
mod complete;
mod configs;
mod deadlines;
mod embedded;
pub mod keys;
mod launcher_settings;
pub mod needs;
mod ordered;
pub mod orders;
mod overrides;
mod pilot_error;
pub mod process;
pub mod rehearsal;
mod renamed;
mod rights;
pub mod script;
pub mod services;
pub mod settings;
pub mod shipped;
pub mod start;
#[cfg(test)]
mod tests;
mod text;
mod timing;
mod typed;
mod vehicle;
mod verdict;
pub mod wiring;

pub use ::pilot::settings::Plan;
pub use check::TESTED_RATES_HZ;
pub use overrides::Override;
pub use renamed::renamed;
pub use settings::Settings;
pub use wiring::WiringError;
pub use wiring::delayed_topics;

use ::vehicle::{MorphAngle, ParameterError, VehicleParameters};
use document::{Complaint, Document, Edit, Problem, ScenarioError, Texts};
use host::Flight;
use host::flight::{Clock, Facts};
use host::realtime::Realtime;
use renamed::RENAMED;
use runtime::Graph;
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
        // A flight has the name of its scenario, and a scenario without a name that of its file.
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
        if table.is_some_and(|table| text::has_no_value(&table)) {
            return Err(no_key(name_or_path));
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
        let scenario = Self::from_text(name, &text, overrides)?;
        // Of a program that was to write one and failed.
        if text.parse().is_ok_and(|table: toml::Table| text::has_no_value(&table)) {
            return Err(no_key(name));
        }
        Ok(scenario)
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
        let mut document = Document::parse(&written, &edits, &RENAMED)?;
        let embedded = embedded::embedded(&document)?;
        let texts;
        if !embedded.is_empty() {
            edits.extend(embedded);
            texts = Texts::new(name, text, &edits);
            document = Document::parse(&texts, &edits, &RENAMED)?;
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
        if effective.len() as u64 > text::MAX_BYTES {
            let what =
                format!("with all of its rows it has more than {} MB", text::MAX_BYTES >> 20);
            let remedy = "give fewer rows, or numbers with fewer digits";
            return Err(Problem::new(name, what, remedy, document.place_of("pilot")).into());
        }
        let mut scenario = Self { settings, effective, warnings: Vec::new(), absent: Vec::new() };
        let (errors, warnings) = check::check(&scenario, &document);
        let placed = |(key, what, remedy): Complaint| {
            let place = document.place_of(&key);
            Problem::new(key, what, remedy, place)
        };
        let (absent, doubtful) = script::candidates(&scenario.settings);
        scenario.absent = absent.into_iter().map(placed).collect();
        refuse(errors).map_or(Ok(()), Err)?;
        scenario.warnings = [document.renamed(), &warnings].concat();
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
    /// Each name of a candidate that nothing on this machine answers to.
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

    /// The highest place of what is planned \[m\].
    pub(crate) fn highest_m(&self) -> f64 {
        let planned = self.trajectory().map(|path| path.heights_m(self.flown_of_the_plan_ns())[1]);
        // Of an order that is being followed as the flight begins.
        let ordered = self.settings.start.guidance.order().map(|order| order.position.goal_w_m[2]);
        [planned, ordered].into_iter().flatten().fold(self.settings.start.position_w_m[2], f64::max)
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
            hover_s: controller::preview::Landing::default().after_s,
            landing_s: configs::landing_s(self.highest_m()),
            start_yaw_rad: self.start_yaw_rad(),
            vehicle: &self.modelled_vehicle(),
            graph: &graph,
            timing: self.timing(),
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
}

fn unwritable(name: &str) -> ScenarioError {
    let remedy = "write times as numbers of seconds; dates have no place in a scenario";
    Problem::new(name, "the scenario cannot be written back as TOML", remedy, None).into()
}
fn no_key(name: &str) -> ScenarioError {
    let remedy = "write what is to be other than usual, such as `duration_s = 5.0` under `[scenario]`; \
                  `morphquad run hover` flies a scenario that is there";
    Problem::new(name, "has no key in it", remedy, None).into()
}
