//! How the law brings a vehicle back that another controller has flown.
//!
//! From beside its path the vehicle returns along a path that fades, so that the set point does not jump at a swap between
//! healthy controllers. One that has been lost is caught: it is braked at once, and the tilt may be reversed faster.

use crate::memory::Memory;
use nalgebra::Vector3;

/// Distance from the reference \[m\] that another controller may leave and that is still driven away at once. What is beyond
/// it fades over [`RETURN_S`].
const NEAR_M: f64 = 0.01;
/// Distance from which on less of it fades, to nothing at twice the distance \[m\]: no healthy controller leaves the vehicle
/// so far away.
const FAR_M: f64 = 0.1;
/// A vehicle that is beyond this distance \[m\] in [`LOST_S`], if it goes on as it does, has been lost by the other
/// controller. It is caught until it is within [`FAR_M`].
const LOST_M: f64 = 1.5 * FAR_M;
/// About the time in which the tilt is reversed \[s\].
const LOST_S: f64 = 0.3;
/// Factor of the bound on the tilt's rate while the vehicle is caught: while the tilt is reversed it goes most of its way on.
const CATCHING_RATE: f64 = 2.0;
/// Time constant of the path back to the reference \[s\].
const RETURN_S: f64 = 0.5;

/// The path back to the reference.
#[derive(Debug)]
pub(crate) struct Takeover {
    /// What is left of it after each sample ahead.
    left: Vec<f64>,
}

impl Takeover {
    /// For a law that looks so many samples ahead.
    pub(crate) fn new(look_ahead: usize, period_s: f64) -> Self {
        let left = |j: usize| libm::exp(-(j as f64) * period_s / RETURN_S);
        Self { left: (0..=look_ahead).map(left).collect() }
    }

    pub(crate) fn look_ahead(&self) -> usize {
        self.left.len() - 1
    }

    /// What is left of the way back after each sample ahead.
    pub(crate) fn left(&self) -> &[f64] {
        &self.left
    }

    /// Where the path back is beside the reference \[m\], for a vehicle that will be `away_m` from it a sample later and moves
    /// relative to it with `velocity_m_s`. `is_another` if what is applied comes from another controller.
    pub(crate) fn beside(
        &self,
        memory: &mut Memory,
        away_m: Vector3<f64>,
        velocity_m_s: Vector3<f64>,
        is_another: bool,
    ) -> Vector3<f64> {
        let distance_m = away_m.norm();
        memory.catches = if memory.tracks || is_another {
            (away_m + velocity_m_s * LOST_S).norm() > LOST_M
        } else {
            memory.catches && distance_m > FAR_M
        };
        let beside = if memory.tracks {
            let fading_m = (distance_m - NEAR_M).min(2.0 * FAR_M - distance_m).max(0.0);
            away_m * (fading_m / distance_m.max(NEAR_M))
        } else {
            Vector3::from(memory.beside_w_m) * self.left[1]
        };
        memory.tracks = false;
        memory.beside_w_m = beside.into();
        beside
    }

    /// Factor of the bound on the tilt's rate.
    pub(crate) fn tilt_rate(memory: &Memory) -> f64 {
        if memory.catches { CATCHING_RATE } else { 1.0 }
    }
}
