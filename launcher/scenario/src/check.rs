//! Rules that span keys or sections, after every section is valid by itself.

mod assignment;
mod laws;

pub use laws::TESTED_RATES_HZ;

use super::deadlines;
use super::document::Document;
use super::ordered;
use super::pilot_error::pilot_error;
use super::problem::Problem;
use super::script;
use super::settings::{Clock, Settings};
use super::wiring::{self, WiringError};
use super::{Scenario, ns_from_s};
use ::pilot::settings::{MAX_SPEED_M_S, MAX_TIME_SCALE, Manoeuvre, Plan, Trajectory as Given};
use ::pilot::{Pilot, RigPilot, Trajectory};
use disturbance_injector::Event;
use runtime::{Graph, GraphError};
use shared_types::time::s_from_ns;
use shared_types::{Role, TopicInfo};
use vehicle::ParameterError;

/// Share of the lateral force at full tilt that wind and trajectory may claim.
const TILT_SHARE: f64 = 0.8;

/// Distance from the beginning of a trajectory at which a flight still begins with it \[m\].
const BEGINS_WITHIN_M: f64 = 0.2;

/// Fastest turn of a heading that a trajectory may mean \[rad/s\].
const MAX_TURN_RAD_S: f64 = 4.0;

/// Height up to which a vehicle counts as standing on the ground \[m\].
const ON_THE_GROUND_M: f64 = 0.05;

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
    checker.clock();
    checker.deadlines();
    checker.graph();
    (checker.errors, checker.warnings)
}

/// The largest accelerations that a trajectory asks for.
#[derive(Debug, Clone, Copy, Default)]
struct Accelerations {
    /// See [`Trajectory::peak_sideways_m_s2`].
    sideways_m_s2: f64,
    /// Downwards and upwards.
    vertical_m_s2: [f64; 2],
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
        let attitude_hz = self.scenario.slot_rate_hz(Role::Attitude);
        if f64::from(plant.imu.rate_hz) < attitude_hz {
            let what = format!(
                "{} samples per second are too few for the attitude loop, which goes by {attitude_hz} estimates per second",
                plant.imu.rate_hz
            );
            let remedy = format!(
                "raise it to {:.0} or more, or lower the rate of the attitude loop",
                attitude_hz.ceil()
            );
            self.error("plant.imu.rate_hz", what, remedy);
        }
        if f64::from(plant.imu.rate_hz) > plant.rate_hz {
            let what = format!("the plant steps at {} Hz only", plant.rate_hz);
            self.warn("plant.imu.rate_hz", what, "raise plant.rate_hz or lower this rate");
        }
    }

    /// The gate drops a command after its validity, two periods of its writer.
    fn gate(&mut self) {
        let validity_s = self.settings().plant.gate.validity_max_s;
        let needed_s = 2.0 / self.scenario.slot_rate_hz(Role::Attitude);
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

    /// What the trajectory asks for.
    fn pilot(&mut self) -> Accelerations {
        let vehicle = self.scenario.modelled_vehicle();
        let built = match self.scenario.plan() {
            Plan::Rig(config) => RigPilot::new(&config, &vehicle).map(|_| Accelerations::default()),
            Plan::Flight(config) => Pilot::new(&config, &vehicle).map(|pilot| {
                self.given(pilot.trajectory());
                self.heights(pilot.trajectory());
                let window_ns = self.scenario.flown_of_the_plan_ns();
                let path = pilot.trajectory();
                Accelerations {
                    sideways_m_s2: path.peak_sideways_m_s2(window_ns, vehicle.gravity_m_s2),
                    vertical_m_s2: path.peak_vertical_m_s2(window_ns),
                }
            }),
        };
        if let Manoeuvre::Trajectory(given) = &self.settings().pilot.manoeuvre
            && !given.pieces.is_empty()
            && !given.samples.is_empty()
        {
            let what = "there are pieces as well, and one trajectory is flown";
            self.error("pilot.samples", what, "leave out `pieces` or `samples`");
        }
        let start_deg = self.settings().start.morph_angle_deg;
        if let Some([_, first_deg]) = self.settings().pilot.common.morph.first().copied()
            && self.settings().start.at_s <= 0.0
            && (first_deg - start_deg).abs() > 1e-9
        {
            let what = format!("the arms start at {start_deg} degrees and are told {first_deg}");
            self.warn("pilot.morph[0]", what, "let it equal start.morph_angle_deg");
        }
        built.unwrap_or_else(|error| {
            let (key, what, remedy) = pilot_error(&error);
            self.error(&key, what, remedy);
            Accelerations::default()
        })
    }

    /// A given trajectory that is too fast, turns too fast, or of which the flight misses the beginning or the end.
    fn given(&mut self, trajectory: &Trajectory) {
        if trajectory.pieces().is_none() {
            return;
        }
        let window_ns = self.scenario.flown_of_the_plan_ns();
        let [from_ns, until_ns] = window_ns;
        let speed_m_s = trajectory.peak_speed_m_s(window_ns);
        if speed_m_s > MAX_SPEED_M_S {
            let what = format!("leads along at up to {speed_m_s:.0} m/s");
            self.error(
                "pilot",
                what,
                "fly slower: pilot.time_scale takes longer for the same path; positions are in metres and times in seconds",
            );
        }
        let turn_rad_s = trajectory.fastest_turn_rad_s(window_ns);
        let start = &self.settings().start;
        let begin = trajectory.at(from_ns);
        let apart = |i: usize| start.position_w_m[i] - begin.position_w_m[i];
        let apart_m = libm::hypot(libm::hypot(apart(0), apart(1)), apart(2));
        // Of a flight that is taken up in the middle, errors are a part.
        if apart_m > BEGINS_WITHIN_M && start.at_s <= 0.0 {
            let what = format!("lies {apart_m:.2} m from where the trajectory begins");
            self.warn(
                "start.position_w_m",
                what,
                "leave it out: a flight begins with its trajectory",
            );
        }
        let rest_s = trajectory.rest_s().unwrap_or(0.0);
        let left_s = rest_s - s_from_ns(until_ns);
        if left_s > 1e-6 {
            let what =
                format!("ends {left_s:.2} s before the trajectory rests, at {rest_s:.2} s of it");
            self.warn("scenario.duration_s", what, "leave it out, or fly longer");
        }
        if turn_rad_s > MAX_TURN_RAD_S {
            let what = format!("turns by up to {turn_rad_s:.1} rad/s, faster than the vehicle can");
            let remedy = "turn slower; headings are in radians, those of samples in degrees in a column yaw_deg";
            self.warn("pilot", what, remedy);
        }
    }

    /// A reference that leads through the ground, or along it.
    fn heights(&mut self, trajectory: &Trajectory) {
        let [low_m, high_m] = trajectory.heights_m(self.scenario.flown_of_the_plan_ns());
        if !self.settings().plant.ground || (low_m >= 0.0 && high_m > ON_THE_GROUND_M) {
            return;
        }
        let what = if low_m < 0.0 {
            format!("leads down to {low_m:.3} m, and the ground is at 0 m")
        } else {
            format!("leads no higher than {high_m:.2} m, where the vehicle stands on the ground")
        };
        let remedy = match &self.settings().pilot.manoeuvre {
            Manoeuvre::Trajectory(Given { origin_w_m: [x_m, y_m, z_m], .. }) => {
                let lifted_m = libm::ceil(10.0 * (z_m - low_m)) / 10.0 + 1.5;
                format!(
                    "lift it, for example with pilot.origin_w_m = [{x_m:?}, {y_m:?}, {lifted_m:?}]"
                )
            }
            _ => "lift it, or fly without a ground: plant.ground = false".to_owned(),
        };
        self.error("pilot", what, remedy);
    }

    fn wind(&mut self, peak_m_s2: f64) {
        let (drag_n, wind) = self.drag_n();
        let vehicle = self.scenario.modelled_vehicle();
        let tilt_rad = self.scenario.position_law().map_or(0.35, |law| law.tilt_max_rad);
        let asked_n = drag_n + vehicle.mass_kg * peak_m_s2;
        let given_n = TILT_SHARE * vehicle.weight_n() * libm::tan(tilt_rad);
        if asked_n > given_n && !self.settings().pilot.is_rig() {
            let what = format!(
                "wind and trajectory ask for {asked_n:.2} N sideways, and {given_n:.2} N are to spend: {:.0} % of what the tilt bound gives",
                100.0 * TILT_SHARE
            );
            let key =
                wind.map_or("pilot".to_owned(), |i| format!("disturbance_injector.script[{i}]"));
            let remedy =
                self.slower((asked_n - drag_n) / (given_n - drag_n)).unwrap_or_else(|| {
                    "fly slower, in less wind, or raise position_mpc.tilt_max_rad".to_owned()
                });
            self.warn(&key, what, remedy);
        }
    }

    /// A reference that climbs or sinks faster than the bounds on the thrust let the vehicle.
    fn climb(&mut self, [down_m_s2, up_m_s2]: [f64; 2]) {
        let Ok(law) = self.scenario.position_law() else { return };
        let gravity_m_s2 = self.scenario.modelled_vehicle().gravity_m_s2;
        let bounds = [
            (down_m_s2, 1.0 - law.thrust_min_weights, "downwards", "thrust_min_weights"),
            (up_m_s2, law.thrust_max_weights - 1.0, "upwards", "thrust_max_weights"),
        ];
        for (asked_m_s2, weights, direction, key) in bounds {
            let given_m_s2 = weights * gravity_m_s2;
            if asked_m_s2 > given_m_s2 && !self.settings().pilot.is_rig() {
                let what = format!(
                    "leads {direction} with {asked_m_s2:.1} m/s^2, and position_mpc.{key} allows {given_m_s2:.1} m/s^2"
                );
                let slower = self.slower(asked_m_s2 / given_m_s2);
                self.warn("pilot", what, slower.unwrap_or_else(|| "fly slower".to_owned()));
            }
        }
    }

    /// How a given trajectory keeps within a bound of which it asks `times` as much, which goes with the square of the
    /// time; none of another trajectory.
    fn slower(&self, times: f64) -> Option<String> {
        let Manoeuvre::Trajectory(given) = &self.settings().pilot.manoeuvre else { return None };
        let scale = libm::ceil(100.0 * given.time_scale * times.max(0.0).sqrt()) / 100.0;
        Some(if times > 0.0 && scale <= MAX_TIME_SCALE {
            format!("fly slower: pilot.time_scale = {scale} keeps within it")
        } else {
            "no time_scale keeps within it: fly in less wind, or along another path".to_owned()
        })
    }

    /// Mean drag + 3 σ of the strongest wind \[N\], and which event it is.
    fn drag_n(&self) -> (f64, Option<usize>) {
        let drag = self.settings().vehicle.drag_n_s_m;
        let script = &self.settings().disturbance_injector.script;
        let winds = script.iter().enumerate().filter_map(|(index, event)| match event {
            Event::Wind(wind) => {
                let [x, y, _] = wind.mean_w_m_s;
                let sigma = wind.sigma_m_s[0].max(wind.sigma_m_s[1]);
                Some((drag * (libm::hypot(x, y) + 3.0 * sigma), Some(index)))
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
        let restarted = [
            (Role::Estimator, u64::from(settings.estimator.state_every)),
            (Role::Position, 1),
            (Role::Attitude, 1),
            (Role::Monitor, 1),
        ];
        for (role, state_every) in restarted {
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
                for (key, what, remedy) in scripted.chain(ordered::check(self.scenario)) {
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
