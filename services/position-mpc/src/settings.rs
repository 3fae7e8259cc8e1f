//! The section `[position_mpc]` of a scenario.
//!
//! Keys left out take the value that suits the rate, see [`PositionLawConfig::flight`].
//!
//! A program has 6 constraint rows for each block, or for each sample of Nc where there are none, and 3 for each sample of
//! Np if speeds are bounded. There is room for [`mpc::ROW_CAPACITY`], 1024, of them; more are refused.

use controller::{ControllerSection, FlightFacts, SectionRefusal};
use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::Slot;

use crate::config::{BLOCKS, USUAL_ATTITUDE_PERIOD_S, USUAL_LATENCY_S};
use crate::transport::transport_s;
use crate::{Basis, ConfigError, Horizon, PositionLawConfig, PositionMpc, SolverKind, TiltBound};

/// Samples over which inputs that move by Laguerre functions are bounded at least.
const LAGUERRE_CONTROL: usize = 3;

/// What a scenario sets of the position law.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Control rate \[Hz\].
    #[garde(range(min = 1.0, max = 200.0))]
    pub rate_hz: f64,
    /// Np in samples; 2 s if left out.
    #[garde(range(min = 1, max = 400))]
    pub prediction_horizon: Option<u16>,
    /// Nc in samples, during which the inputs move: 1.7 s if left out. Given alone, one unknown for each of them and at
    /// most 50.
    #[garde(range(min = 1, max = 400))]
    pub control_horizon: Option<u16>,
    /// Unknowns of each input: blocks of Nc in which its increment stays, each longer than the one before; 9 if neither
    /// Nc nor Laguerre functions are given.
    #[garde(range(min = 1, max = 50))]
    pub control_blocks: Option<u8>,
    /// W of (15) on tilt increments \[m²/rad²\]; if left out 1.3 at 50 Hz, with the square of the rate.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub tilt_weight: Option<f64>,
    /// W of (15) on thrust increments \[m²/N²\]; if left out 0.4 at 50 Hz, with the square of the rate.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub thrust_weight: Option<f64>,
    /// Q of x, y and z; 1 each if left out.
    #[garde(inner(inner(range(min = 0.0, max = 1e9))))]
    pub output_weight: Option<[f64; 3]>,
    /// Factor on Q at the last sample of the horizon; 1 if left out.
    #[garde(range(min = 0.0, max = 1e9))]
    pub terminal_factor: Option<f64>,
    /// Poles of the Laguerre functions of pitch, roll and thrust. Inputs are then bounded for as long
    /// as the functions last, at least over Nc samples and at most over 50.
    #[garde(skip)]
    pub laguerre_pole: Option<[f64; 3]>,
    /// How many functions each; Nc of them if left out.
    #[garde(skip)]
    pub laguerre_terms: Option<[u8; 3]>,
    /// Price of leaving the bounds on tilt and thrust, in increments that cost 1; hard if left
    /// out.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub level_penalty: Option<f64>,
    /// Price of leaving the bounds on their change; hard if left out.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub increment_penalty: Option<f64>,
    /// Bound on the predicted speed along each axis \[m/s\], at each sample of Np.
    #[garde(range(min = 1e-3, max = 1e3))]
    pub speed_max_m_s: Option<f64>,
    /// Price of leaving it; hard if left out.
    #[garde(range(min = 1e-9, max = 1e9))]
    pub state_penalty: Option<f64>,
    /// What `tilt_max_rad` bounds: `box`, |φ| and |θ| each at ψ = 0, or `cone`, the angle between thrust and vertical.
    #[garde(skip)]
    pub tilt_bound: TiltBound,
    /// Bound on the tilt \[rad\]; 0.35 if left out.
    #[garde(range(min = 0.01, max = 0.8))]
    pub tilt_max_rad: Option<f64>,
    /// Bound on their change in one sample \[rad\]; 2.8 rad/s if left out, twice that while a vehicle is caught that another controller has lost.
    #[garde(range(min = 1e-3, max = 1.6))]
    pub tilt_step_max_rad: Option<f64>,
    /// Least thrust over weight; 0.3 if left out.
    #[garde(range(min = 0.0, max = 4.0))]
    pub thrust_min_weights: Option<f64>,
    /// Largest thrust over weight; 1.7 if left out.
    #[garde(range(min = 0.0, max = 4.0))]
    pub thrust_max_weights: Option<f64>,
    /// Bound on the change of thrust over weight in one sample; 0.2 if left out.
    #[garde(range(min = 1e-3, max = 4.0))]
    pub thrust_step_max_weights: Option<f64>,
    /// Lag of the attitude loop as seen from here \[s\]; 0.04 if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub tilt_lag_s: Option<f64>,
    /// Delay of the attitude loop as seen from here \[s\]; follows the latency of set points and its rate if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub tilt_delay_s: Option<f64>,
    /// Lag of the thrust \[s\]; the vehicle's rotor lag if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub thrust_lag_s: Option<f64>,
    /// Delay of the thrust \[s\]; follows the latency of set points and the rate of the attitude loop if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub thrust_delay_s: Option<f64>,
    /// Solver of the quadratic program: `active-set`, or for comparison `hildreth` or `hildreth-converged`.
    #[garde(skip)]
    #[schemars(with = "String")]
    pub solver: SolverKind,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            rate_hz: 50.0,
            prediction_horizon: None,
            control_horizon: None,
            control_blocks: None,
            tilt_weight: None,
            thrust_weight: None,
            output_weight: None,
            terminal_factor: None,
            laguerre_pole: None,
            laguerre_terms: None,
            level_penalty: None,
            increment_penalty: None,
            speed_max_m_s: None,
            state_penalty: None,
            tilt_bound: TiltBound::Box,
            tilt_max_rad: None,
            tilt_step_max_rad: None,
            thrust_min_weights: None,
            thrust_max_weights: None,
            thrust_step_max_weights: None,
            tilt_lag_s: None,
            tilt_delay_s: None,
            thrust_lag_s: None,
            thrust_delay_s: None,
            solver: SolverKind::ActiveSet,
        }
    }
}

/// What a position law is given about the loops around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// First-order lag of the rotors \[s\].
    pub rotor_lag_s: f64,
    /// Declared latency of the attitude set point \[s\].
    pub setpoint_latency_s: f64,
    /// Period of the attitude loop \[s\].
    pub attitude_period_s: f64,
}

impl Surroundings {
    /// By how much later \[s\] a set point acts than the law's delays assume.
    fn late_s(&self, period_s: f64) -> f64 {
        let usual_s = transport_s(USUAL_LATENCY_S, USUAL_ATTITUDE_PERIOD_S, period_s);
        (transport_s(self.setpoint_latency_s, self.attitude_period_s, period_s) - usual_s).max(0.0)
    }
}

impl From<&FlightFacts> for Surroundings {
    fn from(flight: &FlightFacts) -> Self {
        Self {
            rotor_lag_s: flight.vehicle.rotor_lag_s,
            setpoint_latency_s: flight.setpoint_latency_s,
            attitude_period_s: 1.0 / flight.rate_hz[Slot::Attitude],
        }
    }
}

impl ControllerSection for Settings {
    type Service = PositionMpc;
    const SLOT: Slot = Slot::Position;

    fn rate_hz(&self) -> Option<f64> {
        Some(self.rate_hz)
    }

    fn thrust_weights(&self) -> [Option<f64>; 2] {
        [self.thrust_min_weights, self.thrust_max_weights]
    }

    fn build(&self, flight: &FlightFacts) -> Result<PositionMpc, SectionRefusal> {
        self.law_config(flight.into())
            .and_then(|config| PositionMpc::new(config, &flight.vehicle, flight.landing))
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
    /// The law's numbers in these surroundings, checked.
    ///
    /// # Errors
    /// The first number that the law refuses.
    pub fn law_config(&self, around: Surroundings) -> Result<PositionLawConfig, ConfigError> {
        let base = PositionLawConfig::flight(self.rate_hz);
        let late_s = around.late_s(base.period_s());
        let config = PositionLawConfig {
            horizon: self.horizon(base.horizon),
            tilt_weight: self.tilt_weight.unwrap_or(base.tilt_weight),
            thrust_weight: self.thrust_weight.unwrap_or(base.thrust_weight),
            output_weight: self.output_weight.unwrap_or(base.output_weight),
            terminal_factor: self.terminal_factor.unwrap_or(base.terminal_factor),
            moves: self.moves(&base),
            level_penalty: self.level_penalty,
            increment_penalty: self.increment_penalty,
            speed_max_m_s: self.speed_max_m_s,
            state_penalty: self.state_penalty,
            tilt_bound: self.tilt_bound,
            tilt_max_rad: self.tilt_max_rad.unwrap_or(base.tilt_max_rad),
            tilt_step_max_rad: self.tilt_step_max_rad.unwrap_or(base.tilt_step_max_rad),
            thrust_min_weights: self.thrust_min_weights.unwrap_or(base.thrust_min_weights),
            thrust_max_weights: self.thrust_max_weights.unwrap_or(base.thrust_max_weights),
            thrust_step_max_weights: self
                .thrust_step_max_weights
                .unwrap_or(base.thrust_step_max_weights),
            tilt_lag_s: self.tilt_lag_s.unwrap_or(base.tilt_lag_s),
            tilt_delay_s: self.tilt_delay_s.unwrap_or(base.tilt_delay_s + late_s),
            thrust_lag_s: self.thrust_lag_s.unwrap_or(around.rotor_lag_s),
            thrust_delay_s: self.thrust_delay_s.unwrap_or(base.thrust_delay_s + late_s),
            setpoint_latency_s: around.setpoint_latency_s,
            solver: self.solver,
            ..base
        };
        config.validate()?;
        Ok(config)
    }

    fn moves(&self, base: &PositionLawConfig) -> [Basis; 3] {
        let Horizon { control, .. } = self.horizon(base.horizon);
        let laguerre = Basis::given(self.laguerre_pole, self.laguerre_terms, control);
        let usual = self.control_horizon.is_none().then_some(usize::from(BLOCKS).min(control));
        let blocks = self.control_blocks.map(usize::from).or(usual);
        let blocks = blocks.map(|terms| Basis::Blocks { terms, samples: control });
        laguerre.unwrap_or([blocks.unwrap_or(Basis::pulses(control)); 3])
    }

    fn horizon(&self, base: Horizon) -> Horizon {
        let prediction = self.prediction_horizon.map_or(base.prediction, usize::from);
        let by_laguerre = self.laguerre_pole.is_some() || self.laguerre_terms.is_some();
        let usual = if by_laguerre { LAGUERRE_CONTROL } else { base.control };
        let control = self.control_horizon.map_or(usual.min(prediction), usize::from);
        Horizon { prediction, control }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mpc::MpcError;

    const AROUND: Surroundings =
        Surroundings { rotor_lag_s: 0.015, setpoint_latency_s: 0.001, attitude_period_s: 0.010 };

    fn settings(toml: &str) -> Settings {
        toml::from_str(toml).unwrap()
    }

    #[test]
    fn an_empty_section_flies_the_law_of_its_rate() {
        for rate_hz in [20.0, 50.0, 100.0, 200.0] {
            let settings = settings(&format!("rate_hz = {rate_hz}"));
            assert_eq!(settings.law_config(AROUND), Ok(PositionLawConfig::flight(rate_hz)));
        }
    }

    /// Compares the reference of scenarios with the configuration that flies.
    #[test]
    fn the_notes_on_keys_that_are_left_out_name_the_numbers_that_fly() {
        let schema = schemars::schema_for!(Settings);
        let flown = PositionLawConfig::flight(50.0);
        let look_ahead_s = flown.horizon.prediction as f64 / flown.rate_hz;
        let moves_s = flown.horizon.control as f64 / flown.rate_hz;
        for (key, text) in [
            ("prediction_horizon", format!("{look_ahead_s} s if left out")),
            ("control_horizon", format!("{moves_s} s if left out")),
            ("control_blocks", format!("{} if neither", flown.moves[0].terms())),
            ("tilt_weight", format!("if left out {} at 50 Hz", flown.tilt_weight)),
            ("thrust_weight", format!("if left out {} at 50 Hz", flown.thrust_weight)),
            ("output_weight", format!("{} each if left out", flown.output_weight[0])),
            ("terminal_factor", format!("{} if left out", flown.terminal_factor)),
            ("tilt_max_rad", format!("{} if left out", flown.tilt_max_rad)),
            ("tilt_step_max_rad", format!("{} rad/s", flown.tilt_step_max_rad * flown.rate_hz)),
            ("thrust_min_weights", format!("{} if left out", flown.thrust_min_weights)),
            ("thrust_max_weights", format!("{} if left out", flown.thrust_max_weights)),
            ("thrust_step_max_weights", format!("{} if left out", flown.thrust_step_max_weights)),
            ("tilt_lag_s", format!("{} if left out", flown.tilt_lag_s)),
        ] {
            let description = schema.as_value()["properties"][key]["description"].as_str().unwrap();
            assert!(description.contains(&text), "{key}: {description}, and not {text}");
        }
    }

    #[test]
    fn a_delay_beyond_the_set_points_that_are_remembered_is_refused_by_name() {
        assert!(settings("tilt_delay_s = 0.3").law_config(AROUND).is_ok());
        let refusal = settings("tilt_delay_s = 0.31").law_config(AROUND).unwrap_err();
        assert!(matches!(
            refusal,
            ConfigError::Engine(MpcError::OutOfRange { name: "tilt_delay_s", .. })
        ));
    }

    #[test]
    fn a_late_set_point_and_a_slow_attitude_loop_are_in_the_delays() {
        let delays = |rate_hz: f64, latency_s: f64, attitude_period_s: f64| {
            let around =
                Surroundings { setpoint_latency_s: latency_s, attitude_period_s, ..AROUND };
            let config = settings(&format!("rate_hz = {rate_hz}")).law_config(around).unwrap();
            [config.tilt_delay_s, config.thrust_delay_s]
        };
        let close = |delays: [f64; 2], tilt_s: f64, thrust_s: f64| {
            (delays[0] - tilt_s).abs() < 1e-12 && (delays[1] - thrust_s).abs() < 1e-12
        };
        assert!(close(delays(50.0, 0.032, 0.010), 0.0525, 0.032));
        assert!(close(delays(200.0, 0.001, 0.020), 0.0325, 0.012));
    }
}
