//! Rules that span keys or sections, after every section is valid by itself.

mod assignment;
mod laws;
mod plan;

pub use laws::TESTED_RATES_HZ;

use super::deadlines;
use super::ordered;
use super::script;
use super::settings::{Clock, Settings};
use super::timing;
use super::wiring::{self, WiringError};
use super::{Scenario, ns_from_s};
use document::{Document, Problem};
use runtime::{Graph, GraphError};
use shared_types::{Role, Slot, TopicInfo};
use vehicle::ParameterError;

/// Thrust of all rotors over the weight below which no attitude controller has torque left in hover.
const LIFT_MIN_WEIGHTS: f64 = 1.05;

/// Errors and warnings.
pub(super) fn check(scenario: &Scenario, document: &Document<'_>) -> (Vec<Problem>, Vec<Problem>) {
    let mut checker = Checker { scenario, document, errors: Vec::new(), warnings: Vec::new() };
    checker.vehicle();
    checker.start();
    checker.attitude();
    if !scenario.settings.pilot.is_rig() {
        checker.position();
    }
    checker.assignment();
    checker.idle_keys();
    checker.estimator();
    checker.gate();
    let asked = checker.pilot();
    checker.wind(asked.sideways_m_s2);
    checker.climb(asked.vertical_m_s2);
    if !scenario.settings.pilot.is_rig() {
        checker.weight();
        checker.preview();
    }
    checker.clock();
    checker.deadlines();
    checker.graph();
    (checker.errors, checker.warnings)
}

struct Checker<'s> {
    scenario: &'s Scenario,
    document: &'s Document<'s>,
    errors: Vec<Problem>,
    warnings: Vec<Problem>,
}

impl<'s> Checker<'s> {
    fn settings(&self) -> &'s Settings {
        &self.scenario.settings
    }

    fn problem(&self, key: &str, what: impl Into<String>, remedy: impl Into<String>) -> Problem {
        Problem::new(key, what, remedy, self.document.place_of(key))
    }

    fn error(&mut self, key: &str, what: impl Into<String>, remedy: impl Into<String>) {
        self.errors.push(self.problem(key, what, remedy));
    }

    fn warn(&mut self, key: &str, what: impl Into<String>, remedy: impl Into<String>) {
        self.warnings.push(self.problem(key, what, remedy).into_warning());
    }

    fn vehicle(&mut self) {
        let modelled = self.scenario.modelled_vehicle();
        if let Err(ParameterError { name, value, remedy }) = modelled.validate() {
            let name = if name.contains('.') || !name.starts_with("inertia_") {
                name.to_owned()
            } else {
                format!("geometry.{name}")
            };
            self.error(&format!("vehicle.{name}"), format!("{value} is not usable"), remedy);
        } else if let Err(ParameterError { name, value, remedy }) =
            self.scenario.real_vehicle().validate()
        {
            let what = format!("makes {name} = {value}");
            self.error("plant.mismatch", what, remedy);
        } else {
            let weights = 4.0 * modelled.rotor_thrust_max_n / modelled.weight_n();
            if weights < LIFT_MIN_WEIGHTS {
                let what = format!(
                    "four rotors lift {weights:.2} times the weight, which leaves nothing to tilt and to turn by"
                );
                let least_n = 0.25 * LIFT_MIN_WEIGHTS * modelled.weight_n();
                let remedy = format!("give each {least_n:.3} N or more, or vehicle.mass_kg less");
                self.error("vehicle.rotor_thrust_max_n", what, remedy);
            }
        }
    }

    /// A place below the ground, and rotors that turn faster than any can.
    fn start(&mut self) {
        let [_, _, height_m] = self.settings().start.position_w_m;
        if self.settings().plant.ground && height_m < 0.0 {
            let what =
                format!("{height_m} m lies below the ground, which would throw the vehicle out");
            let remedy =
                "start at a height of 0 m or more, or without a ground: plant.ground = false";
            self.error("start.position_w_m", what, remedy);
        }
        let most_n = self.scenario.modelled_vehicle().rotor_thrust_max_n;
        let given = self.settings().start.rotor_thrust_n.unwrap_or_default();
        if let Some(index) = given.iter().position(|thrust_n| *thrust_n > most_n) {
            let what = format!("{} N is more than a rotor can give", given[index]);
            let remedy = format!("write at most vehicle.rotor_thrust_max_n, {most_n} N");
            self.error(&format!("start.rotor_thrust_n[{index}]"), what, remedy);
        }
    }

    /// A loop flies no estimate that is older than two of its periods, the attitude loop none that is older than 20 ms, too.
    fn estimates(&mut self) {
        let settings = self.settings();
        let (imu_hz, estimator_hz) =
            (f64::from(settings.plant.imu.rate_hz), settings.estimator.rate_hz);
        let [attitude_hz, position_hz] =
            [Slot::Attitude, Slot::Position].map(|slot| self.scenario.slot_rate_hz(slot));
        if imu_hz < attitude_hz {
            let what = format!(
                "{imu_hz} samples per second are too few for the attitude loop, which goes by {attitude_hz} estimates per second"
            );
            let remedy = format!(
                "raise it to {:.0} or more, or lower the rate of the attitude loop",
                attitude_hz.ceil()
            );
            self.error("plant.imu.rate_hz", what, remedy);
        }
        // A rig has no position loop.
        let flies = !settings.pilot.is_rig();
        for (key, rate_hz, of, least_hz, is_there) in [
            ("estimator.rate_hz", estimator_hz, "attitude", (0.5 * attitude_hz).min(50.0), true),
            ("estimator.rate_hz", estimator_hz, "position", 0.5 * position_hz, flies),
            ("plant.imu.rate_hz", imu_hz, "position", 0.5 * position_hz, flies),
        ] {
            if is_there && rate_hz < least_hz {
                let what = format!(
                    "with {rate_hz} per second the {of} loop has no estimate at many of its steps that is new enough to be flown, at most {:.0} ms old",
                    1e3 / least_hz
                );
                let remedy = format!(
                    "raise it to {:.0} or more, or lower the rate of that loop",
                    least_hz.ceil()
                );
                self.error(key, what, remedy);
            }
        }
    }

    fn estimator(&mut self) {
        if let Err(error) = self.scenario.filter() {
            let key = "estimator.fix_latency_s";
            self.error(key, error.to_string(), "bridge less, or lower plant.imu.rate_hz");
        }
        let (plant, estimator) = (&self.settings().plant, &self.settings().estimator);
        if plant.pose_fix.latency_s > estimator.fix_latency_s {
            let what = format!(
                "fixes arrive {} s late, but only {} s are bridged",
                plant.pose_fix.latency_s, estimator.fix_latency_s
            );
            let remedy = "raise estimator.fix_latency_s to at least this";
            self.error("plant.pose_fix.latency_s", what, remedy);
        }
        self.estimates();
        if f64::from(plant.imu.rate_hz) > plant.rate_hz {
            let what = format!("the plant steps at {} Hz only", plant.rate_hz);
            self.warn("plant.imu.rate_hz", what, "raise plant.rate_hz or lower this rate");
        }
    }

    /// The gate drops a command after its validity, two periods of its writer.
    fn gate(&mut self) {
        let validity_s = self.settings().plant.gate.validity_max_s;
        let needed_s = 2.0 / self.scenario.slot_rate_hz(Slot::Attitude);
        if needed_s > validity_s {
            let what = format!(
                "a command is valid for two periods, {needed_s:.3} s, but the gate allows {validity_s} s"
            );
            let remedy = format!(
                "raise the rate to {} Hz or more, or plant.gate.validity_max_s",
                2.0 / validity_s
            );
            self.error("attitude_mpc.rate_hz", what, remedy);
        }
    }

    fn clock(&mut self) {
        let settings = &self.settings().scenario;
        if settings.clock == Clock::Realtime && settings.pace().is_none() {
            let what = "the wall clock does not run as fast as the machine can";
            self.error("scenario.speed", what, "give a number, or clock = \"lockstep\"");
        }
        if ns_from_s(settings.duration_s) == 0 {
            self.error("scenario.duration_s", "is shorter than a nanosecond", "fly longer");
        }
    }

    fn deadlines(&mut self) {
        let realtime = &self.settings().realtime;
        let mut complaints = deadlines::of_unknown_edges(realtime);
        complaints.extend(deadlines::of_unhurried(realtime));
        if let (true, Ok(graph)) = (complaints.is_empty(), self.scenario.graph()) {
            complaints = deadlines::beyond_the_period(realtime, &graph);
        }
        for (key, what, remedy) in complaints {
            self.error(&key, what, remedy);
        }
    }

    /// A restarted process fetches what it missed from the history of its inputs.
    fn resumable(&mut self, graph: &Graph) {
        let settings = self.settings();
        let state_every = |role: Role| match role {
            Role::Estimator => Some(u64::from(settings.estimator.state_every)),
            role if role.is_slot() || role == Role::Monitor => Some(1),
            _ => None,
        };
        for role in Role::STEPPING {
            let Some(state_every) = state_every(role) else { continue };
            let rate_of = |topic: &TopicInfo| wiring::sensor_rate(settings, topic);
            if let Some((edge, needed)) = graph.too_short_history(role, state_every, &rate_of) {
                let TopicInfo { name, history, .. } = edge.topic;
                let what = format!(
                    "after a crash it would need the last {needed} samples of {name}, and {history} are kept"
                );
                let remedy = format!(
                    "lower {}.rate_hz, its lead or its latency, or accept that a restart is not exact",
                    wiring::section(edge.from)
                );
                self.warn(&format!("{}.rate_hz", wiring::section(role)), what, remedy);
            }
        }
    }

    fn graph(&mut self) {
        match self.scenario.graph() {
            Ok(graph) => {
                self.resumable(&graph);
                let scripted = script::check(self.settings(), &graph).into_iter();
                let timed = timing::check(self.settings(), &graph);
                for (key, what, remedy) in
                    scripted.chain(ordered::check(self.scenario)).chain(timed)
                {
                    self.error(&key, what, remedy);
                }
            }
            Err(WiringError::Rate { section, error }) => {
                let remedy = "write a rate with at most three decimals";
                self.error(&format!("{section}.rate_hz"), error.to_string(), remedy);
            }
            Err(WiringError::Graph(error)) => {
                let key = match &error {
                    GraphError::ZeroLatencyLoop(_) => "latency".to_owned(),
                    GraphError::BufferTooSmall { producer, .. } => {
                        let role =
                            Role::STEPPING.into_iter().find(|role| role.label() == *producer);
                        role.map_or_else(String::new, |r| format!("{}.rate_hz", wiring::section(r)))
                    }
                };
                let remedy = "change the rates or latencies that it names";
                self.error(&key, error.to_string(), remedy);
            }
        }
    }
}
