//! The edges of stability along one quantity.

use super::{Bench, LinearLoop, Mismatch, Model, Quantity, StabilityError, answer};
use attitude_mpc::AttitudeLawConfig;
use serde::Serialize;

/// Largest rotor lag looked at \[s\]; a loop that is stable up to an end has no limit there.
const MAX_LAG_S: f64 = 0.5;
/// Least and largest inertia looked at, over the modelled one.
const INERTIA_RATIOS: [f64; 2] = [0.05, 50.0];
/// Longest delay looked at \[control periods\].
const MAX_DELAY: f64 = 10.0;
/// Halvings of the bracket.
const HALVINGS: usize = 12;

/// A stable interval around the modelled value; an end is absent if there is no limit, both are
/// if the loop is unstable even in the world of its own model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Range {
    /// Stable in a world that is as modelled.
    pub stable: bool,
    /// Least stable value.
    pub from: Option<f64>,
    /// Largest stable value.
    pub to: Option<f64>,
}

/// The three ranges by both methods.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limits {
    /// The law's model.
    pub model: Model,
    /// `r_w` \[rad²/(N m)²\].
    pub increment_weight: f64,
    /// What is varied.
    pub quantity: Quantity,
    /// By the eigenvalues.
    pub linear: Range,
    /// By the nonlinear vehicle's answer to a step.
    pub simulated: Range,
}

/// The stable range of a quantity around the world as modelled.
///
/// # Errors
/// A law or vehicle that is impossible.
pub fn limits(
    bench: &Bench,
    model: Model,
    increment_weight: f64,
    quantity: Quantity,
) -> Result<Limits, StabilityError> {
    let law = bench.law(model, increment_weight);
    let closed = LinearLoop::new(bench, &law)?;
    let is_stable =
        |value: f64| Ok(closed.spectral_radius(&bench.world(model, quantity, value))? < 1.0);
    let settles =
        |value: f64| Ok(answer(bench, &law, &bench.world(model, quantity, value))?.is_stable());
    let (modelled, ends) = match quantity {
        Quantity::Lag => (law.rotor_lag_s, [0.0, MAX_LAG_S]),
        Quantity::Inertia => (1.0, INERTIA_RATIOS),
        Quantity::Delay => (0.0, [0.0, MAX_DELAY]),
    };
    Ok(Limits {
        model,
        increment_weight,
        quantity,
        linear: range(&is_stable, modelled, ends)?,
        simulated: range(&settles, modelled, ends)?,
    })
}

/// The longest delay beyond the modelled one at which a law is stable with the vehicle as it is, by the eigenvalues; none if
/// there is no limit, and 0 if it is not stable without any \[s\].
///
/// # Errors
/// A law or vehicle that is impossible.
pub fn delay_margin_s(
    bench: &Bench,
    law: &AttitudeLawConfig,
) -> Result<Option<f64>, StabilityError> {
    let closed = LinearLoop::new(bench, law)?;
    let is_stable = |periods: f64| {
        let delay_s = periods / bench.rate_hz;
        let world = Mismatch { lag_s: bench.vehicle.rotor_lag_s, inertia_ratio: 1.0, delay_s };
        Ok(closed.spectral_radius(&world)? < 1.0)
    };
    let Range { stable, to, .. } = range(&is_stable, 0.0, [0.0, MAX_DELAY])?;
    Ok(if stable { to.map(|periods| periods / bench.rate_hz) } else { Some(0.0) })
}

type Test<'a> = &'a dyn Fn(f64) -> Result<bool, StabilityError>;

fn range(stable: Test, modelled: f64, ends: [f64; 2]) -> Result<Range, StabilityError> {
    if !stable(modelled)? {
        return Ok(Range::default());
    }
    let [from, to] = ends.map(|end| edge(stable, modelled, end));
    Ok(Range { stable: true, from: from?, to: to? })
}

/// The last stable value on the way from `inside` to `end`; none if all are. Walks in small steps
/// first, so that it finds the first edge and not a later one.
fn edge(stable: Test, inside: f64, end: f64) -> Result<Option<f64>, StabilityError> {
    const STRIDES: u16 = 60;
    // Small steps near the model, larger ones far from it.
    let at = |i: u16| {
        let part = f64::from(i) / f64::from(STRIDES);
        inside + (end - inside) * part * part
    };
    let mut good = inside;
    for i in 1..=STRIDES {
        let mut bad = at(i);
        if stable(bad)? {
            good = bad;
            continue;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (good + bad);
            if stable(middle)? { good = middle } else { bad = middle }
        }
        return Ok(Some(good));
    }
    Ok(None)
}
