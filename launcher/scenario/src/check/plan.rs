//! What the pilot's plan, and the wind beside it, ask of the vehicle.

use super::Checker;
use crate::pilot_error::pilot_error;
use ::pilot::settings::{MAX_SPEED_M_S, MAX_TIME_SCALE, Manoeuvre, Plan, Trajectory as Given, Yaw};
use ::pilot::{Pilot, RigPilot, Trajectory};
use disturbance_injector::Event;
use shared_types::guidance::REFERENCE_POINTS;
use shared_types::time::s_from_ns;
use vehicle::wrap_pi;

/// Share of the lateral force at full tilt that wind and trajectory may claim.
const TILT_SHARE: f64 = 0.8;

/// Distance from the beginning of a trajectory at which a flight still begins with it \[m\].
const BEGINS_WITHIN_M: f64 = 0.2;

/// Difference of headings at which a flight still begins along its path \[rad\].
const POINTS_WITHIN_RAD: f64 = 0.2;

/// Fastest turn of a heading that a trajectory may mean \[rad/s\].
const MAX_TURN_RAD_S: f64 = 4.0;

/// Height up to which a vehicle counts as standing on the ground \[m\].
const ON_THE_GROUND_M: f64 = 0.05;

/// The largest accelerations that a trajectory asks for.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Accelerations {
    /// See [`Trajectory::peak_sideways_m_s2`].
    pub(super) sideways_m_s2: f64,
    /// Downwards and upwards.
    pub(super) vertical_m_s2: [f64; 2],
}

impl Checker<'_> {
    /// What the trajectory asks for.
    pub(super) fn pilot(&mut self) -> Accelerations {
        let vehicle = self.scenario.modelled_vehicle();
        let built = match self.scenario.plan() {
            Plan::Rig(config) => RigPilot::new(&config, &vehicle).map(|_| Accelerations::default()),
            Plan::Flight(config) => Pilot::new(&config, &vehicle).map(|pilot| {
                self.given(pilot.trajectory());
                self.heights(pilot.trajectory());
                self.heading(pilot.trajectory());
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
            let what =
                format!("the arms start at {start_deg} degrees and are ordered to {first_deg}");
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

    /// A flight whose nose points elsewhere than along the path that it is to follow.
    fn heading(&mut self, trajectory: &Trajectory) {
        let Manoeuvre::Figure8(figure) = &self.settings().pilot.manoeuvre else { return };
        let [from_ns, _] = self.scenario.flown_of_the_plan_ns();
        let along_rad = trajectory.at(from_ns).yaw_rad;
        let away_rad = wrap_pi(along_rad - self.scenario.start_yaw_rad());
        if figure.yaw == Yaw::AlongPath && away_rad.abs() > POINTS_WITHIN_RAD {
            let what = format!(
                "the nose points {:.0} degrees away from the path at the start",
                away_rad.abs().to_degrees()
            );
            let remedy = format!("begin along it: start.yaw_deg = {:.1}", along_rad.to_degrees());
            self.warn("start.yaw_deg", what, remedy);
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

    pub(super) fn wind(&mut self, peak_m_s2: f64) {
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

    /// A vehicle that is heavier than the controllers' model by more than their bound on the thrust can carry.
    pub(super) fn weight(&mut self) {
        let Ok(law) = self.scenario.position_law() else { return };
        let weight_n = self.scenario.real_vehicle().weight_n();
        let most_n = law.thrust_max_weights * self.scenario.modelled_vehicle().weight_n();
        if weight_n > most_n {
            let what = format!(
                "makes it weigh {weight_n:.2} N, and position_mpc.thrust_max_weights lets {most_n:.2} N carry it"
            );
            let remedy = "load it less, or raise position_mpc.thrust_max_weights";
            self.warn("plant.mismatch.mass_scale", what, remedy);
        }
    }

    /// A position law that looks farther ahead than the reference that the pilot publishes.
    pub(super) fn preview(&mut self) {
        let Ok(law) = self.scenario.position_law() else { return };
        let common = &self.settings().pilot.common;
        // The oldest reference that is in use was published a period of the pilot ago.
        let spacings = (REFERENCE_POINTS - 1) as f64;
        let known_s = spacings * common.preview_spacing_s - 1.0 / common.rate_hz;
        let looks_s = law.horizon.prediction as f64 / law.rate_hz + law.tilt_delay_s;
        if looks_s > known_s {
            let what = format!(
                "the reference is known for {known_s:.2} s, and position_mpc.prediction_horizon looks {looks_s:.2} s ahead"
            );
            let least_s = libm::ceil(1e3 * (looks_s + 1.0 / common.rate_hz) / spacings) * 1e-3;
            let remedy = format!("write {least_s:.3} or more, or look less far ahead");
            self.warn("pilot.preview_spacing_s", what, remedy);
        }
    }

    /// A reference that climbs or sinks faster than the bounds on the thrust let the vehicle.
    pub(super) fn climb(&mut self, [down_m_s2, up_m_s2]: [f64; 2]) {
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
}
