//! What a law hands to the engine once: horizon, axes, constraint sets.

use crate::error::within;
use crate::rows::Rows;
use crate::{Basis, LaggedAxis, MpcError, ROW_CAPACITY};

/// Prediction and control horizon, Np and Nc, in samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Horizon {
    /// Np: samples over which the output error is weighed.
    pub prediction: usize,
    /// Nc <= Np: samples in which the input may still move (pulses, blocks), and in which its bounds are
    /// enforced; see [`Design::bounded_while_moving`] for functions that last longer.
    pub control: usize,
}

impl Horizon {
    /// Largest prediction horizon accepted: 2 s at 200 Hz.
    pub const PREDICTION_LIMIT: usize = 400;
    /// Largest control horizon accepted, but for blocks.
    pub const CONTROL_LIMIT: usize = 50;

    /// Checks 1 <= Nc <= Np, and the limit of Np.
    ///
    /// # Errors
    /// [`MpcError::ControlHorizon`] or [`MpcError::PredictionHorizon`].
    pub const fn check(&self) -> Result<(), MpcError> {
        let Self { prediction, control } = *self;
        if prediction > Self::PREDICTION_LIMIT {
            return Err(MpcError::PredictionHorizon { prediction, limit: Self::PREDICTION_LIMIT });
        }
        if control == 0 || control > prediction {
            return Err(MpcError::ControlHorizon { control, prediction });
        }
        Ok(())
    }
}

/// One axis of the prediction model, a [`LaggedAxis`], and its part of the cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisDesign {
    /// Lag of the actuator \[s\], >= 0; 0 is an ideal actuator.
    pub lag_s: f64,
    /// Delay of the command \[s\], within 0..=period.
    pub delay_s: f64,
    /// Deceleration per unit of rate \[1/s\], 0 in the paper; at most [`LaggedAxis::drag_max_per_s`].
    pub drag_per_s: f64,
    /// How Δu is parameterised.
    pub basis: Basis,
    /// Entry of Q: weight of the output error. 1 in the paper.
    pub output_weight: f64,
    /// Factor on it for the last error of the horizon. 1 in the paper.
    pub terminal_factor: f64,
}

impl AxisDesign {
    /// Its model for the gain 1.
    pub(crate) const fn sampled(&self) -> LaggedAxis {
        let Self { lag_s, delay_s, drag_per_s, .. } = *self;
        LaggedAxis { gain: 1.0, lag_s, delay_s, drag_per_s }
    }
}

/// What happens where a constraint cannot be met.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hardness {
    /// It must be: the program is then infeasible, which is a verdict.
    Hard,
    /// It is violated by s at the price of `penalty` s² in the cost (15). For an input s counts
    /// in units in which an increment costs 1, for an output or a rate in its own.
    Soft {
        /// Price, > 0.
        penalty: f64,
    },
}

impl Hardness {
    /// True for [`Self::Hard`].
    #[must_use]
    pub fn is_hard(self) -> bool {
        self == Self::Hard
    }
}

/// Which constraints there are. All can be combined; the numbers come with each step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constraints<const N: usize> {
    /// `u_min` <= u <= `u_max`, over the first Nc samples.
    pub levels: Option<Hardness>,
    /// |Δu| <= `du_max`, over the first Nc samples.
    pub increments: Option<Hardness>,
    /// Rows n'u that several inputs share, over the first Nc samples; n in units of the inputs.
    pub coupled: Option<(&'static [[f64; N]], Hardness)>,
    /// Bounds on y, at each sample of the prediction horizon.
    pub outputs: Option<Hardness>,
    /// Bounds on |y'|, at each sample of the prediction horizon.
    pub rates: Option<Hardness>,
}

impl<const N: usize> Constraints<N> {
    /// The paper's: hard bounds on level and increment.
    pub const PAPER: Self = Self {
        levels: Some(Hardness::Hard),
        increments: Some(Hardness::Hard),
        coupled: None,
        outputs: None,
        rates: None,
    };
}

/// Everything about a law that stays the same in flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Design<const N: usize> {
    /// Np and Nc.
    pub horizon: Horizon,
    /// Control period \[s\].
    pub period_s: f64,
    /// Model and cost of each axis.
    pub axes: [AxisDesign; N],
    /// Constraint sets.
    pub constraints: Constraints<N>,
}

impl<const N: usize> Design<N> {
    /// With the bounds on inputs enforced for as long as the functions last, at least over the Nc
    /// samples given, at most over [`Horizon::CONTROL_LIMIT`] and as far as the rows fit: inputs that
    /// still move behind the last bound would be planned beyond it. Pulses and blocks end with their bounds.
    #[must_use]
    pub fn bounded_while_moving(mut self) -> Self {
        if self.blocks().is_some() {
            return self;
        }
        let most = self.horizon.prediction.min(Horizon::CONTROL_LIMIT);
        let fits = |control: usize| {
            let horizon = Horizon { control, ..self.horizon };
            Rows::new(&Self { horizon, ..self }).count() <= ROW_CAPACITY
        };
        let spans = self.axes.iter().map(|axis| axis.basis.span(most));
        let wanted = spans.max().unwrap_or(0);
        let least = self.horizon.control;
        if let Some(control) = (least + 1..=wanted).rev().find(|control| fits(*control)) {
            self.horizon.control = control;
        }
        self
    }

    /// First and last sample of the blocks that all inputs share, if they move by the same ones within Nc.
    fn blocks(&self) -> Option<Vec<[usize; 2]>> {
        let mut bases = self.axes.iter().map(|axis| axis.basis);
        let first = bases.next()?;
        let within =
            matches!(first, Basis::Blocks { samples, .. } if samples <= self.horizon.control);
        if within && bases.all(|basis| basis == first) { first.blocks() } else { None }
    }

    /// Where the bounds on inputs are rows: samples of an increment and of the level that it ends at. The level is linear
    /// within a block.
    pub(crate) fn bounded(&self) -> Vec<[usize; 2]> {
        self.blocks().unwrap_or_else(|| (0..self.horizon.control).map(|m| [m; 2]).collect())
    }

    /// Checks every number, and that the rows fit.
    ///
    /// # Errors
    /// The first that is refused, by name.
    pub fn check(&self) -> Result<(), MpcError> {
        self.horizon.check()?;
        let (control, limit) = (self.horizon.control, Horizon::CONTROL_LIMIT);
        if control > limit && self.blocks().is_none() {
            return Err(MpcError::ControlLimit { control, limit });
        }
        within("period_s", self.period_s, 1e-6, 1e3)?;
        for axis in &self.axes {
            axis.basis.check(Horizon::CONTROL_LIMIT)?;
            within("lag_s", axis.lag_s, 0.0, 1e3)?;
            within("delay_s", axis.delay_s, 0.0, self.period_s)?;
            within("drag_per_s", axis.drag_per_s, 0.0, LaggedAxis::drag_max_per_s(axis.lag_s))?;
            within("output_weight", axis.output_weight, 0.0, 1e12)?;
            within("terminal_factor", axis.terminal_factor, 0.0, 1e12)?;
        }
        let Constraints { levels, increments, coupled, outputs, rates } = self.constraints;
        let sets = [levels, increments, coupled.map(|(_, hardness)| hardness), outputs, rates];
        for hardness in sets.into_iter().flatten() {
            if let Hardness::Soft { penalty } = hardness {
                within("penalty", penalty, 1e-12, 1e12)?;
            }
        }
        let rows = Rows::new(self).count();
        if rows > ROW_CAPACITY {
            return Err(MpcError::Rows { rows, limit: ROW_CAPACITY });
        }
        Ok(())
    }
}
