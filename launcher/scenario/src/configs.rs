//! What each service of a flight is built from.

use crate::services::{Assignment, usual_rate_hz};
use crate::{Plan, Scenario, Settings};
use ::monitor::MonitorConfig;
use ::pilot::TakenUp;
use ::pilot::settings::Frame;
use ::vehicle::ParameterError;
use attitude_mpc::{AttitudeLawConfig, TorqueBound};
use controller::preview::Landing;
use controller::{FlightFacts, SetpointBounds};
use estimator::{FilterConfig, InitialState};
use plant::gate::UnprovenRange;
use position_mpc::PositionLawConfig;
use shared_types::{PerSlot, Slot};

/// From the end of a descent until the vehicle stands still on the ground, and by how much it may have begun late: the last
/// reference is ahead of its time \[s\].
const SETTLE_S: f64 = 2.0;

/// How long the vehicle needs to land from a height once no reference comes any more \[s\].
pub(crate) fn landing_s(height_m: f64) -> f64 {
    let landing = Landing::default();
    landing.after_s + landing.lasts_s(height_m) + SETTLE_S
}

impl Scenario {
    /// What the plant is built from.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn plant_config(&self) -> Result<plant::PlantConfig, ParameterError> {
        let settings = &self.settings.plant;
        let believed = self.modelled_vehicle();
        let limits = self.settings.monitor_limits();
        let weights = limits.setpoint_thrust_weights;
        let unproven = UnprovenRange {
            believed,
            thrust_n: weights.map(|weights| weights * believed.weight_n()),
            tilt_rad: limits.tilt_rad,
        };
        Ok(plant::PlantConfig {
            vehicle: self.real_vehicle(),
            model: settings.model_kind(),
            sensors: settings.sensors(),
            gate: settings.gate.clone(),
            unproven: (self.settings.monitor.enabled && self.keeps_to_rotors()).then_some(unproven),
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
        let rates_hz = [plant.imu.rate_hz, plant.morph_encoder.rate_hz].map(f64::from);
        let config = estimator.filter_config(vehicle.gravity_m_s2, rates_hz[0], rates_hz[1])?;
        let morph_angle_rad = start.morph_angle_deg.to_radians();
        let yaw_rad = self.start_yaw_rad();
        let (position_w_m, velocity_w, attitude) = start.belief();
        let initial = estimator.initial_state(position_w_m, yaw_rad, morph_angle_rad);
        let q_wb = attitude.unwrap_or(initial.q_wb);
        Ok((config, InitialState { velocity_w, q_wb, ..initial }))
    }

    /// What every controller is given beside its own section.
    #[must_use]
    pub fn flight_facts(&self) -> FlightFacts {
        let settings = &self.settings;
        let bounds = |law: &PositionLawConfig| SetpointBounds {
            tilt_max_rad: law.tilt_max_rad,
            thrust_weights: [law.thrust_min_weights, law.thrust_max_weights],
            thrust_step_max_weights: law.thrust_step_max_weights,
        };
        let mut facts = FlightFacts {
            vehicle: self.modelled_vehicle(),
            start_yaw_rad: self.start_yaw_rad(),
            is_rig: settings.pilot.is_rig(),
            plant_rate_hz: settings.plant.rate_hz,
            rate_hz: PerSlot::from_fn(|slot| self.slot_rate_hz(slot)),
            usual_rate_hz: PerSlot::from_fn(|slot| usual_rate_hz(slot, settings)),
            wrench_latency_s: settings.latency.wrench_command_s,
            setpoint_latency_s: settings.latency.attitude_setpoint_s,
            setpoint_bounds: bounds(&PositionLawConfig::default()),
            landing: Landing::default(),
        };
        // Without the MPC's own, of which its section is refused, other position controllers are judged by the usual ones.
        if let Ok(law) = settings.position_mpc.law_config((&facts).into()) {
            facts.setpoint_bounds = bounds(&law);
        }
        facts
    }

    /// The law of the attitude MPC.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn attitude_law(&self) -> Result<AttitudeLawConfig, attitude_mpc::ConfigError> {
        self.settings.attitude_mpc.law_config((&self.flight_facts()).into())
    }

    /// The law of the position MPC; it flies unless the pilot has a rig.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn position_law(&self) -> Result<PositionLawConfig, position_mpc::ConfigError> {
        self.settings.position_mpc.law_config((&self.flight_facts()).into())
    }

    /// Rate of the loop in a slot \[Hz\].
    #[must_use]
    pub fn slot_rate_hz(&self, slot: Slot) -> f64 {
        Assignment::of(&self.settings).rate_hz(slot.role(), &self.settings)
    }

    /// What the monitor is built from.
    #[must_use]
    pub fn monitor_config(&self) -> MonitorConfig {
        let Settings { monitor, latency, .. } = &self.settings;
        MonitorConfig {
            limits: self.settings.monitor_limits(),
            period_s: 1.0 / monitor.rate_hz,
            latency_s: latency.trip_s,
            landing: Landing::default(),
            keeps_to_rotors: self.keeps_to_rotors(),
        }
    }

    /// Whether the laws of the attitude slot ask for no more torque than hover thrust leaves.
    #[must_use]
    pub fn keeps_to_rotors(&self) -> bool {
        self.attitude_law().is_ok_and(|law| law.torque_bound == TorqueBound::Rotors)
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
