//! The section `[attitude_mpc]` of a scenario.
//!
//! Keys left out take the value that suits the rate and the model, see
//! [`AttitudeLawConfig::flight`] and [`AttitudeLawConfig::paper`].
//!
//! A program has 6 constraint rows for each sample of Nc, 7 if the torques are bounded by rotor
//! thrusts, and 3 for each sample of Np if angles are bounded, 3 more if rates are. There is room
//! for [`mpc::ROW_CAPACITY`], 1024, of them; more are refused.

use controller::{ControllerSection, FlightFacts, SectionRefusal};
use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::Slot;
use vehicle::MorphAngle;

use crate::{
    AttitudeLawConfig, AttitudeMpc, Basis, ConfigError, Horizon, HorizonChoice, SolverKind,
    TorqueBound,
};

/// What a scenario sets of the attitude law.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Control rate \[Hz\].
    #[garde(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Which prediction model, and with it which set of defaults for the keys that have none here.
    #[garde(skip)]
    pub model: Model,
    /// Look-ahead \[s\]; Np and Nc follow from the rate.
    #[garde(range(min = 0.001, max = 10.0))]
    pub horizon_s: Option<f64>,
    /// Np in samples, instead of `horizon_s`.
    #[garde(range(min = 1, max = 200))]
    pub prediction_horizon: Option<u16>,
    /// Nc in samples, beside `prediction_horizon`; a tenth of it, at least 3, if left out.
    #[garde(range(min = 1, max = 50))]
    pub control_horizon: Option<u16>,
    /// Weight `r_w` in eq. (15) on increments of the body torques of roll and pitch \[rad²/(N m)²\], at Ixx = 1e-4 kg m²
    /// if it is scaled; if left out 5 (rate/100 Hz)², for the paper's model 0.25.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub increment_weight: Option<f64>,
    /// Factor on `increment_weight` for pitch; 1 if left out.
    #[garde(range(min = 1e-6, max = 1e6))]
    pub pitch_weight_factor: Option<f64>,
    /// Factor on `increment_weight` for yaw; if left out 8, for the paper's model 0.25.
    #[garde(range(min = 1e-6, max = 1e6))]
    pub yaw_weight_factor: Option<f64>,
    /// Weight Q in eq. (15) on the errors of the Euler angles roll, pitch and yaw; 1 each if left out.
    #[garde(inner(inner(range(min = 0.0, max = 1e9))))]
    pub output_weight: Option<[f64; 3]>,
    /// Factor on `output_weight` at the last sample of the horizon; 1 if left out.
    #[garde(range(min = 0.0, max = 1e9))]
    pub terminal_factor: Option<f64>,
    /// Poles of the Laguerre functions of roll, pitch and yaw torque. Inputs are then bounded not
    /// only over Nc samples but for as long as the functions last, at most 50.
    #[garde(skip)]
    pub laguerre_pole: Option<[f64; 3]>,
    /// How many Laguerre functions roll, pitch and yaw torque have; Nc of them if left out.
    #[garde(skip)]
    pub laguerre_terms: Option<[u8; 3]>,
    /// Whether `increment_weight` is scaled with 1/Ixx(β)², which keeps the loop in samples the same at every size; if left
    /// out it is, but for the paper's model.
    #[garde(skip)]
    pub scale_weight_with_inertia: Option<bool>,
    /// Where the torque bounds come from.
    #[garde(skip)]
    pub torque_bound: Option<TorqueBound>,
    /// Price of leaving the torque bounds, in increments that cost 1; they are hard if left out.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub level_penalty: Option<f64>,
    /// Whether increments are bounded as well.
    #[garde(skip)]
    pub increment_bound: Option<bool>,
    /// Price of leaving the bounds on increments, as `level_penalty`; they are hard if left out.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub increment_penalty: Option<f64>,
    /// Bound on predicted roll and pitch \[rad\], at each sample of Np.
    #[garde(range(min = 1e-3, max = 3.2))]
    pub angle_max_rad: Option<f64>,
    /// Bound on predicted Euler rates \[rad/s\], at each sample of Np.
    #[garde(range(min = 1e-3, max = 1e3))]
    pub rate_max_rad_s: Option<f64>,
    /// Price of leaving `angle_max_rad` and `rate_max_rad_s`, as `level_penalty`; they are hard if left out.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub state_penalty: Option<f64>,
    /// Whether a commanded morph is followed along the horizon.
    #[garde(skip)]
    pub morph_preview: Option<bool>,
    /// How far along the horizon a commanded morph is followed \[s\]; as far as the torque can still move if left out.
    #[garde(range(min = 0.0, max = 10.0))]
    pub morph_preview_s: Option<f64>,
    /// Rotor lag in the prediction model \[s\]; the vehicle's with a margin if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub rotor_lag_s: Option<f64>,
    /// Command delay in the prediction model \[s\]; the wrench command's latency if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub command_delay_s: Option<f64>,
    /// Time over which a new setpoint is approached \[s\]; one position period if left out.
    #[garde(range(min = 0.0, max = 10.0))]
    pub setpoint_ramp_s: Option<f64>,
    /// Change of the morph angle \[°\] below which the matrices stay.
    #[garde(range(min = 0.0, max = 115.0))]
    pub rebuild_tolerance_deg: f64,
    /// Angle \[°\] of model, weights and bounds instead of the measured one.
    #[garde(range(min = 45.0, max = 160.0))]
    pub fixed_morph_angle_deg: Option<f64>,
    /// Solver of the quadratic program: `active-set`, or for comparison `hildreth` or `hildreth-converged`.
    #[garde(skip)]
    #[schemars(with = "String")]
    pub solver: SolverKind,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            rate_hz: 100.0,
            model: Model::Flight,
            horizon_s: None,
            prediction_horizon: None,
            control_horizon: None,
            increment_weight: None,
            pitch_weight_factor: None,
            yaw_weight_factor: None,
            output_weight: None,
            terminal_factor: None,
            laguerre_pole: None,
            laguerre_terms: None,
            scale_weight_with_inertia: None,
            torque_bound: None,
            level_penalty: None,
            increment_bound: None,
            increment_penalty: None,
            angle_max_rad: None,
            rate_max_rad_s: None,
            state_penalty: None,
            morph_preview: None,
            morph_preview_s: None,
            rotor_lag_s: None,
            command_delay_s: None,
            setpoint_ramp_s: None,
            rebuild_tolerance_deg: 0.0,
            fixed_morph_angle_deg: None,
            solver: SolverKind::ActiveSet,
        }
    }
}

/// Prediction model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// With the rotors' lag and the command's delay.
    Flight,
    /// Model (8) alone, with the paper's bounds and weights.
    Paper,
}

/// What the law must know of the flight around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// The vehicle's rotor lag \[s\].
    pub rotor_lag_s: f64,
    /// Declared latency of the wrench command \[s\].
    pub wrench_latency_s: f64,
    /// Period of the plant's reports of the applied torque \[s\].
    pub report_period_s: f64,
    /// Period of the position loop \[s\]; 0 if setpoints come as steps.
    pub setpoint_period_s: f64,
}

impl From<&FlightFacts> for Surroundings {
    fn from(flight: &FlightFacts) -> Self {
        let setpoint_period_s =
            if flight.is_rig { 0.0 } else { 1.0 / flight.rate_hz[Slot::Position] };
        Self {
            rotor_lag_s: flight.vehicle.rotor_lag_s,
            wrench_latency_s: flight.wrench_latency_s,
            report_period_s: 1.0 / flight.plant_rate_hz,
            setpoint_period_s,
        }
    }
}

impl ControllerSection for Settings {
    type Service = AttitudeMpc;
    const SLOT: Slot = Slot::Attitude;

    fn rate_hz(&self) -> Option<f64> {
        Some(self.rate_hz)
    }

    fn build(&self, flight: &FlightFacts) -> Result<AttitudeMpc, SectionRefusal> {
        self.law_config(flight.into())
            .and_then(|config| AttitudeMpc::new(config, &flight.vehicle, flight.start_yaw_rad))
            .map_err(|error| SectionRefusal::Refused {
                what: error.to_string(),
                remedy: "`morphquad check` names the key to blame",
            })
    }

    /// A scenario asks for [`law_config`](Settings::law_config) and reports which key is to blame.
    fn check(&self, _flight: &FlightFacts) -> Result<(), SectionRefusal> {
        Ok(())
    }
}

impl Settings {
    /// The law's numbers, checked.
    ///
    /// # Errors
    /// The first number that the law refuses.
    pub fn law_config(&self, around: Surroundings) -> Result<AttitudeLawConfig, ConfigError> {
        let flight = AttitudeLawConfig {
            command_delay_s: around.wrench_latency_s,
            command_latency_s: around.wrench_latency_s,
            rotor_lag_s: around.rotor_lag_s * AttitudeLawConfig::lag_margin(self.rate_hz),
            report_period_s: around.report_period_s,
            setpoint_ramp_s: around.setpoint_period_s,
            ..AttitudeLawConfig::flight(self.rate_hz)
        };
        let paper = AttitudeLawConfig {
            rate_hz: self.rate_hz,
            command_latency_s: around.wrench_latency_s,
            report_period_s: around.report_period_s,
            ..AttitudeLawConfig::paper()
        };
        let base = if self.model == Model::Paper { paper } else { flight };
        let config = AttitudeLawConfig {
            horizon: self.horizon().unwrap_or(base.horizon),
            increment_weight: self.increment_weight.unwrap_or(base.increment_weight),
            pitch_weight_factor: self.pitch_weight_factor.unwrap_or(base.pitch_weight_factor),
            yaw_weight_factor: self.yaw_weight_factor.unwrap_or(base.yaw_weight_factor),
            output_weight: self.output_weight.unwrap_or(base.output_weight),
            terminal_factor: self.terminal_factor.unwrap_or(base.terminal_factor),
            level_penalty: self.level_penalty,
            increment_bound: self.increment_bound.unwrap_or(base.increment_bound),
            increment_penalty: self.increment_penalty,
            angle_max_rad: self.angle_max_rad,
            rate_max_rad_s: self.rate_max_rad_s,
            state_penalty: self.state_penalty,
            morph_preview: self.morph_preview.unwrap_or(base.morph_preview),
            morph_preview_s: self.morph_preview_s,
            scale_weight_with_inertia: self
                .scale_weight_with_inertia
                .unwrap_or(base.scale_weight_with_inertia),
            torque_bound: self.torque_bound.unwrap_or(base.torque_bound),
            rotor_lag_s: self.rotor_lag_s.unwrap_or(base.rotor_lag_s),
            command_delay_s: self.command_delay_s.unwrap_or(base.command_delay_s),
            setpoint_ramp_s: self.setpoint_ramp_s.unwrap_or(base.setpoint_ramp_s),
            rebuild_tolerance_rad: self.rebuild_tolerance_deg.to_radians(),
            fixed_morph_angle: self
                .fixed_morph_angle_deg
                .and_then(|angle| MorphAngle::saturating_from_rad(angle.to_radians())),
            solver: self.solver,
            ..base
        };
        let control = config.horizon.samples(config.rate_hz)?.control;
        let laguerre = Basis::given(self.laguerre_pole, self.laguerre_terms, control);
        let config = AttitudeLawConfig { laguerre, ..config };
        config.validate()?;
        Ok(config)
    }

    /// How far `config` looks ahead \[s\].
    ///
    /// # Errors
    /// A horizon that no rate can give.
    pub fn look_ahead_s(config: &AttitudeLawConfig) -> Result<f64, ConfigError> {
        let horizon = config.horizon.samples(config.rate_hz)?;
        Ok(horizon.prediction as f64 * config.period_s())
    }

    fn horizon(&self) -> Option<HorizonChoice> {
        let samples = self.prediction_horizon.map(|prediction| {
            let control = self.control_horizon.unwrap_or(prediction.div_ceil(10).max(3));
            HorizonChoice::Samples(Horizon {
                prediction: prediction.into(),
                control: control.into(),
            })
        });
        samples.or(self.horizon_s.map(HorizonChoice::Seconds))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AROUND: Surroundings = Surroundings {
        rotor_lag_s: 0.015,
        wrench_latency_s: 0.001,
        report_period_s: 0.001,
        setpoint_period_s: 0.02,
    };

    fn settings(toml: &str) -> Settings {
        toml::from_str(toml).unwrap()
    }

    #[test]
    fn an_empty_section_flies_the_law_of_its_rate() {
        for rate_hz in [50.0, 100.0, 150.0, 400.0, 1000.0] {
            let settings = settings(&format!("rate_hz = {rate_hz}"));
            assert_eq!(settings.law_config(AROUND), Ok(AttitudeLawConfig::flight(rate_hz)));
        }
    }

    #[test]
    fn the_paper_model_ignores_lag_delay_and_ramp_of_the_flight_around_it() {
        let config = settings("model = \"paper\"").law_config(AROUND);
        assert_eq!(config, Ok(AttitudeLawConfig::paper()));
    }

    #[test]
    fn lag_delay_and_schedule_can_be_left_out_of_the_flight_model() {
        let toml = "rotor_lag_s = 0.0\ncommand_delay_s = 0.0\nfixed_morph_angle_deg = 94.5";
        let config = settings(toml).law_config(AROUND).unwrap();
        let bare = AttitudeLawConfig {
            rotor_lag_s: 0.0,
            command_delay_s: 0.0,
            fixed_morph_angle: Some(MorphAngle::MEDIUM),
            ..AttitudeLawConfig::flight(100.0)
        };
        assert_eq!(config, bare);
    }

    #[test]
    fn a_horizon_in_samples_overrides_the_one_in_seconds() {
        let config = settings("prediction_horizon = 30\ncontrol_horizon = 4").law_config(AROUND);
        let horizon = Horizon { prediction: 30, control: 4 };
        assert_eq!(config.unwrap().horizon, HorizonChoice::Samples(horizon));
    }

    #[test]
    fn laguerre_functions_are_given_by_pole_or_number() {
        let config = settings("laguerre_pole = [0.5, 0.5, 0.8]").law_config(AROUND).unwrap();
        let basis = [0.5, 0.5, 0.8].map(|pole| Basis::Laguerre { pole, terms: 3 });
        assert_eq!(config.laguerre, Some(basis));
        let config = settings("laguerre_terms = [2, 2, 1]").law_config(AROUND).unwrap();
        let basis = [2, 2, 1].map(|terms| Basis::Laguerre { pole: 0.0, terms });
        assert_eq!(config.laguerre, Some(basis));
        for wrong in ["laguerre_pole = [0.5, 1.0, 0.5]", "laguerre_terms = [3, 0, 3]"] {
            let refusal = settings(wrong).law_config(AROUND).unwrap_err().to_string();
            assert!(refusal.starts_with("laguerre_"), "{refusal}");
        }
    }

    #[test]
    fn more_moves_than_samples_are_refused() {
        let config = settings("prediction_horizon = 3\ncontrol_horizon = 4").law_config(AROUND);
        assert!(matches!(config, Err(ConfigError::Engine(_))));
    }
}
