//! Arms as they are drawn.
//!
//! How the linkage of the vehicle is made is not public, only where it brings the rotors: L(β). Drawn is
//! a scissor: two equal links whose ends are a hinge at the hub and the rotor. Opened by β it spans about
//! L(β), and it is placed so that the rotor is exactly there.

use core::f64::consts::FRAC_PI_2;
use vehicle::{Geometry, MorphAngle};

/// Directions of rotors 1 (front), 2 (left), 3 (rear) and 4 (right), from the nose \[rad\].
pub(super) const DIRECTIONS_RAD: [f64; 4] = [0.0, FRAC_PI_2, 2.0 * FRAC_PI_2, -FRAC_PI_2];

/// Arms of one vehicle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Linkage {
    geometry: Geometry,
    /// From the centre to the hinge of an arm \[m\].
    pub(super) hinge_m: f64,
    link_m: f64,
}

/// Arms at one β.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fold {
    pub(super) hinge_m: f64,
    /// From the centre to the rotor \[m\].
    pub(super) arm_m: f64,
    /// Length of each link \[m\].
    pub(super) link_m: f64,
    /// Between a link and the arm's direction; 0 is stretched \[rad\].
    pub(super) bend_rad: f64,
}

impl Linkage {
    /// The scissor that spans L(β) at both ends of the range when it is opened by β.
    pub(super) fn of(geometry: Geometry) -> Self {
        let half_sine = |beta: MorphAngle| libm::sin(0.5 * beta.rad());
        let (short_m, long_m) =
            (geometry.arm_length_m(MorphAngle::MIN), geometry.arm_length_m(MorphAngle::MAX));
        let opened = 2.0 * (half_sine(MorphAngle::MAX) - half_sine(MorphAngle::MIN));
        let link_m = ((long_m - short_m) / opened).max(0.0);
        let hinge_m = short_m - 2.0 * link_m * half_sine(MorphAngle::MIN);
        Self { geometry, hinge_m: hinge_m.clamp(0.2 * short_m, 0.6 * short_m), link_m }
    }

    /// Shortest arm \[m\].
    pub(super) fn shortest_m(&self) -> f64 {
        self.geometry.arm_length_m(MorphAngle::MIN)
    }

    /// Of a rotor as it is drawn: discs of neighbours leave a gap even at the shortest arms \[m\].
    pub(super) fn disc_radius_m(&self) -> f64 {
        0.45 * core::f64::consts::SQRT_2 * self.shortest_m()
    }

    /// The arms at an angle \[rad\]; outside the range, or not a number, at its nearest end.
    pub(super) fn fold(&self, beta_rad: f64) -> Fold {
        let beta = MorphAngle::saturating_from_rad(beta_rad).unwrap_or(MorphAngle::MIN);
        let arm_m = self.geometry.arm_length_m(beta);
        let span_m = (arm_m - self.hinge_m).max(0.0);
        // Links that do not reach are drawn longer.
        let link_m = self.link_m.max(0.5 * span_m);
        let bend_rad = libm::acos((0.5 * span_m / link_m).min(1.0));
        Fold { hinge_m: self.hinge_m, arm_m, link_m, bend_rad }
    }
}
