//! The law's numbers, each with its reason, and what is refused.

use mpc::{Basis, Horizon, MpcError, SolverKind, within};
use thiserror::Error;
use vehicle::ParameterError;

use crate::cone::TiltBound;
use crate::model;
use crate::transport::DELAY_MAX_PERIODS;

/// Time over which errors are weighed \[s\]; the reference is known for 2.35 s.
const LOOK_AHEAD_S: f64 = 2.0;
/// Time over which the inputs move \[s\], in [`BLOCKS`].
const MOVES_S: f64 = 1.7;
/// Blocks of moves of each input.
pub(crate) const BLOCKS: u8 = 9;
/// Largest rate of a set point's tilt \[rad/s\]: with more, `attitude-pid` lags behind after a gust by more than a rehearsal
/// allows, and attitude loops with slow rotors and a weak one are lost more often.
const TILT_RATE_MAX_RAD_S: f64 = 2.8;
/// Latency of set points and period of the attitude loop that the delays of [`PositionLawConfig::flight`] are for \[s\].
pub(crate) const USUAL_LATENCY_S: f64 = 0.001;
pub(crate) const USUAL_ATTITUDE_PERIOD_S: f64 = 0.010;

/// The complete configuration of the position law. [`Default`] is for flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionLawConfig {
    /// Control rate \[Hz\], up to 200.
    pub rate_hz: f64,
    /// Np and Nc. A double integrator whose input is bounded must begin to brake before it arrives: with 0.4 s of
    /// look-ahead a figure eight in 4.5 s, where the tilt bound binds, is 0.9 m off in calm air, with 2 s 14 mm. {100, 85} at 50 Hz.
    pub horizon: Horizon,
    /// W of (15) on tilt increments \[m²/rad²\].
    pub tilt_weight: f64,
    /// W of (15) on thrust increments \[m²/N²\].
    pub thrust_weight: f64,
    /// Q of x, y and z; 1 in the paper.
    pub output_weight: [f64; 3],
    /// Factor on Q at the last sample of the horizon; 1 in the paper.
    pub terminal_factor: f64,
    /// How each input (θ₀, φ₀, T₀) moves: nine blocks move it for as long as 85 pulses do, in a program of 27 unknowns and
    /// 51 rows.
    pub moves: [Basis; 3],
    /// What the bound on the tilt is for.
    pub tilt_bound: TiltBound,
    /// Bound on |φ| and |θ| in the ψ = 0 frame, or on the tilt \[rad\].
    pub tilt_max_rad: f64,
    /// Bound on their change in one sample \[rad\].
    pub tilt_step_max_rad: f64,
    /// Least thrust over weight.
    pub thrust_min_weights: f64,
    /// Largest thrust over weight.
    pub thrust_max_weights: f64,
    /// Bound on the change of thrust over weight in one sample.
    pub thrust_step_max_weights: f64,
    /// Price of leaving the bounds on tilt and thrust, see [`mpc::Hardness::Soft`]; `None` forbids
    /// it.
    pub level_penalty: Option<f64>,
    /// Price of leaving the bounds on their change; `None` forbids it.
    pub increment_penalty: Option<f64>,
    /// Bound on the predicted speed along each axis \[m/s\].
    pub speed_max_m_s: Option<f64>,
    /// Price of leaving it; `None` forbids it, and what cannot be met is then infeasible.
    pub state_penalty: Option<f64>,
    /// First-order lag of the attitude loop as seen from here \[s\]; 0 with no delay is (3).
    pub tilt_lag_s: f64,
    /// Delay of the attitude loop as seen from here \[s\], at most fifteen periods.
    pub tilt_delay_s: f64,
    /// First-order lag of the thrust: the rotors' \[s\].
    pub thrust_lag_s: f64,
    /// Delay of the thrust through the attitude loop's clock \[s\], at most fifteen periods.
    pub thrust_delay_s: f64,
    /// Latency of the set point \[s\], by which the one that is reported as applied is recognised; the delays above are for
    /// the prediction.
    pub setpoint_latency_s: f64,
    /// Solver of (16).
    pub solver: SolverKind,
}

impl Default for PositionLawConfig {
    /// [`Self::flight`] at 50 Hz.
    fn default() -> Self {
        Self::flight(50.0)
    }
}

impl PositionLawConfig {
    /// For flight at `rate_hz` above an attitude loop of 50 Hz or more.
    ///
    /// Look-ahead, blocks and W were chosen together, by the largest error of figure eights in 8 to 3.5 s and of
    /// random vehicles in random weather (`morphquad study random`). The increments shrink with the period, so W grows
    /// with the square of the rate, and the blocks last as long in seconds at each rate.
    #[must_use]
    pub fn flight(rate_hz: f64) -> Self {
        let samples = |time_s: f64| {
            let found = (BLOCKS.into()..400).find(|n| f64::from(*n) >= time_s * rate_hz);
            usize::from(found.unwrap_or(400_u16))
        };
        let horizon = Horizon { prediction: samples(LOOK_AHEAD_S), control: samples(MOVES_S) };
        let blocks = Basis::Blocks { terms: BLOCKS.into(), samples: horizon.control };
        let by_rate = (rate_hz / 50.0) * (rate_hz / 50.0);
        Self {
            rate_hz,
            horizon,
            tilt_weight: 1.3 * by_rate,
            thrust_weight: 0.4 * by_rate,
            output_weight: [1.0; 3],
            terminal_factor: 1.0,
            moves: [blocks; 3],
            tilt_bound: TiltBound::Box,
            tilt_max_rad: 0.35,
            tilt_step_max_rad: (TILT_RATE_MAX_RAD_S / rate_hz).min(0.8),
            thrust_min_weights: 0.3,
            thrust_max_weights: 1.7,
            thrust_step_max_weights: 0.2,
            level_penalty: None,
            increment_penalty: None,
            speed_max_m_s: None,
            state_penalty: None,
            tilt_lag_s: 0.040,
            tilt_delay_s: (0.5 / rate_hz).max(0.0225),
            thrust_lag_s: 0.015,
            thrust_delay_s: 0.002,
            setpoint_latency_s: USUAL_LATENCY_S,
            solver: SolverKind::ActiveSet,
        }
    }

    /// The control period \[s\].
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }

    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        within("rate_hz", self.rate_hz, 1.0, 200.0)?;
        within("tilt_weight", self.tilt_weight, 1e-9, 1e9)?;
        within("thrust_weight", self.thrust_weight, 1e-9, 1e9)?;
        within("tilt_max_rad", self.tilt_max_rad, 0.01, 0.8)?;
        within("tilt_step_max_rad", self.tilt_step_max_rad, 1e-3, 1.6)?;
        within("thrust_min_weights", self.thrust_min_weights, 0.0, 1.0)?;
        within("thrust_max_weights", self.thrust_max_weights, 1.0, 4.0)?;
        within("thrust_step_max_weights", self.thrust_step_max_weights, 1e-3, 4.0)?;
        let period = self.period_s();
        within("tilt_lag_s", self.tilt_lag_s, 0.0, 1.0)?;
        let most = DELAY_MAX_PERIODS * period;
        within("tilt_delay_s", self.tilt_delay_s, 0.0, most)?;
        within("thrust_lag_s", self.thrust_lag_s, 0.0, 1.0)?;
        within("thrust_delay_s", self.thrust_delay_s, 0.0, most)?;
        for weight in self.output_weight {
            within("output_weight", weight, 0.0, 1e9)?;
        }
        within("terminal_factor", self.terminal_factor, 0.0, 1e9)?;
        let optional = [
            ("level_penalty", self.level_penalty, 1e-9),
            ("increment_penalty", self.increment_penalty, 1e-9),
            ("state_penalty", self.state_penalty, 1e-9),
            ("speed_max_m_s", self.speed_max_m_s, 1e-3),
        ];
        for (name, value, least) in optional {
            within(name, value.unwrap_or(1.0), least, 1e9)?;
        }
        Ok(model::design(self, 0.0).check()?)
    }
}

/// A configuration the law refuses.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ConfigError {
    /// A number outside its range, or a set-up that the engine refuses.
    #[error(transparent)]
    Engine(#[from] MpcError),
    /// The vehicle is impossible.
    #[error(transparent)]
    Vehicle(#[from] ParameterError),
}
