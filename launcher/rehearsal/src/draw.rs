//! The initial states of a rehearsal: the estimated state, and two more drawn within one sigma of it.

use crate::Snapshot;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Flights of a rehearsal: the mean and two draws.
pub const DRAWS: usize = 3;

/// One initial state, as the difference between the simulated vehicle and the estimate, and the seed of its
/// sensor noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Draw {
    /// Number of the flight; 0 starts from the estimate itself.
    pub index: usize,
    /// True minus estimated position, in the world frame \[m\].
    pub position_w_m: [f64; 3],
    /// True minus estimated velocity, in the world frame \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Rotation vector from the estimated to the true attitude, in body axes \[rad\].
    pub attitude_b_rad: [f64; 3],
    /// Seed of the sensor noise; at most 2⁶³ − 1, the largest integer that TOML can represent.
    pub seed: u64,
}

/// The initial states for swap number `swap` of the run with the seed `run_seed`, uniform within one sigma
/// per axis. The key of the random stream holds both numbers, so that no two rehearsals of a run, and no two
/// runs, share their random numbers.
#[must_use]
pub fn draws(snapshot: &Snapshot, run_seed: u64, swap: u64) -> [Draw; DRAWS] {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&run_seed.to_le_bytes());
    key[8..16].copy_from_slice(&swap.to_le_bytes());
    key[16..25].copy_from_slice(b"rehearsal");
    let mut generator = ChaCha8Rng::from_seed(key);
    core::array::from_fn(|index| {
        let seed = generator.next_u64() >> 1;
        let mut within = |sigma: [f64; 3]| {
            sigma.map(|sigma| {
                // Uniform in [-1, 1), with 53 random bits.
                let unit = (generator.next_u64() >> 11) as f64 * f64::EPSILON - 1.0;
                if index == 0 { 0.0 } else { sigma * unit }
            })
        };
        Draw {
            index,
            position_w_m: within(snapshot.position_sigma_w_m),
            velocity_w_m_s: within(snapshot.velocity_sigma_w_m_s),
            attitude_b_rad: within(snapshot.attitude_sigma_b_rad),
            seed,
        }
    })
}
