//! The unconstrained closed loop on the roll axis as a matrix, and its eigenvalues.
//!
//! The law is linear as long as no bound is active. Its matrix is taken from the law itself: what
//! it makes of each entry of its memory and of each measurement. The plant is sampled exactly.

use super::{Bench, Mismatch, StabilityError};
use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Input, Memory, Setpoint};
use faer::Mat;
use nalgebra::{SMatrix, SVector, Vector3};

/// Entries of the law's memory that belong to roll.
const MEMORY: usize = 7;
/// The one that is the command in force.
const COMMAND: usize = 6;
/// Roll, its rate and the torque.
const PLANT: usize = 3;
/// Size of a probe: far from every bound, far above rounding.
const PROBE: f64 = 1e-5;

type LawMatrix = SMatrix<f64, MEMORY, { MEMORY + 2 }>;

fn roll(memory: &Memory) -> SVector<f64, MEMORY> {
    SVector::from([
        memory.gamma_rad[0],
        memory.gamma_rate_rad_s[0],
        memory.actuators.torque_nm[0],
        memory.actuators.applied_nm[0],
        memory.previous_actuator_nm[0],
        memory.previous_applied_nm[0],
        memory.actuators.command_nm[0],
    ])
}

fn with_roll(memory: &Memory, entry: usize, value: f64) -> Memory {
    let mut memory = *memory;
    *[
        &mut memory.gamma_rad[0],
        &mut memory.gamma_rate_rad_s[0],
        &mut memory.actuators.torque_nm[0],
        &mut memory.actuators.applied_nm[0],
        &mut memory.previous_actuator_nm[0],
        &mut memory.previous_applied_nm[0],
        &mut memory.actuators.command_nm[0],
    ][entry] = value;
    memory
}

/// A law and a vehicle, closed.
#[derive(Debug, Clone)]
pub struct LinearLoop {
    /// Memory after a step, from memory before it, roll and roll rate.
    law: LawMatrix,
    period_s: f64,
    modelled_delay_s: f64,
    modelled_inertia_kg_m2: f64,
}

impl LinearLoop {
    /// Takes the law's matrix at hover.
    ///
    /// # Errors
    /// An impossible law.
    pub fn new(bench: &Bench, config: &AttitudeLawConfig) -> Result<Self, StabilityError> {
        let mut law = AttitudeLaw::new(*config, &bench.vehicle)?;
        let step = |law: &mut AttitudeLaw, roll_rad: f64, rate_rad_s: f64| {
            law.step(&Input {
                gamma_rad: Vector3::new(roll_rad, 0.0, 0.0),
                body_rate_rad_s: Vector3::new(rate_rad_s, 0.0, 0.0),
                age_s: 0.0,
                morph_angle: bench.morph_angle,
                setpoint: Setpoint {
                    gamma_rad: Vector3::zeros(),
                    thrust_n: bench.vehicle.weight_n(),
                },
                applied_torque_nm: None,
            });
            roll(law.memory())
        };
        step(&mut law, 0.0, 0.0);
        let rest = *law.memory();
        let mut matrix = LawMatrix::zeros();
        for column in 0..MEMORY + 2 {
            let (mut memory, mut measured) = (rest, [0.0; 2]);
            if column < MEMORY {
                memory = with_roll(&rest, column, PROBE);
            } else {
                measured[column - MEMORY] = PROBE;
            }
            law.restore(&memory)?;
            let after = step(&mut law, measured[0], measured[1]);
            matrix.set_column(column, &(after / PROBE));
        }
        Ok(Self {
            law: matrix,
            period_s: config.period_s(),
            modelled_delay_s: config.command_delay_s,
            modelled_inertia_kg_m2: bench.vehicle.inertia_kg_m2(bench.morph_angle).x,
        })
    }

    /// The command as the law makes it: coefficients of its memory, of roll and of roll rate.
    #[cfg(test)]
    pub(super) fn command_row(&self) -> Vec<f64> {
        self.law.row(COMMAND).iter().copied().collect()
    }

    /// Largest magnitude of the eigenvalues of one control period in the world of `mismatch`.
    ///
    /// # Errors
    /// The eigenvalue iteration failed.
    pub fn spectral_radius(&self, mismatch: &Mismatch) -> Result<f64, StabilityError> {
        let delay_s = self.modelled_delay_s + mismatch.delay_s;
        // Rounding must not make a whole number of periods one more.
        let whole = (delay_s / self.period_s + 1e-9).floor();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 4")]
        let queued = whole as usize + 1;
        let early_s = (delay_s - whole * self.period_s).max(0.0);
        let size = PLANT + MEMORY + queued;
        let mut closed = Mat::<f64>::zeros(size, size);
        for column in 0..size {
            let mut unit = vec![0.0; size];
            unit[column] = 1.0;
            let after = self.period(&unit, mismatch, early_s);
            for (row, value) in after.into_iter().enumerate() {
                closed[(row, column)] = value;
            }
        }
        let eigenvalues = closed
            .eigenvalues()
            .map_err(|_| StabilityError::Eigenvalues { lag_s: mismatch.lag_s })?;
        Ok(eigenvalues.iter().map(|value| value.norm()).fold(0.0, f64::max))
    }

    /// One period from sample to sample; `state` is plant, memory, past commands from the newest.
    fn period(&self, state: &[f64], mismatch: &Mismatch, early_s: f64) -> Vec<f64> {
        let (plant, rest) = state.split_at(PLANT);
        let (memory, past) = rest.split_at(MEMORY);
        let mut known = SVector::<f64, { MEMORY + 2 }>::zeros();
        known.rows_mut(0, MEMORY).copy_from_slice(memory);
        (known[MEMORY], known[MEMORY + 1]) = (plant[0], plant[1]);
        let memory = self.law * known;
        let commands: Vec<f64> =
            [memory[COMMAND]].into_iter().chain(past.iter().copied()).collect();
        // The delay is past.len() − 1 periods and `early_s`: the oldest command holds until then.
        let (oldest, newer) = (commands[past.len()], commands[past.len() - 1]);
        let axis = Axis {
            gain: 1.0 / (self.modelled_inertia_kg_m2 * mismatch.inertia_ratio),
            lag_s: mismatch.lag_s,
        };
        let plant = axis.after([plant[0], plant[1], plant[2]], oldest, early_s);
        let plant = axis.after(plant, newer, self.period_s - early_s);
        let mut after = plant.to_vec();
        after.extend(memory.iter());
        after.extend(&commands[..past.len()]);
        after
    }
}

/// φ̈ = gain τ, τ̇ = (u − τ) / lag.
struct Axis {
    gain: f64,
    lag_s: f64,
}

impl Axis {
    /// Roll, rate and torque after `h` seconds of the command `u`, exactly.
    fn after(&self, [angle, rate, torque]: [f64; 3], u: f64, h: f64) -> [f64; 3] {
        let lag = self.lag_s;
        let share = if lag > 0.0 { -libm::expm1(-h / lag) } else { 1.0 };
        let share = if h > 0.0 { share } else { 0.0 };
        let excess = torque - u;
        let once = u * h + excess * lag * share;
        let twice = 0.5 * u * h * h + excess * lag * (h - lag * share);
        [angle + rate * h + self.gain * twice, rate + self.gain * once, u + excess * (1.0 - share)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sampled_axis_is_what_fine_integration_makes_of_it() {
        let axis = Axis { gain: 1e4, lag_s: 0.015 };
        let (mut fine, steps) = ([0.1, -0.2, 0.03], 20_000);
        let h = 0.01 / f64::from(steps);
        for _ in 0..steps {
            // Midpoint rule.
            let slope = |[_, rate, torque]: [f64; 3]| {
                [rate, axis.gain * torque, (0.05 - torque) / axis.lag_s]
            };
            let first = slope(fine);
            let middle = slope(core::array::from_fn(|i| fine[i] + 0.5 * h * first[i]));
            fine = core::array::from_fn(|i| fine[i] + h * middle[i]);
        }
        let exact = axis.after([0.1, -0.2, 0.03], 0.05, 0.01);
        for (exact, fine) in exact.iter().zip(fine) {
            assert!((exact - fine).abs() < 1e-7, "{exact} {fine}");
        }
    }

    #[test]
    fn no_lag_is_the_limit_of_a_short_one() {
        let after = |lag_s| Axis { gain: 1e4, lag_s }.after([0.1, 0.0, 0.0], 0.05, 0.01);
        for (none, short) in after(0.0).into_iter().zip(after(1e-9)) {
            assert!((none - short).abs() < 1e-6, "{none} {short}");
        }
    }
}
