//! What each service of a flight is built from.

use crate::services::Assignment;
use crate::{Plan, Scenario, Settings};
use ::monitor::MonitorConfig;
use ::pilot::TakenUp;
use ::pilot::settings::Frame;
use ::vehicle::ParameterError;
use attitude_lqr::LqrConfig;
use attitude_mpc::settings::Surroundings;
use attitude_mpc::{AttitudeLawConfig, TorqueBound};
use attitude_pid::PidConfig;
use controller::attitude::Timing;
use estimator::{FilterConfig, InitialState};
use plant::gate::UnprovenRange;
use position_mpc::{Landing, PositionLawConfig};
use position_pid::PositionPidConfig;
use position_pid::settings::Shared;
use shared_types::Role;

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
        let settings = &self.settings;
        settings.position_mpc.law_config(position_mpc::settings::Surroundings {
            rotor_lag_s: settings.vehicle.rotor_lag_s,
            setpoint_latency_s: settings.latency.attitude_setpoint_s,
            attitude_period_s: 1.0 / self.slot_rate_hz(Role::Attitude),
        })
    }

    /// Rate of the loop in a slot \[Hz\].
    #[must_use]
    pub fn slot_rate_hz(&self, role: Role) -> f64 {
        Assignment::of(&self.settings).rate_hz(role, &self.settings)
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
            thrust_weights: [mpc.thrust_min_weights, mpc.thrust_max_weights],
            thrust_step_max_weights: mpc.thrust_step_max_weights,
        }))
    }

    /// What the monitor is built from; `landing` is what position controllers fly without a reference.
    #[must_use]
    pub fn monitor_config(&self, landing: Landing) -> MonitorConfig {
        let Settings { monitor, latency, .. } = &self.settings;
        MonitorConfig {
            limits: self.settings.monitor_limits(),
            period_s: 1.0 / monitor.rate_hz,
            latency_s: latency.trip_s,
            landing,
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
