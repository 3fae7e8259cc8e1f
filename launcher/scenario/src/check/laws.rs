//! What the two control laws refuse, which key is to blame, and keys of theirs that do nothing.

use super::Checker;
use attitude_mpc::{AttitudeLawConfig, MpcError, TorqueBound};

/// The paper's bound on yaw, 2 m g L, over what rotors give at most, 2 k m g, at the full arm length.
const PAPER_TORQUE_RANGE: f64 = 10.5;

/// An attitude prediction shorter than this many rotor lags does not see what its torque does.
const MIN_ROTOR_LAGS: f64 = 5.0;
/// Rates at which the steps of 0.2 rad are tested \[Hz\].
pub const TESTED_RATES_HZ: core::ops::RangeInclusive<f64> = 50.0..=1000.0;

/// Soft bounds on torques cheaper than this end in limit cycles: at 50 Hz and 160° a price of 100
/// does, 1000 settles like hard bounds.
const MIN_LEVEL_PENALTY: f64 = 1000.0;

/// Sections of the two laws.
const ATTITUDE: &str = "attitude_mpc";
const POSITION: &str = "position_mpc";

impl Checker<'_> {
    pub(super) fn attitude(&mut self) {
        let law = self.settings().attitude_mpc;
        if law.horizon_s.is_some() && law.prediction_horizon.is_some() {
            let what = "sets the same as attitude_mpc.prediction_horizon";
            self.error("attitude_mpc.horizon_s", what, "keep one of the two");
        }
        if law.control_horizon.is_some() && law.prediction_horizon.is_none() {
            let what = "needs attitude_mpc.prediction_horizon beside it";
            self.error("attitude_mpc.control_horizon", what, "give both in samples, or horizon_s");
        }
        let config = match self.scenario.attitude_law() {
            Ok(config) => config,
            Err(attitude_mpc::ConfigError::Engine(error)) => return self.refused(ATTITUDE, &error),
            Err(error) => return self.error(ATTITUDE, error.to_string(), "see [vehicle]"),
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
        if config.level_penalty.is_some_and(|price| price < MIN_LEVEL_PENALTY) {
            let what = "lets the law plan torques that the rotors do not have";
            let remedy = format!("set it to {MIN_LEVEL_PENALTY} or more, or leave it out");
            self.warn("attitude_mpc.level_penalty", what, remedy);
        }
        self.blind(ATTITUDE, config.output_weight);
        self.look_ahead(&config);
    }

    /// Warns of outputs whose error costs nothing.
    fn blind(&mut self, section: &str, weights: [f64; 3]) {
        if let Some(index) = weights.iter().position(|weight| *weight <= 0.0) {
            let what = "0 leaves this output uncontrolled";
            let remedy = "write a positive weight; 1 is the paper's";
            self.warn(&format!("{section}.output_weight[{index}]"), what, remedy);
        }
    }

    /// The prediction must see what its torque does.
    fn look_ahead(&mut self, config: &AttitudeLawConfig) {
        let law = self.settings().attitude_mpc;
        // The rotors' own lag: the margin on the modelled one asks for no longer look.
        let lag_s = law.rotor_lag_s.unwrap_or(self.settings().vehicle.rotor_lag_s);
        let lag_s = lag_s.min(config.rotor_lag_s);
        let needed_s = MIN_ROTOR_LAGS * lag_s;
        let asked_s = law.horizon_s.unwrap_or(f64::INFINITY);
        let look_ahead_s = attitude_mpc::settings::Settings::look_ahead_s(config);
        let Some(look_ahead_s) = look_ahead_s.ok().map(|s| s.min(asked_s)) else { return };
        if look_ahead_s >= needed_s {
            return;
        }
        let what = format!(
            "{look_ahead_s:.3} s of prediction do not cover {MIN_ROTOR_LAGS} rotor lags of {lag_s} s"
        );
        // To blame is what was chosen: the look before the lag.
        let key = if law.horizon_s.is_some() {
            "attitude_mpc.horizon_s"
        } else if law.prediction_horizon.is_some() {
            "attitude_mpc.prediction_horizon"
        } else if law.rotor_lag_s.is_some() {
            "attitude_mpc.rotor_lag_s"
        } else {
            "vehicle.rotor_lag_s"
        };
        let remedy = if key.ends_with("rotor_lag_s") {
            format!("model a shorter lag, or set attitude_mpc.horizon_s = {needed_s:.3} or more")
        } else {
            format!("look at least {needed_s:.3} s ahead, or set model = \"paper\"")
        };
        self.error(key, what, remedy);
    }

    pub(super) fn position(&mut self) {
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
            Ok(config) => self.blind(POSITION, config.output_weight),
            Err(position_mpc::ConfigError::Engine(error)) => self.refused(POSITION, &error),
            Err(error) => self.error(POSITION, error.to_string(), "see [vehicle]"),
        }
    }

    /// Complains about what a law refuses, at the key that decides it.
    fn refused(&mut self, section: &str, error: &MpcError) {
        let what = error.to_string();
        let own = |key: &str| format!("{section}.{key}");
        match *error {
            MpcError::OutOfRange { name, value, least, most } => {
                let what = format!("{value} does not go with the other settings");
                let remedy = format!("write a number from {least} to {most}");
                self.error(&self.decisive(section, name), what, remedy);
            }
            MpcError::ControlHorizon { prediction, .. } => {
                let remedy =
                    format!("let 1 <= control_horizon <= prediction_horizon, here {prediction}");
                self.error(&own("control_horizon"), what, remedy);
            }
            MpcError::ControlLimit { limit, .. } => {
                let blocks = if section == POSITION { "control_blocks" } else { "laguerre_terms" };
                let remedy = format!("let control_horizon <= {limit}, or give {blocks}");
                self.error(&own("control_horizon"), what, remedy);
            }
            MpcError::PredictionHorizon { limit, .. } => {
                let remedy = format!("let prediction_horizon <= {limit}, or lower rate_hz");
                self.error(&own("prediction_horizon"), what, remedy);
            }
            MpcError::Pole { .. } => {
                let remedy = "let 0 <= pole < 1 for each input; 0 is the classic form";
                self.error(&own("laguerre_pole"), what, remedy);
            }
            MpcError::Terms { limit, .. } => {
                let remedy = format!("give each input 1 to {limit} functions");
                self.error(&own("laguerre_terms"), what, remedy);
            }
            MpcError::Blocks { limit, .. } => {
                let remedy = format!("give each input 1 to {limit} blocks");
                self.error(&own("control_blocks"), what, remedy);
            }
            MpcError::Rows { limit, .. } => {
                let (states, remedy) = self.rows_of(section, limit);
                self.error(&own(states), what, remedy);
            }
            MpcError::Solver(_) => self.error(section, what, "change its weights"),
        }
    }

    /// The key behind a name of the attitude law.
    fn decisive(&self, section: &str, name: &str) -> String {
        let own = self.settings().attitude_mpc;
        match name {
            "command_delay_s" if own.command_delay_s.is_none() => "latency.wrench_command_s",
            "command_latency_s" => "latency.wrench_command_s",
            "report_period_s" => "plant.rate_hz",
            name => return format!("{section}.{name}"),
        }
        .to_owned()
    }

    /// Which key asks for most rows, and what each horizon costs.
    fn rows_of(&self, section: &str, limit: usize) -> (&'static str, String) {
        let law = self.settings().attitude_mpc;
        let by_rotor = law.torque_bound == Some(TorqueBound::RotorThrusts);
        let (states, inputs, key) = if section == POSITION {
            (3, 6, "speed_max_m_s")
        } else {
            let sets = [law.angle_max_rad, law.rate_max_rad_s];
            let key = if law.rate_max_rad_s.is_some() { "rate_max_rad_s" } else { "angle_max_rad" };
            (3 * sets.iter().flatten().count(), if by_rotor { 7 } else { 6 }, key)
        };
        let remedy = format!(
            "keep {states} prediction_horizon + {inputs} control_horizon below {limit}: shorten the \
             horizons or drop this bound"
        );
        (key, remedy)
    }

    /// Warns of keys that are set and change nothing.
    pub(super) fn idle_keys(&mut self) {
        for (section, key, is_idle, why) in self.attitude_keys().iter().chain(&self.position_keys())
        {
            if *is_idle {
                let remedy = format!("drop the key, or {why}");
                self.warn(&format!("{section}.{key}"), "has no effect here", remedy);
            }
        }
        if self.settings().pilot.is_rig() && self.document.root().contains_key(POSITION) {
            let what = "has no effect: this manoeuvre flies without a position loop";
            self.warn(POSITION, what, "drop the section, or choose another pilot.kind");
        }
    }

    fn attitude_keys(&self) -> Vec<IdleKey> {
        let law = &self.settings().attitude_mpc;
        let bounded = law.angle_max_rad.or(law.rate_max_rad_s).is_some();
        let fixed = law.fixed_morph_angle_deg.is_some();
        let (follows, steps) = self
            .scenario
            .attitude_law()
            .map_or((true, true), |config| (config.morph_preview, config.increment_bound));
        vec![
            (
                ATTITUDE,
                "state_penalty",
                law.state_penalty.is_some() && !bounded,
                "give angle_max_rad or rate_max_rad_s",
            ),
            (
                ATTITUDE,
                "increment_penalty",
                law.increment_penalty.is_some() && !steps,
                "set increment_bound = true",
            ),
            (
                ATTITUDE,
                "morph_preview_s",
                law.morph_preview_s.is_some() && (fixed || !follows),
                "set morph_preview = true and no fixed_morph_angle_deg",
            ),
            (
                ATTITUDE,
                "morph_preview",
                law.morph_preview == Some(true) && fixed,
                "drop fixed_morph_angle_deg",
            ),
            (
                ATTITUDE,
                "rebuild_tolerance_deg",
                law.rebuild_tolerance_deg > 0.0 && fixed,
                "drop fixed_morph_angle_deg",
            ),
        ]
    }

    fn position_keys(&self) -> Vec<IdleKey> {
        let law = &self.settings().position_mpc;
        let idle = law.state_penalty.is_some() && law.speed_max_m_s.is_none();
        let by_laguerre = law.laguerre_pole.is_some() || law.laguerre_terms.is_some();
        let no_blocks = law.control_blocks.is_some() && by_laguerre;
        vec![
            (POSITION, "state_penalty", idle, "give speed_max_m_s"),
            (POSITION, "control_blocks", no_blocks, "leave out laguerre_pole and laguerre_terms"),
        ]
    }
}

/// Section, key, whether it is set in vain, and what would give it a meaning.
type IdleKey = (&'static str, &'static str, bool, &'static str);
