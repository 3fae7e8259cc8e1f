//! A bound on the tilt in every direction alike.
//!
//! (θ₀, φ₀) are tangents of the tilt, so that √(θ₀² + φ₀²) is the tangent of the angle between thrust and vertical. The
//! cone is bounded by the regular polygon of sixteen sides that lies within it: at most 2 % of the bound are given away.

use mpc::Coupled;

/// What `tilt_max_rad` bounds.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    serde::Deserialize,
    serde::Serialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum TiltBound {
    /// |φ| and |θ| each, at ψ = 0: in between the vehicle may tilt by √2 times as much.
    #[default]
    Box,
    /// The angle between thrust and vertical.
    Cone,
}

/// Half of the sides; the others are opposite.
const SIDES: usize = 8;
/// cos and sin of multiples of π/8.
const C1: f64 = 0.923_879_532_511_286_7;
const S1: f64 = 0.382_683_432_365_089_8;
const C2: f64 = core::f64::consts::FRAC_1_SQRT_2;
/// Normals of the sides.
pub(crate) static NORMALS: [[f64; 3]; SIDES] = [
    [1.0, 0.0, 0.0],
    [C1, S1, 0.0],
    [C2, C2, 0.0],
    [S1, C1, 0.0],
    [0.0, 1.0, 0.0],
    [-S1, C1, 0.0],
    [-C2, C2, 0.0],
    [-C1, S1, 0.0],
];

/// The bounds on its sides; none for a box.
#[derive(Debug, Clone)]
pub(crate) struct Cone {
    lower: [f64; SIDES],
    upper: [f64; SIDES],
    sides: usize,
}

impl Cone {
    pub(crate) fn of(kind: TiltBound, tilt_max_rad: f64) -> Self {
        // The distance of the sides from the middle.
        let within = libm::cos(core::f64::consts::PI / (2 * SIDES) as f64);
        let bound = within * libm::tan(tilt_max_rad);
        let sides = if kind == TiltBound::Cone { SIDES } else { 0 };
        Self { lower: [-bound; SIDES], upper: [bound; SIDES], sides }
    }

    pub(crate) fn rows(&self) -> Coupled<'_, 3> {
        Coupled {
            normals: &NORMALS[..self.sides],
            lower: &self.lower[..self.sides],
            upper: &self.upper[..self.sides],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_polygon_lies_within_the_cone_and_gives_away_two_percent() {
        let cone = Cone::of(TiltBound::Cone, 0.35);
        let bound = libm::tan(0.35);
        for degrees in 0..360 {
            let (s, c) = libm::sincos(f64::from(degrees).to_radians());
            let rows = cone.rows();
            let reach =
                rows.normals.iter().zip(rows.upper).fold(f64::INFINITY, |reach, (n, upper)| {
                    reach.min(upper / (n[0] * c + n[1] * s).abs())
                });
            assert!((0.98 * bound..=bound * (1.0 + 1e-12)).contains(&reach), "{degrees}: {reach}");
        }
        assert!(Cone::of(TiltBound::Box, 0.35).rows().normals.is_empty());
    }
}
