//! The starts that a rehearsal flies from: what is believed, and two more within its one-sigma.

use crate::Snapshot;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Flights of a rehearsal: the mean and two draws.
pub const DRAWS: usize = 3;

/// One start: by how much the vehicle is elsewhere than believed, and the seed of its sensors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Draw {
    /// 0 for the mean.
    pub index: usize,
    /// Real less believed position \[m\].
    pub position_w_m: [f64; 3],
    /// Real less believed velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Rotation vector from the believed to the real attitude, about the body axes \[rad\].
    pub attitude_b_rad: [f64; 3],
    /// Of the sensors; at most 2⁶³ − 1, which TOML can write.
    pub seed: u64,
}

/// The starts of swap number `swap` of a run. The stream's key holds both numbers, so that no two
/// rehearsals of a run, and none of another run, draw the same.
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
                // Uniform in [-1, 1), 53 bits.
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
