//! A step of the set point with the nonlinear vehicle, its rotors and the law's constraints.

use super::{Bench, Mismatch, StabilityError};
use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Input, LawStatus, Setpoint};
use nalgebra::Vector3;
use serde::Serialize;
use shared_types::time::ns_from_s;
use std::collections::VecDeque;
use vehicle::{
    Actuation, Disturbance, NonlinearModel, PlantInputs, PlantModel, RigidBodyState, StepStatus,
    VehicleParameters, Wrench, euler_from_quaternion,
};

/// Set point of roll \[rad\].
const STEP_RAD: f64 = 0.2;
/// Half width of the band that counts as settled \[rad\].
const BAND_RAD: f64 = 0.004;
/// Until when what has not settled is flown \[ns\], and over how many last stretches its movement
/// must shrink to be flown further, and in the end to count as slow.
const PATIENCE: [(u64, usize); 2] = [(3_000_000_000, 4), (6_000_000_000, 10)];
/// Within the band for so long counts as settled \[ms\]: whatever the step has set in motion would
/// have left it again.
const SETTLED_MS: usize = 1000;
/// Stretch by whose extent a movement is judged \[ms\].
const STRETCH_MS: usize = 500;
/// What is slow shrinks at least so much from a stretch to the next; weaker damping counts as none.
const SHRINKS: f64 = 0.97;
/// A vehicle that rolls further is lost \[rad\].
const LOST_RAD: f64 = 1.2;
/// Shortest lag that the vehicle's equations take \[s\].
const MIN_LAG_S: f64 = 1e-4;
/// Longest integration step \[ns\].
const TICK_NS: u64 = 1_000_000;

/// What became of the step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Answer {
    /// Within ±4 mrad from this time on \[s\].
    Settled(f64),
    /// Not yet there, but its movement shrinks.
    Slow,
    /// Moves on and on, by this much from peak to peak \[rad\].
    LimitCycle(f64),
    /// The vehicle was lost.
    Lost,
}

impl Answer {
    /// True if it settles, be it slowly.
    #[must_use]
    pub fn is_stable(self) -> bool {
        matches!(self, Self::Settled(_) | Self::Slow)
    }
}

/// Flies the step in the world of `mismatch`.
///
/// # Errors
/// An impossible law or vehicle.
pub fn answer(
    bench: &Bench,
    config: &AttitudeLawConfig,
    mismatch: &Mismatch,
) -> Result<Answer, StabilityError> {
    let mut law = AttitudeLaw::new(*config, &bench.vehicle)?;
    let mut world = World::new(bench, mismatch, config.command_delay_s + mismatch.delay_s)?;
    let mut rolls = Vec::with_capacity(6001);
    for (until_ns, stretches) in PATIENCE {
        if let Some(answer) = fly_until(until_ns, bench, &mut law, &mut world, &mut rolls) {
            return Ok(answer);
        }
        let extents = extents_rad(&rolls, stretches);
        if extents.windows(2).any(|pair| pair[1] >= SHRINKS * pair[0]) {
            return Ok(Answer::LimitCycle(extents.last().copied().unwrap_or(f64::NAN)));
        }
    }
    Ok(Answer::Slow)
}

/// Flies on to `until_ns`, or to a vehicle that is settled or lost.
fn fly_until(
    until_ns: u64,
    bench: &Bench,
    law: &mut AttitudeLaw,
    world: &mut World,
    rolls: &mut Vec<f64>,
) -> Option<Answer> {
    let period_ns = ns_from_s(1.0 / bench.rate_hz);
    while world.now_ns < until_ns {
        let state = *world.plant.state();
        let output = law.step(&Input {
            gamma_rad: euler_from_quaternion(&state.q_wb),
            body_rate_rad_s: state.omega_b,
            morph_angle: state.beta,
            setpoint: Setpoint {
                gamma_rad: Vector3::new(STEP_RAD, 0.0, 0.0),
                thrust_n: bench.vehicle.weight_n(),
            },
            age_s: 0.0,
            // The command path's delay is what the law does not know; no report contains it.
            applied_torque_nm: None,
        });
        world.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
        let advanced = world.advance(world.now_ns + period_ns, rolls);
        let rolled = rolls.last().is_some_and(|roll: &f64| roll.abs() > LOST_RAD);
        if !advanced || rolled || matches!(output.status, LawStatus::Refused(_)) {
            return Some(Answer::Lost);
        }
        if let Some(settling_s) = settled_s(rolls) {
            return Some(Answer::Settled(settling_s));
        }
    }
    None
}

/// When the roll entered the band for good, once it has been there long enough; `rolls` are a
/// millisecond apart.
fn settled_s(rolls: &[f64]) -> Option<f64> {
    let outside = rolls.iter().rposition(|roll| (roll - STEP_RAD).abs() > BAND_RAD);
    let since = outside.map_or(0, |last| last + 1);
    (since + SETTLED_MS <= rolls.len()).then_some((since + 1) as f64 * 1e-3)
}

/// How far the roll moved in each of the last `count` stretches \[rad\]. A cycle's extent may
/// wander; what dies out shrinks from each to the next.
fn extents_rad(rolls: &[f64], count: usize) -> Vec<f64> {
    let last = &rolls[rolls.len().saturating_sub(count * STRETCH_MS)..];
    let extent = |part: &[f64]| {
        let (least, most) =
            part.iter().fold((f64::MAX, f64::MIN), |(l, m), roll| (l.min(*roll), m.max(*roll)));
        most - least
    };
    last.chunks(STRETCH_MS).map(extent).collect()
}

/// The vehicle with its command path.
struct World {
    plant: NonlinearModel,
    morph_rad: f64,
    delay_ns: u64,
    now_ns: u64,
    in_effect: Wrench,
    pending: VecDeque<(u64, Wrench)>,
}

impl World {
    fn new(bench: &Bench, mismatch: &Mismatch, delay_s: f64) -> Result<Self, StabilityError> {
        let real = VehicleParameters {
            rotor_lag_s: mismatch.lag_s.max(MIN_LAG_S),
            inertia_scale: bench.vehicle.inertia_scale * mismatch.inertia_ratio,
            ..bench.vehicle
        };
        let state = RigidBodyState::hover(&real, Vector3::zeros(), bench.morph_angle);
        Ok(Self {
            plant: NonlinearModel::new(real, None, state)?,
            morph_rad: bench.morph_angle.rad(),
            delay_ns: ns_from_s(delay_s),
            now_ns: 0,
            in_effect: Wrench::thrust(real.weight_n()),
            pending: VecDeque::new(),
        })
    }

    fn command(&mut self, wrench: Wrench) {
        self.pending.push_back((self.now_ns + self.delay_ns, wrench));
    }

    /// Integrates to `until_ns`, split at whole milliseconds and where a command takes effect;
    /// keeps the roll of each millisecond. False if the equations have no answer.
    fn advance(&mut self, until_ns: u64, rolls: &mut Vec<f64>) -> bool {
        while self.now_ns < until_ns {
            while let Some((_, wrench)) = self.pending.pop_front_if(|(at, _)| *at <= self.now_ns) {
                self.in_effect = wrench;
            }
            let tick = (self.now_ns / TICK_NS + 1) * TICK_NS;
            let next = self.pending.front().map_or(tick, |(at, _)| tick.min(*at)).min(until_ns);
            let inputs = PlantInputs {
                actuation: Actuation::Wrench(self.in_effect),
                morph_command_rad: self.morph_rad,
                disturbance: Disturbance::default(),
            };
            let stretch_s = (next - self.now_ns) as f64 * 1e-9;
            if self.plant.step(stretch_s, &inputs) != StepStatus::Advanced {
                return false;
            }
            self.now_ns = next;
            if next.is_multiple_of(TICK_NS) {
                rolls.push(euler_from_quaternion(&self.plant.state().q_wb).x);
            }
        }
        true
    }
}
