//! The law's numbers, each with its reason, and what is refused.

use controller::attitude::Timing;
use mpc::{Basis, Horizon, MpcError, SolverKind, within};
use thiserror::Error;
use vehicle::{MorphAngle, ParameterError};

use crate::schedule;

/// How far the law looks ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HorizonChoice {
    /// Np and Nc in samples, as the paper gives them.
    Samples(Horizon),
    /// At least this long \[s\]: Np = 20..=200 samples, Nc a tenth of it but at least 3. What 200
    /// samples do not cover is refused.
    ///
    /// 20 samples suffice up to 150 Hz; 40 ms of look-ahead against 15 ms of rotor lag do not fly.
    Seconds(f64),
}

impl HorizonChoice {
    pub(crate) fn samples(self, rate_hz: f64) -> Result<Horizon, ConfigError> {
        match self {
            Self::Samples(horizon) => Ok(horizon),
            Self::Seconds(seconds) => {
                within("horizon_s", seconds, 1e-3, 10.0)?;
                let wanted = (seconds * rate_hz - 1e-9).ceil();
                let limit = Horizon::PREDICTION_LIMIT as f64 / rate_hz;
                within("horizon_s", seconds, 1e-3, limit)?;
                let prediction = (20..200).find(|n| f64::from(*n) >= wanted).unwrap_or(200_u16);
                let control = prediction.div_ceil(10).max(3);
                Ok(Horizon { prediction: prediction.into(), control: control.into() })
            }
        }
    }
}

/// Where the bounds on the torque come from.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize, serde::Serialize, schemars::JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum TorqueBound {
    /// Roll and pitch m g L min(1/2, T/(2 m g)), what the rotors can give at the present thrust;
    /// yaw k m g.
    Rotors,
    /// Roll and pitch m g L, yaw 2 m g L: our reading of the paper, which prints none. Yaw then
    /// moves like roll on the linear model, as in its figures.
    Paper,
    /// 0 <= F <= `F_max` for each rotor at the given thrust: the axes share what there is.
    RotorThrusts,
}

/// The complete configuration of the attitude law. [`Default`] is for flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeLawConfig {
    /// Control rate \[Hz\], up to 1000.
    pub rate_hz: f64,
    /// Look-ahead.
    pub horizon: HorizonChoice,
    /// `r_w` of roll and pitch \[rad²/(N m)²\] in (15); at [`Self::REFERENCE_INERTIA_KG_M2`] if
    /// it is scaled.
    pub increment_weight: f64,
    /// Factor on `r_w` for pitch.
    pub pitch_weight_factor: f64,
    /// Factor on `r_w` for yaw; (Ixx/Izz)² = 1/4 makes the axes alike.
    pub yaw_weight_factor: f64,
    /// Scales `r_w` with 1/Ixx(β)², so that ρ = `r_w` (I/dt²)² and with it the loop in samples is
    /// the same at every size. A fixed `r_w` makes the large vehicle sluggish.
    pub scale_weight_with_inertia: bool,
    /// Q of roll, pitch and yaw; 1 in the paper.
    pub output_weight: [f64; 3],
    /// Factor on Q at the last sample of the horizon; 1 in the paper.
    pub terminal_factor: f64,
    /// Laguerre functions of each torque instead of one unknown per move.
    pub laguerre: Option<[Basis; 3]>,
    /// Torque bounds; the increment bound of one sample equals them.
    pub torque_bound: TorqueBound,
    /// Price of leaving the torque bounds, see [`mpc::Hardness::Soft`]; `None` forbids it.
    pub level_penalty: Option<f64>,
    /// Whether increments are bounded at all.
    pub increment_bound: bool,
    /// Price of leaving the increment bounds; `None` forbids it.
    pub increment_penalty: Option<f64>,
    /// Bound on predicted |φ| and |θ| \[rad\].
    pub angle_max_rad: Option<f64>,
    /// Bound on predicted |γ̇| \[rad/s\].
    pub rate_max_rad_s: Option<f64>,
    /// Price of leaving these two; `None` forbids it, and what cannot be met is then infeasible.
    pub state_penalty: Option<f64>,
    /// Whether a commanded morph is followed along the horizon.
    pub morph_preview: bool,
    /// How far it is followed \[s\]; if left out, as far as the input can still move.
    ///
    /// What comes after the last move could only be answered before its time: followed to the end
    /// of the horizon with Nc = 3, a sweep disturbs a turn more than if it were not foreseen.
    pub morph_preview_s: Option<f64>,
    /// Rotor lag in the prediction model \[s\], in flight [`Self::lag_margin`] times the vehicle's;
    /// 0 with no delay is the paper's model (8).
    pub rotor_lag_s: f64,
    /// Time from a step to its command taking effect \[s\] in the prediction model, at most one
    /// period.
    pub command_delay_s: f64,
    /// The same as it is outside the model \[s\]: it shows which command a report belongs to.
    pub command_latency_s: f64,
    /// Time between the plant's reports of the applied torque \[s\].
    pub report_period_s: f64,
    /// Time over which a new setpoint is approached \[s\]: one period of the position loop.
    pub setpoint_ramp_s: f64,
    /// Change of the morph angle \[rad\] below which the matrices stay.
    pub rebuild_tolerance_rad: f64,
    /// Angle that model, weights and bounds are made for whatever is measured: the law that is not
    /// scheduled, for comparison.
    pub fixed_morph_angle: Option<MorphAngle>,
    /// Solver of (16).
    pub solver: SolverKind,
}

impl Default for AttitudeLawConfig {
    /// [`Self::flight`] at the paper's 100 Hz.
    fn default() -> Self {
        Self::flight(100.0)
    }
}

impl AttitudeLawConfig {
    /// Ixx of the smallest vehicle, at which `increment_weight` is stated.
    pub const REFERENCE_INERTIA_KG_M2: f64 = 1e-4;

    /// For flight at `rate_hz`.
    ///
    /// `r_w` is 5 at 100 Hz, where it rides out a lag of 10 to 20 ms together with 0.8 to 1.5
    /// times the inertia; 0.25 limit cycles there and drives the large vehicle's torque by half
    /// its bound from sample to sample with the noise of an estimate (10 mrad/s, 1 mrad). It
    /// grows with the square of the rate, so that the cost is the same integral over e² and u̇².
    /// Yaw has little authority and a large inertia: its `r_w` is larger, or its noise alone
    /// clips the rotors in a third of the samples.
    #[must_use]
    pub fn flight(rate_hz: f64) -> Self {
        let increment_weight = 5.0 * (rate_hz / 100.0) * (rate_hz / 100.0);
        Self {
            rate_hz,
            horizon: HorizonChoice::Seconds(0.12),
            increment_weight,
            pitch_weight_factor: 1.0,
            yaw_weight_factor: 8.0,
            scale_weight_with_inertia: true,
            output_weight: [1.0; 3],
            terminal_factor: 1.0,
            laguerre: None,
            torque_bound: TorqueBound::Rotors,
            level_penalty: None,
            increment_bound: true,
            increment_penalty: None,
            angle_max_rad: None,
            rate_max_rad_s: None,
            state_penalty: None,
            morph_preview: true,
            morph_preview_s: None,
            rotor_lag_s: 0.015 * Self::lag_margin(rate_hz),
            command_delay_s: 0.001,
            command_latency_s: 0.001,
            report_period_s: 0.001,
            setpoint_ramp_s: 0.02,
            rebuild_tolerance_rad: 0.0,
            fixed_morph_angle: None,
            solver: SolverKind::ActiveSet,
        }
    }

    /// Factor on the vehicle's rotor lag in the prediction model.
    ///
    /// A lag that is longer than modelled costs damping, one that is shorter costs little: at 1.2
    /// three axes at once settle within 0.3 s (yaw 0.5 s) for lags of 10 to 20 ms together with
    /// 0.8 to 1.5 times the inertia, at 1.0 within 0.9 s. Below 75 Hz a sample is longer than the
    /// lag, and the margin only slows the loop.
    #[must_use]
    pub fn lag_margin(rate_hz: f64) -> f64 {
        if rate_hz < 75.0 { 1.0 } else { 1.2 }
    }

    /// The paper's controller: 100 Hz, {20, 3}, model (8) without lag and delay, steps unramped.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            horizon: HorizonChoice::Samples(Horizon { prediction: 20, control: 3 }),
            increment_weight: 0.25,
            yaw_weight_factor: 0.25,
            scale_weight_with_inertia: false,
            torque_bound: TorqueBound::Paper,
            morph_preview: false,
            rotor_lag_s: 0.0,
            command_delay_s: 0.0,
            setpoint_ramp_s: 0.0,
            ..Self::default()
        }
    }

    /// The control period \[s\].
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// Times on the way of a command.
    pub(crate) fn timing(&self) -> Timing {
        Timing {
            period_s: self.period_s(),
            latency_s: self.command_latency_s,
            report_s: self.report_period_s,
            rotor_lag_s: self.rotor_lag_s,
        }
    }

    /// Samples over which a commanded morph is followed.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    pub(crate) fn preview_reach(&self, horizon: Horizon) -> usize {
        match (self.morph_preview_s, self.laguerre) {
            (Some(seconds), _) => (seconds * self.rate_hz).round() as usize,
            (None, Some(_)) => horizon.prediction,
            (None, None) => horizon.control + 1,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        within("rate_hz", self.rate_hz, 1.0, 1000.0)?;
        within("increment_weight", self.increment_weight, 1e-9, 1e9)?;
        within("pitch_weight_factor", self.pitch_weight_factor, 1e-6, 1e6)?;
        within("yaw_weight_factor", self.yaw_weight_factor, 1e-6, 1e6)?;
        within("rotor_lag_s", self.rotor_lag_s, 0.0, 1.0)?;
        within("command_delay_s", self.command_delay_s, 0.0, self.period_s())?;
        within("command_latency_s", self.command_latency_s, 0.0, 1.0)?;
        within("report_period_s", self.report_period_s, 0.0, 1.0)?;
        within("setpoint_ramp_s", self.setpoint_ramp_s, 0.0, 10.0)?;
        within("rebuild_tolerance_rad", self.rebuild_tolerance_rad, 0.0, 3.2)?;
        for weight in self.output_weight {
            within("output_weight", weight, 0.0, 1e9)?;
        }
        within("terminal_factor", self.terminal_factor, 0.0, 1e9)?;
        let optional = [
            ("level_penalty", self.level_penalty, 1e-9),
            ("increment_penalty", self.increment_penalty, 1e-9),
            ("state_penalty", self.state_penalty, 1e-9),
            ("angle_max_rad", self.angle_max_rad, 1e-3),
            ("rate_max_rad_s", self.rate_max_rad_s, 1e-3),
            ("morph_preview_s", self.morph_preview_s, 0.0),
        ];
        for (name, value, least) in optional {
            within(name, value.unwrap_or(1.0), least, 1e9)?;
        }
        Ok(schedule::design(self)?.check()?)
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
