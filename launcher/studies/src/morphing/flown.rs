//! What is measured in one flight.

use super::{Flight, MorphingError, Verdict};
use ::verdict::LOST_M;
use observe::Observer;
use pilot::Trajectory;
use scenario::{Plan, Scenario};
use serde::Serialize;
use shared_types::{AppliedCommand, GateMode, Sample, Topic, Truth};
use simulate::in_process::fly;
use std::any::Any;

/// Stretch over which oscillation is judged \[ns\].
const STRETCH_NS: u64 = 500_000_000;
/// Root mean square of roll and pitch rate over a stretch that counts as oscillation \[rad/s\]:
/// quiet flights stay below 1, cycles are above 3.5.
const OSCILLATION_RAD_S: f64 = 2.0;

/// A stretch of the flight \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// First instant.
    pub from_s: f64,
    /// Last instant.
    pub to_s: f64,
}

/// One flight in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Flown {
    pub seed: u64,
    /// How it went.
    pub verdict: Verdict,
    /// Root mean square of the position error over the flight \[m\].
    pub rms_m: f64,
    /// Largest position error \[m\].
    pub peak_m: f64,
    /// Root mean square of the position error over the sweep windows of each sweep of the plan
    /// \[m\]; of interest is the flight's own sweep, and every one without morph.
    pub window_rms_m: Vec<f64>,
    /// Largest root mean square of roll and pitch rate over half a second \[rad/s\].
    pub oscillation_rad_s: f64,
}

/// One instant of the truth.
struct Instant {
    t_ns: u64,
    position_w_m: [f64; 3],
    /// Square of roll and pitch rate \[rad²/s²\].
    rate_square: f64,
}

/// The truth at every tick, and whether the gate ever left its normal mode.
#[derive(Default)]
struct Witness {
    instants: Vec<Instant>,
    gate_took_over: bool,
}

impl Observer for Witness {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            let [p, q, _] = truth.body_rate_b_rad_s;
            self.instants.push(Instant {
                t_ns: truth.header.valid_ns,
                position_w_m: truth.position_w_m,
                rate_square: p * p + q * q,
            });
        } else if let Some(applied) = any.downcast_ref::<AppliedCommand>() {
            self.gate_took_over |= applied.mode != GateMode::Normal;
        }
    }
}

/// Flies one flight and measures it over `windows`, one list per sweep of the plan.
pub(super) fn fly_one(
    scenario: &Scenario,
    flight: &Flight,
    windows: &[Vec<Window>],
) -> Result<Flown, MorphingError> {
    let witness = fly(scenario, flight.conditions.state, Witness::default())?;
    let errors = errors(scenario, &witness);
    let rms = |chosen: &dyn Fn(f64) -> bool| {
        let squares = errors.iter().filter(|(t_s, _)| chosen(*t_s)).map(|(_, e)| e * e);
        let (count, sum) = squares.fold((0_u32, 0.0), |(n, sum), square| (n + 1, sum + square));
        (sum / f64::from(count.max(1))).sqrt()
    };
    let inside = |windows: &[Window], t_s| windows.iter().any(|w| w.from_s <= t_s && t_s <= w.to_s);
    let peak_m = errors.iter().map(|(_, e)| *e).fold(0.0, f64::max);
    let oscillation_rad_s = oscillation_rad_s(&witness.instants);
    Ok(Flown {
        seed: flight.seed,
        verdict: if witness.gate_took_over || peak_m > LOST_M {
            Verdict::Lost
        } else if oscillation_rad_s > OSCILLATION_RAD_S {
            Verdict::LimitCycle
        } else {
            Verdict::Flown
        },
        rms_m: rms(&|_| true),
        peak_m,
        window_rms_m: windows.iter().map(|list| rms(&|t_s| inside(list, t_s))).collect(),
        oscillation_rad_s,
    })
}

/// Time \[s\] and distance \[m\] from the trajectory of every instant.
fn errors(scenario: &Scenario, witness: &Witness) -> Vec<(f64, f64)> {
    let Plan::Flight(plan) = scenario.plan() else { return Vec::new() };
    let Ok(trajectory) = Trajectory::new(&plan.trajectory) else { return Vec::new() };
    let error = |instant: &Instant| {
        let wanted = trajectory.at(instant.t_ns).position_w_m;
        let squares = wanted.iter().zip(&instant.position_w_m).map(|(a, b)| (a - b) * (a - b));
        (instant.t_ns as f64 * 1e-9, squares.sum::<f64>().sqrt())
    };
    witness.instants.iter().map(error).collect()
}

/// Largest root mean square rate over a stretch \[rad/s\].
fn oscillation_rad_s(instants: &[Instant]) -> f64 {
    let stretches = instants.chunk_by(|a, b| a.t_ns / STRETCH_NS == b.t_ns / STRETCH_NS);
    let mean = |part: &[Instant]| {
        part.iter().map(|i| i.rate_square).sum::<f64>() / part.len().max(1) as f64
    };
    stretches.map(mean).fold(0.0, f64::max).sqrt()
}
