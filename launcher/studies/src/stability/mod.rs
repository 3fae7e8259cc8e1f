//! Where the attitude loop is stable: rotor lag, inertia and delay that its model does not have,
//! over the weight `r_w`, with and without lag and delay in the model.
//!
//! Two methods that share only the law. `linear.rs` takes the eigenvalues of the unconstrained
//! closed loop on one axis, which is exact for small angles. `simulation.rs` flies a step with the
//! nonlinear vehicle, its rotors and the law's constraints. [`run`] does both on a grid and finds the
//! edges, `report.rs` makes tables, pictures and files.

mod limits;
mod linear;
pub mod report;
mod simulation;
#[cfg(test)]
mod tests;

pub use limits::{Limits, Range, delay_margin_s, limits};
pub use linear::LinearLoop;
pub use simulation::{Answer, answer};

use attitude_mpc::{AttitudeLawConfig, ConfigError};
use serde::Serialize;
use simulate::fan_out::{Progress, fan_out};
use thiserror::Error;
use vehicle::{MorphAngle, ParameterError, VehicleParameters};

/// What the law's prediction model contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// The paper's (8): the torque is there at once.
    Bare,
    /// With rotor lag and without command delay.
    Lag,
    /// With rotor lag and command delay, as in flight.
    LagAndDelay,
}

/// How the world differs from the law's model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mismatch {
    /// Rotor lag \[s\], whatever the model has.
    pub lag_s: f64,
    /// Inertia over the modelled one.
    pub inertia_ratio: f64,
    /// Delay of the command beyond the modelled one \[s\].
    pub delay_s: f64,
}

/// Which part of the world is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Rotor lag \[s\].
    Lag,
    /// Inertia over the modelled one.
    Inertia,
    /// Delay beyond the modelled one \[control periods\].
    Delay,
}

/// All of them, in the order shown.
pub const QUANTITIES: [Quantity; 3] = [Quantity::Lag, Quantity::Inertia, Quantity::Delay];

/// The loop under study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bench {
    /// Control rate \[Hz\].
    pub rate_hz: f64,
    /// Size of the vehicle.
    pub morph_angle: MorphAngle,
    /// The vehicle as modelled.
    pub vehicle: VehicleParameters,
}

/// The vehicle or the law is impossible.
#[derive(Debug, Error)]
pub enum StabilityError {
    /// The law refuses.
    #[error("attitude law: {0}: choose another --rate")]
    Law(#[from] ConfigError),
    /// The vehicle refuses.
    #[error(transparent)]
    Vehicle(#[from] ParameterError),
    /// The eigenvalue iteration failed.
    #[error("the eigenvalues of a closed loop with {lag_s} s lag did not converge")]
    Eigenvalues {
        /// Its lag \[s\].
        lag_s: f64,
    },
}

impl Bench {
    /// The law with this model and `r_w` \[rad²/(N m)²\], as it flies apart from these. `r_w` is
    /// that of the smallest vehicle; it is scaled with 1/Ixx² as in flight.
    #[must_use]
    pub fn law(&self, model: Model, increment_weight: f64) -> AttitudeLawConfig {
        let flight = AttitudeLawConfig {
            increment_weight,
            setpoint_ramp_s: 0.0,
            // Without flight's margin on it, so that a model that is right has no mismatch.
            rotor_lag_s: self.vehicle.rotor_lag_s,
            ..AttitudeLawConfig::flight(self.rate_hz)
        };
        match model {
            Model::LagAndDelay => flight,
            Model::Lag => AttitudeLawConfig { command_delay_s: 0.0, ..flight },
            // The look-ahead stays that of flight, so that the model alone is compared.
            Model::Bare => AttitudeLawConfig { rotor_lag_s: 0.0, command_delay_s: 0.0, ..flight },
        }
    }

    /// The vehicle as it is, with its rotor lag and the command delay of flight.
    #[must_use]
    pub fn vehicle_as_it_is(&self, model: Model) -> Mismatch {
        let flight = self.law(Model::LagAndDelay, 1.0);
        let modelled_s = self.law(model, 1.0).command_delay_s;
        let delay_s = flight.command_delay_s - modelled_s;
        Mismatch { lag_s: self.vehicle.rotor_lag_s, inertia_ratio: 1.0, delay_s }
    }

    /// A world that is as this model assumes.
    #[must_use]
    pub fn as_modelled(&self, model: Model) -> Mismatch {
        let law = self.law(model, 1.0);
        Mismatch { lag_s: law.rotor_lag_s, inertia_ratio: 1.0, delay_s: 0.0 }
    }

    /// That world with one quantity changed.
    #[must_use]
    pub fn world(&self, model: Model, quantity: Quantity, value: f64) -> Mismatch {
        let modelled = self.as_modelled(model);
        match quantity {
            Quantity::Lag => Mismatch { lag_s: value, ..modelled },
            Quantity::Inertia => Mismatch { inertia_ratio: value, ..modelled },
            Quantity::Delay => Mismatch { delay_s: value / self.rate_hz, ..modelled },
        }
    }
}

/// The grid of a map.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// `r_w` \[rad²/(N m)²\].
    pub weights: Vec<f64>,
    /// Rotor lags \[s\].
    pub lags_s: Vec<f64>,
    pub inertia_ratios: Vec<f64>,
    /// Delays \[control periods\].
    pub delays: Vec<f64>,
}

impl Grid {
    /// `r_w` in four steps per decade from 0.01 to 100, 0 to 40 ms, 0.4 to 3 times, 0 to 3 periods.
    #[must_use]
    pub fn full() -> Self {
        Self {
            weights: decades(4),
            lags_s: steps(20, 0.0, 0.040),
            inertia_ratios: steps(26, 0.4, 3.0),
            delays: steps(12, 0.0, 3.0),
        }
    }

    /// The same range with few points.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            weights: decades(1),
            lags_s: steps(8, 0.0, 0.040),
            inertia_ratios: steps(13, 0.4, 3.0),
            delays: steps(6, 0.0, 3.0),
        }
    }

    /// Values of one quantity.
    #[must_use]
    pub fn values(&self, quantity: Quantity) -> &[f64] {
        match quantity {
            Quantity::Lag => &self.lags_s,
            Quantity::Inertia => &self.inertia_ratios,
            Quantity::Delay => &self.delays,
        }
    }

    /// Points of all maps together.
    #[must_use]
    pub fn points(&self) -> usize {
        let values = self.lags_s.len() + self.inertia_ratios.len() + self.delays.len();
        2 * values * self.weights.len()
    }
}

/// `n` + 1 equal steps.
fn steps(n: u16, from: f64, to: f64) -> Vec<f64> {
    (0..=n).map(|i| from + (to - from) * f64::from(i) / f64::from(n)).collect()
}

/// From 0.01 to 100 with this many steps per decade.
fn decades(per_decade: u16) -> Vec<f64> {
    let exponents = (0..=4 * per_decade).map(|i| f64::from(i) / f64::from(per_decade) - 2.0);
    exponents.map(|exponent| libm::pow(10.0, exponent)).collect()
}

/// Both methods at one point of a map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    /// The law's model.
    pub model: Model,
    /// What is varied.
    pub quantity: Quantity,
    /// `r_w` \[rad²/(N m)²\].
    pub increment_weight: f64,
    /// Value of the quantity, see [`Quantity`].
    pub value: f64,
    /// Largest magnitude of the closed loop's eigenvalues; stable below 1.
    pub spectral_radius: f64,
    /// The nonlinear vehicle's answer to a step.
    pub answer: Answer,
}

/// The nonlinear vehicle as it is, under a law.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settling {
    /// The law's model.
    pub model: Model,
    /// `r_w` \[rad²/(N m)²\].
    pub increment_weight: f64,
    /// The answer to a step.
    pub answer: Answer,
}

/// Maps and limits of one loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// The loop.
    pub bench: Bench,
    /// Points of the maps.
    pub grid: Grid,
    /// The maps.
    pub points: Vec<Point>,
    /// Their edges at some weights.
    pub limits: Vec<Limits>,
    /// What each model is worth on the vehicle as it is, at these weights.
    pub settling: Vec<Settling>,
}

/// Computes maps on `grid`, and limits at `weights`, on all cores; `progress` is called after each point.
///
/// # Errors
/// A law or vehicle that is impossible.
pub fn run(
    bench: &Bench,
    grid: &Grid,
    weights: &[f64],
    progress: Progress<'_>,
) -> Result<Study, StabilityError> {
    let mut rows = Vec::new();
    for quantity in QUANTITIES {
        for model in [Model::Bare, Model::LagAndDelay] {
            rows.extend(grid.weights.iter().map(|&weight| (model, quantity, weight)));
        }
    }
    let (mut edges, mut steps) = (Vec::new(), Vec::new());
    for &weight in weights {
        for model in [Model::Bare, Model::LagAndDelay] {
            edges.extend(QUANTITIES.map(|quantity| (model, weight, quantity)));
        }
        steps.extend([Model::Bare, Model::Lag, Model::LagAndDelay].map(|model| (model, weight)));
    }
    let points = fan_out(&rows, &|| (), |&(model, quantity, weight)| {
        let values = grid.values(quantity);
        row(bench, (model, quantity, weight), values, progress)
    })?;
    let points = points.concat();
    let limits = fan_out(&edges, &|| (), |&(model, weight, quantity)| {
        limits(bench, model, weight, quantity)
    })?;
    let settling = fan_out(&steps, &|| (), |&(model, increment_weight)| {
        let world = bench.vehicle_as_it_is(model);
        let answer = answer(bench, &bench.law(model, increment_weight), &world)?;
        Ok::<_, StabilityError>(Settling { model, increment_weight, answer })
    })?;
    Ok(Study { bench: *bench, grid: grid.clone(), points, limits, settling })
}

/// One row of a map.
fn row(
    bench: &Bench,
    (model, quantity, increment_weight): (Model, Quantity, f64),
    values: &[f64],
    progress: Progress<'_>,
) -> Result<Vec<Point>, StabilityError> {
    let law = bench.law(model, increment_weight);
    let linear = LinearLoop::new(bench, &law)?;
    let mut points = Vec::with_capacity(values.len());
    for &value in values {
        let world = bench.world(model, quantity, value);
        let spectral_radius = linear.spectral_radius(&world)?;
        let answer = answer(bench, &law, &world)?;
        points.push(Point { model, quantity, increment_weight, value, spectral_radius, answer });
        progress();
    }
    Ok(points)
}
