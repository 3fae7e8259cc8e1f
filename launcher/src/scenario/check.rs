//! Rules that span keys or sections, after every section is valid by itself.

use super::document::Document;
use super::pilot::Plan;
use super::problem::Problem;
use super::settings::{Clock, Settings};
use super::wiring::{self, WiringError};
use super::{Scenario, ns_from_s};
use crate::pilot::{Pilot, PilotError, RigPilot};
use attitude_mpc::{MpcError, TorqueBound};
use disturbance_injector::Event;
use runtime::{Graph, GraphError};
use shared_types::{Role, TopicInfo};
use vehicle::ParameterError;

/// The paper's bound on yaw, 2 m g L, over what rotors give at most, 2 k m g, at the full arm length.
const PAPER_TORQUE_RANGE: f64 = 10.5;

/// An attitude prediction shorter than this many rotor lags does not see what its torque does.
const LEAST_ROTOR_LAGS: f64 = 5.0;
/// Rates at which the steps of 0.2 rad are tested \[Hz\].
const TESTED_RATES_HZ: core::ops::RangeInclusive<f64> = 50.0..=1000.0;
/// Share of the lateral force at full tilt that wind and trajectory may claim.
const TILT_SHARE: f64 = 0.8;

/// Errors and warnings.
pub(super) fn check(scenario: &Scenario, document: &Document<'_>) -> (Vec<Problem>, Vec<Problem>) {
    let mut checker = Checker { scenario, document, errors: Vec::new(), warnings: Vec::new() };
    checker.vehicle();
    checker.attitude();
    if !scenario.settings.pilot.is_rig() {
        checker.position();
    }
    checker.estimator();
    checker.gate();
    let peak_m_s2 = checker.pilot();
    checker.wind(peak_m_s2);
    checker.clock();
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
        }
    }

    fn attitude(&mut self) {
        let law = self.settings().attitude_mpc;
        if law.horizon_s.is_some() && law.prediction_horizon.is_some() {
            let what = "says the same as attitude_mpc.prediction_horizon";
            self.error("attitude_mpc.horizon_s", what, "keep one of the two");
        }
        if law.control_horizon.is_some() && law.prediction_horizon.is_none() {
            let what = "needs attitude_mpc.prediction_horizon beside it";
            self.error("attitude_mpc.control_horizon", what, "give both in samples, or horizon_s");
        }
        let config = match self.scenario.attitude_law() {
            Ok(config) => config,
            Err(attitude_mpc::ConfigError::Engine(MpcError::OutOfRange {
                name,
                value,
                least,
                most,
            })) => {
                let key = match name {
                    "command_delay_s" if law.command_delay_s.is_none() => {
                        "latency.wrench_command_s".to_owned()
                    }
                    "command_latency_s" => "latency.wrench_command_s".to_owned(),
                    "report_period_s" => "plant.rate_hz".to_owned(),
                    name => format!("attitude_mpc.{name}"),
                };
                return self.out_of_range(&key, value, least, most);
            }
            Err(error) => return self.refused("attitude_mpc", &error.to_string()),
        };
        if !TESTED_RATES_HZ.contains(&law.rate_hz) {
            let what =
                format!("{} Hz is slower than any attitude loop that is tested", law.rate_hz);
            let remedy = "fly at 50 Hz or more, or look at attitude-step first";
            self.warn("attitude_mpc.rate_hz", what, remedy);
        }
        let gate = self.settings().plant.gate.torque_range_factor;
        if config.torque_bound == TorqueBound::Paper && gate < PAPER_TORQUE_RANGE {
            let what = "lets the law ask for torques that the plant's gate refuses";
            let remedy = "set plant.gate.torque_range_factor = 100, as for the paper's own vehicle";
            self.warn("attitude_mpc.torque_bound", what, remedy);
        }
        let look_ahead_s = attitude_mpc::settings::Settings::look_ahead_s(&config);
        // The rotors' own lag: the margin on the modelled one asks for no longer look.
        let lag_s = law.rotor_lag_s.unwrap_or(self.settings().vehicle.rotor_lag_s);
        let lag_s = lag_s.min(config.rotor_lag_s);
        let needed_s = LEAST_ROTOR_LAGS * lag_s;
        let asked_s = law.horizon_s.unwrap_or(f64::INFINITY);
        if let Some(look_ahead_s) =
            look_ahead_s.ok().map(|s| s.min(asked_s)).filter(|&s| s < needed_s)
        {
            let key = if law.horizon_s.is_some() { "horizon_s" } else { "prediction_horizon" };
            let what = format!(
                "{look_ahead_s:.3} s of prediction do not cover {LEAST_ROTOR_LAGS} rotor lags of {lag_s} s"
            );
            let remedy = format!("look at least {needed_s:.3} s ahead, or set model = \"paper\"");
            self.error(&format!("attitude_mpc.{key}"), what, remedy);
        }
    }

    fn position(&mut self) {
        let law = self.settings().position_mpc;
        if law.control_horizon.is_some() && law.prediction_horizon.is_none() {
            let what = "needs position_mpc.prediction_horizon beside it";
            self.error("position_mpc.control_horizon", what, "give both in samples");
        }
        if let (Some(least), Some(most)) = (law.thrust_min_weights, law.thrust_max_weights)
            && least >= most
        {
            let what = format!("the lower bound {least} is not below the upper bound {most}");
            let remedy = "let thrust_min_weights < 1 < thrust_max_weights";
            return self.error("position_mpc.thrust_min_weights", what, remedy);
        }
        match self.scenario.position_law() {
            Ok(_) => {}
            Err(position_mpc::ConfigError::Engine(MpcError::OutOfRange {
                name,
                value,
                least,
                most,
            })) => {
                self.out_of_range(&format!("position_mpc.{name}"), value, least, most);
            }
            Err(error) => self.refused("position_mpc", &error.to_string()),
        }
    }

    fn out_of_range(&mut self, key: &str, value: f64, least: f64, most: f64) {
        let what = format!("{value} does not go with the other settings");
        self.error(key, what, format!("write a number from {least} to {most}"));
    }

    /// Complains about what the laws' engine refuses and a range of numbers cannot tell.
    fn refused(&mut self, section: &str, what: &str) {
        let (key, remedy) = if what.starts_with("laguerre_pole") {
            ("laguerre_pole", "let 0 <= pole < 1 for each input; 0 is the classic form")
        } else if what.starts_with("laguerre_terms") {
            ("laguerre_terms", "give each input 1 to 50 functions")
        } else {
            ("control_horizon", "let 1 <= control_horizon <= 50 and <= prediction_horizon <= 200")
        };
        self.error(&format!("{section}.{key}"), what, remedy);
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
        if f64::from(plant.imu.rate_hz) > plant.rate_hz {
            let what = format!("the plant steps at {} Hz only", plant.rate_hz);
            self.warn("plant.imu.rate_hz", what, "raise plant.rate_hz or lower this rate");
        }
    }

    /// The gate drops a command after its validity, two periods of its writer.
    fn gate(&mut self) {
        let validity_s = self.settings().plant.gate.validity_max_s;
        let needed_s = 2.0 / self.settings().attitude_mpc.rate_hz;
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

    /// Largest acceleration of the trajectory \[m/s²\].
    fn pilot(&mut self) -> f64 {
        let vehicle = self.scenario.modelled_vehicle();
        let built = match self.scenario.plan() {
            Plan::Rig(config) => RigPilot::new(&config, &vehicle).map(|_| 0.0),
            Plan::Flight(config) => Pilot::new(&config, &vehicle).map(|pilot| {
                pilot.trajectory().peak_acceleration_m_s2(self.scenario.duration_ns())
            }),
        };
        let start_deg = self.settings().start.morph_angle_deg;
        if let Some([_, first_deg]) = self.settings().pilot.common.morph.first().copied()
            && (first_deg - start_deg).abs() > 1e-9
        {
            let what = format!("the arms start at {start_deg} degrees and are told {first_deg}");
            self.warn("pilot.morph[0]", what, "let it equal start.morph_angle_deg");
        }
        built.unwrap_or_else(|error| {
            let (key, remedy) = pilot_key(&error);
            self.error(&key, error.to_string(), remedy);
            0.0
        })
    }

    fn wind(&mut self, peak_m_s2: f64) {
        let (drag_n, wind) = self.drag_n();
        let vehicle = self.scenario.modelled_vehicle();
        let tilt_rad = self.scenario.position_law().map_or(0.35, |law| law.tilt_max_rad);
        let asked_n = drag_n + vehicle.mass_kg * peak_m_s2;
        let given_n = TILT_SHARE * vehicle.weight_n() * libm::tan(tilt_rad);
        if asked_n > given_n && !self.settings().pilot.is_rig() {
            let what = format!(
                "wind and trajectory ask for {asked_n:.2} N sideways, the tilt bound gives {given_n:.2} N to spend"
            );
            let key =
                wind.map_or("pilot".to_owned(), |i| format!("disturbance_injector.script[{i}]"));
            self.warn(&key, what, "fly slower, in less wind, or raise position_mpc.tilt_max_rad");
        }
    }

    /// Mean drag + 3 σ of the strongest wind \[N\], and which event it is.
    fn drag_n(&self) -> (f64, Option<usize>) {
        let drag = self.settings().vehicle.drag_n_s_m;
        let script = &self.settings().disturbance_injector.script;
        let winds = script.iter().enumerate().filter_map(|(index, event)| match event {
            Event::Wind(wind) => {
                let [x, y, _] = wind.mean_w_m_s;
                let sigma = wind.sigma_m_s[0].max(wind.sigma_m_s[1]);
                Some((drag * (x.hypot(y) + 3.0 * sigma), Some(index)))
            }
            _ => None,
        });
        winds.fold((0.0, None), |most, wind| if wind.0 > most.0 { wind } else { most })
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

    /// A restarted process fetches what it missed from the history of its inputs.
    fn resumable(&mut self, graph: &Graph) {
        let settings = self.settings();
        let restarted = [
            (Role::Estimator, u64::from(settings.estimator.state_every)),
            (Role::Position, 1),
            (Role::Attitude, 1),
        ];
        for (role, state_every) in restarted {
            if let Some((edge, needed)) = graph.too_short_history(role, state_every) {
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
            Ok(graph) => self.resumable(&graph),
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

/// Key of what a pilot refuses.
fn pilot_key(error: &PilotError) -> (String, &'static str) {
    match error {
        PilotError::OutOfRange { parameter, .. } => {
            let own = parameter.trim_start_matches("trajectory.").trim_start_matches("step.");
            (format!("pilot.{}", own.replace("waypoints", "points")), "write a number in the range")
        }
        PilotError::Empty { .. } => ("pilot".to_owned(), "give at least one entry"),
        PilotError::TimesNotIncreasing { parameter, index, .. } => {
            let list = if *parameter == "morph" { "morph" } else { "points" };
            (format!("pilot.{list}[{index}]"), "let the times increase from entry to entry")
        }
        PilotError::FigureTooShort { .. } => {
            ("pilot.period_s".to_owned(), "fly longer or shorten the leads")
        }
        PilotError::MorphTooFast { index, .. } => (
            format!("pilot.morph[{index}]"),
            "give the sweep more time, or the servo a higher limit",
        ),
    }
}
